// Radii that fall where the dual has not the topology of the surface: remesh() with Topology::kPreserve, and the set that is
// edited for it.
#include "amps/topology_refinement.h"

#include "kit/bits.h"
#include "kit/curves.h"
#include "kit/data.h"
#include "kit/diagrams.h"
#include "kit/execution.h"
#include "kit/meshes.h"
#include "kit/models.h"
#include "kit/random.h"
#include "kit/samples.h"
#include "kit/topology.h"

#include "amps/maximality.h"
#include "amps/remesh.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace amps_test {
namespace {

using amps::Outcome;
using amps::RemeshResult;
using amps::Topology;
using amps::detail::CapField;
using amps::detail::RadiusCap;
using amps::detail::RefinedSet;
using amps::detail::WantedRadii;

// Surfaces with parts that are small against the radius.

Mesh box(const Vec3& low, const Vec3& size) {
  return transformed(amps::make_cube(1), [&](const Vec3& x) { return Vec3(low + x.cwiseProduct(size)); });
}

/// A cube of side 1, and fifty boxes of side .02 to .12 around it.
Mesh small_parts() {
  Mesh result = box({0, 0, 0}, {1, 1, 1});
  Rng rng(3);
  for (int k = 0; k < 50; ++k) {
    const Vec3 low(1.2 + 0.2 * (k % 5), 0.2 * (k / 5 % 5), 0.2 * (k / 25));
    const Vec3 size = Vec3::Constant(0.02) + 0.1 * random_point(rng);
    result = joined(result, box(low, size));
  }
  return result;
}

/// A ring of radius 1 with a tube of this circumference.
Mesh thin_tube(double circumference) { return amps::make_torus(1.0, circumference / (2 * kPi), 96, 12); }

/// The surface of unit cubes, as quads in two; each vertex once.
Mesh surface_of_cubes(const std::set<std::array<int, 3>>& cubes) {
  std::vector<std::array<Vec3, 3>> facets;
  for (const std::array<int, 3>& cube : cubes) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (const int side : {0, 1}) {
        std::array<int, 3> beside = cube;
        beside[axis] += side == 1 ? 1 : -1;
        if (cubes.count(beside) > 0) continue;
        const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
        std::array<Vec3, 4> quad;
        for (std::size_t k = 0; k < 4; ++k) {
          std::array<double, 3> x = {double(cube[0]), double(cube[1]), double(cube[2])};
          x[axis] += side;
          x[u] += k == 1 || k == 2 ? 1 : 0;
          x[v] += k >= 2 ? 1 : 0;
          quad[k] = {x[0], x[1], x[2]};
        }
        if (side == 0) std::swap(quad[1], quad[3]);
        facets.push_back({quad[0], quad[1], quad[2]});
        facets.push_back({quad[0], quad[2], quad[3]});
      }
    }
  }
  return amps::merge_equal_vertices(soup_mesh(facets));
}

/// A block of 8³ with a handle of 1².
Mesh block_with_handle() {
  std::set<std::array<int, 3>> cubes;
  for (int x = 0; x < 8; ++x) {
    for (int y = 0; y < 8; ++y) {
      for (int z = 0; z < 8; ++z) cubes.insert({x, y, z});
    }
  }
  for (int z = 8; z < 12; ++z) cubes.insert({{2, 3, z}}), cubes.insert({{5, 3, z}});
  for (int x = 2; x <= 5; ++x) cubes.insert({x, 3, 11});
  return surface_of_cubes(cubes);
}

Mesh nested_shells(double distance) {
  return joined(amps::make_sphere(1280), inside_out(amps::make_sphere(1280, 1 - distance)));
}

/// Walls along an outline with teeth.
Mesh saw(int teeth, double height) {
  Polygon outline = {{0, -1, 0}, {1, -1, 0}};
  for (int k = 0; k < teeth; ++k) {
    outline.emplace_back(1 - double(k) / teeth, 0, 0);
    outline.emplace_back(1 - (k + 0.5) / teeth, height, 0);
  }
  outline.emplace_back(0, 0, 0);
  return prism(outline, 1, Vec3::Zero(), false);
}

