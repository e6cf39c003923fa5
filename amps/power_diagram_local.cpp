// Local facets of a restricted power diagram: those that are divided among the sites that reach them.
//
// A facet becomes local when in the diagram of all sites somebody owns a fragment there, and has a part of it in its ball, but
// does not reach the facet. (An owner whose ball does not meet its fragment does no harm: nobody's does, and the fragment is a
// gap either way.) Mostly few sites reach such a facet, and each bounds the cells of all others. Large ones, a side of a thin
// plate, find who may bound a cell in a grid.
#define AMPS_OWN_SOURCE
#include "amps/power_diagram.h"

#include "amps/power_diagram_clipper.h"
#include "amps/samples.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace amps {

using detail::slot;

namespace detail {
namespace {

/// So many sites bound each other's cells in a facet without a search among them.
constexpr Index kFewLocalSites = 48;
/// So many are moved in a list at once, in a tenth of a microsecond.
constexpr std::size_t kFewKeptTidy = 1024;
/// Fragments of a loop that takes some 20 ns for each, and at most 200.
constexpr std::size_t kLocalFragmentsPerPiece = std::size_t{1} << 13;

/// Does the ball meet the convex polygon with these corners? True where rounding leaves it open.
template <class Corners>
bool ball_may_meet(const Corners& corners, Index size, const Vec3& normal, const WeightedPoint& ball, double error) {
  constexpr double kSlack = 1e-9;
  const Vec3 p = ball.position();
  double nearest = INFINITY;
  bool above_inside = true;
  Vec3 b = corners[size - 1];
  for (Index k = 0; k < size; ++k) {
    const Vec3 a = std::exchange(b, corners[k]), along = b - a;
    const double length2 = squared_norm(along);
    const double t = length2 > 0 ? std::min(std::max(dot(p - a, along) / length2, 0.0), 1.0) : 0.0;
    nearest = std::min(nearest, squared_norm(a + t * along - p));
    above_inside = above_inside && dot(normal.cross(along), p - a) >= 0;
  }
  if (above_inside) {
    const double height = dot(p - corners[0], normal);
    nearest = std::min(nearest, height * height);
  }
  const double radius = std::sqrt(ball.w) * (1 + kSlack) + error;
  return !(nearest > radius * radius);
}

}  // namespace
}  // namespace detail

/// Lists may have sites that are on their way into the diagram.
bool RestrictedPowerDiagram::takes_part(Index s) const {
  if (s >= num_sites()) return false;
  const RegularTriangulation::VertexState state = triangulation_.state(s + kSentinels);
  return state != RegularTriangulation::VertexState::kRemoved && state != RegularTriangulation::VertexState::kDuplicate;
}

bool RestrictedPowerDiagram::reaches_local_facet(Index s) const {
  if (reach_lists_ == nullptr || local_.empty()) return false;
  for (const Index facet : reach_lists_->facets(s)) {
    if (local(facet)) return true;
  }
  return false;
}

/// visit(site), ascending.
template <class Visit>
void RestrictedPowerDiagram::for_each_local_site(Index facet, const Visit& visit) const {
  const LocalSites& local = local_sites_[slot(local_[slot(facet)])];
  const auto visit_all = [&](const std::vector<Index>& sites) {
    for (const Index s : sites) {
      if (takes_part(s)) visit(s);
    }
  };
  if (local.tidy) {
    visit_all(local.sites);
    return;
  }
  std::vector<Index> sites = local.sites;
  keep_local_sites(facet, sites);
  visit_all(sites);
}

void RestrictedPowerDiagram::list_local_sites(Index facet, std::vector<Index>& sites) const {
  sites.clear();
  for_each_local_site(facet, [&](Index s) { sites.push_back(s); });
}

/// How many are listed.
Index RestrictedPowerDiagram::count_local_sites(Index facet) const {
  return static_cast<Index>(local_sites_[slot(local_[slot(facet)])].sites.size());
}

/// Sorts these sites, and leaves out those that do not reach the facet, or not any more. Duplicates of others stay: once these
/// are removed they take part.
void RestrictedPowerDiagram::keep_local_sites(Index facet, std::vector<Index>& sites) const {
  const auto is_gone = [&](Index s) { return removed(s) || !reach_lists_->has(s) || !reach_lists_->reaches(s, facet); };
  sites.erase(std::remove_if(sites.begin(), sites.end(), is_gone), sites.end());
  std::sort(sites.begin(), sites.end());
  sites.erase(std::unique(sites.begin(), sites.end()), sites.end());
}

