#define AMPS_OWN_SOURCE
#include "amps/power_diagram.h"

#include "amps/mesh_edges.h"
#include "amps/power_diagram_clipper.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

namespace amps {

using detail::slot;

double RestrictedPowerDiagram::Polygon::area() const {
  Vec3 sum = Vec3::Zero();
  for (Index k = 2; k < size; ++k) sum += (corners[k - 1] - corners[0]).cross(corners[k] - corners[0]);
  return 0.5 * detail::stable_norm(sum);  // areas of 1e±200 have squares out of range
}

// Construction

/// Fragments of a run of facets, before they are put together.
struct RestrictedPowerDiagram::Batch {
  struct Entry {
    Index facet, site, size;
  };
  std::vector<Entry> entries;
  std::vector<Vec3> corners;
  std::vector<Index> labels;
  std::vector<Index> queue;      ///< sites found in the current facet
  std::vector<Index> last_seen;  ///< by site: the facet it was last queued in
  detail::WorkCounter* done = nullptr;
  std::size_t told = 0;  ///< entries that have been added to it

  void add(Index facet, Index site, const Clipper& clipper) {
    constexpr std::size_t kFragmentsPerLook = 512;
    if (entries.size() - told >= kFragmentsPerLook) {
      done->add(entries.size() - told);
      told = entries.size();
    }
    const std::size_t first = corners.size(), count = clipper.corners().size();
    entries.push_back({facet, site, static_cast<Index>(count)});
    corners.resize(first + count);
    labels.resize(first + count);
    std::copy(clipper.corners().begin(), clipper.corners().end(), corners.begin() + static_cast<std::ptrdiff_t>(first));
    std::copy(clipper.labels().begin(), clipper.labels().end(), labels.begin() + static_cast<std::ptrdiff_t>(first));
  }
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
    first_of_site_.assign(static_cast<std::size_t>(sites.rows()), kNone);
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
  corners_ = {};
  labels_ = {};
  first_of_site_ = first_of_facet_ = {};
  facet_error_ = reach_ = {};
  local_ = {};
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
  // On one thread: of points on a surface most insertions by several get in each other's way.
  triangulation_.insert(positions, all_weights, execution.part(0.03, 1).on_one_thread());
}

namespace {

/// Of loops that take 100 ns a facet.
constexpr std::uint64_t kFacetsPerLook = 8192;

}  // namespace

/// Bounds of the error of computed corners per facet; −1 for facets without fragments: those without area, and second copies.
void RestrictedPowerDiagram::measure_facets(const Execution& execution) {
  facet_error_.assign(slot(mesh_.num_facets()), 0);
  for (const Index facet : detail::find_repeated_facets(mesh_, execution.part(0, 0.4))) facet_error_[slot(facet)] = -1;
  detail::Ticker ticker(execution.part(0.4, 1), facet_error_.size(), kFacetsPerLook);
  for (Index facet = 0; facet < mesh_.num_facets(); ++facet) {
    ticker.tick();
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
    largest_facet_error_ = std::max(largest_facet_error_, facet_error_[slot(facet)]);
  }
}

RestrictedPowerDiagram::Plane RestrictedPowerDiagram::plane(Index owner, Index other) const {
  const WeightedPoint &p = site(owner), &q = site(other);
  const double d2 = detail::squared_norm(q.position() - p.position());
  const double dw = p.w - q.w;
  return {((d2 + dw) - detail::kOffsetSlack * (d2 + std::fabs(dw))) / (2 * std::sqrt(d2)), other};
}

RestrictedPowerDiagram::PlaneTable RestrictedPowerDiagram::all_planes(const Execution& execution) const {
  const RegularTriangulation::Adjacency around = adjacency(execution.part(0, 0.6));
  PlaneTable table;
  table.offset = around.offset;
  table.planes.reserve(around.adjacent.size());
  constexpr std::size_t kSitesPerPiece = 4096;
  detail::for_each_piece(slot(num_sites()), kSitesPerPiece, execution.part(0.6, 1), [&](std::size_t begin, std::size_t end) {
    for (Index s = static_cast<Index>(begin); s < static_cast<Index>(end); ++s) {
      for (Index k = around.offset[slot(s)]; k < around.offset[slot(s) + 1]; ++k) {
        table.planes.push_back(plane(s, around.adjacent[slot(k)]));
      }
      std::sort(table.planes.begin() + around.offset[slot(s)], table.planes.end(), detail::nearer_plane<Plane>);
    }
  });
  return table;
}

void RestrictedPowerDiagram::build(const Execution& execution) {
  const PlaneTable planes = all_planes(execution.part(0, 0.35));
  const std::vector<Index> owner = corner_owners(planes, execution.part(0.35, 0.4));
  const std::size_t num_facets = slot(mesh_.num_facets());
  // One thread fills the pools themselves; with more, batches are put together in their order, with the same result.
  const std::size_t facets_per_batch = execution.workers() == 1 ? num_facets : 4096;
  std::vector<Batch> batches((num_facets + facets_per_batch - 1) / facets_per_batch);
  const Execution clipping = execution.part(0.4, 0.8);
  const double fragments = detail::expected_fragments(static_cast<double>(num_facets), static_cast<double>(num_sites()));
  detail::WorkCounter done(clipping, static_cast<std::uint64_t>(fragments));
  parallel_for(num_facets, facets_per_batch, clipping, [&](std::size_t begin, std::size_t end) {
    Batch& batch = batches[begin / facets_per_batch];
    batch.done = &done;
    batch.last_seen.assign(slot(num_sites()), kNone);
    batch.entries.reserve(end - begin + 4 * slot(num_sites()) / batches.size());
    // Room for edits, too: memory is not used before it is written to, and moving the pools would take long.
    batch.corners.reserve(8 * batch.entries.capacity());
    batch.labels.reserve(8 * batch.entries.capacity());
    clip_facets(begin, end, owner, planes, batch);
    batch.last_seen = {};
  });
  assemble(batches, execution.part(0.8, 1));
}

void RestrictedPowerDiagram::clip_facets(std::size_t begin, std::size_t end, const std::vector<Index>& owner,
                                         const PlaneTable& planes, Batch& batch) const {
  Clipper clipper(*this);
  for (std::size_t f = begin; f < end; ++f) {
    if (facet_error_[f] < 0) continue;
    const Index facet = static_cast<Index>(f);
    clipper.set_facet(facet);
    const Index owner_a = owner[slot(mesh_.triangles(facet, 0))];
    if (owner_a == owner[slot(mesh_.triangles(facet, 1))] && owner_a == owner[slot(mesh_.triangles(facet, 2))]) {
      clipper.start(owner_a);  // power cells are convex: the whole facet lies in this one
      batch.add(facet, owner_a, clipper);
    } else {
      flood_facet(facet, owner_a, planes, clipper, batch);
    }
  }
}

/// Puts the fragments of all facets together. Polygons stay in the order of facets, but the records of each site's fragments
/// lie side by side, sites in the order in which facets meet them: local updates look through all fragments of a few sites, and
/// would otherwise spend their time on cache misses.
void RestrictedPowerDiagram::assemble(std::vector<Batch>& batches, const Execution& execution) {
  using detail::for_each_piece;
  using detail::kElementsPerLook;
  make_records(batches, execution.part(0, 0.3));
  fill_pools(batches, execution.part(0.3, 0.4));
  for_each_piece(fragments_.size(), kElementsPerLook, execution.part(0.4, 0.9), [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) link(num_fragments_ - 1 - static_cast<Index>(k));  // so that lists run forwards
  });
  reach_.resize(slot(num_sites()));
  for_each_piece(reach_.size(), kElementsPerLook, execution.part(0.9, 1), [&](std::size_t begin, std::size_t end) {
    for (std::size_t s = begin; s < end; ++s) update_reach(static_cast<Index>(s));
  });
}

