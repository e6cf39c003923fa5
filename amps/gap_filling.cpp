#define AMPS_OWN_SOURCE
#include "amps/gap_filling.h"

#include "amps/predicates.h"
#include "amps/spatial_sort.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace amps::detail {
namespace {

/// A dart in a gap is thrown again when rounding puts it too close to a sample; so often before the slack below is used.
constexpr int kGapDarts = 64;
/// Relative distance by which such a dart may be too close: a tenth of what the certificate allows.
constexpr double kSeparationSlack = 1e-10;

/// Gaps are chosen among those in the cells of so many samples at a time, along a curve in space: where gap filling works,
/// memory is at hand (two thirds of the time at a million samples, measured with stretches of 16,384 fragments). The paper
/// chooses among all gaps. Stretches that do not touch do not see each other, so it does not matter which comes first, and
/// within one choice is in proportion to ρ × area; only near where two of them meet, each some 90 by 90 samples, is the order
/// another. Stretches of 80 samples make 0.07 % more samples, of 300 samples 0.04 %, of these none that could be measured
/// (tests/bench/README.md). They are of samples, not of fragments: on a fine mesh so many fragments are the cells of few.
constexpr std::size_t kSitesAtATime = 8192;

/// So many darts in a row are left out for the density's sake; the next one stays. That is for radii that grow a thousandfold
/// and more across a gap; elsewhere a few in a row are.
constexpr int kMostThinned = 4096;

/// Samples are entered together up to so many, of as many gaps in the stretch for each, so that few darts meet a sample of
/// their own batch: the more, the more can be found side by side, and the more of them are near each other.
constexpr Index kMostTogether = 64;
constexpr Index kGapsPerSample = 8;

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

Index SumTree::pick(double u) const {
  std::size_t at = 1;
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

bool GapFiller::has_gaps() const {
  return std::any_of(stretches_.begin(), stretches_.end(), [](const Stretch& stretch) { return stretch.gaps.total() > 0; });
}

double GapFiller::total_weight() const {
  double total = 0;
  for (const Stretch& stretch : stretches_) total += stretch.gaps.total();
  return total;
}

/// A fragment gets its place when it first has a gap; and another one when its slot, used again, holds a new gap elsewhere.
void GapFiller::set_weight(Index f, double weight) {
  const bool has_gap = weight > 0;
  if (slot(f) >= place_of_.size()) {
    if (!has_gap) return;
    place_of_.resize(std::max(slot(diagram_.fragment_capacity()), slot(f) + 1));
  }
  Place& place = place_of_[slot(f)];
  if (place.stretch != current_ && has_gap &&
      (place.at == kNone || stretches_[slot(place.stretch)].gaps.weight(place.at) == 0)) {
    Stretch& stretch = stretches_[slot(current_)];
    place = {current_, static_cast<Index>(stretch.fragment_at.size())};
    stretch.fragment_at.push_back(f);
  }
  if (place.at == kNone) return;
  Stretch& stretch = stretches_[slot(place.stretch)];
  stretch.num_gaps += static_cast<Index>(has_gap) - static_cast<Index>(stretch.gaps.weight(place.at) > 0);
  stretch.gaps.set(place.at, weight);
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
  // Gaps are found in the order of the diagram's memory, and entered in that of the curve.
  std::vector<double> weights = all_weights(execution.part(0.25, 0.85));
  const std::size_t n = weights.size(), num_stretches = std::max<std::size_t>(1, order.size() / kSitesAtATime);
  stretches_.resize(num_stretches);
  for_each_piece(order.size(), kElementsPerLook, execution.part(0.85, 0.95), [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      current_ = static_cast<Index>(k * num_stretches / order.size());
      for (Index f = diagram_.first_of_site(sites[slot(order[k])]); f != kNone; f = diagram_.next_of_site(f)) {
        set_weight(f, std::exchange(weights[slot(f)], 0.0));
      }
    }
  });
  // What is left are facets that no sample reaches.
  for_each_piece(n, kElementsPerLook, execution.part(0.95, 1), [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      if (weights[f] > 0) set_weight(static_cast<Index>(f), weights[f]);
    }
  });
}

/// By slot of a fragment.
std::vector<double> GapFiller::all_weights(const Execution& execution) const {
  const auto n = slot(diagram_.fragment_capacity());
  std::vector<double> weights(n, 0.0);
  constexpr std::size_t kFragmentsPerPiece = 4096;
  for_each_piece_on_all_threads(n, kFragmentsPerPiece, execution, [&](std::size_t begin, std::size_t end) {
    FragmentGap gap;
    for (std::size_t f = begin; f < end; ++f) {
      if (diagram_.alive(static_cast<Index>(f))) weights[f] = gap_weight(static_cast<Index>(f), gap);
    }
  });
  return weights;
}

void GapFiller::look_at(const std::vector<Index>& fragments) {
  for (const Index f : fragments) refresh(f);
}

void GapFiller::forget() {
  for (Stretch& stretch : stretches_) {
    for (std::size_t at = 0; at < stretch.fragment_at.size(); ++at) {
      stretch.gaps.set(static_cast<Index>(at), 0.0);
      place_of_[slot(stretch.fragment_at[at])] = {};
    }
    stretch.fragment_at.clear();
    stretch.num_gaps = 0;
  }
  stretches_.resize(1);
  current_ = 0;
}

