#define AMPS_OWN_SOURCE
#include "amps/kdtree.h"
#include "amps/portable_math.h"
#include "amps/spectrum.h"
#include "amps/surface_tree.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>

namespace amps {
namespace {

/// Pieces of the loops over points, each with counts of its own; depends on nothing but the number of points.
constexpr std::size_t kDifferencePieces = 64, kLeastPointsPerPiece = 64;
/// Points between two looks for a cancel.
constexpr std::size_t kDifferencesPerLook = 64;
/// Nearer than this, n_i·e and n_j·e are taken for equal: the formula for equal ones is off by its square, in proportion.
constexpr double kEqualSlopes = 1e-5;
/// Fewer pairs a sector are too few for a χ².
constexpr double kLeastPairsPerSector = 5;
/// The axis is the normal: the sine² of the angle between them.
constexpr double kAlongNormal = 1e-12;

/// Points on the surface with what differences need.
struct DifferencePoints {
  std::vector<Vec3> positions, normals;
  std::vector<double> radii, weights;
  void reserve(std::size_t n) {
    positions.reserve(n);
    normals.reserve(n);
    radii.reserve(n);
    weights.reserve(n);
  }
  void add(const Vec3& position, const Vec3& normal, double radius, double weight) {
    positions.push_back(position);
    normals.push_back(normal);
    radii.push_back(radius);
    weights.push_back(weight);
  }
  std::size_t size() const { return radii.size(); }
};

/// Weights of differences by length, by length and sector, by pixel.
struct DifferenceCounts {
  std::vector<double> radial, sectors, image;
  double nearest = std::numeric_limits<double>::infinity();

  DifferenceCounts() = default;
  explicit DifferenceCounts(const DifferentialOptions& options)
      : radial(detail::slot(options.bins)),
        sectors(radial.size() * detail::slot(options.sectors)),
        image(detail::slot(options.image_size) * detail::slot(options.image_size)) {}

  void add(const DifferenceCounts& other, double factor) {
    const auto add_all = [factor](std::vector<double>& to, const std::vector<double>& from) {
      for (std::size_t i = 0; i < to.size(); ++i) to[i] += factor * from[i];
    };
    add_all(radial, other.radial);
    add_all(sectors, other.sectors);
    add_all(image, other.image);
    nearest = std::min(nearest, other.nearest);
  }
};

void require_differential_options(const DifferentialOptions& options) {
  const auto refuse = [](const std::string& what) {
    throw Error(ErrorCode::kInvalidArgument, "amps: DifferentialOptions::" + what);
  };
  constexpr Index kMost = 1 << 13;  // of bins, sectors, pixels: counts stay below a few GB
  if (!(options.range > 0) || !std::isfinite(options.range)) refuse("range must be positive and finite");
  if (options.bins < 1 || options.bins > kMost) refuse("bins must be from 1 to " + std::to_string(kMost));
  if (options.sectors < 2 || options.sectors > kMost) refuse("sectors must be from 2 to " + std::to_string(kMost));
  if (options.image_size < 1 || options.image_size > kMost) refuse("image_size must be from 1 to " + std::to_string(kMost));
  if (options.references < 1) refuse("references must be at least 1");
  if (!options.axis.allFinite() || options.axis.isZero(0)) refuse("axis must be finite and not 0");
}

/// What the length of a chord is multiplied by for that of the geodesic; s and t: its direction along the normals at its ends.
double geodesic_factor(double s, double t) {
  if (std::abs(s - t) < kEqualSlopes) {
    const double mean = 0.5 * s + 0.5 * t;
    return 1 / std::sqrt((1 - mean) * (1 + mean));
  }
  return (detail::portable_arcsine(s) - detail::portable_arcsine(t)) / (s - t);
}

/// Counts differences from points with a frame on their tangent plane.
class DifferenceCounter {
 public:
  DifferenceCounter(const DifferentialOptions& options) : options_(options), axis_(detail::stable_normalized(options.axis)) {
    for (Index k = 0; k < options.sectors; ++k) {
      const detail::Phase phase = detail::portable_phase(0.5 * k / options.sectors);
      starts_.emplace_back(phase.cosine, phase.sine);
    }
  }

