#include "amps/sampling.h"

#include "amps/maximality.h"
#include "amps/quality.h"
#include "amps/remesh.h"
#include "amps/shapes.h"
#include "test_models.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <sstream>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

using amps::Error;
using amps::ErrorCode;
using amps::GapSet;
using amps::Index;
using amps::MaximalityReport;
using amps::Mesh;
using amps::MeshView;
using amps::Outcome;
using amps::Points;
using amps::Progress;
using amps::Rng;
using amps::SampleSet;
using amps::SamplingOptions;
using amps::SamplingResult;
using amps::Vec3;
using amps::kNone;

namespace {

SamplingOptions with_radius(double radius, std::uint64_t seed = 1) {
  SamplingOptions options;
  options.radius = radius;
  options.seed = seed;
  return options;
}

SamplingOptions with_count(Index count, std::uint64_t seed = 1) {
  SamplingOptions options;
  options.target_count = count;
  options.seed = seed;
  return options;
}

Vec3 sample_at(const SampleSet& set, Index s) { return set.positions.row(s).transpose(); }

SampleSet one_sample(const Vec3& position, double radius) {
  SampleSet set;
  set.positions = position.transpose();
  set.radii = Eigen::VectorXd::Constant(1, radius);
  return set;
}

template <class Keep>
SampleSet selected(const SampleSet& set, const Keep& keep) {
  std::vector<Index> rows;
  for (Index s = 0; s < set.size(); ++s) {
    if (keep(s)) rows.push_back(s);
  }
  SampleSet result{set.positions(rows, Eigen::all), set.radii(rows), {}, {}};
  if (!set.facets.empty()) {
    for (const Index s : rows) result.facets.push_back(set.facets[static_cast<std::size_t>(s)]);
    result.barycentrics = set.barycentrics(rows, Eigen::all);
  }
  return result;
}

SampleSet sorted_by_position(const SampleSet& set) {
  std::vector<Index> rows(static_cast<std::size_t>(set.size()));
  std::iota(rows.begin(), rows.end(), 0);
  std::sort(rows.begin(), rows.end(), [&](Index a, Index b) {
    return std::lexicographical_compare(set.positions.row(a).begin(), set.positions.row(a).end(), set.positions.row(b).begin(),
                                        set.positions.row(b).end());
  });
  SampleSet result{set.positions(rows, Eigen::all), set.radii(rows), {}, set.barycentrics(rows, Eigen::all)};
  for (const Index s : rows) result.facets.push_back(set.facets[static_cast<std::size_t>(s)]);
  return result;
}

/// Samples by cells of side `cell`: the oracle's own search structure.
class Cells {
 public:
  Cells(const Points& positions, double cell) : positions_(positions), cell_(cell) {
    for (Index s = 0; s < positions.rows(); ++s) cells_[key(position(s), 0, 0, 0)].push_back(s);
  }
  Vec3 position(Index s) const { return positions_.row(s).transpose(); }
  /// Calls back with every sample within one cell of x, and others.
  template <class Visit>
  void around(const Vec3& x, const Visit& visit) const {
    for (int i = -1; i <= 1; ++i) {
      for (int j = -1; j <= 1; ++j) {
        for (int k = -1; k <= 1; ++k) {
          const auto found = cells_.find(key(x, i, j, k));
          if (found == cells_.end()) continue;
          for (const Index s : found->second) visit(s);
        }
      }
    }
  }

 private:
  std::uint64_t key(const Vec3& x, int i, int j, int k) const {
    const auto at = [this](double c, int step) {
      return static_cast<std::uint64_t>(std::floor(c / cell_) + step + 0x80000) & 0x1fffff;
    };
    return at(x.x(), i) | at(x.y(), j) << 21 | at(x.z(), k) << 42;
  }
  Points positions_;
  double cell_;
  std::unordered_map<std::uint64_t, std::vector<Index>> cells_;
};

/// Oracle: the least distance of two samples over the greater radius.
double brute_separation(const SampleSet& set) {
  const Cells cells(set.positions, 1.5 * set.radii.maxCoeff());
  double worst = INFINITY;
  for (Index s = 0; s < set.size(); ++s) {
    cells.around(sample_at(set, s), [&](Index t) {
      if (t != s)
        worst = std::min(worst, (sample_at(set, s) - sample_at(set, t)).norm() / std::max(set.radii[s], set.radii[t]));
    });
  }
  return worst;
}

/// Oracle of maximality: a triangle is covered if one ball contains its corners, else it is cut at its longest edge and both
/// halves are looked at, down to where a half is as small as the tolerance. No power diagram.
class CoverageOracle {
 public:
  CoverageOracle(const SampleSet& set, double tolerance)
      : set_(set), cells_(set.positions, 2.05 * set.radii.maxCoeff()), largest_(set.radii.maxCoeff()), tolerance_(tolerance) {}

  bool covers(const Mesh& mesh) {
    for (Index f = 0; f < mesh.triangles.rows(); ++f) {
      const MeshView view(mesh);
      if (!covers({view.corner(f, 0), view.corner(f, 1), view.corner(f, 2)}, nullptr)) return false;
    }
    return true;
  }

 private:
  using Triangle = std::array<Vec3, 3>;

  bool in_one_ball(const Triangle& t, Index s) const {
    const double r = set_.radii[s] * (1 + tolerance_);
    for (const Vec3& x : t) {
      if ((x - cells_.position(s)).squaredNorm() > r * r) return false;
    }
    return true;
  }

