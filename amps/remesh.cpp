#define AMPS_OWN_SOURCE
#include "amps/remesh.h"

#include "amps/count_editor.h"
#include "amps/curve_sampling.h"
#include "amps/disk_set.h"
#include "amps/dual_mesh.h"
#include "amps/dual_star.h"
#include "amps/error_refinement.h"
#include "amps/mesh_edges.h"
#include "amps/portable_math.h"
#include "amps/power_diagram.h"
#include "amps/topology_refinement.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace amps {
namespace detail {
namespace {

/// The ends of the parts of remesh() in the range of progress.
struct RemeshParts {
  double sampling, optimization, listing, certificates, extraction, fit;

  RemeshParts(const MeshView& mesh, const SamplingOptions& options, const RemeshOptions& all) {
    // Microseconds a sample or facet, roughly.
    constexpr double kListingCost = 0.2, kExtractionCost = 0.4, kCertificateCost = 0.9, kReportCost = 1.3,
                     kReportFacetCost = 0.2;
    const auto facets = static_cast<double>(mesh.num_facets());
    const double samples = expected_samples(mesh, options);
    sampling = sampling_cost(samples, facets, options.execution.workers());
    optimization = sampling;
    if (all.optimize) optimization += optimization_cost(all.optimization, samples, is_one_radius(options.sizing));
    listing = optimization + kListingCost * samples;
    certificates = listing + kCertificateCost * samples + kReportFacetCost * facets;
    fit = extraction = certificates + kExtractionCost * samples;
    if (all.fit != Fit::kOff) {
      constexpr double kNormalCost = 10, kFreeCost = 100, kFitFacetCost = 1.5;
      const double cost = all.fit == Fit::kNormal ? kNormalCost : kFreeCost;
      fit += kFitFacetCost * facets + cost * samples / options.execution.workers();
    }
    const double end = fit + kReportCost * samples + kReportFacetCost * facets;
    for (double* share : {&sampling, &optimization, &listing, &certificates, &extraction, &fit}) *share /= end;
  }
};

/// The shapes of triangles, and apart from each other of those beside curves and away from them. `asked`: bounds of angles, if
/// any.
void measure_shapes(const Mesh& mesh, const MeshEdges& edges, bool has_curves, const OptimizeReport& asked,
                    const Execution& execution, RemeshReport& report) {
  std::vector<char> is_away;
  if (has_curves) {
    const Index on_curves = report.curves.samples;
    is_away.resize(static_cast<std::size_t>(mesh.triangles.rows()));
    for_each_piece(is_away.size(), kElementsPerLook, execution.part(0, 0.1), [&](std::size_t begin, std::size_t end) {
      for (std::size_t t = begin; t < end; ++t) {
        const auto row = mesh.triangles.row(static_cast<std::ptrdiff_t>(t));
        is_away[t] = row.minCoeff() < on_curves ? 0 : 1;
        if (row.maxCoeff() >= on_curves || !(asked.max_angle > 0)) continue;
        AngleRange angles;
        angles.add(mesh.vertices.row(row[0]).transpose(), mesh.vertices.row(row[1]).transpose(),
                   mesh.vertices.row(row[2]).transpose());
        if (angles.min_angle() < asked.min_angle || angles.max_angle() > asked.max_angle) ++report.curves.forced_triangles;
      }
    });
  }
  const QualityOfParts quality = quality_of_parts(mesh, edges, is_away, execution.part(0.1, 1));
  report.quality = quality.all;
  report.curves.beside = quality.parts[0];
  report.curves.away = has_curves ? quality.parts[1] : quality.all;
}

/// What is proved of samples and diagram, which nobody needs any more then: they go, so that there is room for the mesh.
void certify_and_release(const SamplingSurface& surface, ConflictRule rule, const Execution& execution, SamplingRun& run,
                         RemeshReport& report) {
  report.maximality =
      measure_maximality(*run.diagram, rule, execution.part(0, 0.4), run.disks->knows_surface() ? run.disks.get() : nullptr);
  if (surface.flood != nullptr) {
    TopologySamples samples = topology_samples(*run.disks, surface.curves.get(), run.curves.get());
    samples.covered = report.maximality.gaps == 0;
    report.certificate = surface.topology->check(*run.diagram, samples, execution.part(0.4, 1));
  }
  run.diagram.reset();
  run.disks.reset();
}

/// Measures the mesh. `surface`: the edges of the input.
void measure(const MeshView& mesh, const SurfaceEdges& surface, const SamplingRun& run, const Execution& execution,
             RemeshResult& result) {
  RemeshReport& report = result.report;
  {
    const MeshEdges edges(result.mesh.triangles, static_cast<Index>(result.mesh.vertices.rows()), {}, execution.part(0, 0.1));
    // Each takes one thread: what they have in common is little, and they are as long as each other, roughly.
    const std::function<void(const Execution&)> measures[] = {
        [&](const Execution& part) {
          report.input = topology_of(surface.triangles(), surface.num_vertices(), surface.edges(), surface.counted(), part);
        },
        [&](const Execution& part) {
          report.output = topology_of(result.mesh.triangles, static_cast<Index>(result.mesh.vertices.rows()), edges, {}, part);
        },
        [&](const Execution& part) {
          measure_shapes(result.mesh, edges, run.curves != nullptr, report.optimization, part, report);
        },
    };
    const Execution measuring = execution.part(0.1, 0.5);
    constexpr std::size_t kMeasures = std::size(measures);
    parallel_for(kMeasures, 1, measuring, [&](std::size_t k, std::size_t) {
      measures[k](measuring.part(static_cast<double>(k) / kMeasures, static_cast<double>(k + 1) / kMeasures));
    });
  }
  SelfIntersectionOptions crossing;
  crossing.max_pairs = 0;
  crossing.execution = execution.part(0.5, 0.95);
  report.self_intersections = find_self_intersections(result.mesh, crossing).num_pairs;
  if (report.self_intersections == 0) return;
  crossing.execution = execution.part(0.95, 1);
  report.input_self_intersections = find_self_intersections(mesh, crossing).num_pairs;
}

/// The radius that is wanted on so much area, at first estimate: what curves are found by.
void set_curve_radii(double area, const SamplingOptions& sampling, CurveOptions& curves) {
  if (curves.radius != 0 || !curves.sizing.empty()) return;
  const double target = sampling.target_count;
  if (sampling.sizing.empty()) {
    curves.radius = sampling.radius;
    if (target > 0) curves.radius = std::sqrt(kSamplesPerDensity * area / target);
  } else if (target > 0) {
    curves.sizing = sampling.sizing.scaled(std::sqrt(kSamplesPerDensity * sampling.sizing.density_integral() / target));
  } else {
    curves.sizing = sampling.sizing;
  }
}

/// The surface that disks know, cut at the curves to be kept. `curves`: out, too: the radii that they are found by.
SamplingSurface sampling_surface(const MeshView& mesh, CurveOptions& curves, const SamplingOptions& sampling,
                                 const Execution& execution) {
  SamplingSurface result;
  if (sampling.neighborhood != Neighborhood::kSurface) return result;
  const Execution looking = execution.part(0, 0.4, "finding curves");
  SurfaceEdges edges(mesh, looking.part(0, 0.7));
  const Execution measuring = looking.part(0.7, 1);
  std::vector<std::size_t> fans;
  parallel_for(2, 1, measuring, [&](std::size_t task, std::size_t) {
    if (task == 0) {
      fans = corner_fans(edges.edges(), {}, measuring);
    } else {
      result.area = FacetAreas(mesh, edges.repeated_facets(), measuring).total;
    }
  });
  set_curve_radii(result.area, sampling, curves);
  CurveOptions finding = curves;
  finding.execution = execution.part(0.4, 0.8);
  auto graph = std::make_shared<const CurveGraph>(find_curves(mesh, edges, finding, &fans));
  result.flood = std::make_shared<const SurfaceFlood>(
      mesh, std::move(edges), graph->empty() ? std::vector<char>() : graph->is_curve_edge, execution.part(0.8, 0.9));
  result.topology = std::make_shared<const TopologyChecker>(mesh, *result.flood, execution.part(0.9, 1), &fans);
  result.curves = std::move(graph);
  return result;
}

/// Of candidates that are no curves, all that hang together with one at these facets, as edges by vertices of the surface.
std::vector<std::array<Index, 2>> dropped_edges_at(const SamplingSurface& surface, const std::vector<Index>& facets) {
  const SurfaceEdges& edges = surface.flood->edges();
  const std::vector<std::size_t>& dropped = surface.curves->dropped;
  UnionFind sets(slot(edges.num_vertices()));
  for (const std::size_t e : dropped) sets.join(slot(edges[e].low), slot(edges[e].high));
  std::vector<char> chosen(slot(edges.num_vertices()), 0);
  for (const std::size_t e : dropped) {
    for (const EdgeSide& side : edges[e]) {
      if (std::binary_search(facets.begin(), facets.end(), side.facet)) chosen[sets.find(slot(edges[e].low))] = 1;
    }
  }
  std::vector<std::array<Index, 2>> result;
  for (const std::size_t e : dropped) {
    if (chosen[sets.find(slot(edges[e].low))]) result.push_back({edges[e].low, edges[e].high});
  }
  return result;
}

/// Vertices of these facets that are tips of spikes: facets make less than a right angle around them, and are all there is. The
/// cell around a tip is a disk only among far smaller ones. By vertex of the surface, ascending.
std::vector<Index> tips_at(const MeshView& mesh, const SamplingSurface& surface, const std::vector<Index>& facets) {
  constexpr double kSharp = 1.5707963267948966;
  const SurfaceEdges& edges = surface.flood->edges();
  std::vector<Index> vertices;
  for (const Index f : facets) {
    for (int k = 0; k < 3; ++k) vertices.push_back(edges.triangles()(f, k));
  }
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  std::vector<Index> tips;
  for (const Index v : vertices) {
    bool at_curve = false;
    double angle = 0;
    for (const Index f : surface.flood->homes_of_vertex(v)) {
      for (int k = 0; k < 3; ++k) {
        const int next = (k + 1) % 3, last = (k + 2) % 3;
        if (edges.triangles()(f, k) != v) continue;
        at_curve =
            at_curve || surface.curves->is_curve_edge[edges.edge(f, k)] || surface.curves->is_curve_edge[edges.edge(f, last)];
        const Vec3 a = mesh.corner(f, next) - mesh.corner(f, k), b = mesh.corner(f, last) - mesh.corner(f, k);
        angle += portable_arc_tangent(norm(a.cross(b)), dot(a, b));
      }
    }
    if (!at_curve && angle < kSharp) tips.push_back(v);
  }
  return tips;
}

/// Samples on corners and curves among so many in all, roughly: chords are 1.22 radii long.
double expected_curve_samples(const SamplingSurface& surface, double samples) {
  if (surface.curves == nullptr) return 0;
  constexpr double kChord = 1.22;
  const double radius = std::sqrt(kSamplesPerDensity * surface.area / samples);
  double count = static_cast<double>(surface.curves->corners.size());
  for (const Curve& curve : surface.curves->curves) count += curve.length() / (kChord * radius);
  return count;
}

/// Which edges of curves the result has.
void report_curves(const SamplingSurface& surface, const SamplingRun& run, RemeshResult& result) {
  CurveReport& report = result.report.curves;
  report.patches = 1;
  if (surface.curves == nullptr) return;
  report.patches = surface.curves->num_patches;
  if (run.curves == nullptr) return;
  report.curves = static_cast<Index>(surface.curves->curves.size());
  report.corners = static_cast<Index>(surface.curves->corners.size());
  for (const Curve& curve : surface.curves->curves) {
    report.length += curve.length();
    ++report.curves_of[static_cast<std::size_t>(curve.kind)];
  }
  report.samples = static_cast<Index>(run.curves->samples.size());
  report.deviation = run.curves->report.worst_sagitta;
  report.edges = static_cast<Index>(run.curves->edges.size());
  // Samples on curves are the first vertices, and stay.
  using Pair = std::array<Index, 2>;
  std::vector<Pair> there;
  const Triangles& triangles = result.mesh.triangles;
  for (std::ptrdiff_t t = 0; t < triangles.rows(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const Index a = triangles(t, k), b = triangles(t, (k + 1) % 3);
      if (std::max(a, b) < report.samples) there.push_back({std::min(a, b), std::max(a, b)});
    }
  }
  std::sort(there.begin(), there.end());
  const SurfaceEdges& edges = surface.flood->edges();
  for (std::size_t c = 0; c < surface.curves->curves.size(); ++c) {
    const std::vector<std::size_t>& along = surface.curves->curves[c].edges;
    const std::size_t sheets = edges[along.front()].size();
    const bool everywhere = std::all_of(along.begin(), along.end(), [&](std::size_t e) { return edges[e].size() == sheets; });
    for (std::size_t k = run.curves->first_edge[c]; k < run.curves->first_edge[c + 1]; ++k) {
      const Pair& edge = run.curves->edges[k];
      const Pair sorted = {std::min(edge[0], edge[1]), std::max(edge[0], edge[1])};
      const auto same = std::equal_range(there.begin(), there.end(), sorted);
      const auto num_triangles = static_cast<std::size_t>(same.second - same.first);
      if (everywhere ? num_triangles == sheets : num_triangles > 0) result.curve_edges.push_back(edge);
    }
  }
  report.edges_kept = static_cast<Index>(result.curve_edges.size());
}

/// Samples the surface. Where radii fall without end, an edge is sharp that is not a curve: candidates there become curves
/// (`curves`, `surface`: out as well). In the end radii stay as they are, and the topology is another. Cancelled, what was
/// complete by then stays.
SamplingRun sample_preserving(const MeshView& mesh, CurveOptions& curves, SamplingOptions sampling, SamplingSurface& surface) {
  constexpr int kMaxPromotions = 3;
  const Execution execution = sampling.execution;
  const auto cancelled = [](SamplingRun& run) {
    run.result.status = Outcome::kCancelled;
    run.diagram.reset();
    return std::move(run);
  };
  SamplingRun earlier;
  const auto keep = [&earlier](SamplingRun& run) {
    earlier = std::move(run);
    earlier.diagram.reset();
    earlier.disks.reset();
  };
  double done = 0;
  for (int k = 0;; ++k) {
    constexpr double kShare = 0.7;
    const double next = surface.preserve ? done + kShare * (1 - done) : 1;
    sampling.execution = execution.part(done, next);
    done = next;
    surface.may_change = surface.preserve && k < kMaxPromotions;
    SamplingRun run;
    if (!completes([&] { run = sample_with_diagram(mesh, sampling, surface); })) run.result.status = Outcome::kCancelled;
    if (run.result.status == Outcome::kCancelled && earlier.result.samples.size() > 0) return cancelled(earlier);
    if (run.changed_facets.empty() || run.result.status == Outcome::kCancelled) return run;
    const std::vector<std::array<Index, 2>> sharp = dropped_edges_at(surface, run.changed_facets);
    std::vector<Index> tips = tips_at(mesh, surface, run.changed_facets);
    if ((sharp.empty() && tips.empty()) || !surface.may_change) {
      // A count asked for has not been looked for to the end while there might have been other curves.
      if (!run.gave_up && (!surface.may_change || sampling.target_count == 0)) return run;
      if (run.gave_up) surface.preserve = false;
      k = kMaxPromotions;
      keep(run);
      continue;
    }
    curves.edges.insert(curves.edges.end(), sharp.begin(), sharp.end());
    curves.vertices.insert(curves.vertices.end(), tips.begin(), tips.end());
    SamplingSurface next_surface;
    if (!completes([&] { next_surface = sampling_surface(mesh, curves, sampling, execution.part(done, done)); })) {
      return cancelled(run);
    }
    next_surface.limits = std::move(surface.limits);
    next_surface.kept = std::move(surface.kept);
    tips.insert(tips.end(), surface.tips.begin(), surface.tips.end());
    std::sort(tips.begin(), tips.end());
    next_surface.tips = std::move(tips);
    next_surface.preserve = true;
    surface = std::move(next_surface);
    keep(run);
  }
}

/// On what of the surface each sample is; those on curves are the first ones.
void name_places(const SamplingRun& run, SampleSet& samples) {
  const auto n = slot(samples.size());
  samples.dimensions.assign(n, 2);
  samples.curves.assign(n, kNone);
  samples.parameters.assign(n, 0);
  if (run.curves == nullptr) return;
  for (std::size_t s = 0; s < run.curves->samples.size(); ++s) {
    const CurveSample& sample = run.curves->samples[s];
    const bool at_corner = sample.corner != kNone;
    samples.dimensions[s] = at_corner ? 0 : 1;
    samples.curves[s] = at_corner ? sample.corner : sample.curve;
    samples.parameters[s] = sample.parameter;
  }
}

/// Edits the samples of a run, which are maximal, until they are exactly as many as asked for. `ids`: in the run's diagram;
/// empty: rows. Returns what is to be said of it.
Outcome meet_exact_count(const SamplingSurface& surface, const RemeshOptions& options, const WantedRadii& radii,
                         std::vector<Index>& ids, const Execution& execution, SamplingRun& run, RemeshResult& result) {
  ExactCountReport& report = result.report.exact_count;
  report.asked = true;
  report.wanted = options.sampling.target_count;
  report.before = report.after = result.samples.size();
  // Where radii follow from an error, another set comes nearer: see RemeshRuns.
  constexpr double kMostByError = 0.05;
  const bool by_error = options.max_error > 0 || options.least_error;
  if (by_error && std::abs(report.before - report.wanted) > kMostByError * report.wanted) {
    report.obstacle = CountObstacle::kShape;
    return Outcome::kCountMissed;
  }
  const OptimizeReport& reached = result.report.optimization;
  const bool has_topology = surface.preserve && run.changed_facets.empty();
  const CountedSet set{*run.diagram,
                       result.samples,
                       ids,
                       run.disks->knows_surface() ? run.disks.get() : nullptr,
                       radii,
                       result.report.sampling.curve_samples,
                       options.optimize ? DualRating(options.optimization.angles, options.optimization.valences,
                                                     reached.min_angle, reached.max_angle)
                                        : DualRating(false, false, 0, 0),
                       has_topology ? surface.topology.get() : nullptr,
                       has_topology ? topology_samples(*run.disks, surface.curves.get(), run.curves.get()) : TopologySamples(),
                       result.report.sampling.seed};
  meet_count(set, execution, report);
  Outcome status = Outcome::kDone;
  if (report.cost > kMinGain) status = Outcome::kStalled;
  if (report.coverage > 1) status = Outcome::kNotMaximal;
  return report.after == report.wanted ? status : Outcome::kCountMissed;
}

/// Moves the vertices off the surface; those on curves with the curves, and corners stay.
void fit_mesh(const MeshView& mesh, const SamplingSurface& surface, const SamplingRun& run, const RemeshOptions& options,
              const Execution& execution, RemeshResult& result) {
  if (!(total_area(result.mesh, execution.part(0, 0.01)) > 0)) return;
  FitOptions fit;
  fit.fit = options.fit;
  if (options.optimize) {
    fit.min_angle = result.report.optimization.min_angle;
    fit.max_angle = result.report.optimization.max_angle;
  }
  if (surface.curves != nullptr && run.curves != nullptr) {
    fit.curve_edges = run.curves->edges;
    for (const Curve& curve : surface.curves->curves) {
      for (std::size_t k = 0; k < curve.edges.size(); ++k) {
        fit.input_curve_edges.push_back({curve.vertices[k], curve.vertices[k + 1]});
      }
    }
    for (std::size_t s = 0; s < result.samples.dimensions.size(); ++s) {
      if (result.samples.dimensions[s] == 0) fit.fixed.push_back(static_cast<Index>(s));
    }
  }
  fit.execution = execution.part(0.01, 1);
  result.mesh.vertices = fit_vertices(mesh, result.mesh, fit, &result.report.fit);
}

/// What runs of remesh() have in common.
struct RemeshState {
  CurveOptions curves;
  SamplingSurface surface;   ///< with bounds of radii, and samples to begin with
  bool has_surface = false;  ///< or is made by the next run
};

/// The end of optimisation in its part of the range of progress, where the number is to be met exactly.
constexpr double kBeforeExactCountShare = 0.85;

/// One run of remesh(), with options for the samples to begin with. `result` (in: cancelled) has what there is at any time.
void sample_and_remesh(const MeshView& mesh, const RemeshOptions& options, SamplingOptions sampling, RemeshState& state,
                       const Execution& execution, RemeshResult& result) {
  const RemeshParts parts(mesh, sampling, options);
  sampling.execution = execution.part(0, parts.sampling);
  if (options.optimize) result.report.optimization.status = Outcome::kCancelled;  // until it is done
  SamplingSurface& surface_of_input = state.surface;
  if (!state.has_surface) {
    constexpr double kSurfaceShare = 0.05;
    surface_of_input = sampling_surface(mesh, state.curves, sampling, sampling.execution.part(0, kSurfaceShare));
    if (surface_of_input.flood != nullptr) sampling.execution = sampling.execution.part(kSurfaceShare, 1);
    state.has_surface = true;
  }
  surface_of_input.preserve = surface_of_input.topology != nullptr && options.topology == Topology::kPreserve;
  if (options.optimize && sampling.target_count > 0) {
    // What optimisation will add, for each sample that it may move.
    const double target = sampling.target_count;
    const double share = std::max(0.0, 1 - expected_curve_samples(surface_of_input, target) / target);
    const double growth = share * expected_growth(options.optimization, is_one_radius(sampling.sizing));
    sampling.target_count = std::max(Index{1}, static_cast<Index>(target / (1 + growth) + 0.5));
  }
  SamplingRun run = sample_preserving(mesh, state.curves, sampling, surface_of_input);
  result.samples = std::move(run.result.samples);
  result.report.sampling = run.result.report;
  result.graph = surface_of_input.curves;
  if (surface_of_input.flood != nullptr) name_places(run, result.samples);
  if (run.result.status == Outcome::kCancelled) return;

  Stopwatch watch;
  Outcome status = run.result.status;
  std::vector<Index> ids;
  const bool one_radius = is_one_radius(sampling.sizing);
  const double optimized = options.sampling.exact_count && options.optimize
                               ? parts.sampling + kBeforeExactCountShare * (parts.optimization - parts.sampling)
                               : parts.optimization;
  if (options.optimize) {
    OptimizeOptions optimization = options.optimization;
    optimization.sizing = one_radius ? SizingField() : sampling.sizing.scaled(result.report.sampling.sizing_scale);
    optimization.radius = one_radius ? result.report.sampling.radius : 0;
    optimization.conflict_rule = sampling.conflict_rule;
    optimization.seed = sampling.seed;
    optimization.execution = execution.part(parts.sampling, optimized, "improving triangles");
    OptimizeSurface surface;
    if (run.disks->knows_surface()) surface.disks = run.disks.get();
    surface.caps = run.caps;
    surface.num_fixed = result.report.sampling.curve_samples;
    if (surface_of_input.preserve && run.changed_facets.empty()) {
      surface.topology = surface_of_input.topology.get();
      surface.samples = topology_samples(*run.disks, surface_of_input.curves.get(), run.curves.get());
    }
    result.report.optimization = optimize_diagram(*run.diagram, result.samples, surface, optimization, ids);
    if (surface_of_input.flood != nullptr) name_places(run, result.samples);
    status = std::max(status, result.report.optimization.status);
    result.report.seconds_optimize = watch.lap();
    if (status == Outcome::kCancelled) return;
  }
  if (options.sampling.exact_count) {
    const WantedRadii radii =
        one_radius ? WantedRadii(result.report.sampling.radius, sampling.conflict_rule)
                   : WantedRadii(sampling.sizing.scaled(result.report.sampling.sizing_scale), sampling.conflict_rule);
    const Execution meeting = execution.part(optimized, parts.optimization, "meeting the number exactly");
    Outcome met = Outcome::kCancelled;
    completes([&] { met = meet_exact_count(surface_of_input, options, radii.with_caps(run.caps), ids, meeting, run, result); });
    if (surface_of_input.flood != nullptr) name_places(run, result.samples);
    status = std::max(status, met);
    watch.lap();
    if (status == Outcome::kCancelled) return;
  }
  const auto building = [&](double from, double to) { return execution.part(from, to, "building the mesh"); };
  Dual dual = listed_triangles(*run.diagram, ids, building(parts.optimization, parts.listing));
  ids = std::vector<Index>();
  result.report.seconds_remesh = watch.lap();
  certify_and_release(surface_of_input, sampling.conflict_rule, building(parts.listing, parts.certificates), run,
                      result.report);
  result.report.seconds_report = watch.lap();
  const Execution extracting = building(parts.certificates, parts.extraction);
  std::optional<SurfaceEdges> of_balls;
  if (surface_of_input.flood == nullptr) of_balls.emplace(mesh, extracting.part(0, 0.3));
  const SurfaceEdges& edges = of_balls.has_value() ? *of_balls : surface_of_input.flood->edges();
  dual = restricted_triangles(dual, result.samples.positions, edges, extracting.part(of_balls.has_value() ? 0.3 : 0, 1));
  result.mesh = {result.samples.positions, std::move(dual.triangles)};
  result.facets = std::move(dual.facets);
  result.patches.assign(result.facets.size(), 0);
  if (surface_of_input.curves != nullptr) {
    const std::vector<Index>& patch_of_facet = surface_of_input.curves->patch_of_facet;
    for (std::size_t t = 0; t < result.facets.size(); ++t) result.patches[t] = patch_of_facet[slot(result.facets[t])];
  }
  report_curves(surface_of_input, run, result);
  result.report.seconds_remesh += watch.lap();
  if (options.fit != Fit::kOff) {
    fit_mesh(mesh, surface_of_input, run, options, execution.part(parts.extraction, parts.fit, "fitting vertices"), result);
    watch.lap();
  }
  measure(mesh, edges, run, execution.part(parts.fit, 1, "measuring the result"), result);
  result.report.seconds_report += watch.lap();
  if (misses_count(result.samples.size(), options.sampling)) status = std::max(status, Outcome::kCountMissed);
  if (!lost_shape(result.report).empty()) status = std::max(status, Outcome::kShapeChanged);
  result.status = status;
}

/// Bounds of radii where triangles of the result cross.
std::vector<RadiusCap> caps_at_crossings(const RemeshResult& result, const Execution& execution) {
  constexpr double kCrossingShare = 0.6;
  SelfIntersectionOptions options;
  options.execution = execution;
  std::vector<Index> samples;
  for (const SelfIntersection& pair : find_self_intersections(result.mesh, options).pairs) {
    for (const Index t : {pair.a, pair.b}) {
      for (int k = 0; k < 3; ++k) samples.push_back(result.mesh.triangles(t, k));
    }
  }
  std::sort(samples.begin(), samples.end());
  samples.erase(std::unique(samples.begin(), samples.end()), samples.end());
  std::vector<RadiusCap> caps;
  for (const Index s : samples) {
    caps.push_back({result.samples.positions.row(s).transpose(), kCrossingShare * result.samples.radii[slot(s)]});
  }
  return caps;
}

/// Do sheets of the result cross each other, and those of the surface do not?
bool crosses(const RemeshReport& report) { return report.self_intersections > 0 && report.input_self_intersections == 0; }

/// Measures how far the result, which has triangles, is from the surface, with bounds close beside this error.
void bound_error(const MeshView& mesh, double error, const Execution& execution, RemeshResult& result) {
  const DistanceReport distance = measure_error(mesh, result.mesh, error, execution);
  result.report.hausdorff_bound = distance.hausdorff();
  result.report.hausdorff_lower = distance.hausdorff_lower();
}

/// Samples of a result that lie on faces.
std::vector<FaceSample> samples_on_faces(const SampleSet& samples) {
  std::vector<FaceSample> kept;
  for (Index s = 0; s < samples.size(); ++s) {
    if (samples.dimensions.empty() || samples.dimensions[slot(s)] == 2) kept.push_back({sample_of(samples, s), true});
  }
  return kept;
}

/// A run, and further ones where sheets of the result cross each other, where it is farther from the surface than max_error, or
/// while the distance is to become less: radii fall there, and what lies elsewhere is kept. If there are too many samples then,
/// all is sampled again under these bounds. The best result counts.
class RemeshRuns {
 public:
  /// `sampling`: with the execution of all, whose range is that of `execution`. `result` (in: cancelled) has what there is at
  /// any time.
  RemeshRuns(const MeshView& mesh, const RemeshOptions& options, const SamplingOptions& sampling, const Execution& execution,
             RemeshResult& result)
      : mesh_(mesh),
        options_(options),
        sampling_(sampling),
        execution_(execution),
        result_(result),
        measured_(options.max_error > 0 || options.least_error),
        uncrosses_(options.topology == Topology::kPreserve && sampling.neighborhood == Neighborhood::kSurface),
        goal_(options.max_error) {}

