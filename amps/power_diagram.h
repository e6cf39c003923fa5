// power_diagram.h: the restricted power diagram (RPD) of weighted sites on a triangle mesh — for each facet, which part of it
// is nearest in power to which site — exact, and updated locally when a site is inserted or removed.
//
// The intersection of a facet with a site's power cell is a convex polygon, a *fragment*. Fragments are found facet by facet,
// by clipping the facet with the bisectors of an owner and its neighbours in the regular triangulation and flooding to the
// owners on the other side (Yan, Lévy, Liu, Sun & Wang, "Isotropic remeshing with fast and exact computation of restricted
// Voronoi diagram", 2009). Facets need no adjacency: soups, open, non-manifold and inconsistently oriented meshes are fine.
//
// Exactness. A polygon is a cycle of edge labels (a mesh edge or the site beyond a bisector); its vertices are symbolic, and
// every side they take of a bisector is decided exactly (predicates.h). So the fragments of a facet tile it without crack or
// overlap, a site j labels an edge of a fragment of i iff i labels the same edge of a fragment of j, and three fragments meet
// at every vertex inside a facet. Coordinates are derived for output and measures only; all fragments at a vertex have the same
// bits. Meshes beyond 1e±15 take long, as they do in the triangulation, and squares of 1e±150 are no doubles: scale them, as
// what is built on this does.
//
// Over disks that know their surface (DESIGN: reach) each facet is divided among the sites that reach it alone. Where all
// owners in the diagram of all sites do, that diagram is right as it is: all but thin sheets, tight folds and sharp creases.
// There, a facet is *local*: its fragments are clipped by the sites that reach it. A facet that none of them reaches is one
// fragment without an owner.
//
// Const members that take an Execution throw Error(kCancelled) when cancelled.
//
// Thread-safety: const members may be called concurrently.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/polygon_pages.h"
#include "amps/reach.h"
#include "amps/site_tree.h"
#include "amps/triangulation.h"

#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace amps {

class RestrictedPowerDiagram {
 public:
  /// Label of a polygon edge: a site (≥ 0), or a mesh edge e of the facet, from its corner e to corner e + 1 (mod 3).
  static constexpr Index mesh_edge_label(int e) { return -1 - e; }
  static constexpr bool is_site(Index label) { return label >= 0; }
  static constexpr int mesh_edge(Index label) { return -1 - label; }

  /// Positions of a fragment's corners: corners[k], counted from 0. Computed from what is kept, 3 to 10 ns each.
  class Corners {
   public:
    Corners() = default;
    Corners(const MeshView& mesh, Index facet, const detail::PackedBarycentric* places)
        : mesh_(&mesh), facet_(facet), places_(places) {}
    AMPS_EXPORT Vec3 operator[](std::ptrdiff_t k) const;
    const MeshView& mesh() const { return *mesh_; }
    const detail::PackedBarycentric* places() const { return places_; }

   private:
    const MeshView* mesh_ = nullptr;
    Index facet_ = kNone;
    const detail::PackedBarycentric* places_ = nullptr;
  };

  /// A fragment. Corner k lies between edges k − 1 and k; edge k runs from corner k to corner k + 1; counter-clockwise in the
  /// facet's own orientation. The view is valid until the next edit, and as long as the diagram is not moved.
  struct Polygon {
    Index facet = kNone;
    Index site = kNone;  ///< kNone: no site reaches the facet
    Corners corners;
    const Index* labels = nullptr;
    Index size = 0;
    /// Area, absolute units.
    AMPS_EXPORT double area() const;
    /// All corners at once, in place of what `positions` had.
    AMPS_EXPORT void list_corners(std::vector<Vec3>& positions) const;
  };

