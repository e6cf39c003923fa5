// Sizing fields: made, tabulated, combined, scaled, refused. Gradation, local feature size and curvature have files of their
// own.
#include "amps/sizing.h"

#include "kit/data.h"
#include "kit/errors.h"
#include "kit/meshes.h"
#include "kit/sizing.h"

#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

namespace {

/// ∫ over the unit triangle (area ½) of 1/r², times 2: Gauss–Legendre of 5 points a panel in Duffy's coordinates.
double mean_by_quadrature(const std::array<double, 3>& r, int panels) {
  const double x[5] = {-0.9061798459386640, -0.5384693101056831, 0, 0.5384693101056831, 0.9061798459386640};
  const double w[5] = {0.2369268850561891, 0.4786286704993665, 0.5688888888888889, 0.4786286704993665, 0.2369268850561891};
  double sum = 0;
  for (int p = 0; p < panels; ++p) {
    for (int q = 0; q < panels; ++q) {
      for (int i = 0; i < 5; ++i) {
        for (int j = 0; j < 5; ++j) {
          const double s = (p + (x[i] + 1) / 2) / panels, t = (q + (x[j] + 1) / 2) / panels;
          const double value = r[0] * (1 - s) + s * (r[1] * (1 - t) + r[2] * t);
          sum += w[i] * w[j] / 4 / (panels * panels) * 2 * s / (value * value);
        }
      }
    }
  }
  return sum;
}

}  // namespace

TEST_CASE("sizing: an empty field, a uniform one, one from vertices") {
  CHECK(SizingField().empty());
  const Mesh mesh = amps::make_sphere(80);
  const SizingField uniform = amps::uniform_sizing(mesh, 0.25);
  CHECK(uniform.fits(mesh));
  CHECK_FALSE(uniform.fits(amps::make_sphere(80, 2)));
  CHECK(uniform.num_facets() == 80);
  CHECK(uniform.num_pieces() == 80);
  CHECK(uniform.min_radius() == 0.25);
  CHECK(uniform.max_radius() == 0.25);
  CHECK(uniform.density_integral() == doctest::Approx(16 * amps::total_area(mesh)).epsilon(1e-13));

  const auto linear = [](const Vec3& x) { return 2 + x.x() - 0.5 * x.z(); };
  const SizingField field = amps::vertex_sizing(mesh, at_vertices(mesh, linear));
  Rng rng(1);
  for (Index f = 0; f < 80; ++f) {
    const Vec3 b = amps::uniform_barycentric(rng);
    const Vec3 x = b[0] * vertex_of(mesh, f, 0) + b[1] * vertex_of(mesh, f, 1) + b[2] * vertex_of(mesh, f, 2);
    REQUIRE(field.radius(f, b) == doctest::Approx(linear(x)).epsilon(1e-14));
  }
  const SizingField dense = amps::vertex_density_sizing(mesh, at_vertices(mesh, [](const Vec3&) { return 16.0; }));
  CHECK(dense.min_radius() == 0.25);
  CHECK(dense.max_radius() == 0.25);
}

TEST_CASE("sizing: the density integral of a piece agrees with quadrature, for equal, nearly equal and very different radii") {
  Rng rng(2);
  const Mesh mesh = one_triangle({0, 0, 0}, {1, 0, 0}, {0, 2, 0});  // area 1
  for (int trial = 0; trial < 400; ++trial) {
    // Spreads from 1e-16 to 30, two of the three equal now and then.
    const double spread = std::pow(10.0, -16 + 17.5 * rng.uniform());
    std::array<double, 3> r{1, 1 + spread * rng.uniform(), 1 + spread * rng.uniform()};
    if (trial % 5 == 0) r[1] = r[2];
    if (trial % 7 == 0) r[1] = r[0];
    const double size = std::pow(10.0, 6 * rng.uniform() - 3);
    for (double& x : r) x *= size;
    std::rotate(r.begin(), r.begin() + trial % 3, r.end());
    if (trial % 2 == 0) std::swap(r[0], r[1]);
    const SizingField field = amps::vertex_sizing(mesh, values_of({r[0], r[1], r[2]}));
    REQUIRE(field.density_integral(0) == doctest::Approx(mean_by_quadrature(r, spread > 0.5 ? 250 : 24)).epsilon(1e-11));
  }
}

