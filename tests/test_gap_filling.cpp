#include "amps/gap_filling.h"

#include "kit/data.h"
#include "kit/maximality.h"
#include "kit/meshes.h"
#include "kit/random.h"
#include "kit/samples.h"

#include "amps/maximality.h"
#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/shapes.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <set>
#include <tuple>
#include <vector>

namespace amps_test {

using amps::RestrictedPowerDiagram;
using amps::SurfacePoint;
using amps::detail::GapFiller;
using amps::detail::GapFilling;
using amps::detail::GapFillLimits;
using amps::detail::Sample;
using amps::detail::SumTree;
using amps::detail::WantedRadii;

namespace {

/// A set that is edited as optimisation edits its own: diagram, disks and samples by id, ids used again.
class EditedSet {
 public:
  EditedSet(const Mesh& mesh, const SampleSet& set, const WantedRadii& radii)
      : diagram_(mesh, set.positions, squared(set.radii), on_threads(1)),
        disks_(amps::bounding_box(mesh), radii.min_of_set(), radii.max_of_set(), nullptr) {
    for (Index s = 0; s < set.size(); ++s) {
      samples_.push_back(amps::detail::sample_of(set, s));
      disks_.insert(samples_.back(), s);
    }
  }

  const RestrictedPowerDiagram& diagram() const { return diagram_; }
  const amps::detail::DiskSet& disks() const { return disks_; }
  const amps::detail::VoxelGrid& grid() const { return disks_.grid(); }
  const Sample& operator[](Index s) const { return samples_[at(s)]; }

  const std::vector<Index>& remove(Index s) {
    disks_.remove(samples_[at(s)], s);
    diagram_.remove(s);
    free_.push_back(s);
    return diagram_.changed();
  }

  Index enter(const Sample& sample, Index near) {
    Index s;
    if (free_.empty()) {
      s = diagram_.insert(sample.position(), sample.radius * sample.radius, near);
      samples_.push_back(sample);
    } else {
      s = free_.back();
      free_.pop_back();
      diagram_.reinsert(s, sample.position(), sample.radius * sample.radius, near);
      samples_[at(s)] = sample;
    }
    disks_.insert(sample, s);
    return s;
  }

  SampleSet finish() const {
    amps::detail::GrowingSet result;
    for (Index s = 0; s < diagram_.num_sites(); ++s) {
      if (!diagram_.removed(s)) result.add(samples_[at(s)]);
    }
    return result.finish();
  }

