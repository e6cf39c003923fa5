// Removing, moving and re-weighting points of a RegularTriangulation.
//
// The star of a vertex is a hole with a triangulated border once the vertex is gone. The regular triangulation of the other
// points is unique (triangulation.h), and its cells in the hole have corners in the vertex's link only: so each border facet
// has one apex, the link vertex whose cell with it no other link vertex conflicts with, and gift wrapping from facet to facet
// fills the hole with exactly those cells. Facets without a link vertex in front of them are on the new hull.
#define AMPS_OWN_SOURCE
#include "amps/triangulation.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace amps {
namespace detail {
namespace {

/// Links of more vertices are triangulated, in n·log n; smaller ones wrapped, in n²: as fast at this size.
constexpr std::size_t kSmallLink = 48;

}  // namespace
}  // namespace detail

using detail::kFaceCorners;
using detail::slot;

void RegularTriangulation::remove(Index v) {
  require_present(v);
  detail::require_exact_arithmetic();
  hidden_by_last_.clear();
  if (dimension_ < 3) {
    forget(v);
    rebuild_basis();
    return;
  }
  if (state(v) != VertexState::kVisible) {
    detach_hidden(v);
    --num_hidden_;
    forget(v);
    return;
  }
  open_hole(v);
  forget(v);
  if (cavity_vertices_.size() <= detail::kSmallLink || !fill_hole_from_link(v)) wrap_hole();
  if (num_finite_ == 0) {
    flatten();
    return;
  }
  // Points that only v's cells, or v itself, have kept hidden come back; of equal ones the lowest id comes first and stays.
  std::sort(uncovered_.begin(), uncovered_.end());
  for (const Index u : uncovered_) {
    state_[slot(u)] = VertexState::kVisible;
    --num_hidden_;
    place(u, last_cell_);
  }
  place_hidden(last_cell_);
}

void RegularTriangulation::reinsert(Index v, const Vec3& position, double weight, Index hint) {
  if (v < 0 || v >= num_vertices() || state(v) != VertexState::kRemoved) {
    throw Error(ErrorCode::kInvalidArgument,
                "triangulation: point " + std::to_string(v) + " is not a removed one; use insert()");
  }
  detail::require_exact_arithmetic();
  require_finite_point(position, weight);
  hidden_by_last_.clear();
  points_[slot(v)] = {position.x(), position.y(), position.z(), weight};
  grow_bounds(point(v));
  state_[slot(v)] = VertexState::kVisible;
  --num_removed_;
  if (dimension_ < 3) {
    if (extend_basis(v)) bulk_insert(v, 1);
    return;
  }
  place(v, hint);
  if (state(v) != VertexState::kVisible) hidden_by_last_.push_back(v);
  place_hidden(last_cell_);
}

void RegularTriangulation::move(Index v, const Vec3& position, double weight) {
  require_present(v);
  require_finite_point(position, weight);
  const WeightedPoint& p = point(v);
  if (p.position() == position && p.w == weight) return;
  remove(v);
  reinsert(v, position, weight);
}

void RegularTriangulation::require_present(Index v) const {
  if (v < 0 || v >= num_vertices() || state(v) == VertexState::kRemoved) {
    throw Error(ErrorCode::kInvalidArgument, "triangulation: there is no point " + std::to_string(v) + "; ids are 0 to " +
                                                 std::to_string(num_vertices() - 1) + ", less those removed");
  }
}

void RegularTriangulation::require_finite_point(const Vec3& position, double weight) {
  if (position.allFinite() && std::isfinite(weight)) return;
  throw Error(ErrorCode::kInvalidArgument, "triangulation: the point is not finite (NaN or infinity); remove or repair it");
}

void RegularTriangulation::forget(Index v) {
  state_[slot(v)] = VertexState::kRemoved;
  vertex_cell_[slot(v)] = kNone;
  ++num_removed_;
}

/// While everything lies in a plane: the dimension and an independent set after a removal. Stops at the first points that span
/// what was spanned before.
void RegularTriangulation::rebuild_basis() {
  const int before = dimension_;
  dimension_ = -1;
  for (Index v = 0; v < num_vertices() && dimension_ < before; ++v) {
    if (state(v) != VertexState::kRemoved) extend_basis(v);
  }
}

