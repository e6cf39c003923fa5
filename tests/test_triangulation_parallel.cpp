// Bulk insertion by several threads gives the triangulation that one thread gives.
#include <doctest/doctest.h>

#include "amps/base.h"
#include "amps/triangulation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace {

using amps::Index;
using amps::Points;
using amps::RegularTriangulation;
using amps::Rng;

std::vector<std::array<Index, 4>> sorted_cells(const RegularTriangulation& triangulation) {
  const auto cells = triangulation.cells();
  std::vector<std::array<Index, 4>> result(static_cast<std::size_t>(cells.rows()));
  for (Eigen::Index c = 0; c < cells.rows(); ++c) {
    auto& cell = result[static_cast<std::size_t>(c)];
    for (int k = 0; k < 4; ++k) cell[static_cast<std::size_t>(k)] = cells(c, k);
    std::sort(cell.begin(), cell.end());
  }
  std::sort(result.begin(), result.end());
  return result;
}

void check_threads_agree(const Points& points, const Eigen::VectorXd& weights) {
  const RegularTriangulation one(points, weights, 1);
  const auto expected = sorted_cells(one);
  for (const unsigned threads : {2u, 3u}) {
    CAPTURE(threads);
    const RegularTriangulation several(points, weights, threads);
    CHECK(several.check() == "");
    CHECK(several.num_hidden() == one.num_hidden());
    CHECK(sorted_cells(several) == expected);
    Index other_states = 0;
    for (Index v = 0; v < one.num_vertices(); ++v) other_states += one.state(v) != several.state(v);
    CHECK(other_states == 0);
  }
}

// Enough for two and three threads to get a share of the last round.
constexpr Eigen::Index kMany = 230000;

}  // namespace

TEST_CASE("triangulation: any number of threads gives the same cells, uniform points") {
  Rng rng(1);
  Points points(kMany, 3);
  for (Eigen::Index k = 0; k < points.size(); ++k) points.data()[k] = rng.uniform();
  check_threads_agree(points, Eigen::VectorXd::Zero(kMany));
}

TEST_SUITE("slow") {
  TEST_CASE("triangulation: any number of threads gives the same cells and states, with hidden points and duplicates") {
    Rng rng(2);
    Points points(kMany, 3);
    Eigen::VectorXd weights(kMany);
    for (Eigen::Index k = 0; k < points.size(); ++k) points.data()[k] = static_cast<double>(rng.below(50));
    for (double& w : weights) w = static_cast<double>(rng.below(3)) / 2;
    check_threads_agree(points, weights);
  }

  TEST_CASE("triangulation: any number of threads gives the same cells, points on a surface and a cluster") {
    Rng rng(3);
    Points points(kMany, 3);
    for (Eigen::Index k = 0; k < kMany; ++k) {
      const double z = 2 * rng.uniform() - 1, a = 6.283185307179586 * rng.uniform(), s = std::sqrt(1 - z * z);
      const double scale = k % 4 == 0 ? 1e-6 : 1.0;
      points.row(k) << scale * s * std::cos(a), scale * s * std::sin(a), scale * z;
    }
    check_threads_agree(points, Eigen::VectorXd::Zero(kMany));
  }
}
