// triangulation_edits.h: removing, moving and putting back points of a RegularTriangulation. The law behind all tests: whatever
// has happened before, the triangulation is the one that construction makes of the points that are left.
#pragma once

#include "triangulations.h"

#include <algorithm>
#include <functional>
#include <vector>

namespace amps_test {

/// The law. Construction keeps the order of ids, so of equal points the same one is the vertex.
inline void require_rebuilt(const RegularTriangulation& t) {
  REQUIRE(t.check() == "");
  const std::vector<Index> id = live_ids(t);
  REQUIRE(t.num_vertices() - t.num_removed() == static_cast<Index>(id.size()));
  WeightedPoints left;
  for (const Index v : id) left.push_back(t.point(v));
  const RegularTriangulation fresh = built(left);
  REQUIRE(t.dimension() == fresh.dimension());
  REQUIRE(t.num_hidden() == fresh.num_hidden());
  REQUIRE(t.num_ghosts() == fresh.num_ghosts());
  for (std::size_t k = 0; k < id.size(); ++k) {
    // Which of hidden and duplicate a point is may depend on when it came; whether it is a vertex may not.
    REQUIRE((t.state(id[k]) == State::kVisible) == (fresh.state(static_cast<Index>(k)) == State::kVisible));
  }
  REQUIRE(cell_set(t) == renamed(cell_set(fresh), id));
}

/// Removes everything in the given order, proving the law each `every` steps.
inline void remove_all(RegularTriangulation t, const std::vector<Index>& order, Index every) {
  REQUIRE(order.size() == live_ids(t).size());
  Index step = 0;
  for (const Index v : order) {
    CAPTURE(step);
    CAPTURE(v);
    t.remove(v);
    REQUIRE(t.state(v) == State::kRemoved);
    REQUIRE(t.incident_cell(v) == kNone);
    const Index left = static_cast<Index>(order.size()) - ++step;
    if (step % every == 0 || left < 8) require_rebuilt(t);
  }
  CHECK(t.dimension() == -1);
  CHECK(t.num_cells() == 0);
  CHECK(t.num_hidden() == 0);
  CHECK(t.power_nearest(Vec3::Zero()) == kNone);
}

/// Random, ascending and descending order, and from the outside in.
inline void remove_in_many_orders(Rng& rng, const WeightedPoints& sites, Index every = 1) {
  const RegularTriangulation t = built(sites);
  std::vector<Index> order = live_ids(t);
  remove_all(t, order, every);
  std::reverse(order.begin(), order.end());
  remove_all(t, order, every);
  remove_all(t, shuffled(order, rng), every);
  Vec3 middle = Vec3::Zero();
  for (const WeightedPoint& p : sites) middle += p.position() / static_cast<double>(sites.size());
  std::sort(order.begin(), order.end(), [&](Index a, Index b) {
    const double da = (sites[at(a)].position() - middle).squaredNorm(), db = (sites[at(b)].position() - middle).squaredNorm();
    return da != db ? da > db : a < b;
  });
  remove_all(t, order, every);
}

inline WeightedPoints cubic(int m) {
  return integer_points(0, m, [](int, int, int) { return true; });
}

inline WeightedPoints bcc(int m) {
  return integer_points(0, m, [](int x, int y, int z) { return (x & 1) == (y & 1) && (y & 1) == (z & 1); });
}

inline WeightedPoints fcc(int m) {
  return integer_points(0, m, [](int x, int y, int z) { return (x + y + z) % 2 == 0; });
}

inline WeightedPoints cospherical() { return integer_sphere(81); }

/// |p|² − w is one constant: all points lie on one hyperplane when lifted.
inline WeightedPoints co_power_spherical() {
  WeightedPoints result = integer_points(-2, 3, [](int x, int y, int z) { return (x + y + z) % 2 == 0; });
  for (WeightedPoint& p : result) p.w = p.position().squaredNorm();
  return result;
}

/// Everything that a program of edits and queries does, at random.
struct Player {
  Rng rng;
  std::function<WeightedPoint(Rng&)> next;
  RegularTriangulation t;

  WeightedPoint draw() { return next(rng); }
  Index any_live() {
    const std::vector<Index> ids = live_ids(t);
    return ids[rng.below(ids.size())];
  }
  Index any_removed() {
    for (;;) {
      const Index v = below(rng, t.num_vertices());
      if (t.state(v) == State::kRemoved) return v;
    }
  }
  Index any_hint() { return t.cell_capacity() == 0 || rng.below(2) == 0 ? kNone : below(rng, t.cell_capacity()); }
  void step(double growth) {
    const bool empty = t.num_removed() == t.num_vertices();
    const double u = rng.uniform();
    if (empty || u < 0.3 * growth) {
      const WeightedPoint p = draw();
      t.insert(p.position(), p.w, any_hint());
    } else if (u < 0.4 * growth && t.num_removed() > 0) {
      const WeightedPoint p = draw();
      t.reinsert(any_removed(), p.position(), p.w, any_hint());
    } else if (u < 0.43 * growth) {
      const WeightedPoints some = drawn(5, [this] { return draw(); });
      insert_all(t, some);
    } else if (u < 0.85) {
      t.remove(any_live());
    } else {
      const Index v = any_live();
      const WeightedPoint p = draw();
      t.move(v, u < 0.9 ? p.position() : t.point(v).position(), p.w);
    }
  }
};

}  // namespace amps_test
