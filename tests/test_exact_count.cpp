// Exact numbers of samples: the number, and all laws of a set beside it, by oracles that share no code with the edits.
#include "amps/count_editor.h"
#include "amps/exact_count.h"

#include "kit/bits.h"
#include "kit/curves.h"
#include "kit/data.h"
#include "kit/errors.h"
#include "kit/execution.h"
#include "kit/maximality.h"
#include "kit/meshes.h"
#include "kit/models.h"
#include "kit/optimized.h"
#include "kit/samples.h"
#include "kit/topology.h"

#include "amps/disk_set.h"
#include "amps/maximality.h"
#include "amps/power_diagram.h"
#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/sizing.h"
#include "amps/wanted_radii.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {
namespace {

using amps::CountObstacle;
using amps::ExactCountReport;
using amps::RemeshOptions;
using amps::RemeshResult;

SamplingOptions exactly(Index count, std::uint64_t seed = 1) {
  SamplingOptions options = with_count(count, seed);
  options.exact_count = true;
  return options;
}

RemeshOptions remesh_exactly(Index count, unsigned threads = 1) {
  RemeshOptions options;
  options.sampling = exactly(count);
  run_on(options.sampling, threads);
  return options;
}

SampleSet with_radii_times(SampleSet set, double factor) {
  for (double& r : set.radii) r *= factor;
  return set;
}

/// Is this the least multiple of the radii that covers the surface? By bisection of the surface among balls.
void check_coverage_by_oracle(const Mesh& mesh, const SampleSet& set, double coverage) {
  CHECK(covered_by_oracle(mesh, with_radii_times(set, coverage * (1 + 1e-9))));
  CHECK(!CoverageOracle(with_radii_times(set, coverage * (1 - 1e-4)), 1e-6).covers(mesh));
}

/// A maximal set of one radius, optimised or not, edited by hand until it has so many samples.
struct Counted {
  SampleSet before, set;
  ExactCountReport report;
  Index left = 0;
};

Counted counted(const Mesh& mesh, double radius, double share, bool optimised = false) {
  Counted result;
  result.before = amps::sample(mesh, with_radius(radius)).samples;
  if (optimised) result.before = amps::optimize(mesh, result.before, {}).samples;
  result.set = result.before;
  const amps::detail::DualRating rating(optimised, optimised, 35, 105);
  amps::RestrictedPowerDiagram diagram(mesh, result.set.positions, amps::detail::weights_of(result.set.radii));
  std::vector<Index> ids;
  const amps::detail::WantedRadii radii(radius, ConflictRule::kMax);
  result.report.wanted = static_cast<Index>(share * result.set.size());
  result.left =
      amps::detail::meet_count({diagram, result.set, ids, nullptr, radii, 0, rating, nullptr, {}, 1}, {}, result.report);
  CHECK(diagram.check() == "");
  CHECK(diagram.num_sites() - diagram.num_removed() == result.set.size());
  return result;
}

struct NamedCount {
  std::string name;
  Mesh mesh;
  Index count;
};

std::vector<NamedCount> counts() {
  return {{"sphere", amps::make_sphere(320), 10},
          {"sphere", amps::make_sphere(1280), 100},
          {"sphere", amps::make_sphere(1280), 777},
          {"square", amps::make_square(), 500},
          {"square", amps::make_square(), 37},
          {"torus", amps::make_torus(), 1234},
          {"knot", small_knot(), 300},
          {"cube", amps::make_cube(3), 501},
          {"open book", open_book(3), 211},
          {"moebius strip", moebius_strip(48, 4), 333},
          {"soup", random_soup(40, 3), 400}};
}

}  // namespace