  bool covers(const Triangle& t, const std::vector<Index>* candidates) {
    std::size_t from = 0;
    double longest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double length = (t[k] - t[(k + 1) % 3]).norm();
      if (length > longest) {
        longest = length;
        from = k;
      }
    }
    std::vector<Index> near;
    if (longest <= largest_) {
      const Vec3 centre = (t[0] + t[1] + t[2]) / 3;
      const auto reaches = [&](Index s) {
        return (cells_.position(s) - centre).norm() <= longest + set_.radii[s] * (1 + tolerance_);
      };
      const auto add = [&](Index s) {
        if (reaches(s)) near.push_back(s);
      };
      if (candidates == nullptr) {
        cells_.around(centre, add);
      } else {
        std::for_each(candidates->begin(), candidates->end(), add);
      }
      for (const Index s : near) {
        if (in_one_ball(t, s)) return true;
      }
      if (near.empty() || longest < tolerance_ * largest_) return false;
      candidates = &near;
    }
    const Vec3 middle = (t[from] + t[(from + 1) % 3]) / 2;
    Triangle first = t, second = t;
    first[(from + 1) % 3] = middle;
    second[from] = middle;
    return covers(first, candidates) && covers(second, candidates);
  }

  const SampleSet& set_;
  Cells cells_;
  double largest_, tolerance_;
};

bool covered_by_oracle(const Mesh& mesh, const SampleSet& set) { return CoverageOracle(set, 1e-9).covers(mesh); }

bool same_bits(double a, double b) { return std::memcmp(&a, &b, sizeof a) == 0; }

bool same_bits(const Points& a, const Points& b) {
  return a.rows() == b.rows() &&
         std::equal(a.data(), a.data() + a.size(), b.data(), [](double x, double y) { return same_bits(x, y); });
}

bool same_set(const SampleSet& a, const SampleSet& b) {
  return same_bits(a.positions, b.positions) && same_bits(a.barycentrics, b.barycentrics) && a.facets == b.facets &&
         a.radii == b.radii;
}

/// Samples lie where they say, bit for bit.
void check_placement(const Mesh& mesh, const SampleSet& set) {
  REQUIRE(set.facets.size() == static_cast<std::size_t>(set.size()));
  REQUIRE(set.barycentrics.rows() == set.size());
  REQUIRE(set.radii.size() == set.size());
  Index misplaced = 0;
  double worst_sum = 0;
  for (Index s = 0; s < set.size(); ++s) {
    const Index f = set.facets[static_cast<std::size_t>(s)];
    REQUIRE((f >= 0 && f < mesh.triangles.rows()));
    const Vec3 b = set.barycentrics.row(s).transpose();
    worst_sum = std::max(worst_sum, std::fabs(b.sum() - 1));
    bool right = b.minCoeff() >= 0;
    for (int c = 0; c < 3; ++c) {
      const auto corner = [&](int k) { return mesh.vertices(mesh.triangles(f, k), c); };
      const double x = b[0] * corner(0) + b[1] * corner(1) + b[2] * corner(2);
      right = right && same_bits(x, set.positions(s, c));
    }
    misplaced += !right;
  }
  CHECK(misplaced == 0);
  CHECK(worst_sum <= 4e-16);
}

/// Everything that is promised of a maximal set, by amps' own certificate and by the oracles.
void check_maximal(const Mesh& mesh, const SamplingResult& result) {
  const SampleSet& set = result.samples;
  CHECK(result.status == Outcome::kDone);
  CHECK(result.report.unfilled_gaps == 0);
  CHECK(set.radii == Eigen::VectorXd::Constant(set.size(), result.report.radius));
  check_placement(mesh, set);
  const MaximalityReport certificate = amps::verify_maximal(mesh, set);
  CHECK(certificate.maximal());
  CHECK(certificate.poisson_disk());
  CHECK(certificate.worst_coverage <= 1 + 1e-9);
  CHECK(certificate.worst_separation >= 1 - 1e-9);
  CHECK(certificate.gaps == 0);
  CHECK(certificate.gap_area == 0);
  if (set.size() > 1) {
    const double separation = brute_separation(set);
    CHECK(separation >= 1 - 1e-9);
    if (separation < 1.4) CHECK(certificate.worst_separation == doctest::Approx(separation).epsilon(1e-12));
  }
  CHECK(covered_by_oracle(mesh, set));
}

/// Σ (observed − expected)²/expected, and how many standard deviations that is above its mean (Wilson & Hilferty 1931).
double chi_square_score(const std::vector<double>& observed, const std::vector<double>& expected) {
  double chi2 = 0;
  for (std::size_t k = 0; k < observed.size(); ++k)
    chi2 += (observed[k] - expected[k]) * (observed[k] - expected[k]) / expected[k];
  const double v = static_cast<double>(observed.size() - 1);
  return (std::cbrt(chi2 / v) - (1 - 2 / (9 * v))) / std::sqrt(2 / (9 * v));
}

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
  for (const auto& [facet, b] : samples) observed[4 * static_cast<std::size_t>(facet) + quarter_of(b)] += 1;
  return chi_square_score(observed, expected);
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

ErrorCode error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    CHECK(std::string(error.what()).size() > 20);
    return error.code();
  }
  FAIL("no error was thrown");
  return ErrorCode::kInternal;
}

Mesh triangle_mesh(const std::vector<Vec3>& vertices, const std::vector<std::array<Index, 3>>& triangles) {
  Mesh mesh{Points(static_cast<Index>(vertices.size()), 3), amps::Triangles(static_cast<Index>(triangles.size()), 3)};
  for (Index v = 0; v < mesh.vertices.rows(); ++v) mesh.vertices.row(v) = vertices[static_cast<std::size_t>(v)].transpose();
  for (Index f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) mesh.triangles(f, k) = triangles[static_cast<std::size_t>(f)][static_cast<std::size_t>(k)];
  }
  return mesh;
}

