#define AMPS_OWN_SOURCE
#include "amps/darts.h"

#include "amps/sizing_lattice.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>

namespace amps::detail {

AliasTable::AliasTable(const std::vector<double>& weights, const Execution& execution) : entries_(weights.size()) {
  const std::size_t n = weights.size();
  double largest = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (!(weights[i] >= 0 && std::isfinite(weights[i]))) {
      throw Error(ErrorCode::kInvalidArgument, "AliasTable: weight " + std::to_string(i) +
                                                   " is negative or not finite; weights must be finite and at least 0");
    }
    largest = std::max(largest, weights[i]);
  }
  if (!(largest > 0)) throw Error(ErrorCode::kInvalidArgument, "AliasTable: no weight is positive, so nothing can be drawn");

  // Mass of each entry in units of the mean; relative to the largest first, so that the sum cannot overflow.
  double sum = 0;
  for (const double w : weights) sum += w / largest;
  const double to_mean = static_cast<double>(n) / sum;
  std::vector<double> mass(n);
  std::vector<Index> light, heavy;
  for_each_piece(n, kElementsPerLook, execution.part(0, 0.4), [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      mass[i] = weights[i] / largest * to_mean;
      (mass[i] < 1 ? light : heavy).push_back(static_cast<Index>(i));
    }
  });
  Ticker ticker(execution.part(0.4, 1), n, kElementsPerLook);
  while (!light.empty() && !heavy.empty()) {  // fill the column of a light entry up with mass of a heavy one
    ticker.tick();
    const auto i = static_cast<std::size_t>(light.back());
    const auto j = static_cast<std::size_t>(heavy.back());
    light.pop_back();
    entries_[i] = {mass[i], static_cast<Index>(j)};
    mass[j] -= 1 - mass[i];
    if (mass[j] < 1) {
      light.push_back(static_cast<Index>(j));
      heavy.pop_back();
    }
  }
  // Only one kind is left over, with a mean mass of 1 but for roundings (n·2^-53 at most): light ones, each below 1, are all
  // near 1. So no entry of weight 0 is among them.
  for (const auto* left : {&heavy, &light}) {
    for (const Index i : *left) entries_[static_cast<std::size_t>(i)] = {1, i};
  }
}

namespace {

/// Density 1/r² where the radii, given in ascending order, differ by more than rejection of uniform points bears: these would
/// be drawn (r_max/r_min)² times. So the triangle is cut where r is 2, 4, 8, … times its minimum. A band [s, 2s] is chosen by
/// area/s², the level line in it by area, and kept with probability (s/r)² ≥ 1/4.
class BandedTriangle {
 public:
  explicit BandedTriangle(const std::array<double, 3>& radii) : r_(radii) {
    double weight = 1;
    for (double low = r_[0]; low < r_[2]; low *= 2, weight /= 4) {
      const bool last = num_bands_ + 1 == kMaxBands || 2 * low >= r_[2];
      Band& band = bands_[num_bands_++];
      band = {low, share_below(low), last ? 1.0 : share_below(2 * low), 0};
      total_ += weight * (band.share_end - band.share_begin);
      band.weight_up_to = total_;
      if (last) break;
    }
  }

  Vec3 draw(Rng& rng) const {
    for (;;) {
      const double choice = rng.uniform() * total_;
      std::size_t k = 0;
      while (k + 1 < num_bands_ && choice >= bands_[k].weight_up_to) ++k;
      const Band& band = bands_[k];
      const double r = level(band.share_begin + rng.uniform() * (band.share_end - band.share_begin));
      if (rng.uniform() * r * r < band.low * band.low) return on_level(r, rng.uniform());
    }
  }

 private:
  /// The last band takes all the rest: it comes up with a chance of 4^-31.
  static constexpr std::size_t kMaxBands = 32;
  struct Band {
    double low;
    double share_begin, share_end;  ///< of the triangle's area, from the corner of smallest radius on
    double weight_up_to;
  };

  /// Share of the area where the radius is below r: two similar triangles, cut by the level line of the middle corner.
  double share_below(double r) const {
    if (r <= r_[0]) return 0;
    if (r <= r_[1]) return (r - r_[0]) / (r_[1] - r_[0]) * ((r - r_[0]) / (r_[2] - r_[0]));
    return 1 - (r_[2] - r) / (r_[2] - r_[1]) * ((r_[2] - r) / (r_[2] - r_[0]));
  }

  /// The inverse of share_below.
  double level(double share) const {
    const double span = r_[2] - r_[0];
    const double r = share * span <= r_[1] - r_[0] ? r_[0] + std::sqrt(share * (r_[1] - r_[0]) * span)
                                                   : r_[2] - std::sqrt((1 - share) * (r_[2] - r_[1]) * span);
    return std::min(std::max(r, r_[0]), r_[2]);
  }

  /// The point at `along` ∈ [0, 1) of the level line of r.
  Vec3 on_level(double r, double along) const {
    const auto between = [&](int from, int to) {
      const auto low = r_[static_cast<std::size_t>(from)], high = r_[static_cast<std::size_t>(to)];
      const double t = high > low ? std::min(std::max((r - low) / (high - low), 0.0), 1.0) : 0.0;
      Vec3 b = Vec3::Zero();
      b[from] = 1 - t;
      b[to] = t;
      return b;
    };
    const Vec3 a = between(0, 2), b = r <= r_[1] ? between(0, 1) : between(1, 2);
    return (1 - along) * a + along * b;
  }

