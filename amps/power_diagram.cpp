#define AMPS_OWN_SOURCE
#include "amps/power_diagram.h"

#include "amps/mesh_edges.h"
#include "amps/power_diagram_clipper.h"
#include "amps/thread_pool.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace amps {

using detail::slot;

Vec3 RestrictedPowerDiagram::Corners::operator[](std::ptrdiff_t k) const {
  return places_[k].position(detail::FacetCorners(*mesh_, facet_).at);
}

void RestrictedPowerDiagram::Polygon::list_corners(std::vector<Vec3>& positions) const {
  positions.resize(detail::slot(size));
  if (size == 0) return;
  const detail::FacetCorners facet_corners(corners.mesh(), facet);
  for (std::size_t k = 0; k < positions.size(); ++k) positions[k] = corners.places()[k].position(facet_corners.at);
}

double RestrictedPowerDiagram::Polygon::area() const {
  if (size == 0) return 0;
  const detail::FacetCorners facet_corners(corners.mesh(), facet);
  const Vec3 first = corners.places()[0].position(facet_corners.at);
  Vec3 sum = Vec3::Zero(), before = Vec3::Zero();
  for (Index k = 1; k < size; ++k) {
    const Vec3 now = corners.places()[k].position(facet_corners.at) - first;
    sum += before.cross(now);
    before = now;
  }
  return 0.5 * detail::stable_norm(sum);  // areas of 1e±200 have squares out of range
}

// Construction

/// Fragments of a run of facets, before they are put together. Their polygons stay where they are.
class RestrictedPowerDiagram::Batch {
 public:
  struct Entry {
    Index facet;
    Index owner;  ///< the site; once fragments are numbered, the number of this one
    Index size;
    Index room;  ///< in `polygons`, and later in those of the diagram
    detail::PackedBall ball;
  };
  /// Memory of the entries of all batches in one piece: given back as that, it serves what follows.
  struct Arena {
    std::vector<Entry, detail::UninitializedAllocator<Entry>> entries;
    std::atomic<std::size_t> used{0};
    /// Not touched where it is not used.
    explicit Arena(double expected) : entries(static_cast<std::size_t>(kMost * expected)) {}
    static constexpr double kMost = 1.25;
  };
  struct Entries {
    Entry *first = nullptr, *last = nullptr;
    Entry* begin() const { return first; }
    Entry* end() const { return last; }
    std::size_t size() const { return static_cast<std::size_t>(last - first); }
  };

  Entries entries;  ///< once all are there
  detail::PolygonPages polygons;
  detail::WorkCounter* done = nullptr;
  std::size_t told = 0;  ///< entries that have been added to it

  /// What add() has listed is all.
  void finish(std::vector<Entry>& listed, Arena& arena) {
    const std::size_t at = arena.used.fetch_add(listed.size(), std::memory_order_relaxed), room = arena.entries.size();
    if (at <= room && listed.size() <= room - at) {
      entries.first = arena.entries.data() + at;
      entries.last = std::copy(listed.begin(), listed.end(), entries.first);
    } else {
      own.assign(listed.begin(), listed.end());
      entries = {own.data(), own.data() + own.size()};
    }
    listed.clear();
  }

  void add(Index facet, Index site, const Clipper& clipper, std::vector<Entry>& listed) {
    constexpr std::size_t kFragmentsPerLook = 512;
    if (listed.size() - told >= kFragmentsPerLook) {
      done->add(listed.size() - told);
      told = listed.size();
    }
    const Index size = clipper.size(), room = polygons.allocate(room_for(size));
    fill_room(polygons, room, clipper.corners(), clipper.labels().begin(), size);
    listed.push_back({facet, site, size, room, clipper.ball()});
  }

 private:
  std::vector<Entry> own;  ///< where the arena has no room
};

/// What finding the fragments of a facet needs.
struct RestrictedPowerDiagram::FloodScratch {
  Clipper clipper;
  std::vector<Index> queue;      ///< sites found in the current facet
  std::vector<Index> last_seen;  ///< by site: the facet it was last queued in

  Index near = 0;                     ///< a site where a search may begin
  std::vector<Batch::Entry> entries;  ///< memory of the batch at work

  explicit FloodScratch(const RestrictedPowerDiagram& diagram) : clipper(diagram), last_seen(slot(diagram.num_sites()), kNone) {
    clipper.remember_crossings();
    while (!diagram.visible(near)) ++near;
  }
};

/// Fragments of a site: from its first one up to, not including, its end.
struct RestrictedPowerDiagram::SiteOrder {
  std::vector<Index> first, end;
};

/// By site: cells of the triangulation that it is a corner of.
struct RestrictedPowerDiagram::CellsOfSites {
  std::vector<std::size_t> start;  ///< of a site's ones in `cells`; one entry more than sites
  std::vector<Index, detail::UninitializedAllocator<Index>> cells;
};

RestrictedPowerDiagram::RestrictedPowerDiagram(const MeshView& mesh, const PointsView& sites, const ValuesView& weights,
                                               const Execution& execution)
    : RestrictedPowerDiagram(mesh, sites, weights, nullptr, execution) {}

RestrictedPowerDiagram::RestrictedPowerDiagram(const MeshView& mesh, const PointsView& sites, const ValuesView& weights,
                                               const detail::ReachLists* reach, const Execution& execution)
    : mesh_(mesh), reach_lists_(reach) {
  const Execution run = execution.start();
  require_usable(mesh);
  if (sites.rows() == 0) throw Error(ErrorCode::kInvalidArgument, "restricted power diagram: no sites; give at least one");
  const detail::DiagramCosts costs(mesh.num_facets(), static_cast<double>(sites.rows()), run.workers());
  const double share = costs.triangulation / costs.all();
  detail::Stopwatch watch;
  const bool complete = detail::completes([&] {
    triangulate(sites, weights, run.part(0, share, "triangulating samples"));
    seconds_triangulation_ = watch.lap();
    const Execution dividing = run.part(share, 1, "dividing the surface");
    const auto num_sites = static_cast<std::size_t>(sites.rows());
    first_of_site_.reserve(detail::room_for_more(num_sites));
    first_of_site_.assign(num_sites, kNone);
    first_of_facet_.assign(slot(mesh_.num_facets()), kNone);
    measure_facets(dividing.part(0, 0.05));
    build(dividing.part(0.05, reach_lists_ == nullptr ? 1 : 0.9));
    if (reach_lists_ != nullptr) find_local_facets(dividing.part(0.9, 1));
  });
  if (complete) {
    run.finish();
  } else {
    clear();
  }
}

