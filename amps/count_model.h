// count_model.h (internal): how many samples radii make, so that a wanted number can be met.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/mesh_edges.h"
#include "amps/sizing.h"
#include "amps/wanted_radii.h"

namespace amps::detail {

/// What radii make of a surface, worked out facet by facet before anything is made.
struct ForeseenSize {
  double by_area;    ///< κ∫dA/r²
  double by_length;  ///< samples that the length of edges and components asks for, whatever the area beside it
  double crossings;  ///< places where cells' edges cross the mesh's, roughly: the fragments beyond one a facet and one a sample
  double samples() const { return by_area > by_length ? by_area : by_length; }
};

/// A ball of radius r holds at most 2r of an edge: so many samples the longest edge takes. Where edges are so long that needles
/// could need `most_samples`, lengths of components are added up, at 0.75 samples per r, up to what the box has room for. A
/// convex facet of perimeter P meets about 1 + κA/r² + 0.5·P/r cells of a maximal set: Euler's formula and Buffon's needle, as
/// expected_fragments(), which is of equilateral facets; of needles the last term is nearly all. In a field r is the mean of
/// 1/r at a facet's corners; for lengths the greatest. `area`: total_area(). O(#V + #F) expected; caps do not count.
ForeseenSize foresee_size(const MeshView& mesh, double area, const WantedRadii& radii, double most_samples,
                          const Execution& execution = {});

/// How many samples a scale s of the radii makes: factor·(κ∫dA/r²/s² + (β∫ds/r − κγ∫|∇r|dA/r²)/s), the second integral along
/// the boundary, the third over the surface again. What else matters, above all creases and features finer than the radii, the
/// factor learns from the runs; it starts as on most real models (measured: tests/bench/README.md).
///
/// Where that would give radii with which one component, by its length alone, takes more samples than wanted, the surface is
/// needles: samples then follow one another along them, and the first scale is 0.75·∑l/n, over the lengths l of all components
/// (random disks that hold no other's centre cover an interval so: Rényi, 1958). Side by side needles are a surface again, so
/// that between runs the count is taken to fall with a power of the scale between 1 and 2.
class CountModel {
 public:
  /// For a field, or radius 1 everywhere if it is empty. target ≥ 1. O(#V + #F + #pieces). Cancelled, it throws
  /// Error(kCancelled).
  CountModel(const MeshView& mesh, const SizingField& field, Index target, const Execution& execution = {})
      : CountModel(mesh, SurfaceEdges(mesh, execution), field.empty() ? total_area(mesh) : 0, field, target, execution) {}
  /// The same on a surface whose edges and area are known; with a field the area does not matter.
  CountModel(const MeshView& mesh, const SurfaceEdges& edges, double area, const SizingField& field, Index target,
             const Execution& execution = {});

  /// The factor on the radii that makes the wanted number.
  double scale() const;

  /// The count that scale() would lead to, for reasons that the model does not know; before any run.
  void expect(double count) { factor_ *= count / target_; }

  /// The count that scale() has led to. Far off, it is believed as it is: the factor varies with the scale. Near, it scatters
  /// (by about 0.3/√n), and the factor is the mean.
  void learn(Index count);

 private:
  double target_, inner_, border_;  ///< border_: of the terms in 1/s
  double least_scale_ = 0;          ///< less makes more samples than wanted of one component's length
  double needle_scale_ = 0;         ///< where the surface is needles; else 0
  double factor_ = 0.993;
  int near_runs_ = 0;
};

}  // namespace amps::detail
