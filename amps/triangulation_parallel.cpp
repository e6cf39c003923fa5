// Parallel bulk insertion into a RegularTriangulation, without locks.
//
// The idea of HXT (Marot, Pellerin & Remacle, "One machine, one minute, three billion tetrahedra", 2019): every thread owns an
// interval of a space-filling curve, hence the vertices in it, and gives an insertion up when its cavity would leave them;
// those points are tried again with the intervals shifted by half, and what is left then goes in sequentially. The
// triangulation being unique, its cells are the sequential ones.
//
// Why there is no race. A thread deletes, creates and marks only cells all of whose vertices it owns (the infinite vertex
// counts as everybody's). Cells with vertices of several owners are nobody's: in this pass they stay, and of their neighbour
// links a thread reads and writes only those across faces with a vertex of its own; links across faces that are all its own are
// nobody else's business, others do not change. A step across a face with a vertex of its own leads to a cell that is its own
// or nobody's.
#define AMPS_OWN_SOURCE
#include "amps/triangulation.h"

#include "amps/execution.h"

#include <algorithm>

namespace amps {

using detail::slot;

namespace detail {
namespace {

/// Cells set aside for a thread at a time.
constexpr Index kCellChunk = 4096;

}  // namespace
}  // namespace detail

using detail::kCellChunk;

/// What the threads of a pass share.
struct RegularTriangulation::ParallelPass {
  const std::vector<std::uint32_t>& curve;  ///< by vertex
  std::atomic<Index> next_chunk;            ///< first cell not set aside yet
  Index capacity;
};

class RegularTriangulation::ParallelWorker {
 public:
  ParallelWorker(RegularTriangulation& triangulation, ParallelPass& pass) : t_(triangulation), pass_(pass) {}

  /// Owns the places low … low + span of the curve, around its end if need be.
  void own(std::uint32_t low, std::uint32_t span) {
    low_ = low;
    span_ = span;
  }
  bool owns(Index v) const { return v == kInfinite || pass_.curve[slot(v)] - low_ <= span_; }

  /// Can walks start here? It takes a living cell with a corner of its own.
  bool start_at(Index c) {
    if (c == kNone || !t_.cell(c).alive()) return false;
    hint_ = c;
    const auto& corner = t_.cell(c).vertex;
    return std::any_of(corner.begin(), corner.end(), [this](Index v) { return v != kInfinite && owns(v); });
  }

  void run(const std::vector<Index>& vertices, std::vector<Index>& given_up, detail::WorkCounter& done) {
    constexpr std::size_t kInsertionsPerLook = 256;
    for (std::size_t k = 0; k < vertices.size(); ++k) {
      if (!try_insert(vertices[k])) given_up.push_back(vertices[k]);
      if (k % kInsertionsPerLook == 0) done.add(kInsertionsPerLook);
    }
  }

  Index hint() const { return hint_; }
  Workspace& work() { return work_; }

 private:
  bool try_insert(Index v) {
    const WeightedPoint q = t_.point(v);
    const Index start = walk(q);
    if (start == kNone) return false;
    const Cell& home = t_.cell(start);
    for (const Index u : home.vertex) {
      if (u == kInfinite || !same_position(t_.point(u), q) || t_.point(u).w != q.w) continue;
      t_.state_[slot(v)] = VertexState::kDuplicate;
      t_.vertex_cell_[slot(v)] = u;  // settled after the pass
      return true;
    }
    if (!home.ghost() && !t_.in_conflict(start, q)) {
      t_.state_[slot(v)] = VertexState::kHidden;
      return true;
    }
    if (!std::all_of(home.vertex.begin(), home.vertex.end(), [this](Index u) { return owns(u); })) return false;
    if (!dig_cavity(start, q) || !provide_cells(work_.boundary.size())) {
      clear_marks();
      return false;
    }
    hint_ = t_.fill_cavity(work_, v);
    return true;
  }

  bool may_cross(const Cell& cell, int face) const {
    for (const int k : detail::kFaceCorners[face]) {
      const Index u = cell.vertex[slot(k)];
      if (u != kInfinite && owns(u)) return true;
    }
    return false;
  }

