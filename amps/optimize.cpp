#define AMPS_OWN_SOURCE
#include "amps/optimize.h"

#include "amps/disk_set.h"
#include "amps/dual_star.h"
#include "amps/maximality.h"
#include "amps/optimize_refiller.h"
#include "amps/optimize_state.h"
#include "amps/portable_math.h"
#include "amps/refill.h"
#include "amps/sample_edit.h"
#include "amps/sizing_lattice.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <locale>
#include <ostream>
#include <sstream>
#include <string>
#include <utility>

namespace amps {
namespace detail {
namespace {

/// Visits in a row to all that is bad, none of which brought anything, before it is given up. Refills are random: the next
/// visit may find what the last has missed.
constexpr int kMaxIdleIterations = 32;
/// Of those, so many before forced refills begin, which cost more than others.
constexpr int kIdleBeforeForcing = 2;
/// Refills forced in an idle iteration, at least and at most; in between, as many as there are bad items. Few items deserve
/// several attempts; of many, the next iteration has some left.
constexpr std::size_t kMinForced = 8;
constexpr std::size_t kMaxForced = 64;
/// Rounds of improvement that a forced refill is given to become worth keeping.
constexpr int kRoundsAfterForcing = 16;
/// A forced refill takes out a random number of samples beyond the usual. It grows by one in so many idle iterations,
constexpr int kIdlePerSample = 2;
/// and ends at this many: a ring and a half around the item.
constexpr int kMaxForcedSamples = 10;
/// It is given up, too, when this work, in refills tried per sample, has not halved the energy. (All the way to [46, 83] it
/// takes 150 on a sphere.)
constexpr double kWorkPerHalving = 200;
/// An edit of the diagram counts as so many refills tried.
constexpr double kWorkOfEdit = 40;
/// It is given up, too, when the second half of its work has brought less than this share of all that was gained, and has not
/// halved the energy either. So what resists costs at most about as long again as what does not. (Of 36 models at [35, 105] and
/// [42, 90], those that come to an end on their own never meet this.)
constexpr double kMinShareOfGain = 0.05;
/// But for so much work everything is tried: some tenths of a second. A hard item or two may take as long in any set.
constexpr double kWorkAtLeast = 200000;
/// Units of that work, about a microsecond each: for a refill tried, and for a fragment changed by an edit.
constexpr double kWorkOfTrial = 2, kWorkOfFragment = 1;
/// Items are visited in stretches of so many ids, which mostly follow a curve in space, so that memory is at hand; in each
/// stretch in random order.
constexpr Index kIdsPerStretch = 4096;
/// Items a thread takes at a time.
constexpr std::size_t kItemsPerTask = 2;
/// Beside curves much may be out of reach: corners that are too narrow, radii that fall too fast. Optimisation ends where so
/// many iterations leave more than this share of the energy.
constexpr int kIterationsAtCurves = 8;
constexpr double kLeftAtCurves = 0.9;
/// Samples or fragments between two looks for a cancel, in loops that take up to 1 µs for each.
constexpr std::uint64_t kEntriesPerLook = 4096;

/// Angles of all triangles.
AngleRange angles_of_all(OptimizeState& state, const Execution& execution) {
  AngleRange range;
  const EditableSamples& samples = state.samples;
  const StarTable& stars = state.stars.star;
  const auto add = [&](Index a, Index b, Index c) {
    range.add(samples[a].position(), samples[b].position(), samples[c].position());
  };
  Ticker ticker(execution, slot(samples.size()), kEntriesPerLook);
  for (Index s = 0; s < samples.size(); ++s) {
    ticker.tick();
    if (!samples.alive(s)) continue;
    const StarView star = stars[slot(s)];
    for (int k = 0; k < star.size; ++k) {
      const Index a = star.ring[static_cast<std::size_t>(k)], b = star.ring[static_cast<std::size_t>((k + 1) % star.size)];
      const bool once = s < std::min(a, b) || stars[slot(a)].size == 0 || stars[slot(b)].size == 0;
      if (once) add(s, a, b);
    }
    if (star.size != 0) continue;
    for (const auto& pair : state.reader.read(s)) add(s, pair[0], pair[1]);
  }
  return range;
}

/// How hard bounds are: degrees from those that every maximal set of one radius meets. The upper bounds that go with lower ones
/// are about so many times as far from 120 as these from 30.
double tightness_of(double min_angle, double max_angle) {
  constexpr double kUpperPerLower = 2.4;
  return std::max(min_angle - 30, (120 - max_angle) / kUpperPerLower);
}

/// What share of the time is over, from the energy that is left. It falls fast while most of what is bad is improved at the
/// first visit, and slowly while little is left that resists; measured, the share of the time is near 1 − (share of the
/// energy)^a, with a from 0.6 at the paper's bounds down to 0.2 at tight ones.
class TimeEstimate {
 public:
  TimeEstimate(double min_angle, double max_angle)
      : exponent_(std::min(std::max(0.57 - 0.04 * (tightness_of(min_angle, max_angle) - 5), 0.2), 0.57)) {}

