// random.h: draws that many tests make.
#pragma once

#include "basics.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

namespace amps_test {

inline Index below(Rng& rng, Index n) { return static_cast<Index>(rng.below(static_cast<std::uint64_t>(n))); }

inline double between(Rng& rng, double low, double high) { return low + (high - low) * rng.uniform(); }

/// Of the unit cube.
inline Vec3 random_point(Rng& rng) { return {rng.uniform(), rng.uniform(), rng.uniform()}; }

/// Uniform on the unit sphere.
inline Vec3 on_unit_sphere(Rng& rng) {
  const double z = 2 * rng.uniform() - 1, a = 2 * kPi * rng.uniform(), s = std::sqrt(1 - z * z);
  return {s * std::cos(a), s * std::sin(a), z};
}

/// Uniform points of a surface.
class SurfaceDraw {
 public:
  explicit SurfaceDraw(const MeshView& mesh) : mesh_(mesh), area_up_to_(amps::facet_areas(mesh)) {
    std::partial_sum(area_up_to_.begin(), area_up_to_.end(), area_up_to_.begin());
  }

  amps::SurfacePoint operator()(Rng& rng) const {
    const auto found = std::upper_bound(area_up_to_.begin(), area_up_to_.end(), rng.uniform() * area_up_to_.back());
    const auto facet = static_cast<Index>(std::min<std::ptrdiff_t>(found - area_up_to_.begin(), mesh_.num_facets() - 1));
    amps::SurfacePoint point{facet, amps::uniform_barycentric(rng), Vec3::Zero()};
    for (int k = 0; k < 3; ++k) point.position += point.barycentric[k] * mesh_.corner(facet, k);
    return point;
  }

 private:
  MeshView mesh_;
  std::vector<double> area_up_to_;
};

template <class T>
std::vector<T> shuffled(std::vector<T> list, Rng& rng) {
  for (std::size_t k = list.size(); k > 1; --k) std::swap(list[k - 1], list[rng.below(k)]);
  return list;
}

/// 0, …, n − 1.
inline std::vector<Index> all_indices(Index n) {
  std::vector<Index> list;
  for (Index i = 0; i < n; ++i) list.push_back(i);
  return list;
}

}  // namespace amps_test
