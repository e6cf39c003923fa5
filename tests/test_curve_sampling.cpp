#include "amps/curve_sampling.h"

#include "kit/basics.h"
#include "kit/data.h"
#include "kit/meshes.h"

#include "amps/curves.h"
#include "amps/predicates.h"
#include "amps/shapes.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <string>
#include <vector>

namespace amps_test {

using amps::ConflictRule;
using amps::Curve;
using amps::CurveGraph;
using amps::CurveOptions;
using amps::SurfacePoint;
using amps::detail::CapField;
using amps::detail::CurveSample;
using amps::detail::CurveSamples;
using amps::detail::CurveSamplingOptions;
using amps::detail::PlacedPoint;
using amps::detail::RadiusCap;
using amps::detail::Sample;
using amps::detail::SurfaceEdges;
using amps::detail::SurfaceFlood;
using amps::detail::WantedRadii;

namespace {

using Polygon = std::vector<Vec3>;  // in the plane z = 0, seen from `centre`

/// Between z = 0 and `height`; the ends are fans around the point (x, y) that sees the whole polygon.
Mesh prism(const Polygon& polygon, double height, double x = 0, double y = 0) {
  const auto n = static_cast<Index>(polygon.size());
  std::vector<Vec3> vertices;
  for (const Vec3& v : polygon) vertices.emplace_back(v.x(), v.y(), 0);
  for (const Vec3& v : polygon) vertices.emplace_back(v.x(), v.y(), height);
  vertices.emplace_back(x, y, 0);
  vertices.emplace_back(x, y, height);
  std::vector<Corners> triangles;
  for (Index k = 0; k < n; ++k) {
    const Index next = (k + 1) % n;
    triangles.push_back({k, next, n + next});
    triangles.push_back({k, n + next, n + k});
    triangles.push_back({next, k, 2 * n});
    triangles.push_back({n + k, n + next, 2 * n + 1});
  }
  return mesh_of(vertices, triangles);
}

Polygon regular(Index n, double radius = 1) {
  Polygon result;
  for (Index k = 0; k < n; ++k) result.emplace_back(radius * std::cos(2 * kPi * k / n), radius * std::sin(2 * kPi * k / n), 0);
  return result;
}

Polygon star(Index tips, double inner) {
  Polygon result;
  for (Index k = 0; k < 2 * tips; ++k) {
    const double radius = k % 2 == 0 ? 1 : inner;
    result.emplace_back(radius * std::cos(kPi * k / tips), radius * std::sin(kPi * k / tips), 0);
  }
  return result;
}

/// Two arms of this width, from the corner between them.
Mesh l_shape(double width) {
  const double w = width;
  return prism({{0, 0, 0}, {1, 0, 0}, {1, w, 0}, {w, w, 0}, {w, 1, 0}, {0, 1, 0}}, 0.5, w / 2, w / 2);
}

/// With this angle (degrees) between two of its three sides.
Mesh wedge(double angle) {
  const double half = angle / 2 * kDegree;
  const double x = std::cos(half), y = std::sin(half);
  return prism({{0, 0, 0}, {x, -y, 0}, {x, y, 0}}, 1, x / 2, 0);
}

Mesh cone(Index n, double height) {
  const Polygon base = regular(n);
  std::vector<Vec3> vertices = base;
  vertices.emplace_back(0, 0, 0);
  vertices.emplace_back(0, 0, height);
  std::vector<Corners> triangles;
  for (Index k = 0; k < n; ++k) {
    triangles.push_back({(k + 1) % n, k, n});
    triangles.push_back({k, (k + 1) % n, n + 1});
  }
  return mesh_of(vertices, triangles);
}

/// A sheet through rows of points: row k at (x_k, z_k), for y from 0 to 1 in `cells` steps.
Mesh sheet(const std::vector<std::array<double, 2>>& profile, Index cells) {
  std::vector<Vec3> vertices;
  for (const auto& [x, z] : profile) {
    for (Index j = 0; j <= cells; ++j) vertices.emplace_back(x, static_cast<double>(j) / cells, z);
  }
  std::vector<Corners> triangles;
  for (Index i = 0; i + 1 < static_cast<Index>(profile.size()); ++i) {
    for (Index j = 0; j < cells; ++j) {
      const Index a = i * (cells + 1) + j, b = a + cells + 1;
      triangles.push_back({a, b, b + 1});
      triangles.push_back({a, b + 1, a + 1});
    }
  }
  return mesh_of(vertices, triangles);
}

Mesh saw(Index teeth) {
  std::vector<std::array<double, 2>> profile;
  for (Index k = 0; k <= 2 * teeth; ++k) profile.push_back({0.5 * k / teeth, k % 2 == 0 ? 0.0 : 0.4});
  return sheet(profile, 3);
}

/// A strip between two helices.
Mesh ribbon(double inner, double pitch, Index turns) {
  constexpr Index kSteps = 60;
  std::vector<Vec3> vertices;
  std::vector<Corners> triangles;
  for (Index k = 0; k <= turns * kSteps; ++k) {
    const double t = 2 * kPi * k / kSteps;
    for (const double r : {inner, 1.0}) vertices.emplace_back(r * std::cos(t), r * std::sin(t), pitch * t / (2 * kPi));
    if (k == 0) continue;
    const Index a = 2 * (k - 1);
    triangles.push_back({a, a + 1, a + 3});
    triangles.push_back({a, a + 3, a + 2});
  }
  return mesh_of(vertices, triangles);
}

/// n³ boxes of edges up to a third of their distance.
Mesh many_boxes(Index n, std::uint64_t seed) {
  Rng rng(seed);
  const Mesh box = amps::make_cube(1);
  std::vector<Vec3> vertices;
  std::vector<Corners> triangles;
  for (Index i = 0; i < n * n * n; ++i) {
    const auto first = static_cast<Index>(vertices.size());
    const Vec3 corner(i % n, i / n % n, i / n / n), size(0.05 + 0.3 * rng.uniform(), 0.05 + 0.3 * rng.uniform(), 0.3);
    for (Index v = 0; v < MeshView(box).num_vertices(); ++v) {
      vertices.push_back((corner + MeshView(box).vertices[v].cwiseProduct(size)) / n);
    }
    for (Index f = 0; f < MeshView(box).num_facets(); ++f) {
      const auto& t = box.triangles;
      triangles.push_back({first + t(f, 0), first + t(f, 1), first + t(f, 2)});
    }
  }
  return mesh_of(vertices, triangles);
}

/// All that curves are sampled with.
struct Curves {
  Mesh mesh;
  SurfaceEdges edges;
  CurveGraph graph;
  SurfaceFlood flood;

