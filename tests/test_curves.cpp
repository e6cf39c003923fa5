// The curve graph: what it finds on shapes whose creases are known, and what must not change it.
#include "amps/curves.h"

#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

using namespace amps;

namespace {

Mesh as_soup(const Mesh& mesh) {
  Mesh soup{Points(3 * mesh.triangles.rows()), Triangles(mesh.triangles.rows())};
  for (Index f = 0; f < static_cast<Index>(mesh.triangles.rows()); ++f) {
    for (int k = 0; k < 3; ++k) {
      for (int c = 0; c < 3; ++c) soup.vertices(3 * f + k, c) = mesh.vertices(mesh.triangles(f, k), c);
      soup.triangles(f, k) = 3 * f + k;
    }
  }
  return soup;
}

/// Facets in random order, indices rotated, some facets turned over.
Mesh shuffled(const Mesh& mesh, std::uint64_t seed) {
  Rng rng(seed);
  Mesh result = mesh;
  const auto n = static_cast<Index>(mesh.triangles.rows());
  std::vector<Index> order(static_cast<std::size_t>(n));
  for (Index f = 0; f < n; ++f) order[static_cast<std::size_t>(f)] = f;
  for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[rng.below(i)]);
  for (Index f = 0; f < n; ++f) {
    const int turn = static_cast<int>(rng.below(3));
    const bool flip = rng.below(2) != 0;
    for (int k = 0; k < 3; ++k) {
      result.triangles(f, k) = mesh.triangles(order[static_cast<std::size_t>(f)], ((flip ? 2 - k : k) + turn) % 3);
    }
  }
  return result;
}

/// A tube round the z axis, open or with fans as lids.
Mesh make_tube(Index n, bool lids) {
  Mesh mesh{Points(2 * n + 2), Triangles(lids ? 4 * n : 2 * n)};
  for (Index i = 0; i < n; ++i) {
    const double angle = 2 * 3.14159265358979323846 * i / n;
    for (int level = 0; level < 2; ++level) {
      mesh.vertices(2 * i + level, 0) = std::cos(angle);
      mesh.vertices(2 * i + level, 1) = std::sin(angle);
      mesh.vertices(2 * i + level, 2) = level;
    }
  }
  for (int c = 0; c < 3; ++c) mesh.vertices(2 * n, c) = mesh.vertices(2 * n + 1, c) = 0;
  mesh.vertices(2 * n + 1, 2) = 1;
  Index f = 0;
  const auto add = [&](Index a, Index b, Index c) {
    mesh.triangles(f, 0) = a;
    mesh.triangles(f, 1) = b;
    mesh.triangles(f++, 2) = c;
  };
  for (Index i = 0; i < n; ++i) {
    const Index a = 2 * i, b = 2 * ((i + 1) % n);
    add(a, b, b + 1);
    add(a, b + 1, a + 1);
    if (!lids) continue;
    add(b, a, 2 * n);
    add(a + 1, b + 1, 2 * n + 1);
  }
  return mesh;
}

Mesh triangles_of(std::vector<Vec3> points, std::vector<std::array<Index, 3>> facets) {
  Mesh mesh{Points(static_cast<Index>(points.size())), Triangles(static_cast<Index>(facets.size()))};
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (int c = 0; c < 3; ++c) mesh.vertices(static_cast<Index>(i), c) = points[i][c];
  }
  for (std::size_t f = 0; f < facets.size(); ++f) {
    for (int c = 0; c < 3; ++c) mesh.triangles(static_cast<Index>(f), c) = facets[f][static_cast<std::size_t>(c)];
  }
  return mesh;
}

CurveOptions with_radius(double r) {
  CurveOptions options;
  options.radius = r;
  return options;
}

void check_is_cube(const CurveGraph& graph) {
  CHECK(graph.curves.size() == 12);
  CHECK(graph.corners.size() == 8);
  CHECK(graph.num_patches == 6);
  for (const Curve& curve : graph.curves) CHECK(!curve.closed);
}

}  // namespace

