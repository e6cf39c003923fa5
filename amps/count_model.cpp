#define AMPS_OWN_SOURCE
#include "amps/count_model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace amps::detail {
namespace {

/// β: measured on the unit square with uniform radii.
constexpr double kSamplesPerBoundary = 0.255;

/// The part of the count that boundary edges may account for: cracks, which are no boundary of the shape, must not rule it.
constexpr double kMaxPartAtBoundary = 0.3;

/// γ: measured on the unit square with r linear in x. Of two disks the larger keeps others off.
constexpr double kLostToGradient = 0.07;

/// ∫|∇r| dA/r².
double gradient_integral(const MeshView& mesh, const SizingField& field, const Execution& execution) {
  double sum = 0;
  Ticker ticker(execution, field.num_pieces(), kElementsPerLook);
  for (std::size_t i = 0; i < field.num_pieces(); ++i) {
    ticker.tick();
    const SizingField::Piece piece = field.piece(i);
    std::array<Vec3, 3> x;
    for (std::size_t k = 0; k < 3; ++k) {
      x[k] = piece.corners[k][0] * mesh.corner(piece.facet, 0) + piece.corners[k][1] * mesh.corner(piece.facet, 1) +
             piece.corners[k][2] * mesh.corner(piece.facet, 2);
    }
    const Vec3 u = x[1] - x[0], v = x[2] - x[0];
    const double doubled_area = norm(u.cross(v));
    if (!(doubled_area > 0)) continue;
    const double slope = norm((piece.radii[1] - piece.radii[0]) * v - (piece.radii[2] - piece.radii[0]) * u) / doubled_area;
    sum += std::min(slope, 1.0) * field.density_integral(i);
  }
  return sum;
}

/// Of a maximal set in an interval that is long against r: samples per r.
constexpr double kSamplesPerLength = 0.748;

/// Of expected_fragments(): 2.7·√(F·S) for F equilateral facets of area A, S = κFA/r², is so much times their perimeters over
/// r.
constexpr double kCrossingsPerPerimeter = 0.5;

/// Lengths of components and what there is of boundary; over r, which is 1 without a field.
struct MeasuredLengths {
  double boundary = 0;    ///< ∫ds/r along the boundary of the surface, by Simpson's rule on each edge
  double longest = 0;     ///< the longest extent of a component along an axis, over the greatest radius
  double components = 0;  ///< the sum of these extents
};

/// `triangles`: by surface vertices. Empty flags: all count.
void measure_components(const MeshView& mesh, const Triangles& triangles, const std::vector<char>& counted,
                        MeasuredLengths& lengths, const Execution& execution) {
  const Index num_facets = mesh.num_facets();
  Ticker ticker(execution, 2 * slot(num_facets), kElementsPerLook);
  const auto n = slot(mesh.num_vertices());
  const auto counts = [&counted](Index f) { return counted.empty() || counted[slot(f)] != 0; };
  UnionFind sets(n);
  for (Index f = 0; f < num_facets; ++f) {
    ticker.tick();
    if (!counts(f)) continue;
    for (int k = 1; k < 3; ++k) sets.join(slot(triangles(f, 0)), slot(triangles(f, k)));
  }
  std::vector<Box> boxes(n);
  std::vector<char> used(n, 0);
  for (Index f = 0; f < num_facets; ++f) {
    ticker.tick();
    if (!counts(f)) continue;
    const std::size_t set = sets.find(slot(triangles(f, 0)));
    for (int k = 0; k < 3; ++k) {
      const Vec3 x = mesh.corner(f, k);
      boxes[set].min = used[set] != 0 ? boxes[set].min.cwiseMin(x).eval() : x;
      boxes[set].max = used[set] != 0 ? boxes[set].max.cwiseMax(x).eval() : x;
      used[set] = 1;
    }
  }
  for (std::size_t v = 0; v < n; ++v) {
    if (used[v] == 0) continue;
    const double extent = (boxes[v].max - boxes[v].min).maxCoeff();
    lengths.longest = std::max(lengths.longest, extent);
    lengths.components += extent;
  }
}

MeasuredLengths measure_lengths(const MeshView& mesh, const SurfaceEdges& edges, const SizingField& field,
                                const Execution& execution) {
  Ticker ticker(execution.part(0, 0.4), edges.size(), kElementsPerLook);
  MeasuredLengths lengths;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    ticker.tick();
    if (!edges[e].boundary()) continue;
    const EdgeSide side = edges[e][0];
    const int next = (side.k + 1) % 3;
    const auto inverse_radius = [&](double t) {
      Vec3 b = Vec3::Zero();
      b[side.k] = 1 - t;
      b[next] = t;
      return field.empty() ? 1.0 : 1 / field.radius(side.facet, b);
    };
    const double length = detail::norm(mesh.corner(side.facet, side.k) - mesh.corner(side.facet, next));
    lengths.boundary += length / 6 * (inverse_radius(0) + 4 * inverse_radius(0.5) + inverse_radius(1));
  }
  measure_components(mesh, edges.triangles(), edges.counted(), lengths, execution.part(0.4, 1));
  if (!field.empty()) {
    lengths.longest /= field.max_radius();
    lengths.components /= field.max_radius();
  }
  return lengths;
}

}  // namespace

