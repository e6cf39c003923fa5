#define AMPS_OWN_SOURCE
#include "amps/optimize.h"

#include "amps/dual_star.h"
#include "amps/gap_filling.h"
#include "amps/gaps.h"
#include "amps/maximality.h"
#include "amps/portable_math.h"
#include "amps/refill.h"
#include "amps/sample_edit.h"
#include "amps/sizing_lattice.h"
#include "amps/disk_set.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <locale>
#include <memory>
#include <optional>
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
/// Edits spent on vertices at crossings, 0.2 ms each, beyond one for every fourth sample. Where a surface meets itself there
/// may be no end of them.
constexpr std::uint64_t kEditsAtCrossings = 500;
constexpr std::uint64_t kSamplesPerEditAtCrossings = 4;
/// Items are visited in stretches of so many ids, which mostly follow a curve in space, so that memory is at hand; in each
/// stretch in random order.
constexpr Index kIdsPerStretch = 4096;
/// Items planned before those of the batch before are carried out: with more, more of what was found is out of date.
constexpr std::size_t kItemsPerBatch = 8;
/// Items a thread takes at a time.
constexpr std::size_t kItemsPerTask = 2;
/// Room is made for one sample more for so many: ids are used again, and most sets grow by less. (Doubling: 5 MiB at 100k.)
constexpr std::size_t kSamplesPerRoom = 8;
/// Stars a thread reads at a time.
constexpr std::size_t kStarsPerTask = 1024;
/// Beside curves much may be out of reach: corners that are too narrow, radii that fall too fast. Optimisation ends where so
/// many iterations leave more than this share of the energy.
constexpr int kIterationsAtCurves = 8;
constexpr double kLeftAtCurves = 0.9;
/// Samples or fragments between two looks for a cancel, in loops that take up to 1 µs for each.
constexpr std::uint64_t kEntriesPerLook = 4096;
/// Refills of the diagram itself, where a patch cannot be copied.
constexpr int kRefillsInPlace = 8;
/// Of three such refills one takes out so many neighbours too.
constexpr int kNeighborsInPlace = 2;
/// Samples for one refill of the diagram at most: far more than fit where a few have been taken out.
constexpr Index kMaxRefillSamples = 64;

/// Radii of samples to come beside those there are.
WantedRadii radii_of(const OptimizeOptions& options, const SampleSet& samples) {
  const double min = min_radius(samples), max = max_radius(samples);
  const WantedRadii wanted = options.sizing.empty()
                                 ? WantedRadii(options.radius > 0 ? options.radius : min, options.conflict_rule)
                                 : WantedRadii(options.sizing, options.conflict_rule);
  return wanted.beside(min, max);
}

/// Balls, none yet: for the samples there are and those to come.
DiskSet balls_for(const MeshView& mesh, const WantedRadii& radii) {
  const double min = radii.min_of_set(), max = radii.max_of_set();
  const Box box = bounding_box(mesh);
  if (!VoxelGrid::fits(box, min, max)) {
    throw Error(ErrorCode::kTooLarge, "optimisation: radii from " + number_text(min) + " to " + number_text(max) +
                                          " are out of proportion to the mesh's diagonal " + number_text(box.diagonal()) +
                                          "; stay between 1e-6 and 1e6 of it");
  }
  return DiskSet(VoxelGrid(box, min, max));
}

/// What the parts of the optimiser work on.
struct OptimizeState {
  OptimizeState(RestrictedPowerDiagram& given, const SampleSet& set, const OptimizeSurface& surface,
                const OptimizeOptions& given_options, double min_angle, double max_angle, const Execution& execution)
      : diagram(given),
        num_fixed(surface.num_fixed),
        topology(surface.topology),
        topology_samples(surface.samples),
        options(given_options),
        rating(options.angles, options.valences, min_angle, max_angle),
        reader(diagram, rating, num_fixed),
        radii(radii_of(options, set).with_caps(surface.caps)),
        balls(surface.disks != nullptr ? nullptr : std::make_unique<DiskSet>(balls_for(diagram.mesh(), radii))),
        samples(given, set, surface.disks != nullptr ? *surface.disks : *balls, execution.part(0, 0.3)),
        rng(options.seed) {
    report.min_angle = min_angle;
    report.max_angle = max_angle;
    const std::size_t n = slot(samples.size());
    stars.resize(n);
    seen.reserve(n + n / kSamplesPerRoom);
    seen.resize(n);
    std::vector<std::vector<std::pair<std::size_t, DualStar>>> large((n + kStarsPerTask - 1) / kStarsPerTask);
    for_each_piece_on_all_threads(n, kStarsPerTask, execution.part(0.3, 1), [&](std::size_t begin, std::size_t end) {
      StarReader own(diagram, rating, num_fixed);
      DualStar star;
      for (std::size_t s = begin; s < end; ++s) {
        stars.energy[s] = own.energy(static_cast<Index>(s), star);
        if (!stars.star.set_small(s, star)) large[begin / kStarsPerTask].emplace_back(s, star);
        seen.site[s] = diagram.site(static_cast<Index>(s));
      }
    });
    for (const auto& of_piece : large) {
      for (const auto& [s, star] : of_piece) stars.star.set(s, star);
    }
    seen.star = stars.star;
  }
  OptimizeState(const OptimizeState&) = delete;

