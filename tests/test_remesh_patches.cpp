// What remeshing says of its samples and triangles: on which corner, curve and facet a sample is, and of which patch a
// triangle. All of it is compared with curves that are found anew, and with positions alone.
#include "amps/remesh.h"

#include "kit/curves.h"
#include "kit/data.h"
#include "kit/execution.h"
#include "kit/meshes.h"
#include "kit/samples.h"

#include "amps/curves.h"
#include "amps/mesh_io.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

using amps::Curve;
using amps::Neighborhood;
using amps::RemeshResult;
using amps::detail::UnionFind;

namespace {

/// The point of a curve at a length from its start.
Vec3 point_of_curve(const Input& input, const Curve& curve, double parameter) {
  std::size_t k = 1;
  while (k + 1 < curve.arc.size() && curve.arc[k] < parameter) ++k;
  const double t = (parameter - curve.arc[k - 1]) / (curve.arc[k] - curve.arc[k - 1]);
  return (1 - t) * input.vertex(curve.vertices[k - 1]) + t * input.vertex(curve.vertices[k]);
}

/// The patches on the sides of an edge of the input, ascending.
std::vector<Index> patches_at(const Input& input, std::size_t e) {
  std::vector<Index> patches;
  for (const auto& side : input.edges[e]) patches.push_back(input.graph.patch_of_facet[at(side.facet)]);
  std::sort(patches.begin(), patches.end());
  return patches;
}

void check_columns(const Input& input, const RemeshResult& result) {
  const SampleSet& set = result.samples;
  const CurveGraph& graph = input.graph;
  const std::size_t n = at(set.size());
  REQUIRE(set.dimensions.size() == n);
  REQUIRE(set.curves.size() == n);
  REQUIRE(set.parameters.size() == n);
  Index wrong_order = 0, wrong_number = 0, off_corner = 0, off_face = 0, off_edges = 0, out_of_curve = 0;
  double worst = 0;
  for (Index s = 0; s < set.size(); ++s) {
    const Index number = set.curves[at(s)];
    const double parameter = set.parameters[at(s)];
    const Vec3 x = sample_at(set, s);
    const std::set<Index> curves = input.curves_at(amps::detail::sample_of(set, s).at);
    wrong_order += (set.dimensions[at(s)] < 2) == (s < result.report.curves.samples) ? 0 : 1;
    if (set.dimensions[at(s)] == 2) {
      off_face += number == kNone && parameter == 0 && curves.empty() ? 0 : 1;
      continue;
    }
    const std::size_t count = set.dimensions[at(s)] == 0 ? graph.corners.size() : graph.curves.size();
    wrong_number += number >= 0 && at(number) < count ? 0 : 1;
    REQUIRE(wrong_number == 0);
    if (set.dimensions[at(s)] == 0) {
      off_corner += x == input.vertex(graph.corners[at(number)]) && parameter == 0 ? 0 : 1;
      continue;
    }
    const Curve& curve = graph.curves[at(number)];
    out_of_curve += parameter >= 0 && parameter < curve.length() && (curve.closed || parameter > 0) ? 0 : 1;
    off_edges += curves == std::set<Index>{number} ? 0 : 1;
    worst = std::max(worst, (point_of_curve(input, curve, parameter) - x).norm());
  }
  CHECK(wrong_order == 0);
  CHECK(off_face == 0);
  CHECK(off_corner == 0);
  CHECK(out_of_curve == 0);
  CHECK(off_edges == 0);
  CHECK(worst <= 1e-12 * input.diagonal());
}

/// Samples of each curve by their parameter, with its corners at both ends: neighbours are the pairs that the result has edges
/// of, in order.
void check_order(const Input& input, const RemeshResult& result) {
  const SampleSet& set = result.samples;
  std::vector<Index> sample_of_corner(input.graph.corners.size(), kNone);
  std::vector<std::vector<std::pair<double, Index>>> along(input.graph.curves.size());
  for (Index s = 0; s < set.size(); ++s) {
    if (set.dimensions[at(s)] == 0) sample_of_corner[at(set.curves[at(s)])] = s;
    if (set.dimensions[at(s)] == 1) along[at(set.curves[at(s)])].emplace_back(set.parameters[at(s)], s);
  }
  std::vector<Pair> expected;
  for (std::size_t c = 0; c < along.size(); ++c) {
    std::sort(along[c].begin(), along[c].end());
    std::vector<Index> chain;
    const Curve& curve = input.graph.curves[c];
    if (!curve.closed) chain.push_back(sample_of_corner[at(curve.first_corner)]);
    for (const auto& [parameter, s] : along[c]) chain.push_back(s);
    chain.push_back(curve.closed ? chain.front() : sample_of_corner[at(curve.last_corner)]);
    for (std::size_t k = 1; k < chain.size(); ++k) expected.push_back(sorted_pair(chain[k - 1], chain[k]));
  }
  std::vector<Pair> found;
  for (const Pair& pair : result.curve_edges) found.push_back(sorted_pair(pair[0], pair[1]));
  std::sort(expected.begin(), expected.end());
  std::sort(found.begin(), found.end());
  CHECK(found == expected);
}

/// The curve between two neighbours; kNone where it is between two corners that several curves join.
Index curve_of(const Input& input, const SampleSet& set, const Pair& pair) {
  for (const Index s : pair) {
    if (set.dimensions[at(s)] == 1) return set.curves[at(s)];
  }
  const Pair ends = sorted_pair(set.curves[at(pair[0])], set.curves[at(pair[1])]);
  Index found = kNone, times = 0;
  for (std::size_t c = 0; c < input.graph.curves.size(); ++c) {
    const Curve& curve = input.graph.curves[c];
    if (curve.closed || sorted_pair(curve.first_corner, curve.last_corner) != ends) continue;
    found = static_cast<Index>(c), ++times;
  }
  return times == 1 ? found : kNone;
}

/// Facets, patches, and what is on both sides of curves.
void check_patches(const Input& input, const RemeshResult& result) {
  const CurveGraph& graph = input.graph;
  const SampleSet& set = result.samples;
  const auto n = static_cast<std::size_t>(rows(result.mesh.triangles));
  REQUIRE(result.facets.size() == n);
  REQUIRE(result.patches.size() == n);

  // The patches at each corner and curve of the input: their samples are vertices of triangles of these only.
  std::vector<std::set<Index>> of_corner(graph.corners.size()), of_curve(graph.curves.size());
  for (Index f = 0; f < rows(input.mesh.triangles); ++f) {
    if (!input.edges.counts(f)) continue;
    for (int k = 0; k < 3; ++k) {
      const Index corner = graph.corner_of_vertex[at(input.edges.triangles()(f, k))];
      const Index curve = graph.curve_of_edge[input.edges.edge(f, k)];
      if (corner != kNone) of_corner[at(corner)].insert(graph.patch_of_facet[at(f)]);
      if (curve != kNone) of_curve[at(curve)].insert(graph.patch_of_facet[at(f)]);
    }
  }
  Index wrong_patches = 0, strangers = 0;
  std::map<Pair, std::vector<Index>> patches_of_edge;
  for (std::size_t t = 0; t < n; ++t) {
    const Index patch = result.patches[t];
    REQUIRE(result.facets[t] >= 0);
    REQUIRE(result.facets[t] < rows(input.mesh.triangles));
    wrong_patches += patch == graph.patch_of_facet[at(result.facets[t])] ? 0 : 1;
    const Corners corners = corners_of(result.mesh.triangles, static_cast<Index>(t));
    for (std::size_t k = 0; k < 3; ++k) {
      const Index s = corners[k], number = set.curves[at(s)];
      const bool at_home = set.dimensions[at(s)] == 2   ? graph.patch_of_facet[at(facet_of(set, s))] == patch
                           : set.dimensions[at(s)] == 1 ? of_curve[at(number)].count(patch) > 0
                                                        : of_corner[at(number)].count(patch) > 0;
      strangers += at_home ? 0 : 1;
      patches_of_edge[sorted_pair(s, corners[(k + 1) % 3])].push_back(patch);
    }
  }
  CHECK(wrong_patches == 0);
  CHECK(strangers == 0);

  Index wrong_sides = 0, ambiguous = 0;
  std::set<Pair> on_curves;
  for (const Pair& pair : result.curve_edges) {
    on_curves.insert(sorted_pair(pair[0], pair[1]));
    const Index curve = curve_of(input, set, pair);
    if (curve == kNone) {
      ++ambiguous;
      continue;
    }
    std::vector<Index> found = patches_of_edge[sorted_pair(pair[0], pair[1])];
    std::sort(found.begin(), found.end());
    for (const std::size_t e : graph.curves[at(curve)].edges) wrong_sides += found == patches_at(input, e) ? 0 : 1;
  }
  CHECK(wrong_sides == 0);
  CHECK(10 * static_cast<std::size_t>(ambiguous) <= result.curve_edges.size());

  // Triangles that hang together across edges off the curves: one part for each patch.
  UnionFind parts(n);
  std::map<Pair, std::size_t> first_at;
  for (std::size_t t = 0; t < n; ++t) {
    const Corners corners = corners_of(result.mesh.triangles, static_cast<Index>(t));
    for (std::size_t k = 0; k < 3; ++k) {
      const Pair pair = sorted_pair(corners[k], corners[(k + 1) % 3]);
      if (on_curves.count(pair) == 0) parts.join(t, first_at.emplace(pair, t).first->second);
    }
  }
  std::map<std::size_t, std::set<Index>> patches_of_part;
  std::set<Index> patches;
  for (std::size_t t = 0; t < n; ++t) {
    patches_of_part[parts.find(t)].insert(result.patches[t]);
    patches.insert(result.patches[t]);
  }
  for (const auto& [part, in_it] : patches_of_part) CHECK(in_it.size() == 1);
  CHECK(patches_of_part.size() == at(graph.num_patches));
  CHECK(patches.size() == at(graph.num_patches));
  CHECK(*patches.begin() == 0);
  CHECK(*patches.rbegin() == graph.num_patches - 1);
}

void check_all(const Input& input, const RemeshResult& result) {
  REQUIRE(result.status != Outcome::kCancelled);
  REQUIRE(result.report.certificate.holds());
  CHECK(amps::lost_shape(result.report).empty());
  check_columns(input, result);
  check_order(input, result);
  check_patches(input, result);
}

}  // namespace

