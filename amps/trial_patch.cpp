#define AMPS_OWN_SOURCE
#include "amps/trial_patch.h"

#include "amps/exact.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace amps::detail {
namespace {

/// Orthocentre of three weighted points in their plane: the point of equal power.
struct DualPoint {
  Vec3 position;
  double power;  ///< −∞ for points on a line, which have none: no sample is in conflict with them, and they have no gap
};
DualPoint dual_point(const Vec3& a, double wa, const Vec3& b, double wb, const Vec3& c, double wc) {
  const Vec3 u = b - a, v = c - a, n = u.cross(v);
  const double nn = detail::squared_norm(n);
  if (nn == 0) return {a, -kInfinity};
  const double bu = detail::squared_norm(u) - wb + wa, bv = detail::squared_norm(v) - wc + wa;
  const Vec3 dual = a + (bu * v.cross(n) + bv * n.cross(u)) / (2 * nn);
  return {dual, detail::squared_norm(dual - a) - wa};
}

/// A dual point above the surface may be uncovered where the surface is not: so much of the weight is allowed, and the diagram
/// decides.
constexpr double kGapDepth = 0.01;

inline int count_bits(std::uint64_t x) {
  int n = 0;
  for (; x != 0; x &= x - 1) ++n;
  return n;
}

inline std::uint64_t bit(int v) { return std::uint64_t{1} << v; }

}  // namespace

TrialPatch& TrialPatch::operator=(const TrialPatch& other) {
  rating_ = other.rating_;
  num_vertices_ = other.num_vertices_;
  num_triangles_ = other.num_triangles_;
  const auto v = static_cast<std::size_t>(num_vertices_), t = static_cast<std::size_t>(num_triangles_);
  std::copy_n(other.position_.begin(), v, position_.begin());
  std::copy_n(other.weight_.begin(), v, weight_.begin());
  std::copy_n(other.neighbors_.begin(), v, neighbors_.begin());
  std::copy_n(other.rated_.begin(), v, rated_.begin());
  std::copy_n(other.border_.begin(), v, border_.begin());
  std::copy_n(other.triangles_.begin(), t, triangles_.begin());
  return *this;
}

bool TrialPatch::add_vertex(const Vec3& x, double weight, int neighbors, bool rated) {
  if (num_vertices_ == kMaxVertices) return false;
  const auto v = static_cast<std::size_t>(num_vertices_++);
  position_[v] = x;
  weight_[v] = weight;
  neighbors_[v] = static_cast<std::int16_t>(neighbors);
  rated_[v] = rated;
  border_[v] = 0;
  return true;
}

bool TrialPatch::add_triangle(int a, int b, int c) {
  if (num_triangles_ == kMaxTriangles) return false;
  append(a, b, c);
  Triangle& triangle = triangles_[static_cast<std::size_t>(num_triangles_ - 1)];
  triangle.rating = rate(triangle);                                         // once for all trials
  for (const int v : {a, b, c}) --neighbors_[static_cast<std::size_t>(v)];  // the caller has counted it
  return true;
}

void TrialPatch::close() {
  for (int v = 0; v < num_vertices_; ++v) border_[static_cast<std::size_t>(v)] = 0;
  for (int t = 0; t < num_triangles_; ++t) {
    const auto& corner = triangles_[static_cast<std::size_t>(t)].corner;
    for (std::size_t k = 0; k < 3; ++k) {
      const int u = corner[k], v = corner[(k + 1) % 3];
      border_[static_cast<std::size_t>(u)] ^= bit(v);
      border_[static_cast<std::size_t>(v)] ^= bit(u);
    }
  }
}

/// One triangle more; its corners have one neighbour more, as on any disk or half disk.
void TrialPatch::append(int a, int b, int c) {
  Triangle& t = triangles_[static_cast<std::size_t>(num_triangles_++)];
  const auto ia = static_cast<std::size_t>(a), ib = static_cast<std::size_t>(b), ic = static_cast<std::size_t>(c);
  t.corner = {static_cast<std::uint8_t>(a), static_cast<std::uint8_t>(b), static_cast<std::uint8_t>(c)};
  const DualPoint dual = dual_point(position_[ia], weight_[ia], position_[ib], weight_[ib], position_[ic], weight_[ic]);
  t.dual = dual.position;
  t.power = dual.power;
  t.rating = kNotRated;
  for (const std::size_t v : {ia, ib, ic}) ++neighbors_[v];
}

void TrialPatch::drop(int t) {
  for (const std::uint8_t v : triangles_[static_cast<std::size_t>(t)].corner) --neighbors_[v];
  triangles_[static_cast<std::size_t>(t)] = triangles_[static_cast<std::size_t>(--num_triangles_)];
}

bool TrialPatch::remove(int v) {
  // Its triangles, as the edges opposite of it.
  std::array<std::array<std::uint8_t, 2>, kMaxRing> edges;
  int size = 0;
  for (int t = 0; t < num_triangles_;) {
    const auto& c = triangles_[static_cast<std::size_t>(t)].corner;
    const int at = c[0] == v ? 0 : c[1] == v ? 1 : c[2] == v ? 2 : 3;
    if (at == 3) {
      ++t;
      continue;
    }
    if (size == kMaxRing) return false;
    edges[static_cast<std::size_t>(size++)] = {c[static_cast<std::size_t>((at + 1) % 3)],
                                               c[static_cast<std::size_t>((at + 2) % 3)]};
    drop(t);
  }
  rated_[static_cast<std::size_t>(v)] = false;
  std::array<std::uint8_t, kMaxRing> ring;
  if (size < 3) return false;
  ring[0] = edges[0][0];
  ring[1] = edges[0][1];
  for (int k = 1; k + 1 < size; ++k) {
    int next = k;
    while (next < size && edges[static_cast<std::size_t>(next)][0] != ring[static_cast<std::size_t>(k)] &&
           edges[static_cast<std::size_t>(next)][1] != ring[static_cast<std::size_t>(k)]) {
      ++next;
    }
    if (next == size) return false;
    std::swap(edges[static_cast<std::size_t>(k)], edges[static_cast<std::size_t>(next)]);
    const auto& edge = edges[static_cast<std::size_t>(k)];
    ring[static_cast<std::size_t>(k + 1)] = edge[0] == ring[static_cast<std::size_t>(k)] ? edge[1] : edge[0];
  }
  const auto& last = edges[static_cast<std::size_t>(size - 1)];
  const std::uint8_t end = ring[static_cast<std::size_t>(size - 1)];
  if (!(last[0] == end && last[1] == ring[0]) && !(last[1] == end && last[0] == ring[0])) return false;
  return fill(ring.data(), size);
}

