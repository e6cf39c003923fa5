// Trial patches against the dual triangulation itself. In a plane their dual points are the true ones.
#include "amps/trial_patch.h"

#include "kit/models.h"
#include "kit/samples.h"

#include "amps/maximality.h"
#include "amps/remesh.h"
#include "amps/sampling.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <utility>
#include <vector>

namespace amps_test {

using amps::detail::DualRating;
using amps::detail::TrialPatch;

namespace {

constexpr double kLow = 35, kHigh = 105;
/// Who is around whom.
struct Dual {
  Mesh mesh;
  std::vector<std::vector<Index>> ring;  ///< cyclic; empty: not a disk
  std::vector<std::set<Index>> neighbors;

  explicit Dual(Mesh dual) : mesh(std::move(dual)) {
    const std::size_t n = at(rows(mesh.vertices));
    std::vector<std::map<Index, Index>> next(n);
    neighbors.resize(n);
    ring.resize(n);
    for (Index t = 0; t < rows(mesh.triangles); ++t) {
      for (int k = 0; k < 3; ++k) {
        const Index a = mesh.triangles(t, k), b = mesh.triangles(t, (k + 1) % 3), c = mesh.triangles(t, (k + 2) % 3);
        next[at(a)][b] = c;
        neighbors[at(a)].insert({b, c});
      }
    }
    for (std::size_t v = 0; v < n; ++v) {
      std::vector<Index> walk;
      if (next[v].empty()) continue;
      for (Index w = next[v].begin()->first; walk.size() <= next[v].size();) {
        walk.push_back(w);
        const auto found = next[v].find(w);
        if (found == next[v].end()) break;
        w = found->second;
        if (w == walk.front()) {
          ring[v] = walk;
          break;
        }
      }
      if (ring[v].size() != neighbors[v].size()) ring[v].clear();
    }
  }