  /// The diagram of the given sites (#S by 3, #S weights; ids are rows). Views are not copied: the mesh's buffers must outlive
  /// the diagram. Facets with exactly collinear corners have no fragments, nor have those whose three corners an earlier facet
  /// has, at the same positions and in any order: they are that facet again, and would double all that is dual to it. Throws
  /// Error: kInvalidMesh (require_usable), kInvalidArgument (a site not finite, no site at all). Expected O(n log n +
  /// #fragments); facets are split over the threads of `execution`, with the same result for any number.
  AMPS_EXPORT RestrictedPowerDiagram(const MeshView& mesh, const PointsView& sites, const ValuesView& weights,
                                     const Execution& execution = {});

  /// The same over disks that know their surface: `reach` (null: as above) lists the facets that each site reaches, before it
  /// enters by any member below, and until it is removed. Its ball (closed) meets each of them. `reach` must outlive the
  /// diagram.
  RestrictedPowerDiagram(const MeshView& mesh, const PointsView& sites, const ValuesView& weights,
                         const detail::ReachLists* reach, const Execution& execution);

  /// kCancelled if the constructor was. The diagram then has no sites and no fragments, and is good for nothing but to be
  /// assigned to: insert() throws Error(kCancelled), the other edits find no site.
  Outcome status() const { return status_; }

  Index num_sites() const { return static_cast<Index>(first_of_site_.size()); }  ///< ids given out, removed ones included
  Index num_removed() const { return triangulation_.num_removed(); }
  const WeightedPoint& site(Index s) const { return triangulation_.point(s + kSentinels); }
  bool removed(Index s) const { return triangulation_.state(s + kSentinels) == RegularTriangulation::VertexState::kRemoved; }
  /// False if others dominate the site everywhere in space (its power cell is empty), it is a duplicate, or removed.
  /// Space ends where four far sentinel sites begin (neighbors()): a cell beyond them does not count.
  bool visible(Index s) const { return triangulation_.state(s + kSentinels) == RegularTriangulation::VertexState::kVisible; }
  const MeshView& mesh() const { return mesh_; }

  /// Fragments live in slots with holes: visit f in [0, fragment_capacity()) with alive(f).
  Index fragment_capacity() const { return static_cast<Index>(fragments_.size()); }
  Index num_fragments() const { return num_fragments_; }
  bool alive(Index f) const { return fragments_[static_cast<std::size_t>(f)].ball.note() != 0; }
  Polygon polygon(Index f) const {
    const Fragment& fragment = fragments_[static_cast<std::size_t>(f)];
    if (fragment.ball.note() == 0) return {fragment.facet, fragment.site, {}, nullptr, 0};
    const Index first = first_of(fragment);
    return {fragment.facet,
            fragment.site,
            {mesh_, fragment.facet, polygons_.corners(first)},
            polygons_.labels(first),
            size_of(fragment)};
  }

  /// Is the facet divided among the sites that reach it, and not as the diagram of all sites is? Once it is, it stays so.
  bool local(Index facet) const { return !local_.empty() && local_[static_cast<std::size_t>(facet)] != kNone; }
  const detail::ReachLists* reach_lists() const { return reach_lists_; }
  /// Does the disk of s reach a local facet, whether or not s is a site yet? False for balls. O(#facets reached).
  bool reaches_local_facet(Index s) const;

  /// The fragments of a site (of a facet), as a linked list ending with kNone.
  Index first_of_site(Index s) const { return first_of_site_[static_cast<std::size_t>(s)]; }
  Index next_of_site(Index f) const { return fragments_[static_cast<std::size_t>(f)].next_of_site; }
  Index first_of_facet(Index facet) const { return first_of_facet_[static_cast<std::size_t>(facet)]; }
  Index next_of_facet(Index f) const { return fragments_[static_cast<std::size_t>(f)].next_of_facet; }

  /// An upper bound of the distance from a fragment's site to the fragment's corners, without a look at the corners; infinite
  /// without a site. O(1).
  AMPS_EXPORT double reach(Index f) const;

