// optimized.h: sets to optimise, and what optimisation promises of every state, counted anew from the samples alone.
#pragma once

#include "maximality.h"
#include "models.h"

#include "amps/optimize.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

using amps::OptimizeIteration;
using amps::OptimizeOptions;
using amps::OptimizeReport;
using amps::OptimizeResult;

/// Two spheres around one centre, at this distance: no border, so refills are tried in copies, which do not know the other
/// sheet.
inline Mesh two_spheres(double distance) { return joined(amps::make_sphere(320), amps::make_sphere(320, 1 + distance)); }

/// A maximal set, and what it was made with.
struct TestSet {
  std::string name;
  Mesh mesh;
  SizingField sizing;  ///< empty: uniform
  SampleSet samples;
};

inline TestSet uniform_set(const std::string& name, const Mesh& mesh, double count, std::uint64_t seed = 1) {
  return {name, mesh, {}, amps::sample(mesh, with_radius(radius_for(mesh, count), seed)).samples};
}

/// Radii of ratio 1:8 along the longest axis, as far as the gradation allows.
inline TestSet graded_set(const std::string& name, const Mesh& mesh, double count, double gradation = 0.1,
                          std::uint64_t seed = 1) {
  const Values radii = graded_radii(mesh, 8, longest_axis(mesh));
  const SizingField field = amps::for_count(amps::vertex_sizing(mesh, radii), count, gradation);
  return {name, mesh, field, amps::sample(mesh, with_sizing(field, seed)).samples};
}

/// Surfaces whose dual triangulations have no edge of more than two triangles (what is rated there is switched on late).
inline std::vector<TestSet> manifold_sets(double count) {
  return {uniform_set("sphere", amps::make_sphere(320), count),
          uniform_set("torus", amps::make_torus(1, 0.4, 48, 20), count),
          uniform_set("square", amps::make_square(4), count),
          uniform_set("moebius", moebius_strip(60, 6), count),
          graded_set("graded sphere", amps::make_sphere(1280), count),
          graded_set("graded torus", amps::make_torus(1, 0.4, 48, 20), count),
          graded_set("graded square", amps::make_square(16), count)};
}

/// Surfaces where it may have.
inline std::vector<TestSet> other_sets(double count) {
  const Mesh soup = random_soup(12, 401);
  const double r = radius_for(two_sheets(0), count);
  return {uniform_set("soup", soup, count),
          graded_set("graded soup", soup, count),
          uniform_set("book of 3 pages", open_book(3), count),
          uniform_set("two near sheets", two_sheets(0.4 * r), count),
          uniform_set("two sheets at 1.2 r", two_sheets(1.2 * r), count),
          uniform_set("bunny", data_mesh_or("bunny_3k_closed.off", amps::make_ellipsoid(1280, {1.0, 0.8, 0.6})), 2 * count)};
}

inline OptimizeOptions options_for(const TestSet& set, int iterations = 1000) {
  OptimizeOptions options;
  options.sizing = set.sizing;
  options.max_iterations = iterations;
  return options;
}

inline OptimizeResult optimized(const TestSet& set, const OptimizeOptions& options) {
  return amps::optimize(set.mesh, set.samples, options);
}

/// Maximal and Poisson-disk, by certificate and by all pairs; on its facets; of wanted radii.
inline void check_state(const TestSet& set, const SampleSet& samples) {
  const amps::MaximalityReport certificate = amps::verify_maximal(set.mesh, samples);
  CHECK(certificate.worst_coverage <= 1 + 1e-9);
  CHECK(certificate.worst_separation >= 1 - 1e-9);
  CHECK(separation_of_all_pairs(samples) >= 1 - 5e-13);
  REQUIRE(samples.facets.size() == at(samples.size()));
  REQUIRE(rows(samples.barycentrics) == samples.size());
  const MeshView mesh(set.mesh);
  const double least = set.sizing.empty() ? min_of(set.samples.radii) : set.sizing.min_radius();
  Index off = 0;
  double off_sum = 0, too_large = 0;
  for (Index s = 0; s < samples.size(); ++s) {
    const Vec3 b = barycentric_of(samples, s);
    const Index f = facet_of(samples, s);
    REQUIRE(f >= 0);
    REQUIRE(f < mesh.num_facets());
    REQUIRE(b.minCoeff() >= 0);
    const Vec3 there = b[0] * mesh.corner(f, 0) + b[1] * mesh.corner(f, 1) + b[2] * mesh.corner(f, 2);
    off += there != sample_at(samples, s);
    off_sum = std::max(off_sum, std::fabs(b.sum() - 1));
    const double wanted = set.sizing.empty() ? least : set.sizing.radius(f, b);
    too_large = std::max(too_large, samples.radii[s] / wanted);
  }
  CHECK(off == 0);  // derived, to the bit
  CHECK(off_sum <= 1e-14);
  CHECK(too_large <= 1 + 1e-12);
  CHECK(min_of(samples.radii) >= least * (1 - 1e-12));
}