TEST_CASE("exact count: a set of one radius has as many samples as asked for, and is maximal as ever") {
  for (const NamedCount& wanted : counts()) {
    for (const std::uint64_t seed : {1u, 2u}) {
      CAPTURE(wanted.name);
      CAPTURE(wanted.count);
      const SamplingResult result = amps::sample(wanted.mesh, exactly(wanted.count, seed));
      const ExactCountReport& report = result.report.exact_count;
      CHECK(result.samples.size() == wanted.count);
      check_maximal(wanted.mesh, result);
      CHECK(report.asked);
      CHECK(report.wanted == wanted.count);
      CHECK(report.after == wanted.count);
      CHECK(report.smaller == 0);
      CHECK(report.taken_out == 0);
      CHECK(report.obstacle == CountObstacle::kNothing);
      CHECK(report.coverage <= 1);
      CHECK(report.coverage == doctest::Approx(amps::verify_maximal(wanted.mesh, result.samples).worst_coverage).epsilon(1e-9));
      CHECK(amps::missed_count(report).empty());
      CHECK(result.report.dart_samples + result.report.gap_samples == wanted.count);
    }
  }
}

TEST_CASE("exact count: likewise where disks know their surface, and where radii vary, by either rule") {
  const Mesh mesh = amps::make_ellipsoid(1280, {1.0, 0.6, 0.05});
  for (const Index count : {60, 800}) {
    SamplingOptions options = exactly(count);
    options.neighborhood = amps::Neighborhood::kSurface;
    const SamplingResult result = amps::sample(mesh, options);
    CHECK(result.samples.size() == count);
    CHECK(result.status == Outcome::kDone);
    CHECK(amps::verify_maximal(mesh, result.samples, {}, ConflictRule::kMax, amps::Neighborhood::kSurface).maximal());
    CHECK(amps::verify_maximal(mesh, result.samples, {}, ConflictRule::kMax, amps::Neighborhood::kSurface).poisson_disk());
  }
  for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
    for (const double ratio : {1.5, 8.0}) {
      SamplingOptions options = exactly(903);
      options.sizing = graded_field(amps::make_torus(), ratio, 700);
      options.conflict_rule = rule;
      const SamplingResult result = amps::sample(amps::make_torus(), options);
      CHECK(result.samples.size() == 903);
      check_certificate(amps::make_torus(), result, options);
      CHECK(separation_of_all_pairs(result.samples, rule) >= 1 - 1e-9);
      CHECK(result.report.exact_count.coverage <= 1);
    }
  }
}

TEST_CASE("exact count: balls of other sheets are seen") {
  Index refills = 0;
  for (const double distance : {0.02, 0.08, 0.09, 0.095}) {
    const Mesh mesh = two_sheets(distance);
    for (const double share : {0.93, 1.07}) {
      const Counted result = counted(mesh, 0.1, share);
      CHECK(result.set.size() == result.report.wanted);
      refills += result.report.refills;
      CHECK(all_equal(result.set.radii, 0.1));
      CHECK(separation_of_all_pairs(result.set) >= 1 - 1e-9);
      CHECK(amps::verify_maximal(mesh, result.set).maximal() == (result.report.taken_out == 0));
    }
  }
  CHECK(refills > 40);
}

TEST_CASE("exact count: without room for refills, samples are taken out, and the coverage that is left is told") {
  const Mesh mesh = amps::make_sphere(320);
  const Counted few = counted(mesh, 0.25, 0.6);
  CHECK(few.set.size() == few.report.wanted);
  CHECK(few.report.after == few.report.wanted);
  CHECK(few.report.taken_out > 0);
  CHECK(few.report.refills > 0);
  CHECK(few.report.coverage > 1);
  CHECK(few.report.coverage <= 2);
  CHECK(all_equal(few.set.radii, 0.25));
  CHECK(separation_of_all_pairs(few.set) >= 1);
  check_placement(mesh, few.set);
  check_coverage_by_oracle(mesh, few.set, few.report.coverage);
  const MaximalityReport certificate = amps::verify_maximal(mesh, few.set);
  CHECK(!certificate.maximal());
  CHECK(certificate.worst_coverage == doctest::Approx(few.report.coverage).epsilon(1e-12));
  // Cheap ones go first: taking out so many at random leaves far more.
  Rng rng(5);
  SampleSet random = few.before;
  while (random.size() > few.report.wanted) {
    const Index s = below(rng, random.size());
    random = selected(random, [s](Index t) { return t != s; });
  }
  CHECK(amps::verify_maximal(mesh, random).worst_coverage > few.report.coverage + 0.2);
  // Samples that are left come first, in order.
  CHECK(few.left > 0);
  Index last = -1;
  for (Index s = 0; s < few.left; ++s) {
    Index t = last + 1;
    while (t < few.before.size() && !(sample_at(few.before, t) == sample_at(few.set, s))) ++t;
    REQUIRE(t < few.before.size());
    last = t;
  }
}

