#define AMPS_OWN_SOURCE
#include "amps/quality.h"

#include "amps/mesh_edges.h"
#include "amps/portable_math.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iomanip>
#include <limits>
#include <locale>
#include <ostream>
#include <sstream>
#include <string>
#include <vector>

namespace amps {
namespace {

constexpr double kDegreesPerBin = 5;  // of QualityReport::angles

struct FacetShape {
  double area;
  double smallest_angle, largest_angle;  ///< degrees
  bool obtuse;
  double q;
  std::array<double, 3> angles;  ///< degrees
};

FacetShape facet_shape(const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 corners[3] = {a, b, c};
  Vec3 edges[3];  // edge k lies opposite of corner k
  double lengths[3];
  for (int k = 0; k < 3; ++k) {
    edges[k] = corners[(k + 2) % 3] - corners[(k + 1) % 3];
    lengths[k] = detail::norm(edges[k]);
  }
  const int longest = static_cast<int>(std::max_element(lengths, lengths + 3) - lengths);
  // Products of lengths stay in range. Angles and Q do not depend on the scale.
  double scale = 1;
  if (lengths[longest] > 0x1p200 || (lengths[longest] < 0x1p-200 && lengths[longest] > 0)) {
    int exponent = 0;
    std::frexp(lengths[longest], &exponent);
    scale = std::ldexp(1.0, std::clamp(exponent, -1000, 1000));
    for (int k = 0; k < 3; ++k) {
      edges[k] /= scale;
      lengths[k] /= scale;
    }
  }
  // Twice the area, from the two shorter edges: its error is relative to their product, the smallest of the three.
  const double twice_area = detail::norm(edges[(longest + 1) % 3].cross(edges[(longest + 2) % 3]));
  if (!(twice_area > 0)) return {0, 0, 180, true, 0, {0, 0, 180}};

  FacetShape shape{twice_area / 2, 180, 0, false, 0, {}};
  for (int k = 0; k < 3; ++k) {
    // One of the two leads to the corner, one away from it.
    const double along = -detail::dot(edges[(k + 1) % 3], edges[(k + 2) % 3]);
    const double angle = detail::to_degrees(detail::portable_arc_tangent(twice_area, along));
    shape.angles[detail::slot(k)] = angle;
    shape.smallest_angle = std::min(shape.smallest_angle, angle);
    shape.largest_angle = std::max(shape.largest_angle, angle);
    shape.obtuse |= along < 0;
  }
  const double half_perimeter = (lengths[0] + lengths[1] + lengths[2]) / 2;
  shape.q = 6 / std::sqrt(3.0) * shape.area / (half_perimeter * lengths[longest]);
  shape.area = shape.area * scale * scale;
  return shape;
}

bool quality_skips(const TrianglesView& triangles, Index f) {
  return triangles(f, 0) == triangles(f, 1) || triangles(f, 1) == triangles(f, 2) || triangles(f, 2) == triangles(f, 0);
}

void measure_facets(const MeshView& mesh, QualityReport& report, const Execution& run) {
  detail::Ticker ticker(run, detail::slot(mesh.num_facets()), detail::kEdgesPerLook);
  report.min_angle = 180;
  report.min_q = 1;
  double smallest_area = std::numeric_limits<double>::infinity();
  double largest_area = 0;
  Index below_30 = 0;
  Index above_90 = 0;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    ticker.tick();
    if (quality_skips(mesh.triangles, f)) continue;
    const FacetShape shape = facet_shape(mesh.corner(f, 0), mesh.corner(f, 1), mesh.corner(f, 2));
    ++report.triangles;
    report.min_angle = std::min(report.min_angle, shape.smallest_angle);
    report.max_angle = std::max(report.max_angle, shape.largest_angle);
    report.mean_min_angle += shape.smallest_angle;
    report.min_q = std::min(report.min_q, shape.q);
    report.mean_q += shape.q;
    below_30 += shape.smallest_angle < 30;
    above_90 += shape.obtuse;
    for (const double angle : shape.angles) {
      ++report.angles[std::min(static_cast<std::size_t>(angle / kDegreesPerBin), report.angles.size() - 1)];
    }
    smallest_area = std::min(smallest_area, shape.area);
    largest_area = std::max(largest_area, shape.area);
  }
  if (report.triangles == 0) {
    report.min_angle = 0;
    report.min_q = 0;
    return;
  }
  const double n = report.triangles;
  report.mean_min_angle /= n;
  report.mean_q /= n;
  report.below_30 = 100 * below_30 / n;
  report.above_90 = 100 * above_90 / n;
  report.min_area = smallest_area;
  report.max_area = largest_area;
  report.area_ratio = largest_area > 0 ? smallest_area / largest_area : 0;
}

void measure_edges(const MeshView& mesh, QualityReport& report, const Execution& run) {
  std::vector<char> counted(detail::slot(mesh.num_facets()));
  for (Index f = 0; f < mesh.num_facets(); ++f) counted[detail::slot(f)] = quality_skips(mesh.triangles, f) ? 0 : 1;
  const detail::MeshEdges edges(mesh.triangles, mesh.num_vertices(), counted, run.part(0, 0.6));
  detail::Ticker ticker(run.part(0.6, 0.95), edges.size(), detail::kEdgesPerLook);
  const auto num_vertices = detail::slot(mesh.num_vertices());
  std::vector<Index> degree(num_vertices, 0);
  std::vector<char> on_boundary(num_vertices, 0);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    ticker.tick();
    const detail::MeshEdge edge = edges[e];
    const std::size_t low = detail::slot(edge.low), high = detail::slot(edge.high);
    const double length = detail::norm(mesh.vertices[edge.low] - mesh.vertices[edge.high]);
    report.min_edge = e == 0 ? length : std::min(report.min_edge, length);
    report.max_edge = std::max(report.max_edge, length);
    report.mean_edge += length;
    ++degree[low];
    ++degree[high];
    if (edge.boundary()) on_boundary[low] = on_boundary[high] = 1;
  }
  if (edges.size() > 0) report.mean_edge /= static_cast<double>(edges.size());

