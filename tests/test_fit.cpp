// Vertices that leave the surface: what falls (distance, error of volume), what stays (planes, curves, bounds), and what must
// not happen (sheets that pull at each other, seams that open).
#include "amps/fit.h"

#include "kit/data.h"
#include "kit/errors.h"
#include "kit/execution.h"
#include "kit/meshes.h"

#include "amps/quality.h"
#include "amps/remesh.h"
#include "amps/self_intersections.h"
#include "amps/shapes.h"
#include "amps/surface_distance.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

using amps::Fit;
using amps::fit_vertices;
using amps::FitOptions;
using amps::FitReport;
using amps::Points;

namespace {

constexpr std::array<Fit, 2> kKinds = {Fit::kNormal, Fit::kFree};

FitOptions options_of(Fit fit) {
  FitOptions options;
  options.fit = fit;
  return options;
}

/// With room for triangles that are all much the same.
FitOptions loose_options(Fit fit) {
  FitOptions options = options_of(fit);
  options.min_angle = 30;
  options.max_angle = 120;
  options.min_edge = 1e-6;
  options.max_edge = kInfinity;
  return options;
}

amps::RemeshResult remeshed(const Mesh& mesh, Index count, bool optimize = true) {
  amps::RemeshOptions options;
  options.sampling.target_count = count;
  options.optimize = optimize;
  return amps::remesh(mesh, options);
}

Mesh fitted(const Mesh& input, Mesh mesh, const FitOptions& options, FitReport* report = nullptr) {
  mesh.vertices = fit_vertices(input, mesh, options, report);
  return mesh;
}

double rms(const Mesh& input, const Mesh& mesh) {
  amps::DistanceOptions options;
  options.tolerance = 1e-2;
  return amps::surface_distance(input, mesh, options).rms();
}

Vec3 vertex(const Points& points, Index v) { return points.row(v).transpose(); }

double farthest_move(const Points& a, const Points& b) {
  double result = 0;
  for (Index v = 0; v < rows(a); ++v) result = std::max(result, (vertex(a, v) - vertex(b, v)).norm());
  return result;
}

/// Edges of one facet of `mesh`, by vertices.
std::vector<std::array<Index, 2>> border_of(const Mesh& mesh) {
  std::vector<std::array<Index, 2>> sides, result;
  for (Index f = 0; f < rows(mesh.triangles); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index a = mesh.triangles(f, k), b = mesh.triangles(f, (k + 1) % 3);
      sides.push_back({std::min(a, b), std::max(a, b)});
    }
  }
  for (const auto& side : sides) {
    if (std::count(sides.begin(), sides.end(), side) == 1) result.push_back(side);
  }
  return result;
}

/// The edges of a cube of n cells a side, by vertices.
std::vector<std::array<Index, 2>> creases_of_cube(const Mesh& cube) {
  const auto walls = [](const Vec3& x) {
    int count = 0;
    for (int k = 0; k < 3; ++k) count += x[k] == 0 || x[k] == 1;
    return count;
  };
  std::vector<std::array<Index, 2>> result;
  for (Index f = 0; f < rows(cube.triangles); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index a = cube.triangles(f, k), b = cube.triangles(f, (k + 1) % 3);
      const Vec3 x = vertex(cube.vertices, a), y = vertex(cube.vertices, b);
      if (a < b && walls(x) >= 2 && walls(y) >= 2 && walls((x + y) / 2) == 2) result.push_back({a, b});
    }
  }
  return result;
}

/// The upper half of a sphere, its border on z = 0.
Mesh half_sphere(Index facets) {
  return transformed(amps::make_square(static_cast<Index>(std::sqrt(facets / 2.0))), [](const Vec3& p) -> Vec3 {
    // The square to the disk, concentric squares to circles, and up.
    const double u = 2 * p.x() - 1, v = 2 * p.y() - 1, r = std::max(std::abs(u), std::abs(v));
    const double length = std::hypot(u, v);
    if (length == 0) return {0, 0, 1};
    const double height = 1 - r * r;
    const double flat = std::sqrt(1 - height * height) / length;
    return {u * flat, v * flat, height};
  });
}

}  // namespace

