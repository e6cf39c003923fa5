// Memory of polygons that change: rooms never overlap, keep what is in them, and are used again. And how corners are kept.
#include "amps/polygon_pages.h"

#include "kit/basics.h"
#include "kit/points.h"
#include "kit/random.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

namespace amps_test {

using amps::detail::PackedBall;
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

namespace {

Vec3 random_vector(Rng& rng, double scale) {
  return {scale * (2 * rng.uniform() - 1), scale * (2 * rng.uniform() - 1), scale * (2 * rng.uniform() - 1)};
}

}  // namespace

TEST_CASE("polygon_pages: a corner is kept to 2^-47 of the facet's longest edge, and exactly where facets meet") {
  Rng rng(5);
  const Real tolerance = std::ldexp(Real{1}, -47);
  for (int round = 0; round < 20000; ++round) {
    const double scale = std::ldexp(1.0, static_cast<int>(rng.below(40)) - 20);
    const Vec3 facet[3] = {random_vector(rng, scale), random_vector(rng, scale), random_vector(rng, scale)};
    const double longest = std::max({(facet[1] - facet[0]).norm(), (facet[2] - facet[1]).norm(), (facet[0] - facet[2]).norm()});
    // Barycentric coordinates with what they may be off by; some are next to 0 or 1.
    const double near_end = std::ldexp(rng.uniform(), -static_cast<int>(rng.below(60)));
    const double b1 = round % 3 == 0 ? near_end : rng.uniform(),
                 b2 = (1 - b1) * (round % 5 == 0 ? 1 - near_end : rng.uniform());
    const Vec3 b(1 - b1 - b2 < 0 ? 0 : 1 - b1 - b2, b1, b2);
    Vec3 said;
    const PackedBarycentric kept = PackedBarycentric::inside(b, facet, said);
    const Vec3 x = kept.position(facet);
    REQUIRE(x == said);
    REQUIRE(kept.second() >= 0);
    REQUIRE(kept.third() >= 0);
    REQUIRE(kept.second() + kept.third() <= PackedBarycentric::kOne);
    const auto rounding = [&](int c) {
      return 4 * 0x1p-53 * std::max({std::fabs(facet[0][c]), std::fabs(facet[1][c]), std::fabs(facet[2][c])});
    };
    for (int c = 0; c < 3; ++c) {
      const Real exact = Real{b[0]} * facet[0][c] + Real{b[1]} * facet[1][c] + Real{b[2]} * facet[2][c];
      REQUIRE(std::fabs(exact - x[c]) <= tolerance * longest + rounding(c));
    }
    // A point of an edge, as three facets there see it.
    const double share = round % 7 == 0 ? near_end : rng.uniform();
    const int u = static_cast<int>(rng.below(3)), v = (u + 1 + static_cast<int>(rng.below(2))) % 3;
    const Vec3 on_edge = PackedBarycentric::on_edge(u, v, share, facet, said).position(facet);
    REQUIRE(on_edge == said);
    for (int c = 0; c < 3; ++c) {
      const Real exact = (1 - Real{share}) * facet[u][c] + Real{share} * facet[v][c];
      REQUIRE(std::fabs(exact - on_edge[c]) <= tolerance * longest + rounding(c));
    }
    for (int turn = 0; turn < 3; ++turn) {
      Vec3 other[3] = {random_vector(rng, scale), random_vector(rng, scale), random_vector(rng, scale)};
      const int a = turn, z = (turn + 1 + round % 2) % 3;
      other[a] = facet[u];
      other[z] = facet[v];
      REQUIRE(same_bits(PackedBarycentric::on_edge(a, z, share, other, said).position(other), on_edge));
    }
  }
  const Vec3 signs[3] = {Vec3(-0.0, 1, -0.0), Vec3(-0.0, 0.0, 2), Vec3(3, -0.0, -0.0)};
  for (int c = 0; c < 3; ++c) CHECK(same_bits(PackedBarycentric::of_corner(c).position(signs), signs[c]));
}

TEST_CASE("polygon_pages: a ball that is kept holds the points, and little more") {
  Rng rng(6);
  for (int round = 0; round < 20000; ++round) {
    const double scale = std::ldexp(1.0, static_cast<int>(rng.below(400)) - 200);
    const Vec3 middle = random_vector(rng, scale);
    const double size = std::ldexp(scale, -static_cast<int>(rng.below(12)));
    std::vector<Vec3> points;
    for (std::uint64_t k = rng.below(9) + 1; k > 0; --k) points.push_back(middle + random_vector(rng, size));
    const PackedBall ball(points.data(), points.size());
    const Vec3 centre = ball.centre();
    Real farthest = 0, extent = 0;
    for (const Vec3& x : points) {
      Real squared = 0, from_middle = 0;
      for (int c = 0; c < 3; ++c) {
        squared += (Real{x[c]} - centre[c]) * (Real{x[c]} - centre[c]);
        from_middle = std::max(from_middle, std::fabs(Real{x[c]} - middle[c]));
      }
      farthest = std::max(farthest, std::sqrt(squared));
      extent = std::max(extent, from_middle);
    }
    REQUIRE(farthest <= ball.radius());
    if (scale > 0x1p-100 && scale < 0x1p100) {
      // 2^-9 of a number is the rounding of its first 8 bits, 2^-7 of the radius what rounding up adds.
      const Real moved = std::sqrt(Real{3}) * 0x1p-8 * (std::fabs(middle.maxCoeff()) + std::fabs(middle.minCoeff()) + 2 * size);
      REQUIRE(ball.radius() <= (1 + 0x1p-6) * (2 * std::sqrt(Real{3}) * extent + moved));
    }
  }
  for (const double far : {1e39, 1e200, 1e308}) {
    const Vec3 points[2] = {Vec3(far, 0, 0), Vec3(0, -far, 1)};
    CHECK(PackedBall(points, 2).radius() == kInfinity);
  }
}

}  // namespace amps_test
