// power_diagram_clipper.h (internal): cuts a polygon of a facet by bisectors, every side decided exactly.
#pragma once

#include "amps/power_diagram.h"
#include "amps/predicates.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace amps {
namespace detail {

/// A corner computed from barycentric coordinates good to a few 2^-46 (predicates.h) is off by less than this, relative to the
/// facet's longest edge, plus kPositionRounding relative to its largest coordinate.
inline constexpr double kPositionError = 0x1p-42;
inline constexpr double kPositionRounding = 0x1p-49;
/// Relative rounding of D_k(x) evaluated in doubles: 8 operations, slack 4.
inline constexpr double kSideRounding = 0x1p-48;
/// Records of a site's fragments lie side by side when they have come from bulk construction.
inline constexpr Index kFragmentsPrefetched = 8;
/// A cell with more fragments than that is divided with lists of its neighbours' ones.
inline constexpr std::size_t kManyFragments = 32;
/// Relative slack of plane offsets and of the security radius they are compared with.
inline constexpr double kOffsetSlack = 1e-9;

/// D_j(x) of predicates.h in doubles, for the many corners that are far from the bisector.
class SideFilter {
 public:
  SideFilter(const WeightedPoint& owner, const WeightedPoint& other) noexcept
      : difference_(other.position() - owner.position()),
        sum_(other.position() + owner.position()),
        weights_(owner.w - other.w),
        gradient_(sum(difference_.cwiseAbs())),
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
  double slope() const noexcept { return 2 * (1 + kOffsetSlack) * norm(difference_); }

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

}  // namespace detail

class RestrictedPowerDiagram::Clipper {
 public:
  explicit Clipper(const RestrictedPowerDiagram& diagram) : diagram_(diagram) {}
  Clipper(const Clipper&) = delete;
  Clipper& operator=(const Clipper&) = delete;

  void set_facet(Index facet) {
    const MeshView& mesh = diagram_.mesh_;
    for (int c = 0; c < 3; ++c) {
      vertex_[detail::slot(c)] = mesh.triangles(facet, c);
      position_[c] = mesh.vertices[vertex_[detail::slot(c)]];
    }
    position_error_ = diagram_.facet_error_[detail::slot(facet)];
  }

  /// The whole facet, owned by `site`.
  void start(Index site) {
    set_owner(site);
    start_ownerless();
  }

  /// The whole facet, owned by nobody; not to be clipped.
  void start_ownerless() {
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
    // What the facet cut by these two has between their edges takes the place of the edge. None of the other edges can end
    // there: each already is an edge elsewhere, and a line bounds a convex polygon only once.
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

  /// No plane at a greater offset from the owner reaches the polygon.
  double security_radius() const {
    double farthest = 0;
    for (const Vec3& x : corners_) farthest = std::max(farthest, detail::squared_norm(x - owner_position_));
    return std::sqrt(farthest) * (1 + detail::kOffsetSlack) + position_error_;
  }

  const std::vector<Vec3>& corners() const { return corners_; }
  const std::vector<Index>& labels() const { return labels_; }

 private:
  const Vec3& corner(int c) const { return position_[c]; }

  void set_owner(Index site) {
    owner_ = &diagram_.site(site);
    owner_position_ = owner_->position();
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
    if (vertex_[detail::slot(u)] > vertex_[detail::slot(v)]) std::swap(u, v);
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
  Vec3 position_[3] = {Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};
  const double* const corner_[3] = {position_[0].data(), position_[1].data(), position_[2].data()};
  std::array<Index, 3> vertex_{};
  double position_error_ = 0;
  const WeightedPoint* owner_ = nullptr;
  Vec3 owner_position_ = Vec3::Zero();
  std::vector<Vec3> corners_, new_corners_;
  std::vector<Index> labels_, new_labels_;
  std::vector<signed char> sides_;
};

}  // namespace amps
