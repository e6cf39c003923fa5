#define AMPS_OWN_SOURCE
#include "amps/fit.h"

#include "amps/fit_system.h"
#include "amps/mesh_edges.h"
#include "amps/portable_math.h"
#include "amps/self_intersections.h"
#include "amps/surface_tree.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <locale>
#include <memory>
#include <ostream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace amps {
namespace detail {
namespace {

/// How far offsets are kept from what samples alone ask for, in shares of the samples' weight. Normal offsets need it only
/// where samples say nothing. In free fits it decides how triangles deform: offsets of neighbours that differ are dear at
/// first, or bounds on triangles would stop most of them; each round that brings something asks for less of it.
constexpr FitRegularisation kNormalRegularisation = {1e-3, 0, 0};
constexpr FitRegularisation kFreeRegularisation = {1e-3, 1e-2, 0.05};
constexpr FitRegularisation kCurveRegularisation = {1e-3, 1e-3, 0};
constexpr double kRelaxation = 0.3;   ///< after a round that brought something
constexpr double kStiffening = 4;     ///< after one that did not
constexpr int kFreeRounds = 8;        ///< further ones bring some 0.5 % each
constexpr double kLeastGain = 0.005;  ///< of the residual, for a further round
constexpr int kIterations = 12;       ///< of conjugate gradients: 1e-3 of the residual are mostly left after 6 to 10
constexpr int kCurveIterations = 100;

/// No offset is longer in one round, in mean edges: beyond, a surface is not its tangent plane.
constexpr double kLongestMove = 0.5;
/// Offsets shorter than this are rounding, where the greatest coordinate is about 1.
constexpr double kNoMove = 1e-12;
/// Cosine of the greatest angle that a triangle may turn by.
constexpr double kCosineOfTurn = 0.5;

using FitCorners = std::array<Vec3, 3>;

Vec3 area_vector(const FitCorners& x) { return (x[1] - x[0]).cross(x[2] - x[0]); }

/// Cosines of the smallest and the largest angle of a triangle that has an area.
struct AngleCosines {
  double of_smallest = -1, of_largest = 1;
};

AngleCosines angle_cosines(const FitCorners& x) {
  AngleCosines result;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3 a = x[(k + 1) % 3] - x[k], b = x[(k + 2) % 3] - x[k];
    const double cosine = dot(a, b) / std::sqrt(squared_norm(a) * squared_norm(b));
    result.of_smallest = std::max(result.of_smallest, cosine);
    result.of_largest = std::min(result.of_largest, cosine);
  }
  return result;
}

/// Triangles by the vertices they have.
using FitTriangles = std::vector<std::array<Index, 3>>;

FitCorners corners_at(const FitTriangles& triangles, const std::vector<Vec3>& at, std::size_t f) {
  const std::array<Index, 3>& t = triangles[f];
  return {at[slot(t[0])], at[slot(t[1])], at[slot(t[2])]};
}

/// The bounds that triangles keep: those asked for or, of what is beyond them at the start, what it is there.
class FitBounds {
 public:
  /// Lengths of `options` times `scale` are those of `start`.
  FitBounds(const FitTriangles& triangles, const std::vector<Vec3>& start, const FitOptions& options, double scale,
            const Execution& run)
      : triangles_(triangles), start_(start), min_edge2_(std::numeric_limits<double>::infinity()) {
    for_each_index(triangles.size(), run, [&](std::size_t f) {
      const FitCorners x = corners_at(triangles_, start_, f);
      if (!(squared_norm(area_vector(x)) > 0)) return;
      const AngleCosines angles = angle_cosines(x);
      angles_.of_smallest = std::max(angles_.of_smallest, angles.of_smallest);
      angles_.of_largest = std::min(angles_.of_largest, angles.of_largest);
      for (std::size_t k = 0; k < 3; ++k) {
        const double length2 = squared_norm(x[(k + 1) % 3] - x[k]);
        min_edge2_ = std::min(min_edge2_, length2);
        max_edge2_ = std::max(max_edge2_, length2);
      }
    });
    // Measured by other formulas, a bound that is just met would be missed by rounding.
    constexpr double kMargin = 1e-12;
    const auto square_of = [scale](double length) { return (length * scale) * (length * scale); };
    if (options.min_angle > 0) angles_.of_smallest = portable_cosine(options.min_angle) - kMargin;
    if (options.max_angle > 0) angles_.of_largest = portable_cosine(options.max_angle) + kMargin;
    if (options.min_edge > 0) min_edge2_ = square_of(options.min_edge) * (1 + kMargin);
    if (options.max_edge > 0) max_edge2_ = square_of(options.max_edge) * (1 - kMargin);
  }

  /// Whether the corners of a triangle may be there. Never, for a triangle without area at the start.
  bool hold(const std::vector<Vec3>& at, std::size_t f) const {
    const FitCorners x = corners_at(triangles_, at, f), first = corners_at(triangles_, start_, f);
    const Vec3 now = area_vector(x), before = area_vector(first);
    const double product = std::sqrt(squared_norm(now) * squared_norm(before));
    if (!(product > 0 && dot(now, before) >= kCosineOfTurn * product)) return false;
    const AngleCosines angles = angle_cosines(x);
    if (angles.of_smallest > angles_.of_smallest || angles.of_largest < angles_.of_largest) {
      const AngleCosines allowed = angle_cosines(first);
      if (angles.of_smallest > std::max(angles_.of_smallest, allowed.of_smallest)) return false;
      if (angles.of_largest < std::min(angles_.of_largest, allowed.of_largest)) return false;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const double length2 = squared_norm(x[(k + 1) % 3] - x[k]);
      if (length2 >= min_edge2_ && length2 <= max_edge2_) continue;
      const double allowed = squared_norm(first[(k + 1) % 3] - first[k]);
      if (length2 < std::min(min_edge2_, allowed) || length2 > std::max(max_edge2_, allowed)) return false;
    }
    return true;
  }

