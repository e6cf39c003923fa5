// topology.h: diagrams of disks that know their surface, made for certificates, and the law these are held to: the topology of
// the dual, counted from its triangles alone, against that of the surface.
#pragma once

#include "basics.h"
#include "meshes.h"
#include "samples.h"

#include "amps/disk_set.h"
#include "amps/mesh_edges.h"
#include "amps/power_diagram.h"
#include "amps/reach.h"
#include "amps/topology_certificate.h"

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <memory>
#include <ostream>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

using amps::Neighborhood;
using amps::TopologyCertificate;
using amps::TopologyFailureKind;

/// A sample set, its diagram and all that a certificate takes.
struct Certified {
  Mesh mesh;
  SampleSet set;
  std::shared_ptr<const amps::detail::SurfaceFlood> flood;
  std::unique_ptr<amps::detail::DiskSet> disks;
  std::unique_ptr<amps::RestrictedPowerDiagram> diagram;
  std::vector<Index> curve_of_edge;
  std::function<bool(Index, Index)> may_own;

  Certified(Mesh its_mesh, SampleSet its_set, Neighborhood neighborhood, const std::vector<char>& cut = {})
      : mesh(std::move(its_mesh)), set(std::move(its_set)) {
    flood = std::make_shared<const amps::detail::SurfaceFlood>(mesh, amps::detail::SurfaceEdges(mesh), cut);
    const std::vector<double> weights = amps::detail::weights_of(set.radii);
    if (neighborhood == Neighborhood::kSpace) {
      diagram = std::make_unique<amps::RestrictedPowerDiagram>(mesh, set.positions, weights);
      return;
    }
    disks = std::make_unique<amps::detail::DiskSet>(amps::bounding_box(mesh), amps::detail::min_radius(set),
                                                    amps::detail::max_radius(set), flood);
    for (Index s = 0; s < set.size(); ++s) disks->insert(amps::detail::sample_of(set, s), s);
    diagram = std::make_unique<amps::RestrictedPowerDiagram>(mesh, set.positions, weights, disks->reach_lists(), 1);
  }

  amps::detail::TopologySamples samples() const {
    return {[this](Index s) { return amps::detail::sample_of(set, s).at; }, &curve_of_edge, may_own};
  }
  TopologyCertificate certificate(const amps::Execution& execution = {}) const {
    return amps::detail::TopologyChecker(mesh, *flood).check(*diagram, samples(), execution);
  }
};

/// What two surfaces that are homeomorphic have in common.
struct Invariants {
  Index components = 0, euler = 0, loops = 0;
  bool many_sheets = false;
  bool operator==(const Invariants& b) const {
    return components == b.components && euler == b.euler && loops == b.loops && many_sheets == b.many_sheets;
  }
};
inline std::ostream& operator<<(std::ostream& out, const Invariants& x) {
  return out << x.components << " components, characteristic " << x.euler << ", " << x.loops << " loops, "
             << (x.many_sheets ? "edges of many sheets" : "two sheets");
}

inline Invariants invariants_of(const Mesh& mesh) {
  const amps::TopologyReport report = amps::topology(mesh);
  return {report.components, report.euler_characteristic, report.boundary_loops, report.non_manifold_edges > 0};
}

/// Of the surface whose fans at a vertex are apart, but for vertices at these places.
inline Invariants invariants_of_surface(const Mesh& mesh, const std::set<std::array<double, 3>>& joined_at = {}) {
  const MeshView view(mesh);
  const amps::detail::SurfaceEdges edges(mesh);
  const std::vector<std::size_t> fans = amps::detail::corner_fans(edges.edges());
  std::map<std::pair<bool, std::size_t>, Index> vertex_of_fan;  // or of a vertex
  std::vector<std::array<Index, 3>> triangles;
  for (Index f = 0; f < edges.num_facets(); ++f) {
    if (!edges.counts(f)) continue;
    std::array<Index, 3> triangle{};
    for (std::size_t k = 0; k < 3; ++k) {
      const Index v = edges.triangles()(f, static_cast<int>(k));
      const Vec3 x = view.vertices[v];
      const bool joined = joined_at.count({x[0], x[1], x[2]}) > 0;
      const std::pair<bool, std::size_t> name(joined, joined ? at(v) : fans[3 * at(f) + k]);
      triangle[k] = vertex_of_fan.emplace(name, static_cast<Index>(vertex_of_fan.size())).first->second;
    }
    triangles.push_back(triangle);
  }
  std::vector<Vec3> vertices(vertex_of_fan.size(), Vec3::Zero());
  Triangles corners(static_cast<Index>(triangles.size()));
  for (std::size_t f = 0; f < triangles.size(); ++f) {
    for (int k = 0; k < 3; ++k) corners(static_cast<Index>(f), k) = triangles[f][static_cast<std::size_t>(k)];
  }
  return invariants_of(Mesh{points_of(vertices), std::move(corners)});
}

/// Triples of cells that meet an odd number of times.
inline Mesh dual_of(const Certified& certified) {
  std::map<std::array<Index, 3>, Index> count;
  const Triangles all = certified.diagram->dual_triangles();
  for (Index t = 0; t < rows(all); ++t) {
    std::array<Index, 3> triple = {all(t, 0), all(t, 1), all(t, 2)};
    std::sort(triple.begin(), triple.end());
    ++count[triple];
  }
  std::vector<Corners> triangles;
  for (const auto& [triple, times] : count) {
    if (times % 2 != 0) triangles.push_back({triple[0], triple[1], triple[2]});
  }
  return {certified.set.positions, triangles_of(triangles)};
}

}  // namespace amps_test
