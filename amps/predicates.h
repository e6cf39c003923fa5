// predicates.h: the exact decisions of amps — orientation, power test, side of a bisector, side of a ball, coverage.
//
// Every predicate goes through the same stages and returns the sign of its polynomial for the doubles as given:
//   static    two comparisons with a bound that holds for a whole point set (only where the caller has one);
//   filter    double arithmetic with a bound from the magnitudes of this call;
//   double    the double value itself, where all input of this call lies on a lattice coarse enough for it to be exact;
//   machine   (power test, where the compiler has 128-bit integers) exact integers of the machine, where all differences of
//             coordinates are exact in double and span ≤ 59 bits;
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

#include "amps/host_macros_begin.h"

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
enum class Stage { kStatic, kFilter, kExactDouble, kExactMachine, kExactNarrow, kExactMiddle, kExactWide, kSymbolic };

/// Counts decisions per stage.
struct StageTally {
  std::array<std::uint64_t, 8> counts{};
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

/// The 3×3 minors of four rows: the k-th is the determinant of the other three.
template <class T>
auto volume_minors(const T (&d)[4][3]) noexcept {
  const auto m01 = d[0][0] * d[1][1] - d[1][0] * d[0][1];
  const auto m02 = d[0][0] * d[2][1] - d[2][0] * d[0][1];
  const auto m03 = d[0][0] * d[3][1] - d[3][0] * d[0][1];
  const auto m12 = d[1][0] * d[2][1] - d[2][0] * d[1][1];
  const auto m13 = d[1][0] * d[3][1] - d[3][0] * d[1][1];
  const auto m23 = d[2][0] * d[3][1] - d[3][0] * d[2][1];
  const auto m123 = d[1][2] * m23 - d[2][2] * m13 + d[3][2] * m12;
  return std::array<std::decay_t<decltype(m123)>, 4>{m123, d[0][2] * m23 - d[2][2] * m03 + d[3][2] * m02,
                                                     d[0][2] * m13 - d[1][2] * m03 + d[3][2] * m01,
                                                     d[0][2] * m12 - d[1][2] * m02 + d[2][2] * m01};
}

/// From the minors of rows d_k = p_k − q and from h_k = |d_k|² + w_q − w_k: det[1 d] times the height at q of the hyperplane
/// through the four lifted sites, above the lifted q.
template <class H, class Minor>
auto power_determinant(const std::array<H, 4>& h, const std::array<Minor, 4>& minor) noexcept {
  return (h[0] * minor[0] - h[1] * minor[1]) + (h[2] * minor[2] - h[3] * minor[3]);
}

#if defined(__GNUC__) || defined(__clang__)
typedef double Double2 __attribute__((vector_size(16)));  // two at a time: SSE2, NEON
#else
/// Two numbers that a compiler may keep in one register.
struct Double2 {
  double lane[2];
  double operator[](int k) const noexcept { return lane[k]; }
  friend Double2 operator+(Double2 a, Double2 b) noexcept { return {{a.lane[0] + b.lane[0], a.lane[1] + b.lane[1]}}; }
  friend Double2 operator-(Double2 a, Double2 b) noexcept { return {{a.lane[0] - b.lane[0], a.lane[1] - b.lane[1]}}; }
  friend Double2 operator*(Double2 a, Double2 b) noexcept { return {{a.lane[0] * b.lane[0], a.lane[1] * b.lane[1]}}; }
};
#endif

/// One number for each of p0 … p3, in pairs.
struct Column {
  Double2 p01, p23;
  Double2 p02() const noexcept { return Double2{p01[0], p23[0]}; }
  Double2 p13() const noexcept { return Double2{p01[1], p23[1]}; }
  Double2 p32() const noexcept { return Double2{p23[1], p23[0]}; }
  double operator[](int k) const noexcept { return k < 2 ? p01[k] : p23[k - 2]; }
  double largest() const noexcept {
    return std::max(std::max(std::fabs(p01[0]), std::fabs(p01[1])), std::max(std::fabs(p23[0]), std::fabs(p23[1])));
  }
};

/// The power test in doubles: differences to q, by coordinate.
struct PowerRows {
  Column x, y, z, w, h;  ///< w: q's weight less that of p_k; h as in power_determinant

