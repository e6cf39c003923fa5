// polygon_pages.h (internal): memory for many polygons whose sizes change, each in a facet: corners and labels in pages that
// never move. Corners are kept by what they are in their facet, in half of the room of positions. A room has exactly the size
// of its polygon. Rooms that were given back are used again by their size, the last one first, since that is in the cache; so
// all rooms ever made of a size are no more than were used of it at one time.
#pragma once

#include "amps/base.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

namespace amps::detail {

/// A point of a facet: its barycentric coordinates in whole units of 2^-47, which doubles hold, sums and differences included.
/// 12 bytes, where a position has 24. Rounding moves a point by at most 2^-47 of the facet's longest edge.
class PackedBarycentric {
 public:
  static constexpr std::int64_t kOne = std::int64_t{1} << 47;

  /// Not initialized.
  PackedBarycentric() = default;
  /// Coordinates of corners 1 and 2, in units; that of corner 0 is what kOne has more than both.
  PackedBarycentric(std::int64_t second, std::int64_t third)
      : low_{static_cast<std::uint32_t>(second), static_cast<std::uint32_t>(third)},
        high_{static_cast<std::uint16_t>(second >> 32), static_cast<std::uint16_t>(third >> 32)} {}

  static PackedBarycentric of_corner(int c) { return {c == 1 ? kOne : 0, c == 2 ? kOne : 0}; }
  /// On the edge of corners u and v, `share` in [0, 1] being the coordinate of v. Sets `position`, too.
  static PackedBarycentric on_edge(int u, int v, double share, const Vec3 (&corner)[3], Vec3& position) {
    std::int64_t units[3] = {0, 0, 0};
    units[v] = rounded(share);
    units[u] = kOne - units[v];
    position = number(units[u]) * corner[u] + number(units[v]) * corner[v];
    return {units[1], units[2]};
  }
  /// Of coordinates in [0, 1] with sum 1, up to rounding. Sets `position`, too.
  static PackedBarycentric inside(const Vec3& barycentric, const Vec3 (&corner)[3], Vec3& position) {
    const std::int64_t second = rounded(barycentric[1]), third = std::min(rounded(barycentric[2]), kOne - second);
    position = sum(number(second), number(third), corner);
    return {second, third};
  }

  std::int64_t second() const { return joined(0); }
  std::int64_t third() const { return joined(1); }

  /// Its position, the facet's corners given: exactly theirs at a corner, and on an edge the same bits in all facets there.
  Vec3 position(const Vec3 (&corner)[3]) const {
    const std::int64_t b1 = second(), b2 = third();
    // A corner has no other bit than that of kOne; one of another coordinate is set, or none at all.
    if (static_cast<std::uint64_t>(b1 | b2) - 1 >= static_cast<std::uint64_t>(kOne) - 1) {
      return corner[b1 == kOne ? 1 : (b2 == kOne ? 2 : 0)];
    }
    // 0.0 in place of −0.0, of which the corner beside an edge could make either.
    const Vec3 x = sum(number(b1), number(b2), corner);
    return {x[0] + 0.0, x[1] + 0.0, x[2] + 0.0};
  }

 private:
  static double number(std::int64_t units) { return (1.0 / static_cast<double>(kOne)) * static_cast<double>(units); }
  static Vec3 sum(double b1, double b2, const Vec3 (&corner)[3]) {
    const double b0 = 1 - b1 - b2;  // exact
    return {b0 * corner[0][0] + b1 * corner[1][0] + b2 * corner[2][0],
            b0 * corner[0][1] + b1 * corner[1][1] + b2 * corner[2][1],
            b0 * corner[0][2] + b1 * corner[1][2] + b2 * corner[2][2]};
  }
  static std::int64_t rounded(double share) { return static_cast<std::int64_t>(share * static_cast<double>(kOne) + 0.5); }
  std::int64_t joined(int k) const { return static_cast<std::int64_t>(static_cast<std::uint64_t>(high_[k]) << 32 | low_[k]); }

