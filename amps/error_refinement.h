// error_refinement.h (internal): smaller radii where a result is farther from the surface than asked for. Nothing here is
// proved; what is proved is surface_distance()'s upper bound, of what comes of it.
//
// Radii need not fall below the error: the points of a disk of radius r ≤ ε are that near to its sample, and so are those of a
// triangle whose circumradius is r.
#pragma once

#include "amps/base.h"
#include "amps/cap_field.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/samples.h"
#include "amps/sizing.h"
#include "amps/surface_distance.h"

#include <vector>

namespace amps::detail {

/// Radii to begin with, where none are given: by curvature, up to a quarter of the diagonal, limited in gradation.
SizingField error_sizing(const MeshView& mesh, double error, const Execution& execution);

/// The distance between input and result, with bounds close beside this error.
DistanceReport measure_error(const MeshView& mesh, const Mesh& result, double error, const Execution& execution);

/// Bounds of radii at the vertices of triangles that are farther than `error` from the surface, or have points of it nearest
/// to them that are. `distance`: of the two. Empty if radii there are as small as they may become.
std::vector<RadiusCap> error_caps(const MeshView& mesh, const Mesh& result, const SampleSet& samples, double error,
                                  const DistanceReport& distance, const Execution& execution);

/// About how many samples there will be under more bounds of radii.
double expected_under(const CapField& caps, const Mesh& result, const SampleSet& samples);

}  // namespace amps::detail
