// cli_quality.h: amps quality — how good the triangles of a mesh are: histograms, the columns of the paper's tables, and what
// is beside curves apart.
#pragma once

#include "amps/amps.h"
#include "cli_commands.h"
#include "cli_curves.h"
#include "cli_files.h"
#include "cli_output.h"
#include "cli_report.h"
#include "cli_watch.h"
#include "render_plot.h"
#include "render_png.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

/// All that is told of a mesh.
struct MeasuredQuality {
  amps::QualityReport all, beside, away;  ///< triangles with a vertex on a curve, and the others
  amps::Index curves = 0;
  bool has_radii = false;
  bool uniform = false;  ///< one radius
  double radius = 0;     ///< that one
  amps::BoundRatios ratios;
};

/// The triangles with, or without, a vertex that is marked.
inline amps::Mesh triangles_of(const amps::Mesh& mesh, const std::vector<char>& marked, bool with) {
  std::vector<std::ptrdiff_t> rows;
  for (std::ptrdiff_t f = 0; f < mesh.triangles.rows(); ++f) {
    bool any = false;
    for (int k = 0; k < 3; ++k) any = any || marked[static_cast<std::size_t>(mesh.triangles(f, k))] != 0;
    if (any == with) rows.push_back(f);
  }
  amps::Mesh part;
  part.vertices = mesh.vertices;
  part.triangles.resize(static_cast<std::ptrdiff_t>(rows.size()));
  for (std::size_t i = 0; i < rows.size(); ++i)
    part.triangles.row(static_cast<std::ptrdiff_t>(i)) = mesh.triangles.row(rows[i]);
  return part;
}

/// `radii`: one a vertex, or one alone, or none.
inline MeasuredQuality measure_quality(const amps::Mesh& mesh, const std::vector<std::array<amps::Index, 2>>& curves,
                                       std::vector<double> radii, const amps::Execution& execution) {
  MeasuredQuality measured;
  measured.all = amps::quality(mesh, execution.part(0, 0.4));
  measured.curves = static_cast<amps::Index>(curves.size());
  if (!curves.empty()) {
    std::vector<char> marked(static_cast<std::size_t>(mesh.vertices.rows()), 0);
    for (const auto& edge : curves) {
      for (const amps::Index v : edge) marked[static_cast<std::size_t>(v)] = 1;
    }
    measured.beside = amps::quality(triangles_of(mesh, marked, true), execution.part(0.4, 0.6));
    measured.away = amps::quality(triangles_of(mesh, marked, false), execution.part(0.6, 0.8));
  }
  measured.has_radii = !radii.empty();
  if (measured.has_radii) {
    const auto [low, high] = std::minmax_element(radii.begin(), radii.end());
    measured.uniform = *low == *high;
    measured.radius = *low;
    if (radii.size() == 1) radii.assign(static_cast<std::size_t>(mesh.vertices.rows()), measured.radius);
    measured.ratios = amps::bound_ratios(mesh, radii, execution.part(0.8, 1));
  }
  return measured;
}

/// One bar a line, between the first and the last that is not empty.
inline void print_histogram(const Table& table, const char* title,
                            const std::vector<std::pair<std::string, amps::Index>>& bars) {
  constexpr double kWidest = 40;  // the table fits 80 columns
  amps::Index most = 1, all = 0;
  std::size_t first = bars.size(), last = 0;
  for (std::size_t i = 0; i < bars.size(); ++i) {
    if (bars[i].second == 0) continue;
    first = std::min(first, i);
    last = i;
    most = std::max(most, bars[i].second);
    all += bars[i].second;
  }
  if (all == 0) return;
  table.row(title, "");
  for (std::size_t i = first; i <= last; ++i) {
    const auto width = static_cast<std::size_t>(kWidest * bars[i].second / most + 0.5);
    const std::string bar = width > 0 ? std::string(width, '#') : bars[i].second > 0 ? "." : "";
    table.row(format("  %10s", bars[i].first.c_str()).c_str(), format("%6.2f %%  ", 100.0 * bars[i].second / all) + bar);
  }
}

inline std::vector<std::pair<std::string, amps::Index>> angle_bars(const amps::QualityReport& report) {
  std::vector<std::pair<std::string, amps::Index>> bars;
  const int degrees = 180 / static_cast<int>(report.angles.size());
  for (std::size_t k = 0; k < report.angles.size(); ++k) {
    const int from = static_cast<int>(k) * degrees;
    bars.emplace_back(format("%d to %d", from, from + degrees), report.angles[k]);
  }
  return bars;
}

inline std::vector<std::pair<std::string, amps::Index>> valence_bars(const amps::QualityReport& report) {
  std::vector<std::pair<std::string, amps::Index>> bars;
  for (std::size_t d = 0; d < report.valence.size(); ++d) {
    bars.emplace_back(format(d + 1 < report.valence.size() ? "%zu" : "%zu or more", d), report.valence[d]);
  }
  return bars;
}