void RestrictedPowerDiagram::add_local_site(Index facet, Index s) {
  LocalSites& local = local_sites_[slot(local_[slot(facet)])];
  std::vector<Index>& sites = local.sites;
  if (local.tidy && (sites.empty() || s > sites.back())) {
    sites.push_back(s);
    return;
  }
  if (local.tidy && sites.size() <= detail::kFewKeptTidy) {
    sites.insert(std::lower_bound(sites.begin(), sites.end(), s), s);
    return;
  }
  if (local.tidy) local.most = 2 * sites.size();
  local.tidy = false;
  sites.push_back(s);
  if (sites.size() < local.most) return;
  keep_local_sites(facet, sites);
  local.tidy = true;
}

void RestrictedPowerDiagram::remove_local_site(Index facet, Index s) {
  LocalSites& local = local_sites_[slot(local_[slot(facet)])];
  std::vector<Index>& sites = local.sites;
  if (local.tidy && sites.size() <= detail::kFewKeptTidy) {
    const auto at = std::lower_bound(sites.begin(), sites.end(), s);
    AMPS_ASSERT(at != sites.end() && *at == s);
    sites.erase(at);
    return;
  }
  if (local.tidy) local.most = 2 * sites.size();
  local.tidy = false;
}

/// From now on the facet is local. No site is listed yet.
void RestrictedPowerDiagram::make_local(Index facet) {
  if (local_.empty()) local_.assign(slot(mesh_.num_facets()), kNone);
  local_[slot(facet)] = static_cast<Index>(local_sites_.size());
  local_sites_.emplace_back();
}

/// Lists all sites that reach some of these facets, which are not local yet, and others. Let the ball of a site hold a point x
/// of a facet. If the site does not own x, then across some side of its cell there is one of less power at x, whose ball holds
/// x, too. So from the owners in the facet one gets to all of them over neighbours whose balls meet it; but for those that
/// others have hidden. Ascending.
std::vector<Index> RestrictedPowerDiagram::find_sites_near(const std::vector<Index>& facets) {
  struct Place {
    detail::FacetCorners corners;
    Vec3 normal;
    double error;
  };
  std::vector<Place> places;
  std::vector<Index> sites, star;
  const std::uint32_t stamp = new_stamp();
  const auto is_new = [&](Index v) { return std::exchange(stamp_[slot(v)], stamp) != stamp; };
  for (const Index facet : facets) {
    places.push_back({detail::FacetCorners(mesh_, facet), detail::normal_of(mesh_, facet), facet_error_[slot(facet)]});
    for (Index f = first_of_facet(facet); f != kNone; f = next_of_facet(f)) {
      const Index s = fragments_[slot(f)].site;
      if (is_new(s + kSentinels)) sites.push_back(s);
    }
  }
  const auto meets = [&](Index s) {
    const WeightedPoint& ball = site(s);
    return std::any_of(places.begin(), places.end(), [&](const Place& place) {
      return detail::ball_may_meet(place.corners.at, 3, place.normal, ball, place.error);
    });
  };
  // Who owns a point in the triangulation may be a site that is on its way into the diagram.
  for (Index v = num_sites() + kSentinels; v < triangulation_.num_vertices(); ++v) {
    const bool is_visible = triangulation_.state(v) == RegularTriangulation::VertexState::kVisible;
    if (is_visible && is_new(v) && meets(v - kSentinels)) sites.push_back(v - kSentinels);
  }
  for (std::size_t k = 0; k < sites.size(); ++k) {
    triangulation_.incident_cells(sites[k] + kSentinels, star);
    for (const Index c : star) {
      for (const Index v : triangulation_.cell(c).vertex) {
        if (v >= kSentinels && is_new(v) && meets(v - kSentinels)) sites.push_back(v - kSentinels);
      }
    }
  }
  if (triangulation_.num_hidden() > 0) {
    for (Index s = 0; s < num_sites(); ++s) {
      if (!visible(s) && !removed(s)) sites.push_back(s);
    }
  }
  std::sort(sites.begin(), sites.end());
  sites.erase(std::lower_bound(sites.begin(), sites.end(), num_sites()), sites.end());  // those that are on their way
  sites.erase(std::unique(sites.begin(), sites.end()), sites.end());  // an owner may be hidden by one of those
  return sites;
}

