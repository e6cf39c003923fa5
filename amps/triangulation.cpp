#define AMPS_OWN_SOURCE
#include "amps/triangulation.h"

#include "amps/execution.h"
#include "amps/spatial_sort.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace amps {
using detail::kFaceCorners;
using detail::slot;

// Bulk insertion

RegularTriangulation::RegularTriangulation(const PointsView& positions) { insert(positions); }

RegularTriangulation::RegularTriangulation(const PointsView& positions, const ValuesView& weights, const Execution& execution) {
  insert(positions, weights, execution);
}

void RegularTriangulation::insert(const PointsView& positions) { insert_all(positions, nullptr, {}); }

void RegularTriangulation::insert(const PointsView& positions, const ValuesView& weights, const Execution& execution) {
  if (weights.size() != positions.rows()) {
    throw Error(ErrorCode::kInvalidArgument, "triangulation: " + std::to_string(positions.rows()) + " points with " +
                                                 std::to_string(weights.size()) + " weights; give one weight a point");
  }
  insert_all(positions, &weights, execution);
}

void RegularTriangulation::insert_all(const PointsView& positions, const ValuesView* weights, const Execution& execution) {
  const Execution run = execution.start("triangulating");
  const Index first = num_vertices();
  const bool complete = detail::completes([&] {
    const Execution appending = run.part(0, 0.05);
    append_points(positions, weights, &appending);
    bulk_insert(first, run.part(0.05, 1));
  });
  if (!complete) {
    *this = RegularTriangulation();
    run.check();
  }
  run.finish();
}

void RegularTriangulation::reserve(std::size_t num_points) {
  points_.reserve(num_points);
  state_.reserve(num_points);
  vertex_cell_.reserve(num_points);
}

void RegularTriangulation::keep_in_place(std::size_t count) {
  const std::size_t total = points_.size() + count;
  if (total > points_.capacity()) points_.reserve(std::max(total, points_.size() + points_.size() / 8));
}

void RegularTriangulation::append_points(const PointsView& positions, const ValuesView* weights, const Execution* execution) {
  detail::require_exact_arithmetic();
  const std::ptrdiff_t n = positions.rows();
  constexpr std::ptrdiff_t kMaxPoints = (std::ptrdiff_t{1} << 29) / 8;  // so that 4·cell + face fits an Index
  if (n + static_cast<std::ptrdiff_t>(points_.size()) > kMaxPoints) {
    throw Error(ErrorCode::kTooLarge,
                "triangulation: more than " + std::to_string(kMaxPoints) + " points; split the set or use a larger radius");
  }
  const auto in_pieces = [&](double from, double to, const auto& body) {
    const auto count = static_cast<std::size_t>(n);
    if (execution == nullptr) return body(std::size_t{0}, count);
    detail::for_each_piece(count, detail::kElementsPerLook, execution->part(from, to), body);
  };
  in_pieces(0, 0.3, [&](std::size_t begin, std::size_t end) {
    for (auto k = static_cast<std::ptrdiff_t>(begin); k < static_cast<std::ptrdiff_t>(end); ++k) {
      if (!positions[k].allFinite() || (weights != nullptr && !std::isfinite((*weights)[k]))) {
        throw Error(ErrorCode::kInvalidArgument,
                    "triangulation: point " + std::to_string(k) + " is not finite (NaN or infinity); remove or repair it");
      }
    }
  });
  const std::size_t total = points_.size() + static_cast<std::size_t>(n);
  if (total > points_.capacity()) points_.reserve(std::max(total, 2 * points_.capacity()));  // single insertions: amortised
  in_pieces(0.3, 1, [&](std::size_t begin, std::size_t end) {
    for (auto k = static_cast<std::ptrdiff_t>(begin); k < static_cast<std::ptrdiff_t>(end); ++k) {
      const Vec3 x = positions[k];
      points_.push_back({x[0], x[1], x[2], weights != nullptr ? (*weights)[k] : 0.0});
      grow_bounds(points_.back());
    }
  });
  state_.resize(total, VertexState::kVisible);
  vertex_cell_.resize(total, kNone);
}