TEST_CASE("remesh says where: samples by corner, curve and facet, triangles by facet and patch") {
  for (const Shape& shape : shapes()) {
    CAPTURE(shape.name);
    const Input input(shape.mesh, shape.radius);
    for (const bool optimize : {false, true}) {
      CAPTURE(optimize);
      check_all(input, amps::remesh(shape.mesh, options_of(shape, optimize, 3)));
    }
    const Input soup(soup_of(shape.mesh), shape.radius);
    check_all(soup, amps::remesh(soup.mesh, options_of(shape, false, 3)));
  }
}

TEST_CASE("remesh says where: on real parts") {
  const std::vector<NamedMesh> parts = {{"fandisk.obj", prism(regular(6), 1, Vec3::Zero())},
                                        {"hemisphere.off", hemisphere(5120)},
                                        {"hinge_ascii.stl", wedge(40)}};
  for (const NamedMesh& part : parts) {
    CAPTURE(part.name);
    const Mesh mesh = data_mesh_or(part.name, part.mesh);
    const double radius = radius_for(mesh, 3000);
    for (const bool optimize : {false, true}) {
      CAPTURE(optimize);
      RemeshOptions options = plain(with_radius(radius));
      options.optimize = optimize;
      check_all(Input(mesh, radius), amps::remesh(mesh, options));
    }
  }
}