/// Has the ball of its owner a part of the fragment, while the owner does not reach the facet?
bool RestrictedPowerDiagram::is_foreign(Index f) const {
  const Fragment& fragment = fragments_[slot(f)];
  if (reach_lists_->reaches(fragment.site, fragment.facet)) return false;
  const WeightedPoint& owner = site(fragment.site);
  const double error = facet_error_[slot(fragment.facet)];
  const double beyond = detail::norm(fragment.ball.centre()) * (1 - detail::kOffsetSlack) - fragment.ball.radius() - error;
  if (beyond > 0 && beyond * beyond > owner.w) return false;
  return detail::ball_may_meet(polygon(f).corners, size_of(fragment), detail::normal_of(mesh_, fragment.facet), owner, error);
}

void RestrictedPowerDiagram::find_local_facets(const Execution& execution) {
  constexpr std::size_t kPiece = detail::kLocalFragmentsPerPiece;
  std::vector<std::vector<Index>> found((fragments_.size() + kPiece - 1) / kPiece);
  detail::for_each_piece_on_all_threads(fragments_.size(), kPiece, execution.part(0, 0.5),
                                        [&](std::size_t begin, std::size_t end) {
                                          std::vector<Index>& facets = found[begin / kPiece];
                                          for (std::size_t f = begin; f < end; ++f) {
                                            if (is_foreign(static_cast<Index>(f))) facets.push_back(fragments_[f].facet);
                                          }
                                        });
  std::vector<Index> facets;
  for (const std::vector<Index>& some : found) facets.insert(facets.end(), some.begin(), some.end());
  std::sort(facets.begin(), facets.end());
  facets.erase(std::unique(facets.begin(), facets.end()), facets.end());
  if (facets.empty()) return;
  for (const Index facet : facets) make_local(facet);
  detail::for_each_piece(slot(num_sites()), detail::kElementsPerLook, execution.part(0.5, 0.6),
                         [&](std::size_t begin, std::size_t end) {
                           for (auto s = static_cast<Index>(begin); s < static_cast<Index>(end); ++s) {
                             for (const Index facet : reach_lists_->facets(s)) {
                               if (local(facet)) add_local_site(facet, s);
                             }
                           }
                         });
  detail::Ticker dividing(execution.part(0.6, 1), facets.size());
  for (const Index facet : facets) {
    dividing.tick();
    clear_facet(facet);
    divide_locally(facet);
  }
  edit_.clear();
}

/// Fragments that an edit has changed, those listed `from` there on, may be foreign now: after an insertion those of the new
/// owner, since all others have shrunk; after a removal (kNone) any.
void RestrictedPowerDiagram::localize_foreign(Index owner, std::size_t from) {
  std::vector<Index> facets;
  for (std::size_t k = from; k < edit_.changed.size(); ++k) {
    const Index f = edit_.changed[k];
    if (!alive(f) || (owner != kNone && fragments_[slot(f)].site != owner) || local(fragments_[slot(f)].facet)) continue;
    if (is_foreign(f)) facets.push_back(fragments_[slot(f)].facet);
  }
  std::sort(facets.begin(), facets.end());
  facets.erase(std::unique(facets.begin(), facets.end()), facets.end());
  if (!facets.empty()) localize(facets);
}

void RestrictedPowerDiagram::localize(const std::vector<Index>& facets) {
  const std::vector<Index> near = find_sites_near(facets);
  for (const Index facet : facets) {
    make_local(facet);
    for (const Index s : near) {
      if (reach_lists_->reaches(s, facet)) local_sites_.back().sites.push_back(s);
    }
    clear_facet(facet);
    divide_locally(facet);
  }
}

void RestrictedPowerDiagram::clear_facet(Index facet) {
  for (Index f = first_of_facet(facet), next = kNone; f != kNone; f = next) {
    next = next_of_facet(f);
    edit_.changed.push_back(f);
    edit_.changed_sites.push_back(fragments_[slot(f)].site);
    free_fragment(f, edit_);
  }
}

