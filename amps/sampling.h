// sampling.h: maximal Poisson-disk sets on a surface — dart throwing, then gap filling. (The certificate: maximality.h.)
//
// Yan & Wonka, "Adaptive maximal Poisson-disk sampling on surfaces", SIGGRAPH Asia 2012 Technical Briefs; "Gap processing for
// adaptive maximal Poisson-disk sampling", ACM TOG 32(5), 2013. A set of disks (p_i, r_i), p_i on the surface, is
//   * Poisson-disk:  |p_i − p_j| ≥ max(r_i, r_j) for i ≠ j (Euclidean distance in space),
//   * maximal:       every point of the surface lies in some ball (p_i, r_i).
// Radii are equal, or follow a sizing field r(p): then darts fall with density ρ = 1/r², and r_i is r(p_i), or less where
// r(p_i) would cover a sample that is there already: such a dart of the second stage takes its distance to the nearest sample,
// as in the paper. So r_min ≤ r_i ≤ r(p_i), samples are at least r_min apart, and filling ends.
//
// Scale. Coordinates of any magnitude behave as those at 1: the bits at 2^k times the scale are those at 1, scaled (but for
// results below the least normal double, which are rounded, areas that are no doubles, and coordinates that are less than
// 2^-1074 of the largest: they count as 0). That is so in all of amps that computes with lengths of a mesh.
//
// Far from the origin. The resolution of coordinates is 2^-52 of the largest of them: positions are rounded to it, and what is
// promised is of the rounded ones. While radii are above 1024 resolutions (that is up to 10^12 r from the origin), all of it
// holds. Below that, distances are off by a resolution, gaps may hold no double (SamplingReport::unfilled_gaps); radii below 64
// resolutions are refused.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/cap_field.h"
#include "amps/curves.h"
#include "amps/exact_count.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"
#include "amps/samples.h"
#include "amps/sizing.h"

#include <cstdint>
#include <memory>
#include <vector>