TEST_CASE("exact count: without room for disks as wanted, smaller ones enter, and the set is maximal") {
  for (const Mesh& mesh : {amps::make_sphere(320), amps::make_square()}) {
    const double radius = mesh.vertices.rows() > 100 ? 0.25 : 0.08;
    const Counted many = counted(mesh, radius, 1.5);
    CHECK(many.set.size() == many.report.wanted);
    CHECK(many.report.smaller > 0);
    CHECK(many.report.taken_out == 0);
    CHECK(many.report.coverage <= 1);
    CHECK(max_of(many.set.radii) == radius);
    CHECK(min_of(many.set.radii) >= 0.5 * radius);
    CHECK(separation_of_all_pairs(many.set) >= 1);
    CHECK(covered_by_oracle(mesh, many.set));
    CHECK(amps::verify_maximal(mesh, many.set).maximal());
    check_placement(mesh, many.set);
  }
}

TEST_CASE("exact count: what cannot be met costs nothing") {
  const Mesh mesh = amps::make_sphere(320);
  const Counted few = counted(mesh, 0.25, 0.2), many = counted(mesh, 0.25, 9);
  // Here some of it has been tried, and undone: angles and valences are none the worse.
  amps::OptimizeReport bounds;
  bounds.min_angle = 35;
  bounds.max_angle = 105;
  const Mesh square = amps::make_square();
  Counted tried;
  for (double share = 0.44; tried.report.obstacle == CountObstacle::kNothing; share -= 0.01) {
    tried = counted(square, 0.08, share, true);
  }
  CHECK(tried.report.obstacle == CountObstacle::kCoverage);
  CHECK(tried.report.cost == 0);
  CHECK(tried.report.taken_out == 0);
  CHECK(amps::verify_maximal(square, tried.set).maximal());
  CHECK(badness(amps::restricted_triangulation(square, tried.set), bounds).energy <=
        badness(amps::restricted_triangulation(square, tried.before), bounds).energy + 1e-6);
  CHECK(few.set.size() > few.report.wanted);
  CHECK(few.report.obstacle == CountObstacle::kCoverage);
  CHECK(many.set.size() < many.report.wanted);
  CHECK(many.report.obstacle == CountObstacle::kNoRoom);
  for (const Counted* missed : {&few, &many}) {
    CHECK(missed->report.after == missed->set.size());
    CHECK(missed->report.coverage <= 1);
    CHECK(missed->report.smaller == 0);
    CHECK(missed->report.taken_out == 0);
    CHECK(all_equal(missed->set.radii, 0.25));
    CHECK(amps::verify_maximal(mesh, missed->set).maximal());
    CHECK(separation_of_all_pairs(missed->set) >= 1);
    CHECK(!amps::missed_count(missed->report).empty());
  }
}