/// The vertices that are left lie in a plane: no cells, and every point waits. Points that were hidden may reach out of the
/// plane: then all start over.
void RegularTriangulation::flatten() {
  cells_.clear();
  mark_.clear();
  work_.free_cells.clear();
  hidden_head_.clear();
  hidden_next_.clear();
  num_hidden_ = num_ghosts_ = 0;
  last_cell_ = kNone;
  dimension_ = -1;
  bool spans_space = false;
  for (Index v = 0; v < num_vertices(); ++v) {
    if (state(v) == VertexState::kRemoved) continue;
    state_[slot(v)] = VertexState::kVisible;
    vertex_cell_[slot(v)] = kNone;
    spans_space = spans_space || extend_basis(v);
  }
  if (spans_space) bulk_insert(0, 1);
}

void RegularTriangulation::detach_hidden(Index v) {
  Index* at = &hidden_head_[slot(vertex_cell_[slot(v)])];
  while (*at != v) at = &hidden_next_[slot(*at)];
  *at = hidden_next_[slot(v)];
}

/// Inserts v and settles who stays if it has a twin.
void RegularTriangulation::place(Index v, Index hint) {
  if (hint == kNone || hint >= cell_capacity() || !cell(hint).alive()) hint = last_cell_;
  last_cell_ = insert_vertex(v, hint);
  if (state(v) == VertexState::kDuplicate) {
    const Index twin = std::exchange(vertex_cell_[slot(v)], kNone);
    if (twin > v) {
      // The lower id takes over the twin's cells.
      std::vector<Index> star;
      incident_cells(twin, star);
      for (const Index c : star) *std::find(cells_[slot(c)].vertex.begin(), cells_[slot(c)].vertex.end(), twin) = v;
      vertex_cell_[slot(v)] = std::exchange(vertex_cell_[slot(twin)], kNone);
      std::swap(state_[slot(v)], state_[slot(twin)]);
      hidden_by_last_.push_back(twin);
      unplaced_.push_back(twin);
      return;
    }
  }
  if (state(v) != VertexState::kVisible) unplaced_.push_back(v);
}

// The hole

/// Frees the star of v; its border becomes the open facets, its corners the link (numbered in the order of cavity_vertices_),
/// and hidden points in it wait in uncovered_.
void RegularTriangulation::open_hole(Index v) {
  collect_star(v);
  cavity_vertices_.clear();
  uncovered_.clear();
  const std::uint32_t stamp = next_stamp(work_);
  for (const Index c : work_.conflict) {
    for (const Index u : cell(c).vertex) {
      if (u == v || u == kInfinite || work_.local[slot(u + 2)] == stamp) continue;
      work_.local[slot(u + 2)] = stamp;
      // Until the hole is filled: every link vertex gets a new cell then.
      vertex_cell_[slot(u)] = static_cast<Index>(cavity_vertices_.size());
      cavity_vertices_.push_back(u);
    }
  }
  const Index infinite = static_cast<Index>(cavity_vertices_.size());
  open_facets_.clear();
  open_ghost_facets_.clear();
  for (const Index c : work_.conflict) {
    Cell& here = cells_[slot(c)];
    HoleFacet facet{};
    for (int k = 0; k < 4; ++k) {
      const Index u = here.vertex[slot(k)];
      facet.vertex[slot(k)] = u == kInfinite ? infinite : (u == v ? kNone : vertex_cell_[slot(u)]);
      if (u == v) facet.slot = k;
    }
    facet.outside = here.neighbor[slot(facet.slot)];
    facet.set_key();
    (here.ghost() ? open_ghost_facets_ : open_facets_).push_back(facet);
    if (!hidden_head_.empty()) {
      for (Index u = hidden_head_[slot(c)]; u != kNone; u = hidden_next_[slot(u)]) uncovered_.push_back(u);
      hidden_head_[slot(c)] = kNone;
    }
    --(here.ghost() ? num_ghosts_ : num_finite_);
    here.vertex[0] = kNone;
    work_.free_cells.push_back(c);
  }
  for (const Index u : uncovered_) vertex_cell_[slot(u)] = kNone;
}

/// The cells around v, in work_.conflict. As incident_cells, with marks instead of a set.
void RegularTriangulation::collect_star(Index v) {
  Scratch<Index>& star = work_.conflict;
  star.assign(1, vertex_cell_[slot(v)]);
  mark_[slot(star.front())] = kInConflict;
  for (std::size_t k = 0; k < star.size(); ++k) {
    const Cell& here = cell(star[k]);
    for (std::size_t f = 0; f < 4; ++f) {
      const Index next = here.neighbor[f] >> 2;
      if (here.vertex[f] == v || mark_[slot(next)] == kInConflict) continue;
      mark_[slot(next)] = kInConflict;
      star.push_back(next);
    }
  }
  for (const Index c : star) mark_[slot(c)] = kUntested;
}

