#include "amps/triangulation.h"

#include "kit/errors.h"
#include "kit/triangulations.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <string>
#include <vector>

namespace amps::detail {
struct TriangulationTestAccess {
  static auto& cells(RegularTriangulation& t) { return t.cells_; }
  static std::vector<RegularTriangulation::VertexState>& states(RegularTriangulation& t) { return t.state_; }
  static std::vector<WeightedPoint>& points(RegularTriangulation& t) { return t.points_; }
  static std::vector<Index>& vertex_cell(RegularTriangulation& t) { return t.vertex_cell_; }
  static Index& num_finite(RegularTriangulation& t) { return t.num_finite_; }
};
}  // namespace amps::detail

namespace amps_test {

using Access = amps::detail::TriangulationTestAccess;

namespace {

/// Of the integer points on the sphere of radius 9.
NamedSites cospherical(Rng& rng, Index n) {
  const WeightedPoints all = shuffled(integer_sphere(81), rng);
  return {"cospherical", head(sites_of(all), std::min(n, static_cast<Index>(all.size())))};
}

NamedSites coplanar_heavy(Rng& rng, Index n) {
  Index k = 0;
  return {"coplanar-heavy", sites_of(drawn(n, [&] {
            const double x = rng.uniform(), y = rng.uniform(), z = k++ % 8 == 0 ? static_cast<double>(rng.below(3)) : 1.0;
            return WeightedPoint{x, y, z, static_cast<double>(rng.below(2)) * 0.01};
          }))};
}

std::vector<NamedSites> small_inputs(std::uint64_t seed) {
  Rng rng(seed);
  std::vector<NamedSites> inputs;
  for (const double range : {0.0, 0.05, 0.5}) inputs.push_back(random_cube(rng, 22, range));
  inputs.push_back(random_lattice(rng, 22, 3, 1));
  inputs.push_back(random_lattice(rng, 26, 3, 3));
  inputs.push_back(random_lattice(rng, 18, 2, 4));
  inputs.push_back(cospherical(rng, 20));
  inputs.push_back(coplanar_heavy(rng, 22));
  inputs.push_back(
      {"on two lines", sites_of(made_points(20, [](Index k) { return k < 10 ? Vec3(k, 0, 0) : Vec3(4, k - 14, 1); }))});
  NamedSites one_big("one point hides most", random_cube(rng, 20, 0.01));
  one_big.weights[7] = 0.3;
  inputs.push_back(one_big);
  return inputs;
}

void check_same_vertices(const RegularTriangulation& a, const RegularTriangulation& b) {
  REQUIRE(a.num_vertices() == b.num_vertices());
  for (Index v = 0; v < a.num_vertices(); ++v) {
    // Which of hidden and duplicate a point is may depend on when it came; whether it is a vertex may not.
    REQUIRE((a.state(v) == State::kVisible) == (b.state(v) == State::kVisible));
  }
}

}  // namespace

TEST_CASE("triangulation: the cells are those of the brute-force oracle") {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    for (const NamedSites& in : small_inputs(seed)) {
      CAPTURE(in.name);
      CAPTURE(seed);
      const RegularTriangulation t = built(in);
      REQUIRE(t.check() == "");
      const CellSet expected = brute_force(in);
      REQUIRE(cell_set(t) == expected);
      std::set<Index> visible;
      for (const auto& cell : expected) visible.insert(cell.begin(), cell.end());
      Index hidden = 0;
      for (Index v = 0; v < t.num_vertices(); ++v) {
        if (t.dimension() == 3) REQUIRE((t.state(v) == State::kVisible) == (visible.count(v) == 1));
        hidden += t.state(v) != State::kVisible;
        REQUIRE(t.point(v).x == in.positions(v, 0));
        REQUIRE(t.point(v).w == in.weights[v]);
      }
      REQUIRE(t.num_hidden() == hidden);
    }
  }
}

TEST_CASE("triangulation: all 8! insertion orders of a cube's corners give one triangulation") {
  std::array<Index, 8> order = {0, 1, 2, 3, 4, 5, 6, 7};
  const auto corner = [](Index k) { return Vec3(k & 1, (k >> 1) & 1, (k >> 2) & 1); };
  CellSet expected;
  int different = 0, count = 0;
  do {
    RegularTriangulation t;
    std::vector<Index> corner_of_id(8);
    for (const Index k : order) corner_of_id[at(t.insert(corner(k), 0.0))] = k;
    const CellSet cells = renamed(cell_set(t), corner_of_id);
    if (expected.empty()) expected = cells;
    different += cells != expected;
    ++count;
  } while (std::next_permutation(order.begin(), order.end()));
  CHECK(count == 40320);
  CHECK(different == 0);
  CHECK(expected == brute_force(sites_of(made_points(8, corner))));
}

