#define AMPS_OWN_SOURCE
#include "amps/power_diagram.h"

#include "amps/power_diagram_clipper.h"
#include "amps/thread_pool.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

namespace amps {

using detail::slot;

Index RestrictedPowerDiagram::hint_cell(Index near) const {
  return near == kNone || !visible(near) ? kNone : triangulation_.incident_cell(near + kSentinels);
}

Index RestrictedPowerDiagram::insert(const Vec3& position, double weight, Index near) {
  if (status_ == Outcome::kCancelled) {
    throw Error(ErrorCode::kCancelled, "restricted power diagram: its construction was cancelled; make a new one");
  }
  NewCell cell;
  cell.point = {position.x(), position.y(), position.z(), weight};
  cell.near = near;
  enter_triangulation(cell);
  add_site(cell);
  edit_.clear();
  CellScratch scratch(*this);
  if (cell.visible) take_cell(cell, scratch, edit_);
  if (reach_lists_ != nullptr) enter_local_facets(cell.site, cell.hidden, 0);
  finish_edit();
  return cell.site;
}

/// What is in the triangulation of a new site is noted in its cell, for whenever that is found.
void RestrictedPowerDiagram::enter_triangulation(NewCell& cell) {
  const Index v = triangulation_.insert(cell.point.position(), cell.point.w, hint_cell(cell.near));
  cell.site = v - kSentinels;
  cell.visible = triangulation_.state(v) == RegularTriangulation::VertexState::kVisible;
  cell.around = triangulation_.neighbors_of_last_insertion();
  cell.hidden = triangulation_.hidden_by_last_insertion();
}

/// A site of the triangulation becomes one of the diagram, without a cell as yet.
void RestrictedPowerDiagram::add_site(const NewCell& cell) {
  AMPS_ASSERT(cell.site == num_sites());
  first_of_site_.push_back(kNone);
  reach_.push_back(kNoCell);
  num_guards_ += is_guard(cell.site);
}

void RestrictedPowerDiagram::reinsert(Index s, const Vec3& position, double weight, Index near) {
  if (s < 0 || s >= num_sites() || !removed(s)) {
    throw Error(ErrorCode::kInvalidArgument,
                "restricted power diagram: site " + std::to_string(s) + " is not a removed one; use insert()");
  }
  triangulation_.reinsert(s + kSentinels, position, weight, hint_cell(near));
  num_guards_ += is_guard(s);
  edit_.clear();
  if (visible(s)) retake_cell(s);
  if (reach_lists_ != nullptr) enter_local_facets(s, triangulation_.hidden_by_last_insertion(), 0);
  finish_edit();
}

/// The neighbours of a site that has just entered, vertices of the triangulation.
void RestrictedPowerDiagram::list_new_neighbors(Index s, std::vector<Index>& around) {
  // Hidden points that had to be placed anew may have left other ones.
  if (triangulation_.num_hidden() == 0) {
    around = triangulation_.neighbors_of_last_insertion();
  } else {
    around = link_of(s);
  }
}

/// Gives a site that has been put back its cell.
void RestrictedPowerDiagram::retake_cell(Index s) {
  NewCell cell;
  cell.site = s;
  list_new_neighbors(s, cell.around);
  cell.hidden = triangulation_.hidden_by_last_insertion();
  for (const Index v : cell.hidden) {
    const WeightedPoint &p = site(s), &q = triangulation_.point(v);
    if (v < kSentinels || p.position() != q.position() || p.w != q.w) continue;
    // Its duplicate had the cell until now, and no bisector tells the two apart.
    neighbors(s, cell.around);
    cell.around.push_back(s);
    reach_[slot(s)] = 0;
    divide_cell(v - kSentinels, cell.around, edit_);
    return;
  }
  CellScratch scratch(*this);
  take_cell(cell, scratch, edit_);
}

/// Gives a new site its cell. False, and nothing has changed, where an edit beside others has too few slots.
bool RestrictedPowerDiagram::take_cell(const NewCell& cell, CellScratch& scratch, EditRecord& edit) {
  find_touched(cell, scratch);
  if (edit.beside_others && scratch.touched.size() > edit.slots.size()) return false;
  clip_touched(cell.site, scratch, edit);
  forget_hidden(cell);
  divide_taken(cell.site, scratch, [&](Index facet, const Clipper& clipper) { add_fragment(facet, cell.site, clipper, edit); });
  measure_reach(cell.site, edit);
  return true;
}

/// What the new site has in each facet where it takes something. Beyond each edge of that is somebody it takes a part from, and
/// leaves a part.
template <class Add>
void RestrictedPowerDiagram::divide_taken(Index site, CellScratch& scratch, const Add& add) const {
  std::vector<CellScratch::Taken>& taken = scratch.taken;
  std::sort(taken.begin(), taken.end(), [](const CellScratch::Taken& a, const CellScratch::Taken& b) {
    return a.facet != b.facet ? a.facet < b.facet : a.order < b.order;
  });
  Clipper& clipper = scratch.clipper;
  for (auto from = taken.begin(); from != taken.end();) {
    const Index facet = from->facet;
    clipper.set_facet(facet);
    clipper.start(site);
    for (; from != taken.end() && from->facet == facet; ++from) {
      if (from->site != kNone) clipper.clip(from->site);
    }
    AMPS_ASSERT(!clipper.empty());
    add(facet, clipper);
  }
}

/// Lists the fragments from which the cell of a new site may take something, grouped by site, and the planes of the new site.
void RestrictedPowerDiagram::find_touched(const NewCell& cell, CellScratch& scratch) const {
  // The new cell takes its place from its neighbours and from the sites it has hidden, and from nobody else.
  std::vector<Plane>& planes = scratch.planes;
  planes.clear();
  for (const Index v : cell.around) {
    if (v >= kSentinels) planes.push_back(plane(cell.site, v - kSentinels));
  }
  std::sort(planes.begin(), planes.end(), detail::NearerPlane());
  // Neighbours without a cell as yet, if any, have the highest numbers.
  const auto has_cell = [this](Index s) { return s < num_sites(); };
  for (const Plane& plane : planes) {  // worth a tenth of the time of an insertion, where the fragments exceed the cache
    const Index first = has_cell(plane.site) ? first_of_site(plane.site) : kNone;
    if (first == kNone || plane.offset > reach_[slot(plane.site)]) continue;
    const Index last = std::min(first + detail::kFragmentsPrefetched, fragment_capacity());
    for (Index f = first; f < last; ++f) detail::prefetch(&fragments_[slot(f)]);
  }
  scratch.touched.clear();
  for (const Plane& plane : planes) {
    if (has_cell(plane.site)) find_touched(plane.site, cell.site, scratch.touched);
  }
  for (const Index v : cell.hidden) {
    if (v >= kSentinels && has_cell(v - kSentinels)) find_touched(v - kSentinels, cell.site, scratch.touched);
  }
  for (const Index f : scratch.touched) prefetch_facet_corners(fragments_[slot(f)].facet);
}

// Many at once
//
// On several threads cells are found side by side, as if each were the first one, and stored one after another. What an earlier
// one has changed shows in its marks: a cell that takes something of a fragment changed since, or of a site that came since, is
// found anew. All others are what they would have been. Let t take a point x. If x was somebody's who was there before, whose
// fragment has not changed, t was found to take it from there. Else x is now in a changed fragment of such a one, and marked;
// or it came to a new site s. Then s is a neighbour of t, whose fragments are looked at.
//
// Beside the cells, one thread brings the sites to come into the triangulation. Nothing of that is read: of their triangulation
// cells need only what was noted when their site entered it, and the positions of sites.

void RestrictedPowerDiagram::insert_together(Arrivals& now, Arrivals& next, const std::function<void()>& draw,
                                             const Measure& measure, const Execution& execution) {
  AMPS_ASSERT(status_ != Outcome::kCancelled && next.empty());
  const Index first = num_sites();
  std::size_t num_found = 0;
  if (execution.workers() == 1) {
    draw();
  } else {
    num_found = find_cells(now, next, draw, measure, execution);
  }
  edit_.clear();
  measured_.clear();
  CellScratch scratch(*this);
  for (std::size_t k = 0; k < now.size(); ++k) {
    NewCell& cell = now.cells_[k];
    if (k >= now.num_triangulated_) enter_triangulation(cell);  // while what is around is in the cache
    const std::size_t from = edit_.changed.size();
    const bool is_right = k < num_found && is_cell_right(cell, first, scratch);
    add_site(cell);
    if (is_right) {
      store_cell(cell);
    } else if (cell.visible) {
      take_cell(cell, scratch, edit_);
    }
    if (reach_lists_ != nullptr) enter_local_facets(cell.site, cell.hidden, from);
    note_changes(from, is_right ? &cell.values : nullptr);
  }
  for (std::size_t k = 0; k < edit_.changed.size(); ++k) {
    const Index f = edit_.changed[k];
    is_changed_[slot(f)] = false;
    if (!is_changed_again_[slot(f)]) continue;
    is_changed_again_[slot(f)] = false;
    measured_[k] = std::numeric_limits<double>::quiet_NaN();
  }
  edit_.changed_sites.clear();
  if (4 * polygons_.unused() > 3 * polygons_.capacity()) compact_polygons();
}

/// Of fragments that one cell has changed, listed `from` there on, those that are new to the list stay in it. `values`: of the
/// first ones, measured.
void RestrictedPowerDiagram::note_changes(std::size_t from, const std::vector<double>* values) {
  is_changed_.resize(fragments_.size());
  is_changed_again_.resize(fragments_.size());
  std::size_t kept = from;
  std::vector<Index>& changed = edit_.changed;
  for (std::size_t k = from; k < changed.size(); ++k) {
    const Index f = changed[k];
    if (is_changed_[slot(f)]) {
      is_changed_again_[slot(f)] = true;
      continue;
    }
    is_changed_[slot(f)] = true;
    const bool known = values != nullptr && k - from < values->size();
    measured_.push_back(known ? (*values)[k - from] : std::numeric_limits<double>::quiet_NaN());
    changed[kept++] = f;
  }
  changed.resize(kept);
}

/// Finds the first cells of `now`, and returns how many; `next` enters the triangulation beside that.
std::size_t RestrictedPowerDiagram::find_cells(Arrivals& now, Arrivals& next, const std::function<void()>& draw,
                                               const Measure& measure, const Execution& execution) {
  constexpr std::size_t kCellsPerTask = 4, kFewCells = 8;
  const auto triangulate = [this](Arrivals& arrivals) {
    for (std::size_t& k = arrivals.num_triangulated_; k < arrivals.size(); ++k) enter_triangulation(arrivals.cells_[k]);
  };
  triangulate(now);
  const std::size_t num_cells = now.size() < kFewCells ? 0 : now.size();
  const std::size_t num_tasks = (num_cells + kCellsPerTask - 1) / kCellsPerTask;
  triangulation_.keep_in_place(kMostArrivals);
  detail::ScratchPool<CellScratch> scratches;
  parallel_for(1 + num_tasks, 1, execution.without_progress(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t task = begin; task < end; ++task) {
      if (task == 0) {
        draw();
        AMPS_ASSERT(next.size() <= kMostArrivals);
        triangulate(next);
        continue;
      }
      const auto scratch = scratches.lend([this] { return std::make_unique<CellScratch>(*this); });
      NewCell* const first = &now.cells_[(task - 1) * kCellsPerTask];
      NewCell* const last = now.cells_.data() + std::min(task * kCellsPerTask, num_cells);
      for (NewCell* cell = first; cell != last; ++cell) find_cell(*cell, *scratch);
      measure_cells(first, last, measure);
    }
  });
  return num_cells;
}

