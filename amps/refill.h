// refill.h (internal): finds refills worth carrying out — which samples around a bad item to take out, and which ones to put in
// their place. They are tried in copies (trial_patch.h); nothing here changes anything, so many may look at once. What to try
// is planned first and the cells concerned are copied with it, so that trials can be made while the diagram is being edited.
#pragma once

#include "amps/base.h"
#include "amps/dual_star.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"
#include "amps/samples.h"
#include "amps/trial_patch.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace amps::detail {

/// What to do about a bad item.
struct Proposal {
  enum class Kind {
    kNothing,
    kRefill,   ///< removed and added are an improvement as far as copies tell
    kInPlace,  ///< there was no copy to try on: try in the diagram itself
  } kind = Kind::kNothing;
  std::vector<Index> removed;
  std::vector<Sample> added;
  std::vector<Index> seen;  ///< samples it depends on
  std::uint64_t trials = 0;
};

/// Stars and sites by sample as they were at some time, for finders to look at while those of the diagram change.
struct SeenSamples {
  StarTable star;
  std::vector<WeightedPoint> site;

  void resize(std::size_t samples) {
    star.resize(samples);
    site.resize(samples);
  }
  void reserve(std::size_t samples) {
    star.reserve(samples);
    site.reserve(samples);
  }
};

/// What to try around a bad item: patches to take out, and their cells.
struct RefillPlan {
  static constexpr std::size_t kMaxPatchSize = 5;

  struct Patch {
    std::array<Index, kMaxPatchSize> removed;
    std::size_t size = 0;

    const Index* begin() const { return removed.data(); }
    const Index* end() const { return removed.data() + size; }
    bool has(Index s) const { return std::find(begin(), end(), s) != end(); }
    void add(Index s) { removed[size++] = s; }
  };
  /// A triangle of a fragment: a corner and the edges from it.
  struct Piece {
    Index facet;
    Vec3 corner, u, v;
  };
  /// The pieces of a sample's cell: from the end of those of the cell before.
  struct Cell {
    Index sample;
    std::size_t end;
  };

  void clear() {
    patches.clear();
    cells.clear();
    pieces.clear();
  }

  std::vector<Patch> patches;   ///< in the order of trying
  std::size_t num_singles = 0;  ///< of them, the first: of these the best counts, of the others the first that is better
  std::vector<Cell> cells;      ///< of all samples of patches that have a star
  std::vector<Piece> pieces;
};

/// The disks of a patch side by side, for many tests whose outcome cannot be predicted: eight at a time, without branches.
class NearbyDisks {
 public:
  /// Those from `first` on; near ones should come first.
  void assign(const TrialPatch& patch, int first);

  /// Is x in none of them? If so, `nearest` is the squared distance of the nearest centre.
  bool are_apart(const Vec3& x, double& nearest) const {
    for (std::size_t begin = 0; begin < size_; begin += kBlock) {
      double depth = INFINITY;
      for (std::size_t k = begin; k < begin + kBlock; ++k) {
        const double dx = x_[k] - x[0], dy = y_[k] - x[1], dz = z_[k] - x[2], d = dx * dx + dy * dy + dz * dz;
        depth = std::min(depth, d - weight_[k]);
        nearest = std::min(nearest, d);
      }
      if (depth < 0) return false;
    }
    return true;
  }

 private:
  static constexpr std::size_t kBlock = 8;
  static constexpr std::size_t kRoom = static_cast<std::size_t>(TrialPatch::kMaxVertices);
  static_assert(kRoom % kBlock == 0, "");
  void add(const Vec3& x, double weight);

  std::array<double, kRoom> x_, y_, z_, weight_;
  std::size_t size_ = 0;
};

/// Looks for refills that improve what is around a bad item. One per thread; what it is given must outlive it.
class RefillFinder {
 public:
  /// `refills`: tried of each patch. Samples below `num_fixed` stay.
  RefillFinder(const RestrictedPowerDiagram& diagram, const DualStars& stars, const DualRating& rating,
               const WantedRadii& radii, int refills, Index num_fixed = 0)
      : diagram_(diagram),
        stars_(stars),
        radii_(radii),
        refills_(refills),
        num_fixed_(num_fixed),
        patch_(rating),
        trial_(rating) {}

  /// Stars and sites are looked up in `seen` from now on, by all but plan(); it must be up to date where plans are carried out.
  void look_at(const SeenSamples& seen) { seen_ = &seen; }

  /// What find() is to try for an item; `rng` moves on. Reads the diagram and its stars. Some microseconds.
  void plan(const BadItem& item, Rng& rng, RefillPlan& plan) const;

  /// The refill that is proposed of those planned. Does not read the diagram's cells, and with look_at() neither its stars nor
  /// its sites: these may be edited meanwhile. kInPlace is the answer where nothing is found and a patch could not be copied
  /// (boundaries).
  Proposal find(const RefillPlan& plan, Rng rng);
  /// Both.
  Proposal find(const BadItem& item, Rng rng);

  /// Of refills of a patch around s of `change` samples more than there were (negative: fewer), the one that raises the energy
  /// least, and by less than `most`; `patch_size`: samples taken out, s and neighbours. kInPlace as above.
  Proposal find_of_count(Index s, int change, int patch_size, double most, Rng rng);

 private:
  void add_random_neighbor(RefillPlan::Patch& patch, Rng& rng) const;
  void add_cells(RefillPlan& plan) const;
  std::size_t corners_to_move(const BadItem& item, Rng& rng, std::array<Index, 3>& corner) const;
  bool try_patch(const RefillPlan& plan, const RefillPlan::Patch& patch, Rng& rng);
  bool copy_patch();
  int local(Index s);
  StarView star(Index s) const { return seen_ != nullptr ? seen_->star[slot(s)] : stars_.star[slot(s)]; }
  const WeightedPoint& site(Index s) const { return seen_ != nullptr ? seen_->site[slot(s)] : diagram_.site(s); }
  void list_pieces(const RefillPlan& plan);
  std::size_t piece_at(double area) const;
  void fill_pool(const RefillPlan& plan, Rng& rng);
  bool try_refill(Rng& rng);

  const RestrictedPowerDiagram& diagram_;
  const DualStars& stars_;
  const SeenSamples* seen_ = nullptr;
  const WantedRadii& radii_;
  int refills_;
  Index num_fixed_;
  double best_gain_ = 0;
  bool of_count_ = false;  ///< only refills of this many samples more than before count, whatever they cost beside energy
  int count_change_ = 0;
  bool all_good_ = false;  ///< nothing is bad in the patch any more, and no sample has been added: no need to look further
  Proposal proposal_;
  RefillPlan plan_;  ///< where none is given
  TrialPatch patch_, trial_;
  std::vector<Index> removed_, ids_;
  NearbyDisks others_;
  std::vector<RefillPlan::Piece> pieces_;
  std::vector<double> up_to_;  ///< twice the area of a piece and all before it
  std::vector<Sample> pool_, chosen_;
  std::vector<std::uint8_t> open_;
};

}  // namespace amps::detail
