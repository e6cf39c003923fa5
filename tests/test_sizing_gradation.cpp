// Fields whose radii may only change so fast: SizingField::limited() and for_count().
#include "amps/sizing.h"

#include "kit/data.h"
#include "kit/meshes.h"
#include "kit/sizing.h"

#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace amps_test {

TEST_CASE("sizing: gradation limiting gives the shortest-path cone on a planar grid") {
  // One small radius in the corner; elsewhere large. The largest field is r0 + L·|x − x0|.
  const Mesh mesh = amps::make_square(60);
  const double gradation = 0.4;
  const SizingField field =
      amps::vertex_sizing(mesh, at_vertices(mesh, [](const Vec3& x) { return x.norm() == 0 ? 0.01 : 10.0; }))
          .limited(gradation);
  for (const LatticeEdge& e : lattice_edges(mesh, field)) {
    const double exact = 0.01 + gradation * e.a.norm();
    REQUIRE(e.ra >= exact * (1 - 1e-12));  // never below the truth: updates are lengths of paths
    REQUIRE(e.ra <= exact + gradation * 0.02);
  }
  // Arbitrary radii against all pairs.
  Rng rng(7);
  const Mesh small = amps::make_square(24);
  const Values radii = at_vertices(small, [&](const Vec3&) { return 0.05 + rng.uniform(); });
  const SizingField limited = amps::vertex_sizing(small, radii).limited(gradation);
  for (Index f = 0; f < rows(small.triangles); ++f) {
    for (int k = 0; k < 3; ++k) {
      double exact = kInfinity;
      for (Index v = 0; v < rows(radii); ++v) {
        exact = std::min(exact, radii[v] + gradation * (point_at(small.vertices, v) - vertex_of(small, f, k)).norm());
      }
      const double r = limited.radius(f, Vec3::Unit(k));
      // Triangles interpolate along their edges, paths bend at them: off by part of an edge either way.
      REQUIRE(std::abs(r - exact) <= gradation * 0.75 / 24);
    }
  }
}

TEST_CASE("sizing: gradation limiting measures along the surface") {
  const Mesh mesh = amps::make_sphere(20480);
  const SizingField field =
      amps::vertex_sizing(mesh, at_vertices(mesh, [&](const Vec3& x) { return x == vertex_of(mesh, 0, 0) ? 0.01 : 10.0; }))
          .limited(1);
  const Vec3 pole = vertex_of(mesh, 0, 0);
  for (const LatticeEdge& e : lattice_edges(mesh, field)) {
    const double geodesic = std::atan2(pole.cross(e.a).norm(), pole.dot(e.a));
    REQUIRE(std::abs(e.ra - 0.01 - geodesic) <= 0.02 + 0.01 * geodesic);
  }
  // Two sheets 0.01 apart do not see each other.
  const Mesh sheets = two_sheets(0.01, 10);
  const SizingField apart =
      amps::vertex_sizing(sheets, at_vertices(sheets, [](const Vec3& x) { return x.z() > 0 ? 5.0 : 0.1; })).limited(0.1);
  CHECK(apart.max_radius() == 5.0);
}

TEST_CASE("sizing: limited fields are Lipschitz along lattice edges, below the original, idempotent and monotone") {
  std::vector<Mesh> meshes{amps::make_cube(2),
                           amps::make_torus(1, 0.4, 40, 20),
                           soup_of(amps::make_cube(1)),
                           data_mesh_or("triceratops.off", amps::make_ellipsoid(1280, {1, 0.5, 0.2})),
                           data_mesh_or("thingi_65004.stl", soup_of(amps::make_cube(3))),
                           data_mesh_or("degtri_sliding.off", amps::make_square(2))};
  for (const Mesh& mesh : meshes) {
    const double diagonal = amps::bounding_box(mesh).diagonal();
    const Vec3 corner = amps::bounding_box(mesh).min;
    const SizingField field = amps::function_sizing(mesh, [&](const SurfacePoint& at) {
      return diagonal * (0.02 + 2 * ((at.position - corner) / diagonal).squaredNorm());
    });
    for (const double gradation : {0.1, 0.5}) {
      const SizingField limited = field.limited(gradation);
      CHECK(steepest(mesh, limited) <= gradation * (1 + 1e-6));
      for (std::size_t i = 0; i < field.num_pieces(); ++i) {
        for (std::size_t c = 0; c < 3; ++c) REQUIRE(limited.piece(i).radii[c] <= field.piece(i).radii[c]);
      }
      require_same(limited.limited(gradation), limited);
      CHECK(limited.min_radius() == field.min_radius());
      const SizingField other = min(field, amps::uniform_sizing(mesh, 0.5 * field.max_radius())).limited(gradation);
      for (std::size_t i = 0; i < field.num_pieces(); ++i) {
        for (std::size_t c = 0; c < 3; ++c) REQUIRE(other.piece(i).radii[c] <= limited.piece(i).radii[c] * (1 + 1e-3));
      }
    }
    require_same(field.limited(kInfinity), field);
  }
}

TEST_CASE("sizing: for_count reaches the count with the gradation it is given, also where that binds") {
  const Mesh mesh = data_mesh_or("bunny_3k_closed.off", amps::make_ellipsoid(5120, {1, 0.6, 0.3}));
  const SizingField field = amps::lfs_sizing(mesh).with_ratio(16);
  double before = kInfinity;
  for (const double count : {100.0, 1000.0, 10000.0, 1e6}) {
    for (const double gradation : {0.1, amps::kDefaultGradation}) {
      const SizingField fitted = amps::for_count(field, count, gradation);
      CHECK(amps::kSamplesPerDensity * fitted.density_integral() == doctest::Approx(count).epsilon(5e-3));
      CHECK(steepest(mesh, fitted) <= gradation * (1 + 1e-6));
      CHECK(fitted.max_radius() <= 16 * fitted.min_radius() * (1 + 1e-12));
      require_same(fitted.limited(gradation), fitted);
      // It goes on from one factor to the next, and comes to what limits the last one from the beginning.
      const SizingField afresh = field.scaled(fitted.min_radius() / field.min_radius()).limited(gradation);
      double worst = 0;
      for (std::size_t i = 0; i < fitted.num_pieces(); ++i) {
        const auto a = fitted.piece(i).radii, b = afresh.piece(i).radii;
        for (std::size_t c = 0; c < 3; ++c) worst = std::max(worst, std::abs(a[c] / b[c] - 1));
      }
      CHECK(worst < 2e-3);
      // The least radius is limited by nothing, so it tells the factor; limiting makes disks smaller, so that is above plain
      // scaling's.
      CHECK(fitted.min_radius() / field.min_radius() >= amps::count_factor(field, count) * (1 - 3e-3));
    }
    const double least = amps::for_count(field, count).min_radius();
    CHECK(least < before);
    before = least;
  }
  require_same(amps::for_count(field, 500, kInfinity), field.scaled(amps::count_factor(field, 500)));
}

TEST_CASE("sizing: gradation limiting treats a soup as the mesh it stands for") {
  const Mesh mesh = amps::make_cube(3), soup = soup_of(mesh);
  const auto radius = [](const SurfacePoint& at) { return 0.02 + at.position.squaredNorm(); };
  const SizingField a = amps::function_sizing(mesh, radius).limited(0.2), b = amps::function_sizing(soup, radius).limited(0.2);
  REQUIRE(a.num_pieces() == b.num_pieces());
  for (std::size_t i = 0; i < a.num_pieces(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) REQUIRE(a.piece(i).radii[c] == doctest::Approx(b.piece(i).radii[c]).epsilon(1e-3));
  }
}

}  // namespace amps_test
