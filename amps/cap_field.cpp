#define AMPS_OWN_SOURCE
#include "amps/cap_field.h"

#include <algorithm>
#include <utility>

namespace amps::detail {

CapField::CapField(std::vector<RadiusCap> caps, double slope) : caps_(std::move(caps)), slope_(slope) {
  if (!caps_.empty()) build(0, caps_.size());
}

void CapField::build(std::size_t begin, std::size_t end) {
  const std::size_t at = nodes_.size();
  Node node{caps_[begin].position, caps_[begin].position, caps_[begin].radius, begin, end, 0};
  for (std::size_t k = begin; k < end; ++k) {
    node.low = node.low.cwiseMin(caps_[k].position);
    node.high = node.high.cwiseMax(caps_[k].position);
    node.min_radius = std::min(node.min_radius, caps_[k].radius);
  }
  nodes_.push_back(node);
  if (end - begin <= kLeafSize) return;
  int axis = 0;
  const Vec3 extent = node.high - node.low;
  for (int k = 1; k < 3; ++k) {
    if (extent[k] > extent[axis]) axis = k;
  }
  const std::size_t middle = begin + (end - begin) / 2;
  const auto place = [this](std::size_t k) { return caps_.begin() + static_cast<std::ptrdiff_t>(k); };
  std::nth_element(place(begin), place(middle), place(end),
                   [axis](const RadiusCap& a, const RadiusCap& b) { return a.position[axis] < b.position[axis]; });
  build(begin, middle);
  nodes_[at].second = nodes_.size();
  build(middle, end);
}

double CapField::bound_of(const Node& node, const Vec3& x) const {
  const Vec3 outside = (node.low - x).cwiseMax(x - node.high).cwiseMax(Vec3::Zero());
  return node.min_radius + slope_ * norm(outside);
}

double CapField::at(const Vec3& x, double wanted) const {
  double bound = wanted;
  if (!nodes_.empty()) search(0, x, bound);
  return bound;
}

void CapField::search(std::size_t at, const Vec3& x, double& bound) const {
  const Node& node = nodes_[at];
  if (!(bound_of(node, x) < bound)) return;
  if (node.second == 0) {
    for (std::size_t k = node.begin; k < node.end; ++k) {
      bound = std::min(bound, caps_[k].radius + slope_ * norm(x - caps_[k].position));
    }
    return;
  }
  const std::size_t first = at + 1;
  const bool second_nearer = bound_of(nodes_[node.second], x) < bound_of(nodes_[first], x);
  search(second_nearer ? node.second : first, x, bound);
  search(second_nearer ? first : node.second, x, bound);
}

}  // namespace amps::detail