void RegularTriangulation::grow_bounds(const WeightedPoint& p) {
  const int unit = scale_.unit();
  for (const double x : {p.x, p.y, p.z}) scale_.coordinate(x);
  scale_.weight(p.w);
  const Vec3 x = p.position();
  const bool within = (box_min_.array() <= x.array()).all() && (x.array() <= box_max_.array()).all() && weight_min_ <= p.w &&
                      p.w <= weight_max_;
  if (within && scale_.unit() == unit) return;
  box_min_ = box_min_.cwiseMin(x);
  box_max_ = box_max_.cwiseMax(x);
  weight_min_ = std::min(weight_min_, p.w);
  weight_max_ = std::max(weight_max_, p.w);
  weights_vary_ = weight_min_ < weight_max_;
  bounds_ = detail::StaticBounds::for_set(box_max_ - box_min_, weight_max_ - weight_min_, scale_.unit());
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

/// Once it has begun, a cancel leaves what cannot be used any more.
void RegularTriangulation::bulk_insert(Index first, const Execution& execution) {
  if (first == num_vertices()) return;
  if (dimension_ < 3) first = 0;  // nothing has a cell yet: start over with all points
  std::vector<Index> id_of_rank, removed;
  id_of_rank.reserve(points_.size() - slot(first));
  for (Index v = first; v < num_vertices(); ++v) (state(v) == VertexState::kRemoved ? removed : id_of_rank).push_back(v);
  detail::InsertionOrder order = detail::insertion_order(points_, std::move(id_of_rank), execution.part(0, 0.1));
  id_of_rank = std::move(order.ids);

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
  const Index count = static_cast<Index>(id_of_rank.size());
  id_of_rank.insert(id_of_rank.end(), removed.begin(), removed.end());
  order.ids = std::move(id_of_rank);
  build(order, count, execution.part(0.1, 1));
}

/// Points are moved into the order in which they are inserted while that lasts, so that neighbours in space are neighbours in
/// cache. Those after the first `count` are removed ones.
void RegularTriangulation::move_into_order(const std::vector<Index>& id_of_rank, Index first, Index count,
                                           const Execution& execution) {
  std::vector<WeightedPoint> sorted(id_of_rank.size());
  detail::for_each_piece(sorted.size(), detail::kElementsPerLook, execution, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) sorted[k] = points_[slot(id_of_rank[k])];
  });
  detail::for_each_piece(sorted.size(), detail::kElementsPerLook, execution, [&](std::size_t begin, std::size_t end) {
    const auto from = static_cast<std::ptrdiff_t>(begin), to = static_cast<std::ptrdiff_t>(end);
    std::copy(sorted.begin() + from, sorted.begin() + to, points_.begin() + first + from);
  });
  std::fill(state_.begin() + first, state_.begin() + first + count, VertexState::kVisible);
  std::fill(state_.begin() + first + count, state_.end(), VertexState::kRemoved);
}

