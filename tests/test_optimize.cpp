// Optimisation: what it promises of every state, counted anew from the samples alone.
#include "amps/optimize.h"

#include "kit/bits.h"
#include "kit/diagrams.h"
#include "kit/optimized.h"

#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <vector>

namespace amps_test {

TEST_CASE("optimize: every state is a maximal Poisson-disk set, and better than the one before") {
  for (const TestSet& set : manifold_sets(350)) {
    CAPTURE(set.name);
    const OptimizeResult whole = optimized(set, options_for(set));
    check_result(set, whole);
    CHECK(whole.report.status == Outcome::kDone);
    for (const int k : {0, 1, 2, 3, 5, 8}) {
      CAPTURE(k);
      const OptimizeResult part = optimized(set, options_for(set, k));
      check_result(set, part);
      // The same course, cut short.
      const std::size_t lines = std::min(at(k) + 1, whole.report.iterations.size());
      REQUIRE(part.report.iterations.size() == lines);
      CHECK(std::equal(part.report.iterations.begin(), part.report.iterations.end() - 1, whole.report.iterations.begin(),
                       same_line));
      CHECK(part.report.iterations.back().energy ==
            whole.report.iterations[lines - 1].energy);  // last angles are of all triangles
      CHECK((part.report.status == Outcome::kDone) == (lines == whole.report.iterations.size()));
      if (part.report.status != Outcome::kDone) CHECK(part.report.status == Outcome::kIterationLimit);
      if (k == 0) CHECK(same_set(part.samples, set.samples));
    }
  }
}

TEST_CASE("optimize: every state on soups, at spines and between near sheets is a maximal Poisson-disk set") {
  for (const TestSet& set : other_sets(250)) {
    CAPTURE(set.name);
    for (const int k : {0, 1, 2, 4, 12}) {
      CAPTURE(k);
      const OptimizeResult result = optimized(set, options_for(set, k));
      check_result(set, result, false);
      CHECK(result.report.iterations.size() <= at(k) + 1);
    }
  }
}

TEST_CASE("optimize: sheets nearer than a disk respect each other where copies know one of them only") {
  const double r = radius_for(two_spheres(0), 600);
  for (const double distance : {0.7, 0.8, 0.9}) {
    CAPTURE(distance);
    const TestSet set = uniform_set("", two_spheres(distance * r), 600);
    for (const int k : {2, 40}) check_result(set, optimized(set, options_for(set, k)), false);
  }
}

TEST_CASE("optimize: forced refills and what is undone leave every radius, place and weight as they were") {
  for (const TestSet& set :
       {graded_set("sphere", amps::make_sphere(320), 50, 0.4), graded_set("square", amps::make_square(8), 60, 0.2),
        graded_set("torus", amps::make_torus(1, 0.4, 48, 20), 160, 0.4)}) {
    CAPTURE(set.name);
    OptimizeOptions options = options_for(set, 100);
    options.min_angle = 44;
    options.max_angle = 92;
    Diagram diagram = amps::detail::diagram_of(set.mesh, set.samples, on_threads(1));
    std::vector<Index> ids;
    OptimizeResult result{set.samples, {}};
    result.report = amps::detail::optimize_diagram(diagram, result.samples, {}, options, ids);
    check_result(set, result);
    REQUIRE(ids.size() == at(result.samples.size()));
    for (Index s = 0; s < result.samples.size(); ++s) {
      CHECK(diagram.site(ids[at(s)]).w == result.samples.radii[s] * result.samples.radii[s]);
      CHECK(diagram.site(ids[at(s)]).position() == sample_at(result.samples, s));
    }
  }
}

TEST_CASE("optimize: edges of more than two triangles are rated late; the energy rises there only, and states stay sound") {
  for (const TestSet& set : other_sets(300)) {
    CAPTURE(set.name);
    const OptimizeResult result = optimized(set, options_for(set, 60));
    check_result(set, result, false);
    int rises = 0;
    for (std::size_t k = 1; k < result.report.iterations.size(); ++k) {
      rises += result.report.iterations[k].energy > result.report.iterations[k - 1].energy * (1 + 1e-12);
    }
    CHECK(rises <= 2);
    // The energy of vertices that are no crossings is counted here; the report's may be more.
    const Badness after = badness(set, result.samples, result.report);
    CHECK(result.report.iterations.back().energy >= after.energy * (1 - 1e-9));
    if (result.report.status == Outcome::kDone) CHECK(after.triangles + after.vertices + after.crossings == 0);
  }
}

TEST_CASE("optimize: bad vertices on edges of more than two triangles count from the first line on") {
  // Sheets that cross and thin ones, with disks that are balls: crossings are bad before, and some after.
  Index crossings = 0;
  for (const TestSet& set : {uniform_set("soup", random_soup(12, 401), 300), uniform_set("book of 5 pages", open_book(5), 300),
                             uniform_set("thin plate", two_sheets(0.4 * radius_for(two_sheets(0), 400)), 400)}) {
    CAPTURE(set.name);
    for (const int k : {0, 3, 60}) check_result(set, optimized(set, options_for(set, k)), false);
    const OptimizeResult none = optimized(set, options_for(set, 0));
    const Badness before = badness(set, set.samples, none.report);
    crossings += before.crossings;
    // A result is counted as the input of the next call.
    const OptimizeResult result = optimized(set, options_for(set, 60));
    const OptimizeResult again = amps::optimize(set.mesh, result.samples, options_for(set, 0));
    CHECK(again.report.iterations.front().bad_vertices == result.report.iterations.back().bad_vertices);
    CHECK(again.report.iterations.front().bad_triangles == result.report.iterations.back().bad_triangles);
  }
  CHECK(crossings > 5);
}

TEST_CASE("optimize: sets of the min rule stay so, and keep the wanted radii; in remesh too") {
  std::vector<TestSet> sets = {graded_set("sphere", amps::make_sphere(1280), 700),
                               graded_set("square", amps::make_square(16), 700),
                               graded_set("steeper sphere", amps::make_sphere(1280), 700, 0.6)};
  // So steep that samples hide behind larger ones.
  const Mesh square = amps::make_square(12);
  Rng rng(21);
  const Values steep = made_values(rows(square.vertices), [&](Index) { return rng.below(2) == 0 ? 0.015 : 0.075; });
  sets.push_back({"steep square", square, amps::vertex_sizing(square, steep), {}});
  for (TestSet& set : sets) {
    CAPTURE(set.name);
    const SamplingOptions sampling = with_sizing(set.sizing, 1, ConflictRule::kMin);
    set.samples = amps::sample(set.mesh, sampling).samples;
    const auto lowered = [&](const SampleSet& samples) {
      Index count = 0;
      for (Index s = 0; s < samples.size(); ++s) {
        count += samples.radii[s] != set.sizing.radius(facet_of(samples, s), barycentric_of(samples, s));
      }
      return count;
    };
    const auto hidden = [&](const SampleSet& samples) {
      return samples.size() - amps::topology(amps::restricted_triangulation(set.mesh, samples)).vertices;
    };
    OptimizeOptions options = options_for(set, 60);
    options.conflict_rule = ConflictRule::kMin;
    const OptimizeResult result = optimized(set, options);
    check_survivors(set.samples, result);
    check_never_rises(result.report);
    CHECK(result.report.added > 30);
    CHECK(result.report.iterations.back().energy < 0.2 * result.report.iterations.front().energy);
    CHECK(amps::verify_maximal(set.mesh, result.samples, on_threads(1), ConflictRule::kMin).maximal());
    CHECK(separation_of_all_pairs(result.samples, ConflictRule::kMin) >= 1 - 5e-13);
    CHECK(lowered(result.samples) == 0);
    if (set.name == "steep square") REQUIRE(hidden(set.samples) > 20);
    CHECK(hidden(result.samples) <= hidden(set.samples));
    amps::RemeshOptions whole;
    whole.sampling = sampling;
    whole.optimization.max_iterations = 60;
    const amps::RemeshResult remeshed = amps::remesh(set.mesh, whole);
    CHECK(remeshed.report.maximality.maximal());
    CHECK(remeshed.report.maximality.poisson_disk());
    CHECK(lowered(remeshed.samples) == 0);
  }
}

TEST_CASE("optimize: non-obtuse, where radii are equal or of gradation 0.1") {
  for (const TestSet& set :
       {uniform_set("sphere", amps::make_sphere(320), 500), graded_set("graded sphere", amps::make_sphere(1280), 500),
        uniform_set("torus", amps::make_torus(1, 0.4, 48, 20), 500)}) {
    CAPTURE(set.name);
    OptimizeOptions options = options_for(set);
    options.min_angle = 42;
    options.max_angle = 90;
    const OptimizeResult result = optimized(set, options);
    check_result(set, result);
    CHECK(result.report.status == Outcome::kDone);
    const Badness after = badness(set, result.samples, result.report);
    CHECK(after.min_angle >= 42);
    CHECK(after.max_angle <= 90);
  }
}

TEST_CASE("optimize: default bounds are [35, 105] where all radii are equal, [32, 114] elsewhere") {
  const TestSet even = uniform_set("", amps::make_sphere(320), 100), graded = graded_set("", amps::make_sphere(320), 100);
  for (const TestSet* set : {&even, &graded}) {
    OptimizeOptions options = options_for(*set, 0);
    const OptimizeReport by_default = optimized(*set, options).report;
    CHECK(by_default.min_angle == (set == &even ? 35 : 32));
    CHECK(by_default.max_angle == (set == &even ? 105 : 114));
    options.min_angle = 40;
    CHECK(optimized(*set, options).report.min_angle == 40);
    CHECK(optimized(*set, options).report.max_angle == by_default.max_angle);
    options.max_angle = 95;
    CHECK(optimized(*set, options).report.max_angle == 95);
  }
}

TEST_CASE("optimize: the same bits for any number of threads, other bits for another seed") {
  for (const TestSet& set :
       {uniform_set("torus", amps::make_torus(1, 0.4, 48, 20), 900), graded_set("square", amps::make_square(16), 900),
        uniform_set("soup", random_soup(12, 401), 300)}) {
    CAPTURE(set.name);
    OptimizeOptions options = options_for(set, 20);
    options.seed = 7;
    const OptimizeResult first = optimized(set, options);
    for (const unsigned threads : {1u, 2u, 3u, 8u, 0u}) {
      CAPTURE(threads);
      run_on(options, threads);
      const OptimizeResult again = optimized(set, options);
      CHECK(same_set(first.samples, again.samples));
      CHECK(same_course(first.report, again.report));
    }
    options.seed = 8;
    CHECK(!same_set(first.samples, optimized(set, options).samples));
  }
}

TEST_CASE("optimize: samples without a place on the mesh are as good; those added have one") {
  const TestSet set = uniform_set("torus", amps::make_torus(1, 0.4, 48, 20), 400);
  const OptimizeResult expected = optimized(set, options_for(set));
  const SampleSet bare = bare_set(set.samples.positions, set.samples.radii);
  const OptimizeResult result = amps::optimize(set.mesh, bare, options_for(set));
  CHECK(same_bits(result.samples.positions, expected.samples.positions));
  CHECK(same_values(result.samples.radii, expected.samples.radii));
  check_survivors(bare, result);
  const Index kept = set.samples.size() - result.report.removed;
  for (Index s = 0; s < result.samples.size(); ++s) {
    CHECK((facet_of(result.samples, s) == kNone) == (s < kept));
    if (s >= kept) {
      CHECK(barycentric_of(result.samples, s) == barycentric_of(expected.samples, s));
    } else {
      CHECK(barycentric_of(result.samples, s) == Vec3::Zero());
    }
  }
}

TEST_CASE("optimize: angles only, valences only, neither") {
  for (const TestSet& set :
       {uniform_set("sphere", amps::make_sphere(320), 400), graded_set("square", amps::make_square(16), 400)}) {
    CAPTURE(set.name);
    for (const bool angles : {false, true}) {
      for (const bool valences : {false, true}) {
        CAPTURE(angles);
        CAPTURE(valences);
        OptimizeOptions options = options_for(set);
        options.angles = angles;
        options.valences = valences;
        const OptimizeResult result = optimized(set, options);
        check_state(set, result.samples);
        check_survivors(set.samples, result);
        check_never_rises(result.report);
        CHECK(result.report.status == Outcome::kDone);
        const Badness all = badness(set, set.samples, result.report), left = badness(set, result.samples, result.report);
        check_line(result.report.iterations.front(), badness(set, set.samples, result.report, angles, valences), set.samples);
        check_line(result.report.iterations.back(), badness(set, result.samples, result.report, angles, valences),
                   result.samples);
        REQUIRE(all.triangles > 0);
        REQUIRE(all.vertices > 0);
        CHECK((left.triangles == 0) == angles);
        CHECK((left.vertices == 0) == valences);
        if (!angles && !valences) {
          CHECK(same_set(set.samples, result.samples));
          CHECK(result.report.iterations.size() == 1);
          CHECK(result.report.trials == 0);
        }
      }
    }
  }
}

TEST_CASE("optimize: the diagram given is that of the result") {
  for (const TestSet& set :
       {uniform_set("torus", amps::make_torus(1, 0.4, 48, 20), 300), graded_set("square", amps::make_square(16), 300),
        uniform_set("soup", random_soup(12, 401), 200)}) {
    CAPTURE(set.name);
    OptimizeOptions options = options_for(set, 40);
    options.min_angle = 40;
    Diagram diagram = amps::detail::diagram_of(set.mesh, set.samples, on_threads(1));
    std::vector<Index> ids;
    OptimizeResult result{set.samples, {}};
    result.report = amps::detail::optimize_diagram(diagram, result.samples, {}, options, ids);
    CHECK(same_set(result.samples, optimized(set, options).samples));
    REQUIRE(ids.size() == at(result.samples.size()));
    REQUIRE(diagram.num_sites() - diagram.num_removed() == result.samples.size());
    CHECK(broken_law(set.mesh, diagram) == "");
    const Diagram fresh = amps::detail::diagram_of(set.mesh, result.samples, on_threads(1));
    CHECK(canonical(fresh, ids) == canonical(diagram));
  }
}

TEST_CASE("optimize: the same seed gives the same bits with every compiler and build type") {
  // Recorded once, for valences alone; test_remesh has the bits of both.
  const auto bits = [&](const TestSet& set) {
    OptimizeOptions options = options_for(set);
    options.angles = false;
    const SampleSet result = optimized(set, options).samples;
    return hash_bits(result.positions, result.radii, result.barycentrics);
  };
  CHECK(bits(uniform_set("", amps::make_square(3), 900)) == 5678639602280453715u);
  CHECK(bits(uniform_set("", amps::make_cube(7), 900)) == 9085052381732115385u);
  CHECK(bits(graded_set("", amps::make_square(12), 900)) == 10045812690507217026u);
}

TEST_CASE("optimize: large sets keep every law" * doctest::test_suite("slow")) {
  for (const TestSet& set : manifold_sets(6000)) {
    CAPTURE(set.name);
    check_result(set, optimized(set, options_for(set)));
    OptimizeOptions options = options_for(set);
    options.min_angle = 40;
    options.max_angle = 95;
    run_on(options, 2);
    for (const int k : {1, 4, 1000}) {
      options.max_iterations = k;
      check_result(set, optimized(set, options));
    }
  }
  for (const TestSet& set : other_sets(4000)) {
    CAPTURE(set.name);
    check_result(set, optimized(set, options_for(set, 100)), false);
  }
}

TEST_CASE("optimize: real models keep every law" * doctest::test_suite("slow")) {
  for (const auto& model : real_models()) {
    CAPTURE(model.name);
    const TestSet set = uniform_set(model.name, model.mesh, 3000);
    check_result(set, optimized(set, options_for(set, 60)), false);
    const SizingField field = amps::for_count(amps::lfs_sizing(model.mesh).with_ratio(16), 3000);
    const TestSet graded{model.name, model.mesh, field, amps::sample(model.mesh, with_sizing(field)).samples};
    check_result(graded, optimized(graded, options_for(graded, 60)), false);
  }
}

}  // namespace amps_test