TEST_CASE("exact count: remesh has as many vertices as asked for, the topology of the surface, and angles as before" *
          doctest::test_suite("slow")) {
  std::vector<std::pair<std::string, Mesh>> meshes = {
      {"sphere", amps::make_sphere(1280)},
      {"torus", amps::make_torus()},
      {"square", amps::make_square()},
      {"knot", small_knot()},
      {"two spheres", joined(amps::make_sphere(320), amps::make_sphere(320, 3))}};
  for (const Shape& shape : shapes()) meshes.emplace_back(shape.name, shape.mesh);
  for (const auto& [name, mesh] : meshes) {
    for (const Index count : {500, 1501}) {
      CAPTURE(name);
      CAPTURE(count);
      if (name == "thin plate" || (name == "channel" && count == 500)) continue;  // below
      const RemeshResult result = amps::remesh(mesh, remesh_exactly(count));
      const amps::RemeshReport& report = result.report;
      CHECK(result.samples.size() == count);
      CHECK(rows(result.mesh.vertices) == count);
      CHECK(report.exact_count.after == count);
      CHECK(report.certificate.holds());
      CHECK(amps::lost_shape(report).empty());
      CHECK(report.maximality.maximal());
      CHECK(report.maximality.poisson_disk());
      CHECK(report.exact_count.coverage <= 1);
      CHECK(report.output.euler_characteristic == report.input.euler_characteristic);
      CHECK(report.output.components == report.input.components);
      CHECK(report.output.boundary_loops == report.input.boundary_loops);
      CHECK(invariants_of(result.mesh) == invariants_of_surface(mesh));
      CHECK(report.curves.edges_kept == report.curves.edges);
      check_placement(mesh, result.samples);
      // A fresh diagram agrees with the one that was edited.
      const MaximalityReport fresh =
          amps::verify_maximal(mesh, result.samples, {}, ConflictRule::kMax, amps::Neighborhood::kSurface, result.graph.get());
      CHECK(fresh.maximal());
      CHECK(fresh.worst_coverage == doctest::Approx(report.exact_count.coverage).epsilon(1e-9));
      if (report.optimization.status == Outcome::kDone && report.exact_count.cost == 0) CHECK(result.status == Outcome::kDone);

      // Samples on curves are those of the set before.
      RemeshOptions nearly = remesh_exactly(count);
      nearly.sampling.exact_count = false;
      const RemeshResult before = amps::remesh(mesh, nearly);
      CHECK(before.samples.size() == report.exact_count.before);
      const Index on_curves = report.curves.samples;
      REQUIRE(on_curves == before.report.curves.samples);
      CHECK(same_set(head(result.samples, on_curves), head(before.samples, on_curves)));
      const bool smooth = report.curves.samples == 0;
      if (smooth) CHECK(report.exact_count.cost == 0);
      if (report.exact_count.cost == 0 && before.report.optimization.status == Outcome::kDone) {
        CHECK(result.report.quality.min_angle >=
              std::min(before.report.quality.min_angle, report.optimization.min_angle) - 1e-6);
        CHECK(result.report.quality.max_angle <=
              std::max(before.report.quality.max_angle, report.optimization.max_angle) + 1e-6);
      }
    }
  }
}

TEST_CASE("exact count: remesh by local feature size, with balls, without optimisation, and of few vertices") {
  for (int kind = 0; kind < 4; ++kind) {
    CAPTURE(kind);
    const Mesh blob = amps::make_ellipsoid(1280, {1.0, 0.6, 0.3});
    const Mesh mesh = kind == 1 || kind == 3 ? blob : data_mesh_or("bunny_3k_closed.off", blob);
    RemeshOptions options = remesh_exactly(kind == 3 ? 60 : 1200);
    if (kind == 0) options.sampling.sizing = amps::lfs_sizing(mesh);
    if (kind == 1) options.sampling.neighborhood = amps::Neighborhood::kSpace;
    if (kind == 2) options.optimize = false;
    const RemeshResult result = amps::remesh(mesh, options);
    CHECK(result.samples.size() == options.sampling.target_count);
    CHECK(result.report.maximality.maximal());
    CHECK(result.report.maximality.poisson_disk());
    CHECK(result.report.certificate.holds());
    CHECK(result.status <= Outcome::kStalled);
    if (kind == 1) CHECK(separation_of_all_pairs(result.samples) >= 1 - 1e-9);
  }
}

TEST_CASE("exact count: fewer than lie on curves cannot be met, and the result says so") {
  const RemeshResult result = amps::remesh(plate(0.01), remesh_exactly(60));
  CHECK(result.status == Outcome::kCountMissed);
  CHECK(result.report.exact_count.obstacle == CountObstacle::kCurves);
  CHECK(result.report.exact_count.after == result.samples.size());
  CHECK(result.samples.size() > 60);
  CHECK(amps::missed_count(result.report.exact_count).find("exactly 60") != std::string::npos);
  CHECK(result.report.maximality.maximal());
  CHECK(result.report.certificate.holds());
}

