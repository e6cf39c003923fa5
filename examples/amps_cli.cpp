// amps_cli.cpp: the command-line program `amps` — maximal Poisson-disk sampling and remeshing of mesh files.
//
//   amps remesh bunny.obj out.obj --vertices 12000
//
// Read from the bottom: main() finds the command, parses its options and runs it. A command reads, works, writes and prints a
// table, in that order. Exit codes: 0 done, 2 bad input or usage (one line on stderr says what to do), 3 `gaps` found some or
// `fill` left some, 4 `remesh` has lost something of the shape (all files are written, one line on stderr says what is lost),
// 128 and the signal where one ended it: 130 for Ctrl-C.

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_curves.h"
#include "cli_files.h"
#include "cli_fill.h"
#include "cli_keep.h"
#include "cli_output.h"
#include "cli_page.h"
#include "cli_quality.h"
#include "cli_render.h"
#include "cli_report.h"
#include "cli_sizing.h"
#include "cli_spectrum.h"
#include "cli_watch.h"
#include "render_looks.h"
#include "render_mesh.h"
#include "render_png.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <limits>
#include <new>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace {

constexpr int kExitDone = 0;
constexpr int kExitTrouble = 2;
constexpr int kExitGaps = 3;
constexpr int kExitShape = 4;
constexpr int kExitSignal = 128;  // and its number, as a shell reports it

/// Where the parts of a command end, of its time: rough, since it depends on input and options.
constexpr double kRead = 0.03, kMarked = 0.04, kSized = 0.25, kSampled = 0.85, kMeasured = 0.75, kWorked = 0.96;

/// --neighborhood
amps::Neighborhood neighborhood_of(const Arguments& arguments, amps::Neighborhood standard) {
  if (!arguments.has("--neighborhood")) return standard;
  const std::string name = arguments.text("--neighborhood");
  if (name == "surface") return amps::Neighborhood::kSurface;
  if (name == "space") return amps::Neighborhood::kSpace;
  throw arguments.error("--neighborhood " + name + ": name surface or space");
}

amps::SamplingOptions sampling_options(const Arguments& arguments, amps::Neighborhood neighborhood) {
  amps::SamplingOptions options;
  options.radius = arguments.positive("--radius");
  options.target_count = static_cast<amps::Index>(arguments.whole("--vertices", 0, 1, kMostVertices));
  options.exact_count = arguments.has("--exact");
  if (options.exact_count && options.target_count == 0) throw arguments.error("--exact goes with --vertices N");
  options.seed = arguments.whole("--seed", options.seed, 0, UINT64_MAX);
  options.execution.threads = threads_of(arguments);
  options.neighborhood = neighborhood_of(arguments, neighborhood);
  return options;
}

/// Errors are one line each, whatever a file name holds.
int complain(std::string message, int code = kExitTrouble) {
  if (message.compare(0, 4, "amps") != 0) message = "amps: " + message;
  std::replace_if(
      message.begin(), message.end(), [](char c) { return c == '\n' || c == '\r'; }, ' ');
  const std::size_t prefix = std::min(message.find(':'), message.size());
  message.replace(0, prefix, in_colour(kTroubleColour, message.substr(0, prefix)));
  std::fprintf(stderr, "%s\n", message.c_str());
  return code;
}

int run_sample(const Arguments& arguments) {
  const SizingRequest sizing = sizing_request(arguments);
  amps::SamplingOptions options = sampling_options(arguments, amps::Neighborhood::kSpace);
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  name_sizing_file(files, sizing);
  files.writes("OUT", arguments.operand(1), Holds::kSamples);
  files.writes("--json", Holds::kOther);
  files.look();

  const Stopwatch total;
  Watch watch(arguments.quiet(), options.execution.threads);
  const amps::Mesh mesh = files.mesh_to_sample(arguments.operand(0), watch.part(0, kRead));
  const double seconds_read = total.seconds();
  const double sized = sizing.kind == "uniform" ? kRead : kSized;
  options.sizing = make_sizing(sizing, mesh, watch.part(kRead, sized));
  const double seconds_sizing = total.seconds() - seconds_read;
  options.execution = watch.part(sized, kSampled);
  const amps::SamplingResult result = amps::sample(mesh, options);
  watch.check(result.status);
  const Stopwatch verify;
  const amps::MaximalityReport certificate =
      amps::verify_maximal(mesh, result.samples, watch.part(kSampled, kWorked), options.conflict_rule, options.neighborhood);
  const double seconds_verify = verify.seconds();
  const Stopwatch write;
  files.write(arguments.operand(1), result.samples, watch.part(kWorked, 1));
  Seconds seconds{{"read", seconds_read}, {"sizing", seconds_sizing}};
  for (const auto& stage : seconds_of(result.report)) seconds.push_back(stage);
  seconds.insert(seconds.end(), {{"verify", seconds_verify}, {"write", write.seconds()}, {"total", total.seconds()}});

  Json json = begin_json("sample");
  json.add("status", amps::name_of(result.status));
  json.add("samples", result.samples.size());
  add_radii(json, result.samples);
  add_sampling(json, result.report);
  add_exact_count(json, result.report.exact_count);
  add_maximality(json, certificate);
  add_seconds(json, seconds);
  files.write(json);
  watch.finish();

  const Table table = files.table();
  table.row("samples", number(result.samples.size()));
  table.row("of darts and of gaps", number(result.report.dart_samples) + " and " + number(result.report.gap_samples));
  print_exact_count(table, result.report.exact_count);
  print_radii(table, result.samples);
  print_maximality(table, certificate);
  print_unfilled(table, result.report);
  print_seconds(table, seconds);
  const std::string missed = amps::missed_count(result.report.exact_count);
  return missed.empty() ? kExitDone : complain(missed, kExitShape);
}

