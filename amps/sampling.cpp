#define AMPS_OWN_SOURCE
#include "amps/sampling.h"

#include "amps/count_editor.h"
#include "amps/count_model.h"
#include "amps/curve_sampling.h"
#include "amps/darts.h"
#include "amps/mesh_edges.h"
#include "amps/sampling_stages.h"
#include "amps/sizing_lattice.h"
#include "amps/topology_refinement.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <cmath>
#include <optional>
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
/// Where curves and topology need samples of their own, runs end at kMinTargetAttempts, and sooner where larger radii do not
/// help. But small sets that have come as near as this may have missed by chance: they are drawn so often, as long as together
/// they have drawn no more than this.
constexpr double kNearTarget = 0.15;
constexpr int kNearTargetAttempts = 12;
constexpr double kNearTargetSamples = 1e4;
/// Up to so many samples the best run so far keeps its diagram while others are made for a target_count.
constexpr Index kFewForDiagrams = 20'000;
/// Curves that need so many samples, and so many times the wanted number (or what radius, area and length make), are refused:
/// thin plates, needles.
constexpr double kCurveSamples = 1e5;
constexpr double kCurveSamplesPerTarget = 50;
/// How far radii may grow beyond the first estimate to make room for samples that curves and topology ask for. Growing ends
/// before where the number of samples does not fall with the square root of the radius (its square, on a surface without
/// either).
constexpr double kMaxScaleBesideFixed = 3;
/// From so many samples on, which scatter by less than the tolerance, the first run takes what curves add into account.
constexpr Index kMinForeseenCount = 2000;
/// Where more of the samples lie on curves, what they add is not foreseen; and if it is less than this, it does not matter.
constexpr double kMaxForeseenCurvePart = 0.5;
constexpr double kMinForeseenMiss = 0.004;
/// Offset between the seeds of those runs: 2^64 over the golden ratio.
constexpr std::uint64_t kSeedStride = 0x9e3779b97f4a7c15u;

/// Crossings of cells and facets, at most, for each of max_samples and of the mesh's facets. They take some 200 bytes each; on
/// usual meshes there are at most 1.35, which the memory of samples and mesh includes.
constexpr double kMostCrossings = 4;

/// More samples than this would not leave the triangulation's cells their 32-bit names.
constexpr Index kMaxSamples = 50'000'000;

/// Share of a run's progress for its curves.
constexpr double kCurvesShare = 0.05;
/// Shares of the range of progress for the first run for a target_count, and of what is left for each further one. Many need
/// one or two.
constexpr double kFirstRunShare = 0.75;
constexpr double kFurtherRunShare = 0.75;

void require_sampling_options(const SamplingOptions& options) {
  require_neighborhood(options.neighborhood, options.conflict_rule);
  if (options.max_rejections < 1) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: max_rejections is " + std::to_string(options.max_rejections) +
                                                 "; it must be at least 1 (the paper uses 300)");
  }
  if (options.max_samples < 1 || options.max_samples > kMaxSamples) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: max_samples is " + std::to_string(options.max_samples) +
                                                 "; it must be between 1 and " + std::to_string(kMaxSamples));
  }
}

/// Radii below this many resolutions of the coordinates are refused: roundings of positions would be 1 % of them and more, and
/// gaps with no double in them too many.
constexpr double kLeastResolutions = 64;

std::string text_of_radii(double min, double max) {
  return min == max ? "radius " + number_text(min) : "radii from " + number_text(min) + " to " + number_text(max);
}

void require_fitting_radii(double min, double max, const Box& box) {
  if (VoxelGrid::fits(box, min, max)) return;
  throw Error(ErrorCode::kTooLarge, "sampling: " + text_of_radii(min, max) + ": out of proportion to the mesh's diagonal " +
                                        number_text(box.diagonal()) + "; stay between 1e-6 and 1e6 of it, or rescale the mesh");
}

