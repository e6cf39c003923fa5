#define AMPS_OWN_SOURCE
#include "amps/kdtree.h"

#include "amps/exact.h"
#include "amps/mesh_scale.h"

#include <nanoflann.hpp>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>

namespace amps {
namespace detail {

// Members of KdTree::Impl. Not in an unnamed namespace: a class with linkage would then have members without, which GCC warns
// of in the single header.

/// nanoflann's view of the points.
struct KdPoints {
  std::vector<double> coordinates;
  std::size_t kdtree_get_point_count() const { return coordinates.size() / 3; }
  double kdtree_get_pt(std::size_t i, std::size_t axis) const { return coordinates[3 * i + axis]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;  // let nanoflann compute it
  }
};

/// The same while the tree is built: then, and only then, nanoflann asks the data set for coordinates, and can be left by an
/// exception. (Searches ask through the metric, which sees the base class alone: they count nothing, on any number of threads.)
struct KdWatchedPoints : KdPoints {
  Ticker* ticker = nullptr;  ///< none after the building
  mutable std::uint32_t calls_left = kElementsPerLook;

  explicit KdWatchedPoints(std::vector<double> xyz) : KdPoints{std::move(xyz)} {}
  double kdtree_get_pt(std::size_t i, std::size_t axis) const {
    if (--calls_left == 0) look();
    return KdPoints::kdtree_get_pt(i, axis);
  }
  void look() const {
    calls_left = kElementsPerLook;
    if (ticker != nullptr) ticker->tick(kElementsPerLook);
  }
};

using KdIndex =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, KdPoints>, KdWatchedPoints, 3, std::uint32_t>;

}  // namespace detail

namespace {

bool kd_before(const KdTree::Neighbor& a, const KdTree::Neighbor& b) {
  return a.squared_distance != b.squared_distance ? a.squared_distance < b.squared_distance : a.index < b.index;
}

/// nanoflann takes a point only if it is nearer than this, and skips boxes whose rounded distance is beyond: slightly more than
/// `distance`, so that ties get through, however the distance of their box was rounded.
double kd_beyond(double distance) { return distance * (1 + 1e-12) + std::numeric_limits<double>::denorm_min(); }

/// What nanoflann asks of a result set, in all its versions. nanoflann's own leave ties to the order of the search.
template <class Derived>
struct KdResultSet {
  using DistanceType = double;
  using IndexType = std::uint32_t;
  using CountType = std::size_t;
  std::vector<KdTree::Neighbor>& found;

  explicit KdResultSet(std::vector<KdTree::Neighbor>& result) : found(result) { found.clear(); }
  std::size_t size() const { return found.size(); }
  bool empty() const { return found.empty(); }
  bool full() const { return true; }
  void sort() {}
  bool addPoint(double squared_distance, std::uint32_t index) {
    static_cast<Derived*>(this)->add({static_cast<Index>(index), squared_distance});
    return true;
  }
};

/// The `capacity` ≥ 1 nearest: a heap with the worst on top.
struct KdNearestSet : KdResultSet<KdNearestSet> {
  std::size_t capacity;

  KdNearestSet(std::vector<KdTree::Neighbor>& result, std::size_t k) : KdResultSet(result), capacity(k) {}
  double worstDist() const {
    return found.size() < capacity ? std::numeric_limits<double>::max() : kd_beyond(found.front().squared_distance);
  }
  void add(const KdTree::Neighbor& neighbor) {
    if (found.size() == capacity) {
      if (!kd_before(neighbor, found.front())) return;
      std::pop_heap(found.begin(), found.end(), kd_before);
      found.pop_back();
    }
    found.push_back(neighbor);
    std::push_heap(found.begin(), found.end(), kd_before);
  }
};

struct KdRadiusSet : KdResultSet<KdRadiusSet> {
  double squared_radius;

  KdRadiusSet(std::vector<KdTree::Neighbor>& result, double radius) : KdResultSet(result), squared_radius(radius * radius) {}
  double worstDist() const { return kd_beyond(squared_radius); }
  void add(const KdTree::Neighbor& neighbor) {
    if (neighbor.squared_distance <= squared_radius) found.push_back(neighbor);
  }
};

/// The one nearest, without a buffer.
struct KdNearestOne {
  using DistanceType = double;
  using IndexType = std::uint32_t;
  using CountType = std::size_t;
  KdTree::Neighbor best;

