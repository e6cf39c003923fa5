#include "amps/spectrum.h"

#include "kit/errors.h"
#include "kit/execution.h"
#include "kit/meshes.h"
#include "kit/pair_correlation.h"
#include "kit/random.h"

#include "amps/sampling.h"
#include "amps/shapes.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdint>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

namespace amps_test {

using amps::differential_spectrum;
using amps::DifferentialOptions;
using amps::DifferentialReport;
using amps::PointsView;
using amps::positions_of;
using amps::SampleSet;
using amps::spectrum;
using amps::SpectrumOptions;
using amps::SpectrumReport;
using amps::SquareBorder;
using doctest::Approx;

namespace {

SampleSet noise_on_square(Index n, std::uint64_t seed, double radius = 0.02) {
  Rng rng(seed);
  SampleSet set;
  set.positions = made_points(n, [&](Index) {
    const double x = rng.uniform(), y = rng.uniform();
    return Vec3(x, y, 0);
  });
  set.radii.assign(at(n), radius);
  return set;
}

std::vector<SampleSet> noise_on_square(Index sets, Index n) {
  std::vector<SampleSet> result;
  for (Index k = 0; k < sets; ++k) result.push_back(noise_on_square(n, 100 + static_cast<std::uint64_t>(k)));
  return result;
}

std::vector<SampleSet> disks_on(const Mesh& mesh, double radius, int sets) {
  std::vector<SampleSet> result;
  for (int k = 1; k <= sets; ++k) {
    amps::SamplingOptions options;
    options.radius = radius;
    options.seed = static_cast<std::uint64_t>(k);
    result.push_back(amps::sample(mesh, options).samples);
  }
  return result;
}

SpectrumOptions periodic(Index max_frequency = 0) {
  SpectrumOptions options;
  options.border = SquareBorder::kPeriodic;
  options.max_frequency = max_frequency;
  return options;
}

/// The mean over the rings from `from` to `to`, weighted by their frequencies.
double mean_power(const SpectrumReport& report, double from, double to) {
  double sum = 0, count = 0;
  for (std::size_t k = 0; k < report.rings.size(); ++k) {
    if (report.rings[k] < from || report.rings[k] > to) continue;
    sum += report.radial_mean[k] * report.frequencies[k];
    count += report.frequencies[k];
  }
  return sum / count;
}

double mean_anisotropy(const SpectrumReport& report, Index from) {
  double sum = 0, count = 0;
  for (std::size_t k = 0; k < report.rings.size(); ++k) {
    if (report.rings[k] < from) continue;
    sum += report.anisotropy[k];
    ++count;
  }
  return sum / count;
}

double mean_between(const DifferentialReport& report, const std::vector<double>& values, double from, double to) {
  double sum = 0, count = 0;
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (report.distances[k] < from || report.distances[k] > to) continue;
    sum += values[k];
    ++count;
  }
  return sum / count;
}

/// Nothing is nearer than 1 radius, whatever the bins.
void check_void(const DifferentialReport& report) {
  CHECK(report.min_distance >= 1 - 1e-12);
  const double half = report.range / static_cast<double>(report.distances.size()) / 2;
  for (std::size_t k = 0; k < report.distances.size(); ++k) {
    if (report.distances[k] + half < 1 - 1e-9) CHECK(report.radial_mean[k] == 0);
  }
}

/// exp(−2πi(ux + vy)) summed by <cmath>.
double naive_power(const SampleSet& set, int u, int v, bool window) {
  std::complex<double> sum = 0;
  double noise = 0;
  for (Index i = 0; i < set.size(); ++i) {
    const double x = (set.positions(i, 0) - 2) / 3, y = (set.positions(i, 1) + 1) / 3;
    const double w = window ? (1 - std::cos(2 * kPi * x)) * (1 - std::cos(2 * kPi * y)) : 1;
    sum += w * std::polar(1.0, -2 * kPi * (u * x + v * y));
    noise += w * w;
  }
  return std::norm(sum) / noise;
}

}  // namespace

