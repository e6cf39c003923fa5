#define AMPS_OWN_SOURCE
#include "amps/predicates.h"

#include <cmath>
#include <cstdlib>
#include <utility>

namespace amps {
namespace detail {

StaticBounds StaticBounds::for_set(const Vec3& extent, double weight_range, int unit) noexcept {
  StaticBounds bounds;
  // In multiples of the unit, all intermediate values are integers of at most the sum of the monomials' magnitudes: 6 of them
  // in an orientation, 24 in a power test. Below 2^53 doubles hold them all.
  if (std::abs(unit) < 150) {
    bounds.orientation_exact = std::ldexp(1.0, 50 + 3 * unit);
    bounds.power_exact = std::ldexp(1.0, 48 + 5 * unit);
  }
  // A flat box has no static bound of use; a huge or tiny one leaves it to the later stages.
  const double min_extent = extent.minCoeff(), max_extent = extent.maxCoeff();
  const double height = squared_norm(extent) + weight_range;
  if (!(max_extent < kFilterMax && min_extent > kFilterMin && height < kFilterMax)) return bounds;
  // The box's own extents carry a rounding; the slack of the constants covers it.
  const double volume = extent.x() * extent.y() * extent.z();
  bounds.orientation = kOrientationBound * volume;
  bounds.power = kPowerBound * height * volume;
  return bounds;
}

namespace {

void count_stage(OptionalTally tally, Stage stage) noexcept {
  if (tally != nullptr) tally->count(stage);
}

/// Runs `body` with the narrowest width that holds the scaled input: body(std::integral_constant<int, limbs>) → sign.
template <class Body>
auto with_exact_width(const ExactScale& scale, Stage& stage, Body&& body) {
  if (scale.bits() <= usable_bits(kNarrowLimbs)) {
    stage = Stage::kExactNarrow;
    return body(std::integral_constant<int, kNarrowLimbs>{});
  }
  if (scale.bits() <= usable_bits(kMiddleLimbs)) {
    stage = Stage::kExactMiddle;
    return body(std::integral_constant<int, kMiddleLimbs>{});
  }
  stage = Stage::kExactWide;
  return body(std::integral_constant<int, kWideLimbs>{});
}

void include_site(ExactScale& scale, const WeightedPoint& p) noexcept {
  scale.coordinate(p.x);
  scale.coordinate(p.y);
  scale.coordinate(p.z);
  scale.weight(p.w);
}

void include_position(ExactScale& scale, const double* p) noexcept {
  for (int k = 0; k < 3; ++k) scale.coordinate(p[k]);
}

/// a − b, exactly.
template <int N>
void exact_difference(const WeightedPoint& a, const WeightedPoint& b, int unit, Int<N> (&out)[3]) noexcept {
  out[0] = to_int<N>(a.x, unit) - to_int<N>(b.x, unit);
  out[1] = to_int<N>(a.y, unit) - to_int<N>(b.y, unit);
  out[2] = to_int<N>(a.z, unit) - to_int<N>(b.z, unit);
}

/// Sites in decreasing order of their ε; returns their positions in the argument list.
template <std::size_t K>
std::array<int, K> by_dominance(const std::array<const WeightedPoint*, K>& sites) noexcept {
  std::array<int, K> order{};
  for (std::size_t n = 0; n < K; ++n) {  // insertion sort: K ≤ 5
    std::size_t at = n;
    for (; at > 0 && lexicographically_less(*sites[static_cast<std::size_t>(order[at - 1])], *sites[n]); --at) {
      order[at] = order[at - 1];
    }
    order[at] = static_cast<int>(n);
  }
  return order;
}

}  // namespace

#ifdef AMPS_HAS_INT128
namespace {

/// Four differences of one coordinate as integers of at most 59 bits, all times `scale`; false if rounding to double has made
/// one inexact (the error term of Knuth's TwoSum) or they span more powers of two than that.
bool as_factors(const Column& difference, double WeightedPoint::*coordinate, const WeightedPoint* const p[4],
                const WeightedPoint& q, double scale, Factor (&row)[4][3], int column) noexcept {
  bool exact = true;
  for (int k = 0; k < 4; ++k) {
    const double a = p[k]->*coordinate, b = q.*coordinate, d = difference[k], back = a - d, scaled = d * scale;
    row[k][column].value = static_cast<std::int64_t>(scaled);
    exact = exact & ((a - (d + back)) + (back - b) == 0) & (static_cast<double>(row[k][column].value) == scaled);
  }
  return exact;
}

/// The same for the difference of two weights, times scale².
bool as_integer(double difference, double a, double b, double scale, Int128& result) noexcept {
  const double back = a - difference, scaled = difference * scale * scale;
  if (!((a - (difference + back)) + (back - b) == 0 && std::fabs(scaled) < 0x1p119)) return false;
  result = static_cast<Int128>(scaled);
  return static_cast<double>(result) == scaled;
}

/// The value to within 2^-51 of itself and 2^76: limb 0 and a bit of limb 1 are left out, the others rounded.
double approximately(const Int<3>& a) noexcept {
  return static_cast<double>(static_cast<std::int64_t>(a.limb[2])) * 0x1p128 +
         static_cast<double>(static_cast<std::int64_t>(a.limb[1] >> 1)) * 0x1p65;
}

/// The power test where it fits the machine's integers: d of 59 bits, h of 121, minors of 181, all of it 304 of 320 bits. False
/// if it does not.
bool power_test_in_words(const PowerRows& rows, const WeightedPoint* const p[4], const WeightedPoint& q, int& sign,
                         std::array<int, 4>& minor_signs) noexcept {
  const double largest = std::max({rows.x.largest(), rows.y.largest(), rows.z.largest()});
  if (!(largest < kFilterMax && largest > kFilterMin)) return false;
  int exponent;
  std::frexp(largest, &exponent);
  const double scale = std::ldexp(1.0, 59 - exponent);
  Factor d[4][3];
  if (!as_factors(rows.x, &WeightedPoint::x, p, q, scale, d, 0) || !as_factors(rows.y, &WeightedPoint::y, p, q, scale, d, 1) ||
      !as_factors(rows.z, &WeightedPoint::z, p, q, scale, d, 2)) {
    return false;
  }
  const auto minor = volume_minors(d);
  std::array<Int<3>, 4> m;
  for (std::size_t k = 0; k < 4; ++k) m[k] = to_limbs(minor[k]);

  // With exact minors doubles settle the rest for nearly all of a cospherical set: what cancels in the sum is h, not the
  // minors. Roundings: h 4, m 3, product 1, sums 3; 2^128 covers the absolute part of m's.
  double value = 0, magnitude = 0;
  for (int k = 0; k < 4; ++k) {
    const double v = approximately(m[slot(k)]);
    value += (k % 2 == 0 ? rows.h[k] : -rows.h[k]) * v;
    magnitude += (rows.h[k] + 2 * std::fabs(rows.w[k])) * (std::fabs(v) + 0x1p128);
  }
  const double bound = 32 * kUnitRoundoff * magnitude;
  if (value > bound || -value > bound) {
    sign = value > 0 ? 1 : -1;
    return true;
  }

  std::array<Int<2>, 4> h;
  for (int k = 0; k < 4; ++k) {
    Int128 weight = 0;
    if (rows.w[k] != 0 && !as_integer(rows.w[k], q.w, p[k]->w, scale, weight)) return false;
    h[slot(k)] = to_limbs(d[k][0] * d[k][0] + d[k][1] * d[k][1] + d[k][2] * d[k][2] + weight);
  }
  for (std::size_t k = 0; k < 4; ++k) minor_signs[k] = m[k].sign();
  sign = power_determinant(h, m).sign();
  return true;
}

}  // namespace
#endif

int power_test_in_limbs(const WeightedPoint* const p[4], const WeightedPoint& q, Stage& stage,
                        std::array<int, 4>& minor_signs) noexcept {
  ExactScale scale;
  for (int k = 0; k < 4; ++k) include_site(scale, *p[k]);
  include_site(scale, q);
  return with_exact_width(scale, stage, [&](auto width) {
    constexpr int N = decltype(width)::value;
    Int<N> d[4][3];
    std::array<Int<2 * N>, 4> h;
    const Int<2 * N> wq = to_int<2 * N>(q.w, 2 * scale.unit());
    for (int k = 0; k < 4; ++k) {
      exact_difference<N>(*p[k], q, scale.unit(), d[k]);
      h[slot(k)] = d[k][0] * d[k][0] + d[k][1] * d[k][1] + d[k][2] * d[k][2] + (wq - to_int<2 * N>(p[k]->w, 2 * scale.unit()));
    }
    const auto minor = volume_minors(d);
    for (std::size_t k = 0; k < 4; ++k) minor_signs[k] = minor[k].sign();
    return power_determinant(h, minor).sign();
  });
}

}  // namespace detail

int orient3d_exact(const WeightedPoint& a, const WeightedPoint& b, const WeightedPoint& c, const WeightedPoint& d,
                   Stage& stage) noexcept {
  detail::ExactScale scale;
  for (const WeightedPoint* p : {&a, &b, &c, &d}) {
    scale.coordinate(p->x);
    scale.coordinate(p->y);
    scale.coordinate(p->z);
  }
  return detail::with_exact_width(scale, stage, [&](auto width) {
    constexpr int N = decltype(width)::value;
    detail::Int<N> m[3][3];
    detail::exact_difference<N>(b, a, scale.unit(), m[0]);
    detail::exact_difference<N>(c, a, scale.unit(), m[1]);
    detail::exact_difference<N>(d, a, scale.unit(), m[2]);
    return detail::determinant3(m[0], m[1], m[2]).sign();
  });
}

int power_test_exact(const detail::PowerRows& rows, const WeightedPoint* const p[4], const WeightedPoint& q, Stage& stage,
                     std::array<int, 4>& minor_signs) noexcept {
#ifdef AMPS_HAS_INT128
  int sign;
  if (detail::power_test_in_words(rows, p, q, sign, minor_signs)) {
    stage = Stage::kExactMachine;
    return sign;
  }
#else
  static_cast<void>(rows);
#endif
  return detail::power_test_in_limbs(p, q, stage, minor_signs);
}

using detail::Approx;
using detail::ExactScale;
using detail::Int;

int side_of_ball(const double* x, const double* p, double w, OptionalTally tally) noexcept {
  const Approx dx = Approx(x[0]) - Approx(p[0]), dy = Approx(x[1]) - Approx(p[1]), dz = Approx(x[2]) - Approx(p[2]);
  if (const int sign = (dx * dx + dy * dy + dz * dz - Approx(w)).certain_sign()) {
    detail::count_stage(tally, Stage::kFilter);
    return sign;
  }
  ExactScale scale;
  detail::include_position(scale, x);
  detail::include_position(scale, p);
  scale.weight(w);
  Stage stage;
  const int sign = detail::with_exact_width(scale, stage, [&](auto width) {
    constexpr int N = decltype(width)::value;
    const int unit = scale.unit();
    const auto square = [&](int k) {
      const auto d = detail::to_int<N>(x[k], unit) - detail::to_int<N>(p[k], unit);
      return d * d;
    };
    return (square(0) + square(1) + square(2) - detail::to_int<2 * N>(w, 2 * unit)).sign();
  });
  detail::count_stage(tally, stage);
  return sign;
}

namespace detail {
namespace {

/// Bits of coordinates with which doubles hold everything that segment_side() computes.
constexpr int kSegmentBitsOfDouble = 11;
/// Powers of two of the unit with which its products neither overflow nor underflow.
constexpr int kSegmentUnitOfDouble = 200;

/// Sign of |x − p|² − w at the nearest point of a segment whose ends relative to p are a and b.
/// Width: let coordinates be below 2^c, weights below 2^(2c). Differences are below 2^(c+1), their products' sums of three
/// below 2^(2c+4), coordinates of the cross product below 2^(2c+3), its square below 2^(4c+8), the whole below 2^(4c+9): 53
/// bits for c = 11, and 4·N limbs have 4·c + 23 bits beside the sign for c = 64·N − 6.
template <class T, class W>
int segment_side(const T (&a)[3], const T (&b)[3], const W& w) noexcept {
  const auto dot = [](const auto& s, const auto& t) { return s[0] * t[0] + s[1] * t[1] + s[2] * t[2]; };
  const T u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
  if (sign_of(dot(u, a)) >= 0) return sign_of(dot(a, a) - w);
  if (sign_of(dot(u, b)) <= 0) return sign_of(dot(b, b) - w);
  const auto minor = [&](int i, int k) { return a[i] * b[k] - a[k] * b[i]; };
  const decltype(minor(0, 1)) cross[3] = {minor(1, 2), minor(2, 0), minor(0, 1)};
  return sign_of(dot(cross, cross) - w * dot(u, u));
}

}  // namespace

int segment_side_of_ball_exact(const double* a, const double* b, const double* p, double w, Stage& stage) noexcept {
  ExactScale scale;
  for (const double* x : {a, b, p}) include_position(scale, x);
  scale.weight(w);
  if (scale.bits() <= kSegmentBitsOfDouble && std::abs(scale.unit()) < kSegmentUnitOfDouble) {
    stage = Stage::kExactDouble;
    const double from_a[3] = {a[0] - p[0], a[1] - p[1], a[2] - p[2]}, from_b[3] = {b[0] - p[0], b[1] - p[1], b[2] - p[2]};
    return segment_side(from_a, from_b, w);
  }
  return with_exact_width(scale, stage, [&](auto width) {
    constexpr int N = decltype(width)::value;
    const int unit = scale.unit();
    Int<N> from_a[3], from_b[3];
    for (int k = 0; k < 3; ++k) {
      const auto centre = to_int<N>(p[k], unit);
      from_a[k] = to_int<N>(a[k], unit) - centre;
      from_b[k] = to_int<N>(b[k], unit) - centre;
    }
    return segment_side(from_a, from_b, to_int<2 * N>(w, 2 * unit));
  });
}

}  // namespace detail

int segment_side_of_ball(const double* a, const double* b, const double* p, double w, OptionalTally tally) noexcept {
  const detail::SegmentFilter filter(p, w);
  if (const int sign = filter.side(filter.end(a), filter.end(b))) {
    detail::count_stage(tally, Stage::kFilter);
    return sign;
  }
  Stage stage;
  const int sign = detail::segment_side_of_ball_exact(a, b, p, w, stage);
  detail::count_stage(tally, stage);
  return sign;
}

namespace detail {
namespace {

/// The stages of orient2d() after the filter.
int orient2d_exact(const double* a, const double* b, const double* c, int axis, Stage& stage) noexcept {
  const int m = (axis + 1) % 3, n = (axis + 2) % 3;
  // On lines along axes both products are 0 because a factor is; a difference of doubles is 0 only if they are equal.
  if ((a[m] == b[m] || a[n] == c[n]) && (a[n] == b[n] || a[m] == c[m])) {
    stage = Stage::kExactDouble;
    return 0;
  }
  ExactScale scale;
  for (const double* p : {a, b, c}) {
    scale.coordinate(p[m]);
    scale.coordinate(p[n]);
  }
  return with_exact_width(scale, stage, [&](auto width) {
    constexpr int N = decltype(width)::value;
    const auto difference = [&](const double* p, int k) {
      return to_int<N>(p[k], scale.unit()) - to_int<N>(a[k], scale.unit());
    };
    return (difference(b, m) * difference(c, n) - difference(b, n) * difference(c, m)).sign();
  });
}

}  // namespace
}  // namespace detail

int orient2d(const double* a, const double* b, const double* c, int axis, OptionalTally tally) noexcept {
  if (const int sign = detail::orient2d_filter(a, b, c, axis)) {
    detail::count_stage(tally, Stage::kFilter);
    return sign;
  }
  Stage stage;
  const int sign = detail::orient2d_exact(a, b, c, axis, stage);
  detail::count_stage(tally, stage);
  return sign;
}

bool collinear(const double* a, const double* b, const double* c) noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    if (detail::orient2d_filter(a, b, c, axis) != 0) return false;
  }
  Stage stage;
  return detail::orient2d_exact(a, b, c, 0, stage) == 0 && detail::orient2d_exact(a, b, c, 1, stage) == 0 &&
         detail::orient2d_exact(a, b, c, 2, stage) == 0;
}

