#include "amps/mesh.h"

#include "kit/data.h"
#include "kit/errors.h"
#include "kit/meshes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

namespace {

Mesh corner_triangle() { return one_triangle({0, 0, 0}, {2, 0, 0}, {0, 1, 0}); }

/// Why a mesh cannot be used; empty: it can.
std::string trouble_with(const Mesh& mesh) {
  if (amps::check(mesh).usable()) {
    CHECK_NOTHROW(amps::require_usable(mesh));
    return "";
  }
  const Thrown thrown = thrown_by([&mesh] { amps::require_usable(mesh); });
  CHECK(thrown.code == ErrorCode::kInvalidMesh);
  return thrown.text;
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

// Facts of a file, read as it is and with equal vertices merged; found by other programs (see the folder's INDEX.md). −1: not
// known.
struct Facts {
  const char* name;
  Index vertices, facets;
  Index components[2], boundary_loops[2], non_manifold_edges[2], non_manifold_vertices[2];
  Index inconsistent_edges, repeated_index, zero_area, duplicates, isolated, genus;
};

const Facts kFacts[] = {
    {"anchor.off", 519, 1050, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 4},
    {"bones_26comps.off", 2154, 4204, {26, 26}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"bumpy.off", 1250, 2496, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"bunny_100kf_closed.obj", 50000, 99996, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"bunny_36k_holes.obj", 35947, 69451, {1, 1}, {5, 5}, {0, 0}, {0, 0}, 0, 0, 0, 0, 1113, 0},
    {"bunny_3k_closed.off", 3485, 6966, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"cheburashka.off", 6669, 13334, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"cow.off", 2762, 5520, {1, 1}, {0, 0}, {0, 1}, {0, 0}, 0, 0, 0, 1, 0, -1},
    {"cube-minimal-degenerated.obj", 8, -1, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 2, 0, 0, 0, 0},
    {"cube-shuffled.off", 8, 12, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 9, 0, 0, 0, 0, 0},
    {"cube_twist.obj", 6146, 12288, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"degtri_four-2.off", 6, 4, {1, 1}, {1, 1}, {0, 0}, {0, 0}, 0, 0, 1, 0, 0, 0},
    {"degtri_sliding.off", 8, 8, {1, 1}, {1, 1}, {0, 0}, {0, 0}, 0, 0, 4, 0, 0, 0},
    {"double-torus-polygons.off", 231, -1, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 2},
    {"eight.off", 315, 634, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 2},
    {"elephant.off", 2775, 5558, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 3},
    {"fan3_nonmanifold_edge.obj", 5, 3, {1, 1}, {1, 1}, {1, 1}, {0, 0}, 0, 0, 0, 0, 0, -1},
    {"fandisk.obj", 6475, 12946, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"fandisk_coarse.obj", 766, 1528, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"fandisk_quads.off", 766, 1528, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"fertility.off", 4494, 9000, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 4},
    {"hemisphere.off", 1861, 3600, {1, 1}, {1, 1}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"hinge_ascii.stl", 3636, 1212, {1212, 1}, {1212, 0}, {0, 0}, {0, 0}, 0, 0, 0, 3038, 0, 5},
    {"hole_capsule_quads.off", 89, 152, {1, 1}, {3, 3}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"homer.obj", 6002, 12000, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"hourglass_nonmanifold_vertex.obj", 23, 40, {1, 1}, {0, 0}, {0, 0}, {1, 1}, 0, 0, 0, 0, 0, -1},
    {"joined_tetrahedra.obj", 5, 8, {1, 1}, {0, 0}, {3, 3}, {0, 0}, 0, 0, 0, 0, 0, -1},
    {"knot2_2comps.off", 5760, 11520, {2, 2}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 2},
    {"lion-head.off", 8356, 16674, {1, 1}, {1, 1}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"maxFace.obj", 4486, 8743, {1, 1}, {1, 1}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"mech-holes-shark.off", 5246, 10192, {1, 1}, {4, 4}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"moebius.obj", 280, 448, {1, 1}, {1, 1}, {0, 0}, {0, 0}, 4, 0, 0, 0, 0, -1},
    {"negative_indices.obj", 8, 12, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"netgen_part1_ascii.stl", 1140, 380, {380, 1}, {380, 0}, {0, 0}, {0, 0}, 0, 0, 0, 950, 0, 1},
    {"platonic_shelf_polygons.obj", 50, -1, {5, 5}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"prim_isolated.off", 11, 12, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 3, 0},
    {"quads_to_stitch.off", 20, 16, {2, 1}, {2, 1}, {0, 0}, {0, 0}, 0, 0, 0, 5, 0, 0},
    {"rocker-arm.obj", 10044, 20088, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 1},
    {"sphere_solid_header_binary.stl", 4080, 1360, {1360, 1}, {1360, 0}, {0, 0}, {0, 0}, 0, 0, 0, 3398, 0, 0},
    {"spot.obj", 2930, 5856, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"suzanne.obj", 507, 968, {3, 1}, {4, 4}, {1, 1}, {0, 2}, 0, 0, 0, 2, 0, -1},
    {"teapot.obj", 3644, 6320, {4, 3}, {25, 6}, {0, 0}, {38, 1}, 0, 0, 0, 403, 0, -1},
    {"thingi_65004.stl", 4398, 1466, {1466, 1}, {1466, 0}, {0, 0}, {0, 0}, 0, 0, 0, 3667, 0, 2},
    {"three_peaks.off", 1907, 3671, {1, 1}, {1, 1}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"triceratops.off", 2832, 5660, {1, 1}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
    {"triple_vierbein.obj", 75, 108, {1, 1}, {1, 1}, {20, 20}, {0, 0}, 3, 0, 0, 0, 0, -1},
    {"two_spheres_overlap.obj", 1060, 2112, {2, 2}, {0, 0}, {0, 0}, {0, 0}, 0, 0, 0, 0, 0, 0},
};

}  // namespace

TEST_CASE("mesh: real files have the defects and the topology other programs found in them") {
  int tried = 0;
  for (const Facts& facts : kFacts) {
    const auto path = data_file(facts.name);
    if (!path) continue;
    ++tried;
    CAPTURE(facts.name);
    const Mesh mesh = amps::read_mesh(*path);
    const amps::MeshReport report = amps::check(mesh);
    const bool merged_by_reader = amps::mesh_format(*path) == amps::MeshFormat::kStl;
    const std::size_t as_read = merged_by_reader ? 1 : 0;
    const Index duplicates = merged_by_reader ? 0 : facts.duplicates;
    CHECK(report.vertices == facts.vertices - (facts.duplicates - duplicates));
    if (facts.facets >= 0) CHECK(report.facets == facts.facets);
    CHECK(report.usable());
    CHECK(report.duplicate_vertices == duplicates);
    CHECK(report.isolated_vertices == facts.isolated);
    CHECK(report.repeated_index_facets == facts.repeated_index);
    CHECK(report.zero_area_facets == facts.zero_area);
    CHECK(report.topology.inconsistent_edges == facts.inconsistent_edges);
    if (facts.genus >= 0) CHECK(report.topology.genus() == facts.genus);
    const amps::TopologyReport shapes[2] = {report.topology, amps::topology(amps::merge_equal_vertices(mesh))};
    for (std::size_t k = 0; k < 2; ++k) {
      const std::size_t expected = std::max(k, as_read);
      CAPTURE(k);
      CHECK(shapes[k].components == facts.components[expected]);
      if (expected == 0 || facts.name != std::string("suzanne.obj"))
        CHECK(shapes[k].boundary_loops == facts.boundary_loops[expected]);
      CHECK(shapes[k].non_manifold_edges == facts.non_manifold_edges[expected]);
      CHECK(shapes[k].non_manifold_vertices == facts.non_manifold_vertices[expected]);
    }
  }
  if (tried == 0) MESSAGE("no folder of real meshes here; set AMPS_TEST_DATA to check them");
}

TEST_CASE("mesh: area is the sum of facet areas, half the cross product, the same at any scale") {
  CHECK(amps::total_area(corner_triangle()) == 1.0);
  const Mesh sphere = amps::make_sphere(2000, 1.0);
  const std::vector<double> areas = amps::facet_areas(sphere);
  double sum = 0;
  for (const double area : areas) sum += area;
  CHECK(amps::total_area(sphere) == doctest::Approx(sum).epsilon(1e-13));
  for (const int exponent : {-500, -310, 310, 500}) {
    const Mesh other = scaled(sphere, std::ldexp(1.0, exponent));
    CHECK(amps::total_area(other) == std::ldexp(amps::total_area(sphere), 2 * exponent));  // powers of two: no rounding
    CHECK(same_values(amps::facet_normals(other), amps::facet_normals(sphere)));
  }
}

TEST_CASE("mesh: normals are unit, point to the right-hand side, and vanish where there is no area") {
  const Mesh sphere = amps::make_sphere(500, 3.0);
  const Points normals = amps::facet_normals(sphere);
  const MeshView view(sphere);
  for (Index f = 0; f < view.num_facets(); ++f) {
    REQUIRE(point_at(normals, f).norm() == doctest::Approx(1.0).epsilon(1e-14));
    const Vec3 middle = (view.corner(f, 0) + view.corner(f, 1) + view.corner(f, 2)) / 3.0;
    REQUIRE(point_at(normals, f).dot(middle) > 0);
  }
  const Mesh flat = mesh_of({{0.1, 0.1, 0.1}, {0.2, 0.2, 0.2}, {0.7, 0.7, 0.7}}, {{0, 1, 2}, {0, 1, 1}});
  CHECK(all_zero(amps::facet_normals(flat)));
  CHECK(amps::facet_areas(flat) == std::vector<double>{0.0, 0.0});
}

TEST_CASE("mesh: zero area is decided exactly, not by a tolerance") {
  // On the diagonal every coordinate triple is collinear whatever its rounding; one last bit off it is not.
  for (const double t : {0.1, 1.0 / 3.0, 0.7, 1e-9, 1e9}) {
    Vec3 p = Vec3::Constant(t);
    const auto zero_area = [&p] { return amps::check(mesh_of({{0, 0, 0}, {1, 1, 1}, p}, {{0, 1, 2}})).zero_area_facets; };
    CHECK(zero_area() == 1);
    p.z() = std::nextafter(t, 2 * t);
    CHECK(zero_area() == 0);
  }
}

TEST_CASE("mesh: the box is that of the vertices in use") {
  const Mesh mesh = mesh_of({{9, 9, 9}, {0, -1, 0}, {2, 0, 0}, {0, 1, 5}}, {{1, 2, 3}});
  CHECK(amps::bounding_box(mesh).min == Vec3(0, -1, 0));
  CHECK(amps::bounding_box(mesh).max == Vec3(2, 1, 5));
  CHECK(amps::bounding_box(without_facets(mesh)).diagonal() == 0.0);
}

TEST_CASE("mesh: the box leaves NaN out, whichever vertex has it") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (Index v = 0; v < 3; ++v) {
    CAPTURE(v);
    Mesh mesh = mesh_of({{0, -1, 0}, {2, 0, 0}, {0, 1, 5}, {1, 1, 1}}, {{3, 1, 2}, {0, 1, 2}});
    mesh.vertices(v, 1) = nan;
    const double low[] = {0, -1, -1}, high[] = {1, 1, 1};
    CHECK(amps::bounding_box(mesh).min == Vec3(0, low[v], 0));
    CHECK(amps::bounding_box(mesh).max == Vec3(2, high[v], 5));
  }
  Mesh nowhere = mesh_of({{nan, 0, 0}, {nan, 1, 0}, {nan, 0, 1}}, {{0, 1, 2}});
  CHECK(std::isnan(amps::bounding_box(nowhere).min.x()));
  CHECK(amps::bounding_box(nowhere).max.y() == 1);
}

TEST_CASE("mesh: what cannot be worked on is refused, naming the place") {
  CHECK(trouble_with(corner_triangle()).empty());
  CHECK(contains(trouble_with(Mesh{}), "no facet"));
  Mesh mesh = corner_triangle();
  mesh.vertices(2, 1) = kNaN;
  CHECK(contains(trouble_with(mesh), "vertex 2"));
  CHECK_FALSE(amps::check(mesh).usable());
  CHECK(amps::check(mesh).non_finite_vertices == 1);
  mesh.vertices(2, 1) = kInfinity;
  CHECK(contains(trouble_with(mesh), "vertex 2"));
  for (const Index bad : {-1, 3, std::numeric_limits<Index>::max()}) {
    mesh = corner_triangle();
    mesh.triangles(0, 1) = bad;
    CHECK(contains(trouble_with(mesh), "facet 0"));
    CHECK(amps::check(mesh).out_of_range_facets == 1);
    CHECK_FALSE(amps::check(mesh).usable());
    CHECK_THROWS_AS(amps::total_area(mesh), Error);
    CHECK_THROWS_AS(amps::merge_equal_vertices(mesh), Error);
    CHECK_THROWS_AS(amps::remove_isolated_vertices(mesh), Error);
  }
  mesh = mesh_of({{0, 0, 0}, {1, 2, 3}, {2, 4, 6}}, {{0, 1, 2}});
  CHECK(contains(trouble_with(mesh), "no area"));
  // An area that is no double is one nevertheless.
  for (const double size : {1e200, 1e-200, 1e307, 1e-310}) {
    CAPTURE(size);
    mesh = scaled(corner_triangle(), size);
    CHECK_NOTHROW(amps::require_usable(mesh));
    CHECK(amps::check(mesh).usable());
    CHECK(amps::check(mesh).area == (size > 1 ? kInfinity : 0));
  }
}

TEST_CASE("mesh: isolated vertices go, order and geometry stay") {
  const Mesh original = amps::make_sphere(80, 1.0);
  const Index n = rows(original.vertices);
  const Points padded =
      made_points(2 * n, [&](Index v) { return v % 2 == 0 ? Vec3(100, 100, v / 2) : point_at(original.vertices, v / 2); });
  const Mesh mesh{padded, renumbered(original.triangles, [](Index v) { return 2 * v + 1; })};
  CHECK(amps::check(mesh).isolated_vertices == n);
  const Mesh cleaned = amps::remove_isolated_vertices(mesh);
  CHECK(same_values(cleaned.vertices, original.vertices));
  CHECK(same_values(cleaned.triangles, original.triangles));
}

TEST_CASE("mesh: merging a soup gives back the mesh; −0 equals 0, NaN equals nothing") {
  const Mesh original = amps::make_cube(4);
  Mesh soup = soup_of(original);
  for (Index v = 0; v < rows(soup.vertices); ++v) {  // some zeros are −0
    const Vec3 x = point_at(soup.vertices, v);
    if (v / 3 % 2 == 0) soup.vertices.row(v) = Vec3(-(-x[0] + 0.0), -(-x[1] + 0.0), -(-x[2] + 0.0)).transpose();
  }
  CHECK(amps::topology(soup).components == rows(soup.triangles));
  CHECK(amps::check(soup).duplicate_vertices == rows(soup.vertices) - rows(original.vertices));
  const Mesh merged = amps::merge_equal_vertices(soup);
  CHECK(rows(merged.vertices) == rows(original.vertices));
  CHECK(amps::topology(merged).euler_characteristic == 2);
  CHECK(amps::topology(merged).closed());
  for (Index f = 0; f < rows(merged.triangles); ++f) {
    for (int k = 0; k < 3; ++k) REQUIRE(MeshView(merged).corner(f, k) == MeshView(original).corner(f, k));
  }
  const Mesh nan{constant_points(3, kNaN), corner_triangle().triangles};
  CHECK(amps::merge_equal_vertices(nan).vertices.rows() == 3);
}

TEST_CASE("mesh: topology of the textbook shapes") {
  struct Case {
    const char* name;
    Mesh mesh;
    Index components, euler, loops, nm_edges, nm_vertices, inconsistent;
  };
  const std::vector<Vec3> six = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 0}, {1, 1, 1}};
  const Case cases[] = {
      {"triangle", mesh_of(six, {{0, 1, 2}}), 1, 1, 1, 0, 0, 0},
      {"two sides of a triangle", mesh_of(six, {{0, 1, 2}, {0, 2, 1}}), 1, 2, 0, 0, 0, 0},
      {"a facet twice", mesh_of(six, {{0, 1, 2}, {0, 1, 2}}), 1, 2, 0, 0, 0, 3},
      {"two facets at a vertex", mesh_of(six, {{0, 1, 2}, {0, 3, 4}}), 1, 1, 2, 0, 1, 0},
      {"two facets apart", mesh_of(six, {{0, 1, 2}, {3, 4, 5}}), 2, 2, 2, 0, 0, 0},
      {"two facets at an edge, against each other", mesh_of(six, {{0, 1, 2}, {0, 1, 4}}), 1, 1, 1, 0, 0, 1},
      {"three facets at an edge", mesh_of(six, {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}}), 1, 1, 1, 1, 0, 0},
      {"a facet of repeated indices", mesh_of(six, {{0, 1, 2}, {3, 4, 3}}), 1, 1, 1, 0, 0, 0},
      {"torus", amps::make_torus(1, 0.4, 9, 7), 1, 0, 0, 0, 0, 0},
  };
  for (const Case& c : cases) {
    CAPTURE(c.name);
    const amps::TopologyReport report = amps::topology(c.mesh);
    CHECK(report.components == c.components);
    CHECK(report.euler_characteristic == c.euler);
    CHECK(report.boundary_loops == c.loops);
    CHECK(report.non_manifold_edges == c.nm_edges);
    CHECK(report.non_manifold_vertices == c.nm_vertices);
    CHECK(report.inconsistent_edges == c.inconsistent);
  }
}

