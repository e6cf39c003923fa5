#define AMPS_OWN_SOURCE
#include "amps/shapes.h"

#include "amps/portable_math.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

namespace amps {
namespace {

void require_shape(bool condition, const char* what) {
  if (!condition) throw Error(ErrorCode::kInvalidArgument, std::string("amps: ") + what);
}

bool positive_finite(double x) { return x > 0 && x <= std::numeric_limits<double>::max(); }

// Facets outnumber vertices in every shape here but the smallest squares, so theirs is the count to check.
Mesh empty_shape(std::int64_t vertices, std::int64_t facets) {
  constexpr std::int64_t limit = std::numeric_limits<Index>::max();
  if (vertices > limit || facets > limit) {
    throw Error(ErrorCode::kTooLarge, "amps: a shape of " + std::to_string(facets) +
                                          " facets is more than a 32-bit index counts; ask for fewer cells");
  }
  Mesh mesh;
  mesh.vertices.resize(static_cast<std::ptrdiff_t>(vertices), 3);
  mesh.triangles.resize(static_cast<std::ptrdiff_t>(facets), 3);
  return mesh;
}

// Two triangles of the cell with corners a, b, c, d counter-clockwise; returns the next free facet.
std::ptrdiff_t put_cell(Mesh& mesh, std::ptrdiff_t facet, const std::array<Index, 4>& corner) {
  mesh.triangles.row(facet) << corner[0], corner[1], corner[2];
  mesh.triangles.row(facet + 1) << corner[0], corner[2], corner[3];
  return facet + 2;
}

// A grid of nu × nv vertices, closed in both directions, oriented by (u, v).
void put_closed_grid(Mesh& mesh, Index nu, Index nv) {
  std::ptrdiff_t facet = 0;
  for (Index u = 0; u < nu; ++u) {
    const Index next_u = (u + 1) % nu;
    for (Index v = 0; v < nv; ++v) {
      const Index next_v = (v + 1) % nv;
      facet = put_cell(mesh, facet, {u * nv + v, next_u * nv + v, next_u * nv + next_v, u * nv + next_v});
    }
  }
}

// Numbers the points (i, j, k) of the lattice {0..n}³ that lie on the surface of the cube: the bottom layer, the rings, the
// top.
Index cube_surface_vertex(Index n, Index i, Index j, Index k) {
  const Index layer = (n + 1) * (n + 1);
  if (k == 0) return j * (n + 1) + i;
  if (k == n) return layer + (n - 1) * 4 * n + j * (n + 1) + i;
  Index ring = 0;
  if (j == 0 && i < n) {
    ring = i;
  } else if (i == n && j < n) {
    ring = n + j;
  } else if (j == n && i > 0) {
    ring = 3 * n - i;
  } else {
    ring = 4 * n - j;
  }
  return layer + (k - 1) * 4 * n + ring;
}

// The icosahedron with every facet cut into n² and its vertices numbered: corners, then edges, then insides.
struct IcosahedronGrid {
  static constexpr Index kCorners = 12, kEdges = 30, kFacets = 20;
  std::array<Vec3, 12> corner;
  std::array<std::array<Index, 3>, 20> facet;
  std::array<std::array<Index, 12>, 12> edge{};  // [lower corner][higher corner] → 0..29
  Index n;

