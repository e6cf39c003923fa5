#define AMPS_OWN_SOURCE
#include "amps/polygons.h"

#include "amps/predicates.h"

#include <algorithm>
#include <cmath>

namespace amps::detail {
namespace {

/// By how much the cotangents opposite to a diagonal may add up to less than 0 before the other one is taken: corners on a
/// circle, as those of rectangles in single precision, keep the first.
constexpr double kDiagonalSlack = 1e-4;

/// Newell's normal of a ring, up to a factor > 0: coordinates are divided by the extent, so that nothing overflows.
Vec3 newell_normal(const double* coordinates, const std::vector<Index>& ring) {
  const auto at = [&](std::size_t k) { return coordinates + 3 * slot(ring[k]); };
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

}  // namespace

int PolygonCutter::turn(std::size_t a, std::size_t b, std::size_t c) const {
  return sense_ * orient2d(at(a), at(b), at(c), axis_);
}

bool PolygonCutter::same_place(std::size_t a, std::size_t b) const {
  return ring_[a] == ring_[b] || std::equal(at(a), at(a) + 3, at(b));
}

// All triangles turn the right way, and together less than once around the first corner: after a corner on the right of the
// first edge, none is on its left again.
bool PolygonCutter::fan_tiles() const {
  bool on_right = false;
  for (std::size_t k = 2; k < ring_.size(); ++k) {
    if (turn(0, k - 1, k) <= 0) return false;
    const int side = turn(0, 1, k);
    if (on_right && side >= 0) return false;
    on_right = on_right || side < 0;
  }
  return true;
}

// Do two edges cross in a point inside both? Edges sorted by where they begin along one coordinate.
bool PolygonCutter::crosses() const {
  const std::size_t n = ring_.size();
  const int along = (axis_ + 1) % 3;
  const auto end = [n](std::size_t k) { return k + 1 == n ? 0 : k + 1; };
  const auto low = [&](std::size_t k) { return std::min(at(k)[along], at(end(k))[along]); };
  const auto high = [&](std::size_t k) { return std::max(at(k)[along], at(end(k))[along]); };
  std::vector<std::size_t> edges(n);
  for (std::size_t k = 0; k < n; ++k) edges[k] = k;
  std::sort(edges.begin(), edges.end(), [&](std::size_t a, std::size_t b) { return low(a) < low(b); });
  for (std::size_t i = 0; i < n; ++i) {
    execution_.check();
    const std::size_t a = edges[i], b = end(a);
    for (std::size_t j = i + 1; j < n && low(edges[j]) <= high(a); ++j) {
      const std::size_t c = edges[j], d = end(c);
      if (turn(a, b, c) * turn(a, b, d) < 0 && turn(c, d, a) * turn(c, d, b) < 0) return true;
    }
  }
  return false;
}

// Is the triangle a b c, of three corners in a row, inside the polygon? No other corner may be in it or on its border, but for
// copies of its own: bridges and polygons that touch themselves have those.
bool PolygonCutter::is_ear(std::size_t a, std::size_t b, std::size_t c) const {
  if (turn(a, b, c) <= 0) return false;
  for (std::size_t k = next_[c]; k != a; k = next_[k]) {
    if (turn(a, b, k) < 0 || turn(b, c, k) < 0 || turn(c, a, k) < 0) continue;
    if (same_place(k, a) || same_place(k, b) || same_place(k, c)) continue;
    return false;
  }
  return true;
}

bool PolygonCutter::clip_ears(std::vector<Index>& triangles) {
  std::size_t left = ring_.size();
  next_.resize(left);
  before_.resize(left);
  for (std::size_t k = 0; k < left; ++k) {
    next_[k] = k + 1 == left ? 0 : k + 1;
    before_[k] = k == 0 ? left - 1 : k - 1;
  }
  const auto unlink = [&](std::size_t k) {
    next_[before_[k]] = next_[k];
    before_[next_[k]] = before_[k];
    --left;
  };
  std::size_t at_corner = 0, since_clipped = 0;
  while (left > 2) {
    execution_.check();
    const std::size_t a = before_[at_corner], b = at_corner, c = next_[at_corner];
    if (same_place(a, c)) {  // there and back again, as along a bridge whose hole is filled
      unlink(b);
      unlink(c);
      at_corner = a;
      since_clipped = 0;
    } else if (is_ear(a, b, c)) {
      add(a, b, c, triangles);
      unlink(b);
      at_corner = next_[c];  // not c, which would make a fan
      since_clipped = 0;
    } else {
      at_corner = c;
      if (++since_clipped > left) return false;
    }
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
  ring_.clear();
  for (std::size_t k = 0; k < n; ++k) {
    ring_.push_back(corners[k]);
    if (ring_.size() > 1 && same_place(ring_.size() - 1, ring_.size() - 2)) ring_.pop_back();
  }
  while (ring_.size() > 1 && same_place(0, ring_.size() - 1)) ring_.pop_back();
  const std::size_t size = ring_.size();
  const auto flat = [&] {
    for (std::size_t k = 2; k < size; ++k) {
      if (!collinear(at(0), at(1), at(k))) return false;
    }
    return true;
  };
  if (size < 3 || flat()) {
    fan();
    return true;
  }
  const Vec3 normal = newell_normal(coordinates_, ring_);
  int axes[3] = {0, 1, 2};
  std::stable_sort(axes, axes + 3, [&](int a, int b) { return std::abs(normal[a]) > std::abs(normal[b]); });
  axis_ = axes[0];
  sense_ = normal[axis_] < 0 ? -1 : 1;
  if (size == 3) {
    add(0, 1, 2, triangles);
    return true;
  }
  if (size == 4) {
    const bool first = turn(0, 1, 2) > 0 && turn(0, 2, 3) > 0, second = turn(1, 2, 3) > 0 && turn(1, 3, 0) > 0;
    const bool better =
        first && second && cotangent_at(at(0), at(1), at(2)) + cotangent_at(at(2), at(3), at(0)) < -kDiagonalSlack;
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
  if (!crosses() && clip_ears(triangles)) return true;
  triangles.resize(before);
  fan();
  return false;
}

}  // namespace amps::detail
