#define AMPS_OWN_SOURCE
#include "amps/topology_refinement.h"

#include <algorithm>

namespace amps::detail {
namespace {

// Shares of the radius that is there, after a failure. Smaller steps take more rounds, larger ones more samples.
constexpr double kCellShare = 0.75;
constexpr double kCurveShare = 0.8;
constexpr double kSharedShare = 0.85;
/// After so many rounds steps become larger: what holds out so long is no matter of a few samples.
constexpr int kPatientRounds = 6;
/// Of the wanted radius; below it nothing is lowered: what is left is no matter of scale.
constexpr double kRefinementFloor = 1.0 / 1024;

}  // namespace

TopologySamples topology_samples(const DiskSet& disks, const CurveGraph* graph, const CurveSamples* curves) {
  TopologySamples samples;
  samples.place = [&disks](Index s) { return disks.sample(s).at; };
  if (curves == nullptr || graph == nullptr) return samples;
  samples.curve_of_edge = &graph->curve_of_edge;
  samples.may_own = [graph, curves](Index s, Index c) {
    if (slot(s) >= curves->samples.size()) return false;
    const CurveSample& sample = curves->samples[slot(s)];
    if (sample.corner == kNone) return sample.curve == c;
    const Curve& curve = graph->curves[slot(c)];
    return curve.first_corner == sample.corner || curve.last_corner == sample.corner;
  };
  return samples;
}

std::vector<Index> samples_of(const TopologyFailure& failure) {
  std::vector<Index> result;
  const bool of_curve = failure.kind == TopologyFailureKind::kForeignCurve;
  for (const Index s : {failure.sample, of_curve ? kNone : failure.other, failure.third}) {
    if (s != kNone) result.push_back(s);
  }
  return result;
}

bool RefinementCaps::lower(const TopologyCertificate& certificate, const DiskSet& disks, const CurveSamples* curves,
                           const WantedRadii& wanted) {
  struct Lowered {
    Index sample;
    double share;
    bool operator<(const Lowered& b) const { return sample != b.sample ? sample < b.sample : share < b.share; }
  };
  std::vector<Lowered> lowered;
  const auto stays = [curves](Index s) {
    return curves != nullptr && slot(s) < curves->samples.size() && curves->samples[slot(s)].tip;
  };
  const auto add = [&](Index sample, double share) {
    if (sample != kNone && !stays(sample)) lowered.push_back({sample, share});
  };
  for (const TopologyFailure& failure : certificate.failures) {
    switch (failure.kind) {
      case TopologyFailureKind::kSharedEdge:
      case TopologyFailureKind::kEdgeAtCurves:
      case TopologyFailureKind::kTriple:
        for (const Index s : {failure.sample, failure.other, failure.third}) add(s, kSharedShare);
        break;
      case TopologyFailureKind::kCurve:
        add(failure.sample, kCurveShare);
        break;
      case TopologyFailureKind::kForeignCurve:
        add(failure.sample, kCurveShare);
        // Whose chord bulges so far that the sample owns a part of the curve.
        if (curves != nullptr) {
          const Sample& owner = disks.sample(failure.sample);
          const auto add_near = [&](std::size_t first, std::size_t end) {
            for (std::size_t s = first; s < end; ++s) {
              const Sample& near = curves->samples[s].sample;
              const double reach = owner.radius + near.radius;
              if (squared_norm(near.position() - owner.position()) < reach * reach) add(static_cast<Index>(s), kCurveShare);
            }
          };
          const auto place = [&](auto is_before) {
            const auto found = std::partition_point(curves->samples.begin(), curves->samples.end(), is_before);
            return static_cast<std::size_t>(found - curves->samples.begin());
          };
          // Corners come first, then curve by curve.
          add_near(0, place([](const CurveSample& s) { return s.corner != kNone; }));
          add_near(place([&](const CurveSample& s) { return s.corner != kNone || s.curve < failure.other; }),
                   place([&](const CurveSample& s) { return s.corner != kNone || s.curve <= failure.other; }));
        }
        break;
      default:
        add(failure.sample, kCellShare);
    }
  }
  std::sort(lowered.begin(), lowered.end());
  num_before_ = caps_.size();
  const int steps = 1 + rounds_++ / kPatientRounds;
  for (std::size_t k = 0; k < lowered.size(); ++k) {
    if (k > 0 && lowered[k].sample == lowered[k - 1].sample) continue;  // the least share comes first
    const Sample& sample = disks.sample(lowered[k].sample);
    if (sample.radius <= kRefinementFloor * wanted.at(sample.at)) continue;
    double radius = sample.radius;
    for (int step = 0; step < steps; ++step) radius *= lowered[k].share;
    caps_.push_back({sample.position(), radius});
  }
  return caps_.size() > num_before_;
}

RefinedSet::RefinedSet(RestrictedPowerDiagram& diagram, DiskSet& disks, Index num_fixed, Index num_darts)
    : diagram_(diagram), disks_(disks), num_darts_(num_darts) {
  origin_.assign(slot(diagram.num_sites()), Origin::kGap);
  std::fill(origin_.begin(), origin_.begin() + num_fixed, Origin::kCurve);
  std::fill(origin_.begin() + num_fixed, origin_.begin() + num_fixed + num_darts, Origin::kDart);
}

void RefinedSet::note_changed() {
  changed_.insert(changed_.end(), diagram_.changed_sites().begin(), diagram_.changed_sites().end());
}

void RefinedSet::take_out(Index s, GapFiller& filler) {
  disks_.remove(disks_.sample(s), s);
  diagram_.remove(s);
  disks_.forget_reach(s);
  filler.look_at(diagram_.changed());
  note_changed();
  if (origin_[slot(s)] == Origin::kDart) --num_darts_;
  origin_[slot(s)] = Origin::kNothing;
  free_.push_back(s);
}

void RefinedSet::enter(const Sample& sample, Index near) {
  const double weight = sample.radius * sample.radius;
  if (free_.empty()) {
    disks_.insert(sample, diagram_.num_sites());
    diagram_.insert(sample.position(), weight, near);
    origin_.push_back(Origin::kGap);
  } else {
    const Index s = free_.back();
    free_.pop_back();
    disks_.insert(sample, s);
    diagram_.reinsert(s, sample.position(), weight, near);
    origin_[slot(s)] = Origin::kGap;
  }
  note_changed();
}

void RefinedSet::lower(const CapField& bounds, const WantedRadii& radii, Rng& rng, const Execution& execution) {
  changed_.clear();
  std::vector<Index> too_large;
  Ticker ticker(execution.part(0, 0.2), origin_.size(), kElementsPerLook);
  for (std::size_t s = 0; s < origin_.size(); ++s) {
    ticker.tick();
    if (origin_[s] != Origin::kDart && origin_[s] != Origin::kGap) continue;
    const Sample& sample = disks_.sample(static_cast<Index>(s));
    if (bounds.at(sample.position(), sample.radius) < sample.radius) too_large.push_back(static_cast<Index>(s));
  }
  GapFiller filler(diagram_, disks_, radii);
  if (!too_large.empty() && too_large.size() == origin_.size() - free_.size()) {
    // A diagram has at least one site: one of the new ones comes first.
    const Index facet = disks_.sample(too_large.front()).at.facet;
    Sample first{surface_point_at(diagram_.mesh(), facet, uniform_barycentric(rng)), 0};
    first.radius = radii.at(first.at);
    enter(first, too_large.front());
    filler.look_at(diagram_.changed());
  }
  for (const Index s : too_large) {
    execution.check();
    take_out(s, filler);
  }
  GapFillLimits limits;
  limits.execution = &execution;
  const GapFilling filled = filler.fill(rng, limits, [&](const Sample& sample, Index near) { enter(sample, near); });
  num_unfilled_ += filled.unfilled;
  if (filled.end == GapFilling::End::kCancelled) execution.check();
  std::sort(changed_.begin(), changed_.end());
  changed_.erase(std::unique(changed_.begin(), changed_.end()), changed_.end());
}

GrowingSet RefinedSet::samples() const {
  GrowingSet set;
  set.reserve(origin_.size());
  for (std::size_t s = 0; s < origin_.size(); ++s) set.add(disks_.sample(static_cast<Index>(s)));
  return set;
}

std::vector<FaceSample> RefinedSet::on_faces() const {
  std::vector<FaceSample> result;
  for (std::size_t s = 0; s < origin_.size(); ++s) {
    const bool of_darts = origin_[s] == Origin::kDart;
    if (of_darts || origin_[s] == Origin::kGap) result.push_back({disks_.sample(static_cast<Index>(s)), of_darts});
  }
  std::stable_partition(result.begin(), result.end(), [](const FaceSample& sample) { return sample.of_darts; });
  return result;
}

Index RefinedSet::num_gap_samples() const {
  return static_cast<Index>(std::count(origin_.begin(), origin_.end(), Origin::kGap));
}

bool touches_curves(const CapField& bounds, const CurveSamples* curves) {
  if (curves == nullptr) return false;
  return std::any_of(curves->samples.begin(), curves->samples.end(), [&bounds](const CurveSample& on_curve) {
    const Sample& sample = on_curve.sample;
    return !on_curve.tip && bounds.at(sample.position(), sample.radius) < sample.radius;
  });
}

}  // namespace amps::detail
