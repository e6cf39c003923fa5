#define AMPS_OWN_SOURCE
#include "amps/power_diagram.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace amps {
namespace detail {
namespace {

/// A corner computed from barycentric coordinates good to a few 2^-46 (predicates.h) is off by less than this, relative to the
/// facet's longest edge, plus kPositionRounding relative to its largest coordinate.
constexpr double kPositionError = 0x1p-42;
constexpr double kPositionRounding = 0x1p-49;
/// Relative rounding of D_k(x) evaluated in doubles: 8 operations, slack 4.
constexpr double kSideRounding = 0x1p-48;
/// Records of a site's fragments lie side by side when they have come from bulk construction.
constexpr Index kFragmentsPrefetched = 8;
/// Relative slack of plane offsets and of the security radius they are compared with.
constexpr double kOffsetSlack = 1e-9;

/// D_j(x) of predicates.h in doubles, for the many corners that are far from the bisector.
class SideFilter {
 public:
  SideFilter(const WeightedPoint& owner, const WeightedPoint& other) noexcept
      : difference_(other.position() - owner.position()),
        sum_(other.position() + owner.position()),
        weights_(owner.w - other.w),
        gradient_(difference_.cwiseAbs().sum()),
        weight_error_(kSideRounding * std::fabs(weights_)) {}

  /// The side of x, known to `error` (which must include kPositionRounding of the coordinates: the sum above has that rounding
  /// too), if x is farther from the bisector than all errors, else 0.
  int side(const Vec3& x, double error) const noexcept {
    const double tx = sum_.x() - 2 * x.x(), ty = sum_.y() - 2 * x.y(), tz = sum_.z() - 2 * x.z();
    const double value = (difference_.x() * tx + difference_.y() * ty + difference_.z() * tz) + weights_;
    // |∇D| = 2|p_j − p_i|; the 1-norm bounds it from above.
    const double span = std::fabs(tx) + std::fabs(ty) + std::fabs(tz);
    const double margin = gradient_ * (2 * error + kSideRounding * span) + weight_error_;
    return value > margin ? 1 : (-value > margin ? -1 : 0);
  }

  /// |∇D|, for surely_inside.
  double slope() const noexcept { return 2 * (1 + kOffsetSlack) * difference_.norm(); }

  /// True only if all points within `radius` of x are on the owner's side. NaN and infinity give false.
  bool surely_inside(const Vec3& x, double radius, double error, double slope) const noexcept {
    const double tx = sum_.x() - 2 * x.x(), ty = sum_.y() - 2 * x.y(), tz = sum_.z() - 2 * x.z();
    const double value = (difference_.x() * tx + difference_.y() * ty + difference_.z() * tz) + weights_;
    const double span = std::fabs(tx) + std::fabs(ty) + std::fabs(tz);
    return value > slope * radius + (gradient_ * (2 * error + kSideRounding * span) + weight_error_);
  }

 private:
  Vec3 difference_, sum_;
  double weights_, gradient_, weight_error_;
};

/// Order of a site's planes; ties by site, so that nothing depends on the sort.
template <class Plane>
bool nearer_plane(const Plane& a, const Plane& b) noexcept {
  return a.offset != b.offset ? a.offset < b.offset : a.site < b.site;
}

}  // namespace
}  // namespace detail

using detail::slot;

double RestrictedPowerDiagram::Polygon::area() const {
  Vec3 sum = Vec3::Zero();
  for (Index k = 2; k < size; ++k) sum += (corners[k - 1] - corners[0]).cross(corners[k] - corners[0]);
  return 0.5 * sum.stableNorm();  // areas of 1e±200 have squares out of range
}

// ---------------------------------------------------------------------------------------------------------------------------
// Clipping one polygon of one facet and owner

class RestrictedPowerDiagram::Clipper {
 public:
  explicit Clipper(const RestrictedPowerDiagram& diagram) : diagram_(diagram) {}

  void set_facet(Index facet) {
    const MeshView& mesh = diagram_.mesh_;
    for (int c = 0; c < 3; ++c) {
      vertex_[slot(c)] = mesh.triangles(facet, c);
      corner_[c] = mesh.position(vertex_[slot(c)]);
    }
    position_error_ = diagram_.facet_error_[slot(facet)];
  }

  /// The whole facet, owned by `site`.
  void start(Index site) {
    set_owner(site);
    corners_.clear();
    labels_.clear();
    for (int c = 0; c < 3; ++c) {
      corners_.push_back(corner(c));
      labels_.push_back(mesh_edge_label(c));
    }
  }

  void load(const Polygon& polygon) {
    set_facet(polygon.facet);
    set_owner(polygon.site);
    corners_.assign(polygon.corners, polygon.corners + polygon.size);
    labels_.assign(polygon.labels, polygon.labels + polygon.size);
  }

  /// The polygon with the bisector of `gone` lifted: the two edges beside that edge run on until they meet or leave the facet.
  void load_without(const Polygon& polygon, Index gone) {
    set_facet(polygon.facet);
    start(polygon.site);
    const Index n = polygon.size;
    const auto at = static_cast<Index>(std::find(polygon.labels, polygon.labels + n, gone) - polygon.labels);
    const Index in = polygon.labels[(at + n - 1) % n], out = polygon.labels[(at + 1) % n];
    if (is_site(in)) clip(in);
    if (is_site(out)) clip(out);
    // What the facet cut by these two has between their edges takes the place of the edge. None of the other edges can end there:
    // each already is an edge elsewhere, and a line bounds a convex polygon only once.
    const std::size_t m = labels_.size();
    std::size_t k = static_cast<std::size_t>(std::find(labels_.begin(), labels_.end(), in) - labels_.begin());
    AMPS_ASSERT(k < m);
    new_corners_.clear();
    new_labels_.clear();
    do {
      k = k + 1 == m ? 0 : k + 1;
      new_corners_.push_back(corners_[k]);
      new_labels_.push_back(labels_[k]);
    } while (labels_[k] != out);
    for (Index e = 2; e < n; ++e) {
      new_corners_.push_back(polygon.corners[(at + e) % n]);
      new_labels_.push_back(polygon.labels[(at + e) % n]);
    }
    corners_.swap(new_corners_);
    labels_.swap(new_labels_);
  }

  bool has_label(Index label) const { return std::find(labels_.begin(), labels_.end(), label) != labels_.end(); }