  /// The difference of point j of `to` from point i of `from`.
  void count(const DifferencePoints& from, std::size_t i, const DifferencePoints& to, std::size_t j, double weight,
             DifferenceCounts& counts) const {
    const Vec3 &n = from.normals[i], &other = to.normals[j];
    if (!(detail::dot(n, other) > 0)) return;
    const Vec3 d = to.positions[j] - from.positions[i];
    const double chord = detail::norm(d);
    const double scale = options_.range * (0.5 * from.radii[i] + 0.5 * to.radii[j]);
    double part = 0;  // of the range
    if (chord > 0) {
      const Vec3 e = d / chord;
      const double s = std::clamp(detail::dot(n, e), -1.0, 1.0), t = std::clamp(detail::dot(other, e), -1.0, 1.0);
      part = chord * geodesic_factor(s, t) / scale;
    }
    if (!(part < 1)) return;
    counts.nearest = std::min(counts.nearest, part * options_.range);
    const std::size_t bin = std::min(static_cast<std::size_t>(part * options_.bins), counts.radial.size() - 1);
    counts.radial[bin] += weight;
    const Vec3 along = tangent(n), across = n.cross(along);
    double x = detail::dot(along, d), y = detail::dot(across, d);
    const double length = std::sqrt(x * x + y * y);
    if (!(length > 0)) return;
    x /= length;
    y /= length;
    counts.sectors[bin * starts_.size() + sector(x, y)] += weight;
    counts.image[pixel(x * part, y * part)] += weight;
    counts.image[pixel(-x * part, -y * part)] += weight;
  }

 private:
  Vec3 tangent(const Vec3& n) const {
    Vec3 along = axis_ - n * detail::dot(n, axis_);
    if (detail::squared_norm(along) < kAlongNormal) {
      const Vec3 other = std::abs(axis_.x()) < 0.5 ? Vec3::UnitX() : Vec3::UnitY();
      along = other - n * detail::dot(n, other);
    }
    return detail::normalized(along);
  }
  /// Of the line through 0 and (x, y).
  std::size_t sector(double x, double y) const {
    if (y < 0 || (y == 0 && x < 0)) {
      x = -x;
      y = -y;
    }
    std::size_t low = 0, high = starts_.size();  // the line is not before the start of low, and before that of high
    while (high - low > 1) {
      const std::size_t middle = (low + high) / 2;
      const Eigen::Vector2d& start = starts_[middle];
      (start.x() * y - start.y() * x >= 0 ? low : high) = middle;
    }
    return low;
  }
  std::size_t pixel(double x, double y) const {
    const auto place = [this](double at) {
      return std::min(static_cast<std::size_t>((at + 1) / 2 * options_.image_size), detail::slot(options_.image_size) - 1);
    };
    return place(y) * detail::slot(options_.image_size) + place(x);
  }

