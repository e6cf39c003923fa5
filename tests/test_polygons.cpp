// Polygons cut into triangles, and what readers keep of them.
#include "amps/polygons.h"

#include "amps/mesh_io.h"
#include "kit/errors.h"
#include "kit/mesh_files.h"
#include "kit/random.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {
namespace {

using Lattice = std::array<std::int64_t, 2>;

std::int64_t twice_area(const Lattice& a, const Lattice& b, const Lattice& c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

bool on_segment(const Lattice& a, const Lattice& b, const Lattice& x) {
  if (twice_area(a, b, x) != 0) return false;
  return (x[0] - a[0]) * (x[0] - b[0]) + (x[1] - a[1]) * (x[1] - b[1]) <= 0;
}

bool touch(const Lattice& a, const Lattice& b, const Lattice& c, const Lattice& d) {
  if (on_segment(a, b, c) || on_segment(a, b, d) || on_segment(c, d, a) || on_segment(c, d, b)) return true;
  return (twice_area(a, b, c) > 0) != (twice_area(a, b, d) > 0) && (twice_area(c, d, a) > 0) != (twice_area(c, d, b) > 0);
}

/// A simple polygon, counter-clockwise: a triangle whose edges are bent towards points that leave it simple.
std::vector<Lattice> random_polygon(Rng& rng, std::size_t corners, Index size) {
  std::vector<Lattice> p{{0, 0}, {size, 0}, {0, size}};
  for (int tries = 0; p.size() < corners && tries < 400; ++tries) {
    const std::size_t n = p.size(), k = rng.below(n), l = (k + 1) % n;
    const Lattice q{below(rng, size + 1), below(rng, size + 1)};
    bool good = q != p[k] && q != p[l] && !on_segment(q, p[l], p[k]) && !on_segment(q, p[k], p[l]);
    for (std::size_t i = 0; i < n && good; ++i) {
      const std::size_t j = (i + 1) % n;
      if (i == k) continue;
      good = !on_segment(p[i], p[j], q);
      good = good && !(j == k ? on_segment(p[k], q, p[i]) : touch(p[k], q, p[i], p[j]));
      good = good && !(i == l ? on_segment(q, p[l], p[j]) : touch(q, p[l], p[i], p[j]));
    }
    if (good) p.insert(p.begin() + static_cast<std::ptrdiff_t>(k) + 1, q);
  }
  return p;
}

/// Do two edges cross in a point inside both?
bool crosses_itself(const std::vector<Lattice>& p) {
  const std::size_t n = p.size();
  const auto sign = [](std::int64_t x) { return x > 0 ? 1 : x < 0 ? -1 : 0; };
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const Lattice a = p[i], b = p[(i + 1) % n], c = p[j], d = p[(j + 1) % n];
      if (sign(twice_area(a, b, c)) * sign(twice_area(a, b, d)) < 0 &&
          sign(twice_area(c, d, a)) * sign(twice_area(c, d, b)) < 0)
        return true;
    }
  }
  return false;
}

/// In the plane z = 0; false if it is said to cross itself.
bool cut_flat(const std::vector<Lattice>& p, std::vector<Index>& triangles) {
  std::vector<double> coordinates;
  std::vector<Index> corners;
  for (const Lattice& x : p) {
    coordinates.insert(coordinates.end(), {static_cast<double>(x[0]), static_cast<double>(x[1]), 0});
    corners.push_back(static_cast<Index>(corners.size()));
  }
  const amps::Execution execution;
  return amps::detail::PolygonCutter(coordinates.data(), execution).cut(corners.data(), p.size(), triangles);
}

/// Triangles that turn as the polygon does, and whose edges cancel but for those of the polygon, tile it: each point is in as
/// many of them as the polygon goes around it.
void require_tiling(const std::vector<Lattice>& p, const std::vector<Index>& triangles) {
  const std::size_t n = p.size();
  REQUIRE(triangles.size() == 3 * (n - 2));
  std::map<std::pair<Index, Index>, int> edges;
  for (std::size_t t = 0; t < triangles.size(); t += 3) {
    const auto at = [&](std::size_t k) { return p[static_cast<std::size_t>(triangles[t + k % 3])]; };
    REQUIRE(twice_area(at(0), at(1), at(2)) > 0);
    for (std::size_t k = 0; k < 3; ++k) {
      const Index a = triangles[t + k], b = triangles[t + (k + 1) % 3];
      a < b ? ++edges[{a, b}] : --edges[{b, a}];
    }
  }
  for (std::size_t k = 0; k < n; ++k) {
    const auto a = static_cast<Index>(k), b = static_cast<Index>((k + 1) % n);
    a < b ? --edges[{a, b}] : ++edges[{b, a}];
  }
  for (const auto& edge : edges) REQUIRE(edge.second == 0);
}

