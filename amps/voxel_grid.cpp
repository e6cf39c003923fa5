#define AMPS_OWN_SOURCE
#include "amps/voxel_grid.h"

#include "amps/exact.h"
#include "amps/predicates.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace amps::detail {
namespace {

/// Bits of a key for one coordinate.
constexpr int kVoxelBits = 21;
constexpr double kVoxelsPerAxis = 1 << kVoxelBits;

/// A voxel is this much wider than 2R, so that its half nearer to a sample is wider than R in spite of rounding: a coordinate
/// below 2^21 voxels is off by less than 2^-30. The same slack covers the rounding of levels and of distances to voxels.
constexpr double kVoxelExcess = 1e-6;

constexpr std::uint64_t kEmptyKey = ~std::uint64_t{0};  // no voxel: coordinates stay below 2^21 each, and bit 63 unset

/// Below, r² and the squares it is compared with would lose bits to underflow; above the reciprocal, to overflow.
constexpr double kSmallestVoxelWeight = 0x1p-900;

/// Bounds on a rounded squared distance that decide whether the exact one is below or above w. A sum of three squares of
/// differences carries a relative error of less than 5·2^-53 (one for each difference, squared, one for each product, two for
/// the sums), and comparing with these bounds adds one.
constexpr double kSurelyInside = 1 - 8 * kUnitRoundoff;
constexpr double kSurelyOutside = 1 + 8 * kUnitRoundoff;

/// The voxel of a dart first, then those across a face, an edge, and the corner: most darts conflict, and soon.
constexpr int kNearestOctantsFirst[8] = {0, 1, 2, 4, 3, 5, 6, 7};

double voxel_side(double radius) { return 2 * radius * (1 + kVoxelExcess); }

/// Coordinates from −1 on, as an unsigned number in each.
std::uint64_t voxel_key(std::uint64_t x, std::uint64_t y, std::uint64_t z) {
  constexpr std::uint64_t kBias = 1 | std::uint64_t{1} << kVoxelBits | std::uint64_t{1} << (2 * kVoxelBits);
  return x + (y << kVoxelBits) + (z << (2 * kVoxelBits)) + kBias;
}

/// Multiplicative hashing (Knuth, TAOCP 3, §6.4): 2^64 over the golden ratio.
std::size_t voxel_hash(std::uint64_t key, int shift) { return static_cast<std::size_t>((key * 0x9e3779b97f4a7c15u) >> shift); }

/// Rounds as squaredNorm() of the difference does.
double squared_distance(const Vec3& x, const double* sample) {
  const double dx = x[0] - sample[0];
  const double dy = x[1] - sample[1];
  const double dz = x[2] - sample[2];
  return dx * dx + dy * dy + dz * dz;
}

/// The largest radius that has voxels of its own. In a box of this extent a larger one reaches everything, as this does.
double coarsest_radius(const Box& box, double min_radius, double max_radius) {
  return std::max(min_radius, std::min(max_radius, (box.max - box.min).maxCoeff()));
}

}  // namespace

bool VoxelGrid::fits(const Box& box, double min_radius, double max_radius) {
  const double weight = min_radius * min_radius;
  if (!(min_radius > 0 && min_radius <= max_radius && weight >= kSmallestVoxelWeight &&
        max_radius * max_radius <= 1 / kSmallestVoxelWeight)) {
    return false;
  }
  double finest = coarsest_radius(box, min_radius, max_radius);
  while (finest / 2 >= min_radius) finest /= 2;
  return (box.max - box.min).maxCoeff() / voxel_side(finest) + 4 <= kVoxelsPerAxis;  // false for NaN
}

VoxelGrid::VoxelGrid(const Box& box, double min_radius, double max_radius)
    : origin_(box.min), equal_(min_radius == max_radius), weight_(min_radius * min_radius) {
  AMPS_ASSERT(fits(box, min_radius, max_radius));
  constexpr int kFirstSlots = 10;  // log2
  double radius = coarsest_radius(box, min_radius, max_radius);
  do {
    Level level;
    level.slots.assign(std::size_t{1} << kFirstSlots, Slot{kEmptyKey, kNone, 0});
    level.shift = 64 - kFirstSlots;
    level.radius = radius;
    level.weight_above = radius * radius / 4 * (1 - 4 * kVoxelExcess);
    level.weight_below = levels_.empty() && radius < max_radius ? INFINITY : radius * radius * (1 + 4 * kVoxelExcess);
    levels_.push_back(std::move(level));
    radius /= 2;
  } while (radius >= min_radius);
  per_cell_ = 1 / voxel_side(levels_.back().radius);
  extent_ = (box.max - box.min) * per_cell_;
}

