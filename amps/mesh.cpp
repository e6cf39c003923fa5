#define AMPS_OWN_SOURCE
#include "amps/mesh.h"

#include "amps/mesh_edges.h"
#include "amps/mesh_scale.h"
#include "amps/predicates.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <ostream>
#include <string>
#include <utility>

namespace amps {
namespace {

bool facet_in_range(const MeshView& mesh, Index f) {
  const Index n = mesh.num_vertices();
  for (int k = 0; k < 3; ++k) {
    if (mesh.triangles(f, k) < 0 || mesh.triangles(f, k) >= n) return false;
  }
  return true;
}

bool facet_has_repeated_index(const MeshView& mesh, Index f) {
  const Index a = mesh.triangles(f, 0), b = mesh.triangles(f, 1), c = mesh.triangles(f, 2);
  return a == b || b == c || c == a;
}

bool vertex_is_finite(const MeshView& mesh, Index v) {
  return std::isfinite(mesh.vertices(v, 0)) && std::isfinite(mesh.vertices(v, 1)) && std::isfinite(mesh.vertices(v, 2));
}

bool facet_is_finite(const MeshView& mesh, Index f) {
  for (int k = 0; k < 3; ++k) {
    if (!vertex_is_finite(mesh, mesh.triangles(f, k))) return false;
  }
  return true;
}

/// body(i) for all i in [0, n), with looks between.
template <class Body>
void for_each_watched(Index n, const Execution& run, const Body& body) {
  detail::Ticker ticker(run, detail::slot(n), detail::kEdgesPerLook);
  for (Index i = 0; i < n; ++i) {
    ticker.tick();
    body(i);
  }
}

void require_index_sizes(const MeshView& mesh) {
  constexpr std::ptrdiff_t limit = std::numeric_limits<Index>::max();
  if (mesh.vertices.rows() < 0 || mesh.triangles.rows() < 0) {
    throw Error(ErrorCode::kInvalidMesh, "mesh: a view of " + std::to_string(mesh.vertices.rows()) + " vertices and " +
                                             std::to_string(mesh.triangles.rows()) + " facets; counts are not negative");
  }
  if (mesh.vertices.rows() > limit || mesh.triangles.rows() > limit) {
    throw Error(ErrorCode::kTooLarge, "mesh: more than 2^31 - 1 vertices or facets; cut it into parts");
  }
}

void require_indices(const MeshView& mesh) {
  require_index_sizes(mesh);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    if (facet_in_range(mesh, f)) continue;
    throw Error(ErrorCode::kInvalidMesh, "mesh: facet " + std::to_string(f) + " has a corner that is not one of the " +
                                             std::to_string(mesh.num_vertices()) +
                                             " vertices (0-based); remove it or correct its indices");
  }
}

// The facet's normal times twice its area, divided by scale². Scaling by a power of two, only where needed, keeps products of
// coordinate differences away from overflow and underflow.
struct FacetCross {
  Vec3 cross = Vec3::Zero();  // zero iff the corners are exactly collinear (or the product underflows even when scaled)
  double scale = 1.0;
};

FacetCross facet_cross(const MeshView& mesh, Index f) {
  const Vec3 a = mesh.corner(f, 0), b = mesh.corner(f, 1), c = mesh.corner(f, 2);
  FacetCross result;
  Vec3 u = b - a, v = c - a;
  const double size = std::max(u.cwiseAbs().maxCoeff(), v.cwiseAbs().maxCoeff());
  if (size > 0 && std::isfinite(size) && (size > 0x1p200 || size < 0x1p-200)) {
    int exponent = 0;
    std::frexp(size, &exponent);
    exponent = std::clamp(exponent, -1000, 1000);  // so that 2^±exponent is a normal number
    result.scale = std::ldexp(1.0, exponent);
    u *= std::ldexp(1.0, -exponent);
    v *= std::ldexp(1.0, -exponent);
  }
  result.cross = u.cross(v);
  // Each component carries an error below 8·2^-53·|u||v| (two rounded differences and a product each, one subtraction), far
  // under 2^-40·|u||v|: beyond that the corners are not collinear, below it the exact test decides.
  const double bound = 0x1p-80 * detail::squared_norm(u) * detail::squared_norm(v);
  const double square = detail::squared_norm(result.cross);
  if (std::isfinite(square) && !(square > bound) && collinear(a.data(), b.data(), c.data())) result.cross.setZero();
  return result;
}

double facet_area(const MeshView& mesh, Index f) {
  const FacetCross x = facet_cross(mesh, f);
  return 0.5 * detail::norm(x.cross) * x.scale * x.scale;
}

/// The same in units of `scale`.
double scaled_area(const MeshView& mesh, Index f, const detail::MeshScale& scale) {
  const FacetCross x = facet_cross(mesh, f);
  const double factor = x.scale / scale.unit();
  return 0.5 * detail::norm(x.cross) * factor * factor;
}

// Neumaier's compensated sum, so that the total is good to a few last bits whatever the number and order of facets.
class CompensatedSum {
 public:
  void add(double x) {
    const double next = sum_ + x;
    lost_ += std::abs(sum_) >= std::abs(x) ? (sum_ - next) + x : (x - next) + sum_;
    sum_ = next;
  }
  double value() const { return std::isfinite(sum_) ? sum_ + lost_ : sum_; }

