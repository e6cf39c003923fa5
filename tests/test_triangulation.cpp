#include "amps/triangulation.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <string>
#include <vector>

using amps::Error;
using amps::ErrorCode;
using amps::Index;
using amps::kNone;
using amps::Points;
using amps::RegularTriangulation;
using amps::Rng;
using amps::Vec3;
using amps::WeightedPoint;
using State = RegularTriangulation::VertexState;

namespace amps::detail {
struct TriangulationTestAccess {
  static auto& cells(RegularTriangulation& t) { return t.cells_; }
  static std::vector<RegularTriangulation::VertexState>& states(RegularTriangulation& t) { return t.state_; }
  static std::vector<WeightedPoint>& points(RegularTriangulation& t) { return t.points_; }
  static std::vector<Index>& vertex_cell(RegularTriangulation& t) { return t.vertex_cell_; }
  static Index& num_finite(RegularTriangulation& t) { return t.num_finite_; }
};
}  // namespace amps::detail
using Access = amps::detail::TriangulationTestAccess;

namespace {

using CellSet = std::set<std::array<Index, 4>>;

CellSet cell_set(const RegularTriangulation& t) {
  CellSet result;
  const auto cells = t.cells();
  for (Eigen::Index r = 0; r < cells.rows(); ++r) {
    std::array<Index, 4> cell = {cells(r, 0), cells(r, 1), cells(r, 2), cells(r, 3)};
    std::sort(cell.begin(), cell.end());
    result.insert(cell);
  }
  REQUIRE(result.size() == static_cast<std::size_t>(t.num_cells()));
  return result;
}

struct Input {
  std::string name;
  Points positions;
  Eigen::VectorXd weights;
  Input(std::string n, Eigen::Index size)
      : name(std::move(n)), positions(Points::Zero(size, 3)), weights(Eigen::VectorXd::Zero(size)) {}
  Eigen::Index size() const { return positions.rows(); }
  WeightedPoint point(Eigen::Index k) const { return {positions(k, 0), positions(k, 1), positions(k, 2), weights[k]}; }
};

/// Of each position the heaviest point, of these the first: the only ones that can be vertices.
std::vector<Index> candidates(const Input& in) {
  std::vector<Index> result;
  for (Eigen::Index a = 0; a < in.size(); ++a) {
    bool best = true;
    for (Eigen::Index b = 0; b < in.size(); ++b) {
      if (a == b || !amps::same_position(in.point(a), in.point(b))) continue;
      if (in.weights[b] > in.weights[a] || (in.weights[b] == in.weights[a] && b < a)) best = false;
    }
    if (best) result.push_back(static_cast<Index>(a));
  }
  return result;
}

/// The oracle: all quadruples that are not flat and in conflict with no other point.
CellSet brute_force(const Input& in) {
  const std::vector<Index> id = candidates(in);
  const std::size_t n = id.size();
  CellSet result;
  for (std::size_t a = 0; a < n; ++a) {
    for (std::size_t b = a + 1; b < n; ++b) {
      for (std::size_t c = b + 1; c < n; ++c) {
        for (std::size_t d = c + 1; d < n; ++d) {
          WeightedPoint p[4] = {in.point(id[a]), in.point(id[b]), in.point(id[c]), in.point(id[d])};
          const int orientation = amps::orient3d(p[0], p[1], p[2], p[3]);
          if (orientation == 0) continue;
          if (orientation < 0) std::swap(p[0], p[1]);
          bool empty = true;
          for (std::size_t q = 0; q < n && empty; ++q) {
            if (q == a || q == b || q == c || q == d) continue;
            empty = amps::power_test(p[0], p[1], p[2], p[3], in.point(id[q])) < 0;
          }
          if (empty) result.insert({id[a], id[b], id[c], id[d]});
        }
      }
    }
  }
  return result;
}

Input random_cube(Rng& rng, Eigen::Index n, double weight_range) {
  Input in("cube, weights to " + std::to_string(weight_range), n);
  for (Eigen::Index k = 0; k < n; ++k) {
    for (int a = 0; a < 3; ++a) in.positions(k, a) = rng.uniform();
    in.weights[k] = weight_range * rng.uniform();
  }
  return in;
}

Input lattice(Rng& rng, Eigen::Index n, int side, int weights) {
  Input in("lattice " + std::to_string(side) + ", weights " + std::to_string(weights), n);
  for (Eigen::Index k = 0; k < n; ++k) {
    for (int a = 0; a < 3; ++a) in.positions(k, a) = static_cast<double>(rng.below(static_cast<std::uint64_t>(side)));
    in.weights[k] = static_cast<double>(rng.below(static_cast<std::uint64_t>(weights)));
  }
  return in;
}

/// Integer points on the sphere x² + y² + z² = 81: exactly cospherical.
Input cospherical(Rng& rng, Eigen::Index n) {
  std::vector<Vec3> all;
  for (int x = -9; x <= 9; ++x) {
    for (int y = -9; y <= 9; ++y) {
      for (int z = -9; z <= 9; ++z) {
        if (x * x + y * y + z * z == 81) all.emplace_back(x, y, z);
      }
    }
  }
  Input in("cospherical", std::min<Eigen::Index>(n, static_cast<Eigen::Index>(all.size())));
  for (Eigen::Index k = 0; k < in.size(); ++k) {
    const std::size_t at = rng.below(all.size());
    in.positions.row(k) = all[at].transpose();
    all.erase(all.begin() + static_cast<std::ptrdiff_t>(at));
  }
  return in;
}

Input coplanar_heavy(Rng& rng, Eigen::Index n) {
  Input in("coplanar-heavy", n);
  for (Eigen::Index k = 0; k < n; ++k) {
    in.positions.row(k) << rng.uniform(), rng.uniform(), (k % 8 == 0 ? static_cast<double>(rng.below(3)) : 1.0);
    in.weights[k] = static_cast<double>(rng.below(2)) * 0.01;
  }
  return in;
}

std::vector<Input> small_inputs(std::uint64_t seed) {
  Rng rng(seed);
  std::vector<Input> inputs;
  for (const double range : {0.0, 0.05, 0.5}) inputs.push_back(random_cube(rng, 22, range));
  inputs.push_back(lattice(rng, 22, 3, 1));
  inputs.push_back(lattice(rng, 26, 3, 3));
  inputs.push_back(lattice(rng, 18, 2, 4));
  inputs.push_back(cospherical(rng, 20));
  inputs.push_back(coplanar_heavy(rng, 22));
  Input line("on two lines", 20);
  for (Eigen::Index k = 0; k < 20; ++k)
    line.positions.row(k) << (k < 10 ? double(k) : 4.0), (k < 10 ? 0.0 : double(k - 14)), (k < 10 ? 0 : 1);
  inputs.push_back(line);
  Input one_big("one point hides most", 20);
  one_big = random_cube(rng, 20, 0.01);
  one_big.weights[7] = 0.3;
  inputs.push_back(one_big);
  return inputs;
}

RegularTriangulation one_by_one(const Input& in, Eigen::Index first = 0) {
  RegularTriangulation t;
  if (first > 0) t.insert(in.positions.topRows(first), in.weights.head(first));
  for (Eigen::Index k = first; k < in.size(); ++k) t.insert(Vec3(in.positions.row(k)), in.weights[k]);
  return t;
}

void check_same_vertices(const RegularTriangulation& a, const RegularTriangulation& b) {
  REQUIRE(a.num_vertices() == b.num_vertices());
  for (Index v = 0; v < a.num_vertices(); ++v) {
    // Which of hidden and duplicate a point is may depend on when it came; whether it is a vertex may not.
    REQUIRE((a.state(v) == State::kVisible) == (b.state(v) == State::kVisible));
  }
}

ErrorCode code_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.code();
  }
  FAIL("no error");
  return ErrorCode::kInternal;
}

}  // namespace

