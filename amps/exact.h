// exact.h (internal): the two number types behind every decision of amps.
//
//   Approx  a double with a running bound of its rounding error; settles nearly all signs.
//   Int<N>  a two's-complement integer of N 64-bit limbs; settles the rest, always.
//
// A predicate is a polynomial of its input coordinates, written once as a template. Evaluated in Approx it is a filter whose
// error bound derives itself; evaluated in Int it is exact: finite doubles are integers times a common power of two, and a
// polynomial keeps its sign when all inputs are scaled by that power. Products widen the type (Int<A>·Int<B> = Int<A+B>), so
// no intermediate result can overflow.
//
// Departure from the usual floating-point expansions (Shewchuk 1997), which the design proposes: integers of fixed width need
// no memory management, recognise exact zeros at no extra cost (lattices, coplanar and cospherical input), are exact from the
// smallest denormal to the largest double instead of overflowing near 1e60, and do not depend on rounding modes, FMA
// contraction or excess precision.
#pragma once

#include "amps/base.h"

#include <cmath>
#include <cstdint>
#include <cstring>

namespace amps::detail {

/// Half an ulp of 1: relative error of one rounding to nearest.
inline constexpr double kUnitRoundoff = 0x1p-53;

inline int sign_of(double x) noexcept { return (x > 0) - (x < 0); }

/// A value and a bound of its absolute error. The bound is itself computed in floating point; the factor in `certain` and
/// `kTiny` cover the roundings of the bound and underflow: each operation adds at most a few relative 2^-53 to the bound, and
/// expressions here are below 2^7 operations deep, so 1 + 2^-40 is ample.
struct Approx {
  double value = 0;
  double error = 0;

  /// More than one operation can lose to underflow, gradual or flushed to zero.
  static constexpr double kTiny = 0x1p-1020;

  Approx() = default;
  Approx(double v) noexcept : value(v) {}  // NOLINT: exact, implicit by design
  Approx(double v, double e) noexcept : value(v), error(e) {}

  /// Sign if the bound decides it, else 0. False on NaN and infinity, so overflow goes to the exact stage by itself.
  int certain_sign() const noexcept {
    const double bound = error * (1 + 0x1p-40);
    return value > bound ? 1 : (-value > bound ? -1 : 0);
  }

  friend Approx operator+(const Approx& a, const Approx& b) noexcept {
    const double v = a.value + b.value;
    return {v, a.error + b.error + (kUnitRoundoff * std::fabs(v) + kTiny)};
  }
  friend Approx operator-(const Approx& a, const Approx& b) noexcept {
    const double v = a.value - b.value;
    return {v, a.error + b.error + (kUnitRoundoff * std::fabs(v) + kTiny)};
  }
  friend Approx operator*(const Approx& a, const Approx& b) noexcept {
    const double v = a.value * b.value;
    return {v,
            std::fabs(a.value) * b.error + a.error * (std::fabs(b.value) + b.error) + (kUnitRoundoff * std::fabs(v) + kTiny)};
  }
  Approx operator-() const noexcept { return {-value, error}; }
};

// Integers of fixed width

/// a·b = high·2^64 + the result, from 32-bit halves.
inline std::uint64_t multiply_wide_portable(std::uint64_t a, std::uint64_t b, std::uint64_t& high) noexcept {
  const std::uint64_t a0 = a & 0xffffffffu, a1 = a >> 32, b0 = b & 0xffffffffu, b1 = b >> 32;
  const std::uint64_t p00 = a0 * b0, p01 = a0 * b1, p10 = a1 * b0;
  const std::uint64_t middle = (p00 >> 32) + (p01 & 0xffffffffu) + (p10 & 0xffffffffu);
  high = a1 * b1 + (p01 >> 32) + (p10 >> 32) + (middle >> 32);
  return (middle << 32) | (p00 & 0xffffffffu);
}

#if defined(__SIZEOF_INT128__)
__extension__ typedef unsigned __int128 UInt128;
inline std::uint64_t multiply_wide(std::uint64_t a, std::uint64_t b, std::uint64_t& high) noexcept {
  const UInt128 p = static_cast<UInt128>(a) * b;
  high = static_cast<std::uint64_t>(p >> 64);
  return static_cast<std::uint64_t>(p);
}
#else
inline std::uint64_t multiply_wide(std::uint64_t a, std::uint64_t b, std::uint64_t& high) noexcept {
  return multiply_wide_portable(a, b, high);
}
#endif

/// Two's complement, least significant limb first. Sums keep the wider width: callers leave head room (see ExactScale).
template <int N>
struct Int {
  std::uint64_t limb[static_cast<std::size_t>(N)];

  int sign() const noexcept {
    if (static_cast<std::int64_t>(limb[N - 1]) < 0) return -1;
    std::uint64_t any = 0;
    for (int k = 0; k < N; ++k) any |= limb[k];
    return any != 0;
  }

