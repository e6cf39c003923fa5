// Gradation: how fast the radius may change along the surface. Persson, "Mesh size functions for implicit geometries and
// PDE-based gradient limiting", 2006, solved as in fast marching (Kimmel & Sethian 1998) on the lattice triangles of all
// facets.
#define AMPS_OWN_SOURCE
#include "amps/sizing_lattice.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

namespace amps {
namespace detail {
namespace {

/// All lattice nodes of a mesh, those on shared edges and at vertices of equal position being one. Where facets beside an edge
/// have different lattices, it has the nodes of the finest.
class NodeGraph {
 public:
  NodeGraph(const SizingLattice& lattice, const Execution& execution)
      : lattice_(lattice), welded_(merge_equal_vertices(lattice.mesh, execution.part(0, 0.3))) {
    count_ = static_cast<Index>(welded_.vertices.rows());
    if (!lattice.simple()) number_edges(execution.part(0.3, 0.45));
    node_.reserve(lattice.num_nodes());
    for_each_index(lattice.num_facets(), execution.part(0.45, 0.55), [this](Index f) { number_facet(f); });
    place_nodes(execution.part(0.55, 0.7));
    list_triangles(execution.part(0.7, 1));
  }

  Index size() const { return count_; }
  /// Of the n-th entry of a field's table.
  Index node(std::size_t n) const { return node_[n]; }
  Vec3 position(Index node) const { return positions_[slot(node)]; }

  /// A lattice triangle as one of its nodes sees it: what a turn of the node reads lies together.
  struct Corner {
    std::array<Index, 2> other;    ///< the other two, in the order of the facet
    std::array<double, 2> length;  ///< of the edges to them
    double opposite;               ///< of the edge between them
  };
  /// Those of each node: `corners[begin[node]] … `.
  std::vector<std::size_t> begin;
  std::vector<Corner> corners;

  std::array<Index, 3> nodes_of_piece(std::size_t i) const {
    const Index f = lattice_.simple() ? static_cast<Index>(i) : lattice_.piece_facet[i];
    const Index* const node = node_.data() + lattice_.node(f);
    if (lattice_.level(f) == 0) return {node[0], node[1], node[2]};
    const LatticeTriangle triangle = nth_lattice_triangle(lattice_.k(f), i - lattice_.piece(f));
    std::array<Index, 3> nodes;
    for (std::size_t k = 0; k < 3; ++k)
      nodes[k] = node[lattice_node(lattice_.k(f), triangle.corner[k][0], triangle.corner[k][1])];
    return nodes;
  }

 private:
  void list_triangles(const Execution& execution) {
    begin.assign(slot(count_) + 1, 0);
    for_each_index(lattice_.num_pieces(), execution.part(0, 0.3), [&](std::size_t i) {
      for (const Index v : nodes_of_piece(i)) ++begin[slot(v) + 1];
    });
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    corners.resize(3 * lattice_.num_pieces());
    std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
    for_each_index(lattice_.num_pieces(), execution.part(0.3, 0.7), [&](std::size_t i) {
      const std::array<Index, 3> v = nodes_of_piece(i);
      for (std::size_t k = 0; k < 3; ++k) corners[next[slot(v[k])]++].other = {v[(k + 1) % 3], v[(k + 2) % 3]};
    });
    for_each_index_on_all_threads(slot(count_), execution.part(0.7, 1), [&](std::size_t v) {
      for (std::size_t i = begin[v]; i < begin[v + 1]; ++i) {
        const Vec3 a = position(corners[i].other[0]), b = position(corners[i].other[1]);
        corners[i].length = {norm(a - positions_[v]), norm(b - positions_[v])};
        corners[i].opposite = norm(b - a);
      }
    });
  }

  void number_edges(const Execution& execution) {
    first_side_ = first_sides(welded_.triangles, static_cast<Index>(welded_.vertices.rows()), execution.part(0, 0.8));
    edge_level_.assign(first_side_.size(), 0);
    for_each_index(first_side_.size(), execution.part(0.8, 0.9), [this](std::size_t s) {
      std::uint8_t& level = edge_level_[first_side_[s]];
      level = std::max(level, lattice_.levels[s / 3]);
    });
    edge_node_.assign(first_side_.size(), kNone);
    for_each_index(first_side_.size(), execution.part(0.9, 1), [this](std::size_t s) {
      if (first_side_[s] != s) return;
      edge_node_[s] = count_;
      count_ += (Index{1} << edge_level_[s]) - 1;
    });
  }

