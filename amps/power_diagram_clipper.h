// power_diagram_clipper.h (internal): cuts a polygon of a facet by bisectors, every side decided exactly.
#pragma once

#include "amps/power_diagram.h"
#include "amps/predicates.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace amps {
namespace detail {

/// A corner computed from barycentric coordinates good to a few 2^-46 (predicates.h), and then rounded to 2^-47, is off by less
/// than this, relative to the facet's longest edge, plus kPositionRounding relative to its largest coordinate.
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

/// D_j(x) of predicates.h in doubles, for the many corners that are far from the bisector: at y = x − p_i, known to `error`,
/// of a length up to `reach`. With d = p_j − p_i it is (d² + w_i − w_j) − 2 d·y. With u = 2^-53, rounding makes the first term
/// wrong by up to 8u (d² + |w_i − w_j|), the second by 12u |d|₁ |y|, their difference by u of both: kSideRounding is 32u. What
/// x is wrong by adds 2 |d|₁ error.
class RelativeFilter {
 public:
  RelativeFilter(const Vec3& owner, double owner_weight, const WeightedPoint& other, double error, double reach) noexcept
      : difference_(other.position() - owner) {
    const double square = squared_norm(difference_), weights = owner_weight - other.w;
    constant_ = square + weights;
    margin_ = sum(difference_.cwiseAbs()) * (2 * error + kSideRounding * reach) +
              (kSideRounding * (square + std::fabs(weights)) + std::numeric_limits<double>::min());
  }

  double value(const Vec3& y) const noexcept { return constant_ - 2 * dot(difference_, y); }
  /// The owner's side for sure, given a value; the other's if it is so for the negative value. Never for NaN, from overflow.
  bool is_inside(double value) const noexcept { return value > margin_; }
  /// |∇D|: a ball around y is on the owner's side if is_inside(value(y) − slope · radius).
  double slope() const noexcept { return 2 * (1 + kOffsetSlack) * norm(difference_); }
  /// The side if it is sure, else 0.
  int side(const Vec3& y) const noexcept {
    const double at = value(y);
    return is_inside(at) ? 1 : (is_inside(-at) ? -1 : 0);
  }

 private:
  Vec3 difference_;
  double constant_, margin_;
};

/// The corners of a facet, where several points of it are computed.
struct FacetCorners {
  Vec3 at[3];
  FacetCorners(const MeshView& mesh, Index facet) : at{mesh.corner(facet, 0), mesh.corner(facet, 1), mesh.corner(facet, 2)} {}
};

/// Order of a site's planes; ties by site, so that nothing depends on the sort. A type, which sorting compiles in.
struct NearerPlane {
  template <class Plane>
  bool operator()(const Plane& a, const Plane& b) const noexcept {
    return a.offset != b.offset ? a.offset < b.offset : a.site < b.site;
  }
};

}  // namespace detail

class RestrictedPowerDiagram::Clipper {
 public:
  /// Labels of the polygon, for loops.
  struct Labels {
    const Index *first, *last;
    const Index* begin() const { return first; }
    const Index* end() const { return last; }
  };

  explicit Clipper(const RestrictedPowerDiagram& diagram) : diagram_(diagram) {}
  Clipper(const Clipper&) = delete;
  Clipper& operator=(const Clipper&) = delete;

  /// For bulk work, while no site changes: two or three fragments of a facet have a corner, one after the other.
  void remember_crossings() { known_.resize(kCrossingsKnown, Crossing{kNone, 0, 0, 0, {{0, 0}, Vec3::Zero()}}); }

  void set_facet(Index facet) {
    const MeshView& mesh = diagram_.mesh_;
    facet_ = facet;
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
    if (owner_site_ == kNone) owner_position_ = Vec3::Zero();
    now_->clear(3);
    for (int c = 0; c < 3; ++c) {
      now_->add({detail::PackedBarycentric::of_corner(c), position_[c]}, mesh_edge_label(c), owner_position_);
    }
    measure();
  }

  void load(const Polygon& polygon) {
    set_facet(polygon.facet);
    set_owner(polygon.site);
    now_->clear(detail::slot(polygon.size));
    for (Index k = 0; k < polygon.size; ++k) now_->add(placed(polygon, k), polygon.labels[k], owner_position_);
    measure();
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
    const std::size_t m = now_->size;
    std::size_t k = static_cast<std::size_t>(std::find(labels().begin(), labels().end(), in) - labels().begin());
    AMPS_ASSERT(k < m);
    next_->clear(m + detail::slot(n));
    do {
      k = k + 1 == m ? 0 : k + 1;
      next_->add(*now_, k);
    } while (now_->labels[k] != out);
    for (Index e = 2; e < n; ++e) next_->add(placed(polygon, (at + e) % n), polygon.labels[(at + e) % n], owner_position_);
    std::swap(now_, next_);
    measure();
  }

  bool has_label(Index label) const { return std::find(labels().begin(), labels().end(), label) != labels().end(); }

