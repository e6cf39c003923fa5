// gaps.h (internal): the part of one fragment of the restricted power diagram that its own ball leaves uncovered — whether
// there is any, its exact area, triangles that cover it tightly (the gap primitives), and uniform points in it.
//
// Yan & Wonka, "Gap Processing for Adaptive Maximal Poisson-disk Sampling", ACM TOG 32(5), 2013, §4. Where we differ: the
// paper takes the gap as polygons with arcs cut off at tangents by cases; here a gap is a few *runs* (stretches of the
// polygon's boundary outside of the disk, each closed by one arc), the area is summed per run so that nothing cancels in tiny
// gaps, and each arc gets as many tangents as a bound asks for, so that rejection sampling accepts with probability ≥ 1/2
// whatever the shape.
#pragma once

#include "amps/base.h"
#include "amps/power_diagram.h"
#include "amps/samples.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace amps::detail {

/// A ball as the power diagram knows it: weight = squared radius, > 0.
struct Ball {
  Vec3 centre = Vec3::Zero();
  double weight = 0;
};

/// View of a convex planar polygon, `size` ≥ 3 corners counter-clockwise around the unit `normal`, planar and convex up to
/// rounding. Corners may coincide and the polygon may have no area.
struct FragmentView {
  const Vec3* corners = nullptr;
  std::size_t size = 0;
  Vec3 normal = Vec3::UnitZ();
};

/// The gap of one fragment at a time, in buffers that are kept from one to the next: no heap allocation in steady state.
/// One object per thread.
class FragmentGap {
 public:
  /// Finds the gap of `fragment` and returns its area (absolute units), 0 exactly where no corner is `uncovered` (one entry
  /// each): whether there is a gap has been decided, and rounding here has no say in it. The area is that of the polygon minus
  /// the disk in closed form. A gap thinner than rounding gets a tiny positive area in place of a zero, so that choosing by
  /// area can still reach it. Nothing of the arguments is referenced afterwards. O(size).
  double assign(const FragmentView& fragment, const Ball& ball, const std::vector<char>& uncovered);

  /// The gap that the diagram's own, exact decisions leave in a fragment: 0 iff it is covered.
  double assign(const RestrictedPowerDiagram& diagram, const RestrictedPowerDiagram::Polygon& polygon);

  double area() const { return area_ * scale_ * scale_; }

  /// Points whose convex hull holds the gap, up to rounding: all ends of its edges. None without a gap.
  std::size_t num_corners() const { return points_.size(); }
  Vec3 corner(std::size_t i) const { return to_space(points_[i]); }

  /// Triangles in the plane of the fragment that cover the gap, with disjoint interiors, inside of the fragment, of at most
  /// twice the area of the gap (up to rounding). Empty if there is no gap, or one without area. Built when first asked for.
  std::size_t num_primitives();
  std::array<Vec3, 3> primitive(std::size_t i);
  double primitives_area();

  /// A uniformly distributed point of the gap; requires a gap. It lies in the plane of the fragment up to rounding, and
  /// exactly (not only up to rounding) outside of the open ball. Rejection in the primitives, ≥ 1/2 accepted; should 64
  /// darts fail, which only a gap too thin for doubles can bring about, it is the uncovered corner farthest from the ball, as
  /// rounded.
  Vec3 sample(Rng& rng);

 private:
  /// In the frame. (Not Eigen::Vector2d, whose alignment depends on flags.)
  struct Point {
    double x = 0, y = 0;
    friend Point operator+(const Point& a, const Point& b) { return {a.x + b.x, a.y + b.y}; }
    friend Point operator-(const Point& a, const Point& b) { return {a.x - b.x, a.y - b.y}; }
    friend Point operator-(const Point& a) { return {-a.x, -a.y}; }
    friend Point operator*(double s, const Point& a) { return {s * a.x, s * a.y}; }
    friend Point operator/(const Point& a, double s) { return {a.x / s, a.y / s}; }
    friend double dot(const Point& a, const Point& b) { return a.x * b.x + a.y * b.y; }
    friend double cross(const Point& a, const Point& b) { return a.x * b.y - a.y * b.x; }
    friend double squared_norm(const Point& a) { return dot(a, a); }
    friend double norm(const Point& a) { return std::sqrt(dot(a, a)); }
  };
  /// A stretch of the polygon's boundary outside of the disk, points_[begin, end). With an arc, the first and last point lie
  /// on the circle and an arc of `angle` > 0 closes it; with angle 0 it is the whole polygon.
  struct Run {
    std::size_t begin, end;
    double angle;
    double area;  ///< of the gap between stretch and arc, > 0
  };
  struct Triangle {
    Point a, b, c;
    double area_up_to;  ///< of this and all triangles before it
  };
  /// How an edge meets the disk, seen from its start: kThrough goes in and comes out again.
  enum class EdgeKind { kInside, kLeaves, kEnters, kOutside, kThrough };

  void clear();
  void set_frame(const FragmentView& fragment, const Ball& ball);
  EdgeKind edge_kind(std::size_t from, std::size_t to) const;
  Point crossing(std::size_t outside, std::size_t other) const;
  void find_runs();
  void add_whole_polygon();
  void add_ring();
  void add_run(std::size_t begin, double angle);
  double run_angle(std::size_t begin) const;

  void build_primitives();
  void cover_run(const Run& run);
  std::size_t cut_by_tangent(std::size_t begin, const Point& touch);
  void add_fan(const Point* points, std::size_t size);
  void add_triangle(const Point& a, const Point& b, const Point& c);
  Vec3 to_space(const Point& x) const { return origin_ + scale_ * (x.x * axis_u_ + x.y * axis_v_); }

  // The frame: coordinates in units of the ball's radius, the disk's centre at the origin.
  Vec3 axis_u_ = Vec3::UnitX(), axis_v_ = Vec3::UnitY();
  Vec3 origin_ = Vec3::Zero();  ///< centre of the disk: the ball's centre projected to the plane
  double scale_ = 1;            ///< the ball's radius
  double disk_ = 0;             ///< squared radius of the disk, in the frame; ≤ 0 if the plane misses the ball
  double radius_ = 0;           ///< its root

  Ball ball_;
  Vec3 farthest_corner_ = Vec3::Zero();  ///< from the ball's centre, of the uncovered ones
  std::size_t farthest_ = 0;             ///< its index
  double area_ = 0;                      ///< in the frame
  bool has_primitives_ = false;
  std::vector<Point> corners_;
  std::vector<double> excess_;             ///< |corner|² − disk_; > 0 iff uncovered
  std::vector<char> uncovered_, decided_;  ///< by corner
  std::vector<Vec3> positions_;            ///< of a diagram's fragment
  std::vector<Point> points_;              ///< of all runs
  std::vector<Run> runs_;
  std::vector<Point> work_;  ///< what is left of a run while tangents cut it up
  std::vector<Triangle> triangles_;
};

}  // namespace amps::detail
