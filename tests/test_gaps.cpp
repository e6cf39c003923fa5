#include "amps/gaps.h"
#include "amps/predicates.h"

#include <Eigen/Geometry>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

using amps::Rng;
using amps::Vec3;
using amps::detail::Ball;
using amps::detail::FragmentGap;
using amps::detail::FragmentView;

namespace {

using Real = long double;
const Real kPiReal = 3.141592653589793238462643383279502884L;
const double kTwoPi = static_cast<double>(2 * kPiReal);

struct GapCase {
  std::string kind;
  std::vector<Vec3> corners;
  Vec3 normal = Vec3::UnitZ();
  Ball ball;
  FragmentView view() const { return {corners.data(), corners.size(), normal}; }
  /// By the exact sign at the doubles of the corners.
  bool is_uncovered(const Vec3& x) const { return amps::side_of_ball(x.data(), ball.centre.data(), ball.weight) > 0; }
  std::vector<char> uncovered() const {
    std::vector<char> result;
    for (const Vec3& x : corners) result.push_back(is_uncovered(x));
    return result;
  }
  bool has_gap() const {
    return std::any_of(corners.begin(), corners.end(), [this](const Vec3& x) { return is_uncovered(x); });
  }
};

double between(Rng& rng, double low, double high) { return low + (high - low) * rng.uniform(); }

Eigen::Matrix3d random_rotation(Rng& rng) {
  Eigen::Vector4d q;
  do {
    for (int k = 0; k < 4; ++k) q[k] = between(rng, -1, 1);
  } while (q.squaredNorm() > 1 || q.squaredNorm() < 0.01);
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
}

/// A convex polygon in an ellipse, counter-clockwise.
std::vector<Eigen::Vector2d> random_polygon(Rng& rng, int n, double aspect) {
  std::vector<double> angles;
  for (int k = 0; k < n; ++k) angles.push_back(between(rng, 0, kTwoPi));
  std::sort(angles.begin(), angles.end());
  std::vector<Eigen::Vector2d> polygon;
  for (double a : angles) polygon.emplace_back(std::cos(a), aspect * std::sin(a));
  return polygon;
}

const char* const kGapKinds[] = {"any",           "tiny", "ring",          "far", "sliver", "plane misses ball",
                                 "grazing plane", "rim",  "centre outside"};

/// Polygons and balls of each kind, turned in space and off the origin.
GapCase random_case(Rng& rng, const std::string& kind) {
  GapCase c;
  c.kind = kind;
  const int n = 3 + static_cast<int>(rng.below(8));
  std::vector<Eigen::Vector2d> polygon =
      random_polygon(rng, n, kind == "sliver" ? std::pow(10.0, -between(rng, 2, 7)) : between(rng, 0.2, 1));
  Eigen::Vector2d centre(between(rng, -1, 1), between(rng, -1, 1));
  double height = between(rng, -0.3, 0.3);
  double radius = between(rng, 0.35, 1.5);
  if (kind == "ring" || kind == "rim") {
    polygon.clear();  // around the unit circle, touching it for "rim"
    for (int k = 0; k < n; ++k) {
      const double a = kTwoPi * (k + between(rng, -0.2, 0.2)) / n;
      polygon.emplace_back(std::cos(a), std::sin(a));
    }
    centre.setZero();
    double inscribed = 1;
    for (std::size_t k = 0; k < polygon.size(); ++k) {
      inscribed = std::min(inscribed, (0.5 * (polygon[k] + polygon[(k + 1) % polygon.size()])).norm());
    }
    if (kind == "ring" && inscribed < 0.1) inscribed = 0.05;
    height = 0;
    radius = inscribed * (kind == "ring" ? between(rng, 0.05, 0.999) : 1 + between(rng, -1, 1) * 1e-7);
  }
  if (kind == "far") centre *= between(rng, 3, 1000);
  if (kind == "plane misses ball") height = radius * between(rng, 1.01, 5);
  if (kind == "grazing plane") height = radius * (1 - std::pow(10.0, -between(rng, 1, 6)));
  if (kind == "centre outside") centre = polygon[0] * between(rng, 1.2, 2), radius = between(rng, 0.5, 2);

  const Eigen::Matrix3d rotation = random_rotation(rng);
  const Vec3 offset(between(rng, -1, 1), between(rng, -1, 1), between(rng, -1, 1));
  for (const auto& v : polygon) c.corners.push_back(rotation * Vec3(v.x(), v.y(), 0) + offset);
  c.normal = rotation.col(2);
  c.ball.centre = rotation * Vec3(centre.x(), centre.y(), height) + offset;
  c.ball.weight = radius * radius;
  if (kind == "tiny") {  // the farthest corner sticks out by 1e-9 … 1e-3
    double farthest = 0;
    for (const Vec3& v : c.corners) farthest = std::max(farthest, (v - c.ball.centre).squaredNorm());
    c.ball.weight = farthest / (1 + std::pow(10.0, -between(rng, 3, 9)));
  }
  return c;
}

struct Flat {
  Real x, y;
};

/// The oracle's own frame: first axis along the longest edge, in extended precision.
struct OracleFrame {
  Real u[3], v[3], height;
  Vec3 centre;