  void run() {
    choose_radii();
    while (one_run()) ++num_further_;
    if (result_.status == Outcome::kCancelled || !measured_) return;
    if (std::isfinite(result_.report.hausdorff_bound) || !(total_area(result_.mesh) > 0)) return;
    Stopwatch watch;
    const Outcome status = std::exchange(result_.status, Outcome::kCancelled);
    bound_error(mesh_, goal_, execution_.part(done_, 1), result_);
    result_.status = status;
    result_.report.seconds_error = seconds_ + watch.lap();
  }

 private:
  /// Of these, fresh ones: without coming closer.
  static constexpr int kMaxFurtherRuns = 40, kMaxFreshRuns = 4;
  static constexpr int kMaxRunsForLess = 24, kMaxFreshRunsForLess = 2;
  /// A goal that is reached falls to this share of the distance that there is.
  static constexpr double kNextGoal = 0.85;

  /// Those to begin with, and the radius that curves are found by.
  void choose_radii() {
    constexpr double kSizingShare = 0.02;
    const bool no_radii = sampling_.radius == 0 && sampling_.sizing.empty();
    if (options_.least_error && no_radii) {
      sampling_.sizing =
          error_sizing_of_count(mesh_, sampling_.target_count, execution_.part(0, kSizingShare, "finding radii"));
      done_ = kSizingShare;
    } else if (options_.max_error > 0 && no_radii && sampling_.target_count == 0) {
      sampling_.sizing = error_sizing(mesh_, options_.max_error, execution_.part(0, kSizingShare, "finding radii"));
      done_ = kSizingShare;
    }
    state_.curves = options_.curves;
    if (options_.max_error > 0 && state_.curves.radius == 0 && state_.curves.sizing.empty()) {
      // Cutting off a crease, however short beside the radius, costs a part of its length.
      constexpr double kCreaseSize = 4;
      const double finest = kCreaseSize * options_.max_error;
      if (sampling_.radius == 0 || finest < sampling_.radius) state_.curves.radius = finest;
    }
    next_ = sampling_;
  }

