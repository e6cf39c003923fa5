#include "amps/mesh_edges.h"

#include "kit/execution.h"
#include "kit/meshes.h"

#include "amps/mesh.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <utility>
#include <vector>

namespace amps_test {

using amps::detail::DistinctPoints;
using amps::detail::EdgeSide;
using amps::detail::MeshEdge;
using amps::detail::MeshEdges;
using amps::detail::UnionFind;

namespace {

/// Facets with corners at random: few vertices, so that edges have any number of facets, and indices repeat.
Mesh random_facets(Index num_vertices, Index num_facets, std::uint64_t seed) {
  Rng rng(seed);
  const Points vertices = made_points(num_vertices, [&rng](Index) { return random_point(rng); });
  const auto corner = [&] { return below(rng, num_vertices); };
  return {vertices, made_triangles(num_facets, [&](Index) { return Corners{corner(), corner(), corner()}; })};
}

std::vector<char> random_flags(std::size_t n, double share, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<char> flags(n);
  for (char& flag : flags) flag = rng.uniform() < share ? 1 : 0;
  return flags;
}

using SidesByEdge = std::map<std::pair<Index, Index>, std::vector<std::array<Index, 3>>>;  // facet, k, forward

SidesByEdge brute_sides(const Mesh& mesh, const std::vector<char>& counted) {
  SidesByEdge result;
  for (Index f = 0; f < rows(mesh.triangles); ++f) {
    if (!counted.empty() && counted[static_cast<std::size_t>(f)] == 0) continue;
    for (Index k = 0; k < 3; ++k) {
      const Index a = mesh.triangles(f, k), b = mesh.triangles(f, (k + 1) % 3);
      result[std::minmax(a, b)].push_back({f, k, a <= b ? 1 : 0});
    }
  }
  return result;
}

void require_same_sides(const Mesh& mesh, const std::vector<char>& counted) {
  const MeshEdges edges(mesh.triangles, rows(mesh.vertices), counted);
  const SidesByEdge wanted = brute_sides(mesh, counted);
  REQUIRE(edges.size() == wanted.size());
  REQUIRE(edges.num_corners() == 3 * at(rows(mesh.triangles)));
  const std::vector<Index> edge_of_side = edges.edge_of_sides();
  std::size_t e = 0, sides = 0;
  for (const auto& [ends, list] : wanted) {  // a map: by lower, then by higher vertex
    const MeshEdge edge = edges[e];
    REQUIRE(edge.low == ends.first);
    REQUIRE(edge.high == ends.second);
    REQUIRE(edge.size() == list.size());
    CHECK(edge.boundary() == (list.size() == 1));
    CHECK(edge.non_manifold() == (list.size() > 2));
    CHECK(edge.regular() == (list.size() == 2 && list[0][2] != list[1][2]));
    for (std::size_t i = 0; i < list.size(); ++i) {
      const EdgeSide side = edge[i];
      REQUIRE(side.facet == list[i][0]);
      REQUIRE(side.k == list[i][1]);
      REQUIRE(side.forward == (list[i][2] == 1));
      const auto vertex = [&](std::size_t corner) {
        return mesh.triangles(static_cast<Index>(corner / 3), static_cast<Index>(corner % 3));
      };
      REQUIRE(vertex(side.low_corner()) == edge.low);
      REQUIRE(vertex(side.high_corner()) == edge.high);
      REQUIRE(edge_of_side[side.corner()] == static_cast<Index>(e));
      ++sides;
    }
    ++e;
  }
  const auto none = std::count(edge_of_side.begin(), edge_of_side.end(), kNone);
  CHECK(static_cast<std::size_t>(none) + sides == edges.num_corners());
}

/// Labels go round until nothing changes: corners of one vertex whose facets share an edge at it that is not cut.
std::vector<std::size_t> brute_fans(const Mesh& mesh, const std::vector<char>& counted,
                                    const std::set<std::pair<Index, Index>>& cut) {
  const std::size_t n = 3 * at(rows(mesh.triangles));
  const auto vertex = [&](std::size_t c) { return mesh.triangles(static_cast<Index>(c / 3), static_cast<Index>(c % 3)); };
  const auto in_facet = [](std::size_t c, std::size_t step) { return c - c % 3 + (c % 3 + step) % 3; };
  std::vector<std::size_t> label(n);
  for (std::size_t c = 0; c < n; ++c) label[c] = c;
  for (bool changed = true; changed;) {
    changed = false;
    for (std::size_t a = 0; a < n; ++a) {
      for (std::size_t b = 0; b < n; ++b) {
        if (vertex(a) != vertex(b) || counted[a / 3] == 0 || counted[b / 3] == 0 || label[a] <= label[b]) continue;
        bool joined = false;
        for (const std::size_t i : {1u, 2u}) {
          for (const std::size_t j : {1u, 2u}) {
            const Index other = vertex(in_facet(a, i));
            joined |= other == vertex(in_facet(b, j)) && cut.count(std::minmax(vertex(a), other)) == 0;
          }
        }
        if (!joined) continue;
        label[a] = label[b];
        changed = true;
      }
    }
  }
  return label;
}

}  // namespace

TEST_CASE("mesh_edges: each edge has the sides that lie on it, in the order of facets, with their directions") {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    CAPTURE(seed);
    const Index num_vertices = seed % 2 == 0 ? 7 : 60;
    const Mesh mesh = random_facets(num_vertices, 150, seed);
    require_same_sides(mesh, {});
    require_same_sides(mesh, random_flags(150, 0.7, seed));
    require_same_sides(mesh, std::vector<char>(150, 0));
  }
  require_same_sides(amps::make_sphere(320), {});
  require_same_sides(amps::make_square(6), {});
  // A vertex with more edges than are sorted by insertion.
  const Mesh star{constant_points(101, 0), made_triangles(100, [](Index f) {
                    return Corners{(f + 1) % 100 + 1, 0, (37 * f) % 100 + 1};
                  })};
  require_same_sides(star, {});
}

