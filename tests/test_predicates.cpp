#include "amps/predicates.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

using amps::Bisector;
using amps::Rng;
using amps::Stage;
using amps::StageTally;
using amps::Vec3;
using amps::WeightedPoint;
using amps::detail::Int;
using amps::detail::StaticBounds;

namespace {

enum class Kind { kRandom, kLattice, kNearSphere, kNearPlane, kClusters, kMixedMagnitude, kTiny };
constexpr Kind kAllKinds[] = {Kind::kRandom,   Kind::kLattice,        Kind::kNearSphere, Kind::kNearPlane,
                              Kind::kClusters, Kind::kMixedMagnitude, Kind::kTiny};

double random_magnitude(Rng& rng, int exponent_range) {
  const int e = static_cast<int>(rng.below(static_cast<std::uint64_t>(2 * exponent_range + 1))) - exponent_range;
  return std::ldexp(rng.uniform() - 0.5, e);
}

WeightedPoint random_site(Rng& rng, Kind kind) {
  const auto u = [&rng] { return rng.uniform(); };
  switch (kind) {
    case Kind::kLattice:
      return {double(rng.below(4)), double(rng.below(4)), double(rng.below(4)), double(rng.below(3))};
    case Kind::kNearSphere: {  // orthogonal to the unit sphere up to rounding
      const double z = 2 * u() - 1, t = 6.283185307179586 * u(), s = std::sqrt(1 - z * z);
      return {s * std::cos(t), s * std::sin(t), z, 0};
    }
    case Kind::kNearPlane: {
      const double x = u(), y = u();
      return {x, y, 0.25 * x + 0.3 * y, u()};
    }
    case Kind::kClusters: {  // small clusters: a bound of the whole set says little about a call within one
      const double at = double(rng.below(2));
      return {at + 1e-4 * u(), at + 1e-4 * u(), at + 1e-4 * u(), 1e-8 * u()};
    }
    case Kind::kMixedMagnitude:
      return {random_magnitude(rng, 500), random_magnitude(rng, 500), random_magnitude(rng, 500), random_magnitude(rng, 500)};
    case Kind::kTiny:
      return {std::ldexp(double(rng.below(9)), -1074), std::ldexp(double(rng.below(9)), -1074),
              std::ldexp(double(rng.below(9)), -1074), 0};
    default:
      return {u(), u(), u(), u()};
  }
}

template <std::size_t K>
std::array<WeightedPoint, K> distinct_sites(Rng& rng, Kind kind) {
  for (;;) {
    std::array<WeightedPoint, K> sites;
    for (WeightedPoint& p : sites) p = random_site(rng, kind);
    bool distinct = true;
    for (std::size_t a = 0; a < K; ++a) {
      for (std::size_t b = 0; b < a; ++b) distinct = distinct && !amps::same_position(sites[a], sites[b]);
    }
    if (distinct) return sites;
  }
}

bool odd_permutation(const std::array<int, 4>& order) {
  int inversions = 0;
  for (std::size_t a = 0; a < 4; ++a) {
    for (std::size_t b = 0; b < a; ++b) inversions += order[b] > order[a];
  }
  return inversions % 2 != 0;
}

WeightedPoint scaled(const WeightedPoint& p, int exponent) {
  return {std::ldexp(p.x, exponent), std::ldexp(p.y, exponent), std::ldexp(p.z, exponent), std::ldexp(p.w, 2 * exponent)};
}
WeightedPoint translated(const WeightedPoint& p, double t) { return {p.x + t, p.y - 2 * t, p.z + 4 * t, p.w}; }

// The oracle of the perturbation: small-integer sites, w − ε with the explicit ε below in units of 2^-kUnitBits, all in
// integers. Degree 3 in D (Type C): ε of one rank must dominate every product with a smaller one, hence the wide steps.
constexpr int kUnitBits = 400;
constexpr int kFirstEpsilon = 360;  // the dominant ε is 2^(kFirstEpsilon − kUnitBits)
constexpr int kEpsilonStep = 60;
using Wide = Int<8>;

Wide power_of_two(int e) {
  Wide r{};
  r.limb[e / 64] = std::uint64_t{1} << (e % 64);
  return r;
}
Wide from_integer(std::int64_t x) { return amps::detail::widen<8>(Int<1>{{static_cast<std::uint64_t>(x)}}); }
Wide narrow(const Int<9>& a) {  // values here fit by far
  Wide r;
  std::copy(a.limb, a.limb + 8, r.limb);
  return r;
}
Wide times(std::int64_t x, const Wide& a) { return narrow(Int<1>{{static_cast<std::uint64_t>(x)}} * a); }

/// ε of each site in units: the lexicographically greatest gets the largest.
template <std::size_t K>
std::array<Wide, K> explicit_epsilons(const std::array<WeightedPoint, K>& sites) {
  std::array<Wide, K> epsilon{};
  for (std::size_t a = 0; a < K; ++a) {
    int greater = 0;
    for (std::size_t b = 0; b < K; ++b) greater += amps::lexicographically_less(sites[a], sites[b]);
    epsilon[a] = power_of_two(kFirstEpsilon - kEpsilonStep * greater);
  }
  return epsilon;
}

std::array<std::int64_t, 3> integers(const WeightedPoint& p) {
  return {std::int64_t(p.x), std::int64_t(p.y), std::int64_t(p.z)};
}

/// The determinant of rows (x, y, z, 1) by summing over permutations.
std::int64_t orientation_by_permutations(const std::array<std::array<std::int64_t, 3>, 4>& p) {
  std::array<int, 4> order = {0, 1, 2, 3};
  std::int64_t sum = 0;
  do {
    const std::int64_t term = p[std::size_t(order[0])][0] * p[std::size_t(order[1])][1] * p[std::size_t(order[2])][2];
    sum += odd_permutation(order) ? -term : term;
  } while (std::next_permutation(order.begin(), order.end()));
  return sum;
}

/// Sign of the lifted determinant of five sites with explicit ε, normalised to be + where the last lies in conflict with a
/// positively oriented cell. `unperturbed`: whether it is 0 without ε.
int perturbed_power_by_permutations(const std::array<WeightedPoint, 5>& site, bool& degenerate) {
  const auto epsilon = explicit_epsilons(site);
  Wide sum = from_integer(0);
  std::int64_t plain_sum = 0;
  for (std::size_t k = 0; k < 5; ++k) {  // expansion along the column of heights
    std::array<std::array<std::int64_t, 3>, 4> others;
    for (std::size_t m = 0, at = 0; m < 5; ++m) {
      if (m != k) others[at++] = integers(site[m]);
    }
    const auto x = integers(site[k]);
    const std::int64_t height = x[0] * x[0] + x[1] * x[1] + x[2] * x[2] - std::int64_t(site[k].w);
    const std::int64_t minor = (k % 2 == 0 ? 1 : -1) * orientation_by_permutations(others);
    plain_sum += minor * height;
    sum = sum + times(minor, times(height, power_of_two(kUnitBits)) + epsilon[k]);
  }
  degenerate = plain_sum == 0;
  std::array<std::array<std::int64_t, 3>, 4> cell;
  for (std::size_t m = 0; m < 4; ++m) cell[m] = integers(site[m]);
  // The minor of the last height is the cell's orientation; a query of lower height makes the sum smaller if that is +.
  return -sum.sign() * (orientation_by_permutations(cell) > 0 ? 1 : -1);
}

struct Corners {
  double position[3][3];
  const double* pointers[3] = {position[0], position[1], position[2]};
  Corners() = default;
  Corners(const Corners&) = delete;
};

/// D_j at a corner, in units, with the explicit ε.
Wide perturbed_bisector(const WeightedPoint& i, const Wide& epsilon_i, const WeightedPoint& j, const Wide& epsilon_j,
                        const double* x) {
  const auto power = [x](const WeightedPoint& p) {
    const double d[3] = {x[0] - p.x, x[1] - p.y, x[2] - p.z};
    return std::int64_t(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - p.w);
  };
  return times(power(j) - power(i), power_of_two(kUnitBits)) + (epsilon_j - epsilon_i);
}

void random_lattice_corners(Rng& rng, Corners& corners) {
  for (auto& corner : corners.position) {
    for (double& x : corner) x = double(rng.below(4));
  }
}

}  // namespace