 private:
  double sum_ = 0, lost_ = 0;
};

/// NaN does not count, but where there is nothing else.
void grow_box(Box& box, bool& started, const Vec3& p) {
  for (int k = 0; k < 3; ++k) {
    if (!started || p[k] < box.min[k] || std::isnan(box.min[k])) box.min[k] = p[k];
    if (!started || p[k] > box.max[k] || std::isnan(box.max[k])) box.max[k] = p[k];
  }
  started = true;
}

std::vector<char> used_vertices(const MeshView& mesh, const Execution& run) {
  std::vector<char> used(static_cast<std::size_t>(mesh.num_vertices()), 0);
  for_each_watched(mesh.num_facets(), run, [&](Index f) {
    for (int k = 0; k < 3; ++k) {
      const Index v = mesh.triangles(f, k);
      if (v >= 0 && v < mesh.num_vertices()) used[static_cast<std::size_t>(v)] = 1;
    }
  });
  return used;
}

// Keeps the vertices i with keep[i] == i, in order; facets go through `keep`.
Mesh renumbered(const MeshView& mesh, const std::vector<Index>& keep, const Execution& run) {
  std::vector<Index> number(keep.size(), kNone);
  Index count = 0;
  for (std::size_t i = 0; i < keep.size(); ++i) {
    if (keep[i] == static_cast<Index>(i)) number[i] = count++;
  }
  Mesh result;
  result.vertices.resize(count);
  for_each_watched(mesh.num_vertices(), run.part(0, 0.5), [&](Index v) {
    if (number[detail::slot(v)] != kNone) result.vertices.row(number[detail::slot(v)]) = mesh.vertices[v].transpose();
  });
  result.triangles.resize(mesh.num_facets());
  for_each_watched(mesh.num_facets(), run.part(0.5, 1), [&](Index f) {
    for (int k = 0; k < 3; ++k) {
      const Index target = keep[static_cast<std::size_t>(mesh.triangles(f, k))];
      result.triangles(f, k) = number[static_cast<std::size_t>(target)];
    }
  });
  return result;
}

}  // namespace

Mesh MeshView::copy() const {
  Mesh result;
  result.vertices.resize(vertices.rows());
  for (std::ptrdiff_t v = 0; v < vertices.rows(); ++v) result.vertices.row(v) = vertices[v].transpose();
  result.triangles.resize(triangles.rows());
  for (std::ptrdiff_t f = 0; f < triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) result.triangles(f, k) = triangles(f, k);
  }
  return result;
}

void require_usable(const MeshView& mesh, const Execution& execution) {
  const auto fail = [](const std::string& what) { throw Error(ErrorCode::kInvalidMesh, "mesh: " + what); };
  require_index_sizes(mesh);
  if (mesh.num_facets() == 0) fail("it has no facet; give a surface, not a point set");
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    if (vertex_is_finite(mesh, v)) continue;
    fail("vertex " + std::to_string(v) + " (0-based) has a coordinate that is NaN or infinite; remove or correct it");
  }
  require_indices(mesh);
  const Execution run = execution.start("checking the mesh");
  // Repeated facets make no difference here, and take time to find. In units of the mesh: areas in its own may be no doubles.
  bool has_area = false;
  const detail::MeshScale scale(mesh);
  for_each_watched(mesh.num_facets(), run, [&](Index f) { has_area = has_area || scaled_area(mesh, f, scale) > 0; });
  run.finish();
  if (!has_area) fail("it has no area: the corners of every facet are in one line, or nearly; repair it");
}

