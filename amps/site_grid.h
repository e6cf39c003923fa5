// site_grid.h (internal): sites by place, in cubes of one size: which sites are near a point, while sites come and go. For the
// few facets of a diagram that too many disks reach to look at all of them (power_diagram.h).
#pragma once

#include "amps/base.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <unordered_map>
#include <vector>

namespace amps::detail {

/// Sites with their positions. A value.
class SiteGrid {
 public:
  SiteGrid() = default;
  /// Cubes of this side, > 0.
  explicit SiteGrid(double side) : side_(side) {}

  bool empty() const { return side_ == 0; }
  double side() const { return side_; }

  void insert(const Vec3& x, Index site) { sites_[key(cube_of(x))].push_back(site); }
  void remove(const Vec3& x, Index site) {
    std::vector<Index>& sites = sites_[key(cube_of(x))];
    for (Index& entry : sites) {
      if (entry != site) continue;
      entry = sites.back();
      sites.pop_back();
      return;
    }
  }

  /// Calls visit(site) for the sites in the cubes that lie up to `rings` cubes from that of x, but not for those up to
  /// `before` cubes from it (−1: for all of them). In an order that depends on the history of edits.
  template <class Visit>
  void visit_rings(const Vec3& x, std::int64_t before, std::int64_t rings, const Visit& visit) const {
    const Cube centre = cube_of(x);
    for (std::int64_t i = -rings; i <= rings; ++i) {
      for (std::int64_t j = -rings; j <= rings; ++j) {
        for (std::int64_t k = -rings; k <= rings; ++k) {
          if (std::max({std::abs(i), std::abs(j), std::abs(k)}) <= before) continue;
          const auto found = sites_.find(key({centre[0] + i, centre[1] + j, centre[2] + k}));
          if (found == sites_.end()) continue;
          for (const Index site : found->second) visit(site);
        }
      }
    }
  }

 private:
  using Cube = std::array<std::int64_t, 3>;
  Cube cube_of(const Vec3& x) const {
    // Far points share the outermost cubes: they cost time only.
    const double kFarthest = 0x1p40;
    const auto along = [this, kFarthest](double c) {
      return static_cast<std::int64_t>(std::floor(std::min(std::max(c / side_, -kFarthest), kFarthest)));
    };
    return {along(x[0]), along(x[1]), along(x[2])};
  }
  static std::uint64_t key(const Cube& c) {
    constexpr std::uint64_t kMask = (std::uint64_t{1} << 21) - 1;  // cubes 2^21 apart share a place: they cost time only
    return (static_cast<std::uint64_t>(c[0]) & kMask) << 42 | (static_cast<std::uint64_t>(c[1]) & kMask) << 21 |
           (static_cast<std::uint64_t>(c[2]) & kMask);
  }

  double side_ = 0;
  std::unordered_map<std::uint64_t, std::vector<Index>> sites_;
};

}  // namespace amps::detail
