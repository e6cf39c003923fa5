// cli_remesh.h: amps remesh.
#pragma once

#include "amps/amps.h"
#include "cli_commands.h"
#include "cli_curves.h"
#include "cli_files.h"
#include "cli_keep.h"
#include "cli_output.h"
#include "cli_page.h"
#include "cli_report.h"
#include "cli_sizing.h"
#include "cli_watch.h"

#include <array>
#include <cmath>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

/// --optimize and its companions.
inline void set_optimization(const Arguments& arguments, amps::RemeshOptions& options) {
  const std::string what = arguments.text("--optimize", "angle,valence");
  if (what != "angle,valence" && what != "valence,angle" && what != "angle" && what != "valence" && what != "none") {
    throw arguments.error("--optimize " + what + ": name angle, valence, angle,valence or none");
  }
  options.optimize = what != "none";
  options.optimization.angles = what.find("angle") != std::string::npos;
  options.optimization.valences = what.find("valence") != std::string::npos;
  options.optimization.min_angle = arguments.positive("--angle-min");
  options.optimization.max_angle = arguments.positive("--angle-max");
  for (const char* name : {"--angle-min", "--angle-max"}) {
    if (arguments.has(name) && !(options.optimize && options.optimization.angles)) {
      throw arguments.error(std::string(name) + " goes with --optimize angle");
    }
  }
  for (const char* name : {"--iterations", "--convergence"}) {
    if (arguments.has(name) && !options.optimize)
      throw arguments.error(std::string(name) + " does not go with --optimize none");
  }
  const auto most = static_cast<std::uint64_t>(std::numeric_limits<int>::max());
  options.optimization.max_iterations = static_cast<int>(
      arguments.whole("--iterations", static_cast<std::uint64_t>(options.optimization.max_iterations), 0, most));
}

/// Writes the result; with its curves, if it has any, as lines and its patches as labels.
inline void write_result(const Files& files, const std::string& name, const amps::RemeshResult& result,
                         const amps::Execution& execution) {
  amps::MeshWriteOptions writing;
  writing.edges = result.curve_edges;
  if (!writing.edges.empty()) writing.labels = result.patches;
  files.write(name, result.mesh, writing, execution);
}

inline amps::Fit fit_of(const Arguments& arguments) {
  const std::string how = arguments.text("--fit", "none");
  for (const amps::Fit fit : {amps::Fit::kOff, amps::Fit::kNormal, amps::Fit::kFree}) {
    if (how == amps::name_of(fit)) return fit;
  }
  throw arguments.error("--fit " + how + ": name none, normal or free");
}

inline amps::Topology topology_of(const Arguments& arguments) {
  const std::string what = arguments.text("--topology", "preserve");
  if (what == "preserve") return amps::Topology::kPreserve;
  if (what == "report") return amps::Topology::kReport;
  throw arguments.error("--topology " + what + ": name preserve or report");
}

