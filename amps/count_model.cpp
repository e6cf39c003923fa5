#define AMPS_OWN_SOURCE
#include "amps/count_model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace amps::detail {
namespace {

/// β: measured on the unit square with uniform radii, n from 10³ to 10⁵; the same with gradations up to 0.1.
constexpr double kSamplesPerBoundary = 0.255;

/// Boundary that is none (cracks) must not rule the count.
constexpr double kMostAtBoundary = 0.3;

/// γ: measured on the unit square with r linear in x, slopes from 0.01 to 0.3: of two disks the larger keeps others off.
constexpr double kLostToGradient = 0.07;

/// ∫|∇r| dA/r².
double gradient_integral(const MeshView& mesh, const SizingField& field) {
  double sum = 0;
  for (std::size_t i = 0; i < field.num_pieces(); ++i) {
    const SizingField::Piece piece = field.piece(i);
    std::array<Vec3, 3> x;
    for (std::size_t k = 0; k < 3; ++k) {
      x[k] = piece.corners[k][0] * mesh.corner(piece.facet, 0) + piece.corners[k][1] * mesh.corner(piece.facet, 1) +
             piece.corners[k][2] * mesh.corner(piece.facet, 2);
    }
    const Vec3 u = x[1] - x[0], v = x[2] - x[0];
    const double doubled_area = u.cross(v).norm();
    if (!(doubled_area > 0)) continue;
    const double slope = ((piece.radii[1] - piece.radii[0]) * v - (piece.radii[2] - piece.radii[0]) * u).norm() / doubled_area;
    sum += std::min(slope, 1.0) * field.density_integral(i);
  }
  return sum;
}

/// ∫ds/r along the boundary of the surface (r = 1 without a field), by Simpson's rule on each edge.
double boundary_integral(const MeshView& mesh, const SizingField& field) {
  struct Side {
    Index end;  ///< the greater vertex of the edge; the lesser has a list of these
    Index facet;
    int corner;
  };
  const Mesh merged = merge_equal_vertices(mesh);  // soups have no boundary but the surface's
  const auto lesser_end = [&](Index f, int k) { return std::min(merged.triangles(f, k), merged.triangles(f, (k + 1) % 3)); };
  std::vector<std::size_t> begin(slot(static_cast<Index>(merged.vertices.rows())) + 2, 0);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    for (int k = 0; k < 3; ++k) ++begin[slot(lesser_end(f, k)) + 2];
  }
  for (std::size_t v = 2; v < begin.size(); ++v) begin[v] += begin[v - 1];
  std::vector<Side> sides(3 * slot(mesh.num_facets()));
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index end = std::max(merged.triangles(f, k), merged.triangles(f, (k + 1) % 3));
      sides[begin[slot(lesser_end(f, k)) + 1]++] = {end, f, k};
    }
  }
  double sum = 0;
  for (std::size_t v = 0; v + 1 < begin.size(); ++v) {
    const auto first = sides.begin() + static_cast<std::ptrdiff_t>(begin[v]);
    const auto last = sides.begin() + static_cast<std::ptrdiff_t>(begin[v + 1]);
    std::sort(first, last, [](const Side& a, const Side& b) { return a.end != b.end ? a.end < b.end : a.facet < b.facet; });
    for (auto at = first; at != last; ++at) {
      const Side& side = *at;
      if ((at != first && (at - 1)->end == side.end) || (at + 1 != last && (at + 1)->end == side.end)) continue;
      const int next = (side.corner + 1) % 3;
      const auto inverse_radius = [&](double t) {
        Vec3 b = Vec3::Zero();
        b[side.corner] = 1 - t;
        b[next] = t;
        return field.empty() ? 1.0 : 1 / field.radius(side.facet, b);
      };
      const double length = (mesh.corner(side.facet, side.corner) - mesh.corner(side.facet, next)).norm();
      sum += length / 6 * (inverse_radius(0) + 4 * inverse_radius(0.5) + inverse_radius(1));
    }
  }
  return sum;
}

}  // namespace

CountModel::CountModel(const MeshView& mesh, const SizingField& field, Index target)
    : target_(target), inner_(kSamplesPerDensity * (field.empty() ? total_area(mesh) : field.density_integral())) {
  border_ = std::min(kSamplesPerBoundary * boundary_integral(mesh, field), kMostAtBoundary * std::sqrt(target_ * inner_));
  if (!field.empty()) border_ -= kLostToGradient * kSamplesPerDensity * gradient_integral(mesh, field);
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