/// What take_cell() would store, were the site the first one to come.
void RestrictedPowerDiagram::find_cell(NewCell& cell, CellScratch& scratch) const {
  cell.cuts.clear();
  cell.pieces.clear();
  cell.corners.clear();
  cell.labels.clear();
  cell.values.clear();
  if (!cell.visible) return;
  const Clipper& clipper = scratch.clipper;
  const auto keep = [&] {
    cell.corners.insert(cell.corners.end(), clipper.corners(), clipper.corners() + clipper.size());
    cell.labels.insert(cell.labels.end(), clipper.labels().begin(), clipper.labels().end());
  };
  find_touched(cell, scratch);
  for_each_taken(cell.site, scratch, [&](Index f) {
    cell.cuts.push_back({f, fragments_[slot(f)].site, clipper.size(), clipper.ball()});
    keep();
  });
  divide_taken(cell.site, scratch, [&](Index facet, const Clipper&) {
    cell.pieces.push_back({facet, clipper.size(), clipper.ball()});
    keep();
  });
}

/// Measures what cells have been found to leave and to take.
void RestrictedPowerDiagram::measure_cells(NewCell* begin, NewCell* end, const Measure& measure) const {
  std::vector<Polygon> polygons;
  for (const NewCell* cell = begin; cell != end; ++cell) {
    const detail::PackedBarycentric* corners = cell->corners.data();
    const Index* labels = cell->labels.data();
    const auto list = [&](Index facet, Index site, Index size) {
      if (size > 0) polygons.push_back({facet, site, {mesh_, facet, corners}, labels, size});
      corners += size;
      labels += size;
    };
    for (const NewCell::Cut& cut : cell->cuts) list(fragments_[slot(cut.fragment)].facet, cut.site, cut.size);
    for (const NewCell::Piece& piece : cell->pieces) list(piece.facet, cell->site, piece.size);
  }
  std::vector<double> values;
  measure(polygons, values);
  auto value = values.begin();
  for (NewCell* cell = begin; cell != end; ++cell) {
    for (const NewCell::Cut& cut : cell->cuts) cell->values.push_back(cut.size > 0 ? *value++ : 0.0);
    for (std::size_t k = 0; k < cell->pieces.size(); ++k) cell->values.push_back(*value++);
  }
}

