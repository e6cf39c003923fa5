// mesh.h: the triangle mesh amps works on, what can be measured on it, and a report of what is wrong with an input.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/buffers.h"
#include "amps/execution.h"

#include <cmath>
#include <iosfwd>
#include <utility>
#include <vector>

namespace amps {

/// An indexed triangle mesh that owns its buffers. Soups, open, non-manifold and inconsistently oriented meshes are all fine.
struct Mesh {
  Points vertices;      ///< #V by 3
  Triangles triangles;  ///< #F by 3
  /// What readers say of a file of polygons; nothing else fills or reads it. By triangle the number of its polygon, from 0 in
  /// the order of the file, all faces counted; empty where triangle f is face f.
  std::vector<Index> polygons = {};
  std::vector<Index> crossing_polygons = {};  ///< those that cross themselves, ascending: their triangles are a guess
};

/// What functions take: a view of somebody's buffers (buffers.h), made from a Mesh or from views of vertices and triangles,
/// that is also from Eigen matrices of any storage order. Valid while the buffers are; a temporary Mesh is taken over.
struct MeshView {
  PointsView vertices;
  TrianglesView triangles;

  MeshView(const Mesh& mesh) : vertices(mesh.vertices), triangles(mesh.triangles) {}  // NOLINT: implicit by design
  MeshView(Mesh&& mesh) : vertices(std::move(mesh.vertices)), triangles(std::move(mesh.triangles)) {}  // NOLINT
  MeshView(PointsView v, TrianglesView t) : vertices(std::move(v)), triangles(std::move(t)) {}

  Index num_vertices() const { return static_cast<Index>(vertices.rows()); }
  Index num_facets() const { return static_cast<Index>(triangles.rows()); }
  Vec3 corner(Index facet, int k) const { return vertices[triangles(facet, k)]; }
  /// A mesh of its own, with the facets' indices as they are.
  AMPS_EXPORT Mesh copy() const;
};

/// A point on a mesh: `position` = Σ barycentric[k] · corner k of `facet`. Interpolate UVs, colours or weights with it.
struct SurfacePoint {
  Index facet = kNone;
  Vec3 barycentric = Vec3::Zero();  ///< non-negative, sums to 1
  Vec3 position = Vec3::Zero();
};

/// Throws Error(kInvalidMesh) naming the first offending vertex or facet, and what to do, if the mesh has no facet, a
/// coordinate that is NaN or infinite, an index out of range, or no facet with an area (at the scale of its coordinates);
/// Error(kTooLarge) for more than 2^31 − 1 vertices or facets. Everything else works.
AMPS_EXPORT void require_usable(const MeshView& mesh, const Execution& execution = {});

/// A vertex so far away that no radius suits the mesh: more than 0.95 of the corners of facets lie so near to each other,
/// beside the size of the whole, that they would be nothing to the least disks that sampling takes (10⁻⁶ of the diagonal). The
/// farthest such vertex; kNone if there is none, as in meshes of fewer than 12 facets. Facets with a vertex that is out of
/// range or not finite do not count. O(#F) where there is one, else next to nothing but the box.
AMPS_EXPORT Index find_wild_vertex(const MeshView& mesh, const Execution& execution = {});

// All functions of this file are O(#V + #F) expected and thread-safe. They use no thread of their Execution, and throw
// Error(kCancelled) if stopped through it. Those below, but topology() and check(), throw Error(kInvalidMesh) for an index out
// of range.

/// Area of each facet, absolute units; exactly 0 where the corners are exactly collinear, and where all three are those of an
/// earlier facet, by position and in any order: a surface that is there twice is one. Good at any scale whose squares a double
/// holds. total_area is a compensated sum, so it does not depend on the order of facets beyond its last bits.
AMPS_EXPORT std::vector<double> facet_areas(const MeshView& mesh, const Execution& execution = {});
AMPS_EXPORT double total_area(const MeshView& mesh, const Execution& execution = {});

namespace detail {

/// facet_areas() and their total_area(), for those who need both.
struct FacetAreas {
  std::vector<double> of_facets;
  double total = 0;

