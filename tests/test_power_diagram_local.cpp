// Local facets: divided among the sites that reach them. The oracle is the diagram of those sites on the facet alone.
#include "amps/power_diagram.h"

#include "kit/diagrams.h"
#include "kit/distance.h"
#include "kit/meshes.h"
#include "kit/random.h"

#include "amps/reach.h"

#include <doctest/doctest.h>

#include <map>
#include <string>
#include <vector>

namespace amps_test {
namespace {

using amps::WeightedPoint;
using amps::detail::ReachLists;

/// Sites with arbitrary lists: what a list says is all the diagram knows of reach.
struct Model {
  Mesh mesh;
  Rng rng;
  std::map<Index, WeightedPoint> sites;        ///< alive
  std::map<Index, std::vector<Index>> facets;  ///< that they reach

  Vec3 random_place() {
    const auto f = below(rng, rows(mesh.triangles));
    double a = rng.uniform(), b = rng.uniform();
    if (a + b > 1) a = 1 - a, b = 1 - b;
    const Vec3 p = corner_of(f, 0), q = corner_of(f, 1), r = corner_of(f, 2);
    return p + a * (q - p) + b * (r - p);
  }
  Vec3 corner_of(Index f, int k) const { return mesh.vertices.row(mesh.triangles(f, k)).transpose(); }

