#include "amps/power_diagram.h"

#include "kit/diagrams.h"
#include "kit/errors.h"
#include "kit/execution.h"

#include "amps/power_diagram_clipper.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <vector>

namespace amps_test {

TEST_CASE("power_diagram: fragments tile every facet, labels are mutual, corners at a vertex have the same bits") {
  for (const auto& model : small_meshes()) {
    CAPTURE(model.name);
    const auto& [name, mesh] = model;
    const double size = amps::bounding_box(mesh).diagonal();
    for (const Index n : {1, 2, 5, 40, 400}) {
      for (const double weight : {0.0, 0.02, 0.3}) {
        CAPTURE(n);
        CAPTURE(weight);
        const Sites sites = random_sites(mesh, n, weight * size * size / n, static_cast<std::uint64_t>(100 + n));
        const Diagram diagram(mesh, sites.positions, sites.weights);
        CHECK(broken_law(mesh, diagram) == "");
        const std::vector<double> areas = diagram.cell_areas();
        const double area = amps::total_area(mesh);
        CHECK(std::accumulate(areas.begin(), areas.end(), 0.0) == doctest::Approx(area).epsilon(1e-12));
      }
    }
  }
}

TEST_CASE("power_diagram: areas per site agree with a clip by all bisectors") {
  for (const auto& model : small_meshes()) {
    CAPTURE(model.name);
    const auto& [name, mesh] = model;
    const double size = amps::bounding_box(mesh).diagonal();
    for (const Index n : {2, 12, 50}) {
      CAPTURE(n);
      const double spacing2 = size * size / n;
      const Sites uniform = random_sites(mesh, n, 0, 7);
      CHECK(worst_area_error(mesh, uniform, {mesh, uniform.positions, uniform.weights}) <= 1e-12);
      const Sites weighted = random_sites(mesh, n, 0.05 * spacing2, 8);
      CHECK(worst_area_error(mesh, weighted, {mesh, weighted.positions, weighted.weights}) <= 1e-12);
      const Sites off_surface = random_sites(mesh, n, 0.05 * spacing2, 9, 0.5 * size);
      CHECK(worst_area_error(mesh, off_surface, {mesh, off_surface.positions, off_surface.weights}) <= 1e-12);
      Sites negative = uniform;
      negative.weights = constant_values(n, -3 * size * size);
      CHECK(worst_area_error(mesh, negative, {mesh, negative.positions, negative.weights}) <= 1e-12);
    }
  }
}

TEST_CASE("power_diagram: hidden and duplicate sites own nothing, the others what is theirs") {
  for (const auto& model : small_meshes()) {
    CAPTURE(model.name);
    const auto& [name, mesh] = model;
    const double size = amps::bounding_box(mesh).diagonal();
    Sites sites = random_sites(mesh, 60, 0.5 * size * size, 21);
    // Copies: of equal weight, lighter, heavier.
    for (const Index s : {3, 10, 20}) {
      sites.positions.row(s + 1) = sites.positions.row(s);
      sites.positions.row(s + 2) = sites.positions.row(s);
      sites.weights[s + 1] = sites.weights[s] = 0.5 * size * size;
      sites.weights[s + 2] = sites.weights[s] + (s == 10 ? 0.01 : -0.01) * size * size;
    }
    const Diagram diagram(mesh, sites.positions, sites.weights);
    CHECK(broken_law(mesh, diagram) == "");
    CHECK(count_hidden(diagram) > 10);
    CHECK(count_hidden(diagram) < 60);
    CHECK(!diagram.visible(4));
    CHECK(!diagram.visible(5));
    CHECK(!diagram.visible(10));
    CHECK(!diagram.visible(11));
    CHECK(worst_area_error(mesh, sites, diagram) <= 1e-12);
    const std::vector<double> areas = diagram.cell_areas();
    for (Index s = 0; s < sites.size(); ++s) {
      if (!diagram.visible(s)) CHECK(areas[static_cast<std::size_t>(s)] == 0);
    }
    CHECK(same_diagram(diagram, inserted_one_by_one(mesh, sites)));
  }
}

TEST_CASE("power_diagram: a random point lies in the fragment of its power-nearest site") {
  Rng rng(31);
  for (const auto& model : small_meshes()) {
    CAPTURE(model.name);
    const auto& [name, mesh] = model;
    const double size = amps::bounding_box(mesh).diagonal();
    const Sites sites = random_sites(mesh, 120, 0.1 * size * size / 120, 32);
    const Diagram diagram(mesh, sites.positions, sites.weights);
    for (int t = 0; t < 2000; ++t) {
      const Index facet = static_cast<Index>(rng.below(static_cast<std::uint64_t>(mesh.triangles.rows())));
      const Vec3 b = amps::uniform_barycentric(rng);
      Vec3 x = Vec3::Zero();
      for (int k = 0; k < 3; ++k) x += b[k] * MeshView(mesh).corner(facet, k);
      Index nearest = 0;
      const auto power = [&](Index s) { return (x - sites.at(s)).squaredNorm() - sites.weights[s]; };
      for (Index s = 1; s < sites.size(); ++s) {
        if (power(s) < power(nearest)) nearest = s;
      }
      Index f = diagram.first_of_facet(facet);
      while (f != kNone && diagram.polygon(f).site != nearest) f = diagram.next_of_facet(f);
      REQUIRE(f != kNone);
      const Diagram::Polygon p = diagram.polygon(f);
      const Vec3 a = MeshView(mesh).corner(facet, 0);
      const Vec3 normal = (MeshView(mesh).corner(facet, 1) - a).cross(MeshView(mesh).corner(facet, 2) - a).normalized();
      double outside = 0;
      for (Index k = 0; k < p.size; ++k) {
        const Vec3 edge = p.corners[k + 1 == p.size ? 0 : k + 1] - p.corners[k];
        const double length = edge.norm();
        if (length > 0) outside = std::max(outside, -edge.cross(x - p.corners[k]).dot(normal) / length);
      }
      // Edges that are too short to have a direction may put the point out by their length.
      CHECK(outside <= 1e-9 * size);
    }
  }
}

TEST_CASE("power_diagram: a lattice of sites whose bisectors run along mesh edges and through mesh vertices") {
  std::vector<Vec3> lattice;
  for (int y = 0; y <= 6; ++y) {
    for (int x = 0; x <= 6; ++x) lattice.emplace_back(x, y, 0);
  }
  const Sites sites = sites_of(lattice);
  SUBCASE("mesh edges on bisectors") { check_everything(scaled(amps::make_square(12), 6), sites); }
  SUBCASE("mesh vertices at sites") { check_everything(scaled(amps::make_square(6), 6), sites); }
  SUBCASE("mesh vertices at the corners of cells only") {
    check_everything(scaled(amps::make_square(6), 6, {-0.5, -0.5, 0}), sites);
  }
  SUBCASE("two facets, the diagonal through sites and corners of cells") {
    check_everything(scaled(amps::make_square(1), 6), sites);
  }
  SUBCASE("the mesh above the lattice") { check_everything(scaled(amps::make_square(12), 6, {0, 0, 2}), sites); }
  SUBCASE("equal weights") {
    Sites weighted = sites;
    weighted.weights = constant_values(weighted.size(), 0.7);
    check_everything(scaled(amps::make_square(12), 6), weighted);
  }
  SUBCASE("weights of a checkerboard") {
    Sites weighted = sites;
    for (Index s = 0; s < sites.size(); ++s) weighted.weights[s] = s % 2 * 0.5;
    check_everything(scaled(amps::make_square(24), 6), weighted);
  }
  SUBCASE("weights that hide every other site exactly") {
    // Every other site of a row is on the lower hull of its neighbours: power cells of width zero.
    Sites weighted = sites;
    for (Index s = 0; s < sites.size(); ++s) weighted.weights[s] = s % 2 == 1 ? 1.0 : 0.0;
    check_everything(scaled(amps::make_square(12), 6), weighted);
  }
}

TEST_CASE("power_diagram: grids of sites in space, meshes in their planes of symmetry") {
  std::vector<Vec3> grid;
  for (int z = 0; z < 4; ++z) {
    for (int y = 0; y < 4; ++y) {
      for (int x = 0; x < 4; ++x) grid.emplace_back(x, y, z);
    }
  }
  const Sites sites = sites_of(grid);
  SUBCASE("facets through sites") { check_everything(scaled(amps::make_cube(3), 3), sites); }
  SUBCASE("facets in bisectors") { check_everything(scaled(amps::make_cube(2), 2, {0.5, 0.5, 0.5}), sites); }
  SUBCASE("facets in bisectors, cut at quarters") { check_everything(scaled(amps::make_cube(4), 2, {0.5, 0.5, 0.5}), sites); }
  SUBCASE("slanted facets through many ties") {
    check_everything(mesh_of({{0, 0, 0}, {3, 0, 3}, {0, 3, 3}, {3, 3, 0}}, {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 3, 2}}),
                     sites);
  }
}

