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

TEST_CASE("darts: drawn many at a time, or in halves, they are those drawn one by one") {
  using amps::detail::Sample;
  const amps::Mesh torus = amps::make_torus(1.0, 0.4, 30, 15);
  const amps::MeshView mesh(torus);
  const std::vector<double> areas = amps::facet_areas(mesh);
  std::vector<double> at_vertices;
  for (amps::Index v = 0; v < mesh.num_vertices(); ++v) at_vertices.push_back(0.1 + 0.09 * std::fabs(mesh.vertices[v][0]));
  const amps::SizingField simple = amps::vertex_sizing(mesh, at_vertices);
  // Fine near one point: facets have lattices of several pieces.
  const amps::SizingField fine =
      amps::function_sizing(mesh, [](const amps::SurfacePoint& x) { return 0.001 + (x.position - Vec3(1, 0, 0.3)).norm(); });
  REQUIRE(simple.num_pieces() == static_cast<std::size_t>(mesh.num_facets()));
  REQUIRE(fine.num_pieces() > simple.num_pieces());
  using Radii = amps::detail::WantedRadii;
  const auto rule = amps::ConflictRule::kMax;
  for (const Radii& radii : {Radii(0.1, rule), Radii(simple, rule), Radii(fine, rule)}) {
    const amps::detail::SurfaceDarts darts(mesh, areas, radii);
    Rng one(11), many(11), halves(11);
    std::array<Sample, 16> of_many, of_halves;
    std::vector<Rng> after(16, many), after_halves(16, many);
    for (std::size_t k = 0; k < 5000; ++k) {
      const std::size_t at = k % 16;
      if (at == 0) {
        darts.draw(many, 16, of_many.data(), after.data());
        darts.draft(halves, 16, of_halves.data(), after_halves.data());
        darts.finish(7, of_halves.data());
        darts.finish(9, of_halves.data() + 7);
      }
      const Sample alone = darts.draw(one);
      for (const Sample* other : {&of_many[at], &of_halves[at]}) {
        REQUIRE(alone.at.facet == other->at.facet);
        REQUIRE(alone.at.barycentric == other->at.barycentric);
        REQUIRE(alone.at.position == other->at.position);
        REQUIRE(alone.radius == other->radius);
      }
      REQUIRE(Rng(one).next() == Rng(after[at]).next());
      REQUIRE(Rng(one).next() == Rng(after_halves[at]).next());
      // It lies where it says, and wants what the radii say there.
      const Vec3& b = alone.at.barycentric;
      REQUIRE(std::fabs(b.sum() - 1) < 1e-14);
      const Vec3 x =
          b[0] * mesh.corner(alone.at.facet, 0) + b[1] * mesh.corner(alone.at.facet, 1) + b[2] * mesh.corner(alone.at.facet, 2);
      REQUIRE(alone.at.position == x);
      REQUIRE(alone.radius == radii.at(alone.at));
    }
  }
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
