// Gradation: how fast the radius may change along the surface. Persson, "Mesh size functions for implicit geometries and
// PDE-based gradient limiting", 2006, solved as in fast marching (Kimmel & Sethian 1998) on the lattice triangles of all
// facets.
#define AMPS_OWN_SOURCE
#include "amps/sizing_lattice.h"

#include <functional>
#include <limits>
#include <numeric>

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

  /// Lattice triangles at each node: `triangles[begin[node]] … `, as numbers of triples in `corners`.
  std::vector<std::array<Index, 3>> corners;
  std::vector<std::size_t> begin;
  std::vector<std::size_t> triangles;

 private:
  void list_triangles(const Execution& execution) {
    corners.reserve(lattice_.num_pieces());
    begin.assign(slot(count_) + 1, 0);
    for_each_index(lattice_.num_pieces(), execution.part(0, 0.5), [&](std::size_t i) {
      const Index f = lattice_.simple() ? static_cast<Index>(i) : lattice_.piece_facet[i];
      const LatticeTriangle triangle = nth_lattice_triangle(lattice_.k(f), i - lattice_.piece(f));
      std::array<Index, 3> nodes;
      for (std::size_t c = 0; c < 3; ++c) {
        nodes[c] = node_[lattice_.node(f) + lattice_node(lattice_.k(f), triangle.corner[c][0], triangle.corner[c][1])];
        ++begin[slot(nodes[c]) + 1];
      }
      corners.push_back(nodes);
    });
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    triangles.resize(3 * corners.size());
    std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
    for_each_index(corners.size(), execution.part(0.5, 1), [&](std::size_t t) {
      for (const Index v : corners[t]) triangles[next[slot(v)]++] = t;
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
    std::size_t n = 0;
    const MeshView mesh(lattice_.mesh);
    for_each_index(lattice_.num_facets(), execution, [&](Index f) {
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

/// The smallest u(x) + g·|x − c| over the inside of the segment from a to b, on which u is linear from ua to ub; infinite if
/// the ends are no worse.
double reach_from_segment(const Vec3& a, const Vec3& b, const Vec3& c, double ua, double ub, double g) {
  constexpr double kNoBetter = std::numeric_limits<double>::infinity();
  const double length = norm(b - a);
  if (!(length > 0)) return kNoBetter;
  const Vec3 along = (b - a) / length;
  const double slope = (ub - ua) / length, foot = dot(along, c - a), height = norm(c - a - foot * along);
  const double rest = g * g - slope * slope;
  if (!(rest > 0)) return kNoBetter;
  // d/dt (ua + slope·t + g √((t − foot)² + height²)) = 0.
  const double root = std::sqrt(rest), t = foot - slope * height / root;
  return t > 0 && t < length ? ua + slope * foot + height * root : kNoBetter;
}

/// Lowers u to the largest values that no lattice triangle can lower further, smallest first as Dijkstra's algorithm does; a
/// node that is lowered after its turn (obtuse triangles) has another one.
void limit_gradation(const NodeGraph& graph, double g, const Execution& execution, std::vector<double>& u) {
  // Along edges, smaller steps are rounding. Across triangles they are no better than the scheme is, and among needles, which
  // lower each other in turn, there is no end of them.
  constexpr double kEdgeStep = 1e-13, kTriangleStep = 1e-4;
  using Entry = std::pair<double, Index>;
  std::vector<Entry> heap(u.size());
  for (std::size_t n = 0; n < u.size(); ++n) heap[n] = {u[n], static_cast<Index>(n)};
  std::make_heap(heap.begin(), heap.end(), std::greater<>());
  // Every node has its turn, and some are lowered before it, which leaves an entry without use.
  Ticker ticker(execution, heap.size() + heap.size() / 2);
  while (!heap.empty()) {
    ticker.tick();
    std::pop_heap(heap.begin(), heap.end(), std::greater<>());
    const auto [value, node] = heap.back();
    heap.pop_back();
    if (value != u[slot(node)]) continue;
    const Vec3 p = graph.position(node);
    for (std::size_t i = graph.begin[slot(node)]; i < graph.begin[slot(node) + 1]; ++i) {
      const auto& corner = graph.corners[graph.triangles[i]];
      const std::size_t own = corner[0] == node ? 0 : corner[1] == node ? 1 : 2;
      for (std::size_t k = 1; k <= 2; ++k) {
        const Index target = corner[(own + k) % 3], other = corner[(own + 3 - k) % 3];
        double& now = u[slot(target)];
        if (now <= std::min(value, u[slot(other)])) continue;
        double lowered = value + g * norm(graph.position(target) - p);
        if (!(lowered < now * (1 - kEdgeStep))) lowered = now;
        const double across = reach_from_segment(p, graph.position(other), graph.position(target), value, u[slot(other)], g);
        if (across < lowered * (1 - kTriangleStep)) lowered = across;
        if (!(lowered < now)) continue;
        now = lowered;
        heap.emplace_back(lowered, target);
        std::push_heap(heap.begin(), heap.end(), std::greater<>());
      }
    }
  }
}

void require_gradation(double gradation) {
  if (!(gradation > 0)) refuse_sizing("the gradation " + number_text(gradation) + " is not positive");
}

constexpr const char* kGradationStage = "limiting the gradation";

/// limited() for several multiples of one field.
class GradationLimiter {
 public:
  GradationLimiter(const SizingField& field, const Execution& execution)
      : lattice_(SizingFieldAccess::lattice(field)),
        graph_(*lattice_, execution.part(0, 0.95)),
        smallest_(slot(graph_.size()), std::numeric_limits<double>::infinity()) {
    const std::vector<double>& nodes = SizingFieldAccess::nodes(field);
    for_each_index(nodes.size(), execution.part(0.95, 1), [&](std::size_t n) {
      double& smallest = smallest_[slot(graph_.node(n))];
      smallest = std::min(smallest, nodes[n]);
    });
  }

  SizingField limited(double factor, double gradation, const Execution& execution) const {
    std::vector<double> u = smallest_;
    for (double& r : u) r *= factor;
    limit_gradation(graph_, gradation, execution.part(0, 0.9), u);
    std::vector<double> nodes(lattice_->num_nodes());
    for_each_index(nodes.size(), execution.part(0.9, 0.96), [&](std::size_t n) { nodes[n] = u[slot(graph_.node(n))]; });
    return SizingFieldAccess::make(lattice_, std::move(nodes), execution.part(0.96, 1));
  }

 private:
  const std::shared_ptr<const SizingLattice> lattice_;
  NodeGraph graph_;
  std::vector<double> smallest_;  ///< by node of the graph: where entries of the table disagree, the smallest
};

}  // namespace
}  // namespace detail

SizingField SizingField::limited(double gradation, const Execution& execution) const {
  detail::require_gradation(gradation);
  if (std::isinf(gradation)) return *this;
  const Execution job = execution.start(detail::kGradationStage);
  const detail::GradationLimiter limiter(*this, job.part(0, 0.18));
  SizingField result = limiter.limited(1, gradation, job.part(0.18, 1));
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
  double from = 0.06;
  const detail::GradationLimiter limiter(field, job.part(0.01, from));
  // The mean size of disks over the wanted one grows with s, in proportion where nothing is limited: false position with
  // halving (Illinois) takes a few steps. The limit makes disks smaller, so s is not below `unlimited`.
  constexpr double kClose = 2.5e-3;  // counts depart from the integral by more than twice that anyway
  constexpr int kMaxSteps = 40;
  double low = 0, low_off = -1, high = 0, high_off = 0, last_off = 0, s = unlimited;
  for (int step = 0;; ++step) {
    // Three or four steps are usual; of more, each takes two thirds of what is left.
    const double to = from + (1 - from) / std::max(1.5, 3.8 - step), counting = from + 0.95 * (to - from);
    SizingField result = limiter.limited(s, gradation, job.part(from, counting));
    const double off = 1 / count_factor(result, count, job.part(counting, to)) - 1;
    if (std::abs(off) < kClose || step == kMaxSteps) {
      job.finish();
      return result;
    }
    from = to;
    (off < 0 ? low : high) = s;
    (off < 0 ? low_off : high_off) = off;
    if (last_off * off > 0) (off < 0 ? high_off : low_off) /= 2;  // the same end moved twice
    last_off = off;
    s = high > 0 ? (low * high_off - high * low_off) / (high_off - low_off) : s / (1 + off);
  }
}

}  // namespace amps
