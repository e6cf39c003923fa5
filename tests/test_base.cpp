#include "amps/base.h"

#include "kit/errors.h"

#include "amps/shapes.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <cmath>
#include <string>

namespace amps_test {

using amps::detail::number_text;

TEST_CASE("base: numbers in texts have six digits, and small ones are not zero") {
  CHECK(number_text(0) == "0");
  CHECK(number_text(-1e-9) == "-1e-09");
  CHECK(number_text(0.1) == "0.1");
  CHECK(number_text(1.0 / 3) == "0.333333");
  CHECK(number_text(123456789) == "1.23457e+08");
  CHECK(number_text(12000) == "12000");
  CHECK(number_text(kInfinity) == "inf");
}

TEST_CASE("base: sums over coordinates go from the first to the last") {
  using amps::Vec3;
  using namespace amps::detail;
  const Vec3 ones(1, 1, 1), rounded(0x1p53, 1, 1), kept(1, 1, 0x1p53);  // 2^53 + 1 is no double
  CHECK(dot(rounded, ones) == 0x1p53);
  CHECK(dot(kept, ones) == 0x1p53 + 2);
  CHECK(sum(rounded) == 0x1p53);
  CHECK(sum(kept) == 0x1p53 + 2);
  CHECK(squared_norm(Vec3(0x1p27, 1, 1)) == 0x1p54);
  CHECK(squared_norm(Vec3(std::sqrt(2.0), std::sqrt(2.0), 0x1p27)) == 0x1p54 + 4);
  CHECK(norm(Vec3(2, 3, 6)) == 7);
  CHECK(normalized(Vec3(0, 4, 0)) == Vec3(0, 1, 0));
  CHECK(normalized(Vec3::Zero()) == Vec3(0, 0, 0));
}

TEST_CASE("base: lengths whose squares are out of range") {
  using amps::Vec3;
  using namespace amps::detail;
  for (const int exponent : {-1070, -600, -500, 0, 500, 600, 1020}) {
    const double scale = std::ldexp(1.0, exponent);
    CHECK(stable_norm(scale * Vec3(2, -3, 6)) == 7 * scale);
    CHECK(stable_normalized(scale * Vec3(2, -3, 6)) == stable_normalized(Vec3(2, -3, 6)));
    CHECK(stable_normalized(scale * Vec3(0, -1, 0)) == Vec3(0, -1, 0));
  }
  CHECK(stable_norm(Vec3::Zero()) == 0);
  CHECK(stable_normalized(Vec3::Zero()) == Vec3(0, 0, 0));
  CHECK(stable_norm(Vec3(1, kInfinity, 1)) == kInfinity);
  CHECK(std::isnan(stable_norm(Vec3(1, std::nan(""), 1))));
}

TEST_CASE("base: an error tells the small number that is wrong") {
  const std::string text = error_text([] { amps::uniform_sizing(amps::make_square(1), -1e-9); });
  CHECK(text.find("-1e-09") != std::string::npos);
}

}  // namespace amps_test