  std::array<double, 3> r_;
  std::array<Band, kMaxBands> bands_;
  std::size_t num_bands_ = 0;
  double total_ = 0;
};

}  // namespace

Vec3 density_barycentric(const std::array<double, 3>& radii, Rng& rng) {
  std::array<std::size_t, 3> order = {0, 1, 2};
  const auto sort_two = [&](std::size_t i, std::size_t j) {
    if (radii[order[i]] > radii[order[j]]) std::swap(order[i], order[j]);
  };
  sort_two(0, 1);
  sort_two(1, 2);
  sort_two(0, 1);
  const double min = radii[order[0]], max = radii[order[2]];
  if (max <= 2 * min) {  // most pieces: every fourth point is kept, or more
    for (;;) {
      const Vec3 b = uniform_barycentric(rng);
      const double r = b[0] * radii[0] + b[1] * radii[1] + b[2] * radii[2];
      if (rng.uniform() * r * r < min * min) return b;
    }
  }
  const Vec3 sorted = BandedTriangle({min, radii[order[1]], max}).draw(rng);
  Vec3 b;
  for (std::size_t k = 0; k < 3; ++k) b[static_cast<int>(order[k])] = sorted[static_cast<int>(k)];
  return b;
}

namespace {

std::vector<double> dart_weights(const WantedRadii& radii, const Execution& execution) {
  std::vector<double> result(radii.field().num_pieces());
  for_each_index_on_all_threads(result.size(), execution,
                                [&](std::size_t i) { result[i] = radii.field().density_integral(i); });
  return result;
}

AliasTable dart_table(const std::vector<double>& areas, const WantedRadii& radii, const Execution& execution) {
  if (radii.constant()) return AliasTable(areas, execution);
  const std::vector<double> weights = dart_weights(radii, execution.part(0, 0.5));
  return AliasTable(weights, execution.part(0.5, 1));
}

}  // namespace

SurfaceDarts::SurfaceDarts(const MeshView& mesh, const std::vector<double>& areas, const WantedRadii& radii,
                           const Execution& execution)
    : mesh_(mesh), radii_(radii), table_(dart_table(areas, radii, execution)) {}

int SurfaceDarts::draws_per_dart() const {
  constexpr int kOfTable = 2, kOfTriangle = 2;
  return radii_.constant() ? kOfTable + kOfTriangle : 0;
}

void SurfaceDarts::draw(Rng& rng, std::size_t count, Sample* darts, Rng* after) const {
  draft(rng, count, darts, after);
  finish(count, darts);
}

void SurfaceDarts::draft(Rng& rng, std::size_t count, Sample* darts, Rng* after) const {
  std::array<AliasTable::Throw, kMostAtOnce> thrown;
  if (radii_.constant()) {
    for (std::size_t k = 0; k < count; ++k) {
      thrown[k] = table_.throw_at(rng);
      darts[k].at.barycentric = uniform_barycentric(rng);
      after[k] = rng;
    }
    for (std::size_t k = 0; k < count; ++k) darts[k].at.facet = table_.pick(thrown[k]);
    return;
  }
  // How many random numbers a dart takes depends on what it reads. Mostly it is so many: what they would read is fetched.
  constexpr int kOfTriangle = 3;
  const SizingField& field = radii_.field();
  Rng guess = rng;
  for (std::size_t k = 0; k < count; ++k) {
    thrown[k] = table_.throw_at(guess);
    for (int i = 0; i < kOfTriangle; ++i) guess.next();
  }
  for (std::size_t k = 0; k < count; ++k) SizingFieldAccess::prefetch_piece(field, table_.pick(thrown[k]));
  for (std::size_t k = 0; k < count; ++k) {
    darts[k].at.facet = table_.pick(rng);
    darts[k].at.barycentric = density_barycentric(field.piece(slot(darts[k].at.facet)).radii, rng);
    after[k] = rng;
  }
}

void SurfaceDarts::finish(std::size_t count, Sample* darts) const {
  if (!radii_.constant()) {
    for (std::size_t k = 0; k < count; ++k) {
      const SizingField::Piece piece = radii_.field().piece(slot(darts[k].at.facet));
      const Vec3& b = darts[k].at.barycentric;
      darts[k].at.barycentric = b[0] * piece.corners[0] + b[1] * piece.corners[1] + b[2] * piece.corners[2];
      darts[k].at.facet = piece.facet;
    }
  }
  for (std::size_t k = 0; k < count; ++k) prefetch(mesh_.triangles.address(darts[k].at.facet));
  for (std::size_t k = 0; k < count; ++k) {
    for (int c = 0; c < 3; ++c) prefetch(mesh_.vertices.address(mesh_.triangles(darts[k].at.facet, c)));
  }
  for (std::size_t k = 0; k < count; ++k) {
    darts[k].at = surface_point_at(mesh_, darts[k].at.facet, darts[k].at.barycentric);
    darts[k].radius = radii_.at(darts[k].at);
  }
}

Sample SurfaceDarts::draw(Rng& rng) const {
  Sample dart;
  Rng after = rng;
  draw(rng, 1, &dart, &after);
  return dart;
}

}  // namespace amps::detail
