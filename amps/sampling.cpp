#define AMPS_OWN_SOURCE
#include "amps/sampling.h"

#include "amps/count_model.h"
#include "amps/darts.h"
#include "amps/gap_filling.h"
#include "amps/spatial_sort.h"
#include "amps/voxel_grid.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace amps {
namespace detail {
namespace {

/// Relative distance to target_count that counts as met.
constexpr double kTargetTolerance = 0.01;
/// Runs made for a target end at this many, and sooner when together they have drawn this many samples: small sets, whose
/// counts scatter by more than the tolerance, are cheap to draw again.
constexpr int kTargetAttempts = 100;
constexpr int kMinTargetAttempts = 8;
constexpr double kTargetSamples = 1e5;
/// Offset between the seeds of those runs: 2^64 over the golden ratio.
constexpr std::uint64_t kSeedStride = 0x9e3779b97f4a7c15u;

/// More samples than this would not leave the triangulation's cells their 32-bit names.
constexpr Index kMaxSamples = 50'000'000;

/// Darts between two looks at Progress: less than a millisecond.
constexpr std::uint64_t kDartsPerReport = 1024;
/// Darts drawn at a time, whatever becomes of the first of them: the voxels they will look at are on their way from memory
/// meanwhile. A third of the time of a large set.
constexpr std::size_t kDartsAhead = 16;

void require_sampling_options(const SamplingOptions& options) {
  if (options.max_rejections < 1) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: max_rejections is " + std::to_string(options.max_rejections) +
                                                 "; it must be at least 1 (the paper uses 300)");
  }
  if (options.max_samples < 1 || options.max_samples > kMaxSamples) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: max_samples is " + std::to_string(options.max_samples) +
                                                 "; it must be between 1 and " + std::to_string(kMaxSamples));
  }
}

/// Refuses radii before any work that would end in memory exhaustion. `density` is ∫dA/r².
void require_feasible_radii(double min, double max, double density, const Box& box, const SamplingOptions& options) {
  if (!(min > 0) || !std::isfinite(max)) {
    throw Error(ErrorCode::kInvalidArgument,
                "sampling: the radius is " + number_text(min) + "; it must be positive and finite");
  }
  const bool uniform = min == max;
  const std::string what =
      uniform ? "radius " + number_text(min) : "radii from " + number_text(min) + " to " + number_text(max);
  const double expected = kSamplesPerDensity * density;
  if (!(expected < options.max_samples)) {
    const double factor = std::sqrt(expected / options.max_samples) * 1.01;
    throw Error(ErrorCode::kTooLarge, "sampling: " + what + " need about " + number_text(expected) +
                                          " samples, more than max_samples, " + std::to_string(options.max_samples) + "; use " +
                                          (uniform ? "a radius of at least " + number_text(min * factor)
                                                   : "a sizing field scaled by at least " + number_text(factor)));
  }
  if (!VoxelGrid::fits(box, min, max)) {
    throw Error(ErrorCode::kTooLarge, "sampling: " + what + ": out of proportion to the mesh's diagonal " +
                                          number_text(box.diagonal()) +
                                          "; stay between 1e-6 and 1e6 of it, or rescale the mesh");
  }
}

/// Which of radius, sizing and target_count are given, and whether the field is this mesh's.
void require_one_sizing(const MeshView& mesh, const SamplingOptions& options) {
  const bool by_radius = options.radius != 0, by_count = options.target_count != 0, by_field = !options.sizing.empty();
  if (options.target_count < 0 || !(by_radius || by_count || by_field) || (by_radius && (by_count || by_field))) {
    throw Error(ErrorCode::kInvalidArgument,
                "sampling: set a positive radius, or a sizing field, or a positive target_count, or both of the last two");
  }
  if (by_field && !options.sizing.fits(mesh)) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: the sizing field is of another mesh (" +
                                                 std::to_string(options.sizing.num_facets()) + " facets; this one has " +
                                                 std::to_string(mesh.num_facets()) + "); make it from the mesh to be sampled");
  }
}

WantedRadii wanted_radii(const SamplingOptions& options) {
  return options.sizing.empty() ? WantedRadii(options.radius, options.conflict_rule)
                                : WantedRadii(options.sizing, options.conflict_rule);
}

/// What both stages share: the mesh, the wanted radii, the samples so far and the grid that tells conflicts among them.
struct SamplingTask {
  /// `box` holds all samples.
  SamplingTask(const MeshView& m, const SamplingOptions& o, const WantedRadii& r, const Box& box, std::uint64_t seed)
      : mesh(m), options(o), radii(r), grid(box, r.min_of_set(), r.max_of_set()), rng(seed) {
    if (r.constant()) report.radius = r.min();
    report.seed = seed;
  }
  void add(const Sample& sample) {
    grid.insert(sample.position(), sample.radius, set.size());
    set.add(sample);
  }
  /// Samples get new numbers, in the order of a curve: what follows reaches for neighbours in space, which now are neighbours
  /// in memory.
  void sort_along_curve(const Box& box) {
    Stopwatch watch;
    set.reorder(curve_order(set.points()));
    grid = VoxelGrid(box, radii.min_of_set(), radii.max_of_set());
    for (Index s = 0; s < set.size(); ++s) grid.insert(set.position(s), set.radii()[slot(s)], s);
    report.seconds_darts += watch.lap();
  }

