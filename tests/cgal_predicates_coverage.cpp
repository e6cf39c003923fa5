// The sign of the power at symbolic vertices against exact rationals (GMP through CGAL), near zero and on it.
#include "amps/power_diagram_clipper.h"
#include "amps/predicates.h"

#include <CGAL/Gmpq.h>

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <limits>

using amps::Bisector;
using amps::Rng;
using amps::Stage;
using amps::StageTally;
using amps::Vec3;
using amps::WeightedPoint;
using CGAL::Gmpq;

namespace {

int sign(const Gmpq& x) { return static_cast<int>(CGAL::sign(x)); }

using RationalVector = std::array<Gmpq, 3>;

/// x − p
RationalVector difference(const double* x, const WeightedPoint& p) {
  return {Gmpq(x[0]) - Gmpq(p.x), Gmpq(x[1]) - Gmpq(p.y), Gmpq(x[2]) - Gmpq(p.z)};
}
RationalVector difference(const WeightedPoint& q, const WeightedPoint& p) { return difference(&q.x, p); }
Gmpq dot(const RationalVector& a, const RationalVector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
RationalVector cross(const RationalVector& a, const RationalVector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

/// A power, if the vertex exists.
struct MaybePower {
  bool exists = false;
  Gmpq power;
};

/// The bisector (i, j) relative to p_i: the plane of all y with normal·y = offset.
struct RationalPlane {
  RationalVector normal;
  Gmpq offset;
  RationalPlane(const WeightedPoint& i, const WeightedPoint& j) : normal(difference(j, i)) {
    offset = (dot(normal, normal) + Gmpq(i.w) - Gmpq(j.w)) / 2;
  }
  RationalPlane(const WeightedPoint& i, const double* const c[3]) {
    const RationalVector a = difference(c[0], i), b = difference(c[1], i), d = difference(c[2], i);
    normal = cross({b[0] - a[0], b[1] - a[1], b[2] - a[2]}, {d[0] - a[0], d[1] - a[1], d[2] - a[2]});
    offset = dot(normal, a);
  }
};

/// Power of i at the common point of facet plane and bisectors, by Cramer's rule on the three planes.
MaybePower rational_facet_power(const WeightedPoint& i, const WeightedPoint& j, const WeightedPoint& l,
                                const double* const c[3]) {
  const RationalPlane a(i, j), b(i, l), f(i, c);
  const RationalVector ab = cross(a.normal, b.normal), bf = cross(b.normal, f.normal), fa = cross(f.normal, a.normal);
  const Gmpq determinant = dot(ab, f.normal);
  if (sign(determinant) == 0) return {};
  RationalVector y;
  for (std::size_t k = 0; k < 3; ++k) y[k] = (a.offset * bf[k] + b.offset * fa[k] + f.offset * ab[k]) / determinant;
  return {true, dot(y, y) - Gmpq(i.w)};
}

/// Power of i where the line through u and v meets bisector (i, j).
MaybePower rational_edge_power(const WeightedPoint& i, const WeightedPoint& j, const double* u, const double* v) {
  const RationalPlane plane(i, j);
  const RationalVector a = difference(u, i), b = difference(v, i);
  const Gmpq slope = dot(plane.normal, b) - dot(plane.normal, a);
  if (sign(slope) == 0) return {};
  const Gmpq t = (plane.offset - dot(plane.normal, a)) / slope;
  RationalVector y;
  for (std::size_t k = 0; k < 3; ++k) y[k] = a[k] + t * (b[k] - a[k]);
  return {true, dot(y, y) - Gmpq(i.w)};
}

Gmpq rational_corner_power(const WeightedPoint& i, const double* x) {
  const RationalVector y = difference(x, i);
  return dot(y, y) - Gmpq(i.w);
}

double some_ulps(Rng& rng, double x) {
  switch (rng.below(4)) {
    case 0:
      return std::nextafter(x, INFINITY);
    case 1:
      return std::nextafter(x, -INFINITY);
    default:
      return x;
  }
}

enum class Kind {
  kRandom,
  kLattice,
  kFlat,        ///< the third coordinate far smaller than the others
  kOffset,      ///< far from the origin
  kMagnitudes,  ///< each coordinate of another one
  kTiny,        ///< multiples of the smallest denormal
  kNarrowEdge,  ///< the greatest and smallest numbers of each width of integers
  kMiddleEdge,
  kWideEdge
};
constexpr Kind kAllKinds[] = {Kind::kRandom, Kind::kLattice,    Kind::kFlat,       Kind::kOffset,  Kind::kMagnitudes,
                              Kind::kTiny,   Kind::kNarrowEdge, Kind::kMiddleEdge, Kind::kWideEdge};

double plus_or_minus(Rng& rng, double x) { return rng.below(2) == 0 ? x : -x; }

/// Numbers that need all `bits`, or few of them. Some are smaller, so that the weight that makes a power 0 fits the width too.
double extreme(Rng& rng, int bits) {
  switch (rng.below(4)) {
    case 0:
      return plus_or_minus(rng, double(rng.below(4)));
    case 1:
      return plus_or_minus(rng, std::ldexp(1.0, bits - 1));
    default:
      return plus_or_minus(rng, std::ldexp(0x1p53 - double(1 + rng.below(2)), bits - 53 - static_cast<int>(rng.below(3))));
  }
}

double coordinate(Rng& rng, Kind kind, int axis) {
  switch (kind) {
    case Kind::kLattice:
      return double(rng.below(9)) / 8;
    case Kind::kFlat:
      return axis == 2 ? rng.uniform() * 0x1p-70 : rng.uniform();
    case Kind::kOffset:
      return 1e8 + rng.uniform();
    case Kind::kMagnitudes:
      return (rng.uniform() - 0.5) * std::pow(10.0, double(rng.below(301)) - 150);
    case Kind::kTiny:
      return double(rng.below(9)) * std::numeric_limits<double>::denorm_min();
    case Kind::kNarrowEdge:
      return extreme(rng, amps::detail::usable_bits(1));
    case Kind::kMiddleEdge:
      return extreme(rng, amps::detail::usable_bits(2));
    case Kind::kWideEdge:
      return rng.below(3) == 0 ? plus_or_minus(rng, double(rng.below(4)) * std::numeric_limits<double>::denorm_min())
                               : plus_or_minus(rng, DBL_MAX);
    default:
      return rng.uniform();
  }
}

struct Configuration {
  std::array<WeightedPoint, 3> site;
  std::array<std::array<double, 3>, 3> corner;
  const double* pointers[3] = {corner[0].data(), corner[1].data(), corner[2].data()};
  Configuration() = default;
  Configuration(const Configuration&) = delete;

  void randomize(Rng& rng, Kind kind) {
    const auto distinct = [this] {
      return !amps::same_position(site[0], site[1]) && !amps::same_position(site[1], site[2]) &&
             !amps::same_position(site[0], site[2]);
    };
    do {
      for (WeightedPoint& p : site) {
        p = {coordinate(rng, kind, 0), coordinate(rng, kind, 1), coordinate(rng, kind, 2), 0};
        if (kind == Kind::kRandom || kind == Kind::kOffset) p.w = 0.1 * rng.uniform();
      }
    } while (!distinct());
    for (auto& x : corner) x = {coordinate(rng, kind, 0), coordinate(rng, kind, 1), coordinate(rng, kind, 2)};
  }

  /// Takes the power at a vertex off or onto all weights, so that it becomes 0 up to rounding.
  void bring_to_zero(Rng& rng, const Gmpq& power) {
    for (WeightedPoint& p : site) {
      const double w = CGAL::to_double(Gmpq(p.w) + power);
      if (std::isfinite(w)) p.w = some_ulps(rng, w);
    }
  }
};

struct Count {
  int compared = 0, wrong = 0, zeros = 0;
  void compare(int computed, int expected) {
    ++compared;
    wrong += computed != expected;
    zeros += expected == 0;
  }
};

struct Counts {
  Count corner, edge, facet;
  StageTally corner_stages, edge_stages, facet_stages;
};

/// All owners, edges, and orders of arguments.
void compare_all(const Configuration& c, Counts& counts) {
  const double* const* q = c.pointers;
  for (std::size_t i = 0; i < 3; ++i) {
    const WeightedPoint &owner = c.site[i], &second = c.site[(i + 1) % 3], &third = c.site[(i + 2) % 3];
    for (int v = 0; v < 3; ++v) {
      counts.corner.compare(amps::power_at_corner(q, v, owner, &counts.corner_stages),
                            sign(rational_corner_power(owner, q[v])));
    }
    const Bisector j(owner, second, q), l(owner, third, q), reverse(second, owner, q);
    for (int u = 0; u < 3; ++u) {
      const int v = (u + 1) % 3;
      const MaybePower at = rational_edge_power(owner, second, q[u], q[v]);
      if (!at.exists) continue;
      counts.edge.compare(amps::power_at_edge_crossing(q, u, v, j, &counts.edge_stages), sign(at.power));
      counts.edge.compare(amps::power_at_edge_crossing(q, v, u, reverse), sign(at.power));
    }
    const MaybePower at = rational_facet_power(owner, second, third, q);
    if (!at.exists) continue;
    counts.facet.compare(amps::power_at_facet_crossing(q, j, l, &counts.facet_stages), sign(at.power));
    counts.facet.compare(amps::power_at_facet_crossing(q, l, j), sign(at.power));
    const double* const turned[3] = {q[2], q[0], q[1]};
    const double* const mirrored[3] = {q[1], q[0], q[2]};
    for (const double* const* other : {turned, mirrored}) {
      const Bisector k(owner, second, other), m(owner, third, other);
      counts.facet.compare(amps::power_at_facet_crossing(other, k, m), sign(at.power));
    }
  }
}

/// Integer vectors of one length, so that sites at these offsets from a vertex are cospherical around it.
constexpr int kSquaredLength = 50;
const std::array<std::array<double, 3>, 9> kOffsets = {
    {{5, 5, 0}, {7, 1, 0}, {-7, 0, 1}, {3, 4, 5}, {3, -4, 5}, {-4, -3, 5}, {0, -5, -5}, {1, 0, -7}, {5, 4, -3}}};

}  // namespace

TEST_CASE("coverage vs rationals: the sign of the power at corners, edge crossings and facet crossings") {
  Counts all;
  for (const Kind kind : kAllKinds) {
    CAPTURE(int(kind));
    Counts counts;
    Rng rng(1);
    Configuration c;
    // Rationals of 20,000 bits take their time.
    const int count = kind == Kind::kWideEdge ? 12 : (kind == Kind::kMagnitudes ? 100 : 300);
    for (int n = 0; n < count; ++n) {
      c.randomize(rng, kind);
      MaybePower near;
      if (n % 4 == 1) near = {true, rational_corner_power(c.site[0], c.pointers[0])};
      if (n % 4 == 2) near = rational_edge_power(c.site[0], c.site[1], c.pointers[0], c.pointers[1]);
      if (n % 4 == 3) near = rational_facet_power(c.site[0], c.site[1], c.site[2], c.pointers);
      if (near.exists) c.bring_to_zero(rng, near.power);
      compare_all(c, counts);
    }
    CHECK(counts.corner.wrong == 0);
    CHECK(counts.edge.wrong == 0);
    CHECK(counts.facet.wrong == 0);
    CHECK(counts.edge.compared > 100);
    CHECK(counts.facet.compared > 100);
    for (std::size_t s = 0; s < all.edge_stages.counts.size(); ++s) {
      all.corner_stages.counts[s] += counts.corner_stages.counts[s];
      all.edge_stages.counts[s] += counts.edge_stages.counts[s];
      all.facet_stages.counts[s] += counts.facet_stages.counts[s];
    }
  }
  for (const StageTally* tally : {&all.corner_stages, &all.edge_stages, &all.facet_stages}) {
    for (const Stage stage : {Stage::kFilter, Stage::kExactNarrow, Stage::kExactMiddle, Stage::kExactWide}) {
      CAPTURE(int(stage));
      CHECK((*tally)[stage] > 20);
    }
    CHECK((*tally)[Stage::kSymbolic] == 0);
  }
}

TEST_CASE("coverage vs rationals: sites cospherical around a vertex, at all scales and far from the origin") {
  Rng rng(2);
  Counts counts;
  Configuration c;
  for (int n = 0; n < 3000; ++n) {
    // The vertex, and a facet around it (its corners sum to three times the vertex, weighted or not).
    const auto small = [&rng] { return double(rng.below(41)) - 20; };
    const double shift = n % 3 == 0 ? 0x1p40 : 0;
    const std::array<double, 3> vertex = {shift + small(), small() - shift, small()};
    std::array<double, 3> a, b;
    for (std::size_t k = 0; k < 3; ++k) {
      a[k] = small();
      b[k] = small();
    }
    for (std::size_t k = 0; k < 3; ++k) {
      c.corner[0][k] = vertex[k] + a[k];
      c.corner[1][k] = vertex[k] + b[k];
      c.corner[2][k] = vertex[k] - a[k] - b[k];
    }
    const double w = n % 2 == 0 ? kSquaredLength : some_ulps(rng, kSquaredLength);
    std::array<std::size_t, 3> at{};
    do {
      for (std::size_t& m : at) m = rng.below(kOffsets.size());
    } while (at[0] == at[1] || at[1] == at[2] || at[0] == at[2]);
    for (std::size_t s = 0; s < 3; ++s) {
      const auto& o = kOffsets[at[s]];
      c.site[s] = {vertex[0] + o[0], vertex[1] + o[1], vertex[2] + o[2], w};
    }
    if (n % 5 == 0) c.corner[0] = vertex;  // the vertex is a corner
    if (n % 5 == 1) {                      // it halves edge (0, 1)
      for (std::size_t k = 0; k < 3; ++k) c.corner[1][k] = vertex[k] - a[k];
    }
    const int exponent = n % 7 == 0 ? 400 : (n % 7 == 1 ? -450 : 0);
    for (auto& x : c.corner) {
      for (double& v : x) v = std::ldexp(v, exponent);
    }
    for (WeightedPoint& p : c.site) {
      p = {std::ldexp(p.x, exponent), std::ldexp(p.y, exponent), std::ldexp(p.z, exponent), std::ldexp(p.w, 2 * exponent)};
    }
    compare_all(c, counts);
  }
  CHECK(counts.corner.wrong == 0);
  CHECK(counts.edge.wrong == 0);
  CHECK(counts.facet.wrong == 0);
  CHECK(counts.corner.zeros > 500);
  CHECK(counts.edge.zeros > 500);
  CHECK(counts.facet.zeros > 5000);
}

TEST_CASE("coverage vs rationals: the filter on computed coordinates is never wrong") {
  int wrong = 0, decided = 0, undecided = 0, vertices = 0;
  for (const Kind kind : {Kind::kRandom, Kind::kLattice, Kind::kFlat, Kind::kOffset, Kind::kMagnitudes, Kind::kTiny}) {
    Rng rng(3);
    Configuration c;
    for (int n = 0; n < 1500; ++n) {
      c.randomize(rng, kind);
      MaybePower at = rational_facet_power(c.site[0], c.site[1], c.site[2], c.pointers);
      if (!at.exists) continue;
      if (n % 2 == 0) c.bring_to_zero(rng, at.power);
      if (n % 4 == 0) {  // beside the threshold
        for (WeightedPoint& p : c.site) p.w *= 1 + (rng.uniform() - 0.5) * 0x1p-27;
      }
      at = rational_facet_power(c.site[0], c.site[1], c.site[2], c.pointers);
      if (!at.exists) continue;
      const Vec3 t = amps::facet_crossing_coordinates(c.pointers, c.site[0], c.site[1], c.site[2]);
      if (t.minCoeff() == 0 || std::fabs(t.sum() - 1) > 1e-9) continue;  // clamped: not in the facet
      const auto position = [&c](std::size_t k) { return Vec3(c.corner[k][0], c.corner[k][1], c.corner[k][2]); };
      const Vec3 x = t[0] * position(0) + t[1] * position(1) + t[2] * position(2);
      double longest = 0, largest = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        longest = std::max(longest, (position(k) - position((k + 1) % 3)).stableNorm());
        largest = std::max(largest, position(k).cwiseAbs().maxCoeff());
      }
      const double error = amps::detail::kPositionError * longest + amps::detail::kPositionRounding * largest;
      ++vertices;
      const int side = amps::detail::PowerFilter(c.site[0], error).side(x);
      wrong += side != 0 && side != sign(at.power);
      ++(side == 0 ? undecided : decided);
    }
  }
  CHECK(wrong == 0);
  CHECK(vertices > 500);
  CHECK(decided > 250);
  CHECK(undecided > 100);
}
