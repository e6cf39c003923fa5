// Digits are made by exact integers: Burger & Dybvig, "Printing Floating-Point Numbers Quickly and Accurately", PLDI 1996, free
// format. The rules beyond it, plain or not and ties to even, are those of std::to_chars.
#define AMPS_OWN_SOURCE
#include "amps/decimal.h"

#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>

#if defined(__cpp_lib_to_chars) && __cpp_lib_to_chars >= 201611L
#define AMPS_HAS_DOUBLE_TO_CHARS 1
#else
#define AMPS_HAS_DOUBLE_TO_CHARS 0
#endif

namespace amps::detail {
namespace {

/// An integer below 2^1152. The greatest here are 2·10·2^1024 and 2·10^325 < 2^1081.
class DecimalInteger {
 public:
  explicit DecimalInteger(std::uint64_t value)
      : limbs_{static_cast<std::uint32_t>(value), static_cast<std::uint32_t>(value >> 32)} {
    size_ = value >> 32 != 0 ? 2 : value != 0 ? 1 : 0;
  }

  void multiply(std::uint32_t factor) {
    std::uint64_t carry = 0;
    for (std::size_t k = 0; k < size_; ++k) {
      carry += std::uint64_t{limbs_[k]} * factor;
      limbs_[k] = static_cast<std::uint32_t>(carry);
      carry >>= 32;
    }
    if (carry != 0) limbs_[size_++] = static_cast<std::uint32_t>(carry);
  }
  void multiply_by_power_of_two(int exponent) {
    for (; exponent >= 31; exponent -= 31) multiply(std::uint32_t{1} << 31);
    multiply(std::uint32_t{1} << exponent);
  }
  void multiply_by_power_of_ten(int exponent) {
    for (; exponent >= 9; exponent -= 9) multiply(1000000000);
    for (; exponent > 0; --exponent) multiply(10);
  }
  /// `other` must not be greater.
  void subtract(const DecimalInteger& other) {
    std::uint64_t borrow = 0;
    for (std::size_t k = 0; k < size_; ++k) {
      const std::uint64_t less = (k < other.size_ ? other.limbs_[k] : 0) + borrow;
      borrow = less > limbs_[k] ? 1 : 0;
      limbs_[k] = static_cast<std::uint32_t>(limbs_[k] - less);
    }
    while (size_ > 0 && limbs_[size_ - 1] == 0) --size_;
  }
  void add(const DecimalInteger& other) {
    std::uint64_t carry = 0;
    for (std::size_t k = 0; k < size_ || k < other.size_ || carry != 0; ++k) {
      if (k >= size_) limbs_[size_++] = 0;
      carry += std::uint64_t{limbs_[k]} + (k < other.size_ ? other.limbs_[k] : 0);
      limbs_[k] = static_cast<std::uint32_t>(carry);
      carry >>= 32;
    }
  }
  /// Negative, zero or positive as the difference is.
  int compared_to(const DecimalInteger& other) const {
    if (size_ != other.size_) return size_ < other.size_ ? -1 : 1;
    for (std::size_t k = size_; k-- > 0;) {
      if (limbs_[k] != other.limbs_[k]) return limbs_[k] < other.limbs_[k] ? -1 : 1;
    }
    return 0;
  }

 private:
  std::array<std::uint32_t, 36> limbs_;  // those from size_ on mean nothing
  std::size_t size_ = 0;
};

/// A positive double as the fraction numerator/denominator · 10^point, in [0.1, 1) · 10^point, and half the distances to the
/// doubles next to it, over the same denominator.
struct DecimalFraction {
  DecimalInteger numerator, denominator{1}, below{1}, above{1};
  bool even;  ///< its mantissa: ends of the interval belong to it
  int point = 0;