/// Two unit squares, `gap` apart.
Mesh two_sheets(double gap) {
  const Mesh one = amps::make_square(4);
  Mesh mesh{Points(2 * one.vertices.rows(), 3), amps::Triangles(2 * one.triangles.rows(), 3)};
  mesh.vertices << one.vertices, one.vertices;
  mesh.vertices.bottomRows(one.vertices.rows()).col(2).setConstant(gap);
  mesh.triangles << one.triangles, (one.triangles.array() + static_cast<Index>(one.vertices.rows())).matrix();
  return mesh;
}

/// A Möbius band of n cells along.
Mesh moebius_band(Index n) {
  std::vector<Vec3> vertices;
  std::vector<std::array<Index, 3>> triangles;
  for (Index i = 0; i < n; ++i) {
    const double t = 2 * 3.14159265358979323846 * i / n;
    for (const double s : {-0.4, 0.4}) {
      const double r = 1 + s * std::cos(t / 2);
      vertices.emplace_back(r * std::cos(t), r * std::sin(t), s * std::sin(t / 2));
    }
  }
  for (Index i = 0; i < n; ++i) {
    const Index a = 2 * i, b = 2 * i + 1;
    const Index c = i + 1 == n ? 1 : 2 * i + 2, d = i + 1 == n ? 0 : 2 * i + 3;
    triangles.push_back({a, c, d});
    triangles.push_back({a, d, b});
  }
  return triangle_mesh(vertices, triangles);
}

Mesh random_soup(Index n, std::uint64_t seed) {
  Rng rng(seed);
  const auto point = [&rng] { return Vec3(rng.uniform(), rng.uniform(), rng.uniform()); };
  std::vector<Vec3> vertices;
  std::vector<std::array<Index, 3>> triangles;
  for (Index f = 0; f < n; ++f) {
    const Vec3 centre = point();
    const double size = 0.6 * rng.uniform();
    for (int k = 0; k < 3; ++k) vertices.push_back(centre + size * point());
    triangles.push_back({3 * f, 3 * f + 1, 3 * f + 2});
  }
  return triangle_mesh(vertices, triangles);
}

/// Three half-discs of triangles around one edge, of no common orientation.
Mesh non_manifold_book() {
  return triangle_mesh({{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {-0.5, 0.8, 0}, {-0.5, -0.8, 0}}, {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}});
}

}  // namespace

TEST_CASE("sampling: sets are maximal Poisson-disk sets, by certificate and by oracle") {
  for (const auto& model : amps_test::procedural_models()) {
    CAPTURE(model.name);
    const auto& [name, mesh, radius] = model;
    const SamplingResult result = amps::sample(mesh, with_radius(radius));
    CHECK(result.report.radius == radius);
    CHECK(result.samples.size() > 2500);
    CHECK(result.samples.size() < 5500);
    CHECK(result.report.gap_samples > result.samples.size() / 20);
    CHECK(result.report.darts > static_cast<std::uint64_t>(result.report.dart_samples));
    CHECK(result.report.attempts == 1);
    CHECK(result.report.dart_samples + result.report.gap_samples == result.samples.size());
    check_maximal(mesh, result);
  }
}

TEST_CASE("sampling: the oracles notice a missing sample and a pair that is too near") {
  const Mesh mesh = amps::make_sphere(320);
  const SampleSet set = amps::sample(mesh, with_radius(0.15)).samples;
  REQUIRE(covered_by_oracle(mesh, set));
  REQUIRE(set.size() > 300);
  for (Index gone = 0; gone < set.size(); gone += 50) {
    const SampleSet less = selected(set, [gone](Index s) { return s != gone; });
    CHECK(!covered_by_oracle(mesh, less));
    const MaximalityReport report = amps::verify_maximal(mesh, less);
    CHECK(!report.maximal());
    CHECK(report.poisson_disk());
    CHECK(report.gaps > 0);
    CHECK(report.gap_area > 0);
    CHECK(report.gap_area < 3.15 * 0.15 * 0.15);
  }
  SampleSet near = set;
  near.positions.row(17) = near.positions.row(42) + Eigen::RowVector3d(0.15 * (1 - 1e-6), 0, 0);
  CHECK(brute_separation(near) < 1 - 1e-9);
  CHECK(!amps::verify_maximal(mesh, near).poisson_disk());
}

TEST_CASE("sampling: verify_maximal measures coverage and separation as they are") {
  const Mesh mesh = amps::make_square(3);
  const double root2 = std::sqrt(2.0);
  MaximalityReport one = amps::verify_maximal(mesh, one_sample({0.5, 0.5, 0}, 0.5));
  CHECK(one.worst_coverage == doctest::Approx(root2).epsilon(1e-14));
  CHECK(one.worst_separation == INFINITY);
  CHECK(one.gap_area == doctest::Approx(1 - 3.14159265358979323846 / 4).epsilon(1e-12));
  CHECK(one.poisson_disk());
  CHECK(!one.maximal());
  CHECK(amps::verify_maximal(mesh, one_sample({0.5, 0.5, 0}, root2 / 2 * (1 + 1e-12))).maximal());
  CHECK(amps::verify_maximal(mesh, one_sample({0.5, 0.5, 0}, root2 / 2 * (1 + 1e-12))).gaps == 0);
  CHECK(!amps::verify_maximal(mesh, one_sample({0.5, 0.5, 0}, root2 / 2 * (1 - 2e-9))).maximal());
  // Above the surface, the ball still counts as a ball in space.
  CHECK(amps::verify_maximal(mesh, one_sample({0.5, 0.5, 1}, 1)).worst_coverage ==
        doctest::Approx(std::sqrt(1.5)).epsilon(1e-14));

  SampleSet three;
  three.positions.resize(3, 3);
  three.positions << 0.25, 0.5, 0, 0.75, 0.5, 0, 0.5, 0.9, 0;
  three.radii.resize(3);
  three.radii << 0.3, 0.6, 0.1;
  // Each pair over the greater of its radii: 0.5/0.6, and √(0.0625 + 0.16)/0.6 for the second and third.
  CHECK(amps::verify_maximal(mesh, three).worst_separation == doctest::Approx(std::sqrt(0.2225) / 0.6).epsilon(1e-12));
  three.positions.row(2) = three.positions.row(0);
  CHECK(amps::verify_maximal(mesh, three).worst_separation == 0);
}

