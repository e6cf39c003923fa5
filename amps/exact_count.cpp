#define AMPS_OWN_SOURCE
#include "amps/exact_count.h"

namespace amps {

std::string missed_count(const ExactCountReport& report) {
  if (!report.asked || report.after == report.wanted) return {};
  const std::string made =
      std::to_string(report.after) + " samples for exactly " + std::to_string(report.wanted) + " asked for: ";
  switch (report.obstacle) {
    case CountObstacle::kShape:
      return made + "radii follow from the shape; ask for another number, or a larger error";
    case CountObstacle::kCurves:
      return made + "those on curves alone are more; ask for more, or keep fewer curves";
    case CountObstacle::kCoverage:
      return made + "fewer would leave parts of the surface without samples, or change the topology; ask for more";
    case CountObstacle::kNoRoom:
      return made + "no more fit, or they would change the topology; ask for fewer, or far more";
    case CountObstacle::kNothing:
      break;
  }
  return made + "stopped";
}

}  // namespace amps