  PowerRows(const WeightedPoint* const p[4], const WeightedPoint& q) noexcept {
    const Double2 qx = {q.x, q.x}, qy = {q.y, q.y}, qz = {q.z, q.z}, qw = {q.w, q.w};
    x = {Double2{p[0]->x, p[1]->x} - qx, Double2{p[2]->x, p[3]->x} - qx};
    y = {Double2{p[0]->y, p[1]->y} - qy, Double2{p[2]->y, p[3]->y} - qy};
    z = {Double2{p[0]->z, p[1]->z} - qz, Double2{p[2]->z, p[3]->z} - qz};
    w = {qw - Double2{p[0]->w, p[1]->w}, qw - Double2{p[2]->w, p[3]->w}};
    h = {x.p01 * x.p01 + y.p01 * y.p01 + z.p01 * z.p01 + w.p01, x.p23 * x.p23 + y.p23 * y.p23 + z.p23 * z.p23 + w.p23};
  }

  /// power_determinant by Laplace's expansion, 2×2 minors of columns (x, y) times the complementary ones of (h, z): that goes
  /// two at a time, and saves a sixth of the time of an insertion.
  double determinant() const noexcept {
    const auto minors = [](Double2 a, Double2 a2, Double2 b, Double2 b2) { return a * b2 - a2 * b; };
    const auto swapped = [](Double2 a) { return Double2{a[1], a[0]}; };
    const Double2 xy02_13 = minors(x.p01, x.p23, y.p01, y.p23), hz02_13 = minors(h.p01, h.p23, z.p01, z.p23);
    const Double2 xy03_12 = minors(x.p01, x.p32(), y.p01, y.p32()), hz03_12 = minors(h.p01, h.p32(), z.p01, z.p32());
    const Double2 xy01_23 = minors(x.p02(), x.p13(), y.p02(), y.p13()), hz01_23 = minors(h.p02(), h.p13(), z.p02(), z.p13());
    const Double2 sum = (xy01_23 * swapped(hz01_23) - xy02_13 * swapped(hz02_13)) + xy03_12 * swapped(hz03_12);
    return sum[0] + sum[1];
  }

  /// The k-th of volume_minors.
  double minor(int k) const noexcept {
    double row[3][3];
    for (int n = 0, m = 0; n < 4; ++n) {
      if (n == k) continue;
      row[m][0] = x[n];
      row[m][1] = y[n];
      row[m++][2] = z[n];
    }
    return determinant3(row[0], row[1], row[2]);
  }
};

/// What the first stage of power_test() looks at, for callers with bounds of their set: its sign counts where it is farther
/// from 0 than StaticBounds::power.
inline double power_value(const WeightedPoint* const p[4], const WeightedPoint& q) noexcept {
  return PowerRows(p, q).determinant();
}

/// Relative bounds of the filters. A computed polynomial differs from the exact one by at most γ_k · Σ|monomials|,
/// γ_k = k·u/(1 − k·u), with k the largest number of roundings any monomial passes through (Higham 2002, §3.1).
/// Orientation: 3 differences, 2 products, 1 + 2 sums: k = 8, six monomials. Power, as in PowerRows: differences 3 + 2, square
/// 1, sums of h 3, products 2, differences of products 2, product of minors 1, last sums 3: k = 17, 24 monomials. Slack for the
/// roundings of the bound itself is included. The same bounds hold with any magnitudes that are not smaller: of this call, or
/// of the set. If a magnitude is exactly 0 so is the determinant, and its double value: every monomial has that factor.
inline constexpr double kOrientationBound = 50 * kUnitRoundoff;
inline constexpr double kPowerBound = 450 * kUnitRoundoff;

/// Magnitudes for which products in the filters neither underflow (losing more than the bound) nor overflow.
inline constexpr double kFilterMin = 1e-50;
inline constexpr double kFilterMax = 1e50;

/// The last stages of power_test_exact(), for any finite input.
int power_test_in_limbs(const WeightedPoint* const p[4], const WeightedPoint& q, Stage& stage,
                        std::array<int, 4>& minor_signs) noexcept;

/// What holds for all calls within one point set. By default nothing.
struct StaticBounds {
  double orientation = kInfinity;  ///< determinants above this are decided
  double power = kInfinity;
  double orientation_exact = 0;  ///< products of magnitudes up to this leave the double determinant without any rounding
  double power_exact = 0;
  /// For points within a box of these extents and weights within `weight_range` of each other, coordinates being multiples of
  /// 2^unit and weights of 2^(2·unit).
  static StaticBounds for_set(const Vec3& extent, double weight_range, int unit) noexcept;
};

/// The perturbed power test where the unperturbed one is 0. The determinant gains Σ ε_k·C_k − ε_q·ΣC_k, where C_k is the
/// orientation of the cell with p_k replaced by q, that is (−1)^k times the k-th of volume_minors, and ΣC_k that of the cell
/// itself, positive: the first non-zero coefficient in order of dominance decides, at q at the latest.
template <class MinorSign>
int power_test_symbolic(const WeightedPoint* const p[4], const WeightedPoint& q, MinorSign&& minor_sign) noexcept {
  for (unsigned tried = 0;;) {
    int dominant = 4;
    const WeightedPoint* greatest = &q;
    for (int k = 0; k < 4; ++k) {
      if ((tried >> k & 1u) != 0 || !lexicographically_less(*greatest, *p[k])) continue;
      dominant = k;
      greatest = p[k];
    }
    if (dominant == 4) return -1;
    if (const int sign = minor_sign(dominant)) return dominant % 2 == 0 ? sign : -sign;
    tried |= 1u << dominant;
  }
}

}  // namespace detail

