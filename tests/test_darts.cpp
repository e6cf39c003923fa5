#include "amps/darts.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

using amps::Rng;
using amps::detail::AliasTable;

TEST_CASE("alias table: frequencies follow the weights") {
  Rng rng(5);
  std::vector<double> weights = {0, 1, 2, 0, 5, 1e-3, 10, 0.5, 0, 7, 7, 7};
  for (int i = 0; i < 40; ++i) weights.push_back(rng.uniform());
  for (const double scale : {1.0, 1e300, 1e-300}) {
    std::vector<double> scaled = weights;
    double sum = 0;
    for (double& w : scaled) {
      sum += w;
      w *= scale;
    }
    const AliasTable table(scaled);
    std::vector<int> count(weights.size(), 0);
    const int draws = 1000000;
    for (int i = 0; i < draws; ++i) ++count[static_cast<std::size_t>(table.pick(rng))];
    double chi2 = 0, freedom = -1;
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const double expected = draws * weights[i] / sum;
      if (expected == 0) {
        CHECK(count[i] == 0);
        continue;
      }
      chi2 += (count[i] - expected) * (count[i] - expected) / expected;
      freedom += 1;
    }
    CHECK(chi2 < freedom + 4 * std::sqrt(2 * freedom));
  }
}

TEST_CASE("alias table: single entries, zeros among thirds, and what it refuses") {
  Rng rng(6);
  const AliasTable one(std::vector<double>{1e-308});
  for (int i = 0; i < 100; ++i) CHECK(one.pick(rng) == 0);

  std::vector<double> thirds;  // sums that round, with zeros that must never come up
  for (int i = 0; i < 3000; ++i) thirds.push_back(i % 3 == 0 ? 0 : i % 3 == 1 ? 1.0 / 3 : 0.1);
  const AliasTable table(thirds);
  for (int i = 0; i < 200000; ++i) REQUIRE(table.pick(rng) % 3 != 0);

  for (int trial = 0; trial < 2000; ++trial) {  // the same on tables that round each in its own way
    std::vector<double> weights(5 + rng.below(20), 0.0);
    for (std::size_t i = 3; i < weights.size(); ++i) weights[i] = rng.uniform();
    const AliasTable random(weights);
    for (int i = 0; i < 100; ++i) REQUIRE(random.pick(rng) >= 3);
  }

  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  for (const std::vector<double>& bad : {std::vector<double>{}, {0, 0}, {1, -1}, {1, nan}, {1, infinity}}) {
    try {
      const AliasTable refused(bad);
      FAIL("accepted");
    } catch (const amps::Error& e) {
      CHECK(e.code() == amps::ErrorCode::kInvalidArgument);
    }
  }
}