inline void print_measured(const Table& table, const MeasuredQuality& measured) {
  const amps::QualityReport& q = measured.all;
  table.row("triangles", number(q.triangles));
  table.row("angles", format("%.2f to %.2f degrees", q.min_angle, q.max_angle));
  table.row("mean smallest angle", format("%.2f degrees", q.mean_min_angle));
  table.row("below 30 degrees", format("%.3g %% of triangles", q.below_30));
  table.row("above 90 degrees", format("%.3g %% of triangles", q.above_90));
  table.row("Q", format("%.4f least, %.4f mean", q.min_q, q.mean_q));
  if (q.interior_vertices > 0) table.row("v567", format("%.2f %%   (valence 5 to 7, inside)", q.valence_5_6_7));
  table.row("edges", format("%.6g to %.6g, mean %.6g", q.min_edge, q.max_edge, q.mean_edge));
  table.row("areas", format("%.6g to %.6g, ratio %.4g", q.min_area, q.max_area, q.area_ratio));
  if (measured.has_radii) {
    const amps::BoundRatios& ratios = measured.ratios;
    table.row("|e'_min|", format("%.6f   (edge / greater radius, bound: >= 1)", ratios.min_edge));
    table.row("|e'_max|", format("%.6f   (edge / sum of radii, bound: <= 1)", ratios.max_edge));
    const char* least = measured.uniform ? "bound: >= 1" : "no bound";
    const char* greatest = measured.uniform ? "bound: <= 1" : "no bound";
    table.row("|t'_min|", format("%.6f   (area / that of edges r, %s)", ratios.min_area, least));
    table.row("|t'_max|", format("%.6f   (area / greatest in circle r, %s)", ratios.max_area, greatest));
    if (!measured.uniform) {
      table.row("gradation", format("%.4f greatest, %.4f mean   (of radii)", ratios.gradation, ratios.mean_gradation));
    }
  }
  if (measured.curves > 0) {
    const auto part = [&](const char* name, const amps::QualityReport& report) {
      if (report.triangles == 0) return;
      table.row(name, format("%.2f to %.2f degrees, Q %.3f, %.3g %% below 30", report.min_angle, report.max_angle, report.min_q,
                             report.below_30));
    };
    part("beside curves", measured.beside);
    part("away from them", measured.away);
  }
  print_histogram(table, "angles, degrees", angle_bars(q));
  print_histogram(table, "valence, inside", valence_bars(q));
}

inline void add_measured(Json& json, const MeasuredQuality& measured) {
  add_quality(json, measured.all, measured.uniform ? measured.radius : 0);
  if (measured.has_radii) {
    json.open("bounds")
        .add("e_min", measured.ratios.min_edge)
        .add("e_max", measured.ratios.max_edge)
        .add("t_min", measured.ratios.min_area)
        .add("t_max", measured.ratios.max_area)
        .add("gradation", measured.ratios.gradation)
        .add("mean_gradation", measured.ratios.mean_gradation)
        .close();
  }
  const auto part = [&](const char* key, const amps::QualityReport& report) {
    if (report.triangles == 0) return;
    json.open(key)
        .add("triangles", report.triangles)
        .add("min_angle", report.min_angle)
        .add("max_angle", report.max_angle)
        .add("min_q", report.min_q)
        .add("percent_below_30", report.below_30)
        .add("percent_above_90", report.above_90)
        .close();
  };
  part("beside_curves", measured.beside);
  part("away_from_curves", measured.away);
}

/// Both histograms as one picture.
inline render::Image histograms_of(const amps::QualityReport& report) {
  const auto steps = [](const char* title, const char* label, const auto& counts, double from, double width, double x_min,
                        double x_max) {
    render::Plot plot;
    plot.x_min = x_min;
    plot.x_max = x_max;
    plot.title = title;
    plot.x_label = label;
    plot.y_label = "%";
    plot.height = 420;
    double all = 0;
    for (const amps::Index n : counts) all += n;
    render::Series series;
    for (std::size_t k = 0; k < counts.size(); ++k) {
      const double share = all > 0 ? 100 * counts[k] / all : 0, at = from + width * static_cast<double>(k);
      series.x.insert(series.x.end(), {at, at + width});
      series.y.insert(series.y.end(), {share, share});
    }
    plot.series.push_back(series);
    return render::draw(plot);
  };
  const double bin = 180.0 / static_cast<double>(report.angles.size());
  constexpr double kLeastValence = 2.5, kMostValence = 11.5;  // shown
  return render::sheet(
      {{steps("Angles", "degrees", report.angles, 0, bin, 0, 180), ""},
       {steps("Valences of inner vertices", "valence", report.valence, -0.5, 1, kLeastValence, kMostValence), ""}},
      1);
}

inline int run_quality(const Arguments& arguments) {
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