TEST_CASE("fit: the residual falls, and so does the distance; triangles and bounds stay") {
  const std::vector<std::pair<std::string, Mesh>> inputs = {{"sphere", amps::make_sphere(5120)},
                                                            {"torus", amps::make_torus()},
                                                            {"ellipsoid", amps::make_ellipsoid(5120, {1, 0.5, 0.2})},
                                                            {"half sphere", half_sphere(5000)}};
  for (const auto& [name, input] : inputs) {
    const amps::RemeshResult result = remeshed(input, 600);
    const amps::QualityReport before = amps::quality(result.mesh);
    for (const Fit fit : kKinds) {
      CAPTURE(name);
      CAPTURE(amps::name_of(fit));
      FitReport report;
      const Mesh mesh = fitted(input, result.mesh, options_of(fit), &report);
      CHECK(report.rms_after < 0.7 * report.rms_before);
      CHECK(report.max_before >= report.rms_before);
      CHECK(report.max_after >= report.rms_after);
      CHECK(report.moved > 500);
      CHECK(report.rounds >= 1);
      CHECK(rms(input, mesh) < 0.7 * rms(input, result.mesh));
      const amps::QualityReport after = amps::quality(mesh);
      CHECK(after.min_angle >= before.min_angle - 1e-9);
      CHECK(after.max_angle <= before.max_angle + 1e-9);
      CHECK(after.min_edge >= before.min_edge * (1 - 1e-12));
      CHECK(after.max_edge <= before.max_edge * (1 + 1e-12));
    }
  }
}

TEST_CASE("fit: never a greater residual, whatever the surface") {
  std::vector<NamedMesh> inputs = small_meshes();
  inputs.push_back({"soup", random_soup(40, 5)});
  inputs.push_back({"book", open_book(3)});
  inputs.push_back({"strip", moebius_strip(40, 6)});
  for (const NamedMesh& input : inputs) {
    CAPTURE(input.name);
    const amps::RemeshResult result = remeshed(input.mesh, 300, false);
    if (result.mesh.triangles.empty() || !(amps::total_area(result.mesh) > 0)) continue;
    for (const Fit fit : kKinds) {
      FitReport report;
      const Mesh mesh = fitted(input.mesh, result.mesh, options_of(fit), &report);
      CHECK(report.rms_after <= report.rms_before);
      CHECK(amps::check(mesh).non_finite_vertices == 0);
      CHECK(amps::quality(mesh).min_angle >= amps::quality(result.mesh).min_angle - 1e-9);
    }
  }
}

TEST_CASE("fit: the volume of a sphere is nearer by ten times") {
  const Mesh input = amps::make_sphere(20480);
  const Mesh mesh = remeshed(input, 1000).mesh;
  const double volume = signed_volume(input), before = std::abs(signed_volume(mesh) - volume);
  CHECK(before > 0.005 * volume);
  for (const Fit fit : kKinds) CHECK(std::abs(signed_volume(fitted(input, mesh, options_of(fit))) - volume) < 0.1 * before);
}

