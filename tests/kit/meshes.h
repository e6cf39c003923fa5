// meshes.h: meshes by hand and at random, with all that may be odd about one, and what can be done to a mesh.
#pragma once

#include "points.h"
#include "random.h"

#include "amps/shapes.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

struct NamedMesh {
  std::string name;
  Mesh mesh;
};

inline Mesh mesh_of(const std::vector<Vec3>& vertices, const std::vector<Corners>& triangles) {
  return {points_of(vertices), triangles_of(triangles)};
}

inline Mesh one_triangle(const Vec3& a, const Vec3& b, const Vec3& c) { return mesh_of({a, b, c}, {{0, 1, 2}}); }

/// A mesh of its own three vertices per facet.
inline Mesh soup_mesh(const std::vector<std::array<Vec3, 3>>& facets) {
  std::vector<Vec3> vertices;
  std::vector<Corners> triangles;
  for (const auto& facet : facets) {
    const auto v = static_cast<Index>(vertices.size());
    vertices.insert(vertices.end(), facet.begin(), facet.end());
    triangles.push_back({v, v + 1, v + 2});
  }
  return mesh_of(vertices, triangles);
}

/// Every facet with three vertices of its own.
inline Mesh soup_of(const Mesh& mesh) {
  std::vector<std::array<Vec3, 3>> facets;
  const MeshView view(mesh);
  for (Index f = 0; f < view.num_facets(); ++f) facets.push_back({view.corner(f, 0), view.corner(f, 1), view.corner(f, 2)});
  return soup_mesh(facets);
}

// What can be done to a mesh.

template <class Map>
Mesh transformed(Mesh mesh, const Map& map) {
  mesh.vertices = transformed(mesh.vertices, map);
  return mesh;
}

inline Mesh scaled(Mesh mesh, double factor) {
  mesh.vertices = scaled(mesh.vertices, factor);
  return mesh;
}

inline Mesh moved(Mesh mesh, const Vec3& by) {
  mesh.vertices = moved(mesh.vertices, by);
  return mesh;
}

inline Mesh scaled(const Mesh& mesh, double factor, const Vec3& offset) { return moved(scaled(mesh, factor), offset); }

/// With the products summed in a fixed order, for the same bits everywhere.
inline Mesh turned(Mesh mesh, const Eigen::Matrix3d& rotation) {
  return transformed(std::move(mesh), [&r = rotation](const Vec3& x) {
    Vec3 y;
    for (int k = 0; k < 3; ++k) y[k] = r(k, 0) * x[0] + (r(k, 1) * x[1] + r(k, 2) * x[2]);
    return y;
  });
}

/// All vertices in the line y = z = 0: no facet has an area.
inline Mesh squashed(const Mesh& mesh) {
  return transformed(mesh, [](const Vec3& x) -> Vec3 { return {x.x(), 0, 0}; });
}

/// Each vertex moved by at most `amount` in every coordinate.
inline Mesh shaken(const Mesh& mesh, double amount, Rng& rng) {
  return transformed(mesh, [&](Vec3 x) {
    for (int k = 0; k < 3; ++k) x[k] += amount * (2 * rng.uniform() - 1);
    return x;
  });
}

inline Mesh joined(const Mesh& a, const Mesh& b) {
  const Index n = rows(a.vertices);
  return {joined(a.vertices, b.vertices), joined(a.triangles, renumbered(b.triangles, [n](Index v) { return v + n; }))};
}

inline Mesh with_vertices(Mesh mesh, const std::vector<Vec3>& more) {
  mesh.vertices = joined(mesh.vertices, points_of(more));
  return mesh;
}

inline Mesh with_facets(Mesh mesh, const std::vector<Corners>& more) {
  mesh.triangles = joined(mesh.triangles, triangles_of(more));
  return mesh;
}

/// With one more facet, of vertices of its own.
inline Mesh with_facet(const Mesh& mesh, const Vec3& a, const Vec3& b, const Vec3& c) {
  return joined(mesh, one_triangle(a, b, c));
}

inline Mesh without_facets(Mesh mesh) {
  mesh.triangles = no_triangles();
  return mesh;
}

inline Mesh first_facets(Mesh mesh, Index n) {
  mesh.triangles = head(mesh.triangles, n);
  return mesh;
}

inline Mesh chosen_facets(Mesh mesh, const std::vector<Index>& facets) {
  mesh.triangles = chosen(mesh.triangles, facets);
  return mesh;
}

/// Facets that `choose(f)` picks are turned over.
template <class Choose>
Mesh flipped_where(Mesh mesh, const Choose& choose) {
  for (Index f = 0; f < rows(mesh.triangles); ++f) {
    if (choose(f)) std::swap(mesh.triangles(f, 1), mesh.triangles(f, 2));
  }
  return mesh;
}

inline Mesh with_random_flips(const Mesh& mesh, std::uint64_t seed) {
  Rng rng(seed);
  return flipped_where(mesh, [&rng](Index) { return rng.below(2) == 0; });
}

inline Mesh inside_out(const Mesh& mesh) {
  return flipped_where(mesh, [](Index) { return true; });
}

