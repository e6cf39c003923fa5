// fragment_gaps.h (internal): the gaps of a restricted power diagram, fragment by fragment, and the points of facets that fill
// them.
#pragma once

#include "amps/base.h"
#include "amps/gaps.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"

#include <cmath>
#include <cstddef>

namespace amps::detail {

inline Vec3 position_of(const MeshView& mesh, const SurfacePoint& at) {
  return at.barycentric[0] * mesh.corner(at.facet, 0) + at.barycentric[1] * mesh.corner(at.facet, 1) +
         at.barycentric[2] * mesh.corner(at.facet, 2);
}

/// Unit normal of a facet with area, at any scale whose squares a double holds.
inline Vec3 normal_of(const MeshView& mesh, Index facet) {
  const Vec3 a = mesh.corner(facet, 0);
  return (mesh.corner(facet, 1) - a).cross(mesh.corner(facet, 2) - a).stableNormalized();
}

/// The point of the facet below x, which lies in its plane up to rounding.
inline SurfacePoint surface_point(const MeshView& mesh, Index facet, const Vec3& x) {
  const Vec3 a = mesh.corner(facet, 0), b = mesh.corner(facet, 1), c = mesh.corner(facet, 2);
  const Vec3 normal = normal_of(mesh, facet);
  Vec3 weight((b - x).cross(c - x).dot(normal), (c - x).cross(a - x).dot(normal), (a - x).cross(b - x).dot(normal));
  weight = weight.cwiseMax(0.0);
  return {facet, weight / weight.sum()};
}

inline FragmentView fragment_view(const MeshView& mesh, const RestrictedPowerDiagram::Polygon& polygon) {
  return {polygon.corners, static_cast<std::size_t>(polygon.size), normal_of(mesh, polygon.facet)};
}

inline Ball ball_of(const WeightedPoint& site) { return {site.position(), site.w}; }

inline bool fragment_has_gap(const RestrictedPowerDiagram& diagram, const RestrictedPowerDiagram::Polygon& polygon) {
  return has_gap({polygon.corners, static_cast<std::size_t>(polygon.size), Vec3::UnitZ()}, ball_of(diagram.site(polygon.site)));
}

/// The radius of a new sample where `wanted` is wanted and the nearest sample is at this squared distance: by the max rule no
/// more than that distance, and less by more than the rounding of its square, so that the weight in the diagram is below all
/// exact squared distances, and the new site hides no other.
inline double radius_below(double wanted, double nearest_squared) {
  constexpr double kBelowRounding = 1 - 0x1p-50;  // eight units of roundoff: three squares and their sum
  const double most = nearest_squared * kBelowRounding;
  if (!(most < wanted * wanted)) return wanted;
  double r = std::sqrt(most);
  while (r * r > most) r = std::nextafter(r, 0.0);
  return r;
}

}  // namespace amps::detail
