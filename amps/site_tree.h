// site_tree.h (internal): sites by place and weight, while they come and go: which sites near a point may matter there. For the
// few facets of a diagram that too many disks reach to look at all of them (power_diagram.h). An octree, so that radii may
// differ a thousandfold, as beside the rim of a thin plate.
#pragma once

#include "amps/base.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace amps::detail {

/// Sites by their positions, with bounds of their weights. Some 25 bytes a site on a surface. A value.
class SiteTree {
 public:
  SiteTree() = default;
  /// For sites in this box, mostly: those outside are looked at in every search.
  SiteTree(const Vec3& low, const Vec3& high)
      : root_{(low + high) / 2, std::max((high - low).maxCoeff() / 2, 1e-300) * (1 + 1e-9)}, nodes_(1) {}

  bool empty() const { return nodes_.empty(); }

  /// `position(site)`: where a site is that has been inserted.
  template <class Position>
  void insert(const Vec3& x, double weight, Index site, const Position& position) {
    if (!is_inside(x)) {
      outside_.push_back(site);
      return;
    }
    Cube cube = root_;
    std::size_t at = 0;
    int depth = 0;
    for (;; ++depth) {
      nodes_[at].max_weight = std::max(nodes_[at].max_weight, weight);
      if (!nodes_[at].has_children()) break;
      const std::size_t k = octant(cube, x);
      at = nodes_[at].first_child() + k;
      cube = child(cube, k);
    }
    if (append(at, site) && depth < kMaxDepth) split(at, cube, position);
  }
  void remove(const Vec3& x, Index site) {
    if (!is_inside(x)) {
      const auto found = std::find(outside_.begin(), outside_.end(), site);
      if (found == outside_.end()) return;
      *found = outside_.back();
      outside_.pop_back();
      return;
    }
    erase(leaf_at(x), site);
  }

  /// Calls visit(site) for the sites of the smallest cube that a point is in: a few near ones, or none.
  template <class Visit>
  void visit_cube(const Vec3& x, const Visit& visit) const {
    if (is_inside(x)) visit_leaf(leaf_at(x), visit);
  }

  /// Calls visit(site) for all sites in cubes for which wants(least, most, weight) is true: the least and the greatest distance
  /// of their points from x, and a weight that none of their sites exceeds. In an order that depends on the history of edits.
  template <class Wants, class Visit>
  void visit(const Vec3& x, const Wants& wants, const Visit& visit) const {
    for (const Index site : outside_) visit(site);
    visit_node(0, root_, x, wants, visit);
  }

  /// The half diagonal of the whole.
  double radius() const { return std::sqrt(3.0) * root_.half; }

 private:
  struct Cube {
    Vec3 centre = Vec3::Zero();
    double half = 0;
  };
  struct Node {
    double max_weight = -kInfinity;  ///< of all that were ever here
    Index link = 0;                  ///< above 0: the first of eight children; of a leaf: −1 − its block; 0: an empty leaf
    bool has_children() const { return link > 0; }
    std::size_t first_child() const { return static_cast<std::size_t>(link); }
    Index block() const { return link < 0 ? -1 - link : kNone; }
  };
  static constexpr int kLeafSize = 8;
  static constexpr int kMaxDepth = 48;
  /// Sites of a leaf; of a leaf that has more, all blocks but the first one are full.
  struct Block {
    std::array<Index, kLeafSize> sites;
    int size;
    Index next;
  };

  bool is_inside(const Vec3& x) const { return (x - root_.centre).cwiseAbs().maxCoeff() <= root_.half; }
  static std::size_t octant(const Cube& cube, const Vec3& x) {
    return (x[0] >= cube.centre[0] ? 1u : 0u) + (x[1] >= cube.centre[1] ? 2u : 0u) + (x[2] >= cube.centre[2] ? 4u : 0u);
  }
  static Cube child(const Cube& cube, std::size_t k) {
    const double half = cube.half / 2;
    return {cube.centre + half * Vec3((k & 1) != 0 ? 1 : -1, (k & 2) != 0 ? 1 : -1, (k & 4) != 0 ? 1 : -1), half};
  }
  std::size_t leaf_at(const Vec3& x) const {
    Cube cube = root_;
    std::size_t at = 0;
    while (nodes_[at].has_children()) {
      const std::size_t k = octant(cube, x);
      at = nodes_[at].first_child() + k;
      cube = child(cube, k);
    }
    return at;
  }

