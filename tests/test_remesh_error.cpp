// test_remesh_error.cpp: RemeshOptions::max_error.
#include "kit/distance.h"
#include "kit/meshes.h"

#include "amps/amps.h"
#include <doctest/doctest.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <string>

namespace {

using amps::Index;
using amps::Mesh;
using amps::MeshView;
using amps::Vec3;

amps::RemeshResult within(const MeshView& mesh, double error) {
  amps::RemeshOptions options;
  options.max_error = error;
  return amps::remesh(mesh, options);
}

double diagonal(const MeshView& mesh) { return amps::bounding_box(mesh).diagonal(); }

/// The greatest distance of some points of `from` to `to`, by looking at all of its facets.
double farthest_of_points(const MeshView& from, const MeshView& to) {
  constexpr int kSteps = 2;
  double farthest = 0;
  for (Index f = 0; f < from.num_facets(); ++f) {
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; i + j <= kSteps; ++j) {
        const double u = double(i) / kSteps, v = double(j) / kSteps;
        const Vec3 x = (1 - u - v) * from.corner(f, 0) + u * from.corner(f, 1) + v * from.corner(f, 2);
        farthest = std::max(farthest, static_cast<double>(amps_test::brute_distance(to, x)));
      }
    }
  }
  return farthest;
}

}  // namespace

TEST_CASE("remesh error: the bound holds by an independent measure, and smaller ones take more vertices" *
          doctest::test_suite("slow")) {
  const Mesh mesh = amps::make_torus(1, 0.4, 48, 24);
  Index before = 0;
  for (const double percent : {2.0, 0.8}) {
    const double error = percent / 100 * diagonal(mesh);
    const amps::RemeshResult result = within(mesh, error);
    CHECK(result.status == amps::Outcome::kDone);
    CHECK(result.report.hausdorff_bound <= error);
    CHECK(result.report.hausdorff_lower <= result.report.hausdorff_bound);
    const double there = farthest_of_points(mesh, result.mesh), back = farthest_of_points(result.mesh, mesh);
    CHECK(std::max(there, back) <= result.report.hausdorff_bound * (1 + 1e-12));
    CHECK(result.samples.size() > before);
    before = result.samples.size();
  }
}

TEST_CASE("remesh error: flat faces are exact, with few vertices") {
  const Mesh mesh = amps::make_cube();
  const amps::RemeshResult result = within(mesh, 0.01);
  CHECK(result.report.hausdorff_bound <= 1e-5);
  CHECK(result.report.output.euler_characteristic == 2);
  CHECK(result.samples.size() < 500);
}

TEST_CASE("remesh error: a radius and a count are upper bounds of radii") {
  const Mesh mesh = amps::make_torus(1, 0.4, 48, 24);
  const double error = 0.004 * diagonal(mesh);
  amps::RemeshOptions options;
  options.max_error = error;
  options.sampling.radius = 0.6;
  const amps::RemeshResult by_radius = amps::remesh(mesh, options);
  CHECK(by_radius.report.hausdorff_bound <= error);
  CHECK(by_radius.report.further_runs > 0);
  options.sampling.radius = 0;
  options.sampling.target_count = 2000;
  const amps::RemeshResult by_count = amps::remesh(mesh, options);
  CHECK(by_count.report.hausdorff_bound <= error);
  CHECK(by_count.status == amps::Outcome::kDone);
  CHECK(std::abs(by_count.samples.size() - 2000) <= 40);
}

TEST_CASE("remesh error: what cannot be held ends, and the status says so") {
  const Mesh mesh = amps::make_torus(1, 0.4, 48, 24);
  amps::RemeshOptions options;
  options.max_error = 1e-4;
  options.sampling.radius = 0.3;
  options.sampling.max_samples = 3000;
  const amps::RemeshResult result = amps::remesh(mesh, options);
  CHECK(result.status == amps::Outcome::kErrorMissed);
  CHECK(result.report.hausdorff_bound > options.max_error);
  CHECK(std::string(amps::name_of(result.status)) == "error missed");
}

TEST_CASE("remesh error: what is good is kept, so that small errors are reached") {
  const Mesh mesh = amps::make_torus(1, 0.4, 24, 12);  // facets larger than the disks: the distance is at their edges
  const double error = 0.002 * diagonal(mesh);
  const amps::RemeshResult result = within(mesh, error);
  CHECK(result.status == amps::Outcome::kDone);
  CHECK(result.report.hausdorff_bound <= error);
  CHECK(result.report.further_runs > 1);
  CHECK(result.report.certificate.holds());
  CHECK(result.report.maximality.maximal());
}

TEST_CASE("remesh error: a count is spent where it lowers the distance") {
  const Mesh mesh = amps::make_ellipsoid(5120, Vec3(4, 1, 1));
  amps::RemeshOptions options;
  options.sampling.target_count = 1500;
  const amps::RemeshResult uniform = amps::remesh(mesh, options);
  const double before = amps::surface_distance(mesh, uniform.mesh).hausdorff_lower();
  options.least_error = true;
  const amps::RemeshResult less = amps::remesh(mesh, options);
  CHECK(less.status == amps::Outcome::kDone);
  CHECK(std::abs(less.samples.size() - 1500) <= 30);
  CHECK(less.report.hausdorff_bound < 0.8 * before);
  CHECK(less.report.hausdorff_bound >= amps::surface_distance(mesh, less.mesh).hausdorff_lower());
  options.sampling.target_count = 0;
  options.sampling.radius = 0.1;
  CHECK_THROWS_AS(amps::remesh(mesh, options), amps::Error);
}

TEST_CASE("remesh error: options out of range are refused") {
  const Mesh mesh = amps::make_cube();
  for (const double bad : {-1.0, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
    CHECK_THROWS_AS(within(mesh, bad), amps::Error);
  }
}
