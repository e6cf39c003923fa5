#define AMPS_OWN_SOURCE
#include "amps/sizing.h"

#include "amps/mesh_edges.h"
#include "amps/portable_math.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace amps {

// ---------------------------------------------------------------------------------------------------------------------------
// Lattices

namespace detail {

/// Where the nodes are. With k = 2^level, node (i, j), i + j ≤ k, of a facet has barycentrics (k − i − j, i, j)/k; nodes are
/// stored by j, then i. Piece t of a facet lies in row j; rows alternate upward and downward triangles.
struct SizingLattice {
  Mesh mesh;
  std::vector<double> areas;             ///< by facet
  std::vector<std::uint8_t> levels;      ///< by facet; this and what follows is empty if all are 0
  std::vector<std::size_t> first_node;   ///< #F + 1
  std::vector<std::size_t> first_piece;  ///< #F + 1
  std::vector<Index> piece_facet;

  Index num_facets() const { return static_cast<Index>(mesh.triangles.rows()); }
  bool simple() const { return levels.empty(); }
  int level(Index f) const { return simple() ? 0 : levels[slot(f)]; }
  Index k(Index f) const { return Index{1} << level(f); }
  std::size_t node(Index f) const { return simple() ? 3 * slot(f) : first_node[slot(f)]; }
  std::size_t piece(Index f) const { return simple() ? slot(f) : first_piece[slot(f)]; }
  std::size_t num_nodes() const { return node(num_facets()); }
  std::size_t num_pieces() const { return piece(num_facets()); }
};

struct SizingFieldAccess {
  static SizingField make(std::shared_ptr<const SizingLattice> lattice, std::vector<double> nodes) {
    return {std::move(lattice), std::move(nodes)};
  }
  static const std::shared_ptr<const SizingLattice>& lattice(const SizingField& field) { return field.lattice_; }
  static const std::vector<double>& nodes(const SizingField& field) { return *field.nodes_; }
};

}  // namespace detail

namespace {

using detail::SizingFieldAccess;
using detail::SizingLattice;
using detail::slot;

/// Corners of lattice triangles as (i, j).
struct LatticeTriangle {
  std::array<std::array<Index, 2>, 3> corner;
};

std::size_t nodes_of_lattice(Index k) { return slot(k + 1) * slot(k + 2) / 2; }

/// Place of node (i, j) among those of its facet: rows before j hold k+1, k, … nodes.
std::size_t lattice_node(Index k, Index i, Index j) { return slot(j) * (2 * slot(k) + 3 - slot(j)) / 2 + slot(i); }

Vec3 lattice_barycentric(Index k, Index i, Index j) { return Vec3(k - i - j, i, j) / k; }

LatticeTriangle lattice_triangle(Index i, Index j, bool upward) {
  if (upward) return {{{{i, j}, {i + 1, j}, {i, j + 1}}}};
  return {{{{i + 1, j}, {i + 1, j + 1}, {i, j + 1}}}};
}

/// The t-th triangle of a lattice. Rows from j on hold (k − j)² triangles, so t lies in row j iff (k − j)² ≥ k² − t > (k − j −
/// 1)².
LatticeTriangle nth_lattice_triangle(Index k, std::size_t t) {
  const std::size_t all = slot(k) * slot(k), left = all - t;
  auto side = static_cast<std::size_t>(std::sqrt(static_cast<double>(left)));
  while (side * side < left) ++side;
  while ((side - 1) * (side - 1) >= left) --side;
  const std::size_t within = t - (all - side * side);
  return lattice_triangle(static_cast<Index>(within / 2), k - static_cast<Index>(side), within % 2 == 0);
}

/// The linear interpolant of a facet's nodes; never outside the range of the three it interpolates.
double interpolate_lattice(const double* nodes, Index k, const Vec3& barycentric) {
  const double x = barycentric[1] * k, y = barycentric[2] * k;  // exact: k is a power of two
  const Index j = std::clamp(static_cast<Index>(y), Index{0}, k - 1);
  const Index i = std::clamp(static_cast<Index>(x), Index{0}, k - 1 - j);
  const double u = x - i, v = y - j;
  const bool upward = u + v <= 1 || i + j + 1 == k;
  double a, b, c, s, t;  // a + s (b − a) + t (c − a)
  if (upward) {
    a = nodes[lattice_node(k, i, j)];
    s = u;
    t = v;
  } else {
    a = nodes[lattice_node(k, i + 1, j + 1)];
    s = 1 - v;
    t = 1 - u;
  }
  b = nodes[lattice_node(k, i + 1, j)];
  c = nodes[lattice_node(k, i, j + 1)];
  return std::clamp(a + s * (b - a) + t * (c - a), std::min({a, b, c}), std::max({a, b, c}));
}

/// A lattice of the given levels (empty: k = 1 everywhere).
std::shared_ptr<SizingLattice> make_lattice(Mesh mesh, std::vector<double> areas, std::vector<std::uint8_t> levels) {
  auto lattice = std::make_shared<SizingLattice>();
  lattice->mesh = std::move(mesh);
  lattice->areas = std::move(areas);
  if (std::all_of(levels.begin(), levels.end(), [](std::uint8_t level) { return level == 0; })) return lattice;
  lattice->levels = std::move(levels);
  const std::size_t n = lattice->levels.size();
  lattice->first_node.assign(n + 1, 0);
  lattice->first_piece.assign(n + 1, 0);
  for (std::size_t f = 0; f < n; ++f) {
    const Index k = Index{1} << lattice->levels[f];
    lattice->first_node[f + 1] = lattice->first_node[f] + nodes_of_lattice(k);
    lattice->first_piece[f + 1] = lattice->first_piece[f] + slot(k) * slot(k);
  }
  lattice->piece_facet.resize(lattice->first_piece[n]);
  for (std::size_t f = 0; f < n; ++f) {
    std::fill(lattice->piece_facet.begin() + static_cast<std::ptrdiff_t>(lattice->first_piece[f]),
              lattice->piece_facet.begin() + static_cast<std::ptrdiff_t>(lattice->first_piece[f + 1]), static_cast<Index>(f));
  }
  return lattice;
}

std::shared_ptr<SizingLattice> make_simple_lattice(const MeshView& mesh) {
  require_usable(mesh);
  return make_lattice({mesh.vertices, mesh.triangles}, facet_areas(mesh), {});
}

bool same_mesh(const MeshView& a, const MeshView& b) {
  return a.num_vertices() == b.num_vertices() && a.num_facets() == b.num_facets() && a.triangles == b.triangles &&
         a.vertices == b.vertices;
}

[[noreturn]] void refuse_sizing(const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "sizing: " + what); }