/// Refuses radii before any work that would end in memory exhaustion.
void require_feasible_radii(const MeshView& mesh, double area, const WantedRadii& radii, const Box& box,
                            const SamplingOptions& options) {
  const double min = radii.min(), max = radii.max();
  if (!(min > 0) || !std::isfinite(max)) {
    throw Error(ErrorCode::kInvalidArgument,
                "sampling: the radius is " + number_text(min) + "; it must be positive and finite");
  }
  const bool uniform = min == max;
  const std::string what = text_of_radii(min, max);
  const ForeseenSize size = foresee_size(mesh, area, radii, options.max_samples);
  const auto use = [&](double factor) {
    constexpr double kMargin = 1.01;
    return std::string("; use ") + (uniform ? "a radius of at least " + number_text(min * factor * kMargin)
                                            : "a sizing field scaled by at least " + number_text(factor * kMargin));
  };
  if (!(size.samples() < options.max_samples)) {
    const double over = size.samples() / options.max_samples;
    throw Error(ErrorCode::kTooLarge, "sampling: " + what + (uniform ? " needs about " : " need about ") +
                                          number_text(size.samples()) + " samples, more than max_samples, " +
                                          std::to_string(options.max_samples) +
                                          use(size.by_length > size.by_area ? over : std::sqrt(over)));
  }
  const double most = kMostCrossings * (static_cast<double>(options.max_samples) + mesh.num_facets());
  if (!(size.crossings < most)) {
    throw Error(ErrorCode::kTooLarge, "sampling: " + what + (uniform ? " cuts" : " cut") +
                                          " the facets, which are long and thin beside it, into about " +
                                          number_text(size.crossings) + " pieces, more than max_samples, " +
                                          std::to_string(options.max_samples) + ", leaves room for" +
                                          use(size.crossings / most) + ", or a mesh without such needles");
  }
  require_fitting_radii(min, max, box);
  const double farthest = box.min.cwiseAbs().cwiseMax(box.max.cwiseAbs()).maxCoeff(), resolution = 0x1p-52 * farthest;
  if (min < kLeastResolutions * resolution) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: " + what + " at coordinates of up to " + number_text(farthest) +
                                                 ": doubles are " + number_text(resolution) +
                                                 " apart there, too much for disks; move the mesh to the origin");
  }
}

/// Of facets, where one radius is wanted, or would be once the field is scaled and rounded; else nobody needs them. `edges`:
/// of the surface, if they are known.
FacetAreas areas_for_darts(const MeshView& mesh, const SizingField& sizing, const SurfaceEdges* edges) {
  constexpr double kNoField = 1 + 1e-9;
  const bool one_radius = sizing.empty() || sizing.max_radius() < kNoField * sizing.min_radius();
  if (!one_radius) return {};
  return edges != nullptr ? FacetAreas(mesh, edges->repeated_facets()) : FacetAreas(mesh);
}

