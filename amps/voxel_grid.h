// voxel_grid.h (internal): what dart throwing stands on — a grid that tells whether a dart is too near to a sample, and a table
// that draws facets by area.
//
// Yan & Wonka (2012, §3) use voxels of diagonal r with at most one sample each and look at 5³ of them. On a surface most of
// these are empty, and looking up an empty voxel costs as much as a full one. Voxels of side 2r hold about three samples, and
// the ball of a dart meets at most 2³ of them. Measured on the unit sphere, nanoseconds a dart with its share of insertions
// (0.75·10⁴ and 0.74·10⁵ samples): side 2r 57 and 93, side r (27 voxels, culled) 100 and 190, side r/√3 255 and 363, and one
// lookup a dart with each sample entered in all voxels its ball meets 89–156 and 320–530.
#pragma once

#include "amps/base.h"
#include "amps/mesh.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace amps::detail {

/// The samples of one radius r, and whether a point is at distance < r from one of them: |x − p|² < w, decided exactly, with
/// w the double r·r. Sparse and hashed: O(#samples) memory whatever the box. Constant expected time for a query or an
/// insertion as long as stored samples are not much nearer to each other than r. Queries may run concurrently.
class VoxelGrid {
 public:
  /// Can a grid be made: at most ~4e6·r a side, r² far from underflow and overflow? If not, the caller's error is kTooLarge.
  static bool fits(const Box& box, double radius);

  /// Requires fits(box, radius). Points given to the other members lie in the box, or at most r outside.
  VoxelGrid(const Box& box, double radius);

  /// Some stored sample at distance < r from x, or kNone. Which one, if there are several, depends on the order of insertion
  /// only.
  Index conflicting_sample(const Vec3& x) const;
  bool conflicts(const Vec3& x) const { return conflicting_sample(x) != kNone; }

  /// Stores a sample, whether or not it conflicts with others. `id` ≥ 0 is what conflicting_sample returns.
  void insert(const Vec3& x, Index id);

 private:
  /// Samples of a voxel, side by side: two cache lines. A voxel with more has a list of blocks, the newest first.
  struct Block {
    static constexpr int kCapacity = 4;
    double positions[kCapacity][3];
    Index ids[kCapacity];
    std::int32_t count;
    std::int32_t next;
  };
  /// Open addressing, linear probing, at most half full. The key packs the three coordinates of a voxel.
  struct Slot {
    std::uint64_t key;
    std::int32_t block;
  };
  struct Place {
    std::uint64_t cell[3];
    double within[3];  ///< position in the voxel, in [0, 1)
  };

  Place place(const Vec3& x) const;
  std::size_t find_slot(std::uint64_t key) const;
  void grow();

  Vec3 origin_;
  double per_cell_;                        ///< 1 / side of a voxel
  double weight_;                          ///< r·r
  double surely_inside_, surely_outside_;  ///< bounds on a rounded squared distance that decide without exact arithmetic
  std::vector<Slot> slots_;
  int shift_;  ///< 64 − log2(slots_.size())
  std::size_t used_slots_ = 0;
  std::vector<Block> blocks_;
};

/// Draws i with probability weights[i] / Σ weights in constant time: Walker's alias method as built by Vose (IEEE TSE 17(9),
/// 1991). The same table on every platform. Entries of weight 0 are never drawn.
class AliasTable {
 public:
  /// Throws Error(kInvalidArgument) if a weight is negative, NaN or infinite, or if none is positive. O(n).
  explicit AliasTable(const std::vector<double>& weights);

  /// Two draws of `rng`.
  Index pick(Rng& rng) const noexcept;

 private:
  struct Entry {
    double keep;  ///< chance of this entry, rather than its alias, once its column is drawn
    Index alias;
  };
  std::vector<Entry> entries_;
};

}  // namespace amps::detail