TEST_CASE("exact count: where curves leave few samples to choose from, a gap is left, and the status says so") {
  const Mesh mesh = channel(0.02);
  const RemeshResult result = amps::remesh(mesh, remesh_exactly(500));
  const amps::RemeshReport& report = result.report;
  CHECK(result.status == Outcome::kNotMaximal);
  CHECK(amps::name_of(result.status) == std::string("not maximal"));
  CHECK(result.samples.size() == 500);
  CHECK(report.exact_count.taken_out > 0);
  CHECK(report.exact_count.coverage > 1);
  CHECK(report.maximality.worst_coverage == doctest::Approx(report.exact_count.coverage).epsilon(1e-12));
  CHECK(!report.maximality.maximal());
  CHECK(report.maximality.poisson_disk());
  const MaximalityReport fresh =
      amps::verify_maximal(mesh, result.samples, {}, ConflictRule::kMax, amps::Neighborhood::kSurface, result.graph.get());
  CHECK(fresh.worst_coverage == doctest::Approx(report.exact_count.coverage).epsilon(1e-9));
  CHECK(fresh.poisson_disk());
  // Nothing but gaps is in the way of the certificate, and the topology is that of the surface.
  CHECK(report.certificate.num_failures(TopologyFailureKind::kUncovered) ==
        static_cast<Index>(report.certificate.failures.size()));
  CHECK(amps::lost_shape(report).empty());
  CHECK(invariants_of(result.mesh) == invariants_of_surface(mesh));
  CHECK(report.curves.edges_kept == report.curves.edges);
}

TEST_CASE("exact count: the same bits on any number of threads") {
  const Mesh mesh = amps::make_cube(3);
  const RemeshResult one = amps::remesh(mesh, remesh_exactly(1499, 1));
  CHECK(one.report.exact_count.refills > 0);
  for (const unsigned threads : {2u, 8u}) {
    const RemeshResult many = amps::remesh(mesh, remesh_exactly(1499, threads));
    CHECK(same_set_on_curves(one.samples, many.samples));
    CHECK(one.mesh.triangles.map() == many.mesh.triangles.map());
  }
  SamplingOptions options = exactly(1777);
  run_on(options, 1);
  const SamplingResult alone = amps::sample(mesh, options);
  CHECK(alone.samples.size() == 1777);
  run_on(options, 8);
  CHECK(same_set(alone.samples, amps::sample(mesh, options).samples));
}

TEST_CASE("exact count: any scale gives the same set") {
  const Mesh mesh = amps::make_torus();
  const double scale = std::ldexp(1.0, 300);
  const SampleSet set = amps::sample(mesh, exactly(700)).samples;
  const SampleSet large = amps::sample(scaled(mesh, scale), exactly(700)).samples;
  CHECK(large.size() == 700);
  CHECK(same_bits(set.barycentrics, large.barycentrics));
}

TEST_CASE("exact count: it needs a number, and it can be cancelled") {
  SamplingOptions options = with_radius(0.1);
  options.exact_count = true;
  CHECK(error_of([&] { amps::sample(amps::make_sphere(80), options); }) == ErrorCode::kInvalidArgument);
  RemeshOptions remeshing;
  remeshing.sampling = options;
  CHECK(error_of([&] { amps::remesh(amps::make_sphere(80), remeshing); }) == ErrorCode::kInvalidArgument);

  const Mesh mesh = amps::make_sphere(1280);
  for (const double at : {0.3, 0.87, 0.93}) {
    SamplingOptions stopped = exactly(3000);
    watch(stopped, [at](const char*, double done) { return done < at; });
    const SamplingResult result = amps::sample(mesh, stopped);
    CHECK(result.status == Outcome::kCancelled);
    if (result.samples.size() > 1) CHECK(separation_of_all_pairs(result.samples) >= 1 - 1e-9);
  }
}

}  // namespace amps_test