TEST_CASE("mesh_edges: no facet, no edge") {
  const MeshEdges edges(amps::Triangles(0, 3), 4);
  CHECK(edges.size() == 0);
  CHECK(edges.num_corners() == 0);
  CHECK(amps::detail::corner_fans(edges).empty());
}

TEST_CASE("mesh_edges: fans are the corners of a vertex that are joined across edges without a cut") {
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    CAPTURE(seed);
    Mesh mesh = random_facets(9, 24, 100 + seed);
    std::vector<char> counted = random_flags(24, 0.9, seed);
    for (Index f = 0; f < 24; ++f) {  // a facet with a repeated index has two corners at one vertex
      const auto& t = mesh.triangles;
      if (t(f, 0) == t(f, 1) || t(f, 1) == t(f, 2) || t(f, 2) == t(f, 0)) counted[static_cast<std::size_t>(f)] = 0;
    }
    const MeshEdges edges(mesh.triangles, 9, counted);
    const std::vector<char> cut = seed % 3 == 0 ? std::vector<char>() : random_flags(edges.size(), 0.5, 7 * seed);
    std::set<std::pair<Index, Index>> cut_pairs;
    for (std::size_t e = 0; e < cut.size(); ++e) {
      if (cut[e] != 0) cut_pairs.insert({edges[e].low, edges[e].high});
    }
    const std::vector<std::size_t> fans = amps::detail::corner_fans(edges, cut);
    const std::vector<std::size_t> wanted = brute_fans(mesh, counted, cut_pairs);
    CHECK(fans == wanted);
    std::vector<std::set<std::size_t>> at(9);
    for (std::size_t c = 0; c < wanted.size(); ++c) {
      if (counted[c / 3] == 0) continue;
      at[static_cast<std::size_t>(mesh.triangles(static_cast<Index>(c / 3), static_cast<Index>(c % 3)))].insert(wanted[c]);
    }
    const std::vector<Index> number = amps::detail::fans_at_vertices(mesh.triangles, 9, fans, counted);
    for (std::size_t v = 0; v < at.size(); ++v) CHECK(number[v] == static_cast<Index>(at[v].size()));
  }
}

