// Sampling with radii that vary over the surface: sampling.h and remesh.h with a sizing field.
#include "amps/maximality.h"
#include "amps/quality.h"
#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/shapes.h"
#include "amps/sizing.h"
#include "hash_bits.h"
#include "test_models.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

using amps::ConflictRule;
using amps::Error;
using amps::ErrorCode;
using amps::Index;
using amps::MaximalityReport;
using amps::Mesh;
using amps::MeshView;
using amps::Outcome;
using amps::Rng;
using amps::SampleSet;
using amps::SamplingOptions;
using amps::SamplingResult;
using amps::SizingField;
using amps::Vec3;

namespace {

/// Radii from 1 to `ratio` along z, then scaled so that about `count` samples come of it.
SizingField graded_field(const Mesh& mesh, double ratio, double count) {
  const amps::Box box = amps::bounding_box(mesh);
  int axis;
  (box.max - box.min).maxCoeff(&axis);
  Eigen::VectorXd radii(mesh.vertices.rows());
  for (Index v = 0; v < mesh.vertices.rows(); ++v) {
    const double t = (mesh.vertices(v, axis) - box.min[axis]) / (box.max[axis] - box.min[axis]);
    radii[v] = 1 + (ratio - 1) * std::min(std::max(t, 0.0), 1.0);  // isolated vertices may lie outside
  }
  const SizingField field = amps::vertex_sizing(mesh, radii);
  return field.scaled(std::sqrt(amps::kSamplesPerDensity * field.density_integral() / count));
}

/// Radii that leap from vertex to vertex by factors of up to `ratio`.
SizingField wild_field(const Mesh& mesh, double ratio, double count, std::uint64_t seed) {
  Rng rng(seed);
  Eigen::VectorXd radii(mesh.vertices.rows());
  for (Index v = 0; v < mesh.vertices.rows(); ++v) radii[v] = std::pow(ratio, rng.uniform());
  const SizingField field = amps::vertex_sizing(mesh, radii);
  return field.scaled(std::sqrt(amps::kSamplesPerDensity * field.density_integral() / count));
}

SamplingOptions with_sizing(const SizingField& field, std::uint64_t seed = 1, ConflictRule rule = ConflictRule::kMax) {
  SamplingOptions options;
  options.sizing = field;
  options.seed = seed;
  options.conflict_rule = rule;
  return options;
}

Vec3 sample_at(const SampleSet& set, Index s) { return set.positions.row(s).transpose(); }

/// Oracle: all pairs.
double separation_of_all_pairs(const SampleSet& set, ConflictRule rule) {
  const double* const x = set.positions.data();  // plain arrays: Eigen is slow without optimisation
  const double* const r = set.radii.data();
  double worst = INFINITY;
  for (Index s = 0; s < set.size(); ++s) {
    for (Index t = 0; t < s; ++t) {
      const double dx = x[3 * s] - x[3 * t], dy = x[3 * s + 1] - x[3 * t + 1], dz = x[3 * s + 2] - x[3 * t + 2];
      const double radius = (r[s] > r[t]) == (rule == ConflictRule::kMax) ? r[s] : r[t];
      const double ratio = (dx * dx + dy * dy + dz * dz) / (radius * radius);
      if (ratio < worst) worst = ratio;
    }
  }
  return std::sqrt(worst);
}

/// Oracle: a triangle is covered if one ball contains its corners; else both halves of it are looked at, among the balls that
/// reach it. No power diagram, no grid.
bool all_covered(const std::array<Vec3, 3>& t, const SampleSet& set, const std::vector<Index>& candidates) {
  constexpr double kTolerance = 1e-9;
  std::vector<Index> near;
  const Vec3 centre = (t[0] + t[1] + t[2]) / 3;
  double extent = 0;
  for (const Vec3& x : t) extent = std::max(extent, (x - centre).norm());
  double least = INFINITY;
  for (const Index s : candidates) {
    const double reach = set.radii[s] * (1 + kTolerance);
    const double distance = (sample_at(set, s) - centre).norm();
    if (distance > reach + extent) continue;
    if (std::all_of(t.begin(), t.end(), [&](const Vec3& x) { return (x - sample_at(set, s)).norm() <= reach; })) return true;
    near.push_back(s);
    least = std::min(least, set.radii[s]);
  }
  if (near.empty() || extent < kTolerance * least) return false;
  std::size_t from = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if ((t[k] - t[(k + 1) % 3]).norm() > (t[from] - t[(from + 1) % 3]).norm()) from = k;
  }
  const Vec3 middle = (t[from] + t[(from + 1) % 3]) / 2;
  std::array<Vec3, 3> first = t, second = t;
  first[(from + 1) % 3] = middle;
  second[from] = middle;
  return all_covered(first, set, near) && all_covered(second, set, near);
}

