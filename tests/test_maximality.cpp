// The certificate of a sample set: separation against all pairs, coverage against every corner, the same bits on all threads.
#include "amps/maximality.h"

#include "kit/maximality.h"
#include "kit/meshes.h"

#include "amps/disk_set.h"
#include "amps/reach.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace amps_test {

namespace {

MaximalityReport report_over_surface(const Mesh& mesh, const SampleSet& set, unsigned threads = 1) {
  return amps::verify_maximal(mesh, set, on_threads(threads), ConflictRule::kMax, amps::Neighborhood::kSurface);
}

SampleSet sampled_on_surface(const Mesh& mesh, double radius, std::uint64_t seed) {
  SamplingOptions options = with_radius(radius, seed);
  options.neighborhood = amps::Neighborhood::kSurface;
  return amps::sample(mesh, options).samples;
}

SampleSet with_radii_times(SampleSet set, double factor) {
  for (double& r : set.radii) r *= factor;
  return set;
}

/// Radii from their own up to `ratio` times that, so that disks overlap.
SampleSet with_some_larger(SampleSet set, double ratio, Rng& rng) {
  for (double& r : set.radii) r *= std::pow(ratio, rng.uniform());
  return set;
}

/// min |p_i − p_j|/r_i over the samples j that lie in a facet which the disk of i reaches; `inside`: in the disk itself.
double separation_by_floods(const Mesh& mesh, const SampleSet& set, bool inside) {
  const amps::detail::SurfaceFlood flood(mesh, amps::detail::SurfaceEdges(mesh));
  amps::detail::SurfaceFlood::Scratch scratch;
  double worst = kInfinity;
  std::vector<Index> reached;
  for (Index i = 0; i < set.size(); ++i) {
    const double r = set.radii[at(i)];
    flood.flood(sample_at(set, i), r * r, flood.homes({facet_of(set, i), barycentric_of(set, i), sample_at(set, i)}), scratch,
                reached);
    for (Index j = 0; j < set.size(); ++j) {
      const double distance = (sample_at(set, i) - sample_at(set, j)).norm();
      if (j == i || !std::binary_search(reached.begin(), reached.end(), facet_of(set, j))) continue;
      if (!inside || distance < r) worst = std::min(worst, distance / r);
    }
  }
  return worst;
}

}  // namespace

TEST_CASE("maximality: separation is that of all pairs, by either rule, for disks that keep apart and for others") {
  Rng rng(11);
  for (const NamedMesh& named : small_meshes()) {
    CAPTURE(named.name);
    const Mesh& mesh = named.mesh;
    const double radius = std::sqrt(0.7 * amps::total_area(mesh) / 400);
    if (!(radius > 0)) continue;
    const SampleSet apart = amps::sample(mesh, with_radius(radius, 3)).samples;
    for (const SampleSet& set : {apart, with_radii_times(apart, 1.2), with_some_larger(apart, 4, rng)}) {
      for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
        const double all_pairs = separation_of_all_pairs(set, rule);
        // Pairs farther apart than that need not be neighbours.
        if (all_pairs < 1.4)
          CHECK(certificate_of(mesh, set, rule).worst_separation == doctest::Approx(all_pairs).epsilon(1e-12));
      }
    }
  }
}

TEST_CASE(
    "maximality: over a surface separation is that of disks that hold a centre, and else of neighbours that are reached") {
  Rng rng(12);
  for (const Mesh& mesh : {amps::make_sphere(320), amps::make_torus(1.0, 0.4, 24, 10), two_sheets(0.01)}) {
    CAPTURE(rows(mesh.triangles));
    const SampleSet apart = sampled_on_surface(mesh, std::sqrt(0.7 * amps::total_area(mesh) / 500), 5);
    const double reached = separation_by_floods(mesh, apart, false);
    REQUIRE(separation_by_floods(mesh, apart, true) == kInfinity);
    REQUIRE(reached >= 1);
    REQUIRE(reached < 1.4);
    CHECK(report_over_surface(mesh, apart).worst_separation == doctest::Approx(reached).epsilon(1e-12));
    for (const SampleSet& set : {with_radii_times(apart, 1.3), with_some_larger(apart, 2, rng)}) {
      const double inside = separation_by_floods(mesh, set, true);
      REQUIRE(inside < 1);
      CHECK(report_over_surface(mesh, set).worst_separation == doctest::Approx(inside).epsilon(1e-12));
    }
  }
}

