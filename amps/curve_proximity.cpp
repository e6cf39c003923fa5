#define AMPS_OWN_SOURCE
#include "amps/curve_proximity.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace amps::detail {

namespace {

/// Another curve that shares a corner does not count where it is at this share of the distance to the corner or more: from 53°
/// on. Two samples just outside of the corner's disk are apart from 60° on; what is between is for the look at conflicts.
constexpr double kOpenWedge = 0.8;
/// A curve is no neighbour of itself where the way along it is at most so many times the distance.
constexpr double kMaxBend = 2;

}  // namespace

CurveProximity::CurveProximity(const CurveGraph& graph, const SurfaceFlood& flood, const Execution& run)
    : graph_(graph), flood_(flood), segments_(slot(graph.num_patches)), scratch_(run) {
  Ticker ticker(run, flood.edges().size(), kEdgesPerLook);
  for (std::size_t c = 0; c < graph.curves.size(); ++c) {
    const Curve& curve = graph.curves[c];
    for (std::size_t k = 0; k < curve.edges.size(); ++k) {
      ticker.tick();
      patches_.clear();
      for (const EdgeSide& side : flood.edges()[curve.edges[k]]) patches_.push_back(graph.patch_of_facet[slot(side.facet)]);
      std::sort(patches_.begin(), patches_.end());
      patches_.erase(std::unique(patches_.begin(), patches_.end()), patches_.end());
      for (const Index patch : patches_) {
        if (patch != kNone) segments_[slot(patch)].push_back({static_cast<Index>(c), static_cast<Index>(k)});
      }
    }
  }
  trees_.reserve(segments_.size());
  std::vector<BoxItem> items;
  for (const auto& of_patch : segments_) {
    items.clear();
    for (const Segment& segment : of_patch) {
      const Vec3 a = end(segment, 0), b = end(segment, 1);
      items.push_back({a.cwiseMin(b), a.cwiseMax(b)});
    }
    ticker.tick(items.size());
    trees_.emplace_back(items);
  }
}

/// Does a point of the curve count as another place of it, seen from s?
bool CurveProximity::is_far_along(Index curve, double s, double parameter, double distance) const {
  const Curve& of = graph_.curves[slot(curve)];
  double way = std::abs(parameter - s);
  if (of.closed || of.first_corner == of.last_corner) way = std::min(way, of.length() - way);
  constexpr double kRounding = 0x1p-40;  // of lengths along the curve, and of coordinates
  const double size = of.length() + flood_.position(of.vertices.front()).lpNorm<Eigen::Infinity>();
  return way > kMaxBend * distance + kRounding * size;
}

/// How a point of an edge at this distance bounds the radius at x, which is at s on the curve.
int CurveProximity::kind_of(Index curve, double s, const Vec3& x, const Segment& segment, double parameter,
                            double distance) const {
  const Curve& mine = graph_.curves[slot(curve)];
  const Curve& other = graph_.curves[slot(segment.curve)];
  const bool same = segment.curve == curve;
  if (same && !is_far_along(curve, s, parameter, distance)) return kDoesNotCount;
  if (mine.closed || (same && mine.first_corner != mine.last_corner)) return kPlain;
  int kind = kPlain;
  double nearest = std::numeric_limits<double>::infinity();
  for (const int k : {0, 1}) {
    const Index corner = k == 0 ? mine.first_corner : mine.last_corner;
    if (corner != other.first_corner && corner != other.last_corner) continue;
    const double to_corner = norm(x - flood_.position(graph_.corners[slot(corner)]));
    // Both ends at one corner: the one that is nearer along the curve.
    if (to_corner < nearest || (to_corner == nearest && s > mine.length() / 2)) kind = k;
    nearest = std::min(nearest, to_corner);
  }
  return kind != kPlain && distance >= kOpenWedge * nearest * (1 - 0x1p-30) ? kDoesNotCount : kind;
}

