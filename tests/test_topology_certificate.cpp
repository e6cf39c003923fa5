#include "amps/topology_certificate.h"

#include "kit/basics.h"
#include "kit/data.h"
#include "kit/diagrams.h"
#include "kit/meshes.h"
#include "kit/random.h"
#include "kit/samples.h"
#include "kit/topology.h"

#include "amps/gap_filling.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {
namespace {

using Kind = TopologyFailureKind;

SampleSet maximal_set(const Mesh& mesh, double radius, Neighborhood neighborhood, std::uint64_t seed = 1) {
  SamplingOptions options = with_radius(radius, seed);
  options.neighborhood = neighborhood;
  return amps::sample(mesh, options).samples;
}

/// Random points, with disks that cover the box.
SampleSet random_set(const Mesh& mesh, Index n, Rng& rng, double weight_range = 0) {
  const SurfaceDraw draw(mesh);
  const double radius = 2 * amps::bounding_box(mesh).diagonal();
  amps::detail::GrowingSet set;
  for (Index s = 0; s < n; ++s) set.add({draw(rng), radius * (1 + weight_range * rng.uniform())});
  return set.finish();
}

struct Tally {
  int holds = 0, fails_rightly = 0, fails_needlessly = 0;
};

/// Where it holds, the dual has the topology of the surface.
void check_law(const Certified& certified, Tally& tally) {
  const TopologyCertificate certificate = certified.certificate();
  const Invariants surface = invariants_of_surface(certified.mesh), dual = invariants_of(dual_of(certified));
  if (certificate.holds()) {
    CHECK(dual == surface);
    CHECK(amps::topology(dual_of(certified)).vertices == certificate.cells);
    ++tally.holds;
  } else {
    ++(dual == surface ? tally.fails_needlessly : tally.fails_rightly);
  }
}

bool fails(const TopologyCertificate& certificate, Kind kind) { return certificate.num_failures(kind) > 0; }

Mesh thin_plate(double thickness, Index cells) {
  return transformed(amps::make_cube(cells), [&](const Vec3& x) { return Vec3(x.x(), x.y(), thickness * x.z()); });
}

/// An open sheet, bent so that one half lies `gap` above the other.
Mesh folded_sheet(double gap, Index cells) {
  return transformed(amps::make_square(cells), [&](const Vec3& x) {
    const double bend = 0.5 * kPi * gap, half = 0.5 - bend / 2, s = x.x();
    if (s < half) return Vec3(s, x.y(), 0);
    if (s > half + bend) return Vec3(half - (s - half - bend), x.y(), gap);
    const double t = (s - half) / bend * kPi;
    return Vec3(half + gap / 2 * std::sin(t), x.y(), gap / 2 * (1 - std::cos(t)));
  });
}

Mesh open_tube(Index around, Index along, double radius) {
  std::vector<Vec3> vertices;
  std::vector<Corners> triangles;
  for (Index i = 0; i <= along; ++i) {
    for (Index j = 0; j < around; ++j) {
      const double t = 2 * kPi * j / around;
      vertices.emplace_back(radius * std::cos(t), radius * std::sin(t), static_cast<double>(i) / along);
      if (i == along) continue;
      const Index a = i * around + j, b = i * around + (j + 1) % around;
      triangles.push_back({a, b, b + around});
      triangles.push_back({a, b + around, a + around});
    }
  }
  return mesh_of(vertices, triangles);
}

/// A tube with a page along one of its lines, around the z axis.
Mesh tube_with_page(Index around, Index along, double radius, double width) {
  const auto beside = [&](const Vec3& x) { return Vec3(radius + width * x.x(), 0, x.y()); };
  const Mesh page = transformed(amps::make_square(along), beside);
  return amps::merge_equal_vertices(joined(open_tube(around, along, radius), page));
}

/// One-sided and closed; facets pass through each other.
Mesh projective_plane() {
  return mesh_of(
      {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-1, 0.2, 0.1}, {0.1, -1, 0.3}, {0.3, 0.1, -1}},
      {{0, 1, 4}, {0, 4, 2}, {0, 2, 3}, {0, 3, 5}, {0, 5, 1}, {1, 2, 5}, {1, 2, 3}, {1, 3, 4}, {2, 4, 5}, {3, 4, 5}});
}

std::vector<NamedMesh> law_meshes() {
  Mesh many = amps::make_sphere(80, 0.3);
  for (int k = 1; k < 6; ++k) many = joined(many, moved(amps::make_sphere(80, 0.1 + 0.05 * k), {0.8 * k, 0, 0}));
  return {{"sphere", amps::make_sphere(320)},
          {"torus", amps::make_torus(1.0, 0.4, 24, 12)},
          {"thin torus", amps::make_torus(1.0, 0.08, 48, 8)},
          {"cube", amps::make_cube(3)},
          {"plate", thin_plate(0.03, 4)},
          {"square", amps::make_square(4)},
          {"strip", transformed(amps::make_square(6), [](const Vec3& x) { return Vec3(x.x(), 0.1 * x.y(), 0); })},
          {"folded sheet", folded_sheet(0.05, 24)},
          {"tube", open_tube(9, 5, 0.15)},
          {"moebius strip", moebius_strip(24, 3)},
          {"many components", many},
          {"two sheets", two_sheets(0.02, 3)},
          {"projective plane", projective_plane()},
          {"book of 3 pages", open_book(3)},
          {"book of 5 pages", open_book(5)},
          {"tube with a page", tube_with_page(9, 6, 0.1, 0.4)},
          {"knot", small_knot()},
          {"soup", random_soup(30, 5)}};
}