/// Inserts the first `count` points of the order; the others are removed ones.
void RegularTriangulation::build(detail::InsertionOrder& order, Index count, const Execution& execution) {
  std::vector<Index>& id_of_rank = order.ids;
  const Index first = num_vertices() - static_cast<Index>(id_of_rank.size());
  move_into_order(id_of_rank, first, count, execution.part(0, 0.03));
  // 7 in a volume. Insertions one by one may follow, and moving the cells of a million points would take a tenth of a second.
  constexpr std::size_t kRoomPerPoint = 10;
  const std::size_t expected_cells = cells_.size() + id_of_rank.size() * kRoomPerPoint + 64;
  cells_.reserve(expected_cells);
  mark_.reserve(expected_cells);
  const Execution inserting = execution.part(0.03, 0.92);
  bulk_ = &inserting;
  Index next = first;
  bool together = false;
  if (dimension_ < 3) {
    start_simplex({first, first + 1, first + 2, first + 3});
    next = first + 4;
    together = first == 0 && execution.workers() > 1;  // no cell holds hidden points yet, which threads would fight for
  }
  const auto share = [&](Index v) { return static_cast<double>(v - first) / static_cast<double>(count); };
  constexpr Index kInsertionsPerLook = 256;
  const auto insert_rank = [&](Index v) {
    last_cell_ = insert_vertex(v, last_cell_);
    if (state(v) == VertexState::kDuplicate) settle_duplicate(v, first, id_of_rank);
    if (v % kInsertionsPerLook == 0) inserting.report(share(v));
  };
  for (Index round_end : order.round_ends) {
    round_end += first;
    if (!together) {
      for (Index v = next; v < round_end; ++v) insert_rank(v);
    } else if (next < round_end) {
      // Threads need cells all over space that each can begin with: of the first round some go in before.
      constexpr Index kFirstOnes = 4;
      const bool first_round = next == first + 4;
      std::vector<Index> left;
      for (Index v = next; v < round_end; ++v) {
        if (first_round && v % kFirstOnes == 0) {
          insert_rank(v);
        } else {
          left.push_back(v);
        }
      }
      const std::size_t wanted = left.size();
      // Where long cells join the parts most insertions are given up, and it will not get better.
      if (insert_in_parallel(left, round_end, inserting.part(share(next), share(round_end))))
        together = 4 * left.size() < wanted;
      for (const Index v : left) insert_rank(v);
      for (Index v = first; v < round_end; ++v) {
        if (state(v) == VertexState::kDuplicate && vertex_cell_[slot(v)] != kNone) settle_duplicate(v, first, id_of_rank);
      }
    }
    next = round_end;
  }
  bulk_ = nullptr;
  finish_bulk(first, id_of_rank, execution.part(0.92, 1));
}

/// Of equal points the lowest id stays: the vertex in the cells takes it over.
void RegularTriangulation::settle_duplicate(Index rank, Index first, std::vector<Index>& id_of_rank) {
  const Index twin = std::exchange(vertex_cell_[slot(rank)], kNone);
  if (twin < first) return;
  Index &id = id_of_rank[slot(rank - first)], &twin_id = id_of_rank[slot(twin - first)];
  if (twin_id > id) std::swap(id, twin_id);
}

/// Back from ranks to the caller's ids, and what insertion leaves undone in bulk: cells of vertices, hidden points, counts.
void RegularTriangulation::finish_bulk(Index first, const std::vector<Index>& id_of_rank, const Execution& execution) {
  using detail::for_each_piece;
  using detail::kElementsPerLook;
  num_finite_ = num_ghosts_ = num_hidden_ = 0;
  for (Index v = 0; v < num_vertices(); ++v) {
    if (v >= first || state(v) == VertexState::kVisible) vertex_cell_[slot(v)] = kNone;
  }
  constexpr std::size_t kCellGrain = 1 << 14;
  parallel_for(cells_.size(), kCellGrain, execution.part(0, 0.4), [&](std::size_t from, std::size_t to) {
    for (std::size_t c = from; c < to; ++c) {
      if (!cells_[c].alive()) continue;
      for (Index& v : cells_[c].vertex) v = v >= first ? id_of_rank[slot(v - first)] : v;
    }
  });
  for_each_piece(cells_.size(), kElementsPerLook, execution.part(0.4, 0.75), [&](std::size_t from, std::size_t to) {
    for (std::size_t c = from; c < to; ++c) {
      const Cell& here = cells_[c];
      if (!here.alive()) continue;
      ++(here.ghost() ? num_ghosts_ : num_finite_);
      for (const Index v : here.vertex) {
        if (v != kInfinite) vertex_cell_[slot(v)] = static_cast<Index>(c);
      }
    }
  });
  execution.report(0.75);
  const std::vector<WeightedPoint> points(points_.begin() + first, points_.end());
  const std::vector<VertexState> states(state_.begin() + first, state_.end());
  for_each_piece(id_of_rank.size(), kElementsPerLook, execution.part(0.8, 0.85), [&](std::size_t from, std::size_t to) {
    for (std::size_t k = from; k < to; ++k) {
      points_[slot(id_of_rank[k])] = points[k];
      state_[slot(id_of_rank[k])] = states[k];
    }
  });
  // Vertices left without a cell have been hidden by a later one. Earlier hidden points keep their cell if it still lives.
  const auto settle = [this](Index v) {
    if (state(v) == VertexState::kRemoved) return;
    if (vertex_cell_[slot(v)] == kNone) {
      if (state(v) == VertexState::kVisible) state_[slot(v)] = VertexState::kHidden;
      unplaced_.push_back(v);
    }
    if (state(v) != VertexState::kVisible) ++num_hidden_;
  };
  for (Index v = 0; v < first; ++v) settle(v);
  for_each_piece(id_of_rank.size(), kElementsPerLook, execution.part(0.85, 0.9), [&](std::size_t from, std::size_t to) {
    for (std::size_t k = from; k < to; ++k) settle(id_of_rank[k]);  // along the curve: the walks of place_hidden are short
  });
  const Execution placing = execution.part(0.9, 1);
  place_hidden(last_cell_, &placing);
}