  explicit Curves(Mesh of, const CurveOptions& options = {})
      : mesh(std::move(of)),
        edges(mesh),
        graph(amps::detail::find_curves(mesh, edges, options)),
        flood(mesh, edges, graph.is_curve_edge) {}

  CurveSamples sample(const WantedRadii& wanted, std::uint64_t seed = 1) const {
    CurveSamplingOptions options;
    options.seed = seed;
    return amps::detail::sample_curves(mesh, graph, flood, wanted, options);
  }
  CurveSamples sample(double radius, std::uint64_t seed = 1) const { return sample(uniform(radius), seed); }
  static WantedRadii uniform(double radius) { return {radius, ConflictRule::kMax}; }
};

double weight(const CurveSample& p) { return p.sample.radius * p.sample.radius; }
const Vec3& position(const CurveSample& p) { return p.sample.position(); }

Real squared_distance(const CurveSample& p, const CurveSample& q) {
  Real sum = 0;
  for (int k = 0; k < 3; ++k) {
    const Real d = static_cast<Real>(position(p)[k]) - position(q)[k];
    sum += d * d;
  }
  return sum;
}

bool is_spaced(const CurveSamples& samples, std::size_t curve) {
  const std::vector<Index>& unspaced = samples.report.unspaced;
  return !std::binary_search(unspaced.begin(), unspaced.end(), static_cast<Index>(curve));
}

/// Every sample lies where it says, in a facet, on its curve or corner.
void check_places(const Curves& curves, const CurveSamples& samples) {
  const CurveGraph& graph = curves.graph;
  REQUIRE(samples.samples.size() >= graph.corners.size());
  for (std::size_t s = 0; s < samples.samples.size(); ++s) {
    const CurveSample& p = samples.samples[s];
    const SurfacePoint& at = p.sample.at;
    CHECK(amps::detail::position_of(curves.mesh, at) == at.position);
    const auto homes = amps::detail::homes_of(curves.flood, p);
    CHECK(homes == curves.flood.homes(at));
    CHECK(std::binary_search(homes.begin(), homes.end(), at.facet));
    CHECK((p.corner == kNone) != (p.curve == kNone));
    CHECK((p.vertex == kNone) != (p.edge == amps::detail::MeshEdges::kNoEdge));
    CHECK((at.barycentric.array() == 0).count() == (p.vertex == kNone ? 1 : 2));
    CHECK((at.barycentric.array() >= 0).all());
    if (s < graph.corners.size()) {
      CHECK(p.corner == static_cast<Index>(s));
      CHECK(p.vertex == graph.corners[s]);
      CHECK(at.position == curves.flood.position(p.vertex));
      continue;
    }
    REQUIRE(p.curve != kNone);
    const Curve& curve = graph.curves[amps_test::at(p.curve)];
    CHECK(p.parameter >= 0);
    CHECK(p.parameter <= curve.length());
    // The point at its parameter, by walking there.
    std::size_t k = 0;
    while (k + 2 < curve.arc.size() && curve.arc[k + 1] < p.parameter) ++k;
    const Vec3 a = curves.flood.position(curve.vertices[k]), b = curves.flood.position(curve.vertices[k + 1]);
    const Vec3 x = a + (p.parameter - curve.arc[k]) / (curve.arc[k + 1] - curve.arc[k]) * (b - a);
    CHECK((x - at.position).norm() <= 1e-8 * (curve.arc[k + 1] - curve.arc[k]) + 1e-14 * at.position.norm());
  }
}

/// What the header says about neighbours, and that pairs run along the curves. Curves in report.unspaced may break protection.
void check_chords(const Curves& curves, const CurveSamples& samples) {
  const CurveGraph& graph = curves.graph;
  REQUIRE(samples.first_edge.size() == graph.curves.size() + 1);
  CHECK(samples.first_edge.back() == samples.edges.size());
  std::map<std::array<Index, 2>, int> pairs;
  std::vector<char> met(samples.samples.size(), 0);
  for (std::size_t c = 0; c < graph.curves.size(); ++c) {
    const Curve& curve = graph.curves[c];
    const bool spaced = is_spaced(samples, c);
    const std::size_t begin = samples.first_edge[c], end = samples.first_edge[c + 1];
    REQUIRE(end > begin);
    CHECK(end - begin >= (curve.closed || curve.first_corner == curve.last_corner ? 3u : 1u));
    CHECK(samples.edges[begin][0] == (curve.closed ? samples.edges[end - 1][1] : curve.first_corner));
    if (!curve.closed) CHECK(samples.edges[end - 1][1] == curve.last_corner);
    double last = -1;
    for (std::size_t e = begin; e < end; ++e) {
      const auto [i, j] = samples.edges[e];
      if (e > begin) CHECK(i == samples.edges[e - 1][1]);
      ++pairs[{std::min(i, j), std::max(i, j)}];
      const CurveSample &p = samples.samples[at(i)], &q = samples.samples[at(j)];
      if (p.corner == kNone) {
        CHECK(p.curve == static_cast<Index>(c));
        CHECK(p.parameter > last);
        last = p.parameter;
        CHECK(met[at(i)]++ == 0);
      }
      CHECK(amps::detail::are_apart(p.sample, q.sample, ConflictRule::kMax));
      if (spaced) CHECK(squared_distance(p, q) < static_cast<Real>(weight(p)) + weight(q));
    }
  }
  for (std::size_t s = graph.corners.size(); s < met.size(); ++s) CHECK(met[s] == 1);
  for (const auto& [pair, times] : pairs) CHECK(times == 1);
}

/// No disk holds another sample: each with each.
void check_conflicts(const Curves& curves, const CurveSamples& samples) {
  SurfaceFlood::Scratch scratch;
  const auto n = samples.samples.size();
  for (std::size_t i = 0; i < n; ++i) {
    const CurveSample& p = samples.samples[i];
    const PlacedPoint from{position(p), amps::detail::homes_of(curves.flood, p)};
    for (std::size_t j = 0; j < n; ++j) {
      const CurveSample& q = samples.samples[j];
      if (i == j || amps::side_of_ball(position(q).data(), position(p).data(), weight(p)) >= 0) continue;
      const PlacedPoint to{position(q), amps::detail::homes_of(curves.flood, q)};
      CHECK_FALSE(curves.flood.holds(from, weight(p), to, scratch));
    }
  }
}

/// Radii are at most the wanted ones, and grow no faster than the gradation along curves.
void check_radii(const Curves& curves, const CurveSamples& samples, const WantedRadii& wanted) {
  for (const CurveSample& p : samples.samples) {
    CHECK(p.sample.radius > 0);
    CHECK(p.sample.radius <= wanted.at(p.sample.at));
  }
  if (!wanted.constant() || samples.report.forced > 0) return;
  for (std::size_t c = 0; c < curves.graph.curves.size(); ++c) {
    if (!is_spaced(samples, c)) continue;
    const double length = curves.graph.curves[c].length();
    for (std::size_t e = samples.first_edge[c]; e < samples.first_edge[c + 1]; ++e) {
      const CurveSample &p = samples.samples[at(samples.edges[e][0])], &q = samples.samples[at(samples.edges[e][1])];
      const double from = p.corner != kNone ? 0 : p.parameter;
      double to = q.corner != kNone ? length : q.parameter;
      if (to <= from) to += length;
      const double most = amps::detail::kCurveGradation * (to - from) * (1 + 1e-9);
      // A corner may keep a radius beyond those of its curves.
      if (q.corner == kNone) CHECK(q.sample.radius <= p.sample.radius + most);
      if (p.corner == kNone) CHECK(p.sample.radius <= q.sample.radius + most);
    }
  }
}

void check_laws(const Curves& curves, const CurveSamples& samples, const WantedRadii& wanted) {
  check_places(curves, samples);
  check_chords(curves, samples);
  check_conflicts(curves, samples);
  check_radii(curves, samples, wanted);
}

bool same(const CurveSamples& a, const CurveSamples& b) {
  if (a.samples.size() != b.samples.size() || a.edges != b.edges) return false;
  for (std::size_t s = 0; s < a.samples.size(); ++s) {
    const CurveSample &p = a.samples[s], &q = b.samples[s];
    if (position(p) != position(q) || p.sample.radius != q.sample.radius || p.parameter != q.parameter) return false;
  }
  return true;
}

std::vector<NamedMesh> many_meshes() {
  return {{"cube", amps::make_cube(1)},
          {"cube of fine facets", amps::make_cube(20)},
          {"soup of a cube", soup_of(amps::make_cube(3))},
          {"cylinder", prism(regular(96), 1.5)},
          {"flat cylinder", prism(regular(96), 0.04)},
          {"cone", cone(64, 1.5)},
          {"wedge of 7°", wedge(7)},
          {"wedge of 15°", wedge(15)},
          {"wedge of 30°", wedge(30)},
          {"wedge of 55°", wedge(55)},
          {"wedge of 60°", wedge(60)},
          {"plate", prism({{-0.5, -0.5, 0}, {0.5, -0.5, 0}, {0.5, 0.5, 0}, {-0.5, 0.5, 0}}, 0.01)},
          {"saw", saw(7)},
          {"L", l_shape(0.3)},
          {"narrow L", l_shape(0.03)},
          {"square", amps::make_square(7)},
          {"Möbius strip", moebius_strip(48, 4)},
          {"three sheets", open_book(3)},
          {"star", prism(star(5, 0.4), 0.3)},
          {"pointed star", prism(star(9, 0.15), 0.3)},
          {"helices", ribbon(0.9, 0.1, 3)},
          {"narrow helices", ribbon(0.99, 0.5, 2)},
          {"boxes", many_boxes(3, 5)},
          {"triangle", one_triangle({0, 0, 0}, {1, 0, 0}, {0.3, 0.02, 0})}};
}

/// Of edges of length 1 or so: many samples, a few, hardly one.
constexpr double kRadii[] = {0.03, 0.1, 0.35};

}  // namespace

TEST_CASE("curve_sampling: the laws, on meshes of many kinds") {
  for (const NamedMesh& named : many_meshes()) {
    const Curves curves(named.mesh);
    for (const double radius : kRadii) {
      for (const std::uint64_t seed : {1u, 2u}) {
        CAPTURE(named.name);
        CAPTURE(radius);
        const CurveSamples samples = curves.sample(radius, seed);
        CHECK(samples.report.unspaced.empty());
        CHECK(samples.report.corners == static_cast<Index>(curves.graph.corners.size()));
        check_laws(curves, samples, Curves::uniform(radius));
      }
    }
  }
}

TEST_CASE("curve_sampling: radii are full where nothing forces less, and about as many samples as that needs") {
  const auto full = [](const Mesh& mesh, double radius) {
    const Curves curves(mesh);
    double length = 0;
    for (const Curve& curve : curves.graph.curves) length += curve.length();
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const CurveSamples samples = curves.sample(radius, seed);
      CHECK(samples.report.lowered == 0);
      CHECK(samples.caps.empty());
      const double expected = length / (1.22 * radius);
      CHECK(static_cast<double>(samples.edges.size()) > 0.93 * expected);
      CHECK(static_cast<double>(samples.edges.size()) < 1.1 * expected);
    }
  };
  full(amps::make_cube(1), 0.03);
  full(amps::make_cube(20), 0.03);
  full(amps::make_square(1), 0.04);
  full(wedge(60), 0.03);
  full(prism(regular(200), 1), 0.05);
  full(prism(regular(6), 1), 0.05);
  full(open_book(3), 0.03);
}

