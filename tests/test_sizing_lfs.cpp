// Local feature size against closed forms and laws.
#include "amps/sizing.h"

#include "kit/data.h"
#include "kit/meshes.h"
#include "kit/sizing.h"

#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace amps_test {

TEST_CASE("lfs: closed forms") {
  const Mesh sphere = amps::make_sphere(5120, 2);
  CHECK(ratio_spread(amps::local_feature_size(sphere, sphere.vertices), at_vertices(sphere, [](const Vec3&) { return 2.0; })) <
        0.01);

  // The medial axis of a torus: the core circle and, outside, the axis.
  const auto torus_lfs = [](double minor) {
    return [minor](const Vec3& x) { return std::min(minor, std::hypot(x.x(), x.y())); };
  };
  const Mesh thin = amps::make_torus(1, 0.3, 96, 40), fat = amps::make_torus(1, 0.7, 160, 110);
  CHECK(ratio_spread(amps::local_feature_size(thin, thin.vertices), at_vertices(thin, torus_lfs(0.3))) < 0.02);
  CHECK(ratio_spread(amps::local_feature_size(fat, fat.vertices), at_vertices(fat, torus_lfs(0.7))) < 0.02);

  // Of an oblate ellipsoid: a disk of radius 1 − c² in its plane; of a prolate one with axis 1: a segment of half-length 1 −
  // c².
  const double c = 0.5, half = 1 - c * c;
  const Mesh oblate = amps::make_ellipsoid(20480, {1, 1, c}), prolate = amps::make_ellipsoid(20480, {1, c, c});
  const Values disk =
      at_vertices(oblate, [&](const Vec3& x) { return std::hypot(std::max(0.0, std::hypot(x.x(), x.y()) - half), x.z()); });
  const Values segment = at_vertices(
      prolate, [&](const Vec3& x) { return std::hypot(std::max(0.0, std::abs(x.x()) - half), std::hypot(x.y(), x.z())); });
  CHECK(ratio_spread(amps::local_feature_size(oblate, oblate.vertices), disk) < 0.07);
  CHECK(mean_error(amps::local_feature_size(oblate, oblate.vertices), disk) < 0.025);
  CHECK(ratio_spread(amps::local_feature_size(prolate, prolate.vertices), segment) < 0.08);
  CHECK(mean_error(amps::local_feature_size(prolate, prolate.vertices), segment) < 0.015);
  amps::LfsOptions sharper;
  sharper.min_separation = 20;
  CHECK(ratio_spread(amps::local_feature_size(oblate, oblate.vertices, sharper), disk) < 0.03);

  // Two parallel plates: half the gap, however coarse their meshes. The last two gaps are near and below the spacing of samples
  // (0.012): larger values there, but of that order.
  for (const Index n : {1, 7, 20}) {
    for (const auto& [gap, most] : {std::pair{0.1, 1.06}, std::pair{0.02, 1.5}, std::pair{0.005, 4.0}}) {
      const Mesh plates = two_sheets(gap, n);
      Rng rng(8);
      const Points inside = made_points(200, [&, height = gap](Index i) {
        const double x = 0.1 + 0.8 * rng.uniform(), y = 0.1 + 0.8 * rng.uniform();
        return Vec3(x, y, i % 2 == 0 ? 0.0 : height);
      });
      const Values lfs = amps::local_feature_size(plates, inside);
      CHECK(min_of(lfs) > 0.98 * gap / 2);
      CHECK(max_of(lfs) < most * gap / 2);
    }
  }
}

TEST_CASE("lfs: flat surfaces have none, creases are bounded by the spacing of samples, cubes are resolved") {
  const Mesh square = amps::make_square(5);
  CHECK(amps::lfs_sizing(square).min_radius() == doctest::Approx(std::sqrt(2.0)).epsilon(1e-12));
  const Values coarse = amps::local_feature_size(amps::make_cube(1), amps::make_cube(1).vertices);
  CHECK(min_of(coarse) > 0.3);
  CHECK(max_of(coarse) < 0.88);
  const Mesh fine = amps::make_cube(20);
  const Values lfs = amps::local_feature_size(fine, fine.vertices);
  CHECK(min_of(lfs) > 0.05);  // an edge of the mesh is 0.05 long
  CHECK(max_of(lfs) < 0.51);
}

