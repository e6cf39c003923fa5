// Self-intersections against CGAL with exact predicates: its self_intersections() on meshes that it can hold, and its tests of
// triangles and segments on each pair of facets of soups. orient2d() against CGAL's orientation.
#include "amps/predicates.h"
#include "amps/self_intersections.h"

#include "kit/data.h"
#include "kit/meshes.h"

#include "amps/mesh_io.h"
#include "amps/remesh.h"

#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {
namespace {

using amps::find_self_intersections;
using amps::SelfIntersection;
using amps::SelfIntersectionReport;

namespace PMP = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using KernelPoint = Kernel::Point_3;
using KernelMesh = CGAL::Surface_mesh<KernelPoint>;
using Pairs = std::vector<SelfIntersection>;

KernelPoint kernel_point(const Vec3& x) { return {x[0], x[1], x[2]}; }

/// The facets that count, by number: with an area, and the first with their corners.
std::vector<Index> facets_that_count(const MeshView& mesh) {
  std::vector<Index> result;
  std::set<std::array<std::array<double, 3>, 3>> seen;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    std::array<std::array<double, 3>, 3> corners{};
    for (int k = 0; k < 3; ++k) {
      const Vec3 x = mesh.corner(f, k) + Vec3::Zero();  // −0 + 0 = 0
      corners[at(k)] = {x[0], x[1], x[2]};
    }
    std::sort(corners.begin(), corners.end());
    const bool area =
        !CGAL::collinear(kernel_point(mesh.corner(f, 0)), kernel_point(mesh.corner(f, 1)), kernel_point(mesh.corner(f, 2)));
    if (seen.insert(corners).second && area) result.push_back(f);
  }
  return result;
}

/// By CGAL's tests of two facets with areas that are not the same.
bool cgal_intersect(const std::array<KernelPoint, 3>& s, const std::array<KernelPoint, 3>& t) {
  std::vector<std::size_t> of_s, of_t;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      if (s[i] != t[j]) continue;
      of_s.push_back(i);
      of_t.push_back(j);
    }
  }
  const Kernel::Triangle_3 first(s[0], s[1], s[2]), second(t[0], t[1], t[2]);
  if (of_s.empty()) return CGAL::do_intersect(first, second);
  if (of_s.size() == 1) {
    const Kernel::Segment_3 s_opposite(s[(of_s[0] + 1) % 3], s[(of_s[0] + 2) % 3]);
    const Kernel::Segment_3 t_opposite(t[(of_t[0] + 1) % 3], t[(of_t[0] + 2) % 3]);
    return CGAL::do_intersect(first, t_opposite) || CGAL::do_intersect(second, s_opposite);
  }
  const KernelPoint &a = s[of_s[0]], &b = s[of_s[1]], &c = s[3 - of_s[0] - of_s[1]], &d = t[3 - of_t[0] - of_t[1]];
  return CGAL::coplanar(a, b, c, d) && CGAL::coplanar_orientation(a, b, c, d) == CGAL::POSITIVE;
}

/// All pairs of facets whose boxes meet.
Pairs cgal_pairs(const MeshView& mesh) {
  const std::vector<Index> facets = facets_that_count(mesh);
  std::vector<std::array<KernelPoint, 3>> corners;
  std::vector<CGAL::Bbox_3> boxes;
  for (const Index f : facets) {
    corners.push_back({kernel_point(mesh.corner(f, 0)), kernel_point(mesh.corner(f, 1)), kernel_point(mesh.corner(f, 2))});
    boxes.push_back(corners.back()[0].bbox() + corners.back()[1].bbox() + corners.back()[2].bbox());
  }
  Pairs result;
  for (std::size_t i = 0; i < facets.size(); ++i) {
    for (std::size_t j = i + 1; j < facets.size(); ++j) {
      if (CGAL::do_overlap(boxes[i], boxes[j]) && cgal_intersect(corners[i], corners[j]))
        result.push_back({facets[i], facets[j]});
    }
  }
  return result;
}

/// CGAL's own answer, where it can hold the mesh: vertices of equal position are one, all facets count.
std::optional<Pairs> cgal_mesh_pairs(const Mesh& mesh) {
  const Mesh merged = amps::merge_equal_vertices(mesh);
  if (static_cast<std::ptrdiff_t>(facets_that_count(merged).size()) != merged.triangles.rows()) return std::nullopt;
  KernelMesh held;
  const MeshView view(merged);
  std::vector<KernelMesh::Vertex_index> vertices;
  for (Index v = 0; v < view.num_vertices(); ++v) vertices.push_back(held.add_vertex(kernel_point(view.vertices[v])));
  for (Index f = 0; f < view.num_facets(); ++f) {
    const auto vertex = [&](int k) { return vertices[at(view.triangles(f, k))]; };
    if (!held.add_face(vertex(0), vertex(1), vertex(2)).is_valid()) return std::nullopt;
  }
  std::vector<std::pair<KernelMesh::Face_index, KernelMesh::Face_index>> found;
  PMP::self_intersections<CGAL::Sequential_tag>(faces(held), held, std::back_inserter(found));
  Pairs result;
  for (const auto& pair : found) {
    const auto a = static_cast<Index>(pair.first.idx()), b = static_cast<Index>(pair.second.idx());
    result.push_back({std::min(a, b), std::max(a, b)});
  }
  std::sort(result.begin(), result.end());
  return result;
}