TEST_CASE("curve_sampling: acute corners keep their radius, and the samples beside them come down") {
  for (const double angle : {7.0, 15.0, 30.0, 45.0}) {
    CAPTURE(angle);
    const Curves curves(wedge(angle));
    const double radius = 0.04;
    const CurveSamples samples = curves.sample(radius);
    CHECK(samples.report.lowered > 0);
    Index on_ridge = 0;
    for (std::size_t s = 0; s < curves.graph.corners.size(); ++s) {
      const CurveSample& p = samples.samples[s];
      if (position(p).x() != 0) continue;
      ++on_ridge;
      CHECK(p.sample.radius == radius);
    }
    CHECK(on_ridge == 2);
    double first = kInfinity, radius_there = 0;
    // The disks of the two sides' samples stay off the other side.
    for (const CurveSample& p : samples.samples) {
      if (p.corner != kNone || position(p).x() == 0) continue;
      const bool at_end = position(p).z() == 0 || position(p).z() == 1;
      if (!at_end || position(p).x() > 0.5) continue;
      const double to_corner = std::hypot(position(p).x(), position(p).y());
      CHECK(to_corner >= radius);
      if (to_corner < first) radius_there = p.sample.radius;
      first = std::min(first, to_corner);
      CHECK(p.sample.radius <= to_corner * std::sin(angle * kDegree) * (1 + 1e-9));
    }
    CHECK(radius_there > 0.9 * radius * std::sin(angle * kDegree));
  }
}

