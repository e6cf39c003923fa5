#define AMPS_OWN_SOURCE
#include "amps/self_intersections.h"

#include "amps/mesh_edges.h"
#include "amps/mesh_scale.h"
#include "amps/predicates.h"
#include "amps/spatial_sort.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <mutex>
#include <ostream>
#include <string>
#include <utility>

namespace amps {
namespace {

using detail::orient2d_filter;

// Two facets

/// The projection that shows most of a triangle, and how it turns there; turn 0 if it has no area.
struct Projection {
  int axis, turn;
};
Projection best_projection(const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 u = b - a, v = c - a;
  const double area[3] = {std::fabs(u[1] * v[2] - u[2] * v[1]), std::fabs(u[2] * v[0] - u[0] * v[2]),
                          std::fabs(u[0] * v[1] - u[1] * v[0])};
  int order[3] = {0, 1, 2};  // the greatest first, for speed; where these overflow or underflow, any
  if (area[order[1]] > area[order[0]]) std::swap(order[0], order[1]);
  if (area[order[2]] > area[order[0]]) std::swap(order[0], order[2]);
  for (const int axis : order) {
    if (const int turn = orient2d(a.data(), b.data(), c.data(), axis)) return {axis, turn};
  }
  return {order[0], 0};
}

/// A facet that has an area, ready to be compared.
struct ComparedFacet {
  std::array<std::array<double, 3>, 3> corners;
  std::array<Index, 3> vertices;  ///< the first mesh vertex with the position of each
  Index facet;
  Projection seen;

  const double* corner(int k) const { return corners[static_cast<std::size_t>(k)].data(); }
};

using ComparedFacets = std::vector<ComparedFacet, detail::UninitializedAllocator<ComparedFacet>>;

/// Corners of two facets by their place in them, those that they share first and in the same order.
struct CommonCorners {
  int count = 0;
  int of_first[3] = {0, 1, 2};
  int of_second[3] = {0, 1, 2};

  CommonCorners(const ComparedFacet& s, const ComparedFacet& t) noexcept {
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        if (s.vertices[static_cast<std::size_t>(i)] == t.vertices[static_cast<std::size_t>(j)]) add(i, j);
      }
    }
  }

 private:
  void add(int i, int j) noexcept {
    std::swap(of_first[count], *std::find(of_first, of_first + 3, i));
    std::swap(of_second[count], *std::find(of_second, of_second + 3, j));
    ++count;
  }
};

struct ClosedBox {
  double min[3], max[3];

  void add(const ClosedBox& box) noexcept {
    for (int k = 0; k < 3; ++k) {
      min[k] = std::min(min[k], box.min[k]);
      max[k] = std::max(max[k], box.max[k]);
    }
  }
  bool meets(const ClosedBox& box) const noexcept {
    bool apart = false;
    for (int k = 0; k < 3; ++k) apart = apart | (max[k] < box.min[k]) | (box.max[k] < min[k]);
    return !apart;
  }
};

int orientation_of(const double* a, const double* b, const double* c, const double* d) noexcept {
  const auto site = [](const double* x) { return WeightedPoint{x[0], x[1], x[2], 0}; };
  return orient3d(site(a), site(b), site(c), site(d));
}

/// Is there certainly a line, in the projection along an axis, through an edge of s that has all common corners, with s on one
/// side of it and what is not common of t strictly on the other? Then s and t have nothing else in common.
bool parted_by_edge(const ComparedFacet& s, const int (&of_s)[3], const ComparedFacet& t, const int (&of_t)[3], int count,
                    int axis) noexcept {
  constexpr int kEdges[3][3] = {{0, 1, 2}, {0, 2, 1}, {1, 2, 0}};  // the two ends, and the corner that is none
  const int num_edges = 3 - count;                                 // those of all common corners come first
  for (int e = 0; e < num_edges; ++e) {
    const double *const a = s.corner(of_s[kEdges[e][0]]), *const b = s.corner(of_s[kEdges[e][1]]);
    const int inside = orient2d_filter(a, b, s.corner(of_s[kEdges[e][2]]), axis);
    bool parted = inside != 0;
    for (int k = count; k < 3 && parted; ++k) parted = orient2d_filter(a, b, t.corner(of_t[k]), axis) == -inside;
    if (parted) return true;
  }
  return false;
}