/// Is a cell still what was found? `first`: of the sites that came together.
bool RestrictedPowerDiagram::is_cell_right(const NewCell& cell, Index first, CellScratch& scratch) const {
  if (!cell.visible) return false;
  for (const NewCell::Cut& cut : cell.cuts) {
    if (slot(cut.fragment) < is_changed_.size() && is_changed_[slot(cut.fragment)]) return false;
  }
  scratch.touched.clear();
  for (const std::vector<Index>* sites : {&cell.around, &cell.hidden}) {
    for (const Index v : *sites) {
      if (v - kSentinels >= first) find_touched(v - kSentinels, cell.site, scratch.touched);
    }
  }
  return scratch.touched.empty();
}

/// Sites that a new one, visible, has hidden have no cell any more.
void RestrictedPowerDiagram::forget_hidden(const NewCell& cell) {
  for (const Index v : cell.hidden) {
    if (v >= kSentinels) reach_[slot(v - kSentinels)] = kNoCell;
  }
}

void RestrictedPowerDiagram::store_cell(const NewCell& cell) {
  const detail::PackedBarycentric* corners = cell.corners.data();
  const Index* labels = cell.labels.data();
  for (std::size_t k = 0; k < cell.cuts.size(); ++k) {
    const NewCell::Cut& cut = cell.cuts[k];
    edit_.changed.push_back(cut.fragment);
    if (cut.size == 0) {
      retire_fragment(cut.fragment, edit_);
    } else {
      store_polygon(fragments_[slot(cut.fragment)], cut.ball, corners, labels, cut.size, edit_);
    }
    corners += cut.size;
    labels += cut.size;
    if (k + 1 < cell.cuts.size() && cell.cuts[k + 1].site == cut.site) continue;
    measure_reach(cut.site, edit_);
  }
  forget_hidden(cell);
  for (const NewCell::Piece& piece : cell.pieces) {
    add_fragment(piece.facet, cell.site, piece.ball, corners, labels, piece.size, edit_);
    corners += piece.size;
    labels += piece.size;
  }
  measure_reach(cell.site, edit_);
}