TEST_CASE("spectrum: sums are those of the definition, with and without a window") {
  std::vector<SampleSet> sets;
  for (const Index n : {1, 64, 137}) {  // less than a block of points, one, more
    SampleSet set = noise_on_square(n, static_cast<std::uint64_t>(n));
    for (Index i = 0; i < n; ++i) {
      set.positions(i, 0) = 2 + 3 * set.positions(i, 0);
      set.positions(i, 1) = -1 + 3 * set.positions(i, 1);
      set.positions(i, 2) = 7;
    }
    sets.push_back(set);
  }
  for (const bool window : {false, true}) {
    SpectrumOptions options;
    options.x = 2;
    options.y = -1;
    options.side = 3;
    options.border = window ? SquareBorder::kWindow : SquareBorder::kPeriodic;
    options.max_frequency = 21;
    const SpectrumReport report = spectrum(positions_of(sets), options);
    REQUIRE(report.power.size() == 43 * 43);
    CHECK(report.mean_points == Approx(202.0 / 3));
    for (int v = -21; v <= 21; ++v) {
      for (int u = -21; u <= 21; ++u) {
        double expected = 0;
        for (const SampleSet& set : sets) expected += naive_power(set, u, v, window) / 3;
        CHECK(std::abs(report.at(u, v) - expected) < 1e-10);
      }
    }
    std::size_t frequencies = 0;
    for (const Index f : report.frequencies) frequencies += at(f);
    std::size_t in_rings = 0;
    for (int v = 0; v <= 21; ++v) {
      for (int u = -21; u <= 21; ++u) {
        if (u * u + v * v >= 21.5 * 21.5 || (v == 0 && u <= 0) || (window && std::abs(u) <= 1 && v <= 1)) continue;
        ++in_rings;
      }
    }
    CHECK(frequencies == in_rings);
    CHECK(report.rings.front() == (window ? 2 : 1));
    CHECK(report.rings.back() == 21);
  }
}

TEST_CASE("spectrum: white noise has power 1, and only as much anisotropy as so many sets leave") {
  const std::vector<SampleSet> sets = noise_on_square(10, 900);
  for (const bool window : {false, true}) {
    SpectrumOptions options = periodic(60);
    if (window) options.border = SquareBorder::kWindow;
    const SpectrumReport report = spectrum(positions_of(sets), options);
    // Power is exponentially distributed with deviation 1. Neighbours of the window share: of 9, about 2 are independent.
    const double shared = window ? 4 : 1;
    for (std::size_t k = 0; k < report.rings.size(); ++k) {
      CHECK(std::abs(report.radial_mean[k] - 1) < 5 * std::sqrt(shared / (10.0 * report.frequencies[k])));
    }
    CHECK(mean_power(report, 2, 60) == Approx(1).epsilon(0.03));
    CHECK(mean_anisotropy(report, 10) == Approx(-10).epsilon(0.05));
    CHECK(report.effective_nyquist == 0);
    CHECK(report.oscillation < 1);
  }
}

TEST_CASE("spectrum: a square lattice has peaks at its dual lattice and nothing else") {
  constexpr Index kSide = 12;
  SampleSet lattice;
  lattice.positions =
      made_points(kSide * kSide, [](Index i) { return Vec3((i % kSide + 0.3) / kSide, (i / kSide + 0.6) / kSide, 0); });
  const SpectrumReport report = spectrum({lattice.positions}, periodic(40));
  for (int v = -40; v <= 40; ++v) {
    for (int u = -40; u <= 40; ++u) {
      const double expected = u % kSide == 0 && v % kSide == 0 ? kSide * kSide : 0;
      CHECK(std::abs(report.at(u, v) - expected) < 1e-10);
    }
  }
  CHECK(report.effective_nyquist == Approx(1).epsilon(0.05));
  CHECK(report.oscillation > 10);
  // Through a window the same peaks, three frequencies wide; of the mean density, nothing is left beside 0.
  const SpectrumReport seen = spectrum({lattice.positions}, {0, 0, 1, SquareBorder::kWindow, 40, {}});
  CHECK(seen.at(kSide, 0) == Approx(seen.at(0, 0)));
  CHECK(seen.at(kSide + 1, 0) == Approx(seen.at(kSide, 0) / 4));
  CHECK(seen.at(kSide + 2, 0) < 1e-10);
  CHECK(seen.at(3, 0) < 1e-10);
}