Index find_wild_vertex(const MeshView& mesh, const Execution& execution) {
  constexpr Index least_facets = 12, facets_looked_at = 63;
  constexpr double near_by = 0.5e-6;  // in longest sides of the box, on each side
  if (mesh.num_facets() < least_facets) return kNone;
  const Execution run = execution.start("checking the mesh");
  const auto counts = [&](Index f) { return facet_in_range(mesh, f) && facet_is_finite(mesh, f); };
  Box box;
  bool started = false;
  for_each_watched(mesh.num_facets(), run.part(0, 0.9), [&](Index f) {
    for (int k = 0; counts(f) && k < 3; ++k) grow_box(box, started, mesh.corner(f, k));
  });
  // Some corners tell where most are.
  std::vector<double> some[3];
  for (Index i = 0; i < facets_looked_at; ++i) {
    const auto f = static_cast<Index>(std::int64_t{i} * mesh.num_facets() / facets_looked_at);
    if (!counts(f)) continue;
    for (int k = 0; k < 3; ++k) some[k].push_back(mesh.corner(f, i % 3)[k]);
  }
  Index wild = kNone;
  if (!some[0].empty()) {
    Vec3 middle;
    for (int k = 0; k < 3; ++k) {
      const auto median = some[k].begin() + static_cast<std::ptrdiff_t>(some[k].size() / 2);
      std::nth_element(some[k].begin(), median, some[k].end());
      middle[k] = *median;
    }
    const double reach = near_by * (box.max - box.min).maxCoeff();
    // Of needles both ends are many; a fan around a far vertex is a needle too.
    const std::int64_t most = std::max<std::int64_t>(6, 3 * std::int64_t{mesh.num_facets()} / 20);
    std::int64_t far = 0;
    double farthest = 0;
    detail::Ticker ticker(run.part(0.9, 1), detail::slot(mesh.num_facets()), detail::kEdgesPerLook);
    for (Index f = 0; f < mesh.num_facets() && far <= most; ++f) {
      ticker.tick();
      for (int k = 0; counts(f) && k < 3; ++k) {
        const double distance = (mesh.corner(f, k) - middle).cwiseAbs().maxCoeff();
        if (!(distance > reach)) continue;
        ++far;
        if (distance <= farthest) continue;
        farthest = distance;
        wild = mesh.triangles(f, k);
      }
    }
    if (far > most) wild = kNone;
  }
  run.finish();
  return wild;
}

std::vector<double> facet_areas(const MeshView& mesh, const Execution& execution) {
  return detail::FacetAreas(mesh, execution).of_facets;
}

double total_area(const MeshView& mesh, const Execution& execution) { return detail::FacetAreas(mesh, execution).total; }

detail::FacetAreas::FacetAreas(const MeshView& mesh, const Execution& execution) {
  require_indices(mesh);
  const Execution run = execution.start("measuring areas");
  *this = FacetAreas(mesh, find_repeated_facets(mesh, run.part(0, 0.25)), run.part(0.25, 1));
  run.finish();
}

detail::FacetAreas::FacetAreas(const MeshView& mesh, const std::vector<Index>& repeated_facets, const Execution& execution)
    : of_facets(static_cast<std::size_t>(mesh.num_facets())) {
  require_indices(mesh);
  const Execution run = execution.start("measuring areas");
  for_each_index_on_all_threads(of_facets.size(), run,
                                [&](std::size_t f) { of_facets[f] = facet_area(mesh, static_cast<Index>(f)); });
  for (const Index f : repeated_facets) of_facets[static_cast<std::size_t>(f)] = 0;
  CompensatedSum sum;
  for (const double area : of_facets) sum.add(area);
  total = sum.value();
  run.finish();
}

Points facet_normals(const MeshView& mesh, const Execution& execution) {
  require_indices(mesh);
  const Execution run = execution.start("measuring normals");
  Points normals(mesh.num_facets());
  for_each_watched(mesh.num_facets(), run, [&](Index f) {
    const Vec3 cross = facet_cross(mesh, f).cross;
    if (detail::squared_norm(cross) > 0) normals.row(f) = detail::stable_normalized(cross).transpose();
  });
  run.finish();
  return normals;
}

double Box::diagonal() const {
  const Vec3 sides = max - min;
  const detail::MeshScale scale = detail::MeshScale::of_length(sides.maxCoeff());
  return scale.length_back(detail::norm(scale.point(sides)));
}

Box bounding_box(const MeshView& mesh, const Execution& execution) {
  require_indices(mesh);
  const Execution run = execution.start("measuring the box");
  Box box;
  bool started = false;
  const std::vector<char> used = used_vertices(mesh, run.part(0, 0.6));  // each is read once
  for_each_watched(mesh.num_vertices(), run.part(0.6, 1), [&](Index v) {
    if (used[static_cast<std::size_t>(v)] != 0) grow_box(box, started, mesh.vertices[v]);
  });
  run.finish();
  return box;
}