TEST_CASE("sampling: worst separation of disks of many radii agrees with all pairs") {
  Rng rng(5);
  const Mesh mesh = amps::make_cube(2);
  for (int round = 0; round < 20; ++round) {
    CAPTURE(round);
    SampleSet set;
    const Index n = 60;
    set.positions.resize(n, 3);
    set.radii.resize(n);
    for (Index s = 0; s < n; ++s) {
      for (int c = 0; c < 3; ++c) set.positions(s, c) = rng.uniform();
      set.radii[s] = std::pow(10.0, -3 * rng.uniform());
    }
    double expected = INFINITY;
    for (Index s = 0; s < n; ++s) {
      for (Index t = 0; t < s; ++t) {
        expected = std::min(expected, (sample_at(set, s) - sample_at(set, t)).norm() / std::max(set.radii[s], set.radii[t]));
      }
    }
    CHECK(amps::verify_maximal(mesh, set).worst_separation == doctest::Approx(expected).epsilon(1e-12));
  }
}

TEST_CASE("sampling: same seed same bits, for any number of threads; another seed, another set") {
  const Mesh mesh = amps::make_torus();
  SamplingOptions options = with_radius(0.06, 42);
  const SamplingResult first = amps::sample(mesh, options);
  for (const unsigned threads : {1u, 2u, 5u, 0u}) {
    CAPTURE(threads);
    options.threads = threads;
    const SamplingResult again = amps::sample(mesh, options);
    CHECK(same_set(first.samples, again.samples));
    CHECK(again.report.darts == first.report.darts);
    CHECK(again.report.dart_samples == first.report.dart_samples);
    const MaximalityReport a = amps::verify_maximal(mesh, first.samples),
                           b = amps::verify_maximal(mesh, first.samples, threads);
    CHECK(same_bits(a.worst_coverage, b.worst_coverage));
    CHECK(same_bits(a.worst_separation, b.worst_separation));
  }
  const SamplingResult other = amps::sample(mesh, with_radius(0.06, 43));
  CHECK(!same_set(first.samples, other.samples));
  CHECK(!same_bits(first.samples.positions.topRows(1), other.samples.positions.topRows(1)));
  // The darts come first, in another order than they were thrown.
  const SampleSet darts = amps::throw_darts(mesh, with_radius(0.06, 42)).samples;
  const SampleSet of_first = selected(first.samples, [&](Index s) { return s < first.report.dart_samples; });
  CHECK(!same_set(darts, of_first));
  CHECK(same_set(sorted_by_position(darts), sorted_by_position(of_first)));
  CHECK(same_set(amps::sample(mesh, with_count(700, 9)).samples, amps::sample(mesh, with_count(700, 9)).samples));
}

TEST_CASE("sampling: the first dart is uniform on the surface") {
  const Mesh mesh = amps::make_torus(1.0, 0.6, 7, 5);  // facets of very different areas
  std::vector<std::pair<Index, Vec3>> first;
  SamplingOptions options = with_radius(10);
  options.max_rejections = 1;
  for (std::uint64_t seed = 0; seed < 20000; ++seed) {
    options.seed = seed;
    const SampleSet set = amps::throw_darts(mesh, options).samples;
    REQUIRE(set.size() == 1);
    first.emplace_back(set.facets[0], set.barycentrics.row(0).transpose());
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
    for (Index s = 0; s < 500; ++s)
      early.emplace_back(set.facets[static_cast<std::size_t>(s)], set.barycentrics.row(s).transpose());
  }
  // Less than random, because disks keep apart, but not unevenly.
  CHECK(facet_uniformity(mesh, early) < 4);
}