TEST_CASE("spectrum: a jittered grid lacks low frequencies by the law of its jitter") {
  // Of a point uniform in each cell of a grid of m × m, Σ exp has mean 0 at all frequencies but multiples of m in both axes,
  // and P(u, v) = 1 − sinc²(πu/m)·sinc²(πv/m) exactly: it rises as (π²/3)|f|²/m², reaches 1 at the cells' frequency.
  constexpr Index kSide = 24, kSets = 40;
  std::vector<SampleSet> sets;
  for (int k = 0; k < kSets; ++k) {
    Rng rng(static_cast<std::uint64_t>(500 + k));
    SampleSet set;
    set.positions = made_points(kSide * kSide, [&](Index i) {
      const double x = rng.uniform(), y = rng.uniform();
      return Vec3((i % kSide + x) / kSide, (i / kSide + y) / kSide, 0);
    });
    sets.push_back(set);
  }
  const SpectrumReport report = spectrum(positions_of(sets), periodic(60));
  const auto sinc2 = [](double f) {
    const double x = kPi * f / kSide;
    return f == 0 ? 1.0 : std::sin(x) * std::sin(x) / (x * x);
  };
  std::vector<double> expected(report.rings.size(), 0.0), count(report.rings.size(), 0.0);
  for (int v = -60; v <= 60; ++v) {
    for (int u = -60; u <= 60; ++u) {
      const auto ring = static_cast<std::size_t>(std::floor(std::hypot(u, v) + 0.5));
      if (ring < 1 || ring > expected.size()) continue;
      expected[ring - 1] += 1 - sinc2(u) * sinc2(v);
      ++count[ring - 1];
    }
  }
  for (std::size_t k = 0; k < expected.size(); ++k) {
    expected[k] /= count[k];
    // Exponentially distributed about its mean, as noise is; f and −f are one.
    const double deviation = expected[k] * std::sqrt(2 / (kSets * count[k]));
    CHECK(std::abs(report.radial_mean[k] - expected[k]) < 5 * deviation);
  }
  CHECK(report.effective_nyquist > 0.1);
  CHECK(report.effective_nyquist < 0.56);  // worse than step blue noise
  CHECK(report.oscillation < 1);
}

TEST_CASE("spectrum: a hexagonal lattice has peaks at its dual lattice, of six directions") {
  // Rows of kAlong points, every other one shifted by half a distance, in a square that they almost fill as equilateral
  // triangles: 15 × 2/√3 = 17.3 rows, taken as 18. Peaks at (a·kAlong, b·kRows/2), a + b even.
  constexpr Index kAlong = 15, kRows = 18;
  SampleSet lattice;
  lattice.positions = made_points(kAlong * kRows, [](Index i) {
    const Index row = i / kAlong;
    return Vec3((i % kAlong + 0.25 + 0.5 * (row % 2)) / kAlong, (row + 0.5) / kRows, 0);
  });
  const SpectrumReport report = spectrum({lattice.positions}, periodic(50));
  Index peaks = 0;
  for (int v = -50; v <= 50; ++v) {
    for (int u = -50; u <= 50; ++u) {
      const bool peak = u % kAlong == 0 && v % (kRows / 2) == 0 && (u / kAlong + v / (kRows / 2)) % 2 == 0;
      CHECK(std::abs(report.at(u, v) - (peak ? kAlong * kRows : 0)) < 1e-9);
      peaks += peak && (u != 0 || v != 0) && std::hypot(u, v) < 1.2 * kRows;
    }
  }
  CHECK(peaks == 6);
  // The first peaks of equilateral triangles are at 2/(√3 d), n = 2/(√3 d²): 1.0746 √n.
  CHECK(report.effective_nyquist > 1);
  CHECK(report.effective_nyquist < 2.2);
  CHECK(report.oscillation > 10);
  const auto first = std::find_if(report.radial_mean.begin(), report.radial_mean.end(), [](double p) { return p > 0.1; });
  const double at_first = report.rings[static_cast<std::size_t>(first - report.radial_mean.begin())];
  CHECK(at_first / std::sqrt(report.mean_points) == Approx(1.0746).epsilon(0.04));
  CHECK(report.anisotropy[static_cast<std::size_t>(first - report.radial_mean.begin())] > 5);
}

