// A ball against a segment: laws, and the stages' agreement. tests/cgal_predicates_segments.cpp compares with rationals.
#include "amps/predicates.h"

#include "kit/random.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace amps_test {

using amps::segment_side_of_ball;
using amps::side_of_ball;
using amps::Stage;
using amps::StageTally;
using amps::detail::SegmentFilter;

TEST_CASE("segment against ball: touching between the ends, at an end, and a segment that is a point") {
  const double a[3] = {-3, 2, 0}, b[3] = {5, 2, 0}, c[3] = {3, 2, 1}, o[3] = {0, 0, 0};
  CHECK(segment_side_of_ball(a, b, o, 4) == 0);
  CHECK(segment_side_of_ball(a, b, o, std::nextafter(4, 5)) == -1);
  CHECK(segment_side_of_ball(a, b, o, std::nextafter(4, 3)) == 1);
  CHECK(segment_side_of_ball(b, c, o, 14) == 0);  // c is nearest
  CHECK(segment_side_of_ball(b, c, o, 13) == 1);
  CHECK(segment_side_of_ball(c, c, o, 14) == 0);
  CHECK(segment_side_of_ball(c, c, o, 15) == -1);
  CHECK(segment_side_of_ball(c, c, c, 0) == 0);
  CHECK(segment_side_of_ball(o, c, o, 0) == 0);
  CHECK(segment_side_of_ball(o, c, o, -1) == 1);
  CHECK(segment_side_of_ball(o, c, o, -std::numeric_limits<double>::denorm_min()) == 1);
  const double far_away[3] = {3e200, 4e200, 0}, beyond[3] = {3e200, -4e200, 0}, tiny[3] = {1e-200, 0, 0};
  CHECK(segment_side_of_ball(far_away, beyond, o, 1e300) == 1);
  CHECK(segment_side_of_ball(far_away, o, o, 1e-300) == -1);
  CHECK(segment_side_of_ball(tiny, far_away, o, 0) == 1);
  CHECK(segment_side_of_ball(tiny, far_away, o, std::numeric_limits<double>::denorm_min()) == -1);
}

TEST_CASE("segment against ball: ends can be swapped, weights only help, ends and points between are no nearer") {
  Rng rng(1);
  StageTally tally;
  int filter_wrong = 0;
  for (int n = 0; n < 20000; ++n) {
    const bool lattice = n % 2 == 0;
    const double scale = std::ldexp(1.0, static_cast<int>(rng.below(5)) * 200 - 400);
    std::array<Vec3, 3> x;
    for (Vec3& v : x) {
      v = lattice ? Vec3(below(rng, 9), below(rng, 9), below(rng, 9)) : random_point(rng);
      v *= scale;
    }
    if (n % 4 == 1) x[0] *= 0x1p-20;
    const double *a = x[0].data(), *b = x[1].data(), *p = x[2].data();
    double w = lattice ? below(rng, 40) * scale * scale : rng.uniform() * 0.3 * scale * scale;
    if (n % 3 == 0) {  // beside the line
      const Vec3 u = (x[1] - x[0]).stableNormalized();
      w = (x[2] - x[0]).cross(u).squaredNorm();
    }
    const int side = segment_side_of_ball(a, b, p, w, &tally);
    REQUIRE(segment_side_of_ball(b, a, p, w) == side);
    Stage stage;
    REQUIRE(amps::detail::segment_side_of_ball_exact(a, b, p, w, stage) == side);
    const SegmentFilter filter(p, w);
    const int filtered = filter.side(filter.end(b), filter.end(a));
    filter_wrong += filtered != 0 && filtered != side;
    REQUIRE(side <= std::min(side_of_ball(a, p, w), side_of_ball(b, p, w)));
    if (lattice && n % 3 != 0) {  // the midpoint is exact
      const Vec3 middle = (x[0] + x[1]) / 2;
      REQUIRE(side <= side_of_ball(middle.data(), p, w));
    }
    REQUIRE(segment_side_of_ball(a, b, p, std::nextafter(w, kInfinity)) <= (side == 0 ? -1 : side));
    REQUIRE(segment_side_of_ball(a, b, p, std::nextafter(w, -kInfinity)) >= (side == 0 ? 1 : side));
    REQUIRE(segment_side_of_ball(a, a, p, w) == side_of_ball(a, p, w));
  }
  CHECK(filter_wrong == 0);
  for (const Stage stage : {Stage::kFilter, Stage::kExactDouble, Stage::kExactNarrow, Stage::kExactMiddle}) {
    CAPTURE(int(stage));
    CHECK(tally[stage] > 0);
  }
}

}  // namespace amps_test