TEST_CASE("sizing: pieces tile their facets, in order, and carry the field") {
  const Mesh mesh = amps::make_square(2);
  const SizingField field = amps::function_sizing(
      mesh, [](const SurfacePoint& at) { return 0.01 + 0.2 * at.position.squaredNorm() * at.position.squaredNorm(); });
  REQUIRE(field.num_pieces() > 500);
  std::set<std::size_t> counts;
  std::size_t next = 0;
  Rng rng(3);
  double sum = 0;
  for (Index f = 0; f < field.num_facets(); ++f) {
    REQUIRE(field.first_piece(f) == next);
    double area = 0;
    std::set<std::array<double, 2>> centroids;
    const std::size_t end = f + 1 < field.num_facets() ? field.first_piece(f + 1) : field.num_pieces();
    counts.insert(end - next);
    for (; next < end; ++next) {
      const SizingField::Piece piece = field.piece(next);
      REQUIRE(piece.facet == f);
      Eigen::Matrix3d corners;
      for (int c = 0; c < 3; ++c) {
        const Vec3& b = piece.corners[static_cast<std::size_t>(c)];
        REQUIRE(b.sum() == 1.0);
        REQUIRE(b.minCoeff() >= 0);
        REQUIRE(field.radius(f, b) == piece.radii[static_cast<std::size_t>(c)]);
        corners.col(c) = b;
      }
      const double part = corners.determinant();
      REQUIRE(part > 0);
      area += part;
      const Vec3 middle = corners.rowwise().sum();
      REQUIRE(centroids.insert({middle[0], middle[1]}).second);
      const Vec3 inside = amps::uniform_barycentric(rng);
      const double linear = inside[0] * piece.radii[0] + inside[1] * piece.radii[1] + inside[2] * piece.radii[2];
      REQUIRE(field.radius(f, corners * inside) == doctest::Approx(linear).epsilon(1e-12));
      sum += field.density_integral(next);
    }
    CHECK(area == doctest::Approx(1).epsilon(1e-14));
  }
  CHECK(next == field.num_pieces());
  CHECK(counts.size() > 1);
  CHECK(sum == doctest::Approx(field.density_integral()).epsilon(1e-13));
}

TEST_CASE("sizing: the radius is continuous over edges, and within its bounds") {
  for (const Mesh& mesh : {amps::make_square(1), amps::make_cube(1)}) {
    const SizingField field = amps::function_sizing(mesh, [](const SurfacePoint& at) { return wavy(at) * 0.2; });
    Rng rng(4);
    int shared = 0;
    for (Index f = 0; f < field.num_facets(); ++f) {
      for (Index g = 0; g < f; ++g) {
        std::vector<std::array<int, 2>> common;
        for (int i = 0; i < 3; ++i) {
          for (int j = 0; j < 3; ++j) {
            if (mesh.triangles(f, i) == mesh.triangles(g, j)) common.push_back({i, j});
          }
        }
        const auto pieces = [&](Index h) {
          return (h + 1 < field.num_facets() ? field.first_piece(h + 1) : field.num_pieces()) - field.first_piece(h);
        };
        if (common.size() != 2 || pieces(f) != pieces(g)) continue;
        ++shared;
        for (int trial = 0; trial < 50; ++trial) {
          const double t = trial < 9 ? trial / 8.0 : rng.uniform();
          Vec3 a = Vec3::Zero(), b = Vec3::Zero();
          a[common[0][0]] = b[common[0][1]] = t;
          a[common[1][0]] = b[common[1][1]] = 1 - t;
          REQUIRE(field.radius(f, a) == doctest::Approx(field.radius(g, b)).epsilon(1e-13));
          REQUIRE(field.radius(f, a) >= field.min_radius());
          REQUIRE(field.radius(f, a) <= field.max_radius());
        }
      }
    }
    CHECK(shared > 0);
  }
}

