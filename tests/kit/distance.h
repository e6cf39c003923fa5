// distance.h: the distance of a point to triangles, by plain geometry in long double over all of them: an oracle that shares
// nothing with the library's tree.
#pragma once

#include "basics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace amps_test {

using Exact3 = std::array<Real, 3>;

inline Exact3 exact3(const Vec3& x) { return {x[0], x[1], x[2]}; }
inline Exact3 minus(const Exact3& a, const Exact3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Real dot(const Exact3& a, const Exact3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline Exact3 cross(const Exact3& a, const Exact3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline Real segment_distance(const Exact3& x, const Exact3& a, const Exact3& b) {
  const Exact3 ab = minus(b, a), ax = minus(x, a);
  const Real square = dot(ab, ab);
  const Real t = square > 0 ? std::clamp(dot(ax, ab) / square, Real(0), Real(1)) : Real(0);
  const Exact3 rest = {ax[0] - t * ab[0], ax[1] - t * ab[1], ax[2] - t * ab[2]};
  return std::sqrt(dot(rest, rest));
}

/// Above the inside of the triangle, the distance to its plane; anywhere, at most the distance to its sides.
inline Real triangle_distance(const Exact3& x, const Exact3& a, const Exact3& b, const Exact3& c) {
  Real least = std::min({segment_distance(x, a, b), segment_distance(x, b, c), segment_distance(x, c, a)});
  const Exact3 n = cross(minus(b, a), minus(c, a));
  const Real length = std::sqrt(dot(n, n));
  if (!(length > 0)) return least;
  const auto inside = [&](const Exact3& p, const Exact3& q) { return dot(cross(minus(q, p), minus(x, p)), n) >= 0; };
  if (inside(a, b) && inside(b, c) && inside(c, a)) least = std::min(least, std::abs(dot(minus(x, a), n)) / length);
  return least;
}

inline Real facet_distance(const MeshView& mesh, Index f, const Vec3& x) {
  return triangle_distance(exact3(x), exact3(mesh.corner(f, 0)), exact3(mesh.corner(f, 1)), exact3(mesh.corner(f, 2)));
}

inline Real brute_distance(const MeshView& mesh, const Vec3& x) {
  Real least = std::numeric_limits<Real>::infinity();
  for (Index f = 0; f < mesh.num_facets(); ++f) least = std::min(least, facet_distance(mesh, f, x));
  return least;
}

}  // namespace amps_test