Bisector::Bisector(const WeightedPoint& i, const WeightedPoint& j, const double* const corners[3]) noexcept
    : owner(&i), other(&j) {
  // The bound in closed form, for speed (Approx takes twice as long): a monomial d·(a or b) passes through at most 7 roundings
  // (two differences, a sum, a product, three sums), the difference of weights through 2. The last summand covers underflow of
  // products.
  constexpr double kTermBound = 8 * detail::kUnitRoundoff, kWeightBound = 3 * detail::kUnitRoundoff;
  const double pi[3] = {i.x, i.y, i.z}, pj[3] = {j.x, j.y, j.z};
  const double weight_error = kWeightBound * std::fabs(i.w - j.w) + 8 * Approx::kTiny;
  for (std::size_t c = 0; c < 3; ++c) {
    const double x[3] = {corners[c][0], corners[c][1], corners[c][2]};
    double magnitude = 0;
    for (int k = 0; k < 3; ++k) magnitude += std::fabs(pj[k] - pi[k]) * (std::fabs(pj[k] - x[k]) + std::fabs(pi[k] - x[k]));
    at_corner[c] = {detail::bisector_value(pi, i.w, pj, j.w, x), kTermBound * magnitude + weight_error};
  }
}

namespace detail {
namespace {

/// The exact values of a bisector at the corners of a facet.
template <int N>
struct ExactBisector {
  Int<2 * N> at_corner[3];
  ExactBisector(const WeightedPoint& i, const WeightedPoint& j, const double* const corners[3], int unit) noexcept {
    const auto position = [unit](const double* p, Int<N>(&out)[3]) {
      for (int k = 0; k < 3; ++k) out[k] = to_int<N>(p[k], unit);
    };
    Int<N> pi[3], pj[3], x[3];
    const double at_i[3] = {i.x, i.y, i.z}, at_j[3] = {j.x, j.y, j.z};
    position(at_i, pi);
    position(at_j, pj);
    const auto wi = to_int<2 * N>(i.w, 2 * unit), wj = to_int<2 * N>(j.w, 2 * unit);
    for (int c = 0; c < 3; ++c) {
      position(corners[c], x);
      at_corner[c] = bisector_value(pi, wi, pj, wj, x);
    }
  }
};

ExactScale facet_scale(const double* const corners[3], std::initializer_list<const WeightedPoint*> sites) noexcept {
  ExactScale scale;
  for (int c = 0; c < 3; ++c) include_position(scale, corners[c]);
  for (const WeightedPoint* site : sites) include_site(scale, *site);
  return scale;
}

/// The formulas of the three kinds of vertices over any number type.
template <class T>
auto edge_numerator(const T& ju, const T& jv, const T& ku, const T& kv) noexcept {
  return ju * kv - ku * jv;
}
template <class T>
struct CrossProduct {
  using Product = decltype(std::declval<T>() * std::declval<T>());
  Product at[3];
  CrossProduct(const T* a, const T* b) noexcept {
    at[0] = a[1] * b[2] - a[2] * b[1];
    at[1] = a[2] * b[0] - a[0] * b[2];
    at[2] = a[0] * b[1] - a[1] * b[0];
  }
  auto sum() const noexcept { return at[0] + at[1] + at[2]; }
  auto dot(const T* d) const noexcept { return d[0] * at[0] + d[1] * at[1] + d[2] * at[2]; }
};

/// The first non-zero coefficient in decreasing order of dominance.
template <std::size_t K>
int decide_by_dominance(const std::array<const WeightedPoint*, K>& sites, const std::array<int, K>& coefficient_sign) noexcept {
  for (const int k : by_dominance<K>(sites)) {
    if (const int sign = coefficient_sign[static_cast<std::size_t>(k)]) return sign;
  }
  return 1;
}

}  // namespace
}  // namespace detail

