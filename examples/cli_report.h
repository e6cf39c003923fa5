// cli_report.h: the reports of the library as rows of the table and as JSON.
#pragma once

#include "amps/amps.h"
#include "cli_output.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

inline void print_distance(const Table& table, const amps::DistanceReport& report) {
  const auto row = [&](const char* name, double distance) {
    table.row(name, format("%.6g   (%.4g %% of its diagonal)", distance, report.percent(distance)));
  };
  row("Hausdorff distance", report.hausdorff());
  row("RMS distance", report.rms());
  row("mean distance", report.mean());
}

inline void add_one_sided(Json& json, const char* key, const amps::OneSidedDistance& side) {
  json.open(key)
      .add("hausdorff", side.hausdorff)
      .add("hausdorff_lower", side.hausdorff_lower)
      .add("rms", side.rms)
      .add("mean", side.mean)
      .close();
}

inline void add_distance(Json& json, const std::string& reference, const amps::DistanceReport& report) {
  json.open("distance")
      .add("reference", reference)
      .add("reference_diagonal", report.diagonal)
      .add("hausdorff", report.hausdorff())
      .add("hausdorff_lower", report.hausdorff_lower())
      .add("rms", report.rms())
      .add("mean", report.mean())
      .add("hausdorff_percent", report.percent(report.hausdorff()))
      .add("rms_percent", report.percent(report.rms()))
      .add("mean_percent", report.percent(report.mean()));
  add_one_sided(json, "from_reference", report.forward);
  add_one_sided(json, "to_reference", report.backward);
  json.close();
}

/// Numbers of the result that are worse than the input's are marked, and those that should be the input's and are not.
inline std::string worse_if(bool worse, const std::string& value) { return worse ? value + "   worse" : value; }
inline std::string changed_if(bool changed, const std::string& value) { return changed ? value + "   changed" : value; }

inline void print_topology(const Table& table, const amps::TopologyReport& in, const amps::TopologyReport& out) {
  const auto kept = [&](const char* name, amps::Index amps::TopologyReport::*member) {
    table.row(name, number(in.*member), changed_if(out.*member != in.*member, number(out.*member)));
  };
  const auto trouble = [&](const char* name, amps::Index amps::TopologyReport::*member) {
    table.row(name, number(in.*member), worse_if(out.*member > in.*member, number(out.*member)));
  };
  kept("components", &amps::TopologyReport::components);
  kept("Euler characteristic", &amps::TopologyReport::euler_characteristic);
  kept("boundary loops", &amps::TopologyReport::boundary_loops);
  trouble("non-manifold edges", &amps::TopologyReport::non_manifold_edges);
  trouble("non-manifold vertices", &amps::TopologyReport::non_manifold_vertices);
  if (in.inconsistent_edges + out.inconsistent_edges > 0) {
    trouble("inconsistent edges", &amps::TopologyReport::inconsistent_edges);
  }
}

inline void add_topology(Json& json, const char* key, const amps::TopologyReport& report) {
  json.open(key)
      .add("vertices", report.vertices)
      .add("edges", report.edges)
      .add("triangles", report.facets)
      .add("components", report.components)
      .add("euler_characteristic", report.euler_characteristic)
      .add("boundary_edges", report.boundary_edges)
      .add("boundary_loops", report.boundary_loops)
      .add("non_manifold_edges", report.non_manifold_edges)
      .add("non_manifold_vertices", report.non_manifold_vertices)
      .add("inconsistent_edges", report.inconsistent_edges)
      .close();
}

inline void print_curves(const Table& table, const amps::CurveReport& report) {
  if (report.samples == 0) return;
  table.row("curves, corners", number(report.curves) + ", " + number(report.corners), number(report.samples) + " vertices");
  table.row("edges along curves", "",
            worse_if(report.edges_kept < report.edges, number(report.edges_kept) + " of " + number(report.edges) + " kept"));
  table.row("curves off by up to", "", format("%.3g", report.deviation));
  const auto angles = [&](const char* name, const amps::QualityReport& quality) {
    if (quality.triangles > 0) table.row(name, "", format("%.2f to %.2f degrees", quality.min_angle, quality.max_angle));
  };
  angles("angles beside curves", report.beside);
  angles("angles away from them", report.away);
  if (report.forced_triangles > 0) {
    table.row("bad by force of curves", "", number(report.forced_triangles) + " triangles");
  }
}

/// A kind of curve as a key: its name with underscores.
inline std::string key_of(amps::CurveKind kind) {
  std::string key = amps::name_of(kind);
  std::replace(key.begin(), key.end(), ' ', '_');
  return key;
}