  /// Is the owner's ball (radius² = weight, closed) without corner k of the fragment? +1 yes, 0 the corner lies on the sphere,
  /// −1 no. Exact: the corner is the symbolic one, however its coordinates are rounded. O(1).
  AMPS_EXPORT int power_at_corner(const Polygon& polygon, Index k) const;
  /// Is power_at_corner() > 0, for all corners at once? Their positions are given. True if it is at any.
  bool list_uncovered(const Polygon& polygon, const std::vector<Vec3>& corners, std::vector<char>& uncovered) const;
  /// Does the owner's ball cover the fragment? Exact: both are convex, so it does iff no corner is without. The surface is
  /// covered iff all fragments are, see predicates.h. O(size).
  AMPS_EXPORT bool covered(const Polygon& polygon) const;

  /// Inserts a site and updates the fragments of its neighbours; returns its id, num_sites() before. `near`: a site close to it
  /// (kNone: anywhere). Expected O(1) with a good hint on Poisson-disk-like sets. Throws Error(kInvalidArgument) if not finite.
  AMPS_EXPORT Index insert(const Vec3& position, double weight, Index near = kNone);

  /// Sites that enter together, in order, and a site close to each that is there already (kNone: anywhere).
  class Arrivals;
  /// What a caller wants to know of polygons of the diagram: one number each, whatever the thread.
  using Measure = std::function<void(const std::vector<Polygon>& polygons, std::vector<double>& values)>;

  /// Inserts sites at once, for gap filling; their ids are num_sites(), … in order. The diagram, to the slots of its fragments,
  /// is that of one insert() after the other. On several threads most cells are found side by side; meanwhile, on one of them,
  /// `draw` may look at the diagram as it was before the call, changed() included, and give to `next` what the next call
  /// inserts, at most kMostArrivals: that enters the triangulation beside the cells. Until it has its cells, the diagram is
  /// good for nothing but that next call, for its fragments, and for sites below num_sites(). Requires finite coordinates.
  ///
  /// Afterwards changed() is in the order of changes, each fragment once; changed_sites() is empty; and measured()[k] is what
  /// `measure` says of changed()[k], NaN where nobody has asked by now.
  AMPS_EXPORT void insert_together(Arrivals& now, Arrivals& next, const std::function<void()>& draw, const Measure& measure,
                                   const Execution& execution);
  static constexpr std::size_t kMostArrivals = 1024;
  const std::vector<double>& measured() const { return measured_; }

  /// Removes a site, visible or not: its neighbours, and sites that it has hidden, share its fragments. The diagram is then
  /// that of the other sites alone, bit by bit; what has a fragment in none of the facets that it had one in stays untouched.
  /// Other ids stay valid, and this one is not given out again but by reinsert(). Expected O(1) on Poisson-disk-like sets.
  /// Throws Error(kInvalidArgument) if there is no such site, or no other one: a diagram has at least one site.
  AMPS_EXPORT void remove(Index s);

  /// Puts a removed id back to use, elsewhere and with another weight if you like. `near`, cost and errors as insert(), and
  /// kInvalidArgument if s is not a removed id.
  AMPS_EXPORT void reinsert(Index s, const Vec3& position, double weight, Index near = kNone);

  class PendingEdit;
  class PendingEdits;

  // Edits side by side: several, each of a few sites. One after another they enter the triangulation, by insert_pending(),
  // reinsert_pending() and remove_pending(); then each gives the fragments to their new owners by carry_out(), on as many
  // threads as there are edits; and last one after another again, join() of all and finish() of all. That leaves what the same
  // edits leave one by one, and slots are the same for any number of threads. In between the diagram is good for nothing else.

  /// Before the first of those that go side by side.
  void begin_side_by_side(PendingEdits& edits);
  /// insert(), reinsert() and remove() of an edit; all that enters comes before what is removed. False if the edit cannot be
  /// carried out beside those that have entered before, since cells would change that theirs may change, or since a site is
  /// hidden by it or comes back from hiding. It is to be withdrawn then. None of its sites may reach a local facet.
  bool insert_pending(PendingEdit& edit, const Vec3& position, double weight, Index near);
  bool reinsert_pending(PendingEdit& edit, Index s, const Vec3& position, double weight, Index near);
  bool remove_pending(PendingEdit& edit, Index s);
  /// Does an edit that has entered since begin_side_by_side() change the cell of s, as far as is known?
  bool near_pending(Index s) const;
  /// Takes back all of an edit that has entered and has not been carried out. Ids it has given out are removed ones.
  void withdraw_pending(PendingEdit& edit);
  /// May be called concurrently, each for another edit. Afterwards its thread may read the fragments of sites it has changed.
  void carry_out(PendingEdit& edit);
  void join(PendingEdit& edit);
  /// True if more has changed than when carry_out() returned: facets have become local, or there was no room for all. Then the
  /// others may have changed as well.
  bool finish(PendingEdit& edit);
  /// After the last of all.
  void end_side_by_side(PendingEdits& edits);

