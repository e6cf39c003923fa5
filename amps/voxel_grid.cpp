#define AMPS_OWN_SOURCE
#include "amps/voxel_grid.h"

#include "amps/exact.h"
#include "amps/predicates.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace amps::detail {
namespace {

/// Bits of a key for one coordinate.
constexpr int kVoxelBits = 21;
constexpr double kVoxelsPerAxis = 1 << kVoxelBits;

/// Voxels left free on each side of the box, so that a point up to r outside and its neighbour voxels have coordinates ≥ 0.
constexpr double kVoxelMargin = 2;

/// A voxel is this much wider than 2r, so that its half nearer to a sample is wider than r in spite of rounding: a coordinate
/// below 2^21 voxels is off by less than 2^-30.
constexpr double kVoxelExcess = 1e-6;

constexpr std::uint64_t kEmptyKey = ~std::uint64_t{0};  // no voxel: coordinates stay below 2^21 each, and bit 63 unset

/// Below, r² and the squares it is compared with would lose bits to underflow; above the reciprocal, to overflow.
constexpr double kSmallestVoxelWeight = 0x1p-900;

double voxel_side(double radius) { return 2 * radius * (1 + kVoxelExcess); }

std::uint64_t voxel_key(std::uint64_t x, std::uint64_t y, std::uint64_t z) {
  return x | y << kVoxelBits | z << (2 * kVoxelBits);
}

/// Multiplicative hashing (Knuth, TAOCP 3, §6.4): 2^64 over the golden ratio.
std::size_t voxel_hash(std::uint64_t key, int shift) { return static_cast<std::size_t>((key * 0x9e3779b97f4a7c15u) >> shift); }

}  // namespace

bool VoxelGrid::fits(const Box& box, double radius) {
  const double weight = radius * radius;
  if (!(radius > 0 && weight >= kSmallestVoxelWeight && weight <= 1 / kSmallestVoxelWeight)) return false;
  const double extent = (box.max - box.min).maxCoeff();
  return extent / voxel_side(radius) + 2 * kVoxelMargin + 1 <= kVoxelsPerAxis;  // false for NaN
}

VoxelGrid::VoxelGrid(const Box& box, double radius)
    : origin_(box.min - Vec3::Constant(kVoxelMargin * voxel_side(radius))),
      per_cell_(1 / voxel_side(radius)),
      weight_(radius * radius),
      // A sum of three squares of differences carries a relative error of less than 5·2^-53 (one for each difference, squared,
      // one for each product, two for the sums), and comparing with these bounds adds one.
      surely_inside_(weight_ * (1 - 8 * kUnitRoundoff)),
      surely_outside_(weight_ * (1 + 8 * kUnitRoundoff)),
      slots_(1024, Slot{kEmptyKey, kNone}),
      shift_(64 - 10) {
  AMPS_ASSERT(fits(box, radius));
}

VoxelGrid::Place VoxelGrid::place(const Vec3& x) const {
  Place result;
  for (int axis = 0; axis < 3; ++axis) {
    const double f = std::min(std::max((x[axis] - origin_[axis]) * per_cell_, 1.0), kVoxelsPerAxis - 2);
    const auto cell = static_cast<std::int64_t>(f);  // signed: one instruction where unsigned takes a branch
    result.cell[axis] = static_cast<std::uint64_t>(cell);
    result.within[axis] = f - static_cast<double>(cell);
  }
  return result;
}

/// The slot that holds `key`, or the empty one where it belongs.
std::size_t VoxelGrid::find_slot(std::uint64_t key) const {
  const std::size_t mask = slots_.size() - 1;
  std::size_t i = voxel_hash(key, shift_);
  while (slots_[i].key != key && slots_[i].key != kEmptyKey) i = (i + 1) & mask;
  return i;
}

