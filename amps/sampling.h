// sampling.h: maximal Poisson-disk sets on a surface — dart throwing, gap filling, and the certificate that a set is maximal.
//
// Yan & Wonka, "Adaptive maximal Poisson-disk sampling on surfaces", SIGGRAPH Asia 2012 Technical Briefs; "Gap processing for
// adaptive maximal Poisson-disk sampling", ACM TOG 32(5), 2013. A set of disks (p_i, r_i), p_i on the surface, is
//   * Poisson-disk:  |p_i − p_j| ≥ max(r_i, r_j) for i ≠ j (Euclidean distance in space),
//   * maximal:       every point of the surface lies in some ball (p_i, r_i).
// Radii are equal, or follow a sizing field r(p): then darts fall with density ρ = 1/r², and r_i is r(p_i), or less where
// r(p_i) would cover a sample that is there already: such a dart of the second stage takes its distance to the nearest sample,
// as in the paper. So r_min ≤ r_i ≤ r(p_i), samples are at least r_min apart, and filling ends.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"
#include "amps/sizing.h"

#include <iosfwd>
#include <memory>
#include <vector>

namespace amps {

/// Disks on a surface. `facets` and `barycentrics` say where on the input mesh each sample lies, so that anything stored per
/// vertex or facet (UVs, colours, weights) can be interpolated; both are empty in a set that came without them (from a file).
struct SampleSet {
  Points positions;           ///< #S by 3
  Eigen::VectorXd radii;      ///< #S, > 0
  std::vector<Index> facets;  ///< #S or empty
  Points barycentrics;        ///< #S by 3 or empty; rows are non-negative and sum to 1 (to rounding)
  Index size() const { return static_cast<Index>(positions.rows()); }
};

/// How far apart two disks of different radii must be (Mitchell, Rand, Ebeida & Bajaj, "Variable radii Poisson-disk sampling",
/// CCCG 2012).
enum class ConflictRule {
  /// |p_i − p_j| ≥ max(r_i, r_j): no disk covers another's centre ("bigger disks"). The rule of the papers above and of
  /// everything this library promises: no sample is ever hidden in the power diagram.
  kMax,
  /// |p_i − p_j| ≥ min(r_i, r_j) ("smaller disks"): small samples come up to large ones, so sets are denser where radii change
  /// (at gradation 0.1, 0.25 and 0.5 by about 1, 4 and 8 % beside kMax). Darts of the second stage keep r(p). Samples of
  /// a field of gradation L (|r(p) − r(q)| ≤ L·|p − q|) own their position in the power diagram if L < √2 − 1: with d ≥ r_j and
  /// r_i ≤ r_j + L·d, r_i² − r_j² ≤ 2L·d·r_j + L²d² ≤ (2L + L²)·d² < d². In steeper fields a small sample may hide behind a
  /// large one: it stays in the set, the surface is still covered, but the mesh dual to the diagram has no vertex there.
  kMin,
};

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
  /// Means nothing where radii are equal.
  ConflictRule conflict_rule = ConflictRule::kMax;
  /// Same seed, mesh and options: the same bits, on any platform and any number of threads.
  std::uint64_t seed = 1;
  /// Dart throwing ends after this many consecutive rejections (k of the paper); what is left is the gap filler's.
  int max_rejections = 300;
  /// A radius that would need more samples than this is refused before any work. Sampling takes about 1 KB of memory a sample:
  /// the default stands for 20 GB. At most 5e7 (32-bit names of cells).
  Index max_samples = 20'000'000;
  /// Threads used where work splits by facet; 0: one per core. The result does not depend on it.
  unsigned threads = 1;
  Progress progress;
};

struct SamplingReport {
  double radius = 0;        ///< the one used (differs from the option with target_count); 0 with `sizing`
  double sizing_scale = 1;  ///< factor on `sizing` (differs from 1 with target_count)
  double min_radius = 0;    ///< of all samples, as the next two; 0 if there is none
  double max_radius = 0;
  double mean_radius = 0;
  std::uint64_t seed = 0;   ///< the one used: with radius or scale it reproduces the set (differs with target_count)
  std::uint64_t darts = 0;  ///< thrown in the first stage
  Index dart_samples = 0;   ///< samples after dart throwing
  Index gap_samples = 0;    ///< samples added by gap filling
  Index unfilled_gaps = 0;  ///< gaps that hold no double at the wanted distance: 0 unless the mesh lies > 1e6·r from the origin
  int attempts = 1;         ///< sampling runs made to reach target_count
  double seconds_darts = 0;  ///< wall clock, all attempts; as the next three
  double seconds_triangulation = 0;
  double seconds_diagram = 0;
  double seconds_gaps = 0;
};

