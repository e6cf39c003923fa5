#include "amps/exact.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cfenv>
#include <cfloat>
#include <cmath>
#include <limits>
#include <vector>

using amps::Rng;
using amps::detail::Approx;
using amps::detail::ExactScale;
using amps::detail::Int;
using amps::detail::to_int;

namespace {

/// The oracle: sign and magnitude in 16-bit digits, schoolbook, no code shared with Int.
class Big {
 public:
  Big() = default;
  static Big from_double(double x, int unit) {  // x / 2^unit, must be an integer
    Big r;
    int e;
    double m = std::frexp(std::fabs(x), &e);
    std::uint64_t bits = static_cast<std::uint64_t>(std::ldexp(m, 53));
    int shift = e - 53 - unit;
    for (; shift < 0; ++shift) {
      REQUIRE(bits % 2 == 0);
      bits /= 2;
      if (bits == 0) break;
    }
    for (; bits != 0; bits >>= 16) r.digit_.push_back(bits & 0xffffu);
    for (int k = 0; k < shift; ++k) r.digit_ = add(r.digit_, r.digit_);
    r.negative_ = x < 0;
    return r.trim();
  }
  template <int N>
  static Big from_int(const Int<N>& a) {  // two's complement: −2^(64N−1)·top bit + the rest
    Big r, top;
    for (int k = 0; k < N; ++k) {
      std::uint64_t limb = a.limb[k];
      if (k == N - 1) limb &= ~(std::uint64_t{1} << 63);
      for (int d = 0; d < 4; ++d, limb >>= 16) r.digit_.push_back(limb & 0xffffu);
    }
    r.trim();
    if ((a.limb[N - 1] >> 63) == 0) return r;
    top.digit_.assign(static_cast<std::size_t>(4 * N), 0);
    top.digit_.back() = 0x8000u;
    return r - top;
  }
  friend Big operator+(const Big& a, const Big& b) {
    Big r;
    if (a.negative_ == b.negative_) {
      r.digit_ = add(a.digit_, b.digit_);
      r.negative_ = a.negative_;
    } else if (less(a.digit_, b.digit_)) {
      r.digit_ = subtract(b.digit_, a.digit_);
      r.negative_ = b.negative_;
    } else {
      r.digit_ = subtract(a.digit_, b.digit_);
      r.negative_ = a.negative_;
    }
    return r.trim();
  }
  Big operator-() const {
    Big r = *this;
    r.negative_ = !negative_;
    return r.trim();
  }
  friend Big operator-(const Big& a, const Big& b) { return a + -b; }
  friend Big operator*(const Big& a, const Big& b) {
    Big r;
    r.digit_.assign(a.digit_.size() + b.digit_.size(), 0);
    for (std::size_t i = 0; i < a.digit_.size(); ++i) {
      std::uint32_t carry = 0;
      for (std::size_t j = 0; j < b.digit_.size(); ++j) {
        carry += r.digit_[i + j] + a.digit_[i] * b.digit_[j];
        r.digit_[i + j] = carry & 0xffffu;
        carry >>= 16;
      }
      r.digit_[i + b.digit_.size()] = carry;
    }
    r.negative_ = a.negative_ != b.negative_;
    return r.trim();
  }
  friend bool operator==(const Big& a, const Big& b) { return a.negative_ == b.negative_ && a.digit_ == b.digit_; }
  int sign() const { return digit_.empty() ? 0 : (negative_ ? -1 : 1); }
  /// The number of bits of the magnitude.
  int bits() const {
    int n = static_cast<int>(digit_.size()) * 16;
    for (std::uint32_t top = digit_.empty() ? 0x8000u : digit_.back(); (top & 0x8000u) == 0; top <<= 1) --n;
    return n;
  }
  /// mantissa · 2^exponent, truncated after 64 bits.
  long double mantissa(int& exponent) const {
    long double m = 0;
    exponent = 0;
    const std::size_t n = digit_.size(), used = std::min<std::size_t>(n, 5);
    for (std::size_t k = 0; k < used; ++k) m = m * 65536 + static_cast<long double>(digit_[n - 1 - k]);
    exponent = 16 * static_cast<int>(n - used);
    return negative_ ? -m : m;
  }

