// refill.h (internal): finds refills worth carrying out — which samples around a bad item to take out, and which ones to put in
// their place. They are tried in copies (trial_patch.h); nothing here changes anything, so many may look at once.
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

  /// kInPlace is the answer where nothing is found and a patch could not be copied (boundaries).
  Proposal find(const BadItem& item, Rng rng);

  /// Of refills of a patch around s of `change` samples more than there were (negative: fewer), the one that raises the energy
  /// least, and by less than `most`; `patch_size`: samples taken out, s and neighbours. kInPlace as above.
  Proposal find_of_count(Index s, int change, int patch_size, double most, Rng rng);

 private:
  void add_random_neighbor(Rng& rng);
  std::size_t corners_to_move(const BadItem& item, Rng& rng, std::array<Index, 3>& corner) const;
  bool try_patch(Rng& rng);
  bool copy_patch();
  int local(Index s);
  void list_pieces();
  std::size_t piece_at(double area) const;
  void fill_pool(Rng& rng);
  bool try_refill(Rng& rng);

  /// A triangle of a fragment: a corner and the edges from it.
  struct Piece {
    Index facet;
    Vec3 corner, u, v;
  };

  const RestrictedPowerDiagram& diagram_;
  const DualStars& stars_;
  const WantedRadii& radii_;
  int refills_;
  Index num_fixed_;
  double best_gain_ = 0;
  bool of_count_ = false;  ///< only refills of this many samples more than before count, whatever they cost beside energy
  int count_change_ = 0;
  bool all_good_ = false;  ///< nothing is bad in the patch any more, and no sample has been added: no need to look further
  Proposal proposal_;
  TrialPatch patch_, trial_;
  std::vector<Index> removed_, ids_;
  NearbyDisks others_;
  std::vector<Piece> pieces_;
  std::vector<double> up_to_;  ///< twice the area of a piece and all before it
  std::vector<Sample> pool_, chosen_;
  std::vector<std::uint8_t> open_;
};

}  // namespace amps::detail