TEST_CASE("topology_certificate: where it holds, the dual has the topology of the surface: maximal sets") {
  Tally all;
  for (const NamedMesh& model : law_meshes()) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    CAPTURE(name);
    const double size = amps::bounding_box(mesh).diagonal();
    for (const Neighborhood neighborhood : {Neighborhood::kSpace, Neighborhood::kSurface}) {
      Tally tally;
      for (const double share : {0.4, 0.2, 0.1, 0.05}) {
        for (std::uint64_t seed = 1; seed <= 3; ++seed) {
          CAPTURE(share);
          CAPTURE(seed);
          check_law(Certified(mesh, maximal_set(mesh, share * size, neighborhood, seed), neighborhood), tally);
        }
      }
      MESSAGE(name << std::string(neighborhood == Neighborhood::kSpace ? ", balls" : "") << ": holds " << tally.holds
                   << ", fails rightly " << tally.fails_rightly << ", fails needlessly " << tally.fails_needlessly);
      all.holds += tally.holds;
      all.fails_rightly += tally.fails_rightly;
    }
  }
  CHECK(all.holds > 40);
  CHECK(all.fails_rightly > 40);
}

TEST_CASE("topology_certificate: where it holds, the dual has the topology of the surface: random sites") {
  Rng rng(7);
  for (const NamedMesh& model : law_meshes()) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    CAPTURE(name);
    Tally tally;
    for (const Index n : {1, 2, 3, 4, 5, 6, 8, 12, 20, 40, 100, 300}) {
      for (int round = 0; round < 8; ++round) {
        CAPTURE(n);
        CAPTURE(round);
        const Neighborhood neighborhood = round % 2 == 0 ? Neighborhood::kSpace : Neighborhood::kSurface;
        check_law(Certified(mesh, random_set(mesh, n, rng, round < 4 ? 0 : 0.002), neighborhood), tally);
      }
    }
    MESSAGE(name << ": holds " << tally.holds << ", fails rightly " << tally.fails_rightly << ", fails needlessly "
                 << tally.fails_needlessly);
  }
}

/// Some squares of a grid, a few of them halved: edges of one to four squares, vertices of several fans.
Mesh random_squares(Rng& rng, Index size) {
  const double share = rng.uniform();
  std::vector<std::array<Vec3, 3>> facets;
  for (int a = 0; a < 3; ++a) {
    const Vec3 u = Vec3::Unit((a + 1) % 3), v = Vec3::Unit((a + 2) % 3);
    for (Index i = 0; i <= size; ++i) {
      for (Index j = 0; j < size; ++j) {
        for (Index k = 0; k < size; ++k) {
          if (!facets.empty() && rng.uniform() > share) continue;
          const Vec3 corner = i * Vec3::Unit(a) + j * u + k * v;
          facets.push_back({corner, corner + u, corner + u + v});
          if (rng.uniform() < 0.85) facets.push_back({corner, corner + u + v, corner + v});
        }
      }
    }
  }
  return amps::merge_equal_vertices(soup_mesh(facets));
}

TEST_CASE("topology_certificate: where it holds, the dual has the topology of the surface: squares of a grid, cut at random") {
  Rng rng(17);
  Tally tally;
  for (int round = 0; round < 4000; ++round) {
    CAPTURE(round);
    const Mesh mesh = random_squares(rng, 1 + below(rng, 2));
    std::vector<char> cut;
    if (rng.uniform() < 0.6) {
      const double share = rng.uniform();
      cut.resize(amps::detail::SurfaceEdges(mesh).size());
      for (char& flag : cut) flag = rng.uniform() < share;
    }
    const double radius = 2 * amps::bounding_box(mesh).diagonal();
    const double at_vertices = rng.uniform() < 0.5 ? 0 : rng.uniform(), on_edges = rng.uniform() < 0.5 ? 0 : rng.uniform();
    const Index n = 1 + below(rng, rng.uniform() < 0.5 ? 12 : 150);
    const SurfaceDraw draw(mesh);
    std::set<std::array<double, 3>> sampled, sampled_vertices;
    amps::detail::GrowingSet set;
    for (Index s = 0; s < n; ++s) {
      amps::SurfacePoint at = draw(rng);
      const int k = below(rng, 3);
      const bool vertex = rng.uniform() < at_vertices;
      if (vertex) {
        at = amps::detail::surface_point_at(mesh, at.facet, Vec3::Unit(k));
      } else if (rng.uniform() < on_edges) {
        const double t = rng.uniform();
        at = amps::detail::surface_point_at(mesh, at.facet, t * Vec3::Unit(k) + (1 - t) * Vec3::Unit((k + 1) % 3));
      }
      const std::array<double, 3> place = {at.position[0], at.position[1], at.position[2]};
      if (!sampled.insert(place).second) continue;
      if (vertex) sampled_vertices.insert(place);
      set.add({at, radius});
    }
    const Neighborhood neighborhood = rng.uniform() < 0.5 ? Neighborhood::kSpace : Neighborhood::kSurface;
    const Certified certified(mesh, set.finish(), neighborhood, cut);
    const TopologyCertificate certificate = certified.certificate();
    if (certificate.holds()) CHECK(invariants_of(dual_of(certified)) == invariants_of_surface(mesh, sampled_vertices));
    ++(certificate.holds() ? tally.holds : tally.fails_rightly);
  }
  MESSAGE("holds " << tally.holds << ", fails " << tally.fails_rightly);
  CHECK(tally.holds > 100);
}

