#define AMPS_OWN_SOURCE
#include "amps/mesh_edges.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <numeric>
#include <string>

namespace amps::detail {
namespace {

/// Sorts by the higher vertex; sides of equal ones keep their order. Nearly always a handful.
void sort_by_high(EdgeSide* first, EdgeSide* last, const Execution& run) {
  constexpr std::ptrdiff_t kMaxInserted = 24;
  if (last - first > kMaxInserted) {
    constexpr std::uint64_t kComparisonsPerLook = 1 << 16;
    std::uint64_t comparisons = 0;
    std::stable_sort(first, last, [&](const EdgeSide& a, const EdgeSide& b) {
      if (++comparisons % kComparisonsPerLook == 0) run.report(0);
      return a.high < b.high;
    });
    return;
  }
  for (EdgeSide* next = first; next < last; ++next) {
    const EdgeSide taken = *next;
    EdgeSide* to = next;
    for (; to > first && to[-1].high > taken.high; --to) *to = to[-1];
    *to = taken;
  }
}

constexpr std::uint64_t kHashFactor = 0x9e3779b97f4a7c15u;

/// Equal for equal positions.
std::uint64_t position_hash(const Vec3& x) {
  std::uint64_t hash = 0;
  for (int k = 0; k < 3; ++k) {
    const double coordinate = x[k] + 0.0;  // −0 + 0 = +0: equal numbers have equal bits
    std::uint64_t bits = 0;
    std::memcpy(&bits, &coordinate, sizeof bits);
    hash = (hash ^ bits) * kHashFactor;
    hash ^= hash >> 32;
  }
  return hash;
}

}  // namespace

MeshEdges::MeshEdges(const TrianglesView& triangles, Index num_vertices, const std::vector<char>& counted, const Execution& run)
    : num_corners_(3 * static_cast<std::size_t>(triangles.rows())) {
  const auto num_facets = static_cast<Index>(triangles.rows());
  // Each part has some of the vertices, and takes the sides from them out of all.
  constexpr std::size_t kMostParts = 8, kFacetsWorthAPart = std::size_t{1} << 14;
  const std::size_t num_parts =
      std::max<std::size_t>(1, std::min({std::size_t{run.workers()}, kMostParts, slot(num_facets) / kFacetsWorthAPart}));
  const Index vertices_per_part = num_vertices / static_cast<Index>(num_parts) + 1;
  WorkCounter done(run, (2 * slot(num_facets) + slot(num_vertices)) * num_parts);
  const auto in_parts = [&](const auto& body) {
    parallel_for(num_parts, 1, run, [&](std::size_t part, std::size_t) {
      const Index first = std::min(num_vertices, static_cast<Index>(part) * vertices_per_part);
      body(part, first, std::min(num_vertices, first + vertices_per_part));
    });
  };
  const auto for_each_side = [&](Index first, Index last, const auto& body) {
    const auto count = static_cast<std::uint32_t>(last - first);
    for (Index f = 0; f < num_facets; ++f) {
      if (slot(f) % kEdgesPerLook == 0) done.add(kEdgesPerLook);
      if (!counted.empty() && counted[slot(f)] == 0) continue;
      const Index v[3] = {triangles(f, 0), triangles(f, 1), triangles(f, 2)};
      for (std::uint8_t k = 0; k < 3; ++k) {
        const Index from = v[k], to = v[k == 2 ? 0 : k + 1];
        const bool forward = from <= to;
        const Index low = forward ? from : to;
        if (static_cast<std::uint32_t>(low - first) < count) body(low, EdgeSide{forward ? to : from, f, k, forward});
      }
    }
  };
  // By lower vertex, facet by facet: a counting sort.
  std::vector<std::size_t> start(slot(num_vertices) + 2, 0);
  in_parts([&](std::size_t, Index first, Index last) {
    for_each_side(first, last, [&](Index low, const EdgeSide&) { ++start[slot(low) + 2]; });
  });
  std::partial_sum(start.begin(), start.end(), start.begin());
  if (start.back() > slot(std::numeric_limits<Index>::max())) {
    throw Error(ErrorCode::kTooLarge, "amps: " + std::to_string(num_facets) + " facets are too many to list their edges");
  }
  sides_.resize(start.back());
  struct Listed {
    std::vector<Index> begin, low;
  };
  std::vector<Listed> listed(num_parts);
  in_parts([&](std::size_t part, Index first, Index last) {
    const std::size_t begin = start[slot(first) + 1];
    for_each_side(first, last, [&](Index low, const EdgeSide& side) { sides_[start[slot(low) + 1]++] = side; });
    auto& [begins, lows] = listed[part];
    const std::size_t num_sides = first < last ? start[slot(last)] - begin : 0;
    begins.reserve(num_sides / 2 + 1);
    lows.reserve(num_sides / 2);
    for (Index low = first; low < last; ++low) {
      if (slot(low) % kEdgesPerLook == 0) done.add(kEdgesPerLook);
      EdgeSide* const first_side = sides_.data() + (low == first ? begin : start[slot(low)]);
      EdgeSide* const last_side = sides_.data() + start[slot(low) + 1];
      sort_by_high(first_side, last_side, run);
      for (const EdgeSide* at = first_side; at < last_side; ++at) {
        if (at > first_side && at[-1].high == at->high) continue;
        begins.push_back(static_cast<Index>(at - sides_.data()));
        lows.push_back(low);
      }
    }
  });
  begin_ = std::move(listed.front().begin);
  low_ = std::move(listed.front().low);
  for (std::size_t part = 1; part < num_parts; ++part) {
    begin_.insert(begin_.end(), listed[part].begin.begin(), listed[part].begin.end());
    low_.insert(low_.end(), listed[part].low.begin(), listed[part].low.end());
  }
  begin_.push_back(static_cast<Index>(sides_.size()));
}

std::vector<Index> MeshEdges::edge_of_sides(const Execution& run) const {
  std::vector<Index> result(num_corners_, kNone);
  for_each_index_on_all_threads(size(), run, [&](std::size_t e) {
    for (const EdgeSide& side : (*this)[e]) result[side.corner()] = static_cast<Index>(e);
  });
  return result;
}

UnionFind::UnionFind(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), std::uint32_t{0}); }