inline void add_curves(Json& json, const amps::CurveReport& report) {
  json.open("curves")
      .add("curves", report.curves)
      .add("corners", report.corners)
      .add("patches", report.patches)
      .add("vertices", report.samples)
      .add("edges", report.edges)
      .add("edges_kept", report.edges_kept)
      .add("length", report.length)
      .add("deviation", report.deviation)
      .add("forced_triangles", report.forced_triangles)
      .open("kinds");
  for (std::size_t kind = 0; kind < amps::kNumCurveKinds; ++kind) {
    json.add(key_of(static_cast<amps::CurveKind>(kind)).c_str(), report.curves_of[kind]);
  }
  json.close();
  const auto angles = [&json](const char* key, const amps::QualityReport& quality) {
    if (quality.triangles == 0) return;
    json.open(key)
        .add("triangles", quality.triangles)
        .add("min_angle", quality.min_angle)
        .add("max_angle", quality.max_angle)
        .close();
  };
  angles("beside", report.beside);
  angles("away", report.away);
  json.close();
}

inline void print_certificate(const Table& table, const amps::TopologyCertificate& certificate) {
  if (certificate.cells == 0) return;
  if (certificate.holds()) {
    table.row("topology", "", "that of the input, proved");
  } else {
    table.row("topology", "", "not proved at " + std::to_string(certificate.failures.size()) + " places");
  }
}

inline void add_certificate(Json& json, const amps::TopologyCertificate& certificate) {
  if (certificate.cells == 0) return;
  json.open("certificate").add("holds", certificate.holds()).add("cells", certificate.cells);
  for (std::size_t kind = 0; kind < amps::kNumTopologyFailureKinds; ++kind) {
    std::string name = amps::name_of(static_cast<amps::TopologyFailureKind>(kind));
    std::replace(name.begin(), name.end(), ' ', '_');
    json.add(name.c_str(), certificate.failures_of[kind]);
  }
  json.close();
}

/// Of the input they are known only if the result has some.
inline void print_crossings(const Table& table, const amps::RemeshReport& report) {
  const auto pairs = [](std::int64_t n) { return n == 0 ? std::string("none") : std::to_string(n) + " pairs"; };
  const bool known = report.self_intersections > 0;
  table.row("self-intersections", known ? pairs(report.input_self_intersections) : "",
            worse_if(report.self_intersections > report.input_self_intersections, pairs(report.self_intersections)));
}

inline void add_crossings(Json& json, const amps::RemeshReport& report) {
  json.add("self_intersections", static_cast<std::uint64_t>(report.self_intersections));
}

inline void print_maximality(const Table& table, const amps::MaximalityReport& report) {
  table.row("worst coverage", format("%.9f r   (maximal: at most 1)", report.worst_coverage));
  if (std::isfinite(report.worst_separation)) {
    table.row("worst separation", format("%.9f r   (Poisson-disk: at least 1)", report.worst_separation));
  } else {
    table.row("worst separation", "none, there is one sample");
  }
}

struct RadiusRange {
  double min, max, mean;
  explicit RadiusRange(const amps::SampleSet& samples)
      : min(*std::min_element(samples.radii.begin(), samples.radii.end())),
        max(*std::max_element(samples.radii.begin(), samples.radii.end())),
        mean(std::accumulate(samples.radii.begin(), samples.radii.end(), 0.0) / samples.size()) {}
};

inline void print_radii(const Table& table, const amps::SampleSet& samples) {
  const RadiusRange r(samples);
  table.row("radius r", r.min == r.max ? number(r.min) : number(r.min) + " to " + number(r.max) + ", mean " + number(r.mean));
}

inline void add_radii(Json& json, const amps::SampleSet& samples) {
  const RadiusRange r(samples);
  json.add("min_radius", r.min).add("max_radius", r.max).add("mean_radius", r.mean);
}

inline void add_maximality(Json& json, const amps::MaximalityReport& report) {
  json.open("maximality")
      .add("maximal", report.maximal())
      .add("poisson_disk", report.poisson_disk())
      .add("worst_coverage", report.worst_coverage)
      .add("worst_x", report.worst_point.x())
      .add("worst_y", report.worst_point.y())
      .add("worst_z", report.worst_point.z())
      .add("worst_separation", report.worst_separation)
      .add("gaps", report.gaps)
      .add("gap_area", report.gap_area)
      .close();
}

