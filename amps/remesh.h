// remesh.h: from a maximal Poisson-disk set to a triangle mesh — the restricted regular triangulation (RRT), dual of the
// restricted power diagram — and the one-call pipeline.
//
// With a uniform radius r and a maximal set, every RRT triangle has its dual point on the surface within r of its three
// corners, which are at least r apart: all angles lie in [30°, 120°] and all edges in [r, 2r], on any surface; and nothing
// opens in the dual of a closed surface (restricted_triangulation()). Optimisation (optimize.h), on by default, narrows the
// angles to [35°, 105°] or as far as asked for, and valences to 5, 6 and 7.
//
// Where the shape asks for smaller disks, at corners narrower than 30°, between curves nearer than r, at folds tighter than r,
// angles follow from the shape: the bounds are those of triangles whose corners have the full radius.
//
// By default disks know the surface they lie on, and curves of the input (curves.h) are kept: samples are placed on corners and
// curves first, so close that the edge between neighbours is in the dual, and no disk reaches across a curve.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/curves.h"
#include "amps/execution.h"
#include "amps/fit.h"
#include "amps/maximality.h"
#include "amps/mesh.h"
#include "amps/optimize.h"
#include "amps/quality.h"
#include "amps/sampling.h"
#include "amps/self_intersections.h"
#include "amps/topology_certificate.h"

#include <array>
#include <cstdint>
#include <iosfwd>
#include <memory>
#include <string>
#include <vector>

