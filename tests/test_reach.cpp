#include "amps/reach.h"

#include "kit/data.h"
#include "kit/errors.h"
#include "kit/meshes.h"

#include "amps/predicates.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

namespace amps_test {

using amps::SurfacePoint;
using amps::detail::MeshEdge;
using amps::detail::PlacedPoint;
using amps::detail::ReachLists;
using amps::detail::SurfaceEdges;
using amps::detail::SurfaceFlood;

namespace {

using Coordinates = std::array<double, 3>;
using EdgeKey = std::pair<Coordinates, Coordinates>;

Coordinates coordinates(const Vec3& x) { return {x[0] + 0.0, x[1] + 0.0, x[2] + 0.0}; }  // without −0

/// The surface by its positions alone: sets of three points, and which of them have which edge.
struct BruteSurface {
  std::vector<std::set<Coordinates>> corners;  ///< by facet
  std::vector<char> counts;
  std::map<EdgeKey, std::vector<Index>> edges;

  explicit BruteSurface(const MeshView& mesh) {
    std::set<std::set<Coordinates>> seen;
    for (Index f = 0; f < mesh.num_facets(); ++f) {
      std::set<Coordinates> points;
      for (int k = 0; k < 3; ++k) points.insert(coordinates(mesh.corner(f, k)));
      counts.push_back(points.size() == 3 && seen.insert(points).second ? 1 : 0);
      corners.push_back(points);
      if (counts.back() == 0) continue;
      for (const Coordinates& a : points) {
        for (const Coordinates& b : points) {
          if (a < b) edges[{a, b}].push_back(f);
        }
      }
    }
  }

  /// Facets with all corners of `at`'s facet that its barycentric coordinates name.
  std::vector<Index> homes(const MeshView& mesh, const SurfacePoint& at) const {
    std::set<Coordinates> support;
    for (int k = 0; k < 3; ++k) {
      if (at.barycentric[k] != 0) support.insert(coordinates(mesh.corner(at.facet, k)));
    }
    std::vector<Index> result;
    for (std::size_t f = 0; f < corners.size(); ++f) {
      if (counts[f] != 0 && std::includes(corners[f].begin(), corners[f].end(), support.begin(), support.end())) {
        result.push_back(static_cast<Index>(f));
      }
    }
    return result;
  }

