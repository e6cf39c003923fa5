// voxel_grid.h (internal): the grid that tells whether a dart is too near to a sample.
//
// Yan & Wonka (2012, §3) use one grid of voxels of diagonal r_min, with at most one sample each, and look at all voxels that a
// dart's ball meets: 5³ of them where r = r_min, 80³ where r = 16 r_min. We depart from that twice.
//
// Voxels are wide. On a surface most small voxels are empty, and looking up an empty voxel costs as much as a full one. Voxels
// of side 2r hold about three samples, and the ball of a dart meets at most 2³ of them (other sides: tests/bench/README.md).
//
// There is a grid for each size of disk. Level k holds the samples with R/2 < r ≤ R, R = 2^−k·r_max, in voxels of side 2R, each
// voxel of level k being 2³ of level k + 1. At its own level and at each coarser one a dart looks at 2³ voxels; of the finer
// levels it sees only what its ball meets, going down from its own 2³ voxels through children that hold samples. Levels of
// equal radii are thus all there is to a uniform set, and levels without samples cost nothing.
#pragma once

#include "amps/base.h"
#include "amps/mesh.h"
#include "amps/samples.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace amps::detail {

/// Samples with their radii, and which of them a dart conflicts with. Distances are compared with radii exactly: |x − p|² < w
/// with w the double r·r. Sparse and hashed: O(#samples) memory whatever the box and the range of radii, as long as samples of
/// few levels share a place (a sample far from all others takes a slot of 16 bytes on each coarser level). Queries may run
/// concurrently. What a query costs holds for sets whose samples are not much nearer to each other than their radii.
class VoxelGrid {
 public:
  /// Can a grid be made: at most ~4e6·min_radius a side, r² far from underflow and overflow? If not, the caller's error is
  /// kTooLarge.
  static bool fits(const Box& box, double min_radius, double max_radius);

  /// For samples with radii in [min_radius, max_radius]; requires fits(). Equal bounds make one radius of all, and queries
  /// faster. Points given to the other members should lie in the box: what lies outside costs time.
  VoxelGrid(const Box& box, double min_radius, double max_radius);

  /// Start to fetch what a query or an insertion at x will look at first: its voxel; once that is there, the samples in it.
  void prefetch_voxel(const Vec3& x, double radius) const;
  void prefetch_samples(const Vec3& x, double radius) const;

  /// Some stored sample p that a disk (x, radius) is too near to by the rule, |x − p| < max or min(radius, r_p), or kNone;
  /// radius in [0, max_radius]. With radius 0 and the max rule: a sample whose disk holds x. Which one, if there are several,
  /// depends on the order of insertion only. O(1) expected a level that has samples, but by the max rule for darts that
  /// conflict with nothing beside a step in the radii: those pay for the small samples along their ball, which is O(1) for
  /// each of them.
  Index conflicting_sample(const Vec3& x, double radius, ConflictRule rule) const;

  /// All that conflicting_sample() chooses from, in an order that depends on the order of insertion only.
  void list_conflicts(const Vec3& x, double radius, ConflictRule rule, std::vector<Index>& found) const;

  /// The least squared distance, as rounded by squaredNorm(), to a stored sample within about `reach`, at most the grid's
  /// greatest radius; +inf or more than reach² if there is none.
  double nearest_squared_distance(const Vec3& x, double reach) const;

  /// Stores a sample, whether or not it conflicts with others. `id` ≥ 0 is what conflicting_sample returns; ids are
  /// consecutive, or memory is wasted. Where radii are equal, `radius` is that one.
  void insert(const Vec3& x, double radius, Index id);

  /// Makes room for `factor` times what it takes by now.
  void reserve(double factor) { blocks_.reserve(static_cast<std::size_t>(factor * static_cast<double>(blocks_.size()))); }

  /// Takes a sample out again that was stored with exactly these values; its id may be stored anew. O(1) expected.
  void remove(const Vec3& x, double radius, Index id);

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
    std::int32_t block;     ///< kNone: no sample of this level
    std::uint8_t children;  ///< bit c: child c holds samples, or some descendant of it does
  };
  struct Level {
    std::vector<Slot> slots;
    int shift;  ///< 64 − log2(slots.size())
    std::size_t used = 0;
    double radius;        ///< R: the largest of its radii
    double weight_above;  ///< no sample has a weight below this
    double weight_below;  ///< or above this
  };
  struct Place {
    std::uint64_t cell[3];  ///< of the finest level
    double within[3];       ///< position in the voxel, in [0, 1)
  };
  using Cell = std::array<std::uint64_t, 3>;

  Place place(const Vec3& x) const;
  int level_of(double radius) const;
  std::uint64_t key_at(const Place& p, int level) const;
  template <class Visit>
  void visit_conflicts(const Vec3& x, double radius, ConflictRule rule, const Visit& visit) const;
  template <class Visit>
  void visit_conflicts_of_equals(const Vec3& x, double weight, const Visit& visit) const;
  template <class Visit>
  void visit_conflicts_by_max(const Vec3& x, double radius, const Visit& visit) const;
  template <class Visit>
  void visit_conflicts_by_min(const Vec3& x, double radius, const Visit& visit) const;
  static std::size_t find_slot(const Level& level, std::uint64_t key);
  template <class Visit>
  bool visit_around(const Place& p, int level, const Visit& visit) const;
  template <class Visit>
  bool visit_below(const Place& p, int level, const Slot& parent, const Cell& cell, const double& limit,
                   const Visit& visit) const;
  template <class Combine, class Visit>
  bool visit_conflicts_in(const Slot& slot, int level, const Vec3& x, double weight, const Combine& combine,
                          const Visit& visit) const;
  Slot& slot_for(Level& level, std::uint64_t key);
  void store(Slot& slot, const Vec3& x, Index id);
  std::int32_t new_block(std::int32_t next);
  static void grow(Level& level);

  Vec3 origin_;
  Vec3 extent_;                ///< of the box, in voxels of the finest level
  double per_cell_;            ///< 1 / side of a voxel of the finest level
  bool equal_;                 ///< one radius for all
  double weight_;              ///< its square, rounded
  std::vector<Level> levels_;  ///< coarsest first
  std::vector<Block> blocks_;
  std::vector<std::int32_t> free_blocks_;
  std::vector<double> weights_;  ///< by id, where radii differ
};

}  // namespace amps::detail