TEST_CASE("spectrum: maximal Poisson-disk sets have no low frequencies, a peak near 1/r, and no direction") {
  constexpr double kRadius = 0.03;
  const std::vector<SampleSet> sets = disks_on(amps::make_square(8), kRadius, 10);
  const SpectrumReport report = spectrum(positions_of(sets));
  CHECK(report.sets == 10);
  CHECK(mean_power(report, 2, 0.3 / kRadius) < 0.1);
  std::size_t peak = 0;
  for (std::size_t k = 0; k < report.rings.size(); ++k) {
    if (report.radial_mean[k] > report.radial_mean[peak]) peak = k;
  }
  // The dual lattice of a hexagonal one of distance d begins at 1.155/d; neighbours are at about 1.2 r.
  CHECK(report.rings[peak] * kRadius > 0.85);
  CHECK(report.rings[peak] * kRadius < 1.1);
  CHECK(report.radial_mean[peak] > 1.5);
  CHECK(mean_power(report, 3 / kRadius, 4 / kRadius) == Approx(1).epsilon(0.05));
  CHECK(mean_anisotropy(report, 8) == Approx(-10).epsilon(0.1));
  CHECK(report.effective_nyquist > 0.55);
  CHECK(report.effective_nyquist < 0.85);
  CHECK(report.oscillation > 1);
  CHECK(report.oscillation < 5);
}

TEST_CASE("spectrum: maximal sets have that of darts thrown until none fits") {
  constexpr double kRadius = 0.03;
  constexpr Index kCells = 48;  // narrower than r/√2: one dart each
  constexpr int kRejections = 20000, kSets = 6;
  std::vector<SampleSet> darts;
  for (int k = 0; k < kSets; ++k) {
    Rng rng(static_cast<std::uint64_t>(40 + k));
    std::vector<Vec3> points;
    std::vector<Index> grid(at(kCells * kCells), amps::kNone);
    for (int rejected = 0; rejected < kRejections; ++rejected) {
      const double x = rng.uniform(), y = rng.uniform();
      const auto i = static_cast<Index>(x * kCells), j = static_cast<Index>(y * kCells);
      bool fits = true;
      for (Index b = std::max(j - 2, 0); b <= std::min(j + 2, kCells - 1) && fits; ++b) {
        for (Index a = std::max(i - 2, 0); a <= std::min(i + 2, kCells - 1) && fits; ++a) {
          const Index other = grid[at(b * kCells + a)];
          fits = other == amps::kNone || (points[at(other)] - Vec3(x, y, 0)).norm() >= kRadius;
        }
      }
      if (!fits) continue;
      rejected = 0;
      grid[at(j * kCells + i)] = static_cast<Index>(points.size());
      points.emplace_back(x, y, 0);
    }
    SampleSet set;
    set.positions = points_of(points);
    darts.push_back(set);
  }
  SpectrumOptions options;
  options.max_frequency = 120;
  const SpectrumReport expected = spectrum(positions_of(darts), options);
  const SpectrumReport report = spectrum(positions_of(disks_on(amps::make_square(8), kRadius, kSets)), options);
  double score = 0;
  for (std::size_t k = 0; k < report.rings.size(); ++k) {
    // Both are means over sets and over frequencies, of which the window leaves a quarter independent.
    const double deviation = expected.radial_mean[k] * std::sqrt(2 * 4 / (kSets * 1.0 * report.frequencies[k]));
    const double off = (report.radial_mean[k] - expected.radial_mean[k]) / deviation;
    CHECK(std::abs(off) < 4);
    score += off * off / static_cast<double>(report.rings.size());
  }
  CHECK(score < 1.5);
  CHECK(report.effective_nyquist == Approx(expected.effective_nyquist).epsilon(0.06));
  CHECK(report.oscillation == Approx(expected.oscillation).epsilon(0.15));
}

