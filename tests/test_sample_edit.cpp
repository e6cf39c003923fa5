// Edits of samples, diagram and grid against a plain list of samples, from which all three are made anew.
#include "amps/sample_edit.h"

#include "kit/diagrams.h"
#include "kit/meshes.h"
#include "kit/models.h"
#include "kit/random.h"
#include "kit/sites.h"

#include "amps/execution.h"
#include "amps/maximality.h"
#include "amps/sampling.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {
namespace {

using amps::ConflictRule;
using amps::SampleSet;
using amps::detail::EditableSamples;
using amps::detail::Sample;
using amps::detail::SampleChange;
using amps::detail::SampleEdit;
using amps::detail::VoxelGrid;

/// What there should be: the samples by id.
struct Entry {
  Sample sample;
  bool is_new;
};
using Expected = std::map<Index, Entry>;

bool same_sample(const Sample& a, const Sample& b) {
  return a.position() == b.position() && a.radius == b.radius && a.at.facet == b.at.facet &&
         a.at.barycentric == b.at.barycentric;
}

Sample random_sample(const Mesh& mesh, double radius, Rng& rng) {
  const Index facet = below(rng, MeshView(mesh).num_facets());
  return {amps::detail::surface_point_at(mesh, facet, amps::uniform_barycentric(rng)), radius * between(rng, 0.5, 1.5)};
}

/// A diagram, made anew, with the ids that are expected.
CanonicalDiagram rebuilt(const Mesh& mesh, const Expected& expected) {
  WeightedPoints list;
  std::vector<Index> ids;
  for (const auto& [id, entry] : expected) {
    const Vec3& x = entry.sample.position();
    list.push_back({x.x(), x.y(), x.z(), entry.sample.radius * entry.sample.radius});
    ids.push_back(id);
  }
  const Sites sites = sites_of(list);
  return canonical(Diagram(mesh, sites.positions, sites.weights), ids);
}

/// Grid and set, asked and compared one by one. `set`: the given one.
void check_samples(const Mesh& mesh, const EditableSamples& samples, SampleSet set, const Expected& expected, double radius,
                   Rng& rng) {
  std::vector<Index> alive;
  for (Index s = 0; s < samples.size(); ++s) {
    if (samples.alive(s)) alive.push_back(s);
  }
  REQUIRE(alive.size() == expected.size());
  for (const auto& [id, entry] : expected) {
    REQUIRE(samples.alive(id));
    CHECK(same_sample(samples[id], entry.sample));
    CHECK(samples.is_new(id) == entry.is_new);
    CHECK(samples.diagram().site(id).w == entry.sample.radius * entry.sample.radius);
  }
  for (int query = 0; query < 20; ++query) {
    const Sample dart = random_sample(mesh, radius, rng);
    bool conflict = false;
    double nearest = INFINITY;
    for (const auto& [id, entry] : expected) {
      const double d = (entry.sample.position() - dart.position()).squaredNorm(),
                   r = std::max(entry.sample.radius, dart.radius);
      conflict = conflict || d < r * r;
      nearest = std::min(nearest, d);
    }
    const Index found = samples.disks().grid().conflicting_sample(dart.position(), dart.radius, amps::ConflictRule::kMax);
    CHECK((found != kNone) == conflict);
    if (found != kNone) CHECK(expected.count(found) == 1);
    const double reach = 1.5 * radius;  // the greatest radius of the grid
    const double by_grid = samples.disks().grid().nearest_squared_distance(dart.position(), reach);
    if (nearest <= reach * reach) CHECK(by_grid == nearest);
  }
  std::vector<Index> ids;
  samples.collect(set, ids);
  REQUIRE(ids.size() == expected.size());
  for (Index row = 0; row < set.size(); ++row) {
    const Entry& entry = expected.at(ids[at(row)]);
    CHECK(same_sample(amps::detail::sample_of(set, row), entry.sample));
    if (row == 0) continue;  // given ones first, each kind by id
    const Entry& before = expected.at(ids[at(row - 1)]);
    CHECK(std::make_pair(before.is_new, ids[at(row - 1)]) < std::make_pair(entry.is_new, ids[at(row)]));
  }
}

/// Sites with other fragments in one of the two than in the other.
std::set<Index> sites_that_differ(const CanonicalDiagram& a, const CanonicalDiagram& b) {
  std::set<Index> sites;
  for (const auto& [key, polygon] : a) {
    const auto found = b.find(key);
    if (found == b.end() || !(found->second == polygon)) sites.insert(key.second);
  }
  for (const auto& [key, polygon] : b) {
    if (a.count(key) == 0) sites.insert(key.second);
  }
  return sites;
}

/// The state, and what it should be.
class Session {
 public:
  Session(const Mesh& mesh, double radius, std::uint64_t seed)
      : mesh_(mesh),
        radius_(radius),
        set_(set_of(mesh, radius)),
        diagram_(amps::detail::diagram_of(mesh, set_, 1)),
        disks_(VoxelGrid(amps::bounding_box(mesh), radius / 2, 3 * radius / 2)),
        samples_(diagram_, set_, disks_),
        rng_(seed) {
    for (Index s = 0; s < set_.size(); ++s) expected_[s] = {amps::detail::sample_of(set_, s), false};
  }

