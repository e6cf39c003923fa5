// Removing, moving and putting back points of a RegularTriangulation. The law behind all tests: whatever has happened before,
// the triangulation is the one that construction makes of the points that are left.
#include "amps/triangulation.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cfenv>
#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <string>
#include <vector>

using amps::Error;
using amps::ErrorCode;
using amps::Index;
using amps::kNone;
using amps::Points;
using amps::RegularTriangulation;
using amps::Rng;
using amps::Vec3;
using amps::WeightedPoint;
using State = RegularTriangulation::VertexState;

namespace {

using CellSet = std::vector<std::array<Index, 4>>;  // sorted corners, sorted cells
using Sites = std::vector<WeightedPoint>;

constexpr double kTurn = 6.283185307179586;

std::size_t slot(Index i) { return static_cast<std::size_t>(i); }
Index below(Rng& rng, Index n) { return static_cast<Index>(rng.below(static_cast<std::uint64_t>(n))); }

CellSet cell_set(const RegularTriangulation& t) {
  CellSet result;
  const auto cells = t.cells();
  for (Eigen::Index r = 0; r < cells.rows(); ++r) {
    result.push_back({cells(r, 0), cells(r, 1), cells(r, 2), cells(r, 3)});
    std::sort(result.back().begin(), result.back().end());
  }
  std::sort(result.begin(), result.end());
  return result;
}

Points positions_of(const Sites& sites) {
  Points result(static_cast<Eigen::Index>(sites.size()), 3);
  for (std::size_t k = 0; k < sites.size(); ++k) result.row(static_cast<Eigen::Index>(k)) = sites[k].position().transpose();
  return result;
}

Eigen::VectorXd weights_of(const Sites& sites) {
  Eigen::VectorXd result(static_cast<Eigen::Index>(sites.size()));
  for (std::size_t k = 0; k < sites.size(); ++k) result[static_cast<Eigen::Index>(k)] = sites[k].w;
  return result;
}

RegularTriangulation built(const Sites& sites) { return {positions_of(sites), weights_of(sites)}; }

std::vector<Index> live_ids(const RegularTriangulation& t) {
  std::vector<Index> result;
  for (Index v = 0; v < t.num_vertices(); ++v) {
    if (t.state(v) != State::kRemoved) result.push_back(v);
  }
  return result;
}

/// The law. Construction keeps the order of ids, so of equal points the same one is the vertex.
void require_rebuilt(const RegularTriangulation& t) {
  REQUIRE(t.check() == "");
  const std::vector<Index> id = live_ids(t);
  REQUIRE(t.num_vertices() - t.num_removed() == static_cast<Index>(id.size()));
  Sites left;
  for (const Index v : id) left.push_back(t.point(v));
  const RegularTriangulation fresh = built(left);
  REQUIRE(t.dimension() == fresh.dimension());
  REQUIRE(t.num_hidden() == fresh.num_hidden());
  REQUIRE(t.num_ghosts() == fresh.num_ghosts());
  for (std::size_t k = 0; k < id.size(); ++k) {
    // Which of hidden and duplicate a point is may depend on when it came; whether it is a vertex may not.
    REQUIRE((t.state(id[k]) == State::kVisible) == (fresh.state(static_cast<Index>(k)) == State::kVisible));
  }
  CellSet expected = cell_set(fresh);
  for (auto& cell : expected) {
    for (Index& v : cell) v = id[slot(v)];
  }
  REQUIRE(cell_set(t) == expected);
}

std::vector<Index> shuffled(Rng& rng, std::vector<Index> ids) {
  for (std::size_t k = ids.size(); k > 1; --k) std::swap(ids[k - 1], ids[rng.below(k)]);
  return ids;
}

/// Removes everything in the given order, proving the law each `every` steps.
void remove_all(RegularTriangulation t, const std::vector<Index>& order, Index every) {
  REQUIRE(order.size() == live_ids(t).size());
  Index step = 0;
  for (const Index v : order) {
    CAPTURE(step);
    CAPTURE(v);
    t.remove(v);
    REQUIRE(t.state(v) == State::kRemoved);
    REQUIRE(t.incident_cell(v) == kNone);
    const Index left = static_cast<Index>(order.size()) - ++step;
    if (step % every == 0 || left < 8) require_rebuilt(t);
  }
  CHECK(t.dimension() == -1);
  CHECK(t.num_cells() == 0);
  CHECK(t.num_hidden() == 0);
  CHECK(t.power_nearest(Vec3::Zero()) == kNone);
}

/// Random, ascending and descending order, and from the outside in.
void remove_in_many_orders(Rng& rng, const Sites& sites, Index every = 1) {
  const RegularTriangulation t = built(sites);
  std::vector<Index> order = live_ids(t);
  remove_all(t, order, every);
  std::reverse(order.begin(), order.end());
  remove_all(t, order, every);
  remove_all(t, shuffled(rng, order), every);
  Vec3 middle = Vec3::Zero();
  for (const WeightedPoint& p : sites) middle += p.position() / static_cast<double>(sites.size());
  std::sort(order.begin(), order.end(), [&](Index a, Index b) {
    const double da = (sites[slot(a)].position() - middle).squaredNorm(),
                 db = (sites[slot(b)].position() - middle).squaredNorm();
    return da != db ? da > db : a < b;
  });
  remove_all(t, order, every);
}

WeightedPoint in_cube(Rng& rng, double weight_range) {
  const double x = rng.uniform(), y = rng.uniform(), z = rng.uniform();
  return {x, y, z, weight_range * rng.uniform()};
}

WeightedPoint on_lattice(Rng& rng, Index side, Index weights) {
  const Index x = below(rng, side), y = below(rng, side), z = below(rng, side);
  return {double(x), double(y), double(z), double(below(rng, weights))};
}

WeightedPoint on_sphere(Rng& rng) {
  const double z = 2 * rng.uniform() - 1, a = kTurn * rng.uniform(), s = std::sqrt(1 - z * z);
  return {s * std::cos(a), s * std::sin(a), z, 0};
}

Sites make(Index n, const std::function<WeightedPoint()>& next) {
  Sites result;
  for (Index k = 0; k < n; ++k) result.push_back(next());
  return result;
}

/// All integer points p with low ≤ p < high that `keep` wants.
Sites integer_points(int low, int high, const std::function<bool(int, int, int)>& keep) {
  Sites result;
  for (int x = low; x < high; ++x) {
    for (int y = low; y < high; ++y) {
      for (int z = low; z < high; ++z) {
        if (keep(x, y, z)) result.push_back({double(x), double(y), double(z), 0});
      }
    }
  }
  return result;
}

Sites cubic(int m) {
  return integer_points(0, m, [](int, int, int) { return true; });
}
Sites bcc(int m) {
  return integer_points(0, m, [](int x, int y, int z) { return (x & 1) == (y & 1) && (y & 1) == (z & 1); });
}
Sites fcc(int m) {
  return integer_points(0, m, [](int x, int y, int z) { return (x + y + z) % 2 == 0; });
}
Sites cospherical() {
  return integer_points(-9, 10, [](int x, int y, int z) { return x * x + y * y + z * z == 81; });
}
/// |p|² − w is one constant: all points lie on one hyperplane when lifted.
Sites co_power_spherical() {
  Sites result = integer_points(-2, 3, [](int x, int y, int z) { return (x + y + z) % 2 == 0; });
  for (WeightedPoint& p : result) p.w = p.position().squaredNorm();
  return result;
}

/// Everything that a program of edits and queries does, at random.
struct Player {
  Rng rng;
  std::function<WeightedPoint(Rng&)> next;
  RegularTriangulation t;

