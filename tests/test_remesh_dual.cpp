// The dual mod 2: its law, its counts and its independence, on closed surfaces and on those that are there twice.
#include "amps/mesh_edges.h"
#include "amps/optimize.h"
#include "amps/remesh.h"
#include "amps/surface_distance.h"

#include "kit/bits.h"
#include "kit/data.h"
#include "kit/diagrams.h"
#include "kit/execution.h"
#include "kit/meshes.h"
#include "kit/models.h"
#include "kit/samples.h"
#include "kit/sites.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {
namespace {

Mesh tetrahedron() {
  return mesh_of({{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}}, {{0, 1, 2}, {0, 3, 1}, {0, 2, 3}, {1, 3, 2}});
}

/// Two with a facet in common, which is there twice. Once, three sheets meet at its edges.
Mesh joined_tetrahedra() {
  return mesh_of({{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}, {1.5, 1.5, -1.5}},
                 {{0, 1, 2}, {0, 3, 1}, {0, 2, 3}, {1, 3, 2}, {0, 2, 1}, {4, 0, 1}, {4, 1, 2}, {4, 2, 0}});
}

/// A closed prism along z over a polygon in the plane, which is a star seen from its first corner.
Mesh prism(const std::vector<std::array<double, 2>>& polygon, double length) {
  std::vector<Vec3> vertices;
  for (const double z : {0.0, length}) {
    for (const auto& [x, y] : polygon) vertices.emplace_back(x, y, z);
  }
  const auto n = static_cast<Index>(polygon.size());
  std::vector<Corners> triangles;
  for (Index k = 0; k < n; ++k) {
    const Index next = (k + 1) % n;
    triangles.push_back({k, next, n + next});
    triangles.push_back({k, n + next, n + k});
    if (k < 2) continue;
    triangles.push_back({0, k, k - 1});
    triangles.push_back({n, n + k - 1, n + k});
  }
  return mesh_of(vertices, triangles);
}

Mesh wedge(double degrees) { return prism({{0, 0}, {1, 0}, {std::cos(degrees * kDegree), std::sin(degrees * kDegree)}}, 1); }

Mesh rhombus(double degrees) {
  const double c = std::cos(degrees * kDegree), s = std::sin(degrees * kDegree);
  return prism({{0, 0}, {1, 0}, {1 + c, s}, {c, s}}, 1);
}

/// Sharp teeth, all seen from the first corner.
Mesh saw() {
  constexpr int kTeeth = 8;
  std::vector<std::array<double, 2>> polygon = {{0, -1}};
  for (int k = 0; k < kTeeth; ++k) {
    polygon.push_back({0.25 * k - 0.875, 0.1});
    polygon.push_back({0.25 * k - 0.750, 0.9});
  }
  std::reverse(polygon.begin() + 1, polygon.end());
  return prism(polygon, 1);
}

Mesh plate(double thickness) {
  return transformed(amps::make_cube(2), [thickness](const Vec3& x) { return Vec3(x.x(), x.y(), thickness * x.z()); });
}

/// Tetrahedra that share an edge: 2 · count sheets meet there.
Mesh tents(Index count) {
  Mesh all = tetrahedron();
  for (Index k = 1; k < count; ++k) {
    // All share the edge from corner 0 to corner 1, and turn about it.
    const Vec3 a(1, 1, 1), b(1, -1, -1);
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(2.1 * k, (b - a).normalized()).toRotationMatrix();
    const auto map = [&](const Vec3& x) -> Vec3 { return x == a || x == b ? x : Vec3(a + turn * (x - a)); };
    all = joined(all, transformed(tetrahedron(), map));
  }
  return all;
}

/// Random tetrahedra through each other.
Mesh tetrahedra(int count, std::uint64_t seed) {
  Rng rng(seed);
  Mesh all = shaken(tetrahedron(), 0.8, rng);
  for (int k = 1; k < count; ++k) all = joined(all, shaken(tetrahedron(), 0.8, rng));
  return all;
}

/// Two sheets of a square in the same place, with other diagonals, and closed around.
Mesh pillow() { return mesh_of({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 3, 2}}); }

