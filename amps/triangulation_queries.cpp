// Queries of a triangulation, and its proof.
#define AMPS_OWN_SOURCE
#include "amps/triangulation.h"

#include "amps/execution.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <utility>

namespace amps {
namespace detail {
namespace {

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

}  // namespace
}  // namespace detail

using detail::kFaceCorners;
using detail::slot;

Tetrahedra RegularTriangulation::cells(const Execution& execution) const {
  const Execution run = execution.start("listing tetrahedra");
  Tetrahedra result(num_finite_);
  std::ptrdiff_t row = 0;
  detail::for_each_piece(cells_.size(), detail::kElementsPerLook, run, [&](std::size_t begin, std::size_t end) {
    for (std::size_t at = begin; at < end; ++at) {
      const Cell& c = cells_[at];
      if (!c.alive() || c.ghost()) continue;
      for (int k = 0; k < 4; ++k) result(row, k) = c.vertex[slot(k)];
      ++row;
    }
  });
  run.finish();
  return result;
}

Triangles RegularTriangulation::hull(const Execution& execution) const {
  const Execution run = execution.start("listing the hull");
  Triangles result(num_ghosts_);
  std::ptrdiff_t row = 0;
  detail::for_each_piece(cells_.size(), detail::kElementsPerLook, run, [&](std::size_t begin, std::size_t end) {
    for (std::size_t at = begin; at < end; ++at) {
      const Cell& c = cells_[at];
      if (!c.alive() || !c.ghost()) continue;
      for (int k = 0; k < 3; ++k) result(row, k) = c.vertex[slot(k)];
      ++row;
    }
  });
  run.finish();
  return result;
}

void RegularTriangulation::incident_cells(Index v, std::vector<Index>& out) const {
  out.clear();
  if (dimension_ < 3 || state(v) != VertexState::kVisible) return;
  detail::IndexSet seen;
  out.push_back(vertex_cell_[slot(v)]);
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

namespace detail {
namespace {

/// Edges of a cell, as pairs of corners, that lie in two faces of a set of its faces each.
struct CellEdges {
  std::uint8_t count = 0;
  std::array<std::array<std::uint8_t, 2>, 6> corner{};
};

/// By set of faces, a bit each. Of ghosts only the finite edges: those of the face opposite to corner 3.
constexpr std::array<CellEdges, 16> edges_between_faces(bool ghost) {
  std::array<CellEdges, 16> result{};
  for (unsigned faces = 0; faces < 16; ++faces) {
    for (unsigned i = 0; i < 4; ++i) {
      for (unsigned j = i + 1; j < (ghost ? 3u : 4u); ++j) {
        // A face has the number of the corner that is not on it.
        const unsigned other_faces = 15u & ~(1u << i) & ~(1u << j);
        if ((faces & other_faces) != other_faces) continue;
        CellEdges& edges = result[faces];
        edges.corner[edges.count][0] = static_cast<std::uint8_t>(i);
        edges.corner[edges.count][1] = static_cast<std::uint8_t>(j);
        ++edges.count;
      }
    }
  }
  return result;
}
constexpr std::array<CellEdges, 16> kEdgesBetweenFaces[2] = {edges_between_faces(false), edges_between_faces(true)};

}  // namespace
}  // namespace detail

/// Calls visit(a, b) for edges of cells begin … end − 1, such that over all cells every edge comes once or a few times: of the
/// cells around an edge, those that come before both of their neighbours there. That is a third of all.
template <class Visit>
void RegularTriangulation::visit_edges(std::size_t begin, std::size_t end, const Visit& visit) const {
  for (std::size_t at = begin; at < end; ++at) {
    const Cell& c = cells_[at];
    if (!c.alive()) continue;
    unsigned later = 0;  // faces with a later cell behind them
    for (unsigned f = 0; f < 4; ++f) later |= (slot(c.neighbor[f] >> 2) > at ? 1u : 0u) << f;
    const detail::CellEdges& edges = detail::kEdgesBetweenFaces[c.ghost() ? 1 : 0][later];
    for (std::size_t e = 0; e < edges.count; ++e) visit(c.vertex[edges.corner[e][0]], c.vertex[edges.corner[e][1]]);
  }
}

RegularTriangulation::Adjacency RegularTriangulation::adjacency(const Execution& execution) const {
  // Count, scatter, then thin and sort each vertex's list. Each thread has a part of the cells, and of the vertices, as its
  // own.
  constexpr std::size_t kMostWorkers = 8, kLeastPerWorker = 1 << 12;
  const Execution run = execution.start("listing neighbours");
  const std::size_t n = points_.size();
  const std::size_t workers = std::min({std::size_t{run.workers()}, kMostWorkers, n / kLeastPerWorker + 1});
  const auto in_parts = [workers](std::size_t count, const Execution& part, const auto& body) {
    detail::WorkCounter done(part, count);
    parallel_for(workers, 1, part, [&](std::size_t k, std::size_t) {
      constexpr std::size_t kPerLook =
          detail::kElementsPerLook / 8;  // each may touch several pages of memory for the first time
      for (std::size_t from = count * k / workers, end = count * (k + 1) / workers; from < end;) {
        const std::size_t to = std::min(from + kPerLook, end);
        body(k, from, to);
        done.add(to - from);
        from = to;
      }
    });
  };
  std::vector<std::vector<Index>> cursor(workers);
  for (std::vector<Index>& part : cursor) detail::resize_watched(part, n, 0, run.part(0, 0));
  in_parts(cells_.size(), run.part(0, 0.2), [&](std::size_t k, std::size_t from, std::size_t to) {
    Index* const count = cursor[k].data();
    visit_edges(from, to, [count](Index a, Index b) {
      ++count[a];
      ++count[b];
    });
  });
  Index total = 0;
  detail::for_each_piece(n, detail::kElementsPerLook, run.part(0.2, 0.25), [&](std::size_t from, std::size_t to) {
    for (std::size_t v = from; v < to; ++v) {
      for (std::vector<Index>& part : cursor) total += std::exchange(part[v], total);
    }
  });
  std::vector<Index, detail::UninitializedAllocator<Index>> scattered(slot(total));
  in_parts(cells_.size(), run.part(0.25, 0.5), [&](std::size_t k, std::size_t from, std::size_t to) {
    Index *const at = cursor[k].data(), *const out = scattered.data();
    visit_edges(from, to, [at, out](Index a, Index b) {
      out[at[a]++] = b;
      out[at[b]++] = a;
    });
  });
  const std::vector<Index>& list_end = cursor.back();
  const auto list_begin = [&list_end](std::size_t v) { return v == 0 ? 0 : list_end[v - 1]; };
  Adjacency result;
  detail::resize_watched(result.offset, n + 1, 0, run.part(0.5, 0.5));
  std::vector<std::vector<Index>> last_seen(workers);
  for (std::vector<Index>& part : last_seen) detail::resize_watched(part, n, kNone, run.part(0.5, 0.5));
  in_parts(n, run.part(0.5, 0.9), [&](std::size_t k, std::size_t from, std::size_t to) {
    for (std::size_t v = from; v < to; ++v) {
      Index* const list = scattered.data() + list_begin(v);
      Index* end = list;
      for (Index m = list_begin(v); m < list_end[v]; ++m) {
        const Index u = scattered[slot(m)];
        if (std::exchange(last_seen[k][slot(u)], static_cast<Index>(v)) != static_cast<Index>(v)) *end++ = u;
      }
      std::sort(list, end);
      result.offset[v + 1] = static_cast<Index>(end - list);
    }
  });
  for (std::size_t v = 0; v < n; ++v) result.offset[v + 1] += result.offset[v];
  detail::resize_watched(result.adjacent, slot(result.offset.back()), 0, run.part(0.9, 0.9));
  in_parts(n, run.part(0.9, 1), [&](std::size_t, std::size_t from, std::size_t to) {
    for (std::size_t v = from; v < to; ++v) {
      const Index* const list = scattered.data() + list_begin(v);
      std::copy(list, list + (result.offset[v + 1] - result.offset[v]), result.adjacent.begin() + result.offset[v]);
    }
  });
  run.finish();
  return result;
}

namespace detail {
namespace {

void require_finite(const Vec3& x) {
  if (!x.allFinite())
    throw Error(ErrorCode::kInvalidArgument, "triangulation: the point to look up is not finite (NaN or infinity)");
}

}  // namespace
}  // namespace detail

Index RegularTriangulation::locate(const Vec3& x, Index hint) const {
  if (dimension_ < 3) return kNone;
  if (hint == kNone || hint >= cell_capacity() || !cell(hint).alive()) hint = last_cell_;
  detail::require_finite(x);
  // The static bound holds for points within the box of the set only, and x need not lie on the set's lattice.
  const bool in_box = (box_min_.array() <= x.array()).all() && (x.array() <= box_max_.array()).all();
  detail::StaticBounds bounds;
  if (in_box) bounds.orientation = bounds_.orientation;
  return walk({x.x(), x.y(), x.z(), 0.0}, hint, bounds);
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
      if (state(v) == VertexState::kRemoved) continue;
      if (best == kNone || detail::nearer_in_power(x, point(v), point(best))) best = v;
    }
    return best;
  }
  Index best = near;
  const auto improve = [&](Index u) { best = detail::nearer_in_power(x, point(u), point(best)) ? u : best; };
  if (near < 0 || near >= num_vertices() || !is_vertex(near)) {
    // From cell to cell is faster than from vertex to vertex.
    const Cell& home = cell(locate(x));
    best = home.vertex[0];
    for (std::size_t k = 1; k < (home.ghost() ? 3u : 4u); ++k) improve(home.vertex[k]);
  }
  // If v is not the nearest, the segment from its power cell to x leaves through a bisector whose other site is nearer.
  std::vector<Index> star;
  for (Index from = kNone; from != best;) {
    from = best;
    incident_cells(from, star);
    for (const Index c : star) {
      for (const Index u : cell(c).vertex) {
        if (u != kInfinite && u != best) improve(u);
      }
    }
  }
  return best;
}

