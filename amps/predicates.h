// predicates.h: the exact decisions of amps — orientation, power test, side of a bisector, side of a ball.
//
// Every predicate goes through the same stages and returns the sign of its polynomial for the doubles as given:
//   static    two comparisons with a bound that holds for a whole point set (only where the caller has one);
//   filter    double arithmetic with a bound from the magnitudes of this call;
//   double    the double value itself, where all input of this call lies on a lattice coarse enough for it to be exact;
//   exact     integers of fixed width (exact.h), in three widths: data of ≤ 58 bits, of ≤ 122 bits, any finite doubles;
//   symbolic  where the exact value is 0 and the geometry needs a decision.
//
// Symbolic perturbation. Weights are perturbed, w_i → w_i − ε_i, positions never; the ε of the lexicographically greatest
// position dominates (Devillers & Teillaud, "Perturbations for Delaunay and weighted Delaunay 3D triangulations", 2011). The
// regular triangulation becomes a unique function of the weighted points, without flat cells; among points exactly on a
// bisector, the lexicographically smaller site owns them.
//
// Requirements: finite doubles. No range limits: from denormals to 1e308. Positions of the sites of one call are pairwise
// distinct. Thread-safe, no state. A caller who wants to know which stage decided passes a StageTally; the default counts
// nothing and costs nothing.
#pragma once

#include "amps/base.h"
#include "amps/exact.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace amps {

/// A site with its weight as given: the power of x is |x − p|² − w. A disk of radius r has w = r².
struct WeightedPoint {
  double x, y, z, w;
  Vec3 position() const { return {x, y, z}; }
};

/// Which stage decided a predicate.
enum class Stage { kStatic, kFilter, kExactDouble, kExactNarrow, kExactMiddle, kExactWide, kSymbolic };

/// Counts decisions per stage.
struct StageTally {
  std::array<std::uint64_t, 7> counts{};
  void count(Stage stage) noexcept { ++counts[static_cast<std::size_t>(stage)]; }
  std::uint64_t operator[](Stage stage) const noexcept { return counts[static_cast<std::size_t>(stage)]; }
};
struct NoTally {
  void count(Stage) const noexcept {}
};

/// Lexicographic order of positions; the greatest has the dominant ε.
inline bool lexicographically_less(const WeightedPoint& a, const WeightedPoint& b) noexcept {
  if (a.x != b.x) return a.x < b.x;
  if (a.y != b.y) return a.y < b.y;
  return a.z < b.z;
}
inline bool same_position(const WeightedPoint& a, const WeightedPoint& b) noexcept {
  return a.x == b.x && a.y == b.y && a.z == b.z;
}