 private:
  const FitTriangles& triangles_;
  const std::vector<Vec3>& start_;
  AngleCosines angles_;
  double min_edge2_, max_edge2_ = 0;
};

/// How much of its way a vertex goes, by how often a bound held it back. What lies across its normal is given up first, since
/// it brings less.
struct FitShare {
  double normal, tangential;
};
constexpr std::array<FitShare, 12> kFitShares = {
    {{1, 1}, {1, 0.6}, {1, 0.36}, {1, 0.2}, {1, 0}, {0.7, 0}, {0.5, 0}, {0.35, 0}, {0.25, 0}, {0.15, 0}, {0.07, 0}, {0, 0}}};
constexpr std::uint8_t kNormalOnly = 4;  ///< the first share without a tangential part
constexpr std::uint8_t kStays = kFitShares.size() - 1u;

/// Points of the input, each for as much of its area.
struct InputPoints {
  Points positions;
  std::vector<Index> facets;
  double area = 0;  ///< of each
};

/// In the order of facets, so that points that follow each other are near each other; within facets as Roberts' sequence has
/// them, which covers large ones evenly.
InputPoints points_of_input(const MeshView& mesh, double area_a_point, const Execution& run) {
  const std::vector<double> areas = facet_areas(mesh, run.part(0, 0.2));
  double total = 0;
  for (const double area : areas) total += area;
  constexpr double kMostPoints = 3e7;  // 1 GB
  InputPoints points;
  points.area = std::max(area_a_point, total / kMostPoints);
  std::vector<double> numbers;
  // 1/g and 1/g² for g³ = g + 1 (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
  constexpr double kFirst = 0.7548776662466927, kSecond = 0.5698402909980532;
  double passed = 0, next = points.area / 2, u = 0.5, w = 0.5;
  Ticker ticker(run.part(0.2, 1), areas.size() + static_cast<std::uint64_t>(total / points.area), kElementsPerLook);
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    ticker.tick();
    passed += areas[slot(f)];
    for (; next < passed; next += points.area) {
      ticker.tick();
      u += u + kFirst < 1 ? kFirst : kFirst - 1;
      w += w + kSecond < 1 ? kSecond : kSecond - 1;
      const bool outside = u + w > 1;
      const double b = outside ? 1 - u : u, c = outside ? 1 - w : w;
      const Vec3 x = (1 - b - c) * mesh.corner(f, 0) + b * mesh.corner(f, 1) + c * mesh.corner(f, 2);
      numbers.insert(numbers.end(), {x[0], x[1], x[2]});
      points.facets.push_back(f);
    }
  }
  points.positions = Points(std::move(numbers));
  return points;
}

/// A point of the mesh (on one of its triangles) and one of the input, one being the nearest to the other.
struct FitPair {
  Vec3 on_mesh, on_input;
  double distance;
  Vec3 weight;
};

/// The nearest points of the surface. `hints` (in and out): the facets found for the same points when they, or the surface,
/// were elsewhere; empty at first.
std::vector<SurfaceHit> nearest_again(const SurfaceTree& tree, const Points& points, std::vector<Index>& hints,
                                      const Execution& run) {
  std::vector<SurfaceHit> hits;
  if (hints.empty()) {
    hits = tree.nearest_all(points, run);
    hints.resize(hits.size());
  } else {
    hits.resize(hints.size());
    parallel_for(hits.size(), kFitGrain, run, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        hits[i] = tree.nearest(points.row(static_cast<std::ptrdiff_t>(i)).transpose(), hints[i]);
      }
    });
  }
  for (std::size_t i = 0; i < hits.size(); ++i) hints[i] = hits[i].point.facet;
  return hits;
}

/// `tiny`: below it, the direction of a distance is rounding, and `normal` is that of the surface.
FitSample fit_sample_of(const FitPair& pair, const Vec3& normal, double tiny, double mass) {
  FitSample sample;
  sample.weight = pair.weight;
  const Vec3 difference = pair.on_mesh - pair.on_input;
  sample.direction = pair.distance > tiny ? Vec3(difference / pair.distance) : normal;
  sample.offset = dot(sample.direction, difference);
  sample.mass = mass;
  return sample;
}

/// The power of two that brings all coordinates below 1: no square overflows or is lost, and results are the same bits at any
/// such scale.
double scale_to_one(const MeshView& input, const MeshView& mesh, const Execution& run) {
  double largest = 0;
  for (const MeshView* const m : {&input, &mesh}) {
    for_each_index(m->num_vertices(), run, [&](Index v) { largest = std::max(largest, m->vertices[v].cwiseAbs().maxCoeff()); });
  }
  int exponent = 0;
  std::frexp(largest, &exponent);
  return std::ldexp(1.0, -std::clamp(exponent, -1022, 1022));
}

Points scaled_points(const PointsView& points, double scale, const Execution& run) {
  Points result(points.rows());
  for_each_index(points.rows(), run, [&](std::ptrdiff_t i) { result.row(i) = (scale * points[i]).transpose(); });
  return result;
}

