// sampling_stages.h (internal): the two stages of a run of sampling — darts, and then gap filling — on what both share.
#pragma once

#include "amps/base.h"
#include "amps/disk_set.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"
#include "amps/samples.h"
#include "amps/sampling.h"
#include "amps/spatial_sort.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

namespace amps::detail {

/// What each part of sampling costs, in microseconds a sample (of the result) or fragment. Roughly: only for telling how far a
/// run is. Of the samples, kDartPart come from darts.
inline constexpr double kDartCost = 1.4;
inline constexpr double kSortCost = 0.35;
inline constexpr double kGapCost = 3.3;
inline constexpr double kLookCost = 0.25;
inline constexpr double kDartPart = 0.74;

/// The same of a whole run.
struct SamplingCosts {
  double darts, sort, diagram, gaps;

  SamplingCosts(double samples, double facets, unsigned workers) {
    darts = kDartCost * samples;
    sort = kSortCost * samples;
    diagram = DiagramCosts(facets, kDartPart * samples, workers).all();
    gaps = kGapCost * samples + kLookCost * expected_fragments(facets, samples);
  }
  double all() const { return darts + sort + diagram + gaps; }
};

/// Darts between two looks for a cancel: less than a millisecond.
inline constexpr std::uint64_t kDartsPerReport = 1024;

/// Where the random numbers of a run begin. Radii, by ∫dA/r² to single precision, have a part in it: or else one seed would
/// throw the same darts for all of them, and sets of nearly equal radii would share most of their points.
std::uint64_t random_stream(std::uint64_t seed, double density);

/// What both stages share: the mesh, the wanted radii, the samples so far and the grid that tells conflicts among them.
struct SamplingTask {
  /// `box` holds all samples. `stream`: random_stream().
  SamplingTask(const MeshView& m, const SamplingOptions& o, const WantedRadii& r, const Box& box,
               std::shared_ptr<const SurfaceFlood> flood, std::uint64_t stream)
      : mesh(m),
        options(o),
        radii(r),
        disks(std::make_shared<DiskSet>(box, r.min_of_set(), r.max_of_set(), std::move(flood))),
        rng(stream) {
    if (r.constant()) report.radius = r.min();
  }
  /// In the first stage all disks are balls: over a surface that leaves gaps where sheets are near each other, which the second
  /// stage fills; and nothing needs to be known of their reach until they lie in the order of a curve.
  void add_dart(const Sample& sample) {
    disks->insert_ball(sample, set.size());
    set.add(sample);
  }
  void add(const Sample& sample) {
    disks->insert(sample, set.size());
    set.add(sample);
  }
  /// Samples get new numbers, in the order of a curve: what follows reaches for neighbours in space, which now are neighbours
  /// in memory.
  void sort_along_curve(const Box& box, const Execution& execution) {
    Stopwatch watch;
    std::vector<Index> order = curve_order(set.points(), execution.part(0, 0.5));
    if (num_fixed > 0) {  // samples on curves stay where they are, ahead of all others
      order.erase(std::remove_if(order.begin(), order.end(), [this](Index s) { return s < num_fixed; }), order.end());
      order.insert(order.begin(), slot(num_fixed), 0);
      std::iota(order.begin(), order.begin() + num_fixed, Index{0});
    }
    disks->clear(box, radii.min_of_set(), radii.max_of_set());  // first, so that there is room for a second copy of the set
    set.reorder(order, execution.part(0.5, 0.65));
    disks->insert_all(set, execution.part(0.65, 1));
    report.seconds_darts += watch.lap();
  }

  const MeshView& mesh;
  const SamplingOptions& options;
  const WantedRadii& radii;
  std::shared_ptr<DiskSet> disks;
  Rng rng;  ///< one sequence for both stages: gap darts must not repeat the random numbers of the first darts
  GrowingSet set;
  Index num_fixed = 0;  ///< samples on curves: the first ones
  SamplingReport report;
  Outcome status = Outcome::kDone;
};

/// First stage: darts, until enough in a row are rejected. `density` is ∫dA/r².
void run_darts(SamplingTask& task, const FacetAreas& areas, double density, const Execution& execution);

/// Second stage: the diagram of the samples so far, filled until no gap is left.
std::unique_ptr<RestrictedPowerDiagram> run_gap_filling(SamplingTask& task, const Execution& execution);

/// Samples of an earlier round stay where radii are not too large by now, and curves leave them room.
void add_kept(SamplingTask& task, const std::vector<FaceSample>& kept, const Execution& execution);

/// Of a set that is not empty.
void report_radii(const std::vector<double>& radii, SamplingReport& report);

/// The run of a task that has ended.
SamplingRun finish_run(SamplingTask& task, std::unique_ptr<RestrictedPowerDiagram> diagram);

}  // namespace amps::detail