std::size_t UnionFind::count(const std::vector<char>& member, const Execution& run) {
  Ticker ticker(run, member.size(), kEdgesPerLook);
  std::size_t result = 0;
  for (std::size_t i = 0; i < member.size(); ++i) {
    ticker.tick();
    result += member[i] != 0 && find(i) == i ? 1 : 0;
  }
  return result;
}

std::vector<std::size_t> corner_fans(const MeshEdges& edges, const std::vector<char>& cut, const Execution& run) {
  UnionFind fans(edges.num_corners());
  run.report(0);
  Ticker ticker(run, edges.size() + edges.num_corners(), kEdgesPerLook);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    ticker.tick();
    if (!cut.empty() && cut[e] != 0) continue;
    const MeshEdge edge = edges[e];
    for (const EdgeSide* side = edge.begin() + 1; side < edge.end(); ++side) {
      fans.join(edge[0].low_corner(), side->low_corner());
      fans.join(edge[0].high_corner(), side->high_corner());
    }
  }
  std::vector<std::size_t> result;
  resize_watched(result, edges.num_corners(), std::size_t{0}, run);
  for (std::size_t c = 0; c < result.size(); ++c) {
    result[c] = fans.find(c);
    ticker.tick();
  }
  return result;
}

std::vector<Index> fans_at_vertices(const TrianglesView& triangles, Index num_vertices, const std::vector<std::size_t>& fans,
                                    const std::vector<char>& counted, const Execution& run) {
  Ticker ticker(run, fans.size(), kEdgesPerLook);
  std::vector<Index> result(slot(num_vertices), 0);
  for (std::size_t c = 0; c < fans.size(); ++c) {
    ticker.tick();
    if (fans[c] != c || (!counted.empty() && counted[c / 3] == 0)) continue;
    ++result[slot(triangles(static_cast<std::ptrdiff_t>(c / 3), static_cast<int>(c % 3)))];
  }
  return result;
}

