#define AMPS_OWN_SOURCE
#include "amps/surface_tree.h"

#include "amps/execution.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>

namespace amps {
namespace detail {

// What SurfaceTree::Impl is made of. Not in an unnamed namespace: a class with linkage would then have members without, which
// GCC warns of in the single header.

/// Coordinates inside the tree are (x − centre)·scale with a power of two for scale, so that they lie in [−1, 1] ([−4, 4] at
/// the end of the range of doubles) and neither floats nor squares overflow. The centre is 0 unless the mesh is far from the
/// origin compared with its size: then the map is exact, and in the other case its rounding is that of the coordinates
/// themselves.
struct TreeUnit {
  Vec3 centre = Vec3::Zero();
  double scale = 1;
  Vec3 in(const Vec3& x) const { return (x - centre) * scale; }
};

/// A facet (a, b, c), ready to be measured. `to_b` and `to_c` take x − a to the barycentric coordinates of b and c of the
/// projection of x: rows of the pseudo-inverse of [b − a, c − a].
struct TreeFacet {
  Vec3 a, ab, ac, to_b, to_c;
  double rim;  ///< if the projection has a barycentric coordinate at most this, look at that edge as well
  Index facet;
  bool has_inner;  ///< false: too flat a facet for inner points; `to_b` and `to_c` are 0
};

struct FacetPoint {
  double squared_distance;
  double b, c;  ///< barycentric coordinates
};

constexpr int kTreeArity = 4;

/// Four numbers, in plain loops that compilers turn into single instructions. (Not an Eigen array: its alignment depends on
/// flags.)
struct FourFloats {
  float value[kTreeArity];
  float& operator[](int k) { return value[k]; }
  float operator[](int k) const { return value[k]; }
};

/// Four children, their boxes side by side.
struct TreeNode {
  FourFloats min[3], max[3];
  Index child[kTreeArity];  ///< ≥ 0: a node; kNoChild: none; else ~ the place of a facet
};

}  // namespace detail

namespace {

using detail::dot;
using detail::FacetPoint;
using detail::FourFloats;
using detail::kTreeArity;
using detail::squared_norm;
using detail::TreeFacet;
using detail::TreeNode;
using detail::TreeUnit;

TreeUnit tree_unit(const Box& box) {
  const Vec3 half = box.max / 2 - box.min / 2;
  const Vec3 farthest = box.min.cwiseAbs().cwiseMax(box.max.cwiseAbs());
  constexpr double kFar = 4;  // half-extents; a box around the origin has at most 1
  TreeUnit unit;
  double size = farthest.maxCoeff();
  if (size > kFar * half.maxCoeff()) {
    unit.centre = box.max / 2 + box.min / 2;
    size = half.maxCoeff() + 0x1p-50 * size;  // what rounding of the centre can add
  }
  int exponent = 0;
  std::frexp(size, &exponent);
  unit.scale = std::ldexp(1.0, -std::clamp(exponent, -1022, 1022));  // a normal number
  return unit;
}

// One facet

TreeFacet tree_facet(const Vec3& a, const Vec3& b, const Vec3& c, Index facet) {
  // At the rim rounding may take the inner point for the nearest where an edge or corner is, by a few 1e-16: a corner of the
  // mesh shall be at distance 0 exactly. A sliver (sine of the angle at a below kSliver) has inner points known to
  // 2^-53/sine only, but its edges are nearer than its width.
  constexpr double kRim = 1e-9, kSliver = 1e-7;
  constexpr double kInfinite = std::numeric_limits<double>::infinity(), kGreatest = std::numeric_limits<double>::max();
  TreeFacet t{a, b - a, c - a, Vec3::Zero(), Vec3::Zero(), kRim, facet, false};
  const Vec3 normal = t.ab.cross(t.ac);
  const double square = detail::squared_norm(normal);
  if (!(square > kSliver * kSliver * detail::squared_norm(t.ab) * detail::squared_norm(t.ac))) t.rim = kInfinite;
  const Vec3 b_direction = t.ac.cross(normal), c_direction = normal.cross(t.ab);
  // In words: both quotients are finite. Only the smallest squares, far below 1, can make them overflow.
  const double largest = std::max(b_direction.cwiseAbs().maxCoeff(), c_direction.cwiseAbs().maxCoeff());
  t.has_inner = square > 0 && largest <= std::min(square, 1.0) * kGreatest;
  if (t.has_inner) {
    t.to_b = b_direction / square;
    t.to_c = c_direction / square;
  } else {
    t.rim = kInfinite;
  }
  return t;
}

/// The parameter in [0, 1] of the point of the segment from 0 to `edge` nearest to x.
double nearest_on_segment(const Vec3& edge, const Vec3& x) {
  const double along = dot(edge, x), square = squared_norm(edge);
  if (!(along > 0)) return 0;
  return along >= square ? 1 : along / square;
}

FacetPoint nearest_on(const TreeFacet& t, const Vec3& query) {
  const Vec3 x = query - t.a;
  FacetPoint best{std::numeric_limits<double>::infinity(), 0, 0};
  double b = detail::dot(x, t.to_b), c = detail::dot(x, t.to_c);
  if (b >= 0 && c >= 0 && b + c <= 1 && t.has_inner) {
    // The error of b and c is 2^-53 over the sine of the facet's angle; measured on what they leave of x, that of the error.
    Vec3 rest = x - b * t.ab - c * t.ac;
    const double finer_b = b + dot(rest, t.to_b), finer_c = c + dot(rest, t.to_c);
    if (finer_b >= 0 && finer_c >= 0 && finer_b + finer_c <= 1) {
      b = finer_b;
      c = finer_c;
      rest = x - b * t.ab - c * t.ac;
    }
    best = {squared_norm(rest), b, c};
  }
  // Outside, the nearest point is on an edge whose line parts the projection from the facet.
  const auto offer = [&best](double squared_distance, double at_b, double at_c) {
    if (squared_distance < best.squared_distance) best = {squared_distance, at_b, at_c};
  };
  if (!(c > t.rim)) {
    const double at = nearest_on_segment(t.ab, x);
    offer(squared_norm(x - at * t.ab), at, 0);
  }
  if (!(b > t.rim)) {
    const double at = nearest_on_segment(t.ac, x);
    offer(squared_norm(x - at * t.ac), 0, at);
  }
  if (!(1 - b - c > t.rim)) {
    const Vec3 from_b = x - t.ab, bc = t.ac - t.ab;
    const double at = nearest_on_segment(bc, from_b);
    offer(squared_norm(from_b - at * bc), 1 - at, at);
  }
  return best;
}

// Boxes

struct TreeBox {
  Vec3 min = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 max = Vec3::Constant(-std::numeric_limits<double>::infinity());
  void add(const Vec3& x) {
    min = min.cwiseMin(x);
    max = max.cwiseMax(x);
  }
  void add(const TreeBox& box) {
    min = min.cwiseMin(box.min);
    max = max.cwiseMax(box.max);
  }
  double half_area() const {
    const Vec3 e = max - min;
    return e.x() * e.y() + e.y() * e.z() + e.z() * e.x();
  }
};

constexpr Index kNoChild = std::numeric_limits<Index>::min();

float round_down(double x) {
  const auto f = static_cast<float>(x);
  return static_cast<double>(f) > x ? std::nextafter(f, -std::numeric_limits<float>::infinity()) : f;
}
float round_up(double x) {
  const auto f = static_cast<float>(x);
  return static_cast<double>(f) < x ? std::nextafter(f, std::numeric_limits<float>::infinity()) : f;
}

/// A query for boxes. With |x| the greatest of its coordinates, converting one to float and subtracting a bound in [−4, 4] errs
/// by less than 2^-22·(|x| + 1). `slack`, four times that, is taken off each difference; what remains of it makes a difference
/// smaller by a factor below 1 − 2^-21, more than the roundings of the sum of squares can add.
struct BoxQuery {
  float x[3];
  float slack;

