// How samples are spread: darts and points in gaps are uniform, maximal sets as dense everywhere as the paper says.
#include "amps/sampling.h"

#include "kit/models.h"
#include "kit/samples.h"
#include "kit/statistics.h"

#include "amps/quality.h"
#include "amps/remesh.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

namespace {

/// Which of the four similar quarters of its facet a point is in.
std::size_t quarter_of(const Vec3& barycentric) {
  for (int k = 0; k < 3; ++k) {
    if (barycentric[k] >= 0.5) return static_cast<std::size_t>(k);
  }
  return 3;
}

/// Counts of samples per quarter of a facet against the areas.
double facet_uniformity(const Mesh& mesh, const std::vector<std::pair<Index, Vec3>>& samples) {
  const std::vector<double> areas = amps::facet_areas(mesh);
  const double total = amps::total_area(mesh);
  std::vector<double> observed(4 * areas.size(), 0), expected(4 * areas.size());
  for (std::size_t k = 0; k < expected.size(); ++k)
    expected[k] = static_cast<double>(samples.size()) * areas[k / 4] / 4 / total;
  REQUIRE(*std::min_element(expected.begin(), expected.end()) > 5);
  for (const auto& [facet, b] : samples) observed[4 * at(facet) + quarter_of(b)] += 1;
  return chi_square_score(observed, expected);
}

}  // namespace

TEST_CASE("sampling: the first dart is uniform on the surface") {
  const Mesh mesh = amps::make_torus(1.0, 0.6, 7, 5);  // facets of very different areas
  std::vector<std::pair<Index, Vec3>> first;
  SamplingOptions options = with_radius(10);
  options.max_rejections = 1;
  for (std::uint64_t seed = 0; seed < 20000; ++seed) {
    options.seed = seed;
    const SampleSet set = amps::throw_darts(mesh, options).samples;
    REQUIRE(set.size() == 1);
    first.emplace_back(facet_of(set, 0), barycentric_of(set, 0));
  }
  const double score = facet_uniformity(mesh, first);
  CHECK(score < 4);
  CHECK(score > -4);
}

TEST_CASE("sampling: early darts are uniform on the surface") {
  const Mesh mesh = amps::make_torus(1.0, 0.6, 7, 5);
  std::vector<std::pair<Index, Vec3>> early;
  for (std::uint64_t seed = 100; seed < 120; ++seed) {
    const SampleSet set = amps::throw_darts(mesh, with_radius(0.04, seed)).samples;
    REQUIRE(set.size() > 5000);
    for (Index s = 0; s < 500; ++s) early.emplace_back(facet_of(set, s), barycentric_of(set, s));
  }
  // Less than random, because disks keep apart, but not unevenly.
  CHECK(facet_uniformity(mesh, early) < 4);
}

TEST_CASE("sampling: the first point in a gap is uniform in it") {
  // One disk in the middle of the square: eight sectors of equal gap area, each cut at distance 0.4.
  const double r = 0.3, cut = 0.4;
  for (const Index cells : {1, 4}) {
    CAPTURE(cells);
    const Mesh mesh = amps::make_square(cells);
    const SampleSet middle = one_sample({0.5, 0.5, 0}, r);
    std::vector<double> observed(16, 0), expected(16);
    const int n = 4000;
    for (std::size_t k = 0; k < 16; ++k)
      expected[k] = n * (k < 8 ? kPi * (cut * cut - r * r) : 1 - kPi * cut * cut) / 8 / (1 - kPi * r * r);
    for (int seed = 0; seed < n; ++seed) {
      const SampleSet set = amps::fill_gaps(mesh, middle, with_radius(0, static_cast<std::uint64_t>(seed))).samples;
      REQUIRE(set.size() >= 2);
      const Vec3 x = sample_at(set, 1) - sample_at(set, 0);
      const auto sector = static_cast<std::size_t>((std::atan2(x.y(), x.x()) + kPi) / (kPi / 4)) % 8;
      observed[sector + (x.norm() < cut ? 0 : 8)] += 1;
    }
    const double score = chi_square_score(observed, expected);
    CHECK(score < 4);
    CHECK(score > -4);
  }
}

TEST_CASE("sampling: maximal sets are as dense everywhere") {
  // On the sphere the number of samples in each octant over many sets: equal but for chance, and less spread than random.
  const Mesh mesh = amps::make_sphere(1280);
  std::vector<double> observed(8, 0);
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const SampleSet set = amps::sample(mesh, with_radius(0.1, seed)).samples;
    for (Index s = 0; s < set.size(); ++s) {
      const Vec3 x = sample_at(set, s);
      observed[static_cast<std::size_t>((x.x() > 0) + 2 * (x.y() > 0) + 4 * (x.z() > 0))] += 1;
    }
  }
  const double mean = std::accumulate(observed.begin(), observed.end(), 0.0) / 8;
  CHECK(mean > 800);
  CHECK(chi_square_score(observed, std::vector<double>(8, mean)) < 0);
}

TEST_SUITE("slow") {
  TEST_CASE("sampling: Table 1 of the paper, counts and valences") {
    struct Row {
      std::string name;
      Mesh mesh;
      double maximal, darts, maximal_valence, darts_valence;
    };
    // Yan & Wonka 2012, Table 1, r = 4.5e-3. Dart throwing stops at random: single counts spread by ±5 %, medians of five by ±3
    // %, so the counts of darts are medians of 51.
    const std::vector<Row> rows = {{"square", amps::make_square(), 34500, 26800, 96.4, 94.2},
                                   {"sphere", sphere_of_area(0.863, 81920), 29700, 23500, 96.6, 94.5}};
    const double radius = 4.5e-3;
    for (const Row& row : rows) {
      CAPTURE(row.name);
      std::vector<double> maximal, darts, maximal_valence, darts_valence;
      for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        const SamplingResult result = amps::sample(row.mesh, with_radius(radius, seed));
        const SampleSet dart_set = head(result.samples, result.report.dart_samples);
        maximal.push_back(result.samples.size());
        maximal_valence.push_back(amps::quality(amps::restricted_triangulation(row.mesh, result.samples)).valence_5_6_7);
        darts_valence.push_back(amps::quality(amps::restricted_triangulation(row.mesh, dart_set)).valence_5_6_7);
        MESSAGE(row.name << " seed " << seed << ": maximal " << maximal.back() << " valence 5-7 " << maximal_valence.back()
                         << " %, darts " << dart_set.size() << " valence 5-7 " << darts_valence.back() << " %");
      }
      for (std::uint64_t seed = 1; seed <= 51; ++seed) {
        darts.push_back(amps::throw_darts(row.mesh, with_radius(radius, seed)).samples.size());
      }
      MESSAGE(row.name << " medians: maximal " << median(maximal) << " valence 5-7 " << median(maximal_valence) << " %, darts "
                       << median(darts) << " valence 5-7 " << median(darts_valence) << " %");
      CHECK(std::fabs(median(maximal) / row.maximal - 1) <= 0.02);
      CHECK(std::fabs(median(darts) / row.darts - 1) <= 0.05);
      CHECK(std::fabs(median(maximal_valence) - row.maximal_valence) <= 1);
      CHECK(std::fabs(median(darts_valence) - row.darts_valence) <= 1);
    }
  }
}

}  // namespace amps_test
