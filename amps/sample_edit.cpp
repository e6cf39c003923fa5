#define AMPS_OWN_SOURCE
#include "amps/sample_edit.h"

#include <algorithm>
#include <cstdint>
#include <utility>

namespace amps::detail {
namespace {

/// Of loops that take some 100 ns a sample.
constexpr std::uint64_t kEditableSamplesPerLook = 8192;

void sort_each_once(std::vector<Index>& ids) {
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
}

}  // namespace

EditableSamples::EditableSamples(RestrictedPowerDiagram& diagram, const SampleSet& samples, DiskSet& disks,
                                 const Execution& execution)
    : EditableSamples(diagram, samples, {}, disks, execution) {}

EditableSamples::EditableSamples(RestrictedPowerDiagram& diagram, const SampleSet& samples, const std::vector<Index>& ids,
                                 DiskSet& disks, const Execution& execution)
    : diagram_(diagram), disks_(disks), given_(ids), num_given_(samples.size()) {
  const auto n = slot(ids.empty() ? samples.size() : diagram.num_sites());
  if (!disks.knows_surface()) {
    balls_.reserve(n + n / 8);  // optimisation adds some hundredths
    balls_.resize(n);
  }
  alive_.assign(n, 0);
  is_new_.assign(n, 0);
  const bool fresh = !disks.has_samples();
  Ticker ticker(execution, slot(samples.size()), kEditableSamplesPerLook);
  for (Index row = 0; row < samples.size(); ++row) {
    ticker.tick();
    const Index s = ids.empty() ? row : ids[slot(row)];
    if (!disks.knows_surface()) balls_[slot(s)] = sample_of(samples, row);
    alive_[slot(s)] = 1;
    if (fresh) disks_.insert(sample_of(samples, row), s);
  }
  for (std::size_t s = n; s-- > 0;) {
    if (alive_[s] == 0) free_.push_back(static_cast<Index>(s));
  }
}

bool EditableSamples::are_apart(const std::vector<Sample>& disks, ConflictRule rule) const {
  for (std::size_t k = 0; k < disks.size(); ++k) {
    if (disks_.conflicting_sample(disks[k], rule) != kNone) return false;
    for (std::size_t j = 0; j < k; ++j) {
      if (!detail::are_apart(disks[k], disks[j], rule)) return false;
    }
  }
  return true;
}

void EditableSamples::collect(SampleSet& set, std::vector<Index>& ids) const {
  const bool has_given = set.size() > 0;
  AMPS_ASSERT(!has_given || set.size() == num_given_);
  if (has_given && set.facets.empty()) {
    set.facets.assign(slot(num_given_), kNone);
    set.barycentrics.resize(num_given_);
  }
  ids.clear();
  ids.reserve(alive_.size());
  // Rows only move forwards, into places that are free by now.
  Index row = 0;
  for (Index before = 0; before < num_given_; ++before) {
    const Index s = given_.empty() ? before : given_[slot(before)];
    if (!alive(s) || is_new(s)) continue;
    if (has_given && row != before) {
      set.positions.row(row) = set.positions.row(before);
      set.barycentrics.row(row) = set.barycentrics.row(before);
      set.radii[slot(row)] = set.radii[slot(before)];
      set.facets[slot(row)] = set.facets[slot(before)];
    }
    ids.push_back(s);
    if (has_given) ++row;
  }
  for (Index s = 0; s < size(); ++s) {
    if (alive(s) && is_new(s)) ids.push_back(s);
  }
  set.positions.resize(static_cast<std::ptrdiff_t>(ids.size()));
  set.barycentrics.resize(static_cast<std::ptrdiff_t>(ids.size()));
  set.radii.resize(ids.size());
  set.facets.resize(ids.size());
  for (; slot(row) < ids.size(); ++row) {
    const Sample& sample = (*this)[ids[slot(row)]];
    set.positions.row(row) = sample.position().transpose();
    set.barycentrics.row(row) = sample.at.barycentric.transpose();
    set.radii[slot(row)] = sample.radius;
    set.facets[slot(row)] = sample.at.facet;
  }
}

SampleEdit::SampleEdit(EditableSamples& samples, const std::vector<Index>& removed) : samples_(samples) {
  for (const Index s : removed) {
    const Sample& sample = samples[s];
    change_.removed.push_back({s, sample, samples.is_new(s)});
    samples.disks_.remove(sample, s);
  }
}

void SampleEdit::note_changed() {
  const RestrictedPowerDiagram& diagram = samples_.diagram_;
  samples_.fragments_changed_ += diagram.changed().size();
  changed_fragments_.insert(changed_fragments_.end(), diagram.changed().begin(), diagram.changed().end());
  change_.affected.insert(change_.affected.end(), diagram.changed_sites().begin(), diagram.changed_sites().end());
}

void SampleEdit::remove_site(Index s) {
  samples_.diagram_.remove(s);
  samples_.disks_.forget_reach(s);
  samples_.alive_[slot(s)] = 0;
  note_changed();
}

void SampleEdit::take_out() {
  for (const SampleChange::Removed& old : change_.removed) remove_site(old.id);
}

/// One that is free, or that of the next site.
Index SampleEdit::take_id() {
  if (samples_.free_.empty()) return samples_.diagram_.num_sites();
  const Index s = samples_.free_.back();
  samples_.free_.pop_back();
  return s;
}

void SampleEdit::note_alive(const Sample& sample, Index s) {
  if (s == samples_.size()) {
    if (!samples_.disks_.knows_surface()) samples_.balls_.emplace_back();
    samples_.alive_.push_back(0);
    samples_.is_new_.push_back(1);
  }
  if (!samples_.disks_.knows_surface()) samples_.balls_[slot(s)] = sample;
  samples_.alive_[slot(s)] = 1;
  samples_.is_new_[slot(s)] = 1;
  change_.added.push_back(s);
}

Index SampleEdit::insert_site(const Sample& sample, Index near) {
  const double weight = sample.radius * sample.radius;
  const Index s = take_id();
  samples_.disks_.insert(sample, s);
  if (s == samples_.diagram_.num_sites()) {
    samples_.diagram_.insert(sample.position(), weight, near);
  } else {
    samples_.diagram_.reinsert(s, sample.position(), weight, near);
  }
  return s;
}

Index SampleEdit::enter(const Sample& sample, Index near) {
  const Index s = insert_site(sample, near);
  note_alive(sample, s);
  note_changed();
  return s;
}

bool SampleEdit::begin_insertion(const Sample& sample, Index near, RestrictedPowerDiagram::PendingEdit& pending) {
  RestrictedPowerDiagram& diagram = samples_.diagram_;
  const Index s = take_id();
  samples_.disks_.insert(sample, s);
  if (diagram.reaches_local_facet(s)) {
    samples_.disks_.remove(sample, s);
    samples_.disks_.forget_reach(s);
    if (s < diagram.num_sites()) samples_.free_.push_back(s);
    return false;
  }
  const double weight = sample.radius * sample.radius;
  const bool apart = s == diagram.num_sites() ? diagram.insert_pending(pending, sample.position(), weight, near)
                                              : diagram.reinsert_pending(pending, s, sample.position(), weight, near);
  note_alive(sample, s);
  return apart;
}

bool SampleEdit::begin(const std::vector<Sample>& added, Index near, RestrictedPowerDiagram::PendingEdit& pending) {
  RestrictedPowerDiagram& diagram = samples_.diagram_;
  const std::vector<SampleChange::Removed>& removed = change_.removed;
  bool apart =
      std::none_of(removed.begin(), removed.end(), [&](const auto& old) { return diagram.reaches_local_facet(old.id); });
  for (std::size_t k = 0; k < added.size() && apart; ++k) {
    apart = begin_insertion(added[k], k == 0 ? near : change_.added.back(), pending);
  }
  for (std::size_t k = 0; k < removed.size() && apart; ++k) apart = diagram.remove_pending(pending, removed[k].id);
  if (apart) {
    for (const SampleChange::Removed& old : removed) samples_.alive_[slot(old.id)] = 0;
    return true;
  }
  diagram.withdraw_pending(pending);
  for (; !change_.added.empty(); change_.added.pop_back()) {
    const Index s = change_.added.back();
    samples_.disks_.remove(samples_[s], s);
    samples_.disks_.forget_reach(s);
    samples_.alive_[slot(s)] = 0;
    samples_.free_.push_back(s);
  }
  return false;
}

void SampleEdit::carry_out(RestrictedPowerDiagram::PendingEdit& pending) {
  samples_.diagram_.carry_out(pending);
  changed_fragments_ = pending.changed();
  change_.affected = pending.changed_sites();
}

bool SampleEdit::finish(RestrictedPowerDiagram::PendingEdit& pending) {
  const bool more = samples_.diagram_.finish(pending);
  if (more) {
    changed_fragments_ = pending.changed();
    change_.affected = pending.changed_sites();
  }
  samples_.fragments_changed_ += pending.changed().size();
  for (const SampleChange::Removed& old : change_.removed) samples_.disks_.forget_reach(old.id);
  return more;
}

void SampleEdit::withdraw() {
  for (const Index s : change_.added) {
    samples_.disks_.remove(samples_[s], s);
    remove_site(s);
    samples_.free_.push_back(s);
  }
  change_.added.clear();
}

bool SampleEdit::has_added(Index s) const {
  return std::find(change_.added.begin(), change_.added.end(), s) != change_.added.end();
}

const std::vector<Index>& SampleEdit::changed_fragments() {
  sort_each_once(changed_fragments_);
  return changed_fragments_;
}

const std::vector<Index>& SampleEdit::affected() {
  std::vector<Index>& affected = change_.affected;
  sort_each_once(affected);
  affected.erase(std::remove_if(affected.begin(), affected.end(), [&](Index s) { return !samples_.alive(s); }), affected.end());
  return affected;
}

SampleChange SampleEdit::keep() {
  for (const SampleChange::Removed& old : change_.removed) samples_.free_.push_back(old.id);
  affected();
  return std::move(change_);
}

/// Near the edit.
Index SampleEdit::neighbor_that_stays() const {
  for (const Index s : change_.affected) {
    if (samples_.alive(s) && !has_added(s)) return s;
  }
  return kNone;
}

void SampleEdit::undo() {
  Index near = neighbor_that_stays();
  withdraw();
  for (const SampleChange::Removed& old : change_.removed) {
    const Sample& sample = old.sample;
    samples_.disks_.insert(sample, old.id);
    if (!samples_.alive(old.id)) {
      samples_.diagram_.reinsert(old.id, sample.position(), sample.radius * sample.radius, near);
      note_changed();
    }
    if (!samples_.disks_.knows_surface()) samples_.balls_[slot(old.id)] = sample;
    samples_.alive_[slot(old.id)] = 1;
    samples_.is_new_[slot(old.id)] = old.is_new;
    near = old.id;
  }
}

std::vector<Index> SampleEdit::undo_all(EditableSamples& samples, std::vector<SampleChange>& changes) {
  SampleEdit all(samples, SampleChange{});
  for (const SampleChange& change : changes) {
    all.change_.affected.insert(all.change_.affected.end(), change.affected.begin(), change.affected.end());
  }
  for (; !changes.empty(); changes.pop_back()) {
    all.change_.removed = std::move(changes.back().removed);
    all.change_.added = std::move(changes.back().added);
    for (const SampleChange::Removed& old : all.removed()) {
      samples.free_.erase(std::find(samples.free_.begin(), samples.free_.end(), old.id));
    }
    all.undo();
  }
  all.affected();
  return std::move(all.change_.affected);
}

}  // namespace amps::detail
