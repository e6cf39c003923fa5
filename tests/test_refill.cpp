// Refills that are proposed: trials made beside edits must see nothing of them.
#include "amps/refill.h"

#include "kit/diagrams.h"
#include "kit/models.h"
#include "kit/optimized.h"

#include "amps/disk_set.h"
#include "amps/maximality.h"
#include "amps/sample_edit.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace amps_test {
namespace {

using amps::detail::BadItem;
using amps::detail::Proposal;
using amps::detail::RefillFinder;
using amps::detail::RefillPlan;
using amps::detail::Sample;

bool same_proposal(const Proposal& a, const Proposal& b) {
  const auto same_sample = [](const Sample& x, const Sample& y) {
    return x.position() == y.position() && x.radius == y.radius && x.at.facet == y.at.facet;
  };
  return a.kind == b.kind && a.removed == b.removed && a.seen == b.seen && a.trials == b.trials &&
         std::equal(a.added.begin(), a.added.end(), b.added.begin(), b.added.end(), same_sample);
}

/// A set with its diagram, grid and stars, as the optimiser has them.
struct Scene {
  explicit Scene(const TestSet& set)
      : mesh(set.mesh),
        diagram(amps::detail::diagram_of(mesh, set.samples, on_threads(1))),
        radius(set.samples.radii[0]),
        radii(radius, amps::ConflictRule::kMax),
        disks(amps::detail::VoxelGrid(amps::bounding_box(mesh), radius, radius)),
        samples(diagram, set.samples, disks),
        rating(true, true, 42, 90),
        reader(diagram, rating) {
    stars.resize(at(samples.size()));
    seen.resize(at(samples.size()));
    for (Index s = 0; s < samples.size(); ++s) {
      stars.read(reader, s);
      seen.star.set(at(s), stars.star[at(s)]);
      seen.site[at(s)] = diagram.site(s);
      reader.list_bad(s, items);
    }
  }

  RefillFinder finder() const { return {diagram, stars, rating, radii, 8}; }

  const Mesh& mesh;
  Diagram diagram;
  double radius;
  amps::detail::WantedRadii radii;
  amps::detail::DiskSet disks;
  amps::detail::EditableSamples samples;
  amps::detail::DualRating rating;
  amps::detail::StarReader reader;
  amps::detail::DualStars stars;
  amps::detail::SeenSamples seen;
  std::vector<BadItem> items;
};

TEST_CASE("refill: what was planned is proposed whatever has become of the diagram since") {
  for (const TestSet& set :
       {uniform_set("torus", amps::make_torus(1, 0.4, 48, 20), 400), uniform_set("square", amps::make_square(8), 300)}) {
    CAPTURE(set.name);
    Scene scene(set);
    REQUIRE(scene.items.size() > 20);
    std::vector<RefillPlan> plans(scene.items.size());
    std::vector<Rng> rngs;
    std::vector<Proposal> expected;
    std::size_t refills = 0;
    for (std::size_t k = 0; k < plans.size(); ++k) {
      RefillFinder finder = scene.finder();
      expected.push_back(finder.find(scene.items[k], Rng(k)));
      refills += expected[k].kind == Proposal::Kind::kRefill;
      Rng rng(k);
      finder.plan(scene.items[k], rng, plans[k]);
      rngs.push_back(rng);
      CHECK(same_proposal(finder.find(plans[k], rng), expected[k]));
    }
    CHECK(refills > plans.size() / 4);
    // All but a few samples leave, and their stars are forgotten.
    std::vector<Index> gone;
    for (Index s = 8; s < scene.samples.size(); ++s) gone.push_back(s);
    amps::detail::SampleEdit edit(scene.samples, gone);
    edit.take_out();
    for (Index s = 0; s < scene.samples.size(); ++s) scene.stars.star.set(at(s), amps::detail::DualStar());
    RefillFinder finder = scene.finder();
    finder.look_at(scene.seen);
    for (std::size_t k = 0; k < plans.size(); ++k) CHECK(same_proposal(finder.find(plans[k], rngs[k]), expected[k]));
    edit.undo();
  }
}

TEST_CASE("refill: a plan has each cell once, and patches of its item first") {
  const TestSet set = uniform_set("torus", amps::make_torus(1, 0.4, 48, 20), 400);
  const Scene scene(set);
  const RefillFinder finder = scene.finder();
  RefillPlan plan;
  for (std::size_t k = 0; k < scene.items.size(); ++k) {
    const BadItem& item = scene.items[k];
    Rng rng(k);
    finder.plan(item, rng, plan);
    REQUIRE(plan.num_singles == (item.is_vertex() ? 1u : 3u));
    REQUIRE(plan.patches.size() == 2 * plan.num_singles + 1);
    std::vector<Index> removed;
    for (std::size_t p = 0; p < plan.patches.size(); ++p) {
      const RefillPlan::Patch& patch = plan.patches[p];
      if (p < plan.num_singles) CHECK(patch.size == 1);
      CHECK((patch.has(item.a) || patch.has(item.b) || patch.has(item.c)));
      removed.insert(removed.end(), patch.begin(), patch.end());
    }
    std::sort(removed.begin(), removed.end());
    removed.erase(std::unique(removed.begin(), removed.end()), removed.end());
    std::vector<Index> copied;
    for (const RefillPlan::Cell& cell : plan.cells) copied.push_back(cell.sample);
    std::sort(copied.begin(), copied.end());
    CHECK(copied == removed);
    // The cells' areas, counted anew.
    double area = 0, expected = 0;
    for (const RefillPlan::Piece& piece : plan.pieces) area += piece.u.cross(piece.v).norm() / 2;
    for (const Index s : removed) {
      for (Index f = scene.diagram.first_of_site(s); f != kNone; f = scene.diagram.next_of_site(f)) {
        const auto polygon = scene.diagram.polygon(f);
        Vec3 twice = Vec3::Zero();
        for (Index c = 0; c < polygon.size; ++c) twice += polygon.corners[c].cross(polygon.corners[(c + 1) % polygon.size]);
        expected += twice.norm() / 2;
      }
    }
    CHECK(area == doctest::Approx(expected));
  }
}

}  // namespace
}  // namespace amps_test