struct Case {
  std::string name;
  Mesh mesh;
  double radius;
  bool curves = true;
};

std::vector<Case> cases() {
  std::vector<Case> result = {{"small parts", small_parts(), 0.2},
                              {"small parts without curves", small_parts(), 0.2, false},
                              {"handle", block_with_handle(), 1.5},
                              {"handle without curves", block_with_handle(), 1.5, false},
                              {"nested shells", nested_shells(0.01), 0.3},
                              {"cube in one disk", amps::make_cube(1), 3},
                              {"cube in one disk without curves", amps::make_cube(1), 3, false},
                              {"wedge of 15 degrees without curves", wedge(15), 0.15, false},
                              {"saw", saw(16, 0.1), 0.2}};
  for (const double share : {0.5, 1.0, 2.0, 4.0}) {
    result.push_back({"tube of " + std::to_string(share) + " radii", thin_tube(0.25 * share), 0.25});
  }
  return result;
}

RemeshOptions options_of(const Case& one, std::uint64_t seed = 1) {
  const RemeshOptions options = plain(with_radius(one.radius, seed));
  return one.curves ? options : without_curves(options);
}

Invariants invariants_of_report(const amps::TopologyReport& report) {
  return {report.components, report.euler_characteristic, report.boundary_loops, report.non_manifold_edges > 0};
}

/// Everything that is promised where the topology is kept.
void check_kept(const Mesh& mesh, const RemeshResult& result, double radius) {
  const amps::RemeshReport& report = result.report;
  CHECK(report.certificate.holds());
  CHECK(amps::lost_shape(report).empty());
  CHECK(result.status < Outcome::kShapeChanged);
  CHECK(invariants_of(result.mesh) == invariants_of_surface(mesh));
  CHECK(invariants_of_report(report.output) == invariants_of_report(report.input));
  CHECK(report.curves.edges_kept == report.curves.edges);
  CHECK(report.maximality.maximal());
  CHECK(report.maximality.poisson_disk());
  CHECK(max_of(result.samples.radii) <= radius);
}

using Disk = std::array<double, 4>;
std::set<Disk> disks_where(const SampleSet& set, const std::function<bool(const Vec3&)>& where) {
  std::set<Disk> result;
  for (Index s = 0; s < set.size(); ++s) {
    const Vec3 x = sample_at(set, s);
    if (where(x)) result.insert({x[0], x[1], x[2], set.radii[s]});
  }
  return result;
}

}  // namespace

TEST_CASE("topology_refinement: the dual has the topology of the surface, and the set is maximal") {
  int refined = 0;
  for (const Case& one : cases()) {
    const std::string& name = one.name;
    CAPTURE(name);
    for (const std::uint64_t seed : {1u, 2u, 3u}) {
      CAPTURE(seed);
      const RemeshResult result = amps::remesh(one.mesh, options_of(one, seed));
      check_kept(one.mesh, result, one.radius);
      refined += result.report.sampling.refinements > 0 ? 1 : 0;
      const amps::SamplingReport& report = result.report.sampling;
      CHECK(report.curve_samples + report.dart_samples + report.gap_samples == result.samples.size());
      CHECK(report.min_radius == min_of(result.samples.radii));
      CHECK(report.max_radius == max_of(result.samples.radii));
      CHECK(report.mean_radius == doctest::Approx(mean_of(result.samples.radii)));
    }
  }
  CHECK(refined > 20);
}

TEST_CASE("topology_refinement: asked to report, it changes nothing and says so") {
  for (const Case& one : {Case{"tube", thin_tube(0.25), 0.25}, Case{"parts", small_parts(), 0.2, false}}) {
    const std::string& name = one.name;
    CAPTURE(name);
    RemeshOptions options = options_of(one);
    options.topology = Topology::kReport;
    const RemeshResult result = amps::remesh(one.mesh, options);
    CHECK(result.report.sampling.refinements == 0);
    CHECK(!result.report.certificate.holds());
    CHECK(!amps::lost_shape(result.report).empty());
    CHECK(result.status == Outcome::kShapeChanged);
  }
}