  /// `giving_up`: how far it is on the way to give up, in [0, 1].
  double share(double energy, double giving_up) {
    if (first_energy_ == 0) first_energy_ = energy;
    if (!(energy > 0)) return 1;
    const double by_energy = 1 - portable_power(std::min(1.0, energy / first_energy_), exponent_);
    return by_energy + (1 - by_energy) * giving_up;
  }

 private:
  double exponent_, first_energy_ = 0;
};

/// Tells when work brings next to nothing any more.
class DiminishingReturns {
 public:
  /// Where it stands. `work` never falls.
  void note(double work, double energy) {
    points_.push_back({work, energy});
    const double half = (points_.front().work + work) / 2;
    while (middle_ + 1 < points_.size() && points_[middle_ + 1].work <= half) ++middle_;
  }

  bool reached() const {
    const Point &first = points_.front(), &middle = points_[middle_], &last = points_.back();
    return last.work - first.work > kWorkAtLeast && last.energy > middle.energy / 2 &&
           middle.energy - last.energy < kMinShareOfGain * (first.energy - last.energy);
  }

 private:
  struct Point {
    double work, energy;
  };
  std::vector<Point> points_;
  std::size_t middle_ = 0;  ///< the last point in the first half of the work
};

/// The schedule.
class Optimizer {
 public:
  Optimizer(RestrictedPowerDiagram& diagram, const SampleSet& samples, const OptimizeSurface& surface,
            const OptimizeOptions& options, double min_angle, double max_angle, const Execution& execution)
      : execution_(execution),
        state_(diagram, samples, surface, options, min_angle, max_angle, execution.part(0, kSetUpShare)),
        refiller_(state_),
        estimate_(min_angle, max_angle),
        num_given_(samples.size()) {}

  /// Cancelled, the state is as good as any before.
  OptimizeReport run() {
    visiting_ = execution_.part(kSetUpShare, kClosingBegin);
    Outcome status = Outcome::kCancelled;
    completes([&] { status = improve_all(); });
    refiller_.give_back();
    return end(status);
  }

  /// In: the samples given to the constructor, or none.
  void write_samples(SampleSet& samples, std::vector<Index>& ids) const { state_.samples.collect(samples, ids); }

 private:
  /// Shares of the time at the paper's bounds: stars are read and angles measured before and after all.
  static constexpr double kSetUpShare = 0.2;
  static constexpr double kClosingBegin = 0.93;

  const OptimizeOptions& options() const { return state_.options; }

  Outcome improve_all() {
    Outcome status = improve();
    if (status == Outcome::kDone && options().valences) {
      // Vertices of bad valence on edges of more than two triangles come last: mostly there is little to be done, and what it
      // has cost in angles is made good again.
      rate_crossings(true);
      status = improve();
      if (status == Outcome::kStalled) {
        rate_crossings(false);
        const Outcome after = improve();
        if (after != Outcome::kDone) status = after;
        rate_crossings(true);
        bad_items(visiting_);
      }
    }
    return status;
  }

