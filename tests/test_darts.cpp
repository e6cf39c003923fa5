#include "amps/darts.h"

#include "amps/shapes.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

using amps::Rng;
using amps::Vec3;
using amps::detail::AliasTable;
using amps::detail::density_barycentric;

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

TEST_CASE("darts: points of a triangle have density 1/r², from equal radii to 1:1000000") {
  // With r linear, in u = (share of corner 1) and v = (share of corner 2), radii a, a·q, a·q at the corners depend on u + v = t
  // alone: ∫ of 2t/(1 + g·t)², g = q − 1, is 2/g²·(ln(1 + g·t) + 1/(1 + g·t) − 1). Along the level lines the density is even.
  Rng rng(9);
  for (const double q : {1.0, 1.5, 2.0, 7.0, 100.0, 1e6}) {
    for (std::size_t small = 0; small < 3; ++small) {
      std::array<double, 3> radii = {3 * q, 3 * q, 3 * q};
      radii[small] = 3;
      const double g = q - 1;
      const auto share = [&](double t) { return g == 0 ? t * t : 2 / (g * g) * (std::log1p(g * t) + 1 / (1 + g * t) - 1); };
      constexpr int kBins = 12, kColumns = 4, kDraws = 40000;
      // Edges in t at even steps of the share, by bisection.
      std::vector<double> edge = {0};
      for (int k = 1; k < kBins; ++k) {
        double low = 0, high = 1;
        for (int step = 0; step < 60; ++step) {
          const double t = (low + high) / 2;
          (share(t) < share(1) * k / kBins ? low : high) = t;
        }
        edge.push_back(high);
      }
      std::vector<double> count(kBins * kColumns, 0);
      for (int draw = 0; draw < kDraws; ++draw) {
        const Vec3 b = density_barycentric(radii, rng);
        REQUIRE(b.minCoeff() >= 0);
        REQUIRE(std::fabs(b.sum() - 1) < 1e-15);
        const double u = b[static_cast<int>((small + 1) % 3)], v = b[static_cast<int>((small + 2) % 3)];
        const auto bin = std::upper_bound(edge.begin(), edge.end(), u + v) - edge.begin() - 1;
        const auto column = std::min<std::ptrdiff_t>(kColumns - 1, static_cast<std::ptrdiff_t>(kColumns * (u / (u + v))));
        count[static_cast<std::size_t>(bin * kColumns + column)] += 1;
      }
      const double expected = static_cast<double>(kDraws) / (kBins * kColumns), freedom = kBins * kColumns - 1;
      double chi2 = 0;
      for (const double c : count) chi2 += (c - expected) * (c - expected) / expected;
      CAPTURE(q);
      CHECK(chi2 < freedom + 4 * std::sqrt(2 * freedom));
    }
  }
}

TEST_CASE("darts: where one radius is wanted, each takes as many random numbers as it says") {
  const amps::Mesh torus = amps::make_torus();
  const amps::MeshView mesh(torus);
  const std::vector<double> areas = amps::facet_areas(mesh);
  const amps::detail::WantedRadii equal(0.1, amps::ConflictRule::kMax);
  const amps::detail::SurfaceDarts darts(mesh, areas, equal);
  REQUIRE(darts.draws_per_dart() > 0);
  Rng drawn(7), counted(7);
  for (int k = 0; k < 1000; ++k) {
    darts.draw(drawn);
    for (int i = 0; i < darts.draws_per_dart(); ++i) counted.next();
    REQUIRE(Rng(drawn).next() == Rng(counted).next());
  }
  std::vector<double> radii(static_cast<std::size_t>(mesh.num_vertices()), 0.1);
  radii[0] = 0.2;
  const amps::SizingField field = amps::vertex_sizing(mesh, radii);
  const amps::detail::WantedRadii graded(field, amps::ConflictRule::kMax);
  CHECK(amps::detail::SurfaceDarts(mesh, {}, graded).draws_per_dart() == 0);
}

TEST_CASE("darts: three different radii, by moments") {
  // E[r²] = area/∫ρ over radii a < b < c, and E[r³] = area·mean(r)/∫ρ: two moments that need no integral but ∫ρ itself cancels
  // in their quotient, the mean radius (a + b + c)/3.
  Rng rng(10);
  for (const std::array<double, 3>& radii : {std::array<double, 3>{1, 3, 9}, {9, 1, 2.5}, {1.1, 1.9, 1}, {40, 1, 39}}) {
    double second = 0, third = 0;
    for (int draw = 0; draw < 400000; ++draw) {
      const Vec3 b = density_barycentric(radii, rng);
      const double r = b[0] * radii[0] + b[1] * radii[1] + b[2] * radii[2];
      second += r * r;
      third += r * r * r;
    }
    CHECK(third / second == doctest::Approx((radii[0] + radii[1] + radii[2]) / 3).epsilon(0.01));
  }
}
