#define AMPS_OWN_SOURCE
#include "amps/portable_math.h"

#include <cmath>

namespace amps::detail {

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

}  // namespace amps::detail
