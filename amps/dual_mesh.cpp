#define AMPS_OWN_SOURCE
#include "amps/dual_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <tuple>
#include <vector>

namespace amps::detail {
namespace {

/// The dual mod 2: of dual triangles, least corner first, one for each triple of sites that is there an odd number of times.
/// Where all facets at every edge are an even number, so are then the triangles at every edge. Of three or more the majority
/// says how the one is oriented, and it is on the least of their facets. Sorted by corners, so that nothing depends on the
/// history of the diagram.
Dual odd_triples(const Dual& dual, Index num_sites, const Execution& execution) {
  const Triangles& triangles = dual.triangles;
  struct Keyed {
    std::array<Index, 2> others;  ///< the corners but the least, ascending
    Index facet;
    bool turned;  ///< they were descending
    bool operator<(const Keyed& b) const { return std::tie(others, facet) < std::tie(b.others, b.facet); }
  };
  const auto n = static_cast<std::size_t>(triangles.rows());
  std::vector<std::size_t> begin(slot(num_sites) + 1, 0);  // of the triangles of each least corner, which is the first one
  for_each_piece(n, kElementsPerLook, execution.part(0, 0.15), [&](std::size_t from, std::size_t to) {
    for (std::size_t t = from; t < to; ++t) ++begin[slot(triangles(static_cast<std::ptrdiff_t>(t), 0)) + 1];
  });
  for (std::size_t s = 1; s < begin.size(); ++s) begin[s] += begin[s - 1];
  std::vector<Keyed> keyed(n);
  std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
  for_each_piece(n, kElementsPerLook, execution.part(0.15, 0.5), [&](std::size_t from, std::size_t to) {
    for (std::size_t t = from; t < to; ++t) {
      const auto row = triangles.row(static_cast<std::ptrdiff_t>(t));
      Keyed& k = keyed[next[slot(row[0])]++];
      k = {{std::min(row[1], row[2]), std::max(row[1], row[2])}, dual.facets[t], row[1] > row[2]};
    }
  });
  std::vector<Index> corners, facets;
  corners.reserve(3 * n);
  facets.reserve(n);
  for_each_piece(slot(num_sites), kElementsPerLook, execution.part(0.5, 1), [&](std::size_t from, std::size_t to) {
    for (std::size_t s = from; s < to; ++s) {
      std::sort(keyed.begin() + static_cast<std::ptrdiff_t>(begin[s]),
                keyed.begin() + static_cast<std::ptrdiff_t>(begin[s + 1]));
      for (std::size_t k = begin[s]; k < begin[s + 1];) {
        const auto [low, high] = keyed[k].others;
        const Index facet = keyed[k].facet;
        std::size_t count = 0, turned = 0;
        for (; k < begin[s + 1] && keyed[k].others == std::array<Index, 2>{low, high}; ++k) {
          ++count;
          turned += keyed[k].turned ? 1 : 0;
        }
        if (count % 2 == 0) continue;
        const bool turn = 2 * turned > count;
        corners.insert(corners.end(), {static_cast<Index>(s), turn ? high : low, turn ? low : high});
        facets.push_back(facet);
      }
    }
  });
  return {Triangles(std::move(corners)), std::move(facets)};
}

/// Flags of facets that are joined, across edges of two facets, to two that traverse their edge in one direction. Empty if
/// there is none.
std::vector<char> disagreeing_facets(const SurfaceEdges& edges) {
  const auto disagrees = [](const MeshEdge& edge) { return edge.size() == 2 && !edge.regular(); };
  std::size_t first = 0;
  while (first < edges.size() && !disagrees(edges[first])) ++first;
  if (first == edges.size()) return {};
  UnionFind sets(slot(edges.num_facets()));
  for (std::size_t e = 0; e < edges.size(); ++e) {
    if (edges[e].size() == 2) sets.join(slot(edges[e][0].facet), slot(edges[e][1].facet));
  }
  std::vector<char> of_set(slot(edges.num_facets()), 0);
  for (std::size_t e = first; e < edges.size(); ++e) {
    if (disagrees(edges[e])) of_set[sets.find(slot(edges[e][0].facet))] = 1;
  }
  std::vector<char> result(of_set.size());
  for (std::size_t f = 0; f < result.size(); ++f) result[f] = of_set[sets.find(f)];
  return result;
}

/// The sign of the volume that these triangles enclose; 0 where rounding might have changed it.
int sign_of_volume(const Triangles& triangles, const std::vector<Index>& chosen, const PointsView& positions) {
  const Vec3 origin = positions[triangles(chosen.front(), 0)];
  double volume = 0, magnitude = 0;
  for (const Index t : chosen) {
    const Vec3 a = positions[triangles(t, 0)] - origin, b = positions[triangles(t, 1)] - origin,
               c = positions[triangles(t, 2)] - origin;
    volume += dot(a, b.cross(c));
    magnitude += sum(a.cwiseAbs()) * sum(b.cwiseAbs()) * sum(c.cwiseAbs());
  }
  // A term is off by some 10 units of 2^-53 of its magnitude, the sum by one more for each term.
  const double bound = (static_cast<double>(chosen.size()) + 16) * 0x1p-53 * magnitude;
  return (volume > bound) - (volume < -bound);
}

/// Flips triangles so that manifold edges are traversed once in each direction, as far as the surface is orientable. By
/// component (across manifold edges) the majority of the given orientations stays; but where facets under it disagree (`dual`
/// has the facets, `surface` their edges) and it is closed, it is turned so that its volume is positive.
void orient_consistently(Dual& dual, const SurfaceEdges& surface, const PointsView& positions, const Execution& execution) {
  Triangles& triangles = dual.triangles;
  struct Link {
    Index triangle;
    bool same;  ///< both traverse the edge in opposite directions already
  };
  const std::size_t n = static_cast<std::size_t>(triangles.rows());
  std::vector<std::array<Link, 3>> links(n, {Link{kNone, true}, Link{kNone, true}, Link{kNone, true}});
  std::vector<std::uint8_t> link_count(n, 0);
  const MeshEdges edges(triangles, static_cast<Index>(positions.rows()), {}, execution.part(0, 0.6));
  Ticker linking(execution.part(0.6, 0.8), edges.size(), kElementsPerLook);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    linking.tick();
    const MeshEdge edge = edges[e];
    if (edge.size() != 2) continue;
    const auto ta = slot(edge[0].facet), tb = slot(edge[1].facet);
    links[ta][link_count[ta]++] = {edge[1].facet, edge.regular()};
    links[tb][link_count[tb]++] = {edge[0].facet, edge.regular()};
  }
  enum : std::uint8_t { kUnseen, kKept, kFlipped };
  std::vector<std::uint8_t> decision(n, kUnseen);
  std::vector<Index> components, component_of(n, kNone);  // triangles, component after component
  std::vector<std::size_t> begin;
  Ticker turning(execution.part(0.8, 1), n, kElementsPerLook);
  for (std::size_t seed = 0; seed < n; ++seed) {
    if (decision[seed] != kUnseen) continue;
    decision[seed] = kKept;
    const std::size_t first = components.size();
    begin.push_back(first);
    components.push_back(static_cast<Index>(seed));
    std::size_t flipped = 0;
    for (std::size_t k = first; k < components.size(); ++k) {
      turning.tick();
      const auto t = slot(components[k]);
      component_of[t] = static_cast<Index>(begin.size() - 1);
      flipped += decision[t] == kFlipped;
      for (const Link& link : links[t]) {
        if (link.triangle == kNone || decision[slot(link.triangle)] != kUnseen) continue;
        decision[slot(link.triangle)] = (decision[t] == kKept) == link.same ? kKept : kFlipped;
        components.push_back(link.triangle);
      }
    }
    const std::uint8_t turn = 2 * flipped > components.size() - first ? kKept : kFlipped;
    for (std::size_t k = first; k < components.size(); ++k) {
      const Index t = components[k];
      if (decision[slot(t)] == turn) std::swap(triangles(t, 1), triangles(t, 2));
    }
  }
  const std::vector<char> disagreeing = disagreeing_facets(surface);
  if (disagreeing.empty()) return;
  begin.push_back(components.size());
  // Closed is a component that traverses each of its edges as often forward as backward.
  std::vector<char> open(begin.size() - 1, 0);
  const MeshEdges turned(triangles, static_cast<Index>(positions.rows()));
  std::vector<std::pair<Index, int>> directions;  // component, direction
  for (std::size_t e = 0; e < turned.size(); ++e) {
    if (turned[e].regular()) continue;
    directions.clear();
    for (const EdgeSide& side : turned[e]) directions.emplace_back(component_of[slot(side.facet)], side.forward ? 1 : -1);
    std::sort(directions.begin(), directions.end());
    for (std::size_t k = 0; k < directions.size();) {
      const Index component = directions[k].first;
      int sum = 0;
      for (; k < directions.size() && directions[k].first == component; ++k) sum += directions[k].second;
      if (sum != 0) open[slot(component)] = 1;
    }
  }
  std::vector<Index> chosen;
  for (std::size_t c = 0; c + 1 < begin.size(); ++c) {
    if (open[c] != 0) continue;
    chosen.assign(components.begin() + static_cast<std::ptrdiff_t>(begin[c]),
                  components.begin() + static_cast<std::ptrdiff_t>(begin[c + 1]));
    const auto disagrees = [&](Index t) { return disagreeing[slot(dual.facets[slot(t)])] != 0; };
    if (!std::any_of(chosen.begin(), chosen.end(), disagrees)) continue;
    std::sort(chosen.begin(), chosen.end());
    if (sign_of_volume(triangles, chosen, positions) >= 0) continue;
    for (const Index t : chosen) std::swap(triangles(t, 1), triangles(t, 2));
  }
}

}  // namespace

