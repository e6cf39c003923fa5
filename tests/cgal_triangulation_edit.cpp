// Cell sets of RegularTriangulation against CGAL's Regular_triangulation_3 while points come and go: equal, ties included,
// because both resolve them by the same perturbation. CGAL keeps no copies of a point, so amps may have some of a live site;
// cells are compared by the values of their corners.
#include "amps/triangulation.h"

#include "kit/triangulations.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Regular_triangulation_3.h>

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

namespace amps_test {

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Oracle = CGAL::Regular_triangulation_3<Kernel>;
using Site = std::array<double, 4>;
using CellValues = std::vector<std::array<Site, 4>>;

CellValues sorted(CellValues cells) {
  for (auto& cell : cells) std::sort(cell.begin(), cell.end());
  std::sort(cells.begin(), cells.end());
  return cells;
}

CellValues cells_of(const RegularTriangulation& t) {
  CellValues result;
  for (Index c = 0; c < t.cell_capacity(); ++c) {
    if (!t.cell(c).alive() || t.cell(c).ghost()) continue;
    result.emplace_back();
    for (std::size_t k = 0; k < 4; ++k) {
      const WeightedPoint& p = t.point(t.cell(c).vertex[k]);
      result.back()[k] = {p.x, p.y, p.z, p.w};
    }
  }
  return sorted(std::move(result));
}

CellValues cells_of(const Oracle& oracle) {
  CellValues result;
  if (oracle.dimension() < 3) return result;
  for (auto c = oracle.finite_cells_begin(); c != oracle.finite_cells_end(); ++c) {
    result.emplace_back();
    for (int k = 0; k < 4; ++k) {
      const auto& p = c->vertex(k)->point();
      result.back()[static_cast<std::size_t>(k)] = {p.x(), p.y(), p.z(), p.weight()};
    }
  }
  return sorted(std::move(result));
}

Oracle::Weighted_point weighted_point(const WeightedPoint& p) { return {Kernel::Point_3(p.x, p.y, p.z), p.w}; }

/// CGAL's construction of what is left.
Oracle rebuilt(const RegularTriangulation& t) {
  std::vector<Oracle::Weighted_point> points;
  for (const Index v : live_ids(t)) points.push_back(weighted_point(t.point(v)));
  return Oracle(points.begin(), points.end());
}

void require_equal(const RegularTriangulation& t, const Oracle& oracle) {
  REQUIRE(t.check() == "");
  REQUIRE(t.dimension() == oracle.dimension());
  if (t.dimension() < 3) return;
  REQUIRE(static_cast<std::size_t>(t.num_cells()) == oracle.number_of_finite_cells());
  REQUIRE(cells_of(t) == cells_of(oracle));
}

struct Kind {
  std::string name;
  std::function<WeightedPoint(Rng&)> draw;
};

/// Integer points on the sphere of radius 45: 234 of them, exactly cospherical; those drawn twice are duplicates.
WeightedPoint cospherical(Rng& rng) {
  static const WeightedPoints all = integer_sphere(45 * 45);
  return all[rng.below(all.size())];
}

/// |p|² − w is constant up to one: co-power-spherical, or just below.
WeightedPoint co_power_spherical(Rng& rng) {
  WeightedPoint p = on_lattice(rng, 9, 1);
  p.w = p.position().squaredNorm() - (rng.below(4) == 0 ? 1 : 0);
  return p;
}

WeightedPoint weighted_on_sphere(Rng& rng, double weight_range) {
  WeightedPoint p = on_sphere(rng);
  p.w = weight_range * rng.uniform();
  return p;
}

/// On three planes, sometimes on one line of them.
WeightedPoint on_planes(Rng& rng) {
  WeightedPoint p = in_cube(rng, 0);
  p.z = below(rng, 3);
  if (rng.below(4) == 0) p.y = 0.5;
  return p;
}

const std::vector<Kind>& kinds() {
  static const std::vector<Kind> all = {{"cube", [](Rng& rng) { return in_cube(rng, 0); }},
                                        {"cube, weighted", [](Rng& rng) { return in_cube(rng, 0.02); }},
                                        {"cube, most hidden", [](Rng& rng) { return in_cube(rng, 1); }},
                                        {"lattice", [](Rng& rng) { return on_lattice(rng, 8, 1); }},
                                        {"lattice, weighted", [](Rng& rng) { return on_lattice(rng, 7, 3); }},
                                        {"lattice of few points, weighted", [](Rng& rng) { return on_lattice(rng, 3, 4); }},
                                        {"cospherical", cospherical},
                                        {"co-power-spherical", co_power_spherical},
                                        {"sphere", [](Rng& rng) { return weighted_on_sphere(rng, 0); }},
                                        {"sphere, weighted", [](Rng& rng) { return weighted_on_sphere(rng, 0.01); }},
                                        {"planes", on_planes}};
  return all;
}

/// Insertions, removals, returns and movements; grows to some size, then shrinks to nothing. Compares each `every` operations.
void play(const Kind& kind, std::uint64_t seed, int operations, int every) {
  CAPTURE(kind.name);
  Rng rng(seed);
  RegularTriangulation t;
  std::vector<Index> live, removed;
  const auto take = [&rng](std::vector<Index>& from) {
    const std::size_t k = rng.below(from.size());
    const Index v = from[k];
    from[k] = from.back();
    from.pop_back();
    return v;
  };
  for (int k = 0; k < operations; ++k) {
    CAPTURE(k);
    const double u = rng.uniform(), growth = k < operations / 2 ? 0.6 : 0.35;
    const WeightedPoint p = kind.draw(rng);
    const Index hint = t.cell_capacity() > 0 && rng.below(2) == 0 ? below(rng, t.cell_capacity()) : kNone;
    if (live.empty() || u < growth / 2) {
      live.push_back(t.insert(p.position(), p.w, hint));
    } else if (u < growth && !removed.empty()) {
      const Index v = take(removed);
      t.reinsert(v, p.position(), p.w, hint);
      live.push_back(v);
    } else if (u < 0.9) {
      const Index v = take(live);
      t.remove(v);
      removed.push_back(v);
    } else {
      const Index v = live[rng.below(live.size())];
      t.move(v, u < 0.95 ? p.position() : t.point(v).position(), p.w);
    }
    if (k % every == 0) require_equal(t, rebuilt(t));
  }
  while (!live.empty()) {
    CAPTURE(live.size());
    t.remove(take(live));
    if (live.size() < 30 || live.size() % static_cast<std::size_t>(every) == 0) require_equal(t, rebuilt(t));
  }
  CHECK(t.dimension() == -1);
}

}  // namespace