std::vector<Vec3> points_as_vectors(const PointsView& points, const Execution& run) {
  std::vector<Vec3> result(static_cast<std::size_t>(points.rows()));
  for_each_index(points.rows(), run, [&](std::ptrdiff_t i) { result[static_cast<std::size_t>(i)] = points[i]; });
  return result;
}

/// The triangles of the surface that a mesh is, by surface vertices (SurfaceEdges).
FitTriangles surface_triangles(const SurfaceEdges& surface, const Execution& run) {
  FitTriangles result;
  const Triangles& triangles = surface.triangles();
  for_each_index(surface.num_facets(), run, [&](Index f) {
    if (surface.counts(f)) result.push_back({triangles(f, 0), triangles(f, 1), triangles(f, 2)});
  });
  return result;
}

/// The curves that vertices of the mesh follow, and those of the input.
struct FitCurves {
  std::vector<std::array<Index, 2>> edges;  ///< of the mesh, ascending, each once
  std::vector<char> fixed;                  ///< by vertex: it stays
  std::vector<char> on_curve;               ///< by vertex: it follows nothing but curves
  Mesh input;                               ///< edges as facets without area
};

/// `first`: the surface vertex of each vertex of the mesh. `input_vertices`: as the result is to have them.
FitCurves curves_to_fit(const MeshView& input, const Points& input_vertices, const SurfaceEdges& surface,
                        const std::vector<Index>& first, const FitOptions& options, const Execution& run) {
  FitCurves curves;
  const std::size_t n = first.size();
  curves.fixed.assign(n, 0);
  curves.on_curve.assign(n, 0);
  for (const Index v : options.fixed) curves.fixed[slot(first[slot(v)])] = 1;
  const auto add = [&](Index a, Index b, bool follow) {
    curves.on_curve[slot(a)] = curves.on_curve[slot(b)] = 1;
    if (follow) curves.edges.push_back({std::min(a, b), std::max(a, b)});
  };
  const bool input_known = !options.input_curve_edges.empty();
  for (const auto& edge : options.curve_edges) add(first[slot(edge[0])], first[slot(edge[1])], input_known);
  // At an edge of three sheets that is no curve it is not clear where to go.
  for_each_index(surface.size(), run.part(0, 0.1), [&](std::size_t e) {
    const MeshEdge edge = surface[e];
    if (edge.size() != 2) add(edge.low, edge.high, edge.boundary());
  });
  std::sort(curves.edges.begin(), curves.edges.end());
  curves.edges.erase(std::unique(curves.edges.begin(), curves.edges.end()), curves.edges.end());

  const SurfaceEdges input_surface(input, run.part(0.1, 0.8));
  std::vector<std::array<Index, 2>> input_edges = options.input_curve_edges;
  for_each_index(input_surface.size(), run.part(0.8, 0.9), [&](std::size_t e) {
    const MeshEdge edge = input_surface[e];
    if (edge.boundary()) input_edges.push_back({edge.low, edge.high});
  });
  if (input_edges.empty()) curves.edges.clear();
  curves.input.triangles.resize(static_cast<std::ptrdiff_t>(input_edges.size()));
  for (std::size_t e = 0; e < input_edges.size(); ++e) {
    curves.input.triangles.row(static_cast<std::ptrdiff_t>(e)) << input_edges[e][0], input_edges[e][1], input_edges[e][1];
  }
  if (!input_edges.empty()) curves.input.vertices = input_vertices;

  std::vector<int> degree(n, 0);
  for (const auto& edge : curves.edges) {
    for (const Index v : edge) ++degree[slot(v)];
  }
  for_each_index(n, run.part(0.9, 1), [&](std::size_t v) {
    if (curves.on_curve[v] != 0 && degree[v] != 2) curves.fixed[v] = 1;
  });
  return curves;
}

/// A mesh on its way to a surface.
class VertexFit {
 public:
  /// Takes about a third of `run`.
  VertexFit(const MeshView& input, const MeshView& mesh, const FitOptions& options, const Execution& run);

  /// `mesh`: the one of the constructor.
  Points fit(const MeshView& mesh, FitReport& report);

 private:
  /// How far the mesh is from the surface.
  struct Residual {
    double mean_square = 0;           ///< what rounds lower
    double max = 0;                   ///< of all distances
    std::vector<double> of_triangle;  ///< sums of squares, by mass
  };

  void compute_normals();
  void orient(const Execution& run);
  FitSamples take_samples(Residual& residual, const Execution& run);
  void sample_input(std::vector<FitSample>& samples, std::vector<Index>& triangle, std::vector<double>& square,
                    const Execution& run);
  Mesh mesh_now() const;
  bool avoid_intersections(const Execution& run);
  FitCorners corners(std::size_t f) const { return corners_at(triangles_, at_, f); }
  /// Whether a point of a triangle and one of the input, where the normal is that, lie on sheets of opposed normals.
  bool opposed(std::size_t f, const Vec3& area, const Vec3& normal) const { return sense_[f] * dot(area, normal) < 0; }
  std::vector<Vec3> moves_of(const FitSamples& samples, const Execution& run) const;
  void move_curves(std::vector<Vec3>& moves, const Execution& run) const;
  FitSamples sample_curves(const FitTriangles& edges, const Execution& run) const;
  std::vector<Vec3> within_bounds(const std::vector<Vec3>& moves, std::vector<std::uint8_t>& shares) const;
  bool go(const std::vector<Vec3>& moves, std::vector<std::uint8_t>& shares, Residual& residual, FitSamples& samples,
          const Execution& run);
  std::vector<std::uint8_t> without_worse(const Residual& before, const Residual& after) const;