  void number_facet(Index f) {
    if (lattice_.level(f) == 0) {
      for (int c = 0; c < 3; ++c) node_.push_back(welded_.triangles(f, c));
      return;
    }
    const Index k = lattice_.k(f);
    for (Index j = 0; j <= k; ++j) {
      for (Index i = 0; i + j <= k; ++i) {
        const PlaceOnSide place = place_on_side(k, i, j);
        node_.push_back(place.side < 0 ? count_++ : node_on_side(f, k, place));
      }
    }
  }

  Index node_on_side(Index f, Index k, const PlaceOnSide& place) const {
    const Index start = welded_.triangles(f, place.side);
    if (place.steps == 0) return start;
    const std::size_t first = first_side_[3 * slot(f) + slot(place.side)];
    const Index edge_k = Index{1} << edge_level_[first];
    const Index steps = place.steps * (edge_k / k);
    // An edge's nodes are counted from the start of its first side.
    const bool same = welded_.triangles(static_cast<std::ptrdiff_t>(first / 3), static_cast<int>(first % 3)) == start;
    return edge_node_[first] + (same ? steps : edge_k - steps) - 1;
  }

  void place_nodes(const Execution& execution) {
    positions_.resize(slot(count_));
    for_each_index_on_all_threads(
        static_cast<std::size_t>(welded_.vertices.rows()), execution.part(0, 0.5),
        [this](std::size_t v) { positions_[v] = welded_.vertices.row(static_cast<Index>(v)).transpose(); });
    const MeshView mesh(lattice_.mesh);
    for_each_index(lattice_.num_facets(), execution.part(0.5, 1), [&](Index f) {
      if (lattice_.level(f) == 0) return;
      std::size_t n = lattice_.node(f);
      const Index k = lattice_.k(f);
      const std::array<Vec3, 3> corner{mesh.corner(f, 0), mesh.corner(f, 1), mesh.corner(f, 2)};
      for (Index j = 0; j <= k; ++j) {
        for (Index i = 0; i + j <= k; ++i) {
          const Vec3 b = lattice_barycentric(k, i, j);
          positions_[slot(node_[n++])] = b[0] * corner[0] + b[1] * corner[1] + b[2] * corner[2];
        }
      }
    });
  }

  const SizingLattice& lattice_;
  Mesh welded_;
  Index count_ = 0;
  std::vector<Index> node_;
  std::vector<Vec3> positions_;
  std::vector<std::size_t> first_side_;
  std::vector<std::uint8_t> edge_level_;
  std::vector<Index> edge_node_;
};

/// A radius at each node of a graph, and how fast it grows with the factor of the field that is limited: as the radius where
/// the limit comes from, unlimited. By it the limited field at another factor is foreseen up to second order, from above.
struct LimitedRadii {
  std::vector<double> value, growth;
};

/// Lowers radii to the largest values that no lattice triangle can lower further, smallest first as Dijkstra's algorithm does;
/// a node that is lowered after its turn (obtuse triangles) has another one.
class GradationRun {
 public:
  GradationRun(const NodeGraph& graph, double gradation, LimitedRadii& radii) : graph_(graph), g_(gradation), radii_(radii) {}

  void run(const Execution& execution) {
    find_first_sources(execution.part(0, kSourcesShare));
    // Every node has about one turn.
    Ticker ticker(execution.part(kSourcesShare, 1), slot(graph_.size()));
    while (!heap_.empty()) {
      ticker.tick();
      std::pop_heap(heap_.begin(), heap_.end(), std::greater<>());
      const auto [value, node] = heap_.back();
      heap_.pop_back();
      if (value == at(node)) lower_around(node);
    }
  }

 private:
  static constexpr double kSourcesShare = 0.2;  ///< of the time
  // Along edges, smaller steps are rounding. Across triangles they are no better than the scheme is, and among needles, which
  // lower each other in turn, there is no end of them.
  static constexpr double kEdgeStep = 1e-13, kTriangleStep = 1e-4;

