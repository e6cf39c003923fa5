// Coverage: the sign of the power at symbolic vertices, by its laws, and what it says about a diagram. (Against exact
// rationals: cgal_predicates_coverage.cpp.)
#include "amps/predicates.h"

#include "kit/diagrams.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <utility>
#include <vector>

namespace amps_test {

using amps::Bisector;
using amps::Stage;
using amps::StageTally;
using amps::detail::PowerFilter;

namespace {

/// A facet and the sites whose bisectors cross it.
struct Scene {
  std::array<Vec3, 3> corner;
  std::array<WeightedPoint, 3> site;
  const double* pointers[3] = {corner[0].data(), corner[1].data(), corner[2].data()};
  Scene() = default;
  Scene(const Scene&) = delete;

  void set_weights(double w) {
    for (WeightedPoint& p : site) p.w = w;
  }
  Bisector bisector(std::size_t owner, std::size_t other) const { return {site[owner], site[other], pointers}; }
  int at_corner(int v, std::size_t owner) const { return amps::power_at_corner(pointers, v, site[owner]); }
  int at_edge(int u, int v, std::size_t owner, std::size_t other) const {
    return amps::power_at_edge_crossing(pointers, u, v, bisector(owner, other));
  }
  int at_facet(std::size_t owner, std::size_t j, std::size_t l, StageTally* tally = nullptr) const {
    return amps::power_at_facet_crossing(pointers, bisector(owner, j), bisector(owner, l), tally);
  }
};

bool edge_crosses(const Scene& s, int u, int v, std::size_t owner, std::size_t other) {
  const Bisector j = s.bisector(owner, other);
  return amps::side_of_corner(s.pointers, u, j) != amps::side_of_corner(s.pointers, v, j);
}

/// The approximate place where the three cells meet, in doubles and by plain barycentric coordinates; false if it is not well
/// inside of the facet.
bool meeting_point(const Scene& s, Vec3& x) {
  const auto difference_of_powers = [&s](std::size_t other, std::size_t v) {
    const auto power = [&s, v](const WeightedPoint& p) { return (s.corner[v] - p.position()).squaredNorm() - p.w; };
    return power(s.site[other]) - power(s.site[0]);
  };
  Vec3 a, b;
  for (std::size_t v = 0; v < 3; ++v) {
    a[static_cast<int>(v)] = difference_of_powers(1, v);
    b[static_cast<int>(v)] = difference_of_powers(2, v);
  }
  const Vec3 lambda = a.cross(b) / a.cross(b).sum();
  x = lambda[0] * s.corner[0] + lambda[1] * s.corner[1] + lambda[2] * s.corner[2];
  return lambda.minCoeff() > 1e-3;
}

enum class Kind {
  kRandom,
  kLattice,     ///< integers; sites at one distance from a point of the facet or of an edge
  kNearSphere,  ///< the same up to rounding
  kFar          ///< from the origin
};
constexpr Kind kAllKinds[] = {Kind::kRandom, Kind::kLattice, Kind::kNearSphere, Kind::kFar};

/// One of the 30 integer vectors of length 5.
Vec3 vector_of_length_5(Rng& rng) {
  Vec3 v = rng.below(5) == 0 ? Vec3(5, 0, 0) : Vec3(rng.below(2) == 0 ? 3 : -3, 4, 0);
  if (rng.below(2) == 0) std::swap(v[0], v[1]);
  const auto turn = static_cast<int>(rng.below(3));
  return Vec3(v[turn], v[(turn + 1) % 3], v[(turn + 2) % 3]) * (rng.below(2) == 0 ? 1 : -1);
}

void fill_on_lattice(Rng& rng, Scene& s) {
  const auto random_vector = [&rng] {
    return Vec3(double(rng.below(17)) - 8, double(rng.below(17)) - 8, double(rng.below(5)));
  };
  const Vec3 centre = random_vector(), a = random_vector(), b = random_vector();
  const bool halves_edge = rng.below(3) == 0;
  s.corner = {centre + a, halves_edge ? Vec3(centre - a) : Vec3(centre + b), centre - a - b};
  const double w = 25 + (rng.below(2) == 0 ? 0 : double(rng.below(3)) - 1) / 4;
  for (WeightedPoint& p : s.site) {
    const Vec3 x = centre + vector_of_length_5(rng);
    p = {x.x(), x.y(), x.z(), w};
  }
}

void fill_with_doubles(Rng& rng, Kind kind, Scene& s) {
  const auto random_vector = [&rng, kind] {
    const Vec3 x(rng.uniform(), rng.uniform(), rng.uniform());
    return kind == Kind::kFar ? Vec3(x + Vec3::Constant(1e6)) : x;
  };
  for (Vec3& x : s.corner) x = random_vector();
  const Vec3 centre = 0.25 * s.corner[0] + 0.25 * s.corner[1] + 0.5 * s.corner[2];
  for (WeightedPoint& p : s.site) {
    Vec3 x = random_vector();
    if (kind == Kind::kNearSphere) x = centre + (x - Vec3::Constant(0.5)).normalized() / 4;
    p = {x.x(), x.y(), x.z(), kind == Kind::kNearSphere ? 0.0625 : 0.2 * rng.uniform()};
  }
}

void randomize(Rng& rng, Kind kind, Scene& s) {
  do {
    if (kind == Kind::kLattice) {
      fill_on_lattice(rng, s);
    } else {
      fill_with_doubles(rng, kind, s);
    }
  } while (amps::collinear(s.pointers[0], s.pointers[1], s.pointers[2]) || amps::same_position(s.site[0], s.site[1]) ||
           amps::same_position(s.site[1], s.site[2]) || amps::same_position(s.site[0], s.site[2]));
}

}  // namespace

TEST_CASE("coverage: vertices at an exact distance of 5 are on the sphere, and one step of the weight decides") {
  Scene s;
  s.corner = {Vec3(0, 0, 0), Vec3(12, 0, 0), Vec3(0, 12, 0)};
  const auto expect_turn = [&s](const std::function<int()>& sign) {
    s.set_weights(25);
    CHECK(sign() == 0);
    s.set_weights(std::nextafter(25, 26));
    CHECK(sign() == -1);
    s.set_weights(std::nextafter(25, 24));
    CHECK(sign() == 1);
  };
  s.site = {{{6, 7, 0, 0}, {-1, 6, 0, 0}, {3, 3, 5, 0}}};  // around (3, 3, 0)
  expect_turn([&s] { return s.at_facet(0, 1, 2); });
  expect_turn([&s] { return s.at_facet(2, 0, 1); });
  s.site = {{{3, 4, 0, 0}, {9, 4, 0, 0}, {0, 0, 9, 0}}};  // the edge halfway, and the corner (0, 0, 0)
  expect_turn([&s] { return s.at_edge(0, 1, 0, 1); });
  expect_turn([&s] { return s.at_edge(1, 0, 1, 0); });
  expect_turn([&s] { return s.at_corner(0, 0); });
}

TEST_CASE("coverage: the cells that meet in a vertex agree on its sign, whatever the order of arguments") {
  for (const Kind kind : kAllKinds) {
    CAPTURE(int(kind));
    Rng rng(1);
    Scene s;
    int edges = 0, edge_zeros = 0, facet_zeros = 0;
    for (int n = 0; n < 3000; ++n) {
      randomize(rng, kind, s);
      for (int u = 0; u < 3; ++u) {
        const int v = (u + 1) % 3;
        if (!edge_crosses(s, u, v, 0, 1)) continue;
        ++edges;
        const int sign = s.at_edge(u, v, 0, 1);
        edge_zeros += sign == 0;
        REQUIRE(s.at_edge(v, u, 0, 1) == sign);
        REQUIRE(s.at_edge(u, v, 1, 0) == sign);
      }
      Vec3 x;
      if (!meeting_point(s, x)) continue;
      const int sign = s.at_facet(0, 1, 2);
      facet_zeros += sign == 0;
      for (const auto& order : {std::array<std::size_t, 3>{0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}}) {
        REQUIRE(s.at_facet(order[0], order[1], order[2]) == sign);
      }
    }
    CHECK(edges > 500);
    if (kind == Kind::kLattice) {
      CHECK(edge_zeros > 100);
      CHECK(facet_zeros > 100);
    }
  }
}

TEST_CASE("coverage: exact translations and scalings by powers of two keep every sign") {
  Rng rng(2);
  Scene s, moved;
  int zeros = 0, compared = 0;
  for (int n = 0; n < 3000; ++n) {
    randomize(rng, Kind::kLattice, s);
    const int exponent = static_cast<int>(rng.below(900)) - 450;
    const Vec3 shift = n % 2 == 0 ? Vec3(0x1p45, -0x1p46, 0x1p44) : Vec3::Zero();
    for (std::size_t k = 0; k < 3; ++k) {
      moved.corner[k] = (s.corner[k] + shift) * std::ldexp(1.0, exponent);
      const Vec3 x = (s.site[k].position() + shift) * std::ldexp(1.0, exponent);
      moved.site[k] = {x.x(), x.y(), x.z(), std::ldexp(s.site[k].w, 2 * exponent)};
    }
    Vec3 x;
    if (meeting_point(s, x)) {
      const int sign = s.at_facet(0, 1, 2);
      REQUIRE(moved.at_facet(0, 1, 2) == sign);
      zeros += sign == 0;
      ++compared;
    }
    if (edge_crosses(s, 0, 1, 0, 1)) {
      const int sign = s.at_edge(0, 1, 0, 1);
      REQUIRE(moved.at_edge(0, 1, 0, 1) == sign);
      zeros += sign == 0;
      ++compared;
    }
    REQUIRE(moved.at_corner(0, 0) == s.at_corner(0, 0));
  }
  CHECK(zeros > 50);
  CHECK(compared > 1000);
}

TEST_CASE("coverage: far from the sphere the filter decides, as doubles do") {
  Rng rng(3);
  Scene s;
  StageTally tally;
  int compared = 0;
  for (int n = 0; n < 20000; ++n) {
    randomize(rng, Kind::kRandom, s);
    Vec3 x;
    if (!meeting_point(s, x)) continue;
    const double power = (x - s.site[0].position()).squaredNorm() - s.site[0].w;
    if (std::fabs(power) < 1e-6) continue;
    ++compared;
    REQUIRE(s.at_facet(0, 1, 2, &tally) == (power > 0 ? 1 : -1));
  }
  CHECK(compared > 500);
  CHECK(tally[Stage::kFilter] == std::uint64_t(compared));
}

TEST_CASE("coverage: the filter on coordinates is never wrong within its error, and decides nearly all points") {
  Rng rng(4);
  int decided = 0, wrong = 0, total = 0;
  for (int n = 0; n < 200000; ++n) {
    const double scale = std::ldexp(1.0, static_cast<int>(rng.below(800)) - 400);
    const Vec3 centre = scale * Vec3(rng.uniform(), rng.uniform(), rng.uniform());
    const double radius = scale * rng.uniform();
    const WeightedPoint owner{centre.x(), centre.y(), centre.z(), radius * radius};
    const double errors[] = {0, 1e-14, 1e-9, 1e-3};
    const double error = scale * errors[rng.below(4)];
    const Vec3 direction = Vec3(rng.uniform() - 0.5, rng.uniform() - 0.5, rng.uniform() - 0.5).normalized();
    // Beside the sphere by some multiple of the error, or anywhere.
    const bool anywhere = n % 2 == 0;
    const double distance = anywhere ? scale * rng.uniform() : radius + 3 * (rng.uniform() - 0.5) * error;
    const Vec3 x = centre + distance * direction;
    Vec3 computed = x;
    for (int k = 0; k < 3; ++k) computed[k] += error * 0.999 * (rng.below(2) == 0 ? 1 : -1);
    if ((computed - x).cwiseAbs().maxCoeff() > error) computed = x;  // by rounding
    const int side = PowerFilter(owner, error).side(computed);
    wrong += side != 0 && side != amps::side_of_ball(x.data(), centre.data(), owner.w);
    if (anywhere && error <= 1e-9 * scale) {
      decided += side != 0;
      ++total;
    }
  }
  CHECK(wrong == 0);
  CHECK(decided > 0.999 * total);
}

TEST_CASE("coverage: the filter on coordinates at the ends of the range of doubles") {
  const WeightedPoint unit{0, 0, 0, 1};
  CHECK(PowerFilter(unit, 0).side(Vec3(1, 0, 0)) == 0);
  CHECK(PowerFilter(unit, 0).side(Vec3(2, 0, 0)) == 1);
  CHECK(PowerFilter(unit, 0).side(Vec3(0.5, 0, 0)) == -1);
  CHECK(PowerFilter(unit, 2).side(Vec3(2, 0, 0)) == 0);
  CHECK(PowerFilter(unit, kInfinity).side(Vec3(2, 0, 0)) == 0);
  CHECK(PowerFilter(unit, std::nan("")).side(Vec3(2, 0, 0)) == 0);
  CHECK(PowerFilter(unit, 0).side(Vec3(std::nan(""), 0, 0)) == 0);
  CHECK(PowerFilter({0, 0, 0, 0}, 0).side(Vec3(0, 0, 0)) == 0);
  CHECK(PowerFilter({0, 0, 0, 0}, 0).side(Vec3(1e-200, 0, 0)) == 0);  // its square is no double
  CHECK(PowerFilter({0, 0, 0, 0}, 0).side(Vec3(1e-100, 0, 0)) == 1);
  CHECK(PowerFilter({0, 0, 0, -1}, 0).side(Vec3(0, 0, 0)) >= 0);
  CHECK(PowerFilter({0, 0, 0, 1e300}, 0).side(Vec3(1e200, 0, 0)) == 1);
  CHECK(PowerFilter({0, 0, 0, DBL_MAX}, 0).side(Vec3(1e100, 0, 0)) == -1);
  CHECK(PowerFilter({0, 0, 0, 1e-323}, 1e-170).side(Vec3(0, 0, 0)) == 0);
}

namespace {

/// The exact sign at corner k of a polygon.
int power_at_vertex(const Diagram& diagram, const Diagram::Polygon& polygon, Index k) {
  std::array<Vec3, 3> corner;
  const double* pointers[3];
  for (int c = 0; c < 3; ++c) {
    corner[std::size_t(c)] = diagram.mesh().corner(polygon.facet, c);
    pointers[c] = corner[std::size_t(c)].data();
  }
  const WeightedPoint& owner = diagram.site(polygon.site);
  const Index in = polygon.labels[(k + polygon.size - 1) % polygon.size], out = polygon.labels[k];
  const auto bisector = [&](Index label) { return Bisector(owner, diagram.site(label), pointers); };
  if (Diagram::is_site(in) && Diagram::is_site(out)) {
    return amps::power_at_facet_crossing(pointers, bisector(in), bisector(out));
  }
  if (!Diagram::is_site(in) && !Diagram::is_site(out)) {
    return amps::power_at_corner(pointers, Diagram::mesh_edge(out), owner);
  }
  const int e = Diagram::mesh_edge(Diagram::is_site(in) ? out : in);
  return amps::power_at_edge_crossing(pointers, e, (e + 1) % 3, bisector(Diagram::is_site(in) ? in : out));
}

struct Signs {
  int covered = 0, on_sphere = 0, uncovered = 0;
};
Signs count_signs(const Diagram& diagram) {
  Signs signs;
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    if (!diagram.alive(f)) continue;
    const Diagram::Polygon polygon = diagram.polygon(f);
    for (Index k = 0; k < polygon.size; ++k) {
      const int sign = power_at_vertex(diagram, polygon, k);
      ++(sign < 0 ? signs.covered : (sign == 0 ? signs.on_sphere : signs.uncovered));
    }
  }
  return signs;
}

}  // namespace