  /// False if it was the last one.
  bool one_run() {
    // Without measuring one run is enough, mostly.
    const double first_share = measured_ ? 0.5 : 0.98, run_share = measured_ ? 0.8 : 0.99;
    constexpr double kFurtherShare = 0.3;
    const bool first = num_further_ == 0;
    const double end = done_ + (first ? first_share : kFurtherShare) * (1 - done_);
    const Execution part = execution_.part(done_, end);
    done_ = end;
    RemeshResult further;
    further.status = Outcome::kCancelled;
    RemeshResult& made = first ? result_ : further;
    std::vector<RadiusCap> more;
    Outcome reached = Outcome::kCancelled;
    const bool complete = completes([&] {
      sample_and_remesh(mesh_, options_, next_, state_, part.part(0, run_share), made);
      reached = std::exchange(made.status, Outcome::kCancelled);  // until it is measured
      if (reached != Outcome::kCancelled) more = look(part.part(run_share, 1), made);
    });
    if (!complete || reached == Outcome::kCancelled) {
      result_.status = Outcome::kCancelled;
      return false;
    }
    made.status = options_.max_error > 0 && !(made.report.hausdorff_bound <= options_.max_error)
                      ? std::max(reached, Outcome::kErrorMissed)
                      : reached;
    made.report.further_runs = num_further_;
    if (first) most_ = most_refined(made.samples.size());
    if (state_.surface.kept.empty()) {
      count_before_ = made.samples.size();
      scale_ = made.report.sampling.sizing_scale;
    } else {
      made.report.sampling.sizing_scale = scale_;
    }
    const bool goes_on = prepare_next(made, std::move(more));
    if (!first && badness(further) < badness(result_)) result_ = std::move(further);
    return goes_on;
  }