/// Points outside of the box count as at its border: that brings no two points farther apart.
VoxelGrid::Place VoxelGrid::place(const Vec3& x) const {
  Place result;
  for (int axis = 0; axis < 3; ++axis) {
    const double f = std::min(std::max((x[axis] - origin_[axis]) * per_cell_, 0.0), extent_[axis]);
    const auto cell = static_cast<std::int64_t>(f);  // signed: one instruction where unsigned takes a branch
    result.cell[axis] = static_cast<std::uint64_t>(cell);
    result.within[axis] = f - static_cast<double>(cell);
  }
  return result;
}

/// The coarsest level whose radius halved is below the given one; the finest for what is smaller still.
int VoxelGrid::level_of(double radius) const {
  const int finest = static_cast<int>(levels_.size()) - 1;
  if (radius >= levels_.front().radius) return 0;
  if (radius <= levels_.back().radius) return finest;
  int exponent;  // of the ratio, in (2^(e−1), 2^e) or the lower end of it: rounding is the excess's
  std::frexp(levels_.front().radius / radius, &exponent);
  return std::min(exponent - 1, finest);
}

/// The slot that holds `key`, or the empty one where it belongs.
std::size_t VoxelGrid::find_slot(const Level& level, std::uint64_t key) {
  const std::size_t mask = level.slots.size() - 1;
  std::size_t i = voxel_hash(key, level.shift);
  while (level.slots[i].key != key && level.slots[i].key != kEmptyKey) i = (i + 1) & mask;
  return i;
}

/// The key of the voxel of a level that contains p.
std::uint64_t VoxelGrid::key_at(const Place& p, int level) const {
  const int shift = static_cast<int>(levels_.size()) - 1 - level;
  return voxel_key(p.cell[0] >> shift, p.cell[1] >> shift, p.cell[2] >> shift);
}

void VoxelGrid::prefetch_voxel(const Vec3& x, double radius) const {
  const int own = level_of(radius);
  const Level& level = levels_[static_cast<std::size_t>(own)];
  prefetch(&level.slots[voxel_hash(key_at(place(x), own), level.shift)]);
}

void VoxelGrid::prefetch_samples(const Vec3& x, double radius) const {
  const int own = level_of(radius);
  const Level& level = levels_[static_cast<std::size_t>(own)];
  const std::int32_t b = level.slots[find_slot(level, key_at(place(x), own))].block;
  if (b == kNone) return;
  const Block* const block = &blocks_[static_cast<std::size_t>(b)];
  prefetch(block);
  prefetch(&block->ids);
}

Index VoxelGrid::conflicting_sample(const Vec3& x, double radius, ConflictRule rule) const {
  Index found = kNone;
  visit_conflicts(x, radius, rule, [&](Index id) {
    found = id;
    return true;
  });
  return found;
}

void VoxelGrid::list_conflicts(const Vec3& x, double radius, ConflictRule rule, std::vector<Index>& found) const {
  found.clear();
  visit_conflicts(x, radius, rule, [&](Index id) {
    found.push_back(id);
    return false;
  });
}

/// Calls visit(id) for samples that a disk is too near to, until it returns true.
template <class Visit>
void VoxelGrid::visit_conflicts(const Vec3& x, double radius, ConflictRule rule, const Visit& visit) const {
  const bool by_max = rule == ConflictRule::kMax;
  if (equal_) {
    visit_conflicts_of_equals(x, by_max ? weight_ : std::min(weight_, radius * radius), visit);
  } else if (by_max) {
    visit_conflicts_by_max(x, radius, visit);
  } else {
    visit_conflicts_by_min(x, radius, visit);
  }
}

