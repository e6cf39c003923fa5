// count_model.h (internal): how many samples radii make, so that a wanted number can be met.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/sizing.h"

namespace amps::detail {

/// How many samples a scale s of the radii makes: factor·(κ∫dA/r²/s² + (β∫ds/r − κγ∫|∇r|dA/r²)/s), the second integral along
/// the boundary, the third over the surface again. What else matters, above all creases and features finer than the radii, the
/// factor learns from the runs; it starts as on most real models (measured: tests/bench/README.md).
class CountModel {
 public:
  /// For a field, or radius 1 everywhere if it is empty. target ≥ 1. O(#V + #F + #pieces). Cancelled, it throws
  /// Error(kCancelled).
  CountModel(const MeshView& mesh, const SizingField& field, Index target, const Execution& execution = {});

  /// The factor on the radii that makes the wanted number.
  double scale() const;

  /// The count that scale() has led to. Far off, it is believed as it is: the factor varies with the scale. Near, it scatters
  /// (by about 0.3/√n), and the factor is the mean.
  void learn(Index count);

 private:
  double target_, inner_, border_;  ///< border_: of the terms in 1/s
  double factor_ = 0.993;
  int near_runs_ = 0;
};

}  // namespace amps::detail