TEST_CASE("topology_certificate: a cell with both ends of a spine makes it a point of the dual") {
  Rng rng(13);
  Tally tally;
  for (int round = 0; round < 600; ++round) {
    CAPTURE(round);
    const Mesh mesh = open_book(3 + below(rng, 3));
    check_law(Certified(mesh, random_set(mesh, 2 + below(rng, 40), rng), Neighborhood::kSpace), tally);
  }
  // One cell has all of the spine, and no cell has two parts of its border.
  const Mesh book = transformed(open_book(3), [](const Vec3& x) { return Vec3(x.x(), x.y(), 0.2 * x.z()); });
  const MeshView view(book);
  std::vector<Vec3> sites = {{0, 0, 0.1}};
  for (Index v = 2; v < view.num_vertices(); ++v) sites.emplace_back(0.6 * view.vertices[v]);
  SampleSet set;
  set.positions = points_of(sites);
  set.radii.assign(sites.size(), 4);
  CHECK(fails(Certified(book, set, Neighborhood::kSpace).certificate(), Kind::kCurve));
}

TEST_CASE("topology_certificate: it says what is wrong") {
  Rng rng(3);
  const auto certificate_of = [&](const Mesh& mesh, Index n) {
    return Certified(mesh, random_set(mesh, n, rng), Neighborhood::kSpace).certificate();
  };
  SUBCASE("a cell that is a whole surface has no boundary") {
    CHECK(fails(certificate_of(amps::make_sphere(80), 1), Kind::kNotADisk));
    CHECK(fails(certificate_of(amps::make_torus(1.0, 0.4, 14, 8), 1), Kind::kNotADisk));
    CHECK(invariants_of(projective_plane()).euler == 1);
    CHECK(amps::topology(projective_plane()).closed());
    CHECK(fails(certificate_of(projective_plane(), 1), Kind::kNotADisk));
  }
  SUBCASE("the border of a sheet in one cell") {
    const TopologyCertificate certificate = certificate_of(amps::make_square(3), 1);
    CHECK(certificate.failures.size() == 1);
    CHECK(fails(certificate, Kind::kCurve));
  }
  SUBCASE("two cells share a circle, three meet twice") {
    CHECK(fails(certificate_of(amps::make_sphere(80), 2), Kind::kSharedEdge));
    CHECK(fails(certificate_of(amps::make_sphere(80), 3), Kind::kTriple));
  }
  SUBCASE("cells in pieces") {
    const TopologyCertificate certificate = certificate_of(two_sheets(0.01), 50);
    CHECK(fails(certificate, Kind::kPieces));
  }
  SUBCASE("a strip one cell wide") {
    const Mesh strip = transformed(amps::make_square(4), [](const Vec3& x) { return Vec3(x.x(), 0.01 * x.y(), 0); });
    const TopologyCertificate certificate = certificate_of(strip, 8);
    CHECK(fails(certificate, Kind::kCurve));
    CHECK(fails(certificate, Kind::kEdgeAtCurves));
  }
  SUBCASE("annuli") {
    const Mesh tube = open_tube(9, 12, 0.02);
    const TopologyCertificate certificate = certificate_of(tube, 6);
    CHECK(fails(certificate, Kind::kNotADisk));
    CHECK(fails(certificate, Kind::kSharedEdge));
  }
  SUBCASE("gaps, and a facet that nobody reaches") {
    const Mesh mesh = joined(amps::make_square(2), moved(amps::make_square(2), {0, 0, 0.01}));
    SampleSet set = maximal_set(amps::make_square(2), 0.2, Neighborhood::kSpace);
    const TopologyCertificate certificate = Certified(mesh, set, Neighborhood::kSurface).certificate();
    CHECK(certificate.num_failures(Kind::kUncovered) == 8);
    for (const auto& failure : certificate.failures) CHECK(failure.facet >= 8);
    CHECK_FALSE(fails(Certified(amps::make_square(2), set, Neighborhood::kSurface).certificate(), Kind::kUncovered));
    for (double& radius : set.radii) radius *= 0.7;
    CHECK(fails(Certified(amps::make_square(2), set, Neighborhood::kSurface).certificate(), Kind::kUncovered));
  }
  SUBCASE("in words") {
    std::ostringstream out;
    out << certificate_of(amps::make_sphere(80), 2);
    CHECK(out.str() ==
          "topology of 2 cells: 1 failures (1 shared edge that is not one path); the first: what the cells of samples 0 and 1 "
          "share is not one path (facet 0)");
  }
}

// An oracle: cells as explicit complexes, glued by the positions of their corners.

/// Of the cell of a site, corners nearer than `tolerance` being one.
struct CellShape {
  Index pieces = 0, euler = 0;
};
CellShape shape_of_cell(const Diagram& diagram, Index s, double tolerance) {
  std::vector<Vec3> points;
  const auto point = [&](const Vec3& x) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      if ((points[i] - x).norm() < tolerance) return i;
    }
    points.push_back(x);
    return points.size() - 1;
  };
  std::set<std::pair<std::size_t, std::size_t>> edges;
  Index faces = 0;
  std::vector<std::vector<std::size_t>> cycles;
  for (Index f = diagram.first_of_site(s); f != kNone; f = diagram.next_of_site(f)) {
    const auto p = diagram.polygon(f);
    std::vector<std::size_t> cycle;
    for (Index k = 0; k < p.size; ++k) cycle.push_back(point(p.corners[k]));
    for (std::size_t k = 0; k < cycle.size(); ++k) edges.insert(std::minmax(cycle[k], cycle[(k + 1) % cycle.size()]));
    cycles.push_back(cycle);
    ++faces;
  }
  std::vector<std::size_t> component(points.size());
  for (std::size_t i = 0; i < component.size(); ++i) component[i] = i;
  for (bool changed = true; changed;) {
    changed = false;
    for (const auto& [a, b] : edges) {
      const std::size_t least = std::min(component[a], component[b]);
      changed = changed || component[a] != least || component[b] != least;
      component[a] = component[b] = least;
    }
  }
  CellShape shape;
  for (std::size_t i = 0; i < component.size(); ++i) shape.pieces += component[i] == i ? 1 : 0;
  shape.euler = static_cast<Index>(points.size()) - static_cast<Index>(edges.size()) + faces;
  return shape;
}

