// sample_edit.h (internal): edits of samples that have a power diagram and a grid. An edit takes samples out and puts others
// in, in all three at once; then it is kept or undone. Edits that were kept can be undone later, the last one first.
#pragma once

#include "amps/base.h"
#include "amps/disk_set.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"
#include "amps/samples.h"
#include "amps/wanted_radii.h"

#include <cstdint>
#include <utility>
#include <vector>

namespace amps::detail {

/// The samples of a diagram, by their ids in it, and a grid of them. Only a SampleEdit changes them; ids of samples that are
/// gone are used again. Const members may be called concurrently.
class EditableSamples {
 public:
  /// `diagram`: of exactly these samples, ids being rows; `disks`: these samples, of which the diagram uses the reach, or none
  /// yet: then they are stored, for all radii there will be. Both must outlive this.
  EditableSamples(RestrictedPowerDiagram& diagram, const SampleSet& samples, DiskSet& disks, const Execution& execution = {});
  /// The same of samples with these ids; empty: rows.
  EditableSamples(RestrictedPowerDiagram& diagram, const SampleSet& samples, const std::vector<Index>& ids, DiskSet& disks,
                  const Execution& execution = {});

  const RestrictedPowerDiagram& diagram() const { return diagram_; }
  const DiskSet& disks() const { return disks_; }

  /// Ids given out so far; some are not alive.
  Index size() const { return static_cast<Index>(alive_.size()); }
  bool alive(Index s) const { return alive_[slot(s)] != 0; }
  /// Has an edit put it in?
  bool is_new(Index s) const { return is_new_[slot(s)] != 0; }
  /// Of a sample that is alive, as the next.
  const Sample& operator[](Index s) const { return disks_.knows_surface() ? disks_.sample(s) : balls_[slot(s)]; }

  /// Fragments that edits have changed so far, each as often as it was: what edits have cost, on any machine.
  std::uint64_t fragments_changed() const { return fragments_changed_; }

  /// Exact: do these disks keep the distance of the rule from each other and from all samples?
  bool are_apart(const std::vector<Sample>& disks, ConflictRule rule) const;

  /// Before and after edits that are made side by side, see SampleEdit::begin().
  void begin_side_by_side(RestrictedPowerDiagram::PendingEdits& edits) { diagram_.begin_side_by_side(edits); }
  void end_side_by_side(RestrictedPowerDiagram::PendingEdits& edits) { diagram_.end_side_by_side(edits); }

  /// RestrictedPowerDiagram::compact(); between edits.
  void compact(const Execution& execution) { diagram_.compact(execution); }

  /// Those that are alive: the given ones in order, then the new ones. `set`: in, the samples given to the constructor, whose
  /// memory is used again, or none. `ids` (out): of the rows. A twentieth of a second for a million samples.
  void collect(SampleSet& set, std::vector<Index>& ids) const;

 private:
  friend class SampleEdit;

  RestrictedPowerDiagram& diagram_;
  DiskSet& disks_;
  std::vector<Sample> balls_;  ///< only where disks do not know their surface: those that do are known to `disks_`
  std::vector<char> alive_, is_new_;
  std::vector<Index> given_;  ///< ids of those given to the constructor; empty: rows
  Index num_given_;
  std::vector<Index> free_;  ///< ids to be used again
  std::uint64_t fragments_changed_ = 0;
};

/// What an edit that was kept has done: enough to undo it.
struct SampleChange {
  struct Removed {
    Index id;
    Sample sample;
    bool is_new;
  };
  std::vector<Removed> removed;
  std::vector<Index> added;
  /// Samples alive after the edit whose fragments or dual triangles may be others than before, ascending.
  std::vector<Index> affected;
};

/// An edit. keep() or undo() ends it, once, and must do so before the next edit begins; it is not undone by its destructor,
/// since undoing may fail for want of memory. If a member throws, diagram and samples are of no use any more.
///
/// After undo() the diagram has the same sites, cells and corners as before the edit, bit by bit, and the grid gives the same
/// answers; samples and their ids are the same. (Fragments may be in other slots; ids that the edit has given out are free.)
class SampleEdit {
 public:
  /// `removed`: samples to go. The grid forgets them at once, so that it can be asked what would fit in their place; the
  /// diagram does in take_out().
  SampleEdit(EditableSamples& samples, const std::vector<Index>& removed);

  /// Takes those to go out of the diagram, before or after others enter. The diagram must not become empty.
  void take_out();
  /// Puts a sample in and returns its id. `near`: a sample in the diagram that is close to it.
  Index enter(const Sample& sample, Index near);
  /// Takes those that have entered out again; others may enter in their place.
  void withdraw();

  // Side by side with other edits: begin() of one after another; carry_out() of all, on as many threads; one after another
  // join() of all, and finish() of all. Then each is as one of which all have entered and all to go are taken out, and may go
  // on, in any order.

  /// enter() and take_out(), as far as they are not to be done by carry_out(). False, and nothing has changed, if that cannot
  /// be done beside those that have begun: then the edit has to be made alone.
  bool begin(const std::vector<Sample>& added, Index near, RestrictedPowerDiagram::PendingEdit& pending);
  /// changed_fragments() and affected() are up to date then.
  void carry_out(RestrictedPowerDiagram::PendingEdit& pending);
  void join(RestrictedPowerDiagram::PendingEdit& pending) { samples_.diagram_.join(pending); }
  /// True if more has changed than when carry_out() returned, of other edits, too.
  bool finish(RestrictedPowerDiagram::PendingEdit& pending);

  const std::vector<SampleChange::Removed>& removed() const { return change_.removed; }
  const std::vector<Index>& added() const { return change_.added; }
  bool has_added(Index s) const;
  /// Slots of fragments that were created, changed or freed so far, ascending, each once.
  const std::vector<Index>& changed_fragments();
  /// Samples alive now whose fragments or dual triangles may have changed so far, ascending, each once.
  const std::vector<Index>& affected();

  SampleChange keep();
  void undo();

  /// Undoes edits that were kept, the last one first; they must be the last ones of all. Returns the samples alive then that
  /// they had affected, ascending. `changes` is empty then.
  static std::vector<Index> undo_all(EditableSamples& samples, std::vector<SampleChange>& changes);

 private:
  SampleEdit(EditableSamples& samples, SampleChange&& change) : samples_(samples), change_(std::move(change)) {}

  Index take_id();
  void note_alive(const Sample& sample, Index s);
  Index insert_site(const Sample& sample, Index near);
  bool begin_insertion(const Sample& sample, Index near, RestrictedPowerDiagram::PendingEdit& pending);
  void remove_site(Index s);
  Index neighbor_that_stays() const;
  void note_changed();

  EditableSamples& samples_;
  SampleChange change_;
  std::vector<Index> changed_fragments_;
};

}  // namespace amps::detail