/// Does the closed segment from p to q meet the closed triangle t, all in one plane? The difference of both sets is a convex
/// polygon with sides along those of t and along pq: where it does not have 0, it is beyond one of these.
bool meet_in_plane(const double* p, const double* q, const ComparedFacet& t) noexcept {
  for (int k = 0; k < 3; ++k) {
    const double *const a = t.corner(k), *const b = t.corner((k + 1) % 3);
    if (orient2d(a, b, p, t.seen.axis) == -t.seen.turn && orient2d(a, b, q, t.seen.axis) == -t.seen.turn) return false;
  }
  const int side = orient2d(p, q, t.corner(0), t.seen.axis);
  return side == 0 || orient2d(p, q, t.corner(1), t.seen.axis) != side || orient2d(p, q, t.corner(2), t.seen.axis) != side;
}

/// The same anywhere; at_p and at_q: the sides of the plane of t, as orient3d() has them. Where the segment passes through the
/// plane, at a single point, its orientations with the sides of t are that point's barycentric coordinates, times a number.
bool segment_meets_facet(const double* p, int at_p, const double* q, int at_q, const ComparedFacet& t) noexcept {
  if (at_p * at_q > 0) return false;
  if (at_p == 0 && at_q == 0) return meet_in_plane(p, q, t);
  bool positive = false, negative = false;
  for (int k = 0; k < 3 && !(positive && negative); ++k) {
    const int sign = orientation_of(p, q, t.corner(k), t.corner((k + 1) % 3));
    positive |= sign > 0;
    negative |= sign < 0;
  }
  return !(positive && negative);
}

/// The sides of the plane of t that the corners of s are on; those that are common are on it.
struct SidesOfPlane {
  int at[3] = {0, 0, 0};  ///< in the order of `of_s`

  SidesOfPlane(const ComparedFacet& s, const int (&of_s)[3], int count, const ComparedFacet& t) noexcept {
    for (int k = count; k < 3; ++k) at[k] = orientation_of(t.corner(0), t.corner(1), t.corner(2), s.corner(of_s[k]));
  }
  /// Are all that are not common strictly on one side?
  bool beyond(int count) const noexcept { return at[2] != 0 && at[1] == at[2] && (count > 0 || at[0] == at[2]); }
};

/// Does an edge of s that has no common corner meet t? For one common corner or none.
bool edges_meet_facet(const ComparedFacet& s, const int (&of_s)[3], const SidesOfPlane& sides, int count,
                      const ComparedFacet& t) noexcept {
  for (int k = count; k < 3; ++k) {  // the edge from k to the next one that is not common; one edge if there is a common corner
    const int next = k < 2 ? k + 1 : 0;
    if (next < count) break;
    if (segment_meets_facet(s.corner(of_s[k]), sides.at[k], s.corner(of_s[next]), sides.at[next], t)) return true;
  }
  return false;
}

/// Two facets at a common edge.
bool folded_over(const ComparedFacet& s, const int (&of_s)[3], const ComparedFacet& t, const int (&of_t)[3]) noexcept {
  const double *const a = s.corner(of_s[0]), *const b = s.corner(of_s[1]), *const c = s.corner(of_s[2]);
  const double* const d = t.corner(of_t[2]);
  if (orientation_of(a, b, c, d) != 0) return false;
  return orient2d(a, b, c, s.seen.axis) == orient2d(a, b, d, s.seen.axis);
}

/// Facets without a common corner have a point in common iff an edge of one of them meets the other. Facets with a common
/// corner v have more than it in common iff the edge opposite to v does, of one or of the other: whichever comes first on the
/// ray from v through another common point.
bool facets_intersect(const ComparedFacet& s, const ComparedFacet& t) {
  const CommonCorners common(s, t);
  const int count = common.count;
  AMPS_ASSERT(count < 3);  // a facet that is there already is not compared
  if (parted_by_edge(s, common.of_first, t, common.of_second, count, s.seen.axis)) return false;
  if (count == 2) return folded_over(s, common.of_first, t, common.of_second);
  if (parted_by_edge(t, common.of_second, s, common.of_first, count, s.seen.axis)) return false;
  const SidesOfPlane of_t(t, common.of_second, count, s);
  if (of_t.beyond(count)) return false;
  const SidesOfPlane of_s(s, common.of_first, count, t);
  if (of_s.beyond(count)) return false;
  return edges_meet_facet(s, common.of_first, of_s, count, t) || edges_meet_facet(t, common.of_second, of_t, count, s);
}

