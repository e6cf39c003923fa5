// Distances between surfaces, against closed forms, and against plain geometry in long double at many points
// (kit/distance.h).
#include "amps/surface_distance.h"

#include "kit/data.h"
#include "kit/distance.h"
#include "kit/errors.h"
#include "kit/execution.h"
#include "kit/meshes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

using amps::DistanceOptions;
using amps::DistanceReport;
using amps::one_sided_distance;
using amps::OneSidedDistance;
using amps::surface_distance;
using doctest::Approx;

namespace {

bool same(const OneSidedDistance& a, const OneSidedDistance& b) {
  return a.hausdorff == b.hausdorff && a.hausdorff_lower == b.hausdorff_lower && a.farthest.facet == b.farthest.facet &&
         a.farthest.barycentric == b.farthest.barycentric && a.farthest.position == b.farthest.position && a.mean == b.mean &&
         a.rms == b.rms && a.mean_error == b.mean_error && a.rms_error == b.rms_error;
}

bool same(const DistanceReport& a, const DistanceReport& b) {
  return same(a.forward, b.forward) && same(a.backward, b.backward) && a.diagonal == b.diagonal;
}

/// One direction is what it says: the bounds are no farther apart than `gap`, the lower one is the distance of a point of
/// `from`, and none of many points of `from`, spread and at random, is beyond the upper one. Mean and rms, if taken at enough
/// points for an estimate of their error, are those of the random points, within five standard errors and the error told.
void check_direction(const Mesh& from, const Mesh& to, const OneSidedDistance& d, double gap, Rng& rng, bool means = true) {
  constexpr double kRounding = 1e-10;  // slivers, see SurfaceTree
  CHECK(d.hausdorff_lower <= d.hausdorff);
  CHECK(d.hausdorff - d.hausdorff_lower <= gap);
  const MeshView mesh(from);
  REQUIRE(d.farthest.facet >= 0);
  REQUIRE(d.farthest.facet < mesh.num_facets());
  CHECK(d.farthest.barycentric.minCoeff() >= -1e-15);
  CHECK(d.farthest.barycentric.sum() == Approx(1).epsilon(1e-14));
  Vec3 position = Vec3::Zero();
  for (int k = 0; k < 3; ++k) position += d.farthest.barycentric[k] * mesh.corner(d.farthest.facet, k);
  CHECK((position - d.farthest.position).norm() <= 1e-14);
  CHECK(std::abs(static_cast<double>(brute_distance(to, position)) - d.hausdorff_lower) <= kRounding);
  CHECK(d.mean <= d.rms * (1 + 1e-12));
  CHECK(d.rms <= d.hausdorff + kRounding);

  const std::vector<double> areas = amps::facet_areas(from);
  const double area = amps::total_area(from);
  constexpr double kPoints = 4000;
  double beyond = 0, mean = 0, square = 0, fourth = 0;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const double share = areas[at(f)] / area;
    const int n = static_cast<int>(kPoints * share) + 3;  // by area, and some of each
    for (int i = 0; i < n; ++i) {
      const Vec3 b = amps::uniform_barycentric(rng);
      const Vec3 x = b[0] * mesh.corner(f, 0) + b[1] * mesh.corner(f, 1) + b[2] * mesh.corner(f, 2);
      const auto distance = static_cast<double>(brute_distance(to, x));
      beyond = std::max(beyond, distance - d.hausdorff);
      mean += share / n * distance;
      square += share / n * distance * distance;
      fourth += share / n * std::pow(distance, 4);
    }
  }
  CHECK(beyond <= kRounding);
  if (!means) return;
  CHECK(std::abs(mean - d.mean) <= 5 * std::sqrt(square / kPoints) + d.mean_error + kRounding);
  CHECK(std::abs(square - d.rms * d.rms) <= 5 * std::sqrt(fourth / kPoints) + 2 * d.rms * d.rms_error + kRounding);
}

