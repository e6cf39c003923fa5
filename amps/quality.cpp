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

/// The report of facets and edges that are added, in order.
class QualityMeasure {
 public:
  explicit QualityMeasure(std::size_t num_vertices) : degree_(num_vertices, 0), on_boundary_(num_vertices, 0) {
    report_.min_angle = 180;
    report_.min_q = 1;
  }

  void add_facet(const FacetShape& shape) {
    ++report_.triangles;
    report_.min_angle = std::min(report_.min_angle, shape.smallest_angle);
    report_.max_angle = std::max(report_.max_angle, shape.largest_angle);
    report_.mean_min_angle += shape.smallest_angle;
    report_.min_q = std::min(report_.min_q, shape.q);
    report_.mean_q += shape.q;
    below_30_ += shape.smallest_angle < 30;
    above_90_ += shape.obtuse;
    for (const double angle : shape.angles) {
      ++report_.angles[std::min(static_cast<std::size_t>(angle / kDegreesPerBin), report_.angles.size() - 1)];
    }
    smallest_area_ = std::min(smallest_area_, shape.area);
    report_.max_area = std::max(report_.max_area, shape.area);
  }

  void add_edge(Index low, Index high, double length, bool boundary) {
    report_.min_edge = num_edges_ == 0 ? length : std::min(report_.min_edge, length);
    report_.max_edge = std::max(report_.max_edge, length);
    report_.mean_edge += length;
    ++num_edges_;
    for (const Index v : {low, high}) {
      ++degree_[detail::slot(v)];
      if (boundary) on_boundary_[detail::slot(v)] = 1;
    }
  }

  QualityReport finish() {
    finish_facets();
    if (num_edges_ > 0) report_.mean_edge /= static_cast<double>(num_edges_);
    Index good = 0;
    for (std::size_t v = 0; v < degree_.size(); ++v) {
      if (degree_[v] == 0 || on_boundary_[v] != 0) continue;
      ++report_.interior_vertices;
      ++report_.valence[std::min(static_cast<std::size_t>(degree_[v]), report_.valence.size() - 1)];
      good += degree_[v] >= 5 && degree_[v] <= 7;
    }
    if (report_.interior_vertices > 0) report_.valence_5_6_7 = 100.0 * good / report_.interior_vertices;
    return report_;
  }

 private:
  void finish_facets() {
    if (report_.triangles == 0) {
      report_.min_angle = 0;
      report_.min_q = 0;
      return;
    }
    const double n = report_.triangles;
    report_.mean_min_angle /= n;
    report_.mean_q /= n;
    report_.below_30 = 100 * below_30_ / n;
    report_.above_90 = 100 * above_90_ / n;
    report_.min_area = smallest_area_;
    report_.area_ratio = report_.max_area > 0 ? smallest_area_ / report_.max_area : 0;
  }

  QualityReport report_;
  double smallest_area_ = std::numeric_limits<double>::infinity();
  Index below_30_ = 0, above_90_ = 0;
  std::size_t num_edges_ = 0;
  std::vector<Index> degree_;
  std::vector<char> on_boundary_;
};

}  // namespace

void detail::scale_back(QualityReport& report, const MeshScale& scale) {
  for (double* length : {&report.min_edge, &report.max_edge, &report.mean_edge}) scale.back(*length);
}

QualityReport quality(const MeshView& mesh, const Execution& execution) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    QualityReport report = quality(scale.mesh(mesh), execution);
    detail::scale_back(report, scale);
    return report;
  }
  const Execution run = execution.start("measuring triangles");
  QualityMeasure measure(detail::slot(mesh.num_vertices()));
  std::vector<char> counted(detail::slot(mesh.num_facets()), 0);
  detail::Ticker facets(run.part(0, 0.6), counted.size(), detail::kEdgesPerLook);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    facets.tick();
    if (quality_skips(mesh.triangles, f)) continue;
    counted[detail::slot(f)] = 1;
    measure.add_facet(facet_shape(mesh.corner(f, 0), mesh.corner(f, 1), mesh.corner(f, 2)));
  }
  const detail::MeshEdges edges(mesh.triangles, mesh.num_vertices(), counted, run.part(0.6, 0.85));
  detail::Ticker ticker(run.part(0.85, 1), edges.size(), detail::kEdgesPerLook);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    ticker.tick();
    const detail::MeshEdge edge = edges[e];
    measure.add_edge(edge.low, edge.high, detail::norm(mesh.vertices[edge.low] - mesh.vertices[edge.high]), edge.boundary());
  }
  const QualityReport report = measure.finish();
  run.finish();
  return report;
}

detail::QualityOfParts detail::quality_of_parts(const MeshView& mesh, const MeshEdges& edges, const std::vector<char>& part,
                                                const Execution& run) {
  const std::size_t num_vertices = slot(mesh.num_vertices());
  QualityMeasure all(num_vertices);
  std::vector<QualityMeasure> parts(part.empty() ? 0 : 2, QualityMeasure(num_vertices));
  Ticker facets(run.part(0, 0.8), slot(mesh.num_facets()), kEdgesPerLook);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    facets.tick();
    const FacetShape shape = facet_shape(mesh.corner(f, 0), mesh.corner(f, 1), mesh.corner(f, 2));
    all.add_facet(shape);
    if (!part.empty()) parts[slot(part[slot(f)])].add_facet(shape);
  }
  Ticker ticker(run.part(0.8, 1), edges.size(), kEdgesPerLook);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    ticker.tick();
    const MeshEdge edge = edges[e];
    const double length = norm(mesh.vertices[edge.low] - mesh.vertices[edge.high]);
    all.add_edge(edge.low, edge.high, length, edge.boundary());
    std::size_t sides[2] = {0, 0};
    for (const EdgeSide& side : edge) {
      if (!part.empty()) ++sides[slot(part[slot(side.facet)])];
    }
    for (std::size_t k = 0; k < 2; ++k) {
      if (sides[k] > 0) parts[k].add_edge(edge.low, edge.high, length, sides[k] == 1);
    }
  }
  QualityOfParts result;
  result.all = all.finish();
  for (std::size_t k = 0; k < parts.size(); ++k) result.parts[k] = parts[k].finish();
  return result;
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
