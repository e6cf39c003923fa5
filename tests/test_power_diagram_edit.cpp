// Edits of a restricted power diagram against a diagram built anew from the sites that are left.
#include "amps/sampling.h"
#include "amps/sizing.h"
#include "test_data.h"
#include "test_diagrams.h"

#include <limits>
#include <optional>

using amps::ErrorCode;
using amps::Index;
using amps::kNone;
using amps::Mesh;
using amps::Points;
using amps::Rng;
using amps::Vec3;
using amps_test::Canonical;
using amps_test::CanonicalDiagram;
using amps_test::Diagram;
using amps_test::NamedMesh;
using amps_test::Sites;

namespace {

std::size_t at(Index i) { return static_cast<std::size_t>(i); }

/// A diagram under edits, and the sites it should have.
class EditedDiagram {
 public:
  EditedDiagram(const Mesh& mesh, const Sites& sites) : mesh_(mesh), diagram_(mesh, sites.positions, sites.weights) {
    for (Index s = 0; s < sites.size(); ++s) {
      site_.push_back(amps::WeightedPoint{sites.at(s).x(), sites.at(s).y(), sites.at(s).z(), sites.weights[s]});
      present_.push_back(s);
    }
  }

  const Diagram& diagram() const { return diagram_; }
  const std::vector<Index>& present() const { return present_; }
  const std::vector<Index>& removed() const { return removed_; }
  const amps::WeightedPoint& site(Index s) const { return *site_[at(s)]; }

  void insert(const Vec3& x, double w, Index near = kNone) {
    REQUIRE(diagram_.insert(x, w, near) == static_cast<Index>(site_.size()));
    present_.push_back(static_cast<Index>(site_.size()));
    site_.push_back(amps::WeightedPoint{x.x(), x.y(), x.z(), w});
  }
  void remove(Index s) {
    diagram_.remove(s);
    site_[at(s)].reset();
    present_.erase(std::find(present_.begin(), present_.end(), s));
    removed_.push_back(s);
  }
  void reinsert(Index s, const Vec3& x, double w, Index near = kNone) {
    diagram_.reinsert(s, x, w, near);
    site_[at(s)] = amps::WeightedPoint{x.x(), x.y(), x.z(), w};
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
    Points positions(static_cast<Index>(id.size()), 3);
    Eigen::VectorXd weights(positions.rows());
    for (Index k = 0; k < positions.rows(); ++k) {
      positions.row(k) = site(id[at(k)]).position().transpose();
      weights[k] = site(id[at(k)]).w;
    }
    const Diagram fresh(mesh_, positions, weights);
    CanonicalDiagram expected;
    for (const auto& [key, polygon] : amps_test::canonical(fresh)) {
      Canonical& entry = expected[{key.first, id[at(key.second)]}];
      entry = polygon;
      for (Index& label : entry.labels) {
        if (Diagram::is_site(label)) label = id[at(label)];
      }
    }
    return fresh.num_fragments() == diagram_.num_fragments() && expected == amps_test::canonical(diagram_);
  }

  std::string broken_law() const { return amps_test::broken_law(mesh_, diagram_); }