/// As a cancelled constructor leaves it.
void RestrictedPowerDiagram::clear() {
  triangulation_ = RegularTriangulation();
  fragments_ = {};
  polygons_ = detail::PolygonPages();
  first_of_site_ = first_of_facet_ = {};
  facet_error_ = reach_ = {};
  local_ = {};
  local_sites_ = {};
  site_tree_ = {};
  num_fragments_ = num_guards_ = 0;
  status_ = Outcome::kCancelled;
}

/// A regular tetrahedron whose corners are 4 diagonals from the centre of the box. At any point of the box its corners have
/// power at least 12 diagonals² − w, and a site in the box that is not lighter at most 1 diagonal² − w: while there is such a
/// guard, no sentinel owns anything on the mesh.
std::array<WeightedPoint, RestrictedPowerDiagram::kSentinels> RestrictedPowerDiagram::sentinels() const {
  const double reach = 4 * detail::norm(high_ - low_) / std::sqrt(3.0);
  const Vec3 centre = low_ + (high_ - low_) / 2;
  const double sign[kSentinels][3] = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}};
  std::array<WeightedPoint, kSentinels> result{};
  for (std::size_t k = 0; k < kSentinels; ++k) {
    const Vec3 x = centre + reach * Vec3(sign[k][0], sign[k][1], sign[k][2]);
    result[k] = {x.x(), x.y(), x.z(), min_weight_};
  }
  return result;
}

void RestrictedPowerDiagram::triangulate(const PointsView& sites, const ValuesView& weights, const Execution& execution) {
  if (weights.size() != sites.rows()) {
    throw Error(ErrorCode::kInvalidArgument, "restricted power diagram: " + std::to_string(sites.rows()) + " sites with " +
                                                 std::to_string(weights.size()) + " weights; give one weight a site");
  }
  const Box box = bounding_box(mesh_);
  Vec3 low = box.min, high = box.max;
  const auto n = static_cast<std::size_t>(sites.rows());
  std::vector<Vec3> positions(kSentinels + n);
  std::vector<double> all_weights(kSentinels + n);
  min_weight_ = INFINITY;
  detail::for_each_piece(n, detail::kElementsPerLook, execution.part(0, 0.03), [&](std::size_t begin, std::size_t end) {
    for (auto s = static_cast<std::ptrdiff_t>(begin); s < static_cast<std::ptrdiff_t>(end); ++s) {
      const Vec3 x = sites[s];
      if (!x.allFinite() || !std::isfinite(weights[s])) {
        throw Error(ErrorCode::kInvalidArgument, "restricted power diagram: site " + std::to_string(s) +
                                                     " is not finite (NaN or infinity); remove or repair it");
      }
      low = low.cwiseMin(x);
      high = high.cwiseMax(x);
      min_weight_ = std::min(min_weight_, weights[s]);
      positions[static_cast<std::size_t>(kSentinels + s)] = x;
      all_weights[static_cast<std::size_t>(kSentinels + s)] = weights[s];
    }
  });
  low_ = low;
  high_ = high;
  num_guards_ = static_cast<Index>(n);
  std::size_t k = 0;
  for (const WeightedPoint& sentinel : sentinels()) {
    positions[k] = sentinel.position();
    all_weights[k++] = sentinel.w;
  }
  triangulation_.reserve(kSentinels + detail::room_for_more(n));
  triangulation_.insert(positions, all_weights, execution.part(0.03, 1));
}

namespace {

/// Of loops that take 100 ns a facet.
constexpr std::size_t kFacetsPerPiece = 4096;

}  // namespace

/// Bounds of the error of computed corners per facet; −1 for facets without fragments: those without area, and second copies.
void RestrictedPowerDiagram::measure_facets(const Execution& execution) {
  facet_error_.assign(slot(mesh_.num_facets()), 0);
  for (const Index facet : detail::find_repeated_facets(mesh_, execution.part(0, 0.4))) facet_error_[slot(facet)] = -1;
  std::vector<double> largest_of_piece((facet_error_.size() + kFacetsPerPiece - 1) / kFacetsPerPiece, 0.0);
  const auto measure = [&](std::size_t begin, std::size_t end) {
    double& largest_error = largest_of_piece[begin / kFacetsPerPiece];
    for (Index facet = static_cast<Index>(begin); facet < static_cast<Index>(end); ++facet) {
      if (facet_error_[slot(facet)] < 0) continue;
      double longest = 0, largest = 0;
      for (int c = 0; c < 3; ++c) {
        const Vec3 corner = mesh_.corner(facet, c);
        longest = std::max(longest, detail::squared_norm(corner - mesh_.corner(facet, (c + 1) % 3)));
        largest = std::max(largest, corner.cwiseAbs().maxCoeff());
      }
      const Vec3 a = mesh_.corner(facet, 0), b = mesh_.corner(facet, 1), c = mesh_.corner(facet, 2);
      facet_error_[slot(facet)] = collinear(a.data(), b.data(), c.data())
                                      ? -1.0
                                      : detail::kPositionError * std::sqrt(longest) + detail::kPositionRounding * largest;
      largest_error = std::max(largest_error, facet_error_[slot(facet)]);
    }
  };
  detail::for_each_piece_on_all_threads(facet_error_.size(), kFacetsPerPiece, execution.part(0.4, 1), measure);
  for (const double error : largest_of_piece) largest_facet_error_ = std::max(largest_facet_error_, error);
}