  explicit OracleFrame(const GapCase& c) : centre(c.ball.centre) {
    std::size_t longest = 0;
    double length = -1;
    for (std::size_t k = 0; k < c.corners.size(); ++k) {
      const double l = (c.corners[(k + 1) % c.corners.size()] - c.corners[k]).norm();
      if (l > length) length = l, longest = k;
    }
    Real n[3], norm = 0, dot = 0;
    for (int i = 0; i < 3; ++i) n[i] = c.normal[i];
    for (int i = 0; i < 3; ++i) norm += n[i] * n[i];
    for (int i = 0; i < 3; ++i) n[i] /= std::sqrt(norm);
    for (int i = 0; i < 3; ++i) u[i] = Real(c.corners[(longest + 1) % c.corners.size()][i]) - c.corners[longest][i];
    for (int i = 0; i < 3; ++i) dot += u[i] * n[i];
    norm = 0;
    for (int i = 0; i < 3; ++i) u[i] -= dot * n[i], norm += u[i] * u[i];
    for (int i = 0; i < 3; ++i) u[i] /= std::sqrt(norm);
    for (int i = 0; i < 3; ++i) v[i] = n[(i + 1) % 3] * u[(i + 2) % 3] - n[(i + 2) % 3] * u[(i + 1) % 3];
    height = 0;  // of the corner farthest out, where rounding matters most
    Real farthest = -1;
    for (const Vec3& corner : c.corners) {
      Real d2 = 0, h = 0;
      for (int i = 0; i < 3; ++i) {
        const Real d = Real(corner[i]) - c.ball.centre[i];
        d2 += d * d;
        h += d * n[i];
      }
      if (d2 > farthest) farthest = d2, height = h;
    }
  }
  Flat operator()(const Vec3& p) const {
    Flat f{0, 0};
    for (int i = 0; i < 3; ++i) f.x += u[i] * (Real(p[i]) - centre[i]), f.y += v[i] * (Real(p[i]) - centre[i]);
    return f;
  }
};

struct OracleGap {
  Real area = 0;
  Real outside_length = 0;  ///< of the polygon's boundary
  Real disk = 0;            ///< squared radius
};

/// Polygon minus disk by quadrature: the part of the cone from the disk's centre over an edge that lies beyond the disk is
/// ∫ cross(a, b)/2 · max(0, 1 − R²/ρ(t)²) dt along the edge, signed. Gauss–Legendre on pieces that end where ρ = R.
OracleGap oracle_gap(const GapCase& c) {
  const OracleFrame frame(c);
  OracleGap gap;
  gap.disk = Real(c.ball.weight) - frame.height * frame.height;
  const Real node[5] = {0, 0.5384693101056830910363144L, -0.5384693101056830910363144L, 0.9061798459386639927976269L,
                        -0.9061798459386639927976269L};
  const Real weight[5] = {0.5688888888888888888888889L, 0.4786286704993664680412915L, 0.4786286704993664680412915L,
                          0.2369268850561890875142640L, 0.2369268850561890875142640L};
  const std::size_t n = c.corners.size();
  for (std::size_t k = 0; k < n; ++k) {
    const Flat a = frame(c.corners[k]);
    const Flat b = frame(c.corners[(k + 1) % n]);
    const Real dx = b.x - a.x, dy = b.y - a.y, cross = a.x * b.y - a.y * b.x, length = std::sqrt(dx * dx + dy * dy);
    const auto rho2 = [&](Real t) { return (a.x + t * dx) * (a.x + t * dx) + (a.y + t * dy) * (a.y + t * dy); };
    const Real nearest = length > 0 ? std::min(Real(1), std::max(Real(0), -(a.x * dx + a.y * dy) / (length * length))) : 0;
    for (int side = 0; side < 2; ++side) {  // from the nearest point to either end, where ρ grows
      const Real end = side == 0 ? 0 : 1;
      if (rho2(end) <= gap.disk) continue;
      Real from = nearest;
      if (rho2(nearest) < gap.disk) {
        Real in = nearest, out = end;
        for (int i = 0; i < 200; ++i) {
          const Real middle = (in + out) / 2;
          (rho2(middle) < gap.disk ? in : out) = middle;
        }
        from = out;
      }
      gap.outside_length += std::abs(end - from) * length;
      // Geometric pieces toward the nearest point, where 1/ρ² varies fastest.
      Real sum = 0, low = 0;
      for (int piece = 200; piece >= 0; --piece) {
        const Real high = piece == 0 ? 1 : std::pow(Real(0.9), piece);
        const Real half = (high - low) / 2, middle = (high + low) / 2;
        for (int i = 0; i < 5; ++i) {
          const Real r2 = rho2(from + (end - from) * (middle + half * node[i]));
          if (r2 > 0) sum += weight[i] * half * std::max(Real(0), gap.disk > 0 ? 1 - gap.disk / r2 : Real(1));
        }
        low = high;
      }
      gap.area += std::abs(end - from) * sum * cross / 2;
    }
  }
  return gap;
}

double triangle_area(const std::array<Vec3, 3>& t) { return 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).norm(); }