 private:
  using Digits = std::vector<std::uint32_t>;
  Big& trim() {
    while (!digit_.empty() && digit_.back() == 0) digit_.pop_back();
    if (digit_.empty()) negative_ = false;
    return *this;
  }
  static bool less(const Digits& a, const Digits& b) {
    if (a.size() != b.size()) return a.size() < b.size();
    return std::lexicographical_compare(a.rbegin(), a.rend(), b.rbegin(), b.rend());
  }
  static Digits add(const Digits& a, const Digits& b) {
    Digits r;
    std::uint32_t carry = 0;
    for (std::size_t k = 0; k < std::max(a.size(), b.size()) || carry != 0; ++k) {
      carry += (k < a.size() ? a[k] : 0) + (k < b.size() ? b[k] : 0);
      r.push_back(carry & 0xffffu);
      carry >>= 16;
    }
    return r;
  }
  static Digits subtract(const Digits& a, const Digits& b) {
    Digits r;
    std::int32_t borrow = 0;
    for (std::size_t k = 0; k < a.size(); ++k) {
      std::int32_t d = static_cast<std::int32_t>(a[k]) - (k < b.size() ? static_cast<std::int32_t>(b[k]) : 0) - borrow;
      borrow = d < 0;
      r.push_back(static_cast<std::uint32_t>(d + (borrow << 16)));
    }
    return r;
  }
  Digits digit_;
  bool negative_ = false;
};

/// Random limbs with long runs of ones and zeros, where carries travel; the top two bits equal, so that a sum of two fits.
template <int N>
Int<N> random_int(Rng& rng) {
  Int<N> r;
  for (std::uint64_t& limb : r.limb) {
    switch (rng.below(5)) {
      case 0:
        limb = 0;
        break;
      case 1:
        limb = ~std::uint64_t{0};
        break;
      case 2:
        limb = std::uint64_t{1} << rng.below(64);
        break;
      case 3:
        limb = ~(std::uint64_t{1} << rng.below(64));
        break;
      default:
        limb = rng.next();
    }
  }
  std::uint64_t& top = r.limb[N - 1];
  top = static_cast<std::uint64_t>(static_cast<std::int64_t>(top << 1) >> 1);
  return r;
}

template <int A, int B>
void check_ring(int cases) {
  CAPTURE(A);
  CAPTURE(B);
  Rng rng(A * 100 + B);
  int failures = 0;
  for (int k = 0; k < cases; ++k) {
    const Int<A> a = random_int<A>(rng);
    const Int<B> b = random_int<B>(rng);
    const Big x = Big::from_int(a), y = Big::from_int(b);
    failures += !(Big::from_int(a + b) == x + y);
    failures += !(Big::from_int(a - b) == x - y);
    failures += !(Big::from_int(a * b) == x * y);
    failures += !(Big::from_int(-a) == -x);
    failures += !((a - a).sign() == 0);
    failures += !(a.sign() == x.sign());
    failures += !((a * b).sign() == x.sign() * y.sign());
    failures += !(Big::from_int(amps::detail::widen<A + 3>(a)) == x);
  }
  CHECK(failures == 0);
}

double random_double(Rng& rng, int lowest_exponent, int highest_exponent) {
  const int e =
      lowest_exponent + static_cast<int>(rng.below(static_cast<std::uint64_t>(highest_exponent - lowest_exponent + 1)));
  const double m = rng.below(4) == 0 ? 1.0 : 1.0 + rng.uniform();
  return std::ldexp(rng.below(2) == 0 ? m : -m, e);
}

template <int N>
void check_round_trip(double x, int unit) {
  const Big big = Big::from_double(x, unit);
  const Int<N> a = to_int<N>(x, unit);
  CHECK(Big::from_int(a) == big);
  if (x == 0) return;
  int exponent;
  const double m = amps::detail::mantissa_exponent(a, exponent);
  CHECK(std::fabs(m) >= 0.5);
  CHECK(std::fabs(m) < 1.0);
  CHECK(std::ldexp(m, exponent + unit) == x);
}

}  // namespace

TEST_CASE("exact: multiply_wide and its portable version are the 128-bit product") {
  Rng rng(1);
  int failures = 0;
  for (int k = 0; k < 100000; ++k) {
    const std::uint64_t a = random_int<1>(rng).limb[0], b = k % 2 == 0 ? rng.next() : random_int<1>(rng).limb[0];
    Int<2> x{{a, 0}}, y{{b, 0}};
    const Big product = Big::from_int(x) * Big::from_int(y);
    std::uint64_t high1, high2;
    const std::uint64_t low1 = amps::detail::multiply_wide(a, b, high1);
    const std::uint64_t low2 = amps::detail::multiply_wide_portable(a, b, high2);
    failures += !(Big::from_int(Int<3>{{low1, high1, 0}}) == product);
    failures += low1 != low2 || high1 != high2;
  }
  CHECK(failures == 0);
}