  /// As the sequential walk, kNone where it would leave the owned region.
  Index walk(const WeightedPoint& q) const {
    Index c = hint_;
    int entry = -1;
    if (t_.cell(c).ghost()) {
      if (!may_cross(t_.cell(c), 3)) return kNone;
      c = t_.cell(c).neighbor[3] >> 2;
    }
    for (;;) {
      const Cell& here = t_.cell(c);
      int exit = -1;
      for (int f = 0; f < 4 && exit < 0; ++f) {
        if (f == entry) continue;
        const int* face = detail::kFaceCorners[f];
        if (orient3d(t_.point(here.vertex[slot(face[0])]), t_.point(here.vertex[slot(face[1])]),
                     t_.point(here.vertex[slot(face[2])]), q, t_.bounds_) > 0) {
          exit = f;
        }
      }
      if (exit < 0) return c;
      if (!may_cross(here, exit)) return kNone;
      const Index next = here.neighbor[slot(exit)];
      c = next >> 2;
      entry = next & 3;
      if (t_.cell(c).ghost()) return c;
    }
  }

  /// As the sequential one; false if the cavity takes in a cell that is not its own. Cells that are nobody's are not marked.
  bool dig_cavity(Index start, const WeightedPoint& q) {
    const Cell* const cells = t_.cells_.data();
    std::uint8_t* const mark = t_.mark_.data();
    t_.start_cavity(work_, start);
    for (std::size_t entered = 0, found = 1; entered < found;) {
      make_room(work_, entered, found);
      std::size_t count = 0;
      for (; entered < found; ++entered) {
        for (const Index face : cells[slot(work_.conflict[entered])].neighbor) {
          const Index beyond = face >> 2;
          if (!owns(cells[slot(beyond)].vertex[slot(face & 3)])) {
            if (!t_.in_conflict(beyond, q)) continue;
            work_.conflict.resize(found);
            return false;
          }
          const std::uint8_t before = mark[slot(beyond)];
          work_.untested[count] = beyond;
          count += before == kUntested;
          mark[slot(beyond)] = before == kInConflict ? before : std::uint8_t{kOutside};
        }
      }
      found = t_.test_cells(work_, found, count, q);
      if (entered == found) work_.conflict.resize(found);
    }
    t_.collect_boundary(work_);
    return true;
  }

  /// Of the cells in conflict and those around them. Nobody's are never written to.
  void clear_marks() {
    for (const Index c : work_.conflict) {
      t_.mark_[slot(c)] = kUntested;
      for (const Index face : t_.cell(c).neighbor) {
        if (t_.mark_[slot(face >> 2)] != kUntested) t_.mark_[slot(face >> 2)] = kUntested;
      }
    }
  }

  bool provide_cells(std::size_t count) {
    while (work_.free_cells.size() + static_cast<std::size_t>(work_.end_cell - work_.next_cell) < count) {
      for (; work_.next_cell < work_.end_cell; ++work_.next_cell) work_.free_cells.push_back(work_.next_cell);
      const Index chunk = pass_.next_chunk.fetch_add(kCellChunk);
      if (chunk > pass_.capacity - kCellChunk) {
        pass_.next_chunk.fetch_sub(kCellChunk);
        return false;
      }
      work_.next_cell = chunk;
      work_.end_cell = chunk + kCellChunk;
      t_.clear_cells(chunk, chunk + kCellChunk);
    }
    return true;
  }