  /// Facets connected to homes over edges for which passes(a, b): by joining until nothing changes.
  template <class Passes>
  std::vector<Index> reached(const std::vector<Index>& homes, const Passes& passes) const {
    std::vector<char> in(corners.size(), 0);
    for (const Index f : homes) in[at(f)] = 1;
    for (bool changed = true; changed;) {
      changed = false;
      for (const auto& [edge, facets] : edges) {
        int inside = 0;
        for (const Index f : facets) inside += in[at(f)];
        if (inside == 0 || inside == static_cast<int>(facets.size()) || !passes(edge)) continue;
        for (const Index f : facets) in[at(f)] = 1;
        changed = true;
      }
    }
    std::vector<Index> result;
    for (std::size_t f = 0; f < in.size(); ++f) {
      if (in[f] != 0) result.push_back(static_cast<Index>(f));
    }
    return result;
  }
};

using Integers = std::array<std::int64_t, 3>;

Integers integers(const Coordinates& x) {
  Integers result{};
  for (std::size_t k = 0; k < 3; ++k) {
    result[k] = static_cast<std::int64_t>(x[k]);
    REQUIRE(static_cast<double>(result[k]) == x[k]);
  }
  return result;
}
std::int64_t dot(const Integers& a, const Integers& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/// Is the least squared distance of p to the segment at most w? In integers, with touching.
bool integer_meets(const EdgeKey& edge, const Integers& p, std::int64_t w, bool& touches) {
  const Integers a = integers(edge.first), b = integers(edge.second);
  const Integers u = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, v = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
  const std::int64_t length = dot(u, u), along = std::clamp<std::int64_t>(dot(u, v), 0, length);
  // |v − t·u|²·length², t = along/length
  std::int64_t numerator = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::int64_t d = v[k] * length - along * u[k];
    numerator += d * d;
  }
  touches = numerator == w * length * length;
  return numerator <= w * length * length;
}

/// With coordinates that are multiples of `step`, near what they were.
Mesh on_lattice(const Mesh& mesh, double step) {
  return transformed(mesh, [step](const Vec3& x) -> Vec3 {
    return {step * std::round(x[0] / step), step * std::round(x[1] / step), step * std::round(x[2] / step)};
  });
}

/// A strip of rectangles folded at each rung, `thickness` between its layers.
Mesh folded_strip(Index folds, double width, double thickness) {
  std::vector<Vec3> vertices;
  std::vector<Corners> triangles;
  for (Index i = 0; i <= folds; ++i) {
    const double x = i % 2 == 0 ? 0 : width, z = thickness * i;
    vertices.emplace_back(x, 0, z);
    vertices.emplace_back(x, width, z);
    if (i == 0) continue;
    const Index v = 2 * i;
    triangles.push_back({v - 2, v, v + 1});
    triangles.push_back({v - 2, v + 1, v - 1});
  }
  return mesh_of(vertices, triangles);
}

/// Facets with corners among few points of a lattice: any number of sheets at an edge, facets twice, without area or collapsed.
Mesh random_lattice_facets(Index num_vertices, Index num_facets, Index range, Rng& rng) {
  const Points vertices = made_points(
      num_vertices, [&](Index) { return Vec3(4.0 * below(rng, range), 4.0 * below(rng, range), 4.0 * below(rng, range)); });
  const auto corner = [&] { return below(rng, num_vertices); };
  return {vertices, made_triangles(num_facets, [&](Index) { return Corners{corner(), corner(), corner()}; })};
}

std::vector<NamedMesh> lattice_meshes() {
  Rng rng(5);
  std::vector<NamedMesh> list = {
      {"thin plate", on_lattice(transformed(amps::make_cube(5),
                                            [](const Vec3& x) -> Vec3 {
                                              return {40 * x[0], 40 * x[1], 4 * x[2]};
                                            }),
                                4)},
      {"folded strip", folded_strip(8, 24, 4)},
      {"sphere", on_lattice(scaled(amps::make_sphere(400), 40), 4)},
      {"soup of a sphere", soup_of(on_lattice(scaled(amps::make_sphere(200), 24), 4))},
      {"book", on_lattice(scaled(open_book(7), 16), 4)},
      {"two sheets", on_lattice(scaled(two_sheets(0.25), 16), 4)},
      {"coarse sphere, much of it collapsed", on_lattice(scaled(amps::make_sphere(800), 12), 4)},
      {"flat and collinear", on_lattice(scaled(joined(squashed(amps::make_square(4)), amps::make_square(4)), 16), 4)}};
  for (int n = 0; n < 12; ++n) {
    const Mesh mesh = random_lattice_facets(6 + 3 * n, 20 + 5 * n, 2 + n / 3, rng);
    list.push_back({"random facets", mesh});
    list.push_back({"random facets, each with its own vertices", soup_of(mesh)});
  }
  return list;
}

/// In a facet, on one of its edges or at a corner; of coordinates that are integers where those of corners are multiples of 4.
SurfacePoint lattice_point(const MeshView& mesh, Rng& rng) {
  static const std::array<Vec3, 4> kInside = {Vec3(0.5, 0.25, 0.25), Vec3(0.5, 0.5, 0), Vec3(0.25, 0.75, 0), Vec3(1, 0, 0)};
  const Vec3 b = kInside[rng.below(4)];
  const auto turn = static_cast<int>(rng.below(3));
  return amps::detail::surface_point_at(mesh, below(rng, mesh.num_facets()), {b[turn], b[(turn + 1) % 3], b[(turn + 2) % 3]});
}

EdgeKey key_of(const MeshView& mesh, const MeshEdge& edge) {
  const Coordinates a = coordinates(mesh.vertices[edge.low]), b = coordinates(mesh.vertices[edge.high]);
  return {std::min(a, b), std::max(a, b)};
}

/// A surface, some of its edges cut at random, and which those are.
struct CutSurface {
  SurfaceFlood flood;
  std::set<EdgeKey> cut_edges;
};

CutSurface cut_surface(const MeshView& mesh, double share, Rng& rng) {
  SurfaceEdges edges(mesh);
  std::vector<char> cut(edges.size(), 0);
  std::set<EdgeKey> cut_edges;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    if (rng.uniform() >= share) continue;
    cut[e] = 1;
    cut_edges.insert(key_of(mesh, edges[e]));
  }
  return {SurfaceFlood(mesh, std::move(edges), share == 0 ? std::vector<char>() : cut), std::move(cut_edges)};
}

PlacedPoint placed(const SurfaceFlood& flood, const SurfacePoint& at) { return {at.position, flood.homes(at)}; }

std::vector<Index> flooded(const SurfaceFlood& flood, const PlacedPoint& from, double weight, SurfaceFlood::Scratch& scratch) {
  std::vector<Index> facets;
  flood.flood(from.position, weight, from.homes, scratch, facets);
  return facets;
}

bool is_subset(const std::vector<Index>& a, const std::vector<Index>& b) {
  return std::includes(b.begin(), b.end(), a.begin(), a.end());
}

bool have_common(const std::vector<Index>& a, const std::vector<Index>& b) {
  return std::find_first_of(a.begin(), a.end(), b.begin(), b.end()) != a.end();
}

}  // namespace

