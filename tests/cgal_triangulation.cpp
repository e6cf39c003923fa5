// Cell sets of RegularTriangulation against CGAL's Regular_triangulation_3: equal, ties included, because both resolve them by
// the same perturbation. Cells are compared by the values of their corners: of equal points CGAL may keep another one.
#include "amps/triangulation.h"

#include "kit/triangulations.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Regular_triangulation_3.h>

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

namespace amps_test {

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Oracle = CGAL::Regular_triangulation_3<Kernel>;
using Site = std::array<double, 4>;
using CellValues = std::array<std::uint32_t, 4>;  // ranks of the corners in the sorted list of sites

Site site_of(const WeightedPoint& p) { return {p.x, p.y, p.z, p.w}; }

/// The sites, sorted and without copies; a cell is then four ranks.
class Ranks {
 public:
  explicit Ranks(const Sites& in) {
    for (Index k = 0; k < in.size(); ++k) {
      sites_.push_back(site_of(in.point(k)));
    }
    std::sort(sites_.begin(), sites_.end());
    sites_.erase(std::unique(sites_.begin(), sites_.end()), sites_.end());
  }
  std::uint32_t operator()(const Site& site) const {
    const auto found = std::lower_bound(sites_.begin(), sites_.end(), site);
    REQUIRE((found != sites_.end() && *found == site));
    return static_cast<std::uint32_t>(found - sites_.begin());
  }

 private:
  std::vector<Site> sites_;
};

std::vector<CellValues> cells_of(const RegularTriangulation& t, const Ranks& ranks) {
  std::vector<std::uint32_t> rank(at(t.num_vertices()));
  for (Index v = 0; v < t.num_vertices(); ++v) {
    rank[at(v)] = ranks(site_of(t.point(v)));
  }
  std::vector<CellValues> result;
  const auto cells = t.cells();
  for (Index r = 0; r < cells.rows(); ++r) {
    CellValues cell;
    for (int k = 0; k < 4; ++k) cell[static_cast<std::size_t>(k)] = rank[at(cells(r, k))];
    std::sort(cell.begin(), cell.end());
    result.push_back(cell);
  }
  std::sort(result.begin(), result.end());
  return result;
}

std::vector<CellValues> cells_of(const Oracle& oracle, const Ranks& ranks) {
  std::vector<CellValues> result;
  for (auto c = oracle.finite_cells_begin(); c != oracle.finite_cells_end(); ++c) {
    CellValues cell;
    for (int k = 0; k < 4; ++k) {
      const auto& p = c->vertex(k)->point();
      cell[static_cast<std::size_t>(k)] = ranks({p.x(), p.y(), p.z(), p.weight()});
    }
    std::sort(cell.begin(), cell.end());
    result.push_back(cell);
  }
  std::sort(result.begin(), result.end());
  return result;
}

Oracle::Weighted_point weighted_point(const WeightedPoint& p) { return {Kernel::Point_3(p.x, p.y, p.z), p.w}; }

void check_equal(const NamedSites& in) {
  CAPTURE(in.name);
  CAPTURE(in.size());
  const Ranks ranks(in);
  const RegularTriangulation t = built(in);
  std::vector<Oracle::Weighted_point> points;
  for (Index k = 0; k < in.size(); ++k) points.push_back(weighted_point(in.point(k)));
  const Oracle oracle(points.begin(), points.end());
  CHECK(t.check() == "");
  CHECK(static_cast<std::size_t>(t.num_cells()) == oracle.number_of_finite_cells());
  CHECK(static_cast<std::size_t>(t.num_vertices() - t.num_hidden()) == oracle.number_of_vertices());
  CHECK(cells_of(t, ranks) == cells_of(oracle, ranks));
}

NamedSites random_sphere(Rng& rng, Index n, double weight_range) {
  return {"sphere, weights to " + std::to_string(weight_range), sites_of(drawn(n, [&] {
            WeightedPoint p = on_sphere(rng);
            p.w = weight_range * rng.uniform();
            return p;
          }))};
}

NamedSites random_torus(Rng& rng, Index n) {
  return {"torus", sites_of(made_points(n, [&rng](Index) {
            const double a = 2 * kPi * rng.uniform(), b = 2 * kPi * rng.uniform();
            return Vec3((2 + std::cos(b)) * std::cos(a), (2 + std::cos(b)) * std::sin(a), std::sin(b));
          }))};
}

/// m³ points at spacing `step`, each coordinate the rounded product; then shifted.
NamedSites grid(int m, double step, double offset) {
  const WeightedPoints lattice = integer_points(0, m, [](int, int, int) { return true; });
  const auto place = [&](const Vec3& x) -> Vec3 { return {x[0] * step + offset, x[1] * step + offset, x[2] * step + offset}; };
  return {"grid " + std::to_string(m) + "³ at " + std::to_string(step) + " + " + std::to_string(offset),
          sites_of(transformed(positions_of(lattice), place))};
}

/// All integer points of x² + y² + z² = r²: exactly cospherical; with weights: co-power-spherical.
NamedSites cospherical(int r, bool weighted) {
  WeightedPoints points = integer_points(-r, r + 1, [&](int x, int y, int z) {
    const int d = x * x + y * y + z * z - r * r;
    return weighted ? d >= 0 && d <= 6 && (x + y + z) % 2 == 0 : d == 0;
  });
  for (WeightedPoint& p : points) p.w = p.position().squaredNorm() - r * r;
  return {weighted ? "co-power-spherical" : "cospherical", sites_of(points)};
}

NamedSites random_planes(Rng& rng, Index n, Index count) {
  return {std::to_string(count) + " planes", sites_of(made_points(n, [&](Index) {
            return Vec3{rng.uniform(), rng.uniform(), static_cast<double>(below(rng, count))};
          }))};
}

}  // namespace

