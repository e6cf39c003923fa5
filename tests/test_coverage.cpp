// Exact coverage from end to end: diagrams, certificates and gap filling agree with the exact sign, where doubles cannot tell.
#include "kit/basics.h"
#include "kit/maximality.h"
#include "kit/meshes.h"
#include "kit/samples.h"

#include "amps/maximality.h"
#include "amps/power_diagram.h"
#include "amps/sampling.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

namespace amps_test {
namespace {

/// Centres of the cells of an n × n grid over the square [0, n]².
std::vector<Vec3> grid_centres(int n) {
  std::vector<Vec3> result;
  for (int x = 0; x < n; ++x) {
    for (int y = 0; y < n; ++y) result.emplace_back(x + 0.5, y + 0.5, 0.0);
  }
  return result;
}

Mesh square_of_side(int n) {
  Mesh mesh = amps::make_square();
  mesh.vertices.map() *= n;
  return mesh;
}

}  // namespace

TEST_CASE("coverage: a set is maximal at a weight of exactly half a square, and not one step below") {
  // All corners of cells are at squared distance 1/2 from the four centres around: cocircular, and exact in doubles.
  const int n = 8;
  const Mesh mesh = square_of_side(n);
  const auto covered_at = [&](double weight) {
    const std::vector<Vec3> centres = grid_centres(n);
    const amps::RestrictedPowerDiagram diagram(mesh, centres, std::vector<double>(centres.size(), weight));
    bool all = true;
    Index on_sphere = 0;
    for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
      if (!diagram.alive(f)) continue;
      const auto polygon = diagram.polygon(f);
      bool any_outside = false;
      for (Index k = 0; k < polygon.size; ++k) {
        const int side = diagram.power_at_corner(polygon, k);
        any_outside = any_outside || side > 0;
        on_sphere += side == 0;
      }
      CHECK(diagram.covered(polygon) == !any_outside);
      all = all && !any_outside;
    }
    if (weight == 0.5) CHECK(on_sphere >= 4 * n * n);
    return all;
  };
  CHECK(covered_at(0.5));
  CHECK(covered_at(std::nextafter(0.5, 1.0)));
  CHECK(!covered_at(std::nextafter(0.5, 0.0)));
}

TEST_CASE("coverage: the certificate counts gaps of one rounding error, and filling closes them") {
  const int n = 6;
  const Mesh mesh = square_of_side(n);
  const double radius = std::sqrt(0.5);  // its square is above 1/2: the least double whose square is not below may be another
  const double small = radius * radius >= 0.5 ? std::nextafter(radius, 0.0) : radius;
  REQUIRE(small * small < 0.5);
  const Points centres = points_of(grid_centres(n));
  const SampleSet thin = bare_set(centres, constant_values(n * n, small));
  const amps::MaximalityReport report = amps::verify_maximal(mesh, thin);
  CHECK(report.gaps > 0);
  CHECK(!report.maximal());
  CHECK(report.maximal(1e-9));
  CHECK(report.worst_coverage == doctest::Approx(1).epsilon(1e-12));
  CHECK(report.gap_area > 0);
  CHECK(report.gap_area < 1e-9);

  const SamplingResult filled = amps::fill_gaps(mesh, thin, with_radius(small));
  CHECK(filled.report.unfilled_gaps == 0);
  CHECK(filled.samples.size() > thin.size());
  CHECK(amps::verify_maximal(mesh, filled.samples).maximal());
  CHECK(amps::verify_maximal(mesh, filled.samples).poisson_disk());

  const double large = std::nextafter(radius, 1.0);
  REQUIRE(large * large >= 0.5);
  const SampleSet enough = bare_set(centres, constant_values(n * n, large));
  CHECK(amps::verify_maximal(mesh, enough).gaps == 0);
  CHECK(amps::fill_gaps(mesh, enough, with_radius(large)).samples.size() == enough.size());
}

TEST_CASE("coverage: sets that amps makes are maximal without a tolerance") {
  for (const Mesh& mesh :
       {amps::make_square(5), amps::make_sphere(500), amps::make_torus(1, 0.4, 24, 10), amps::make_cube(2)}) {
    const double radius = 0.03 * amps::bounding_box(mesh).diagonal();
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      CHECK(amps::verify_maximal(mesh, amps::sample(mesh, with_radius(radius, seed)).samples).gaps == 0);
    }
    amps::RemeshOptions options;
    options.sampling = with_radius(radius);
    CHECK(amps::remesh(mesh, options).report.maximality.gaps == 0);
  }
}

}  // namespace amps_test
