#define AMPS_OWN_SOURCE
#include "amps/curves.h"

#include "amps/mesh_edges.h"
#include "amps/portable_math.h"
#include "amps/sizing_lattice.h"
#include "amps/thread_pool.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

namespace amps {
namespace detail {
namespace {

constexpr double kConfirmedShare = 0.75;  // of the threshold, for averaged normals
constexpr double kThinFacet = 1e-3;       // height over r below which a facet's own normal is noise
constexpr int kThinSteps = 64;            // thin facets in a row
constexpr std::size_t kFacetsPerAverage = 512;
constexpr double kShortCurve = 12;  // in r: chains that end freely, and components
constexpr double kShortLoop = 3;    // in r: smooth loops
/// Mean length, in r, of the curves of a component: below it is a web. All machined parts of the tests have 4.3 and more, webs
/// on scans and figures of few facets 3.3 and less.
constexpr double kShortMeanCurve = 4;
constexpr double kSmoothTurn = 65;  // degrees, at each vertex of a smooth loop
constexpr double kSharpTurn = 60;   // degrees from edge to edge: a corner always
constexpr double kCornerTurn = 45;  // degrees, over kTurnReach · r
constexpr double kTurnReach = 0.25;

/// Cosine of the angle between two directions, at any scale; 1 where one has no length.
double cosine_between(const Vec3& a, const Vec3& b) {
  return a.isZero(0) || b.isZero(0) ? 1 : dot(stable_normalized(a), stable_normalized(b));
}

class CurveFinder {
 public:
  CurveFinder(const MeshView& mesh, const SurfaceEdges& edges, const std::vector<std::size_t>& fans,
              const CurveOptions& options, const Execution& run)
      : mesh_(mesh), edges_(edges), corner_fans_(fans), options_(options), run_(run) {}

  CurveGraph find() {
    curve_.assign(edges_.size(), 0);
    fixed_.assign(edges_.size(), 0);
    kind_.assign(edges_.size(), CurveKind::kMarked);
    measure_edges();
    mark_fixed();
    if (options_.creases) {
      find_normals();
      mark_candidates();
      candidate_ = curve_;
      if (has_radius()) confirm();
    }
    list_edges();
    if (options_.creases && has_radius()) {
      while (drop_dangling()) list_edges();
      drop_components();
      list_edges();
    }
    find_corners();
    walk_all();
    if (options_.creases && has_radius() && drop_webs()) {
      graph_.corners.clear();
      graph_.curves.clear();
      list_edges();
      find_corners();
      walk_all();
    }
    find_patches();
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (!candidate_.empty() && candidate_[e] && !curve_[e]) graph_.dropped.push_back(e);
    }
    graph_.is_curve_edge = std::move(curve_);
    return std::move(graph_);
  }

 private:
  bool has_radius() const { return options_.radius > 0 || !options_.sizing.empty(); }
  Vec3 at(Index v) const { return mesh_.vertices[v]; }
  Index other(std::size_t e, Index v) const { return edges_[e].low == v ? edges_[e].high : edges_[e].low; }

  void measure_edges() {
    length_.resize(edges_.size());
    radius_.assign(edges_.size(), options_.radius);
    for_each_index_on_all_threads(edges_.size(), run_.part(0, 0.1), [this](std::size_t e) {
      const MeshEdge edge = edges_[e];
      length_[e] = std::sqrt(squared_norm(at(edge.high) - at(edge.low)));
      if (options_.sizing.empty()) return;
      radius_[e] = 0;
      for (const EdgeSide& side : edge) {
        Vec3 middle(0.5, 0.5, 0.5);
        middle[(side.k + 2) % 3] = 0;
        radius_[e] = std::max(radius_[e], options_.sizing.radius(side.facet, middle));
      }
    });
  }

  std::size_t find_edge(Index a, Index b) const {
    if (a > b) std::swap(a, b);
    std::size_t from = 0, to = edges_.size();
    while (from < to) {
      const std::size_t middle = from + (to - from) / 2;
      const MeshEdge edge = edges_[middle];
      if (edge.low < a || (edge.low == a && edge.high < b)) {
        from = middle + 1;
      } else {
        to = middle;
      }
    }
    return from < edges_.size() && edges_[from].low == a && edges_[from].high == b ? from : edges_.size();
  }

