#include "amps/site_tree.h"

#include "kit/points.h"
#include "kit/random.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <map>
#include <vector>

namespace amps_test {

using amps::detail::SiteTree;

TEST_CASE("site tree: searches find all sites that are near or heavy, each once, and none that has gone") {
  struct Site {
    Vec3 x;
    double weight;
  };
  Rng rng(3);
  for (const bool crowded : {false, true}) {
    CAPTURE(crowded);
    SiteTree tree({-1, -1, -1}, {1, 1, 1});
    std::map<Index, Site> model;
    const auto position = [&model](Index s) { return model.at(s).x; };
    Index num_large = 0;
    for (Index step = 0; step < 6000; ++step) {
      // Some outside of the box; where it is crowded many at a few places, more than a cube has room for.
      Vec3 x = 2.4 * (random_point(rng) - Vec3::Constant(0.5));
      if (crowded && rng.below(2) == 0) x = Vec3(0.25, 0.5, 0.125) * static_cast<double>(1 + rng.below(3)) / 3;
      model[step] = {x, rng.uniform() * rng.uniform()};
      tree.insert(x, model[step].weight, step, position);
      if (rng.below(3) == 0) {
        const auto gone = std::next(model.begin(), static_cast<std::ptrdiff_t>(rng.below(model.size())));
        tree.remove(gone->second.x, gone->first);
        model.erase(gone);
      }
      if (step % 100 != 0 || model.empty()) continue;
      const Vec3 from = 2.4 * (random_point(rng) - Vec3::Constant(0.5));
      const double reach = rng.uniform() * rng.uniform(), least_weight = rng.uniform();
      std::vector<Index> found;
      tree.visit(
          from, [&](double least, double, double weight) { return least <= reach || weight >= least_weight; },
          [&](Index s) { found.push_back(s); });
      num_large += found.size() > model.size() / 2 ? 1 : 0;
      std::sort(found.begin(), found.end());
      CHECK(std::adjacent_find(found.begin(), found.end()) == found.end());
      for (const Index s : found) CHECK(model.count(s) == 1);
      for (const auto& [s, site] : model) {
        const bool wanted = (site.x - from).norm() <= reach || site.weight >= least_weight;
        if (wanted) CHECK(std::binary_search(found.begin(), found.end(), s));
      }
      // The cube of a site has the site itself.
      const auto some = std::next(model.begin(), static_cast<std::ptrdiff_t>(rng.below(model.size())));
      const Vec3 at_some = some->second.x;
      bool has_itself = at_some.cwiseAbs().maxCoeff() > 1;
      tree.visit_cube(at_some, [&](Index s) { has_itself = has_itself || s == some->first; });
      CHECK(has_itself);
    }
    CHECK(num_large < 60);
  }
}

TEST_CASE("site tree: distances to cubes bound those to their sites") {
  Rng rng(4);
  SiteTree tree({0, 0, 0}, {1, 1, 1});
  std::vector<Vec3> positions;
  const auto position = [&positions](Index s) { return positions[static_cast<std::size_t>(s)]; };
  for (Index s = 0; s < 1000; ++s) {
    positions.push_back(random_point(rng).cwiseMax(0.0).cwiseMin(1.0));
    tree.insert(positions.back(), 0, s, position);
  }
  for (int k = 0; k < 20; ++k) {
    const Vec3 from = 3 * random_point(rng);
    double least_of_cube = 0, most_of_cube = 0;
    Index visited = 0;
    tree.visit(
        from,
        [&](double least, double most, double) {
          least_of_cube = least;
          most_of_cube = most;
          return true;
        },
        [&](Index s) {
          const double d = (position(s) - from).norm();
          CHECK(d >= least_of_cube);
          CHECK(d <= most_of_cube);
          ++visited;
        });
    CHECK(visited == 1000);
  }
}

}  // namespace amps_test