bool is_radius(double r) { return r > 0 && std::isfinite(r); }

// ---------------------------------------------------------------------------------------------------------------------------
// ∫ 1/r² over a triangle, r linear. std::log differs between platforms, and the integrals decide where darts go.

/// (ln b − ln a)/(b − a), also for a = b.
double log_slope(double a, double b) {
  using detail::portable_log;
  const double s = (b - a) / (b + a);
  return std::abs(s) < 0.17 ? 2 * detail::portable_atanh_over(s) / (a + b) : (portable_log(b) - portable_log(a)) / (b - a);
}

/// The mean of 1/r² over a triangle. By Hermite–Genocchi it is 2·F[r₀, r₁, r₂] with F'' = 1/r², so F = −ln. Where the radii
/// differ little the divided difference cancels (its relative error is about ε/spread²); there, with deviations x_i from the
/// mean m in units of m, the mean of 1/(1 + x)² = Σ (−1)ⁿ (n + 1) xⁿ is Σ (−1)ⁿ 2/(n + 2) · h_n(x₀, x₁, x₂): h_n, the complete
/// homogeneous polynomial, follows from h_n = e₁ h_{n−1} − e₂ h_{n−2} + e₃ h_{n−3}, and e₁ = 0.
double mean_inverse_square(const std::array<double, 3>& radii) {
  double a = radii[0], b = radii[1], c = radii[2];
  if (a > b) std::swap(a, b);
  if (b > c) std::swap(b, c);
  if (a > b) std::swap(a, b);
  constexpr double kSeriesSpread = 0.1;
  if (c - a > kSeriesSpread * a) return 2 * (log_slope(a, b) - log_slope(b, c)) / (c - a);
  const double m = a + ((b - a) + (c - a)) / 3;
  const double x = (a - m) / m, y = (b - m) / m, z = -(x + y);
  const double e2 = x * y + z * (x + y), e3 = x * y * z;
  double h3 = 0, h2 = 0, h1 = 1, sum = 1;  // h_{n−3}, h_{n−2}, h_{n−1}
  // |x_i| ≤ 0.067, h_n ≤ (n + 1)(n + 2)/2 · 0.067ⁿ: the remainder is below 1e-15.
  for (int n = 1; n <= 14; ++n) {
    const double h = -e2 * h2 + e3 * h3;
    sum += (n % 2 == 0 ? 2.0 : -2.0) / (n + 2) * h;
    h3 = h2;
    h2 = h1;
    h1 = h;
  }
  return sum / (m * m);
}

}  // namespace

