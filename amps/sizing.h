// sizing.h: how large the disks are, point by point of a surface. A sizing field gives the wanted radius r > 0 everywhere:
// uniform, from values at vertices or from a function of one's own, then combined, clamped, limited in gradation and scaled to
// a wanted number of samples.
#pragma once

#include "amps/base.h"
#include "amps/mesh.h"

#include <array>
#include <cstddef>
#include <memory>
#include <vector>

namespace amps {

namespace detail {
struct SizingLattice;
struct SizingFieldAccess;
}  // namespace detail

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
  bool fits(const MeshView& mesh) const;
  Index num_facets() const;

  /// Requires a facet in range and barycentrics ≥ 0 that sum to 1 up to rounding. Within [min_radius(), max_radius()]
  /// where the facet has area. O(1).
  double radius(Index facet, const Vec3& barycentric) const;
  double radius(const SurfacePoint& at) const { return radius(at.facet, at.barycentric); }
  double min_radius() const { return min_; }  ///< over all nodes of facets with area: the extremes of the field
  double max_radius() const { return max_; }

  /// A lattice triangle: where darts are thrown.
  struct Piece {
    Index facet = kNone;
    std::array<Vec3, 3> corners;  ///< barycentric coordinates in the facet, exact; oriented as the facet
    std::array<double, 3> radii;  ///< at the corners; linear between
  };
  std::size_t num_pieces() const;              ///< Σ k² ≥ #F
  std::size_t first_piece(Index facet) const;  ///< pieces of a facet are consecutive, facets in order; #F gives num_pieces()
  Piece piece(std::size_t i) const;            ///< O(1)

  /// ∫ dA/r² over a piece, and over the mesh: exact for the piecewise linear field up to rounding (relative error below 1e-12).
  /// A maximal set has about kSamplesPerDensity times as many samples. O(1); O(pieces).
  double density_integral(std::size_t piece) const;
  double density_integral() const;

  /// r·factor. Throws Error(kInvalidArgument) unless the factor is > 0 and finite and all radii stay so.
  SizingField scaled(double factor) const;
  /// min(greatest, max(least, r)) at the nodes. Throws Error(kInvalidArgument) unless 0 < least ≤ greatest; greatest may be
  /// infinite.
  SizingField clamped(double least, double greatest) const;

 private:
  friend struct detail::SizingFieldAccess;
  SizingField(std::shared_ptr<const detail::SizingLattice> lattice, std::vector<double> nodes);

  std::shared_ptr<const detail::SizingLattice> lattice_;
  std::shared_ptr<const std::vector<double>> nodes_;  ///< radii, facet by facet
  double min_ = 0, max_ = 0;
};

/// A maximal set of radii r has about this times ∫dA/r² samples (measured: uniform radii, large sets).
inline constexpr double kSamplesPerDensity = 0.6965;

/// The smaller radius of two fields of one mesh, at the nodes of the finer lattice of each facet: nowhere above either. Throws
/// Error(kInvalidArgument) if a field is empty or they belong to different meshes.
SizingField min(const SizingField& a, const SizingField& b);

// Factories. Each throws Error(kInvalidMesh) for a mesh that is not usable (require_usable) and kInvalidArgument as said.

/// The same radius everywhere, > 0 and finite. O(#V + #F).
SizingField uniform_sizing(const MeshView& mesh, double radius);

/// Radii at the vertices, linear in each facet. `radii`: one a vertex, > 0 and finite where a facet uses the vertex (the error
/// names the first that is not). O(#V + #F).
SizingField vertex_sizing(const MeshView& mesh, const Eigen::Ref<const Eigen::VectorXd>& radii);

}  // namespace amps