TEST_CASE("predicates: orient3d is + for a positive tetrahedron and negated by each swap") {
  const WeightedPoint o{0, 0, 0, 0}, x{1, 0, 0, 0}, y{0, 1, 0, 0}, z{0, 0, 1, 0};
  CHECK(amps::orient3d(o, x, y, z) == 1);
  for (const Kind kind : kAllKinds) {
    CAPTURE(int(kind));
    Rng rng(1);
    for (int k = 0; k < 300; ++k) {
      auto p = distinct_sites<4>(rng, kind);
      if (k % 3 == 0) p[3] = {p[0].x + p[1].x - p[2].x, p[0].y + p[1].y - p[2].y, p[0].z + p[1].z - p[2].z, 0};
      const int sign = amps::orient3d(p[0], p[1], p[2], p[3]);
      std::array<int, 4> order = {0, 1, 2, 3};
      do {
        const int permuted = amps::orient3d(p[std::size_t(order[0])], p[std::size_t(order[1])], p[std::size_t(order[2])],
                                            p[std::size_t(order[3])]);
        REQUIRE(permuted == (odd_permutation(order) ? -sign : sign));
      } while (std::next_permutation(order.begin(), order.end()));
    }
  }
}

TEST_CASE("predicates: power_test is negated by odd permutations of the cell and kept by even ones") {
  for (const Kind kind : kAllKinds) {
    CAPTURE(int(kind));
    Rng rng(2);
    for (int k = 0; k < 300; ++k) {
      const auto p = distinct_sites<5>(rng, kind);
      if (amps::orient3d(p[0], p[1], p[2], p[3]) <= 0) continue;
      const int plain = amps::power_test<false>(p[0], p[1], p[2], p[3], p[4]);
      const int perturbed = amps::power_test(p[0], p[1], p[2], p[3], p[4]);
      CHECK(perturbed != 0);
      CHECK((plain == 0 || plain == perturbed));
      std::array<int, 4> order = {0, 1, 2, 3};
      do {
        const WeightedPoint &a = p[std::size_t(order[0])], &b = p[std::size_t(order[1])], &c = p[std::size_t(order[2])],
                            &d = p[std::size_t(order[3])];
        const bool odd = odd_permutation(order);
        REQUIRE(amps::power_test<false>(a, b, c, d, p[4]) == (odd ? -plain : plain));
        if (!odd) REQUIRE(amps::power_test(a, b, c, d, p[4]) == perturbed);
      } while (std::next_permutation(order.begin(), order.end()));
    }
  }
}