TEST_CASE("exact: Int is a ring, for all widths the predicates use") {
  check_ring<1, 1>(100000);
  check_ring<2, 1>(20000);
  check_ring<1, 2>(20000);
  check_ring<2, 2>(20000);
  check_ring<3, 2>(10000);
  check_ring<4, 2>(10000);
  check_ring<6, 4>(5000);
  check_ring<6, 6>(5000);
  check_ring<4, 1>(5000);  // coverage: scaled_power, in the narrow, middle and wide widths
  check_ring<5, 5>(5000);
  check_ring<8, 2>(5000);
  check_ring<10, 10>(2000);
  check_ring<34, 34>(300);
  check_ring<68, 34>(200);
  check_ring<102, 68>(50);
  check_ring<272, 68>(20);
  check_ring<170, 170>(20);
}

#if defined(__SIZEOF_INT128__)
TEST_CASE("exact: Int<1> and Int<2> are int64 and int128") {
  __extension__ typedef __int128 Int128;
  Rng rng(3);
  const auto as_int128 = [](const Int<2>& a) {
    return static_cast<Int128>((static_cast<amps::detail::UInt128>(a.limb[1]) << 64) | a.limb[0]);
  };
  int failures = 0;
  for (int k = 0; k < 100000; ++k) {
    const Int<1> a = random_int<1>(rng), b = random_int<1>(rng);
    const Int<2> wide = random_int<2>(rng);
    const Int128 x = static_cast<std::int64_t>(a.limb[0]), y = static_cast<std::int64_t>(b.limb[0]);
    failures += as_int128(a * b) != x * y;
    failures += static_cast<Int128>(static_cast<std::int64_t>((a - b).limb[0])) != x - y;
    failures += as_int128(wide + a) != as_int128(wide) + x;
    failures += as_int128(wide - a * b) != as_int128(wide) - x * y;
  }
  CHECK(failures == 0);
}
#endif

TEST_CASE("exact: to_int and mantissa_exponent give back every finite double") {
  constexpr double kDenormal = std::numeric_limits<double>::denorm_min();
  for (const double x :
       {0.0, -0.0, kDenormal, -kDenormal, 3 * kDenormal, DBL_MIN, DBL_MIN - kDenormal, DBL_MAX, -DBL_MAX, 1.0, -1.0}) {
    check_round_trip<34>(x, -1074);
  }
  Rng rng(4);
  for (int k = 0; k < 2000; ++k) {
    check_round_trip<34>(random_double(rng, -1022, 1023), -1074);
    check_round_trip<34>(std::ldexp(random_double(rng, 0, 0), -1030 - static_cast<int>(rng.below(44))), -1074);
    const double narrow = random_double(rng, 52, 57);
    check_round_trip<1>(narrow, 0);
    check_round_trip<2>(random_double(rng, 52, 121), 0);
    // Trailing zeros below the unit.
    check_round_trip<1>(std::ldexp(1.0, static_cast<int>(rng.below(58))), 0);
  }
}

TEST_CASE("exact: ExactScale counts bits enough, at and around every width boundary") {
  using amps::detail::usable_bits;
  Rng rng(5);
  for (const int width : {usable_bits(1), usable_bits(2), 2098}) {
    for (int k = 0; k < 2000; ++k) {
      // Extremes of a coordinate set that spans about `width` bits, and a weight that spans about twice as many.
      const int span = std::min(width + static_cast<int>(rng.below(5)) - 2, 2098);
      const int low = width > 2000 ? -1074 : static_cast<int>(rng.below(200)) - 100;
      const double least = std::ldexp(1.0, low);
      const double most = std::ldexp(1.0 + rng.uniform(), low + span - 1);
      const int weight_low = std::max(2 * low, -1074);
      const double weight = std::ldexp(1.0 + rng.uniform(), std::min(weight_low + 52 + static_cast<int>(rng.below(60)), 1023));
      if (!std::isfinite(most)) continue;
      ExactScale scale;
      scale.coordinate(least);
      scale.coordinate(-most);
      if (k % 2 == 0) scale.weight(weight);
      // from_double requires the value to be a multiple of the unit.
      CHECK(Big::from_double(least, scale.unit()).bits() <= scale.bits());
      CHECK(Big::from_double(most, scale.unit()).bits() <= scale.bits());
      if (k % 2 == 0) CHECK(Big::from_double(weight, 2 * scale.unit()).bits() <= 2 * scale.bits());
      CHECK(scale.bits() <= usable_bits(amps::detail::kWideLimbs));
    }
  }
  // Not wastefully many: a 52-bit lattice with small weights is narrow.
  ExactScale lattice;
  for (const double x : {1.0, -3.0, 0x1p52 - 1}) lattice.coordinate(x);
  lattice.weight(2.0);
  CHECK(lattice.bits() <= 53);
  // Weights alone, at both ends of the range.
  for (const double w : {std::numeric_limits<double>::denorm_min(), DBL_MAX, 2.0, 0.5, 3.0, 0x1p-1073}) {
    ExactScale scale;
    scale.weight(w);
    CHECK(Big::from_double(w, 2 * scale.unit()).bits() <= 2 * scale.bits());
    CHECK(scale.bits() <= 55);
  }
  ExactScale nothing;
  nothing.coordinate(0.0);
  nothing.weight(-0.0);
  CHECK(nothing.bits() == 1);
}

