#include "amps/remesh.h"

#include "kit/bits.h"
#include "kit/errors.h"
#include "kit/execution.h"
#include "kit/models.h"
#include "kit/samples.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <set>
#include <string>
#include <vector>

namespace amps_test {

using amps::RemeshOptions;
using amps::RemeshResult;

namespace {

/// Extremes over the triangles whose corners have the full radius, measured here in long double: angles in degrees, absolute
/// edge lengths.
struct Extremes {
  double min_angle = 180, max_angle = 0, min_edge = INFINITY, max_edge = 0;
};

Extremes extremes_of(const Mesh& mesh, const SampleSet& samples, double radius) {
  using V = Eigen::Matrix<Real, 3, 1>;
  Extremes e;
  for (Index t = 0; t < rows(mesh.triangles); ++t) {
    const auto full = [&](int c) { return samples.radii[static_cast<std::size_t>(mesh.triangles(t, c))] == radius; };
    if (!full(0) || !full(1) || !full(2)) continue;  // beside a tight fold
    for (int k = 0; k < 3; ++k) {
      const auto corner = [&](int c) -> V { return MeshView(mesh).corner(t, (k + c) % 3).cast<Real>(); };
      const V u = corner(1) - corner(0), v = corner(2) - corner(0);
      const auto angle = static_cast<double>(std::atan2(u.cross(v).norm(), u.dot(v)) * 57.29577951308232087680L);
      const auto edge = static_cast<double>(u.norm());
      e.min_angle = std::min(e.min_angle, angle);
      e.max_angle = std::max(e.max_angle, angle);
      e.min_edge = std::min(e.min_edge, edge);
      e.max_edge = std::max(e.max_edge, edge);
    }
  }
  return e;
}

using Triple = Corners;

std::set<Triple> triples_of(const Mesh& mesh) {
  std::set<Triple> result;
  for (Index t = 0; t < rows(mesh.triangles); ++t) {
    Triple triple = {mesh.triangles(t, 0), mesh.triangles(t, 1), mesh.triangles(t, 2)};
    std::sort(triple.begin(), triple.end());
    CHECK(result.insert(triple).second);  // each once
  }
  return result;
}

/// The theorem of a uniform maximal set, and everything a result says about itself.
void check_remeshed(const Mesh& input, const RemeshResult& result, double radius,
                    amps::Neighborhood neighborhood = amps::Neighborhood::kSurface) {
  constexpr double kTolerance = 1e-9;
  // A handful of balls may have another topology than the surface, which is said.
  const bool of_balls = neighborhood == amps::Neighborhood::kSpace;
  REQUIRE((result.status == Outcome::kDone || (of_balls && result.status == Outcome::kShapeChanged)));
  REQUIRE(rows(result.mesh.triangles) > 0);
  const Extremes e = extremes_of(result.mesh, result.samples, radius);
  CHECK(e.min_angle >= 30 * (1 - kTolerance));
  CHECK(e.max_angle <= 120 * (1 + kTolerance));
  CHECK(e.min_edge >= radius * (1 - kTolerance));
  CHECK(e.max_edge <= 2 * radius * (1 + kTolerance));
  const amps::RemeshReport& report = result.report;
  if (amps::detail::min_radius(result.samples) == radius) {
    CHECK(report.quality.min_angle == doctest::Approx(e.min_angle).epsilon(1e-9));
    CHECK(report.quality.max_angle == doctest::Approx(e.max_angle).epsilon(1e-9));
    CHECK(report.quality.min_edge == doctest::Approx(e.min_edge).epsilon(1e-12));
    CHECK(report.quality.max_edge == doctest::Approx(e.max_edge).epsilon(1e-12));
  }
  CHECK(report.quality.triangles == rows(result.mesh.triangles));
  CHECK(report.sampling.radius == radius);
  CHECK(report.maximality.maximal());
  CHECK(report.maximality.poisson_disk());
  // Vertices are the samples, in order.
  CHECK(same_bits(result.mesh.vertices, result.samples.positions));
  CHECK(result.samples.facets.size() == static_cast<std::size_t>(result.samples.size()));
  CHECK(rows(result.samples.barycentrics) == result.samples.size());
  CHECK(least_index(result.mesh.triangles) >= 0);
  CHECK(greatest_index(result.mesh.triangles) < result.samples.size());
  CHECK(triples_of(result.mesh).size() == static_cast<std::size_t>(rows(result.mesh.triangles)));
  // Report and certificate are those of a fresh look.
  const amps::TopologyReport output = amps::topology(result.mesh);
  CHECK(report.output.euler_characteristic == output.euler_characteristic);
  CHECK(report.output.facets == output.facets);
  const amps::TopologyReport of_input = amps::topology(amps::merge_equal_vertices(input));
  CHECK(report.input.euler_characteristic == of_input.euler_characteristic);
  CHECK(report.input.components == of_input.components);
  if (report.curves.samples > 0) return;  // which verify_maximal() does not know
  const amps::MaximalityReport fresh = amps::verify_maximal(input, result.samples, {}, amps::ConflictRule::kMax, neighborhood);
  CHECK(report.maximality.worst_coverage == doctest::Approx(fresh.worst_coverage).epsilon(1e-12));
  CHECK(report.maximality.worst_separation == doctest::Approx(fresh.worst_separation).epsilon(1e-12));
}

/// The oracle: the triangles of sites whose equidistant line meets the surface in an odd number of points with no other site
/// nearer. All triples within `reach` of each other against all facets.
std::set<Triple> brute_force_triples(const Mesh& mesh, const SampleSet& set, double reach) {
  using V = Eigen::Matrix<Real, 3, 1>;
  const auto site = [&](Index s) -> V { return sample_at(set, s).cast<Real>(); };
  const Index n = set.size();
  std::set<Triple> result;
  const auto near = [&](Index s, Index t) { return (site(s) - site(t)).norm() <= static_cast<Real>(reach); };
  for (Index i = 0; i < n; ++i) {
    for (Index j = i + 1; j < n; ++j) {
      if (!near(i, j)) continue;
      for (Index k = j + 1; k < n; ++k) {
        if (!near(i, k) || !near(j, k)) continue;
        // Two planes: x·u = a, x·v = b.
        const V p = site(i), u = site(j) - p, v = site(k) - p;
        const Real a = u.dot(site(j) + p) / 2, b = v.dot(site(k) + p) / 2;
        for (Index f = 0; f < rows(mesh.triangles); ++f) {
          const auto corner = [&](int c) -> V { return MeshView(mesh).corner(f, c).cast<Real>(); };
          // With the third, λ_0 + λ_1 + λ_2 = 1, three equations for the barycentric coordinates.
          Eigen::Matrix<Real, 3, 3> m;
          for (int c = 0; c < 3; ++c) m.col(c) << corner(c).dot(u) - a, corner(c).dot(v) - b, 1;
          if (std::fabs(m.determinant()) < 1e-18L) continue;
          const V lambda = m.inverse() * V(0, 0, 1);
          if (lambda.minCoeff() < 0) continue;
          const V x = lambda[0] * corner(0) + lambda[1] * corner(1) + lambda[2] * corner(2);
          const Real distance = (x - p).norm();
          bool nearest = true;
          for (Index s = 0; s < n && nearest; ++s) {
            nearest = s == i || s == j || s == k || (x - site(s)).norm() >= distance;
          }
          // Mod 2: of two points one triangle is none.
          if (nearest && !result.insert({i, j, k}).second) result.erase({i, j, k});
        }
      }
    }
  }
  return result;
}

}  // namespace

TEST_CASE("remesh: all angles lie in [30°, 120°] and all edges in [r, 2r]") {
  for (const auto& model : procedural_models()) {
    CAPTURE(model.name);
    const auto& [name, mesh, radius] = model;
    for (const std::uint64_t seed : {1u, 2u}) {
      const RemeshResult result = amps::remesh(mesh, plain(with_radius(radius, seed)));
      check_remeshed(mesh, result, radius);
      CHECK(result.samples.size() > 2500);
      CHECK(result.report.output.non_manifold_edges == 0);
    }
  }
}

TEST_CASE("remesh: the bounds hold for a handful of samples, whatever the topology makes of them") {
  for (const auto& model : procedural_models()) {
    CAPTURE(model.name);
    const auto& [name, mesh, unused] = model;
    for (const Index count : {20, 60, 200}) {
      const double radius = radius_for(mesh, count);
      amps::RemeshOptions options = plain(with_radius(radius));
      options.sampling.neighborhood = amps::Neighborhood::kSpace;  // disks of a fold have less than the full radius
      const RemeshResult result = amps::remesh(mesh, options);
      check_remeshed(mesh, result, radius, amps::Neighborhood::kSpace);
    }
  }
}

TEST_CASE("remesh: triangles are those with a point of the surface nearest to their corners") {
  Rng rng(3);
  const std::vector<NamedMesh> meshes = {{"square", amps::make_square(2)},
                                         {"sphere", amps::make_sphere(180)},
                                         {"torus", amps::make_torus(1.0, 0.4, 16, 8)},
                                         {"cube", amps::make_cube(1)}};
  for (const auto& model : meshes) {
    CAPTURE(model.name);
    const auto& [name, mesh] = model;
    const double radius = radius_for(mesh, 70);
    const SampleSet set = amps::sample(mesh, with_radius(radius, 5)).samples;
    CHECK(triples_of(amps::restricted_triangulation(mesh, set)) == brute_force_triples(mesh, set, 2.01 * radius));
    // Of any other set too: random points, far from maximal, some of them off the surface.
    const amps::Box box = amps::bounding_box(mesh);
    const Points anywhere = made_points(25, [&](Index) {
      Vec3 x;
      for (int c = 0; c < 3; ++c) x[c] = box.min[c] + (box.max[c] - box.min[c] + 0.1) * rng.uniform();
      return x;
    });
    const SampleSet random = bare_set(anywhere, constant_values(25, 0.1));
    const std::set<Triple> expected = brute_force_triples(mesh, random, INFINITY);
    CHECK(expected.size() > 8);
    CHECK(triples_of(amps::restricted_triangulation(mesh, random)) == expected);
  }
}

TEST_CASE("remesh: on the square the triangles are the Delaunay triangles with their circumcentre in it") {
  const Mesh mesh = amps::make_square(1);
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const RemeshResult result = amps::remesh(mesh, plain(with_radius(0.11, seed)));
    const Index n = result.samples.size();
    REQUIRE(n > 40);
    const auto at = [&](Index s) { return Eigen::Vector2d(result.samples.positions(s, 0), result.samples.positions(s, 1)); };
    std::set<Triple> expected;
    for (Index i = 0; i < n; ++i) {
      for (Index j = i + 1; j < n; ++j) {
        for (Index k = j + 1; k < n; ++k) {
          const Eigen::Vector2d u = at(j) - at(i), v = at(k) - at(i);
          const double d = 2 * (u.x() * v.y() - u.y() * v.x());
          const Eigen::Vector2d centre = at(i) + Eigen::Vector2d(v.y() * u.squaredNorm() - u.y() * v.squaredNorm(),
                                                                 u.x() * v.squaredNorm() - v.x() * u.squaredNorm()) /
                                                     d;
          if (centre.minCoeff() < 0 || centre.maxCoeff() > 1) continue;
          bool empty = true;
          for (Index s = 0; s < n && empty; ++s) {
            empty = s == i || s == j || s == k || (at(s) - centre).norm() > (at(i) - centre).norm();
          }
          if (empty) expected.insert({i, j, k});
        }
      }
    }
    CHECK(triples_of(result.mesh) == expected);
    for (Index t = 0; t < rows(result.mesh.triangles); ++t) {  // upwards, as the square
      const Eigen::Vector2d a = at(result.mesh.triangles(t, 0)), b = at(result.mesh.triangles(t, 1)),
                            c = at(result.mesh.triangles(t, 2));
      CHECK((b - a).x() * (c - a).y() - (b - a).y() * (c - a).x() > 0);
    }
  }
}