TEST_CASE("predicates: power_test is + inside and − outside the orthogonal sphere, and answers to weights") {
  const WeightedPoint o{0, 0, 0, 0}, x{1, 0, 0, 0}, y{0, 1, 0, 0}, z{0, 0, 1, 0};
  CHECK(amps::power_test(o, x, y, z, {0.5, 0.5, 0.5, 0}) == 1);
  CHECK(amps::power_test(o, x, y, z, {2, 2, 2, 0}) == -1);
  CHECK(amps::power_test(o, x, y, z, {2, 2, 2, 100}) == 1);
  CHECK(amps::power_test(o, x, y, z, {0.5, 0.5, 0.5, -100}) == -1);
  CHECK(amps::power_test<false>(o, x, y, z, {1, 1, 0, 0}) == 0);
}

TEST_CASE("predicates: exact translations and scalings by powers of two keep every sign") {
  for (const Kind kind : {Kind::kLattice, Kind::kRandom}) {
    CAPTURE(int(kind));
    Rng rng(3);
    for (int k = 0; k < 400; ++k) {
      auto p = distinct_sites<5>(rng, kind);
      for (WeightedPoint& s : p) {  // 20-bit coordinates: translations below are exact
        s = {std::floor(s.x * 0x1p18) * 0x1p-18, std::floor(s.y * 0x1p18) * 0x1p-18, std::floor(s.z * 0x1p18) * 0x1p-18, s.w};
      }
      if (amps::orient3d(p[0], p[1], p[2], p[3]) < 0) std::swap(p[0], p[1]);
      const int orientation = amps::orient3d(p[0], p[1], p[2], p[3]);
      const int power = amps::power_test<false>(p[0], p[1], p[2], p[3], p[4]);
      const int perturbed = orientation > 0 ? amps::power_test(p[0], p[1], p[2], p[3], p[4]) : 0;
      const auto same = [&](const std::array<WeightedPoint, 5>& q) {
        return amps::orient3d(q[0], q[1], q[2], q[3]) == orientation &&
               amps::power_test<false>(q[0], q[1], q[2], q[3], q[4]) == power &&
               (orientation <= 0 || amps::power_test(q[0], q[1], q[2], q[3], q[4]) == perturbed);
      };
      for (const int e : {-900, -500, -170, -30, 1, 160, 333, 480}) {
        auto q = p;
        if (e < -500 || e > 500) {
          for (WeightedPoint& s : q) s.w = 0;
          auto r = q;
          for (WeightedPoint& s : r) s = scaled(s, e);
          CHECK(amps::power_test<false>(r[0], r[1], r[2], r[3], r[4]) == amps::power_test<false>(q[0], q[1], q[2], q[3], q[4]));
          CHECK(amps::orient3d(r[0], r[1], r[2], r[3]) == orientation);
          continue;
        }
        for (WeightedPoint& s : q) s = scaled(s, e);
        CHECK(same(q));
      }
      {  // weights 0: up to the ends of the range
        auto q = p, r = p;
        for (std::size_t s = 0; s < 5; ++s) {
          q[s].w = 0;
          r[s] = scaled(q[s], 900);
        }
        CHECK(amps::power_test<false>(r[0], r[1], r[2], r[3], r[4]) == amps::power_test<false>(q[0], q[1], q[2], q[3], q[4]));
      }
      for (const double t : {1.0, -1024.0, 0x1p30}) {
        auto q = p;
        for (WeightedPoint& s : q) s = translated(s, t);
        CHECK(same(q));
      }
    }
  }
}

