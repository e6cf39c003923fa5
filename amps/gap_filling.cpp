#define AMPS_OWN_SOURCE
#include "amps/gap_filling.h"

#include "amps/predicates.h"
#include "amps/spatial_sort.h"

#include <algorithm>
#include <cmath>

namespace amps::detail {
namespace {

/// A dart in a gap is thrown again when rounding puts it too close to a sample; so often before the slack below is used.
constexpr int kGapDarts = 64;
/// Relative distance by which such a dart may be too close: a tenth of what the certificate allows.
constexpr double kSeparationSlack = 1e-10;

/// Gaps are chosen among so many fragments at a time, along a curve in space: where gap filling works, memory is at hand (two
/// thirds of the time at a million samples). The paper chooses among all gaps. Stretches that do not touch do not see each
/// other, so it does not matter which comes first, and within one choice is in proportion to ρ × area; only near where two of
/// them meet, each some 70 by 70 samples, is the order another. That makes no difference to the count of samples; stretches of
/// 1024 make 0.4 % more, and so do stretches scattered in space (tests/bench/README.md).
constexpr std::size_t kFragmentsAtATime = 16384;

/// Gaps between two looks for a cancel: some milliseconds.
constexpr Index kGapsPerReport = 256;

}  // namespace

void SumTree::set(Index i, double weight) {
  if (slot(i) >= leaves_) grow(slot(i) + 1);
  std::size_t at = leaves_ + slot(i);
  if (nodes_[at] == weight) return;
  nodes_[at] = weight;
  for (at /= 2; at > 0; at /= 2) nodes_[at] = nodes_[2 * at] + nodes_[2 * at + 1];
}

Index SumTree::pick(double u, std::size_t stretch) const {
  std::size_t at = 1;
  for (std::size_t span = leaves_; span > stretch; span /= 2) {
    at *= 2;
    if (!(nodes_[at] > 0)) ++at;
  }
  double rest = u * nodes_[at];
  while (at < leaves_) {
    at *= 2;
    // Rounding must not lead into an empty branch.
    if ((rest >= nodes_[at] && nodes_[at + 1] > 0) || !(nodes_[at] > 0)) {
      rest -= nodes_[at];
      ++at;
    }
  }
  return static_cast<Index>(at - leaves_);
}

void SumTree::grow(std::size_t wanted) {
  constexpr std::size_t kFirstLeaves = 64;  // of a local refill, mostly
  std::size_t leaves = std::max(leaves_, kFirstLeaves);
  while (leaves < wanted) leaves *= 2;
  std::vector<double> nodes(2 * leaves, 0.0);
  std::copy(nodes_.begin() + static_cast<std::ptrdiff_t>(leaves_), nodes_.end(),
            nodes.begin() + static_cast<std::ptrdiff_t>(leaves));
  nodes_.swap(nodes);
  leaves_ = leaves;
  for (std::size_t at = leaves_ - 1; at > 0; --at) nodes_[at] = nodes_[2 * at] + nodes_[2 * at + 1];
}

/// Fragments get leaves in the order they are looked at.
Index GapFiller::leaf(Index f) {
  if (slot(f) >= leaf_of_.size()) leaf_of_.resize(std::max(slot(diagram_.fragment_capacity()), slot(f) + 1), kNone);
  Index& result = leaf_of_[slot(f)];
  if (result == kNone) {
    result = static_cast<Index>(fragment_at_.size());
    fragment_at_.push_back(f);
  }
  return result;
}

void GapFiller::look_at_all(const Execution& execution) {
  std::vector<Index> sites;
  std::vector<Vec3> positions;
  sites.reserve(slot(diagram_.num_sites()));
  positions.reserve(sites.capacity());
  for_each_piece(sites.capacity(), kElementsPerLook, execution.part(0, 0.05), [&](std::size_t begin, std::size_t end) {
    for (Index s = static_cast<Index>(begin); s < static_cast<Index>(end); ++s) {
      if (diagram_.removed(s)) continue;
      sites.push_back(s);
      positions.push_back(diagram_.site(s).position());
    }
  });
  const std::vector<Index> order = curve_order(positions, execution.part(0.05, 0.25));
  for_each_piece(order.size(), kElementsPerLook, execution.part(0.25, 0.4), [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      for (Index f = diagram_.first_of_site(sites[slot(order[k])]); f != kNone; f = diagram_.next_of_site(f)) leaf(f);
    }
  });
  gaps_.grow(slot(diagram_.num_fragments()));
  constexpr std::size_t kFragmentsPerPiece = 4096;
  const auto n = slot(diagram_.fragment_capacity());
  for_each_piece(n, kFragmentsPerPiece, execution.part(0.4, 1), [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      if (diagram_.alive(static_cast<Index>(f))) refresh(static_cast<Index>(f));
    }
  });
}