TEST_CASE("power_diagram: a facet within a bisector belongs to the lexicographically smaller site") {
  const Mesh mesh = amps::make_square(2);
  std::vector<Vec3> mirrored;
  for (const Vec3& p : {Vec3(0.25, 0.25, 0.5), Vec3(0.75, 0.5, 0.25), Vec3(0.5, 0.875, 0.125)}) {
    mirrored.push_back(p);
    mirrored.emplace_back(p.x(), p.y(), -p.z());
  }
  const Sites sites = sites_of(mirrored);
  check_everything(mesh, sites);
  const Diagram diagram(mesh, sites.positions, sites.weights);
  const std::vector<double> areas = diagram.cell_areas();
  for (std::size_t s = 0; s < areas.size(); s += 2) {
    CHECK(areas[s] == 0);
    CHECK(areas[s + 1] > 0.05);
  }
}

TEST_CASE("power_diagram: cospherical sites, all at one distance from a mesh vertex") {
  for (const int n : {9, 14, 50}) {
    CAPTURE(n);
    const WeightedPoints points = integer_sphere(n);
    REQUIRE(points.size() >= 30);
    const Sites sites = sites_of(points);
    check_everything(scaled(amps::make_cube(2), 8, {-4, -4, -4}), sites);
    // Facets that meet at the common centre.
    const Mesh fan = mesh_of({{0, 0, 0}, {9, 0, 0}, {0, 9, 0}, {0, 0, 9}, {-9, -9, 0}, {0, -9, -9}},
                             {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {0, 4, 5}, {4, 0, 2}, {1, 5, 0}});
    check_everything(fan, sites);
    // The lightest site at the centre that is not seen: its power there equals the others'.
    const Sites with_centre = joined(sites, sites_of(WeightedPoints{{0, 0, 0, double(-n)}}));
    check_everything(fan, with_centre);
  }
}

