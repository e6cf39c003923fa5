#include "amps/samples.h"

#include "kit/meshes.h"
#include "kit/samples.h"

#include "amps/sampling.h"
#include "amps/shapes.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <vector>

namespace amps_test {

using amps::SurfacePoint;
using amps::detail::GrowingSet;

namespace {

/// Rows from `first` on whose position is not b0·c0 + b1·c1 + b2·c2, each operation rounded.
int not_derived(const Mesh& mesh, const SampleSet& set, Index first = 0) {
  int result = 0;
  for (Index s = first; s < set.size(); ++s) {
    const Index facet = facet_of(set, s);
    for (int axis = 0; axis < 3; ++axis) {
      double term[3];
      for (int k = 0; k < 3; ++k) term[k] = set.barycentrics(s, k) * mesh.vertices(mesh.triangles(facet, k), axis);
      const double two = term[0] + term[1];
      result += two + term[2] != set.positions(s, axis);
    }
  }
  return result;
}

SampleSet every_second(const SampleSet& set) {
  GrowingSet result;
  for (Index s = 0; s < set.size(); s += 2) result.add(amps::detail::sample_of(set, s));
  return result.finish();
}

}  // namespace

TEST_CASE("samples: every position is derived from facet and barycentrics, bit for bit") {
  const Mesh torus = moved(amps::make_torus(), {1.0 / 3, -100.0 / 7, 1e3});  // coordinates that do not fit in few bits
  for (const Mesh& mesh : {torus, amps::make_cube(3)}) {
    const double size = amps::bounding_box(mesh).diagonal();
    const amps::SizingField varying = amps::function_sizing(mesh, [&](const SurfacePoint& at) {
                                        return size * (0.02 + 0.02 * std::fabs(std::sin(at.position.x())));
                                      }).limited(0.3);
    for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
      for (const int kind : {0, 1, 2, 3}) {
        SamplingOptions options;
        options.conflict_rule = rule;
        options.seed = 5;
        if (kind == 0) options.radius = 0.03 * size;
        if (kind == 1) options.sizing = varying;
        if (kind == 2) options.sizing = amps::uniform_sizing(mesh, 0.03 * size);
        if (kind == 3) options.target_count = 500;
        const SampleSet set = amps::sample(mesh, options).samples;
        REQUIRE(set.size() > 300);
        CHECK(not_derived(mesh, set) == 0);
        if (kind == 3) continue;
        CHECK(not_derived(mesh, amps::throw_darts(mesh, options).samples) == 0);

        const SampleSet half = every_second(set);
        options.radius = 0;
        const SampleSet filled = amps::fill_gaps(mesh, half, options).samples;
        REQUIRE(filled.size() > half.size() + 50);
        CHECK(not_derived(mesh, filled) == 0);
      }
    }
  }
}

TEST_CASE("samples: the point below a point of a facet is that point, and derived as all are") {
  Rng rng(2);
  for (int trial = 0; trial < 2000; ++trial) {
    const Points corners = made_points(3, [&rng](Index) { return Vec3{rng.uniform(), rng.uniform(), 100 + rng.uniform()}; });
    const Mesh mesh{corners, triangles_of({{0, 1, 2}})};
    const SurfacePoint at = amps::detail::surface_point_at(mesh, 0, amps::uniform_barycentric(rng));
    const SurfacePoint below = amps::detail::surface_point_below(mesh, 0, at.position);
    REQUIRE(below.facet == 0);
    REQUIRE(below.barycentric.minCoeff() >= 0);
    REQUIRE(std::fabs(below.barycentric.sum() - 1) < 1e-15);
    REQUIRE(below.position == amps::detail::position_of(mesh, below));
    REQUIRE((below.position - at.position).norm() < 1e-12);
  }
  // Beside the facet: its nearest barycentrics that are not negative.
  const Mesh square = amps::make_square(1);
  const SurfacePoint outside =
      amps::detail::surface_point_below(square, 0, MeshView(square).corner(0, 0) + Vec3(-1e-3, -1e-3, 0));
  CHECK(outside.barycentric.minCoeff() >= 0);
}

TEST_CASE("samples: a growing set keeps what it is given, and takes a new order") {
  SampleSet set = bare_set(points_of({{1, 2, 3}, {4, 5, 6}, {7, 8, 9}}), values_of({0.1, 0.2, 0.3}));
  set.facets = {5, 6, 7};
  set.barycentrics = points_of({{0.5, 0.25, 0.25}, {1, 0, 0}, {0, 0.5, 0.5}});
  GrowingSet growing;
  growing.add_all(set);
  growing.reorder({2, 0, 1});
  const SampleSet result = GrowingSet(growing).finish();  // which gives its content away
  const Index order[] = {2, 0, 1};
  REQUIRE(result.size() == 3);
  for (Index s = 0; s < 3; ++s) {
    CHECK(sample_at(result, s) == sample_at(set, order[s]));
    CHECK(result.radii[s] == set.radii[order[s]]);
    CHECK(facet_of(result, s) == facet_of(set, order[s]));
    CHECK(barycentric_of(result, s) == barycentric_of(set, order[s]));
    CHECK(growing[s].position() == growing.position(s));
    CHECK(growing[s].at.facet == facet_of(result, s));
  }

  GrowingSet unplaced;
  unplaced.add_all(bare_set(set.positions, set.radii));
  const SampleSet whole = unplaced.finish();
  CHECK(whole.facets == std::vector<Index>(3, kNone));
  CHECK(same_values(whole.barycentrics, constant_points(3, 0)));
  CHECK(same_bits(whole.positions, set.positions));
}

}  // namespace amps_test