TEST_CASE("topology_certificate: pieces and disks are those of the cells as complexes of points") {
  Rng rng(11);
  int disks = 0, others = 0;
  for (const NamedMesh& model : std::vector<NamedMesh>{{"sphere", amps::make_sphere(180)},
                                                       {"torus", amps::make_torus(1.0, 0.1, 20, 7)},
                                                       {"knot", small_knot()},
                                                       {"plate", thin_plate(0.05, 3)},
                                                       {"tube", open_tube(7, 5, 0.1)}}) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    CAPTURE(name);
    for (const Index n : {1, 3, 8, 25, 80}) {
      CAPTURE(n);
      const Certified certified(mesh, random_set(mesh, n, rng), Neighborhood::kSpace);
      const TopologyCertificate certificate = certified.certificate();
      for (Index s = 0; s < n; ++s) {
        CAPTURE(s);
        const CellShape shape = shape_of_cell(*certified.diagram, s, 1e-9);
        bool in_pieces = false, no_disk = false, closed = n == 1 && name != "tube";
        for (const auto& failure : certificate.failures) {
          if (failure.sample != s) continue;
          in_pieces = in_pieces || failure.kind == Kind::kPieces;
          no_disk = no_disk || failure.kind == Kind::kNotADisk;
        }
        // On the tube the border may add what the shape alone does not tell.
        if (name != "tube") CHECK(in_pieces == (shape.pieces != 1));
        if (shape.pieces == 1) CHECK(no_disk == (shape.euler != 1 || closed));
        ++(shape.pieces == 1 && shape.euler == 1 ? disks : others);
      }
    }
  }
  CHECK(disks > 200);
  CHECK(others > 20);
}

// Facets without area.

/// The same surface with more facets: some are divided at a place of one edge, and at times at one more between that and an
/// end; facets without area fill the slit to the facet on the other side, which keeps the edge. Ends have coordinates of few
/// bits.
Mesh with_flat_facets(const Mesh& mesh, Rng& rng, double share) {
  const MeshView view(mesh);
  std::vector<Vec3> vertices;
  for (Index v = 0; v < view.num_vertices(); ++v) vertices.push_back(view.vertices[v]);
  std::vector<Corners> triangles;
  for (Index f = 0; f < view.num_facets(); ++f) {
    const Corners c = corners_of(mesh.triangles, f);
    if (rng.uniform() >= share) {
      triangles.push_back(c);
      continue;
    }
    const int k = static_cast<int>(below(rng, 3));
    const Index a = c[at(k)], b = c[at((k + 1) % 3)], o = c[at((k + 2) % 3)];
    // From the lower end, in another range where the facet on the other side is divided here.
    const double t = a < b ? (1 + below(rng, 20)) / 64.0 : 1 - (41 + below(rng, 20)) / 64.0;
    const auto m = static_cast<Index>(vertices.size());
    const Vec3 middle = vertices[at(a)] + t * (vertices[at(b)] - vertices[at(a)]);
    vertices.push_back(middle);
    triangles.push_back({m, b, o});
    triangles.push_back({a, b, m});  // without area
    if (rng.uniform() < 0.5) {
      triangles.push_back({a, m, o});
      continue;
    }
    vertices.push_back(0.5 * (vertices[at(a)] + middle));
    triangles.push_back({a, m, m + 1});
    triangles.push_back({m + 1, m, o});
    triangles.push_back({a, m + 1, o});
  }
  return mesh_of(vertices, triangles);
}

TEST_CASE("topology_certificate: facets without area change nothing") {
  Rng rng(5);
  int holds = 0, flat_facets = 0;
  for (const Mesh& mesh : {amps::make_cube(4), amps::make_square(4), thin_plate(0.125, 4)}) {
    for (int round = 0; round < 6; ++round) {
      CAPTURE(round);
      const Mesh divided = with_flat_facets(mesh, rng, 0.5);
      const Index zero = amps::check(divided).zero_area_facets;
      flat_facets += zero;
      CHECK(zero > 10);
      CHECK(invariants_of_surface(divided) == invariants_of_surface(mesh));
      const double radius = 0.05 + 0.02 * round;
      const Certified original(mesh, maximal_set(mesh, radius, Neighborhood::kSurface), Neighborhood::kSurface);
      SampleSet set = original.set;  // without places
      set.facets.clear();
      set.barycentrics = Points();
      const Certified a(mesh, set, Neighborhood::kSpace), b(divided, set, Neighborhood::kSpace);
      const TopologyCertificate of_original = a.certificate(), of_divided = b.certificate();
      CHECK(of_original.failures_of == of_divided.failures_of);
      holds += of_divided.holds() ? 1 : 0;
      Tally tally;
      check_law(Certified(divided, maximal_set(divided, radius, Neighborhood::kSurface), Neighborhood::kSurface), tally);
      holds += tally.holds;
    }
  }
  MESSAGE(flat_facets << " facets without area; holds " << holds << " times");
  CHECK(holds > 12);
}