  /// Facets that the ball meets, some of them left out.
  std::vector<Index> random_facets(const Vec3& x, double radius, double share) {
    std::vector<Index> result;
    for (Index f = 0; f < rows(mesh.triangles); ++f) {
      const Vec3 a = corner_of(f, 0), b = corner_of(f, 1), c = corner_of(f, 2);
      if (triangle_distance(exact3(x), exact3(a), exact3(b), exact3(c)) <= radius && rng.uniform() < share) result.push_back(f);
    }
    return result;
  }
};

/// "" or what is wrong.
std::string broken_local_law(Model& model, const Diagram& diagram) {
  const std::string violation = diagram.check();
  if (!violation.empty()) return violation;
  for (Index facet = 0; facet < rows(model.mesh.triangles); ++facet) {
    if (is_degenerate(model.mesh, facet)) continue;
    std::vector<Index> names;
    std::vector<double> xyz, weights;
    for (const auto& [s, p] : model.sites) {
      const std::vector<Index>& reached = model.facets.at(s);
      if (std::find(reached.begin(), reached.end(), facet) == reached.end()) continue;
      names.push_back(s);
      xyz.insert(xyz.end(), {p.x, p.y, p.z});
      weights.push_back(p.w);
    }
    const std::string where = "facet " + std::to_string(facet) + ": ";
    if (!diagram.local(facet)) {
      // Nobody's ball has a part here that it does not reach; then coverage is that of the sites that do.
      for (int k = 0; k < 40; ++k) {
        double a = model.rng.uniform(), b = model.rng.uniform();
        if (a + b > 1) a = 1 - a, b = 1 - b;
        const Vec3 p = model.corner_of(facet, 0),
                   x = p + a * (model.corner_of(facet, 1) - p) + b * (model.corner_of(facet, 2) - p);
        double min_of_all = 1e300, min_of_reaching = 1e300;
        for (const auto& [s, site] : model.sites)
          min_of_all = std::min(min_of_all, (site.position() - x).squaredNorm() - site.w);
        for (std::size_t i = 0; i < names.size(); ++i) {
          const Vec3 q(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]);
          min_of_reaching = std::min(min_of_reaching, (q - x).squaredNorm() - weights[i]);
        }
        if (std::fabs(min_of_all) > 1e-9 && (min_of_all < 0) != (min_of_reaching < 0)) return where + "should be local";
      }
      continue;
    }
    CanonicalDiagram got, wanted;
    Index ownerless = 0, count = 0;
    for (Index f = diagram.first_of_facet(facet); f != kNone; f = diagram.next_of_facet(f), ++count) {
      ownerless += diagram.polygon(f).site == kNone;
    }
    if (names.empty()) {
      if (ownerless != 1 || count != 1) return where + "nobody reaches it, but it is no gap without owner";
      continue;
    }
    if (ownerless != 0) return where + "a fragment without owner, though it is reached";
    const Mesh alone = chosen_facets(model.mesh, {facet});
    const Diagram oracle(alone, amps::Points(std::move(xyz)), weights);
    std::map<Index, std::vector<std::pair<Index, Vec3>>> by_owner;
    for (Index f = 0; f < oracle.fragment_capacity(); ++f) {
      const auto p = oracle.polygon(f);
      if (p.size == 0) continue;
      auto& corners = by_owner[names[static_cast<std::size_t>(p.site)]];
      for (Index k = 0; k < p.size; ++k) {
        const Index label = p.labels[k];
        corners.emplace_back(label < 0 ? label : names[static_cast<std::size_t>(label)], p.corners[k]);
      }
    }
    if (count != static_cast<Index>(by_owner.size())) return where + "another number of owners";
    for (Index f = diagram.first_of_facet(facet); f != kNone; f = diagram.next_of_facet(f)) {
      const auto p = diagram.polygon(f);
      const auto found = by_owner.find(p.site);
      if (found == by_owner.end()) return where + "a wrong owner";
      const auto& corners = found->second;
      if (static_cast<Index>(corners.size()) != p.size) return where + "another polygon";
      Index turn = 0;
      while (turn < p.size && corners[static_cast<std::size_t>(turn)].first != p.labels[0]) ++turn;
      for (Index k = 0; k < p.size; ++k) {
        const auto& [label, x] = corners[static_cast<std::size_t>((turn + k) % p.size)];
        if (label != p.labels[k] || (x - p.corners[k]).norm() > 1e-9) return where + "another polygon";
      }
    }
  }
  return "";
}

void edit_at_random(Model& model, Index count, double radius, double ratio, double share, int edits, int check_every) {
  ReachLists lists;
  std::vector<double> xyz, weights;
  const auto random_site = [&] {
    const Vec3 x = model.random_place();
    const double r = radius * std::pow(ratio, model.rng.uniform());
    return WeightedPoint{x.x(), x.y(), x.z(), r * r};
  };
  const auto enter = [&](Index s, const WeightedPoint& p) {
    model.sites[s] = p;
    model.facets[s] = model.random_facets(p.position(), std::sqrt(p.w), share);
    lists.add(s, model.facets[s]);
  };
  for (Index s = 0; s < count; ++s) {
    const WeightedPoint p = random_site();
    enter(s, p);
    xyz.insert(xyz.end(), {p.x, p.y, p.z});
    weights.push_back(p.w);
  }
  Diagram diagram(model.mesh, amps::Points(std::move(xyz)), weights, &lists, {});
  REQUIRE(broken_local_law(model, diagram) == "");
  std::vector<Index> gone;
  Index local = 0;
  for (int k = 0; k < edits; ++k) {
    const auto kind = below(model.rng, 3);
    if (kind == 0 && model.sites.size() > 2) {
      auto at = model.sites.begin();
      std::advance(at, below(model.rng, static_cast<Index>(model.sites.size())));
      const Index s = at->first;
      diagram.remove(s);
      lists.remove(s);
      model.sites.erase(at);
      model.facets.erase(s);
      gone.push_back(s);
    } else if (kind == 1 && !gone.empty()) {
      const Index s = gone.back();
      gone.pop_back();
      const WeightedPoint p = random_site();
      enter(s, p);
      diagram.reinsert(s, p.position(), p.w);
    } else {
      const WeightedPoint p = random_site();
      enter(diagram.num_sites(), p);
      diagram.insert(p.position(), p.w);
    }
    if (k % check_every == 0) REQUIRE(broken_local_law(model, diagram) == "");
  }
  REQUIRE(broken_local_law(model, diagram) == "");
  for (Index f = 0; f < rows(model.mesh.triangles); ++f) local += diagram.local(f) ? 1 : 0;
  CHECK(local > 0);
}

}  // namespace

TEST_CASE("power diagram: a local facet is divided as if the sites that reach it were alone, after any edits") {
  struct Case {
    const char* name;
    Mesh mesh;
    Index sites;
    double radius, ratio, share;
    int edits, check_every;
  };
  const Case cases[] = {
      {"cube", amps::make_cube(2), 60, 0.3, 1, 0.8, 300, 20},
      {"cube of other radii", amps::make_cube(1), 40, 0.15, 4, 0.7, 300, 20},
      {"soup", random_soup(20, 3), 50, 0.3, 2, 0.8, 300, 20},
      {"sheets", two_sheets(0.05), 80, 0.2, 1, 0.5, 300, 20},
      {"never reached", amps::make_cube(1), 10, 0.4, 1, 0.2, 300, 10},
      {"large facets", two_sheets(0.02, 1), 400, 0.08, 1.5, 0.6, 400, 50},
  };
  std::uint64_t seed = 1;
  for (const Case& c : cases) {
    CAPTURE(c.name);
    Model model{c.mesh, Rng(seed++), {}, {}};
    edit_at_random(model, c.sites, c.radius, c.ratio, c.share, c.edits, c.check_every);
  }
}

}  // namespace amps_test