  const RestrictedPowerDiagram& diagram;
  const Index num_fixed;  ///< samples below stay where they are
  const TopologyChecker* const topology;
  const TopologySamples topology_samples;
  const OptimizeOptions& options;
  const DualRating rating;
  StarReader reader;
  const WantedRadii radii;
  const std::unique_ptr<DiskSet> balls;
  EditableSamples samples;
  DualStars stars;            ///< of `samples`, up to date between edits
  SeenSamples seen;           ///< the same for trials, up to date where trials begin
  std::vector<Index> unseen;  ///< samples whose star may be another one than seen
  Rng rng;
  OptimizeReport report;

  /// Is it still there, and bad?
  bool is_current(const BadItem& item) const {
    for (const Index s : {item.a, item.b, item.c}) {
      if (s != kNone && (!samples.alive(s) || !(stars.energy[slot(s)] > 0))) return false;
    }
    if (item.is_vertex()) return true;
    const StarView star = stars.star[slot(item.a)];
    for (int k = 0; k < star.size; ++k) {
      const Index p = star.ring[static_cast<std::size_t>(k)], q = star.ring[static_cast<std::size_t>((k + 1) % star.size)];
      if ((p == item.b && q == item.c) || (p == item.c && q == item.b)) return true;
    }
    return star.size == 0;
  }

  /// Brings `seen` up to date. Not beside trials.
  void see_changes() {
    seen.resize(slot(samples.size()));
    for (const Index s : unseen) {
      if (!samples.alive(s)) continue;
      seen.star.set(slot(s), stars.star[slot(s)]);
      seen.site[slot(s)] = diagram.site(s);
    }
    unseen.clear();
  }

  RefillFinder finder() const { return {diagram, stars, rating, radii, options.refills, num_fixed}; }
};

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

/// Edits that were kept, to be undone together if they are no improvement.
struct EditSeries {
  std::vector<SampleChange> changes;
  double energy_change = 0;
};

/// Carries out refills, and keeps those that lower the energy of all samples affected: their stars are the only ones to change.
class Refiller {
 public:
  explicit Refiller(OptimizeState& state)
      : state_(state), filler_(state.diagram, state.samples.disks(), state.radii), pending_(kItemsPerBatch) {
    for (std::size_t k = 0; k < kItemsPerBatch; ++k) beside_.push_back(std::make_unique<EditBeside>(state));
    grow();
  }

  /// The present state, for carry_out() to compare with.
  std::uint64_t time() const { return time_; }

  /// What was proposed for a bad item at that time, unless an edit since then has changed what it relies on.
  void carry_out(const BadItem& item, const Proposal& proposal, std::uint64_t planned_at) {
    if (!is_due(item, proposal, planned_at)) return;
    if (is_for_in_place(item, proposal)) {
      refill_in_place(item, Accept::kBetter);
      return;
    }
    SampleEdit edit(state_.samples, proposal.removed);
    if (!starts(edit, item, proposal)) return;
    Index near = proposal.removed.front();
    for (const Sample& sample : proposal.added) near = edit.enter(sample, near);
    edit.take_out();
    fill_and_end(edit, item);
  }

  // Several refills side by side: begin_batch(), begin() of one after another, carry_out_beside() of each, on as many threads,
  // and end_batch().

  void begin_batch() {
    num_begun_ = 0;
    state_.samples.begin_side_by_side(pending_);
  }

  enum class Begun { kYes, kNothing, kAlone };  ///< kAlone: to be carried out by itself, after the batch