  /// Visits what is bad until nothing is, or nothing helps.
  Outcome improve() {
    const OptimizeReport& report = state_.report;
    double halved = INFINITY, work_then = 0;
    double energy_then = INFINITY;
    int iterations_since = 0;
    DiminishingReturns returns;
    for (int idle = 0;; ++iteration_) {
      std::vector<BadItem> items = bad_items(visiting_);
      const double energy = report.iterations.back().energy;
      const double work = static_cast<double>(report.trials) + kWorkOfEdit * static_cast<double>(report.edits);
      if (energy <= halved / 2) {
        halved = energy;
        work_then = work;
      }
      const double slowness = (work - work_then) / (kWorkPerHalving * num_given_);
      if (items.empty()) return Outcome::kDone;
      returns.note(report.iterations.back().work, energy);
      if (returns.reached()) return Outcome::kStalled;
      if (state_.num_fixed > 0 && ++iterations_since > kIterationsAtCurves) {
        if (energy > kLeftAtCurves * energy_then) return Outcome::kStalled;
        energy_then = energy;
        iterations_since = 0;
      }
      if (idle == kMaxIdleIterations || slowness > 1 || !refiller_.affords_edits_in_place()) return Outcome::kStalled;
      if (iteration_ == options().max_iterations) return Outcome::kIterationLimit;
      giving_up_ = std::max(slowness * slowness, static_cast<double>(idle) / kMaxIdleIterations);
      const std::uint64_t accepted = report.accepted;
      visit(items);
      if (report.accepted == accepted && idle >= kIdleBeforeForcing) {
        force_refills(items, std::min(1 + idle / kIdlePerSample, kMaxForcedSamples));
      }
      idle = report.accepted == accepted ? idle + 1 : 0;
    }
  }

  OptimizeReport end(Outcome status) {
    OptimizeReport& report = state_.report;
    if (status != Outcome::kCancelled) {
      const OptimizeIteration last = report.iterations.back();
      report.iterations.pop_back();
      const bool complete = completes([&] { bad_items(execution_.part(kClosingBegin, 0.99), true); });
      if (!complete) {
        report.iterations.push_back(last);
        status = Outcome::kCancelled;
      }
    }
    report.status = status;
    const EditableSamples& samples = state_.samples;
    Index left = 0;
    for (Index s = 0; s < samples.size(); ++s) {
      left += samples.alive(s) && !samples.is_new(s);
      report.added += samples.alive(s) && samples.is_new(s);
    }
    report.removed = num_given_ - left;
    return report;
  }

  /// The line of the report is written anew by bad_items(), which must follow.
  void rate_crossings(bool on) {
    state_.reader.rate_crossings(on);
    refiller_.count_edits_in_place_anew();
    state_.report.iterations.pop_back();
    for (Index s = 0; s < state_.samples.size(); ++s) {
      if (slot(s) % kEntriesPerLook == 0) visiting_.report(0);
      if (!state_.samples.alive(s) || state_.stars.star[slot(s)].size != 0) continue;
      state_.stars.read(state_.reader, s);
      state_.unseen.push_back(s);
    }
  }

  /// What is bad and rated, and a line of the report, which counts what is not rated yet as well. Angles are measured where
  /// something is bad, or everywhere.
  std::vector<BadItem> bad_items(const Execution& execution, bool measure_all = false) {
    const EditableSamples& samples = state_.samples;
    std::vector<BadItem> items;
    OptimizeIteration line;
    AngleRange range;
    // Reports of 0 tell nothing new; they look for a cancel.
    if (measure_all || state_.report.iterations.empty()) range = angles_of_all(state_, execution.part(0, measure_all ? 1 : 0));
    for (Index s = 0; s < samples.size(); ++s) {
      if (slot(s) % kEntriesPerLook == 0) execution.report(0);
      if (!samples.alive(s)) continue;
      ++line.samples;
      line.energy += state_.stars.energy[slot(s)];
      if (state_.stars.energy[slot(s)] > 0) state_.reader.list_bad(s, items);
      if (state_.stars.star[slot(s)].size != 0 || state_.reader.rates_crossings()) continue;
      line.bad_vertices += state_.reader.is_bad_crossing(s);  // all lines count alike
    }
    for (std::size_t k = 0; k < items.size(); ++k) {
      if (k % kEntriesPerLook == 0) execution.report(0);
      const BadItem& item = items[k];
      ++(item.is_vertex() ? line.bad_vertices : line.bad_triangles);
      if (!item.is_vertex()) range.add(samples[item.a].position(), samples[item.b].position(), samples[item.c].position());
    }
    line.min_angle = range.min_angle();
    line.max_angle = range.max_angle();
    line.seconds = seconds_ += watch_.lap();
    line.work = kWorkOfTrial * static_cast<double>(state_.report.trials) +
                kWorkOfFragment * static_cast<double>(samples.fragments_changed());
    state_.report.iterations.push_back(line);
    energy_change_then_ = refiller_.energy_change_of_all();
    return items;
  }

