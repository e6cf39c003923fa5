// The predicates and crossing coordinates against exact rationals (GMP through CGAL), on input made to be nearly degenerate.
#include "amps/predicates.h"

#include <CGAL/Gmpq.h>

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

using amps::Bisector;
using amps::Rng;
using amps::Stage;
using amps::StageTally;
using amps::Vec3;
using amps::WeightedPoint;
using CGAL::Gmpq;

namespace {

int sign(const Gmpq& x) { return static_cast<int>(CGAL::sign(x)); }

struct ExactSite {
  Gmpq x[3], w;
  explicit ExactSite(const WeightedPoint& p) : x{Gmpq(p.x), Gmpq(p.y), Gmpq(p.z)}, w(p.w) {}
};

Gmpq squared(const Gmpq& a) { return a * a; }

Gmpq determinant(const Gmpq (&m)[3][3]) {
  return m[0][0] * m[1][1] * m[2][2] + m[0][1] * m[1][2] * m[2][0] + m[0][2] * m[1][0] * m[2][1] - m[0][2] * m[1][1] * m[2][0] -
         m[0][1] * m[1][0] * m[2][2] - m[0][0] * m[1][2] * m[2][1];
}

int rational_orientation(const WeightedPoint& a, const WeightedPoint& b, const WeightedPoint& c, const WeightedPoint& d) {
  const ExactSite e[4] = {ExactSite(a), ExactSite(b), ExactSite(c), ExactSite(d)};
  Gmpq m[3][3];
  for (int r = 0; r < 3; ++r) {
    for (int k = 0; k < 3; ++k) m[r][k] = e[r + 1].x[k] - e[0].x[k];
  }
  return sign(determinant(m));
}

/// By the orthogonal sphere: its centre relative to p0 by Cramer's rule, then the power of q to it.
int rational_power(const WeightedPoint& p0, const WeightedPoint& p1, const WeightedPoint& p2, const WeightedPoint& p3,
                   const WeightedPoint& q) {
  const ExactSite e[4] = {ExactSite(p0), ExactSite(p1), ExactSite(p2), ExactSite(p3)}, f(q);
  // 2 (p_k − p_0)·c = |p_k − p_0|² − w_k + w_0, radius² = |c|² − w_0; conflict: |q − p0 − c|² − radius² − w_q < 0.
  Gmpq rows[3][3], right[3];
  for (int r = 0; r < 3; ++r) {
    right[r] = e[0].w - e[r + 1].w;
    for (int k = 0; k < 3; ++k) {
      rows[r][k] = 2 * (e[r + 1].x[k] - e[0].x[k]);
      right[r] += squared(e[r + 1].x[k] - e[0].x[k]);
    }
  }
  const Gmpq denominator = determinant(rows);
  Gmpq power = e[0].w - f.w;
  for (int k = 0; k < 3; ++k) {
    Gmpq replaced[3][3];
    for (int r = 0; r < 3; ++r) {
      for (int m = 0; m < 3; ++m) replaced[r][m] = m == k ? right[r] : rows[r][m];
    }
    const Gmpq d = f.x[k] - e[0].x[k];
    power += d * d - 2 * d * (determinant(replaced) / denominator);
  }
  return -sign(power);
}

double ulps(double x, std::int64_t n) {
  for (; n > 0; --n) x = std::nextafter(x, INFINITY);
  for (; n < 0; ++n) x = std::nextafter(x, -INFINITY);
  return x;
}
double some_ulps(Rng& rng, double x) { return ulps(x, static_cast<std::int64_t>(rng.below(5)) - 2); }

double random_decimal_magnitude(Rng& rng, int range) {
  return (rng.uniform() - 0.5) *
         std::pow(10.0, static_cast<double>(rng.below(static_cast<std::uint64_t>(2 * range + 1))) - range);
}

enum class Kind { kRandom, kSphere, kNearPlane, kLattice, kMagnitudes, kOffset, kOffsetSphere, kFlatBox };
constexpr Kind kAllKinds[] = {Kind::kRandom,     Kind::kSphere, Kind::kNearPlane,    Kind::kLattice,
                              Kind::kMagnitudes, Kind::kOffset, Kind::kOffsetSphere, Kind::kFlatBox};

WeightedPoint random_site(Rng& rng, Kind kind) {
  const double x = rng.uniform(), y = rng.uniform(), z = rng.uniform();
  switch (kind) {
    case Kind::kSphere:
    case Kind::kOffsetSphere: {
      const double height = 2 * z - 1, turn = 6.283185307179586 * y, s = std::sqrt(1 - height * height);
      const double at = kind == Kind::kOffsetSphere ? 1e8 : 0;
      return {some_ulps(rng, at + s * std::cos(turn)), some_ulps(rng, at + s * std::sin(turn)), some_ulps(rng, at + height), 0};
    }
    case Kind::kNearPlane:
      return {x, y, some_ulps(rng, 0.3 * x + 0.7 * y), z * 1e-3};
    case Kind::kLattice:
      return {std::floor(5 * x) / 7, std::floor(5 * y) / 7, std::floor(5 * z) / 7, std::floor(3 * rng.uniform()) / 49};
    case Kind::kMagnitudes:
      return {random_decimal_magnitude(rng, 300), random_decimal_magnitude(rng, 300), random_decimal_magnitude(rng, 300),
              random_decimal_magnitude(rng, 300)};
    case Kind::kOffset:
      return {1e8 + x, 1e8 + y, 1e8 + z, rng.uniform() * 1e-3};
    case Kind::kFlatBox:
      return {x, y * 1e-9, z * 1e-18, rng.uniform() * 1e-12};
    default:
      return {x, y, z, rng.uniform() * 0.1};
  }
}

template <std::size_t K>
std::array<WeightedPoint, K> distinct_sites(Rng& rng, Kind kind) {
  for (;;) {
    std::array<WeightedPoint, K> sites;
    bool distinct = true;
    for (std::size_t a = 0; a < K; ++a) {
      sites[a] = random_site(rng, kind);
      for (std::size_t b = 0; b < a; ++b) distinct = distinct && !amps::same_position(sites[a], sites[b]);
    }
    if (distinct) return sites;
  }
}

Gmpq rational_bisector(const WeightedPoint& i, const WeightedPoint& j, const double* x) {
  const ExactSite a(i), b(j);
  Gmpq d = a.w - b.w;
  for (int k = 0; k < 3; ++k) d += squared(Gmpq(x[k]) - b.x[k]) - squared(Gmpq(x[k]) - a.x[k]);
  return d;
}

/// Moves the weight of `other` so that x lies on the bisector, up to rounding.
void balance(const WeightedPoint& owner, WeightedPoint& other, const double* x) {
  const Gmpq w = rational_bisector(owner, other, x) + Gmpq(other.w);
  const double rounded = CGAL::to_double(w);
  if (std::isfinite(rounded)) other.w = rounded;
}

struct RationalBisectors {
  Gmpq j[3], l[3], k[3];
  Gmpq lambda[3], sum;
  RationalBisectors(const WeightedPoint& i, const WeightedPoint& pj, const WeightedPoint& pl, const WeightedPoint& pk,
                    const double* const c[3]) {
    for (int v = 0; v < 3; ++v) {
      j[v] = rational_bisector(i, pj, c[v]);
      l[v] = rational_bisector(i, pl, c[v]);
      k[v] = rational_bisector(i, pk, c[v]);
    }
    for (int v = 0; v < 3; ++v) lambda[v] = j[(v + 1) % 3] * l[(v + 2) % 3] - j[(v + 2) % 3] * l[(v + 1) % 3];
    sum = lambda[0] + lambda[1] + lambda[2];
  }
  bool meet() const {
    const int s = sign(sum);
    return s != 0 && sign(lambda[0]) * s >= 0 && sign(lambda[1]) * s >= 0 && sign(lambda[2]) * s >= 0;
  }
};

/// Documented: a few 2^-46 of 1.
constexpr double kCoordinateError = 4 * 0x1p-46;

}  // namespace