RestrictedPowerDiagram::Plane RestrictedPowerDiagram::plane(Index owner, Index other) const {
  const WeightedPoint &p = site(owner), &q = site(other);
  const double d2 = detail::squared_norm(q.position() - p.position());
  const double dw = p.w - q.w;
  return {((d2 + dw) - detail::kOffsetSlack * (d2 + std::fabs(dw))) / (2 * std::sqrt(d2)), other};
}

/// Each thread counts, and then lists, what a part of the cells has: lists are in the order of cells, however many parts.
RestrictedPowerDiagram::CellsOfSites RestrictedPowerDiagram::cells_of_sites(const Execution& execution) const {
  using detail::for_each_piece;
  using detail::kElementsPerLook;
  constexpr std::size_t kMostParts = 16;  // each has a number a site
  const std::size_t n = slot(num_sites()), num_cells = slot(triangulation_.cell_capacity());
  const std::size_t cells_per_part = num_cells / std::min<std::size_t>(execution.workers(), kMostParts) + 1;
  std::vector<std::vector<Index>> parts((num_cells + cells_per_part - 1) / cells_per_part);
  // visit(part, site, cell) for the corners of living cells.
  const auto visit_corners = [&](const Execution& part, const auto& visit) {
    parallel_for(num_cells, cells_per_part, part, [&](std::size_t first, std::size_t last) {
      std::vector<Index>& of_part = parts[first / cells_per_part];
      of_part.resize(n, 0);
      for_each_piece(last - first, kElementsPerLook, part, [&](std::size_t begin, std::size_t end) {
        for (std::size_t c = first + begin; c < first + end; ++c) {
          const RegularTriangulation::Cell& cell = triangulation_.cell(static_cast<Index>(c));
          if (!cell.alive()) continue;
          for (const Index v : cell.vertex) {
            if (v >= kSentinels) visit(of_part, slot(v - kSentinels), static_cast<Index>(c));
          }
        }
      });
    });
  };
  visit_corners(execution.part(0, 0.3), [](std::vector<Index>& count, std::size_t s, Index) { ++count[s]; });
  CellsOfSites result;
  result.start.resize(n + 1);
  result.start[0] = 0;
  for_each_piece(n, kElementsPerLook, execution.part(0.3, 0.4), [&](std::size_t begin, std::size_t end) {
    for (std::size_t s = begin; s < end; ++s) {
      Index before = 0;
      for (std::vector<Index>& part : parts) before += std::exchange(part[s], before);
      result.start[s + 1] = result.start[s] + slot(before);
    }
  });
  result.cells.resize(result.start.back());
  visit_corners(execution.part(0.4, 1),
                [&](std::vector<Index>& next, std::size_t s, Index c) { result.cells[result.start[s] + slot(next[s]++)] = c; });
  return result;
}

RestrictedPowerDiagram::PlaneTable RestrictedPowerDiagram::all_planes(const Execution& execution) const {
  const CellsOfSites around = cells_of_sites(execution.part(0, 0.4));
  const std::size_t n = slot(num_sites());
  PlaneTable table;
  table.of_site.resize(n);
  std::size_t room = 0;
  for (std::size_t s = 0; s < n; ++s) {
    table.of_site[s] = {room, 0};
    // The cells at a vertex meet a small sphere around it in triangles: by Euler, they have half as many corners, and two.
    const std::size_t count = around.start[s + 1] - around.start[s];
    if (count > 0) room += count / 2 + 2;
  }
  table.planes.resize(room);
  constexpr std::size_t kSitesPerPiece = 2048, kCellsAhead = 12;
  detail::ScratchPool<std::vector<Index>> pool;
  detail::for_each_piece_on_all_threads(n, kSitesPerPiece, execution.part(0.4, 1), [&](std::size_t begin, std::size_t end) {
    const auto scratch = pool.lend([n] { return std::make_unique<std::vector<Index>>(n, kNone); });
    Index* const last_seen = scratch->data();
    const Index* const cells = around.cells.data();
    const std::size_t num_listed = around.cells.size();
    for (std::size_t at = begin; at < end; ++at) {
      const Index s = static_cast<Index>(at);
      last_seen[at] = s;
      Plane* const first = table.planes.data() + table.of_site[at].first;
      Plane* last = first;
      for (std::size_t k = around.start[at], stop = around.start[at + 1]; k < stop; ++k) {
        if (k + kCellsAhead < num_listed) detail::prefetch(&triangulation_.cell(cells[k + kCellsAhead]));
        for (const Index v : triangulation_.cell(cells[k]).vertex) {
          if (v < kSentinels || last_seen[v - kSentinels] == s) continue;
          last_seen[v - kSentinels] = s;
          detail::prefetch(&triangulation_.point(v));
          (last++)->site = v - kSentinels;
        }
      }
      for (Plane* at_plane = first; at_plane != last; ++at_plane) *at_plane = plane(s, at_plane->site);
      std::sort(first, last, detail::NearerPlane());
      table.of_site[at].count = static_cast<Index>(last - first);
    }
  });
  return table;
}

void RestrictedPowerDiagram::build(const Execution& execution) {
  const std::size_t num_facets = slot(mesh_.num_facets());
  const double fragments = detail::expected_fragments(static_cast<double>(num_facets), static_cast<double>(num_sites()));
  // So many that threads end at about the same time. Batches are put together in their order.
  constexpr double kFragmentsPerBatch = 4096;
  const auto facets_per_batch = static_cast<std::size_t>(
      std::min(std::max(1.0, static_cast<double>(num_facets) * kFragmentsPerBatch / fragments), kFragmentsPerBatch));
  Batch::Arena arena(fragments);
  std::vector<Batch> batches((num_facets + facets_per_batch - 1) / facets_per_batch);
  {
    const PlaneTable planes = all_planes(execution.part(0, 0.2));
    const Execution clipping = execution.part(0.2, 0.85);
    CornerOwners owner(slot(mesh_.num_vertices()));
    for (std::atomic<Index>& unknown : owner) unknown.store(kNone, std::memory_order_relaxed);
    detail::WorkCounter done(clipping, static_cast<std::uint64_t>(fragments));
    detail::ScratchPool<FloodScratch> pool;
    parallel_for(num_facets, facets_per_batch, clipping, [&](std::size_t begin, std::size_t end) {
      const auto scratch = pool.lend([this] { return std::make_unique<FloodScratch>(*this); });
      Batch& batch = batches[begin / facets_per_batch];
      batch.done = &done;
      clip_facets(begin, end, owner, planes, *scratch, batch);
      batch.finish(scratch->entries, arena);
    });
  }
  assemble(batches, execution.part(0.85, 1));
}