  void mark_fixed() {
    if (!options_.edges.empty() || !options_.vertices.empty()) first_ = first_equal_vertices(mesh_, run_.part(0.1, 0.15));
    for_each_index_on_all_threads(edges_.size(), run_.part(0.15, 0.2), [this](std::size_t e) {
      const MeshEdge edge = edges_[e];
      bool fixed = options_.borders && edge.size() != 2;
      if (fixed) kind_[e] = edge.boundary() ? CurveKind::kBorder : CurveKind::kManySheets;
      for (std::size_t i = 1; i < edge.size() && !options_.labels.empty(); ++i) {
        if (options_.labels[slot(edge[i].facet)] == options_.labels[slot(edge[0].facet)]) continue;
        fixed = true;
        kind_[e] = std::min(kind_[e], CurveKind::kLabels);
      }
      fixed_[e] = curve_[e] = fixed;
    });
    for (const auto& pair : options_.edges) {
      const std::size_t e = find_edge(first_[slot(pair[0])], first_[slot(pair[1])]);
      if (e == edges_.size()) {
        throw Error(ErrorCode::kInvalidArgument, "find_curves: vertices " + std::to_string(pair[0]) + " and " +
                                                     std::to_string(pair[1]) + " are marked as an edge, but share none");
      }
      fixed_[e] = curve_[e] = 1;
    }
  }

  /// +1 where the facets of an edge of two go round alike, −1 otherwise.
  static double alignment(const MeshEdge& edge) { return edge[0].forward != edge[1].forward ? 1 : -1; }

  void find_normals() {
    const auto n = static_cast<std::size_t>(edges_.num_facets());
    std::vector<Vec3> own(n, Vec3::Zero());
    std::vector<std::size_t> longest(n, edges_.size());
    std::vector<char> thin(n, 0);
    area_.assign(n, 0);
    for_each_index_on_all_threads(n, run_.part(0.2, 0.25), [&](std::size_t facet) {
      const auto f = static_cast<Index>(facet);
      if (!edges_.counts(f)) return;
      const auto row = edges_.triangles().row(f);
      // From the lowest vertex on, so that rotated indices give the same bits.
      const int first = row[0] < row[1] ? (row[0] < row[2] ? 0 : 2) : (row[1] < row[2] ? 1 : 2);
      const Vec3 a = at(row[first]);
      const Vec3 cross = (at(row[(first + 1) % 3]) - a).cross(at(row[(first + 2) % 3]) - a);
      const double norm = stable_norm(cross);  // of an area: its square may be out of range
      std::size_t& e = longest[slot(f)] = edges_.edge(f, 0);
      for (int k = 1; k < 3; ++k) {
        const std::size_t g = edges_.edge(f, k);
        if (length_[g] > length_[e] || (length_[g] == length_[e] && g < e)) e = g;
      }
      area_[slot(f)] = norm / 2;
      thin[slot(f)] = norm <= kThinFacet * radius_[e] * length_[e];
      if (norm > 0) own[slot(f)] = cross / norm;
    });
    normal_ = own;
    for_each_index_on_all_threads(n, run_.part(0.25, 0.3), [&](std::size_t facet) {
      const auto f = static_cast<Index>(facet);
      if (!edges_.counts(f) || !thin[slot(f)]) return;
      double sign = 1;
      Index g = f;
      for (int step = 0; step < kThinSteps && thin[slot(g)]; ++step) {
        const MeshEdge edge = edges_[longest[slot(g)]];
        if (edge.size() != 2) return;
        sign *= alignment(edge);
        g = edge[0].facet == g ? edge[1].facet : edge[0].facet;
      }
      if (!thin[slot(g)]) normal_[slot(f)] = sign * own[slot(g)];
    });
  }

  void mark_candidates() {
    const double threshold = portable_cosine(options_.crease_angle);
    for_each_index_on_all_threads(edges_.size(), run_.part(0.3, 0.35), [&](std::size_t e) {
      const MeshEdge edge = edges_[e];
      if (edge.size() != 2) return;
      const Vec3 &a = normal_[slot(edge[0].facet)], &b = normal_[slot(edge[1].facet)];
      if (alignment(edge) * cosine_between(a, b) < threshold) {
        // A facet without a normal is no evidence of a crease.
        if (a.isZero(0) || b.isZero(0)) return;
        curve_[e] = 1;
        kind_[e] = std::min(kind_[e], CurveKind::kCrease);
      }
    });
  }

