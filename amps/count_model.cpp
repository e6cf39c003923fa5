#define AMPS_OWN_SOURCE
#include "amps/count_model.h"

#include "amps/mesh_edges.h"

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

/// ∫ds/r along the boundary of the surface (r = 1 without a field), by Simpson's rule on each edge.
double boundary_integral(const MeshView& mesh, const SizingField& field, const Execution& execution) {
  const Mesh merged = merge_equal_vertices(mesh, execution.part(0, 0.3));  // soups have no boundary but the surface's
  std::vector<char> counted(slot(mesh.num_facets()), 1);  // a sheet that is there twice has the boundary of one
  for (const Index f : find_repeated_facets(mesh, execution.part(0.3, 0.4))) counted[slot(f)] = 0;
  const MeshEdges edges(merged.triangles, static_cast<Index>(merged.vertices.rows()), counted, execution.part(0.4, 0.9));
  Ticker ticker(execution.part(0.9, 1), edges.size(), kElementsPerLook);
  double sum = 0;
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
    const double length = norm(mesh.corner(side.facet, side.k) - mesh.corner(side.facet, next));
    sum += length / 6 * (inverse_radius(0) + 4 * inverse_radius(0.5) + inverse_radius(1));
  }
  return sum;
}

}  // namespace

CountModel::CountModel(const MeshView& mesh, const SizingField& field, Index target, const Execution& execution)
    : target_(target), inner_(kSamplesPerDensity * (field.empty() ? total_area(mesh) : field.density_integral())) {
  border_ = std::min(kSamplesPerBoundary * boundary_integral(mesh, field, execution.part(0, 0.5)),
                     kMaxPartAtBoundary * std::sqrt(target_ * inner_));
  if (!field.empty()) border_ -= kLostToGradient * kSamplesPerDensity * gradient_integral(mesh, field, execution.part(0.5, 1));
}

double CountModel::scale() const {
  const double wanted = target_ / factor_;
  return (border_ + std::sqrt(border_ * border_ + 4 * inner_ * wanted)) / (2 * wanted);
}

void CountModel::learn(Index count) {
  const double s = scale();
  const double seen = count / (inner_ / (s * s) + border_ / s);
  const double far = 0.03 + 1 / std::sqrt(target_);
  near_runs_ = std::fabs(count - target_) > far * target_ ? 0 : near_runs_ + 1;
  factor_ += (seen - factor_) / std::max(1, near_runs_);
}

}  // namespace amps::detail
