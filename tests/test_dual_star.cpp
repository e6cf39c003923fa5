// Dual stars and their ratings against the list of all dual triangles, counted one by one.
#include "amps/dual_star.h"

#include "kit/diagrams.h"
#include "kit/meshes.h"
#include "kit/models.h"

#include "amps/maximality.h"
#include "amps/sampling.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace amps_test {
namespace {

using amps::detail::AngleRange;
using amps::detail::BadItem;
using amps::detail::DualRating;
using amps::detail::DualStar;
using amps::detail::StarReader;

constexpr double kLow = 38, kHigh = 100;
using Form = StarReader::Form;
using Triple = std::array<Index, 3>;

/// The neighbours of a sample as a graph: who is joined to whom by a triangle at the sample.
using Link = std::map<Index, std::set<Index>>;

std::set<Index> reached_from(const Link& link, Index start) {
  std::set<Index> seen = {start};
  for (std::vector<Index> next = {start}; !next.empty();) {
    const Index v = next.back();
    next.pop_back();
    for (const Index w : link.at(v)) {
      if (seen.insert(w).second) next.push_back(w);
    }
  }
  return seen;
}

Form form_of(const Link& link) {
  if (link.empty()) return Form::kOther;
  int ends = 0;
  bool crossing = false;
  for (const auto& [v, around] : link) {
    ends += around.size() == 1;
    crossing = crossing || around.size() > 2;
  }
  const bool whole = reached_from(link, link.begin()->first).size() == link.size();
  if (crossing) return ends == 0 ? Form::kCrossing : Form::kOther;
  if (ends == 0) return whole ? Form::kDisk : Form::kPinched;
  return ends == 2 && whole ? Form::kHalfDisk : Form::kOther;
}

double valence_energy(Form form, std::size_t neighbors, bool crossings) {
  if (form == Form::kOther || (form == Form::kCrossing && !crossings)) return 0;
  const int n = static_cast<int>(neighbors);
  if (form == Form::kHalfDisk) return 5.0 * std::max(0, n - 5);
  return 5.0 * (n < 5 ? 5 - n : std::max(0, n - 7));
}

/// All triangles: triples that are met an odd number of times.
std::set<Triple> triples_of(const Diagram& diagram) {
  std::set<Triple> triples;
  const Triangles triangles = diagram.dual_triangles();
  for (Index t = 0; t < rows(triangles); ++t) {
    Triple corners = {triangles(t, 0), triangles(t, 1), triangles(t, 2)};
    std::sort(corners.begin(), corners.end());
    if (!triples.insert(corners).second) triples.erase(corners);
  }
  return triples;
}

/// Two cones that share their apex.
Mesh hourglass() {
  std::vector<Vec3> vertices = {Vec3::Zero()};
  std::vector<Triple> triangles;
  for (const double z : {-1.0, 1.0}) {
    const auto first = static_cast<Index>(vertices.size());
    for (int k = 0; k < 12; ++k) vertices.emplace_back(std::cos(k * 0.5236), std::sin(k * 0.5236), z);
    for (Index k = 0; k < 12; ++k) triangles.push_back({0, first + k, first + (k + 1) % 12});
  }
  return mesh_of(vertices, triangles);
}

struct TestDiagram {
  std::string name;
  Mesh mesh;
  double count;
};

/// Few samples for what they are on, so that all kinds of stars occur.
std::vector<TestDiagram> test_diagrams() {
  const Mesh square = amps::make_square(4);
  return {{"sphere", amps::make_sphere(320), 300},
          {"square", square, 200},
          {"soup", random_soup(12, 401), 250},
          {"book of 3 pages", open_book(3), 200},
          {"near sheets", joined(square, scaled(square, 1, Vec3(0, 0, 0.03))), 300},
          {"crossing sheets", joined(amps::make_cube(2), scaled(amps::make_cube(2), 0.7)), 200},
          {"hourglass", hourglass(), 300}};
}

}  // namespace

TEST_CASE("dual_star: stars are the dual triangles at a sample, their kind and ring those of the graph around it") {
  const DualRating rating(true, true, kLow, kHigh);
  std::map<Form, int> seen;
  for (const TestDiagram& test : test_diagrams()) {
    CAPTURE(test.name);
    amps::SamplingOptions options;
    options.radius = radius_for(test.mesh, test.count);
    const Diagram diagram = amps::detail::diagram_of(test.mesh, amps::sample(test.mesh, options).samples, 1);
    std::vector<Link> links(at(diagram.num_sites()));
    std::vector<std::vector<StarReader::Pair>> pairs(links.size());
    for (const Triple& t : triples_of(diagram)) {
      for (std::size_t k = 0; k < 3; ++k) {
        const Index a = t[(k + 1) % 3], b = t[(k + 2) % 3];
        pairs[at(t[k])].push_back({std::min(a, b), std::max(a, b)});
        links[at(t[k])][a].insert(b);
        links[at(t[k])][b].insert(a);
      }
    }
    StarReader reader(diagram, rating);
    for (Index s = 0; s < diagram.num_sites(); ++s) {
      CAPTURE(s);
      std::sort(pairs[at(s)].begin(), pairs[at(s)].end());
      CHECK(reader.read(s) == pairs[at(s)]);
      DualStar star;
      const Form form = reader.form(star);
      const Link& link = links[at(s)];
      CHECK(form == form_of(link));
      ++seen[form];
      const bool has_ring = form == Form::kDisk && link.size() <= static_cast<std::size_t>(DualStar::kMaxSize);
      REQUIRE(star.size == (has_ring ? static_cast<int>(link.size()) : 0));
      std::set<Index> ring;
      for (int k = 0; k < star.size; ++k) {
        const Index v = star.ring[at(k)], w = star.ring[at((k + 1) % star.size)];
        ring.insert(v);
        CHECK(link.at(v).count(w) == 1);
      }
      CHECK(ring.size() == static_cast<std::size_t>(star.size));
    }
  }
  for (const Form form : {Form::kDisk, Form::kHalfDisk, Form::kPinched, Form::kCrossing, Form::kOther}) {
    CAPTURE(static_cast<int>(form));
    CHECK(seen[form] > 0);
  }
}