TEST_CASE("sizing: scaling, clamping, minimum") {
  const Mesh mesh = amps::make_cube(2);
  const SizingField a = amps::function_sizing(mesh, [](const SurfacePoint& at) { return wavy(at) * 0.3; });
  const SizingField b = amps::function_sizing(
      mesh, [](const SurfacePoint& at) { return 0.02 + 0.1 * (at.position - Vec3(1, 1, 0)).squaredNorm(); });
  const SizingField twice = a.scaled(2);
  CHECK(twice.min_radius() == 2 * a.min_radius());
  CHECK(twice.density_integral() == doctest::Approx(a.density_integral() / 4).epsilon(1e-12));
  const SizingField clamped = a.clamped(0.05, 0.1);
  CHECK(clamped.min_radius() == 0.05);
  CHECK(clamped.max_radius() == 0.1);
  require_same(a.clamped(1e-9, kInfinity), a);
  const SizingField both = min(a, b);
  CHECK(both.fits(mesh));
  Rng rng(5);
  for (int trial = 0; trial < 2000; ++trial) {
    const auto f = below(rng, rows(mesh.triangles));
    const Vec3 at = amps::uniform_barycentric(rng);
    REQUIRE(both.radius(f, at) <= std::min(a.radius(f, at), b.radius(f, at)) * (1 + 1e-12));
    REQUIRE(both.radius(f, at) >= 0.9 * std::min(a.radius(f, at), b.radius(f, at)));
  }
  require_same(min(b, a), both);
  require_same(min(both, both), both);
  require_same(min(a, amps::uniform_sizing(mesh, 100)), a);
}

TEST_CASE("sizing: a function is tabulated to its tolerance, with memory that the samples justify") {
  const Mesh mesh = amps::make_square(1);
  const auto bump = [](const SurfacePoint& at) {
    return 0.01 + 0.2 * (at.position - Vec3(0.3, 0.4, 0)).squaredNorm() * at.position.x() + 0.01 * at.position.y();
  };
  for (const double tolerance : {0.05, 0.01, 0.001}) {
    amps::TabulationOptions options;
    options.tolerance = tolerance;
    options.finest = 1e-3;
    const SizingField field = amps::function_sizing(mesh, bump, options);
    Rng rng(6);
    for (int trial = 0; trial < 2000; ++trial) {
      SurfacePoint at{static_cast<Index>(trial % 2), amps::uniform_barycentric(rng), Vec3::Zero()};
      for (int k = 0; k < 3; ++k) at.position += at.barycentric[k] * vertex_of(mesh, at.facet, k);
      REQUIRE(std::abs(field.radius(at) - bump(at)) <= 1.5 * tolerance * bump(at));
    }
  }
  // A jump is never resolved: lattices stop at what samples justify.
  const SizingField jump =
      amps::function_sizing(mesh, [](const SurfacePoint& at) { return at.position.x() < 0.3333 ? 0.01 : 0.2; });
  CHECK(static_cast<double>(jump.num_pieces()) < 16 * amps::kSamplesPerDensity * jump.density_integral() + 64 * 2);
  CHECK(jump.num_pieces() > 500);
  // So it is with needles.
  const Mesh needle = one_triangle({0, 0, 0}, {1000, 0, 0}, {0, 0.001, 0});
  CHECK(amps::function_sizing(needle, [](const SurfacePoint& at) { return 0.01 + 1e-5 * at.position.x(); }).num_pieces() <=
        4096);
  // Vertices and edges are met from several facets, but always as the same points, to the last bit.
  std::set<std::array<double, 3>> exact;
  std::set<std::array<long, 3>> rounded;
  const Mesh cube = turned(amps::make_cube(1), some_rotation());
  amps::function_sizing(cube, [&](const SurfacePoint& at) {
    exact.insert({at.position.x(), at.position.y(), at.position.z()});
    rounded.insert(
        {std::lround(1e9 * at.position.x()), std::lround(1e9 * at.position.y()), std::lround(1e9 * at.position.z())});
    Vec3 again = Vec3::Zero();
    for (int k = 0; k < 3; ++k) again += at.barycentric[k] * vertex_of(cube, at.facet, k);
    CHECK((again - at.position).norm() < 1e-15);
    return 0.3;
  });
  CHECK(exact.size() > 100);
  CHECK(exact.size() == rounded.size());
}