  WeightedPoint draw() { return next(rng); }
  Index any_live() {
    const std::vector<Index> ids = live_ids(t);
    return ids[rng.below(ids.size())];
  }
  Index any_removed() {
    for (;;) {
      const Index v = below(rng, t.num_vertices());
      if (t.state(v) == State::kRemoved) return v;
    }
  }
  Index any_hint() { return t.cell_capacity() == 0 || rng.below(2) == 0 ? kNone : below(rng, t.cell_capacity()); }
  void step(double growth) {
    const bool empty = t.num_removed() == t.num_vertices();
    const double u = rng.uniform();
    if (empty || u < 0.3 * growth) {
      const WeightedPoint p = draw();
      t.insert(p.position(), p.w, any_hint());
    } else if (u < 0.4 * growth && t.num_removed() > 0) {
      const WeightedPoint p = draw();
      t.reinsert(any_removed(), p.position(), p.w, any_hint());
    } else if (u < 0.43 * growth) {
      const Sites some = make(5, [this] { return draw(); });
      t.insert(positions_of(some), weights_of(some));
    } else if (u < 0.85) {
      t.remove(any_live());
    } else {
      const Index v = any_live();
      const WeightedPoint p = draw();
      t.move(v, u < 0.9 ? p.position() : t.point(v).position(), p.w);
    }
  }
};

ErrorCode code_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.code();
  }
  FAIL("no error");
  return ErrorCode::kInternal;
}

}  // namespace