/// Ears cut in turn, each corner tried against all others; empty if there is none left to cut.
std::vector<Index> plain_ears(const std::vector<Lattice>& p, int sense) {
  std::vector<Index> ring, triangles;
  for (std::size_t k = 0; k < p.size(); ++k) ring.push_back(static_cast<Index>(k));
  const auto at = [&](Index k) { return p[static_cast<std::size_t>(k)]; };
  const auto outside = [&](Index a, Index b, Index x) { return sense * twice_area(at(a), at(b), at(x)) < 0; };
  std::size_t i = 0, since = 0;
  while (ring.size() > 2) {
    const std::size_t n = ring.size();
    const Index a = ring[(i + n - 1) % n], b = ring[i % n], c = ring[(i + 1) % n];
    const bool spike = at(a) == at(c);
    bool ear = sense * twice_area(at(a), at(b), at(c)) > 0;
    for (std::size_t j = 0; j < n && ear && !spike; ++j) {
      const Index x = ring[j];
      if (at(x) == at(a) || at(x) == at(b) || at(x) == at(c)) continue;
      ear = outside(a, b, x) || outside(b, c, x) || outside(c, a, x);
    }
    Index go_on = c;
    if (spike) {
      ring.erase(std::find(ring.begin(), ring.end(), b));
      ring.erase(std::find(ring.begin(), ring.end(), c));
      go_on = a;
      since = 0;
    } else if (ear) {
      triangles.insert(triangles.end(), {a, b, c});
      go_on = ring[(i + 2) % n];
      ring.erase(std::find(ring.begin(), ring.end(), b));
      since = 0;
    } else if (++since > n) {
      return {};
    }
    i = static_cast<std::size_t>(std::find(ring.begin(), ring.end(), go_on) - ring.begin());
  }
  return triangles;
}

Lattice rounded(double x, double y) { return {std::llround(x), std::llround(y)}; }

double area_of(const std::string& obj) { return amps::total_area(amps::parse_mesh(obj, MeshFormat::kObj)); }

}  // namespace

TEST_CASE("polygons: triangles of simple polygons tile them") {
  Rng rng(3);
  int concave = 0, with_runs = 0;
  for (int round = 0; round < 10000; ++round) {
    const std::vector<Lattice> p = random_polygon(rng, 4 + rng.below(20), 2 + below(rng, 12));
    const std::size_t n = p.size();
    bool is_concave = false, has_run = false;
    for (std::size_t k = 0; k < n; ++k) {
      const std::int64_t turn = twice_area(p[k], p[(k + 1) % n], p[(k + 2) % n]);
      is_concave = is_concave || turn < 0;
      has_run = has_run || turn == 0;
    }
    concave += is_concave ? 1 : 0;
    with_runs += has_run ? 1 : 0;
    // On a plane of integer directions, so that coordinates are exact.
    Vec3 u, v;
    do {
      for (int k = 0; k < 3; ++k) {
        u[k] = below(rng, 9) - 4;
        v[k] = below(rng, 9) - 4;
      }
    } while (u.cross(v).isZero());
    std::vector<double> coordinates;
    std::vector<Index> corners;
    const std::size_t shift = rng.below(n);
    for (std::size_t k = 0; k < n; ++k) {
      const Vec3 x = static_cast<double>(p[k][0]) * u + static_cast<double>(p[k][1]) * v + Vec3(7, -3, 5);
      coordinates.insert(coordinates.end(), {x[0], x[1], x[2]});
      corners.push_back(static_cast<Index>((k + shift) % n));
    }
    std::vector<Index> triangles;
    const amps::Execution execution;
    amps::detail::PolygonCutter cutter(coordinates.data(), execution);
    REQUIRE(cutter.cut(corners.data(), n, triangles));
    require_tiling(p, triangles);
  }
  CHECK(concave > 5000);
  CHECK(with_runs > 500);
}