/// Which of radius, sizing and target_count are given, and whether the field is this mesh's.
void require_one_sizing(const MeshView& mesh, const SamplingOptions& options) {
  const bool by_radius = options.radius != 0, by_count = options.target_count != 0, by_field = !options.sizing.empty();
  if (options.target_count < 0 || !(by_radius || by_count || by_field) || (by_radius && (by_count || by_field))) {
    throw Error(ErrorCode::kInvalidArgument,
                "sampling: set a positive radius, or a sizing field, or a positive target_count, or both of the last two");
  }
  if (options.exact_count && !by_count) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: exact_count meets a number of samples; set target_count");
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

/// Times and attempts add up over the runs made for one target.
void add_up(SamplingReport& total, const SamplingReport& run) {
  total.seconds_darts += run.seconds_darts;
  total.seconds_triangulation += run.seconds_triangulation;
  total.seconds_diagram += run.seconds_diagram;
  total.seconds_gaps += run.seconds_gaps;
  total.seconds_topology += run.seconds_topology;
}

bool has_curves(const SamplingSurface& surface) { return surface.curves != nullptr && !surface.curves->empty(); }

/// Refuses radii that are lowered out of proportion: a conflict may halve them once more.
void require_fitting_grid(const Box& box, double min, double max) {
  if (VoxelGrid::fits(box, min / 2, max)) return;
  throw Error(ErrorCode::kTooLarge, "sampling: the shape needs radii down to " + number_text(min) +
                                        ", out of proportion to the mesh's diagonal " + number_text(box.diagonal()) +
                                        "; take a larger radius, fewer curves, or parts that are nearer to each other");
}

/// Wanted radii beside samples on curves, under bounds that they and failures ask for (null: none do).
struct BoundedRadii {
  WantedRadii radii;
  std::shared_ptr<const CapField> caps;
};

/// `curves`: null where there are none.
BoundedRadii bounded_radii(const WantedRadii& radii, const std::vector<RadiusCap>& limits, const CurveSamples* curves,
                           const Box& box) {
  std::vector<RadiusCap> caps = limits;
  double min = radii.min(), max = radii.max();
  for (const RadiusCap& cap : caps) min = std::min(min, cap.radius);
  if (curves != nullptr) {
    for (const CurveSample& on_curve : curves->samples) {
      min = std::min(min, on_curve.sample.radius);
      max = std::max(max, on_curve.sample.radius);
    }
    caps.insert(caps.end(), curves->caps.caps().begin(), curves->caps.caps().end());
  }
  std::shared_ptr<const CapField> field;
  if (!caps.empty()) {
    require_fitting_grid(box, min, max);
    field = std::make_shared<const CapField>(std::move(caps), kCapGradation);
  }
  return {radii.beside(min, max).with_caps(field), field};
}

/// What one round of a run is made from.
struct SamplingRound {
  const WantedRadii& radii;
  const SamplingSurface& surface;
  const FacetAreas& areas;
  const Box& box;
  double density;                        ///< ∫dA/r², without bounds
  std::uint64_t stream;                  ///< random_stream()
  const std::vector<RadiusCap>& limits;  ///< bounds of radii, beside `radii`
  const std::vector<FaceSample>* kept;   ///< of an earlier round, to begin with; null: darts are thrown
  std::shared_ptr<CurveSamples> curves;  ///< null: if there are curves, they are yet to be sampled
};

/// The first round of a run. Its arguments must outlive it.
SamplingRound first_round(const SamplingSurface& surface, const FacetAreas& areas, const WantedRadii& radii, const Box& box,
                          std::uint64_t seed, std::shared_ptr<CurveSamples> curves) {
  const double density = radii.density_integral(areas.total);
  const std::vector<FaceSample>* const kept = surface.kept.empty() ? nullptr : &surface.kept;
  return {radii, surface, areas, box, density, random_stream(seed, density), surface.limits, kept, std::move(curves)};
}

/// Of a surface with curves. Cancelled, it throws Error(kCancelled).
std::shared_ptr<CurveSamples> curves_of_round(const MeshView& mesh, const SamplingOptions& options, const SamplingRound& round,
                                              const Execution& execution) {
  const SamplingSurface& surface = round.surface;
  const CapField limits(round.limits, kCapGradation);
  CurveSamplingOptions along;
  along.seed = round.stream;
  if (!limits.empty()) along.limits = &limits;
  along.tips = &surface.tips;
  // What refinement asks for counts in the set as a whole.
  along.max_samples = options.max_samples;
  if (limits.empty()) {
    double wanted = options.target_count;
    if (options.target_count == 0) {
      wanted = kSamplesPerDensity * round.density;
      for (const Curve& curve : surface.curves->curves) wanted += 1 + curve.length() / round.radii.max();
    }
    along.max_samples = std::min<double>(along.max_samples, std::max(kCurveSamples, kCurveSamplesPerTarget * wanted));
  }
  along.execution = execution.part(0, 1, "sampling curves");
  return std::make_shared<CurveSamples>(sample_curves(mesh, *surface.curves, *surface.flood, round.radii, along));
}

/// How many samples radii make beside curves that make `count` without: 0.1 more for each sample on a crease, 0.42 on a
/// boundary (beyond what CountModel adds), and 0.8 of what ∫dA/r² gains where radii are bounded, which darts measure. Fitted to
/// models of 2,000 to 100,000 samples: the first run is within 1 % on 31 of 38 (on 14 without), and 14 % off at worst.
double count_beside_curves(const MeshView& mesh, const SamplingRound& round, const CurveSamples& curves, double count,
                           const Execution& execution) {
  constexpr double kPerCreaseSample = 0.1, kPerBoundarySample = 0.42, kPerBoundedArea = 0.8;
  // Smaller radii are in places so small that darts do not hit them often enough to tell how large.
  constexpr double kMostRatio = 8;
  constexpr double kMostDarts = 2e5;
  double added = 0;
  for (const CurveSample& on_curve : curves.samples) {
    if (on_curve.curve == kNone) continue;
    const std::size_t edge = round.surface.curves->curves[slot(on_curve.curve)].edges.front();
    added += round.surface.flood->edges()[edge].size() == 1 ? kPerBoundarySample : kPerCreaseSample;
  }
  const BoundedRadii bounded = bounded_radii(round.radii, round.limits, &curves, round.box);
  if (bounded.caps == nullptr) return count + added;
  const SurfaceDarts darts(mesh, round.areas.of_facets, round.radii);
  Rng rng(round.stream);
  const auto num_darts = static_cast<std::uint64_t>(std::min(count, kMostDarts));
  double gained = 0;
  Ticker ticker(execution, num_darts, kDartsPerReport);
  for (std::uint64_t k = 0; k < num_darts; ++k) {
    ticker.tick();
    const Sample dart = darts.draw(rng);
    const double ratio = std::min(kMostRatio, dart.radius / bounded.radii.at(dart.at));
    gained += ratio * ratio - 1;
  }
  return count * (1 + kPerBoundedArea * gained / static_cast<double>(num_darts)) + added;
}

/// From curves and darts to the last gap.
SamplingRun run_round(const MeshView& mesh, const SamplingOptions& options, const SamplingRound& round,
                      const Execution& execution) {
  const SamplingSurface& surface = round.surface;
  const double density = round.density;
  std::shared_ptr<CurveSamples> curves = round.curves;
  const double curves_end = has_curves(surface) ? kCurvesShare : 0;
  if (has_curves(surface) && curves == nullptr) {
    if (!completes([&] { curves = curves_of_round(mesh, options, round, execution.part(0, curves_end)); })) {
      SamplingRun run;
      run.result.status = Outcome::kCancelled;
      return run;
    }
  }
  BoundedRadii bounded = bounded_radii(round.radii, round.limits, curves.get(), round.box);
  SamplingTask task(mesh, options, bounded.radii, round.box, surface.flood, round.stream);
  if (curves != nullptr) {
    for (const CurveSample& on_curve : curves->samples) {
      if (round.kept != nullptr) {
        task.add(on_curve.sample);
      } else {
        task.add_dart(on_curve.sample);
      }
    }
    task.num_fixed = task.report.curve_samples = task.set.size();
  }
  const SamplingCosts costs(kSamplesPerDensity * density, static_cast<double>(mesh.num_facets()), execution.workers());
  const double darts_end = costs.darts / costs.all(), sort_end = (costs.darts + costs.sort) / costs.all();
  std::unique_ptr<RestrictedPowerDiagram> diagram;
  const bool complete = completes([&] {
    const Execution filling = execution.part(curves_end, 1);
    if (round.kept != nullptr) add_kept(task, *round.kept, filling.part(0, sort_end, "throwing darts"));
    // Of samples that are all too large, none is kept; and a diagram has at least one site.
    if (round.kept == nullptr || task.set.size() == 0) {
      run_darts(task, round.areas, density, filling.part(0, darts_end, "throwing darts"));
      if (task.status == Outcome::kDone) task.sort_along_curve(round.box, filling.part(darts_end, sort_end, "throwing darts"));
    }
    if (task.status == Outcome::kDone) diagram = run_gap_filling(task, filling.part(sort_end, 1));
  });
  if (!complete) task.status = Outcome::kCancelled;
  if (task.status == Outcome::kCancelled) diagram.reset();
  SamplingRun run = finish_run(task, std::move(diagram));
  run.curves = std::move(curves);
  run.caps = std::move(bounded.caps);
  return run;
}

/// Lowers radii where the dual has not the topology of the surface, until it has, or nothing is left to lower. Where curves
/// have to be sampled anew, the diagram is, too; elsewhere it is edited.
class TopologyRefiner {
 public:
  /// `run`: that of `first`.
  TopologyRefiner(const MeshView& mesh, const SamplingOptions& options, const SamplingRound& first, SamplingRun& run)
      : mesh_(mesh), options_(options), first_(first), run_(run), caps_(first.limits), rng_(first.stream + 1) {
    take_run();
  }

  void refine(const Execution& execution) {
    double done = 0.1;
    const auto next_part = [&done, &execution] {
      const double from = done;
      done = (1 + done) / 2;
      return execution.part(from, done);
    };
    const Index before = run_.diagram->num_sites();
    const Index most = std::max(before, std::min(most_refined(before), options_.max_samples));
    TopologyCertificate certificate = check_all(execution.part(0, done));
    if (certificate.holds()) return;
    // What floors are shares of: beside close curves radii are small from the beginning. But where these take so many samples
    // as in sheets far thinner than a thousandth of the radius, to go on below would cost far more.
    constexpr std::size_t kFewCurveSamples = 20'000;
    const bool few = run_.curves == nullptr || run_.curves->samples.size() <= kFewCurveSamples;
    const WantedRadii to_begin_with =
        few ? bounded_radii(first_.radii, first_.limits, run_.curves.get(), first_.box).radii : first_.radii;
    for (;;) {
      while (!run_.gave_up && caps_.lower(certificate, *run_.disks, run_.curves.get(), to_begin_with)) {
        lower(certificate, next_part());
        if (!certificate.holds() && run_.diagram->num_sites() > most) run_.gave_up = true;
      }
      if (run_.gave_up || !edited_ || set_->compact()) break;
      // Fewer samples than ids. Curves are sampled under bounds that are new to them, so that all has to be looked at again.
      const Execution part = next_part();
      start_anew(part.part(0, 0.9));
      certificate = check_all(part.part(0.9, 1));
    }
    for (const TopologyFailure& failure : certificate.failures) list_facets(failure);
    std::vector<Index>& facets = run_.changed_facets;
    std::sort(facets.begin(), facets.end());
    facets.erase(std::unique(facets.begin(), facets.end()), facets.end());
    if (edited_ && set_->compact()) finish();
  }

 private:
  /// Samples again under the bounds of the last time, and looks at what has changed. Where smaller radii would be out of
  /// proportion, or samples on curves too many, all stays as it is.
  void lower(TopologyCertificate& certificate, const Execution& execution) {
    const CapField bounds(caps_.last(), kCapGradation);
    try {
      if (touches_curves(bounds, run_.curves.get())) {
        start_anew(execution.part(0, 0.9));
        certificate = check_all(execution.part(0.9, 1));
      } else {
        edit(bounds, execution);
        certificate = check_changed(certificate);
      }
      ++run_.result.report.refinements;
    } catch (const Error& error) {
      if (error.code() != ErrorCode::kTooLarge) throw;
      run_.gave_up = true;
    }
  }

  void take_run() {
    const SamplingReport& report = run_.result.report;
    set_.emplace(*run_.diagram, *run_.disks, report.curve_samples, report.dart_samples);
    edited_ = false;
  }
  /// Of a failure, all facets of the cells.
  void list_facets(const TopologyFailure& failure) {
    if (failure.facet != kNone) run_.changed_facets.push_back(failure.facet);
    for (const Index s : samples_of(failure)) {
      const RestrictedPowerDiagram& diagram = *run_.diagram;
      for (Index f = diagram.first_of_site(s); f != kNone; f = diagram.next_of_site(f)) {
        run_.changed_facets.push_back(diagram.polygon(f).facet);
      }
    }
  }

  TopologySamples samples() const { return topology_samples(*run_.disks, first_.surface.curves.get(), run_.curves.get()); }
  TopologyCertificate check_all(const Execution& execution) const {
    return first_.surface.topology->check(*run_.diagram, samples(), execution);
  }

  TopologyCertificate check_changed(const TopologyCertificate& before) {
    std::vector<Index> cells = set_->changed();
    for (const TopologyFailure& failure : before.failures) {
      const std::vector<Index> of_failure = samples_of(failure);
      cells.insert(cells.end(), of_failure.begin(), of_failure.end());
    }
    std::sort(cells.begin(), cells.end());
    cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
    return first_.surface.topology->check(*run_.diagram, samples(), cells, scratch_);
  }

  void start_anew(const Execution& execution) {
    const SamplingReport before = run_.result.report;
    const std::vector<FaceSample> kept = set_->on_faces();
    const SamplingRound round{first_.radii,  first_.surface, first_.areas, first_.box, first_.density,
                              first_.stream, caps_.caps(),   &kept,        nullptr};
    SamplingRun next = run_round(mesh_, options_, round, execution);
    add_up(next.result.report, before);
    next.result.report.seed = before.seed;
    next.result.report.darts = before.darts;
    next.result.report.refinements = before.refinements;
    // What was complete stays.
    if (next.result.status != Outcome::kDone) throw Error(ErrorCode::kCancelled, "sampling: cancelled");
    run_ = std::move(next);
    take_run();
  }

  void edit(const CapField& bounds, const Execution& execution) {
    BoundedRadii bounded = bounded_radii(first_.radii, caps_.caps(), run_.curves.get(), first_.box);
    run_.caps = std::move(bounded.caps);
    set_->lower(bounds, bounded.radii, rng_, execution);
    edited_ = true;
  }

  void finish() {
    SamplingReport& report = run_.result.report;
    report.dart_samples = set_->num_darts();
    report.gap_samples = set_->num_gap_samples();
    report.unfilled_gaps += set_->num_unfilled();
    GrowingSet samples = set_->samples();
    report_radii(samples.radii(), report);
    run_.result.samples = samples.finish();
  }

  const MeshView& mesh_;
  const SamplingOptions& options_;
  const SamplingRound& first_;
  SamplingRun& run_;
  RefinementCaps caps_;
  Rng rng_;
  TopologyChecker::Scratch scratch_;
  std::optional<RefinedSet> set_;  ///< of run_
  bool edited_ = false;            ///< since run_ was made
};

/// One run: a round, and further ones with smaller radii where the topology is not that of the surface. `curves`: its samples
/// on curves; null: if there are curves, they are yet to be sampled.
SamplingRun run_once(const MeshView& mesh, const SamplingOptions& options, const WantedRadii& radii,
                     const SamplingSurface& surface, const FacetAreas& areas, const Box& box, std::uint64_t seed,
                     std::shared_ptr<CurveSamples> curves, const Execution& execution) {
  require_feasible_radii(mesh, areas.total, radii, box, options);
  constexpr double kRefinementShare = 0.1;
  const double refining = surface.preserve ? 1 - kRefinementShare : 1;
  const SamplingRound round = first_round(surface, areas, radii, box, seed, std::move(curves));
  SamplingRun run;
  if (!completes([&] { run = run_round(mesh, options, round, execution.part(0, refining)); })) {
    run.result.status = Outcome::kCancelled;
  }
  run.result.report.seed = seed;
  if (!surface.preserve || run.result.status != Outcome::kDone) return run;
  Stopwatch watch;
  const bool complete = completes(
      [&] { TopologyRefiner(mesh, options, round, run).refine(execution.part(refining, 1, "keeping the topology")); });
  if (!complete) {
    run.result.status = Outcome::kCancelled;
    run.diagram.reset();
  }
  run.result.report.seconds_topology += watch.lap();
  return run;
}

/// What the first run for a target_count will have on its curves; null if there are none, or if their samples make the count
/// another one than asked for: then the model knows. Cancelled, it throws Error(kCancelled).
std::shared_ptr<CurveSamples> foresee_curves(const MeshView& mesh, const SamplingOptions& options, const SamplingRound& first,
                                             CountModel& model, const Execution& execution) {
  if (!has_curves(first.surface) || first.kept != nullptr || options.target_count < kMinForeseenCount) return nullptr;
  require_feasible_radii(mesh, first.areas.total, first.radii, first.box, options);
  const double target = options.target_count;
  std::shared_ptr<CurveSamples> curves = curves_of_round(mesh, options, first, execution.part(0, 0.8));
  if (static_cast<double>(curves->samples.size()) > kMaxForeseenCurvePart * target) return curves;
  const double count = count_beside_curves(mesh, first, *curves, target, execution.part(0.8, 1));
  if (std::fabs(count - target) <= kMinForeseenMiss * target) return curves;
  model.expect(count);
  return nullptr;
}

/// The part of the range of progress for a run for a target_count, the first being number 1.
Execution part_of_attempt(const Execution& execution, int attempt) {
  double begin = 0, end = kFirstRunShare;
  for (int k = 1; k < attempt; ++k) {
    begin = end;
    end += kFurtherRunShare * (1 - end);
  }
  return execution.part(begin, end);
}

}  // namespace