  DifferentialOptions options_;
  Vec3 axis_;
  std::vector<Eigen::Vector2d> starts_;  // directions where sectors begin
};

/// Counts what visit(i, neighbours, counts) counts, over all i, in pieces that are added in their order.
template <class Visit>
DifferenceCounts count_around(std::size_t n, const DifferentialOptions& options, const Execution& run, const Visit& visit) {
  const std::size_t grain = std::max(kLeastPointsPerPiece, (n - 1) / kDifferencePieces + 1);
  std::vector<DifferenceCounts> pieces((n - 1) / grain + 1);
  detail::WorkCounter work(run, n);
  parallel_for(n, grain, run, [&](std::size_t begin, std::size_t end) {
    DifferenceCounts counts(options);
    std::vector<KdTree::Neighbor> around;
    for (std::size_t i = begin; i < end; ++i) {
      visit(i, around, counts);
      if ((i + 1 - begin) % kDifferencesPerLook == 0) work.add(kDifferencesPerLook);
    }
    pieces[begin / grain] = std::move(counts);
  });
  DifferenceCounts sum(options);
  for (const DifferenceCounts& piece : pieces) sum.add(piece, 1);
  return sum;
}

/// The facet each sample lies on: the one it names, or the nearest.
std::vector<Index> difference_facets(const MeshView& mesh, const SampleSet& samples, const Execution& run) {
  const auto known = [&mesh](Index f) { return f >= 0 && f < mesh.num_facets(); };
  if (!samples.facets.empty() && std::all_of(samples.facets.begin(), samples.facets.end(), known)) return samples.facets;
  const SurfaceTree tree(mesh, run.part(0, 0.5));
  const std::vector<SurfaceHit> hits = tree.nearest_all(samples.positions, run.part(0.5, 1));
  std::vector<Index> facets;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    const bool named = !samples.facets.empty() && known(samples.facets[i]);
    facets.push_back(named ? samples.facets[i] : hits[i].point.facet);
  }
  return facets;
}

DifferencePoints difference_points(const MeshView& mesh, const SampleSet& samples, const Execution& run) {
  const std::vector<Index> facets = difference_facets(mesh, samples, run);
  DifferencePoints points;
  points.reserve(facets.size());
  for (std::size_t i = 0; i < facets.size(); ++i) {
    points.add(samples.positions.row(static_cast<std::ptrdiff_t>(i)).transpose(), detail::normal_of(mesh, facets[i]),
               samples.radii[i], 1);
  }
  return points;
}

/// Random points of density 1/r², r the radius of the nearest sample: drawn by the radius at the middle of their facet, and
/// weighted by what that is off by.
DifferencePoints reference_points(const MeshView& mesh, const std::vector<double>& areas, const SampleSet& samples,
                                  const KdTree& tree, std::size_t n, std::uint64_t seed, const Execution& run) {
  const bool equal = detail::min_radius(samples) == detail::max_radius(samples);
  const auto radius_at = [&](const Vec3& x) { return samples.radii[equal ? 0 : detail::slot(tree.nearest(x).index)]; };
  detail::Ticker ticker(run, areas.size() + n);
  std::vector<double> ends, middles;  // running sums of weights; radii
  const double largest = *std::max_element(areas.begin(), areas.end());
  const double smallest = detail::min_radius(samples);
  double sum = 0;
  for (std::size_t f = 0; f < areas.size(); ++f) {
    ticker.tick();
    const auto facet = static_cast<Index>(f);
    middles.push_back(radius_at((mesh.corner(facet, 0) + mesh.corner(facet, 1) + mesh.corner(facet, 2)) / 3));
    const double closeness = smallest / middles.back();
    sum += areas[f] / largest * closeness * closeness;
    ends.push_back(sum);
  }
  Rng rng(seed);
  DifferencePoints points;
  points.reserve(n);
  for (std::size_t i = 0; i < n; ++i) {
    ticker.tick();
    const auto found = std::upper_bound(ends.begin(), ends.end(), rng.uniform() * sum);
    const auto f = static_cast<std::size_t>(std::min(found, ends.end() - 1) - ends.begin());
    const SurfacePoint at = detail::surface_point_at(mesh, static_cast<Index>(f), uniform_barycentric(rng));
    const double radius = radius_at(at.position), off = middles[f] / radius;
    points.add(at.position, detail::normal_of(mesh, at.facet), radius, off * off);
  }
  return points;
}

struct DifferenceSums {
  DifferenceCounts pairs, expected;
};

/// Adds one set.
void add_differences(const MeshView& mesh, const std::vector<double>& areas, const SampleSet& samples, std::uint64_t seed,
                     const DifferentialOptions& options, const Execution& run, DifferenceSums& sums) {
  const DifferencePoints points = difference_points(mesh, samples, run.part(0, 0.1));
  const KdTree tree(points.positions, run.part(0.1, 0.15));
  const std::size_t n = points.size();
  const DifferencePoints references =
      reference_points(mesh, areas, samples, tree, n * detail::slot(options.references), seed, run.part(0.15, 0.2));
  const KdTree reference_tree(references.positions, run.part(0.2, 0.3));
  const DifferenceCounter counter(options);

  // A pair is met at its greater radius, which is at least the mean of both: the search reaches far enough.
  sums.pairs.add(count_around(n, options, run.part(0.3, 0.4),
                              [&](std::size_t i, std::vector<KdTree::Neighbor>& around, DifferenceCounts& counts) {
                                tree.in_radius(points.positions[i], options.range * points.radii[i], around);
                                for (const KdTree::Neighbor& near : around) {
                                  const std::size_t j = detail::slot(near.index);
                                  const bool mine =
                                      points.radii[j] < points.radii[i] || (points.radii[j] == points.radii[i] && j > i);
                                  if (mine) counter.count(points, i, points, j, 1, counts);
                                }
                              }),
                 2);  // and the other way round
  DifferenceCounts expected = count_around(
      n, options, run.part(0.4, 0.9), [&](std::size_t i, std::vector<KdTree::Neighbor>& around, DifferenceCounts& counts) {
        reference_tree.in_radius(points.positions[i], options.range * points.radii[i], around);
        for (const KdTree::Neighbor& near : around) {
          const std::size_t j = detail::slot(near.index);
          if (references.radii[j] <= points.radii[i]) {
            counter.count(points, i, references, j, references.weights[j], counts);
          }
        }
      });
  if (detail::min_radius(samples) < detail::max_radius(samples)) {
    expected.add(count_around(references.size(), options, run.part(0.9, 1),
                              [&](std::size_t j, std::vector<KdTree::Neighbor>& around, DifferenceCounts& counts) {
                                tree.in_radius(references.positions[j], options.range * references.radii[j], around);
                                for (const KdTree::Neighbor& near : around) {
                                  const std::size_t i = detail::slot(near.index);
                                  if (points.radii[i] < references.radii[j]) {
                                    counter.count(points, i, references, j, references.weights[j], counts);
                                  }
                                }
                              }),
                 1);
  }
  double weight = 0;
  for (const double w : references.weights) weight += w;
  sums.expected.add(expected, static_cast<double>(n - 1) / weight);
}

DifferentialReport report_of(const DifferenceSums& sums, const DifferentialOptions& options) {
  DifferentialReport report;
  report.range = options.range;
  report.min_distance = std::min(sums.pairs.nearest, options.range);
  report.image_size = options.image_size;
  const auto ratio = [](double pairs, double expected) { return pairs > 0 && expected > 0 ? pairs / expected : 0; };
  const std::size_t sectors = detail::slot(options.sectors);
  for (std::size_t k = 0; k < sums.pairs.radial.size(); ++k) {
    const double pairs = sums.pairs.radial[k] / 2, expected = sums.expected.radial[k];
    report.distances.push_back(options.range * (static_cast<double>(k) + 0.5) / options.bins);
    report.radial_mean.push_back(ratio(2 * pairs, expected));
    report.pairs.push_back(pairs);
    double chi_squared = 0;
    bool enough = expected > 0;
    for (std::size_t s = 0; s < sectors && enough; ++s) {
      const double share = pairs * sums.expected.sectors[k * sectors + s] / expected;
      const double off = sums.pairs.sectors[k * sectors + s] / 2 - share;
      enough = share >= kLeastPairsPerSector;
      if (enough) chi_squared += off * off / share;
    }
    // The expected numbers are of chance too: of n·references·n differences, where pairs are n·n/2 times the pair correlation.
    const double noise = 1 + report.radial_mean.back() / (2 * options.references);
    const double dispersion = chi_squared / (options.sectors - 1) / noise;
    report.anisotropy.push_back(enough && dispersion > 0 ? 10 * detail::portable_log(dispersion) / detail::portable_log(10)
                                                         : 0);
  }
  for (std::size_t i = 0; i < sums.pairs.image.size(); ++i) {
    report.image.push_back(ratio(sums.pairs.image[i], sums.expected.image[i]));
  }
  return report;
}

DifferentialReport differences_of(const MeshView& mesh, const std::vector<const SampleSet*>& sets,
                                  const DifferentialOptions& options) {
  const Execution run = options.execution.start("measuring differences");
  require_differential_options(options);
  if (sets.empty()) throw Error(ErrorCode::kInvalidArgument, "amps: no sample set is given to take differences of");
  require_usable(mesh, run);
  double mean = 0;
  constexpr double kMostPoints = 2147483647;  // of a tree
  for (const SampleSet* set : sets) {
    detail::require_sample_set(*set);
    if (static_cast<double>(set->size()) * options.references > kMostPoints) {
      throw Error(ErrorCode::kTooLarge, "amps: " + std::to_string(set->size()) + " samples with " +
                                            std::to_string(options.references) + " references each; take fewer references");
    }
    mean += set->size();
  }
  const std::vector<double> areas = facet_areas(mesh, run);
  DifferenceSums sums{DifferenceCounts(options), DifferenceCounts(options)};
  const double share = 1 / static_cast<double>(sets.size());
  for (std::size_t i = 0; i < sets.size(); ++i) {
    const double begin = static_cast<double>(i) * share, end = std::min(1.0, begin + share);
    add_differences(mesh, areas, *sets[i], detail::scramble(options.seed) + i, options, run.part(begin, end), sums);
  }
  DifferentialReport report = report_of(sums, options);
  report.sets = static_cast<Index>(sets.size());
  report.mean_samples = mean * share;
  run.finish();
  return report;
}

}  // namespace

DifferentialReport differential_spectrum(const MeshView& mesh, const std::vector<SampleSet>& sets,
                                         const DifferentialOptions& options) {
  std::vector<const SampleSet*> pointers;
  for (const SampleSet& set : sets) pointers.push_back(&set);
  return differences_of(mesh, pointers, options);
}

DifferentialReport differential_spectrum(const MeshView& mesh, const SampleSet& samples, const DifferentialOptions& options) {
  return differences_of(mesh, {&samples}, options);
}

}  // namespace amps