  Index good = 0;
  for (std::size_t v = 0; v < num_vertices; ++v) {
    if (degree[v] == 0 || on_boundary[v] != 0) continue;
    ++report.interior_vertices;
    ++report.valence[std::min(static_cast<std::size_t>(degree[v]), report.valence.size() - 1)];
    good += degree[v] >= 5 && degree[v] <= 7;
  }
  if (report.interior_vertices > 0) report.valence_5_6_7 = 100.0 * good / report.interior_vertices;
}

}  // namespace

QualityReport quality(const MeshView& mesh, const Execution& execution) {
  const Execution run = execution.start("measuring triangles");
  QualityReport report;
  measure_facets(mesh, report, run.part(0, 0.6));
  measure_edges(mesh, report, run.part(0.6, 1));
  run.finish();
  return report;
}

BoundRatios bound_ratios(const MeshView& mesh, const ValuesView& radii, const Execution& execution) {
  const Execution run = execution.start("measuring triangles");
  if (radii.size() != mesh.num_vertices()) {
    throw Error(ErrorCode::kInvalidArgument, "amps: " + std::to_string(radii.size()) + " radii for " +
                                                 std::to_string(mesh.num_vertices()) + " vertices; give one a vertex");
  }
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    if (!(radii[v] > 0) || !std::isfinite(radii[v])) {
      throw Error(ErrorCode::kInvalidArgument,
                  "amps: the radius of vertex " + std::to_string(v) + " is not finite and above 0; leave that vertex out");
    }
  }
  const double least_of_one = std::sqrt(3.0) / 4, greatest_of_one = 3 * least_of_one;
  BoundRatios ratios;
  ratios.min_edge = ratios.min_area = std::numeric_limits<double>::infinity();
  std::vector<char> counted(detail::slot(mesh.num_facets()));
  detail::Ticker ticker(run.part(0, 0.4), detail::slot(mesh.num_facets()), detail::kEdgesPerLook);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    ticker.tick();
    if (quality_skips(mesh.triangles, f)) continue;
    counted[detail::slot(f)] = 1;
    const double area = facet_shape(mesh.corner(f, 0), mesh.corner(f, 1), mesh.corner(f, 2)).area;
    const auto [low, high] =
        std::minmax({radii[mesh.triangles(f, 0)], radii[mesh.triangles(f, 1)], radii[mesh.triangles(f, 2)]});
    ratios.min_area = std::min(ratios.min_area, area / low / low / least_of_one);
    ratios.max_area = std::max(ratios.max_area, area / high / high / greatest_of_one);
  }
  const detail::MeshEdges edges(mesh.triangles, mesh.num_vertices(), counted, run.part(0.4, 0.8));
  if (edges.size() == 0) return {};
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const double a = radii[edges[e].low], b = radii[edges[e].high];
    const double length = detail::norm(mesh.vertices[edges[e].low] - mesh.vertices[edges[e].high]);
    ratios.min_edge = std::min(ratios.min_edge, length / std::max(a, b));
    ratios.max_edge = std::max(ratios.max_edge, length / (a + b));
    const double gradation = a == b ? 0 : std::abs(a - b) / length;
    ratios.gradation = std::max(ratios.gradation, gradation);
    ratios.mean_gradation += gradation / static_cast<double>(edges.size());
  }
  run.finish();
  return ratios;
}

std::ostream& operator<<(std::ostream& out, const QualityReport& report) {
  std::ostringstream text;  // neither the caller's format nor its locale
  text.imbue(std::locale::classic());
  text << std::fixed << std::setprecision(2);
  text << "triangles " << report.triangles << "\n";
  text << "angles    min " << report.min_angle << ", max " << report.max_angle << ", mean of smallest " << report.mean_min_angle
       << " degrees; below 30: " << report.below_30 << " %, above 90: " << report.above_90 << " %\n";
  text << std::setprecision(4) << "Q         min " << report.min_q << ", mean " << report.mean_q << "; smallest/largest area "
       << report.area_ratio << "\n";
  text << std::defaultfloat << std::setprecision(6) << "edges     min " << report.min_edge << ", max " << report.max_edge
       << ", mean " << report.mean_edge << "\n";
  text << std::fixed << std::setprecision(2) << "valence   5 to 7: " << report.valence_5_6_7 << " % of "
       << report.interior_vertices << " interior vertices;";
  for (std::size_t d = 0; d < report.valence.size(); ++d) {
    if (report.valence[d] > 0) text << " " << d << (d + 1 == report.valence.size() ? "+:" : ":") << report.valence[d];
  }
  text << "\n";
  return out << text.str();
}

}  // namespace amps