// ---------------------------------------------------------------------------------------------------------------------------
// SizingField

SizingField::SizingField(std::shared_ptr<const SizingLattice> lattice, std::vector<double> nodes)
    : lattice_(std::move(lattice)), nodes_(std::make_shared<const std::vector<double>>(std::move(nodes))) {
  min_ = std::numeric_limits<double>::infinity();
  for (Index f = 0; f < lattice_->num_facets(); ++f) {
    if (!(lattice_->areas[slot(f)] > 0)) continue;
    for (std::size_t n = lattice_->node(f); n < lattice_->node(f + 1); ++n) {
      min_ = std::min(min_, (*nodes_)[n]);
      max_ = std::max(max_, (*nodes_)[n]);
    }
  }
}

bool SizingField::fits(const MeshView& mesh) const { return !empty() && same_mesh(lattice_->mesh, mesh); }

Index SizingField::num_facets() const { return lattice_->num_facets(); }

double SizingField::radius(Index facet, const Vec3& barycentric) const {
  return interpolate_lattice(nodes_->data() + lattice_->node(facet), lattice_->k(facet), barycentric);
}

std::size_t SizingField::num_pieces() const { return lattice_->num_pieces(); }

std::size_t SizingField::first_piece(Index facet) const { return lattice_->piece(facet); }

SizingField::Piece SizingField::piece(std::size_t i) const {
  Piece result;
  result.facet = lattice_->simple() ? static_cast<Index>(i) : lattice_->piece_facet[i];
  const Index k = lattice_->k(result.facet);
  const LatticeTriangle triangle = nth_lattice_triangle(k, i - lattice_->piece(result.facet));
  for (std::size_t c = 0; c < 3; ++c) {
    const auto [x, y] = triangle.corner[c];
    result.corners[c] = lattice_barycentric(k, x, y);
    result.radii[c] = (*nodes_)[lattice_->node(result.facet) + lattice_node(k, x, y)];
  }
  return result;
}

double SizingField::density_integral(std::size_t i) const {
  const Piece p = piece(i);
  const double k = lattice_->k(p.facet), area = lattice_->areas[slot(p.facet)] / (k * k);
  return area > 0 ? area * mean_inverse_square(p.radii) : 0.0;
}

double SizingField::density_integral() const {
  double sum = 0;
  for (std::size_t i = 0; i < num_pieces(); ++i) sum += density_integral(i);
  return sum;
}

SizingField SizingField::scaled(double factor) const {
  if (!is_radius(factor)) refuse_sizing("the factor " + std::to_string(factor) + " is not positive and finite");
  std::vector<double> nodes = *nodes_;
  for (double& r : nodes) {
    r *= factor;
    if (!is_radius(r))
      refuse_sizing("scaled by " + std::to_string(factor) + " a radius is no positive double; use a milder factor");
  }
  return {lattice_, std::move(nodes)};
}

SizingField SizingField::clamped(double least, double greatest) const {
  if (!(is_radius(least) && least <= greatest)) {
    refuse_sizing("cannot clamp to [" + std::to_string(least) + ", " + std::to_string(greatest) +
                  "]; give 0 < least <= greatest");
  }
  std::vector<double> nodes = *nodes_;
  for (double& r : nodes) r = std::min(greatest, std::max(least, r));
  return {lattice_, std::move(nodes)};
}