  enum class End { kKeep, kUndo };

  /// A random edit, in one of the orders that are allowed, and all that can be said of it.
  SampleChange edit(End end) {
    const CanonicalDiagram before = canonical(diagram_);
    Expected after = expected_;
    std::vector<Index> removed;
    for (auto n = rng_.below(4); n > 0 && removed.size() + 2 < expected_.size(); --n) {
      const Index s = std::next(expected_.begin(), static_cast<std::ptrdiff_t>(rng_.below(expected_.size())))->first;
      if (after.erase(s) != 0) removed.push_back(s);
    }
    SampleEdit edit(samples_, removed);
    for (const Index s : removed) {
      const Sample& gone = expected_.at(s).sample;
      const Index near = samples_.disks().grid().conflicting_sample(gone.position(), 0, amps::ConflictRule::kMax);
      CHECK(std::find(removed.begin(), removed.end(), near) == removed.end());
    }
    const bool first_out = rng_.below(2) == 0, in_diagram = end == End::kKeep || rng_.below(4) != 0;
    if (first_out && in_diagram) edit.take_out();
    if (rng_.below(3) == 0) {
      enter(edit, nullptr);
      edit.withdraw();
      CHECK(edit.added().empty());
    }
    enter(edit, &after);
    if (!first_out && in_diagram) edit.take_out();
    if (end == End::kUndo) {
      edit.undo();
      CHECK(canonical(diagram_) == before);
      return {};
    }
    const CanonicalDiagram now = canonical(diagram_);
    const std::set<Index> differ = sites_that_differ(before, now);
    const std::vector<Index> fragments = edit.changed_fragments();
    CHECK(std::is_sorted(fragments.begin(), fragments.end()));
    SampleChange change = edit.keep();
    expected_ = after;
    CHECK(std::is_sorted(change.affected.begin(), change.affected.end()));
    CHECK(std::adjacent_find(change.affected.begin(), change.affected.end()) == change.affected.end());
    for (const Index s : change.affected) CHECK(expected_.count(s) == 1);
    for (const Index s : differ) {
      if (expected_.count(s) != 0) CHECK(std::binary_search(change.affected.begin(), change.affected.end(), s));
    }
    return change;
  }

  struct Begun {
    std::size_t edits = 0, refused = 0;
  };