TEST_CASE("topology_certificate: without area and without anything to go by") {
  // Beside a facet with area only along one of its short sides: nobody knows who has the rest.
  const Mesh mesh = mesh_of({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {2, 0, 0}}, {{0, 1, 2}, {1, 0, 3}});
  const SampleSet set = maximal_set(mesh, 0.1, Neighborhood::kSpace);
  CHECK(fails(Certified(mesh, set, Neighborhood::kSpace).certificate(), Kind::kUndecided));
  // By itself, it is no part of the surface that samples could tell.
  const Mesh apart = joined(amps::make_sphere(80), one_triangle({3, 0, 0}, {4, 0, 0}, {5, 0, 0}));
  CHECK(Certified(apart, maximal_set(apart, 0.2, Neighborhood::kSurface), Neighborhood::kSurface).certificate().holds());
}

// Curves.

/// The unit cube with its 12 edges as curves: its corners, samples along its edges and what fills the faces.
struct CurvedCube {
  Mesh mesh = amps::make_cube(4);
  amps::detail::SurfaceEdges edges{mesh};
  std::vector<char> cut;
  std::vector<Index> curve_of_edge;
  std::vector<std::vector<Index>> curves_of_sample;
  SampleSet set;

  static int axes_at_border(const Vec3& x) {
    int count = 0;
    for (int k = 0; k < 3; ++k) count += x[k] == 0 || x[k] == 1 ? 1 : 0;
    return count;
  }
  /// The edge of the cube that a point is inside of.
  static Index curve_at(const Vec3& x) {
    Index name = 0;
    for (int k = 0; k < 3; ++k) name = 3 * name + (x[k] == 0 ? 0 : x[k] == 1 ? 1 : 2);
    return name;
  }

  /// `left_out`: of the samples on curves; kNone: none is left out.
  explicit CurvedCube(int per_edge, Index left_out, std::uint64_t seed) {
    const MeshView view(mesh);
    const double radius = 1.0 / (1.2 * per_edge);
    cut.resize(edges.size(), 0);
    curve_of_edge.resize(edges.size(), kNone);
    for (std::size_t e = 0; e < edges.size(); ++e) {
      const Vec3 a = view.vertices[edges[e].low], b = view.vertices[edges[e].high], middle = 0.5 * (a + b);
      if (axes_at_border(middle) < 2) continue;
      cut[e] = 1;
      curve_of_edge[e] = curve_at(middle);
    }
    const auto flood = std::make_shared<const amps::detail::SurfaceFlood>(mesh, edges, cut);
    amps::detail::DiskSet disks(amps::bounding_box(mesh), radius, radius, flood);
    amps::detail::GrowingSet growing;
    Index on_curves = 0;
    const auto add = [&](const amps::SurfacePoint& point, std::vector<Index> curves) {
      disks.insert({point, radius}, growing.size());
      growing.add({point, radius});
      curves_of_sample.push_back(std::move(curves));
    };
    std::set<std::array<double, 3>> seen;
    for (std::size_t e = 0; e < edges.size(); ++e) {
      if (cut[e] == 0) continue;
      const auto& side = edges[e][0];
      const Vec3 a = view.corner(side.facet, side.k), b = view.corner(side.facet, (side.k + 1) % 3);
      for (int i = 0; i <= per_edge; ++i) {
        const Vec3 low = a.cwiseMin(b);
        int axis = 0;
        while (a[axis] == b[axis]) ++axis;
        const double place = static_cast<double>(i) / per_edge, t = (place - low[axis]) / (a.cwiseMax(b)[axis] - low[axis]);
        if (t < 0 || t > 1) continue;
        Vec3 x = low;
        x[axis] = place;
        if (!seen.insert({x[0], x[1], x[2]}).second || on_curves++ == left_out) continue;
        Vec3 barycentric = Vec3::Zero();
        barycentric[side.k] = a[axis] < b[axis] ? 1 - t : t;
        barycentric[(side.k + 1) % 3] = 1 - barycentric[side.k];
        std::vector<Index> curves;
        for (std::size_t other = 0; other < edges.size(); ++other) {
          if (cut[other] == 0) continue;
          const Vec3 p = view.vertices[edges[other].low], q = view.vertices[edges[other].high];
          if ((x - p).norm() + (x - q).norm() < (p - q).norm() + 1e-9) curves.push_back(curve_of_edge[other]);
        }
        add(amps::detail::surface_point_at(mesh, side.facet, barycentric), curves);
      }
    }
    std::vector<double> weights(static_cast<std::size_t>(growing.size()), radius * radius);
    amps::RestrictedPowerDiagram diagram(mesh, growing.points(), weights, disks.reach_lists(), 1);
    const amps::detail::WantedRadii radii(radius, ConflictRule::kMax);
    amps::detail::GapFiller filler(diagram, disks, radii);
    filler.look_at_all();
    Rng rng(seed);
    const auto filled = filler.fill(rng, {}, [&](const amps::detail::Sample& sample, Index near) {
      add(sample.at, {});
      diagram.insert(sample.position(), sample.radius * sample.radius, near);
    });
    CHECK(filled.complete());
    set = growing.finish();
  }

  TopologyCertificate certificate() const {
    Certified certified(mesh, set, Neighborhood::kSurface, cut);
    certified.curve_of_edge = curve_of_edge;
    certified.may_own = [this](Index sample, Index curve) {
      const std::vector<Index>& own = curves_of_sample[at(sample)];
      return std::find(own.begin(), own.end(), curve) != own.end();
    };
    const TopologyCertificate result = certified.certificate();
    const Mesh dual = dual_of(certified);
    if (result.holds()) CHECK(invariants_of(dual) == invariants_of_surface(mesh));
    if (result.holds()) CHECK(amps::total_area(dual) == doctest::Approx(6));  // it is the cube again
    return result;
  }
};

