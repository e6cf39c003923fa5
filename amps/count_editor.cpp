#define AMPS_OWN_SOURCE
#include "amps/count_editor.h"

#include "amps/gap_filling.h"
#include "amps/refill.h"
#include "amps/sample_edit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <queue>
#include <string>
#include <utility>
#include <vector>

namespace amps::detail {
namespace {

/// What a refill may add to the energy of triangles: nothing at first. So many tries in a row that fail lead to the next one.
constexpr std::array<double, 5> kMostEnergy = {kMinGain, 1, 4, 16, INFINITY};
constexpr int kTriesPerEnergy = 1000;
/// Refills tried of each patch, in a copy.
constexpr int kRefillsPerCopy = 16;
/// Samples taken out of a patch at most: larger ones cost more to copy, and give no more choice.
constexpr int kMaxPatch = 4;
/// Where copies find nothing: patches tried in a row in the diagram itself, their samples at most, and refills of each.
constexpr int kPatchesInPlace = 48, kMaxPatchInPlace = 7, kRefillsPerPatch = 6;
/// Samples for one refill of the diagram at most: far more than fit where a few have been taken out.
constexpr Index kMaxSamplesInPlace = 64;
/// Shares of the wanted radii that are tried in turn where no more samples fit.
constexpr std::array<double, 7> kSmallerRadii = {0.97, 0.94, 0.9, 0.85, 0.78, 0.65, 0.5};
/// Edits of the diagram end when they have changed so many fragments, about 2 µs each, and so many more for each sample to be
/// added or taken out: cells of few samples have thousands of fragments on fine meshes.
constexpr double kMostWork = 1e6, kWorkPerSample = 2000;
/// Samples that enter with smaller disks are at most this share of those there are.
constexpr double kMostSmaller = 1;
/// Samples whose removal is tried, at least, and for each one that has to go.
constexpr Index kMinCandidates = 256, kCandidatesPerSample = 4;
/// Bounds of what is taken out singly: how far a point may come to be from all samples, in radii, and the share of the samples
/// that may go. Beyond, the set would be another one, not one that lacks its last samples.
constexpr double kMostCoverage = 2;
constexpr double kMostTakenOut = 0.5;
/// Refills do with a fifth less at best: where more than this share would have to go in all, none of it is tried.
constexpr double kMostFewer = 0.6;
/// Visits to what refills have made bad, to make it good again.
constexpr int kRepairRounds = 12;
/// Draws of an id until it is that of a sample that may go.
constexpr int kDrawsOfSample = 256;

class CountEditor {
 public:
  CountEditor(const CountedSet& set, const Execution& execution, ExactCountReport& report)
      : set_(set),
        execution_(execution),
        report_(report),
        diagram_(set.diagram),
        radii_(set.radii.beside(min_radius(set.samples), max_radius(set.samples))),
        balls_(set.disks != nullptr ? nullptr : std::make_unique<DiskSet>(balls(radii_.min_of_set()))),
        samples_(set.diagram, set.samples, set.ids, balls_ != nullptr ? *balls_ : *set.disks, execution.part(0, 0.05)),
        reader_(diagram_, set.rating, set.num_fixed),
        finder_(diagram_, stars_, set.rating, radii_, kRefillsPerCopy, set.num_fixed),
        filler_(std::make_unique<GapFiller>(diagram_, samples_.disks(), radii_)),
        rng_(set.seed),
        count_(set.samples.size()),
        first_missing_(std::abs(missing())) {
    stars_.resize(slot(samples_.size()));
    Ticker ticker(execution.part(0.05, 0.2), slot(samples_.size()), kElementsPerLook);
    for (Index s = 0; s < samples_.size(); ++s) {
      ticker.tick();
      if (samples_.alive(s)) stars_.read(reader_, s);
    }
    execution_ = execution.part(0.2, 0.95);
  }