  RegularTriangulation& t_;
  ParallelPass& pass_;
  std::uint32_t low_ = 0, span_ = 0;
  Index hint_ = kNone;
  Workspace work_;
};

/// Inserts the vertices begin … end − 1, one round along the curve. Returns begin if that is not worth several threads, else
/// end, with the vertices left over in `rest`. Vertices and ranks are the same here.
Index RegularTriangulation::insert_in_parallel(Index begin, Index end, const std::vector<std::uint32_t>& curve,
                                               const Execution& execution, std::vector<Index>& rest) {
  constexpr Index kLeastPerThread = 4000;  // below, too much of a region is border
  constexpr double kFirstPass = 0.9;       // of the time
  const Index count = end - begin;
  const Index workers_wanted = std::min(static_cast<Index>(std::min(execution.workers(), 256u)), count / kLeastPerThread);
  if (workers_wanted < 2) return begin;
  const auto num_workers = static_cast<std::size_t>(workers_wanted);

  const Index cells_before = cell_capacity();
  const std::size_t room = cells_.size() + slot(count) * 8 + (num_workers + 1) * 2 * slot(kCellChunk);
  cells_.resize(room);
  mark_.resize(room, kUntested);
  ParallelPass pass{curve, {cells_before}, static_cast<Index>(room)};
  std::vector<ParallelWorker> workers(num_workers, ParallelWorker(*this, pass));
  rest.resize(slot(count));
  for (Index k = 0; k < count; ++k) rest[slot(k)] = begin + k;

  for (std::size_t shift = 0; shift < 2; ++shift) {
    // Worker k owns the curve from its start to the next worker's; in the second pass the starts lie half an interval further,
    // and the last interval runs around the end of the curve.
    std::vector<std::uint32_t> starts(num_workers);
    for (std::size_t k = 0; k < num_workers; ++k) {
      const std::size_t position = slot(count) * (2 * k + shift) / (2 * num_workers);
      starts[k] = k + shift == 0 ? 0 : curve[slot(begin) + position];
    }
    std::vector<std::vector<Index>> share(num_workers), given_up(num_workers);
    for (std::size_t k = 0; k < num_workers; ++k) {
      const std::uint32_t next = starts[(k + 1) % num_workers];
      workers[k].own(starts[k], k + 1 == num_workers && shift == 0 ? ~starts[k] : next - starts[k] - 1);
    }
    std::vector<Index> unshared;
    for (const Index v : rest) {
      std::size_t k = 0;
      while (k < num_workers && !workers[k].owns(v)) ++k;
      (k < num_workers ? share[k] : unshared).push_back(v);
    }
    if (work_.end_cell - work_.next_cell < kCellChunk / 2) {
      for (; work_.next_cell < work_.end_cell; ++work_.next_cell) work_.free_cells.push_back(work_.next_cell);
      work_.next_cell = pass.next_chunk.fetch_add(kCellChunk);
      work_.end_cell = work_.next_cell + kCellChunk;
      clear_cells(work_.next_cell, work_.end_cell);
    }
    std::vector<Index> start_cells(num_workers, kNone);
    for (std::size_t k = 0; k < num_workers; ++k) {
      // One vertex of each worker goes in before the threads start, so that their walks start among their own.
      while (!share[k].empty() && start_cells[k] == kNone) {
        const Index v = share[k].front();
        share[k].erase(share[k].begin());
        last_cell_ = insert_vertex(v, last_cell_);
        if (state(v) == VertexState::kVisible) start_cells[k] = last_cell_;
      }
    }
    const Execution pass_execution = execution.part(shift == 0 ? 0 : kFirstPass, shift == 0 ? kFirstPass : 1);
    detail::WorkCounter done(pass_execution, rest.size());
    parallel_for(num_workers, 1, pass_execution, [&](std::size_t k, std::size_t) {
      if (share[k].empty()) return;
      if (workers[k].start_at(start_cells[k])) {
        workers[k].run(share[k], given_up[k], done);
      } else {
        given_up[k] = share[k];
      }
    });
    rest = std::move(unshared);
    for (std::size_t k = 0; k < num_workers; ++k) {
      rest.insert(rest.end(), given_up[k].begin(), given_up[k].end());
      if (workers[k].hint() != kNone && cell(workers[k].hint()).alive()) last_cell_ = workers[k].hint();
    }
    std::sort(rest.begin(), rest.end());
  }

  for (std::size_t k = 0; k <= num_workers; ++k) {
    Workspace& work = k < num_workers ? workers[k].work() : work_;
    for (; work.next_cell < work.end_cell; ++work.next_cell) work_.free_cells.push_back(work.next_cell);
    if (k < num_workers) work_.free_cells.insert(work_.free_cells.end(), work.free_cells.begin(), work.free_cells.end());
  }
  if (cells_.size() == room) {
    cells_.resize(slot(pass.next_chunk));
    mark_.resize(cells_.size());
  } else {  // a cavity larger than a chunk has added cells behind the room
    clear_cells(pass.next_chunk, static_cast<Index>(room));
    for (Index c = pass.next_chunk; c < static_cast<Index>(room); ++c) work_.free_cells.push_back(c);
  }
  return end;
}

}  // namespace amps
