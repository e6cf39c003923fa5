// mesh_edges.h (internal): which facets meet at an edge, which corners form a fan, which vertices are one point. Everything
// that asks a mesh for its edges asks here: topology, curvature, lattices of sizing fields, boundaries, the orientation of
// results.
//
// Corner 3·f + k is corner k of facet f; side 3·f + k goes from corner k of the facet to the next one. Where vertices of equal
// position are to be one (soups, seams), merge_equal_vertices() comes first: here an index is a vertex.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace amps::detail {

/// Facets or edges of such loops between looks: some 0.1 ms.
inline constexpr std::uint64_t kEdgesPerLook = 1 << 12;

inline std::size_t next_corner(std::size_t corner) { return corner % 3 == 2 ? corner - 2 : corner + 1; }

/// A side of a facet, as one of those at an edge (low, high).
struct EdgeSide {
  Index high;
  Index facet;
  std::uint8_t k;
  bool forward;  ///< from low to high

  std::size_t corner() const { return 3 * slot(facet) + k; }  ///< its number; the corner that it starts from
  /// The corner of its facet at the lower vertex, and at the higher one.
  std::size_t low_corner() const { return forward ? corner() : next_corner(corner()); }
  std::size_t high_corner() const { return forward ? next_corner(corner()) : corner(); }
};

/// An undirected edge and the sides that lie on it, in the order of their facets. Valid as long as its MeshEdges.
struct MeshEdge {
  Index low, high;  ///< low ≤ high
  const EdgeSide* first;
  const EdgeSide* last;

  const EdgeSide* begin() const { return first; }
  const EdgeSide* end() const { return last; }
  std::size_t size() const { return static_cast<std::size_t>(last - first); }  ///< ≥ 1
  const EdgeSide& operator[](std::size_t i) const { return first[i]; }
  bool boundary() const { return size() == 1; }
  bool non_manifold() const { return size() > 2; }
  /// Exactly two facets, of one orientation: they traverse the edge in opposite directions.
  bool regular() const { return size() == 2 && first[0].forward != first[1].forward; }
};

/// The edges of a mesh, sorted by their lower and then by their higher vertex. Edge numbers are places in this order. 8 bytes
/// an edge and 12 a side; O(#V + #F), but for sorting the sides at a vertex of many edges. Facets whose flag in `counted` is 0
/// are left out (an empty one counts all). Of the facets that count, all indices must lie in [0, num_vertices). A facet with a
/// repeated index has a side from a vertex to itself, an edge like others; leave such facets out where that matters. Throws
/// Error(kTooLarge) beyond 2^31 − 1 sides.
class MeshEdges {
 public:
  MeshEdges(const TrianglesView& triangles, Index num_vertices, const std::vector<char>& counted = {},
            const Execution& run = {});

  std::size_t size() const { return low_.size(); }
  MeshEdge operator[](std::size_t e) const {
    const EdgeSide* const first = sides_.data() + slot(begin_[e]);
    return {low_[e], first->high, first, sides_.data() + slot(begin_[e + 1])};
  }

  /// "No such edge" where a number of one is expected.
  static constexpr std::size_t kNoEdge = static_cast<std::size_t>(-1);
  /// The edge of each side, by side; kNone for those of facets that were left out. O(#F).
  std::vector<Index> edge_of_sides(const Execution& run = {}) const;

  std::size_t num_corners() const { return num_corners_; }  ///< 3·#F, of facets left out too

 private:
  std::size_t num_corners_;
  std::vector<EdgeSide, UninitializedAllocator<EdgeSide>> sides_;
  std::vector<Index> begin_;  ///< of each edge's sides, and the end
  std::vector<Index> low_;
};

/// Disjoint sets of 0 … n − 1 < 2^32, each named by its smallest element. Near O(1) a call.
class UnionFind {
 public:
  explicit UnionFind(std::size_t n);
  std::size_t find(std::size_t x) {
    while (parent_[x] != x) x = parent_[x] = parent_[parent_[x]];
    return x;
  }
  void join(std::size_t a, std::size_t b) {
    a = find(a);
    b = find(b);
    parent_[a < b ? b : a] = static_cast<std::uint32_t>(a < b ? a : b);
  }
  /// The number of sets whose smallest element has a flag other than 0 in `member`.
  std::size_t count(const std::vector<char>& member, const Execution& run = {});

 private:
  std::vector<std::uint32_t> parent_;  // half the memory, most of the time
};

