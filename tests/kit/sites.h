// sites.h: weighted points: one by one, as lists, in the arrays that calls take; drawn at random, from lattices and on spheres.
#pragma once

#include "points.h"
#include "random.h"

#include "amps/predicates.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

using amps::WeightedPoint;
using WeightedPoints = std::vector<WeightedPoint>;

struct Sites {
  Points positions;
  Values weights;
  Index size() const { return rows(positions); }
  Vec3 at(Index s) const { return point_at(positions, s); }
  WeightedPoint point(Index s) const { return {positions(s, 0), positions(s, 1), positions(s, 2), weights[s]}; }
};

struct NamedSites : Sites {
  std::string name;
  NamedSites(std::string its_name, Sites sites) : Sites(std::move(sites)), name(std::move(its_name)) {}
};

inline Points positions_of(const WeightedPoints& list) {
  return made_points(static_cast<Index>(list.size()), [&](Index s) { return list[at(s)].position(); });
}

inline Values weights_of(const WeightedPoints& list) {
  return made_values(static_cast<Index>(list.size()), [&](Index s) { return list[at(s)].w; });
}

inline Sites sites_of(const WeightedPoints& list) { return {positions_of(list), weights_of(list)}; }

/// With one weight.
inline Sites sites_of(const Points& positions, double weight = 0) {
  return {positions, constant_values(rows(positions), weight)};
}

inline Sites sites_of(const std::vector<Vec3>& positions) { return sites_of(points_of(positions)); }

inline Sites head(const Sites& sites, Index n) { return {head(sites.positions, n), head(sites.weights, n)}; }
inline Sites tail(const Sites& sites, Index n) { return {tail(sites.positions, n), tail(sites.weights, n)}; }

inline Sites chosen(const Sites& sites, const std::vector<Index>& rows) {
  return {chosen(sites.positions, rows), chosen(sites.weights, rows)};
}

inline Sites joined(const Sites& a, const Sites& b) { return {joined(a.positions, b.positions), joined(a.weights, b.weights)}; }

/// Positions times `factor`, weights times its square.
inline Sites scaled(const Sites& sites, double factor) {
  return {scaled(sites.positions, factor), scaled(scaled(sites.weights, factor), factor)};
}

// One at a time.

/// In the unit cube, weight in [0, weight_range).
inline WeightedPoint in_cube(Rng& rng, double weight_range) {
  const double x = rng.uniform(), y = rng.uniform(), z = rng.uniform();
  return {x, y, z, weight_range * rng.uniform()};
}

/// Integers below `side`, the weight below `weights`.
inline WeightedPoint on_lattice(Rng& rng, Index side, Index weights) {
  const Index x = below(rng, side), y = below(rng, side), z = below(rng, side);
  return {double(x), double(y), double(z), double(below(rng, weights))};
}

inline WeightedPoint on_sphere(Rng& rng) {
  const Vec3 x = on_unit_sphere(rng);
  return {x.x(), x.y(), x.z(), 0};
}

// Lists.

template <class Draw>
WeightedPoints drawn(Index n, const Draw& draw) {
  WeightedPoints result;
  for (Index k = 0; k < n; ++k) result.push_back(draw());
  return result;
}

/// All integer points p with low ≤ p < high that `keep` wants, without weight.
template <class Keep>
WeightedPoints integer_points(int low, int high, const Keep& keep) {
  WeightedPoints result;
  for (int x = low; x < high; ++x) {
    for (int y = low; y < high; ++y) {
      for (int z = low; z < high; ++z) {
        if (keep(x, y, z)) result.push_back({double(x), double(y), double(z), 0});
      }
    }
  }
  return result;
}

/// Integer points on the sphere |p|² = n: exactly cospherical.
inline WeightedPoints integer_sphere(int n) {
  const int m = static_cast<int>(std::sqrt(n));
  return integer_points(-m, m + 1, [n](int x, int y, int z) { return x * x + y * y + z * z == n; });
}

/// Uniform points of the surface, and a few within `lift` of it, with weights in [0, max_weight).
inline Sites random_sites(const Mesh& mesh, Index n, double max_weight, std::uint64_t seed, double lift = 0) {
  Rng rng(seed);
  const SurfaceDraw surface(mesh);
  WeightedPoints sites;
  for (Index s = 0; s < n; ++s) {
    Vec3 x = surface(rng).position;
    for (int k = 0; k < 3; ++k) x[k] += lift * (rng.uniform() - 0.5);
    sites.push_back({x.x(), x.y(), x.z(), max_weight * rng.uniform()});
  }
  return sites_of(sites);
}

}  // namespace amps_test
