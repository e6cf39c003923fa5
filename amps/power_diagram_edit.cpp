#define AMPS_OWN_SOURCE
#include "amps/power_diagram.h"

#include "amps/power_diagram_clipper.h"

#include <algorithm>
#include <cmath>
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
  const Index s = triangulation_.insert(position, weight, hint_cell(near)) - kSentinels;
  first_of_site_.push_back(kNone);
  reach_.push_back(kNoCell);
  num_guards_ += is_guard(s);
  changed_.clear();
  changed_sites_.clear();
  if (visible(s)) take_cell(s, triangulation_.neighbors_of_last_insertion());
  if (reach_lists_ != nullptr) enter_local_facets(s);
  finish_edit();
  return s;
}

void RestrictedPowerDiagram::reinsert(Index s, const Vec3& position, double weight, Index near) {
  if (s < 0 || s >= num_sites() || !removed(s)) {
    throw Error(ErrorCode::kInvalidArgument,
                "restricted power diagram: site " + std::to_string(s) + " is not a removed one; use insert()");
  }
  triangulation_.reinsert(s + kSentinels, position, weight, hint_cell(near));
  num_guards_ += is_guard(s);
  changed_.clear();
  changed_sites_.clear();
  if (visible(s)) retake_cell(s);
  if (reach_lists_ != nullptr) enter_local_facets(s);
  finish_edit();
}

/// Gives a site that has been put back its cell.
void RestrictedPowerDiagram::retake_cell(Index s) {
  std::vector<Index> around = link_of(s);
  for (const Index v : triangulation_.hidden_by_last_insertion()) {
    const WeightedPoint &p = site(s), &q = triangulation_.point(v);
    if (v < kSentinels || p.position() != q.position() || p.w != q.w) continue;
    // Its duplicate had the cell until now, and no bisector tells the two apart.
    neighbors(s, around);
    around.push_back(s);
    reach_[slot(s)] = 0;
    divide_cell(v - kSentinels, around);
    return;
  }
  take_cell(s, around);
}

/// Gives a new site its cell. `around`: its neighbours, vertices of the triangulation.
void RestrictedPowerDiagram::take_cell(Index s, const std::vector<Index>& around) {
  std::vector<Plane> planes;
  const std::vector<Index> touched = find_touched(s, around, planes);
  Clipper clipper(*this);
  clipper.remember_crossings();
  std::vector<Index> facets = clip_touched(touched, s, clipper);
  for (const Index v : triangulation_.hidden_by_last_insertion()) {
    if (v >= kSentinels && v != s + kSentinels) reach_[slot(v - kSentinels)] = kNoCell;
  }
  std::sort(facets.begin(), facets.end());
  facets.erase(std::unique(facets.begin(), facets.end()), facets.end());
  for (const Index facet : facets) {
    clipper.set_facet(facet);
    clipper.start(s);
    clipper.clip_all(planes.data(), planes.data() + planes.size());
    AMPS_ASSERT(!clipper.empty());
    add_fragment(facet, s, clipper);
  }
  update_reach(s);
}

/// Lists the fragments from which the cell of a new site may take something, grouped by site, and the planes of the new site.
std::vector<Index> RestrictedPowerDiagram::find_touched(Index s, const std::vector<Index>& around,
                                                        std::vector<Plane>& planes) const {
  // The new cell takes its place from its neighbours and from the sites it has hidden, and from nobody else.
  for (const Index v : around) {
    if (v >= kSentinels) planes.push_back(plane(s, v - kSentinels));
  }
  std::sort(planes.begin(), planes.end(), detail::NearerPlane());
  for (const Plane& plane : planes) {  // worth a tenth of the time of an insertion, where the fragments exceed the cache
    const Index first = first_of_site(plane.site);
    if (first == kNone || plane.offset > reach_[slot(plane.site)]) continue;
    const Index last = std::min(first + detail::kFragmentsPrefetched, fragment_capacity());
    for (Index f = first; f < last; ++f) detail::prefetch(&fragments_[slot(f)]);
  }
  std::vector<Index> touched;
  for (const Plane& plane : planes) find_touched(plane.site, s, touched);
  for (const Index v : triangulation_.hidden_by_last_insertion()) {
    if (v >= kSentinels && v != s + kSentinels) find_touched(v - kSentinels, s, touched);
  }
  for (const Index f : touched) prefetch_facet_corners(fragments_[slot(f)].facet);
  return touched;
}

