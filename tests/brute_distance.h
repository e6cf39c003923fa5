// brute_distance.h: the distance of a point to triangles, by plain geometry in long double over all of them: an oracle that
// shares nothing with the library's tree. And soups that are hard on it.
#pragma once

#include "amps/mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace amps_test {

using Exact3 = std::array<long double, 3>;

inline Exact3 exact3(const amps::Vec3& x) { return {x[0], x[1], x[2]}; }
inline Exact3 minus(const Exact3& a, const Exact3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline long double dot(const Exact3& a, const Exact3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline Exact3 cross(const Exact3& a, const Exact3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline long double segment_distance(const Exact3& x, const Exact3& a, const Exact3& b) {
  const Exact3 ab = minus(b, a), ax = minus(x, a);
  const long double square = dot(ab, ab);
  const long double t = square > 0 ? std::clamp(dot(ax, ab) / square, 0.0L, 1.0L) : 0.0L;
  const Exact3 rest = {ax[0] - t * ab[0], ax[1] - t * ab[1], ax[2] - t * ab[2]};
  return std::sqrt(dot(rest, rest));
}

/// Above the inside of the triangle, the distance to its plane; anywhere, at most the distance to its sides.
inline long double triangle_distance(const Exact3& x, const Exact3& a, const Exact3& b, const Exact3& c) {
  long double least = std::min({segment_distance(x, a, b), segment_distance(x, b, c), segment_distance(x, c, a)});
  const Exact3 n = cross(minus(b, a), minus(c, a));
  const long double length = std::sqrt(dot(n, n));
  if (!(length > 0)) return least;
  const auto inside = [&](const Exact3& p, const Exact3& q) { return dot(cross(minus(q, p), minus(x, p)), n) >= 0; };
  if (inside(a, b) && inside(b, c) && inside(c, a)) least = std::min(least, std::abs(dot(minus(x, a), n)) / length);
  return least;
}

inline long double facet_distance(const amps::MeshView& mesh, amps::Index f, const amps::Vec3& x) {
  return triangle_distance(exact3(x), exact3(mesh.corner(f, 0)), exact3(mesh.corner(f, 1)), exact3(mesh.corner(f, 2)));
}

inline long double brute_distance(const amps::MeshView& mesh, const amps::Vec3& x) {
  long double least = std::numeric_limits<long double>::infinity();
  for (amps::Index f = 0; f < mesh.num_facets(); ++f) least = std::min(least, facet_distance(mesh, f, x));
  return least;
}

inline amps::Vec3 random_point(amps::Rng& rng) { return {rng.uniform(), rng.uniform(), rng.uniform()}; }

/// A mesh of its own three vertices per facet.
inline amps::Mesh soup_mesh(const std::vector<std::array<amps::Vec3, 3>>& facets) {
  amps::Mesh mesh{amps::Points(3 * facets.size(), 3), amps::Triangles(facets.size(), 3)};
  for (std::size_t f = 0; f < facets.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      mesh.vertices.row(static_cast<amps::Index>(3 * f + k)) = facets[f][k].transpose();
      mesh.triangles(static_cast<amps::Index>(f), static_cast<int>(k)) = static_cast<amps::Index>(3 * f + k);
    }
  }
  return mesh;
}

/// `n` facets in and around the unit cube: plain, tiny, large, without area — a segment run through once or twice, a point —,
/// some of them twice, and slivers of either kind if wanted.
inline amps::Mesh hard_soup(amps::Index n, amps::Rng& rng, bool slivers = true) {
  std::vector<std::array<amps::Vec3, 3>> facets;
  while (static_cast<amps::Index>(facets.size()) < n) {
    const amps::Vec3 a = random_point(rng), u = random_point(rng) - random_point(rng),
                     v = random_point(rng) - random_point(rng);
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
        facets.push_back({a, rng.below(2) == 0 ? a : amps::Vec3(a + 0.3 * u), a});
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

}  // namespace amps_test