/// The first corner of each corner's fan, by corner: corners of one vertex belong together where facets meet at an edge between
/// them that is not cut. Edges whose flag in `cut` is not 0 separate fans (an empty one cuts nothing). At other edges all
/// facets are joined, whatever their number and orientation. A corner of a facet that does not count is a fan by itself. O(#F).
std::vector<std::size_t> corner_fans(const MeshEdges& edges, const std::vector<char>& cut = {}, const Execution& run = {});

/// The number of fans at each vertex, of facets that count. `fans`: as corner_fans() gives them. O(#V + #F).
std::vector<Index> fans_at_vertices(const TrianglesView& triangles, Index num_vertices, const std::vector<std::size_t>& fans,
                                    const std::vector<char>& counted = {}, const Execution& run = {});

/// topology() of the facets that these edges are of; `counted` as the edges were made with. (In mesh.cpp.)
TopologyReport topology_of(const TrianglesView& triangles, Index num_vertices, const MeshEdges& edges,
                           const std::vector<char>& counted = {}, const Execution& run = {});

/// Points without repetition, numbered as they come. Equal are equal coordinates (−0 equals 0); a point with a NaN equals none,
/// not even itself. O(1) expected a call.
class DistinctPoints {
 public:
  explicit DistinctPoints(std::size_t expected = 0, const Execution& run = {});

  /// The number of the point with these coordinates, which is added if it is new. Fewer than 2^31.
  Index find_or_add(const Vec3& x);

  Index size() const { return static_cast<Index>(coordinates_.size() / 3); }
  Vec3 operator[](Index i) const {
    const double* x = &coordinates_[3 * slot(i)];
    return {x[0], x[1], x[2]};
  }
  const std::vector<double>& coordinates() const { return coordinates_; }  ///< xyzxyz…

 private:
  std::size_t place(const Vec3& x) const;
  void grow_table();

  std::vector<double> coordinates_;
  std::vector<Index> table_;  ///< open addressing; a power of two entries, at least half of them empty
};

/// For each vertex the first one with equal coordinates; a vertex with a NaN stays alone. O(#V) expected.
std::vector<Index> first_equal_vertices(const MeshView& mesh, const Execution& run = {});

/// Facets whose three corners an earlier facet has, at the same positions (−0 equals 0) and in any order, ascending: they are
/// that facet again, whatever their orientation. Never among them are facets of which two corners are at one position, or one
/// is a NaN or no vertex. O(#V + #F) expected.
std::vector<Index> find_repeated_facets(const MeshView& mesh, const Execution& run = {});

/// The edges of a surface: of a mesh whose vertices of equal position are one. What is no part of the surface does not count:
/// facets of which two corners are one vertex, and of facets with the same three vertices all but the first. O(#V + #F)
/// expected. A value.
class SurfaceEdges {
 public:
  explicit SurfaceEdges(const MeshView& mesh, const Execution& run = {});

  /// #F by 3: facets by their surface vertices, each the first mesh vertex with its position.
  const Triangles& triangles() const { return triangles_; }
  Index num_vertices() const { return num_vertices_; }  ///< as the mesh has; not all are surface vertices
  Index num_facets() const { return static_cast<Index>(triangles_.rows()); }
  bool counts(Index facet) const { return counted_[slot(facet)] != 0; }
  /// Flags by facet, as counts().
  const std::vector<char>& counted() const { return counted_; }
  /// Facets that are left out as they are there already, ascending.
  const std::vector<Index>& repeated_facets() const { return repeated_; }

  const MeshEdges& edges() const { return edges_; }
  std::size_t size() const { return edges_.size(); }
  MeshEdge operator[](std::size_t e) const { return edges_[e]; }
  /// The edge of side k of a facet that counts.
  std::size_t edge(Index facet, int k) const { return slot(edge_of_side_[3 * slot(facet) + static_cast<std::size_t>(k)]); }

 private:
  struct Parts {
    Triangles triangles;
    Index num_vertices;
    std::vector<char> counted;
    std::vector<Index> repeated;
    MeshEdges edges;
  };
  static Parts make_parts(const MeshView& mesh, const Execution& run);
  SurfaceEdges(Parts&& parts, const Execution& run);

  Triangles triangles_;
  Index num_vertices_;
  std::vector<char> counted_;
  std::vector<Index> repeated_;
  MeshEdges edges_;
  std::vector<Index> edge_of_side_;
};

}  // namespace amps::detail
