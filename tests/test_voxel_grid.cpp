#include "amps/voxel_grid.h"

#include "amps/predicates.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

using amps::Box;
using amps::ConflictRule;
using amps::Index;
using amps::kNone;
using amps::Rng;
using amps::Vec3;
using amps::detail::VoxelGrid;

namespace {

Vec3 point_in_box(Rng& rng, const Box& box) {
  const Vec3 t(rng.uniform(), rng.uniform(), rng.uniform());
  return box.min + t.cwiseProduct(box.max - box.min);
}

Box box_of(const Vec3& min, const Vec3& max) {
  Box box;
  box.min = min;
  box.max = max;
  return box;
}

bool conflicts(const VoxelGrid& grid, const Vec3& x, double radius) {
  return grid.conflicting_sample(x, radius, ConflictRule::kMax) != kNone;
}

}  // namespace

TEST_CASE("voxel_grid: agrees with all pairs, whatever the radius, the box and the crowding") {
  Rng rng(1);
  for (const double radius : {0.02, 0.11, 0.5, 3.0}) {
    for (const double shift : {0.0, 1000.0, -1e6}) {
      const Box box = box_of(Vec3(shift, shift - 1, shift), Vec3(shift + 1, shift, shift + 0.25));
      VoxelGrid grid(box, radius, radius);
      std::vector<Vec3> samples;
      int conflicting = 0;
      for (int dart = 0; dart < 2500; ++dart) {
        // Up to r outside of the box too.
        Vec3 x = point_in_box(rng, box);
        if (dart % 7 == 0) x += radius * (2 * Vec3(rng.uniform(), rng.uniform(), rng.uniform()) - Vec3::Ones());
        bool expected = false;
        for (const Vec3& s : samples) expected |= (s - x).norm() < radius;
        REQUIRE(conflicts(grid, x, radius) == expected);
        conflicting += expected;
        const Index hit = grid.conflicting_sample(x, radius, ConflictRule::kMax);
        REQUIRE((hit != kNone) == expected);
        if (hit != kNone) REQUIRE((samples[static_cast<std::size_t>(hit)] - x).norm() < radius);
        if (!expected || dart % 5 == 0) {  // conflicting ones now and then: voxels with many samples
          grid.insert(x, radius, static_cast<Index>(samples.size()));
          samples.push_back(x);
        }
      }
      CHECK(conflicting > 0);
    }
  }
}

TEST_CASE("voxel_grid: a point at distance exactly r is no conflict, the next double inward is") {
  // (3, 4, 12)/13 and its like: integer triples, exact in doubles, at distance exactly r·scale.
  const Vec3 directions[] = {Vec3(13, 0, 0),  Vec3(0, -13, 0),  Vec3(3, 4, 12),
                             Vec3(-12, 3, 4), Vec3(4, -12, -3), Vec3(5, 12, 0)};
  for (const double scale : {1.0, 0x1p-20, 0x1p30}) {
    const double radius = 13 * scale;
    const Box box = box_of(Vec3::Constant(-100 * scale), Vec3::Constant(100 * scale));
    for (int place = 0; place < 40; ++place) {
      const Vec3 p = Vec3(place, 2 * place - 17, 31 - place) * scale;
      VoxelGrid grid(box, radius, radius);
      grid.insert(p, radius, 0);
      for (const Vec3& d : directions) {
        Vec3 x = p + d * scale;
        CHECK_FALSE(conflicts(grid, x, radius));
        int axis;
        d.cwiseAbs().maxCoeff(&axis);
        x[axis] = std::nextafter(x[axis], p[axis]);
        CHECK(conflicts(grid, x, radius));
      }
      CHECK(grid.conflicting_sample(p, radius, ConflictRule::kMax) == 0);
    }
  }
}