  /// Squared distance of x from an edge.
  double squared_distance(std::size_t e, const Vec3& x) const {
    const Vec3 a = at(edges_[e].low), d = at(edges_[e].high) - a;
    const double t = squared_norm(d) > 0 ? std::min(1.0, std::max(0.0, dot(x - a, d) / squared_norm(d))) : 0;
    return squared_norm(x - a - t * d);
  }

  struct Flooded {
    Index facet;
    double sign;
  };

  /// The sum of normals, oriented as `facet`, over what lies within the radius of x and is joined to it across no candidate.
  Vec3 average(Index facet, const Vec3& x, double r, std::vector<Flooded>& flood, std::vector<Index>& stamp, Index mark) const {
    flood.assign(1, {facet, 1});
    stamp[slot(facet)] = mark;
    Vec3 sum = Vec3::Zero();
    for (std::size_t i = 0; i < flood.size(); ++i) {
      const Flooded now = flood[i];
      sum += now.sign * std::min(area_[slot(now.facet)], r * r) * normal_[slot(now.facet)];
      // Sides by edge number, so that the order does not depend on how indices are rotated.
      std::array<std::size_t, 3> sides{edges_.edge(now.facet, 0), edges_.edge(now.facet, 1), edges_.edge(now.facet, 2)};
      std::sort(sides.begin(), sides.end());
      for (const std::size_t e : sides) {
        const MeshEdge edge = edges_[e];
        if (curve_[e] || edge.size() != 2 || flood.size() >= kFacetsPerAverage) continue;
        const Index next = edge[0].facet == now.facet ? edge[1].facet : edge[0].facet;
        if (stamp[slot(next)] == mark || squared_distance(e, x) > r * r) continue;
        stamp[slot(next)] = mark;
        flood.push_back({next, now.sign * alignment(edge)});
      }
    }
    return sum.isZero(0) ? normal_[slot(facet)] : sum;
  }

  void confirm() {
    std::vector<std::size_t> creases;
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (curve_[e] && !fixed_[e]) creases.push_back(e);
    }
    const double threshold = portable_cosine(kConfirmedShare * options_.crease_angle);
    std::vector<char> keep(creases.size(), 0);
    struct Scratch {
      std::vector<Flooded> flood;
      std::vector<Index> stamp;
      Index mark = 0;
    };
    ScratchPool<Scratch> pool;
    constexpr std::size_t kCreasesPerPiece = 64;
    for_each_piece_on_all_threads(creases.size(), kCreasesPerPiece, run_.part(0.35, 0.8),
                                  [&](std::size_t begin, std::size_t end) {
                                    const auto lent = pool.lend([] { return std::make_unique<Scratch>(); });
                                    Scratch& scratch = *lent;
                                    scratch.stamp.resize(slot(edges_.num_facets()), 0);
                                    for (std::size_t i = begin; i < end; ++i) {
                                      const MeshEdge edge = edges_[creases[i]];
                                      const Vec3 x = (at(edge.low) + at(edge.high)) / 2;
                                      const double r = radius_[creases[i]];
                                      // At most 2 marks a candidate: renewed before they could run out.
                                      if (scratch.mark > 2'000'000'000) {
                                        std::fill(scratch.stamp.begin(), scratch.stamp.end(), 0);
                                        scratch.mark = 0;
                                      }
                                      const Vec3 a = average(edge[0].facet, x, r, scratch.flood, scratch.stamp, ++scratch.mark);
                                      const Vec3 b = average(edge[1].facet, x, r, scratch.flood, scratch.stamp, ++scratch.mark);
                                      keep[i] = alignment(edge) * cosine_between(a, b) < threshold;
                                    }
                                  });
    for (std::size_t i = 0; i < creases.size(); ++i) curve_[creases[i]] = keep[i];
  }