/// The stages of orient3d() after its filters, which are in this header. For orient3d() itself.
AMPS_EXPORT int orient3d_exact(const WeightedPoint& a, const WeightedPoint& b, const WeightedPoint& c, const WeightedPoint& d,
                               Stage& stage) noexcept;
/// Those of power_test(), without perturbation. If it is 0, minor_signs holds the signs of detail::volume_minors.
AMPS_EXPORT int power_test_exact(const detail::PowerRows& rows, const WeightedPoint* const p[4], const WeightedPoint& q,
                                 Stage& stage, std::array<int, 4>& minor_signs) noexcept;

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
  if (std::fabs(value) > bounds.orientation) {  // one branch, which can be predicted: the sign cannot
    tally.count(Stage::kStatic);
    return value > 0 ? 1 : -1;
  }
  const auto largest = [&m](int k) { return std::max({std::fabs(m[0][k]), std::fabs(m[1][k]), std::fabs(m[2][k])}); };
  const double mx = largest(0), my = largest(1), mz = largest(2);
  const double min_magnitude = std::min({mx, my, mz});
  if (std::max({mx, my, mz}) < detail::kFilterMax && (min_magnitude > detail::kFilterMin || min_magnitude == 0)) {
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
  const int sign = orient3d_exact(a, b, c, d, stage);
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
  const detail::PowerRows rows(p, q);
  const double value = rows.determinant();
  if (std::fabs(value) > bounds.power) {  // as above
    tally.count(Stage::kStatic);
    return value > 0 ? 1 : -1;
  }
  const double m[3] = {rows.x.largest(), rows.y.largest(), rows.z.largest()};
  const double mh = m[0] * m[0] + m[1] * m[1] + m[2] * m[2] + rows.w.largest();
  const double min_magnitude = std::min({m[0], m[1], m[2]});
  if (mh < detail::kFilterMax && (min_magnitude > detail::kFilterMin || min_magnitude == 0)) {
    const double magnitude = mh * m[0] * m[1] * m[2];
    const double bound = detail::kPowerBound * magnitude;
    if (value > bound || -value > bound) {
      tally.count(Stage::kFilter);
      return value > 0 ? 1 : -1;
    }
    if (magnitude <= bounds.power_exact) {
      if (value != 0 || !kPerturbed) {
        tally.count(Stage::kExactDouble);
        return detail::sign_of(value);
      }
      tally.count(Stage::kSymbolic);
      return detail::power_test_symbolic(p, q, [&rows](int k) { return detail::sign_of(rows.minor(k)); });
    }
  }
  Stage stage;
  std::array<int, 4> minor_signs;
  int sign = power_test_exact(rows, p, q, stage, minor_signs);
  if (kPerturbed && sign == 0) {
    sign = detail::power_test_symbolic(p, q, [&minor_signs](int k) { return minor_signs[static_cast<std::size_t>(k)]; });
    stage = Stage::kSymbolic;
  }
  tally.count(stage);
  return sign;
}