TEST_CASE("predicates: every stage decides some calls, and the stages agree") {
  StageTally orientation, power, unperturbed;
  for (const Kind kind : kAllKinds) {
    CAPTURE(int(kind));
    Rng rng(4);
    std::vector<std::array<WeightedPoint, 5>> calls;
    Vec3 low = Vec3::Constant(INFINITY), high = -low;
    double weight_low = INFINITY, weight_high = -INFINITY;
    amps::detail::ExactScale scale;
    for (int k = 0; k < 2000; ++k) {
      calls.push_back(distinct_sites<5>(rng, kind));
      for (const WeightedPoint& p : calls.back()) {
        low = low.cwiseMin(p.position());
        high = high.cwiseMax(p.position());
        for (const double x : {p.x, p.y, p.z}) scale.coordinate(x);
        scale.weight(p.w);
        weight_low = std::min(weight_low, p.w);
        weight_high = std::max(weight_high, p.w);
      }
    }
    const StaticBounds bounds = StaticBounds::for_set(high - low, weight_high - weight_low, scale.unit());
    for (const auto& p : calls) {
      Stage stage;
      const int exact_orientation = amps::orient3d_exact(p[0], p[1], p[2], p[3], stage);
      REQUIRE(amps::orient3d(p[0], p[1], p[2], p[3], bounds, orientation) == exact_orientation);
      REQUIRE(amps::orient3d(p[0], p[1], p[2], p[3]) == exact_orientation);
      if (exact_orientation <= 0) continue;
      const WeightedPoint* const cell[4] = {&p[0], &p[1], &p[2], &p[3]};
      std::array<int, 4> minor_signs{}, minor_signs_in_limbs{};
      const int exact_power = amps::detail::power_test_in_limbs(cell, p[4], stage, minor_signs_in_limbs);
      const amps::detail::PowerRows rows(cell, p[4]);
      REQUIRE(amps::power_test_exact(rows, cell, p[4], stage, minor_signs) == exact_power);
      if (exact_power == 0) REQUIRE(minor_signs == minor_signs_in_limbs);
      REQUIRE(amps::power_test<false>(p[0], p[1], p[2], p[3], p[4]) == exact_power);
      const int perturbed = amps::power_test(p[0], p[1], p[2], p[3], p[4], bounds, power);
      REQUIRE(perturbed == amps::power_test(p[0], p[1], p[2], p[3], p[4]));
      REQUIRE(amps::power_test<false>(p[0], p[1], p[2], p[3], p[4], bounds, unperturbed) == exact_power);
      REQUIRE((exact_power == 0 || exact_power == perturbed));
    }
  }
  for (const Stage stage :
       {Stage::kStatic, Stage::kFilter, Stage::kExactDouble, Stage::kExactNarrow, Stage::kExactMiddle, Stage::kExactWide}) {
    CAPTURE(int(stage));
    CHECK(orientation[stage] > 0);
#ifdef AMPS_HAS_INT128
    if (stage == Stage::kExactNarrow) continue;  // the machine's integers see to that
#endif
    CHECK(unperturbed[stage] > 0);
  }
#ifdef AMPS_HAS_INT128
  CHECK(unperturbed[Stage::kExactMachine] > 0);
#endif
  CHECK(orientation[Stage::kSymbolic] == 0);
  CHECK(unperturbed[Stage::kSymbolic] == 0);
  CHECK(power[Stage::kSymbolic] > 0);
}