void check_both(const Mesh& a, const Mesh& b, const DistanceOptions& options, Rng& rng) {
  const DistanceReport d = surface_distance(a, b, options);
  CHECK(d.diagonal == Approx(amps::bounding_box(a).diagonal()).epsilon(1e-15));
  const double gap = options.tolerance * d.diagonal * (1 + 1e-9);
  check_direction(a, b, d.forward, gap, rng);
  check_direction(b, a, d.backward, gap, rng);
}

}  // namespace

TEST_CASE("surface_distance: of a surface to itself it is 0") {
  for (const Mesh& mesh :
       {amps::make_square(), amps::make_sphere(), amps::make_knot(), data_mesh_or("bunny_3k_closed.off", amps::make_torus())}) {
    const DistanceReport d = surface_distance(mesh, mesh);
    CHECK(d.hausdorff() <= DistanceOptions().tolerance * d.diagonal);
    CHECK(d.hausdorff_lower() <= 1e-15 * d.diagonal);  // points inside facets are rounded
    CHECK(d.rms() <= 1e-15 * d.diagonal);
  }
}

TEST_CASE("surface_distance: facets cut otherwise, flipped or reordered change nothing") {
  DistanceOptions fine;
  fine.tolerance = 1e-9;
  const Mesh cube = amps::make_cube(3);
  const Mesh other = amps::make_cube(5);
  const Index last = rows(other.triangles) - 1;
  const Mesh flipped{other.vertices, made_triangles(last + 1, [&](Index f) {
                       const Corners c = corners_of(other.triangles, last - f);
                       return Corners{c[2], c[1], c[0]};
                     })};
  const DistanceReport d = surface_distance(cube, flipped, fine);
  CHECK(d.hausdorff_lower() <= 1e-15);
  CHECK(d.hausdorff() <= 1e-9 * d.diagonal);
  CHECK(d.rms() <= 1e-15);
}

TEST_CASE("surface_distance: parallel squares are their offset apart, in each measure") {
  for (const Index n : {1, 3, 7}) {
    for (const double h : {1e-9, 0.01, 2.0, 1e4}) {
      const DistanceReport d = surface_distance(amps::make_square(4), moved(amps::make_square(n), {0, 0, h}));
      for (const OneSidedDistance* side : {&d.forward, &d.backward}) {
        CHECK(side->hausdorff_lower == Approx(h).epsilon(1e-12));
        CHECK(side->hausdorff - h <= DistanceOptions().tolerance * d.diagonal * (1 + 1e-9));
        CHECK(side->mean == Approx(h).epsilon(1e-12));
        CHECK(side->rms == Approx(h).epsilon(1e-12));
      }
      CHECK(d.percent(d.rms()) == Approx(100 * h / std::sqrt(2)).epsilon(1e-12));
    }
  }
}

TEST_CASE("surface_distance: a square shifted in its plane; quadrature converges, and tells its error") {
  const double t = 0.3;
  double coarse = 0;
  for (const double spacing : {0.3, 0.01, 0.003}) {
    DistanceOptions options;
    options.spacing = spacing;
    const DistanceReport d = surface_distance(amps::make_square(), moved(amps::make_square(), {t, 0, 0}), options);
    for (const OneSidedDistance* side : {&d.forward, &d.backward}) {
      CHECK(side->hausdorff_lower == Approx(t).epsilon(1e-14));
      CHECK(side->hausdorff == Approx(t).epsilon(2e-5));
      CHECK(std::abs(side->mean - t * t / 2) <= side->mean_error);  // ∫ (t − x) over x < t
      CHECK(std::abs(side->rms - std::sqrt(t * t * t / 3)) <= side->rms_error);
    }
    if (coarse > 0) CHECK(d.forward.rms_error < 0.2 * coarse);
    coarse = d.forward.rms_error;
  }
}