  const MeshView& mesh;
  const SamplingOptions& options;
  const WantedRadii& radii;
  VoxelGrid grid;
  Rng rng;  ///< one sequence for both stages: gap darts must not repeat the random numbers of the first darts
  GrowingSet set;
  SamplingReport report;
  Outcome status = Outcome::kDone;
};

void throw_all(SamplingTask& task, const SurfaceDarts& darts, double expected) {
  struct Thrown {
    Sample dart;
    Rng after;  ///< the generator once this dart was drawn
  };
  Rng rng = task.rng;
  std::vector<Thrown> thrown(kDartsAhead, Thrown{{}, rng});
  for (int rejections = 0;;) {
    for (Thrown& next : thrown) {
      next = {darts.draw(rng), rng};
      task.grid.prefetch_voxel(next.dart.position(), next.dart.radius);
    }
    for (const Thrown& next : thrown) task.grid.prefetch_samples(next.dart.position(), next.dart.radius);
    for (const Thrown& next : thrown) {
      if (task.grid.conflicting_sample(next.dart.position(), next.dart.radius, task.radii.rule()) != kNone) {
        ++rejections;
      } else {
        rejections = 0;
        task.add(next.dart);
      }
      const bool goes_on = ++task.report.darts % kDartsPerReport != 0 ||
                           task.options.progress.report("dart throwing", std::min(1.0, task.set.size() / expected));
      if (!goes_on) task.status = Outcome::kCancelled;
      if (!goes_on || rejections >= task.options.max_rejections) {
        task.rng = next.after;
        return;
      }
    }
  }
}

/// `density` is ∫dA/r².
void run_darts(SamplingTask& task, double density) {
  Stopwatch watch;
  throw_all(task, SurfaceDarts(task.mesh, task.radii), kSamplesPerDensity * density);
  task.report.dart_samples = task.set.size();
  task.report.seconds_darts += watch.lap();
}

/// Second stage: the diagram of the samples so far, filled until no gap is left.
std::unique_ptr<RestrictedPowerDiagram> run_gap_filling(SamplingTask& task) {
  Stopwatch watch;
  auto diagram = std::make_unique<RestrictedPowerDiagram>(task.mesh, task.set.points(), weights_of(task.set.radii()),
                                                          task.options.threads, task.options.progress);
  task.report.seconds_triangulation += diagram->seconds_triangulation();
  task.report.seconds_diagram += watch.lap() - diagram->seconds_triangulation();
  if (task.options.progress.cancelled()) {
    task.status = Outcome::kCancelled;
    return nullptr;
  }
  GapFiller filler(*diagram, task.grid, task.radii);
  filler.look_at_all();
  GapFillLimits limits;
  limits.progress = &task.options.progress;
  const GapFilling filled = filler.fill(task.rng, limits, [&](const Sample& sample, Index near) {
    task.add(sample);
    diagram->insert(sample.position(), sample.radius * sample.radius, near);
  });
  task.report.gap_samples += filled.samples;
  task.report.unfilled_gaps += filled.unfilled;
  if (filled.end == GapFilling::End::kCancelled) task.status = Outcome::kCancelled;
  task.report.seconds_gaps += watch.lap();
  return diagram;
}

SamplingRun finish_run(SamplingTask& task, std::unique_ptr<RestrictedPowerDiagram> diagram) {
  const std::vector<double>& radii = task.set.radii();
  if (!radii.empty()) {
    task.report.min_radius = *std::min_element(radii.begin(), radii.end());
    task.report.max_radius = *std::max_element(radii.begin(), radii.end());
    for (const double r : radii) task.report.mean_radius += r / static_cast<double>(radii.size());
  }
  return {{task.set.finish(), task.report, task.status}, std::move(diagram)};
}

/// Times and attempts add up over the runs made for one target.
void add_up(SamplingReport& total, const SamplingReport& run) {
  total.seconds_darts += run.seconds_darts;
  total.seconds_triangulation += run.seconds_triangulation;
  total.seconds_diagram += run.seconds_diagram;
  total.seconds_gaps += run.seconds_gaps;
}

}  // namespace