TEST_CASE("predicates: the perturbed power test is the test of explicitly perturbed weights") {
  const std::array<WeightedPoint, 5> inside = {{{0, 0, 0, 0}, {3, 0, 0, 0}, {0, 3, 0, 0}, {0, 0, 3, 0}, {1, 1, 1, 0}}};
  bool degenerate;
  REQUIRE(perturbed_power_by_permutations(inside, degenerate) == 1);
  Rng rng(5);
  int degenerate_count = 0, mismatches = 0;
  for (int k = 0; k < 600000 && degenerate_count < 20000; ++k) {
    const auto p = distinct_sites<5>(rng, Kind::kLattice);
    if (amps::orient3d(p[0], p[1], p[2], p[3]) <= 0) continue;
    const int expected = perturbed_power_by_permutations(p, degenerate);
    degenerate_count += degenerate;
    mismatches += amps::power_test(p[0], p[1], p[2], p[3], p[4]) != expected;
  }
  CHECK(mismatches == 0);
  CHECK(degenerate_count > 5000);
}

TEST_CASE("predicates: bisector sides are those of explicitly perturbed weights") {
  Rng rng(6);
  int corner_zeros = 0, edge_zeros = 0, facet_zeros = 0, mismatches = 0;
  StageTally corner_tally, edge_tally, facet_tally;
  for (int n = 0; n < 400000; ++n) {
    Corners corners;
    random_lattice_corners(rng, corners);
    const double* const* c = corners.pointers;
    if (amps::collinear(c[0], c[1], c[2])) continue;
    const auto site = distinct_sites<4>(rng, Kind::kLattice);
    const WeightedPoint &i = site[0], &j = site[1], &l = site[2], &k = site[3];
    const auto epsilon = explicit_epsilons(site);
    Wide dj[3], dl[3], dk[3];
    for (std::size_t v = 0; v < 3; ++v) {
      dj[v] = perturbed_bisector(i, epsilon[0], j, epsilon[1], c[v]);
      dl[v] = perturbed_bisector(i, epsilon[0], l, epsilon[2], c[v]);
      dk[v] = perturbed_bisector(i, epsilon[0], k, epsilon[3], c[v]);
    }
    const Bisector bj(i, j, c), bl(i, l, c), bk(i, k, c);
    for (int v = 0; v < 3; ++v) mismatches += amps::side_of_corner(c, v, bj, &corner_tally) != dj[v].sign();

    if (dj[0].sign() != dj[1].sign()) {
      const int numerator = (dj[0] * dk[1] - dk[0] * dj[1]).sign();
      const int expected = numerator * (dj[0] - dj[1]).sign();
      REQUIRE(expected != 0);
      mismatches += amps::side_of_edge_crossing(c, 0, 1, bj, bk, &edge_tally) != expected;
      mismatches += amps::side_of_edge_crossing(c, 1, 0, bj, bk) != expected;
    }

    Int<16> lambda[3];
    for (std::size_t v = 0; v < 3; ++v) {
      lambda[v] = dj[(v + 1) % 3] * dl[(v + 2) % 3] - dj[(v + 2) % 3] * dl[(v + 1) % 3];
    }
    const int sum = (lambda[0] + lambda[1] + lambda[2]).sign();
    const bool meets = sum != 0 && lambda[0].sign() == sum && lambda[1].sign() == sum && lambda[2].sign() == sum;
    if (meets) {
      const int expected = (lambda[0] * dk[0] + lambda[1] * dk[1] + lambda[2] * dk[2]).sign() * sum;
      REQUIRE(expected != 0);
      mismatches += amps::side_of_facet_crossing(c, bj, bl, bk, &facet_tally) != expected;
      mismatches += amps::side_of_facet_crossing(c, bl, bj, bk) != expected;
    }
  }
  corner_zeros = int(corner_tally[Stage::kSymbolic]);
  edge_zeros = int(edge_tally[Stage::kSymbolic]);
  facet_zeros = int(facet_tally[Stage::kSymbolic]);
  CHECK(mismatches == 0);
  CHECK(corner_zeros > 5000);
  CHECK(edge_zeros > 5000);
  CHECK(facet_zeros > 2000);
}