TEST_CASE(
    "lfs: 1-Lipschitz, invariant under motions, proportional to scale, independent of order, representation and orientation") {
  const Mesh mesh = data_mesh_or("bunny_3k_closed.off", amps::make_ellipsoid(5120, {1.0, 0.7, 0.4}));
  const Values lfs = amps::local_feature_size(mesh, mesh.vertices);
  for (Index f = 0; f < rows(mesh.triangles); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index a = mesh.triangles(f, k), b = mesh.triangles(f, (k + 1) % 3);
      const double distance = (point_at(mesh.vertices, a) - point_at(mesh.vertices, b)).norm();
      REQUIRE(std::abs(lfs[a] - lfs[b]) <= distance * (1 + 1e-9));
    }
  }
  const auto lfs_of = [](const Mesh& other) { return amps::local_feature_size(other, other.vertices); };
  CHECK(mean_error(lfs_of(moved(turned(mesh, some_rotation()), {3, -2, 5})), lfs) < 0.002);
  CHECK(same_values(lfs_of(scaled(mesh, 1024)), scaled(lfs, 1024)));
  CHECK(same_values(lfs_of(scaled(mesh, 0x1p-500)), scaled(lfs, 0x1p-500)));

  const Index last = rows(mesh.vertices) - 1;
  const Mesh reversed{made_points(last + 1, [&](Index v) { return point_at(mesh.vertices, last - v); }),
                      renumbered(mesh.triangles, [last](Index v) { return last - v; })};
  CHECK(mean_error(amps::local_feature_size(reversed, mesh.vertices), lfs) < 0.002);
  CHECK(mean_error(amps::local_feature_size(soup_of(mesh), mesh.vertices), lfs) < 0.002);
  const Mesh flipped = flipped_where(mesh, [](Index f) { return f % 3 == 0; });
  CHECK(mean_error(amps::local_feature_size(flipped, mesh.vertices), lfs) < 0.002);
}

TEST_CASE("lfs: noise below a twentieth of the spacing changes little") {
  const Mesh mesh = amps::make_sphere(5120);
  const double spacing = std::sqrt(4 * kPi / 5120 * 4 / std::sqrt(3.0));
  Rng rng(9);
  const Mesh noisy = shaken(mesh, 0.05 * spacing, rng);
  CHECK(min_of(amps::local_feature_size(noisy, noisy.vertices)) > 0.8);
}

TEST_CASE("lfs: the same bits on any number of threads") {
  // Large enough for a triangulation on several threads (8,000 points each): cells then have other numbers and first corners.
  Rng rng(16);
  const Mesh bumpy = shaken(amps::make_ellipsoid(81920, {1, 0.7, 0.4}), 0.001, rng);
  const Mesh ties = amps::make_torus(1, 0.4, 256, 128);  // with many equal circumradii
  for (const Mesh& mesh : {bumpy, ties, data_mesh_or("bunny_36k_holes.obj", inside_out(bumpy))}) {
    const SizingField one = amps::lfs_sizing(mesh);
    for (const unsigned threads : {2u, 3u, 8u}) {
      const SizingField several = amps::lfs_sizing(mesh, {}, threads);
      require_same(one, several);
      require_same(amps::for_count(one.with_ratio(), 2000), amps::for_count(several.with_ratio(), 2000, 0.1, threads));
    }
  }
}

TEST_CASE("lfs: the field tabulates the function, also inside of large facets") {
  for (const Mesh& mesh : {amps::make_cube(1), amps::make_sphere(1280)}) {
    const SizingField field = amps::lfs_sizing(mesh);
    Values radii = constant_values(500, 0);
    Rng rng(10);
    const Points points = made_points(500, [&](Index i) {
      const Index f = below(rng, rows(mesh.triangles));
      const Vec3 b = amps::uniform_barycentric(rng);
      radii[i] = field.radius(f, b);
      return Vec3(b[0] * vertex_of(mesh, f, 0) + b[1] * vertex_of(mesh, f, 1) + b[2] * vertex_of(mesh, f, 2));
    });
    CHECK(ratio_spread(radii, amps::local_feature_size(mesh, points)) < 0.1);
  }
  amps::LfsOptions options;
  options.scale = 0.5;
  const Mesh sphere = amps::make_sphere(1280);
  CHECK(amps::lfs_sizing(sphere, options).max_radius() == 0.5 * amps::lfs_sizing(sphere).max_radius());
}

}  // namespace amps_test
