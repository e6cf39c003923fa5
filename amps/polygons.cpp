#define AMPS_OWN_SOURCE
#include "amps/polygons.h"

#include "amps/predicates.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

namespace amps::detail {
namespace {

/// By how much the cotangents opposite to a diagonal may add up to less than 0 before the other one is taken: corners on a
/// circle, as those of rectangles in single precision, keep the first.
constexpr double kDiagonalSlack = 1e-4;

/// Newell's normal of a ring, up to a factor > 0: coordinates are divided by the extent, so that nothing overflows.
Vec3 newell_normal(const ProjectedRing& ring) {
  const auto at = [&](std::size_t k) { return ring.at(k); };
  double extent = 0;
  for (std::size_t k = 1; k < ring.size(); ++k) {
    for (int c = 0; c < 3; ++c) extent = std::max(extent, std::abs(0.5 * at(k)[c] - 0.5 * at(0)[c]));
  }
  const auto from_first = [&](std::size_t k) {
    Vec3 x;
    for (int c = 0; c < 3; ++c) x[c] = (0.5 * at(k)[c] - 0.5 * at(0)[c]) / extent;
    return x;
  };
  Vec3 normal = Vec3::Zero();
  for (std::size_t k = 2; k < ring.size(); ++k) normal += from_first(k - 1).cross(from_first(k));
  return normal;
}

/// Of the angle at b.
double cotangent_at(const double* a, const double* b, const double* c) {
  const Vec3 u(a[0] - b[0], a[1] - b[1], a[2] - b[2]), v(c[0] - b[0], c[1] - b[1], c[2] - b[2]);
  return dot(u, v) / norm(u.cross(v));
}

/// Polygons of so many corners are worth a sweep and a tree.
constexpr std::size_t kManyCorners = 48;

/// Rings are long loops: a look, if it is time for one.
void look_at_ring(const Execution& execution, std::size_t step) {
  constexpr std::size_t steps_per_look = 1 << 10;
  if (step % steps_per_look == 0) execution.report(0);
}

/// Do two edges cross in a point inside both?
bool edges_cross(const ProjectedRing& ring, std::size_t a, std::size_t c) {
  const std::size_t b = ring.after(a), d = ring.after(c);
  return ring.turn(a, b, c) * ring.turn(a, b, d) < 0 && ring.turn(c, d, a) * ring.turn(c, d, b) < 0;
}

/// The edges of a ring that a line meets as it sweeps over the plane, in order along it. The line is as good as parallel to the
/// second coordinate, and leans just so far that it meets points of one first coordinate one after another.
///
/// Edges may touch and lie on each other, as those of bridges do: while none cross, two that the line meets have one order
/// wherever both are, or are in one line. So the order holds up to the first crossing, and of the edges that go through that
/// point two that cross are neighbours before, or when those that end there are gone.
class RingSweep {
 public:
  RingSweep(const ProjectedRing& ring, const Execution& execution)
      : ring_(ring), execution_(execution), met_(Below{this}), place_(ring.size(), met_.end()) {}

  bool finds_crossing() {
    std::vector<Event> events;
    for (std::size_t k = 0; k < ring_.size(); ++k) {
      const bool straight = precedes(k, ring_.after(k)), back = precedes(ring_.after(k), k);
      if (!straight && !back) continue;  // a point, as it is seen here
      events.push_back({straight ? k : ring_.after(k), k, true});
      events.push_back({straight ? ring_.after(k) : k, k, false});
    }
    std::size_t compared = 0;
    std::sort(events.begin(), events.end(), [&](const Event& e, const Event& f) {
      look_at_ring(execution_, ++compared);
      if (precedes(e.corner, f.corner)) return true;
      if (precedes(f.corner, e.corner)) return false;
      return e.begins != f.begins ? f.begins : e.edge < f.edge;  // what ends at a point goes first
    });
    for (std::size_t i = 0; i < events.size(); ++i) {
      look_at_ring(execution_, i);
      const std::size_t edge = events[i].edge;
      if (events[i].begins) {
        const auto here = place_[edge] = met_.insert(edge).first;
        if (here != met_.begin() && edges_cross(ring_, *std::prev(here), edge)) return true;
        if (std::next(here) != met_.end() && edges_cross(ring_, *std::next(here), edge)) return true;
      } else {
        const auto above = met_.erase(place_[edge]);
        if (above != met_.begin() && above != met_.end() && edges_cross(ring_, *std::prev(above), *above)) return true;
      }
    }
    return false;
  }

