// How many samples sets have, where they are and how many disks are lowered, whatever the triangulation of the input: beside a
// thrower of darts that knows of no mesh and no diagram.
#include "amps/sampling.h"

#include "kit/samples.h"
#include "kit/statistics.h"

#include "amps/remesh.h"
#include "amps/shapes.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace amps_test {

namespace {

/// Radii over the unit square: from + slope·x.
struct LinearRadii {
  double from, slope;
  double at(double x) const { return from + slope * x; }
  double min() const { return std::min(from, from + slope); }
  double max() const { return std::max(from, from + slope); }
};

struct Disk {
  double x, y, r;
};

/// The oracle: darts of density 1/r² on the unit square. As long as fewer than k in a row fail, those count that lie in no disk
/// and whose disk holds no centre; then all that lie in no disk, with radii up to the nearest centre, until no point is left.
/// That end is reached by boxes: those within one disk are left out, and all others are cut in four from time to time. A dart
/// into a random box that is left is one into the square, given that it does not lie in the boxes left out.
class PlainThrower {
 public:
  PlainThrower(const LinearRadii& radii, std::uint64_t seed)
      : radii_(radii), cells_(std::max(1, static_cast<int>(1 / radii.max()))), disks_(at(cells_ * cells_)), random_(seed) {}

  /// All samples.
  std::vector<Disk> throw_all(int most_rejections) {
    for (int rejections = 0; rejections < most_rejections;) {
      Disk dart{uniform(), uniform(), 0};
      if (!is_kept(dart)) continue;
      const Around around = look_around(dart);
      if (around.covered || around.nearest < dart.r * dart.r) {
        ++rejections;
      } else {
        rejections = 0;
        add(dart);
      }
    }
    fill();
    return set_;
  }

 private:
  struct Around {
    bool covered = false;
    double nearest = INFINITY;  ///< squared
  };
  struct Corner {
    double x, y;
  };
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  double uniform() { return static_cast<double>(random_() >> 11) * 0x1p-53; }
  int cell(double x) const { return std::min(cells_ - 1, std::max(0, static_cast<int>(x * cells_))); }

  /// Thins uniform darts to the density.
  bool is_kept(Disk& dart) {
    dart.r = radii_.at(dart.x);
    const double ratio = radii_.min() / dart.r;
    return uniform() < ratio * ratio;
  }
  /// Cells are as wide as the largest disk.
  template <class Visit>
  void visit(double x, double y, const Visit& visit) const {
    for (int j = std::max(0, cell(y) - 1); j <= std::min(cells_ - 1, cell(y) + 1); ++j) {
      for (int i = std::max(0, cell(x) - 1); i <= std::min(cells_ - 1, cell(x) + 1); ++i) {
        for (const Disk& disk : disks_[at(j * cells_ + i)]) visit(disk);
      }
    }
  }
  Around look_around(const Disk& dart) const {
    Around result;
    visit(dart.x, dart.y, [&](const Disk& disk) {
      const double d = (disk.x - dart.x) * (disk.x - dart.x) + (disk.y - dart.y) * (disk.y - dart.y);
      result.nearest = std::min(result.nearest, d);
      result.covered |= d < disk.r * disk.r;
    });
    return result;
  }
  bool is_covered(const Corner& box, double side) const {
    bool covered = false;
    const double half = side / 2, x = box.x + half, y = box.y + half;
    visit(x, y, [&](const Disk& disk) {
      const double dx = std::fabs(disk.x - x) + half, dy = std::fabs(disk.y - y) + half;
      covered |= dx * dx + dy * dy < disk.r * disk.r;
    });
    return covered;
  }
  void add(const Disk& disk) {
    disks_[at(cell(disk.y) * cells_ + cell(disk.x))].push_back(disk);
    set_.push_back(disk);
  }
  void fill() {
    const int n = static_cast<int>(std::ceil(2 / radii_.min()));
    double side = 1.0 / n;
    std::vector<Corner> boxes;
    const auto add_box = [&](std::vector<Corner>& list, const Corner& box) {
      if (!is_covered(box, side)) list.push_back(box);
    };
    for (int i = 0; i < n * n; ++i) add_box(boxes, {i % n * side, i / n * side});
    constexpr double kSmallestBox = 1e-9;
    while (!boxes.empty() && side > kSmallestBox) {
      for (std::size_t dart = 0; dart <= boxes.size() / 2; ++dart) {
        const Corner& box = boxes[static_cast<std::size_t>(uniform() * static_cast<double>(boxes.size()))];
        Disk disk{box.x + uniform() * side, box.y + uniform() * side, 0};
        if (!is_kept(disk)) continue;
        const Around around = look_around(disk);
        if (around.covered) continue;
        disk.r = std::min(disk.r, std::sqrt(around.nearest));
        add(disk);
      }
      side /= 2;
      std::vector<Corner> quarters;
      for (const Corner& box : boxes) {
        for (int k = 0; k < 4; ++k) add_box(quarters, {box.x + k % 2 * side, box.y + k / 2 * side});
      }
      boxes.swap(quarters);
    }
  }

