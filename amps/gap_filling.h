// gap_filling.h (internal): fills the gaps of a sample set, for whoever has one. Gaps are found in the restricted power diagram
// of the set; a gap is chosen with probability in proportion to ρ × area, a uniform random point of it becomes a sample, and
// what that has changed in the diagram is looked at anew, until no gap is left. That is the law of darts of density ρ that are
// thrown until no point is uncovered, without those that miss.
//
// Yan & Wonka, "Gap Processing for Adaptive Maximal Poisson-disk Sampling", ACM TOG 32(5), 2013, §4. Where we differ: the
// density is that of each point, not one for a gap; and large sets are filled stretch by stretch along a curve in space, see
// kSitesAtATime.
#pragma once

#include "amps/base.h"
#include "amps/disk_set.h"
#include "amps/execution.h"
#include "amps/gaps.h"
#include "amps/power_diagram.h"
#include "amps/samples.h"
#include "amps/wanted_radii.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

namespace amps::detail {

/// Non-negative weights with O(log n) update and choice in proportion to them. Sums are recomputed from the leaves, never
/// incremented, so they depend on the weights alone.
class SumTree {
 public:
  double total() const { return nodes_.empty() ? 0.0 : nodes_[1]; }

  /// Room for so many weights, of which set() otherwise makes more when it needs it.
  void grow(std::size_t wanted);

  /// i ≥ 0; weights not set are 0.
  void set(Index i, double weight);

  /// All weights at once, in place of what was there. O(n).
  void assign(const std::vector<double>& weights);

  double weight(Index i) const { return slot(i) < leaves_ ? nodes_[leaves_ + slot(i)] : 0.0; }

  /// Where the running sum of weights passes u times their total, u in [0, 1): a place of positive weight. Requires
  /// total() > 0.
  Index pick(double u) const;

 private:
  void add_up();

  std::vector<double> nodes_;  ///< children of node i: 2i and 2i + 1; leaves last
  std::size_t leaves_ = 0;
};

/// When to stop before all gaps are filled.
struct GapFillLimits {
  Index max_samples = std::numeric_limits<Index>::max();
  const Execution* execution = nullptr;  ///< whom to tell, who may cancel; null: nobody
};

/// What came of it.
struct GapFilling {
  enum class End { kFilled, kGaveUp, kCancelled } end = End::kFilled;  ///< kGaveUp: max_samples were not enough
  Index samples = 0;                                                   ///< entered
  Index unfilled = 0;  ///< gaps that hold no double at the wanted distance: 0 unless the mesh lies > 1e6·r from the origin
  /// Is every point of what was looked at covered?
  bool complete() const { return end == End::kFilled && unfilled == 0; }
};

/// Keeps for each fragment the area of its gap times a bound of ρ there. To fill all gaps: look_at_all(), fill(). After a local
/// change of the diagram, where all else is covered: look_at() what has changed, fill(), forget(). One object per thread.
class GapFiller {
 public:
  /// Enters a sample into the diagram, the disks, and whatever else its owner keeps: that is also where a caller who may want
  /// to undo it all takes notes. `near`: a site close to it. The filler looks at the diagram's changed() afterwards.
  using Enter = std::function<void(const Sample& sample, Index near)>;

  /// Enters samples that are in the disks by now into the diagram: RestrictedPowerDiagram::insert_together().
  using Arrivals = RestrictedPowerDiagram::Arrivals;
  using EnterSites = std::function<void(Arrivals& now, Arrivals& next, const std::function<void()>& draw,
                                        const RestrictedPowerDiagram::Measure& measure)>;

  /// All must outlive it. The disks are the sites of the diagram that are not removed, with radii whose rounded squares are
  /// their weights.
  GapFiller(const RestrictedPowerDiagram& diagram, const DiskSet& disks, const WantedRadii& radii)
      : diagram_(diagram), disks_(disks), radii_(radii) {}

  /// O(n log n), with nothing looked at before. Gaps are found on the threads of `execution`. Cancelled, it throws
  /// Error(kCancelled).
  void look_at_all(const Execution& execution = {});
  /// Slots of fragments, alive or not, in any order. O(log n) each.
  void look_at(const std::vector<Index>& fragments);
  /// As if nothing had been looked at. O(what was looked at).
  void forget();

  bool has_gaps() const;
  /// Has one of these fragments a gap? They are not looked at as by look_at().
  bool has_gap_in(const std::vector<Index>& fragments);
  /// Darts into the gaps of what was looked at, and of what changes meanwhile.
  GapFilling fill(Rng& rng, const GapFillLimits& limits, const Enter& enter);
  /// By the same law, with several samples at a time entered into the diagram: `enter` enters a sample into everything else,
  /// maybe on another thread. Darts are thrown into the gaps as they were some samples ago, and one that lies in a disk of
  /// these is left out. Requires can_fill_together().
  GapFilling fill_together(Rng& rng, const GapFillLimits& limits, const Enter& enter, const EnterSites& enter_sites);
  /// By the max rule, and with equal radii. (The min rule is for comparisons.)
  bool can_fill_together() const { return radii_.uniform() || radii_.rule() == ConflictRule::kMax; }

 private:
  /// Gaps among which one is chosen.
  struct Stretch {
    SumTree gaps;                    ///< by place: area × greatest ρ of the gap of a fragment
    std::vector<Index> fragment_at;  ///< by place
    Index num_gaps = 0;
  };
  /// Where a fragment is that has or had a gap.
  struct Place {
    Index stretch = kNone, at = kNone;
  };
  enum class Dart { kStays, kThinned, kTaken, kNoRoom };

  /// A run of fill().
  struct Run {
    Rng& rng;
    const GapFillLimits& limits;
    GapFilling result;
    double at_start = 0;  ///< total weight
    double done = 0;
    std::uint64_t gaps = 0;  ///< chosen
    int thinned = 0;         ///< darts in a row
  };
  class Turns;

  Run start(Rng& rng, const GapFillLimits& limits) const;
  bool goes_on(Run& run) const;
  bool draw_sample(Run& run, Index stretch, Sample& sample, Index& near);
  void draw_samples(Run& run, Index stretch, const Enter& enter, Arrivals& drawn);
  bool has_gaps(Index stretch) const { return stretches_[slot(stretch)].gaps.total() > 0; }
  void move_gaps(Index from, Index to);
  void enter_changes();
  std::vector<double> all_weights(const Execution& execution) const;
  double gap_weight(Index f, FragmentGap& gap) const;
  double gap_weight(const RestrictedPowerDiagram::Polygon& polygon, FragmentGap& gap) const;
  void set_weight(Index f, double weight);
  void refresh(Index f) { set_weight(f, gap_weight(f, gap_)); }
  double total_weight() const;
  bool surely_covered(Index f) const;
  double greatest_density(Index facet, const FragmentGap& gap) const;
  Dart throw_darts_into(Index f, double weight, Rng& rng, Sample& sample);
  bool is_free(const SurfacePoint& at, Index covers, const RestrictedPowerDiagram::Polygon& polygon, double slack) const;

  const RestrictedPowerDiagram& diagram_;
  const DiskSet& disks_;
  const WantedRadii& radii_;
  FragmentGap gap_;
  std::vector<Stretch> stretches_ = std::vector<Stretch>(1);
  Index current_ = 0;            ///< the stretch that gaps of new fragments belong to
  std::vector<Place> place_of_;  ///< by slot of a fragment
};

}  // namespace amps::detail