  /// Moves the polygons together in memory if more than half of their room is unused. Edits do that themselves, but only once
  /// three quarters are: for a million sites it takes a tenth of a second. Between edits, and with looks for a cancel: then it
  /// throws Error(kCancelled), and nothing has changed. Polygons seen before are void.
  AMPS_EXPORT void compact(const Execution& execution);

  /// Slots of fragments that the last insert(), remove() or reinsert() created, changed or freed (then not alive), ascending,
  /// each once.
  const std::vector<Index>& changed() const { return edit_.changed; }
  /// Sites that owned or own one of these, ascending, each once: of no other site have fragments, or dual triangles, changed.
  const std::vector<Index>& changed_sites() const { return edit_.changed_sites; }

  /// Sites whose power cells share a facet with that of s in space (not only on the mesh), ascending. Four far sentinel sites
  /// take part in space, so sites on the outside may lack neighbours across large distances; never ones that share a fragment's
  /// edge.
  AMPS_EXPORT void neighbors(Index s, std::vector<Index>& out) const;
  /// The same for all sites at once.
  AMPS_EXPORT RegularTriangulation::Adjacency adjacency(const Execution& execution = {}) const;

  /// The same, pair by pair, for loops that need no memory of it: visit(i, j) for the pairs of sites of the cells in [begin,
  /// end) of the triangulation, of cell_capacity(). Over all cells that is each pair of neighbours, in one order or the other,
  /// some five times.
  Index cell_capacity() const { return triangulation_.cell_capacity(); }
  template <class Visit>
  void visit_neighbor_pairs(Index begin, Index end, const Visit& visit) const {
    for (Index c = begin; c < end; ++c) {
      const RegularTriangulation::Cell& cell = triangulation_.cell(c);
      if (!cell.alive() || cell.ghost()) continue;  // a ghost's pairs are those of the cell behind it
      for (std::size_t a = 1; a < cell.vertex.size(); ++a) {
        for (std::size_t b = 0; b < a; ++b) {
          if (cell.vertex[a] < kSentinels || cell.vertex[b] < kSentinels) continue;
          visit(cell.vertex[a] - kSentinels, cell.vertex[b] - kSentinels);
        }
      }
    }
  }

  /// One dual triangle for each vertex where three cells meet inside a facet: (i, j, k) counter-clockwise in the orientation of
  /// that facet, i the smallest. `facets` (optional): the facet of each. A triple appears as often as its cells meet; of the
  /// triangulation are those that do so an odd number of times (remesh.h).
  AMPS_EXPORT Triangles dual_triangles(std::vector<Index>* facets = nullptr, const Execution& execution = {}) const;

  /// Restricted cell area per site, absolute units; they sum to total_area().
  AMPS_EXPORT std::vector<double> cell_areas(const Execution& execution = {}) const;

  /// Wall-clock seconds the constructor spent on the triangulation (the rest went into the fragments).
  double seconds_triangulation() const { return seconds_triangulation_; }

  /// Re-proves the invariants: lists and polygons well formed, labels symmetric, fragments of a facet tile its area (relative
  /// 1e-9), every corner nearest in power to its owner among the owner's neighbours. "" or the first violation. O(#fragments).
  AMPS_EXPORT std::string check(const Execution& execution = {}) const;

 private:
  /// Far sentinel sites come first in the triangulation: they own nothing on the mesh, and make every set three-dimensional.
  static constexpr Index kSentinels = 4;