/// The fragments' records, without links. Their bounds are set here, where corners are read as a stream: afterwards each would
/// be looked for in memory, which of ten million took a minute.
void RestrictedPowerDiagram::make_records(const std::vector<Batch>& batches, const Execution& execution) {
  std::size_t num_entries = 0;
  for (const Batch& batch : batches) num_entries += batch.entries.size();
  std::vector<Index> count(slot(num_sites()), 0), site_order;
  detail::Ticker counting(execution.part(0, 0.3), num_entries, detail::kElementsPerLook);
  for (const Batch& batch : batches) {
    for (const Batch::Entry& entry : batch.entries) {
      counting.tick();
      if (count[slot(entry.site)]++ == 0) site_order.push_back(entry.site);
    }
  }
  std::vector<Index> next(slot(num_sites()), 0);
  for (const Index s : site_order) {
    next[slot(s)] = num_fragments_;
    num_fragments_ += count[slot(s)];
  }
  fragments_.reserve(num_entries + num_entries / 2);
  detail::for_each_piece(num_entries, detail::kElementsPerLook, execution.part(0.3, 0.6),
                         [&](std::size_t, std::size_t end) { fragments_.resize(end); });
  detail::Ticker filling(execution.part(0.6, 1), num_entries, detail::kElementsPerLook);
  Index first = 0;
  for (const Batch& batch : batches) {
    const Vec3* corners = batch.corners.data();
    for (const Batch::Entry& entry : batch.entries) {
      filling.tick();
      Fragment& fragment = fragments_[slot(next[slot(entry.site)]++)];
      fragment.facet = entry.facet;
      fragment.site = entry.site;
      fragment.first = first;
      fragment.size = fragment.capacity = entry.size;
      bound(fragment, corners);
      first += entry.size;
      corners += entry.size;
    }
  }
}

