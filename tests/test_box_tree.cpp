#include "amps/box_tree.h"

#include "kit/basics.h"
#include "kit/random.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <vector>

namespace amps_test {

using amps::detail::BoxItem;
using amps::detail::BoxTree;

namespace {

double least_distance(const BoxItem& item, const Vec3& x, double slope) {
  double sum = 0;
  for (int k = 0; k < 3; ++k) {
    const double d = std::max({0.0, item.min[k] - x[k], x[k] - item.max[k]});
    sum += d * d;
  }
  return item.value + slope * std::sqrt(sum);
}

std::vector<BoxItem> random_items(int n, Rng& rng) {
  std::vector<BoxItem> items;
  for (int k = 0; k < n; ++k) {
    const Vec3 a = random_point(rng), b = k % 3 == 0 ? a : Vec3(a + 0.1 * random_point(rng));
    items.push_back({a, b, k % 2 == 0 ? 0 : 0.2 * rng.uniform()});
  }
  return items;
}

}  // namespace

TEST_CASE("box_tree: visits all items below the bound, each once, and few others") {
  Rng rng(1);
  for (const int n : {0, 1, 2, 4, 5, 33, 2000}) {
    const std::vector<BoxItem> items = random_items(n, rng);
    const BoxTree tree(items);
    CHECK(tree.empty() == (n == 0));
    for (int k = 0; k < 50; ++k) {
      const Vec3 x = 2 * random_point(rng) - Vec3::Constant(0.5);
      const double slope = k % 2 == 0 ? 1 : 0.3, bound = 0.1 * rng.uniform();
      std::vector<int> visits(items.size(), 0);
      tree.search(x, slope, bound, [&](Index i, double&) { ++visits[at(i)]; });
      int below = 0;
      for (std::size_t i = 0; i < items.size(); ++i) {
        CHECK(visits[i] <= 1);
        if (!(least_distance(items[i], x, slope) < bound)) continue;
        CHECK(visits[i] == 1);
        ++below;
      }
      if (n == 2000 && slope == 1) CHECK(std::count(visits.begin(), visits.end(), 1) < 10 * below + 100);
    }
  }
}

TEST_CASE("box_tree: a bound that falls finds the least") {
  Rng rng(2);
  const std::vector<BoxItem> items = random_items(1000, rng);
  const BoxTree tree(items);
  for (int k = 0; k < 200; ++k) {
    const Vec3 x = 3 * random_point(rng) - Vec3::Constant(1);
    double least = kInfinity, found = kInfinity;
    int visits = 0;
    for (const BoxItem& item : items) least = std::min(least, least_distance(item, x, 1));
    tree.search(x, 1, kInfinity, [&](Index i, double& bound) {
      ++visits;
      found = bound = std::min(bound, least_distance(items[at(i)], x, 1));
    });
    CHECK(found == least);
    CHECK(visits < 200);
  }
}

}  // namespace amps_test
