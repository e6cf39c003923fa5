// curve_spacing.h (internal): samples along one curve — the radius along it, places where samples may be, and how many of them,
// so that neighbours are in each other's reach and their chord is kept (curve_sampling.h).
#pragma once

#include "amps/base.h"
#include "amps/cap_field.h"
#include "amps/curves.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/mesh_edges.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <vector>

namespace amps::detail {

/// Of a corner's radius: outside of so much of it, the distance to another curve at the corner bounds the radius. Samples begin
/// outside of all of it; the margin lets the radius come down before.
inline constexpr double kWedgeStart = 0.9;
/// How fast radii grow along a curve, per length. At more than some .2, peaks of R cannot be spaced.
inline constexpr double kCurveGradation = 0.15;
/// Chords are sought within so many radii of way along the curve.
inline constexpr double kLongestWay = 2.5;

/// A point of a curve.
struct CurvePlace {
  SurfacePoint at;
  std::size_t edge = MeshEdges::kNoEdge;  ///< kNoEdge: at a vertex
  Index vertex = kNone;
};

/// The corner of a facet at a vertex, as a point of it.
SurfacePoint corner_point(const MeshView& mesh, const SurfaceEdges& edges, Index facet, Index vertex);

CurvePlace place_on_curve(const MeshView& mesh, const SurfaceEdges& edges, const Curve& curve, double s);

/// What the radius at a curve's two ends is, and the most that it may be between.
struct CurveRadii {
  static constexpr double kNoRadius = std::numeric_limits<double>::infinity();
  std::array<double, 2> ends = {kNoRadius, kNoRadius};  ///< infinite: a closed curve
  double most = kNoRadius;
};

/// R along a curve, linear between nodes.
class RadiusTable {
 public:
  struct Node {
    double s;
    double bound;                     ///< whatever the corners' radii are
    std::array<double, 2> of_wedge;   ///< bounds outside of the disks of the corners at the ends
    std::array<double, 2> to_corner;  ///< distances to the corners
    double radius = 0;
  };

  void add(const Node& node) { nodes_.push_back(node); }
  bool empty() const { return nodes_.empty(); }
  void clear() { nodes_.clear(); }
  const std::vector<Node>& nodes() const { return nodes_; }

  /// R at s is at most `radius` from now on.
  void lower(double s, double radius);
  /// R, for a curve whose ends have these radii. O(nodes).
  void update(const CurveRadii& radii, bool closed);
  double at(double s) const;
  double max() const;
  /// ∫ds/R.
  double integral() const;
  /// The n − 1 places that cut the curve into n parts of equal ∫ds/R; fewer where rounding makes two of them one.
  std::vector<double> cuts(int n) const;

 private:
  std::size_t interval(double s) const {
    const auto after =
        std::upper_bound(nodes_.begin() + 1, nodes_.end() - 1, s, [](double x, const Node& node) { return x < node.s; });
    return static_cast<std::size_t>(after - nodes_.begin()) - 1;
  }
  double integral(std::size_t k) const {  // of an interval
    return (nodes_[k + 1].s - nodes_[k].s) * 0.5 * (1 / nodes_[k].radius + 1 / nodes_[k + 1].radius);
  }
  static double between(double a, double b, double t) {  // both may be infinite
    return t <= 0 || a == b ? a : t >= 1 ? b : a + t * (b - a);
  }

  std::vector<Node> nodes_;  ///< ascending; at least two
};

/// A place where a curve may have a sample.
struct CurveStop {
  double s;  ///< on a closed curve beyond its length after the start is passed again
  double radius;
  Vec3 position;
};

/// What one curve is sampled with.
struct CurveTask {
  const MeshView& mesh;
  const SurfaceEdges& edges;
  const Curve& curve;
  const RadiusTable& table;
  const WantedRadii& wanted;
  const CapField* limits;

  double wrapped(double s) const {
    return curve.closed && s > curve.length() ? std::min(s - curve.length(), curve.length()) : s;
  }
  CurvePlace place(double s) const { return place_on_curve(mesh, edges, curve, wrapped(s)); }
  CurveStop stop(double s) const {
    const SurfacePoint at = place(s).at;
    double radius = std::min(table.at(wrapped(s)), wanted.at(at));
    if (limits != nullptr) radius = limits->at(at.position, radius);
    return {s, radius, at.position};
  }
  double sagitta(const CurveStop& p, const CurveStop& q) const;
};

/// Beyond the protection of a straight piece, what always sufficed for a curved one: 4hρ ≤ w_p + w_q − d², h the sagitta, ρ the
/// half-chord at d/2 of a disk of 1.15 times the greater radius.
bool is_surely_kept(const CurveTask& task, const CurveStop& p, const CurveStop& q);

/// What came of an attempt to space a curve.
struct Spacing {
  bool done = false;
  std::vector<CurveStop> samples;  ///< from the start to the end, both included
  double stuck_at = 0;             ///< if not done: no chord leads there from nearer to the start
};

/// Samples from one place to another, in at least so many pieces: each at random among the stops from which the end can be got
/// to. So whatever can be spaced is spaced, in corners' windows, between close corners and over peaks of R alike; adding pieces
/// of equal shares of ∫ds/R, by contrast, fails where none of these does fit.
Spacing space_between(const CurveTask& task, const CurveStop& first, const CurveStop& last, int least_pieces, Rng& rng);

/// The same for a curve of any length: a long one is cut at places that get a sample, so that stops need no more memory than a
/// section has.
Spacing space_by_sections(const CurveTask& task, const CurveStop& first, const CurveStop& last, int least_pieces, Rng& rng,
                          const Execution& run);

}  // namespace amps::detail