void RestrictedPowerDiagram::fill_pools(std::vector<Batch>& batches, const Execution& execution) {
  if (batches.size() == 1) {
    corners_ = std::move(batches.front().corners);
    labels_ = std::move(batches.front().labels);
    return;
  }
  std::size_t size = 0;
  for (const Batch& batch : batches) size += batch.corners.size();
  corners_.reserve(2 * size);  // edits add to them
  labels_.reserve(2 * size);
  detail::Ticker ticker(execution, size, detail::kElementsPerLook);
  for (Batch& batch : batches) {
    corners_.insert(corners_.end(), batch.corners.begin(), batch.corners.end());
    labels_.insert(labels_.end(), batch.labels.begin(), batch.labels.end());
    ticker.tick(batch.corners.size());
    batch.corners = {};
    batch.labels = {};
  }
}

void RestrictedPowerDiagram::update_reach(Index s) {
  if (!visible(s)) {
    reach_[slot(s)] = kNoCell;
    return;
  }
  double reach = 0;
  for (Index f = first_of_site(s); f != kNone; f = next_of_site(f)) {
    const double farthest = this->reach(f);
    if (farthest > reach || std::isnan(farthest)) reach = farthest;  // NaN from overflow stays, and prunes nothing
  }
  reach_[slot(s)] = reach;
}

double RestrictedPowerDiagram::reach(Index f) const {
  const Fragment& fragment = fragments_[slot(f)];
  if (fragment.site == kNone) return INFINITY;
  const WeightedPoint& owner = site(fragment.site);
  const Vec3 offset(fragment.centre[0] - owner.x, fragment.centre[1] - owner.y, fragment.centre[2] - owner.z);
  return (detail::norm(offset) + fragment.radius) * (1 + detail::kOffsetSlack) + largest_facet_error_;
}

/// Sets the ball around the corners. Floats carry 2^-24 of the coordinates, or lose up to 2^-127 to underflow; more than that
/// is added to the radius.
void RestrictedPowerDiagram::bound(Fragment& fragment, const Vec3* corner) {
  constexpr double kFloatSlack = 0x1p-21, kFloatUnderflow = 0x1p-124;
  Vec3 low = corner[0], high = corner[0];
  for (Index k = 1; k < fragment.size; ++k) {
    low = low.cwiseMin(corner[k]);
    high = high.cwiseMax(corner[k]);
  }
  const Vec3 centre = 0.5 * (low + high);
  double farthest = 0;
  for (Index k = 0; k < fragment.size; ++k) farthest = std::max(farthest, detail::squared_norm(corner[k] - centre));
  for (int a = 0; a < 3; ++a) fragment.centre[slot(a)] = static_cast<float>(centre[a]);
  fragment.radius = static_cast<float>(std::sqrt(farthest) * (1 + kFloatSlack) + kFloatSlack * detail::sum(centre.cwiseAbs()) +
                                       kFloatUnderflow);
}