  Fit fit_;
  Execution run_;
  double scale_;
  Points input_vertices_;
  MeshView input_;
  SurfaceEdges surface_;
  std::vector<Index> first_;  ///< the surface vertex of each vertex
  FitTriangles triangles_;
  std::vector<Vec3> start_, at_;  ///< positions by vertex; of surface vertices, the others stay
  FitElements elements_;
  FitBounds bounds_;
  FitCurves curves_;
  SurfaceTree tree_;
  std::unique_ptr<const SurfaceTree> curve_tree_;
  std::vector<Vec3> normals_;        ///< by vertex
  std::vector<Vec3> input_normals_;  ///< by facet
  std::vector<std::int8_t> sense_;  ///< by triangle: −1 where the input has the opposite orientation, 0 where it is not clear
  double length_ = 0;               ///< of an edge, in the mean
  InputPoints input_points_;        ///< for free fits
  std::vector<Index> hints_, input_hints_;  ///< what the points of triangles and those of the input came to
  double stiffness_ = 1;                    ///< of the regularisation
  std::vector<char> held_back_;             ///< by vertex
};

VertexFit::VertexFit(const MeshView& input, const MeshView& mesh, const FitOptions& options, const Execution& run)
    : fit_(options.fit),
      run_(run),
      scale_(scale_to_one(input, mesh, run.part(0, 0.01))),
      input_vertices_(scaled_points(input.vertices, scale_, run.part(0.01, 0.02))),
      input_(input_vertices_, input.triangles),
      surface_(mesh, run.part(0.02, 0.06)),
      first_(first_equal_vertices(mesh, run.part(0.06, 0.07))),
      triangles_(surface_triangles(surface_, run.part(0.07, 0.08))),
      start_(points_as_vectors(scaled_points(mesh.vertices, scale_, run.part(0.08, 0.085)), run.part(0.085, 0.09))),
      at_(start_),
      elements_(triangles_, start_.size(), run.part(0.09, 0.12)),
      bounds_(triangles_, start_, options, scale_, run.part(0.12, 0.14)),
      curves_(curves_to_fit(input, input_vertices_, surface_, first_, options, run.part(0.14, 0.18))),
      tree_(input_, run.part(0.18, 0.26)),
      input_normals_(points_as_vectors(facet_normals(input_, run.part(0.26, 0.265)), run.part(0.265, 0.27))),
      held_back_(start_.size(), 0) {
  if (!curves_.edges.empty()) curve_tree_ = std::make_unique<const SurfaceTree>(curves_.input, run.part(0.27, 0.28));
  const double sum = ordered_sum(triangles_.size(), run, [&](std::size_t f) {
    const FitCorners x = corners(f);
    return norm(x[1] - x[0]) + norm(x[2] - x[1]) + norm(x[0] - x[2]);
  });
  length_ = sum / static_cast<double>(3 * std::max(std::size_t{1}, triangles_.size()));
  compute_normals();
  orient(run.part(0.28, 0.3));
  // Seven points of the input a triangle: more bring nothing.
  constexpr double kSpacing = 0.35;
  const double spacing = kSpacing * length_;
  if (fit_ == Fit::kFree && spacing > 0) input_points_ = points_of_input(input_, spacing * spacing, run.part(0.3, 0.33));
}

/// Weights that make them exact on spheres (Max, "Weights for computing vertex normals from facet normals", 1999).
void VertexFit::compute_normals() {
  normals_.assign(at_.size(), Vec3::Zero());
  parallel_for(at_.size(), kFitGrain, run_, [&](std::size_t begin, std::size_t end) {
    for (std::size_t v = begin; v < end; ++v) {
      Vec3 sum = Vec3::Zero();
      for (std::size_t i = elements_.first_corner(v); i < elements_.first_corner(v + 1); ++i) {
        const std::size_t k = elements_.corner(i) % 3;
        const FitCorners x = corners(elements_.corner(i) / 3);
        const Vec3 a = x[(k + 1) % 3] - x[k], b = x[(k + 2) % 3] - x[k];
        const double squares = squared_norm(a) * squared_norm(b);
        if (squares > 0) sum += a.cross(b) / squares;
      }
      const double length = norm(sum);
      if (length > 0) normals_[v] = sum / length;
    }
  });
}

/// Facets of the input may be flipped; where two of a triangle's corners lie, they say what is right there.
void VertexFit::orient(const Execution& run) {
  const std::vector<SurfaceHit> hits = tree_.nearest_all(PointsView(start_), run.part(0, 0.9));
  const auto sense_at = [&](Index v) {
    const double along = dot(input_normals_[slot(hits[slot(v)].point.facet)], normals_[slot(v)]);
    return (along > 0) - (along < 0);
  };
  sense_.assign(triangles_.size(), 0);
  for_each_index(triangles_.size(), run.part(0.9, 1), [&](std::size_t f) {
    const std::array<Index, 3>& t = triangles_[f];
    const int sum = sense_at(t[0]) + sense_at(t[1]) + sense_at(t[2]);
    sense_[f] = static_cast<std::int8_t>((sum > 0) - (sum < 0));
  });
}

