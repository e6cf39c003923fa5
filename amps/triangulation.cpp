#define AMPS_OWN_SOURCE
#include "amps/triangulation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace amps {
namespace detail {
namespace {

/// Corners of the face opposite to slot k of a positively oriented cell, counter-clockwise seen from outside the cell.
constexpr int kFaceCorners[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

// ---------------------------------------------------------------------------------------------------------------------------
// Order of bulk insertion: rounds of growing size, each along a Hilbert curve

/// The 3D Hilbert curve as an automaton (Hamilton, "Compact Hilbert indices", 2006): a state is an entry corner and a direction;
/// an octant of the grid leads to its rank along the curve and the state inside it.
struct HilbertAutomaton {
  std::uint8_t rank[24][8]{};
  std::uint8_t next[24][8]{};

  constexpr HilbertAutomaton() {
    for (unsigned entry = 0; entry < 8; ++entry) {
      for (unsigned direction = 0; direction < 3; ++direction) {
        for (unsigned octant = 0; octant < 8; ++octant) {
          const unsigned gray = rotate_right(octant ^ entry, (direction + 1) % 3);
          unsigned w = gray ^ (gray >> 1);
          w ^= gray >> 2;
          const unsigned entry_of_w = w == 0 ? 0 : gray_code(2 * ((w - 1) / 2));
          const unsigned direction_of_w = w == 0 ? 0 : trailing_ones(w % 2 == 0 ? w - 1 : w) % 3;
          const unsigned next_entry = entry ^ rotate_left(entry_of_w, (direction + 1) % 3);
          const unsigned next_direction = (direction + direction_of_w + 1) % 3;
          rank[entry * 3 + direction][octant] = static_cast<std::uint8_t>(w);
          next[entry * 3 + direction][octant] = static_cast<std::uint8_t>(next_entry * 3 + next_direction);
        }
      }
    }
  }

  static constexpr unsigned gray_code(unsigned x) { return x ^ (x >> 1); }
  static constexpr unsigned rotate_right(unsigned x, unsigned k) { return ((x >> k) | (x << (3 - k))) & 7u; }
  static constexpr unsigned rotate_left(unsigned x, unsigned k) { return ((x << k) | (x >> (3 - k))) & 7u; }
  static constexpr unsigned trailing_ones(unsigned x) {
    unsigned n = 0;
    for (; (x & 1u) != 0; x >>= 1) ++n;
    return n;
  }
};
constexpr HilbertAutomaton kHilbert;

struct KeyedIndex {
  std::uint64_t key;
  Index index;
};

/// Stable sort by the low `bits` bits of the key, least significant digit first.
void radix_sort(std::vector<KeyedIndex>& items, int bits) {
  constexpr int kDigit = 11;
  std::vector<KeyedIndex> other(items.size());
  for (int shift = 0; shift < bits; shift += kDigit) {
    std::size_t start[(1 << kDigit) + 1] = {};
    const auto digit = [shift](const KeyedIndex& item) { return (item.key >> shift) & ((1u << kDigit) - 1); };
    for (const KeyedIndex& item : items) ++start[digit(item) + 1];
    for (int d = 0; d < 1 << kDigit; ++d) start[d + 1] += start[d];
    for (const KeyedIndex& item : items) other[start[digit(item)]++] = item;
    items.swap(other);
  }
}

constexpr double kRoundRatio = 7.5;      // growth of the rounds; measured flat between 4 and 12
constexpr std::size_t kFirstRound = 2048;  // below this a further round costs more than its better hints save

std::uint64_t scramble(std::uint64_t z) noexcept {  // splitmix64's finaliser
  z = (z + 0x9e3779b97f4a7c15u) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

/// Sorts order[begin, end) along the Hilbert curve of its own bounding box, in rounds if `rounds`; groups that fall into one
/// grid cell are sorted again by themselves, so clusters at any scale end up in order.
void hilbert_sort(const std::vector<WeightedPoint>& points, std::vector<Index>& order, std::size_t begin, std::size_t end,
                  bool rounds) {
  constexpr std::size_t kSmallGroup = 16;
  const std::size_t n = end - begin;
  if (n <= kSmallGroup) return;
  double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
  for (std::size_t k = begin; k < end; ++k) {
    const WeightedPoint& p = points[static_cast<std::size_t>(order[k])];
    const double x[3] = {p.x, p.y, p.z};
    for (int a = 0; a < 3; ++a) {
      low[a] = std::min(low[a], x[a]);
      high[a] = std::max(high[a], x[a]);
    }
  }
  // Halves, because the extent itself may overflow.
  const double extent = std::max({high[0] / 2 - low[0] / 2, high[1] / 2 - low[1] / 2, high[2] / 2 - low[2] / 2});
  if (!(extent > 0)) return;

  int levels = 3;
  while (levels < 18 && (std::size_t{1} << (2 * levels)) < 16 * n) ++levels;  // surfaces: n ~ 4^levels
  int round_count = 1;
  for (double size = static_cast<double>(n) / kRoundRatio; rounds && size >= static_cast<double>(kFirstRound); size /= kRoundRatio) {
    ++round_count;
  }
  const double cells = static_cast<double>(1u << levels);
  std::vector<KeyedIndex> items(n);
  for (std::size_t k = 0; k < n; ++k) {
    const Index index = order[begin + k];
    const WeightedPoint& p = points[static_cast<std::size_t>(index)];
    const double x[3] = {p.x, p.y, p.z};
    unsigned grid[3];
    for (int a = 0; a < 3; ++a) {
      const double t = (x[a] / 2 - low[a] / 2) / extent * cells;
      grid[a] = std::min(static_cast<unsigned>(t), (1u << levels) - 1);
    }
    std::uint64_t key = 0;
    unsigned state = 0;
    for (int level = levels - 1; level >= 0; --level) {
      const unsigned octant = ((grid[0] >> level) & 1u) | (((grid[1] >> level) & 1u) << 1) | (((grid[2] >> level) & 1u) << 2);
      key = (key << 3) | kHilbert.rank[state][octant];
      state = kHilbert.next[state][octant];
    }
    if (round_count > 1) {
      // A point is in the last round with probability 1 − 1/ratio, in the one before with 1/ratio of that, and so on.
      double u = static_cast<double>(scramble(static_cast<std::uint64_t>(index)) >> 11) * 0x1p-53;
      int round = round_count - 1;
      for (; round > 0 && u < 1 / kRoundRatio; --round) u *= kRoundRatio;
      key |= static_cast<std::uint64_t>(round) << (3 * levels);
    }
    items[k] = {key, index};
  }
  int bits = 3 * levels;
  for (int k = round_count - 1; k > 0; k >>= 1) ++bits;
  radix_sort(items, bits);
  for (std::size_t k = 0; k < n; ++k) order[begin + k] = items[k].index;
  for (std::size_t k = 0; k < n;) {
    std::size_t group_end = k + 1;
    while (group_end < n && items[group_end].key == items[k].key) ++group_end;
    if (group_end - k < n) hilbert_sort(points, order, begin + k, begin + group_end, false);
    k = group_end;
  }
}

/// A set of cells for walks of const members, which may not mark: open addressing, grows, no heap for small stars.
class IndexSet {
 public:
  /// True if `value` (≥ 0) was not in the set.
  bool insert(Index value) {
    if (2 * (count_ + 1) > capacity_) grow();
    return insert_into(slots(), value);
  }

 private:
  Index* slots() { return heap_.empty() ? inline_.data() : heap_.data(); }
  bool insert_into(Index* slot, Index value) {
    std::size_t at = scramble(static_cast<std::uint64_t>(value)) & (capacity_ - 1);
    for (; slot[at] != 0; at = (at + 1) & (capacity_ - 1)) {
      if (slot[at] == value + 1) return false;
    }
    slot[at] = value + 1;
    ++count_;
    return true;
  }
  void grow() {
    const std::vector<Index> old(slots(), slots() + capacity_);
    capacity_ *= 4;
    heap_.assign(capacity_, 0);
    count_ = 0;
    for (const Index v : old) {
      if (v != 0) insert_into(heap_.data(), v - 1);
    }
  }
  std::array<Index, 128> inline_{};
  std::vector<Index> heap_;
  std::size_t capacity_ = 128;
  std::size_t count_ = 0;
};

std::size_t at(Index i) noexcept { return static_cast<std::size_t>(i); }

enum CellMark : std::uint8_t { kUntested = 0, kInConflict = 1, kOutside = 2 };

}  // namespace
}  // namespace detail

using detail::at;
using detail::kFaceCorners;

// ---------------------------------------------------------------------------------------------------------------------------
// Bulk insertion

RegularTriangulation::RegularTriangulation(const PointsView& positions) { insert(positions); }

RegularTriangulation::RegularTriangulation(const PointsView& positions, const Eigen::Ref<const Eigen::VectorXd>& weights) {
  insert(positions, weights);
}

void RegularTriangulation::insert(const PointsView& positions) {
  const Index first = num_vertices();
  append_points(positions, nullptr);
  bulk_insert(first);
}

void RegularTriangulation::insert(const PointsView& positions, const Eigen::Ref<const Eigen::VectorXd>& weights) {
  if (weights.size() != positions.rows()) {
    throw Error(ErrorCode::kInvalidArgument, "triangulation: " + std::to_string(positions.rows()) + " points with " +
                                                 std::to_string(weights.size()) + " weights; give one weight a point");
  }
  const Index first = num_vertices();
  append_points(positions, weights.data());
  bulk_insert(first);
}

void RegularTriangulation::append_points(const PointsView& positions, const double* weights) {
  detail::require_exact_arithmetic();
  const Eigen::Index n = positions.rows();
  constexpr Eigen::Index kMaxPoints = (Eigen::Index{1} << 29) / 8;  // so that 4·cell + face fits an Index
  if (n + static_cast<Eigen::Index>(points_.size()) > kMaxPoints) {
    throw Error(ErrorCode::kTooLarge, "triangulation: more than " + std::to_string(kMaxPoints) +
                                          " points; split the set or use a larger radius");
  }
  for (Eigen::Index k = 0; k < n; ++k) {
    if (!positions.row(k).allFinite() || (weights != nullptr && !std::isfinite(weights[k]))) {
      throw Error(ErrorCode::kInvalidArgument, "triangulation: point " + std::to_string(k) +
                                                   " is not finite (NaN or infinity); remove or repair it");
    }
  }
  const std::size_t total = points_.size() + static_cast<std::size_t>(n);
  if (n > 1) points_.reserve(std::max(total, 2 * points_.size()));  // single insertions grow geometrically by themselves
  for (Eigen::Index k = 0; k < n; ++k) {
    points_.push_back({positions(k, 0), positions(k, 1), positions(k, 2), weights != nullptr ? weights[k] : 0.0});
    grow_bounds(points_.back());
  }
  state_.resize(total, VertexState::kVisible);
  vertex_cell_.resize(total, kNone);
  local_.resize(total + 2, 0);
  bounds_ = detail::StaticBounds::for_box(box_max_ - box_min_, weight_max_ - weight_min_);
}

void RegularTriangulation::grow_bounds(const WeightedPoint& p) {
  box_min_ = box_min_.cwiseMin(p.position());
  box_max_ = box_max_.cwiseMax(p.position());
  weight_min_ = std::min(weight_min_, p.w);
  weight_max_ = std::max(weight_max_, p.w);
  weights_vary_ = weight_min_ < weight_max_;
}

/// Adds v to the basis if it is affinely independent of it; true once that completes a simplex with v.
bool RegularTriangulation::extend_basis(Index v) {
  const WeightedPoint& p = point(v);
  const auto position = [this](int k) { return &point(basis_[static_cast<std::size_t>(k)]).x; };
  switch (dimension_) {
    case -1:
      break;
    case 0:
      if (same_position(point(basis_[0]), p)) return false;
      break;
    case 1:
      if (collinear(position(0), position(1), &p.x)) return false;
      break;
    default:
      if (orient3d(point(basis_[0]), point(basis_[1]), point(basis_[2]), p) == 0) return false;
      return true;
  }
  basis_[static_cast<std::size_t>(++dimension_)] = v;
  return false;
}

void RegularTriangulation::bulk_insert(Index first) {
  if (first == num_vertices()) return;
  if (dimension_ < 3) first = 0;  // nothing has a cell yet: start over with all points
  std::vector<Index> id_of_rank(points_.size() - at(first));
  for (std::size_t k = 0; k < id_of_rank.size(); ++k) id_of_rank[k] = first + static_cast<Index>(k);
  detail::hilbert_sort(points_, id_of_rank, 0, id_of_rank.size(), true);

  if (dimension_ < 3) {
    // The first independent points in insertion order make the first cell: early rounds are spread out.
    dimension_ = -1;
    std::size_t apex = 0;
    while (apex < id_of_rank.size() && !extend_basis(id_of_rank[apex])) ++apex;
    if (apex == id_of_rank.size()) return;
    std::array<Index, 4> corner = {basis_[0], basis_[1], basis_[2], id_of_rank[apex]};
    for (std::size_t k = 0; k < 4; ++k) {
      const auto found = std::find(id_of_rank.begin() + static_cast<std::ptrdiff_t>(k), id_of_rank.end(), corner[k]);
      std::rotate(id_of_rank.begin() + static_cast<std::ptrdiff_t>(k), found, found + 1);
    }
  }
  build(std::move(id_of_rank));
}

/// Inserts the points id_of_rank in order. They are moved into that order in memory while it lasts, so that neighbours in
/// space are neighbours in cache.
void RegularTriangulation::build(std::vector<Index> id_of_rank) {
  const Index first = num_vertices() - static_cast<Index>(id_of_rank.size());
  {
    std::vector<WeightedPoint> sorted(id_of_rank.size());
    for (std::size_t k = 0; k < sorted.size(); ++k) sorted[k] = points_[at(id_of_rank[k])];
    std::copy(sorted.begin(), sorted.end(), points_.begin() + first);
  }
  const std::size_t expected_cells = cells_.size() + id_of_rank.size() * 7 + 64;
  cells_.reserve(expected_cells);
  mark_.reserve(expected_cells);
  bulk_ = true;
  Index next = first;
  if (dimension_ < 3) {
    start_simplex({first, first + 1, first + 2, first + 3});
    next = first + 4;
  }
  Index hint = last_cell_;
  for (; next < num_vertices(); ++next) {
    hint = insert_vertex(next, hint);
    if (state(next) == VertexState::kDuplicate) {
      // Of equal points the lowest id stays: the vertex in the cells takes it over.
      const Index twin = vertex_cell_[at(next)];
      vertex_cell_[at(next)] = kNone;
      if (twin >= first && id_of_rank[at(twin - first)] > id_of_rank[at(next - first)]) {
        std::swap(id_of_rank[at(twin - first)], id_of_rank[at(next - first)]);
      }
    }
  }
  last_cell_ = hint;
  bulk_ = false;
  relabel(first, id_of_rank);
  for (Index v = 0; num_hidden_ > 0 && v < num_vertices(); ++v) {
    if (state(v) != VertexState::kVisible && vertex_cell_[at(v)] == kNone) unplaced_.push_back(v);
  }
  place_hidden(last_cell_);
}

/// From ranks back to the caller's ids, everywhere.
void RegularTriangulation::relabel(Index first, const std::vector<Index>& id_of_rank) {
  for (Cell& cell : cells_) {
    for (Index& v : cell.vertex) {
      if (v >= first) v = id_of_rank[at(v - first)];
    }
  }
  const std::vector<WeightedPoint> points(points_.begin() + first, points_.end());
  const std::vector<VertexState> states(state_.begin() + first, state_.end());
  const std::vector<Index> cell_of(vertex_cell_.begin() + first, vertex_cell_.end());
  for (std::size_t k = 0; k < id_of_rank.size(); ++k) {
    const std::size_t id = at(id_of_rank[k]);
    points_[id] = points[k];
    state_[id] = states[k];
    vertex_cell_[id] = cell_of[k];
  }
}

void RegularTriangulation::start_simplex(const std::array<Index, 4>& corner) {
  dimension_ = 3;
  std::array<Index, 4> v = corner;
  if (orient3d(point(v[0]), point(v[1]), point(v[2]), point(v[3])) < 0) std::swap(v[0], v[1]);
  cells_.clear();
  free_cells_.clear();
  cells_.push_back({v, {}});
  for (int f = 0; f < 4; ++f) {
    const int* face = kFaceCorners[f];
    cells_.push_back({{v[at(face[0])], v[at(face[1])], v[at(face[2])], kInfinite}, {}});
  }
  mark_.assign(5, detail::kUntested);
  for (int f = 0; f < 4; ++f) {
    // Ghost 1 + f is glued to face f of the cell, and to ghost 1 + g across the edge that misses its corner g.
    cells_[0].neighbor[at(f)] = 4 * (1 + f) + 3;
    Cell& ghost = cells_[at(1 + f)];
    ghost.neighbor[3] = f;
    for (std::size_t s = 0; s < 3; ++s) {
      const int g = kFaceCorners[f][s];
      const int* other = kFaceCorners[g];
      const int back = other[0] == f ? 0 : (other[1] == f ? 1 : 2);
      ghost.neighbor[s] = 4 * (1 + g) + back;
    }
    vertex_cell_[at(v[at(f)])] = 0;
  }
  num_finite_ = 1;
  num_ghosts_ = 4;
  last_cell_ = 0;
}

// ---------------------------------------------------------------------------------------------------------------------------
// One insertion

Index RegularTriangulation::insert(const Vec3& position, double weight, Index hint) {
  const Index v = num_vertices();
  append_points(position.transpose(), &weight);
  hidden_by_last_.clear();
  if (dimension_ < 3) {
    if (extend_basis(v)) bulk_insert(v);
    return v;
  }
  if (hint == kNone || hint >= cell_capacity() || !cell(hint).alive()) hint = last_cell_;
  last_cell_ = insert_vertex(v, hint);
  if (state(v) == VertexState::kDuplicate) vertex_cell_[at(v)] = kNone;
  if (state(v) != VertexState::kVisible) {
    hidden_by_last_.push_back(v);
    unplaced_.push_back(v);
  }
  place_hidden(last_cell_);
  return v;
}

/// Returns a cell near v. A duplicate gets its twin as vertex_cell_, for the caller to settle who keeps the lower id.
Index RegularTriangulation::insert_vertex(Index v, Index hint) {
  const WeightedPoint q = point(v);
  const Index start = walk(q, hint, bounds_.orientation);
  const Cell& home = cell(start);
  for (const Index u : home.vertex) {
    if (u != kInfinite && same_position(point(u), q) && point(u).w == q.w) {
      hide(v, VertexState::kDuplicate);
      vertex_cell_[at(v)] = u;
      return start;
    }
  }
  if (!home.ghost() && !in_conflict(start, q)) {  // a ghost that q sees is always in conflict
    hide(v, VertexState::kHidden);
    return start;
  }
  dig_cavity(start, q);
  number_cavity_vertices();
  if (weights_vary_) collect_hidden_by_cavity();
  if (!hidden_head_.empty()) {
    for (const Index c : conflict_) release_hidden(c);
  }
  return fill_cavity(v);
}

bool RegularTriangulation::in_conflict(Index c, const WeightedPoint& q) const {
  const Cell* cell = &cells_[at(c)];
  if (cell->ghost()) {
    const int side = orient3d(point(cell->vertex[0]), point(cell->vertex[1]), point(cell->vertex[2]), q, bounds_.orientation);
    if (side != 0) return side > 0;
    // q lies in the plane of the hull facet: it conflicts iff it lies in the facet's power circle, which is where that plane
    // cuts the orthogonal sphere of the finite cell behind it.
    cell = &cells_[at(cell->neighbor[3] >> 2)];
  }
  return power_test(point(cell->vertex[0]), point(cell->vertex[1]), point(cell->vertex[2]), point(cell->vertex[3]), q,
                    bounds_.power) > 0;
}

/// Visibility walk: cross any face that separates the cell from q. It never cycles in a regular triangulation (Edelsbrunner,
/// "An acyclicity theorem for cell complexes", 1989).
Index RegularTriangulation::walk(const WeightedPoint& q, Index start, double orientation_bound) const {
  Index c = start;
  if (cell(c).ghost()) c = cell(c).neighbor[3] >> 2;
  int entry = -1;
  for (;;) {
    const Cell& here = cell(c);
    const WeightedPoint* p[4];
    for (std::size_t k = 0; k < 4; ++k) p[k] = &points_[at(here.vertex[k])];
    int exit = -1;
    for (int f = 0; f < 4 && exit < 0; ++f) {
      if (f == entry) continue;
      const int* face = kFaceCorners[f];
      // Counter-clockwise seen from outside: positive means q is beyond it.
      if (orient3d(*p[face[0]], *p[face[1]], *p[face[2]], q, orientation_bound) > 0) exit = f;
    }
    if (exit < 0) return c;
    const Index next = here.neighbor[at(exit)];
    c = next >> 2;
    entry = next & 3;
    if (cell(c).ghost()) return c;
  }
}

/// Collects the cells in conflict with q, and the facets around them.
void RegularTriangulation::dig_cavity(Index start, const WeightedPoint& q) {
  conflict_.clear();
  boundary_.clear();
  outside_tested_.clear();
  conflict_.push_back(start);
  mark_[at(start)] = detail::kInConflict;
  for (std::size_t k = 0; k < conflict_.size(); ++k) {  // the list is its own queue
    const Index c = conflict_[k];
    for (int f = 0; f < 4; ++f) {
      const Index beyond = cells_[at(c)].neighbor[at(f)];
      std::uint8_t& mark = mark_[at(beyond >> 2)];
      if (mark == detail::kUntested) {
        if (in_conflict(beyond >> 2, q)) {
          mark = detail::kInConflict;
          conflict_.push_back(beyond >> 2);
        } else {
          mark = detail::kOutside;
          outside_tested_.push_back(beyond >> 2);
        }
      }
      if (mark == detail::kOutside) boundary_.push_back({cells_[at(c)].vertex, beyond, f, {}});
    }
  }
  for (const Index c : outside_tested_) mark_[at(c)] = detail::kUntested;
  for (const Index c : conflict_) mark_[at(c)] = detail::kUntested;
}

void RegularTriangulation::number_cavity_vertices() {
  cavity_vertices_.clear();
  for (BoundaryFacet& facet : boundary_) {
    for (int k = 0; k < 4; ++k) {
      if (k == facet.slot) continue;
      std::int32_t& number = local_[at(facet.vertex[at(k)] + 2)];
      if (number == 0) {
        cavity_vertices_.push_back(facet.vertex[at(k)]);
        number = static_cast<std::int32_t>(cavity_vertices_.size());
      }
      facet.local[at(k)] = number - 1;
    }
  }
}

/// Vertices inside the cavity, not on its boundary, are dominated by the new point.
void RegularTriangulation::collect_hidden_by_cavity() {
  for (const Index c : conflict_) {
    for (const Index v : cells_[at(c)].vertex) {
      if (local_[at(v + 2)] != 0 || v == kInfinite || state(v) != VertexState::kVisible) continue;
      hide(v, VertexState::kHidden);
      if (bulk_) continue;
      hidden_by_last_.push_back(v);
      unplaced_.push_back(v);
    }
  }
}

/// Replaces the cavity by the star of v. Slots of the cells just freed are used again.
Index RegularTriangulation::fill_cavity(Index v) {
  for (const Index c : conflict_) {
    Cell& dead = cells_[at(c)];
    --(dead.ghost() ? num_ghosts_ : num_finite_);
    dead.vertex[0] = kNone;
    free_cells_.push_back(c);
  }
  new_cells_.clear();
  for (const BoundaryFacet& facet : boundary_) {
    const Index c = allocate_cell();
    new_cells_.push_back(c);
    Cell& cell = cells_[at(c)];
    cell.vertex = facet.vertex;
    cell.vertex[at(facet.slot)] = v;
    cell.neighbor[at(facet.slot)] = facet.outside;
    cells_[at(facet.outside >> 2)].neighbor[at(facet.outside & 3)] = 4 * c + facet.slot;
    for (const Index u : cell.vertex) {
      if (u != kInfinite) vertex_cell_[at(u)] = c;
    }
    ++(cell.ghost() ? num_ghosts_ : num_finite_);
  }
  link_star(new_cells_);
  for (const Index u : cavity_vertices_) local_[at(u + 2)] = 0;
  return new_cells_.front();
}

Index RegularTriangulation::allocate_cell() {
  if (!free_cells_.empty()) {
    const Index c = free_cells_.back();
    free_cells_.pop_back();
    return c;
  }
  cells_.push_back({});
  mark_.push_back(detail::kUntested);
  if (!hidden_head_.empty()) hidden_head_.push_back(kNone);
  return static_cast<Index>(cells_.size()) - 1;
}

/// Glues the new cells to each other. Each directed edge of the cavity's boundary belongs to one facet, and its reverse to the
/// facet next to it.
void RegularTriangulation::link_star(const std::vector<Index>& new_cell) {
  constexpr std::size_t kTableLimit = 512;  // vertices of a cavity: a 1 MiB table at most, sorted edges beyond
  const std::size_t n = cavity_vertices_.size();
  // visit(facet, slot opposite to the edge, from, to)
  const auto for_each_edge = [&](auto&& visit) {
    for (std::size_t k = 0; k < boundary_.size(); ++k) {
      const BoundaryFacet& facet = boundary_[k];
      const int* face = kFaceCorners[facet.slot];
      for (int e = 0; e < 3; ++e) {
        const int from = face[e], to = face[e == 2 ? 0 : e + 1], opposite = face[e == 0 ? 2 : e - 1];
        visit(k, opposite, static_cast<std::size_t>(facet.local[at(from)]), static_cast<std::size_t>(facet.local[at(to)]));
      }
    }
  };
  if (n <= kTableLimit) {
    if (edge_table_.size() < n * n) edge_table_.resize(n * n);
    for_each_edge([&](std::size_t k, int opposite, std::size_t from, std::size_t to) {
      edge_table_[from * n + to] = 4 * new_cell[k] + opposite;
    });
    for_each_edge([&](std::size_t k, int opposite, std::size_t from, std::size_t to) {
      cells_[at(new_cell[k])].neighbor[at(opposite)] = edge_table_[to * n + from];
    });
    return;
  }
  std::vector<std::pair<std::uint64_t, Index>> edges;
  edges.reserve(3 * boundary_.size());
  for_each_edge([&](std::size_t k, int opposite, std::size_t from, std::size_t to) {
    edges.emplace_back(std::uint64_t{from} << 32 | to, 4 * new_cell[k] + opposite);
  });
  std::sort(edges.begin(), edges.end());
  for_each_edge([&](std::size_t k, int opposite, std::size_t from, std::size_t to) {
    const auto twin = std::lower_bound(edges.begin(), edges.end(), std::make_pair(std::uint64_t{to} << 32 | from, Index{0}));
    cells_[at(new_cell[k])].neighbor[at(opposite)] = twin->second;
  });
}

// ---------------------------------------------------------------------------------------------------------------------------
// Hidden points

void RegularTriangulation::hide(Index v, VertexState state) {
  state_[at(v)] = state;
  vertex_cell_[at(v)] = kNone;
  ++num_hidden_;
}

void RegularTriangulation::attach_hidden(Index v, Index c) {
  hidden_head_.resize(cells_.size(), kNone);
  hidden_next_.resize(points_.size(), kNone);
  hidden_next_[at(v)] = hidden_head_[at(c)];
  hidden_head_[at(c)] = v;
  vertex_cell_[at(v)] = c;
}

/// The cell is about to vanish: its hidden points wait for place_hidden (in bulk, for the end).
void RegularTriangulation::release_hidden(Index c) {
  for (Index v = hidden_head_[at(c)]; v != kNone; v = hidden_next_[at(v)]) {
    vertex_cell_[at(v)] = kNone;
    if (!bulk_) unplaced_.push_back(v);
  }
  hidden_head_[at(c)] = kNone;
}

/// Attaches waiting hidden points to the finite cells that contain them.
void RegularTriangulation::place_hidden(Index hint) {
  for (const Index v : unplaced_) {
    hint = walk(point(v), hint, bounds_.orientation);
    attach_hidden(v, hint);
  }
  unplaced_.clear();
}

// ---------------------------------------------------------------------------------------------------------------------------
// Queries

Eigen::Matrix<Index, Eigen::Dynamic, 4, Eigen::RowMajor> RegularTriangulation::cells() const {
  Eigen::Matrix<Index, Eigen::Dynamic, 4, Eigen::RowMajor> result(num_finite_, 4);
  Eigen::Index row = 0;
  for (const Cell& c : cells_) {
    if (!c.alive() || c.ghost()) continue;
    for (int k = 0; k < 4; ++k) result(row, k) = c.vertex[at(k)];
    ++row;
  }
  return result;
}

Triangles RegularTriangulation::hull() const {
  Triangles result(num_ghosts_, 3);
  Eigen::Index row = 0;
  for (const Cell& c : cells_) {
    if (!c.alive() || !c.ghost()) continue;
    for (int k = 0; k < 3; ++k) result(row, k) = c.vertex[at(k)];
    ++row;
  }
  return result;
}

void RegularTriangulation::incident_cells(Index v, std::vector<Index>& out) const {
  out.clear();
  if (dimension_ < 3 || state(v) != VertexState::kVisible) return;
  detail::IndexSet seen;
  out.push_back(vertex_cell_[at(v)]);
  seen.insert(out.front());
  for (std::size_t k = 0; k < out.size(); ++k) {
    const Cell& c = cell(out[k]);
    for (std::size_t f = 0; f < 4; ++f) {
      if (c.vertex[f] == v) continue;  // the face opposite to v leaves its star
      const Index next = c.neighbor[f] >> 2;
      if (seen.insert(next)) out.push_back(next);
    }
  }
}

void RegularTriangulation::neighbors(Index v, std::vector<Index>& out) const {
  std::vector<Index> star;
  incident_cells(v, star);
  out.clear();
  for (const Index c : star) {
    for (const Index u : cell(c).vertex) {
      if (u != v && u != kInfinite) out.push_back(u);
    }
  }
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
}

RegularTriangulation::Adjacency RegularTriangulation::adjacency() const {
  // Every edge lies in at least three cells: count, scatter, then thin and sort each vertex's list.
  Adjacency result;
  std::vector<Index> start(points_.size() + 1, 0);
  for (const Cell& c : cells_) {
    if (!c.alive()) continue;
    const int corners = c.ghost() ? 3 : 4;
    for (int k = 0; k < corners; ++k) start[at(c.vertex[at(k)]) + 1] += corners - 1;
  }
  for (std::size_t v = 0; v < points_.size(); ++v) start[v + 1] += start[v];
  std::vector<Index> scattered(at(start.back()));
  std::vector<Index> cursor(start.begin(), start.end() - 1);
  for (const Cell& c : cells_) {
    if (!c.alive()) continue;
    const int corners = c.ghost() ? 3 : 4;
    for (int k = 0; k < corners; ++k) {
      for (int m = 0; m < corners; ++m) {
        if (m != k) scattered[at(cursor[at(c.vertex[at(k)])]++)] = c.vertex[at(m)];
      }
    }
  }
  result.offset.reserve(points_.size() + 1);
  result.offset.push_back(0);
  result.adjacent.reserve(scattered.size() / 4);
  std::vector<Index> last_seen(points_.size(), kNone);
  for (Index v = 0; v < num_vertices(); ++v) {
    for (Index k = start[at(v)]; k < start[at(v) + 1]; ++k) {
      const Index u = scattered[at(k)];
      if (std::exchange(last_seen[at(u)], v) != v) result.adjacent.push_back(u);
    }
    std::sort(result.adjacent.begin() + result.offset.back(), result.adjacent.end());
    result.offset.push_back(static_cast<Index>(result.adjacent.size()));
  }
  return result;
}

namespace detail {
namespace {

void require_finite(const Vec3& x) {
  if (!x.allFinite()) throw Error(ErrorCode::kInvalidArgument, "triangulation: the point to look up is not finite (NaN or infinity)");
}

}  // namespace
}  // namespace detail

Index RegularTriangulation::locate(const Vec3& x, Index hint) const {
  if (dimension_ < 3) return kNone;
  if (hint == kNone || hint >= cell_capacity() || !cell(hint).alive()) hint = last_cell_;
  detail::require_finite(x);
  // The static bound holds for points within the box of the set only.
  const bool in_box = (box_min_.array() <= x.array()).all() && (x.array() <= box_max_.array()).all();
  return walk({x.x(), x.y(), x.z(), 0.0}, hint, in_box ? bounds_.orientation : INFINITY);
}

namespace detail {
namespace {

/// Does site a own x rather than site b? Ties to the lexicographically smallest.
bool nearer_in_power(const Vec3& x, const WeightedPoint& a, const WeightedPoint& b) noexcept {
  if (same_position(a, b)) return a.w > b.w;
  const double* const corners[3] = {x.data(), x.data(), x.data()};
  return side_of_corner(corners, 0, Bisector(a, b, corners)) > 0;
}

}  // namespace
}  // namespace detail

Index RegularTriangulation::power_nearest(const Vec3& x, Index near) const {
  detail::require_finite(x);
  if (dimension_ < 3) {
    Index best = kNone;
    for (Index v = 0; v < num_vertices(); ++v) {
      if (best == kNone || detail::nearer_in_power(x, point(v), point(best))) best = v;
    }
    return best;
  }
  if (near < 0 || near >= num_vertices() || !is_vertex(near)) near = cell(last_cell_).vertex[0];
  // If v is not the nearest, the segment from its power cell to x leaves through a bisector whose other site is nearer.
  std::vector<Index> around;
  for (Index best = near;;) {
    neighbors(best, around);
    Index next = best;
    for (const Index u : around) {
      if (detail::nearer_in_power(x, point(u), point(next))) next = u;
    }
    if (next == best) return best;
    best = next;
  }
}

// ---------------------------------------------------------------------------------------------------------------------------
// Proof

namespace detail {
namespace {

std::string cell_name(Index c) { return "cell " + std::to_string(c); }

}  // namespace
}  // namespace detail

std::string RegularTriangulation::check(int level) const {
  using detail::cell_name;
  if (dimension_ < 3) return num_finite_ == 0 ? "" : "cells in a flat set";
  Index finite = 0, ghosts = 0;
  for (Index c = 0; c < cell_capacity(); ++c) {
    const Cell& here = cell(c);
    if (!here.alive()) continue;
    ++(here.ghost() ? ghosts : finite);
    for (std::size_t k = 0; k < 4; ++k) {
      const Index v = here.vertex[k];
      if (v == kInfinite ? k != 3 : (v < 0 || v >= num_vertices())) return cell_name(c) + ": corner out of range";
      if (v != kInfinite && state(v) != VertexState::kVisible) return cell_name(c) + ": hidden corner " + std::to_string(v);
      const Index n = here.neighbor[k];
      if (n < 0 || (n >> 2) >= cell_capacity() || !cell(n >> 2).alive()) return cell_name(c) + ": neighbour out of range";
      if (cell(n >> 2).neighbor[at(n & 3)] != 4 * c + static_cast<Index>(k)) return cell_name(c) + ": asymmetric neighbour";
      std::array<Index, 3> mine{}, theirs{};
      for (std::size_t m = 0; m < 3; ++m) {
        mine[m] = here.vertex[at(kFaceCorners[k][m])];
        theirs[m] = cell(n >> 2).vertex[at(kFaceCorners[n & 3][m])];
      }
      // The neighbour sees the face from the other side: the same cycle backwards.
      const bool mirrored = (mine[0] == theirs[0] && mine[1] == theirs[2] && mine[2] == theirs[1]) ||
                            (mine[0] == theirs[1] && mine[1] == theirs[0] && mine[2] == theirs[2]) ||
                            (mine[0] == theirs[2] && mine[1] == theirs[1] && mine[2] == theirs[0]);
      if (!mirrored) return cell_name(c) + ": face " + std::to_string(k) + " is not its neighbour's";
    }
    if (!here.ghost() && orient3d(point(here.vertex[0]), point(here.vertex[1]), point(here.vertex[2]), point(here.vertex[3])) <= 0) {
      return cell_name(c) + ": not positively oriented";
    }
  }
  if (finite != num_finite_ || ghosts != num_ghosts_) return "cell counts are off";
  Index hidden = 0;
  for (Index v = 0; v < num_vertices(); ++v) {
    const Index c = vertex_cell_[at(v)];
    if (c < 0 || c >= cell_capacity() || !cell(c).alive()) return "vertex " + std::to_string(v) + ": no cell";
    if (state(v) != VertexState::kVisible) {
      ++hidden;
      if (cell(c).ghost()) return "hidden point " + std::to_string(v) + " in a ghost cell";
      const auto& corner = cell(c).vertex;
      for (int f = 0; f < 4; ++f) {
        const int* face = kFaceCorners[f];
        if (orient3d(point(corner[at(face[0])]), point(corner[at(face[1])]), point(corner[at(face[2])]), point(v)) > 0) {
          return "hidden point " + std::to_string(v) + " outside its cell";
        }
      }
    } else if (const auto& corner = cell(c).vertex; std::find(corner.begin(), corner.end(), v) == corner.end()) {
      return "vertex " + std::to_string(v) + ": its cell has another corner";
    }
  }
  if (hidden != num_hidden_) return "hidden count is off";
  if (level < 2) return "";

  for (Index c = 0; c < cell_capacity(); ++c) {
    const Cell& here = cell(c);
    if (!here.alive()) continue;
    for (std::size_t k = 0; k < 4; ++k) {
      const Index n = here.neighbor[k];
      const Index apex = cell(n >> 2).vertex[at(n & 3)];
      if (apex == kInfinite || here.vertex[k] == kInfinite) continue;
      if (in_conflict(c, point(apex))) {
        return (here.ghost() ? "hull not convex at " : "not regular at ") + cell_name(c);
      }
    }
  }
  for (Index v = 0; hidden > 0 && v < num_vertices(); ++v) {
    if (state(v) == VertexState::kVisible) continue;
    const Index c = vertex_cell_[at(v)];
    bool has_twin = false;
    for (const Index u : cell(c).vertex) {
      has_twin = has_twin || (same_position(point(u), point(v)) && point(u).w == point(v).w);
    }
    // A twin may itself be hidden by now: then the duplicate is an ordinary hidden point.
    if (!has_twin && in_conflict(c, point(v))) return "hidden point " + std::to_string(v) + " is not hidden";
  }
  return "";
}

}  // namespace amps