  LinearRadii radii_;
  int cells_;
  std::vector<std::vector<Disk>> disks_;  ///< by cell
  std::vector<Disk> set_;
  std::mt19937_64 random_;
};

/// A number seen in each of many sets.
struct Seen {
  double n = 0, sum = 0, squares = 0;
  void add(double x) {
    ++n;
    sum += x;
    squares += x * x;
  }
  double mean() const { return sum / n; }
  double variance_of_mean() const { return (squares - sum * sum / n) / (n - 1) / n; }
};

/// What is told of sets of disks.
struct SetsSeen {
  static constexpr int kRegions = 4;  ///< a side
  Seen count, lowered;                ///< lowered: the share, in per cent
  std::vector<Seen> in_region = std::vector<Seen>(kRegions * kRegions);

  void add(const std::vector<Disk>& set, const LinearRadii& radii) {
    std::vector<int> counts(in_region.size(), 0);
    int low = 0;
    for (const Disk& disk : set) {
      const auto part = [](double x) { return std::min(kRegions - 1, static_cast<int>(x * kRegions)); };
      ++counts[static_cast<std::size_t>(part(disk.y) * kRegions + part(disk.x))];
      low += disk.r < radii.at(disk.x) * (1 - 1e-9) ? 1 : 0;
    }
    count.add(static_cast<double>(set.size()));
    lowered.add(100.0 * low / static_cast<double>(set.size()));
    for (std::size_t k = 0; k < counts.size(); ++k) in_region[k].add(counts[k]);
  }
};

/// The difference of two means in units of its standard deviation.
double score_of(const Seen& a, const Seen& b) {
  const double variance = a.variance_of_mean() + b.variance_of_mean();
  return variance > 0 ? (a.mean() - b.mean()) / std::sqrt(variance) : 0.0;
}

/// χ² of the counts in regions, as chi_square_score() has it. Neighbours hardly know of each other.
double region_score(const SetsSeen& a, const SetsSeen& b) {
  double chi2 = 0;
  for (std::size_t k = 0; k < a.in_region.size(); ++k) chi2 += std::pow(score_of(a.in_region[k], b.in_region[k]), 2);
  const double v = static_cast<double>(a.in_region.size());
  return (std::cbrt(chi2 / v) - (1 - 2 / (9 * v))) / std::sqrt(2 / (9 * v));
}

SetsSeen thrown_plainly(const LinearRadii& radii, int sets) {
  SetsSeen seen;
  for (int k = 1; k <= sets; ++k) {
    seen.add(PlainThrower(radii, static_cast<std::uint64_t>(k)).throw_all(SamplingOptions().max_rejections), radii);
  }
  return seen;
}

SetsSeen sampled(const Mesh& mesh, const LinearRadii& radii, int sets) {
  SamplingOptions options;
  if (radii.slope == 0) {
    options.radius = radii.from;
  } else {
    options.sizing = amps::vertex_sizing(mesh, at_vertices(mesh, [&](const Vec3& x) { return radii.at(x.x()); }));
  }
  SetsSeen seen;
  for (int k = 1; k <= sets; ++k) {
    options.seed = static_cast<std::uint64_t>(k);
    const SampleSet samples = amps::sample(mesh, options).samples;
    std::vector<Disk> set;
    for (Index s = 0; s < samples.size(); ++s)
      set.push_back({samples.positions(s, 0), samples.positions(s, 1), samples.radii[s]});
    seen.add(set, radii);
  }
  return seen;
}

/// The unit square as `n` slivers, from one corner to two sides.
Mesh square_of_slivers(int n) {
  Mesh mesh;
  mesh.vertices.resize(n + 2, 3);
  mesh.triangles.resize(n, 3);
  mesh.vertices.row(0) << 0, 0, 0;
  for (int k = 0; k <= n; ++k) {
    const double t = 2.0 * k / n;
    mesh.vertices.row(k + 1) << std::min(1.0, 2 - t), std::min(1.0, t), 0;
    if (k < n) mesh.triangles.row(k) << 0, k + 1, k + 2;
  }
  return mesh;
}

/// The unit square as a Delaunay mesh, with facets 16 times as large in one corner as in the opposite one.
Mesh uneven_square() {
  const Mesh square = amps::make_square(8);
  amps::RemeshOptions options;
  options.sampling.sizing = amps::function_sizing(
      square, [](const amps::SurfacePoint& p) { return 0.006 + 0.06 * (p.position.x() + p.position.y()); });
  options.optimization.max_iterations = 0;
  return amps::remesh(square, options).mesh;
}

struct NamedMesh {
  std::string name;
  Mesh mesh;
};

std::vector<NamedMesh> squares() {
  return {{"two facets", amps::make_square(1)}, {"slivers", square_of_slivers(100)}, {"uneven Delaunay mesh", uneven_square()}};
}

void check_agreement(const NamedMesh& input, const SetsSeen& ours, const SetsSeen& plain) {
  CAPTURE(input.name);
  CAPTURE(input.mesh.triangles.rows());
  REQUIRE(amps::total_area(input.mesh) == doctest::Approx(1).epsilon(1e-12));
  const double noise = std::sqrt(ours.count.variance_of_mean() + plain.count.variance_of_mean()) / plain.count.mean();
  MESSAGE(input.name << ": " << ours.count.mean() << " samples, plainly " << plain.count.mean() << ", "
                     << 100 * (ours.count.mean() / plain.count.mean() - 1) << " % more, noise " << 100 * noise << " %; lowered "
                     << ours.lowered.mean() << " %, plainly " << plain.lowered.mean() << " %, noise "
                     << std::sqrt(ours.lowered.variance_of_mean() + plain.lowered.variance_of_mean()) << "; regions "
                     << region_score(ours, plain));
  CHECK(std::fabs(score_of(ours.count, plain.count)) < 3.5);
  CHECK(std::fabs(score_of(ours.lowered, plain.lowered)) < 3.5);
  CHECK(region_score(ours, plain) < 3.5);
}

constexpr int kSets = 400;

std::set<std::tuple<double, double, double>> places(const SampleSet& set) {
  std::set<std::tuple<double, double, double>> result;
  for (Index s = 0; s < set.size(); ++s) result.emplace(set.positions(s, 0), set.positions(s, 1), set.positions(s, 2));
  return result;
}

std::size_t num_common(const SampleSet& a, const SampleSet& b) {
  const auto of_a = places(a), of_b = places(b);
  return static_cast<std::size_t>(
      std::count_if(of_a.begin(), of_a.end(), [&](const auto& place) { return of_b.count(place) > 0; }));
}

}  // namespace