Mesh remove_isolated_vertices(const MeshView& mesh, const Execution& execution) {
  require_indices(mesh);
  const Execution run = execution.start("removing vertices");
  const std::vector<char> used = used_vertices(mesh, run.part(0, 0.3));
  std::vector<Index> keep(used.size(), kNone);
  for (std::size_t v = 0; v < used.size(); ++v) {
    if (used[v] != 0) keep[v] = static_cast<Index>(v);
  }
  Mesh result = renumbered(mesh, keep, run.part(0.3, 1));
  run.finish();
  return result;
}

Mesh merge_equal_vertices(const MeshView& mesh, const Execution& execution) {
  require_indices(mesh);
  const Execution run = execution.start("merging vertices");
  const std::vector<Index> first = detail::first_equal_vertices(mesh, run.part(0, 0.7));
  Mesh result = renumbered(mesh, first, run.part(0.7, 1));
  run.finish();
  return result;
}

namespace {

// Edges by the number and orientation of their facets.
void count_edges(const detail::MeshEdges& edges, TopologyReport& report, const Execution& run) {
  report.edges = static_cast<Index>(edges.size());
  detail::Ticker ticker(run, edges.size(), detail::kEdgesPerLook);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    ticker.tick();
    const detail::MeshEdge edge = edges[e];
    report.boundary_edges += edge.boundary() ? 1 : 0;
    report.non_manifold_edges += edge.non_manifold() ? 1 : 0;
    report.inconsistent_edges += edge.size() == 2 && !edge.regular() ? 1 : 0;
  }
}

// The closed curves of the boundary graph, with each vertex split into its fans.
Index count_boundary_loops(const detail::MeshEdges& edges, const std::vector<std::size_t>& fans, const Execution& run) {
  detail::UnionFind boundary(fans.size());
  std::vector<char> on_boundary(fans.size(), 0);
  detail::Ticker ticker(run.part(0, 0.5), edges.size(), detail::kEdgesPerLook);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    ticker.tick();
    if (!edges[e].boundary()) continue;
    const std::size_t a = fans[edges[e][0].low_corner()], b = fans[edges[e][0].high_corner()];
    on_boundary[a] = on_boundary[b] = 1;
    boundary.join(a, b);
  }
  return static_cast<Index>(boundary.count(on_boundary, run.part(0.5, 1)));
}

}  // namespace

TopologyReport detail::topology_of(const TrianglesView& triangles, Index num_vertices, const MeshEdges& edges,
                                   const std::vector<char>& counted, const Execution& run) {
  TopologyReport report;
  std::vector<char> used(slot(num_vertices), 0);
  UnionFind surface(used.size());
  for_each_watched(static_cast<Index>(triangles.rows()), run.part(0, 0.15), [&](Index f) {
    if (!counted.empty() && counted[slot(f)] == 0) return;
    ++report.facets;
    for (int k = 0; k < 3; ++k) {
      used[slot(triangles(f, k))] = 1;
      if (k > 0) surface.join(slot(triangles(f, 0)), slot(triangles(f, k)));
    }
  });
  report.vertices = static_cast<Index>(std::count(used.begin(), used.end(), char{1}));
  report.components = static_cast<Index>(surface.count(used, run.part(0.15, 0.2)));
  count_edges(edges, report, run.part(0.2, 0.3));
  report.euler_characteristic = report.vertices - report.edges + report.facets;

  const std::vector<std::size_t> fans = corner_fans(edges, {}, run.part(0.3, 0.65));
  report.boundary_loops = count_boundary_loops(edges, fans, run.part(0.65, 0.85));

  // Where three or more facets meet at an edge, their corners are in one fan; vertices of such edges are not asked for theirs.
  std::vector<Index> fans_at = fans_at_vertices(triangles, num_vertices, fans, counted, run.part(0.85, 1));
  for (std::size_t e = 0; e < edges.size(); ++e) {
    if (edges[e].non_manifold()) fans_at[slot(edges[e].low)] = fans_at[slot(edges[e].high)] = 1;
  }
  report.non_manifold_vertices =
      static_cast<Index>(std::count_if(fans_at.begin(), fans_at.end(), [](Index n) { return n > 1; }));
  return report;
}