  void run() {
    if (missing() < 0 && count_ + missing() < set_.num_fixed) {
      report_.obstacle = CountObstacle::kCurves;
      return;
    }
    refill_by_copies(kMostEnergy.front());
    if (-missing() > kMostFewer * (count_ - set_.num_fixed)) {
      report_.obstacle = CountObstacle::kCoverage;
      return;
    }
    begin_costly();
    for (std::size_t k = 1; k < kMostEnergy.size(); ++k) refill_by_copies(kMostEnergy[k]);
    refill_in_place(kPatchesInPlace);
    repair();
    if (missing() > 0) refill_smaller();
    if (missing() < 0) take_out_singly();
    if (missing() == 0) return;
    report_.obstacle = missing() > 0 ? CountObstacle::kNoRoom : CountObstacle::kCoverage;
    undo_costly();
  }

  /// In: the samples given to the constructor. Returns how many of these are left.
  Index write(SampleSet& samples, std::vector<Index>& ids) {
    samples_.collect(samples, ids);
    report_.after = samples.size();
    report_.cost = std::max(0.0, cost_);
    measure_coverage();
    return static_cast<Index>(std::count_if(ids.begin(), ids.end(), [&](Index s) { return !samples_.is_new(s); }));
  }

 private:
  /// Samples that are to be added; negative: taken out.
  Index missing() const { return report_.wanted - count_; }
  int direction() const { return missing() > 0 ? 1 : -1; }

  void tell() const {
    const double left = static_cast<double>(std::abs(missing())) / std::max(Index{1}, first_missing_);
    execution_.report(1 - std::min(1.0, left));
  }

  DiskSet balls(double least) const { return DiskSet(VoxelGrid(bounding_box(diagram_.mesh()), least, radii_.max_of_set())); }

  void count_work(SampleEdit& edit) { work_ += static_cast<double>(edit.changed_fragments().size()); }
  bool has_time() const { return work_ < kMostWork + kWorkPerSample * first_missing_; }

  /// A random sample that may go; kNone if none was found.
  Index draw_sample() {
    const auto range = static_cast<std::uint64_t>(samples_.size() - set_.num_fixed);
    if (range == 0) return kNone;
    for (int draw = 0; draw < kDrawsOfSample; ++draw) {
      const Index s = set_.num_fixed + static_cast<Index>(rng_.below(range));
      if (samples_.alive(s)) return s;
    }
    return kNone;
  }

  /// Refills that raise the energy by less than `most`, until so many tries in a row have failed.
  void refill_by_copies(double most) {
    for (int tries = 0; missing() != 0 && tries < kTriesPerEnergy; ++tries) {
      tell();
      samples_.compact(execution_);
      const Index s = draw_sample();
      if (s == kNone) return;
      const int change = direction(), least = change < 0 ? 2 : 1;
      const int size = least + static_cast<int>(rng_.below(static_cast<std::uint64_t>(kMaxPatch - least + 1)));
      const Proposal proposal = finder_.find_of_count(s, change, size, most, Rng(rng_.next()));
      if (proposal.kind == Proposal::Kind::kRefill && carry_out(proposal, change, most)) tries = 0;
    }
  }

  /// Edits from now on are undone where the number cannot be met: what is missed is to cost nothing.
  void begin_costly() {
    is_costly_ = true;
    cheap_ = report_;
    cheap_count_ = count_;
    cheap_cost_ = cost_;
  }
  void undo_costly() {
    SampleEdit::undo_all(samples_, costly_);
    const CountObstacle obstacle = report_.obstacle;
    report_ = cheap_;
    report_.obstacle = obstacle;
    count_ = cheap_count_;
    cost_ = cheap_cost_;
  }

  /// What a copy has promised; kept if it is true, of `change` samples more, and raises the energy by less than `most`.
  bool carry_out(const Proposal& proposal, int change, double most) {
    if (static_cast<Index>(proposal.removed.size()) >= count_) return false;
    SampleEdit edit(samples_, proposal.removed);
    if (!samples_.are_apart(proposal.added, radii_.rule())) {  // some disk of another sheet
      edit.undo();
      return false;
    }
    Index near = proposal.removed.front();
    for (const Sample& sample : proposal.added) near = edit.enter(sample, near);
    edit.take_out();
    if (fill(*filler_, edit) && change_of(edit) == change && is_good(edit, most)) {
      keep(edit);
      if (change != 0) ++report_.refills;
      return true;
    }
    edit.undo();
    return false;
  }

