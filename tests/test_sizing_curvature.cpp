// Curvature against closed forms, and the radii it asks for.
#include "amps/sizing.h"

#include "kit/data.h"
#include "kit/meshes.h"
#include "kit/sizing.h"

#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

namespace amps_test {

TEST_CASE("curvature: sphere, cylinder, torus, ellipsoid") {
  const Mesh sphere = amps::make_sphere(5120, 4);
  CHECK(ratio_spread(amps::max_curvature(sphere), at_vertices(sphere, [](const Vec3&) { return 0.25; })) < 0.01);
  const Mesh torus = amps::make_torus(1, 0.7, 120, 80);
  const auto torus_curvature = [](const Vec3& x) {
    const double rho = std::hypot(x.x(), x.y()), cosine = (rho - 1) / 0.7;
    return std::max(1 / 0.7, std::abs(cosine / rho));
  };
  CHECK(ratio_spread(amps::max_curvature(torus), at_vertices(torus, torus_curvature)) < 0.03);
  const double c = 0.5;
  const Mesh spheroid = amps::make_ellipsoid(20480, {1, c, c});
  const Values truth = at_vertices(spheroid, [&](const Vec3& x) {
    const double sine = std::hypot(x.y(), x.z()) / c, w = std::sqrt(sine * sine + c * c * x.x() * x.x());
    return std::max(c / (w * w * w), 1 / (c * w));
  });
  CHECK(ratio_spread(amps::max_curvature(spheroid), truth) < 0.05);
  CHECK(mean_error(amps::max_curvature(spheroid), truth) < 0.01);

  // Half a cylinder of radius 1, right up to its borders (but for its four corners, where all normals are one-sided).
  const Mesh cylinder = transformed(amps::make_square(40), [](const Vec3& x) -> Vec3 {
    return {std::cos(kPi * x.x()), std::sin(kPi * x.x()), 4 * x.y()};
  });
  const Values around = amps::max_curvature(cylinder);
  for (Index v = 0; v < rows(around); ++v) {
    const double y = cylinder.vertices(v, 1), z = cylinder.vertices(v, 2);
    const bool corner = y < 0.2 && std::min(z, 4 - z) < 0.25;
    REQUIRE(around[v] == doctest::Approx(1).epsilon(corner ? 0.7 : 0.01));
  }
}

TEST_CASE("curvature: creases, borders and bad facets do no harm") {
  CHECK(max_of(amps::max_curvature(amps::make_cube(4))) == doctest::Approx(0).epsilon(1e-12));
  CHECK(max_of(amps::max_curvature(amps::make_square(4))) == doctest::Approx(0).epsilon(1e-12));
  CHECK(min_of(amps::max_curvature(amps::make_cube(1), 120)) > 0.5);  // no crease: as round as its vertices say
  const Mesh sphere = amps::make_sphere(1280);
  CHECK(mean_error(amps::max_curvature(soup_of(sphere)), constant_values(3 * 1280, 1)) < 0.01);
  for (const char* name : {"triceratops.off", "degtri_four-2.off", "triple_vierbein.obj", "hinge_ascii.stl", "moebius.obj"}) {
    const Mesh mesh = data_mesh_or(name, amps::make_torus());
    const double diagonal = amps::bounding_box(mesh).diagonal();
    const Values curvature = amps::max_curvature(mesh);
    CHECK(std::all_of(curvature.data(), curvature.data() + curvature.size(), [](double x) { return std::isfinite(x); }));
    CHECK(min_of(curvature) >= 0);
    const SizingField field = amps::curvature_sizing(mesh, {1e-3 * diagonal});
    CHECK(field.min_radius() > 0);
    CHECK(field.max_radius() <= diagonal);
  }
}

TEST_CASE("curvature: radii keep chords within the error") {
  const Mesh sphere = amps::make_sphere(20480, 3);
  for (const double error : {1e-4, 1e-2, 0.5}) {
    const double r = amps::curvature_sizing(sphere, {error}).max_radius();
    CHECK(3 - std::sqrt(9 - r * r) == doctest::Approx(error).epsilon(0.01));
  }
  CHECK(amps::curvature_sizing(sphere, {5.0}).max_radius() == doctest::Approx(3).epsilon(0.01));
  CHECK(amps::curvature_sizing(amps::make_cube(2), {0.01, 50, 0.125}).min_radius() == 0.125);
}

}  // namespace amps_test