TEST_CASE("spectrum: the same bits on any number of threads") {
  const std::vector<SampleSet> sets = noise_on_square(3, 300);
  SpectrumOptions options;
  const SpectrumReport one = spectrum(positions_of(sets), options);
  DifferentialOptions differences;
  const Mesh square = amps::make_square(3);
  const DifferentialReport one_difference = differential_spectrum(square, sets, differences);
  for (const unsigned threads : {2U, 3U}) {
    options.execution.threads = differences.execution.threads = threads;
    const SpectrumReport report = spectrum(positions_of(sets), options);
    CHECK(report.power == one.power);
    CHECK(report.radial_mean == one.radial_mean);
    CHECK(report.anisotropy == one.anisotropy);
    const DifferentialReport difference = differential_spectrum(square, sets, differences);
    CHECK(difference.radial_mean == one_difference.radial_mean);
    CHECK(difference.anisotropy == one_difference.anisotropy);
    CHECK(difference.image == one_difference.image);
  }
}

TEST_CASE("spectrum: what cannot be measured is refused, and any call can be cancelled") {
  const std::vector<SampleSet> sets = noise_on_square(2, 200);
  const Mesh square = amps::make_square(3);
  const auto refused = [&](const std::vector<PointsView>& points, const SpectrumOptions& options) {
    return error_of([&] { spectrum(points, options); });
  };
  CHECK(refused({}, {}) == ErrorCode::kInvalidArgument);
  CHECK(refused({Points(0)}, {}) == ErrorCode::kInvalidArgument);
  CHECK(refused(positions_of(sets), periodic(3)) == ErrorCode::kInvalidArgument);
  SpectrumOptions elsewhere = periodic();
  elsewhere.x = 0.5;
  CHECK(refused(positions_of(sets), elsewhere) == ErrorCode::kInvalidArgument);
  elsewhere.border = SquareBorder::kWindow;
  CHECK(spectrum(positions_of(sets), elsewhere).mean_points < 150);
  elsewhere.x = 5;
  CHECK(refused(positions_of(sets), elsewhere) == ErrorCode::kInvalidArgument);
  SpectrumOptions flat;
  flat.side = 0;
  CHECK(refused(positions_of(sets), flat) == ErrorCode::kInvalidArgument);
  std::vector<SampleSet> broken = sets;
  broken[1].positions(7, 1) = std::numeric_limits<double>::quiet_NaN();
  CHECK(refused(positions_of(broken), {}) == ErrorCode::kInvalidArgument);

  const auto differences_refused = [&](const std::vector<SampleSet>& given, const DifferentialOptions& options) {
    return error_of([&] { differential_spectrum(square, given, options); });
  };
  CHECK(differences_refused({}, {}) == ErrorCode::kInvalidArgument);
  CHECK(differences_refused(broken, {}) == ErrorCode::kInvalidArgument);
  for (const int k : {0, 1, 2, 3, 4}) {
    DifferentialOptions bad;
    if (k == 0) bad.range = 0;
    if (k == 1) bad.bins = 0;
    if (k == 2) bad.sectors = 1;
    if (k == 3) bad.axis = Vec3::Zero();
    if (k == 4) bad.references = 0;
    CHECK(differences_refused(sets, bad) == ErrorCode::kInvalidArgument);
  }

  for (const double when : {0.0, 0.5}) {
    double last = 0;
    const auto stop = [&](const char*, double fraction) {
      CHECK(fraction >= last);
      last = fraction;
      return fraction < when;
    };
    SpectrumOptions options;
    watch(options, stop);
    CHECK(refused(positions_of(sets), options) == ErrorCode::kCancelled);
    last = 0;
    DifferentialOptions differences;
    watch(differences, stop);
    CHECK(differences_refused(sets, differences) == ErrorCode::kCancelled);
  }
  double end = 0;
  SpectrumOptions watched;
  watch(watched, [&](const char*, double fraction) {
    end = fraction;
    return true;
  });
  spectrum(positions_of(sets), watched);
  CHECK(end == 1);
}

