// triangulation.h: the regular triangulation of weighted points in space (weighted Delaunay triangulation), exact.
//
// What is computed. The power of x to a weighted point (p, w) is |x − p|² − w. Four points form a cell iff their orthogonal
// sphere has no other point at negative power to it; with equal weights this is the Delaunay triangulation. Points below
// the lower hull of the lifted points (p, |p|² − w) are hidden: they are no vertex and have no power cell.
//
// Uniqueness. Ties are broken by the symbolic perturbation of weights stated in predicates.h, so the cells are a function of
// the weighted points alone, not of their order, and no cell is ever flat. Of points with equal positions the greatest weight
// wins and hides the others; with equal weights too the one with the lowest id stays and the others are duplicates.
//
//   amps::RegularTriangulation t(positions, weights);          // #P by 3, #P; a third argument: Execution
//   for (amps::Index c = 0; c < t.cell_capacity(); ++c) {
//     if (!t.cell(c).alive() || t.cell(c).ghost()) continue;   // a ghost stands on a facet of the hull
//     visit(t.cell(c).vertex);                                 // four rows of `positions`, positively oriented
//   }
//   const amps::Index v = t.insert({0.5, 0.5, 0.5}, 0.01);     // its id
//   t.move(v, {0.6, 0.5, 0.5}, 0.02);
//   t.remove(v);                                               // the cells are again those of `positions`
//
// How. Incremental insertion (Bowyer 1981, Watson 1981) with a ghost vertex at infinity; bulk input is sorted into rounds of
// growing size (BRIO: Amenta, Choi & Rote 2003), each along a Hilbert curve; single points are located by a visibility walk.
// Several threads own a box of space each (after Marot, Pellerin & Remacle 2019; triangulation_parallel.cpp). A removed vertex
// leaves a hole that the triangulation of its link fills (Devillers & Teillaud 2011; triangulation_edit.cpp).
//
// Cost. Expected O(n log n) for bulk input; single insertion with a good hint, removal, and a move cost O(1) expected on
// evenly spread points, O(d log d) for a vertex of degree d in general; O(n²) cells in the worst case, as the size of the
// result. Memory: 33 bytes a cell (6.7 cells a point in a volume, 2.5 on a sphere, 17 for random points on a torus) and 41
// bytes a point, 4 more for each once points hide; 300 bytes a point in a volume at its peak.
//
// Limits. 2^29 cells. Any finite doubles, but beyond 1e±25 the filters of predicates decide little, and all takes up to a
// thousand times as long: scale such sets by a power of two, as amps does with meshes (sampling.h). Degenerate sets (all points
// on one plane, line or point) have no cells; dimension() says so, and insertion goes on from there.
//
// Const members that take an Execution throw Error(kCancelled) when cancelled.
//
// Thread-safety: const members may be called concurrently; everything else needs exclusive access.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/buffers.h"
#include "amps/execution.h"
#include "amps/predicates.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

namespace amps {

namespace detail {

struct InsertionOrder;

/// Corners of the face opposite to slot k of a positively oriented cell, counter-clockwise seen from outside the cell.
inline constexpr int kFaceCorners[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

}  // namespace detail

namespace detail {

struct TriangulationTestAccess;  // defined by the tests, to corrupt a triangulation and see check() notice
}  // namespace detail

class RegularTriangulation {
 public:
  /// The vertex at infinity, fourth corner of every ghost cell.
  static constexpr Index kInfinite = -2;

  enum class VertexState : std::uint8_t {
    kVisible,    ///< a vertex of the triangulation (or waiting for one while dimension() < 3)
    kHidden,     ///< dominated by others: no power cell
    kDuplicate,  ///< equal in position and weight to a point with a lower id
    kRemoved,    ///< taken out; the id stays unused until reinsert()
  };

  /// Four corners, positively oriented (orient3d > 0), and the neighbour opposite to each: 4·cell + the face of that cell that
  /// is shared. The corner kInfinite, if any, is the last one; the other three then form a hull facet, counter-clockwise seen
  /// from outside.
  struct Cell {
    std::array<Index, 4> vertex{kNone, kNone, kNone, kNone};
    std::array<Index, 4> neighbor{kNone, kNone, kNone, kNone};
    bool ghost() const { return vertex[3] == kInfinite; }
    bool alive() const { return vertex[0] != kNone; }
  };

  RegularTriangulation() = default;

  /// Bulk construction: insert(positions, weights).
  AMPS_EXPORT explicit RegularTriangulation(const PointsView& positions);
  AMPS_EXPORT RegularTriangulation(const PointsView& positions, const ValuesView& weights, const Execution& execution = {});

