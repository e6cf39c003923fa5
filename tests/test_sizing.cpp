#include "amps/sizing.h"

#include "amps/shapes.h"
#include "test_data.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <set>
#include <string>
#include <utility>
#include <vector>

using amps::Index;
using amps::Mesh;
using amps::Points;
using amps::Rng;
using amps::SizingField;
using amps::SurfacePoint;
using amps::Vec3;

namespace {

constexpr double kPi = 3.14159265358979323846;

Vec3 vertex_of(const Mesh& mesh, Index facet, int k) { return mesh.vertices.row(mesh.triangles(facet, k)).transpose(); }

Eigen::VectorXd at_vertices(const Mesh& mesh, const std::function<double(const Vec3&)>& f) {
  Eigen::VectorXd values(mesh.vertices.rows());
  for (Eigen::Index v = 0; v < values.size(); ++v) values[v] = f(mesh.vertices.row(v).transpose());
  return values;
}

Mesh one_triangle(const Vec3& a, const Vec3& b, const Vec3& c) {
  Mesh mesh;
  mesh.vertices.resize(3, 3);
  mesh.vertices << a.transpose(), b.transpose(), c.transpose();
  mesh.triangles.resize(1, 3);
  mesh.triangles << 0, 1, 2;
  return mesh;
}

/// Every facet with three vertices of its own.
Mesh soup_of(const Mesh& mesh) {
  Mesh soup;
  soup.vertices.resize(3 * mesh.triangles.rows(), 3);
  soup.triangles.resize(mesh.triangles.rows(), 3);
  for (Index f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) {
      soup.vertices.row(3 * f + k) = mesh.vertices.row(mesh.triangles(f, k));
      soup.triangles(f, k) = 3 * f + k;
    }
  }
  return soup;
}

Eigen::Matrix3d some_rotation() {
  // Rational: (2, 3, 6)/7 is a unit vector.
  Eigen::Matrix3d r;
  r << 2, 3, 6, 3, -6, 2, 6, 2, -3;
  return r / 7;
}

double ratio_spread(const Eigen::VectorXd& values, const Eigen::VectorXd& truth) {
  return (values.array() / truth.array() - 1).abs().maxCoeff();
}

double mean_error(const Eigen::VectorXd& values, const Eigen::VectorXd& truth) {
  return (values.array() / truth.array() - 1).abs().mean();
}

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

/// All pairs of nodes of lattice edges, with positions.
struct LatticeEdge {
  Vec3 a, b;
  double ra, rb;
};
std::vector<LatticeEdge> lattice_edges(const Mesh& mesh, const SizingField& field) {
  std::vector<LatticeEdge> edges;
  for (std::size_t i = 0; i < field.num_pieces(); ++i) {
    const SizingField::Piece piece = field.piece(i);
    std::array<Vec3, 3> x;
    for (std::size_t c = 0; c < 3; ++c) {
      x[c] = Vec3::Zero();
      for (int k = 0; k < 3; ++k) x[c] += piece.corners[c][k] * vertex_of(mesh, piece.facet, k);
    }
    for (std::size_t c = 0; c < 3; ++c) edges.push_back({x[c], x[(c + 1) % 3], piece.radii[c], piece.radii[(c + 1) % 3]});
  }
  return edges;
}

double steepest(const Mesh& mesh, const SizingField& field) {
  double worst = 0;
  for (const LatticeEdge& e : lattice_edges(mesh, field)) {
    if ((e.a - e.b).norm() > 0) worst = std::max(worst, std::abs(e.ra - e.rb) / (e.a - e.b).norm());
  }
  return worst;
}

/// A field with lattices of several sizes.
double wavy(const SurfacePoint& at) { return 0.05 + 0.3 * at.position.squaredNorm() + 0.02 * at.position.x(); }

void require_same(const SizingField& a, const SizingField& b) {
  REQUIRE(a.num_pieces() == b.num_pieces());
  for (std::size_t i = 0; i < a.num_pieces(); ++i) REQUIRE(a.piece(i).radii == b.piece(i).radii);
}