  /// Items under way: first planned, then tried, then carried out.
  struct Batch {
    const BadItem* items = nullptr;
    std::size_t count = 0;
    std::vector<RefillPlan> plans;
    std::vector<Rng> rngs;
    std::vector<Proposal> proposals;
    std::uint64_t planned_at = 0;
  };
  struct ItemAlone {
    BadItem item;
    Proposal proposal;
    std::uint64_t planned_at;
  };

  /// Visits items that are sorted by their first corner, in another order.
  void visit(std::vector<BadItem>& items) {
    Batch tried, next;
    for (std::size_t begin = 0, end; begin < items.size(); begin = end) {
      for (end = begin + 1; end < items.size() && items[end].a / kIdsPerStretch == items[begin].a / kIdsPerStretch;) ++end;
      for (std::size_t k = end - begin; k > 1; --k) std::swap(items[begin + k - 1], items[begin + state_.rng.below(k)]);
      for (std::size_t first = begin; first < end; first += Refiller::kItemsPerBatch) {
        report_progress();
        next.items = items.data() + first;
        next.count = std::min(Refiller::kItemsPerBatch, end - first);
        plan(next);
        try_beside(next, tried);
        std::swap(tried, next);
      }
    }
    next.count = 0;
    try_beside(next, tried);
    carry_out_alone();
  }

  void plan(Batch& batch) {
    const std::uint64_t seed = state_.rng.next();
    state_.see_changes();
    batch.planned_at = refiller_.time();
    batch.plans.resize(std::max(batch.plans.size(), batch.count));
    batch.rngs.clear();
    batch.proposals.assign(batch.count, Proposal());
    for (std::size_t k = 0; k < batch.count; ++k) {
      Rng rng(scramble(seed + k));
      if (state_.is_current(batch.items[k])) {
        planner_.plan(batch.items[k], rng, batch.plans[k]);
      } else {
        batch.plans[k].clear();
      }
      batch.rngs.push_back(rng);
    }
  }

  /// Begins what was proposed for one batch, in order, while others make the trials of the next, which see nothing of it; then
  /// it is carried out side by side. So it comes out the same where one thread does all.
  void try_beside(Batch& next, Batch& tried) {
    const std::size_t tasks = (next.count + kItemsPerTask - 1) / kItemsPerTask;
    const auto run_task = [&](std::size_t task) {
      if (task == 0) {
        carry_out_alone();
        begin(tried);
        return;
      }
      RefillFinder finder = state_.finder();
      finder.look_at(state_.seen);
      const std::size_t first = (task - 1) * kItemsPerTask, last = std::min(first + kItemsPerTask, next.count);
      for (std::size_t k = first; k < last; ++k) next.proposals[k] = finder.find(next.plans[k], next.rngs[k]);
    };
    const bool complete = completes([&] {
      parallel_for(1 + tasks, 1, visiting_, [&](std::size_t begin, std::size_t end) {
        for (std::size_t task = begin; task < end; ++task) run_task(task);
      });
    });
    // What has begun is brought to its end, come what may.
    parallel_for(refiller_.num_begun(), 1, visiting_.without_progress(), [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) refiller_.carry_out_beside(k);
    });
    refiller_.end_batch();
    if (!complete) visiting_.check();
  }

  /// Between edits a cancel ends it.
  void begin(Batch& batch) {
    if (batch.count == 0) return;
    refiller_.begin_batch();
    for (std::size_t k = 0; k < batch.count; ++k) {
      visiting_.check();
      state_.report.trials += batch.proposals[k].trials;
      if (refiller_.begin(batch.items[k], batch.proposals[k], batch.planned_at) != Refiller::Begun::kAlone) continue;
      alone_.push_back({batch.items[k], std::move(batch.proposals[k]), batch.planned_at});
    }
  }