TEST_CASE("triangulation: bulk, one by one, mixed and shuffled insertion give the same cells") {
  Rng rng(3);
  std::vector<NamedSites> inputs = small_inputs(77);
  inputs.push_back(random_cube(rng, 3000, 0.0));
  inputs.push_back(random_cube(rng, 3000, 0.05));
  inputs.push_back(random_lattice(rng, 2500, 12, 3));
  inputs.push_back(coplanar_heavy(rng, 1500));
  for (const NamedSites& in : inputs) {
    CAPTURE(in.name);
    const RegularTriangulation bulk = built(in);
    REQUIRE(bulk.check() == "");
    const CellSet expected = cell_set(bulk);
    for (const Index first : {Index{0}, in.size() / 3}) {
      const RegularTriangulation t = one_by_one(in, first);
      REQUIRE(t.check() == "");
      REQUIRE(cell_set(t) == expected);
      check_same_vertices(t, bulk);
    }
    RegularTriangulation twice;
    const Index half = in.size() / 2;
    insert_all(twice, head(in, half));
    insert_all(twice, tail(in, in.size() - half));
    REQUIRE(twice.check() == "");
    REQUIRE(cell_set(twice) == expected);
    check_same_vertices(twice, bulk);

    // Shuffled: compare through the permutation; of equal points another one may be the vertex, so by value.
    const Sites mixed = chosen(in, shuffled(all_indices(in.size()), rng));
    const auto by_value = [](const RegularTriangulation& t) {
      std::set<std::vector<std::array<double, 4>>> result;
      for (const auto& cell : cell_set(t)) {
        std::vector<std::array<double, 4>> corners;
        for (const Index v : cell) corners.push_back({t.point(v).x, t.point(v).y, t.point(v).z, t.point(v).w});
        std::sort(corners.begin(), corners.end());
        result.insert(corners);
      }
      return result;
    };
    REQUIRE(by_value(built(mixed)) == by_value(bulk));
  }
}

TEST_CASE("triangulation: of equal points the heaviest is the vertex, of equal weights the first, the others are duplicates") {
  Rng rng(4);
  const Sites base = random_cube(rng, 200, 0.0);
  Sites in = joined(base, base);
  for (const bool bulk : {true, false}) {
    const RegularTriangulation t = bulk ? built(in) : one_by_one(in);
    for (Index v = 0; v < 400; ++v) CHECK(t.state(v) == (v < 200 ? State::kVisible : State::kDuplicate));
    CHECK(t.num_hidden() == 200);
    CHECK(t.check() == "");
  }
  in.weights = joined(constant_values(200, 0), constant_values(200, 1e-9));
  for (const bool bulk : {true, false}) {
    const RegularTriangulation t = bulk ? built(in) : one_by_one(in);
    for (Index v = 0; v < 400; ++v) CHECK(t.state(v) == (v < 200 ? State::kHidden : State::kVisible));
    CHECK(t.check() == "");
  }
}