TEST_CASE("triangulation: the cells are those of the brute-force oracle") {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    for (const Input& in : small_inputs(seed)) {
      CAPTURE(in.name);
      CAPTURE(seed);
      const RegularTriangulation t(in.positions, in.weights);
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
    std::array<Index, 8> corner_of_id{};
    for (const Index k : order) corner_of_id[static_cast<std::size_t>(t.insert(corner(k), 0.0))] = k;
    CellSet cells;
    for (auto cell : cell_set(t)) {
      for (Index& v : cell) v = corner_of_id[static_cast<std::size_t>(v)];
      std::sort(cell.begin(), cell.end());
      cells.insert(cell);
    }
    if (expected.empty()) expected = cells;
    different += cells != expected;
    ++count;
  } while (std::next_permutation(order.begin(), order.end()));
  CHECK(count == 40320);
  CHECK(different == 0);
  Input in("cube", 8);
  for (Index k = 0; k < 8; ++k) in.positions.row(k) = corner(k).transpose();
  CHECK(expected == brute_force(in));
}

TEST_CASE("triangulation: bulk, one by one, mixed and shuffled insertion give the same cells") {
  Rng rng(3);
  std::vector<Input> inputs = small_inputs(77);
  inputs.push_back(random_cube(rng, 3000, 0.0));
  inputs.push_back(random_cube(rng, 3000, 0.05));
  inputs.push_back(lattice(rng, 2500, 12, 3));
  inputs.push_back(coplanar_heavy(rng, 1500));
  for (const Input& in : inputs) {
    CAPTURE(in.name);
    const RegularTriangulation bulk(in.positions, in.weights);
    REQUIRE(bulk.check() == "");
    const CellSet expected = cell_set(bulk);
    for (const Eigen::Index first : {Eigen::Index{0}, in.size() / 3}) {
      const RegularTriangulation t = one_by_one(in, first);
      REQUIRE(t.check() == "");
      REQUIRE(cell_set(t) == expected);
      check_same_vertices(t, bulk);
    }
    RegularTriangulation twice;
    const Eigen::Index half = in.size() / 2;
    twice.insert(in.positions.topRows(half), in.weights.head(half));
    twice.insert(in.positions.bottomRows(in.size() - half), in.weights.tail(in.size() - half));
    REQUIRE(twice.check() == "");
    REQUIRE(cell_set(twice) == expected);
    check_same_vertices(twice, bulk);

    // Shuffled: compare through the permutation; of equal points another one may be the vertex, so by value.
    std::vector<Eigen::Index> order(static_cast<std::size_t>(in.size()));
    for (std::size_t k = 0; k < order.size(); ++k) order[k] = static_cast<Eigen::Index>(k);
    for (std::size_t k = order.size(); k > 1; --k) std::swap(order[k - 1], order[rng.below(k)]);
    Input shuffled(in.name, in.size());
    for (std::size_t k = 0; k < order.size(); ++k) {
      shuffled.positions.row(static_cast<Eigen::Index>(k)) = in.positions.row(order[k]);
      shuffled.weights[static_cast<Eigen::Index>(k)] = in.weights[order[k]];
    }
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
    REQUIRE(by_value(RegularTriangulation(shuffled.positions, shuffled.weights)) == by_value(bulk));
  }
}