void RestrictedPowerDiagram::finish_edit(EditRecord& edit) {
  if (!edit.beside_others && 4 * polygons_.unused() > 3 * polygons_.capacity()) compact_polygons();
  // A slot freed and used again is listed twice.
  for (std::vector<Index>* const list : {&edit.changed, &edit.changed_sites}) {
    std::sort(list->begin(), list->end());
    list->erase(std::unique(list->begin(), list->end()), list->end());
  }
}

/// Lists the fragments of `site` from which the cell of `by` may take something.
void RestrictedPowerDiagram::find_touched(Index site, Index by, std::vector<Index>& touched) const {
  if (plane(site, by).offset > reach_[slot(site)]) return;
  const WeightedPoint& owner = this->site(site);
  const double most = 2 * reach_[slot(site)];  // of the distance of a centre, which is no corner
  const detail::RelativeFilter filter(owner.position(), owner.w, this->site(by), largest_facet_error_, most);
  const double slope = filter.slope();
  for (Index f = first_of_site(site); f != kNone; f = next_of_site(f)) {
    const Fragment& fragment = fragments_[slot(f)];
    if (local(fragment.facet)) continue;
    if (filter.is_inside(filter.value(fragment.ball.centre()) - slope * fragment.ball.radius())) continue;
    touched.push_back(f);
    prefetch_polygon(f);
  }
}

