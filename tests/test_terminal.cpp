// What the program shows of work that goes on: told times in, lines out, without a clock.
#include "examples/cli_terminal.h"

#include "kit/basics.h"

#include <doctest/doctest.h>

#include <cstddef>
#include <string>

namespace amps_test {

TEST_CASE("a pace is known after a second, and is that of the later half of the time") {
  Pace pace;
  CHECK(pace.rate() == 0);
  CHECK(pace.time_left().empty());
  pace.tell(0.5, 0.4);
  CHECK(pace.rate() == 0);
  // Fast at first; from half the time on, a hundredth in two seconds.
  pace.tell(2, 0.5);
  pace.tell(4, 0.51);
  CHECK(pace.rate() == doctest::Approx(0.005));
  CHECK(pace.time_left() == "1:38 left");
  // Each later half begins at the last time that is not after the middle: (3.5, .7) is after that of 6, (2, .5) is not.
  pace.tell(6, 0.9);
  CHECK(pace.rate() == doctest::Approx(0.4 / 4));
  CHECK(pace.time_left() == "0:01 left");
}

TEST_CASE("times left of hours, and those nobody would wait for") {
  Pace hours;
  hours.tell(0, 0);
  hours.tell(100, 0.01);
  CHECK(hours.time_left() == "2:45:00 left");
  Pace ages;
  ages.tell(0, 0);
  ages.tell(100, 1e-6);
  CHECK(ages.rate() > 0);
  CHECK(ages.time_left().empty());
  Pace standstill;
  standstill.tell(0, 0.5);
  standstill.tell(10, 0.5);
  CHECK(standstill.rate() == 0);
  CHECK(standstill.time_left().empty());
}

TEST_CASE("a line of the bar has stage, bar, percent, rate and time left, as far as its columns go") {
  Pace pace;
  pace.tell(0, 0);
  CHECK(bar_line("filling gaps", 0, pace, 79) == "filling gaps           [.....................]   0 %");
  pace.tell(10, 0.5);
  CHECK(bar_line("filling gaps", 0.5, pace, 79) ==
        "filling gaps           [##########...........]  50 %      5 %/s  0:10 left");
  pace.tell(20, 1);
  CHECK(bar_line("filling gaps", 1, pace, 79) == "filling gaps           [#####################] 100 %      5 %/s  0:00 left");
  CHECK(bar_line("filling gaps", 1, pace, 40) == "filling gaps           100 %      5 %/s ");
  for (std::size_t columns = 0; columns < 120; ++columns) {
    CHECK(bar_line("a stage with a name longer than its place", 0.3, pace, columns).size() <= columns);
  }
}

}  // namespace amps_test
