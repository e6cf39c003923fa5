// Self-intersections: pairs of facets of every kind by hand, then random ones on a lattice against an oracle that clips one
// triangle by the other in rationals, then meshes as wholes.
#include "amps/self_intersections.h"

#include "kit/data.h"
#include "kit/errors.h"
#include "kit/execution.h"
#include "kit/meshes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {
namespace {

using amps::find_self_intersections;
using amps::SelfIntersection;
using amps::SelfIntersectionOptions;
using amps::SelfIntersectionReport;

using Facet = std::array<Vec3, 3>;

constexpr double kDenormal = 0x1p-1074;

// The oracle: the intersection of two triangles as a polygon (Sutherland & Hodgman) with corners in rationals.

/// x/w, y/w, z/w in lowest terms, w > 0.
struct Rational3 {
  std::array<std::int64_t, 3> x{};
  std::int64_t w = 1;

  void reduce() {
    std::int64_t common = w;
    for (const std::int64_t c : x) common = std::gcd(common, c);
    for (std::int64_t& c : x) c /= common;
    w /= common;
  }
  bool operator==(const Rational3& other) const { return x == other.x && w == other.w; }
};
using Polygon = std::vector<Rational3>;
using Triple = std::array<std::int64_t, 3>;

Triple triple_of(const Vec3& x) {
  Triple result{};
  for (int k = 0; k < 3; ++k) result[static_cast<std::size_t>(k)] = static_cast<std::int64_t>(x[k]);
  return result;
}
Triple difference(const Triple& a, const Triple& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Triple cross(const Triple& a, const Triple& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
std::int64_t dot(const Triple& a, const Triple& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/// What of the polygon, which may be a segment or a point, has n·x ≥ n·p.
Polygon clipped(const Polygon& polygon, const Triple& n, const Triple& p) {
  const auto value = [&](const Rational3& x) { return dot(n, x.x) - dot(n, p) * x.w; };
  Polygon result;
  for (std::size_t k = 0; k < polygon.size(); ++k) {
    const Rational3 &a = polygon[k], &b = polygon[(k + 1) % polygon.size()];
    const std::int64_t fa = value(a), fb = value(b);
    if (fa >= 0) result.push_back(a);
    if ((fa < 0 && fb > 0) || (fa > 0 && fb < 0)) {
      const std::int64_t s = fa > 0 ? 1 : -1;  // (fa·b − fb·a)/(fa − fb), with a positive denominator
      Rational3 at;
      for (std::size_t c = 0; c < 3; ++c) at.x[c] = s * (fa * b.x[c] - fb * a.x[c]);
      at.w = s * (fa * b.w - fb * a.w);
      at.reduce();
      result.push_back(at);
    }
  }
  return result;
}

bool has_area(const Facet& f) {
  return cross(difference(triple_of(f[1]), triple_of(f[0])), difference(triple_of(f[2]), triple_of(f[0]))) != Triple{};
}

/// Do two facets with areas and small integer coordinates have more in common than their common corners and edge?
bool oracle_intersect(const Facet& s, const Facet& t) {
  Polygon polygon;
  for (const Vec3& x : s) polygon.push_back({triple_of(x), 1});
  const Triple a = triple_of(t[0]), b = triple_of(t[1]), c = triple_of(t[2]);
  const Triple n = cross(difference(b, a), difference(c, a));
  polygon = clipped(polygon, n, a);
  polygon = clipped(polygon, {-n[0], -n[1], -n[2]}, a);
  polygon = clipped(polygon, cross(n, difference(b, a)), a);
  polygon = clipped(polygon, cross(n, difference(c, b)), b);
  polygon = clipped(polygon, cross(n, difference(a, c)), c);
  std::vector<Triple> common;
  for (const Vec3& x : s) {
    if (std::find(t.begin(), t.end(), x) != t.end()) common.push_back(triple_of(x));
  }
  if (common.size() == 3) return false;
  return std::any_of(polygon.begin(), polygon.end(), [&](const Rational3& x) {
    if (common.empty()) return true;
    // It is on the line of the common corners; then it is on their edge, as the intersection is convex and no larger there.
    const Triple from = {x.x[0] - common[0][0] * x.w, x.x[1] - common[0][1] * x.w, x.x[2] - common[0][2] * x.w};
    return common.size() == 1 ? from != Triple{} : cross(from, difference(common[1], common[0])) != Triple{};
  });
}

std::vector<SelfIntersection> oracle_pairs(const std::vector<Facet>& facets) {
  std::vector<char> counts;
  const auto corners = [](const Facet& f) {
    std::array<Triple, 3> result = {triple_of(f[0]), triple_of(f[1]), triple_of(f[2])};
    std::sort(result.begin(), result.end());
    return result;
  };
  std::set<std::array<Triple, 3>> seen;
  for (const Facet& f : facets) counts.push_back(has_area(f) && seen.insert(corners(f)).second);
  std::vector<SelfIntersection> result;
  for (std::size_t i = 0; i < facets.size(); ++i) {
    for (std::size_t j = i + 1; j < facets.size(); ++j) {
      if (counts[i] && counts[j] && oracle_intersect(facets[i], facets[j]))
        result.push_back({static_cast<Index>(i), static_cast<Index>(j)});
    }
  }
  return result;
}

/// Maps of the lattice onto others, which keep what intersects: facets along no axis, and coordinates of many bits.
std::vector<Eigen::Matrix3d> exact_maps() {
  Eigen::Matrix3d plain = Eigen::Matrix3d::Identity(), sheared, long_numbers;
  sheared << 1, 2, 0, 0, 1, 3, 5, 0, 1;
  long_numbers << 1, 0x1p20, 3, 0x1p25 + 1, 1, 0, 7, 0, 0x1p22 - 1;
  return {plain, sheared, long_numbers};
}
/// 1e±100 and the ends of the range of doubles.
constexpr int kScales[] = {0, 332, -332, 990, -1070};

Mesh mapped(const Mesh& mesh, const Eigen::Matrix3d& map, int exponent) {
  return transformed(mesh, [&](const Vec3& x) {
    Vec3 y = map * x;  // exact, in any order
    for (int k = 0; k < 3; ++k) y[k] = std::ldexp(y[k], exponent);
    return y;
  });
}

// Two facets, by hand

const Facet kBase = {Vec3(0, 0, 0), Vec3(4, 0, 0), Vec3(0, 4, 0)};

struct PairCase {
  std::string name;
  Facet other;  ///< beside kBase
  bool intersect;
};
const std::vector<PairCase>& pair_cases() {
  static const std::vector<PairCase> cases = {
      {"parallel above", {Vec3(0, 0, 1), Vec3(4, 0, 1), Vec3(0, 4, 1)}, false},
      {"pierces", {Vec3(1, 1, -1), Vec3(1, 1, 1), Vec3(5, 5, 0)}, true},
      {"pierced", {Vec3(1, -9, -9), Vec3(1, 9, -9), Vec3(1, 0, 18)}, true},
      {"plane crossed beside it", {Vec3(3, 3, -1), Vec3(3, 3, 1), Vec3(5, 5, 0)}, false},
      {"corner on the face", {Vec3(1, 1, 0), Vec3(1, 1, 3), Vec3(2, 1, 3)}, true},
      {"corner on an edge", {Vec3(2, 0, 0), Vec3(2, -1, 1), Vec3(3, -1, 1)}, true},
      {"corner at a corner", {Vec3(0, 0, 0), Vec3(-1, -1, 1), Vec3(-1, 0, 1)}, false},
      {"corner at a corner, of signed zeros", {Vec3(-0.0, 0, -0.0), Vec3(-1, -1, 1), Vec3(-1, 0, 1)}, false},
      {"edges cross in a point", {Vec3(1, 0, -1), Vec3(1, 0, 1), Vec3(1, -3, 0)}, true},
      {"edge on an edge", {Vec3(1, 0, 0), Vec3(3, 0, 0), Vec3(2, -2, 1)}, true},
      {"edge partly on an edge", {Vec3(3, 0, 0), Vec3(6, 0, 0), Vec3(5, -2, 1)}, true},
      {"edges in line, apart", {Vec3(5, 0, 0), Vec3(7, 0, 0), Vec3(6, -2, 1)}, false},
      {"edge in the face", {Vec3(1, 1, 0), Vec3(2, 1, 0), Vec3(1, 1, 5)}, true},
      {"edge across the face", {Vec3(-1, 1, 0), Vec3(5, 1, 0), Vec3(1, 1, 5)}, true},
      {"flat, overlapping", {Vec3(1, 1, 0), Vec3(5, 1, 0), Vec3(1, 5, 0)}, true},
      {"flat, star", {Vec3(3, 3, 0), Vec3(-1, 2, 0), Vec3(2, -1, 0)}, true},
      {"flat, within", {Vec3(1, 1, 0), Vec3(2, 1, 0), Vec3(1, 2, 0)}, true},
      {"flat, around", {Vec3(-9, -9, 0), Vec3(20, -9, 0), Vec3(-9, 20, 0)}, true},
      {"flat, apart with boxes that meet", {Vec3(3, 3, 0), Vec3(5, 4, 0), Vec3(4, 5, 0)}, false},
      {"flat, corner on an edge", {Vec3(2, 2, 0), Vec3(5, 4, 0), Vec3(4, 5, 0)}, true},
      {"flat, along an edge", {Vec3(1, 3, 0), Vec3(3, 1, 0), Vec3(4, 4, 0)}, true},
      {"common corner, flat, apart", {Vec3(0, 0, 0), Vec3(-4, 0, 0), Vec3(-1, -4, 0)}, false},
      {"common corner, flat, opposite", {Vec3(0, 0, 0), Vec3(-4, 0, 0), Vec3(0, -4, 0)}, false},
      {"common corner, flat, within the angle", {Vec3(0, 0, 0), Vec3(3, 1, 0), Vec3(1, 3, 0)}, true},
      {"common corner, flat, small, within", {Vec3(0, 0, 0), Vec3(2, 1, 0), Vec3(1, 2, 0)}, true},
      {"common corner, flat, across an edge", {Vec3(0, 0, 0), Vec3(3, 1, 0), Vec3(3, -1, 0)}, true},
      {"common corner, flat, along an edge", {Vec3(0, 0, 0), Vec3(3, 0, 0), Vec3(3, -1, 0)}, true},
      {"common corner, edge along a part of an edge", {Vec3(0, 0, 0), Vec3(2, 0, 0), Vec3(1, -2, 1)}, true},
      {"common corner, edge along more than an edge", {Vec3(0, 0, 0), Vec3(9, 0, 0), Vec3(1, -2, 1)}, true},
      {"common corner, pierces", {Vec3(0, 0, 0), Vec3(1, 1, -1), Vec3(1, 1, 1)}, true},
      {"common corner, pierced", {Vec3(0, 0, 0), Vec3(9, 9, -1), Vec3(9, 9, 1)}, true},
      {"common corner, edge in the face", {Vec3(0, 0, 0), Vec3(1, 1, 0), Vec3(1, 1, 1)}, true},
      {"common corner, edge across the face", {Vec3(0, 0, 0), Vec3(9, 9, 0), Vec3(9, 9, 1)}, true},
      {"common corner, beyond the plane", {Vec3(0, 0, 0), Vec3(-1, -1, 1), Vec3(1, 1, 1)}, false},
      {"common corner, plane crossed away from the face", {Vec3(0, 0, 0), Vec3(-1, -1, -1), Vec3(-1, -1, 1)}, false},
      {"common edge, flat", {Vec3(0, 0, 0), Vec3(4, 0, 0), Vec3(1, -2, 0)}, false},
      {"common edge, upright", {Vec3(0, 0, 0), Vec3(4, 0, 0), Vec3(1, 0, 3)}, false},
      {"common edge, steep", {Vec3(0, 0, 0), Vec3(4, 0, 0), Vec3(1, 2, 3)}, false},
      {"common edge, folded over", {Vec3(0, 0, 0), Vec3(4, 0, 0), Vec3(1, 2, 0)}, true},
      {"common edge, folded over and beyond", {Vec3(0, 0, 0), Vec3(4, 0, 0), Vec3(-3, 9, 0)}, true},
      {"the same facet", {Vec3(0, 0, 0), Vec3(4, 0, 0), Vec3(0, 4, 0)}, false},
      {"the same facet, turned over", {Vec3(4, 0, 0), Vec3(0, 0, 0), Vec3(0, 4, 0)}, false},
      {"segment that pierces", {Vec3(1, 1, -1), Vec3(1, 1, 0), Vec3(1, 1, 1)}, false},
      {"segment that pierces, with a corner twice", {Vec3(1, 1, -1), Vec3(1, 1, -1), Vec3(1, 1, 1)}, false},
      {"point on the face", {Vec3(1, 1, 0), Vec3(1, 1, 0), Vec3(1, 1, 0)}, false},
  };
  return cases;
}

/// Whether two facets intersect, the same for every order of them and of their corners.
bool intersect_in_any_order(const Mesh& two) {
  std::vector<std::int64_t> found;
  std::array<int, 3> s = {0, 1, 2};
  do {
    std::array<int, 3> t = {0, 1, 2};
    do {
      for (const bool swapped : {false, true}) {
        Mesh mesh = two;
        for (int k = 0; k < 3; ++k) {
          mesh.triangles(swapped ? 1 : 0, k) = two.triangles(0, s[static_cast<std::size_t>(k)]);
          mesh.triangles(swapped ? 0 : 1, k) = two.triangles(1, t[static_cast<std::size_t>(k)]);
        }
        found.push_back(find_self_intersections(mesh).num_pairs);
      }
    } while (std::next_permutation(t.begin(), t.end()));
  } while (std::next_permutation(s.begin(), s.end()));
  CHECK(std::count(found.begin(), found.end(), found[0]) == 72);
  return found[0] == 1;
}

/// `num_vertices` random points of a lattice of `side`³ points, and facets with random corners among them, of their own each.
std::vector<Facet> lattice_facets(Rng& rng, Index num_vertices, Index num_facets, Index side) {
  std::vector<Vec3> vertices;
  for (Index v = 0; v < num_vertices; ++v)
    vertices.emplace_back(double(below(rng, side)), double(below(rng, side)), double(below(rng, side)));
  std::vector<Facet> facets;
  for (Index f = 0; f < num_facets; ++f) {
    Facet facet;
    for (Vec3& x : facet) x = vertices[at(below(rng, num_vertices))];
    facets.push_back(facet);
  }
  return facets;
}

/// A sheet that a second one crosses at a right angle, away from its vertices.
Mesh crossed_sheets(Index cells) {
  return joined(amps::make_square(cells),
                transformed(amps::make_square(cells), [](const Vec3& x) { return Vec3(0.503, x[0] + 0.001, x[1] - 0.503); }));
}

}  // namespace

TEST_CASE("self-intersections: two facets, in every position to each other") {
  for (const PairCase& c : pair_cases()) {
    CAPTURE(c.name);
    const Mesh soup = soup_mesh({kBase, c.other});
    CHECK(intersect_in_any_order(soup) == c.intersect);
    CHECK(intersect_in_any_order(amps::merge_equal_vertices(soup)) == c.intersect);
    for (const Eigen::Matrix3d& map : exact_maps()) {
      for (const int exponent : kScales) {
        CAPTURE(exponent);
        CHECK(intersect_in_any_order(mapped(soup, map, exponent)) == c.intersect);
      }
    }
  }
}

TEST_CASE("self-intersections: the least distance there is between doubles tells") {
  const auto intersect = [](const Facet& other) { return intersect_in_any_order(soup_mesh({kBase, other})); };
  CHECK_FALSE(intersect({Vec3(1, 1, kDenormal), Vec3(1, 1, 3), Vec3(2, 1, 3)}));
  CHECK(intersect({Vec3(1, 1, -kDenormal), Vec3(1, 1, 3), Vec3(2, 1, 3)}));
  CHECK_FALSE(intersect({Vec3(0, 0, 0), Vec3(4, 0, 0), Vec3(1, 2, kDenormal)}));
  CHECK_FALSE(intersect({Vec3(2, -kDenormal, 0), Vec3(2, -1, 0), Vec3(3, -1, 0)}));
  CHECK(intersect({Vec3(2, kDenormal, 0), Vec3(2, -1, 0), Vec3(3, -1, 0)}));
  CHECK_FALSE(intersect({Vec3(0, 0, kDenormal), Vec3(-1, -1, 1), Vec3(-1, 0, 1)}));
  CHECK(intersect({Vec3(0, 0, -kDenormal), Vec3(1, 1, 1), Vec3(2, 1, 1)}));
  // A corner on the long side, where a double can be, and one step to either side of it.
  const double out = std::nextafter(2.0, 3.0), in = std::nextafter(2.0, 1.0);
  CHECK(intersect({Vec3(2, 2, 0), Vec3(5, 4, 1), Vec3(4, 5, -1)}));
  CHECK(intersect({Vec3(2, in, 0), Vec3(5, 4, 1), Vec3(4, 5, 1)}));
  CHECK_FALSE(intersect({Vec3(2, out, 0), Vec3(5, 4, 1), Vec3(4, 5, 1)}));
}

TEST_CASE("self-intersections: random facets on a lattice, against clipping in rationals") {
  Rng rng(1);
  const std::vector<Eigen::Matrix3d> maps = exact_maps();
  std::int64_t all = 0, pairs = 0;
  for (int n = 0; n < 20000; ++n) {
    CAPTURE(n);
    const Index side = 2 + below(rng, 4), num_facets = 2 + below(rng, 14);
    const std::vector<Facet> facets = lattice_facets(rng, 4 + below(rng, 20), num_facets, side);
    const std::vector<SelfIntersection> expected = oracle_pairs(facets);
    const Mesh soup = mapped(soup_mesh(facets), maps[at(below(rng, 3))], kScales[at(below(rng, 5))]);
    const SelfIntersectionReport found = find_self_intersections(soup);
    REQUIRE(found.pairs == expected);
    REQUIRE(found.num_pairs == static_cast<std::int64_t>(expected.size()));
    REQUIRE(find_self_intersections(amps::merge_equal_vertices(soup)).pairs == expected);
    all += num_facets * (num_facets - 1) / 2;
    pairs += found.num_pairs;
  }
  CHECK(pairs > all / 15);  // both answers are frequent
  CHECK(pairs < all / 2);
}

TEST_CASE("self-intersections: many small facets on a larger lattice, against clipping in rationals") {
  Rng rng(2);
  for (int n = 0; n < 6; ++n) {
    const Index side = 20 + 20 * n;
    std::vector<Facet> facets;
    for (Index f = 0; f < 500; ++f) {
      const Vec3 corner(double(below(rng, side)), double(below(rng, side)), double(below(rng, side)));
      Facet facet;
      for (Vec3& x : facet) x = corner + Vec3(double(below(rng, 9)), double(below(rng, 9)), double(below(rng, 9)));
      facets.push_back(facet);
    }
    const std::vector<SelfIntersection> expected = oracle_pairs(facets);
    CHECK(find_self_intersections(soup_mesh(facets)).pairs == expected);
    CHECK(expected.size() > 5);
  }
}

TEST_CASE("self-intersections: the tree finds the pairs that a loop over all pairs finds") {
  Rng rng(3);
  for (const Mesh& mesh : {random_soup(150, 4), hard_soup(200, rng), joined(amps::make_sphere(100), amps::make_cube(3)),
                           joined(amps::make_sphere(80), scaled(amps::make_cube(1), 1e4, {-5e3, -5e3, 0.1}))}) {
    std::vector<SelfIntersection> expected;
    const Index n = static_cast<Index>(mesh.triangles.rows());
    for (Index a = 0; a < n; ++a) {
      for (Index b = a + 1; b < n; ++b) {
        if (!find_self_intersections(chosen_facets(mesh, {a, b})).empty()) expected.push_back({a, b});
      }
    }
    std::vector<SelfIntersection> found = find_self_intersections(mesh).pairs;
    const std::vector<Index> left_out = [&] {  // facets that are there already; alone with another one they are first
      std::vector<Index> result;
      for (Index b = 0; b < n; ++b) {
        for (Index a = 0; a < b; ++a) {
          if (find_self_intersections(chosen_facets(mesh, {a, b})).repeated_facets > 0) {
            result.push_back(b);
            break;
          }
        }
      }
      return result;
    }();
    const auto of_left_out = [&](const SelfIntersection& pair) {
      return std::binary_search(left_out.begin(), left_out.end(), pair.a) ||
             std::binary_search(left_out.begin(), left_out.end(), pair.b);
    };
    expected.erase(std::remove_if(expected.begin(), expected.end(), of_left_out), expected.end());
    CHECK(found == expected);
    CHECK(expected.size() > 10);
  }
}

TEST_CASE("self-intersections: surfaces without any, at any scale and as soups") {
  for (const Mesh& mesh : {amps::make_square(20), amps::make_cube(7), amps::make_sphere(5000), amps::make_torus(),
                           amps::make_knot(), moebius_strip(40, 5), open_book(5), two_sheets(1e-300)}) {
    for (const double scale : {1.0, 1e100, 1e-100}) {
      const Mesh at_scale = scaled(mesh, scale);
      CHECK(find_self_intersections(at_scale).empty());
      CHECK(find_self_intersections(soup_of(at_scale)).empty());
    }
  }
  const Mesh bunny = data_mesh_or("bunny_3k_closed.off", small_knot());
  CHECK(find_self_intersections(bunny).empty());
}

TEST_CASE("self-intersections: parts that overlap, each without any of its own") {
  const Mesh sphere = amps::make_sphere(1000);
  const Mesh spheres = data_mesh_or("two_spheres_overlap.obj", joined(sphere, moved(sphere, {0.9, 0.31, 0.17})));
  const SelfIntersectionReport found = find_self_intersections(spheres);
  const Index half = static_cast<Index>(spheres.triangles.rows() / 2);
  CHECK(found.num_pairs > 50);
  CHECK(std::is_sorted(found.pairs.begin(), found.pairs.end()));
  for (const SelfIntersection& pair : found.pairs) CHECK((pair.a < half && pair.b >= half));

  // Each column of cells of one sheet is crossed by the other in a known number of facets: the line x = 0.503 meets a row of
  // cells in one cell, of which it crosses both triangles.
  const Index cells = 10;
  const SelfIntersectionReport crossed = find_self_intersections(crossed_sheets(cells));
  std::set<Index> of_first, of_second;
  for (const SelfIntersection& pair : crossed.pairs) {
    of_first.insert(pair.a);
    of_second.insert(pair.b);
  }
  CHECK(of_first.size() == 2 * cells);
  CHECK(of_second.size() == 2 * cells);
}

TEST_CASE("self-intersections: one vertex pulled through the other side") {
  Mesh mesh = amps::make_sphere(2000);
  CHECK(find_self_intersections(mesh).empty());
  const Vec3 before = MeshView(mesh).vertices[17];
  for (int k = 0; k < 3; ++k) mesh.vertices(17, k) = -1.5 * before[k];
  const SelfIntersectionReport found = find_self_intersections(mesh);
  CHECK(found.num_pairs >= 5);
  for (const SelfIntersection& pair : found.pairs) {
    const auto has_vertex = [&](Index f) {
      return mesh.triangles(f, 0) == 17 || mesh.triangles(f, 1) == 17 || mesh.triangles(f, 2) == 17;
    };
    CHECK((has_vertex(pair.a) != has_vertex(pair.b)));
  }
}

TEST_CASE("self-intersections: facets left out are counted, and the first copy stands for all") {
  const Facet across = {Vec3(1, 1, -1), Vec3(1, 1, 1), Vec3(5, 5, 0)}, turned_over = {kBase[2], kBase[1], kBase[0]};
  const Facet line = {Vec3(0, 0, 0), Vec3(1, 1, 0), Vec3(3, 3, 0)}, point = {Vec3(1, 1, 0), Vec3(1, 1, 0), Vec3(1, 1, 0)};
  const SelfIntersectionReport found =
      find_self_intersections(soup_mesh({line, kBase, turned_over, point, across, kBase, across, line}));
  CHECK(found.pairs == std::vector<SelfIntersection>{{1, 4}});
  CHECK(found.num_pairs == 1);
  CHECK(found.repeated_facets == 4);
  CHECK(found.degenerate_facets == 2);
  CHECK(find_self_intersections(soup_mesh({line, line, point})).empty());
  CHECK(find_self_intersections(Mesh()).empty());
  CHECK(find_self_intersections(soup_mesh({kBase})).empty());
}

TEST_CASE("self-intersections: all are counted, the first ones returned, on any threads") {
  // Facets through one line, each meeting each.
  std::vector<Facet> facets;
  for (int k = 0; k < 300; ++k) {
    const double angle = 0.01 * k;
    facets.push_back({Vec3(0, 0, -1 - k), Vec3(0, 0, 1), Vec3(std::cos(angle), std::sin(angle), 0)});
  }
  const Mesh mesh = joined(soup_mesh(facets), crossed_sheets(12));
  const SelfIntersectionReport all = find_self_intersections(mesh);
  CHECK(all.num_pairs > 300 * 299 / 2);
  CHECK(all.num_pairs == static_cast<std::int64_t>(all.pairs.size()));
  CHECK(std::adjacent_find(all.pairs.begin(), all.pairs.end()) == all.pairs.end());
  for (const Index max_pairs : {0, 1, 100, 44'849, 1'000'000}) {
    for (const unsigned threads : {1u, 2u, 5u}) {
      SelfIntersectionOptions options;
      options.max_pairs = max_pairs;
      options.execution.threads = threads;
      const SelfIntersectionReport found = find_self_intersections(mesh, options);
      CHECK(found.num_pairs == all.num_pairs);
      const std::size_t n = std::min(at(max_pairs), all.pairs.size());
      CHECK(found.pairs ==
            std::vector<SelfIntersection>(all.pairs.begin(), all.pairs.begin() + static_cast<std::ptrdiff_t>(n)));
    }
  }
}

TEST_CASE("self-intersections: errors, cancelling, words") {
  Mesh mesh = amps::make_sphere(100);
  SelfIntersectionOptions options;
  options.max_pairs = -1;
  CHECK(error_of([&] { find_self_intersections(mesh, options); }) == ErrorCode::kInvalidArgument);
  SelfIntersectionOptions stopped;
  cancel(stopped);
  CHECK(error_of([&] { find_self_intersections(mesh, stopped); }) == ErrorCode::kCancelled);
  CHECK(find_self_intersections(with_vertices(mesh, {Vec3(kNaN, 0, 0)})).empty());  // no facet has it
  Mesh not_finite = mesh;
  not_finite.vertices(3, 1) = kInfinity;
  CHECK(error_text([&] { find_self_intersections(not_finite); }).find("vertex 3") != std::string::npos);
  mesh.triangles(5, 2) = 1000;
  CHECK(error_of([&] { find_self_intersections(mesh); }) == ErrorCode::kInvalidMesh);

  const auto text = [](const SelfIntersectionReport& report) {
    std::ostringstream out;
    out << report;
    return out.str();
  };
  CHECK(text({}) == "no self-intersections");
  CHECK(text(find_self_intersections(soup_mesh({kBase, {Vec3(1, 1, -1), Vec3(1, 1, 1), Vec3(5, 5, 0)}}))) ==
        "1 pair of facets that intersect, such as 0 and 1");
}

}  // namespace amps_test