int side_of_corner(const double* const corners[3], int v, const Bisector& k, OptionalTally tally) noexcept {
  if (const int sign = k.at_corner[static_cast<std::size_t>(v)].certain_sign()) {
    detail::count_stage(tally, Stage::kFilter);
    return sign;
  }
  const double* const x = corners[v];
  const double* const only[3] = {x, x, x};
  const ExactScale scale = detail::facet_scale(only, {k.owner, k.other});
  Stage stage;
  int sign = detail::with_exact_width(scale, stage, [&](auto width) {
    const detail::ExactBisector<decltype(width)::value> value(*k.owner, *k.other, only, scale.unit());
    return value.at_corner[0].sign();
  });
  if (sign == 0) {
    // D_k gains ε_k − ε_i.
    stage = Stage::kSymbolic;
    sign = detail::decide_by_dominance<2>({k.other, k.owner}, {1, -1});
  }
  detail::count_stage(tally, stage);
  return sign;
}

int side_of_edge_crossing(const double* const corners[3], int u, int v, const Bisector& j, const Bisector& k,
                          OptionalTally tally) noexcept {
  const auto su = static_cast<std::size_t>(u), sv = static_cast<std::size_t>(v);
  {
    const Approx numerator = detail::edge_numerator(j.at_corner[su], j.at_corner[sv], k.at_corner[su], k.at_corner[sv]);
    const Approx denominator = j.at_corner[su] - j.at_corner[sv];
    if (const int sign = numerator.certain_sign() * denominator.certain_sign()) {
      detail::count_stage(tally, Stage::kFilter);
      return sign;
    }
  }
  const double* const ends[3] = {corners[u], corners[v], corners[v]};
  const ExactScale scale = detail::facet_scale(ends, {j.owner, j.other, k.other});
  Stage stage;
  int sign = 0, denominator_sign = 0, slope_sign = 0, sum_sign = 0;
  detail::with_exact_width(scale, stage, [&](auto width) {
    constexpr int N = decltype(width)::value;
    const detail::ExactBisector<N> dj(*j.owner, *j.other, ends, scale.unit());
    const detail::ExactBisector<N> dk(*j.owner, *k.other, ends, scale.unit());
    const auto denominator = dj.at_corner[0] - dj.at_corner[1];
    const auto slope = dk.at_corner[1] - dk.at_corner[0];
    sign = detail::edge_numerator(dj.at_corner[0], dj.at_corner[1], dk.at_corner[0], dk.at_corner[1]).sign();
    denominator_sign = denominator.sign();
    slope_sign = slope.sign();
    sum_sign = (denominator + slope).sign();
    return 0;
  });
  if (sign == 0) {
    // The numerator gains ε_k·(D_j(u) − D_j(v)) + ε_j·(D_k(v) − D_k(u)) − ε_i·(sum of both).
    stage = Stage::kSymbolic;
    sign = detail::decide_by_dominance<3>({k.other, j.other, j.owner}, {denominator_sign, slope_sign, -sum_sign});
  }
  detail::count_stage(tally, stage);
  return sign * denominator_sign;
}