void RestrictedPowerDiagram::clip_facets(std::size_t begin, std::size_t end, CornerOwners& owner, const PlaneTable& planes,
                                         FloodScratch& scratch, Batch& batch) const {
  for (std::size_t f = begin; f < end; ++f) {
    if (facet_error_[f] < 0) continue;
    const Index facet = static_cast<Index>(f);
    scratch.clipper.set_facet(facet);
    const std::array<Index, 3> owners = corner_owners(facet, owner, planes, scratch.near);
    if (owners[0] == owners[1] && owners[0] == owners[2]) {
      scratch.clipper.start(owners[0]);  // power cells are convex: the whole facet lies in this one
      batch.add(facet, owners[0], scratch.clipper, scratch.entries);
    } else {
      flood_facet(facet, owners[0], planes, scratch, batch);
    }
  }
}

/// The owners of a facet's corners, found by walking from the last one over ever nearer neighbours if they are not known.
/// Threads may find the same one at the same time.
std::array<Index, 3> RestrictedPowerDiagram::corner_owners(Index facet, CornerOwners& owner, const PlaneTable& planes,
                                                           Index& near) const {
  std::array<Index, 3> result{};
  for (int c = 0; c < 3; ++c) {
    const Index known = owner[slot(mesh_.triangles(facet, c))].load(std::memory_order_relaxed);
    result[slot(c)] = known;
    if (known != kNone) near = known;
  }
  for (int c = 0; c < 3; ++c) {
    if (result[slot(c)] != kNone) continue;
    result[slot(c)] = near = owner_from(near, mesh_.corner(facet, c), planes);
    owner[slot(mesh_.triangles(facet, c))].store(near, std::memory_order_relaxed);
  }
  return result;
}

/// Puts the fragments of all facets together. Polygons stay in the order of facets, but the records of each site's fragments
/// lie side by side, sites in the order in which facets meet them: local updates look through all fragments of a few sites, and
/// would otherwise spend their time on cache misses.
void RestrictedPowerDiagram::assemble(std::vector<Batch>& batches, const Execution& execution) {
  const SiteOrder order = number_fragments(batches, execution.part(0, 0.3));
  const std::size_t num_fragments = slot(num_fragments_);
  fragments_.reserve(detail::room_for_more(num_fragments));
  fragments_.resize(num_fragments);
  detail::for_each_piece_on_all_threads(batches.size(), 1, execution.part(0.3, 0.9), [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) make_records(batches[k]);
  });
  reach_.reserve(detail::room_for_more(slot(num_sites())));
  reach_.resize(slot(num_sites()));
  constexpr std::size_t kSitesPerPiece = 4096;
  detail::for_each_piece_on_all_threads(reach_.size(), kSitesPerPiece, execution.part(0.9, 1),
                                        [&](std::size_t begin, std::size_t end) {
                                          for (Index s = static_cast<Index>(begin); s < static_cast<Index>(end); ++s) {
                                            const Index first = order.first[slot(s)], last = order.end[slot(s)];
                                            for (Index f = first; f < last; ++f) {
                                              Fragment& fragment = fragments_[slot(f)];
                                              fragment.site = s;
                                              if (f + 1 < last) fragment.next_of_site = f + 1;
                                            }
                                            update_reach(s);
                                          }
                                        });
}

/// Takes over the polygons of all batches, and gives each fragment its number.
RestrictedPowerDiagram::SiteOrder RestrictedPowerDiagram::number_fragments(std::vector<Batch>& batches,
                                                                           const Execution& execution) {
  std::size_t num_entries = 0;
  for (const Batch& batch : batches) num_entries += batch.entries.size();
  SiteOrder order;
  order.first.assign(slot(num_sites()), 0);
  order.end.assign(slot(num_sites()), 0);
  std::vector<Index> met;  // sites, as facets meet them
  met.reserve(order.end.size());
  detail::Ticker ticker(execution, 2 * num_entries, detail::kElementsPerLook);
  for (const Batch& batch : batches) {
    for (const Batch::Entry& entry : batch.entries) {
      if (order.end[slot(entry.owner)]++ == 0) met.push_back(entry.owner);
    }
    ticker.tick(batch.entries.size());
  }
  for (const Index s : met) {
    first_of_site_[slot(s)] = order.first[slot(s)] = num_fragments_;
    num_fragments_ += std::exchange(order.end[slot(s)], num_fragments_);
  }
  for (Batch& batch : batches) {
    const Index added = polygons_.adopt(std::move(batch.polygons));
    for (Batch::Entry& entry : batch.entries) {
      entry.room += added;
      entry.owner = order.end[slot(entry.owner)]++;
    }
    ticker.tick(batch.entries.size());
  }
  return order;
}

/// The records of a batch's fragments but for what their sites say, and the lists of its facets. Lists run forwards.
void RestrictedPowerDiagram::make_records(const Batch& batch) {
  std::vector<Index> in_facet;
  for (auto entry = batch.entries.begin(); entry != batch.entries.end();) {
    const Index facet = entry->facet;
    in_facet.clear();
    for (; entry != batch.entries.end() && entry->facet == facet; ++entry) {
      const Index f = entry->owner;
      Fragment fragment;
      fragment.facet = facet;
      fragment.room = entry->room;
      fragment.ball = entry->ball;
      fragment.ball.set_note(static_cast<std::uint32_t>(std::min(entry->size, kLargeSize)));
      fragments_[slot(f)] = fragment;
      in_facet.push_back(f);
    }
    std::sort(in_facet.begin(), in_facet.end());
    first_of_facet_[slot(facet)] = in_facet.front();
    for (std::size_t k = 1; k < in_facet.size(); ++k) {
      fragments_[slot(in_facet[k - 1])].next_of_facet = in_facet[k];
      fragments_[slot(in_facet[k])].previous_of_facet = in_facet[k - 1];
    }
  }
}

