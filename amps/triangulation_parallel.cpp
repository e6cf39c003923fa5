// Parallel bulk insertion into a RegularTriangulation, without locks.
//
// The idea of HXT (Marot, Pellerin & Remacle, "One machine, one minute, three billion tetrahedra", 2019): every thread owns a
// part of space, hence the vertices in it, and gives an insertion up when its cavity would leave them; those points are tried
// again with other parts, and what is left then goes in sequentially. The triangulation being unique, its cells are the
// sequential ones. Where we differ: parts are not intervals of a space-filling curve but boxes, cut across other axes in each
// pass. Of points on a surface cells reach through all of the inside. A plane meets few of them, and only those that meet all
// planes are left: of two threads a hundredth of the points, where the curve, whose cuts share faces, leaves a quarter. Sixteen
// boxes have so many planes that most cells meet some; so where much is left, the next pass has half as many.
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
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

namespace amps {

using detail::slot;

namespace detail {
namespace {

/// Cells set aside for a thread at a time.
constexpr Index kCellChunk = 4096;

/// Of passes with two workers: one for each axis to be cut first. What is left then meets planes across all of them.
constexpr int kPassesOfTwo = 3;

/// Numbers of workers are bytes.
constexpr unsigned kMaxWorkers = 256;

/// Space in one box for each worker: cut across one axis after another, so that workers have about equal shares of `points`.
class WorkerBoxes {
 public:
  WorkerBoxes(std::size_t num_workers, const std::array<int, 3>& axes, std::vector<Vec3> points)
      : axes_(axes), cuts_(num_workers, 0) {
    cut(0, num_workers, 0, points.data(), points.data() + points.size());
  }

  std::uint8_t worker_at(const Vec3& x) const {
    std::size_t first = 0, last = cuts_.size();
    for (std::size_t depth = 0; last - first > 1; ++depth) {
      const std::size_t middle = (first + last) / 2;
      (x[axis(depth)] < cuts_[middle] ? last : first) = middle;
    }
    return static_cast<std::uint8_t>(first);
  }

 private:
  int axis(std::size_t depth) const { return axes_[depth % 3]; }

  /// Among the workers first … last − 1.
  void cut(std::size_t first, std::size_t last, std::size_t depth, Vec3* begin, Vec3* end) {
    if (last - first < 2 || begin == end) return;
    const std::size_t middle = (first + last) / 2;
    Vec3* const at = begin + static_cast<std::size_t>(end - begin) * (middle - first) / (last - first);
    const int a = axis(depth);
    std::nth_element(begin, at, end, [a](const Vec3& x, const Vec3& y) { return x[a] < y[a]; });
    cuts_[middle] = (*at)[a];
    cut(first, middle, depth + 1, begin, at);
    cut(middle, last, depth + 1, at, end);
  }

  std::array<int, 3> axes_;
  std::vector<double> cuts_;  ///< by worker: between those before it and those from it on, where they are cut apart
};

/// The axes by how far the points reach along them, the longest first: a cut across it meets the least.
std::array<int, 3> axes_by_extent(const std::vector<Vec3>& points) {
  Vec3 low = Vec3::Constant(INFINITY), high = -low;
  for (const Vec3& x : points) {
    low = low.cwiseMin(x);
    high = high.cwiseMax(x);
  }
  const Vec3 extent = high / 2 - low / 2;  // halves, because the extent itself may overflow
  std::array<int, 3> axes{0, 1, 2};
  std::stable_sort(axes.begin(), axes.end(), [&](int a, int b) { return extent[a] > extent[b]; });
  return axes;
}

}  // namespace
}  // namespace detail

using detail::kCellChunk;

/// What the threads of a pass share.
struct RegularTriangulation::ParallelPass {
  std::array<int, 3> axes;          ///< in the order in which space is cut across them
  std::vector<std::uint8_t> owner;  ///< by vertex: its worker
  std::atomic<Index> next_chunk;    ///< first cell not set aside yet
  Index capacity;
};

class RegularTriangulation::ParallelWorker {
 public:
  ParallelWorker(RegularTriangulation& triangulation, ParallelPass& pass, std::size_t self)
      : t_(triangulation), pass_(pass), self_(static_cast<std::uint8_t>(self)) {}

  bool owns(Index v) const { return v == kInfinite || pass_.owner[slot(v)] == self_; }

