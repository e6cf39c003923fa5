// cli_page.h: the report page of `amps remesh --report`: input and output in one HTML file that needs no network. Everything
// that is not turned by mouse is in the page as text and SVG; what the viewer draws (report_page/page.js) is in it as base64 of
// little-endian numbers.
#pragma once

#include "amps/amps.h"
#include "cli_curves.h"
#include "cli_output.h"
#include "cli_plots.h"
#include "cli_report.h"
#include "page_files.h"  // generated from report_page/ by embed.cmake

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <map>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

namespace page {

/// A mesh of more triangles is not drawn: some 40 bytes of file and 100 bytes of graphics memory each.
constexpr std::ptrdiff_t kMostDrawn = 2000000;
constexpr std::uint8_t kNoValence = 255;  ///< on a border, or in no triangle
constexpr float kUnknown = -1;

inline std::string base64(const std::string& bytes) {
  const char* const digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 3; ++k)
      word = word << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += i + k <= bytes.size() ? digits[word >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

inline void append(std::string& bytes, std::uint32_t value) {
  for (int k = 0; k < 4; ++k) bytes += static_cast<char>(value >> (8 * k) & 255);
}
inline void append(std::string& bytes, float value) {
  std::uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  append(bytes, bits);
}
inline void append(std::string& bytes, std::uint8_t value) { bytes += static_cast<char>(value); }

template <class Range>
std::string encoded(const Range& values) {
  std::string bytes;
  for (const auto value : values) append(bytes, value);
  return base64(bytes);
}

/// Neighbours of each vertex that is on no edge of one facet, vertices of equal position being one; else kNoValence.
inline std::vector<std::uint8_t> valences(const amps::Mesh& mesh, const amps::Execution& execution) {
  constexpr std::size_t kVerticesPerLook = 1 << 14;
  const amps::Mesh welded = amps::merge_equal_vertices(mesh, execution.part(0, 0.5));
  const auto n = static_cast<std::size_t>(welded.vertices.rows());
  const auto place = [&welded](std::ptrdiff_t t, int k) { return static_cast<std::size_t>(welded.triangles(t, k)); };
  const auto for_each_side = [&](const auto& body) {  // from the lower to the higher vertex
    for (std::ptrdiff_t t = 0; t < welded.triangles.rows(); ++t) {
      const std::array<std::size_t, 3> at{place(t, 0), place(t, 1), place(t, 2)};
      if (at[0] == at[1] || at[1] == at[2] || at[2] == at[0]) continue;
      for (std::size_t k = 0; k < 3; ++k) body(std::min(at[k], at[(k + 1) % 3]), std::max(at[k], at[(k + 1) % 3]));
    }
  };
  std::vector<std::size_t> end(n + 1, 0);
  for_each_side([&end](std::size_t low, std::size_t) { ++end[low + 1]; });
  std::partial_sum(end.begin(), end.end(), end.begin());
  std::vector<std::size_t> others(end.back());  // those of vertex v at [end[v - 1], end[v]) once all are there
  for_each_side([&](std::size_t low, std::size_t high) { others[end[low]++] = high; });
  std::vector<int> degree(n, 0);
  std::vector<char> border(n, 0);
  for (std::size_t v = 0; v < n; ++v) {
    if (v % kVerticesPerLook == 0) execution.report(0.6 + 0.4 * static_cast<double>(v) / static_cast<double>(n));
    const auto stop = others.begin() + static_cast<std::ptrdiff_t>(end[v]);
    auto at = others.begin() + static_cast<std::ptrdiff_t>(v > 0 ? end[v - 1] : 0);
    std::sort(at, stop);
    while (at != stop) {
      const auto next = std::upper_bound(at, stop, *at);
      for (const std::size_t w : {v, *at}) {
        ++degree[w];
        if (next == at + 1) border[w] = 1;
      }
      at = next;
    }
  }
  std::vector<std::uint8_t> result(static_cast<std::size_t>(mesh.vertices.rows()), kNoValence);
  for (std::ptrdiff_t t = 0; t < mesh.triangles.rows(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const std::size_t v = place(t, k);
      if (degree[v] == 0 || border[v] != 0) continue;
      result[static_cast<std::size_t>(mesh.triangles(t, k))] = static_cast<std::uint8_t>(std::min(degree[v], kNoValence - 1));
    }
  }
  return result;
}

/// By triangle: the greatest distance of its corners, the middles of its sides and its centre to another surface.
inline std::vector<double> distances(const amps::Mesh& from, const amps::Mesh& to, const amps::Execution& execution) {
  constexpr std::ptrdiff_t kPoints = 7, kTrianglesAtOnce = 1 << 14;
  std::vector<double> result;
  if (from.triangles.rows() == 0 || to.triangles.rows() == 0) return result;
  const amps::SurfaceTree tree(to, execution.part(0, 0.1));
  const amps::MeshView view(from);
  const std::ptrdiff_t n = from.triangles.rows();
  result.reserve(static_cast<std::size_t>(n));
  for (std::ptrdiff_t begin = 0; begin < n; begin += kTrianglesAtOnce) {
    const std::ptrdiff_t end = std::min(n, begin + kTrianglesAtOnce);
    amps::Points points;
    points.resize(kPoints * (end - begin));
    for (std::ptrdiff_t t = begin; t < end; ++t) {
      const auto f = static_cast<amps::Index>(t);
      const amps::Vec3 a = view.corner(f, 0), b = view.corner(f, 1), c = view.corner(f, 2);
      const amps::Vec3 those[kPoints] = {a, (a + b) / 2, b, (b + c) / 2, c, (c + a) / 2, (a + b + c) / 3};
      for (std::ptrdiff_t k = 0; k < kPoints; ++k) points.row(kPoints * (t - begin) + k) = those[k].transpose();
    }
    const auto part = [&](std::ptrdiff_t done) { return 0.1 + 0.9 * static_cast<double>(done) / static_cast<double>(n); };
    const std::vector<amps::SurfaceHit> hits = tree.nearest_all(points, execution.part(part(begin), part(end)));
    for (std::size_t i = 0; i < hits.size(); i += kPoints) {
      double greatest = 0;
      for (std::size_t k = i; k < i + kPoints; ++k) greatest = std::max(greatest, hits[k].distance);
      result.push_back(greatest);
    }
  }
  return result;
}

/// All but one in a hundred are at most this.
inline double nearly_greatest(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(values.size() - 1 - values.size() / 100);
  std::nth_element(values.begin(), place, values.end());
  return *place > 0 ? *place : *std::max_element(values.begin(), values.end());
}

/// A model's points as the viewer has them: around the middle of the input's box, in halves of its diagonal.
struct Frame {
  amps::Vec3 middle;
  double half_diagonal;

  explicit Frame(const amps::Mesh& mesh) {
    const amps::Box box = amps::bounding_box(mesh);
    middle = box.min / 2 + box.max / 2;
    half_diagonal = (box.max / 2 - box.min / 2).norm();
  }
  std::string encode(const amps::Points& points) const {
    std::string bytes;
    for (std::ptrdiff_t v = 0; v < points.rows(); ++v) {
      for (int k = 0; k < 3; ++k) append(bytes, static_cast<float>((points(v, k) - middle[k]) / half_diagonal));
    }
    return base64(bytes);
  }
};

/// One mesh, measured.
struct MeshData {
  const amps::Mesh& mesh;
  std::vector<std::uint8_t> valences;
  std::vector<double> distances;
  std::vector<std::array<amps::Index, 2>> curves;
};

/// What the page has to measure.
struct Measures {
  MeshData in, out;
  amps::GapSet gaps;
};

}  // namespace page

/// What the page tells.
struct PageContent {
  const amps::Mesh& input;
  const amps::RemeshResult& result;
  std::string input_name, output_name;
  std::string command;
  std::string trouble;  ///< what of the shape or of what was asked for is missed; empty: nothing
  const page::Measures& measures;
  const Table& table;
  const Seconds& seconds;
};

namespace page {

inline void add_mesh(Json& json, const char* key, const MeshData& data, const Frame& frame, double most_distance,
                     const std::vector<float>& radii) {
  json.open(key);
  if (data.mesh.triangles.rows() <= kMostDrawn) {
    std::vector<std::uint32_t> corners, ends;
    for (std::ptrdiff_t t = 0; t < data.mesh.triangles.rows(); ++t) {
      for (int k = 0; k < 3; ++k) corners.push_back(static_cast<std::uint32_t>(data.mesh.triangles(t, k)));
    }
    for (const auto& edge : data.curves) {
      for (const amps::Index v : edge) ends.push_back(static_cast<std::uint32_t>(v));
    }
    std::vector<float> distances(static_cast<std::size_t>(data.mesh.triangles.rows()), kUnknown);
    for (std::size_t t = 0; t < data.distances.size(); ++t) {
      distances[t] = most_distance > 0 ? static_cast<float>(std::min(1.0, data.distances[t] / most_distance)) : 0;
    }
    json.add("positions", frame.encode(data.mesh.vertices))
        .add("indices", encoded(corners))
        .add("valences", encoded(data.valences))
        .add("radii", encoded(radii))
        .add("distances", encoded(distances))
        .add("curves", encoded(ends));
  }
  json.close();
}

/// What the viewer draws, as JSON that may stand in a script element.
inline std::string viewer_data(const PageContent& content) {
  const MeshData &in = content.measures.in, &out = content.measures.out;
  const Frame frame(content.input);
  const amps::SampleSet& samples = content.result.samples;
  const RadiusRange range(samples);
  std::vector<float> radii;
  for (const double r : samples.radii) {
    radii.push_back(range.max > range.min ? static_cast<float>((r - range.min) / (range.max - range.min)) : 0.5f);
  }
  std::vector<double> all = in.distances;
  all.insert(all.end(), out.distances.begin(), out.distances.end());
  const double most = nearly_greatest(all), farthest = all.empty() ? 0 : *std::max_element(all.begin(), all.end());
  const double to_percent = 50 / frame.half_diagonal;

  const amps::MaximalityReport& maximality = content.result.report.maximality;
  std::string gap_text =
      format("No gaps: every point of the input lies in a disk. The worst covered one is %.6f r from its sample.",
             maximality.worst_coverage);
  if (!maximality.measured) {
    gap_text = "Gaps were not looked for.";
  } else if (maximality.gaps > 0) {
    gap_text = format("%d gaps of area %.3g in all: parts of the input that no disk covers", static_cast<int>(maximality.gaps),
                      maximality.gap_area);
  }
  const amps::GapSet& gaps = content.measures.gaps;
  amps::Points corners;
  corners.resize(3 * gaps.primitives.triangles.rows());
  for (std::ptrdiff_t t = 0; t < gaps.primitives.triangles.rows(); ++t) {
    for (int k = 0; k < 3; ++k) corners.row(3 * t + k) = gaps.primitives.vertices.row(gaps.primitives.triangles(t, k));
  }

  Json json;
  json.open();
  json.add("notDrawn", format("Neither mesh is drawn: each has no triangle, or more than %d.", static_cast<int>(kMostDrawn)));
  json.open("radius").add("low", range.min).add("high", range.max).close();
  json.open("distance").add("high", most * to_percent).add("farthest", farthest * to_percent).close();
  json.add("gapText", gap_text).add("gaps", frame.encode(corners));
  add_mesh(json, "input", in, frame, most, {});
  add_mesh(json, "output", out, frame, most, radii);
  std::string text = json.close().text();
  for (std::size_t at = 0; (at = text.find('<', at)) != std::string::npos;) text.replace(at, 1, "\\u003c");
  return text;
}

inline Histogram angle_histogram(const amps::Mesh& mesh) {
  constexpr double kDegree = 3.14159265358979323846 / 180;
  Histogram histogram(0, 180, 60);
  const amps::MeshView view(mesh);
  for (amps::Index t = 0; t < view.num_facets(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const amps::Vec3 u = view.corner(t, (k + 1) % 3) - view.corner(t, k), v = view.corner(t, (k + 2) % 3) - view.corner(t, k);
      histogram.add(std::atan2(u.cross(v).norm(), u.dot(v)) / kDegree);
    }
  }
  return histogram;
}

inline Histogram valence_histogram(const std::vector<std::uint8_t>& valences) {
  Histogram histogram(2.5, 10.5, 8);
  for (const std::uint8_t d : valences) {
    if (d != kNoValence) histogram.add(d);
  }
  return histogram;
}

/// Of edges over the greater radius of their ends; an inner edge counts twice, as it does in the mean over triangles.
inline Histogram edge_histogram(const amps::RemeshResult& result) {
  Histogram histogram(0.5, 3, 75);
  const amps::MeshView view(result.mesh);
  for (amps::Index t = 0; t < view.num_facets(); ++t) {
    for (int k = 0; k < 3; ++k) {
      const auto a = static_cast<std::size_t>(view.triangles(t, k)),
                 b = static_cast<std::size_t>(view.triangles(t, (k + 1) % 3));
      const double length = (view.corner(t, k) - view.corner(t, (k + 1) % 3)).norm();
      histogram.add(length / std::max(result.samples.radii[a], result.samples.radii[b]));
    }
  }
  return histogram;
}

/// Filled bars of the output, an outline of the input if there is one.
inline void draw_histograms(Plot& plot, const Histogram* in, const Histogram& out) {
  plot.bars(out, "output");
  if (in != nullptr) plot.outline(*in, "input");
  if (in != nullptr) plot.key("input", "input", false);
  plot.key("output", "output", true);
}

/// Bad triangles and vertices by sweep, on a scale of log(1 + n).
inline std::string convergence_plot(const amps::OptimizeReport& report) {
  const auto height = [](double n) { return std::log10(1 + n); };
  std::vector<std::pair<double, double>> triangles, vertices;
  constexpr double kHeadroom = 1.3;  // for the key
  double most = 0;
  for (const amps::OptimizeIteration& now : report.iterations) {
    const auto sweep = static_cast<double>(triangles.size());
    triangles.emplace_back(sweep, height(now.bad_triangles));
    vertices.emplace_back(sweep, height(now.bad_vertices));
    most = std::max({most, triangles.back().second, vertices.back().second});
  }
  const double last = std::max(1.0, static_cast<double>(triangles.size() - 1));
  Plot plot(format("Convergence: what is bad, by sweep (%.3g s)", report.iterations.back().seconds), 0, last, kHeadroom * most);
  Plot::Ticks counts{{0, "0"}};
  for (double n = 1; height(n) <= kHeadroom * most; n *= 10) counts.emplace_back(height(n), format("%g", n));
  Plot::Ticks sweeps;
  for (const auto& tick : round_ticks(last)) {
    if (tick.first == std::floor(tick.first)) sweeps.push_back(tick);
  }
  plot.ticks(sweeps, counts, "sweep", "bad");
  plot.line(triangles, "first");
  plot.line(vertices, "second");
  plot.key("triangles", "line first", false);
  plot.key("vertices", "line second", false);
  return plot.text();
}

inline std::string charts(const PageContent& content) {
  const MeshData &in = content.measures.in, &out = content.measures.out;
  const amps::OptimizeReport& optimization = content.result.report.optimization;
  const bool optimized = !optimization.iterations.empty() && optimization.min_angle > 0;
  const auto frame = [](Plot& plot, double high, const Plot::Ticks& along_x, const char* x_name) {
    plot.ticks(along_x, round_ticks(high, " %"), x_name, "");
  };
  std::string text;
  {
    const Histogram before = angle_histogram(content.input), after = angle_histogram(content.result.mesh);
    const double high = 1.1 * std::max(before.greatest_percent(), after.greatest_percent());
    Plot plot("Angles: share of corners, by 3 degrees", 0, 180, high);
    Plot::Ticks degrees;
    for (int a = 0; a <= 180; a += 30) degrees.emplace_back(a, std::to_string(a));
    frame(plot, high, degrees, optimized ? "degrees; dashed: bounds asked for" : "degrees; dashed: bounds of one radius");
    draw_histograms(plot, &before, after);
    plot.bound(optimized ? optimization.min_angle : 30);
    plot.bound(optimized ? optimization.max_angle : 120);
    text += plot.text();
  }
  {
    const Histogram before = valence_histogram(in.valences), after = valence_histogram(out.valences);
    const double high = 1.1 * std::max(before.greatest_percent(), after.greatest_percent());
    Plot plot("Valences: share of inner vertices", 2.5, 10.5, high);
    Plot::Ticks numbers;
    for (int d = 3; d <= 10; ++d) numbers.emplace_back(d, d == 10 ? "10+" : std::to_string(d));
    frame(plot, high, numbers, "neighbours of a vertex");
    draw_histograms(plot, &before, after);
    text += plot.text();
  }
  {
    const Histogram edges = edge_histogram(content.result);
    const double high = 1.1 * edges.greatest_percent();
    Plot plot("Edges of the output over r", 0.5, 3, high);
    frame(plot, high, {{0.5, "0.5"}, {1, "1"}, {1.5, "1.5"}, {2, "2"}, {2.5, "2.5"}, {3, "3"}},
          "length / greater radius of its ends; dashed: bounds");
    draw_histograms(plot, nullptr, edges);
    plot.bound(1);
    plot.bound(2);
    text += plot.text();
  }
  if (!optimization.iterations.empty()) text += convergence_plot(optimization);
  return text;
}

inline std::string table_text(const Table& table) {
  std::string text = "<table id=\"table\">\n";
  for (const Table::Row& row : table.rows()) {
    if (row.name == "seconds") continue;  // stages have a table of their own
    const std::string first = html(row.first), second = html(row.second);
    if (row.name.empty()) {
      text += "<tr><td></td><th scope=\"col\">" + first + "</th><th scope=\"col\">" + second + "</th></tr>\n";
      continue;
    }
    text += "<tr><th scope=\"row\">" + html(row.name) + "</th>";
    text += row.has_second ? "<td>" + first + "</td><td>" + second + "</td>" : "<td colspan=\"2\">" + first + "</td>";
    text += "</tr>\n";
  }
  return text + "</table>";
}

inline std::string seconds_text(const Seconds& seconds) {
  double most = 0;
  for (const auto& [stage, s] : seconds) most = std::max(most, s);
  std::string text = "<table id=\"seconds\">\n";
  for (const auto& [stage, s] : seconds) {
    text += format("<tr><th scope=\"row\">%s</th><td class=\"number\">%.3f</td>", stage, s) +
            format("<td><span class=\"share\" style=\"width:%.1f%%\"></span></td></tr>\n", most > 0 ? 100 * s / most : 0);
  }
  return text + "</table>";
}

/// A file without its folder.
inline std::string file_name(const std::string& path) { return std::filesystem::path(path).filename().string(); }

inline std::string caption(const std::string& name, const amps::Mesh& mesh) {
  std::string text = html(name) + ", " + std::to_string(mesh.triangles.rows()) + " triangles";
  return mesh.triangles.rows() > kMostDrawn ? text + ", too many to be drawn" : text;
}

/// `pattern` with each {{NAME}} replaced.
inline std::string filled(const std::string& pattern, const std::map<std::string, std::string>& values) {
  std::string text;
  for (std::size_t at = 0;;) {
    const std::size_t open = pattern.find("{{", at), close = pattern.find("}}", open);
    if (close == std::string::npos) return text + pattern.substr(at);
    text += pattern.substr(at, open - at) + values.at(pattern.substr(open + 2, close - open - 2));
    at = close + 2;
  }
}

template <std::size_t N>
std::string as_text(const unsigned char (&bytes)[N]) {
  return {bytes, bytes + N};
}

}  // namespace page

/// All that takes long. Both meshes are referenced, not copied. Cancelled, it throws.
inline page::Measures measure_for_page(const amps::Mesh& input, const amps::RemeshResult& result,
                                       amps::Neighborhood neighborhood, const amps::Execution& execution) {
  page::Measures measures{{input, page::valences(input, execution.part(0, 0.1)), {}, {}},
                          {result.mesh, page::valences(result.mesh, execution.part(0.1, 0.15)), {}, result.curve_edges},
                          {}};
  if (result.graph != nullptr) measures.in.curves = edges_of(*result.graph);
  const amps::Execution measuring = execution.part(0.15, 0.95, "measuring distances");
  if (input.triangles.rows() <= page::kMostDrawn) {
    measures.in.distances = page::distances(input, result.mesh, measuring.part(0, 0.7));
  }
  if (result.mesh.triangles.rows() <= page::kMostDrawn) {
    measures.out.distances = page::distances(result.mesh, input, measuring.part(0.7, 1));
  }
  if (result.report.maximality.gaps > 0) {
    measures.gaps = amps::find_gaps(input, result.samples, execution.part(0.95, 1), neighborhood, result.graph.get());
  }
  return measures;
}

/// The whole page.
inline std::string report_page(const PageContent& content) {
  const amps::RemeshResult& result = content.result;
  const std::string status = content.trouble.empty() ? std::string(amps::name_of(result.status)) : content.trouble;
  const std::string version = format("%d.%d.%d", AMPS_VERSION_MAJOR, AMPS_VERSION_MINOR, AMPS_VERSION_PATCH);
  return page::filled(page::as_text(kFile_page_html), {{"VERSION", version},
                                                       {"TITLE", html(content.input_name + " → " + content.output_name)},
                                                       {"STATUS_CLASS", result.status == amps::Outcome::kDone ? "good" : "bad"},
                                                       {"STATUS", "Status: " + html(status)},
                                                       {"COMMAND", html(content.command)},
                                                       {"INPUT_CAPTION", page::caption(content.input_name, content.input)},
                                                       {"OUTPUT_CAPTION", page::caption(content.output_name, result.mesh)},
                                                       {"CHARTS", page::charts(content)},
                                                       {"TABLE", page::table_text(content.table)},
                                                       {"SECONDS", page::seconds_text(content.seconds)},
                                                       {"DATA", page::viewer_data(content)},
                                                       {"STYLE", page::as_text(kFile_page_css)},
                                                       {"SCRIPT", page::as_text(kFile_page_js)}});
}