  /// Of all triangles, and of the valences of inner vertices.
  double energy(const DualRating& rating) const {
    double sum = 0;
    const auto x = [&](Index t, int k) -> Vec3 { return MeshView(mesh).corner(t, k); };
    for (Index t = 0; t < rows(mesh.triangles); ++t) sum += rating.triangle(x(t, 0), x(t, 1), x(t, 2));
    for (std::size_t v = 0; v < ring.size(); ++v) {
      if (!ring[v].empty()) sum += rating.valence(static_cast<int>(neighbors[v].size()), false);
    }
    return sum;
  }
};

/// The stars of these samples and of their neighbours; false where there is no room, or one of them is not a disk.
bool copy_patch(const SampleSet& set, const Dual& dual, const std::vector<Index>& removed, TrialPatch& patch,
                std::vector<Index>& ids) {
  patch.clear();
  ids = removed;
  const auto add = [&ids](Index s) {
    if (std::find(ids.begin(), ids.end(), s) == ids.end()) ids.push_back(s);
  };
  for (const Index s : removed) {
    if (dual.ring[at(s)].empty()) return false;
    for (const Index t : dual.ring[at(s)]) add(t);
  }
  const std::size_t inner = ids.size();
  std::set<std::array<Index, 3>> triangles;
  for (std::size_t v = 0; v < inner; ++v) {
    const std::vector<Index>& ring = dual.ring[at(ids[v])];
    if (ring.empty()) return false;
    for (std::size_t k = 0; k < ring.size(); ++k) {
      add(ring[k]);
      std::array<Index, 3> t = {ids[v], ring[k], ring[(k + 1) % ring.size()]};
      std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
      triangles.insert(t);
    }
  }
  for (const Index s : ids) {
    const auto size = static_cast<int>(dual.ring[at(s)].size());
    if (!patch.add_vertex(sample_at(set, s), set.radii[s] * set.radii[s], size, size > 0)) return false;
  }
  const auto local = [&ids](Index s) { return static_cast<int>(std::find(ids.begin(), ids.end(), s) - ids.begin()); };
  for (const auto& t : triangles) {
    if (!patch.add_triangle(local(t[0]), local(t[1]), local(t[2]))) return false;
  }
  patch.close();
  return true;
}

struct Tally {
  int trials = 0;      ///< refills
  int followed = 0;    ///< that the patch could follow
  int right = 0;       ///< and gave the true change of the energy for
  int gaps_right = 0;  ///< and the true answer about gaps
};

/// Random patches of a set, removed and refilled at random; what the copy says against a triangulation made anew. Measured: of
/// 400 patches with equal radii it followed 399, all of them right in energy and gaps; with graded radii 399, 399 right in
/// energy and 397 in gaps.
Tally compare(const Mesh& mesh, const SampleSet& set, const amps::SizingField& field, int patches, std::uint64_t seed) {
  const DualRating rating(true, true, kLow, kHigh);
  const Dual before(amps::restricted_triangulation(mesh, set));
  const double energy_before = before.energy(rating);
  Rng rng(seed);
  Tally tally;
  TrialPatch patch(rating);
  std::vector<Index> ids;
  while (patches > 0) {
    std::vector<Index> removed = {below(rng, set.size())};
    const auto wanted = static_cast<std::size_t>(1 + rng.below(4));
    for (int k = 0; k < 8 && removed.size() < wanted; ++k) {
      const std::vector<Index>& ring = before.ring[at(removed[rng.below(removed.size())])];
      if (ring.empty()) break;
      const Index s = ring[rng.below(ring.size())];
      if (std::find(removed.begin(), removed.end(), s) == removed.end()) removed.push_back(s);
    }
    if (!copy_patch(set, before, removed, patch, ids)) continue;
    --patches;
    const double patch_before = patch.energy();
    bool follows = true;
    for (std::size_t k = 0; k < removed.size() && follows; ++k) follows = patch.remove(static_cast<int>(k));
    // Darts over the holes until many in a row are rejected.
    std::vector<Vec3> x;
    std::vector<double> r;
    const auto darts = static_cast<int>(rng.below(4) == 0 ? 1 + rng.below(4) : 400);  // or stop early: then there may be a gap
    for (int rejected = 0; rejected < darts;) {
      const Index hole = removed[rng.below(removed.size())];
      const double reach = 2 * set.radii[hole];
      const Vec3 dart = sample_at(set, hole) + reach * Vec3(2 * rng.uniform() - 1, 2 * rng.uniform() - 1, 0);
      bool free = dart[0] > 0 && dart[0] < 1 && dart[1] > 0 && dart[1] < 1;
      double nearest = kInfinity;
      for (Index s = 0; s < set.size(); ++s) {
        if (std::find(removed.begin(), removed.end(), s) != removed.end()) continue;
        const double d = (sample_at(set, s) - dart).norm();
        free = free && d >= set.radii[s];
        nearest = std::min(nearest, d);
      }
      for (std::size_t k = 0; k < x.size(); ++k) {
        free = free && (x[k] - dart).norm() >= r[k];
        nearest = std::min(nearest, (x[k] - dart).norm());
      }
      if (!free) {
        ++rejected;
        continue;
      }
      const double wanted_radius = field.empty() ? set.radii[0] : set.radii[hole];
      x.push_back(dart);
      r.push_back(std::min(wanted_radius, nearest * (1 - 1e-12)));
      follows = follows && patch.insert(dart, r.back() * r.back());
    }
    ++tally.trials;
    if (!follows) continue;
    ++tally.followed;
    const SampleSet kept =
        selected(set, [&](Index s) { return std::find(removed.begin(), removed.end(), s) == removed.end(); });
    const Values radii = made_values(static_cast<Index>(r.size()), [&r](Index k) { return r[at(k)]; });
    const SampleSet changed = bare_set(joined(kept.positions, points_of(x)), joined(kept.radii, radii));
    const Dual after(amps::restricted_triangulation(mesh, changed));
    const double expected = after.energy(rating) - energy_before, found = patch.energy() - patch_before;
    tally.right += std::fabs(found - expected) <= 1e-6;
    // Gaps inside the square are at dual points; nearly covered ones count as covered.
    const double coverage = amps::verify_maximal(mesh, changed).worst_coverage;
    tally.gaps_right += patch.has_gap() == (coverage > std::sqrt(1.01)) || std::fabs(coverage - std::sqrt(1.01)) < 1e-6;
  }
  return tally;
}

}  // namespace

TEST_CASE("trial_patch: in the plane, equal radii, it follows the dual triangulation") {
  const Mesh mesh = amps::make_square(1);
  const SampleSet set = amps::sample(mesh, with_radius(radius_for(mesh, 400))).samples;
  const Tally tally = compare(mesh, set, {}, 150, 501);
  CHECK(tally.followed >= 0.97 * tally.trials);
  CHECK(tally.right >= 0.99 * tally.followed);
  CHECK(tally.gaps_right >= 0.99 * tally.followed);
}

TEST_CASE("trial_patch: in the plane, graded radii, it follows the dual triangulation") {
  const Mesh mesh = amps::make_square(8);
  const SizingField field = amps::for_count(amps::vertex_sizing(mesh, graded_radii(mesh, 8, 0)), 400, 0.1);
  const Tally tally = compare(mesh, amps::sample(mesh, with_sizing(field)).samples, field, 150, 502);
  CHECK(tally.followed >= 0.97 * tally.trials);
  CHECK(tally.right >= 0.98 * tally.followed);
  CHECK(tally.gaps_right >= 0.98 * tally.followed);
}

namespace {

/// A hexagon of unit triangles around vertex 0 (and a second ring of twelve), each vertex with its neighbours in this patch.
TrialPatch hexagons(const DualRating& rating, bool second_ring, double weight = 1) {
  TrialPatch patch(rating);
  std::vector<Vec3> x;
  const auto ring = [&](int steps, double radius, double turn) {
    for (int k = 0; k < steps; ++k) {
      const double angle = 2 * kPi * k / steps + turn;
      x.push_back(Vec3(radius * std::cos(angle), radius * std::sin(angle), 0));
    }
  };
  x.push_back(Vec3::Zero());
  ring(6, 1, 0);
  if (second_ring) {
    for (int k = 0; k < 6; ++k) {
      const Vec3 a = x[static_cast<std::size_t>(1 + k)], b = x[static_cast<std::size_t>(1 + (k + 1) % 6)];
      x.push_back(2 * a);
      x.push_back(a + b);
    }
  }
  std::vector<std::array<int, 3>> triangles;
  for (int k = 0; k < 6; ++k) {
    const int a = 1 + k, b = 1 + (k + 1) % 6;
    triangles.push_back({0, a, b});
    if (!second_ring) continue;
    const int far_a = 7 + 2 * k, middle = far_a + 1, far_b = 7 + 2 * ((k + 1) % 6);
    triangles.push_back({a, far_a, middle});
    triangles.push_back({a, middle, b});
    triangles.push_back({b, middle, far_b});
  }
  std::vector<int> neighbors(x.size(), 6);
  for (std::size_t v = 0; v < x.size(); ++v) REQUIRE(patch.add_vertex(x[v], weight, neighbors[v], true));
  for (const auto& t : triangles) REQUIRE(patch.add_triangle(t[0], t[1], t[2]));
  patch.close();
  return patch;
}

}  // namespace

TEST_CASE("trial_patch: a hexagonal lattice is perfect; without a vertex it has a gap, put back it is as before") {
  const DualRating rating(true, true, kLow, kHigh);
  constexpr double kWeight = 0.8;  // with 1 the disks around a hole just cover its centre
  TrialPatch patch = hexagons(rating, true, kWeight);
  CHECK(patch.num_vertices() == 19);
  CHECK(patch.energy() == 0);
  CHECK(!patch.has_gap());
  const TrialPatch copy(patch);
  REQUIRE(patch.remove(0));
  CHECK(patch.has_gap());
  CHECK(patch.energy() > 0);
  REQUIRE(patch.insert(Vec3::Zero(), kWeight));
  CHECK(patch.energy() == doctest::Approx(0));
  CHECK(!patch.has_gap());
  CHECK(patch.num_vertices() == 20);
  CHECK(patch.position(19) == Vec3::Zero());
  CHECK(patch.weight(19) == kWeight);
  CHECK(copy.energy() == 0);  // a value
  CHECK(copy.num_vertices() == 19);
}

TEST_CASE("trial_patch: it refuses where the border is reached") {
  const DualRating rating(true, true, kLow, kHigh);
  for (const bool second_ring : {false, true}) {
    const TrialPatch patch = hexagons(rating, second_ring);
    const double edge = second_ring ? 2 : 1;
    TrialPatch outside = patch;
    CHECK_FALSE(outside.insert(Vec3(10, 0, 0), 1));  // no triangle makes way
    TrialPatch at_edge = patch;
    CHECK_FALSE(at_edge.insert(edge * Vec3(0.75, 0.4, 0), 1));  // beside an edge of the border
    TrialPatch rim = patch;
    CHECK_FALSE(rim.remove(second_ring ? 7 : 1));  // a half disk
    TrialPatch inside = patch;
    CHECK(inside.insert(Vec3(0.3, 0.25, 0), 1) == second_ring);
  }
}

TEST_CASE("trial_patch: it refuses when it is full") {
  const DualRating rating(true, true, kLow, kHigh);
  TrialPatch patch(rating);
  for (int v = 0; v < TrialPatch::kMaxVertices; ++v) REQUIRE(patch.add_vertex(Vec3(v, v * v, 0), 1, 6, true));
  CHECK_FALSE(patch.add_vertex(Vec3(-1, -1, 0), 1, 6, true));
  CHECK(patch.num_vertices() == TrialPatch::kMaxVertices);
  for (int t = 0; t < TrialPatch::kMaxTriangles; ++t) REQUIRE(patch.add_triangle(t % 60, t % 60 + 1, t % 60 + 3));
  CHECK_FALSE(patch.add_triangle(0, 1, 2));
  patch.clear();
  CHECK(patch.num_vertices() == 0);
  CHECK(patch.energy() == 0);
  CHECK(patch.add_vertex(Vec3::Zero(), 1, 6, true));
  // The last vertex there is room for is the last that can come.
  TrialPatch crowded = hexagons(rating, true);
  for (int v = crowded.num_vertices(); v < TrialPatch::kMaxVertices - 1; ++v)
    REQUIRE(crowded.add_vertex(Vec3(100 + v, 0, 0), 1, 6, true));
  REQUIRE(crowded.insert(Vec3(0.3, 0.25, 0), 1));
  CHECK_FALSE(crowded.insert(Vec3(-0.3, -0.25, 0), 1));
}

TEST_CASE("trial_patch: it refuses stars that are not disks") {
  const DualRating rating(true, true, kLow, kHigh);
  const auto patch_of = [&](const std::vector<std::array<int, 3>>& triangles) {
    TrialPatch patch(rating);
    REQUIRE(patch.add_vertex(Vec3::Zero(), 1, 6, true));
    for (int k = 0; k < 8; ++k) {
      REQUIRE(patch.add_vertex(Vec3(std::cos(kPi * k / 4), std::sin(kPi * k / 4), 0), 1, 6, true));
    }
    for (const auto& t : triangles) REQUIRE(patch.add_triangle(t[0], t[1], t[2]));
    patch.close();
    return patch;
  };
  CHECK_FALSE(patch_of({}).remove(0));
  CHECK_FALSE(patch_of({{0, 1, 2}, {0, 2, 3}}).remove(0));
  CHECK_FALSE(patch_of({{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}}).remove(0));                        // a fan
  CHECK_FALSE(patch_of({{0, 1, 3}, {0, 3, 4}, {0, 4, 1}, {0, 5, 6}, {0, 6, 8}, {0, 8, 5}}).remove(0));  // two cycles
  CHECK(patch_of({{0, 1, 3}, {0, 3, 5}, {0, 5, 7}, {0, 7, 1}}).remove(0));
  CHECK(patch_of({{0, 3, 1}, {0, 3, 5}, {0, 7, 5}, {0, 7, 1}}).remove(0));  // orientation is none of its business
}

TEST_CASE("trial_patch: ratings are degrees out of bounds to first order, half above, with a charge for each bad angle") {
  // An isosceles triangle with this angle at its tip.
  const auto triangle = [](double tip) {
    const double half = tip * kPi / 360;
    return std::array<Vec3, 3>{Vec3(0, 0, 0), Vec3(std::sin(half), std::cos(half), 0),
                               Vec3(-std::sin(half), std::cos(half), 0)};
  };
  const auto rate = [&](const DualRating& rating, double tip) {
    const auto t = triangle(tip);
    const double value = rating.triangle(t[0], t[1], t[2]);
    CHECK(rating.triangle(t[1], t[2], t[0]) == doctest::Approx(value).epsilon(1e-9));
    CHECK(rating.triangle(t[2], t[1], t[0]) == doctest::Approx(value).epsilon(1e-9));
    CHECK(rating.triangle(7 * t[0], 7 * t[1], 7 * t[2]) == doctest::Approx(value).epsilon(1e-9));
    return value;
  };
  for (const double low : {20.0, 35.0, 42.0}) {
    const DualRating rating(true, true, low, 179);
    CHECK(rate(rating, low + 1e-6) == 0);
    CHECK(rate(rating, low + 5) == 0);
    for (const double off : {0.01, 0.1, 0.5}) CHECK(rate(rating, low - off) == doctest::Approx(off + 0.25).epsilon(0.03));
    CHECK(rate(rating, low - 10) > 7);
  }
  for (const double high : {90.0, 105.0, 114.0}) {
    const DualRating rating(true, true, 1, high);
    CHECK(rate(rating, high - 1e-6) == 0);
    CHECK(rate(rating, high - 5) == 0);
    for (const double off : {0.01, 0.1, 0.5}) CHECK(rate(rating, high + off) == doctest::Approx(off / 2 + 0.5).epsilon(0.03));
  }
  const DualRating rating(true, true, 35, 105);
  CHECK(rate(rating, 60) == 0);
  const int inner[] = {25, 20, 15, 10, 5, 0, 0, 0, 5, 10, 15};
  for (int n = 0; n <= 10; ++n) {
    CHECK(rating.valence(n, false) == inner[n]);
    CHECK(rating.valence(n, true) == 5 * std::max(0, n - 5));
  }
  const DualRating angles_only(true, false, 35, 105), valences_only(false, true, 35, 105);
  CHECK(angles_only.valence(3, false) == 0);
  CHECK(rate(valences_only, 10) == 0);
  CHECK(rate(angles_only, 10) > 0);
  CHECK(valences_only.valence(3, false) == 10);
}

}  // namespace amps_test
