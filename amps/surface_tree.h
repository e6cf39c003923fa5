// surface_tree.h: the point of a surface nearest to a given point — to carry attributes from one mesh to another, to project,
// to measure distances.
//
//   amps::SurfaceTree tree(mesh);
//   amps::SurfaceHit hit = tree.nearest({0.1, 0.2, 0.3});
//   // hit.distance, hit.point.facet, hit.point.barycentric, hit.point.position
//
// A bounding-volume hierarchy over the facets: four boxes a node (Dammertz, Hanika & Keller, "Shallow bounding volume
// hierarchies", 2008), split where the surface-area heuristic with binned centroids is least (Wald, "On fast construction of
// SAH-based bounding volume hierarchies", 2007), one facet a leaf. Boxes are floats, and every test of one errs towards
// visiting it; distances are doubles. So the answer is that of a loop over all facets, bit for bit.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"

#include <limits>
#include <memory>
#include <vector>

namespace amps {

/// The nearest point found and how far it is; facet kNone and an infinite distance if there is none.
struct SurfaceHit {
  SurfacePoint point;
  double distance = std::numeric_limits<double>::infinity();
};

/// The facets of a mesh, to search. Movable, not copyable; queries may run concurrently.
///
/// A facet is its closed triangle, and one without area its longest edge or its point: soups, degenerate facets and facets
/// with repeated indices all work. Of facets equally near, the one of lowest index wins. A distance is that of `point.position`
/// to within a few 1e-16 of the mesh's size; the point is the nearest one to the same precision, on facets with an angle below
/// 1e-8 to 2e-11 of their longest edge at worst. About 300 bytes a facet.
class SurfaceTree {
 public:
  /// Copies what it needs, so the caller's buffers may go. Throws Error(kInvalidMesh) if the mesh has no facet, a corner
  /// that is NaN or infinite, or an index out of range; kCancelled. O(#F log #F).
  AMPS_EXPORT explicit SurfaceTree(const MeshView& mesh, const Execution& execution = {});
  AMPS_EXPORT ~SurfaceTree();
  AMPS_EXPORT SurfaceTree(SurfaceTree&&) noexcept;
  AMPS_EXPORT SurfaceTree& operator=(SurfaceTree&&) noexcept;

  AMPS_EXPORT Index num_facets() const;

  // Queries throw Error(kInvalidArgument) for a point that is not finite, or farther from the mesh than 1e150 times its size.

  /// The nearest point of the surface. `hint`: a facet thought to be near, such as that of the last query; it saves time and
  /// never changes the answer. O(log #F) expected for points near the surface.
  AMPS_EXPORT SurfaceHit nearest(const Vec3& query, Index hint = kNone) const;

  /// The same if its distance is at most `radius` ≥ 0, else a hit with facet kNone. The smaller the radius the faster.
  AMPS_EXPORT SurfaceHit nearest_within(const Vec3& query, double radius) const;

  /// The nearest point of one facet.
  AMPS_EXPORT SurfaceHit nearest_on_facet(const Vec3& query, Index facet) const;

  /// nearest() of every row; fast where rows that follow each other are near each other. Cancelled, it throws
  /// Error(kCancelled).
  AMPS_EXPORT std::vector<SurfaceHit> nearest_all(const PointsView& queries, const Execution& execution = {}) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace amps

#include "amps/host_macros_end.h"
