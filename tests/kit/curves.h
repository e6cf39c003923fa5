// curves.h: surfaces with curves of every kind, and their curves as tests find them.
#pragma once

#include "basics.h"
#include "meshes.h"
#include "models.h"
#include "samples.h"

#include "amps/curves.h"
#include "amps/mesh_edges.h"
#include "amps/remesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <set>
#include <string>
#include <vector>

namespace amps_test {

using amps::CurveGraph;
using amps::CurveOptions;
using amps::RemeshOptions;
using amps::SurfacePoint;
using amps::detail::SurfaceEdges;

using Pair = std::array<Index, 2>;
using Polygon = std::vector<Vec3>;

inline Pair sorted_pair(Index a, Index b) { return {std::min(a, b), std::max(a, b)}; }

/// A convex polygon of the plane z = 0, between 0 and `height`, with lids if these are wanted.
inline Mesh prism(const Polygon& polygon, double height, const Vec3& inside, bool lids = true) {
  const auto n = static_cast<Index>(polygon.size());
  std::vector<Vec3> vertices = polygon;
  for (const Vec3& v : polygon) vertices.emplace_back(v.x(), v.y(), height);
  if (lids) {
    vertices.push_back(inside);
    vertices.emplace_back(inside.x(), inside.y(), height);
  }
  std::vector<Corners> triangles;
  for (Index k = 0; k < n; ++k) {
    const Index next = (k + 1) % n;
    triangles.push_back({k, next, n + next});
    triangles.push_back({k, n + next, n + k});
    if (!lids) continue;
    triangles.push_back({next, k, 2 * n});
    triangles.push_back({n + k, n + next, 2 * n + 1});
  }
  return mesh_of(vertices, triangles);
}

inline Polygon regular(Index n) {
  Polygon result;
  for (Index k = 0; k < n; ++k) result.emplace_back(std::cos(2 * kPi * k / n), std::sin(2 * kPi * k / n), 0);
  return result;
}

inline Mesh wedge(double degrees) {
  const double half = degrees / 2 * kDegree, x = std::cos(half), y = std::sin(half);
  return prism({{0, 0, 0}, {x, -y, 0}, {x, y, 0}}, 1, {x / 2, 0, 0});
}

/// A U: two walls with a narrow gap between them. The lids are no fans, as no point sees them whole.
inline Mesh channel(double gap) {
  const double w = 0.3, h = 1, floor = 0.3, wide = 2 * w + gap;
  const Polygon outline = {{0, 0, 0},           {wide, 0, 0},  {wide, h, 0}, {w + gap, h, 0},
                           {w + gap, floor, 0}, {w, floor, 0}, {w, h, 0},    {0, h, 0}};
  const Mesh walls = prism(outline, 1, Vec3::Zero(), false);
  std::vector<Corners> lids = {{0, 5, 7}, {5, 6, 7}, {0, 4, 5}, {0, 1, 4}, {1, 2, 4}, {2, 3, 4}};
  const std::size_t n = lids.size();
  for (std::size_t k = 0; k < n; ++k) {
    const Corners t = lids[k];
    lids.push_back({t[0] + 8, t[1] + 8, t[2] + 8});
    lids[k] = {t[0], t[2], t[1]};
  }
  return with_facets(walls, lids);
}

inline Mesh hemisphere(Index facets) {
  const Mesh sphere = amps::make_sphere(facets);
  std::vector<Index> upper;
  for (Index f = 0; f < rows(sphere.triangles); ++f) {
    Vec3 sum = Vec3::Zero();
    for (int k = 0; k < 3; ++k) sum += MeshView(sphere).corner(f, k);
    if (sum.z() > 0) upper.push_back(f);
  }
  return chosen_facets(sphere, upper);
}

inline Mesh square_with_hole() {
  const Mesh square = amps::make_square(6);
  std::vector<Index> kept;
  for (Index f = 0; f < rows(square.triangles); ++f) {
    Vec3 sum = Vec3::Zero();
    for (int k = 0; k < 3; ++k) sum += MeshView(square).corner(f, k) / 3;
    if ((sum - Vec3(0.5, 0.5, 0)).cwiseAbs().maxCoeff() > 1.0 / 6) kept.push_back(f);
  }
  return chosen_facets(square, kept);
}

/// A thick-walled one between z = 0 and 1, from radius 1 to 2: its inner creases bulge into the lids.
inline Mesh pipe(Index around) {
  std::vector<Vec3> vertices;
  for (const double z : {0.0, 1.0}) {
    for (const double radius : {1.0, 2.0}) {
      for (const Vec3& v : regular(around)) vertices.emplace_back(radius * v.x(), radius * v.y(), z);
    }
  }
  std::vector<Corners> triangles;
  for (const Corners& ring : {Corners{0, 2, 0}, Corners{2, 3, 0}, Corners{3, 1, 0}, Corners{1, 0, 0}}) {
    for (Index k = 0; k < around; ++k) {
      const Index next = (k + 1) % around, a = ring[0] * around, b = ring[1] * around;
      triangles.push_back({a + k, b + k, b + next});
      triangles.push_back({a + k, b + next, a + next});
    }
  }
  return mesh_of(vertices, triangles);
}

inline Mesh plate(double thickness) {
  return transformed(amps::make_cube(1), [&](const Vec3& x) { return Vec3(x.x(), x.y(), thickness * x.z()); });
}

struct Shape {
  std::string name;
  Mesh mesh;
  double radius;
  bool straight = true;  ///< are all of its curves?
};

inline std::vector<Shape> shapes() {
  return {{"cube", amps::make_cube(1), 0.1},
          {"refined cube", amps::make_cube(6), 0.08},
          {"thin plate", plate(0.01), 0.06},
          {"wedge of 15 degrees", wedge(15), 0.08},
          {"channel", channel(0.02), 0.09},
          {"prism of six sides", prism(regular(6), 1, Vec3::Zero()), 0.15},
          {"cylinder with lids", prism(regular(48), 1, Vec3::Zero()), 0.15, false},
          {"pipe", pipe(48), 0.12, false},
          {"hemisphere", hemisphere(1280), 0.12, false},
          {"moebius strip", moebius_strip(48, 4), 0.12, false},
          {"three sheets", open_book(3), 0.1},
          {"two boxes", joined(amps::make_cube(1), moved(amps::make_cube(2), {1.01, 0.1, 0.2})), 0.12},
          {"square with hole", square_with_hole(), 0.06}};
}

inline RemeshOptions options_of(const Shape& shape, bool optimize, std::uint64_t seed = 1) {
  RemeshOptions options = plain(with_radius(shape.radius, seed));
  options.optimize = optimize;
  return options;
}

/// The curves of an input as the test finds them, and what lies on them.
struct Input {
  Mesh mesh;
  SurfaceEdges edges;
  CurveGraph graph;