void RestrictedPowerDiagram::update_reach(Index s) {
  measure_reach(s, edit_);
  if (!visible(s)) reach_[slot(s)] = kNoCell;
}

/// The same of a site whose cell is known to be there, whatever is in the triangulation by now. Takes retired fragments off its
/// list.
void RestrictedPowerDiagram::measure_reach(Index s, EditRecord& edit) {
  double reach = 0;
  for (Index* link = &first_of_site_[slot(s)]; *link != kNone;) {
    const Index f = *link;
    if (alive(f)) {
      reach = std::max(reach, fragments_[slot(f)].ball.reach());
      link = &fragments_[slot(f)].next_of_site;
    } else {
      *link = fragments_[slot(f)].next_of_site;
      give_slot_back(f, edit);
    }
  }
  reach_[slot(s)] = reach * (1 + detail::kOffsetSlack) + largest_facet_error_;
}

double RestrictedPowerDiagram::reach(Index f) const {
  const Fragment& fragment = fragments_[slot(f)];
  if (fragment.site == kNone) return INFINITY;
  return fragment.ball.reach() * (1 + detail::kOffsetSlack) + largest_facet_error_;
}

/// The owner of x. There is one only, wherever the walk begins.
Index RestrictedPowerDiagram::owner_from(Index near, const Vec3& x, const PlaneTable& planes) const {
  const double* const corners[3] = {x.data(), x.data(), x.data()};
  for (bool moved = true; moved;) {
    moved = false;
    prefetch_sites(planes, near);
    const WeightedPoint& owner = site(near);
    const Vec3 position = owner.position(), relative = x - position;
    const double distance = detail::norm(relative) * (1 + detail::kOffsetSlack);
    // Bisectors beyond x leave it to the owner.
    for (const Plane *plane = planes.begin(near), *end = planes.end(near); plane != end && !(plane->offset > distance);
         ++plane) {
      const WeightedPoint& other = site(plane->site);
      int side = detail::RelativeFilter(position, owner.w, other, 0, distance).side(relative);
      if (side == 0) side = side_of_corner(corners, 0, Bisector(owner, other, corners));
      if (side > 0) continue;
      near = plane->site;
      moved = true;
      break;
    }
  }
  return near;
}

// A third of the time of building a diagram of 100,000 sites is waiting for what is far apart in memory.

void RestrictedPowerDiagram::prefetch_planes(const PlaneTable& planes, Index s) const {
  constexpr std::ptrdiff_t kPlanesPerLine = 4;
  const Plane* const first = planes.begin(s);
  for (int line = 0; line < 3; ++line) detail::prefetch(first + line * kPlanesPerLine);
  detail::prefetch(&site(s));
}

void RestrictedPowerDiagram::prefetch_sites(const PlaneTable& planes, Index s) const {
  constexpr std::ptrdiff_t kMostSites = 10;
  const Plane *plane = planes.begin(s), *const end = plane + std::min(kMostSites, planes.end(s) - plane);
  for (; plane != end; ++plane) detail::prefetch(&site(plane->site));
}

void RestrictedPowerDiagram::flood_facet(Index facet, Index owner, const PlaneTable& planes, FloodScratch& scratch,
                                         Batch& batch) const {
  Clipper& clipper = scratch.clipper;
  std::vector<Index>&queue = scratch.queue, &last_seen = scratch.last_seen;
  queue.assign(1, owner);
  last_seen[slot(owner)] = facet;
  for (std::size_t k = 0; k < queue.size(); ++k) {
    const Index s = queue[k];
    prefetch_sites(planes, s);
    clipper.start(s);
    clipper.clip_all(planes.begin(s), planes.end(s));
    AMPS_ASSERT(!clipper.empty());
    batch.add(facet, s, clipper, scratch.entries);
    for (const Index label : clipper.labels()) {
      if (is_site(label) && last_seen[slot(label)] != facet) {
        last_seen[slot(label)] = facet;
        queue.push_back(label);
        prefetch_planes(planes, label);
      }
    }
  }
}

// Fragment store

/// Puts a fragment at the head of the list of its site.
void RestrictedPowerDiagram::link_to_site(Index f) {
  Fragment& fragment = fragments_[slot(f)];
  fragment.next_of_site = kNone;
  if (fragment.site == kNone) return;
  Index& of_site = first_of_site_[slot(fragment.site)];
  fragment.next_of_site = of_site;
  of_site = f;
}

void RestrictedPowerDiagram::link_in_facet(Index f) {
  Fragment& fragment = fragments_[slot(f)];
  Index& of_facet = first_of_facet_[slot(fragment.facet)];
  fragment.next_of_facet = of_facet;
  fragment.previous_of_facet = kNone;
  if (of_facet != kNone) fragments_[slot(of_facet)].previous_of_facet = f;
  of_facet = f;
}

void RestrictedPowerDiagram::unlink_in_facet(Index f) {
  const Fragment& fragment = fragments_[slot(f)];
  (fragment.previous_of_facet == kNone ? first_of_facet_[slot(fragment.facet)]
                                       : fragments_[slot(fragment.previous_of_facet)].next_of_facet) = fragment.next_of_facet;
  if (fragment.next_of_facet != kNone) fragments_[slot(fragment.next_of_facet)].previous_of_facet = fragment.previous_of_facet;
}

/// Writes a polygon into its room, of room_for(size).
void RestrictedPowerDiagram::fill_room(detail::PolygonPages& polygons, Index room, const detail::PackedBarycentric* corners,
                                       const Index* labels, Index size) {
  if (size >= kLargeSize) *polygons.labels(room++) = size;
  std::copy_n(corners, size, polygons.corners(room));
  std::copy_n(labels, size, polygons.labels(room));
}

