// Sampling with radii that vary over the surface: sampling.h and remesh.h with a sizing field.
#include "amps/sampling.h"

#include "kit/bits.h"
#include "kit/diagrams.h"
#include "kit/errors.h"
#include "kit/maximality.h"
#include "kit/models.h"

#include "amps/quality.h"
#include "amps/remesh.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace amps_test {

TEST_CASE("adaptive: sets are maximal Poisson-disk sets by certificate, by all pairs and by bisection") {
  for (const auto& model : procedural_models()) {
    CAPTURE(model.name);
    const Mesh& mesh = model.mesh;
    for (const double ratio : {3.0, 16.0, 1000.0}) {
      for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
        CAPTURE(ratio);
        const SamplingOptions options = with_sizing(graded_field(mesh, ratio, 700), 3, rule);
        const SamplingResult result = amps::sample(mesh, options);
        check_certificate(mesh, result, options);
        CHECK(result.samples.size() > 300);
        const double separation = separation_of_all_pairs(result.samples, rule);
        CHECK(separation >= 1 - 1e-9);
        CHECK(certificate_of(mesh, result.samples, rule).worst_separation == doctest::Approx(separation).epsilon(1e-12));
        CHECK(covered_by_oracle(mesh, result.samples));
      }
    }
  }
}

TEST_CASE("adaptive: fields that leap from vertex to vertex") {
  for (const Mesh& mesh : {amps::make_sphere(80), amps::make_square(3), amps::make_knot()}) {
    for (const double ratio : {10.0, 1000.0}) {
      for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
        const SamplingOptions options = with_sizing(wild_field(mesh, ratio, 900, 5), 2, rule);
        const SamplingResult result = amps::sample(mesh, options);
        check_certificate(mesh, result, options);
        CHECK(separation_of_all_pairs(result.samples, rule) >= 1 - 1e-9);
        CHECK(covered_by_oracle(mesh, result.samples));
        if (rule == ConflictRule::kMax) {  // some radii had to be cut
          Index cut = 0;
          for (Index s = result.report.dart_samples; s < result.samples.size(); ++s) {
            cut +=
                result.samples.radii[s] < options.sizing.radius(facet_of(result.samples, s), barycentric_of(result.samples, s));
          }
          CHECK(cut > 0);
        }
      }
    }
  }
}

TEST_CASE("adaptive: the oracles notice a missing sample, a radius too large and a pair too near") {
  const Mesh mesh = amps::make_sphere(320);
  const SampleSet set = amps::sample(mesh, with_sizing(graded_field(mesh, 16, 400))).samples;
  const SampleSet fewer = head(set, set.size() - 1);
  CHECK_FALSE(covered_by_oracle(mesh, fewer));
  CHECK_FALSE(amps::verify_maximal(mesh, fewer).maximal());
  SampleSet larger = set;
  larger.radii = scaled(set.radii, 1.5);
  CHECK(separation_of_all_pairs(larger, ConflictRule::kMax) < 0.8);
  CHECK(amps::verify_maximal(mesh, larger).worst_separation ==
        doctest::Approx(separation_of_all_pairs(larger, ConflictRule::kMax)).epsilon(1e-12));
}

TEST_CASE("adaptive: worst separation agrees with all pairs whether or not a set is what it should be") {
  const Mesh mesh = amps::make_sphere(320);
  Rng rng(8);
  for (int trial = 0; trial < 60; ++trial) {
    SampleSet set = amps::sample(mesh, with_sizing(graded_field(mesh, trial % 2 == 0 ? 4 : 30, 150), rng.next())).samples;
    // All radii shrunk by chance keep the set Poisson-disk; a few enlarged do not.
    const double spread = trial % 3 == 0 ? 1.0 : 0.2;
    for (Index s = 0; s < set.size(); ++s) set.radii[s] *= 1 - spread * rng.uniform();
    if (trial % 4 == 3) set.radii[below(rng, set.size())] *= 3;
    for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
      REQUIRE(certificate_of(mesh, set, rule).worst_separation ==
              doctest::Approx(separation_of_all_pairs(set, rule)).epsilon(1e-12));
    }
  }
}