  explicit BoxQuery(const Vec3& query) {
    const double size = query.cwiseAbs().maxCoeff();
    // Squares beyond would overflow; from so far all boxes are alike, and the infinite slack has all of them visited.
    constexpr double kFarthest = 0x1p60;
    slack = size < kFarthest ? static_cast<float>(0x1p-20 * (size + 1)) : std::numeric_limits<float>::infinity();
    for (int axis = 0; axis < 3; ++axis) x[axis] = static_cast<float>(std::clamp(query[axis], -kFarthest, kFarthest));
  }

  /// At most the squared distance to anything in each child.
  FourFloats lower_bounds(const TreeNode& node) const {
    FourFloats sum{};
    for (int axis = 0; axis < 3; ++axis) {
      const FourFloats &low = node.min[axis], &high = node.max[axis];
      for (int k = 0; k < kTreeArity; ++k) {
        const float beyond = std::max(std::max(low[k] - x[axis], x[axis] - high[k]) - slack, 0.0f);
        sum[k] += beyond * beyond;
      }
    }
    return sum;
  }
};

// Building

struct BuildItem {
  TreeBox box;
  Vec3 centroid;  ///< twice the middle of the box
  Index facet;
};

class TreeBuilder {
 public:
  /// Rearranges the items. Reports as it visits them, which it does some kVisitsPerLevel times on each level.
  TreeBuilder(std::vector<BuildItem>& items, std::vector<TreeNode>& nodes, const Execution& execution)
      : items_(items), nodes_(nodes), ticker_(execution, expected_visits(items.size()), detail::kElementsPerLook) {
    nodes_.reserve(items.size());  // each has two children at least; what is not used takes no memory
    add_node({0, items.size()}, 0);
  }