TEST_CASE("reach: a flood reaches what is joined over edges that meet the closed ball, decided in integers") {
  SurfaceFlood::Scratch scratch;  // of all surfaces
  Rng rng(1);
  int touching = 0, of_several_homes = 0, homeless = 0, grown = 0;
  for (const NamedMesh& named : lattice_meshes()) {
    CAPTURE(named.name);
    const MeshView mesh(named.mesh);
    const BruteSurface brute(mesh);
    for (const double share : {0.0, 0.2}) {
      const CutSurface surface = cut_surface(mesh, share, rng);
      REQUIRE(surface.flood.edges().size() == brute.edges.size());
      for (int n = 0; n < 60; ++n) {
        const SurfacePoint point = lattice_point(mesh, rng);
        const PlacedPoint from = placed(surface.flood, point);
        REQUIRE(from.homes == brute.homes(mesh, point));
        of_several_homes += from.homes.size() > 1;
        homeless += from.homes.empty();
        const Integers p = integers(coordinates(point.position));
        const auto w = static_cast<std::int64_t>(n % 5 == 0 ? rng.below(4) : rng.below(n % 2 == 0 ? 60 : 600));
        const std::vector<Index> expected = brute.reached(from.homes, [&](const EdgeKey& edge) {
          if (surface.cut_edges.count(edge) != 0) return false;
          bool touches = false;
          const bool meets = integer_meets(edge, p, w, touches);
          touching += touches;
          return meets;
        });
        CHECK(flooded(surface.flood, from, static_cast<double>(w), scratch) == expected);
        grown += expected.size() > from.homes.size();
      }
    }
  }
  CHECK(touching > 100);
  CHECK(of_several_homes > 500);
  CHECK(homeless > 10);
  CHECK(grown > 1000);
}

TEST_CASE("reach: floods of real and round meshes, at random places") {
  SurfaceFlood::Scratch scratch;
  Rng rng(2);
  for (const Mesh& mesh : {data_mesh_or("bunny_3k_closed.off", amps::make_sphere(2000)), small_knot(),
                           data_mesh_or("fan3_nonmanifold_edge.obj", open_book(3))}) {
    const BruteSurface brute{MeshView(mesh)};
    const SurfaceFlood flood(mesh, SurfaceEdges(mesh));
    const SurfaceDraw draw(mesh);
    const double typical = std::sqrt(amps::total_area(mesh));
    for (int n = 0; n < 40; ++n) {
      const SurfacePoint point = draw(rng);
      const PlacedPoint from = placed(flood, point);
      CHECK(from.homes == std::vector<Index>{point.facet});
      const double w = std::pow(typical * between(rng, 0.001, 0.2), 2);
      const std::vector<Index> expected = brute.reached(from.homes, [&](const EdgeKey& edge) {
        // The nearest point of the edge, by halving: on a parabola the lower of two points is on its side.
        using Vector = Eigen::Matrix<Real, 3, 1>;
        const auto vector = [](const Coordinates& x) { return Vector(x[0], x[1], x[2]); };
        const Vector a = vector(edge.first), u = vector(edge.second) - a, p = point.position.cast<Real>();
        Real low = 0, high = 1;
        for (int step = 0; step < 64; ++step) {
          const bool lower = (a + low * u - p).squaredNorm() < (a + high * u - p).squaredNorm();
          (lower ? high : low) = (low + high) / 2;
        }
        return (a + low * u - p).squaredNorm() <= Real(w);
      });
      CHECK(flooded(flood, from, w, scratch) == expected);
    }
  }
}