  /// Random edits side by side, each near a sample; some are kept, the others undone.
  Begun edits_side_by_side(Diagram::PendingEdits& pending, unsigned threads) {
    Begun begun;
    const CanonicalDiagram before = canonical(diagram_);
    struct Edit {
      std::unique_ptr<SampleEdit> edit;
      std::vector<Index> removed;
      std::vector<Sample> added;
    };
    std::vector<Edit> edits;
    Expected after = expected_;
    samples_.begin_side_by_side(pending);
    for (std::size_t k = 0; k < pending.size(); ++k) {
      Edit next;
      next.removed = {std::next(after.begin(), static_cast<std::ptrdiff_t>(rng_.below(after.size())))->first};
      if (expected_.count(next.removed.front()) == 0) continue;
      const Vec3 x = expected_.at(next.removed.front()).sample.position();
      for (auto n = 1 + rng_.below(3); n > 0; --n) next.added.push_back(sample_near(x));
      const CanonicalDiagram here = edits.empty() ? canonical(diagram_) : CanonicalDiagram();
      next.edit = std::make_unique<SampleEdit>(samples_, next.removed);
      if (!next.edit->begin(next.added, next.removed.front(), pending[edits.size()])) {
        next.edit->undo();
        if (edits.empty()) CHECK(canonical(diagram_) == here);
        ++begun.refused;
        continue;
      }
      for (const Index s : next.removed) after.erase(s);
      for (std::size_t a = 0; a < next.added.size(); ++a) after[next.edit->added()[a]] = {next.added[a], true};
      edits.push_back(std::move(next));
    }
    begun.edits = edits.size();
    amps::Execution execution;
    execution.threads = threads;
    amps::parallel_for(edits.size(), 1, execution, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) edits[k].edit->carry_out(pending[k]);
    });
    for (std::size_t k = 0; k < edits.size(); ++k) edits[k].edit->join(pending[k]);
    for (std::size_t k = 0; k < edits.size(); ++k) edits[k].edit->finish(pending[k]);
    const CanonicalDiagram now = canonical(diagram_);
    CHECK(now == rebuilt(mesh_, after));
    std::set<Index> affected;
    for (const Edit& edit : edits) {
      for (const Index s : edit.edit->affected()) CHECK(affected.insert(s).second);
    }
    for (const Index s : sites_that_differ(before, now)) {
      if (after.count(s) != 0) CHECK(affected.count(s) == 1);
    }
    for (const Edit& edit : edits) {
      if (rng_.below(3) != 0) {
        for (const Index s : edit.removed) expected_.erase(s);
        for (const Index s : edit.edit->added()) expected_[s] = after.at(s);
        edit.edit->keep();
      } else {
        edit.edit->undo();
      }
    }
    return begun;
  }

  void check() {
    CHECK(canonical(diagram_) == rebuilt(mesh_, expected_));
    check_samples(mesh_, samples_, set_, expected_, radius_, rng_);
  }

  const Expected& expected() const { return expected_; }
  void expect(const Expected& expected) { expected_ = expected; }
  EditableSamples& samples() { return samples_; }
  Diagram& diagram() { return diagram_; }
  Rng& rng() { return rng_; }
  double radius() const { return radius_; }
  const Mesh& mesh() const { return mesh_; }

 private:
  static SampleSet set_of(const Mesh& mesh, double radius) {
    amps::SamplingOptions options;
    options.radius = radius;
    return amps::sample(mesh, options).samples;
  }

  Sample sample_near(const Vec3& x) {
    Sample best = random_sample(mesh_, radius_, rng_);
    for (int dart = 0; dart < 30; ++dart) {
      const Sample other = random_sample(mesh_, radius_, rng_);
      if ((other.position() - x).norm() < (best.position() - x).norm()) best = other;
    }
    return best;
  }

  void enter(SampleEdit& edit, Expected* after) {
    for (auto n = 1 + rng_.below(3); n > 0; --n) {
      const Sample sample = random_sample(mesh_, radius_, rng_);
      const Index s = edit.enter(sample, kNone);
      CHECK(edit.has_added(s));
      CHECK(expected_.count(s) == 0);
      if (after == nullptr) continue;
      REQUIRE(after->count(s) == 0);
      (*after)[s] = {sample, true};
    }
  }

  Mesh mesh_;
  double radius_;
  SampleSet set_;
  Diagram diagram_;
  amps::detail::DiskSet disks_;
  EditableSamples samples_;
  Expected expected_;
  Rng rng_;
};

std::vector<NamedMesh> edit_meshes() {
  return {{"sphere", amps::make_sphere(180)},
          {"square", amps::make_square(3)},
          {"soup", random_soup(12, 11)},
          {"book of 3 pages", open_book(3)}};
}

}  // namespace

TEST_CASE("sample_edit: after any edits diagram, grid and set are those of the samples that should be there") {
  std::uint64_t seed = 1;
  for (const auto& model : edit_meshes()) {
    CAPTURE(model.name);
    Session session(model.mesh, radius_for(model.mesh, 60), seed++);
    session.check();
    for (int round = 0; round < 60; ++round) {
      CAPTURE(round);
      session.edit(session.rng().below(2) == 0 ? Session::End::kKeep : Session::End::kUndo);
      session.check();
    }
    CHECK(session.diagram().check() == "");
  }
}

TEST_CASE("sample_edit: a series of edits that were kept is undone as if it had never been") {
  std::uint64_t seed = 101;
  for (const auto& model : edit_meshes()) {
    CAPTURE(model.name);
    Session session(model.mesh, radius_for(model.mesh, 60), seed++);
    for (int round = 0; round < 12; ++round) {
      CAPTURE(round);
      session.edit(Session::End::kKeep);
      const Expected before = session.expected();
      const CanonicalDiagram diagram = canonical(session.diagram());
      std::vector<SampleChange> series;
      for (int k = 0; k < round; ++k) {
        if (session.rng().below(4) == 0) session.edit(Session::End::kUndo);
        series.push_back(session.edit(Session::End::kKeep));
      }
      const std::set<Index> differ = sites_that_differ(diagram, canonical(session.diagram()));
      const std::vector<Index> affected = SampleEdit::undo_all(session.samples(), series);
      CHECK(series.empty());
      session.expect(before);
      CHECK(canonical(session.diagram()) == diagram);
      session.check();
      for (const Index s : affected) CHECK(before.count(s) == 1);
      for (const Index s : differ) {
        if (before.count(s) != 0) CHECK(std::binary_search(affected.begin(), affected.end(), s));
      }
    }
  }
}