TEST_CASE("predicates vs rationals: orient3d and power_test") {
  StageTally orientation, power;
  for (const Kind kind : kAllKinds) {
    CAPTURE(int(kind));
    Rng rng(1);
    int wrong = 0;
    for (int n = 0; n < 2000; ++n) {
      auto p = distinct_sites<5>(rng, kind);
      if (n % 4 == 0) {  // d nearly a + b − c: in their plane
        p[3] = {some_ulps(rng, p[0].x + p[1].x - p[2].x), p[0].y + p[1].y - p[2].y, p[0].z + p[1].z - p[2].z, p[3].w};
      }
      const int expected = rational_orientation(p[0], p[1], p[2], p[3]);
      wrong += amps::orient3d(p[0], p[1], p[2], p[3], {}, orientation) != expected;
      if (expected == 0) continue;
      if (expected < 0) std::swap(p[0], p[1]);
      const int expected_power = rational_power(p[0], p[1], p[2], p[3], p[4]);
      const int plain = amps::power_test<false>(p[0], p[1], p[2], p[3], p[4], {}, power);
      const int perturbed = amps::power_test(p[0], p[1], p[2], p[3], p[4]);
      wrong += plain != expected_power;
      wrong += perturbed == 0 || (expected_power != 0 && perturbed != expected_power);
    }
    CHECK(wrong == 0);
  }
  for (const Stage stage : {Stage::kFilter, Stage::kExactNarrow, Stage::kExactMiddle, Stage::kExactWide}) {
    CAPTURE(int(stage));
    CHECK(orientation[stage] > 20);
    CHECK(power[stage] > 20);
  }
}

