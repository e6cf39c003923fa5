// Points that hide behind others, or are equal to them, while points come and go.
#include "amps/triangulation.h"

#include "kit/triangulation_edits.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <vector>

namespace amps_test {

TEST_CASE("triangulation edit: hidden points come back when what hid them goes, and span space if they must") {
  WeightedPoints sites = {{0, 0, 0, 0}, {1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 10}, {0.125, 0.125, 0.125, 0}};
  RegularTriangulation t = built(sites);
  REQUIRE(t.state(4) == State::kHidden);
  SUBCASE("the apex goes: the hidden point is the new apex") {
    t.remove(3);
    CHECK(t.dimension() == 3);
    CHECK(t.num_cells() == 1);
    CHECK(t.state(4) == State::kVisible);
    require_rebuilt(t);
  }
  SUBCASE("a corner of the base goes") {
    t.remove(0);
    require_rebuilt(t);
    CHECK(t.dimension() == 3);
  }
  SUBCASE("the apex moves into the plane of the base") {
    t.move(3, Vec3(0.25, 0.25, 0), 10);
    require_rebuilt(t);
    CHECK(t.dimension() == 3);
  }
  SUBCASE("the apex loses its weight") {
    t.move(3, Vec3(0, 0, 1), 0);
    CHECK(t.num_hidden() == 0);
    require_rebuilt(t);
  }
  SUBCASE("the hidden point goes") {
    const CellSet before = cell_set(t);
    t.remove(4);
    CHECK(cell_set(t) == before);
    CHECK(t.num_hidden() == 0);
    require_rebuilt(t);
  }
}

TEST_CASE("triangulation edit: few vertices over many hidden points: whatever is uncovered, the law holds") {
  Rng rng(3);
  for (int round = 0; round < 150; ++round) {
    CAPTURE(round);
    // The visible ones are a handful of heavy points, two thirds of them in one plane.
    WeightedPoints sites = drawn(5, [&] {
      WeightedPoint p = on_lattice(rng, 4, 3);
      if (rng.below(3) != 0) p.z = 0;
      p.w += 20;
      return p;
    });
    const WeightedPoints light = drawn(12, [&] { return on_lattice(rng, 4, 3); });
    sites.insert(sites.end(), light.begin(), light.end());
    const RegularTriangulation t = built(sites);
    remove_all(t, live_ids(t), 1);
    remove_all(t, shuffled(live_ids(t), rng), 1);
  }
}

TEST_CASE("triangulation edit: of equal points the lowest id stays, hands over when it goes and takes back when it returns") {
  Rng rng(4);
  const WeightedPoints base = drawn(60, [&] { return in_cube(rng, 0.01); });
  WeightedPoints sites = base;
  for (int copy = 0; copy < 2; ++copy) sites.insert(sites.end(), base.begin(), base.end());
  RegularTriangulation t = built(sites);
  Index twin = kNone;  // a vertex with two copies
  for (Index v = 0; twin == kNone; ++v) {
    if (t.state(v) == State::kVisible) twin = v;
  }
  std::vector<Index> before, after;
  t.neighbors(twin, before);

  t.remove(twin);
  CHECK(t.state(twin + 60) == State::kVisible);
  CHECK(t.state(twin + 120) != State::kVisible);
  t.neighbors(twin + 60, after);
  CHECK(after == before);
  require_rebuilt(t);

  t.remove(twin + 60);
  CHECK(t.state(twin + 120) == State::kVisible);
  require_rebuilt(t);

  t.reinsert(twin + 60, sites[at(twin)].position(), sites[at(twin)].w);
  CHECK(t.state(twin + 60) == State::kVisible);
  CHECK(t.state(twin + 120) != State::kVisible);
  require_rebuilt(t);

  t.reinsert(twin, sites[at(twin)].position(), sites[at(twin)].w);
  CHECK(t.state(twin) == State::kVisible);
  CHECK(t.state(twin + 60) != State::kVisible);
  CHECK(t.hidden_by_last_insertion() == std::vector<Index>{twin + 60});
  t.neighbors(twin, after);
  CHECK(after == before);
  require_rebuilt(t);

  // A removed copy changes nothing for the others.
  const CellSet cells = cell_set(t);
  t.remove(twin + 120);
  CHECK(cell_set(t) == cells);
  require_rebuilt(t);

  // The same place, heavier: all copies hide behind it, and the lowest comes back.
  const Index heavy = t.insert(sites[at(twin)].position(), sites[at(twin)].w + 1e-6);
  CHECK(t.state(heavy) == State::kVisible);
  CHECK(t.state(twin) == State::kHidden);
  require_rebuilt(t);
  t.remove(heavy);
  CHECK(t.state(twin) == State::kVisible);
  require_rebuilt(t);
  remove_all(t, shuffled(live_ids(t), rng), 1);
}

TEST_CASE("triangulation edit: twins that were hidden when the second came return as vertex and duplicate") {
  Rng rng(5);
  WeightedPoints sites = drawn(30, [&] { return in_cube(rng, 0); });
  RegularTriangulation t = built(sites);
  const Index hider = t.insert(Vec3(0.5, 0.5, 0.5), 0.5);
  const Index first = t.insert(Vec3(0.5, 0.5, 0.625), 0.0), second = t.insert(Vec3(0.5, 0.5, 0.625), 0.0);
  REQUIRE(t.state(first) == State::kHidden);
  t.remove(hider);
  CHECK(t.state(first) == State::kVisible);
  CHECK(t.state(second) != State::kVisible);
  require_rebuilt(t);
}

TEST_CASE("triangulation edit: what the last insertion hid is told after reinsert, and its neighbours") {
  Rng rng(18);
  RegularTriangulation t = built(drawn(100, [&] { return in_cube(rng, 0.01); }));
  for (int k = 0; k < 200; ++k) {
    const Index v = below(rng, 100);
    if (t.state(v) != State::kRemoved) t.remove(v);
    std::vector<State> before;
    for (Index u = 0; u < 100; ++u) before.push_back(t.state(u));
    const WeightedPoint p = in_cube(rng, k % 4 == 0 ? 0.1 : 0.01);
    t.reinsert(v, p.position(), p.w);
    std::vector<Index> expected, hidden = t.hidden_by_last_insertion();
    for (Index u = 0; u < 100; ++u) {
      if (t.state(u) == State::kHidden && before[at(u)] != State::kHidden) expected.push_back(u);
    }
    std::sort(hidden.begin(), hidden.end());
    REQUIRE(hidden == expected);
    if (t.state(v) != State::kVisible) continue;
    std::vector<Index> around, told;
    t.neighbors(v, around);
    for (const Index u : t.neighbors_of_last_insertion()) {
      if (u != RegularTriangulation::kInfinite) told.push_back(u);
    }
    std::sort(told.begin(), told.end());
    REQUIRE(told == around);
  }
}

}  // namespace amps_test