// Many at once
//
// All enter the triangulation first. A site whose neighbours neither are new nor neighbour another new site takes its cell from
// fragments that no other one touches: such cells are found side by side. The others follow one after the other. Either way a
// cell is that among the sites which had entered before, as if all had come one by one.

void RestrictedPowerDiagram::insert_together(const std::vector<WeightedPoint>& sites, const std::vector<Index>& near,
                                             const Execution& execution) {
  AMPS_ASSERT(status_ != Outcome::kCancelled && reach_lists_ == nullptr && near.size() == sites.size());
  changed_.clear();
  changed_sites_.clear();
  const bool alone = execution.workers() == 1;
  std::vector<NewCell> apart, others;
  const std::uint32_t stamp = new_stamp();
  stamp_.resize(slot(triangulation_.num_vertices()) + sites.size(), 0);
  for (std::size_t k = 0; k < sites.size(); ++k) {
    NewCell cell;
    cell.site = triangulation_.insert(sites[k].position(), sites[k].w, hint_cell(near[k])) - kSentinels;
    AMPS_ASSERT(triangulation_.hidden_by_last_insertion().empty());
    cell.around = triangulation_.neighbors_of_last_insertion();
    first_of_site_.push_back(kNone);
    reach_.push_back(kNoCell);
    num_guards_ += is_guard(cell.site);
    bool is_apart = true;
    for (const Index v : cell.around) {
      if (v >= kSentinels && std::exchange(stamp_[slot(v)], stamp) == stamp) is_apart = false;
    }
    stamp_[slot(cell.site + kSentinels)] = stamp;
    if (is_apart && alone) {  // while what is around is in the cache
      take_cell(cell.site, cell.around);
    } else {
      (is_apart ? apart : others).push_back(std::move(cell));
    }
  }
  if (!apart.empty()) {
    constexpr std::size_t kCellsPerPiece = 4;
    parallel_for(apart.size(), kCellsPerPiece, execution.without_progress(), [&](std::size_t begin, std::size_t end) {
      Clipper clipper(*this);
      clipper.remember_crossings();
      for (std::size_t k = begin; k < end; ++k) find_cell(clipper, apart[k]);
    });
    for (const NewCell& cell : apart) store_cell(cell);
  }
  for (const NewCell& cell : others) take_cell(cell.site, cell.around);
  finish_edit();
}

/// What take_cell() would store.
void RestrictedPowerDiagram::find_cell(Clipper& clipper, NewCell& cell) const {
  const auto keep = [&] {
    cell.corners.insert(cell.corners.end(), clipper.corners(), clipper.corners() + clipper.size());
    cell.labels.insert(cell.labels.end(), clipper.labels().begin(), clipper.labels().end());
  };
  std::vector<Plane> planes;
  std::vector<Index> facets;
  for (const Index f : find_touched(cell.site, cell.around, planes)) {
    const Fragment& fragment = fragments_[slot(f)];
    clipper.load(polygon(f));
    if (!clipper.clip(cell.site)) continue;
    facets.push_back(fragment.facet);
    cell.cuts.push_back({f, fragment.site, clipper.size(), clipper.ball()});
    keep();
  }
  std::sort(facets.begin(), facets.end());
  facets.erase(std::unique(facets.begin(), facets.end()), facets.end());
  for (const Index facet : facets) {
    clipper.set_facet(facet);
    clipper.start(cell.site);
    clipper.clip_all(planes.data(), planes.data() + planes.size());
    AMPS_ASSERT(!clipper.empty());
    cell.pieces.push_back({facet, clipper.size(), clipper.ball()});
    keep();
  }
}

