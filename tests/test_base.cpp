#include "amps/base.h"

#include "kit/errors.h"

#include "amps/shapes.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

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

TEST_CASE("base: an error tells the small number that is wrong") {
  const std::string text = error_text([] { amps::uniform_sizing(amps::make_square(1), -1e-9); });
  CHECK(text.find("-1e-09") != std::string::npos);
}

}  // namespace amps_test
