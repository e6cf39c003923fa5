// What a call will need is known before it begins: needles, whose area says nothing about it.
#include "amps/count_model.h"

#include "kit/data.h"
#include "kit/errors.h"
#include "kit/meshes.h"
#include "kit/samples.h"

#include "amps/maximality.h"
#include "amps/power_diagram.h"
#include "amps/remesh.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <cmath>
#include <string>
#include <vector>

namespace amps_test {
namespace {

/// Needles of length 1, side by side.
Mesh needles(Index n, double width, double apart = 0.025) {
  std::vector<Vec3> vertices;
  std::vector<Corners> triangles;
  for (Index k = 0; k < n; ++k) {
    const double y = k * apart;
    vertices.insert(vertices.end(), {Vec3(0, y, 0), Vec3(1, y, 0), Vec3(1, y + width, 0)});
    triangles.push_back({3 * k, 3 * k + 1, 3 * k + 2});
  }
  return mesh_of(vertices, triangles);
}

/// A prism without ends, of 2·sides needles.
Mesh prism(Index sides, double length, double radius) {
  std::vector<Vec3> vertices;
  std::vector<Corners> triangles;
  for (Index k = 0; k < sides; ++k) {
    const double angle = 2 * 3.14159265358979 * k / sides;
    for (const double z : {0.0, length}) vertices.emplace_back(radius * std::cos(angle), radius * std::sin(angle), z);
    const Index a = 2 * k, b = 2 * ((k + 1) % sides);
    triangles.push_back({a, b, b + 1});
    triangles.push_back({a, b + 1, a + 1});
  }
  return mesh_of(vertices, triangles);
}

struct Counted {
  double samples, fragments;
};

/// Of a maximal set.
Counted counted(const Mesh& mesh, const SampleSet& samples) {
  const amps::RestrictedPowerDiagram diagram(mesh, samples.positions, amps::detail::weights_of(samples.radii));
  return {double(samples.size()), double(diagram.num_fragments())};
}

}  // namespace

TEST_CASE("count model: fragments of usual meshes and of needles are foreseen") {
  struct Shape {
    Mesh mesh;
    double radius;
  };
  const std::vector<Shape> shapes = {{amps::make_sphere(1280), 0.05}, {amps::make_sphere(20480), 0.1}, {small_knot(), 0.2},
                                     {amps::make_square(1), 0.02},    {prism(200, 400, 1), 1},         {prism(1000, 100, 2), 1},
                                     {needles(3, 1e-12), 0.003}};
  for (std::size_t k = 0; k < shapes.size(); ++k) {
    CAPTURE(k);
    const Shape& shape = shapes[k];
    const amps::detail::ForeseenSize size = amps::detail::foresee_size(
        shape.mesh, amps::total_area(shape.mesh), amps::detail::WantedRadii(shape.radius, ConflictRule::kMax), 1e6);
    const Counted is = counted(shape.mesh, amps::sample(shape.mesh, with_radius(shape.radius)).samples);
    CAPTURE(size.samples());
    CAPTURE(is.samples);
    CAPTURE(is.fragments);
    const double fragments = rows(shape.mesh.triangles) + size.samples() + size.crossings;
    CAPTURE(fragments);
    CHECK(size.samples() < 1.15 * is.samples);  // a lower bound, or by area
    CHECK(fragments > 0.6 * is.fragments);
    CHECK(fragments < 1.6 * is.fragments);
  }
}

TEST_CASE("count model: with a field fragments are foreseen, too") {
  const Mesh mesh = prism(100, 200, 1);
  const SizingField field = amps::vertex_sizing(mesh, graded_radii(mesh, 4, 2));
  const amps::detail::ForeseenSize size =
      amps::detail::foresee_size(mesh, amps::total_area(mesh), amps::detail::WantedRadii(field, ConflictRule::kMax), 1e6);
  const Counted is = counted(mesh, amps::sample(mesh, with_sizing(field)).samples);
  CAPTURE(size.crossings);
  CAPTURE(is.fragments);
  CHECK(size.crossings > 0.5 * is.fragments);
  CHECK(size.crossings < 2 * is.fragments);
}

TEST_CASE("count model: needles get the wanted number, by their length") {
  for (const Mesh& mesh : {data_mesh_or("reports/n1.obj", needles(1, 1e-12)), needles(1, 1e-12), needles(1, 1e-4),
                           needles(1, 1e-3), data_mesh_or("reports/needles40.obj", needles(40, 1e-12)), needles(40, 1e-12),
                           needles(40, 1e-6), prism(30, 300, 1e-6)}) {
    for (const Index count : {400, 2000}) {
      CAPTURE(count);
      CAPTURE(rows(mesh.triangles));
      const SamplingResult result = amps::sample(mesh, with_count(count));
      CHECK(std::fabs(result.samples.size() - count) <= 0.02 * count);
      CHECK(result.report.attempts < 12);
      const amps::MaximalityReport report = amps::verify_maximal(mesh, result.samples);
      CHECK(report.maximal());
      CHECK(report.worst_separation >= 1 - 1e-9);
    }
  }
}

TEST_CASE("count model: with a field, needles get the wanted number") {
  const Mesh mesh = needles(5, 1e-12);
  SamplingOptions options = with_sizing(amps::vertex_sizing(mesh, graded_radii(mesh, 3, 0)));
  options.target_count = 1000;
  const SamplingResult result = amps::sample(mesh, options);
  CHECK(std::fabs(result.samples.size() - 1000) <= 20);
}

TEST_CASE("sampling: needles cut into more pieces than there is memory for are refused, with a radius that helps") {
  // A sample of a prism takes hundreds of pieces: it is these that are too many.
  const Mesh pieces = prism(400, 400, 1);
  SamplingOptions options = with_radius(0.5);
  options.max_samples = 20000;
  const std::string text = error_text([&] { amps::sample(pieces, options); });
  CAPTURE(text);
  CHECK(text.find("pieces, more than max_samples") != std::string::npos);
  const std::string radius_text = "a radius of at least ";
  const auto advised = [&](const std::string& error) {
    const std::size_t at = error.find(radius_text);
    REQUIRE(at != std::string::npos);
    return std::stod(error.substr(at + radius_text.size()));
  };
  options.radius = advised(text);
  CHECK(options.radius > 0.5);
  CHECK(amps::sample(pieces, options).samples.size() > 60);

  // Needles apart: each takes samples along its length.
  const Mesh apart = needles(40, 1e-12);
  options.radius = 1e-4;  // 40 · 0.748 / 1e-4 = 299,200
  const std::string longer = error_text([&] { amps::sample(apart, options); });
  CAPTURE(longer);
  CHECK(longer.find("299200 samples, more than max_samples, 20000") != std::string::npos);
  options.radius = advised(longer);
  const Index n = amps::sample(apart, options).samples.size();
  CHECK(n > 19000);
  CHECK(n < 20500);
  // On one place they take the samples of one.
  const Mesh together = needles(40, 1e-12, 1e-14);
  options.radius = 1e-3;
  CHECK(amps::sample(together, options).samples.size() < 1000);
  options.radius = 1e-5;
  CHECK(error_of([&] { amps::sample(together, options); }) == ErrorCode::kTooLarge);
}

TEST_CASE("remesh: needles whose sides no curves can keep apart are refused at once, and told where") {
  for (const Mesh& mesh : {data_mesh_or("reports/n1.obj", needles(1, 1e-12)),
                           data_mesh_or("reports/needles40.obj", needles(40, 1e-12)), needles(40, 1e-12)}) {
    for (const SamplingOptions& sampling : {with_count(2000), with_radius(0.0005)}) {
      const Thrown thrown = thrown_by([&] { amps::remesh(mesh, plain(sampling)); });
      CAPTURE(thrown.text);
      CHECK(thrown.code == ErrorCode::kTooLarge);
      CHECK(thrown.text.find("needles or thin plates") != std::string::npos);
      CHECK(thrown.text.find("most so near (") != std::string::npos);
    }
  }
}

}  // namespace amps_test