TEST_CASE("topology_refinement: balls are never refined") {
  RemeshOptions options = plain(with_radius(0.25));
  options.sampling.neighborhood = amps::Neighborhood::kSpace;
  const RemeshResult result = amps::remesh(thin_tube(0.25), options);
  CHECK(result.report.sampling.refinements == 0);
  CHECK(result.report.certificate.cells == 0);
  CHECK(all_equal(result.samples.radii, 0.25));
}

TEST_CASE("topology_refinement: samples away from failures stay, bit for bit") {
  const Mesh mesh = joined(amps::make_sphere(1280), moved(thin_tube(0.2), {4, 0, 0}));
  RemeshOptions options = plain(with_radius(0.2));
  const RemeshResult kept = amps::remesh(mesh, options);
  options.topology = Topology::kReport;
  const RemeshResult before = amps::remesh(mesh, options);
  CHECK(kept.report.sampling.refinements > 0);
  const auto on_sphere = [](const Vec3& x) { return x.x() < 2; };
  const std::set<Disk> disks = disks_where(before.samples, on_sphere);
  CHECK(disks.size() > 100);
  CHECK(disks_where(kept.samples, on_sphere) == disks);
}

TEST_CASE("topology_refinement: any number of threads gives the same bits") {
  for (const Case& one : {Case{"parts", small_parts(), 0.2}, Case{"tube", thin_tube(0.25), 0.25}}) {
    const std::string& name = one.name;
    CAPTURE(name);
    RemeshOptions options = options_of(one);
    const RemeshResult first = amps::remesh(one.mesh, options);
    for (const unsigned threads : {2u, 5u}) {
      run_on(options.sampling, threads);
      const RemeshResult result = amps::remesh(one.mesh, options);
      CHECK(same_set(result.samples, first.samples));
      CHECK(same_values(result.mesh.triangles, first.mesh.triangles));
      CHECK(result.report.sampling.refinements == first.report.sampling.refinements);
    }
  }
}

TEST_CASE("topology_refinement: cancelled at any look, a Poisson-disk set is left") {
  for (const Case& one : {Case{"parts", small_parts(), 0.2}, Case{"tube", thin_tube(0.25), 0.25},
                          Case{"saw", saw(16, 0.1), 0.2}, Case{"shells", nested_shells(0.03), 0.4}}) {
    const std::string& name = one.name;
    CAPTURE(name);
    RemeshOptions options = options_of(one);
    int looks = 0;
    double last = 0;
    bool rises = true;
    watch(options.sampling, [&](const char*, double fraction) {
      ++looks;
      rises = rises && fraction >= last;
      last = fraction;
      return true;
    });
    const RemeshResult whole = amps::remesh(one.mesh, options);
    REQUIRE(whole.status == Outcome::kDone);
    if (name == "shells") CHECK(whole.report.further_runs > 0);  // their triangles cross at first
    CHECK(rises);
    CHECK(last == 1);
    constexpr int kTries = 40;
    bool was_complete = false;
    for (int k = 0; k < kTries; ++k) {
      const int until = k * looks / kTries;
      CAPTURE(until);
      int seen = 0;
      bool refining = false;
      watch(options.sampling, [&](const char* stage, double) {
        refining = refining || std::string(stage) == "keeping the topology";
        return ++seen <= until;
      });
      const RemeshResult result = amps::remesh(one.mesh, options);
      CHECK(result.status == Outcome::kCancelled);
      CHECK(same_bits(result.mesh.vertices, result.samples.positions));
      if (result.samples.size() == 0) {
        CHECK(!was_complete);
        continue;
      }
      const auto report =
          amps::verify_maximal(one.mesh, result.samples, {}, ConflictRule::kMax, Neighborhood::kSurface, result.graph.get());
      CHECK(report.poisson_disk());
      if (refining) CHECK(report.maximal());
      was_complete = was_complete || refining;
    }
  }
}