TEST_CASE("remesh: with a small radius the output has the topology of the input") {
  const std::vector<NamedMesh> closed = {
      {"sphere", amps::make_sphere(1280)}, {"torus", amps::make_torus()}, {"knot", amps::make_knot()}};
  for (const auto& model : closed) {
    CAPTURE(model.name);
    const auto& [name, mesh] = model;
    const RemeshResult result = amps::remesh(mesh, plain(with_radius(radius_for(mesh, 4000))));
    const amps::TopologyReport &in = result.report.input, &out = result.report.output;
    CHECK(out.closed());
    CHECK(out.manifold());
    CHECK(out.components == 1);
    CHECK(out.genus() == (name == "sphere" ? 0 : 1));
    CHECK(out.euler_characteristic == in.euler_characteristic);
    CHECK(out.inconsistent_edges == 0);
    CHECK(out.vertices == result.samples.size());
    const double volume = signed_volume(mesh);
    REQUIRE(volume > 0);
    CHECK(signed_volume(result.mesh) == doctest::Approx(volume).epsilon(0.02));
  }
}

TEST_CASE("remesh: facets of the input that are turned over do not show in the output") {
  const auto flipped = [](const Mesh& mesh, double share, std::uint64_t seed) {
    Rng rng(seed);
    return flipped_where(mesh, [&](Index) { return rng.uniform() < share; });
  };
  for (const double share : {0.1, 0.3, 0.5, 0.9}) {
    CAPTURE(share);
    for (const Mesh& mesh : {amps::make_sphere(1280), amps::make_torus(), amps::make_cube(4)}) {
      const double radius = radius_for(mesh, 2000);
      const RemeshResult turned = amps::remesh(flipped(mesh, share, 7), plain(with_radius(radius)));
      check_remeshed(mesh, turned, radius);
      CHECK(turned.report.output.inconsistent_edges == 0);
      // Whatever the majority.
      CHECK(signed_volume(turned.mesh) == doctest::Approx(signed_volume(mesh)).epsilon(0.1));
    }
  }
  CHECK(signed_volume(amps::remesh(inside_out(amps::make_sphere(1280)), plain(with_radius(0.1))).mesh) < -4);
}

