// self_intersections.h: which facets of a mesh cross, touch or overlap where the mesh does not join them.
//
//   amps::SelfIntersectionReport found = amps::find_self_intersections(mesh);
//   if (!found.empty()) std::cout << found << "\n";
//
// Decided exactly for the doubles as given, by signs of orientations alone: two triangles meet where an edge of one meets the
// other, and whether it does are the orientations of the edge's ends and of the edge with each side (Guigue & Devillers, "Fast
// and robust triangle-triangle overlap test using orientation predicates", 2003, whose decision tree we do without). In one
// plane the same is asked of projections that drop a coordinate, which is exact too. Pairs whose boxes overlap are found in a
// tree over the facets in the order of a space-filling curve.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"

#include <cstdint>
#include <iosfwd>
#include <vector>

namespace amps {

struct SelfIntersectionOptions {
  /// Pairs to return, ≥ 0: the first ones in order. All are counted in any case. 8 bytes each, a few times that while at work.
  Index max_pairs = 1'000'000;
  /// Threads, progress and cancelling. The result does not depend on the threads.
  Execution execution;
};

/// Two facets that intersect.
struct SelfIntersection {
  Index a, b;  ///< a < b
  bool operator==(const SelfIntersection& other) const { return a == other.a && b == other.b; }
  bool operator<(const SelfIntersection& other) const { return a != other.a ? a < other.a : b < other.b; }
};

struct SelfIntersectionReport {
  std::vector<SelfIntersection> pairs;  ///< ascending, each once; at most max_pairs
  std::int64_t num_pairs = 0;           ///< all there are
  Index degenerate_facets = 0;          ///< left out: their corners are exactly in one line
  Index repeated_facets = 0;            ///< left out: an earlier facet has the same corners
  bool empty() const { return num_pairs == 0; }
};

/// Pairs of facets that have a point in common which is neither a vertex nor on an edge of both. Facets are closed, so touching
/// counts: a corner on another facet or within its edge (T-junctions), edges that cross or lie on each other without being one
/// edge. Vertices of equal position are one (−0 equals 0). That is, two facets
///   - without a common vertex intersect if they have any point in common;
///   - with one common vertex, if they meet in anything else than that;
///   - with two, a common edge, if they lie in one plane and on the same side of it.
/// Orientation plays no part. Facets without area (exactly collinear corners, repeated indices) are left out, as they are no
/// part of the surface, and so is a facet with the three corners of an earlier one, whatever its orientation: the first copy
/// stands for all. Both are counted. CGAL's self_intersections() finds the same pairs, but for what is left out here, of which
/// it reports facets without area as pairs with themselves, and for vertices of equal position, which it takes for different
/// ones.
///
/// Throws Error(kInvalidMesh) for an index out of range or a corner that is NaN or infinite, Error(kInvalidArgument) for a
/// negative max_pairs; kTooLarge, kCancelled. No facet at all is fine. O(n log n + boxes that overlap) for n facets, about
/// 1 µs a facet of a mesh without self-intersections; some 200 bytes a facet. Thread-safe.
AMPS_EXPORT SelfIntersectionReport find_self_intersections(const MeshView& mesh, const SelfIntersectionOptions& options = {});

/// In a line: how many pairs, and the first of them.
AMPS_EXPORT std::ostream& operator<<(std::ostream& out, const SelfIntersectionReport& report);

}  // namespace amps

#include "amps/host_macros_end.h"
