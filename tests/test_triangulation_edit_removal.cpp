// Removal of points: whatever the order, the set and the size of the star, the triangulation is construction of what is left.
#include "amps/triangulation.h"

#include "kit/triangulation_edits.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace amps_test {

TEST_CASE("triangulation edit: removal in any order down to nothing is construction of what is left") {
  Rng rng(1);
  SUBCASE("random") {
    remove_in_many_orders(rng, drawn(120, [&] { return in_cube(rng, 0); }));
  }
  SUBCASE("a few hidden") {
    remove_in_many_orders(rng, drawn(120, [&] { return in_cube(rng, 0.05); }));
  }
  SUBCASE("most hidden") {
    remove_in_many_orders(rng, drawn(120, [&] { return in_cube(rng, 5); }));
  }
  SUBCASE("one hides nearly all") {
    WeightedPoints sites = drawn(100, [&] { return in_cube(rng, 0.01); });
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
    for (const Index weights : {1, 2, 4}) remove_in_many_orders(rng, drawn(100, [&] { return on_lattice(rng, 3, weights); }));
  }
  SUBCASE("two positions, many weights") {
    remove_in_many_orders(rng, drawn(40, [&] { return on_lattice(rng, 2, 5); }));
  }
}

TEST_CASE("triangulation edit: removal from sets on a few planes, lines and cylinders") {
  Rng rng(2);
  SUBCASE("three planes") {
    remove_in_many_orders(rng, drawn(100, [&] {
                            return WeightedPoint{rng.uniform(), rng.uniform(), double(below(rng, 3)), 0};
                          }));
  }
  SUBCASE("a plane and one point off it") {
    WeightedPoints sites = drawn(60, [&] { return WeightedPoint{rng.uniform(), rng.uniform(), 1, 0.01 * rng.uniform()}; });
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
    WeightedPoints sites;
    for (int k = 0; k < 40; ++k)
      sites.push_back(k % 2 == 0 ? WeightedPoint{double(k), 0, 0, 0} : WeightedPoint{4, double(k), 1, 0});
    remove_in_many_orders(rng, sites);
  }
  SUBCASE("a lattice plane, weighted") {
    remove_in_many_orders(rng, drawn(80, [&] {
                            WeightedPoint p = on_lattice(rng, 5, 3);
                            p.z = p.z == 0 ? 1 : 0;
                            return p;
                          }));
  }
  SUBCASE("cylinder") {
    // Twelve exact points of the circle of radius 5 on each of six levels.
    const WeightedPoints circle = integer_points(-5, 6, [](int x, int y, int z) { return x * x + y * y == 25 && z == 0; });
    REQUIRE(circle.size() == 12);
    WeightedPoints sites;
    for (int level = 0; level < 6; ++level) {
      for (const WeightedPoint& p : circle) sites.push_back({p.x, p.y, double(level), 0});
    }
    remove_in_many_orders(rng, sites);
  }
}

TEST_CASE("triangulation edit: all 8! removal orders of a cube's corners pass through the same triangulations") {
  WeightedPoints corners;
  for (int k = 0; k < 8; ++k) corners.push_back({double(k & 1), double((k >> 1) & 1), double((k >> 2) & 1), 0});
  std::vector<CellSet> expected(256);  // by the set of corners left
  std::vector<int> dimension(256);
  for (std::size_t left = 0; left < 256; ++left) {
    std::vector<Index> id;
    WeightedPoints sites;
    for (std::size_t k = 0; k < 8; ++k) {
      if ((left >> k & 1) == 0) continue;
      id.push_back(static_cast<Index>(k));
      sites.push_back(corners[k]);
    }
    const RegularTriangulation fresh = built(sites);
    dimension[left] = fresh.dimension();
    expected[left] = renamed(cell_set(fresh), id);
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

TEST_CASE("triangulation edit: hull vertices can go until the hull is a tetrahedron around the middle") {
  Rng rng(11);
  RegularTriangulation t = built(drawn(200, [&] { return in_cube(rng, 0.001); }));
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
    WeightedPoints sites = exact_sphere ? integer_sphere(1089) : drawn(600, [&] { return on_sphere(rng); });
    const Index hub = static_cast<Index>(sites.size());
    REQUIRE(hub >= 300);
    sites.push_back({0, 0, 0, 0});
    RegularTriangulation t = built(sites);
    std::vector<Index> around;
    t.neighbors(hub, around);
    REQUIRE(around.size() == at(hub));
    t.remove(hub);
    require_rebuilt(t);
    t.reinsert(hub, Vec3::Zero(), 0);
    t.neighbors(hub, around);
    CHECK(around.size() == at(hub));
    require_rebuilt(t);
    // Heavy enough to stand alone with the hull: everything inside comes back at once.
    const WeightedPoints inside = drawn(200, [&] {
      WeightedPoint p = in_cube(rng, 0);
      const double scale = exact_sphere ? 16 : 0.5;
      return WeightedPoint{(p.x - 0.5) * scale, (p.y - 0.5) * scale, (p.z - 0.5) * scale, 0};
    });
    t.move(hub, Vec3::Zero(), exact_sphere ? 500 : 0.5);
    insert_all(t, inside);
    CHECK(t.num_hidden() > 100);
    t.remove(hub);
    CHECK(t.num_hidden() == 0);
    require_rebuilt(t);
  }
}

TEST_CASE("triangulation edit: hubs inside, on the hull and over a flat link, with all that they hide, go and come back") {
  Rng rng(41);
  const auto around = [&rng](double height, double weight_range, bool lattice) {
    WeightedPoints sites;
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
    WeightedPoints sites;
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
      WeightedPoints sites = entry.sites;
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
      remove_all(t, shuffled(live_ids(t), rng), 60);
    }
  }
}

TEST_CASE("triangulation edit: points of all magnitudes at once can be removed") {
  Rng rng(15);
  const WeightedPoints sites = drawn(30, [&] {
    WeightedPoint p = in_cube(rng, 0);
    for (double* x : {&p.x, &p.y, &p.z}) *x = std::ldexp(*x - 0.5, static_cast<int>(rng.below(2040)) - 1070);
    return p;
  });
  remove_in_many_orders(rng, sites, 4);
}

TEST_CASE("triangulation edit: one far point leaves no trace when it is gone") {
  Rng rng(16);
  RegularTriangulation t = built(drawn(100, [&] { return in_cube(rng, 0.01); }));
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

TEST_SUITE("slow") {
  TEST_CASE("triangulation edit: 20,000 points, half removed, returned elsewhere, then all removed") {
    Rng rng(19);
    for (const double range : {0.0, 0.01}) {
      RegularTriangulation t = built(drawn(20000, [&] { return in_cube(rng, range); }));
      for (const Index v : shuffled(live_ids(t), rng)) {
        if (v % 2 == 0) t.remove(v);
      }
      require_rebuilt(t);
      for (Index v = 0; v < 20000; v += 2) {
        const WeightedPoint p = in_cube(rng, range);
        t.reinsert(v, p.position(), p.w);
      }
      require_rebuilt(t);
      remove_all(t, shuffled(live_ids(t), rng), 4000);
    }
  }
}

}  // namespace amps_test