TEST_CASE("maximality: over a surface of radii that differ, the greater one of two counts") {
  const Mesh mesh = amps::make_sphere(320);
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SamplingOptions options = with_sizing(graded_field(mesh, 6, 500), seed);
    options.neighborhood = amps::Neighborhood::kSurface;
    const SampleSet set = amps::sample(mesh, options).samples;
    const double reached = separation_by_floods(mesh, set, false);
    REQUIRE(reached >= 1);
    REQUIRE(reached < 1.1);
    CHECK(report_over_surface(mesh, set).worst_separation == doctest::Approx(reached).epsilon(1e-12));
  }
}

TEST_CASE("maximality: sheets nearer than the radius are apart over the surface, and too near in space") {
  const Mesh mesh = two_sheets(0.01);
  const SampleSet set = sampled_on_surface(mesh, 0.1, 6);
  CHECK(report_over_surface(mesh, set).poisson_disk());
  CHECK(report_over_surface(mesh, set).maximal());
  CHECK(separation_of_all_pairs(set) < 0.8);
  CHECK(certificate_of(mesh, set).worst_separation == doctest::Approx(separation_of_all_pairs(set)).epsilon(1e-12));
}

TEST_CASE("maximality: the worst coverage is that of the farthest corner, and gaps are those that are listed") {
  Rng rng(13);
  const Mesh mesh = amps::make_sphere(1280);
  const SampleSet full = amps::sample(mesh, with_radius(0.06, 7)).samples;
  SampleSet gappy = selected(full, [](Index s) { return s % 97 != 0; });
  for (const SampleSet& set : {full, gappy, with_radii_times(full, 0.999), with_some_larger(full, 3, rng)}) {
    const amps::RestrictedPowerDiagram diagram = diagram_of(mesh, set);
    double worst = 0;
    for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
      if (!diagram.alive(f)) continue;
      const auto polygon = diagram.polygon(f);
      for (Index k = 0; k < polygon.size; ++k) {
        worst = std::max(worst, (polygon.corners[k] - sample_at(set, polygon.site)).norm() / set.radii[at(polygon.site)]);
      }
    }
    const MaximalityReport report = amps::verify_maximal(mesh, set);
    CHECK(report.worst_coverage == doctest::Approx(worst).epsilon(1e-12));
    const amps::GapSet gaps = amps::find_gaps(mesh, set);
    CHECK(report.gaps == gaps.gaps);
    CHECK(same_bits(report.gap_area, gaps.area));
    CHECK((report.gaps == 0) == (report.worst_coverage <= 1));
  }
}

TEST_CASE("maximality: the same bits on any number of threads") {
  Rng rng(14);
  const Mesh mesh = amps::make_sphere(5120);
  const SampleSet full = sampled_on_surface(mesh, 0.03, 8);
  const SampleSet gappy = selected(full, [](Index s) { return s % 31 != 0; });
  const amps::RestrictedPowerDiagram diagram = diagram_of(mesh, full);
  REQUIRE(diagram.fragment_capacity() > 3 * 8192);  // several pieces of each loop
  REQUIRE(diagram.cell_capacity() > 3 * 4096);
  CHECK(report_over_surface(mesh, full).worst_separation == doctest::Approx(separation_of_all_pairs(full)).epsilon(1e-12));
  for (const SampleSet& set : {full, gappy, with_some_larger(gappy, 3, rng)}) {
    for (const bool over_surface : {false, true}) {
      const auto look = [&](unsigned threads) {
        return over_surface ? report_over_surface(mesh, set, threads) : amps::verify_maximal(mesh, set, on_threads(threads));
      };
      const MaximalityReport one = look(1);
      for (const unsigned threads : {2u, 5u}) {
        const MaximalityReport more = look(threads);
        CHECK(same_bits(more.worst_coverage, one.worst_coverage));
        CHECK(same_bits(more.worst_separation, one.worst_separation));
        CHECK(same_bits(more.worst_point, one.worst_point));
        CHECK(same_bits(more.gap_area, one.gap_area));
        CHECK(more.gaps == one.gaps);
      }
    }
  }
}

}  // namespace amps_test