  explicit IcosahedronGrid(Index cuts) : n(cuts) {
    const double phi = 0.5 * (1.0 + std::sqrt(5.0));
    // Corner 4a + 2s + t is ±1 along axis a + 1 and ±φ along axis a + 2 (mod 3).
    for (std::size_t c = 0; c < 12; ++c) {
      const auto axis = static_cast<std::ptrdiff_t>(c / 4);
      corner[c] = Vec3::Zero();
      corner[c]((axis + 1) % 3) = (c & 2) != 0 ? 1.0 : -1.0;
      corner[c]((axis + 2) % 3) = (c & 1) != 0 ? phi : -phi;
    }
    // Corners at distance 2 are joined; every triangle of joined corners is a facet.
    const auto joined = [&](std::size_t a, std::size_t b) { return detail::squared_norm(corner[a] - corner[b]) < 5.0; };
    std::size_t facets = 0;
    Index edges = 0;
    for (std::size_t a = 0; a < 12; ++a) {
      for (std::size_t b = a + 1; b < 12; ++b) {
        if (!joined(a, b)) continue;
        edge[a][b] = edges++;
        for (std::size_t c = b + 1; c < 12; ++c) {
          if (!joined(a, c) || !joined(b, c)) continue;
          const bool outward = detail::dot((corner[b] - corner[a]).cross(corner[c] - corner[a]), corner[a]) > 0;
          facet[facets++] = {static_cast<Index>(a), static_cast<Index>(outward ? b : c), static_cast<Index>(outward ? c : b)};
        }
      }
    }
  }

  const Vec3& at(Index c) const { return corner[static_cast<std::size_t>(c)]; }

  Index edge_vertex(Index from, Index to, Index step) const {
    if (from > to) return edge_vertex(to, from, n - step);
    return kCorners + edge[static_cast<std::size_t>(from)][static_cast<std::size_t>(to)] * (n - 1) + step - 1;
  }

  // The point (n−i−j, i, j)/n of facet f.
  Index vertex(Index f, Index i, Index j) const {
    const std::array<Index, 3>& c = facet[static_cast<std::size_t>(f)];
    if (i == n) return c[1];
    if (j == n) return c[2];
    if (i + j == 0) return c[0];
    if (j == 0) return edge_vertex(c[0], c[1], i);
    if (i == 0) return edge_vertex(c[0], c[2], j);
    if (i + j == n) return edge_vertex(c[1], c[2], j);
    // Rows j = 1, 2, … hold n−2, n−3, … inner points.
    const Index before = (j - 1) * (n - 2) - (j - 1) * (j - 2) / 2;
    return kCorners + kEdges * (n - 1) + f * ((n - 1) * (n - 2) / 2) + before + i - 1;
  }
};

struct KnotCurve {
  double p, q, major, minor;

  Vec3 point(double t) const {
    const auto along = detail::portable_sine_cosine(p * t), around = detail::portable_sine_cosine(q * t);
    const double w = major + minor * around.cosine;
    return {w * along.cosine, w * along.sine, minor * around.sine};
  }
  // Normal of the torus the knot lies on: perpendicular to the knot and periodic, so a frame that closes without a twist.
  Vec3 normal(double t) const {
    const auto along = detail::portable_sine_cosine(p * t), around = detail::portable_sine_cosine(q * t);
    return {around.cosine * along.cosine, around.cosine * along.sine, around.sine};
  }
  Vec3 derivative(double t) const {
    const auto along = detail::portable_sine_cosine(p * t), around = detail::portable_sine_cosine(q * t);
    const double w = major + minor * around.cosine;
    const double dw = -minor * q * around.sine;
    return {dw * along.cosine - w * p * along.sine, dw * along.sine + w * p * along.cosine, minor * q * around.cosine};
  }
};

struct KnotMeasure {
  double reach = std::numeric_limits<double>::infinity();
  double length = 0;
};

// Reach of the curve: the minimum of |b−a|² / (2 · distance of b from the tangent line at a) over pairs of points (Federer
// 1959, theorem 4.18). It bounds both the curvature (b → a) and the distance to other strands, hence is what a tube has to stay
// under.
KnotMeasure measure_knot(const KnotCurve& curve, int samples) {
  const auto n = static_cast<std::size_t>(samples);
  std::vector<Vec3> points(n), tangents(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double t = 2.0 * detail::kPi * static_cast<double>(i) / samples;
    points[i] = curve.point(t);
    tangents[i] = detail::normalized(curve.derivative(t));
  }
  KnotMeasure measure;
  for (std::size_t i = 0; i < n; ++i) {
    measure.length += detail::norm(points[(i + 1) % n] - points[i]);
    for (std::size_t j = 0; j < n; ++j) {
      if (i == j) continue;
      const Vec3 chord = points[j] - points[i];
      measure.reach = std::min(measure.reach, detail::squared_norm(chord) / (2.0 * detail::norm(chord.cross(tangents[i]))));
    }
  }
  return measure;
}

}  // namespace

Mesh make_square(Index n) {
  require_shape(n >= 1, "a square needs at least 1 cell a side");
  const std::int64_t cells = n;
  Mesh mesh = empty_shape((cells + 1) * (cells + 1), 2 * cells * cells);
  for (Index j = 0; j <= n; ++j) {
    for (Index i = 0; i <= n; ++i) {
      mesh.vertices.row(j * (n + 1) + i) << static_cast<double>(i) / n, static_cast<double>(j) / n, 0.0;
    }
  }
  std::ptrdiff_t facet = 0;
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < n; ++i) {
      const Index a = j * (n + 1) + i;
      facet = put_cell(mesh, facet, {a, a + 1, a + n + 2, a + n + 1});
    }
  }
  return mesh;
}