TEST_CASE("polygons: a hundred thousand corners, in a time that is about in proportion") {
  constexpr int kCorners = 100000;
  constexpr double kFullTurn = 6.283185307179586;
  std::vector<Lattice> star, spiral, comb;
  Rng rng(8);
  for (int k = 0; k < kCorners; ++k) {
    const double angle = kFullTurn * k / kCorners, r = (k % 2 == 0 ? 1e8 : 6e7) + 1e7 * rng.uniform();
    star.push_back(rounded(r * std::cos(angle), r * std::sin(angle)));
  }
  constexpr int kHalf = kCorners / 2;
  for (int k = 0; k < kCorners; ++k) {  // twenty times around, out and back again
    const double angle = 20 * kFullTurn * (k < kHalf ? k : kCorners - 1 - k) / kHalf,
                 r = 1e6 * (1 + angle + (k < kHalf ? 0 : 2));
    spiral.push_back(rounded(r * std::cos(angle), r * std::sin(angle)));
  }
  std::reverse(spiral.begin(), spiral.end());
  for (int k = 0; k < kCorners / 4; ++k) {  // of slanted teeth, a hundred thousand long
    for (const auto& [u, v] : {std::array<int, 2>{4 * k, 0}, {4 * k, kCorners}, {4 * k + 2, kCorners}, {4 * k + 2, 2}}) {
      comb.push_back({3 * u + 4 * v, -4 * u + 3 * v});
    }
  }
  comb.push_back({3 * kCorners - 4 * kCorners, -4 * kCorners - 3 * kCorners});
  std::reverse(comb.begin(), comb.end());
  for (std::vector<Lattice>* polygon : {&star, &spiral, &comb}) {
    std::vector<Index> triangles;
    const auto start = std::chrono::steady_clock::now();
    REQUIRE(cut_flat(*polygon, triangles));
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    CHECK(seconds.count() < 30);  // half a second; the time of corners times corners is minutes, or hours
    require_tiling(*polygon, triangles);
    std::swap((*polygon)[kHalf / 2], (*polygon)[kHalf / 2 + 2]);
    triangles.clear();
    CHECK(!cut_flat(*polygon, triangles));
  }
}

TEST_CASE("polygons: crossings of many edges are found, and what has none loses the ears that a search of all corners finds") {
  Rng rng(9);
  int crossing = 0, cut = 0;
  for (int round = 0; round < 3000; ++round) {
    // Around the origin on a coarse lattice; every other one is a walk from neighbour to neighbour.
    std::vector<Lattice> p;
    const int n = 60 + below(rng, 60);
    Lattice x{0, 0};
    for (int k = 0; k < n; ++k) {
      if (round % 2 == 0) {
        const double angle = 6.283185307179586 * k / n, r = (10 + below(rng, 30)) * (0.5 + rng.uniform());
        x = rounded(r * std::cos(angle), r * std::sin(angle));
      } else {
        x[rng.below(2)] += below(rng, 2) == 0 ? 1 : -1;
      }
      if (p.empty() || p.back() != x) p.push_back(x);
    }
    while (p.front() == p.back()) p.pop_back();
    std::vector<Index> triangles;
    const bool is_cut = cut_flat(p, triangles);
    if (crosses_itself(p)) {
      CHECK(!is_cut);
      ++crossing;
    } else {
      std::int64_t area = 0;
      for (std::size_t k = 0; k < p.size(); ++k) area += twice_area({0, 0}, p[k], p[(k + 1) % p.size()]);
      bool is_fan = true;  // taken before ears where it tiles
      for (std::size_t t = 0; t < triangles.size(); t += 3) is_fan = is_fan && triangles[t] == 0;
      if (area == 0 || (is_cut && is_fan)) continue;
      const std::vector<Index> expected = plain_ears(p, area > 0 ? 1 : -1);
      CHECK(is_cut == !expected.empty());
      if (is_cut) CHECK(triangles == expected);
      ++cut;
    }
  }
  CHECK(crossing > 1000);
  CHECK(cut > 300);
}

