// The nearest point of a surface, against plain geometry in long double over all facets (kit/distance.h); and, bit for bit,
// against a loop over the facets with the tree's own arithmetic.
#include "amps/surface_tree.h"

#include "kit/data.h"
#include "kit/distance.h"
#include "kit/errors.h"
#include "kit/execution.h"
#include "kit/meshes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace amps_test {

using amps::SurfaceHit;
using amps::SurfaceTree;

namespace {

bool same(const SurfaceHit& a, const SurfaceHit& b) {
  return a.distance == b.distance && a.point.facet == b.point.facet && a.point.barycentric == b.point.barycentric &&
         a.point.position == b.point.position;
}

/// Is this, to the bit, what a loop over all facets finds? Facets whose squared distances differ only may be equally far.
bool found_by_loop(const SurfaceTree& tree, const Vec3& x, const SurfaceHit& hit) {
  double least = kInfinity;
  for (Index f = 0; f < tree.num_facets(); ++f) least = std::min(least, tree.nearest_on_facet(x, f).distance);
  return hit.distance == least && same(hit, tree.nearest_on_facet(x, hit.point.facet));
}

Index lowest_nearest(const SurfaceTree& tree, const Vec3& x, double distance) {
  Index f = 0;
  while (tree.nearest_on_facet(x, f).distance != distance) ++f;
  return f;
}

/// A query of some kind: near the mesh, far away, at a vertex, in a facet, in the middle of an edge.
Vec3 some_query(const MeshView& mesh, Rng& rng) {
  const auto f = below(rng, mesh.num_facets());
  const int k = static_cast<int>(rng.below(3));
  switch (rng.below(6)) {
    case 0:
      return mesh.corner(f, k);
    case 1:
      return (mesh.corner(f, k) + mesh.corner(f, (k + 1) % 3)) / 2;
    case 2: {
      const Vec3 b = amps::uniform_barycentric(rng);
      return b[0] * mesh.corner(f, 0) + b[1] * mesh.corner(f, 1) + b[2] * mesh.corner(f, 2);
    }
    case 3:
      return 100 * (random_point(rng) - random_point(rng));
    default:
      return 3 * random_point(rng) - Vec3::Ones();
  }
}

/// A hit is what it says: a point of that facet, as far away as told, and no facet is nearer.
void check_hit(const MeshView& mesh, const Vec3& x, const SurfaceHit& hit, double tolerance) {
  REQUIRE(hit.point.facet >= 0);
  REQUIRE(hit.point.facet < mesh.num_facets());
  const Vec3 b = hit.point.barycentric;
  CHECK(b.minCoeff() >= 0);
  CHECK(std::abs(b.sum() - 1) <= 1e-15);
  Vec3 position = Vec3::Zero();
  for (int k = 0; k < 3; ++k) position += b[k] * mesh.corner(hit.point.facet, k);
  CHECK((position - hit.point.position).norm() <= 1e-15);
  CHECK(std::abs((hit.point.position - x).norm() - hit.distance) <= tolerance);
  CHECK(std::abs(static_cast<double>(brute_distance(mesh, x) - hit.distance)) <= tolerance);
}

template <class Query>
bool refuses(const Query& query) {
  return error_of(query) == ErrorCode::kInvalidArgument;
}

ErrorCode error_of_tree(const Mesh& mesh) {
  return error_of([&mesh] { const SurfaceTree tree(mesh); });
}

}  // namespace

TEST_CASE("surface_tree: nearest points of soups with slivers, points, segments and copies are those of plain geometry") {
  Rng rng(1);
  constexpr double kSize = 5;  // of the longest edges of these soups
  for (const Index n : {1, 2, 3, 4, 5, 17, 80, 300}) {
    for (int trial = 0; trial < 16; ++trial) {
      const bool slivers = trial % 2 == 0;
      const Mesh mesh = hard_soup(n, rng, slivers);
      const SurfaceTree tree(mesh);
      CHECK(tree.num_facets() == n);
      for (int q = 0; q < 25; ++q) {
        const Vec3 x = some_query(mesh, rng);
        check_hit(mesh, x, tree.nearest(x), slivers ? 2e-11 * kSize : 1e-15 * (8 + x.norm()));  // as the header promises
      }
    }
  }
}

TEST_CASE("surface_tree: each facet's nearest point, slivers down to a width of 1e-16") {
  Rng rng(2);
  const Mesh mesh = hard_soup(2000, rng);
  const SurfaceTree tree(mesh);
  for (Index f = 0; f < rows(mesh.triangles); ++f) {
    for (int q = 0; q < 4; ++q) {
      const Vec3 x = 3 * random_point(rng) - Vec3::Ones();
      const SurfaceHit hit = tree.nearest_on_facet(x, f);
      CHECK(hit.point.facet == f);
      CHECK(std::abs(static_cast<double>(facet_distance(mesh, f, x) - hit.distance)) <= 2e-15);
    }
  }
}

