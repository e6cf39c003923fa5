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
#include "amps/surface_tree.h"

#include <vector>

namespace amps::detail {

/// Radii to begin with, where none are given: by curvature, up to a quarter of the diagonal, limited in gradation.
SizingField error_sizing(const MeshView& mesh, double error, const Execution& execution);

/// Radii for about so many samples that make the error the same everywhere, as above.
SizingField error_sizing_of_count(const MeshView& mesh, double count, const Execution& execution);

/// The distance between input and result, with bounds close beside this error.
DistanceReport measure_error(const MeshView& mesh, const Mesh& result, double error, const Execution& execution);

/// Where a result is farther from the surface than asked for.
struct ErrorCaps {
  double farthest = 0;          ///< the greatest distance found, of those above 0.9 error
  std::vector<RadiusCap> caps;  ///< bounds of radii there; none where radii are as small as they may become
};

/// Looks at results, one after the other, for triangles that are farther from a surface than an error, or have points of it
/// nearest to them that are.
class ErrorSearch {
 public:
  /// `mesh` must outlive this.
  ErrorSearch(const MeshView& mesh, const Execution& execution);

  /// Bounds are of radii at the vertices of such triangles, and of those farther than 0.9 error: so that the next round does
  /// not find these.
  ErrorCaps look(const Mesh& result, const SampleSet& samples, double error, const Execution& execution);

  /// What comes has been sampled anew.
  void start_again() { first_ = true; }

 private:
  MeshView mesh_;
  double diagonal_;
  SurfaceTree tree_;
  bool first_ = true;
};

/// About how many samples there will be under more bounds of radii.
double expected_under(const CapField& caps, const Mesh& result, const SampleSet& samples);

}  // namespace amps::detail
