#define AMPS_OWN_SOURCE
#include "amps/reach.h"

#include "amps/predicates.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

namespace amps::detail {

// Floods

SurfaceFlood::SurfaceFlood(const MeshView& mesh, SurfaceEdges edges, std::vector<char> cut, const Execution& run)
    : edges_(std::move(edges)), cut_(std::move(cut)) {
  if (!cut_.empty() && cut_.size() != edges_.size()) {
    throw Error(ErrorCode::kInvalidArgument, "amps: " + std::to_string(cut_.size()) + " flags of cut edges for " +
                                                 std::to_string(edges_.size()) + " edges of the surface; give one an edge");
  }
  const std::size_t num_facets = slot(edges_.num_facets()), num_vertices = slot(edges_.num_vertices());
  if (num_facets > static_cast<std::size_t>(std::numeric_limits<Index>::max()) / 3) {
    throw Error(ErrorCode::kTooLarge, "amps: " + std::to_string(num_facets) + " facets are too many to flood");
  }
  Ticker ticker(run, num_vertices + 2 * num_facets + edges_.size(), kEdgesPerLook);
  positions_.reserve(3 * num_vertices);
  for (std::size_t v = 0; v < num_vertices; ++v) {
    ticker.tick();
    const Vec3 x = mesh.vertices[static_cast<std::ptrdiff_t>(v)];
    positions_.insert(positions_.end(), {x.x(), x.y(), x.z()});
  }

  const Triangles& triangles = edges_.triangles();
  links_.reserve(num_facets);
  vertex_begin_.assign(num_vertices + 1, 0);
  for (Index f = 0; f < edges_.num_facets(); ++f) {
    ticker.tick();
    links_.push_back({{triangles(f, 0), triangles(f, 1), triangles(f, 2)}, {kNone, kNone, kNone}});
    if (!edges_.counts(f)) continue;
    for (const Index v : links_.back().vertex) ++vertex_begin_[slot(v)];
  }
  // Counts become ends, and filling from the last facet on makes ends beginnings.
  for (std::size_t v = 1; v <= num_vertices; ++v) vertex_begin_[v] += vertex_begin_[v - 1];
  vertex_facets_.resize(slot(vertex_begin_.back()));
  for (Index f = edges_.num_facets(); f-- > 0;) {
    ticker.tick();
    if (!edges_.counts(f)) continue;
    for (const Index v : links_[slot(f)].vertex) vertex_facets_[slot(--vertex_begin_[slot(v)])] = f;
  }

  shared_begin_.push_back(0);
  for (std::size_t e = 0; e < edges_.size(); ++e) {
    ticker.tick();
    const MeshEdge edge = edges_[e];
    if (edge.size() < 2 || is_cut(e)) continue;
    const auto link = [&](const EdgeSide& side, Index across) { links_[slot(side.facet)].across[side.k] = across; };
    if (edge.size() == 2) {
      link(edge[0], edge[1].facet);
      link(edge[1], edge[0].facet);
      continue;
    }
    const Index number = static_cast<Index>(shared_begin_.size()) - 1;
    for (const EdgeSide& side : edge) {
      link(side, kNone - 1 - number);
      shared_facets_.push_back(side.facet);
    }
    shared_begin_.push_back(static_cast<Index>(shared_facets_.size()));
  }
}

/// Appends the facets at a vertex that have also another one; kNone: all.
void SurfaceFlood::facets_at(Index vertex, Index other, std::vector<Index>& facets) const {
  const Index last = vertex_begin_[slot(vertex) + 1];
  for (Index i = vertex_begin_[slot(vertex)]; i < last; ++i) {
    const Index f = vertex_facets_[slot(i)];
    const auto& v = links_[slot(f)].vertex;
    if (other == kNone || v[0] == other || v[1] == other || v[2] == other) facets.push_back(f);
  }
}

std::vector<Index> SurfaceFlood::homes(const SurfacePoint& at) const {
  const auto& corners = links_[slot(at.facet)].vertex;
  std::array<Index, 3> support{};
  std::size_t n = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    if (at.barycentric[static_cast<Eigen::Index>(k)] == 0) continue;
    if (std::find(support.begin(), support.begin() + n, corners[k]) == support.begin() + n) support[n++] = corners[k];
  }
  std::vector<Index> facets;
  if (n == 3 && edges_.counts(at.facet)) {
    facets.push_back(at.facet);
  } else if (n > 0) {
    facets_at(support[0], n == 1 ? kNone : support[1], facets);
    if (n == 3) {
      const auto lacks_third = [&](Index f) {
        const auto& v = links_[slot(f)].vertex;
        return std::find(v.begin(), v.end(), support[2]) == v.end();
      };
      facets.erase(std::remove_if(facets.begin(), facets.end(), lacks_third), facets.end());
    }
  }
  return facets;
}

