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
