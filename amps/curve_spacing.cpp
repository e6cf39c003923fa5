#define AMPS_OWN_SOURCE
#include "amps/curve_spacing.h"

#include <cmath>
#include <limits>
#include <utility>

namespace amps::detail {
namespace {

/// Of the lesser weight at a chord: what is left of it is the margin of its protection.
constexpr double kWeightInUse = 0.97;

}  // namespace

// Points of curves

SurfacePoint corner_point(const MeshView& mesh, const SurfaceEdges& edges, Index facet, Index vertex) {
  Vec3 barycentric = Vec3::Zero();
  for (int k = 0; k < 3; ++k) {
    if (edges.triangles()(facet, k) == vertex) barycentric[k] = 1;
  }
  return surface_point_at(mesh, facet, barycentric);
}

namespace {

/// The number of the curve's edge that holds the point at this parameter in [0, length].
std::size_t piece_at(const Curve& curve, double s) {
  const auto after = std::upper_bound(curve.arc.begin() + 1, curve.arc.end() - 1, s);
  return static_cast<std::size_t>(after - curve.arc.begin()) - 1;
}

}  // namespace

CurvePlace place_on_curve(const MeshView& mesh, const SurfaceEdges& edges, const Curve& curve, double s) {
  // So near to a vertex a point is at the vertex: rounding must not make another set of facets.
  constexpr double kAtVertex = 0x1p-50;
  const std::size_t piece = piece_at(curve, s);
  const double length = curve.arc[piece + 1] - curve.arc[piece];
  const double t = length > 0 ? std::min(1.0, std::max(0.0, (s - curve.arc[piece]) / length)) : 0;
  const MeshEdge edge = edges[curve.edges[piece]];
  const EdgeSide& side = edge[0];
  CurvePlace place;
  if (t < kAtVertex || t > 1 - kAtVertex) {
    place.vertex = curve.vertices[t < kAtVertex ? piece : piece + 1];
    place.at = corner_point(mesh, edges, side.facet, place.vertex);
    return place;
  }
  const double from_low = curve.vertices[piece] == edge.low ? t : 1 - t;
  Vec3 barycentric = Vec3::Zero();
  barycentric[static_cast<Eigen::Index>(side.low_corner() % 3)] = 1 - from_low;
  barycentric[static_cast<Eigen::Index>(side.high_corner() % 3)] = from_low;
  place.at = surface_point_at(mesh, side.facet, barycentric);
  place.edge = curve.edges[piece];
  return place;
}

// The radius along a curve

void RadiusTable::lower(double s, double radius) {
  const std::size_t k = interval(s);
  const Node &a = nodes_[k], &b = nodes_[k + 1];
  const double t = b.s > a.s ? (s - a.s) / (b.s - a.s) : s > a.s ? 1 : 0;
  Node node{s, radius, {}, {}};
  for (const std::size_t e : {std::size_t{0}, std::size_t{1}}) {
    node.of_wedge[e] = std::min(a.of_wedge[e], b.of_wedge[e]);
    node.to_corner[e] = between(a.to_corner[e], b.to_corner[e], t);
  }
  if (!(t > 0)) {
    nodes_[k].bound = std::min(nodes_[k].bound, radius);
  } else if (!(t < 1)) {
    nodes_[k + 1].bound = std::min(nodes_[k + 1].bound, radius);
  } else {
    nodes_.insert(nodes_.begin() + static_cast<std::ptrdiff_t>(k) + 1, node);
  }
}

void RadiusTable::update(const CurveRadii& radii, bool closed) {
  for (Node& node : nodes_) {
    node.radius = std::min(node.bound, radii.most);
    for (const std::size_t e : {std::size_t{0}, std::size_t{1}}) {
      if (node.to_corner[e] >= kWedgeStart * radii.ends[e]) node.radius = std::min(node.radius, node.of_wedge[e]);
    }
  }
  nodes_.front().radius = std::min(nodes_.front().radius, radii.ends[0]);
  nodes_.back().radius = std::min(nodes_.back().radius, radii.ends[1]);
  for (int round = 0; round < (closed ? 2 : 1); ++round) {
    if (closed) nodes_.front().radius = nodes_.back().radius = std::min(nodes_.front().radius, nodes_.back().radius);
    for (std::size_t k = 1; k < nodes_.size(); ++k) {
      const double step = nodes_[k].s - nodes_[k - 1].s;
      nodes_[k].radius = std::min(nodes_[k].radius, nodes_[k - 1].radius + kCurveGradation * step);
    }
    for (std::size_t k = nodes_.size() - 1; k-- > 0;) {
      const double step = nodes_[k + 1].s - nodes_[k].s;
      nodes_[k].radius = std::min(nodes_[k].radius, nodes_[k + 1].radius + kCurveGradation * step);
    }
  }
}

double RadiusTable::at(double s) const {
  const std::size_t k = interval(s);
  const Node &a = nodes_[k], &b = nodes_[k + 1];
  return b.s > a.s ? between(a.radius, b.radius, (s - a.s) / (b.s - a.s)) : std::min(a.radius, b.radius);
}

double RadiusTable::max() const {
  double most = 0;
  for (const Node& node : nodes_) most = std::max(most, node.radius);
  return most;
}

double RadiusTable::integral() const {
  double sum = 0;
  for (std::size_t k = 0; k + 1 < nodes_.size(); ++k) sum += integral(k);
  return sum;
}

std::vector<double> RadiusTable::cuts(int n) const {
  std::vector<double> places;
  const double share = integral() / n;
  double sum = 0, last = nodes_.front().s;
  for (std::size_t k = 0; k + 1 < nodes_.size(); ++k) {
    const double here = integral(k);
    while (static_cast<int>(places.size()) < n - 1) {
      const double next = share * static_cast<double>(places.size() + 1);
      if (next >= sum + here) break;
      const double s = between(nodes_[k].s, nodes_[k + 1].s, (next - sum) / here);
      if (!(s > last)) break;
      places.push_back(s);
      last = s;
    }
    sum += here;
  }
  while (!places.empty() && !(places.back() < nodes_.back().s)) places.pop_back();
  return places;
}

// Spacing

namespace {

/// No sample in the other's disk, whatever rounding does to the distance; protected, with a margin.
bool may_be_neighbours(const CurveStop& p, const CurveStop& q, double squared_distance) {
  constexpr double kBelowRounding = 1 - 0x1p-50;  // as in radius_below()
  const double a = p.radius * p.radius, b = q.radius * q.radius;
  const double most = std::max(a, b) + kWeightInUse * std::min(a, b);
  return std::max(a, b) <= squared_distance * kBelowRounding && squared_distance <= most;
}

}  // namespace

/// The farthest that the curve's vertices between two of its points are from the line through these.
double CurveTask::sagitta(const CurveStop& p, const CurveStop& q) const {
  const Vec3 u = q.position - p.position;
  const double length = norm(u);
  const std::size_t n = curve.edges.size();
  double farthest = 0;
  std::size_t k = piece_at(curve, wrapped(p.s)) + 1;
  for (double turns = p.s - wrapped(p.s);;) {  // lengths of the curve that are behind
    if (k > n) {
      if (!curve.closed) break;
      turns += curve.length();
      k = 1;
    }
    if (curve.arc[k] + turns >= q.s) break;
    const Vec3 x = mesh.vertices[curve.vertices[k]] - p.position;
    farthest = std::max(farthest, length > 0 ? norm(x.cross(u)) / length : norm(x));
    ++k;
  }
  return farthest;
}

bool is_surely_kept(const CurveTask& task, const CurveStop& p, const CurveStop& q) {
  const double d2 = squared_norm(q.position - p.position);
  const double reach = 1.15 * std::max(p.radius, q.radius);
  const double slack = p.radius * p.radius + q.radius * q.radius - d2;
  const double width = 4 * std::sqrt(std::max(0.0, reach * reach - d2 / 4));
  const double arc = q.s - p.s;
  // No curve of this length is farther from its chord than an ellipse with the ends for foci.
  if (width * std::sqrt(std::max(0.0, arc * arc - d2)) / 2 <= slack) return true;
  return width * task.sagitta(p, q) <= slack;
}

/// Stops per radius: a chord has some six to choose from.
constexpr double kStopsPerRadius = 16;
namespace {

/// Appends stops where a chord from `end` would have a length that it may have, where the radius there is much less than that
/// of the end: that window is narrow. `sign`: the way along the curve.
void add_window(const CurveTask& task, const CurveStop& end, double sign, double way, Rng& rng, std::vector<CurveStop>& stops) {
  constexpr double kMuchLess = 0.8;
  constexpr int kStopsOfWindow = 12, kHalvings = 40;
  const double step = end.radius / kStopsPerRadius;
  const auto squared = [&](const CurveStop& q) { return squared_norm(q.position - end.position); };
  // The least way from `from` on, up to rounding, at which a condition that the end does not fulfil comes to hold.
  const auto first_where = [&](double from, const auto& holds) {
    double low = from, high = from;
    while (!holds(task.stop(end.s + sign * high))) {
      if (high >= way) return std::numeric_limits<double>::infinity();
      low = high;
      high = std::min(way, high + step);
    }
    for (int k = 0; k < kHalvings && low < high; ++k) {
      const double middle = low + (high - low) / 2;
      (holds(task.stop(end.s + sign * middle)) ? high : low) = middle;
    }
    return high;
  };
  const double begin = first_where(0, [&](const CurveStop& q) { return squared(q) > end.radius * end.radius; });
  if (std::isinf(begin) || task.stop(end.s + sign * begin).radius > kMuchLess * end.radius) return;
  double last = first_where(
      begin, [&](const CurveStop& q) { return squared(q) > end.radius * end.radius + kWeightInUse * q.radius * q.radius; });
  last = std::min(last, way);
  for (int k = 0; k < kStopsOfWindow; ++k) {
    const double at = begin + (last - begin) * (k + rng.uniform()) / kStopsOfWindow;
    if (at > 0 && at < way) stops.push_back(task.stop(end.s + sign * at));
  }
}

/// Places along the curve from one to another, ends included.
std::vector<CurveStop> stops_between(const CurveTask& task, const CurveStop& first, const CurveStop& last, Rng& rng) {
  std::vector<CurveStop> stops = {first};
  const double step_at_end = 1 / kStopsPerRadius;
  CurveStop at = first;
  at.radius = std::min(at.radius, task.table.at(task.wrapped(first.s)));
  for (double share = rng.uniform();; share = 1) {
    const double s = at.s + std::max(share, 0x1p-10) * step_at_end * at.radius;
    if (!(s < last.s) || s == at.s) break;
    at = task.stop(s);
    stops.push_back(at);
  }
  add_window(task, first, 1, last.s - first.s, rng, stops);
  add_window(task, last, -1, last.s - first.s, rng, stops);
  std::stable_sort(stops.begin(), stops.end(), [](const CurveStop& a, const CurveStop& b) { return a.s < b.s; });
  const auto not_ascending = [](const CurveStop& a, const CurveStop& b) { return !(a.s < b.s); };
  stops.erase(std::unique(stops.begin(), stops.end(), not_ascending), stops.end());
  while (!(stops.back().s < last.s)) stops.pop_back();
  stops.push_back(last);
  return stops;
}

/// visit(q) for the stops that a chord from stop p may go to.
template <class Visit>
void for_each_next(const std::vector<CurveStop>& stops, std::size_t p, const Visit& visit) {
  const CurveStop& from = stops[p];
  const std::size_t last = stops.size() - 1;
  const auto squared = [&](std::size_t q) { return squared_norm(stops[q].position - from.position); };
  const double begin = from.s + from.radius * (1 - 0x1p-30), end = from.s + kLongestWay * from.radius;
  const auto first = std::lower_bound(stops.begin() + static_cast<std::ptrdiff_t>(p) + 1, stops.end() - 1, begin,
                                      [](const CurveStop& stop, double s) { return stop.s < s; });
  for (std::size_t q = static_cast<std::size_t>(first - stops.begin()); q < last && stops[q].s <= end; ++q) {
    const double d2 = squared(q);
    const double most = from.radius + kCurveGradation * (stops[q].s - from.s);  // of all radii to come within this way
    if (d2 > from.radius * from.radius + most * most) break;
    if (may_be_neighbours(from, stops[q], d2)) visit(q);
  }
  // The end may have a far greater radius.
  const double way = stops[last].s - from.s;
  if (p < last && way <= kLongestWay * std::max(from.radius, stops[last].radius) &&
      may_be_neighbours(from, stops[last], squared(last))) {
    visit(last);
  }
}

/// Of each stop, into how many pieces the rest of the curve can be cut at most, or kManyPieces if more; −1: it cannot. Pieces
/// are those that allowed(p, q) holds of.
constexpr signed char kManyPieces = 3;
template <class Allowed>
std::vector<signed char> most_pieces(const std::vector<CurveStop>& stops, const Allowed& allowed) {
  std::vector<signed char> most(stops.size(), -1);
  most.back() = 0;
  for (std::size_t p = stops.size() - 1; p-- > 0;) {
    for_each_next(stops, p, [&](std::size_t q) {
      if (most[q] < 0 || most[p] > most[q] || !allowed(p, q)) return;
      most[p] = std::max(most[p], static_cast<signed char>(std::min<int>(kManyPieces, most[q] + 1)));
    });
  }
  return most;
}

}  // namespace

Spacing space_between(const CurveTask& task, const CurveStop& first, const CurveStop& last, int least_pieces, Rng& rng) {
  Spacing result;
  const double d2 = squared_norm(last.position - first.position);
  if (least_pieces <= 1 && may_be_neighbours(first, last, d2) && is_surely_kept(task, first, last)) {
    result.done = true;
    result.samples = {first, last};
    return result;
  }
  const std::vector<CurveStop> stops = stops_between(task, first, last, rng);
  // Along chords that are surely kept if there is such a way, else along any.
  std::vector<signed char> most =
      most_pieces(stops, [&](std::size_t p, std::size_t q) { return is_surely_kept(task, stops[p], stops[q]); });
  if (most[0] < least_pieces) most = most_pieces(stops, [](std::size_t, std::size_t) { return true; });
  if (most[0] < least_pieces) {
    std::size_t reached = 0;
    while (reached + 1 < stops.size() && most[reached] < 0) ++reached;
    result.stuck_at = stops[reached].s;
    return result;
  }
  std::vector<std::size_t> choice, kept;
  result.samples.push_back(first);
  for (std::size_t p = 0; p + 1 < stops.size();) {
    choice.clear();
    for_each_next(stops, p, [&](std::size_t q) {
      if (most[q] >= 0 && most[q] >= least_pieces - 1) choice.push_back(q);
    });
    kept.clear();
    for (const std::size_t q : choice) {
      if (is_surely_kept(task, stops[p], stops[q])) kept.push_back(q);
    }
    if (!kept.empty()) choice.swap(kept);
    // The end has no width among the stops, so it would hardly ever be chosen, and what is left then is short.
    p = choice.back() + 1 == stops.size() ? choice.back() : choice[static_cast<std::size_t>(rng.below(choice.size()))];
    --least_pieces;
    result.samples.push_back(stops[p]);
  }
  result.done = true;
  return result;
}

Spacing space_by_sections(const CurveTask& task, const CurveStop& first, const CurveStop& last, int least_pieces, Rng& rng,
                          const Execution& run) {
  constexpr double kRadiiOfSection = 500, kLeastRadii = 20;
  const int sections = static_cast<int>(std::ceil(task.table.integral() / kRadiiOfSection));
  if (sections < 2) return space_between(task, first, last, least_pieces, rng);
  std::vector<double> cuts = task.table.cuts(sections);
  for (double& s : cuts) {
    s += (rng.uniform() - 0.5) * kLeastRadii / 2 * task.table.at(s);
    if (s < first.s) s += task.curve.length();  // of a closed curve: those behind the start come last
  }
  std::sort(cuts.begin(), cuts.end());
  Spacing result;
  result.samples.push_back(first);
  cuts.push_back(last.s);
  for (std::size_t k = 0; k < cuts.size(); ++k) {
    run.check();
    const bool is_last = k + 1 == cuts.size();
    const CurveStop from = result.samples.back();
    const CurveStop to = is_last ? last : task.stop(cuts[k]);
    if (!is_last && std::min(to.s - from.s, last.s - to.s) < kLeastRadii * to.radius) continue;  // too short a section
    const Spacing section = space_between(task, from, to, 1, rng);
    if (!section.done) return section;
    result.samples.insert(result.samples.end(), section.samples.begin() + 1, section.samples.end());
  }
  result.done = true;
  return result;
}

}  // namespace amps::detail
