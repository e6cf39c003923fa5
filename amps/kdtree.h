// kdtree.h: nearest points. A thin wrapper of nanoflann (Blanco & Rai), which stays inside kdtree.cpp; results are made
// deterministic, ties included.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/buffers.h"
#include "amps/execution.h"

#include <memory>
#include <vector>

namespace amps {

/// A static set of points to search. Movable, not copyable. Queries may run concurrently; each costs O(log n) expected plus
/// O(log k) for each point looked at. All comparisons are of squared distances rounded to double: coordinates beyond 1e±150
/// overflow or underflow.
class KdTree {
 public:
  struct Neighbor {
    Index index = kNone;  ///< row of the point
    double squared_distance = 0;
  };

  /// Copies the points, so the caller's buffer may go. They must be finite; an empty set and equal points are fine.
  /// O(n log n). Cancelled, it throws Error(kCancelled).
  AMPS_EXPORT explicit KdTree(const PointsView& points, const Execution& execution = {});
  AMPS_EXPORT ~KdTree();
  AMPS_EXPORT KdTree(KdTree&&) noexcept;
  AMPS_EXPORT KdTree& operator=(KdTree&&) noexcept;

  AMPS_EXPORT Index size() const;

  /// The nearest point, of several the one of lowest index. An empty set gives kNone.
  AMPS_EXPORT Neighbor nearest(const Vec3& query) const;

  /// The min(k, size) nearest points, nearest first, equally near ones by index; among those equally near at the end of the
  /// list, lower indices win. Replaces the content of `result`; keep it from call to call to save allocations. k ≥ 0.
  AMPS_EXPORT void k_nearest(const Vec3& query, Index k, std::vector<Neighbor>& result) const;

  /// All points with squared distance ≤ radius², nearest first, equally near ones by index. Replaces the content of `result`.
  /// radius ≥ 0.
  AMPS_EXPORT void in_radius(const Vec3& query, double radius, std::vector<Neighbor>& result) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace amps

#include "amps/host_macros_end.h"