TEST_CASE("exact: the bound of Approx contains the true value") {
  // A random expression over doubles that are multiples of 2^-40: the truth in Int, scaled by 2^40 a factor.
  Rng rng(6);
  int decided = 0, wrong = 0, outside = 0;
  for (int k = 0; k < 20000; ++k) {
    double x[6];
    for (double& v : x) {
      v = static_cast<double>(static_cast<std::int64_t>(rng.next() >> (11 + rng.below(40)))) * 0x1p-40;
      if (rng.below(2) == 0) v = -v;
    }
    if (rng.below(2) == 0) x[3] = x[0] * (1 + 0x1p-50);  // cancellation
    if (rng.below(3) == 0) x[4] = x[1];
    const auto expression = [](const auto& a, const auto& b, const auto& c, const auto& d, const auto& e, const auto& f) {
      return (a - d) * (b - e) + (a + c) * (f - b) - (d * e - a * b);
    };
    const Approx approx = expression(Approx(x[0]), Approx(x[1]), Approx(x[2]), Approx(x[3]), Approx(x[4]), Approx(x[5]));
    Int<2> n[6];
    const int unit = -60;
    bool exact = true;
    for (int m = 0; m < 6; ++m) {
      exact = exact && std::ldexp(x[m], -unit) == std::floor(std::ldexp(x[m], -unit));
      n[m] = to_int<2>(x[m], unit);
    }
    if (!exact) continue;
    const auto truth = expression(n[0], n[1], n[2], n[3], n[4], n[5]);
    const auto scaled = [&](double v) { return to_int<34>(v, -1074); };
    // truth · 2^(2·unit) against value ± error, all as multiples of 2^-1074.
    const Int<34> shifted = [&] {
      Int<34> r = amps::detail::widen<34>(truth);
      for (int s = 0; s < 1074 + 2 * unit; ++s) r = r + r;
      return r;
    }();
    const Int<34> difference = shifted - scaled(approx.value);
    const Int<34> bound = scaled(approx.error * (1 + 0x1p-40));
    outside += (bound - difference).sign() < 0 || (bound + difference).sign() < 0;
    if (const int sign = approx.certain_sign()) {
      ++decided;
      wrong += sign != truth.sign();
    }
  }
  CHECK(outside == 0);
  CHECK(wrong == 0);
  CHECK(decided > 5000);
}

TEST_CASE("exact: Approx is uncertain about overflow, NaN and underflow") {
  const Approx huge(1e200), tiny(1e-200);
  CHECK((huge * huge).certain_sign() == 0);
  CHECK((huge * huge - huge * huge).certain_sign() == 0);
  CHECK((tiny * tiny).certain_sign() == 0);
  CHECK((tiny * tiny - tiny * tiny).certain_sign() == 0);
  CHECK((huge * tiny).certain_sign() == 1);
  CHECK((-huge).certain_sign() == -1);
  CHECK(Approx(std::numeric_limits<double>::denorm_min()).certain_sign() == 1);
}

TEST_CASE("exact: require_exact_arithmetic accepts rounding to nearest and refuses the other modes") {
  CHECK_NOTHROW(amps::detail::require_exact_arithmetic());
  for (const int mode : {FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO}) {
    if (std::fesetround(mode) != 0) continue;
    bool refused = false;
    try {
      amps::detail::require_exact_arithmetic();
    } catch (const amps::Error& error) {
      refused = error.code() == amps::ErrorCode::kEnvironment;
    }
    std::fesetround(FE_TONEAREST);
    CHECK(refused);
  }
}

TEST_CASE("exact: mantissa_exponent is accurate for integers of any width") {
  Rng rng(8);
  for (int k = 0; k < 3000; ++k) {
    const Int<6> a = random_int<6>(rng);
    if (a.sign() == 0) continue;
    int exponent, expected_exponent;
    const long double value = amps::detail::mantissa_exponent(a, exponent);
    const long double expected = Big::from_int(a).mantissa(expected_exponent);
    const long double ratio = std::ldexp(value, exponent) / std::ldexp(expected, expected_exponent);
    CHECK(std::fabs(ratio - 1) <= 0x1p-51L);
  }
}