// Proof

namespace detail {
namespace {

std::string cell_name(Index c) { return "cell " + std::to_string(c); }

}  // namespace
}  // namespace detail

std::string RegularTriangulation::check(int level, const Execution& execution) const {
  const Execution run = execution.start("checking the triangulation");
  std::string violation = find_violation(level, run);
  run.finish();
  return violation;
}

std::string RegularTriangulation::find_violation(int level, const Execution& execution) const {
  using detail::cell_name;
  if (dimension_ < 3) return num_finite_ == 0 ? "" : "cells in a flat set";
  Index finite = 0, ghosts = 0;
  // Once over all cells and points, and over the cells again.
  detail::Ticker ticker(execution, 2 * cells_.size() + points_.size());
  for (Index c = 0; c < cell_capacity(); ++c) {
    ticker.tick();
    const Cell& here = cell(c);
    if (!here.alive()) continue;
    ++(here.ghost() ? ghosts : finite);
    for (std::size_t k = 0; k < 4; ++k) {
      const Index v = here.vertex[k];
      if (v == kInfinite ? k != 3 : (v < 0 || v >= num_vertices())) return cell_name(c) + ": corner out of range";
      if (v != kInfinite && state(v) != VertexState::kVisible) return cell_name(c) + ": hidden corner " + std::to_string(v);
      const Index n = here.neighbor[k];
      if (n < 0 || (n >> 2) >= cell_capacity() || !cell(n >> 2).alive()) return cell_name(c) + ": neighbour out of range";
      if (cell(n >> 2).neighbor[slot(n & 3)] != 4 * c + static_cast<Index>(k)) return cell_name(c) + ": asymmetric neighbour";
      std::array<Index, 3> mine{}, theirs{};
      for (std::size_t m = 0; m < 3; ++m) {
        mine[m] = here.vertex[slot(kFaceCorners[k][m])];
        theirs[m] = cell(n >> 2).vertex[slot(kFaceCorners[n & 3][m])];
      }
      // The neighbour sees the face from the other side: the same cycle backwards.
      const bool mirrored = (mine[0] == theirs[0] && mine[1] == theirs[2] && mine[2] == theirs[1]) ||
                            (mine[0] == theirs[1] && mine[1] == theirs[0] && mine[2] == theirs[2]) ||
                            (mine[0] == theirs[2] && mine[1] == theirs[1] && mine[2] == theirs[0]);
      if (!mirrored) return cell_name(c) + ": face " + std::to_string(k) + " is not its neighbour's";
    }
    if (!here.ghost() &&
        orient3d(point(here.vertex[0]), point(here.vertex[1]), point(here.vertex[2]), point(here.vertex[3])) <= 0) {
      return cell_name(c) + ": not positively oriented";
    }
  }
  if (finite != num_finite_ || ghosts != num_ghosts_) return "cell counts are off";
  Index hidden = 0;
  for (Index v = 0; v < num_vertices(); ++v) {
    ticker.tick();
    if (state(v) == VertexState::kRemoved) continue;
    const Index c = vertex_cell_[slot(v)];
    if (c < 0 || c >= cell_capacity() || !cell(c).alive()) return "vertex " + std::to_string(v) + ": no cell";
    if (state(v) != VertexState::kVisible) {
      ++hidden;
      if (cell(c).ghost()) return "hidden point " + std::to_string(v) + " in a ghost cell";
      const auto& corner = cell(c).vertex;
      for (int f = 0; f < 4; ++f) {
        const int* face = kFaceCorners[f];
        if (orient3d(point(corner[slot(face[0])]), point(corner[slot(face[1])]), point(corner[slot(face[2])]), point(v)) > 0) {
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
    ticker.tick();
    const Cell& here = cell(c);
    if (!here.alive()) continue;
    for (std::size_t k = 0; k < 4; ++k) {
      const Index n = here.neighbor[k];
      const Index apex = cell(n >> 2).vertex[slot(n & 3)];
      if (apex == kInfinite || here.vertex[k] == kInfinite) continue;
      if (in_conflict(c, point(apex))) {
        return (here.ghost() ? "hull not convex at " : "not regular at ") + cell_name(c);
      }
    }
  }
  if (level < 3) return "";
  for (Index v = 0; hidden > 0 && v < num_vertices(); ++v) {
    ticker.tick();
    if (state(v) == VertexState::kVisible || state(v) == VertexState::kRemoved) continue;
    const Index c = vertex_cell_[slot(v)];
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