struct SamplingResult {
  SampleSet samples;
  SamplingReport report;
  Status status = Status::kDone;
};

/// A maximal Poisson-disk set: dart throwing, then gap filling until no gap is left. The samples of the first stage come first,
/// in the order of a space-filling curve (what is near in space is near in memory, for us and for whoever takes the set); those
/// of the second follow in the order of their insertion.
/// Throws Error: kInvalidMesh (see require_usable), kInvalidArgument (options, a sizing field of another mesh), kTooLarge
/// (radii that would need more than max_samples, estimated before any work). Cancelled: the samples so far (Poisson-disk, not
/// maximal). Expected O(n log n + #F). Thread-safe.
SamplingResult sample(const MeshView& mesh, const SamplingOptions& options);

/// The first stage alone: random darts of density 1/r², accepted when they conflict with none before, until max_rejections in a
/// row fail. Poisson-disk, not maximal; samples in the order they were accepted. Needs `radius` or `sizing`, no target_count.
SamplingResult throw_darts(const MeshView& mesh, const SamplingOptions& options);

/// The second stage alone, for a set made elsewhere: adds samples where the surface is uncovered until nothing is. Existing
/// samples stay first, unchanged and in order; those that are closer than they should be stay so. The radius of new samples is
/// the option's (0: the smallest in `existing`) and must not exceed the smallest in `existing`, so that no new disk covers an
/// old sample; or that of `sizing`, less where it would cover a sample. Samples of `existing` without facet and barycentrics
/// get facet kNone and zeros in the result. Errors as sample() and verify_maximal().
SamplingResult fill_gaps(const MeshView& mesh, const SampleSet& existing, const SamplingOptions& options);

/// Certificate of a sample set, computed from a fresh restricted power diagram.
struct MaximalityReport {
  double worst_coverage = 0;  ///< max over the surface of (distance to the owner)/r; maximal ⇔ ≤ 1 (+1e-9 rounding)
  double worst_separation = 0;  ///< min over pairs of |p_i − p_j|/max(r_i, r_j); Poisson-disk ⇔ ≥ 1 (−1e-9); +inf: one sample.
                                ///< With ConflictRule::kMin: of |p_i − p_j|/min(r_i, r_j)
  Index gaps = 0;       ///< fragments (restricted cell ∩ facet) that are not covered
  double gap_area = 0;  ///< exact uncovered area, absolute
  bool maximal(double tolerance = 1e-9) const { return worst_coverage <= 1 + tolerance; }
  bool poisson_disk(double tolerance = 1e-9) const { return worst_separation >= 1 - tolerance; }
};
/// Throws Error(kInvalidArgument) if there is no sample, one is not finite, a radius is not positive, or facets and
/// barycentrics are given but not one a sample; kInvalidMesh.
MaximalityReport verify_maximal(const MeshView& mesh, const SampleSet& samples, unsigned threads = 1,
                                ConflictRule rule = ConflictRule::kMax);
std::ostream& operator<<(std::ostream& out, const MaximalityReport& report);

/// The uncovered part of the surface as triangles: the gap primitives. Each triangle contains a piece of a gap (and may
/// overlap a disk by its circular segment); their union covers all gaps.
struct GapSet {
  Mesh primitives;            ///< #T triangles, vertices not shared between gaps
  std::vector<Index> facets;  ///< #T, the input facet a primitive lies in
  Index gaps = 0;             ///< uncovered fragments
  double area = 0;            ///< exact uncovered area (less than that of the primitives)
};
GapSet find_gaps(const MeshView& mesh, const SampleSet& samples, unsigned threads = 1);

namespace detail {

/// sample(), and the diagram it ended with (null if cancelled before there was one).
struct SamplingRun {
  SamplingResult result;
  std::unique_ptr<RestrictedPowerDiagram> diagram;
};
SamplingRun sample_with_diagram(const MeshView& mesh, const SamplingOptions& options);

/// Throws what verify_maximal documents.
RestrictedPowerDiagram diagram_of(const MeshView& mesh, const SampleSet& samples, unsigned threads);
MaximalityReport measure_maximality(const RestrictedPowerDiagram& diagram, ConflictRule rule = ConflictRule::kMax);

}  // namespace detail

}  // namespace amps
