// polygons.h (internal): polygons of files, cut into triangles.
//
// A polygon is seen along the axis of its Newell normal's largest component, where every decision is an exact orientation.
// Quads take the better of their diagonals, larger polygons stay the fan of their first corner where that tiles them, all
// others lose ears (Meisters, "Polygons have ears", 1975) until nothing is left. Crossings are found by a sweep (Shamos & Hoey,
// "Geometric intersection problems", 1976), corners in ears by a tree. Holes come as bridge edges, that is as edges
// the polygon goes along in both directions.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"

#include <cstddef>
#include <vector>

namespace amps::detail {

/// The corners of a polygon, seen along a coordinate axis.
struct ProjectedRing {
  const double* coordinates = nullptr;  ///< three to a vertex
  std::vector<Index> corners;           ///< without repetition
  int axis = 2, sense = 1;              ///< +1 if the polygon turns counter-clockwise as seen from the axis' positive end

  std::size_t size() const { return corners.size(); }
  const double* at(std::size_t k) const { return coordinates + 3 * slot(corners[k]); }
  /// The corner behind corner k.
  std::size_t after(std::size_t k) const { return k + 1 == corners.size() ? 0 : k + 1; }
  /// The sign of the turn from a over b to c, +1 for that of a convex corner.
  int turn(const double* a, const double* b, const double* c) const;
  int turn(std::size_t a, std::size_t b, std::size_t c) const { return turn(at(a), at(b), at(c)); }
  bool same_place(std::size_t a, std::size_t b) const;
};

/// Cuts polygons, one after the other; keeps its scratch memory.
class PolygonCutter {
 public:
  /// `coordinates` and what `execution` refers to must outlive this. Coordinates are finite, three to a vertex.
  PolygonCutter(const double* coordinates, const Execution& execution) : execution_(execution) {
    ring_.coordinates = coordinates;
  }

  /// Appends at most n − 2 triangles that tile the polygon of n ≥ 3 corners, oriented as it is, to `triangles`, three indices
  /// each. Corners that repeat the one before, by position, are left out of polygons of more than three. Corners on straight
  /// lines stay corners, and no triangle is degenerate unless the whole polygon is: that one becomes a fan.
  /// False if it crosses itself where it is projected: its triangles are then the fan, and cover more or less than it.
  /// O(n) time for fans, else about O(n log n), more where many ears in turn are kept from being cut by the same corners, and
  /// O(n) memory. Throws Error(kCancelled).
  bool cut(const Index* corners, std::size_t n, std::vector<Index>& triangles);

 private:
  bool fan_tiles() const;
  bool clip_ears(std::vector<Index>& triangles);
  void add(std::size_t a, std::size_t b, std::size_t c, std::vector<Index>& triangles) const {
    triangles.insert(triangles.end(), {ring_.corners[a], ring_.corners[b], ring_.corners[c]});
  }

  const Execution& execution_;
  ProjectedRing ring_;
  std::vector<std::size_t> next_, before_;  // the ring that is left
};

}  // namespace amps::detail
