// Disks that know their surface, against floods of all of them; and the sets that sampling makes of them.
#include "amps/disk_set.h"

#include "kit/meshes.h"
#include "kit/random.h"
#include "kit/samples.h"

#include "amps/maximality.h"
#include "amps/sampling.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <vector>

namespace amps_test {
namespace {

using amps::ConflictRule;
using amps::Neighborhood;
using amps::SurfacePoint;
using amps::detail::DiskSet;
using amps::detail::PlacedPoint;
using amps::detail::Sample;
using amps::detail::SurfaceEdges;
using amps::detail::SurfaceFlood;
using amps::detail::WantedRadii;

SurfacePoint random_surface_point(const Mesh& mesh, Rng& rng) {
  double a = rng.uniform(), b = rng.uniform();
  if (a + b > 1) a = 1 - a, b = 1 - b;
  Vec3 at(1 - a - b, a, b);
  const auto where = below(rng, 8);  // now and then on an edge or a corner
  if (where == 0) at = {a, 1 - a, 0};
  if (where == 1) at = {0, 0, 1};
  return amps::detail::surface_point_at(mesh, below(rng, rows(mesh.triangles)), at);
}

/// A plate, its sides joined by its rim.
Mesh plate(Index cells, double thickness) {
  Mesh mesh = amps::make_cube(cells);
  for (Index v = 0; v < rows(mesh.vertices); ++v) mesh.vertices(v, 2) *= thickness;
  return mesh;
}

struct Floods {
  const SurfaceFlood& flood;
  mutable SurfaceFlood::Scratch scratch;
  bool holds(const Sample& disk, const SurfacePoint& x) const {
    // Disks are closed for floods, and open for what lies at their rim.
    if (!((x.position - disk.position()).squaredNorm() < disk.radius * disk.radius)) return false;
    return flood.holds({disk.position(), flood.homes(disk.at)}, disk.radius * disk.radius, {x.position, flood.homes(x)},
                       scratch);
  }
};

}  // namespace

TEST_CASE("disks that know their surface: what they hold and exclude is what floods of all of them say") {
  std::uint64_t seed = 1;
  int lowered = 0, unlike_balls = 0;
  for (const Mesh& mesh :
       {plate(3, 0.05), two_sheets(0.1), open_book(5), amps::make_torus(1, 0.2, 24, 8), random_soup(12, 5)}) {
    for (const double ratio : {1.0, 3.0}) {
      Rng rng(seed++);
      const amps::Box box = amps::bounding_box(mesh);
      const double min = 0.1 * box.diagonal(), max = ratio * min;
      const auto flood = std::make_shared<const SurfaceFlood>(mesh, SurfaceEdges(mesh));
      const Floods floods{*flood, SurfaceFlood::Scratch()};
      DiskSet disks(box, min, max, flood);
      std::map<Index, Sample> model;
      for (int step = 0; step < 300; ++step) {
        Sample disk{random_surface_point(mesh, rng), between(rng, min, max)};
        if (ratio == 1) disk.radius = min;
        bool covered = false, conflicts = false;
        for (const auto& [id, other] : model) {
          covered = covered || floods.holds(other, disk.at);
          conflicts = conflicts || floods.holds(other, disk.at) || floods.holds(disk, other.at);
        }
        REQUIRE((disks.covering_sample(disk.at) != kNone) == covered);
        REQUIRE((disks.conflicting_sample(disk, ConflictRule::kMax) != kNone) == conflicts);
        unlike_balls += !covered && disks.grid().conflicting_sample(disk.position(), 0, ConflictRule::kMax) != kNone;
        if (!covered) {
          const double wanted = disk.radius;
          disk.radius = disks.lowered_radius(disk.at, wanted, WantedRadii(wanted, ConflictRule::kMax));
          REQUIRE(disk.radius <= wanted);
          REQUIRE(disks.conflicting_sample(disk, ConflictRule::kMax) == kNone);
          if (disk.radius < wanted) {
            Sample greater = disk;
            greater.radius = disk.radius * (1 + 1e-6);
            CHECK(disks.conflicting_sample(greater, ConflictRule::kMax) != kNone);
            ++lowered;
          }
          if (disk.radius > 0.2 * min) {
            const auto id = static_cast<Index>(step);
            disks.insert(disk, id);
            model[id] = disk;
          }
        }
        if (model.size() > 20 && below(rng, 3) == 0) {
          const auto gone = std::next(model.begin(), below(rng, static_cast<Index>(model.size())));
          disks.remove(gone->second, gone->first);
          disks.forget_reach(gone->first);
          model.erase(gone);
        }
      }
    }
  }
  CHECK(lowered > 10);
  CHECK(unlike_balls > 100);
}

TEST_CASE("disks that know their surface: sets that are stored at once are those that are stored one by one, on any threads") {
  Rng rng(9);
  for (const Mesh& mesh : {plate(12, 0.02), amps::make_torus(1, 0.2, 48, 16)}) {
    const amps::Box box = amps::bounding_box(mesh);
    const double min = 0.02 * box.diagonal(), max = 2 * min;
    amps::detail::GrowingSet set;
    for (Index s = 0; s < 5000; ++s) set.add({random_surface_point(mesh, rng), between(rng, min, max)});
    const auto flood = std::make_shared<const SurfaceFlood>(mesh, SurfaceEdges(mesh));
    DiskSet single(box, min, max, flood);
    for (Index s = 0; s < set.size(); ++s) single.insert(set[s], s);
    for (const unsigned threads : {1u, 2u, 4u}) {
      CAPTURE(threads);
      DiskSet together(box, min, max, flood);
      together.insert_all(set, amps::Execution(threads).start());
      CHECK(together.has_samples());
      bool same = true;
      for (Index s = 0; s < set.size(); ++s) {
        const auto a = single.reach_lists()->facets(s), b = together.reach_lists()->facets(s);
        same = same && a.size() > 0 && std::equal(a.begin(), a.end(), b.begin(), b.end());
        same = same && together.sample(s).position() == set.position(s);
      }
      CHECK(same);
      for (int k = 0; k < 200; ++k) {
        const SurfacePoint x = random_surface_point(mesh, rng);
        REQUIRE(single.covering_sample(x) == together.covering_sample(x));
      }
    }
  }
}

TEST_CASE("sampling over a surface: every point lies in a disk that is joined to it, and no sample in the disk of another") {
  std::uint64_t seed = 1;
  Index more_than_balls = 0;
  for (const Mesh& mesh : {plate(4, 0.02), plate(1, 0.01), two_sheets(0.03), open_book(6), amps::make_torus(1, 0.1, 40, 8)}) {
    amps::SamplingOptions options;
    options.neighborhood = Neighborhood::kSurface;
    options.radius = 0.06 * amps::bounding_box(mesh).diagonal();
    options.seed = seed;
    const SampleSet set = amps::sample(mesh, options).samples;
    const auto flood = std::make_shared<const SurfaceFlood>(mesh, SurfaceEdges(mesh));
    const Floods floods{*flood, SurfaceFlood::Scratch()};
    std::vector<Sample> samples;
    for (Index s = 0; s < set.size(); ++s) samples.push_back(amps::detail::sample_of(set, s));
    for (const Sample& a : samples) {
      CHECK(a.radius <= options.radius);
      for (const Sample& b : samples) {
        if (&a != &b) REQUIRE(!floods.holds(a, b.at));
      }
    }
    Rng rng(seed++);
    for (int k = 0; k < 3000; ++k) {
      const SurfacePoint x = random_surface_point(mesh, rng);
      const bool covered = std::any_of(samples.begin(), samples.end(), [&](const Sample& s) {
        return (s.position() - x.position).norm() <= s.radius * (1 + 1e-9) &&
               flood->holds({s.position(), flood->homes(s.at)}, s.radius * s.radius * (1 + 1e-8), {x.position, flood->homes(x)},
                            floods.scratch);
      });
      REQUIRE(covered);
    }
    // Where balls see the other sheet, they leave it open, or double samples.
    options.neighborhood = Neighborhood::kSpace;
    more_than_balls += set.size() - amps::sample(mesh, options).samples.size();
  }
  CHECK(more_than_balls > 200);
}

TEST_CASE("sampling over a surface: where no sheet is near another, disks are balls") {
  for (const Mesh& mesh : {amps::make_sphere(2000), amps::make_torus(1, 0.4, 40, 20), amps::make_square(8)}) {
    amps::SamplingOptions options;
    options.radius = 0.05 * amps::bounding_box(mesh).diagonal();
    const amps::SamplingResult in_space = amps::sample(mesh, options);
    options.neighborhood = Neighborhood::kSurface;
    const amps::SamplingResult on_surface = amps::sample(mesh, options);
    // The same darts. Gaps are filled in another order.
    const Index num_darts = in_space.report.dart_samples;
    REQUIRE(on_surface.report.dart_samples == num_darts);
    for (Index s = 0; s < num_darts; ++s) {
      CHECK(on_surface.samples.positions.row(s) == in_space.samples.positions.row(s));
    }
    // Each is maximal, and Poisson-disk, in the other's sense.
    for (const auto neighborhood : {Neighborhood::kSpace, Neighborhood::kSurface}) {
      for (const amps::SamplingResult* result : {&in_space, &on_surface}) {
        const amps::MaximalityReport report =
            amps::verify_maximal(mesh, result->samples, {}, amps::ConflictRule::kMax, neighborhood);
        CHECK(report.maximal());
        CHECK(report.poisson_disk());
      }
    }
  }
}

}  // namespace amps_test
