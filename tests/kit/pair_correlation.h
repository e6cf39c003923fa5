// pair_correlation.h: how random a sample set is. The pair correlation g(d) is how many other samples there are at distance d
// of a sample, over how many there would be if they knew nothing of each other (a Poisson process of the same density: 1 at any
// d).
#pragma once

#include "points.h"

#include "amps/kdtree.h"

#include <cmath>
#include <cstddef>
#include <vector>

namespace amps_test {

/// g in `bins` bins of width `width`, the first from `first` on, over the pairs whose one point is `inner`. `density`: points
/// an area, around those. Within the distance d of a point there must be the area π·d²: true in the plane as far as d from its
/// border, and on all of a sphere, where d is measured in space.
inline std::vector<double> pair_correlation(const Points& points, const std::vector<char>& inner, double density, double first,
                                            double width, std::size_t bins) {
  const amps::KdTree tree(points);
  std::vector<double> g(bins, 0.0);
  std::vector<amps::KdTree::Neighbor> around;
  double centres = 0;
  for (Index i = 0; i < rows(points); ++i) {
    if (inner[at(i)] == 0) continue;
    ++centres;
    tree.in_radius(point_at(points, i), first + width * static_cast<double>(bins), around);
    for (const amps::KdTree::Neighbor& n : around) {
      const double d = std::sqrt(n.squared_distance);
      if (n.index == i || d < first) continue;
      const auto bin = static_cast<std::size_t>((d - first) / width);
      if (bin < bins) ++g[bin];
    }
  }
  for (std::size_t k = 0; k < bins; ++k) {
    const double from = first + width * static_cast<double>(k), to = from + width;
    g[k] /= centres * density * kPi * (to * to - from * from);
  }
  return g;
}

}  // namespace amps_test