TEST_CASE("polygons: shapes of known area") {
  const std::string arrow = "v 0 0 0\nv 2 1 0\nv 0 2 0\nv 1 1 0\n";
  for (const char* face : {"f 1 2 3 4", "f 2 3 4 1", "f 3 4 1 2", "f 4 1 2 3", "f 4 3 2 1", "f 1 1 2 3 3 4 1"}) {
    CAPTURE(face);
    CHECK(area_of(arrow + face) == doctest::Approx(1));
  }
  // A square with a square hole, by a bridge from 1 to 5; with the bridge at another corner of the list.
  const std::string frame = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nv 1 1 0\nv 1 3 0\nv 3 3 0\nv 3 1 0\n";
  for (const char* face : {"f 1 2 3 4 1 5 6 7 8 5", "f 5 6 7 8 5 1 2 3 4 1", "f 3 4 1 5 6 7 8 5 1 2"}) {
    CAPTURE(face);
    const Mesh mesh = amps::parse_mesh(frame + face, MeshFormat::kObj);
    CHECK(amps::total_area(mesh) == doctest::Approx(12));
    CHECK(amps::topology(mesh).boundary_loops == 2);
    CHECK(mesh.crossing_polygons.empty());
  }
}

TEST_CASE("polygons: what crosses itself is told, and whose each triangle is") {
  const std::string v = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\n";
  const Mesh mesh = amps::parse_mesh("f 1 2 5\n" + v + "f 1 2\nf 1 2 3 4\nf 1 3 2 4\nf 1 2 3\n", MeshFormat::kObj);
  CHECK(mesh.polygons == std::vector<Index>{0, 2, 2, 3, 3, 4});
  CHECK(mesh.crossing_polygons == std::vector<Index>{3});
  CHECK(amps::parse_mesh(v + "f 1 2 3\nf 1 3 4\n", MeshFormat::kObj).polygons.empty());
}

TEST_CASE("polygons: quads take the better diagonal, rectangles the first") {
  const Mesh rhombus = amps::parse_mesh("v -3 0 0\nv 0 -1 0\nv 3 0 0\nv 0 1 0\nf 1 2 3 4\n", MeshFormat::kObj);
  CHECK(rhombus.triangles(0, 2) == 3);
  const Mesh rectangle = amps::parse_mesh("v 0 0 0\nv 3 0 0\nv 3 1 0\nv 0 1 0\nf 1 2 3 4\n", MeshFormat::kObj);
  CHECK(rectangle.triangles(0, 2) == 2);
}

TEST_CASE("mesh_io: triangle strips, broken comments, and files in wraps") {
  const std::string strip =
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\n"
      "property list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n";
  for (const char* list : {"4 0 1 2 3\n", "8 0 1 2 -1 2 1 3 -1\n", "6 0 1 2 2 3 1\n"}) {
    const Mesh mesh = amps::parse_mesh(strip + list, MeshFormat::kPly);
    CHECK(amps::total_area(mesh) == doctest::Approx(1));
    CHECK(amps::facet_normals(mesh)(1, 2) == 1);
  }
  const std::string broken =
      "ply\nformat ascii 1.0\ncomment by an exporter, source: \n made-up.blend\nelement vertex 3\nproperty float x\n"
      "property float y\nproperty float z\nelement face 1\nproperty list uchar uint vertex_indices\nend_header\n"
      "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
  CHECK(rows(amps::parse_mesh(broken, MeshFormat::kPly).triangles) == 1);
  std::string little = "OFF BINARY\n";
  for (const std::int32_t count : {4, 1, 0}) put(little, count, false);
  for (const float x : {0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f, 1.f, 1.f, 0.f}) put(little, x, false);
  for (const std::int32_t index : {4, 0, 1, 3, 2, 0}) put(little, index, false);
  check_is_square(little, MeshFormat::kOff);
  check_is_square(little.substr(0, little.size() - 4), MeshFormat::kOff);  // without the number of parts of a colour
  check_refused(little.substr(0, little.size() - 8), MeshFormat::kOff, "byte");
  for (const MeshFormat format : kFormats) {
    check_refused("\x1F\x8B\x08 and more", format, "gzip");
    check_refused("\xFF\xFEv", format, "UTF-16");
  }
}

}  // namespace amps_test