TEST_CASE("curve_sampling: no two pieces have the same ends, however large the radius") {
  // A lens: two arcs that meet at right angles; and loops, from corners and without.
  Polygon lens;
  for (const double side : {1.0, -1.0}) {
    for (Index k = 0; k < 12; ++k) {
      const double angle = kPi / 4 - kPi / 2 * k / 12;
      lens.emplace_back(side * (std::cos(angle) - std::sqrt(0.5)), side * std::sin(angle), 0);
    }
  }
  CurveOptions with_corner;
  with_corner.vertices = {0};
  const Curves all[] = {Curves(prism(lens, 50)), Curves(prism(regular(48), 50)), Curves(prism(regular(48), 50), with_corner)};
  for (const Curves& curves : all) {
    for (const double radius : {0.3, 0.6, 1.0, 1.5, 1.8, 2.0, 2.4, 3.0, 10.0}) {
      CAPTURE(radius);
      const CurveSamples samples = curves.sample(radius);
      CHECK(samples.report.unspaced.empty());
      check_laws(curves, samples, Curves::uniform(radius));
    }
  }
}

TEST_CASE("curve_sampling: another curve counts only where a flood gets to it") {
  // Two squares at a distance below the radius: no flood gets from one to the other.
  const Curves apart(two_sheets(0.01));
  CHECK(apart.sample(0.05).report.lowered == 0);
  // The same as the bottom and the top of a plate: the strip between them has curves on both sides.
  const Curves plate(prism({{-0.5, -0.5, 0}, {0.5, -0.5, 0}, {0.5, 0.5, 0}, {-0.5, 0.5, 0}}, 0.01));
  const CurveSamples close = plate.sample(0.05);
  CHECK(close.report.unspaced.empty());
  for (const CurveSample& p : close.samples) CHECK(p.sample.radius < 0.0100001);
  // A rim that comes near itself.
  Polygon stadium;
  for (Index k = 0; k <= 16; ++k) stadium.emplace_back(0.5 + 0.02 * std::sin(kPi * k / 16), -0.02 * std::cos(kPi * k / 16), 0);
  for (Index k = 0; k <= 16; ++k) stadium.emplace_back(-0.5 - 0.02 * std::sin(kPi * k / 16), 0.02 * std::cos(kPi * k / 16), 0);
  const Curves rims(prism(stadium, 1));
  const CurveSamples around = rims.sample(0.2);
  CHECK(rims.graph.curves.size() == 2);
  CHECK(around.report.unspaced.empty());
  for (const CurveSample& p : around.samples) {
    if (std::abs(position(p).x()) < 0.45) CHECK(p.sample.radius < 0.0400001);
  }
  // A folded sheet: its sides' borders are near in space, far along the surface.
  std::vector<std::array<double, 2>> fold;
  for (Index k = 0; k <= 20; ++k) fold.push_back({0, 0.05 * k});
  for (Index k = 1; k < 12; ++k) fold.push_back({0.01 - 0.01 * std::cos(kPi * k / 12), 1 + 0.01 * std::sin(kPi * k / 12)});
  for (Index k = 20; k >= 0; --k) fold.push_back({0.02, 0.05 * k});
  const Curves fold_curves(sheet(fold, 3));
  CHECK(fold_curves.graph.num_patches == 1);
  const CurveSamples folded = fold_curves.sample(0.08);
  CHECK(folded.report.unspaced.empty());
  Index near_rim = 0, lowered_there = 0;
  for (const CurveSample& p : folded.samples) {
    if (position(p).z() > 0.6 || p.corner != kNone) continue;
    ++near_rim;
    lowered_there += p.sample.radius < 0.08 ? 1 : 0;
  }
  CHECK(near_rim > 10);
  CHECK(lowered_there == 0);
}