TEST_CASE("voxel_grid: near the radius the decision is the exact one") {
  Rng rng(3);
  const double radius = 0.1;
  const double weight = radius * radius;
  const Box box = box_of(Vec3::Zero(), Vec3::Ones());
  int inside = 0, outside = 0, undecided_by_doubles = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const Vec3 p = point_in_box(rng, box);
    Vec3 d = point_in_box(rng, box) - Vec3::Constant(0.5);
    const Vec3 x = p + d * (radius / d.norm());
    VoxelGrid grid(box, radius, radius);
    grid.insert(p, radius, 7);
    const bool exact = amps::side_of_ball(x.data(), p.data(), weight) < 0;
    REQUIRE(conflicts(grid, x, radius) == exact);
    (exact ? inside : outside) += 1;
    undecided_by_doubles += exact != ((x - p).squaredNorm() < weight);
  }
  CHECK(inside > 1000);
  CHECK(outside > 1000);
  CHECK(undecided_by_doubles > 10);  // or this test would say nothing
}

TEST_CASE("voxel_grid: up to a million radii a side, down to radii that need scaling, and no further") {
  const double r = 1e-6;
  const Box unit = box_of(Vec3::Zero(), Vec3::Ones());
  REQUIRE(VoxelGrid::fits(unit, r, r));
  VoxelGrid grid(unit, r, r);
  Rng rng(4);
  std::vector<Vec3> samples;
  for (Index i = 0; i < 5000; ++i) {
    samples.push_back(point_in_box(rng, unit));
    grid.insert(samples.back(), r, i);
  }
  for (int corner = 0; corner < 8; ++corner) {
    samples.emplace_back(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
    grid.insert(samples.back(), r, static_cast<Index>(samples.size() - 1));
  }
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const Vec3& s = samples[i];
    CHECK(grid.conflicting_sample(s, r, ConflictRule::kMax) == static_cast<Index>(i));
    CHECK(conflicts(grid, s + Vec3(-0.9 * r, 0.1 * r, -0.1 * r), r));
    CHECK(conflicts(grid, s + Vec3(0.5 * r, 0.5 * r, 0.6 * r), r));
    CHECK_FALSE(conflicts(grid, s + Vec3(0, 0, i % 2 == 0 ? 1.01 * r : -1.01 * r), r));
  }

  CHECK_FALSE(VoxelGrid::fits(unit, 1e-8, 1e-8));
  CHECK_FALSE(VoxelGrid::fits(unit, 0, 0));
  CHECK_FALSE(VoxelGrid::fits(unit, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN()));
  CHECK_FALSE(VoxelGrid::fits(unit, 1e-200, 1e-200));
  CHECK_FALSE(VoxelGrid::fits(unit, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()));
  CHECK(VoxelGrid::fits(box_of(Vec3::Zero(), Vec3::Constant(1e-100)), 1e-103, 1e-103));
  CHECK(VoxelGrid::fits(unit, 1e100, 1e100));
}

TEST_CASE("voxel_grid: with many radii it agrees with all pairs, by either rule, and finds the nearest sample") {
  Rng rng(11);
  struct Stored {
    Vec3 position;
    double radius;
  };
  for (const double ratio : {1.0, 1.7, 2.0, 16.0, 1000.0}) {
    for (const double greatest : {0.07, 0.4, 5.0}) {  // the last exceeds the box
      const Box box = box_of(Vec3(3, -1, 0), Vec3(4, 0, 0.25));
      const double least = greatest / ratio;
      VoxelGrid grid(box, least, greatest);
      std::vector<Stored> samples;
      int by_max = 0, by_min = 0;
      for (int dart = 0; dart < 1200; ++dart) {
        Vec3 x = point_in_box(rng, box);
        if (dart % 7 == 0) x += least * (2 * Vec3(rng.uniform(), rng.uniform(), rng.uniform()) - Vec3::Ones());
        if (dart % 3 == 0 && !samples.empty()) {  // near some sample, where small ones crowd
          const Stored& near = samples[rng.below(samples.size())];
          x = near.position + 1.5 * near.radius * (2 * Vec3(rng.uniform(), rng.uniform(), rng.uniform()) - Vec3::Ones());
        }
        const double u = rng.uniform();
        const double radius = dart % 10 == 0 ? least : dart % 11 == 0 ? greatest : least * std::pow(ratio, u * u);
        bool max_conflict = false, min_conflict = false, covered = false;
        double nearest = std::numeric_limits<double>::infinity();
        for (const Stored& s : samples) {
          const double d = (s.position - x).norm();
          max_conflict |= d < std::max(radius, s.radius);
          min_conflict |= d < std::min(radius, s.radius);
          covered |= d < s.radius;
          nearest = std::min(nearest, (x - s.position).squaredNorm());
        }
        const Index max_hit = grid.conflicting_sample(x, radius, ConflictRule::kMax),
                    min_hit = grid.conflicting_sample(x, radius, ConflictRule::kMin);
        REQUIRE((max_hit != kNone) == max_conflict);
        REQUIRE((min_hit != kNone) == min_conflict);
        REQUIRE((grid.conflicting_sample(x, 0, ConflictRule::kMax) != kNone) == covered);
        if (max_hit != kNone) {
          const Stored& s = samples[static_cast<std::size_t>(max_hit)];
          REQUIRE((s.position - x).norm() < std::max(radius, s.radius));
        }
        if (min_hit != kNone) {
          const Stored& s = samples[static_cast<std::size_t>(min_hit)];
          REQUIRE((s.position - x).norm() < std::min(radius, s.radius));
        }
        const double found = grid.nearest_squared_distance(x, radius);
        if (nearest < radius * radius) {
          REQUIRE(found == nearest);
        } else {
          REQUIRE(found >= nearest);
        }
        by_max += max_conflict;
        by_min += min_conflict;
        if (!min_conflict || dart % 5 == 0) {
          grid.insert(x, radius, static_cast<Index>(samples.size()));
          samples.push_back({x, radius});
        }
      }
      CHECK(by_max > 100);
      CHECK(by_min > 5);
    }
  }
}

