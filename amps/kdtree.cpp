#define AMPS_OWN_SOURCE
#include "amps/kdtree.h"

#include "amps/exact.h"
#include "amps/mesh_scale.h"

#include <nanoflann.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <numeric>
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
  WorkCounter* done = nullptr;  ///< none after the building
  mutable std::uint32_t calls_left = kElementsPerLook;

  double kdtree_get_pt(std::size_t i, std::size_t axis) const {
    if (--calls_left == 0) look();
    return KdPoints::kdtree_get_pt(i, axis);
  }
  void look() const {
    calls_left = kElementsPerLook;
    if (done != nullptr) done->add(kElementsPerLook);
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
  const Index* rows = nullptr;  ///< of the points of the part that is searched

  explicit KdResultSet(std::vector<KdTree::Neighbor>& result) : found(result) { found.clear(); }
  std::size_t size() const { return found.size(); }
  bool empty() const { return found.empty(); }
  bool full() const { return true; }
  void sort() {}
  bool addPoint(double squared_distance, std::uint32_t index) {
    static_cast<Derived*>(this)->add({rows[index], squared_distance});
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
  const Index* rows = nullptr;

  std::size_t size() const { return best.index == kNone ? 0 : 1; }
  bool empty() const { return best.index == kNone; }
  bool full() const { return true; }
  void sort() {}
  double worstDist() const {
    return best.index == kNone ? std::numeric_limits<double>::max() : kd_beyond(best.squared_distance);
  }
  bool addPoint(double squared_distance, std::uint32_t index) {
    const KdTree::Neighbor neighbor{rows[index], squared_distance};
    if (best.index == kNone || kd_before(neighbor, best)) best = neighbor;
    return true;
  }
};

}  // namespace

/// One tree for each thread that builds: of the points on one side of cuts across the longest axes.
struct KdTree::Impl {
  detail::MeshScale scale;
  Index size;

  Impl(const PointsView& view, const Execution& execution) : scale(view), size(static_cast<Index>(view.rows())) {
    std::vector<Index> rows(detail::slot(size));
    std::iota(rows.begin(), rows.end(), Index{0});
    const std::size_t most = std::min(kMaxParts, rows.size() / kLeastPerPart);
    divide(view, std::move(rows), std::min<std::size_t>(execution.workers(), most));
    detail::WorkCounter done(execution, expected_calls(detail::slot(size)));
    parallel_for(parts_.size(), 1, execution, [&](std::size_t k, std::size_t) { parts_[k]->build(view, scale, done); });
  }

