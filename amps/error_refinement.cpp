#define AMPS_OWN_SOURCE
#include "amps/error_refinement.h"

#include "amps/surface_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace amps::detail {
namespace {

/// Points are looked at on a lattice of so many steps a side, and not farther apart than a share of the radius there.
constexpr int kLookSteps = 4;
constexpr double kLookSpacing = 0.25;
/// On a facet of the input, at most.
constexpr int kMaxLookSteps = 256;
/// Distances above this share of the error are lowered too, once some are above the error: or the next round finds these.
constexpr double kErrorAim = 0.9;
/// The least and the greatest share of a radius that one round leaves of it.
constexpr double kMinErrorShare = 0.35;
constexpr double kMaxErrorShare = 0.85;
/// Radii fall to this share of the error, and of the diagonal: far below it grids are out of proportion.
constexpr double kErrorFloor = 0.5;
constexpr double kDiagonalFloor = 1e-5;

/// Calls use(x) for points of a triangle, its corners and sides included.
template <class Use>
void for_each_lattice_point(const std::array<Vec3, 3>& corners, int steps, const Use& use) {
  for (int i = 0; i <= steps; ++i) {
    for (int j = 0; i + j <= steps; ++j) {
      const double u = static_cast<double>(i) / steps, v = static_cast<double>(j) / steps;
      use((1 - u - v) * corners[0] + u * corners[1] + v * corners[2]);
    }
  }
}

std::array<Vec3, 3> corners_of_facet(const MeshView& mesh, Index f) {
  return {mesh.corner(f, 0), mesh.corner(f, 1), mesh.corner(f, 2)};
}

double longest_side(const std::array<Vec3, 3>& x) {
  return std::sqrt(std::max({squared_norm(x[1] - x[0]), squared_norm(x[2] - x[1]), squared_norm(x[0] - x[2])}));
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

DistanceReport measure_error(const MeshView& mesh, const Mesh& result, double error, const Execution& execution) {
  constexpr double kTolerance = 1e-3;  // of the error
  DistanceOptions options;
  options.tolerance = std::clamp(kTolerance * error / bounding_box(mesh).diagonal(), 1e-12, options.tolerance);
  options.execution = execution;
  return surface_distance(mesh, result, options);
}

std::vector<RadiusCap> error_caps(const MeshView& mesh, const Mesh& result, const SampleSet& samples, double error,
                                  const DistanceReport& distance, const Execution& execution) {
  const MeshView output(result);
  std::vector<double> farthest(slot(output.num_facets()), 0);  // by triangle of the result
  const auto raise = [&farthest](Index t, double d) { farthest[slot(t)] = std::max(farthest[slot(t)], d); };
  const auto radius_at = [&](Index t) {
    double least = samples.radii[slot(output.triangles(t, 0))];
    for (int k = 1; k < 3; ++k) least = std::min(least, samples.radii[slot(output.triangles(t, k))]);
    return least;
  };

  const SurfaceTree of_input(mesh, execution.part(0, 0.1));
  constexpr std::uint64_t kFacetsPerLook = 64;
  Ticker backward(execution.part(0.1, 0.5), slot(output.num_facets()), kFacetsPerLook);
  for (Index t = 0; t < output.num_facets(); ++t) {
    backward.tick();
    Index hint = kNone;
    for_each_lattice_point(corners_of_facet(output, t), kLookSteps, [&](const Vec3& x) {
      const SurfaceHit hit = of_input.nearest(x, hint);
      hint = hit.point.facet;
      raise(t, hit.distance);
    });
  }

  const SurfaceTree of_output(output, execution.part(0.5, 0.6));
  Ticker forward(execution.part(0.6, 1), slot(mesh.num_facets()), kFacetsPerLook);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    forward.tick();
    const std::array<Vec3, 3> corners = corners_of_facet(mesh, f);
    Index hint = of_output.nearest(corners[0]).point.facet;
    const double steps = std::ceil(longest_side(corners) / (kLookSpacing * radius_at(hint)));
    for_each_lattice_point(corners, static_cast<int>(std::clamp(steps, 1.0, double{kMaxLookSteps})), [&](const Vec3& x) {
      const SurfaceHit hit = of_output.nearest(x, hint);
      hint = hit.point.facet;
      raise(hint, hit.distance);
    });
  }
  // What lies between the points looked at.
  raise(of_output.nearest(distance.forward.farthest.position).point.facet, distance.forward.hausdorff);
  raise(of_output.nearest(distance.backward.farthest.position).point.facet, distance.backward.hausdorff);

  const double floor = std::max(kErrorFloor * error, kDiagonalFloor * bounding_box(mesh).diagonal());
  std::vector<double> share(slot(samples.size()), 1);
  for (Index t = 0; t < output.num_facets(); ++t) {
    const double aim = kErrorAim * error, d = farthest[slot(t)];
    if (!(d > aim)) continue;
    const double left = std::clamp(std::sqrt(aim / d), kMinErrorShare, kMaxErrorShare);
    for (int k = 0; k < 3; ++k) {
      double& least = share[slot(output.triangles(t, k))];
      least = std::min(least, left);
    }
  }
  std::vector<RadiusCap> caps;
  for (Index s = 0; s < samples.size(); ++s) {
    const double radius = samples.radii[slot(s)];
    if (share[slot(s)] < 1 && radius > floor) {
      caps.push_back({samples.positions.row(s).transpose(), std::max(floor, share[slot(s)] * radius)});
    }
  }
  return caps;
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