TEST_CASE("topology_refinement: optimised, the topology stays") {
  for (const Case& one : {Case{"parts", small_parts(), 0.1}, Case{"handle", block_with_handle(), 1.5, false},
                          Case{"tube", thin_tube(0.5), 0.25}, Case{"shells", nested_shells(0.01), 0.3}}) {
    const std::string& name = one.name;
    CAPTURE(name);
    for (const auto& bounds : {std::array<double, 2>{35, 105}, std::array<double, 2>{42, 90}}) {
      const double min_angle = bounds[0];
      CAPTURE(min_angle);
      RemeshOptions options = options_of(one);
      options.optimize = true;
      options.optimization.min_angle = bounds[0];
      options.optimization.max_angle = bounds[1];
      const RemeshResult result = amps::remesh(one.mesh, options);
      check_kept(one.mesh, result, one.radius);
    }
  }
}

TEST_CASE("topology_refinement: another number of samples than asked for") {
  RemeshOptions options = plain(with_count(100));
  const RemeshResult result = amps::remesh(small_parts(), options);  // 51 boxes have 408 corners
  CHECK(result.report.certificate.holds());
  CHECK(result.samples.size() > 408);
  CHECK(result.status == Outcome::kCountMissed);
  const RemeshResult met = amps::remesh(amps::make_torus(), plain(with_count(1000)));
  CHECK(met.status == Outcome::kDone);
}

TEST_CASE("topology_refinement: it adds no more samples than allowed, and then the set is that without it") {
  RemeshOptions options = plain(with_radius(0.2));
  options = without_curves(options);
  options.sampling.max_samples = 200;
  const Mesh mesh = small_parts();
  const RemeshResult result = amps::remesh(mesh, options);
  CHECK(result.status == Outcome::kShapeChanged);
  options.topology = Topology::kReport;
  CHECK(same_set(result.samples, amps::remesh(mesh, options).samples));
}

TEST_CASE("topology_refinement: smaller disks than a grid has room for are given up") {
  // Grids have 2^22 radii a side.
  const Mesh mesh = joined(amps::make_cube(1), moved(amps::make_cube(1), {5e6, 0, 0}));
  const RemeshResult result = amps::remesh(mesh, without_curves(plain(with_radius(1.5))));
  CHECK(result.status == Outcome::kShapeChanged);
  CHECK(all_equal(result.samples.radii, 1.5));
}

TEST_CASE("topology_refinement: what is lost, in words") {
  amps::RemeshReport report;
  CHECK(amps::lost_shape(report).find("no triangle") != std::string::npos);
  report.input.facets = report.output.facets = 8;
  report.input.components = report.output.components = 1;
  CHECK(amps::lost_shape(report).empty());
  report.output.components = 2;
  CHECK(amps::lost_shape(report).find("components 1 -> 2") != std::string::npos);  // disks are balls: no certificate
  report.certificate.cells = 6;
  CHECK(amps::lost_shape(report).empty());  // it holds
  report.certificate.failures.push_back({TopologyFailureKind::kPieces, 3});
  CHECK(amps::lost_shape(report) == "the shape has changed: components 1 -> 2; take a smaller radius or more vertices");
  report.input.boundary_loops = 1;
  report.input.euler_characteristic = 1;
  report.output.euler_characteristic = 4;
  report.output.non_manifold_edges = 7;
  CHECK(amps::lost_shape(report) ==
        "the shape has changed: components 1 -> 2, Euler characteristic 1 -> 4, boundary loops 1 -> 0, non-manifold edges "
        "0 -> 7; take a smaller radius or more vertices");
  report.input.non_manifold_edges = 2;
  CHECK(amps::lost_shape(report).find("non-manifold") == std::string::npos);
  report.certificate.failures.clear();
  report.curves.edges = 5;
  report.curves.edges_kept = 3;
  CHECK(amps::lost_shape(report) ==
        "the shape has changed: 2 of 5 edges along curves are not in the result; take a smaller "
        "radius or more vertices");
}

// The set that is edited.