TEST_CASE("triangulation: of equal points the heaviest is the vertex, of equal weights the first, the others are duplicates") {
  Rng rng(4);
  const Input base = random_cube(rng, 200, 0.0);
  Input in("twins", 400);
  in.positions << base.positions, base.positions;
  for (const bool bulk : {true, false}) {
    const RegularTriangulation t = bulk ? RegularTriangulation(in.positions, in.weights) : one_by_one(in);
    for (Index v = 0; v < 400; ++v) CHECK(t.state(v) == (v < 200 ? State::kVisible : State::kDuplicate));
    CHECK(t.num_hidden() == 200);
    CHECK(t.check() == "");
  }
  in.weights.tail(200).setConstant(1e-9);
  for (const bool bulk : {true, false}) {
    const RegularTriangulation t = bulk ? RegularTriangulation(in.positions, in.weights) : one_by_one(in);
    for (Index v = 0; v < 400; ++v) CHECK(t.state(v) == (v < 200 ? State::kHidden : State::kVisible));
    CHECK(t.check() == "");
  }
}

TEST_CASE("triangulation: locate finds the cell that contains a point, or a hull facet that sees it") {
  Rng rng(5);
  for (const Input& in : {random_cube(rng, 500, 0.01), lattice(rng, 300, 6, 1), coplanar_heavy(rng, 300)}) {
    CAPTURE(in.name);
    const RegularTriangulation t(in.positions, in.weights);
    REQUIRE(t.dimension() == 3);
    const Vec3 low = in.positions.colwise().minCoeff(), high = in.positions.colwise().maxCoeff();
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
      if (k % 10 == 0)
        x = in.positions.row(static_cast<Eigen::Index>(rng.below(static_cast<std::uint64_t>(in.size())))).transpose();
      const Index hint = k % 2 == 0 ? kNone : static_cast<Index>(rng.below(static_cast<std::uint64_t>(t.cell_capacity())));
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
  Input in = random_cube(rng, 300, 0.0);
  const RegularTriangulation t(in.positions, in.weights);
  for (int e = -30; e <= 300; e += 5) {
    const double r = std::pow(10.0, e);
    const Vec3 x(0.5 + r, 0.5 - 0.3 * r, 0.5 + 0.7 * r);
    const Index c = t.locate(x);
    CHECK(t.cell(c).ghost() == (r > 0.8));
  }
}

TEST_CASE("triangulation: power_nearest is the brute-force nearest, ties to the lexicographically smallest") {
  Rng rng(7);
  for (const Input& in : {random_cube(rng, 400, 0.05), lattice(rng, 300, 6, 3), cospherical(rng, 60), lattice(rng, 60, 3, 1)}) {
    CAPTURE(in.name);
    const RegularTriangulation t(in.positions, in.weights);
    for (int k = 0; k < 400; ++k) {
      Vec3 x;
      for (int a = 0; a < 3; ++a)
        x[a] = in.name[0] == 'l' ? static_cast<double>(rng.below(13)) / 2 : 1.5 * rng.uniform() - 0.25;
      if (in.name == "cospherical" && k % 2 == 0) x.setZero();
      Index expected = kNone;
      for (const Index v : candidates(in)) {
        if (expected == kNone) {
          expected = v;
          continue;
        }
        const WeightedPoint &p = in.point(v), &q = in.point(expected);
        // Small integers and halves are exact; random data has no ties.
        const double pp = (x - p.position()).squaredNorm() - p.w, pq = (x - q.position()).squaredNorm() - q.w;
        if (pp < pq || (pp == pq && amps::lexicographically_less(p, q))) expected = v;
      }
      const Index near = k % 3 == 0 ? kNone : static_cast<Index>(rng.below(static_cast<std::uint64_t>(in.size())));
      REQUIRE(t.power_nearest(x, near) == expected);
    }
  }
}

TEST_CASE("triangulation: neighbors, adjacency and incident_cells agree with the cells") {
  Rng rng(8);
  for (const Input& in : {random_cube(rng, 600, 0.05), lattice(rng, 400, 7, 1)}) {
    const RegularTriangulation t(in.positions, in.weights);
    std::vector<std::set<Index>> around(static_cast<std::size_t>(t.num_vertices())), star(around);
    Index finite = 0, ghosts = 0;
    for (Index c = 0; c < t.cell_capacity(); ++c) {
      if (!t.cell(c).alive()) continue;
      ++(t.cell(c).ghost() ? ghosts : finite);
      for (const Index v : t.cell(c).vertex) {
        if (v == RegularTriangulation::kInfinite) continue;
        star[static_cast<std::size_t>(v)].insert(c);
        for (const Index u : t.cell(c).vertex) {
          if (u != v && u != RegularTriangulation::kInfinite) around[static_cast<std::size_t>(v)].insert(u);
        }
      }
    }
    CHECK(finite == t.num_cells());
    CHECK(ghosts == t.num_ghosts());
    CHECK(t.hull().rows() == ghosts);
    const auto adjacency = t.adjacency();
    std::vector<Index> out;
    for (Index v = 0; v < t.num_vertices(); ++v) {
      const std::size_t at = static_cast<std::size_t>(v);
      const std::vector<Index> expected(around[at].begin(), around[at].end());
      t.neighbors(v, out);
      REQUIRE(out == expected);
      REQUIRE(std::vector<Index>(adjacency.adjacent.begin() + adjacency.offset[at],
                                 adjacency.adjacent.begin() + adjacency.offset[at + 1]) == expected);
      t.incident_cells(v, out);
      REQUIRE(std::set<Index>(out.begin(), out.end()) == star[at]);
      REQUIRE(out.size() == star[at].size());
      REQUIRE((t.incident_cell(v) == kNone) == star[at].empty());
      if (!star[at].empty()) REQUIRE(star[at].count(t.incident_cell(v)) == 1);
    }
  }
}

TEST_CASE("triangulation: the star of a vertex of high degree is complete") {
  Rng rng(9);
  Input in("hub", 4001);  // a sphere around one point: its degree is 4,000, and its insertion digs one huge cavity
  for (Eigen::Index k = 1; k <= 4000; ++k) {
    const double z = 2 * rng.uniform() - 1, a = 6.283185307179586 * rng.uniform(), s = std::sqrt(1 - z * z);
    in.positions.row(k) << s * std::cos(a), s * std::sin(a), z;
  }
  Input hub_last("hub last", 4001);
  hub_last.positions << in.positions.bottomRows(4000), in.positions.topRows(1);
  for (const Input* order : {&in, &hub_last}) {
    const RegularTriangulation t = one_by_one(*order, 4000);
    REQUIRE(t.check() == "");
    std::vector<Index> out;
    t.neighbors(order == &in ? 0 : 4000, out);
    CHECK(out.size() == 4000);
  }
}

TEST_CASE("triangulation: flat sets have a dimension and no cells, and grow from there") {
  RegularTriangulation t;
  CHECK(t.dimension() == -1);
  CHECK(t.locate(Vec3::Zero()) == kNone);
  CHECK(t.power_nearest(Vec3::Zero()) == kNone);
  t.insert(Points(0, 3));
  CHECK(t.dimension() == -1);
  for (int k = 0; k < 3; ++k) t.insert(Vec3(1, 2, 3), 0);
  CHECK(t.dimension() == 0);
  for (int k = 0; k < 4; ++k) t.insert(Vec3(1 + k, 2 + k, 3 - k), 0);
  CHECK(t.dimension() == 1);
  CHECK(t.num_cells() == 0);
  Points plane(3, 3);
  plane << 5, 2, 3, 6, 2, 3, 9, 2, 3;
  t.insert(plane);
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
  Input all("all", t.num_vertices());
  for (Index v = 0; v < t.num_vertices(); ++v) all.positions.row(v) = t.point(v).position().transpose();
  CHECK(cell_set(t) == brute_force(all));
}

TEST_CASE("triangulation: flat bulk input of every dimension, then a point outside it") {
  Rng rng(10);
  for (int dimension = 0; dimension <= 2; ++dimension) {
    CAPTURE(dimension);
    Input in("flat", 300);
    for (Eigen::Index k = 0; k < 300; ++k) {
      for (int a = 0; a < dimension; ++a) in.positions(k, a) = static_cast<double>(rng.below(20));
    }
    RegularTriangulation t(in.positions, in.weights);
    CHECK(t.dimension() == dimension);
    CHECK(t.num_cells() == 0);
    CHECK(t.adjacency().adjacent.empty());
    Points apexes(3, 3);
    apexes << 0.5, 0.25, 1, 0.25, 3, 0.5, -1, 0.5, 0.5;
    Eigen::VectorXd zero = Eigen::VectorXd::Zero(3);
    t.insert(apexes, zero);
    CHECK(t.dimension() == 3);
    CHECK(t.check() == "");
    Input all("all", 303);
    all.positions << in.positions, apexes;
    CHECK(cell_set(t) == cell_set(one_by_one(all)));
  }
}

TEST_CASE("triangulation: scale by powers of two, and offsets where they are exact, do not change the cells") {
  Rng rng(11);
  Input in = random_cube(rng, 300, 0.02);
  for (Eigen::Index k = 0; k < in.size(); ++k) {
    for (int a = 0; a < 3; ++a) in.positions(k, a) = std::floor(in.positions(k, a) * 0x1p20) * 0x1p-20;
  }
  const CellSet expected = cell_set(RegularTriangulation(in.positions, in.weights));
  for (const int e : {-480, -330, -100, 60, 166, 400, 500}) {
    CAPTURE(e);
    const Points scaled = in.positions * std::ldexp(1.0, e);
    const Eigen::VectorXd weights = in.weights * std::ldexp(1.0, 2 * e);
    const RegularTriangulation t(scaled, weights);
    CHECK(t.check() == "");
    CHECK(cell_set(t) == expected);
  }
  for (const double offset : {1.0, 1e6, 1e8}) {
    CAPTURE(offset);
    const Points moved = in.positions + Points::Constant(in.size(), 3, offset);
    const RegularTriangulation t(moved, in.weights);
    CHECK(t.check() == "");
    CHECK(cell_set(t) == expected);
  }
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(in.size());
  const CellSet unweighted = cell_set(RegularTriangulation(in.positions, none));
  for (const int e : {-1050, -1000, 1000, 1023}) {  // denormals, and the largest doubles
    CAPTURE(e);
    Points scaled = in.positions;
    for (Eigen::Index k = 0; k < scaled.size(); ++k) scaled.data()[k] = std::ldexp(scaled.data()[k], e);
    const RegularTriangulation t(scaled, none);
    CHECK(t.check() == "");
    CHECK(cell_set(t) == unweighted);
  }
}

TEST_CASE("triangulation: adding one constant to all weights does not change the cells") {
  Rng rng(12);
  const Input in = lattice(rng, 400, 8, 3);
  const CellSet expected = cell_set(RegularTriangulation(in.positions, in.weights));
  for (const double shift : {-1000.0, 0.5, 0x1p40}) {
    const Eigen::VectorXd weights = in.weights.array() + shift;
    CHECK(cell_set(RegularTriangulation(in.positions, weights)) == expected);
  }
}

TEST_CASE("triangulation: bad input is refused with a reason and changes nothing") {
  Rng rng(13);
  const Input in = random_cube(rng, 100, 0.01);
  RegularTriangulation t(in.positions, in.weights);
  const CellSet before = cell_set(t);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Points bad = in.positions.topRows(5);
  for (const double value : {nan, double(INFINITY), -double(INFINITY)}) {
    bad(3, 1) = value;
    CHECK(code_of([&] { t.insert(bad); }) == ErrorCode::kInvalidArgument);
    CHECK(code_of([&] { t.insert(Vec3(0, value, 0), 0); }) == ErrorCode::kInvalidArgument);
    CHECK(code_of([&] { t.insert(Vec3(0, 0, 0), value); }) == ErrorCode::kInvalidArgument);
    CHECK(code_of([&] { t.locate(Vec3(0, value, 0)); }) == ErrorCode::kInvalidArgument);
    CHECK(code_of([&] { t.power_nearest(Vec3(0, value, 0)); }) == ErrorCode::kInvalidArgument);
  }
  try {
    t.insert(bad);
  } catch (const Error& error) {
    CHECK(std::string(error.what()).find("point 3") != std::string::npos);
  }
  CHECK(code_of([&] { t.insert(in.positions, in.weights.head(7)); }) == ErrorCode::kInvalidArgument);
  CHECK(t.num_vertices() == 100);
  CHECK(t.check() == "");
  CHECK(cell_set(t) == before);
}

TEST_CASE("triangulation: check notices corruption") {
  Rng rng(14);
  const Input in = random_cube(rng, 60, 0.2);
  const RegularTriangulation good(in.positions, in.weights);
  REQUIRE(good.check() == "");
  REQUIRE(good.num_hidden() > 0);
  Index alive = 0;
  while (!good.cell(alive).alive() || good.cell(alive).ghost()) ++alive;
  const std::size_t c = static_cast<std::size_t>(alive);
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
  CHECK(corrupted([&](auto& t) { Access::states(t)[static_cast<std::size_t>(v)] = State::kHidden; }) != "");
  CHECK(corrupted([&](auto& t) { Access::vertex_cell(t)[static_cast<std::size_t>(v)] = kNone; }) != "");
  CHECK(corrupted([&](auto& t) { Access::points(t)[static_cast<std::size_t>(v)].w += 0.5; }) != "");
  CHECK(corrupted([&](auto& t) { Access::points(t)[static_cast<std::size_t>(v)].x += 2; }) != "");
  Index hidden = 0;
  while (good.state(hidden) != State::kHidden) ++hidden;
  CHECK(corrupted([&](auto& t) { Access::points(t)[static_cast<std::size_t>(hidden)].w = 10; }) != "");
  CHECK(corrupted([&](auto& t) { Access::points(t)[static_cast<std::size_t>(hidden)].x += 5; }) != "");
  CHECK(corrupted([&](auto& t) { Access::states(t)[static_cast<std::size_t>(hidden)] = State::kVisible; }) != "");
}

TEST_CASE("triangulation: cells are positively oriented and the hull faces outwards") {
  Rng rng(15);
  const Input in = random_cube(rng, 500, 0.01);
  const RegularTriangulation t(in.positions, in.weights);
  const auto cells = t.cells();
  for (Eigen::Index r = 0; r < cells.rows(); ++r) {
    REQUIRE(amps::orient3d(t.point(cells(r, 0)), t.point(cells(r, 1)), t.point(cells(r, 2)), t.point(cells(r, 3))) > 0);
  }
  const auto hull = t.hull();
  for (Eigen::Index r = 0; r < hull.rows(); ++r) {
    for (Index v = 0; v < t.num_vertices(); ++v) {
      REQUIRE(amps::orient3d(t.point(hull(r, 0)), t.point(hull(r, 1)), t.point(hull(r, 2)), t.point(v)) <= 0);
    }
  }
  CHECK(hull.rows() % 2 == 0);
}

TEST_SUITE("slow") {
  TEST_CASE("triangulation: a set of 100,000 points proves itself, in bulk and grown one by one with hints") {
    Rng rng(16);
    Input in = random_cube(rng, 100000, 1e-3);
    RegularTriangulation bulk(in.positions, in.weights);
    CHECK(bulk.check() == "");
    const RegularTriangulation grown = one_by_one(in, 80000);
    CHECK(grown.check() == "");
    CHECK(cell_set(grown) == cell_set(bulk));
  }
}