/// Of samples at squared distance < weight, which is at most that of all samples.
template <class Visit>
void VoxelGrid::visit_conflicts_of_equals(const Vec3& x, double weight, const Visit& visit) const {
  const double surely_inside = weight * kSurelyInside, surely_outside = weight * kSurelyOutside;
  const Level& level = levels_.front();
  const Place p = place(x);
  std::uint64_t other[3];  // the ball of x reaches out of its voxel on the near side only
  for (int axis = 0; axis < 3; ++axis) other[axis] = p.within[axis] < 0.5 ? p.cell[axis] - 1 : p.cell[axis] + 1;
  for (const int side : kNearestOctantsFirst) {
    const std::uint64_t key = voxel_key((side & 1) != 0 ? other[0] : p.cell[0], (side & 2) != 0 ? other[1] : p.cell[1],
                                        (side & 4) != 0 ? other[2] : p.cell[2]);
    for (std::int32_t b = level.slots[find_slot(level, key)].block; b != kNone;) {
      const Block& block = blocks_[static_cast<std::size_t>(b)];
      for (int i = 0; i < block.count; ++i) {
        const double* sample = block.positions[i];
        const double d2 = squared_distance(x, sample);
        if (d2 > surely_outside) continue;
        if ((d2 < surely_inside || side_of_ball(x.data(), sample, weight) < 0) && visit(block.ids[i])) return;
      }
      b = block.next;
    }
  }
}

/// Calls visit(slot, cell) for those of the 2³ voxels of a level nearest to p that there are, until it returns true.
template <class Visit>
bool VoxelGrid::visit_around(const Place& p, int level, const Visit& visit) const {
  const Level& at = levels_[static_cast<std::size_t>(level)];
  if (at.used == 0) return false;
  const int shift = static_cast<int>(levels_.size()) - 1 - level;
  Cell own, other;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    own[axis] = p.cell[axis] >> shift;
    const bool low_half = shift == 0 ? p.within[axis] < 0.5 : ((p.cell[axis] >> (shift - 1)) & 1) == 0;
    other[axis] = low_half ? own[axis] - 1 : own[axis] + 1;
  }
  for (const int side : kNearestOctantsFirst) {
    const Cell cell = {(side & 1) != 0 ? other[0] : own[0], (side & 2) != 0 ? other[1] : own[1],
                       (side & 4) != 0 ? other[2] : own[2]};
    const Slot& slot = at.slots[find_slot(at, voxel_key(cell[0], cell[1], cell[2]))];
    if (slot.key != kEmptyKey && visit(slot, cell)) return true;
  }
  return false;
}

/// Calls visit(slot, level) for the voxels below the given one, a parent before its children and near ones first, until it
/// returns true. Leaves out those whose squared distance from p, rounded down, is not below `limit`, which may shrink
/// meanwhile.
template <class Visit>
bool VoxelGrid::visit_below(const Place& p, int level, const Slot& parent, const Cell& cell, const double& limit,
                            const Visit& visit) const {
  const int shift = static_cast<int>(levels_.size()) - 2 - level;
  const Level& below = levels_[static_cast<std::size_t>(level) + 1];
  const double side = static_cast<double>(std::uint64_t{1} << shift);
  double at[3];       // p, in voxels of the finest level
  double gap[3][2];   // its squared distance from the lower and the upper half of the parent
  unsigned near = 0;  // the octant of the parent that p is in, or nearest to
  for (std::size_t axis = 0; axis < 3; ++axis) {
    at[axis] = static_cast<double>(p.cell[axis]) + p.within[axis];
    const double middle = static_cast<double>((2 * cell[axis] + 1) << shift);
    const double to_lower = std::max({middle - side - at[axis], at[axis] - middle, 0.0});
    const double to_upper = std::max({middle - at[axis], at[axis] - middle - side, 0.0});
    gap[axis][0] = to_lower * to_lower;
    gap[axis][1] = to_upper * to_upper;
    near |= at[axis] >= middle ? 1u << axis : 0u;
  }
  const double to_squared_distance = (1 - 4 * kVoxelExcess) / (per_cell_ * per_cell_);
  for (const int step : kNearestOctantsFirst) {
    const unsigned octant = near ^ static_cast<unsigned>(step);
    if ((parent.children >> octant & 1u) == 0) continue;
    const std::size_t bit[3] = {octant & 1u, octant >> 1 & 1u, octant >> 2 & 1u};
    if (!((gap[0][bit[0]] + gap[1][bit[1]] + gap[2][bit[2]]) * to_squared_distance < limit)) continue;
    const Cell child = {2 * cell[0] + bit[0], 2 * cell[1] + bit[1], 2 * cell[2] + bit[2]};
    const Slot& slot = below.slots[find_slot(below, voxel_key(child[0], child[1], child[2]))];
    if (visit(slot, level + 1)) return true;
    if (slot.children != 0 && visit_below(p, level + 1, slot, child, limit, visit)) return true;
  }
  return false;
}