void RestrictedPowerDiagram::store_polygon(Fragment& fragment, const Clipper& clipper, EditRecord& edit) {
  store_polygon(fragment, clipper.ball(), clipper.corners(), clipper.labels().begin(), clipper.size(), edit);
}

void RestrictedPowerDiagram::store_polygon(Fragment& fragment, const detail::PackedBall& ball,
                                           const detail::PackedBarycentric* corners, const Index* labels, Index size,
                                           EditRecord& edit) {
  const Index before = size_of(fragment);
  if (size != before) {
    std::unique_lock<std::mutex> lock;
    if (edit.pages != nullptr) {
      lock = std::unique_lock<std::mutex>(*edit.pages);
    } else {
      polygons_.let_list_go();
    }
    if (before != 0) {
      polygons_.release(fragment.room, room_for(before));
      fragment.ball.set_note(0);
    }
    fragment.room = polygons_.allocate(room_for(size));
  }
  fill_room(polygons_, fragment.room, corners, labels, size);
  fragment.ball = ball;
  fragment.ball.set_note(static_cast<std::uint32_t>(std::min(size, kLargeSize)));
}

Index RestrictedPowerDiagram::take_slot(EditRecord& edit) {
  std::vector<Index>& slots = edit.beside_others ? edit.slots : free_fragments_;
  AMPS_ASSERT(!edit.beside_others || !slots.empty());
  if (slots.empty()) {
    fragments_.push_back(Fragment());
    return fragment_capacity() - 1;
  }
  const Index f = slots.back();
  slots.pop_back();
  return f;
}

void RestrictedPowerDiagram::add_fragment(Index facet, Index site, const Clipper& clipper, EditRecord& edit) {
  add_fragment(facet, site, clipper.ball(), clipper.corners(), clipper.labels().begin(), clipper.size(), edit);
}

void RestrictedPowerDiagram::add_fragment(Index facet, Index site, const detail::PackedBall& ball,
                                          const detail::PackedBarycentric* corners, const Index* labels, Index size,
                                          EditRecord& edit) {
  const Index f = take_slot(edit);
  fragments_[slot(f)].facet = facet;
  fragments_[slot(f)].site = site;
  store_polygon(fragments_[slot(f)], ball, corners, labels, size, edit);
  link_to_site(f);
  if (edit.beside_others) {
    edit.facet_changes.push_back({f, true});
    ++edit.fragments_added;
  } else {
    link_in_facet(f);
    ++num_fragments_;
  }
  edit.changed.push_back(f);
  if (site != kNone) edit.changed_sites.push_back(site);
}

/// Frees a fragment but for its place in the list of its site, where measure_reach() of the site has to follow.
void RestrictedPowerDiagram::retire_fragment(Index f, EditRecord& edit) {
  Fragment& fragment = fragments_[slot(f)];
  const Index room = room_for(size_of(fragment));
  {
    std::unique_lock<std::mutex> lock;
    if (edit.pages != nullptr) lock = std::unique_lock<std::mutex>(*edit.pages);
    polygons_.release(fragment.room, room);
  }
  fragment.ball.set_note(0);
  if (edit.beside_others) {
    edit.facet_changes.push_back({f, false});
    --edit.fragments_added;
  } else {
    unlink_in_facet(f);
    --num_fragments_;
  }
}

/// In time proportional to its place in the list of its site.
void RestrictedPowerDiagram::free_fragment(Index f, EditRecord& edit) {
  const Fragment& fragment = fragments_[slot(f)];
  if (fragment.site != kNone) {
    Index* link = &first_of_site_[slot(fragment.site)];
    while (*link != f) link = &fragments_[slot(*link)].next_of_site;
    *link = fragment.next_of_site;
  }
  free_taken_fragment(f, edit);
}

/// One that is in the list of no site.
void RestrictedPowerDiagram::free_taken_fragment(Index f, EditRecord& edit) {
  retire_fragment(f, edit);
  give_slot_back(f, edit);
}

void RestrictedPowerDiagram::give_slot_back(Index f, EditRecord& edit) {
  (edit.beside_others ? edit.freed : free_fragments_).push_back(f);
}

/// Takes the fragments of s in local facets, or in the others, off its list; in the order that they had there.
std::vector<Index> RestrictedPowerDiagram::take_fragments(Index s, bool in_local_facets) {
  std::vector<Index> taken;
  for (Index* link = &first_of_site_[slot(s)]; *link != kNone;) {
    Fragment& fragment = fragments_[slot(*link)];
    if (local(fragment.facet) == in_local_facets) {
      taken.push_back(*link);
      *link = fragment.next_of_site;
    } else {
      link = &fragment.next_of_site;
    }
  }
  return taken;
}

void RestrictedPowerDiagram::compact(const Execution& execution) {
  if (2 * polygons_.unused() < polygons_.capacity()) return;
  const Execution run = execution.start("tidying memory");
  compact_polygons(&run);
}

/// Moves all polygons together.
void RestrictedPowerDiagram::compact_polygons(const Execution* execution) {
  constexpr std::size_t kFragmentsPerLook = 8192;
  detail::PolygonPages polygons;
  std::vector<Index> room(fragments_.size(), kNone);
  for (std::size_t f = 0; f < fragments_.size(); ++f) {
    if (execution != nullptr && f % kFragmentsPerLook == 0) execution->report(0);
    const Fragment& fragment = fragments_[f];
    if (fragment.ball.note() == 0) continue;
    const Index size = size_of(fragment), first = first_of(fragment);
    room[f] = polygons.allocate(room_for(size));
    fill_room(polygons, room[f], polygons_.corners(first), polygons_.labels(first), size);
  }
  for (std::size_t f = 0; f < fragments_.size(); ++f) fragments_[f].room = room[f];
  polygons_ = std::move(polygons);
}