TEST_CASE("fit: planes stay planes, and what lies on the surface stays where it is") {
  const Mesh cube = amps::make_cube(8);
  amps::RemeshResult result = remeshed(cube, 800);
  for (const Fit fit : kKinds) {
    FitOptions options = options_of(fit);
    options.curve_edges = result.curve_edges;
    options.input_curve_edges = creases_of_cube(cube);
    REQUIRE(options.input_curve_edges.size() == 12 * 8);
    FitReport report;
    const Points points = fit_vertices(cube, result.mesh, options, &report);
    CHECK(report.rms_before < 1e-14);
    CHECK(farthest_move(points, result.mesh.vertices) < 1e-12);
  }
  // Off their plane, vertices come back to it; only along it there is nothing to gain.
  Rng rng(3);
  const Mesh square = amps::make_square(10);
  Mesh bumpy = square;
  for (Index v = 0; v < rows(bumpy.vertices); ++v) {
    const Vec3 x = vertex(bumpy.vertices, v);
    const bool border = x.x() == 0 || x.x() == 1 || x.y() == 0 || x.y() == 1;
    if (!border) bumpy.vertices(v, 2) = 0.02 * (rng.uniform() - 0.5);
  }
  for (const Fit fit : kKinds) {
    const Points points = fit_vertices(square, bumpy, loose_options(fit));
    double height = 0;
    for (Index v = 0; v < rows(points); ++v) height = std::max(height, std::abs(points(v, 2)));
    CHECK(height < 0.001);
  }
}

TEST_CASE("fit: creases and corners stay, where faces beside them move") {
  // A cube with one face bulged: its border is straight still.
  const Mesh flat = amps::make_cube(24);
  const Mesh input = transformed(flat, [](const Vec3& x) -> Vec3 {
    if (x.z() != 1) return x;
    return {x.x(), x.y(), 1 + 0.8 * x.x() * (1 - x.x()) * x.y() * (1 - x.y())};
  });
  const amps::RemeshResult result = remeshed(input, 500);
  REQUIRE(result.report.curves.samples > 50);
  for (const Fit fit : kKinds) {
    FitOptions options = options_of(fit);
    options.curve_edges = result.curve_edges;
    options.input_curve_edges = creases_of_cube(flat);
    FitReport report;
    const Mesh mesh = fitted(input, result.mesh, options, &report);
    CHECK(report.rms_after < 0.7 * report.rms_before);
    for (Index v = 0; v < result.report.curves.samples; ++v) {
      CHECK((vertex(mesh.vertices, v) - vertex(result.mesh.vertices, v)).norm() < 1e-12);
    }
    // Without the input's curves they stay to the bit, and so do those that are named.
    options.input_curve_edges.clear();
    options.fixed = {rows(mesh.vertices) - 1};
    const Points points = fit_vertices(input, result.mesh, options);
    for (Index v = 0; v < result.report.curves.samples; ++v) CHECK(vertex(points, v) == vertex(result.mesh.vertices, v));
    CHECK(vertex(points, options.fixed[0]) == vertex(result.mesh.vertices, options.fixed[0]));
  }
}

TEST_CASE("fit: vertices that are named and ends of curves stay to the bit") {
  const Mesh input = amps::make_sphere(5120), mesh = amps::make_sphere(320);
  const Index a = mesh.triangles(100, 0), b = mesh.triangles(100, 1);
  for (const Fit fit : kKinds) {
    FitOptions options = loose_options(fit);
    const auto stay = [&](Index v) { return vertex(fit_vertices(input, mesh, options), v) == vertex(mesh.vertices, v); };
    CHECK(!stay(a));
    options.fixed = {a};
    CHECK(stay(a));
    CHECK(!stay(b));
    options.fixed.clear();
    options.curve_edges = {{a, b}};
    options.input_curve_edges = {{0, 1}, {1, 2}};
    CHECK(stay(a));
    CHECK(stay(b));
  }
}

TEST_CASE("fit: a border comes nearer to the input's border, and stays in its plane") {
  const Mesh input = half_sphere(20000);
  const Mesh mesh = remeshed(input, 400).mesh;
  const std::vector<std::array<Index, 2>> border = border_of(mesh);
  REQUIRE(border.size() > 20);
  const auto squares = [&border](const Points& points) {
    double sum = 0;
    for (const auto& edge : border) {
      for (const double t : {0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95}) {
        const Vec3 x = (1 - t) * vertex(points, edge[0]) + t * vertex(points, edge[1]);
        sum += (x.norm() - 1) * (x.norm() - 1);
      }
    }
    return sum;
  };
  for (const Fit fit : kKinds) {
    const Points points = fit_vertices(input, mesh, loose_options(fit));
    CHECK(squares(points) < 0.2 * squares(mesh.vertices));
    for (const auto& edge : border) CHECK(std::abs(points(edge[0], 2)) < 1e-12);
  }
}