// All pairs

/// The least max_pairs of the pairs that are added, whatever their order; several threads may add.
class LeastPairs {
 public:
  explicit LeastPairs(Index max_pairs) : max_pairs_(detail::slot(max_pairs)) {}

  void add(const std::vector<SelfIntersection>& pairs) {
    const std::lock_guard<std::mutex> lock(mutex_);
    num_pairs_ += static_cast<std::int64_t>(pairs.size());
    for (const SelfIntersection& pair : pairs) {
      if (!full_ || pair < greatest_) kept_.push_back(pair);
    }
    if (kept_.size() / 2 > max_pairs_) drop_greatest();
  }

  std::int64_t num_pairs() const { return num_pairs_; }

  std::vector<SelfIntersection> sorted(const Execution& run) {
    drop_greatest();
    constexpr std::uint64_t kComparisonsPerLook = 1 << 18;
    std::uint64_t comparisons = 0;
    std::sort(kept_.begin(), kept_.end(), [&](const SelfIntersection& a, const SelfIntersection& b) {
      if (++comparisons % kComparisonsPerLook == 0) run.report(0);
      return a < b;
    });
    return std::move(kept_);
  }

 private:
  void drop_greatest() {
    if (kept_.size() <= max_pairs_) return;
    const auto end = kept_.begin() + static_cast<std::ptrdiff_t>(max_pairs_);
    std::nth_element(kept_.begin(), end, kept_.end());
    greatest_ = *end;
    full_ = true;
    kept_.erase(end, kept_.end());
  }

  std::size_t max_pairs_;
  std::mutex mutex_;
  std::vector<SelfIntersection> kept_;
  std::int64_t num_pairs_ = 0;
  bool full_ = false;
  SelfIntersection greatest_{};  ///< if full: what is not less is not among the least
};

/// Facets in the order of a curve, so that those in line are near each other, and the boxes of each four of them, of each four
/// of these boxes, and so on.
class FacetBoxes {
 public:
  FacetBoxes(ComparedFacets facets, const Execution& run) : facets_(std::move(facets)) {
    levels_.emplace_back(facets_.size());
    detail::for_each_index_on_all_threads(facets_.size(), run, [this](std::size_t i) {
      const auto& x = facets_[i].corners;
      ClosedBox& box = levels_[0][i];
      for (std::size_t k = 0; k < 3; ++k) {
        box.min[k] = std::min({x[0][k], x[1][k], x[2][k]});
        box.max[k] = std::max({x[0][k], x[1][k], x[2][k]});
      }
    });
    while (levels_.back().size() > 1) {
      const Boxes& below = levels_.back();
      Boxes level((below.size() + kArity - 1) / kArity);
      detail::for_each_index_on_all_threads(level.size(), run, [&](std::size_t i) {
        level[i] = below[kArity * i];
        for (std::size_t k = kArity * i + 1; k < std::min(kArity * (i + 1), below.size()); ++k) level[i].add(below[k]);
      });
      levels_.push_back(std::move(level));
    }
  }

  /// Parts of the line, some 256 facets each.
  std::size_t num_parts() const { return levels_[level_of_parts()].size(); }

  /// visit(s, t) for each two facets whose boxes meet and of which the first in line is in this part. What is near a box is
  /// near to those that it is made of: so they search among the boxes that it has found, not among all.
  template <class Visit>
  void pairs_of_part(std::size_t part, const Execution& run, const Visit& visit) const {
    const std::size_t level = level_of_parts();
    NearBoxes near;
    find_near(levels_.size() - 1, 0, level, part, near[level].boxes);
    near[level].count = near[level].boxes.size();
    search(level, part, near, run, visit);
  }

 private:
  using Boxes = std::vector<ClosedBox, detail::UninitializedAllocator<ClosedBox>>;
  static constexpr std::size_t kArity = 4, kPartLevel = 4;