TEST_CASE("remesh: closed components whose facets disagree get a positive volume; others keep their majority") {
  // 44_cube_7_flipped.obj: 7 of 12 facets are turned over; and 11 of 12 of a cube beside it.
  const Mesh cube = amps::make_cube(1);
  const Mesh seven = flipped_where(cube, [](Index f) { return f < 7; });
  const Mesh eleven = flipped_where(moved(cube, {3, 0, 0}), [](Index f) { return f < 11; });
  const Mesh inward = inside_out(moved(cube, {6, 0, 0}));
  const double volume = signed_volume(cube);
  const Mesh mesh = joined(joined(seven, eleven), inward);
  const RemeshResult result = amps::remesh(mesh, plain(with_radius(0.1)));
  const amps::Mesh by_space = amps::restricted_triangulation(mesh, result.samples);
  const amps::Mesh by_surface =
      amps::restricted_triangulation(mesh, result.samples, {}, amps::Neighborhood::kSurface, result.graph.get());
  for (const Mesh* made : {&result.mesh, &by_space, &by_surface}) {
    std::array<double, 3> volumes{};
    for (Index t = 0; t < MeshView(*made).num_facets(); ++t) {
      const Vec3 a = MeshView(*made).corner(t, 0), b = MeshView(*made).corner(t, 1), c = MeshView(*made).corner(t, 2);
      volumes[a.x() > 4.5 ? 2 : a.x() > 1.5 ? 1 : 0] += a.dot(b.cross(c)) / 6;
    }
    CHECK(volumes[0] == doctest::Approx(volume).epsilon(0.1));
    CHECK(volumes[1] == doctest::Approx(volume).epsilon(0.1));
    CHECK(volumes[2] == doctest::Approx(-volume).epsilon(0.1));
  }
  // An open one has no volume: the majority stays.
  const Mesh square = amps::make_square(4);
  const Mesh most_down = flipped_where(square, [](Index f) { return f % 3 != 0; });
  const amps::RemeshResult down = amps::remesh(most_down, plain(with_radius(0.1)));
  CHECK(down.report.output.inconsistent_edges == 0);
  CHECK(amps::facet_normals(down.mesh)(0, 2) * amps::facet_normals(square)(0, 2) < 0);
}