  /// Inserts a list of points: ids are num_vertices()… in row order. No weights: all 0.
  /// Throws Error(kInvalidArgument): a coordinate or weight not finite (names the row), sizes differ, more than 2^29 cells.
  /// Nothing has changed then.
  AMPS_EXPORT void insert(const PointsView& positions);
  /// With more than one thread large sets go in in parallel, with the same cells; small ones stay sequential. Cancelled, it
  /// throws Error(kCancelled), and the triangulation is empty then: what it held before is gone too.
  AMPS_EXPORT void insert(const PointsView& positions, const ValuesView& weights, const Execution& execution = {});

  /// Makes room for so many points in all, so that those inserted one by one move no memory.
  AMPS_EXPORT void reserve(std::size_t num_points);
  /// Until `count` more are inserted, point() may be called while they are, of what was there before.
  AMPS_EXPORT void keep_in_place(std::size_t count);

  /// Inserts one point and returns its id. `hint`: a cell near it (kNone: the last one touched).
  AMPS_EXPORT Index insert(const Vec3& position, double weight, Index hint = kNone);

  /// Takes a point out, in any order down to none; what it had hidden comes back. Ids of other points stay valid, and no id is
  /// given out again except by reinsert(). Throws Error(kInvalidArgument) if there is no such point. O(d log d) for a vertex of
  /// degree d; d is 15 on average in a volume.
  AMPS_EXPORT void remove(Index v);
  /// Puts a removed id back to use. Errors as insert(), and kInvalidArgument if v is not a removed id.
  AMPS_EXPORT void reinsert(Index v, const Vec3& position, double weight, Index hint = kNone);
  /// Removes v and reinserts it elsewhere or with another weight; nothing happens if nothing differs.
  AMPS_EXPORT void move(Index v, const Vec3& position, double weight);

  /// Points that the last insert() of one point, reinsert() or move() hid: the new one itself, or vertices it dominates. After
  /// remove(): meaningless. Ascending, but for the new one.
  const std::vector<Index>& hidden_by_last_insertion() const { return hidden_by_last_; }

  /// Neighbours of the vertex that the last insert() of one point made, kInfinite included, in no particular order; of
  /// reinsert() likewise if no point is hidden. Meaningless if it was hidden or dimension() < 3.
  const std::vector<Index>& neighbors_of_last_insertion() const { return cavity_vertices_; }

  /// −1 empty, 0 all at one position, 1 on a line, 2 in a plane, 3 proper: only then are there cells.
  int dimension() const { return dimension_; }

  Index num_vertices() const { return static_cast<Index>(points_.size()); }  ///< ids given out, hidden and removed included
  Index num_hidden() const { return num_hidden_; }                           ///< hidden and duplicate
  Index num_removed() const { return num_removed_; }
  const WeightedPoint& point(Index v) const { return points_[static_cast<std::size_t>(v)]; }
  VertexState state(Index v) const { return state_[static_cast<std::size_t>(v)]; }

  /// Cells live in a flat array with holes: visit c in [0, cell_capacity()) with cell(c).alive().
  Index cell_capacity() const { return static_cast<Index>(cells_.size()); }
  const Cell& cell(Index c) const { return cells_[static_cast<std::size_t>(c)]; }
  Index num_cells() const { return num_finite_; }   ///< finite ones
  Index num_ghosts() const { return num_ghosts_; }  ///< = hull facets

  /// #C by 4 corners of the finite cells, in storage order.
  AMPS_EXPORT Tetrahedra cells(const Execution& execution = {}) const;
  /// #H by 3 hull facets, outward: counter-clockwise seen from outside.
  AMPS_EXPORT Triangles hull(const Execution& execution = {}) const;

  /// Some cell with corner v (kNone for hidden points and while dimension() < 3).
  Index incident_cell(Index v) const {
    return state(v) == VertexState::kVisible ? vertex_cell_[static_cast<std::size_t>(v)] : kNone;
  }

  /// Vertices sharing an edge with v, ascending ids, kInfinite left out. Empty for hidden points. `out` is overwritten and
  /// keeps its capacity. O(degree).
  AMPS_EXPORT void neighbors(Index v, std::vector<Index>& out) const;
  /// Cells with corner v, ghosts included, in no particular order.
  AMPS_EXPORT void incident_cells(Index v, std::vector<Index>& out) const;
  /// All vertices' neighbours at once: those of v are `adjacent[offset[v]] … adjacent[offset[v + 1] − 1]`, ascending.
  struct Adjacency {
    std::vector<Index> offset;
    std::vector<Index> adjacent;
  };
  AMPS_EXPORT Adjacency adjacency(const Execution& execution = {}) const;