TEST_CASE("fit: sheets near each other do not pull at each other, and do not come to cross") {
  // Two spheres. The points of the outer mesh at which distance is measured are nearer to the inner one.
  const double gap = 0.012;
  const Mesh outer = amps::make_sphere(20480), inner = inside_out(amps::make_sphere(20480, 1 - gap));
  const Mesh outer_mesh = amps::make_sphere(320), inner_mesh = inside_out(amps::make_sphere(320, 1 - gap));
  const Mesh input = joined(outer, inner), mesh = joined(outer_mesh, inner_mesh);
  REQUIRE(amps::find_self_intersections(mesh).empty());
  for (const Fit fit : kKinds) {
    const Points of_outer = fit_vertices(input, outer_mesh, loose_options(fit));
    for (Index v = 0; v < rows(of_outer); ++v) {
      CHECK(vertex(of_outer, v).norm() > 1 - 1e-9);
      CHECK(vertex(of_outer, v).norm() < 1.02);
    }
    const Points of_inner = fit_vertices(input, inner_mesh, loose_options(fit));
    const Points alone = fit_vertices(inner, inner_mesh, loose_options(fit));
    for (Index v = 0; v < rows(of_inner); ++v) {
      CHECK(vertex(of_inner, v).norm() > 1 - gap);
      CHECK(vertex(of_inner, v).norm() == doctest::Approx(vertex(alone, v).norm()).epsilon(0.004));
    }
    // Each by itself, they cross; together, they keep apart.
    CHECK(!amps::find_self_intersections(
               joined(fitted(outer, outer_mesh, options_of(Fit::kOff)), fitted(input, inner_mesh, loose_options(fit))))
               .empty());
    FitReport report;
    const Mesh together = fitted(input, mesh, loose_options(fit), &report);
    CHECK(amps::find_self_intersections(together).empty());
    CHECK(report.rms_after <= report.rms_before);
  }
}

TEST_CASE("fit: facets of the input that are turned over are no other sheet") {
  const Mesh input = amps::make_sphere(20480), mesh = amps::make_sphere(320);
  for (const Fit fit : kKinds) {
    FitReport right, turned_over, mixed;
    const Points points = fit_vertices(input, mesh, loose_options(fit), &right);
    const Points same = fit_vertices(inside_out(input), mesh, loose_options(fit), &turned_over);
    fit_vertices(flipped_where(input, [](Index f) { return f % 7 == 0; }), mesh, loose_options(fit), &mixed);
    CHECK(right.rms_after < 0.6 * right.rms_before);
    CHECK(turned_over.rms_after < 1.05 * right.rms_after);
    CHECK(mixed.rms_after < 1.3 * right.rms_after);
    if (fit == Fit::kNormal) CHECK(farthest_move(points, same) < 1e-9);
  }
}

TEST_CASE("fit: angles and edges keep the bounds that are given, and get no worse where they are beyond") {
  const Mesh input = amps::make_ellipsoid(5120, {1, 0.6, 0.3});
  const Mesh mesh = remeshed(input, 500, false).mesh;
  const auto angles = [](const Mesh& m, Index f) {
    double least = 180, greatest = 0;
    for (int k = 0; k < 3; ++k) {
      const Vec3 x = vertex(m.vertices, m.triangles(f, k));
      const Vec3 a = vertex(m.vertices, m.triangles(f, (k + 1) % 3)) - x,
                 b = vertex(m.vertices, m.triangles(f, (k + 2) % 3)) - x;
      const double angle = std::acos(a.dot(b) / (a.norm() * b.norm())) / kDegree;
      least = std::min(least, angle);
      greatest = std::max(greatest, angle);
    }
    return std::pair(least, greatest);
  };
  for (const Fit fit : kKinds) {
    FitOptions options = options_of(fit);
    options.min_angle = 40;
    options.max_angle = 95;
    FitReport report;
    const Mesh after = fitted(input, mesh, options, &report);
    CHECK(report.rms_after < report.rms_before);
    CHECK(report.held_back > 0);
    Index beyond = 0;
    for (Index f = 0; f < rows(mesh.triangles); ++f) {
      const auto [least0, greatest0] = angles(mesh, f);
      const auto [least, greatest] = angles(after, f);
      beyond += least0 < 40;
      CHECK(least >= std::min(40.0, least0) - 1e-9);
      CHECK(greatest <= std::max(95.0, greatest0) + 1e-9);
    }
    CHECK(beyond > 0);
  }
}