std::string error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const amps::Error& error) {
    return error.what();
  }
  return "";
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
    const SizingField field = amps::vertex_sizing(mesh, Eigen::Map<const Eigen::Vector3d>(r.data()));
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
  require_same(a.clamped(1e-9, std::numeric_limits<double>::infinity()), a);
  const SizingField both = min(a, b);
  CHECK(both.fits(mesh));
  Rng rng(5);
  for (int trial = 0; trial < 2000; ++trial) {
    const auto f = static_cast<Index>(rng.below(static_cast<std::uint64_t>(mesh.triangles.rows())));
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
  Mesh cube = amps::make_cube(1);
  cube.vertices = cube.vertices * some_rotation().transpose();
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
  Eigen::VectorXd radii = at_vertices(small, [&](const Vec3&) { return 0.05 + rng.uniform(); });
  const SizingField limited = amps::vertex_sizing(small, radii).limited(gradation);
  for (Index f = 0; f < small.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) {
      double exact = std::numeric_limits<double>::infinity();
      for (Eigen::Index v = 0; v < radii.size(); ++v) {
        exact = std::min(exact, radii[v] + gradation * (small.vertices.row(v).transpose() - vertex_of(small, f, k)).norm());
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
  Mesh sheets = amps::make_square(10);
  const Eigen::Index n = sheets.vertices.rows(), m = sheets.triangles.rows();
  sheets.vertices.conservativeResize(2 * n, 3);
  sheets.triangles.conservativeResize(2 * m, 3);
  sheets.vertices.bottomRows(n) = sheets.vertices.topRows(n);
  sheets.vertices.bottomRows(n).col(2).array() += 0.01;
  sheets.triangles.bottomRows(m) = sheets.triangles.topRows(m).array() + static_cast<Index>(n);
  const SizingField apart =
      amps::vertex_sizing(sheets, at_vertices(sheets, [](const Vec3& x) { return x.z() > 0 ? 5.0 : 0.1; })).limited(0.1);
  CHECK(apart.max_radius() == 5.0);
}

TEST_CASE("sizing: limited fields are Lipschitz along lattice edges, below the original, idempotent and monotone") {
  std::vector<Mesh> meshes{amps::make_cube(2),
                           amps::make_torus(1, 0.4, 40, 20),
                           soup_of(amps::make_cube(1)),
                           amps_test::data_mesh_or("triceratops.off", amps::make_ellipsoid(1280, {1, 0.5, 0.2})),
                           amps_test::data_mesh_or("thingi_65004.stl", soup_of(amps::make_cube(3))),
                           amps_test::data_mesh_or("degtri_sliding.off", amps::make_square(2))};
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
    require_same(field.limited(std::numeric_limits<double>::infinity()), field);
  }
}

TEST_CASE("sizing: for_count reaches the count with the gradation it is given, also where that binds") {
  const Mesh mesh = amps_test::data_mesh_or("bunny_3k_closed.off", amps::make_ellipsoid(5120, {1, 0.6, 0.3}));
  const SizingField field = amps::lfs_sizing(mesh).with_ratio(16);
  double before = std::numeric_limits<double>::infinity();
  for (const double count : {100.0, 1000.0, 10000.0, 1e6}) {
    for (const double gradation : {0.1, amps::kDefaultGradation}) {
      const SizingField fitted = amps::for_count(field, count, gradation);
      CHECK(amps::kSamplesPerDensity * fitted.density_integral() == doctest::Approx(count).epsilon(5e-3));
      CHECK(steepest(mesh, fitted) <= gradation * (1 + 1e-6));
      CHECK(fitted.max_radius() <= 16 * fitted.min_radius() * (1 + 1e-12));
      require_same(fitted.limited(gradation), fitted);
      // The least radius is limited by nothing, so it tells the factor; limiting makes disks smaller, so that is above plain
      // scaling's.
      CHECK(fitted.min_radius() / field.min_radius() >= amps::count_factor(field, count) * (1 - 3e-3));
    }
    const double least = amps::for_count(field, count).min_radius();
    CHECK(least < before);
    before = least;
  }
  require_same(amps::for_count(field, 500, std::numeric_limits<double>::infinity()),
               field.scaled(amps::count_factor(field, 500)));
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
  const Eigen::VectorXd disk =
      at_vertices(oblate, [&](const Vec3& x) { return std::hypot(std::max(0.0, std::hypot(x.x(), x.y()) - half), x.z()); });
  const Eigen::VectorXd segment = at_vertices(
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
      Mesh plates = amps::make_square(n);
      const Eigen::Index v = plates.vertices.rows(), f = plates.triangles.rows();
      plates.vertices.conservativeResize(2 * v, 3);
      plates.triangles.conservativeResize(2 * f, 3);
      plates.vertices.bottomRows(v) = plates.vertices.topRows(v);
      plates.vertices.bottomRows(v).col(2).array() += gap;
      plates.triangles.bottomRows(f) = plates.triangles.topRows(f).array() + static_cast<Index>(v);
      Points inside(200, 3);
      Rng rng(8);
      for (Eigen::Index i = 0; i < 200; ++i) {
        inside.row(i) << 0.1 + 0.8 * rng.uniform(), 0.1 + 0.8 * rng.uniform(), i % 2 == 0 ? 0.0 : gap;
      }
      const Eigen::VectorXd lfs = amps::local_feature_size(plates, inside);
      CHECK(lfs.minCoeff() > 0.98 * gap / 2);
      CHECK(lfs.maxCoeff() < most * gap / 2);
    }
  }
}