 private:
  RestrictedPowerDiagram diagram_;
  amps::detail::DiskSet disks_;
  std::vector<Sample> samples_;
  std::vector<Index> free_;
};

/// Takes s out, and `more` of its neighbours; says which, and tells the filler.
std::vector<Index> make_hole(EditedSet& set, GapFiller& filler, Index s, std::size_t more) {
  std::vector<Index> around, removed = {s};
  set.diagram().neighbors(s, around);
  for (std::size_t k = 0; k < std::min(more, around.size()); ++k) removed.push_back(around[k]);
  for (const Index r : removed) filler.look_at(set.remove(r));
  return removed;
}

amps::SizingField field_along_x(const Mesh& mesh, double min, double max) {
  const amps::Box box = amps::bounding_box(mesh);
  return amps::function_sizing(mesh, [=](const SurfacePoint& p) {
    return min + (max - min) * (p.position.x() - box.min.x()) / (box.max.x() - box.min.x());
  });
}

}  // namespace

TEST_CASE("gap_filling: a sum tree picks as a running sum does") {
  Rng rng(1);
  SumTree tree;
  std::vector<double> weights(500, 0.0);
  CHECK(tree.total() == 0);
  CHECK(tree.weight(499) == 0);
  for (int trial = 0; trial < 8000; ++trial) {
    const std::size_t i = rng.below(weights.size());
    weights[i] = trial % 3 == 0 ? 0.0 : static_cast<double>(rng.below(1000));  // whole numbers: sums are exact
    if (trial % 50 == 0) std::fill(weights.begin(), weights.begin() + 200, 0.0);
    if (trial % 50 == 0)
      for (Index k = 0; k < 200; ++k) tree.set(k, 0.0);
    tree.set(static_cast<Index>(i), weights[i]);
    REQUIRE(tree.weight(static_cast<Index>(i)) == weights[i]);
    double total = 0;
    for (const double w : weights) total += w;
    REQUIRE(tree.total() == total);
    if (total == 0) continue;
    const double u = static_cast<double>(rng.below(1024)) / 1024;
    double sum = 0;
    std::size_t expected = 0;
    while (sum + weights[expected] <= u * total) sum += weights[expected++];
    REQUIRE(at(tree.pick(u)) == expected);
  }
}

TEST_CASE("gap_filling: holes are filled where they are, by either rule, and the rest of the set stays") {
  const Mesh mesh = amps::make_torus();
  const double size = amps::bounding_box(mesh).diagonal();
  const amps::SizingField field = field_along_x(mesh, 0.02 * size, 0.05 * size);
  for (const ConflictRule rule : {ConflictRule::kMax, ConflictRule::kMin}) {
    for (const WantedRadii& wanted : {WantedRadii(0.03 * size, rule), WantedRadii(field, rule)}) {
      amps::SamplingOptions options;
      options.conflict_rule = rule;
      if (wanted.constant()) {
        options.radius = wanted.min();
      } else {
        options.sizing = field;
      }
      const SampleSet start = amps::sample(mesh, options).samples;
      const WantedRadii radii = wanted.beside(min_of(start.radii), max_of(start.radii));
      EditedSet set(mesh, start, radii);
      GapFiller filler(set.diagram(), set.disks(), radii);
      CHECK(!filler.has_gaps());
      Rng rng(3);
      std::vector<char> gone(at(start.size()), 0);
      for (int hole = 0; hole < 60; ++hole) {
        Index s = below(rng, start.size());
        if (set.diagram().removed(s)) continue;
        for (const Index r : make_hole(set, filler, s, rng.below(4))) {
          if (r < start.size()) gone[at(r)] = 1;
        }
        REQUIRE(filler.has_gaps());
        Index entered = 0;
        const GapFilling filled = filler.fill(rng, {}, [&](const Sample& sample, Index near) {
          ++entered;
          CHECK(sample.position() == amps::detail::position_of(mesh, sample.at));
          CHECK(sample.radius <= radii.at(sample.at));
          CHECK(sample.radius >= radii.min_of_set() * (1 - 1e-14));
          if (rule == ConflictRule::kMin) CHECK(sample.radius == radii.at(sample.at));
          for (Index k = 0; k < set.diagram().num_sites(); ++k) {
            if (!set.diagram().removed(k)) REQUIRE(amps::detail::are_apart(sample, set[k], rule));
          }
          set.enter(sample, near);
        });
        CHECK(filled.complete());
        CHECK(filled.samples == entered);
        CHECK(!filler.has_gaps());
        filler.forget();
      }
      const amps::MaximalityReport certificate = certificate_of(mesh, set.finish(), rule);
      CHECK(certificate.maximal());
      CHECK(certificate.poisson_disk());
      for (Index s = 0; s < start.size(); ++s) {
        if (!gone[at(s)]) REQUIRE(set[s].position() == sample_at(start, s));
      }
    }
  }
}

TEST_CASE("gap_filling: it gives up when it is told to, and what it has entered can be undone") {
  const Mesh mesh = amps::make_sphere(1280);
  amps::SamplingOptions options;
  options.radius = 0.12;
  const SampleSet start = amps::sample(mesh, options).samples;
  const WantedRadii radii(0.12, ConflictRule::kMax);
  EditedSet set(mesh, start, radii);
  GapFiller filler(set.diagram(), set.disks(), radii);
  Rng rng(4);
  for (const Index s : {5, 77, 300}) {
    const std::vector<Index> removed = make_hole(set, filler, s, 6);
    GapFillLimits limits;
    limits.max_samples = 2;
    std::vector<Index> entered;
    std::vector<Index> touched;
    const GapFilling filled = filler.fill(rng, limits, [&](const Sample& sample, Index near) {
      entered.push_back(set.enter(sample, near));
      touched.insert(touched.end(), set.diagram().changed().begin(), set.diagram().changed().end());
    });
    CHECK(filled.end == GapFilling::End::kGaveUp);
    CHECK(!filled.complete());
    CHECK(filled.samples == 2);
    CHECK(entered.size() == 2);
    CHECK(filler.has_gaps());
    filler.forget();
    CHECK(!filler.has_gaps());  // of what it looks at

    for (const Index e : entered) filler.look_at(set.remove(e));
    CHECK(filler.has_gaps());
    for (const Index r : removed) {
      Sample old = amps::detail::sample_of(start, r);
      set.enter(old, amps::kNone);
      filler.look_at(set.diagram().changed());
    }
    CHECK(!filler.has_gaps());
    filler.forget();
  }
  CHECK(amps::verify_maximal(mesh, set.finish()).maximal());

  // All of a hole within the limit: filled, not given up.
  make_hole(set, filler, 42, 0);
  GapFillLimits limits;
  limits.max_samples = 64;
  CHECK(filler.fill(rng, limits, [&](const Sample& sample, Index near) { set.enter(sample, near); }).complete());
}

TEST_CASE("gap_filling: gaps are chosen in proportion to area times density") {
  const Mesh mesh = amps::make_square(4);
  const amps::SizingField field = field_along_x(mesh, 0.03, 0.09);
  for (const WantedRadii& radii : {WantedRadii(0.06, ConflictRule::kMax), WantedRadii(field, ConflictRule::kMin)}) {
    amps::SamplingOptions options;
    options.conflict_rule = radii.rule();
    if (radii.constant()) {
      options.radius = radii.min();
    } else {
      options.sizing = field;
    }
    const SampleSet start = amps::sample(mesh, options).samples;
    EditedSet set(mesh, start, radii);
    GapFiller filler(set.diagram(), set.disks(), radii);
    // Two holes: a sample and a neighbour on the left, a sample and two neighbours on the right.
    const auto nearest_to = [&](const Vec3& x) {
      Index best = 0;
      for (Index s = 0; s < start.size(); ++s) {
        if ((set[s].position() - x).norm() < (set[best].position() - x).norm()) best = s;
      }
      return best;
    };
    const amps::Box box = amps::bounding_box(mesh);
    const auto inside = [&](double u, double v) {
      return Vec3(box.min.x() + u * (box.max.x() - box.min.x()), box.min.y() + v * (box.max.y() - box.min.y()), box.min.z());
    };
    make_hole(set, filler, nearest_to(inside(0.25, 0.5)), 1);
    make_hole(set, filler, nearest_to(inside(0.75, 0.5)), 2);
    const double middle = 0.5 * (box.min.x() + box.max.x());

    // The oracle: points on a fine grid that no disk holds, each with 1/r².
    double weight[2] = {0, 0};
    const SampleSet left = set.finish();
    constexpr int kSteps = 700;
    for (int i = 0; i < kSteps; ++i) {
      for (int j = 0; j < kSteps; ++j) {
        const Vec3 x = inside((i + 0.5) / kSteps, (j + 0.5) / kSteps);
        if (set.grid().conflicting_sample(x, 0, ConflictRule::kMax) != amps::kNone) continue;
        const double along = (x.x() - box.min.x()) / (box.max.x() - box.min.x());
        const double r = radii.constant() ? 1 : 0.03 + 0.06 * along;
        weight[x.x() > middle] += 1 / (r * r);
      }
    }
    REQUIRE(weight[0] > 0);
    REQUIRE(weight[1] > 0);
    const double expected = weight[1] / (weight[0] + weight[1]);
    CHECK(expected > 0.1);
    CHECK(expected < 0.9);

    constexpr int kTrials = 20000;
    GapFillLimits one;
    one.max_samples = 1;
    int on_the_right = 0;
    Rng rng(9);
    for (int trial = 0; trial < kTrials; ++trial) {
      filler.fill(rng, one, [&](const Sample& sample, Index) { on_the_right += sample.position().x() > middle; });
    }
    const double sigma = std::sqrt(expected * (1 - expected) / kTrials);
    // The oracle's grid is coarse: 0.2 %.
    CHECK(std::fabs(on_the_right / double{kTrials} - expected) < 4 * sigma + 0.002 * expected);
  }
}

TEST_CASE("gap_filling: a whole surface can be filled from a diagram with removed sites") {
  const Mesh mesh = amps::make_cube(4);
  amps::SamplingOptions options;
  options.radius = 0.07;
  const SampleSet start = amps::sample(mesh, options).samples;
  const WantedRadii radii(0.07, ConflictRule::kMax);
  EditedSet set(mesh, start, radii);
  for (Index s = 0; s < start.size(); s += 3) set.remove(s);
  GapFiller filler(set.diagram(), set.disks(), radii);
  filler.look_at_all();
  CHECK(filler.has_gaps());
  Rng rng(6);
  CHECK(filler.fill(rng, {}, [&](const Sample& sample, Index near) { set.enter(sample, near); }).complete());
  const amps::MaximalityReport certificate = amps::verify_maximal(mesh, set.finish());
  CHECK(certificate.maximal());
  CHECK(certificate.poisson_disk());
}

namespace {

using Piece = std::tuple<Index, Index, std::vector<std::array<double, 3>>>;

/// All fragments, by slot, or else sorted.
std::vector<Piece> pieces_of(const RestrictedPowerDiagram& diagram, bool sorted) {
  std::vector<Piece> pieces;
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    if (!diagram.alive(f)) {
      if (!sorted) pieces.emplace_back();
      continue;
    }
    const auto polygon = diagram.polygon(f);
    std::vector<std::array<double, 3>> corners;
    for (Index k = 0; k < polygon.size; ++k)
      corners.push_back({polygon.corners[k].x(), polygon.corners[k].y(), polygon.corners[k].z()});
    if (sorted) std::sort(corners.begin(), corners.end());
    pieces.emplace_back(polygon.facet, polygon.site, corners);
  }
  if (sorted) std::sort(pieces.begin(), pieces.end());
  return pieces;
}

std::vector<double> areas_of(const std::vector<RestrictedPowerDiagram::Polygon>& polygons) {
  std::vector<double> areas;
  for (const auto& polygon : polygons) areas.push_back(polygon.area());
  return areas;
}

/// A diagram of the first samples of a set, which the others enter in batches of those sizes, over and over, each drawn while
/// the one before enters. Checks what each batch says of its changes.
RestrictedPowerDiagram entered_together(const Mesh& mesh, const SampleSet& set, Index first, const amps::detail::DiskSet& disks,
                                        const std::vector<std::size_t>& sizes, unsigned threads, std::size_t& measured) {
  const std::vector<double> weights = squared(set.radii);
  RestrictedPowerDiagram diagram(mesh, {set.positions.data(), first}, {weights.data(), first}, disks.reach_lists(),
                                 on_threads(threads));
  Index drawn = first;
  std::size_t batch = 0;
  const auto draw = [&](RestrictedPowerDiagram::Arrivals& arrivals) {
    for (std::size_t k = sizes[batch++ % sizes.size()]; k > 0 && drawn < set.size(); --k, ++drawn) {
      arrivals.add({set.positions(drawn, 0), set.positions(drawn, 1), set.positions(drawn, 2), weights[at(drawn)]},
                   drawn % first);
    }
  };
  const auto measure = [](const std::vector<RestrictedPowerDiagram::Polygon>& polygons, std::vector<double>& values) {
    values = areas_of(polygons);
  };
  RestrictedPowerDiagram::Arrivals now, next;
  for (draw(now); !now.empty(); now.clear(), std::swap(now, next)) {
    const std::vector<Piece> before = pieces_of(diagram, false);
    const Index expected = diagram.num_sites() + static_cast<Index>(now.size());
    diagram.insert_together(
        now, next, [&] { draw(next); }, measure, on_threads(threads));
    REQUIRE(diagram.num_sites() == expected);
    const std::vector<Piece> after = pieces_of(diagram, false);
    const std::vector<Index>& changed = diagram.changed();
    REQUIRE(diagram.measured().size() == changed.size());
    CHECK(std::set<Index>(changed.begin(), changed.end()).size() == changed.size());
    for (std::size_t k = 0; k < changed.size(); ++k) {
      if (std::isnan(diagram.measured()[k])) continue;
      ++measured;
      const Index f = changed[k];
      REQUIRE(diagram.measured()[k] == (diagram.alive(f) ? diagram.polygon(f).area() : 0.0));
    }
    std::vector<char> listed(after.size(), 0);
    for (const Index f : changed) listed[at(f)] = 1;
    for (std::size_t f = 0; f < after.size(); ++f) {
      if (listed[f] == 0) REQUIRE((f < before.size() && after[f] == before[f]));
    }
  }
  return diagram;
}

}  // namespace