double expected_samples(const MeshView& mesh, const SamplingOptions& options) {
  if (options.target_count > 0) return options.target_count;
  if (options.sizing.empty() && !(options.radius > 0)) return 0;
  return kSamplesPerDensity * wanted_radii(options).density_integral(total_area(mesh));
}

double sampling_cost(double samples, double facets, unsigned workers) { return SamplingCosts(samples, facets, workers).all(); }

SamplingRun sample_with_diagram(const MeshView& mesh, const SamplingOptions& options, const SamplingSurface& surface) {
  const Execution execution = options.execution.start();
  require_usable(mesh);
  require_sampling_options(options);
  require_one_sizing(mesh, options);
  const bool by_field = !options.sizing.empty();
  const Box box = bounding_box(mesh);
  FacetAreas areas;
  if (options.target_count == 0) {
    areas = areas_for_darts(mesh, options.sizing, surface.flood != nullptr ? &surface.flood->edges() : nullptr);
    SamplingRun run = run_once(mesh, options, wanted_radii(options), surface, areas, box, options.seed, nullptr, execution);
    if (run.result.status == Outcome::kDone) execution.finish();
    return run;
  }

  SamplingRun best;
  best.result.status = Outcome::kCancelled;  // until a run is complete
  best.result.report.seed = options.seed;
  std::unique_ptr<CountModel> model;
  if (!completes([&] {
        const Execution counting = execution.part(0, 0.02, "throwing darts");
        std::optional<SurfaceEdges> own;
        const SurfaceEdges& edges =
            surface.flood != nullptr ? surface.flood->edges() : own.emplace(mesh, counting.part(0, 0.5));
        areas = areas_for_darts(mesh, options.sizing, &edges);
        model =
            std::make_unique<CountModel>(mesh, edges, areas.total, options.sizing, options.target_count, counting.part(0.5, 1));
      })) {
    return best;
  }
  const double target = options.target_count;
  const auto miss = [target](const SamplingRun& run) { return std::fabs(run.result.samples.size() - target) / target; };
  const auto radii_of = [&](double scale) {
    return by_field ? WantedRadii(options.sizing.scaled(scale), options.conflict_rule)
                    : WantedRadii(scale, options.conflict_rule);
  };
  SamplingReport total;
  std::shared_ptr<CurveSamples> curves;  // of the first run
  // Of a large set only the samples stay while another one is made: a diagram has some 2 KB a sample.
  const auto drop_large_diagram = [&best] {
    if (best.result.samples.size() <= kFewForDiagrams) return;
    best.diagram.reset();
    best.disks.reset();
  };
  const auto run_of = [&](double scale, std::uint64_t seed, const Execution& part) {
    SamplingRun run = run_once(mesh, options, radii_of(scale), surface, areas, box, seed, std::move(curves), part);
    curves.reset();
    if (by_field) run.result.report.sizing_scale = scale;
    return run;
  };
  Execution running = execution;
  if (!completes([&] {
        Stopwatch watch;
        constexpr double kForeseeingShare = 0.02;
        const double share = has_curves(surface) ? kForeseeingShare : 0;
        const WantedRadii radii = radii_of(model->scale());
        curves = foresee_curves(mesh, options, first_round(surface, areas, radii, box, options.seed, nullptr), *model,
                                execution.part(0, share));
        running = execution.part(share, 1);
        total.seconds_darts += watch.lap();
      })) {
    return best;
  }
  double first_scale = 0, first_count = 0, best_scale = 0;
  bool helps = true, by_chance = false;
  for (int attempt = 1; attempt <= kTargetAttempts; ++attempt) {
    const double scale = model->scale();
    if (attempt == 1) first_scale = scale;
    // Where curves need most of the samples, larger disks on faces help little: the set stays larger than asked for.
    if (surface.curves != nullptr && (scale > kMaxScaleBesideFixed * first_scale || !(helps || by_chance))) break;
    const std::uint64_t seed = options.seed + static_cast<std::uint64_t>(attempt - 1) * kSeedStride;
    drop_large_diagram();
    SamplingRun run;
    const bool begun = completes([&] { run = run_of(scale, seed, part_of_attempt(running, attempt)); });
    total.attempts = attempt;
    add_up(total, run.result.report);
    if (!begun || run.result.status == Outcome::kCancelled) {
      if (best.result.samples.size() == 0 && begun) best = std::move(run);
      best.result.status = Outcome::kCancelled;
      best.diagram.reset();
      break;
    }
    if (run.gave_up || (surface.may_change && !run.changed_facets.empty())) {
      best = std::move(run);
      break;
    }
    const double count = run.result.samples.size();
    if (attempt == 1) first_count = count;
    // Without logarithms, whose last bits differ from one platform to another.
    const double fall = first_count / count;
    helps = count <= target * (1 + kTargetTolerance) || scale <= first_scale || fall * fall > scale / first_scale;
    model->learn(run.result.samples.size());
    if (attempt == 1 || miss(run) < miss(best)) {
      best = std::move(run);
      best_scale = scale;
    }
    if (miss(best) <= kTargetTolerance) break;
    // Curves need the samples that they need, whatever the radius.
    by_chance = miss(best) <= kNearTarget && attempt < kNearTargetAttempts && attempt * target <= kNearTargetSamples;
    if (attempt >= kMinTargetAttempts && (attempt * target > kTargetSamples || (has_curves(surface) && !by_chance))) break;
  }
  if (best.result.status == Outcome::kDone && best.diagram == nullptr && !surface.result_only) {
    // Rarely: the same again, of which not a bit differs.
    SamplingRun run;
    const bool begun =
        completes([&] { run = run_of(best_scale, best.result.report.seed, part_of_attempt(running, total.attempts + 1)); });
    add_up(total, run.result.report);
    if (begun && run.result.status == Outcome::kDone) {
      best = std::move(run);
    } else {
      best.result.status = Outcome::kCancelled;
    }
  }
  SamplingReport& report = best.result.report;
  report.attempts = total.attempts;
  report.seconds_darts = total.seconds_darts;
  report.seconds_triangulation = total.seconds_triangulation;
  report.seconds_diagram = total.seconds_diagram;
  report.seconds_gaps = total.seconds_gaps;
  report.seconds_topology = total.seconds_topology;
  if (best.result.status == Outcome::kDone) execution.finish();
  return best;
}