TEST_CASE("remesh: each component is turned by itself") {
  const Mesh one = amps::make_sphere(320);
  const Mesh mesh = joined(one, moved(inside_out(one), {5, 0, 0}));
  const RemeshResult result = amps::remesh(mesh, plain(with_radius(0.1)));
  CHECK(result.report.output.components == 2);
  CHECK(result.report.output.inconsistent_edges == 0);
  std::vector<Index> facets[2];
  for (Index t = 0; t < rows(result.mesh.triangles); ++t) {
    facets[MeshView(result.mesh).corner(t, 0).x() > 2.5 ? 1 : 0].push_back(t);
  }
  CHECK(signed_volume(chosen_facets(result.mesh, facets[0])) > 3);
  CHECK(signed_volume(chosen_facets(result.mesh, facets[1])) < -3);
}

TEST_CASE("remesh: a given set has the same triangles, for any number of threads") {
  for (const auto& model : procedural_models()) {
    CAPTURE(model.name);
    const auto& [name, mesh, radius] = model;
    RemeshOptions options = plain(with_radius(1.5 * radius, 9));
    const RemeshResult result = amps::remesh(mesh, options);
    for (const unsigned threads : {1u, 2u, 0u}) {
      const Mesh again = amps::restricted_triangulation(mesh, result.samples, on_threads(threads));
      CHECK(same_bits(again.vertices, result.mesh.vertices));
      CHECK(same_values(again.triangles, result.mesh.triangles));
      run_on(options.sampling, threads);
      const RemeshResult repeated = amps::remesh(mesh, options);
      CHECK(same_bits(repeated.mesh.vertices, result.mesh.vertices));
      CHECK(same_values(repeated.mesh.triangles, result.mesh.triangles));
    }
  }
}