  struct Fragment {
    Index facet = kNone, site = kNone;
    Index room = 0;  ///< of its corners and labels
    Index next_of_site = kNone;
    Index next_of_facet = kNone, previous_of_facet = kNone;
    /// A ball around the corners, relative to the site: tells most fragments of a site from those an insertion touches, without
    /// a look at the corners. With it a record is 32 bytes, and a site's fragments are read as a stream. Its note is the number
    /// of corners; 0: free slot; kLargeSize: so many or more, their number being the first label of the room.
    detail::PackedBall ball = detail::PackedBall::nothing();
  };

  static constexpr Index kLargeSize = static_cast<Index>(detail::PackedBall::kGreatestNote);
  static constexpr Index room_for(Index size) { return size + (size >= kLargeSize ? 1 : 0); }
  static void fill_room(detail::PolygonPages& polygons, Index room, const detail::PackedBarycentric* corners,
                        const Index* labels, Index size);
  Index size_of(const Fragment& fragment) const {
    const auto size = static_cast<Index>(fragment.ball.note());
    return size < kLargeSize ? size : *polygons_.labels(fragment.room);
  }
  static Index first_of(const Fragment& fragment) {
    return fragment.room + (fragment.ball.note() == detail::PackedBall::kGreatestNote ? 1 : 0);
  }

  /// A fragment that has come into the list of its facet, or is to leave it.
  struct FacetChange {
    Index fragment;
    bool comes;
  };

  /// What an edit changes. One that is carried out beside others has slots of its own; those that it frees are not used again,
  /// and lists of facets, which it may share with others, stay as they are until it is finished.
  struct EditRecord {
    std::vector<Index> changed, changed_sites;
    bool beside_others = false;
    std::vector<Index> slots, freed;
    std::vector<FacetChange> facet_changes;
    Index fragments_added = 0;
    std::mutex* pages = nullptr;

    void clear() {
      changed.clear();
      changed_sites.clear();
    }
  };

  /// Of dividing the fragments of one cell, each in its own facet.
  struct DivideScratch {
    struct FacetsOfSite {
      Index site;
      std::vector<std::pair<Index, Index>> fragments;  ///< facets, ascending, and the site's fragments in them
    };
    std::vector<Index> owners;
    bool many = false;                ///< so many that those of neighbours are listed by facet
    bool by_site = false;             ///< lists of facets are not to be read
    std::vector<FacetsOfSite> lists;  ///< of neighbours, as they were when each was first asked for
  };

  /// A new site, and what it takes, found before any of it is stored.
  struct NewCell {
    struct Cut {
      Index fragment, site, size;  ///< size: of what is left of it
      detail::PackedBall ball;     ///< around that
    };
    struct Piece {
      Index facet, size;
      detail::PackedBall ball;
    };
    WeightedPoint point{};
    Index near = kNone, site = kNone;
    bool visible = false;       ///< once it was in the triangulation
    std::vector<Index> around;  ///< its neighbours then, and what it has hidden; vertices of the triangulation
    std::vector<Index> hidden;
    std::vector<Cut> cuts;  ///< grouped by site
    std::vector<Piece> pieces;
    std::vector<detail::PackedBarycentric> corners;  ///< of what is left by the cuts, and of the pieces
    std::vector<Index> labels;
    std::vector<double> values;  ///< measured, likewise
  };
  struct CellScratch;

  /// Of a local facet the sites that reach it. A long list is not tidy any more once one goes, or comes back: then some are
  /// gone, or are there twice, until it has `most`.
  struct LocalSites {
    std::vector<Index> sites;  ///< ascending where it is tidy
    std::size_t most = 0;
    bool tidy = true;
  };

  /// A neighbour and a lower bound of where its bisector crosses the ray from the owner towards it, in distance from the owner.
  struct Plane {
    double offset;
    Index site;
  };