TEST_CASE("mesh_edges: an edge that is cut makes two fans where it is crossed twice, and one where it ends") {
  // A square of 2 by 2 cells: vertex 4 in the middle; its edges to 1, 3, 5, 7 and two diagonals.
  const Mesh mesh = amps::make_square(2);
  const MeshEdges edges(mesh.triangles, 9);
  const auto fans_in_the_middle = [&](const std::set<Index>& cut_to) {
    std::vector<char> cut(edges.size(), 0);
    for (std::size_t e = 0; e < edges.size(); ++e) {
      cut[e] =
          (edges[e].low == 4 && cut_to.count(edges[e].high) != 0) || (edges[e].high == 4 && cut_to.count(edges[e].low) != 0);
    }
    return amps::detail::fans_at_vertices(mesh.triangles, 9, amps::detail::corner_fans(edges, cut))[4];
  };
  CHECK(fans_in_the_middle({}) == 1);
  CHECK(fans_in_the_middle({1}) == 1);
  CHECK(fans_in_the_middle({1, 7}) == 2);
  CHECK(fans_in_the_middle({1, 3, 5, 7}) == 4);
}

TEST_CASE("mesh_edges: disjoint sets are the components of their joins, named by the smallest element") {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    CAPTURE(seed);
    Rng rng(seed);
    constexpr std::size_t kElements = 80;
    UnionFind sets(kElements);
    std::vector<std::size_t> wanted(kElements);
    for (std::size_t i = 0; i < kElements; ++i) wanted[i] = i;
    for (int k = 0; k < 60; ++k) {
      const std::size_t a = rng.below(kElements), b = rng.below(kElements);
      sets.join(a, b);
      const std::size_t least = std::min(wanted[a], wanted[b]), other = std::max(wanted[a], wanted[b]);
      for (std::size_t& label : wanted) label = label == other ? least : label;
    }
    for (std::size_t i = 0; i < kElements; ++i) CHECK(sets.find(i) == wanted[i]);
    CHECK(sets.count(std::vector<char>(kElements, 1)) == std::set<std::size_t>(wanted.begin(), wanted.end()).size());
    CHECK(sets.count(std::vector<char>(kElements, 0)) == 0);
  }
}

TEST_CASE("mesh_edges: equal positions are one point, exactly; −0 equals 0, NaN equals nothing") {
  Rng rng(3);
  DistinctPoints points;
  std::map<std::array<double, 3>, Index> wanted;
  for (int i = 0; i < 5000; ++i) {
    Vec3 x;
    for (int k = 0; k < 3; ++k) {
      x[k] = 0.1 * (static_cast<double>(rng.below(12)) - 6);
      if (rng.below(4) == 0) x[k] = -x[k];                                                           // −0 at times
      if (rng.below(40) == 0) x[k] = std::nextafter(x[k], std::numeric_limits<double>::infinity());  // near is not equal
    }
    const auto [at, fresh] = wanted.insert({{x[0] + 0.0, x[1] + 0.0, x[2] + 0.0}, static_cast<Index>(wanted.size())});
    REQUIRE(points.find_or_add(x) == at->second);
    if (fresh) REQUIRE(points[at->second] == x);
  }
  REQUIRE(points.size() == static_cast<Index>(wanted.size()));
  REQUIRE(points.coordinates().size() == 3 * wanted.size());

  Index alone = 0;  // a search among those before would never end
  for (Index i = 0; i < 1'000'000; ++i)
    alone += points.find_or_add({0, kNaN, 0}) == static_cast<Index>(wanted.size()) + i ? 1 : 0;
  CHECK(alone == 1'000'000);
  CHECK(points.find_or_add(Vec3(0, -0.0, 0)) == wanted.at({0, 0, 0}));
}

TEST_CASE("mesh_edges: a vertex is told the first of equal position") {
  Mesh mesh = random_facets(400, 1, 11);
  Rng rng(5);
  for (Index v = 0; v < 400; ++v) {
    if (rng.below(3) == 0) mesh.vertices.row(v) = point_at(mesh.vertices, below(rng, 400)).transpose();
    if (rng.below(50) == 0) mesh.vertices(v, 1) = kNaN;
  }
  const std::vector<Index> first = amps::detail::first_equal_vertices(mesh);
  REQUIRE(first.size() == 400);
  for (Index v = 0; v < 400; ++v) {
    Index wanted = v;
    for (Index u = v - 1; u >= 0; --u) wanted = point_at(mesh.vertices, u) == point_at(mesh.vertices, v) ? u : wanted;
    CHECK(first[static_cast<std::size_t>(v)] == wanted);
  }
}