TEST_CASE("differential spectrum: white noise has pair correlation 1 in the plane, at borders, on curved surfaces") {
  for (const int shape : {0, 1, 2}) {
    const Mesh mesh = shape == 0   ? amps::make_square(2)
                      : shape == 1 ? amps::make_sphere(2000, 0.3)
                                   : amps::make_torus(0.4, 0.1);
    std::vector<SampleSet> sets;
    Rng rng(5);
    const std::vector<double> areas = amps::facet_areas(mesh);
    double largest = 0;
    for (const double a : areas) largest = std::max(largest, a);
    for (int k = 0; k < 4; ++k) {
      std::vector<Vec3> points;
      SampleSet set;
      while (points.size() < 1000) {
        const auto f = static_cast<Index>(rng.below(areas.size()));
        if (rng.uniform() * largest > areas[at(f)]) continue;
        points.push_back(amps::detail::surface_point_at(mesh, f, amps::uniform_barycentric(rng)).position);
      }
      set.positions = points_of(points);
      set.radii.assign(1000, 0.02);
      sets.push_back(set);
    }
    const DifferentialReport report = differential_spectrum(mesh, sets);
    for (std::size_t k = 0; k < report.distances.size(); ++k) {
      // n pairs leave 1/√n; the references a third of that.
      CHECK(std::abs(report.radial_mean[k] - 1) < 5 / std::sqrt(std::max(1.0, report.pairs[k])) * 1.1);
    }
    CHECK(mean_between(report, report.radial_mean, 1, 5) == Approx(1).epsilon(0.03));
    CHECK(std::abs(mean_between(report, report.anisotropy, 2, 5)) < 1);
  }
}

TEST_CASE("differential spectrum: Poisson-disk sets have no difference below r, and no order far off") {
  constexpr double kRadius = 0.03;
  const std::vector<SampleSet> sets = disks_on(amps::make_square(8), kRadius, 6);
  const DifferentialReport report = differential_spectrum(amps::make_square(8), sets);
  check_void(report);
  CHECK(mean_between(report, report.radial_mean, 1, 1.1) > 1.3);
  CHECK(mean_between(report, report.radial_mean, 4, 5) == Approx(1).epsilon(0.01));
  CHECK(std::abs(mean_between(report, report.anisotropy, 1, 5)) < 1);

  // Beside another way to count, of points away from the border.
  std::vector<double> expected(100, 0.0);
  for (const SampleSet& set : sets) {
    std::vector<char> inner;
    double inside = 0;
    for (Index i = 0; i < set.size(); ++i) {
      const double x = set.positions(i, 0), y = set.positions(i, 1);
      inner.push_back(std::min({x, y, 1 - x, 1 - y}) > 5 * kRadius ? 1 : 0);
      inside += inner.back();
    }
    const double side = 1 - 10 * kRadius;
    const std::vector<double> g = pair_correlation(set.positions, inner, inside / (side * side), 0, kRadius * 0.05, 100);
    for (std::size_t k = 0; k < g.size(); ++k) expected[k] += g[k] / 6;
  }
  for (std::size_t k = 0; k < expected.size(); ++k) {
    CHECK(std::abs(report.radial_mean[k] - expected[k]) < 0.02 + 6 / std::sqrt(std::max(1.0, report.pairs[k])));
  }

  // The image: the same by direction; its middle is empty.
  const Index middle = report.image_size / 2;
  for (int k = 0; k < report.image_size * report.image_size; ++k) {
    CHECK(report.image[at(k)] == report.image[at(report.image_size * report.image_size - 1 - k)]);
    const double x = k % report.image_size - middle, y = k / report.image_size - middle;
    if (std::hypot(x, y) + 1 < middle / report.range) CHECK(report.image[at(k)] == 0);
  }
}

TEST_CASE("differential spectrum: on a sphere that of the plane, without a preferred direction") {
  constexpr double kRadius = 0.05;
  const Mesh sphere = amps::make_sphere(20000);
  const std::vector<SampleSet> sets = disks_on(sphere, kRadius, 2);
  const DifferentialReport report = differential_spectrum(sphere, sets);
  check_void(report);
  CHECK(mean_between(report, report.radial_mean, 4, 5) == Approx(1).epsilon(0.01));
  CHECK(std::abs(mean_between(report, report.anisotropy, 1, 5)) < 0.6);
  for (std::size_t k = 20; k < 100; ++k) CHECK(std::abs(report.anisotropy[k]) < 6);
  const DifferentialReport plane = differential_spectrum(amps::make_square(8), disks_on(amps::make_square(8), 0.02, 2));
  for (std::size_t k = 22; k < 100; ++k) {
    const double noise = std::sqrt(1 / plane.pairs[k] + 1 / report.pairs[k]);
    CHECK(std::abs(report.radial_mean[k] - plane.radial_mean[k]) < 0.03 + 5 * noise);
  }
}