int side_of_facet_crossing(const double* const corners[3], const Bisector& j, const Bisector& l, const Bisector& k,
                           OptionalTally tally) noexcept {
  {
    const detail::CrossProduct<Approx> lambda(j.at_corner.data(), l.at_corner.data());
    if (const int sign = lambda.dot(k.at_corner.data()).certain_sign() * lambda.sum().certain_sign()) {
      detail::count_stage(tally, Stage::kFilter);
      return sign;
    }
  }
  const ExactScale scale = detail::facet_scale(corners, {j.owner, j.other, l.other, k.other});
  Stage stage;
  int sign = 0, sum_sign = 0, j_sign = 0, l_sign = 0, total_sign = 0;
  detail::with_exact_width(scale, stage, [&](auto width) {
    constexpr int N = decltype(width)::value;
    const detail::ExactBisector<N> dj(*j.owner, *j.other, corners, scale.unit());
    const detail::ExactBisector<N> dl(*j.owner, *l.other, corners, scale.unit());
    const detail::ExactBisector<N> dk(*j.owner, *k.other, corners, scale.unit());
    using Cross = detail::CrossProduct<Int<2 * N>>;
    const Cross lambda(dj.at_corner, dl.at_corner);
    sign = lambda.dot(dk.at_corner).sign();
    const auto for_k = lambda.sum();                             // det[1; D_j; D_l]
    const auto for_j = Cross(dl.at_corner, dk.at_corner).sum();  // det[D_k; 1; D_l]
    const auto for_l = Cross(dk.at_corner, dj.at_corner).sum();  // det[D_k; D_j; 1]
    sum_sign = for_k.sign();
    j_sign = for_j.sign();
    l_sign = for_l.sign();
    total_sign = (for_k + for_j + for_l).sign();
    return 0;
  });
  if (sign == 0) {
    stage = Stage::kSymbolic;
    sign = detail::decide_by_dominance<4>({k.other, j.other, l.other, j.owner}, {sum_sign, j_sign, l_sign, -total_sign});
  }
  detail::count_stage(tally, stage);
  return sign * sum_sign;
}