TEST_CASE("triangulation edit: removal in any order down to nothing is construction of what is left") {
  Rng rng(1);
  SUBCASE("random") {
    remove_in_many_orders(rng, make(120, [&] { return in_cube(rng, 0); }));
  }
  SUBCASE("a few hidden") {
    remove_in_many_orders(rng, make(120, [&] { return in_cube(rng, 0.05); }));
  }
  SUBCASE("most hidden") {
    remove_in_many_orders(rng, make(120, [&] { return in_cube(rng, 5); }));
  }
  SUBCASE("one hides nearly all") {
    Sites sites = make(100, [&] { return in_cube(rng, 0.01); });
    sites[40] = {0.5, 0.5, 0.5, 0.8};
    const RegularTriangulation t = built(sites);
    REQUIRE(t.num_hidden() > 50);
    remove_in_many_orders(rng, sites);
  }
  SUBCASE("cubic lattice") { remove_in_many_orders(rng, cubic(5)); }
  SUBCASE("BCC lattice") { remove_in_many_orders(rng, bcc(6)); }
  SUBCASE("FCC lattice") { remove_in_many_orders(rng, fcc(6)); }
  SUBCASE("cospherical") { remove_in_many_orders(rng, cospherical()); }
  SUBCASE("co-power-spherical") { remove_in_many_orders(rng, co_power_spherical()); }
  SUBCASE("lattice hit many times, with integer weights") {
    for (const Index weights : {1, 2, 4}) remove_in_many_orders(rng, make(100, [&] { return on_lattice(rng, 3, weights); }));
  }
  SUBCASE("two positions, many weights") {
    remove_in_many_orders(rng, make(40, [&] { return on_lattice(rng, 2, 5); }));
  }
}

TEST_CASE("triangulation edit: removal from sets on a few planes, lines and cylinders") {
  Rng rng(2);
  SUBCASE("three planes") {
    remove_in_many_orders(rng, make(100, [&] {
                            return WeightedPoint{rng.uniform(), rng.uniform(), double(below(rng, 3)), 0};
                          }));
  }
  SUBCASE("a plane and one point off it") {
    Sites sites = make(60, [&] { return WeightedPoint{rng.uniform(), rng.uniform(), 1, 0.01 * rng.uniform()}; });
    sites.push_back({0.5, 0.5, 3, 0});
    remove_in_many_orders(rng, sites);
    // In the order that goes flat at once, and back.
    RegularTriangulation t = built(sites);
    t.remove(60);
    CHECK(t.dimension() == 2);
    t.reinsert(60, Vec3(0.2, 0.1, -4), 0);
    require_rebuilt(t);
  }
  SUBCASE("two skew lines") {
    Sites sites;
    for (int k = 0; k < 40; ++k)
      sites.push_back(k % 2 == 0 ? WeightedPoint{double(k), 0, 0, 0} : WeightedPoint{4, double(k), 1, 0});
    remove_in_many_orders(rng, sites);
  }
  SUBCASE("a lattice plane, weighted") {
    remove_in_many_orders(rng, make(80, [&] {
                            WeightedPoint p = on_lattice(rng, 5, 3);
                            p.z = p.z == 0 ? 1 : 0;
                            return p;
                          }));
  }
  SUBCASE("cylinder") {
    // Twelve exact points of the circle of radius 5 on each of six levels.
    const Sites circle = integer_points(-5, 6, [](int x, int y, int z) { return x * x + y * y == 25 && z == 0; });
    REQUIRE(circle.size() == 12);
    Sites sites;
    for (int level = 0; level < 6; ++level) {
      for (const WeightedPoint& p : circle) sites.push_back({p.x, p.y, double(level), 0});
    }
    remove_in_many_orders(rng, sites);
  }
}