TEST_CASE("lfs: flat surfaces have none, creases are bounded by the spacing of samples, cubes are resolved") {
  const Mesh square = amps::make_square(5);
  CHECK(amps::lfs_sizing(square).min_radius() == doctest::Approx(std::sqrt(2.0)).epsilon(1e-12));
  const Eigen::VectorXd coarse = amps::local_feature_size(amps::make_cube(1), amps::make_cube(1).vertices);
  CHECK(coarse.minCoeff() > 0.3);
  CHECK(coarse.maxCoeff() < 0.88);
  const Mesh fine = amps::make_cube(20);
  const Eigen::VectorXd lfs = amps::local_feature_size(fine, fine.vertices);
  CHECK(lfs.minCoeff() > 0.05);  // an edge of the mesh is 0.05 long
  CHECK(lfs.maxCoeff() < 0.51);
}

TEST_CASE(
    "lfs: 1-Lipschitz, invariant under motions, proportional to scale, independent of order, representation and orientation") {
  const Mesh mesh = amps_test::data_mesh_or("bunny_3k_closed.off", amps::make_ellipsoid(5120, {1.0, 0.7, 0.4}));
  const Eigen::VectorXd lfs = amps::local_feature_size(mesh, mesh.vertices);
  for (Index f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index a = mesh.triangles(f, k), b = mesh.triangles(f, (k + 1) % 3);
      const double distance = (mesh.vertices.row(a) - mesh.vertices.row(b)).norm();
      REQUIRE(std::abs(lfs[a] - lfs[b]) <= distance * (1 + 1e-9));
    }
  }
  Mesh moved = mesh;
  moved.vertices = (mesh.vertices * some_rotation().transpose()).rowwise() + Eigen::RowVector3d(3, -2, 5);
  CHECK(mean_error(amps::local_feature_size(moved, moved.vertices), lfs) < 0.002);
  Mesh scaled = mesh;
  scaled.vertices *= 1024;
  CHECK(amps::local_feature_size(scaled, scaled.vertices) == 1024 * lfs);
  scaled.vertices = mesh.vertices * 0x1p-500;
  CHECK(amps::local_feature_size(scaled, scaled.vertices) == lfs * 0x1p-500);

  Mesh reversed = mesh;
  reversed.vertices = mesh.vertices.colwise().reverse();
  reversed.triangles = static_cast<Index>(mesh.vertices.rows() - 1) - mesh.triangles.array();
  CHECK(mean_error(amps::local_feature_size(reversed, mesh.vertices), lfs) < 0.002);
  CHECK(mean_error(amps::local_feature_size(soup_of(mesh), mesh.vertices), lfs) < 0.002);
  Mesh flipped = mesh;
  for (Index f = 0; f < mesh.triangles.rows(); f += 3) std::swap(flipped.triangles(f, 0), flipped.triangles(f, 1));
  CHECK(mean_error(amps::local_feature_size(flipped, mesh.vertices), lfs) < 0.002);
}

TEST_CASE("lfs: noise below a twentieth of the spacing changes little") {
  const Mesh mesh = amps::make_sphere(5120);
  Mesh noisy = mesh;
  const double spacing = std::sqrt(4 * kPi / 5120 * 4 / std::sqrt(3.0));
  Rng rng(9);
  for (double* x = noisy.vertices.data(); x != noisy.vertices.data() + noisy.vertices.size(); ++x) {
    *x += 0.05 * spacing * (2 * rng.uniform() - 1);
  }
  CHECK(amps::local_feature_size(noisy, noisy.vertices).minCoeff() > 0.8);
}