  explicit DecimalFraction(double value) : numerator(0) {
    constexpr int kDigits = 53, kMinExponent = -1074;
    int exponent = 0;
    const auto mantissa = static_cast<std::uint64_t>(std::ldexp(std::frexp(value, &exponent), kDigits));
    exponent -= kDigits;
    const int shift = exponent < kMinExponent ? kMinExponent - exponent : 0;  // of denormal numbers
    numerator = DecimalInteger(mantissa >> shift);
    exponent += shift;
    even = (mantissa >> shift) % 2 == 0;
    // Below a power of two doubles are twice as near as above, but for the least of full precision.
    const bool narrow = mantissa == std::uint64_t{1} << (kDigits - 1) && exponent > kMinExponent;
    const int doubled = narrow ? 2 : 1;
    numerator.multiply_by_power_of_two(doubled + (exponent > 0 ? exponent : 0));
    denominator.multiply_by_power_of_two(doubled + (exponent < 0 ? -exponent : 0));
    if (exponent > 0) below.multiply_by_power_of_two(exponent);
    above = below;
    if (narrow) above.multiply(2);
    // log10 2 · 1233/4096, rounded down: the point or one less.
    int bits = 0;
    std::frexp(value, &bits);
    point = ((bits - 1) * 1233 - (bits < 1 ? 4095 : 0)) / 4096;
    if (point >= 0) {
      denominator.multiply_by_power_of_ten(point);
    } else {
      for (DecimalInteger* part : {&numerator, &below, &above}) part->multiply_by_power_of_ten(-point);
    }
    while (reaches(denominator)) {
      denominator.multiply(10);
      ++point;
    }
  }

  /// Is `denominator` within the interval or below it?
  bool reaches(const DecimalInteger& bound) const {
    DecimalInteger sum = numerator;
    sum.add(above);
    const int sign = sum.compared_to(bound);
    return even ? sign >= 0 : sign > 0;
  }

  int next_digit() {
    for (DecimalInteger* part : {&numerator, &below, &above}) part->multiply(10);
    int digit = 0;
    for (; numerator.compared_to(denominator) >= 0; ++digit) numerator.subtract(denominator);
    return digit;
  }

  /// The shortest digits of the interval.
  std::string digits() {
    std::string text;
    for (;;) {
      const int digit = next_digit();
      const int sign = numerator.compared_to(below);
      const bool low = even ? sign <= 0 : sign < 0, high = reaches(denominator);
      text += static_cast<char>('0' + digit);
      if (!low && !high) continue;
      DecimalInteger twice = numerator;
      twice.multiply(2);
      const int half = twice.compared_to(denominator);
      if (high && (!low || half > 0 || (half == 0 && digit % 2 != 0))) ++text.back();
      return text;
    }
  }
};

}  // namespace

void append_number_slowly(std::string& out, double value) {
  if (std::signbit(value)) out += '-';
  value = std::abs(value);
  if (value == 0) {
    out += '0';
    return;
  }
  DecimalFraction shortest(value);
  std::string digits = shortest.digits();
  const int count = static_cast<int>(digits.size()), point = shortest.point, exponent = point - 1;
  const int with_exponent = count + (count > 1 ? 1 : 0) + (std::abs(exponent) >= 100 ? 5 : 4);
  const int plain = point <= 0 ? 2 - point + count : point < count ? count + 1 : point;
  if (plain > with_exponent) {
    out += digits[0];
    if (count > 1) out.append(1, '.').append(digits, 1);
    out += exponent < 0 ? "e-" : "e+";
    if (std::abs(exponent) < 10) out += '0';
    out += std::to_string(std::abs(exponent));
  } else if (point <= 0) {
    out.append("0.").append(static_cast<std::size_t>(-point), '0').append(digits);
  } else if (point < count) {
    out.append(digits, 0, static_cast<std::size_t>(point)).append(1, '.').append(digits, static_cast<std::size_t>(point));
  } else {
    // An integer: all its digits, also those that reading would not need.
    DecimalFraction exact(value);
    for (int k = exact.point; k < point; ++k) out += '0';
    for (int k = 0; k < exact.point; ++k) out += static_cast<char>('0' + exact.next_digit());
  }
}

void append_number(std::string& out, double value) {
#if AMPS_HAS_DOUBLE_TO_CHARS
  char digits[32];
  out.append(digits, std::to_chars(digits, digits + sizeof digits, value).ptr);
#else
  append_number_slowly(out, value);
#endif
}
#undef AMPS_HAS_DOUBLE_TO_CHARS

}  // namespace amps::detail
