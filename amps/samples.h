// samples.h: disks on a surface — the set that every function takes and returns, the rule that keeps its disks apart, and the
// one way a sample is made. A sample is a point of a facet, given by barycentric coordinates; its position is derived from
// these, always by the same operations, so whoever does that again gets the same bits.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace amps {

/// Disks on a surface. `facets` and `barycentrics` say where on the input mesh each sample lies, so that anything stored per
/// vertex or facet (UVs, colours, weights) can be interpolated; both are empty in a set that came without them (from a file).
///
/// Of each sample that amps makes, the position is exactly b0·c0 + b1·c1 + b2·c2, c the corners of its facet: three products
/// a coordinate, each rounded, and two sums from left to right, each rounded.
struct SampleSet {
  Points positions;           ///< #S by 3
  std::vector<double> radii;  ///< #S, > 0
  std::vector<Index> facets;  ///< #S or empty
  Points barycentrics;        ///< #S by 3 or empty; rows are non-negative and sum to 1 (to rounding)
  /// On what of the surface each sample was placed: #S each, of the sets of remesh() where disks know their surface; else
  /// empty.
  std::vector<std::uint8_t> dimensions = {};  ///< 0: on a corner; 1: on a curve; 2: on a facet
  std::vector<Index> curves = {};             ///< in CurveGraph::corners, or CurveGraph::curves; kNone on a facet
  std::vector<double> parameters = {};        ///< length along the curve from its start, absolute units; else 0
  Index size() const { return static_cast<Index>(positions.rows()); }
};

/// How far apart two disks of different radii must be (Mitchell, Rand, Ebeida & Bajaj, "Variable radii Poisson-disk sampling",
/// CCCG 2012).
enum class ConflictRule {
  /// |p_i − p_j| ≥ max(r_i, r_j): no disk covers another's centre ("bigger disks"). The rule of the papers that sampling.h
  /// names and of everything this library promises: no sample is ever hidden in the power diagram.
  kMax,
  /// |p_i − p_j| ≥ min(r_i, r_j) ("smaller disks"): small samples come up to large ones, so sets are denser where radii change
  /// (at gradation 0.1, 0.25 and 0.5 by about 1, 4 and 8 % beside kMax). Darts of the second stage keep r(p). Samples of
  /// a field of gradation L (|r(p) − r(q)| ≤ L·|p − q|) own their position in the power diagram if L < √2 − 1: with d ≥ r_j and
  /// r_i ≤ r_j + L·d, r_i² − r_j² ≤ 2L·d·r_j + L²d² ≤ (2L + L²)·d² < d². In steeper fields a small sample may hide behind a
  /// large one: it stays in the set, the surface is still covered, but the mesh dual to the diagram has no vertex there.
  kMin,
};

/// What a disk is.
enum class Neighborhood {
  /// As the function that is asked says.
  kDefault,
  /// The part of the surface in the ball around the sample: the paper's disks, which join sheets nearer than 2r, and close
  /// cracks.
  kSpace,
  /// What of that is joined to the sample within the ball: sheets do not see each other's disks, however near they are. With
  /// ConflictRule::kMax only.
  kSurface,
};

namespace detail {

/// Where a point of a mesh is. Law: position_of(mesh, at) == at.position, bit for bit, for each `at` made by the two functions
/// below.
inline Vec3 position_of(const MeshView& mesh, Index facet, const Vec3& barycentric) {
  return barycentric[0] * mesh.corner(facet, 0) + barycentric[1] * mesh.corner(facet, 1) +
         barycentric[2] * mesh.corner(facet, 2);
}
inline Vec3 position_of(const MeshView& mesh, const SurfacePoint& at) { return position_of(mesh, at.facet, at.barycentric); }

/// The point of the facet with these barycentric coordinates.
inline SurfacePoint surface_point_at(const MeshView& mesh, Index facet, const Vec3& barycentric) {
  return {facet, barycentric, position_of(mesh, facet, barycentric)};
}

/// Unit normal of a facet with area, at any scale whose squares a double holds.
inline Vec3 normal_of(const MeshView& mesh, Index facet) {
  const Vec3 a = mesh.corner(facet, 0);
  return stable_normalized((mesh.corner(facet, 1) - a).cross(mesh.corner(facet, 2) - a));
}

/// The point of the facet below x, which lies in its plane up to rounding. Not finite where rounding leaves the facet no area.
SurfacePoint surface_point_below(const MeshView& mesh, Index facet, const Vec3& x);

/// One disk, in a set or on its way into one.
struct Sample {
  SurfacePoint at;  ///< facet kNone: not known; then only the position counts
  double radius = 0;
  const Vec3& position() const { return at.position; }
};

/// A sample that does not lie on a curve.
struct FaceSample {
  Sample sample;
  bool of_darts;  ///< or of gap filling
};

/// Throws Error(kInvalidArgument) for disks that know their surface under the min rule.
void require_neighborhood(Neighborhood neighborhood, ConflictRule rule);

/// Throws Error(kInvalidArgument) if there is no sample, one is not finite, a radius is not positive, or facets and
/// barycentrics are given but not one a sample.
void require_sample_set(const SampleSet& samples);

/// The least and the greatest radius of a set that is not empty.
double min_radius(const SampleSet& samples);
double max_radius(const SampleSet& samples);

/// The sites' weights in a power diagram, r².
std::vector<double> weights_of(const std::vector<double>& radii);

/// Sample s of a set.
Sample sample_of(const SampleSet& samples, Index s);

/// A set while its size is not known yet.
class GrowingSet {
 public:
  Index size() const { return static_cast<Index>(radii_.size()); }
  void add(const Sample& sample);
  void add_all(const SampleSet& samples);
  /// Samples get new numbers: `order` lists the old ones, each once. Cancelled, it throws, and nothing has changed.
  void reorder(const std::vector<Index>& order, const Execution& execution = {});

  Vec3 position(Index s) const { return Eigen::Map<const Vec3>(positions_.data() + 3 * slot(s)); }
  Sample operator[](Index s) const;
  const std::vector<double>& radii() const { return radii_; }
  PointsView points() const { return {positions_.data(), size()}; }
  void reserve(std::size_t size);
  /// The set; this one is empty then.
  SampleSet finish();

 private:
  std::vector<double> positions_, barycentrics_, radii_;
  std::vector<Index> facets_;
};

}  // namespace detail

}  // namespace amps

#include "amps/host_macros_end.h"