inline int run_remesh(const Arguments& arguments) {
  const SizingRequest sizing = sizing_request(arguments, true);
  amps::RemeshOptions options;
  options.sampling = sampling_options(arguments, amps::Neighborhood::kSurface);
  options.curves = curve_options(arguments);
  set_optimization(arguments, options);
  options.fit = fit_of(arguments);
  options.topology = topology_of(arguments);
  options.least_error = sizing.kind == "error";
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  files.reads("--keep", Holds::kLines);
  name_sizing_file(files, sizing);
  files.writes("OUT", arguments.operand(1), Holds::kMesh);
  files.writes("--samples", Holds::kSamples);
  files.writes("--convergence", Holds::kOther);
  files.writes("--json", Holds::kOther);
  files.writes("--report", Holds::kOther);
  files.look();

  const Stopwatch total;
  Watch watch(arguments.quiet(), options.sampling.execution.threads);
  const amps::Mesh mesh = files.mesh_to_sample(arguments.operand(0), watch.part(0, kRead));
  keep_marks(arguments, files, mesh, watch.part(kRead, kMarked), options.curves);
  if (options.sampling.neighborhood == amps::Neighborhood::kSpace && !arguments.quiet()) {
    watch.say("amps: note: --neighborhood space keeps no curves: no creases, borders or corners");
  }
  const double seconds_read = total.seconds();
  const double sized = sizing.kind == "uniform" || sizing.kind == "error" ? kMarked : kSized;
  options.sampling.sizing = make_sizing(sizing, mesh, watch.part(kMarked, sized));
  options.max_error = error_of(sizing, mesh);
  const amps::QualityReport input_quality = amps::quality(mesh, watch.part(sized, sized));
  const double seconds_sizing = total.seconds() - seconds_read;
  const bool reports = arguments.has("--report");
  const double worked = reports ? kRemeshed : kWorked;
  options.sampling.execution = watch.part(sized, worked);
  const Stopwatch work;
  const amps::RemeshResult result = amps::remesh(mesh, options);
  watch.check(result.status);
  const double seconds_work = work.seconds();
  const Stopwatch measure;
  std::optional<page::Measures> measures;
  if (reports) {
    measures.emplace(measure_for_page(mesh, result, options.sampling.neighborhood, watch.part(worked, kWorked)));
  }
  const double seconds_measure = measure.seconds();
  const Stopwatch write;
  // An interruption leaves all files as they were, or, once the first is in place, none: the others are then written too.
  write_result(files, arguments.operand(1), result, watch.part(kWorked, 1));
  if (arguments.has("--samples")) files.write(arguments.text("--samples"), result.samples, {});
  if (arguments.has("--convergence")) {
    std::ostringstream convergence;
    amps::write_convergence(convergence, result.report.optimization);
    files.write(arguments.text("--convergence"), convergence.str());
  }
  const double seconds_write = write.seconds();

  const amps::RemeshReport& report = result.report;
  const double radius = report.sampling.radius;
  Seconds seconds{{"read", seconds_read}, {"sizing", seconds_sizing}};
  double told = 0;
  for (const auto& stage : seconds_of(report.sampling)) {
    seconds.push_back(stage);
    told += stage.second;
  }
  told += report.seconds_optimize + report.seconds_remesh + report.fit.seconds;
  seconds.insert(seconds.end(), {{"optimize", report.seconds_optimize},
                                 {"remesh", report.seconds_remesh},
                                 {"fit", report.fit.seconds},
                                 {"checks", std::max(0.0, seconds_work - told)},
                                 {"write", seconds_write}});
  if (reports) seconds.emplace_back("report", seconds_measure);
  seconds.emplace_back("total", total.seconds());

  const std::ptrdiff_t unused = result.mesh.vertices.rows() - report.output.vertices;  // on parts as thin as r
  const amps::Index left_out = static_cast<amps::Index>(mesh.triangles.rows()) - report.input.facets;
  Json json = begin_json("remesh");
  json.add("status", amps::name_of(result.status));
  json.add("vertices", static_cast<amps::Index>(result.mesh.vertices.rows()));
  json.add("triangles", static_cast<amps::Index>(result.mesh.triangles.rows()));
  json.add("in_no_triangle", static_cast<amps::Index>(unused));
  json.add("left_out_of_input", left_out);
  add_radii(json, result.samples);
  add_sampling(json, report.sampling);
  add_exact_count(json, report.exact_count);
  add_optimization(json, report.optimization);
  add_fit(json, options.fit, report.fit);
  add_error(json, options, report);
  add_quality(json, report.quality, radius);
  add_maximality(json, report.maximality);
  add_crossings(json, report);
  add_curves(json, report.curves);
  add_certificate(json, report.certificate);
  add_topology(json, "input", report.input);
  add_topology(json, "output", report.output);
  add_seconds(json, seconds);
  files.write(json);

  Table table = files.table();
  table.hold();
  table.row("", "input", "output");
  table.row("vertices", number(report.input.vertices),
            of_wanted(result.samples.size(), options.sampling.target_count, result.status));
  print_exact_count(table, report.exact_count);
  table.row("triangles", number(report.input.facets), number(report.output.facets));
  if (left_out > 0) table.row("triangles left out", number(left_out), "there twice, or of two corners");
  print_topology(table, report.input, report.output);
  print_certificate(table, report.certificate);
  print_curves(table, report.curves);
  if (result.graph != nullptr && !result.graph->dropped.empty()) {
    table.row("creases not kept", number(static_cast<amps::Index>(result.graph->dropped.size())) + " edges", "too small for r");
  }
  print_crossings(table, report);
  if (unused > 0) table.row("in no triangle", "", std::to_string(unused));
  print_radii(table, result.samples);
  print_optimization(table, options.optimization, report.optimization);
  print_fit(table, options.fit, report.fit);
  print_error(table, options, report);
  print_quality(table, report.quality, radius, &input_quality);
  print_maximality(table, report.maximality);
  print_unfilled(table, report.sampling);
  print_seconds(table, seconds);
  std::string lost = amps::lost_shape(report);
  if (lost.empty() && options.max_error > 0 && !(report.hausdorff_bound <= options.max_error)) {
    lost = format("the result is up to %.6g from the input, %.6g was asked for; take a larger --error", report.hausdorff_bound,
                  options.max_error);
  }
  if (lost.empty()) lost = amps::missed_count(report.exact_count);
  if (reports) {
    const std::string in = page::file_name(Files::shown(arguments.operand(0), Files::kInput));
    const std::string out = page::file_name(Files::shown(arguments.operand(1), Files::kOutput));
    files.write(arguments.text("--report"),
                report_page({mesh, result, in, out, arguments.command_line(), lost, *measures, table, seconds}));
  }
  watch.finish();
  table.print();
  return lost.empty() ? kExitDone : complain(lost, kExitShape);
}