TEST_CASE("surface_tree: bit for bit the answer of a loop over all facets, whatever the hint; of equals the lowest index") {
  Rng rng(3);
  std::vector<Mesh> meshes{hard_soup(300, rng), amps::make_sphere(320), amps::make_square(8), amps::make_cube(4)};
  // Everything three times: only the first copies may be found.
  const Mesh once = amps::make_cube(2);
  const Index single = rows(once.triangles);
  const Mesh thrice{once.vertices, joined(joined(once.triangles, once.triangles), once.triangles)};
  meshes.push_back(thrice);
  for (std::size_t m = 0; m < meshes.size(); ++m) {
    const Mesh& mesh = meshes[m];
    const SurfaceTree tree(mesh);
    for (int q = 0; q < 300; ++q) {
      Vec3 x = some_query(mesh, rng);
      if (q % 3 == 0) x = (8 * x).array().round() / 8;  // as far from several facets
      const SurfaceHit hit = tree.nearest(x);
      REQUIRE(found_by_loop(tree, x, hit));
      if (m >= 2 && q % 3 == 0) REQUIRE(hit.point.facet == lowest_nearest(tree, x, hit.distance));
      const auto hint = below(rng, tree.num_facets());
      CHECK(same(hit, tree.nearest(x, hint)));
      CHECK(same(hit, tree.nearest(x, kNone)));
      CHECK(same(hit, tree.nearest(x, tree.num_facets())));  // out of range: none
    }
  }
  const SurfaceTree tree(thrice);
  for (int q = 0; q < 100; ++q) CHECK(tree.nearest(random_point(rng), 2 * single).point.facet < single);
}

TEST_CASE("surface_tree: a vertex is at distance 0 of the surface, exactly") {
  const Mesh mesh = data_mesh_or("bunny_36k_holes.obj", amps::make_knot());
  const Mesh used = amps::remove_isolated_vertices(mesh);
  const SurfaceTree tree(used);
  const std::vector<SurfaceHit> hits = tree.nearest_all(used.vertices);
  Index apart = 0;
  for (const SurfaceHit& hit : hits) apart += hit.distance == 0 ? 0 : 1;
  CHECK(apart == 0);
}

TEST_CASE("surface_tree: within a radius, up to and including it") {
  Rng rng(4);
  const Mesh mesh = hard_soup(200, rng);
  const SurfaceTree tree(mesh);
  for (int q = 0; q < 500; ++q) {
    const Vec3 x = some_query(mesh, rng);
    const SurfaceHit hit = tree.nearest(x);
    CHECK(same(hit, tree.nearest_within(x, hit.distance)));
    CHECK(same(hit, tree.nearest_within(x, 2 * hit.distance)));
    CHECK(same(hit, tree.nearest_within(x, kInfinity)));
    if (hit.distance > 0) {
      const SurfaceHit none = tree.nearest_within(x, std::nextafter(hit.distance, 0.0));
      CHECK(none.point.facet == kNone);
      CHECK(none.distance == kInfinity);
      CHECK(tree.nearest_within(x, 0).point.facet == kNone);
    }
  }
  CHECK(refuses([&] { tree.nearest_within(Vec3::Zero(), -1); }));
  CHECK(refuses([&] { tree.nearest_within(Vec3::Zero(), std::nan("")); }));
}

TEST_CASE("surface_tree: scaling by powers of two changes no bit; any scale and place works") {
  Rng rng(5);
  const Mesh mesh = hard_soup(60, rng);
  const SurfaceTree tree(mesh);
  for (const int exponent : {-900, -300, -1, 40, 300, 1000}) {
    const double scale = std::ldexp(1.0, exponent);
    const SurfaceTree other(scaled(mesh, scale));
    for (int q = 0; q < 100; ++q) {
      const Vec3 x = 3 * random_point(rng) - Vec3::Ones();
      const SurfaceHit a = tree.nearest(x), b = other.nearest(scale * x);
      CHECK(a.distance * scale == b.distance);
      CHECK(a.point.facet == b.point.facet);
      CHECK(a.point.barycentric == b.point.barycentric);
    }
  }
  for (const double offset : {1e3, -1e8, 1e15}) {  // the vertices are rounded by the move, then nothing is
    const Mesh shifted = moved(mesh, Vec3::Constant(offset));
    const SurfaceTree other(shifted);
    for (int q = 0; q < 100; ++q) {
      const Vec3 x = 3 * random_point(rng) - Vec3::Ones() + Vec3::Constant(offset);
      CHECK(std::abs(static_cast<double>(brute_distance(shifted, x) - other.nearest(x).distance)) <= 2e-14);
    }
  }
  const double large = std::numeric_limits<double>::max();
  const SurfaceTree widest(soup_mesh({{Vec3(-large, 0, 0), Vec3(large, 0, 0), Vec3(0, large, 0)}}));
  CHECK(widest.nearest(Vec3(0, 0, large)).distance == doctest::Approx(large));
  CHECK(widest.nearest(Vec3(-large, -large, 0)).distance == doctest::Approx(large));
}