TEST_CASE("adaptive: the worst pair of a bad set need not be neighbours, and is found") {
  // In bad sets that hide nothing, too: there the diagram's neighbours do not tell.
  const Mesh mesh = amps::make_square(1);
  Rng rng(12);
  int visible_sets = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const Index n = 4 + below(rng, 12);
    const WeightedPoints disks = drawn(n, [&rng] {
      const double x = rng.uniform(), y = rng.uniform(), z = 0.05 * rng.uniform();
      return WeightedPoint{x, y, z, 0.05 + 0.3 * rng.uniform()};
    });
    const SampleSet set = bare_set(positions_of(disks), weights_of(disks));
    const amps::RestrictedPowerDiagram diagram = diagram_of(mesh, set);
    bool all_visible = true;
    for (Index s = 0; s < n; ++s) all_visible = all_visible && diagram.visible(s);
    visible_sets += all_visible;
    for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
      REQUIRE(certificate_of(mesh, set, rule).worst_separation ==
              doctest::Approx(separation_of_all_pairs(set, rule)).epsilon(1e-12));
    }
  }
  CHECK(visible_sets > 100);
}

TEST_CASE("adaptive: the same bits for any number of threads, other bits for another seed") {
  const Mesh mesh = amps::make_knot();
  SamplingOptions options = with_sizing(graded_field(mesh, 16, 3000), 7);
  const SamplingResult first = amps::sample(mesh, options);
  for (const unsigned threads : {2u, 5u, 0u}) {
    run_on(options, threads);
    CHECK(same_set(first.samples, amps::sample(mesh, options).samples));
  }
  options.seed = 8;
  CHECK(!same_set(first.samples, amps::sample(mesh, options).samples));
}

TEST_CASE("adaptive: a field that is the same everywhere is a radius, whatever the rule") {
  const Mesh mesh = amps::make_torus();
  const SamplingResult expected = amps::sample(mesh, with_radius(0.1));
  for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
    const SamplingResult result = amps::sample(mesh, with_sizing(amps::uniform_sizing(mesh, 0.1), 1, rule));
    CHECK(same_set(expected.samples, result.samples));
    CHECK(result.report.radius == 0.1);
  }
}

TEST_CASE("adaptive: target_count scales the field, within 1 %" * doctest::test_suite("slow")) {
  for (const Mesh& mesh : {amps::make_square(6), amps::make_sphere(1280), amps::make_knot()}) {
    for (const double ratio : {4.0, 16.0, 1000.0}) {
      for (const Index count : {50, 200, 1000, 5000}) {
        CAPTURE(ratio);
        CAPTURE(count);
        SamplingOptions options = with_sizing(graded_field(mesh, ratio, 77));  // its own scale does not matter
        options.target_count = count;
        const SamplingResult result = amps::sample(mesh, options);
        CHECK(std::fabs(result.samples.size() - count) <= 0.01 * count);
        CHECK(result.report.sizing_scale > 0);
        check_certificate(mesh, result, options);
        // Scale and seed reproduce the set.
        if (count == 1000) {
          const SamplingOptions again = with_sizing(options.sizing.scaled(result.report.sizing_scale), result.report.seed);
          CHECK(same_set(result.samples, amps::sample(mesh, again).samples));
        }
      }
    }
  }
}

TEST_CASE("adaptive: darts alone are a Poisson-disk set of what the field says") {
  const Mesh mesh = amps::make_sphere(320);
  for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
    const SamplingOptions options = with_sizing(graded_field(mesh, 16, 1500), 6, rule);
    const SamplingResult result = amps::throw_darts(mesh, options);
    CHECK(result.report.dart_samples == result.samples.size());
    CHECK(separation_of_all_pairs(result.samples, rule) >= 1 - 1e-12);
    for (Index s = 0; s < result.samples.size(); ++s) {
      REQUIRE(result.samples.radii[s] == options.sizing.radius(facet_of(result.samples, s), barycentric_of(result.samples, s)));
    }
  }
}