TEST_CASE("curves: a cube has 12 curves, 8 corners and 6 patches, whatever the order, orientation, welding and scale") {
  for (const int n : {1, 8}) {
    for (const double r : {0.0, 0.02, 0.1}) {
      const Mesh cube = make_cube(n);
      const CurveGraph graph = find_curves(cube, with_radius(r));
      check_is_cube(graph);
      check_is_cube(find_curves(as_soup(cube), with_radius(r)));
      for (std::uint64_t seed = 0; seed < 5; ++seed) {
        const CurveGraph same = find_curves(shuffled(cube, seed), with_radius(r));
        check_is_cube(same);
        CHECK(same.is_curve_edge == graph.is_curve_edge);
        CHECK(same.corners == graph.corners);
      }
      Mesh large = cube;
      for (Index v = 0; v < static_cast<Index>(cube.vertices.rows()); ++v) {
        for (int c = 0; c < 3; ++c) large.vertices(v, c) *= 1024;
      }
      CHECK(find_curves(large, with_radius(1024 * r)).is_curve_edge == graph.is_curve_edge);
    }
  }
}

TEST_CASE("curves: rims of a tube are closed loops, as borders and as creases") {
  for (const bool lids : {false, true}) {
    for (const double r : {0.0, 0.2}) {
      const CurveGraph graph = find_curves(make_tube(64, lids), with_radius(r));
      REQUIRE(graph.curves.size() == 2);
      CHECK(graph.corners.empty());
      CHECK(graph.num_patches == (lids ? 3 : 1));
      for (const Curve& curve : graph.curves) {
        CHECK(curve.closed);
        CHECK((curve.kind == CurveKind::kBorder) == !lids);
        CHECK(curve.vertices.front() == curve.vertices.back());
        CHECK(curve.edges.size() == 64);
      }
    }
  }
  // The rim is 6.28 long: under 3 r the creases go, the borders stay.
  CHECK(find_curves(make_tube(64, true), with_radius(2.2)).curves.empty());
  CHECK(find_curves(make_tube(64, false), with_radius(2.2)).curves.size() == 2);
}

TEST_CASE("curves: three sheets at an edge, two fans at a vertex, marks and labels") {
  const Mesh book =
      triangles_of({{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {-1, 0.5, 0}, {-1, -0.5, 0}}, {{0, 1, 2}, {0, 1, 3}, {0, 1, 4}});
  const CurveGraph pages = find_curves(book);
  CHECK(pages.corners.size() == 5 - 3 + 3);  // both ends of the spine, and the sharp turns at the pages' outer corners
  CHECK(pages.num_patches == 3);

  const Mesh bow = triangles_of({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {-1, 0, 0}, {-1, -1, 0}}, {{0, 1, 2}, {0, 3, 4}});
  const CurveGraph tie = find_curves(bow);
  CHECK(tie.corner_of_vertex[0] != kNone);

  const Mesh square = triangles_of({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 3}});
  CHECK(find_curves(square).curves.size() == 4);
  CurveOptions options;
  options.labels = {7, 9};
  CHECK(find_curves(square, options).num_patches == 2);
  options.labels.clear();
  options.edges = {{2, 0}};
  CHECK(find_curves(square, options).curves.size() == 5);
  options.edges = {{1, 3}};
  CHECK_THROWS_AS(find_curves(square, options), Error);

  // Why: what holds of an edge comes before its being marked.
  const auto kind_of = [](const Mesh& mesh, const CurveOptions& wanted, Index a, Index b) {
    for (const amps::Curve& curve : find_curves(mesh, wanted).curves) {
      for (std::size_t k = 0; k + 1 < curve.vertices.size(); ++k) {
        const Index from = curve.vertices[k], to = curve.vertices[k + 1];
        if (std::min(from, to) == a && std::max(from, to) == b) return std::string(name_of(curve.kind));
      }
    }
    return std::string("none");
  };
  const auto fold = [](double height) {
    return triangles_of({{0, 0, 0}, {1, 0, 0}, {1, 1, height}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 3}});
  };
  CurveOptions marked;
  CHECK(kind_of(fold(0), marked, 0, 2) == "none");
  CHECK(kind_of(fold(5), marked, 0, 2) == "crease");
  CHECK(kind_of(fold(0), marked, 0, 1) == "border");
  CHECK(kind_of(book, marked, 0, 1) == "edge of many sheets");
  marked.edges = {{0, 1}, {0, 2}};
  CHECK(kind_of(fold(0), marked, 0, 2) == "marked");
  CHECK(kind_of(fold(5), marked, 0, 2) == "crease");
  CHECK(kind_of(fold(0), marked, 0, 1) == "border");
  marked.labels = {1, 2};
  CHECK(kind_of(fold(5), marked, 0, 2) == "border of labels");
  options.edges.clear();
  options.borders = false;
  options.vertices = {1};
  CHECK(find_curves(square, options).corners == std::vector<Index>{1});
  CHECK(find_curves(square, options).curves.empty());

  const Mesh lonely = triangles_of({{5, 5, 5}, {0, 0, 0}, {1, 0, 0}, {1, 1, 0}}, {{1, 2, 3}});
  CHECK(find_curves(lonely, options).corners == std::vector<Index>{1});
  options.vertices = {0};  // on no facet
  CHECK_THROWS_AS(find_curves(lonely, options), Error);
}