/// Calls visit(id) for samples of the voxel at squared distance < combine(weight, its own), until it returns true. Combined
/// with the bounds of all weights of a level this decides about most samples without a look at theirs.
template <class Combine, class Visit>
bool VoxelGrid::visit_conflicts_in(const Slot& slot, int level, const Vec3& x, double weight, const Combine& combine,
                                   const Visit& visit) const {
  const Level& at = levels_[static_cast<std::size_t>(level)];
  const double inside = combine(weight, at.weight_above) * kSurelyInside;
  const double outside = combine(weight, at.weight_below) * kSurelyOutside;
  for (std::int32_t b = slot.block; b != kNone;) {
    const Block& block = blocks_[static_cast<std::size_t>(b)];
    for (int i = 0; i < block.count; ++i) {
      const double d2 = squared_distance(x, block.positions[i]);
      if (d2 > outside) continue;
      if (d2 < inside) {
        if (visit(block.ids[i])) return true;
        continue;
      }
      const double w = combine(weight, weights_[static_cast<std::size_t>(block.ids[i])]);
      if (d2 > w * kSurelyOutside) continue;
      if ((d2 < w * kSurelyInside || side_of_ball(x.data(), block.positions[i], w) < 0) && visit(block.ids[i])) return true;
    }
    b = block.next;
  }
  return false;
}

template <class Visit>
void VoxelGrid::visit_conflicts_by_max(const Vec3& x, double radius, const Visit& visit) const {
  const Place p = place(x);
  const int own = level_of(radius);
  const double weight = radius * radius, limit = weight * (1 + kVoxelExcess);
  const auto larger = [](double a, double b) { return std::max(a, b); };
  const auto in_voxel = [&](const Slot& slot, int level) { return visit_conflicts_in(slot, level, x, weight, larger, visit); };
  bool stopped = visit_around(p, own, [&](const Slot& slot, const Cell& cell) {
    return in_voxel(slot, own) || (slot.children != 0 && visit_below(p, own, slot, cell, limit, in_voxel));
  });
  for (int level = own - 1; level >= 0 && !stopped; --level) {
    stopped = visit_around(p, level, [&](const Slot& slot, const Cell&) { return in_voxel(slot, level); });
  }
}

template <class Visit>
void VoxelGrid::visit_conflicts_by_min(const Vec3& x, double radius, const Visit& visit) const {
  const Place p = place(x);
  const double weight = radius * radius;
  const auto smaller = [](double a, double b) { return std::min(a, b); };
  bool stopped = false;
  for (int level = static_cast<int>(levels_.size()) - 1; level >= 0 && !stopped; --level) {
    stopped = visit_around(
        p, level, [&](const Slot& slot, const Cell&) { return visit_conflicts_in(slot, level, x, weight, smaller, visit); });
  }
}

double VoxelGrid::nearest_squared_distance(const Vec3& x, double reach) const {
  const Place p = place(x);
  const int own = level_of(reach);
  double nearest = INFINITY;
  double limit = reach * reach * (1 + kVoxelExcess);
  const auto in_voxel = [&](const Slot& slot, int) {
    for (std::int32_t b = slot.block; b != kNone;) {
      const Block& block = blocks_[static_cast<std::size_t>(b)];
      for (int i = 0; i < block.count; ++i) nearest = std::min(nearest, squared_distance(x, block.positions[i]));
      b = block.next;
    }
    limit = std::min(limit, nearest);
    return false;
  };
  visit_around(p, own, [&](const Slot& slot, const Cell& cell) {
    in_voxel(slot, own);
    return slot.children != 0 && visit_below(p, own, slot, cell, limit, in_voxel);
  });
  for (int level = own - 1; level >= 0; --level) {
    visit_around(p, level, [&](const Slot& slot, const Cell&) { return in_voxel(slot, level); });
  }
  return nearest;
}