TEST_CASE("power_diagram: sites at the vertices of the mesh") {
  for (const auto& model : small_meshes()) {
    const auto& [name, mesh] = model;
    if (mesh.vertices.rows() > 120) continue;
    CAPTURE(model.name);
    check_everything(mesh, sites_of(mesh.vertices));
    check_everything(mesh, sites_of(mesh.vertices, 0.25));
  }
}

TEST_CASE("power_diagram: small integers everywhere, where ties are the rule") {
  Rng rng(41);
  const auto coordinate = [&rng](int n) { return static_cast<double>(rng.below(static_cast<std::uint64_t>(n))); };
  for (int round = 0; round < 60; ++round) {
    CAPTURE(round);
    const int range = 3 + round % 3;
    std::vector<Vec3> vertices, points;
    std::vector<std::array<Index, 3>> triangles;
    for (int v = 0; v < 12; ++v) vertices.emplace_back(coordinate(range), coordinate(range), round % 2 * coordinate(range));
    for (int f = 0; f < 12; ++f) {
      triangles.push_back(
          {static_cast<Index>(rng.below(12)), static_cast<Index>(rng.below(12)), static_cast<Index>(rng.below(12))});
    }
    const Mesh mesh = mesh_of(vertices, triangles);
    if (!(amps::total_area(mesh) > 0)) continue;
    for (int s = 0; s < 25; ++s) points.emplace_back(coordinate(range), coordinate(range), round % 4 / 2 * coordinate(range));
    Sites sites = sites_of(points);
    if (round % 5 == 0) {
      for (Index s = 0; s < sites.size(); ++s) sites.weights[s] = coordinate(3);
    }
    check_everything(mesh, sites);
  }
}

TEST_CASE("power_diagram: thousands of insertions give the diagram of construction at once") {
  const std::vector<NamedMesh> meshes = {{"square", amps::make_square(1)},
                                         {"sphere", amps::make_sphere(1280)},
                                         {"knot", small_knot()},
                                         {"soup", random_soup(60, 51)},
                                         {"book of 5 pages", open_book(5)}};
  for (const auto& model : meshes) {
    CAPTURE(model.name);
    const auto& [name, mesh] = model;
    const Index n = 2500;
    const double spacing2 = amps::total_area(mesh) / n;
    for (const double weight : {0.0, 0.3, 6.0}) {
      CAPTURE(weight);
      const Sites sites = random_sites(mesh, n, weight * spacing2, 52);
      const Diagram at_once(mesh, sites.positions, sites.weights);
      if (weight > 1) CHECK(count_hidden(at_once) > n / 10);
      const Diagram grown = inserted_one_by_one(mesh, sites, weight == 0.3 ? 500 : 1);
      CHECK(same_diagram(at_once, grown));
      CHECK(broken_law(mesh, grown) == "");
      CHECK(grown.dual_triangles().rows() == at_once.dual_triangles().rows());
    }
  }
}

