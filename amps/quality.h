// quality.h: how good a triangle mesh is — angles, edges, areas, the quality Q of Frey & Borouchaki, and valences.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/mesh_scale.h"

#include <array>
#include <iosfwd>

namespace amps {

/// Shape statistics of a triangle mesh. Angles in degrees. Facets with repeated indices are skipped. A zero-area facet counts
/// with the angles of its limit (0 and 180) and Q = 0.
struct QualityReport {
  Index triangles = 0;
  double min_angle = 0, max_angle = 0;               ///< over all corners
  double mean_min_angle = 0;                         ///< mean over triangles of their smallest angle
  double below_30 = 0;                               ///< % of triangles whose smallest angle is < 30°
  double above_90 = 0;                               ///< % of triangles whose largest angle is > 90°
  double min_edge = 0, max_edge = 0, mean_edge = 0;  ///< absolute length, over distinct edges
  double min_q = 0, mean_q = 0;     ///< Q = 6/√3 · area / (half perimeter · longest edge): 1 equilateral, 0 degenerate
  double area_ratio = 0;            ///< smallest over largest triangle area
  std::array<Index, 16> valence{};  ///< [d] interior vertices of degree d, 15 and above together
  Index interior_vertices = 0;      ///< used by a facet and on no boundary edge
  double valence_5_6_7 = 0;         ///< % of interior vertices with 5 to 7 edges; 0 if there is no interior vertex
};
/// Throws Error(kCancelled) if stopped through `execution`, whose threads are not used. O(#V + #F).
QualityReport quality(const MeshView& mesh, const Execution& execution = {});
std::ostream& operator<<(std::ostream& out, const QualityReport& report);

namespace detail {

/// From units of `scale`.
void scale_back(QualityReport& report, const MeshScale& scale);

}  // namespace detail

}  // namespace amps
