#include "amps/kdtree.h"

#include "kit/execution.h"
#include "kit/points.h"
#include "kit/random.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace amps_test {

using amps::KdTree;

namespace {

using Neighbors = std::vector<KdTree::Neighbor>;

/// All points by distance, then index.
Neighbors sorted_by_brute_force(const Points& points, const Vec3& q) {
  std::vector<std::pair<double, Index>> all;
  for (Index i = 0; i < rows(points); ++i) {
    const double dx = q[0] - points(i, 0), dy = q[1] - points(i, 1), dz = q[2] - points(i, 2);
    all.emplace_back(dx * dx + dy * dy + dz * dz, i);
  }
  std::sort(all.begin(), all.end());
  Neighbors result;
  for (const auto& [d2, i] : all) result.push_back({i, d2});
  return result;
}

void require_equal(const Neighbors& a, const Neighbors& b, std::size_t size) {
  REQUIRE(a.size() == size);
  REQUIRE(b.size() >= size);
  for (std::size_t i = 0; i < size; ++i) {
    REQUIRE(a[i].index == b[i].index);
    REQUIRE(a[i].squared_distance == b[i].squared_distance);
  }
}

void compare_with_brute_force(const Points& points, const std::vector<Vec3>& queries, unsigned threads = 1) {
  const KdTree tree(points, on_threads(threads));
  REQUIRE(tree.size() == rows(points));
  Neighbors found;
  for (const Vec3& q : queries) {
    const Neighbors all = sorted_by_brute_force(points, q);
    const KdTree::Neighbor nearest = tree.nearest(q);
    REQUIRE(nearest.index == all[0].index);
    REQUIRE(nearest.squared_distance == all[0].squared_distance);
    for (const Index k : {0, 1, 2, 7, 30, 100000}) {
      tree.k_nearest(q, k, found);
      require_equal(found, all, std::min(static_cast<std::size_t>(k), all.size()));
    }
    for (const double radius : {0.0, 0.1, 0.25, 1.0, 100.0}) {
      std::size_t within = 0;
      while (within < all.size() && all[within].squared_distance <= radius * radius) ++within;
      tree.in_radius(q, radius, found);
      require_equal(found, all, within);
    }
  }
}

}  // namespace

TEST_CASE("kdtree: agrees with brute force on random points") {
  Rng rng(1);
  for (const Index n : {1, 2, 9, 10, 11, 500, 2000}) {
    const Points points = made_points(n, [&rng](Index) { return Vec3{rng.uniform(), rng.uniform(), 0.01 * rng.uniform()}; });
    std::vector<Vec3> queries;
    for (int i = 0; i < 60; ++i) queries.emplace_back(2 * rng.uniform() - 0.5, rng.uniform(), rng.uniform());
    for (Index i = 0; i < std::min<Index>(n, 20); ++i) queries.push_back(point_at(points, i));
    compare_with_brute_force(points, queries);
  }
}

TEST_CASE("kdtree: ties go by index, on a lattice whose every point is there three times") {
  std::vector<Vec3> lattice;
  for (int repeat = 0; repeat < 3; ++repeat) {
    for (int i = 0; i < 343; ++i) lattice.push_back(Vec3(i % 7, i / 7 % 7, i / 49) / 4);
  }
  Rng rng(2);
  const Points points = points_of(shuffled(lattice, rng));
  std::vector<Vec3> queries;
  for (int i = 0; i < 100; ++i) {  // lattice points and centres of cells, edges, faces
    queries.push_back(
        Vec3(static_cast<double>(rng.below(15)), static_cast<double>(rng.below(15)), static_cast<double>(rng.below(15))) / 8);
  }
  compare_with_brute_force(points, queries);
}

TEST_CASE("kdtree: built in parts by several threads, it agrees with brute force") {
  Rng rng(4);
  const Points random = made_points(60000, [&rng](Index) { return Vec3{0.1 * rng.uniform(), rng.uniform(), rng.uniform()}; });
  const Points lattice = made_points(60000, [&rng](Index) -> Vec3 {
    return Vec3{static_cast<double>(rng.below(20)), static_cast<double>(rng.below(20)), static_cast<double>(rng.below(40))} /
           16;
  });
  for (const unsigned threads : {2u, 3u, 7u}) {
    CAPTURE(threads);
    std::vector<Vec3> queries{Vec3(-3, 0.5, 0.5), Vec3(0.05, 0.5, 0.5), Vec3(9, 9, 9)};
    for (int i = 0; i < 5; ++i) queries.emplace_back(rng.uniform(), rng.uniform(), rng.uniform());
    for (int i = 0; i < 5; ++i) queries.push_back(point_at(lattice, static_cast<Index>(rng.below(60000))));
    compare_with_brute_force(random, queries, threads);
    compare_with_brute_force(lattice, queries, threads);  // ties on both sides of the cuts
    compare_with_brute_force(constant_points(20000, 0.1), {Vec3(0.1, 0.1, 0.1), Vec3(0, 0, 0)}, threads);
  }
}

TEST_CASE("kdtree: equal points, and points at one distance from the query up to rounding") {
  compare_with_brute_force(constant_points(300, 0.1), {Vec3(0.1, 0.1, 0.1), Vec3(0, 0, 0)});
  Rng rng(3);
  const Points sphere = made_points(1000, [&rng](Index) -> Vec3 {
    const Vec3 x = random_point(rng) - Vec3::Constant(0.5);
    return x * (0.25 / x.norm());
  });
  compare_with_brute_force(sphere, {Vec3(0, 0, 0)});
}

TEST_CASE("kdtree: an empty set has no neighbours; the points are copied; trees move") {
  Neighbors found = {{3, 1.0}};
  const KdTree empty{no_points()};
  CHECK(empty.size() == 0);
  CHECK(empty.nearest(Vec3(0, 0, 0)).index == kNone);
  empty.k_nearest(Vec3(0, 0, 0), 5, found);
  CHECK(found.empty());
  found = {{3, 1.0}};
  empty.in_radius(Vec3(0, 0, 0), 5, found);
  CHECK(found.empty());

  Points points = points_of({{0, 0, 0}, {1, 0, 0}});
  KdTree tree(points);
  points = constant_points(2, 9);
  KdTree moved = std::move(tree);
  CHECK(moved.nearest(Vec3(0.9, 0, 0)).index == 1);
  CHECK(moved.nearest(Vec3(0.5, 0, 0)).index == 0);
}

}  // namespace amps_test