TEST_CASE("topology_certificate: curves of a cube") {
  for (const int per_edge : {2, 3, 6, 10}) {
    CAPTURE(per_edge);
    const Index on_curves = 8 + 12 * (per_edge - 1);
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      const TopologyCertificate certificate = CurvedCube(per_edge, kNone, seed).certificate();
      CAPTURE(certificate);
      CHECK(certificate.holds());
    }
    for (const Index left_out : {Index{0}, Index{3}, on_curves / 2, on_curves - 1}) {
      const TopologyCertificate certificate = CurvedCube(per_edge, left_out, 1).certificate();
      CAPTURE(certificate);
      CHECK_FALSE(certificate.holds());
      CHECK(fails(certificate, Kind::kForeignCurve));
    }
  }
}

TEST_CASE("topology_certificate: a curve that is cut needs samples on it") {
  CurvedCube cube(4, kNone, 1);
  // Samples of the faces alone: those beside an edge have parts of it, on their own side.
  SamplingOptions options = with_radius(0.2);
  options.neighborhood = Neighborhood::kSurface;
  cube.set = amps::sample(cube.mesh, options).samples;
  cube.curves_of_sample.assign(at(cube.set.size()), {});
  const TopologyCertificate certificate = cube.certificate();
  CHECK((fails(certificate, Kind::kForeignCurve) || fails(certificate, Kind::kDisagreement)));
  // The same as samples of all curves.
  for (auto& own : cube.curves_of_sample) {
    own = cube.curve_of_edge;
  }
  CHECK_FALSE(cube.certificate().holds());
}

/// Samples at all vertices that edges which are cut have, and what fills the rest; each curve edge is a curve of its own.
struct SampledAtVertices {
  Mesh mesh;
  std::vector<char> cut;
  std::vector<Index> curve_of_edge;
  std::vector<std::vector<Index>> curves_of_sample;
  SampleSet set;

  /// `is_curve`: told the ends of an edge. `also`: more surface vertices that get a sample. `left_out`: of those at vertices.
  template <class IsCurve>
  SampledAtVertices(const Mesh& its_mesh, const IsCurve& is_curve, const std::vector<Index>& also, double radius,
                    Index left_out = kNone)
      : mesh(its_mesh) {
    const MeshView view(mesh);
    const amps::detail::SurfaceEdges edges(mesh);
    cut.resize(edges.size(), 0);
    curve_of_edge.resize(edges.size(), kNone);
    std::set<Index> vertices(also.begin(), also.end());
    for (std::size_t e = 0; e < edges.size(); ++e) {
      if (!is_curve(view.vertices[edges[e].low], view.vertices[edges[e].high])) continue;
      cut[e] = 1;
      curve_of_edge[e] = static_cast<Index>(e);
      vertices.insert(edges[e].low);
      vertices.insert(edges[e].high);
    }
    const auto flood = std::make_shared<const amps::detail::SurfaceFlood>(mesh, edges, cut);
    amps::detail::DiskSet disks(amps::bounding_box(mesh), radius, radius, flood);
    amps::detail::GrowingSet growing;
    const auto add = [&](const amps::SurfacePoint& point, std::vector<Index> curves) {
      disks.insert({point, radius}, growing.size());
      growing.add({point, radius});
      curves_of_sample.push_back(std::move(curves));
    };
    Index place = 0;
    for (const Index v : vertices) {
      if (place++ == left_out) continue;
      std::vector<Index> curves;
      for (std::size_t e = 0; e < edges.size(); ++e) {
        if (cut[e] != 0 && (edges[e].low == v || edges[e].high == v)) curves.push_back(static_cast<Index>(e));
      }
      Index facet = 0;
      int k = 0;
      while (edges.triangles()(facet, k) != v) {
        if (++k == 3) ++facet, k = 0;
      }
      add(amps::detail::surface_point_at(mesh, facet, Vec3::Unit(k)), curves);
    }
    std::vector<double> weights(static_cast<std::size_t>(growing.size()), radius * radius);
    amps::RestrictedPowerDiagram diagram(mesh, growing.points(), weights, disks.reach_lists(), 1);
    const amps::detail::WantedRadii radii(radius, ConflictRule::kMax);
    amps::detail::GapFiller filler(diagram, disks, radii);
    filler.look_at_all();
    Rng rng(1);
    CHECK(filler
              .fill(rng, {},
                    [&](const amps::detail::Sample& sample, Index near) {
                      add(sample.at, {});
                      diagram.insert(sample.position(), sample.radius * sample.radius, near);
                    })
              .complete());
    set = growing.finish();
  }

  TopologyCertificate certificate(const Invariants& wanted) const {
    Certified certified(mesh, set, Neighborhood::kSurface, cut);
    certified.curve_of_edge = curve_of_edge;
    certified.may_own = [this](Index sample, Index curve) {
      const std::vector<Index>& own = curves_of_sample[at(sample)];
      return std::find(own.begin(), own.end(), curve) != own.end();
    };
    const TopologyCertificate result = certified.certificate();
    const Mesh dual = dual_of(certified);
    if (result.holds()) CHECK(invariants_of(dual) == wanted);
    if (result.holds()) CHECK(amps::topology(dual).vertices == set.size());
    return result;
  }
};

