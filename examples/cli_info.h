// cli_info.h: amps info, and amps make.
#pragma once

#include "amps/amps.h"
#include "cli_commands.h"
#include "cli_curves.h"
#include "cli_files.h"
#include "cli_output.h"
#include "cli_report.h"
#include "cli_watch.h"

#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

inline int run_info(const Arguments& arguments) {
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
inline amps::Mesh make_shape(const Arguments& arguments, const std::string& shape, double n) {
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

inline int run_make(const Arguments& arguments) {
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