  /// What could not be carried out beside others of its batch.
  void carry_out_alone() {
    for (const ItemAlone& alone : alone_) {
      visiting_.check();
      refiller_.carry_out(alone.item, alone.proposal, alone.planned_at);
    }
    alone_.clear();
  }

  /// Between edits: a cancel ends it here.
  void report_progress() {
    state_.samples.compact(visiting_);
    const double change = refiller_.energy_change_of_all() - energy_change_then_;
    const double by_iterations = static_cast<double>(iteration_) / options().max_iterations;
    visiting_.report(std::max(by_iterations, estimate_.share(state_.report.iterations.back().energy + change, giving_up_)));
  }

  /// What no refill improves is refilled all the same, of up to `max_more` samples more than usual, and what that has made bad
  /// is improved in turn.
  void force_refills(const std::vector<BadItem>& items, int max_more) {
    const std::size_t n = std::min(std::max(items.size(), kMinForced), kMaxForced);
    const std::uint64_t accepted = state_.report.accepted;
    for (std::size_t k = 0; k < n && (k < items.size() || state_.report.accepted == accepted); ++k) {
      report_progress();
      const BadItem& item = items[k % items.size()];
      if (!state_.is_current(item)) continue;
      force_refill(item, 1 + static_cast<int>(state_.rng.below(static_cast<std::uint64_t>(max_more))));
    }
  }

  /// Undone should the whole be no improvement.
  void force_refill(const BadItem& item, int more) {
    RefillFinder finder = state_.finder();
    const std::uint64_t accepted = state_.report.accepted;
    EditSeries series;
    refiller_.record(&series);
    refiller_.refill_in_place(item, Refiller::Accept::kAny, more);
    for (int round = 0; round < kRoundsAfterForcing && !(series.energy_change < -kMinGain) && !refiller_.is_cancelled();
         ++round) {
      const std::size_t edits = series.changes.size();
      for (const BadItem& bad : bad_items_of(series)) {
        if (!state_.is_current(bad) || refiller_.is_cancelled()) continue;
        const Proposal proposal = finder.find(bad, Rng(state_.rng.next()));
        state_.report.trials += proposal.trials;
        refiller_.carry_out(bad, proposal, refiller_.time());
      }
      if (series.changes.size() == edits) break;
    }
    refiller_.record(nullptr);
    if (series.energy_change < -kMinGain) return;
    refiller_.undo(series);
    state_.report.accepted = accepted;
  }

  /// What is bad where these edits were.
  std::vector<BadItem> bad_items_of(const EditSeries& series) {
    std::vector<Index> affected;
    for (const SampleChange& change : series.changes) {
      affected.insert(affected.end(), change.affected.begin(), change.affected.end());
    }
    std::sort(affected.begin(), affected.end());
    affected.erase(std::unique(affected.begin(), affected.end()), affected.end());
    std::vector<BadItem> items;
    for (const Index s : affected) {
      if (state_.samples.alive(s) && state_.stars.energy[slot(s)] > 0) state_.reader.list_bad(s, items);
    }
    return items;
  }

  const Execution& execution_;
  Execution visiting_;
  OptimizeState state_;
  Refiller refiller_;
  const RefillFinder planner_ = state_.finder();
  TimeEstimate estimate_;
  std::vector<ItemAlone> alone_;
  double energy_change_then_ = 0, giving_up_ = 0;
  const Index num_given_;
  int iteration_ = 0;
  Stopwatch watch_;
  double seconds_ = 0;
};

}  // namespace

OptimizeOptions scaled_options(const OptimizeOptions& options, const MeshScale& scale) {
  OptimizeOptions result = options;
  result.radius = scale.length(options.radius);
  result.sizing = SizingFieldAccess::scaled(options.sizing, scale);
  return result;
}

void require_optimize_options(const OptimizeOptions& options) {
  const auto fail = [](const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "optimisation: " + what); };
  const auto bounded = [](double x, double low, double high) { return x == 0 || (x > low && x < high); };
  if (!bounded(options.min_angle, 0, 60)) {
    fail("min_angle is " + number_text(options.min_angle) + "; it must be above 0 and below 60 degrees, or 0 for the default");
  }
  if (!bounded(options.max_angle, 60, 180)) {
    fail("max_angle is " + number_text(options.max_angle) +
         "; it must be above 60 and below 180 degrees, or 0 for the default");
  }
  if (options.max_iterations < 0)
    fail("max_iterations is " + std::to_string(options.max_iterations) + "; it must be at least 0");
  require_neighborhood(options.neighborhood, options.conflict_rule);
  if (!(options.radius >= 0 && std::isfinite(options.radius))) fail("the radius must be finite and not negative");
  if (options.radius > 0 && !options.sizing.empty()) fail("set a radius or a sizing field, not both");
  if (options.refills < 1) fail("refills is " + std::to_string(options.refills) + "; it must be at least 1");
}