  /// Keeps what is on the owner's side of the bisector with `other`; true if something was cut off.
  bool clip(Index other) {
    const std::size_t n = corners_.size();
    const WeightedPoint& site = diagram_.site(other);
    const detail::SideFilter filter(*owner_, site);
    bool any_inside = false, any_outside = false;
    sides_.resize(n);
    for (std::size_t k = 0; k < n; ++k) {
      sides_[k] = static_cast<signed char>(filter.side(corners_[k], position_error_));
      if (sides_[k] == 0) sides_[k] = static_cast<signed char>(exact_side(k, site));
      (sides_[k] > 0 ? any_inside : any_outside) = true;
    }
    if (!any_outside) return false;
    if (!any_inside) {
      corners_.clear();
      labels_.clear();
      return true;
    }
    cut(other);
    return true;
  }

  /// Clips by bisectors in order of their offset while they can reach the polygon (security radius).
  void clip_all(const Plane* begin, const Plane* end) {
    double reach = security_radius();
    for (const Plane* plane = begin; plane != end && plane->offset <= reach; ++plane) {
      if (clip(plane->site)) {
        if (empty()) return;
        reach = security_radius();
      }
    }
  }

  bool empty() const { return corners_.empty(); }
  const std::vector<Vec3>& corners() const { return corners_; }
  const std::vector<Index>& labels() const { return labels_; }

 private:
  Vec3 corner(int c) const { return {corner_[c][0], corner_[c][1], corner_[c][2]}; }

  void set_owner(Index site) {
    owner_ = &diagram_.site(site);
    owner_position_ = owner_->position();
  }

  double security_radius() const {
    double farthest = 0;
    for (const Vec3& x : corners_) farthest = std::max(farthest, (x - owner_position_).squaredNorm());
    return std::sqrt(farthest) * (1 + detail::kOffsetSlack) + position_error_;
  }

  int exact_side(std::size_t k, const WeightedPoint& site) const {
    const Index in = labels_[k == 0 ? labels_.size() - 1 : k - 1], out = labels_[k];
    const Bisector by(*owner_, site, corner_);
    if (is_site(in) && is_site(out)) return side_of_facet_crossing(corner_, bisector(in), bisector(out), by);
    if (!is_site(in) && !is_site(out)) return side_of_corner(corner_, mesh_edge(out), by);
    const int e = mesh_edge(is_site(in) ? out : in);
    return side_of_edge_crossing(corner_, e, (e + 1) % 3, bisector(is_site(in) ? in : out), by);
  }

  Bisector bisector(Index label) const { return Bisector(*owner_, diagram_.site(label), corner_); }

  /// The intersection of the line of an edge with the bisector of `other`.
  Vec3 crossing(Index label, Index other) const {
    if (is_site(label)) {
      const Vec3 b = facet_crossing_coordinates(corner_, *owner_, diagram_.site(label), diagram_.site(other));
      return b[0] * corner(0) + b[1] * corner(1) + b[2] * corner(2);
    }
    // Ends in the order of their global indices: both facets of the edge compute the same bits.
    int u = mesh_edge(label), v = (u + 1) % 3;
    if (vertex_[slot(u)] > vertex_[slot(v)]) std::swap(u, v);
    const std::array<double, 2> b = edge_crossing_coordinates(corner_, u, v, bisector(other));
    return b[0] * corner(u) + b[1] * corner(v);
  }

  /// Replaces the outside corners, one run of them since both polygon and half-space are convex, by two crossings.
  void cut(Index other) {
    const std::size_t n = corners_.size();
    std::size_t leave = 0;  // the last corner inside before the run
    while (!(sides_[leave] > 0 && sides_[leave + 1 == n ? 0 : leave + 1] < 0)) ++leave;
    std::size_t enter = leave + 1 == n ? 0 : leave + 1;  // the last corner of the run
    while (sides_[enter + 1 == n ? 0 : enter + 1] < 0) enter = enter + 1 == n ? 0 : enter + 1;
    const Vec3 leaving = crossing(labels_[leave], other);
    const Vec3 entering = crossing(labels_[enter], other);
    new_corners_.clear();
    new_labels_.clear();
    for (std::size_t k = enter + 1 == n ? 0 : enter + 1;; k = k + 1 == n ? 0 : k + 1) {
      AMPS_ASSERT(sides_[k] > 0);
      new_corners_.push_back(corners_[k]);
      new_labels_.push_back(labels_[k]);
      if (k == leave) break;
    }
    new_corners_.push_back(leaving);
    new_labels_.push_back(other);
    new_corners_.push_back(entering);
    new_labels_.push_back(labels_[enter]);
    corners_.swap(new_corners_);
    labels_.swap(new_labels_);
  }

  const RestrictedPowerDiagram& diagram_;
  const double* corner_[3] = {};
  std::array<Index, 3> vertex_{};
  double position_error_ = 0;
  const WeightedPoint* owner_ = nullptr;
  Vec3 owner_position_ = Vec3::Zero();
  std::vector<Vec3> corners_, new_corners_;
  std::vector<Index> labels_, new_labels_;
  std::vector<signed char> sides_;
};

// ---------------------------------------------------------------------------------------------------------------------------
// Construction

/// Fragments of a run of facets, before they are put together.
struct RestrictedPowerDiagram::Batch {
  struct Entry {
    Index facet, site, size;
  };
  std::vector<Entry> entries;
  std::vector<Vec3> corners;
  std::vector<Index> labels;
  std::vector<Index> queue;      ///< sites found in the current facet
  std::vector<Index> last_seen;  ///< by site: the facet it was last queued in

  void add(Index facet, Index site, const Clipper& clipper) {
    const std::size_t first = corners.size(), count = clipper.corners().size();
    entries.push_back({facet, site, static_cast<Index>(count)});
    corners.resize(first + count);
    labels.resize(first + count);
    std::copy(clipper.corners().begin(), clipper.corners().end(), corners.begin() + static_cast<std::ptrdiff_t>(first));
    std::copy(clipper.labels().begin(), clipper.labels().end(), labels.begin() + static_cast<std::ptrdiff_t>(first));
  }
};

RestrictedPowerDiagram::RestrictedPowerDiagram(const MeshView& mesh, const PointsView& sites,
                                               const Eigen::Ref<const Eigen::VectorXd>& weights, unsigned threads,
                                               const Progress& progress)
    : mesh_(mesh) {
  require_usable(mesh);
  if (sites.rows() == 0) throw Error(ErrorCode::kInvalidArgument, "restricted power diagram: no sites; give at least one");
  detail::Stopwatch watch;
  triangulate(sites, weights);
  seconds_triangulation_ = watch.lap();
  first_of_site_.assign(slot(num_sites()), kNone);
  first_of_facet_.assign(slot(mesh_.num_facets()), kNone);
  measure_facets();
  build(threads, progress);
}