  /// Can walks start here? It takes a living cell with a corner of its own.
  bool start_at(Index c) {
    if (c == kNone || !t_.cell(c).alive()) return false;
    hint_ = c;
    near_ = kNone;
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
    Index start = near_ != kNone ? walk(near_, q) : kNone;
    if (start == kNone) start = walk(hint_, q);
    if (start == kNone) return false;
    near_ = start;  // the next is near, even where this one is given up
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
    near_ = kNone;
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
  Index walk(Index from, const WeightedPoint& q) const {
    Index c = from;
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
  std::uint8_t self_;
  Index hint_ = kNone;  ///< walks start here: all its own, mostly
  Index near_ = kNone;  ///< or here, where the last insertion was given up, at the border maybe
  Workspace work_;
};

/// They tell where most are.
std::vector<Vec3> RegularTriangulation::some_positions(const std::vector<Index>& vertices) const {
  constexpr std::size_t kStep = 8;
  std::vector<Vec3> result;
  for (std::size_t k = 0; k < vertices.size(); k += kStep) result.push_back(point(vertices[k]).position());
  return result;
}

/// Divides the vertices before `end` among the workers, by boxes that hold equal shares of those that are left to insert.
void RegularTriangulation::choose_owners(ParallelPass& pass, std::size_t num_workers, Index end, const std::vector<Index>& left,
                                         const Execution& execution) const {
  const detail::WorkerBoxes boxes(num_workers, pass.axes, some_positions(left));
  pass.owner.resize(slot(end));
  constexpr std::size_t kVertexGrain = 1 << 13;
  parallel_for(pass.owner.size(), kVertexGrain, execution, [&](std::size_t from, std::size_t to) {
    for (std::size_t v = from; v < to; ++v) pass.owner[v] = boxes.worker_at(points_[v].position());
  });
}

/// One pass: each worker tries those of `left` that are its own. Keeps there what is given up, ascending.
void RegularTriangulation::run_pass(ParallelPass& pass, std::vector<ParallelWorker>& workers, std::vector<Index>& left,
                                    const Execution& execution) {
  const std::size_t num_workers = workers.size();
  std::vector<std::vector<Index>> share(num_workers), given_up(num_workers);
  for (const Index v : left) share[pass.owner[slot(v)]].push_back(v);
  if (work_.end_cell - work_.next_cell < kCellChunk / 2 && pass.next_chunk <= pass.capacity - kCellChunk) {
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
  detail::WorkCounter done(execution, left.size());
  parallel_for(num_workers, 1, execution, [&](std::size_t k, std::size_t) {
    if (share[k].empty()) return;
    if (workers[k].start_at(start_cells[k])) {
      workers[k].run(share[k], given_up[k], done);
    } else {
      given_up[k] = share[k];
    }
  });
  left.clear();
  for (std::size_t k = 0; k < num_workers; ++k) {
    left.insert(left.end(), given_up[k].begin(), given_up[k].end());
    if (workers[k].hint() != kNone && cell(workers[k].hint()).alive()) last_cell_ = workers[k].hint();
  }
  std::sort(left.begin(), left.end());
}

/// Inserts some of the vertices before `end`, in ascending order, into a triangulation that has cells all over. Those that are
/// left over stay in `left`. False if that is not worth several threads. Vertices and ranks are the same here.
bool RegularTriangulation::insert_in_parallel(std::vector<Index>& left, Index end, const Execution& execution) {
  constexpr std::size_t kLeastPerThread = 2000;  // below, too much of a region is border
  constexpr std::size_t kLeastPerPass = 1000;    // below, threads cost more than they bring
  constexpr std::size_t kMuchLeft = 4;           // of so many one
  constexpr double kShareOfPass = 0.7;           // of the time of all that are to come, roughly
  constexpr std::size_t kCellsPerPoint = 8;      // a little more than there will be
  const std::size_t num_workers =
      std::min<std::size_t>(std::min(execution.workers(), detail::kMaxWorkers), left.size() / kLeastPerThread);
  if (num_workers < 2) return false;

  const Index cells_before = cell_capacity();
  const std::size_t room = cells_.size() + left.size() * kCellsPerPoint + (num_workers + 1) * 2 * slot(kCellChunk);
  cells_.resize(room);
  mark_.resize(room, kUntested);
  ParallelPass pass{detail::axes_by_extent(some_positions(left)), {}, {cells_before}, static_cast<Index>(room)};
  std::vector<ParallelWorker> workers;
  for (std::size_t k = 0; k < num_workers; ++k) workers.emplace_back(*this, pass, k);
  const auto give_back_cells = [this](Workspace& work) {
    for (; work.next_cell < work.end_cell; ++work.next_cell) work.free_cells.push_back(work.next_cell);
    if (&work != &work_) work_.free_cells.insert(work_.free_cells.end(), work.free_cells.begin(), work.free_cells.end());
  };
  double done = 0;
  for (int passes_of_two = 0; passes_of_two < detail::kPassesOfTwo;) {
    choose_owners(pass, workers.size(), end, left, execution);
    std::rotate(pass.axes.begin(), pass.axes.begin() + 1, pass.axes.end());
    const std::size_t tried = left.size();
    const double until = done + kShareOfPass * (1 - done);
    run_pass(pass, workers, left, execution.part(done, until));
    done = until;
    if (left.size() < kLeastPerPass) break;
    if (workers.size() == 2) {
      ++passes_of_two;
    } else if (left.size() > tried / kMuchLeft) {
      for (const std::size_t half = workers.size() / 2; workers.size() > std::max<std::size_t>(half, 2);) {
        give_back_cells(workers.back().work());
        workers.pop_back();
      }
    }
  }
  for (ParallelWorker& worker : workers) give_back_cells(worker.work());
  give_back_cells(work_);

  if (cells_.size() == room) {
    cells_.resize(slot(pass.next_chunk));
    mark_.resize(cells_.size());
  } else {  // a cavity larger than a chunk has added cells behind the room
    clear_cells(pass.next_chunk, static_cast<Index>(room));
    for (Index c = pass.next_chunk; c < static_cast<Index>(room); ++c) work_.free_cells.push_back(c);
  }
  return true;
}

}  // namespace amps
