// polygons.h (internal): polygons of files, cut into triangles.
//
// A polygon is seen along the axis of its Newell normal's largest component, where every decision is an exact orientation.
// Quads take the better of their diagonals, larger polygons stay the fan of their first corner where that tiles them, all
// others lose ears (Meisters, "Polygons have ears", 1975) until nothing is left. Holes come as bridge edges, that is as edges
// the polygon goes along in both directions.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"

#include <cstddef>
#include <vector>

namespace amps::detail {

/// Cuts polygons, one after the other; keeps its scratch memory.
class PolygonCutter {
 public:
  /// `coordinates` and what `execution` refers to must outlive this. Coordinates are finite, three to a vertex.
  PolygonCutter(const double* coordinates, const Execution& execution) : coordinates_(coordinates), execution_(execution) {}

  /// Appends at most n − 2 triangles that tile the polygon of n ≥ 3 corners, oriented as it is, to `triangles`, three indices
  /// each. Corners that repeat the one before, by position, are left out of polygons of more than three. Corners on straight
  /// lines stay corners, and no triangle is degenerate unless the whole polygon is: that one becomes a fan.
  /// False if it crosses itself where it is projected: its triangles are then the fan, and cover more or less than it.
  /// O(n) for fans, else O(n²) time at worst, O(n) memory. Throws Error(kCancelled).
  bool cut(const Index* corners, std::size_t n, std::vector<Index>& triangles);

 private:
  const double* at(std::size_t k) const { return coordinates_ + 3 * slot(ring_[k]); }
  int turn(std::size_t a, std::size_t b, std::size_t c) const;
  bool same_place(std::size_t a, std::size_t b) const;
  bool fan_tiles() const;
  bool crosses() const;
  bool is_ear(std::size_t a, std::size_t b, std::size_t c) const;
  bool clip_ears(std::vector<Index>& triangles);
  void add(std::size_t a, std::size_t b, std::size_t c, std::vector<Index>& triangles) const {
    triangles.insert(triangles.end(), {ring_[a], ring_[b], ring_[c]});
  }

  const double* coordinates_;
  const Execution& execution_;
  std::vector<Index> ring_;                 // the corners without repetition
  std::vector<std::size_t> next_, before_;  // the ring that is left
  int axis_ = 2, sense_ = 1;                // of the projection; +1 if the polygon turns counter-clockwise in it
};

}  // namespace amps::detail
