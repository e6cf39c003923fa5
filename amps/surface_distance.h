// surface_distance.h: how far two surfaces are apart — the Hausdorff distance between bounds that are guaranteed, mean and
// root-mean-square distance by quadrature.
//
//   amps::DistanceReport d = amps::surface_distance(input, output);
//   std::cout << d << "\n";                 // in units of the mesh and in % of the input's diagonal
//   d.percent(d.hausdorff());
//
// One-sided distances are of the points of one surface to the nearest points of the other, as in Metro (Cignoni, Rocchini &
// Scopigno, 1998), which samples them. Here the greatest is enclosed instead: distance to one facet is a convex function, so
// over a triangle it is greatest at a corner, and the best of a few facets bounds the distance to the surface from above;
// triangles whose bound is too high are cut (Tang, Lee & Kim, "Interactive Hausdorff distance computation for general polygonal
// models", 2009). We differ in the cut: where two facets of the other surface meet under a small triangle, it is cut along the
// border between them, and what remains lies under one facet, with an exact bound. So surfaces that (nearly) coincide need no
// subdivision down to the tolerance.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/surface_tree.h"

#include <cstdint>
#include <iosfwd>
#include <vector>

namespace amps {

struct DistanceOptions {
  /// Bounds of the Hausdorff distance are at most this far apart, in diagonals of the first mesh's bounding box; in [1e-12, 1].
  /// Cuts are few, so a looser one saves next to nothing.
  double tolerance = 1e-6;
  /// Longest edge of the triangles of the quadrature, in diagonals of the first mesh's bounding box; in [1e-6, 1]. Smaller
  /// facets stay whole, others are halved until they are small enough. It takes about 10 area/spacing² points, and one a facet
  /// at least.
  double spacing = 0.01;
  /// Cuts to spend in each direction on the tolerance; spent, the bounds stay valid but farther apart than asked for. A cut
  /// costs one or two searches; about 400 bytes each are kept at worst.
  std::int64_t max_cuts = 10'000'000;
  /// Threads, progress and cancelling. The result does not depend on the threads.
  Execution execution;
};

/// Distances of the points of one surface to another, in units of the meshes.
struct OneSidedDistance {
  double hausdorff = 0;        ///< no point is farther than this …
  double hausdorff_lower = 0;  ///< … and `farthest` is as far as this
  SurfacePoint farthest;
  double mean = 0;        ///< ∫ d / area
  double rms = 0;         ///< √(∫ d² / area)
  double mean_error = 0;  ///< estimates, mostly too high: what a quadrature of lower degree changes
  double rms_error = 0;
};

/// Both directions. Percentages are of the diagonal of the first mesh's bounding box, as Metro and the paper's Table 2 have
/// them.
struct DistanceReport {
  OneSidedDistance forward;   ///< from the first surface to the second
  OneSidedDistance backward;  ///< from the second to the first
  double diagonal = 0;        ///< of the first mesh's bounding box
  double hausdorff() const { return forward.hausdorff > backward.hausdorff ? forward.hausdorff : backward.hausdorff; }
  double hausdorff_lower() const {
    return forward.hausdorff_lower > backward.hausdorff_lower ? forward.hausdorff_lower : backward.hausdorff_lower;
  }
  double rms() const { return forward.rms > backward.rms ? forward.rms : backward.rms; }
  double mean() const { return forward.mean > backward.mean ? forward.mean : backward.mean; }
  double percent(double distance) const { return 100 * distance / diagonal; }
};

/// The distance between two surfaces, as sets of points: orientation and connectivity play no part, isolated vertices none at
/// all, and facets without area are curves or points, which count in the Hausdorff distance only. Bounds hold to rounding,
/// 1e-14 of the greatest coordinate. Throws Error(kInvalidMesh) for a mesh that is not usable (require_usable),
/// Error(kInvalidArgument) for options out of range; kCancelled. O(n log n) expected for n facets and points. Thread-safe.
AMPS_EXPORT DistanceReport surface_distance(const MeshView& first, const MeshView& second, const DistanceOptions& options = {});

/// One direction alone: distances of the points of `from` to `to`; tolerance and spacing relative to the diagonal of `from`.
AMPS_EXPORT OneSidedDistance one_sided_distance(const MeshView& from, const MeshView& to, const DistanceOptions& options = {});

AMPS_EXPORT std::ostream& operator<<(std::ostream& out, const DistanceReport& report);

namespace detail {

/// A point of one surface that is far from another one.
struct FarPoint {
  Index facet = kNone;    ///< it is on
  Index nearest = kNone;  ///< facet of the other surface
  double distance = 0;
  Vec3 position = Vec3::Zero();
};

/// Points of a surface that are farther than `distance` > 0 from another one, of which `tree` is; wherever some points are
/// farther than 1.01 times that, one in their neighbourhood is listed. Proves nothing: coordinates are not scaled, and bounds
/// are not kept. Both usable. Cost as one_sided_distance(), but there is no quadrature.
std::vector<FarPoint> far_points(const MeshView& from, const MeshView& to, const SurfaceTree& tree, double distance,
                                 const Execution& execution);

}  // namespace detail

}  // namespace amps

#include "amps/host_macros_end.h"
