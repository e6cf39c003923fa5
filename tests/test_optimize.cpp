// Optimisation: what it promises of every state, counted anew from the samples alone.
#include "amps/optimize.h"

#include "amps/maximality.h"
#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/shapes.h"
#include "amps/sizing.h"
#include "hash_bits.h"
#include "test_data.h"
#include "test_diagrams.h"
#include "test_models.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

using amps::ErrorCode;
using amps::Index;
using amps::kNone;
using amps::Mesh;
using amps::MeshView;
using amps::OptimizeIteration;
using amps::OptimizeOptions;
using amps::OptimizeReport;
using amps::OptimizeResult;
using amps::Outcome;
using amps::Progress;
using amps::SampleSet;
using amps::SamplingOptions;
using amps::SizingField;
using amps::Vec3;
using amps_test::error_of;

namespace {

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

Mesh moebius_strip(Index along, Index across) {
  constexpr double kPi = 3.14159265358979323846;
  Mesh mesh{amps::Points(along * (across + 1), 3), amps::Triangles(2 * along * across, 3)};
  for (Index i = 0; i < along; ++i) {
    const double t = 2 * kPi * i / along;
    for (Index j = 0; j <= across; ++j) {
      const double v = 0.8 * j / across - 0.4;
      mesh.vertices.row(i * (across + 1) + j) << (1 + v * std::cos(t / 2)) * std::cos(t),
          (1 + v * std::cos(t / 2)) * std::sin(t), v * std::sin(t / 2);
    }
  }
  // The last column is glued to the first, turned over.
  const auto id = [&](Index i, Index j) { return i < along ? i * (across + 1) + j : across - j; };
  for (Index i = 0; i < along; ++i) {
    for (Index j = 0; j < across; ++j) {
      const Index f = 2 * (i * across + j);
      mesh.triangles.row(f) << id(i, j), id(i + 1, j), id(i + 1, j + 1);
      mesh.triangles.row(f + 1) << id(i, j), id(i + 1, j + 1), id(i, j + 1);
    }
  }
  return mesh;
}

/// Two unit squares, one above the other at this distance.
Mesh two_sheets(double distance) {
  return amps_test::joined(amps::make_square(4), amps_test::scaled(amps::make_square(4), 1, Vec3(0, 0, distance)));
}

/// Two spheres around one centre, at this distance: no border, so refills are tried in copies, which do not know the other
/// sheet.
Mesh two_spheres(double distance) { return amps_test::joined(amps::make_sphere(320), amps::make_sphere(320, 1 + distance)); }

/// A maximal set, and what it was made with.
struct TestSet {
  std::string name;
  Mesh mesh;
  SizingField sizing;  ///< empty: uniform
  SampleSet samples;
};

TestSet uniform_set(const std::string& name, const Mesh& mesh, double count, std::uint64_t seed = 1) {
  SamplingOptions options;
  options.radius = amps_test::radius_for(mesh, count);
  options.seed = seed;
  return {name, mesh, {}, amps::sample(mesh, options).samples};
}

/// Radii of ratio 1:8 along the longest axis, as far as the gradation allows.
TestSet graded_set(const std::string& name, const Mesh& mesh, double count, double gradation = 0.1, std::uint64_t seed = 1) {
  const amps::Box box = amps::bounding_box(mesh);
  int axis;
  (box.max - box.min).maxCoeff(&axis);
  Eigen::VectorXd radii(mesh.vertices.rows());
  for (Index v = 0; v < radii.size(); ++v) {
    radii[v] = 1 + 7 * (mesh.vertices(v, axis) - box.min[axis]) / (box.max[axis] - box.min[axis]);
  }
  SamplingOptions options;
  options.sizing = amps::for_count(amps::vertex_sizing(mesh, radii), count, gradation);
  options.seed = seed;
  return {name, mesh, options.sizing, amps::sample(mesh, options).samples};
}

/// Surfaces whose dual triangulations have no edge of more than two triangles (what is rated there is switched on late).
std::vector<TestSet> manifold_sets(double count) {
  return {uniform_set("sphere", amps::make_sphere(320), count),
          uniform_set("torus", amps::make_torus(1, 0.4, 48, 20), count),
          uniform_set("square", amps::make_square(4), count),
          uniform_set("moebius", moebius_strip(60, 6), count),
          graded_set("graded sphere", amps::make_sphere(1280), count),
          graded_set("graded torus", amps::make_torus(1, 0.4, 48, 20), count),
          graded_set("graded square", amps::make_square(16), count)};
}

/// Surfaces where it may have.
std::vector<TestSet> other_sets(double count) {
  const Mesh soup = amps_test::random_soup(12, 401);
  const double r = amps_test::radius_for(two_sheets(0), count);
  return {uniform_set("soup", soup, count),
          graded_set("graded soup", soup, count),
          uniform_set("book of 3 pages", amps_test::open_book(3), count),
          uniform_set("two near sheets", two_sheets(0.4 * r), count),
          uniform_set("two sheets at 1.2 r", two_sheets(1.2 * r), count),
          uniform_set("bunny", amps_test::data_mesh_or("bunny_3k_closed.off", amps::make_ellipsoid(1280, {1.0, 0.8, 0.6})),
                      2 * count)};
}

OptimizeOptions options_for(const TestSet& set, int iterations = 1000) {
  OptimizeOptions options;
  options.sizing = set.sizing;
  options.max_iterations = iterations;
  return options;
}

OptimizeResult optimized(const TestSet& set, const OptimizeOptions& options) {
  return amps::optimize(set.mesh, set.samples, options);
}

/// Maximal and Poisson-disk, by certificate and by all pairs; on its facets; of wanted radii.
void check_state(const TestSet& set, const SampleSet& samples) {
  const amps::MaximalityReport certificate = amps::verify_maximal(set.mesh, samples);
  CHECK(certificate.worst_coverage <= 1 + 1e-9);
  CHECK(certificate.worst_separation >= 1 - 1e-9);
  const auto n = static_cast<std::size_t>(samples.size());
  const double* const x = samples.positions.data();
  const double* const r = samples.radii.data();
  double separation = INFINITY;
  for (std::size_t s = 0; s < n; ++s) {
    for (std::size_t t = 0; t < s; ++t) {
      const double dx = x[3 * s] - x[3 * t], dy = x[3 * s + 1] - x[3 * t + 1], dz = x[3 * s + 2] - x[3 * t + 2];
      const double radius = std::max(r[s], r[t]), ratio = (dx * dx + dy * dy + dz * dz) / (radius * radius);
      if (ratio < separation) separation = ratio;
    }
  }
  CHECK(separation >= 1 - 1e-12);
  REQUIRE(samples.facets.size() == n);
  REQUIRE(samples.barycentrics.rows() == samples.size());
  const MeshView mesh(set.mesh);
  const double least = set.sizing.empty() ? set.samples.radii.minCoeff() : set.sizing.min_radius();
  Index off = 0;
  double off_sum = 0, too_large = 0;
  for (Index s = 0; s < samples.size(); ++s) {
    const Vec3 b = samples.barycentrics.row(s).transpose();
    const Index f = samples.facets[at(s)];
    REQUIRE(f >= 0);
    REQUIRE(f < mesh.num_facets());
    REQUIRE(b.minCoeff() >= 0);
    const Vec3 there = b[0] * mesh.corner(f, 0) + b[1] * mesh.corner(f, 1) + b[2] * mesh.corner(f, 2);
    off += there != samples.positions.row(s).transpose();
    off_sum = std::max(off_sum, std::fabs(b.sum() - 1));
    const double wanted = set.sizing.empty() ? least : set.sizing.radius(f, b);
    too_large = std::max(too_large, samples.radii[s] / wanted);
  }
  CHECK(off == 0);  // derived, to the bit
  CHECK(off_sum <= 1e-14);
  CHECK(too_large <= 1 + 1e-12);
  CHECK(samples.radii.minCoeff() >= least * (1 - 1e-12));
}

/// What is bad in a triangulation, by a formula, a walk and a container of its own.
struct Badness {
  Index triangles = 0, vertices = 0;
  double energy = 0, min_angle = 180, max_angle = 0;
};

/// Angles by the arc cosine, valences by sets of neighbours.
Badness badness(const Mesh& dual, const OptimizeReport& bounds, bool angles = true, bool valences = true) {
  constexpr double kDegree = 3.14159265358979323846 / 180;
  Badness result;
  std::map<std::pair<Index, Index>, int> triangles_of_edge;
  std::vector<std::vector<std::array<Index, 2>>> link(static_cast<std::size_t>(dual.vertices.rows()));
  for (Index t = 0; t < dual.triangles.rows(); ++t) {
    bool bad = false;
    for (int k = 0; k < 3; ++k) {
      const Index a = dual.triangles(t, k), b = dual.triangles(t, (k + 1) % 3), c = dual.triangles(t, (k + 2) % 3);
      ++triangles_of_edge[{std::min(a, b), std::max(a, b)}];
      link[at(a)].push_back({b, c});
      const Vec3 u = (dual.vertices.row(b) - dual.vertices.row(a)).transpose(),
                 v = (dual.vertices.row(c) - dual.vertices.row(a)).transpose();
      const double cosine = u.dot(v) / (u.norm() * v.norm()), angle = std::acos(cosine) / kDegree;
      result.min_angle = std::min(result.min_angle, angle);
      result.max_angle = std::max(result.max_angle, angle);
      if (!angles) continue;
      const double low = bounds.min_angle, high = bounds.max_angle;
      if (angle < low) result.energy += 0.25 + (cosine - std::cos(low * kDegree)) / (std::sin(low * kDegree) * kDegree);
      if (angle > high) result.energy += 0.5 + 0.5 * (std::cos(high * kDegree) - cosine) / (std::sin(high * kDegree) * kDegree);
      bad = bad || angle < low || angle > high;
    }
    result.triangles += bad;
  }
  for (std::size_t v = 0; v < link.size() && valences; ++v) {
    std::set<Index> neighbors;
    int ends = 0;
    bool crossing = false;
    for (const auto& [a, b] : link[v]) neighbors.insert({a, b});
    for (const Index w : neighbors) {
      const int count = triangles_of_edge[{std::min(static_cast<Index>(v), w), std::max(static_cast<Index>(v), w)}];
      ends += count == 1;
      crossing = crossing || count > 2;
    }
    if (neighbors.empty() || crossing || (ends != 0 && ends != 2)) continue;
    if (ends == 2) {  // one fan?
      std::set<Index> reached = {link[v][0][0]};
      for (std::size_t before = 0; before != reached.size();) {
        before = reached.size();
        for (const auto& [a, b] : link[v]) {
          if (reached.count(a) != 0 || reached.count(b) != 0) reached.insert({a, b});
        }
      }
      if (reached.size() != neighbors.size()) continue;
    }
    const int n = static_cast<int>(neighbors.size());
    const int off = ends == 2 ? std::max(0, n - 5) : n < 5 ? 5 - n : std::max(0, n - 7);
    result.vertices += off != 0;
    result.energy += 5 * off;
  }
  return result;
}

Badness badness(const TestSet& set, const SampleSet& samples, const OptimizeReport& bounds, bool angles = true,
                bool valences = true) {
  return badness(amps::restricted_triangulation(set.mesh, samples), bounds, angles, valences);
}

void check_line(const OptimizeIteration& line, const Badness& expected, const SampleSet& samples) {
  CHECK(line.bad_triangles == expected.triangles);
  CHECK(line.bad_vertices == expected.vertices);
  CHECK(line.energy == doctest::Approx(expected.energy).epsilon(1e-7));  // the bounds are kept with a margin of 1e-9 degrees
  CHECK(line.samples == samples.size());
}

/// Survivors first, in order, to the bit; report.removed and .added; new ones are new.
void check_survivors(const SampleSet& before, const OptimizeResult& result) {
  const SampleSet& after = result.samples;
  const Index kept = before.size() - result.report.removed;
  REQUIRE(kept >= 0);
  REQUIRE(kept + result.report.added == after.size());
  Index from = 0;
  for (Index s = 0; s < kept; ++s, ++from) {
    while (from < before.size() && before.positions.row(from) != after.positions.row(s)) ++from;
    REQUIRE(from < before.size());
    REQUIRE(before.radii[from] == after.radii[s]);
    if (before.facets.empty()) {
      REQUIRE(after.facets[at(s)] == kNone);
      continue;
    }
    REQUIRE(before.facets[at(from)] == after.facets[at(s)]);
    REQUIRE(before.barycentrics.row(from) == after.barycentrics.row(s));
  }
  std::set<std::array<double, 3>> old;
  for (Index s = 0; s < before.size(); ++s)
    old.insert({before.positions(s, 0), before.positions(s, 1), before.positions(s, 2)});
  Index known = 0;
  for (Index s = kept; s < after.size(); ++s) {
    known += old.count({after.positions(s, 0), after.positions(s, 1), after.positions(s, 2)}) != 0;
  }
  CHECK(known == 0);
}

void check_never_rises(const OptimizeReport& report) {
  for (std::size_t k = 1; k < report.iterations.size(); ++k) {
    CAPTURE(k);
    CHECK(report.iterations[k].energy <= report.iterations[k - 1].energy * (1 + 1e-12));
  }
}

bool same_set(const SampleSet& a, const SampleSet& b) {
  return a.size() == b.size() && a.positions == b.positions && a.radii == b.radii && a.facets == b.facets &&
         a.barycentrics == b.barycentrics;
}

/// But for the seconds.
bool same_line(const OptimizeIteration& a, const OptimizeIteration& b) {
  return a.bad_triangles == b.bad_triangles && a.bad_vertices == b.bad_vertices && a.min_angle == b.min_angle &&
         a.max_angle == b.max_angle && a.samples == b.samples && a.energy == b.energy;
}

bool same_course(const OptimizeReport& a, const OptimizeReport& b) {
  return a.status == b.status && a.trials == b.trials && a.edits == b.edits && a.accepted == b.accepted &&
         a.removed == b.removed && a.added == b.added && a.iterations.size() == b.iterations.size() &&
         std::equal(a.iterations.begin(), a.iterations.end(), b.iterations.begin(), same_line);
}

/// All laws of one result.
void check_result(const TestSet& set, const OptimizeResult& result, bool rated_once = true) {
  check_state(set, result.samples);
  check_survivors(set.samples, result);
  REQUIRE(!result.report.iterations.empty());
  if (rated_once) {
    const Badness before = badness(set, set.samples, result.report), after = badness(set, result.samples, result.report);
    check_line(result.report.iterations.front(), before, set.samples);
    check_line(result.report.iterations.back(), after, result.samples);
    CHECK(result.report.iterations.front().min_angle == doctest::Approx(before.min_angle).epsilon(1e-9));
    CHECK(result.report.iterations.front().max_angle == doctest::Approx(before.max_angle).epsilon(1e-9));
    CHECK(result.report.iterations.back().min_angle == doctest::Approx(after.min_angle).epsilon(1e-9));
    CHECK(result.report.iterations.back().max_angle == doctest::Approx(after.max_angle).epsilon(1e-9));
    check_never_rises(result.report);
    CHECK((result.report.status == Outcome::kDone) == (after.triangles + after.vertices == 0));
  }
}

}  // namespace

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
  const double r = amps_test::radius_for(two_spheres(0), 600);
  for (const double distance : {0.7, 0.8, 0.9}) {
    CAPTURE(distance);
    const TestSet set = uniform_set("", two_spheres(distance * r), 600);
    for (const int k : {2, 40}) check_result(set, optimized(set, options_for(set, k)), false);
  }
}

