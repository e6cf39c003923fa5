// Edits of a restricted power diagram against a diagram built anew from the sites that are left.
#include "amps/power_diagram.h"

#include "kit/data.h"
#include "kit/diagrams.h"
#include "kit/errors.h"
#include "kit/models.h"
#include "kit/samples.h"

#include "amps/sampling.h"
#include "amps/sizing.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

namespace amps_test {

namespace {

/// A diagram under edits, and the sites it should have.
class EditedDiagram {
 public:
  EditedDiagram(const Mesh& mesh, const Sites& sites) : mesh_(mesh), diagram_(mesh, sites.positions, sites.weights) {
    for (Index s = 0; s < sites.size(); ++s) {
      site_.push_back(sites.point(s));
      present_.push_back(s);
    }
  }

  const Diagram& diagram() const { return diagram_; }
  const std::vector<Index>& present() const { return present_; }
  const std::vector<Index>& removed() const { return removed_; }
  const WeightedPoint& site(Index s) const { return *site_[at(s)]; }

  void insert(const Vec3& x, double w, Index near = kNone) {
    REQUIRE(diagram_.insert(x, w, near) == static_cast<Index>(site_.size()));
    present_.push_back(static_cast<Index>(site_.size()));
    site_.push_back(WeightedPoint{x.x(), x.y(), x.z(), w});
  }
  void remove(Index s) {
    diagram_.remove(s);
    site_[at(s)].reset();
    present_.erase(std::find(present_.begin(), present_.end(), s));
    removed_.push_back(s);
  }
  void reinsert(Index s, const Vec3& x, double w, Index near = kNone) {
    diagram_.reinsert(s, x, w, near);
    site_[at(s)] = WeightedPoint{x.x(), x.y(), x.z(), w};
    removed_.erase(std::find(removed_.begin(), removed_.end(), s));
    present_.insert(std::lower_bound(present_.begin(), present_.end(), s), s);
  }

  /// Fragments, labels, corner bits and areas are those of a diagram that has never seen another site.
  bool equals_rebuild() const {
    std::vector<Index> id;
    for (Index s = 0; s < static_cast<Index>(site_.size()); ++s) {
      if (diagram_.removed(s) == site_[at(s)].has_value()) return false;
      if (site_[at(s)]) id.push_back(s);
    }
    WeightedPoints left;
    for (const Index s : id) left.push_back(site(s));
    const Diagram fresh(mesh_, positions_of(left), weights_of(left));
    return fresh.num_fragments() == diagram_.num_fragments() && canonical(fresh, id) == canonical(diagram_);
  }

  std::string broken_law() const { return amps_test::broken_law(mesh_, diagram_); }