DistinctPoints::DistinctPoints(std::size_t expected, const Execution& run) {
  std::size_t capacity = 16;
  while (capacity < 2 * expected) capacity *= 2;
  resize_watched(table_, capacity, kNone, run);
  coordinates_.reserve(3 * expected);
}

Index DistinctPoints::find_or_add(const Vec3& x) {
  if (2 * slot(size()) >= table_.size()) grow_table();
  const Index fresh = size();
  if (!x.hasNaN()) {  // in the table it would never be found, and many would make long runs
    Index& entry = table_[place(x)];
    if (entry != kNone) return entry;
    entry = fresh;
  }
  coordinates_.insert(coordinates_.end(), {x.x(), x.y(), x.z()});
  return fresh;
}

std::size_t DistinctPoints::place(const Vec3& x) const {
  std::size_t at = position_hash(x) & (table_.size() - 1);
  while (table_[at] != kNone && (*this)[table_[at]] != x) at = (at + 1) & (table_.size() - 1);
  return at;
}

void DistinctPoints::grow_table() {
  table_.assign(4 * table_.size(), kNone);
  for (Index i = 0; i < size(); ++i) {
    if (!(*this)[i].hasNaN()) table_[place((*this)[i])] = i;
  }
}

std::vector<Index> first_equal_vertices(const MeshView& mesh, const Execution& run) {
  Ticker ticker(run, slot(mesh.num_vertices()), kEdgesPerLook);
  const auto n = slot(mesh.num_vertices());
  DistinctPoints points(n, run);
  std::vector<Index> first, first_of_point;
  resize_watched(first, n, kNone, run);
  first_of_point.reserve(n);
  for (std::size_t i = 0; i < n; ++i) {
    ticker.tick();
    const auto v = static_cast<Index>(i);
    const Index point = points.find_or_add(mesh.vertices[v]);
    if (slot(point) == first_of_point.size()) first_of_point.push_back(v);
    first[i] = first_of_point[slot(point)];
  }
  return first;
}

namespace {

/// Whether each of three distinct corners of a facet is one of another's, by position.
bool has_corners_of(const MeshView& mesh, Index facet, Index other) {
  const Vec3 x[3] = {mesh.corner(facet, 0), mesh.corner(facet, 1), mesh.corner(facet, 2)};
  const Vec3 y[3] = {mesh.corner(other, 0), mesh.corner(other, 1), mesh.corner(other, 2)};
  return std::all_of(x, x + 3, [&](const Vec3& corner) { return corner == y[0] || corner == y[1] || corner == y[2]; });
}

}  // namespace