void RegularTriangulation::HoleFacet::set_key() {
  key = {vertex[detail::slot((slot + 1) & 3)], vertex[detail::slot((slot + 2) & 3)], vertex[detail::slot((slot + 3) & 3)]};
  if (key[0] > key[1]) std::swap(key[0], key[1]);
  if (key[1] > key[2]) std::swap(key[1], key[2]);
  if (key[0] > key[1]) std::swap(key[0], key[1]);
}

/// A cell with these corners, numbers of the link, the infinite one last.
Index RegularTriangulation::add_hole_cell(const std::array<Index, 4>& corner) {
  const Index infinite = static_cast<Index>(cavity_vertices_.size());
  const Index c = allocate_cell(work_);
  Cell& here = cells_[slot(c)];
  for (std::size_t k = 0; k < 4; ++k) {
    here.vertex[k] = corner[k] == infinite ? kInfinite : cavity_vertices_[slot(corner[k])];
    if (corner[k] != infinite) vertex_cell_[slot(here.vertex[k])] = c;
  }
  ++(here.ghost() ? num_ghosts_ : num_finite_);
  last_cell_ = c;
  return c;
}

void RegularTriangulation::glue(Index face, Index other) {
  cells_[slot(face >> 2)].neighbor[slot(face & 3)] = other;
  cells_[slot(other >> 2)].neighbor[slot(other & 3)] = face;
}

// Small holes: gift wrapping

void RegularTriangulation::wrap_hole() {
  const Index infinite = static_cast<Index>(cavity_vertices_.size());
  link_.clear();
  for (const Index u : cavity_vertices_) link_.push_back(point(u));
  while (!open_facets_.empty()) {
    HoleFacet facet = open_facets_.back();
    open_facets_.pop_back();
    const Index apex = apex_of(facet);
    std::array<Index, 4>& corner = facet.vertex;
    corner[slot(facet.slot)] = apex;
    if (apex == infinite && facet.slot != 3) {
      // The ghost vertex goes last; a second exchange keeps the orientation.
      std::swap(corner[slot(facet.slot)], corner[3]);
      std::swap(corner[slot((facet.slot + 1) % 3)], corner[slot((facet.slot + 2) % 3)]);
      facet.slot = 3;
    }
    const Index c = add_hole_cell(corner);
    glue(4 * c + facet.slot, facet.outside);
    for (int k = 0; k < 4; ++k) {
      if (k != facet.slot) meet_face(corner, c, k);
    }
  }
  AMPS_ASSERT(open_ghost_facets_.empty());
}

/// The link vertex that completes the facet to a cell of the triangulation, the infinite one if none lies in front of it.
Index RegularTriangulation::apex_of(const HoleFacet& facet) const {
  // One pass is enough: spheres through the facet are ordered by how far they reach beyond it, and a vertex in conflict with
  // the best cell so far belongs to a sphere that reaches less far.
  const WeightedPoint* corner[4];
  for (std::size_t k = 0; k < 4; ++k) corner[k] = facet.vertex[k] == kNone ? nullptr : &link_[slot(facet.vertex[k])];
  const WeightedPoint*& apex = corner[facet.slot];
  const int* face = kFaceCorners[facet.slot];
  const WeightedPoint &a = *corner[face[0]], &b = *corner[face[1]], &c = *corner[face[2]];
  // orient3d(a, b, c, u) in the order that spares work for many u; its static bound covers this order too (a monomial passes
  // through 4 roundings in the normal, 1 in the difference, 1 in the product, 2 in the sums).
  const Vec3 normal = (b.position() - a.position()).cross(c.position() - a.position());
  Index best = static_cast<Index>(link_.size());
  for (Index u = 0; u < static_cast<Index>(link_.size()); ++u) {
    const WeightedPoint& p = link_[slot(u)];
    const double height = normal.x() * (p.x - a.x) + normal.y() * (p.y - a.y) + normal.z() * (p.z - a.z);
    if (height > bounds_.orientation) continue;  // seen from outside the cell-to-be, counter-clockwise: behind
    if (u == facet.key[0] || u == facet.key[1] || u == facet.key[2]) continue;
    if (!(-height > bounds_.orientation) && orient3d(a, b, c, p, bounds_) >= 0) continue;
    if (best < static_cast<Index>(link_.size())) {
      apex = &link_[slot(best)];
      if (power_test(*corner[0], *corner[1], *corner[2], *corner[3], p, bounds_) < 0) continue;
    }
    best = u;
  }
  return best;
}