/// Distance by which x is outside of the triangle, in its plane; ≤ 0 inside.
double outside_by(const std::array<Vec3, 3>& t, const Vec3& normal, const Vec3& x) {
  double worst = -1e300;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3 edge = t[(k + 1) % 3] - t[k];
    if (edge.norm() > 0) worst = std::max(worst, -normal.cross(edge).dot(x - t[k]) / edge.norm());
  }
  return worst;
}

/// A square of side 2 around the origin in the plane z = 0.
GapCase square_case(const Vec3& centre, double radius) {
  GapCase c;
  c.corners = {Vec3(-1, -1, 0), Vec3(1, -1, 0), Vec3(1, 1, 0), Vec3(-1, 1, 0)};
  c.ball = {centre, radius * radius};
  return c;
}

/// Uniformity of samples over the 12 × 12 cells of the bounding square, against the share of each cell in the gap, which is
/// counted on a fine lattice. Returns χ² and the number of cells with enough expectation.
struct ChiSquare {
  double value;
  int terms;
};
ChiSquare chi_square(const GapCase& c, double low, double size, std::uint64_t seed) {
  const int cells = 12, fine = 600;
  std::vector<double> share(cells * cells, 0.0), count(cells * cells, 0.0);
  double total = 0;
  for (int i = 0; i < fine; ++i) {
    for (int j = 0; j < fine; ++j) {
      const Vec3 x(low + size * (i + 0.5) / fine, low + size * (j + 0.5) / fine, 0);
      bool inside = (x - c.ball.centre).squaredNorm() >= c.ball.weight;
      for (std::size_t k = 0; k < c.corners.size() && inside; ++k) {
        const Vec3 a = c.corners[k], b = c.corners[(k + 1) % c.corners.size()];
        inside = (b - a).cross(x - a).z() >= 0;
      }
      if (inside) share[static_cast<std::size_t>(i * cells / fine * cells + j * cells / fine)] += 1, total += 1;
    }
  }
  FragmentGap gap;
  gap.assign(c.view(), c.ball, c.uncovered());
  Rng rng(seed);
  const int samples = 100000;
  for (int s = 0; s < samples; ++s) {
    const Vec3 x = gap.sample(rng);
    const int i = std::min(cells - 1, std::max(0, static_cast<int>((x.x() - low) / size * cells)));
    const int j = std::min(cells - 1, std::max(0, static_cast<int>((x.y() - low) / size * cells)));
    count[static_cast<std::size_t>(i * cells + j)] += 1;
  }
  double chi2 = 0, rest_expected = 0, rest_count = 0;
  int terms = 0;
  for (std::size_t k = 0; k < share.size(); ++k) {
    const double expected = samples * share[k] / total;
    if (expected < 400) {  // cells cut thin by the boundary go together: the lattice does not know them well enough
      rest_expected += expected;
      rest_count += count[k];
      continue;
    }
    chi2 += (count[k] - expected) * (count[k] - expected) / expected;
    ++terms;
  }
  if (rest_expected > 400) chi2 += (rest_count - rest_expected) * (rest_count - rest_expected) / rest_expected, ++terms;
  return {chi2, terms};
}

}  // namespace