std::vector<NamedMesh> closed_surfaces() {
  return {{"tetrahedron", data_mesh_or("reports/34_tetrahedron.obj", tetrahedron())},
          {"tetrahedron of our own", tetrahedron()},
          {"soup of a tetrahedron", soup_of(tetrahedron())},
          {"wedge of 15 degrees", data_mesh_or("reports/28_wedge_15.obj", wedge(15))},
          {"wedge of 45 degrees", data_mesh_or("reports/28_wedge_45.obj", wedge(45))},
          {"wedge of 15 degrees of our own", wedge(15)},
          {"w60", data_mesh_or("reports/w60.obj", wedge(60))},
          {"rhombus of 60 degrees", data_mesh_or("reports/33_rhombus_60.obj", rhombus(60))},
          {"rhombus of 50 degrees of our own", rhombus(50)},
          {"saw", data_mesh_or("reports/24_saw.obj", saw())},
          {"saw of our own", saw()},
          {"plate", plate(0.01)},
          {"thicker plate", plate(0.05)},
          {"cube", amps::make_cube(3)},
          {"sphere", amps::make_sphere(320)},
          {"knot", small_knot()},
          {"two tents on an edge", tents(2)},
          {"three tents on an edge", tents(3)},
          {"tetrahedra", tetrahedra(6, 71)},
          {"pillow", pillow()},
          {"flipped facets", with_random_flips(rhombus(60), 5)}};
}

using Link = std::array<Index, 2>;

/// Edges of an odd number of triangles.
std::set<Link> odd_edges_of(const Mesh& mesh) {
  std::set<Link> odd;
  for (Index t = 0; t < rows(mesh.triangles); ++t) {
    for (int k = 0; k < 3; ++k) {
      const Index a = mesh.triangles(t, k), b = mesh.triangles(t, (k + 1) % 3);
      const Link edge = {std::min(a, b), std::max(a, b)};
      if (!odd.insert(edge).second) odd.erase(edge);
    }
  }
  return odd;
}

std::size_t odd_edges(const Mesh& mesh) { return odd_edges_of(mesh).size(); }

/// Pairs of cells whose border crosses edges of the surface with an odd number of facets, an odd number of times in all.
std::set<Link> odd_crossings(const Mesh& mesh, const Diagram& diagram) {
  std::set<Link> odd;
  const amps::detail::SurfaceEdges edges(mesh);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    if (edges[e].size() % 2 == 0) continue;
    const Index label = Diagram::mesh_edge_label(edges[e][0].k);
    for (Index f = diagram.first_of_facet(edges[e][0].facet); f != kNone; f = diagram.next_of_facet(f)) {
      const Diagram::Polygon p = diagram.polygon(f);
      for (Index k = 0; k < p.size; ++k) {
        const Index in = p.labels[k == 0 ? p.size - 1 : k - 1], out = p.labels[k];
        const Index other = in == label ? out : out == label ? in : kNone;
        if (other <= p.site) continue;  // a mesh edge, or the fragment beyond tells
        if (!odd.insert({p.site, other}).second) odd.erase({p.site, other});
      }
    }
  }
  return odd;
}

bool is_closed_surface(const Mesh& mesh) {
  const amps::detail::SurfaceEdges edges(mesh);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    if (edges[e].size() % 2 != 0) return false;
  }
  return true;
}

/// How the cells of each triple meet: times, and times against the order of the triple.
struct Met {
  int times = 0, turned = 0;
};

/// The oracle: for each facet, which three fragments share a corner, and in which order their sites lie around it. From corner
/// positions and areas alone: labels are not looked at.
std::map<Corners, Met> met_triples(const Mesh& mesh, const Diagram& diagram) {
  std::map<Corners, Met> result;
  for (Index facet = 0; facet < rows(mesh.triangles); ++facet) {
    struct Seen {
      std::vector<std::pair<double, Index>> around;  ///< by the angle of the fragment's middle
    };
    std::map<std::array<double, 3>, Seen> corners;
    const MeshView view(mesh);
    const Vec3 u = (view.corner(facet, 1) - view.corner(facet, 0)).normalized();
    const Vec3 normal = u.cross(view.corner(facet, 2) - view.corner(facet, 0)).normalized(), v = normal.cross(u);
    for (Index f = diagram.first_of_facet(facet); f != kNone; f = diagram.next_of_facet(f)) {
      const Diagram::Polygon p = diagram.polygon(f);
      Vec3 middle = Vec3::Zero();
      for (Index k = 0; k < p.size; ++k) middle += p.corners[k] / p.size;
      for (Index k = 0; k < p.size; ++k) {
        const Vec3 &x = p.corners[k], to = middle - x;
        corners[{x.x(), x.y(), x.z()}].around.push_back({std::atan2(to.dot(v), to.dot(u)), p.site});
      }
    }
    for (auto& [x, seen] : corners) {
      if (seen.around.size() != 3) continue;
      std::sort(seen.around.begin(), seen.around.end());
      // Inside, not on the border of the facet, where no three fragments meet but in ties.
      Corners order = {seen.around[0].second, seen.around[1].second, seen.around[2].second};
      std::rotate(order.begin(), std::min_element(order.begin(), order.end()), order.end());
      Met& met = result[{order[0], std::min(order[1], order[2]), std::max(order[1], order[2])}];
      ++met.times;
      met.turned += order[1] > order[2] ? 1 : 0;
    }
  }
  return result;
}