/// A local facet without fragments gets them, by a flood from the owner of a corner.
void RestrictedPowerDiagram::divide_locally(Index facet) {
  std::vector<Index> queue;
  list_local_sites(facet, queue);
  if (queue.empty()) {
    add_ownerless_fragment(facet);
    return;
  }
  if (count_local_sites(facet) > detail::kFewLocalSites && site_tree_.empty()) make_site_tree();
  queue.assign(1, owner_of_corner(facet, queue));
  const std::uint32_t stamp = new_stamp();
  stamp_[slot(queue.front() + kSentinels)] = stamp;
  Clipper clipper(*this);
  clipper.set_facet(facet);
  for (std::size_t k = 0; k < queue.size(); ++k) {
    const Index s = queue[k];
    clip_locally(facet, s, clipper);
    AMPS_ASSERT(!clipper.empty());
    add_fragment(facet, s, clipper, edit_);
    for (const Index label : clipper.labels()) {
      if (!is_site(label) || stamp_[slot(label + kSentinels)] == stamp) continue;
      stamp_[slot(label + kSentinels)] = stamp;
      queue.push_back(label);
    }
  }
}

void RestrictedPowerDiagram::add_ownerless_fragment(Index facet) {
  Clipper clipper(*this);
  clipper.set_facet(facet);
  clipper.start_ownerless();
  add_fragment(facet, kNone, clipper, edit_);
}

void RestrictedPowerDiagram::make_site_tree() {
  site_tree_ = detail::SiteTree(low_, high_);
  for (Index s = 0; s < num_sites(); ++s) {
    if (!removed(s)) insert_into_site_tree(s);
  }
}

void RestrictedPowerDiagram::insert_into_site_tree(Index s) {
  site_tree_.insert(site(s).position(), site(s).w, s, [this](Index other) { return site(other).position(); });
}

/// The cell of `owner` in the facet that the clipper is set to.
void RestrictedPowerDiagram::clip_locally(Index facet, Index owner, Clipper& clipper) const {
  clipper.start(owner);
  std::vector<Plane> planes;
  const auto clip = [&] {
    std::sort(planes.begin(), planes.end(), detail::NearerPlane());
    clipper.clip_all(planes.data(), planes.data() + planes.size());
    planes.clear();
  };
  const auto clip_by_all = [&] {
    for_each_local_site(facet, [&](Index s) {
      if (s != owner) planes.push_back(plane(owner, s));
    });
    clip();
  };
  if (site_tree_.empty() || count_local_sites(facet) <= detail::kFewLocalSites) {
    clip_by_all();
    return;
  }
  // From near to far, a doubled distance at a time: which sites are looked at together depends on the distances alone.
  const WeightedPoint& p = site(owner);
  const Vec3 x = p.position();
  // The plane of a site of weight w at distance d is at (d² + w_owner − w)/2d: at least so far, for all d from `least` on.
  const auto least_offset = [&](double least, double weight) {
    const double difference = p.w - weight;
    if (difference > least * least) return std::sqrt(difference);
    return least > 0 ? (least * least + difference) / (2 * least) : -INFINITY;
  };
  const double first = p.w > 0 ? 2 * std::sqrt(p.w) : site_tree_.radius() / 64;
  const double farthest = detail::norm(x - (low_ + high_) / 2) + 2 * site_tree_.radius();
  for (double before = -1, within = first;; before = within, within *= 2) {
    const bool last = within >= farthest;
    const double radius = clipper.security_radius();
    bool more = false;
    site_tree_.visit(
        x,
        [&](double least, double most, double weight) {
          if (most <= before || least_offset(std::max(least, before), weight) * (1 - detail::kOffsetSlack) > radius)
            return false;
          more = more || most > within;
          return last || least <= within;
        },
        [&](Index s) {
          if (s == owner) return;
          const double d = detail::norm(site(s).position() - x);
          const bool its_turn = d > before && (last || d <= within);
          if (its_turn && takes_part(s) && reach_lists_->reaches(s, facet)) planes.push_back(plane(owner, s));
        });
    clip();
    if (clipper.empty() || last || !more) return;
  }
}