/// Clips the fragments that the cell of `by` touches; visit(f) for each of which it takes something, with what is left of it in
/// the clipper.
template <class Visit>
void RestrictedPowerDiagram::for_each_taken(Index by, CellScratch& scratch, const Visit& visit) const {
  const std::vector<Index>& touched = scratch.touched;
  Clipper& clipper = scratch.clipper;
  scratch.taken.clear();
  for (std::size_t k = 0; k < touched.size(); ++k) {
    const Index f = touched[k], facet = fragments_[slot(f)].facet, site = fragments_[slot(f)].site;
    clipper.load(polygon(f));
    if (!clipper.clip(by)) continue;
    scratch.taken.push_back({facet, static_cast<Index>(k), clipper.empty() ? kNone : site});
    visit(f);
  }
}

/// Takes the cell of `by` off the fragments that it touches.
void RestrictedPowerDiagram::clip_touched(Index by, CellScratch& scratch, EditRecord& edit) {
  Index last = kNone;
  const auto finish = [&](Index site) {
    if (last != kNone && last != site) {
      edit.changed_sites.push_back(last);
      measure_reach(last, edit);  // which the triangulation may not have any more, in an edit beside others
    }
    last = site;
  };
  for_each_taken(by, scratch, [&](Index f) {
    finish(fragments_[slot(f)].site);
    edit.changed.push_back(f);
    if (scratch.clipper.empty()) {
      retire_fragment(f, edit);
    } else {
      store_polygon(fragments_[slot(f)], scratch.clipper, edit);
    }
  });
  finish(kNone);
}

// Fragments that an edit touches are far apart in memory. It asks for all of them before it works on the first: on a mesh that
// exceeds the cache half of its time otherwise is waiting.

/// For the polygon of a fragment, and the corners' indices of its facet.
void RestrictedPowerDiagram::prefetch_polygon(Index f) const {
  const Fragment& fragment = fragments_[slot(f)];
  const detail::PackedBarycentric* const corners = polygons_.corners(first_of(fragment));
  detail::prefetch(corners);
  detail::prefetch(corners + fragment.ball.note() - 1);
  detail::prefetch(polygons_.labels(first_of(fragment)));
  detail::prefetch(mesh_.triangles.address(fragment.facet));
  detail::prefetch(&facet_error_[slot(fragment.facet)]);
}

void RestrictedPowerDiagram::prefetch_facet_corners(Index facet) const {
  for (int c = 0; c < 3; ++c) detail::prefetch(mesh_.vertices.address(mesh_.triangles(facet, c)));
}

/// A mark that no entry of stamp_ has.
std::uint32_t RestrictedPowerDiagram::new_stamp() {
  stamp_.reserve(kSentinels + first_of_site_.capacity());
  stamp_.resize(slot(triangulation_.num_vertices()), 0);
  if (++last_stamp_ == 0) {
    std::fill(stamp_.begin(), stamp_.end(), 0u);
    last_stamp_ = 1;
  }
  return last_stamp_;
}

