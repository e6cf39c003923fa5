// quality.h: how good a triangle mesh is — angles, edges, areas, the quality Q of Frey & Borouchaki, and valences.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/buffers.h"
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
  double min_q = 0, mean_q = 0;       ///< Q = 6/√3 · area / (half perimeter · longest edge): 1 equilateral, 0 degenerate
  double min_area = 0, max_area = 0;  ///< absolute
  double area_ratio = 0;              ///< smallest over largest triangle area
  std::array<Index, 36> angles{};     ///< [k] corners with angles in [5k, 5k + 5) degrees; 180 among the last
  std::array<Index, 16> valence{};    ///< [d] interior vertices of degree d, 15 and above together
  Index interior_vertices = 0;        ///< used by a facet and on no boundary edge
  double valence_5_6_7 = 0;           ///< % of interior vertices with 5 to 7 edges; 0 if there is no interior vertex
};
/// Throws Error(kCancelled) if stopped through `execution`, whose threads are not used. O(#V + #F).
AMPS_EXPORT QualityReport quality(const MeshView& mesh, const Execution& execution = {});
AMPS_EXPORT std::ostream& operator<<(std::ostream& out, const QualityReport& report);

/// Edges and areas over what they can be at most, or least, in the dual of a maximal set: the columns |e'_max|, |t'_min| and
/// |t'_max| of the paper's Table 1. With one radius r, edges are in [r, 2r], and triangles have circumradii of at most r: none
/// is smaller than the equilateral one with edges r, √3/4·r², or larger than the one with edges √3·r, 3√3/4·r².
///
/// Where radii vary, edges are from max(r_i, r_j) to r_i + r_j long, and areas are over these bounds for the least (max_area:
/// the greatest) radius of their corners: a measure then, no theorem.
struct BoundRatios {
  double min_edge = 0;        ///< least |p_i − p_j| / max(r_i, r_j): at least 1
  double max_edge = 0;        ///< |e'_max|: greatest |p_i − p_j| / (r_i + r_j): at most 1
  double min_area = 0;        ///< |t'_min|: at least 1 where radii are equal
  double max_area = 0;        ///< |t'_max|: at most 1 where radii are equal
  double gradation = 0;       ///< greatest |r_i − r_j| / |p_i − p_j| over edges
  double mean_gradation = 0;  ///< its mean over edges
};
/// `radii`: of each vertex, absolute. Throws Error: kInvalidArgument (not one radius a vertex, one not finite or not above 0);
/// kCancelled. Zeros without a triangle. Facets with repeated indices are skipped. O(#F).
AMPS_EXPORT BoundRatios bound_ratios(const MeshView& mesh, const ValuesView& radii, const Execution& execution = {});

namespace detail {

class MeshEdges;

struct QualityOfParts {
  QualityReport all;
  std::array<QualityReport, 2> parts;
};
/// quality() of a mesh whose edges are known, at a scale near 1, with no facet of a repeated index; and of its parts, each as
/// if it were a mesh: the facets with flag 0, and those with flag 1. `part`: flags by facet; empty: the whole alone.
QualityOfParts quality_of_parts(const MeshView& mesh, const MeshEdges& edges, const std::vector<char>& part,
                                const Execution& run);
/// From units of `scale`.
void scale_back(QualityReport& report, const MeshScale& scale);

}  // namespace detail

}  // namespace amps

#include "amps/host_macros_end.h"