/// Which stage decided, counted; null: not counted.
using OptionalTally = StageTally*;

/// Sign of |x − p|² − w: +1 outside the ball, 0 on it, −1 inside. Positions are arrays of three doubles.
AMPS_EXPORT int side_of_ball(const double* x, const double* p, double w, OptionalTally tally = nullptr) noexcept;

/// Sign of |x − p|² − w at the point x of the closed segment ab that is nearest to p: +1 if segment and closed ball are apart,
/// 0 if they only touch, −1 if they have more in common. a = b is a segment too. Laws: a and b can be swapped; where it is −1
/// or 0 for some w, it is −1 for any greater one; it is never greater than side_of_ball() of a point of ab.
AMPS_EXPORT int segment_side_of_ball(const double* a, const double* b, const double* p, double w,
                                     OptionalTally tally = nullptr) noexcept;

namespace detail {

/// The filter of segment_side_of_ball(), for one ball and many segments that share ends.
///
/// With a, b and u = b − a relative to the centre, and na = |a|², nb = |b|²: u·a = (nb − na − |u|²)/2 and u·b = (nb − na +
/// |u|²)/2, so the nearest point is an end iff |nb − na| ≥ |u|². Else it is at squared distance |a × b|²/|u|². Errors, in units
/// of 2^-53 (first order; the constants leave slack for the rest and for roundings of the bounds):
///   na, nb     5 of themselves: a difference (twice), a square, two sums.
///   |u|²       u comes from rounded differences, which are off by a unit of themselves; |u_k| ≤ |a_k| + |b_k|, so with the
///              roundings of u, squares and sums 7·Σ(|a_k| + |b_k|)² ≤ 14·(na + nb).
///   |nb − na| − |u|²   5 + 14, and two more differences of no more than 3·(na + nb): 25·(na + nb).
///   |a × b|² − w·|u|²  a monomial of |a × b|² passes through 12 roundings (four differences, two products, two differences of
///              these, a square, three sums), and the sum of all is ≤ 2·na·nb: 24·na·nb. The rest is off by w·(14 + 2·2)·(na +
///              nb), and as no end is certainly inside, w is no more than na and nb: 36·na·nb.
class SegmentFilter {
 public:
  /// An end of segments, relative to the centre.
  struct End {
    double x, y, z;
    double squared;
  };

  SegmentFilter(const double* p, double w) noexcept
      : x_(p[0]), y_(p[1]), z_(p[2]), weight_(w > 0 ? w : 0) {  // a negative one makes all apart that is from the centre
    outside_ = w + (8 * kUnitRoundoff * weight_ + 4 * Approx::kTiny);
    inside_ = w - (8 * kUnitRoundoff * weight_ + 4 * Approx::kTiny);
  }

  End end(const double* p) const noexcept {
    const double x = p[0] - x_, y = p[1] - y_, z = p[2] - z_;
    return {x, y, z, x * x + y * y + z * z};
  }

  /// As segment_side_of_ball() where it is certain and not 0, else 0.
  int side(const End& a, const End& b) const noexcept {
    const double min = std::min(a.squared, b.squared), max = std::max(a.squared, b.squared);
    if (min < inside_) return -1;
    if (!(max < kFilterMax && min > kFilterMin)) return 0;
    const double ux = b.x - a.x, uy = b.y - a.y, uz = b.z - a.z;
    const double uu = ux * ux + uy * uy + uz * uz;
    const double beyond = (max - min) - uu, slack = (32 * kUnitRoundoff) * (max + min);
    if (beyond > slack) return min > outside_ ? 1 : 0;
    const double cx = a.y * b.z - a.z * b.y, cy = a.z * b.x - a.x * b.z, cz = a.x * b.y - a.y * b.x;
    const double value = (cx * cx + cy * cy + cz * cz) - weight_ * uu, bound = (80 * kUnitRoundoff) * (max * min);
    if (value > bound) return 1;
    return value < -bound && beyond < -slack ? -1 : 0;
  }