/// The neighbours of a visible site, vertices of the triangulation, ascending: the order of cells depends on the number of
/// threads that made them.
std::vector<Index> RestrictedPowerDiagram::link_of(Index s) {
  std::vector<Index> star, link;
  triangulation_.incident_cells(s + kSentinels, star);
  stamp_[slot(s + kSentinels)] = new_stamp();
  for (const Index c : star) {
    for (const Index v : triangulation_.cell(c).vertex) {
      if (v == RegularTriangulation::kInfinite || stamp_[slot(v)] == last_stamp_) continue;
      stamp_[slot(v)] = last_stamp_;
      link.push_back(v);
    }
  }
  std::sort(link.begin(), link.end());
  return link;
}

// Local removal
//
// What a site leaves in a facet is a convex polygon, to be divided among the candidates for it: its neighbours in space and the
// sites that it alone has hidden. A site beyond an edge of it gets the strip along that edge, hence a larger fragment: its old
// one, grown over the edge as far as the facet reaches, and cut by the other candidates. The edges of the grown ones lead to
// candidates that had nothing in the facet. Fragments that have no edge with the polygon stay as they are, as do other facets.

void RestrictedPowerDiagram::remove(Index s) {
  if (s < 0 || s >= num_sites() || removed(s)) {
    throw Error(ErrorCode::kInvalidArgument, "restricted power diagram: there is no site " + std::to_string(s) +
                                                 "; ids are 0 to " + std::to_string(num_sites() - 1) + ", less those removed");
  }
  if (num_removed() + 1 == num_sites()) {
    throw Error(ErrorCode::kInvalidArgument, "restricted power diagram: site " + std::to_string(s) +
                                                 " is the last one, and a diagram has at least one; insert another first");
  }
  keep_a_guard(s);
  edit_.clear();
  const bool had_cell = visible(s);
  std::vector<Index> candidates;
  if (had_cell) candidates = link_of(s);
  const Index hidden = triangulation_.num_hidden();
  triangulation_.remove(s + kSentinels);
  if (had_cell) {
    if (triangulation_.num_hidden() != hidden) add_uncovered(candidates);
    candidates.erase(std::remove_if(candidates.begin(), candidates.end(), [](Index v) { return v < kSentinels; }),
                     candidates.end());
    for (Index& candidate : candidates) candidate -= kSentinels;
    divide_cell(s, candidates, edit_);
  }
  if (reach_lists_ != nullptr) leave_local_facets(s);
  finish_edit();
}

bool RestrictedPowerDiagram::is_guard(Index s) const {
  const WeightedPoint& p = site(s);
  return p.w >= min_weight_ && (p.position().array() >= low_.array()).all() && (p.position().array() <= high_.array()).all();
}

/// Before the removal of s: if it is the last guard, the sentinels move so that all sites are guards. No cell on the mesh
/// changes.
void RestrictedPowerDiagram::keep_a_guard(Index s) {
  if (!is_guard(s)) return;
  if (--num_guards_ > 0) return;
  for (Index u = 0; u < num_sites(); ++u) {
    if (removed(u)) continue;
    low_ = low_.cwiseMin(site(u).position());
    high_ = high_.cwiseMax(site(u).position());
    min_weight_ = std::min(min_weight_, site(u).w);
  }
  Index v = 0;
  for (const WeightedPoint& sentinel : sentinels()) triangulation_.move(v++, sentinel.position(), sentinel.w);
  num_guards_ = num_sites() - num_removed() - 1;
  for (Index u = 0; u < num_sites(); ++u) {  // a duplicate of a sentinel, and the like
    if (visible(u) != (reach_[slot(u)] != kNoCell)) update_reach(u);
  }
}

