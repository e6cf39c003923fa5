// optimize_state.h (internal): what the parts of the optimiser work on: the samples, their diagram, their stars and how bad
// these are, what trials see of it, the random numbers, the report. The schedule (optimize.cpp) reads it and plans by it; the
// Refiller (optimize_refiller.h) changes samples.
#pragma once

#include "amps/base.h"
#include "amps/disk_set.h"
#include "amps/dual_star.h"
#include "amps/execution.h"
#include "amps/optimize.h"
#include "amps/power_diagram.h"
#include "amps/refill.h"
#include "amps/sample_edit.h"
#include "amps/samples.h"
#include "amps/topology_certificate.h"
#include "amps/wanted_radii.h"

#include <memory>
#include <vector>

namespace amps::detail {

/// Radii of samples to come beside those there are. `options.sizing` is of the mesh the samples are on.
WantedRadii radii_of(const OptimizeOptions& options, const SampleSet& samples);

/// One for a run. Its members refer to each other: it is never copied.
struct OptimizeState {
  /// `given`: of exactly the samples `set`. It must outlive this, as must the options and what `surface` points to; `set` need
  /// not. Bounds in degrees. All stars are read, on the threads of `execution`. Throws Error(kTooLarge) for radii out of
  /// proportion to the mesh, and Error(kCancelled).
  OptimizeState(RestrictedPowerDiagram& given, const SampleSet& set, const OptimizeSurface& surface,
                const OptimizeOptions& given_options, double min_angle, double max_angle, const Execution& execution);
  OptimizeState(const OptimizeState&) = delete;

  const RestrictedPowerDiagram& diagram;
  const Index num_fixed;                   ///< samples below stay where they are
  const TopologyChecker* const topology;   ///< null: edits may change the topology of the dual
  const TopologySamples topology_samples;  ///< what it asks
  const OptimizeOptions& options;
  const DualRating rating;
  StarReader reader;
  const WantedRadii radii;
  const std::unique_ptr<DiskSet> balls;  ///< the disks of `samples`, unless the surface has given some
  EditableSamples samples;
  DualStars stars;            ///< of `samples`, up to date between edits
  SeenSamples seen;           ///< the same for trials, up to date where trials begin
  std::vector<Index> unseen;  ///< samples whose star may be another one than seen
  Rng rng;
  OptimizeReport report;

  /// Is it still there, and bad? A triangle whose first corner has no ring is there as long as its corners are and something at
  /// each of them is bad.
  bool is_current(const BadItem& item) const;

  /// Brings `seen` up to date. Not beside trials.
  void see_changes();

  /// For one thread. It looks at `stars`, or is made to look at `seen`.
  RefillFinder finder() const { return {diagram, stars, rating, radii, options.refills, num_fixed}; }
};

}  // namespace amps::detail
