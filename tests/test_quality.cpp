#include "amps/quality.h"

#include "kit/meshes.h"

#include "amps/mesh_edges.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iomanip>
#include <map>
#include <set>
#include <sstream>
#include <utility>
#include <vector>

namespace amps_test {

using amps::quality;
using amps::QualityReport;
using doctest::Approx;

namespace {

Mesh octahedron() {
  return mesh_of({{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}},
                 {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}});
}

/// n × n vertices on the unit square, each cell cut in two along the same diagonal.
Mesh right_triangle_grid(Index n) {
  std::vector<Vec3> vertices;
  std::vector<Corners> triangles;
  for (Index j = 0; j < n; ++j) {
    for (Index i = 0; i < n; ++i) vertices.emplace_back(i, j, 0);
  }
  for (Index j = 0; j + 1 < n; ++j) {
    for (Index i = 0; i + 1 < n; ++i) {
      const Index v = j * n + i;
      triangles.push_back({v, v + 1, v + n + 1});
      triangles.push_back({v, v + n + 1, v + n});
    }
  }
  return mesh_of(vertices, triangles);
}

}  // namespace

TEST_CASE("quality: an octahedron is equilateral, closed, and of valence 4") {
  const QualityReport q = quality(octahedron());
  CHECK(q.triangles == 8);
  CHECK(q.min_angle == Approx(60));
  CHECK(q.max_angle == Approx(60));
  CHECK(q.mean_min_angle == Approx(60));
  CHECK(q.min_q == Approx(1));
  CHECK(q.mean_q == Approx(1));
  CHECK(q.area_ratio == Approx(1));
  CHECK(q.min_edge == Approx(std::sqrt(2)));
  CHECK(q.max_edge == Approx(std::sqrt(2)));
  CHECK(q.mean_edge == Approx(std::sqrt(2)));
  CHECK(q.below_30 == 0);
  CHECK(q.above_90 == 0);
  CHECK(q.interior_vertices == 6);
  CHECK(q.valence[4] == 6);
  CHECK(q.valence_5_6_7 == 0);
}

TEST_CASE("quality: a grid of right triangles has no obtuse one, valence 6 inside, and an open boundary") {
  const QualityReport q = quality(right_triangle_grid(6));
  CHECK(q.triangles == 50);
  CHECK(q.min_angle == Approx(45));
  CHECK(q.max_angle == Approx(90));
  CHECK(q.above_90 == 0);
  CHECK(q.below_30 == 0);
  // Q = 6/√3 · ½ / ((2 + √2)/2 · √2) = 2√3 / (2√2 + 2)
  CHECK(q.min_q == Approx(std::sqrt(3) / (std::sqrt(2) + 1)));
  CHECK(q.interior_vertices == 16);
  CHECK(q.valence[6] == 16);
  CHECK(q.valence_5_6_7 == 100);
  CHECK(q.min_edge == Approx(1));
  CHECK(q.max_edge == Approx(std::sqrt(2)));
  CHECK(q.mean_edge == Approx((60 + 25 * std::sqrt(2)) / 85));
}

TEST_CASE("quality: slivers have the angles of their limit, to full relative precision") {
  for (const double h : {1e-3, 1e-8, 1e-12, 1e-100}) {
    const QualityReport needle = quality(mesh_of({{0, 0, 0}, {1, 0, 0}, {0, h, 0}}, {{0, 1, 2}}));
    const double radians = std::atan(h);
    CHECK(needle.min_angle == Approx(radians * 180 / kPi).epsilon(1e-12));
    CHECK(needle.max_angle == Approx(90));
    CHECK(needle.below_30 == 100);
    const QualityReport cap = quality(mesh_of({{0, 0, 0}, {2, 0, 0}, {1, h, 0}}, {{0, 1, 2}}));
    CHECK(cap.min_angle == Approx(radians * 180 / kPi).epsilon(1e-12));
    CHECK(cap.max_angle == Approx(180 - 2 * radians * 180 / kPi).epsilon(1e-14));
    CHECK(cap.above_90 == 100);
  }
}