 private:
  struct Event {
    std::size_t corner, edge;
    bool begins;
  };
  struct Below {
    const RingSweep* sweep;
    bool operator()(std::size_t s, std::size_t t) const { return sweep->is_below(s, t); }
  };

  /// Does the line meet a before b?
  bool precedes(std::size_t a, std::size_t b) const {
    const double *x = ring_.at(a), *y = ring_.at(b);
    const int first = (ring_.axis + 1) % 3, second = (ring_.axis + 2) % 3;
    return x[first] < y[first] || (x[first] == y[first] && x[second] < y[second]);
  }
  std::size_t begin_of(std::size_t edge) const { return precedes(edge, ring_.after(edge)) ? edge : ring_.after(edge); }
  std::size_t end_of(std::size_t edge) const { return precedes(edge, ring_.after(edge)) ? ring_.after(edge) : edge; }

  /// On which side of edge s edge t goes on, where it begins later: +1 above, 0 in one line with it.
  int side(std::size_t s, std::size_t t) const {
    const double *from = ring_.at(begin_of(s)), *to = ring_.at(end_of(s));
    const int at_begin = orient2d(from, to, ring_.at(begin_of(t)), ring_.axis);
    return at_begin != 0 ? at_begin : orient2d(from, to, ring_.at(end_of(t)), ring_.axis);
  }
  bool is_below(std::size_t s, std::size_t t) const {
    if (s == t) return false;
    const int above = precedes(begin_of(s), begin_of(t)) ? side(s, t) : -side(t, s);
    return above != 0 ? above > 0 : s < t;
  }

  using Met = std::set<std::size_t, Below>;
  const ProjectedRing& ring_;
  const Execution& execution_;
  Met met_;
  std::vector<Met::iterator> place_;  // by edge
};

/// Do two edges cross in a point inside both?
bool crosses_itself(const ProjectedRing& ring, const Execution& execution) {
  if (ring.size() >= kManyCorners) return RingSweep(ring, execution).finds_crossing();
  for (std::size_t a = 0; a < ring.size(); ++a) {
    for (std::size_t c = 0; c < a; ++c) {
      if (edges_cross(ring, a, c)) return true;
    }
  }
  return false;
}

/// The corners that are left of a ring, to find those in a triangle: halved by place along the longer side of their box, and so
/// on.
class CornerTree {
 public:
  explicit CornerTree(const ProjectedRing& ring) : ring_(ring), corners_(ring.size()), leaf_of_(ring.size()) {
    std::iota(corners_.begin(), corners_.end(), std::size_t{0});
    while ((ring.size() >> depth_) > kCornersPerLeaf) ++depth_;
    nodes_.resize((std::size_t{2} << depth_) - 1);
    build(0, 0, 0, ring.size());
  }

  void remove(std::size_t corner) {
    for (std::size_t node = leaf_of_[corner];; node = (node - 1) / 2) {
      --nodes_[node].left;
      if (node == 0) return;
    }
  }

  /// A corner in the triangle a b c or on its border that is `good`; else as many as there are corners.
  template <class Good>
  std::size_t find(std::size_t a, std::size_t b, std::size_t c, const Good& good) const {
    const double* const x[3] = {ring_.at(a), ring_.at(b), ring_.at(c)};
    Box box;
    for (const double* corner : x) box.add(corner, first(), second());
    return find(0, 0, corners_.size(), x, box, good);
  }