  std::uint32_t low_[2];
  std::uint16_t high_[2];
};

/// A ball around a polygon, relative to a point near it, rounded outwards: 8 bytes. Coordinates of the centre have 12 bits, the
/// radius 10, in units of one power of two. 10 bits more are the holder's, for a note.
class PackedBall {
 public:
  static constexpr std::uint32_t kGreatestNote = 1023;

  /// Not initialized.
  PackedBall() = default;
  /// Around at least one point. Beyond the range of floats the radius is infinite.
  PackedBall(const Vec3* points, std::size_t count) {
    double low[3], high[3];
    for (int a = 0; a < 3; ++a) low[a] = high[a] = points[0][a];
    for (std::size_t k = 1; k < count; ++k) {
      for (int a = 0; a < 3; ++a) {
        low[a] = std::min(low[a], points[k][a]);
        high[a] = std::max(high[a], points[k][a]);
      }
    }
    // No point is farther from `middle` than the half diagonal. The hundredth is for the rounding of the centre.
    const double middle[3] = {0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2])};
    const double dx = high[0] - low[0], dy = high[1] - low[1], dz = high[2] - low[2];
    const double half = 0.5 * 1.01 * std::sqrt(dx * dx + dy * dy + dz * dz);
    const double size = std::max({std::fabs(middle[0]), std::fabs(middle[1]), std::fabs(middle[2]), half});
    if (!(size < 0x1p126)) {
      bits_ = kInfinite << kExponentAt;
      return;
    }
    const int exponent = std::max(exponent_above(size), kLeastExponent);
    const double per_unit = power_of_two(kCentreBits - 1 - exponent);
    const std::int64_t x = nearest(middle[0] * per_unit), y = nearest(middle[1] * per_unit), z = nearest(middle[2] * per_unit);
    const double unit = power_of_two(exponent - (kCentreBits - 1));
    // As it is kept: its rounding adds nothing.
    const Vec3 from(unit * static_cast<double>(x), unit * static_cast<double>(y), unit * static_cast<double>(z));
    double farthest = 0;
    for (std::size_t k = 0; k < count; ++k) farthest = std::max(farthest, squared_norm(points[k] - from));
    constexpr double kRounding = 1e-12;  // of the lines above, and far more
    const double radius = std::sqrt(farthest) * (1 + kRounding) * power_of_two(kRadiusBits - exponent);
    AMPS_ASSERT(radius < static_cast<double>(kRadiusMask));
    bits_ = (static_cast<std::uint64_t>(x) & kCentreMask) << kAt[0] | (static_cast<std::uint64_t>(y) & kCentreMask) << kAt[1] |
            (static_cast<std::uint64_t>(z) & kCentreMask) << kAt[2] |
            static_cast<std::uint64_t>(exponent - kLeastExponent) << kExponentAt |
            (static_cast<std::uint64_t>(radius) + 1) << kRadiusAt;
  }
  /// A note only.
  static PackedBall nothing() {
    PackedBall ball;
    ball.bits_ = 0;
    return ball;
  }

  Vec3 centre() const {
    const double unit = power_of_two(exponent() - (kCentreBits - 1));
    return {unit * static_cast<double>(coordinate(0)), unit * static_cast<double>(coordinate(1)),
            unit * static_cast<double>(coordinate(2))};
  }
  double radius() const {
    if (((bits_ >> kExponentAt) & kExponentMask) == kInfinite) return std::numeric_limits<double>::infinity();
    return power_of_two(exponent() - kRadiusBits) * static_cast<double>((bits_ >> kRadiusAt) & kRadiusMask);
  }

  /// Of what is in the ball from the point that it is relative to, at most, but for rounding.
  double reach() const {
    const std::int64_t x = coordinate(0), y = coordinate(1), z = coordinate(2);
    const double unit = power_of_two(exponent() - (kCentreBits - 1));
    return unit * std::sqrt(static_cast<double>(x * x + y * y + z * z)) + radius();
  }

  std::uint32_t note() const { return static_cast<std::uint32_t>(bits_ & kGreatestNote); }
  void set_note(std::uint32_t note) { bits_ = (bits_ & ~std::uint64_t{kGreatestNote}) | note; }

 private:
  static constexpr int kAt[3] = {52, 40, 28};  ///< of the centre's coordinates
  static constexpr int kCentreBits = 12, kRadiusBits = 10, kExponentAt = 20, kRadiusAt = 10, kLeastExponent = -126;
  static constexpr std::uint64_t kCentreMask = 0xfff, kRadiusMask = 0x3ff, kExponentMask = 0xff, kInfinite = 0xff;

  static double power_of_two(int exponent) {
    const std::uint64_t bits = static_cast<std::uint64_t>(exponent + 1023) << 52;
    double result;
    std::memcpy(&result, &bits, sizeof result);
    return result;
  }
  /// Of the least power of two above x, which is not negative; of tiny x, some lower one.
  static int exponent_above(double x) {
    std::uint64_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    return static_cast<int>(bits >> 52) - 1022;
  }
  int exponent() const { return static_cast<int>((bits_ >> kExponentAt) & kExponentMask) + kLeastExponent; }
  std::int64_t coordinate(int a) const {
    constexpr std::uint64_t kSign = std::uint64_t{1} << (kCentreBits - 1);
    return static_cast<std::int64_t>(((bits_ >> kAt[a]) & kCentreMask) ^ kSign) - static_cast<std::int64_t>(kSign);
  }
  static std::int64_t nearest(double in_units) {
    const auto result = static_cast<std::int64_t>(in_units + (in_units < 0 ? -0.5 : 0.5));
    return std::min(result, (std::int64_t{1} << (kCentreBits - 1)) - 1);
  }

  std::uint64_t bits_;
};

