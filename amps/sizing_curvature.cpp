// Curvature, and radii that bound the chord error. Rusinkiewicz, "Estimating curvatures and their derivatives on triangle
// meshes", 3DPVT 2004; vertex normals by Max, "Weights for computing vertex normals from facet normals", 1999 (exact on
// spheres). Where we differ: corners of facets are grouped into fans that creases, borders and non-manifold edges bound, and
// each fan has a normal and a curvature of its own.
#define AMPS_OWN_SOURCE
#include "amps/sizing.h"

#include "amps/mesh_edges.h"
#include "amps/portable_math.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace amps {
namespace {

using detail::dot;
using detail::for_each_index;
using detail::norm;
using detail::normalized;
using detail::slot;
using detail::squared_norm;
using detail::stable_normalized;

/// Symmetric 2 by 2: the second fundamental form in a frame of the tangent plane.
struct CurvatureTensor {
  double uu = 0, uv = 0, vv = 0;
  /// Greatest absolute eigenvalue.
  double greatest() const {
    const double mean = (uu + vv) / 2, half = (uu - vv) / 2;
    return std::abs(mean) + std::sqrt(half * half + uv * uv);
  }
};

struct TangentFrame {
  Vec3 u, v, normal;
};

TangentFrame frame_of(const Vec3& normal) {
  int axis = 0;
  normal.cwiseAbs().minCoeff(&axis);
  const Vec3 u = normalized(normal.cross(Vec3::Unit(axis)));
  return {u, normal.cross(u), normal};
}

/// The form over a facet, by least squares over its edges e: II·e = the change of the normal along e, both in the facet's
/// plane.
CurvatureTensor tensor_of(const TangentFrame& frame, const std::array<Vec3, 3>& corner, const std::array<Vec3, 3>& normal) {
  // Unknowns (uu, uv, vv); each edge (x, y) gives uu x + uv y = du and uv x + vv y = dv.
  double xx = 0, xy = 0, yy = 0, xu = 0, mixed = 0, yv = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3 e = corner[(k + 1) % 3] - corner[k], d = normal[(k + 1) % 3] - normal[k];
    const double x = dot(e, frame.u), y = dot(e, frame.v), du = dot(d, frame.u), dv = dot(d, frame.v);
    xx += x * x;
    xy += x * y;
    yy += y * y;
    xu += x * du;
    mixed += y * du + x * dv;
    yv += y * dv;
  }
  // Cramer's rule: the matrix of these columns is positive definite for a facet with area, and facets too thin for doubles are
  // left out by the caller.
  const Vec3 c0(xx, xy, 0), c1(xy, xx + yy, xy), c2(0, xy, yy), right(xu, mixed, yv);
  const double det = dot(c0, c1.cross(c2));
  return {dot(right, c1.cross(c2)) / det, dot(c0, right.cross(c2)) / det, dot(c0, c1.cross(right)) / det};
}

/// The form of a facet in another frame, turned about the line in which the planes meet.
CurvatureTensor turned(const CurvatureTensor& t, const TangentFrame& from, const TangentFrame& to) {
  const double cosine = dot(to.normal, from.normal);
  if (!(cosine > -0.9)) return {};
  const Vec3 axis = (to.normal + from.normal) / (1 + cosine);
  const Vec3 p = to.u - dot(to.u, from.normal) * axis, q = to.v - dot(to.v, from.normal) * axis;
  const double pu = dot(p, from.u), pv = dot(p, from.v), qu = dot(q, from.u), qv = dot(q, from.v);
  return {t.uu * pu * pu + 2 * t.uv * pu * pv + t.vv * pv * pv, t.uu * pu * qu + t.uv * (pu * qv + pv * qu) + t.vv * pv * qv,
          t.uu * qu * qu + 2 * t.uv * qu * qv + t.vv * qv * qv};
}

