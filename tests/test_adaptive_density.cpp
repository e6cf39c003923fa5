// Sampling with radii that vary: darts fall with density 1/r².
#include "amps/sampling.h"

#include "kit/meshes.h"
#include "kit/samples.h"
#include "kit/statistics.h"

#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace amps_test {

namespace {

/// Which of the `cuts`² equal parts of its facet a point is in, and where the centre of part k is.
std::size_t part_of(const Vec3& b, Index cuts) {
  const Index i = std::min(static_cast<Index>(b[1] * cuts), cuts - 1), j = std::min(static_cast<Index>(b[2] * cuts), cuts - 1);
  const bool downward = (b[1] * cuts - i) + (b[2] * cuts - j) > 1;
  Index before = 0;
  for (Index row = 0; row < j; ++row) before += 2 * (cuts - row) - 1;
  return static_cast<std::size_t>(before + 2 * i + (downward ? 1 : 0));
}

/// Oracle: ∫1/r² over each part of a facet in units of the facet's area, by the midpoint rule on a fine lattice; the error
/// falls with the square of the step, so two steps give a better value and a bound.
std::vector<double> density_of_parts(const Vec3& radii, Index cuts) {
  const auto rule = [&](Index fine) {
    std::vector<double> sum(static_cast<std::size_t>(cuts * cuts), 0.0);
    const double step = 1.0 / (fine * cuts);
    for (Index j = 0; j < fine * cuts; ++j) {
      for (Index i = 0; i + j < fine * cuts; ++i) {
        for (const double third : {1.0 / 3, 2.0 / 3}) {
          if (third > 0.5 && i + j + 1 == fine * cuts) continue;
          const double u = (i + third) * step, v = (j + third) * step;
          const Vec3 b(1 - u - v, u, v);
          const double r = b.dot(radii);
          sum[part_of(b, cuts)] += step * step / (r * r);
        }
      }
    }
    return sum;
  };
  const std::vector<double> coarse = rule(32), fine = rule(64);
  std::vector<double> result(coarse.size());
  for (std::size_t k = 0; k < result.size(); ++k) {
    result[k] = fine[k] + (fine[k] - coarse[k]) / 3;
    REQUIRE(std::fabs(fine[k] - coarse[k]) < 5e-3 * fine[k]);
  }
  return result;
}

/// Counts of samples in the parts of all facets against ∫ρ. Parts that expect few are put together.
double density_score(const Mesh& mesh, const Values& radii, const std::vector<std::pair<Index, Vec3>>& samples, Index cuts) {
  const std::vector<double> areas = amps::facet_areas(mesh);
  std::vector<double> expected, observed;
  for (Index f = 0; f < rows(mesh.triangles); ++f) {
    const Vec3 at_corners(radii[mesh.triangles(f, 0)], radii[mesh.triangles(f, 1)], radii[mesh.triangles(f, 2)]);
    for (const double part : density_of_parts(at_corners, cuts)) expected.push_back(part * areas[at(f)]);
  }
  double total = 0;
  for (const double e : expected) total += e;
  observed.assign(expected.size(), 0);
  for (const auto& [facet, b] : samples) {
    observed[at(facet * cuts * cuts) + part_of(b, cuts)] += 1;
  }
  std::vector<double> pooled_expected(1, 0), pooled_observed(1, 0);
  for (std::size_t k = 0; k < expected.size(); ++k) {
    pooled_expected.back() += expected[k] / total * static_cast<double>(samples.size());
    pooled_observed.back() += observed[k];
    if (pooled_expected.back() > 10 && k + 1 < expected.size()) {
      pooled_expected.push_back(0);
      pooled_observed.push_back(0);
    }
  }
  if (pooled_expected.back() < 10) {
    const double e = pooled_expected.back(), o = pooled_observed.back();
    pooled_expected.pop_back();
    pooled_observed.pop_back();
    pooled_expected.back() += e;
    pooled_observed.back() += o;
  }
  REQUIRE(pooled_expected.size() > 8);
  return chi_square_score(pooled_observed, pooled_expected);
}

}  // namespace

