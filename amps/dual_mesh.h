// dual_mesh.h (internal): the triangles that cells of samples meet in, as a mesh: each once, oriented as the surface is.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/mesh_edges.h"
#include "amps/power_diagram.h"

#include <vector>

namespace amps::detail {

/// Dual triangles and the facet of each.
struct Dual {
  Triangles triangles;
  std::vector<Index> facets;
};

/// What the diagram has of the dual; no more of it is needed then. `ids`: the sites, in the order of the result's vertices;
/// empty: as they are.
Dual listed_triangles(const RestrictedPowerDiagram& diagram, const std::vector<Index>& ids, const Execution& execution);

/// The triangulation, of what the diagram has listed. The vertices lie at `positions`. `surface`: the edges of the diagram's
/// mesh.
Dual restricted_triangles(const Dual& listed, const PointsView& positions, const SurfaceEdges& surface,
                          const Execution& execution);

}  // namespace amps::detail