TEST_CASE("remesh: a wanted number of vertices is met within 1 %") {
  for (const Index count : {300, 3000}) {
    CAPTURE(count);
    const Mesh mesh = amps::make_torus();
    const RemeshResult result = amps::remesh(mesh, plain(with_count(count)));
    CHECK(std::fabs(rows(result.mesh.vertices) - count) <= 0.01 * count);
    check_remeshed(mesh, result, result.report.sampling.radius);
  }
}

TEST_CASE("remesh: the report says where the time went and what was there") {
  const Mesh mesh = amps::make_torus();
  const RemeshResult result = amps::remesh(mesh, plain(with_radius(0.05)));
  const amps::RemeshReport& report = result.report;
  CHECK(report.sampling.darts > 0);
  CHECK(report.sampling.dart_samples > 0);
  CHECK(report.sampling.dart_samples + report.sampling.gap_samples == result.samples.size());
  CHECK(report.sampling.seconds_darts > 0);
  CHECK(report.sampling.seconds_triangulation > 0);
  CHECK(report.sampling.seconds_diagram > 0);
  CHECK(report.sampling.seconds_gaps > 0);
  CHECK(report.seconds_remesh > 0);
  CHECK(report.seconds_report > 0);
  CHECK(report.quality.interior_vertices == result.samples.size());
  CHECK(report.quality.valence_5_6_7 > 90);
  CHECK(report.input.genus() == 1);
}

TEST_CASE("remesh: a soup is reported as what it is after merging") {
  const Mesh sphere = amps::make_sphere(320);
  const Mesh soup = soup_of(sphere);
  const RemeshResult result = amps::remesh(soup, plain(with_radius(0.1))),
                     whole = amps::remesh(sphere, plain(with_radius(0.1)));
  CHECK(result.report.input.components == 1);
  CHECK(result.report.input.closed());
  // Facets need no adjacency: the same samples, the same triangles.
  CHECK(same_bits(result.mesh.vertices, whole.mesh.vertices));
  CHECK(same_values(result.mesh.triangles, whole.mesh.triangles));
}

TEST_CASE("remesh: one sample, or two, have no triangle") {
  RemeshOptions options = plain(with_radius(10));
  options.topology = amps::Topology::kReport;
  const Mesh sphere = amps::make_sphere(320);
  const RemeshResult one = amps::remesh(sphere, options);
  CHECK(one.status == Outcome::kShapeChanged);
  CHECK(rows(one.mesh.vertices) == 1);
  CHECK(rows(one.mesh.triangles) == 0);
  CHECK(one.report.quality.triangles == 0);
  const SampleSet two = bare_set(points_of({{0, 0, 1}, {0, 0, -1}}), constant_values(2, 1));
  CHECK(rows(amps::restricted_triangulation(amps::make_sphere(320), two).triangles) == 0);
}

TEST_CASE("remesh: optimised unless told otherwise") {
  const Mesh mesh = amps::make_torus();
  RemeshOptions options;
  options.sampling.target_count = 3000;
  options.sampling.seed = 3;
  const RemeshResult result = amps::remesh(mesh, options);
  const amps::RemeshReport& report = result.report;
  CHECK(result.status == Outcome::kDone);
  CHECK(report.optimization.status == amps::Outcome::kDone);
  CHECK(std::fabs(result.samples.size() - 3000) <= 0.025 * 3000);
  CHECK(report.quality.min_angle >= 35);
  CHECK(report.quality.max_angle <= 105);
  CHECK(report.quality.valence_5_6_7 == 100);
  check_remeshed(mesh, result, report.sampling.radius);
  CHECK(same_values(amps::restricted_triangulation(mesh, result.samples).triangles, result.mesh.triangles));
}