namespace {

/// The end of sampling in the range of progress where the number is to be met exactly.
constexpr double kBeforeExactCount = 0.85;

/// Edits the set of a complete run until it has exactly as many samples as wanted.
void meet_count_of(SamplingRun& run, const SamplingOptions& options, const Execution& execution) {
  SamplingResult& result = run.result;
  SamplingReport& report = result.report;
  report.exact_count.wanted = options.target_count;
  const WantedRadii radii = options.sizing.empty()
                                ? WantedRadii(report.radius, options.conflict_rule)
                                : WantedRadii(options.sizing.scaled(report.sizing_scale), options.conflict_rule);
  std::vector<Index> ids;
  const CountedSet set{*run.diagram,
                       result.samples,
                       ids,
                       run.disks->knows_surface() ? run.disks.get() : nullptr,
                       radii,
                       0,
                       DualRating(false, false, 0, 0),
                       nullptr,
                       {},
                       report.seed};
  const Index num_left = meet_count(set, execution, report.exact_count);
  report.dart_samples =
      static_cast<Index>(std::count_if(ids.begin(), ids.begin() + num_left, [&](Index s) { return s < report.dart_samples; }));
  report.gap_samples = result.samples.size() - report.dart_samples;
  report_radii(result.samples.radii, report);
  if (report.exact_count.coverage > 1) result.status = std::max(result.status, Outcome::kNotMaximal);
  if (result.samples.size() != options.target_count) result.status = std::max(result.status, Outcome::kCountMissed);
}

}  // namespace