  struct Lowered {
    double value, growth;
  };

  double at(Index node) const { return radii_.value[slot(node)]; }

  /// Is `to` too large beside `from`, over an edge of this length?
  bool lowers_along(double from, double to, double length) const { return from + g_ * length < to * (1 - kEdgeStep); }

  /// A triangle with the node to be lowered last; corners in the order of the facet.
  struct Across {
    Index a, b, c;
    double to_a, to_b, length;  ///< of the edges from c, and from a to b
  };

  /// c by the smallest u(x) + g·|x − c| over the inside of the edge from a to b, on which u is linear, if that is below `now`
  /// by more than the step.
  bool lowers_across(const Across& t, double now, Lowered& lowered) const {
    if (!(t.length > 0)) return false;
    const double ua = at(t.a), ub = at(t.b);
    // It falls from both ends towards the inside: its slopes there are (ub − ua)/length ∓ g·cos of the angle at a, b.
    const double squares = t.length * t.length + (t.to_a + t.to_b) * (t.to_a - t.to_b);
    if (!(2 * (ub - ua) * t.to_a < g_ * squares)) return false;
    if (!(2 * (ua - ub) * t.to_b < g_ * (2 * t.length * t.length - squares))) return false;
    const double slope = (ub - ua) / t.length, rest = g_ * g_ - slope * slope;
    if (!(rest > 0)) return false;
    const Vec3 pa = graph_.position(t.a), ac = graph_.position(t.c) - pa;
    const Vec3 along = (graph_.position(t.b) - pa) / t.length;
    const double foot = dot(along, ac), height = norm(ac - foot * along);
    // d/dx (ua + slope·x + g √((x − foot)² + height²)) = 0.
    const double root = std::sqrt(rest), x = foot - slope * height / root;
    if (!(x > 0 && x < t.length)) return false;
    lowered.value = ua + slope * foot + height * root;
    if (!(lowered.value < now * (1 - kTriangleStep))) return false;
    const double ga = radii_.growth[slot(t.a)], gb = radii_.growth[slot(t.b)];
    lowered.growth = ga + x / t.length * (gb - ga);
    return true;
  }

  /// Nodes that lower others and are not lowered by any: all the rest follows from these, since whatever lowers is smaller.
  void find_first_sources(const Execution& execution) {
    std::vector<std::atomic<char>> lowers(slot(graph_.size()));
    std::vector<char> is_lowered(slot(graph_.size()), 0);
    for_each_index_on_all_threads(slot(graph_.size()), execution.part(0, 0.9), [&](std::size_t n) {
      const auto c = static_cast<Index>(n);
      for (std::size_t i = graph_.begin[n]; i < graph_.begin[n + 1]; ++i) {
        const NodeGraph::Corner& corner = graph_.corners[i];
        const auto [a, b] = corner.other;
        const bool by_a = lowers_along(at(a), at(c), corner.length[0]), by_b = lowers_along(at(b), at(c), corner.length[1]);
        const Index low = at(a) < at(b) ? a : b;
        Lowered across;
        const bool by_both =
            at(c) > at(low) && lowers_across({a, b, c, corner.length[0], corner.length[1], corner.opposite}, at(c), across);
        if (by_a) lowers[slot(a)].store(1, std::memory_order_relaxed);
        if (by_b) lowers[slot(b)].store(1, std::memory_order_relaxed);
        if (by_both) lowers[slot(low)].store(1, std::memory_order_relaxed);
        if (by_a || by_b || by_both) is_lowered[n] = 1;
      }
    });
    for_each_index(graph_.size(), execution.part(0.9, 1), [&](Index n) {
      if (lowers[slot(n)] != 0 && is_lowered[slot(n)] == 0) heap_.emplace_back(at(n), n);
    });
    std::make_heap(heap_.begin(), heap_.end(), std::greater<>());
  }

