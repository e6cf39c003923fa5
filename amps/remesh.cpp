#define AMPS_OWN_SOURCE
#include "amps/remesh.h"

#include "amps/mesh_edges.h"
#include "amps/power_diagram.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace amps {
namespace detail {
namespace {

/// Dual triangles, each triple of sites once (the first met, in the order of fragments).
Triangles unique_triples(const Triangles& triangles) {
  struct Keyed {
    std::array<Index, 3> sorted;
    Index row;
  };
  std::vector<Keyed> keyed(static_cast<std::size_t>(triangles.rows()));
  for (Index t = 0; t < triangles.rows(); ++t) {
    Keyed& k = keyed[static_cast<std::size_t>(t)];
    k = {{triangles(t, 0), triangles(t, 1), triangles(t, 2)}, t};
    if (k.sorted[1] > k.sorted[2]) std::swap(k.sorted[1], k.sorted[2]);  // the first is the least already
  }
  std::sort(keyed.begin(), keyed.end(),
            [](const Keyed& a, const Keyed& b) { return a.sorted != b.sorted ? a.sorted < b.sorted : a.row < b.row; });
  // In sorted order, so that the output does not depend on the history of the diagram.
  Triangles result(triangles.rows());
  std::ptrdiff_t kept = 0;
  for (std::size_t k = 0; k < keyed.size(); ++k) {
    if (k == 0 || keyed[k].sorted != keyed[k - 1].sorted) result.row(kept++) = triangles.row(keyed[k].row);
  }
  result.resize(kept);
  return result;
}

/// Flips triangles so that manifold edges are traversed once in each direction, as far as the surface is orientable; per
/// component (across manifold edges) the majority of the given orientations stays.
void orient_consistently(Triangles& triangles, Index num_vertices) {
  struct Link {
    Index triangle;
    bool same;  ///< both traverse the edge in opposite directions already
  };
  const std::size_t n = static_cast<std::size_t>(triangles.rows());
  std::vector<std::array<Link, 3>> links(n, {Link{kNone, true}, Link{kNone, true}, Link{kNone, true}});
  std::vector<std::uint8_t> link_count(n, 0);
  const MeshEdges edges(triangles, num_vertices);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const MeshEdge edge = edges[e];
    if (edge.size() != 2) continue;
    const auto ta = slot(edge[0].facet), tb = slot(edge[1].facet);
    links[ta][link_count[ta]++] = {edge[1].facet, edge.regular()};
    links[tb][link_count[tb]++] = {edge[0].facet, edge.regular()};
  }
  enum : std::uint8_t { kUnseen, kKept, kFlipped };
  std::vector<std::uint8_t> decision(n, kUnseen);
  std::vector<Index> component;
  for (std::size_t seed = 0; seed < n; ++seed) {
    if (decision[seed] != kUnseen) continue;
    decision[seed] = kKept;
    component.assign(1, static_cast<Index>(seed));
    std::size_t flipped = 0;
    for (std::size_t k = 0; k < component.size(); ++k) {
      const auto t = static_cast<std::size_t>(component[k]);
      flipped += decision[t] == kFlipped;
      for (const Link& link : links[t]) {
        if (link.triangle == kNone || decision[static_cast<std::size_t>(link.triangle)] != kUnseen) continue;
        decision[static_cast<std::size_t>(link.triangle)] = (decision[t] == kKept) == link.same ? kKept : kFlipped;
        component.push_back(link.triangle);
      }
    }
    const std::uint8_t turn = 2 * flipped > component.size() ? kKept : kFlipped;
    for (const Index t : component) {
      if (decision[static_cast<std::size_t>(t)] == turn) std::swap(triangles(t, 1), triangles(t, 2));
    }
  }
}

/// `ids`: the sites, in the order of the result's vertices; empty: as they are.
Triangles restricted_triangles(const RestrictedPowerDiagram& diagram, const std::vector<Index>& ids = {}) {
  Triangles triangles = diagram.dual_triangles();
  if (!ids.empty()) {
    std::vector<Index> row(slot(diagram.num_sites()), kNone);
    for (std::size_t k = 0; k < ids.size(); ++k) row[slot(ids[k])] = static_cast<Index>(k);
    for (std::ptrdiff_t t = 0; t < triangles.rows(); ++t) {
      std::array<Index, 3> v = {row[slot(triangles(t, 0))], row[slot(triangles(t, 1))], row[slot(triangles(t, 2))]};
      std::rotate(v.begin(), std::min_element(v.begin(), v.end()), v.end());
      triangles.row(t) << v[0], v[1], v[2];
    }
  }
  triangles = unique_triples(triangles);
  orient_consistently(triangles, ids.empty() ? diagram.num_sites() : static_cast<Index>(ids.size()));
  return triangles;
}

}  // namespace
}  // namespace detail

Mesh restricted_triangulation(const MeshView& mesh, const SampleSet& samples, unsigned threads) {
  return {samples.positions, detail::restricted_triangles(detail::diagram_of(mesh, samples, threads))};
}

RemeshResult remesh(const MeshView& mesh, const RemeshOptions& options) {
  SamplingOptions sampling = options.sampling;
  if (options.optimize) {
    detail::require_optimize_options(options.optimization);
    if (sampling.target_count > 0) {
      const double growth = detail::expected_growth(options.optimization, detail::is_one_radius(sampling.sizing));
      sampling.target_count = std::max(Index{1}, static_cast<Index>(sampling.target_count / (1 + growth) + 0.5));
    }
  }
  detail::SamplingRun run = detail::sample_with_diagram(mesh, sampling);
  RemeshResult result;
  result.status = run.result.status;
  result.samples = std::move(run.result.samples);
  result.report.sampling = run.result.report;
  result.mesh.vertices = result.samples.positions;
  if (run.diagram == nullptr) return result;

  detail::Stopwatch watch;
  std::vector<Index> ids;
  if (options.optimize && result.status == Outcome::kDone) {
    OptimizeOptions optimization = options.optimization;
    optimization.sizing = sampling.sizing.empty() ? SizingField() : sampling.sizing.scaled(result.report.sampling.sizing_scale);
    optimization.conflict_rule = sampling.conflict_rule;
    optimization.seed = sampling.seed;
    optimization.threads = sampling.threads;
    optimization.progress = sampling.progress;
    OptimizeResult optimized = detail::optimize_diagram(*run.diagram, result.samples, optimization, ids);
    result.samples = std::move(optimized.samples);
    result.mesh.vertices = result.samples.positions;
    result.report.optimization = std::move(optimized.report);
    result.status = std::max(result.status, result.report.optimization.status);
  }
  result.report.seconds_optimize = watch.lap();
  result.mesh.triangles = detail::restricted_triangles(*run.diagram, ids);
  result.report.seconds_remesh = watch.lap();
  // Equal positions are one point to the surface; merging them changes neither area nor facets.
  result.report.input = topology(merge_equal_vertices(mesh));
  result.report.output = topology(result.mesh);
  result.report.quality = quality(result.mesh);
  result.report.maximality = detail::measure_maximality(*run.diagram, options.sampling.conflict_rule);
  result.report.seconds_report = watch.lap();
  return result;
}

}  // namespace amps