TEST_CASE("surface_distance: of a slope over a plane, where distance is linear, all measures are exact") {
  const double k = 0.25;
  const Mesh slope = transformed(amps::make_square(3), [k](const Vec3& x) -> Vec3 { return {x.x(), x.y(), k * x.x()}; });
  const Mesh plane = scaled(amps::make_square(2), 5, {-2, -2, 0});
  const OneSidedDistance d = one_sided_distance(slope, plane);
  CHECK(d.hausdorff == Approx(k).epsilon(1e-14));
  CHECK(d.hausdorff_lower == Approx(k).epsilon(1e-14));
  CHECK(d.farthest.position.x() == 1);
  CHECK(d.mean == Approx(k / 2).epsilon(1e-13));
  CHECK(d.rms == Approx(k / std::sqrt(3)).epsilon(1e-13));
}

TEST_CASE("surface_distance: concentric spheres, within what their facets cut off") {
  const double radius = 1.3;
  const auto sagitta = [](const Mesh& sphere, double r) {  // facets of a sphere are nearest to its centre within their inside
    double nearest = r;
    for (Index f = 0; f < rows(sphere.triangles); ++f) {
      nearest = std::min(nearest, static_cast<double>(facet_distance(sphere, f, Vec3::Zero())));
    }
    return r - nearest;
  };
  for (const Index facets : {80, 1280, 5120}) {
    const Mesh inner = amps::make_sphere(facets), outer = amps::make_sphere(facets / 4, radius);
    const double of_inner = sagitta(inner, 1), of_outer = sagitta(outer, radius);
    const DistanceReport d = surface_distance(inner, outer);
    for (const OneSidedDistance* side : {&d.forward, &d.backward}) {
      // A point at x of one lies in a shell of the thickness of its sagitta, and so does the other along the ray through x.
      const double least = radius - of_outer - 1, greatest = radius - (1 - of_inner);
      CHECK(side->hausdorff_lower <= greatest + 1e-15);
      CHECK(side->hausdorff >= least - 1e-15);
      CHECK(side->hausdorff <= greatest + 2e-6 * d.diagonal);
      for (const double mean : {side->mean, side->rms}) {
        CHECK(mean >= least - 1e-15);
        CHECK(mean <= greatest + 1e-15);
      }
    }
  }
}

TEST_CASE("surface_distance: bounds, means and the farthest point, against plain geometry") {
  Rng rng(1);
  DistanceOptions options;
  for (const double tolerance : {1e-2, 1e-4, 1e-7}) {
    options.tolerance = tolerance;
    check_both(amps::make_cube(2), amps::make_sphere(80, 0.7), options, rng);
    check_both(amps::make_square(3), shaken(amps::make_square(4), 0.05, rng), options, rng);
    check_both(amps::make_torus(1, 0.4, 12, 6), amps::make_torus(1, 0.4, 9, 5), options, rng);
  }
  options.tolerance = 1e-3;
  for (int trial = 0; trial < 6; ++trial) {
    check_both(hard_soup(20, rng), hard_soup(30, rng), options, rng);
  }
  // Two sheets that meet: points between are far from both, and no vertex is.
  Mesh two = amps::make_square();
  two = with_facet(two, Vec3(0, 0, 1), Vec3(1, 0, 1), Vec3(1, 1, 1));
  check_both(amps::make_cube(), two, options, rng);
  options.max_cuts = 5;
  options.spacing = 1;
  const DistanceReport stopped = surface_distance(amps::make_cube(), two, options);
  options.tolerance = 1;
  check_direction(amps::make_cube(), two, stopped.forward, 1.0, rng);
  CHECK(stopped.forward.hausdorff - stopped.forward.hausdorff_lower > 1e-3 * stopped.diagonal);
  options.max_cuts = 0;
  check_both(amps::make_cube(), two, options, rng);
}

TEST_CASE("surface_distance: the same from few points to begin with, where the cuts do all the work") {
  Rng rng(2);
  DistanceOptions options;
  options.spacing = 1;
  for (int trial = 0; trial < 10; ++trial) {
    const Mesh rough = scaled(shaken(amps::make_square(3), 0.15, rng), 1.4, {-0.2, -0.2, 0});
    const OneSidedDistance d = one_sided_distance(amps::make_square(), rough, options);
    check_direction(amps::make_square(), rough, d, 1e-6 * std::sqrt(2) * (1 + 1e-9), rng, false);
  }
}

