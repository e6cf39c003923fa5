// sizing.h: sizing fields as the lattices they are kept in, and how far lists of values are off.
#pragma once

#include "samples.h"

#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace amps_test {

using amps::SizingField;
using amps::SurfacePoint;

inline Vec3 vertex_of(const Mesh& mesh, Index facet, int k) { return MeshView(mesh).corner(facet, k); }

/// How far off values are at most, relative to the truth.
inline double ratio_spread(const Values& values, const Values& truth) {
  return max_of(made_values(rows(truth), [&](Index i) { return std::abs(values[i] / truth[i] - 1); }));
}

inline double mean_error(const Values& values, const Values& truth) {
  return mean_of(made_values(rows(truth), [&](Index i) { return std::abs(values[i] / truth[i] - 1); }));
}

/// All pairs of nodes of lattice edges, with positions.
struct LatticeEdge {
  Vec3 a, b;
  double ra, rb;
};
inline std::vector<LatticeEdge> lattice_edges(const Mesh& mesh, const SizingField& field) {
  std::vector<LatticeEdge> edges;
  for (std::size_t i = 0; i < field.num_pieces(); ++i) {
    const SizingField::Piece piece = field.piece(i);
    std::array<Vec3, 3> x;
    for (std::size_t c = 0; c < 3; ++c) {
      x[c] = Vec3::Zero();
      for (int k = 0; k < 3; ++k) x[c] += piece.corners[c][k] * vertex_of(mesh, piece.facet, k);
    }
    for (std::size_t c = 0; c < 3; ++c) edges.push_back({x[c], x[(c + 1) % 3], piece.radii[c], piece.radii[(c + 1) % 3]});
  }
  return edges;
}

inline double steepest(const Mesh& mesh, const SizingField& field) {
  double worst = 0;
  for (const LatticeEdge& e : lattice_edges(mesh, field)) {
    if ((e.a - e.b).norm() > 0) worst = std::max(worst, std::abs(e.ra - e.rb) / (e.a - e.b).norm());
  }
  return worst;
}

/// A field with lattices of several sizes.
inline double wavy(const SurfacePoint& at) { return 0.05 + 0.3 * at.position.squaredNorm() + 0.02 * at.position.x(); }

inline void require_same(const SizingField& a, const SizingField& b) {
  REQUIRE(a.num_pieces() == b.num_pieces());
  for (std::size_t i = 0; i < a.num_pieces(); ++i) REQUIRE(a.piece(i).radii == b.piece(i).radii);
}

}  // namespace amps_test
