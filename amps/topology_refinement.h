// topology_refinement.h (internal): smaller radii where the dual of a set has not the topology of the surface. Each failure of
// the certificate bounds radii around its samples by a share of what they are now; samples are placed again where that is too
// much, and the certificate is looked at again.
#pragma once

#include "amps/base.h"
#include "amps/cap_field.h"
#include "amps/curve_sampling.h"
#include "amps/curves.h"
#include "amps/disk_set.h"
#include "amps/gap_filling.h"
#include "amps/topology_certificate.h"
#include "amps/wanted_radii.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace amps::detail {

/// Refinement gives up beyond so many samples: at eight times those that there were, and ten thousand more. A small part takes
/// four and more samples where it had one.
inline Index most_refined(Index before) {
  constexpr Index kGrowth = 8, kAdded = 10'000;
  return before > (std::numeric_limits<Index>::max() - kAdded) / kGrowth ? before : kGrowth * before + kAdded;
}

/// What the certificate asks about samples, of which the first ones are those of `curves` (null: there are none). All must
/// outlive the result.
TopologySamples topology_samples(const DiskSet& disks, const CurveGraph* graph, const CurveSamples* curves);

/// Whose cells it is about: up to three, each there is.
std::vector<Index> samples_of(const TopologyFailure& failure);

/// Bounds of radii around what has failed so far. A value.
class RefinementCaps {
 public:
  /// `caps`: bounds that there are already.
  explicit RefinementCaps(std::vector<RadiusCap> caps = {}) : caps_(std::move(caps)), num_before_(caps_.size()) {}

  /// Lowers radii where the certificate fails. False if it does not, or if all samples at failures have come down to the floor:
  /// a thousandth of the wanted radius, which knows of curves.
  bool lower(const TopologyCertificate& certificate, const DiskSet& disks, const CurveSamples* curves,
             const WantedRadii& wanted);

  const std::vector<RadiusCap>& caps() const { return caps_; }
  /// Those of the last time.
  std::vector<RadiusCap> last() const { return {caps_.begin() + static_cast<std::ptrdiff_t>(num_before_), caps_.end()}; }

 private:
  std::vector<RadiusCap> caps_;
  std::size_t num_before_ = 0;
  int rounds_ = 0;
};

/// A maximal set whose radii fall here and there, in its diagram and disks; what lies on curves stays.
class RefinedSet {
 public:
  /// `diagram`, `disks`: of these samples, ids being rows. `num_fixed`: samples on curves, the first ones; `num_darts` follow,
  /// and those of gap filling.
  RefinedSet(RestrictedPowerDiagram& diagram, DiskSet& disks, Index num_fixed, Index num_darts);

  /// Takes out samples on faces with radii above these bounds and fills the gaps. `radii`: wanted now, under these bounds.
  /// Cancelled, it throws, and the set is of no more use.
  void lower(const CapField& bounds, const WantedRadii& radii, Rng& rng, const Execution& execution);

  /// Sites that the last lower() may have changed the cells of, alive or not, ascending.
  const std::vector<Index>& changed() const { return changed_; }
  /// Are all ids in use?
  bool compact() const { return free_.empty(); }
  /// All samples, by id; requires compact().
  GrowingSet samples() const;
  /// Those not on curves: of darts, by id, then the others.
  std::vector<FaceSample> on_faces() const;
  /// How many are left of those of darts; how many gap filling has added in all; gaps that were too small for a double.
  Index num_darts() const { return num_darts_; }
  Index num_gap_samples() const;
  Index num_unfilled() const { return num_unfilled_; }

 private:
  enum class Origin : std::uint8_t { kCurve, kDart, kGap, kNothing };
  void take_out(Index s, GapFiller& filler);
  void enter(const Sample& sample, Index near);
  void note_changed();

  RestrictedPowerDiagram& diagram_;
  DiskSet& disks_;
  std::vector<Origin> origin_;  ///< by id
  std::vector<Index> free_, changed_;
  Index num_darts_ = 0, num_unfilled_ = 0;
};

/// Do these bounds touch the radius of a sample on a curve?
bool touches_curves(const CapField& bounds, const CurveSamples* curves);

}  // namespace amps::detail