/// A regular tetrahedron whose corners are 4 diagonals from the centre of the box. At any point of the box its corners have power
/// at least 12 diagonals² − w, and a site in the box that is not lighter at most 1 diagonal² − w: while there is such a guard, no
/// sentinel owns anything on the mesh.
std::array<WeightedPoint, RestrictedPowerDiagram::kSentinels> RestrictedPowerDiagram::sentinels() const {
  const double reach = 4 * (high_ - low_).norm() / std::sqrt(3.0);
  const Vec3 centre = low_ + (high_ - low_) / 2;
  const double sign[kSentinels][3] = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}};
  std::array<WeightedPoint, kSentinels> result{};
  for (std::size_t k = 0; k < kSentinels; ++k) {
    const Vec3 x = centre + reach * Vec3(sign[k][0], sign[k][1], sign[k][2]);
    result[k] = {x.x(), x.y(), x.z(), least_weight_};
  }
  return result;
}

void RestrictedPowerDiagram::triangulate(const PointsView& sites, const Eigen::Ref<const Eigen::VectorXd>& weights) {
  if (weights.size() != sites.rows()) {
    throw Error(ErrorCode::kInvalidArgument, "restricted power diagram: " + std::to_string(sites.rows()) + " sites with " +
                                                 std::to_string(weights.size()) + " weights; give one weight a site");
  }
  const Box box = bounding_box(mesh_);
  Vec3 low = box.min, high = box.max;
  for (Eigen::Index s = 0; s < sites.rows(); ++s) {
    if (!sites.row(s).allFinite() || !std::isfinite(weights[s])) {
      throw Error(ErrorCode::kInvalidArgument, "restricted power diagram: site " + std::to_string(s) +
                                                   " is not finite (NaN or infinity); remove or repair it");
    }
    low = low.cwiseMin(sites.row(s).transpose());
    high = high.cwiseMax(sites.row(s).transpose());
  }
  low_ = low;
  high_ = high;
  least_weight_ = weights.minCoeff();
  num_guards_ = static_cast<Index>(sites.rows());
  Points positions(sites.rows() + kSentinels, 3);
  Eigen::VectorXd all_weights(positions.rows());
  Index k = 0;
  for (const WeightedPoint& sentinel : sentinels()) {
    positions.row(k) = sentinel.position().transpose();
    all_weights[k++] = sentinel.w;
  }
  positions.bottomRows(sites.rows()) = sites;
  all_weights.tail(weights.size()) = weights;
  triangulation_.insert(positions, all_weights);
}

/// Bounds of the error of computed corners per facet; −1 for facets without area.
void RestrictedPowerDiagram::measure_facets() {
  facet_error_.resize(slot(mesh_.num_facets()));
  for (Index facet = 0; facet < mesh_.num_facets(); ++facet) {
    double longest = 0, largest = 0;
    for (int c = 0; c < 3; ++c) {
      const Vec3 corner = mesh_.corner(facet, c);
      longest = std::max(longest, (corner - mesh_.corner(facet, (c + 1) % 3)).squaredNorm());
      largest = std::max(largest, corner.cwiseAbs().maxCoeff());
    }
    const auto position = [&](int c) { return mesh_.position(mesh_.triangles(facet, c)); };
    facet_error_[slot(facet)] = collinear(position(0), position(1), position(2))
                                    ? -1.0
                                    : detail::kPositionError * std::sqrt(longest) + detail::kPositionRounding * largest;
    largest_facet_error_ = std::max(largest_facet_error_, facet_error_[slot(facet)]);
  }
}

RestrictedPowerDiagram::Plane RestrictedPowerDiagram::plane(Index owner, Index other) const {
  const WeightedPoint &p = site(owner), &q = site(other);
  const double d2 = (q.position() - p.position()).squaredNorm();
  const double dw = p.w - q.w;
  return {((d2 + dw) - detail::kOffsetSlack * (d2 + std::fabs(dw))) / (2 * std::sqrt(d2)), other};
}

RestrictedPowerDiagram::PlaneTable RestrictedPowerDiagram::all_planes() const {
  const RegularTriangulation::Adjacency around = adjacency();
  PlaneTable table;
  table.offset = around.offset;
  table.planes.reserve(around.adjacent.size());
  for (Index s = 0; s < num_sites(); ++s) {
    for (Index k = around.offset[slot(s)]; k < around.offset[slot(s) + 1]; ++k) {
      table.planes.push_back(plane(s, around.adjacent[slot(k)]));
    }
    std::sort(table.planes.begin() + around.offset[slot(s)], table.planes.end(), detail::nearer_plane<Plane>);
  }
  return table;
}

void RestrictedPowerDiagram::build(unsigned threads, const Progress& progress) {
  const PlaneTable planes = all_planes();
  const std::vector<Index> owner = corner_owners(planes);
  const std::size_t num_facets = slot(mesh_.num_facets());
  // One thread fills the pools themselves; with more, batches are put together in their order, with the same result.
  const std::size_t facets_per_batch = threads == 1 ? num_facets : 4096;
  std::vector<Batch> batches((num_facets + facets_per_batch - 1) / facets_per_batch);
  std::atomic<std::size_t> done{0};
  constexpr std::size_t kFacetsPerReport = 1024;
  parallel_for(num_facets, facets_per_batch, threads, [&](std::size_t begin, std::size_t end) {
    Batch& batch = batches[begin / facets_per_batch];
    batch.last_seen.assign(slot(num_sites()), kNone);
    batch.entries.reserve(end - begin + 4 * slot(num_sites()) / batches.size());
    batch.corners.reserve(4 * batch.entries.capacity());
    batch.labels.reserve(4 * batch.entries.capacity());
    Clipper clipper(*this);
    for (std::size_t f = begin; f < end; ++f) {
      if (f % kFacetsPerReport == 0) {
        const std::size_t now_done = done += kFacetsPerReport;
        if (!progress.report("restricted power diagram",
                             std::min(1.0, static_cast<double>(now_done) / static_cast<double>(num_facets))))
          return;
      }
      if (facet_error_[f] < 0) continue;
      const Index facet = static_cast<Index>(f);
      clipper.set_facet(facet);
      const Index owner_a = owner[slot(mesh_.triangles(facet, 0))];
      if (owner_a == owner[slot(mesh_.triangles(facet, 1))] && owner_a == owner[slot(mesh_.triangles(facet, 2))]) {
        clipper.start(owner_a);  // power cells are convex: the whole facet lies in this one
        batch.add(facet, owner_a, clipper);
      } else {
        flood_facet(facet, owner_a, planes, clipper, batch);
      }
    }
    batch.last_seen = {};
  });
  assemble(batches);
}