std::vector<Index> SurfaceFlood::homes_of_edge(std::size_t edge) const {
  std::vector<Index> facets;
  for (const EdgeSide& side : edges_[edge]) facets.push_back(side.facet);
  return facets;
}

std::vector<Index> SurfaceFlood::homes_of_vertex(Index vertex) const {
  std::vector<Index> facets;
  facets_at(vertex, kNone, facets);
  return facets;
}

void SurfaceFlood::Scratch::start(std::size_t num_facets, std::size_t num_shared) {
  if (facet_mark_.size() < num_facets) facet_mark_.resize(num_facets, 0);
  if (shared_mark_.size() < num_shared) shared_mark_.resize(num_shared, 0);
  if (++now_ != 0) return;
  std::fill(facet_mark_.begin(), facet_mark_.end(), 0u);
  std::fill(shared_mark_.begin(), shared_mark_.end(), 0u);
  now_ = 1;
}

namespace {

/// Facets of one flood between looks: a millisecond or two.
constexpr std::size_t kFloodedPerLook = std::size_t{1} << 15;

}  // namespace

/// The flood, breadth first; visit(facet) at each that is reached, until it returns false.
template <class Visit>
void SurfaceFlood::spread(const Vec3& centre, double weight, const std::vector<Index>& homes, Scratch& scratch,
                          std::vector<Index>& facets, const Visit& visit) const {
  facets.clear();
  scratch.start(links_.size(), shared_begin_.size() - 1);
  for (const Index f : homes) {
    if (!scratch.mark(f)) continue;
    facets.push_back(f);
    if (!visit(f)) return;
  }
  const SegmentFilter filter(centre.data(), weight);
  for (std::size_t done = 0; done < facets.size(); ++done) {
    if (done % kFloodedPerLook == kFloodedPerLook - 1) scratch.watched_.check();
    const Links& links = links_[slot(facets[done])];
    const auto leads_on = [&](Index across) {
      if (across >= 0) return !scratch.is_marked(across);
      return is_shared(across) && !scratch.is_marked_shared(shared_number(across));
    };
    const bool open[3] = {leads_on(links.across[0]), leads_on(links.across[1]), leads_on(links.across[2])};
    if (!open[0] && !open[1] && !open[2]) continue;
    const double* const corners[3] = {at(links.vertex[0]), at(links.vertex[1]), at(links.vertex[2])};
    const SegmentFilter::End ends[3] = {filter.end(corners[0]), filter.end(corners[1]), filter.end(corners[2])};
    for (int k = 0; k < 3; ++k) {
      if (!open[k]) continue;
      const int m = k == 2 ? 0 : k + 1;
      const Index across = links.across[static_cast<std::size_t>(k)];
      if (is_shared(across)) scratch.mark_shared(shared_number(across));  // asked once, whoever is first
      int side = filter.side(ends[k], ends[m]);
      if (side == 0) {
        Stage stage;
        side = segment_side_of_ball_exact(corners[k], corners[m], centre.data(), weight, stage);
      }
      if (side > 0) continue;
      const Index* first = &across;
      const Index* last = first + 1;
      if (is_shared(across)) {
        first = shared_facets_.data() + shared_begin_[slot(shared_number(across))];
        last = shared_facets_.data() + shared_begin_[slot(shared_number(across)) + 1];
      }
      for (; first < last; ++first) {
        if (!scratch.mark(*first)) continue;
        facets.push_back(*first);
        if (!visit(*first)) return;
      }
    }
  }
}