TEST_CASE("reach: a dense flood from point to point reaches the same facets, to the distance of its points") {
  // Points of every facet on a lattice of its own; those on an edge are the same for all its facets.
  constexpr Index kCells = 24;
  SurfaceFlood::Scratch scratch;
  Rng rng(3);
  int compared = 0, apart = 0;
  for (const Mesh& mesh :
       {folded_strip(6, 1, 0.05), scaled(open_book(4), 0.5), transformed(amps::make_cube(2), [](const Vec3& x) -> Vec3 {
          return {x[0], x[1], 0.04 * x[2]};
        })}) {
    const MeshView view(mesh);
    const SurfaceFlood flood(mesh, SurfaceEdges(mesh));
    std::map<std::vector<std::pair<Index, Index>>, std::size_t> number_of_node;  // by vertices and multiples of 1/kCells
    std::vector<Vec3> nodes;
    std::vector<std::vector<std::size_t>> neighbours;
    std::vector<std::vector<Index>> facets_of_node;
    const auto node = [&](Index f, Index i, Index j) {
      std::vector<std::pair<Index, Index>> key;
      const Index parts[3] = {i, j, kCells - i - j};
      Vec3 x = Vec3::Zero();
      for (int k = 0; k < 3; ++k) {
        x += view.corner(f, k) * parts[k] / kCells;
        if (parts[k] > 0) key.emplace_back(flood.edges().triangles()(f, k), parts[k]);
      }
      std::sort(key.begin(), key.end());
      const auto [found, fresh] = number_of_node.emplace(key, nodes.size());
      if (fresh) {
        nodes.push_back(x);
        neighbours.emplace_back();
        facets_of_node.emplace_back();
      }
      return found->second;
    };
    double spacing = 0;
    for (Index f = 0; f < view.num_facets(); ++f) {
      for (Index i = 0; i <= kCells; ++i) {
        for (Index j = 0; i + j <= kCells; ++j) {
          const std::size_t here = node(f, i, j);
          facets_of_node[here].push_back(f);
          for (const auto& [di, dj] : {std::pair<Index, Index>{1, 0}, {0, 1}, {1, -1}}) {
            if (i + di > kCells || j + dj < 0 || i + j + di + dj > kCells) continue;
            const std::size_t there = node(f, i + di, j + dj);
            neighbours[here].push_back(there);
            neighbours[there].push_back(here);
            spacing = std::max(spacing, (nodes[here] - nodes[there]).norm());
          }
        }
      }
    }
    for (int n = 0; n < 60; ++n) {
      const Index f = below(rng, view.num_facets());
      const Index i = 1 + below(rng, kCells - 2), j = 1 + below(rng, kCells - 1 - i);
      const std::size_t start = node(f, i, j);
      const double r = spacing + between(rng, 0.05, 0.5);
      std::vector<char> seen(nodes.size(), 0);
      std::vector<std::size_t> queue = {start};
      seen[start] = 1;
      std::set<Index> dense = {f};
      for (std::size_t q = 0; q < queue.size(); ++q) {
        dense.insert(facets_of_node[queue[q]].begin(), facets_of_node[queue[q]].end());
        for (const std::size_t m : neighbours[queue[q]]) {
          if (seen[m] != 0 || (nodes[m] - nodes[start]).norm() > r) continue;
          seen[m] = 1;
          queue.push_back(m);
        }
      }
      const PlacedPoint from = {nodes[start], {f}};
      const std::vector<Index> outer = flooded(flood, from, r * r * (1 + 1e-12), scratch);
      const std::vector<Index> inner = flooded(flood, from, (r - spacing) * (r - spacing), scratch);
      const std::vector<Index> between_them(dense.begin(), dense.end());
      CHECK(is_subset(between_them, outer));
      CHECK(is_subset(inner, between_them));
      ++compared;
      apart += inner.size() < static_cast<std::size_t>(view.num_facets());
    }
  }
  CHECK(compared == 180);
  CHECK(apart > 100);
}

