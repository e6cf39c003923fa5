// Bulk insertion by several threads gives the triangulation that one thread gives.
#include "amps/triangulation.h"

#include "kit/execution.h"
#include "kit/triangulations.h"

#include <doctest/doctest.h>

#include <functional>
#include <utility>

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

/// Runs everything on the calling thread, and keeps what of the progress is made meanwhile.
class ProgressWithin : public amps::Executor {
 public:
  ProgressWithin(unsigned concurrency, amps::Progress progress) : concurrency_(concurrency), progress_(std::move(progress)) {}
  unsigned concurrency() const override { return concurrency_; }
  void run(unsigned count, const std::function<void(unsigned)>& work) override {
    const double before = progress_.fraction();
    for (unsigned k = 0; k < count; ++k) work(k);
    within_ += progress_.fraction() - before;
  }
  double within() const { return within_; }

 private:
  unsigned concurrency_;
  amps::Progress progress_;
  double within_ = 0;
};

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

TEST_CASE("triangulation: points of a surface go in on all threads, whatever their number") {
  // Of a solid without symmetry: most cells reach through its inside, and meet some of the planes between many boxes. (0.03
  // where that made four threads and more give up.)
  Rng rng(6);
  const Sites sites = sites_of(made_points(50000, [&rng](Index) {
    const Vec3 u = on_unit_sphere(rng);
    return Vec3((1 + 0.3 * u.x() * u.y() + 0.2 * u.z() * u.z() * u.x()) * u);
  }));
  for (const unsigned threads : {2u, 4u, 8u, 16u, 64u}) {
    CAPTURE(threads);
    const amps::Progress progress;
    ProgressWithin executor(threads, progress);
    const RegularTriangulation several(sites.positions, sites.weights, amps::Execution(1, progress, &executor));
    CHECK(executor.within() > 0.5);
  }
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
