// Bulk insertion by several threads gives the triangulation that one thread gives.
#include "amps/triangulation.h"

#include "kit/execution.h"
#include "kit/triangulations.h"

#include <doctest/doctest.h>

namespace amps_test {

namespace {

void check_threads_agree(const Sites& sites) {
  const RegularTriangulation one(sites.positions, sites.weights, on_threads(1));
  const auto expected = cell_set(one);
  for (const unsigned threads : {2u, 3u, 7u}) {
    CAPTURE(threads);
    const RegularTriangulation several(sites.positions, sites.weights, on_threads(threads));
    CHECK(several.check() == "");
    CHECK(several.num_hidden() == one.num_hidden());
    CHECK(cell_set(several) == expected);
    Index other_states = 0;
    for (Index v = 0; v < one.num_vertices(); ++v) other_states += one.state(v) != several.state(v);
    CHECK(other_states == 0);
  }
}

// Enough for two and three threads to get a share of the last round.
constexpr Index kMany = 230000;

}  // namespace

TEST_CASE("triangulation: any number of threads gives the same cells, uniform points") {
  Rng rng(1);
  check_threads_agree(sites_of(made_points(kMany, [&rng](Index) { return random_point(rng); })));
}

TEST_CASE("triangulation: any number of threads gives the same cells, where the first round is divided among them too") {
  Rng rng(4);
  check_threads_agree(sites_of(made_points(9000, [&rng](Index) { return random_point(rng); })));
  check_threads_agree(sites_of(made_points(13000, [&rng](Index) { return on_unit_sphere(rng); })));
  const Points grid = made_points(30000, [&rng](Index) {
    return Vec3{double(rng.below(20)), double(rng.below(20)), double(rng.below(20))};
  });
  check_threads_agree({grid, made_values(30000, [&rng](Index) { return static_cast<double>(rng.below(3)) / 2; })});
}

TEST_CASE("triangulation: any number of threads gives the same cells, of points that planes do not divide") {
  Rng rng(5);
  const auto apart = [&rng](Index k) { return k % 1000 == 0 ? rng.uniform() : 0.0; };
  check_threads_agree(sites_of(made_points(15000, [&](Index k) { return Vec3{apart(k), rng.uniform(), rng.uniform()}; })));
  check_threads_agree(sites_of(made_points(15000, [&](Index k) { return Vec3{apart(k), apart(k), rng.uniform()}; })));
  // Most on one side of all cuts, in cells with far corners.
  check_threads_agree(sites_of(made_points(
      15000, [&](Index k) -> Vec3 { return k % 2000 == 0 ? Vec3(1e6 * random_point(rng)) : Vec3(on_unit_sphere(rng)); })));
}

TEST_SUITE("slow") {
  TEST_CASE("triangulation: any number of threads gives the same cells and states, with hidden points and duplicates") {
    Rng rng(2);
    const Points points = made_points(kMany, [&rng](Index) {
      return Vec3{double(rng.below(50)), double(rng.below(50)), double(rng.below(50))};
    });
    const Values weights = made_values(kMany, [&rng](Index) { return static_cast<double>(rng.below(3)) / 2; });
    check_threads_agree({points, weights});
  }

  TEST_CASE("triangulation: any number of threads gives the same cells, points on a surface and a cluster") {
    Rng rng(3);
    const auto scale = [](Index k) { return k % 4 == 0 ? 1e-6 : 1.0; };
    check_threads_agree(sites_of(made_points(kMany, [&](Index k) -> Vec3 { return scale(k) * on_unit_sphere(rng); })));
  }
}

}  // namespace amps_test
