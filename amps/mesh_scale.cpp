#define AMPS_OWN_SOURCE
#include "amps/mesh_scale.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

namespace amps::detail {
namespace {

/// The largest finite coordinate, absolute.
double largest_coordinate(const PointsView& points) {
  double largest = 0;
  for (std::ptrdiff_t i = 0; i < points.rows(); ++i) {
    const double x = points[i].cwiseAbs().maxCoeff<Eigen::PropagateNumbers>();
    if (x > largest && x <= std::numeric_limits<double>::max()) largest = x;
  }
  return largest;
}

/// The same of vertices that facets use, where it could be far from 1; else any number near it.
double largest_used_coordinate(const MeshView& mesh) {
  constexpr double kLarge = 0x1p52, kSmall = 0x1p-52;  // within the safe range
  const auto in_range = [&](Index v) { return v >= 0 && v < mesh.num_vertices(); };
  double largest = 0;
  // Mostly the first facet tells that coordinates are not small, and vertices are fewer.
  for (Index f = 0; f < std::min(mesh.num_facets(), Index{64}); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index v = mesh.triangles(f, k);
      if (in_range(v)) largest = std::max(largest, mesh.vertices[v].cwiseAbs().maxCoeff<Eigen::PropagateNumbers>());
    }
  }
  if (largest > kSmall && largest_coordinate(mesh.vertices) < kLarge) return 1;
  largest = 0;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index v = mesh.triangles(f, k);
      if (!in_range(v)) continue;
      for (int c = 0; c < 3; ++c) {
        const double x = std::fabs(mesh.vertices(v, c));
        if (x > largest && x <= std::numeric_limits<double>::max()) largest = x;
      }
    }
  }
  return largest;
}

}  // namespace

MeshScale::MeshScale(int exponent)
    : exponent_(exponent), unit_(std::ldexp(1.0, exponent)), inverse_(std::ldexp(1.0, -exponent)) {}

int MeshScale::exponent_for(double largest) {
  if (!(largest > 0)) return 0;
  int exponent = 0;
  std::frexp(largest, &exponent);
  // So that the unit and its inverse are normal doubles.
  return std::abs(exponent) <= kSafeExponent ? 0 : std::clamp(exponent, -1022, 1022);
}

MeshScale::MeshScale(const MeshView& mesh) : MeshScale(exponent_for(largest_used_coordinate(mesh))) {}

MeshScale::MeshScale(const MeshView& first, const MeshView& second)
    : MeshScale(exponent_for(std::max(largest_used_coordinate(first), largest_used_coordinate(second)))) {}

MeshScale::MeshScale(const PointsView& points) : MeshScale(exponent_for(largest_coordinate(points))) {}

MeshScale MeshScale::of_length(double length) { return MeshScale(std::isfinite(length) ? exponent_for(length) : 0); }

double MeshScale::coordinate(double x) const {
  const double y = x * inverse_;
  return std::isinf(y) && !std::isinf(x) ? std::copysign(std::numeric_limits<double>::max(), x) : y;
}

double MeshScale::length(double x) const {
  const double y = coordinate(x);
  return y == 0 && x != 0 ? std::copysign(std::numeric_limits<double>::min(), x) : y;
}

Points MeshScale::points(const PointsView& points) const {
  Points result(points.rows());
  for (std::ptrdiff_t i = 0; i < points.rows(); ++i) result.row(i) = point(points[i]).transpose();
  return result;
}

std::vector<double> MeshScale::lengths(const std::vector<double>& lengths) const {
  std::vector<double> result;
  result.reserve(lengths.size());
  for (const double x : lengths) result.push_back(length(x));
  return result;
}

Mesh MeshScale::mesh(const MeshView& mesh) const {
  Mesh result;
  result.vertices = points(mesh.vertices);
  result.triangles.resize(mesh.num_facets());
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    for (int k = 0; k < 3; ++k) result.triangles(f, k) = mesh.triangles(f, k);
  }
  return result;
}

void MeshScale::back(std::vector<double>& lengths) const {
  for (double& x : lengths) x *= unit_;
}

void MeshScale::back(Points& points) const { points.map() *= unit_; }

}  // namespace amps::detail