int RestrictedPowerDiagram::power_at_corner(const Polygon& polygon, Index k) const {
  if (polygon.site == kNone) return 1;
  const detail::PowerFilter filter(site(polygon.site), facet_error_[slot(polygon.facet)]);
  const int side = filter.side(polygon.corners[k]);
  return side != 0 ? side : exact_power_at_corner(polygon, k);
}

bool RestrictedPowerDiagram::list_uncovered(const Polygon& polygon, const std::vector<Vec3>& corners,
                                            std::vector<char>& uncovered) const {
  uncovered.assign(slot(polygon.size), 1);
  if (polygon.site == kNone) return polygon.size > 0;
  const detail::PowerFilter filter(site(polygon.site), facet_error_[slot(polygon.facet)]);
  bool any = false;
  for (Index k = 0; k < polygon.size; ++k) {
    int side = filter.side(corners[slot(k)]);
    if (side == 0) side = exact_power_at_corner(polygon, k);
    uncovered[slot(k)] = side > 0;
    any = any || side > 0;
  }
  return any;
}

bool RestrictedPowerDiagram::covered(const Polygon& polygon) const {
  if (polygon.site == kNone) return false;
  const detail::PowerFilter filter(site(polygon.site), facet_error_[slot(polygon.facet)]);
  const detail::FacetCorners facet(mesh_, polygon.facet);
  for (Index k = 0; k < polygon.size; ++k) {
    int side = filter.side(polygon.corners.places()[k].position(facet.at));
    if (side == 0) side = exact_power_at_corner(polygon, k);
    if (side > 0) return false;
  }
  return true;
}

int RestrictedPowerDiagram::exact_power_at_corner(const Polygon& polygon, Index k) const {
  const Vec3 corner[3] = {mesh_.corner(polygon.facet, 0), mesh_.corner(polygon.facet, 1), mesh_.corner(polygon.facet, 2)};
  const double* const corners[3] = {corner[0].data(), corner[1].data(), corner[2].data()};
  const WeightedPoint& owner = site(polygon.site);
  const Index in = polygon.labels[k == 0 ? polygon.size - 1 : k - 1], out = polygon.labels[k];
  const auto bisector = [&](Index label) { return Bisector(owner, site(label), corners); };
  if (is_site(in) && is_site(out)) return power_at_facet_crossing(corners, bisector(in), bisector(out));
  if (!is_site(in) && !is_site(out)) return amps::power_at_corner(corners, mesh_edge(out), owner);
  const int e = mesh_edge(is_site(in) ? out : in);
  return power_at_edge_crossing(corners, e, (e + 1) % 3, bisector(is_site(in) ? in : out));
}

void RestrictedPowerDiagram::neighbors(Index s, std::vector<Index>& out) const {
  triangulation_.neighbors(s + kSentinels, out);
  std::size_t kept = 0;
  for (const Index v : out) {
    if (v >= kSentinels) out[kept++] = v - kSentinels;
  }
  out.resize(kept);
}

RegularTriangulation::Adjacency RestrictedPowerDiagram::adjacency(const Execution& execution) const {
  const Execution run = execution.start("listing neighbours");
  RegularTriangulation::Adjacency all = triangulation_.adjacency(run.part(0, 0.9)), result;
  result.offset.assign(1, 0);
  result.offset.reserve(slot(num_sites()) + 1);
  result.adjacent.reserve(all.adjacent.size());
  detail::for_each_piece(slot(num_sites()), detail::kElementsPerLook, run.part(0.9, 1),
                         [&](std::size_t begin, std::size_t end) {
                           for (std::size_t v = begin + kSentinels; v < end + kSentinels; ++v) {
                             for (Index k = all.offset[v]; k < all.offset[v + 1]; ++k) {
                               const Index u = all.adjacent[slot(k)];
                               if (u >= kSentinels) result.adjacent.push_back(u - kSentinels);
                             }
                             result.offset.push_back(static_cast<Index>(result.adjacent.size()));
                           }
                         });
  run.finish();
  return result;
}

// Dual, measures, proof

Triangles RestrictedPowerDiagram::dual_triangles(std::vector<Index>* facets, const Execution& execution) const {
  const Execution run = execution.start("listing triangles");
  struct Listed {
    std::vector<Index> corners, facets;
  };
  constexpr std::size_t kMostParts = 64;
  const std::size_t fragments_per_part = fragments_.size() / std::min<std::size_t>(run.workers(), kMostParts) + 1;
  std::vector<Listed> parts(fragments_.size() / fragments_per_part + 1);
  const auto list_part = [&](std::size_t first, std::size_t last) {
    Listed& listed = parts[first / fragments_per_part];
    listed.corners.reserve(6 * slot(num_sites()) / parts.size());  // 2 triangles a sample
    detail::for_each_piece(last - first, detail::kElementsPerLook, run, [&](std::size_t begin, std::size_t end) {
      for (Index f = static_cast<Index>(first + begin); f < static_cast<Index>(first + end); ++f) {
        const Polygon p = polygon(f);
        for (Index k = 0; k < p.size; ++k) {
          // Walking round the vertex counter-clockwise from the owner, the cell across the incoming edge comes first.
          const Index in = p.labels[k == 0 ? p.size - 1 : k - 1], out = p.labels[k];
          if (in <= p.site || out <= p.site)
            continue;  // mesh edges are negative; all three fragments see the vertex, the least lists it
          listed.corners.insert(listed.corners.end(), {p.site, in, out});
          if (facets != nullptr) listed.facets.push_back(p.facet);
        }
      }
    });
  };
  parallel_for(fragments_.size(), fragments_per_part, run, list_part);
  Listed all = std::move(parts.front());
  for (std::size_t k = 1; k < parts.size(); ++k) {
    all.corners.insert(all.corners.end(), parts[k].corners.begin(), parts[k].corners.end());
    all.facets.insert(all.facets.end(), parts[k].facets.begin(), parts[k].facets.end());
    parts[k] = {};
  }
  run.finish();
  if (facets != nullptr) *facets = std::move(all.facets);
  return Triangles(std::move(all.corners));
}