void GapFiller::look_at(const std::vector<Index>& fragments) {
  for (const Index f : fragments) refresh(f);
}

void GapFiller::forget() {
  for (const Index f : fragment_at_) {
    gaps_.set(leaf_of_[slot(f)], 0.0);
    leaf_of_[slot(f)] = kNone;
  }
  fragment_at_.clear();
}

void GapFiller::refresh(Index f) {
  double weight = 0;
  if (diagram_.alive(f) && !surely_covered(f)) {
    const auto polygon = diagram_.polygon(f);
    const double area = gap_.assign(diagram_, polygon);
    if (area > 0) weight = area * relative_density(polygon);
  }
  gaps_.set(leaf(f), weight);
}

bool GapFiller::surely_covered(Index f) const {
  const double reach = diagram_.reach(f);
  if (radii_.uniform() && !disks_.knows_surface()) return reach <= radii_.min();
  if (!std::isfinite(reach)) return false;
  return reach * reach <= diagram_.site(diagram_.polygon(f).site).w;
}

/// ρ in the middle of a fragment, in units of its greatest value. Above the square of rounding, so that no gap goes unseen.
double GapFiller::relative_density(const RestrictedPowerDiagram::Polygon& polygon) const {
  if (radii_.one_density()) return 1;
  Vec3 sum = Vec3::Zero();
  for (Index k = 0; k < polygon.size; ++k) sum += polygon.corners[k];
  return radii_.relative_density(surface_point_below(diagram_.mesh(), polygon.facet, sum / polygon.size));
}

GapFilling GapFiller::fill(Rng& rng, const GapFillLimits& limits, const Enter& enter) {
  GapFilling result;
  const double at_start = gaps_.total();
  double done = 0;  // ρ in the middle of what is left of a fragment may rise
  while (has_gaps()) {
    if (limits.execution != nullptr && (result.samples + result.unfilled) % kGapsPerReport == 0) {
      done = std::max(done, 1 - std::min(1.0, gaps_.total() / at_start));
      if (!completes([&] { limits.execution->report(done); })) {
        result.end = GapFilling::End::kCancelled;
        return result;
      }
    }
    if (result.samples == limits.max_samples) {
      result.end = GapFilling::End::kGaveUp;
      return result;
    }
    const Index at = gaps_.pick(rng.uniform(), kFragmentsAtATime), f = fragment_at_[slot(at)];
    Sample sample;
    if (throw_darts_into(f, rng, sample)) {
      ++result.samples;
      enter(sample, diagram_.polygon(f).site);
      look_at(diagram_.changed());
    } else {
      ++result.unfilled;
      gaps_.set(at, 0.0);
    }
  }
  return result;
}

/// False if the gap of f holds no double at the wanted distance.
bool GapFiller::throw_darts_into(Index f, Rng& rng, Sample& sample) {
  const auto polygon = diagram_.polygon(f);
  gap_.assign(diagram_, polygon);
  for (int dart = 0; dart < kGapDarts; ++dart) {
    sample.at = surface_point_below(diagram_.mesh(), polygon.facet, gap_.sample(rng));
    if (!sample.position().allFinite()) continue;
    if (!is_free(sample.at, polygon, dart + 1 == kGapDarts ? kSeparationSlack : 0.0)) continue;
    sample.radius = disks_.lowered_radius(sample.at, radii_.at(sample.at), radii_);
    return true;
  }
  return false;
}

/// Rounding may move a point of the gap into a ball: the doubles themselves are tested, exactly unless slack is given. (A gap
/// lies in no ball, whatever the conflict rule.)
bool GapFiller::is_free(const SurfacePoint& at, const RestrictedPowerDiagram::Polygon& polygon, double slack) const {
  const Index covers = disks_.covering_sample(at);
  if (covers == kNone) return true;
  if (slack == 0) return false;
  const double shrink = (1 - slack) * (1 - slack);
  const auto is_outside = [&](Index s) {
    const WeightedPoint& site = diagram_.site(s);
    return side_of_ball(at.position.data(), site.position().data(), site.w * shrink) >= 0;
  };
  if (!is_outside(covers) || (polygon.site != kNone && !is_outside(polygon.site))) return false;
  for (Index k = 0; k < polygon.size; ++k) {
    if (RestrictedPowerDiagram::is_site(polygon.labels[k]) && !is_outside(polygon.labels[k])) return false;
  }
  return true;
}

}  // namespace amps::detail