TEST_CASE("sizing: the ratio clamp starts at a quantile by area; count_factor gives the wanted integral") {
  // Radii 1 on 0.5 % of the square, 100 on the rest but one strip with 3.
  const Mesh mesh = amps::make_square(100);
  const SizingField field = amps::vertex_sizing(mesh, at_vertices(mesh, [](const Vec3& x) {
                                                  return x.x() < 0.004 && x.y() < 0.3 ? 1.0 : x.y() < 0.1 ? 3.0 : 100.0;
                                                }));
  const SizingField clamped = field.with_ratio(16);
  CHECK(clamped.min_radius() == doctest::Approx(3).epsilon(0.3));
  CHECK(clamped.max_radius() == 16 * clamped.min_radius());
  CHECK(field.with_ratio(16, 0.08).min_radius() == doctest::Approx(3).epsilon(0.3));
  CHECK(field.with_ratio(16, 0.2).min_radius() == 100);
  CHECK(field.with_ratio(16, 0).min_radius() == 1);
  CHECK(field.with_ratio(1).max_radius() == field.with_ratio(1).min_radius());

  const double factor = amps::count_factor(field, 5000);
  CHECK(amps::kSamplesPerDensity * field.scaled(factor).density_integral() == doctest::Approx(5000).epsilon(1e-10));
}

TEST_CASE("sizing: the quantile of radii is where areas in ascending order pass its part of the whole") {
  // All facets have the area 2^-13, so that sums of areas are exact.
  const Index n = 64;
  const Mesh mesh = amps::make_square(n);
  Rng rng(5);
  std::vector<double> radii;
  for (std::ptrdiff_t v = 0; v < mesh.vertices.rows(); ++v) radii.push_back(1 + rng.uniform());
  const SizingField field = amps::vertex_sizing(mesh, radii);
  std::vector<double> means;
  for (std::size_t i = 0; i < field.num_pieces(); ++i) {
    const auto r = field.piece(i).radii;
    means.push_back((r[0] + r[1] + r[2]) / 3);
  }
  std::sort(means.begin(), means.end());
  for (const double quantile : {1e-9, 0.01, 0.0301, 0.25, 0.6, 0.951, 1 - 1e-9}) {
    CAPTURE(quantile);
    const auto place = static_cast<std::size_t>(quantile * static_cast<double>(means.size()));
    CHECK(field.with_ratio(1, quantile).min_radius() == means[place]);
  }
}

TEST_CASE("sizing: real meshes of all kinds have fields") {
  for (const char* name : {"bunny_36k_holes.obj", "fandisk_coarse.obj", "cow.off", "teapot.obj", "joined_tetrahedra.obj",
                           "netgen_part1_ascii.stl", "degtri_four-2.off", "cube-minimal-degenerated.obj"}) {
    const Mesh mesh = data_mesh_or(name, amps::make_knot());
    const double diagonal = amps::bounding_box(mesh).diagonal();
    const SizingField field = amps::lfs_sizing(mesh);
    CHECK(field.min_radius() > 0);
    CHECK(field.max_radius() <= diagonal * (1 + 1e-12));
    const SizingField graded = field.with_ratio().limited(amps::kDefaultGradation);
    CHECK(steepest(mesh, graded) <= amps::kDefaultGradation * (1 + 1e-6));
    CHECK(graded.max_radius() <= 16 * graded.min_radius() * (1 + 1e-12));
  }
}

TEST_CASE("sizing: values for vertices are read from text") {
  const Values values = amps::parse_values("\xEF\xBB\xBF# radii\n1 2.5\t-3e-2 # more\r\n\r\n 4\r5");
  REQUIRE(values.size() == 5);
  CHECK(same_values(values, values_of({1, 2.5, -0.03, 4, 5})));
  CHECK(error_text([] { amps::parse_values("1 2\n3 x 4\n", "radii.txt"); }).find("radii.txt: line 2") == 0);
  CHECK(error_text([] { amps::parse_values("1\n1e999\n"); }).find("line 2") != std::string::npos);
  CHECK(error_text([] { amps::parse_values("# nothing\n"); }).find("no number") != std::string::npos);
  CHECK(error_text([] { amps::read_values("/no/such/file"); }).find("/no/such/file") != std::string::npos);
}