double some_ulps_off(Rng& rng, double x) {
  for (std::uint64_t k = rng.below(3); k > 0; --k) x = std::nextafter(x, rng.below(2) == 0 ? -1e300 : 1e300);
  return x;
}

/// Facets with corners among a few points that are nearly on the lines and planes of others: means and sums of points, each
/// coordinate off by up to two units in the last place.
Mesh nearly_degenerate_soup(Rng& rng, Index num_points, Index num_facets) {
  std::vector<Vec3> points;
  for (Index n = 0; n < num_points; ++n) {
    const auto any = [&] { return points[at(below(rng, n))]; };
    Vec3 x = random_point(rng);
    if (n > 2) {
      const double s = rng.uniform(), t = rng.uniform();
      switch (rng.below(4)) {
        case 0:
          x = (1 - s) * any() + s * any();
          break;
        case 1:
          x = any() + s * (any() - any());
          break;
        case 2:
          x = any() + s * (any() - any()) + t * (any() - any());
          break;
        default:
          break;
      }
    }
    for (int k = 0; k < 3; ++k) x[k] = some_ulps_off(rng, x[k]);
    points.push_back(x);
  }
  std::vector<Corners> facets;
  for (Index f = 0; f < num_facets; ++f)
    facets.push_back({below(rng, num_points), below(rng, num_points), below(rng, num_points)});
  return mesh_of(points, facets);
}

}  // namespace

TEST_CASE("self-intersections vs CGAL: random facets on a lattice") {
  Rng rng(1);
  std::size_t pairs = 0;
  for (int n = 0; n < 1500; ++n) {
    CAPTURE(n);
    const Index side = 2 + below(rng, 5), num_points = 4 + below(rng, 20);
    std::vector<Vec3> points;
    for (Index v = 0; v < num_points; ++v)
      points.emplace_back(double(below(rng, side)), double(below(rng, side)), double(below(rng, side)));
    std::vector<Corners> facets;
    for (Index f = 0; f < 20; ++f) facets.push_back({below(rng, num_points), below(rng, num_points), below(rng, num_points)});
    const Mesh mesh = mesh_of(points, facets);
    const Pairs expected = cgal_pairs(mesh);
    REQUIRE(find_self_intersections(mesh).pairs == expected);
    pairs += expected.size();
  }
  CHECK(pairs > 10000);
}

TEST_CASE("self-intersections vs CGAL: corners within a few units in the last place of lines and planes of others") {
  Rng rng(2);
  std::size_t pairs = 0;
  for (int n = 0; n < 1500; ++n) {
    CAPTURE(n);
    const Mesh mesh = nearly_degenerate_soup(rng, 5 + below(rng, 12), 20);
    const Pairs expected = cgal_pairs(mesh);
    REQUIRE(find_self_intersections(mesh).pairs == expected);
    pairs += expected.size();
  }
  CHECK(pairs > 10000);
}

TEST_CASE("self-intersections vs CGAL: soups of facets of all kinds and sizes") {
  Rng rng(3);
  for (int n = 0; n < 10; ++n) {
    const Mesh mesh = n % 2 == 0 ? hard_soup(300, rng) : random_soup(300, 100 + static_cast<std::uint64_t>(n));
    CHECK(find_self_intersections(mesh).pairs == cgal_pairs(mesh));
  }
}

TEST_CASE("self-intersections vs CGAL: meshes shaken until they cross themselves") {
  Rng rng(4);
  for (const NamedMesh& m : small_meshes()) {
    CAPTURE(m.name);
    for (const double amount : {0.0, 0.05, 0.3}) {
      const Mesh mesh = amount > 0 ? shaken(m.mesh, amount, rng) : m.mesh;
      const Pairs found = find_self_intersections(mesh).pairs;
      CHECK(found == cgal_pairs(mesh));
      if (const auto expected = cgal_mesh_pairs(mesh)) CHECK(found == *expected);
    }
  }
}

