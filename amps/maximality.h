// maximality.h: the certificate of a sample set — how well its disks cover the surface, how far apart they are, and what they
// leave open.
//
// A fragment of the restricted power diagram is a convex polygon, and a ball is convex: it covers a fragment of its own cell if
// and only if it covers the corners. So gaps are found corner by corner, by the exact sign of the power there; how deep they
// are is measured in doubles.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/curves.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"
#include "amps/samples.h"

#include <iosfwd>
#include <memory>
#include <vector>

namespace amps {

/// Certificate of a sample set, computed from a fresh restricted power diagram.
struct MaximalityReport {
  bool measured = false;            ///< false: nothing is known, as in the report of what was cancelled; it is neither, then
  double worst_coverage = 0;        ///< max over the surface of (distance to the owner)/r, to rounding; maximal: at most 1
  Vec3 worst_point = Vec3::Zero();  ///< where that is; of several places any. Of a facet that no disk reaches, a corner
  double worst_separation = 0;  ///< min over pairs of |p_i − p_j|/max(r_i, r_j); Poisson-disk ⇔ ≥ 1 (−1e-9); +inf: one sample.
                                ///< With ConflictRule::kMin: of |p_i − p_j|/min(r_i, r_j). Over disks that know their surface:
                                ///< of |p_i − p_j|/r_i for p_j in disk i; if there is none, of neighbours that i reaches
  Index gaps = 0;       ///< fragments (restricted cell ∩ facet) that are not covered, decided exactly
  double gap_area = 0;  ///< uncovered area, absolute, in closed form
  /// Without a tolerance: exactly. With one: as if all radii were larger by that share, for sets that come from elsewhere with
  /// rounded numbers.
  bool maximal(double tolerance = 0) const {
    return measured && (gaps == 0 || (tolerance > 0 && worst_coverage <= 1 + tolerance));
  }
  bool poisson_disk(double tolerance = 1e-9) const { return measured && worst_separation >= 1 - tolerance; }
};
/// `curves` (optional): disks end at these, as those of remesh() do (RemeshResult::graph); with Neighborhood::kSurface only.
/// Throws Error(kInvalidArgument) if there is no sample, one is not finite, a radius is not positive, or facets and
/// barycentrics are given but not one a sample; kInvalidMesh; kCancelled, as find_gaps().
AMPS_EXPORT MaximalityReport verify_maximal(const MeshView& mesh, const SampleSet& samples, const Execution& execution = {},
                                            ConflictRule rule = ConflictRule::kMax,
                                            Neighborhood neighborhood = Neighborhood::kSpace,
                                            const CurveGraph* curves = nullptr);
AMPS_EXPORT std::ostream& operator<<(std::ostream& out, const MaximalityReport& report);

/// The uncovered part of the surface as triangles: the gap primitives. Each triangle contains a piece of a gap (and may
/// overlap a disk by its circular segment); their union covers all gaps.
struct GapSet {
  Mesh primitives;            ///< #T triangles, vertices not shared between gaps
  std::vector<Index> facets;  ///< #T, the input facet a primitive lies in
  Index gaps = 0;             ///< uncovered fragments
  double area = 0;            ///< exact uncovered area (less than that of the primitives)
};
AMPS_EXPORT GapSet find_gaps(const MeshView& mesh, const SampleSet& samples, const Execution& execution = {},
                             Neighborhood neighborhood = Neighborhood::kSpace, const CurveGraph* curves = nullptr);

namespace detail {

class DiskSet;

/// Throws what verify_maximal documents.
RestrictedPowerDiagram diagram_of(const MeshView& mesh, const SampleSet& samples, const Execution& execution);
/// The diagram of a set, and its disks where they know their surface (else null).
struct SetDiagram {
  std::shared_ptr<DiskSet> disks;
  RestrictedPowerDiagram diagram;
};
/// `max_radius`: of samples to come; those there are may be larger.
SetDiagram diagram_of(const MeshView& mesh, const SampleSet& samples, Neighborhood neighborhood, double max_radius,
                      const Execution& execution, const CurveGraph* curves = nullptr);
/// Is any point of the surface outside of its owner's disk? Exact.
bool has_gaps(const RestrictedPowerDiagram& diagram, const Execution& execution = {});
/// `disks`: those of the diagram's sites where they know their surface, else null.
MaximalityReport measure_maximality(const RestrictedPowerDiagram& diagram, ConflictRule rule = ConflictRule::kMax,
                                    const Execution& execution = {}, const DiskSet* disks = nullptr);

}  // namespace detail

}  // namespace amps

#include "amps/host_macros_end.h"