TEST_CASE("adaptive: filling the gaps of a set from elsewhere") {
  const Mesh mesh = amps::make_torus();
  const SizingField field = graded_field(mesh, 16, 900);
  const auto fill = [&](const SampleSet& existing) {
    const SamplingResult result = amps::fill_gaps(mesh, existing, with_sizing(field, 4));
    CHECK(result.report.unfilled_gaps == 0);
    REQUIRE(result.samples.size() > existing.size());
    CHECK(same_bits(head(result.samples.positions, existing.size()), existing.positions));
    CHECK(same_values(head(result.samples.radii, existing.size()), existing.radii));
    const MaximalityReport report = amps::verify_maximal(mesh, result.samples);
    CHECK(report.maximal());
    CHECK(covered_by_oracle(mesh, result.samples));
    // No new disk covers a sample, no new sample lies in a disk.
    double worst = kInfinity;
    for (Index s = existing.size(); s < result.samples.size(); ++s) {
      for (Index t = 0; t < s; ++t) {
        const double distance = (sample_at(result.samples, s) - sample_at(result.samples, t)).norm();
        worst = std::min(worst, distance / std::max(result.samples.radii[s], result.samples.radii[t]));
      }
    }
    CHECK(worst >= 1 - 1e-9);
    return report;
  };
  // Every second sample of our own.
  const SampleSet own = amps::sample(mesh, with_sizing(field)).samples;
  const SampleSet half = selected(own, [](Index s) { return s % 2 == 0; });
  CHECK(fill(bare_set(half.positions, half.radii)).poisson_disk());
  // Points off the surface with radii far above and below the field's, hidden ones among them.
  Rng rng(3);
  const WeightedPoints disks = drawn(60, [&] {
    const double x = 3 * rng.uniform() - 1.5, y = 3 * rng.uniform() - 1.5, z = rng.uniform() - 0.5;
    return WeightedPoint{x, y, z, field.min_radius() * std::pow(100.0, rng.uniform()) / 3};
  });
  const SampleSet random = bare_set(positions_of(disks), weights_of(disks));
  fill(random);
  // One field value everywhere, other radii in the set.
  const SamplingResult uniform = amps::fill_gaps(mesh, random, with_sizing(amps::uniform_sizing(mesh, 0.2)));
  CHECK(amps::verify_maximal(mesh, uniform.samples).maximal());
}

TEST_CASE("adaptive: the dual triangulation has the topology of the surface") {
  struct Case {
    Mesh mesh;
    double count;
  };
  for (const auto& [mesh, count] :
       {Case{amps::make_sphere(1280), 3000}, Case{amps::make_torus(), 4000}, Case{amps::make_square(8), 2000}}) {
    amps::RemeshOptions options;
    options.sampling = with_sizing(graded_field(mesh, 16, count));
    const amps::RemeshResult result = amps::remesh(mesh, options);
    const amps::TopologyReport &in = result.report.input, &out = result.report.output;
    CHECK(out.manifold());
    CHECK(out.inconsistent_edges == 0);
    CHECK(out.euler_characteristic == in.euler_characteristic);
    CHECK(out.boundary_loops == in.boundary_loops);
    CHECK(out.components == in.components);
    CHECK(out.vertices == result.samples.size());
    CHECK(result.report.maximality.maximal());
    CHECK(result.report.maximality.poisson_disk());
    CHECK(result.report.quality.min_angle > 15);
  }
}

TEST_CASE("adaptive: by the min rule no sample of a field of gradation below √2 − 1 is hidden") {
  const Mesh mesh = amps::make_square(8);
  const SizingField field = graded_field(mesh, 1000, 20000);
  const SamplingResult result = amps::sample(mesh, with_sizing(field, 1, ConflictRule::kMin));
  REQUIRE(field.max_radius() - field.min_radius() < 0.41);  // over a square of side 1
  CHECK(count_hidden(diagram_of(mesh, result.samples)) == 0);
}