TEST_CASE("adaptive: the first dart has density 1/r², in large triangles too") {
  struct Case {
    Mesh mesh;
    Values radii;
    Index cuts;
  };
  std::vector<Case> cases;
  const Mesh triangle = one_triangle({0, 0, 0}, {1, 0, 0}, {0.2, 0.9, 0});
  for (const Values& radii :
       {values_of({1, 16, 16}), values_of({16, 1, 1}), values_of({4, 1, 16}), values_of({1, 1.9, 1.3}), values_of({2, 1, 2})}) {
    cases.push_back({triangle, radii, 8});
  }
  const Mesh sphere = amps::make_sphere(20);
  Rng field_rng(4);
  cases.push_back({sphere, at_vertices(sphere, [&](const Vec3&) { return std::pow(16.0, field_rng.uniform()); }), 2});
  for (const Case& c : cases) {
    SamplingOptions options = with_sizing(amps::vertex_sizing(c.mesh, c.radii).scaled(1e3));  // the first dart is the only one
    options.max_rejections = 1;
    std::vector<std::pair<Index, Vec3>> first;
    for (std::uint64_t seed = 1; seed <= 20000; ++seed) {
      options.seed = seed;
      const SampleSet set = amps::throw_darts(c.mesh, options).samples;
      first.emplace_back(facet_of(set, 0), barycentric_of(set, 0));
    }
    const double score = density_score(c.mesh, c.radii, first, c.cuts);
    CHECK(std::fabs(score) < 3.5);
    const Values flat = constant_values(rows(c.radii), 1);
    CHECK(density_score(c.mesh, flat, first, c.cuts) > 10);  // it would notice darts of uniform density
  }
}

TEST_CASE("adaptive: across 1:1000 within a triangle darts fall by ∫1/r² in closed form") {
  // r = 1 + 999x over the unit right triangle: ∫ between two x is ∫ (1 − x)/(1 + 999x)² dx.
  const Mesh mesh = one_triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  const double g = 999;
  const auto integral = [&](double x) {  // antiderivative, from 0
    const double r = 1 + g * x;
    return (1 + 1 / g) / g * (1 - 1 / r) - std::log(r) / (g * g);
  };
  SamplingOptions options = with_sizing(amps::vertex_sizing(mesh, values_of({1, 1000, 1})).scaled(100));
  options.max_rejections = 1;
  std::vector<double> edges = {0};
  for (double r = 1.5; r < 400; r *= 1.5) edges.push_back((r - 1) / g);
  edges.push_back(1);
  const int draws = 30000;
  std::vector<double> observed(edges.size() - 1, 0), expected;
  for (std::size_t k = 0; k + 1 < edges.size(); ++k) {
    expected.push_back(draws * (integral(edges[k + 1]) - integral(edges[k])) / integral(1));
  }
  REQUIRE(*std::min_element(expected.begin(), expected.end()) > 5);
  for (std::uint64_t seed = 1; seed <= draws; ++seed) {
    options.seed = seed;
    const double x = amps::throw_darts(mesh, options).samples.positions(0, 0);
    observed[static_cast<std::size_t>(std::upper_bound(edges.begin() + 1, edges.end() - 1, x) - edges.begin() - 1)] += 1;
  }
  CHECK(std::fabs(chi_square_score(observed, expected)) < 3.5);
}

TEST_CASE("adaptive: early darts have density 1/r²") {
  const Mesh mesh = amps::make_sphere(80);
  const Values radii = at_vertices(mesh, [](const Vec3& x) { return 1 + 7.5 * (1 + x.z()); });
  for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
    SamplingOptions options = with_sizing(amps::vertex_sizing(mesh, radii).scaled(3e-3), 1, rule);
    std::vector<std::pair<Index, Vec3>> early;
    for (std::uint64_t seed = 1; seed <= 25; ++seed) {
      options.seed = seed;
      options.max_rejections = 3;  // ends while the surface is nearly empty: hardly any dart has met another
      const SampleSet set = amps::throw_darts(mesh, options).samples;
      for (Index s = 0; s < set.size(); ++s) early.emplace_back(facet_of(set, s), barycentric_of(set, s));
    }
    REQUIRE(early.size() > 2000);
    CHECK(density_score(mesh, radii, early, 1) < 3.5);
  }
}

}  // namespace amps_test
