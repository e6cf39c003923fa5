#define AMPS_OWN_SOURCE
#include "amps/sampling_stages.h"

#include "amps/darts.h"
#include "amps/gap_filling.h"
#include "amps/portable_math.h"

#include <cmath>
#include <cstring>

namespace amps::detail {

std::uint64_t random_stream(std::uint64_t seed, double density) {
  const auto rounded = static_cast<float>(density);
  std::uint32_t bits;
  static_assert(sizeof bits == sizeof rounded, "float has 32 bits");
  std::memcpy(&bits, &rounded, sizeof bits);
  return scramble(seed ^ scramble(std::uint64_t{bits} + 1));
}

namespace {

/// Darts drawn at a time, whatever becomes of the first of them: the voxels they will look at are on their way from memory
/// meanwhile. A third of the time of a large set.
constexpr std::size_t kDartsAhead = SurfaceDarts::kMostAtOnce;
/// On several threads so many are drawn and tested at a time, in pieces, once there are more samples.
constexpr std::size_t kDartsTogether = 4096;
constexpr std::size_t kDartsPerPiece = 256;

/// How many darts it takes. The chance that the disk of a dart is free falls with the power −3/2 of their number (Feder,
/// "Random sequential adsorption", J. Theor. Biol. 1980), and k rejections in a row are due when it is about ln(n)/k. The
/// factor is measured.
double expected_darts(double samples, int max_rejections) {
  const double per_sample = 0.6 * portable_power(max_rejections / portable_log(samples + 2), 2.0 / 3);
  return samples * std::max(1.0, per_sample);
}

/// The next darts.
struct ThrownDarts {
  std::vector<Sample> samples;
  std::vector<Rng> after;       ///< the generator once the dart was drawn
  std::vector<char> conflicts;  ///< with samples that were there when it was drawn; where darts are thrown together