  /// Bounds of radii where the result is not as it should be.
  std::vector<RadiusCap> look(const Execution& execution, RemeshResult& made) {
    std::vector<RadiusCap> more;
    if (measured_) {
      Stopwatch watch;
      if (search_ == nullptr) search_ = std::make_unique<ErrorSearch>(mesh_, execution.part(0, 0.05));
      more = look_at_error(execution.part(0.05, 0.9), made);
      made.report.seconds_error = seconds_ += watch.lap();
    }
    if (uncrosses_ && crosses(made.report)) {
      const std::vector<RadiusCap> at_crossings = caps_at_crossings(made, execution.part(0.9, 1));
      more.insert(more.end(), at_crossings.begin(), at_crossings.end());
    }
    return more;
  }

  /// Where the result is farther from the surface than the goal. Where it seems not to be, measures how far it is, and where
  /// the distance is to become less, there is a new goal.
  std::vector<RadiusCap> look_at_error(const Execution& execution, RemeshResult& made) {
    RemeshReport& report = made.report;
    report.hausdorff_bound = report.hausdorff_lower = std::numeric_limits<double>::infinity();
    if (!(total_area(made.mesh) > 0)) return {};
    if (goal_ > 0) {
      ErrorCaps found = search_->look(made.mesh, made.samples, goal_, execution.part(0, 0.4));
      report.hausdorff_lower = found.farthest;
      if (found.farthest > goal_) return std::move(found.caps);
      bound_error(mesh_, goal_, execution.part(0.4, 0.6), made);
      if (report.hausdorff_bound > goal_) return std::move(found.caps);
    } else {
      bound_error(mesh_, kNextGoal * bounding_box(mesh_).diagonal(), execution.part(0, 0.6), made);
    }
    if (!options_.least_error || misses_count(made.samples.size(), options_.sampling)) return {};
    constexpr double kLeastGoal = 1e-5;  // of the diagonal
    goal_ = kNextGoal * report.hausdorff_bound;
    num_fresh_ = 0;
    if (goal_ < kLeastGoal * bounding_box(mesh_).diagonal()) return {};
    return search_->look(made.mesh, made.samples, goal_, execution.part(0.6, 1)).caps;
  }

