#include "amps/sampling.h"

#include "kit/maximality.h"
#include "kit/models.h"
#include "kit/sites.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>
#include <vector>

namespace amps_test {

TEST_CASE("sampling: sets are maximal Poisson-disk sets, by certificate and by oracle") {
  for (const auto& model : procedural_models()) {
    CAPTURE(model.name);
    const auto& [name, mesh, radius] = model;
    const SamplingResult result = amps::sample(mesh, with_radius(radius));
    CHECK(result.report.radius == radius);
    CHECK(result.samples.size() > 2500);
    CHECK(result.samples.size() < 5500);
    CHECK(result.report.gap_samples > result.samples.size() / 20);
    CHECK(result.report.darts > static_cast<std::uint64_t>(result.report.dart_samples));
    CHECK(result.report.attempts == 1);
    CHECK(result.report.dart_samples + result.report.gap_samples == result.samples.size());
    check_maximal(mesh, result);
  }
}

TEST_CASE("sampling: the oracles notice a missing sample and a pair that is too near") {
  const Mesh mesh = amps::make_sphere(320);
  const SampleSet set = amps::sample(mesh, with_radius(0.15)).samples;
  REQUIRE(covered_by_oracle(mesh, set));
  REQUIRE(set.size() > 300);
  for (Index gone = 0; gone < set.size(); gone += 50) {
    const SampleSet less = selected(set, [gone](Index s) { return s != gone; });
    CHECK(!covered_by_oracle(mesh, less));
    const MaximalityReport report = amps::verify_maximal(mesh, less);
    CHECK(!report.maximal());
    CHECK(report.poisson_disk());
    CHECK(report.gaps > 0);
    CHECK(report.gap_area > 0);
    CHECK(report.gap_area < 3.15 * 0.15 * 0.15);
  }
  SampleSet near = set;
  near.positions.row(17) = (sample_at(near, 42) + Vec3(0.15 * (1 - 1e-6), 0, 0)).transpose();
  CHECK(separation_of_all_pairs(near) < 1 - 1e-9);
  CHECK(!amps::verify_maximal(mesh, near).poisson_disk());
}

TEST_CASE("sampling: verify_maximal measures coverage and separation as they are") {
  const Mesh mesh = amps::make_square(3);
  const double root2 = std::sqrt(2.0);
  MaximalityReport one = amps::verify_maximal(mesh, one_sample({0.5, 0.5, 0}, 0.5));
  CHECK(one.worst_coverage == doctest::Approx(root2).epsilon(1e-14));
  CHECK((one.worst_point - Vec3(0.5, 0.5, 0)).cwiseAbs() == Vec3(0.5, 0.5, 0));  // a corner of the square
  CHECK(one.worst_separation == kInfinity);
  CHECK(one.gap_area == doctest::Approx(1 - kPi / 4).epsilon(1e-12));
  CHECK(one.poisson_disk());
  CHECK(!one.maximal());
  CHECK(amps::verify_maximal(mesh, one_sample({0.5, 0.5, 0}, root2 / 2 * (1 + 1e-12))).maximal());
  CHECK(amps::verify_maximal(mesh, one_sample({0.5, 0.5, 0}, root2 / 2 * (1 + 1e-12))).gaps == 0);
  CHECK(!amps::verify_maximal(mesh, one_sample({0.5, 0.5, 0}, root2 / 2 * (1 - 2e-9))).maximal());
  // Above the surface, the ball still counts as a ball in space.
  CHECK(amps::verify_maximal(mesh, one_sample({0.5, 0.5, 1}, 1)).worst_coverage ==
        doctest::Approx(std::sqrt(1.5)).epsilon(1e-14));

  SampleSet three = bare_set(points_of({{0.25, 0.5, 0}, {0.75, 0.5, 0}, {0.5, 0.9, 0}}), values_of({0.3, 0.6, 0.1}));
  // Each pair over the greater of its radii: 0.5/0.6, and √(0.0625 + 0.16)/0.6 for the second and third.
  CHECK(amps::verify_maximal(mesh, three).worst_separation == doctest::Approx(std::sqrt(0.2225) / 0.6).epsilon(1e-12));
  three.positions.row(2) = sample_at(three, 0).transpose();
  CHECK(amps::verify_maximal(mesh, three).worst_separation == 0);
}

TEST_CASE("sampling: worst separation of disks of many radii agrees with all pairs") {
  Rng rng(5);
  const Mesh mesh = amps::make_cube(2);
  for (int round = 0; round < 20; ++round) {
    CAPTURE(round);
    const WeightedPoints disks = drawn(60, [&rng] {
      const Vec3 x = random_point(rng);
      return WeightedPoint{x.x(), x.y(), x.z(), std::pow(10.0, -3 * rng.uniform())};
    });
    const SampleSet set = bare_set(positions_of(disks), weights_of(disks));
    CHECK(amps::verify_maximal(mesh, set).worst_separation == doctest::Approx(separation_of_all_pairs(set)).epsilon(1e-12));
  }
}

TEST_CASE("sampling: same seed same bits, for any number of threads; another seed, another set") {
  const Mesh mesh = amps::make_torus();
  SamplingOptions options = with_radius(0.06, 42);
  const SamplingResult first = amps::sample(mesh, options);
  for (const unsigned threads : {1u, 2u, 5u, 0u}) {
    CAPTURE(threads);
    run_on(options, threads);
    const SamplingResult again = amps::sample(mesh, options);
    CHECK(same_set(first.samples, again.samples));
    CHECK(again.report.darts == first.report.darts);
    CHECK(again.report.dart_samples == first.report.dart_samples);
    const MaximalityReport a = amps::verify_maximal(mesh, first.samples),
                           b = amps::verify_maximal(mesh, first.samples, on_threads(threads));
    CHECK(same_bits(a.worst_coverage, b.worst_coverage));
    CHECK(same_bits(a.worst_separation, b.worst_separation));
  }
  const SamplingResult other = amps::sample(mesh, with_radius(0.06, 43));
  CHECK(!same_set(first.samples, other.samples));
  CHECK(!same_bits(sample_at(first.samples, 0), sample_at(other.samples, 0)));
  // The darts come first, in another order than they were thrown.
  const SampleSet darts = amps::throw_darts(mesh, with_radius(0.06, 42)).samples;
  const SampleSet of_first = head(first.samples, first.report.dart_samples);
  CHECK(!same_set(darts, of_first));
  CHECK(same_set(sorted_by_position(darts), sorted_by_position(of_first)));
  CHECK(same_set(amps::sample(mesh, with_count(700, 9)).samples, amps::sample(mesh, with_count(700, 9)).samples));
}

TEST_CASE("sampling: sets large enough for darts and floods on several threads have the same bits on each number of them") {
  const Mesh mesh = amps::make_torus(1, 0.4, 96, 48);
  const amps::SizingField graded = amps::vertex_sizing(mesh, [&mesh] {
    std::vector<double> radii;
    for (Index v = 0; v < rows(mesh.vertices); ++v) radii.push_back(0.03 + 0.01 * mesh.vertices(v, 0));
    return radii;
  }());
  for (const bool by_field : {false, true}) {
    for (const amps::Neighborhood neighborhood : {amps::Neighborhood::kSpace, amps::Neighborhood::kSurface}) {
      CAPTURE(by_field);
      CAPTURE(static_cast<int>(neighborhood));
      SamplingOptions options;
      if (by_field) {
        options.sizing = graded;
      } else {
        options.radius = 0.026;
      }
      options.neighborhood = neighborhood;
      options.seed = 5;
      const SamplingResult one = amps::sample(mesh, options);
      CHECK(one.report.dart_samples > 6000);
      for (const unsigned threads : {2u, 3u}) {
        run_on(options, threads);
        const SamplingResult several = amps::sample(mesh, options);
        CHECK(same_set(one.samples, several.samples));
        CHECK(several.report.darts == one.report.darts);
      }
    }
  }
}

TEST_CASE("sampling: target_count is met within 1 %") {
  for (const Index count : {50, 200, 1000, 5000}) {
    CAPTURE(count);
    for (const Mesh& mesh : {amps::make_square(), amps::make_sphere(1280), amps::make_knot(), amps::make_cube(2)}) {
      CAPTURE(rows(mesh.triangles));
      const SamplingResult result = amps::sample(mesh, with_count(count));
      CHECK(std::fabs(result.samples.size() - count) <= 0.01 * count);
      CHECK(result.report.attempts >= 1);
      CHECK(result.report.radius > 0);
      const MaximalityReport report = amps::verify_maximal(mesh, result.samples);
      CHECK(report.maximal());
      CHECK(report.poisson_disk());
    }
  }
}

TEST_CASE("sampling: a handful of samples") {
  for (const Mesh& mesh :
       {amps::make_square(), amps::make_sphere(320), amps::make_torus(1.0, 0.4, 24, 12), moebius_strip(24, 1)}) {
    CAPTURE(rows(mesh.triangles));
    for (Index count = 1; count <= 10; ++count) {
      CAPTURE(count);
      const SamplingResult result = amps::sample(mesh, with_count(count));
      check_maximal(mesh, result);
      CHECK(std::abs(result.samples.size() - count) <= 2);
    }
  }
}

TEST_CASE("sampling: a radius greater than the mesh makes one sample") {
  const Mesh tiny = one_triangle({0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0});
  const SamplingResult one = amps::sample(tiny, with_radius(1));
  CHECK(one.samples.size() == 1);
  CHECK(one.report.gap_samples == 0);
  check_maximal(tiny, one);
  for (const double radius : {2.01, 1e3}) {
    const SamplingResult result = amps::sample(amps::make_sphere(320), with_radius(radius));
    CHECK(result.samples.size() == 1);
    check_maximal(amps::make_sphere(320), result);
  }
}

TEST_CASE("sampling: thin sheets, non-manifold edges, soups and one-sided surfaces") {
  // Three triangles around one edge, of no common orientation.
  const Mesh book =
      mesh_of({{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {-0.5, 0.8, 0}, {-0.5, -0.8, 0}}, {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}});
  const std::vector<NamedMesh> meshes = {{"sheets at 0.01 r", two_sheets(1e-3)},  {"sheets at 0.9 r", two_sheets(0.09)},
                                         {"sheets that coincide", two_sheets(0)}, {"book", book},
                                         {"soup", random_soup(50, 21)},           {"moebius", moebius_strip(40, 1)}};
  for (const auto& model : meshes) {
    CAPTURE(model.name);
    const auto& [name, mesh] = model;
    const SamplingResult coarse = amps::sample(mesh, with_radius(0.1));
    check_maximal(mesh, coarse);
    check_maximal(mesh, amps::sample(mesh, with_radius(0.03)));
  }
}

TEST_CASE("sampling: facets without area and isolated vertices change nothing") {
  const Mesh mesh = amps::make_sphere(320);
  const Index a = mesh.triangles(0, 0), b = mesh.triangles(0, 1);
  const Mesh spoilt = with_vertices(with_facets(mesh, {{a, a, b}, {5, 5, 5}}), {{50, 50, 50}});
  const SamplingResult result = amps::sample(spoilt, with_radius(0.1));
  check_maximal(spoilt, result);
  CHECK(*std::max_element(result.samples.facets.begin(), result.samples.facets.end()) < rows(mesh.triangles));
}

TEST_CASE("sampling: any scale and place") {
  const Mesh mesh = amps::make_torus(1.0, 0.4, 30, 16);
  const SamplingResult original = amps::sample(mesh, with_radius(0.1, 8));
  for (const int exponent : {-332, -100, -20, 20, 100, 332}) {
    CAPTURE(exponent);
    const double factor = std::ldexp(1.0, exponent);
    const Mesh other = scaled(mesh, factor);
    const SamplingResult result = amps::sample(other, with_radius(0.1 * factor, 8));
    // Scaling by a power of two rounds nothing: the same darts, the same gaps.
    CHECK(result.samples.size() == original.samples.size());
    CHECK(result.report.unfilled_gaps == 0);
    const MaximalityReport report = amps::verify_maximal(other, result.samples);
    CHECK(report.maximal());
    CHECK(report.poisson_disk());
  }
  for (const double far : {1e3, 1e5}) {
    CAPTURE(far);
    const Mesh other = moved(mesh, {far, -far, far});
    const SamplingResult result = amps::sample(other, with_radius(0.1, 8));
    CHECK(result.report.unfilled_gaps == 0);
    const MaximalityReport report = amps::verify_maximal(other, result.samples);
    CHECK(report.maximal());
    CHECK(report.poisson_disk());
  }
}

TEST_CASE("sampling: a certificate prints itself") {
  std::ostringstream out;
  out << amps::verify_maximal(amps::make_square(), one_sample({0.5, 0.5, 0}, 0.5));
  CHECK(out.str().find("1.41421") != std::string::npos);
}

TEST_SUITE("slow") {
  TEST_CASE("sampling: sets on real models are maximal, by certificate and by oracle") {
    for (const auto& model : real_models()) {
      CAPTURE(model.name);
      const auto& [name, mesh, radius] = model;
      const SamplingResult result = amps::sample(mesh, with_radius(radius));
      check_maximal(mesh, result);
      MESSAGE(name << ": " << result.samples.size() << " samples");
    }
  }

  TEST_CASE("sampling: large sets on procedural models are maximal, by certificate and by oracle") {
    for (const auto& model : procedural_models()) {
      CAPTURE(model.name);
      const auto& [name, mesh, radius] = model;
      check_maximal(mesh, amps::sample(mesh, with_radius(radius / 3)));
    }
  }

  TEST_CASE("sampling: target_count is met within 1 % on real models and for large sets") {
    for (const auto& model : real_models()) {
      CAPTURE(model.name);
      const auto& [name, mesh, radius] = model;
      for (const Index count : {50, 500, 20000}) {
        CAPTURE(count);
        const SamplingResult result = amps::sample(mesh, with_count(count));
        CHECK(std::fabs(result.samples.size() - count) <= 0.01 * count);
      }
    }
  }
}

}  // namespace amps_test