SampleSet random_set(const Mesh& mesh, Index n, double spread, std::uint64_t seed) {
  const double r = radius_for(mesh, n);
  const Sites sites = random_sites(mesh, n, spread * r * r, seed);
  SampleSet set = bare_set(sites.positions, sites.weights);
  for (double& w : set.radii) w = std::sqrt(w + 1e-3 * r * r);
  return set;
}

Mesh twice(const Mesh& mesh, bool turned) { return joined(mesh, turned ? inside_out(mesh) : mesh); }

}  // namespace

TEST_CASE("dual: no boundary opens on a closed surface, whatever the samples") {
  for (const NamedMesh& model : closed_surfaces()) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    CAPTURE(name);
    REQUIRE(is_closed_surface(mesh));
    for (const Index n : {30, 300, 2000}) {
      CAPTURE(n);
      for (const double spread : {0.0, 1.0, 6.0}) {
        CAPTURE(spread);
        const Mesh dual = amps::restricted_triangulation(mesh, random_set(mesh, n, spread, 17 + static_cast<std::uint64_t>(n)));
        CHECK(odd_edges(dual) == 0);
      }
    }
  }
}

TEST_CASE("dual: an edge has an odd number of triangles where the border of its cells leaves the surface, and only there") {
  std::vector<NamedMesh> meshes = small_meshes();
  meshes.push_back({"book of 3 pages", open_book(3)});
  meshes.push_back({"book of 4 pages", open_book(4)});
  meshes.push_back({"moebius", moebius_strip(20, 3)});
  meshes.push_back({"near sheets", two_sheets(0.03)});
  meshes.push_back({"our own joined tetrahedra", joined_tetrahedra()});
  meshes.push_back({"joined tetrahedra", data_mesh_or("joined_tetrahedra.obj", joined_tetrahedra())});
  meshes.push_back({"three sheets", data_mesh_or("reports/13_three_sheets.obj", open_book(3))});
  std::size_t crossings = 0;
  for (const NamedMesh& model : meshes) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    CAPTURE(name);
    for (const Index n : {20, 200, 1000}) {
      CAPTURE(n);
      for (const double spread : {0.0, 2.0}) {
        const SampleSet set = random_set(mesh, n, spread, 41);
        const std::set<Link> expected = odd_crossings(mesh, diagram_of(mesh, set));
        CHECK(odd_edges_of(amps::restricted_triangulation(mesh, set)) == expected);
        crossings += expected.size();
      }
    }
  }
  CHECK(crossings > 1000);
}

TEST_CASE("dual: no boundary opens where samples lie on a lattice, with all its ties") {
  for (const Index cells : {1, 2, 3, 4}) {
    CAPTURE(cells);
    const Mesh mesh = amps::make_cube(cells);
    for (const Index side : {1, 2, 3, 4, 6}) {
      CAPTURE(side);
      const Mesh sites = amps::make_cube(side);
      const SampleSet set = bare_set(sites.vertices, Values(at(rows(sites.vertices)), 0.4));
      CHECK(odd_edges(amps::restricted_triangulation(mesh, set)) == 0);
    }
  }
}