/// Puts the fragments of all facets together. Polygons stay in the order of facets, but the records of each site's fragments
/// lie side by side, sites in the order in which facets meet them: local updates look through all fragments of a few sites, and
/// would otherwise spend their time on cache misses.
void RestrictedPowerDiagram::assemble(std::vector<Batch>& batches) {
  std::vector<Index> count(slot(num_sites()), 0), site_order;
  for (const Batch& batch : batches) {
    for (const Batch::Entry& entry : batch.entries) {
      if (count[slot(entry.site)]++ == 0) site_order.push_back(entry.site);
    }
  }
  std::vector<Index> next(slot(num_sites()), 0);
  for (const Index s : site_order) {
    next[slot(s)] = num_fragments_;
    num_fragments_ += count[slot(s)];
  }
  fragments_.reserve(slot(num_fragments_) + slot(num_fragments_) / 4);
  fragments_.resize(slot(num_fragments_));
  Index first = 0;
  for (const Batch& batch : batches) {
    for (const Batch::Entry& entry : batch.entries) {
      Fragment& fragment = fragments_[slot(next[slot(entry.site)]++)];
      fragment.facet = entry.facet;
      fragment.site = entry.site;
      fragment.first = first;
      fragment.size = fragment.capacity = entry.size;
      first += entry.size;
    }
  }
  if (batches.size() == 1) {
    corners_ = std::move(batches.front().corners);
    labels_ = std::move(batches.front().labels);
  } else {
    corners_.resize(slot(first));
    labels_.resize(slot(first));
    std::size_t at = 0;
    for (const Batch& batch : batches) {
      std::copy(batch.corners.begin(), batch.corners.end(), corners_.begin() + static_cast<std::ptrdiff_t>(at));
      std::copy(batch.labels.begin(), batch.labels.end(), labels_.begin() + static_cast<std::ptrdiff_t>(at));
      at += batch.corners.size();
    }
  }
  for (Index f = num_fragments_ - 1; f >= 0; --f) link(f);  // backwards: lists run forwards
  for (Fragment& fragment : fragments_) bound(fragment);
  reach_.resize(slot(num_sites()));
  for (Index s = 0; s < num_sites(); ++s) update_reach(s);
}

void RestrictedPowerDiagram::update_reach(Index s) {
  if (!visible(s)) {
    reach_[slot(s)] = kNoCell;
    return;
  }
  double reach = 0;
  for (Index f = first_of_site(s); f != kNone; f = next_of_site(f)) {
    const double farthest = this->reach(f);
    if (farthest > reach || std::isnan(farthest)) reach = farthest;  // NaN from overflow stays, and prunes nothing
  }
  reach_[slot(s)] = reach;
}

double RestrictedPowerDiagram::reach(Index f) const {
  const Fragment& fragment = fragments_[slot(f)];
  const WeightedPoint& owner = site(fragment.site);
  const Vec3 offset(fragment.centre[0] - owner.x, fragment.centre[1] - owner.y, fragment.centre[2] - owner.z);
  return (offset.norm() + fragment.radius) * (1 + detail::kOffsetSlack) + largest_facet_error_;
}

/// Sets the ball around the corners. Floats carry 2^-24 of the coordinates, or lose up to 2^-127 to underflow; more than that
/// is added to the radius.
void RestrictedPowerDiagram::bound(Fragment& fragment) {
  constexpr double kFloatSlack = 0x1p-21, kFloatUnderflow = 0x1p-124;
  const Vec3* const corner = corners_.data() + fragment.first;
  Vec3 low = corner[0], high = corner[0];
  for (Index k = 1; k < fragment.size; ++k) {
    low = low.cwiseMin(corner[k]);
    high = high.cwiseMax(corner[k]);
  }
  const Vec3 centre = 0.5 * (low + high);
  double farthest = 0;
  for (Index k = 0; k < fragment.size; ++k) farthest = std::max(farthest, (corner[k] - centre).squaredNorm());
  for (int a = 0; a < 3; ++a) fragment.centre[slot(a)] = static_cast<float>(centre[a]);
  fragment.radius =
      static_cast<float>(std::sqrt(farthest) * (1 + kFloatSlack) + kFloatSlack * centre.cwiseAbs().sum() + kFloatUnderflow);
}

/// The owner of every mesh vertex that a facet uses, found by walking from the last one over ever nearer neighbours.
std::vector<Index> RestrictedPowerDiagram::corner_owners(const PlaneTable& planes) const {
  std::vector<Index> owner(slot(mesh_.num_vertices()), kNone);
  Index near = 0;
  while (!visible(near)) ++near;
  for (Index facet = 0; facet < mesh_.num_facets(); ++facet) {
    for (int c = 0; c < 3; ++c) {
      const Index known = owner[slot(mesh_.triangles(facet, c))];
      if (known != kNone) near = known;
    }
    for (int c = 0; c < 3; ++c) {
      Index& found = owner[slot(mesh_.triangles(facet, c))];
      if (found != kNone) continue;
      const double* const x = mesh_.position(mesh_.triangles(facet, c));
      const double* const corners[3] = {x, x, x};
      const Vec3 position(x[0], x[1], x[2]);
      const double error = detail::kPositionRounding * position.cwiseAbs().maxCoeff();
      for (bool moved = true; moved;) {
        moved = false;
        for (const Plane *plane = planes.begin(near), *end = planes.end(near); plane != end && !moved; ++plane) {
          const Index other = plane->site;
          int side = detail::SideFilter(site(near), site(other)).side(position, error);
          if (side == 0) side = side_of_corner(corners, 0, Bisector(site(near), site(other), corners));
          if (side < 0) {
            near = other;
            moved = true;
          }
        }
      }
      found = near;
    }
  }
  return owner;
}

void RestrictedPowerDiagram::flood_facet(Index facet, Index owner, const PlaneTable& planes, Clipper& clipper,
                                         Batch& batch) const {
  batch.queue.assign(1, owner);
  batch.last_seen[slot(owner)] = facet;
  for (std::size_t k = 0; k < batch.queue.size(); ++k) {
    const Index s = batch.queue[k];
    clipper.start(s);
    clipper.clip_all(planes.begin(s), planes.end(s));
    AMPS_ASSERT(!clipper.empty());
    batch.add(facet, s, clipper);
    for (const Index label : clipper.labels()) {
      if (is_site(label) && batch.last_seen[slot(label)] != facet) {
        batch.last_seen[slot(label)] = facet;
        batch.queue.push_back(label);
      }
    }
  }
}