 private:
  static constexpr std::size_t kCornersPerLeaf = 8;

  struct Box {
    double low[2] = {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
    double high[2] = {-std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
    void add(const double* x, int first, int second) {
      low[0] = std::min(low[0], x[first]);
      high[0] = std::max(high[0], x[first]);
      low[1] = std::min(low[1], x[second]);
      high[1] = std::max(high[1], x[second]);
    }
    bool meets(const Box& other) const {
      return low[0] <= other.high[0] && other.low[0] <= high[0] && low[1] <= other.high[1] && other.low[1] <= high[1];
    }
  };
  struct Node {
    Box box;               // of what was there at first
    std::size_t left = 0;  // corners
  };

  int first() const { return (ring_.axis + 1) % 3; }
  int second() const { return (ring_.axis + 2) % 3; }
  bool is_leaf(std::size_t node) const { return 2 * node + 1 >= nodes_.size(); }

  void build(std::size_t node, std::size_t depth, std::size_t from, std::size_t to) {
    Node& here = nodes_[node];
    here.left = to - from;
    for (std::size_t i = from; i < to; ++i) here.box.add(ring_.at(corners_[i]), first(), second());
    if (depth == depth_) {
      for (std::size_t i = from; i < to; ++i) leaf_of_[corners_[i]] = node;
      return;
    }
    const bool wide = here.box.high[0] - here.box.low[0] >= here.box.high[1] - here.box.low[1];
    const int along = wide ? first() : second();
    const std::size_t middle = from + (to - from) / 2;
    const auto place = [this](std::size_t i) { return corners_.begin() + static_cast<std::ptrdiff_t>(i); };
    std::nth_element(place(from), place(middle), place(to), [&](std::size_t a, std::size_t b) {
      const double x = ring_.at(a)[along], y = ring_.at(b)[along];
      return x < y || (x == y && a < b);
    });
    build(2 * node + 1, depth + 1, from, middle);
    build(2 * node + 2, depth + 1, middle, to);
  }

  /// Is all of the box on the outer side of an edge of the triangle? Its corner farthest inwards is.
  bool is_beside(const Box& box, const double* const x[3]) const {
    for (int k = 0; k < 3; ++k) {
      const double *from = x[k], *to = x[(k + 1) % 3];
      double inmost[3] = {0, 0, 0};
      const bool up = (to[first()] > from[first()]) == (ring_.sense > 0);
      const bool right = (to[second()] < from[second()]) == (ring_.sense > 0);
      inmost[first()] = right ? box.high[0] : box.low[0];
      inmost[second()] = up ? box.high[1] : box.low[1];
      if (ring_.turn(from, to, inmost) < 0) return true;
    }
    return false;
  }

  template <class Good>
  std::size_t find(std::size_t node, std::size_t from, std::size_t to, const double* const x[3], const Box& box,
                   const Good& good) const {
    const Node& here = nodes_[node];
    if (here.left == 0 || !here.box.meets(box)) return corners_.size();
    if (is_leaf(node)) {
      for (std::size_t i = from; i < to; ++i) {
        if (good(corners_[i])) return corners_[i];
      }
      return corners_.size();
    }
    if (is_beside(here.box, x)) return corners_.size();
    const std::size_t middle = from + (to - from) / 2;
    const std::size_t found = find(2 * node + 1, from, middle, x, box, good);
    return found < corners_.size() ? found : find(2 * node + 2, middle, to, x, box, good);
  }

  const ProjectedRing& ring_;
  std::vector<std::size_t> corners_;  // leaf by leaf
  std::vector<std::size_t> leaf_of_;  // by corner
  std::vector<Node> nodes_;           // the children of i are 2 i + 1 and 2 i + 2
  std::size_t depth_ = 0;             // of the leaves
};

/// Which corner of a ring is to be tried next, and which wait until another is gone.
class EarQueue {
 public:
  explicit EarQueue(std::size_t n) : blocker_(n, n), waiters_(n) {
    for (std::size_t k = 0; k < n; ++k) open_.insert(open_.end(), k);
  }