 private:
  double x_, y_, z_;
  double weight_;
  double outside_, inside_;  ///< squared distances above the one are outside, below the other inside
};

/// The stages of segment_side_of_ball() after the filter, for those who have that themselves.
int segment_side_of_ball_exact(const double* a, const double* b, const double* p, double w, Stage& stage) noexcept;

/// The filter of orient2d(): its sign where that is certain, else 0.
///
/// Both monomials pass through four roundings (two differences, a product, a difference), so the value is off by
/// γ_4·Σ|monomials|; the constant leaves slack for the roundings of the sum and the bound. The last summand covers underflow of
/// the products.
inline int orient2d_filter(const double* a, const double* b, const double* c, int axis) noexcept {
  const int m = axis == 2 ? 0 : axis + 1, n = axis == 0 ? 2 : axis - 1;
  const double ux = b[m] - a[m], uy = b[n] - a[n], vx = c[m] - a[m], vy = c[n] - a[n];
  const double first = ux * vy, second = uy * vx, value = first - second;
  const double bound = (8 * kUnitRoundoff) * (std::fabs(first) + std::fabs(second)) + 4 * Approx::kTiny;
  return (value > bound) - (-value > bound);
}

}  // namespace detail

/// Sign of component `axis` (0, 1, 2) of (b − a) × (c − a): +1 if a, b, c turn counter-clockwise in the projection along that
/// axis, as seen from its positive end, 0 if they are in one line there. Exact, as dropping a coordinate is. Laws: swapping two
/// points negates it; the three points are collinear() iff it is 0 for all axes.
AMPS_EXPORT int orient2d(const double* a, const double* b, const double* c, int axis, OptionalTally tally = nullptr) noexcept;

/// True if the three points lie exactly on one line (or coincide).
AMPS_EXPORT bool collinear(const double* a, const double* b, const double* c) noexcept;

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
  AMPS_EXPORT Bisector(const WeightedPoint& owner, const WeightedPoint& other, const double* const corners[3]) noexcept;
};

/// Is corner v on the owner's side of bisector k? +1 yes, −1 no; never 0.
AMPS_EXPORT int side_of_corner(const double* const corners[3], int v, const Bisector& k,
                               OptionalTally tally = nullptr) noexcept;

/// Is the intersection of edge (u, v) with bisector j on the owner's side of bisector k? The edge must cross j (the sides of
/// its ends differ), and j and k have one owner. +1 yes, −1 no; never 0.
AMPS_EXPORT int side_of_edge_crossing(const double* const corners[3], int u, int v, const Bisector& j, const Bisector& k,
                                      OptionalTally tally = nullptr) noexcept;

/// Is the intersection of bisectors j and l in the facet's plane on the owner's side of bisector k? j and l must intersect
/// in a vertex of the clipped facet; all have one owner. +1 yes, −1 no; never 0.
AMPS_EXPORT int side_of_facet_crossing(const double* const corners[3], const Bisector& j, const Bisector& l, const Bisector& k,
                                       OptionalTally tally = nullptr) noexcept;

/// Barycentric coordinates of these vertices, each coordinate to a few 2^-46 relative to 1 whatever the conditioning (computed
/// exactly where the approximate values are not good enough). Same bits for any order of the three sites involved
/// and for both facets of an edge if its ends come in one order.
AMPS_EXPORT std::array<double, 2> edge_crossing_coordinates(const double* const corners[3], int u, int v,
                                                            const Bisector& j) noexcept;
AMPS_EXPORT Vec3 facet_crossing_coordinates(const double* const corners[3], const WeightedPoint& i, const WeightedPoint& j,
                                            const WeightedPoint& l) noexcept;