 private:
  struct Range {
    std::size_t begin, end;
    std::size_t size() const { return end - begin; }
  };

  static std::uint64_t expected_visits(std::size_t n) {
    std::uint64_t levels = 1;
    for (std::size_t left = n; left > 1; left /= 2) ++levels;
    return kVisitsPerLevel * n * levels;
  }

  Index add_node(const Range& all, int depth) {
    const auto id = static_cast<Index>(nodes_.size());
    nodes_.emplace_back();
    std::array<Range, kTreeArity> parts{all, {}, {}, {}};
    std::size_t count = 1;
    // Halve the largest part until there are four or all are single facets.
    while (count < kTreeArity) {
      std::size_t largest = 0;
      for (std::size_t k = 1; k < count; ++k) {
        if (parts[k].size() > parts[largest].size()) largest = k;
      }
      if (parts[largest].size() < 2) break;
      const Range part = parts[largest];
      const std::size_t middle = part.size() <= kTreeArity ? part.begin + part.size() / 2 : split(part, depth);
      parts[largest] = {part.begin, middle};
      parts[count++] = {middle, part.end};
    }
    for (std::size_t k = 0; k < kTreeArity; ++k) {
      if (k >= count) {
        set_child(id, k, TreeBox{Vec3::Zero(), Vec3::Zero()}, kNoChild);
        continue;
      }
      TreeBox box;
      for (std::size_t i = parts[k].begin; i < parts[k].end; ++i) {
        ticker_.tick();
        box.add(items_[i].box);
      }
      const Index child = parts[k].size() == 1 ? ~static_cast<Index>(parts[k].begin) : add_node(parts[k], depth + 1);
      set_child(id, k, box, child);
    }
    return id;
  }

  void set_child(Index id, std::size_t k, const TreeBox& box, Index child) {
    TreeNode& node = nodes_[detail::slot(id)];
    for (int axis = 0; axis < 3; ++axis) {
      node.min[axis][static_cast<Index>(k)] = round_down(box.min[axis]);
      node.max[axis][static_cast<Index>(k)] = round_up(box.max[axis]);
    }
    node.child[k] = child;
  }

