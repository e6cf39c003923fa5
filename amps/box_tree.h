// box_tree.h (internal): a few thousand points or segments in space, found by distance: what is near a place, where each item
// may count as farther off than it is by a value of its own.
#pragma once

#include "amps/base.h"

#include <utility>
#include <vector>

namespace amps::detail {

/// An axis-parallel box around an item, and what is added to distances from it; ≥ 0.
struct BoxItem {
  Vec3 min, max;
  double value = 0;
};

/// Items, halved again and again across the longest extent of their centres. A value.
class BoxTree {
 public:
  BoxTree() = default;
  /// O(n log n); 72 bytes a node, of which there is one for two items.
  explicit BoxTree(const std::vector<BoxItem>& items);

  bool empty() const { return nodes_.empty(); }

  /// visit(item, bound) for the items that may have value + slope·distance(x, box) < bound, about the nearest first. `visit`
  /// may lower the bound. O(log n + items) expected.
  template <class Visit>
  void search(const Vec3& x, double slope, double bound, const Visit& visit) const {
    if (!nodes_.empty()) search(0, x, slope, bound, visit);
  }

 private:
  struct Node {
    Vec3 min, max;
    double value;                ///< the least of its items
    Index begin, end;            ///< its items, in order_
    Index second_child = kNone;  ///< the first one follows; kNone: a leaf
  };
  static double least(const Node& node, const Vec3& x, double slope) {
    return node.value + slope * norm(x - x.cwiseMax(node.min).cwiseMin(node.max));
  }

  template <class Visit>
  void search(Index n, const Vec3& x, double slope, double& bound, const Visit& visit) const {
    const Node& node = nodes_[slot(n)];
    if (node.second_child == kNone) {
      for (Index i = node.begin; i < node.end; ++i) visit(order_[slot(i)], bound);
      return;
    }
    Index near = n + 1, far = node.second_child;
    double of_near = least(nodes_[slot(near)], x, slope), of_far = least(nodes_[slot(far)], x, slope);
    if (of_far < of_near) {
      std::swap(near, far);
      std::swap(of_near, of_far);
    }
    if (of_near < bound) search(near, x, slope, bound, visit);
    if (of_far < bound) search(far, x, slope, bound, visit);
  }

  void split(const std::vector<BoxItem>& items, Index begin, Index end);

  std::vector<Node> nodes_;
  std::vector<Index> order_;
};

}  // namespace amps::detail
