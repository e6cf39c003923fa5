#define AMPS_OWN_SOURCE
#include "amps/gap_filling.h"

#include "amps/predicates.h"
#include "amps/spatial_sort.h"
#include "amps/thread_pool.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>

namespace amps::detail {
namespace {

/// A dart in a gap is thrown again when rounding puts it too close to a sample; so often before the slack below is used.
constexpr int kGapDarts = 64;
/// Relative distance by which such a dart may be too close: a tenth of what the certificate allows.
constexpr double kSeparationSlack = 1e-10;

/// Gaps are chosen among those in the cells of so many samples at a time, along a curve in space: where gap filling works,
/// memory is at hand (two thirds of the time at a million samples; two stretches take turns, and a tenth more of it if each is
/// twice as long). The paper chooses among all gaps. Stretches that do not touch do not see each other, so it does not matter
/// which comes first, and within one choice is in proportion to ρ × area; only near where two of them meet, each some 64 by 64
/// samples, is the order another. Stretches of 80 samples make 0.07 % more samples, of 300 samples 0.04 %, of 8,192 none that
/// could be measured (tests/bench/README.md). They are of samples, not of fragments: on a fine mesh so many fragments are the
/// cells of few.
constexpr std::size_t kSitesAtATime = 4096;
/// So many samples are worth two stretches.
constexpr std::size_t kSitesOfTwo = 2048;

/// So many darts in a row are left out for the density's sake; the next one stays. That is for radii that grow a thousandfold
/// and more across a gap; elsewhere a few in a row are.
constexpr int kMostThinned = 4096;

/// Samples are entered together up to so many, one of so many gaps in the stretch, so that few darts meet a sample of their own
/// batch, and few of its cells each other: one in twenty. The more, the less threads wait for each other.
constexpr Index kMostTogether = 128;
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
  add_up();
}

void SumTree::assign(const std::vector<double>& weights) {
  nodes_.clear();
  leaves_ = 0;
  if (weights.empty()) return;
  grow(weights.size());
  std::copy(weights.begin(), weights.end(), nodes_.begin() + static_cast<std::ptrdiff_t>(leaves_));
  add_up();
}

/// All sums from the leaves.
void SumTree::add_up() {
  for (std::size_t at = leaves_ - 1; at > 0; --at) nodes_[at] = nodes_[2 * at] + nodes_[2 * at + 1];
}

bool GapFiller::has_gaps() const {
  return std::any_of(stretches_.begin(), stretches_.end(), [](const Stretch& stretch) { return stretch.gaps.total() > 0; });
}

bool GapFiller::has_gap_in(const std::vector<Index>& fragments) {
  return std::any_of(fragments.begin(), fragments.end(), [this](Index f) { return gap_weight(f, gap_) > 0; });
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
    const std::size_t wanted = std::max(slot(diagram_.fragment_capacity()), slot(f) + 1);
    if (wanted > place_of_.capacity()) place_of_.reserve(wanted + wanted / 8);  // doubled, it would take megabytes
    place_of_.resize(wanted);
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
  const std::size_t n = weights.size(), num_sites = order.size();
  // At least two, which take turns, where one would be of some size.
  const std::size_t num_stretches = std::max<std::size_t>(num_sites / kSitesAtATime, num_sites < kSitesOfTwo ? 1 : 2);
  stretches_.resize(num_stretches);
  place_of_.reserve(room_for_more(n));
  place_of_.resize(n);
  std::vector<double> of_stretch;
  for_each_piece(num_stretches, 1, execution.part(0.85, 0.95), [&](std::size_t i, std::size_t) {
    current_ = static_cast<Index>(i);
    Stretch& stretch = stretches_[i];
    of_stretch.clear();
    for (std::size_t k = i * num_sites / num_stretches; k < (i + 1) * num_sites / num_stretches; ++k) {
      for (Index f = diagram_.first_of_site(sites[slot(order[k])]); f != kNone; f = diagram_.next_of_site(f)) {
        const double weight = std::exchange(weights[slot(f)], 0.0);
        if (!(weight > 0)) continue;
        place_of_[slot(f)] = {current_, static_cast<Index>(of_stretch.size())};
        stretch.fragment_at.push_back(f);
        of_stretch.push_back(weight);
      }
    }
    stretch.num_gaps = static_cast<Index>(of_stretch.size());
    stretch.gaps.assign(of_stretch);
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
  return !diagram_.alive(f) || surely_covered(f) ? 0.0 : gap_weight(diagram_.polygon(f), gap);
}

double GapFiller::gap_weight(const RestrictedPowerDiagram::Polygon& polygon, FragmentGap& gap) const {
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

GapFiller::Run GapFiller::start(Rng& rng, const GapFillLimits& limits) const {
  Run run{rng, limits, {}};
  if (limits.execution != nullptr) run.at_start = total_weight();
  return run;
}

/// Is there time and room for one more?
bool GapFiller::goes_on(Run& run) const {
  if (run.limits.execution != nullptr && run.gaps++ % kGapsPerReport == 0) {
    // The greatest ρ of what is left of a fragment, by rounding, may rise.
    run.done = std::max(run.done, 1 - std::min(1.0, total_weight() / run.at_start));
    if (!completes([&] { run.limits.execution->report(run.done); })) run.result.end = GapFilling::End::kCancelled;
  }
  if (run.result.samples == run.limits.max_samples) run.result.end = GapFilling::End::kGaveUp;
  return run.result.end == GapFilling::End::kFilled;
}

/// Chooses a gap of the stretch, and throws darts into it. True if one stays: a sample. `near`: whose the gap was.
bool GapFiller::draw_sample(Run& run, Index stretch, Sample& sample, Index& near) {
  const Stretch& from = stretches_[slot(stretch)];
  const Index place = from.gaps.pick(run.rng.uniform()), f = from.fragment_at[slot(place)];
  switch (throw_darts_into(f, run.thinned == kMostThinned ? 0.0 : from.gaps.weight(place), run.rng, sample)) {
    case Dart::kStays:
      run.thinned = 0;
      ++run.result.samples;
      near = diagram_.polygon(f).site;
      return true;
    case Dart::kNoRoom:
      ++run.result.unfilled;
      set_weight(f, 0.0);
      break;
    case Dart::kThinned:
      ++run.thinned;
      break;
    case Dart::kTaken:
      break;
  }
  return false;
}

GapFilling GapFiller::fill(Rng& rng, const GapFillLimits& limits, const Enter& enter) {
  Run run = start(rng, limits);
  for (current_ = 0; has_gaps(); current_ = (current_ + 1) % static_cast<Index>(stretches_.size())) {
    while (has_gaps(current_)) {
      if (!goes_on(run)) return run.result;
      Sample sample;
      Index near = kNone;
      if (!draw_sample(run, current_, sample, near)) continue;
      enter(sample, near);
      look_at(diagram_.changed());
    }
  }
  return run.result;
}

/// Two stretches take turns. While the cells of samples of the one are found, samples of the other are drawn, which do not see
/// each other but where the two meet. A stretch whose gaps have become few leaves them to the next one.
class GapFiller::Turns {
 public:
  explicit Turns(GapFiller& filler) : filler_(filler), num_stretches_(static_cast<Index>(filler.stretches_.size())) {
    num_begun_ = std::min<Index>(2, num_stretches_);
    if (num_begun_ == 2) stretch_[1] = 1;
  }

  /// The stretch whose turn it is, the other one than last time, if it has gaps; else, where `again` allows it, the same.
  /// kNone: there is none.
  Index next(bool again) {
    const std::size_t turn = 1 - last_;
    if (fill_up(turn)) {
      last_ = turn;
      return stretch_[turn];
    }
    return again && fill_up(last_) ? stretch_[last_] : kNone;
  }

 private:
  bool fill_up(std::size_t turn) {
    constexpr Index kFewGaps = kGapsPerSample * kMostTogether;
    Index& stretch = stretch_[turn];
    if (stretch == kNone) return false;
    while (num_begun_ < num_stretches_ && filler_.stretches_[slot(stretch)].num_gaps < kFewGaps) {
      filler_.move_gaps(stretch, num_begun_);
      stretch = num_begun_++;
    }
    return filler_.has_gaps(stretch);
  }

  GapFiller& filler_;
  const Index num_stretches_;
  Index num_begun_;
  std::array<Index, 2> stretch_{0, kNone};
  std::size_t last_ = 1;
};

GapFilling GapFiller::fill_together(Rng& rng, const GapFillLimits& limits, const Enter& enter, const EnterSites& enter_sites) {
  Run run = start(rng, limits);
  ScratchPool<FragmentGap> gaps;
  const auto measure = [&](const std::vector<RestrictedPowerDiagram::Polygon>& polygons, std::vector<double>& weights) {
    const auto gap = gaps.lend([] { return std::make_unique<FragmentGap>(); });
    for (const auto& polygon : polygons) weights.push_back(gap_weight(polygon, *gap));
  };
  Turns turns(*this);
  Arrivals now, next;
  Index stretch = kNone, other = kNone;  // what these are drawn from
  Index unseen = kNone;                  // the stretch of samples whose changes have not been looked at
  const auto is_over = [&] { return run.result.end != GapFilling::End::kFilled; };
  const auto see_changes = [&] {
    if (unseen == kNone) return;
    current_ = std::exchange(unseen, kNone);
    enter_changes();
  };
  for (;;) {
    if (now.empty()) {
      see_changes();
      stretch = is_over() ? kNone : turns.next(true);
      if (stretch == kNone) return run.result;
      draw_samples(run, stretch, enter, now);
      if (now.empty()) continue;
    }
    const auto draw_others = [&] {
      see_changes();
      other = is_over() ? kNone : turns.next(false);
      if (other != kNone) draw_samples(run, other, enter, next);
    };
    enter_sites(now, next, draw_others, measure);
    unseen = stretch;
    now.clear();
    std::swap(now, next);
    if (other != kNone) stretch = other;
  }
}

void GapFiller::draw_samples(Run& run, Index stretch, const Enter& enter, Arrivals& drawn) {
  const Stretch& from = stretches_[slot(stretch)];
  const Index count = std::clamp<Index>(from.num_gaps / kGapsPerSample, 1, kMostTogether);
  for (Index k = 0; k < count && has_gaps(stretch) && goes_on(run); ++k) {
    Sample sample;
    Index near = kNone;
    if (!draw_sample(run, stretch, sample, near)) continue;
    enter(sample, near);
    drawn.add({sample.position().x(), sample.position().y(), sample.position().z(), sample.radius * sample.radius}, near);
  }
}

/// What is left of one stretch becomes part of another.
void GapFiller::move_gaps(Index from, Index to) {
  Stretch left = std::exchange(stretches_[slot(from)], {});
  current_ = to;
  for (std::size_t at = 0; at < left.fragment_at.size(); ++at) {
    const double weight = left.gaps.weight(static_cast<Index>(at));
    const Index f = left.fragment_at[at];
    Place& place = place_of_[slot(f)];
    if (place.stretch != from || slot(place.at) != at) continue;  // used again elsewhere
    place = {};
    if (weight > 0) set_weight(f, weight);
  }
}

/// Looks at what has changed, where that has not been measured.
void GapFiller::enter_changes() {
  const std::vector<Index>& changed = diagram_.changed();
  for (std::size_t k = 0; k < changed.size(); ++k) {
    const double weight = diagram_.measured()[k];
    set_weight(changed[k], std::isnan(weight) ? gap_weight(changed[k], gap_) : weight);
  }
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
