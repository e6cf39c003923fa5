// Edits side by side.
//
// An edit changes fragments of the sites it enters and removes, and of neighbours of these in space: all others it does not
// even look at. So edits whose neighbours are apart share nothing but memory: slots of fragments, of which each has some of its
// own, so that they do not depend on who is faster; the lists of fragments by facet, which wait until the edit is finished; and
// the pages of polygons, under a lock.
//
// Order. Edits count as if each came whole before the next. An edit that enters looks at what those before have marked: all
// neighbours of what they remove, and those neighbours of what they insert that the new cell can reach; when it is carried out,
// it looks at no other fragments. What a later edit inserts beside none of these takes nothing from them, and gets nothing: its
// neighbours in the triangulation, which has all edits so far, are those it has once the edits before are carried out.
#define AMPS_OWN_SOURCE
#include "amps/power_diagram.h"

#include "amps/power_diagram_clipper.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace amps {

using detail::slot;

namespace detail {
namespace {

/// Slots an edit has of its own: most need a fraction of them.
constexpr std::size_t kSlotsHeld = 256;
/// Pages it may open on the average: half a million corners. Most open none.
constexpr std::size_t kPagesPerEdit = 512;

}  // namespace
}  // namespace detail

RestrictedPowerDiagram::PendingEdit::Step& RestrictedPowerDiagram::PendingEdit::add_step() {
  if (num_steps_ == steps_.size()) steps_.emplace_back();
  Step& step = steps_[num_steps_++];
  step.cell.around.clear();
  return step;
}

void RestrictedPowerDiagram::begin_side_by_side(PendingEdits& edits) {
  mark_.resize(slot(triangulation_.num_vertices()), 0);
  const auto num_marks = static_cast<std::uint32_t>(edits.size());
  if (first_mark_ > std::numeric_limits<std::uint32_t>::max() - 2 * num_marks) {
    std::fill(mark_.begin(), mark_.end(), 0u);
    first_mark_ = 1;
  }
  first_mark_ += num_marks;  // above all marks there are
  for (std::size_t k = 0; k < edits.size(); ++k) {
    PendingEdit& edit = edits[k];
    edit.mark_ = first_mark_ + static_cast<std::uint32_t>(k);
    edit.num_steps_ = edit.next_step_ = 0;
    edit.has_foreign_ = false;
    edit.record_.clear();
    edit.record_.beside_others = true;
    edit.record_.pages = &edits.pages_;
    hold_slots(edit, detail::kSlotsHeld);
  }
  polygons_.hold_list(edits.size() * detail::kPagesPerEdit);
}

void RestrictedPowerDiagram::hold_slots(PendingEdit& edit, std::size_t count) {
  std::vector<Index>& slots = edit.record_.slots;
  while (slots.size() < count) slots.push_back(take_slot(edit_));
  while (slots.size() > 2 * count) {
    free_fragments_.push_back(slots.back());
    slots.pop_back();
  }
}

void RestrictedPowerDiagram::end_side_by_side(PendingEdits& edits) {
  for (std::size_t k = 0; k < edits.size(); ++k) {
    std::vector<Index>& slots = edits[k].record_.slots;
    free_fragments_.insert(free_fragments_.end(), slots.begin(), slots.end());
    slots.clear();
  }
}

bool RestrictedPowerDiagram::near_pending(Index s) const {
  const std::size_t v = slot(s + kSentinels);
  return v < mark_.size() && mark_[v] >= first_mark_;
}

/// False if another edit has marked the vertex. Marks it if its fragments may change.
bool RestrictedPowerDiagram::mark_pending(PendingEdit& edit, Index vertex, bool changes) {
  if (vertex < kSentinels) return true;
  std::uint32_t& mark = mark_[slot(vertex)];
  if (mark >= first_mark_ && mark != edit.mark_) return false;
  if (changes) mark = edit.mark_;
  return true;
}

bool RestrictedPowerDiagram::insert_pending(PendingEdit& edit, const Vec3& position, double weight, Index near) {
  const Index s = triangulation_.insert(position, weight, hint_cell(near)) - kSentinels;
  first_of_site_.push_back(kNone);
  reach_.push_back(kNoCell);
  mark_.push_back(0);
  return enter_pending(edit, s);
}

bool RestrictedPowerDiagram::reinsert_pending(PendingEdit& edit, Index s, const Vec3& position, double weight, Index near) {
  triangulation_.reinsert(s + kSentinels, position, weight, hint_cell(near));
  return enter_pending(edit, s);
}