bool all_covered(const Mesh& mesh, const SampleSet& set) {
  std::vector<Index> all;
  for (Index s = 0; s < set.size(); ++s) all.push_back(s);
  const MeshView view(mesh);
  for (Index f = 0; f < view.num_facets(); ++f) {
    if (!all_covered({view.corner(f, 0), view.corner(f, 1), view.corner(f, 2)}, set, all)) return false;
  }
  return true;
}

/// Radii are positive, never above the field, and not below its least value but for one rounding of a distance.
void check_radii(const SampleSet& set, const SizingField& field, double least) {
  Index above = 0;
  for (Index s = 0; s < set.size(); ++s) {
    above += set.radii[s] > field.radius(set.facets[static_cast<std::size_t>(s)], set.barycentrics.row(s).transpose());
  }
  CHECK(above == 0);
  CHECK(set.radii.minCoeff() >= least * (1 - 1e-15));
}

void check_certificate(const Mesh& mesh, const SamplingResult& result, const SamplingOptions& options) {
  CHECK(result.status == Outcome::kDone);
  CHECK(result.report.unfilled_gaps == 0);
  const bool constant = options.sizing.min_radius() == options.sizing.max_radius();
  CHECK((result.report.radius == 0) == !constant);
  const MaximalityReport certificate = amps::verify_maximal(mesh, result.samples, 1, options.conflict_rule);
  CHECK(certificate.worst_coverage <= 1 + 1e-9);
  CHECK(certificate.worst_separation >= 1 - 1e-9);
  CHECK(certificate.gaps == 0);
  const SizingField field = options.sizing.scaled(result.report.sizing_scale);
  check_radii(result.samples, field, field.min_radius());
  CHECK(result.report.min_radius == result.samples.radii.minCoeff());
  CHECK(result.report.max_radius == result.samples.radii.maxCoeff());
  CHECK(result.report.mean_radius == doctest::Approx(result.samples.radii.mean()).epsilon(1e-12));
}

double chi_square_score(const std::vector<double>& observed, const std::vector<double>& expected) {
  double chi2 = 0;
  for (std::size_t k = 0; k < observed.size(); ++k)
    chi2 += (observed[k] - expected[k]) * (observed[k] - expected[k]) / expected[k];
  const double v = static_cast<double>(observed.size() - 1);
  return (std::cbrt(chi2 / v) - (1 - 2 / (9 * v))) / std::sqrt(2 / (9 * v));
}

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
double density_score(const Mesh& mesh, const Eigen::VectorXd& radii, const std::vector<std::pair<Index, Vec3>>& samples,
                     Index cuts) {
  const std::vector<double> areas = amps::facet_areas(mesh);
  std::vector<double> expected, observed;
  for (Index f = 0; f < mesh.triangles.rows(); ++f) {
    const Vec3 at_corners(radii[mesh.triangles(f, 0)], radii[mesh.triangles(f, 1)], radii[mesh.triangles(f, 2)]);
    for (const double part : density_of_parts(at_corners, cuts)) expected.push_back(part * areas[static_cast<std::size_t>(f)]);
  }
  double total = 0;
  for (const double e : expected) total += e;
  observed.assign(expected.size(), 0);
  for (const auto& [facet, b] : samples) {
    observed[static_cast<std::size_t>(facet * cuts * cuts) + part_of(b, cuts)] += 1;
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

ErrorCode error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    CHECK(std::string(error.what()).size() > 20);
    return error.code();
  }
  FAIL("no error was thrown");
  return ErrorCode::kInternal;
}

