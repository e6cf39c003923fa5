#include "amps/buffers.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"
#include "amps/sampling.h"
#include "amps/shapes.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

using amps::Error;
using amps::Index;
using amps::Mesh;
using amps::MeshView;
using amps::Points;
using amps::PointsView;
using amps::Triangles;
using amps::TrianglesView;
using amps::ValuesView;
using amps::Vec3;

namespace {

/// A mesh whose coordinates are floats, so that views of float and of double see the same points.
Mesh float_sphere() {
  Mesh mesh = amps::make_sphere(320);
  for (std::ptrdiff_t v = 0; v < mesh.vertices.rows(); ++v) {
    for (int k = 0; k < 3; ++k) {
      const volatile float rounded = static_cast<float>(mesh.vertices(v, k));  // GCC 12 loses the rounding of two side by side
      mesh.vertices(v, k) = static_cast<double>(rounded);
    }
  }
  return mesh;
}

bool same(const MeshView& view, const Mesh& mesh) {
  if (view.vertices.rows() != mesh.vertices.rows() || view.triangles.rows() != mesh.triangles.rows()) return false;
  for (std::ptrdiff_t v = 0; v < mesh.vertices.rows(); ++v) {
    if (view.vertices[v] != Vec3(mesh.vertices.row(v).transpose())) return false;
    for (int k = 0; k < 3; ++k) {
      if (view.vertices(v, k) != mesh.vertices(v, k)) return false;
    }
  }
  for (std::ptrdiff_t f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) {
      if (view.triangles(f, k) != mesh.triangles(f, k) ||
          view.triangles[f][static_cast<std::size_t>(k)] != mesh.triangles(f, k))
        return false;
    }
  }
  return true;
}

template <class Scalar, int Options>
using Dynamic = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Options>;

/// A view of Eigen matrices of these types sees `mesh`, and what lies in the caller's memory: nothing is copied.
template <class Vertex, class Corner, int Options>
void check_eigen(const Mesh& mesh) {
  Dynamic<Vertex, Options> v = mesh.vertices.map().template cast<Vertex>();
  Dynamic<Corner, Options> f = mesh.triangles.map().template cast<Corner>();
  const MeshView view(v, f);
  CHECK(same(view, mesh));
  v(5, 2) = 7;
  f(3, 1) = 9;
  CHECK(view.vertices(5, 2) == 7);
  CHECK(view.triangles(3, 1) == 9);
}

struct Interleaved {
  float normal[3];
  float position[3];
  std::uint8_t colour[4];
};

}  // namespace

TEST_CASE("buffers: views of Eigen matrices of any storage order and number type see the same mesh, without a copy") {
  const Mesh mesh = float_sphere();
  check_eigen<double, std::int32_t, Eigen::RowMajor>(mesh);
  check_eigen<double, std::int32_t, Eigen::ColMajor>(mesh);
  check_eigen<double, std::int64_t, Eigen::ColMajor>(mesh);
  check_eigen<float, std::int16_t, Eigen::RowMajor>(mesh);
  check_eigen<float, std::uint16_t, Eigen::ColMajor>(mesh);
  check_eigen<float, std::uint32_t, Eigen::ColMajor>(mesh);
  check_eigen<double, std::uint64_t, Eigen::RowMajor>(mesh);
}

TEST_CASE("buffers: maps, blocks, transposes and references are viewed where they lie") {
  const Mesh mesh = float_sphere();
  const Eigen::MatrixXd v = mesh.vertices.map();
  const Eigen::MatrixXi f = mesh.triangles.map();
  const Eigen::Matrix3Xd v_columns = v.transpose();
  const Eigen::Matrix<Index, 3, Eigen::Dynamic> f_columns = f.transpose();
  CHECK(same(MeshView(v_columns.transpose(), f_columns.transpose()), mesh));
  const Eigen::Ref<const Eigen::MatrixXd> reference(v);
  CHECK(same(MeshView(reference, f), mesh));
  Eigen::MatrixXd wide(v.rows(), 7);
  wide << v, v, v.col(0);
  CHECK(same(MeshView(wide.middleCols(3, 3), f.leftCols(3)), mesh));
  const MeshView half(wide.leftCols(3).topRows(10), f.topRows(2));
  CHECK(half.num_vertices() == 10);
  CHECK(half.num_facets() == 2);
  const Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>> map(mesh.vertices.data(),
                                                                                        mesh.vertices.rows(), 3);
  CHECK(same(MeshView(map, f), mesh));
}