std::vector<double> RestrictedPowerDiagram::cell_areas(const Execution& execution) const {
  const Execution run = execution.start("measuring cells");
  std::vector<double> area(slot(num_sites()), 0.0);
  detail::for_each_piece(fragments_.size(), detail::kElementsPerLook, run, [&](std::size_t begin, std::size_t end) {
    for (Index f = static_cast<Index>(begin); f < static_cast<Index>(end); ++f) {
      if (alive(f) && fragments_[slot(f)].site != kNone) area[slot(fragments_[slot(f)].site)] += polygon(f).area();
    }
  });
  run.finish();
  return area;
}

std::string RestrictedPowerDiagram::check(const Execution& execution) const {
  const Execution run = execution.start("checking the diagram");
  std::string violation =
      status_ == Outcome::kCancelled ? "the diagram is not there: its construction was cancelled" : find_violation(run);
  run.finish();
  return violation;
}

/// Are all sites listed that reach a local facet?
bool RestrictedPowerDiagram::lists_all_local_sites() const {
  std::vector<Index> listed, count(local_sites_.size(), 0);
  for (Index s = 0; s < num_sites() && !local_sites_.empty(); ++s) {
    if (!takes_part(s)) continue;
    for (const Index facet : reach_lists_->facets(s)) {
      if (local(facet)) ++count[slot(local_[slot(facet)])];
    }
  }
  for (Index facet = 0; facet < mesh_.num_facets(); ++facet) {
    if (!local(facet)) continue;
    list_local_sites(facet, listed);
    if (static_cast<Index>(listed.size()) != count[slot(local_[slot(facet)])]) return false;
  }
  return true;
}

std::string RestrictedPowerDiagram::find_violation(const Execution& execution) const {
  if (!lists_all_local_sites()) return "lists of sites that reach a local facet are not those of facets that sites reach";
  detail::Ticker ticker(execution, fragments_.size() + first_of_facet_.size());
  const auto name = [](Index f) { return "fragment " + std::to_string(f); };
  Index live = 0;
  Clipper clipper(*this);
  std::vector<Index> around;
  for (Index f = 0; f < fragment_capacity(); ++f) {
    ticker.tick();
    if (!alive(f)) continue;
    ++live;
    const Polygon p = polygon(f);
    if (p.size < 3) return name(f) + ": fewer than 3 corners";
    for (Index k = 0; k < p.size; ++k) {
      const Index label = p.labels[k];
      if (label < mesh_edge_label(2) || label >= num_sites()) return name(f) + ": label out of range";
      if (std::count(p.labels, p.labels + p.size, label) != 1) return name(f) + ": label twice";
      if (!is_site(label)) continue;
      Index twin = first_of_facet(p.facet);
      while (twin != kNone && fragments_[slot(twin)].site != label) twin = next_of_facet(twin);
      if (twin == kNone) return name(f) + ": nothing beyond label " + std::to_string(label);
      const Polygon q = polygon(twin);
      if (std::count(q.labels, q.labels + q.size, p.site) != 1) return name(f) + ": label not mutual";
    }
    if (p.site == kNone) {
      around.clear();
      if (local(p.facet)) list_local_sites(p.facet, around);
      if (!local(p.facet) || !around.empty()) return name(f) + ": no owner, but sites reach the facet";
      continue;
    }
    // Clipping again by every neighbour must cut nothing off.
    if (local(p.facet)) {
      if (!reach_lists_->reaches(p.site, p.facet)) return name(f) + ": its owner does not reach the facet";
      list_local_sites(p.facet, around);
      around.erase(std::find(around.begin(), around.end(), p.site));
    } else {
      if (reach_lists_ != nullptr && is_foreign(f))
        return name(f) + ": its owner's ball meets it, but does not reach the facet";
      neighbors(p.site, around);
    }
    clipper.load(p);
    for (const Index other : around) {
      if (std::find(p.labels, p.labels + p.size, other) == p.labels + p.size && clipper.clip(other)) {
        return name(f) + ": reaches over the bisector with " + std::to_string(other);
      }
    }
  }
  if (live != num_fragments_) return "fragment count is off";
  for (Index s = 0; s < num_sites(); ++s) {
    for (Index f = first_of_site(s); f != kNone; f = next_of_site(f), --live) {
      if (live == 0 || !alive(f) || fragments_[slot(f)].site != s)
        return "fragment list of " + std::to_string(s) + " is broken";
    }
  }
  for (Index f = 0; f < fragment_capacity(); ++f) live -= alive(f) && fragments_[slot(f)].site == kNone ? 1 : 0;
  if (live != 0) return "fragments are missing in the lists of their sites";
  for (Index facet = 0; facet < mesh_.num_facets(); ++facet) {
    ticker.tick();
    double sum = 0;
    Index count = 0;
    for (Index f = first_of_facet(facet); f != kNone; f = next_of_facet(f), ++count) {
      if (fragments_[slot(f)].facet != facet || !alive(f)) return "facet list of " + std::to_string(facet) + " is broken";
      sum += polygon(f).area();
    }
    const Vec3 a = mesh_.corner(facet, 0), b = mesh_.corner(facet, 1), c = mesh_.corner(facet, 2);
    const double area = 0.5 * detail::stable_norm((b - a).cross(c - a));
    const double longest = std::max({detail::stable_norm(b - a), detail::stable_norm(c - b), detail::stable_norm(a - c)});
    // Corners are off by facet_error_, fragments by that along their borders of at most 4 longest edges each.
    const double rounding = 4 * longest * facet_error_[slot(facet)] * (count + 1);
    if (facet_error_[slot(facet)] < 0) {
      if (count > 0) return "facet " + std::to_string(facet) + " has fragments, but no area, or is there already";
      continue;
    }
    if (std::fabs(sum - area) > 1e-9 * area + rounding + 1e-12 * longest * longest) {
      return "fragments of facet " + std::to_string(facet) + " do not tile it";
    }
  }
  return "";
}

}  // namespace amps