  /// Lists the curve edges at each vertex, ascending.
  void list_edges() {
    first_at_.assign(slot(edges_.num_vertices()) + 1, 0);
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (!curve_[e]) continue;
      ++first_at_[slot(edges_[e].low) + 1];
      ++first_at_[slot(edges_[e].high) + 1];
    }
    for (std::size_t v = 1; v < first_at_.size(); ++v) first_at_[v] += first_at_[v - 1];
    std::vector<std::size_t> next(first_at_.begin(), first_at_.end() - 1);
    at_.resize(first_at_.back());
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (!curve_[e]) continue;
      at_[next[slot(edges_[e].low)]++] = e;
      at_[next[slot(edges_[e].high)]++] = e;
    }
  }
  std::size_t degree(Index v) const { return first_at_[slot(v) + 1] - first_at_[slot(v)]; }
  std::size_t edge_at(Index v, std::size_t i) const { return at_[first_at_[slot(v)] + i]; }
  std::size_t next_edge(Index v, std::size_t e) const { return edge_at(v, 0) == e ? edge_at(v, 1) : edge_at(v, 0); }

  /// Drops all short chains that end freely, as they are now; false if there is none.
  bool drop_dangling() {
    run_.check();
    std::vector<std::size_t> gone, chain;
    for (Index v = 0; v < edges_.num_vertices(); ++v) {
      if (degree(v) != 1) continue;
      chain.clear();
      double length = 0;
      Index w = v;
      std::size_t e = edge_at(v, 0);
      while (!fixed_[e] && length < kShortCurve) {
        chain.push_back(e);
        length += length_[e] / radius_[e];
        w = other(e, w);
        if (degree(w) != 2) break;
        e = next_edge(w, e);
      }
      if (length < kShortCurve) gone.insert(gone.end(), chain.begin(), chain.end());
    }
    for (const std::size_t e : gone) curve_[e] = 0;
    return !gone.empty();
  }

  /// Cosine of the turn at a vertex of two curve edges.
  double cosine_of_turn(Index v) const {
    return cosine_between(at(v) - at(other(edge_at(v, 0), v)), at(other(edge_at(v, 1), v)) - at(v));
  }

  void drop_components() {
    run_.check();
    const auto n = slot(edges_.num_vertices());
    UnionFind sets(n);
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (curve_[e]) sets.join(slot(edges_[e].low), slot(edges_[e].high));
    }
    std::vector<double> length(n, 0);
    std::vector<char> kept(n, 0), rough(n, 0);
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (!curve_[e]) continue;
      const std::size_t set = sets.find(slot(edges_[e].low));
      length[set] += length_[e] / radius_[e];
      if (fixed_[e]) kept[set] = 1;
    }
    const double smooth = portable_cosine(kSmoothTurn);
    for (Index v = 0; v < edges_.num_vertices(); ++v) {
      if (degree(v) == 0) continue;
      if (degree(v) != 2 || cosine_of_turn(v) < smooth) rough[sets.find(slot(v))] = 1;
    }
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (!curve_[e]) continue;
      const std::size_t set = sets.find(slot(edges_[e].low));
      if (!kept[set] && length[set] < (rough[set] ? kShortCurve : kShortLoop)) curve_[e] = 0;
    }
  }

  /// Drops components without fixed edges that are a web of short curves, as on rough scans and coarse figures; false if there
  /// is none.
  bool drop_webs() {
    run_.check();
    UnionFind sets(graph_.curves.size());
    std::vector<std::size_t> first_at_corner(graph_.corners.size(), graph_.curves.size());
    for (std::size_t c = 0; c < graph_.curves.size(); ++c) {
      for (const Index corner : {graph_.curves[c].first_corner, graph_.curves[c].last_corner}) {
        if (corner == kNone) continue;
        std::size_t& first = first_at_corner[slot(corner)];
        if (first == graph_.curves.size()) first = c;
        sets.join(first, c);
      }
    }
    struct Component {
      double length = 0;  // in r
      int curves = 0;
      bool fixed = false;
    };
    std::vector<Component> components(graph_.curves.size());
    for (std::size_t c = 0; c < graph_.curves.size(); ++c) {
      Component& component = components[sets.find(c)];
      ++component.curves;
      for (const std::size_t e : graph_.curves[c].edges) {
        component.length += length_[e] / radius_[e];
        component.fixed = component.fixed || fixed_[e];
      }
    }
    bool any = false;
    for (std::size_t c = 0; c < graph_.curves.size(); ++c) {
      const Component& component = components[sets.find(c)];
      if (component.fixed || component.curves < 2 || component.length >= kShortMeanCurve * component.curves) continue;
      for (const std::size_t e : graph_.curves[c].edges) curve_[e] = 0;
      any = true;
    }
    return any;
  }

  /// The place on the curve from v over e at the given arc, or where degree 2 ends before.
  Vec3 ahead(Index v, std::size_t e, double arc) const {
    Index w = v;
    while (true) {
      const Index next = other(e, w);
      if (length_[e] >= arc) return at(w) + (arc / length_[e]) * (at(next) - at(w));
      arc -= length_[e];
      w = next;
      if (degree(w) != 2 || w == v) return at(w);
      e = next_edge(w, e);
    }
  }

  void find_corners() {
    const Execution run = run_.part(0.8, 0.9);
    const auto n = slot(edges_.num_vertices());
    std::vector<char> corner(n, 0);
    const std::vector<Index> fans = fans_at_vertices(edges_.triangles(), edges_.num_vertices(), corner_fans_, edges_.counted());
    const double sharp = portable_cosine(kSharpTurn), bent = portable_cosine(kCornerTurn);
    std::vector<double> turn(n, 1);  // cosines
    const auto reach = [this](Index v) { return kTurnReach * std::max(radius_[edge_at(v, 0)], radius_[edge_at(v, 1)]); };
    for_each_index(edges_.num_vertices(), run, [&](Index v) {
      corner[slot(v)] = fans[slot(v)] > 1 || (degree(v) != 0 && degree(v) != 2);
      if (degree(v) != 2) return;
      if (cosine_of_turn(v) < sharp) corner[slot(v)] = 1;
      if (!has_radius()) return;
      turn[slot(v)] = cosine_between(at(v) - ahead(v, edge_at(v, 0), reach(v)), ahead(v, edge_at(v, 1), reach(v)) - at(v));
    });
    for (Index v = 0; v < edges_.num_vertices() && has_radius(); ++v) {
      if (degree(v) != 2 || corner[slot(v)] || !(turn[slot(v)] < bent)) continue;
      bool sharpest = true;
      for (std::size_t side = 0; side < 2 && sharpest; ++side) {
        std::size_t e = edge_at(v, side);
        Index w = other(e, v);
        for (double arc = length_[e]; arc <= reach(v) && w != v && degree(w) == 2; arc += length_[e]) {
          if (turn[slot(w)] < turn[slot(v)] || (turn[slot(w)] == turn[slot(v)] && w < v)) sharpest = false;
          e = next_edge(w, e);
          w = other(e, w);
        }
      }
      // Not yet a corner for those that follow: they compare turns alone.
      if (sharpest) corner[slot(v)] = 1;
    }
    for (const Index v : options_.vertices) {
      if (fans[slot(first_[slot(v)])] == 0) {
        throw Error(ErrorCode::kInvalidArgument,
                    "find_curves: vertex " + std::to_string(v) + " is marked as a corner, but is on no facet");
      }
      corner[slot(first_[slot(v)])] = 1;
    }
    graph_.corner_of_vertex.assign(n, kNone);
    for (Index v = 0; v < edges_.num_vertices(); ++v) {
      if (!corner[slot(v)]) continue;
      graph_.corner_of_vertex[slot(v)] = static_cast<Index>(graph_.corners.size());
      graph_.corners.push_back(v);
    }
  }

  void walk(Index v, std::size_t e) {
    Curve curve;
    curve.vertices.push_back(v);
    curve.arc.push_back(0);
    const auto number = static_cast<Index>(graph_.curves.size());
    Index w = v;
    while (true) {
      graph_.curve_of_edge[e] = number;
      curve.edges.push_back(e);
      curve.arc.push_back(curve.arc.back() + length_[e]);
      curve.kind = std::min(curve.kind, kind_[e]);
      w = other(e, w);
      curve.vertices.push_back(w);
      if (w == v || graph_.corner_of_vertex[slot(w)] != kNone) break;
      e = next_edge(w, e);
    }
    curve.first_corner = graph_.corner_of_vertex[slot(v)];
    curve.last_corner = graph_.corner_of_vertex[slot(w)];
    curve.closed = curve.first_corner == kNone;
    graph_.curves.push_back(std::move(curve));
  }

  void walk_all() {
    graph_.curve_of_edge.assign(edges_.size(), kNone);
    for (const Index v : graph_.corners) {
      for (std::size_t i = 0; i < degree(v); ++i) {
        if (graph_.curve_of_edge[edge_at(v, i)] == kNone) walk(v, edge_at(v, i));
      }
    }
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (curve_[e] && graph_.curve_of_edge[e] == kNone) walk(edges_[e].low, e);
    }
  }

  void find_patches() {
    const auto n = slot(edges_.num_facets());
    UnionFind sets(n);
    for_each_index(edges_.size(), run_.part(0.9, 1), [&](std::size_t e) {
      const MeshEdge edge = edges_[e];
      for (std::size_t i = 1; i < edge.size() && !curve_[e]; ++i) sets.join(slot(edge[0].facet), slot(edge[i].facet));
    });
    graph_.patch_of_facet.assign(n, kNone);
    for (std::size_t f = 0; f < n; ++f) {
      if (!edges_.counts(static_cast<Index>(f))) continue;
      const std::size_t first = sets.find(f);  // ≤ f
      graph_.patch_of_facet[f] = first == f ? graph_.num_patches++ : graph_.patch_of_facet[first];
    }
  }

  const MeshView& mesh_;
  const SurfaceEdges& edges_;
  const std::vector<std::size_t>& corner_fans_;  // uncut
  const CurveOptions& options_;
  const Execution& run_;
  std::vector<double> length_, radius_;          // by edge
  std::vector<char> curve_, fixed_, candidate_;  // by edge
  std::vector<CurveKind> kind_;                  // by edge; kMarked where nothing else is known
  std::vector<Index> first_;                     // of each vertex the surface vertex, where something is marked
  std::vector<Vec3> normal_;                     // by facet
  std::vector<double> area_;
  std::vector<std::size_t> first_at_, at_;  // curve edges by vertex
  CurveGraph graph_;
};