TEST_CASE("gaps: areas known in closed form") {
  FragmentGap gap;
  const double pi = static_cast<double>(kPiReal);
  const auto area = [&](const GapCase& c) { return gap.assign(c.view(), c.ball, c.uncovered()); };
  CHECK(area(square_case(Vec3(0, 0, 0), 0.5)) == doctest::Approx(4 - pi / 4).epsilon(1e-14));
  CHECK(area(square_case(Vec3(0, 0, 0), 2)) == 0);                                             // covered
  CHECK(area(square_case(Vec3(0, 0, 0.75), 1.25)) == doctest::Approx(4 - pi).epsilon(1e-14));  // inscribed circle
  CHECK(area(square_case(Vec3(0, 0, 3), 2)) == doctest::Approx(4).epsilon(1e-14));             // plane misses ball
  CHECK(area(square_case(Vec3(0, 9, 0), 2)) == doctest::Approx(4).epsilon(1e-14));             // disk beside polygon
  CHECK(area(square_case(Vec3(-1, -1, 0), 1)) == doctest::Approx(4 - pi / 4).epsilon(1e-14));  // centre on a corner
  CHECK(area(square_case(Vec3(0, -1, 0), 1)) == doctest::Approx(4 - pi / 2).epsilon(1e-14));   // centre on an edge
  CHECK(area(square_case(Vec3(1.5, 0, 0), 1)) == doctest::Approx(4 - (pi / 3 - std::sqrt(3) / 4)).epsilon(1e-14));
  // Four runs of one corner each: r² = 1.25, so each edge is cut half way between its middle and its ends.
  const double wedge = 1.25 * (pi / 2 - 2 * std::atan(0.5)) / 2;
  CHECK(area(square_case(Vec3(0, 0, 0), std::sqrt(1.25))) == doctest::Approx(4 * (1 - 0.5 - wedge)).epsilon(1e-13));
}

TEST_CASE("gaps: the area agrees with quadrature for every configuration") {
  Rng rng(101);
  FragmentGap gap;
  for (const char* kind : kGapKinds) {
    int gaps = 0;
    for (int trial = 0; trial < 400; ++trial) {
      const GapCase c = random_case(rng, kind);
      const double area = gap.assign(c.view(), c.ball, c.uncovered());
      REQUIRE((area > 0) == c.has_gap());
      if (area == 0) continue;
      ++gaps;
      const OracleGap oracle = oracle_gap(c);
      // The coordinates carry rounding errors δ. They move the boundary of the gap, at most twice the uncovered boundary of the
      // polygon, by about δ, and the circle by δ·r/R.
      const Real delta = 4e-15L * Real(1 + c.ball.centre.norm());
      const Real amplification = oracle.disk > 0 ? 1 + std::sqrt(Real(c.ball.weight) / oracle.disk) : 1;
      Real tolerance = 1e-13L * oracle.area + 2 * delta * amplification * oracle.outside_length + 1e-25L;
      INFO(c.kind, " trial ", trial, " area ", area, " oracle ", static_cast<double>(oracle.area));
      CHECK(static_cast<double>(std::abs(oracle.area - Real(area))) <= static_cast<double>(tolerance));
    }
    INFO(std::string(kind));
    CHECK(gaps > 100);
  }
}