TopologyReport topology(const MeshView& mesh, const Execution& execution) {
  require_index_sizes(mesh);
  const Execution run = execution.start("looking at the topology");
  std::vector<char> counted(static_cast<std::size_t>(mesh.num_facets()), 0);
  for_each_watched(mesh.num_facets(), run.part(0, 0.05), [&](Index f) {
    counted[detail::slot(f)] = facet_in_range(mesh, f) && !facet_has_repeated_index(mesh, f) ? 1 : 0;
  });
  const detail::MeshEdges edges(mesh.triangles, mesh.num_vertices(), counted, run.part(0.05, 0.4));
  const TopologyReport report = detail::topology_of(mesh.triangles, mesh.num_vertices(), edges, counted, run.part(0.4, 1));
  run.finish();
  return report;
}

MeshReport check(const MeshView& mesh, const Execution& execution) {
  require_index_sizes(mesh);
  const Execution run = execution.start("checking the mesh");
  MeshReport report;
  report.vertices = mesh.num_vertices();
  report.facets = mesh.num_facets();
  const std::vector<char> used = used_vertices(mesh, run.part(0, 0.03));
  report.isolated_vertices = static_cast<Index>(std::count(used.begin(), used.end(), char{0}));
  for (Index v = 0; v < report.vertices; ++v) report.non_finite_vertices += vertex_is_finite(mesh, v) ? 0 : 1;
  const std::vector<Index> first = detail::first_equal_vertices(mesh, run.part(0.03, 0.2));
  for (std::size_t v = 0; v < first.size(); ++v) report.duplicate_vertices += first[v] == static_cast<Index>(v) ? 0 : 1;
  const std::vector<Index> copies = detail::find_repeated_facets(mesh, run.part(0.2, 0.25));
  report.repeated_facets = static_cast<Index>(copies.size());
  auto copy = copies.begin();
  CompensatedSum area;
  const detail::MeshScale scale(mesh);
  bool box_started = false;
  for_each_watched(report.facets, run.part(0.25, 0.5), [&](Index f) {
    if (!facet_in_range(mesh, f)) {
      ++report.out_of_range_facets;
      return;
    }
    const bool repeated = facet_has_repeated_index(mesh, f);
    report.repeated_index_facets += repeated ? 1 : 0;
    if (!facet_is_finite(mesh, f)) return;
    for (int k = 0; k < 3; ++k) grow_box(report.box, box_started, mesh.corner(f, k));
    while (copy != copies.end() && *copy < f) ++copy;
    if (copy == copies.end() || *copy != f) {
      area.add(facet_area(mesh, f));
      report.has_area = report.has_area || scaled_area(mesh, f, scale) > 0;
    }
    const Vec3 a = mesh.corner(f, 0), b = mesh.corner(f, 1), c = mesh.corner(f, 2);
    report.zero_area_facets += !repeated && collinear(a.data(), b.data(), c.data()) ? 1 : 0;
  });
  report.area = area.value();
  report.wild_vertex = find_wild_vertex(mesh, run.part(0.5, 0.55));
  report.topology = topology(mesh, run.part(0.55, 1));
  run.finish();
  return report;
}

std::ostream& operator<<(std::ostream& out, const TopologyReport& report) {
  out << "vertices " << report.vertices << ", edges " << report.edges << ", facets " << report.facets << ", components "
      << report.components << ", Euler characteristic " << report.euler_characteristic << ", "
      << (report.closed() ? "closed" : "not closed") << ", boundary loops " << report.boundary_loops << " ("
      << report.boundary_edges << " edges), non-manifold edges " << report.non_manifold_edges << ", non-manifold vertices "
      << report.non_manifold_vertices << ", inconsistent edges " << report.inconsistent_edges;
  if (report.manifold() && report.inconsistent_edges == 0) out << ", genus " << report.genus();
  return out;
}

std::ostream& operator<<(std::ostream& out, const MeshReport& report) {
  out << "vertices               " << report.vertices << "\nfacets                 " << report.facets
      << "\narea                   " << report.area << "\nbox                    [" << report.box.min.transpose() << "] to ["
      << report.box.max.transpose() << "]\ntopology               " << report.topology << "\nnon-finite vertices    "
      << report.non_finite_vertices << "\nout-of-range facets    " << report.out_of_range_facets << "\nrepeated-index facets  "
      << report.repeated_index_facets << "\nzero-area facets       " << report.zero_area_facets << "\nrepeated facets        "
      << report.repeated_facets << "\nduplicate vertices     " << report.duplicate_vertices << "\nisolated vertices      "
      << report.isolated_vertices << "\nwild vertex            "
      << (report.wild_vertex == kNone ? "none" : std::to_string(report.wild_vertex)) << "\nusable                 "
      << (report.usable() ? "yes" : "no") << '\n';
  return out;
}

}  // namespace amps
