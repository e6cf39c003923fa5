// curve_sampling.h (internal): disks on corners and along curves, before any are placed on faces. Neighbours on a curve are so
// near that the curve's edge between them is in the dual, whatever samples are added elsewhere (protection), and no farther
// apart than the max rule wants. Why that is so is said at chord_is_kept().
//
// The radius along a curve, R(s), is the least of the wanted radius there; of the distance to other curves of a patch at which
// the curve lies, where a flood that is cut at curves gets to them; of the radius of each of its corners plus kCurveGradation
// times the way to it. What cannot be spaced with R is lowered until it can: short curves as a whole with their corners, long
// ones where it fails.
//
// Acute corners. Where two curves leave a corner at less than some 53°, each one's radius is bounded by its distance to the
// other one; not within the disk of the corner, which keeps its radius: samples on either curve begin just outside of it.
#pragma once

#include "amps/base.h"
#include "amps/cap_field.h"
#include "amps/curve_spacing.h"
#include "amps/curves.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/mesh_edges.h"
#include "amps/reach.h"
#include "amps/samples.h"
#include "amps/wanted_radii.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace amps::detail {

/// How fast the radii of faces grow with the distance from a lowered sample of a curve.
inline constexpr double kCapGradation = 0.2;

/// A sample on a corner or a curve.
struct CurveSample {
  Sample sample;                          ///< barycentrics are 0 exactly where the point is on an edge or at a vertex
  Index curve = kNone;                    ///< kNone: on a corner
  Index corner = kNone;                   ///< kNone: on a curve
  double parameter = 0;                   ///< length along the curve from its start; 0 on a corner
  std::size_t edge = MeshEdges::kNoEdge;  ///< of SurfaceEdges; kNoEdge: at a vertex
  Index vertex = kNone;                   ///< of the surface; kNone: inside an edge
  bool tip = false;                       ///< on one of CurveSamplingOptions::tips: its radius does not fall
};

/// The facets that it lies in, ascending.
std::vector<Index> homes_of(const SurfaceFlood& flood, const CurveSample& sample);

struct CurveSamplingReport {
  Index corners = 0;            ///< samples on corners
  Index lowered = 0;            ///< samples whose radius is below the wanted one
  std::vector<Index> unspaced;  ///< curves with a chord that is not protected, ascending: the dual may lack their edges
  Index forced = 0;             ///< samples lowered to the distance of another one at last, where curves all but coincide
  Index unproved_chords = 0;    ///< chords of curved pieces beyond the bound that always sufficed: for the certificate to see
  double worst_sagitta = 0;     ///< the farthest that a curve is from its chords, absolute units
  std::uint64_t placings = 0;   ///< how often a curve was sampled, or was tried with a lower radius
  Index rounds = 0;             ///< of looking for conflicts
};

/// Samples on corners come first, by number; then those on curves, curve by curve along each.
struct CurveSamples {
  std::vector<CurveSample> samples;
  /// Pairs of neighbours along curves, which the dual has to keep: curve by curve, along each, from its start. A closed curve
  /// ends with the pair of its last and first sample.
  std::vector<std::array<Index, 2>> edges;
  std::vector<std::size_t> first_edge;  ///< of each curve, in `edges`, and the end
  CapField caps{{}, kCapGradation};     ///< around the lowered samples: what the radii of faces have to stay below
  CurveSamplingReport report;
};

struct CurveSamplingOptions {
  std::uint64_t seed = 1;
  /// Radii wanted to stay below this field as well as the wanted one; null: no such field.
  const CapField* limits = nullptr;
  /// Corners whose radii they do not bound, by vertex of the surface, ascending; null: none.
  const std::vector<Index>* tips = nullptr;
  /// More samples than about these are refused, before they take memory: some 500 bytes each on the way. What is far more is so
  /// before any is made, from the radii at a few places of each curve.
  double max_samples = 1e6;
  Execution execution;
};

/// Laws, for the samples p, q of the result, by their radii and weights r² as doubles give them:
///   1. Every corner has a sample. |p − q|² ≥ max(r_p², r_q²) where one's disk reaches the other (flood; exact), and for
///      neighbours along a curve in any case.
///   2. Neighbours: |p − q|² < r_p² + r_q², but on curves of report.unspaced.
///   3. Radii are not above the wanted ones. Where none is forced and one radius is wanted, they grow along a curve by no more
///      than kCurveGradation.
///   4. Closed curves and curves from a corner to itself have three pieces, curves that share both corners two.
///   5. A curve's random numbers depend on the seed, its number and how often it was tried: one that nothing lowers, and that
///      has no conflicts, has the same samples in another call with the same radii along it, whatever becomes of others.
/// `flood` is cut at the curves, and `graph` is that of its surface. Throws Error(kInvalidArgument) for the min rule, which
/// keeps no curves, and for corners on no facet; Error(kTooLarge) where curves are too long for their radii (needles).
/// O(n log n) for n samples and edges of curves, some 5 µs each; more where a disk holds many facets and a curve is near.
CurveSamples sample_curves(const MeshView& mesh, const CurveGraph& graph, const SurfaceFlood& flood, const WantedRadii& wanted,
                           const CurveSamplingOptions& options);

/// Protection of the edge of a straight piece of a curve between two neighbours at this squared distance: p and q own all of it
/// in the diagram of any samples whose disks keep off both. For a site x, g(y) = pow_x(y) − pow_p(y) is affine along pq,
/// g(p) ≥ w_p and g(q) ≥ w_p − d², so at the radical point, t = (d² + w_p − w_q)/2d, it is at least
/// w_p − t·d = (w_p + w_q − d²)/2.
inline bool chord_is_kept(double weight_p, double weight_q, double squared_distance) {
  return squared_distance < weight_p + weight_q;
}

}  // namespace amps::detail