  void resize(std::size_t n, const Rng& rng) {
    samples.resize(n);
    after.resize(n, rng);
    conflicts.resize(n, 0);
  }
  std::size_t size() const { return samples.size(); }
};

bool conflicts_with_set(const SamplingTask& task, const Sample& dart) {
  return task.disks->grid().conflicting_sample(dart.position(), dart.radius, task.radii.rule()) != kNone;
}

/// Starts to fetch what tests of these darts will look at.
void prefetch_surroundings(const VoxelGrid& grid, const Sample* darts, std::size_t count) {
  for (std::size_t k = 0; k < count; ++k) grid.prefetch_voxel(darts[k].position(), darts[k].radius);
  for (std::size_t k = 0; k < count; ++k) grid.prefetch_samples(darts[k].position(), darts[k].radius);
}

/// Draws the next darts, and tests them against the samples that are there by now.
void throw_together(const SamplingTask& task, const SurfaceDarts& darts, Rng& rng, ThrownDarts& thrown,
                    const Execution& execution) {
  static_assert(kDartsPerPiece % kDartsAhead == 0, "pieces are drawn in full");
  const int draws = darts.draws_per_dart();
  std::vector<Rng> at_begin_of_piece;
  for (std::size_t k = 0; k < thrown.size(); k += kDartsAhead) {
    if (draws == 0) {
      darts.draft(rng, kDartsAhead, &thrown.samples[k], &thrown.after[k]);
      continue;
    }
    if (k % kDartsPerPiece == 0) at_begin_of_piece.push_back(rng);
    for (std::size_t i = 0; i < static_cast<std::size_t>(draws) * kDartsAhead; ++i) rng.next();
  }
  parallel_for(thrown.size(), kDartsPerPiece, execution, [&](std::size_t begin, std::size_t end) {
    Rng own = draws > 0 ? at_begin_of_piece[begin / kDartsPerPiece] : rng;
    for (std::size_t first = begin; first < end; first += kDartsAhead) {
      if (draws > 0) darts.draft(own, kDartsAhead, &thrown.samples[first], &thrown.after[first]);
      darts.finish(kDartsAhead, &thrown.samples[first]);
      prefetch_surroundings(task.disks->grid(), &thrown.samples[first], kDartsAhead);
      for (std::size_t k = first; k < first + kDartsAhead; ++k)
        thrown.conflicts[k] = conflicts_with_set(task, thrown.samples[k]) ? 1 : 0;
    }
  });
}

/// Throws darts until enough in a row are rejected. On several threads the same, since which darts become samples is decided
/// one after another: those together that conflict with a sample that was there before are known, and there are few others.
void throw_all(SamplingTask& task, const SurfaceDarts& darts, double expected, const Execution& execution) {
  Rng rng = task.rng;
  ThrownDarts thrown;
  thrown.resize(kDartsAhead, rng);
  bool together = false;
  for (int rejections = 0;;) {
    if (together) {
      throw_together(task, darts, rng, thrown, execution);
    } else {
      darts.draw(rng, kDartsAhead, thrown.samples.data(), thrown.after.data());
      prefetch_surroundings(task.disks->grid(), thrown.samples.data(), kDartsAhead);
    }
    const Index before = task.set.size();
    for (std::size_t k = 0; k < thrown.size(); ++k) {
      const Sample& dart = thrown.samples[k];
      const bool conflicts = thrown.conflicts[k] != 0, known = together && (conflicts || task.set.size() == before);
      if (known ? conflicts : conflicts_with_set(task, dart)) {
        ++rejections;
      } else {
        rejections = 0;
        task.add_dart(dart);
      }
      const bool goes_on = ++task.report.darts % kDartsPerReport != 0 || completes([&] {
        execution.report(std::min(1.0, static_cast<double>(task.report.darts) / expected));
      });
      if (!goes_on) task.status = Outcome::kCancelled;
      if (!goes_on || rejections >= task.options.max_rejections) {
        task.rng = thrown.after[k];
        return;
      }
    }
    if (together || execution.workers() == 1) continue;
    together = slot(task.set.size()) > kDartsTogether;
    if (together) thrown.resize(kDartsTogether, rng);
  }
}

}  // namespace

void run_darts(SamplingTask& task, const FacetAreas& areas, double density, const Execution& execution) {
  Stopwatch watch;
  const SurfaceDarts darts(task.mesh, areas.of_facets, task.radii, execution.part(0, 0.02));
  const double expected = expected_darts(kSamplesPerDensity * density, task.options.max_rejections);
  throw_all(task, darts, expected, execution.part(0.02, 1));
  task.report.dart_samples = task.set.size() - task.num_fixed;
  task.report.seconds_darts += watch.lap();
}

std::unique_ptr<RestrictedPowerDiagram> run_gap_filling(SamplingTask& task, const Execution& execution) {
  Stopwatch watch;
  const SamplingCosts costs(task.set.size() / kDartPart, static_cast<double>(task.mesh.num_facets()), execution.workers());
  const double share = costs.diagram / (costs.diagram + costs.gaps);
  auto diagram = std::make_unique<RestrictedPowerDiagram>(task.mesh, task.set.points(), weights_of(task.set.radii()),
                                                          task.disks->reach_lists(), execution.part(0, share));
  task.report.seconds_triangulation += diagram->seconds_triangulation();
  task.report.seconds_diagram += watch.lap() - diagram->seconds_triangulation();
  execution.check();
  const Execution filling = execution.part(share, 1, "filling gaps");
  GapFiller filler(*diagram, *task.disks, task.radii);
  constexpr double kLookShare = 0.15;
  filler.look_at_all(filling.part(0, kLookShare));
  const Execution throwing = filling.part(kLookShare, 1);
  GapFillLimits limits;
  limits.execution = &throwing;
  const auto enter = [&](const Sample& sample) {
    task.add(sample);
    ++task.report.gap_samples;
  };
  const auto fill = [&] {
    if (!filler.can_fill_together()) {
      return filler.fill(task.rng, limits, [&](const Sample& sample, Index near) {
        diagram->compact(throwing);
        enter(sample);
        diagram->insert(sample.position(), sample.radius * sample.radius, near);
      });
    }
    return filler.fill_together(
        task.rng, limits, [&](const Sample& sample, Index) { enter(sample); },
        [&](RestrictedPowerDiagram::Arrivals& now, RestrictedPowerDiagram::Arrivals& next, const std::function<void()>& draw,
            const RestrictedPowerDiagram::Measure& measure) {
          diagram->compact(throwing);
          diagram->insert_together(now, next, draw, measure, throwing);
        });
  };
  const GapFilling filled = fill();
  task.report.unfilled_gaps += filled.unfilled;
  if (filled.end == GapFilling::End::kCancelled) task.status = Outcome::kCancelled;
  task.report.seconds_gaps += watch.lap();
  return diagram;
}

void add_kept(SamplingTask& task, const std::vector<FaceSample>& kept, const Execution& execution) {
  for_each_piece(kept.size(), kElementsPerLook, execution, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const Sample& sample = kept[k].sample;
      if (sample.radius > task.radii.at(sample.at)) continue;
      if (task.num_fixed > 0 && task.disks->conflicting_sample(sample, task.radii.rule()) != kNone) continue;
      task.add(sample);
      ++(kept[k].of_darts ? task.report.dart_samples : task.report.gap_samples);
    }
  });
}

void report_radii(const std::vector<double>& radii, SamplingReport& report) {
  report.min_radius = *std::min_element(radii.begin(), radii.end());
  report.max_radius = *std::max_element(radii.begin(), radii.end());
  report.mean_radius = 0;
  for (const double r : radii) report.mean_radius += r / static_cast<double>(radii.size());
}

SamplingRun finish_run(SamplingTask& task, std::unique_ptr<RestrictedPowerDiagram> diagram) {
  if (task.set.size() > 0) report_radii(task.set.radii(), task.report);
  SamplingRun run;
  run.result = {task.set.finish(), task.report, task.status};
  run.disks = task.disks;
  run.diagram = std::move(diagram);
  return run;
}

}  // namespace amps::detail