  /// Up to kItemsPerBatch times. What comes of it is as if each ended before the next began.
  Begun begin(const BadItem& item, const Proposal& proposal, std::uint64_t planned_at) {
    if (!is_due(item, proposal, planned_at)) return Begun::kNothing;
    const auto is_near_others = [this](Index s) { return state_.diagram.near_pending(s); };
    if (is_for_in_place(item, proposal) || std::any_of(proposal.seen.begin(), proposal.seen.end(), is_near_others)) {
      return Begun::kAlone;
    }
    EditBeside& beside = *beside_[num_begun_];
    SampleEdit& edit = beside.edit.emplace(state_.samples, proposal.removed);
    if (!starts(edit, item, proposal)) return Begun::kNothing;
    if (!edit.begin(proposal.added, proposal.removed.front(), pending_[num_begun_])) {
      edit.undo();
      --state_.report.edits;
      return Begun::kAlone;
    }
    beside.item = item;
    ++num_begun_;
    return Begun::kYes;
  }

  std::size_t num_begun() const { return num_begun_; }

  void carry_out_beside(std::size_t k) {
    EditBeside& beside = *beside_[k];
    beside.edit->carry_out(pending_[k]);
    beside.reader.rate_crossings(state_.reader.rates_crossings());
    beside.complete = !beside.gaps.has_gap_in(beside.edit->changed_fragments());
    if (beside.complete) rate(*beside.edit, beside.reader, beside.rating);
  }

  void end_batch() {
    bool more = false;
    for (std::size_t k = 0; k < num_begun_; ++k) beside_[k]->edit->join(pending_[k]);
    for (std::size_t k = 0; k < num_begun_; ++k) more = beside_[k]->edit->finish(pending_[k]) || more;
    // Those with gaps last: what fills these may change stars of the others.
    for (std::size_t k = 0; k < num_begun_; ++k) {
      EditBeside& beside = *beside_[k];
      beside.complete = beside.complete && !more;
      if (beside.complete) keep_or_undo(*beside.edit, beside.rating, beside.item);
    }
    for (std::size_t k = 0; k < num_begun_; ++k) {
      if (!beside_[k]->complete) fill_and_end(*beside_[k]->edit, beside_[k]->item);
    }
    num_begun_ = 0;
  }

  /// After the last batch.
  void give_back() { state_.samples.end_side_by_side(pending_); }

  enum class Accept { kBetter, kAny };

  /// Tries a random patch in the diagram itself, of `more` samples than usual.
  void refill_in_place(const BadItem& item, Accept accept, int more = 0) {
    if (!affords_edits_in_place()) return;
    const std::vector<Index> removed = random_patch(item, more);
    if (removed.empty()) return;
    if (static_cast<Index>(removed.size()) + 1 >= num_samples()) return;
    SampleEdit edit(state_.samples, removed);
    edit.take_out();
    for (int refill = 0; refill < kRefillsInPlace && !is_cancelled(); ++refill) {
      ++state_.report.trials;
      ++state_.report.edits;
      ++edits_in_place_;
      if (fill(edit)) {
        rate(edit, state_.reader, rating_);
        if (is_good(edit, rating_, accept)) {
          keep(edit, rating_);
          return;
        }
      }
      edit.withdraw();
    }
    edit.undo();
  }

  /// Refills in place can take a tenth of a second each, beside sheets that crowd.
  bool is_cancelled() const { return state_.options.execution.cancelled(); }

  /// False where edits in place have come to their end, which they do only while crossings are rated.
  bool affords_edits_in_place() const {
    return !state_.reader.rates_crossings() ||
           edits_in_place_ < kEditsAtCrossings + static_cast<std::uint64_t>(num_given_) / kSamplesPerEditAtCrossings;
  }
  void count_edits_in_place_anew() { edits_in_place_ = 0; }

  /// What the edits that were kept have changed in all. (Up to rounding: for telling progress.)
  double energy_change_of_all() const { return energy_change_of_all_; }

  /// Edits kept from now on are added to a series (null: no more).
  void record(EditSeries* series) { series_ = series; }

  void undo(EditSeries& series) {
    energy_change_of_all_ -= series.energy_change;
    for (const Index s : SampleEdit::undo_all(state_.samples, series.changes)) {
      state_.stars.read(state_.reader, s);
      state_.unseen.push_back(s);
    }
  }

 private:
  Index num_samples() const { return state_.diagram.num_sites() - state_.diagram.num_removed(); }

  bool changed_since(std::uint64_t time, Index s) const { return changed_at_[slot(s)] > time; }

  void grow() {
    const std::size_t n = slot(state_.samples.size());
    state_.stars.resize(n);
    changed_at_.resize(n, 0);
    copies_mislead_.resize(n, 0);
  }