// ---------------------------------------------------------------------------------------------------------------------------
// Fragment store

RestrictedPowerDiagram::Polygon RestrictedPowerDiagram::polygon(Index f) const {
  const Fragment& fragment = fragments_[slot(f)];
  return {fragment.facet, fragment.site, corners_.data() + fragment.first, labels_.data() + fragment.first, fragment.size};
}

/// Puts a fragment at the head of its two lists.
void RestrictedPowerDiagram::link(Index f) {
  Fragment& fragment = fragments_[slot(f)];
  Index& of_site = first_of_site_[slot(fragment.site)];
  Index& of_facet = first_of_facet_[slot(fragment.facet)];
  fragment.next_of_site = of_site;
  fragment.next_of_facet = of_facet;
  fragment.previous_of_site = fragment.previous_of_facet = kNone;
  if (of_site != kNone) fragments_[slot(of_site)].previous_of_site = f;
  if (of_facet != kNone) fragments_[slot(of_facet)].previous_of_facet = f;
  of_site = of_facet = f;
}

void RestrictedPowerDiagram::store_polygon(Fragment& fragment, const Clipper& clipper) {
  const Index size = static_cast<Index>(clipper.corners().size());
  if (size > fragment.capacity) {
    pool_garbage_ += slot(fragment.capacity);
    fragment.first = static_cast<Index>(corners_.size());
    fragment.capacity = size + 2;  // room for the next cut or two
    corners_.resize(corners_.size() + slot(fragment.capacity), Vec3::Zero());
    labels_.resize(labels_.size() + slot(fragment.capacity), kNone);
  }
  fragment.size = size;
  std::copy(clipper.corners().begin(), clipper.corners().end(), corners_.begin() + fragment.first);
  std::copy(clipper.labels().begin(), clipper.labels().end(), labels_.begin() + fragment.first);
  bound(fragment);
}

void RestrictedPowerDiagram::add_fragment(Index facet, Index site, const Clipper& clipper) {
  Index f;
  if (free_fragments_.empty()) {
    f = static_cast<Index>(fragments_.size());
    fragments_.emplace_back();
  } else {
    f = free_fragments_.back();
    free_fragments_.pop_back();
  }
  fragments_[slot(f)].facet = facet;
  fragments_[slot(f)].site = site;
  store_polygon(fragments_[slot(f)], clipper);
  link(f);
  ++num_fragments_;
  changed_.push_back(f);
}

/// The slot keeps its room in the pools for its next use.
void RestrictedPowerDiagram::free_fragment(Index f) {
  Fragment& fragment = fragments_[slot(f)];
  (fragment.previous_of_site == kNone ? first_of_site_[slot(fragment.site)]
                                      : fragments_[slot(fragment.previous_of_site)].next_of_site) = fragment.next_of_site;
  if (fragment.next_of_site != kNone) fragments_[slot(fragment.next_of_site)].previous_of_site = fragment.previous_of_site;
  (fragment.previous_of_facet == kNone ? first_of_facet_[slot(fragment.facet)]
                                       : fragments_[slot(fragment.previous_of_facet)].next_of_facet) = fragment.next_of_facet;
  if (fragment.next_of_facet != kNone) fragments_[slot(fragment.next_of_facet)].previous_of_facet = fragment.previous_of_facet;
  fragment.size = 0;
  --num_fragments_;
  free_fragments_.push_back(f);
}

/// Moves all polygons together once more than half of the pools is unused.
void RestrictedPowerDiagram::compact_pools() {
  if (2 * pool_garbage_ < corners_.size()) return;
  std::vector<Vec3> corners;
  std::vector<Index> labels;
  corners.reserve(corners_.size());
  labels.reserve(labels_.size());
  for (Fragment& fragment : fragments_) {
    const Index first = static_cast<Index>(corners.size());
    corners.insert(corners.end(), corners_.begin() + fragment.first, corners_.begin() + fragment.first + fragment.size);
    labels.insert(labels.end(), labels_.begin() + fragment.first, labels_.begin() + fragment.first + fragment.size);
    fragment.first = first;
    fragment.capacity = fragment.size;
  }
  corners_.swap(corners);
  labels_.swap(labels);
  pool_garbage_ = 0;
}

// ---------------------------------------------------------------------------------------------------------------------------
// Local insertion

Index RestrictedPowerDiagram::hint_cell(Index near) const {
  return near == kNone || !visible(near) ? kNone : triangulation_.incident_cell(near + kSentinels);
}

Index RestrictedPowerDiagram::insert(const Vec3& position, double weight, Index near) {
  const Index s = triangulation_.insert(position, weight, hint_cell(near)) - kSentinels;
  first_of_site_.push_back(kNone);
  reach_.push_back(kNoCell);
  num_guards_ += is_guard(s);
  changed_.clear();
  if (visible(s)) take_cell(s, triangulation_.neighbors_of_last_insertion());
  return s;
}

void RestrictedPowerDiagram::reinsert(Index s, const Vec3& position, double weight, Index near) {
  if (s < 0 || s >= num_sites() || !removed(s)) {
    throw Error(ErrorCode::kInvalidArgument,
                "restricted power diagram: site " + std::to_string(s) + " is not a removed one; use insert()");
  }
  triangulation_.reinsert(s + kSentinels, position, weight, hint_cell(near));
  num_guards_ += is_guard(s);
  changed_.clear();
  if (!visible(s)) return;
  std::vector<Index> around = link_of(s);
  for (const Index v : triangulation_.hidden_by_last_insertion()) {
    const WeightedPoint &p = site(s), &q = triangulation_.point(v);
    if (v < kSentinels || p.position() != q.position() || p.w != q.w) continue;
    // Its duplicate had the cell until now, and no bisector tells the two apart.
    neighbors(s, around);
    around.push_back(s);
    reach_[slot(s)] = 0;
    share_out(v - kSentinels, around);
    finish_edit();
    return;
  }
  take_cell(s, around);
}

