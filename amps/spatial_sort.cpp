#define AMPS_OWN_SOURCE
#include "amps/spatial_sort.h"

#include "amps/execution.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace amps::detail {
namespace {

/// The 3D Hilbert curve as an automaton (Hamilton, "Compact Hilbert indices", 2006): a state is an entry corner and a
/// direction; an octant of the grid leads to its rank along the curve and the state inside it.
struct HilbertAutomaton {
  std::uint8_t rank[24][8]{};
  std::uint8_t next[24][8]{};

  constexpr HilbertAutomaton() {
    for (unsigned entry = 0; entry < 8; ++entry) {
      for (unsigned direction = 0; direction < 3; ++direction) {
        for (unsigned octant = 0; octant < 8; ++octant) {
          const unsigned gray = rotate_right(octant ^ entry, (direction + 1) % 3);
          unsigned w = gray ^ (gray >> 1);
          w ^= gray >> 2;
          const unsigned entry_of_w = w == 0 ? 0 : gray_code(2 * ((w - 1) / 2));
          const unsigned direction_of_w = w == 0 ? 0 : trailing_ones(w % 2 == 0 ? w - 1 : w) % 3;
          const unsigned next_entry = entry ^ rotate_left(entry_of_w, (direction + 1) % 3);
          const unsigned next_direction = (direction + direction_of_w + 1) % 3;
          rank[entry * 3 + direction][octant] = static_cast<std::uint8_t>(w);
          next[entry * 3 + direction][octant] = static_cast<std::uint8_t>(next_entry * 3 + next_direction);
        }
      }
    }
  }

  static constexpr unsigned gray_code(unsigned x) { return x ^ (x >> 1); }
  static constexpr unsigned rotate_right(unsigned x, unsigned k) { return ((x >> k) | (x << (3 - k))) & 7u; }
  static constexpr unsigned rotate_left(unsigned x, unsigned k) { return ((x << k) | (x >> (3 - k))) & 7u; }
  static constexpr unsigned trailing_ones(unsigned x) {
    unsigned n = 0;
    for (; (x & 1u) != 0; x >>= 1) ++n;
    return n;
  }
};
constexpr HilbertAutomaton kHilbert;

struct KeyedIndex {
  std::uint64_t key;
  Index index;
};

/// Stable sort by the low `bits` bits of the key, least significant digit first.
void radix_sort(std::vector<KeyedIndex>& items, int bits, const Execution& execution) {
  constexpr int kDigit = 11;
  const int passes = (bits + kDigit - 1) / kDigit;
  std::vector<KeyedIndex> other(items.size());
  for (int pass = 0; pass < passes; ++pass) {
    const int shift = pass * kDigit;
    const Execution part = execution.part(static_cast<double>(pass) / passes, static_cast<double>(pass + 1) / passes);
    std::size_t start[(1 << kDigit) + 1] = {};
    const auto digit = [shift](const KeyedIndex& item) { return (item.key >> shift) & ((1u << kDigit) - 1); };
    for_each_piece(items.size(), kElementsPerLook, part.part(0, 0.3), [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) ++start[digit(items[k]) + 1];
    });
    for (int d = 0; d < 1 << kDigit; ++d) start[d + 1] += start[d];
    for_each_piece(items.size(), kElementsPerLook, part.part(0.3, 1), [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) other[start[digit(items[k])]++] = items[k];
    });
    items.swap(other);
  }
}

constexpr double kRoundRatio =
    5.5;  // growth of the rounds: larger favours volumes (walks), smaller surfaces with hubs (cavities)
constexpr std::size_t kSortGrain = 1 << 14;
constexpr std::size_t kFirstRound = 2048;  // below this a further round costs more than its better hints save