  /// Keeps what is on the owner's side of the bisector with `other`; true if something was cut off.
  bool clip(Index other) {
    const WeightedPoint& site = diagram_.site(other);
    const detail::RelativeFilter filter(owner_position_, owner_->w, site, position_error_, reach_);
    const std::size_t n = now_->size;
    bool all_inside = true;
    for (std::size_t k = 0; k < n; ++k) {
      values_[k] = filter.value(now_->relative[k]);
      all_inside = all_inside & filter.is_inside(values_[k]);
    }
    if (all_inside) return false;
    std::optional<Bisector> bisector_with_other;
    bool any_inside = false, any_outside = false;
    for (std::size_t k = 0; k < n; ++k) {
      bool inside = filter.is_inside(values_[k]);
      if (!inside && !filter.is_inside(-values_[k])) inside = exact_side(k, with(site, bisector_with_other)) > 0;
      inside_[k] = inside;
      (inside ? any_inside : any_outside) = true;
    }
    if (!any_outside) return false;
    if (any_inside) {
      cut(other, bisector_with_other);
    } else {
      now_->size = 0;
    }
    return true;
  }

  /// Clips by bisectors in order of their offset while they can reach the polygon (security radius).
  void clip_all(const Plane* begin, const Plane* end) {
    for (const Plane* plane = begin; plane != end && plane->offset <= reach_; ++plane) {
      if (clip(plane->site) && empty()) return;
    }
  }

  bool empty() const { return now_->size == 0; }

  /// No plane at a greater offset from the owner reaches the polygon.
  double security_radius() const { return reach_; }

  Index size() const { return static_cast<Index>(now_->size); }
  const detail::PackedBarycentric* corners() const { return now_->corners.data(); }
  detail::PackedBall ball() const { return detail::PackedBall(now_->relative.data(), now_->size); }
  Labels labels() const { return {now_->labels.data(), now_->labels.data() + now_->size}; }

 private:
  /// A point of the facet, as it is kept, and where that is.
  struct Placed {
    detail::PackedBarycentric place;
    Vec3 position;
  };

  /// A polygon in arrays that keep their room.
  struct Arrays {
    std::size_t size = 0;
    std::vector<detail::PackedBarycentric> corners;
    std::vector<Vec3> relative;   ///< to the owner
    std::vector<double> squares;  ///< squared distances from the owner
    std::vector<Index> labels;

    /// Makes it empty, with room for that many corners.
    void clear(std::size_t room) {
      size = 0;
      if (room <= labels.size()) return;
      constexpr std::size_t kLeastRoom = 32;
      room = std::max(2 * room, kLeastRoom);
      corners.resize(room);
      relative.resize(room);
      squares.resize(room);
      labels.resize(room);
    }
    void add(const Placed& x, Index label, const Vec3& owner) {
      corners[size] = x.place;
      relative[size] = x.position - owner;
      squares[size] = detail::squared_norm(relative[size]);
      labels[size++] = label;
    }
    void add(const Arrays& other, std::size_t k) {
      corners[size] = other.corners[k];
      relative[size] = other.relative[k];
      squares[size] = other.squares[k];
      labels[size++] = other.labels[k];
    }
  };

  /// Of two bisectors, or one and a mesh edge, on a facet.
  struct Crossing {
    Index facet;
    Index a, b, c;  ///< the sites and the edge's label, ascending
    Placed placed;
  };
  /// A facet's fragments are found next to each other: those of the last 20 or so.
  static constexpr int kCrossingBits = 6;
  static constexpr std::size_t kCrossingsKnown = std::size_t{1} << kCrossingBits;

  /// Corner k of a polygon of the facet.
  Placed placed(const Polygon& polygon, Index k) const {
    const detail::PackedBarycentric& place = polygon.corners.places()[k];
    return {place, place.position(position_)};
  }

  void set_owner(Index site) {
    owner_site_ = site;
    owner_ = &diagram_.site(site);
    owner_position_ = owner_->position();
  }

  /// To be called whenever corners have changed.
  void measure() {
    double farthest = 0;
    for (std::size_t k = 0; k < now_->size; ++k) farthest = std::max(farthest, now_->squares[k]);
    reach_ = std::sqrt(farthest) * (1 + detail::kOffsetSlack) + position_error_;
    if (values_.size() < now_->size) {
      values_.resize(now_->labels.size());
      inside_.resize(now_->labels.size());
    }
  }

  /// The bisector of the owner and the site, made when it is first asked for.
  const Bisector& with(const WeightedPoint& site, std::optional<Bisector>& bisector) const {
    if (!bisector) bisector.emplace(*owner_, site, corner_);
    return *bisector;
  }

  int exact_side(std::size_t k, const Bisector& by) const {
    const Index in = now_->labels[k == 0 ? now_->size - 1 : k - 1], out = now_->labels[k];
    if (is_site(in) && is_site(out)) return side_of_facet_crossing(corner_, bisector(in), bisector(out), by);
    if (!is_site(in) && !is_site(out)) return side_of_corner(corner_, mesh_edge(out), by);
    const int e = mesh_edge(is_site(in) ? out : in);
    return side_of_edge_crossing(corner_, e, (e + 1) % 3, bisector(is_site(in) ? in : out), by);
  }