  Index new_block() {
    if (free_block_ == kNone) {
      blocks_.push_back({{}, 0, kNone});
      return static_cast<Index>(blocks_.size()) - 1;
    }
    const Index block = free_block_;
    free_block_ = blocks_[slot(block)].next;
    blocks_[slot(block)] = {{}, 0, kNone};
    return block;
  }
  void free_block(Index block) {
    blocks_[slot(block)].next = free_block_;
    free_block_ = block;
  }

  /// Is the leaf over-full then?
  bool append(std::size_t leaf, Index site) {
    Index first = nodes_[leaf].block();
    if (first == kNone || blocks_[slot(first)].size == kLeafSize) {
      const Index fresh = new_block();
      blocks_[slot(fresh)].next = first;
      first = fresh;
      nodes_[leaf].link = -1 - fresh;
    }
    Block& block = blocks_[slot(first)];
    block.sites[static_cast<std::size_t>(block.size++)] = site;
    return block.next != kNone;
  }

  /// The last site takes its place.
  void erase(std::size_t leaf, Index site) {
    const Index first = nodes_[leaf].block();
    for (Index b = first; b != kNone; b = blocks_[slot(b)].next) {
      Index* const end = blocks_[slot(b)].sites.data() + blocks_[slot(b)].size;
      Index* const found = std::find(blocks_[slot(b)].sites.data(), end, site);
      if (found == end) continue;
      Block& block = blocks_[slot(first)];
      *found = block.sites[static_cast<std::size_t>(--block.size)];
      if (block.size > 0) return;
      nodes_[leaf].link = block.next == kNone ? 0 : -1 - block.next;
      free_block(first);
      return;
    }
  }

  template <class Visit>
  void visit_leaf(std::size_t leaf, const Visit& visit) const {
    for (Index b = nodes_[leaf].block(); b != kNone; b = blocks_[slot(b)].next) {
      const Block& block = blocks_[slot(b)];
      for (int k = 0; k < block.size; ++k) visit(block.sites[static_cast<std::size_t>(k)]);
    }
  }

  template <class Position>
  void split(std::size_t leaf, const Cube& cube, const Position& position) {
    std::vector<Index> sites;
    visit_leaf(leaf, [&sites](Index site) { sites.push_back(site); });
    for (Index b = nodes_[leaf].block(); b != kNone;) {
      const Index next = blocks_[slot(b)].next;
      free_block(b);
      b = next;
    }
    const std::size_t first = nodes_.size();
    const double max_weight = nodes_[leaf].max_weight;
    nodes_.resize(first + 8, {max_weight, 0});
    nodes_[leaf].link = static_cast<Index>(first);
    for (const Index site : sites) append(first + octant(cube, position(site)), site);
  }

  template <class Wants, class Visit>
  void visit_node(std::size_t at, const Cube& cube, const Vec3& x, const Wants& wants, const Visit& visit) const {
    const Node& node = nodes_[at];
    const Vec3 off = (x - cube.centre).cwiseAbs();
    constexpr double kSlack = 1e-9;  // of rounding, here and where a point was put into a cube
    const Vec3 margin = Vec3::Constant(cube.half * (1 + kSlack));
    const double least = norm((off - margin).cwiseMax(0.0)) * (1 - kSlack), most = norm(off + margin) * (1 + kSlack);
    if (!wants(least, most, node.max_weight)) return;
    if (!node.has_children()) return visit_leaf(at, visit);
    for (std::size_t k = 0; k < 8; ++k) visit_node(node.first_child() + k, child(cube, k), x, wants, visit);
  }

  Cube root_;
  std::vector<Node> nodes_;
  std::vector<Block> blocks_;
  Index free_block_ = kNone;  ///< linked by `next`
  std::vector<Index> outside_;
};

}  // namespace amps::detail