TEST_CASE("reach: a greater ball reaches no less; what edges join is reached together") {
  SurfaceFlood::Scratch scratch;
  Rng rng(4);
  for (const NamedMesh& named : small_meshes()) {
    CAPTURE(named.name);
    const CutSurface surface = cut_surface(named.mesh, 0.05, rng);
    const SurfaceEdges& edges = surface.flood.edges();
    const SurfaceDraw draw(named.mesh);
    for (int n = 0; n < 10; ++n) {
      const PlacedPoint from = placed(surface.flood, draw(rng));
      std::vector<Index> before = from.homes;
      for (double r = 0.01; r < 4; r *= 1.3) {
        const std::vector<Index> reached = flooded(surface.flood, from, r * r, scratch);
        CHECK(is_subset(before, reached));
        before = reached;
        for (std::size_t e = 0; e < edges.size(); ++e) {
          if (surface.flood.is_cut(e)) continue;
          const Vec3 a = surface.flood.position(edges[e].low), b = surface.flood.position(edges[e].high);
          if (amps::segment_side_of_ball(a.data(), b.data(), from.position.data(), r * r) > 0) continue;
          int inside = 0;
          for (const auto& side : edges[e]) inside += std::binary_search(reached.begin(), reached.end(), side.facet);
          CHECK((inside == 0 || inside == static_cast<int>(edges[e].size())));
        }
      }
      CHECK(flooded(surface.flood, from, -1, scratch) == from.homes);
    }
  }
}

TEST_CASE("reach: facets at an edge, at a vertex, and of points there") {
  const Mesh mesh = soup_of(amps::make_cube(2));
  const SurfaceFlood flood(mesh, SurfaceEdges(mesh));
  const SurfaceEdges& edges = flood.edges();
  const BruteSurface brute{MeshView(mesh)};
  for (std::size_t e = 0; e < edges.size(); ++e) {
    CHECK(flood.homes_of_edge(e) == brute.edges.at(key_of(mesh, edges[e])));
    for (const auto& side : edges[e]) {
      SurfacePoint at{side.facet, Vec3::Zero(), Vec3::Zero()};
      at.barycentric[side.k] = 0.25;
      at.barycentric[(side.k + 1) % 3] = 0.75;
      at.barycentric[(side.k + 2) % 3] = -0.0;
      CHECK(flood.homes(at) == flood.homes_of_edge(e));
    }
  }
  for (Index f = 0; f < edges.num_facets(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const SurfacePoint corner{f, Vec3::Unit(k), flood.position(edges.triangles()(f, k))};
      CHECK(flood.homes(corner) == brute.homes(mesh, corner));
      CHECK(flood.homes_of_vertex(edges.triangles()(f, k)) == flood.homes(corner));
    }
  }
  const Mesh square = amps::make_square(1);
  CHECK(SurfaceFlood(square, SurfaceEdges(square)).homes_of_vertex(kNone + 1).size() >= 1);
  CHECK(error_of([&] { SurfaceFlood(square, SurfaceEdges(square), {1, 0}); }) == ErrorCode::kInvalidArgument);
}