namespace {

/// Sorts different numbers. `memory`: of any size, for use again. Few are put where the count of those below says: a comparison
/// of each with each, several at a time and without a branch, takes a third of the time of std::sort for some 30.
void sort_distinct(std::vector<Index>& list, std::vector<Index>& memory) {
  constexpr std::size_t kMaxRanked = 96;
  if (list.size() > kMaxRanked) {
    std::sort(list.begin(), list.end());
    return;
  }
  const std::size_t n = list.size();
  if (memory.size() < n) memory.resize(kMaxRanked);
  const Index* const from = list.data();
  Index* const to = memory.data();
  for (std::size_t i = 0; i < n; ++i) {
    const Index x = from[i];
    Index below = 0;
    for (std::size_t k = 0; k < n; ++k) below += from[k] < x ? 1 : 0;
    to[below] = x;
  }
  std::copy(to, to + n, list.begin());
}

}  // namespace

void SurfaceFlood::flood(const Vec3& centre, double weight, const std::vector<Index>& homes, Scratch& scratch,
                         std::vector<Index>& facets) const {
  spread(centre, weight, homes, scratch, facets, [](Index) { return true; });
  constexpr std::size_t kShareWorthSorting = 16;  // a greater one is in the marks, in order already
  if (facets.size() < links_.size() / kShareWorthSorting) {
    sort_distinct(facets, scratch.reached_);
    return;
  }
  facets.clear();
  for (Index f = 0; f < edges_.num_facets(); ++f) {
    if (scratch.is_marked(f)) facets.push_back(f);
  }
}

bool SurfaceFlood::holds(const PlacedPoint& from, double weight, const PlacedPoint& to, Scratch& scratch) const {
  if (side_of_ball(to.position.data(), from.position.data(), weight) > 0) return false;
  bool found = false;
  spread(from.position, weight, from.homes, scratch, scratch.reached_, [&](Index f) {
    found = std::binary_search(to.homes.begin(), to.homes.end(), f);
    return !found;
  });
  return found;
}

namespace {

double distance_of_crossing(const Vec3& x, const Vec3& a, const Vec3& b) {
  const Vec3 u = b - a;
  const double length = stable_norm(u);
  if (!(length > 0)) return stable_norm(x - a);
  const double along = dot(x - a, u / length);
  if (along <= 0) return stable_norm(x - a);
  if (along >= length) return stable_norm(x - b);
  return stable_norm((x - a).cross(u / length));
}

}  // namespace

/// The least radius, as doubles see it, at which a flood gets from one point's homes to one of the other's: by the path over
/// facets whose farthest edge is nearest (Dijkstra). Infinite if there is no path.
double SurfaceFlood::radius_of_arrival(const PlacedPoint& from, const PlacedPoint& to, Scratch& scratch) const {
  scratch.start(links_.size(), shared_begin_.size() - 1);
  if (scratch.radius_.size() < links_.size()) scratch.radius_.resize(links_.size());
  auto& heap = scratch.heap_;
  heap.clear();
  const auto offer = [&](Index f, double radius) {
    if (!scratch.mark(f) && scratch.radius_[slot(f)] <= radius) return;
    scratch.radius_[slot(f)] = radius;
    heap.emplace_back(radius, f);
    std::push_heap(heap.begin(), heap.end(), std::greater<>());
  };
  for (const Index f : from.homes) offer(f, 0);
  for (std::size_t done = 1; !heap.empty(); ++done) {
    if (done % kFloodedPerLook == 0) scratch.watched_.check();
    const auto [radius, f] = heap.front();
    std::pop_heap(heap.begin(), heap.end(), std::greater<>());
    heap.pop_back();
    if (radius > scratch.radius_[slot(f)]) continue;
    if (std::binary_search(to.homes.begin(), to.homes.end(), f)) return radius;
    const Links& links = links_[slot(f)];
    for (std::size_t k = 0; k < 3; ++k) {
      const Index across = links.across[k];
      if (across == kNone) continue;
      const double distance =
          distance_of_crossing(from.position, position(links.vertex[k]), position(links.vertex[k == 2 ? 0 : k + 1]));
      const double there = std::max(radius, distance);
      if (!is_shared(across)) {
        offer(across, there);
        continue;
      }
      const Index last = shared_begin_[slot(shared_number(across)) + 1];
      for (Index i = shared_begin_[slot(shared_number(across))]; i < last; ++i) offer(shared_facets_[slot(i)], there);
    }
  }
  return std::numeric_limits<double>::infinity();
}