TEST_CASE("mesh: edges are counted as by a set") {
  Rng rng(7);
  for (int round = 0; round < 20; ++round) {
    const std::uint64_t n = 4 + rng.below(30);
    std::vector<Vec3> points;
    std::vector<Corners> facets;
    for (std::uint64_t i = 0; i < n; ++i) points.emplace_back(rng.uniform(), rng.uniform(), rng.uniform());
    const auto vertex = [&] { return static_cast<Index>(rng.below(n)); };
    for (std::uint64_t i = 0; i < 3 * n; ++i) facets.push_back({vertex(), vertex(), vertex()});
    const Mesh mesh = mesh_of(points, facets);
    std::multiset<std::pair<Index, Index>> sides;
    std::set<std::pair<Index, Index>> edges;
    for (const auto& f : facets) {
      if (f[0] == f[1] || f[1] == f[2] || f[2] == f[0]) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::pair<Index, Index> edge = std::minmax({f[k], f[(k + 1) % 3]});
        sides.insert(edge);
        edges.insert(edge);
      }
    }
    Index boundary = 0, crowded = 0;
    for (const auto& edge : edges) {
      boundary += sides.count(edge) == 1 ? 1 : 0;
      crowded += sides.count(edge) > 2 ? 1 : 0;
    }
    const amps::TopologyReport report = amps::topology(mesh);
    CHECK(report.edges == static_cast<Index>(edges.size()));
    CHECK(report.boundary_edges == boundary);
    CHECK(report.non_manifold_edges == crowded);
  }
}