TEST_SUITE("slow") {
  TEST_CASE("remesh says where: on more real parts, wherever the topology is that of the input") {
    Index made = 0, certified = 0;
    for (const std::string name :
         {"anchor.off", "bunny_36k_holes.obj", "cube_twist.obj", "fan3_nonmanifold_edge.obj", "fandisk.obj",
          "fandisk_coarse.obj", "joined_tetrahedra.obj", "mech-holes-shark.off", "moebius.obj", "netgen_part1_ascii.stl",
          "teapot.obj", "thingi_65004.stl", "three_peaks.off"}) {
      CAPTURE(name);
      const Mesh mesh = data_mesh_or(name, pipe(48));
      const double radius = radius_for(mesh, 4000);
      RemeshOptions options;
      options.sampling = with_radius(radius);
      const RemeshResult result = amps::remesh(mesh, options);
      ++made;
      if (!result.report.certificate.holds()) continue;
      ++certified;
      check_all(Input(mesh, radius), result);
    }
    CHECK(2 * certified > made);
  }
}

TEST_CASE("remesh says where: patches follow labels, with all of their area") {
  constexpr Index kCells = 8, kLabels = 3;
  const Mesh mesh = amps::make_square(kCells);
  RemeshOptions options = plain(with_radius(0.05));
  std::vector<double> wanted(at(kLabels), 0);
  const std::vector<double> areas = amps::facet_areas(mesh);
  for (Index f = 0; f < rows(mesh.triangles); ++f) {  // stairs, so that borders have corners
    Vec3 middle = Vec3::Zero();
    for (int k = 0; k < 3; ++k) middle += MeshView(mesh).corner(f, k) / 3;
    const Index column = static_cast<Index>(kCells * middle.x()), row = static_cast<Index>(kCells * middle.y());
    options.curves.labels.push_back(column < kCells / 2 ? 0 : row < column ? 1 : 2);
    wanted[at(options.curves.labels.back())] += areas[at(f)];
  }
  for (const bool optimize : {false, true}) {
    options.optimize = optimize;
    const Input input(mesh, 0.05, options.curves);
    REQUIRE(input.graph.num_patches == kLabels);
    const RemeshResult result = amps::remesh(mesh, options);
    check_all(input, result);
    std::vector<double> found(at(kLabels), 0);
    std::map<Index, std::set<Index>> labels_of_patch;
    const std::vector<double> of_triangles = amps::facet_areas(result.mesh);
    for (std::size_t t = 0; t < result.facets.size(); ++t) {
      const Index label = options.curves.labels[at(result.facets[t])];
      found[at(label)] += of_triangles[t];
      labels_of_patch[result.patches[t]].insert(label);
    }
    for (const auto& [patch, labels] : labels_of_patch) CHECK(labels.size() == 1);
    for (std::size_t k = 0; k < found.size(); ++k) CHECK(found[k] == doctest::Approx(wanted[k]).epsilon(1e-12));
  }
}