  void lower_around(Index node) {
    const double value = at(node), growth = radii_.growth[slot(node)];
    lowered_.clear();
    for (std::size_t i = graph_.begin[slot(node)]; i < graph_.begin[slot(node) + 1]; ++i) {
      const NodeGraph::Corner& corner = graph_.corners[i];
      for (std::size_t k = 0; k < 2; ++k) {
        const Index target = corner.other[k], opposite = corner.other[1 - k];
        const double now = at(target), to_node = corner.length[k];
        if (now <= std::min(value, at(opposite))) continue;
        Lowered best{now, 0}, across;
        if (lowers_along(value, now, to_node)) best = {value + g_ * to_node, growth};
        const Across triangle = k == 0 ? Across{opposite, node, target, corner.opposite, to_node, corner.length[1]}
                                       : Across{node, opposite, target, to_node, corner.opposite, corner.length[0]};
        if (lowers_across(triangle, best.value, across)) best = across;
        if (!(best.value < now)) continue;
        radii_.value[slot(target)] = best.value;
        radii_.growth[slot(target)] = best.growth;
        if (std::find(lowered_.begin(), lowered_.end(), target) == lowered_.end()) lowered_.push_back(target);
      }
    }
    for (const Index target : lowered_) {
      heap_.emplace_back(at(target), target);
      std::push_heap(heap_.begin(), heap_.end(), std::greater<>());
    }
  }

  const NodeGraph& graph_;
  double g_;
  LimitedRadii& radii_;
  std::vector<std::pair<double, Index>> heap_;
  std::vector<Index> lowered_;  ///< in one turn
};

void require_gradation(double gradation) {
  if (!(gradation > 0)) refuse_sizing("the gradation " + number_text(gradation) + " is not positive");
}

constexpr const char* kGradationStage = "limiting the gradation";

/// limited() for several multiples of one field.
class GradationLimiter {
 public:
  GradationLimiter(const SizingField& field, const Execution& execution)
      : lattice_(SizingFieldAccess::lattice(field)),
        scale_(SizingFieldAccess::scale(field)),
        graph_(*lattice_, execution.part(0, 0.95)),
        smallest_(slot(graph_.size()), std::numeric_limits<double>::infinity()) {
    const std::vector<double>& nodes = SizingFieldAccess::nodes(field);
    for_each_index(nodes.size(), execution.part(0.95, 1), [&](std::size_t n) {
      double& smallest = smallest_[slot(graph_.node(n))];
      smallest = std::min(smallest, nodes[n]);
    });
  }

  /// The limited multiple itself, or what is above it, to be limited.
  LimitedRadii unlimited(double factor) const {
    LimitedRadii radii{smallest_, smallest_};
    for (double& r : radii.value) r *= factor;
    return radii;
  }
  /// What is foreseen for another factor, nowhere below the limited field.
  void foresee(double factor_before, double factor, LimitedRadii& radii) const {
    for (std::size_t n = 0; n < smallest_.size(); ++n) {
      if (std::isinf(radii.growth[n])) continue;  // radii that nothing bounds
      const double highest = factor * smallest_[n];
      radii.value[n] += (factor - factor_before) * radii.growth[n];
      if (radii.value[n] < highest) continue;
      radii.value[n] = highest;
      radii.growth[n] = smallest_[n];
    }
  }

  SizingField limited(double gradation, LimitedRadii& radii, const Execution& execution) const {
    GradationRun(graph_, gradation, radii).run(execution.part(0, 0.9));
    std::vector<double> nodes(lattice_->num_nodes());
    for_each_index(nodes.size(), execution.part(0.9, 0.96),
                   [&](std::size_t n) { nodes[n] = radii.value[slot(graph_.node(n))]; });
    return SizingFieldAccess::of_scale(SizingFieldAccess::make(lattice_, std::move(nodes), execution.part(0.96, 1)), scale_);
  }