TEST_CASE("gap_filling: sites that enter together divide the surface as one after the other, on any number of threads") {
  const Mesh sphere = amps::make_sphere(5120), sheets = two_sheets(0.02, 12), coarse = amps::make_cube(2);
  // Small disks between large ones: sites that others hide.
  const Mesh three_sheets = joined(two_sheets(0.04, 12), moved(amps::make_square(12), {0, 0, 0.02}));
  const amps::SizingField field = amps::function_sizing(
      three_sheets, [](const SurfacePoint& p) { return std::fabs(p.position.z() - 0.02) < 0.01 ? 0.02 : 0.08; });
  struct Case {
    const Mesh& mesh;
    double radius;
    const amps::SizingField* field;
    amps::Neighborhood neighborhood;
    bool hides = false;
  };
  std::size_t num_local = 0, num_hidden = 0, measured = 0;
  Rng rng(11);
  for (const Case& c :
       {Case{sphere, 0.06, nullptr, amps::Neighborhood::kSpace}, Case{sphere, 0.05, nullptr, amps::Neighborhood::kSurface},
        Case{coarse, 0.05, nullptr, amps::Neighborhood::kSpace}, Case{sheets, 0.03, nullptr, amps::Neighborhood::kSurface},
        Case{three_sheets, 0, &field, amps::Neighborhood::kSurface},
        Case{sphere, 0.05, nullptr, amps::Neighborhood::kSpace, true}}) {
    CAPTURE(c.radius);
    amps::SamplingOptions options;
    options.neighborhood = c.neighborhood;
    if (c.field != nullptr) {
      options.sizing = *c.field;
    } else {
      options.radius = c.radius;
    }
    SampleSet set = amps::sample(c.mesh, options).samples;
    if (c.field != nullptr) {  // those that hide others come neither first nor last
      amps::detail::GrowingSet samples;
      samples.add_all(set);
      std::vector<Index> order;
      for (Index s = 0; s < set.size(); ++s) order.push_back(s);
      samples.reorder(shuffled(order, rng));
      set = samples.finish();
    }
    for (Index s = 0; c.hides && s < set.size(); s += 1 + below(rng, 60)) set.radii[at(s)] *= 10;
    const Index first = set.size() / 2;  // the first ones are there, many of the others are neighbours
    const auto flood = amps::detail::flood_of(c.mesh, c.neighborhood);
    // Lists of all: sites that are not in the diagram must play no part in it.
    const auto disks = amps::detail::disks_of(c.mesh, set, min_of(set.radii), max_of(set.radii), flood);
    const std::vector<double> weights = squared(set.radii);
    RestrictedPowerDiagram one_by_one(c.mesh, {set.positions.data(), first}, {weights.data(), first}, disks->reach_lists(),
                                      on_threads(1));
    for (Index s = first; s < set.size(); ++s) {
      one_by_one.insert(sample_at(set, s), weights[at(s)], s % first);
    }
    for (Index f = 0; f < static_cast<Index>(c.mesh.triangles.rows()); ++f) num_local += one_by_one.local(f) ? 1 : 0;
    for (Index s = 0; s < set.size(); ++s) num_hidden += one_by_one.visible(s) ? 0 : 1;
    CHECK(one_by_one.check() == "");
    RestrictedPowerDiagram some = one_by_one;
    for (Index s = first; s < set.size(); s += 3) some.remove(s);
    const std::vector<Piece> left = pieces_of(some, true);
    for (const unsigned threads : {1u, 2u, 3u}) {
      CAPTURE(threads);
      RestrictedPowerDiagram together = entered_together(c.mesh, set, first, *disks, {60, 1, 200, 9, 30}, threads, measured);
      CHECK(together.check() == "");
      CHECK(pieces_of(together, true) == pieces_of(one_by_one, true));
      CHECK(pieces_of(together, false) == pieces_of(one_by_one, false));
      for (Index s = first; s < set.size(); s += 3) together.remove(s);  // what they had hidden comes back
      CHECK(together.check() == "");
      CHECK(pieces_of(together, true) == left);
    }
  }
  CHECK(num_local > 0);
  CHECK(measured > 1000);  // on several threads most are found side by side
  CHECK(num_hidden > 0);
}