class PolygonPages {
 public:
  PolygonPages() = default;
  PolygonPages(PolygonPages&&) = default;
  PolygonPages& operator=(PolygonPages&&) = default;
  PolygonPages(const PolygonPages& other) { *this = other; }
  PolygonPages& operator=(const PolygonPages& other) {
    if (this == &other) return *this;
    std::vector<Block> blocks;
    for (const Block& block : other.blocks_) {
      blocks.push_back(make_block(block.size));
      std::copy_n(block.corners.get(), block.size, blocks.back().corners.get());
      std::copy_n(block.labels.get(), block.size, blocks.back().labels.get());
    }
    blocks_ = std::move(blocks);
    pages_.clear();
    for (const Block& block : blocks_) list_pages(block);
    free_ = other.free_;
    tails_ = other.tails_;
    next_ = other.next_;
    end_ = other.end_;
    unused_ = other.unused_;
    return *this;
  }

  /// A room for a polygon of so many corners, at least one. Throws Error(kTooLarge) beyond 2^31 corners in all.
  Index allocate(Index size) {
    if (slot(size) < free_.size() && free_[slot(size)] != kNone) {
      const Index room = free_[slot(size)];
      free_[slot(size)] = *labels(room);
      unused_ -= slot(size);
      return room;
    }
    if (size > kLargeRoom) return allocate_block(size);
    while (end_ - next_ < size) open_next_page();
    const Index room = next_;
    next_ += size;
    return room;
  }

  /// Gives a room back; `size` as it was allocated. What was in it is void.
  void release(Index room, Index size) {
    if (slot(size) >= free_.size()) free_.resize(slot(size) + 1, kNone);
    *labels(room) = free_[slot(size)];
    free_[slot(size)] = room;
    unused_ += slot(size);
  }

  /// Takes over what another one has. Its rooms keep their order and their contents; the result is to be added to each.
  Index adopt(PolygonPages&& other) {
    const auto added = static_cast<Index>(pages_.size() << kPageBits);
    require_pages(other.pages_.size());
    for (Block& block : other.blocks_) {
      list_pages(block);
      blocks_.push_back(std::move(block));
    }
    for (const Tail& tail : other.tails_) tails_.push_back({tail.begin + added, tail.end + added});
    if (other.next_ < other.end_) tails_.push_back({other.next_ + added, other.end_ + added});
    for (std::size_t size = 0; size < other.free_.size(); ++size) {
      for (Index room = other.free_[size], next = kNone; room != kNone; room = next) {
        next = *labels(room + added);
        release(room + added, static_cast<Index>(size));
      }
    }
    other = PolygonPages();
    return added;
  }