namespace {

std::pair<double, double> bounds_of(const OptimizeOptions& options, bool uniform) {
  return {options.min_angle != 0 ? options.min_angle
          : uniform              ? 35
                                 : 32,
          options.max_angle != 0 ? options.max_angle
          : uniform              ? 105
                                 : 114};
}

}  // namespace

double expected_growth(const OptimizeOptions& options, bool uniform) {
  // Medians over sphere, bunny and fertility, 8k samples: [30.5, 119], [35, 105], [38, 100], [42, 90], [45, 85].
  constexpr std::array<std::array<double, 2>, 5> kGrowth = {{{0, 0.008}, {5, 0.013}, {8, 0.023}, {12, 0.041}, {15, 0.045}}};
  const auto [low, high] = bounds_of(options, uniform);
  const double tightness = tightness_of(low, high);
  if (!options.angles) return options.valences ? kGrowth[0][1] : 0;
  std::size_t k = 1;
  while (k + 1 < kGrowth.size() && tightness > kGrowth[k][0]) ++k;
  const double t = std::min(std::max((tightness - kGrowth[k - 1][0]) / (kGrowth[k][0] - kGrowth[k - 1][0]), 0.0), 1.0);
  return kGrowth[k - 1][1] + t * (kGrowth[k][1] - kGrowth[k - 1][1]);
}

double optimization_cost(const OptimizeOptions& options, double samples, bool uniform) {
  // At the paper's bounds, and how it grows with tightness (seven times at [42, 90]).
  constexpr double kUsualCost = 9, kMinCost = 6, kGrowthPerDegree = 0.28, kUsualTightness = 5;
  const auto [low, high] = bounds_of(options, uniform);
  if (!options.angles) return kMinCost * samples;
  return samples *
         std::max(kMinCost, kUsualCost * portable_exp(kGrowthPerDegree * (tightness_of(low, high) - kUsualTightness)));
}

OptimizeReport optimize_diagram(RestrictedPowerDiagram& diagram, SampleSet& samples, const OptimizeSurface& surface,
                                const OptimizeOptions& options, std::vector<Index>& ids) {
  require_optimize_options(options);
  const Execution execution = options.execution.start("improving triangles");
  // Default bounds follow what is wanted, not what curves and folds have made of it.
  const bool uniform = options.radius > 0 || radii_of(options, samples).uniform();
  const auto [min_angle, max_angle] = bounds_of(options, uniform);
  Optimizer optimizer(diagram, samples, surface, options, min_angle, max_angle, execution);
  if (surface.disks != nullptr && surface.disks->knows_surface() && !samples.facets.empty()) {
    // The disks have all that is in them, 60 bytes a sample.
    samples.positions = Points();
    samples.barycentrics = Points();
    samples.radii = std::vector<double>();
    samples.facets = std::vector<Index>();
  }
  OptimizeReport report = optimizer.run();
  optimizer.write_samples(samples, ids);
  if (report.status != Outcome::kCancelled) execution.finish();
  return report;
}