/// --optimize and its companions.
void set_optimization(const Arguments& arguments, amps::RemeshOptions& options) {
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
void write_result(const Files& files, const std::string& name, const amps::RemeshResult& result,
                  const amps::Execution& execution) {
  amps::MeshWriteOptions writing;
  writing.edges = result.curve_edges;
  if (!writing.edges.empty()) writing.labels = result.patches;
  files.write(name, result.mesh, writing, execution);
}

amps::Fit fit_of(const Arguments& arguments) {
  const std::string how = arguments.text("--fit", "none");
  for (const amps::Fit fit : {amps::Fit::kOff, amps::Fit::kNormal, amps::Fit::kFree}) {
    if (how == amps::name_of(fit)) return fit;
  }
  throw arguments.error("--fit " + how + ": name none, normal or free");
}

amps::Topology topology_of(const Arguments& arguments) {
  const std::string what = arguments.text("--topology", "preserve");
  if (what == "preserve") return amps::Topology::kPreserve;
  if (what == "report") return amps::Topology::kReport;
  throw arguments.error("--topology " + what + ": name preserve or report");
}

int run_remesh(const Arguments& arguments) {
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
  const double worked = reports ? kMeasured : kWorked;
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
  const amps::Index asked = options.sampling.target_count;
  std::string vertices = std::to_string(result.mesh.vertices.rows());
  if (asked > 0) vertices += " of " + number(asked) + " asked for";
  if (result.status == amps::Outcome::kCountMissed) vertices += ": missed";
  table.row("vertices", number(report.input.vertices), vertices);
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

int run_curves(const Arguments& arguments) {
  amps::CurveOptions options = curve_options(arguments);
  if (arguments.has("--radius") && arguments.has("--vertices")) {
    throw arguments.error("say either --radius R or --vertices N, not both");
  }
  options.radius = arguments.positive("--radius");
  const auto vertices = static_cast<double>(arguments.whole("--vertices", 0, 1, kMostVertices));
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  files.reads("--keep", Holds::kLines);
  if (arguments.operands() > 1) files.writes("OUT", arguments.operand(1), Holds::kLines);
  files.writes("--json", Holds::kOther);
  files.look();
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = files.usable_mesh(arguments.operand(0), watch.part(0, 0.4));
  keep_marks(arguments, files, mesh, watch.part(0.4, 0.5), options);
  if (vertices > 0) options.radius = first_radius(mesh, vertices);
  options.execution = watch.part(0.5, 0.9);
  const amps::CurveGraph graph = amps::find_curves(mesh, options);
  const bool writes = arguments.operands() > 1 && !graph.empty();
  if (writes) write_graph(files, arguments.operand(1), mesh, graph, watch.part(0.9, 1));

  Json json = begin_json("curves");
  json.add("radius", options.radius);
  add_graph(json, graph);
  files.write(json);
  watch.finish();

  const Table table = files.table();
  print_graph(table, graph);
  table.row("radius r", options.radius > 0 ? number(options.radius) : "none: creases of all sizes");
  if (arguments.operands() > 1) {
    const std::string out = Files::shown(arguments.operand(1), Files::kOutput);
    table.row("lines", writes ? "in " + out : "none, " + out + " is not written");
  }
  return kExitDone;
}

int run_gaps(const Arguments& arguments) {
  neighborhood_of(arguments, amps::Neighborhood::kSpace);  // refuses other names, before the work
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  files.reads("SAMPLES", arguments.operand(1), Holds::kSamples);
  if (arguments.operands() > 2) files.writes("OUT", arguments.operand(2), Holds::kMesh);
  files.writes("--json", Holds::kOther);
  files.look();
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = files.usable_mesh(arguments.operand(0), watch.part(0, 0.05));
  const amps::SampleSet samples = files.samples(arguments.operand(1), watch.part(0.05, 0.1));
  // Sets that say what of the surface their samples are on are those of remesh.
  const amps::Neighborhood neighborhood =
      neighborhood_of(arguments, samples.dimensions.empty() ? amps::Neighborhood::kSpace : amps::Neighborhood::kSurface);
  const ForeignSet foreign = look_at_set(mesh, samples, watch.part(0.1, 0.2));
  const amps::MaximalityReport report =
      amps::verify_maximal(mesh, samples, watch.part(0.2, 0.5), amps::ConflictRule::kMax, neighborhood);
  const double area = amps::total_area(mesh, watch.part(0.5, 0.51));
  if (arguments.operands() > 2 && report.gaps > 0) {
    const amps::GapSet gaps = amps::find_gaps(mesh, samples, watch.part(0.51, kWorked), neighborhood);
    files.write(arguments.operand(2), gaps.primitives, {}, watch.part(kWorked, 1));
  }

  Json json = begin_json("gaps");
  json.add("samples", samples.size()).add("surface_area", area);
  add_radii(json, samples);
  add_foreign(json, foreign);
  add_maximality(json, report);
  files.write(json);
  watch.finish();

  const Table table = files.table();
  table.row("samples", number(samples.size()));
  print_foreign(table, foreign, neighborhood == amps::Neighborhood::kSpace);
  print_radii(table, samples);
  table.row("maximal", report.maximal() ? "yes" : "no");
  table.row("Poisson-disk", report.poisson_disk() ? "yes" : "no");
  print_maximality(table, report);
  if (std::isfinite(report.worst_coverage)) {
    const amps::Vec3& x = report.worst_point;
    table.row("  which is at", format("%.6g %.6g %.6g", x.x(), x.y(), x.z()));
  }
  table.row("gaps", number(report.gaps));
  table.row("area of gaps", format("%.6g   (%.3g %% of the surface)", report.gap_area, 100 * report.gap_area / area));
  if (arguments.operands() > 2) {
    const std::string out = Files::shown(arguments.operand(2), Files::kOutput);
    table.row("gap primitives", report.gaps > 0 ? "in " + out : "none, " + out + " is not written");
  }
  return report.maximal() ? kExitDone : kExitGaps;
}

int run_fill(const Arguments& arguments) {
  neighborhood_of(arguments, amps::Neighborhood::kSpace);  // refuses other names, before the work
  amps::SamplingOptions options;
  options.radius = arguments.positive("--radius");
  options.seed = arguments.whole("--seed", options.seed, 0, UINT64_MAX);
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  if (arguments.operand(1) != "none") files.reads("SAMPLES", arguments.operand(1), Holds::kSamples);
  files.writes("OUT", arguments.operand(2), Holds::kSamples);
  files.writes("--added", Holds::kSamples);
  files.writes("--json", Holds::kOther);
  files.look();
  const bool from_nothing = names_no_samples(files, arguments.operand(1));
  if (from_nothing && options.radius == 0) {
    throw arguments.error("there are no samples in " + Files::shown(arguments.operand(1), Files::kInput) +
                          ": say --radius R for new ones");
  }
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = files.mesh_to_sample(arguments.operand(0), watch.part(0, 0.05));
  amps::SampleSet before;
  if (!from_nothing) before = files.samples(arguments.operand(1), watch.part(0.05, 0.1));
  options.neighborhood =
      neighborhood_of(arguments, before.dimensions.empty() ? amps::Neighborhood::kSpace : amps::Neighborhood::kSurface);
  const bool balls = options.neighborhood == amps::Neighborhood::kSpace;

  ForeignSet foreign;
  amps::MaximalityReport was;
  if (!from_nothing) {
    foreign = look_at_set(mesh, before, watch.part(0.1, 0.2));
    was = amps::verify_maximal(mesh, before, watch.part(0.2, 0.35), options.conflict_rule, options.neighborhood);
  }
  options.execution = watch.part(0.35, 0.75);
  amps::SamplingResult result = from_nothing ? amps::sample(mesh, options) : amps::fill_gaps(mesh, before, options);
  watch.check(result.status);
  const amps::SampleSet filled = as_written(std::move(result.samples), before);
  const amps::MaximalityReport is =
      amps::verify_maximal(mesh, filled, watch.part(0.75, kWorked), options.conflict_rule, options.neighborhood);
  const amps::SampleSet added = samples_from(filled, before.size());
  files.write(arguments.operand(2), filled, watch.part(kWorked, 1));  // once it is in place, the others are written too
  const bool writes_added = arguments.has("--added") && added.size() > 0;
  if (writes_added) files.write(arguments.text("--added"), added, {});

  Json json = begin_json("fill");
  json.add("samples_before", before.size()).add("samples", filled.size()).add("added", added.size());
  add_radii(json, filled);
  add_foreign(json, foreign);
  if (!from_nothing) {
    json.open("before");
    add_maximality(json, was);
    json.close();
  }
  add_maximality(json, is);
  files.write(json);
  watch.finish();

  const Table table = files.table();
  table.row("", "before", "after");
  table.row("samples", number(before.size()), number(filled.size()));
  table.row("gaps", from_nothing ? "" : number(was.gaps), number(is.gaps));
  if (!from_nothing) table.row("worst coverage", format("%.6f r", was.worst_coverage), format("%.6f r", is.worst_coverage));
  table.row("added", number(added.size()) + (before.size() == 0  ? ""
                                             : added.size() == 0 ? ", the set was maximal"
                                                                 : ", after the others, which stay as they are"));
  if (arguments.has("--added")) {
    const std::string file = Files::shown(arguments.text("--added"), Files::kOutput);
    table.row("new samples", writes_added ? "in " + file : "none, " + file + " is not written");
  }
  print_foreign(table, foreign, balls);
  print_radii(table, filled);
  table.row("maximal", is.maximal() ? "yes" : "no");
  table.row("Poisson-disk", is.poisson_disk() ? "yes" : "no, samples given are nearer than their radii");
  print_maximality(table, is);
  print_unfilled(table, result.report);
  return is.maximal() ? kExitDone : kExitGaps;
}

int run_quality(const Arguments& arguments) {
  const double radius = arguments.positive("--radius");
  if (radius > 0 && arguments.has("--samples")) throw arguments.error("say either --radius R or --samples FILE, not both");
  amps::CurveOptions finding = curve_options(arguments);
  finding.radius = radius;
  finding.creases = finding.creases && arguments.has("--features");
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  files.reads("--samples", Holds::kSamples);
  files.writes("--png", Holds::kPicture);
  files.writes("--json", Holds::kOther);
  files.look();
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = files.usable_mesh(arguments.operand(0), watch.part(0, 0.2));
  std::vector<double> radii;
  if (radius > 0) radii.push_back(radius);
  if (arguments.has("--samples")) {
    radii = files.samples(arguments.text("--samples"), watch.part(0.2, 0.3)).radii;
    if (static_cast<std::ptrdiff_t>(radii.size()) != mesh.vertices.rows()) {
      throw arguments.error(
          std::to_string(radii.size()) + " samples in " + Files::shown(arguments.text("--samples"), Files::kInput) + " for " +
          std::to_string(mesh.vertices.rows()) + " vertices: take the set that 'amps remesh --samples' wrote beside this mesh");
    }
  }
  const bool marked = !arguments.has("--features") && files.mesh_format(arguments.operand(0), true) == amps::MeshFormat::kObj;
  std::vector<std::array<amps::Index, 2>> curves;
  if (marked) curves = files.marks(arguments.operand(0), watch.part(0.3, 0.4)).edges;
  finding.execution = watch.part(0.4, 0.6);
  if (curves.empty()) curves = edges_of(amps::find_curves(mesh, finding));
  const MeasuredQuality measured = measure_quality(mesh, curves, radii, watch.part(0.6, kWorked));
  if (arguments.has("--png")) {
    files.write(arguments.text("--png"), render::encode_png(histograms_of(measured.all), watch.part(kWorked, 1)));
  }

  Json json = begin_json("quality");
  add_measured(json, measured);
  files.write(json);
  watch.finish();
  print_measured(files.table(), measured);
  return kExitDone;
}

int run_info(const Arguments& arguments) {
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  files.reads("--reference", Holds::kMesh);
  files.writes("--json", Holds::kOther);
  files.look();
  const bool compare = arguments.has("--reference");
  Watch watch(arguments.quiet(), threads_of(arguments));
  amps::DistanceOptions options;
  const double looked = compare ? 0.1 : 1;  // distances take far longer than all the rest
  const amps::Execution reading = watch.part(0, 0.25 * looked);
  const amps::Mesh mesh =
      compare ? files.usable_mesh(arguments.operand(0), reading) : files.mesh(arguments.operand(0), reading);
  const amps::MeshReport report = amps::check(mesh, watch.part(0.25 * looked, 0.6 * looked));
  const amps::TopologyReport& shape = report.topology;
  const amps::QualityReport quality =
      report.usable() ? amps::quality(mesh, watch.part(0.6 * looked, 0.7 * looked)) : amps::QualityReport();
  amps::SelfIntersectionOptions crossing;
  crossing.max_pairs = 0;
  crossing.execution = watch.part(0.7 * looked, 0.85 * looked);
  const amps::SelfIntersectionReport intersections =
      report.usable() ? amps::find_self_intersections(mesh, crossing) : amps::SelfIntersectionReport();
  amps::CurveOptions curves;
  curves.execution = watch.part(0.85 * looked, looked);
  const amps::CurveGraph graph = report.usable() ? amps::find_curves(mesh, curves) : amps::CurveGraph();
  amps::DistanceReport distance;
  if (compare) {
    const amps::Mesh reference = files.usable_mesh(arguments.text("--reference"), watch.part(looked, looked + 0.05));
    options.execution = watch.part(looked + 0.05, 1);
    distance = amps::surface_distance(reference, mesh, options);
  }

  Json json = begin_json("info");
  json.add("usable", report.usable())
      .add("vertices", report.vertices)
      .add("triangles", report.facets)
      .add("area", report.area)
      .add("box_diagonal", report.box.diagonal())
      .add("non_finite_vertices", report.non_finite_vertices)
      .add("out_of_range_facets", report.out_of_range_facets)
      .add("repeated_index_facets", report.repeated_index_facets)
      .add("zero_area_facets", report.zero_area_facets)
      .add("repeated_facets", report.repeated_facets)
      .add("duplicate_vertices", report.duplicate_vertices)
      .add("isolated_vertices", report.isolated_vertices)
      .add("wild_vertex", report.wild_vertex)
      .add("crossing_polygons", static_cast<amps::Index>(mesh.crossing_polygons.size()));
  add_topology(json, "topology", shape);
  if (report.usable()) {
    json.add("self_intersections", static_cast<std::uint64_t>(intersections.num_pairs)).open("curves");
    add_graph(json, graph);
    json.close();
    add_quality(json, quality, 0);
  }
  if (compare) add_distance(json, arguments.text("--reference"), distance);
  files.write(json);
  watch.finish();

  const Table table = files.table();
  const auto count = [&](const char* name, amps::Index n) { table.row(name, number(n)); };
  const auto trouble = [&](const char* name, amps::Index n) {
    if (n > 0) count(name, n);
  };
  count("vertices", report.vertices);
  count("triangles", report.facets);
  table.row("area", number(report.area));
  table.row("box", format("%.6g x %.6g x %.6g", report.box.max.x() - report.box.min.x(),
                          report.box.max.y() - report.box.min.y(), report.box.max.z() - report.box.min.z()));
  count("components", shape.components);
  count("Euler characteristic", shape.euler_characteristic);
  if (shape.manifold() && shape.inconsistent_edges == 0) count("genus", shape.genus());
  count("boundary loops", shape.boundary_loops);
  table.row("closed", shape.closed() ? "yes" : "no");
  table.row("manifold", shape.manifold() ? "yes" : "no");
  trouble("non-manifold edges", shape.non_manifold_edges);
  trouble("non-manifold vertices", shape.non_manifold_vertices);
  trouble("inconsistent edges", shape.inconsistent_edges);
  trouble("duplicate vertices", report.duplicate_vertices);
  trouble("isolated vertices", report.isolated_vertices);
  trouble("crossing polygons", static_cast<amps::Index>(mesh.crossing_polygons.size()));
  trouble("zero-area triangles", report.zero_area_facets);
  trouble("repeated triangles", report.repeated_facets);
  trouble("repeated indices", report.repeated_index_facets);
  trouble("indices out of range", report.out_of_range_facets);
  trouble("non-finite vertices", report.non_finite_vertices);
  if (report.usable()) {
    table.row("self-intersections",
              intersections.empty() ? "none" : std::to_string(intersections.num_pairs) + " pairs of triangles");
    count("curves", static_cast<amps::Index>(graph.curves.size()));
    count("corners", static_cast<amps::Index>(graph.corners.size()));
    count("patches", graph.num_patches);
    print_quality(table, quality, 0);
  }
  if (compare) {
    table.row("reference", Files::shown(arguments.text("--reference"), Files::kInput));
    print_distance(table, distance);
  }
  if (report.wild_vertex != amps::kNone) {
    table.row("far from all others", Files::shown_vertex(mesh, report.wild_vertex) + ": correct it, or remove its facets");
  }
  table.row("can be remeshed", report.usable() && report.wild_vertex == amps::kNone ? "yes" : "no");
  return kExitDone;
}

/// The shape with about `n` triangles.
amps::Mesh make_shape(const Arguments& arguments, const std::string& shape, double n) {
  const auto rounded = [](double x, int least) {
    return std::max(static_cast<amps::Index>(least), static_cast<amps::Index>(std::lround(x)));
  };
  if (shape == "sphere") return amps::make_sphere(rounded(n, 20));
  if (shape == "square") return amps::make_square(rounded(std::sqrt(n / 2), 1));
  if (shape == "cube") return amps::make_cube(rounded(std::sqrt(n / 12), 1));
  if (shape == "torus") {  // cells about square: tube and axis circles of radii 0.4 and 1
    const amps::Index around = rounded(std::sqrt(0.4 * n / 2), 3);
    return amps::make_torus(1.0, 0.4, rounded(n / 2 / around, 3), around);
  }
  if (shape == "knot") {  // the number of cells along follows from that around, in proportion
    amps::KnotOptions options;
    const auto cells = static_cast<double>(amps::make_knot(options).triangles.rows()) / 2;
    options.around = rounded(options.around * std::sqrt(n / 2 / cells), 3);
    return amps::make_knot(options);
  }
  const std::vector<std::string> known{"sphere", "torus", "square", "knot", "cube"};
  throw arguments.error("unknown shape " + shape + did_you_mean(shape, known) +
                        "; it can be sphere, torus, square, knot or cube");
}

int run_make(const Arguments& arguments) {
  constexpr std::uint64_t kDefaultTriangles = 10000;
  constexpr std::uint64_t kMostTriangles = 100000000;
  const auto n = static_cast<double>(arguments.whole("--n", kDefaultTriangles, 1, kMostTriangles));
  Files files(arguments);
  files.writes("OUT", arguments.operand(1), Holds::kMesh);
  files.look();
  Watch watch(arguments.quiet(), 1);
  const amps::Mesh mesh = make_shape(arguments, arguments.operand(0), n);
  files.write(arguments.operand(1), mesh, {}, watch.part(0.2, 1));
  watch.finish();
  const Table table = files.table();
  table.row("vertices", std::to_string(mesh.vertices.rows()));
  table.row("triangles", std::to_string(mesh.triangles.rows()));
  return kExitDone;
}

int run_render(const Arguments& arguments) {
  const RenderRequest request = render_request(arguments);
  const bool curves = arguments.has("--curves");
  amps::CurveOptions finding = curve_options(arguments);
  finding.radius = arguments.positive("--radius");
  for (const char* name : {"--features", "--radius"}) {
    if (arguments.has(name) && !curves) throw arguments.error(std::string(name) + " is for curves: say --curves as well");
  }
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  files.reads("--samples", Holds::kSamples);
  files.reads("--added", Holds::kSamples);
  files.writes("OUT", arguments.operand(1), Holds::kPicture);
  files.look();
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = files.usable_mesh(arguments.operand(0), watch.part(0, kRead));
  amps::SampleSet samples, added;
  if (request.samples) samples = files.samples(arguments.text("--samples"), watch.part(kRead, 0.04));
  if (arguments.has("--added")) added = files.samples(arguments.text("--added"), watch.part(0.04, 0.05));
  std::vector<std::array<amps::Index, 2>> lines;
  if (curves) {
    const bool marked = !arguments.has("--features") && files.mesh_format(arguments.operand(0), true) == amps::MeshFormat::kObj;
    if (marked) lines = files.marks(arguments.operand(0), watch.part(0.05, 0.06)).edges;
    finding.execution = watch.part(0.06, 0.1);
    if (lines.empty()) lines = edges_of(amps::find_curves(mesh, finding));
  }
  render::Scene scene = scene_of(request, mesh, samples, watch.part(0.1, 0.25));
  if (request.samples && !arguments.has("--no-dots")) render::add_dots(samples, render::look::kDot, scene.options);
  if (added.size() > 0) render::add_dots(added, render::look::kRed, scene.options);
  render::set_curves(mesh, lines, scene);
  scene.options.execution = watch.part(0.25, 0.6);
  render::Image image = render::draw(scene.mesh, scene.options);
  if (arguments.has("--legend")) image = render::with_legend(image, legend_of(request, added.size() > 0));
  files.write(arguments.operand(1), render::encode_png(image, watch.part(0.6, 1)));
  watch.finish();
  return kExitDone;
}

int run_spectrum(const Arguments& arguments) {
  const SpectrumRequest request = spectrum_request(arguments);
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  for (std::size_t i = 1; i < arguments.operands(); ++i) files.reads("SAMPLES", arguments.operand(i), Holds::kSamples);
  files.writes("--csv", Holds::kOther);
  files.writes("--png", Holds::kPicture);
  files.writes("--plot", Holds::kPicture);
  files.writes("--json", Holds::kOther);
  files.look();
  Watch watch(arguments.quiet(), threads_of(arguments));
  const MeasuredSpectrum measured = measure_spectrum(arguments, files, request, watch);
  std::string png, plot;
  if (arguments.has("--png")) png = render::encode_png(picture_of(measured), watch.part(kWorked, 0.99));
  if (arguments.has("--plot")) plot = render::encode_png(plot_of(measured), watch.part(0.99, 1));

  if (arguments.has("--csv")) files.write(arguments.text("--csv"), csv_of(measured));
  if (arguments.has("--png")) files.write(arguments.text("--png"), png);
  if (arguments.has("--plot")) files.write(arguments.text("--plot"), plot);
  Json json = begin_json("spectrum");
  add_spectrum(json, measured);
  files.write(json);
  watch.finish();
  print_spectrum(files.table(), measured, request);
  return kExitDone;
}

const std::vector<Command>& commands() {
  static const Option kRadius{"--radius", "R", "disk radius, in the units of the mesh"};
  static const Option kVertices{"--vertices", "N", "number of samples wanted instead, met within 1 %"};
  static const Option kExact{"--exact", nullptr,
                             "meet N exactly: samples are added or taken out where that costs least, and the table tells what\n"
                             "coverage is left"};
  static const Option kSizing{
      "--sizing", "KIND", "uniform (default), lfs, curvature, or a file of one radius a vertex (numbers, or x.ply:PROPERTY)"};
  static const Option kRmin{"--rmin", "R", "least radius; with --rmax left out, radii go up to 16 R"};
  static const Option kRmax{"--rmax", "R", "greatest radius"};
  static const Option kError{"--error", "E", "radii by curvature, so that triangles are at most E off"};
  static const Option kGradation{"--gradation", "L",
                                 "how fast radii may grow along the surface (default 0.1): it sets the worst angle"};
  static const Option kSeed{"--seed", "S", "of the random numbers (default 1): the same seed gives the same bits"};
  static const Option kThreads{"--threads", "T", "default 0: one per core; the result does not depend on it"};
  static const Option kJson{"--json", "FILE", "write the table as JSON too"};
  static const Option kFeatures{"--features", "ANGLE", "keep creases of more than so many degrees (default 40), or none"};
  static const Option kBorders{"--borders", "HOW", "keep (default) or free: sampled like everything else"};
  static const Option kKeep{"--keep", "FILE",
                            "keep the edges too that lines (l) of an OBJ file name, and points (p) as corners"};
  static const Option kInSpace{"--neighborhood", "KIND",
                               "space (default): disks are balls; surface: sheets do not see each other's disks"};
  static const std::vector<Command> kCommands{
      {"sample",
       "IN OUT",
       "place a maximal Poisson-disk set on a mesh",
       "IN is a mesh (.obj .off .ply .stl), OUT a sample set (.xyzr .ply .csv). No two samples are nearer than the\n"
       "greater of their radii, and every point of the surface is within the radius of a sample.",
       {kRadius, kVertices, kExact, kSizing, kRmin, kRmax, kError, kGradation, kInSpace, kSeed, kThreads, kJson},
       run_sample},
      {"remesh",
       "IN OUT",
       "replace a mesh by one of well-shaped triangles",
       "IN and OUT are meshes (.obj .off .ply .stl). With one radius R everywhere, all angles of OUT are in [30, 120] degrees\n"
       "and all edges in [R, 2R]; where radii vary, angles follow from how fast they do (--gradation). Optimisation narrows\n"
       "angles to [35, 105], or [32, 114] where radii vary, and valences to 5, 6 and 7. Corners of IN that are narrower keep\n"
       "their angles. Tighter bounds take longer: --angle-min 42 --angle-max 90 leaves no obtuse triangle, in six times the "
       "time.\n"
       "Creases and borders are kept as curves. OBJ files hold them as lines, and the patches between them as groups; PLY "
       "files\n"
       "hold patches as a property of faces. The FILE of --keep is IN itself, or has vertices at the positions of those of "
       "IN.\n"
       "Exit code 4: OUT is written, but has another topology than IN, lacks edges of curves, is farther from IN\n"
       "than --error allows, has another number of vertices than --exact asks for, or has no triangle.",
       {kRadius,
        {"--vertices", "N", "number of vertices wanted instead, met within 2 %"},
        kExact,
        {"--sizing", "KIND",
         "uniform (default), lfs, curvature, a file of one radius a vertex (numbers, or x.ply:PROPERTY), or error: N vertices\n"
         "are spent where they lower the distance to IN most, in some thirty times the time"},
        kRmin,
        kRmax,
        {"--error", "E", "the result is at most E from the input, proved: in the units of the mesh, or 1% of its diagonal"},
        kGradation,
        kFeatures,
        kBorders,
        kKeep,
        {"--neighborhood", "KIND", "surface (default): sheets do not see each other's disks; space: disks are balls"},
        {"--topology", "WHAT", "preserve (default): radii fall where the shape asks for it; report: only say what is lost"},
        {"--optimize", "WHAT", "angle,valence (default), angle, valence, or none"},
        {"--angle-min", "DEG", "least angle to reach, below 60"},
        {"--angle-max", "DEG", "greatest angle to reach, above 60"},
        {"--fit", "HOW", "vertices leave the surface so that triangles lie closer to it: none (default), normal or free"},
        {"--iterations", "N", "stop optimising after so many visits to all that is bad"},
        {"--convergence", "FILE", "write the course of optimisation as CSV"},
        {"--report", "FILE", "write a page (.html) of IN and OUT side by side, to be turned, with charts and this table"},
        kSeed,
        kThreads,
        {"--samples", "FILE", "write the vertices as a sample set too (.xyzr .ply .csv)"},
        kJson},
       run_remesh},
      {"curves",
       "IN [OUT]",
       "find the curves that remesh keeps",
       "IN is a mesh (.obj .off .ply .stl). Curves are borders, edges of many facets, creases, and what is marked (--keep).\n"
       "Creases too small for the radius wanted are dropped, as in remesh with the same numbers. OUT is an .obj file of the\n"
       "curves, as lines, and of their corners, as points: look at it, change it, and give it to --keep.",
       {kFeatures,
        kBorders,
        kKeep,
        {"--radius", "R", "the radius wanted, in the units of the mesh (default: none, creases of all sizes)"},
        {"--vertices", "N", "the number of vertices wanted instead"},
        kThreads,
        kJson},
       run_curves},
      {"gaps",
       "IN SAMPLES [OUT]",
       "say whether a set of disks on a mesh is maximal",
       "SAMPLES is a sample set (.xyzr .ply .csv), made by amps or by anything else. If parts of the mesh IN are in no disk,\n"
       "triangles that cover them are written to OUT. Exit code 0: maximal; 3: not. Disks of sets that say what of the "
       "surface\n"
       "their samples are on, as those of remesh (.ply .csv), know the surface, others are balls.",
       {{"--neighborhood", "KIND", "space or surface, instead: disks are balls, or sheets do not see each other's disks"},
        kThreads,
        kJson},
       run_gaps},
      {"fill",
       "IN SAMPLES OUT",
       "make a set of disks maximal, wherever it comes from",
       "SAMPLES is a sample set on the mesh IN (.xyzr .ply .csv), made by amps or by anything else; or none. OUT is the same "
       "set,\n"
       "bit by bit and in its order, and after it the samples that were missing. Samples off the surface and samples too "
       "close\n"
       "are told, and stay. Exit code 3: gaps are left, which hold no double.",
       {{"--radius", "R", "of new samples (default: the least in SAMPLES, which it must not exceed where disks are balls)"},
        {"--added", "FILE", "write the new samples alone, too ('amps render --added' draws them in red)"},
        {"--neighborhood", "KIND", "space or surface: disks are balls, or sheets do not see each other's disks"},
        kSeed,
        kThreads,
        kJson},
       run_fill},
      {"quality",
       "IN",
       "say how good the triangles of a mesh are",
       "IN is a mesh (.obj .off .ply .stl). Angles and valences as histograms; the columns of the paper's tables: angles, Q,\n"
       "% of triangles below 30 and above 90 degrees, v567; and, with a radius or radii, edges and areas over what they can "
       "be\n"
       "in the dual of a maximal set (|e'_max| and |t'_max| at most 1, |t'_min| at least 1, where there is one radius).\n"
       "Triangles beside curves are told apart: lines (l) of IN if it has some, else borders, or with --features what is "
       "found.",
       {{"--radius", "R", "the radius that IN was made with"},
        {"--samples", "FILE", "one sample a vertex, as 'amps remesh --samples' writes them, for radii that vary"},
        {"--features", "ANGLE", "curves are borders and creases of more than so many degrees"},
        {"--png", "FILE", "draw the histograms"},
        kThreads,
        kJson},
       run_quality},
      {"spectrum",
       "IN SAMPLES...",
       "say how random, even and isotropic sample sets are",
       "SAMPLES are sample sets (.xyzr .ply .csv) on the mesh IN, best ten or more of the same kind by different seeds: all\n"
       "numbers are means over them. Where IN is a rectangle along the axes, at one z, what is measured is the power by\n"
       "frequency in the square in its middle (white noise: 1): radial mean and anisotropy, effective Nyquist frequency and\n"
       "oscillation. On any other mesh, it is the density of differences between samples, in radii along the surface.",
       {{"--csv", "FILE", "write radial mean and anisotropy as curves"},
        {"--png", "FILE", "draw power by frequency, or density of differences: black 0, grey 1, white 2 or more"},
        {"--plot", "FILE", "draw radial mean and anisotropy as curves"},
        {"--border", "HOW", "window (default): the square is a part of something; periodic: it goes on as itself"},
        {"--max-frequency", "F", "periods a side, 4 to 8192 (default: 4 times the root of the number of samples)"},
        {"--differences", nullptr, "differences in any case"},
        {"--range", "R", "greatest difference, in radii (default 5)"},
        kThreads,
        kJson},
       run_spectrum},
      {"info",
       "IN",
       "say what a mesh is like, and what is wrong with it",
       "IN is a mesh (.obj .off .ply .stl). With a reference, such as the mesh IN was made from, also: how far the surfaces\n"
       "are apart. No point of either is farther from the other than the Hausdorff distance; root mean square (RMS) and mean\n"
       "are over each surface, and the greater of both directions is given. Curves are borders and creases of more than\n"
       "40 degrees, of all sizes; 'amps curves' tells which of them a wanted radius keeps.",
       {{"--reference", "FILE", "tell the distance to this mesh, too"}, kThreads, kJson},
       run_info},
      {"make",
       "SHAPE OUT",
       "write a sphere, torus, square, knot or cube",
       "OUT is a mesh (.obj .off .ply .stl).",
       {{"--n", "N", "about so many triangles (default 10000)"}},
       run_make},
      {"render",
       "IN OUT",
       "draw a picture of a mesh",
       "IN is a mesh (.obj .off .ply .stl), OUT a .png. Insides, seen through holes or on flipped triangles, are red.\n"
       "Curves are the lines (l) of IN if it has some, such as amps writes them; else, or with --features, they are found.\n"
       "Looks: shape; valence (around vertices with 5 neighbours blue, 6 green, 7 orange, others dark); angles (triangles "
       "with\n"
       "one below 30 or above 120 degrees dark, below 35 or above 105 red); radius (cool where small, warm where large: of\n"
       "samples, or of edges). Of a sample set: cells (of its power diagram on the surface), gaps (in no disk: red), disks.\n"
       "The picture fits the model. The circles of disks are those of balls.",
       {{"--size", "N", "width and height in pixels (default 1024)"},
        {"--look", "NAME", "shape (default), valence, angles, radius, cells, gaps or disks"},
        {"--legend", nullptr, "say in the picture what the colours of a look mean"},
        {"--samples", "FILE", "a sample set (.xyzr .ply .csv): each is a dot"},
        {"--no-dots", nullptr, "no dots, only what the look makes of the set"},
        {"--added", "FILE", "samples drawn as red dots, such as those that 'amps fill' added"},
        {"--view", "NAME", "front, back, left, right, top, bottom or iso, in place of both angles"},
        {"--zoom", "F", "so many times larger than what fits, about the middle"},
        {"--azimuth", "DEG", "walk around the model (default 30)"},
        {"--elevation", "DEG", "look down on it (default 18)"},
        {"--z-up", nullptr, "the model's up axis is z, not y"},
        {"--smooth", nullptr, "interpolate normals"},
        {"--no-edges", nullptr, "do not draw triangle edges"},
        {"--curves", nullptr, "draw curves as thick lines"},
        {"--features", "ANGLE", "borders, and creases of more than so many degrees (default 40) or none"},
        {"--radius", "R", "drop creases too small for this radius, as remesh does"},
        kThreads},
       run_render},
  };
  return kCommands;
}

void print_help() {
  std::printf("amps %d.%d.%d: maximal Poisson-disk sampling on surfaces, and remeshing with it\n\n", AMPS_VERSION_MAJOR,
              AMPS_VERSION_MINOR, AMPS_VERSION_PATCH);
  std::printf("usage: amps COMMAND ...\n\n");
  for (const Command& command : commands()) {
    std::printf("  %-24s %s\n", (std::string(command.name) + " " + command.operands).c_str(), command.summary);
  }
  std::printf("\n'amps COMMAND --help' tells the options of a command,\n'amps --version' the version.\n");
  std::printf("%s\n",
              wrapped("Exit codes: 0 done, 2 bad input or usage, 3 'gaps' found some or 'fill' left some, 4 'remesh' lost some "
                      "of the shape or missed --error, a number was not met --exact, 130 interrupted, 143 terminated.",
                      0, 0)
                  .c_str());
}

void print_help(const Command& command) {
  constexpr std::size_t kHelpColumn = 21;
  const auto wrapped_anew = [](std::string text, std::size_t column, std::size_t indent) {  // its lines are those of the source
    std::replace(text.begin(), text.end(), '\n', ' ');
    return wrapped(text, column, indent);
  };
  std::printf("usage: amps %s %s [options]\n\n%s: %s.\n%s\n\n", command.name, command.operands, command.name, command.summary,
              wrapped_anew(command.details, 0, 0).c_str());
  for (const std::vector<Option>& group : {command.options, common_options()}) {
    for (const Option& option : group) {
      const std::string name = option.value == nullptr ? option.name : std::string(option.name) + " " + option.value;
      std::printf("  %-18s %s\n", name.c_str(),
                  wrapped_anew(option.help, std::max(kHelpColumn, name.size() + 3), kHelpColumn).c_str());
    }
  }
}

/// Advice for those who call the library, in terms of options.
std::string in_options(const Arguments& arguments, std::string message) {
  const std::string limit = "more than max_samples, ";
  const std::size_t at = message.find(limit), advice = message.find("; use ");
  if (at == std::string::npos || advice == std::string::npos || advice < at) return message;
  for (const char* name : {"--vertices", "--rmin", "--rmax", "--error", "--sizing"}) {
    if (!arguments.has(name)) continue;
    const bool fewer = name == std::string("--vertices"), file = name == std::string("--sizing");
    message.replace(
        advice, std::string::npos,
        fewer ? "; ask for fewer --vertices"
              : std::string("; ") + (file ? "use larger radii in " : "use a larger ") + (file ? arguments.text(name) : name));
    break;
  }
  return message.replace(at, limit.size(), "more than ");
}

int run(const std::vector<std::string>& words) {
  if (words.empty()) throw UsageError("amps: no command given (see 'amps --help')");
  const std::string& name = words.front();
  if (name == "--help" || name == "-h" || name == "help") {
    print_help();
    return kExitDone;
  }
  if (name == "--version") {
    std::printf("amps %d.%d.%d\n", AMPS_VERSION_MAJOR, AMPS_VERSION_MINOR, AMPS_VERSION_PATCH);
    return kExitDone;
  }
  std::vector<std::string> known;
  for (const Command& command : commands()) {
    known.emplace_back(command.name);
    if (name != command.name) continue;
    const Arguments arguments(command, {words.begin() + 1, words.end()});
    if (arguments.has("--help")) {
      print_help(command);
      return kExitDone;
    }
    try {
      return command.run(arguments);
    } catch (const amps::Error& error) {
      throw amps::Error(error.code(), in_options(arguments, error.what()));
    }
  }
  throw UsageError("amps: unknown command " + name + did_you_mean(name, known) + " (see 'amps --help')");
}

}  // namespace

int main(int argc, char** argv) {
  const auto interruption = [] {
    std::fprintf(stderr, "amps: interrupted, nothing is written\n");
    return kExitSignal + interrupted;
  };
#ifdef SIGXFSZ
  std::signal(SIGXFSZ, SIG_IGN);  // writing then fails, and what is half-written is taken away
#endif
  try {
    const int code = run({argv + 1, argv + argc});
    if (std::fflush(stdout) != 0) return complain("cannot write to the standard output");
    return code;
  } catch (const Interrupted&) {
    return interruption();
  } catch (const amps::Error& error) {
    return error.code() == amps::ErrorCode::kCancelled ? interruption() : complain(error.what());
  } catch (const std::bad_alloc&) {
    return complain("out of memory; use a larger radius or fewer vertices");
  } catch (const std::exception& error) {
    return complain(error.what());
  }
}