SizingField min(const SizingField& a, const SizingField& b) {
  if (a.empty() || b.empty()) refuse_sizing("minimum of an empty field; make both from the mesh");
  const auto& la = SizingFieldAccess::lattice(a);
  const auto& lb = SizingFieldAccess::lattice(b);
  if (la != lb && !same_mesh(la->mesh, lb->mesh))
    refuse_sizing("minimum of fields of different meshes; make both from one mesh");
  std::shared_ptr<const SizingLattice> lattice = la;
  if (!lb->simple()) {
    std::vector<std::uint8_t> levels(slot(la->num_facets()));
    for (Index f = 0; f < la->num_facets(); ++f)
      levels[slot(f)] = static_cast<std::uint8_t>(std::max(la->level(f), lb->level(f)));
    if (levels == lb->levels) {
      lattice = lb;
    } else if (levels != la->levels) {
      lattice = make_lattice(la->mesh, la->areas, std::move(levels));
    }
  }
  std::vector<double> nodes(lattice->num_nodes());
  for (Index f = 0; f < lattice->num_facets(); ++f) {
    const Index k = lattice->k(f);
    double* out = nodes.data() + lattice->node(f);
    for (Index j = 0; j <= k; ++j) {
      for (Index i = 0; i + j <= k; ++i) {
        const Vec3 at = lattice_barycentric(k, i, j);
        *out++ = std::min(a.radius(f, at), b.radius(f, at));
      }
    }
  }
  return SizingFieldAccess::make(std::move(lattice), std::move(nodes));
}

SizingField SizingField::with_ratio(double ratio, double quantile) const {
  if (!(ratio >= 1)) refuse_sizing("the ratio " + std::to_string(ratio) + " of greatest to least radius is below 1");
  if (!(quantile >= 0 && quantile < 1)) refuse_sizing("the quantile " + std::to_string(quantile) + " is not in [0, 1)");
  struct Share {
    double radius, area;
  };
  std::vector<Share> shares;
  double total = 0;
  for (std::size_t i = 0; i < num_pieces(); ++i) {
    const Piece p = piece(i);
    const double k = lattice_->k(p.facet), area = lattice_->areas[slot(p.facet)] / (k * k);
    if (!(area > 0)) continue;
    shares.push_back({(p.radii[0] + p.radii[1] + p.radii[2]) / 3, area});
    total += area;
  }
  std::sort(shares.begin(), shares.end(),
            [](const Share& a, const Share& b) { return a.radius != b.radius ? a.radius < b.radius : a.area < b.area; });
  double below = 0, least = shares.front().radius;
  for (const Share& share : shares) {
    least = share.radius;
    below += share.area;
    if (below > quantile * total) break;
  }
  if (quantile == 0) least = min_;
  return clamped(least, ratio * least);
}

double count_factor(const SizingField& field, double count) {
  if (field.empty()) refuse_sizing("number of samples of an empty field; make it from a mesh");
  if (!(count >= 1 && std::isfinite(count)))
    refuse_sizing("cannot place " + std::to_string(count) + " samples; ask for one at least");
  return std::sqrt(kSamplesPerDensity * field.density_integral() / count);
}

// ---------------------------------------------------------------------------------------------------------------------------
// Gradation

namespace {

/// The first side of each side's edge, by side.
std::vector<std::size_t> first_sides(const TrianglesView& triangles, Index num_vertices) {
  const detail::MeshEdges edges(triangles, num_vertices);
  std::vector<std::size_t> first(edges.num_corners());
  for (std::size_t e = 0; e < edges.size(); ++e) {
    for (const detail::EdgeSide& side : edges[e]) first[side.corner()] = edges[e][0].corner();
  }
  return first;
}

/// The side of the facet that node (i, j) of a lattice lies on, and how many lattice edges from its start; corners lie at the
/// start of a side. Side −1: inside.
struct PlaceOnSide {
  int side = -1;
  Index steps = 0;
};

PlaceOnSide place_on_side(Index k, Index i, Index j) {
  if (j == 0 && i < k) return {0, i};
  if (i + j == k && j < k) return {1, j};
  if (i == 0 && j > 0) return {2, k - j};
  return {};
}

/// All lattice nodes of a mesh, those on shared edges and at vertices of equal position being one. Where facets beside an edge
/// have different lattices, it has the nodes of the finest.
class NodeGraph {
 public:
  explicit NodeGraph(const SizingLattice& lattice) : lattice_(lattice), welded_(merge_equal_vertices(lattice.mesh)) {
    count_ = static_cast<Index>(welded_.vertices.rows());
    if (!lattice.simple()) number_edges();
    node_.reserve(lattice.num_nodes());
    for (Index f = 0; f < lattice.num_facets(); ++f) number_facet(f);
    place_nodes();
  }

  Index size() const { return count_; }
  /// Of the n-th entry of a field's table.
  Index node(std::size_t n) const { return node_[n]; }
  Vec3 position(Index node) const { return positions_.row(node).transpose(); }