namespace detail {
namespace {

/// Coordinates whose bound is worse than this, relative to 1, are computed exactly. Facet edges are rarely longer than 1,000
/// radii, where it means 1e-11 of a radius: well below the certificate's tolerance.
constexpr double kCoordinateTolerance = 0x1p-46;

/// May a sum of terms divide each of them? Its bound covers theirs. Strictly less: false for infinities and NaN on both sides.
bool accurate_enough(const Approx& sum) noexcept { return sum.error < kCoordinateTolerance * std::fabs(sum.value); }

template <int N>
double ratio(const Int<N>& numerator, const Int<N>& denominator) noexcept {
  int en, ed;
  const double n = mantissa_exponent(numerator, en);
  const double d = mantissa_exponent(denominator, ed);
  return std::ldexp(n / d, en - ed);
}

double clamp01(double t) noexcept { return t < 0 ? 0 : (t > 1 ? 1 : t); }

}  // namespace
}  // namespace detail

std::array<double, 2> edge_crossing_coordinates(const double* const corners[3], int u, int v, const Bisector& j) noexcept {
  const Approx du = j.at_corner[static_cast<std::size_t>(u)], dv = j.at_corner[static_cast<std::size_t>(v)];
  const Approx difference = du - dv;
  if (detail::accurate_enough(difference)) {
    return {detail::clamp01(-dv.value / difference.value), detail::clamp01(du.value / difference.value)};
  }
  const double* const ends[3] = {corners[u], corners[v], corners[v]};
  const ExactScale scale = detail::facet_scale(ends, {j.owner, j.other});
  Stage stage;
  return detail::with_exact_width(scale, stage, [&](auto width) -> std::array<double, 2> {
    const detail::ExactBisector<decltype(width)::value> d(*j.owner, *j.other, ends, scale.unit());
    const auto exact_difference = d.at_corner[0] - d.at_corner[1];
    if (exact_difference.sign() == 0) return {0.5, 0.5};  // not a crossing: the caller broke the requirement
    return {detail::clamp01(detail::ratio(-d.at_corner[1], exact_difference)),
            detail::clamp01(detail::ratio(d.at_corner[0], exact_difference))};
  });
}