  Int operator-() const noexcept {
    Int result;
    std::uint64_t carry = 1;
    for (int k = 0; k < N; ++k) {
      result.limb[k] = ~limb[k] + carry;
      carry = carry & static_cast<std::uint64_t>(result.limb[k] == 0);
    }
    return result;
  }
};

template <int N>
int sign_of(const Int<N>& x) noexcept {
  return x.sign();
}

/// The same value in W ≥ N limbs.
template <int W, int N>
Int<W> widen(const Int<N>& a) noexcept {
  static_assert(W >= N, "widen cannot narrow");
  Int<W> result;
  for (int k = 0; k < N; ++k) result.limb[k] = a.limb[k];
  const std::uint64_t fill = static_cast<std::int64_t>(a.limb[N - 1]) < 0 ? ~std::uint64_t{0} : 0;
  for (int k = N; k < W; ++k) result.limb[k] = fill;
  return result;
}

template <int N>
Int<N> add_equal_width(const Int<N>& a, const Int<N>& b, std::uint64_t flip, std::uint64_t carry) noexcept {
  Int<N> result;
  for (int k = 0; k < N; ++k) {
    const std::uint64_t y = b.limb[k] ^ flip;
    const std::uint64_t s = a.limb[k] + y;
    const std::uint64_t t = s + carry;
    carry = static_cast<std::uint64_t>(s < y) | static_cast<std::uint64_t>(t < s);
    result.limb[k] = t;
  }
  return result;
}

template <int A, int B>
auto operator+(const Int<A>& a, const Int<B>& b) noexcept {
  constexpr int N = A > B ? A : B;
  return add_equal_width(widen<N>(a), widen<N>(b), 0, 0);
}

template <int A, int B>
auto operator-(const Int<A>& a, const Int<B>& b) noexcept {
  constexpr int N = A > B ? A : B;
  return add_equal_width(widen<N>(a), widen<N>(b), ~std::uint64_t{0}, 1);
}

template <int A, int B>
Int<A + B> operator*(const Int<A>& a, const Int<B>& b) noexcept {
  Int<A + B> result;
  for (int k = 0; k < A + B; ++k) result.limb[k] = 0;
  for (int i = 0; i < A; ++i) {
    std::uint64_t carry = 0;
    for (int j = 0; j < B; ++j) {
      std::uint64_t high;
      std::uint64_t low = multiply_wide(a.limb[i], b.limb[j], high);
      low += carry;
      high += static_cast<std::uint64_t>(low < carry);
      result.limb[i + j] += low;
      carry = high + static_cast<std::uint64_t>(result.limb[i + j] < low);
    }
    result.limb[i + B] = carry;
  }
  // Read as unsigned, a negative factor is too large by 2^(64·width): take the other factor off the upper limbs.
  const auto take_off = [&result](int at, const std::uint64_t* limbs, int count, std::uint64_t mask) {
    std::uint64_t borrow = 0;
    for (int k = 0; k < count; ++k) {
      const std::uint64_t y = limbs[k] & mask;
      const std::uint64_t x = result.limb[at + k];
      const std::uint64_t d = x - y;
      result.limb[at + k] = d - borrow;
      borrow = static_cast<std::uint64_t>(x < y) | static_cast<std::uint64_t>(d < borrow);
    }
  };
  take_off(A, b.limb, B, static_cast<std::int64_t>(a.limb[A - 1]) < 0 ? ~std::uint64_t{0} : 0);
  take_off(B, a.limb, A, static_cast<std::int64_t>(b.limb[B - 1]) < 0 ? ~std::uint64_t{0} : 0);
  return result;
}

/// a = mantissa · 2^exponent to within relative 2^-52, |mantissa| in [0.5, 1) or 0: ratios of huge integers without overflow.
template <int N>
double mantissa_exponent(const Int<N>& a, int& exponent) noexcept {
  const bool negative = a.sign() < 0;
  const Int<N> m = negative ? -a : a;
  int top = N - 1;
  while (top > 0 && m.limb[top] == 0) --top;
  double v = static_cast<double>(m.limb[top]);
  if (top > 0) v += static_cast<double>(m.limb[top - 1]) * 0x1p-64;
  v = std::frexp(v, &exponent);
  exponent += 64 * top;
  return negative ? -v : v;
}

#if defined(__SIZEOF_INT128__)
#define AMPS_HAS_INT128 1
__extension__ typedef __int128 Int128;

/// A factor of up to 60 bits, and what becomes of products of two and of three of them in the machine's own words: four times
/// as fast as Int<1> and its products.
struct Factor {
  std::int64_t value;
};
/// high·2^64 + low, for sums of a few products of three factors.
struct Product3 {
  Int128 high, low;
  friend Product3 operator+(const Product3& a, const Product3& b) noexcept { return {a.high + b.high, a.low + b.low}; }
  friend Product3 operator-(const Product3& a, const Product3& b) noexcept { return {a.high - b.high, a.low - b.low}; }
};
inline Int128 operator*(Factor a, Factor b) noexcept { return Int128{a.value} * b.value; }
inline Product3 operator*(Factor a, Int128 b) noexcept {
  return {Int128{a.value} * static_cast<std::int64_t>(b >> 64), Int128{a.value} * Int128{static_cast<std::uint64_t>(b)}};
}
inline Int<2> to_limbs(Int128 a) noexcept { return {{static_cast<std::uint64_t>(a), static_cast<std::uint64_t>(a >> 64)}}; }
inline Int<3> to_limbs(const Product3& a) noexcept {
  const Int128 high = a.high + (a.low >> 64);
  return {{static_cast<std::uint64_t>(a.low), static_cast<std::uint64_t>(high), static_cast<std::uint64_t>(high >> 64)}};
}
#endif

// From doubles to integers

/// A finite non-zero double as odd·2^lowest, with its highest bit.
struct BinaryExponents {
  int lowest;
  int highest;
};

inline int count_trailing_zeros(std::uint64_t x) noexcept {
#if defined(__GNUC__) || defined(__clang__)
  return __builtin_ctzll(x);
#else
  int n = 0;
  for (; (x & 1) == 0; x >>= 1) ++n;
  return n;
#endif
}

/// |x| = mantissa · 2^exponent with an integer mantissa below 2^53; x finite.
inline std::uint64_t integer_mantissa(double x, int& exponent) noexcept {
  std::uint64_t bits;
  std::memcpy(&bits, &x, sizeof bits);
  const int biased = static_cast<int>((bits >> 52) & 0x7ff);
  const std::uint64_t fraction = bits & ((std::uint64_t{1} << 52) - 1);
  exponent = (biased == 0 ? 1 : biased) - 1075;
  return biased == 0 ? fraction : fraction | (std::uint64_t{1} << 52);
}

/// Finds the common power of two of a predicate's input, and the number of bits it needs: coordinates are multiples of
/// 2^unit below 2^(unit + bits) in magnitude, weights multiples of 2^(2·unit) below 2^(2·unit + 2·bits).
class ExactScale {
 public:
  void coordinate(double x) noexcept { include(x, 1); }
  void weight(double w) noexcept { include(w, 2); }
  int unit() const noexcept { return lowest_ > highest_ ? 0 : lowest_; }
  int bits() const noexcept { return lowest_ > highest_ ? 1 : highest_ - lowest_ + 1; }

