#include "amps/wanted_radii.h"

#include "kit/random.h"
#include "kit/samples.h"

#include "amps/predicates.h"
#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace amps_test {

using amps::SurfacePoint;
using amps::detail::Sample;
using amps::detail::WantedRadii;

namespace {

SizingField field_along_x(const Mesh& mesh, double min, double max) {
  return amps::function_sizing(mesh, [=](const SurfacePoint& at) { return min + (max - min) * at.position.x(); });
}

Sample disk(const Vec3& x, double radius) {
  Sample result;
  result.at.position = x;
  result.radius = radius;
  return result;
}

}  // namespace

TEST_CASE("wanted_radii: one radius, a field that is the same everywhere, a field that is not; alone and beside others") {
  const Mesh square = amps::make_square(4);
  const SizingField same = amps::uniform_sizing(square, 0.1), varying = field_along_x(square, 0.1, 0.3);
  for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
    for (const WantedRadii& radii : {WantedRadii(0.1, rule), WantedRadii(same, rule)}) {
      CHECK(radii.constant());
      CHECK(radii.uniform());
      CHECK(radii.beside(0.1, 0.1).uniform());
      CHECK(!radii.beside(0.1, 0.2).uniform());
      CHECK(radii.beside(0.1, 0.2).constant());
      CHECK(radii.at({3, {0.2, 0.3, 0.5}, {}}) == 0.1);
      CHECK(radii.density_integral(2) == doctest::Approx(200));
      CHECK(radii.relative_density({3, {0.2, 0.3, 0.5}, {}}) == 1);
      CHECK(!radii.lowers());
      CHECK(!radii.beside(0.1, 0.2).lowers());
      CHECK(radii.beside(0.05, 0.2).lowers() == (rule == ConflictRule::kMax));
    }
    const WantedRadii radii(varying, rule);
    CHECK(!radii.constant());
    CHECK(!radii.uniform());
    CHECK(radii.rule() == rule);
    CHECK(radii.lowers() == (rule == ConflictRule::kMax));
    CHECK(radii.min() == varying.min_radius());
    CHECK(radii.max() == varying.max_radius());
    CHECK(radii.beside(0.2, 0.9).min_of_set() == varying.min_radius());
    CHECK(radii.beside(0.2, 0.9).max_of_set() == 0.9);
    Rng rng(1);
    for (int trial = 0; trial < 100; ++trial) {
      const auto facet = below(rng, rows(square.triangles));
      const SurfacePoint at = amps::detail::surface_point_at(square, facet, amps::uniform_barycentric(rng));
      CHECK(radii.at(at) == varying.radius(at));
      const double ratio = 0.1 / varying.radius(at);
      CHECK(radii.relative_density(at) == doctest::Approx(ratio * ratio));
    }
  }
}

TEST_CASE("wanted_radii: a lowered radius keeps the nearest sample out, exactly, and gives away no more than rounding") {
  Rng rng(7);
  const WantedRadii radii = WantedRadii(1e6, ConflictRule::kMax).beside(1e-9, 1e6);
  int bitten = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const double scale = std::pow(10.0, 8 * rng.uniform() - 4);
    const Vec3 p = Vec3(rng.uniform(), rng.uniform(), rng.uniform());
    const Vec3 x = p + scale * (Vec3(rng.uniform(), rng.uniform(), rng.uniform()) - Vec3::Constant(0.5));
    const double squared = (x - p).squaredNorm();
    const double r = radii.lowered(1e6, squared);
    REQUIRE(amps::side_of_ball(p.data(), x.data(), r * r) > 0);
    REQUIRE(r >= std::sqrt(squared) * (1 - 1e-14));
    REQUIRE(radii.lowered(r, squared) == r);
    const double root = std::sqrt(squared);
    bitten += amps::side_of_ball(p.data(), x.data(), root * root) < 0;
  }
  CHECK(bitten > 1000);  // without care many samples would lie inside
  CHECK(radii.lowered(1e6, std::numeric_limits<double>::infinity()) == 1e6);
  CHECK(WantedRadii(1e6, ConflictRule::kMin).beside(1e-9, 1e6).lowered(1e6, 1) == 1e6);
}