TEST_CASE("predicates vs rationals: bisector sides") {
  StageTally corner, edge, facet;
  for (const Kind kind : kAllKinds) {
    CAPTURE(int(kind));
    Rng rng(2);
    int wrong = 0;
    for (int n = 0; n < 2000; ++n) {
      auto s = distinct_sites<7>(rng, kind);
      const double* const c[3] = {&s[4].x, &s[5].x, &s[6].x};
      WeightedPoint &i = s[0], &j = s[1], &l = s[2], &k = s[3];
      if (n % 2 == 0) {  // all bisectors nearly through one point of the facet
        const Vec3 x = (s[4].position() / 4 + s[5].position() / 4 + s[6].position() / 2);
        balance(i, j, x.data());
        if (n % 4 == 0) balance(i, l, x.data());
        balance(i, k, x.data());
      }
      if (n % 5 == 0) {  // a corner nearly on the bisector
        balance(i, j, c[0]);
        j.w = some_ulps(rng, j.w);
      }
      if (n % 7 == 0) {  // k nearly j
        k = j;
        k.x = some_ulps(rng, k.x);
        if (amps::same_position(k, j)) k.x = ulps(k.x, 1);
      }
      const RationalBisectors exact(i, j, l, k, c);
      const Bisector bj(i, j, c), bl(i, l, c), bk(i, k, c);
      const auto compare = [&wrong](int computed, int expected) {
        wrong += computed == 0 || (expected != 0 && computed != expected);
      };
      for (int v = 0; v < 3; ++v) compare(amps::side_of_corner(c, v, bj, &corner), sign(exact.j[v]));
      if (sign(exact.j[0]) * sign(exact.j[1]) < 0) {
        compare(amps::side_of_edge_crossing(c, 0, 1, bj, bk, &edge),
                sign(exact.j[0] * exact.k[1] - exact.k[0] * exact.j[1]) * sign(exact.j[0] - exact.j[1]));
      }
      if (exact.meet()) {
        compare(
            amps::side_of_facet_crossing(c, bj, bl, bk, &facet),
            sign(exact.k[0] * exact.lambda[0] + exact.k[1] * exact.lambda[1] + exact.k[2] * exact.lambda[2]) * sign(exact.sum));
      }
    }
    CHECK(wrong == 0);
  }
  for (const StageTally* tally : {&corner, &edge, &facet}) {
    for (const Stage stage : {Stage::kFilter, Stage::kExactNarrow, Stage::kExactMiddle, Stage::kExactWide}) {
      CAPTURE(int(stage));
      CHECK((*tally)[stage] > 0);
    }
  }
}