/// The parts of a triangle's area nearest to each corner (Meyer et al. 2003: half and quarters where an angle is obtuse).
std::array<double, 3> corner_areas(const std::array<Vec3, 3>& corner) {
  std::array<double, 3> square;  // of the side opposite to each corner
  for (std::size_t k = 0; k < 3; ++k) square[k] = squared_norm(corner[(k + 2) % 3] - corner[(k + 1) % 3]);
  const double area = norm((corner[1] - corner[0]).cross(corner[2] - corner[0])) / 2;
  for (std::size_t k = 0; k < 3; ++k) {
    if (square[k] <= square[(k + 1) % 3] + square[(k + 2) % 3]) continue;
    std::array<double, 3> result{area / 4, area / 4, area / 4};
    result[k] = area / 2;
    return result;
  }
  std::array<double, 3> result;
  for (std::size_t k = 0; k < 3; ++k) {
    // ⅛ Σ over the two sides at k of |side|²·cot(opposite angle), cot = (sum of the adjacent squares − the opposite)/(4·area).
    const double a = square[k], b = square[(k + 1) % 3], c = square[(k + 2) % 3];
    result[k] = area > 0 ? (b * (c + a - b) + c * (a + b - c)) / (32 * area) : 0;
  }
  return result;
}

/// A mesh whose corners are grouped into smooth fans.
class CurvatureEstimator {
 public:
  CurvatureEstimator(const MeshView& mesh, double crease_angle, const Execution& execution)
      : mesh_(merge_equal_vertices(mesh, execution.part(0, 0.15))), view_(mesh_) {
    crease_cosine_ = detail::portable_cosine(crease_angle);
    normals_ = facet_normals(view_, execution.part(0.15, 0.25));
    // To unit size: fourth powers of lengths must be doubles.
    const Box box = bounding_box(view_, execution.part(0.25, 0.3));
    scale_ = 1 / box.diagonal();
    group_corners(execution.part(0.3, 0.6));
    estimate_normals(execution.part(0.6, 0.8));
    estimate_tensors(execution.part(0.8, 1));
  }

  /// By facet corner: the greatest value at its vertex.
  std::vector<double> at_corners(const Execution& execution) const {
    std::vector<double> at_vertex(slot(view_.num_vertices()), 0.0), result(fan_.size());
    for_each_index(fan_.size(), execution.part(0, 0.7), [&](std::size_t c) {
      double& value = at_vertex[vertex_of(c)];
      const std::size_t fan = fan_[c];
      if (weights_[fan] > 0) value = std::max(value, tensors_[fan].greatest() / weights_[fan] * scale_);
    });
    for_each_index(fan_.size(), execution.part(0.7, 1), [&](std::size_t c) { result[c] = at_vertex[vertex_of(c)]; });
    return result;
  }

 private:
  std::size_t vertex_of(std::size_t corner) const {
    return slot(mesh_.triangles(static_cast<std::ptrdiff_t>(corner / 3), static_cast<int>(corner % 3)));
  }
  Vec3 normal_of_facet(std::size_t f) const { return normals_.row(static_cast<std::ptrdiff_t>(f)).transpose(); }
  std::array<Vec3, 3> corners_of(std::size_t f) const {
    std::array<Vec3, 3> result;
    for (int k = 0; k < 3; ++k) result[slot(k)] = scale_ * view_.corner(static_cast<Index>(f), k);
    return result;
  }