TEST_CASE("buffers: an interleaved float vertex buffer with 16-bit indices, and columns apart") {
  const Mesh mesh = float_sphere();
  const auto n = static_cast<std::size_t>(mesh.vertices.rows()), m = static_cast<std::size_t>(mesh.triangles.rows());
  std::vector<Interleaved> buffer(n);
  std::vector<double> x(n), y(n), z(n);
  for (std::size_t i = 0; i < n; ++i) {
    for (int k = 0; k < 3; ++k) buffer[i].position[k] = static_cast<float>(mesh.vertices(static_cast<std::ptrdiff_t>(i), k));
    x[i] = mesh.vertices(static_cast<std::ptrdiff_t>(i), 0);
    y[i] = mesh.vertices(static_cast<std::ptrdiff_t>(i), 1);
    z[i] = mesh.vertices(static_cast<std::ptrdiff_t>(i), 2);
  }
  std::vector<std::uint16_t> corners;
  std::vector<std::int64_t> a(m), b(m), c(m);
  for (std::size_t f = 0; f < m; ++f) {
    const auto row = static_cast<std::ptrdiff_t>(f);
    for (int k = 0; k < 3; ++k) corners.push_back(static_cast<std::uint16_t>(mesh.triangles(row, k)));
    a[f] = mesh.triangles(row, 0);
    b[f] = mesh.triangles(row, 1);
    c[f] = mesh.triangles(row, 2);
  }
  const PointsView interleaved(buffer.front().position, static_cast<std::ptrdiff_t>(n), sizeof(Interleaved));
  CHECK(same(MeshView(interleaved, TrianglesView(corners.data(), static_cast<std::ptrdiff_t>(m))), mesh));
  const PointsView apart = PointsView::columns(x.data(), y.data(), z.data(), static_cast<std::ptrdiff_t>(n));
  CHECK(same(MeshView(apart, TrianglesView::columns(a.data(), b.data(), c.data(), static_cast<std::ptrdiff_t>(m))), mesh));

  // The whole pipeline gives the same bits from any of them.
  amps::SamplingOptions options;
  options.radius = 0.1;
  const auto sampled = [&](const MeshView& view) { return amps::sample(view, options).samples; };
  const amps::SampleSet expected = sampled(mesh);
  for (const MeshView& view :
       {MeshView(interleaved, TrianglesView(corners.data(), static_cast<std::ptrdiff_t>(m))),
        MeshView(apart, TrianglesView::columns(a.data(), b.data(), c.data(), static_cast<std::ptrdiff_t>(m)))}) {
    const amps::SampleSet found = sampled(view);
    CHECK(found.positions == expected.positions);
    CHECK(found.facets == expected.facets);
    CHECK(found.barycentrics == expected.barycentrics);
  }
}

TEST_CASE("buffers: lists of numbers from vectors, Eigen vectors of float and double, rows and strided memory") {
  const std::vector<double> values = {3, 1, 4, 1, 5};
  const auto equal = [&](const ValuesView& view) {
    bool result = view.size() == 5;
    for (std::ptrdiff_t i = 0; result && i < 5; ++i) result = view[i] == values[static_cast<std::size_t>(i)];
    return result;
  };
  CHECK(equal(values));
  CHECK(equal(std::vector<float>(values.begin(), values.end())));
  const Eigen::VectorXd column = Eigen::Map<const Eigen::VectorXd>(values.data(), 5);
  const Eigen::RowVectorXf row = column.transpose().cast<float>();
  CHECK(equal(column));
  CHECK(equal(row));
  Eigen::MatrixXd table = Eigen::MatrixXd::Zero(5, 3);
  table.col(1) = column;
  CHECK(equal(table.col(1)));
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = table.transpose();
  CHECK(equal(rows.row(1)));
  CHECK(equal(table.middleCols(1, 1)));
  CHECK(equal(ValuesView(table.data() + 5, 5)));
  CHECK_THROWS_AS(ValuesView(table.leftCols(2)), Error);
}

TEST_CASE("buffers: matrices of another number of columns are refused, with their size in the message") {
  const Eigen::MatrixXd v = Eigen::MatrixXd::Zero(3, 8);
  const Eigen::MatrixXi f = Eigen::MatrixXi::Zero(4, 4);
  CHECK_THROWS_WITH_AS(
      PointsView{v},
      "positions: a matrix of 3 by 8; it needs 3 columns, one row each (of a matrix with 3 rows, give m.transpose())", Error);
  CHECK_THROWS_WITH_AS(TrianglesView{f}, "triangles: a matrix of 4 by 4; it needs 3 columns, one row each", Error);
  CHECK_THROWS_AS(Points{v}, Error);
  CHECK_THROWS_AS(Points(std::vector<double>(7)), Error);
  CHECK_THROWS_AS(Points(2, 4), Error);
}