  bool empty() const { return open_.empty(); }
  /// The first corner to be tried at `from` or behind it, around the ring.
  std::size_t take(std::size_t from) {
    auto next = open_.lower_bound(from);
    if (next == open_.end()) next = open_.begin();
    const std::size_t corner = *next;
    open_.erase(next);
    return corner;
  }
  void retry(std::size_t corner) { open_.insert(corner); }
  /// What kept the corner from being an ear when it was last tried; the number of corners: nothing.
  std::size_t blocker_of(std::size_t corner) const { return blocker_[corner]; }
  void wait(std::size_t corner, std::size_t blocker) {
    blocker_[corner] = blocker;
    waiters_[blocker].push_back(corner);
  }
  void gone(std::size_t corner) {
    open_.erase(corner);
    const std::vector<std::size_t> waiters = std::move(waiters_[corner]);
    waiters_[corner] = {};
    for (const std::size_t waiter : waiters) {
      if (blocker_[waiter] != corner) continue;
      blocker_[waiter] = blocker_.size();
      open_.insert(waiter);
    }
    blocker_[corner] = blocker_.size();
  }

 private:
  std::set<std::size_t> open_;
  std::vector<std::size_t> blocker_;               // by corner
  std::vector<std::vector<std::size_t>> waiters_;  // by blocker
};

}  // namespace

int ProjectedRing::turn(const double* a, const double* b, const double* c) const { return sense * orient2d(a, b, c, axis); }

bool ProjectedRing::same_place(std::size_t a, std::size_t b) const {
  return corners[a] == corners[b] || std::equal(at(a), at(a) + 3, at(b));
}

// All triangles turn the right way, and together less than once around the first corner: after a corner on the right of the
// first edge, none is on its left again.
bool PolygonCutter::fan_tiles() const {
  bool on_right = false;
  for (std::size_t k = 2; k < ring_.size(); ++k) {
    if (ring_.turn(0, k - 1, k) <= 0) return false;
    const int side = ring_.turn(0, 1, k);
    if (on_right && side >= 0) return false;
    on_right = on_right || side < 0;
  }
  return true;
}

// Corners are tried in turn, around the ring. One that is no ear is tried again only when a neighbour of it, or the corner that
// was found in its triangle, is gone: until then it stays none.
bool PolygonCutter::clip_ears(std::vector<Index>& triangles) {
  const std::size_t n = ring_.size();
  std::size_t left = n;
  next_.resize(n);
  before_.resize(n);
  for (std::size_t k = 0; k < n; ++k) {
    next_[k] = ring_.after(k);
    before_[k] = k == 0 ? n - 1 : k - 1;
  }
  const bool many = n >= kManyCorners;
  std::optional<CornerTree> tree;
  if (many) tree.emplace(ring_);
  EarQueue queue(n);
  const auto unlink = [&](std::size_t k) {
    next_[before_[k]] = next_[k];
    before_[next_[k]] = before_[k];
    next_[k] = before_[k] = n;  // no more in the ring
    --left;
    if (many) tree->remove(k);
    queue.gone(k);
  };
  // Is corner k in the triangle of three others in a row, so that it is no ear? On its border too, but for copies of its
  // corners: bridges and polygons that touch themselves have those.
  const auto blocks = [&](std::size_t k, std::size_t a, std::size_t b, std::size_t c) {
    if (next_[k] == n || ring_.turn(a, b, k) < 0 || ring_.turn(b, c, k) < 0 || ring_.turn(c, a, k) < 0) return false;
    return !ring_.same_place(k, a) && !ring_.same_place(k, b) && !ring_.same_place(k, c);
  };
  const auto blocker = [&](std::size_t a, std::size_t b, std::size_t c) {
    if (many) return tree->find(a, b, c, [&](std::size_t k) { return blocks(k, a, b, c); });
    std::size_t k = next_[c];
    while (k != a && !blocks(k, a, b, c)) k = next_[k];
    return k != a ? k : n;
  };
  std::size_t at_corner = 0;
  for (std::size_t tried = 0; left > 2; ++tried) {
    if (queue.empty()) return false;
    look_at_ring(execution_, tried);
    const std::size_t b = queue.take(at_corner), a = before_[b], c = next_[b];
    if (ring_.same_place(a, c)) {  // there and back again, as along a bridge whose hole is filled
      unlink(b);
      unlink(c);
      queue.retry(a);
      queue.retry(next_[a]);
      at_corner = a;
      continue;
    }
    at_corner = c;
    if (ring_.turn(a, b, c) <= 0) continue;
    const std::size_t known = queue.blocker_of(b);
    if (known != n && blocks(known, a, b, c)) continue;  // it waits already
    const std::size_t found = blocker(a, b, c);
    if (found != n) {
      queue.wait(b, found);
      continue;
    }
    add(a, b, c, triangles);
    unlink(b);
    queue.retry(a);
    queue.retry(c);
    at_corner = next_[c];  // not c, which would make a fan
  }
  return true;
}

bool PolygonCutter::cut(const Index* corners, std::size_t n, std::vector<Index>& triangles) {
  const auto fan = [&] {
    for (std::size_t k = 2; k < n; ++k) triangles.insert(triangles.end(), {corners[0], corners[k - 1], corners[k]});
  };
  if (n == 3) {
    fan();
    return true;
  }
  ring_.corners.clear();
  for (std::size_t k = 0; k < n; ++k) {
    ring_.corners.push_back(corners[k]);
    if (ring_.size() > 1 && ring_.same_place(ring_.size() - 1, ring_.size() - 2)) ring_.corners.pop_back();
  }
  while (ring_.size() > 1 && ring_.same_place(0, ring_.size() - 1)) ring_.corners.pop_back();
  const std::size_t size = ring_.size();
  const auto flat = [&] {
    for (std::size_t k = 2; k < size; ++k) {
      if (!collinear(ring_.at(0), ring_.at(1), ring_.at(k))) return false;
    }
    return true;
  };
  if (size < 3 || flat()) {
    fan();
    return true;
  }
  const Vec3 normal = newell_normal(ring_);
  int axes[3] = {0, 1, 2};
  std::stable_sort(axes, axes + 3, [&](int a, int b) { return std::abs(normal[a]) > std::abs(normal[b]); });
  ring_.axis = axes[0];
  ring_.sense = normal[ring_.axis] < 0 ? -1 : 1;
  if (size == 3) {
    add(0, 1, 2, triangles);
    return true;
  }
  if (size == 4) {
    const bool first = ring_.turn(0, 1, 2) > 0 && ring_.turn(0, 2, 3) > 0,
               second = ring_.turn(1, 2, 3) > 0 && ring_.turn(1, 3, 0) > 0;
    const bool better =
        first && second &&
        cotangent_at(ring_.at(0), ring_.at(1), ring_.at(2)) + cotangent_at(ring_.at(2), ring_.at(3), ring_.at(0)) <
            -kDiagonalSlack;
    if (first && !better) {
      add(0, 1, 2, triangles);
      add(0, 2, 3, triangles);
      return true;
    }
    if (second) {
      add(0, 1, 3, triangles);
      add(1, 2, 3, triangles);
      return true;
    }
  } else if (fan_tiles()) {
    for (std::size_t k = 2; k < size; ++k) add(0, k - 1, k, triangles);
    return true;
  }
  const std::size_t before = triangles.size();
  if (!crosses_itself(ring_, execution_) && clip_ears(triangles)) return true;
  triangles.resize(before);
  fan();
  return false;
}

}  // namespace amps::detail