TEST_CASE("self-intersections vs CGAL: real meshes") {
  constexpr Index kMaxFacetsOfAllPairs = 15000;
  const std::optional<std::string> index = data_file("INDEX.md");
  if (!index) return;  // the meshes above are the stand-ins
  const std::filesystem::path folder = std::filesystem::path(*index).parent_path();
  std::vector<std::filesystem::path> paths;
  for (const auto& within : {folder, folder / "reports"}) {
    for (const auto& entry : std::filesystem::directory_iterator(within)) {
      const std::string extension = entry.path().extension().string();
      if (extension == ".obj" || extension == ".off" || extension == ".ply" || extension == ".stl")
        paths.push_back(entry.path());
    }
  }
  std::sort(paths.begin(), paths.end());
  int held = 0, with_pairs = 0;
  for (const auto& path : paths) {
    const std::string name = path.string();
    CAPTURE(name);
    Mesh mesh;
    try {
      mesh = amps::read_mesh(name);
    } catch (const Error&) {
      continue;  // some are there to be refused
    }
    if (amps::check(mesh).non_finite_vertices > 0) mesh = amps::remove_isolated_vertices(mesh);
    const SelfIntersectionReport found = find_self_intersections(mesh);
    const std::optional<Pairs> expected = cgal_mesh_pairs(mesh);
    if (expected) CHECK(found.pairs == *expected);
    if (mesh.triangles.rows() < kMaxFacetsOfAllPairs) CHECK(found.pairs == cgal_pairs(mesh));
    held += expected.has_value();
    with_pairs += !found.empty();
  }
  CHECK(held > 20);
  CHECK(with_pairs > 5);
}

TEST_CASE("self-intersections vs CGAL: a remesh of a surface, and one whose vertices are pulled about") {
  amps::RemeshOptions options;
  options.sampling.target_count = 3000;
  const Mesh mesh = amps::remesh(data_mesh_or("bunny_3k_closed.off", small_knot()), options).mesh;
  const std::optional<Pairs> expected = cgal_mesh_pairs(mesh);
  REQUIRE(expected);
  CHECK(find_self_intersections(mesh).pairs == *expected);
  Rng rng(5);
  const Mesh pulled = shaken(mesh, 0.03 * amps::bounding_box(mesh).diagonal(), rng);
  const std::optional<Pairs> of_pulled = cgal_mesh_pairs(pulled);
  REQUIRE(of_pulled);
  CHECK(of_pulled->size() > 1000);
  CHECK(find_self_intersections(pulled).pairs == *of_pulled);
}

TEST_CASE("orient2d vs CGAL: at random, nearly in line, at every scale") {
  Rng rng(6);
  amps::StageTally tally;
  for (int n = 0; n < 60000; ++n) {
    Vec3 a = random_point(rng), b = random_point(rng), c = random_point(rng);
    const double t = 4 * rng.uniform() - 2;
    if (n % 3 == 1) {
      for (int k = 0; k < 3; ++k) c[k] = some_ulps_off(rng, a[k] + t * (b[k] - a[k]));
    }
    if (n % 3 == 2) {  // exactly in line where the multiples are exact
      for (Vec3* x : {&a, &b}) {
        for (int k = 0; k < 3; ++k) (*x)[k] = std::floor(0x1p20 * (*x)[k]);
      }
      c = a + double(below(rng, 9)) * (b - a);
    }
    constexpr int kExponents[] = {0, 0, 0, -1060, -520, -300, 300, 500, 990};
    const int exponent = kExponents[rng.below(9)];
    for (Vec3* x : {&a, &b, &c}) {
      for (int k = 0; k < 3; ++k) (*x)[k] = std::ldexp((*x)[k], exponent - (n % 3 == 2 ? 20 : 0));
    }
    for (int axis = 0; axis < 3; ++axis) {
      const auto dropped = [axis](const Vec3& x) { return CGAL::Epeck::Point_2(x[(axis + 1) % 3], x[(axis + 2) % 3]); };
      const int sign = amps::orient2d(a.data(), b.data(), c.data(), axis, &tally);
      REQUIRE(sign == static_cast<int>(CGAL::orientation(dropped(a), dropped(b), dropped(c))));
      REQUIRE(amps::orient2d(b.data(), a.data(), c.data(), axis) == -sign);
      REQUIRE(amps::orient2d(c.data(), a.data(), b.data(), axis) == sign);
      const int filtered = amps::detail::orient2d_filter(a.data(), b.data(), c.data(), axis);
      REQUIRE((filtered == sign || filtered == 0));
    }
  }
  for (const amps::Stage stage : {amps::Stage::kFilter, amps::Stage::kExactNarrow, amps::Stage::kExactMiddle}) {
    CHECK(tally[stage] > 200);
  }
}

}  // namespace amps_test