TEST_CASE("power_diagram: heavier and heavier sites hide all before them") {
  const Mesh mesh = amps::make_sphere(320);
  Sites sites = random_sites(mesh, 60, 0, 61);
  for (Index s = 0; s < 60; ++s) sites.weights[s] = s < 50 ? 0.1 * s : 5.0 * s;
  const Diagram grown = inserted_one_by_one(mesh, sites);
  CHECK(same_diagram(grown, {mesh, sites.positions, sites.weights}));
  CHECK(broken_law(mesh, grown) == "");
  // Far more than any distance: the last one owns everything.
  sites.weights[59] = 1e4;
  const Diagram last = inserted_one_by_one(mesh, sites);
  CHECK(last.num_fragments() == 320);
  CHECK(last.cell_areas()[59] == doctest::Approx(amps::total_area(mesh)));
  CHECK(same_diagram(last, {mesh, sites.positions, sites.weights}));
}

TEST_CASE("power_diagram: changed() lists exactly the fragments that an insertion touched") {
  const Mesh mesh = amps::make_sphere(320);
  const Sites sites = random_sites(mesh, 250, 0.3, 71);
  const Sites begin = head(sites, 5);
  Diagram diagram(mesh, begin.positions, begin.weights);
  Index hidden = 0;
  for (Index s = 5; s < sites.size(); ++s) {
    const auto before = snapshot(diagram);
    diagram.insert(sites.at(s), sites.weights[s]);
    const auto after = snapshot(diagram);
    std::set<Index> expected;
    for (const auto& [f, entry] : before) {
      if (after.count(f) == 0 || !(after.at(f).first == entry.first && after.at(f).second == entry.second)) expected.insert(f);
    }
    for (const auto& [f, entry] : after) {
      if (before.count(f) == 0) expected.insert(f);
    }
    const std::vector<Index>& changed = diagram.changed();
    CHECK(std::set<Index>(changed.begin(), changed.end()) == expected);
    CHECK(std::set<Index>(changed.begin(), changed.end()).size() == changed.size());
    hidden += !diagram.visible(s);
    if (!diagram.visible(s)) CHECK(changed.empty());
  }
  CHECK(hidden > 0);
}

namespace {

/// Slot by slot: polygons and their bits, bounds, and the order of all lists.
bool same_slots(const Diagram& one, const Diagram& other) {
  if (other.fragment_capacity() != one.fragment_capacity() || other.num_sites() != one.num_sites()) return false;
  for (Index f = 0; f < one.fragment_capacity(); ++f) {
    if (one.alive(f) != other.alive(f)) return false;
    if (!one.alive(f)) continue;
    const Diagram::Polygon p = one.polygon(f), q = other.polygon(f);
    std::vector<Vec3> corners_of_p, corners_of_q;
    p.list_corners(corners_of_p);
    q.list_corners(corners_of_q);
    if (p.facet != q.facet || p.site != q.site || p.size != q.size || !std::equal(p.labels, p.labels + p.size, q.labels) ||
        !std::equal(corners_of_p.begin(), corners_of_p.end(), corners_of_q.begin(),
                    [](const Vec3& x, const Vec3& y) { return same_bits(x, y); }) ||
        one.next_of_site(f) != other.next_of_site(f) || one.next_of_facet(f) != other.next_of_facet(f) ||
        one.reach(f) != other.reach(f)) {
      return false;
    }
  }
  for (Index s = 0; s < one.num_sites(); ++s) {
    if (one.first_of_site(s) != other.first_of_site(s)) return false;
  }
  for (Index facet = 0; facet < one.mesh().num_facets(); ++facet) {
    if (one.first_of_facet(facet) != other.first_of_facet(facet)) return false;
  }
  return true;
}

}  // namespace

TEST_CASE("power_diagram: any number of threads gives the same diagram, slot by slot") {
  const Mesh with_copies = [] {
    Mesh mesh = amps::make_torus(1.0, 0.4, 80, 40);
    for (Index f = 0; f < rows(mesh.triangles); f += 7) mesh.triangles.row(f) = mesh.triangles.row(0);
    return mesh;
  }();
  const NamedMesh meshes[] = {{"sphere", amps::make_sphere(20000)},
                              {"two facets", amps::make_square(1)},
                              {"soup", random_soup(300, 83)},
                              {"copies of a facet", with_copies}};
  for (const NamedMesh& model : meshes) {
    CAPTURE(model.name);
    for (const double weight : {1e-3, 0.1}) {
      const Sites sites = random_sites(model.mesh, 3000, weight, 81);
      const Diagram one(model.mesh, sites.positions, sites.weights, 1);
      for (const unsigned threads : {2u, 3u, 8u, 0u}) {
        CAPTURE(threads);
        const Diagram many(model.mesh, sites.positions, sites.weights, on_threads(threads));
        CHECK(same_slots(one, many));
        CHECK(one.dual_triangles() == many.dual_triangles());
      }
    }
  }
}

