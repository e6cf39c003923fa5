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
  wrap_hole();
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
  bounds_ = detail::StaticBounds::for_set(box_max_ - box_min_, weight_max_ - weight_min_, scale_.unit());
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

/// The vertices that are left lie in a plane: no cells, and every point waits. Points that were hidden may reach out of the plane:
/// then all start over.
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

// ---------------------------------------------------------------------------------------------------------------------------
// The hole

/// Frees the star of v; its border becomes the open facets, its corners the link, and hidden points in it wait in uncovered_.
void RegularTriangulation::open_hole(Index v) {
  std::vector<Index>& star = work_.conflict;
  incident_cells(v, star);
  open_facets_.clear();
  open_ghost_facets_.clear();
  uncovered_.clear();
  cavity_vertices_.clear();
  const std::uint32_t stamp = next_stamp(work_);
  for (const Index c : star) {
    const Cell& here = cells_[slot(c)];
    HoleFacet facet{here.vertex, 0, 0};
    for (int k = 0; k < 4; ++k) {
      const Index u = here.vertex[slot(k)];
      if (u == v) {
        facet.slot = k;
        facet.outside = here.neighbor[slot(k)];
      } else if (u != kInfinite && work_.local[slot(u + 2)] != stamp) {
        cavity_vertices_.push_back(u);
        work_.local[slot(u + 2)] = stamp;
      }
    }
    facet.vertex[slot(facet.slot)] = kNone;
    (here.ghost() ? open_ghost_facets_ : open_facets_).push_back(facet);
  }
  for (const Index c : star) {
    if (!hidden_head_.empty()) {
      for (Index u = hidden_head_[slot(c)]; u != kNone; u = hidden_next_[slot(u)]) uncovered_.push_back(u);
      hidden_head_[slot(c)] = kNone;
    }
    Cell& dead = cells_[slot(c)];
    --(dead.ghost() ? num_ghosts_ : num_finite_);
    dead.vertex[0] = kNone;
    work_.free_cells.push_back(c);
  }
  for (const Index u : uncovered_) vertex_cell_[slot(u)] = kNone;
}

/// The link vertex that completes the facet to a cell of the triangulation, kInfinite if none lies in front of it.
Index RegularTriangulation::apex_of(const HoleFacet& facet) const {
  // One pass is enough: spheres through the facet are ordered by how far they reach beyond it, and a vertex in conflict with
  // the best cell so far belongs to a sphere that reaches less far.
  const WeightedPoint* corner[4];
  for (std::size_t k = 0; k < 4; ++k) corner[k] = facet.vertex[k] == kNone ? nullptr : &point(facet.vertex[k]);
  const WeightedPoint*& apex = corner[facet.slot];
  Index best = kInfinite;
  for (const Index u : cavity_vertices_) {
    if (std::find(facet.vertex.begin(), facet.vertex.end(), u) != facet.vertex.end()) continue;
    apex = &point(u);
    if (orient3d(*corner[0], *corner[1], *corner[2], *corner[3], bounds_) <= 0) continue;
    if (best != kInfinite) {
      apex = &point(best);
      if (power_test(*corner[0], *corner[1], *corner[2], *corner[3], point(u), bounds_) < 0) continue;
    }
    best = u;
  }
  return best;
}

void RegularTriangulation::wrap_hole() {
  while (!open_facets_.empty()) {
    HoleFacet facet = open_facets_.back();
    open_facets_.pop_back();
    const Index apex = apex_of(facet);
    std::array<Index, 4>& corner = facet.vertex;
    corner[slot(facet.slot)] = apex;
    if (apex == kInfinite && facet.slot != 3) {
      // The ghost vertex goes last; a second exchange keeps the orientation.
      std::swap(corner[slot(facet.slot)], corner[3]);
      std::swap(corner[slot((facet.slot + 1) % 3)], corner[slot((facet.slot + 2) % 3)]);
      facet.slot = 3;
    }
    const Index c = allocate_cell(work_);
    cells_[slot(c)].vertex = corner;
    ++(apex == kInfinite ? num_ghosts_ : num_finite_);
    for (const Index u : corner) {
      if (u != kInfinite) vertex_cell_[slot(u)] = c;
    }
    glue(4 * c + facet.slot, facet.outside);
    for (int k = 0; k < 4; ++k) {
      if (k != facet.slot) meet_face(c, k);
    }
    last_cell_ = c;
  }
  AMPS_ASSERT(open_ghost_facets_.empty());
}

void RegularTriangulation::glue(Index face, Index other) {
  cells_[slot(face >> 2)].neighbor[slot(face & 3)] = other;
  cells_[slot(other >> 2)].neighbor[slot(other & 3)] = face;
}

/// A face of a new cell: glued to the open facet it closes, or open itself.
void RegularTriangulation::meet_face(Index c, int k) {
  HoleFacet facet{cells_[slot(c)].vertex, k, 4 * c + k};
  facet.vertex[slot(k)] = kNone;
  auto& open = k != 3 && facet.vertex[3] == kInfinite ? open_ghost_facets_ : open_facets_;
  const auto has = [](const HoleFacet& f, Index u) { return std::find(f.vertex.begin(), f.vertex.end(), u) != f.vertex.end(); };
  const auto closes = [&](const HoleFacet& other) {
    for (const Index u : facet.vertex) {
      if (!has(other, u)) return false;
    }
    return true;
  };
  const auto found = std::find_if(open.rbegin(), open.rend(), closes);
  if (found != open.rend()) {
    glue(facet.outside, found->outside);
    *found = open.back();
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

}  // namespace amps