TEST_CASE("triangulation vs CGAL: equal cells on 1,000 to 10,000 points of every kind") {
  Rng rng(1);
  for (const Index n : {1000, 10000}) {
    for (const double range : {0.0, 1e-3, 0.1}) {
      check_equal(random_cube(rng, n, range));
      check_equal(random_sphere(rng, n, range));
    }
    check_equal(random_torus(rng, n));
    check_equal(random_planes(rng, n, 2));
    check_equal(random_planes(rng, n, 5));
    check_equal(random_lattice(rng, n, 6, 3));
    check_equal(random_lattice(rng, n, 20, 2));
  }
  for (const double step : {1.0, 1.0 / 3, 0.1, 1.0 / 13}) {
    check_equal(grid(13, step, 0.0));
    check_equal(grid(13, step, 1e6));
  }
  check_equal(cospherical(65, false));
  check_equal(cospherical(12, true));
}

TEST_CASE("triangulation vs CGAL: equal cells after each of some single insertions") {
  Rng rng(2);
  for (const NamedSites& in :
       {random_cube(rng, 1200, 0.01), random_lattice(rng, 800, 7, 3), grid(9, 1.0 / 3, 0), random_planes(rng, 600, 3)}) {
    CAPTURE(in.name);
    const Ranks ranks(in);
    const Index bulk = in.size() / 2;
    // In random order: a grid's first half would be a smaller grid.
    const std::vector<Index> order = shuffled(all_indices(in.size()), rng);
    Oracle oracle;
    RegularTriangulation t;
    for (Index k = 0; k < in.size(); ++k) {
      const Index row = order[at(k)];
      oracle.insert(weighted_point(in.point(row)));
      if (k < bulk) {
        if (k + 1 == bulk) insert_all(t, head(chosen(in, order), bulk));
        continue;
      }
      t.insert(in.at(row), in.weights[row]);
      if (k % 17 == 0 || k + 1 == in.size()) {
        REQUIRE(t.check() == "");
        REQUIRE(cells_of(t, ranks) == cells_of(oracle, ranks));
      }
    }
  }
}

TEST_SUITE("slow") {
  TEST_CASE("triangulation vs CGAL: equal cells on 100,000 points") {
    Rng rng(3);
    constexpr Index n = 100000;
    check_equal(random_cube(rng, n, 0.0));
    check_equal(random_cube(rng, n, 1e-3));
    check_equal(random_cube(rng, n, 0.1));
    check_equal(random_sphere(rng, n, 1e-4));
    check_equal(random_torus(rng, n));
    check_equal(random_planes(rng, n, 2));
    check_equal(random_lattice(rng, n, 30, 3));
    check_equal(grid(46, 1.0, 0));
    check_equal(grid(46, 1.0 / 46, 0));
    check_equal(grid(40, 1.0 / 3, 1e5));
  }
}

}  // namespace amps_test
