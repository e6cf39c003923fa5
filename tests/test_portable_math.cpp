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

TEST_CASE("portable_math: turns, arcs, exponentials and powers are within a few units in the last place of long doubles") {
  constexpr double kUnit = std::numeric_limits<double>::epsilon();
  Rng rng(2);
  for (int i = 0; i < 20'000; ++i) {
    const double x = (2 * rng.uniform() - 1) * (i % 2 == 0 ? 10 : 1e6);
    const auto [sine, cosine] = detail::portable_sine_cosine(x);
    const auto true_sine = static_cast<double>(std::sin(static_cast<long double>(x)));
    const auto true_cosine = static_cast<double>(std::cos(static_cast<long double>(x)));
    CHECK(std::abs(sine - true_sine) <= 2 * kUnit * std::abs(true_sine));
    CHECK(std::abs(cosine - true_cosine) <= 2 * kUnit * std::abs(true_cosine));

    const double scale = std::ldexp(1.0, static_cast<int>(rng.below(600)) - 300);
    const double a = scale * (2 * rng.uniform() - 1), b = scale * (2 * rng.uniform() - 1) * (i % 3 == 0 ? 1e-3 : 1);
    const auto angle = static_cast<double>(std::atan2(static_cast<long double>(a), static_cast<long double>(b)));
    CHECK(std::abs(detail::portable_arc_tangent(a, b) - angle) <= 2 * kUnit * std::abs(angle));

    const double c = i % 2 == 0 ? 2 * rng.uniform() - 1 : 1 - std::ldexp(rng.uniform(), -static_cast<int>(rng.below(50)));
    const auto arc = static_cast<double>(std::acos(static_cast<long double>(c)));
    CHECK(std::abs(detail::portable_arc_cosine(c) - arc) <= 3 * kUnit * std::abs(arc));

    const double y = (2 * rng.uniform() - 1) * (i % 2 == 0 ? 1 : 700);
    const auto exponential = static_cast<double>(std::exp(static_cast<long double>(y)));
    CHECK(std::abs(detail::portable_exp(y) - exponential) <= 2 * kUnit * exponential);

    const double base = 100 * rng.uniform(), power = 2 * rng.uniform() - 1;
    if (base > 0) CHECK(detail::portable_power(base, power) == doctest::Approx(std::pow(base, power)).epsilon(1e-14));
  }
}

TEST_CASE("portable_math: zeros, axes and ends") {
  const auto none = detail::portable_sine_cosine(0);
  CHECK(none.sine == 0);
  CHECK(none.cosine == 1);
  const double half_turn = detail::kPi, quarter = half_turn / 2;
  CHECK(detail::portable_arc_tangent(0, 0) == 0);
  CHECK(detail::portable_arc_tangent(0, 1) == 0);
  CHECK(detail::portable_arc_tangent(1, 0) == quarter);
  CHECK(detail::portable_arc_tangent(-1, 0) == -quarter);
  CHECK(detail::portable_arc_tangent(0, -1) == half_turn);
  CHECK(detail::portable_arc_tangent(1, 1) == quarter / 2);
  CHECK(detail::portable_arc_tangent(-1, -1) == -3 * (quarter / 2));
  CHECK(detail::portable_arc_tangent(5e-324, 1) == 5e-324);
  CHECK(detail::portable_arc_cosine(1) == 0);
  CHECK(detail::portable_arc_cosine(0) == quarter);
  CHECK(detail::portable_arc_cosine(-1) == half_turn);
  CHECK(detail::portable_exp(0) == 1);
  CHECK(detail::portable_power(1, 0.3) == 1);
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
  CHECK(detail::portable_sine_cosine(2.5).sine == 0x1.326af0dcfcabp-1);
  CHECK(detail::portable_sine_cosine(100).cosine == 0x1.b981dbf665fdfp-1);
  CHECK(detail::portable_arc_tangent(2, -3) == 0x1.46dc09ec29433p+1);
  CHECK(detail::portable_arc_cosine(0.3) == 0x1.441f5ecbeef58p+0);
  CHECK(detail::portable_exp(-3.7) == 0x1.9511fc6871044p-6);
  CHECK(detail::portable_power(7, 0.4) == 0x1.16c5a341736f4p+1);
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