TEST_CASE("curve_sampling: at random, and the same again from the same seed") {
  const Curves curves(amps::make_square(1));
  const double radius = 0.02;
  const CurveSamples first = curves.sample(radius, 1);
  CHECK(same(first, curves.sample(radius, 1)));
  CHECK_FALSE(same(first, curves.sample(radius, 2)));
  double sum = 0, sum_of_squares = 0;
  for (const auto& [p, q] : first.edges) {
    const double d = (position(first.samples[at(p)]) - position(first.samples[at(q)])).norm() / radius;
    sum += d;
    sum_of_squares += d * d;
  }
  const auto n = static_cast<double>(first.edges.size());
  const double mean = sum / n, spread = std::sqrt(sum_of_squares / n - mean * mean);
  CHECK(mean > 1.15);
  CHECK(mean < 1.27);
  CHECK(spread / mean > 0.06);
  // Closed curves begin anywhere.
  const Curves cylinder(prism(regular(96), 1));
  CHECK(cylinder.sample(0.1, 1).samples[0].parameter != cylinder.sample(0.1, 2).samples[0].parameter);
}

TEST_CASE("curve_sampling: long curves, which are cut into sections") {
  for (const Mesh& mesh : {prism(regular(200), 1), amps::make_square(1)}) {
    const Curves curves(mesh);
    const double radius = 0.0015;
    const CurveSamples samples = curves.sample(radius);
    CHECK(samples.report.lowered == 0);
    CHECK(samples.report.unspaced.empty());
    check_laws(curves, samples, Curves::uniform(radius));
  }
}