TEST_CASE("topology_certificate: a curve that ends inside of the surface leaves one sector at its ends") {
  const auto is_curve = [](const Vec3& a, const Vec3& b) {
    return a.y() == 0.5 && b.y() == 0.5 && std::min(a.x(), b.x()) >= 0.25 && std::max(a.x(), b.x()) <= 0.75;
  };
  const Mesh mesh = amps::make_square(16);
  const Invariants square = invariants_of_surface(mesh);
  const TopologyCertificate certificate = SampledAtVertices(mesh, is_curve, {}, 0.052).certificate(square);
  CAPTURE(certificate);
  CHECK(certificate.holds());
  for (const Index left_out : {0, 4, 8}) {
    CHECK_FALSE(SampledAtVertices(mesh, is_curve, {}, 0.052, left_out).certificate(square).holds());
  }
}

TEST_CASE("topology_certificate: a curve along a blade, and along the spine of a book") {
  const Mesh square = amps::make_square(12);
  const auto page = [&](double degrees) {
    const double c = std::cos(degrees * kDegree), s = std::sin(degrees * kDegree);
    return transformed(square, [&](const Vec3& x) { return Vec3(c * x.x(), x.y(), s * x.x()); });
  };
  const auto is_curve = [](const Vec3& a, const Vec3& b) { return a.x() == 0 && b.x() == 0; };
  const Mesh blade = joined(square, page(8)), book = joined(blade, page(100));
  for (const Mesh& mesh : {blade, book}) {
    const Invariants surface = invariants_of_surface(mesh);
    const TopologyCertificate certificate = SampledAtVertices(mesh, is_curve, {}, 0.07).certificate(surface);
    CAPTURE(certificate);
    CHECK(certificate.holds());
    for (const Index left_out : {0, 5, 12}) {
      CHECK_FALSE(SampledAtVertices(mesh, is_curve, {}, 0.07, left_out).certificate(surface).holds());
    }
  }
}

TEST_CASE("topology_certificate: a sample at a vertex of two fans has a piece in each") {
  const Mesh square = amps::make_square(6);
  const Mesh mesh = joined(square, transformed(square, [](const Vec3& x) { return Vec3(-x.x(), -x.y(), 0); }));
  const auto no_curve = [](const Vec3&, const Vec3&) { return false; };
  REQUIRE(amps::topology(amps::merge_equal_vertices(mesh)).non_manifold_vertices == 1);
  const Index shared = 0;
  REQUIRE(MeshView(mesh).vertices[shared] == Vec3::Zero());
  const Invariants joined_there = invariants_of(amps::merge_equal_vertices(mesh)), apart = invariants_of_surface(mesh);
  CHECK(joined_there.components == 1);
  CHECK(apart.components == 2);
  for (const double radius : {0.05, 0.1, 0.15}) {
    // Two borders that touch there.
    CHECK(SampledAtVertices(mesh, no_curve, {shared}, radius).certificate(joined_there).holds());
  }
}

TEST_CASE("topology_certificate: a cell whose sheets are disks can yet go round a tube") {
  const double radius = 0.1;
  const Mesh mesh = tube_with_page(12, 8, radius, 0.5);
  REQUIRE(amps::topology(mesh).non_manifold_edges == 8);
  // Above and below it are three cells each, beside it on the page one.
  std::vector<Vec3> sites = {{radius, 0, 0.5}, {0.45, 0, 0.52}};
  for (const double z : {0.2, 0.81}) {
    for (const double angle : {0.1, 2.2, 4.3}) sites.emplace_back(radius * std::cos(angle), radius * std::sin(angle), z);
  }
  for (const double z : {0.1, 0.9}) sites.emplace_back(0.5, 0, z);
  SampleSet set;
  set.positions = points_of(sites);
  set.radii.assign(sites.size(), 4);
  const Certified certified(mesh, set, Neighborhood::kSpace);
  const amps::detail::TopologyChecker checker(certified.mesh, *certified.flood);
  amps::detail::TopologyChecker::Scratch scratch;
  const auto nowhere = [](Index) { return amps::SurfacePoint(); };
  const TopologyCertificate certificate = checker.check(*certified.diagram, {nowhere, nullptr, nullptr}, {0}, scratch);
  CAPTURE(certificate);
  CHECK(certificate.failures.size() == 1);
  CHECK(fails(certificate, Kind::kPieces));
  CHECK(shape_of_cell(*certified.diagram, 0, 1e-9).euler == 0);
}

TEST_CASE("topology_certificate: facets that are divided differently at an edge are seen from both sides") {
  const Mesh mesh = amps::make_square(1);
  const SampleSet set = maximal_set(mesh, 0.3, Neighborhood::kSurface);
  const amps::detail::SurfaceEdges edges(mesh);
  int seen = 0;
  for (Index s = 0; s < set.size(); ++s) {
    for (const Index reached : {0, 1}) {
      // All reach both facets, but for s, which reaches one.
      amps::detail::ReachLists lists;
      for (Index other = 0; other < set.size(); ++other) {
        lists.add(other, other == s ? std::vector<Index>{reached} : std::vector<Index>{0, 1});
      }
      const amps::RestrictedPowerDiagram whole(mesh, set.positions, amps::detail::weights_of(set.radii));
      // Who has a part of the diagonal beside that of s? kNone: s has none.
      std::set<Index> beside;
      bool crosses = false;
      for (Index f = whole.first_of_site(s); f != kNone; f = whole.next_of_site(f)) {
        const auto p = whole.polygon(f);
        for (Index k = 0; k < p.size; ++k) {
          if (Diagram::is_site(p.labels[k])) continue;
          if (edges[edges.edge(p.facet, Diagram::mesh_edge(p.labels[k]))].size() < 2) continue;
          crosses = true;
          for (const Index label : {p.labels[(k + p.size - 1) % p.size], p.labels[(k + 1) % p.size]}) {
            if (Diagram::is_site(label)) beside.insert(label);
          }
        }
      }
      const amps::RestrictedPowerDiagram diagram(mesh, set.positions, amps::detail::weights_of(set.radii), &lists, 1);
      const amps::detail::SurfaceFlood flood(mesh, amps::detail::SurfaceEdges(mesh));
      const amps::detail::TopologyChecker checker(mesh, flood);
      amps::detail::TopologyChecker::Scratch scratch;
      const auto place = [&](Index sample) { return amps::detail::sample_of(set, sample).at; };
      const TopologyCertificate own = checker.check(diagram, {place, nullptr, nullptr}, {s}, scratch);
      CHECK(fails(own, Kind::kDisagreement) == crosses);
      CHECK(fails(checker.check(diagram, {place, nullptr, nullptr}), Kind::kDisagreement) == crosses);
      for (const Index other : beside) {
        CHECK(fails(checker.check(diagram, {place, nullptr, nullptr}, {other}, scratch), Kind::kDisagreement));
      }
      seen += crosses ? 1 : 0;
    }
  }
  CHECK(seen > 4);
}