bool misses_count(Index count, const SamplingOptions& asked) {
  constexpr double kTolerance = 0.02;
  if (asked.target_count == 0) return false;
  const Index off = std::abs(count - asked.target_count);
  return asked.exact_count ? off > 0 : off > std::max(1.0, kTolerance * asked.target_count);
}

SamplingOptions scaled_options(const SamplingOptions& options, const MeshScale& scale) {
  SamplingOptions result = options;
  result.radius = scale.length(options.radius);
  result.sizing = SizingFieldAccess::scaled(options.sizing, scale);
  return result;
}

void scale_back(SamplingReport& report, const MeshScale& scale) {
  for (double* length : {&report.radius, &report.min_radius, &report.max_radius, &report.mean_radius}) scale.back(*length);
}

namespace {

/// sample() of a mesh whose scale is ours.
SamplingResult sample_for_count(const MeshView& mesh, const SamplingOptions& options) {
  const bool knows_surface = options.neighborhood == Neighborhood::kSurface;
  SamplingSurface surface;
  surface.result_only = !options.exact_count;
  if (!knows_surface && surface.result_only) return std::move(sample_with_diagram(mesh, options, surface).result);
  require_usable(mesh);
  const double floods = knows_surface ? 0.03 : 0, sampled = options.exact_count ? kBeforeExactCount : 1;
  const Execution execution = options.execution.start();
  SamplingOptions inner = options;
  SamplingResult result;
  result.status = Outcome::kCancelled;
  if (!completes([&] {
        if (knows_surface) {
          surface.flood = flood_of(mesh, options.neighborhood, execution.part(0, floods, "listing edges"));
        }
        inner.execution = execution.part(floods, sampled);
      })) {
    return result;
  }
  SamplingRun run = sample_with_diagram(mesh, inner, surface);
  if (options.exact_count && run.result.status != Outcome::kCancelled) {
    const bool complete =
        completes([&] { meet_count_of(run, options, execution.part(sampled, 1, "meeting the number exactly")); });
    if (!complete) run.result.status = Outcome::kCancelled;
  }
  result = std::move(run.result);
  if (result.status != Outcome::kCancelled) execution.finish();
  return result;
}

/// `call` of the mesh and the options in units of `scale`.
template <class Call>
SamplingResult sampled_at(const MeshScale& scale, const MeshView& mesh, const SamplingOptions& options, const Call& call) {
  SamplingResult result = scale.in_our_units([&] { return call(scale.mesh(mesh), scaled_options(options, scale)); });
  scale_back(result.samples, scale);
  scale_back(result.report, scale);
  return result;
}

}  // namespace
}  // namespace detail