  /// The corners around a vertex, across smooth edges.
  void group_corners(const Execution& execution) {
    std::vector<char> counted(slot(view_.num_facets()));
    for_each_index(counted.size(), execution.part(0, 0.05),
                   [&](std::size_t f) { counted[f] = squared_norm(normal_of_facet(f)) > 0 ? 1 : 0; });
    const detail::MeshEdges edges(view_.triangles, view_.num_vertices(), counted, execution.part(0.05, 0.45));
    std::vector<char> sharp(edges.size(), 0), smooth_side(edges.num_corners(), 0);
    for_each_index(edges.size(), execution.part(0.45, 0.6), [&](std::size_t e) {
      const detail::MeshEdge edge = edges[e];
      const auto normal = [&](std::size_t i) { return normal_of_facet(slot(edge[i].facet)); };
      sharp[e] = edge.regular() && !(dot(normal(0), normal(1)) < crease_cosine_) ? 0 : 1;
      if (sharp[e] == 0) smooth_side[edge[0].corner()] = smooth_side[edge[1].corner()] = 1;
    });
    fan_ = detail::corner_fans(edges, sharp, execution.part(0.6, 0.9));
    number_fans(execution.part(0.9, 0.95));
    open_.assign(num_fans_, 0);
    for_each_index(fan_.size(), execution.part(0.95, 1), [&](std::size_t c) {
      if (smooth_side[c] != 0) return;
      open_[fan_[c]] = open_[fan_[detail::next_corner(c)]] = 1;
    });
  }

  /// From the first corner of each fan to numbers without holes: tables of fans are a sixth as large.
  void number_fans(const Execution& execution) {
    for_each_index(fan_.size(), execution, [this](std::size_t c) { fan_[c] = fan_[c] == c ? num_fans_++ : fan_[fan_[c]]; });
  }

  void estimate_normals(const Execution& execution) {
    fan_normals_.assign(num_fans_, Vec3::Zero());
    for_each_index(fan_.size(), execution.part(0, 0.5), [this](std::size_t c) {
      const auto corner = corners_of(c / 3);
      const Vec3 a = corner[(c + 1) % 3] - corner[c % 3], b = corner[(c + 2) % 3] - corner[c % 3];
      const double weight = squared_norm(a) * squared_norm(b);
      if (weight > 0) fan_normals_[fan_[c]] += a.cross(b) / weight;
    });
    for_each_index(num_fans_, execution.part(0.5, 0.6),
                   [this](std::size_t fan) { fan_normals_[fan] = stable_normalized(fan_normals_[fan]); });
    correct_open_fans(execution.part(0.6, 1));
  }

  /// The facets of an open fan all lie on one side of its vertex, and so does the place that has their mean normal. A facet's
  /// normal is about the mean of those at its corners: what the corners with closed fans leave is for the others.
  void correct_open_fans(const Execution& execution) {
    std::vector<Vec3> corrected(num_fans_, Vec3::Zero());
    for_each_index(fan_.size() / 3, execution.part(0, 0.8), [&](std::size_t f) {
      const auto corner = corners_of(f);
      const double weight = norm((corner[1] - corner[0]).cross(corner[2] - corner[0]));
      Vec3 left = 3 * normal_of_facet(f);
      int open = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t fan = fan_[3 * f + k];
        if (open_[fan] != 0) {
          ++open;
        } else {
          left -= fan_normals_[fan];
        }
      }
      for (std::size_t k = 0; k < 3; ++k) {
        if (open_[fan_[3 * f + k]] != 0) corrected[fan_[3 * f + k]] += weight / open * left;
      }
    });
    constexpr double kTrusted = 0.866;  // 30°: beyond, the facets are too coarse or uneven for this
    for_each_index(num_fans_, execution.part(0.8, 1), [&](std::size_t fan) {
      if (open_[fan] == 0 || !(detail::squared_norm(corrected[fan]) > 0)) return;
      const Vec3 n = stable_normalized(corrected[fan]);
      if (detail::dot(n, fan_normals_[fan]) > kTrusted) fan_normals_[fan] = n;
    });
  }

  void estimate_tensors(const Execution& execution) {
    constexpr double kThinnest = 1e-6;  // height over longest edge below which a facet's normal is noise
    tensors_.assign(num_fans_, {});
    weights_.assign(num_fans_, 0.0);
    for_each_index(fan_.size() / 3, execution, [this](std::size_t f) {
      const auto corner = corners_of(f);
      const Vec3 cross = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
      double longest = 0;
      for (std::size_t k = 0; k < 3; ++k) longest = std::max(longest, squared_norm(corner[(k + 1) % 3] - corner[k]));
      if (!(norm(cross) > kThinnest * longest)) return;
      const TangentFrame frame = frame_of(normalized(cross));
      const std::array<std::size_t, 3> fan{fan_[3 * f], fan_[3 * f + 1], fan_[3 * f + 2]};
      const CurvatureTensor tensor =
          tensor_of(frame, corner, {fan_normals_[fan[0]], fan_normals_[fan[1]], fan_normals_[fan[2]]});
      const auto weight = corner_areas(corner);
      for (std::size_t k = 0; k < 3; ++k) {
        const CurvatureTensor t = turned(tensor, frame, frame_of(fan_normals_[fan[k]]));
        tensors_[fan[k]].uu += weight[k] * t.uu;
        tensors_[fan[k]].uv += weight[k] * t.uv;
        tensors_[fan[k]].vv += weight[k] * t.vv;
        weights_[fan[k]] += weight[k];
      }
    });
  }

  Mesh mesh_;
  MeshView view_;
  Points normals_;
  double crease_cosine_ = 0;
  double scale_ = 1;
  std::vector<std::size_t> fan_;  ///< by corner: the number of its fan
  std::size_t num_fans_ = 0;
  std::vector<char> open_;  ///< by fan: it does not surround its vertex
  std::vector<Vec3> fan_normals_;
  std::vector<CurvatureTensor> tensors_;  ///< sums, to be divided by
  std::vector<double> weights_;
};

}  // namespace

