// triangulations.h: cells of regular triangulations as sets, what is left of one after edits, and the brute-force oracle.
#pragma once

#include "sites.h"

#include "amps/triangulation.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

using amps::RegularTriangulation;
using State = RegularTriangulation::VertexState;

using Cell = std::array<Index, 4>;
using CellSet = std::vector<Cell>;  ///< sorted corners, sorted cells

inline CellSet sorted(CellSet cells) {
  for (Cell& cell : cells) std::sort(cell.begin(), cell.end());
  std::sort(cells.begin(), cells.end());
  return cells;
}

/// With every cell once.
inline CellSet cell_set(const RegularTriangulation& t) {
  CellSet result;
  const auto cells = t.cells();
  for (Index r = 0; r < t.num_cells(); ++r) result.push_back({cells(r, 0), cells(r, 1), cells(r, 2), cells(r, 3)});
  result = sorted(std::move(result));
  REQUIRE(
      (static_cast<Index>(cells.rows()) == t.num_cells() && std::adjacent_find(result.begin(), result.end()) == result.end()));
  return result;
}

/// With `name[v]` for v; where names rise with v the cells stay sorted.
inline CellSet renamed(CellSet cells, const std::vector<Index>& name) {
  for (Cell& cell : cells) {
    for (Index& v : cell) v = name[at(v)];
  }
  return sorted(std::move(cells));
}

inline RegularTriangulation built(const Sites& sites) { return {sites.positions, sites.weights}; }
inline RegularTriangulation built(const WeightedPoints& sites) { return built(sites_of(sites)); }

inline void insert_all(RegularTriangulation& t, const Sites& sites) { t.insert(sites.positions, sites.weights); }
inline void insert_all(RegularTriangulation& t, const WeightedPoints& sites) { insert_all(t, sites_of(sites)); }

/// The first ones in bulk.
inline RegularTriangulation one_by_one(const Sites& sites, Index in_bulk = 0) {
  RegularTriangulation t;
  if (in_bulk > 0) insert_all(t, head(sites, in_bulk));
  for (Index k = in_bulk; k < sites.size(); ++k) t.insert(sites.at(k), sites.weights[k]);
  return t;
}

inline std::vector<Index> live_ids(const RegularTriangulation& t) {
  std::vector<Index> result;
  for (Index v = 0; v < t.num_vertices(); ++v) {
    if (t.state(v) != State::kRemoved) result.push_back(v);
  }
  return result;
}

/// Of each position the heaviest point, of these the first: the only ones that can be vertices.
inline std::vector<Index> candidates(const Sites& in) {
  std::vector<Index> result;
  for (Index a = 0; a < in.size(); ++a) {
    bool best = true;
    for (Index b = 0; b < in.size(); ++b) {
      if (a == b || !amps::same_position(in.point(a), in.point(b))) continue;
      if (in.weights[b] > in.weights[a] || (in.weights[b] == in.weights[a] && b < a)) best = false;
    }
    if (best) result.push_back(a);
  }
  return result;
}

/// The oracle: all quadruples that are not flat and in conflict with no other point.
inline CellSet brute_force(const Sites& in) {
  const std::vector<Index> id = candidates(in);
  const std::size_t n = id.size();
  CellSet result;
  for (std::size_t a = 0; a < n; ++a) {
    for (std::size_t b = a + 1; b < n; ++b) {
      for (std::size_t c = b + 1; c < n; ++c) {
        for (std::size_t d = c + 1; d < n; ++d) {
          WeightedPoint p[4] = {in.point(id[a]), in.point(id[b]), in.point(id[c]), in.point(id[d])};
          const int orientation = amps::orient3d(p[0], p[1], p[2], p[3]);
          if (orientation == 0) continue;
          if (orientation < 0) std::swap(p[0], p[1]);
          bool empty = true;
          for (std::size_t q = 0; q < n && empty; ++q) {
            if (q == a || q == b || q == c || q == d) continue;
            empty = amps::power_test(p[0], p[1], p[2], p[3], in.point(id[q])) < 0;
          }
          if (empty) result.push_back({id[a], id[b], id[c], id[d]});
        }
      }
    }
  }
  return result;
}

/// Of these sites, by brute force; ties go to the lexicographically smallest. Small integers and halves are exact.
template <class Point>
Index power_nearest_of(const std::vector<Index>& ids, const Point& point, const Vec3& x) {
  Index nearest = kNone;
  for (const Index v : ids) {
    if (nearest == kNone) {
      nearest = v;
      continue;
    }
    const WeightedPoint p = point(v), q = point(nearest);
    const double pp = (x - p.position()).squaredNorm() - p.w, pq = (x - q.position()).squaredNorm() - q.w;
    if (pp < pq || (pp == pq && amps::lexicographically_less(p, q))) nearest = v;
  }
  return nearest;
}

/// Neighbours, adjacency, stars and incident cells agree with the cells.
inline void check_neighborhoods(const RegularTriangulation& t) {
  std::vector<std::set<Index>> around(at(t.num_vertices())), star(around);
  for (Index c = 0; c < t.cell_capacity(); ++c) {
    if (!t.cell(c).alive()) continue;
    for (const Index v : t.cell(c).vertex) {
      if (v == RegularTriangulation::kInfinite) continue;
      star[at(v)].insert(c);
      for (const Index u : t.cell(c).vertex) {
        if (u != v && u != RegularTriangulation::kInfinite) around[at(v)].insert(u);
      }
    }
  }
  const auto adjacency = t.adjacency();
  REQUIRE(adjacency.offset.size() == at(t.num_vertices()) + 1);
  std::vector<Index> out;
  for (Index v = 0; v < t.num_vertices(); ++v) {
    const std::set<Index>&expected = around[at(v)], &cells = star[at(v)];
    const std::vector<Index> list(expected.begin(), expected.end());
    t.neighbors(v, out);
    REQUIRE(out == list);
    REQUIRE(std::vector<Index>(adjacency.adjacent.begin() + adjacency.offset[at(v)],
                               adjacency.adjacent.begin() + adjacency.offset[at(v) + 1]) == list);
    t.incident_cells(v, out);
    REQUIRE(out.size() == cells.size());
    REQUIRE(std::set<Index>(out.begin(), out.end()) == cells);
    REQUIRE((t.incident_cell(v) == kNone) == cells.empty());
    if (!cells.empty()) REQUIRE(cells.count(t.incident_cell(v)) == 1);
  }
}

// Named inputs.

inline NamedSites random_cube(Rng& rng, Index n, double weight_range) {
  return {"cube, weights to " + std::to_string(weight_range), sites_of(drawn(n, [&] { return in_cube(rng, weight_range); }))};
}

inline NamedSites random_lattice(Rng& rng, Index n, Index side, Index weights) {
  return {"lattice " + std::to_string(side) + ", weights " + std::to_string(weights),
          sites_of(drawn(n, [&] { return on_lattice(rng, side, weights); }))};
}

}  // namespace amps_test