  /// Lattice triangles at each node: `triangles[begin[node]] … `, as numbers of triples in `corners`.
  std::vector<std::array<Index, 3>> corners;
  std::vector<std::size_t> begin;
  std::vector<std::size_t> triangles;

  void list_triangles() {
    corners.reserve(lattice_.num_pieces());
    begin.assign(slot(count_) + 1, 0);
    for (std::size_t i = 0; i < lattice_.num_pieces(); ++i) {
      const Index f = lattice_.simple() ? static_cast<Index>(i) : lattice_.piece_facet[i];
      const LatticeTriangle triangle = nth_lattice_triangle(lattice_.k(f), i - lattice_.piece(f));
      std::array<Index, 3> nodes;
      for (std::size_t c = 0; c < 3; ++c) {
        nodes[c] = node_[lattice_.node(f) + lattice_node(lattice_.k(f), triangle.corner[c][0], triangle.corner[c][1])];
        ++begin[slot(nodes[c]) + 1];
      }
      corners.push_back(nodes);
    }
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    triangles.resize(3 * corners.size());
    std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
    for (std::size_t t = 0; t < corners.size(); ++t) {
      for (const Index v : corners[t]) triangles[next[slot(v)]++] = t;
    }
  }

 private:
  void number_edges() {
    first_side_ = first_sides(welded_.triangles, static_cast<Index>(welded_.vertices.rows()));
    edge_level_.assign(first_side_.size(), 0);
    for (std::size_t s = 0; s < first_side_.size(); ++s) {
      std::uint8_t& level = edge_level_[first_side_[s]];
      level = std::max(level, lattice_.levels[s / 3]);
    }
    edge_node_.assign(first_side_.size(), kNone);
    for (std::size_t s = 0; s < first_side_.size(); ++s) {
      if (first_side_[s] != s) continue;
      edge_node_[s] = count_;
      count_ += (Index{1} << edge_level_[s]) - 1;
    }
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
    const bool same = welded_.triangles(static_cast<Eigen::Index>(first / 3), static_cast<Eigen::Index>(first % 3)) == start;
    return edge_node_[first] + (same ? steps : edge_k - steps) - 1;
  }

  void place_nodes() {
    positions_.resize(count_, 3);
    std::size_t n = 0;
    for (Index f = 0; f < lattice_.num_facets(); ++f) {
      const Index k = lattice_.k(f);
      for (Index j = 0; j <= k; ++j) {
        for (Index i = 0; i + j <= k; ++i) {
          const Vec3 b = lattice_barycentric(k, i, j);
          positions_.row(node_[n++]) = b[0] * lattice_.mesh.vertices.row(lattice_.mesh.triangles(f, 0)) +
                                       b[1] * lattice_.mesh.vertices.row(lattice_.mesh.triangles(f, 1)) +
                                       b[2] * lattice_.mesh.vertices.row(lattice_.mesh.triangles(f, 2));
        }
      }
    }
  }

  const SizingLattice& lattice_;
  Mesh welded_;
  Index count_ = 0;
  std::vector<Index> node_;
  Points positions_;
  std::vector<std::size_t> first_side_;
  std::vector<std::uint8_t> edge_level_;
  std::vector<Index> edge_node_;
};

/// The smallest u(x) + g·|x − c| over the inside of the segment from a to b, on which u is linear from ua to ub; infinite if
/// the ends are no worse.
double reach_from_segment(const Vec3& a, const Vec3& b, const Vec3& c, double ua, double ub, double g) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const double length = (b - a).norm();
  if (!(length > 0)) return kNone;
  const Vec3 along = (b - a) / length;
  const double slope = (ub - ua) / length, foot = along.dot(c - a), height = (c - a - foot * along).norm();
  const double rest = g * g - slope * slope;
  if (!(rest > 0)) return kNone;
  // d/dt (ua + slope·t + g √((t − foot)² + height²)) = 0.
  const double root = std::sqrt(rest), t = foot - slope * height / root;
  return t > 0 && t < length ? ua + slope * foot + height * root : kNone;
}