/// Three points a triangle with the nearest ones of the input; in free fits points of the input with the nearest ones of the
/// mesh as well, which see what no triangle comes near.
FitSamples VertexFit::take_samples(Residual& residual, const Execution& run) {
  constexpr std::size_t kRule = 3;  // exact for squares
  constexpr double kNear = 1.0 / 6, kFar = 2.0 / 3;
  const std::size_t n = triangles_.size();
  Points positions(static_cast<std::ptrdiff_t>(kRule * n));
  parallel_for(n, kFitGrain, run, [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      const FitCorners x = corners(f);
      for (std::size_t q = 0; q < kRule; ++q) {
        positions.row(static_cast<std::ptrdiff_t>(kRule * f + q)) =
            (kFar * x[q] + kNear * x[(q + 1) % 3] + kNear * x[(q + 2) % 3]).transpose();
      }
    }
  });
  const std::vector<SurfaceHit> hits = nearest_again(tree_, positions, hints_, run.part(0, fit_ == Fit::kFree ? 0.4 : 1));
  std::vector<FitSample> of_input;
  std::vector<Index> triangle_of_input;
  std::vector<double> square_of_input;
  if (fit_ == Fit::kFree) sample_input(of_input, triangle_of_input, square_of_input, run.part(0.4, 1));

  FitSamples result;
  result.first.assign(n + 1, 0);
  for (const Index f : triangle_of_input) ++result.first[slot(f) + 1];
  for (std::size_t f = 0; f < n; ++f) result.first[f + 1] += result.first[f] + kRule;
  result.samples.resize(result.first[n]);
  residual = {};
  residual.of_triangle.assign(n, 0.0);
  std::vector<double> areas(n, 0.0);
  parallel_for(n, kFitGrain, run, [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      const Vec3 area = area_vector(corners(f)) / 2;
      areas[f] = norm(area);
      for (std::size_t q = 0; q < kRule; ++q) {
        const SurfaceHit& hit = hits[kRule * f + q];
        residual.of_triangle[f] += areas[f] / kRule * hit.distance * hit.distance;
        if (!(areas[f] > 0) || opposed(f, area, input_normals_[slot(hit.point.facet)])) continue;
        FitPair pair{positions.row(static_cast<std::ptrdiff_t>(kRule * f + q)).transpose(), hit.point.position, hit.distance,
                     Vec3(kNear, kNear, kNear)};
        pair.weight[static_cast<int>(q)] = kFar;
        result.samples[result.first[f] + q] = fit_sample_of(pair, area / areas[f], kNoMove, areas[f] / kRule);
      }
    }
  });
  const double area = ordered_sum(n, run, [&](std::size_t f) { return areas[f]; });
  const double squares = ordered_sum(n, run, [&](std::size_t f) { return residual.of_triangle[f]; });
  residual.mean_square = area > 0 ? squares / area : 0;
  for (const SurfaceHit& hit : hits) residual.max = std::max(residual.max, hit.distance);
  if (of_input.empty()) return result;

  std::vector<std::size_t> next(result.first.begin(), result.first.end() - 1);
  for (std::size_t i = 0; i < of_input.size(); ++i) {
    const std::size_t f = slot(triangle_of_input[i]);
    result.samples[next[f]++ + kRule] = of_input[i];
    residual.of_triangle[f] += input_points_.area * square_of_input[i];
    residual.max = std::max(residual.max, std::sqrt(square_of_input[i]));
  }
  const double sum = ordered_sum(of_input.size(), run, [&](std::size_t i) { return square_of_input[i]; });
  residual.mean_square = (residual.mean_square + sum / static_cast<double>(of_input.size())) / 2;
  return result;
}

/// The points of the input: samples, their triangles and squared distances.
void VertexFit::sample_input(std::vector<FitSample>& samples, std::vector<Index>& triangle, std::vector<double>& square,
                             const Execution& run) {
  const SurfaceTree tree(mesh_now(), run.part(0, 0.2));
  const std::vector<SurfaceHit> hits = nearest_again(tree, input_points_.positions, input_hints_, run.part(0.2, 1));
  samples.resize(hits.size());
  triangle.resize(hits.size());
  square.resize(hits.size());
  parallel_for(hits.size(), kFitGrain, run, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const SurfaceHit& hit = hits[i];
      triangle[i] = hit.point.facet;
      square[i] = hit.distance * hit.distance;
      const Vec3 area = area_vector(corners(slot(hit.point.facet)));
      const Vec3& normal = input_normals_[slot(input_points_.facets[i])];
      if (!(squared_norm(area) > 0) || opposed(slot(hit.point.facet), area, normal)) continue;
      const FitPair pair{hit.point.position, input_points_.positions.row(static_cast<std::ptrdiff_t>(i)).transpose(),
                         hit.distance, hit.point.barycentric};
      samples[i] = fit_sample_of(pair, normal, kNoMove, input_points_.area);
    }
  });
}