TEST_CASE("predicates: of two sites exactly one owns a point, and swapping the sites swaps the answer") {
  for (const Kind kind : kAllKinds) {
    CAPTURE(int(kind));
    Rng rng(7);
    for (int n = 0; n < 500; ++n) {
      const auto site = distinct_sites<5>(rng, kind);
      const double* const c[3] = {&site[2].x, &site[3].x, &site[4].x};
      const Bisector ij(site[0], site[1], c), ji(site[1], site[0], c);
      for (int v = 0; v < 3; ++v) REQUIRE(amps::side_of_corner(c, v, ij) == -amps::side_of_corner(c, v, ji));
    }
  }
}

TEST_CASE("predicates: exactly one of three sites owns the crossing of an edge with the bisector of two") {
  // Seen from i and from j, the point where edge meets bisector (i, j) is on the same side of the third site.
  for (const Kind kind : kAllKinds) {
    CAPTURE(int(kind));
    Rng rng(8);
    int crossings = 0;
    for (int n = 0; n < 2000; ++n) {
      const auto site = distinct_sites<6>(rng, kind);
      const double* const c[3] = {&site[3].x, &site[4].x, &site[5].x};
      const Bisector ij(site[0], site[1], c), ji(site[1], site[0], c), ik(site[0], site[2], c), jk(site[1], site[2], c);
      if (amps::side_of_corner(c, 0, ij) == amps::side_of_corner(c, 1, ij)) continue;
      ++crossings;
      const int from_i = amps::side_of_edge_crossing(c, 0, 1, ij, ik);
      const int from_j = amps::side_of_edge_crossing(c, 0, 1, ji, jk);
      REQUIRE(from_i == from_j);
    }
    CHECK(crossings > 50);
  }
}

TEST_CASE("predicates: every stage decides some bisector sides") {
  StageTally corner, edge, facet;
  for (const Kind kind : kAllKinds) {
    Rng rng(9);
    for (int n = 0; n < 3000; ++n) {
      auto site = distinct_sites<4>(rng, kind);
      const auto corner_site = distinct_sites<3>(rng, kind);
      const double* const c[3] = {&corner_site[0].x, &corner_site[1].x, &corner_site[2].x};
      if (n % 2 == 0 && kind != Kind::kTiny) {  // corner 0 nearly on bisector j, and k nearly j
        const auto squared = [&](const WeightedPoint& p) { return (p.position() - corner_site[0].position()).squaredNorm(); };
        site[1].w = squared(site[1]) - squared(site[0]) + site[0].w;
        site[3] = site[1];
        site[3].x = std::nextafter(site[3].x, INFINITY);
      }
      const Bisector j(site[0], site[1], c), l(site[0], site[2], c), k(site[0], site[3], c);
      int side[3];
      for (int v = 0; v < 3; ++v) side[v] = amps::side_of_corner(c, v, j, &corner);
      if (side[0] != side[1]) {
        amps::side_of_edge_crossing(c, 0, 1, j, k, &edge);
        amps::side_of_edge_crossing(c, 0, 1, j, j, &edge);  // a point on its own bisector: exactly 0
      }
      if (side[0] != side[1] || side[1] != side[2]) amps::side_of_facet_crossing(c, j, l, k, &facet);
    }
  }
  for (const StageTally* tally : {&corner, &edge, &facet}) {
    for (const Stage stage : {Stage::kFilter, Stage::kExactNarrow, Stage::kExactMiddle, Stage::kExactWide, Stage::kSymbolic}) {
      CAPTURE(int(stage));
      CHECK((*tally)[stage] > 0);
    }
  }
}

TEST_CASE("predicates: side_of_ball is exact on, inside and outside the ball") {
  const double o[3] = {0, 0, 0}, x[3] = {3, 4, 0};
  CHECK(amps::side_of_ball(x, o, 25) == 0);
  CHECK(amps::side_of_ball(x, o, std::nextafter(25, 26)) == -1);
  CHECK(amps::side_of_ball(x, o, std::nextafter(25, 24)) == 1);
  const double far_away[3] = {3e200, 4e200, 0};
  CHECK(amps::side_of_ball(far_away, o, 1e300) == 1);
  const double tiny[3] = {1e-200, 0, 0};
  CHECK(amps::side_of_ball(tiny, o, 0) == 1);
  CHECK(amps::side_of_ball(o, o, 0) == 0);
}