Vec3 facet_crossing_coordinates(const double* const corners[3], const WeightedPoint& i, const WeightedPoint& j,
                                const WeightedPoint& l) noexcept {
  // One order of the sites, so that all three of them compute the same bits.
  std::array<const WeightedPoint*, 3> site = {&i, &j, &l};
  if (lexicographically_less(*site[1], *site[0])) std::swap(site[0], site[1]);
  if (lexicographically_less(*site[2], *site[1])) std::swap(site[1], site[2]);
  if (lexicographically_less(*site[1], *site[0])) std::swap(site[0], site[1]);
  {
    const Bisector a(*site[0], *site[1], corners), b(*site[0], *site[2], corners);
    const detail::CrossProduct<Approx> lambda(a.at_corner.data(), b.at_corner.data());
    const Approx sum = lambda.sum();
    if (detail::accurate_enough(sum)) {
      return {detail::clamp01(lambda.at[0].value / sum.value), detail::clamp01(lambda.at[1].value / sum.value),
              detail::clamp01(lambda.at[2].value / sum.value)};
    }
  }
  const ExactScale scale = detail::facet_scale(corners, {site[0], site[1], site[2]});
  Stage stage;
  return detail::with_exact_width(scale, stage, [&](auto width) -> Vec3 {
    constexpr int N = decltype(width)::value;
    const detail::ExactBisector<N> a(*site[0], *site[1], corners, scale.unit());
    const detail::ExactBisector<N> b(*site[0], *site[2], corners, scale.unit());
    const detail::CrossProduct<Int<2 * N>> lambda(a.at_corner, b.at_corner);
    const auto sum = lambda.sum();
    if (sum.sign() == 0) return Vec3::Constant(1.0 / 3);  // not a crossing: the caller broke the requirement
    return {detail::clamp01(detail::ratio(lambda.at[0], sum)), detail::clamp01(detail::ratio(lambda.at[1], sum)),
            detail::clamp01(detail::ratio(lambda.at[2], sum))};
  });
}