void VoxelGrid::insert(const Vec3& x, double radius, Index id) {
  if (equal_) {
    AMPS_ASSERT(radius * radius == weight_);
    const Place p = place(x);
    return store(slot_for(levels_.front(), voxel_key(p.cell[0], p.cell[1], p.cell[2])), x, id);
  }
  if (static_cast<std::size_t>(id) >= weights_.size()) weights_.resize(static_cast<std::size_t>(id) + 1);
  weights_[static_cast<std::size_t>(id)] = radius * radius;
  const Place p = place(x);
  const int own = level_of(radius), finest = static_cast<int>(levels_.size()) - 1;
  Slot& slot = slot_for(levels_[static_cast<std::size_t>(own)], key_at(p, own));
  const bool known = slot.block != kNone || slot.children != 0;
  store(slot, x, id);
  if (known) return;  // and so do its ancestors
  for (int level = own - 1; level >= 0; --level) {
    Slot& ancestor = slot_for(levels_[static_cast<std::size_t>(level)], key_at(p, level));
    const bool enough = ancestor.block != kNone || ancestor.children != 0;
    const int shift = finest - level - 1;
    const auto octant = (p.cell[0] >> shift & 1) | (p.cell[1] >> shift & 1) << 1 | (p.cell[2] >> shift & 1) << 2;
    ancestor.children = static_cast<std::uint8_t>(ancestor.children | 1u << octant);
    if (enough) return;
  }
}

/// The slot of a key, made if need be.
VoxelGrid::Slot& VoxelGrid::slot_for(Level& level, std::uint64_t key) {
  if (2 * (level.used + 1) > level.slots.size()) grow(level);
  Slot& slot = level.slots[find_slot(level, key)];
  if (slot.key == kEmptyKey) {
    slot.key = key;
    ++level.used;
  }
  return slot;
}

void VoxelGrid::store(Slot& slot, const Vec3& x, Index id) {
  AMPS_ASSERT(id >= 0);
  if (slot.block == kNone || blocks_[static_cast<std::size_t>(slot.block)].count == Block::kCapacity) {
    slot.block = new_block(slot.block);
  }
  Block& block = blocks_[static_cast<std::size_t>(slot.block)];
  for (int axis = 0; axis < 3; ++axis) block.positions[block.count][axis] = x[axis];
  block.ids[block.count++] = id;
}

std::int32_t VoxelGrid::new_block(std::int32_t next) {
  std::int32_t b = static_cast<std::int32_t>(blocks_.size());
  if (free_blocks_.empty()) {
    blocks_.emplace_back();
  } else {
    b = free_blocks_.back();
    free_blocks_.pop_back();
  }
  blocks_[static_cast<std::size_t>(b)] = Block{};
  blocks_[static_cast<std::size_t>(b)].next = next;
  return b;
}

/// Its place is taken by a sample of the newest block, the only one that may not be full.
void VoxelGrid::remove(const Vec3& x, double radius, Index id) {
  const int own = level_of(radius);
  Level& level = levels_[static_cast<std::size_t>(own)];
  Slot& slot = level.slots[find_slot(level, key_at(place(x), own))];
  Block& newest = blocks_[static_cast<std::size_t>(slot.block)];
  for (std::int32_t b = slot.block; b != kNone; b = blocks_[static_cast<std::size_t>(b)].next) {
    Block& block = blocks_[static_cast<std::size_t>(b)];
    for (int i = 0; i < block.count; ++i) {
      if (block.ids[i] != id) continue;
      const int last = --newest.count;
      std::copy_n(newest.positions[last], 3, block.positions[i]);
      block.ids[i] = newest.ids[last];
      if (last == 0) {
        free_blocks_.push_back(slot.block);
        slot.block = newest.next;
      }
      return;
    }
  }
  AMPS_ASSERT(false);
}

void VoxelGrid::grow(Level& level) {
  std::vector<Slot> old(2 * level.slots.size(), Slot{kEmptyKey, kNone, 0});
  old.swap(level.slots);
  --level.shift;
  for (const Slot& slot : old) {
    if (slot.key != kEmptyKey) level.slots[find_slot(level, slot.key)] = slot;
  }
}

}  // namespace amps::detail
