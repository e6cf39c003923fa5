// fit.h: vertices that leave the surface so that the triangles lie closer to it. A mesh whose vertices lie on a surface is
// biased: it cuts through where the surface is convex. Here its vertices move, and its triangles stay as they are, so that the
// distance to the surface falls in the mean square.
//
//   amps::Mesh fitted = result.mesh;
//   fitted.vertices = amps::fit_vertices(input, result.mesh);
//
// The distance of a point y of a triangle to its nearest point p of the input is, as long as that point's tangent plane is the
// surface, d + n·Σ bᵢ xᵢ, where n is the direction from p to y, d their distance, b the barycentric coordinates of y and x the
// offsets of the corners. Its square, summed over three points a triangle, is least at the solution of a sparse linear system
// (the point-to-plane step of Chen & Medioni, "Object modelling by registration of multiple range images", 1992), found by
// conjugate gradients. We differ from a registration in that each vertex has offsets of its own, and in the bounds that hold.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"

#include <array>
#include <iosfwd>
#include <vector>

namespace amps {

/// Where vertices may go.
enum class Fit {
  kOff,     ///< they stay
  kNormal,  ///< along their normals: fast, and triangles hardly change
  kFree,    ///< anywhere, in several rounds; points of the input count as well, so that corners and folds are followed too
};

/// In words: "none", "normal", "free".
AMPS_EXPORT const char* name_of(Fit fit) noexcept;

struct FitOptions {
  Fit fit = Fit::kNormal;
  /// Edges of the mesh that lie along curves of the input, by vertices. Their vertices move so that these edges lie closer to
  /// the input's curves, and follow nothing else; ends and forks of curves stay where they are. The mesh's boundary is such a
  /// curve by itself.
  std::vector<std::array<Index, 2>> curve_edges;
  /// The input's curves, by vertices of the input; its boundary is one by itself. Without them, vertices of `curve_edges` that
  /// are not on the boundary stay.
  std::vector<std::array<Index, 2>> input_curve_edges;
  /// Further vertices that stay, such as corners.
  std::vector<Index> fixed;
  /// Bounds for what keeps them before, angles in degrees and edges in absolute units; 0: the least and the greatest there are,
  /// as max_edge infinity: none. A triangle or an edge that is beyond a bound gets no worse than it was. Where all edges are of
  /// about one length, a max_edge of 0 leaves no room.
  double min_angle = 0, max_angle = 0;
  double min_edge = 0, max_edge = 0;
  /// Threads, progress and cancelling. The result does not depend on the threads.
  Execution execution;
};

/// What was reached. Distances are of three points a triangle of the mesh to the input, in its units: a cheap measure,
/// surface_distance() is the true one.
struct FitReport {
  double rms_before = 0, rms_after = 0;
  double max_before = 0, max_after = 0;
  Index moved = 0;      ///< vertices
  Index held_back = 0;  ///< of them, or of those that stayed, how many a bound kept from where they were to go
  int rounds = 0;       ///< that brought something
  double seconds = 0;
};
AMPS_EXPORT std::ostream& operator<<(std::ostream& out, const FitReport& report);

/// The vertices of `mesh`, moved so that its triangles lie closer to `input`: #V by 3, in the same order. The mesh's vertices
/// lie on the input or near it, as those of remesh() do. Never is rms_after above rms_before. No triangle turns by more than
/// 60°, and none intersects another (find_self_intersections) that it did not before: vertices go back for that. Where two
/// sheets of the input are near each other, points count only with the sheet that their triangle's corners are of: one whose
/// normal is not opposed. Vertices whose move is less than rounding, as on planes, keep their bits.
///
/// Throws Error(kInvalidMesh) for an input that is not usable (require_usable), a mesh with an index out of range or a
/// coordinate that is not finite, Error(kInvalidArgument) for options out of range; kCancelled. Thread-safe.
/// O(#F_input log #F_input + #F_mesh log #F_input) expected.
AMPS_EXPORT Points fit_vertices(const MeshView& input, const MeshView& mesh, const FitOptions& options = {},
                                FitReport* report = nullptr);

}  // namespace amps

#include "amps/host_macros_end.h"
