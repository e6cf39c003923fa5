// A ball against a segment, against exact rationals (GMP through CGAL): near zero, on it, and at all scales.
#include "amps/predicates.h"

#include <CGAL/Gmpq.h>

#include <doctest/doctest.h>

#include <array>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

using amps::Rng;
using amps::Stage;
using amps::StageTally;
using CGAL::Gmpq;

namespace {

using Position = std::array<double, 3>;

/// The least squared distance of p to the segment: at the parameter of p's projection, cut to [0, 1].
Gmpq rational_squared_distance(const Position& a, const Position& b, const Position& p) {
  Gmpq along = 0, length = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const Gmpq u = Gmpq(b[k]) - Gmpq(a[k]);
    along += u * (Gmpq(p[k]) - Gmpq(a[k]));
    length += u * u;
  }
  Gmpq t = CGAL::is_zero(length) ? Gmpq(0) : Gmpq(along / length);
  if (t < 0) t = 0;
  if (t > 1) t = 1;
  Gmpq sum = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const Gmpq d = Gmpq(a[k]) + t * (Gmpq(b[k]) - Gmpq(a[k])) - Gmpq(p[k]);
    sum += d * d;
  }
  return sum;
}

enum class Scale { kUnit, kLattice, kOffset, kFlat, kMagnitudes, kTiny, kNarrow, kMiddle, kWide };
constexpr Scale kAllScales[] = {Scale::kUnit, Scale::kLattice, Scale::kOffset, Scale::kFlat, Scale::kMagnitudes,
                                Scale::kTiny, Scale::kNarrow,  Scale::kMiddle, Scale::kWide};

double either_sign(Rng& rng, double x) { return rng.below(2) == 0 ? x : -x; }

/// Numbers of all the bits of a width, or of few of them.
double number_of_bits(Rng& rng, int bits) {
  if (rng.below(3) == 0) return either_sign(rng, double(rng.below(4)));
  return either_sign(rng, std::ldexp(0x1p53 - double(1 + rng.below(2)), bits - 53 - static_cast<int>(rng.below(3))));
}

double draw(Rng& rng, Scale scale, std::size_t axis) {
  switch (scale) {
    case Scale::kLattice:
      return double(rng.below(9)) / 8;
    case Scale::kOffset:
      return 1e8 + rng.uniform();
    case Scale::kFlat:
      return axis == 2 ? rng.uniform() * 0x1p-70 : rng.uniform();
    case Scale::kMagnitudes:
      return (rng.uniform() - 0.5) * std::pow(10.0, double(rng.below(301)) - 150);
    case Scale::kTiny:
      return double(rng.below(9)) * std::numeric_limits<double>::denorm_min();
    case Scale::kNarrow:
      return number_of_bits(rng, amps::detail::usable_bits(amps::detail::kNarrowLimbs));
    case Scale::kMiddle:
      return number_of_bits(rng, amps::detail::usable_bits(amps::detail::kMiddleLimbs));
    case Scale::kWide:
      return rng.below(3) == 0 ? double(rng.below(4)) * std::numeric_limits<double>::denorm_min() : either_sign(rng, DBL_MAX);
    default:
      return rng.uniform();
  }
}

struct Comparison {
  int compared = 0, wrong = 0, of_stages = 0;
  std::array<int, 3> seen{};  ///< by sign + 1
  StageTally stages;

  /// Both orders of the ends, and the exact stages by themselves.
  void run(const Position& a, const Position& b, const Position& p, double w) {
    const Gmpq difference = rational_squared_distance(a, b, p) - Gmpq(w);
    const int expected = static_cast<int>(CGAL::sign(difference));
    ++compared;
    ++seen[static_cast<std::size_t>(expected + 1)];
    wrong += amps::segment_side_of_ball(a.data(), b.data(), p.data(), w, &stages) != expected;
    wrong += amps::segment_side_of_ball(b.data(), a.data(), p.data(), w) != expected;
    Stage stage;
    of_stages += amps::detail::segment_side_of_ball_exact(a.data(), b.data(), p.data(), w, stage) != expected;
  }
};

double beside(Rng& rng, double x) {
  const std::uint64_t draw = rng.below(4);
  return draw == 0 ? std::nextafter(x, INFINITY) : (draw == 1 ? std::nextafter(x, -INFINITY) : x);
}

}  // namespace

