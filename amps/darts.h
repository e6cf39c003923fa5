// darts.h (internal): where darts fall — a table that draws facets by weight, points of a triangle by density, and both
// together: points of a surface by the density that radii ask for.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/wanted_radii.h"

#include <array>
#include <vector>

namespace amps::detail {

/// Draws i with probability weights[i] / Σ weights in constant time: Walker's alias method as built by Vose (IEEE TSE 17(9),
/// 1991). The same table on every platform. Entries of weight 0 are never drawn.
class AliasTable {
 public:
  /// Throws Error(kInvalidArgument) if a weight is negative, NaN or infinite, or if none is positive;
  /// kCancelled. O(n).
  explicit AliasTable(const std::vector<double>& weights, const Execution& execution = {});

  /// Two draws of `rng`.
  Index pick(Rng& rng) const noexcept;

 private:
  struct Entry {
    double keep;  ///< chance of this entry, rather than its alias, once its column is drawn
    Index alias;
  };
  std::vector<Entry> entries_;
};

/// Barycentric coordinates of a random point of a triangle, of density exactly ∝ 1/r² with r > 0 linear between `radii` at its
/// corners. Arithmetic and square roots only, so the same on every platform. O(1) expected, whatever the radii.
Vec3 density_barycentric(const std::array<double, 3>& radii, Rng& rng);

/// Samples to be, independent of each other: points of density exactly ∝ 1/r², with the radius wanted there.
class SurfaceDarts {
 public:
  /// `areas`: of the facets. Mesh and radii must outlive it. O(#F), or the pieces of the field. Cancelled, it throws
  /// Error(kCancelled).
  SurfaceDarts(const MeshView& mesh, const std::vector<double>& areas, const WantedRadii& radii,
               const Execution& execution = {});
  Sample draw(Rng& rng) const;
  /// How often each dart draws from the generator; 0: that varies.
  int draws_per_dart() const;

 private:
  const MeshView& mesh_;
  const WantedRadii& radii_;
  AliasTable table_;
};

}  // namespace amps::detail