TEST_CASE("curve_sampling: soups, slivers, facets that cross") {
  Rng rng(11);
  for (std::uint64_t k = 0; k < 40; ++k) {
    CAPTURE(k);
    const Curves curves(k % 2 == 0 ? hard_soup(20, rng) : random_soup(30, 100 + k));
    for (const double radius : {0.1, 0.35}) {
      try {
        const CurveSamples samples = curves.sample(radius, k);
        check_chords(curves, samples);
        check_radii(curves, samples, Curves::uniform(radius));
        if (samples.report.forced == 0) CHECK(samples.report.unspaced.empty());
        constexpr std::size_t kMostPairs = 4000;
        if (samples.samples.size() < kMostPairs) check_laws(curves, samples, Curves::uniform(radius));
      } catch (const Error& error) {
        CHECK(error.code() == ErrorCode::kTooLarge);
      }
    }
  }
}

TEST_CASE("curve_sampling: varying radii") {
  for (const NamedMesh& named : many_meshes()) {
    CAPTURE(named.name);
    const Curves curves(named.mesh);
    const auto radius = [](const SurfacePoint& x) { return 0.02 + 0.1 * std::abs(x.position.x() - 0.3); };
    const WantedRadii wanted(amps::function_sizing(curves.mesh, radius), ConflictRule::kMax);
    const CurveSamples samples = curves.sample(wanted);
    CHECK(samples.report.unspaced.empty());
    check_laws(curves, samples, wanted);
    CHECK(same(samples, curves.sample(wanted)));
  }
  // One value on either side of a line, another one beyond: steeper than any gradation.
  const Curves curves(amps::make_square(8));
  std::vector<double> radii;
  for (Index v = 0; v < MeshView(curves.mesh).num_vertices(); ++v) {
    radii.push_back(MeshView(curves.mesh).vertices[v].x() < 0.5 ? 0.004 : 0.2);
  }
  const WantedRadii steep(amps::vertex_sizing(curves.mesh, radii), ConflictRule::kMax);
  check_laws(curves, curves.sample(steep), steep);
}

