#define AMPS_OWN_SOURCE
#include "amps/optimize_refiller.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <utility>

namespace amps::detail {
namespace {

/// Edits spent on vertices at crossings, 0.2 ms each, beyond one for every fourth sample. Where a surface meets itself there
/// may be no end of them.
constexpr std::uint64_t kEditsAtCrossings = 500;
constexpr std::uint64_t kSamplesPerEditAtCrossings = 4;
/// Refills of the diagram itself, where a patch cannot be copied.
constexpr int kRefillsInPlace = 8;
/// Of three such refills one takes out so many neighbours too.
constexpr int kNeighborsInPlace = 2;
/// Samples for one refill of the diagram at most: far more than fit where a few have been taken out.
constexpr Index kMaxRefillSamples = 64;

}  // namespace

Refiller::Refiller(OptimizeState& state)
    : state_(state), filler_(state.diagram, state.samples.disks(), state.radii), pending_(kItemsPerBatch) {
  for (std::size_t k = 0; k < kItemsPerBatch; ++k) beside_.push_back(std::make_unique<EditBeside>(state));
  grow();
}

void Refiller::carry_out(const BadItem& item, const Proposal& proposal, std::uint64_t planned_at) {
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

void Refiller::begin_batch() {
  num_begun_ = 0;
  state_.samples.begin_side_by_side(pending_);
}

Refiller::Begun Refiller::begin(const BadItem& item, const Proposal& proposal, std::uint64_t planned_at) {
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

void Refiller::carry_out_beside(std::size_t k) {
  EditBeside& beside = *beside_[k];
  beside.edit->carry_out(pending_[k]);
  beside.reader.rate_crossings(state_.reader.rates_crossings());
  beside.complete = !beside.gaps.has_gap_in(beside.edit->changed_fragments());
  if (beside.complete) rate(*beside.edit, beside.reader, beside.rating);
}

void Refiller::end_batch() {
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

void Refiller::refill_in_place(const BadItem& item, Accept accept, int more) {
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

bool Refiller::affords_edits_in_place() const {
  return !state_.reader.rates_crossings() ||
         edits_in_place_ < kEditsAtCrossings + static_cast<std::uint64_t>(num_given_) / kSamplesPerEditAtCrossings;
}

void Refiller::undo(EditSeries& series) {
  energy_change_of_all_ -= series.energy_change;
  for (const Index s : SampleEdit::undo_all(state_.samples, series.changes)) {
    state_.stars.read(state_.reader, s);
    state_.unseen.push_back(s);
  }
}

void Refiller::grow() {
  const std::size_t n = slot(state_.samples.size());
  state_.stars.resize(n);
  changed_at_.resize(n, 0);
  copies_mislead_.resize(n, 0);
}

/// Until no gap is left where the edit has changed something; false if that takes too many samples.
bool Refiller::fill(SampleEdit& edit) {
  GapFillLimits limits;
  limits.max_samples = kMaxRefillSamples;
  filler_.look_at(edit.changed_fragments());
  const GapFilling filling =
      filler_.fill(state_.rng, limits, [&](const Sample& sample, Index near) { edit.enter(sample, near); });
  filler_.forget();
  return filling.complete();
}

std::vector<Index> Refiller::random_patch(const BadItem& item, int more) {
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
void Refiller::take_free(std::vector<Index>& patch) {
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

/// Of the edit so far.
void Refiller::rate(SampleEdit& edit, StarReader& reader, EditRating& rating) const {
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

bool Refiller::is_good(SampleEdit& edit, const EditRating& rating, Accept accept) {
  return (rating.energy_change < -kMinGain || accept == Accept::kAny) && !hides_a_sample(edit) &&
         keeps_topology(edit, rating.stars);
}

void Refiller::keep_or_undo(SampleEdit& edit, const EditRating& rating, const BadItem& item) {
  if (is_good(edit, rating, Accept::kBetter)) {
    keep(edit, rating);
  } else {
    copies_mislead_[slot(item.a)] = 1;
    edit.undo();
  }
}

void Refiller::fill_and_end(SampleEdit& edit, const BadItem& item) {
  if (fill(edit)) {
    rate(edit, state_.reader, rating_);
  } else {
    rating_.energy_change = INFINITY;
  }
  keep_or_undo(edit, rating_, item);
}

/// Is there something to be done, and has nothing changed that it relies on?
bool Refiller::is_due(const BadItem& item, const Proposal& proposal, std::uint64_t planned_at) {
  if (proposal.kind == Proposal::Kind::kNothing) return false;
  if (is_for_in_place(item, proposal)) return state_.is_current(item) && !changed_since(planned_at, item.a);
  return std::none_of(proposal.seen.begin(), proposal.seen.end(), [&](Index s) { return changed_since(planned_at, s); });
}

bool Refiller::is_for_in_place(const BadItem& item, const Proposal& proposal) const {
  return proposal.kind == Proposal::Kind::kInPlace || copies_mislead_[slot(item.a)];
}

/// Counts the edit. False, and it is undone, where a disk would be too near to one of another sheet.
bool Refiller::starts(SampleEdit& edit, const BadItem& item, const Proposal& proposal) {
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
bool Refiller::hides_a_sample(SampleEdit& edit) const {
  if (state_.radii.rule() == ConflictRule::kMax) return false;
  const auto is_hidden = [&](Index s) { return state_.diagram.first_of_site(s) == kNone; };
  const std::vector<Index>&added = edit.added(), &affected = edit.affected();
  return std::any_of(added.begin(), added.end(), is_hidden) || std::any_of(affected.begin(), affected.end(), is_hidden);
}

/// Is the dual of the same topology after the edit, of which the samples affected have these stars? Where disks of triangles
/// around samples away from curves, met once each, are replaced by such, their sum of 6 less the valence says so: six times
/// the Euler characteristic. All else the certificate decides, at five times the cost.
bool Refiller::keeps_topology(SampleEdit& edit, const AffectedStars& stars) {
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

void Refiller::keep(SampleEdit& edit, const EditRating& rating) {
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

}  // namespace amps::detail