TEST_CASE("gaps: area and scale: a gap is the same at any power of two") {
  Rng rng(7);
  FragmentGap gap;
  for (int trial = 0; trial < 100; ++trial) {
    GapCase c = random_case(rng, "any");
    const double area = gap.assign(c.view(), c.ball, c.uncovered());
    const double s = 0x1p-330;  // about 1e-99
    for (Vec3& v : c.corners) v *= s;
    c.ball.centre *= s;
    c.ball.weight *= s * s;
    CHECK(gap.assign(c.view(), c.ball, c.uncovered()) == area * s * s);
  }
}

TEST_CASE("gaps: primitives lie in the fragment, cover the gap, and are at most twice as large") {
  Rng rng(102);
  FragmentGap gap;
  for (const char* kind : kGapKinds) {
    double worst = 1;
    for (int trial = 0; trial < 300; ++trial) {
      const GapCase c = random_case(rng, kind);
      if (gap.assign(c.view(), c.ball, c.uncovered()) == 0) continue;
      INFO(c.kind, " trial ", trial);
      std::vector<std::array<Vec3, 3>> triangles;
      double sum = 0, extent = 0;
      const double rounding = 1e-14 * (1 + c.ball.centre.norm());
      for (std::size_t i = 0; i < gap.num_primitives(); ++i) {
        triangles.push_back(gap.primitive(i));
        sum += triangle_area(triangles.back());
        for (const Vec3& v : triangles.back()) {
          extent = std::max(extent, (v - triangles[0][0]).norm());
          CHECK(std::abs((v - c.corners[0]).dot(c.normal)) <= rounding);
          for (std::size_t k = 0; k < c.corners.size(); ++k) {
            const Vec3 a = c.corners[k], edge = c.corners[(k + 1) % c.corners.size()] - a;
            if (edge.norm() > 1e-6)
              CHECK(c.normal.cross(edge).dot(v - a) / edge.norm() >= -rounding * (1 + 1e-9 / edge.norm()));
          }
        }
      }
      const double slack = 8 * rounding * extent;
      CHECK(std::abs(sum - gap.primitives_area()) <= 1e-12 * sum + slack);
      CHECK(gap.primitives_area() <= 2 * gap.area() * (1 + 1e-9) + slack);
      CHECK(gap.primitives_area() >= gap.area() * (1 - 1e-9) - slack);
      if (gap.area() > 100 * slack) worst = std::min(worst, gap.area() / gap.primitives_area());

      for (int s = 0; s < 60; ++s) {  // points of the fragment, near its corners too, where the gaps are
        Vec3 x = Vec3::Zero();
        double total = 0;
        const double power = between(rng, 0, 30);
        for (const Vec3& v : c.corners) {
          const double weight = std::pow(rng.uniform(), power);
          x += weight * v;
          total += weight;
        }
        x /= total;
        if (!c.is_uncovered(x)) continue;
        double nearest = 1e300;
        for (const auto& t : triangles) nearest = std::min(nearest, outside_by(t, c.normal, x));
        CHECK(nearest <= rounding);
      }
    }
    INFO(std::string(kind));
    CHECK(worst >= 0.5 - 1e-9);
  }
}