TEST_CASE("curve_sampling: limits below the wanted radius") {
  const Curves curves(amps::make_cube(4));
  const CapField limits({{Vec3(0, 0, 0), 0.01}, {Vec3(1, 0.5, 1), 0.002}}, amps::detail::kCapGradation);
  CurveSamplingOptions options;
  options.limits = &limits;
  const WantedRadii wanted = Curves::uniform(0.1);
  const CurveSamples samples = amps::detail::sample_curves(curves.mesh, curves.graph, curves.flood, wanted, options);
  CHECK(samples.report.unspaced.empty());
  check_laws(curves, samples, wanted);
  for (const CurveSample& p : samples.samples) CHECK(p.sample.radius <= limits.at(position(p), 0.1));
  // Curves that the limits do not touch have the samples that they had without.
  const CurveSamples without = curves.sample(0.1);
  Index same_curves = 0;
  for (std::size_t c = 0; c < curves.graph.curves.size(); ++c) {
    std::vector<double> a, b;
    for (const CurveSample& p : samples.samples) {
      if (p.curve == static_cast<Index>(c)) a.push_back(p.parameter);
    }
    for (const CurveSample& p : without.samples) {
      if (p.curve == static_cast<Index>(c)) b.push_back(p.parameter);
    }
    same_curves += a == b ? 1 : 0;
  }
  CHECK(same_curves >= 5);
  CHECK(same_curves < 12);
}

TEST_CASE("curve_sampling: caps for faces") {
  const CurveSamples samples = Curves(wedge(15)).sample(0.05);
  CHECK(samples.caps.caps().size() == static_cast<std::size_t>(samples.report.lowered));
  for (const CurveSample& p : samples.samples) {
    if (p.sample.radius < 0.0499) CHECK(samples.caps.at(position(p), 1) <= p.sample.radius);
  }
}

