// sizing.h: how large the disks are, point by point of a surface. A sizing field gives the wanted radius r > 0 everywhere:
// uniform, from values at vertices, from a function of one's own, from the local feature size or from curvature; then combined,
// clamped, limited in gradation and scaled to a wanted number of samples.
//
// A maximal Poisson-disk set has triangles as good as its radii are even: the gradation of the field, how fast r may change
// along the surface, sets the worst angle. So the usual way is
//
//   SizingField field = for_count(lfs_sizing(mesh).with_ratio(), 12000);
//
// which scales the field and limits its gradation. Scaling a limited field would multiply its gradation too.
//
// Everything here that takes an Execution throws Error(kCancelled) when cancelled.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/mesh_scale.h"

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

namespace amps {

namespace detail {
struct SizingLattice;
struct SizingFieldAccess;
}  // namespace detail

/// r_max / r_min where nothing else is asked for: that of the paper.
inline constexpr double kDefaultRatio = 16;

/// The wanted disk radius r > 0 at every point of one mesh, absolute units. Piecewise linear: each facet carries a lattice of
/// k² congruent triangles (k a power of two, its own for each facet; 1 where the values at the corners say enough) with a
/// radius at each node. Continuous over an edge whose facets have equal k and equal values there; beside a finer facet the
/// coarser one interpolates linearly, so that there the field may jump by the error of that interpolation.
///
/// A value: copies share one immutable table, every operation gives a new field, the mesh need not outlive it. Thread-safe.
class SizingField {
 public:
  /// No mesh, no radius: nothing but empty() and assignment may be called.
  SizingField() = default;
  bool empty() const { return lattice_ == nullptr; }

  /// True if this field was made for a mesh with the same coordinates and the same facets. O(#V + #F).
  AMPS_EXPORT bool fits(const MeshView& mesh, const Execution& execution = {}) const;
  AMPS_EXPORT Index num_facets() const;

  /// Requires a facet in range and barycentrics ≥ 0 that sum to 1 up to rounding. Within [min_radius(), max_radius()]
  /// where the facet has area. O(1).
  AMPS_EXPORT double radius(Index facet, const Vec3& barycentric) const;
  double radius(const SurfacePoint& at) const { return radius(at.facet, at.barycentric); }
  double min_radius() const {
    return scale_.length_back(min_);
  }  ///< over all nodes of facets with area: the extremes of the field
  double max_radius() const { return scale_.length_back(max_); }

  /// A lattice triangle: where darts are thrown.
  struct Piece {
    Index facet = kNone;
    std::array<Vec3, 3> corners;  ///< barycentric coordinates in the facet, exact; oriented as the facet
    std::array<double, 3> radii;  ///< at the corners; linear between
  };
  AMPS_EXPORT std::size_t num_pieces() const;  ///< Σ k² ≥ #F
  /// Pieces of a facet are consecutive, facets in order; #F gives num_pieces().
  AMPS_EXPORT std::size_t first_piece(Index facet) const;
  AMPS_EXPORT Piece piece(std::size_t i) const;  ///< O(1)

  /// ∫ dA/r² over a piece, and over the mesh: exact for the piecewise linear field up to rounding (relative error below 1e-12).
  /// A maximal set has about kSamplesPerDensity times as many samples. O(1); O(pieces).
  AMPS_EXPORT double density_integral(std::size_t piece) const;
  AMPS_EXPORT double density_integral(const Execution& execution = {}) const;

  /// r·factor. Throws Error(kInvalidArgument) unless the factor is > 0 and finite and all radii stay so.
  AMPS_EXPORT SizingField scaled(double factor, const Execution& execution = {}) const;
  /// min(highest, max(lowest, r)) at the nodes. Throws Error(kInvalidArgument) unless 0 < lowest ≤ highest; highest may be
  /// infinite.
  AMPS_EXPORT SizingField clamped(double lowest, double highest, const Execution& execution = {}) const;

  /// clamped(m, ratio·m), with a robust smallest radius m: the `quantile` of radii by area (of the means of pieces), so that r
  /// is raised on this part of the surface at most, where it is smallest. Throws Error(kInvalidArgument) unless ratio ≥ 1 and 0
  /// ≤ quantile < 1. O(pieces) expected.
  AMPS_EXPORT SizingField with_ratio(double ratio = kDefaultRatio, double quantile = 0.01,
                                     const Execution& execution = {}) const;