  static int change_of(const SampleEdit& edit) {
    return static_cast<int>(edit.added().size()) - static_cast<int>(edit.removed().size());
  }

  /// Until no gap is left where the edit has changed something; false if that takes too many samples.
  static bool fill(GapFiller& filler, SampleEdit& edit, Rng& rng) {
    GapFillLimits limits;
    limits.max_samples = kMaxSamplesInPlace;
    filler.look_at(edit.changed_fragments());
    const GapFilling filling = filler.fill(rng, limits, [&](const Sample& sample, Index near) { edit.enter(sample, near); });
    filler.forget();
    return filling.complete();
  }
  bool fill(GapFiller& filler, SampleEdit& edit) { return fill(filler, edit, rng_); }

  /// Reads the stars it affects, for keep().
  bool is_good(SampleEdit& edit, double most) {
    const std::vector<Index>& affected = edit.affected();
    double before = 0, after = 0;
    for (const SampleChange::Removed& old : edit.removed()) before += stars_.energy[slot(old.id)];
    new_stars_.resize(affected.size());
    for (std::size_t k = 0; k < affected.size(); ++k) {
      if (!edit.has_added(affected[k])) before += stars_.energy[slot(affected[k])];
      after += new_stars_.energy[k] = reader_.energy(affected[k], new_stars_.star[k]);
    }
    energy_change_ = after - before;
    return energy_change_ < most && !hides_a_sample(edit) && keeps_topology(edit);
  }

  /// By the min rule a disk may cover smaller ones.
  bool hides_a_sample(SampleEdit& edit) const {
    if (radii_.rule() == ConflictRule::kMax) return false;
    const auto is_hidden = [&](Index s) { return diagram_.first_of_site(s) == kNone; };
    const std::vector<Index>&added = edit.added(), &affected = edit.affected();
    return std::any_of(added.begin(), added.end(), is_hidden) || std::any_of(affected.begin(), affected.end(), is_hidden);
  }

  bool keeps_topology(SampleEdit& edit) {
    if (set_.topology == nullptr) return true;
    const TopologyCertificate certificate =
        set_.topology->check(diagram_, set_.topology_samples, edit.affected(), topology_scratch_);
    // Gaps may be there by intent. Cells that meet as they should make a dual of the right topology without covering all.
    return certificate.num_failures(TopologyFailureKind::kUncovered) == static_cast<Index>(certificate.failures.size());
  }

  /// What is_good() was last asked of.
  void keep(SampleEdit& edit) {
    count_ += change_of(edit);
    cost_ += energy_change_;
    SampleChange change = edit.keep();
    stars_.resize(slot(samples_.size()));
    for (std::size_t k = 0; k < change.affected.size(); ++k) {
      const Index s = change.affected[k];
      stars_.energy[slot(s)] = new_stars_.energy[k];
      stars_.star.set(slot(s), new_stars_.star[k]);
      if (energy_change_ > kMinGain) touched_.push_back(s);
    }
    if (is_costly_) costly_.push_back(std::move(change));
  }

  /// A sample and others around it, by triangles of the dual; at most `size`.
  std::vector<Index> random_patch(Index s, std::size_t size) {
    std::vector<Index> patch = {s};
    for (std::size_t draw = 0; draw < 4 * size && patch.size() < size; ++draw) {
      const auto& pairs = reader_.read(patch[rng_.below(patch.size())]);
      if (pairs.empty()) continue;
      const Index t = pairs[rng_.below(pairs.size())][rng_.below(2)];
      if (t >= set_.num_fixed && std::find(patch.begin(), patch.end(), t) == patch.end()) patch.push_back(t);
    }
    return patch;
  }