namespace detail {
namespace {

/// (Σλ)²·(|v − p|² − w) at v = Σ λ_c·x_c / Σλ, where relative[c] = x_c − p: the sign of the power at v. Differences to the
/// centre come first, so that the error is relative to the facet's size, and not to its distance from the origin.
/// Width: let coordinates be below 2^b, b = 64·N − 6 (usable_bits), weights below 2^(2b). Then |relative| < 2^(b+1), and
/// bisector values are below 3·2^(2b+3) + 2^(2b+1) < 2^(2b+5), which 2·N limbs hold. Edge: λ are bisector values, Σλ <
/// 2^(2b+6), Σ λ·relative < 2^(3b+7), both summands of the result below 3·2^(6b+14) < 2^(6b+16): 6·N limbs hold it. Facet: λ <
/// 2^(4b+11), Σλ < 2^(4b+13), Σ λ·relative < 3·2^(5b+12) < 2^(5b+14), the result below 3·2^(10b+28) + 2^(10b+26) < 2^(10b+30):
/// 10·N limbs have 10·b + 59 bits beside the sign.
template <std::size_t K, class L, class X, class W>
auto scaled_power(const L (&lambda)[K], const X (&relative)[K][3], const W& w) noexcept {
  const auto squared_coordinate = [&](int k) {
    auto sum = lambda[0] * relative[0][k];
    for (std::size_t c = 1; c < K; ++c) sum = sum + lambda[c] * relative[c][k];
    return sum * sum;
  };
  auto denominator = lambda[0];
  for (std::size_t c = 1; c < K; ++c) denominator = denominator + lambda[c];
  return (squared_coordinate(0) + squared_coordinate(1) + squared_coordinate(2)) - w * (denominator * denominator);
}

/// corners[c] − p for the first K corners, in the number type that `convert` makes of a double.
template <std::size_t K, class T, class Convert>
void subtract_centre(const double* const corners[3], const WeightedPoint& p, Convert&& convert, T (&relative)[K][3]) noexcept {
  const T centre[3] = {convert(p.x), convert(p.y), convert(p.z)};
  for (std::size_t c = 0; c < K; ++c) {
    for (int k = 0; k < 3; ++k) relative[c][k] = convert(corners[c][k]) - centre[k];
  }
}

/// The filter, with λ from approximate bisector values. The expression is some 40 operations deep.
template <std::size_t K>
int approximate_power_sign(const Approx (&lambda)[K], const double* const corners[3], const WeightedPoint& owner) noexcept {
  Approx relative[K][3];
  subtract_centre(
      corners, owner, [](double x) { return Approx(x); }, relative);
  return scaled_power(lambda, relative, Approx(owner.w)).certain_sign();
}

template <int N, std::size_t K, class L>
int exact_power_sign(const L (&lambda)[K], const double* const corners[3], const WeightedPoint& owner, int unit) noexcept {
  Int<N> relative[K][3];
  subtract_centre(
      corners, owner, [unit](double x) { return to_int<N>(x, unit); }, relative);
  return scaled_power(lambda, relative, to_int<2 * N>(owner.w, 2 * unit)).sign();
}

}  // namespace
}  // namespace detail

