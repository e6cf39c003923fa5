// Removing, moving and putting back points of a RegularTriangulation: ids, programs of edits, queries after them and bad calls.
// Removal and hidden points have files of their own.
#include "amps/triangulation.h"

#include "kit/errors.h"
#include "kit/triangulation_edits.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cfenv>
#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <vector>

namespace amps_test {

TEST_CASE("triangulation edit: an id is given out again by reinsert only, and other ids stay what they were") {
  Rng rng(6);
  const WeightedPoints sites = drawn(80, [&] { return in_cube(rng, 0.01); });
  RegularTriangulation t = built(sites);
  t.remove(10);
  t.remove(79);
  CHECK(t.num_vertices() == 80);
  CHECK(t.num_removed() == 2);
  CHECK(t.insert(Vec3(0.5, 0.5, 0.5), 0) == 80);
  insert_all(t, WeightedPoints{sites[10], sites[79]});
  CHECK(t.num_vertices() == 83);
  CHECK(t.state(10) == State::kRemoved);
  CHECK(t.state(79) == State::kRemoved);
  t.reinsert(10, Vec3(0.75, 0.25, 0.5), 0.25);
  CHECK(t.num_removed() == 1);
  CHECK(t.state(10) == State::kVisible);
  CHECK(t.point(10).x == 0.75);
  CHECK(t.point(10).w == 0.25);
  require_rebuilt(t);
  for (Index v = 0; v < 80; ++v) {
    if (v == 10 || v == 79) continue;
    REQUIRE(t.point(v).position() == sites[at(v)].position());
    REQUIRE(t.point(v).w == sites[at(v)].w);
  }
}

TEST_CASE("triangulation edit: removal and return of any vertex is no change") {
  Rng rng(7);
  for (const WeightedPoints& sites :
       {drawn(150, [&] { return in_cube(rng, 0.1); }), cubic(5), bcc(6), cospherical(), co_power_spherical()}) {
    RegularTriangulation t = built(sites);
    const CellSet before = cell_set(t);
    for (const Index v : shuffled(live_ids(t), rng)) {
      const bool was_visible = t.state(v) == State::kVisible;
      std::vector<Index> around, again;
      t.neighbors(v, around);
      t.remove(v);
      require_rebuilt(t);
      t.reinsert(v, sites[at(v)].position(), sites[at(v)].w, around.empty() ? kNone : t.incident_cell(around.front()));
      REQUIRE((t.state(v) == State::kVisible) == was_visible);
      REQUIRE((std::count(t.hidden_by_last_insertion().begin(), t.hidden_by_last_insertion().end(), v) == 1) != was_visible);
      t.neighbors(v, again);
      REQUIRE(again == around);
      REQUIRE(cell_set(t) == before);
    }
    CHECK(t.check() == "");
  }
}

TEST_CASE("triangulation edit: moving a point or changing its weight is construction with the new one") {
  Rng rng(8);
  WeightedPoints sites = drawn(80, [&] { return in_cube(rng, 0.02); });
  RegularTriangulation t = built(sites);
  for (int k = 0; k < 200; ++k) {
    const Index v = below(rng, 80);
    WeightedPoint p = in_cube(rng, 0.02);
    if (k % 3 == 1) p = {sites[at(v)].x, sites[at(v)].y, sites[at(v)].z, k % 2 == 0 ? 0.2 : -0.2};
    if (k % 3 == 2) p = sites[at(below(rng, 80))];  // onto another one
    t.move(v, p.position(), p.w);
    sites[at(v)] = p;
    REQUIRE(t.num_vertices() == 80);
    REQUIRE(t.num_removed() == 0);
    REQUIRE(t.point(v).position() == p.position());
    REQUIRE(t.point(v).w == p.w);
    require_rebuilt(t);
    REQUIRE(cell_set(t) == cell_set(built(sites)));
  }
  const CellSet before = cell_set(t);
  for (Index v = 0; v < 80; ++v) t.move(v, sites[at(v)].position(), sites[at(v)].w);
  CHECK(cell_set(t) == before);
}

TEST_CASE("triangulation edit: random programs of insertion, bulk insertion, removal, return and movement") {
  const std::vector<std::function<WeightedPoint(Rng&)>> kinds = {[](Rng& rng) { return in_cube(rng, 0); },
                                                                 [](Rng& rng) { return in_cube(rng, 0.3); },
                                                                 [](Rng& rng) { return on_lattice(rng, 4, 1); },
                                                                 [](Rng& rng) { return on_lattice(rng, 3, 4); },
                                                                 [](Rng& rng) { return on_lattice(rng, 2, 3); },
                                                                 [](Rng& rng) {
                                                                   WeightedPoint p = on_lattice(rng, 3, 2);
                                                                   p.z = rng.below(8) == 0 ? 1 : 0;
                                                                   return p;
                                                                 },
                                                                 [](Rng& rng) {
                                                                   WeightedPoint p = on_lattice(rng, 9, 2);
                                                                   p.y = rng.below(9) == 0;
                                                                   p.z = rng.below(9) == 0;
                                                                   return p;
                                                                 },
                                                                 [](Rng& rng) { return on_sphere(rng); },
                                                                 [](Rng& rng) {
                                                                   WeightedPoint p = in_cube(rng, 0);
                                                                   p.w = rng.below(10) == 0 ? 1.0 : 0.0;
                                                                   return p;
                                                                 }};
  for (std::size_t kind = 0; kind < kinds.size(); ++kind) {
    CAPTURE(kind);
    Player player{Rng(kind + 1), kinds[kind], {}};
    for (int k = 0; k < 600; ++k) {
      CAPTURE(k);
      player.step(k % 200 < 120 ? 1.4 : 0.4);  // grow, then shrink to little or nothing
      require_rebuilt(player.t);
    }
    remove_all(player.t, shuffled(live_ids(player.t), player.rng), 1);
  }
}

TEST_CASE("triangulation edit: flat, solid, flat again, and bulk insertion in every dimension after removals") {
  Rng rng(9);
  const auto row = [&rng](int dimension) {
    WeightedPoint p{2, 3, 4, 0};
    double* x[3] = {&p.x, &p.y, &p.z};
    for (int a = 0; a < dimension; ++a) *x[a] += double(below(rng, 9));
    return p;
  };
  for (int dimension = -1; dimension <= 3; ++dimension) {
    CAPTURE(dimension);
    RegularTriangulation t = built(cubic(3));
    for (const Index v : shuffled(live_ids(t), rng)) {
      if (v >= 4) t.remove(v);
    }
    Index kept = 0;  // moved into position one by one: never fewer points than needed
    for (const Index v : live_ids(t)) {
      if (dimension < 0 || kept++ > dimension) {
        t.remove(v);
      } else {
        const WeightedPoint p = row(dimension);
        t.move(v, p.position(), p.w);
      }
      require_rebuilt(t);
    }
    REQUIRE(t.dimension() <= dimension);
    if (dimension >= 0) {
      const WeightedPoints flat = drawn(30, [&] { return row(dimension); });
      insert_all(t, flat);
      require_rebuilt(t);
      CHECK(t.dimension() == dimension);
      // Some go, then flat points come in bulk again, one by one and back by their ids.
      std::vector<Index> gone = shuffled(live_ids(t), rng);
      gone.resize(gone.size() - 6);
      for (const Index v : gone) {
        t.remove(v);
        require_rebuilt(t);
      }
      insert_all(t, flat);
      require_rebuilt(t);
      t.reinsert(gone[0], row(dimension).position(), 1);
      t.reinsert(gone[1], row(dimension).position(), 0);
      t.insert(row(dimension).position(), 0);
      require_rebuilt(t);
    }
    const WeightedPoints solid = drawn(40, [&] { return in_cube(rng, 0.1); });
    insert_all(t, solid);
    require_rebuilt(t);
    CHECK(t.dimension() == 3);
    // The solid ones go again.
    const Index first = t.num_vertices() - 40;
    for (Index v = first; v < first + 40; ++v) {
      t.remove(v);
      if (v % 8 == 0) require_rebuilt(t);
    }
    require_rebuilt(t);
    CHECK(t.dimension() == dimension);
  }
}

TEST_CASE("triangulation edit: bulk insertion after removals leaves removed ids alone") {
  Rng rng(10);
  for (const double range : {0.0, 0.3}) {
    RegularTriangulation t = built(drawn(300, [&] { return in_cube(rng, range); }));
    for (int round = 0; round < 5; ++round) {
      const std::vector<Index> order = shuffled(live_ids(t), rng);
      for (std::size_t k = 0; k < order.size() / 2; ++k) t.remove(order[k]);
      const Index removed = t.num_removed();
      const WeightedPoints more = drawn(200, [&] { return in_cube(rng, range); });
      insert_all(t, more);
      CHECK(t.num_removed() == removed);
      require_rebuilt(t);
    }
  }
}

TEST_CASE("triangulation edit: bad calls are refused and change nothing") {
  Rng rng(13);
  const WeightedPoints solid = drawn(60, [&] { return in_cube(rng, 0.1); });
  WeightedPoints flat = solid;
  for (WeightedPoint& p : flat) p.z = 0.5;
  for (const WeightedPoints& sites : {solid, flat}) {
    RegularTriangulation t = built(sites);
    t.remove(7);
    const CellSet before = cell_set(t);
    const auto refused = [&](const std::function<void()>& call) {
      CHECK(error_of(call) == ErrorCode::kInvalidArgument);
      CHECK(cell_set(t) == before);
      CHECK(t.num_vertices() == 60);
      CHECK(t.num_removed() == 1);
      CHECK(t.state(7) == State::kRemoved);
      CHECK(t.point(9).position() == sites[9].position());
      CHECK(t.point(9).w == sites[9].w);
      require_rebuilt(t);
    };
    constexpr Index kGreatest = std::numeric_limits<Index>::max(), kLeast = std::numeric_limits<Index>::min();
    for (const Index none : {Index{-1}, Index{60}, Index{7}, RegularTriangulation::kInfinite, kGreatest, kLeast}) {
      refused([&] { t.remove(none); });
      refused([&] { t.move(none, Vec3(0.5, 0.5, 0.5), 0); });
    }
    for (const Index none : {Index{-1}, Index{60}, Index{9}, RegularTriangulation::kInfinite, kGreatest, kLeast}) {
      refused([&] { t.reinsert(none, Vec3(0.5, 0.5, 0.5), 0); });
    }
    for (const double bad : {kNaN, kInfinity, -kInfinity}) {
      for (int a = 0; a < 3; ++a) {
        Vec3 x(0.5, 0.5, 0.5);
        x[a] = bad;
        refused([&] { t.reinsert(7, x, 0); });
        refused([&] { t.move(9, x, 0); });
      }
      refused([&] { t.reinsert(7, Vec3(0.5, 0.5, 0.5), bad); });
      refused([&] { t.move(9, Vec3(0.5, 0.5, 0.5), bad); });
    }
  }
  // Under another rounding nothing can be decided, and move() must find out before it has taken the point out.
  RegularTriangulation t = built(solid);
  const CellSet before = cell_set(t);
  REQUIRE(std::fesetround(FE_UPWARD) == 0);
  const ErrorCode code = error_of([&] { t.move(9, Vec3(0.5, 0.5, 0.5), 0); });
  std::fesetround(FE_TONEAREST);
  CHECK(code == ErrorCode::kEnvironment);
  CHECK(t.num_removed() == 0);
  CHECK(cell_set(t) == before);

  RegularTriangulation empty;
  CHECK(error_of([&] { empty.remove(0); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { empty.reinsert(0, Vec3::Zero(), 0); }) == ErrorCode::kInvalidArgument);
  CHECK(empty.num_vertices() == 0);
}

TEST_CASE("triangulation edit: a program of edits at any scale and offset is the plain one") {
  // Coordinates are multiples of 2^-20 in the unit cube, so that scaling and offsets are exact.
  const auto coarse = [](double x) { return std::floor(x * 0x1p20) * 0x1p-20; };
  struct Frame {
    int exponent;
    double offset;
    bool weighted;
  };
  for (const Frame& frame : {Frame{-300, 0, true}, Frame{300, 0, true}, Frame{0, 1e8, true}, Frame{0, -1e8, true},
                             Frame{-1050, 0, false}, Frame{1000, 0, false}, Frame{-500, 0, true}, Frame{500, 0, true}}) {
    CAPTURE(frame.exponent);
    CAPTURE(frame.offset);
    Rng rng(14);
    RegularTriangulation plain, framed;
    const auto position = [&frame](const WeightedPoint& p) {
      Vec3 x;
      for (int a = 0; a < 3; ++a) x[a] = std::ldexp(p.position()[a], frame.exponent) + frame.offset;
      return x;
    };
    const auto weight = [&frame](const WeightedPoint& p) { return std::ldexp(p.w, 2 * frame.exponent); };
    for (int k = 0; k < 400; ++k) {
      CAPTURE(k);
      WeightedPoint p = k % 2 == 0 ? in_cube(rng, 0.05) : on_lattice(rng, 2, 2);
      p = {coarse(p.x), coarse(p.y), coarse(p.z), frame.weighted ? coarse(p.w) : 0.0};
      const std::vector<Index> live = live_ids(plain);
      const double u = rng.uniform();
      const Index v = live.empty() ? kNone : live[rng.below(live.size())];
      if (v == kNone || u < (k < 250 ? 0.6 : 0.2)) {
        REQUIRE(plain.insert(p.position(), p.w) == framed.insert(position(p), weight(p)));
      } else if (u < 0.8) {
        plain.remove(v);
        framed.remove(v);
      } else {
        plain.move(v, p.position(), p.w);
        framed.move(v, position(p), weight(p));
      }
      REQUIRE(framed.check() == "");
      REQUIRE(framed.dimension() == plain.dimension());
      REQUIRE(cell_set(framed) == cell_set(plain));
    }
    require_rebuilt(framed);
  }
}

TEST_CASE("triangulation edit: decisions stay exact when points leave the box that the set has had so far") {
  Rng rng(20);
  // From a tiny cube onto a grid of rounded spacing, where the sign of most decisions is below the rounding of doubles.
  const auto grid = [&rng] {
    const WeightedPoint p = on_lattice(rng, 8, 1);
    return WeightedPoint{p.x / 7, p.y / 7, p.z / 7, 0};
  };
  RegularTriangulation moved = built(drawn(150, [&] {
    const WeightedPoint p = in_cube(rng, 0);
    return WeightedPoint{p.x * 0x1p-30, p.y * 0x1p-30, p.z * 0x1p-30, 0};
  }));
  RegularTriangulation returned = moved;
  for (Index v = 0; v < 150; ++v) {
    const Vec3 x = grid().position();
    moved.move(v, x, 0);
    returned.remove(149 - v);
    returned.reinsert(149 - v, x, 0);
    if (v % 10 != 9) continue;
    require_rebuilt(moved);
    require_rebuilt(returned);
  }
}

TEST_CASE("triangulation edit: queries after removals agree with brute force over what is left") {
  for (const int kind : {0, 1, 2}) {
    CAPTURE(kind);
    Player player{
        Rng(17), [kind](Rng& rng) { return kind == 0 ? in_cube(rng, 0.05) : on_lattice(rng, kind == 1 ? 6 : 3, 3); }, {}};
    RegularTriangulation& t = player.t;
    const WeightedPoints start = drawn(200, [&] { return player.draw(); });
    insert_all(t, start);
    for (int k = 0; k < 300; ++k) player.step(0.8);
    if (t.dimension() < 3) insert_all(t, start);
    require_rebuilt(t);
    REQUIRE(t.dimension() == 3);
    REQUIRE(t.num_removed() > 20);

    check_neighborhoods(t);

    const double size = kind == 0 ? 1 : (kind == 1 ? 6 : 3);
    for (int k = 0; k < 500; ++k) {
      Vec3 x;
      // Halves beside integers are exact; random data has no ties.
      for (int a = 0; a < 3; ++a) {
        x[a] = kind == 0 ? 1.5 * player.rng.uniform() - 0.25 : double(below(player.rng, Index(2 * size + 3))) / 2 - 0.5;
      }
      const Index nearest = power_nearest_of(
          live_ids(t), [&t](Index v) { return t.point(v); }, x);
      const Index near = k % 3 == 0 ? kNone : below(player.rng, t.num_vertices());  // removed ones too
      REQUIRE(t.power_nearest(x, near) == nearest);

      const Index c = t.locate(x, player.any_hint());
      REQUIRE(t.cell(c).alive());
      const auto& corner = t.cell(c).vertex;
      if (t.cell(c).ghost()) {
        REQUIRE(amps::orient3d(t.point(corner[0]), t.point(corner[1]), t.point(corner[2]), {x.x(), x.y(), x.z(), 0}) > 0);
      } else {
        for (std::size_t a = 0; a < 4; ++a) {
          std::array<WeightedPoint, 4> p = {t.point(corner[0]), t.point(corner[1]), t.point(corner[2]), t.point(corner[3])};
          p[a] = {x.x(), x.y(), x.z(), 0};
          REQUIRE(amps::orient3d(p[0], p[1], p[2], p[3]) >= 0);
        }
      }
    }
  }
}

}  // namespace amps_test
