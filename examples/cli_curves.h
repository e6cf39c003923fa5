// cli_curves.h: curves that are kept — what --features, --borders and --keep ask for, and curves found as a table, JSON and
// lines.
#pragma once

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_commands.h"
#include "cli_files.h"
#include "cli_keep.h"
#include "cli_output.h"
#include "cli_report.h"
#include "cli_watch.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

/// --features and --borders; --keep is for later, as it needs the mesh.
inline amps::CurveOptions curve_options(const Arguments& arguments) {
  amps::CurveOptions options;
  const std::string features = arguments.text("--features", "40");
  options.creases = features != "none";
  if (options.creases && arguments.has("--features")) options.crease_angle = arguments.real("--features", 40, 1, 179);
  const std::string borders = arguments.text("--borders", "keep");
  if (borders != "keep" && borders != "free") throw arguments.error("--borders " + borders + ": name keep or free");
  options.borders = borders == "keep";
  for (const char* name : {"--features", "--borders", "--keep"}) {
    if (arguments.has(name) && arguments.text("--neighborhood", "surface") == "space") {
      throw arguments.error(std::string(name) + " does not go with --neighborhood space: balls keep no curves");
    }
  }
  return options;
}

/// The radius that remesh() finds curves by where so many vertices are wanted.
inline double first_radius(const amps::Mesh& mesh, double vertices) {
  return std::sqrt(amps::kSamplesPerDensity * amps::total_area(mesh) / vertices);
}

/// Curves of each kind in a graph.
struct CurveCounts {
  std::array<amps::Index, amps::kNumCurveKinds> curves{};
  std::array<double, amps::kNumCurveKinds> length{};
  amps::Index loops = 0;
  double total = 0;

  explicit CurveCounts(const amps::CurveGraph& graph) {
    for (const amps::Curve& curve : graph.curves) {
      const auto kind = static_cast<std::size_t>(curve.kind);
      ++curves[kind];
      length[kind] += curve.length();
      total += curve.length();
      loops += curve.closed ? 1 : 0;
    }
  }
};

inline void print_graph(const Table& table, const amps::CurveGraph& graph) {
  const CurveCounts counts(graph);
  table.row("", "curves", "length");
  for (std::size_t kind = 0; kind < amps::kNumCurveKinds; ++kind) {
    if (counts.curves[kind] == 0) continue;
    table.row(amps::name_of(static_cast<amps::CurveKind>(kind)), number(counts.curves[kind]), number(counts.length[kind]));
  }
  table.row("all", number(static_cast<amps::Index>(graph.curves.size())), number(counts.total));
  table.row("closed loops", number(counts.loops));
  table.row("corners", number(static_cast<amps::Index>(graph.corners.size())));
  table.row("patches", number(graph.num_patches));
  table.row("candidates dropped", number(static_cast<amps::Index>(graph.dropped.size())) + " edges");
}

inline void add_graph(Json& json, const amps::CurveGraph& graph) {
  const CurveCounts counts(graph);
  json.add("curves", static_cast<amps::Index>(graph.curves.size()))
      .add("length", counts.total)
      .add("closed_loops", counts.loops)
      .add("corners", static_cast<amps::Index>(graph.corners.size()))
      .add("patches", graph.num_patches)
      .add("dropped_edges", static_cast<amps::Index>(graph.dropped.size()))
      .open("kinds");
  for (std::size_t kind = 0; kind < amps::kNumCurveKinds; ++kind) {
    json.open(key_of(static_cast<amps::CurveKind>(kind)).c_str())
        .add("curves", counts.curves[kind])
        .add("length", counts.length[kind])
        .close();
  }
  json.close();
}

/// The edges of all curves, curve by curve.
inline std::vector<std::array<amps::Index, 2>> edges_of(const amps::CurveGraph& graph) {
  std::vector<std::array<amps::Index, 2>> edges;
  for (const amps::Curve& curve : graph.curves) {
    for (std::size_t k = 1; k < curve.vertices.size(); ++k) edges.push_back({curve.vertices[k - 1], curve.vertices[k]});
  }
  return edges;
}

/// Curves and corners as an OBJ file of lines and points: --keep takes them as they are.
inline void write_graph(const Files& files, const std::string& name, const amps::Mesh& mesh, const amps::CurveGraph& graph,
                        const amps::Execution& execution) {
  amps::MeshWriteOptions writing;
  writing.edges = edges_of(graph);
  writing.vertices = graph.corners;
  std::vector<amps::Index> used = graph.corners;  // vertices, ascending
  for (const auto& edge : writing.edges) used.insert(used.end(), edge.begin(), edge.end());
  std::sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());
  const auto renumbered = [&used](amps::Index v) {
    return static_cast<amps::Index>(std::lower_bound(used.begin(), used.end(), v) - used.begin());
  };
  for (auto& edge : writing.edges) edge = {renumbered(edge[0]), renumbered(edge[1])};
  for (amps::Index& corner : writing.vertices) corner = renumbered(corner);
  amps::Mesh lines;
  lines.vertices.resize(static_cast<std::ptrdiff_t>(used.size()));
  for (std::size_t i = 0; i < used.size(); ++i) lines.vertices.row(static_cast<std::ptrdiff_t>(i)) = mesh.vertices.row(used[i]);
  files.write(name, lines, writing, execution);
}

inline int run_curves(const Arguments& arguments) {
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