TEST_CASE("surface_tree: facets that halve in size and distance down to the smallest numbers, and a thousand in one place") {
  std::vector<std::array<Vec3, 3>> facets;
  for (int k = 0; k < 1070; ++k) {  // splitting by area takes them off one by one
    const double s = std::ldexp(1.0, -k);
    facets.push_back({Vec3(s, 0, 0), Vec3(s, s / 8, 0), Vec3(s, 0, s / 8)});
  }
  const std::size_t row = facets.size();
  for (int k = 0; k < 1000; ++k) facets.push_back(facets[5]);
  const SurfaceTree tree(soup_mesh(facets));
  for (std::size_t k = 0; k < row; ++k) {
    const double s = std::ldexp(1.0, -static_cast<int>(k));
    const SurfaceHit hit = tree.nearest(Vec3(s, 0, 0));
    CHECK(hit.distance == 0);
    // Where squares vanish, below 2^-540, the first of all the facets that are as near is found.
    CHECK(hit.point.facet <= static_cast<Index>(k));
    if (k < 500) CHECK(hit.point.facet == static_cast<Index>(k));
  }
}

TEST_CASE("surface_tree: queries far away, up to the limit") {
  const Mesh mesh = amps::make_sphere(320);
  const SurfaceTree tree(mesh);
  for (const double far : {1e3, 1e15, 1e17, 1e19, 1e100, 1e149}) {
    const SurfaceHit hit = tree.nearest(Vec3(far, 0, 0));
    CHECK(hit.distance == doctest::Approx(far).epsilon(2 / far + 1e-15));
    CHECK(found_by_loop(tree, Vec3(far, 0, 0), hit));
  }
  CHECK(refuses([&] { tree.nearest(Vec3(1e160, 0, 0)); }));
  CHECK(refuses([&] { tree.nearest(Vec3(0, kInfinity, 0)); }));
  CHECK(refuses([&] { tree.nearest(Vec3(0, 0, std::nan(""))); }));
  CHECK(refuses([&] { tree.nearest_on_facet(Vec3::Zero(), -1); }));
  CHECK(refuses([&] { tree.nearest_on_facet(Vec3::Zero(), tree.num_facets()); }));
}

TEST_CASE("surface_tree: many queries, by any number of threads, are as one by one") {
  Rng rng(6);
  const Mesh mesh = amps::make_torus();
  const SurfaceTree tree(mesh);
  const Points queries = made_points(5000, [&rng](Index) -> Vec3 { return 2.8 * random_point(rng) - 1.4 * Vec3::Ones(); });
  const std::vector<SurfaceHit> one = tree.nearest_all(queries);
  REQUIRE(one.size() == 5000);
  for (const unsigned threads : {0u, 2u, 5u}) {
    const std::vector<SurfaceHit> many = tree.nearest_all(queries, on_threads(threads));
    REQUIRE(many.size() == one.size());
    for (std::size_t i = 0; i < one.size(); ++i) REQUIRE(same(one[i], many[i]));
  }
  for (std::size_t i = 0; i < one.size(); ++i) {
    REQUIRE(same(one[i], tree.nearest(point_at(queries, static_cast<Index>(i)))));
  }
  CHECK(tree.nearest_all(no_points()).empty());
}

TEST_CASE("surface_tree: owns what it needs and can be moved") {
  Mesh mesh = amps::make_cube();
  SurfaceTree first(mesh);
  mesh.vertices = constant_points(rows(mesh.vertices), 7);
  SurfaceTree second = std::move(first);
  CHECK(second.nearest(Vec3(0.5, 0.5, 2)).distance == 1);
  second = SurfaceTree(amps::make_square());
  CHECK(second.num_facets() == 2);
}

TEST_CASE("surface_tree: errors say what is wrong with the mesh; what no facet uses does not matter") {
  const Mesh good = amps::make_square();
  CHECK_NOTHROW(SurfaceTree{good});
  CHECK(error_of_tree(without_facets(good)) == ErrorCode::kInvalidMesh);
  CHECK(error_of_tree({no_points(), good.triangles}) == ErrorCode::kInvalidMesh);
  for (const Index v : {-1, 4}) {
    Mesh mesh = good;
    mesh.triangles(1, 2) = v;
    CHECK(error_of_tree(mesh) == ErrorCode::kInvalidMesh);
  }
  for (const double x : {kInfinity, -kInfinity, std::nan("")}) {
    Mesh mesh = good;
    mesh.vertices(mesh.triangles(0, 1), 2) = x;
    CHECK(error_of_tree(mesh) == ErrorCode::kInvalidMesh);
    CHECK_NOTHROW(SurfaceTree{with_vertices(good, {Vec3::Constant(x)})});
  }
}

}  // namespace amps_test
