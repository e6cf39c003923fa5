// portable_math.h (internal): the constants of angles, and functions whose values in <cmath> differ between platforms, in fixed
// series: the same bits everywhere, as long as nothing is contracted (contraction.h). Errors are a few units in the last place.
// No other file of amps calls those of <cmath> (tests/check_same_bits.cmake). What IEEE 754 rounds correctly is the same
// everywhere: the four operations and sqrt; floor, ceil, ldexp and frexp are exact.
#pragma once

#include "amps/base.h"

namespace amps::detail {

inline constexpr double kPi = 3.14159265358979323846;
inline constexpr double kRadiansPerDegree = kPi / 180;
inline constexpr double kDegreesPerRadian = 180 / kPi;

inline constexpr double to_radians(double angle_in_degrees) { return angle_in_degrees * kRadiansPerDegree; }
inline constexpr double to_degrees(double angle_in_radians) { return angle_in_radians * kDegreesPerRadian; }

/// sin x, |x| ≤ π/2.
double portable_sine(double x);

/// The cosine of an angle in [0, 180] degrees; exactly 0 for 90.
inline double portable_cosine(double angle_in_degrees) { return portable_sine(to_radians(90 - angle_in_degrees)); }

/// arcsin x, |x| ≤ 1.
double portable_arcsine(double x);

/// exp(2πi t) for any finite t: of t itself, exactly reduced to one turn.
struct Phase {
  double cosine, sine;
};
Phase portable_phase(double turns);

/// ln x, x > 0 and finite.
double portable_log(double x);

/// atanh(s)/s, |s| ≤ 0.172.
double portable_atanh_over(double s);

struct SineCosine {
  double sine, cosine;
};

/// Of an angle in radians, |x| ≤ 1e6.
SineCosine portable_sine_cosine(double x);

/// The angle of (x, y) in [−π, π], as std::atan2: 0 for (0, 0), and zeros have no sign. Finite coordinates below 1e308.
double portable_arc_tangent(double y, double x);

/// The angle in [0, π] of a cosine in [−1, 1].
double portable_arc_cosine(double cosine);

/// eˣ, |x| ≤ 700.
double portable_exp(double x);

/// xᵃ, x > 0 and finite, the result between 1e-300 and 1e300. The error grows with the logarithm of the result.
inline double portable_power(double x, double a) { return portable_exp(a * portable_log(x)); }

}  // namespace amps::detail
