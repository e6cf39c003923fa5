#include "amps/shapes.h"

#include "kit/errors.h"
#include "kit/meshes.h"

#include <doctest/doctest.h>

#include <cmath>

namespace amps_test {

namespace {

void check_closed(const Mesh& mesh, Index genus) {
  const amps::MeshReport report = amps::check(mesh);
  CHECK(report.usable());
  CHECK(report.topology.closed());
  CHECK(report.topology.manifold());
  CHECK(report.topology.components == 1);
  CHECK(report.topology.euler_characteristic == 2 - 2 * genus);
  CHECK(report.topology.inconsistent_edges == 0);
  CHECK(report.zero_area_facets == 0);
  CHECK(report.repeated_index_facets == 0);
  CHECK(report.duplicate_vertices == 0);
  CHECK(report.isolated_vertices == 0);
  CHECK(signed_volume(mesh) > 0);
}

bool segment_meets_facet(const Vec3& p, const Vec3& q, const MeshView& mesh, Index f) {
  const Vec3 a = mesh.corner(f, 0), b = mesh.corner(f, 1), c = mesh.corner(f, 2);
  const auto side = [](const Vec3& o, const Vec3& u, const Vec3& v, const Vec3& w) {
    return (u - o).cross(v - o).dot(w - o) > 0;
  };
  if (side(a, b, c, p) == side(a, b, c, q)) return false;
  const bool turn = side(p, q, a, b);
  return turn == side(p, q, b, c) && turn == side(p, q, c, a);
}

// Brute force over all edges and the facets that share no vertex with them.
int self_intersections(const Mesh& mesh) {
  const MeshView view(mesh);
  int count = 0;
  for (Index e = 0; e < view.num_facets(); ++e) {
    for (int k = 0; k < 3; ++k) {
      const Index i = mesh.triangles(e, k), j = mesh.triangles(e, (k + 1) % 3);
      if (i > j) continue;
      const Vec3 p = point_at(mesh.vertices, i), q = point_at(mesh.vertices, j);
      const double reach = (q - p).norm();
      for (Index f = 0; f < view.num_facets(); ++f) {
        bool apart = true;
        for (int c = 0; c < 3; ++c) apart = apart && mesh.triangles(f, c) != i && mesh.triangles(f, c) != j;
        if (!apart) continue;
        const double size = (view.corner(f, 1) - view.corner(f, 0)).norm() + (view.corner(f, 2) - view.corner(f, 0)).norm();
        if ((view.corner(f, 0) - p).norm() > reach + size) continue;
        count += segment_meets_facet(p, q, view, f) ? 1 : 0;
      }
    }
  }
  return count;
}

}  // namespace

TEST_CASE("shapes: the square is exactly [0,1]², looks up and has the promised counts") {
  for (const Index n : {1, 2, 7}) {
    const Mesh mesh = amps::make_square(n);
    CHECK(rows(mesh.vertices) == (n + 1) * (n + 1));
    CHECK(rows(mesh.triangles) == 2 * n * n);
    const amps::MeshReport report = amps::check(mesh);
    CHECK(report.box.min == Vec3(0, 0, 0));
    CHECK(report.box.max == Vec3(1, 1, 0));
    CHECK(report.area == doctest::Approx(1.0).epsilon(1e-14));
    CHECK(report.topology.boundary_loops == 1);
    CHECK(report.topology.boundary_edges == 4 * n);
    CHECK(report.topology.euler_characteristic == 1);
    CHECK(report.topology.inconsistent_edges == 0);
    CHECK(same_values(amps::facet_normals(mesh), made_points(2 * n * n, [](Index) -> Vec3 { return Vec3::UnitZ(); })));
  }
}

TEST_CASE("shapes: the cube is closed, outward, exactly [0,1]³") {
  for (const Index n : {1, 2, 3, 6}) {
    const Mesh mesh = amps::make_cube(n);
    CHECK(rows(mesh.vertices) == 6 * n * n + 2);
    CHECK(rows(mesh.triangles) == 12 * n * n);
    check_closed(mesh, 0);
    CHECK(signed_volume(mesh) == doctest::Approx(1.0).epsilon(1e-13));
    CHECK(amps::total_area(mesh) == doctest::Approx(6.0).epsilon(1e-13));
    CHECK(amps::bounding_box(mesh).min == Vec3(0, 0, 0));
    CHECK(amps::bounding_box(mesh).max == Vec3(1, 1, 1));
  }
}

TEST_CASE("shapes: the sphere has its vertices on the sphere, about the facets asked for, and converges to 4πr²") {
  for (const Index facets : {1, 20, 80, 100, 500, 20000}) {
    const Mesh mesh = amps::make_sphere(facets, 2.5);
    CAPTURE(facets);
    check_closed(mesh, 0);
    const double n = std::sqrt(static_cast<double>(rows(mesh.triangles)) / 20.0);
    CHECK(std::abs(n - std::round(n)) < 1e-12);
    if (facets >= 20) CHECK(std::abs(n - std::sqrt(facets / 20.0)) <= 0.5);
    CHECK(rows(mesh.vertices) == 2 + rows(mesh.triangles) / 2);
    for (Index v = 0; v < rows(mesh.vertices); ++v)
      REQUIRE(point_at(mesh.vertices, v).norm() == doctest::Approx(2.5).epsilon(1e-14));
  }
  CHECK(amps::total_area(amps::make_sphere(20000, 2.5)) == doctest::Approx(4 * kPi * 6.25).epsilon(1e-3));
  CHECK(self_intersections(amps::make_sphere(500, 1.0)) == 0);
}

TEST_CASE("shapes: the ellipsoid encloses 4π/3·abc") {
  const Mesh mesh = amps::make_ellipsoid(20000, Vec3(1.0, 2.0, 0.5));
  check_closed(mesh, 0);
  CHECK(signed_volume(mesh) == doctest::Approx(4.0 * kPi / 3.0).epsilon(2e-3));
}

TEST_CASE("shapes: the torus has genus 1, area 4π²Rr and volume 2π²Rr²") {
  const Mesh mesh = amps::make_torus(2.0, 0.5, 200, 100);
  CHECK(rows(mesh.vertices) == 20000);
  check_closed(mesh, 1);
  CHECK(amps::total_area(mesh) == doctest::Approx(4 * kPi * kPi).epsilon(2e-3));
  CHECK(signed_volume(mesh) == doctest::Approx(kPi * kPi).epsilon(2e-3));
  check_closed(amps::make_torus(1.0, 0.4, 3, 3), 1);
}

TEST_CASE("shapes: knots are closed tubes of genus 1 that do not touch themselves") {
  struct Case {
    int p, q;
    Index around;
  };
  for (const Case& c : {Case{2, 3, 12}, Case{3, 2, 12}, Case{2, 5, 8}, Case{1, 1, 12}, Case{5, 3, 6}}) {
    CAPTURE(c.p);
    CAPTURE(c.q);
    amps::KnotOptions options;
    options.p = c.p;
    options.q = c.q;
    options.around = c.around;
    const Mesh mesh = amps::make_knot(options);
    check_closed(mesh, 1);
    CHECK(self_intersections(mesh) == 0);
  }
}

TEST_CASE("shapes: the brute-force intersection test sees a torus that passes through itself") {
  Mesh mesh = amps::make_torus(1.0, 0.4, 16, 12);  // flattened, then sheared into itself
  for (Index v = 0; v < rows(mesh.vertices); ++v) mesh.vertices(v, 2) = std::sin(40.0 * static_cast<double>(v)) * 0.1;
  CHECK(self_intersections(mesh) > 0);
}

TEST_CASE("shapes: sizes that make no shape are refused") {
  CHECK_THROWS_AS(amps::make_square(0), Error);
  CHECK_THROWS_AS(amps::make_cube(-1), Error);
  CHECK_THROWS_AS(amps::make_sphere(0, 1.0), Error);
  CHECK_THROWS_AS(amps::make_sphere(100, kNaN), Error);
  CHECK_THROWS_AS(amps::make_ellipsoid(100, Vec3(1, 1, 0)), Error);
  CHECK_THROWS_AS(amps::make_torus(1.0, 1.0, 10, 10), Error);
  CHECK_THROWS_AS(amps::make_torus(1.0, 0.5, 2, 10), Error);
  CHECK(error_of([] { amps::make_square(100000); }) == ErrorCode::kTooLarge);
  CHECK(error_of([] { amps::make_torus(1.0, 0.5, 2000000000, 2000000000); }) == ErrorCode::kTooLarge);
  amps::KnotOptions options;
  options.q = 4;
  CHECK(error_of([&] { amps::make_knot(options); }) == ErrorCode::kInvalidArgument);
  options.q = 3;
  options.tube = 1.0;
  CHECK(error_of([&] { amps::make_knot(options); }) == ErrorCode::kInvalidArgument);
}

}  // namespace amps_test