  /// Parts the items of a range in two, neither empty; returns where the second part begins.
  std::size_t split(const Range& range, int depth) {
    TreeBox centroids;
    for (std::size_t i = range.begin; i < range.end; ++i) {
      ticker_.tick();
      centroids.add(items_[i].centroid);
    }
    int axis = 0;
    const double extent = (centroids.max - centroids.min).maxCoeff(&axis);
    // Splitting by area may peel off a few facets at a time; past this depth halves keep the tree, and the stacks, shallow. Of
    // a tiny extent the bins' number to a unit would overflow.
    if (!(extent > kTinyExtent) || depth > kMaxUnbalancedDepth) return split_in_half(range, axis);

    const double low = centroids.min[axis], to_bin = kBins / extent;
    const auto bin_of = [&](const BuildItem& item) {
      return std::min(static_cast<std::size_t>((item.centroid[axis] - low) * to_bin), kBins - 1);
    };
    std::array<TreeBox, kBins> boxes{};
    std::array<std::size_t, kBins> sizes{};
    for (std::size_t i = range.begin; i < range.end; ++i) {
      ticker_.tick();
      const std::size_t bin = bin_of(items_[i]);
      boxes[bin].add(items_[i].box);
      ++sizes[bin];
    }
    std::array<double, kBins> cost_after{};  // of the bins from k on
    TreeBox box;
    std::size_t size = 0;
    for (std::size_t k = kBins; k-- > 1;) {
      box.add(boxes[k]);
      size += sizes[k];
      cost_after[k] = size > 0 ? box.half_area() * static_cast<double>(size) : 0;
    }
    box = TreeBox();
    size = 0;
    double min_cost = std::numeric_limits<double>::infinity();
    std::size_t best = 0;
    for (std::size_t k = 1; k < kBins; ++k) {
      box.add(boxes[k - 1]);
      size += sizes[k - 1];
      if (size == 0 || size == range.size()) continue;
      const double cost = box.half_area() * static_cast<double>(size) + cost_after[k];
      if (cost < min_cost) {
        min_cost = cost;
        best = k;
      }
    }
    if (best == 0) return split_in_half(range, axis);
    const auto first = items_.begin();
    const auto middle = std::partition(first + static_cast<std::ptrdiff_t>(range.begin),
                                       first + static_cast<std::ptrdiff_t>(range.end), [&](const BuildItem& item) {
                                         ticker_.tick();
                                         return bin_of(item) < best;
                                       });
    return static_cast<std::size_t>(middle - first);
  }

  std::size_t split_in_half(const Range& range, int axis) {
    const std::size_t middle = range.begin + range.size() / 2;
    const auto at = [this](std::size_t i) { return items_.begin() + static_cast<std::ptrdiff_t>(i); };
    std::nth_element(at(range.begin), at(middle), at(range.end), [this, axis](const BuildItem& a, const BuildItem& b) {
      ticker_.tick();
      return a.centroid[axis] != b.centroid[axis] ? a.centroid[axis] < b.centroid[axis] : a.facet < b.facet;
    });
    return middle;
  }