TEST_CASE("differential spectrum: on a torus that of the plane, without a preferred direction") {
  constexpr double kRadius = 0.05;
  const Mesh torus = amps::make_torus(1.0, 0.4, 160, 64);
  DifferentialOptions options;
  options.range = 3;  // beyond, the tube is curved too much for what is seen on a plane
  options.bins = 60;
  const std::vector<SampleSet> sets = disks_on(torus, kRadius, 3);
  const DifferentialReport report = differential_spectrum(torus, sets, options);
  CHECK(report.min_distance >= 1 - 1e-12);
  CHECK(mean_between(report, report.radial_mean, 2.5, 3) == Approx(1).epsilon(0.02));
  CHECK(std::abs(mean_between(report, report.anisotropy, 1, 3)) < 0.8);
  const DifferentialReport plane =
      differential_spectrum(amps::make_square(8), disks_on(amps::make_square(8), 0.02, 2), options);
  for (std::size_t k = 22; k < 60; ++k) {
    const double noise = std::sqrt(1 / plane.pairs[k] + 1 / report.pairs[k]);
    CHECK(std::abs(report.radial_mean[k] - plane.radial_mean[k]) < 0.03 + 5 * noise);
  }
}

TEST_CASE("differential spectrum: a preferred direction is seen, and which") {
  const Mesh square = amps::make_square(8);
  std::vector<SampleSet> sets = disks_on(square, 0.03, 2);
  const auto stretch = [](const Vec3& x) { return Vec3(1.5 * x.x(), x.y(), 0); };
  for (SampleSet& set : sets) set.positions = transformed(set.positions, stretch);
  DifferentialOptions options;
  options.axis = Vec3::UnitX();
  const DifferentialReport report = differential_spectrum(transformed(square, stretch), sets, options);
  CHECK(mean_between(report, report.anisotropy, 1, 1.4) > 6);
  const Index size = report.image_size, middle = size / 2;
  const auto at_difference = [&](double along, double across) {
    const auto place = [&](double d) { return middle + static_cast<Index>(std::lround(d / report.range * size / 2)); };
    return report.image[at(place(across) * size + place(along))];
  };
  CHECK(at_difference(1.25, 0) == 0);  // the void is an ellipse
  CHECK(at_difference(0, 1.25) > 0.5);
}

TEST_CASE("differential spectrum: lengths of differences are those of geodesics on a sphere") {
  for (const double angle : {1e-7, 1e-3, 0.2, 1.0, 1.5}) {
    const Vec3 p(1, 0, 0), q(std::cos(angle), std::sin(angle), 0);
    const auto tangent_facet = [](const Vec3& x) {
      const Vec3 u = 1e-9 * x.cross(Vec3::UnitZ()), v = 1e-9 * Vec3::UnitZ();
      return std::array<Vec3, 3>{x - u - v, x - v + u, x + v};
    };
    std::array<Vec3, 3> a = tangent_facet(p), b = tangent_facet(q);
    for (auto* facet : {&a, &b}) {
      if (((*facet)[1] - (*facet)[0]).cross((*facet)[2] - (*facet)[0]).dot((*facet)[0]) < 0)
        std::swap((*facet)[0], (*facet)[1]);
    }
    SampleSet set;
    set.positions = points_of({p, q});
    set.radii = {0.5, 0.7};
    set.facets = {0, 1};
    set.barycentrics = Points(2);
    const DifferentialReport report = differential_spectrum(soup_mesh({a, b}), set);
    CHECK(report.min_distance * 0.6 == Approx(angle).epsilon(1e-6));
  }
}

