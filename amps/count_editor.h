// count_editor.h (internal): edits a sample set until it has a given number of samples, the cheapest edits first: see
// exact_count.h for what they are.
#pragma once

#include "amps/base.h"
#include "amps/disk_set.h"
#include "amps/dual_star.h"
#include "amps/exact_count.h"
#include "amps/execution.h"
#include "amps/power_diagram.h"
#include "amps/samples.h"
#include "amps/topology_certificate.h"
#include "amps/wanted_radii.h"

#include <cstdint>
#include <vector>

namespace amps::detail {

/// A maximal set whose number of samples is to be met, and what is to be kept of it. All must outlive the call.
struct CountedSet {
  RestrictedPowerDiagram& diagram;
  SampleSet& samples;               ///< out: those left, in order, then the new ones
  std::vector<Index>& ids;          ///< of the samples in the diagram; in: empty if they are rows
  DiskSet* disks;                   ///< theirs, if they know their surface; null: balls
  const WantedRadii& radii;         ///< of new samples
  Index num_fixed;                  ///< so many samples, the first ones, lie on curves and stay; their ids are rows
  DualRating rating;                ///< of triangles and valences, by which refills are chosen
  const TopologyChecker* topology;  ///< edits keep the dual homeomorphic to the surface; null: any will do
  TopologySamples topology_samples;
  std::uint64_t seed;
};

/// Edits the set until it has `report.wanted` samples, or nothing helps. Returns how many of the given samples are left.
/// Cancelled, it throws Error(kCancelled); the set is complete then, and Poisson-disk. Some 0.5 ms for each sample to be added
/// or taken out, and 2 µs for each there is.
Index meet_count(const CountedSet& set, const Execution& execution, ExactCountReport& report);

}  // namespace amps::detail