TEST_CASE("remesh: cancelled, it returns what there is") {
  constexpr int kLooks = 18;  // some of the first go before the first dart
  const Mesh mesh = amps::make_torus();
  for (const std::string wanted : {"throwing darts", "triangulating samples", "dividing the surface", "filling gaps",
                                   "improving triangles", "building the mesh", "measuring the result"}) {
    CAPTURE(wanted);
    RemeshOptions options = plain(with_radius(0.04));
    options.optimize = true;
    int seen = 0;
    watch(options.sampling, [&](const char* stage, double) {
      seen += stage == wanted;
      return seen < kLooks;
    });
    const RemeshResult result = amps::remesh(mesh, options);
    CHECK(seen == kLooks);
    CHECK(result.status == Outcome::kCancelled);
    CHECK(result.samples.size() > 0);
    CHECK(same_bits(result.mesh.vertices, result.samples.positions));
    CHECK((rows(result.mesh.triangles) > 0) == (wanted == "measuring the result"));
    const bool maximal = wanted == "improving triangles" || wanted == "building the mesh" || wanted == "measuring the result";
    CHECK(amps::verify_maximal(mesh, result.samples).maximal() == maximal);
  }
}

TEST_CASE("remesh: errors are those of sampling") {
  const Mesh mesh = amps::make_sphere(320);
  CHECK(error_of([&] { amps::remesh(mesh, {}); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { amps::remesh(mesh, plain(with_radius(-1))); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { amps::remesh(mesh, plain(with_radius(kNaN))); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { amps::remesh(mesh, plain(with_radius(1e-7))); }) == ErrorCode::kTooLarge);
  CHECK(error_of([&] { amps::remesh(Mesh{}, plain(with_radius(1))); }) == ErrorCode::kInvalidMesh);
  CHECK(error_of([&] { amps::restricted_triangulation(mesh, {}); }) == ErrorCode::kInvalidArgument);
}

TEST_CASE("remesh: the same seed gives the same bits with every compiler and build type") {
  // Recorded once; the input has no coordinate from libm. A change of the algorithm may change these numbers, a compiler may
  // not.
  const auto hash = [](const RemeshResult& result) {
    return hash_bits(result.samples.positions, result.samples.barycentrics, result.mesh.triangles);
  };
  CHECK(hash(amps::remesh(amps::make_square(3), without_curves(plain(with_radius(0.02))))) == 1196673797265009837u);
  CHECK(hash(amps::remesh(amps::make_cube(7), without_curves(plain(with_radius(0.05))))) == 17352659914343580913u);
  CHECK(hash(amps::remesh(amps::make_square(3), plain(with_radius(0.02)))) == 292754891558762220u);
  CHECK(hash(amps::remesh(amps::make_cube(7), plain(with_radius(0.05)))) == 7335849244501721275u);
  RemeshOptions optimized = plain(with_radius(0.02));
  optimized.optimize = true;
  optimized.optimization.min_angle = 38;
  optimized.optimization.max_angle = 100;
  CHECK(hash(amps::remesh(amps::make_square(3), without_curves(optimized))) == 17850520281558684442u);
  CHECK(hash(amps::remesh(amps::make_cube(7), optimized)) == 17223665984752318728u);
}

TEST_CASE("remesh: scaled by a power of two, a mesh has the same angles, and is improved as far") {
  const Mesh torus = amps::make_torus(1, 0.4, 48, 20);
  for (const bool optimize : {false, true}) {
    RemeshOptions options = plain(with_radius(0.25));
    options.optimize = optimize;
    const RemeshResult one = amps::remesh(torus, options);
    for (const double factor : {0x1p330, 0x1p256, 0x1p-256, 0x1p-270, 0x1p-330}) {
      CAPTURE(factor);
      options.sampling.radius = 0.25 * factor;
      const RemeshResult other = amps::remesh(scaled(torus, factor), options);
      CHECK(other.status == one.status);
      if (optimize) {  // energies are rounded otherwise where products would leave the range of doubles
        CHECK(other.report.optimization.iterations.back().min_angle >= 35 - 1e-9);
        CHECK(other.report.quality.min_angle >= 35 - 1e-9);
        CHECK(other.report.quality.max_angle <= 105 + 1e-9);
        continue;
      }
      CHECK(other.samples.size() == one.samples.size());
      CHECK(other.report.quality.min_angle == doctest::Approx(one.report.quality.min_angle).epsilon(1e-9));
      CHECK(other.report.quality.max_angle == doctest::Approx(one.report.quality.max_angle).epsilon(1e-9));
    }
  }
}

TEST_CASE("remesh: what was cancelled claims nothing") {
  RemeshOptions options;
  options.sampling = with_radius(0.05);
  options.sampling.execution = amps::Execution(1, amps::Progress([](const char*, double fraction) { return fraction < 0.05; }));
  const RemeshResult result = amps::remesh(amps::make_sphere(2000), options);
  CHECK(result.status == Outcome::kCancelled);
  CHECK(!result.report.maximality.maximal());
  CHECK(!result.report.maximality.poisson_disk());
  CHECK(result.report.optimization.status == Outcome::kCancelled);
}

TEST_CASE("remesh: its status is that of the part that went worst") {
  const Mesh sphere = amps::make_sphere(320);
  RemeshOptions options = plain(with_radius(0.5));
  options.optimize = true;
  CHECK(amps::remesh(sphere, options).status == Outcome::kDone);
  options.optimization.min_angle = 59;
  options.optimization.max_angle = 61;
  const RemeshResult stalled = amps::remesh(sphere, options);
  CHECK(stalled.status == Outcome::kStalled);
  CHECK(stalled.report.optimization.status == Outcome::kStalled);
  CHECK(stalled.report.maximality.maximal());
  CHECK(rows(stalled.mesh.triangles) > 0);
  options.optimization.max_iterations = 1;
  CHECK(amps::remesh(sphere, options).status == Outcome::kIterationLimit);
  CHECK(amps::remesh(sphere, plain(with_radius(0.5))).status == Outcome::kDone);
  cancel(options.sampling);
  CHECK(amps::remesh(sphere, options).status == Outcome::kCancelled);
}

TEST_CASE("remesh: outcomes have names, from best to worst") {
  CHECK(amps::name_of(Outcome::kDone) == std::string("done"));
  CHECK(amps::name_of(Outcome::kIterationLimit) == std::string("iteration limit"));
  CHECK(amps::name_of(Outcome::kStalled) == std::string("stalled"));
  CHECK(amps::name_of(Outcome::kCountMissed) == std::string("count missed"));
  CHECK(amps::name_of(Outcome::kErrorMissed) == std::string("error missed"));
  CHECK(amps::name_of(Outcome::kShapeChanged) == std::string("shape changed"));
  CHECK(amps::name_of(Outcome::kCancelled) == std::string("cancelled"));
  CHECK(Outcome::kDone < Outcome::kIterationLimit);
  CHECK(Outcome::kIterationLimit < Outcome::kStalled);
  CHECK(Outcome::kStalled < Outcome::kCountMissed);
  CHECK(Outcome::kCountMissed < Outcome::kErrorMissed);
  CHECK(Outcome::kErrorMissed < Outcome::kShapeChanged);
  CHECK(Outcome::kShapeChanged < Outcome::kCancelled);
}

TEST_SUITE("slow") {
  TEST_CASE("remesh: all angles lie in [30°, 120°] and all edges in [r, 2r] on real models") {
    for (const auto& model : real_models()) {
      CAPTURE(model.name);
      const auto& [name, mesh, radius] = model;
      // At a coarse radius a model loses thin parts and handles, never the bounds.
      for (const double factor : {1.0, 3.0, 10.0}) {
        CAPTURE(factor);
        const RemeshResult result = amps::remesh(mesh, plain(with_radius(factor * radius)));
        check_remeshed(mesh, result, factor * radius);
        const Extremes e = extremes_of(result.mesh, result.samples, result.report.sampling.radius);
        MESSAGE(name << ": " << result.samples.size() << " vertices, angles " << e.min_angle << " to " << e.max_angle
                     << ", edges " << e.min_edge / (factor * radius) << " to " << e.max_edge / (factor * radius));
      }
    }
  }

  TEST_CASE("remesh: all angles lie in [30°, 120°] and all edges in [r, 2r] for large sets") {
    for (const auto& model : procedural_models()) {
      CAPTURE(model.name);
      const auto& [name, mesh, radius] = model;
      check_remeshed(mesh, amps::remesh(mesh, plain(with_radius(radius / 4))), radius / 4);
    }
  }
}

}  // namespace amps_test