/// By the divergence theorem: positive iff a closed mesh is oriented outwards.
inline double signed_volume(const Mesh& mesh) {
  const MeshView view(mesh);
  double sum = 0;
  for (Index f = 0; f < view.num_facets(); ++f) sum += view.corner(f, 0).dot(view.corner(f, 1).cross(view.corner(f, 2)));
  return sum / 6;
}

// Shapes.

/// Unconnected triangles of all sizes in the unit cube, some crossing each other.
inline Mesh random_soup(Index n, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<std::array<Vec3, 3>> facets;
  for (Index f = 0; f < n; ++f) {
    const Vec3 centre = random_point(rng);
    const double size = rng.uniform();
    std::array<Vec3, 3> facet;
    for (Vec3& x : facet) x = centre + size * (random_point(rng) - Vec3::Constant(0.5));
    facets.push_back(facet);
  }
  return soup_mesh(facets);
}

/// `n` facets in and around the unit cube: plain, tiny, large, without area — a segment run through once or twice, a point —,
/// some of them twice, and slivers of either kind if wanted.
inline Mesh hard_soup(Index n, Rng& rng, bool slivers = true) {
  std::vector<std::array<Vec3, 3>> facets;
  while (static_cast<Index>(facets.size()) < n) {
    const Vec3 a = random_point(rng), u = random_point(rng) - random_point(rng), v = random_point(rng) - random_point(rng);
    const double small = std::pow(10.0, -1 - 15 * rng.uniform());
    switch (rng.below(slivers ? 8 : 6)) {
      case 0:
        facets.push_back({a, a + 0.2 * u, a + 0.2 * v});
        break;
      case 1:
        facets.push_back({a, a + small * u, a + small * v});
        break;
      case 2:
        facets.push_back({a, a + 2 * u, a + 2 * v});
        break;
      case 3:
        facets.push_back({a, a + u, a});
        break;
      case 4:
        facets.push_back({a, rng.below(2) == 0 ? a : Vec3(a + 0.3 * u), a});
        break;
      case 5:
        if (!facets.empty()) facets.push_back(facets[rng.below(facets.size())]);
        break;
      case 6:
        facets.push_back({a, a + u, a + small * v});
        break;  // a needle
      default:
        facets.push_back({a + u, a, a + rng.uniform() * u + small * v});  // a cap
    }
  }
  return soup_mesh(facets);
}

/// A book of `pages` rectangles around one spine: a non-manifold edge.
inline Mesh open_book(Index pages) {
  std::vector<Vec3> vertices = {{0, 0, 0}, {0, 0, 1}};
  std::vector<Corners> triangles;
  for (Index p = 0; p < pages; ++p) {
    const double angle = 0.3 + 1.1 * p;
    const Index v = static_cast<Index>(vertices.size());
    for (const double z : {0.0, 1.0}) vertices.emplace_back(std::cos(angle), std::sin(angle), z);
    triangles.push_back({0, v, v + 1});
    triangles.push_back({0, v + 1, 1});
  }
  return mesh_of(vertices, triangles);
}

/// Two squares, one above the other at this distance.
inline Mesh two_sheets(double distance, Index cells = 4) {
  return joined(amps::make_square(cells), moved(amps::make_square(cells), {0, 0, distance}));
}

/// One-sided, with one border.
inline Mesh moebius_strip(Index along, Index across) {
  const Points vertices = made_points(along * (across + 1), [&](Index row) {
    const Index i = row / (across + 1), j = row % (across + 1);
    const double t = 2 * kPi * i / along, v = 0.8 * j / across - 0.4;
    return Vec3((1 + v * std::cos(t / 2)) * std::cos(t), (1 + v * std::cos(t / 2)) * std::sin(t), v * std::sin(t / 2));
  });
  // The last column is glued to the first, turned over.
  const auto id = [&](Index i, Index j) { return i < along ? i * (across + 1) + j : across - j; };
  std::vector<Corners> triangles;
  for (Index i = 0; i < along; ++i) {
    for (Index j = 0; j < across; ++j) {
      triangles.push_back({id(i, j), id(i + 1, j), id(i + 1, j + 1)});
      triangles.push_back({id(i, j), id(i + 1, j + 1), id(i, j + 1)});
    }
  }
  return {vertices, triangles_of(triangles)};
}

inline Mesh small_knot() {
  amps::KnotOptions options;
  options.around = 6;
  options.along = 60;
  return amps::make_knot(options);
}

inline std::vector<NamedMesh> small_meshes() {
  return {{"square", amps::make_square(3)},
          {"cube", amps::make_cube(2)},
          {"sphere", amps::make_sphere(180)},
          {"torus", amps::make_torus(1.0, 0.4, 14, 8)},
          {"knot", small_knot()},
          {"soup", random_soup(40, 11)},
          {"book of 5 pages", open_book(5)},
          {"sphere with flipped facets", with_random_flips(amps::make_sphere(180), 12)},
          {"two components", joined(amps::make_sphere(80), amps::make_cube(1))}};
}

}  // namespace amps_test