namespace {

Mesh noisy(Mesh mesh, double amplitude, std::uint64_t seed) {
  Rng rng(seed);
  for (Index v = 0; v < static_cast<Index>(mesh.vertices.rows()); ++v) {
    for (int c = 0; c < 3; ++c) mesh.vertices(v, c) += amplitude * (2 * rng.uniform() - 1);
  }
  return mesh;
}

}  // namespace

TEST_CASE("curves: noise makes no curves and hides none, where the radius is above it") {
  // Cells of 1/32, noise of a fifth of them: candidates all over the faces. An edge of the cube may turn by enough for a corner
  // of its own, where two curves end; three end at the corners of the cube.
  const Mesh cube = noisy(make_cube(32), 0.2 / 32, 5);
  CHECK(find_curves(cube).curves.size() > 100);
  const CurveGraph graph = find_curves(cube, with_radius(0.125));
  std::vector<int> ends(graph.corners.size(), 0);
  for (const Curve& curve : graph.curves) {
    REQUIRE(!curve.closed);
    ++ends[static_cast<std::size_t>(curve.first_corner)];
    ++ends[static_cast<std::size_t>(curve.last_corner)];
  }
  CHECK(std::count(ends.begin(), ends.end(), 3) == 8);
  CHECK(std::count(ends.begin(), ends.end(), 2) + 8 == static_cast<std::ptrdiff_t>(ends.size()));
  CHECK(graph.num_patches == 6);
  CHECK(graph.dropped.size() > 100);
}

TEST_CASE("curves: any number of threads finds the same graph") {
  // Noise makes thousands of candidates, which are confirmed in many pieces.
  const Mesh mesh = noisy(make_cube(40), 0.2 / 40, 6);
  for (const double radius : {0.0, 0.125}) {
    CurveOptions options;
    options.radius = radius;
    const CurveGraph one = find_curves(mesh, options);
    REQUIRE(one.curves.size() > 5);
    if (radius > 0) REQUIRE(one.dropped.size() > 100);
    for (const unsigned threads : {2u, 3u}) {
      options.execution = threads;
      const CurveGraph several = find_curves(mesh, options);
      CHECK(several.is_curve_edge == one.is_curve_edge);
      CHECK(several.dropped == one.dropped);
      CHECK(several.corners == one.corners);
      CHECK(several.patch_of_facet == one.patch_of_facet);
      CHECK(several.curve_of_edge == one.curve_of_edge);
      REQUIRE(several.curves.size() == one.curves.size());
      bool same = true;
      for (std::size_t c = 0; c < one.curves.size(); ++c) same = same && several.curves[c].arc == one.curves[c].arc;
      CHECK(same);
    }
  }
}