TEST_CASE("fit: a seam does not open, and vertices of no triangle stay") {
  const Mesh input = amps::make_sphere(5120);
  const Mesh sphere = amps::make_sphere(320);
  const Mesh soup = with_vertices(soup_of(sphere), {Vec3(7, 7, 7)});
  for (const Fit fit : kKinds) {
    FitReport report;
    const Points points = fit_vertices(input, soup, loose_options(fit), &report);
    CHECK(report.moved == rows(soup.vertices) - 1);
    std::set<std::array<double, 3>> places;
    for (Index v = 0; v + 1 < rows(points); ++v) places.insert({points(v, 0), points(v, 1), points(v, 2)});
    CHECK(places.size() == static_cast<std::size_t>(sphere.vertices.rows()));
    CHECK(vertex(points, rows(points) - 1) == Vec3(7, 7, 7));
  }
}

TEST_CASE("fit: the same bits on any threads and at any power of two; no fit changes nothing") {
  const Mesh input = amps::make_torus(1, 0.4, 160, 64);
  const Mesh mesh = remeshed(input, 3000, false).mesh;
  for (const Fit fit : kKinds) {
    FitOptions options = options_of(fit);
    const Points points = fit_vertices(input, mesh, options);
    options.execution.threads = 2;
    CHECK(fit_vertices(input, mesh, options) == points);
    const double factor = std::ldexp(1.0, 300);
    CHECK(fit_vertices(scaled(input, factor), scaled(mesh, factor), options_of(fit)) == scaled(points, factor));
  }
  FitReport report;
  CHECK(fit_vertices(input, mesh, options_of(Fit::kOff), &report) == mesh.vertices);
  CHECK(report.moved == 0);
}

TEST_CASE("fit: in remesh, vertices of the mesh move and nothing else does" * doctest::test_suite("slow")) {
  const std::vector<std::pair<std::string, Mesh>> inputs = {{"half sphere", half_sphere(5000)}, {"cube", amps::make_cube(8)}};
  for (const auto& [name, input] : inputs) {
    CAPTURE(name);
    amps::RemeshOptions options;
    options.sampling.target_count = 600;
    const amps::RemeshResult plain = amps::remesh(input, options);
    CHECK(plain.mesh.vertices == plain.samples.positions);
    CHECK(plain.report.fit.rms_before == 0);
    for (const Fit fit : kKinds) {
      options.fit = fit;
      const amps::RemeshResult result = amps::remesh(input, options);
      CHECK(result.status == plain.status);
      CHECK(result.samples.positions == plain.samples.positions);
      CHECK(result.mesh.triangles == plain.mesh.triangles);
      CHECK(result.report.maximality.worst_coverage == plain.report.maximality.worst_coverage);
      CHECK(result.report.quality.min_angle >= std::min(35.0, plain.report.quality.min_angle) - 1e-9);
      CHECK(result.report.quality.max_angle <= std::max(105.0, plain.report.quality.max_angle) + 1e-9);
      if (name == "cube") {
        CHECK(farthest_move(result.mesh.vertices, plain.mesh.vertices) < 1e-12);
        continue;
      }
      CHECK(result.report.fit.moved > 400);
      CHECK(result.report.fit.rms_after < 0.7 * result.report.fit.rms_before);
      CHECK(rms(input, result.mesh) < 0.7 * rms(input, plain.mesh));
      CHECK(result.report.quality.mean_edge != plain.report.quality.mean_edge);
      // Once the mesh is there, to stop costs the fit only.
      amps::RemeshOptions stopped = options;
      stopped.sampling.execution.progress =
          amps::Progress([](const char* stage, double) { return std::string(stage) != "fitting vertices"; }, 0);
      const amps::RemeshResult unfinished = amps::remesh(input, stopped);
      CHECK(unfinished.status == amps::Outcome::kCancelled);
      CHECK(unfinished.mesh.vertices == plain.mesh.vertices);
      CHECK(unfinished.mesh.triangles == plain.mesh.triangles);
    }
  }
}

