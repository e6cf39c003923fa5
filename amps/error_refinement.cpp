#define AMPS_OWN_SOURCE
#include "amps/error_refinement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace amps::detail {
namespace {

/// Distances above this share of the error are lowered too, once some are above the error: or the next round finds these.
constexpr double kErrorAim = 0.9;
/// The least and the greatest share of a radius that one round leaves of it.
constexpr double kMinErrorShare = 0.3;
constexpr double kMaxErrorShare = 0.85;
/// Where so small a share of the triangles is left, samples matter less than rounds: radii fall by this factor more.
constexpr double kFewTriangles = 0.002;
constexpr double kFactorOfFew = 0.7;
/// Radii fall to this share of the error, and of the diagonal: far below it grids are out of proportion.
constexpr double kErrorFloor = 0.5;
constexpr double kDiagonalFloor = 1e-5;

std::array<Vec3, 3> corners_of_facet(const MeshView& mesh, Index f) {
  return {mesh.corner(f, 0), mesh.corner(f, 1), mesh.corner(f, 2)};
}

}  // namespace

SizingField error_sizing(const MeshView& mesh, double error, const Execution& execution) {
  constexpr double kFlatRadius = 0.25;
  const double diagonal = bounding_box(mesh).diagonal(), greatest = kFlatRadius * diagonal;
  if (error >= greatest) return uniform_sizing(mesh, greatest, execution);
  CurvatureOptions options;
  options.max_error = error;
  options.max_radius = greatest;
  const double least = std::max(error, kDiagonalFloor * diagonal);
  return curvature_sizing(mesh, options, execution.part(0, 0.6))
      .clamped(least, greatest)
      .limited(kDefaultGradation, execution.part(0.6, 1));
}

SizingField error_sizing_of_count(const MeshView& mesh, double count, const Execution& execution) {
  // The count falls as the error grows, until all radii are as large as they may be.
  constexpr int kBisections = 12;
  constexpr double kLeast = 1e-5, kGreatest = 0.1;  // of the diagonal
  const double diagonal = bounding_box(mesh).diagonal();
  double low = kLeast, high = kGreatest;
  SizingField field;
  for (int k = 0; k < kBisections; ++k) {
    const double middle = std::sqrt(low * high);
    field = error_sizing(mesh, middle * diagonal, execution.part(double(k) / kBisections, double(k + 1) / kBisections));
    (kSamplesPerDensity * field.density_integral() > count ? low : high) = middle;
  }
  return field;
}

DistanceReport measure_error(const MeshView& mesh, const Mesh& result, double error, const Execution& execution) {
  constexpr double kTolerance = 1e-3;  // of the error
  DistanceOptions options;
  constexpr double kCoarse = 0.1;
  options.spacing = kCoarse;  // means are not asked for
  options.tolerance = std::clamp(kTolerance * error / bounding_box(mesh).diagonal(), 1e-12, options.tolerance);
  options.execution = execution;
  return surface_distance(mesh, result, options);
}

ErrorSearch::ErrorSearch(const MeshView& mesh, const Execution& execution)
    : mesh_(mesh), diagonal_(bounding_box(mesh).diagonal()), tree_(mesh, execution) {}

ErrorCaps ErrorSearch::look(const Mesh& result, const SampleSet& samples, double error, const Execution& execution) {
  const bool first = std::exchange(first_, false);
  const double aim = kErrorAim * error, floor = std::max(kErrorFloor * error, kDiagonalFloor * diagonal_);
  const MeshView output(result);
  std::vector<double> farthest(slot(output.num_facets()), 0);  // by triangle of the result
  ErrorCaps found;
  const auto raise = [&](Index t, double d) {
    found.farthest = std::max(found.farthest, d);
    farthest[slot(t)] = std::max(farthest[slot(t)], d);
  };
  for (const FarPoint& p : far_points(output, mesh_, tree_, aim, execution.part(0, 0.4))) raise(p.facet, p.distance);
  std::vector<FarPoint> of_surface;
  // Mostly what is far in one direction is far in the other.
  if (first || !(found.farthest > error)) {
    const SurfaceTree of_result(output, execution.part(0.4, 0.5));
    of_surface = far_points(mesh_, output, of_result, aim, execution.part(0.5, 1));
    for (const FarPoint& p : of_surface) raise(p.nearest, p.distance);
  }
  const auto num_far =
      static_cast<double>(std::count_if(farthest.begin(), farthest.end(), [aim](double d) { return d > aim; }));
  const bool few = num_far < kFewTriangles * output.num_facets();
  // Of a smooth surface, which a disk has many facets of, the distance is as the square of the radius, and at edges of larger
  // facets as the radius.
  const auto share_at = [&](Index s, double d) {
    const double radius = samples.radii[slot(s)];
    const std::array<Vec3, 3> x = corners_of_facet(mesh_, samples.facets[slot(s)]);
    const bool smooth = detail::squared_norm((x[1] - x[0]).cross(x[2] - x[0])) < radius * radius * radius * radius;
    const double left = std::clamp(smooth ? std::sqrt(aim / d) : aim / d, kMinErrorShare, kMaxErrorShare);
    return few ? kFactorOfFew * left : left;
  };
  std::vector<double> share(slot(samples.size()), 1);
  for (Index t = 0; t < output.num_facets(); ++t) {
    const double d = farthest[slot(t)];
    if (!(d > aim)) continue;
    for (int k = 0; k < 3; ++k) {
      const Index s = output.triangles(t, k);
      share[slot(s)] = std::min(share[slot(s)], share_at(s, d));
    }
  }
  for (Index s = 0; s < samples.size(); ++s) {
    const double radius = samples.radii[slot(s)];
    if (share[slot(s)] < 1 && radius > floor) {
      found.caps.push_back({samples.positions.row(s).transpose(), std::max(floor, share[slot(s)] * radius)});
    }
  }
  // Where the nearest triangle is as small as it may become, a larger one elsewhere stands for this part of the surface.
  for (const FarPoint& p : of_surface) {
    double greatest = 0;
    for (int k = 0; k < 3; ++k) greatest = std::max(greatest, samples.radii[slot(output.triangles(p.nearest, k))]);
    if (greatest <= floor) found.caps.push_back({p.position, kMaxErrorShare * p.distance});
  }
  return found;
}

double expected_under(const CapField& caps, const Mesh& result, const SampleSet& samples) {
  const MeshView output(result);
  double density = 0;
  for (Index t = 0; t < output.num_facets(); ++t) {
    const std::array<Vec3, 3> x = corners_of_facet(output, t);
    const double area = 0.5 * norm((x[1] - x[0]).cross(x[2] - x[0]));
    const double radius = caps.at((x[0] + x[1] + x[2]) / 3, samples.radii[slot(output.triangles(t, 0))]);
    density += area / (radius * radius);
  }
  return kSamplesPerDensity * density;
}

}  // namespace amps::detail