/// Gives a new site its cell. `around`: its neighbours, vertices of the triangulation.
void RestrictedPowerDiagram::take_cell(Index s, const std::vector<Index>& around) {
  // The new cell takes its place from its neighbours and from the sites it has hidden, and from nobody else.
  std::vector<Plane> planes;
  for (const Index v : around) {
    if (v >= kSentinels) planes.push_back(plane(s, v - kSentinels));
  }
  std::sort(planes.begin(), planes.end(), detail::nearer_plane<Plane>);
  for (const Plane& plane : planes) {  // worth a tenth of the time of an insertion, where the fragments exceed the cache
    const Index first = first_of_site(plane.site);
    if (first == kNone || plane.offset > reach_[slot(plane.site)]) continue;
    const Index last = std::min(first + detail::kFragmentsPrefetched, fragment_capacity());
    for (Index f = first; f < last; ++f) detail::prefetch(&fragments_[slot(f)]);
  }
  std::vector<Index> touched;
  for (const Plane& plane : planes) find_touched(plane.site, s, touched);
  for (const Index v : triangulation_.hidden_by_last_insertion()) {
    if (v >= kSentinels && v != s + kSentinels) find_touched(v - kSentinels, s, touched);
  }
  for (const Index f : touched) prefetch_facet_corners(fragments_[slot(f)].facet);
  Clipper clipper(*this);
  std::vector<Index> facets = clip_touched(touched, s, clipper);
  for (const Index v : triangulation_.hidden_by_last_insertion()) {
    if (v >= kSentinels && v != s + kSentinels) reach_[slot(v - kSentinels)] = kNoCell;
  }
  std::sort(facets.begin(), facets.end());
  facets.erase(std::unique(facets.begin(), facets.end()), facets.end());
  for (const Index facet : facets) {
    clipper.set_facet(facet);
    clipper.start(s);
    clipper.clip_all(planes.data(), planes.data() + planes.size());
    AMPS_ASSERT(!clipper.empty());
    add_fragment(facet, s, clipper);
  }
  update_reach(s);
  finish_edit();
}

void RestrictedPowerDiagram::finish_edit() {
  compact_pools();
  // A slot freed and used again is listed twice.
  std::sort(changed_.begin(), changed_.end());
  changed_.erase(std::unique(changed_.begin(), changed_.end()), changed_.end());
}

/// Lists the fragments of `site` from which the cell of `by` may take something.
void RestrictedPowerDiagram::find_touched(Index site, Index by, std::vector<Index>& touched) const {
  if (plane(site, by).offset > reach_[slot(site)]) return;
  const detail::SideFilter filter(this->site(site), this->site(by));
  const double error = largest_facet_error_, slope = filter.slope();
  for (Index f = first_of_site(site); f != kNone; f = next_of_site(f)) {
    const Fragment& fragment = fragments_[slot(f)];
    if (filter.surely_inside({fragment.centre[0], fragment.centre[1], fragment.centre[2]}, fragment.radius, error, slope)) continue;
    touched.push_back(f);
    prefetch_polygon(f);
  }
}

/// Takes the cell of `by` off these fragments, grouped by site, and returns the facets where it took something.
std::vector<Index> RestrictedPowerDiagram::clip_touched(const std::vector<Index>& touched, Index by, Clipper& clipper) {
  std::vector<Index> facets;
  for (std::size_t k = 0; k < touched.size();) {
    const Index site = fragments_[slot(touched[k])].site;
    bool any_clipped = false;
    for (; k < touched.size() && fragments_[slot(touched[k])].site == site; ++k) {
      const Index f = touched[k];
      clipper.load(polygon(f));
      if (!clipper.clip(by)) continue;
      any_clipped = true;
      facets.push_back(fragments_[slot(f)].facet);
      changed_.push_back(f);
      if (clipper.empty()) {
        free_fragment(f);
      } else {
        store_polygon(fragments_[slot(f)], clipper);
      }
    }
    if (any_clipped) update_reach(site);
  }
  return facets;
}

// Fragments that an edit touches are far apart in memory. It asks for all of them before it works on the first: on a mesh that
// exceeds the cache half of its time otherwise is waiting.

/// For the polygon of a fragment, and the corners' indices of its facet.
void RestrictedPowerDiagram::prefetch_polygon(Index f) const {
  const Fragment& fragment = fragments_[slot(f)];
  detail::prefetch(&corners_[slot(fragment.first)]);
  detail::prefetch(&corners_[slot(fragment.first + fragment.size - 1)]);
  detail::prefetch(&labels_[slot(fragment.first)]);
  detail::prefetch(mesh_.triangles.data() + fragment.facet * mesh_.triangles.outerStride());
  detail::prefetch(&facet_error_[slot(fragment.facet)]);
}

void RestrictedPowerDiagram::prefetch_facet_corners(Index facet) const {
  for (int c = 0; c < 3; ++c) detail::prefetch(mesh_.position(mesh_.triangles(facet, c)));
}

/// The neighbours of a visible site, vertices of the triangulation.
std::vector<Index> RestrictedPowerDiagram::link_of(Index s) {
  std::vector<Index> star, link;
  triangulation_.incident_cells(s + kSentinels, star);
  stamp_.resize(slot(triangulation_.num_vertices()), 0);
  if (++last_stamp_ == 0) {
    std::fill(stamp_.begin(), stamp_.end(), 0u);
    last_stamp_ = 1;
  }
  stamp_[slot(s + kSentinels)] = last_stamp_;
  for (const Index c : star) {
    for (const Index v : triangulation_.cell(c).vertex) {
      if (v == RegularTriangulation::kInfinite || stamp_[slot(v)] == last_stamp_) continue;
      stamp_[slot(v)] = last_stamp_;
      link.push_back(v);
    }
  }
  return link;
}

// ---------------------------------------------------------------------------------------------------------------------------
// Local removal
//
// What a site leaves in a facet is a convex polygon, to be divided among its heirs: its neighbours in space and the sites that
// it alone has hidden. A site beyond an edge of it gets the strip along that edge, hence a larger fragment: its old one, grown
// over the edge as far as the facet reaches, and cut by the other heirs. The edges of the grown ones lead to heirs that had
// nothing in the facet. Fragments that have no edge with the polygon stay as they are, as do other facets.