void RegularTriangulation::start_simplex(const std::array<Index, 4>& corner) {
  dimension_ = 3;
  std::array<Index, 4> v = corner;
  if (orient3d(point(v[0]), point(v[1]), point(v[2]), point(v[3])) < 0) std::swap(v[0], v[1]);
  cells_.clear();
  work_.free_cells.clear();
  cells_.push_back({v, {}});
  for (int f = 0; f < 4; ++f) {
    const int* face = kFaceCorners[f];
    cells_.push_back({{v[slot(face[0])], v[slot(face[1])], v[slot(face[2])], kInfinite}, {}});
  }
  mark_.assign(5, kUntested);
  for (int f = 0; f < 4; ++f) {
    // Ghost 1 + f is glued to face f of the cell, and to ghost 1 + g across the edge that misses its corner g.
    cells_[0].neighbor[slot(f)] = 4 * (1 + f) + 3;
    Cell& ghost = cells_[slot(1 + f)];
    ghost.neighbor[3] = f;
    for (std::size_t s = 0; s < 3; ++s) {
      const int g = kFaceCorners[f][s];
      const int* other = kFaceCorners[g];
      const int back = other[0] == f ? 0 : (other[1] == f ? 1 : 2);
      ghost.neighbor[s] = 4 * (1 + g) + back;
    }
    vertex_cell_[slot(v[slot(f)])] = 0;
  }
  num_finite_ = 1;
  num_ghosts_ = 4;
  last_cell_ = 0;
}

// One insertion

Index RegularTriangulation::insert(const Vec3& position, double weight, Index hint) {
  const Index v = num_vertices();
  const ValuesView weights(&weight, 1);
  append_points({position.data(), 1}, &weights);
  hidden_by_last_.clear();
  if (dimension_ < 3) {
    if (extend_basis(v)) bulk_insert(v, {});
    return v;
  }
  place(v, hint);
  if (state(v) != VertexState::kVisible) hidden_by_last_.push_back(v);
  place_hidden(last_cell_);
  return v;
}

/// Returns a cell near v. A duplicate gets its twin as vertex_cell_, for the caller to settle who keeps the lower id.
Index RegularTriangulation::insert_vertex(Index v, Index hint) {
  const WeightedPoint q = point(v);
  const Index start = walk(q, hint, bounds_);
  const Cell& home = cell(start);
  for (const Index u : home.vertex) {
    if (u != kInfinite && same_position(point(u), q) && point(u).w == q.w) {
      hide(v, VertexState::kDuplicate);
      vertex_cell_[slot(v)] = u;
      return start;
    }
  }
  if (!home.ghost() && !in_conflict(start, q)) {  // a ghost that q sees is always in conflict
    hide(v, VertexState::kHidden);
    return start;
  }
  dig_cavity(start, q);
  if (!bulk_) collect_cavity_vertices();
  if (!hidden_head_.empty()) {
    for (const Index c : work_.conflict) release_hidden(c);
  }
  return fill_cavity(work_, v);
}