namespace amps {

/// Exactly one of: `radius`; `target_count`; `sizing`; `sizing` and `target_count`.
struct SamplingOptions {
  /// Disk radius, absolute units; > 0 if used.
  double radius = 0;
  /// Wanted radii over this mesh, absolute units (sizing.h); empty if not used.
  SizingField sizing;
  /// Wanted number of samples. The radius, or a factor on all of `sizing`, follows from n ≈ 0.70·∫dA/r² + 0.26·∫ds/r (along the
  /// boundary) and is corrected, by further runs with other seeds, until the count is within 1 %. The closest run wins if that
  /// never happens (counts below 100 have no choice but to hit exactly).
  Index target_count = 0;
  /// With target_count: that number and no other. The set that comes nearest is edited here and there, as exact_count.h tells;
  /// SamplingReport::exact_count says what that took, and what coverage is left. For all but small or narrow surfaces it is
  /// maximal as ever; where it is not, the status is kNotMaximal, and where the number cannot be met, kCountMissed.
  bool exact_count = false;
  /// Means nothing where radii are equal.
  ConflictRule conflict_rule = ConflictRule::kMax;
  /// Default: kSpace; in remesh() kSurface, but for the min rule.
  Neighborhood neighborhood = Neighborhood::kDefault;
  /// Same seed, mesh and options: the same bits, on any platform and any number of threads. One seed at two radii, which
  /// differ by a millionth and more, makes two sets that have nothing to do with each other.
  std::uint64_t seed = 1;
  /// Dart throwing ends after this many consecutive rejections (k of the paper); what is left is the gap filler's.
  int max_rejections = 300;
  /// A radius that would need more samples than this is refused before any work; and one that would cut facets which are long
  /// and thin beside it (needles) into more than four times this and the number of facets. Sampling takes about 1 KB of memory
  /// a sample and 0.2 KB a piece: the default stands for 20 GB. At most 5e7 (32-bit names of cells).
  Index max_samples = 20'000'000;
  /// Threads, progress and cancelling. The result does not depend on the threads, which share what splits by facet.
  Execution execution;
};

struct SamplingReport {
  double radius = 0;  ///< the one wanted for all new samples, differs from the option with target_count; 0 if there is none,
                      ///< which is where radii of `sizing` differ (a field that is the same everywhere is one radius)
  double sizing_scale = 1;  ///< factor on `sizing` (differs from 1 with target_count)
  double min_radius = 0;    ///< of all samples, as the next two; 0 if there is none
  double max_radius = 0;
  double mean_radius = 0;
  std::uint64_t seed = 0;   ///< the one used: with radius or scale it reproduces the set (differs with target_count)
  std::uint64_t darts = 0;  ///< thrown in the first stage
  Index curve_samples = 0;  ///< samples on corners and curves; they come first
  Index dart_samples = 0;   ///< samples of dart throwing
  Index gap_samples = 0;    ///< samples added by gap filling
  Index unfilled_gaps = 0;  ///< gaps that hold no double at the wanted distance: 0 but where radii are below 1024 resolutions
  int refinements = 0;      ///< rounds with smaller radii, where the topology was not that of the surface
  int attempts = 1;         ///< sampling runs made to reach target_count
  ExactCountReport exact_count;  ///< of sample(): its new samples count as those of gaps
  double seconds_darts = 0;      ///< wall clock, all attempts; as the next three
  double seconds_triangulation = 0;
  double seconds_diagram = 0;
  double seconds_gaps = 0;
  double seconds_topology = 0;  ///< the certificate of the topology, and rounds with smaller radii
};

struct SamplingResult {
  SampleSet samples;
  SamplingReport report;
  /// Of sample(), kCountMissed: another number of samples than asked for, by more than 2 % and more than one.
  Outcome status = Outcome::kDone;
};

/// A maximal Poisson-disk set: dart throwing, then gap filling until no gap is left. The samples of the first stage come first,
/// in the order of a space-filling curve (what is near in space is near in memory, for us and for whoever takes the set); those
/// of the second follow in the order of their insertion.
/// Throws Error: kInvalidMesh (see require_usable), kInvalidArgument (options, a sizing field of another mesh), kTooLarge
/// (radii that would need more than max_samples, estimated facet by facet before any work). Cancelled: the samples so far
/// (Poisson-disk, not maximal), or those of an earlier run for target_count (maximal, of another number). Expected O(n log n +
/// #F). Thread-safe.
AMPS_EXPORT SamplingResult sample(const MeshView& mesh, const SamplingOptions& options);

/// The first stage alone: random darts of density 1/r², accepted when they conflict with none before, until max_rejections in a
/// row fail. Poisson-disk, not maximal; samples in the order they were accepted. Needs `radius` or `sizing`, no target_count.
AMPS_EXPORT SamplingResult throw_darts(const MeshView& mesh, const SamplingOptions& options);

/// The second stage alone, for a set made elsewhere: adds samples where the surface is uncovered until nothing is. Existing
/// samples stay first, unchanged and in order; those that are closer than they should be stay so. The radius of new samples is
/// the option's (0: the smallest in `existing`) and must not exceed the smallest in `existing`, so that no new disk covers an
/// old sample; or, over a surface and with `sizing`, what is wanted, less where it would cover a sample. Samples of `existing`
/// without facet and barycentrics get facet kNone and zeros in the result. Errors as sample() and verify_maximal().
AMPS_EXPORT SamplingResult fill_gaps(const MeshView& mesh, const SampleSet& existing, const SamplingOptions& options);

namespace detail {

/// How many samples these options make, roughly; 0 where they are not usable. For foreseeing time only. O(#F).
double expected_samples(const MeshView& mesh, const SamplingOptions& options);
/// Options in units of `scale`, which is that of the mesh; reports back from there.
SamplingOptions scaled_options(const SamplingOptions& options, const MeshScale& scale);
void scale_back(SamplingReport& report, const MeshScale& scale);

/// Microseconds that sample() takes for so many samples, roughly, on `workers` threads.
double sampling_cost(double samples, double facets, unsigned workers);

class DiskSet;
class SurfaceFlood;
class TopologyChecker;
struct CurveSamples;

/// The surface that disks know, and the curves that are kept on it. By default disks are balls.
struct SamplingSurface {
  std::shared_ptr<const SurfaceFlood> flood;        ///< cut at the curves; null: balls
  std::shared_ptr<const CurveGraph> curves;         ///< null: disks are balls
  std::shared_ptr<const TopologyChecker> topology;  ///< null: nobody asks
  double area = 0;                                  ///< of the surface; 0 where disks are balls
  std::vector<RadiusCap> limits;                    ///< bounds of radii to begin with, for other reasons
  std::vector<FaceSample> kept;  ///< samples to begin with, where they are small enough; none: darts are thrown
  std::vector<Index> tips;       ///< sharp corners whose radii stay, by vertex of the surface, ascending
  bool preserve = false;         ///< radii fall where the dual has not the topology of the surface
  bool may_change = false;  ///< where that does not help, there will be other curves: the number of samples does not matter yet
  bool result_only = false;  ///< of the run nothing but its result is wanted
};

/// sample(), and what it ended with (null if it was cancelled): the diagram and, where disks know their surface, these.
struct SamplingRun {
  SamplingResult result;
  std::shared_ptr<DiskSet> disks;
  std::shared_ptr<const CurveSamples> curves;  ///< of which the set's first samples are; null: there are no curves
  std::shared_ptr<const CapField> caps;        ///< bounds of wanted radii, beside curves; null: none
  /// Facets where the dual has not the topology of the surface, and so many samples more would not help; ascending. Empty if
  /// nobody asked.
  std::vector<Index> changed_facets;
  /// Radii fell no further, since samples became too many or disks too small: the diagram need not be that of `result`.
  bool gave_up = false;
  std::unique_ptr<RestrictedPowerDiagram> diagram;
};
SamplingRun sample_with_diagram(const MeshView& mesh, const SamplingOptions& options, const SamplingSurface& surface = {});

/// Is a count off by more than 2 %, and by more than one, or at all if it is to be exact? `target_count` 0: any will do.
bool misses_count(Index count, const SamplingOptions& asked);

}  // namespace detail

}  // namespace amps

#include "amps/host_macros_end.h"