Dual listed_triangles(const RestrictedPowerDiagram& diagram, const std::vector<Index>& ids, const Execution& execution) {
  Dual dual;
  dual.triangles = diagram.dual_triangles(&dual.facets, execution.part(0, 0.7));
  if (!ids.empty()) {
    std::vector<Index> row(slot(diagram.num_sites()), kNone);
    for (std::size_t k = 0; k < ids.size(); ++k) row[slot(ids[k])] = static_cast<Index>(k);
    Triangles& triangles = dual.triangles;
    Ticker ticker(execution.part(0.7, 1), static_cast<std::uint64_t>(triangles.rows()), kElementsPerLook);
    for (std::ptrdiff_t t = 0; t < triangles.rows(); ++t) {
      ticker.tick();
      std::array<Index, 3> v = {row[slot(triangles(t, 0))], row[slot(triangles(t, 1))], row[slot(triangles(t, 2))]};
      std::rotate(v.begin(), std::min_element(v.begin(), v.end()), v.end());
      triangles.row(t) << v[0], v[1], v[2];
    }
  }
  return dual;
}

Dual restricted_triangles(const Dual& listed, const PointsView& positions, const SurfaceEdges& surface,
                          const Execution& execution) {
  Dual dual = odd_triples(listed, static_cast<Index>(positions.rows()), execution.part(0, 0.3));
  orient_consistently(dual, surface, positions, execution.part(0.3, 1));
  return dual;
}

}  // namespace amps::detail