TEST_CASE("adaptive: options that make no sense") {
  const Mesh mesh = amps::make_sphere(320), other = amps::make_sphere(1280);
  const SizingField field = graded_field(mesh, 4, 500);
  SamplingOptions options = with_sizing(field);
  options.radius = 0.1;
  CHECK(error_of([&] { amps::sample(mesh, options); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { amps::throw_darts(mesh, options); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { amps::fill_gaps(mesh, amps::sample(mesh, with_sizing(field)).samples, options); }) ==
        ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { amps::sample(other, with_sizing(field)); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { amps::throw_darts(other, with_sizing(field)); }) == ErrorCode::kInvalidArgument);
  options = with_sizing(field);
  options.target_count = 100;
  CHECK(error_of([&] { amps::throw_darts(mesh, options); }) == ErrorCode::kInvalidArgument);
  options.target_count = -1;
  CHECK(error_of([&] { amps::sample(mesh, options); }) == ErrorCode::kInvalidArgument);
  options = with_sizing(field.scaled(0.01));
  options.max_samples = 10000;
  CHECK(error_of([&] { amps::sample(mesh, options); }) == ErrorCode::kTooLarge);
  CHECK(error_of([&] { amps::sample(mesh, with_sizing(field.scaled(1e-10))); }) == ErrorCode::kTooLarge);
  // Few samples, but radii out of proportion to the mesh.
  Values radii = constant_values(rows(mesh.vertices), 1);
  radii[0] = 1e-8;
  options = with_sizing(amps::vertex_sizing(mesh, radii));
  CHECK(error_of([&] { amps::sample(mesh, options); }) == ErrorCode::kTooLarge);
}

TEST_CASE("adaptive: cancelled at any stage, what is there is a Poisson-disk set and says so") {
  const Mesh mesh = amps::make_torus();
  for (const char* const wanted : {"throwing darts", "triangulating samples", "dividing the surface", "filling gaps"}) {
    SamplingOptions options = with_sizing(graded_field(mesh, 16, 3000));
    int seen = 0;
    watch(options, [&](const char* stage, double) { return std::string(stage) != wanted || ++seen < 14; });
    const SamplingResult result = amps::sample(mesh, options);
    CHECK(result.status == Outcome::kCancelled);
    CHECK(result.samples.size() > 0);
    CHECK(separation_of_all_pairs(result.samples, ConflictRule::kMax) >= 1 - 1e-9);
  }
}

TEST_CASE("adaptive: progress stays within [0, 1] and never falls") {
  const Mesh mesh = amps::make_knot();
  for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
    SamplingOptions options = with_sizing(wild_field(mesh, 30, 6000, 3), 1, rule);
    double last = 0;
    int reports = 0;
    bool in_order = true;
    watch(options, [&](const char*, double fraction) {
      in_order = in_order && fraction >= last && fraction <= 1;
      last = fraction;
      return ++reports > 0;
    });
    amps::sample(mesh, options);
    CHECK(in_order);
    CHECK(last == 1);
    CHECK(reports > 20);
  }
}

TEST_CASE("adaptive: the same seed gives the same bits with every compiler and build type") {
  // Recorded once; the input has no value from libm. A change of the algorithm may change these numbers, a compiler may not.
  const auto bits = [&](const Mesh& mesh, double ratio, ConflictRule rule) {
    SamplingOptions options = with_sizing(graded_field(mesh, ratio, 2000), 5, rule);
    options.target_count = 2100;
    const SampleSet set = amps::sample(mesh, options).samples;
    return hash_bits(set.positions, set.radii);
  };
  CHECK(bits(amps::make_square(3), 16, ConflictRule::kMax) == 18391047690902342837u);
  CHECK(bits(amps::make_square(3), 1000, ConflictRule::kMax) == 5949611275783104694u);
  CHECK(bits(amps::make_cube(7), 16, ConflictRule::kMin) == 11504801570204696459u);
}

TEST_SUITE("slow") {
  TEST_CASE("adaptive: the certificate holds on every surface there is, whatever is wrong with it") {
    for (const Model& model : difficult_models()) {
      CAPTURE(model.name);
      const Mesh& mesh = model.mesh;
      for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
        const SamplingOptions options = with_sizing(graded_field(mesh, 16, 1500), 2, rule);
        const SamplingResult result = amps::sample(mesh, options);
        check_certificate(mesh, result, options);
        CHECK(separation_of_all_pairs(result.samples, rule) >= 1 - 1e-9);
      }
    }
  }

  TEST_CASE("adaptive: the certificate holds on real models, 1:16 and 1:1000") {
    for (const auto& model : real_models()) {
      CAPTURE(model.name);
      for (const double ratio : {16.0, 1000.0}) {
        for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
          const SamplingOptions options = with_sizing(graded_field(model.mesh, ratio, 6000), 2, rule);
          const SamplingResult result = amps::sample(model.mesh, options);
          check_certificate(model.mesh, result, options);
          if (ratio == 16.0) CHECK(separation_of_all_pairs(result.samples, rule) >= 1 - 1e-9);
        }
      }
    }
  }

  TEST_CASE("adaptive: the certificate holds with radii by local feature size and by curvature") {
    std::vector<Model> models = difficult_models();
    for (const Model& model : real_models()) models.push_back(model);
    for (const Model& model : models) {
      const Mesh& mesh = model.mesh;
      CAPTURE(model.name);
      amps::CurvatureOptions curvature;
      curvature.max_error = 1e-3 * amps::bounding_box(mesh).diagonal();
      for (const SizingField& field : {amps::lfs_sizing(mesh), amps::curvature_sizing(mesh, curvature)}) {
        const SamplingOptions options = with_sizing(amps::for_count(field.with_ratio(16), 2000));
        const SamplingResult result = amps::sample(mesh, options);
        check_certificate(mesh, result, options);
        CHECK(separation_of_all_pairs(result.samples, ConflictRule::kMax) >= 1 - 1e-9);
      }
    }
  }

  TEST_CASE("adaptive: large sets, and counts within 1 %") {
    for (const auto& model : real_models()) {
      CAPTURE(model.name);
      SamplingOptions options = with_sizing(graded_field(model.mesh, 16, 100));
      options.target_count = 20000;
      const SamplingResult result = amps::sample(model.mesh, options);
      CHECK(std::fabs(result.samples.size() - 20000) <= 200);
      check_certificate(model.mesh, result, options);
    }
  }
}

}  // namespace amps_test