TEST_CASE("surface_distance: bounds hold without any cut, on triangles of all shapes, where they are tightest") {
  // The other surface is next to nothing but the points where distance is measured: corners and centroid.
  Rng rng(5);
  DistanceOptions options;
  options.spacing = 1;
  options.max_cuts = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const Vec3 a = random_point(rng), b = random_point(rng);
    const Vec3 c = trial % 3 == 0 ? Vec3((a + b) / 2 + 0.1 * random_point(rng)) : random_point(rng);
    const Mesh triangle = soup_mesh({{a, b, c}});
    std::vector<std::array<Vec3, 3>> dots;
    for (const Vec3& x : {a, b, c, Vec3((a + b + c) / 3)})
      dots.push_back({x, x + 1e-9 * Vec3::UnitX(), x + 1e-9 * Vec3::UnitY()});
    const Mesh points = soup_mesh(dots);
    const OneSidedDistance d = one_sided_distance(triangle, points, options);
    double farthest = 0;
    constexpr int kSteps = 60;
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; i + j <= kSteps; ++j) {
        const Vec3 x = a + i / double(kSteps) * (b - a) + j / double(kSteps) * (c - a);
        farthest = std::max(farthest, static_cast<double>(brute_distance(points, x)));
      }
    }
    CHECK(farthest <= d.hausdorff * (1 + 1e-12));
    CHECK(d.hausdorff <= 1.1 * farthest);
  }
}

TEST_CASE("surface_distance: the quadrature is far better than the error it tells, where distance is smooth") {
  const Mesh point = soup_mesh({{Vec3(0, 0, 1), Vec3(1e-12, 0, 1), Vec3(0, 1e-12, 1)}});
  DistanceOptions options;
  options.spacing = 0.1;
  const OneSidedDistance d = one_sided_distance(amps::make_square(3), point, options);
  double mean = 0, square = 0;
  constexpr int kCells = 1000;
  for (int i = 0; i < kCells; ++i) {
    for (int j = 0; j < kCells; ++j) {
      const double x = (i + 0.5) / kCells, y = (j + 0.5) / kCells;
      const double d2 = x * x + y * y + 1;
      mean += std::sqrt(d2) / (kCells * kCells);
      square += d2 / (kCells * kCells);
    }
  }
  CHECK(std::abs(d.mean - mean) < 0.02 * d.mean_error);
  CHECK(std::abs(d.rms - std::sqrt(square)) < 0.02 * d.rms_error);
  CHECK(d.mean_error < 2e-3);
}

TEST_CASE("surface_distance: part of a surface is on it, not the other way round") {
  const Mesh whole = amps::make_square(4);
  const Mesh half = first_facets(whole, rows(whole.triangles) / 2);  // y < ½
  const DistanceReport d = surface_distance(half, whole);
  CHECK(d.forward.hausdorff <= DistanceOptions().tolerance * d.diagonal);
  CHECK(d.forward.rms <= 1e-15);
  CHECK(d.backward.hausdorff_lower == Approx(0.5));
  CHECK(d.hausdorff() == d.backward.hausdorff);
  CHECK(d.rms() == d.backward.rms);
  CHECK(d.mean() == d.backward.mean);
}

TEST_CASE("surface_distance: facets without area count in the Hausdorff distance alone, isolated vertices nowhere") {
  const Mesh square = amps::make_square(2);
  const Mesh spike = with_facet(square, Vec3(0.5, 0.5, 0), Vec3(0.5, 0.5, 0.75), Vec3(0.5, 0.5, 0.25));
  const OneSidedDistance d = one_sided_distance(spike, square);
  CHECK(d.hausdorff == 0.75);
  CHECK(d.hausdorff_lower == 0.75);
  CHECK(d.farthest.position == Vec3(0.5, 0.5, 0.75));
  CHECK(d.rms <= 1e-15);
  CHECK(one_sided_distance(square, spike).hausdorff <= 2e-6);
  const Mesh sphere = amps::make_sphere(80);
  for (const double far : {1e10, 1e300}) {
    const Mesh more = with_vertices(sphere, {Vec3::Constant(far)});
    CHECK(same(surface_distance(more, square), surface_distance(sphere, square)));
    CHECK(same(surface_distance(square, more), surface_distance(square, sphere)));
  }
}