TEST_CASE("gaps: a many-sided polygon around the disk is covered tightly") {
  FragmentGap gap;
  for (int n : {3, 4, 8, 30, 100, 400}) {
    GapCase c;
    for (int k = 0; k < n; ++k) c.corners.emplace_back(std::cos(kTwoPi * k / n), std::sin(kTwoPi * k / n), 0.0);
    const double inscribed = std::cos(kTwoPi / (2 * n));
    for (double radius : {inscribed * (1 - 1e-12), inscribed, inscribed * (1 + 1e-12), inscribed + (1 - inscribed) / 2}) {
      c.ball = {Vec3(0, 0, 0), radius * radius};
      INFO(n, " ", radius);
      REQUIRE(gap.assign(c.view(), c.ball, c.uncovered()) > 0);
      CHECK(std::abs(Real(gap.area()) - oracle_gap(c).area) < 1e-14);
      CHECK(gap.area() >= 0.5 * gap.primitives_area() * (1 - 1e-9));
      CHECK(gap.num_primitives() <= static_cast<std::size_t>(12 * n + 12));
    }
  }
}

TEST_CASE("gaps: polygons whose edges touch the disk up to a few roundings") {
  Rng rng(104);
  FragmentGap gap;
  int gaps = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    GapCase c;  // around the unit circle; one edge or all touch it
    const int n = 3 + static_cast<int>(rng.below(6));
    const double phase = between(rng, 0, kTwoPi);
    const bool all = trial % 2 == 0;
    Vec3 lines[9];
    for (int k = 0; k < n; ++k) {
      const double a = phase + kTwoPi * (k + between(rng, -0.15, 0.15)) / n;
      lines[k] = Vec3(std::cos(a), std::sin(a), k == 0 || all ? -1.0 : -between(rng, 1.01, 1.5));
    }
    bool proper = true;
    for (int k = 0; k < n; ++k) {
      const Vec3 x = lines[k].cross(lines[(k + 1) % n]);
      c.corners.emplace_back(x[0] / x[2], x[1] / x[2], 0.0);
    }
    for (int k = 0; k < n; ++k) {  // each line must be an edge
      const Vec3 edge = c.corners[static_cast<std::size_t>(k)] - c.corners[static_cast<std::size_t>((k + n - 1) % n)];
      proper &= lines[k][0] * edge[1] - lines[k][1] * edge[0] > 1e-3;
    }
    if (!proper) continue;
    const double radius = 1 + static_cast<double>(static_cast<int>(rng.below(17)) - 8) * 0x1p-53;
    c.ball = {Vec3(0, 0, 0), radius * radius};
    double polygon = 0;
    for (std::size_t k = 0; k < c.corners.size(); ++k)
      polygon += c.corners[k].cross(c.corners[(k + 1) % c.corners.size()]).z() / 2;
    const double area = gap.assign(c.view(), c.ball, c.uncovered());
    ++gaps;
    INFO(trial);
    CHECK(std::abs(area - (polygon - kTwoPi / 2 * c.ball.weight)) < 1e-12);
    CHECK(gap.primitives_area() <= 2 * area * (1 + 1e-9));
    CHECK(gap.sample(rng).squaredNorm() >= c.ball.weight * (1 - 1e-15));
  }
  CHECK(gaps > 300);
}

TEST_CASE("gaps: samples lie in the fragment and exactly outside of the ball") {
  Rng rng(103);
  FragmentGap gap;
  for (const char* kind : kGapKinds) {
    for (int trial = 0; trial < 200; ++trial) {
      const GapCase c = random_case(rng, kind);
      if (gap.assign(c.view(), c.ball, c.uncovered()) == 0) continue;
      INFO(c.kind, " trial ", trial);
      for (int s = 0; s < 20; ++s) {
        const Vec3 x = gap.sample(rng);
        CHECK(amps::side_of_ball(x.data(), c.ball.centre.data(), c.ball.weight) >= 0);
        const double rounding = 1e-14 * (1 + c.ball.centre.norm());
        CHECK(std::abs((x - c.corners[0]).dot(c.normal)) <= rounding);
        for (std::size_t k = 0; k < c.corners.size(); ++k) {
          const Vec3 a = c.corners[k], edge = c.corners[(k + 1) % c.corners.size()] - a;
          if (edge.norm() > 1e-6) CHECK(c.normal.cross(edge).dot(x - a) / edge.norm() >= -rounding * (1 + 1e-9 / edge.norm()));
        }
      }
    }
  }
}