TEST_CASE("predicates: orient2d is + for a counter-clockwise turn about its axis, and decides the last bit") {
  const double o[3] = {0, 0, 0}, x[3] = {1, 0, 0}, y[3] = {0, 1, 0}, z[3] = {0, 0, 1};
  const double* const axes[3] = {x, y, z};
  for (int axis = 0; axis < 3; ++axis) {
    const double *const first = axes[(axis + 1) % 3], *const second = axes[(axis + 2) % 3];
    CHECK(amps::orient2d(o, first, second, axis) == 1);
    CHECK(amps::orient2d(o, second, first, axis) == -1);
    CHECK(amps::orient2d(o, first, axes[axis], axis) == 0);
  }
  Rng rng(11);
  StageTally tally;
  for (int n = 0; n < 3000; ++n) {
    const int axis = static_cast<int>(rng.below(3)), m = (axis + 1) % 3;
    // c = a + 3/2·(b − a), exactly; far from 0 or near it, at scales that a filter can tell nothing of too.
    constexpr int kExponents[] = {0, 300, -300, -520, -1040};
    double a[3], b[3], c[3];
    for (int k = 0; k < 3; ++k) {
      const double step = 2 * double(rng.below(1 << 20)) + 2;
      a[k] = double(rng.below(1 << 20));
      b[k] = a[k] + step;
      c[k] = a[k] + 1.5 * step;
    }
    const int exponent = kExponents[rng.below(5)];
    for (double* const p : {a, b, c}) {
      for (int k = 0; k < 3; ++k) p[k] = std::ldexp(p[k], exponent);
    }
    CHECK(amps::orient2d(a, b, c, axis, &tally) == 0);
    CHECK(amps::collinear(a, b, c));
    c[m] = std::nextafter(c[m], INFINITY);
    const int sign = amps::orient2d(a, b, c, axis, &tally);
    CHECK(sign == -1);  // c is to the right of ab as seen along the axis, whose second coordinate grows from a to b
    CHECK(amps::orient2d(b, a, c, axis) == 1);
    CHECK(amps::orient2d(b, c, a, axis) == -1);
    CHECK_FALSE(amps::collinear(a, b, c));
  }
  CHECK(tally[Stage::kExactNarrow] > 3000);
  StageTally of_wide;
  const double a[3] = {0x1p-1074, 0x1p-1074, 0}, b[3] = {0x1p1000, 0x1p1000, 0}, c[3] = {0x1p1023, 0x1p1023, 0};
  CHECK(amps::orient2d(a, b, c, 2, &of_wide) == 0);
  CHECK(of_wide[Stage::kExactWide] == 1);
}

TEST_CASE("predicates: collinear is exact") {
  Rng rng(10);
  for (int k = 0; k < 2000; ++k) {
    double a[3], b[3], c[3];
    for (int m = 0; m < 3; ++m) {
      a[m] = std::floor(rng.uniform() * 0x1p30) * 0x1p-20;
      const double step = std::floor(rng.uniform() * 0x1p20) * 0x1p-20;
      b[m] = a[m] + 3 * step;
      c[m] = a[m] + 7 * step;
    }
    CHECK(amps::collinear(a, b, c));
    CHECK(amps::collinear(c, a, b));
    CHECK(amps::collinear(a, a, c));
    const int m = static_cast<int>(rng.below(3));
    b[m] = std::nextafter(b[m], INFINITY);
    CHECK_FALSE(amps::collinear(a, b, c));
  }
}

TEST_CASE("predicates: facet crossings have the same coordinates for every order of their sites") {
  Rng rng(11);
  for (const Kind kind : {Kind::kRandom, Kind::kNearPlane, Kind::kLattice}) {
    for (int n = 0; n < 1000; ++n) {
      const auto s = distinct_sites<6>(rng, kind);
      const double* const c[3] = {&s[3].x, &s[4].x, &s[5].x};
      const Vec3 first = amps::facet_crossing_coordinates(c, s[0], s[1], s[2]);
      std::array<std::size_t, 3> order = {0, 1, 2};
      while (std::next_permutation(order.begin(), order.end())) {
        CHECK(amps::facet_crossing_coordinates(c, s[order[0]], s[order[1]], s[order[2]]) == first);
      }
    }
  }
}