// How it is called.

TEST_CASE("topology_certificate: cells one by one tell what all together do, on any number of threads") {
  for (const NamedMesh& model : law_meshes()) {
    const std::string& name = model.name;
    const Mesh& mesh = model.mesh;
    CAPTURE(name);
    const Certified certified(mesh, maximal_set(mesh, 0.1, Neighborhood::kSpace), Neighborhood::kSpace);
    const TopologyCertificate all = certified.certificate();
    CHECK(std::is_sorted(all.failures.begin(), all.failures.end()));
    for (const unsigned threads : {2u, 3u, 8u}) CHECK(certified.certificate(threads).failures == all.failures);
    const amps::detail::TopologyChecker checker(certified.mesh, *certified.flood);
    amps::detail::TopologySamples known = certified.samples();
    known.covered = true;  // as maximal sets are
    CHECK(!fails(all, Kind::kUncovered));
    CHECK(checker.check(*certified.diagram, known).failures == all.failures);
    amps::detail::TopologyChecker::Scratch scratch;
    std::set<std::array<Index, 4>> found, wanted;
    for (const auto& failure : all.failures) {
      wanted.insert({static_cast<Index>(failure.kind), failure.sample, failure.other, failure.third});
    }
    Index cells = 0;
    for (Index s = 0; s < certified.set.size(); ++s) {
      const TopologyCertificate one = checker.check(*certified.diagram, certified.samples(), {s}, scratch);
      cells += one.cells;
      for (const auto& failure : one.failures) {
        found.insert({static_cast<Index>(failure.kind), failure.sample, failure.other, failure.third});
      }
    }
    CHECK(found == wanted);
    CHECK(cells == all.cells);
  }
}

TEST_CASE("topology_certificate: follows the edits of a diagram") {
  const Mesh mesh = amps::make_torus(1.0, 0.3, 24, 12);
  Certified certified(mesh, maximal_set(mesh, 0.2, Neighborhood::kSpace), Neighborhood::kSpace);
  const amps::detail::TopologyChecker checker(certified.mesh, *certified.flood);
  amps::detail::TopologyChecker::Scratch scratch;
  const auto samples = certified.samples();
  REQUIRE(checker.check(*certified.diagram, samples).holds());
  Rng rng(2);
  for (int round = 0; round < 50; ++round) {
    const Index s = below(rng, certified.set.size());
    const amps::detail::Sample sample = amps::detail::sample_of(certified.set, s);
    certified.diagram->remove(s);
    const TopologyCertificate local = checker.check(*certified.diagram, samples, certified.diagram->changed_sites(), scratch);
    const TopologyCertificate whole = checker.check(*certified.diagram, samples);
    CHECK(whole.cells == certified.set.size() - 1);
    CHECK(local.failures_of == whole.failures_of);
    CHECK(fails(local, Kind::kUncovered));
    certified.diagram->reinsert(s, sample.position(), sample.radius * sample.radius);
    CHECK(checker.check(*certified.diagram, samples, certified.diagram->changed_sites(), scratch).holds());
  }
}

TEST_CASE("topology_certificate: can be cancelled") {
  const Certified certified(amps::make_sphere(320), maximal_set(amps::make_sphere(320), 0.2, Neighborhood::kSpace),
                            Neighborhood::kSpace);
  amps::Execution execution;
  execution.progress.cancel();
  CHECK_THROWS_AS(static_cast<void>(certified.certificate(execution)), Error);
}

TEST_CASE("topology_certificate: real meshes") {
  const std::vector<NamedMesh> meshes = {{"bunny_3k_closed.off", amps::make_sphere(1280)},
                                         {"eight.off", amps::make_torus()},
                                         {"hemisphere.off", amps::make_square(8)},
                                         {"elephant.off", amps::make_sphere(1280)},
                                         {"cube-minimal-degenerated.obj", amps::make_cube(2)}};
  for (const NamedMesh& model : meshes) {
    const std::string& name = model.name;
    const Mesh& stand_in = model.mesh;
    CAPTURE(name);
    const Mesh mesh = data_mesh_or(name, stand_in);
    SamplingOptions options = with_count(6000);
    options.neighborhood = Neighborhood::kSurface;
    Tally tally;
    const Certified certified(mesh, amps::sample(mesh, options).samples, Neighborhood::kSurface);
    check_law(certified, tally);
    const TopologyCertificate certificate = certified.certificate();
    CAPTURE(certificate);
    CHECK(certificate.holds());
  }
}

}  // namespace
}  // namespace amps_test