  /// Until no gap is left where the edit has changed something; false if that takes too many samples.
  bool fill(SampleEdit& edit) {
    GapFillLimits limits;
    limits.max_samples = kMaxRefillSamples;
    filler_.look_at(edit.changed_fragments());
    const GapFilling filling =
        filler_.fill(state_.rng, limits, [&](const Sample& sample, Index near) { edit.enter(sample, near); });
    filler_.forget();
    return filling.complete();
  }

  std::vector<Index> random_patch(const BadItem& item, int more) {
    Rng& rng = state_.rng;
    std::vector<Index> patch = {item.a};
    if (!item.is_vertex()) {
      const auto others = rng.below(3);
      if (others > 0) patch.push_back(others == 1 && rng.below(2) == 0 ? item.c : item.b);
      if (others > 1) patch.push_back(item.c);
      std::swap(patch[0], patch[rng.below(patch.size())]);
    }
    take_free(patch);
    if (patch.empty()) return patch;
    const int neighbors = (rng.below(3) == 0 ? kNeighborsInPlace : 0) + more;
    for (int k = 0; k < neighbors; ++k) {
      const auto& pairs = state_.reader.read(patch[rng.below(patch.size())]);
      if (pairs.empty()) continue;
      const Index s = pairs[rng.below(pairs.size())][rng.below(2)];
      if (s >= state_.num_fixed && std::find(patch.begin(), patch.end(), s) == patch.end()) patch.push_back(s);
    }
    return patch;
  }

  /// Leaves out samples that stay; where that leaves none, takes one of their neighbours instead, if one may go.
  void take_free(std::vector<Index>& patch) {
    const auto is_fixed = [this](Index s) { return s < state_.num_fixed; };
    const Index first = patch.front();
    patch.erase(std::remove_if(patch.begin(), patch.end(), is_fixed), patch.end());
    if (!patch.empty()) return;
    std::vector<Index> free;
    for (const StarReader::Pair& pair : state_.reader.read(first)) {
      std::copy_if(pair.begin(), pair.end(), std::back_inserter(free), [&](Index s) { return !is_fixed(s); });
    }
    if (!free.empty()) patch.push_back(free[state_.rng.below(free.size())]);
  }

  /// What an edit makes of the samples it affects.
  struct EditRating {
    AffectedStars stars;
    double energy_change = 0;
  };

  /// Of the edit so far.
  void rate(SampleEdit& edit, StarReader& reader, EditRating& rating) const {
    const std::vector<Index>& affected = edit.affected();
    double before = 0, after = 0;
    for (const SampleChange::Removed& old : edit.removed()) before += state_.stars.energy[slot(old.id)];
    rating.stars.resize(affected.size());
    for (std::size_t k = 0; k < affected.size(); ++k) {
      const Index s = affected[k];
      if (!edit.has_added(s)) before += state_.stars.energy[slot(s)];
      after += rating.stars.energy[k] = reader.energy(s, rating.stars.star[k]);
    }
    rating.energy_change = after - before;
  }

  bool is_good(SampleEdit& edit, const EditRating& rating, Accept accept) {
    return (rating.energy_change < -kMinGain || accept == Accept::kAny) && !hides_a_sample(edit) &&
           keeps_topology(edit, rating.stars);
  }

  void keep_or_undo(SampleEdit& edit, const EditRating& rating, const BadItem& item) {
    if (is_good(edit, rating, Accept::kBetter)) {
      keep(edit, rating);
    } else {
      copies_mislead_[slot(item.a)] = 1;
      edit.undo();
    }
  }

  void fill_and_end(SampleEdit& edit, const BadItem& item) {
    if (fill(edit)) {
      rate(edit, state_.reader, rating_);
    } else {
      rating_.energy_change = INFINITY;
    }
    keep_or_undo(edit, rating_, item);
  }

  /// Is there something to be done, and has nothing changed that it relies on?
  bool is_due(const BadItem& item, const Proposal& proposal, std::uint64_t planned_at) {
    if (proposal.kind == Proposal::Kind::kNothing) return false;
    if (is_for_in_place(item, proposal)) return state_.is_current(item) && !changed_since(planned_at, item.a);
    return std::none_of(proposal.seen.begin(), proposal.seen.end(), [&](Index s) { return changed_since(planned_at, s); });
  }

  bool is_for_in_place(const BadItem& item, const Proposal& proposal) const {
    return proposal.kind == Proposal::Kind::kInPlace || copies_mislead_[slot(item.a)];
  }