/// The owner of every mesh vertex that a facet uses, found by walking from the last one over ever nearer neighbours.
std::vector<Index> RestrictedPowerDiagram::corner_owners(const PlaneTable& planes, const Execution& execution) const {
  std::vector<Index> owner(slot(mesh_.num_vertices()), kNone);
  Index near = 0;
  while (!visible(near)) ++near;
  detail::Ticker ticker(execution, slot(mesh_.num_facets()));
  for (Index facet = 0; facet < mesh_.num_facets(); ++facet) {
    ticker.tick();
    for (int c = 0; c < 3; ++c) {
      const Index known = owner[slot(mesh_.triangles(facet, c))];
      if (known != kNone) near = known;
    }
    for (int c = 0; c < 3; ++c) {
      Index& found = owner[slot(mesh_.triangles(facet, c))];
      if (found != kNone) continue;
      const Vec3 position = mesh_.corner(facet, c);
      const double* const corners[3] = {position.data(), position.data(), position.data()};
      const double error = detail::kPositionRounding * position.cwiseAbs().maxCoeff();
      for (bool moved = true; moved;) {
        moved = false;
        for (const Plane *plane = planes.begin(near), *end = planes.end(near); plane != end && !moved; ++plane) {
          const Index other = plane->site;
          int side = detail::SideFilter(site(near), site(other)).side(position, error);
          if (side == 0) side = side_of_corner(corners, 0, Bisector(site(near), site(other), corners));
          if (side < 0) {
            near = other;
            moved = true;
          }
        }
      }
      found = near;
    }
  }
  return owner;
}

void RestrictedPowerDiagram::flood_facet(Index facet, Index owner, const PlaneTable& planes, Clipper& clipper,
                                         Batch& batch) const {
  batch.queue.assign(1, owner);
  batch.last_seen[slot(owner)] = facet;
  for (std::size_t k = 0; k < batch.queue.size(); ++k) {
    const Index s = batch.queue[k];
    clipper.start(s);
    clipper.clip_all(planes.begin(s), planes.end(s));
    AMPS_ASSERT(!clipper.empty());
    batch.add(facet, s, clipper);
    for (const Index label : clipper.labels()) {
      if (is_site(label) && batch.last_seen[slot(label)] != facet) {
        batch.last_seen[slot(label)] = facet;
        batch.queue.push_back(label);
      }
    }
  }
}

// Fragment store

RestrictedPowerDiagram::Polygon RestrictedPowerDiagram::polygon(Index f) const {
  const Fragment& fragment = fragments_[slot(f)];
  return {fragment.facet, fragment.site, corners_.data() + fragment.first, labels_.data() + fragment.first, fragment.size};
}

/// Puts a fragment at the head of its two lists.
void RestrictedPowerDiagram::link(Index f) {
  Fragment& fragment = fragments_[slot(f)];
  Index& of_facet = first_of_facet_[slot(fragment.facet)];
  fragment.next_of_facet = of_facet;
  fragment.next_of_site = fragment.previous_of_site = fragment.previous_of_facet = kNone;
  if (of_facet != kNone) fragments_[slot(of_facet)].previous_of_facet = f;
  of_facet = f;
  if (fragment.site == kNone) return;
  Index& of_site = first_of_site_[slot(fragment.site)];
  fragment.next_of_site = of_site;
  if (of_site != kNone) fragments_[slot(of_site)].previous_of_site = f;
  of_site = f;
}

void RestrictedPowerDiagram::store_polygon(Fragment& fragment, const Clipper& clipper) {
  const Index size = static_cast<Index>(clipper.corners().size());
  if (size > fragment.capacity) {
    pool_garbage_ += slot(fragment.capacity);
    fragment.first = static_cast<Index>(corners_.size());
    fragment.capacity = size + 2;  // room for the next cut or two
    corners_.resize(corners_.size() + slot(fragment.capacity), Vec3::Zero());
    labels_.resize(labels_.size() + slot(fragment.capacity), kNone);
  }
  fragment.size = size;
  std::copy(clipper.corners().begin(), clipper.corners().end(), corners_.begin() + fragment.first);
  std::copy(clipper.labels().begin(), clipper.labels().end(), labels_.begin() + fragment.first);
  bound(fragment, corners_.data() + fragment.first);
}

void RestrictedPowerDiagram::add_fragment(Index facet, Index site, const Clipper& clipper) {
  Index f;
  if (free_fragments_.empty()) {
    f = static_cast<Index>(fragments_.size());
    fragments_.emplace_back();
  } else {
    f = free_fragments_.back();
    free_fragments_.pop_back();
  }
  fragments_[slot(f)].facet = facet;
  fragments_[slot(f)].site = site;
  store_polygon(fragments_[slot(f)], clipper);
  link(f);
  ++num_fragments_;
  changed_.push_back(f);
  if (site != kNone) changed_sites_.push_back(site);
}