void RestrictedPowerDiagram::remove(Index s) {
  if (s < 0 || s >= num_sites() || removed(s)) {
    throw Error(ErrorCode::kInvalidArgument, "restricted power diagram: there is no site " + std::to_string(s) + "; ids are 0 to " +
                                                 std::to_string(num_sites() - 1) + ", less those removed");
  }
  if (num_removed() + 1 == num_sites()) {
    throw Error(ErrorCode::kInvalidArgument, "restricted power diagram: site " + std::to_string(s) +
                                                 " is the last one, and a diagram has at least one; insert another first");
  }
  keep_a_guard(s);
  changed_.clear();
  const bool had_cell = visible(s);
  std::vector<Index> heirs;
  if (had_cell) heirs = link_of(s);
  const Index hidden = triangulation_.num_hidden();
  triangulation_.remove(s + kSentinels);
  if (!had_cell) return;
  if (triangulation_.num_hidden() != hidden) add_uncovered(heirs);
  heirs.erase(std::remove_if(heirs.begin(), heirs.end(), [](Index v) { return v < kSentinels; }), heirs.end());
  for (Index& heir : heirs) heir -= kSentinels;
  share_out(s, heirs);
  finish_edit();
}

bool RestrictedPowerDiagram::is_guard(Index s) const {
  const WeightedPoint& p = site(s);
  return p.w >= least_weight_ && (p.position().array() >= low_.array()).all() && (p.position().array() <= high_.array()).all();
}

/// Before the removal of s: if it is the last guard, the sentinels move so that all sites are guards. No cell on the mesh changes.
void RestrictedPowerDiagram::keep_a_guard(Index s) {
  if (!is_guard(s)) return;
  if (--num_guards_ > 0) return;
  for (Index u = 0; u < num_sites(); ++u) {
    if (removed(u)) continue;
    low_ = low_.cwiseMin(site(u).position());
    high_ = high_.cwiseMax(site(u).position());
    least_weight_ = std::min(least_weight_, site(u).w);
  }
  Index v = 0;
  for (const WeightedPoint& sentinel : sentinels()) triangulation_.move(v++, sentinel.position(), sentinel.w);
  num_guards_ = num_sites() - num_removed() - 1;
  for (Index u = 0; u < num_sites(); ++u) {  // a duplicate of a sentinel, and the like
    if (visible(u) != (reach_[slot(u)] != kNoCell)) update_reach(u);
  }
}

/// Adds to the neighbours of a removed site (vertices of the triangulation) those that have come back from hiding. They and the
/// neighbours fill its place, so that each is joined to a neighbour by edges between such vertices.
void RestrictedPowerDiagram::add_uncovered(std::vector<Index>& heirs) {
  std::vector<Index> around;
  for (std::size_t k = 0; k < heirs.size(); ++k) {
    triangulation_.neighbors(heirs[k], around);
    for (const Index v : around) {
      const bool fresh = v < kSentinels ? std::find(heirs.begin(), heirs.end(), v) == heirs.end()
                                        : reach_[slot(v - kSentinels)] == kNoCell;
      if (!fresh) continue;
      if (v >= kSentinels) reach_[slot(v - kSentinels)] = 0;
      heirs.push_back(v);
    }
  }
}

/// Divides the fragments of s, which has no cell any more, among the heirs.
void RestrictedPowerDiagram::share_out(Index s, const std::vector<Index>& heirs) {
  std::vector<Index> left, contenders, owners;
  for (Index f = first_of_site(s); f != kNone; f = next_of_site(f)) {
    left.push_back(f);
    prefetch_polygon(f);
    detail::prefetch(&first_of_facet_[slot(fragments_[slot(f)].facet)]);
  }
  for (const Index f : left) {
    const Index facet = fragments_[slot(f)].facet;
    prefetch_facet_corners(facet);
    Index grown = first_of_facet(facet);
    for (Index k = 0; k < detail::kFragmentsPrefetched && grown != kNone; ++k, grown = next_of_facet(grown)) prefetch_polygon(grown);
  }
  Clipper clipper(*this);
  reach_[slot(s)] = kNoCell;
  for (const Index f : left) {
    find_contenders(f, heirs, contenders);
    share_out_facet(f, contenders, clipper, owners);
  }
}

/// The heirs that may own something in fragment f. At its points, in the ball around it, the owner's power is at most what any
/// heir's can be there.
void RestrictedPowerDiagram::find_contenders(Index f, const std::vector<Index>& heirs, std::vector<Index>& contenders) const {
  const Fragment& fragment = fragments_[slot(f)];
  const Vec3 centre(fragment.centre[0], fragment.centre[1], fragment.centre[2]);
  const double radius = fragment.radius + largest_facet_error_;
  const auto slack = [](double d, double w) { return detail::kOffsetSlack * (d * d + std::fabs(w)); };
  double most = INFINITY;
  for (const Index heir : heirs) {
    const double d = (site(heir).position() - centre).norm() + radius, w = site(heir).w;
    most = std::min(most, d * d - w + slack(d, w));
  }
  contenders.clear();
  for (const Index heir : heirs) {
    const double d = std::max((site(heir).position() - centre).norm() - radius, 0.0), w = site(heir).w;
    if (!(d * d - w - slack(d, w) > most)) contenders.push_back(heir);  // NaN, from overflow, decides nothing
  }
}

/// `owners`: scratch.
void RestrictedPowerDiagram::share_out_facet(Index f, const std::vector<Index>& contenders, Clipper& clipper,
                                             std::vector<Index>& owners) {
  const Polygon left = polygon(f);
  owners.clear();
  for (Index k = 0; k < left.size; ++k) {
    if (is_site(left.labels[k])) owners.push_back(left.labels[k]);
  }
  free_fragment(f);
  changed_.push_back(f);
  if (owners.empty()) owners.push_back(owner_of_corner(left.facet, contenders));
  for (std::size_t n = 0; n < owners.size(); ++n) {
    const Index owner = owners[n], grown = fragment_of(left.facet, owner);
    if (grown == kNone) {
      clipper.set_facet(left.facet);
      clipper.start(owner);
    } else {
      clipper.load_without(polygon(grown), left.site);
    }
    // Those with edges here first: they cut off the most.
    for (const Index other : owners) {
      if (other != owner && !clipper.has_label(other)) clipper.clip(other);
    }
    for (const Index other : contenders) {
      if (other != owner && !clipper.has_label(other)) clipper.clip(other);
    }
    AMPS_ASSERT(!clipper.empty());
    for (const Index label : clipper.labels()) {
      if (!is_site(label) || std::find(owners.begin(), owners.end(), label) != owners.end()) continue;
      const Index* const labels = grown == kNone ? nullptr : polygon(grown).labels;
      if (grown == kNone || std::find(labels, labels + polygon(grown).size, label) == labels + polygon(grown).size) {
        owners.push_back(label);
      }
    }
    if (grown == kNone) {
      add_fragment(left.facet, owner, clipper);
    } else {
      store_polygon(fragments_[slot(grown)], clipper);
      changed_.push_back(grown);
    }
    const double farthest = reach(grown == kNone ? changed_.back() : grown);
    double& known = reach_[slot(owner)];
    if (farthest > known || std::isnan(farthest)) known = farthest;
  }
}