namespace {

SampleSet set_of(const RefinedSet& set, const Certified& certified) {
  std::vector<Index> ids;
  for (Index s = 0; s < certified.diagram->num_sites(); ++s) {
    if (!certified.diagram->removed(s)) ids.push_back(s);
  }
  SampleSet result;
  result.positions =
      made_points(static_cast<Index>(ids.size()), [&](Index k) { return certified.disks->sample(ids[at(k)]).position(); });
  result.radii = Values(static_cast<Index>(ids.size()));
  result.barycentrics =
      made_points(static_cast<Index>(ids.size()), [&](Index k) { return certified.disks->sample(ids[at(k)]).at.barycentric; });
  for (std::size_t k = 0; k < ids.size(); ++k) {
    result.radii[static_cast<Index>(k)] = certified.disks->sample(ids[k]).radius;
    result.facets.push_back(certified.disks->sample(ids[k]).at.facet);
  }
  CHECK(set.compact() == (result.size() == certified.diagram->num_sites()));
  return result;
}

/// Names of sites in the order of their ids, those removed without one.
std::vector<Index> ranks(const Diagram& diagram) {
  std::vector<Index> result;
  Index next = 0;
  for (Index s = 0; s < diagram.num_sites(); ++s) result.push_back(diagram.removed(s) ? kNone : next++);
  return result;
}

}  // namespace

TEST_CASE("topology_refinement: after radii have fallen, diagram and disks are those of a set made anew") {
  bool seen_free_ids = false;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    CAPTURE(seed);
    const Mesh mesh = seed % 2 == 0 ? amps::make_torus(1.0, 0.3, 24, 8) : joined(amps::make_sphere(180), amps::make_cube(1));
    const double radius = 0.3;
    SamplingOptions options = with_radius(radius, seed);
    options.neighborhood = Neighborhood::kSurface;
    const amps::SamplingResult start = amps::sample(mesh, options);
    Certified certified(mesh, start.samples, Neighborhood::kSurface);
    RefinedSet set(*certified.diagram, *certified.disks, 0, start.report.dart_samples);
    CHECK(set.compact());
    Rng rng(seed);
    std::vector<RadiusCap> all;
    for (int round = 0; round < 5; ++round) {
      CAPTURE(round);
      const SampleSet before = set_of(set, certified);
      std::vector<RadiusCap> caps;
      // Of many new samples there may be fewer than of old ones.
      for (int k = 0; k < (round == 0 ? 20 : 2); ++k) {
        const auto s = static_cast<Index>(rng.below(static_cast<std::uint64_t>(before.size())));
        caps.push_back({sample_at(before, s), (round == 0 ? 0.999 : 0.7) * before.radii[s]});
      }
      all.insert(all.end(), caps.begin(), caps.end());
      const CapField bounds(caps, 0.2);
      auto field = std::make_shared<const CapField>(all, 0.2);
      double least = radius;
      for (const RadiusCap& cap : all) least = std::min(least, cap.radius);
      const WantedRadii wanted(radius, ConflictRule::kMax);
      set.lower(bounds, wanted.beside(least, radius).with_caps(field), rng, {});

      const SampleSet after = set_of(set, certified);
      CHECK(std::is_sorted(set.changed().begin(), set.changed().end()));
      CHECK(!set.changed().empty());
      const amps::MaximalityReport report = amps::verify_maximal(mesh, after, {}, ConflictRule::kMax, Neighborhood::kSurface);
      CHECK(report.maximal());
      CHECK(report.poisson_disk());
      Index above = 0;
      for (Index s = 0; s < after.size(); ++s) above += after.radii[s] > field->at(sample_at(after, s), radius) ? 1 : 0;
      CHECK(above == 0);
      // What was small enough stays.
      const auto small_before = [&](const Vec3&) { return true; };
      const std::set<Disk> disks = disks_where(after, small_before);
      Index lost = 0;
      for (Index s = 0; s < before.size(); ++s) {
        const Vec3 x = sample_at(before, s);
        const bool small = before.radii[s] <= bounds.at(x, before.radii[s]);
        const bool stays = disks.count({x[0], x[1], x[2], before.radii[s]}) > 0;
        if (small != stays) ++lost;
      }
      CHECK(lost == 0);

      const Certified anew(mesh, after, Neighborhood::kSurface);
      CHECK(canonical(*certified.diagram, ranks(*certified.diagram)) == canonical(*anew.diagram));
      CHECK(set.num_darts() + set.num_gap_samples() == after.size());
      const std::vector<amps::detail::FaceSample> faces = set.on_faces();
      CHECK(static_cast<Index>(faces.size()) == after.size());
      Index darts = 0;
      bool darts_first = true;
      for (const amps::detail::FaceSample& face : faces) {
        darts_first = darts_first && (!face.of_darts || darts == set.num_darts() || &face == &faces[at(darts)]);
        darts += face.of_darts ? 1 : 0;
      }
      CHECK(darts == set.num_darts());
      CHECK(darts_first);
      seen_free_ids = seen_free_ids || !set.compact();
      if (set.compact()) CHECK(set.samples().size() == after.size());
    }
  }
  CHECK(seen_free_ids);
}