  struct BoxList {
    std::vector<std::size_t> boxes;  ///< the first `count` of these
    std::size_t count = 0;
  };
  /// By level: boxes that meet one of it, from that on.
  using NearBoxes = std::array<BoxList, kPartLevel + 1>;

  std::size_t level_of_parts() const { return std::min(kPartLevel, levels_.size() - 1); }

  template <class Body>
  void for_each_child(std::size_t level, std::size_t node, const Body& body) const {
    const std::size_t begin = kArity * node, end = std::min(begin + kArity, levels_[level - 1].size());
    for (std::size_t child = begin; child < end; ++child) body(child);
  }

  /// Lists the boxes below `node` that meet that of the part, of its level and from it on.
  void find_near(std::size_t level, std::size_t node, std::size_t part_level, std::size_t part,
                 std::vector<std::size_t>& near) const {
    if (level == part_level) {
      if (node >= part) near.push_back(node);
      return;
    }
    for_each_child(level, node, [&](std::size_t child) {
      if (levels_[level - 1][child].meets(levels_[part_level][part])) find_near(level - 1, child, part_level, part, near);
    });
  }

  template <class Visit>
  void search(std::size_t level, std::size_t node, NearBoxes& near, const Execution& run, const Visit& visit) const {
    if (level == 0) {
      for (std::size_t k = 0; k < near[0].count; ++k) {
        if (near[0].boxes[k] > node) visit(facets_[node], facets_[near[0].boxes[k]]);
      }
      return;
    }
    const Boxes& boxes = levels_[level - 1];
    const BoxList& of_node = near[level];
    BoxList& of_child = near[level - 1];
    if (of_child.boxes.size() < kArity * of_node.count) of_child.boxes.resize(2 * kArity * of_node.count);
    for_each_child(level, node, [&](std::size_t child) {
      const ClosedBox box = boxes[child];
      std::size_t* const found = of_child.boxes.data();
      std::size_t count = 0;
      for (std::size_t k = 0; k < of_node.count; ++k) {
        for_each_child(level, of_node.boxes[k], [&](std::size_t i) {  // no branch: which it is cannot be predicted
          found[count] = i;
          count += (i >= child) & boxes[i].meets(box);
        });
      }
      of_child.count = count;
      if (level > 1) run.check();
      search(level - 1, child, near, run, visit);
    });
  }

  ComparedFacets facets_;
  std::vector<Boxes> levels_;  ///< of single facets first; the last one has one box
};

/// The facets that are compared, those left out counted. In the order of a curve through the middles of their boxes.
ComparedFacets compared_facets(const MeshView& mesh, SelfIntersectionReport& report, const Execution& run) {
  const std::vector<Index> vertices = detail::first_equal_vertices(mesh, run.part(0, 0.2));
  std::vector<char> counted;
  detail::resize_watched(counted, detail::slot(mesh.num_facets()), char{1}, run);
  for (const Index f : detail::find_repeated_facets(mesh, run.part(0.2, 0.4))) {
    counted[detail::slot(f)] = 0;
    ++report.repeated_facets;
  }
  std::vector<Projection> projections(counted.size());
  detail::for_each_index_on_all_threads(counted.size(), run.part(0.4, 0.5), [&](std::size_t i) {
    const auto f = static_cast<Index>(i);
    if (counted[i] != 0) projections[i] = best_projection(mesh.corner(f, 0), mesh.corner(f, 1), mesh.corner(f, 2));
  });
  std::vector<Index> kept;
  kept.reserve(counted.size());
  for (std::size_t f = 0; f < counted.size(); ++f) {
    if (counted[f] == 0) continue;
    if (projections[f].turn != 0) {
      kept.push_back(static_cast<Index>(f));
    } else {
      ++report.degenerate_facets;
    }
  }
  Points middles(static_cast<std::ptrdiff_t>(kept.size()));
  detail::for_each_index_on_all_threads(kept.size(), run.part(0.5, 0.6), [&](std::size_t i) {
    const Vec3 a = mesh.corner(kept[i], 0), b = mesh.corner(kept[i], 1), c = mesh.corner(kept[i], 2);
    const Vec3 middle = a.cwiseMin(b).cwiseMin(c) / 2 + a.cwiseMax(b).cwiseMax(c) / 2;
    for (int k = 0; k < 3; ++k) middles(static_cast<std::ptrdiff_t>(i), k) = middle[k];
  });
  ComparedFacets facets(kept.size());
  const std::vector<Index> order = detail::curve_order(middles, run.part(0.6, 0.85));
  detail::for_each_index_on_all_threads(order.size(), run.part(0.85, 1), [&](std::size_t i) {
    ComparedFacet& facet = facets[i];
    facet.facet = kept[detail::slot(order[i])];
    facet.seen = projections[detail::slot(facet.facet)];
    for (int k = 0; k < 3; ++k) {
      const Vec3 x = mesh.corner(facet.facet, k);
      facet.corners[static_cast<std::size_t>(k)] = {x[0], x[1], x[2]};
      facet.vertices[static_cast<std::size_t>(k)] = vertices[detail::slot(mesh.triangles(facet.facet, k))];
    }
  });
  return facets;
}