bool same_rows(const SampleSet& a, const SampleSet& b) {
  return a.size() == b.size() && a.positions == b.positions && a.radii == b.radii && a.facets == b.facets &&
         a.barycentrics == b.barycentrics;
}

}  // namespace

TEST_CASE("adaptive: sets are maximal Poisson-disk sets by certificate, by all pairs and by bisection") {
  for (const auto& model : amps_test::procedural_models()) {
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
        CHECK(amps::verify_maximal(mesh, result.samples, 1, rule).worst_separation ==
              doctest::Approx(separation).epsilon(1e-12));
        CHECK(all_covered(mesh, result.samples));
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
        CHECK(all_covered(mesh, result.samples));
        if (rule == ConflictRule::kMax) {  // some radii had to be cut
          Index cut = 0;
          for (Index s = result.report.dart_samples; s < result.samples.size(); ++s) {
            cut += result.samples.radii[s] < options.sizing.radius(result.samples.facets[static_cast<std::size_t>(s)],
                                                                   result.samples.barycentrics.row(s));
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
  SampleSet fewer{set.positions.topRows(set.size() - 1), set.radii.head(set.size() - 1), {}, {}};
  CHECK_FALSE(all_covered(mesh, fewer));
  CHECK_FALSE(amps::verify_maximal(mesh, fewer).maximal());
  SampleSet larger = set;
  larger.radii *= 1.5;
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
    if (trial % 4 == 3) set.radii[static_cast<Index>(rng.below(static_cast<std::uint64_t>(set.size())))] *= 3;
    for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
      REQUIRE(amps::verify_maximal(mesh, set, 1, rule).worst_separation ==
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
    const Index n = 4 + static_cast<Index>(rng.below(12));
    SampleSet set{amps::Points(n, 3), Eigen::VectorXd(n), {}, {}};
    for (Index s = 0; s < n; ++s) {
      set.positions.row(s) << rng.uniform(), rng.uniform(), 0.05 * rng.uniform();
      set.radii[s] = 0.05 + 0.3 * rng.uniform();
    }
    const amps::RestrictedPowerDiagram diagram(mesh, set.positions, set.radii.cwiseAbs2());
    bool all_visible = true;
    for (Index s = 0; s < n; ++s) all_visible = all_visible && diagram.visible(s);
    visible_sets += all_visible;
    for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
      REQUIRE(amps::verify_maximal(mesh, set, 1, rule).worst_separation ==
              doctest::Approx(separation_of_all_pairs(set, rule)).epsilon(1e-12));
    }
  }
  CHECK(visible_sets > 100);
}

TEST_CASE("adaptive: the first dart has density 1/r², in large triangles too") {
  struct Case {
    Mesh mesh;
    Eigen::VectorXd radii;
    Index cuts;
  };
  std::vector<Case> cases;
  Mesh triangle;
  triangle.vertices.resize(3, 3);
  triangle.vertices << 0, 0, 0, 1, 0, 0, 0.2, 0.9, 0;
  triangle.triangles.resize(1, 3);
  triangle.triangles << 0, 1, 2;
  for (const Vec3& radii : {Vec3(1, 16, 16), Vec3(16, 1, 1), Vec3(4, 1, 16), Vec3(1, 1.9, 1.3), Vec3(2, 1, 2)}) {
    cases.push_back({triangle, radii, 8});
  }
  const Mesh sphere = amps::make_sphere(20);
  Rng field_rng(4);
  Eigen::VectorXd radii(sphere.vertices.rows());
  for (Index v = 0; v < radii.size(); ++v) radii[v] = std::pow(16.0, field_rng.uniform());
  cases.push_back({sphere, radii, 2});
  for (const Case& c : cases) {
    SamplingOptions options = with_sizing(amps::vertex_sizing(c.mesh, c.radii).scaled(1e3));  // the first dart is the only one
    options.max_rejections = 1;
    std::vector<std::pair<Index, Vec3>> first;
    for (std::uint64_t seed = 1; seed <= 20000; ++seed) {
      options.seed = seed;
      const SampleSet set = amps::throw_darts(c.mesh, options).samples;
      first.emplace_back(set.facets[0], set.barycentrics.row(0).transpose());
    }
    const double score = density_score(c.mesh, c.radii, first, c.cuts);
    CHECK(std::fabs(score) < 3.5);
    const Eigen::VectorXd flat = Eigen::VectorXd::Constant(c.radii.size(), 1.0);
    CHECK(density_score(c.mesh, flat, first, c.cuts) > 10);  // it would notice darts of uniform density
  }
}

TEST_CASE("adaptive: across 1:1000 within a triangle darts fall by ∫1/r² in closed form") {
  // r = 1 + 999x over the unit right triangle: ∫ between two x is ∫ (1 − x)/(1 + 999x)² dx.
  Mesh mesh;
  mesh.vertices.resize(3, 3);
  mesh.vertices << 0, 0, 0, 1, 0, 0, 0, 1, 0;
  mesh.triangles.resize(1, 3);
  mesh.triangles << 0, 1, 2;
  const double g = 999;
  const auto integral = [&](double x) {  // antiderivative, from 0
    const double r = 1 + g * x;
    return (1 + 1 / g) / g * (1 - 1 / r) - std::log(r) / (g * g);
  };
  SamplingOptions options = with_sizing(amps::vertex_sizing(mesh, Vec3(1, 1000, 1)).scaled(100));
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
  Eigen::VectorXd radii(mesh.vertices.rows());
  for (Index v = 0; v < radii.size(); ++v) radii[v] = 1 + 7.5 * (1 + mesh.vertices(v, 2));
  for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
    SamplingOptions options = with_sizing(amps::vertex_sizing(mesh, radii).scaled(3e-3), 1, rule);
    std::vector<std::pair<Index, Vec3>> early;
    for (std::uint64_t seed = 1; seed <= 25; ++seed) {
      options.seed = seed;
      options.max_rejections = 3;  // ends while the surface is nearly empty: hardly any dart has met another
      const SampleSet set = amps::throw_darts(mesh, options).samples;
      for (Index s = 0; s < set.size(); ++s)
        early.emplace_back(set.facets[static_cast<std::size_t>(s)], set.barycentrics.row(s));
    }
    REQUIRE(early.size() > 2000);
    CHECK(density_score(mesh, radii, early, 1) < 3.5);
  }
}

TEST_CASE("adaptive: the same bits for any number of threads, other bits for another seed") {
  const Mesh mesh = amps::make_knot();
  SamplingOptions options = with_sizing(graded_field(mesh, 16, 3000), 7);
  const SamplingResult first = amps::sample(mesh, options);
  for (const unsigned threads : {2u, 5u, 0u}) {
    options.threads = threads;
    CHECK(same_rows(first.samples, amps::sample(mesh, options).samples));
  }
  options.seed = 8;
  CHECK(!same_rows(first.samples, amps::sample(mesh, options).samples));
}

TEST_CASE("adaptive: a field that is the same everywhere is a radius, whatever the rule") {
  const Mesh mesh = amps::make_torus();
  SamplingOptions uniform;
  uniform.radius = 0.1;
  const SamplingResult expected = amps::sample(mesh, uniform);
  for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
    const SamplingResult result = amps::sample(mesh, with_sizing(amps::uniform_sizing(mesh, 0.1), 1, rule));
    CHECK(same_rows(expected.samples, result.samples));
    CHECK(result.report.radius == 0.1);
  }
}