 private:
  void include(double x, int degree) noexcept {
    int exponent;
    const std::uint64_t m = integer_mantissa(x, exponent);
    if (m == 0) return;
    const int zeros = count_trailing_zeros(m);
    int low = exponent + zeros;
    // m < 2^53 with bit 52 set for normal numbers; for denormals this overestimates, which is harmless.
    int high = exponent + 52;
    if (degree == 2) {  // floor and ceiling of the halves
      low = (low >= 0 ? low : low - 1) / 2;
      high = high >= 0 ? high / 2 + 1 : high / 2;
    }
    if (low < lowest_) lowest_ = low;
    if (high > highest_) highest_ = high;
  }
  int lowest_ = 1 << 20;
  int highest_ = -(1 << 20);
};

/// x as a multiple of 2^unit; x must be one and fit.
template <int N>
Int<N> to_int(double x, int unit) noexcept {
  Int<N> result;
  for (int k = 0; k < N; ++k) result.limb[k] = 0;
  int exponent;
  std::uint64_t m = integer_mantissa(x, exponent);
  if (m == 0) return result;
  int shift = exponent - unit;
  if (shift < 0) {
    m >>= -shift;  // the zeros ExactScale has counted
    shift = 0;
  }
  const int at = shift / 64;
  const int by = shift % 64;
  result.limb[at] = m << by;
  if (by != 0 && at + 1 < N) result.limb[at + 1] = m >> (64 - by);
  return std::signbit(x) ? -result : result;
}

/// The widths exact predicates are compiled for: coordinates of up to this many bits fit Int<N> with the head room that sums
/// of the predicates need (derived at each formula; the worst, 2^6, is met by 64·N − 6 bits). The last one covers all
/// finite doubles: bits from 2^-1074 to 2^1023 are 2098 ≤ 64·34 − 6.
inline constexpr int kNarrowLimbs = 1;
inline constexpr int kMiddleLimbs = 2;
inline constexpr int kWideLimbs = 34;
constexpr int usable_bits(int limbs) { return 64 * limbs - 6; }

}  // namespace amps::detail