TEST_CASE("mesh: a vertex out of proportion is found, and nothing else") {
  for (const Mesh& mesh : {amps::make_sphere(300), amps::make_cube(1), amps::make_torus(3, 1, 20, 10)}) {
    CHECK(amps::find_wild_vertex(mesh) == amps::kNone);
    const auto n = static_cast<Index>(mesh.vertices.rows());
    for (const Index v : {0, n / 2, n - 1}) {
      for (const double far : {1e7, 1e12, -1e160}) {
        Mesh wild = mesh;
        wild.vertices(v, v % 3) += far;
        CHECK(amps::find_wild_vertex(wild) == v);
        CHECK(amps::check(wild).wild_vertex == v);
        for (std::ptrdiff_t i = 0; i < 3 * n; ++i) wild.vertices(i / 3, static_cast<int>(i % 3)) *= 1e-60;
        CHECK(amps::find_wild_vertex(wild) == v);
      }
      Mesh far = mesh;
      far.vertices(v, 0) += 1e5;
      CHECK(amps::find_wild_vertex(far) == amps::kNone);
    }
  }
  Mesh two = amps::make_sphere(2000);  // the farther one, and what is isolated or broken does not count
  two.vertices.row(5) = Vec3(1e9, 0, 0).transpose();
  two.vertices.row(700) = Vec3(0, -2e9, 0).transpose();
  CHECK(amps::find_wild_vertex(two) == 700);
  two.triangles(3, 1) = -1;
  two.vertices(9, 2) = kInfinity;
  CHECK(amps::find_wild_vertex(two) == 700);
  Mesh isolated = amps::make_cube(2);
  isolated.vertices.resize(isolated.vertices.rows() + 1);
  for (std::ptrdiff_t v = 0; v < isolated.vertices.rows(); ++v)
    isolated.vertices.row(v) = Vec3(0.1 * static_cast<double>(v), 1, 0).transpose();
  isolated.vertices.row(isolated.vertices.rows() - 1) = Vec3(1e12, 0, 0).transpose();
  CHECK(amps::find_wild_vertex(isolated) == amps::kNone);
  // Needles have two ends, a small and a large part are two parts.
  Mesh needles;
  needles.vertices.resize(120);
  needles.triangles.resize(40);
  for (Index f = 0; f < 40; ++f) {
    const double at = 1e-12 * f;
    needles.vertices.row(3 * f) = Vec3(at, 0, 0).transpose();
    needles.vertices.row(3 * f + 1) = Vec3(at, 1e-12, 0).transpose();
    needles.vertices.row(3 * f + 2) = Vec3(0, 1, at).transpose();
    for (int k = 0; k < 3; ++k) needles.triangles(f, k) = 3 * f + k;
  }
  CHECK(amps::find_wild_vertex(needles) == amps::kNone);
}

TEST_CASE("mesh: functions take a caller's buffers as they are") {
  const double xyz[9] = {0, 0, 0, 2, 0, 0, 0, 1, 0};
  const Index corners[3] = {0, 1, 2};
  const amps::PointsView vertices(xyz, 3);
  const amps::TrianglesView triangles(corners, 1);
  const MeshView view(vertices, triangles);
  CHECK(view.vertices.address(1) == xyz + 3);
  CHECK(amps::total_area(view) == 1.0);
  std::ostringstream text;
  text << amps::check(view);
  CHECK(contains(text.str(), "usable                 yes"));
}

}  // namespace amps_test