  /// What the next run begins with. False if there is none.
  bool prepare_next(const RemeshResult& made, std::vector<RadiusCap> more) {
    std::vector<RadiusCap>& caps = state_.surface.limits;
    const Index count = made.samples.size();
    const bool fresh = more.empty() && !caps.empty() && misses_count(count, options_.sampling) &&
                       num_fresh_ < (options_.least_error ? kMaxFreshRunsForLess : kMaxFreshRuns);
    if (num_further_ == (options_.least_error ? kMaxRunsForLess : kMaxFurtherRuns) || (more.empty() && !fresh)) return false;
    const bool far = measured_ && !(made.report.hausdorff_bound <= goal_);
    if (!far && !fresh && count > most_) return false;
    caps.insert(caps.end(), more.begin(), more.end());
    if (expected_under(CapField(caps, kCapGradation), made.mesh, made.samples) > sampling_.max_samples) return false;
    next_ = sampling_;
    if (fresh) {
      ++num_fresh_;
      state_.surface.kept.clear();
      if (search_ != nullptr) search_->start_again();
      // Runs after this one will add what they have added this time, or less.
      const double share = count_before_ / std::max(count_before_, static_cast<double>(count));
      next_.target_count = std::max(Index{1}, static_cast<Index>(sampling_.target_count * share + 0.5));
      return true;
    }
    state_.surface.kept = samples_on_faces(made.samples);
    next_.target_count = 0;
    if (is_one_radius(sampling_.sizing)) {
      next_.radius = made.report.sampling.radius;
      next_.sizing = SizingField();
    } else {
      next_.sizing = sampling_.sizing.scaled(scale_);
    }
    return true;
  }