Index VoxelGrid::conflicting_sample(const Vec3& x) const {
  const Place p = place(x);
  std::uint64_t other[3];  // the ball of x reaches out of its voxel on the near side only
  for (int axis = 0; axis < 3; ++axis) other[axis] = p.within[axis] < 0.5 ? p.cell[axis] - 1 : p.cell[axis] + 1;

  // The voxel of x first, then those across a face, an edge, and the corner: most darts conflict, and soon.
  static constexpr int kOrder[8] = {0, 1, 2, 4, 3, 5, 6, 7};
  for (const int side : kOrder) {
    const std::uint64_t key = voxel_key((side & 1) != 0 ? other[0] : p.cell[0], (side & 2) != 0 ? other[1] : p.cell[1],
                                        (side & 4) != 0 ? other[2] : p.cell[2]);
    for (std::int32_t b = slots_[find_slot(key)].block; b != kNone;) {
      const Block& block = blocks_[static_cast<std::size_t>(b)];
      for (int i = 0; i < block.count; ++i) {
        const double* sample = block.positions[i];
        const double dx = x[0] - sample[0];
        const double dy = x[1] - sample[1];
        const double dz = x[2] - sample[2];
        const double squared_distance = dx * dx + dy * dy + dz * dz;
        if (squared_distance > surely_outside_) continue;
        if (squared_distance < surely_inside_ || side_of_ball(x.data(), sample, weight_) < 0) return block.ids[i];
      }
      b = block.next;
    }
  }
  return kNone;
}

void VoxelGrid::insert(const Vec3& x, Index id) {
  AMPS_ASSERT(id >= 0);
  if (2 * (used_slots_ + 1) > slots_.size()) grow();
  const Place p = place(x);
  const std::uint64_t key = voxel_key(p.cell[0], p.cell[1], p.cell[2]);
  Slot& slot = slots_[find_slot(key)];
  if (slot.block == kNone || blocks_[static_cast<std::size_t>(slot.block)].count == Block::kCapacity) {
    Block block{};
    block.next = slot.block;
    blocks_.push_back(block);
    if (slot.block == kNone) ++used_slots_;
    slot = {key, static_cast<std::int32_t>(blocks_.size() - 1)};
  }
  Block& block = blocks_[static_cast<std::size_t>(slot.block)];
  for (int axis = 0; axis < 3; ++axis) block.positions[block.count][axis] = x[axis];
  block.ids[block.count++] = id;
}

void VoxelGrid::grow() {
  std::vector<Slot> old(2 * slots_.size(), Slot{kEmptyKey, kNone});
  old.swap(slots_);
  --shift_;
  for (const Slot& slot : old) {
    if (slot.key != kEmptyKey) slots_[find_slot(slot.key)] = slot;
  }
}

AliasTable::AliasTable(const std::vector<double>& weights) : entries_(weights.size()) {
  const std::size_t n = weights.size();
  double largest = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!(weights[i] >= 0 && std::isfinite(weights[i]))) {
      throw Error(ErrorCode::kInvalidArgument, "AliasTable: weight " + std::to_string(i) +
                                                   " is negative or not finite; weights must be finite and at least 0");
    }
    largest = std::max(largest, weights[i]);
  }
  if (!(largest > 0)) throw Error(ErrorCode::kInvalidArgument, "AliasTable: no weight is positive, so nothing can be drawn");

  // Mass of each entry in units of the mean; relative to the largest first, so that the sum cannot overflow.
  double sum = 0;
  for (const double w : weights) sum += w / largest;
  const double to_mean = static_cast<double>(n) / sum;
  std::vector<double> mass(n);
  std::vector<Index> light, heavy;
  for (std::size_t i = 0; i < n; ++i) {
    mass[i] = weights[i] / largest * to_mean;
    (mass[i] < 1 ? light : heavy).push_back(static_cast<Index>(i));
  }
  while (!light.empty() && !heavy.empty()) {  // fill the column of a light entry up with mass of a heavy one
    const auto i = static_cast<std::size_t>(light.back());
    const auto j = static_cast<std::size_t>(heavy.back());
    light.pop_back();
    entries_[i] = {mass[i], static_cast<Index>(j)};
    mass[j] -= 1 - mass[i];
    if (mass[j] < 1) {
      light.push_back(static_cast<Index>(j));
      heavy.pop_back();
    }
  }
  // Only one kind is left over, with a mean mass of 1 but for roundings (n·2^-53 at most): light ones, each below 1, are all
  // near 1. So no entry of weight 0 is among them.
  for (const auto* left : {&heavy, &light}) {
    for (const Index i : *left) entries_[static_cast<std::size_t>(i)] = {1, i};
  }
}

Index AliasTable::pick(Rng& rng) const noexcept {
  // Fewer than 2^31 columns: uniform() favours none of them by more than 2^-22 of its share, and n·uniform() < n.
  const auto column = static_cast<std::size_t>(rng.uniform() * static_cast<double>(entries_.size()));
  const Entry& entry = entries_[column];
  return rng.uniform() < entry.keep ? static_cast<Index>(column) : entry.alias;
}

}  // namespace amps::detail