bool RegularTriangulation::decide_conflict(Index c, const WeightedPoint& q) const {
  const Cell* cell = &cells_[slot(c)];
  if (cell->ghost()) {
    const int side = orient3d(point(cell->vertex[0]), point(cell->vertex[1]), point(cell->vertex[2]), q, bounds_);
    if (side != 0) return side > 0;
    // q lies in the plane of the hull facet: it conflicts iff it lies in the facet's power circle, which is where that plane
    // cuts the orthogonal sphere of the finite cell behind it.
    cell = &cells_[slot(cell->neighbor[3] >> 2)];
  }
  return power_test(point(cell->vertex[0]), point(cell->vertex[1]), point(cell->vertex[2]), point(cell->vertex[3]), q,
                    bounds_) > 0;
}

/// Visibility walk: cross any face that separates the cell from q. It never cycles in a regular triangulation (Edelsbrunner,
/// "An acyclicity theorem for cell complexes", 1989).
Index RegularTriangulation::walk(const WeightedPoint& q, Index start, const detail::StaticBounds& bounds) const {
  Index c = start;
  if (cell(c).ghost()) c = cell(c).neighbor[3] >> 2;
  int entry = -1;
  for (;;) {
    const Cell& here = cell(c);
    const WeightedPoint* p[4];
    for (std::size_t k = 0; k < 4; ++k) p[k] = &points_[slot(here.vertex[k])];
    int exit = -1;
    for (int f = 0; f < 4 && exit < 0; ++f) {
      if (f == entry) continue;
      const int* face = kFaceCorners[f];
      // Counter-clockwise seen from outside: positive means q is beyond it.
      if (orient3d(*p[face[0]], *p[face[1]], *p[face[2]], q, bounds) > 0) exit = f;
    }
    if (exit < 0) return c;
    const Index next = here.neighbor[slot(exit)];
    c = next >> 2;
    entry = next & 3;
    if (cell(c).ghost()) return c;
  }
}

namespace detail {
namespace {

/// A cavity of so many cells is looked at for a cancel while it is dug and filled: of a point that sees most of the hull.
constexpr std::size_t kManyCells = std::size_t{1} << 14;

}  // namespace
}  // namespace detail

/// Out of line, so that the loops around it stay small.
void RegularTriangulation::look() const {
  if (bulk_ != nullptr) bulk_->report(0);
}

/// Collects the cells in conflict with q, and the facets around them. Whether a cell is in conflict cannot be predicted, nor
/// whether it has been met: no branch depends on either, so that tests overlap, which takes a quarter off an insertion's time.
void RegularTriangulation::dig_cavity(Index start, const WeightedPoint& q) {
  Workspace& work = work_;
  const Cell* const cells = cells_.data();
  std::uint8_t* const mark = mark_.data();
  start_cavity(work, start);
  std::size_t next_look = detail::kManyCells;
  for (std::size_t entered = 0, found = 1; entered < found;) {
    if (entered >= next_look) {
      look();
      next_look += detail::kManyCells;
    }
    make_room(work, entered, found);
    Index* const conflict = work.conflict.data();
    Index* const untested = work.untested.data();
    // All neighbours of the cells found last, each once; those are tested next.
    std::size_t count = 0;
    for (; entered < found; ++entered) {
      for (const Index face : cells[slot(conflict[entered])].neighbor) {
        const Index beyond = face >> 2;
        const std::uint8_t before = mark[slot(beyond)];
        untested[count] = beyond;
        count += before == kUntested;
        mark[slot(beyond)] = before == kInConflict ? before : std::uint8_t{kOutside};
        detail::prefetch(&cells[slot(beyond)]);
      }
    }
    found = test_cells(work, found, count, q);
    if (entered == found) work.conflict.resize(found);
  }
  collect_boundary(work);
}

void RegularTriangulation::start_cavity(Workspace& work, Index start) {
  constexpr std::size_t kUsualRoom = 256;
  work.conflict.resize(std::max(work.conflict.capacity(), kUsualRoom));
  work.untested.resize(std::max(work.untested.capacity(), kUsualRoom));
  work.conflict[0] = start;
  mark_[slot(start)] = kInConflict;
}