/// Lowers u to the largest values that no lattice triangle can lower further, smallest first as Dijkstra's algorithm does; a
/// node that is lowered after its turn (obtuse triangles) has another one.
void limit_gradation(const NodeGraph& graph, double g, std::vector<double>& u) {
  // Along edges, smaller steps are rounding. Across triangles they are no better than the scheme is, and among needles, which
  // lower each other in turn, there is no end of them.
  constexpr double kEdgeStep = 1e-13, kTriangleStep = 1e-4;
  using Entry = std::pair<double, Index>;
  std::vector<Entry> heap(u.size());
  for (std::size_t n = 0; n < u.size(); ++n) heap[n] = {u[n], static_cast<Index>(n)};
  std::make_heap(heap.begin(), heap.end(), std::greater<>());
  while (!heap.empty()) {
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
        double lowered = value + g * (graph.position(target) - p).norm();
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

}  // namespace

namespace {

void require_gradation(double gradation) {
  if (!(gradation > 0)) refuse_sizing("the gradation " + std::to_string(gradation) + " is not positive");
}

/// limited() for several multiples of one field.
class GradationLimiter {
 public:
  explicit GradationLimiter(const SizingField& field)
      : lattice_(SizingFieldAccess::lattice(field)),
        graph_(*lattice_),
        least_(slot(graph_.size()), std::numeric_limits<double>::infinity()) {
    graph_.list_triangles();
    const std::vector<double>& nodes = SizingFieldAccess::nodes(field);
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      double& least = least_[slot(graph_.node(n))];
      least = std::min(least, nodes[n]);
    }
  }

  SizingField limited(double factor, double gradation) const {
    std::vector<double> u = least_;
    for (double& r : u) r *= factor;
    limit_gradation(graph_, gradation, u);
    std::vector<double> nodes(lattice_->num_nodes());
    for (std::size_t n = 0; n < nodes.size(); ++n) nodes[n] = u[slot(graph_.node(n))];
    return SizingFieldAccess::make(lattice_, std::move(nodes));
  }

 private:
  const std::shared_ptr<const SizingLattice> lattice_;
  NodeGraph graph_;
  std::vector<double> least_;  ///< by node of the graph: where entries of the table disagree, the smallest
};

}  // namespace

SizingField SizingField::limited(double gradation) const {
  require_gradation(gradation);
  return std::isinf(gradation) ? *this : GradationLimiter(*this).limited(1, gradation);
}

SizingField for_count(const SizingField& field, double count, double gradation) {
  require_gradation(gradation);
  const double unlimited = count_factor(field, count);
  if (std::isinf(gradation)) return field.scaled(unlimited);
  const GradationLimiter limiter(field);
  // The mean size of disks over the wanted one grows with s, in proportion where nothing is limited: false position with
  // halving (Illinois) takes a few steps. The limit makes disks smaller, so s is not below `unlimited`.
  constexpr double kClose = 2.5e-3;  // counts depart from the integral by more than twice that anyway
  constexpr int kMostSteps = 40;
  double low = 0, low_off = -1, high = 0, high_off = 0, last_off = 0, s = unlimited;
  for (int step = 0;; ++step) {
    SizingField result = limiter.limited(s, gradation);
    const double off = 1 / count_factor(result, count) - 1;
    if (std::abs(off) < kClose || step == kMostSteps) return result;
    (off < 0 ? low : high) = s;
    (off < 0 ? low_off : high_off) = off;
    if (last_off * off > 0) (off < 0 ? high_off : low_off) /= 2;  // the same end moved twice
    last_off = off;
    s = high > 0 ? (low * high_off - high * low_off) / (high_off - low_off) : s / (1 + off);
  }
}

// ---------------------------------------------------------------------------------------------------------------------------
// Factories

SizingField uniform_sizing(const MeshView& mesh, double radius) {
  if (!is_radius(radius)) refuse_sizing("the radius " + std::to_string(radius) + " is not positive and finite");
  auto lattice = make_simple_lattice(mesh);
  const std::size_t n = lattice->num_nodes();
  return SizingFieldAccess::make(std::move(lattice), std::vector<double>(n, radius));
}

SizingField vertex_sizing(const MeshView& mesh, const Eigen::Ref<const Eigen::VectorXd>& radii) {
  auto lattice = make_simple_lattice(mesh);
  if (radii.size() != mesh.num_vertices()) {
    refuse_sizing(std::to_string(radii.size()) + " values for " + std::to_string(mesh.num_vertices()) +
                  " vertices; give one a vertex");
  }
  std::vector<double> nodes(lattice->num_nodes());
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index v = mesh.triangles(f, k);
      if (!is_radius(radii[v])) {
        refuse_sizing("the radius " + std::to_string(radii[v]) + " of vertex " + std::to_string(v) +
                      " (0-based) is not positive and finite; correct it");
      }
      nodes[3 * slot(f) + slot(k)] = radii[v];
    }
  }
  return SizingFieldAccess::make(std::move(lattice), std::move(nodes));
}