  /// Of two results the better one has less of what comes first.
  std::tuple<std::int64_t, bool, bool, double> badness(const RemeshResult& result) const {
    const RemeshReport& report = result.report;
    const bool too_far = options_.max_error > 0 && !(report.hausdorff_bound <= options_.max_error);
    return {crosses(report) ? report.self_intersections : 0, too_far, misses_count(result.samples.size(), options_.sampling),
            too_far ? report.hausdorff_lower : report.hausdorff_bound};
  }

  const MeshView& mesh_;
  const RemeshOptions& options_;
  SamplingOptions sampling_, next_;  ///< as given, with radii chosen; of the next run
  const Execution& execution_;
  RemeshResult& result_;
  const bool measured_, uncrosses_;
  double goal_;  ///< no point is to be farther off; 0: none yet
  RemeshState state_;
  std::unique_ptr<ErrorSearch> search_;
  double done_ = 0, seconds_ = 0;
  int num_further_ = 0, num_fresh_ = 0;
  Index most_ = 0;
  double scale_ = 1, count_before_ = 0;  ///< of the sizing, and of the result, by the last run that kept nothing
};

/// remesh() of the mesh in units of `scale`.
RemeshResult remesh_at(const MeshScale& scale, const MeshView& mesh, const RemeshOptions& options) {
  RemeshOptions scaled = options;
  scaled.sampling = scaled_options(options.sampling, scale);
  scaled.curves = scaled_options(options.curves, scale);
  scaled.max_error = scale.length(options.max_error);
  scaled.optimization = scaled_options(options.optimization, scale);
  RemeshResult result = scale.in_our_units([&] { return remesh(scale.mesh(mesh), scaled); });
  scale.back(result.mesh.vertices);
  scale_back(result.samples, scale);
  if (result.graph != nullptr) {
    auto graph = std::make_shared<CurveGraph>(*result.graph);
    scale_back(*graph, scale);
    result.graph = std::move(graph);
  }
  RemeshReport& report = result.report;
  scale_back(report.sampling, scale);
  for (QualityReport* quality : {&report.quality, &report.curves.beside, &report.curves.away}) scale_back(*quality, scale);
  for (double* length : {&report.curves.length, &report.curves.deviation, &report.fit.rms_before, &report.fit.rms_after,
                         &report.fit.max_before, &report.fit.max_after, &report.hausdorff_bound, &report.hausdorff_lower}) {
    scale.back(*length);
  }
  report.maximality.gap_area = scale.area_back(report.maximality.gap_area);
  return result;
}

}  // namespace
}  // namespace detail