TEST_CASE("triangulation edit: all 8! removal orders of a cube's corners pass through the same triangulations") {
  Sites corners;
  for (int k = 0; k < 8; ++k) corners.push_back({double(k & 1), double((k >> 1) & 1), double((k >> 2) & 1), 0});
  std::vector<CellSet> expected(256);  // by the set of corners left
  std::vector<int> dimension(256);
  for (std::size_t left = 0; left < 256; ++left) {
    std::vector<Index> id;
    Sites sites;
    for (std::size_t k = 0; k < 8; ++k) {
      if ((left >> k & 1) == 0) continue;
      id.push_back(static_cast<Index>(k));
      sites.push_back(corners[k]);
    }
    const RegularTriangulation fresh = built(sites);
    dimension[left] = fresh.dimension();
    expected[left] = cell_set(fresh);
    for (auto& cell : expected[left]) {
      for (Index& v : cell) v = id[slot(v)];
    }
  }
  const RegularTriangulation whole = built(corners);
  std::array<Index, 8> order = {0, 1, 2, 3, 4, 5, 6, 7};
  int count = 0, different = 0;
  do {
    RegularTriangulation t = whole;
    std::size_t left = 255;
    for (const Index v : order) {
      t.remove(v);
      left &= ~(std::size_t{1} << v);
      different += cell_set(t) != expected[left] || t.dimension() != dimension[left] || t.check() != "";
    }
    ++count;
  } while (std::next_permutation(order.begin(), order.end()));
  CHECK(count == 40320);
  CHECK(different == 0);
}

TEST_CASE("triangulation edit: hidden points come back when what hid them goes, and span space if they must") {
  Sites sites = {{0, 0, 0, 0}, {1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 10}, {0.125, 0.125, 0.125, 0}};
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
    Sites sites = make(5, [&] {
      WeightedPoint p = on_lattice(rng, 4, 3);
      if (rng.below(3) != 0) p.z = 0;
      p.w += 20;
      return p;
    });
    const Sites light = make(12, [&] { return on_lattice(rng, 4, 3); });
    sites.insert(sites.end(), light.begin(), light.end());
    const RegularTriangulation t = built(sites);
    remove_all(t, live_ids(t), 1);
    remove_all(t, shuffled(rng, live_ids(t)), 1);
  }
}

TEST_CASE("triangulation edit: of equal points the lowest id stays, hands over when it goes and takes back when it returns") {
  Rng rng(4);
  const Sites base = make(60, [&] { return in_cube(rng, 0.01); });
  Sites sites = base;
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

  t.reinsert(twin + 60, sites[slot(twin)].position(), sites[slot(twin)].w);
  CHECK(t.state(twin + 60) == State::kVisible);
  CHECK(t.state(twin + 120) != State::kVisible);
  require_rebuilt(t);

  t.reinsert(twin, sites[slot(twin)].position(), sites[slot(twin)].w);
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
  const Index heavy = t.insert(sites[slot(twin)].position(), sites[slot(twin)].w + 1e-6);
  CHECK(t.state(heavy) == State::kVisible);
  CHECK(t.state(twin) == State::kHidden);
  require_rebuilt(t);
  t.remove(heavy);
  CHECK(t.state(twin) == State::kVisible);
  require_rebuilt(t);
  remove_all(t, shuffled(rng, live_ids(t)), 1);
}

TEST_CASE("triangulation edit: twins that were hidden when the second came return as vertex and duplicate") {
  Rng rng(5);
  Sites sites = make(30, [&] { return in_cube(rng, 0); });
  RegularTriangulation t = built(sites);
  const Index hider = t.insert(Vec3(0.5, 0.5, 0.5), 0.5);
  const Index first = t.insert(Vec3(0.5, 0.5, 0.625), 0.0), second = t.insert(Vec3(0.5, 0.5, 0.625), 0.0);
  REQUIRE(t.state(first) == State::kHidden);
  t.remove(hider);
  CHECK(t.state(first) == State::kVisible);
  CHECK(t.state(second) != State::kVisible);
  require_rebuilt(t);
}