/// Two points an edge with the nearest ones of the input's curves, in two directions across the edge.
FitSamples VertexFit::sample_curves(const FitTriangles& edges, const Execution& run) const {
  const double near = (1 - 1 / std::sqrt(3.0)) / 2;  // Gauss
  const std::array<double, 2> places = {near, 1 - near};
  Points positions(static_cast<std::ptrdiff_t>(2 * edges.size()));
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const Vec3 &a = at_[slot(edges[e][0])], &b = at_[slot(edges[e][1])];
    for (std::size_t q = 0; q < 2; ++q) {
      positions.row(static_cast<std::ptrdiff_t>(2 * e + q)) = ((1 - places[q]) * a + places[q] * b).transpose();
    }
  }
  const std::vector<SurfaceHit> hits = curve_tree_->nearest_all(positions, run);
  FitSamples result;
  result.first.push_back(0);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const Vec3 along = at_[slot(edges[e][1])] - at_[slot(edges[e][0])];
    const double length = norm(along);
    for (std::size_t q = 0; q < 2; ++q) {
      const SurfaceHit& hit = hits[2 * e + q];
      const Index c = hit.point.facet;
      const Vec3 tangent = MeshView(curves_.input).corner(c, 1) - MeshView(curves_.input).corner(c, 0);
      // Another curve, or one that the edge does not follow.
      constexpr double kLeastCosine = 0.5;
      if (!(std::abs(dot(tangent, along)) > kLeastCosine * norm(tangent) * length)) continue;
      int least = 0;
      along.cwiseAbs().minCoeff(&least);
      const Vec3 first = normalized(along.cross(Vec3(Vec3::Unit(least))));
      const Vec3 second = along.cross(first) / length;
      const Vec3 x = positions.row(static_cast<std::ptrdiff_t>(2 * e + q)).transpose();
      for (const Vec3& direction : {first, second}) {
        FitSample sample;
        sample.weight = Vec3(1 - places[q], places[q], 0);
        sample.direction = direction;
        sample.offset = dot(direction, x - hit.point.position);
        sample.mass = length / 2;
        result.samples.push_back(sample);
      }
    }
    result.first.push_back(result.samples.size());
  }
  return result;
}

void VertexFit::move_curves(std::vector<Vec3>& moves, const Execution& run) const {
  if (curves_.edges.empty()) return;
  FitTriangles edges;
  for (const auto& edge : curves_.edges) edges.push_back({edge[0], edge[1], edge[1]});
  const FitSamples samples = sample_curves(edges, run.part(0, 0.5));
  std::vector<char> unknown(at_.size(), 0);
  for (const auto& edge : curves_.edges) {
    for (const Index v : edge) unknown[slot(v)] = curves_.fixed[slot(v)] == 0 ? 1 : 0;
  }
  const FitElements elements(std::move(edges), at_.size(), run.part(0.5, 1));
  FitSystem<3>(elements, unknown, normals_, run_).solve(samples, kCurveRegularisation, kCurveIterations, moves);
}

/// Where vertices are to go: along curves first, then all others with those on curves given.
std::vector<Vec3> VertexFit::moves_of(const FitSamples& samples, const Execution& run) const {
  std::vector<Vec3> moves(at_.size(), Vec3::Zero());
  move_curves(moves, run.part(0, 0.5));
  std::vector<char> unknown(at_.size(), 0);
  for (std::size_t v = 0; v < unknown.size(); ++v) {
    const bool used = elements_.first_corner(v) < elements_.first_corner(v + 1);
    unknown[v] = used && curves_.fixed[v] == 0 && curves_.on_curve[v] == 0 ? 1 : 0;
  }
  if (fit_ == Fit::kNormal) {
    FitSystem<1>(elements_, unknown, normals_, run_).solve(samples, kNormalRegularisation, kIterations, moves);
  } else {
    FitRegularisation regularisation = kFreeRegularisation;
    regularisation.edges *= stiffness_;
    FitSystem<3>(elements_, unknown, normals_, run_).solve(samples, regularisation, kIterations, moves);
  }
  const double longest = kLongestMove * length_;
  for (Vec3& move : moves) {
    const double length = norm(move);
    if (length > longest) move *= longest / length;
    if (!(length > kNoMove)) move = Vec3::Zero();
  }
  return moves;
}

/// Where vertices come to if they go so far that every triangle is within its bounds. `shares` (in and out) by vertex, places
/// in kFitShares. Ends, since shares only fall, and with no vertex moving all is as it was, within bounds.
std::vector<Vec3> VertexFit::within_bounds(const std::vector<Vec3>& moves, std::vector<std::uint8_t>& shares) const {
  const std::size_t n = at_.size();
  std::vector<Vec3> across(n, Vec3::Zero()), next(n);
  const auto place = [&](std::size_t v) {
    const FitShare& share = kFitShares[shares[v]];
    if (shares[v] == kStays) return at_[v];
    return Vec3(at_[v] + share.normal * (moves[v] - across[v]) + share.tangential * across[v]);
  };
  // Below it, giving up what lies across changes no bound.
  const double least_across = 1e-3 * length_;
  for (std::size_t v = 0; v < n; ++v) {
    const Vec3 tangential = moves[v] - dot(moves[v], normals_[v]) * normals_[v];
    if (fit_ == Fit::kFree && curves_.on_curve[v] == 0 && norm(tangential) > least_across) across[v] = tangential;
    next[v] = place(v);
  }
  std::vector<std::size_t> look(triangles_.size()), again, back;
  for (std::size_t f = 0; f < look.size(); ++f) look[f] = f;
  std::vector<char> fails(triangles_.size(), 0), listed(triangles_.size(), 0), listed_vertex(n, 0);
  while (!look.empty()) {
    parallel_for(look.size(), kFitGrain, run_, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) fails[look[i]] = bounds_.hold(next, look[i]) ? 0 : 1;
    });
    back.clear();
    for (const std::size_t f : look) {
      listed[f] = 0;
      if (fails[f] == 0) continue;
      for (const Index v : triangles_[f]) {
        if (shares[slot(v)] == kStays || listed_vertex[slot(v)] != 0 || moves[slot(v)] == Vec3::Zero()) continue;
        listed_vertex[slot(v)] = 1;
        back.push_back(slot(v));
      }
    }
    again.clear();
    for (const std::size_t v : back) {
      listed_vertex[v] = 0;
      ++shares[v];
      if (across[v] == Vec3::Zero()) shares[v] = std::max<std::uint8_t>(shares[v], kNormalOnly + 1);
      next[v] = place(v);
      for (std::size_t i = elements_.first_corner(v); i < elements_.first_corner(v + 1); ++i) {
        const std::size_t f = elements_.corner(i) / 3;
        if (listed[f] != 0) continue;
        listed[f] = 1;
        again.push_back(f);
      }
    }
    std::swap(look, again);
  }
  return next;
}