TEST_CASE("sampling counts: as many samples as darts thrown plainly make, whatever the triangulation" *
          doctest::test_suite("slow")) {
  // Noise of the difference: 0.06 %.
  const LinearRadii radii{0.03, 0};
  const SetsSeen plain = thrown_plainly(radii, kSets);
  for (const NamedMesh& input : squares()) check_agreement(input, sampled(input.mesh, radii, kSets), plain);
}

TEST_CASE("sampling counts: where radii vary, too, and as many disks are lowered" * doctest::test_suite("slow")) {
  const LinearRadii radii{0.01, 0.1};
  const SetsSeen plain = thrown_plainly(radii, kSets);
  CHECK(plain.lowered.mean() > 5);
  for (const NamedMesh& input : squares()) check_agreement(input, sampled(input.mesh, radii, kSets), plain);
}

TEST_CASE("sampling counts: one seed shares no points between radii that differ") {
  const Mesh mesh = amps::make_torus();
  const auto radius = [](double r) { return with_radius(r, 5); };
  CHECK(num_common(amps::sample(mesh, radius(0.084)).samples, amps::sample(mesh, radius(0.084)).samples) > 1000);
  CHECK(num_common(amps::sample(mesh, radius(0.084)).samples, amps::sample(mesh, radius(0.086)).samples) == 0);
  CHECK(num_common(amps::throw_darts(mesh, radius(0.084)).samples, amps::throw_darts(mesh, radius(0.084001)).samples) == 0);
  const amps::SizingField field =
      amps::function_sizing(mesh, [](const amps::SurfacePoint& p) { return 0.1 + 0.02 * p.position.z(); });
  CHECK(num_common(amps::sample(mesh, with_sizing(field, 5)).samples,
                   amps::sample(mesh, with_sizing(field.scaled(1.01), 5)).samples) == 0);
  const SampleSet none = head(amps::sample(mesh, radius(0.084)).samples, 1);
  CHECK(num_common(amps::fill_gaps(mesh, none, radius(0.082)).samples, amps::fill_gaps(mesh, none, radius(0.083)).samples) ==
        1);
}

TEST_SUITE("slow") {
  TEST_CASE("sampling counts: within 0.03 % of those of darts thrown plainly, on 500,000 facets, too") {
    // 4,000 samples: noise of the difference 0.028 %, of each mean 0.02 %.
    const LinearRadii radii{0.0133, 0};
    const SetsSeen plain = thrown_plainly(radii, kSets);
    std::vector<NamedMesh> inputs = squares();
    inputs.push_back({"500,000 facets", amps::make_square(500)});
    for (const NamedMesh& input : inputs) check_agreement(input, sampled(input.mesh, radii, kSets), plain);
  }

  TEST_CASE("sampling counts: where gaps are filled stretch by stretch") {
    // 40,000 samples, three stretches: noise of the difference 0.03 %.
    const LinearRadii radii{0.00418, 0};
    const SetsSeen plain = thrown_plainly(radii, 40);
    const NamedMesh input{"two facets", amps::make_square(1)};
    check_agreement(input, sampled(input.mesh, radii, 40), plain);
  }
}

}  // namespace amps_test