TEST_CASE("surface_distance: the second mesh first, both directions change places") {
  Rng rng(3);
  const Mesh a = amps::make_cube(2);
  // The same box, so that tolerance and spacing are the same.
  const Mesh b = transformed(amps::make_cube(5), [](const Vec3& x) -> Vec3 {
    return ((x.array() > 0) && (x.array() < 1)).count() == 2 ? Vec3(0.9 * x + 0.05 * Vec3::Ones()) : x;
  });
  const DistanceReport ab = surface_distance(a, b), ba = surface_distance(b, a);
  CHECK(same(ab.forward, ba.backward));
  CHECK(same(ab.backward, ba.forward));
  CHECK(same(ab.forward, one_sided_distance(a, b)));
  CHECK(same(ab.backward, one_sided_distance(b, a)));
  CHECK(ab.hausdorff() == ba.hausdorff());
  CHECK(ab.hausdorff() > 0.01);
}

TEST_CASE("surface_distance: the same bits for any number of threads") {
  Rng rng(4);
  const Mesh a = amps::make_torus();
  const Mesh b = shaken(amps::make_torus(1, 0.4, 61, 23), 0.01, rng);
  DistanceOptions options;
  options.tolerance = 1e-6;
  const DistanceReport one = surface_distance(a, b, options);
  for (const unsigned threads : {0u, 2u, 5u}) {
    run_on(options, threads);
    CHECK(same(one, surface_distance(a, b, options)));
  }
}

TEST_CASE("surface_distance: any scale; powers of two change no bit") {
  const Mesh a = amps::make_sphere(320), b = amps::make_cube(3);
  const DistanceReport d = surface_distance(a, b);
  for (const double scale : {std::ldexp(1.0, 12), std::ldexp(1.0, -300), 1e-140, 1e140}) {
    const DistanceReport other = surface_distance(scaled(a, scale), scaled(b, scale));
    int exponent = 0;
    const bool exact = std::frexp(scale, &exponent) == 0.5;
    const double epsilon = exact ? 0 : 1e-12;  // another scale, another rounding of the vertices
    for (const auto& [x, y] : {std::pair(&d.forward, &other.forward), {&d.backward, &other.backward}}) {
      CHECK(std::abs(x->hausdorff - y->hausdorff / scale) <= (exact ? 0 : 1e-6 * d.diagonal));
      CHECK(std::abs(x->hausdorff_lower - y->hausdorff_lower / scale) <= (exact ? 0 : 1e-6 * d.diagonal));
      CHECK(std::abs(x->rms - y->rms / scale) <= epsilon);
      CHECK(std::abs(x->mean - y->mean / scale) <= epsilon);
      CHECK(std::abs(x->rms_error - y->rms_error / scale) <= epsilon);
    }
    CHECK(d.percent(d.rms()) == Approx(other.percent(other.rms())).epsilon(1e-12));
  }
}

TEST_CASE("surface_distance: slivers much longer than wide") {
  // 60 strips of 1 by 1/60, halved at their longest sides.
  std::vector<Vec3> ends;
  std::vector<Corners> halves;
  for (Index i = 0; i <= 60; ++i) {
    ends.insert(ends.end(), {Vec3(0, i / 60.0, 0), Vec3(1, i / 60.0, 0)});
  }
  for (Index i = 0; i < 60; ++i) {
    halves.push_back({2 * i, 2 * i + 1, 2 * i + 3});
    halves.push_back({2 * i, 2 * i + 3, 2 * i + 2});
  }
  const Mesh strips = mesh_of(ends, halves);
  const Mesh roof = transformed(amps::make_square(2), [](const Vec3& x) -> Vec3 {  // |z| is ½ − |x − ½|
    return {x.x(), x.y(), 0.5 - std::abs(x.x() - 0.5)};
  });
  const OneSidedDistance d = one_sided_distance(strips, roof);
  CHECK(d.hausdorff_lower == Approx(std::sqrt(0.125)));  // from the middle, a slope of 45°
  CHECK(d.hausdorff == Approx(std::sqrt(0.125)).epsilon(1e-3));
  CHECK(std::abs(d.mean - std::sqrt(0.125) / 2) <= 1e-3);
}