SamplingResult sample(const MeshView& mesh, const SamplingOptions& options) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) return detail::sampled_at(scale, mesh, options, sample);
  SamplingResult result = detail::sample_for_count(mesh, options);
  if (result.status < Outcome::kCountMissed && detail::misses_count(result.samples.size(), options)) {
    result.status = Outcome::kCountMissed;
  }
  return result;
}

SamplingResult throw_darts(const MeshView& mesh, const SamplingOptions& options) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) return detail::sampled_at(scale, mesh, options, throw_darts);
  const Execution execution = options.execution.start("throwing darts");
  require_usable(mesh);
  detail::require_sampling_options(options);
  if (options.target_count != 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "sampling: dart throwing alone needs a radius or a sizing field; target_count counts maximal sets");
  }
  detail::require_one_sizing(mesh, options);
  const detail::WantedRadii radii = detail::wanted_radii(options);
  const Box box = bounding_box(mesh);
  const detail::FacetAreas areas = detail::areas_for_darts(mesh, options.sizing, nullptr);
  detail::require_feasible_radii(mesh, areas.total, radii, box, options);
  const double density = radii.density_integral(areas.total);
  detail::SamplingTask task(mesh, options, radii, box, nullptr, detail::random_stream(options.seed, density));
  task.report.seed = options.seed;
  if (!detail::completes([&] { detail::run_darts(task, areas, density, execution); })) task.status = Outcome::kCancelled;
  if (task.status == Outcome::kDone) execution.finish();
  return std::move(detail::finish_run(task, nullptr).result);
}