/// candidates_: the edges of the patches at the point that are nearer than `bound` and that count, nearest first.
template <class Kind>
void CurveProximity::collect(const PlacedPoint& at, double bound, const Kind& kind) {
  candidates_.clear();
  patches_.clear();
  for (const Index f : at.homes) patches_.push_back(graph_.patch_of_facet[slot(f)]);
  std::sort(patches_.begin(), patches_.end());
  patches_.erase(std::unique(patches_.begin(), patches_.end()), patches_.end());
  const Vec3& x = at.position;
  for (const Index patch : patches_) {
    if (patch == kNone) continue;
    trees_[slot(patch)].search(x, 1, bound, [&](Index i, double&) {
      const Segment& segment = segments_[slot(patch)][slot(i)];
      const Vec3 a = end(segment, 0), u = end(segment, 1) - a;
      const double length = squared_norm(u);
      const double t = length > 0 ? std::min(1.0, std::max(0.0, dot(x - a, u) / length)) : 0;
      const Vec3 point = a + t * u;
      const double distance = norm(x - point);
      if (distance >= bound) return;
      const auto& arc = graph_.curves[slot(segment.curve)].arc;
      const double parameter = arc[slot(segment.piece)] + t * (arc[slot(segment.piece) + 1] - arc[slot(segment.piece)]);
      const int wedge = kind(segment, parameter, distance);
      if (wedge != kDoesNotCount) candidates_.push_back({distance, segment, point, wedge});
    });
  }
  std::sort(candidates_.begin(), candidates_.end(), [](const Candidate& a, const Candidate& b) {
    if (a.distance != b.distance) return a.distance < b.distance;
    return std::make_pair(a.segment.curve, a.segment.piece) < std::make_pair(b.segment.curve, b.segment.piece);
  });
}

/// What the candidates leave, of those that a flood gets to.
Clearance CurveProximity::reached(const PlacedPoint& at, double bound) {
  // A flood is sought for so many candidates that are not reached at their distance; the next is taken to be reached.
  constexpr int kMaxDetours = 16;
  constexpr double kAboveRounding = 1 + 0x1p-40;
  Clearance result;
  bool flooded = false;
  int detours = 0;
  PlacedPoint target;
  for (const Candidate& candidate : candidates_) {
    double& least = candidate.wedge == kPlain ? result.of_others : result.of_wedge[static_cast<std::size_t>(candidate.wedge)];
    if (candidate.distance >= result.of_others) break;
    if (candidate.distance >= least) continue;
    target.position = candidate.point;
    target.homes = flood_.homes_of_edge(graph_.curves[slot(candidate.segment.curve)].edges[slot(candidate.segment.piece)]);
    const double enough = candidate.distance * kAboveRounding;
    if (flood_.holds(at, enough * enough, target, scratch_) || detours >= kMaxDetours) {
      least = candidate.distance;
      continue;
    }
    if (!flooded) flood_.flood(at.position, bound * bound, at.homes, scratch_, facets_);
    flooded = true;
    const auto is_reached = [&](Index f) { return std::binary_search(facets_.begin(), facets_.end(), f); };
    if (std::none_of(target.homes.begin(), target.homes.end(), is_reached)) continue;
    ++detours;
    least = std::min(least, flood_.bottleneck(at, target, bound, scratch_));
  }
  return result;
}

Clearance CurveProximity::of_curve(Index curve, double s, const PlacedPoint& at, double bound) {
  collect(at, bound, [&](const Segment& segment, double parameter, double distance) {
    return kind_of(curve, s, at.position, segment, parameter, distance);
  });
  return reached(at, bound);
}

double CurveProximity::of_corner(Index corner, const PlacedPoint& at, double bound) {
  collect(at, bound, [&](const Segment& segment, double parameter, double distance) {
    const Curve& other = graph_.curves[slot(segment.curve)];
    const bool first = other.first_corner == corner && !is_far_along(segment.curve, 0, parameter, distance);
    const bool last = other.last_corner == corner && !is_far_along(segment.curve, other.length(), parameter, distance);
    return first || last ? kDoesNotCount : kPlain;
  });
  return reached(at, bound).of_others;
}

}  // namespace amps::detail