TEST_CASE("voxel_grid: with many radii a point at distance exactly r is no conflict, the next double inward is") {
  const Vec3 directions[] = {Vec3(13, 0, 0), Vec3(3, 4, 12), Vec3(-12, 3, 4), Vec3(4, -12, -3), Vec3(0, 5, -12)};
  const Box box = box_of(Vec3::Constant(-200), Vec3::Constant(200));
  for (const double other : {1.0, 6.5, 12.75, 13.0}) {
    for (int place = 0; place < 40; ++place) {
      const Vec3 p = Vec3(place, 2 * place - 17, 31 - place);
      for (const Vec3& d : directions) {
        Vec3 inward = p + d;
        int axis;
        d.cwiseAbs().maxCoeff(&axis);
        inward[axis] = std::nextafter(inward[axis], p[axis]);
        for (const bool large_is_stored : {false, true}) {
          VoxelGrid grid(box, 0.5, 64);
          grid.insert(p, large_is_stored ? 13 : other, 0);
          const double radius = large_is_stored ? other : 13;
          CHECK(grid.conflicting_sample(p + d, radius, ConflictRule::kMax) == kNone);
          CHECK(grid.conflicting_sample(inward, radius, ConflictRule::kMax) == 0);
          CHECK((grid.conflicting_sample(inward, radius, ConflictRule::kMin) == 0) == (other == 13));
        }
      }
    }
  }
}