SizingField vertex_density_sizing(const MeshView& mesh, const Eigen::Ref<const Eigen::VectorXd>& densities) {
  require_usable(mesh);
  Eigen::VectorXd radii(densities.size());
  for (Eigen::Index v = 0; v < densities.size(); ++v) radii[v] = 1 / std::sqrt(densities[v]);
  for (Index f = 0; f < mesh.num_facets() && densities.size() == mesh.num_vertices(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index v = mesh.triangles(f, k);
      if (is_radius(densities[v]) && is_radius(radii[v])) continue;
      refuse_sizing("the density " + std::to_string(densities[v]) + " of vertex " + std::to_string(v) +
                    " (0-based) is not positive and finite; correct it");
    }
  }
  return vertex_sizing(mesh, radii);
}

namespace {

/// Tabulates a function facet by facet.
class Tabulator {
 public:
  Tabulator(const MeshView& mesh, const SizingFunction& radius, const TabulationOptions& options)
      : mesh_(mesh), radius_(radius), options_(options), areas_(facet_areas(mesh)) {
    levels_.assign(areas_.size(), 0);
    nodes_.reserve(3 * areas_.size());
    at_vertex_.assign(slot(mesh.num_vertices()), 0.0);
  }

  SizingField run() {
    for (Index f = 0; f < mesh_.num_facets(); ++f) tabulate(f);
    return SizingFieldAccess::make(make_lattice({mesh_.vertices, mesh_.triangles}, std::move(areas_), std::move(levels_)),
                                   std::move(nodes_));
  }

 private:
  static constexpr int kLastLevel = 14;

  double call(Index facet, const Vec3& b) const {
    SurfacePoint at{facet, b, Vec3::Zero()};
    at.position = b[0] * mesh_.corner(facet, 0) + b[1] * mesh_.corner(facet, 1) + b[2] * mesh_.corner(facet, 2);
    const double r = radius_(at);
    if (is_radius(r)) return r;
    const auto list = [](const Vec3& v) {
      return "(" + std::to_string(v[0]) + ", " + std::to_string(v[1]) + ", " + std::to_string(v[2]) + ")";
    };
    refuse_sizing("the function gives the radius " + std::to_string(r) + " at " + list(at.position) + ", barycentrics " +
                  list(b) + " of facet " + std::to_string(facet) + " (0-based); it must be positive and finite everywhere");
  }

  double at_corner(Index f, int k) {
    double& value = at_vertex_[slot(mesh_.triangles(f, k))];
    if (value == 0) value = call(f, Vec3::Unit(k));
    return value;
  }

  double at_node(Index f, Index k, Index i, Index j) {
    const PlaceOnSide place = place_on_side(k, i, j);
    if (place.side < 0) return call(f, lattice_barycentric(k, i, j));
    if (place.steps == 0) return at_corner(f, place.side);
    if (first_side_.empty()) first_side_ = first_sides(mesh_.triangles, mesh_.num_vertices());
    const std::size_t first = first_side_[3 * slot(f) + slot(place.side)];
    const auto owner = static_cast<Index>(first / 3);
    const int side = static_cast<int>(first % 3);
    const bool same = mesh_.triangles(owner, side) == mesh_.triangles(f, place.side);
    const double along = static_cast<double>(same ? place.steps : k - place.steps) / k;
    Vec3 b = Vec3::Zero();
    b[side] = 1 - along;
    b[(side + 1) % 3] = along;
    return call(owner, b);
  }

  void tabulate(Index f) {
    std::vector<double>& now = now_;
    now.assign({at_corner(f, 0), at_corner(f, 1), at_corner(f, 2)});
    int level = 0;
    if (areas_[slot(f)] > 0) {
      const double edge = longest_edge(f);
      // The first lattice has edges of an eighth, or of twice the radius.
      while (fineness(edge, level) > 2 && level < 3) refine(f, level++);
      while (fineness(edge, level) > options_.finest && worth_refining(f, level)) {
        coarse_ = now;
        const bool agreed = refine(f, level) && centroids_agree(f, Index{1} << level);
        if (agreed) {
          now.swap(coarse_);
          break;
        }
        ++level;
      }
    }
    levels_[slot(f)] = static_cast<std::uint8_t>(level);
    nodes_.insert(nodes_.end(), now.begin(), now.end());
  }

