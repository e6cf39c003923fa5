#define AMPS_OWN_SOURCE
#include "amps/portable_math.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>

namespace amps::detail {
namespace {

constexpr double kInverseFactorials[] = {1.0,
                                         1.0,
                                         1.0 / 2,
                                         1.0 / 6,
                                         1.0 / 24,
                                         1.0 / 120,
                                         1.0 / 720,
                                         1.0 / 5040,
                                         1.0 / 40320,
                                         1.0 / 362880,
                                         1.0 / 3628800,
                                         1.0 / 39916800,
                                         1.0 / 479001600,
                                         1.0 / 6227020800,
                                         1.0 / 87178291200,
                                         1.0 / 1307674368000,
                                         1.0 / 20922789888000,
                                         1.0 / 355687428096000,
                                         1.0 / 6402373705728000};

}  // namespace

double portable_sine(double x) {
  // The remainder of the series is below x²³/23! < 2e-18.
  double sum = 0;
  for (int n = 21; n >= 1; n -= 2) sum = 1 - x * x / ((n + 1.0) * (n + 2.0)) * sum;
  return x * sum;
}

double portable_arcsine(double x) {
  // Halving the angle three times, sin(α/2) = sin α / √(2 (1 + cos α)), leaves |x| ≤ sin(π/16) < 0.196: the remainder of the
  // series, whose coefficients are below 0.1/k, is less than 0.196²⁹/100 < 1e-21.
  constexpr int kHalvings = 3, kTerms = 14;
  for (int k = 0; k < kHalvings; ++k) x /= std::sqrt(2 * (1 + std::sqrt((1 - x) * (1 + x))));
  double sum = 0;  // Σ (2k)! / (4^k k!² (2k + 1)) x^(2k), each term from the next
  for (int k = kTerms; k >= 1; --k) sum = (2 * k - 1.0) / (2.0 * k) * x * x * (1.0 / (2 * k + 1) + sum);
  return (1 << kHalvings) * (x + x * sum);
}

Phase portable_phase(double turns) {
  // Subtractions of whole turns and of quarters are exact but for turns < 0 of less than a unit in the last place of 1.
  const double t = turns - std::floor(turns);
  const int quarter = static_cast<int>(4 * t + 0.5);
  const double angle = 2 * kPi * (t - 0.25 * quarter);  // in [−π/4, π/4]
  const double s = portable_sine(angle), c = portable_sine(kPi / 2 - std::abs(angle));
  switch (quarter % 4) {
    case 0:
      return {c, s};
    case 1:
      return {-s, c};
    case 2:
      return {-c, -s};
    default:
      return {s, -c};
  }
}

double portable_atanh_over(double s) {
  // The remainder of the series is below s²⁴/25 < 1e-19.
  const double q = s * s;
  double sum = 0;
  for (int n = 23; n >= 1; n -= 2) sum = sum * q + 1.0 / n;
  return sum;
}

double portable_log(double x) {
  // ln 2 · e + 2 atanh((m − 1)/(m + 1)) with m in [√½, √2].
  constexpr double kLn2 = 0.693147180559945309417232, kSqrtHalf = 0.70710678118654752;
  int exponent = 0;
  double m = std::frexp(x, &exponent);
  if (m < kSqrtHalf) {
    m *= 2;
    --exponent;
  }
  const double s = (m - 1) / (m + 1);
  return exponent * kLn2 + 2 * s * portable_atanh_over(s);
}

SineCosine portable_sine_cosine(double x) {
  // Quarter turns are taken off in three parts of 33, 33 and 53 bits: the first two times a number of 20 bits are exact.
  constexpr double kHigh = 0x1.921fb544p+0, kMiddle = 0x1.0b4611a6p-34, kLow = 0x1.3198a2e037073p-69;
  const double quarters = std::floor(x / (kPi / 2) + 0.5);
  const double r = x - quarters * kHigh - quarters * kMiddle - quarters * kLow;
  // |r| ≤ π/4: the remainders are below r¹⁹/19! < 1e-19 and r¹⁸/18! < 3e-18.
  const double q = r * r;
  double sine = 0, cosine = 0;
  for (std::size_t k = std::size(kInverseFactorials) - 2; k >= 3; k -= 2) {
    sine = kInverseFactorials[k] - q * sine;
    cosine = kInverseFactorials[k + 1] - q * cosine;
  }
  sine = r - r * q * sine;
  cosine = 1 - q / 2 + q * q * cosine;
  switch (static_cast<std::int64_t>(quarters) & 3) {
    case 0:
      return {sine, cosine};
    case 1:
      return {cosine, -sine};
    case 2:
      return {-sine, -cosine};
    default:
      return {-cosine, sine};
  }
}

double portable_arc_tangent(double y, double x) {
  // atan(small/large), off the nearest of 0, ¼, ½, ¾ and 1: tan(a − b) = (tan a − tan b)/(1 + tan a tan b).
  constexpr double kArcs[] = {0, 0x1.f5b75f92c80ddp-3, 0x1.dac670561bb4fp-2, 0x1.4978fa3269ee1p-1, 0x1.921fb54442d18p-1};
  const double large = std::max(std::abs(x), std::abs(y)), small = std::min(std::abs(x), std::abs(y));
  double angle = 0;
  if (small > 0) {
    const double nearest = std::floor(small / large * 4 + 0.5), tangent = nearest / 4;
    const double t = (small - tangent * large) / (large + tangent * small);
    // |t| ≤ ⅛: the remainder is below t¹⁹/19 < 4e-19.
    const double q = t * t;
    double sum = 0;
    for (int n = 17; n >= 3; n -= 2) sum = 1.0 / n - q * sum;
    angle = kArcs[static_cast<int>(nearest)] + (t - t * q * sum);
  }
  if (std::abs(y) > std::abs(x)) angle = kPi / 2 - angle;
  if (x < 0) angle = kPi - angle;
  return y < 0 ? -angle : angle;
}

double portable_arc_cosine(double cosine) { return portable_arc_tangent(std::sqrt((1 - cosine) * (1 + cosine)), cosine); }

double portable_exp(double x) {
  // Powers of two are taken off, ln 2 in two parts: the first of 32 bits, times an exponent exact.
  constexpr double kHigh = 0x1.62e42feep-1, kLow = 0x1.a39ef35793c76p-33;
  const double exponent = std::floor(x / kHigh + 0.5);
  const double r = x - exponent * kHigh - exponent * kLow;
  // |r| ≤ ½ ln 2: the remainder is below r¹⁹/19! < 1e-25.
  double sum = 0;
  for (std::size_t k = std::size(kInverseFactorials); k-- > 2;) sum = kInverseFactorials[k] + r * sum;
  return std::ldexp(1 + (r + r * r * sum), static_cast<int>(exponent));
}

}  // namespace amps::detail