TEST_CASE("quality: slivers in general position agree with extended precision") {
  Rng rng(2);
  for (int trial = 0; trial < 200; ++trial) {
    const double width = std::pow(10.0, -1 - 7 * rng.uniform());
    std::array<Vec3, 3> p;
    for (int k = 0; k < 3; ++k) {
      p[0][k] = rng.uniform();
      p[1][k] = p[0][k] + rng.uniform() - 0.5;
      p[2][k] = p[0][k] + width * (rng.uniform() - 0.5);
    }
    std::vector<Real> angles;
    for (std::size_t i = 0; i < 3; ++i) {
      Real u[3], v[3], dot = 0, cross = 0;
      for (int k = 0; k < 3; ++k) {
        u[k] = static_cast<Real>(p[(i + 1) % 3][k]) - p[i][k];
        v[k] = static_cast<Real>(p[(i + 2) % 3][k]) - p[i][k];
        dot += u[k] * v[k];
      }
      for (int k = 0; k < 3; ++k) {
        const Real c = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
        cross += c * c;
      }
      angles.push_back(std::atan2(std::sqrt(cross), dot) * 180 / std::acos(-1.0L));
    }
    std::sort(angles.begin(), angles.end());
    if (angles[1] < 5) continue;  // nearly collinear corners: their differences alone lose more than this test allows
    const QualityReport q = quality(one_triangle(p[0], p[1], p[2]));
    CHECK(q.min_angle == Approx(static_cast<double>(angles[0])).epsilon(1e-13));
    CHECK(q.max_angle == Approx(static_cast<double>(angles[2])).epsilon(1e-13));
  }
}

TEST_CASE("quality: zero-area facets count with 0, 180 and Q 0; repeated indices are skipped") {
  const std::vector<Vec3> points = {{0, 0, 0}, {1, 0, 0}, {0.5, 1, 0}, {0.5, 0, 0}, {0, 0, 0}, {0, 0, 0}};
  for (const Corners& flat : {Corners{0, 1, 3}, {0, 4, 1}, {0, 4, 5}}) {
    const QualityReport q = quality(mesh_of(points, {{0, 1, 2}, flat, {1, 1, 2}, {0, 0, 0}}));
    CHECK(q.triangles == 2);
    CHECK(q.min_angle == 0);
    CHECK(q.max_angle == 180);
    CHECK(q.min_q == 0);
    CHECK(q.area_ratio == 0);
    CHECK(q.below_30 == 50);
    CHECK(q.above_90 == 50);
  }
}

TEST_CASE("quality: a mesh without triangles gives zeros") {
  const QualityReport q = quality(mesh_of({{0, 0, 0}}, {{0, 0, 0}}));
  CHECK(q.triangles == 0);
  CHECK(q.min_angle == 0);
  CHECK(q.min_q == 0);
  CHECK(q.mean_edge == 0);
  CHECK(q.interior_vertices == 0);
  CHECK(quality(Mesh{no_points(), no_triangles()}).triangles == 0);
}

TEST_CASE("quality: valences above 14 go together; edges of three facets are interior") {
  std::vector<Vec3> points = {{0, 0, 1}, {0, 0, -1}};
  std::vector<Corners> triangles;
  const Index n = 40;
  for (Index i = 0; i < n; ++i) {  // a bipyramid
    points.emplace_back(std::cos(2 * kPi * i / n), std::sin(2 * kPi * i / n), 0);
    triangles.push_back({2 + i, 2 + (i + 1) % n, 0});
    triangles.push_back({2 + (i + 1) % n, 2 + i, 1});
  }
  QualityReport q = quality(mesh_of(points, triangles));
  CHECK(q.valence[15] == 2);
  CHECK(q.valence[4] == n);
  triangles.push_back({2, 3, 0});  // twice the same facet: no new edge, and no boundary
  q = quality(mesh_of(points, triangles));
  CHECK(q.interior_vertices == n + 2);
  CHECK(q.valence[4] == n);
}