TEST_CASE("surface_distance: bad meshes and options are refused") {
  const Mesh good = amps::make_square();
  const Mesh flat = transformed(good, [](const Vec3& x) -> Vec3 { return {x.x(), 0, x.z()}; });
  Mesh nan = good;
  nan.vertices(2, 1) = std::nan("");
  Mesh range = good;
  range.triangles(0, 0) = 4;
  for (const Mesh& bad : {flat, nan, range, without_facets(good)}) {
    CHECK(error_of([&] { surface_distance(good, bad); }) == ErrorCode::kInvalidMesh);
    CHECK(error_of([&] { surface_distance(bad, good); }) == ErrorCode::kInvalidMesh);
    CHECK(error_of([&] { one_sided_distance(bad, good); }) == ErrorCode::kInvalidMesh);
  }
  const auto refused = [&](double DistanceOptions::*field, double value) {
    DistanceOptions options;
    options.*field = value;
    return error_of([&] { surface_distance(good, good, options); }) == ErrorCode::kInvalidArgument;
  };
  for (const double x : {0.0, -1.0, 1e-13, 1.5, std::nan("")}) {
    CHECK(refused(&DistanceOptions::tolerance, x));
    CHECK(refused(&DistanceOptions::spacing, x));
  }
  DistanceOptions negative;
  negative.max_cuts = -1;
  CHECK(error_of([&] { surface_distance(good, good, negative); }) == ErrorCode::kInvalidArgument);
}

TEST_CASE("surface_distance: the report in words, whatever the stream's format") {
  const DistanceReport d = surface_distance(amps::make_square(), moved(amps::make_square(), {0, 0, 0.5}));
  std::ostringstream out;
  out.precision(2);
  out << std::hex << std::scientific << d;
  CHECK(out.str().find("RMS       0.5 (35.3553 % of the diagonal)") != std::string::npos);
  CHECK(out.str().find("Hausdorff 0.5") == 0);
}

}  // namespace amps_test

TEST_CASE("surface distance: points farther than asked for are listed, with their distances") {
  const amps::Mesh sphere = amps::make_sphere(320), cut = amps::make_sphere(80);
  const amps::SurfaceTree tree(cut);
  const double farthest = amps::one_sided_distance(sphere, cut).hausdorff;
  for (const double share : {0.3, 0.9}) {
    const std::vector<amps::detail::FarPoint> points = amps::detail::far_points(sphere, cut, tree, share * farthest, {});
    REQUIRE(!points.empty());
    double greatest = 0;
    for (const amps::detail::FarPoint& p : points) {
      const double brute = static_cast<double>(amps_test::brute_distance(cut, p.position));
      CHECK(std::abs(p.distance - brute) <= 1e-12);
      CHECK(p.distance > share * farthest);
      greatest = std::max(greatest, p.distance);
    }
    CHECK(greatest <= farthest * (1 + 1e-12));
    // Facets that have vertices as far as that are all there.
    for (amps::Index f = 0; f < static_cast<amps::Index>(sphere.triangles.rows()); ++f) {
      double corner = 0;
      for (int k = 0; k < 3; ++k) {
        corner = std::max(corner, static_cast<double>(amps_test::brute_distance(cut, amps::MeshView(sphere).corner(f, k))));
      }
      const bool listed = std::any_of(points.begin(), points.end(), [f](const auto& p) { return p.facet == f; });
      if (corner > share * farthest * (1 + 1e-9)) CHECK(listed);
    }
  }
  CHECK(amps::detail::far_points(sphere, cut, tree, 1.02 * farthest, {}).empty());
}
