// cap_field.h (internal): bounds of radii around points where they had to be small: r(x) ≤ min over i of (r_i + L·|x − x_i|).
#pragma once

#include "amps/base.h"

#include <cstddef>
#include <vector>

namespace amps::detail {

/// A point and the radius that is wanted there at most.
struct RadiusCap {
  Vec3 position = Vec3::Zero();
  double radius = 0;
};

/// The bound that caps put on radii, at any point of space. Const once it is made; thread-safe.
class CapField {
 public:
  /// `slope`: L ≥ 0. O(n log n).
  CapField(std::vector<RadiusCap> caps, double slope);

  bool empty() const { return caps_.empty(); }
  const std::vector<RadiusCap>& caps() const { return caps_; }
  double slope() const { return slope_; }

  /// The bound at x, or `wanted` if that is less. O(log n) where caps are as dense as their slope lets them count.
  double at(const Vec3& x, double wanted) const;

 private:
  /// A box around caps_[begin, end), halved along its longest side in two children, the next node and `second`.
  struct Node {
    Vec3 low, high;
    double min_radius;
    std::size_t begin, end, second;
  };
  static constexpr std::size_t kLeafSize = 4;

  void build(std::size_t begin, std::size_t end);
  void search(std::size_t node, const Vec3& x, double& bound) const;
  double bound_of(const Node& node, const Vec3& x) const;

  std::vector<RadiusCap> caps_;
  double slope_;
  std::vector<Node> nodes_;  ///< a parent before its children
};

}  // namespace amps::detail
