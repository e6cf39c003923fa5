// Memory of polygons that change: rooms never overlap, keep what is in them, and are used again. And how corners are kept.
#include "amps/polygon_pages.h"

#include "kit/basics.h"
#include "kit/random.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

namespace amps_test {

using amps::detail::PackedBarycentric;
using amps::detail::PolygonPages;

namespace {

struct Room {
  Index at, size, name;
};

/// Corners and labels tell the polygon and the place in it.
void fill(PolygonPages& pages, const Room& room) {
  for (Index k = 0; k < room.size; ++k) {
    pages.corners(room.at)[k] = {(std::int64_t{room.name} << 8) + k, room.size};
    pages.labels(room.at)[k] = room.name + k;
  }
}

bool is_filled(const PolygonPages& pages, const Room& room) {
  for (Index k = 0; k < room.size; ++k) {
    const PackedBarycentric corner = pages.corners(room.at)[k];
    const bool kept = corner.second() == (std::int64_t{room.name} << 8) + k && corner.third() == room.size;
    if (!kept || pages.labels(room.at)[k] != room.name + k) return false;
  }
  return true;
}

bool all_filled(const PolygonPages& pages, const std::vector<Room>& rooms) {
  return std::all_of(rooms.begin(), rooms.end(), [&](const Room& room) { return is_filled(pages, room); });
}

/// Polygons as surfaces have them: 3 to 10 corners, rarely more.
Index random_size(Rng& rng) {
  const Index size = 3 + below(rng, 8);
  return rng.uniform() < 0.002 ? size * 40 : size;
}

Room add(PolygonPages& pages, Index size, Index name) {
  const Room room = {pages.allocate(size), size, name};
  fill(pages, room);
  return room;
}

}  // namespace

TEST_CASE("polygon_pages: rooms keep their contents while others come and go, and hold no more than was used at one time") {
  Rng rng(1);
  PolygonPages pages;
  std::vector<Room> rooms;
  std::map<Index, std::size_t> used, most_used;
  for (Index step = 0; step < 40000; ++step) {
    // The number of polygons rises and falls.
    const bool adds = rooms.empty() || rng.uniform() < (step / 10000 % 2 == 0 ? 0.6 : 0.45);
    if (adds) {
      rooms.push_back(add(pages, random_size(rng), step));
      const std::size_t count = ++used[rooms.back().size];
      most_used[rooms.back().size] = std::max(most_used[rooms.back().size], count);
    } else {
      std::swap(rooms[rng.below(rooms.size())], rooms.back());
      REQUIRE(is_filled(pages, rooms.back()));
      --used[rooms.back().size];
      pages.release(rooms.back().at, rooms.back().size);
      rooms.pop_back();
    }
    if (step % 5000 == 0) REQUIRE(all_filled(pages, rooms));
  }
  REQUIRE(all_filled(pages, rooms));
  std::size_t bound = 0, now = 0;
  for (const auto& [size, count] : most_used) bound += at(size) * count;
  for (const Room& room : rooms) now += at(room.size);
  CHECK(pages.capacity() <= bound + bound / 8 + 2048);  // an eighth for ends of pages, and the present ones
  CHECK(pages.unused() + now <= pages.capacity());
  CHECK(pages.unused() > 0);
}

TEST_CASE("polygon_pages: what is given back is taken again, so that memory does not grow") {
  Rng rng(2);
  PolygonPages pages;
  std::vector<Room> rooms;
  for (Index k = 0; k < 5000; ++k) rooms.push_back(add(pages, random_size(rng), k));
  const std::size_t capacity = pages.capacity();
  for (Index k = 0; k < 50000; ++k) {
    Room& room = rooms[rng.below(rooms.size())];
    pages.release(room.at, room.size);
    room = add(pages, room.size, k);
  }
  CHECK(pages.capacity() == capacity);
  CHECK(all_filled(pages, rooms));
}

TEST_CASE("polygon_pages: polygons larger than a page") {
  PolygonPages pages;
  std::vector<Room> rooms;
  const Index sizes[] = {3, 1023, 1024, 1025, 5, 2048, 10000, 4, 127, 128, 129, 7};
  for (const Index size : sizes) rooms.push_back(add(pages, size, 10 * size));
  CHECK(all_filled(pages, rooms));
  for (const Room& room : rooms) pages.release(room.at, room.size);
  const std::size_t capacity = pages.capacity();
  rooms.clear();
  for (const Index size : sizes) rooms.push_back(add(pages, size, 10 * size));
  CHECK(all_filled(pages, rooms));
  CHECK(pages.capacity() == capacity);
}

TEST_CASE("polygon_pages: pages of others are adopted with their contents, and what they did not use is used") {
  Rng rng(3);
  PolygonPages pages;
  std::vector<Room> rooms;
  const int parts = 20;
  for (Index part = 0; part < parts; ++part) {
    PolygonPages other;
    std::vector<Room> theirs;
    for (Index k = 0; k < 40 + 30 * (part % 3); ++k) theirs.push_back(add(other, random_size(rng), 1000 * part + k));
    for (Index k = 0; k < 5; ++k) {
      other.release(theirs.back().at, theirs.back().size);
      theirs.pop_back();
    }
    const std::size_t capacity = pages.capacity(), unused = pages.unused(), added = other.capacity();
    const std::size_t released = other.unused();
    const Index base = pages.adopt(std::move(other));
    CHECK(pages.capacity() == capacity + added);
    CHECK(pages.unused() == unused + released);
    for (Room room : theirs) {
      room.at += base;
      rooms.push_back(room);
    }
  }
  REQUIRE(all_filled(pages, rooms));
  const std::size_t capacity = pages.capacity();
  std::size_t used = 0;
  for (const Room& room : rooms) used += at(room.size);
  while (used + used / 8 < capacity) {
    rooms.push_back(add(pages, 3 + below(rng, 8), 100000 + static_cast<Index>(rooms.size())));
    used += at(rooms.back().size);
  }
  CHECK(pages.capacity() <= capacity + 1024);
  CHECK(all_filled(pages, rooms));
}

TEST_CASE("polygon_pages: a copy has pages of its own") {
  Rng rng(4);
  PolygonPages pages;
  std::vector<Room> rooms;
  for (Index k = 0; k < 1000; ++k) rooms.push_back(add(pages, random_size(rng), k));
  PolygonPages copy = pages;
  CHECK(copy.capacity() == pages.capacity());
  std::vector<Room> others = rooms;
  for (Room& room : others) {
    room.name += 5000;
    fill(copy, room);
  }
  for (Index k = 0; k < 1000; ++k) others.push_back(add(copy, random_size(rng), 20000 + k));
  CHECK(all_filled(pages, rooms));
  CHECK(all_filled(copy, others));
  pages = copy;
  CHECK(all_filled(pages, others));
}

}  // namespace amps_test