/// Goes there, if that lowers the residual. `residual` and `samples` (in and out) are those of where the mesh is; if it does
/// not go, `residual.of_triangle` is that of where it would have come.
bool VertexFit::go(const std::vector<Vec3>& moves, std::vector<std::uint8_t>& shares, Residual& residual, FitSamples& samples,
                   const Execution& run) {
  std::vector<Vec3> there = within_bounds(moves, shares);
  std::swap(at_, there);
  Residual after;
  FitSamples taken = take_samples(after, run);
  if (!(after.mean_square < residual.mean_square)) {
    std::swap(at_, there);
    residual.of_triangle = std::move(after.of_triangle);
    return false;
  }
  for (std::size_t v = 0; v < shares.size(); ++v) {
    if (shares[v] > 0) held_back_[v] = 1;
  }
  residual = std::move(after);
  samples = std::move(taken);
  return true;
}

/// Shares that keep those vertices where they are whose triangles would come farther from the surface.
std::vector<std::uint8_t> VertexFit::without_worse(const Residual& before, const Residual& after) const {
  std::vector<std::uint8_t> shares(at_.size(), 0);
  for (std::size_t v = 0; v < shares.size(); ++v) {
    double change = 0;
    for (std::size_t i = elements_.first_corner(v); i < elements_.first_corner(v + 1); ++i) {
      const std::size_t f = elements_.corner(i) / 3;
      change += after.of_triangle[f] - before.of_triangle[f];
    }
    if (change > 0) shares[v] = kStays;
  }
  return shares;
}

Mesh VertexFit::mesh_now() const {
  Mesh mesh{Points(static_cast<std::ptrdiff_t>(at_.size())), Triangles(static_cast<std::ptrdiff_t>(triangles_.size()))};
  for (std::size_t v = 0; v < at_.size(); ++v) mesh.vertices.row(static_cast<std::ptrdiff_t>(v)) = at_[v].transpose();
  for (std::size_t f = 0; f < triangles_.size(); ++f) {
    mesh.triangles.row(static_cast<std::ptrdiff_t>(f)) << triangles_[f][0], triangles_[f][1], triangles_[f][2];
  }
  return mesh;
}

/// Puts vertices back to where they were at the start until no triangles intersect that did not then, and bounds hold. Whether
/// any were. Ends, since with all of them back that is so.
bool VertexFit::avoid_intersections(const Execution& run) {
  SelfIntersectionOptions options;
  options.max_pairs = std::numeric_limits<Index>::max();
  const auto pairs_now = [&](double from, double to) {
    options.execution = run.part(from, to);
    return find_self_intersections(mesh_now(), options).pairs;
  };
  double done = 0.3;
  std::vector<SelfIntersection> now = pairs_now(0, done), before, more;
  if (now.empty()) return false;
  std::vector<Vec3> fitted = start_;
  std::swap(at_, fitted);
  before = pairs_now(done, 2 * done);
  std::swap(at_, fitted);
  done *= 2;
  std::vector<std::size_t> facets, again;
  bool any = false;
  const auto put_back = [&](std::size_t f) {
    for (const Index v : triangles_[f]) {
      if (at_[slot(v)] == start_[slot(v)]) continue;
      any = true;
      at_[slot(v)] = start_[slot(v)];
      held_back_[slot(v)] = 1;
      for (std::size_t i = elements_.first_corner(slot(v)); i < elements_.first_corner(slot(v) + 1); ++i) {
        again.push_back(elements_.corner(i) / 3);
      }
    }
  };
  for (;;) {
    more.clear();
    std::set_difference(now.begin(), now.end(), before.begin(), before.end(), std::back_inserter(more));
    if (more.empty()) return any;
    for (const SelfIntersection& pair : more) {
      put_back(slot(pair.a));
      put_back(slot(pair.b));
    }
    while (!again.empty()) {
      std::swap(facets, again);
      again.clear();
      run.check();
      for (const std::size_t f : facets) {
        if (!bounds_.hold(at_, f)) put_back(f);
      }
    }
    now = pairs_now(done, done + (1 - done) / 2);
    done += (1 - done) / 2;
  }
}