  FacetAreas() = default;
  explicit FacetAreas(const MeshView& mesh, const Execution& execution = {});
  /// Where it is known which facets are there already.
  FacetAreas(const MeshView& mesh, const std::vector<Index>& repeated_facets, const Execution& execution = {});
};

}  // namespace detail

/// #F by 3 unit normals by the right-hand rule; zero rows for degenerate facets.
AMPS_EXPORT Points facet_normals(const MeshView& mesh, const Execution& execution = {});

/// Smallest box around the vertices that facets use, NaN left out; a point at the origin if there is no facet.
struct Box {
  Vec3 min = Vec3::Zero();
  Vec3 max = Vec3::Zero();
  AMPS_EXPORT double diagonal() const;  ///< at any scale; infinite where it is no double
};
AMPS_EXPORT Box bounding_box(const MeshView& mesh, const Execution& execution = {});

/// Vertices used by no facet dropped, the rest renumbered in order.
AMPS_EXPORT Mesh remove_isolated_vertices(const MeshView& mesh, const Execution& execution = {});

/// Vertices with equal coordinates merged (−0 equals 0), first of each kept, in order; facets keep their number and order.
AMPS_EXPORT Mesh merge_equal_vertices(const MeshView& mesh, const Execution& execution = {});

/// The combinatorial shape of a mesh, facets with repeated indices left out and isolated vertices not counted.
struct TopologyReport {
  Index vertices = 0;               ///< used by at least one facet
  Index edges = 0;                  ///< undirected, distinct
  Index facets = 0;                 ///< without those of repeated indices
  Index components = 0;             ///< connected through shared vertices
  Index euler_characteristic = 0;   ///< vertices − edges + facets
  Index boundary_edges = 0;         ///< edges of exactly one facet
  Index boundary_loops = 0;         ///< closed curves the boundary edges form; curves of different fans at a vertex are apart
  Index non_manifold_edges = 0;     ///< edges of three or more facets
  Index non_manifold_vertices = 0;  ///< vertices, on no non-manifold edge, whose facets do not form one fan
  Index inconsistent_edges = 0;     ///< edges two facets traverse in the same direction
  bool closed() const { return boundary_edges == 0 && non_manifold_edges == 0; }
  bool manifold() const { return non_manifold_edges == 0 && non_manifold_vertices == 0; }
  /// Sum over components, meaningful for orientable manifolds: (2·components − boundary_loops − euler_characteristic) / 2.
  Index genus() const { return (2 * components - boundary_loops - euler_characteristic) / 2; }
};

/// Facets with an index out of range are left out too; no other error.
AMPS_EXPORT TopologyReport topology(const MeshView& mesh, const Execution& execution = {});
AMPS_EXPORT std::ostream& operator<<(std::ostream& out, const TopologyReport& report);

/// Everything a user should know about an input before sampling it.
struct MeshReport {
  Index vertices = 0;
  Index facets = 0;
  Index non_finite_vertices = 0;
  Index out_of_range_facets = 0;    ///< a corner index < 0 or ≥ #V
  Index repeated_index_facets = 0;  ///< two corners share an index
  Index zero_area_facets = 0;       ///< distinct indices, exactly collinear corners (decided exactly)
  Index repeated_facets = 0;        ///< all corners at the positions of an earlier facet's, in any order: they are left out
  Index duplicate_vertices = 0;     ///< equal coordinates to an earlier vertex
  Index isolated_vertices = 0;
  Index wild_vertex = kNone;  ///< as find_wild_vertex()
  double area = 0;            ///< without repeated facets; 0 or infinite where it is no double
  bool has_area = false;      ///< is there any?
  Box box;
  TopologyReport topology;  ///< of the facets whose indices are in range
  bool usable() const { return facets > 0 && non_finite_vertices == 0 && out_of_range_facets == 0 && has_area; }
};

/// Takes any mesh whatsoever; facets with an index out of range or a corner that is not finite count in no measure.
AMPS_EXPORT MeshReport check(const MeshView& mesh, const Execution& execution = {});
AMPS_EXPORT std::ostream& operator<<(std::ostream& out, const MeshReport& report);

}  // namespace amps

#include "amps/host_macros_end.h"