  Input(const Mesh& of, double radius, CurveOptions options = {}) : mesh(of), edges(mesh) {
    if (options.sizing.empty()) options.radius = radius;
    graph = amps::find_curves(mesh, options);
  }
  Vec3 vertex(Index v) const { return point_at(mesh.vertices, v); }
  double length(std::size_t e) const { return (vertex(edges[e].high) - vertex(edges[e].low)).norm(); }
  double diagonal() const { return amps::bounding_box(mesh).diagonal(); }

  /// The curves that a point lies on, by its coordinates that are 0.
  std::set<Index> curves_at(const SurfacePoint& x) const {
    std::set<Index> result;
    int zeros = 0;
    for (int k = 0; k < 3; ++k) zeros += x.barycentric[k] == 0 ? 1 : 0;
    if (!edges.counts(x.facet)) return result;
    if (zeros == 2) {
      Index v = kNone;
      for (int k = 0; k < 3; ++k) {
        if (x.barycentric[k] != 0) v = edges.triangles()(x.facet, k);
      }
      for (std::size_t e = 0; e < edges.size(); ++e) {
        if ((edges[e].low == v || edges[e].high == v) && graph.curve_of_edge[e] != kNone) result.insert(graph.curve_of_edge[e]);
      }
    }
    if (zeros == 1) {
      for (int k = 0; k < 3; ++k) {
        if (x.barycentric[(k + 2) % 3] == 0) {
          const Index curve = graph.curve_of_edge[edges.edge(x.facet, k)];
          if (curve != kNone) result.insert(curve);
        }
      }
    }
    return result;
  }
  double distance_to_curves(const Vec3& x) const {
    double result = kInfinity;
    for (std::size_t e = 0; e < edges.size(); ++e) {
      if (!graph.is_curve_edge[e]) continue;
      const Vec3 a = vertex(edges[e].low), d = vertex(edges[e].high) - a;
      const double t = std::clamp((x - a).dot(d) / d.squaredNorm(), 0.0, 1.0);
      result = std::min(result, (a + t * d - x).norm());
    }
    return result;
  }
};

}  // namespace amps_test