/// `hidden`: by s, vertices of the triangulation. What its entering has changed by now is listed `from` there on.
void RestrictedPowerDiagram::enter_local_facets(Index s, const std::vector<Index>& hidden, std::size_t from) {
  if (!site_tree_.empty()) insert_into_site_tree(s);
  if (!local_.empty()) {
    for (const Index facet : reach_lists_->facets(s)) {
      if (local(facet)) add_local_site(facet, s);
    }
  }
  for (const Index v : hidden) {
    // Its duplicate: no bisector tells the two apart.
    if (v >= kSentinels && v != s + kSentinels && !takes_part(v - kSentinels)) give_local_facets_away(v - kSentinels);
  }
  if (takes_part(s)) {
    Clipper clipper(*this);
    for (const Index facet : reach_lists_->facets(s)) {
      if (local(facet) && facet_error_[slot(facet)] >= 0 && fragment_of(facet, s) == kNone)
        enter_local_facet(facet, s, clipper);
    }
  }
  localize_foreign(s, from);
}

/// A fragment of a local facet near x, found from that of a site near by, or else the facet's first one, by moving to whoever
/// beyond an edge has less power there. In doubles: it is only where a search begins.
Index RestrictedPowerDiagram::local_fragment_near(Index facet, const Vec3& x) const {
  const auto power = [&](Index s) { return detail::squared_norm(site(s).position() - x) - site(s).w; };
  double least = INFINITY;
  Index at = first_of_facet(facet);
  site_tree_.visit_cube(x, [&](Index s) {
    const Index near = power(s) < least ? fragment_of(facet, s) : kNone;
    if (near == kNone) return;
    least = power(s);
    at = near;
  });
  for (least = INFINITY; at != kNone;) {
    const Polygon here = polygon(at);
    if (here.site == kNone) return kNone;
    least = std::min(least, power(here.site));
    Index next = kNone;
    for (Index k = 0; k < here.size; ++k) {
      if (!is_site(here.labels[k]) || !(power(here.labels[k]) < least)) continue;
      least = power(here.labels[k]);
      next = here.labels[k];
    }
    if (next == kNone) return at;
    at = fragment_of(facet, next);
  }
  return kNone;
}

/// enter_local_facet() without a search for who bounds the new cell: those it takes from, since beyond each of its edges lies
/// one of them, and what it takes hangs together. False if it takes nothing of the fragment near its site, and nothing has
/// changed then.
bool RestrictedPowerDiagram::enter_large_facet(Index facet, Index s, Clipper& clipper) {
  const Index first = local_fragment_near(facet, site(s).position());
  if (first == kNone) return false;
  const std::vector<Index> cut = cut_local_fragments(facet, s, {fragments_[slot(first)].site}, clipper);
  std::vector<Plane> planes;
  for (const Index other : cut) planes.push_back(plane(s, other));
  if (planes.empty()) return false;
  std::sort(planes.begin(), planes.end(), detail::NearerPlane());
  clipper.set_facet(facet);
  clipper.start(s);
  clipper.clip_all(planes.data(), planes.data() + planes.size());
  AMPS_ASSERT(!clipper.empty());
  add_fragment(facet, s, clipper, edit_);
  return true;
}

void RestrictedPowerDiagram::enter_local_facet(Index facet, Index s, Clipper& clipper) {
  const bool large = count_local_sites(facet) > detail::kFewLocalSites;
  if (large && site_tree_.empty()) make_site_tree();
  if (large && enter_large_facet(facet, s, clipper)) return;
  clipper.set_facet(facet);
  clip_locally(facet, s, clipper);
  if (clipper.empty()) return;
  const Index first = first_of_facet(facet);
  if (first != kNone && fragments_[slot(first)].site == kNone) {
    edit_.changed.push_back(first);
    free_fragment(first, edit_);
  }
  add_fragment(facet, s, clipper, edit_);
  // It takes from those beyond its edges, and from whom these border on and are cut from.
  std::vector<Index> from(clipper.labels().begin(), clipper.labels().end());
  if (std::none_of(from.begin(), from.end(), is_site)) {  // it owns all of the facet
    for (Index f = first_of_facet(facet); f != kNone; f = next_of_facet(f)) from.push_back(fragments_[slot(f)].site);
  }
  cut_local_fragments(facet, s, from, clipper);
}