TEST_CASE("curve_sampling: what is refused") {
  const Curves curves(amps::make_cube(1));
  try {
    curves.sample(WantedRadii(0.1, ConflictRule::kMin));
    FAIL("the min rule was taken");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::kInvalidArgument);
  }
  try {
    curves.sample(1e-9);
    FAIL("10^10 samples were begun");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::kTooLarge);
  }
  // Without curves there is nothing to do.
  const CurveSamples none = Curves(amps::make_sphere(320)).sample(0.1);
  CHECK(none.samples.empty());
  CHECK(none.edges.empty());
  CHECK(none.caps.empty());
}

TEST_CASE("curve_sampling: marked edges, marked corners, labels") {
  const Mesh mesh = amps::make_square(20);
  const auto vertex = [&](double x, double y) {
    const auto distance = [&](Index v) { return (MeshView(mesh).vertices[v] - Vec3(x, y, 0)).norm(); };
    Index best = 0;
    for (Index v = 0; v < MeshView(mesh).num_vertices(); ++v) best = distance(v) < distance(best) ? v : best;
    return best;
  };
  CurveOptions options;
  options.vertices = {vertex(0.5, 0.5), vertex(0.55, 0.5), vertex(0.3, 0.05), vertex(0.4, 0)};  // three that no curve meets
  for (int k = 0; k < 8; ++k) {  // a curve that ends within the square
    options.edges.push_back({vertex(0.05 * k, 0.8), vertex(0.05 * (k + 1), 0.8)});
  }
  for (Index f = 0; f < MeshView(mesh).num_facets(); ++f) {
    const Vec3 centre = (MeshView(mesh).corner(f, 0) + MeshView(mesh).corner(f, 1) + MeshView(mesh).corner(f, 2)) / 3;
    options.labels.push_back((centre - Vec3(0.7, 0.3, 0)).norm() < 0.15 ? 1 : 0);
  }
  const Curves curves(mesh, options);
  for (const double radius : {0.02, 0.1, 0.4}) {
    CAPTURE(radius);
    const CurveSamples samples = curves.sample(radius);
    CHECK(samples.report.unspaced.empty());
    check_laws(curves, samples, Curves::uniform(radius));
  }
}

TEST_CASE("curve_sampling: can be watched and stopped") {
  const Curves curves(many_boxes(3, 5));
  double last = 0;
  CurveSamplingOptions options;
  const auto watch = [&](const char*, double fraction) {
    CHECK(fraction >= last);
    last = fraction;
    return true;
  };
  options.execution.progress = amps::Progress(watch, 0);
  const WantedRadii wanted = Curves::uniform(0.05);
  const CurveSamples watched = amps::detail::sample_curves(curves.mesh, curves.graph, curves.flood, wanted, options);
  CHECK(last == 1);
  CHECK(same(watched, curves.sample(0.05)));
  for (const double stop : {0.01, 0.1, 0.5, 0.92}) {
    options.execution.progress = amps::Progress([&](const char*, double fraction) { return fraction < stop; }, 0);
    try {
      amps::detail::sample_curves(curves.mesh, curves.graph, curves.flood, wanted, options);
      FAIL("went on to the end");
    } catch (const Error& error) {
      CHECK(error.code() == ErrorCode::kCancelled);
    }
  }
}

TEST_CASE("curve_sampling: thousands of small parts" * doctest::test_suite("slow")) {
  const Curves curves(many_boxes(14, 7));
  for (const double radius : {0.2, 0.02, 0.005}) {
    const CurveSamples samples = curves.sample(radius);
    CHECK(samples.report.unspaced.empty());
    check_chords(curves, samples);
    check_radii(curves, samples, Curves::uniform(radius));
  }
}

TEST_CASE("curve_sampling: real meshes") {
  for (const char* const name :
       {"fandisk.obj", "anchor.off", "cube_twist.obj", "thingi_65004.stl", "lion-head.off", "maxFace.obj"}) {
    CAPTURE(name);
    const Mesh mesh = data_mesh_or(name, prism(star(9, 0.15), 0.3));
    const double radius = std::sqrt(0.6965 * amps::total_area(mesh) / 3000);
    CurveOptions options;
    options.radius = radius;
    const Curves curves(mesh, options);
    const CurveSamples samples = curves.sample(radius);
    CHECK(samples.report.unspaced.empty());
    check_laws(curves, samples, Curves::uniform(radius));
  }
}

}  // namespace amps_test