/// What is bad in a triangulation, by a formula, a walk and a container of its own.
struct Badness {
  Index triangles = 0, vertices = 0;  ///< of the latter those that are no crossings
  Index crossings = 0;                ///< bad vertices on edges of more than two triangles
  double energy = 0, min_angle = 180, max_angle = 0;
};

/// Angles by the arc cosine, valences by sets of neighbours.
inline Badness badness(const Mesh& dual, const OptimizeReport& bounds, bool angles = true, bool valences = true) {
  Badness result;
  std::map<std::pair<Index, Index>, int> triangles_of_edge;
  std::vector<std::vector<std::array<Index, 2>>> link(at(rows(dual.vertices)));
  for (Index t = 0; t < rows(dual.triangles); ++t) {
    bool bad = false;
    for (int k = 0; k < 3; ++k) {
      const Index a = dual.triangles(t, k), b = dual.triangles(t, (k + 1) % 3), c = dual.triangles(t, (k + 2) % 3);
      ++triangles_of_edge[{std::min(a, b), std::max(a, b)}];
      link[at(a)].push_back({b, c});
      const Vec3 u = point_at(dual.vertices, b) - point_at(dual.vertices, a),
                 v = point_at(dual.vertices, c) - point_at(dual.vertices, a);
      const double cosine = u.dot(v) / (u.norm() * v.norm()), angle = std::acos(cosine) / kDegree;
      result.min_angle = std::min(result.min_angle, angle);
      result.max_angle = std::max(result.max_angle, angle);
      if (!angles) continue;
      const double low = bounds.min_angle, high = bounds.max_angle;
      if (angle < low) result.energy += 0.25 + (cosine - std::cos(low * kDegree)) / (std::sin(low * kDegree) * kDegree);
      if (angle > high) result.energy += 0.5 + 0.5 * (std::cos(high * kDegree) - cosine) / (std::sin(high * kDegree) * kDegree);
      bad = bad || angle < low || angle > high;
    }
    result.triangles += bad;
  }
  for (std::size_t v = 0; v < link.size() && valences; ++v) {
    std::set<Index> neighbors;
    int ends = 0;
    bool crossing = false;
    for (const auto& [a, b] : link[v]) neighbors.insert({a, b});
    for (const Index w : neighbors) {
      const int count = triangles_of_edge[{std::min(static_cast<Index>(v), w), std::max(static_cast<Index>(v), w)}];
      ends += count == 1;
      crossing = crossing || count > 2;
    }
    const int n = static_cast<int>(neighbors.size());
    if (crossing && ends == 0 && (n < 5 || n > 7)) ++result.crossings;
    if (neighbors.empty() || crossing || (ends != 0 && ends != 2)) continue;
    if (ends == 2) {  // one fan?
      std::set<Index> reached = {link[v][0][0]};
      for (std::size_t before = 0; before != reached.size();) {
        before = reached.size();
        for (const auto& [a, b] : link[v]) {
          if (reached.count(a) != 0 || reached.count(b) != 0) reached.insert({a, b});
        }
      }
      if (reached.size() != neighbors.size()) continue;
    }
    const int off = ends == 2 ? std::max(0, n - 5) : n < 5 ? 5 - n : std::max(0, n - 7);
    result.vertices += off != 0;
    result.energy += 5 * off;
  }
  return result;
}

inline Badness badness(const TestSet& set, const SampleSet& samples, const OptimizeReport& bounds, bool angles = true,
                       bool valences = true) {
  return badness(amps::restricted_triangulation(set.mesh, samples), bounds, angles, valences);
}

