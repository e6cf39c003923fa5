// Distances between surfaces against CGAL: nearest points by its AABB tree, Hausdorff distances by its bounded-error algorithm
// (both directions lie within its error and ours), means by a plain midpoint sum over many small triangles with its tree.
#include "amps/surface_distance.h"
#include "amps/surface_tree.h"

#include "kit/data.h"
#include "kit/random.h"
#include "kit/samples.h"

#include "amps/remesh.h"
#include "amps/shapes.h"

#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/distance.h>
#include <CGAL/Surface_mesh.h>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace amps_test {

namespace {

namespace PMP = CGAL::Polygon_mesh_processing;
using DistanceKernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = DistanceKernel::Point_3;
using OracleMesh = CGAL::Surface_mesh<Point>;
using OracleTree = CGAL::AABB_tree<CGAL::AABB_traits<DistanceKernel, CGAL::AABB_face_graph_triangle_primitive<OracleMesh>>>;

OracleMesh oracle_mesh(const Mesh& mesh) {
  OracleMesh result;
  std::vector<OracleMesh::Vertex_index> vertices;
  for (Index v = 0; v < rows(mesh.vertices); ++v) {
    vertices.push_back(result.add_vertex(Point(mesh.vertices(v, 0), mesh.vertices(v, 1), mesh.vertices(v, 2))));
  }
  const auto corner = [&](Index f, int k) { return vertices[at(mesh.triangles(f, k))]; };
  for (Index f = 0; f < rows(mesh.triangles); ++f)
    REQUIRE(result.add_face(corner(f, 0), corner(f, 1), corner(f, 2)).is_valid());
  return result;
}

struct Means {
  double mean, rms;
};

/// Each facet as n² small triangles, n such that they are a few thousandths of the diagonal; distances of their centroids.
Means midpoint_means(const Mesh& from, const OracleTree& to, double size) {
  double area = 0, mean = 0, square = 0;
  for (Index f = 0; f < rows(from.triangles); ++f) {
    const MeshView mesh(from);
    const Vec3 a = mesh.corner(f, 0), ab = mesh.corner(f, 1) - a, ac = mesh.corner(f, 2) - a;
    const int n = 1 + static_cast<int>(std::max({ab.norm(), ac.norm(), (ac - ab).norm()}) / size);
    const double cell = 0.5 * ab.cross(ac).norm() / (n * n);
    const auto add = [&](double i, double j) {
      const Vec3 x = a + i / n * ab + j / n * ac;
      const double d2 = to.squared_distance(Point(x[0], x[1], x[2]));
      area += cell;
      mean += cell * std::sqrt(d2);
      square += cell * d2;
    };
    for (int i = 0; i < n; ++i) {
      for (int j = 0; i + j < n; ++j) {
        add(i + 1 / 3.0, j + 1 / 3.0);
        if (i + j + 1 < n) add(i + 2 / 3.0, j + 2 / 3.0);
      }
    }
  }
  return {mean / area, std::sqrt(square / area)};
}

void compare(const Mesh& a, const Mesh& b) {
  const OracleMesh first = oracle_mesh(a), second = oracle_mesh(b);
  const amps::DistanceReport d = amps::surface_distance(a, b);
  const double error = 1e-4 * d.diagonal;
  const auto check = [&](const amps::OneSidedDistance& side, const OracleMesh& from, const OracleMesh& to, const Mesh& mesh) {
    const double hausdorff = PMP::bounded_error_Hausdorff_distance<CGAL::Sequential_tag>(from, to, error);
    CHECK(side.hausdorff_lower <= hausdorff + error);
    CHECK(side.hausdorff >= hausdorff - error);
    const OracleTree tree(faces(to).begin(), faces(to).end(), to);
    const Means means = midpoint_means(mesh, tree, 0.004 * d.diagonal);
    CHECK(std::abs(side.mean - means.mean) <= side.mean_error + 0.003 * means.mean);
    CHECK(std::abs(side.rms - means.rms) <= side.rms_error + 0.003 * means.rms);
    CHECK(side.rms_error < 0.1 * means.rms);  // an error that says something
  };
  check(d.forward, first, second, a);
  check(d.backward, second, first, b);
  const double both = PMP::bounded_error_symmetric_Hausdorff_distance<CGAL::Sequential_tag>(first, second, error);
  CHECK(d.hausdorff_lower() <= both + error);
  CHECK(d.hausdorff() >= both - error);
}

Mesh remeshed(const Mesh& mesh, Index count) {
  amps::RemeshOptions options;
  options.sampling = with_count(count);
  return amps::remesh(mesh, options).mesh;
}

}  // namespace

TEST_CASE("surface_distance: Hausdorff, mean and rms agree with CGAL on remeshed surfaces") {
  for (const auto& model : {std::pair("bunny_3k_closed.off", amps::make_ellipsoid(5120, {1.0, 0.8, 0.6})),
                            {"fandisk_coarse.obj", amps::make_cube(4)},
                            {"eight.off", amps::make_knot()}}) {
    const Mesh mesh = data_mesh_or(model.first, model.second);
    CAPTURE(model.first);
    compare(mesh, remeshed(mesh, 1500));
  }
}

TEST_CASE("surface_distance: Hausdorff, mean and rms agree with CGAL on shapes far from each other") {
  compare(amps::make_sphere(320), amps::make_cube(3));
  compare(amps::make_torus(1.0, 0.4, 24, 10), amps::make_sphere(1280, 0.9));
}

TEST_CASE("surface_tree: distances are those of CGAL's AABB tree") {
  for (const Mesh& mesh : {data_mesh_or("bunny_36k_holes.obj", amps::make_knot()), amps::make_cube(6),
                           data_mesh_or("triceratops.off", amps::make_torus())}) {
    const OracleMesh copy = oracle_mesh(amps::remove_isolated_vertices(mesh));
    const OracleTree tree(faces(copy).begin(), faces(copy).end(), copy);
    const amps::SurfaceTree ours(mesh);
    const amps::Box box = amps::bounding_box(mesh);
    Rng rng(1);
    double worst = 0;
    for (int q = 0; q < 3000; ++q) {
      const Vec3 x = box.min + (1.4 * random_point(rng) - 0.2 * Vec3::Ones()).cwiseProduct(box.max - box.min);
      worst = std::max(worst, std::abs(ours.nearest(x).distance - std::sqrt(tree.squared_distance(Point(x[0], x[1], x[2])))));
    }
    CHECK(worst <= 1e-14 * (box.diagonal() + box.max.norm()));
  }
}

}  // namespace amps_test