// Coverage: the power of the owner at the vertices of its fragments
//
// pow_i(v) = |v − p_i|² − w_i at a vertex v of a facet clipped by bisectors: +1 uncovered by the owner's ball, 0 on its sphere,
// −1 inside. Balls are closed: 0 is covered. There is no symbolic stage, because none is needed. The perturbation of weights
// moves v, but leaves the denominators of its coordinates alone, and they are not 0: as the ε tend to 0, v tends to the exact
// intersection of the unperturbed bisectors, and a fragment to the convex hull of these limits. That hull lies in the owner's
// unperturbed closed cell, and the hulls of a facet's fragments cover it. Therefore:
//   1. A facet is covered by the closed balls iff no vertex of its fragments is uncovered by its owner's. (If all are covered,
//      so is each hull, since balls are convex. If one is not, no other ball has it either: its owner is nearest in power.)
//   2. All owners of fragments that meet in v agree on the sign, in ties too: pow_i(v) = pow_j(v) on the bisector (i, j).
//   3. The sign does not depend on the order of u and v, of j and l, or of the corners.

/// At corner v of the facet.
inline int power_at_corner(const double* const corners[3], int v, const WeightedPoint& owner,
                           OptionalTally tally = nullptr) noexcept {
  const double centre[3] = {owner.x, owner.y, owner.z};
  return side_of_ball(corners[v], centre, owner.w, tally);
}

/// At the intersection of edge (u, v) with bisector j, whose owner is meant. The edge must cross j (the sides of its ends
/// differ).
AMPS_EXPORT int power_at_edge_crossing(const double* const corners[3], int u, int v, const Bisector& j,
                                       OptionalTally tally = nullptr) noexcept;

/// At the intersection of bisectors j and l in the facet's plane. j and l must intersect in a vertex of the clipped facet, and
/// have one owner, who is meant.
AMPS_EXPORT int power_at_facet_crossing(const double* const corners[3], const Bisector& j, const Bisector& l,
                                        OptionalTally tally = nullptr) noexcept;

namespace detail {

/// The power of one owner at vertices whose computed coordinates are known to an error, for the many that are far from its
/// sphere: one squared distance and two comparisons.
class PowerFilter {
 public:
  /// `error`: bound of the error of each coordinate of the points asked for.
  ///
  /// Let r² = w and δ = √3·error. A point of the closed ball is computed within r + δ of the centre, one that is not inside no
  /// nearer than r − δ, and 2rδ ≤ t·w + δ²/t for any t > 0, so that no root is needed:
  ///   (r + δ)² ≤ (1 + t)·w + (1 + 1/t)·δ²,   (r − δ)² ≥ (1 − t)·w − δ²/t.
  /// A fixed t will do: where δ is below t·r, few vertices in 2^28 fall between the thresholds. Roundings, of the squared
  /// distance (5 units of 2^-53) and here (4), are far below t; twice each term covers them, and kTiny underflow, gradual or
  /// flushed to zero. A negative weight makes every point outside, whatever the thresholds.
  PowerFilter(const WeightedPoint& owner, double error) noexcept : x_(owner.x), y_(owner.y), z_(owner.z) {
    constexpr double t = 0x1p-30;
    const double position = ((6 / t) * error) * error + 2 * Approx::kTiny;
    outside_ = owner.w * (1 + 2 * t) + position;
    inside_ = owner.w * (1 - 2 * t) - position;
  }

  /// As power_at_*, where x is farther from the sphere than all errors, else 0. NaN and infinity give 0 or the truth.
  int side(const Vec3& x) const noexcept {
    const double dx = x.x() - x_, dy = x.y() - y_, dz = x.z() - z_;
    const double squared = dx * dx + dy * dy + dz * dz;
    return (squared > outside_) - (squared < inside_);
  }

 private:
  double x_, y_, z_;
  double outside_, inside_;  ///< squared distances above the one are outside, below the other inside
};

}  // namespace detail

}  // namespace amps

#include "amps/host_macros_end.h"