  std::size_t size() const { return best.index == kNone ? 0 : 1; }
  bool empty() const { return best.index == kNone; }
  bool full() const { return true; }
  void sort() {}
  double worstDist() const {
    return best.index == kNone ? std::numeric_limits<double>::max() : kd_beyond(best.squared_distance);
  }
  bool addPoint(double squared_distance, std::uint32_t index) {
    const KdTree::Neighbor neighbor{static_cast<Index>(index), squared_distance};
    if (best.index == kNone || kd_before(neighbor, best)) best = neighbor;
    return true;
  }
};

}  // namespace

struct KdTree::Impl {
  detail::MeshScale scale;
  detail::KdWatchedPoints points;
  detail::KdIndex index;

  /// In units of `scale`.
  static std::vector<double> coordinates_of(const PointsView& view, const detail::MeshScale& scale,
                                            const Execution& execution) {
    std::vector<double> result;
    result.reserve(3 * static_cast<std::size_t>(view.rows()));
    detail::for_each_index(view.rows(), execution, [&](std::ptrdiff_t i) {
      const Vec3 x = scale.point(view[i]);
      result.insert(result.end(), {x[0], x[1], x[2]});
    });
    return result;
  }

  /// nanoflann asks some 5 times a point and level (measured, from 10⁴ to 10⁶ points).
  static std::uint64_t expected_calls(std::size_t n) {
    std::uint64_t levels = 1;
    for (std::size_t left = n / kLeafSize; left > 1; left /= 2) ++levels;
    return kCallsPerLevel * n * levels;
  }

  Impl(const PointsView& view, const Execution& execution)
      : scale(view),
        points(coordinates_of(view, scale, execution.part(0, 0.05))),
        index(3, points,
              nanoflann::KDTreeSingleIndexAdaptorParams(kLeafSize,
                                                        nanoflann::KDTreeSingleIndexAdaptorFlags::SkipInitialBuildIndex)) {
    detail::Ticker ticker(execution.part(0.05, 1), expected_calls(points.kdtree_get_point_count()), detail::kElementsPerLook);
    points.ticker = &ticker;
    index.buildIndex();
    points.ticker = nullptr;
  }

  void scale_back(std::vector<Neighbor>& found) const {
    for (Neighbor& neighbor : found) neighbor.squared_distance = scale.area_back(neighbor.squared_distance);
  }

 private:
  static constexpr std::size_t kLeafSize = 10;
  static constexpr std::uint64_t kCallsPerLevel = 5;
};

KdTree::KdTree(const PointsView& points, const Execution& execution) {
  const Execution job = execution.start("building a search tree");
  impl_ = std::make_unique<Impl>(points, job);
  job.finish();
}

KdTree::~KdTree() = default;
KdTree::KdTree(KdTree&&) noexcept = default;
KdTree& KdTree::operator=(KdTree&&) noexcept = default;

Index KdTree::size() const { return static_cast<Index>(impl_->points.kdtree_get_point_count()); }

KdTree::Neighbor KdTree::nearest(const Vec3& query) const {
  KdNearestOne one;
  if (size() > 0) impl_->index.findNeighbors(one, impl_->scale.point(query).data(), {});
  one.best.squared_distance = impl_->scale.area_back(one.best.squared_distance);
  return one.best;
}

void KdTree::k_nearest(const Vec3& query, Index k, std::vector<Neighbor>& result) const {
  AMPS_ASSERT(k >= 0);
  KdNearestSet set(result, static_cast<std::size_t>(std::min(k, size())));
  if (set.capacity == 0) return;
  impl_->index.findNeighbors(set, impl_->scale.point(query).data(), {});
  std::sort_heap(result.begin(), result.end(), kd_before);
  impl_->scale_back(result);
}

void KdTree::in_radius(const Vec3& query, double radius, std::vector<Neighbor>& result) const {
  AMPS_ASSERT(radius >= 0);
  KdRadiusSet set(result, impl_->scale.length(radius));
  if (size() == 0) return;
  impl_->index.findNeighbors(set, impl_->scale.point(query).data(), {});
  std::sort(result.begin(), result.end(), kd_before);
  impl_->scale_back(result);
}

}  // namespace amps