  /// Counts the edit. False, and it is undone, where a disk would be too near to one of another sheet.
  bool starts(SampleEdit& edit, const BadItem& item, const Proposal& proposal) {
    if (!state_.samples.are_apart(proposal.added, state_.radii.rule())) {
      copies_mislead_[slot(item.a)] = 1;
      edit.undo();
      return false;
    }
    ++state_.report.edits;
    return true;
  }

  /// Has a new sample no part of the surface, or an old one none any more? By the min rule a disk may cover smaller ones; by
  /// the max rule this never happens.
  bool hides_a_sample(SampleEdit& edit) const {
    if (state_.radii.rule() == ConflictRule::kMax) return false;
    const auto is_hidden = [&](Index s) { return state_.diagram.first_of_site(s) == kNone; };
    const std::vector<Index>&added = edit.added(), &affected = edit.affected();
    return std::any_of(added.begin(), added.end(), is_hidden) || std::any_of(affected.begin(), affected.end(), is_hidden);
  }

  /// Is the dual of the same topology after the edit, of which the samples affected have these stars? Where disks of triangles
  /// around samples away from curves, met once each, are replaced by such, their sum of 6 less the valence says so: six times
  /// the Euler characteristic. All else the certificate decides, at five times the cost.
  bool keeps_topology(SampleEdit& edit, const AffectedStars& stars) {
    if (state_.topology == nullptr) return true;
    const std::vector<Index>& affected = edit.affected();
    bool all_disks = true;
    int change = 0;
    const auto add = [&](Index s, const StarView& star, int sign) {
      all_disks = all_disks && star.size > 0 && !star.repeats && s >= state_.num_fixed;
      change += sign * (6 - star.size);
    };
    for (const SampleChange::Removed& old : edit.removed()) add(old.id, state_.stars.star[slot(old.id)], -1);
    for (std::size_t k = 0; k < affected.size(); ++k) {
      const Index s = affected[k];
      if (!edit.has_added(s)) add(s, state_.stars.star[slot(s)], -1);
      add(s, stars.star[k], 1);
    }
    if (all_disks) return change == 0;
    return state_.topology->check(state_.diagram, state_.topology_samples, affected, topology_scratch_).holds();
  }

  void keep(SampleEdit& edit, const EditRating& rating) {
    ++state_.report.accepted;
    ++time_;
    SampleChange change = edit.keep();
    grow();
    state_.unseen.insert(state_.unseen.end(), change.affected.begin(), change.affected.end());
    for (std::size_t k = 0; k < change.affected.size(); ++k) {
      const std::size_t s = slot(change.affected[k]);
      changed_at_[s] = time_;
      copies_mislead_[s] = 0;
      state_.stars.energy[s] = rating.stars.energy[k];
      state_.stars.star.set(s, rating.stars.star[k]);
    }
    energy_change_of_all_ += rating.energy_change;
    if (series_ == nullptr) return;
    series_->energy_change += rating.energy_change;
    series_->changes.push_back(std::move(change));
  }

  /// One of a batch, with what its thread uses.
  struct EditBeside {
    explicit EditBeside(const OptimizeState& state)
        : reader(state.diagram, state.rating, state.num_fixed), gaps(state.diagram, state.samples.disks(), state.radii) {}

    BadItem item{};
    std::optional<SampleEdit> edit;
    StarReader reader;
    GapFiller gaps;
    EditRating rating;
    bool complete = false;  ///< no gap, and rated
  };

  OptimizeState& state_;
  GapFiller filler_;
  const Index num_given_ = num_samples();
  std::uint64_t time_ = 0;  ///< edits kept so far
  std::uint64_t edits_in_place_ = 0;
  std::vector<std::uint64_t> changed_at_;  ///< the time after the edit that changed a sample's star last
  std::vector<char> copies_mislead_;       ///< by sample: the diagram has shown a refill to be less than a copy promised
  EditSeries* series_ = nullptr;
  double energy_change_of_all_ = 0;
  EditRating rating_;  ///< of the present edit
  std::vector<std::unique_ptr<EditBeside>> beside_;
  RestrictedPowerDiagram::PendingEdits pending_;
  std::size_t num_begun_ = 0;
  TopologyChecker::Scratch topology_scratch_;
};

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
      for (std::size_t first = begin; first < end; first += kItemsPerBatch) {
        report_progress();
        next.items = items.data() + first;
        next.count = std::min(kItemsPerBatch, end - first);
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
