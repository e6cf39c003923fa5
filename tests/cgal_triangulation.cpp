// Cell sets of RegularTriangulation against CGAL's Regular_triangulation_3: equal, ties included, because both resolve them by
// the same perturbation. Cells are compared by the values of their corners: of equal points CGAL may keep another one.
#include "amps/triangulation.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Regular_triangulation_3.h>

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

using amps::Index;
using amps::Points;
using amps::RegularTriangulation;
using amps::Rng;
using amps::Vec3;

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Oracle = CGAL::Regular_triangulation_3<Kernel>;
using Site = std::array<double, 4>;
using CellValues = std::array<std::uint32_t, 4>;  // ranks of the corners in the sorted list of sites

constexpr double kTurn = 6.283185307179586;

struct Input {
  std::string name;
  Points positions;
  Eigen::VectorXd weights;
  Input(std::string n, Eigen::Index size)
      : name(std::move(n)), positions(Points::Zero(size, 3)), weights(Eigen::VectorXd::Zero(size)) {}
  Eigen::Index size() const { return positions.rows(); }
};

/// The sites, sorted and without copies; a cell is then four ranks.
class Ranks {
 public:
  explicit Ranks(const Input& in) {
    for (Eigen::Index k = 0; k < in.size(); ++k) {
      sites_.push_back({in.positions(k, 0), in.positions(k, 1), in.positions(k, 2), in.weights[k]});
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
  std::vector<std::uint32_t> rank(static_cast<std::size_t>(t.num_vertices()));
  for (Index v = 0; v < t.num_vertices(); ++v) {
    rank[static_cast<std::size_t>(v)] = ranks({t.point(v).x, t.point(v).y, t.point(v).z, t.point(v).w});
  }
  std::vector<CellValues> result;
  const auto cells = t.cells();
  for (Eigen::Index r = 0; r < cells.rows(); ++r) {
    CellValues cell;
    for (int k = 0; k < 4; ++k) cell[static_cast<std::size_t>(k)] = rank[static_cast<std::size_t>(cells(r, k))];
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

Oracle::Weighted_point weighted_point(const Input& in, Eigen::Index k) {
  return {Kernel::Point_3(in.positions(k, 0), in.positions(k, 1), in.positions(k, 2)), in.weights[k]};
}

void check_equal(const Input& in) {
  CAPTURE(in.name);
  CAPTURE(in.size());
  const Ranks ranks(in);
  const RegularTriangulation t(in.positions, in.weights);
  std::vector<Oracle::Weighted_point> points;
  for (Eigen::Index k = 0; k < in.size(); ++k) points.push_back(weighted_point(in, k));
  const Oracle oracle(points.begin(), points.end());
  CHECK(t.check() == "");
  CHECK(static_cast<std::size_t>(t.num_cells()) == oracle.number_of_finite_cells());
  CHECK(static_cast<std::size_t>(t.num_vertices() - t.num_hidden()) == oracle.number_of_vertices());
  CHECK(cells_of(t, ranks) == cells_of(oracle, ranks));
}

Input cube(Rng& rng, Eigen::Index n, double weight_range) {
  Input in("cube, weights to " + std::to_string(weight_range), n);
  for (Eigen::Index k = 0; k < n; ++k) {
    for (int a = 0; a < 3; ++a) in.positions(k, a) = rng.uniform();
    in.weights[k] = weight_range * rng.uniform();
  }
  return in;
}

Input sphere(Rng& rng, Eigen::Index n, double weight_range) {
  Input in("sphere, weights to " + std::to_string(weight_range), n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double z = 2 * rng.uniform() - 1, a = kTurn * rng.uniform(), s = std::sqrt(1 - z * z);
    in.positions.row(k) << s * std::cos(a), s * std::sin(a), z;
    in.weights[k] = weight_range * rng.uniform();
  }
  return in;
}

Input torus(Rng& rng, Eigen::Index n) {
  Input in("torus", n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double a = kTurn * rng.uniform(), b = kTurn * rng.uniform();
    in.positions.row(k) << (2 + std::cos(b)) * std::cos(a), (2 + std::cos(b)) * std::sin(a), std::sin(b);
  }
  return in;
}

/// m³ points at spacing `step`, each coordinate the rounded product; then shifted.
Input grid(int m, double step, double offset) {
  Input in("grid " + std::to_string(m) + "³ at " + std::to_string(step) + " + " + std::to_string(offset), m * m * m);
  Eigen::Index k = 0;
  for (int x = 0; x < m; ++x) {
    for (int y = 0; y < m; ++y) {
      for (int z = 0; z < m; ++z) in.positions.row(k++) << x * step + offset, y * step + offset, z * step + offset;
    }
  }
  return in;
}

/// All integer points of x² + y² + z² = r²: exactly cospherical; with weights: co-power-spherical.
Input cospherical(int r, bool weighted) {
  std::vector<std::array<int, 3>> all;
  for (int x = -r; x <= r; ++x) {
    for (int y = -r; y <= r; ++y) {
      for (int z = -r; z <= r; ++z) {
        const int d = x * x + y * y + z * z - r * r;
        if (weighted ? (d >= 0 && d <= 6 && (x + y + z) % 2 == 0) : d == 0) all.push_back({x, y, z});
      }
    }
  }
  Input in(weighted ? "co-power-spherical" : "cospherical", static_cast<Eigen::Index>(all.size()));
  for (std::size_t k = 0; k < all.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(k);
    in.positions.row(row) << all[k][0], all[k][1], all[k][2];
    in.weights[row] = in.positions.row(row).squaredNorm() - r * r;
  }
  return in;
}

Input planes(Rng& rng, Eigen::Index n, int count) {
  Input in(std::to_string(count) + " planes", n);
  for (Eigen::Index k = 0; k < n; ++k) {
    in.positions.row(k) << rng.uniform(), rng.uniform(), static_cast<double>(rng.below(static_cast<std::uint64_t>(count)));
  }
  return in;
}

Input small_lattice(Rng& rng, Eigen::Index n, int side, int weights) {
  Input in("lattice of " + std::to_string(side) + "³ hit " + std::to_string(n) + " times", n);
  for (Eigen::Index k = 0; k < n; ++k) {
    for (int a = 0; a < 3; ++a) in.positions(k, a) = static_cast<double>(rng.below(static_cast<std::uint64_t>(side)));
    in.weights[k] = static_cast<double>(rng.below(static_cast<std::uint64_t>(weights)));
  }
  return in;
}

}  // namespace

TEST_CASE("triangulation vs CGAL: equal cells on 1,000 to 10,000 points of every kind") {
  Rng rng(1);
  for (const Eigen::Index n : {1000, 10000}) {
    for (const double range : {0.0, 1e-3, 0.1}) {
      check_equal(cube(rng, n, range));
      check_equal(sphere(rng, n, range));
    }
    check_equal(torus(rng, n));
    check_equal(planes(rng, n, 2));
    check_equal(planes(rng, n, 5));
    check_equal(small_lattice(rng, n, 6, 3));
    check_equal(small_lattice(rng, n, 20, 2));
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
  for (const Input& in : {cube(rng, 1200, 0.01), small_lattice(rng, 800, 7, 3), grid(9, 1.0 / 3, 0), planes(rng, 600, 3)}) {
    CAPTURE(in.name);
    const Ranks ranks(in);
    const Eigen::Index bulk = in.size() / 2;
    // In random order: a grid's first half would be a smaller grid.
    std::vector<Eigen::Index> order(static_cast<std::size_t>(in.size()));
    for (std::size_t k = 0; k < order.size(); ++k) order[k] = static_cast<Eigen::Index>(k);
    for (std::size_t k = order.size(); k > 1; --k) std::swap(order[k - 1], order[rng.below(k)]);
    Oracle oracle;
    RegularTriangulation t;
    Input first("first half", bulk);
    for (Eigen::Index k = 0; k < in.size(); ++k) {
      const Eigen::Index row = order[static_cast<std::size_t>(k)];
      oracle.insert(weighted_point(in, row));
      if (k < bulk) {
        first.positions.row(k) = in.positions.row(row);
        first.weights[k] = in.weights[row];
        if (k + 1 == bulk) t.insert(first.positions, first.weights);
        continue;
      }
      t.insert(Vec3(in.positions.row(row)), in.weights[row]);
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
    constexpr Eigen::Index n = 100000;
    check_equal(cube(rng, n, 0.0));
    check_equal(cube(rng, n, 1e-3));
    check_equal(cube(rng, n, 0.1));
    check_equal(sphere(rng, n, 1e-4));
    check_equal(torus(rng, n));
    check_equal(planes(rng, n, 2));
    check_equal(small_lattice(rng, n, 30, 3));
    check_equal(grid(46, 1.0, 0));
    check_equal(grid(46, 1.0 / 46, 0));
    check_equal(grid(40, 1.0 / 3, 1e5));
  }
}