TEST_CASE("sample_edit: edits side by side end as if made one after another, for any number of threads") {
  std::vector<NamedMesh> models = edit_meshes();
  models.push_back({"sphere of 300 facets to a cell", amps::make_sphere(20000)});
  std::uint64_t seed = 201;
  for (const auto& model : models) {
    CAPTURE(model.name);
    const int samples = model.mesh.triangles.rows() < 1000 ? 400 : 60;
    std::string slots_by_threads[2];
    std::size_t edits = 0, refused = 0;
    for (const unsigned threads : {1u, 3u}) {
      Session session(model.mesh, radius_for(model.mesh, samples), seed);
      Diagram::PendingEdits pending(6);
      for (int round = 0; round < 25; ++round) {
        CAPTURE(round);
        const Session::Begun begun = session.edits_side_by_side(pending, threads);
        edits += begun.edits;
        refused += begun.refused;
        session.check();
      }
      session.samples().end_side_by_side(pending);
      CHECK(session.diagram().check() == "");
      for (Index f = 0; f < session.diagram().fragment_capacity(); ++f) {
        const bool alive = session.diagram().alive(f);
        slots_by_threads[threads == 1 ? 0 : 1] += alive ? std::to_string(session.diagram().polygon(f).site) + " " : "- ";
      }
    }
    ++seed;
    CHECK(slots_by_threads[0] == slots_by_threads[1]);
    CHECK(edits > 50);
    CHECK(refused > 5);
  }
}

TEST_CASE("sample_edit: ids are used again, those of undone edits too") {
  const Mesh mesh = amps::make_sphere(180);
  Session session(mesh, radius_for(mesh, 60), 7);
  for (int round = 0; round < 200; ++round) session.edit(round % 2 == 0 ? Session::End::kUndo : Session::End::kKeep);
  const auto alive = static_cast<Index>(session.expected().size());
  // At most as many ids as there ever were samples at a time: what one edit removes and adds comes on top.
  CHECK(session.samples().size() < alive + 200);
  CHECK(session.samples().size() == session.diagram().num_sites());
  CHECK(session.diagram().num_sites() - session.diagram().num_removed() == alive);
}

TEST_CASE("sample_edit: disks are apart at the distance of the rule, samples that go not counted") {
  const Mesh mesh = amps::make_square(3);
  Session session(mesh, radius_for(mesh, 60), 9);
  int apart = 0, close = 0, by_min_only = 0;
  for (int round = 0; round < 3000; ++round) {
    std::vector<Index> removed;
    Expected left = session.expected();
    const Vec3 centre = random_sample(mesh, session.radius(), session.rng()).position();
    for (const auto& [id, entry] : session.expected()) {
      if ((entry.sample.position() - centre).norm() < 1.5 * session.radius()) removed.push_back(id);
    }
    for (const Index s : removed) left.erase(s);
    std::vector<Sample> disks;
    for (int k = 0; k < 2; ++k) {
      disks.push_back(random_sample(mesh, 0.5 * session.radius(), session.rng()));
      if (round % 2 == 0) {
        disks.back().at.position =
            centre + session.radius() * Vec3(session.rng().uniform() - 0.5, session.rng().uniform() - 0.5, 0);
      }
    }
    bool by_max = true, by_min = true;
    const auto compare = [&](const Sample& a, const Sample& b) {
      const double d = (a.position() - b.position()).squaredNorm(), p = a.radius * a.radius, q = b.radius * b.radius;
      by_max = by_max && !(d < std::max(p, q));
      by_min = by_min && !(d < std::min(p, q));
    };
    for (const Sample& disk : disks) {
      for (const auto& [id, entry] : left) compare(disk, entry.sample);
    }
    compare(disks[0], disks[1]);
    SampleEdit edit(session.samples(), removed);
    CHECK(session.samples().are_apart(disks, ConflictRule::kMax) == by_max);
    CHECK(session.samples().are_apart(disks, ConflictRule::kMin) == by_min);
    edit.undo();
    ++(by_max ? apart : close);
    by_min_only += by_min && !by_max;
  }
  CHECK(apart > 100);
  CHECK(close > 100);
  CHECK(by_min_only > 100);
  session.check();
}

}  // namespace amps_test