TEST_CASE("power_diagram: a copy is edited without the other, and ends as the other does after the same edits") {
  const Mesh mesh = amps::make_sphere(2000);
  const Sites sites = random_sites(mesh, 500, 1e-3, 84), pool = random_sites(mesh, 200, 1e-3, 85);
  Diagram diagram(mesh, sites.positions, sites.weights);
  const Diagram before(mesh, sites.positions, sites.weights);
  Diagram copy = diagram;
  const auto edit = [&](Diagram& edited) {
    for (Index k = 0; k < pool.size(); ++k) {
      if (k % 3 == 0) edited.remove(2 * k);
      edited.insert(pool.at(k), pool.weights[k]);
    }
  };
  edit(copy);
  CHECK(same_slots(diagram, before));
  CHECK(broken_law(mesh, copy) == "");
  edit(diagram);
  CHECK(same_slots(diagram, copy));
}

TEST_CASE("power_diagram: edits end in the same diagram, slot by slot, whatever number of threads made it") {
  const Mesh mesh = amps::make_sphere(6000);
  for (const double weight : {1e-4, 3e-3}) {  // the heavier ones hide some
    CAPTURE(weight);
    const Sites sites = random_sites(mesh, 9000, weight, 87), pool = random_sites(mesh, 400, 2 * weight, 88);
    const auto edited = [&](unsigned threads) {
      Diagram diagram(mesh, sites.positions, sites.weights, on_threads(threads));
      for (Index k = 0; k < pool.size(); ++k) {
        diagram.remove(20 * k);
        if (k % 2 == 0) diagram.insert(pool.at(k), pool.weights[k]);
        if (k % 5 == 0) diagram.reinsert(20 * k, pool.at(k), pool.weights[k]);
      }
      return diagram;
    };
    const Diagram one = edited(1);
    Index hidden = 0;
    for (Index k = 0; k < one.num_sites(); ++k) hidden += !one.removed(k) && !one.visible(k);
    CHECK((hidden > 100) == (weight > 1e-3));
    for (const unsigned threads : {2u, 3u}) {
      CAPTURE(threads);
      CHECK(same_slots(one, edited(threads)));
    }
  }
}

TEST_CASE("power_diagram: the filter of sides is right wherever it is sure, and it is sure of most") {
  Rng rng(86);
  int sure = 0, sure_near = 0;
  const auto random_vector = [&] { return Vec3(rng.uniform() - 0.5, rng.uniform() - 0.5, rng.uniform() - 0.5); };
  const int trials = 20000;
  for (int trial = 0; trial < trials; ++trial) {
    const double size = std::ldexp(1.0, static_cast<int>(below(rng, 40)) - 20);
    const Vec3 centre = rng.uniform() < 0.5 ? Vec3(Vec3::Zero()) : Vec3(1000 * size * random_vector());
    const auto site_near = [&] {
      const Vec3 x = centre + size * random_vector();
      return WeightedPoint{x.x(), x.y(), x.z(), size * size * 0.1 * rng.uniform()};
    };
    const WeightedPoint owner = site_near(), other = site_near();
    // A point of the bisector, but for rounding and a step across it of a size that varies much.
    const Vec3 d = other.position() - owner.position(), y = size * random_vector();
    const double to_bisector = ((d.squaredNorm() + owner.w - other.w) / 2 - d.dot(y)) / d.squaredNorm();
    const double step = trial % 2 == 0 ? 0.0 : std::ldexp(rng.uniform() - 0.5, -static_cast<int>(below(rng, 60)));
    const bool is_far = trial % 4 == 1;
    const Vec3 x = owner.position() + y + (is_far ? Vec3(size * random_vector()) : Vec3((to_bisector + step) * d));
    const double* const corners[3] = {x.data(), x.data(), x.data()};
    const int exact = amps::side_of_corner(corners, 0, amps::Bisector(owner, other, corners));
    const Vec3 relative = x - owner.position();
    const int side =
        amps::detail::RelativeFilter(owner.position(), owner.w, other, 0, relative.norm() * (1 + 1e-9)).side(relative);
    if (side != 0) REQUIRE(side == exact);
    sure += is_far && side != 0;
    sure_near += trial % 2 == 0 && side != 0;
  }
  CHECK(sure > trials / 4 * 99 / 100);
  CHECK(sure_near < trials / 4);  // the others are as good as on the bisector
}