/// Room for all neighbours of the cells from `entered` to `found`.
void RegularTriangulation::make_room(Workspace& work, std::size_t entered, std::size_t found) {
  const std::size_t most = 4 * (found - entered);
  if (work.untested.size() < most) work.untested.resize(2 * most);
  if (work.conflict.size() < found + most) work.conflict.resize(2 * (found + most));
}

/// Marks `count` cells and appends those in conflict with q to the `found` that are known. Returns how many are then.
std::size_t RegularTriangulation::test_cells(Workspace& work, std::size_t found, std::size_t count, const WeightedPoint& q) {
  Index* const conflict = work.conflict.data();
  const Index* const untested = work.untested.data();
  std::uint8_t* const mark = mark_.data();
  for (std::size_t k = 0; k < count; ++k) {
    const Index c = untested[k];
    for (const Index face : cell(c).neighbor) detail::prefetch(&mark[slot(face >> 2)]);  // a twentieth on a torus
    const bool inside = in_conflict(c, q);
    mark[slot(c)] = inside ? kInConflict : kOutside;
    conflict[found] = c;
    found += inside;
  }
  return found;
}

/// The facets between cells in conflict and others.
void RegularTriangulation::collect_boundary(Workspace& work) const {
  const Cell* const cells = cells_.data();
  const std::uint8_t* const mark = mark_.data();
  work.boundary.resize(4 * work.conflict.size());
  BoundaryFacet* const boundary = work.boundary.data();
  std::size_t count = 0;
  for (const Index c : work.conflict) {
    for (int f = 0; f < 4; ++f) {
      const Index beyond = cells[slot(c)].neighbor[slot(f)];
      boundary[count] = {4 * c + f, beyond};
      count += mark[slot(beyond >> 2)] != kInConflict;
    }
  }
  work.boundary.resize(count);
}

/// A new stamp for work.local: what other insertions left there is void.
std::uint32_t RegularTriangulation::next_stamp(Workspace& work) const {
  if (work.local.size() < points_.size() + 2) {
    work.local.reserve(points_.capacity() + 2);
    work.local.resize(points_.size() + 2, 0);
  }
  work.stamp += kStampStep;
  if (work.stamp == 0) {  // after 2^24 stamps
    std::fill(work.local.begin(), work.local.end(), 0);
    work.stamp = kStampStep;
  }
  return work.stamp;
}

/// Lists the vertices on the cavity's boundary, and hides those inside: the new point dominates them.
void RegularTriangulation::collect_cavity_vertices() {
  cavity_vertices_.clear();
  cavity_facet_of_.clear();
  const std::uint32_t stamp = next_stamp(work_);
  for (std::size_t n = 0; n < work_.boundary.size(); ++n) {
    const Cell& c = cell(work_.boundary[n].inside >> 2);
    for (const int k : kFaceCorners[work_.boundary[n].inside & 3]) {
      const Index u = c.vertex[slot(k)];
      if (work_.local[slot(u + 2)] == stamp) continue;
      work_.local[slot(u + 2)] = stamp;
      cavity_vertices_.push_back(u);
      cavity_facet_of_.push_back(n);
    }
  }
  if (!weights_vary_) return;
  for (const Index c : work_.conflict) {
    for (const Index u : cell(c).vertex) {
      if (u == kInfinite || work_.local[slot(u + 2)] == stamp || state(u) != VertexState::kVisible) continue;
      hide(u, VertexState::kHidden);
      hidden_by_last_.push_back(u);
      unplaced_.push_back(u);
    }
  }
  std::sort(hidden_by_last_.begin(), hidden_by_last_.end());
}