TEST_CASE("fit: what cannot be done says so") {
  const Mesh input = amps::make_sphere(320), mesh = amps::make_sphere(80);
  const auto refused = [&](const auto& change) {
    FitOptions options;
    change(options);
    return error_of([&] { fit_vertices(input, mesh, options); });
  };
  const auto code = ErrorCode::kInvalidArgument;
  CHECK(refused([](FitOptions& o) { o.min_angle = -1; }) == code);
  CHECK(refused([](FitOptions& o) { o.min_angle = 61; }) == code);
  CHECK(refused([](FitOptions& o) { o.min_angle = kNaN; }) == code);
  CHECK(refused([](FitOptions& o) { o.max_angle = 59; }) == code);
  CHECK(refused([](FitOptions& o) { o.max_angle = 181; }) == code);
  CHECK(refused([](FitOptions& o) { o.min_edge = -0.1; }) == code);
  CHECK(refused([](FitOptions& o) { o.max_edge = kNaN; }) == code);
  CHECK(refused([](FitOptions& o) { o.min_edge = 0.3, o.max_edge = 0.2; }) == code);
  CHECK(refused([](FitOptions& o) { o.fixed = {0, -1}; }) == code);
  CHECK(refused([](FitOptions& o) { o.fixed = {42}; }) == code);
  CHECK(refused([](FitOptions& o) { o.curve_edges = {{0, 42}}; }) == code);
  CHECK(refused([](FitOptions& o) { o.input_curve_edges = {{0, 162}}; }) == code);
  CHECK(error_of([&] { fit_vertices(squashed(input), mesh); }) == ErrorCode::kInvalidMesh);
  CHECK(error_of([&] { fit_vertices(input, without_facets(mesh)); }) == ErrorCode::kInvalidMesh);
  FitOptions options;
  cancel(options);
  CHECK(error_of([&] { fit_vertices(input, mesh, options); }) == ErrorCode::kCancelled);
  FitReport report;
  fit_vertices(input, mesh, {}, &report);
  std::ostringstream text;
  text << report;
  CHECK(text.str().find("RMS") != std::string::npos);
}

TEST_CASE("fit: a real mesh comes nearer by a third and more") {
  const Mesh input = data_mesh_or("bunny_3k_closed.off", amps::make_knot());
  const amps::RemeshResult result = remeshed(input, 2000);
  const double before = rms(input, result.mesh);
  const double volume = signed_volume(input), lost = std::abs(signed_volume(result.mesh) - volume);
  double last = before;
  for (const Fit fit : kKinds) {
    FitOptions options = options_of(fit);
    options.min_angle = 35;
    options.max_angle = 105;
    const Mesh mesh = fitted(input, result.mesh, options);
    const double now = rms(input, mesh);
    CHECK(now < 0.75 * before);
    CHECK(now < last);  // freely, nearer than along normals
    last = now;
    CHECK(std::abs(signed_volume(mesh) - volume) < 0.3 * lost);
    CHECK(amps::quality(mesh).min_angle >= 35 - 1e-9);
    CHECK(amps::quality(mesh).max_angle <= 105 + 1e-9);
  }
}

}  // namespace amps_test