void require_curve_options(const MeshView& mesh, const CurveOptions& options) {
  const auto refuse = [](const std::string& why) { throw Error(ErrorCode::kInvalidArgument, "find_curves: " + why); };
  if (!(options.crease_angle > 0 && options.crease_angle < 180)) refuse("crease_angle must lie in (0, 180) degrees");
  if (!(options.radius >= 0 && std::isfinite(options.radius))) refuse("radius must be finite and not negative");
  if (!options.labels.empty() && options.labels.size() != slot(mesh.num_facets())) refuse("labels must be one per facet");
  if (!options.sizing.empty() && options.sizing.num_facets() != mesh.num_facets()) refuse("sizing is of another mesh");
  const auto in_range = [&](Index v) { return v >= 0 && v < mesh.num_vertices(); };
  for (const auto& pair : options.edges) {
    if (!in_range(pair[0]) || !in_range(pair[1])) refuse("a marked edge has a vertex that the mesh does not have");
  }
  for (const Index v : options.vertices) {
    if (!in_range(v)) refuse("marked vertex " + std::to_string(v) + " is not in the mesh");
  }
}

}  // namespace

CurveOptions scaled_options(const CurveOptions& options, const MeshScale& scale) {
  CurveOptions result = options;
  result.radius = scale.length(options.radius);
  result.sizing = SizingFieldAccess::scaled(options.sizing, scale);
  return result;
}