TEST_CASE("topology_refinement: a set of which nothing stays") {
  const Mesh mesh = amps::make_cube(1);
  SamplingOptions options = with_radius(3);
  options.neighborhood = Neighborhood::kSurface;
  Certified certified(mesh, amps::sample(mesh, options).samples, Neighborhood::kSurface);
  REQUIRE(certified.set.size() == 1);
  RefinedSet set(*certified.diagram, *certified.disks, 0, 1);
  Rng rng(1);
  const auto bounds = std::make_shared<const CapField>(std::vector<RadiusCap>{{Vec3(0.5, 0.5, 0.5), 0.3}}, 0.0);
  set.lower(*bounds, WantedRadii(3, ConflictRule::kMax).beside(0.3, 3).with_caps(bounds), rng, {});
  const SampleSet after = set_of(set, certified);
  CHECK(max_of(after.radii) <= 0.3);
  CHECK(set.num_darts() == 0);
  const amps::MaximalityReport report = amps::verify_maximal(mesh, after, {}, ConflictRule::kMax, Neighborhood::kSurface);
  CHECK(report.maximal());
  CHECK(report.poisson_disk());
}

TEST_CASE("topology_refinement: caps lie around what has failed, and end at the floor") {
  const Mesh mesh = thin_tube(0.1);
  SamplingOptions options = with_radius(0.3);
  options.neighborhood = Neighborhood::kSurface;
  const Certified certified(mesh, amps::sample(mesh, options).samples, Neighborhood::kSurface);
  const TopologyCertificate certificate = certified.certificate();
  REQUIRE(!certificate.holds());
  amps::detail::RefinementCaps caps;
  REQUIRE(caps.lower(certificate, *certified.disks, nullptr, WantedRadii(0.3, ConflictRule::kMax)));
  std::set<std::array<double, 3>> failed;
  for (const amps::TopologyFailure& failure : certificate.failures) {
    for (const Index s : amps::detail::samples_of(failure)) {
      const Vec3 x = certified.disks->sample(s).position();
      failed.insert({x[0], x[1], x[2]});
    }
  }
  CHECK(caps.last().size() == failed.size());
  for (const RadiusCap& cap : caps.last()) {
    CHECK(failed.count({cap.position[0], cap.position[1], cap.position[2]}) == 1);
    CHECK(cap.radius < 0.3);
    CHECK(cap.radius >= 0.75 * 0.3 * (1 - 1e-15));
  }
  const std::size_t first = caps.caps().size();
  CHECK(!caps.lower(TopologyCertificate{}, *certified.disks, nullptr, WantedRadii(0.3, ConflictRule::kMax)));
  CHECK(caps.last().empty());
  CHECK(caps.caps().size() == first);
  // Radii that are a thousandth of the wanted ones fall no further.
  CHECK(!caps.lower(certificate, *certified.disks, nullptr, WantedRadii(0.3 * 1024, ConflictRule::kMax)));
}

TEST_CASE("topology_refinement: creases that were dropped become curves where samples become too many") {
  const Mesh mesh = wedge(15);
  const double radius = 1;
  const Input input(mesh, radius);
  REQUIRE(input.graph.dropped.size() == 9);
  REQUIRE(input.graph.empty());
  RemeshOptions options = plain(with_radius(radius));
  const RemeshResult by_radius = amps::remesh(mesh, options);
  check_kept(mesh, by_radius, radius);
  CHECK(by_radius.report.curves.corners == 0);
  options.sampling.max_samples = 8;
  const RemeshResult by_curves = amps::remesh(mesh, options);
  check_kept(mesh, by_curves, radius);
  CHECK(by_curves.report.curves.corners == 6);
  CHECK(by_curves.report.curves.edges > 0);
}