/// `input`: of the input, to compare; nullptr: none.
inline void print_quality(const Table& table, const amps::QualityReport& report, double radius,
                          const amps::QualityReport* input = nullptr) {
  constexpr double kRounding = 0.005;  // of what is printed
  const auto of_input = [input](const std::string& value) { return input == nullptr ? "" : "   (input: " + value + ")"; };
  const auto angles = [](const amps::QualityReport& r) { return format("%.2f to %.2f", r.min_angle, r.max_angle); };
  const auto row = [&](const char* name, const std::string& value, const std::string& before, bool worse) {
    table.row(name, worse_if(input != nullptr && worse, value + of_input(before)));
  };
  const amps::QualityReport& in = input == nullptr ? report : *input;
  row("angles", angles(report) + " degrees", angles(in),
      report.min_angle < in.min_angle - kRounding || report.max_angle > in.max_angle + kRounding);
  row("mean smallest angle", format("%.2f degrees", report.mean_min_angle), format("%.2f", in.mean_min_angle),
      report.mean_min_angle < in.mean_min_angle - kRounding);
  if (radius > 0) {
    table.row("edges / r", format("%.6f to %.6f", report.min_edge / radius, report.max_edge / radius));
  } else {
    table.row("edges", format("%.6g to %.6g, mean %.6g", report.min_edge, report.max_edge, report.mean_edge));
  }
  if (report.interior_vertices > 0) {
    row("valence 5 to 7", format("%.2f %%", report.valence_5_6_7), format("%.2f %%", in.valence_5_6_7),
        report.valence_5_6_7 < in.valence_5_6_7 - kRounding);
  }
}

inline void add_quality(Json& json, const amps::QualityReport& report, double radius) {
  json.open("quality")
      .add("triangles", report.triangles)
      .add("min_angle", report.min_angle)
      .add("max_angle", report.max_angle)
      .add("mean_min_angle", report.mean_min_angle)
      .add("percent_below_30", report.below_30)
      .add("percent_above_90", report.above_90)
      .add("min_edge", report.min_edge)
      .add("max_edge", report.max_edge)
      .add("mean_edge", report.mean_edge);
  if (radius > 0)
    json.add("min_edge_over_radius", report.min_edge / radius).add("max_edge_over_radius", report.max_edge / radius);
  json.add("min_q", report.min_q)
      .add("mean_q", report.mean_q)
      .add("area_ratio", report.area_ratio)
      .add("interior_vertices", report.interior_vertices)
      .add("percent_valence_5_6_7", report.valence_5_6_7)
      .add_list("valence", report.valence)
      .close();
}

inline void print_fit(const Table& table, amps::Fit fit, const amps::FitReport& report) {
  if (fit == amps::Fit::kOff) return;
  table.row("distance, RMS", format("%.3g to %.3g by fit", report.rms_before, report.rms_after));
}

inline void add_fit(Json& json, amps::Fit fit, const amps::FitReport& report) {
  if (fit == amps::Fit::kOff) return;
  json.open("fit")
      .add("kind", amps::name_of(fit))
      .add("rms_before", report.rms_before)
      .add("rms_after", report.rms_after)
      .add("max_before", report.max_before)
      .add("max_after", report.max_after)
      .add("moved", report.moved)
      .add("held_back", report.held_back)
      .add("rounds", report.rounds)
      .close();
}

/// `asked`: what the distance was to be at most; 0: nothing.
inline void print_error(const Table& table, const amps::RemeshOptions& options, const amps::RemeshReport& report) {
  const double asked = options.max_error;
  if (asked > 0 || options.least_error) {
    table.row("distance, proved", "",
              format("%.6g", report.hausdorff_bound) + (asked > 0 ? format(" of %.6g asked for", asked) : ""));
  }
}

inline void add_error(Json& json, const amps::RemeshOptions& options, const amps::RemeshReport& report) {
  const double asked = options.max_error;
  if (!(asked > 0 || options.least_error)) return;
  json.open("error");
  if (asked > 0) json.add("asked", asked).add("holds", report.hausdorff_bound <= asked);
  json.add("hausdorff", report.hausdorff_bound)
      .add("hausdorff_lower", report.hausdorff_lower)
      .add("rounds", report.further_runs)
      .add("seconds", report.seconds_error)
      .close();
}

/// Wall-clock seconds by stage, in order.
using Seconds = std::vector<std::pair<const char*, double>>;

inline Seconds seconds_of(const amps::SamplingReport& report) {
  return {{"darts", report.seconds_darts},
          {"triangulation", report.seconds_triangulation},
          {"diagram", report.seconds_diagram},
          {"gaps", report.seconds_gaps}};
}