TEST_CASE("gaps: samples are uniform") {
  struct Setup {
    Vec3 centre;
    double radius;
  };
  // χ² beyond mean + 4 deviations of its own: about 1 in 10,000 for fair samples, and the seeds are fixed.
  for (const Setup& s : {Setup{Vec3(0, 0, 0), 0.8}, Setup{Vec3(0, 0, 0), 1.2}, Setup{Vec3(0.3, -0.9, 0.2), 1},
                         Setup{Vec3(2, 0.5, 0), 1.6}, Setup{Vec3(0.9, 0.9, 0), 0.3}, Setup{Vec3(0, 0, 2), 1}}) {
    const ChiSquare chi2 = chi_square(square_case(s.centre, s.radius), -1, 2, 11);
    const double freedom = chi2.terms - 1;
    INFO("centre ", s.centre.transpose(), " chi2 ", chi2.value, " of ", freedom);
    CHECK(chi2.terms > 4);
    CHECK(chi2.value < freedom + 4 * std::sqrt(2 * freedom));
  }
}

TEST_CASE("gaps: degenerate fragments have a positive area and give a point") {
  Rng rng(5);
  FragmentGap gap;
  std::vector<GapCase> cases(4);
  cases[0].corners = {Vec3(0, 0, 0), Vec3(2, 0, 0), Vec3(2, 0, 0), Vec3(0, 0, 0)};  // no area
  cases[1].corners = {Vec3(2, 0, 0), Vec3(2, 0, 0), Vec3(2, 0, 0)};                 // a point
  cases[2].corners = {Vec3(-2, 0, 0), Vec3(0, 0, 0), Vec3(2, 0, 0)};                // a segment through the disk
  cases[3].corners = {Vec3(0, 0, 0), Vec3(1 + 3e-10, 0, 0), Vec3(1 + 3e-10, 1e-300, 0), Vec3(0, 1e-300, 0)};  // thin, tiny gap
  for (GapCase& c : cases) {
    c.ball = {Vec3(0, 0, 0), 1};
    REQUIRE(c.has_gap());
    CHECK(gap.assign(c.view(), c.ball, c.uncovered()) > 0);
    const Vec3 x = gap.sample(rng);
    CHECK(x.squaredNorm() >= 1);
    CHECK(x.squaredNorm() <= 4);
    CHECK(std::abs(x.z()) <= 1e-15);
  }
}

TEST_CASE("gaps: what has been decided stands where the doubles of a corner say otherwise") {
  GapCase c;
  c.corners = {Vec3(0, -0.5, 0), Vec3(1.25, 0, 0), Vec3(0, 0.5, 0), Vec3(-1 + 1e-16, 0, 0)};
  c.ball = {Vec3(0, 0, 0), 1};
  FragmentGap gap;
  Rng rng(3);
  CHECK(gap.assign(c.view(), c.ball, {0, 0, 0, 0}) == 0);
  CHECK(gap.assign(c.view(), c.ball, {0, 1, 0, 0}) > 0);  // the corner at −1 is covered: no gap there
  for (std::size_t i = 0; i < gap.num_primitives(); ++i) {
    for (const Vec3& v : gap.primitive(i)) CHECK(v.x() > 0);
  }
  CHECK(gap.assign(c.view(), c.ball, {0, 0, 0, 1}) > 0);  // and here it is not
  CHECK(gap.area() < 1e-10);
  CHECK((gap.sample(rng) - c.corners[3]).norm() < 1e-7);
}

TEST_CASE("gaps: a gap of one rounding error has an area, and its point is where it is") {
  GapCase c;
  c.corners = {Vec3(0, -0.5, 0), Vec3(std::nextafter(1.0, 2.0), 0, 0), Vec3(0, 0.5, 0)};
  c.ball = {Vec3(0, 0, 0), 1};
  FragmentGap gap;
  Rng rng(3);
  CHECK(c.uncovered() == std::vector<char>{0, 1, 0});
  CHECK(gap.assign(c.view(), c.ball, c.uncovered()) > 0);
  CHECK((gap.sample(rng) - c.corners[1]).norm() < 1e-7);
  c.corners[1].x() = 1;
  CHECK(gap.assign(c.view(), c.ball, c.uncovered()) == 0);
}
