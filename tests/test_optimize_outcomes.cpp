// Optimisation: how it ends — done, stalled, at a limit, cancelled, refused —, on odd sets too, and what it tells.
#include "amps/optimize.h"

#include "kit/errors.h"
#include "kit/optimized.h"

#include <doctest/doctest.h>

#include <sstream>
#include <string>
#include <vector>

namespace amps_test {

TEST_CASE("optimize: what is out of reach ends as stalled or at the limit, no worse than the start") {
  // Closed surfaces of less than 12 vertices have some of valence below 5 (Euler); of genus 0.
  for (const double count : {6.0, 8.0}) {
    const TestSet set = uniform_set("sphere", amps::make_sphere(20), count);
    OptimizeOptions options = options_for(set);
    options.angles = false;
    const OptimizeResult result = optimized(set, options);
    REQUIRE(result.samples.size() < 12);
    check_state(set, result.samples);
    check_survivors(set.samples, result);
    check_never_rises(result.report);
    CHECK(result.report.status == Outcome::kStalled);
    CHECK(result.report.iterations.size() < 100);
  }
  for (const TestSet& set : {uniform_set("sphere", amps::make_sphere(320), 60), uniform_set("square", amps::make_square(2), 40),
                             graded_set("graded sphere", amps::make_sphere(320), 60)}) {
    CAPTURE(set.name);
    OptimizeOptions options = options_for(set);
    options.min_angle = 59;
    options.max_angle = 61;
    const OptimizeResult result = optimized(set, options);
    check_result(set, result);
    CHECK(result.report.status == Outcome::kStalled);
    CHECK(result.report.iterations.size() < 100);
    CHECK(result.report.iterations.back().energy < result.report.iterations.front().energy);
    options.max_iterations = 1;
    const OptimizeResult limited = optimized(set, options);
    CHECK(limited.report.status == Outcome::kIterationLimit);
    CHECK(limited.report.iterations.size() == 2);
  }
}

TEST_CASE("optimize: cancelled, it returns the state it had") {
  for (const TestSet& set :
       {uniform_set("sphere", amps::make_sphere(320), 600), graded_set("square", amps::make_square(16), 600)}) {
    CAPTURE(set.name);
    const OptimizeResult whole = optimized(set, options_for(set));
    OptimizeOptions options = options_for(set);
    cancel(options);
    const OptimizeResult at_once = optimized(set, options);
    CHECK(at_once.report.status == Outcome::kCancelled);
    CHECK(same_set(at_once.samples, set.samples));
    CHECK(at_once.report.iterations.empty());
    int calls_in_all = 0;
    watch(options = options_for(set), [&](const char* stage, double) {
      calls_in_all += stage == std::string("improving triangles");
      return true;
    });
    optimized(set, options);
    REQUIRE(calls_in_all > 10);
    for (const int calls : {1, 4, calls_in_all / 4, calls_in_all / 2, calls_in_all - 3}) {
      CAPTURE(calls);
      int seen = 0;
      double fraction = 0;
      bool in_order = true;
      watch(options, [&](const char* stage, double f) {
        in_order = in_order && f >= fraction && f <= 1;
        fraction = f;
        seen += stage == std::string("improving triangles");
        return seen < calls;
      });
      const OptimizeResult result = optimized(set, options);
      CHECK(in_order);
      CHECK(seen == calls);
      CHECK(result.report.status == Outcome::kCancelled);
      if (calls <= 4) {  // while it reads what there is
        CHECK(same_set(result.samples, set.samples));
        continue;
      }
      check_result(set, result);
      CHECK(result.report.iterations.size() <= whole.report.iterations.size());
      for (std::size_t k = 0; k + 1 < result.report.iterations.size(); ++k) {  // the last may yet be written anew
        CHECK(same_line(result.report.iterations[k], whole.report.iterations[k]));
      }
      if (calls == calls_in_all / 2) CHECK(result.report.accepted > 0);
    }
    // Watching changes nothing.
    watch(options, [](const char*, double) { return true; });
    const OptimizeResult watched = optimized(set, options);
    CHECK(same_set(watched.samples, whole.samples));
    CHECK(same_course(watched.report, whole.report));
  }
}

TEST_CASE("optimize: what is good is left alone") {
  const TestSet set = uniform_set("sphere", amps::make_sphere(320), 300);
  const TestSet good{"", set.mesh, {}, optimized(set, options_for(set)).samples};
  const OptimizeResult again = optimized(good, options_for(good));
  CHECK(again.report.status == Outcome::kDone);
  CHECK(same_set(again.samples, good.samples));
  CHECK(again.report.trials == 0);
}

TEST_CASE("optimize: out of reach, it ends when half of its work has brought next to nothing, and not before" *
          doctest::test_suite("slow")) {
  constexpr double kAlways = 200000;  // work that is not measured by what it brings
  int measured = 0, stalled = 0;
  std::vector<TestSet> sets = manifold_sets(500);
  sets.push_back(uniform_set("dense sphere", amps::make_sphere(20480), 500));
  for (const TestSet& set : sets) {
    CAPTURE(set.name);
    OptimizeOptions options = options_for(set);
    options.min_angle = 49;
    options.max_angle = 82;
    const OptimizeResult result = optimized(set, options);
    stalled += result.report.status == Outcome::kStalled;
    const std::vector<OptimizeIteration>& lines = result.report.iterations;
    // Has the second half of the work up to this line neither halved the energy nor brought a twentieth of the gain?
    const auto brings_little = [&](std::size_t k) {
      std::size_t middle = 0;
      for (std::size_t j = 0; j <= k; ++j) middle = 2 * lines[j].work <= lines[k].work ? j : middle;
      const double gain = lines[0].energy - lines[k].energy, late = lines[middle].energy - lines[k].energy;
      return 2 * lines[k].energy > lines[middle].energy && 20 * late < gain;
    };
    for (std::size_t k = 1; k < lines.size(); ++k) {
      CHECK(lines[k].work >= lines[k - 1].work);
      if (k + 1 == lines.size() || lines[k].work <= kAlways) continue;
      ++measured;
      CHECK(!brings_little(k));
    }
  }
  CHECK(measured > 10);
  CHECK(stalled > 3);
}

TEST_CASE("optimize: a few samples, on closed and open surfaces") {
  const std::vector<NamedMesh> meshes = {{"sphere", amps::make_sphere(80)},
                                         {"square", amps::make_square(2)},
                                         {"moebius", moebius_strip(24, 2)},
                                         {"two sheets", two_sheets(0.1)},
                                         {"soup", random_soup(5, 402)}};
  for (const auto& model : meshes) {
    const Mesh& mesh = model.mesh;
    CAPTURE(model.name);
    const double diagonal = amps::bounding_box(mesh).diagonal();
    for (const double size : {2.0, 0.6, 0.4, 0.3, 0.2}) {
      const TestSet set{model.name, mesh, {}, amps::sample(mesh, with_radius(size * diagonal)).samples};
      CAPTURE(set.samples.size());
      if (size == 2.0) REQUIRE(set.samples.size() == 1);
      const OptimizeResult result = optimized(set, options_for(set, 30));
      check_result(set, result, false);
      CHECK(result.samples.size() > 0);
      if (set.samples.size() == 1) {
        CHECK(same_set(result.samples, set.samples));
        CHECK(result.report.status == Outcome::kDone);
        CHECK(result.report.iterations.front().max_angle == 0);
        CHECK(result.report.iterations.front().min_angle == 0);
      }
    }
  }
}

TEST_CASE("optimize: sets that are not maximal, and sets that are not Poisson-disk, end in order and never get worse") {
  const Mesh mesh = amps::make_sphere(320);
  const SampleSet darts = amps::throw_darts(mesh, with_radius(radius_for(mesh, 300))).samples;
  const SampleSet sparse = bare_set(head(darts.positions, 170), head(darts.radii, 170));
  SampleSet crowded = darts, doubled = darts;
  crowded.radii = scaled(darts.radii, 1.5);
  doubled.positions.row(3) = sample_at(darts, 2).transpose();
  for (const SampleSet* samples :
       {&darts, &sparse, static_cast<const SampleSet*>(&crowded), static_cast<const SampleSet*>(&doubled)}) {
    OptimizeOptions options;
    options.max_iterations = 40;
    const OptimizeResult result = amps::optimize(mesh, *samples, options);
    check_survivors(*samples, result);
    check_never_rises(result.report);
    const Badness after = badness(amps::restricted_triangulation(mesh, result.samples), result.report);
    CHECK(result.report.iterations.back().bad_triangles == after.triangles);
    CHECK(result.report.iterations.back().bad_vertices == after.vertices);
    if (samples == &darts || samples == &sparse) CHECK(amps::verify_maximal(mesh, result.samples).poisson_disk());
  }
}

TEST_CASE("optimize: options and sets that cannot be are refused, and the message says why") {
  const TestSet set = uniform_set("", amps::make_sphere(80), 50);
  const auto refused = [&](void (*change)(OptimizeOptions&, double), double value) {
    OptimizeOptions options;
    change(options, value);
    return error_of([&] { optimized(set, options); }) == ErrorCode::kInvalidArgument;
  };
  for (const double low : {-1.0, 60.0, 75.0, kNaN, kInfinity, -kInfinity})
    CHECK(refused([](OptimizeOptions& o, double x) { o.min_angle = x; }, low));
  for (const double high : {-1.0, 60.0, 45.0, 180.0, kNaN, kInfinity})
    CHECK(refused([](OptimizeOptions& o, double x) { o.max_angle = x; }, high));
  CHECK(refused([](OptimizeOptions& o, double) { o.max_iterations = -1; }, 0));
  CHECK(refused([](OptimizeOptions& o, double) { o.refills = 0; }, 0));
  CHECK(refused([](OptimizeOptions& o, double) { o.refills = -5; }, 0));
  OptimizeOptions options;
  options.sizing = amps::uniform_sizing(amps::make_sphere(320), 0.1);
  CHECK(error_of([&] { optimized(set, options); }) == ErrorCode::kInvalidArgument);
  options = {};
  const auto refuses = [&](const SampleSet& samples) {
    return error_of([&] { amps::optimize(set.mesh, samples, options); }) == ErrorCode::kInvalidArgument;
  };
  CHECK(refuses({}));
  SampleSet broken = set.samples;
  broken.positions(3, 1) = kNaN;
  CHECK(refuses(broken));
  broken = set.samples;
  broken.radii[2] = 0;
  CHECK(refuses(broken));
  broken.radii[2] = kNaN;
  CHECK(refuses(broken));
  broken = set.samples;
  broken.facets.pop_back();
  CHECK(refuses(broken));
  CHECK(error_of([&] { amps::optimize(Mesh{no_points(), no_triangles()}, set.samples, options); }) == ErrorCode::kInvalidMesh);
}

TEST_CASE("optimize: convergence as text has a line an iteration and parses back") {
  const TestSet set = uniform_set("", amps::make_sphere(320), 300);
  const OptimizeReport report = optimized(set, options_for(set)).report;
  REQUIRE(report.iterations.size() > 2);
  std::stringstream text;
  amps::write_convergence(text, report);
  std::string line;
  REQUIRE(std::getline(text, line));
  CHECK(line == "iteration,bad_triangles,bad_vertices,min_angle,max_angle,samples,energy,seconds");
  for (std::size_t k = 0; k < report.iterations.size(); ++k) {
    REQUIRE(std::getline(text, line));
    std::istringstream fields(line);
    std::vector<double> values;
    for (std::string field; std::getline(fields, field, ',');) {
      std::size_t read = 0;
      values.push_back(std::stod(field, &read));
      REQUIRE(read == field.size());
    }
    const OptimizeIteration& expected = report.iterations[k];
    REQUIRE(values.size() == 8);
    CHECK(values[0] == static_cast<double>(k));
    CHECK(values[1] == expected.bad_triangles);
    CHECK(values[2] == expected.bad_vertices);
    CHECK(values[5] == expected.samples);
    CHECK(values[3] == doctest::Approx(expected.min_angle).epsilon(1e-5));
    CHECK(values[4] == doctest::Approx(expected.max_angle).epsilon(1e-5));
    CHECK(values[6] == doctest::Approx(expected.energy).epsilon(1e-5));
    CHECK(values[7] == doctest::Approx(expected.seconds).epsilon(1e-5));
    if (k > 0) CHECK(expected.seconds >= report.iterations[k - 1].seconds);
  }
  CHECK_FALSE(std::getline(text, line));
  std::ostringstream summary;
  summary << report;
  CHECK(summary.str().find("done") != std::string::npos);
}

}  // namespace amps_test
