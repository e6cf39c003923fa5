#include "amps/portable_math.h"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>

using amps::Rng;
namespace detail = amps::detail;

TEST_CASE("portable_math: sine and logarithm are within a few units in the last place of long doubles") {
  constexpr double kUnit = std::numeric_limits<double>::epsilon();
  Rng rng(1);
  for (int i = 0; i < 20'000; ++i) {
    const double x = (2 * rng.uniform() - 1) * detail::kPi / 2;
    const auto sine = static_cast<double>(std::sin(static_cast<long double>(x)));
    CHECK(std::abs(detail::portable_sine(x) - sine) <= 2 * kUnit * std::abs(sine));

    const double y = std::ldexp(1 + rng.uniform(), static_cast<int>(rng.below(2000)) - 1000);
    const auto logarithm = static_cast<double>(std::log(static_cast<long double>(y)));
    CHECK(std::abs(detail::portable_log(y) - logarithm) <= 4 * kUnit * std::abs(logarithm));

    const double s = 0.172 * (2 * rng.uniform() - 1);
    const auto atanh_over = static_cast<double>(std::atanh(static_cast<long double>(s)) / s);
    if (s != 0) CHECK(std::abs(detail::portable_atanh_over(s) - atanh_over) <= 2 * kUnit);
  }
  CHECK(detail::portable_sine(0) == 0);
  CHECK(detail::portable_log(1) == 0);
  CHECK(detail::portable_atanh_over(0) == 1);
}

TEST_CASE("portable_math: cosines of degrees; right angles have exactly none") {
  CHECK(detail::portable_cosine(90) == 0);
  CHECK(detail::portable_cosine(60) == doctest::Approx(0.5).epsilon(1e-15));
  CHECK(detail::portable_cosine(0) == doctest::Approx(1).epsilon(1e-15));
  CHECK(detail::portable_cosine(180) == -detail::portable_cosine(0));
  for (int angle = 0; angle <= 90; ++angle) CHECK(detail::portable_cosine(180 - angle) == -detail::portable_cosine(angle));
  CHECK(detail::to_degrees(detail::to_radians(30)) == doctest::Approx(30).epsilon(1e-15));
}

TEST_CASE("portable_math: values keep their bits") {
  CHECK(detail::portable_sine(0.7) == 0x1.49d6e694619b8p-1);
  CHECK(detail::portable_sine(1.5) == 0x1.feb7a9b2c6d8ap-1);
  CHECK(detail::portable_log(3) == 0x1.193ea7aad030ap+0);
  CHECK(detail::portable_log(1e-300) == -0x1.5963447f87fb5p+9);
  CHECK(detail::portable_atanh_over(0.1) == 0x1.00dbc60360a8bp+0);
}

TEST_CASE("portable_math: phases and arcsines are those of long doubles") {
  constexpr double kError = 6e-16;
  Rng rng(2);
  for (int i = 0; i < 20'000; ++i) {
    const double t = i < 100 ? (i - 50) / 8.0 : 20 * rng.uniform() - 10;
    const detail::Phase phase = detail::portable_phase(t);
    const long double angle = 2 * std::acos(-1.0L) * t;
    CHECK(std::abs(static_cast<double>(phase.cosine - std::cos(angle))) < kError);
    CHECK(std::abs(static_cast<double>(phase.sine - std::sin(angle))) < kError);
    const double x = i <= 100 ? (i - 50) / 50.0 : 2 * rng.uniform() - 1;
    CHECK(std::abs(static_cast<double>(detail::portable_arcsine(x) - std::asin(static_cast<long double>(x)))) < kError);
  }
  CHECK(detail::portable_phase(0.25).cosine == 0);
  CHECK(detail::portable_phase(-3.0).sine == 0);
  CHECK(detail::portable_arcsine(0) == 0);
}