TEST_CASE("sampling: the first point in a gap is uniform in it") {
  // One disk in the middle of the square: eight sectors of equal gap area, each cut at distance 0.4.
  const double pi = 3.14159265358979323846, r = 0.3, cut = 0.4;
  for (const Index cells : {1, 4}) {
    CAPTURE(cells);
    const Mesh mesh = amps::make_square(cells);
    const SampleSet middle = one_sample({0.5, 0.5, 0}, r);
    std::vector<double> observed(16, 0), expected(16);
    const int n = 4000;
    for (std::size_t k = 0; k < 16; ++k)
      expected[k] = n * (k < 8 ? pi * (cut * cut - r * r) : 1 - pi * cut * cut) / 8 / (1 - pi * r * r);
    for (int seed = 0; seed < n; ++seed) {
      const SampleSet set = amps::fill_gaps(mesh, middle, with_radius(0, static_cast<std::uint64_t>(seed))).samples;
      REQUIRE(set.size() >= 2);
      const Vec3 x = sample_at(set, 1) - sample_at(set, 0);
      const auto sector = static_cast<std::size_t>((std::atan2(x.y(), x.x()) + pi) / (pi / 4)) % 8;
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

TEST_CASE("sampling: filling a set with holes keeps what is there and ends maximal") {
  for (const auto& model : amps_test::procedural_models()) {
    CAPTURE(model.name);
    const auto& [name, mesh, radius] = model;
    const double r = 2 * radius;
    const SampleSet full = amps::sample(mesh, with_radius(r, 3)).samples;
    const Vec3 hole = sample_at(full, full.size() / 2);
    const SampleSet punched = selected(full, [&](Index s) { return (sample_at(full, s) - hole).norm() > 6 * r && s % 7 != 0; });
    REQUIRE(punched.size() < full.size() - 20);
    REQUIRE(!amps::verify_maximal(mesh, punched).maximal());
    const SamplingResult filled = amps::fill_gaps(mesh, punched, with_radius(0, 4));
    check_maximal(mesh, filled);
    CHECK(filled.report.radius == r);
    CHECK(filled.report.darts == 0);
    CHECK(filled.report.gap_samples == filled.samples.size() - punched.size());
    CHECK(same_set(selected(filled.samples, [&](Index s) { return s < punched.size(); }), punched));
    // What is maximal stays as it is.
    CHECK(same_set(amps::fill_gaps(mesh, full, with_radius(r, 4)).samples, full));
  }
}

TEST_CASE("sampling: filling a set from elsewhere: no facets, many radii, points off the surface") {
  const Mesh mesh = amps::make_sphere(1280);
  SampleSet existing;
  existing.positions.resize(5, 3);
  existing.positions << 0, 0, 1.02, 0.9, 0, 0, 0, -1, 0, 0, -1, 0.01, -1.3, 0, 0;  // the third and fourth too near
  existing.radii.resize(5);
  existing.radii << 0.5, 0.3, 0.12, 0.1, 0.4;
  for (const double radius : {0.0, 0.07}) {
    CAPTURE(radius);
    const SamplingResult filled = amps::fill_gaps(mesh, existing, with_radius(radius, 6));
    const SampleSet& set = filled.samples;
    CHECK(filled.status == Outcome::kDone);
    CHECK(filled.report.radius == (radius == 0 ? 0.1 : radius));
    CHECK(filled.report.unfilled_gaps == 0);
    REQUIRE(set.size() > 500);
    CHECK(same_bits(set.positions.topRows(5), existing.positions));
    CHECK(set.radii.head(5) == existing.radii);
    CHECK(set.radii.tail(set.size() - 5) == Eigen::VectorXd::Constant(set.size() - 5, filled.report.radius));
    for (Index s = 0; s < 5; ++s) {
      CHECK(set.facets[static_cast<std::size_t>(s)] == kNone);
      CHECK(set.barycentrics.row(s).isZero(0));
    }
    check_placement(mesh, selected(set, [](Index s) { return s >= 5; }));
    CHECK(covered_by_oracle(mesh, set));
    CHECK(amps::verify_maximal(mesh, set).maximal());
    // Every pair with a new sample keeps its distance.
    for (Index s = 5; s < set.size(); ++s) {
      for (Index t = 0; t < s; ++t) {
        const double distance = (sample_at(set, s) - sample_at(set, t)).norm();
        if (distance < std::max(set.radii[s], set.radii[t]) * (1 - 1e-9))
          FAIL("samples " << s << " and " << t << " are too near");
      }
    }
  }
}

TEST_CASE("sampling: gaps of a few parts in a billion are filled") {
  // One disk that all but reaches the corners of the square.
  const double half_diagonal = std::sqrt(0.5);
  for (const double missing : {1e-2, 1e-5, 1e-7, 1e-8, 2e-9}) {
    CAPTURE(missing);
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const Mesh mesh = amps::make_square(seed % 2 == 0 ? 1 : 3);
      const SampleSet middle = one_sample({0.5, 0.5, 0}, half_diagonal * (1 - missing));
      const SamplingResult filled = amps::fill_gaps(mesh, middle, with_radius(0, seed));
      CHECK(filled.samples.size() == 5);
      CHECK(filled.report.unfilled_gaps == 0);
      CHECK(amps::verify_maximal(mesh, filled.samples).maximal());
      CHECK(brute_separation(filled.samples) >= 1 - 1e-9);
      check_placement(mesh, selected(filled.samples, [](Index s) { return s > 0; }));
    }
  }
}

TEST_CASE("sampling: find_gaps finds every uncovered point, and no more than there is") {
  Rng rng(11);
  for (const auto& model : amps_test::procedural_models()) {
    CAPTURE(model.name);
    const auto& [name, mesh, radius] = model;
    const double r = 2 * radius;
    const SampleSet full = amps::sample(mesh, with_radius(r, 7)).samples;
    CHECK(amps::find_gaps(mesh, full).gaps == 0);
    CHECK(amps::find_gaps(mesh, full).primitives.triangles.rows() == 0);
    const SampleSet punched = selected(full, [](Index s) { return s % 4 != 0; });
    const GapSet gaps = amps::find_gaps(mesh, punched);
    const MaximalityReport report = amps::verify_maximal(mesh, punched);
    CHECK(gaps.gaps == report.gaps);
    CHECK(gaps.area == doctest::Approx(report.gap_area).epsilon(1e-12));
    REQUIRE(gaps.facets.size() == static_cast<std::size_t>(gaps.primitives.triangles.rows()));
    const double primitives_area = amps::total_area(gaps.primitives);
    CHECK(primitives_area >= gaps.area * (1 - 1e-9));
    CHECK(primitives_area <= gaps.area * 2.0001);

    std::map<Index, std::vector<Index>> of_facet;
    for (Index t = 0; t < gaps.primitives.triangles.rows(); ++t)
      of_facet[gaps.facets[static_cast<std::size_t>(t)]].push_back(t);
    // Barycentric coordinates, of the facet plane, against a primitive.
    const auto outside = [](const MeshView& m, Index t, const Vec3& x) {
      const Vec3 a = m.corner(t, 0), b = m.corner(t, 1), c = m.corner(t, 2), n = (b - a).cross(c - a);
      const double area = n.squaredNorm();
      const Vec3 w((b - x).cross(c - x).dot(n), (c - x).cross(a - x).dot(n), (a - x).cross(b - x).dot(n));
      return area > 0 ? -w.minCoeff() / area : 1.0;
    };
    for (Index t = 0; t < gaps.primitives.triangles.rows(); ++t) {  // in their facet
      for (int k = 0; k < 3; ++k) {
        CHECK(outside(mesh, gaps.facets[static_cast<std::size_t>(t)], MeshView(gaps.primitives).corner(t, k)) <= 1e-9);
      }
    }
    const Cells cells(punched.positions, r);
    const std::vector<double> areas = amps::facet_areas(mesh);
    std::vector<double> up_to(areas.size());
    std::partial_sum(areas.begin(), areas.end(), up_to.begin());
    const int darts = 40000;
    int uncovered = 0, missed = 0;
    for (int d = 0; d < darts; ++d) {
      const auto found = std::upper_bound(up_to.begin(), up_to.end(), rng.uniform() * up_to.back());
      const Index f = static_cast<Index>(std::min<std::ptrdiff_t>(found - up_to.begin(), mesh.triangles.rows() - 1));
      const Vec3 b = amps::uniform_barycentric(rng);
      Vec3 x = Vec3::Zero();
      for (int k = 0; k < 3; ++k) x += b[k] * MeshView(mesh).corner(f, k);
      bool covered = false;
      cells.around(x, [&](Index s) { covered = covered || (x - cells.position(s)).norm() <= r * (1 + 1e-9); });
      if (covered) continue;
      ++uncovered;
      double best = 1;
      for (const Index t : of_facet[f]) best = std::min(best, outside(gaps.primitives, t, x));
      missed += best > 1e-6;
    }
    CHECK(missed == 0);
    const double fraction = gaps.area / up_to.back();
    const double deviation = std::sqrt(fraction * (1 - fraction) / darts);
    CHECK(std::fabs(uncovered / double(darts) - fraction) <= 4 * deviation);
  }
}

TEST_CASE("sampling: target_count is met within 1 %") {
  for (const Index count : {50, 200, 1000, 5000}) {
    CAPTURE(count);
    for (const Mesh& mesh : {amps::make_square(), amps::make_sphere(1280), amps::make_knot(), amps::make_cube(2)}) {
      CAPTURE(mesh.triangles.rows());
      const SamplingResult result = amps::sample(mesh, with_count(count));
      CHECK(std::fabs(result.samples.size() - count) <= 0.01 * count);
      CHECK(result.report.attempts >= 1);
      CHECK(result.report.radius > 0);
      const MaximalityReport report = amps::verify_maximal(mesh, result.samples);
      CHECK(report.maximal());
      CHECK(report.poisson_disk());
    }
  }
}

TEST_CASE("sampling: a handful of samples") {
  for (const Mesh& mesh : {amps::make_square(), amps::make_sphere(320), amps::make_torus(1.0, 0.4, 24, 12), moebius_band(24)}) {
    CAPTURE(mesh.triangles.rows());
    for (Index count = 1; count <= 10; ++count) {
      CAPTURE(count);
      const SamplingResult result = amps::sample(mesh, with_count(count));
      check_maximal(mesh, result);
      CHECK(std::abs(result.samples.size() - count) <= 2);
    }
  }
}

TEST_CASE("sampling: a radius greater than the mesh makes one sample") {
  const Mesh tiny = triangle_mesh({{0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0}}, {{0, 1, 2}});
  const SamplingResult one = amps::sample(tiny, with_radius(1));
  CHECK(one.samples.size() == 1);
  CHECK(one.report.gap_samples == 0);
  check_maximal(tiny, one);
  for (const double radius : {2.01, 1e3}) {
    const SamplingResult result = amps::sample(amps::make_sphere(320), with_radius(radius));
    CHECK(result.samples.size() == 1);
    check_maximal(amps::make_sphere(320), result);
  }
}

TEST_CASE("sampling: thin sheets, non-manifold edges, soups and one-sided surfaces") {
  const std::vector<std::pair<std::string, Mesh>> meshes = {
      {"sheets at 0.01 r", two_sheets(1e-3)}, {"sheets at 0.9 r", two_sheets(0.09)}, {"sheets that coincide", two_sheets(0)},
      {"book", non_manifold_book()},          {"soup", random_soup(50, 21)},         {"moebius", moebius_band(40)}};
  for (const auto& model : meshes) {
    CAPTURE(model.first);
    const auto& [name, mesh] = model;
    const SamplingResult coarse = amps::sample(mesh, with_radius(0.1));
    check_maximal(mesh, coarse);
    check_maximal(mesh, amps::sample(mesh, with_radius(0.03)));
  }
}

TEST_CASE("sampling: facets without area and isolated vertices change nothing") {
  const Mesh mesh = amps::make_sphere(320);
  Mesh spoilt = mesh;
  const Index n = static_cast<Index>(mesh.triangles.rows());
  spoilt.triangles.conservativeResize(n + 2, 3);
  spoilt.triangles.row(n) << mesh.triangles(0, 0), mesh.triangles(0, 0), mesh.triangles(0, 1);
  spoilt.triangles.row(n + 1) << 5, 5, 5;
  spoilt.vertices.conservativeResize(mesh.vertices.rows() + 1, 3);
  spoilt.vertices.row(mesh.vertices.rows()) << 50, 50, 50;
  const SamplingResult result = amps::sample(spoilt, with_radius(0.1));
  check_maximal(spoilt, result);
  CHECK(*std::max_element(result.samples.facets.begin(), result.samples.facets.end()) < n);
}

TEST_CASE("sampling: any scale and place") {
  const Mesh mesh = amps::make_torus(1.0, 0.4, 30, 16);
  const SamplingResult original = amps::sample(mesh, with_radius(0.1, 8));
  for (const int exponent : {-332, -100, -20, 20, 100, 332}) {
    CAPTURE(exponent);
    const double factor = std::ldexp(1.0, exponent);
    Mesh scaled = mesh;
    scaled.vertices *= factor;
    const SamplingResult result = amps::sample(scaled, with_radius(0.1 * factor, 8));
    // Scaling by a power of two rounds nothing: the same darts, the same gaps.
    CHECK(result.samples.size() == original.samples.size());
    CHECK(result.report.unfilled_gaps == 0);
    const MaximalityReport report = amps::verify_maximal(scaled, result.samples);
    CHECK(report.maximal());
    CHECK(report.poisson_disk());
  }
  for (const double far : {1e3, 1e5}) {
    CAPTURE(far);
    Mesh moved = mesh;
    moved.vertices.rowwise() += Eigen::RowVector3d(far, -far, far);
    const SamplingResult result = amps::sample(moved, with_radius(0.1, 8));
    CHECK(result.report.unfilled_gaps == 0);
    const MaximalityReport report = amps::verify_maximal(moved, result.samples);
    CHECK(report.maximal());
    CHECK(report.poisson_disk());
  }
}

TEST_CASE("sampling: cancelled at any stage, what is there is a Poisson-disk set and says so") {
  const Mesh mesh = amps::make_torus();
  const double radius = 0.06;
  const SampleSet done = amps::sample(mesh, with_radius(radius)).samples;
  std::map<std::string, int> reports;
  SamplingOptions count = with_radius(radius);
  count.progress = Progress([&](const char* stage, double) { return ++reports[stage] > 0; });
  amps::sample(mesh, count);
  REQUIRE(reports.size() == 3);
  for (const auto& entry : reports) {
    const std::string wanted = entry.first;
    CAPTURE(wanted);
    for (const int at : {1, (entry.second + 1) / 2, entry.second}) {
      CAPTURE(at);
      int seen = 0;
      SamplingOptions options = with_radius(radius);
      options.progress = Progress([&](const char* stage, double) { return stage != wanted || ++seen < at; });
      const SamplingResult result = amps::sample(mesh, options);
      CHECK(result.status == Outcome::kCancelled);
      CHECK(options.progress.cancelled());
      REQUIRE(result.samples.size() > 0);
      CHECK(result.samples.size() < done.size());
      CHECK(brute_separation(result.samples) >= 1 - 1e-9);
      check_placement(mesh, result.samples);
      // As far as it came it is the whole run (darts that were not all thrown are in the order they were), and it can be
      // finished.
      if (wanted == "dart throwing") {
        std::set<std::array<double, 3>> all;
        for (Index s = 0; s < done.size(); ++s) all.insert({done.positions(s, 0), done.positions(s, 1), done.positions(s, 2)});
        Index strangers = 0;
        for (Index s = 0; s < result.samples.size(); ++s) {
          const Vec3 x = sample_at(result.samples, s);
          strangers += static_cast<Index>(1 - all.count({x[0], x[1], x[2]}));
        }
        CHECK(strangers == 0);
      } else {
        CHECK(same_set(result.samples, selected(done, [&](Index s) { return s < result.samples.size(); })));
      }
      check_maximal(mesh, amps::fill_gaps(mesh, result.samples, with_radius(radius)));
    }
  }
  // Before it began.
  SamplingOptions options = with_radius(radius);
  options.progress.cancel();
  CHECK(amps::sample(mesh, options).status == Outcome::kCancelled);
  CHECK(amps::throw_darts(mesh, options).status == Outcome::kCancelled);
  CHECK(amps::fill_gaps(mesh, selected(done, [](Index s) { return s % 2 == 0; }), options).status == Outcome::kCancelled);
  options = with_count(2000);
  options.progress.cancel();
  CHECK(amps::sample(mesh, options).status == Outcome::kCancelled);
}

TEST_CASE("sampling: progress stays within [0, 1] and never falls within a stage") {
  for (const bool by_count : {false, true}) {
    SamplingOptions options = by_count ? with_count(6000) : with_radius(0.03);
    std::string last_stage;
    double last = 0;
    std::vector<std::string> stages;
    bool in_range = true, growing = true;
    options.progress = Progress([&](const char* stage, double fraction) {
      in_range = in_range && fraction >= 0 && fraction <= 1;
      if (stage != last_stage) {
        stages.emplace_back(stage);
      } else {
        growing = growing && fraction >= last;
      }
      last_stage = stage;
      last = fraction;
      return true;
    });
    const SamplingResult result = amps::sample(amps::make_torus(), options);
    CHECK(result.status == Outcome::kDone);
    CHECK(in_range);
    CHECK(growing);
    CHECK(stages.size() == static_cast<std::size_t>(3 * result.report.attempts));
  }
}

TEST_CASE("sampling: options that make no sense") {
  const Mesh mesh = amps::make_sphere(320);
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  const auto sampling = [&](const SamplingOptions& options) { return error_of([&] { amps::sample(mesh, options); }); };
  const auto darts = [&](const SamplingOptions& options) { return error_of([&] { amps::throw_darts(mesh, options); }); };
  for (const double bad : {0.0, -1.0, -0.0, nan, inf, -inf}) {
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
    options.progress = Progress([&](const char*, double) { return ++reports > 0; });
    CHECK(error_of([&] { amps::sample(mesh, options); }) == ErrorCode::kTooLarge);
    CHECK(error_of([&] { amps::throw_darts(mesh, options); }) == ErrorCode::kTooLarge);
    CHECK(error_of([&] { amps::fill_gaps(mesh, one_sample({0, 0, 1}, 1), options); }) == ErrorCode::kTooLarge);
    CHECK(reports == 0);
  }
  try {
    amps::sample(mesh, with_radius(1e-5));
  } catch (const Error& error) {
    const std::string text = error.what();
    CAPTURE(text);
    CHECK(text.find("radius") != std::string::npos);
    CHECK(text.find("e+10 samples") != std::string::npos);  // 0.70 · 4π / 1e-10
  }
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
  Mesh mesh = good;
  mesh.triangles.resize(0, 3);
  refused(mesh);
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    mesh = good;
    mesh.vertices(10, 1) = bad;
    refused(mesh);
  }
  for (const Index bad : {-1, 100000}) {
    mesh = good;
    mesh.triangles(10, 1) = bad;
    refused(mesh);
  }
  mesh = good;
  mesh.vertices.rightCols(2).setZero();
  refused(mesh);
  mesh.vertices.setZero();
  refused(mesh);
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
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const double bad : {0.0, -0.5, nan, inf}) {
    SampleSet set = good;
    set.radii[3] = bad;
    refused(set);
  }
  for (const double bad : {nan, -inf}) {
    SampleSet set = good;
    set.positions(3, 0) = bad;
    refused(set);
  }
  SampleSet set = good;
  set.radii.conservativeResize(set.size() - 1);
  refused(set);
  // A radius that would let new disks cover old samples.
  CHECK(error_of([&] { amps::fill_gaps(mesh, good, with_radius(0.51)); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { amps::fill_gaps(mesh, good, with_count(100)); }) == ErrorCode::kInvalidArgument);
}

TEST_CASE("sampling: facets and barycentrics of the wrong length are refused") {
  const Mesh mesh = amps::make_sphere(320);
  SampleSet set = amps::sample(mesh, with_radius(0.5)).samples;
  set.barycentrics.conservativeResize(2, 3);
  CHECK(error_of([&] { amps::fill_gaps(mesh, set, with_radius(0.1)); }) == ErrorCode::kInvalidArgument);
  set = amps::sample(mesh, with_radius(0.5)).samples;
  set.facets.resize(2);
  CHECK(error_of([&] { amps::fill_gaps(mesh, set, with_radius(0.1)); }) == ErrorCode::kInvalidArgument);
}

TEST_CASE("sampling: a certificate prints itself") {
  std::ostringstream out;
  out << amps::verify_maximal(amps::make_square(), one_sample({0.5, 0.5, 0}, 0.5));
  CHECK(out.str().find("1.41421") != std::string::npos);
}

TEST_SUITE("slow") {
  TEST_CASE("sampling: sets on real models are maximal, by certificate and by oracle") {
    for (const auto& model : amps_test::real_models()) {
      CAPTURE(model.name);
      const auto& [name, mesh, radius] = model;
      const SamplingResult result = amps::sample(mesh, with_radius(radius));
      check_maximal(mesh, result);
      MESSAGE(name << ": " << result.samples.size() << " samples");
    }
  }

  TEST_CASE("sampling: large sets on procedural models are maximal, by certificate and by oracle") {
    for (const auto& model : amps_test::procedural_models()) {
      CAPTURE(model.name);
      const auto& [name, mesh, radius] = model;
      check_maximal(mesh, amps::sample(mesh, with_radius(radius / 3)));
    }
  }

  TEST_CASE("sampling: Table 1 of the paper, counts and valences") {
    struct Row {
      std::string name;
      Mesh mesh;
      double maximal, darts, maximal_valence, darts_valence;
    };
    // Yan & Wonka 2012, Table 1, r = 4.5e-3. Dart throwing stops at random: single counts spread by ±5 %, medians of five by ±3
    // %, so the counts of darts are medians of 51.
    const std::vector<Row> rows = {{"square", amps::make_square(), 34500, 26800, 96.4, 94.2},
                                   {"sphere", amps_test::sphere_of_area(0.863, 81920), 29700, 23500, 96.6, 94.5}};
    const double radius = 4.5e-3;
    for (const Row& row : rows) {
      CAPTURE(row.name);
      std::vector<double> maximal, darts, maximal_valence, darts_valence;
      for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        const SamplingResult result = amps::sample(row.mesh, with_radius(radius, seed));
        const SampleSet dart_set = selected(result.samples, [&](Index s) { return s < result.report.dart_samples; });
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

  TEST_CASE("sampling: target_count is met within 1 % on real models and for large sets") {
    for (const auto& model : amps_test::real_models()) {
      CAPTURE(model.name);
      const auto& [name, mesh, radius] = model;
      for (const Index count : {50, 500, 20000}) {
        CAPTURE(count);
        const SamplingResult result = amps::sample(mesh, with_count(count));
        CHECK(std::fabs(result.samples.size() - count) <= 0.01 * count);
      }
    }
  }
}