  static constexpr std::size_t kBins = 16;
  static constexpr int kMaxUnbalancedDepth = 40;
  static constexpr double kTinyExtent = 1e-300;
  static constexpr std::uint64_t kVisitsPerLevel = 3;
  std::vector<BuildItem>& items_;
  std::vector<TreeNode>& nodes_;
  detail::Ticker ticker_;
};

// Each node of the way down leaves at most three others behind. At most 41 levels may be unbalanced; below, the largest of the
// parts is halved until there are four, so a level leaves at most ⌈n/2⌉ of n items in a part, and 2^31 are used up in 32.
constexpr std::size_t kStackSize = 3 * (41 + 32) + 1;

/// Unlike require_usable(): without area is fine, and of vertices only those of facets matter.
void require_tree_mesh(const MeshView& mesh, const Execution& execution) {
  if (mesh.triangles.rows() == 0) {
    throw Error(ErrorCode::kInvalidMesh, "surface tree: the mesh has no facet; give a surface, or use KdTree for points");
  }
  bounding_box(mesh, execution.part(0, 0.6));  // throws for counts and indices out of range
  detail::for_each_index(mesh.num_facets(), execution.part(0.6, 1), [&](Index f) {
    for (int k = 0; k < 3; ++k) {
      if (mesh.corner(f, k).allFinite()) continue;
      throw Error(ErrorCode::kInvalidMesh, "surface tree: vertex " + std::to_string(mesh.triangles(f, k)) +
                                               " (0-based) has a coordinate that is NaN or infinite; remove or correct it");
    }
  });
}

std::vector<BuildItem> build_items(const MeshView& mesh, const TreeUnit& unit, const Execution& execution) {
  std::vector<BuildItem> items;
  detail::resize_watched(items, static_cast<std::size_t>(mesh.num_facets()), BuildItem{{}, Vec3::Zero(), kNone},
                         execution.part(0, 0));
  detail::for_each_index(mesh.num_facets(), execution, [&](Index f) {
    BuildItem& item = items[detail::slot(f)];
    for (int k = 0; k < 3; ++k) item.box.add(unit.in(mesh.corner(f, k)));
    item.centroid = item.box.min + item.box.max;
    item.facet = f;
  });
  return items;
}

/// In the order of the items.
std::vector<TreeFacet> tree_facets(const MeshView& mesh, const TreeUnit& unit, const std::vector<BuildItem>& items,
                                   const Execution& execution) {
  std::vector<TreeFacet> facets;
  facets.reserve(items.size());
  detail::for_each_index(items.size(), execution, [&](std::size_t i) {
    const Index f = items[i].facet;
    facets.push_back(tree_facet(unit.in(mesh.corner(f, 0)), unit.in(mesh.corner(f, 1)), unit.in(mesh.corner(f, 2)), f));
  });
  return facets;
}

}  // namespace

// Searching

struct SurfaceTree::Impl {
  Mesh mesh;
  TreeUnit unit;
  std::vector<TreeNode> nodes;
  std::vector<TreeFacet> facets;  ///< in the order of the leaves
  std::vector<Index> place;       ///< of each facet, in `facets`

  struct Best {
    FacetPoint point{std::numeric_limits<double>::infinity(), 0, 0};
    Index place = kNone;
    Index facet = std::numeric_limits<Index>::max();
  };

  Impl(const MeshView& view, const Execution& execution)
      : mesh(view.copy()), unit(tree_unit(bounding_box(view, execution.part(0, 0.1)))) {
    std::vector<BuildItem> items = build_items(view, unit, execution.part(0.1, 0.2));
    const TreeBuilder build(items, nodes, execution.part(0.2, 0.85));
    facets = tree_facets(view, unit, items, execution.part(0.85, 0.97));
    place.resize(facets.size());
    detail::for_each_index(facets.size(), execution.part(0.97, 1),
                           [this](std::size_t i) { place[detail::slot(facets[i].facet)] = static_cast<Index>(i); });
  }

  Vec3 query_point(const Vec3& query) const {
    const Vec3 x = unit.in(query);
    constexpr double kFarthest = 1e150;  // squares stay finite
    if (!(x.cwiseAbs().maxCoeff() <= kFarthest) || x.hasNaN()) {
      throw Error(ErrorCode::kInvalidArgument,
                  "surface tree: a query point is NaN, infinite, or over 1e150 times the mesh's size away; give a finite point "
                  "in the units of the mesh");
    }
    return x;
  }

  void offer(Index at, const Vec3& x, Best& best) const {
    if (at == best.place) return;  // the hint
    const TreeFacet& t = facets[detail::slot(at)];
    const FacetPoint point = nearest_on(t, x);
    const double d = point.squared_distance;
    if (d < best.point.squared_distance || (d == best.point.squared_distance && t.facet < best.facet))
      best = {point, at, t.facet};
  }

  /// Improves `best`. A facet exactly as far as the best so far is looked at, so the result depends on no order.
  void search(const Vec3& x, Best& best) const {
    struct Visit {
      float bound;
      Index child;
    };
    const BoxQuery query(x);
    std::array<Visit, kStackSize> stack;  // NOLINT: filled as it grows
    std::size_t top = 0;
    stack[top++] = {0, 0};
    // Above the squared distance by more than the conversion's error, and quicker to have than the next float.
    const auto limit_of = [](const Best& b) { return static_cast<float>(b.point.squared_distance * (1 + 0x1p-22) + 0x1p-126); };
    float limit = limit_of(best);
    while (top > 0) {
      const Visit visit = stack[--top];
      if (visit.bound > limit) continue;
      if (visit.child < 0) {
        offer(~visit.child, x, best);
        limit = limit_of(best);
        continue;
      }
      const TreeNode& node = nodes[detail::slot(visit.child)];
      const FourFloats bounds = query.lower_bounds(node);
      const std::size_t base = top;
      for (int k = 0; k < kTreeArity; ++k) {
        if (node.child[k] == kNoChild || bounds[k] > limit) continue;
        std::size_t i = top++;
        for (; i > base && stack[i - 1].bound < bounds[k]; --i) stack[i] = stack[i - 1];
        stack[i] = {bounds[k], node.child[k]};
      }
    }
  }