TEST_CASE("remesh says where: without curves all is on facets of one patch, and balls say nothing") {
  const Mesh mesh = amps::make_sphere(1280);
  for (const bool optimize : {false, true}) {
    RemeshOptions options = plain(with_radius(0.15));
    options.optimize = optimize;
    const RemeshResult result = amps::remesh(mesh, options);
    const auto n = at(result.samples.size()), triangles = static_cast<std::size_t>(rows(result.mesh.triangles));
    CHECK(result.samples.dimensions == std::vector<std::uint8_t>(n, 2));
    CHECK(result.samples.curves == std::vector<Index>(n, kNone));
    CHECK(result.samples.parameters == Values(n, 0));
    CHECK(result.facets.size() == triangles);
    CHECK(result.patches == std::vector<Index>(triangles, 0));
    options.sampling.neighborhood = Neighborhood::kSpace;
    const RemeshResult balls = amps::remesh(mesh, options);
    CHECK(balls.samples.dimensions.empty());
    CHECK(balls.samples.curves.empty());
    CHECK(balls.samples.parameters.empty());
    CHECK(balls.patches == std::vector<Index>(static_cast<std::size_t>(rows(balls.mesh.triangles)), 0));
  }
}

TEST_CASE("remesh says where: sample files keep it") {
  const RemeshResult result = amps::remesh(amps::make_cube(2), plain(with_radius(0.15)));
  for (const amps::SampleFormat format : {amps::SampleFormat::kCsv, amps::SampleFormat::kPly}) {
    const SampleSet back = amps::parse_samples(amps::format_samples(result.samples, format), format);
    CHECK(same_set_on_curves(back, result.samples));
  }
}

TEST_CASE("remesh says where: cancelled at any time, of all samples or of none") {
  const Mesh mesh = amps::make_cube(3);
  RemeshOptions options;
  options.sampling = with_radius(0.08);
  int looks = 0, last_look = 0;
  watch(options.sampling, [&](const char*, double) { return ++looks != last_look; });
  amps::remesh(mesh, options);
  const int all = looks;
  for (last_look = 1; last_look < all; last_look += 1 + all / 60) {
    looks = 0;
    const RemeshResult result = amps::remesh(mesh, options);
    if (result.samples.size() > 0) CHECK_NOTHROW(amps::detail::require_sample_set(result.samples));
    CHECK(result.facets.size() == static_cast<std::size_t>(rows(result.mesh.triangles)));
    CHECK(result.patches.size() == result.facets.size());
  }
}

}  // namespace amps_test
