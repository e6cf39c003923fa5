// sizing_lattice.h (internal): the tables behind SizingField. Each facet carries a lattice of k² congruent triangles with a
// value at each node; here are the places of nodes and triangles, interpolation, and the integral that counts samples.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/sizing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace amps::detail {

/// Where the nodes are. With k = 2^level, node (i, j), i + j ≤ k, of a facet has barycentrics (k − i − j, i, j)/k; nodes are
/// stored by j, then i. Piece t of a facet lies in row j; rows alternate upward and downward triangles.
struct SizingLattice {
  Mesh mesh;
  std::vector<double> areas;             ///< by facet
  std::vector<std::uint8_t> levels;      ///< by facet; this and what follows is empty if all are 0
  std::vector<std::size_t> first_node;   ///< #F + 1
  std::vector<std::size_t> first_piece;  ///< #F + 1
  std::vector<Index> piece_facet;

  Index num_facets() const { return static_cast<Index>(mesh.triangles.rows()); }
  bool simple() const { return levels.empty(); }
  int level(Index f) const { return simple() ? 0 : levels[slot(f)]; }
  Index k(Index f) const { return Index{1} << level(f); }
  std::size_t node(Index f) const { return simple() ? 3 * slot(f) : first_node[slot(f)]; }
  std::size_t piece(Index f) const { return simple() ? slot(f) : first_piece[slot(f)]; }
  std::size_t num_nodes() const { return node(num_facets()); }
  std::size_t num_pieces() const { return piece(num_facets()); }
};

struct SizingFieldAccess {
  static SizingField make(std::shared_ptr<const SizingLattice> lattice, std::vector<double> nodes, const Execution& execution) {
    return {std::move(lattice), std::move(nodes), execution};
  }
  /// The same field over the same mesh, of which `scale` was the unit, and is 1 now; and the other way round.
  static SizingField scaled(const SizingField& field, const MeshScale& scale) {
    return of_scale(field, field.scale_.in(scale));
  }
  static SizingField back(const SizingField& field, const MeshScale& scale) {
    return of_scale(field, field.scale_.in(MeshScale().in(scale)));
  }
  static const MeshScale& scale(const SizingField& field) { return field.scale_; }
  static SizingField of_scale(SizingField field, const MeshScale& scale) {
    field.scale_ = scale;
    return field;
  }
  static const std::shared_ptr<const SizingLattice>& lattice(const SizingField& field) { return field.lattice_; }
  static const std::vector<double>& nodes(const SizingField& field) { return *field.nodes_; }
  /// Starts to fetch the radii of a piece, where they are found without a look elsewhere.
  static void prefetch_piece(const SizingField& field, Index piece) {
    if (field.lattice_->simple()) prefetch(&(*field.nodes_)[field.lattice_->node(piece)]);
  }
};

/// Corners of lattice triangles as (i, j).
struct LatticeTriangle {
  std::array<std::array<Index, 2>, 3> corner;
};

inline std::size_t nodes_of_lattice(Index k) { return slot(k + 1) * slot(k + 2) / 2; }

/// Place of node (i, j) among those of its facet: rows before j hold k+1, k, … nodes.
inline std::size_t lattice_node(Index k, Index i, Index j) { return slot(j) * (2 * slot(k) + 3 - slot(j)) / 2 + slot(i); }

inline Vec3 lattice_barycentric(Index k, Index i, Index j) { return Vec3(k - i - j, i, j) / k; }

inline LatticeTriangle lattice_triangle(Index i, Index j, bool upward) {
  if (upward) return {{{{i, j}, {i + 1, j}, {i, j + 1}}}};
  return {{{{i + 1, j}, {i + 1, j + 1}, {i, j + 1}}}};
}

/// The t-th triangle of a lattice. Rows from j on hold (k − j)² triangles, so t lies in row j iff (k − j)² ≥ k² − t > (k − j −
/// 1)².
inline LatticeTriangle nth_lattice_triangle(Index k, std::size_t t) {
  const std::size_t all = slot(k) * slot(k), left = all - t;
  auto side = static_cast<std::size_t>(std::sqrt(static_cast<double>(left)));
  while (side * side < left) ++side;
  while ((side - 1) * (side - 1) >= left) --side;
  const std::size_t within = t - (all - side * side);
  return lattice_triangle(static_cast<Index>(within / 2), k - static_cast<Index>(side), within % 2 == 0);
}

/// The linear interpolant of a facet's nodes; never outside the range of the three it interpolates.
inline double interpolate_lattice(const double* nodes, Index k, const Vec3& barycentric) {
  const double x = barycentric[1] * k, y = barycentric[2] * k;  // exact: k is a power of two
  const Index j = std::clamp(static_cast<Index>(y), Index{0}, k - 1);
  const Index i = std::clamp(static_cast<Index>(x), Index{0}, k - 1 - j);
  const double u = x - i, v = y - j;
  const bool upward = u + v <= 1 || i + j + 1 == k;
  double a, b, c, s, t;  // a + s (b − a) + t (c − a)
  if (upward) {
    a = nodes[lattice_node(k, i, j)];
    s = u;
    t = v;
  } else {
    a = nodes[lattice_node(k, i + 1, j + 1)];
    s = 1 - v;
    t = 1 - u;
  }
  b = nodes[lattice_node(k, i + 1, j)];
  c = nodes[lattice_node(k, i, j + 1)];
  return std::clamp(a + s * (b - a) + t * (c - a), std::min({a, b, c}), std::max({a, b, c}));
}

/// The side of the facet that node (i, j) of a lattice lies on, and how many lattice edges from its start; corners lie at the
/// start of a side. Side −1: inside.
struct PlaceOnSide {
  int side = -1;
  Index steps = 0;
};

inline PlaceOnSide place_on_side(Index k, Index i, Index j) {
  if (j == 0 && i < k) return {0, i};
  if (i + j == k && j < k) return {1, j};
  if (i == 0 && j > 0) return {2, k - j};
  return {};
}

/// The first side of each side's edge, by side (3·facet + k): two facets count the nodes of their edge from the same end.
std::vector<std::size_t> first_sides(const TrianglesView& triangles, Index num_vertices, const Execution& execution);

/// A lattice of the given levels (empty: k = 1 everywhere).
std::shared_ptr<SizingLattice> make_lattice(Mesh mesh, std::vector<double> areas, std::vector<std::uint8_t> levels,
                                            const Execution& execution);

/// A radius for each position: positive, finite, the same for the same position; called from several threads.
using PositionFunction = std::function<double(const Vec3&)>;

/// As function_sizing(), on all threads. The mesh is usable; `areas`: those of its facets.
SizingField tabulate_positions(const MeshView& mesh, const std::vector<double>& areas, const PositionFunction& radius,
                               const TabulationOptions& options, const Execution& execution);

/// The mean of 1/r² over a triangle on which r is linear, > 0 at the corners; relative error below 1e-12.
double mean_inverse_square(const std::array<double, 3>& radii);

/// Throws Error(kInvalidArgument).
[[noreturn]] void refuse_sizing(const std::string& what);

inline bool is_radius(double r) { return r > 0 && std::isfinite(r); }

}  // namespace amps::detail