TEST_CASE("adaptive: target_count scales the field, within 1 %") {
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
          CHECK(same_rows(result.samples, amps::sample(mesh, again).samples));
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
      REQUIRE(result.samples.radii[s] ==
              options.sizing.radius(result.samples.facets[static_cast<std::size_t>(s)], result.samples.barycentrics.row(s)));
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
    CHECK(result.samples.positions.topRows(existing.size()) == existing.positions);
    CHECK(result.samples.radii.head(existing.size()) == existing.radii);
    const MaximalityReport report = amps::verify_maximal(mesh, result.samples);
    CHECK(report.maximal());
    CHECK(all_covered(mesh, result.samples));
    // No new disk covers a sample, no new sample lies in a disk.
    double worst = INFINITY;
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
  std::vector<Index> half;
  for (Index s = 0; s < own.size(); s += 2) half.push_back(s);
  CHECK(fill({own.positions(half, Eigen::all), own.radii(half), {}, {}}).poisson_disk());
  // Points off the surface with radii far above and below the field's, hidden ones among them.
  Rng rng(3);
  SampleSet random{amps::Points(60, 3), Eigen::VectorXd(60), {}, {}};
  for (Index s = 0; s < 60; ++s) {
    random.positions.row(s) << 3 * rng.uniform() - 1.5, 3 * rng.uniform() - 1.5, rng.uniform() - 0.5;
    random.radii[s] = field.min_radius() * std::pow(100.0, rng.uniform()) / 3;
  }
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
  const amps::RestrictedPowerDiagram diagram(mesh, result.samples.positions, result.samples.radii.cwiseAbs2());
  Index hidden = 0;
  for (Index s = 0; s < diagram.num_sites(); ++s) hidden += !diagram.visible(s);
  CHECK(hidden == 0);
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
  Eigen::VectorXd radii = Eigen::VectorXd::Constant(mesh.vertices.rows(), 1.0);
  radii[0] = 1e-8;
  options = with_sizing(amps::vertex_sizing(mesh, radii));
  CHECK(error_of([&] { amps::sample(mesh, options); }) == ErrorCode::kTooLarge);
}