TEST_CASE("lfs: the field tabulates the function, also inside of large facets") {
  for (const Mesh& mesh : {amps::make_cube(1), amps::make_sphere(1280)}) {
    const SizingField field = amps::lfs_sizing(mesh);
    Points points(500, 3);
    Eigen::VectorXd radii(500);
    Rng rng(10);
    for (Eigen::Index i = 0; i < 500; ++i) {
      const auto f = static_cast<Index>(rng.below(static_cast<std::uint64_t>(mesh.triangles.rows())));
      const Vec3 b = amps::uniform_barycentric(rng);
      points.row(i) = b.transpose() * (Eigen::Matrix3d() << vertex_of(mesh, f, 0).transpose(),
                                       vertex_of(mesh, f, 1).transpose(), vertex_of(mesh, f, 2).transpose())
                                          .finished();
      radii[i] = field.radius(f, b);
    }
    CHECK(ratio_spread(radii, amps::local_feature_size(mesh, points)) < 0.1);
  }
  amps::LfsOptions options;
  options.scale = 0.5;
  const Mesh sphere = amps::make_sphere(1280);
  CHECK(amps::lfs_sizing(sphere, options).max_radius() == 0.5 * amps::lfs_sizing(sphere).max_radius());
}

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
  const Eigen::VectorXd truth = at_vertices(spheroid, [&](const Vec3& x) {
    const double sine = std::hypot(x.y(), x.z()) / c, w = std::sqrt(sine * sine + c * c * x.x() * x.x());
    return std::max(c / (w * w * w), 1 / (c * w));
  });
  CHECK(ratio_spread(amps::max_curvature(spheroid), truth) < 0.05);
  CHECK(mean_error(amps::max_curvature(spheroid), truth) < 0.01);

  // Half a cylinder of radius 1, right up to its borders (but for its four corners, where all normals are one-sided).
  Mesh cylinder = amps::make_square(40);
  for (Eigen::Index v = 0; v < cylinder.vertices.rows(); ++v) {
    const double angle = kPi * cylinder.vertices(v, 0), z = 4 * cylinder.vertices(v, 1);
    cylinder.vertices.row(v) << std::cos(angle), std::sin(angle), z;
  }
  const Eigen::VectorXd around = amps::max_curvature(cylinder);
  for (Eigen::Index v = 0; v < around.size(); ++v) {
    const double y = cylinder.vertices(v, 1), z = cylinder.vertices(v, 2);
    const bool corner = y < 0.2 && std::min(z, 4 - z) < 0.25;
    REQUIRE(around[v] == doctest::Approx(1).epsilon(corner ? 0.7 : 0.01));
  }
}