TEST_CASE("gap_filling: sets large enough for two stretches are maximal and have the same bits on any number of threads") {
  struct Case {
    const char* name;
    Mesh mesh;
    bool remeshed;  // disks know their surface, and end at curves
  };
  for (const Case& c : {Case{"sphere in space", amps::make_sphere(1280), false}, Case{"sphere", amps::make_sphere(20480), true},
                        Case{"open, with creases", open_book(3), true}, Case{"thin sheets", two_sheets(0.01), true}}) {
    CAPTURE(c.name);
    amps::RemeshOptions options;
    options.optimization.max_iterations = 0;
    options.sampling.target_count = 6000;
    const auto run = [&](unsigned threads) {
      run_on(options.sampling, threads);
      return c.remeshed ? amps::remesh(c.mesh, options).samples : amps::sample(c.mesh, options.sampling).samples;
    };
    const SampleSet one = run(1);
    CHECK(one.size() > 5000);
    for (const unsigned threads : {2u, 3u}) {
      CAPTURE(threads);
      CHECK(same_set(run(threads), one));
    }
    if (c.remeshed) continue;
    const amps::MaximalityReport certificate = amps::verify_maximal(c.mesh, one);
    CHECK(certificate.maximal());
    CHECK(certificate.poisson_disk());
  }
  // Over a surface, disks that end at no curve.
  const Mesh sheets = two_sheets(0.01);
  amps::SamplingOptions options;
  options.target_count = 6000;
  options.neighborhood = amps::Neighborhood::kSurface;
  const amps::MaximalityReport certificate =
      amps::verify_maximal(sheets, amps::sample(sheets, options).samples, {}, ConflictRule::kMax, amps::Neighborhood::kSurface);
  CHECK(certificate.maximal());
  CHECK(certificate.poisson_disk());
}

TEST_CASE("gap_filling: where parts overlap, facets that become local know their sites on any number of threads") {
  const Mesh boxes = joined(amps::make_cube(6), scaled(amps::make_cube(5), 0.9, Vec3(0.05, 0.04, 0.03)));
  const Mesh mesh = data_mesh_or("bones_26comps.off", boxes);
  amps::RemeshOptions options;
  options.sampling.sizing = amps::lfs_sizing(mesh).with_ratio().limited(0.1);
  options.curves.creases = false;
  options.optimize = false;
  for (const std::uint64_t seed : {3u, 9u, 11u}) {
    CAPTURE(seed);
    options.sampling.target_count = static_cast<Index>(20 + 8 * seed);
    options.sampling.seed = seed;
    run_on(options.sampling, 1);
    const amps::RemeshResult alone = amps::remesh(mesh, options);
    run_on(options.sampling, 2);
    const amps::RemeshResult together = amps::remesh(mesh, options);
    CHECK(alone.report.maximality.maximal());
    CHECK(same_set(alone.samples, together.samples));
  }
}

}  // namespace amps_test