/// Of the gap of f: its area, times the greatest density there. `gap` is scratch.
double GapFiller::gap_weight(Index f, FragmentGap& gap) const {
  if (!diagram_.alive(f) || surely_covered(f)) return 0;
  const auto polygon = diagram_.polygon(f);
  const double area = gap.assign(diagram_, polygon);
  return area > 0 ? area * greatest_density(polygon.facet, gap) : 0;
}

bool GapFiller::surely_covered(Index f) const {
  const double reach = diagram_.reach(f);
  if (radii_.uniform() && !disks_.knows_surface()) return reach <= radii_.min();
  if (!std::isfinite(reach)) return false;
  return reach * reach <= diagram_.site(diagram_.polygon(f).site).w;
}

/// The greatest ρ in the gap, in units of its greatest value on the surface: that at a corner of the gap, exactly so where the
/// field is linear. Above the square of rounding, so that no gap goes unseen.
double GapFiller::greatest_density(Index facet, const FragmentGap& gap) const {
  if (radii_.one_density()) return 1;
  double greatest = 0;
  for (std::size_t k = 0; k < gap.num_corners(); ++k) {
    greatest = std::max(greatest, radii_.relative_density(surface_point_below(diagram_.mesh(), facet, gap.corner(k))));
  }
  return greatest;
}

/// Without enter_sites, `enter` enters samples into the diagram, one at a time.
GapFilling GapFiller::fill(Rng& rng, const GapFillLimits& limits, const Enter& enter, const EnterSites* enter_sites) {
  GapFilling result;
  const double at_start = limits.execution != nullptr ? total_weight() : 0;
  double done = 0;  // the greatest ρ of what is left of a fragment, by rounding, may rise
  std::uint64_t darts = 0;
  int thinned = 0;
  std::vector<WeightedPoint> sites;
  std::vector<Index> near;
  for (current_ = 0; has_gaps(); current_ = (current_ + 1) % static_cast<Index>(stretches_.size())) {
    const Stretch& stretch = stretches_[slot(current_)];
    while (stretch.gaps.total() > 0) {
      const Index together =
          enter_sites != nullptr ? std::clamp<Index>(stretch.num_gaps / kGapsPerSample, 1, kMostTogether) : Index{1};
      sites.clear();
      near.clear();
      for (Index k = 0; k < together && stretch.gaps.total() > 0; ++k) {
        if (limits.execution != nullptr && darts++ % kGapsPerReport == 0) {
          done = std::max(done, 1 - std::min(1.0, total_weight() / at_start));
          if (!completes([&] { limits.execution->report(done); })) result.end = GapFilling::End::kCancelled;
        }
        if (result.samples == limits.max_samples) result.end = GapFilling::End::kGaveUp;
        if (result.end != GapFilling::End::kFilled) break;
        const Index place = stretch.gaps.pick(rng.uniform()), f = stretch.fragment_at[slot(place)];
        Sample sample;
        switch (throw_darts_into(f, thinned == kMostThinned ? 0.0 : stretch.gaps.weight(place), rng, sample)) {
          case Dart::kStays:
            thinned = 0;
            ++result.samples;
            near.push_back(diagram_.polygon(f).site);
            sites.push_back(
                {sample.position().x(), sample.position().y(), sample.position().z(), sample.radius * sample.radius});
            enter(sample, near.back());
            break;
          case Dart::kNoRoom:
            ++result.unfilled;
            set_weight(f, 0.0);
            break;
          case Dart::kThinned:
            ++thinned;
            break;
          case Dart::kTaken:
            break;
        }
      }
      if (!sites.empty()) {
        if (enter_sites != nullptr) (*enter_sites)(sites, near);
        look_at(diagram_.changed());
      }
      if (result.end != GapFilling::End::kFilled) return result;
    }
  }
  return result;
}

/// A gap is chosen by `weight`, its area times a bound of ρ, and darts in it are uniform: what is more than ρ is left out, and
/// a gap chosen anew (kThinned). With weight 0 nothing is. kTaken: a sample that is in the disks, not in the diagram yet,
/// covers the dart. kNoRoom: the gap of f holds no double at the wanted distance.
GapFiller::Dart GapFiller::throw_darts_into(Index f, double weight, Rng& rng, Sample& sample) {
  const auto polygon = diagram_.polygon(f);
  const double area = gap_.assign(diagram_, polygon);
  for (int dart = 0; dart < kGapDarts; ++dart) {
    sample.at = surface_point_below(diagram_.mesh(), polygon.facet, gap_.sample(rng));
    if (!sample.position().allFinite()) continue;
    if (!radii_.one_density() && rng.uniform() * weight >= area * radii_.relative_density(sample.at)) return Dart::kThinned;
    const Index covers = disks_.covering_sample(sample.at);
    if (covers >= diagram_.num_sites()) return Dart::kTaken;
    const bool is_last = dart + 1 == kGapDarts;
    // The sample found may be another one, that covers by rounding what is taken.
    if (is_last && covers != kNone && disks_.is_covered_from(diagram_.num_sites(), sample.at)) return Dart::kTaken;
    if (!is_free(sample.at, covers, polygon, is_last ? kSeparationSlack : 0.0)) continue;
    sample.radius = disks_.lowered_radius(sample.at, radii_.at(sample.at), radii_);
    return Dart::kStays;
  }
  return Dart::kNoRoom;
}

/// Rounding may move a point of the gap into a ball: the doubles themselves are tested, exactly unless slack is given. (A gap
/// lies in no ball, whatever the conflict rule.) `covers`: a sample that covers it, if any.
bool GapFiller::is_free(const SurfacePoint& at, Index covers, const RestrictedPowerDiagram::Polygon& polygon,
                        double slack) const {
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