/// Replaces the cavity by the star of v: one new cell on each facet of its boundary.
Index RegularTriangulation::fill_cavity(Workspace& work, Index v) {
  const bool large = work.conflict.size() > detail::kManyCells;
  for (BoundaryFacet& facet : work.boundary) {
    const Index c = allocate_cell(work);
    Cell& cell = cells_[slot(c)];
    const int k = facet.inside & 3;
    cell.vertex = cells_[slot(facet.inside >> 2)].vertex;
    cell.vertex[slot(k)] = v;
    cell.neighbor[slot(k)] = facet.outside;
    cells_[slot(facet.outside >> 2)].neighbor[slot(facet.outside & 3)] = 4 * c + k;
    // Read before writing: in parallel, cells that nobody owns are never marked and must not be written to.
    if (mark_[slot(facet.outside >> 2)] != kUntested) mark_[slot(facet.outside >> 2)] = kUntested;
    facet.inside = 4 * c + k;
    if (!bulk_) ++(cell.ghost() ? num_ghosts_ : num_finite_);
  }
  if (!bulk_) {  // else finish_bulk does this once for all cells
    for (std::size_t k = 0; k < cavity_vertices_.size(); ++k) {
      const Index u = cavity_vertices_[k];
      if (u != kInfinite) vertex_cell_[slot(u)] = work.boundary[cavity_facet_of_[k]].inside >> 2;
    }
    vertex_cell_[slot(v)] = work.boundary.front().inside >> 2;
    for (const Index old : work.conflict) --(cells_[slot(old)].ghost() ? num_ghosts_ : num_finite_);
  }
  if (large) look();
  for (const Index old : work.conflict) {
    Cell& dead = cells_[slot(old)];
    dead.vertex[0] = kNone;
    mark_[slot(old)] = kUntested;
    work.free_cells.push_back(old);
  }
  if (large) look();
  if (work.boundary.size() / 2 + 2 <= kSmallStar) {
    glue_small_star(work);
  } else {
    glue_large_star(work);
  }
  return work.boundary.front().inside >> 2;  // next to where the walk ended; the last one may be far away (torus: 5 % slower)
}

/// Glues the new cells to each other through a table of directed edges, at most 16 KiB. Each directed edge of the cavity's
/// boundary belongs to one facet, and its reverse to the facet next to it. No branch depends on the data: an edge hash, whose
/// hits cannot be predicted, takes 0.5 µs an insertion more in a volume.
void RegularTriangulation::glue_small_star(Workspace& work) {
  const std::size_t side = work.boundary.size() / 2 + 2;  // Euler: so many vertices are on the boundary
  const std::uint32_t stamp = next_stamp(work);
  std::array<std::array<std::uint8_t, 3>, 2 * kSmallStar> number;
  std::array<Index, kSmallStar * kSmallStar> face_at;
  std::uint32_t count = 0;
  for (std::size_t k = 0; k < work.boundary.size(); ++k) {
    const Index c = work.boundary[k].inside >> 2;
    const auto& vertex = cells_[slot(c)].vertex;
    const int* corner = kFaceCorners[work.boundary[k].inside & 3];
    for (std::size_t e = 0; e < 3; ++e) {
      std::uint32_t& local = work.local[slot(vertex[slot(corner[e])] + 2)];
      const bool first_seen = (local & ~(kStampStep - 1)) != stamp;
      local = first_seen ? stamp | count : local;
      count += first_seen;
      number[k][e] = static_cast<std::uint8_t>(local);
    }
    face_at[number[k][0] * side + number[k][1]] = 4 * c + corner[2];
    face_at[number[k][1] * side + number[k][2]] = 4 * c + corner[0];
    face_at[number[k][2] * side + number[k][0]] = 4 * c + corner[1];
  }
  for (std::size_t k = 0; k < work.boundary.size(); ++k) {
    auto& neighbor = cells_[slot(work.boundary[k].inside >> 2)].neighbor;
    const int* corner = kFaceCorners[work.boundary[k].inside & 3];
    neighbor[slot(corner[2])] = face_at[number[k][1] * side + number[k][0]];
    neighbor[slot(corner[0])] = face_at[number[k][2] * side + number[k][1]];
    neighbor[slot(corner[1])] = face_at[number[k][0] * side + number[k][2]];
  }
}

