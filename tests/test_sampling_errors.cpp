// Sampling that cannot be: refused, and why.
#include "amps/sampling.h"

#include "kit/errors.h"
#include "kit/execution.h"
#include "kit/meshes.h"
#include "kit/samples.h"

#include "amps/maximality.h"
#include "amps/remesh.h"

#include <doctest/doctest.h>

#include <functional>
#include <string>
#include <vector>

namespace amps_test {

TEST_CASE("sampling: options that make no sense") {
  const Mesh mesh = amps::make_sphere(320);
  const auto sampling = [&](const SamplingOptions& options) { return error_of([&] { amps::sample(mesh, options); }); };
  const auto darts = [&](const SamplingOptions& options) { return error_of([&] { amps::throw_darts(mesh, options); }); };
  for (const double bad : {0.0, -1.0, -0.0, kNaN, kInfinity, -kInfinity}) {
    CAPTURE(bad);
    CHECK(sampling(with_radius(bad)) == ErrorCode::kInvalidArgument);
    CHECK(darts(with_radius(bad)) == ErrorCode::kInvalidArgument);
  }
  SamplingOptions both = with_radius(0.1);
  both.target_count = 100;
  CHECK(sampling(both) == ErrorCode::kInvalidArgument);
  CHECK(darts(both) == ErrorCode::kInvalidArgument);
  CHECK(sampling(SamplingOptions{}) == ErrorCode::kInvalidArgument);
  CHECK(sampling(with_count(-5)) == ErrorCode::kInvalidArgument);
  CHECK(darts(with_count(100)) == ErrorCode::kInvalidArgument);
  for (const int rejections : {0, -300}) {
    SamplingOptions options = with_radius(0.1);
    options.max_rejections = rejections;
    CHECK(sampling(options) == ErrorCode::kInvalidArgument);
    CHECK(darts(options) == ErrorCode::kInvalidArgument);
  }
}

TEST_CASE("sampling: a radius far too small is refused with an estimate, before any work") {
  const Mesh mesh = amps::make_sphere(320);
  for (const double radius : {1e-5, 1e-9, 1e-160, 5e-324}) {
    CAPTURE(radius);
    SamplingOptions options = with_radius(radius);
    int reports = 0;
    watch(options, [&](const char*, double) { return ++reports > 0; });
    CHECK(error_of([&] { amps::sample(mesh, options); }) == ErrorCode::kTooLarge);
    CHECK(error_of([&] { amps::throw_darts(mesh, options); }) == ErrorCode::kTooLarge);
    CHECK(error_of([&] { amps::fill_gaps(mesh, one_sample({0, 0, 1}, 1), options); }) == ErrorCode::kTooLarge);
    CHECK(reports == 0);
  }
  const std::string text = error_text([&] { amps::sample(mesh, with_radius(1e-5)); });
  CAPTURE(text);
  CHECK(text.find("radius") != std::string::npos);
  CHECK(text.find("e+10 samples") != std::string::npos);  // 0.70 · 4π / 1e-10
  CHECK(error_of([&] { amps::sample(mesh, with_count(2000000000)); }) == ErrorCode::kTooLarge);
}

TEST_CASE("sampling: meshes that cannot be sampled") {
  const Mesh good = amps::make_sphere(320);
  const SampleSet set = one_sample({0, 0, 1}, 0.5);
  const auto refused = [&](const Mesh& mesh) {
    for (const auto& call : std::vector<std::function<void()>>{
             [&] { amps::sample(mesh, with_radius(0.1)); }, [&] { amps::sample(mesh, with_count(10)); },
             [&] { amps::throw_darts(mesh, with_radius(0.1)); }, [&] { amps::fill_gaps(mesh, set, with_radius(0.1)); },
             [&] { amps::verify_maximal(mesh, set); }, [&] { amps::find_gaps(mesh, set); }}) {
      CHECK(error_of(call) == ErrorCode::kInvalidMesh);
    }
  };
  refused(Mesh{});
  refused(without_facets(good));
  Mesh mesh;
  for (const double bad : {kNaN, kInfinity}) {
    mesh = good;
    mesh.vertices(10, 1) = bad;
    refused(mesh);
  }
  for (const Index bad : {-1, 100000}) {
    mesh = good;
    mesh.triangles(10, 1) = bad;
    refused(mesh);
  }
  refused(squashed(good));
  refused(scaled(good, 0));
}

TEST_CASE("sampling: sample sets that cannot be worked with") {
  const Mesh mesh = amps::make_sphere(320);
  const SampleSet good = amps::sample(mesh, with_radius(0.5)).samples;
  const auto refused = [&](const SampleSet& set) {
    for (const auto& call : std::vector<std::function<void()>>{
             [&] { amps::fill_gaps(mesh, set, with_radius(0.1)); }, [&] { amps::verify_maximal(mesh, set); },
             [&] { amps::find_gaps(mesh, set); }, [&] { amps::restricted_triangulation(mesh, set); }}) {
      CHECK(error_of(call) == ErrorCode::kInvalidArgument);
    }
  };
  refused(SampleSet{});
  for (const double bad : {0.0, -0.5, kNaN, kInfinity}) {
    SampleSet set = good;
    set.radii[3] = bad;
    refused(set);
  }
  for (const double bad : {kNaN, -kInfinity}) {
    SampleSet set = good;
    set.positions(3, 0) = bad;
    refused(set);
  }
  SampleSet set = good;
  set.radii = head(set.radii, set.size() - 1);
  refused(set);
  // A radius that would let new disks cover old samples.
  CHECK(error_of([&] { amps::fill_gaps(mesh, good, with_radius(0.51)); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { amps::fill_gaps(mesh, good, with_count(100)); }) == ErrorCode::kInvalidArgument);
}

TEST_CASE("sampling: facets and barycentrics of the wrong length are refused") {
  const Mesh mesh = amps::make_sphere(320);
  SampleSet set = amps::sample(mesh, with_radius(0.5)).samples;
  set.barycentrics = head(set.barycentrics, 2);
  CHECK(error_of([&] { amps::fill_gaps(mesh, set, with_radius(0.1)); }) == ErrorCode::kInvalidArgument);
  set = amps::sample(mesh, with_radius(0.5)).samples;
  set.facets.resize(2);
  CHECK(error_of([&] { amps::fill_gaps(mesh, set, with_radius(0.1)); }) == ErrorCode::kInvalidArgument);
}

}  // namespace amps_test