TEST_CASE("voxel_grid: samples come and go, and it agrees with all pairs of those that are there") {
  struct Stored {
    Vec3 position;
    double radius = 0;
    bool there = false;
  };
  Rng rng(21);
  for (const double ratio : {1.0, 3.0, 64.0}) {
    for (const double greatest : {0.1, 0.5, 3.0}) {
      CAPTURE(ratio);
      CAPTURE(greatest);
      const Box box = box_of(Vec3(-2, 5, 0), Vec3(-1, 6, 0.25));
      const double least = greatest / ratio;
      VoxelGrid grid(box, least, greatest);
      std::vector<Stored> samples;  // by id
      std::vector<Index> there, free;
      int conflicting = 0;
      for (int step = 0; step < 3000; ++step) {
        // Fills up, thins out, and so on: down to nothing now and then.
        const bool growing = step / 500 % 2 == 0;
        if (!there.empty() && rng.uniform() < (growing ? 0.35 : 0.75)) {
          const std::size_t k = rng.below(there.size());
          const Index id = there[k];
          Stored& gone = samples[static_cast<std::size_t>(id)];
          grid.remove(gone.position, gone.radius, id);
          gone.there = false;
          there[k] = there.back();
          there.pop_back();
          free.push_back(id);
        } else {
          Stored sample;
          sample.position = point_in_box(rng, box);
          if (step % 4 == 0 && !there.empty()) {  // crowds: voxels of several blocks
            sample.position =
                samples[static_cast<std::size_t>(there.front())].position + 0.01 * (point_in_box(rng, box) - box.min);
          }
          const double u = rng.uniform();
          sample.radius = std::min(greatest, std::max(least, least * std::pow(ratio, u * u)));
          sample.there = true;
          Index id = static_cast<Index>(samples.size());
          if (free.empty()) {
            samples.push_back(sample);
          } else {
            id = free[rng.below(free.size())];
            free.erase(std::find(free.begin(), free.end(), id));
            samples[static_cast<std::size_t>(id)] = sample;
          }
          there.push_back(id);
          grid.insert(sample.position, sample.radius, id);
        }
        const Vec3 x = point_in_box(rng, box);
        const double radius = least + (greatest - least) * rng.uniform() * rng.uniform();
        bool by_max = false, by_min = false;
        double nearest = std::numeric_limits<double>::infinity();
        for (const Index id : there) {
          const Stored& s = samples[static_cast<std::size_t>(id)];
          const double d = (s.position - x).norm();
          by_max |= d < std::max(radius, s.radius);
          by_min |= d < std::min(radius, s.radius);
          nearest = std::min(nearest, (x - s.position).squaredNorm());
        }
        const Index max_hit = grid.conflicting_sample(x, radius, ConflictRule::kMax),
                    min_hit = grid.conflicting_sample(x, radius, ConflictRule::kMin);
        REQUIRE((max_hit != kNone) == by_max);
        REQUIRE((min_hit != kNone) == by_min);
        for (const Index hit : {max_hit, min_hit}) {
          if (hit == kNone) continue;
          const Stored& s = samples[static_cast<std::size_t>(hit)];
          REQUIRE(s.there);
          REQUIRE((s.position - x).norm() < (hit == max_hit ? std::max(radius, s.radius) : std::min(radius, s.radius)));
        }
        const double found = grid.nearest_squared_distance(x, radius);
        if (nearest < radius * radius) {
          REQUIRE(found == nearest);
        } else {
          REQUIRE(found >= nearest);
        }
        conflicting += by_max;
      }
      CHECK(conflicting > 100);
      while (!there.empty()) {
        const Stored& s = samples[static_cast<std::size_t>(there.back())];
        grid.remove(s.position, s.radius, there.back());
        there.pop_back();
      }
      for (int dart = 0; dart < 100; ++dart) {
        const Vec3 x = point_in_box(rng, box);
        REQUIRE(grid.conflicting_sample(x, greatest, ConflictRule::kMax) == kNone);
        REQUIRE(!(grid.nearest_squared_distance(x, greatest) <= greatest * greatest));
      }
    }
  }
}

TEST_CASE("voxel_grid: with equal radii too, samples come and go") {
  const Box box = box_of(Vec3::Zero(), Vec3::Ones());
  const double radius = 0.15;
  VoxelGrid grid(box, radius, radius);
  Rng rng(22);
  std::vector<Vec3> samples;
  std::vector<Index> there;
  for (int step = 0; step < 4000; ++step) {
    if (!there.empty() && rng.uniform() < 0.45) {
      const std::size_t k = rng.below(there.size());
      grid.remove(samples[static_cast<std::size_t>(there[k])], radius, there[k]);
      there[k] = there.back();
      there.pop_back();
    } else {
      there.push_back(static_cast<Index>(samples.size()));
      samples.push_back(point_in_box(rng, box));
      grid.insert(samples.back(), radius, there.back());
    }
    const Vec3 x = point_in_box(rng, box);
    bool expected = false;
    for (const Index id : there) expected |= (samples[static_cast<std::size_t>(id)] - x).norm() < radius;
    REQUIRE(conflicts(grid, x, radius) == expected);
    const Index hit = grid.conflicting_sample(x, radius, ConflictRule::kMax);
    if (hit != kNone) REQUIRE(std::find(there.begin(), there.end(), hit) != there.end());
  }
}