TEST_CASE("power_diagram: dual triangles turn as their facet does and meet at a common power") {
  const Mesh mesh = with_random_flips(amps::make_torus(1.0, 0.4, 20, 10), 91);
  const Sites sites = random_sites(mesh, 300, 0.002, 92);
  const Diagram diagram(mesh, sites.positions, sites.weights);
  std::vector<Index> facets;
  const Triangles dual = diagram.dual_triangles(&facets);
  REQUIRE(facets.size() == static_cast<std::size_t>(dual.rows()));
  CHECK(dual.rows() > 200);
  for (Index t = 0; t < dual.rows(); ++t) {
    const Index i = dual(t, 0), j = dual(t, 1), k = dual(t, 2);
    CHECK((i < j && i < k && j != k));
    const Index facet = facets[static_cast<std::size_t>(t)];
    const Vec3 a = MeshView(mesh).corner(facet, 0);
    const Vec3 normal = (MeshView(mesh).corner(facet, 1) - a).cross(MeshView(mesh).corner(facet, 2) - a);
    CHECK((sites.at(j) - sites.at(i)).cross(sites.at(k) - sites.at(i)).dot(normal) > 0);
    // The dual vertex is the corner of the fragment of i between its neighbours.
    bool found = false;
    for (Index f = diagram.first_of_site(i); f != kNone; f = diagram.next_of_site(f)) {
      const Diagram::Polygon p = diagram.polygon(f);
      for (Index c = 0; c < p.size && p.facet == facet; ++c) {
        std::array<Index, 3> key = {i, j, k};
        std::sort(key.begin(), key.end());
        if (corner_key(p, c) != key) continue;
        found = true;
        const auto power = [&](Index s) { return (p.corners[c] - sites.at(s)).squaredNorm() - sites.weights[s]; };
        CHECK(power(j) == doctest::Approx(power(i)).epsilon(1e-9));
        CHECK(power(k) == doctest::Approx(power(i)).epsilon(1e-9));
      }
    }
    CHECK(found);
  }
}

TEST_CASE("power_diagram: facets without area are skipped, isolated vertices do not matter") {
  const Mesh square = amps::make_square(2);
  const Index facets = rows(square.triangles);
  // A repeated index, a point, and two lines of three vertices.
  const Mesh mesh = with_vertices(with_facets(square, {{0, 0, 1}, {4, 4, 4}, {0, 1, 2}, {0, 4, 8}}), {{1e3, -1e3, 1e3}});
  const Sites sites = random_sites(amps::make_square(2), 30, 0.01, 101);
  check_everything(mesh, sites);
  const Diagram diagram(mesh, sites.positions, sites.weights);
  for (Index f = facets; f < facets + 4; ++f) CHECK(diagram.first_of_facet(f) == kNone);
}

TEST_CASE("power_diagram: needles and caps") {
  std::vector<Vec3> vertices;
  std::vector<std::array<Index, 3>> triangles;
  Rng rng(111);
  for (int f = 0; f < 40; ++f) {
    const double thin = std::pow(10.0, -1.0 - 0.35 * f);
    const Vec3 a(rng.uniform(), rng.uniform(), rng.uniform()), b(rng.uniform(), rng.uniform(), rng.uniform());
    const Index v = static_cast<Index>(vertices.size());
    vertices.insert(vertices.end(),
                    {a, b, (f % 2 == 0 ? (a + b) / 2 : a) + thin * Vec3(rng.uniform(), rng.uniform(), rng.uniform())});
    triangles.push_back({v, v + 1, v + 2});
  }
  const Mesh mesh = mesh_of(vertices, triangles);
  const Sites sites = random_sites(mesh, 80, 0.01, 112, 0.3);
  const Diagram diagram(mesh, sites.positions, sites.weights);
  CHECK(broken_law(mesh, diagram) == "");
  // A facet 1 long and 1e-15 wide: its corners are as good as doubles are, its area is not.
  CHECK(worst_area_error(mesh, sites, diagram) <= 1e-9);
  CHECK(same_diagram(diagram, inserted_one_by_one(mesh, sites)));
}

