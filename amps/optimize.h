// optimize.h: better triangles from the same kind of set. What is bad — a triangle with an angle out of bounds, a vertex with
// too few or too many neighbours — loses some of its samples, the gap is refilled at random, and the refill is kept if it is
// better. Vertices never move off their disks: the set stays a maximal Poisson-disk set throughout.
//
// Yan & Wonka 2012, §4.2, take out whatever is bad with its neighbours and keep every refill; that stalls near [35°, 105°]. We
// differ in three things. A refill is kept only if it lowers an energy of the triangles and valences around, and undone
// otherwise: that goes on to triangles without obtuse angles, always ends, and the last state is the best. Small patches come
// before large ones. And refills are tried in a copy of the few dual triangles around (trial_patch.h); the diagram is edited
// only for those that promise to be better, and decides: it is exact, the copy is not.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"
#include "amps/sampling.h"
#include "amps/sizing.h"
#include "amps/topology_certificate.h"

#include <cstdint>
#include <iosfwd>
#include <memory>
#include <vector>

namespace amps {

/// What to reach, and when to stop trying.
struct OptimizeOptions {
  bool angles = true;    ///< triangles with an angle below min_angle or above max_angle are bad
  bool valences = true;  ///< inner vertices with less than 5 or more than 7 neighbours, and boundary vertices with more than 5,
                         ///< are bad; the latter not on edges of more than two triangles
  /// Degrees; 0 < min_angle < 60 < max_angle < 180. 0: the paper's, [35, 105] where all radii are equal and [32, 114] elsewhere
  /// (115 there would let Q_min fall below its 0.51). Where radii are equal or of gradation 0.1 and less, [42, 90] is in reach
  /// too; it takes six times as long, and 4 % more samples.
  double min_angle = 0;
  double max_angle = 0;
  /// Visits to everything that is bad, 0 or more.
  int max_iterations = 1000;
  /// Refills tried of each patch, at least 1.
  int refills = 8;
  /// Same seed, mesh, samples and options: the same result on any number of threads. (remesh() goes on with the diagram that
  /// sampling has left, in another order than a fresh one: it finds other refills than optimize() of the same samples.)
  std::uint64_t seed = 1;
  /// Wanted radii of new samples; empty: `radius`.
  SizingField sizing;
  /// Wanted radius of new samples, absolute units, without a field; 0: the least radius of the set. Greater than that it may be
  /// over a surface (Neighborhood::kSurface), where curves and folds have made some disks smaller.
  double radius = 0;
  /// That of the set: new samples obey it too.
  ConflictRule conflict_rule = ConflictRule::kMax;
  /// Default: kSpace.
  Neighborhood neighborhood = Neighborhood::kDefault;
  /// Threads, progress and cancelling. The result does not depend on the threads.
  Execution execution;
};

/// The state before an iteration, and, unless cancelled, one more at the end.
struct OptimizeIteration {
  Index bad_triangles = 0;  ///< 0 if angles are not asked for
  Index bad_vertices = 0;   ///< 0 if valences are not asked for; those on edges of more than two triangles always count
  double min_angle = 0;     ///< degrees, over bad triangles, over all in the first line and the last; 0 if there is none
  double max_angle = 0;
  Index samples = 0;
  /// What is lowered: degrees out of bounds to first order (half of those above), 0.25 for each angle below and 0.5 for each
  /// above, 5 a missing or extra valence. Vertices on edges of more than two triangles join when all else is good.
  double energy = 0;
  double seconds = 0;  ///< wall clock since the start
  /// What it has cost since the start, in about microseconds, from what was done and not from a clock: the same on any machine.
  double work = 0;
};

struct OptimizeReport {
  /// kDone: nothing is bad. kStalled: many visits to all that is bad have brought nothing, or too little for the work; the
  /// bounds are too tight for this set or surface.
  Outcome status = Outcome::kDone;
  double min_angle = 0, max_angle = 0;  ///< the bounds used
  std::vector<OptimizeIteration> iterations;
  std::uint64_t trials = 0;    ///< refills tried
  std::uint64_t edits = 0;     ///< those the diagram was edited for
  std::uint64_t accepted = 0;  ///< those kept
  Index removed = 0;           ///< samples of the input that are gone
  Index added = 0;             ///< samples of the result that are new
};
AMPS_EXPORT std::ostream& operator<<(std::ostream& out, const OptimizeReport& report);

struct OptimizeResult {
  SampleSet
      samples;  ///< those of the input that are left, in order, then the new ones; without facet (kNone) if the input has none
  OptimizeReport report;
};

/// Optimises a maximal Poisson-disk set; if it is not maximal, fill_gaps() comes first. Cancelled or stopped early, the result
/// is the best state so far, a maximal Poisson-disk set as well. Throws as verify_maximal, and Error(kInvalidArgument) for
/// options out of range or a sizing field of another mesh, kTooLarge for radii out of proportion to the mesh. About 8 µs a
/// sample to the paper's bounds. Thread-safe.
AMPS_EXPORT OptimizeResult optimize(const MeshView& mesh, const SampleSet& samples, const OptimizeOptions& options);

/// Convergence as text, a line an iteration: "iteration,bad_triangles,bad_vertices,min_angle,max_angle,samples,energy,seconds".
AMPS_EXPORT void write_convergence(std::ostream& out, const OptimizeReport& report);

namespace detail {

class CapField;
class DiskSet;

void require_optimize_options(const OptimizeOptions& options);
/// Options in units of `scale`, which is that of the mesh.
OptimizeOptions scaled_options(const OptimizeOptions& options, const MeshScale& scale);

/// Samples that optimisation adds, relative to those there are: measured, good to 0.01.
double expected_growth(const OptimizeOptions& options, bool uniform);

/// Microseconds that optimisation takes for so many samples, roughly: for foreseeing time only.
double optimization_cost(const OptimizeOptions& options, double samples, bool uniform);

/// What the samples know of their surface. By default nothing: disks are balls.
struct OptimizeSurface {
  DiskSet* disks = nullptr;              ///< the samples' disks, which know their surface; edited as the samples are
  std::shared_ptr<const CapField> caps;  ///< bounds of wanted radii, beside curves
  Index num_fixed = 0;  ///< so many samples, the first ones, lie on curves: they stay, may have any valence, and triangles
                        ///< of three of them any angles
  const TopologyChecker* topology =
      nullptr;              ///< edits keep the dual homeomorphic to the surface, where it is; null: any will do
  TopologySamples samples;  ///< what it asks of samples, by their ids
};

/// optimize() on a diagram of exactly these samples. All are edited; a site that is removed leaves its id unused. `ids` (out):
/// of the samples there are in the end. Cancelled before it has begun, it throws Error(kCancelled), and nothing has changed.
OptimizeReport optimize_diagram(RestrictedPowerDiagram& diagram, SampleSet& samples, const OptimizeSurface& surface,
                                const OptimizeOptions& options, std::vector<Index>& ids);

}  // namespace detail

}  // namespace amps

#include "amps/host_macros_end.h"