Mesh restricted_triangulation(const MeshView& mesh, const SampleSet& samples, const Execution& execution,
                              Neighborhood neighborhood, const CurveGraph* curves) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    Mesh result = scale.in_our_units([&] {
      return restricted_triangulation(scale.mesh(mesh), detail::scaled_samples(samples, scale), execution, neighborhood,
                                      curves);
    });
    result.vertices = samples.positions;
    return result;
  }
  const Execution run = execution.start();
  const detail::SetDiagram set = detail::diagram_of(mesh, samples, neighborhood, 0, run.part(0, 0.9), curves);
  const detail::SurfaceEdges edges(mesh, run.part(0.9, 0.93));
  const Execution listing = run.part(0.93, 1, "listing triangles");
  const detail::Dual listed = detail::listed_triangles(set.diagram, {}, listing.part(0, 0.3));
  Mesh result{samples.positions,
              detail::restricted_triangles(listed, samples.positions, edges, listing.part(0.3, 1)).triangles};
  run.finish();
  return result;
}

std::string lost_shape(const RemeshReport& report) {
  const TopologyReport &in = report.input, &out = report.output;
  const char* const remedy = "; take a smaller radius or more vertices";
  if (out.facets == 0) return std::string("nothing of the shape is left: the result has no triangle") + remedy;
  const bool knows_surface = report.certificate.cells > 0;
  std::string lost;
  const auto differs = [&lost](const char* what, Index before, Index after) {
    if (before == after) return;
    lost += (lost.empty() ? "" : ", ") + std::string(what) + " " + std::to_string(before) + " -> " + std::to_string(after);
  };
  if (!(knows_surface && report.certificate.holds())) {
    differs("components", in.components, out.components);
    differs("Euler characteristic", in.euler_characteristic, out.euler_characteristic);
    differs("boundary loops", in.boundary_loops, out.boundary_loops);
    if (in.non_manifold_edges == 0) differs("non-manifold edges", 0, out.non_manifold_edges);
  }
  if (report.curves.edges_kept < report.curves.edges) {
    const Index edges = report.curves.edges - report.curves.edges_kept;
    lost += (lost.empty() ? "" : ", ") + std::to_string(edges) + " of " + std::to_string(report.curves.edges) +
            " edges along curves are not in the result";
  }
  if (knows_surface && detail::crosses(report)) {
    lost += (lost.empty() ? "" : ", ") + std::to_string(report.self_intersections) + " pairs of triangles cross";
  }
  return lost.empty() ? lost : "the shape has changed: " + lost + remedy;
}

