// optimize_refiller.h (internal): carries out refills in the diagram, one by one or several side by side, and keeps those that
// are better. What a RefillFinder proposes (refill.h) was found in copies; here the diagram decides: gaps that a refill leaves
// are filled, the stars of all samples it affects are rated, and the topology is looked at. What is carried out when, the
// schedule says (optimize.cpp).
#pragma once

#include "amps/base.h"
#include "amps/dual_star.h"
#include "amps/gap_filling.h"
#include "amps/optimize_state.h"
#include "amps/power_diagram.h"
#include "amps/refill.h"
#include "amps/sample_edit.h"
#include "amps/topology_certificate.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

namespace amps::detail {

/// Edits that were kept, to be undone together if they are no improvement.
struct EditSeries {
  std::vector<SampleChange> changes;
  double energy_change = 0;
};

/// Carries out refills, and keeps those that lower the energy of all samples affected: their stars are the only ones to change.
/// One that is kept leaves a maximal Poisson-disk set, every sample with a part of the surface, and, where the state has a
/// TopologyChecker, the dual homeomorphic to what it was; any other is undone. Stars, `unseen` and, in the report, trials made
/// here, edits and accepted are kept up to date. Only carry_out_beside() may be called concurrently. No member throws
/// Error(kCancelled); if one throws, the state is of no use any more.
class Refiller {
 public:
  /// Items of a batch, at most. A batch is planned before the last one is carried out: the more items, the more of what was
  /// found is out of date.
  static constexpr std::size_t kItemsPerBatch = 8;

  /// `state` must outlive it, and its samples are edited by nobody else. O(samples).
  explicit Refiller(OptimizeState& state);

  /// Edits kept so far: the present state, for carry_out() to compare with.
  std::uint64_t time() const { return time_; }

  /// What was proposed for a bad item at that time, unless an edit since then has changed what it relies on. A proposal of kind
  /// kInPlace is tried as by refill_in_place(). So is any other one at a first corner where the diagram has shown a refill to
  /// be less than its copy promised, until an edit changes that corner's star.
  void carry_out(const BadItem& item, const Proposal& proposal, std::uint64_t planned_at);

  // Several refills side by side: begin_batch(), begin() of one after another, carry_out_beside() of each, on as many threads,
  // and end_batch(). In between nobody else may read the diagram or carry out refills.

  void begin_batch();

  /// kYes: it has begun. kNothing: what carry_out() would do nothing about, or disks that are too near to those of another
  /// sheet. kAlone: it has not begun, and is to be carried out by itself after the batch.
  enum class Begun { kYes, kNothing, kAlone };

  /// Up to kItemsPerBatch times; arguments as those of carry_out(). What comes of it is as if each ended before the next began.
  Begun begin(const BadItem& item, const Proposal& proposal, std::uint64_t planned_at);

  /// Those that have begun and not ended.
  std::size_t num_begun() const { return num_begun_; }

  /// The k-th of them; each once. May be called concurrently, each for another one.
  void carry_out_beside(std::size_t k);

  /// Keeps or undoes each of them, those that have left gaps last.
  void end_batch();

  /// After the last batch.
  void give_back() { state_.samples.end_side_by_side(pending_); }

  enum class Accept { kBetter, kAny };  ///< kAny: whatever it does to the energy

  /// Tries a random patch in the diagram itself, of `more` samples than usual: some refills, of which the first one that is
  /// accepted is kept. Nothing where no sample may go, or where affords_edits_in_place() is false. A cancel ends it early.
  void refill_in_place(const BadItem& item, Accept accept, int more = 0);

  /// Refills in place can take a tenth of a second each, beside sheets that crowd.
  bool is_cancelled() const { return state_.options.execution.cancelled(); }

  /// False where edits in place have come to their end, which they do only while crossings are rated.
  bool affords_edits_in_place() const;
  /// They have not come to their end any more.
  void count_edits_in_place_anew() { edits_in_place_ = 0; }

  /// What the edits that were kept have changed in all. (Up to rounding: for telling progress.)
  double energy_change_of_all() const { return energy_change_of_all_; }

  /// Edits kept from now on are added to a series (null: no more).
  void record(EditSeries* series) { series_ = series; }

  /// Undoes the edits of a series, which must be the last ones that were kept, and of which the list is empty then. The report
  /// goes on counting them.
  void undo(EditSeries& series);

 private:
  /// What an edit makes of the samples it affects.
  struct EditRating {
    AffectedStars stars;
    double energy_change = 0;
  };

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

  Index num_samples() const { return state_.diagram.num_sites() - state_.diagram.num_removed(); }
  bool changed_since(std::uint64_t time, Index s) const { return changed_at_[slot(s)] > time; }
  void grow();
  bool fill(SampleEdit& edit);
  std::vector<Index> random_patch(const BadItem& item, int more);
  void take_free(std::vector<Index>& patch);
  void rate(SampleEdit& edit, StarReader& reader, EditRating& rating) const;
  bool is_good(SampleEdit& edit, const EditRating& rating, Accept accept);
  void keep_or_undo(SampleEdit& edit, const EditRating& rating, const BadItem& item);
  void fill_and_end(SampleEdit& edit, const BadItem& item);
  bool is_due(const BadItem& item, const Proposal& proposal, std::uint64_t planned_at);
  bool is_for_in_place(const BadItem& item, const Proposal& proposal) const;
  bool starts(SampleEdit& edit, const BadItem& item, const Proposal& proposal);
  bool hides_a_sample(SampleEdit& edit) const;
  bool keeps_topology(SampleEdit& edit, const AffectedStars& stars);
  void keep(SampleEdit& edit, const EditRating& rating);

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

}  // namespace amps::detail
