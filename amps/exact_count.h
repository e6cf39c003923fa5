// exact_count.h: what came of meeting a number of samples exactly (SamplingOptions::exact_count). A set that comes near the
// number is edited here and there until it has it, the cheapest edits first:
//   * A few neighbours are taken out and their gap is refilled with one sample more, or fewer. Radii stay as they are wanted,
//     and no gap is left: the set stays maximal. Of the refills tried, the one with the best triangles counts. There is room
//     for that: random maximal sets have 0.70 disks to an area of r², and there are sets from 0.39 to 1.15.
//   * Where that adds none any more, gaps are refilled with disks that are smaller than wanted. The set stays maximal.
//   * Where it takes none out any more, single samples go, those first that leave the surface covered best. Then the set is not
//     maximal, and a multiple of the radius that covers the surface is reported.
// The set stays Poisson-disk all the time, samples on curves stay, and so does the topology of the dual where that is asked
// for.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"

#include <string>

namespace amps {

/// Why there is another number of samples than was to be met exactly.
enum class CountObstacle {
  kNothing,   ///< there is none
  kShape,     ///< radii follow from the shape or from max_error, and the number was too far off
  kCurves,    ///< samples on curves alone are more
  kCoverage,  ///< to take more out would leave a point farther than two radii from all samples, change the topology, or leave
              ///< another set: half of those away from curves is the most
  kNoRoom,  ///< no more fit, though disks fell to half the radius wanted, or they would change the topology, or double the set
};

/// How a number of samples was met exactly. Where it could not be, nothing has been done that costs angles, radii or coverage.
struct ExactCountReport {
  bool asked = false;           ///< if not, all the rest says nothing
  Index wanted = 0;             ///< the number asked for
  Index before = 0, after = 0;  ///< samples before and after
  Index refills = 0;            ///< places where a gap was refilled with more samples or fewer
  Index smaller = 0;            ///< of these, with disks smaller than wanted
  Index taken_out = 0;          ///< samples that went without a refill
  /// The greatest distance from a point of the surface to the owner of its place, in radii of the latter: above 1 if and only
  /// if there are gaps, decided exactly.
  double coverage = 0;
  /// What it has added to the energy of triangles and valences that are bad (OptimizeIteration::energy); 0 without
  /// optimisation.
  double cost = 0;
  CountObstacle obstacle = CountObstacle::kNothing;
  double seconds = 0;
};

/// Why the number was not met, and what to do, in one line; empty if it was, or was not asked for.
AMPS_EXPORT std::string missed_count(const ExactCountReport& report);

}  // namespace amps

#include "amps/host_macros_end.h"