/// Adds to the neighbours of a removed site (vertices of the triangulation) those that have come back from hiding. They and the
/// neighbours fill its place, so that each is joined to a neighbour by edges between such vertices.
void RestrictedPowerDiagram::add_uncovered(std::vector<Index>& candidates) {
  std::vector<Index> around;
  for (std::size_t k = 0; k < candidates.size(); ++k) {
    triangulation_.neighbors(candidates[k], around);
    for (const Index v : around) {
      const bool fresh = v < kSentinels ? std::find(candidates.begin(), candidates.end(), v) == candidates.end()
                                        : reach_[slot(v - kSentinels)] == kNoCell;
      if (!fresh) continue;
      if (v >= kSentinels) reach_[slot(v - kSentinels)] = 0;
      candidates.push_back(v);
    }
  }
}

/// Divides the fragments of s, which has no cell any more, among the candidates. False where an edit beside others has too few
/// slots for all of them: what is left is divided by another call.
bool RestrictedPowerDiagram::divide_cell(Index s, const std::vector<Index>& candidates, EditRecord& edit) {
  const std::vector<Index> left = take_fragments(s, false);
  std::vector<Index> possible_owners;
  for (const Index f : left) {
    prefetch_polygon(f);
    detail::prefetch(&first_of_facet_[slot(fragments_[slot(f)].facet)]);
  }
  for (const Index f : left) {
    const Index facet = fragments_[slot(f)].facet;
    prefetch_facet_corners(facet);
    if (edit.beside_others) continue;
    Index grown = first_of_facet(facet);
    for (Index k = 0; k < detail::kFragmentsPrefetched && grown != kNone; ++k, grown = next_of_facet(grown))
      prefetch_polygon(grown);
  }
  Clipper clipper(*this);
  clipper.remember_crossings();
  DivideScratch scratch;
  scratch.many = left.size() > detail::kManyFragments;
  scratch.by_site = edit.beside_others;
  reach_[slot(s)] = kNoCell;
  for (std::size_t k = 0; k < left.size(); ++k) {
    find_possible_owners(left[k], candidates, possible_owners);
    // Owners are among these and the sites beyond its edges.
    const std::size_t most_owners = possible_owners.size() + slot(size_of(fragments_[slot(left[k])]));
    if (edit.beside_others && most_owners > edit.slots.size()) {
      for (; k < left.size(); ++k) link_to_site(left[k]);
      return false;
    }
    divide_fragment(left[k], possible_owners, clipper, scratch, edit);
  }
  return true;
}

/// The candidates that may own something in fragment f. At its points, in the ball around it, the owner's power is at most what
/// any candidate's can be there.
void RestrictedPowerDiagram::find_possible_owners(Index f, const std::vector<Index>& candidates,
                                                  std::vector<Index>& possible_owners) const {
  const Fragment& fragment = fragments_[slot(f)];
  const Vec3 centre = site(fragment.site).position() + fragment.ball.centre();
  const double radius = fragment.ball.radius() + largest_facet_error_;
  const auto slack = [](double d, double w) { return detail::kOffsetSlack * (d * d + std::fabs(w)); };
  double max_power = INFINITY;
  for (const Index candidate : candidates) {
    const double d = detail::norm(site(candidate).position() - centre) + radius, w = site(candidate).w;
    max_power = std::min(max_power, d * d - w + slack(d, w));
  }
  possible_owners.clear();
  for (const Index candidate : candidates) {
    const double d = std::max(detail::norm(site(candidate).position() - centre) - radius, 0.0), w = site(candidate).w;
    if (!(d * d - w - slack(d, w) > max_power)) possible_owners.push_back(candidate);  // NaN, from overflow, decides nothing
  }
}

