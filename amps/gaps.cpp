#define AMPS_OWN_SOURCE
#include "amps/gaps.h"

#include "amps/exact.h"
#include "amps/portable_math.h"
#include "amps/predicates.h"

#include <algorithm>
#include <cmath>

namespace amps::detail {
namespace {

/// A plane whose disk has less than this share of the ball's squared radius is taken to miss the ball: less is rounding.
constexpr double kSmallestDisk = 1e-14;

/// Stands for the excess of a corner that is uncovered by less than rounding.
constexpr double kThinnestExcess = 0x1p-60;

/// Each dart in the primitives hits the gap with probability ≥ 1/2; all of these miss with probability 2^-64.
constexpr int kGapSampleTries = 64;

/// Two unit vectors that make a right-handed orthonormal frame with the unit vector n (Duff et al., JCGT 6(1), 2017).
void complete_gap_frame(const Vec3& n, Vec3& u, Vec3& v) {
  const double sign = std::copysign(1.0, n.z());
  const double a = -1.0 / (sign + n.z());
  const double b = n.x() * n.y() * a;
  u = {1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()};
  v = {b, sign + n.y() * n.y() * a, -n.y()};
}

/// x − sin x for x ≥ 0. Below 0.5 by its series, whose first term left out, x^17/17!, is below 2^-53 of the result.
double angle_minus_sine(double x) {
  if (x >= 0.5) return x - portable_sine_cosine(x).sine;
  const double y = x * x;
  double sum = 1.0;
  for (double k = 14.0; k >= 4.0; k -= 2.0) sum = 1.0 - sum * y / (k * (k + 1.0));
  return x * y / 6.0 * sum;
}

}  // namespace

double FragmentGap::assign(const RestrictedPowerDiagram& diagram, const RestrictedPowerDiagram::Polygon& polygon) {
  if (!diagram.uncovered_corners(polygon, decided_)) {
    clear();
    return 0;
  }
  const Vec3 normal = normal_of(diagram.mesh(), polygon.facet);
  if (polygon.site == kNone) {  // all of it is a gap, as beside a ball that is too far away to meet it
    double extent = 0;
    for (Index k = 1; k < polygon.size; ++k) extent = std::max(extent, norm(polygon.corners[k] - polygon.corners[0]));
    return assign({polygon.corners, decided_.size(), normal}, {polygon.corners[0] + 2 * extent * normal, extent * extent},
                  decided_);
  }
  const WeightedPoint& site = diagram.site(polygon.site);
  return assign({polygon.corners, decided_.size(), normal}, {site.position(), site.w}, decided_);
}

void FragmentGap::clear() {
  runs_.clear();
  points_.clear();
  triangles_.clear();
  has_primitives_ = false;
  area_ = 0;
}

double FragmentGap::assign(const FragmentView& fragment, const Ball& ball, const std::vector<char>& uncovered) {
  AMPS_ASSERT(fragment.size >= 3 && ball.weight > 0 && uncovered.size() == fragment.size);
  clear();
  uncovered_ = uncovered;
  double farthest_distance = -1;
  for (std::size_t k = 0; k < fragment.size; ++k) {
    if (uncovered_[k] == 0) continue;
    const double distance = squared_norm(fragment.corners[k] - ball.centre);
    if (distance > farthest_distance) {
      farthest_distance = distance;
      farthest_ = k;
    }
  }
  if (farthest_distance < 0) return 0;

  farthest_corner_ = fragment.corners[farthest_];
  set_frame(fragment, ball);
  find_runs();
  for (const Run& run : runs_) area_ += run.area;
  return area();
}

void FragmentGap::set_frame(const FragmentView& fragment, const Ball& ball) {
  ball_ = ball;
  scale_ = std::sqrt(ball.weight);
  const double to_frame = 1.0 / scale_;
  complete_gap_frame(fragment.normal, axis_u_, axis_v_);
  // The plane is taken through the farthest corner, so that rounding cannot make a gap with this corner vanish in the plane:
  // its distance within the plane and the height below add up to its distance in space.
  const double height = dot(farthest_corner_ - ball.centre, fragment.normal);
  origin_ = ball.centre + height * fragment.normal;
  disk_ = 1.0 - (height * to_frame) * (height * to_frame);
  radius_ = disk_ > 0 ? std::sqrt(disk_) : 0.0;

  corners_.resize(fragment.size);
  excess_.resize(fragment.size);
  for (std::size_t k = 0; k < fragment.size; ++k) {
    const Vec3 d = (fragment.corners[k] - ball.centre) * to_frame;
    corners_[k] = {dot(d, axis_u_), dot(d, axis_v_)};
    excess_[k] = squared_norm(corners_[k]) - disk_;
    if ((excess_[k] > 0) != (uncovered_[k] != 0)) excess_[k] = uncovered_[k] != 0 ? kThinnestExcess : 0.0;
  }
}

FragmentGap::EdgeKind FragmentGap::edge_kind(std::size_t from, std::size_t to) const {
  const bool from_outside = excess_[from] > 0;
  const bool to_outside = excess_[to] > 0;
  if (!from_outside) return to_outside ? EdgeKind::kLeaves : EdgeKind::kInside;
  if (!to_outside) return EdgeKind::kEnters;
  const Point& a = corners_[from];
  const Point& b = corners_[to];
  const Point d = b - a;
  if (dot(a, d) >= 0 || dot(b, d) <= 0) return EdgeKind::kOutside;  // the nearest point to the centre is an end
  const double c = cross(a, d);
  return c * c < disk_ * squared_norm(d) ? EdgeKind::kThrough : EdgeKind::kOutside;
}

/// The first point on the circle from corner `outside` along the edge to `other`.
FragmentGap::Point FragmentGap::crossing(std::size_t outside, std::size_t other) const {
  const Point& a = corners_[outside];
  const Point d = corners_[other] - a;
  const double length = norm(d);
  if (!(length > 0)) return a;
  const Point direction = d / length;
  const double c = cross(a, direction);
  const double half_chord = std::sqrt(std::max(0.0, disk_ - c * c));
  // The smaller root of s² + 2s (a·direction) + excess, in the form that does not cancel.
  const double denominator = half_chord - dot(a, direction);
  const double s = denominator > 0 ? std::min(excess_[outside] / denominator, length) : length;
  return a + s * direction;
}

void FragmentGap::find_runs() {
  const std::size_t n = corners_.size();
  if (disk_ <= kSmallestDisk) return add_whole_polygon();
  const auto next = [n](std::size_t k) { return k + 1 == n ? 0 : k + 1; };

  std::size_t first = 0;  // an edge on which a run starts
  for (; first < n; ++first) {
    const EdgeKind kind = edge_kind(first, next(first));
    if (kind == EdgeKind::kLeaves || kind == EdgeKind::kThrough) break;
  }
  if (first == n) {  // the boundary stays outside: it goes around the disk, or the disk lies beside the polygon
    for (std::size_t k = 0; k < n; ++k) {
      if (cross(corners_[k], corners_[next(k)]) < 0) return add_whole_polygon();
    }
    return add_ring();
  }

  std::size_t begin = 0;
  bool open = false;
  bool worth_it = false;  // does the run have an uncovered corner?
  for (std::size_t step = 0, i = first; step <= n; ++step, i = next(i)) {
    const std::size_t j = next(i);
    const EdgeKind kind = edge_kind(i, j);
    if (open && (kind == EdgeKind::kEnters || kind == EdgeKind::kThrough)) {
      points_.push_back(crossing(i, j));
      if (worth_it) {
        add_run(begin, run_angle(begin));
      } else {
        points_.resize(begin);
      }
      open = false;
    }
    if (step == n) break;
    if (kind == EdgeKind::kLeaves || kind == EdgeKind::kThrough) {
      begin = points_.size();
      points_.push_back(crossing(j, i));
      open = true;
      worth_it = false;
    }
    if (open) {
      points_.push_back(corners_[j]);
      worth_it |= uncovered_[j] != 0;
    }
  }
}

void FragmentGap::add_whole_polygon() {
  points_.assign(corners_.begin(), corners_.end());
  add_run(0, 0.0);
}

/// The polygon contains the disk: halve both by the line through the centre and the farthest corner.
void FragmentGap::add_ring() {
  const std::size_t n = corners_.size();
  const Point& corner = corners_[farthest_];
  const Point touch = (radius_ / norm(corner)) * corner;
  const auto at = [&](std::size_t k) -> const Point& { return corners_[(farthest_ + k) % n]; };

  std::size_t k = 2;  // the line leaves the polygon on the edge from corner k − 1 to corner k, counted from the farthest
  while (k < n && cross(corner, at(k)) > 0) ++k;
  const double before = cross(corner, at(k - 1));
  const double after = cross(corner, at(k));
  const Point opposite = before > after ? at(k - 1) + before / (before - after) * (at(k) - at(k - 1)) : at(k - 1);

  points_.push_back(touch);
  for (std::size_t i = 0; i < k; ++i) points_.push_back(at(i));
  points_.push_back(opposite);
  points_.push_back(-touch);
  add_run(0, kPi);
  const std::size_t begin = points_.size();
  points_.push_back(-touch);
  points_.push_back(opposite);
  for (std::size_t i = k; i <= n; ++i) points_.push_back(at(i));
  points_.push_back(touch);
  add_run(begin, kPi);
}

/// Angle of the arc from the first to the last point of the run that ends at points_.back(), in [0, 2π].
double FragmentGap::run_angle(std::size_t begin) const {
  const Point& start = points_[begin];
  const Point& end = points_.back();
  const double turned = cross(start, end - start);
  const double along = dot(start, end);
  // Next to 0 and 2π the two ends cannot tell which it is. The run winds around the centre as the arc does, edge by edge at
  // most half a turn.
  constexpr double kAmbiguous = 1e-6;
  if (along > 0 && std::abs(turned) < kAmbiguous * disk_) {
    double sum = 0;
    for (std::size_t k = begin; k + 1 < points_.size(); ++k) {
      sum += portable_arc_tangent(cross(points_[k], points_[k + 1]), dot(points_[k], points_[k + 1]));
    }
    return std::max(0.0, sum);
  }
  const double angle = portable_arc_tangent(turned, along);
  return angle < 0 ? angle + 2 * kPi : angle;
}

/// Area of the run from points_[begin] to the last point: the convex polygon of its points minus the circular segment. Of the
/// polygon around an arc the segment is at most the share 1 − 1/(2m²), m the number of corners (see cover_run): nothing
/// cancels, however small the gap.
void FragmentGap::add_run(std::size_t begin, double angle) {
  const std::size_t end = points_.size();
  const Point& origin = points_[begin + 1];  // a corner: near all of a tiny gap
  double twice_area = cross(points_[end - 1] - origin, points_[begin] - origin);
  double reach = 0;
  for (std::size_t k = begin + 1; k < end; ++k) {
    if (k + 1 < end) twice_area += cross(points_[k] - origin, points_[k + 1] - origin);
    reach = std::max(reach, norm(points_[k]));
  }
  double area = 0.5 * (twice_area - disk_ * angle_minus_sine(angle));
  // Thinner than rounding: as if it were one rounding error wide.
  const double length = reach - radius_;
  if (!(area > 0)) area = std::max(0x1p-52 * length * length, 0x1p-100);
  runs_.push_back({begin, end, angle, area});
}

std::size_t FragmentGap::num_primitives() {
  if (!has_primitives_) build_primitives();
  return triangles_.size();
}

std::array<Vec3, 3> FragmentGap::primitive(std::size_t i) {
  AMPS_ASSERT(i < num_primitives());
  const Triangle& t = triangles_[i];
  return {to_space(t.a), to_space(t.b), to_space(t.c)};
}

double FragmentGap::primitives_area() { return num_primitives() == 0 ? 0.0 : triangles_.back().area_up_to * scale_ * scale_; }

void FragmentGap::build_primitives() {
  has_primitives_ = true;
  for (const Run& run : runs_) cover_run(run);
}

/// Covers the gap between a run and its arc of angle θ by the polygon between the run and n equal chords of the arc, cut into
/// convex pieces by the tangents where two chords meet. It takes in n circular segments, of at most R²θ³/(12n²) together, and
/// this must not exceed the area G of the gap. A run of m corners around an arc leaves at least the area that m pairs of
/// tangents do, G ≥ R²·m·(tan(θ/2m) − θ/2m) ≥ R²θ³/(24m²), so n = √2·m chords are always enough.
void FragmentGap::cover_run(const Run& run) {
  const Point* points = points_.data() + run.begin;
  const std::size_t size = run.end - run.begin;
  if (0.5 * disk_ * angle_minus_sine(run.angle) <= run.area) return add_fan(points, size);

  const double cube = run.angle * run.angle * run.angle;
  const double enough = 2.0 * static_cast<double>(size - 2);
  const double wanted = std::ceil(std::sqrt(disk_ * cube / (12.0 * run.area)));
  const int chords = static_cast<int>(std::max(2.0, std::min(wanted, enough)));
  const double step = run.angle / chords;
  const auto [sine, cosine] = portable_sine_cosine(step);
  work_.assign(points, points + size);
  std::size_t begin = 0;
  Point touch = points[0];
  for (int i = 1; i < chords; ++i) {
    touch = {cosine * touch.x - sine * touch.y, sine * touch.x + cosine * touch.y};
    begin = cut_by_tangent(begin, touch);
  }
  add_fan(work_.data() + begin, work_.size() - begin);
}

/// work_[begin, …) is a convex polygon whose first and last point lie on the circle. Adds what lies beyond the tangent at
/// `touch`, and what lies on its near side between the first point and `touch`. Leaves the rest, which starts with `touch`.
std::size_t FragmentGap::cut_by_tangent(std::size_t begin, const Point& touch) {
  const auto beyond = [&](std::size_t k) { return dot(work_[k], touch) - disk_; };
  if (begin + 2 >= work_.size()) return begin;  // rounding has used the run up
  std::size_t top = begin + 1;
  for (std::size_t k = begin + 2; k + 1 < work_.size(); ++k) {
    if (beyond(k) > beyond(top)) top = k;
  }
  const Point first = work_[begin];
  if (!(beyond(top) > 0)) {  // an edge lies on the tangent: split it there
    const std::size_t last = cross(touch, work_[top]) < 0 ? top : top - 1;
    add_fan(work_.data() + begin, last - begin + 1);
    add_triangle(first, work_[last], touch);
    work_[last] = touch;
    return last;
  }

  std::size_t low = top;  // [low, high]: what is beyond; contiguous, as the polygon is convex
  std::size_t high = top;
  while (low > begin + 1 && beyond(low - 1) > 0) --low;
  while (high + 2 < work_.size() && beyond(high + 1) > 0) ++high;
  const auto on_tangent = [&](std::size_t near, std::size_t far) {
    const double near_side = std::min(0.0, beyond(near));
    return work_[near] + near_side / (near_side - beyond(far)) * (work_[far] - work_[near]);
  };
  const Point left = on_tangent(low - 1, low);
  const Point right = on_tangent(high + 1, high);
  for (std::size_t k = low; k < high; ++k) add_triangle(left, work_[k], work_[k + 1]);
  add_triangle(left, work_[high], right);
  add_fan(work_.data() + begin, low - begin);
  add_triangle(first, work_[low - 1], left);
  add_triangle(first, left, touch);
  work_[high] = right;
  work_[high - 1] = touch;
  return high - 1;
}

void FragmentGap::add_fan(const Point* points, std::size_t size) {
  for (std::size_t k = 1; k + 1 < size; ++k) add_triangle(points[0], points[k], points[k + 1]);
}

void FragmentGap::add_triangle(const Point& a, const Point& b, const Point& c) {
  const double area = 0.5 * cross(b - a, c - a);
  if (!(area > 0)) return;
  triangles_.push_back({a, b, c, area + (triangles_.empty() ? 0.0 : triangles_.back().area_up_to)});
}

Vec3 FragmentGap::sample(Rng& rng) {
  AMPS_ASSERT(area_ > 0);
  if (num_primitives() > 0) {
    const double total = triangles_.back().area_up_to;
    const auto starts_above = [](double value, const Triangle& t) { return value < t.area_up_to; };
    for (int dart = 0; dart < kGapSampleTries; ++dart) {
      auto t = std::upper_bound(triangles_.begin(), triangles_.end(), rng.uniform() * total, starts_above);
      if (t == triangles_.end()) --t;
      const Vec3 weights = uniform_barycentric(rng);
      const Vec3 x = to_space(weights[0] * t->a + weights[1] * t->b + weights[2] * t->c);
      if (side_of_ball(x.data(), ball_.centre.data(), ball_.weight) >= 0) return x;
    }
  }
  return farthest_corner_;
}

}  // namespace amps::detail