TEST_CASE("differential spectrum: varying radii are scaled away") {
  const Mesh square = amps::make_square(30);
  amps::SamplingOptions options;
  std::vector<double> wanted;
  for (Index v = 0; v < rows(square.vertices); ++v) wanted.push_back(0.008 + 0.03 * square.vertices(v, 0));
  options.sizing = amps::vertex_sizing(square, wanted);
  std::vector<SampleSet> sets;
  for (int k = 0; k < 4; ++k) {
    options.seed = static_cast<std::uint64_t>(10 + k);
    sets.push_back(amps::sample(square, options).samples);
  }
  // On the mesh itself, and on one whose facets are far larger than the radii vary over.
  for (const Index cells : {30, 1}) {
    if (cells == 1) {
      for (SampleSet& set : sets) {
        set.facets.clear();
        set.barycentrics = Points();
      }
    }
    const DifferentialReport report = differential_spectrum(amps::make_square(cells), sets);
    check_void(report);
    CHECK(mean_between(report, report.radial_mean, 1, 1.15) > 1.2);
    CHECK(mean_between(report, report.radial_mean, 3.5, 5) == Approx(1).epsilon(0.04));
  }
}

TEST_CASE("differential spectrum: no order is that of density 1/r², on facets of any size") {
  // Of samples that are as dense everywhere, nπr² others are within r, where ∫ 1/r² dA gives nπ / ∫ 1/r² dA: the mean of r²
  // times that of 1/r² as many.
  constexpr double kLeast = 0.008, kMost = 0.038;
  constexpr double kExpected = (kMost * kMost + kMost * kLeast + kLeast * kLeast) / 3 / (kLeast * kMost);
  for (const Index cells : {1, 40}) {
    std::vector<SampleSet> sets = noise_on_square(2, 3000);
    for (SampleSet& set : sets) {
      for (Index i = 0; i < set.size(); ++i) set.radii[at(i)] = kLeast + (kMost - kLeast) * set.positions(i, 0);
    }
    DifferentialOptions options;
    options.range = 1;
    options.bins = 1;
    const DifferentialReport report = differential_spectrum(amps::make_square(cells), sets, options);
    CHECK(report.radial_mean[0] == Approx(kExpected).epsilon(0.05));
  }
}

TEST_CASE("differential spectrum: sheets do not see each other") {
  const std::vector<SampleSet> one = disks_on(amps::make_square(4), 0.05, 1);
  const Mesh sheets = joined(amps::make_square(4), inside_out(moved(amps::make_square(4), {0, 0, 0.01})));
  SampleSet both = one[0];
  both.positions = joined(one[0].positions, moved(one[0].positions, {0, 0, 0.01}));
  both.radii.assign(at(both.size()), 0.05);
  both.facets.clear();
  both.barycentrics = Points();
  check_void(differential_spectrum(sheets, both));
}

TEST_CASE("spectrum: reports are written as CSV") {
  const std::vector<SampleSet> sets = noise_on_square(2, 100);
  const SpectrumReport report = spectrum(positions_of(sets), periodic(10));
  const DifferentialReport differences = differential_spectrum(amps::make_square(1), sets[0]);
  std::ostringstream text, other;
  amps::write_spectrum(text, report);
  amps::write_spectrum(other, differences);
  std::istringstream lines(text.str());
  std::string line;
  std::getline(lines, line);
  CHECK(line == "frequency,relative_frequency,radial_mean,anisotropy_db,frequencies");
  for (std::size_t k = 0; k < report.rings.size(); ++k) {
    std::getline(lines, line);
    std::istringstream numbers(line);
    double ring = 0, relative = 0, mean = 0;
    char comma = 0;
    numbers >> ring >> comma >> relative >> comma >> mean;
    CHECK(ring == report.rings[k]);
    CHECK(relative == Approx(ring / 10));
    CHECK(mean == Approx(report.radial_mean[k]).epsilon(1e-8));
  }
  const std::string written = other.str();
  CHECK(written.rfind("distance,pair_correlation,anisotropy_db,pairs\n", 0) == 0);
  CHECK(std::count(written.begin(), written.end(), '\n') == 101);
}

}  // namespace amps_test