TEST_CASE("adaptive: cancelled at any stage, what is there is a Poisson-disk set and says so") {
  const Mesh mesh = amps::make_torus();
  for (const char* const wanted : {"dart throwing", "restricted power diagram", "gap filling"}) {
    SamplingOptions options = with_sizing(graded_field(mesh, 16, 3000));
    int seen = 0;
    options.progress = amps::Progress([&](const char* stage, double) { return std::string(stage) != wanted || ++seen < 2; });
    const SamplingResult result = amps::sample(mesh, options);
    CHECK(result.status == Outcome::kCancelled);
    CHECK(result.samples.size() > 0);
    CHECK(separation_of_all_pairs(result.samples, ConflictRule::kMax) >= 1 - 1e-9);
  }
}

TEST_CASE("adaptive: progress stays within [0, 1] and never falls within a stage") {
  const Mesh mesh = amps::make_knot();
  for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
    SamplingOptions options = with_sizing(wild_field(mesh, 30, 6000, 3), 1, rule);
    std::string stage;
    double last = 0;
    int reports = 0;
    bool in_order = true;
    options.progress = amps::Progress([&](const char* name, double fraction) {
      if (stage != name) last = 0;
      stage = name;
      in_order = in_order && fraction >= last && fraction <= 1;
      last = fraction;
      return ++reports > 0;
    });
    amps::sample(mesh, options);
    CHECK(in_order);
    CHECK(reports > 20);
  }
}

TEST_CASE("adaptive: where gaps are filled a stretch at a time, sets are as dense as where they are not") {
  // Stretches follow the order of facets. The same square with facets in random order has no stretches in space.
  const Mesh ordered = amps::make_square(96);
  Mesh shuffled = ordered;
  Rng rng(6);
  for (Index f = static_cast<Index>(shuffled.triangles.rows()) - 1; f > 0; --f) {
    shuffled.triangles.row(f).swap(shuffled.triangles.row(static_cast<Index>(rng.below(static_cast<std::uint64_t>(f) + 1))));
  }
  double count[2] = {0, 0};
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SamplingOptions options;
    options.radius = 0.006;
    options.seed = seed;
    count[0] += amps::sample(ordered, options).samples.size() / 4.0;
    count[1] += amps::sample(shuffled, options).samples.size() / 4.0;
  }
  CHECK(count[0] > 19000);
  CHECK(count[0] == doctest::Approx(count[1]).epsilon(0.003));
}