namespace detail {

// The formulas, each once, over any number type.

/// a · (b × c)
template <class T>
auto determinant3(const T (&a)[3], const T (&b)[3], const T (&c)[3]) noexcept {
  return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

/// Row k is (h_k, d_k): with h_k = |d_k|² + w_q − w_k and d_k = p_k − q this is det[1 d] times the height at q of the
/// hyperplane through the four lifted sites, above the lifted q.
template <class H, class T>
auto power_determinant(const H (&h)[4], const T (&d)[4][3]) noexcept {
  const auto m01 = d[0][0] * d[1][1] - d[1][0] * d[0][1];
  const auto m02 = d[0][0] * d[2][1] - d[2][0] * d[0][1];
  const auto m03 = d[0][0] * d[3][1] - d[3][0] * d[0][1];
  const auto m12 = d[1][0] * d[2][1] - d[2][0] * d[1][1];
  const auto m13 = d[1][0] * d[3][1] - d[3][0] * d[1][1];
  const auto m23 = d[2][0] * d[3][1] - d[3][0] * d[2][1];
  const auto m123 = d[1][2] * m23 - d[2][2] * m13 + d[3][2] * m12;
  const auto m023 = d[0][2] * m23 - d[2][2] * m03 + d[3][2] * m02;
  const auto m013 = d[0][2] * m13 - d[1][2] * m03 + d[3][2] * m01;
  const auto m012 = d[0][2] * m12 - d[1][2] * m02 + d[2][2] * m01;
  return (h[0] * m123 - h[1] * m023) + (h[2] * m013 - h[3] * m012);
}

/// Relative bounds of the filters. A computed polynomial differs from the exact one by at most γ_k · Σ|monomials|,
/// γ_k = k·u/(1 − k·u), with k the largest number of roundings any monomial passes through (Higham 2002, §3.1).
/// Orientation: 3 differences, 2 products, 1 + 2 sums: k = 8, six monomials. Power: differences 3 + 2, square 1, sums of h 3,
/// minors 2 + 2 + 2 (products and sums), product with h 1, last sums 2: k = 18, 24 monomials. Slack for the roundings of
/// the bound itself is included. The same bounds hold with any magnitudes that are not smaller: of this call, or of the set.
/// If a magnitude is exactly 0 so is the determinant, and its double value: every monomial has that factor.
inline constexpr double kOrientationBound = 50 * kUnitRoundoff;
inline constexpr double kPowerBound = 450 * kUnitRoundoff;

/// Magnitudes for which products in the filters neither underflow (losing more than the bound) nor overflow.
inline constexpr double kFilterMin = 1e-50;
inline constexpr double kFilterMax = 1e50;

int orient3d_exact(const WeightedPoint& a, const WeightedPoint& b, const WeightedPoint& c, const WeightedPoint& d,
                   Stage& stage) noexcept;
int power_test_exact(const WeightedPoint* const p[4], const WeightedPoint& q, Stage& stage) noexcept;

/// What holds for all calls within one point set. By default nothing.
struct StaticBounds {
  double orientation = INFINITY;  ///< determinants above this are decided
  double power = INFINITY;
  double orientation_exact = 0;  ///< products of magnitudes up to this leave the double determinant without any rounding
  double power_exact = 0;
  /// For points within a box of these extents and weights within `weight_range` of each other, coordinates being multiples of
  /// 2^unit and weights of 2^(2·unit).
  static StaticBounds for_set(const Vec3& extent, double weight_range, int unit) noexcept;
};

int power_test_symbolic(const WeightedPoint* const p[4], const WeightedPoint& q, const StaticBounds& bounds) noexcept;

}  // namespace detail

/// Sign of det(b − a, c − a, d − a), the volume of the tetrahedron: +1 if a, b, c turn counter-clockwise seen from d, 0 if the
/// four points are exactly coplanar.
/// Laws: swapping two arguments negates it; even permutations keep it.
/// `bounds`: what is known of the set that the points are from.
template <class Tally = NoTally>
int orient3d(const WeightedPoint& a, const WeightedPoint& b, const WeightedPoint& c, const WeightedPoint& d,
             const detail::StaticBounds& bounds = {}, Tally&& tally = NoTally{}) noexcept {
  const double m[3][3] = {
      {b.x - a.x, b.y - a.y, b.z - a.z}, {c.x - a.x, c.y - a.y, c.z - a.z}, {d.x - a.x, d.y - a.y, d.z - a.z}};
  const double value = detail::determinant3(m[0], m[1], m[2]);
  if (value > bounds.orientation || -value > bounds.orientation) {
    tally.count(Stage::kStatic);
    return value > 0 ? 1 : -1;
  }
  const auto largest = [&m](int k) { return std::max({std::fabs(m[0][k]), std::fabs(m[1][k]), std::fabs(m[2][k])}); };
  const double mx = largest(0), my = largest(1), mz = largest(2);
  const double least = std::min({mx, my, mz});
  if (std::max({mx, my, mz}) < detail::kFilterMax && (least > detail::kFilterMin || least == 0)) {
    const double volume = mx * my * mz;
    const double bound = detail::kOrientationBound * volume;
    if (value > bound || -value > bound) {
      tally.count(Stage::kFilter);
      return value > 0 ? 1 : -1;
    }
    if (volume <= bounds.orientation_exact) {
      tally.count(Stage::kExactDouble);
      return detail::sign_of(value);
    }
  }
  Stage stage;
  const int sign = detail::orient3d_exact(a, b, c, d, stage);
  tally.count(stage);
  return sign;
}

/// Power test without perturbation. For positively oriented p0..p3: +1 if q is in conflict with the cell (its power to the
/// cell's orthogonal sphere is negative: |q − c|² − R² < w_q), −1 if not, 0 if it is orthogonal to it.
/// With perturbation (`kPerturbed`) the answer is never 0.
/// Law: even permutations of p0..p3 keep it.
template <bool kPerturbed = true, class Tally = NoTally>
int power_test(const WeightedPoint& p0, const WeightedPoint& p1, const WeightedPoint& p2, const WeightedPoint& p3,
               const WeightedPoint& q, const detail::StaticBounds& bounds = {}, Tally&& tally = NoTally{}) noexcept {
  const WeightedPoint* const p[4] = {&p0, &p1, &p2, &p3};
  double d[4][3], h[4], dw[4];
  for (int k = 0; k < 4; ++k) {
    d[k][0] = p[k]->x - q.x;
    d[k][1] = p[k]->y - q.y;
    d[k][2] = p[k]->z - q.z;
    dw[k] = q.w - p[k]->w;
    h[k] = d[k][0] * d[k][0] + d[k][1] * d[k][1] + d[k][2] * d[k][2] + dw[k];
  }
  const double value = detail::power_determinant(h, d);
  if (value > bounds.power || -value > bounds.power) {
    tally.count(Stage::kStatic);
    return value > 0 ? 1 : -1;
  }
  double m[3];
  for (int k = 0; k < 3; ++k) {
    m[k] = std::max(std::max(std::fabs(d[0][k]), std::fabs(d[1][k])), std::max(std::fabs(d[2][k]), std::fabs(d[3][k])));
  }
  const double mw = std::max(std::max(std::fabs(dw[0]), std::fabs(dw[1])), std::max(std::fabs(dw[2]), std::fabs(dw[3])));
  const double mh = m[0] * m[0] + m[1] * m[1] + m[2] * m[2] + mw;
  const double least = std::min({m[0], m[1], m[2]});
  Stage stage = Stage::kSymbolic;
  int sign = 0;
  if (mh < detail::kFilterMax && (least > detail::kFilterMin || least == 0)) {
    const double magnitude = mh * m[0] * m[1] * m[2];
    const double bound = detail::kPowerBound * magnitude;
    if (value > bound || -value > bound) {
      tally.count(Stage::kFilter);
      return value > 0 ? 1 : -1;
    }
    if (magnitude <= bounds.power_exact) {
      stage = Stage::kExactDouble;
      sign = detail::sign_of(value);
    }
  }
  if (stage != Stage::kExactDouble) sign = detail::power_test_exact(p, q, stage);
  if (kPerturbed && sign == 0) {
    sign = detail::power_test_symbolic(p, q, bounds);
    stage = Stage::kSymbolic;
  }
  tally.count(stage);
  return sign;
}

/// Sign of |x − p|² − w: +1 outside the ball, 0 on it, −1 inside. Positions are arrays of three doubles.
int side_of_ball(const double* x, const double* p, double w) noexcept;

/// True if the three points lie exactly on one line (or coincide).
bool collinear(const double* a, const double* b, const double* c) noexcept;

// ---------------------------------------------------------------------------------------------------------------------------
// Sides of bisectors: restricted clipping
//
// For a facet (a, b, c), an owner i and another site j, let D_j(x) = |x − p_j|² − w_j − |x − p_i|² + w_i: affine in x, ≥ 0
// where i is at least as close. In barycentric coordinates every vertex of a clipped facet is a small determinant of the values
// of D at the corners, and so is its side of a further bisector (DESIGN: "restricted clipping in barycentric form"). Under the
// perturbation D_j gains ε_j − ε_i at every corner; by multilinearity only first-order terms survive, and the term of the site
// just tested never vanishes where a vertex exists, so each test decides.

namespace detail {

/// D_j(x) = (p_j − p_i)·((p_j − x) + (p_i − x)) + w_i − w_j, in any number type; differences first, so that sites and facet far
/// from the origin lose nothing.
template <class P, class W>
auto bisector_value(const P (&i)[3], const W& wi, const P (&j)[3], const W& wj, const P (&x)[3]) noexcept {
  const auto term = [&](int k) { return (j[k] - i[k]) * ((j[k] - x[k]) + (i[k] - x[k])); };
  return (term(0) + term(1) + term(2)) + (wi - wj);
}

}  // namespace detail

/// The bisector of an owner and another site, with its approximate values at the corners of one facet.
struct Bisector {
  const WeightedPoint* owner;
  const WeightedPoint* other;
  std::array<detail::Approx, 3> at_corner;