TEST_CASE("dual: no boundary opens when sites come and go") {
  Rng rng(5);
  for (const NamedMesh& model : {NamedMesh{"tetrahedron", tetrahedron()}, NamedMesh{"plate", plate(0.05)}}) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    CAPTURE(name);
    const SampleSet set = random_set(mesh, 200, 1, 3);
    Diagram diagram = diagram_of(mesh, set);
    for (int k = 0; k < 60; ++k) {
      const auto s = static_cast<Index>(rng.below(200));
      if (!diagram.removed(s)) diagram.remove(s);
    }
    std::map<Corners, int> times;
    const Triangles triangles = diagram.dual_triangles();
    for (Index t = 0; t < rows(triangles); ++t) {
      Corners corners = {triangles(t, 0), triangles(t, 1), triangles(t, 2)};
      std::sort(corners.begin(), corners.end());
      ++times[corners];
    }
    std::map<std::array<Index, 2>, int> at_edge;
    for (const auto& [corners, n] : times) {
      if (n % 2 == 0) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        const Index a = corners[k], b = corners[(k + 1) % 3];
        ++at_edge[{std::min(a, b), std::max(a, b)}];
      }
    }
    for (const auto& [edge, n] : at_edge) CHECK(n % 2 == 0);
  }
}

TEST_CASE("dual: a triple is there if its cells meet an odd number of times") {
  int doubled = 0, tripled = 0;
  for (const NamedMesh& model : closed_surfaces()) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    if (name == "pillow") continue;  // corners of both sheets in one place
    CAPTURE(name);
    const SampleSet set = random_set(mesh, 150, 1, 23);
    const Diagram diagram = diagram_of(mesh, set);
    std::map<Corners, int> expected;
    for (const auto& [corners, met] : met_triples(mesh, diagram)) {
      doubled += met.times == 2 ? 1 : 0;
      tripled += met.times == 3 ? 1 : 0;
      if (met.times % 2 == 1) expected[corners] = met.times;
    }
    const Mesh dual = amps::restricted_triangulation(mesh, set);
    CHECK(at(rows(dual.triangles)) == expected.size());
    Index missed = 0;
    for (Index t = 0; t < rows(dual.triangles); ++t) {
      Corners corners = {dual.triangles(t, 0), dual.triangles(t, 1), dual.triangles(t, 2)};
      std::sort(corners.begin(), corners.end());
      missed += expected.count(corners) == 1 ? 0 : 1;
    }
    CHECK(missed == 0);
  }
  CHECK(doubled > 20);
  MESSAGE(doubled << " triples met twice, " << tripled << " three times");
}

TEST_CASE("dual: a tetrahedron of few thousand samples comes out closed and manifold, optimised or not") {
  const Mesh mesh = data_mesh_or("reports/34_tetrahedron.obj", tetrahedron());
  for (const bool optimize : {false, true}) {
    CAPTURE(optimize);
    amps::RemeshOptions options;
    options.sampling = with_count(3000);
    options.optimize = optimize;
    const amps::RemeshResult result = amps::remesh(mesh, options);
    CHECK(result.report.output.boundary_edges == 0);
    CHECK(result.report.output.non_manifold_edges == 0);
    CHECK(odd_edges(result.mesh) == 0);
  }
}

TEST_CASE("dual: no boundary opens after optimisation, nor with radii that vary" * doctest::test_suite("slow")) {
  for (const NamedMesh& model : closed_surfaces()) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    if (name == "pillow") continue;  // nothing left
    CAPTURE(name);
    amps::RemeshOptions options;
    options.sampling = with_count(600);
    // Of disks that know their surface the law holds where curves are kept.
    const amps::RemeshResult result = amps::remesh(mesh, options);
    if (result.report.certificate.holds()) CHECK(odd_edges(result.mesh) == 0);
    CHECK(odd_edges(amps::remesh(mesh, without_curves(options)).mesh) == 0);
    options.sampling.neighborhood = amps::Neighborhood::kSpace;
    CHECK(odd_edges(amps::remesh(mesh, options).mesh) == 0);
  }
}

TEST_CASE("dual: diagrams of surfaces that are there twice obey all laws, and are those of one") {
  for (const NamedMesh& model : {NamedMesh{"cube", amps::make_cube(1)}, NamedMesh{"soup", random_soup(10, 3)}}) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    CAPTURE(name);
    const Mesh doubled = twice(mesh, true);
    const Sites sites = random_sites(doubled, 40, 0.01, 9);
    const Diagram one(mesh, sites.positions, sites.weights), two(doubled, sites.positions, sites.weights);
    CHECK(broken_law(doubled, two) == "");
    CHECK(canonical(one) == canonical(two));
    CHECK(worst_area_error(doubled, sites, two) < 1e-12);
    CHECK(same_diagram(inserted_one_by_one(doubled, sites), two));
  }
}