/// Takes the cell of s off the fragments of these sites (other labels are passed over), and off those that border on what is
/// cut. Returns the sites that it has taken something from.
std::vector<Index> RestrictedPowerDiagram::cut_local_fragments(Index facet, Index s, const std::vector<Index>& from,
                                                               Clipper& clipper) {
  std::vector<Index> queue, labels, cut;
  const std::uint32_t stamp = new_stamp();
  stamp_[slot(s + kSentinels)] = stamp;
  const auto add_sites = [&](const std::vector<Index>& found) {
    for (const Index label : found) {
      if (!is_site(label) || stamp_[slot(label + kSentinels)] == stamp) continue;
      stamp_[slot(label + kSentinels)] = stamp;
      queue.push_back(label);
    }
  };
  add_sites(from);
  for (std::size_t k = 0; k < queue.size(); ++k) {
    const Index f = fragment_of(facet, queue[k]);
    if (f == kNone) continue;
    const Polygon old = polygon(f);
    labels.assign(old.labels, old.labels + old.size);
    clipper.load(old);
    if (!clipper.clip(s)) continue;
    cut.push_back(queue[k]);
    edit_.changed.push_back(f);
    edit_.changed_sites.push_back(queue[k]);
    if (clipper.empty()) {
      free_fragment(f, edit_);
    } else {
      store_polygon(fragments_[slot(f)], clipper, edit_);
    }
    add_sites(labels);
  }
  return cut;
}

/// After the removal of s, which the lists still have.
void RestrictedPowerDiagram::leave_local_facets(Index s) {
  if (!site_tree_.empty()) site_tree_.remove(site(s).position(), s);
  if (!local_.empty()) {
    for (const Index facet : reach_lists_->facets(s)) {
      if (local(facet)) remove_local_site(facet, s);
    }
  }
  give_local_facets_away(s);
  localize_foreign(kNone, 0);
}

/// Divides what s, which takes no part any more, has in local facets.
void RestrictedPowerDiagram::give_local_facets_away(Index s) {
  const std::vector<Index> left = take_fragments(s, true);
  std::vector<Index> candidates;
  Clipper clipper(*this);
  DivideScratch scratch;
  scratch.many = left.size() > detail::kManyFragments;
  for (const Index f : left) {
    find_local_candidates(f, candidates);
    if (!candidates.empty()) {
      divide_fragment(f, candidates, clipper, scratch, edit_);
      continue;
    }
    const Index facet = fragments_[slot(f)].facet;
    edit_.changed.push_back(f);
    edit_.changed_sites.push_back(s);
    free_taken_fragment(f, edit_);
    add_ownerless_fragment(facet);
  }
}

/// Those of a local facet that may own something of what fragment f leaves.
void RestrictedPowerDiagram::find_local_candidates(Index f, std::vector<Index>& candidates) const {
  const Fragment& fragment = fragments_[slot(f)];
  const Index facet = fragment.facet;
  if (!site_tree_.empty() && count_local_sites(facet) > detail::kFewLocalSites) {
    // At a point of the fragment its new owner has at most the power of whoever is beyond an edge.
    const Vec3 centre = site(fragment.site).position() + fragment.ball.centre();
    const double radius = fragment.ball.radius() + largest_facet_error_;
    const Polygon left = polygon(f);
    double max_power = INFINITY;
    for (Index k = 0; k < left.size; ++k) {
      if (!is_site(left.labels[k])) continue;
      const WeightedPoint& p = site(left.labels[k]);
      const double d = detail::norm(p.position() - centre) + radius;
      max_power = std::min(max_power, d * d - p.w);
    }
    candidates.clear();
    const auto reach = [&](double weight) {
      return (radius + std::sqrt(std::max(0.0, max_power + weight))) * (1 + detail::kOffsetSlack);
    };
    site_tree_.visit(
        centre, [&](double least, double, double weight) { return least <= reach(weight); },
        [&](Index s) {
          const bool is_near = detail::norm(site(s).position() - centre) <= reach(site(s).w);
          if (is_near && takes_part(s) && reach_lists_->reaches(s, facet)) candidates.push_back(s);
        });
    return;
  }
  list_local_sites(facet, candidates);
}

}  // namespace amps