std::vector<double> max_curvature(const MeshView& mesh, double crease_angle, const Execution& execution) {
  const Execution job = execution.start("measuring curvature");
  require_usable(mesh, job.part(0, 0.1));
  if (!(crease_angle >= 0 && crease_angle <= 180)) {
    throw Error(ErrorCode::kInvalidArgument, "curvature: the crease angle must lie in [0, 180] degrees");
  }
  const std::vector<double> at_corner =
      CurvatureEstimator(mesh, crease_angle, job.part(0.1, 0.9)).at_corners(job.part(0.9, 0.97));
  std::vector<double> result(slot(mesh.num_vertices()), 0.0);
  for_each_index(at_corner.size(), job.part(0.97, 1), [&](std::size_t c) {
    result[slot(mesh.triangles(static_cast<std::ptrdiff_t>(c / 3), static_cast<int>(c % 3)))] = at_corner[c];
  });
  job.finish();
  return result;
}

SizingField curvature_sizing(const MeshView& mesh, const CurvatureOptions& options, const Execution& execution) {
  const auto fail = [](const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "curvature sizing: " + what); };
  if (!(options.max_error > 0 && std::isfinite(options.max_error))) fail("max_error must be positive and finite");
  if (!(options.max_radius >= 0 && std::isfinite(options.max_radius))) fail("max_radius must be finite and not negative");
  const Execution job = execution.start("measuring curvature");
  std::vector<double> radii = max_curvature(mesh, options.crease_angle, job.part(0, 0.75));
  const double greatest = options.max_radius > 0 ? options.max_radius : bounding_box(mesh, job.part(0.75, 0.8)).diagonal();
  for_each_index(radii.size(), job.part(0.8, 0.83), [&](std::size_t v) {
    double& r = radii[v];
    const double curvature = r, error = options.max_error;
    if (!(curvature > 0)) {
      r = greatest;
      return;
    }
    // √(ε(2/κ − ε)) as √(εκ(2 − εκ))/κ.
    const double relative = error * curvature;
    const double wanted = relative < 1 ? std::sqrt(relative * (2 - relative)) / curvature : 1 / curvature;
    r = std::min(wanted, greatest);
  });
  return vertex_sizing(mesh, radii, job.part(0.83, 1));
}

}  // namespace amps