  /// The largest field below this one with |r(x) − r(y)| ≤ gradation·d(x, y) between nodes, d the distance along the surface
  /// (vertices of equal position are one). Relaxed to a fixed point over lattice triangles: within an error of first order in
  /// their size, as in fast marching, and 1e-4 of r; Lipschitz to rounding along their edges; limiting again changes nothing.
  /// Distances come out too long, r too large, where lattice triangles are very obtuse. Persson, "Mesh size functions for
  /// implicit geometries and PDE-based gradient limiting", 2006. Throws Error(kInvalidArgument) unless gradation > 0 (infinite:
  /// no limit). O(nodes · log).
  AMPS_EXPORT SizingField limited(double gradation, const Execution& execution = {}) const;

 private:
  friend struct detail::SizingFieldAccess;
  SizingField(std::shared_ptr<const detail::SizingLattice> lattice, std::vector<double> nodes, const Execution& execution);

  Piece scaled_piece(std::size_t i) const;

  std::shared_ptr<const detail::SizingLattice> lattice_;
  std::shared_ptr<const std::vector<double>> nodes_;  ///< radii, facet by facet
  double min_ = 0, max_ = 0;
  detail::MeshScale scale_;  ///< in whose unit all of these are, and the lattice's mesh
};

/// A maximal set of radii r has about this times ∫dA/r² samples (measured: uniform radii, large sets).
inline constexpr double kSamplesPerDensity = 0.6965;

/// The gradation for SizingField::limited where nothing else is asked for: the largest at which remeshing by lfs beats Table 2
/// of the paper in every column, and sets can be optimised until no triangle is obtuse (measured: tests/bench/README.md). It is
/// what drives the worst angle.
inline constexpr double kDefaultGradation = 0.1;

/// The factor to scale a field by for about `count` samples: √(kSamplesPerDensity · ∫dA/r² / count). Good to a few percent
/// where the surface is large beside the disks. Throws Error(kInvalidArgument) for count < 1 or an empty field.
AMPS_EXPORT double count_factor(const SizingField& field, double count, const Execution& execution = {});

/// The field scaled by some s and then limited in gradation, for about `count` samples in all: s is such that
/// kSamplesPerDensity · ∫dA/r² is within 0.5 % of `count`. An infinite gradation gives field.scaled(count_factor(field,
/// count)). Throws as count_factor and SizingField::limited. About twice the cost of limited().
AMPS_EXPORT SizingField for_count(const SizingField& field, double count, double gradation = kDefaultGradation,
                                  const Execution& execution = {});

/// The smaller radius of two fields of one mesh, at the nodes of the finer lattice of each facet: nowhere above either. Throws
/// Error(kInvalidArgument) if a field is empty or they belong to different meshes.
AMPS_EXPORT SizingField min(const SizingField& a, const SizingField& b, const Execution& execution = {});

// Factories. Each throws Error(kInvalidMesh) for a mesh that is not usable (require_usable) and kInvalidArgument as said.

/// The same radius everywhere, > 0 and finite. O(#V + #F).
AMPS_EXPORT SizingField uniform_sizing(const MeshView& mesh, double radius, const Execution& execution = {});

/// Radii at the vertices, linear in each facet. `radii`: one a vertex, > 0 and finite where a facet uses the vertex (the error
/// names the first that is not). O(#V + #F).
AMPS_EXPORT SizingField vertex_sizing(const MeshView& mesh, const ValuesView& radii, const Execution& execution = {});

/// The same from wanted densities ρ, samples per area up to a constant, > 0 and finite: r = 1/√ρ at the vertices.
AMPS_EXPORT SizingField vertex_density_sizing(const MeshView& mesh, const ValuesView& densities,
                                              const Execution& execution = {});

/// A radius for a point of the surface. Called from one thread, several times for some points: it must give the same value for
/// the same point. Points on edges and vertices come as points of the first facet that has them.
using SizingFunction = std::function<double(const SurfacePoint&)>;

struct TabulationOptions {
  /// Lattices are refined until linear interpolation is off by less than this times the radius, at the middles of lattice edges
  /// and triangles...
  double tolerance = 0.01;
  /// ...or lattice edges are shorter than this times the smallest radius in the facet, or the facet has 16 lattice triangles
  /// for each sample it is going to hold (and 64 more): memory is O(samples + #F).
  double finest = 0.5;
  /// More than these nodes are refused with Error(kTooLarge): 8 bytes each.
  std::size_t max_nodes = 200'000'000;
};

/// Tabulates a function. Details smaller than an eighth of a facet and than twice the radius around may be missed: give the
/// mesh facets, or the function radii, of their size. Throws Error(kInvalidArgument), naming the point, if a value is not > 0
/// and finite. O(#F + nodes) and about 5 calls a node.
AMPS_EXPORT SizingField function_sizing(const MeshView& mesh, const SizingFunction& radius,
                                        const TabulationOptions& options = {}, const Execution& execution = {});

struct LfsOptions {
  double scale = 1;  ///< r = scale · lfs
  /// A medial ball counts if it touches the surface at points seen under at least this angle (degrees) from its centre.
  /// Smaller: shallower dents and bumps count, and noise with them. Blunt tips: an angle θ overestimates their lfs by about
  /// θ²/10 (ellipsoid 2:1:1, 40°: 5 %).
  double min_separation = 40;
  /// ...and if its radius is at least this times the spacing of samples around. Bounds lfs from below near creases.
  double min_pole_ratio = 1.5;
  /// Facets too coarse for the feature size are sampled inside, about as densely as this many samples would cover the whole
  /// surface; finer meshes are taken as they are.
  Index samples = 12'000;
  double tolerance = 0.02;  ///< of the tabulation inside of large facets
};

/// Local feature size: the distance of each point (#P by 3, absolute units) to the medial axis of the surface, by poles
/// (Amenta, Bern & Kamvysselis 1998) from a regular triangulation of samples, filtered by the angle of Dey & Zhao 2004 and by
/// the spacing of samples, but that balls between two sheets count down to half of it. Sheets closer than that may be missed or
/// have values too large. Between 1e-6 and 1 times the diagonal of the bounding box, which is also the value where there is no
/// medial axis: on flat surfaces. 1-Lipschitz in space. Poles are thinned: errors of 1 %. Throws Error(kInvalidArgument) for
/// options out of range and points that are not finite. O(n log n) expected.
AMPS_EXPORT std::vector<double> local_feature_size(const MeshView& mesh, const PointsView& points,
                                                   const LfsOptions& options = {}, const Execution& execution = {});

/// r = scale · lfs; with it ρ = 1/r² ∝ 1/lfs². At vertices, and tabulated on facets that are large beside it.
AMPS_EXPORT SizingField lfs_sizing(const MeshView& mesh, const LfsOptions& options = {}, const Execution& execution = {});

/// #V greatest absolute principal curvatures, 1/length, estimated from the change of vertex normals over each facet
/// (Rusinkiewicz, "Estimating curvatures and their derivatives on triangle meshes", 2004; normals by Max 1999), averaged around
/// a vertex. Edges with more than `crease_angle` degrees between the normals of their facets, and edges without exactly two
/// facets of one orientation, are creases: nothing is averaged or differenced over them, and a vertex has the greatest of its
/// sides' values. 0 at isolated vertices. Vertices of equal position are one. Throws Error(kInvalidArgument) unless 0 ≤
/// crease_angle ≤ 180. O(#F log #F).
AMPS_EXPORT std::vector<double> max_curvature(const MeshView& mesh, double crease_angle = 50, const Execution& execution = {});

struct CurvatureOptions {
  double max_error = 0;      ///< ε: absolute units, > 0
  double crease_angle = 50;  ///< degrees; curvature across sharper edges does not count
  double max_radius = 0;     ///< where the surface is flat; 0: the diagonal of the bounding box
};

/// Radii that keep the triangles of a maximal set within ε of the surface. They have circumradii ≤ r; a triangle of
/// circumradius r with corners on a sphere of curvature κ is off by up to the sagitta 1/κ − √(1/κ² − r²), so r = √(ε(2/κ − ε))
/// with κ the max_curvature, and 1/κ where κε ≥ 1. At vertices. Creases are no matter of radii: a triangle across one cuts it
/// off. Throws Error(kInvalidArgument) unless max_error > 0.
AMPS_EXPORT SizingField curvature_sizing(const MeshView& mesh, const CurvatureOptions& options,
                                         const Execution& execution = {});

}  // namespace amps

#include "amps/host_macros_end.h"