TEST_CASE("predicates vs rationals: crossing coordinates are as accurate as documented, whatever the conditioning") {
  int edge_count = 0, facet_count = 0, hard_edges = 0, hard_facets = 0;
  double worst_edge = 0, worst_facet = 0;
  for (const Kind kind : kAllKinds) {
    Rng rng(3);
    for (int n = 0; n < 3000; ++n) {
      auto s = distinct_sites<6>(rng, kind);
      WeightedPoint &i = s[0], &j = s[1], &l = s[2];
      if (n % 3 == 0) {  // facet nearly parallel to bisector (i, j): all corners nearly on it
        for (int v = 3; v < 6; ++v) {
          const double shift = s[std::size_t(v)].x - (i.x + j.x) / 2;
          const double y = (i.y + j.y) / 2 - shift * (j.x - i.x) / (j.y - i.y);
          if (std::isfinite(y)) s[std::size_t(v)].y = y;
          s[std::size_t(v)].z = (i.z + j.z) / 2;
        }
        j.w = i.w;
      }
      const double* const c[3] = {&s[3].x, &s[4].x, &s[5].x};
      if (n % 2 == 0) {
        const Vec3 x = (s[3].position() / 4 + s[4].position() / 4 + s[5].position() / 2);
        balance(i, j, x.data());
        balance(i, l, x.data());
      }
      if (n % 5 == 0) {  // bisectors nearly parallel
        l = j;
        l.x = some_ulps(rng, l.x + (j.x - i.x) * 1e-10);
        if (amps::same_position(l, j)) l.x = ulps(l.x, 1);
      }
      const RationalBisectors exact(i, j, l, l, c);
      const Bisector bj(i, j, c);
      if (sign(exact.j[0]) * sign(exact.j[1]) < 0) {
        const auto t = amps::edge_crossing_coordinates(c, 0, 1, bj);
        const Gmpq difference = exact.j[0] - exact.j[1];
        const double error = std::max(CGAL::to_double(CGAL::abs(Gmpq(t[0]) + exact.j[1] / difference)),
                                      CGAL::to_double(CGAL::abs(Gmpq(t[1]) - exact.j[0] / difference)));
        worst_edge = std::max(worst_edge, error);
        ++edge_count;
        const auto approximate = bj.at_corner[0] - bj.at_corner[1];
        hard_edges += !(approximate.error <= 1e-6 * std::fabs(approximate.value));
      }
      if (exact.meet()) {
        const Vec3 t = amps::facet_crossing_coordinates(c, i, j, l);
        for (int v = 0; v < 3; ++v) {
          const double error = CGAL::to_double(CGAL::abs(Gmpq(t[v]) - exact.lambda[v] / exact.sum));
          worst_facet = std::max(worst_facet, error);
        }
        ++facet_count;
        const Bisector bl(i, l, c);
        const auto sum = bj.at_corner[0] * (bl.at_corner[1] - bl.at_corner[2]) +
                         bj.at_corner[1] * (bl.at_corner[2] - bl.at_corner[0]) +
                         bj.at_corner[2] * (bl.at_corner[0] - bl.at_corner[1]);
        hard_facets += !(sum.error <= 1e-6 * std::fabs(sum.value));
      }
    }
  }
  CHECK(worst_edge <= kCoordinateError);
  CHECK(worst_facet <= kCoordinateError);
  CHECK(edge_count > 3000);
  CHECK(facet_count > 1000);
  CHECK(hard_edges > 300);
  CHECK(hard_facets > 100);
}

TEST_CASE("predicates vs rationals: side_of_ball and collinear") {
  for (const Kind kind : kAllKinds) {
    CAPTURE(int(kind));
    Rng rng(4);
    int wrong = 0, zeros = 0;
    for (int n = 0; n < 2000; ++n) {
      auto s = distinct_sites<3>(rng, kind);
      if (n % 2 == 0) {
        s[2] = {2 * s[1].x - s[0].x, 2 * s[1].y - s[0].y, some_ulps(rng, 2 * s[1].z - s[0].z), 0};
      }
      const ExactSite a(s[0]), b(s[1]), c(s[2]);
      Gmpq distance = 0;
      for (int k = 0; k < 3; ++k) distance += squared(a.x[k] - b.x[k]);
      const double rounded = CGAL::to_double(distance);
      if (std::isfinite(rounded)) {
        const double w = some_ulps(rng, rounded);
        wrong += amps::side_of_ball(&s[0].x, &s[1].x, w) != sign(distance - Gmpq(w));
      }
      bool collinear = true;
      for (int k = 0; k < 3; ++k) {
        const int m = (k + 1) % 3;
        collinear = collinear && (b.x[k] - a.x[k]) * (c.x[m] - a.x[m]) == (b.x[m] - a.x[m]) * (c.x[k] - a.x[k]);
      }
      zeros += collinear;
      wrong += amps::collinear(&s[0].x, &s[1].x, &s[2].x) != collinear;
    }
    CHECK(wrong == 0);
    if (kind == Kind::kLattice) CHECK(zeros > 20);
  }
}