TEST_CASE("mesh_edges: facets that are there again, among those that cannot be, however many") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const std::uint64_t seed : {1, 2, 3, 4, 5}) {
    CAPTURE(seed);
    Mesh mesh = random_facets(14, 600, seed);
    amps::Rng rng(seed);
    for (Index v = 7; v < 14; ++v) mesh.vertices.row(v) = mesh.vertices.row(v % 6);
    mesh.vertices(0, 0) = 0.0;
    mesh.vertices(6, 0) = -0.0;
    mesh.vertices(1, 2) = nan;
    for (int k = 0; k < 20; ++k) {  // no vertices
      mesh.triangles(static_cast<Index>(rng.below(600)), static_cast<int>(rng.below(3))) = k % 2 == 0 ? -1 - k : 14 + k;
    }
    std::set<std::set<std::array<double, 3>>> seen;
    std::vector<Index> wanted;
    for (Index f = 0; f < rows(mesh.triangles); ++f) {
      std::set<std::array<double, 3>> corners;
      bool proper = true;
      for (int k = 0; k < 3 && proper; ++k) {
        const Index v = mesh.triangles(f, k);
        proper = v >= 0 && v < 14 && !std::isnan(mesh.vertices(v, 2));
        if (proper) corners.insert({mesh.vertices(v, 0) + 0.0, mesh.vertices(v, 1) + 0.0, mesh.vertices(v, 2) + 0.0});
      }
      if (proper && corners.size() == 3 && !seen.insert(corners).second) wanted.push_back(f);
    }
    CHECK(wanted.size() > 100);
    CHECK(amps::detail::find_repeated_facets(mesh) == wanted);
  }
  // As scans have them where they saw nothing: at one position, which took a second for each 20,000, and its square for more.
  Mesh collapsed;
  collapsed.vertices = amps::Points(300'002);
  collapsed.triangles = amps::Triangles(300'000);
  for (Index v = 0; v < rows(collapsed.vertices); ++v) {
    for (int k = 0; k < 3; ++k) collapsed.vertices(v, k) = v % 3 == 0 && v < 600 ? nan : 0;
  }
  for (Index f = 0; f < rows(collapsed.triangles); ++f) {
    for (int k = 0; k < 3; ++k) collapsed.triangles(f, k) = f + k;
  }
  CHECK(amps::detail::find_repeated_facets(collapsed).empty());
}

TEST_CASE("surface edges: vertices by position, facets without repeated corners, each once") {
  for (const std::uint64_t seed : {1, 2, 3}) {
    CAPTURE(seed);
    Mesh mesh = random_facets(12, 300, seed);
    for (Index v = 6; v < 12; ++v) mesh.vertices.row(v) = mesh.vertices.row(v % 5);  // −0 and +0 are one as well
    mesh.vertices(0, 0) = 0.0;
    mesh.vertices(10, 0) = -0.0;
    const amps::detail::SurfaceEdges surface(mesh);
    const auto first = [&](Index v) {
      for (Index u = 0; u < v; ++u) {
        if (mesh.vertices(u, 0) == mesh.vertices(v, 0) && mesh.vertices(u, 1) == mesh.vertices(v, 1) &&
            mesh.vertices(u, 2) == mesh.vertices(v, 2)) {
          return u;
        }
      }
      return v;
    };
    std::set<std::set<Index>> seen;
    std::vector<char> counted;
    std::vector<Index> repeated;
    for (Index f = 0; f < rows(mesh.triangles); ++f) {
      std::set<Index> corners;
      for (int k = 0; k < 3; ++k) {
        CHECK(surface.triangles()(f, k) == first(mesh.triangles(f, k)));
        corners.insert(first(mesh.triangles(f, k)));
      }
      const bool proper = corners.size() == 3;
      counted.push_back(proper && seen.insert(corners).second ? 1 : 0);
      if (proper && counted.back() == 0) repeated.push_back(f);
    }
    CHECK(surface.counted() == counted);
    CHECK(surface.repeated_facets() == repeated);
    CHECK(!repeated.empty());
    require_same_sides({mesh.vertices, surface.triangles()}, counted);
    for (Index f = 0; f < surface.num_facets(); ++f) {
      if (!surface.counts(f)) continue;
      for (int k = 0; k < 3; ++k) {
        const MeshEdge edge = surface[surface.edge(f, k)];
        const Index a = surface.triangles()(f, k), b = surface.triangles()(f, (k + 1) % 3);
        CHECK(edge.low == std::min(a, b));
        CHECK(edge.high == std::max(a, b));
        CHECK(std::count_if(edge.begin(), edge.end(), [f](const EdgeSide& side) { return side.facet == f; }) == 1);
      }
    }
  }
}

TEST_CASE("surface edges: the topology of a surface is that of its mesh, welded, without facets that are there already") {
  std::vector<NamedMesh> meshes = small_meshes();
  for (const std::uint64_t seed : {1, 2, 3}) meshes.push_back({"random", random_facets(40, 60, seed)});
  for (const NamedMesh& named : meshes) {
    CAPTURE(named.name);
    const Mesh mesh = joined(soup_of(named.mesh), first_facets(named.mesh, rows(named.mesh.triangles) / 2));
    const amps::detail::SurfaceEdges surface(mesh);
    std::vector<Index> facets;
    for (Index f = 0; f < rows(mesh.triangles); ++f) {
      if (surface.counts(f)) facets.push_back(f);
    }
    const amps::TopologyReport wanted = amps::topology(chosen_facets(amps::merge_equal_vertices(mesh), facets));
    const amps::TopologyReport found =
        amps::detail::topology_of(surface.triangles(), surface.num_vertices(), surface.edges(), surface.counted());
    CHECK(found.vertices == wanted.vertices);
    CHECK(found.edges == wanted.edges);
    CHECK(found.facets == wanted.facets);
    CHECK(found.components == wanted.components);
    CHECK(found.euler_characteristic == wanted.euler_characteristic);
    CHECK(found.boundary_edges == wanted.boundary_edges);
    CHECK(found.boundary_loops == wanted.boundary_loops);
    CHECK(found.non_manifold_edges == wanted.non_manifold_edges);
    CHECK(found.non_manifold_vertices == wanted.non_manifold_vertices);
    CHECK(found.inconsistent_edges == wanted.inconsistent_edges);
  }
}

TEST_CASE("mesh_edges: the same on any number of threads") {
  Rng rng(41);
  // Random triangles: edges of no, one and many facets, a hub in a third of all, and flags that leave out some.
  const Index num_vertices = 9000, num_facets = 70000;
  std::vector<Index> corners;
  for (Index f = 0; f < num_facets; ++f) {
    const auto v = static_cast<Index>(rng.below(num_vertices - 40));
    corners.push_back(f % 3 == 0 ? 4711 : v);
    corners.push_back(v + 1 + static_cast<Index>(rng.below(4)));
    corners.push_back(v + 5 + static_cast<Index>(rng.below(30)));
  }
  const amps::Triangles triangles(corners);
  std::vector<char> counted;
  for (Index f = 0; f < num_facets; ++f) counted.push_back(rng.below(5) != 0 ? 1 : 0);
  for (const std::vector<char>& flags : {std::vector<char>(), counted}) {
    const amps::detail::MeshEdges one(triangles, num_vertices, flags, on_threads(1));
    std::size_t num_sides = 0;
    for (const unsigned threads : {2u, 3u, 7u}) {
      const amps::detail::MeshEdges several(triangles, num_vertices, flags, on_threads(threads));
      REQUIRE(several.size() == one.size());
      bool same = true;
      num_sides = 0;
      for (std::size_t e = 0; e < one.size(); ++e) {
        const auto a = one[e], b = several[e];
        same = same && a.low == b.low && a.high == b.high && a.size() == b.size();
        for (std::size_t k = 0; same && k < a.size(); ++k) {
          same = a[k].high == a.high && a[k].high == b[k].high && a[k].facet == b[k].facet && a[k].k == b[k].k &&
                 a[k].forward == b[k].forward;
        }
        num_sides += b.size();
      }
      CHECK(same);
      CHECK(several.edge_of_sides(on_threads(threads)) == one.edge_of_sides());
    }
    const auto left_out = std::count(flags.begin(), flags.end(), char{0});
    CHECK(num_sides == 3 * static_cast<std::size_t>(num_facets - left_out));
  }
}

}  // namespace amps_test