bool RestrictedPowerDiagram::enter_pending(PendingEdit& edit, Index s) {
  num_guards_ += is_guard(s);
  PendingEdit::Step& step = edit.add_step();
  step.cell.site = s;
  step.enters = true;
  if (!visible(s) || !triangulation_.hidden_by_last_insertion().empty()) return false;
  list_new_neighbors(s, step.cell.around);
  bool apart = mark_pending(edit, s + kSentinels, true);
  for (const Index v : step.cell.around) {
    if (v < kSentinels) continue;
    const bool changes = !(plane(v - kSentinels, s).offset > reach_[slot(v - kSentinels)]);
    apart = mark_pending(edit, v, changes) && apart;
  }
  // Fragments of neighbours that the new cell does not reach may be another edit's by the time it is found.
  const auto is_ours = [&](Index v) { return v >= kSentinels && mark_[slot(v)] == edit.mark_; };
  step.cell.around.erase(std::remove_if(step.cell.around.begin(), step.cell.around.end(), [&](Index v) { return !is_ours(v); }),
                         step.cell.around.end());
  return apart;
}

bool RestrictedPowerDiagram::remove_pending(PendingEdit& edit, Index s) {
  PendingEdit::Step& step = edit.add_step();
  step.cell.site = s;
  step.enters = false;
  step.cell.point = site(s);
  if (visible(s)) step.cell.around = link_of(s);
  bool apart = !step.cell.around.empty() && num_guards_ > 1 && mark_pending(edit, s + kSentinels, true);
  for (const Index v : step.cell.around) apart = mark_pending(edit, v, true) && apart;
  num_guards_ -= is_guard(s);
  const Index hidden = triangulation_.num_hidden();
  triangulation_.remove(s + kSentinels);
  return apart && triangulation_.num_hidden() == hidden;
}

void RestrictedPowerDiagram::withdraw_pending(PendingEdit& edit) {
  for (; edit.num_steps_ > 0; --edit.num_steps_) {
    const PendingEdit::Step& step = edit.steps_[edit.num_steps_ - 1];
    if (step.enters) {
      num_guards_ -= is_guard(step.cell.site);
      triangulation_.remove(step.cell.site + kSentinels);
      continue;
    }
    Index near = kNone;
    for (const Index v : step.cell.around) near = v >= kSentinels ? v - kSentinels : near;
    triangulation_.reinsert(step.cell.site + kSentinels, step.cell.point.position(), step.cell.point.w, hint_cell(near));
    num_guards_ += is_guard(step.cell.site);
  }
}

/// All steps there are slots for.
void RestrictedPowerDiagram::run_steps(PendingEdit& edit) {
  CellScratch scratch(*this);
  for (; edit.next_step_ < edit.num_steps_; ++edit.next_step_) {
    const PendingEdit::Step& step = edit.steps_[edit.next_step_];
    if (step.enters) {
      if (!take_cell(step.cell, scratch, edit.record_)) return;
      continue;
    }
    std::vector<Index> candidates;
    candidates.reserve(step.cell.around.size());
    for (const Index v : step.cell.around) {
      if (v >= kSentinels) candidates.push_back(v - kSentinels);
    }
    if (!divide_cell(step.cell.site, candidates, edit.record_)) return;
  }
}

void RestrictedPowerDiagram::carry_out(PendingEdit& edit) {
  run_steps(edit);
  finish_edit(edit.record_);
  if (reach_lists_ == nullptr) return;
  for (const Index f : edit.record_.changed) {
    edit.has_foreign_ = edit.has_foreign_ || (alive(f) && !local(fragments_[slot(f)].facet) && is_foreign(f));
  }
}

void RestrictedPowerDiagram::join(PendingEdit& edit) {
  polygons_.let_list_go();
  EditRecord& record = edit.record_;
  edit.is_late_ = edit.next_step_ < edit.num_steps_;
  for (std::size_t count = 2 * detail::kSlotsHeld; edit.next_step_ < edit.num_steps_; count *= 2) {
    hold_slots(edit, count);
    run_steps(edit);
  }
  for (const FacetChange& change : record.facet_changes) {
    if (change.comes) {
      link_in_facet(change.fragment);
    } else {
      unlink_in_facet(change.fragment);
    }
  }
  record.facet_changes.clear();
  num_fragments_ += std::exchange(record.fragments_added, 0);
  record.slots.insert(record.slots.end(), record.freed.begin(), record.freed.end());
  record.freed.clear();
  if (site_tree_.empty()) return;
  for (std::size_t k = 0; k < edit.num_steps_; ++k) {
    const Index s = edit.steps_[k].cell.site;
    if (edit.steps_[k].enters) {
      insert_into_site_tree(s);
    } else {
      site_tree_.remove(edit.steps_[k].cell.point.position(), s);
    }
  }
}

bool RestrictedPowerDiagram::finish(PendingEdit& edit) {
  if (edit.is_late_ || edit.has_foreign_) {
    edit_.changed = std::move(edit.record_.changed);
    edit_.changed_sites = std::move(edit.record_.changed_sites);
    if (reach_lists_ != nullptr) localize_foreign(kNone, 0);
    finish_edit();
    std::swap(edit.record_.changed, edit_.changed);
    std::swap(edit.record_.changed_sites, edit_.changed_sites);
  }
  edit_.clear();
  if (4 * polygons_.unused() > 3 * polygons_.capacity()) compact_polygons();
  return edit.is_late_ || edit.has_foreign_;
}

}  // namespace amps