TEST_CASE("power_diagram: far from the origin") {
  for (const double far : {1e6, 1e9}) {
    CAPTURE(far);
    const Mesh mesh = scaled(amps::make_sphere(320), 1.0, {far, -far, 0.3 * far});
    const Sites sites = random_sites(mesh, 50, 0.01, 121);
    const Diagram diagram(mesh, sites.positions, sites.weights);
    CHECK(broken_law(mesh, diagram) == "");
    // Corners are doubles near `far`: that is what the areas can be good to. The structure is exact.
    CHECK(worst_area_error(mesh, sites, diagram) <= 1e-15 * far * 100);
    CHECK(same_diagram(diagram, inserted_one_by_one(mesh, sites)));
  }
}

TEST_CASE("power_diagram: scaling by a power of two changes no label") {
  const Mesh mesh = amps::make_torus(1.0, 0.4, 14, 8);
  const Sites sites = random_sites(mesh, 150, 0.01, 131);
  const Diagram original(mesh, sites.positions, sites.weights);
  const CanonicalDiagram expected = canonical(original);
  const std::vector<double> areas = original.cell_areas();
  for (const int exponent : {-332, -100, -30, 1, 30, 100, 332}) {  // 2^332 ≈ 1e100
    CAPTURE(exponent);
    const double factor = std::ldexp(1.0, exponent);
    const Mesh big = scaled(mesh, factor);
    const Sites far_apart = scaled(sites, factor);
    const Diagram diagram(big, far_apart.positions, far_apart.weights);
    const CanonicalDiagram found = canonical(diagram);
    REQUIRE(found.size() == expected.size());
    bool same_labels = true;
    double worst = 0;
    for (auto a = expected.begin(), b = found.begin(); a != expected.end(); ++a, ++b) {
      same_labels = same_labels && a->first == b->first && a->second.labels == b->second.labels;
      if (!same_labels) break;
      for (std::size_t k = 0; k < a->second.corners.size(); ++k) {
        for (std::size_t c = 0; c < 3; ++c) {
          worst = std::max(worst, std::fabs(a->second.corners[k][c] - b->second.corners[k][c] / factor));
        }
      }
    }
    CHECK(same_labels);
    CHECK(worst <= 1e-14);
    CHECK(diagram.check() == "");
    CHECK(same_diagram(diagram, inserted_one_by_one(big, far_apart)));
    const std::vector<double> scaled_areas = diagram.cell_areas();
    for (std::size_t s = 0; s < areas.size(); ++s) {
      CHECK(scaled_areas[s] / factor / factor == doctest::Approx(areas[s]).epsilon(1e-12));
    }
  }
}

TEST_CASE("power_diagram: sites far away from the mesh, and one site alone") {
  const Mesh mesh = amps::make_sphere(80);
  Sites sites = random_sites(mesh, 20, 0, 141);
  sites.positions = moved(sites.positions, {1e4, 0, 0});
  const Diagram diagram(mesh, sites.positions, sites.weights);
  CHECK(broken_law(mesh, diagram) == "");
  CHECK(worst_area_error(mesh, sites, diagram) <= 1e-9);

  Diagram alone(mesh, constant_points(1, 0), constant_values(1, 0));
  CHECK(alone.num_fragments() == mesh.triangles.rows());
  CHECK(broken_law(mesh, alone) == "");
  CHECK(alone.dual_triangles().rows() == 0);
  // Sites far outside of what it was made for.
  for (const Vec3& x : {Vec3(1e5, 0, 0), Vec3(-1e3, 1e3, 0), Vec3(0, 0.1, 0)}) alone.insert(x, 0);
  alone.insert(Vec3(50, 0, 0), 2500);  // its ball touches the middle of the sphere
  REQUIRE(alone.num_sites() == 5);
  const Sites all = sites_of(WeightedPoints{{0, 0, 0, 0}, {1e5, 0, 0, 0}, {-1e3, 1e3, 0, 0}, {0, 0.1, 0, 0}, {50, 0, 0, 2500}});
  CHECK(broken_law(mesh, alone) == "");
  CHECK(worst_area_error(mesh, all, alone) <= 1e-11);
  CHECK(alone.cell_areas()[4] > 1);
}