namespace amps {

/// What is done where the result would have another topology than the surface: parts thinner than r, folds, small components.
enum class Topology {
  kPreserve,  ///< radii fall there, until the certificate holds or they are down to a thousandth
  kReport,    ///< nothing
};

struct RemeshOptions {
  /// With optimisation a target_count is that of the result, met within about 2 %, or exactly if exact_count is set: then
  /// triangles and valences stay as good as optimisation has made them, if they can. `sampling.execution` is that of the whole.
  /// Where disks know their surface, a radius beyond the box's diagonal counts as that: either way one disk is all of a
  /// component.
  SamplingOptions sampling;
  /// Curves of the input that the result keeps, where disks know their surface (sampling.neighborhood, by default). The radius
  /// is that of `sampling`, unless one is given.
  CurveOptions curves;
  /// The result is to be within this Hausdorff distance of the surface, in both directions: absolute units; 0: any. Radius,
  /// sizing or target_count of `sampling` are then upper bounds (a target_count is met if it can be) and may be left out: radii
  /// follow from curvature, up to a quarter of the diagonal. Where the result is farther off they fall and all is done again, a
  /// few times. The distance is that of the final mesh, after optimisation and fit; without enough of either, kErrorMissed.
  double max_error = 0;
  /// The samples of `sampling.target_count`, which must be given, are spent where they lower that distance most: radii follow
  /// from curvature unless there is a sizing, and as long as that helps, they fall where the result is farthest off and grow
  /// elsewhere. The distance is reported as of max_error. Takes some thirty times as long as one run.
  bool least_error = false;
  /// Means nothing where disks are balls.
  Topology topology = Topology::kPreserve;
  /// Improve angles and valences of the maximal set.
  bool optimize = true;
  /// How. Sizing, radius, conflict rule, seed and execution are those of `sampling`.
  OptimizeOptions optimization;
  /// Vertices of the mesh leave the surface so that its triangles lie closer to it (fit.h); the samples stay, with all that is
  /// proved of them. Bounds of angles that were reached stay, and edges within what they were.
  Fit fit = Fit::kOff;
};

/// What was kept of the curves of the input.
struct CurveReport {
  Index curves = 0, corners = 0, patches = 0;  ///< of the input
  Index samples = 0;                           ///< vertices on corners and curves: the first ones of the result
  Index edges = 0;                             ///< pairs of neighbours along curves
  Index edges_kept = 0;  ///< of these, edges of the result of as many triangles as the curve has facets; mostly all
  double length = 0;     ///< of all curves, absolute units
  double deviation = 0;  ///< the farthest that a curve is from the edges of its samples, absolute units
  std::array<Index, kNumCurveKinds> curves_of{};  ///< by kind
  Index forced_triangles = 0;  ///< of three vertices on curves, with an angle out of the bounds: what curves leave no choice in
  QualityReport beside;        ///< of the triangles with a vertex on a curve
  QualityReport away;          ///< of the others
};

struct RemeshReport {
  SamplingReport sampling;      ///< of the set before optimisation
  OptimizeReport optimization;  ///< no iterations if there was none
  /// Where SamplingOptions::exact_count asks for it; then `optimization` is of the set before.
  ExactCountReport exact_count;
  CurveReport curves;
  TopologyReport input;   ///< topology of the input: equal positions one vertex, repeated facets one facet
  TopologyReport output;  ///< topology of the result
  /// Pairs of triangles of the result that cross, touch or overlap (self_intersections.h); and of the input, looked for only if
  /// the result has some.
  std::int64_t self_intersections = 0, input_self_intersections = 0;
  QualityReport quality;        ///< of the result
  FitReport fit;                ///< all 0 if there was none
  MaximalityReport maximality;  ///< certificate of the samples, from the diagram the triangles are dual to
  /// Where it holds, the result has the topology of the surface, curves included: proved, not measured. Of no cells where disks
  /// are balls. (`failures` are of sites of the diagram: of vertices, where nothing was optimised.)
  TopologyCertificate certificate;
  /// Of surface and result: no point is farther off than this, proved by surface_distance(); and some point is as far as the
  /// lower one. Of RemeshOptions::max_error and least_error only, else both 0.
  double hausdorff_bound = 0;
  double hausdorff_lower = 0;
  int further_runs = 0;      ///< with smaller radii, where triangles crossed or the result was farther off than max_error
  double seconds_error = 0;  ///< measuring that distance; all runs
  double seconds_optimize = 0;
  double seconds_remesh = 0;  ///< extraction and orientation of the triangles
  double seconds_report = 0;  ///< topology, quality and certificate
};

struct RemeshResult {
  /// Row i of mesh.vertices is row i of samples.positions or, fitted, where that sample has gone to.
  Mesh mesh;
  SampleSet samples;           ///< facet and barycentric coordinates per output vertex
  std::vector<Index> facets;   ///< by triangle: a facet of the input on which its three cells meet
  std::vector<Index> patches;  ///< by triangle: that facet's patch (CurveGraph::patch_of_facet); all 0 where disks are balls
  /// The curves that samples, patches and edges are of; null where disks are balls.
  std::shared_ptr<const CurveGraph> graph;
  /// Pairs of vertices along the curves that were kept, #E; curve by curve.
  std::vector<std::array<Index, 2>> curve_edges;
  RemeshReport report;
  /// The worst of those of sampling and optimisation, of kShapeChanged (lost_shape()), of kErrorMissed (hausdorff_bound is
  /// above max_error), and of kCountMissed: another number of samples than asked for, by more than 2 % and more than one; or
  /// any other (missed_count()) where it was to be met exactly. Then kStalled and kNotMaximal too say what that has cost.
  Outcome status = Outcome::kDone;
};

/// What the result lacks of the shape of the surface, and what to do, in one line; empty if that is nothing: if the certificate
/// holds, or components, Euler characteristic, boundary loops and edges of many facets are as many as before, all edges of
/// curves are kept, and no triangles cross where none did. (Where disks are balls there is no certificate, and crossings do not
/// count.)
AMPS_EXPORT std::string lost_shape(const RemeshReport& report);

/// Samples the mesh, optimises the samples and returns their dual triangulation. Errors and thread-safety as sample() and
/// optimize(), and kInvalidArgument unless max_error is finite and not negative; cost about twice that of sample(), with the
/// default bounds. Cancelled, it has the best samples so far, a vertex each, and triangles only if the report was all that was
/// left to do; of a maximal set restricted_triangulation() makes them.
AMPS_EXPORT RemeshResult remesh(const MeshView& mesh, const RemeshOptions& options);

/// The RRT of a given set: a triangle (i, j, k) for each triple of cells that meet an odd number of times inside facets; where
/// they meet twice, as on both sides of a sharp crease or of a thin plate, the two triangles cancel. So where every edge of the
/// input has evenly many facets (equal positions being one vertex, and facets that are there twice one facet), every edge of
/// the result has evenly many triangles, for any set: the dual of a closed surface has no boundary. Oriented as the surface
/// under it, then made consistent across manifold edges, component by component: wherever the output is orientable, inputs with
/// flipped facets come out right. The majority says which way; but of a component that is closed, over facets of the input that
/// disagree with each other across edges of two, the volume is positive, whatever the majority. remesh() orients likewise.
/// Cancelled, it throws Error(kCancelled). `curves`: as verify_maximal().
AMPS_EXPORT Mesh restricted_triangulation(const MeshView& mesh, const SampleSet& samples, const Execution& execution = {},
                                          Neighborhood neighborhood = Neighborhood::kSpace, const CurveGraph* curves = nullptr);

}  // namespace amps

#include "amps/host_macros_end.h"
