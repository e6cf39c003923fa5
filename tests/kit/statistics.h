// statistics.h: whether counts are what chance makes of expected ones.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace amps_test {

/// Σ (observed − expected)²/expected, and how many standard deviations that is above its mean (Wilson & Hilferty 1931).
inline double chi_square_score(const std::vector<double>& observed, const std::vector<double>& expected) {
  double chi2 = 0;
  for (std::size_t k = 0; k < observed.size(); ++k)
    chi2 += (observed[k] - expected[k]) * (observed[k] - expected[k]) / expected[k];
  const double v = static_cast<double>(observed.size() - 1);
  return (std::cbrt(chi2 / v) - (1 - 2 / (9 * v))) / std::sqrt(2 / (9 * v));
}

inline double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

}  // namespace amps_test