SamplingResult fill_gaps(const MeshView& mesh, const SampleSet& existing, const SamplingOptions& options) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    return detail::sampled_at(scale, mesh, options, [&](const MeshView& m, const SamplingOptions& o) {
      return fill_gaps(m, detail::scaled_samples(existing, scale), o);
    });
  }
  const Execution execution = options.execution.start();
  require_usable(mesh);
  detail::require_sampling_options(options);
  detail::require_sample_set(existing);
  if (options.target_count != 0) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: gap filling takes a radius or a sizing field, not a target_count");
  }
  if (options.radius != 0 || !options.sizing.empty()) detail::require_one_sizing(mesh, options);
  const double smallest = detail::min_radius(existing);
  const double radius = options.radius == 0 ? smallest : options.radius;
  // Over a surface new disks are lowered where they would cover a sample.
  if (radius > smallest && options.neighborhood != Neighborhood::kSurface) {
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
  detail::require_feasible_radii(mesh, total_area(mesh), radii, box, options);
  if (!radii.uniform()) detail::require_fitting_radii(radii.min_of_set(), radii.max_of_set(), box);
  const double density = radii.density_integral(total_area(mesh));
  detail::SamplingTask task(mesh, options, radii, box, nullptr, detail::random_stream(options.seed, density));
  task.report.seed = options.seed;
  task.set.add_all(existing);
  const bool complete = detail::completes([&] {
    constexpr double kDisksShare = 0.03;
    const Execution placing = execution.part(0, kDisksShare, "filling gaps");
    const auto flood = detail::flood_of(mesh, options.neighborhood, placing.part(0, 0.3));
    task.disks = detail::disks_of(mesh, existing, radii.min_of_set(), radii.max_of_set(), flood, placing.part(0.3, 1));
    detail::run_gap_filling(task, execution.part(kDisksShare, 1));
  });
  if (!complete) task.status = Outcome::kCancelled;
  if (task.status == Outcome::kDone) execution.finish();
  return std::move(detail::finish_run(task, nullptr).result);
}

}  // namespace amps