  /// The planes of all sites, each site's in increasing order of offset.
  struct PlaneTable {
    struct Range {
      std::size_t first;
      Index count;
    };
    std::vector<Range> of_site;  ///< in `planes`
    std::vector<Plane, detail::UninitializedAllocator<Plane>> planes;
    const Plane* begin(Index s) const { return planes.data() + of_site[static_cast<std::size_t>(s)].first; }
    const Plane* end(Index s) const { return begin(s) + of_site[static_cast<std::size_t>(s)].count; }
  };
  struct CellsOfSites;
  using CornerOwners = std::vector<std::atomic<Index>>;  ///< by vertex of the mesh; kNone: not known yet

  class Clipper;
  class Batch;
  struct FloodScratch;
  struct SiteOrder;

  std::array<WeightedPoint, kSentinels> sentinels() const;
  bool is_guard(Index s) const;
  void keep_a_guard(Index s);
  std::string find_violation(const Execution& execution) const;
  bool lists_all_local_sites() const;
  void clear();
  void triangulate(const PointsView& sites, const ValuesView& weights, const Execution& execution);
  void build(const Execution& execution);
  CellsOfSites cells_of_sites(const Execution& execution) const;
  PlaneTable all_planes(const Execution& execution) const;
  std::array<Index, 3> corner_owners(Index facet, CornerOwners& owner, const PlaneTable& planes, Index& near) const;
  Index owner_from(Index near, const Vec3& position, const PlaneTable& planes) const;
  void prefetch_planes(const PlaneTable& planes, Index s) const;
  void prefetch_sites(const PlaneTable& planes, Index s) const;
  void clip_facets(std::size_t begin, std::size_t end, CornerOwners& owner, const PlaneTable& planes, FloodScratch& scratch,
                   Batch& batch) const;
  void flood_facet(Index facet, Index owner, const PlaneTable& planes, FloodScratch& scratch, Batch& batch) const;
  void assemble(std::vector<Batch>& batches, const Execution& execution);
  SiteOrder number_fragments(std::vector<Batch>& batches, const Execution& execution);
  void make_records(const Batch& batch);
  void update_reach(Index s);
  void measure_reach(Index s, EditRecord& edit);
  void measure_facets(const Execution& execution);
  Plane plane(Index owner, Index other) const;
  int exact_power_at_corner(const Polygon& polygon, Index k) const;
  void link_to_site(Index f);
  void link_in_facet(Index f);
  void unlink_in_facet(Index f);
  Index take_slot(EditRecord& edit);
  void add_fragment(Index facet, Index site, const Clipper& clipper, EditRecord& edit);
  void add_fragment(Index facet, Index site, const detail::PackedBall& ball, const detail::PackedBarycentric* corners,
                    const Index* labels, Index size, EditRecord& edit);
  void store_polygon(Fragment& fragment, const Clipper& clipper, EditRecord& edit);
  void store_polygon(Fragment& fragment, const detail::PackedBall& ball, const detail::PackedBarycentric* corners,
                     const Index* labels, Index size, EditRecord& edit);
  void retire_fragment(Index f, EditRecord& edit);
  void free_fragment(Index f, EditRecord& edit);
  void free_taken_fragment(Index f, EditRecord& edit);
  void give_slot_back(Index f, EditRecord& edit);
  std::vector<Index> take_fragments(Index s, bool in_local_facets);
  void find_touched(Index site, Index by, std::vector<Index>& touched) const;
  template <class Visit>
  void for_each_taken(Index by, CellScratch& scratch, const Visit& visit) const;
  void clip_touched(Index by, CellScratch& scratch, EditRecord& edit);
  template <class Add>
  void divide_taken(Index site, CellScratch& scratch, const Add& add) const;
  void prefetch_polygon(Index f) const;
  void prefetch_facet_corners(Index facet) const;
  std::uint32_t new_stamp();
  std::vector<Index> link_of(Index s);
  Index hint_cell(Index near) const;
  void enter_triangulation(NewCell& cell);
  void add_site(const NewCell& cell);
  std::size_t find_cells(Arrivals& now, Arrivals& next, const std::function<void()>& draw, const Measure& measure,
                         const Execution& execution);
  bool take_cell(const NewCell& cell, CellScratch& scratch, EditRecord& edit);
  void find_touched(const NewCell& cell, CellScratch& scratch) const;
  void find_cell(NewCell& cell, CellScratch& scratch) const;
  void measure_cells(NewCell* begin, NewCell* end, const Measure& measure) const;
  bool is_cell_right(const NewCell& cell, Index first, CellScratch& scratch) const;
  void store_cell(const NewCell& cell);
  void forget_hidden(const NewCell& cell);
  void note_changes(std::size_t from, const std::vector<double>* values);
  void retake_cell(Index s);
  void add_uncovered(std::vector<Index>& candidates);
  bool divide_cell(Index s, const std::vector<Index>& candidates, EditRecord& edit);
  void divide_fragment(Index f, const std::vector<Index>& possible_owners, Clipper& clipper, DivideScratch& scratch,
                       EditRecord& edit);
  void find_possible_owners(Index f, const std::vector<Index>& candidates, std::vector<Index>& possible_owners) const;
  Index owner_of_corner(Index facet, const std::vector<Index>& among) const;
  Index fragment_of(Index facet, Index site) const;
  Index fragment_of(Index facet, Index site, DivideScratch& scratch) const;
  void finish_edit() { finish_edit(edit_); }
  void finish_edit(EditRecord& edit);
  void hold_slots(PendingEdit& edit, std::size_t count);
  bool mark_pending(PendingEdit& edit, Index vertex, bool changes);
  bool enter_pending(PendingEdit& edit, Index s);
  void run_steps(PendingEdit& edit);
  void list_new_neighbors(Index s, std::vector<Index>& around);