 private:
  const Mesh& mesh_;
  Diagram diagram_;
  std::vector<std::optional<amps::WeightedPoint>> site_;
  std::vector<Index> present_, removed_;
};

Index any_of(Rng& rng, const std::vector<Index>& ids) { return ids[at(static_cast<Index>(rng.below(ids.size())))]; }

/// A random edit; new sites come from `pool`, or are copies of what is there, of equal or another weight.
void random_edit(EditedDiagram& edited, const Sites& pool, Rng& rng, double copies) {
  const double what = rng.uniform();
  if (what < 0.5 && edited.present().size() > 1) {
    edited.remove(any_of(rng, edited.present()));
    return;
  }
  const Index from = static_cast<Index>(rng.below(static_cast<std::uint64_t>(pool.size())));
  Vec3 x = pool.at(from);
  double w = pool.weights[from];
  if (rng.uniform() < copies) {
    const amps::WeightedPoint twin = edited.site(any_of(rng, edited.present()));
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
  amps::SamplingOptions options;
  if (graded) {
    const amps::Box box = amps::bounding_box(mesh);
    Eigen::VectorXd radii(mesh.vertices.rows());
    for (Index v = 0; v < mesh.vertices.rows(); ++v) {
      radii[v] = 1 + 3 * (mesh.vertices(v, 0) - box.min.x()) / (box.max.x() - box.min.x());
    }
    const amps::SizingField field = amps::vertex_sizing(mesh, radii);
    options.sizing = field.scaled(amps::count_factor(field, count));
  } else {
    options.radius = std::sqrt(0.7 * amps::total_area(mesh) / count);
  }
  const amps::SampleSet set = amps::sample(mesh, options).samples;
  return {set.positions, set.radii.cwiseAbs2()};
}

std::vector<NamedMesh> models() {
  return {{"square", amps::make_square(1)},
          {"fine square", amps::make_square(24)},
          {"sphere", amps::make_sphere(320)},
          {"fine sphere", amps::make_sphere(5120)},
          {"torus", amps::make_torus(1.0, 0.4, 40, 20)},
          {"book of 5 pages", amps_test::open_book(5)},
          {"soup", amps_test::random_soup(40, 301)},
          {"bunny", amps_test::data_mesh_or("bunny_3k_closed.off", amps::make_knot())}};
}

}  // namespace

TEST_CASE("power_diagram: a site removed leaves the diagram of the others") {
  for (const auto& model : amps_test::small_meshes()) {
    CAPTURE(model.name);
    const double size = amps::bounding_box(model.mesh).diagonal();
    for (const Index n : {2, 5, 40}) {
      for (const double weight : {0.0, 0.02, 1.0}) {
        CAPTURE(n);
        CAPTURE(weight);
        const Sites sites =
            amps_test::random_sites(model.mesh, n, weight * size * size / n, 302, weight == 0.02 ? 0.3 * size : 0);
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
      const Sites pool = amps_test::random_sites(model.mesh, 1000, 2 * sites.weights.maxCoeff(), 303);
      // Back and forth among its own sites, then with sites that hide others.
      check_random_edits(model.mesh, sites, sites, 1000, 125, 0, 304);
      check_random_edits(model.mesh, sites, pool, 1000, 125, 0.02, 305);
    }
  }
}

TEST_CASE("power_diagram: edits of few and heavy sites, where most hide") {
  for (const auto& model : amps_test::small_meshes()) {
    CAPTURE(model.name);
    const double size2 = amps::bounding_box(model.mesh).diagonal() * amps::bounding_box(model.mesh).diagonal();
    for (const double weight : {0.0, 0.05, 2.0}) {
      CAPTURE(weight);
      const Sites pool = amps_test::random_sites(model.mesh, 60, weight * size2, 306, weight > 1 ? 0.5 : 0);
      const Sites start{pool.positions.topRows(12), pool.weights.head(12)};
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
  const Sites flat = amps_test::sites_of(lattice), cubic = amps_test::sites_of(grid);
  Sites checkerboard = flat;
  for (Index s = 0; s < flat.size(); ++s) checkerboard.weights[s] = s % 2;
  const Mesh through_sites = amps_test::scaled(amps::make_square(6), 6),
             on_bisectors = amps_test::scaled(amps::make_square(12), 6);
  const Mesh two_facets = amps_test::scaled(amps::make_square(1), 6);
  for (const Mesh* mesh : {&through_sites, &on_bisectors, &two_facets}) {
    check_random_edits(*mesh, flat, flat, 400, 10, 0.05, 308);
    check_random_edits(*mesh, checkerboard, checkerboard, 400, 10, 0.05, 309);
  }
  check_random_edits(amps_test::scaled(amps::make_cube(3), 3), cubic, cubic, 400, 10, 0.05, 310);
  check_random_edits(amps_test::scaled(amps::make_cube(2), 2, {0.5, 0.5, 0.5}), cubic, cubic, 400, 10, 0.05, 311);
  const Sites sphere = amps_test::sites_of(amps_test::integer_sphere(50));
  check_random_edits(amps_test::scaled(amps::make_cube(2), 8, {-4, -4, -4}), sphere, sphere, 400, 10, 0.05, 312);
  for (const auto& model : amps_test::small_meshes()) {
    CAPTURE(model.name);
    const Sites vertices{model.mesh.vertices, Eigen::VectorXd::Constant(model.mesh.vertices.rows(), 0.25)};
    check_random_edits(model.mesh, vertices, vertices, 200, 10, 0.05, 313);
  }
}

TEST_CASE("power_diagram: down to one site and up again, in any order") {
  for (const auto& model : models()) {
    CAPTURE(model.name);
    const Sites sites = amps_test::random_sites(model.mesh, 150, 0.01, 314);
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
  const Sites sites = amps_test::random_sites(mesh, 12, 0.01, 316);
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
  const Sites sites = amps_test::random_sites(mesh, 40, 0.01, 317);
  for (const Index n : {1, 2, 40}) {
    EditedDiagram edited(mesh, {sites.positions.topRows(n), sites.weights.head(n)});
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
  for (const auto& model : amps_test::small_meshes()) {
    CAPTURE(model.name);
    const double size = amps::bounding_box(model.mesh).diagonal();
    const Sites pool = amps_test::random_sites(model.mesh, 80, 0.1 * size * size, 318);
    EditedDiagram edited(model.mesh, pool);
    Rng rng(319);
    const auto snapshot = [&edited] {
      std::map<Index, std::pair<std::pair<Index, Index>, Canonical>> result;
      for (Index f = 0; f < edited.diagram().fragment_capacity(); ++f) {
        if (!edited.diagram().alive(f)) continue;
        const Diagram::Polygon p = edited.diagram().polygon(f);
        Canonical polygon;
        polygon.labels.assign(p.labels, p.labels + p.size);
        for (Index k = 0; k < p.size; ++k) polygon.corners.push_back({p.corners[k].x(), p.corners[k].y(), p.corners[k].z()});
        result[f] = {{p.facet, p.site}, polygon};
      }
      return result;
    };
    const auto triangles_by_site = [&edited] {
      std::map<Index, std::multiset<std::array<Index, 3>>> result;
      const amps::Triangles triangles = edited.diagram().dual_triangles();
      for (Index t = 0; t < triangles.rows(); ++t) {
        for (int corner = 0; corner < 3; ++corner) {
          result[triangles(t, corner)].insert({triangles(t, 0), triangles(t, 1), triangles(t, 2)});
        }
      }
      return result;
    };
    const auto triangles_of = [](const auto& of_site, Index s) {
      const auto found = of_site.find(s);
      return found == of_site.end() ? std::multiset<std::array<Index, 3>>() : found->second;
    };
    for (int k = 0; k < 150; ++k) {
      const auto before = snapshot();
      const auto triangles_before = triangles_by_site();
      random_edit(edited, pool, rng, 0.1);
      const auto after = snapshot();
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
  const Sites sites = amps_test::random_sites(mesh, 3, 0, 320);
  Diagram diagram(mesh, sites.positions, sites.weights);
  const auto before = amps_test::canonical(diagram);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Index s : {-1, -4, 3, 100}) {
    CHECK(amps_test::error_of([&] { diagram.remove(s); }) == ErrorCode::kInvalidArgument);
    CHECK(amps_test::error_of([&] { diagram.reinsert(s, {0, 0, 0}, 0); }) == ErrorCode::kInvalidArgument);
  }
  CHECK(amps_test::error_of([&] { diagram.reinsert(1, {0, 0, 0}, 0); }) == ErrorCode::kInvalidArgument);
  CHECK(amps_test::canonical(diagram) == before);
  diagram.remove(1);
  CHECK(amps_test::error_of([&] { diagram.remove(1); }) == ErrorCode::kInvalidArgument);
  CHECK(amps_test::error_of([&] { diagram.reinsert(1, {0, nan, 0}, 0); }) == ErrorCode::kInvalidArgument);
  CHECK(amps_test::error_of([&] { diagram.reinsert(1, {0, 0, 0}, nan); }) == ErrorCode::kInvalidArgument);
  CHECK(diagram.removed(1));
  CHECK(diagram.num_removed() == 1);
  diagram.reinsert(1, sites.at(1), 0);
  CHECK(amps_test::canonical(diagram) == before);
  diagram.remove(0);
  diagram.remove(2);
  CHECK(amps_test::error_of([&] { diagram.remove(1); }) == ErrorCode::kInvalidArgument);
  CHECK(amps_test::broken_law(mesh, diagram) == "");
}

TEST_SUITE("slow") {
  TEST_CASE("power_diagram: thousands of edits of real surfaces and large sets") {
    const std::vector<NamedMesh> meshes = {
        {"bunny", amps_test::data_mesh_or("bunny_36k_holes.obj", amps::make_knot())},
        {"fandisk", amps_test::data_mesh_or("fandisk.obj", amps::make_cube(12))},
        {"triceratops", amps_test::data_mesh_or("triceratops.off", amps::make_torus())},
        {"suzanne", amps_test::data_mesh_or("suzanne.obj", amps_test::open_book(4))},
        {"triple vierbein", amps_test::data_mesh_or("triple_vierbein.obj", amps_test::open_book(7))},
        {"sphere", amps::make_sphere(20000)}};
    for (const auto& model : meshes) {
      CAPTURE(model.name);
      for (const bool graded : {false, true}) {
        CAPTURE(graded);
        const Sites sites = poisson_disks(model.mesh, 4000, graded);
        check_random_edits(model.mesh, sites, sites, 10000, 2500, 0, 321);
        const Sites pool = amps_test::random_sites(model.mesh, 8000, 3 * sites.weights.maxCoeff(), 322);
        check_random_edits(model.mesh, sites, pool, 5000, 1250, 0.01, 323);
      }
    }
  }
}
