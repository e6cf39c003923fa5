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
  Index pick(Rng& rng) const noexcept { return pick(throw_at(rng)); }

  /// pick() in two halves: the draws, and the look at the table, whose entry is on its way from memory meanwhile.
  struct Throw {
    std::size_t column;
    double height;
  };
  Throw throw_at(Rng& rng) const noexcept {
    // Fewer than 2^31 columns: uniform() favours none of them by more than 2^-22 of its share, and n·uniform() < n.
    const auto column = static_cast<std::size_t>(rng.uniform() * static_cast<double>(entries_.size()));
    prefetch(&entries_[column]);
    return {column, rng.uniform()};
  }
  Index pick(const Throw& at) const noexcept {
    const Entry& entry = entries_[at.column];
    return at.height < entry.keep ? static_cast<Index>(at.column) : entry.alias;
  }

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
  /// The next `count` ≤ kMostAtOnce darts, and the generator as each leaves it. Faster than one by one: what each reads is on
  /// its way from memory while others are worked on.
  void draw(Rng& rng, std::size_t count, Sample* darts, Rng* after) const;
  static constexpr std::size_t kMostAtOnce = 16;

  /// draw() in two halves: all that takes random numbers, one dart after another, and the rest of it, where darts are each for
  /// itself. Between the two a dart is no point: its facet is the entry of the table that was drawn.
  void draft(Rng& rng, std::size_t count, Sample* darts, Rng* after) const;
  void finish(std::size_t count, Sample* darts) const;
  /// How often each dart draws from the generator; 0: that varies.
  int draws_per_dart() const;

 private:
  const MeshView& mesh_;
  const WantedRadii& radii_;
  AliasTable table_;
};

}  // namespace amps::detail