/// Which of these sites owns the first corner of the facet.
Index RestrictedPowerDiagram::owner_of_corner(Index facet, const std::vector<Index>& among) const {
  const double* const x = mesh_.position(mesh_.triangles(facet, 0));
  const double* const corners[3] = {x, x, x};
  AMPS_ASSERT(!among.empty());
  Index best = among.front();
  for (const Index other : among) {
    if (other != best && side_of_corner(corners, 0, Bisector(site(best), site(other), corners)) < 0) best = other;
  }
  return best;
}

/// The fragment of the site in the facet, if any. In time proportional to the shorter of their lists, or better.
Index RestrictedPowerDiagram::fragment_of(Index facet, Index site) const {
  Index a = first_of_facet(facet), b = first_of_site(site);
  while (a != kNone && b != kNone) {
    if (fragments_[slot(a)].site == site) return a;
    if (fragments_[slot(b)].facet == facet) return b;
    a = next_of_facet(a);
    b = next_of_site(b);
  }
  return kNone;
}

// ---------------------------------------------------------------------------------------------------------------------------

void RestrictedPowerDiagram::neighbors(Index s, std::vector<Index>& out) const {
  triangulation_.neighbors(s + kSentinels, out);
  std::size_t kept = 0;
  for (const Index v : out) {
    if (v >= kSentinels) out[kept++] = v - kSentinels;
  }
  out.resize(kept);
}

RegularTriangulation::Adjacency RestrictedPowerDiagram::adjacency() const {
  RegularTriangulation::Adjacency all = triangulation_.adjacency(), result;
  result.offset.assign(1, 0);
  result.offset.reserve(slot(num_sites()) + 1);
  result.adjacent.reserve(all.adjacent.size());
  for (std::size_t v = kSentinels; v + 1 < all.offset.size(); ++v) {
    for (Index k = all.offset[v]; k < all.offset[v + 1]; ++k) {
      if (all.adjacent[slot(k)] >= kSentinels) result.adjacent.push_back(all.adjacent[slot(k)] - kSentinels);
    }
    result.offset.push_back(static_cast<Index>(result.adjacent.size()));
  }
  return result;
}

// ---------------------------------------------------------------------------------------------------------------------------
// Dual, measures, proof

Triangles RestrictedPowerDiagram::dual_triangles(std::vector<Index>* facets) const {
  std::vector<Index> corners;
  if (facets != nullptr) facets->clear();
  for (Index f = 0; f < fragment_capacity(); ++f) {
    const Polygon p = polygon(f);
    for (Index k = 0; k < p.size; ++k) {
      // Walking round the vertex counter-clockwise from the owner, the cell across the incoming edge comes first.
      const Index in = p.labels[k == 0 ? p.size - 1 : k - 1], out = p.labels[k];
      if (in <= p.site || out <= p.site)
        continue;  // mesh edges are negative; all three fragments see the vertex, the least lists it
      corners.insert(corners.end(), {p.site, in, out});
      if (facets != nullptr) facets->push_back(p.facet);
    }
  }
  return Eigen::Map<const Triangles>(corners.data(), static_cast<Eigen::Index>(corners.size() / 3), 3);
}

std::vector<double> RestrictedPowerDiagram::cell_areas() const {
  std::vector<double> area(slot(num_sites()), 0.0);
  for (Index f = 0; f < fragment_capacity(); ++f) {
    if (alive(f)) area[slot(fragments_[slot(f)].site)] += polygon(f).area();
  }
  return area;
}

std::string RestrictedPowerDiagram::check() const {
  const auto name = [](Index f) { return "fragment " + std::to_string(f); };
  Index live = 0;
  Clipper clipper(*this);
  std::vector<Index> around;
  for (Index f = 0; f < fragment_capacity(); ++f) {
    if (!alive(f)) continue;
    ++live;
    const Polygon p = polygon(f);
    if (p.size < 3) return name(f) + ": fewer than 3 corners";
    for (Index k = 0; k < p.size; ++k) {
      const Index label = p.labels[k];
      if (label < mesh_edge_label(2) || label >= num_sites()) return name(f) + ": label out of range";
      if (std::count(p.labels, p.labels + p.size, label) != 1) return name(f) + ": label twice";
      if (!is_site(label)) continue;
      Index twin = first_of_facet(p.facet);
      while (twin != kNone && fragments_[slot(twin)].site != label) twin = next_of_facet(twin);
      if (twin == kNone) return name(f) + ": nothing beyond label " + std::to_string(label);
      const Polygon q = polygon(twin);
      if (std::count(q.labels, q.labels + q.size, p.site) != 1) return name(f) + ": label not mutual";
    }
    // Clipping again by every neighbour must cut nothing off.
    neighbors(p.site, around);
    clipper.load(p);
    for (const Index other : around) {
      if (std::find(p.labels, p.labels + p.size, other) == p.labels + p.size && clipper.clip(other)) {
        return name(f) + ": reaches over the bisector with " + std::to_string(other);
      }
    }
  }
  if (live != num_fragments_) return "fragment count is off";
  for (Index facet = 0; facet < mesh_.num_facets(); ++facet) {
    double sum = 0;
    Index count = 0;
    for (Index f = first_of_facet(facet); f != kNone; f = next_of_facet(f), ++count) {
      if (fragments_[slot(f)].facet != facet || !alive(f)) return "facet list of " + std::to_string(facet) + " is broken";
      sum += polygon(f).area();
    }
    const Vec3 a = mesh_.corner(facet, 0), b = mesh_.corner(facet, 1), c = mesh_.corner(facet, 2);
    const double area = 0.5 * (b - a).cross(c - a).stableNorm();
    const double longest = std::max({(b - a).stableNorm(), (c - b).stableNorm(), (a - c).stableNorm()});
    // Corners are off by facet_error_, fragments by that along their borders of at most 4 longest edges each.
    const double rounding = 4 * longest * std::max(facet_error_[slot(facet)], 0.0) * (count + 1);
    if (std::fabs(sum - area) > 1e-9 * area + rounding + 1e-12 * longest * longest) {
      return "fragments of facet " + std::to_string(facet) + " do not tile it";
    }
  }
  return "";
}

}  // namespace amps