/// The same by a hash of edges, for cavities whose table would not stay in cache.
void RegularTriangulation::glue_large_star(Workspace& work) {
  int bits = 6;
  while ((std::size_t{1} << bits) < 4 * work.boundary.size()) ++bits;  // 3/2 edges a facet: at most 3/8 full
  constexpr std::uint64_t kEmpty = ~std::uint64_t{0};
  work.open_edges.assign(std::size_t{1} << bits, {kEmpty, kNone});
  const std::size_t last = work.open_edges.size() - 1;
  for (const BoundaryFacet& facet : work.boundary) {
    Cell& cell = cells_[slot(facet.inside >> 2)];
    const int* corner = kFaceCorners[facet.inside & 3];
    for (int e = 0; e < 3; ++e) {
      const Index a = cell.vertex[slot(corner[e == 2 ? 0 : e + 1])], b = cell.vertex[slot(corner[e == 0 ? 2 : e - 1])];
      const Index face = (facet.inside & ~3) + corner[e];
      const std::uint64_t edge =
          std::uint64_t{static_cast<std::uint32_t>(std::max(a, b))} << 32 | static_cast<std::uint32_t>(std::min(a, b));
      std::size_t k = (edge * 0x9e3779b97f4a7c15u) >> (64 - bits);
      while (work.open_edges[k].edge != kEmpty && work.open_edges[k].edge != edge) k = (k + 1) & last;
      OpenEdge& open = work.open_edges[k];
      if (open.edge == kEmpty) {
        open = {edge, face};
        continue;
      }
      cell.neighbor[slot(corner[e])] = open.face;
      cells_[slot(open.face >> 2)].neighbor[slot(open.face & 3)] = face;
    }
  }
}

Index RegularTriangulation::allocate_cell(Workspace& work) {
  if (!work.free_cells.empty()) {
    const Index c = work.free_cells.back();
    work.free_cells.pop_back();
    return c;
  }
  if (work.next_cell < work.end_cell) return work.next_cell++;
  cells_.push_back({});
  mark_.push_back(kUntested);
  if (!hidden_head_.empty()) hidden_head_.push_back(kNone);
  return static_cast<Index>(cells_.size()) - 1;
}

// Hidden points

void RegularTriangulation::hide(Index v, VertexState state) {
  state_[slot(v)] = state;
  vertex_cell_[slot(v)] = kNone;
  ++num_hidden_;
}

void RegularTriangulation::attach_hidden(Index v, Index c) {
  hidden_head_.resize(cells_.size(), kNone);
  hidden_next_.resize(points_.size(), kNone);
  hidden_next_[slot(v)] = hidden_head_[slot(c)];
  hidden_head_[slot(c)] = v;
  vertex_cell_[slot(v)] = c;
  // What it is called depends on what is visible there now, not on the order in which things came.
  state_[slot(v)] = VertexState::kHidden;
  for (const Index u : cell(c).vertex) {
    if (u != kInfinite && same_position(point(u), point(v)) && point(u).w == point(v).w)
      state_[slot(v)] = VertexState::kDuplicate;
  }
}

/// The cell is about to vanish: its hidden points wait for place_hidden (in bulk, for the end).
void RegularTriangulation::release_hidden(Index c) {
  for (Index v = hidden_head_[slot(c)]; v != kNone; v = hidden_next_[slot(v)]) {
    vertex_cell_[slot(v)] = kNone;
    if (!bulk_) unplaced_.push_back(v);
  }
  hidden_head_[slot(c)] = kNone;
}

/// Attaches waiting hidden points to the finite cells that contain them.
void RegularTriangulation::place_hidden(Index hint, const Execution* execution) {
  constexpr std::size_t kPlacedPerLook = 1024;
  for (std::size_t k = 0; k < unplaced_.size(); ++k) {
    const Index v = unplaced_[k];
    hint = walk(point(v), hint, bounds_);
    attach_hidden(v, hint);
    if (execution != nullptr && k % kPlacedPerLook == 0) {
      execution->report(static_cast<double>(k) / static_cast<double>(unplaced_.size()));
    }
  }
  unplaced_.clear();
}

}  // namespace amps
