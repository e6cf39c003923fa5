#define AMPS_OWN_SOURCE
#include "amps/sizing_lattice.h"

#include "amps/mesh_edges.h"
#include "amps/portable_math.h"

namespace amps::detail {

void refuse_sizing(const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "sizing: " + what); }

std::shared_ptr<SizingLattice> make_lattice(Mesh mesh, std::vector<double> areas, std::vector<std::uint8_t> levels,
                                            const Execution& execution) {
  auto lattice = std::make_shared<SizingLattice>();
  lattice->mesh = std::move(mesh);
  lattice->areas = std::move(areas);
  if (std::all_of(levels.begin(), levels.end(), [](std::uint8_t level) { return level == 0; })) return lattice;
  lattice->levels = std::move(levels);
  const std::size_t n = lattice->levels.size();
  lattice->first_node.assign(n + 1, 0);
  lattice->first_piece.assign(n + 1, 0);
  for_each_index(n, execution.part(0, 0.3), [&](std::size_t f) {
    const Index k = Index{1} << lattice->levels[f];
    lattice->first_node[f + 1] = lattice->first_node[f] + nodes_of_lattice(k);
    lattice->first_piece[f + 1] = lattice->first_piece[f] + slot(k) * slot(k);
  });
  lattice->piece_facet.resize(lattice->first_piece[n]);
  for_each_index(n, execution.part(0.3, 1), [&](std::size_t f) {
    std::fill(lattice->piece_facet.begin() + static_cast<std::ptrdiff_t>(lattice->first_piece[f]),
              lattice->piece_facet.begin() + static_cast<std::ptrdiff_t>(lattice->first_piece[f + 1]), static_cast<Index>(f));
  });
  return lattice;
}

std::vector<std::size_t> first_sides(const TrianglesView& triangles, Index num_vertices, const Execution& execution) {
  const MeshEdges edges(triangles, num_vertices, {}, execution.part(0, 0.7));
  std::vector<std::size_t> first(edges.num_corners());
  for_each_index(edges.size(), execution.part(0.7, 1), [&](std::size_t e) {
    for (const EdgeSide& side : edges[e]) first[side.corner()] = edges[e][0].corner();
  });
  return first;
}

namespace {

/// (ln b − ln a)/(b − a), also for a = b; the same bits at any power of two, scaled.
double log_slope(double a, double b) {
  const double s = (b - a) / (b + a);
  return std::abs(s) < 0.17 ? 2 * portable_atanh_over(s) / (a + b) : portable_log(b / a) / (b - a);
}

}  // namespace

// By Hermite–Genocchi it is 2·F[r₀, r₁, r₂] with F'' = 1/r², so F = −ln. Where the radii differ little the divided difference
// cancels (its relative error is about ε/spread²); there, with deviations x_i from the mean m in units of m, the mean of
// 1/(1 + x)² = Σ (−1)ⁿ (n + 1) xⁿ is Σ (−1)ⁿ 2/(n + 2) · h_n(x₀, x₁, x₂): h_n, the complete homogeneous polynomial, follows
// from h_n = e₁ h_{n−1} − e₂ h_{n−2} + e₃ h_{n−3}, and e₁ = 0. Logarithms are portable ones, since the integrals decide where
// darts go.
double mean_inverse_square(const std::array<double, 3>& radii) {
  double a = radii[0], b = radii[1], c = radii[2];
  if (a > b) std::swap(a, b);
  if (b > c) std::swap(b, c);
  if (a > b) std::swap(a, b);
  constexpr double kSeriesSpread = 0.1;
  if (c - a > kSeriesSpread * a) return 2 * (log_slope(a, b) - log_slope(b, c)) / (c - a);
  const double m = a + ((b - a) + (c - a)) / 3;
  const double x = (a - m) / m, y = (b - m) / m, z = -(x + y);
  const double e2 = x * y + z * (x + y), e3 = x * y * z;
  double h3 = 0, h2 = 0, h1 = 1, sum = 1;  // h_{n−3}, h_{n−2}, h_{n−1}
  // |x_i| ≤ 0.067, h_n ≤ (n + 1)(n + 2)/2 · 0.067ⁿ: the remainder is below 1e-15.
  for (int n = 1; n <= 14; ++n) {
    const double h = -e2 * h2 + e3 * h3;
    sum += (n % 2 == 0 ? 2.0 : -2.0) / (n + 2) * h;
    h3 = h2;
    h2 = h1;
    h1 = h;
  }
  return sum / (m * m);
}

}  // namespace amps::detail