namespace {

/// Fills gaps first if there are any. `result` (in: cancelled) has the best samples so far.
void optimize_or_fill(const MeshView& mesh, const SampleSet& samples, OptimizeOptions options, const Execution& execution,
                      OptimizeResult& result) {
  std::vector<Index> ids;
  require_sample_set(samples);
  const double least = min_radius(samples);
  if (options.radius > least && options.neighborhood != Neighborhood::kSurface) {
    throw Error(ErrorCode::kInvalidArgument, "optimisation: new disks of radius " + number_text(options.radius) +
                                                 " could cover samples; use at most the least radius, " + number_text(least));
  }
  const double max_radius = std::max(radii_of(options, samples).max_of_set(), options.radius);
  SetDiagram set = diagram_of(mesh, samples, options.neighborhood, max_radius, execution.part(0, 0.25));
  OptimizeSurface surface;
  surface.disks = set.disks.get();
  if (!has_gaps(set.diagram, execution.part(0.25, 0.27))) {
    options.execution = execution.part(0.27, 1);
    result.samples = samples;
    result.report = optimize_diagram(set.diagram, result.samples, surface, options, ids);
    return;
  }
  SamplingOptions filling;
  filling.sizing = options.sizing;
  filling.radius = options.radius;
  filling.conflict_rule = options.conflict_rule;
  filling.seed = options.seed;
  filling.neighborhood = options.neighborhood;
  filling.execution = execution.part(0.27, 0.5);
  SamplingResult filled = fill_gaps(mesh, samples, filling);
  result.samples = std::move(filled.samples);
  const Index num_filled = result.samples.size();
  result.report.added = num_filled - samples.size();
  if (filled.status == Outcome::kCancelled) return;
  set = diagram_of(mesh, result.samples, options.neighborhood, max_radius, execution.part(0.5, 0.6));
  surface.disks = set.disks.get();
  options.execution = execution.part(0.6, 1);
  result.report = optimize_diagram(set.diagram, result.samples, surface, options, ids);
  const auto first_new = ids.begin() + (num_filled - result.report.removed);
  const auto kept = static_cast<Index>(std::count_if(ids.begin(), first_new, [&](Index s) { return s < samples.size(); }));
  result.report.removed = samples.size() - kept;
  result.report.added = result.samples.size() - kept;
}

}  // namespace
}  // namespace detail

OptimizeResult optimize(const MeshView& mesh, const SampleSet& samples, const OptimizeOptions& options) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    OptimizeResult result = scale.in_our_units([&] {
      return optimize(scale.mesh(mesh), detail::scaled_samples(samples, scale), detail::scaled_options(options, scale));
    });
    detail::scale_back(result.samples, scale);
    return result;
  }
  detail::require_optimize_options(options);
  if (!options.sizing.empty() && !options.sizing.fits(mesh)) {
    throw Error(ErrorCode::kInvalidArgument, "optimisation: the sizing field is of another mesh (" +
                                                 std::to_string(options.sizing.num_facets()) + " facets; this one has " +
                                                 std::to_string(mesh.num_facets()) +
                                                 "); make it from the mesh the samples are on");
  }
  const Execution execution = options.execution.start();
  OptimizeResult result;
  result.report.status = Outcome::kCancelled;
  detail::completes([&] { detail::optimize_or_fill(mesh, samples, options, execution, result); });
  if (result.samples.size() == 0) result.samples = samples;
  if (result.report.status != Outcome::kCancelled) execution.finish();
  return result;
}

void write_convergence(std::ostream& stream, const OptimizeReport& report) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out.precision(9);
  out << "iteration,bad_triangles,bad_vertices,min_angle,max_angle,samples,energy,seconds\n";
  for (std::size_t k = 0; k < report.iterations.size(); ++k) {
    const OptimizeIteration& line = report.iterations[k];
    out << k << ',' << line.bad_triangles << ',' << line.bad_vertices << ',' << line.min_angle << ',' << line.max_angle << ','
        << line.samples << ',' << line.energy << ',' << line.seconds << '\n';
  }
  stream << out.str();
}

std::ostream& operator<<(std::ostream& out, const OptimizeReport& report) {
  out << "optimisation to [" << report.min_angle << ", " << report.max_angle << "] degrees: " << name_of(report.status);
  if (!report.iterations.empty()) {
    const OptimizeIteration &first = report.iterations.front(), &last = report.iterations.back();
    out << " after " << report.iterations.size() - 1 << " iterations; bad triangles " << first.bad_triangles << " -> "
        << last.bad_triangles << ", bad vertices " << first.bad_vertices << " -> " << last.bad_vertices;
  }
  return out << "; samples -" << report.removed << " +" << report.added;
}

}  // namespace amps