  /// `corners`: three positions, three doubles each. ~15 ns.
  Bisector(const WeightedPoint& owner, const WeightedPoint& other, const double* const corners[3]) noexcept;
};

/// Which stage decided, counted; null: not counted.
using OptionalTally = StageTally*;

/// Is corner v on the owner's side of bisector k? +1 yes, −1 no; never 0.
int side_of_corner(const double* const corners[3], int v, const Bisector& k, OptionalTally tally = nullptr) noexcept;

/// Is the intersection of edge (u, v) with bisector j on the owner's side of bisector k? The edge must cross j (the sides of
/// its ends differ), and j and k have one owner. +1 yes, −1 no; never 0.
int side_of_edge_crossing(const double* const corners[3], int u, int v, const Bisector& j, const Bisector& k,
                          OptionalTally tally = nullptr) noexcept;

/// Is the intersection of bisectors j and l in the facet's plane on the owner's side of bisector k? j and l must intersect
/// in a vertex of the clipped facet; all have one owner. +1 yes, −1 no; never 0.
int side_of_facet_crossing(const double* const corners[3], const Bisector& j, const Bisector& l, const Bisector& k,
                           OptionalTally tally = nullptr) noexcept;

/// Barycentric coordinates of these vertices, each coordinate to a few 2^-46 relative to 1 whatever the conditioning (computed
/// exactly where the approximate values are not good enough). Same bits for any order of the three sites involved
/// and for both facets of an edge if its ends come in one order.
std::array<double, 2> edge_crossing_coordinates(const double* const corners[3], int u, int v, const Bisector& j) noexcept;
Vec3 facet_crossing_coordinates(const double* const corners[3], const WeightedPoint& i, const WeightedPoint& j,
                                const WeightedPoint& l) noexcept;

}  // namespace amps