  double longest_edge(Index f) const {
    const Vec3 a = mesh_.corner(f, 0), b = mesh_.corner(f, 1), c = mesh_.corner(f, 2);
    return std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
  }
  /// Lattice edges in units of the smallest radius.
  double fineness(double edge, int level) const {
    return std::ldexp(edge, -level) / *std::min_element(now_.begin(), now_.end());
  }
  /// False where lattice triangles outnumber what samples justify: large needles, functions with jumps.
  bool worth_refining(Index f, int level) const {
    const Index k = Index{1} << level;
    const std::size_t pieces = slot(k) * slot(k);
    double sum = 0;
    for (std::size_t t = 0; t < pieces; ++t) {
      const LatticeTriangle triangle = nth_lattice_triangle(k, t);
      std::array<double, 3> radii;
      for (std::size_t c = 0; c < 3; ++c) radii[c] = now_[lattice_node(k, triangle.corner[c][0], triangle.corner[c][1])];
      sum += mean_inverse_square(radii);
    }
    const double samples = kSamplesPerDensity * areas_[slot(f)] * sum / static_cast<double>(pieces);
    return level < kLastLevel && 4 * static_cast<double>(pieces) <= 16 * samples + 64;
  }

  /// Doubles k in now_; true if the new values are what interpolation says.
  bool refine(Index f, int level) {
    const Index k = Index{1} << level, fine = 2 * k;
    if (nodes_.size() + nodes_of_lattice(fine) > options_.max_nodes) {
      throw Error(ErrorCode::kTooLarge, "sizing: the function needs more than " + std::to_string(options_.max_nodes) +
                                            " lattice nodes; give larger radii or a larger tolerance");
    }
    const std::vector<double> old = now_;
    const auto at = [&](Index i, Index j) { return old[lattice_node(k, i, j)]; };
    now_.clear();
    bool agreed = true;
    for (Index j = 0; j <= fine; ++j) {
      for (Index i = 0; i + j <= fine; ++i) {
        if (i % 2 == 0 && j % 2 == 0) {
          now_.push_back(at(i / 2, j / 2));
          continue;
        }
        // The ends of the lattice edge that this node is the middle of.
        const Index di = i % 2, dj = i % 2 == 0 ? 1 : j % 2 == 0 ? 0 : -1;
        const double linear = (at((i + di) / 2, (j + dj) / 2) + at((i - di) / 2, (j - dj) / 2)) / 2;
        now_.push_back(at_node(f, fine, i, j));
        agreed = agreed && std::abs(now_.back() - linear) <= options_.tolerance * now_.back();
      }
    }
    return agreed;
  }

  /// The same at the centroids of the lattice in coarse_.
  bool centroids_agree(Index f, Index k) const {
    for (std::size_t t = 0; t < slot(k) * slot(k); ++t) {
      const LatticeTriangle triangle = nth_lattice_triangle(k, t);
      Vec3 b = Vec3::Zero();
      double linear = 0;
      for (const auto& corner : triangle.corner) {
        b += lattice_barycentric(k, corner[0], corner[1]) / 3;
        linear += coarse_[lattice_node(k, corner[0], corner[1])] / 3;
      }
      const double r = call(f, b);
      if (!(std::abs(r - linear) <= options_.tolerance * r)) return false;
    }
    return true;
  }

  const MeshView& mesh_;
  const SizingFunction& radius_;
  const TabulationOptions& options_;
  std::vector<double> areas_;
  std::vector<std::uint8_t> levels_;
  std::vector<double> nodes_;
  std::vector<double> at_vertex_;        ///< 0: not called yet
  std::vector<std::size_t> first_side_;  ///< empty until a facet has a lattice
  std::vector<double> now_, coarse_;     ///< the facet's lattice, and the one before
};

}  // namespace

SizingField function_sizing(const MeshView& mesh, const SizingFunction& radius, const TabulationOptions& options) {
  require_usable(mesh);
  if (!radius) refuse_sizing("no function given");
  if (!(options.tolerance > 0 && options.finest > 0)) refuse_sizing("tolerance and finest must be positive");
  return Tabulator(mesh, radius, options).run();
}

}  // namespace amps
