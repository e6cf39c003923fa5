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

/// Sites with their positions and weights. A value.
class SiteTree {
 public:
  SiteTree() = default;
  /// For sites in this box, mostly: those outside are looked at in every search.
  SiteTree(const Vec3& low, const Vec3& high) : nodes_(1) {
    nodes_.front().centre = (low + high) / 2;
    nodes_.front().half = std::max((high - low).maxCoeff() / 2, 1e-300) * (1 + 1e-9);
  }

  bool empty() const { return nodes_.empty(); }

  void insert(const Vec3& x, double weight, Index site) {
    if (!is_inside(x)) {
      outside_.push_back({x, site});
      return;
    }
    insert_at(0, {x, site}, weight, 0);
  }
  void remove(const Vec3& x, Index site) {
    if (!is_inside(x)) return erase(outside_, site);
    std::size_t at = 0;
    while (nodes_[at].first_child != 0) at = nodes_[at].first_child + octant(nodes_[at], x);
    erase(nodes_[at].entries, site);
  }

  /// Calls visit(site) for the sites of the smallest cube that a point is in: a few near ones, or none.
  template <class Visit>
  void visit_cube(const Vec3& x, const Visit& visit) const {
    if (!is_inside(x)) return;
    std::size_t at = 0;
    while (nodes_[at].first_child != 0) at = nodes_[at].first_child + octant(nodes_[at], x);
    for (const Entry& entry : nodes_[at].entries) visit(entry.site);
  }

  /// Calls visit(site) for all sites in cubes for which wants(least, most, weight) is true: the least and the greatest distance
  /// of their points from x, and a weight that none of their sites exceeds. In an order that depends on the history of edits.
  template <class Wants, class Visit>
  void visit(const Vec3& x, const Wants& wants, const Visit& visit) const {
    for (const Entry& entry : outside_) visit(entry.site);
    visit_node(0, x, wants, visit);
  }

  /// The half diagonal of the whole.
  double radius() const { return std::sqrt(3.0) * nodes_.front().half; }

 private:
  struct Entry {
    Vec3 x;
    Index site;
  };
  struct Node {
    Vec3 centre = Vec3::Zero();
    double half = 0;
    double max_weight = -kInfinity;  ///< of all that were ever here
    std::size_t first_child = 0;     ///< of eight; 0: a leaf
    std::vector<Entry> entries;      ///< of a leaf
  };
  static constexpr std::size_t kLeafSize = 8;
  static constexpr int kMaxDepth = 48;

  bool is_inside(const Vec3& x) const { return (x - nodes_.front().centre).cwiseAbs().maxCoeff() <= nodes_.front().half; }
  static std::size_t octant(const Node& node, const Vec3& x) {
    return (x[0] >= node.centre[0] ? 1u : 0u) + (x[1] >= node.centre[1] ? 2u : 0u) + (x[2] >= node.centre[2] ? 4u : 0u);
  }
  static void erase(std::vector<Entry>& entries, Index site) {
    const auto found = std::find_if(entries.begin(), entries.end(), [site](const Entry& entry) { return entry.site == site; });
    if (found == entries.end()) return;
    *found = entries.back();
    entries.pop_back();
  }

  void insert_at(std::size_t at, const Entry& entry, double weight, int depth) {
    for (;; ++depth) {
      nodes_[at].max_weight = std::max(nodes_[at].max_weight, weight);
      if (nodes_[at].first_child == 0) break;
      at = nodes_[at].first_child + octant(nodes_[at], entry.x);
    }
    nodes_[at].entries.push_back(entry);
    if (nodes_[at].entries.size() <= kLeafSize || depth >= kMaxDepth) return;
    const std::size_t first = nodes_.size();
    nodes_.resize(first + 8);
    Node& parent = nodes_[at];
    parent.first_child = first;
    for (std::size_t k = 0; k < 8; ++k) {
      Node& child = nodes_[first + k];
      child.half = parent.half / 2;
      child.centre = parent.centre + child.half * Vec3((k & 1) != 0 ? 1 : -1, (k & 2) != 0 ? 1 : -1, (k & 4) != 0 ? 1 : -1);
      child.max_weight = parent.max_weight;
    }
    const std::vector<Entry> entries = std::move(parent.entries);
    parent.entries = {};
    for (const Entry& moved : entries) nodes_[first + octant(parent, moved.x)].entries.push_back(moved);
  }

  template <class Wants, class Visit>
  void visit_node(std::size_t at, const Vec3& x, const Wants& wants, const Visit& visit) const {
    const Node& node = nodes_[at];
    const Vec3 off = (x - node.centre).cwiseAbs();
    constexpr double kSlack = 1e-9;  // of rounding, here and where a point was put into a cube
    const Vec3 margin = Vec3::Constant(node.half * (1 + kSlack));
    const double least = norm((off - margin).cwiseMax(0.0)) * (1 - kSlack), most = norm(off + margin) * (1 + kSlack);
    if (!wants(least, most, node.max_weight)) return;
    for (const Entry& entry : node.entries) visit(entry.site);
    for (std::size_t k = 0; k < 8 && node.first_child != 0; ++k) visit_node(node.first_child + k, x, wants, visit);
  }

  std::vector<Node> nodes_;
  std::vector<Entry> outside_;
};

}  // namespace amps::detail