  /// The change of the factor at which the mean size of disks, 1/√∫dA/r² as foreseen, is `growth` times what it is; infinite
  /// where that foresees nothing.
  double change_for(double growth, const LimitedRadii& radii, const Execution& execution) const {
    if (node_area_.empty()) spread_areas(execution);
    // Newton's method; the mean size is nearly linear in the factor.
    constexpr int kMaxNewtonSteps = 6;
    double change = 0, wanted = 0;
    for (int step = 0; step < kMaxNewtonSteps; ++step) {
      double integral = 0, slope = 0, least = kNothing;
      for_each_index(smallest_.size(), execution, [&](std::size_t n) {
        if (std::isinf(radii.growth[n])) return;
        const double r = radii.value[n] + change * radii.growth[n];
        least = std::min(least, r);
        if (!(r > 0)) return;
        const double density = node_area_[n] / (r * r);
        integral += density;
        slope += density * radii.growth[n] / r;
      });
      if (!(least > 0 && slope > 0)) return kNothing;
      const double mean = 1 / std::sqrt(integral);
      if (step == 0) wanted = growth * mean;
      const double next = change + (wanted - mean) * integral / (slope * mean);
      if (!(std::abs(next - change) > kEnough * std::abs(next))) return next;
      change = next;
    }
    return change;
  }

 private:
  static constexpr double kNothing = std::numeric_limits<double>::infinity();
  static constexpr double kEnough = 1e-3;  ///< of a change: what is foreseen is not better

  /// A third of the area of each lattice triangle to each of its nodes.
  void spread_areas(const Execution& execution) const {
    node_area_.assign(smallest_.size(), 0);
    for_each_index(lattice_->num_pieces(), execution, [&](std::size_t t) {
      const Index f = lattice_->simple() ? static_cast<Index>(t) : lattice_->piece_facet[t];
      const double k = lattice_->k(f), area = lattice_->areas[slot(f)] / (k * k);
      for (const Index node : graph_.nodes_of_piece(t)) node_area_[slot(node)] += area / 3;
    });
  }

  const std::shared_ptr<const SizingLattice> lattice_;
  const MeshScale scale_;
  NodeGraph graph_;
  std::vector<double> smallest_;           ///< by node of the graph: where entries of the table disagree, the smallest
  mutable std::vector<double> node_area_;  ///< once asked for
};

}  // namespace
}  // namespace detail

SizingField SizingField::limited(double gradation, const Execution& execution) const {
  detail::require_gradation(gradation);
  if (std::isinf(gradation)) return *this;
  const Execution job = execution.start(detail::kGradationStage);
  const detail::GradationLimiter limiter(*this, job.part(0, 0.18));
  detail::LimitedRadii radii = limiter.unlimited(1);
  SizingField result = limiter.limited(gradation, radii, job.part(0.18, 1));
  job.finish();
  return result;
}

SizingField for_count(const SizingField& field, double count, double gradation, const Execution& execution) {
  detail::require_gradation(gradation);
  const Execution job = execution.start(detail::kGradationStage);
  const double unlimited = count_factor(field, count, job.part(0, 0.01));
  if (std::isinf(gradation)) {
    SizingField result = field.scaled(unlimited, job.part(0.01, 1));
    job.finish();
    return result;
  }
  double from = 0.2;
  const detail::GradationLimiter limiter(field, job.part(0.01, from));
  // The mean size of disks over the wanted one grows with s. The limit makes disks smaller, so s is not below `unlimited`. Each
  // step goes where the field as foreseen has the wanted mean, which is off by the second order of the step.
  constexpr double kClose = 2.5e-3;  // counts depart from the integral by more than twice that anyway
  constexpr int kMaxSteps = 40, kForeseenSteps = 8;
  double low = 0, high = std::numeric_limits<double>::infinity(), s = unlimited;
  detail::LimitedRadii radii = limiter.unlimited(s);
  for (int step = 0;; ++step) {
    // The first step limits everything, others change little.
    const double to = from + (1 - from) * (step == 0 ? 0.6 : 0.5), counting = from + 0.8 * (to - from);
    SizingField result = limiter.limited(gradation, radii, job.part(from, counting));
    const double off = 1 / count_factor(result, count, job.part(counting, to)) - 1;
    if (std::abs(off) < kClose || step == kMaxSteps) {
      job.finish();
      return result;
    }
    from = to;
    (off < 0 ? low : high) = s;
    double next = s + limiter.change_for(1 / (1 + off), radii, job.part(from, from));
    if (!(next > low && next < high) || step >= kForeseenSteps) next = std::isinf(high) ? 2 * s : (low + high) / 2;
    limiter.foresee(s, next, radii);
    s = next;
  }
}

}  // namespace amps