SamplingRun sample_with_diagram(const MeshView& mesh, const SamplingOptions& options) {
  require_usable(mesh);
  require_sampling_options(options);
  require_one_sizing(mesh, options);
  const double area = total_area(mesh);
  const Box box = bounding_box(mesh);
  const auto run_once = [&](const WantedRadii& radii, std::uint64_t seed) {
    const double density = radii.density_integral(area);
    require_feasible_radii(radii.min(), radii.max(), density, box, options);
    SamplingTask task(mesh, options, radii, box, seed);
    run_darts(task, density);
    std::unique_ptr<RestrictedPowerDiagram> diagram;
    if (task.status == Outcome::kDone) task.sort_along_curve(box);
    if (task.status == Outcome::kDone) diagram = run_gap_filling(task);
    return finish_run(task, std::move(diagram));
  };
  const bool by_field = !options.sizing.empty();
  if (options.target_count == 0) {
    return run_once(wanted_radii(options), options.seed);
  }

  CountModel model(mesh, options.sizing, options.target_count);
  const double target = options.target_count;
  const auto miss = [target](const SamplingRun& run) { return std::fabs(run.result.samples.size() - target) / target; };
  SamplingRun best;
  SamplingReport total;
  for (int attempt = 1; attempt <= kTargetAttempts; ++attempt) {
    const double scale = model.scale();
    const WantedRadii radii =
        by_field ? WantedRadii(options.sizing.scaled(scale), options.conflict_rule) : WantedRadii(scale, options.conflict_rule);
    SamplingRun run = run_once(radii, options.seed + static_cast<std::uint64_t>(attempt - 1) * kSeedStride);
    if (by_field) run.result.report.sizing_scale = scale;
    total.attempts = attempt;
    add_up(total, run.result.report);
    if (run.result.status == Outcome::kCancelled) {
      best = std::move(run);
      break;
    }
    model.learn(run.result.samples.size());
    if (attempt == 1 || miss(run) < miss(best)) best = std::move(run);
    if (miss(best) <= kTargetTolerance) break;
    if (attempt >= kMinTargetAttempts && attempt * target > kTargetSamples) break;
  }
  SamplingReport& report = best.result.report;
  report.attempts = total.attempts;
  report.seconds_darts = total.seconds_darts;
  report.seconds_triangulation = total.seconds_triangulation;
  report.seconds_diagram = total.seconds_diagram;
  report.seconds_gaps = total.seconds_gaps;
  return best;
}

}  // namespace detail

SamplingResult sample(const MeshView& mesh, const SamplingOptions& options) {
  return std::move(detail::sample_with_diagram(mesh, options).result);
}

SamplingResult throw_darts(const MeshView& mesh, const SamplingOptions& options) {
  require_usable(mesh);
  detail::require_sampling_options(options);
  if (options.target_count != 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "sampling: dart throwing alone needs a radius or a sizing field; target_count counts maximal sets");
  }
  detail::require_one_sizing(mesh, options);
  const detail::WantedRadii radii = detail::wanted_radii(options);
  const Box box = bounding_box(mesh);
  const double density = radii.density_integral(total_area(mesh));
  detail::require_feasible_radii(radii.min(), radii.max(), density, box, options);
  detail::SamplingTask task(mesh, options, radii, box, options.seed);
  detail::run_darts(task, density);
  return std::move(detail::finish_run(task, nullptr).result);
}

SamplingResult fill_gaps(const MeshView& mesh, const SampleSet& existing, const SamplingOptions& options) {
  require_usable(mesh);
  detail::require_sampling_options(options);
  detail::require_sample_set(existing);
  if (options.target_count != 0) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: gap filling takes a radius or a sizing field, not a target_count");
  }
  if (options.radius != 0 || !options.sizing.empty()) detail::require_one_sizing(mesh, options);
  const double smallest = detail::min_radius(existing);
  const double radius = options.radius == 0 ? smallest : options.radius;
  if (radius > smallest) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: new disks of radius " + detail::number_text(radius) +
                                                 " could cover existing samples; use at most the smallest existing radius, " +
                                                 detail::number_text(smallest));
  }
  const detail::WantedRadii wanted = options.sizing.empty() ? detail::WantedRadii(radius, options.conflict_rule)
                                                            : detail::WantedRadii(options.sizing, options.conflict_rule);
  const detail::WantedRadii radii = wanted.beside(smallest, detail::max_radius(existing));
  Box box = bounding_box(mesh);
  for (Index s = 0; s < existing.size(); ++s) {
    box.min = box.min.cwiseMin(existing.positions.row(s).transpose());
    box.max = box.max.cwiseMax(existing.positions.row(s).transpose());
  }
  const double density = radii.density_integral(total_area(mesh));
  detail::require_feasible_radii(radii.min(), radii.max(), density, box, options);
  if (!radii.uniform()) detail::require_feasible_radii(radii.min_of_set(), radii.max_of_set(), density, box, options);
  detail::SamplingTask task(mesh, options, radii, box, options.seed);
  for (Index s = 0; s < existing.size(); ++s) task.add(detail::sample_of(existing, s));
  auto diagram = detail::run_gap_filling(task);
  return std::move(detail::finish_run(task, std::move(diagram)).result);
}

}  // namespace amps