TEST_CASE("quality: agrees with a direct evaluation on random soups") {
  Rng rng(1);
  for (int trial = 0; trial < 30; ++trial) {
    const Index n = 20;
    std::vector<Vec3> points;
    for (Index i = 0; i < n; ++i) points.push_back(random_point(rng));
    std::vector<Corners> triangles;
    for (int f = 0; f < 60; ++f) {
      triangles.push_back({below(rng, n), below(rng, n), below(rng, n)});
    }
    const auto length = [&](Index a, Index b) {
      const auto &p = points[at(a)], &q = points[at(b)];
      return std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);
    };
    std::map<std::pair<Index, Index>, int> edges;
    double smallest = 180, largest = 0, sum_smallest = 0, sum_q = 0;
    int count = 0, below = 0, above = 0;
    for (const auto& t : triangles) {
      if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) continue;
      ++count;
      double l[3], low = 180, high = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        l[k] = length(t[(k + 1) % 3], t[(k + 2) % 3]);
        ++edges[std::minmax(t[(k + 1) % 3], t[(k + 2) % 3])];
      }
      for (int k = 0; k < 3; ++k) {  // law of cosines
        const double a = l[k], b = l[(k + 1) % 3], c = l[(k + 2) % 3];
        const double angle = std::acos((b * b + c * c - a * a) / (2 * b * c)) * 180 / kPi;
        low = std::min(low, angle);
        high = std::max(high, angle);
      }
      const double s = (l[0] + l[1] + l[2]) / 2;  // Heron
      sum_q += 6 / std::sqrt(3) * std::sqrt(s * (s - l[0]) * (s - l[1]) * (s - l[2])) / (s * std::max({l[0], l[1], l[2]}));
      smallest = std::min(smallest, low);
      largest = std::max(largest, high);
      sum_smallest += low;
      below += low < 30;
      above += high > 90;
    }
    std::vector<int> degree(n, 0);
    std::set<Index> boundary;
    double sum_length = 0;
    for (const auto& [e, uses] : edges) {
      sum_length += length(e.first, e.second);
      ++degree[at(e.first)];
      ++degree[at(e.second)];
      if (uses == 1) boundary.insert({e.first, e.second});
    }
    std::array<Index, 16> valence{};
    for (Index v = 0; v < n; ++v) {
      const int d = degree[at(v)];
      if (d > 0 && boundary.count(v) == 0) ++valence[static_cast<std::size_t>(std::min(d, 15))];
    }
    const QualityReport q = quality(mesh_of(points, triangles));
    CHECK(q.triangles == count);
    CHECK(q.min_angle == Approx(smallest).epsilon(1e-9));
    CHECK(q.max_angle == Approx(largest).epsilon(1e-9));
    CHECK(q.mean_min_angle == Approx(sum_smallest / count).epsilon(1e-9));
    CHECK(q.mean_q == Approx(sum_q / count).epsilon(1e-9));
    CHECK(q.below_30 == Approx(100.0 * below / count));
    CHECK(q.above_90 == Approx(100.0 * above / count));
    CHECK(q.mean_edge == Approx(sum_length / static_cast<double>(edges.size())));
    CHECK(q.valence == valence);
  }
}

TEST_CASE("quality: angles are counted in bins of five degrees, each corner once") {
  const QualityReport grid = quality(right_triangle_grid(6));
  CHECK(grid.angles[9] + grid.angles[8] == 100);  // 45, up to rounding
  CHECK(grid.angles[18] + grid.angles[17] == 50);
  CHECK(grid.min_area == Approx(0.5));
  CHECK(grid.max_area == Approx(0.5));
  // 3, 4, 5: 36.87, 53.13, 90 degrees; two of the corners are well inside their bins.
  const QualityReport egypt = quality(one_triangle({0, 0, 0}, {4, 0, 0}, {0, 3, 0}));
  CHECK(egypt.angles[7] == 1);
  CHECK(egypt.angles[10] == 1);
  const QualityReport flat = quality(one_triangle({0, 0, 0}, {1, 0, 0}, {2, 0, 0}));
  CHECK(flat.angles[0] == 2);
  CHECK(flat.angles[35] == 1);
}