TEST_CASE("optimize: kicks and what is undone leave every radius, place and weight as they were") {
  for (const TestSet& set :
       {graded_set("sphere", amps::make_sphere(320), 50, 0.4), graded_set("square", amps::make_square(8), 60, 0.2),
        graded_set("torus", amps::make_torus(1, 0.4, 48, 20), 120, 0.4)}) {
    CAPTURE(set.name);
    OptimizeOptions options = options_for(set, 100);
    options.min_angle = 44;
    options.max_angle = 92;
    amps::RestrictedPowerDiagram diagram = amps::detail::diagram_of(set.mesh, set.samples, 1);
    std::vector<Index> ids;
    const OptimizeResult result = amps::detail::optimize_diagram(diagram, set.samples, options, ids);
    check_result(set, result);
    REQUIRE(ids.size() == static_cast<std::size_t>(result.samples.size()));
    for (Index s = 0; s < result.samples.size(); ++s) {
      CHECK(diagram.site(ids[at(s)]).w == result.samples.radii[s] * result.samples.radii[s]);
      CHECK(diagram.site(ids[at(s)]).position() == result.samples.positions.row(s).transpose());
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
    // Vertices that are no crossings are counted here; the report may count more.
    const Badness after = badness(set, result.samples, result.report);
    CHECK(result.report.iterations.back().bad_triangles == after.triangles);
    CHECK(result.report.iterations.back().bad_vertices >= after.vertices);
    CHECK(result.report.iterations.back().energy >= after.energy * (1 - 1e-9));
    if (result.report.status == Outcome::kDone) CHECK(after.triangles + after.vertices == 0);
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
        uniform_set("soup", amps_test::random_soup(12, 401), 300)}) {
    CAPTURE(set.name);
    OptimizeOptions options = options_for(set, 20);
    options.seed = 7;
    const OptimizeResult first = optimized(set, options);
    for (const unsigned threads : {1u, 2u, 3u, 0u}) {
      CAPTURE(threads);
      options.threads = threads;
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
  SampleSet bare = set.samples;
  bare.facets.clear();
  bare.barycentrics.resize(0, 3);
  const OptimizeResult result = amps::optimize(set.mesh, bare, options_for(set));
  CHECK(result.samples.positions == expected.samples.positions);
  CHECK(result.samples.radii == expected.samples.radii);
  check_survivors(bare, result);
  const Index kept = set.samples.size() - result.report.removed;
  for (Index s = 0; s < result.samples.size(); ++s) {
    CHECK((result.samples.facets[at(s)] == kNone) == (s < kept));
    if (s >= kept) {
      CHECK(result.samples.barycentrics.row(s) == expected.samples.barycentrics.row(s));
    } else {
      CHECK(result.samples.barycentrics.row(s).isZero(0));
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
    options.progress.cancel();
    const OptimizeResult at_once = optimized(set, options);
    CHECK(at_once.report.status == Outcome::kCancelled);
    CHECK(same_set(at_once.samples, set.samples));
    CHECK(at_once.report.iterations.size() == 1);
    for (const int calls : {1, 2, 3, 5}) {
      CAPTURE(calls);
      int seen = 0;
      double fraction = 0;
      bool in_order = true;
      options.progress = Progress([&](const char*, double f) {
        in_order = in_order && f >= fraction && f <= 1;
        fraction = f;
        return ++seen < calls;
      });
      const OptimizeResult result = optimized(set, options);
      CHECK(in_order);
      check_result(set, result);
      if (seen < calls) {  // it was faster
        CHECK(calls > 3);
        CHECK(same_set(result.samples, whole.samples));
        continue;
      }
      CHECK(seen == calls);
      CHECK(result.report.status == Outcome::kCancelled);
      CHECK(result.report.iterations.size() <= whole.report.iterations.size());
      if (calls == 1) CHECK(same_set(result.samples, set.samples));
      if (calls > 2) CHECK(result.report.iterations.back().energy < result.report.iterations.front().energy);
    }
    // Watching changes nothing.
    options.progress = Progress([](const char*, double) { return true; });
    const OptimizeResult watched = optimized(set, options);
    CHECK(same_set(watched.samples, whole.samples));
    CHECK(same_course(watched.report, whole.report));
  }
  // There is nothing to cancel where nothing is bad.
  const TestSet set = uniform_set("sphere", amps::make_sphere(320), 200);
  OptimizeOptions options = options_for(set);
  options.angles = options.valences = false;
  options.progress.cancel();
  CHECK(optimized(set, options).report.status == Outcome::kDone);
}

TEST_CASE("optimize: what is good is left alone") {
  const TestSet set = uniform_set("sphere", amps::make_sphere(320), 300);
  const TestSet good{"", set.mesh, {}, optimized(set, options_for(set)).samples};
  const OptimizeResult again = optimized(good, options_for(good));
  CHECK(again.report.status == Outcome::kDone);
  CHECK(same_set(again.samples, good.samples));
  CHECK(again.report.trials == 0);
}

TEST_CASE("optimize: a few samples, on closed and open surfaces") {
  const std::vector<amps_test::NamedMesh> meshes = {{"sphere", amps::make_sphere(80)},
                                                    {"square", amps::make_square(2)},
                                                    {"moebius", moebius_strip(24, 2)},
                                                    {"two sheets", two_sheets(0.1)},
                                                    {"soup", amps_test::random_soup(5, 402)}};
  for (const auto& model : meshes) {
    const Mesh& mesh = model.mesh;
    CAPTURE(model.name);
    const double diagonal = amps::bounding_box(mesh).diagonal();
    for (const double size : {2.0, 0.6, 0.4, 0.3, 0.2}) {
      SamplingOptions sampling;
      sampling.radius = size * diagonal;
      const TestSet set{model.name, mesh, {}, amps::sample(mesh, sampling).samples};
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
  SamplingOptions sampling;
  sampling.radius = amps_test::radius_for(mesh, 300);
  const SampleSet darts = amps::throw_darts(mesh, sampling).samples;
  SampleSet sparse{darts.positions.topRows(170), darts.radii.head(170), {}, {}};
  SampleSet crowded = darts, doubled = darts;
  crowded.radii *= 1.5;
  doubled.positions.row(3) = doubled.positions.row(2);
  for (const SampleSet* samples : {&darts, static_cast<const SampleSet*>(&sparse), static_cast<const SampleSet*>(&crowded),
                                   static_cast<const SampleSet*>(&doubled)}) {
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

TEST_CASE("optimize: the diagram given is that of the result") {
  for (const TestSet& set :
       {uniform_set("torus", amps::make_torus(1, 0.4, 48, 20), 300), graded_set("square", amps::make_square(16), 300),
        uniform_set("soup", amps_test::random_soup(12, 401), 200)}) {
    CAPTURE(set.name);
    OptimizeOptions options = options_for(set, 40);
    options.min_angle = 40;
    amps::RestrictedPowerDiagram diagram = amps::detail::diagram_of(set.mesh, set.samples, 1);
    std::vector<Index> ids;
    const OptimizeResult result = amps::detail::optimize_diagram(diagram, set.samples, options, ids);
    CHECK(same_set(result.samples, optimized(set, options).samples));
    REQUIRE(ids.size() == static_cast<std::size_t>(result.samples.size()));
    REQUIRE(diagram.num_sites() - diagram.num_removed() == result.samples.size());
    CHECK(amps_test::broken_law(set.mesh, diagram) == "");
    const amps_test::Diagram fresh = amps::detail::diagram_of(set.mesh, result.samples, 1);
    amps_test::CanonicalDiagram expected;
    for (const auto& [key, polygon] : amps_test::canonical(fresh)) {
      amps_test::Canonical& entry = expected[{key.first, ids[at(key.second)]}];
      // Named as in the edited diagram, and turned to begin with its least label.
      std::vector<Index> labels = polygon.labels;
      for (Index& label : labels) {
        if (amps_test::Diagram::is_site(label)) label = ids[at(label)];
      }
      const auto start = std::min_element(labels.begin(), labels.end()) - labels.begin();
      for (std::size_t k = 0; k < labels.size(); ++k) {
        const std::size_t from = (static_cast<std::size_t>(start) + k) % labels.size();
        entry.labels.push_back(labels[from]);
        entry.corners.push_back(polygon.corners[from]);
      }
    }
    CHECK(expected == amps_test::canonical(diagram));
  }
}

TEST_CASE("optimize: options and sets that cannot be are refused, and the message says why") {
  const TestSet set = uniform_set("", amps::make_sphere(80), 50);
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  const auto refused = [&](void (*change)(OptimizeOptions&, double), double value) {
    OptimizeOptions options;
    change(options, value);
    return error_of([&] { optimized(set, options); }) == ErrorCode::kInvalidArgument;
  };
  for (const double low : {-1.0, 60.0, 75.0, nan, inf, -inf})
    CHECK(refused([](OptimizeOptions& o, double x) { o.min_angle = x; }, low));
  for (const double high : {-1.0, 60.0, 45.0, 180.0, nan, inf})
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
  broken.positions(3, 1) = nan;
  CHECK(refuses(broken));
  broken = set.samples;
  broken.radii[2] = 0;
  CHECK(refuses(broken));
  broken.radii[2] = nan;
  CHECK(refuses(broken));
  broken = set.samples;
  broken.facets.pop_back();
  CHECK(refuses(broken));
  CHECK(error_of([&] {
          amps::optimize(Mesh{amps::Points(0, 3), amps::Triangles(0, 3)}, set.samples, options);
        }) == ErrorCode::kInvalidMesh);
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

TEST_CASE("optimize: the same seed gives the same bits with every compiler and build type") {
  // Recorded once, for valences alone; test_remesh has the bits of both.
  const auto hash = [](const SampleSet& set) { return amps_test::hash_bits(set.positions, set.radii, set.barycentrics); };
  const auto bits = [&](const TestSet& set) {
    OptimizeOptions options = options_for(set);
    options.angles = false;
    return hash(optimized(set, options).samples);
  };
  CHECK(bits(uniform_set("", amps::make_square(3), 900)) == 9617786904074402353u);
  CHECK(bits(uniform_set("", amps::make_cube(7), 900)) == 1564647869874391754u);
  CHECK(bits(graded_set("", amps::make_square(12), 900)) == 16379450160354872760u);
}

TEST_CASE("optimize: large sets keep every law" * doctest::test_suite("slow")) {
  for (const TestSet& set : manifold_sets(6000)) {
    CAPTURE(set.name);
    check_result(set, optimized(set, options_for(set)));
    OptimizeOptions options = options_for(set);
    options.min_angle = 40;
    options.max_angle = 95;
    options.threads = 2;
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
  for (const auto& model : amps_test::real_models()) {
    CAPTURE(model.name);
    const TestSet set = uniform_set(model.name, model.mesh, 3000);
    check_result(set, optimized(set, options_for(set, 60)), false);
    SamplingOptions options;
    options.sizing = amps::for_count(amps::lfs_sizing(model.mesh).with_ratio(16), 3000);
    const TestSet graded{model.name, model.mesh, options.sizing, amps::sample(model.mesh, options).samples};
    check_result(graded, optimized(graded, options_for(graded, 60)), false);
  }
}