Points VertexFit::fit(const MeshView& mesh, FitReport& report) {
  Residual residual;
  FitSamples samples = take_samples(residual, run_.part(0.33, 0.4));
  report.rms_before = std::sqrt(residual.mean_square) / scale_;
  report.max_before = residual.max / scale_;
  const int rounds = fit_ == Fit::kNormal ? 1 : kFreeRounds;
  constexpr double kFitted = 0.85;
  const Residual at_start = residual;
  double done = 0.4;
  for (int round = 0; round < rounds; ++round) {
    constexpr double kShareOfRest = 0.4;  // each round may be the last
    const double until = fit_ == Fit::kNormal ? kFitted : done + kShareOfRest * (kFitted - done);
    const Execution run = run_.part(done, until);
    done = until;
    const std::vector<Vec3> moves = moves_of(samples, run.part(0, 0.3));
    const Residual before = residual;
    std::vector<std::uint8_t> shares(at_.size(), 0);
    bool gone = go(moves, shares, residual, samples, run.part(0.3, 0.65));
    if (!gone) {
      shares = without_worse(before, residual);
      gone = go(moves, shares, residual, samples, run.part(0.65, 1));
    }
    if (!gone) {
      residual = before;
      stiffness_ *= kStiffening;
      continue;
    }
    ++report.rounds;
    stiffness_ *= kRelaxation;
    if (residual.mean_square > (1 - 2 * kLeastGain) * before.mean_square) break;
    if (round + 1 < rounds) compute_normals();
  }
  if (report.rounds > 0 && avoid_intersections(run_.part(kFitted, 0.95))) {
    take_samples(residual, run_.part(0.95, 1));
    if (residual.mean_square > at_start.mean_square) {
      at_ = start_;
      residual = at_start;
    }
  }
  report.rms_after = std::sqrt(residual.mean_square) / scale_;
  report.max_after = residual.max / scale_;
  Points result(static_cast<std::ptrdiff_t>(at_.size()));
  for (std::size_t i = 0; i < at_.size(); ++i) {
    const std::size_t v = slot(first_[i]);
    const auto row = static_cast<std::ptrdiff_t>(i);
    const bool moved = at_[v] != start_[v];
    result.row(row) = (moved ? Vec3(at_[v] / scale_) : mesh.vertices[row]).transpose();
    report.moved += moved ? 1 : 0;
    report.held_back += held_back_[v] != 0 ? 1 : 0;
  }
  return result;
}

[[noreturn]] void refuse_fit(const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "fit: " + what); }

void require_fit_vertices(const char* what, Index vertex, Index num_vertices) {
  if (vertex >= 0 && vertex < num_vertices) return;
  refuse_fit(std::string(what) + " has vertex " + std::to_string(vertex) + ", and there are " + std::to_string(num_vertices));
}

void require_fit_options(const MeshView& input, const MeshView& mesh, const FitOptions& options) {
  constexpr double kEquilateral = 60;
  if (!(options.min_angle >= 0 && options.min_angle <= kEquilateral)) {
    refuse_fit("min_angle is " + number_text(options.min_angle) + " degrees; give one in [0, 60]");
  }
  if (!(options.max_angle == 0 || (options.max_angle >= kEquilateral && options.max_angle <= 180))) {
    refuse_fit("max_angle is " + number_text(options.max_angle) + " degrees; give 0 or one in [60, 180]");
  }
  for (const double length : {options.min_edge, options.max_edge}) {
    if (!(length >= 0)) refuse_fit("a bound of edges is " + number_text(length) + "; give 0 or a length");
  }
  if (options.max_edge > 0 && options.min_edge > options.max_edge) {
    refuse_fit("min_edge is " + number_text(options.min_edge) + ", above max_edge, " + number_text(options.max_edge));
  }
  for (const Index v : options.fixed) require_fit_vertices("fixed", v, mesh.num_vertices());
  for (const auto& edge : options.curve_edges) {
    for (const Index v : edge) require_fit_vertices("curve_edges", v, mesh.num_vertices());
  }
  for (const auto& edge : options.input_curve_edges) {
    for (const Index v : edge) require_fit_vertices("input_curve_edges", v, input.num_vertices());
  }
}

}  // namespace
}  // namespace detail

const char* name_of(Fit fit) noexcept {
  switch (fit) {
    case Fit::kOff:
      return "none";
    case Fit::kNormal:
      return "normal";
    case Fit::kFree:
      return "free";
  }
  return "unknown";
}

Points fit_vertices(const MeshView& input, const MeshView& mesh, const FitOptions& options, FitReport* report) {
  const Execution job = options.execution.start("fitting vertices");
  detail::Stopwatch watch;
  detail::require_fit_options(input, mesh, options);
  constexpr double kChecks = 0.02;
  require_usable(input, job.part(0, kChecks / 2));
  require_usable(mesh, job.part(kChecks / 2, kChecks));
  const Execution run = job.part(kChecks, 1);
  FitReport result;
  Points vertices;
  if (options.fit == Fit::kOff) {
    vertices = detail::scaled_points(mesh.vertices, 1, run);
  } else {
    vertices = detail::VertexFit(input, mesh, options, run).fit(mesh, result);
  }
  result.seconds = watch.lap();
  if (report != nullptr) *report = result;
  job.finish();
  return vertices;
}

std::ostream& operator<<(std::ostream& out, const FitReport& report) {
  std::ostringstream text;  // neither the caller's format nor its locale
  text.imbue(std::locale::classic());
  text.precision(6);
  text << "RMS       " << report.rms_before << " -> " << report.rms_after << "\n";
  text << "farthest  " << report.max_before << " -> " << report.max_after << "\n";
  text << "vertices  " << report.moved << " moved, " << report.held_back << " held back by bounds\n";
  return out << text.str();
}

}  // namespace amps