  PackedBarycentric* corners(Index room) { return pages_[slot(room >> kPageBits)].corners + (room & kPageMask); }
  Index* labels(Index room) { return pages_[slot(room >> kPageBits)].labels + (room & kPageMask); }
  const PackedBarycentric* corners(Index room) const { return pages_[slot(room >> kPageBits)].corners + (room & kPageMask); }
  const Index* labels(Index room) const { return pages_[slot(room >> kPageBits)].labels + (room & kPageMask); }

  /// The list of pages does not move from now on, so that others may read rooms while one allocates. So many can be added
  /// meanwhile; allocate() throws Error(kTooLarge) beyond that.
  void hold_list(std::size_t more) {
    const std::size_t wanted = pages_.size() + more;
    if (wanted > pages_.capacity()) pages_.reserve(wanted + wanted / 8);
    list_is_held_ = true;
  }
  /// It may move again.
  void let_list_go() { list_is_held_ = false; }

  /// Corners that there is memory for.
  std::size_t capacity() const { return pages_.size() << kPageBits; }
  /// Of these, in rooms that were given back.
  std::size_t unused() const { return unused_; }

 private:
  /// 16 kB a page: fragments of a hundred sites or two, and no loss to speak of where few are needed.
  static constexpr int kPageBits = 10;
  static constexpr Index kPageSize = Index{1} << kPageBits, kPageMask = kPageSize - 1;
  /// A larger one gets pages of its own, so that no more than so much of a page is lost for want of room.
  static constexpr Index kLargeRoom = kPageSize / 8;

  /// One page, or more for a polygon that is larger than a page.
  struct Block {
    std::unique_ptr<PackedBarycentric[]> corners;
    std::unique_ptr<Index[]> labels;
    std::size_t size;
  };
  struct Page {
    PackedBarycentric* corners;
    Index* labels;
  };
  struct Tail {
    Index begin, end;
  };

  /// Not initialized: memory is not used before it is written to.
  static Block make_block(std::size_t size) {
    return {std::unique_ptr<PackedBarycentric[]>(new PackedBarycentric[size]), std::unique_ptr<Index[]>(new Index[size]), size};
  }

  void list_pages(const Block& block) {
    for (std::size_t at = 0; at < block.size; at += slot(kPageSize)) {
      pages_.push_back({block.corners.get() + at, block.labels.get() + at});
    }
  }

  void require_pages(std::size_t count) const {
    constexpr std::size_t kMaxPages = (std::size_t{1} << (31 - kPageBits)) - 1;
    if (pages_.size() + count > kMaxPages) {
      throw Error(ErrorCode::kTooLarge, "restricted power diagram: more than 2^31 corners of fragments; use fewer sites");
    }
    if (list_is_held_ && pages_.size() + count > pages_.capacity()) {
      throw Error(ErrorCode::kTooLarge, "restricted power diagram: edits of millions of corners at once; use more sites");
    }
  }

  /// Pages one after another, for a room of this size; returns where they begin.
  Index add_block(Index size) {
    const std::size_t count = (slot(size) + slot(kPageMask)) >> kPageBits;
    require_pages(count);
    const auto begin = static_cast<Index>(pages_.size() << kPageBits);
    blocks_.push_back(make_block(count << kPageBits));
    list_pages(blocks_.back());
    return begin;
  }

  Index allocate_block(Index size) {
    const Index begin = add_block(size), end = static_cast<Index>(pages_.size() << kPageBits);
    if (begin + size < end) tails_.push_back({begin + size, end});
    return begin;
  }

  void open_next_page() {
    if (next_ < end_) release(next_, end_ - next_);
    if (tails_.empty()) {
      next_ = add_block(kPageSize);
      end_ = next_ + kPageSize;
    } else {
      next_ = tails_.back().begin;
      end_ = tails_.back().end;
      tails_.pop_back();
    }
  }

  std::vector<Block> blocks_;
  std::vector<Page> pages_;
  std::vector<Index> free_;   ///< by size: a room that was given back; the first label of each names the next one
  std::vector<Tail> tails_;   ///< of pages: not used yet
  Index next_ = 0, end_ = 0;  ///< the present one
  std::size_t unused_ = 0;
  bool list_is_held_ = false;
};

}  // namespace amps::detail