void RestrictedPowerDiagram::store_cell(const NewCell& cell) {
  const detail::PackedBarycentric* corners = cell.corners.data();
  const Index* labels = cell.labels.data();
  for (std::size_t k = 0; k < cell.cuts.size(); ++k) {
    const NewCell::Cut& cut = cell.cuts[k];
    changed_.push_back(cut.fragment);
    if (cut.size == 0) {
      retire_fragment(cut.fragment);
    } else {
      store_polygon(fragments_[slot(cut.fragment)], cut.ball, corners, labels, cut.size);
    }
    corners += cut.size;
    labels += cut.size;
    if (k + 1 < cell.cuts.size() && cell.cuts[k + 1].site == cut.site) continue;
    changed_sites_.push_back(cut.site);
    update_reach(cut.site);
  }
  for (const NewCell::Piece& piece : cell.pieces) {
    add_fragment(piece.facet, cell.site, piece.ball, corners, labels, piece.size);
    corners += piece.size;
    labels += piece.size;
  }
  update_reach(cell.site);
}

void RestrictedPowerDiagram::finish_edit() {
  if (4 * polygons_.unused() > 3 * polygons_.capacity()) compact_polygons();
  // A slot freed and used again is listed twice.
  std::sort(changed_.begin(), changed_.end());
  changed_.erase(std::unique(changed_.begin(), changed_.end()), changed_.end());
  std::sort(changed_sites_.begin(), changed_sites_.end());
  changed_sites_.erase(std::unique(changed_sites_.begin(), changed_sites_.end()), changed_sites_.end());
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

/// Takes the cell of `by` off these fragments, grouped by site, and returns the facets where it took something.
std::vector<Index> RestrictedPowerDiagram::clip_touched(const std::vector<Index>& touched, Index by, Clipper& clipper) {
  std::vector<Index> facets;
  for (std::size_t k = 0; k < touched.size();) {
    const Index site = fragments_[slot(touched[k])].site;
    bool any_clipped = false;
    for (; k < touched.size() && fragments_[slot(touched[k])].site == site; ++k) {
      const Index f = touched[k];
      clipper.load(polygon(f));
      if (!clipper.clip(by)) continue;
      any_clipped = true;
      facets.push_back(fragments_[slot(f)].facet);
      changed_.push_back(f);
      if (clipper.empty()) {
        retire_fragment(f);
      } else {
        store_polygon(fragments_[slot(f)], clipper);
      }
    }
    if (!any_clipped) continue;
    changed_sites_.push_back(site);
    update_reach(site);
  }
  return facets;
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

/// The neighbours of a visible site, vertices of the triangulation.
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
  changed_.clear();
  changed_sites_.clear();
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
    divide_cell(s, candidates);
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

/// Divides the fragments of s, which has no cell any more, among the candidates.
void RestrictedPowerDiagram::divide_cell(Index s, const std::vector<Index>& candidates) {
  const std::vector<Index> left = take_fragments(s, false);
  std::vector<Index> possible_owners;
  for (const Index f : left) {
    prefetch_polygon(f);
    detail::prefetch(&first_of_facet_[slot(fragments_[slot(f)].facet)]);
  }
  for (const Index f : left) {
    const Index facet = fragments_[slot(f)].facet;
    prefetch_facet_corners(facet);
    Index grown = first_of_facet(facet);
    for (Index k = 0; k < detail::kFragmentsPrefetched && grown != kNone; ++k, grown = next_of_facet(grown))
      prefetch_polygon(grown);
  }
  Clipper clipper(*this);
  clipper.remember_crossings();
  DivideScratch scratch;
  scratch.many = left.size() > detail::kManyFragments;
  reach_[slot(s)] = kNoCell;
  for (const Index f : left) {
    find_possible_owners(f, candidates, possible_owners);
    divide_fragment(f, possible_owners, clipper, scratch);
  }
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
                                             DivideScratch& scratch) {
  const Polygon left = polygon(f);
  std::vector<Index>& owners = scratch.owners;
  owners.clear();
  for (Index k = 0; k < left.size; ++k) {
    if (is_site(left.labels[k])) owners.push_back(left.labels[k]);
  }
  free_taken_fragment(f);
  changed_.push_back(f);
  changed_sites_.push_back(left.site);
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
      add_fragment(left.facet, owner, clipper);
    } else {
      store_polygon(fragments_[slot(grown)], clipper);
      changed_.push_back(grown);
      changed_sites_.push_back(owner);
    }
    if (local(left.facet)) continue;  // what an edit looks for by reach_ are others
    const double farthest = reach(grown == kNone ? changed_.back() : grown);
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
  if (!scratch.many) return fragment_of(facet, site);
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