inline void print_seconds(const Table& table, const Seconds& seconds) {
  std::string line;
  for (const auto& [stage, s] : seconds) line += format("%s%s %.3f", line.empty() ? "" : ", ", stage, s);
  table.row("seconds", line);
}

inline void add_seconds(Json& json, const Seconds& seconds) {
  json.open("seconds");
  for (const auto& [stage, s] : seconds) json.add(stage, s);
  json.close();
}

inline void print_unfilled(const Table& table, const amps::SamplingReport& report) {
  if (report.unfilled_gaps > 0)
    table.row("unfilled gaps", number(report.unfilled_gaps) + ", move the mesh nearer to the origin");
}

/// A number of samples beside the one asked for (0: none).
inline std::string of_wanted(amps::Index samples, amps::Index asked, amps::Outcome status) {
  std::string text = number(samples);
  if (asked > 0) text += " of " + number(asked) + " asked for";
  if (status == amps::Outcome::kCountMissed) text += ": missed";
  return text;
}

/// What it took to meet the number exactly.
inline void print_exact_count(const Table& table, const amps::ExactCountReport& report) {
  if (!report.asked) return;
  if (report.after != report.wanted) {
    table.row("exact number", number(report.wanted) + ": missed");
  } else if (report.before == report.after) {
    table.row("exact number", "met");
  } else {
    std::string how = "met from " + number(report.before) + " by " + number(report.refills) + " refills";
    if (report.smaller > 0) how += ", " + number(report.smaller) + " of them with smaller disks";
    if (report.taken_out > 0) how += (report.refills > 0 ? " and " : " by ") + number(report.taken_out) + " taken out";
    table.row("exact number", how);
  }
}

inline void add_exact_count(Json& json, const amps::ExactCountReport& report) {
  if (!report.asked) return;
  json.open("exact_count")
      .add("wanted", report.wanted)
      .add("before", report.before)
      .add("after", report.after)
      .add("refills", report.refills)
      .add("smaller", report.smaller)
      .add("taken_out", report.taken_out)
      .add("coverage", report.coverage)
      .add("cost", report.cost)
      .add("missed", amps::missed_count(report).c_str())
      .close();
}

/// Radius, or scale, and seed are the ones used: together they make the set again.
inline void add_sampling(Json& json, const amps::SamplingReport& report) {
  json.add("radius", report.radius)
      .add("sizing_scale", report.sizing_scale)
      .add("seed", report.seed)
      .open("sampling")
      .add("darts", report.darts)
      .add("dart_samples", report.dart_samples)
      .add("gap_samples", report.gap_samples)
      .add("unfilled_gaps", report.unfilled_gaps)
      .add("attempts", report.attempts)
      .close();
}

/// `asked`: what was to be reached.
inline void print_optimization(const Table& table, const amps::OptimizeOptions& asked, const amps::OptimizeReport& report) {
  if (report.iterations.empty()) return;
  const amps::OptimizeIteration& last = report.iterations.back();
  std::string bounds;
  if (asked.angles) bounds = format("angles in [%g, %g]", report.min_angle, report.max_angle);
  if (asked.valences) bounds += bounds.empty() ? "valences 5 to 7" : ", valences 5 to 7";
  if (report.status == amps::Outcome::kDone) {
    table.row("optimised", bounds + ": reached");
  } else {
    table.row("optimised", bounds + ": " + amps::name_of(report.status) + ", left bad " + number(last.bad_triangles) +
                               " triangles, " + number(last.bad_vertices) + " vertices");
  }
  table.row("samples replaced, added", number(report.removed) + ", " + std::to_string(report.added - report.removed));
}

inline void add_optimization(Json& json, const amps::OptimizeReport& report) {
  if (report.iterations.empty()) return;
  const amps::OptimizeIteration &first = report.iterations.front(), &last = report.iterations.back();
  json.open("optimization")
      .add("status", amps::name_of(report.status))
      .add("min_angle", report.min_angle)
      .add("max_angle", report.max_angle)
      .add("iterations", static_cast<amps::Index>(report.iterations.size() - 1))
      .add("bad_triangles_before", first.bad_triangles)
      .add("bad_triangles_after", last.bad_triangles)
      .add("bad_vertices_before", first.bad_vertices)
      .add("bad_vertices_after", last.bad_vertices)
      .add("removed", report.removed)
      .add("added", report.added)
      .add("trials", report.trials)
      .add("edits", report.edits)
      .add("accepted", report.accepted)
      .close();
}