ForeseenSize foresee_size(const MeshView& mesh, double area, const WantedRadii& radii, double most_samples,
                          const Execution& execution) {
  double longest = 0, perimeters = 0;
  const bool constant = radii.constant();
  Ticker ticker(execution, slot(mesh.num_facets()), kElementsPerLook);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    ticker.tick();
    const Vec3 a = mesh.corner(f, 0), b = mesh.corner(f, 1), c = mesh.corner(f, 2);
    const double ab = detail::norm(b - a), bc = detail::norm(c - b), ca = detail::norm(a - c);
    longest = std::max({longest, ab, bc, ca});
    double per_radius = 0;
    for (int k = 0; k < 3 && !constant; ++k) per_radius += 1 / radii.field().radius(f, Vec3::Unit(k)) / 3;
    perimeters += constant ? ab + bc + ca : (ab + bc + ca) * per_radius;
  }
  if (constant) perimeters /= radii.min();
  const double max = radii.max();
  ForeseenSize size{kSamplesPerDensity * radii.density_integral(area), longest / (2 * max),
                    kCrossingsPerPerimeter * perimeters};
  // The extent of a component is at most half of the perimeters of its facets.
  if (kSamplesPerLength * perimeters / 2 < most_samples) return size;
  MeasuredLengths lengths;
  measure_components(mesh, merge_equal_vertices(mesh).triangles, {}, lengths, {});
  const Box box = bounding_box(mesh);
  double room = 1;  // no two samples in a voxel of diagonal r
  for (int axis = 0; axis < 3; ++axis) room *= 1 + std::sqrt(3.0) * (box.max[axis] - box.min[axis]) / max;
  size.by_length = std::max(size.by_length, std::min(room, kSamplesPerLength * lengths.components / max));
  return size;
}

CountModel::CountModel(const MeshView& mesh, const SurfaceEdges& edges, double area, const SizingField& field, Index target,
                       const Execution& execution)
    : target_(target), inner_(kSamplesPerDensity * (field.empty() ? area : field.density_integral())) {
  const MeasuredLengths lengths = measure_lengths(mesh, edges, field, execution.part(0, 0.5));
  border_ = std::min(kSamplesPerBoundary * lengths.boundary, kMaxPartAtBoundary * std::sqrt(target_ * inner_));
  if (!field.empty()) border_ -= kLostToGradient * kSamplesPerDensity * gradient_integral(mesh, field, execution.part(0.5, 1));
  const double least_scale = lengths.longest / (2 * target_);
  if (scale() < least_scale) {
    least_scale_ = least_scale;
    needle_scale_ = kSamplesPerLength * lengths.components / target_;
  }
}

double CountModel::scale() const {
  if (needle_scale_ > 0) return std::max(least_scale_, needle_scale_);
  const double wanted = target_ / factor_;
  return (border_ + std::sqrt(border_ * border_ + 4 * inner_ * wanted)) / (2 * wanted);
}

void CountModel::learn(Index count) {
  const double s = scale();
  if (needle_scale_ > 0) {  // to the power 3/4: errors fall by their root at least, whether counts fall with s or s²
    const double root = std::sqrt(count / target_);
    needle_scale_ = s * root * std::sqrt(root);
    return;
  }
  const double seen = count / (inner_ / (s * s) + border_ / s);
  const double far = 0.03 + 1 / std::sqrt(target_);
  near_runs_ = std::fabs(count - target_) > far * target_ ? 0 : near_runs_ + 1;
  factor_ += (seen - factor_) / std::max(1, near_runs_);
}

}  // namespace amps::detail
