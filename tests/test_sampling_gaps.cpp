// Gaps of sample sets made by amps or elsewhere: found, and filled until none is left.
#include "amps/sampling.h"

#include "kit/maximality.h"
#include "kit/models.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <vector>

namespace amps_test {

TEST_CASE("sampling: filling a set with holes keeps what is there and ends maximal") {
  for (const auto& model : procedural_models()) {
    CAPTURE(model.name);
    const auto& [name, mesh, radius] = model;
    const double r = 2 * radius;
    const SampleSet full = amps::sample(mesh, with_radius(r, 3)).samples;
    const Vec3 hole = sample_at(full, full.size() / 2);
    const SampleSet punched = selected(full, [&](Index s) { return (sample_at(full, s) - hole).norm() > 6 * r && s % 7 != 0; });
    REQUIRE(punched.size() < full.size() - 20);
    REQUIRE(!amps::verify_maximal(mesh, punched).maximal());
    const SamplingResult filled = amps::fill_gaps(mesh, punched, with_radius(0, 4));
    check_maximal(mesh, filled);
    CHECK(filled.report.radius == r);
    CHECK(filled.report.darts == 0);
    CHECK(filled.report.gap_samples == filled.samples.size() - punched.size());
    CHECK(same_set(head(filled.samples, punched.size()), punched));
    // What is maximal stays as it is.
    CHECK(same_set(amps::fill_gaps(mesh, full, with_radius(r, 4)).samples, full));
  }
}

TEST_CASE("sampling: filling a set from elsewhere: no facets, many radii, points off the surface") {
  const Mesh mesh = amps::make_sphere(1280);
  const SampleSet existing =  // the third and fourth too near
      bare_set(points_of({{0, 0, 1.02}, {0.9, 0, 0}, {0, -1, 0}, {0, -1, 0.01}, {-1.3, 0, 0}}),
               values_of({0.5, 0.3, 0.12, 0.1, 0.4}));
  for (const double radius : {0.0, 0.07}) {
    CAPTURE(radius);
    const SamplingResult filled = amps::fill_gaps(mesh, existing, with_radius(radius, 6));
    const SampleSet& set = filled.samples;
    CHECK(filled.status == Outcome::kDone);
    CHECK(filled.report.radius == (radius == 0 ? 0.1 : radius));
    CHECK(filled.report.unfilled_gaps == 0);
    REQUIRE(set.size() > 500);
    CHECK(same_bits(head(set.positions, 5), existing.positions));
    CHECK(same_values(head(set.radii, 5), existing.radii));
    CHECK(all_equal(tail(set.radii, set.size() - 5), filled.report.radius));
    for (Index s = 0; s < 5; ++s) {
      CHECK(facet_of(set, s) == kNone);
      CHECK(barycentric_of(set, s) == Vec3::Zero());
    }
    check_placement(mesh, selected(set, [](Index s) { return s >= 5; }));
    CHECK(covered_by_oracle(mesh, set));
    CHECK(amps::verify_maximal(mesh, set).maximal());
    // Every pair with a new sample keeps its distance.
    for (Index s = 5; s < set.size(); ++s) {
      for (Index t = 0; t < s; ++t) {
        const double distance = (sample_at(set, s) - sample_at(set, t)).norm();
        if (distance < std::max(set.radii[s], set.radii[t]) * (1 - 1e-9))
          FAIL("samples " << s << " and " << t << " are too near");
      }
    }
  }
}

TEST_CASE("sampling: gaps of a few parts in a billion are filled") {
  // One disk that all but reaches the corners of the square.
  const double half_diagonal = std::sqrt(0.5);
  for (const double missing : {1e-2, 1e-5, 1e-7, 1e-8, 2e-9}) {
    CAPTURE(missing);
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const Mesh mesh = amps::make_square(seed % 2 == 0 ? 1 : 3);
      const SampleSet middle = one_sample({0.5, 0.5, 0}, half_diagonal * (1 - missing));
      const SamplingResult filled = amps::fill_gaps(mesh, middle, with_radius(0, seed));
      CHECK(filled.samples.size() == 5);
      CHECK(filled.report.unfilled_gaps == 0);
      CHECK(amps::verify_maximal(mesh, filled.samples).maximal());
      CHECK(separation_of_all_pairs(filled.samples) >= 1 - 1e-9);
      check_placement(mesh, selected(filled.samples, [](Index s) { return s > 0; }));
    }
  }
}

TEST_CASE("sampling: find_gaps finds every uncovered point, and no more than there is") {
  Rng rng(11);
  for (const auto& model : procedural_models()) {
    CAPTURE(model.name);
    const auto& [name, mesh, radius] = model;
    const double r = 2 * radius;
    const SampleSet full = amps::sample(mesh, with_radius(r, 7)).samples;
    CHECK(amps::find_gaps(mesh, full).gaps == 0);
    CHECK(rows(amps::find_gaps(mesh, full).primitives.triangles) == 0);
    const SampleSet punched = selected(full, [](Index s) { return s % 4 != 0; });
    const amps::GapSet gaps = amps::find_gaps(mesh, punched);
    const MaximalityReport report = amps::verify_maximal(mesh, punched);
    CHECK(gaps.gaps == report.gaps);
    CHECK(gaps.area == doctest::Approx(report.gap_area).epsilon(1e-12));
    REQUIRE(gaps.facets.size() == at(rows(gaps.primitives.triangles)));
    const double primitives_area = amps::total_area(gaps.primitives);
    CHECK(primitives_area >= gaps.area * (1 - 1e-9));
    CHECK(primitives_area <= gaps.area * 2.0001);

    std::map<Index, std::vector<Index>> of_facet;
    for (Index t = 0; t < rows(gaps.primitives.triangles); ++t) of_facet[gaps.facets[at(t)]].push_back(t);
    // Barycentric coordinates, of the facet plane, against a primitive.
    const auto outside = [](const MeshView& m, Index t, const Vec3& x) {
      const Vec3 a = m.corner(t, 0), b = m.corner(t, 1), c = m.corner(t, 2), n = (b - a).cross(c - a);
      const double area = n.squaredNorm();
      const Vec3 w((b - x).cross(c - x).dot(n), (c - x).cross(a - x).dot(n), (a - x).cross(b - x).dot(n));
      return area > 0 ? -w.minCoeff() / area : 1.0;
    };
    for (Index t = 0; t < rows(gaps.primitives.triangles); ++t) {  // in their facet
      for (int k = 0; k < 3; ++k) {
        CHECK(outside(mesh, gaps.facets[at(t)], MeshView(gaps.primitives).corner(t, k)) <= 1e-9);
      }
    }
    const Cells cells(punched.positions, r);
    const SurfaceDraw surface(mesh);
    const int darts = 40000;
    int uncovered = 0, missed = 0;
    for (int d = 0; d < darts; ++d) {
      const amps::SurfacePoint drawn_point = surface(rng);
      const Vec3& x = drawn_point.position;
      bool covered = false;
      cells.around(x, [&](Index s) { covered = covered || (x - cells.position(s)).norm() <= r * (1 + 1e-9); });
      if (covered) continue;
      ++uncovered;
      double best = 1;
      for (const Index t : of_facet[drawn_point.facet]) best = std::min(best, outside(gaps.primitives, t, x));
      missed += best > 1e-6;
    }
    CHECK(missed == 0);
    const double fraction = gaps.area / amps::total_area(mesh);
    const double deviation = std::sqrt(fraction * (1 - fraction) / darts);
    CHECK(std::fabs(uncovered / double(darts) - fraction) <= 4 * deviation);
  }
}

}  // namespace amps_test