  // Local facets (power_diagram_local.cpp).
  void find_local_facets(const Execution& execution);
  bool is_foreign(Index f) const;
  void localize_foreign(Index owner, std::size_t from);
  void make_local(Index facet);
  std::vector<Index> find_sites_near(const std::vector<Index>& facets);
  void add_local_site(Index facet, Index s);
  void remove_local_site(Index facet, Index s);
  template <class Visit>
  void for_each_local_site(Index facet, const Visit& visit) const;
  void keep_local_sites(Index facet, std::vector<Index>& sites) const;
  Index count_local_sites(Index facet) const;
  void localize(const std::vector<Index>& facets);
  void clear_facet(Index facet);
  void divide_locally(Index facet);
  void clip_locally(Index facet, Index owner, Clipper& clipper) const;
  void enter_local_facets(Index s, const std::vector<Index>& hidden, std::size_t from);
  void enter_local_facet(Index facet, Index s, Clipper& clipper);
  std::vector<Index> cut_local_fragments(Index facet, Index s, const std::vector<Index>& from, Clipper& clipper);
  bool enter_large_facet(Index facet, Index s, Clipper& clipper);
  Index local_fragment_near(Index facet, const Vec3& x) const;
  void leave_local_facets(Index s);
  void give_local_facets_away(Index s);
  void find_local_candidates(Index f, std::vector<Index>& candidates) const;
  void list_local_sites(Index facet, std::vector<Index>& sites) const;
  bool takes_part(Index s) const;
  void add_ownerless_fragment(Index facet);
  void make_site_tree();
  void insert_into_site_tree(Index s);
  void compact_polygons(const Execution* execution = nullptr);