TEST_CASE("topology_refinement: however large the radius, the shape is kept") {
  for (const double radius : {10.0, 1e9}) {
    RemeshOptions options;
    options.sampling.radius = radius;
    const RemeshResult result = amps::remesh(amps::make_torus(), options);
    CHECK(result.status < Outcome::kShapeChanged);
    CHECK(result.report.certificate.holds());
    CHECK(result.report.output.euler_characteristic == 0);
  }
}

TEST_SUITE("slow") {
  TEST_CASE("topology_refinement: real meshes keep their topology") {
    struct Real {
      std::string name;
      Mesh stand_in;
    };
    const std::vector<Real> models = {
        {"homer.obj", thin_tube(0.2)}, {"elephant.off", block_with_handle()}, {"reports/21_small_parts.obj", small_parts()}};
    for (const Real& model : models) {
      const std::string& name = model.name;
      CAPTURE(name);
      const Mesh mesh = data_mesh_or(model.name, model.stand_in);
      for (const Index count : {500, 2000}) {
        CAPTURE(count);
        for (const bool optimize : {false, true}) {
          CAPTURE(optimize);
          RemeshOptions options = plain(with_count(count));
          options.optimize = optimize;
          const RemeshResult result = amps::remesh(mesh, options);
          check_kept(mesh, result, result.report.sampling.radius);
        }
      }
    }
  }
}

}  // namespace amps_test

TEST_CASE("topology_refinement: the tip of a spike has a sample, among far smaller ones") {
  // A cone of 10 degrees: a disk around a point near its tip wraps round it, however small.
  constexpr int kSides = 64;
  constexpr double kHalfAngle = 0.0872664625997165;
  std::vector<double> positions = {0, 0, 1, 0, 0, 0};
  std::vector<amps::Index> corners;
  for (int k = 0; k < kSides; ++k) {
    const double angle = 2 * 3.141592653589793 * k / kSides, radius = std::tan(kHalfAngle);
    positions.insert(positions.end(), {radius * std::cos(angle), radius * std::sin(angle), 0});
    const amps::Index a = 2 + k, b = 2 + (k + 1) % kSides;
    corners.insert(corners.end(), {0, a, b, 1, b, a});
  }
  const amps::Mesh mesh{amps::Points(std::move(positions)), amps::Triangles(std::move(corners))};
  for (const amps::Index count : {300, 2000}) {
    amps::RemeshOptions options;
    options.sampling.target_count = count;
    const amps::RemeshResult result = amps::remesh(mesh, options);
    CHECK(result.report.certificate.holds());
    CHECK(amps::lost_shape(result.report).empty());
    CHECK(result.report.output.euler_characteristic == 2);
    CHECK(result.mesh.vertices.row(0)[2] == 1);  // corners come first
  }
}

TEST_CASE("topology_refinement: floors follow radii that curves have lowered") {
  // A rod 1000 wide disks long: its edges alone make radii far below a thousandth of the wanted one.
  amps::Mesh mesh = amps::make_cube();
  for (std::ptrdiff_t v = 0; v < mesh.vertices.rows(); ++v) mesh.vertices(v, 0) *= 1000;
  amps::RemeshOptions options;
  options.optimize = false;
  options.sampling.radius = 1200;
  const amps::RemeshResult result = amps::remesh(mesh, options);
  CHECK(result.report.certificate.holds());
  CHECK(result.report.curves.edges_kept == result.report.curves.edges);
  CHECK(result.status == amps::Outcome::kDone);
}

TEST_CASE("topology_refinement: sheets that all but coincide are refused") {
  amps::Mesh mesh = amps::make_cube();
  for (std::ptrdiff_t v = 0; v < mesh.vertices.rows(); ++v) mesh.vertices(v, 2) *= 1e-6;
  amps::RemeshOptions options;
  options.sampling.target_count = 1000;
  CHECK_THROWS_AS(amps::remesh(mesh, options), amps::Error);
}
