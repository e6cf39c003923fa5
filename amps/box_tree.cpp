#define AMPS_OWN_SOURCE
#include "amps/box_tree.h"

#include <algorithm>
#include <numeric>

namespace amps::detail {

namespace {

/// Items of a leaf: to look at them takes about as long as to go down two levels.
constexpr Index kItemsPerLeaf = 4;

}  // namespace

BoxTree::BoxTree(const std::vector<BoxItem>& items) : order_(items.size()) {
  std::iota(order_.begin(), order_.end(), Index{0});
  if (!items.empty()) split(items, 0, static_cast<Index>(items.size()));
}

/// Appends the node of these items and all below it.
void BoxTree::split(const std::vector<BoxItem>& items, Index begin, Index end) {
  Node node;
  node.begin = begin;
  node.end = end;
  const BoxItem& first = items[slot(order_[slot(begin)])];
  node.min = first.min;
  node.max = first.max;
  node.value = first.value;
  Vec3 low = first.min + first.max, high = low;  // of twice the centres
  for (Index i = begin + 1; i < end; ++i) {
    const BoxItem& item = items[slot(order_[slot(i)])];
    node.min = node.min.cwiseMin(item.min);
    node.max = node.max.cwiseMax(item.max);
    node.value = std::min(node.value, item.value);
    low = low.cwiseMin(item.min + item.max);
    high = high.cwiseMax(item.min + item.max);
  }
  const std::size_t place = nodes_.size();
  nodes_.push_back(node);
  if (end - begin <= kItemsPerLeaf) return;
  Eigen::Index axis = 0;
  (high - low).maxCoeff(&axis);
  const Index middle = begin + (end - begin) / 2;
  const auto before = [&](Index a, Index b) {  // a total order: the tree does not depend on how the standard library selects
    const double x = items[slot(a)].min[axis] + items[slot(a)].max[axis];
    const double y = items[slot(b)].min[axis] + items[slot(b)].max[axis];
    return x != y ? x < y : a < b;
  };
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end, before);
  split(items, begin, middle);
  nodes_[place].second_child = static_cast<Index>(nodes_.size());
  split(items, middle, end);
}

}  // namespace amps::detail