  /// The cell that contains x, boundary included; a ghost cell whose hull facet sees x if x is outside the hull. `hint`: a cell
  /// to start from. Requires dimension() == 3 (else kNone). Throws Error(kInvalidArgument) if x is not finite.
  AMPS_EXPORT Index locate(const Vec3& x, Index hint = kNone) const;

  /// The visible vertex with the smallest power at x; ties go to the lexicographically smallest, as everywhere. A walk over
  /// power cells from `near` (a vertex; kNone: any). kNone if there is no point. O(distance walked); O(n) if dimension() < 3.
  /// Throws Error(kInvalidArgument) if x is not finite.
  AMPS_EXPORT Index power_nearest(const Vec3& x, Index near = kNone) const;

  /// Re-proves every invariant and returns the first violation found, "" if none.
  ///   1: adjacency is symmetric, corners agree, all finite cells positively oriented
  ///   2: and every facet locally regular, hull facets included: then so is the whole triangulation (Edelsbrunner & Shah 1996)
  ///   3: and hidden points are hidden
  /// Linear in the number of cells and points.
  AMPS_EXPORT std::string check(int level = 3, const Execution& execution = {}) const;

 private:
  friend struct detail::TriangulationTestAccess;

  /// A facet between a cell in conflict and one that is not, as 4·cell + face from either side.
  struct BoundaryFacet {
    Index inside;
    Index outside;
  };
  /// An edge of the cavity's boundary that has met one of its two new cells.
  struct OpenEdge {
    std::uint64_t edge;  ///< its vertices
    Index face;          ///< 4·cell + face of the new cell
  };
  template <class T>
  using Scratch = std::vector<T, detail::UninitializedAllocator<T>>;
  /// Scratch of one insertion, kept for its capacity; one per thread.
  struct Workspace {
    Scratch<Index> conflict;           ///< the cavity
    Scratch<BoundaryFacet> boundary;   ///< and what is around it
    Scratch<Index> untested;           ///< of the cells around the part of it that is known so far
    std::vector<Index> free_cells;     ///< dead cells to use again
    std::vector<std::uint32_t> local;  ///< by vertex + 2: stamp of the last use, and the vertex's number in it
    std::uint32_t stamp = 0;
    std::vector<OpenEdge> open_edges;
    Index next_cell = 0, end_cell = 0;  ///< unused cells set aside for this thread
  };
  struct ParallelPass;
  class ParallelWorker;
  enum CellMark : std::uint8_t { kUntested, kInConflict, kOutside };
  static constexpr std::size_t kSmallStar = 64;     ///< vertices around a cavity that a table of all pairs is made for
  static constexpr std::uint32_t kStampStep = 256;  ///< local_: 24 bits of stamp, 8 bits of number

  void insert_all(const PointsView& positions, const ValuesView* weights, const Execution& execution);
  void append_points(const PointsView& positions, const ValuesView* weights, const Execution* execution = nullptr);
  void grow_bounds(const WeightedPoint& p);
  void start_simplex(const std::array<Index, 4>& corner);
  bool extend_basis(Index v);
  void build(detail::InsertionOrder& order, Index count, const Execution& execution);
  void move_into_order(const std::vector<Index>& id_of_rank, Index first, Index count, const Execution& execution);
  void settle_duplicate(Index rank, Index first, std::vector<Index>& id_of_rank);
  void bulk_insert(Index first, const Execution& execution);
  void finish_bulk(Index first, const std::vector<Index>& id_of_rank, const Execution& execution);
  Index insert_vertex(Index v, Index hint);

  /// Is q in conflict with the cell?
  bool in_conflict(Index c, const WeightedPoint& q) const {
    const Cell& here = cell(c);
    if (!here.ghost()) {  // the first stage of the power test, without a branch that depends on its sign
      const WeightedPoint* p[4];
      for (std::size_t k = 0; k < 4; ++k) p[k] = &points_[static_cast<std::size_t>(here.vertex[k])];
      const double value = detail::power_value(p, q);
      if (std::fabs(value) > bounds_.power) return value > 0;
    }
    return decide_conflict(c, q);
  }
  bool decide_conflict(Index c, const WeightedPoint& q) const;
  Index walk(const WeightedPoint& q, Index start, const detail::StaticBounds& bounds) const;
  void look() const;
  void dig_cavity(Index start, const WeightedPoint& q);
  void start_cavity(Workspace& work, Index start);
  static void make_room(Workspace& work, std::size_t entered, std::size_t found);
  std::size_t test_cells(Workspace& work, std::size_t found, std::size_t count, const WeightedPoint& q);
  void collect_boundary(Workspace& work) const;
  void collect_cavity_vertices();
  Index fill_cavity(Workspace& work, Index v);
  void glue_small_star(Workspace& work);
  void glue_large_star(Workspace& work);
  std::uint32_t next_stamp(Workspace& work) const;
  Index allocate_cell(Workspace& work);