TEST_CASE("power_diagram: errors say what is wrong, and an insertion that fails changes nothing") {
  const Mesh mesh = amps::make_sphere(80);
  const Sites sites = random_sites(mesh, 20, 0, 151);
  const auto make = [](const Mesh& m, const Points& p, const Values& w) { return Diagram(m, p, w); };
  CHECK(error_of([&] { make(mesh, no_points(), values_of({})); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { make(mesh, sites.positions, head(sites.weights, 19)); }) == ErrorCode::kInvalidArgument);
  for (const double bad : {kNaN, kInfinity, -kInfinity}) {
    Points positions = sites.positions;
    positions(7, 1) = bad;
    CHECK(error_of([&] { make(mesh, positions, sites.weights); }) == ErrorCode::kInvalidArgument);
    Values weights = sites.weights;
    weights[7] = bad;
    CHECK(error_of([&] { make(mesh, sites.positions, weights); }) == ErrorCode::kInvalidArgument);
    Mesh broken = mesh;
    broken.vertices(3, 2) = bad;
    CHECK(error_of([&] { make(broken, sites.positions, sites.weights); }) == ErrorCode::kInvalidMesh);
  }
  Mesh out_of_range = mesh;
  out_of_range.triangles(5, 1) = static_cast<Index>(mesh.vertices.rows());
  CHECK(error_of([&] { make(out_of_range, sites.positions, sites.weights); }) == ErrorCode::kInvalidMesh);
  CHECK(error_of([&] { make(Mesh{}, sites.positions, sites.weights); }) == ErrorCode::kInvalidMesh);
  CHECK(error_of([&] { make(squashed(mesh), sites.positions, sites.weights); }) == ErrorCode::kInvalidMesh);

  Diagram diagram(mesh, sites.positions, sites.weights);
  const CanonicalDiagram before = canonical(diagram);
  CHECK(error_of([&] { diagram.insert({kNaN, 0, 0}, 0); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { diagram.insert({0, 0, 0}, kInfinity); }) == ErrorCode::kInvalidArgument);
  CHECK(diagram.num_sites() == 20);
  CHECK(canonical(diagram) == before);
  CHECK(broken_law(mesh, diagram) == "");
  CHECK(diagram.insert({0, 0, 0.9}, 0) == 20);
  CHECK(broken_law(mesh, diagram) == "");
}

TEST_CASE("power_diagram: the laws notice a diagram of another mesh") {
  // The oracle itself: it must fail where it should.
  const Mesh mesh = amps::make_sphere(80), other = scaled(mesh, 1.0, {0, 0, 1e-6});
  const Sites sites = random_sites(mesh, 20, 0, 161), moved = random_sites(mesh, 20, 0, 162);
  const Diagram diagram(mesh, sites.positions, sites.weights);
  CHECK(broken_law(other, diagram) != "");
  CHECK(worst_area_error(mesh, moved, diagram) > 1e-3);
  CHECK(!same_diagram(diagram, {mesh, moved.positions, moved.weights}));
}

TEST_SUITE("slow") {
  TEST_CASE("power_diagram: tens of thousands of insertions on fine meshes give the diagram of construction at once") {
    const std::vector<NamedMesh> meshes = {{"sphere", amps::make_sphere(20000)},
                                           {"knot", amps::make_knot()},
                                           {"square", amps::make_square(1)},
                                           {"torus with flipped facets", with_random_flips(amps::make_torus(), 171)}};
    for (const auto& model : meshes) {
      CAPTURE(model.name);
      const auto& [name, mesh] = model;
      const Index n = 20000;
      for (const double weight : {0.0, 0.5, 4.0}) {
        CAPTURE(weight);
        const Sites sites = random_sites(mesh, n, weight * amps::total_area(mesh) / n, 172);
        const Diagram at_once(mesh, sites.positions, sites.weights, 2);
        CHECK(broken_law(mesh, at_once) == "");
        CHECK(same_diagram(at_once, inserted_one_by_one(mesh, sites, 100)));
      }
    }
  }

  TEST_CASE("power_diagram: large lattices on the square") {
    for (const int n : {40, 64}) {
      CAPTURE(n);
      std::vector<Vec3> lattice;
      for (int y = 0; y <= n; ++y) {
        for (int x = 0; x <= n; ++x) lattice.emplace_back(x, y, 0);
      }
      const Sites sites = sites_of(lattice);
      for (const Index cells : {1, n, 2 * n}) {
        CAPTURE(cells);
        const Mesh mesh = scaled(amps::make_square(cells), n);
        const Diagram diagram(mesh, sites.positions, sites.weights);
        CHECK(broken_law(mesh, diagram) == "");
        const std::vector<double> areas = diagram.cell_areas();
        for (Index s = 0; s < sites.size(); ++s) {
          const auto half = [n](double x) { return x == 0 || x == n ? 0.5 : 1.0; };
          CHECK(areas[static_cast<std::size_t>(s)] ==
                doctest::Approx(half(sites.at(s).x()) * half(sites.at(s).y())).epsilon(1e-12));
        }
        CHECK(same_diagram(diagram, inserted_one_by_one(mesh, sites)));
      }
    }
  }
}

}  // namespace amps_test