RemeshResult remesh(const MeshView& mesh, const RemeshOptions& options) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) return detail::remesh_at(scale, mesh, options);
  SamplingOptions sampling = options.sampling;
  if (options.optimize) detail::require_optimize_options(options.optimization);
  if (sampling.neighborhood == Neighborhood::kDefault) {
    const bool by_max = sampling.conflict_rule == ConflictRule::kMax;
    sampling.neighborhood = by_max ? Neighborhood::kSurface : Neighborhood::kSpace;
  }
  const Execution execution = sampling.execution.start();
  require_usable(mesh);
  if (options.sampling.exact_count && options.sampling.target_count == 0) {
    throw Error(ErrorCode::kInvalidArgument, "remesh: exact_count meets a number of vertices; set sampling.target_count");
  }
  sampling.exact_count = false;  // only the result counts
  if (!(options.max_error >= 0 && std::isfinite(options.max_error))) {
    throw Error(ErrorCode::kInvalidArgument,
                "remesh: max_error is " + detail::number_text(options.max_error) + "; give a distance above 0, or 0 for none");
  }
  if (options.least_error && sampling.target_count == 0) {
    throw Error(ErrorCode::kInvalidArgument, "remesh: least_error spends a number of samples; set sampling.target_count");
  }
  // Such a disk is all of its component: larger ones are no other, and radii have to fall from there.
  const double diagonal = bounding_box(mesh).diagonal();
  if (sampling.neighborhood == Neighborhood::kSurface && std::isfinite(sampling.radius)) {
    sampling.radius = std::min(sampling.radius, diagonal);
  }
  RemeshResult result;
  result.status = Outcome::kCancelled;
  detail::completes([&] { detail::RemeshRuns(mesh, options, sampling, execution, result).run(); });
  if (result.mesh.vertices.empty()) result.mesh.vertices = result.samples.positions;
  if (result.status != Outcome::kCancelled) execution.finish();
  return result;
}

}  // namespace amps