/// The slot keeps its room in the pools for its next use.
void RestrictedPowerDiagram::free_fragment(Index f) {
  Fragment& fragment = fragments_[slot(f)];
  if (fragment.site != kNone) {
    (fragment.previous_of_site == kNone ? first_of_site_[slot(fragment.site)]
                                        : fragments_[slot(fragment.previous_of_site)].next_of_site) = fragment.next_of_site;
    if (fragment.next_of_site != kNone) fragments_[slot(fragment.next_of_site)].previous_of_site = fragment.previous_of_site;
  }
  (fragment.previous_of_facet == kNone ? first_of_facet_[slot(fragment.facet)]
                                       : fragments_[slot(fragment.previous_of_facet)].next_of_facet) = fragment.next_of_facet;
  if (fragment.next_of_facet != kNone) fragments_[slot(fragment.next_of_facet)].previous_of_facet = fragment.previous_of_facet;
  fragment.size = 0;
  --num_fragments_;
  free_fragments_.push_back(f);
}

void RestrictedPowerDiagram::compact(const Execution& execution) {
  if (2 * pool_garbage_ < corners_.size()) return;
  const Execution run = execution.start("tidying memory");
  compact_pools(&run);
}

/// Moves all polygons together.
void RestrictedPowerDiagram::compact_pools(const Execution* execution) {
  constexpr std::size_t kFragmentsPerLook = 8192;
  std::vector<Vec3> corners;
  std::vector<Index> labels;
  corners.reserve(corners_.size());
  labels.reserve(labels_.size());
  for (std::size_t f = 0; f < fragments_.size(); ++f) {
    if (execution != nullptr && f % kFragmentsPerLook == 0) execution->report(0);
    const Fragment& fragment = fragments_[f];
    corners.insert(corners.end(), corners_.begin() + fragment.first, corners_.begin() + fragment.first + fragment.size);
    labels.insert(labels.end(), labels_.begin() + fragment.first, labels_.begin() + fragment.first + fragment.size);
  }
  Index first = 0;
  for (Fragment& fragment : fragments_) {
    fragment.first = first;
    fragment.capacity = fragment.size;
    first += fragment.size;
  }
  corners_.swap(corners);
  labels_.swap(labels);
  pool_garbage_ = 0;
}

int RestrictedPowerDiagram::power_at_corner(const Polygon& polygon, Index k) const {
  if (polygon.site == kNone) return 1;
  const detail::PowerFilter filter(site(polygon.site), facet_error_[slot(polygon.facet)]);
  const int side = filter.side(polygon.corners[k]);
  return side != 0 ? side : exact_power_at_corner(polygon, k);
}

bool RestrictedPowerDiagram::covered(const Polygon& polygon) const {
  if (polygon.site == kNone) return false;
  const detail::PowerFilter filter(site(polygon.site), facet_error_[slot(polygon.facet)]);
  for (Index k = 0; k < polygon.size; ++k) {
    int side = filter.side(polygon.corners[k]);
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
  std::vector<Index> corners;
  corners.reserve(6 * slot(num_sites()));  // 2 triangles a sample
  if (facets != nullptr) facets->clear();
  detail::for_each_piece(fragments_.size(), detail::kElementsPerLook, run, [&](std::size_t begin, std::size_t end) {
    for (Index f = static_cast<Index>(begin); f < static_cast<Index>(end); ++f) {
      const Polygon p = polygon(f);
      for (Index k = 0; k < p.size; ++k) {
        // Walking round the vertex counter-clockwise from the owner, the cell across the incoming edge comes first.
        const Index in = p.labels[k == 0 ? p.size - 1 : k - 1], out = p.labels[k];
        if (in <= p.site || out <= p.site)
          continue;  // mesh edges are negative; all three fragments see the vertex, the least lists it
        corners.insert(corners.end(), {p.site, in, out});
        if (facets != nullptr) facets->push_back(p.facet);
      }
    }
  });
  run.finish();
  return Triangles(std::move(corners));
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

std::string RestrictedPowerDiagram::find_violation(const Execution& execution) const {
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
      list_local_sites(p.facet, around);
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