  MeshView mesh_;
  const detail::ReachLists* reach_lists_ = nullptr;  ///< null: disks are balls
  std::vector<Index> local_;                         ///< by facet: its number, if it is local; empty: none is
  std::vector<LocalSites> local_sites_;              ///< by number of a local facet
  detail::SiteTree site_tree_;                       ///< of all sites that are not removed, once a facet has needed it
  RegularTriangulation triangulation_;
  std::vector<Fragment, detail::UninitializedAllocator<Fragment>> fragments_;
  std::vector<Index> free_fragments_;
  detail::PolygonPages polygons_;
  std::vector<Index> first_of_site_;
  std::vector<Index> first_of_facet_;
  std::vector<double> facet_error_;  ///< bound of the error of computed corners; −1: no fragments
  double largest_facet_error_ = 0;
  /// By site: not less than the distance to any corner of its fragments; kNoCell: not visible. NaN (overflow) prunes nothing.
  std::vector<double> reach_;
  static constexpr double kNoCell = -1;
  Vec3 low_ = Vec3::Zero(), high_ = Vec3::Zero();  ///< the box that the sentinels stand around
  double min_weight_ = 0;                          ///< theirs
  Index num_guards_ = 0;                           ///< sites in that box and not lighter
  Index num_fragments_ = 0;
  EditRecord edit_;  ///< of the last insert(), remove() or reinsert()
  std::vector<double> measured_;
  std::vector<bool> is_changed_, is_changed_again_;  ///< by fragment: scratch of insert_together()
  std::vector<std::uint32_t> stamp_;                 ///< by vertex of the triangulation: scratch of edits
  std::uint32_t last_stamp_ = 0;
  std::vector<std::uint32_t> mark_;  ///< by vertex of the triangulation: the last edit side by side that was near it
  std::uint32_t first_mark_ = 1;     ///< of the edits under way
  double seconds_triangulation_ = 0;
  Outcome status_ = Outcome::kDone;
};

/// One of several edits that are carried out side by side.
class RestrictedPowerDiagram::PendingEdit {
 public:
  /// As those of the diagram, of the edit as far as it has come.
  const std::vector<Index>& changed() const { return record_.changed; }
  const std::vector<Index>& changed_sites() const { return record_.changed_sites; }

 private:
  friend class RestrictedPowerDiagram;

  struct Step {
    NewCell cell;  ///< of what is removed, too: its place and the neighbours it had
    bool enters = false;
  };
  Step& add_step();

  std::vector<Step> steps_;
  std::size_t num_steps_ = 0, next_step_ = 0;
  std::uint32_t mark_ = 0;
  bool is_late_ = false;  ///< not all of it was carried out beside the others
  bool has_foreign_ = false;
  EditRecord record_;
};

/// So many at most. They keep memory, and slots of the diagram, for those that come next, until end_side_by_side().
class RestrictedPowerDiagram::PendingEdits {
 public:
  explicit PendingEdits(std::size_t count) : edits_(count) {}
  std::size_t size() const { return edits_.size(); }
  PendingEdit& operator[](std::size_t k) { return edits_[k]; }

 private:
  friend class RestrictedPowerDiagram;

  std::vector<PendingEdit> edits_;
  std::mutex pages_;
};

class RestrictedPowerDiagram::Arrivals {
 public:
  void add(const WeightedPoint& site, Index near) {
    if (count_ == cells_.size()) cells_.emplace_back();
    cells_[count_].point = site;
    cells_[count_++].near = near;
  }
  bool empty() const { return count_ == 0; }
  std::size_t size() const { return count_; }
  void clear() { count_ = num_triangulated_ = 0; }

 private:
  friend class RestrictedPowerDiagram;
  std::vector<NewCell> cells_;  ///< keep their memory
  std::size_t count_ = 0;
  std::size_t num_triangulated_ = 0;  ///< of them, the first ones
};

namespace detail {

/// Faces of the overlay of a mesh of that many facets and as many cells: by Euler one for each of both, and one for each place
/// where their edges cross, of which there are 2·L·L'/(π·area) for lengths L and L', here of equilateral triangles and regular
/// hexagons. For foreseeing time only.
inline double expected_fragments(double facets, double sites) { return facets + sites + 2.7 * std::sqrt(facets * sites); }

/// Microseconds that a diagram takes, roughly. For foreseeing time only.
struct DiagramCosts {
  double triangulation, fragments;

  DiagramCosts(double facets, double sites, unsigned workers) {
    triangulation = 1.9 * sites;
    fragments = (0.6 * sites + 0.65 * expected_fragments(facets, sites)) / workers;
  }
  double all() const { return triangulation + fragments; }
};

}  // namespace detail

}  // namespace amps

#include "amps/host_macros_end.h"