 private:
  const Mesh& mesh_;
  Diagram diagram_;
  std::vector<std::optional<WeightedPoint>> site_;
  std::vector<Index> present_, removed_;
};

Index any_of(Rng& rng, const std::vector<Index>& ids) { return ids[rng.below(ids.size())]; }

/// A random edit; new sites come from `pool`, or are copies of what is there, of equal or another weight.
void random_edit(EditedDiagram& edited, const Sites& pool, Rng& rng, double copies) {
  const double what = rng.uniform();
  if (what < 0.5 && edited.present().size() > 1) {
    edited.remove(any_of(rng, edited.present()));
    return;
  }
  const Index from = below(rng, pool.size());
  Vec3 x = pool.at(from);
  double w = pool.weights[from];
  if (rng.uniform() < copies) {
    const WeightedPoint twin = edited.site(any_of(rng, edited.present()));
    x = twin.position();
    if (rng.uniform() < 0.7) w = twin.w;
  }
  const Index near = rng.uniform() < 0.3 ? kNone : any_of(rng, edited.present());
  if (!edited.removed().empty() && rng.uniform() < 0.9) {
    edited.reinsert(any_of(rng, edited.removed()), x, w, near);
  } else {
    edited.insert(x, w, near);
  }
}

void check_random_edits(const Mesh& mesh, const Sites& start, const Sites& pool, int edits, int every, double copies,
                        std::uint64_t seed) {
  Rng rng(seed);
  EditedDiagram edited(mesh, start);
  for (int k = 1; k <= edits; ++k) {
    random_edit(edited, pool, rng, copies);
    if (k % every == 0) {
      CAPTURE(k);
      REQUIRE(edited.equals_rebuild());
    }
    if (k % (8 * every) == 0) REQUIRE(edited.broken_law() == "");
  }
  REQUIRE(edited.equals_rebuild());
  REQUIRE(edited.broken_law() == "");
}

/// Samples of a maximal Poisson-disk set with squared radii as weights; radii in [1, 4] times the least if graded.
Sites poisson_disks(const Mesh& mesh, double count, bool graded) {
  const SamplingOptions options = graded ? with_sizing(for_about(amps::vertex_sizing(mesh, graded_radii(mesh, 4, 0)), count))
                                         : with_radius(radius_for(mesh, count));
  const SampleSet set = amps::sample(mesh, options).samples;
  return {set.positions, squared(set.radii)};
}

std::vector<NamedMesh> models() {
  return {{"square", amps::make_square(1)},
          {"fine square", amps::make_square(24)},
          {"sphere", amps::make_sphere(320)},
          {"fine sphere", amps::make_sphere(5120)},
          {"torus", amps::make_torus(1.0, 0.4, 40, 20)},
          {"book of 5 pages", open_book(5)},
          {"soup", random_soup(40, 301)},
          {"bunny", data_mesh_or("bunny_3k_closed.off", amps::make_knot())}};
}

}  // namespace

TEST_CASE("power_diagram: a site removed leaves the diagram of the others") {
  for (const auto& model : small_meshes()) {
    CAPTURE(model.name);
    const double size = amps::bounding_box(model.mesh).diagonal();
    for (const Index n : {2, 5, 40}) {
      for (const double weight : {0.0, 0.02, 1.0}) {
        CAPTURE(n);
        CAPTURE(weight);
        const Sites sites = random_sites(model.mesh, n, weight * size * size / n, 302, weight == 0.02 ? 0.3 * size : 0);
        for (Index s = 0; s < n; ++s) {
          EditedDiagram edited(model.mesh, sites);
          edited.remove(s);
          REQUIRE(edited.equals_rebuild());
          if (s % 8 == 0) REQUIRE(edited.broken_law() == "");
          edited.reinsert(s, sites.at(s), sites.weights[s], s % 2 == 0 ? kNone : 0);
          REQUIRE(edited.equals_rebuild());
        }
      }
    }
  }
}

TEST_CASE("power_diagram: edits of Poisson-disk sets end in the diagram of construction at once") {
  for (const auto& model : models()) {
    CAPTURE(model.name);
    for (const bool graded : {false, true}) {
      CAPTURE(graded);
      const Sites sites = poisson_disks(model.mesh, 400, graded);
      const Sites pool = random_sites(model.mesh, 1000, 2 * max_of(sites.weights), 303);
      // Back and forth among its own sites, then with sites that hide others.
      check_random_edits(model.mesh, sites, sites, 1000, 125, 0, 304);
      check_random_edits(model.mesh, sites, pool, 1000, 125, 0.02, 305);
    }
  }
}

TEST_CASE("power_diagram: edits of cells with hundreds of fragments, on needles") {
  constexpr Index kSides = 150;
  std::vector<Vec3> vertices;
  std::vector<Corners> triangles;
  for (Index k = 0; k < kSides; ++k) {
    const double angle = 2 * 3.14159265358979 * k / kSides;
    for (const double z : {0.0, 40.0}) vertices.emplace_back(std::cos(angle), std::sin(angle), z);
    const Index a = 2 * k, b = 2 * ((k + 1) % kSides);
    triangles.push_back({a, b, b + 1});
    triangles.push_back({a, b + 1, a + 1});
  }
  const Mesh mesh = mesh_of(vertices, triangles);
  const Sites sites = poisson_disks(mesh, 60, false);
  const Diagram diagram(mesh, sites.positions, sites.weights);
  REQUIRE(diagram.num_fragments() > 100 * sites.size());
  const Sites pool = random_sites(mesh, 200, 2 * max_of(sites.weights), 315);
  check_random_edits(mesh, sites, sites, 200, 25, 0, 316);
  check_random_edits(mesh, sites, pool, 200, 25, 0.05, 317);
}

TEST_CASE("power_diagram: edits of few and heavy sites, where most hide") {
  for (const auto& model : small_meshes()) {
    CAPTURE(model.name);
    const double size2 = amps::bounding_box(model.mesh).diagonal() * amps::bounding_box(model.mesh).diagonal();
    for (const double weight : {0.0, 0.05, 2.0}) {
      CAPTURE(weight);
      const Sites pool = random_sites(model.mesh, 60, weight * size2, 306, weight > 1 ? 0.5 : 0);
      const Sites start = head(pool, 12);
      check_random_edits(model.mesh, start, pool, 400, 5, 0.1, 307);
    }
  }
}

TEST_CASE("power_diagram: edits of lattices and cospherical sites, where ties are the rule") {
  std::vector<Vec3> lattice, grid;
  for (int y = 0; y <= 6; ++y) {
    for (int x = 0; x <= 6; ++x) lattice.emplace_back(x, y, 0);
  }
  for (int k = 0; k < 64; ++k) grid.emplace_back(k % 4, k / 4 % 4, k / 16);
  const Sites flat = sites_of(lattice), cubic = sites_of(grid);
  Sites checkerboard = flat;
  for (Index s = 0; s < flat.size(); ++s) checkerboard.weights[s] = s % 2;
  const Mesh through_sites = scaled(amps::make_square(6), 6), on_bisectors = scaled(amps::make_square(12), 6);
  const Mesh two_facets = scaled(amps::make_square(1), 6);
  for (const Mesh* mesh : {&through_sites, &on_bisectors, &two_facets}) {
    check_random_edits(*mesh, flat, flat, 400, 10, 0.05, 308);
    check_random_edits(*mesh, checkerboard, checkerboard, 400, 10, 0.05, 309);
  }
  check_random_edits(scaled(amps::make_cube(3), 3), cubic, cubic, 400, 10, 0.05, 310);
  check_random_edits(scaled(amps::make_cube(2), 2, {0.5, 0.5, 0.5}), cubic, cubic, 400, 10, 0.05, 311);
  const Sites sphere = sites_of(integer_sphere(50));
  check_random_edits(scaled(amps::make_cube(2), 8, {-4, -4, -4}), sphere, sphere, 400, 10, 0.05, 312);
  for (const auto& model : small_meshes()) {
    CAPTURE(model.name);
    const Sites vertices = sites_of(model.mesh.vertices, 0.25);
    check_random_edits(model.mesh, vertices, vertices, 200, 10, 0.05, 313);
  }
}

TEST_CASE("power_diagram: down to one site and up again, in any order") {
  for (const auto& model : models()) {
    CAPTURE(model.name);
    const Sites sites = random_sites(model.mesh, 150, 0.01, 314);
    Rng rng(315);
    EditedDiagram edited(model.mesh, sites);
    while (edited.present().size() > 1) {
      edited.remove(any_of(rng, edited.present()));
      if (edited.present().size() % 16 == 1 || edited.present().size() < 8) REQUIRE(edited.equals_rebuild());
    }
    const Index last = edited.present().front();
    CHECK(edited.diagram().cell_areas()[at(last)] == doctest::Approx(amps::total_area(model.mesh)));
    while (!edited.removed().empty()) {
      const Index s = any_of(rng, edited.removed());
      edited.reinsert(s, sites.at(s), sites.weights[s], last);
    }
    CHECK(edited.equals_rebuild());
    CHECK(edited.broken_law() == "");
  }
}

TEST_CASE("power_diagram: the sites left may be far away, or lighter than any before") {
  const Mesh mesh = amps::make_sphere(80);
  const Sites sites = random_sites(mesh, 12, 0.01, 316);
  EditedDiagram edited(mesh, sites);
  for (const Vec3& x : {Vec3(1e5, 0, 0), Vec3(-1e3, 1e3, 0), Vec3(0, 0.1, 0), Vec3(0, 0, 40)}) edited.insert(x, -1e6);
  for (Index s = 0; s < 12; ++s) {
    edited.remove(s);
    REQUIRE(edited.equals_rebuild());
    REQUIRE(edited.broken_law() == "");
  }
  for (const Index s : {14, 13, 15}) {
    edited.remove(s);
    REQUIRE(edited.equals_rebuild());
  }
  for (Index s = 0; s < 12; ++s) edited.reinsert(s, sites.at(s), sites.weights[s]);
  CHECK(edited.equals_rebuild());
}

TEST_CASE("power_diagram: a duplicate takes over, and gives back to a lower id") {
  const Mesh mesh = amps::make_sphere(320);
  const Sites sites = random_sites(mesh, 40, 0.01, 317);
  for (const Index n : {1, 2, 40}) {
    EditedDiagram edited(mesh, head(sites, n));
    edited.insert(sites.at(0), sites.weights[0]);
    REQUIRE(!edited.diagram().visible(n));
    edited.remove(0);
    REQUIRE(edited.diagram().visible(n));
    REQUIRE(edited.equals_rebuild());
    edited.reinsert(0, sites.at(0), sites.weights[0]);
    CHECK(edited.diagram().visible(0));
    CHECK(!edited.diagram().visible(n));
    CHECK(edited.equals_rebuild());
    CHECK(edited.broken_law() == "");
    edited.remove(n);
    CHECK(edited.diagram().changed().empty());
    CHECK(edited.equals_rebuild());
  }
}

TEST_CASE("power_diagram: changed() lists exactly the fragments that an edit touched, changed_sites() their owners") {
  for (const auto& model : small_meshes()) {
    CAPTURE(model.name);
    const double size = amps::bounding_box(model.mesh).diagonal();
    const Sites pool = random_sites(model.mesh, 80, 0.1 * size * size, 318);
    EditedDiagram edited(model.mesh, pool);
    Rng rng(319);
    const auto triangles_by_site = [&edited] {
      std::map<Index, std::multiset<std::array<Index, 3>>> result;
      const Triangles triangles = edited.diagram().dual_triangles();
      for (Index t = 0; t < rows(triangles); ++t) {
        for (int corner = 0; corner < 3; ++corner) {
          result[triangles(t, corner)].insert(corners_of(triangles, t));
        }
      }
      return result;
    };
    const auto triangles_of = [](const auto& of_site, Index s) {
      const auto found = of_site.find(s);
      return found == of_site.end() ? std::multiset<std::array<Index, 3>>() : found->second;
    };
    for (int k = 0; k < 150; ++k) {
      const auto before = snapshot(edited.diagram());
      const auto triangles_before = triangles_by_site();
      random_edit(edited, pool, rng, 0.1);
      const auto after = snapshot(edited.diagram());
      std::set<Index> expected;
      for (const auto& [f, entry] : before) {
        const auto now = after.find(f);
        if (now == after.end() || now->second.first != entry.first || !(now->second.second == entry.second)) expected.insert(f);
      }
      for (const auto& [f, entry] : after) {
        if (before.count(f) == 0) expected.insert(f);
      }
      const std::vector<Index>& changed = edited.diagram().changed();
      CHECK(std::is_sorted(changed.begin(), changed.end()));
      CHECK(std::set<Index>(changed.begin(), changed.end()).size() == changed.size());
      // A slot may have been freed and filled again with what it held.
      CHECK(std::includes(changed.begin(), changed.end(), expected.begin(), expected.end()));
      for (const Index f : changed) {
        if (expected.count(f) == 0) CHECK(before.at(f).first == after.at(f).first);
      }
      // Whoever had or has one of them, and nobody else has another dual triangle than before.
      std::set<Index> owners, concerned;
      for (const auto* snap : {&before, &after}) {
        for (const Index f : changed) {
          if (const auto entry = snap->find(f); entry != snap->end()) owners.insert(entry->second.first.second);
        }
        for (const Index f : expected) {
          if (const auto entry = snap->find(f); entry != snap->end()) concerned.insert(entry->second.first.second);
        }
      }
      const std::vector<Index>& sites = edited.diagram().changed_sites();
      CHECK(std::is_sorted(sites.begin(), sites.end()));
      CHECK(sites == std::vector<Index>(owners.begin(), owners.end()));
      CHECK(std::includes(sites.begin(), sites.end(), concerned.begin(), concerned.end()));
      const auto triangles_after = triangles_by_site();
      for (Index s = 0; s < edited.diagram().num_sites(); ++s) {
        if (owners.count(s) == 0) CHECK(triangles_of(triangles_before, s) == triangles_of(triangles_after, s));
      }
    }
  }
}

TEST_CASE("power_diagram: edits that cannot be say why and change nothing") {
  const Mesh mesh = amps::make_sphere(80);
  const Sites sites = random_sites(mesh, 3, 0, 320);
  Diagram diagram(mesh, sites.positions, sites.weights);
  const auto before = canonical(diagram);
  const double nan = kNaN;
  for (const Index s : {-1, -4, 3, 100}) {
    CHECK(error_of([&] { diagram.remove(s); }) == ErrorCode::kInvalidArgument);
    CHECK(error_of([&] { diagram.reinsert(s, {0, 0, 0}, 0); }) == ErrorCode::kInvalidArgument);
  }
  CHECK(error_of([&] { diagram.reinsert(1, {0, 0, 0}, 0); }) == ErrorCode::kInvalidArgument);
  CHECK(canonical(diagram) == before);
  diagram.remove(1);
  CHECK(error_of([&] { diagram.remove(1); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { diagram.reinsert(1, {0, nan, 0}, 0); }) == ErrorCode::kInvalidArgument);
  CHECK(error_of([&] { diagram.reinsert(1, {0, 0, 0}, nan); }) == ErrorCode::kInvalidArgument);
  CHECK(diagram.removed(1));
  CHECK(diagram.num_removed() == 1);
  diagram.reinsert(1, sites.at(1), 0);
  CHECK(canonical(diagram) == before);
  diagram.remove(0);
  diagram.remove(2);
  CHECK(error_of([&] { diagram.remove(1); }) == ErrorCode::kInvalidArgument);
  CHECK(broken_law(mesh, diagram) == "");
}

TEST_CASE("power_diagram: fragments of a thousand corners are kept as others are" * doctest::test_suite("slow")) {
  // Their numbers no longer fit into the records from 1023 on. One cell has a corner for each site of a circle around it.
  const Mesh mesh = one_triangle({-10, -9, 0}, {12, -9, 0}, {0, 11, 0});
  WeightedPoints list = {{0, 0, 0, 0}};
  constexpr Index kOnCircle = 1025;
  for (Index k = 0; k < kOnCircle; ++k) {
    const double angle = 2 * kPi * k / kOnCircle;
    list.push_back({std::cos(angle), std::sin(angle), 0, 0});
  }
  EditedDiagram edited(mesh, sites_of(list));
  const auto size_of_first = [&] { return edited.diagram().polygon(edited.diagram().first_of_site(0)).size; };
  REQUIRE(size_of_first() == kOnCircle);
  std::set<Index> sizes;
  Rng rng(17);
  for (int edit = 0; edit < 60; ++edit) {
    const bool removes = edit % 20 < 10;
    if (removes) {
      Index s = 0;
      while (s == 0) s = any_of(rng, edited.present());
      edited.remove(s);
    } else {
      const Index s = any_of(rng, edited.removed());
      const double angle = 2 * kPi * (s - 1) / kOnCircle;
      edited.reinsert(s, {std::cos(angle), std::sin(angle), 0}, 0);
    }
    sizes.insert(size_of_first());
    if (edit % 3 == 0) REQUIRE(edited.equals_rebuild());
  }
  CHECK(sizes.count(1022) + sizes.count(1023) + sizes.count(1024) == 3);
  const Index inside = static_cast<Index>(list.size());
  edited.insert({0.1, 0.2, 0}, 0);  // takes half of it
  CHECK(edited.equals_rebuild());
  CHECK(edited.broken_law() == "");
  edited.remove(inside);
  edited.remove(0);
  CHECK(edited.equals_rebuild());
}

TEST_SUITE("slow") {
  TEST_CASE("power_diagram: thousands of edits of real surfaces and large sets") {
    const std::vector<NamedMesh> meshes = {{"bunny", data_mesh_or("bunny_36k_holes.obj", amps::make_knot())},
                                           {"fandisk", data_mesh_or("fandisk.obj", amps::make_cube(12))},
                                           {"triceratops", data_mesh_or("triceratops.off", amps::make_torus())},
                                           {"suzanne", data_mesh_or("suzanne.obj", open_book(4))},
                                           {"triple vierbein", data_mesh_or("triple_vierbein.obj", open_book(7))},
                                           {"sphere", amps::make_sphere(20000)}};
    for (const auto& model : meshes) {
      CAPTURE(model.name);
      for (const bool graded : {false, true}) {
        CAPTURE(graded);
        const Sites sites = poisson_disks(model.mesh, 4000, graded);
        check_random_edits(model.mesh, sites, sites, 10000, 2500, 0, 321);
        const Sites pool = random_sites(model.mesh, 8000, 3 * max_of(sites.weights), 322);
        check_random_edits(model.mesh, sites, pool, 5000, 1250, 0.01, 323);
      }
    }
  }
}

}  // namespace amps_test