  SurfaceHit hit(const Best& best) const {
    SurfaceHit result;
    if (best.place == kNone) return result;
    const double b = best.point.b, c = best.point.c;
    result.point.facet = best.facet;
    result.point.barycentric = {std::max(0.0, 1 - b - c), b, c};
    const MeshView view(mesh);
    for (int k = 0; k < 3; ++k) result.point.position += result.point.barycentric[k] * view.corner(best.facet, k);
    result.distance = std::sqrt(best.point.squared_distance) / unit.scale;
    return result;
  }
};

SurfaceTree::SurfaceTree(const MeshView& mesh, const Execution& execution) {
  const Execution job = execution.start("building a search tree");
  require_tree_mesh(mesh, job.part(0, 0.05));
  impl_ = std::make_unique<Impl>(mesh, job.part(0.05, 1));
  job.finish();
}

SurfaceTree::~SurfaceTree() = default;
SurfaceTree::SurfaceTree(SurfaceTree&&) noexcept = default;
SurfaceTree& SurfaceTree::operator=(SurfaceTree&&) noexcept = default;

Index SurfaceTree::num_facets() const { return static_cast<Index>(impl_->facets.size()); }

SurfaceHit SurfaceTree::nearest(const Vec3& query, Index hint) const {
  const Vec3 x = impl_->query_point(query);
  Impl::Best best;
  if (hint >= 0 && hint < num_facets()) impl_->offer(impl_->place[detail::slot(hint)], x, best);
  impl_->search(x, best);
  return impl_->hit(best);
}

SurfaceHit SurfaceTree::nearest_within(const Vec3& query, double radius) const {
  if (!(radius >= 0))
    throw Error(ErrorCode::kInvalidArgument, "surface tree: the radius is negative or NaN; give one that is 0 or more");
  const Vec3 x = impl_->query_point(query);
  Impl::Best best;
  // Wider by more than the roundings of a distance, so that the comparison below decides and not the search.
  const double reach = radius * impl_->unit.scale * (1 + 0x1p-40) + 0x1p-500;
  best.point.squared_distance = reach * reach;
  impl_->search(x, best);
  const SurfaceHit result = impl_->hit(best);
  return result.distance <= radius ? result : SurfaceHit();
}

SurfaceHit SurfaceTree::nearest_on_facet(const Vec3& query, Index facet) const {
  if (facet < 0 || facet >= num_facets()) {
    throw Error(ErrorCode::kInvalidArgument, "surface tree: facet " + std::to_string(facet) + " is not one of the " +
                                                 std::to_string(num_facets()) + " facets (0-based)");
  }
  Impl::Best best;
  impl_->offer(impl_->place[detail::slot(facet)], impl_->query_point(query), best);
  return impl_->hit(best);
}

std::vector<SurfaceHit> SurfaceTree::nearest_all(const PointsView& queries, const Execution& execution) const {
  const Execution job = execution.start("finding nearest points");
  std::vector<SurfaceHit> hits(static_cast<std::size_t>(queries.rows()));
  constexpr std::size_t kGrain = 1024;
  detail::for_each_piece_on_all_threads(hits.size(), kGrain, job, [&](std::size_t begin, std::size_t end) {
    Index hint = kNone;
    for (std::size_t i = begin; i < end; ++i) {
      hits[i] = nearest(queries[static_cast<std::ptrdiff_t>(i)], hint);
      hint = hits[i].point.facet;
    }
  });
  job.finish();
  return hits;
}

}  // namespace amps