TEST_CASE("buffers: an index that no Index holds is no vertex, not another one") {
  Mesh mesh = amps::make_square();
  Eigen::Matrix<std::int64_t, Eigen::Dynamic, 3> wide = mesh.triangles.map().cast<std::int64_t>();
  wide(1, 2) = (std::int64_t{1} << 32) + 1;
  CHECK(TrianglesView(wide)(1, 2) == amps::kNone);
  CHECK_THROWS_WITH_AS(
      amps::require_usable({mesh.vertices, wide}),
      "mesh: facet 1 has a corner that is not one of the 4 vertices (0-based); remove it or correct its indices", Error);
  wide(1, 2) = -(std::int64_t{1} << 32);
  CHECK(amps::check({mesh.vertices, wide}).out_of_range_facets == 1);
  CHECK_THROWS_AS(Triangles{wide}, Error);
  Eigen::Matrix<std::uint32_t, Eigen::Dynamic, 3> unsigned_wide = mesh.triangles.map().cast<std::uint32_t>();
  unsigned_wide(0, 0) = 0xffffffffu;
  CHECK(TrianglesView(unsigned_wide)(0, 0) == amps::kNone);
  std::vector<std::array<std::uint64_t, 3>> huge = {{0, 1, ~std::uint64_t{0}}};
  CHECK(TrianglesView(huge)(0, 2) == amps::kNone);
}

TEST_CASE("buffers: a view of a temporary keeps it") {
  const MeshView view = amps::make_sphere(1280);
  const MeshView copy = view;
  CHECK(amps::topology(copy).closed());
  const PointsView points = std::vector<Vec3>{{1, 2, 3}, {4, 5, 6}};
  CHECK(points[1] == Vec3(4, 5, 6));
  const ValuesView values = std::vector<double>(100, 2.5);
  CHECK(values[99] == 2.5);
  const PointsView floats = std::vector<Eigen::Vector3f>{{1, 2, 3}, {4, 5, 6}};
  CHECK(floats[1] == Vec3(4, 5, 6));
  const TrianglesView corners = std::vector<Eigen::Vector3i>{{1, 2, 3}, {4, 5, 6}};
  CHECK(corners(1, 0) == 4);
  const TrianglesView triangles = std::vector<std::array<std::uint16_t, 3>>{{1, 2, 65535}};
  CHECK(triangles(0, 2) == 65535);
  const amps::RestrictedPowerDiagram diagram(amps::make_square(), std::vector<Vec3>{{0, 0, 0}, {1, 1, 0}},
                                             std::vector<double>{0, 0});
  CHECK(diagram.check() == "");
}

TEST_CASE("buffers: tables are values that Eigen sees and fills") {
  Points points(2);
  CHECK(points == Points(2, 3));
  points.row(0) << 1, 2, 3;
  points.map().row(1) = points.row(0) * 2;
  CHECK(points(1, 2) == 6);
  Points copy = points;
  copy.map().array() += 1;
  CHECK(points(0, 0) == 1);
  CHECK(copy != points);
  copy.resize(1);
  CHECK(copy.rows() == 1);
  CHECK(copy(0, 2) == 4);
  const Eigen::MatrixXf from = points.map().cast<float>();
  CHECK(Points(from) == points);
  CHECK(Points(points.map() * 1.0) == points);
  const Mesh mesh{from, Eigen::MatrixXi::Zero(1, 3)};
  CHECK(mesh.vertices == points);
  CHECK(mesh.triangles.rows() == 1);
  CHECK(points.row(1).transpose().norm() == doctest::Approx(std::sqrt(56.0)));
}

TEST_CASE("buffers: a table takes no index that does not fit, of any type") {
  Eigen::Matrix<std::uint32_t, Eigen::Dynamic, 3> narrow(1, 3);
  narrow << 0, 1, 4000000000u;
  CHECK_THROWS_AS(Triangles{narrow}, amps::Error);
  Eigen::Matrix<std::uint64_t, Eigen::Dynamic, 3> wide(1, 3);
  wide << 0, 1, ~std::uint64_t{0};
  CHECK_THROWS_AS(Triangles{wide}, amps::Error);
  wide(0, 2) = 2;
  CHECK(Triangles(wide)(0, 2) == 2);
}

TEST_CASE("buffers: a view of a negative number of rows is no mesh") {
  const double x[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const std::int32_t corners[3] = {0, 1, 2};
  CHECK_THROWS_AS(amps::require_usable(MeshView(amps::PointsView(x, -3), TrianglesView(corners, 1))), amps::Error);
  CHECK_THROWS_AS(amps::require_usable(MeshView(amps::PointsView(x, 3), TrianglesView(corners, -1))), amps::Error);
}