TEST_CASE("triangulation edit vs CGAL: equal cells during 1,000 random edits of every kind") {
  for (const Kind& kind : kinds()) play(kind, 1, 1000, 7);
}

TEST_CASE("triangulation edit vs CGAL: CGAL's own removals end in the same cells") {
  for (const Kind& kind : kinds()) {
    CAPTURE(kind.name);
    Rng rng(2);
    RegularTriangulation t;
    // CGAL forgets copies, so no site is drawn twice.
    std::vector<Site> seen;
    while (seen.size() < 200) {
      const WeightedPoint p = kind.draw(rng);
      const Site site = {p.x, p.y, p.z, p.w};
      if (seen.size() > 100 && kind.name.find("few") != std::string::npos) break;
      if (std::find(seen.begin(), seen.end(), site) != seen.end()) continue;
      seen.push_back(site);
      t.insert(p.position(), p.w);
    }
    Oracle oracle = rebuilt(t);
    REQUIRE(oracle.dimension() == 3);
    // Visible vertices only: CGAL finds its own hidden points by cell, not by value.
    for (int k = 0; t.num_vertices() - t.num_removed() > 20; ++k) {
      CAPTURE(k);
      Index v;
      do {
        v = below(rng, t.num_vertices());
      } while (t.state(v) != State::kVisible);
      Oracle::Vertex_handle found;
      for (auto u = oracle.finite_vertices_begin(); u != oracle.finite_vertices_end(); ++u) {
        const auto& q = u->point();
        const WeightedPoint& p = t.point(v);
        if (q.x() == p.x && q.y() == p.y && q.z() == p.z && q.weight() == p.w) found = u;
      }
      REQUIRE(found != Oracle::Vertex_handle());
      oracle.remove(found);
      t.remove(v);
      require_equal(t, oracle);
    }
  }
}

TEST_SUITE("slow") {
  TEST_CASE("triangulation edit vs CGAL: equal cells after every step of 1,000 random edits") {
    for (const Kind& kind : kinds()) play(kind, 2, 1000, 1);
  }

  TEST_CASE("triangulation edit vs CGAL: equal cells in 10,000 random edits of every kind") {
    for (const Kind& kind : kinds()) play(kind, 3, 10000, 100);
  }

  TEST_CASE("triangulation edit vs CGAL: equal cells after removal of half of 50,000 points, and their return") {
    Rng rng(4);
    constexpr Index n = 50000;
    for (const Kind& kind : {kinds()[0], kinds()[1], kinds()[9]}) {
      CAPTURE(kind.name);
      const WeightedPoints sites = drawn(n, [&] { return kind.draw(rng); });
      RegularTriangulation t = built(sites);
      for (Index v = 0; v < n; v += 2) t.remove(v);
      require_equal(t, rebuilt(t));
      for (Index v = 0; v < n; v += 2) t.reinsert(v, sites[at(n - 2 - v)].position(), sites[at(n - 2 - v)].w);
      require_equal(t, rebuilt(t));
    }
  }
}

}  // namespace amps_test