int power_at_edge_crossing(const double* const corners[3], int u, int v, const Bisector& j, OptionalTally tally) noexcept {
  const WeightedPoint& owner = *j.owner;
  const double* const ends[3] = {corners[u], corners[v], corners[v]};
  const Approx approximate[2] = {-j.at_corner[static_cast<std::size_t>(v)], j.at_corner[static_cast<std::size_t>(u)]};
  Stage stage = Stage::kFilter;
  int sign = detail::approximate_power_sign(approximate, ends, owner);
  if (sign == 0) {
    const ExactScale scale = detail::facet_scale(ends, {j.owner, j.other});
    sign = detail::with_exact_width(scale, stage, [&](auto width) {
      constexpr int N = decltype(width)::value;
      const detail::ExactBisector<N> d(owner, *j.other, ends, scale.unit());
      const Int<2 * N> lambda[2] = {-d.at_corner[1], d.at_corner[0]};
      return detail::exact_power_sign<N>(lambda, ends, owner, scale.unit());
    });
  }
  detail::count_stage(tally, stage);
  return sign;
}

int power_at_facet_crossing(const double* const corners[3], const Bisector& j, const Bisector& l,
                            OptionalTally tally) noexcept {
  const WeightedPoint& owner = *j.owner;
  const detail::CrossProduct<Approx> approximate(j.at_corner.data(), l.at_corner.data());
  Stage stage = Stage::kFilter;
  int sign = detail::approximate_power_sign(approximate.at, corners, owner);
  if (sign == 0) {
    const ExactScale scale = detail::facet_scale(corners, {j.owner, j.other, l.other});
    sign = detail::with_exact_width(scale, stage, [&](auto width) {
      constexpr int N = decltype(width)::value;
      const detail::ExactBisector<N> dj(owner, *j.other, corners, scale.unit());
      const detail::ExactBisector<N> dl(owner, *l.other, corners, scale.unit());
      const detail::CrossProduct<Int<2 * N>> lambda(dj.at_corner, dl.at_corner);
      return detail::exact_power_sign<N>(lambda.at, corners, owner, scale.unit());
    });
  }
  detail::count_stage(tally, stage);
  return sign;
}

}  // namespace amps