/// f is in the list of no site any more.
void RestrictedPowerDiagram::divide_fragment(Index f, const std::vector<Index>& possible_owners, Clipper& clipper,
                                             DivideScratch& scratch, EditRecord& edit) {
  const Polygon left = polygon(f);
  std::vector<Index>& owners = scratch.owners;
  owners.clear();
  for (Index k = 0; k < left.size; ++k) {
    if (is_site(left.labels[k])) owners.push_back(left.labels[k]);
  }
  free_taken_fragment(f, edit);
  edit.changed.push_back(f);
  edit.changed_sites.push_back(left.site);
  if (owners.empty()) owners.push_back(owner_of_corner(left.facet, possible_owners));
  for (std::size_t n = 0; n < owners.size(); ++n) {
    const Index owner = owners[n], grown = fragment_of(left.facet, owner, scratch);
    if (grown == kNone) {
      clipper.set_facet(left.facet);
      clipper.start(owner);
    } else {
      clipper.load_without(polygon(grown), left.site);
    }
    // Those with edges here first: they cut off the most.
    for (const Index other : owners) {
      if (other != owner && !clipper.has_label(other)) clipper.clip(other);
    }
    for (const Index other : possible_owners) {
      if (other != owner && !clipper.has_label(other)) clipper.clip(other);
    }
    AMPS_ASSERT(!clipper.empty());
    for (const Index label : clipper.labels()) {
      if (!is_site(label) || std::find(owners.begin(), owners.end(), label) != owners.end()) continue;
      const Index* const labels = grown == kNone ? nullptr : polygon(grown).labels;
      if (grown == kNone || std::find(labels, labels + polygon(grown).size, label) == labels + polygon(grown).size) {
        owners.push_back(label);
      }
    }
    if (grown == kNone) {
      add_fragment(left.facet, owner, clipper, edit);
    } else {
      store_polygon(fragments_[slot(grown)], clipper, edit);
      edit.changed.push_back(grown);
      edit.changed_sites.push_back(owner);
    }
    if (local(left.facet)) continue;  // what an edit looks for by reach_ are others
    const double farthest = reach(grown == kNone ? edit.changed.back() : grown);
    double& known = reach_[slot(owner)];
    if (farthest > known || std::isnan(farthest)) known = farthest;
  }
}

/// Which of these sites owns the first corner of the facet.
Index RestrictedPowerDiagram::owner_of_corner(Index facet, const std::vector<Index>& among) const {
  const Vec3 x = mesh_.corner(facet, 0);
  const double* const corners[3] = {x.data(), x.data(), x.data()};
  AMPS_ASSERT(!among.empty());
  Index best = among.front();
  for (const Index other : among) {
    if (other != best && side_of_corner(corners, 0, Bisector(site(best), site(other), corners)) < 0) best = other;
  }
  return best;
}

/// The fragment of the site in the facet, if any. In time proportional to the shorter of their lists, or better.
Index RestrictedPowerDiagram::fragment_of(Index facet, Index site) const {
  Index a = first_of_facet(facet), b = first_of_site(site);
  while (a != kNone && b != kNone) {
    if (fragments_[slot(a)].site == site) return a;
    if (fragments_[slot(b)].facet == facet) return b;
    a = next_of_facet(a);
    b = next_of_site(b);
  }
  return kNone;
}

/// The same while a cell is divided. A facet is asked for by one fragment of the cell only, and a site once then: so lists need
/// not know of what dividing adds. On needles a cell has hundreds of fragments, and so has a facet; going along either for each
/// fragment and each neighbour was half of the time of an optimisation.
Index RestrictedPowerDiagram::fragment_of(Index facet, Index site, DivideScratch& scratch) const {
  if (!scratch.many) {
    if (!scratch.by_site) return fragment_of(facet, site);
    Index f = first_of_site(site);
    while (f != kNone && fragments_[slot(f)].facet != facet) f = next_of_site(f);
    return f;
  }
  auto of_site = std::find_if(scratch.lists.begin(), scratch.lists.end(), [&](const auto& list) { return list.site == site; });
  if (of_site == scratch.lists.end()) {
    of_site = scratch.lists.insert(of_site, {site, {}});
    for (Index f = first_of_site(site); f != kNone; f = next_of_site(f)) {
      of_site->fragments.emplace_back(fragments_[slot(f)].facet, f);
    }
    std::sort(of_site->fragments.begin(), of_site->fragments.end());
  }
  const auto at = std::lower_bound(of_site->fragments.begin(), of_site->fragments.end(), std::make_pair(facet, Index{0}));
  return at != of_site->fragments.end() && at->first == facet ? at->second : kNone;
}

}  // namespace amps
