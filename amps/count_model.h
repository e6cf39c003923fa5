// count_model.h (internal): how many samples radii make, so that a wanted number can be met.
#pragma once

#include "amps/base.h"
#include "amps/mesh.h"
#include "amps/sizing.h"

namespace amps::detail {

/// How many samples a scale s of the radii makes: factor·(κ∫dA/r²/s² + β∫ds/r/s), the second integral along the boundary. On
/// closed surfaces with κ alone the first guess is within 1 % up to gradations of about 0.1; so it is on the unit square with
/// β, where κ alone misses by 1.2/√n. What else matters — steep fields, features finer than the radii — the factor learns from
/// the runs.
class CountModel {
 public:
  /// For a field, or radius 1 everywhere if it is empty. target ≥ 1. O(#V + #F + #pieces).
  CountModel(const MeshView& mesh, const SizingField& field, Index target);

  /// The factor on the radii that makes the wanted number.
  double scale() const;

  /// The count that scale() has led to. Far off, it is believed as it is: the factor varies with the scale. Near, it scatters
  /// (by about 0.3/√n), and the factor is the mean.
  void learn(Index count);

 private:
  double target_, inner_, border_;
  double factor_ = 1;
  int near_runs_ = 0;
};

}  // namespace amps::detail
