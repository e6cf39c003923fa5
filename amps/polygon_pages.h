// polygon_pages.h (internal): memory for many polygons whose sizes change: corners and labels in pages that never move. A room
// has exactly the size of its polygon. Rooms that were given back are used again by their size, the last one first, since that
// is in the cache; so all rooms ever made of a size are no more than were used of it at one time.
#pragma once

#include "amps/base.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

namespace amps::detail {

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

  Vec3* corners(Index room) { return pages_[slot(room >> kPageBits)].corners + (room & kPageMask); }
  Index* labels(Index room) { return pages_[slot(room >> kPageBits)].labels + (room & kPageMask); }
  const Vec3* corners(Index room) const { return pages_[slot(room >> kPageBits)].corners + (room & kPageMask); }
  const Index* labels(Index room) const { return pages_[slot(room >> kPageBits)].labels + (room & kPageMask); }

  /// So many pages can be added without moving the list of them: others may read rooms meanwhile.
  void reserve_pages(std::size_t more) {
    const std::size_t wanted = pages_.size() + more;
    if (wanted > pages_.capacity()) pages_.reserve(wanted + wanted / 8);
  }

  /// Corners that there is memory for.
  std::size_t capacity() const { return pages_.size() << kPageBits; }
  /// Of these, in rooms that were given back.
  std::size_t unused() const { return unused_; }

 private:
  /// 28 kB a page: fragments of a hundred sites or two, and no loss to speak of where few are needed.
  static constexpr int kPageBits = 10;
  static constexpr Index kPageSize = Index{1} << kPageBits, kPageMask = kPageSize - 1;
  /// A larger one gets pages of its own, so that no more than so much of a page is lost for want of room.
  static constexpr Index kLargeRoom = kPageSize / 8;

  /// One page, or more for a polygon that is larger than a page.
  struct Block {
    std::unique_ptr<Vec3[]> corners;
    std::unique_ptr<Index[]> labels;
    std::size_t size;
  };
  struct Page {
    Vec3* corners;
    Index* labels;
  };
  struct Tail {
    Index begin, end;
  };

  /// Not initialized: memory is not used before it is written to.
  static Block make_block(std::size_t size) {
    return {std::unique_ptr<Vec3[]>(new Vec3[size]), std::unique_ptr<Index[]>(new Index[size]), size};
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
};

}  // namespace amps::detail
