#include "amps/mesh_scale.h"

#include "kit/errors.h"
#include "kit/meshes.h"

#include "amps/amps.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

namespace amps_test {

using amps::SizingField;
using amps::detail::MeshScale;

namespace {

/// 2^k times 1: without a copy, and with one; 1e-110, 1e38 and others from reports.
constexpr int kExponents[] = {-40, 20, -1000, -366, -269, -70, 126, 262, 900};

/// Coordinates are multiples of 2^-30, so that meshes at any of these scales are the same mesh.
Mesh at_scale(Mesh mesh, int k) {
  for (std::ptrdiff_t i = 0; i < mesh.vertices.size(); ++i) {
    double& x = mesh.vertices.data()[i];
    x = std::ldexp(std::round(std::ldexp(x, 30)), k - 30);
  }
  return mesh;
}

/// x times 2^k: rounded once, below the normal doubles.
double times(double x, int k) { return std::ldexp(x, k); }

bool equal_bits(double a, double b) { return std::memcmp(&a, &b, sizeof a) == 0 || (a == 0 && b == 0); }

bool same_scaled(const double* at_one, const double* scaled, std::size_t n, int k) {
  bool same = true;
  for (std::size_t i = 0; i < n; ++i) same = same && equal_bits(times(at_one[i], k), scaled[i]);
  return same;
}

bool same_scaled(const std::vector<double>& at_one, const std::vector<double>& scaled, int k) {
  return at_one.size() == scaled.size() && same_scaled(at_one.data(), scaled.data(), at_one.size(), k);
}

bool same_scaled(const Points& at_one, const Points& scaled, int k) {
  return at_one.rows() == scaled.rows() &&
         same_scaled(at_one.data(), scaled.data(), static_cast<std::size_t>(at_one.size()), k);
}

bool same_scaled(const amps::SampleSet& at_one, const amps::SampleSet& scaled, int k) {
  return same_scaled(at_one.positions, scaled.positions, k) && same_scaled(at_one.radii, scaled.radii, k) &&
         same_scaled(at_one.parameters, scaled.parameters, k) && at_one.facets == scaled.facets &&
         at_one.barycentrics == scaled.barycentrics && at_one.curves == scaled.curves && at_one.dimensions == scaled.dimensions;
}

bool same_scaled(const SizingField& at_one, const SizingField& scaled, int k) {
  if (at_one.num_pieces() != scaled.num_pieces()) return false;
  bool same = at_one.density_integral() == scaled.density_integral();
  for (std::size_t i = 0; same && i < at_one.num_pieces(); ++i) {
    const SizingField::Piece a = at_one.piece(i), b = scaled.piece(i);
    same = same_scaled(a.radii.data(), b.radii.data(), 3, k) && at_one.density_integral(i) == scaled.density_integral(i);
  }
  return same && equal_bits(times(at_one.min_radius(), k), scaled.min_radius()) &&
         equal_bits(times(at_one.max_radius(), k), scaled.max_radius());
}

void check_quality(const amps::QualityReport& a, const amps::QualityReport& b, int k) {
  CHECK(a.min_angle == b.min_angle);
  CHECK(a.max_angle == b.max_angle);
  CHECK(a.mean_q == b.mean_q);
  CHECK(a.area_ratio == b.area_ratio);
  CHECK(equal_bits(times(a.min_edge, k), b.min_edge));
  CHECK(equal_bits(times(a.max_edge, k), b.max_edge));
  CHECK(equal_bits(times(a.mean_edge, k), b.mean_edge));
  CHECK(a.valence == b.valence);
}

void check_distance(const amps::OneSidedDistance& a, const amps::OneSidedDistance& b, int k) {
  CHECK(equal_bits(times(a.hausdorff, k), b.hausdorff));
  CHECK(equal_bits(times(a.rms, k), b.rms));
  CHECK(equal_bits(times(a.mean, k), b.mean));
  CHECK(a.farthest.facet == b.farthest.facet);
}

/// What there is at 1, to compare with.
struct AtOne {
  Mesh mesh, other;
  SizingField field;
  explicit AtOne(const Mesh& m) : mesh(at_scale(m, 0)), other(at_scale(scaled(m, 1.01), 0)), field(amps::lfs_sizing(mesh)) {}
};

SizingField lfs_field(const Mesh& mesh) { return amps::for_count(amps::lfs_sizing(mesh).with_ratio(), 400); }

}  // namespace

TEST_CASE("mesh scale: 1 within the safe range, and elsewhere what brings the largest used coordinate to 1") {
  const auto triangle = [](double x) { return one_triangle({0, 0, 0}, {x, 0, 0}, {0, x, 0}); };
  for (const int k : {0, 1, -1, 50, -50}) CHECK(MeshScale(triangle(std::ldexp(1.0, k))).is_one());
  for (const int k : {-1074, -1022, -500, -60, 60, 500, 1023}) {
    CAPTURE(k);
    const Mesh mesh = triangle(std::ldexp(1.0, k));
    const MeshScale scale(mesh);
    CHECK(!scale.is_one());
    const Mesh ours = scale.mesh(mesh);
    CHECK(MeshScale(ours).is_one());
    Points again = ours.vertices;
    scale.back(again);
    CHECK(again == mesh.vertices);
  }
  // Vertices without facets do not count, whatever they are, nor do facets out of range.
  Mesh mesh = mesh_of({{0, 0, 0}, {0x1p-400, 0, 0}, {0, 0x1p-400, 0}, {1, 1, 1}, {INFINITY, 0, 0}}, {{0, 1, 2}, {0, 1, 7}});
  const MeshScale scale(mesh);
  CHECK(scale.unit() == 0x1p-399);
  CHECK(scale.mesh(mesh).vertices(3, 0) == 0x1p399);
  mesh.vertices(3, 0) = 0x1p1000;
  CHECK(std::isfinite(scale.mesh(mesh).vertices(3, 0)));
  CHECK(scale.length(0x1p-1070) == 0x1p-671);
  CHECK(MeshScale(triangle(0x1p1000)).length(0x1p-1000) > 0);
  CHECK(MeshScale(triangle(0x1p1000)).length(0) == 0);
  CHECK(std::isinf(MeshScale(triangle(0x1p1000)).length(INFINITY)));
}

TEST_CASE("mesh scale: bits of sets at 2^k are those at 1, scaled") {
  const Mesh one = at_scale(amps::make_torus(), 0);
  const double radius = 0.15;
  amps::SamplingOptions options;
  options.radius = radius;
  amps::OptimizeOptions optimization;
  const amps::SamplingResult sampled = amps::sample(one, options), thrown = amps::throw_darts(one, options);
  amps::SamplingOptions on_surface = options;
  on_surface.neighborhood = amps::Neighborhood::kSurface;
  const amps::SamplingResult surface = amps::sample(one, on_surface);
  amps::SamplingOptions counted;
  counted.target_count = 300;
  const amps::SamplingResult of_count = amps::sample(one, counted);
  amps::SamplingOptions graded;
  graded.sizing = lfs_field(one);
  const amps::SamplingResult by_field = amps::sample(one, graded);
  const amps::SamplingResult filled = amps::fill_gaps(one, thrown.samples, options);
  const amps::OptimizeResult better = amps::optimize(one, sampled.samples, optimization);
  const amps::MaximalityReport gappy = amps::verify_maximal(one, thrown.samples);
  const amps::GapSet gaps = amps::find_gaps(one, thrown.samples);
  const Mesh dual = amps::restricted_triangulation(one, sampled.samples);
  REQUIRE(gappy.gaps > 0);
  for (const int k : kExponents) {
    CAPTURE(k);
    const Mesh mesh = at_scale(amps::make_torus(), k);
    options.radius = on_surface.radius = times(radius, k);
    const amps::SamplingResult s = amps::sample(mesh, options), t = amps::throw_darts(mesh, options);
    CHECK(same_scaled(sampled.samples, s.samples, k));
    CHECK(equal_bits(times(sampled.report.mean_radius, k), s.report.mean_radius));
    CHECK(s.report.darts == sampled.report.darts);
    CHECK(same_scaled(thrown.samples, t.samples, k));
    CHECK(same_scaled(surface.samples, amps::sample(mesh, on_surface).samples, k));
    CHECK(same_scaled(of_count.samples, amps::sample(mesh, counted).samples, k));
    graded.sizing = lfs_field(mesh);
    CHECK(same_scaled(by_field.samples, amps::sample(mesh, graded).samples, k));
    // Sets at a scale are rounded below the normal doubles: give those that were scaled exactly.
    CHECK(same_scaled(filled.samples, amps::fill_gaps(mesh, t.samples, options).samples, k));
    CHECK(same_scaled(better.samples, amps::optimize(mesh, s.samples, optimization).samples, k));
    const amps::MaximalityReport m = amps::verify_maximal(mesh, t.samples);
    CHECK(m.worst_coverage == gappy.worst_coverage);
    CHECK(m.worst_separation == gappy.worst_separation);
    CHECK(m.gaps == gappy.gaps);
    CHECK(equal_bits(times(gappy.gap_area, 2 * k), m.gap_area));
    const amps::GapSet g = amps::find_gaps(mesh, t.samples);
    CHECK(same_scaled(gaps.primitives.vertices, g.primitives.vertices, k));
    CHECK(g.facets == gaps.facets);
    CHECK(amps::restricted_triangulation(mesh, s.samples).triangles == dual.triangles);
  }
}

TEST_CASE("mesh scale: bits of remeshing at 2^k are those at 1, scaled") {
  const Mesh cube = at_scale(amps::make_cube(2), 0);
  amps::RemeshOptions options;
  options.sampling.target_count = 300;
  amps::RemeshOptions near;
  near.max_error = 0.02;
  near.fit = amps::Fit::kNormal;
  const Mesh sphere = at_scale(amps::make_sphere(320), 0);
  const amps::RemeshResult first = amps::remesh(cube, options), second = amps::remesh(sphere, near);
  for (const int k : kExponents) {
    CAPTURE(k);
    near.max_error = times(0.02, k);
    const amps::RemeshResult a = amps::remesh(at_scale(amps::make_cube(2), k), options);
    const amps::RemeshResult b = amps::remesh(at_scale(amps::make_sphere(320), k), near);
    for (const auto& [one, made] : {std::pair{&first, &a}, {&second, &b}}) {
      CHECK(made->status == one->status);
      CHECK(made->mesh.triangles == one->mesh.triangles);
      CHECK(same_scaled(one->mesh.vertices, made->mesh.vertices, k));
      CHECK(same_scaled(one->samples, made->samples, k));
      check_quality(one->report.quality, made->report.quality, k);
      CHECK(made->report.maximality.worst_coverage == one->report.maximality.worst_coverage);
      CHECK(made->report.certificate.holds());
      CHECK(equal_bits(times(one->report.curves.length, k), made->report.curves.length));
      CHECK(equal_bits(times(one->report.curves.deviation, k), made->report.curves.deviation));
      CHECK(equal_bits(times(one->report.hausdorff_bound, k), made->report.hausdorff_bound));
      CHECK(equal_bits(times(one->report.fit.rms_after, k), made->report.fit.rms_after));
      CHECK(equal_bits(times(one->report.sampling.radius, k), made->report.sampling.radius));
      for (std::size_t c = 0; c < one->graph->curves.size(); ++c) {
        CHECK(same_scaled(one->graph->curves[c].arc, made->graph->curves[c].arc, k));
      }
    }
  }
}

TEST_CASE("mesh scale: bits of sizing fields at 2^k are those at 1, scaled" * doctest::test_suite("slow")) {
  const Mesh one = at_scale(amps::make_knot(), 0);
  const std::vector<SizingField> fields = [&] {
    amps::CurvatureOptions curvature;
    curvature.max_error = 0.01;
    const SizingField lfs = amps::lfs_sizing(one);
    const auto radius = [](const amps::SurfacePoint& at) { return 0.02 + 0.01 * at.position.x() * at.position.x(); };
    return std::vector<SizingField>{amps::uniform_sizing(one, 0.1),
                                    lfs,
                                    amps::curvature_sizing(one, curvature),
                                    amps::function_sizing(one, radius),
                                    lfs.with_ratio(4),
                                    lfs.clamped(0.05, 0.1),
                                    lfs.limited(0.1),
                                    lfs.scaled(0.5),
                                    amps::for_count(lfs, 1000),
                                    amps::min(lfs, amps::uniform_sizing(one, 0.1))};
  }();
  const std::vector<double> curvature_at_one = amps::max_curvature(one),
                            lfs_at_one = amps::local_feature_size(one, one.vertices);
  for (const int k : kExponents) {
    CAPTURE(k);
    const Mesh mesh = at_scale(amps::make_knot(), k);
    amps::CurvatureOptions curvature;
    curvature.max_error = times(0.01, k);
    const SizingField lfs = amps::lfs_sizing(mesh);
    const auto radius = [k](const amps::SurfacePoint& at) {
      const double x = times(at.position.x(), -k);
      return times(0.02 + 0.01 * x * x, k);
    };
    const std::vector<SizingField> made = {amps::uniform_sizing(mesh, times(0.1, k)),
                                           lfs,
                                           amps::curvature_sizing(mesh, curvature),
                                           amps::function_sizing(mesh, radius),
                                           lfs.with_ratio(4),
                                           lfs.clamped(times(0.05, k), times(0.1, k)),
                                           lfs.limited(0.1),
                                           lfs.scaled(0.5),
                                           amps::for_count(lfs, 1000),
                                           amps::min(lfs, amps::uniform_sizing(mesh, times(0.1, k)))};
    for (std::size_t i = 0; i < fields.size(); ++i) {
      CAPTURE(i);
      CHECK(made[i].fits(mesh));
      CHECK(!made[i].fits(one));
      // At 2^-1000 a function sees rounded coordinates.
      if (i != 3 || k > -1000) CHECK(same_scaled(fields[i], made[i], k));
    }
    CHECK(same_scaled(lfs_at_one, amps::local_feature_size(mesh, mesh.vertices), k));
    CHECK(same_scaled(curvature_at_one, amps::max_curvature(mesh), -k));
    CHECK_THROWS_AS(amps::min(lfs, fields[0]), amps::Error);
  }
}

TEST_CASE("mesh scale: bits of measures and searches at 2^k are those at 1, scaled" * doctest::test_suite("slow")) {
  const Mesh one = at_scale(amps::make_torus(), 0);
  const Mesh moved_one = at_scale(moved(amps::make_torus(), {0.01, 0.02, 0}), 0);
  const amps::QualityReport quality = amps::quality(one);
  const amps::DistanceReport distance = amps::surface_distance(one, moved_one);
  const Mesh two = joined(one, moved_one);
  const amps::SelfIntersectionReport crossings = amps::find_self_intersections(two);
  REQUIRE(crossings.num_pairs > 0);
  const amps::CurveGraph curves = amps::find_curves(at_scale(amps::make_cube(3), 0));
  const Points fitted = amps::fit_vertices(moved_one, one);
  const amps::KdTree points(one.vertices);
  const amps::SurfaceTree surface(one);
  for (const int k : kExponents) {
    CAPTURE(k);
    const Mesh mesh = at_scale(amps::make_torus(), k);
    const Mesh other = at_scale(moved(amps::make_torus(), {0.01, 0.02, 0}), k);
    check_quality(quality, amps::quality(mesh), k);
    CHECK(equal_bits(times(amps::bounding_box(one).diagonal(), k), amps::bounding_box(mesh).diagonal()));
    CHECK(amps::facet_normals(one) == amps::facet_normals(mesh));
    if (k > -500 && k < 500) {
      CHECK(same_scaled(amps::facet_areas(one), amps::facet_areas(mesh), 2 * k));
      CHECK(equal_bits(times(amps::total_area(one), 2 * k), amps::total_area(mesh)));
    }
    const amps::MeshReport report = amps::check(mesh);
    CHECK(report.usable());
    CHECK(report.zero_area_facets == 0);
    CHECK(report.wild_vertex == amps::kNone);
    const amps::DistanceReport d = amps::surface_distance(mesh, other);
    check_distance(distance.forward, d.forward, k);
    check_distance(distance.backward, d.backward, k);
    CHECK(equal_bits(times(distance.diagonal, k), d.diagonal));
    CHECK(amps::find_self_intersections(joined(mesh, other)).pairs == crossings.pairs);
    const amps::CurveGraph graph = amps::find_curves(at_scale(amps::make_cube(3), k));
    REQUIRE(graph.curves.size() == curves.curves.size());
    for (std::size_t c = 0; c < graph.curves.size(); ++c) CHECK(same_scaled(curves.curves[c].arc, graph.curves[c].arc, k));
    CHECK(same_scaled(fitted, amps::fit_vertices(other, mesh), k));
    const amps::KdTree tree(mesh.vertices);
    const amps::SurfaceTree search(mesh);
    std::vector<amps::KdTree::Neighbor> near, near_one;
    for (Index v = 0; v < 20; ++v) {
      const Vec3 query = MeshView(other).vertices[v], query_one = MeshView(moved_one).vertices[v];
      CHECK(tree.nearest(query).index == points.nearest(query_one).index);
      points.k_nearest(query_one, 7, near_one);
      tree.k_nearest(query, 7, near);
      for (std::size_t i = 0; i < near_one.size(); ++i) CHECK(near[i].index == near_one[i].index);
      points.in_radius(query_one, 0.2, near_one);
      tree.in_radius(query, times(0.2, k), near);
      REQUIRE(near.size() == near_one.size());
      for (std::size_t i = 0; i < near_one.size(); ++i) CHECK(near[i].index == near_one[i].index);
      const amps::SurfaceHit a = surface.nearest(query_one), b = search.nearest(query);
      CHECK(a.point.facet == b.point.facet);
      CHECK(a.point.barycentric == b.point.barycentric);
      CHECK(equal_bits(times(a.distance, k), b.distance));
    }
  }
}

TEST_CASE("mesh scale: far from the origin sets are maximal and the topology is kept, or radii are refused") {
  const double radius = 0.1;
  for (const Mesh& mesh : {amps::make_torus(), amps::make_cube(3)}) {
    for (const double far : {1e6, 1e7, 1e8, 1e9, 1e12}) {
      CAPTURE(far);
      const Mesh there = moved(mesh, far * radius * Vec3(1, 0.7, -0.3));
      amps::RemeshOptions options;
      options.sampling.radius = radius;
      const amps::RemeshResult result = amps::remesh(there, options);
      CHECK(result.status == amps::Outcome::kDone);
      CHECK(result.report.certificate.holds());
      CHECK(result.report.output.euler_characteristic == result.report.input.euler_characteristic);
      CHECK(result.report.output.closed());
      CHECK(result.report.sampling.unfilled_gaps == 0);
      const amps::MaximalityReport again = amps::verify_maximal(there, result.samples, {}, amps::ConflictRule::kMax,
                                                                amps::Neighborhood::kSurface, result.graph.get());
      CHECK(again.maximal());
      CHECK(again.poisson_disk());
    }
    const Mesh too_far = moved(mesh, {1e15 * radius, 0, 0});
    amps::SamplingOptions options;
    options.radius = radius;
    CHECK(error_text([&] { amps::sample(too_far, options); }).find("move the mesh to the origin") != std::string::npos);
  }
}

TEST_CASE("mesh scale: errors name the unit of their lengths") {
  const Mesh mesh = at_scale(amps::make_cube(2), 300);
  amps::SamplingOptions options;
  options.radius = times(1e-9, 300);
  std::string said;
  try {
    amps::sample(mesh, options);
  } catch (const amps::Error& error) {
    CHECK(error.code() == amps::ErrorCode::kTooLarge);
    said = error.what();
  }
  CHECK(said.find("in units of 2^30") != std::string::npos);
}

}  // namespace amps_test