  Bisector bisector(Index label) const { return Bisector(*owner_, diagram_.site(label), corner_); }

  /// The intersection of the line of an edge with the bisector of `other`.
  const Placed& crossing(Index label, Index other, std::optional<Bisector>& bisector_with_other) {
    if (known_.empty()) {
      compute_crossing(label, other, bisector_with_other, unknown_);
      return unknown_;
    }
    // All fragments there compute the same bits, so it does not matter which one did.
    Index a = owner_site_, b = other, c = label;
    if (b < a) std::swap(a, b);
    if (c < b) std::swap(b, c);
    if (b < a) std::swap(a, b);
    const std::uint32_t hash = 0x9e3779b1u * static_cast<std::uint32_t>(a) + 0x85ebca77u * static_cast<std::uint32_t>(b) +
                               0xc2b2ae3du * static_cast<std::uint32_t>(c);
    Crossing& known = known_[hash >> (32 - kCrossingBits)];
    if (known.facet != facet_ || known.a != a || known.b != b || known.c != c) {
      known.facet = facet_;
      known.a = a;
      known.b = b;
      known.c = c;
      compute_crossing(label, other, bisector_with_other, known.placed);
    }
    return known.placed;
  }

  void compute_crossing(Index label, Index other, std::optional<Bisector>& bisector_with_other, Placed& result) const {
    if (is_site(label)) {
      const Vec3 b = facet_crossing_coordinates(corner_, *owner_, diagram_.site(label), diagram_.site(other));
      result.place = detail::PackedBarycentric::inside(b, position_, result.position);
      return;
    }
    // Ends in the order of their global indices: both facets of the edge compute the same bits.
    int u = mesh_edge(label), v = (u + 1) % 3;
    if (vertex_[detail::slot(u)] > vertex_[detail::slot(v)]) std::swap(u, v);
    const std::array<double, 2> b = edge_crossing_coordinates(corner_, u, v, with(diagram_.site(other), bisector_with_other));
    result.place = detail::PackedBarycentric::on_edge(u, v, b[1], position_, result.position);
  }

  /// Replaces the outside corners, one run of them since both polygon and half-space are convex, by two crossings.
  void cut(Index other, std::optional<Bisector>& bisector_with_other) {
    const std::size_t n = now_->size;
    std::size_t leave = 0;  // the last corner inside before the run
    while (!(inside_[leave] && !inside_[leave + 1 == n ? 0 : leave + 1])) ++leave;
    std::size_t enter = leave + 1 == n ? 0 : leave + 1;  // the last corner of the run
    while (!inside_[enter + 1 == n ? 0 : enter + 1]) enter = enter + 1 == n ? 0 : enter + 1;
    next_->clear(n + 1);
    for (std::size_t k = enter + 1 == n ? 0 : enter + 1;; k = k + 1 == n ? 0 : k + 1) {
      AMPS_ASSERT(inside_[k]);
      next_->add(*now_, k);
      if (k == leave) break;
    }
    next_->add(crossing(now_->labels[leave], other, bisector_with_other), other, owner_position_);
    next_->add(crossing(now_->labels[enter], other, bisector_with_other), now_->labels[enter], owner_position_);
    std::swap(now_, next_);
    measure();
  }

  const RestrictedPowerDiagram& diagram_;
  Vec3 position_[3] = {Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};
  const double* const corner_[3] = {position_[0].data(), position_[1].data(), position_[2].data()};
  std::array<Index, 3> vertex_{};
  double position_error_ = 0;
  Index facet_ = kNone, owner_site_ = kNone;
  const WeightedPoint* owner_ = nullptr;
  Vec3 owner_position_ = Vec3::Zero();
  double reach_ = 0;  ///< not less than the distance of any corner from the owner
  Arrays arrays_[2];
  Arrays *now_ = &arrays_[0], *next_ = &arrays_[1];
  std::vector<double> values_;  ///< of a bisector, at the corners
  std::vector<char> inside_;
  std::vector<Crossing> known_;  ///< by hash
  Placed unknown_{{0, 0}, Vec3::Zero()};
};

/// Memory of finding and taking cells, of one thread, while no site changes.
struct RestrictedPowerDiagram::CellScratch {
  explicit CellScratch(const RestrictedPowerDiagram& diagram) : clipper(diagram) { clipper.remember_crossings(); }

  Clipper clipper;
  /// A fragment that the new site takes from: where, and whose it was; kNone if nothing is left of it.
  struct Taken {
    Index facet, order, site;
  };
  std::vector<Plane> planes;   ///< of the new site, by offset
  std::vector<Index> touched;  ///< fragments it may take something from
  std::vector<Taken> taken;
};

}  // namespace amps