/// Sorts order[begin, end) along the Hilbert curve of its own bounding box, in rounds if those are asked for; groups that fall
/// into one grid cell are sorted again by themselves, so clusters at any scale end up in order.
void hilbert_sort(const std::vector<WeightedPoint>& points, std::vector<Index>& order, std::size_t begin, std::size_t end,
                  InsertionOrder* rounds, const Execution& execution) {
  constexpr std::size_t kSmallGroup = 16;
  const std::size_t n = end - begin;
  if (rounds != nullptr) {
    rounds->round_ends.assign(1, static_cast<Index>(n));
  }
  if (n <= kSmallGroup) return;
  double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
  for_each_piece(n, kElementsPerLook, execution.part(0, 0.1), [&](std::size_t from, std::size_t to) {
    for (std::size_t k = begin + from; k < begin + to; ++k) {
      const WeightedPoint& p = points[static_cast<std::size_t>(order[k])];
      const double x[3] = {p.x, p.y, p.z};
      for (int a = 0; a < 3; ++a) {
        low[a] = std::min(low[a], x[a]);
        high[a] = std::max(high[a], x[a]);
      }
    }
  });
  // Halves, because the extent itself may overflow.
  const double extent = std::max({high[0] / 2 - low[0] / 2, high[1] / 2 - low[1] / 2, high[2] / 2 - low[2] / 2});
  if (!(extent > 0)) return;

  int levels = 3;
  while (levels < 18 && (std::size_t{1} << (2 * levels)) < 16 * n) ++levels;  // surfaces: n ~ 4^levels
  int round_count = 1;
  for (double size = static_cast<double>(n) / kRoundRatio; rounds != nullptr && size >= static_cast<double>(kFirstRound);
       size /= kRoundRatio) {
    ++round_count;
  }
  const double cells = static_cast<double>(1u << levels);
  std::vector<KeyedIndex> items(n);
  const auto keyed = [&](Index index) -> KeyedIndex {
    const WeightedPoint& p = points[static_cast<std::size_t>(index)];
    const double x[3] = {p.x, p.y, p.z};
    unsigned grid[3];
    for (int a = 0; a < 3; ++a) {
      const double t = (x[a] / 2 - low[a] / 2) / extent * cells;
      grid[a] = std::min(static_cast<unsigned>(t), (1u << levels) - 1);
    }
    std::uint64_t key = 0;
    unsigned state = 0;
    for (int level = levels - 1; level >= 0; --level) {
      const unsigned octant = ((grid[0] >> level) & 1u) | (((grid[1] >> level) & 1u) << 1) | (((grid[2] >> level) & 1u) << 2);
      key = (key << 3) | kHilbert.rank[state][octant];
      state = kHilbert.next[state][octant];
    }
    if (round_count > 1) {
      // A point is in the last round with probability 1 − 1/ratio, in the one before with 1/ratio of that, and so on.
      double u = static_cast<double>(scramble(static_cast<std::uint64_t>(index)) >> 11) * 0x1p-53;
      int round = round_count - 1;
      for (; round > 0 && u < 1 / kRoundRatio; --round) u *= kRoundRatio;
      key |= static_cast<std::uint64_t>(round) << (3 * levels);
    }
    return {key, index};
  };
  for_each_piece_on_all_threads(n, kSortGrain, execution.part(0.1, 0.4), [&](std::size_t from, std::size_t to) {
    for (std::size_t k = from; k < to; ++k) items[k] = keyed(order[begin + k]);
  });
  int bits = 3 * levels;
  for (int k = round_count - 1; k > 0; k >>= 1) ++bits;
  radix_sort(items, bits, execution.part(0.4, 0.8));
  if (rounds != nullptr) rounds->round_ends.clear();
  for_each_piece(n, kElementsPerLook, execution.part(0.8, 0.9), [&](std::size_t from, std::size_t to) {
    for (std::size_t k = from; k < to; ++k) {
      order[begin + k] = items[k].index;
      if (rounds == nullptr) continue;
      if (k + 1 == n || items[k].key >> (3 * levels) != items[k + 1].key >> (3 * levels)) {
        rounds->round_ends.push_back(static_cast<Index>(k + 1));
      }
    }
  });
  const Execution groups = execution.part(0.9, 1);
  Ticker ticker(groups, n, kElementsPerLook);
  for (std::size_t k = 0; k < n;) {
    std::size_t group_end = k + 1;
    while (group_end < n && items[group_end].key == items[k].key) ++group_end;
    if (group_end - k > kSmallGroup && group_end - k < n) {
      const double all = static_cast<double>(n);
      hilbert_sort(points, order, begin + k, begin + group_end, nullptr,
                   groups.part(static_cast<double>(k) / all, static_cast<double>(group_end) / all).on_one_thread());
    }
    ticker.tick(group_end - k);
    k = group_end;
  }
}

}  // namespace

InsertionOrder insertion_order(const std::vector<WeightedPoint>& points, std::vector<Index> ids, const Execution& execution) {
  InsertionOrder result;
  hilbert_sort(points, ids, 0, ids.size(), &result, execution);
  result.ids = std::move(ids);
  return result;
}

std::vector<Index> curve_order(const PointsView& points, const Execution& execution) {
  std::vector<WeightedPoint> sites(static_cast<std::size_t>(points.rows()));
  std::vector<Index> ids(sites.size());
  for_each_piece(sites.size(), kElementsPerLook, execution.part(0, 0.1), [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const Vec3 x = points[static_cast<std::ptrdiff_t>(k)];
      sites[k] = {x[0], x[1], x[2], 0};
      ids[k] = static_cast<Index>(k);
    }
  });
  hilbert_sort(sites, ids, 0, ids.size(), nullptr, execution.part(0.1, 1));
  return ids;
}

}  // namespace amps::detail