TEST_CASE("curvature: creases, borders and bad facets do no harm") {
  CHECK(amps::max_curvature(amps::make_cube(4)).maxCoeff() == doctest::Approx(0).epsilon(1e-12));
  CHECK(amps::max_curvature(amps::make_square(4)).maxCoeff() == doctest::Approx(0).epsilon(1e-12));
  CHECK(amps::max_curvature(amps::make_cube(1), 120).minCoeff() > 0.5);  // no crease: as round as its vertices say
  const Mesh sphere = amps::make_sphere(1280);
  CHECK(mean_error(amps::max_curvature(soup_of(sphere)), Eigen::VectorXd::Ones(3 * 1280)) < 0.01);
  for (const char* name : {"triceratops.off", "degtri_four-2.off", "triple_vierbein.obj", "hinge_ascii.stl", "moebius.obj"}) {
    const Mesh mesh = amps_test::data_mesh_or(name, amps::make_torus());
    const double diagonal = amps::bounding_box(mesh).diagonal();
    const Eigen::VectorXd curvature = amps::max_curvature(mesh);
    CHECK(curvature.allFinite());
    CHECK(curvature.minCoeff() >= 0);
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

TEST_CASE("sizing: real meshes of all kinds have fields") {
  for (const char* name : {"bunny_36k_holes.obj", "fandisk_coarse.obj", "cow.off", "teapot.obj", "joined_tetrahedra.obj",
                           "netgen_part1_ascii.stl", "degtri_four-2.off", "cube-minimal-degenerated.obj"}) {
    const Mesh mesh = amps_test::data_mesh_or(name, amps::make_knot());
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
  const Eigen::VectorXd values = amps::parse_values("\xEF\xBB\xBF# radii\n1 2.5\t-3e-2 # more\r\n\r\n 4\r5");
  REQUIRE(values.size() == 5);
  CHECK(values == (Eigen::VectorXd(5) << 1, 2.5, -0.03, 4, 5).finished());
  CHECK(error_of([] { amps::parse_values("1 2\n3 x 4\n", "radii.txt"); }).find("radii.txt: line 2") == 0);
  CHECK(error_of([] { amps::parse_values("1\n1e999\n"); }).find("line 2") != std::string::npos);
  CHECK(error_of([] { amps::parse_values("# nothing\n"); }).find("no number") != std::string::npos);
  CHECK(error_of([] { amps::read_values("/no/such/file"); }).find("/no/such/file") != std::string::npos);
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
  Mesh mesh = amps::make_cube(6);
  mesh.vertices = (mesh.vertices * some_rotation().transpose()).eval();
  for (Eigen::Index v = 0; v < mesh.vertices.rows(); ++v)
    mesh.vertices(v, 2) *= 0.5 + mesh.vertices(v, 0) * mesh.vertices(v, 0);
  CHECK(hash_of(amps::lfs_sizing(mesh)) == 5199934755297015972u);
  CHECK(hash_of(amps::lfs_sizing(mesh).with_ratio(4).limited(0.2)) == 8056268423884251388u);
  CHECK(hash_of(amps::curvature_sizing(mesh, {0.01, 90})) == 8213485142439990167u);
}

TEST_CASE("sizing: errors name the trouble") {
  const Mesh mesh = amps::make_square(1);
  const auto values = [](double a) { return Eigen::Vector4d(1, 1, a, 1); };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(error_of([&] { amps::uniform_sizing(mesh, 0); }).find("not positive and finite") != std::string::npos);
  CHECK(error_of([&] { amps::vertex_sizing(mesh, values(-1)); }).find("vertex 2") != std::string::npos);
  CHECK(error_of([&] { amps::vertex_sizing(mesh, values(nan)); }).find("vertex 2") != std::string::npos);
  CHECK(error_of([&] { amps::vertex_sizing(mesh, Eigen::Vector3d(1, 1, 1)); }).find("3 values for 4") != std::string::npos);
  CHECK(error_of([&] { amps::vertex_density_sizing(mesh, values(0)); }).find("density") != std::string::npos);
  CHECK(error_of([&] { amps::vertex_density_sizing(mesh, Eigen::Vector3d(1, 1, 1)); }).find("3 values") != std::string::npos);
  CHECK(error_of([&] { amps::uniform_sizing(mesh, 1).scaled(0); }) != "");
  CHECK(error_of([&] { amps::uniform_sizing(mesh, 1e-300).scaled(1e-300); }) != "");
  CHECK(error_of([&] { amps::uniform_sizing(mesh, 1).clamped(2, 1); }) != "");
  CHECK(error_of([&] { amps::uniform_sizing(mesh, 1).limited(0); }) != "");
  CHECK(error_of([&] { amps::uniform_sizing(mesh, 1).with_ratio(0.5); }) != "");
  CHECK(error_of([&] { amps::count_factor(SizingField(), 10); }) != "");
  CHECK(error_of([&] { amps::count_factor(amps::uniform_sizing(mesh, 1), 0); }) != "");
  CHECK(error_of([&] { amps::for_count(amps::uniform_sizing(mesh, 1), 10, -1); }) != "");
  CHECK(error_of([&] { amps::for_count(SizingField(), 10); }) != "");
  CHECK(error_of([&] {
          min(amps::uniform_sizing(mesh, 1), amps::uniform_sizing(amps::make_square(2), 1));
        }).find("different") != std::string::npos);
  const std::string function =
      error_of([&] { amps::function_sizing(mesh, [](const SurfacePoint& at) { return at.position.x() > 0.4 ? -2.0 : 0.1; }); });
  CHECK(function.find("-2") != std::string::npos);
  CHECK(function.find("facet 0") != std::string::npos);
  CHECK(error_of([&] { amps::function_sizing(mesh, nullptr); }) != "");
  amps::TabulationOptions few;
  few.max_nodes = 100;
  CHECK(error_of([&] {
          amps::function_sizing(
              mesh, [](const SurfacePoint& at) { return 1e-3 + 0.01 * at.position.squaredNorm(); }, few);
        }).find("100 lattice nodes") != std::string::npos);
  CHECK(error_of([&] { amps::curvature_sizing(mesh, {}); }) != "");
  CHECK(error_of([&] { amps::max_curvature(mesh, -1); }) != "");
  amps::LfsOptions options;
  options.min_separation = 200;
  CHECK(error_of([&] { amps::lfs_sizing(mesh, options); }).find("min_separation") != std::string::npos);
  Points bad(2, 3);
  bad << 0, 0, 0, nan, 0, 0;
  CHECK(error_of([&] { amps::local_feature_size(mesh, bad); }).find("point 1") != std::string::npos);
  CHECK(error_of([&] { amps::lfs_sizing(Mesh()); }) != "");
}