std::vector<Index> find_repeated_facets(const MeshView& mesh, const Execution& run) {
  // Hardly any facet is there twice, so what could be is sifted out first, by a bit for each hash that has come up, and one for
  // each that has again: of others 1 in 16 is left for the table, which needs more memory than is near.
  constexpr std::size_t kBitsPerFacet = 16, kBitsPerWord = 64;
  constexpr std::uint64_t kHashOfNaN = 0;
  const Index num_vertices = mesh.num_vertices(), num_facets = mesh.num_facets();
  std::vector<std::uint64_t> vertex_hash(slot(num_vertices)), facet_hash(slot(num_facets));
  Ticker ticker(run, slot(num_vertices) + 2 * slot(num_facets), kEdgesPerLook);
  for (Index v = 0; v < num_vertices; ++v) {
    ticker.tick();
    const Vec3 x = mesh.vertices[v];
    vertex_hash[slot(v)] = x.hasNaN() ? kHashOfNaN : position_hash(x);
  }
  std::size_t num_words = 1;
  while (num_words * kBitsPerWord < kBitsPerFacet * facet_hash.size()) num_words *= 2;
  std::vector<std::uint64_t> seen, seen_again;
  resize_watched(seen, num_words, std::uint64_t{0}, run);
  resize_watched(seen_again, num_words, std::uint64_t{0}, run);
  const auto word_of = [num_words](std::uint64_t hash) { return (hash >> 32) & (num_words - 1); };
  const auto bit_of = [](std::uint64_t hash) { return std::uint64_t{1} << (hash >> (64 - 6)); };
  // Of other facets there may be any number with one hash, none of which is another one again.
  const auto can_be_repeated = [&](Index f) {
    const std::array<Index, 3> v{mesh.triangles(f, 0), mesh.triangles(f, 1), mesh.triangles(f, 2)};
    if (!std::all_of(v.begin(), v.end(), [num_vertices](Index i) { return i >= 0 && i < num_vertices; })) return false;
    for (std::size_t k = 0; k < 3; ++k) {
      const Index a = v[k], b = v[(k + 1) % 3];
      if (vertex_hash[slot(a)] == kHashOfNaN && mesh.vertices[a].hasNaN()) return false;
      if (vertex_hash[slot(a)] == vertex_hash[slot(b)] && mesh.vertices[a] == mesh.vertices[b]) return false;
    }
    return true;
  };
  for (Index f = 0; f < num_facets; ++f) {
    ticker.tick();
    if (!can_be_repeated(f)) continue;
    std::uint64_t hash = 0;  // a sum: of no order
    for (int k = 0; k < 3; ++k) hash += vertex_hash[slot(mesh.triangles(f, k))];
    facet_hash[slot(f)] = hash *= kHashFactor;
    std::uint64_t& word = seen[word_of(hash)];
    seen_again[word_of(hash)] |= word & bit_of(hash);
    word |= bit_of(hash);
  }
  std::vector<Index> sifted;
  for (Index f = 0; f < num_facets; ++f) {
    ticker.tick();
    const std::uint64_t hash = facet_hash[slot(f)];
    if ((seen_again[word_of(hash)] & bit_of(hash)) != 0 && can_be_repeated(f)) sifted.push_back(f);
  }

  std::size_t capacity = 16;
  while (capacity < 2 * sifted.size()) capacity *= 2;
  std::vector<Index> table;  // open addressing
  resize_watched(table, capacity, kNone, run);
  std::vector<Index> result;
  Ticker looking(run, sifted.size(), kEdgesPerLook);
  for (const Index f : sifted) {
    looking.tick();
    const std::uint64_t hash = facet_hash[slot(f)];
    bool repeated = false;
    std::size_t at = (hash >> 32) & (capacity - 1);
    for (; table[at] != kNone && !repeated; at = (at + 1) & (capacity - 1)) {
      repeated = facet_hash[slot(table[at])] == hash && has_corners_of(mesh, f, table[at]);
    }
    if (repeated) {
      result.push_back(f);
    } else {
      table[at] = f;
    }
  }
  return result;
}

SurfaceEdges::Parts SurfaceEdges::make_parts(const MeshView& mesh, const Execution& run) {
  const std::vector<Index> first = first_equal_vertices(mesh, run.part(0, 0.3));
  Triangles triangles(mesh.num_facets());
  std::vector<char> counted(slot(mesh.num_facets()), 1);
  Ticker ticker(run.part(0.3, 0.4), counted.size(), kEdgesPerLook);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    ticker.tick();
    for (int k = 0; k < 3; ++k) triangles(f, k) = first[slot(mesh.triangles(f, k))];
    const auto row = triangles.row(f);
    if (row[0] == row[1] || row[1] == row[2] || row[2] == row[0]) counted[slot(f)] = 0;
  }
  std::vector<Index> repeated = find_repeated_facets(mesh, run.part(0.4, 0.5));
  for (const Index f : repeated) counted[slot(f)] = 0;
  MeshEdges edges(triangles, mesh.num_vertices(), counted, run.part(0.5, 0.8));
  return {std::move(triangles), mesh.num_vertices(), std::move(counted), std::move(repeated), std::move(edges)};
}

SurfaceEdges::SurfaceEdges(const MeshView& mesh, const Execution& run)
    : SurfaceEdges(make_parts(mesh, run), run.part(0.8, 1)) {}

SurfaceEdges::SurfaceEdges(Parts&& parts, const Execution& run)
    : triangles_(std::move(parts.triangles)),
      num_vertices_(parts.num_vertices),
      counted_(std::move(parts.counted)),
      repeated_(std::move(parts.repeated)),
      edges_(std::move(parts.edges)),
      edge_of_side_(edges_.edge_of_sides(run)) {}

}  // namespace amps::detail