TEST_CASE("sizing: the same bits everywhere") {
  // Numbers made once; a compiler or platform that gives others breaks the promise of determinism.
  const auto hash_of = [](const SizingField& field) {
    std::uint64_t hash = 0;
    for (std::size_t i = 0; i < field.num_pieces(); ++i) {
      const double value = field.density_integral(i);
      std::uint64_t bits = 0;
      std::memcpy(&bits, &value, sizeof bits);
      hash = amps::detail::scramble(hash + bits);
    }
    return hash;
  };
  // No std::sin in these: coordinates are the same everywhere too.
  const Mesh mesh = transformed(turned(amps::make_cube(6), some_rotation()), [](const Vec3& x) -> Vec3 {
    return {x.x(), x.y(), x.z() * (0.5 + x.x() * x.x())};
  });
  CHECK(hash_of(amps::lfs_sizing(mesh)) == 8586069591908033654u);
  CHECK(hash_of(amps::lfs_sizing(mesh).with_ratio(4).limited(0.2)) == 14812366866990539734u);
  CHECK(hash_of(amps::curvature_sizing(mesh, {0.01, 90})) == 11647722858192669726u);
}

TEST_CASE("sizing: errors name the trouble") {
  const Mesh mesh = amps::make_square(1);
  const auto values = [](double a) { return values_of({1, 1, a, 1}); };
  CHECK(error_text([&] { amps::uniform_sizing(mesh, 0); }).find("not positive and finite") != std::string::npos);
  CHECK(error_text([&] { amps::vertex_sizing(mesh, values(-1)); }).find("vertex 2") != std::string::npos);
  CHECK(error_text([&] { amps::vertex_sizing(mesh, values(kNaN)); }).find("vertex 2") != std::string::npos);
  CHECK(error_text([&] { amps::vertex_sizing(mesh, constant_values(3, 1)); }).find("3 values for 4") != std::string::npos);
  CHECK(error_text([&] { amps::vertex_density_sizing(mesh, values(0)); }).find("density") != std::string::npos);
  CHECK(error_text([&] { amps::vertex_density_sizing(mesh, constant_values(3, 1)); }).find("3 values") != std::string::npos);
  CHECK(error_text([&] { amps::uniform_sizing(mesh, 1).scaled(0); }) != "");
  CHECK(error_text([&] { amps::uniform_sizing(mesh, 1e-300).scaled(1e-300); }) != "");
  CHECK(error_text([&] { amps::uniform_sizing(mesh, 1).clamped(2, 1); }) != "");
  CHECK(error_text([&] { amps::uniform_sizing(mesh, 1).limited(0); }) != "");
  CHECK(error_text([&] { amps::uniform_sizing(mesh, 1).with_ratio(0.5); }) != "");
  CHECK(error_text([&] { amps::count_factor(SizingField(), 10); }) != "");
  CHECK(error_text([&] { amps::count_factor(amps::uniform_sizing(mesh, 1), 0); }) != "");
  CHECK(error_text([&] { amps::for_count(amps::uniform_sizing(mesh, 1), 10, -1); }) != "");
  CHECK(error_text([&] { amps::for_count(SizingField(), 10); }) != "");
  CHECK(error_text([&] {
          min(amps::uniform_sizing(mesh, 1), amps::uniform_sizing(amps::make_square(2), 1));
        }).find("different") != std::string::npos);
  const std::string function = error_text(
      [&] { amps::function_sizing(mesh, [](const SurfacePoint& at) { return at.position.x() > 0.4 ? -2.0 : 0.1; }); });
  CHECK(function.find("-2") != std::string::npos);
  CHECK(function.find("facet 0") != std::string::npos);
  CHECK(error_text([&] { amps::function_sizing(mesh, nullptr); }) != "");
  amps::TabulationOptions few;
  few.max_nodes = 100;
  CHECK(error_text([&] {
          amps::function_sizing(
              mesh, [](const SurfacePoint& at) { return 1e-3 + 0.01 * at.position.squaredNorm(); }, few);
        }).find("100 lattice nodes") != std::string::npos);
  CHECK(error_text([&] { amps::curvature_sizing(mesh, {}); }) != "");
  CHECK(error_text([&] { amps::max_curvature(mesh, -1); }) != "");
  amps::LfsOptions options;
  options.min_separation = 200;
  CHECK(error_text([&] { amps::lfs_sizing(mesh, options); }).find("min_separation") != std::string::npos);
  const Points bad = points_of({{0, 0, 0}, {kNaN, 0, 0}});
  CHECK(error_text([&] { amps::local_feature_size(mesh, bad); }).find("point 1") != std::string::npos);
  CHECK(error_text([&] { amps::lfs_sizing(Mesh()); }) != "");
}

}  // namespace amps_test