TEST_CASE("dual: facets that are there twice are one") {
  const std::vector<NamedMesh> once = {{"square", amps::make_square(2)},
                                       {"cube", amps::make_cube(2)},
                                       {"sphere", amps::make_sphere(180)},
                                       {"tetrahedron", tetrahedron()}};
  for (const NamedMesh& model : once) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    CAPTURE(name);
    for (const bool turned : {false, true}) {
      CAPTURE(turned);
      const Mesh doubled = twice(mesh, turned);
      const Index n = rows(mesh.triangles);
      const amps::MeshReport report = amps::check(doubled);
      CHECK(report.repeated_facets == n);
      CHECK(amps::check(mesh).repeated_facets == 0);
      CHECK(report.area == amps::total_area(mesh));
      CHECK(amps::total_area(doubled) == amps::total_area(mesh));
      const std::vector<double> areas = amps::facet_areas(doubled);
      CHECK(std::count(areas.begin() + n, areas.end(), 0.0) == n);

      amps::RemeshOptions options;
      options.sampling = with_radius(radius_for(mesh, 500));
      options.sampling.neighborhood = amps::Neighborhood::kSpace;
      const amps::RemeshResult one = amps::remesh(mesh, options), two = amps::remesh(doubled, options);
      CHECK(two.status == Outcome::kDone);
      CHECK(*std::max_element(two.samples.facets.begin(), two.samples.facets.end()) < n);
      CHECK(std::fabs(two.samples.size() - one.samples.size()) < 0.1 * one.samples.size());
      CHECK(two.report.maximality.maximal());
      CHECK(two.report.maximality.poisson_disk());
      CHECK(two.report.output.euler_characteristic == one.report.output.euler_characteristic);
      const Mesh again = amps::restricted_triangulation(doubled, one.samples);
      CHECK(same_values(again.triangles, one.mesh.triangles));
      CHECK(two.report.input.euler_characteristic == one.report.input.euler_characteristic);
      CHECK(two.report.input.boundary_loops == one.report.input.boundary_loops);
      CHECK(two.report.input.facets == n);

      const Diagram diagram = diagram_of(doubled, one.samples);
      CHECK(diagram.check() == "");
      for (Index f = n; f < 2 * n; ++f) CHECK(diagram.first_of_facet(f) == kNone);

      const amps::OneSidedDistance from_both = amps::one_sided_distance(doubled, one.mesh);
      const amps::OneSidedDistance from_one = amps::one_sided_distance(mesh, one.mesh);
      CHECK(from_both.mean == doctest::Approx(from_one.mean).epsilon(1e-12));
      CHECK(from_both.rms == doctest::Approx(from_one.rms).epsilon(1e-12));
    }
  }
}

TEST_CASE("dual: one side of a cube that is there twice makes no difference") {
  const Mesh cube = amps::make_cube(3);
  std::vector<Index> side;
  for (Index f = 0; f < rows(cube.triangles); ++f) {
    bool on_top = true;
    for (int k = 0; k < 3; ++k) on_top = on_top && MeshView(cube).corner(f, k).z() == 1;
    if (on_top) side.push_back(f);
  }
  REQUIRE(side.size() == 18);
  const Mesh doubled = joined(inside_out(chosen_facets(cube, side)), cube);  // copies come first, and stand for the others
  CHECK(is_closed_surface(doubled));
  CHECK(amps::check(doubled).repeated_facets == 18);
  CHECK(amps::total_area(doubled) == doctest::Approx(6).epsilon(1e-14));
  for (const Index n : {50, 500, 3000}) {
    const amps::RemeshResult result = amps::remesh(doubled, plain(with_count(n)));
    CHECK(odd_edges(result.mesh) == 0);
    CHECK(result.report.output.closed());
    CHECK(result.report.output.inconsistent_edges == 0);
  }
}

TEST_CASE("dual: the double-sided sheet of a report is one sheet") {
  const Mesh mesh = data_mesh_or("reports/36_double_sided.obj", twice(amps::make_square(2), true));
  const amps::MeshReport report = amps::check(mesh);
  CHECK(2 * report.repeated_facets == report.facets);
  amps::RemeshOptions options;
  options.sampling = with_count(1000);
  const amps::RemeshResult result = amps::remesh(mesh, options);
  CHECK(result.report.output.non_manifold_edges == 0);
  CHECK(result.report.output.boundary_loops == result.report.input.boundary_loops);
  CHECK(result.report.output.facets > 1500);
}

}  // namespace amps_test