TEST_CASE("quality: ratios to the bounds of maximal sets are 1 where these are met") {
  const auto ratios_of = [](const Mesh& mesh, std::vector<double> radii) { return amps::bound_ratios(mesh, radii); };
  // Equilateral, of edges r: the shortest edges, half the longest, the least area.
  const double height = std::sqrt(3) / 2;
  const Mesh small = one_triangle({0, 0, 0}, {1, 0, 0}, {0.5, height, 0});
  amps::BoundRatios ratios = ratios_of(small, {1, 1, 1});
  CHECK(ratios.min_edge == Approx(1));
  CHECK(ratios.max_edge == Approx(0.5));
  CHECK(ratios.min_area == Approx(1));
  CHECK(ratios.max_area == Approx(1.0 / 3));
  CHECK(ratios.gradation == 0);
  // The same in a circle of radius r: edges √3 r, the greatest area.
  ratios = ratios_of(small, {1 / std::sqrt(3), 1 / std::sqrt(3), 1 / std::sqrt(3)});
  CHECK(ratios.max_edge == Approx(std::sqrt(3) / 2));
  CHECK(ratios.min_area == Approx(3));
  CHECK(ratios.max_area == Approx(1));
  // Edges r, r and √3 r, an angle of 120 degrees: the least area again. Edges r, √3 r and 2r: the longest.
  ratios = ratios_of(one_triangle({0, 0, 0}, {1, 0, 0}, {-0.5, height, 0}), {1, 1, 1});
  CHECK(ratios.min_area == Approx(1));
  CHECK(ratios.max_edge == Approx(std::sqrt(3) / 2));
  ratios = ratios_of(one_triangle({0, 0, 0}, {1, 0, 0}, {0, std::sqrt(3), 0}), {1, 1, 1});
  CHECK(ratios.max_edge == Approx(1));
  // A grid of right triangles with r its side: edges 1 and √2, areas ½.
  const Mesh grid = right_triangle_grid(6);
  ratios = ratios_of(grid, std::vector<double>(36, 1.0));
  CHECK(ratios.max_edge == Approx(std::sqrt(2) / 2));
  CHECK(ratios.min_area == Approx(2 / std::sqrt(3)));
  CHECK(ratios.max_area == Approx(2 / (3 * std::sqrt(3))));
  // Radii that grow by a tenth along x.
  std::vector<double> growing;
  for (int v = 0; v < 36; ++v) growing.push_back(0.3 + 0.1 * (v % 6));
  ratios = ratios_of(grid, growing);
  CHECK(ratios.gradation == Approx(0.1));
  CHECK(ratios.mean_gradation == Approx((30 * 0.1 + 25 * 0.1 / std::sqrt(2)) / 85));
  CHECK(ratios.max_edge == Approx(std::sqrt(2) / 0.7));
  CHECK(ratios.min_edge == Approx(1 / 0.8));

  CHECK(ratios_of(mesh_of({{0, 0, 0}}, {{0, 0, 0}}), {1}).max_edge == 0);
  CHECK_THROWS_AS(ratios_of(grid, {1, 1}), amps::Error);
  CHECK_THROWS_AS(ratios_of(small, {1, 0, 1}), amps::Error);
  CHECK_THROWS_AS(ratios_of(small, {1, 1, std::nan("")}), amps::Error);
}

TEST_CASE("quality: parts of a mesh have the quality of meshes, to the last bit") {
  Rng rng(21);
  for (const NamedMesh& named : small_meshes()) {
    CAPTURE(named.name);
    std::vector<Index> proper;  // no index repeated
    const auto& t = named.mesh.triangles;
    for (Index f = 0; f < rows(t); ++f) {
      if (t(f, 0) != t(f, 1) && t(f, 1) != t(f, 2) && t(f, 2) != t(f, 0)) proper.push_back(f);
    }
    const Mesh mesh = chosen_facets(named.mesh, proper);
    std::vector<char> part;
    std::vector<Index> facets[2];
    for (Index f = 0; f < rows(mesh.triangles); ++f) {
      part.push_back(rng.below(3) == 0 ? 0 : 1);
      facets[part.back() == 0 ? 0 : 1].push_back(f);
    }
    const amps::detail::MeshEdges edges(mesh.triangles, rows(mesh.vertices));
    const amps::detail::QualityOfParts found = amps::detail::quality_of_parts(mesh, edges, part, {});
    const auto text = [](const QualityReport& q) {
      std::ostringstream out;
      out << std::hexfloat;
      for (const double x : {q.min_angle, q.max_angle, q.mean_min_angle, q.below_30, q.above_90, q.min_edge, q.max_edge,
                             q.mean_edge, q.min_q, q.mean_q, q.min_area, q.max_area, q.area_ratio, q.valence_5_6_7}) {
        out << x << ' ';
      }
      out << q.triangles << ' ' << q.interior_vertices;
      for (const Index count : q.angles) out << ' ' << count;
      for (const Index count : q.valence) out << ' ' << count;
      return out.str();
    };
    CHECK(text(found.all) == text(quality(mesh)));
    for (const int k : {0, 1}) CHECK(text(found.parts[k]) == text(quality(chosen_facets(mesh, facets[k]))));
    CHECK(text(amps::detail::quality_of_parts(mesh, edges, {}, {}).all) == text(found.all));
  }
}

TEST_CASE("quality: printing tells the numbers and leaves the stream's format alone") {
  std::ostringstream out;
  out << std::hex << std::setprecision(3);
  out << quality(octahedron());
  CHECK(out.str().find("min 60.00") != std::string::npos);
  CHECK(out.str().find("4:6") != std::string::npos);
  out.str("");
  out << 255 << " " << 1.23456;
  CHECK(out.str() == "ff 1.23");
}

}  // namespace amps_test