TEST_CASE("reach: a disk holds a point iff its ball does and its flood reaches one of the point's facets") {
  SurfaceFlood::Scratch scratch;
  Rng rng(6);
  int held = 0, blocked = 0;
  for (const NamedMesh& named : lattice_meshes()) {
    const MeshView mesh(named.mesh);
    const CutSurface surface = cut_surface(mesh, 0.1, rng);
    for (int n = 0; n < 100; ++n) {
      const PlacedPoint from = placed(surface.flood, lattice_point(mesh, rng)),
                        to = placed(surface.flood, lattice_point(mesh, rng));
      const double squared = (to.position - from.position).squaredNorm();  // exact: integers
      for (const double w : {squared, std::nextafter(squared, -1.0), 2 * squared}) {
        const bool reached = have_common(flooded(surface.flood, from, w, scratch), to.homes);
        CHECK(surface.flood.holds(from, w, to, scratch) == (squared <= w && reached));
        held += squared <= w && reached;
        blocked += squared <= w && !reached;
      }
    }
  }
  CHECK(held > 500);
  CHECK(blocked > 500);
}

TEST_CASE("reach: the bottleneck is the radius at which a disk comes to hold a point") {
  SurfaceFlood::Scratch scratch;
  Rng rng(7);
  int finite = 0, infinite = 0, by_edges = 0, folds = 0;
  std::vector<NamedMesh> meshes = small_meshes();
  meshes.push_back({"folded strip", folded_strip(8, 1, 0.03)});
  meshes.push_back({"plate", transformed(amps::make_cube(4), [](const Vec3& x) -> Vec3 { return {x[0], x[1], 0.02 * x[2]}; })});
  for (const NamedMesh& named : meshes) {
    CAPTURE(named.name);
    const CutSurface surface = cut_surface(named.mesh, named.name == "torus" ? 0.1 : 0, rng);
    const SurfaceFlood& flood = surface.flood;
    const SurfaceDraw draw(named.mesh);
    const double size = amps::bounding_box(named.mesh).diagonal();
    for (int n = 0; n < 400; ++n) {
      const PlacedPoint p = placed(flood, draw(rng)), q = placed(flood, draw(rng));
      const double limit = size * between(rng, 0.01, n % 2 == 0 ? 0.5 : 1.2);
      const double radius = flood.bottleneck(p, q, limit, scratch);
      if (!flood.holds(p, limit * limit, q, scratch)) {
        CHECK(radius == kInfinity);
        ++infinite;
        continue;
      }
      ++finite;
      CHECK(radius < limit);
      CHECK_FALSE(flood.holds(p, radius * radius, q, scratch));
      double low = 0, high = limit;
      for (int step = 0; step < 100; ++step) {
        const double middle = (low + high) / 2;
        (flood.holds(p, middle * middle, q, scratch) ? high : low) = middle;
      }
      const double slack = 0x1p-40 * (limit + size);
      CHECK(radius <= high);
      CHECK(radius >= low - slack);
      const double d = (p.position - q.position).norm();
      CHECK(radius >= d * (1 - 1e-12));
      by_edges += radius > d * (1 + 1e-9);
      // Round a fold: q's disk has no room for p, but p's holds q. Then p's must be large before it does.
      const double r = between(rng, 1, 3) * d;
      if (flood.holds(q, r * r, p, scratch)) continue;
      CHECK(radius >= std::max(d, r - d) * (1 - 1e-12));
      ++folds;
    }
  }
  CHECK(finite > 300);
  CHECK(infinite > 300);
  CHECK(by_edges > 100);
  CHECK(folds > 30);
}

TEST_CASE("reach: the bottleneck of points of one position and of one facet") {
  const Mesh mesh = amps::make_square(3);
  const SurfaceFlood flood(mesh, SurfaceEdges(mesh));
  SurfaceFlood::Scratch scratch;
  const PlacedPoint p = placed(flood, amps::detail::surface_point_at(mesh, 4, {0.5, 0.25, 0.25}));
  PlacedPoint q = placed(flood, amps::detail::surface_point_at(mesh, 4, {0.25, 0.25, 0.5}));
  CHECK(flood.bottleneck(p, p, 1, scratch) == 0);
  const double d = (p.position - q.position).norm();
  CHECK(flood.bottleneck(p, q, 1, scratch) == doctest::Approx(d).epsilon(1e-14));
  CHECK(flood.bottleneck(p, q, d / 2, scratch) == kInfinity);
  q.homes.clear();
  CHECK(flood.bottleneck(p, q, 1, scratch) == kInfinity);
}