TEST_CASE("triangulation: locate finds the cell that contains a point, or a hull facet that sees it") {
  Rng rng(5);
  for (const NamedSites& in : {random_cube(rng, 500, 0.01), random_lattice(rng, 300, 6, 1), coplanar_heavy(rng, 300)}) {
    CAPTURE(in.name);
    const RegularTriangulation t = built(in);
    REQUIRE(t.dimension() == 3);
    const amps::Box box = box_of(in.positions);
    const Vec3 low = box.min, high = box.max;
    const auto sees = [&](Index c, int face, const Vec3& x) {
      static const int kFace[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
      const auto& v = t.cell(c).vertex;
      const auto p = [&](int k) { return t.point(v[static_cast<std::size_t>(kFace[face][k])]); };
      return amps::orient3d(p(0), p(1), p(2), {x.x(), x.y(), x.z(), 0}) > 0;
    };
    int outside = 0, inside = 0;
    for (int k = 0; k < 600; ++k) {
      // In the box, around it, on vertices, and far outside where the bounds of the set do not hold.
      const double spread = k % 3 == 0 ? 0.0 : (k % 3 == 1 ? 0.5 : std::pow(10.0, static_cast<double>(rng.below(40))));
      Vec3 x;
      for (int a = 0; a < 3; ++a) x[a] = low[a] + (high[a] - low[a]) * ((1 + 2 * spread) * rng.uniform() - spread);
      if (k % 10 == 0) x = in.at(below(rng, in.size()));
      const Index hint = k % 2 == 0 ? kNone : below(rng, t.cell_capacity());
      const Index c = t.locate(x, hint);
      REQUIRE(t.cell(c).alive());
      if (t.cell(c).ghost()) {
        ++outside;
        const auto& v = t.cell(c).vertex;
        REQUIRE(amps::orient3d(t.point(v[0]), t.point(v[1]), t.point(v[2]), {x.x(), x.y(), x.z(), 0}) > 0);
      } else {
        ++inside;
        for (int f = 0; f < 4; ++f) REQUIRE_FALSE(sees(c, f, x));
      }
    }
    CHECK(outside > 100);
    CHECK(inside > 100);
  }
}

TEST_CASE("triangulation: locate of points 1e-30 to 1e300 away uses no bound of the set") {
  Rng rng(6);
  const NamedSites in = random_cube(rng, 300, 0.0);
  const RegularTriangulation t = built(in);
  for (int e = -30; e <= 300; e += 5) {
    const double r = std::pow(10.0, e);
    const Vec3 x(0.5 + r, 0.5 - 0.3 * r, 0.5 + 0.7 * r);
    const Index c = t.locate(x);
    CHECK(t.cell(c).ghost() == (r > 0.8));
  }
}

TEST_CASE("triangulation: power_nearest is the brute-force nearest, ties to the lexicographically smallest") {
  Rng rng(7);
  for (const NamedSites& in :
       {random_cube(rng, 400, 0.05), random_lattice(rng, 300, 6, 3), cospherical(rng, 60), random_lattice(rng, 60, 3, 1)}) {
    CAPTURE(in.name);
    const RegularTriangulation t = built(in);
    for (int k = 0; k < 400; ++k) {
      Vec3 x;
      for (int a = 0; a < 3; ++a)
        x[a] = in.name[0] == 'l' ? static_cast<double>(rng.below(13)) / 2 : 1.5 * rng.uniform() - 0.25;
      if (in.name == "cospherical" && k % 2 == 0) x = Vec3::Zero();
      const Index expected = power_nearest_of(
          candidates(in), [&in = in](Index v) { return in.point(v); }, x);
      const Index near = k % 3 == 0 ? kNone : below(rng, in.size());
      REQUIRE(t.power_nearest(x, near) == expected);
    }
  }
}

TEST_CASE("triangulation: neighbors, adjacency and incident_cells agree with the cells") {
  Rng rng(8);
  for (const NamedSites& in : {random_cube(rng, 600, 0.05), random_lattice(rng, 400, 7, 1)}) {
    const RegularTriangulation t = built(in);
    Index finite = 0, ghosts = 0;
    for (Index c = 0; c < t.cell_capacity(); ++c) {
      if (t.cell(c).alive()) ++(t.cell(c).ghost() ? ghosts : finite);
    }
    CHECK(finite == t.num_cells());
    CHECK(ghosts == t.num_ghosts());
    CHECK(t.hull().rows() == ghosts);
    check_neighborhoods(t);
  }
}

TEST_CASE("triangulation: the star of a vertex of high degree is complete") {
  Rng rng(9);
  // A sphere around one point: its degree is 4,000, and its insertion digs one huge cavity.
  const Sites shell = sites_of(drawn(4000, [&] { return on_sphere(rng); })), hub = sites_of(WeightedPoints{{0, 0, 0, 0}});
  for (const bool hub_first : {true, false}) {
    const RegularTriangulation t = one_by_one(hub_first ? joined(hub, shell) : joined(shell, hub), 4000);
    REQUIRE(t.check() == "");
    std::vector<Index> out;
    t.neighbors(hub_first ? 0 : 4000, out);
    CHECK(out.size() == 4000);
  }
}

TEST_CASE("triangulation: flat sets have a dimension and no cells, and grow from there") {
  RegularTriangulation t;
  CHECK(t.dimension() == -1);
  CHECK(t.locate(Vec3::Zero()) == kNone);
  CHECK(t.power_nearest(Vec3::Zero()) == kNone);
  t.insert(no_points());
  CHECK(t.dimension() == -1);
  for (int k = 0; k < 3; ++k) t.insert(Vec3(1, 2, 3), 0);
  CHECK(t.dimension() == 0);
  for (int k = 0; k < 4; ++k) t.insert(Vec3(1 + k, 2 + k, 3 - k), 0);
  CHECK(t.dimension() == 1);
  CHECK(t.num_cells() == 0);
  t.insert(points_of({{5, 2, 3}, {6, 2, 3}, {9, 2, 3}}));
  CHECK(t.dimension() == 2);
  CHECK(t.num_cells() == 0);
  CHECK(t.check() == "");
  CHECK(t.power_nearest(Vec3(6.1, 2, 3)) == 8);
  CHECK(t.locate(Vec3(0, 0, 0)) == kNone);
  const Index last = t.insert(Vec3(2, 9, 11), 0);
  CHECK(last == t.num_vertices() - 1);
  CHECK(t.dimension() == 3);
  CHECK(t.check() == "");
  CHECK(t.num_hidden() == 3);  // two more points at the first position, and its copy on the line
  const Points all = made_points(t.num_vertices(), [&t](Index v) { return t.point(v).position(); });
  CHECK(cell_set(t) == brute_force(sites_of(all)));
}

TEST_CASE("triangulation: flat bulk input of every dimension, then a point outside it") {
  Rng rng(10);
  for (int dimension = 0; dimension <= 2; ++dimension) {
    CAPTURE(dimension);
    const Sites in = sites_of(made_points(300, [&](Index) {
      Vec3 x = Vec3::Zero();
      for (int a = 0; a < dimension; ++a) x[a] = static_cast<double>(rng.below(20));
      return x;
    }));
    RegularTriangulation t = built(in);
    CHECK(t.dimension() == dimension);
    CHECK(t.num_cells() == 0);
    CHECK(t.adjacency().adjacent.empty());
    const Sites apexes = sites_of(WeightedPoints{{0.5, 0.25, 1, 0}, {0.25, 3, 0.5, 0}, {-1, 0.5, 0.5, 0}});
    insert_all(t, apexes);
    CHECK(t.dimension() == 3);
    CHECK(t.check() == "");
    CHECK(cell_set(t) == cell_set(one_by_one(joined(in, apexes))));
  }
}

TEST_CASE("triangulation: scale by powers of two, and offsets where they are exact, do not change the cells") {
  Rng rng(11);
  Sites in = random_cube(rng, 300, 0.02);
  const auto coarse = [](double x) { return std::floor(x * 0x1p20) * 0x1p-20; };
  in.positions = transformed(in.positions, [&](const Vec3& x) -> Vec3 { return {coarse(x[0]), coarse(x[1]), coarse(x[2])}; });
  const CellSet expected = cell_set(built(in));
  for (const int e : {-480, -330, -100, 60, 166, 400, 500}) {
    CAPTURE(e);
    const RegularTriangulation t =
        built(Sites{scaled(in.positions, std::ldexp(1.0, e)), scaled(in.weights, std::ldexp(1.0, 2 * e))});
    CHECK(t.check() == "");
    CHECK(cell_set(t) == expected);
  }
  for (const double offset : {1.0, 1e6, 1e8}) {
    CAPTURE(offset);
    const RegularTriangulation t = built(Sites{moved(in.positions, Vec3::Constant(offset)), in.weights});
    CHECK(t.check() == "");
    CHECK(cell_set(t) == expected);
  }
  const CellSet unweighted = cell_set(built(sites_of(in.positions)));
  for (const int e : {-1050, -1000, 1000, 1023}) {  // denormals, and the largest doubles
    CAPTURE(e);
    const RegularTriangulation t = built(sites_of(transformed(in.positions, [e](const Vec3& x) -> Vec3 {
      return {std::ldexp(x[0], e), std::ldexp(x[1], e), std::ldexp(x[2], e)};
    })));
    CHECK(t.check() == "");
    CHECK(cell_set(t) == unweighted);
  }
}

TEST_CASE("triangulation: adding one constant to all weights does not change the cells") {
  Rng rng(12);
  const NamedSites in = random_lattice(rng, 400, 8, 3);
  const CellSet expected = cell_set(built(in));
  for (const double shift : {-1000.0, 0.5, 0x1p40}) {
    const Values weights = transformed(in.weights, [shift = shift](double w) { return w + shift; });
    CHECK(cell_set(built(Sites{in.positions, weights})) == expected);
  }
}

TEST_CASE("triangulation: bad input is refused with a reason and changes nothing") {
  Rng rng(13);
  const NamedSites in = random_cube(rng, 100, 0.01);
  RegularTriangulation t = built(in);
  const CellSet before = cell_set(t);
  Points bad = head(in.positions, 5);
  for (const double value : {kNaN, kInfinity, -kInfinity}) {
    bad(3, 1) = value;
    CHECK(error_of([&] { t.insert(bad); }) == ErrorCode::kInvalidArgument);
    CHECK(error_of([&] { t.insert(Vec3(0, value, 0), 0); }) == ErrorCode::kInvalidArgument);
    CHECK(error_of([&] { t.insert(Vec3(0, 0, 0), value); }) == ErrorCode::kInvalidArgument);
    CHECK(error_of([&] { t.locate(Vec3(0, value, 0)); }) == ErrorCode::kInvalidArgument);
    CHECK(error_of([&] { t.power_nearest(Vec3(0, value, 0)); }) == ErrorCode::kInvalidArgument);
  }
  CHECK(error_text([&] { t.insert(bad); }).find("point 3") != std::string::npos);
  CHECK(error_of([&] { t.insert(in.positions, head(in.weights, 7)); }) == ErrorCode::kInvalidArgument);
  CHECK(t.num_vertices() == 100);
  CHECK(t.check() == "");
  CHECK(cell_set(t) == before);
}

TEST_CASE("triangulation: check notices corruption") {
  Rng rng(14);
  const NamedSites in = random_cube(rng, 60, 0.2);
  const RegularTriangulation good = built(in);
  REQUIRE(good.check() == "");
  REQUIRE(good.num_hidden() > 0);
  Index alive = 0;
  while (!good.cell(alive).alive() || good.cell(alive).ghost()) ++alive;
  const std::size_t c = at(alive);
  const auto corrupted = [&](auto&& corrupt) {
    RegularTriangulation t = good;
    corrupt(t);
    return t.check();
  };
  CHECK(corrupted([&](auto& t) { std::swap(Access::cells(t)[c].vertex[0], Access::cells(t)[c].vertex[1]); }) != "");
  CHECK(corrupted([&](auto& t) { std::swap(Access::cells(t)[c].neighbor[0], Access::cells(t)[c].neighbor[1]); }) != "");
  CHECK(corrupted([&](auto& t) { Access::cells(t)[c].vertex[2] = good.num_vertices(); }) != "");
  CHECK(corrupted([&](auto& t) { Access::cells(t)[c].neighbor[2] = -1; }) != "");
  CHECK(corrupted([&](auto& t) { ++Access::num_finite(t); }) != "");
  const Index v = good.cell(alive).vertex[0];
  CHECK(corrupted([&](auto& t) { Access::states(t)[at(v)] = State::kHidden; }) != "");
  CHECK(corrupted([&](auto& t) { Access::vertex_cell(t)[at(v)] = kNone; }) != "");
  CHECK(corrupted([&](auto& t) { Access::points(t)[at(v)].w += 0.5; }) != "");
  CHECK(corrupted([&](auto& t) { Access::points(t)[at(v)].x += 2; }) != "");
  Index hidden = 0;
  while (good.state(hidden) != State::kHidden) ++hidden;
  CHECK(corrupted([&](auto& t) { Access::points(t)[at(hidden)].w = 10; }) != "");
  CHECK(corrupted([&](auto& t) { Access::points(t)[at(hidden)].x += 5; }) != "");
  CHECK(corrupted([&](auto& t) { Access::states(t)[at(hidden)] = State::kVisible; }) != "");
}

TEST_CASE("triangulation: cells are positively oriented and the hull faces outwards") {
  Rng rng(15);
  const NamedSites in = random_cube(rng, 500, 0.01);
  const RegularTriangulation t = built(in);
  const auto cells = t.cells();
  for (Index r = 0; r < cells.rows(); ++r) {
    REQUIRE(amps::orient3d(t.point(cells(r, 0)), t.point(cells(r, 1)), t.point(cells(r, 2)), t.point(cells(r, 3))) > 0);
  }
  const auto hull = t.hull();
  for (Index r = 0; r < hull.rows(); ++r) {
    for (Index v = 0; v < t.num_vertices(); ++v) {
      REQUIRE(amps::orient3d(t.point(hull(r, 0)), t.point(hull(r, 1)), t.point(hull(r, 2)), t.point(v)) <= 0);
    }
  }
  CHECK(hull.rows() % 2 == 0);
}

TEST_SUITE("slow") {
  TEST_CASE("triangulation: a set of 100,000 points proves itself, in bulk and grown one by one with hints") {
    Rng rng(16);
    NamedSites in = random_cube(rng, 100000, 1e-3);
    RegularTriangulation bulk = built(in);
    CHECK(bulk.check() == "");
    const RegularTriangulation grown = one_by_one(in, 80000);
    CHECK(grown.check() == "");
    CHECK(cell_set(grown) == cell_set(bulk));
  }
}

}  // namespace amps_test