  // Parallel bulk insertion (triangulation_parallel.cpp).
  void clear_cells(Index begin, Index end) { std::fill(cells_.begin() + begin, cells_.begin() + end, Cell{}); }
  bool insert_in_parallel(std::vector<Index>& left, Index end, const Execution& execution);
  std::vector<Vec3> some_positions(const std::vector<Index>& vertices) const;
  void choose_owners(ParallelPass& pass, std::size_t num_workers, Index end, const std::vector<Index>& left,
                     const Execution& execution) const;
  void run_pass(ParallelPass& pass, std::vector<ParallelWorker>& workers, std::vector<Index>& left, const Execution& execution);

  // Removal (triangulation_edit.cpp).
  /// A facet of the hole's border, as the cell that it is to get: one corner, in `slot`, is kNone. Corners are numbers in the
  /// link.
  struct HoleFacet {
    std::array<Index, 4> vertex;
    std::array<Index, 3> key;  ///< the corners, ascending
    int slot;
    Index outside;  ///< 4·cell + face on the far side
    void set_key();
  };
  void require_present(Index v) const;
  static void require_finite_point(const Vec3& position, double weight);
  void forget(Index v);
  void rebuild_basis();
  void flatten();
  void place(Index v, Index hint);
  void collect_star(Index v);
  void open_hole(Index v);
  Index add_hole_cell(const std::array<Index, 4>& corner);
  void glue(Index face, Index other);
  void wrap_hole();
  Index apex_of(const HoleFacet& facet) const;
  void meet_face(const std::array<Index, 4>& corner, Index c, int k);
  bool fill_hole_from_link(Index v);
  void detach_hidden(Index v);

  template <class Visit>
  void visit_edges(std::size_t begin, std::size_t end, const Visit& visit) const;
  std::string find_violation(int level, const Execution& execution) const;
  void hide(Index v, VertexState state);
  void attach_hidden(Index v, Index c);
  void release_hidden(Index c);
  void place_hidden(Index hint, const Execution* execution = nullptr);

  bool is_vertex(Index v) const {
    return state(v) == VertexState::kVisible && vertex_cell_[static_cast<std::size_t>(v)] != kNone;
  }

  std::vector<WeightedPoint> points_;
  std::vector<VertexState> state_;
  std::vector<Index> vertex_cell_;  ///< visible: an incident cell; hidden: the cell whose interior or boundary contains it
  Scratch<Cell> cells_;             ///< a dead cell has vertex[0] == kNone
  int dimension_ = -1;
  std::array<Index, 3> basis_{kNone, kNone, kNone};  ///< affinely independent points, dimension_ + 1 of them while < 3
  Index num_hidden_ = 0;
  Index num_removed_ = 0;
  Index num_finite_ = 0;
  Index num_ghosts_ = 0;
  Index last_cell_ = kNone;  ///< where the next walk without a hint starts
  bool weights_vary_ = false;

  Vec3 box_min_ = Vec3::Constant(detail::kInfinity);
  Vec3 box_max_ = Vec3::Constant(-detail::kInfinity);
  double weight_min_ = detail::kInfinity, weight_max_ = -detail::kInfinity;
  detail::ExactScale scale_;  ///< the lattice all points lie on
  detail::StaticBounds bounds_;

  // Hidden points of a cell form a singly linked list. Both arrays stay empty until a point hides.
  std::vector<Index> hidden_head_;  ///< by cell
  std::vector<Index> hidden_next_;  ///< by vertex
  /// Of a bulk insertion while it lasts, else null. Hidden points are attached once, at its end.
  const Execution* bulk_ = nullptr;

  std::vector<std::uint8_t> mark_;  ///< by cell: scratch of an insertion
  std::vector<Index> hidden_by_last_;
  std::vector<Index> unplaced_;   ///< hidden points without a cell
  std::vector<Index> uncovered_;  ///< hidden points of a hole
  std::vector<HoleFacet> open_facets_, open_ghost_facets_;
  std::vector<Index> cavity_vertices_;
  std::vector<std::size_t> cavity_facet_of_;  ///< one facet of each, in the boundary
  std::vector<WeightedPoint> link_;
  Workspace work_;
};

}  // namespace amps

#include "amps/host_macros_end.h"