  /// Random refills by this filler, until so many patches in a row have brought nothing.
  Index refill_in_place(int patches) {
    Index refilled = 0;
    for (int tries = 0; missing() != 0 && tries < patches && has_time(); ++tries) {
      tell();
      samples_.compact(execution_);
      const Index s = draw_sample();
      if (s == kNone) break;
      const std::vector<Index> patch = random_patch(s, 1 + rng_.below(kMaxPatchInPlace));
      if (static_cast<Index>(patch.size()) >= count_) continue;
      SampleEdit edit(samples_, patch);
      edit.take_out();
      bool kept = false;
      for (int refill = 0; refill < kRefillsPerPatch && !kept; ++refill) {
        const bool filled = fill(*filler_, edit);
        count_work(edit);
        const int change = change_of(edit) * direction();
        kept = filled && change > 0 && change <= std::abs(missing()) && is_good(edit, INFINITY);
        if (!kept) edit.withdraw();
      }
      if (!kept) {
        edit.undo();
        continue;
      }
      keep(edit);
      ++refilled;
      tries = -1;
    }
    report_.refills += refilled;
    return refilled;
  }

  /// What has become bad is refilled with as many samples as there are.
  void repair() {
    for (int round = 0; round < kRepairRounds && !touched_.empty(); ++round) {
      std::vector<Index> bad = std::exchange(touched_, {});
      std::sort(bad.begin(), bad.end());
      bad.erase(std::unique(bad.begin(), bad.end()), bad.end());
      for (const Index at : bad) {
        if (!samples_.alive(at) || !(stars_.energy[slot(at)] > 0)) continue;
        tell();
        const Index s = at >= set_.num_fixed ? at : neighbor_that_may_go(at);
        if (s == kNone) continue;
        const int size = 1 + static_cast<int>(rng_.below(kMaxPatch));
        const Proposal proposal = finder_.find_of_count(s, 0, size, -kMinGain, Rng(rng_.next()));
        if (proposal.kind != Proposal::Kind::kRefill || !carry_out(proposal, 0, -kMinGain)) touched_.push_back(at);
      }
    }
    touched_.clear();
  }

  Index neighbor_that_may_go(Index s) {
    for (const StarReader::Pair& pair : reader_.read(s)) {
      if (pair[1] >= set_.num_fixed) return pair[1];
    }
    return kNone;
  }

  /// Refills with smaller disks than are wanted.
  void refill_smaller() {
    if (missing() > kMostSmaller * count_) return;
    if (balls_ != nullptr) {
      // A grid for all radii there will be.
      const double least = kSmallerRadii.back() * radii_.min_of_set();
      if (!VoxelGrid::fits(bounding_box(diagram_.mesh()), least, radii_.max_of_set())) return;
      *balls_ = balls(least);
      for (Index s = 0; s < samples_.size(); ++s) {
        if (samples_.alive(s)) balls_->insert(samples_[s], s);
      }
    }
    for (const double share : kSmallerRadii) {
      if (missing() <= 0) return;
      const WantedRadii smaller = radii_.scaled(share);
      filler_ = std::make_unique<GapFiller>(diagram_, samples_.disks(), smaller);
      report_.smaller += refill_in_place(kPatchesInPlace);
      filler_.reset();
    }
  }

  /// The greatest distance over the radius at these fragments.
  double worst_ratio(const std::vector<Index>& fragments) const {
    double worst = 0;
    std::vector<Vec3> corners;
    for (const Index f : fragments) {
      if (!diagram_.alive(f)) continue;
      const auto polygon = diagram_.polygon(f);
      if (polygon.site == kNone) return INFINITY;
      const WeightedPoint& site = diagram_.site(polygon.site);
      polygon.list_corners(corners);
      for (const Vec3& x : corners) worst = std::max(worst, squared_norm(x - site.position()) / site.w);
    }
    return std::sqrt(worst);
  }

  /// How well the surface is covered around a sample without it; infinite if it has to stay.
  double coverage_without(Index s) {
    SampleEdit edit(samples_, {s});
    edit.take_out();
    double worst = worst_ratio(edit.changed_fragments());
    count_work(edit);
    if (!(worst <= kMostCoverage) || !keeps_topology(edit)) worst = INFINITY;
    edit.undo();
    return worst;
  }

