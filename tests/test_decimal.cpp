#include "amps/decimal.h"

#include <doctest/doctest.h>

#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>

using amps::Rng;
namespace detail = amps::detail;

namespace {

std::string slow_text(double x) {
  std::string text;
  detail::append_number_slowly(text, x);
  return text;
}

#if defined(__cpp_lib_to_chars) && __cpp_lib_to_chars >= 201611L
std::string text_of_library(double x) {
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof digits, x).ptr};
}
#else
std::string text_of_library(double x) { return slow_text(x); }
#endif

void check_text(double x) {
  for (const double y : {x, -x}) {
    const std::string text = slow_text(y);
    REQUIRE(text == text_of_library(y));
    REQUIRE(std::strtod(text.c_str(), nullptr) == y);
  }
}

double double_of(std::uint64_t bits) {
  double x;
  std::memcpy(&x, &bits, sizeof x);
  return x;
}

}  // namespace

TEST_CASE("decimal: numbers and their text") {
  CHECK(slow_text(0) == "0");
  CHECK(slow_text(-0.0) == "-0");
  CHECK(slow_text(0.1) == "0.1");
  CHECK(slow_text(-1.5) == "-1.5");
  CHECK(slow_text(1e-5) == "1e-05");
  CHECK(slow_text(0.001) == "0.001");
  CHECK(slow_text(0.0001) == "1e-04");
  CHECK(slow_text(100000) == "1e+05");
  CHECK(slow_text(123456) == "123456");
  CHECK(slow_text(1e23) == "1e+23");
  CHECK(slow_text(9007199254740993.0) == "9007199254740992");
  CHECK(slow_text(5e-324) == "5e-324");
  CHECK(slow_text(std::numeric_limits<double>::max()) == "1.7976931348623157e+308");
  CHECK(slow_text(0x1p-44) == "5.684341886080802e-14");  // below it doubles are twice as near: 16 digits do
}

TEST_CASE("decimal: the same text as the standard library's, where that has any") {
  Rng rng(1);
  for (int k = -1074; k <= 1023; ++k) {  // powers of two and what is next to them
    const double x = std::ldexp(1.0, k);
    check_text(x);
    check_text(std::nextafter(x, 0));
    check_text(std::nextafter(x, 1e308));
  }
  for (int k = 0; k <= 308; ++k) check_text(std::strtod(("1e" + std::to_string(k)).c_str(), nullptr));
  for (int i = 0; i < 20'000; ++i) {
    check_text(rng.uniform());
    check_text(std::ldexp(rng.uniform(), static_cast<int>(rng.below(200)) - 100));
    check_text(std::floor(std::ldexp(rng.uniform(), static_cast<int>(rng.below(90)))));  // integers, of too many digits as well
    check_text(static_cast<double>(rng.below(100'000)) / 1000);
    check_text(static_cast<float>(rng.uniform()));
    const double any = double_of(rng.next());
    if (std::isfinite(any)) check_text(any);
    check_text(double_of(rng.next() >> 12));  // denormal
  }
}