TEST_CASE("triangulation edit: an id is given out again by reinsert only, and other ids stay what they were") {
  Rng rng(6);
  const Sites sites = make(80, [&] { return in_cube(rng, 0.01); });
  RegularTriangulation t = built(sites);
  t.remove(10);
  t.remove(79);
  CHECK(t.num_vertices() == 80);
  CHECK(t.num_removed() == 2);
  CHECK(t.insert(Vec3(0.5, 0.5, 0.5), 0) == 80);
  t.insert(positions_of({sites[10], sites[79]}), weights_of({sites[10], sites[79]}));
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
    REQUIRE(t.point(v).position() == sites[slot(v)].position());
    REQUIRE(t.point(v).w == sites[slot(v)].w);
  }
}

TEST_CASE("triangulation edit: removal and return of any vertex is no change") {
  Rng rng(7);
  for (const Sites& sites :
       {make(150, [&] { return in_cube(rng, 0.1); }), cubic(5), bcc(6), cospherical(), co_power_spherical()}) {
    RegularTriangulation t = built(sites);
    const CellSet before = cell_set(t);
    for (const Index v : shuffled(rng, live_ids(t))) {
      const bool was_visible = t.state(v) == State::kVisible;
      std::vector<Index> around, again;
      t.neighbors(v, around);
      t.remove(v);
      require_rebuilt(t);
      t.reinsert(v, sites[slot(v)].position(), sites[slot(v)].w, around.empty() ? kNone : t.incident_cell(around.front()));
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
  Sites sites = make(80, [&] { return in_cube(rng, 0.02); });
  RegularTriangulation t = built(sites);
  for (int k = 0; k < 200; ++k) {
    const Index v = below(rng, 80);
    WeightedPoint p = in_cube(rng, 0.02);
    if (k % 3 == 1) p = {sites[slot(v)].x, sites[slot(v)].y, sites[slot(v)].z, k % 2 == 0 ? 0.2 : -0.2};
    if (k % 3 == 2) p = sites[slot(below(rng, 80))];  // onto another one
    t.move(v, p.position(), p.w);
    sites[slot(v)] = p;
    REQUIRE(t.num_vertices() == 80);
    REQUIRE(t.num_removed() == 0);
    REQUIRE(t.point(v).position() == p.position());
    REQUIRE(t.point(v).w == p.w);
    require_rebuilt(t);
    REQUIRE(cell_set(t) == cell_set(built(sites)));
  }
  const CellSet before = cell_set(t);
  for (Index v = 0; v < 80; ++v) t.move(v, sites[slot(v)].position(), sites[slot(v)].w);
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
    remove_all(player.t, shuffled(player.rng, live_ids(player.t)), 1);
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
    for (const Index v : shuffled(rng, live_ids(t))) {
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
      const Sites flat = make(30, [&] { return row(dimension); });
      t.insert(positions_of(flat), weights_of(flat));
      require_rebuilt(t);
      CHECK(t.dimension() == dimension);
      // Some go, then flat points come in bulk again, one by one and back by their ids.
      std::vector<Index> gone = shuffled(rng, live_ids(t));
      gone.resize(gone.size() - 6);
      for (const Index v : gone) {
        t.remove(v);
        require_rebuilt(t);
      }
      t.insert(positions_of(flat), weights_of(flat));
      require_rebuilt(t);
      t.reinsert(gone[0], row(dimension).position(), 1);
      t.reinsert(gone[1], row(dimension).position(), 0);
      t.insert(row(dimension).position(), 0);
      require_rebuilt(t);
    }
    const Sites solid = make(40, [&] { return in_cube(rng, 0.1); });
    t.insert(positions_of(solid), weights_of(solid));
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
    RegularTriangulation t = built(make(300, [&] { return in_cube(rng, range); }));
    for (int round = 0; round < 5; ++round) {
      const std::vector<Index> order = shuffled(rng, live_ids(t));
      for (std::size_t k = 0; k < order.size() / 2; ++k) t.remove(order[k]);
      const Index removed = t.num_removed();
      const Sites more = make(200, [&] { return in_cube(rng, range); });
      t.insert(positions_of(more), weights_of(more));
      CHECK(t.num_removed() == removed);
      require_rebuilt(t);
    }
  }
}

TEST_CASE("triangulation edit: hull vertices can go until the hull is a tetrahedron around the middle") {
  Rng rng(11);
  RegularTriangulation t = built(make(200, [&] { return in_cube(rng, 0.001); }));
  for (int k = 0; t.num_vertices() - t.num_removed() > 5; ++k) {
    const auto hull = t.hull();
    t.remove(hull(below(rng, static_cast<Index>(hull.rows())), below(rng, 3)));
    if (k % 5 == 0 || t.num_vertices() - t.num_removed() < 20) require_rebuilt(t);
  }
  require_rebuilt(t);
}

TEST_CASE("triangulation edit: a vertex of degree 600 in the middle of a sphere goes and comes back") {
  Rng rng(12);
  for (const bool exact_sphere : {false, true}) {
    Sites sites = exact_sphere ? integer_points(-33, 34, [](int x, int y, int z) { return x * x + y * y + z * z == 1089; })
                               : make(600, [&] { return on_sphere(rng); });
    const Index hub = static_cast<Index>(sites.size());
    REQUIRE(hub >= 300);
    sites.push_back({0, 0, 0, 0});
    RegularTriangulation t = built(sites);
    std::vector<Index> around;
    t.neighbors(hub, around);
    REQUIRE(around.size() == static_cast<std::size_t>(hub));
    t.remove(hub);
    require_rebuilt(t);
    t.reinsert(hub, Vec3::Zero(), 0);
    t.neighbors(hub, around);
    CHECK(around.size() == static_cast<std::size_t>(hub));
    require_rebuilt(t);
    // Heavy enough to stand alone with the hull: everything inside comes back at once.
    const Sites inside = make(200, [&] {
      WeightedPoint p = in_cube(rng, 0);
      const double scale = exact_sphere ? 16 : 0.5;
      return WeightedPoint{(p.x - 0.5) * scale, (p.y - 0.5) * scale, (p.z - 0.5) * scale, 0};
    });
    t.move(hub, Vec3::Zero(), exact_sphere ? 500 : 0.5);
    t.insert(positions_of(inside), weights_of(inside));
    CHECK(t.num_hidden() > 100);
    t.remove(hub);
    CHECK(t.num_hidden() == 0);
    require_rebuilt(t);
  }
}

TEST_CASE("triangulation edit: hubs inside, on the hull and over a flat link, with all that they hide, go and come back") {
  Rng rng(41);
  const auto around = [&rng](double height, double weight_range, bool lattice) {
    Sites sites;
    for (int k = 0; k < 300; ++k) {
      const double x = rng.uniform(), y = rng.uniform();
      if (lattice) {
        sites.push_back({double(k % 18), double(k / 18), 0, 0});
      } else {
        sites.push_back({x, y, height * (x * x + y * y), weight_range * rng.uniform()});
      }
    }
    return sites;
  };
  struct Case {
    Sites sites;
    WeightedPoint hub;
    Index least_degree;
  };
  std::vector<Case> cases;
  cases.push_back({around(0, 0, true), {9, 9, 30, 0}, 200});  // apex over a plane: without it, and a point below, all is flat
  cases.push_back({around(0, 0, false), {0.5, 0.5, 40, 0}, 200});
  cases.push_back({around(0.3, 0, false), {0.5, 0.5, -40, 0}, 100});
  cases.push_back({around(0.3, 1e-3, false), {0.5, 0.5, -40, 0}, 60});
  cases.push_back({around(0.3, 0, false), {0.5, 0.5, 2, 3.9}, 8});  // heavy: hides points
  for (const bool with_one_below : {false, true}) {
    for (Case& entry : cases) {
      Sites sites = entry.sites;
      if (with_one_below) sites.push_back({0.4, 0.6, -1, 0});
      RegularTriangulation t = built(sites);
      const CellSet before = cell_set(t);
      const Index hub = t.insert(entry.hub.position(), entry.hub.w);
      require_rebuilt(t);
      std::vector<Index> around_hub;
      t.neighbors(hub, around_hub);
      REQUIRE(static_cast<Index>(around_hub.size()) > (with_one_below ? 4 : entry.least_degree));
      t.remove(hub);
      require_rebuilt(t);
      REQUIRE(cell_set(t) == before);
      t.reinsert(hub, entry.hub.position(), entry.hub.w);
      remove_all(t, shuffled(rng, live_ids(t)), 60);
    }
  }
}

TEST_CASE("triangulation edit: bad calls are refused and change nothing") {
  Rng rng(13);
  const Sites solid = make(60, [&] { return in_cube(rng, 0.1); });
  Sites flat = solid;
  for (WeightedPoint& p : flat) p.z = 0.5;
  for (const Sites& sites : {solid, flat}) {
    RegularTriangulation t = built(sites);
    t.remove(7);
    const CellSet before = cell_set(t);
    const auto refused = [&](const std::function<void()>& call) {
      CHECK(code_of(call) == ErrorCode::kInvalidArgument);
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
    for (const double bad : {std::numeric_limits<double>::quiet_NaN(), HUGE_VAL, -HUGE_VAL}) {
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
  const ErrorCode code = code_of([&] { t.move(9, Vec3(0.5, 0.5, 0.5), 0); });
  std::fesetround(FE_TONEAREST);
  CHECK(code == ErrorCode::kEnvironment);
  CHECK(t.num_removed() == 0);
  CHECK(cell_set(t) == before);

  RegularTriangulation empty;
  CHECK(code_of([&] { empty.remove(0); }) == ErrorCode::kInvalidArgument);
  CHECK(code_of([&] { empty.reinsert(0, Vec3::Zero(), 0); }) == ErrorCode::kInvalidArgument);
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

TEST_CASE("triangulation edit: points of all magnitudes at once can be removed") {
  Rng rng(15);
  const Sites sites = make(30, [&] {
    WeightedPoint p = in_cube(rng, 0);
    for (double* x : {&p.x, &p.y, &p.z}) *x = std::ldexp(*x - 0.5, static_cast<int>(rng.below(2040)) - 1070);
    return p;
  });
  remove_in_many_orders(rng, sites, 4);
}

TEST_CASE("triangulation edit: decisions stay exact when points leave the box that the set has had so far") {
  Rng rng(20);
  // From a tiny cube onto a grid of rounded spacing, where the sign of most decisions is below the rounding of doubles.
  const auto grid = [&rng] {
    const WeightedPoint p = on_lattice(rng, 8, 1);
    return WeightedPoint{p.x / 7, p.y / 7, p.z / 7, 0};
  };
  RegularTriangulation moved = built(make(150, [&] {
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

TEST_CASE("triangulation edit: one far point leaves no trace when it is gone") {
  Rng rng(16);
  RegularTriangulation t = built(make(100, [&] { return in_cube(rng, 0.01); }));
  const CellSet before = cell_set(t);
  for (const double far : {1e3, 1e30, 1e200, 1e307}) {
    const Index v = t.insert(Vec3(far, -far, 0.5 * far), 0);
    require_rebuilt(t);
    t.move(v, Vec3(-far, far, far), far);
    require_rebuilt(t);
    t.remove(v);
    REQUIRE(cell_set(t) == before);
    require_rebuilt(t);
  }
}

TEST_CASE("triangulation edit: queries after removals agree with brute force over what is left") {
  for (const int kind : {0, 1, 2}) {
    CAPTURE(kind);
    Player player{
        Rng(17), [kind](Rng& rng) { return kind == 0 ? in_cube(rng, 0.05) : on_lattice(rng, kind == 1 ? 6 : 3, 3); }, {}};
    RegularTriangulation& t = player.t;
    const Sites start = make(200, [&] { return player.draw(); });
    t.insert(positions_of(start), weights_of(start));
    for (int k = 0; k < 300; ++k) player.step(0.8);
    if (t.dimension() < 3) t.insert(positions_of(start), weights_of(start));
    require_rebuilt(t);
    REQUIRE(t.dimension() == 3);
    REQUIRE(t.num_removed() > 20);

    std::vector<std::set<Index>> around(slot(t.num_vertices())), star(around);
    for (Index c = 0; c < t.cell_capacity(); ++c) {
      if (!t.cell(c).alive()) continue;
      for (const Index v : t.cell(c).vertex) {
        if (v == RegularTriangulation::kInfinite) continue;
        star[slot(v)].insert(c);
        for (const Index u : t.cell(c).vertex) {
          if (u != v && u != RegularTriangulation::kInfinite) around[slot(v)].insert(u);
        }
      }
    }
    const auto adjacency = t.adjacency();
    REQUIRE(adjacency.offset.size() == slot(t.num_vertices()) + 1);
    std::vector<Index> out;
    for (Index v = 0; v < t.num_vertices(); ++v) {
      const std::vector<Index> expected(around[slot(v)].begin(), around[slot(v)].end());
      t.neighbors(v, out);
      REQUIRE(out == expected);
      REQUIRE(std::vector<Index>(adjacency.adjacent.begin() + adjacency.offset[slot(v)],
                                 adjacency.adjacent.begin() + adjacency.offset[slot(v) + 1]) == expected);
      t.incident_cells(v, out);
      REQUIRE(out.size() == star[slot(v)].size());
      REQUIRE(std::set<Index>(out.begin(), out.end()) == star[slot(v)]);
      REQUIRE((t.incident_cell(v) == kNone) == star[slot(v)].empty());
      if (!star[slot(v)].empty()) REQUIRE(star[slot(v)].count(t.incident_cell(v)) == 1);
    }

    const double size = kind == 0 ? 1 : (kind == 1 ? 6 : 3);
    for (int k = 0; k < 500; ++k) {
      Vec3 x;
      // Halves beside integers are exact; random data has no ties.
      for (int a = 0; a < 3; ++a) {
        x[a] = kind == 0 ? 1.5 * player.rng.uniform() - 0.25 : double(below(player.rng, Index(2 * size + 3))) / 2 - 0.5;
      }
      Index nearest = kNone;
      for (const Index v : live_ids(t)) {
        if (nearest == kNone) {
          nearest = v;
          continue;
        }
        const WeightedPoint &p = t.point(v), &q = t.point(nearest);
        const double pp = (x - p.position()).squaredNorm() - p.w, pq = (x - q.position()).squaredNorm() - q.w;
        if (pp < pq || (pp == pq && amps::lexicographically_less(p, q))) nearest = v;
      }
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

TEST_CASE("triangulation edit: what the last insertion hid is told after reinsert, and its neighbours") {
  Rng rng(18);
  RegularTriangulation t = built(make(100, [&] { return in_cube(rng, 0.01); }));
  for (int k = 0; k < 200; ++k) {
    const Index v = below(rng, 100);
    if (t.state(v) != State::kRemoved) t.remove(v);
    std::vector<State> before;
    for (Index u = 0; u < 100; ++u) before.push_back(t.state(u));
    const WeightedPoint p = in_cube(rng, k % 4 == 0 ? 0.1 : 0.01);
    t.reinsert(v, p.position(), p.w);
    std::vector<Index> expected, hidden = t.hidden_by_last_insertion();
    for (Index u = 0; u < 100; ++u) {
      if (t.state(u) == State::kHidden && before[slot(u)] != State::kHidden) expected.push_back(u);
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

TEST_SUITE("slow") {
  TEST_CASE("triangulation edit: 20,000 points, half removed, returned elsewhere, then all removed") {
    Rng rng(19);
    for (const double range : {0.0, 0.01}) {
      RegularTriangulation t = built(make(20000, [&] { return in_cube(rng, range); }));
      for (const Index v : shuffled(rng, live_ids(t))) {
        if (v % 2 == 0) t.remove(v);
      }
      require_rebuilt(t);
      for (Index v = 0; v < 20000; v += 2) {
        const WeightedPoint p = in_cube(rng, range);
        t.reinsert(v, p.position(), p.w);
      }
      require_rebuilt(t);
      remove_all(t, shuffled(rng, live_ids(t)), 4000);
    }
  }
}