  /// Shows a result set all points that may be in it.
  template <class Set>
  void search(Set& set, const Vec3& query) const {
    const Vec3 x = scale.point(query);
    if (parts_.size() == 1) return parts_.front()->search(set, x);
    std::array<std::pair<double, const Part*>, kMaxParts> by_distance;
    std::size_t count = 0;
    for (const auto& part : parts_) by_distance[count++] = {part->squared_distance(x), part.get()};
    std::sort(by_distance.begin(), by_distance.begin() + static_cast<std::ptrdiff_t>(count),
              [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t k = 0; k < count; ++k) {
      if (by_distance[k].first <= set.worstDist()) by_distance[k].second->search(set, x);
    }
  }

  void scale_back(std::vector<Neighbor>& found) const {
    for (Neighbor& neighbor : found) neighbor.squared_distance = scale.area_back(neighbor.squared_distance);
  }

 private:
  static constexpr std::size_t kLeafSize = 10;
  static constexpr std::uint64_t kCallsPerLevel = 5;
  static constexpr std::size_t kMaxParts = 16;           ///< a query looks at the box of each
  static constexpr std::size_t kLeastPerPart = 1 << 13;  ///< points: below, a thread is not worth while

  class Part {
   public:
    explicit Part(std::vector<Index> rows) : rows_(std::move(rows)) {}

    void build(const PointsView& view, const detail::MeshScale& unit, detail::WorkCounter& done) {
      if (!std::is_sorted(rows_.begin(), rows_.end())) std::sort(rows_.begin(), rows_.end());
      points_.coordinates.reserve(3 * rows_.size());
      for (std::size_t k = 0; k < rows_.size(); ++k) {
        const Vec3 x = unit.point(view[rows_[k]]);
        points_.coordinates.insert(points_.coordinates.end(), x.data(), x.data() + 3);
        low_ = low_.cwiseMin(x);
        high_ = high_.cwiseMax(x);
        if ((k + 1) % detail::kElementsPerLook == 0) done.add(0);
      }
      points_.done = &done;
      index_.buildIndex();
      points_.done = nullptr;
    }

    double squared_distance(const Vec3& x) const { return detail::squared_norm((low_ - x).cwiseMax(x - high_).cwiseMax(0.0)); }

    template <class Set>
    void search(Set& set, const Vec3& x) const {
      if (rows_.empty()) return;
      set.rows = rows_.data();
      index_.findNeighbors(set, x.data(), {});
    }

   private:
    std::vector<Index> rows_;  ///< ascending, once built
    Vec3 low_ = Vec3::Constant(INFINITY), high_ = -low_;
    detail::KdWatchedPoints points_;
    detail::KdIndex index_{
        3, points_,
        nanoflann::KDTreeSingleIndexAdaptorParams(kLeafSize, nanoflann::KDTreeSingleIndexAdaptorFlags::SkipInitialBuildIndex)};
  };

  /// nanoflann asks some 5 times a point and level (measured, from 10⁴ to 10⁶ points).
  static std::uint64_t expected_calls(std::size_t n) {
    std::uint64_t levels = 1;
    for (std::size_t left = n / kLeafSize; left > 1; left /= 2) ++levels;
    return kCallsPerLevel * n * levels;
  }

  void divide(const PointsView& view, std::vector<Index> rows, std::size_t num_parts) {
    if (num_parts < 2) {
      parts_.push_back(std::make_unique<Part>(std::move(rows)));
      return;
    }
    Vec3 low = view[rows.front()], high = low;
    for (const Index row : rows) {
      const Vec3 x = view[row];
      low = low.cwiseMin(x);
      high = high.cwiseMax(x);
    }
    int axis = 0;
    const Vec3 extent = high / 2 - low / 2;  // halves, because the extent itself may overflow
    extent.maxCoeff(&axis);
    const std::size_t below = num_parts / 2;
    const auto middle = rows.begin() + static_cast<std::ptrdiff_t>(rows.size() * below / num_parts);
    std::nth_element(rows.begin(), middle, rows.end(), [&](Index a, Index b) { return view[a][axis] < view[b][axis]; });
    divide(view, {rows.begin(), middle}, below);
    divide(view, {middle, rows.end()}, num_parts - below);
  }

  std::vector<std::unique_ptr<Part>> parts_;
};

KdTree::KdTree(const PointsView& points, const Execution& execution) {
  const Execution job = execution.start("building a search tree");
  impl_ = std::make_unique<Impl>(points, job);
  job.finish();
}

KdTree::~KdTree() = default;
KdTree::KdTree(KdTree&&) noexcept = default;
KdTree& KdTree::operator=(KdTree&&) noexcept = default;

Index KdTree::size() const { return impl_->size; }

KdTree::Neighbor KdTree::nearest(const Vec3& query) const {
  KdNearestOne one;
  impl_->search(one, query);
  one.best.squared_distance = impl_->scale.area_back(one.best.squared_distance);
  return one.best;
}

void KdTree::k_nearest(const Vec3& query, Index k, std::vector<Neighbor>& result) const {
  AMPS_ASSERT(k >= 0);
  KdNearestSet set(result, static_cast<std::size_t>(std::min(k, size())));
  if (set.capacity == 0) return;
  impl_->search(set, query);
  std::sort_heap(result.begin(), result.end(), kd_before);
  impl_->scale_back(result);
}

void KdTree::in_radius(const Vec3& query, double radius, std::vector<Neighbor>& result) const {
  AMPS_ASSERT(radius >= 0);
  KdRadiusSet set(result, impl_->scale.length(radius));
  impl_->search(set, query);
  std::sort(result.begin(), result.end(), kd_before);
  impl_->scale_back(result);
}

}  // namespace amps
