#include "amps/base.h"

#include "amps/shapes.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <limits>
#include <string>

using amps::detail::number_text;

TEST_CASE("base: numbers in texts have six digits, and small ones are not zero") {
  CHECK(number_text(0) == "0");
  CHECK(number_text(-1e-9) == "-1e-09");
  CHECK(number_text(0.1) == "0.1");
  CHECK(number_text(1.0 / 3) == "0.333333");
  CHECK(number_text(123456789) == "1.23457e+08");
  CHECK(number_text(12000) == "12000");
  CHECK(number_text(std::numeric_limits<double>::infinity()) == "inf");
}

TEST_CASE("base: an error tells the small number that is wrong") {
  try {
    amps::uniform_sizing(amps::make_square(1), -1e-9);
    FAIL("a negative radius was taken");
  } catch (const amps::Error& error) {
    CHECK(std::string(error.what()).find("-1e-09") != std::string::npos);
  }
}