TEST_CASE("dual_star: energies sum to those of all triangles and valences, and what is bad is listed once") {
  const DualRating rating(true, true, kLow, kHigh);
  for (const TestDiagram& test : test_diagrams()) {
    CAPTURE(test.name);
    amps::SamplingOptions options;
    options.radius = radius_for(test.mesh, test.count);
    const Diagram diagram = amps::detail::diagram_of(test.mesh, amps::sample(test.mesh, options).samples, 1);
    const auto x = [&](Index s) { return diagram.site(s).position(); };
    for (const bool crossings : {false, true}) {
      CAPTURE(crossings);
      double expected = 0;
      std::set<Triple> bad;
      AngleRange range;
      double min_angle = 180, max_angle = 0;
      std::vector<Link> links(at(diagram.num_sites()));
      for (const Triple& t : triples_of(diagram)) {
        const double energy = rating.triangle(x(t[0]), x(t[1]), x(t[2]));
        expected += energy;
        if (energy > 0) bad.insert(t);
        range.add(x(t[0]), x(t[1]), x(t[2]));
        for (std::size_t k = 0; k < 3; ++k) {
          const Index a = t[(k + 1) % 3], b = t[(k + 2) % 3];
          links[at(t[k])][a].insert(b);
          links[at(t[k])][b].insert(a);
          const Vec3 u = x(a) - x(t[k]), v = x(b) - x(t[k]);
          const double angle = std::atan2(u.cross(v).norm(), u.dot(v)) / kDegree;
          min_angle = std::min(min_angle, angle);
          max_angle = std::max(max_angle, angle);
        }
      }
      CHECK(range.min_angle() == doctest::Approx(min_angle).epsilon(1e-9));
      CHECK(range.max_angle() == doctest::Approx(max_angle).epsilon(1e-9));
      std::set<Triple> bad_vertices;
      for (Index s = 0; s < diagram.num_sites(); ++s) {
        const double energy = valence_energy(form_of(links[at(s)]), links[at(s)].size(), crossings);
        expected += energy;
        if (energy > 0) bad_vertices.insert({s, kNone, kNone});
      }
      REQUIRE(!bad.empty());

      StarReader reader(diagram, rating);
      CHECK(!reader.rates_crossings());
      reader.rate_crossings(crossings);
      double sum = 0;
      std::vector<BadItem> items;
      for (Index s = 0; s < diagram.num_sites(); ++s) {
        DualStar star;
        const double energy = reader.energy(s, star);
        sum += energy;
        const std::size_t listed = items.size();
        reader.list_bad(s, items);
        if (items.size() != listed) CHECK(energy > 0);
      }
      CHECK(sum == doctest::Approx(expected).epsilon(1e-12));
      std::set<Triple> listed, listed_vertices;
      for (const BadItem& item : items) {
        const Triple t = {item.a, item.b, item.c};
        CHECK((item.is_vertex() ? listed_vertices : listed).insert(t).second);
      }
      CHECK(listed == bad);
      CHECK(listed_vertices == bad_vertices);
    }
  }
}

TEST_CASE("dual_star: no triangle has no angles") {
  const AngleRange none;
  CHECK(none.min_angle() == 0);
  CHECK(none.max_angle() == 0);
}

TEST_CASE("dual_star: a table gives back the stars it was given last, small ones and large ones") {
  Rng rng(5);
  amps::detail::StarTable table;
  std::vector<DualStar> expected;
  for (int round = 0; round < 4000; ++round) {
    if (rng.below(8) == 0) {
      expected.resize(expected.size() + rng.below(5));
      table.resize(expected.size());
    }
    if (expected.empty()) continue;
    const std::size_t s = rng.below(expected.size());
    DualStar star;
    star.size = static_cast<std::int8_t>(rng.below(DualStar::kMaxSize + 1));
    star.repeats = rng.below(2) == 0;
    for (int k = 0; k < star.size; ++k) star.ring[at(k)] = static_cast<Index>(rng.below(1000));
    const bool small = expected[s].size <= 9 && table.set_small(s, star);
    if (!small) table.set(s, star);
    expected[s] = star;
    const amps::detail::StarTable copy = table;
    for (std::size_t k = 0; k < expected.size(); k += 1 + expected.size() / 20) {
      for (const auto& view : {table[k], copy[k]}) {
        REQUIRE(view.size == expected[k].size);
        CHECK(view.repeats == expected[k].repeats);
        CHECK(std::equal(view.ring, view.ring + view.size, expected[k].ring.begin()));
      }
    }
  }
  CHECK(table.size() == expected.size());
}

}  // namespace amps_test