TEST_CASE("reach: lists of facets are those of a map, after any edits") {
  constexpr Index kFacets = 60, kSamples = 400;
  Rng rng(8);
  ReachLists lists;
  std::map<Index, std::set<Index>> model;
  const auto random_list = [&] {
    std::set<Index> facets;
    const Index size = rng.below(4) == 0 ? below(rng, 30) : below(rng, 6);
    for (Index k = 0; k < size; ++k) facets.insert(below(rng, kFacets));
    return std::vector<Index>(facets.begin(), facets.end());
  };
  int compactions = 0, reused = 0;
  for (int edit = 0; edit < 40000; ++edit) {
    const Index s = below(rng, edit % 8000 < 4000 ? kSamples : kSamples / 8);
    const std::size_t capacity = lists.capacity();
    if (model.count(s) == 0) {
      const std::vector<Index> facets = random_list();
      lists.add(s, facets);
      model[s] = {facets.begin(), facets.end()};
      reused += !facets.empty() && lists.capacity() == capacity;
    } else if (rng.below(2) == 0) {
      model.erase(s);
      lists.remove(s);
      compactions += lists.capacity() < capacity;
    } else {
      const std::vector<Index> before(model[s].begin(), model[s].end());
      const std::vector<Index> facets = rng.below(4) == 0 ? before : random_list();
      CHECK(lists.replace(s, facets) == (facets != before));
      model[s] = {facets.begin(), facets.end()};
    }
    if (edit % 4000 == 3999) {  // nothing left, or nearly
      for (Index all = 0; all < kSamples; ++all) {
        if (model.count(all) == 0) continue;
        model.erase(all);
        lists.remove(all);
      }
      CHECK(lists.size() == 0);
    }
    if (edit % 37 != 0) continue;
    std::size_t pairs = 0;
    for (Index sample = 0; sample < kSamples; ++sample) {
      REQUIRE(lists.has(sample) == (model.count(sample) != 0));
      if (!lists.has(sample)) continue;
      const auto facets = lists.facets(sample);
      REQUIRE(std::equal(facets.begin(), facets.end(), model[sample].begin(), model[sample].end()));
      pairs += facets.size();
      for (Index f = 0; f < kFacets; f += 7) REQUIRE(lists.reaches(sample, f) == (model[sample].count(f) != 0));
    }
    REQUIRE(lists.size() == pairs);
    REQUIRE(lists.capacity() <= 2 * pairs + 2048);
  }
  CHECK(compactions > 3);
  CHECK(reused > 1000);
}

TEST_CASE("reach: a stopped job ends the making of floods, and large floods") {
  const Mesh mesh = amps::make_sphere(100000);
  const SurfaceFlood flood(mesh, SurfaceEdges(mesh));
  const PlacedPoint p = placed(flood, amps::detail::surface_point_at(mesh, 7, {0.5, 0.25, 0.25})),
                    q = placed(flood, amps::detail::surface_point_at(mesh, 70000, {0.5, 0.25, 0.25}));
  const amps::Progress progress;
  SurfaceFlood::Scratch scratch(amps::Execution(1, progress));
  CHECK(flooded(flood, p, 100, scratch) == all_indices(rows(mesh.triangles)));
  const std::vector<Index> half = flooded(flood, p, 2, scratch), few = flooded(flood, p, 0.1, scratch);
  CHECK(std::is_sorted(half.begin(), half.end()));
  CHECK(is_subset(few, half));
  CHECK((few.size() > 1000 && half.size() > 10 * few.size()));
  progress.cancel();
  CHECK(flooded(flood, p, 0.001, scratch).size() > 1);
  CHECK(error_of([&] { flooded(flood, p, 100, scratch); }) == ErrorCode::kCancelled);
  CHECK(error_of([&] { flood.bottleneck(p, q, 100, scratch); }) == ErrorCode::kCancelled);
  CHECK(error_of([&] { SurfaceFlood(mesh, SurfaceEdges(mesh), {}, amps::Execution(1, progress)); }) == ErrorCode::kCancelled);
}

}  // namespace amps_test