double SurfaceFlood::bottleneck(const PlacedPoint& from, const PlacedPoint& to, double limit, Scratch& scratch) const {
  if (!holds(from, limit * limit, to, scratch)) return std::numeric_limits<double>::infinity();
  const double distance = stable_norm(to.position - from.position);
  double radius = std::min(limit, std::max(distance, radius_of_arrival(from, to, scratch)));
  // Doubles may be above by their errors; steps that double soon outgrow any.
  constexpr double kFirstStep = 0x1p-50;
  for (double step = kFirstStep; radius > 0 && holds(from, radius * radius, to, scratch); step *= 2) {
    radius = step < 1 ? radius * (1 - step) : 0;
  }
  return radius;
}

// Lists

void ReachLists::reserve(std::size_t num_samples) {
  if (runs_.empty()) return;
  const auto most = static_cast<std::size_t>(std::numeric_limits<Index>::max());
  const double growth = static_cast<double>(num_samples) / static_cast<double>(runs_.size());
  const double pairs = std::min(growth * static_cast<double>(facets_.size()), static_cast<double>(most));
  runs_.reserve(num_samples);
  facets_.reserve(static_cast<std::size_t>(pairs));
}

/// The first of `size` pairs that nothing uses.
Index ReachLists::take_run(std::size_t size) {
  if (size < unused_of_size_.size() && unused_of_size_[size] != kNone) {
    const Index begin = unused_of_size_[size];
    unused_of_size_[size] = facets_[slot(begin)];
    unused_ -= size;
    return begin;
  }
  const std::size_t begin = facets_.size();
  if (size > static_cast<std::size_t>(std::numeric_limits<Index>::max()) - begin) {
    throw Error(ErrorCode::kTooLarge, "amps: the disks reach more than 2^31 facets in all; they are too large for this mesh");
  }
  facets_.resize(begin + size);
  return static_cast<Index>(begin);
}

/// Keeps a run for another sample.
void ReachLists::release(Run& run) {
  const std::size_t size = slot(std::exchange(run.size, -1));
  if (size == 0) return;
  if (unused_of_size_.size() <= size) unused_of_size_.resize(size + 1, kNone);
  facets_[slot(run.begin)] = unused_of_size_[size];
  unused_of_size_[size] = run.begin;
  unused_ += size;
}

/// Moves all lists together, in the order of the samples.
void ReachLists::compact() {
  std::vector<Index> facets;
  facets.reserve(size());
  for (Run& run : runs_) {
    if (run.size < 0) continue;
    const auto first = facets_.begin() + run.begin;
    run.begin = static_cast<Index>(facets.size());
    facets.insert(facets.end(), first, first + run.size);
  }
  facets_ = std::move(facets);
  unused_of_size_.clear();
  unused_ = 0;
}

void ReachLists::add(Index sample, const std::vector<Index>& facets) {
  AMPS_ASSERT(!has(sample));
  const Index begin = facets.empty() ? 0 : take_run(facets.size());
  if (runs_.size() <= slot(sample)) runs_.resize(slot(sample) + 1);
  runs_[slot(sample)] = {begin, static_cast<Index>(facets.size())};
  std::copy(facets.begin(), facets.end(), facets_.begin() + begin);
}

bool ReachLists::replace(Index sample, const std::vector<Index>& facets) {
  const Facets before = this->facets(sample);
  if (std::equal(before.begin(), before.end(), facets.begin(), facets.end())) return false;
  remove(sample);
  add(sample, facets);
  return true;
}

void ReachLists::remove(Index sample) {
  AMPS_ASSERT(has(sample));
  release(runs_[slot(sample)]);
  constexpr std::size_t kFew = 1024;  // pairs, that are not worth moving
  if (unused_ > kFew && 2 * unused_ > facets_.size()) compact();
}

bool ReachLists::reaches(Index sample, Index facet) const {
  const Facets list = facets(sample);
  return std::binary_search(list.begin(), list.end(), facet);
}

}  // namespace amps::detail