/// Cuts off ears: always one that is convex, seen along the normal of the whole, and whose dual point is nearest to its own
/// corners, or nearly.
bool TrialPatch::fill(const std::uint8_t* ring, int size) {
  std::array<std::uint8_t, kMaxRing> left;
  std::copy_n(ring, size, left.begin());
  Vec3 normal = Vec3::Zero();
  for (int k = 2; k < size; ++k) {
    normal += (position_[ring[k - 1]] - position_[ring[0]]).cross(position_[ring[k]] - position_[ring[0]]);
  }
  for (; size > 3; --size) {
    int best = -1;
    double best_margin = -std::numeric_limits<double>::infinity();
    for (int k = 0; k < size && best_margin < 0; ++k) {
      const auto at = [&](int i) { return left[static_cast<std::size_t>((k + i + size) % size)]; };
      const Vec3 &a = position_[at(-1)], &b = position_[at(0)], &c = position_[at(1)];
      if (!(detail::dot((b - a).cross(c - b), normal) > 0)) continue;
      const DualPoint dual = dual_point(a, weight_[at(-1)], b, weight_[at(0)], c, weight_[at(1)]);
      double margin = std::numeric_limits<double>::infinity();
      for (int i = 2; i + 1 < size; ++i) {
        margin = std::min(margin, detail::squared_norm(dual.position - position_[at(i)]) - weight_[at(i)] - dual.power);
      }
      if (margin > best_margin) {
        best_margin = margin;
        best = k;
      }
    }
    if (best < 0) return false;
    const auto at = [&](int i) { return left[static_cast<std::size_t>((best + i + size) % size)]; };
    append(at(-1), at(0), at(1));
    std::copy(left.begin() + best + 1, left.begin() + size, left.begin() + best);
  }
  append(left[0], left[1], left[2]);
  return true;
}

bool TrialPatch::insert(const Vec3& x, double weight) {
  if (num_vertices_ == kMaxVertices) return false;
  std::array<std::uint64_t, kMaxVertices> rim;  // bit v of u: the edge uv belongs to one triangle that makes way
  std::uint64_t on_rim = 0;
  int gone = 0;
  for (int t = 0; t < num_triangles_;) {
    const Triangle& triangle = triangles_[static_cast<std::size_t>(t)];
    if (!(squared_norm(triangle.dual - x) - weight < triangle.power)) {
      ++t;
      continue;
    }
    ++gone;
    const auto corner = triangle.corner;
    for (const std::uint8_t v : corner) {
      if ((on_rim & bit(v)) == 0) rim[v] = 0;
      on_rim |= bit(v);
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const int u = corner[k], v = corner[(k + 1) % 3];
      rim[static_cast<std::size_t>(u)] ^= bit(v);
      rim[static_cast<std::size_t>(v)] ^= bit(u);
    }
    drop(t);
  }
  const int size = gone + 2;  // of a rim around a disk without vertices inside
  if (gone == 0 || num_triangles_ + size > kMaxTriangles || count_bits(on_rim) != size) return false;
  for (std::uint64_t rest = on_rim; rest != 0; rest &= rest - 1) {
    const auto v = static_cast<std::size_t>(count_trailing_zeros(rest));
    if (count_bits(rim[v]) != 2 || (rim[v] & border_[v]) != 0) return false;
  }
  const int added = num_vertices_;
  add_vertex(x, weight, 0, true);
  const int start = count_trailing_zeros(on_rim);
  int before = start, at = count_trailing_zeros(rim[static_cast<std::size_t>(start)]);
  for (int k = 1;; ++k) {
    append(before, at, added);
    const int next = count_trailing_zeros(rim[static_cast<std::size_t>(at)] & ~bit(before));
    before = at;
    at = next;
    if (before == start) return k == size;  // else there is more than one cycle
  }
}

double TrialPatch::rate(const Triangle& triangle) const {
  const auto& corner = triangle.corner;
  return rating_->triangle(position_[corner[0]], position_[corner[1]], position_[corner[2]]);
}

double TrialPatch::energy() const {
  double sum = 0;
  for (int t = 0; t < num_triangles_; ++t) {
    const Triangle& triangle = triangles_[static_cast<std::size_t>(t)];
    sum += triangle.rating == kNotRated ? rate(triangle) : triangle.rating;
  }
  for (int v = 0; v < num_vertices_; ++v) {
    if (rated_[static_cast<std::size_t>(v)]) sum += rating_->valence(neighbors_[static_cast<std::size_t>(v)], false);
  }
  return sum;
}

bool TrialPatch::has_gap() const {
  for (int t = 0; t < num_triangles_; ++t) {
    const Triangle& triangle = triangles_[static_cast<std::size_t>(t)];
    if (triangle.power > kGapDepth * weight_[triangle.corner[0]]) return true;
  }
  return false;
}

}  // namespace amps::detail
