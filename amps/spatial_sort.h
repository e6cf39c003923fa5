// spatial_sort.h (internal): the order in which points are inserted in bulk — rounds of growing size, random, each along a
// Hilbert curve (biased randomized insertion order: Amenta, Choi & Rote, "Incremental constructions con BRIO", 2003).
#pragma once

#include "amps/base.h"
#include "amps/buffers.h"
#include "amps/execution.h"
#include "amps/predicates.h"

#include <vector>

namespace amps::detail {

struct InsertionOrder {
  std::vector<Index> ids;         ///< the points in order of insertion
  std::vector<Index> round_ends;  ///< one past the last position of each round
};

/// The order for the given points; a function of the points and their ids alone, whatever the number of threads. O(n).
/// Cancelled, both throw Error(kCancelled).
InsertionOrder insertion_order(const std::vector<WeightedPoint>& points, std::vector<Index> ids,
                               const Execution& execution = {});

/// The ids 0 … #P − 1 in the order of the points along one curve: neighbours in the list are neighbours in space. O(n).
std::vector<Index> curve_order(const PointsView& points, const Execution& execution = {});

}  // namespace amps::detail
