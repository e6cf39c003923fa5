// amps_cli.cpp: the command-line program `amps` — maximal Poisson-disk sampling and remeshing of mesh files.
//
//   amps remesh bunny.obj out.obj --vertices 12000
//
// Read from the bottom: main() finds the command, parses its options and runs it. A command reads, works, writes and prints a
// table, in that order. Exit codes: 0 done, 2 bad input or usage (one line on stderr says what to do), 3 `gaps` found some, 4
// `remesh` has lost something of the shape (all files are written, one line on stderr says what is lost), 130 interrupted.

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_curves.h"
#include "cli_files.h"
#include "cli_keep.h"
#include "cli_output.h"
#include "cli_page.h"
#include "cli_report.h"
#include "cli_sizing.h"
#include "cli_watch.h"
#include "render_png.h"

#include <algorithm>
#include <cmath>
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
constexpr int kExitInterrupted = 130;  // 128 + SIGINT, as a shell reports it

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
  options.seed = arguments.whole("--seed", options.seed, 0, UINT64_MAX);
  options.execution.threads = threads_of(arguments);
  options.neighborhood = neighborhood_of(arguments, neighborhood);
  return options;
}

int run_sample(const Arguments& arguments) {
  const SizingRequest sizing = sizing_request(arguments);
  amps::SamplingOptions options = sampling_options(arguments, amps::Neighborhood::kSpace);
  require_sample_output(arguments, arguments.operand(1));
  if (arguments.has("--json")) require_writable(arguments, arguments.text("--json"));
  require_distinct(arguments, arguments.operand(1), {"--json"});

  const Stopwatch total;
  Watch watch(arguments.quiet(), options.execution.threads);
  const amps::Mesh mesh = load(arguments.operand(0), watch.part(0, kRead));
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
  amps::write_samples(arguments.operand(1), result.samples, watch.part(kWorked, 1));
  watch.finish();
  Seconds seconds{{"read", seconds_read}, {"sizing", seconds_sizing}};
  for (const auto& stage : seconds_of(result.report)) seconds.push_back(stage);
  seconds.insert(seconds.end(), {{"verify", seconds_verify}, {"write", write.seconds()}, {"total", total.seconds()}});

  Json json = begin_json("sample");
  json.add("status", amps::name_of(result.status));
  json.add("samples", result.samples.size());
  add_radii(json, result.samples);
  add_sampling(json, result.report);
  add_maximality(json, certificate);
  add_seconds(json, seconds);
  write_json(arguments, json);

  const Table table(arguments.quiet());
  table.row("samples", number(result.samples.size()));
  table.row("of darts and of gaps", number(result.report.dart_samples) + " and " + number(result.report.gap_samples));
  print_radii(table, result.samples);
  print_maximality(table, certificate);
  print_unfilled(table, result.report);
  print_seconds(table, seconds);
  return kExitDone;
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

/// Writes the result; with its curves, if it has any, as lines and its patches as labels.
void write_result(const std::string& path, const amps::RemeshResult& result, const amps::Execution& execution) {
  amps::MeshWriteOptions writing;
  writing.edges = result.curve_edges;
  if (!writing.edges.empty()) writing.labels = result.patches;
  amps::write_mesh(path, result.mesh, writing, execution);
}

amps::Fit fit_of(const Arguments& arguments) {
  const std::string how = arguments.text("--fit", "none");
  for (const amps::Fit fit : {amps::Fit::kOff, amps::Fit::kNormal, amps::Fit::kFree}) {
    if (how == amps::name_of(fit)) return fit;
  }
  throw arguments.error("--fit " + how + ": name none, normal or free");
}

int run_remesh(const Arguments& arguments) {
  const SizingRequest sizing = sizing_request(arguments, true);
  amps::RemeshOptions options;
  options.sampling = sampling_options(arguments, amps::Neighborhood::kSurface);
  options.curves = curve_options(arguments);
  set_optimization(arguments, options);
  options.fit = fit_of(arguments);
  if (arguments.has("--convergence")) require_writable(arguments, arguments.text("--convergence"));
  require_mesh_output(arguments, arguments.operand(1));
  if (arguments.has("--samples")) require_sample_output(arguments, arguments.text("--samples"));
  if (arguments.has("--json")) require_writable(arguments, arguments.text("--json"));
  if (arguments.has("--report")) require_writable(arguments, arguments.text("--report"));
  require_distinct(arguments, arguments.operand(1), {"--samples", "--convergence", "--json", "--report"});

  const Stopwatch total;
  Watch watch(arguments.quiet(), options.sampling.execution.threads);
  const amps::Mesh mesh = load(arguments.operand(0), watch.part(0, kRead));
  keep_marks(arguments, mesh, watch.part(kRead, kMarked), options.curves);
  const double seconds_read = total.seconds();
  const double sized = sizing.kind == "uniform" ? kMarked : kSized;
  options.sampling.sizing = make_sizing(sizing, mesh, watch.part(kMarked, sized));
  options.max_error = error_of(sizing, mesh);
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
  write_result(arguments.operand(1), result, watch.part(kWorked, 1));
  if (arguments.has("--samples")) amps::write_samples(arguments.text("--samples"), result.samples);
  if (arguments.has("--convergence")) {
    std::ostringstream convergence;
    amps::write_convergence(convergence, result.report.optimization);
    write_file(arguments.text("--convergence"), convergence.str());
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
  Json json = begin_json("remesh");
  json.add("status", amps::name_of(result.status));
  json.add("vertices", static_cast<amps::Index>(result.mesh.vertices.rows()));
  json.add("triangles", static_cast<amps::Index>(result.mesh.triangles.rows()));
  json.add("in_no_triangle", static_cast<amps::Index>(unused));
  add_radii(json, result.samples);
  add_sampling(json, report.sampling);
  add_optimization(json, report.optimization);
  add_fit(json, options.fit, report.fit);
  add_error(json, options.max_error, report);
  add_quality(json, report.quality, radius);
  add_maximality(json, report.maximality);
  add_crossings(json, report);
  add_curves(json, report.curves);
  add_certificate(json, report.certificate);
  add_topology(json, "input", report.input);
  add_topology(json, "output", report.output);
  add_seconds(json, seconds);
  write_json(arguments, json);

  Table table(arguments.quiet());
  table.hold();
  table.row("", "input", "output");
  const amps::Index asked = options.sampling.target_count;
  std::string vertices = std::to_string(result.mesh.vertices.rows());
  if (asked > 0) vertices += " of " + number(asked) + " asked for";
  table.row("vertices", number(report.input.vertices), vertices);
  table.row("triangles", number(report.input.facets), number(report.output.facets));
  print_topology(table, report.input, report.output);
  print_certificate(table, report.certificate);
  print_curves(table, report.curves);
  print_crossings(table, report);
  if (unused > 0) table.row("in no triangle", "", std::to_string(unused));
  print_radii(table, result.samples);
  print_optimization(table, options.optimization, report.optimization);
  print_fit(table, options.fit, report.fit);
  print_error(table, options.max_error, report);
  print_quality(table, report.quality, radius);
  print_maximality(table, report.maximality);
  print_unfilled(table, report.sampling);
  print_seconds(table, seconds);
  std::string lost = amps::lost_shape(report);
  if (lost.empty() && options.max_error > 0 && !(report.hausdorff_bound <= options.max_error)) {
    lost = format("the result is up to %.6g from the input, %.6g was asked for; take a larger --error", report.hausdorff_bound,
                  options.max_error);
  }
  if (reports) {
    write_file(arguments.text("--report"),
               report_page({mesh, result, page::file_name(arguments.operand(0)), page::file_name(arguments.operand(1)),
                            arguments.command_line(), lost, *measures, table, seconds}));
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
  if (arguments.operands() > 1) require_line_output(arguments, arguments.operand(1));
  if (arguments.has("--json")) require_writable(arguments, arguments.text("--json"));
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = load(arguments.operand(0), watch.part(0, 0.4));
  keep_marks(arguments, mesh, watch.part(0.4, 0.5), options);
  if (vertices > 0) options.radius = first_radius(mesh, vertices);
  options.execution = watch.part(0.5, 0.9);
  const amps::CurveGraph graph = amps::find_curves(mesh, options);
  const bool writes = arguments.operands() > 1 && !graph.empty();
  if (writes) write_graph(arguments.operand(1), mesh, graph, watch.part(0.9, 1));
  watch.finish();

  Json json = begin_json("curves");
  json.add("radius", options.radius);
  add_graph(json, graph);
  write_json(arguments, json);

  const Table table(arguments.quiet());
  print_graph(table, graph);
  table.row("radius r", options.radius > 0 ? number(options.radius) : "none: creases of all sizes");
  if (arguments.operands() > 1) {
    table.row("lines", writes ? "in " + arguments.operand(1) : "none, " + arguments.operand(1) + " is not written");
  }
  return kExitDone;
}

int run_gaps(const Arguments& arguments) {
  neighborhood_of(arguments, amps::Neighborhood::kSpace);  // refuses other names, before the work
  if (arguments.operands() > 2) require_mesh_output(arguments, arguments.operand(2));
  if (arguments.has("--json")) require_writable(arguments, arguments.text("--json"));
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = load(arguments.operand(0), watch.part(0, 0.05));
  const amps::SampleSet samples = amps::read_samples(arguments.operand(1), watch.part(0.05, 0.1));
  // Sets that say what of the surface their samples are on are those of remesh.
  const amps::Neighborhood neighborhood =
      neighborhood_of(arguments, samples.dimensions.empty() ? amps::Neighborhood::kSpace : amps::Neighborhood::kSurface);
  const amps::MaximalityReport report =
      amps::verify_maximal(mesh, samples, watch.part(0.1, 0.5), amps::ConflictRule::kMax, neighborhood);
  const double area = amps::total_area(mesh, watch.part(0.5, 0.51));
  if (arguments.operands() > 2 && report.gaps > 0) {
    const amps::GapSet gaps = amps::find_gaps(mesh, samples, watch.part(0.51, kWorked), neighborhood);
    amps::write_mesh(arguments.operand(2), gaps.primitives, {}, watch.part(kWorked, 1));
  }
  watch.finish();

  Json json = begin_json("gaps");
  json.add("samples", samples.size()).add("surface_area", area);
  add_radii(json, samples);
  add_maximality(json, report);
  write_json(arguments, json);

  const Table table(arguments.quiet());
  table.row("samples", number(samples.size()));
  print_radii(table, samples);
  table.row("maximal", report.maximal() ? "yes" : "no");
  table.row("Poisson-disk", report.poisson_disk() ? "yes" : "no");
  print_maximality(table, report);
  table.row("gaps", number(report.gaps));
  table.row("area of gaps", format("%.6g   (%.3g %% of the surface)", report.gap_area, 100 * report.gap_area / area));
  if (arguments.operands() > 2) {
    table.row("gap primitives",
              report.gaps > 0 ? "in " + arguments.operand(2) : "none, " + arguments.operand(2) + " is not written");
  }
  return report.maximal() ? kExitDone : kExitGaps;
}

int run_info(const Arguments& arguments) {
  if (arguments.has("--json")) require_writable(arguments, arguments.text("--json"));
  const bool compare = arguments.has("--reference");
  Watch watch(arguments.quiet(), threads_of(arguments));
  amps::DistanceOptions options;
  const double looked = compare ? 0.1 : 1;  // distances take far longer than all the rest
  const amps::Execution reading = watch.part(0, 0.25 * looked);
  const amps::Mesh mesh = compare ? load(arguments.operand(0), reading) : amps::read_mesh(arguments.operand(0), reading);
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
    const amps::Mesh reference = load(arguments.text("--reference"), watch.part(looked, looked + 0.05));
    options.execution = watch.part(looked + 0.05, 1);
    distance = amps::surface_distance(reference, mesh, options);
  }
  watch.finish();

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
      .add("crossing_polygons", static_cast<amps::Index>(mesh.crossing_polygons.size()));
  add_topology(json, "topology", shape);
  if (report.usable()) {
    json.add("self_intersections", static_cast<std::uint64_t>(intersections.num_pairs)).open("curves");
    add_graph(json, graph);
    json.close();
    add_quality(json, quality, 0);
  }
  if (compare) add_distance(json, arguments.text("--reference"), distance);
  write_json(arguments, json);

  const Table table(arguments.quiet());
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
    table.row("reference", arguments.text("--reference"));
    print_distance(table, distance);
  }
  table.row("can be remeshed", report.usable() ? "yes" : "no");
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
  require_mesh_output(arguments, arguments.operand(1));
  Watch watch(arguments.quiet(), 1);
  const amps::Mesh mesh = make_shape(arguments, arguments.operand(0), n);
  amps::write_mesh(arguments.operand(1), mesh, {}, watch.part(0.2, 1));
  watch.finish();
  const Table table(arguments.quiet());
  table.row("vertices", std::to_string(mesh.vertices.rows()));
  table.row("triangles", std::to_string(mesh.triangles.rows()));
  return kExitDone;
}

int run_render(const Arguments& arguments) {
  constexpr std::uint64_t kLargestPicture = 16384;
  render::Options options;
  options.size = static_cast<int>(arguments.whole("--size", 1024, 16, kLargestPicture));
  options.azimuth = arguments.real("--azimuth", options.azimuth, -360, 360);
  options.elevation = arguments.real("--elevation", options.elevation, -90, 90);
  options.smooth = arguments.has("--smooth");
  options.edges = !arguments.has("--no-edges");
  options.z_up = arguments.has("--z-up");
  const bool curves = arguments.has("--curves");
  amps::CurveOptions finding = curve_options(arguments);
  finding.radius = arguments.positive("--radius");
  for (const char* name : {"--features", "--radius"}) {
    if (arguments.has(name) && !curves) throw arguments.error(std::string(name) + " is for curves: say --curves as well");
  }
  std::string extension = fs::path(arguments.operand(1)).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  if (extension != ".png") throw arguments.error("cannot draw " + arguments.operand(1) + ": name a .png file");
  require_writable(arguments, arguments.operand(1));
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = load(arguments.operand(0), watch.part(0, kRead));
  if (curves) {
    const bool marked = !arguments.has("--features") && amps::mesh_format(arguments.operand(0)) == amps::MeshFormat::kObj;
    if (marked) options.curves = amps::read_mesh_marks(arguments.operand(0), watch.part(kRead, 0.05)).edges;
    finding.execution = watch.part(0.05, 0.1);
    if (options.curves.empty()) options.curves = edges_of(amps::find_curves(mesh, finding));
  }
  options.execution = watch.part(0.1, 0.6);
  const render::Image image = render::draw(mesh, options);
  write_file(arguments.operand(1), render::encode_png(image, watch.part(0.6, 1)));
  watch.finish();
  return kExitDone;
}

const std::vector<Command>& commands() {
  static const Option kRadius{"--radius", "R", "disk radius, in the units of the mesh"};
  static const Option kVertices{"--vertices", "N", "number of samples wanted instead, met within 1 %"};
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
       {kRadius, kVertices, kSizing, kRmin, kRmax, kError, kGradation, kInSpace, kSeed, kThreads, kJson},
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
       "than --error allows, or has no triangle.",
       {kRadius,
        {"--vertices", "N", "number of vertices wanted instead, met within 2 %"},
        kSizing,
        kRmin,
        kRmax,
        {"--error", "E", "the result is at most E from the input, proved: in the units of the mesh, or 1% of its diagonal"},
        kGradation,
        kFeatures,
        kBorders,
        kKeep,
        {"--neighborhood", "KIND", "surface (default): sheets do not see each other's disks; space: disks are balls"},
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
       "is a set of disks on a mesh maximal?",
       "SAMPLES is a sample set (.xyzr .ply .csv), made by amps or by anything else. If parts of the mesh IN are in no disk,\n"
       "triangles that cover them are written to OUT. Exit code 0: maximal; 3: not. Disks of sets that say what of the "
       "surface\n"
       "their samples are on, as those of remesh (.ply .csv), know the surface, others are balls.",
       {{"--neighborhood", "KIND", "space or surface, instead: disks are balls, or sheets do not see each other's disks"},
        kThreads,
        kJson},
       run_gaps},
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
       "Curves are the lines (l) of IN if it has some, such as amps writes them; else, or with --features, they are found.",
       {{"--size", "N", "width and height in pixels (default 1024)"},
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
              wrapped("Exit codes: 0 done, 2 bad input or usage, 3 'gaps' found some, 4 'remesh' lost some of the shape "
                      "or missed --error, 130 interrupted.",
                      0, 0)
                  .c_str());
}

void print_help(const Command& command) {
  constexpr std::size_t kHelpColumn = 21;
  std::string details = command.details;  // its lines are those of the source
  std::replace(details.begin(), details.end(), '\n', ' ');
  std::printf("usage: amps %s %s [options]\n\n%s: %s.\n%s\n\n", command.name, command.operands, command.name, command.summary,
              wrapped(details, 0, 0).c_str());
  for (const std::vector<Option>& group : {command.options, common_options()}) {
    for (const Option& option : group) {
      const std::string name = option.value == nullptr ? option.name : std::string(option.name) + " " + option.value;
      std::printf("  %-18s %s\n", name.c_str(),
                  wrapped(option.help, std::max(kHelpColumn, name.size() + 3), kHelpColumn).c_str());
    }
  }
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
    if (!arguments.has("--help")) return command.run(arguments);
    print_help(command);
    return kExitDone;
  }
  throw UsageError("amps: unknown command " + name + did_you_mean(name, known) + " (see 'amps --help')");
}

}  // namespace

int main(int argc, char** argv) {
  const auto interruption = [] {
    std::fprintf(stderr, "amps: interrupted, nothing is written\n");
    return kExitInterrupted;
  };
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