inline void check_line(const OptimizeIteration& line, const Badness& expected, const SampleSet& samples) {
  CHECK(line.bad_triangles == expected.triangles);
  CHECK(line.bad_vertices == expected.vertices + expected.crossings);
  CHECK(line.energy == doctest::Approx(expected.energy).epsilon(1e-7));  // the bounds are kept with a margin of 1e-9 degrees
  CHECK(line.samples == samples.size());
}

/// Survivors first, in order, to the bit; report.removed and .added; new ones are new.
inline void check_survivors(const SampleSet& before, const OptimizeResult& result) {
  const SampleSet& after = result.samples;
  const Index kept = before.size() - result.report.removed;
  REQUIRE(kept >= 0);
  REQUIRE(kept + result.report.added == after.size());
  Index from = 0;
  for (Index s = 0; s < kept; ++s, ++from) {
    while (from < before.size() && sample_at(before, from) != sample_at(after, s)) ++from;
    REQUIRE(from < before.size());
    REQUIRE(before.radii[from] == after.radii[s]);
    if (before.facets.empty()) {
      REQUIRE(facet_of(after, s) == kNone);
      continue;
    }
    REQUIRE(facet_of(before, from) == facet_of(after, s));
    REQUIRE(barycentric_of(before, from) == barycentric_of(after, s));
  }
  std::set<std::array<double, 3>> old;
  for (Index s = 0; s < before.size(); ++s)
    old.insert({before.positions(s, 0), before.positions(s, 1), before.positions(s, 2)});
  Index known = 0;
  for (Index s = kept; s < after.size(); ++s) {
    known += old.count({after.positions(s, 0), after.positions(s, 1), after.positions(s, 2)}) != 0;
  }
  CHECK(known == 0);
}

inline void check_never_rises(const OptimizeReport& report) {
  for (std::size_t k = 1; k < report.iterations.size(); ++k) {
    CAPTURE(k);
    CHECK(report.iterations[k].energy <= report.iterations[k - 1].energy * (1 + 1e-12));
  }
}

/// But for the seconds.
inline bool same_line(const OptimizeIteration& a, const OptimizeIteration& b) {
  return a.bad_triangles == b.bad_triangles && a.bad_vertices == b.bad_vertices && a.min_angle == b.min_angle &&
         a.max_angle == b.max_angle && a.samples == b.samples && a.energy == b.energy && a.work == b.work;
}

inline bool same_course(const OptimizeReport& a, const OptimizeReport& b) {
  return a.status == b.status && a.trials == b.trials && a.edits == b.edits && a.accepted == b.accepted &&
         a.removed == b.removed && a.added == b.added && a.iterations.size() == b.iterations.size() &&
         std::equal(a.iterations.begin(), a.iterations.end(), b.iterations.begin(), same_line);
}

/// All laws of one result.
inline void check_result(const TestSet& set, const OptimizeResult& result, bool rated_once = true) {
  check_state(set, result.samples);
  check_survivors(set.samples, result);
  if (result.report.status == Outcome::kCancelled) return;  // what was rated is older than the samples
  REQUIRE(!result.report.iterations.empty());
  const Badness before = badness(set, set.samples, result.report), after = badness(set, result.samples, result.report);
  const OptimizeIteration &first = result.report.iterations.front(), &last = result.report.iterations.back();
  CHECK(first.bad_triangles == before.triangles);
  CHECK(first.bad_vertices == before.vertices + before.crossings);
  CHECK(last.bad_triangles == after.triangles);
  CHECK(last.bad_vertices == after.vertices + after.crossings);
  if (rated_once) {
    check_line(result.report.iterations.front(), before, set.samples);
    check_line(result.report.iterations.back(), after, result.samples);
    CHECK(result.report.iterations.front().min_angle == doctest::Approx(before.min_angle).epsilon(1e-9));
    CHECK(result.report.iterations.front().max_angle == doctest::Approx(before.max_angle).epsilon(1e-9));
    const bool good = after.triangles + after.vertices == 0;
    CHECK((result.report.status == Outcome::kDone) == good);
    CHECK(result.report.iterations.back().min_angle == doctest::Approx(after.min_angle).epsilon(1e-9));
    CHECK(result.report.iterations.back().max_angle == doctest::Approx(after.max_angle).epsilon(1e-9));
    check_never_rises(result.report);
  }
}

}  // namespace amps_test