TEST_CASE("coverage: a square grid is covered from half its diagonal on, and not by one step less") {
  constexpr int n = 6;
  const Mesh square = mesh_of({{0, 0, 0}, {n, 0, 0}, {n, n, 0}, {0, n, 0}}, {{{0, 1, 2}}, {{0, 2, 3}}});
  std::vector<Vec3> positions;
  for (int x = 0; x < n; ++x) {
    for (int y = 0; y < n; ++y) positions.emplace_back(x + 0.5, y + 0.5, 0.0);
  }
  const auto signs_at = [&](double weight) {
    const Sites sites = sites_of(points_of(positions), weight);
    return count_signs(Diagram(square, sites.positions, sites.weights));
  };
  const Signs exactly = signs_at(0.5);
  CHECK(exactly.uncovered == 0);
  CHECK(exactly.on_sphere >= 4 * n * n);
  CHECK(signs_at(std::nextafter(0.5, 0.0)).uncovered == exactly.on_sphere);
  const Signs more = signs_at(std::nextafter(0.5, 1.0));
  CHECK(more.uncovered + more.on_sphere == 0);
}

TEST_CASE("coverage: a facet is covered iff no vertex of its fragments is uncovered, cospherical sites or not") {
  constexpr int kSide = 12;
  const Mesh facet = mesh_of({{0, 0, 0}, {kSide, 0, 0}, {0, kSide, 0}}, {{{0, 1, 2}}});
  Rng rng(5);
  int covered = 0, gaps = 0;
  for (int n = 0; n < 400; ++n) {
    std::vector<Vec3> positions;
    const auto count = 2 + rng.below(8);
    for (std::uint64_t s = 0; s < count; ++s) {
      positions.emplace_back(double(rng.below(kSide + 1)), double(rng.below(kSide + 1)), double(rng.below(3)));
    }
    Sites sites = sites_of(positions);
    for (Index s = 0; s < sites.size(); ++s) sites.weights[s] = double(rng.below(3)) + (n % 2 == 0 ? 50 : 25);
    const Diagram diagram(facet, sites.positions, sites.weights);
    const auto least_power = [&](const Vec3& x) {
      double least = INFINITY;
      for (Index s = 0; s < sites.size(); ++s) least = std::min(least, (x - sites.at(s)).squaredNorm() - sites.weights[s]);
      return least;
    };
    std::map<std::array<double, 3>, int> sign_at;  // fragments that meet in a vertex agree
    bool is_covered = true;
    for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
      if (!diagram.alive(f)) continue;
      const Diagram::Polygon polygon = diagram.polygon(f);
      for (Index k = 0; k < polygon.size; ++k) {
        const Vec3& x = polygon.corners[k];
        const int sign = power_at_vertex(diagram, polygon, k);
        const auto found = sign_at.emplace(std::array<double, 3>{x.x(), x.y(), x.z()}, sign);
        REQUIRE(found.first->second == sign);
        // No other ball has what the owner's leaves out.
        const double power = least_power(x);
        if (sign > 0) REQUIRE(power > -1e-9);
        if (sign <= 0) REQUIRE(power < 1e-9);
        is_covered = is_covered && sign <= 0;
      }
    }
    ++(is_covered ? covered : gaps);
    if (!is_covered) continue;
    // Points on a lattice of 1/8: their powers are exact in doubles.
    for (int x = 0; x <= 8 * kSide; ++x) {
      for (int y = 0; x + y <= 8 * kSide; ++y) REQUIRE(least_power(Vec3(x / 8.0, y / 8.0, 0)) <= 0);
    }
  }
  CHECK(covered > 50);
  CHECK(gaps > 50);
}

}  // namespace amps_test