TEST_CASE("adaptive: the same seed gives the same bits with every compiler and build type") {
  // Recorded once; the input has no value from libm. A change of the algorithm may change these numbers, a compiler may not.
  const auto hash = [](const SampleSet& set) { return amps_test::hash_bits(set.positions, set.radii); };
  const auto bits = [&](const Mesh& mesh, double ratio, ConflictRule rule) {
    SamplingOptions options = with_sizing(graded_field(mesh, ratio, 2000), 5, rule);
    options.target_count = 2100;
    return hash(amps::sample(mesh, options).samples);
  };
  CHECK(bits(amps::make_square(3), 16, ConflictRule::kMax) == 8721193091677189005u);
  CHECK(bits(amps::make_square(3), 1000, ConflictRule::kMax) == 17001335866364170788u);
  CHECK(bits(amps::make_cube(7), 16, ConflictRule::kMin) == 9320149911398030981u);
}

namespace {

/// Surfaces with everything that can be wrong with one.
const std::vector<std::string>& difficult_models() {
  static const std::vector<std::string> kNames = {"anchor.off",
                                                  "bones_26comps.off",
                                                  "bumpy.off",
                                                  "bunny_3k_closed.off",
                                                  "cheburashka.off",
                                                  "cow.off",
                                                  "cube-minimal-degenerated.obj",
                                                  "cube-shuffled.off",
                                                  "cube_twist.obj",
                                                  "degtri_four-2.off",
                                                  "degtri_sliding.off",
                                                  "double-torus-polygons.off",
                                                  "eight.off",
                                                  "elephant.off",
                                                  "fan3_nonmanifold_edge.obj",
                                                  "fandisk_coarse.obj",
                                                  "fandisk_quads.off",
                                                  "hemisphere.off",
                                                  "hinge_ascii.stl",
                                                  "hole_capsule_quads.off",
                                                  "hourglass_nonmanifold_vertex.obj",
                                                  "joined_tetrahedra.obj",
                                                  "knot2_2comps.off",
                                                  "lion-head.off",
                                                  "maxFace.obj",
                                                  "mech-holes-shark.off",
                                                  "moebius.obj",
                                                  "negative_indices.obj",
                                                  "netgen_part1_ascii.stl",
                                                  "platonic_shelf_polygons.obj",
                                                  "prim_isolated.off",
                                                  "quads_to_stitch.off",
                                                  "sphere_solid_header_binary.stl",
                                                  "suzanne.obj",
                                                  "teapot.obj",
                                                  "thingi_65004.stl",
                                                  "three_peaks.off",
                                                  "triple_vierbein.obj",
                                                  "two_spheres_overlap.obj"};
  return kNames;
}

}  // namespace

TEST_SUITE("slow") {
  TEST_CASE("adaptive: the certificate holds on every surface there is, whatever is wrong with it") {
    const Mesh stand_in = amps::make_ellipsoid(320, {1.0, 0.5, 0.01});
    for (const std::string& name : difficult_models()) {
      CAPTURE(name);
      const Mesh mesh = amps_test::data_mesh_or(name, stand_in);
      for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
        const SamplingOptions options = with_sizing(graded_field(mesh, 16, 1500), 2, rule);
        const SamplingResult result = amps::sample(mesh, options);
        check_certificate(mesh, result, options);
        CHECK(separation_of_all_pairs(result.samples, rule) >= 1 - 1e-9);
      }
    }
  }

  TEST_CASE("adaptive: the certificate holds on real models, 1:16 and 1:1000") {
    for (const auto& model : amps_test::real_models()) {
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
    std::vector<std::pair<std::string, Mesh>> models;
    for (const std::string& name : difficult_models()) {
      models.emplace_back(name, amps_test::data_mesh_or(name, amps::make_ellipsoid(320, {1.0, 0.5, 0.01})));
    }
    for (const auto& model : amps_test::real_models()) models.emplace_back(model.name, model.mesh);
    for (const auto& model : models) {
      const Mesh& mesh = model.second;
      CAPTURE(model.first);
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
    for (const auto& model : amps_test::real_models()) {
      CAPTURE(model.name);
      SamplingOptions options = with_sizing(graded_field(model.mesh, 16, 100));
      options.target_count = 20000;
      const SamplingResult result = amps::sample(model.mesh, options);
      CHECK(std::fabs(result.samples.size() - 20000) <= 200);
      check_certificate(model.mesh, result, options);
    }
  }
}