Mesh make_cube(Index n) {
  require_shape(n >= 1, "a cube needs at least 1 cell a side");
  const std::int64_t cells = n;
  Mesh mesh = empty_shape(6 * cells * cells + 2, 12 * cells * cells);
  std::ptrdiff_t facet = 0;
  // The two sides across each axis; (u, v, axis) is right-handed, so u before v faces up the axis.
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const Index level : {Index{0}, n}) {
      const auto vertex = [&](Index u, Index v) {
        std::array<Index, 3> at{};
        at[axis] = level;
        at[(axis + 1) % 3] = level == 0 ? v : u;
        at[(axis + 2) % 3] = level == 0 ? u : v;
        const Index index = cube_surface_vertex(n, at[0], at[1], at[2]);
        for (std::size_t k = 0; k < 3; ++k)
          mesh.vertices(index, static_cast<std::ptrdiff_t>(k)) = static_cast<double>(at[k]) / n;
        return index;
      };
      for (Index v = 0; v < n; ++v) {
        for (Index u = 0; u < n; ++u) {
          facet = put_cell(mesh, facet, {vertex(u, v), vertex(u + 1, v), vertex(u + 1, v + 1), vertex(u, v + 1)});
        }
      }
    }
  }
  return mesh;
}

Mesh make_sphere(Index facets, double radius) { return make_ellipsoid(facets, Vec3::Constant(radius)); }

Mesh make_ellipsoid(Index facets, const Vec3& semi_axes) {
  require_shape(facets >= 1, "a sphere needs a positive number of facets");
  for (int k = 0; k < 3; ++k) require_shape(positive_finite(semi_axes(k)), "a sphere needs positive, finite radii");
  const Index n = std::max(Index{1}, static_cast<Index>(std::lround(std::sqrt(facets / 20.0))));
  const std::int64_t cuts = n;
  Mesh mesh = empty_shape(10 * cuts * cuts + 2, 20 * cuts * cuts);
  const IcosahedronGrid grid(n);
  std::ptrdiff_t facet = 0;
  for (Index f = 0; f < IcosahedronGrid::kFacets; ++f) {
    const std::array<Index, 3>& c = grid.facet[static_cast<std::size_t>(f)];
    for (Index j = 0; j <= n; ++j) {
      for (Index i = 0; i + j <= n; ++i) {
        // Points of an edge are computed once for each of its facets, with the same value up to rounding; the last one stays.
        const Vec3 flat = (n - i - j) * grid.at(c[0]) + i * grid.at(c[1]) + j * grid.at(c[2]);
        mesh.vertices.row(grid.vertex(f, i, j)) = detail::normalized(flat).cwiseProduct(semi_axes).transpose();
        if (i + j == n) continue;
        mesh.triangles.row(facet++) << grid.vertex(f, i, j), grid.vertex(f, i + 1, j), grid.vertex(f, i, j + 1);
        if (i + j == n - 1) continue;
        mesh.triangles.row(facet++) << grid.vertex(f, i + 1, j), grid.vertex(f, i + 1, j + 1), grid.vertex(f, i, j + 1);
      }
    }
  }
  return mesh;
}