TEST_CASE("wanted_radii: two disks are apart at exactly the distance of the rule, and not one double nearer") {
  const Vec3 directions[] = {Vec3(13, 0, 0), Vec3(3, 4, 12), Vec3(-12, 3, 4), Vec3(4, -12, -3)};
  for (const Vec3& d : directions) {
    const Vec3 p(5, -7, 31);
    Vec3 inward = p + d;
    int axis;
    d.cwiseAbs().maxCoeff(&axis);
    inward[axis] = std::nextafter(inward[axis], p[axis]);
    for (const double other : {1.0, 13.0}) {
      for (const bool swapped : {false, true}) {
        const double rp = swapped ? other : 13, rq = swapped ? 13 : other;
        CHECK(amps::detail::are_apart(disk(p, rp), disk(p + d, rq), ConflictRule::kMax));
        CHECK(amps::detail::are_apart(disk(p, rp), disk(p + d, rq), ConflictRule::kMin));
        CHECK(!amps::detail::are_apart(disk(p, rp), disk(inward, rq), ConflictRule::kMax));
        CHECK(amps::detail::are_apart(disk(p, rp), disk(inward, rq), ConflictRule::kMin) == (other == 1));
      }
    }
  }
}

TEST_CASE("wanted_radii: the report's radius is the one wanted for all new samples, and 0 where there is none") {
  const Mesh mesh = amps::make_square(4);
  SamplingOptions options;
  options.radius = 0.06;
  const amps::SamplingResult uniform = amps::sample(mesh, options);
  CHECK(uniform.report.radius == 0.06);
  CHECK(amps::throw_darts(mesh, options).report.radius == 0.06);
  options.radius = 0.03;
  CHECK(amps::fill_gaps(mesh, uniform.samples, options).report.radius == 0.03);
  options.radius = 0;
  CHECK(amps::fill_gaps(mesh, uniform.samples, options).report.radius == 0.06);
  options.target_count = 300;
  const amps::SamplingResult counted = amps::sample(mesh, options);
  CHECK(counted.report.radius == min_of(counted.samples.radii));
  CHECK(counted.report.radius == max_of(counted.samples.radii));
  options.target_count = 0;

  options.sizing = amps::uniform_sizing(mesh, 0.04);
  CHECK(amps::sample(mesh, options).report.radius == 0.04);
  CHECK(amps::throw_darts(mesh, options).report.radius == 0.04);
  const amps::SamplingResult filled = amps::fill_gaps(mesh, uniform.samples, options);
  CHECK(filled.report.radius == 0.04);
  options.target_count = 300;
  const amps::SamplingResult scaled = amps::sample(mesh, options);
  CHECK(scaled.report.radius == 0.04 * scaled.report.sizing_scale);
  CHECK(scaled.report.radius == scaled.samples.radii[0]);

  options.sizing = field_along_x(mesh, 0.04, 0.08);
  CHECK(amps::sample(mesh, options).report.radius == 0);
  options.target_count = 0;
  CHECK(amps::sample(mesh, options).report.radius == 0);
  CHECK(amps::throw_darts(mesh, options).report.radius == 0);
  CHECK(amps::fill_gaps(mesh, uniform.samples, options).report.radius == 0);
}

TEST_CASE("wanted_radii: a mesh of a wanted size is the same with a field that is the same everywhere and without one") {
  const Mesh mesh = amps::make_torus();
  amps::RemeshOptions options;
  options.optimize = true;
  options.optimization.max_iterations = 0;  // the number to be sampled is at stake
  options.sampling.target_count = 2000;
  const double expected = amps::remesh(mesh, options).report.sampling.radius;
  options.sampling.sizing = amps::uniform_sizing(mesh, 0.3);
  CHECK(amps::remesh(mesh, options).report.sampling.radius == doctest::Approx(expected).epsilon(1e-9));
}

}  // namespace amps_test