void scale_back(CurveGraph& graph, const MeshScale& scale) {
  for (Curve& curve : graph.curves) scale.back(curve.arc);
}

CurveGraph find_curves(const MeshView& mesh, const SurfaceEdges& edges, const CurveOptions& options,
                       const std::vector<std::size_t>* fans) {
  require_curve_options(mesh, options);
  const Execution run = options.execution.start("finding curves");
  if (fans != nullptr) return CurveFinder(mesh, edges, *fans, options, run).find();
  return CurveFinder(mesh, edges, corner_fans(edges.edges()), options, run).find();
}

}  // namespace detail

const char* name_of(CurveKind kind) noexcept {
  switch (kind) {
    case CurveKind::kBorder:
      return "border";
    case CurveKind::kManySheets:
      return "edge of many sheets";
    case CurveKind::kLabels:
      return "border of labels";
    case CurveKind::kCrease:
      return "crease";
    case CurveKind::kMarked:
      return "marked";
  }
  return "";
}

CurveGraph find_curves(const MeshView& mesh, const CurveOptions& options) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    CurveGraph result =
        scale.in_our_units([&] { return find_curves(scale.mesh(mesh), detail::scaled_options(options, scale)); });
    detail::scale_back(result, scale);
    return result;
  }
  CurveOptions inner = options;
  const Execution job = options.execution.start("finding curves");
  require_usable(mesh, job.part(0, 0.1));
  const detail::SurfaceEdges edges(mesh, job.part(0.1, 0.4));
  inner.execution = job.part(0.4, 1);
  CurveGraph result = detail::find_curves(mesh, edges, inner);
  job.finish();
  return result;
}

}  // namespace amps