Mesh make_torus(double major, double minor, Index nu, Index nv) {
  require_shape(positive_finite(major) && positive_finite(minor) && minor < major, "a torus needs 0 < minor < major radius");
  require_shape(nu >= 3 && nv >= 3, "a torus needs at least 3 cells in each direction");
  const std::int64_t cells = static_cast<std::int64_t>(nu) * nv;
  Mesh mesh = empty_shape(cells, 2 * cells);
  for (Index u = 0; u < nu; ++u) {
    const auto along = detail::portable_sine_cosine(2.0 * detail::kPi * u / nu);
    for (Index v = 0; v < nv; ++v) {
      const auto around = detail::portable_sine_cosine(2.0 * detail::kPi * v / nv);
      const double w = major + minor * around.cosine;
      mesh.vertices.row(u * nv + v) << w * along.cosine, w * along.sine, minor * around.sine;
    }
  }
  put_closed_grid(mesh, nu, nv);
  return mesh;
}

Mesh make_knot(const KnotOptions& options) {
  require_shape(options.p >= 1 && options.q >= 1 && std::gcd(options.p, options.q) == 1,
                "a torus knot needs p, q >= 1 without a common divisor");
  require_shape(options.p <= 64 && options.q <= 64, "a torus knot needs p, q <= 64");
  require_shape(positive_finite(options.major) && positive_finite(options.minor) && options.minor < options.major,
                "a torus knot needs 0 < minor < major");
  require_shape(options.around >= 3, "a knot needs at least 3 cells around");
  // 128 samples a turn find the reach to well under 1 %.
  const KnotCurve curve{static_cast<double>(options.p), static_cast<double>(options.q), options.major, options.minor};
  const KnotMeasure measure = measure_knot(curve, 128 * std::max(options.p, options.q));
  const double tube = options.tube == 0 ? 0.7 * measure.reach : options.tube;
  require_shape(positive_finite(tube) && tube <= 0.9 * measure.reach, "the knot's tube must be > 0 and under 0.9 of its reach");
  const Index min_along = 8 * (options.p + options.q);
  const double square_along = measure.length / (2.0 * detail::kPi * tube) * options.around;
  if (options.along == 0 && square_along > std::numeric_limits<Index>::max()) {
    throw Error(ErrorCode::kTooLarge, "amps: a knot with that many cells is more than a 32-bit index counts; ask for fewer");
  }
  const Index nu = options.along == 0 ? std::max(min_along, static_cast<Index>(square_along)) : options.along;
  require_shape(nu >= min_along, "a knot needs at least 8(p + q) cells along");
  const Index nv = options.around;
  const std::int64_t cells = static_cast<std::int64_t>(nu) * nv;
  Mesh mesh = empty_shape(cells, 2 * cells);
  for (Index u = 0; u < nu; ++u) {
    const double t = 2.0 * detail::kPi * u / nu;
    const Vec3 center = curve.point(t), normal = curve.normal(t);
    const Vec3 binormal = normal.cross(detail::normalized(curve.derivative(t)));
    for (Index v = 0; v < nv; ++v) {
      const auto around = detail::portable_sine_cosine(2.0 * detail::kPi * v / nv);
      mesh.vertices.row(u * nv + v) = (center + tube * (around.cosine * normal + around.sine * binormal)).transpose();
    }
  }
  put_closed_grid(mesh, nu, nv);
  return mesh;
}

}  // namespace amps
