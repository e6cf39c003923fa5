// curves.h: which edges of a surface are curves that samples and results keep: boundaries, creases, edges of many sheets,
// borders of labels, marked edges; their corners, and the patches between them. Below sizing.h, since the wanted radius says
// which creases are large enough to be kept.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/mesh.h"
#include "amps/sizing.h"

#include <array>
#include <cstddef>
#include <vector>

namespace amps {

/// Which edges of a surface are kept as curves.
struct CurveOptions {
  bool creases = true;        ///< keep creases
  double crease_angle = 40;   ///< degrees between the normals of two facets above which their edge is a candidate, in (0, 180)
  bool borders = true;        ///< keep boundaries, and edges of three and more facets
  double radius = 0;          ///< the wanted radius r, absolute, if `sizing` is empty; 0: nothing is averaged or dropped
  SizingField sizing;         ///< the wanted radius by place, instead of `radius`
  std::vector<Index> labels;  ///< of each facet: borders between labels are curves; empty: none
  std::vector<std::array<Index, 2>> edges;  ///< marked by the user, by mesh vertices
  std::vector<Index> vertices;              ///< marked by the user, by mesh vertices: corners
  Execution execution;
};

/// Why an edge is part of a curve.
enum class CurveKind {
  kBorder,      ///< it has one facet
  kManySheets,  ///< it has three facets or more
  kLabels,      ///< its facets have different labels
  kCrease,      ///< its facets' normals differ by more than the threshold
  kMarked,      ///< by the user, and none of these
};
inline constexpr std::size_t kNumCurveKinds = 5;

/// In words: "border", "edge of many sheets", "border of labels", "crease", "marked".
AMPS_EXPORT const char* name_of(CurveKind kind) noexcept;

/// A piece of a curve between two corners, or a loop.
struct Curve {
  std::vector<Index> vertices;     ///< surface vertices, n + 1 of n edges; of a loop the first is there again at the end
  std::vector<std::size_t> edges;  ///< numbers in SurfaceEdges, n
  std::vector<double> arc;         ///< length from the start at each vertex, n + 1; absolute
  bool closed = false;             ///< a loop without corner
  Index first_corner = kNone, last_corner = kNone;  ///< places in CurveGraph::corners; kNone if closed
  CurveKind kind = CurveKind::kMarked;              ///< of its edges the first in the order of CurveKind; of an edge, too
  double length() const { return arc.back(); }
};

/// The curves of a surface. But for the numbers of patches the same for any order of facets, rotation of their indices,
/// orientation and number of threads.
struct CurveGraph {
  std::vector<Curve> curves;
  std::vector<Index> corners;           ///< surface vertices, ascending
  std::vector<char> is_curve_edge;      ///< by edge of SurfaceEdges
  std::vector<std::size_t> dropped;     ///< candidates that are no curves after all, ascending
  std::vector<Index> curve_of_edge;     ///< by edge; kNone where there is none
  std::vector<Index> corner_of_vertex;  ///< by mesh vertex, for surface vertices; kNone where there is none
  std::vector<Index> patch_of_facet;    ///< connected across edges that are no curves; kNone: a facet that does not count
  Index num_patches = 0;
  bool empty() const { return curves.empty() && corners.empty(); }
};

/// Finds the curves. Candidates are edges whose facets' normals differ by more than `crease_angle`; they stay where the normals
/// averaged within r on each side differ by more than 3/4 of it, in chains and components that are long enough against r;
/// components of many short curves are none.
/// Borders, edges of many sheets, borders of labels and marked edges always stay. Throws Error(kInvalidArgument) for options
/// out of range, for a marked pair of vertices that no edge joins and a marked vertex on no facet; Error(kInvalidMesh) as
/// require_usable() does, Error(kCancelled). O(#F) expected but for the averages: each looks at no more than 512 facets a side,
/// so where these are far smaller than r it is over less than r.
AMPS_EXPORT CurveGraph find_curves(const MeshView& mesh, const CurveOptions& options = {});

namespace detail {
class SurfaceEdges;

/// Options in units of `scale`, which is that of the mesh; a graph back from there.
CurveOptions scaled_options(const CurveOptions& options, const MeshScale& scale);
void scale_back(CurveGraph& graph, const MeshScale& scale);

/// The same, on edges that are there already, and their corner_fans() if these are. Requires a usable mesh.
CurveGraph find_curves(const MeshView& mesh, const SurfaceEdges& edges, const CurveOptions& options,
                       const std::vector<std::size_t>* fans = nullptr);
}  // namespace detail
}  // namespace amps

#include "amps/host_macros_end.h"
