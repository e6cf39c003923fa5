// curve_proximity.h (internal): how far a point of a curve or a corner is from other curves, where that bounds its disk: from
// those of a patch that the point lies on, at the distance at which a flood from the point gets to them.
#pragma once

#include "amps/base.h"
#include "amps/box_tree.h"
#include "amps/curves.h"
#include "amps/execution.h"
#include "amps/reach.h"

#include <array>
#include <limits>
#include <vector>

namespace amps::detail {

/// What bounds the radius at a point because of other curves; infinite: nothing does.
struct Clearance {
  double of_others = std::numeric_limits<double>::infinity();
  /// Of curves that share the corner at the point's curve's first end, and at its last: bounds outside of the corner's disk.
  std::array<double, 2> of_wedge = {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
};

/// The edges of curves, by the patches that have them.
class CurveProximity {
 public:
  /// Keeps references to the graph and to the flood, which is cut at its curves.
  CurveProximity(const CurveGraph& graph, const SurfaceFlood& flood, const Execution& run);

  /// At a point of a curve; `bound`: what is not below it does not count.
  Clearance of_curve(Index curve, double s, const PlacedPoint& at, double bound);
  /// At a corner; the beginnings of its own curves do not count.
  double of_corner(Index corner, const PlacedPoint& at, double bound);

 private:
  struct Segment {
    Index curve, piece;
  };
  struct Candidate {
    double distance;
    Segment segment;
    Vec3 point;
    int wedge;  ///< kPlain, or the end of the point's curve
  };
  static constexpr int kPlain = -1, kDoesNotCount = -2;

  Vec3 end(const Segment& segment, int k) const {
    return flood_.position(graph_.curves[slot(segment.curve)].vertices[slot(segment.piece + k)]);
  }
  int kind_of(Index curve, double s, const Vec3& x, const Segment& segment, double parameter, double distance) const;
  bool is_far_along(Index curve, double s, double parameter, double distance) const;
  template <class Kind>
  void collect(const PlacedPoint& at, double bound, const Kind& kind);
  Clearance reached(const PlacedPoint& at, double bound);

  const CurveGraph& graph_;
  const SurfaceFlood& flood_;
  std::vector<std::vector<Segment>> segments_;  ///< by patch
  std::vector<BoxTree> trees_;                  ///< by patch
  SurfaceFlood::Scratch scratch_;
  std::vector<Candidate> candidates_;
  std::vector<Index> facets_, patches_;
};

}  // namespace amps::detail