  /// Those first that leave the surface covered best. Costs only grow as neighbours go, so that they are looked at anew only
  /// where they are the least.
  void take_out_singly() {
    if (-missing() > kMostTakenOut * (count_ - set_.num_fixed)) return;
    using Entry = std::pair<double, Index>;
    for (bool helps = true; helps && missing() < 0;) {
      std::priority_queue<Entry, std::vector<Entry>, std::greater<Entry>> queue;
      for (const Index s : candidates()) {
        tell();
        if (!has_time()) return;
        const double cost = coverage_without(s);
        if (std::isfinite(cost)) queue.push({cost, s});
      }
      helps = false;
      while (missing() < 0 && !queue.empty() && count_ > 1 && has_time()) {
        tell();
        samples_.compact(execution_);
        const Index s = queue.top().second;
        queue.pop();
        const double cost = coverage_without(s);
        if (!std::isfinite(cost)) continue;
        if (!queue.empty() && cost > queue.top().first) {
          queue.push({cost, s});
          continue;
        }
        SampleEdit edit(samples_, {s});
        edit.take_out();
        is_good(edit, INFINITY);
        keep(edit);
        ++report_.taken_out;
        helps = true;
      }
    }
  }

  /// Samples whose removal is tried: all that may go if they are few, else some of them.
  std::vector<Index> candidates() {
    if (count_ <= 1) return {};
    std::vector<Index> all;
    for (Index s = set_.num_fixed; s < samples_.size(); ++s) {
      if (samples_.alive(s)) all.push_back(s);
    }
    const auto most = slot(std::max(kMinCandidates, kCandidatesPerSample * -missing()));
    if (all.size() <= most) return all;
    for (std::size_t k = 0; k < most; ++k) std::swap(all[k], all[k + rng_.below(all.size() - k)]);
    all.resize(most);
    return all;
  }

  void measure_coverage() const {
    std::vector<Index> fragments;
    bool has_gap = false;
    for (Index f = 0; f < diagram_.fragment_capacity(); ++f) {
      if (!diagram_.alive(f)) continue;
      fragments.push_back(f);
      has_gap = has_gap || !diagram_.covered(diagram_.polygon(f));
    }
    const double worst = worst_ratio(fragments);
    report_.coverage = has_gap ? std::max(worst, std::nextafter(1.0, 2.0)) : std::min(worst, 1.0);
  }

  const CountedSet& set_;
  Execution execution_;
  ExactCountReport& report_;
  const RestrictedPowerDiagram& diagram_;
  const WantedRadii radii_;
  const std::unique_ptr<DiskSet> balls_;
  EditableSamples samples_;
  StarReader reader_;
  DualStars stars_;          ///< up to date between edits
  AffectedStars new_stars_;  ///< of the present edit
  RefillFinder finder_;
  std::unique_ptr<GapFiller> filler_;
  TopologyChecker::Scratch topology_scratch_;
  Rng rng_;
  Index count_;
  const Index first_missing_;
  double energy_change_ = 0, cost_ = 0;
  double work_ = 0;             ///< fragments changed, but by refills that were tried in copies
  std::vector<Index> touched_;  ///< samples that edits have made worse
  bool is_costly_ = false;
  std::vector<SampleChange> costly_;  ///< edits since then, when all was as follows
  ExactCountReport cheap_;
  Index cheap_count_ = 0;
  double cheap_cost_ = 0;
};

}  // namespace

Index meet_count(const CountedSet& set, const Execution& execution, ExactCountReport& report) {
  Stopwatch watch;
  report.asked = true;
  report.before = report.after = set.samples.size();
  CountEditor editor(set, execution, report);
  const bool complete = completes([&] { editor.run(); });
  const Index left = editor.write(set.samples, set.ids);
  report.seconds += watch.lap();
  if (!complete) throw Error(ErrorCode::kCancelled, "exact count: cancelled");
  return left;
}

}  // namespace amps::detail