TEST_CASE("segments vs rationals: at random and beside the sphere, at every scale") {
  StageTally all;
  for (const Scale scale : kAllScales) {
    CAPTURE(int(scale));
    Comparison c;
    Rng rng(1);
    const auto point = [&] { return Position{draw(rng, scale, 0), draw(rng, scale, 1), draw(rng, scale, 2)}; };
    const int count =
        scale == Scale::kWide ? 60 : (scale == Scale::kMagnitudes ? 600 : 3000);  // rationals of 10,000 bits are slow
    for (int n = 0; n < count; ++n) {
      Position a = point(), b = point();
      const Position p = point();
      if (n % 11 == 0) b = a;
      if (n % 11 == 1) {  // p on the line, beyond an end or between
        for (std::size_t k = 0; k < 3; ++k) b[k] = a[k] + (p[k] - a[k]) * (rng.below(2) == 0 ? 0.5 : 2);
      }
      if (n % 11 == 2) {  // short and far away
        for (std::size_t k = 0; k < 3; ++k) b[k] = beside(rng, a[k]);
      }
      bool finite = true;
      for (const double x : b) finite = finite && std::isfinite(x);
      if (!finite) continue;
      const double square = CGAL::to_double(rational_squared_distance(a, b, p));
      double w = n % 3 == 0 ? 2 * rng.uniform() * square : beside(rng, square);
      if (n % 7 == 0) w = square * (1 + (rng.uniform() - 0.5) * 0x1p-44);
      if (n % 31 == 0) w = -w;
      if (n % 37 == 0) w = 0;
      if (std::isfinite(w)) c.run(a, b, p, w);
    }
    CHECK(c.wrong == 0);
    CHECK(c.of_stages == 0);
    CHECK(c.compared > (scale == Scale::kWide ? 5 : 300));
    if (scale != Scale::kWide) CHECK(c.seen[0] > 20);
    CHECK(c.seen[2] > 0);
    for (std::size_t s = 0; s < all.counts.size(); ++s) all.counts[s] += c.stages.counts[s];
  }
  for (const Stage stage : {Stage::kFilter, Stage::kExactDouble, Stage::kExactNarrow, Stage::kExactMiddle, Stage::kExactWide}) {
    CAPTURE(int(stage));
    CHECK(all[stage] > 20);
  }
}

TEST_CASE("segments vs rationals: balls that touch a segment between its ends or at one, from denormals to 1e300") {
  Rng rng(2);
  Comparison c;
  for (int n = 0; n < 8000; ++n) {
    const auto small = [&rng](int range) { return double(rng.below(static_cast<std::uint64_t>(2 * range + 1))) - range; };
    // The nearest point, a direction, and a vector across it.
    const double shift = n % 3 == 0 ? 0x1p40 : 0;
    const Position nearest = {shift + small(9), small(9) - shift, small(9)};
    const int range = 3 << n % 8;  // of few bits, for doubles, and of more
    const Position d = {small(range), small(range), small(range)}, e = {small(range), small(range), small(range)};
    Position across = {d[1] * e[2] - d[2] * e[1], d[2] * e[0] - d[0] * e[2], d[0] * e[1] - d[1] * e[0]};
    const double before = double(rng.below(4)), after = double(rng.below(4));
    if (before == 0) {  // nearest is an end: the centre may lie behind it
      for (std::size_t k = 0; k < 3; ++k) across[k] -= d[k];
    }
    Position a, b, p;
    double w = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      a[k] = nearest[k] - before * d[k];
      b[k] = nearest[k] + after * d[k];
      p[k] = nearest[k] + across[k];
      w += across[k] * across[k];
    }
    const int exponents[] = {0, 0, 0, 400, 480, -300, -480};
    const int exponent = exponents[n % 7];
    for (Position* x : {&a, &b, &p}) {
      for (double& v : *x) v = std::ldexp(v, exponent);
    }
    w = std::ldexp(w, 2 * exponent);
    c.run(a, b, p, w);
    c.run(a, b, p, std::nextafter(w, INFINITY));
    c.run(a, b, p, std::nextafter(w, -INFINITY));
  }
  CHECK(c.wrong == 0);
  CHECK(c.of_stages == 0);
  CHECK(c.seen[1] >= 8000);
  CHECK(c.seen[0] > 7000);
  CHECK(c.seen[2] > 7000);
}

TEST_CASE("segments vs rationals: needles and long edges, where the filter's bound is tight") {
  Rng rng(3);
  Comparison c;
  for (int n = 0; n < 20000; ++n) {
    const double length = std::pow(10.0, 12 * rng.uniform() - 6), far = std::pow(10.0, 8 * rng.uniform() - 6);
    Position a, b, p;
    for (std::size_t k = 0; k < 3; ++k) {
      p[k] = rng.uniform();
      const double u = length * (rng.uniform() - 0.5), t = rng.uniform();
      const double nearest = p[k] + far * (rng.uniform() - 0.5);
      a[k] = nearest - t * u;
      b[k] = nearest + (1 - t) * u;
    }
    const double square = CGAL::to_double(rational_squared_distance(a, b, p));
    c.run(a, b, p, square * (1 + (rng.uniform() - 0.5) * std::ldexp(1.0, -static_cast<int>(rng.below(52)))));
  }
  CHECK(c.wrong == 0);
  CHECK(c.of_stages == 0);
  CHECK(c.stages[Stage::kFilter] > 10000);
  CHECK(c.stages[Stage::kFilter] < 20000);
}