/// A face of a new cell: glued to the open facet it closes, or open itself.
void RegularTriangulation::meet_face(const std::array<Index, 4>& corner, Index c, int k) {
  HoleFacet facet{corner, {}, k, 4 * c + k};
  facet.vertex[slot(k)] = kNone;
  facet.set_key();
  const bool ghost = k != 3 && corner[3] == static_cast<Index>(link_.size());
  auto& open = ghost ? open_ghost_facets_ : open_facets_;
  for (std::size_t n = open.size(); n-- > 0;) {
    if (open[n].key != facet.key) continue;
    glue(facet.outside, open[n].outside);
    open[n] = open.back();
    open.pop_back();
    return;
  }
  // Seen from beyond the face, the other corners turn the other way.
  int a = 0;
  while (a == k) ++a;
  int b = a + 1;
  while (b == k) ++b;
  std::swap(facet.vertex[slot(a)], facet.vertex[slot(b)]);
  open.push_back(facet);
}

// Large holes: the triangulation of the link

/// Fills the hole that v has left with those cells of its link's triangulation that v is in conflict with: they are the ones it
/// would destroy there, and its star is the same there and here. False, and nothing has changed, if the link lies in a plane.
bool RegularTriangulation::fill_hole_from_link(Index v) {
  const std::size_t count = cavity_vertices_.size();
  std::vector<Vec3> positions(count);
  std::vector<double> weights(count);
  for (std::size_t k = 0; k < count; ++k) {
    const WeightedPoint& p = point(cavity_vertices_[k]);
    positions[k] = p.position();
    weights[k] = p.w;
  }
  RegularTriangulation link;
  const ValuesView link_weights(weights);
  link.append_points(positions, &link_weights);
  link.bulk_insert(0, {});
  if (link.dimension() < 3) return false;
  const WeightedPoint q = point(v);
  const ValuesView weight(&q.w, 1);
  link.append_points({&q.x, 1}, &weight);  // for its bounds only
  link.dig_cavity(link.walk(q, link.last_cell_, link.bounds_), q);

  std::vector<Index> copy(link.cells_.size(), kNone);
  for (const Index c : link.work_.conflict) {
    std::array<Index, 4> corner = link.cell(c).vertex;
    if (corner[3] == kInfinite) corner[3] = static_cast<Index>(count);
    copy[slot(c)] = add_hole_cell(corner);
  }
  for (const Index c : link.work_.conflict) {
    for (std::size_t f = 0; f < 4; ++f) {
      const Index beyond = link.cell(c).neighbor[f];
      if (copy[slot(beyond >> 2)] == kNone) continue;
      cells_[slot(copy[slot(c)])].neighbor[f] = 4 * copy[slot(beyond >> 2)] + (beyond & 3);
    }
  }
  // The two borders, sorted alike.
  std::vector<HoleFacet> mine = open_facets_, theirs;
  mine.insert(mine.end(), open_ghost_facets_.begin(), open_ghost_facets_.end());
  for (const BoundaryFacet& border : link.work_.boundary) {
    HoleFacet facet{
        link.cell(border.inside >> 2).vertex, {}, border.inside & 3, 4 * copy[slot(border.inside >> 2)] + (border.inside & 3)};
    if (facet.vertex[3] == kInfinite) facet.vertex[3] = static_cast<Index>(count);
    facet.set_key();
    theirs.push_back(facet);
  }
  const auto by_key = [](const HoleFacet& a, const HoleFacet& b) { return a.key < b.key; };
  std::sort(mine.begin(), mine.end(), by_key);
  std::sort(theirs.begin(), theirs.end(), by_key);
  AMPS_ASSERT(mine.size() == theirs.size());
  for (std::size_t k = 0; k < mine.size(); ++k) {
    AMPS_ASSERT(mine[k].key == theirs[k].key);
    glue(mine[k].outside, theirs[k].outside);
  }
  return true;
}

}  // namespace amps