void require_comparable(const MeshView& mesh, const Execution& run) {
  bounding_box(mesh, run.part(0, 0.5));  // throws for counts and indices out of range
  detail::for_each_index_on_all_threads(detail::slot(mesh.num_facets()), run.part(0.5, 1), [&](std::size_t i) {
    const auto f = static_cast<Index>(i);
    for (int k = 0; k < 3; ++k) {
      if (mesh.corner(f, k).allFinite()) continue;
      throw Error(ErrorCode::kInvalidMesh, "self-intersections: vertex " + std::to_string(mesh.triangles(f, k)) +
                                               " (0-based) has a coordinate that is NaN or infinite; remove or correct it");
    }
  });
}

/// Compares each two facets whose boxes meet.
void compare_facets(const FacetBoxes& boxes, LeastPairs& found, const Execution& run) {
  constexpr std::uint64_t kComparisonsPerLook = 256;  // 50 ms where all have coordinates of 1e±300
  constexpr std::size_t kPairsPerAdding = 4096;
  detail::for_each_piece_on_all_threads(boxes.num_parts(), 1, run, [&](std::size_t part, std::size_t) {
    std::vector<SelfIntersection> pairs;
    std::uint64_t comparisons = 0;
    boxes.pairs_of_part(part, run, [&](const ComparedFacet& s, const ComparedFacet& t) {
      if (++comparisons % kComparisonsPerLook == 0) run.check();
      if (!facets_intersect(s, t)) return;
      pairs.push_back({std::min(s.facet, t.facet), std::max(s.facet, t.facet)});
      if (pairs.size() < kPairsPerAdding) return;
      found.add(pairs);
      pairs.clear();
    });
    found.add(pairs);
  });
}

}  // namespace

SelfIntersectionReport find_self_intersections(const MeshView& mesh, const SelfIntersectionOptions& options) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) return find_self_intersections(scale.mesh(mesh), options);
  detail::require_exact_arithmetic();
  const Execution run = options.execution.start("finding self-intersections");
  if (options.max_pairs < 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "self-intersections: max_pairs is " + std::to_string(options.max_pairs) + "; 0 is the least, to count only");
  }
  require_comparable(mesh, run.part(0, 0.05));
  SelfIntersectionReport report;
  ComparedFacets facets = compared_facets(mesh, report, run.part(0.05, 0.35));
  const FacetBoxes boxes(std::move(facets), run.part(0.35, 0.4));
  LeastPairs found(options.max_pairs);
  compare_facets(boxes, found, run.part(0.4, 0.98));
  report.num_pairs = found.num_pairs();
  report.pairs = found.sorted(run.part(0.98, 1));
  run.finish();
  return report;
}

std::ostream& operator<<(std::ostream& out, const SelfIntersectionReport& report) {
  if (report.empty()) return out << "no self-intersections";
  out << report.num_pairs << (report.num_pairs == 1 ? " pair" : " pairs") << " of facets that intersect";
  if (!report.pairs.empty()) out << ", such as " << report.pairs[0].a << " and " << report.pairs[0].b;
  return out;
}

}  // namespace amps
