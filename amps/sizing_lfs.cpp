// Local feature size: the distance to the medial axis, by poles. Amenta, Bern & Kamvysselis, "A new Voronoi-based surface
// reconstruction algorithm", 1998 (poles); Dey & Zhao, "Approximating the medial axis from the Voronoi diagram with a
// convergence guarantee", 2004 (the angle that tells its sheets from noise). Where we differ: samples are added only where the
// mesh is too coarse to carry poles; a pole whose ball touches within a small angle, or is no larger than the spacing of
// samples, is dropped.
#define AMPS_OWN_SOURCE
#include "amps/sizing.h"
#include "amps/sizing_lattice.h"

#include "amps/execution.h"
#include "amps/kdtree.h"
#include "amps/mesh_edges.h"
#include "amps/portable_math.h"
#include "amps/triangulation.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace amps {
namespace {

using detail::dot;
using detail::for_each_index;
using detail::for_each_index_on_all_threads;
using detail::norm;
using detail::normalized;
using detail::slot;
using detail::squared_norm;
using detail::stable_normalized;

constexpr const char* kLfsStage = "measuring local feature size";
constexpr double kAxisEnd = 0.8;  ///< of the time

/// Samples that carry the poles: the corners of all facets with area, and the nodes of a lattice of 4^level triangles on facets
/// that are coarse beside the feature size. Equal positions are one sample. Everything is multiplied by a power of two, so that
/// squares and fourth powers of coordinates are doubles.
class PoleSamples {
 public:
  PoleSamples(const MeshView& mesh, const Execution& execution)
      : mesh_(mesh),
        areas_(facet_areas(mesh, execution.part(0, 0.2))),
        level_(areas_.size(), 0),
        points_(slot(mesh.num_vertices()), execution.part(0.2, 0.2)) {
    const Box box = bounding_box(mesh, execution.part(0.2, 0.3));
    int exponent = 0;
    std::frexp(std::max(box.min.cwiseAbs().maxCoeff(), box.max.cwiseAbs().maxCoeff()), &exponent);
    scale_ = std::ldexp(1.0, -std::clamp(exponent, -1000, 1000));
    diagonal_ = norm(scale_ * box.max - scale_ * box.min);
    for (Index f = 0; f < mesh.num_facets(); ++f) total_area_ += areas_[slot(f)] * scale_ * scale_;
    sample_of_vertex_.assign(slot(mesh.num_vertices()), kNone);
    facets_.resize(areas_.size());
    for_each_index_on_all_threads(facets_.size(), execution.part(0.3, 0.5), [&](std::size_t f) {
      if (areas_[f] > 0) facets_[f] = {weighted_normal(static_cast<Index>(f)), longest_edge_of(static_cast<Index>(f))};
    });
    visit_lattices(execution.part(0.5, 1));
  }

  /// Of the mesh's facets, in its units.
  const std::vector<double>& areas() const { return areas_; }

  double scale() const { return scale_; }
  double diagonal() const { return diagonal_; }
  double total_area() const { return total_area_; }
  Index size() const { return points_.size(); }
  PointsView positions_from(Index first) const { return {points_.coordinates().data() + 3 * slot(first), size() - first}; }
  /// Longest edge of the (lattice) triangles around a sample.
  double spacing(Index s) const { return around_[slot(s)].spacing; }
  /// Unit; the mean of the facets around.
  Vec3 normal(Index s) const { return normalized(around_[slot(s)].normal); }
  /// True if refine() might have something to do.
  bool coarser_than(double shortest, const Execution& execution) const {
    bool found = false;
    for_each_index(mesh_.num_facets(), execution, [&](Index f) { found = found || may_refine(f, shortest); });
    return found;
  }

  /// Adds what is missing for lattice edges to be no longer than `fraction` of feature(x), but not shorter than `shortest`.
  template <class Feature>
  void refine(double fraction, double shortest, const Feature& feature, const Execution& execution) {
    std::vector<double> at_vertex(slot(mesh_.num_vertices()), -1);
    bool finer = false;
    detail::Ticker ticker(execution.part(0, 0.7), static_cast<std::uint64_t>(mesh_.num_facets()));
    for (Index f = 0; f < mesh_.num_facets(); ++f) {
      ticker.tick();
      if (!may_refine(f, shortest)) continue;
      double smallest = feature(scale_ * (mesh_.corner(f, 0) + mesh_.corner(f, 1) + mesh_.corner(f, 2)) / 3);
      for (int k = 0; k < 3; ++k) {
        double& value = at_vertex[slot(mesh_.triangles(f, k))];
        if (value < 0) value = feature(scale_ * mesh_.corner(f, k));
        smallest = std::min(smallest, value);
      }
      finer |= refine_facet(f, std::max(shortest, fraction * smallest));
    }
    if (finer) visit_lattices(execution.part(0.7, 1));
  }

 private:
  static constexpr int kMaxLevel = 10;
  static constexpr Index kRowsPerLook = 16;  ///< of up to 2^kMaxLevel nodes

  struct Facet {
    Vec3 normal = Vec3::Zero();  ///< times twice the area
    double longest_edge = 0;
  };
  /// What the facets around a sample are like.
  struct Surrounding {
    Vec3 normal = Vec3::Zero();  ///< sum of their normals times area, each turned to agree with those before
    double spacing = 0;
  };

  Index find_or_add(const Vec3& x) {
    const Index s = points_.find_or_add(x);
    if (slot(s) == around_.size()) around_.emplace_back();
    return s;
  }
  void meet_facet(Index s, const Vec3& normal, double edge) {
    Surrounding& around = around_[slot(s)];
    around.normal += dot(normal, around.normal) < 0 ? Vec3(-normal) : normal;
    around.spacing = std::max(around.spacing, edge);
  }

  Vec3 weighted_normal(Index f) const {
    const Vec3 a = scale_ * mesh_.corner(f, 0);
    return (scale_ * mesh_.corner(f, 1) - a).cross(scale_ * mesh_.corner(f, 2) - a);
  }
  double longest_edge(Index f) const { return facets_[slot(f)].longest_edge; }
  double longest_edge_of(Index f) const {
    const Vec3 a = scale_ * mesh_.corner(f, 0), b = scale_ * mesh_.corner(f, 1), c = scale_ * mesh_.corner(f, 2);
    return std::max({norm(b - a), norm(c - b), norm(a - c)});
  }

  bool too_coarse(Index f, int level, double wanted) const { return longest_edge(f) > std::ldexp(1.4142 * wanted, level); }
  /// False for what may stay as it is whatever the feature size. Facets without a lattice are given twice as much room: a mesh
  /// whose own vertices will do should not be triangulated twice for a few long edges.
  bool may_refine(Index f, double shortest) const {
    return areas_[slot(f)] > 0 && too_coarse(f, level_[slot(f)], level_[slot(f)] == 0 ? 2 * shortest : shortest);
  }

  /// Nodes stay within a few times the number of equilateral triangles of the wanted size; needles get no more.
  bool refine_facet(Index f, double wanted) {
    const double fair = 16 + 10 * areas_[slot(f)] * scale_ * scale_ / (wanted * wanted);
    const int before = level_[slot(f)];
    int level = before;
    while (level < kMaxLevel && too_coarse(f, level, wanted) && std::ldexp(1.0, 2 * level + 2) <= fair) ++level;
    level_[slot(f)] = static_cast<std::uint8_t>(level);
    return level > before;
  }

  /// Finds or adds the samples of all lattices, and sees what is around each. Lattices are nested, so samples stay.
  void visit_lattices(const Execution& execution) {
    std::fill(around_.begin(), around_.end(), Surrounding());
    for_each_index(mesh_.num_facets(), execution, [&](Index f) {
      if (!(areas_[slot(f)] > 0)) return;
      const auto& [normal, longest] = facets_[slot(f)];
      const double edge = level_[slot(f)] == 0 ? longest : std::ldexp(longest, -level_[slot(f)]);
      for (int k = 0; k < 3; ++k) {
        Index& sample = sample_of_vertex_[slot(mesh_.triangles(f, k))];
        if (sample == kNone) sample = find_or_add(scale_ * mesh_.corner(f, k));
        meet_facet(sample, normal, edge);
      }
      if (level_[slot(f)] > 0) visit_inner_nodes(f, normal, edge, execution);
    });
  }

  void visit_inner_nodes(Index f, const Vec3& normal, double edge, const Execution& execution) {
    const Index k = Index{1} << level_[slot(f)];
    // Corners in the order of their coordinates: two facets make the same points of a shared edge.
    std::array<Vec3, 3> corner{scale_ * mesh_.corner(f, 0), scale_ * mesh_.corner(f, 1), scale_ * mesh_.corner(f, 2)};
    std::sort(corner.begin(), corner.end(), [](const Vec3& a, const Vec3& b) {
      return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
    });
    for (Index j = 0; j < k; ++j) {
      for (Index i = j == 0 ? 1 : 0; i + j <= k; ++i) {
        if (i == k) continue;
        const Vec3 x = (static_cast<double>(k - i - j) * corner[0] + static_cast<double>(i) * corner[1] +
                        static_cast<double>(j) * corner[2]) /
                       k;
        meet_facet(find_or_add(x), normal, edge);
      }
      if (j % kRowsPerLook == 0) execution.report(0);
    }
  }

  const MeshView& mesh_;
  std::vector<double> areas_;
  std::vector<Facet> facets_;  ///< those with area
  std::vector<std::uint8_t> level_;
  std::vector<Index> sample_of_vertex_;
  detail::DistinctPoints points_;  ///< the samples
  std::vector<Surrounding> around_;
  double scale_ = 1, diagonal_ = 0, total_area_ = 0;
};

/// The cells of a triangulation are a function of its points, but their numbers and the order of their corners depend on the
/// number of threads. What is computed from a cell is computed from its corners in descending order, the same on any number.
using SortedCorners = std::array<Index, 4>;

SortedCorners sorted_corners(const RegularTriangulation::Cell& cell) {
  SortedCorners v = cell.vertex;
  const auto order = [&v](std::size_t i, std::size_t j) {
    const Index a = v[i], b = v[j];
    v[i] = std::max(a, b);
    v[j] = std::min(a, b);
  };
  order(0, 1);
  order(2, 3);
  order(0, 2);
  order(1, 3);
  order(1, 2);
  return v;
}

/// The ball through the corners of a Delaunay cell.
struct PoleBall {
  std::array<double, 3> at{};
  double squared_radius = -1;  ///< < 0: none, or too flat a cell to tell

  Vec3 center() const { return {at[0], at[1], at[2]}; }
};

PoleBall pole_ball(const RegularTriangulation& triangulation, const RegularTriangulation::Cell& cell) {
  const SortedCorners corner = sorted_corners(cell);
  const auto at = [&](std::size_t k) -> Vec3 { return triangulation.point(corner[k]).position(); };
  const Vec3 u = at(1) - at(0), v = at(2) - at(0), w = at(3) - at(0);
  const double uu = squared_norm(u), vv = squared_norm(v), ww = squared_norm(w);
  const Vec3 vw = v.cross(w), wu = w.cross(u), uv = u.cross(v);
  const double det = dot(u, vw);
  PoleBall ball;
  if (det == 0) return ball;
  const Vec3 c = (uu * vw + vv * wu + ww * uv) / (2 * det);
  const Vec3 center = at(0) + c;
  ball.at = {center.x(), center.y(), center.z()};
  ball.squared_radius = squared_norm(c);
  // The centre solves 2uᵀc = u², … . A relative error e of the right sides and the matrix moves it by at most about
  // 4 e l³ (R + l)/|det|, l the longest edge (the inverse's norm is below 2l²/|det|). Demand a hundredth of R, with e = 2^-50,
  // and (R + l)² ≤ 2(R² + l²).
  constexpr double kLimit = 400 * 0x1p-50;
  const double square = std::max({uu, vv, ww}), radius = ball.squared_radius;
  const bool sound = det * det * radius > 2 * kLimit * kLimit * square * square * square * (radius + square);
  if (!sound || !std::isfinite(radius)) ball.squared_radius = -1;
  return ball;
}

struct Pole {
  Vec3 center = Vec3::Zero();
  double radius = -1;     ///< < 0: none
  double apart = 0;       ///< the longest distance between points where the ball touches, over its radius
  bool opposite = false;  ///< it touches two sheets, one nearly above the other for the tangent planes of both
};

/// The poles of all samples, and what filters ask of them.
class PoleFinder {
 public:
  PoleFinder(const PoleSamples& samples, const RegularTriangulation& triangulation)
      : samples_(samples), triangulation_(triangulation) {}

  /// Finds the poles of new samples, and those that new samples have changed. A cell that is left has kept its number, and has
  /// old samples for corners; every other has a new one; a sample of which no cell is new has lost none.
  void update(const Execution& execution) {
    const std::size_t n = slot(triangulation_.num_vertices());
    changed_ = Flags(n);
    for (std::size_t v = num_old_; v < n; ++v) changed_[v].store(1, std::memory_order_relaxed);
    find_balls(execution.part(0, 0.35));
    first_.start_again(n, num_old_, changed_);
    second_.start_again(n, num_old_, changed_);
    direction_.resize(n, Vec3::Zero());
    find_first(execution.part(0.35, 0.6));
    find_second(execution.part(0.6, 0.8));
    find_poles(execution.part(0.8, 1));
    num_old_ = n;
  }

  /// Those of sample s are 2·s and 2·s + 1.
  const std::vector<Pole>& poles() const { return poles_; }
  /// The radius of a pole over the spacing of samples around its own.
  double resolved(std::size_t pole) const { return poles_[pole].radius / samples_.spacing(static_cast<Index>(pole / 2)); }

 private:
  using Flags = std::vector<std::atomic<char>>;  ///< by sample

  /// A cell for each sample, the farthest so far of those that threads offer.
  class Farthest {
   public:
    Index cell(std::size_t s) const { return entries_[s].cell.load(std::memory_order_relaxed); }
    void forget(Index s) { entries_[slot(s)].cell.store(kNone, std::memory_order_relaxed); }
    /// Is a ball too small to be chosen? Most are, and that takes no look at the one that is.
    bool passes(Index s, double squared_radius) const {
      return squared_radius >= entries_[slot(s)].at_least.load(std::memory_order_relaxed);
    }
    /// Threads may come in any order: what remains is the farthest.
    template <class IsFarther>
    void offer(Index s, Index c, double squared_radius, const IsFarther& farther) {
      Entry& entry = entries_[slot(s)];
      Index now = entry.cell.load(std::memory_order_relaxed);
      while (farther(c, now)) {
        if (!entry.cell.compare_exchange_weak(now, c, std::memory_order_relaxed)) continue;
        double known = entry.at_least.load(std::memory_order_relaxed);
        while (known < squared_radius &&
               !entry.at_least.compare_exchange_weak(known, squared_radius, std::memory_order_relaxed)) {
        }
        return;
      }
    }
    /// For n samples; the first `num_old`, but for those that have changed, keep their cells.
    void start_again(std::size_t n, std::size_t num_old, const Flags& changed) {
      std::vector<Entry> entries(n);
      for (std::size_t s = 0; s < num_old; ++s) {
        if (changed[s].load(std::memory_order_relaxed) == 0) entries[s].cell.store(cell(s), std::memory_order_relaxed);
      }
      entries_ = std::move(entries);
    }

   private:
    struct Entry {
      std::atomic<double> at_least{0};  ///< no more than the squared radius of the ball of `cell`
      std::atomic<Index> cell{kNone};
    };
    std::vector<Entry> entries_;
  };

  bool changed(std::size_t s) const { return changed_[s].load(std::memory_order_relaxed) != 0; }
  bool changed(Index s) const { return changed(slot(s)); }

  void find_balls(const Execution& execution) {
    balls_.resize(slot(triangulation_.cell_capacity()));
    for_each_index_on_all_threads(balls_.size(), execution, [&](std::size_t c) {
      const auto& cell = triangulation_.cell(static_cast<Index>(c));
      if (!cell.alive()) {
        balls_[c] = PoleBall();
        return;
      }
      const auto last = *std::max_element(cell.vertex.begin(), cell.vertex.end());
      if (slot(last) < num_old_) {
        AMPS_ASSERT(cell.ghost() || pole_ball(triangulation_, cell).at == balls_[c].at);
        return;
      }
      for (const Index v : cell.vertex) {
        if (v != RegularTriangulation::kInfinite) changed_[slot(v)].store(1, std::memory_order_relaxed);
      }
      balls_[c] = cell.ghost() ? PoleBall() : pole_ball(triangulation_, cell);
    });
  }

  /// Is the centre of cell c farther from their common samples than that of `best`? Equally far ones go by corners.
  bool farther(Index c, Index best) const {
    if (best == kNone) return true;
    const double square = balls_[slot(c)].squared_radius, best_square = balls_[slot(best)].squared_radius;
    if (square != best_square) return square > best_square;
    return sorted_corners(triangulation_.cell(c)) < sorted_corners(triangulation_.cell(best));
  }

  /// Offers the balls of all cells to those of their corners to whom they may belong.
  template <class MayBelong>
  void choose_farthest(Farthest& chosen, const Execution& execution, const MayBelong& may_belong) {
    for_each_index_on_all_threads(balls_.size(), execution, [&](std::size_t c) {
      const PoleBall& ball = balls_[c];
      if (ball.squared_radius < 0) return;
      for (const Index v : triangulation_.cell(static_cast<Index>(c)).vertex) {
        if (!chosen.passes(v, ball.squared_radius) || !changed(v) || !may_belong(v, ball)) continue;
        chosen.offer(v, static_cast<Index>(c), ball.squared_radius, [this](Index a, Index b) { return farther(a, b); });
      }
    });
  }

  Vec3 from_sample(Index v, const PoleBall& ball) const { return ball.center() - triangulation_.point(v).position(); }

  /// Each from its lowest corner on, in ascending order.
  std::vector<std::array<Index, 3>> hull_facets(const Execution& execution) const {
    constexpr std::size_t kCellsPerPiece = std::size_t{1} << 14;
    const std::size_t n = slot(triangulation_.cell_capacity());
    std::vector<std::vector<std::array<Index, 3>>> found((n + kCellsPerPiece - 1) / kCellsPerPiece);
    detail::for_each_piece_on_all_threads(n, kCellsPerPiece, execution, [&](std::size_t begin, std::size_t end) {
      std::vector<std::array<Index, 3>>& of_piece = found[begin / kCellsPerPiece];
      for (std::size_t c = begin; c < end; ++c) {
        const auto& cell = triangulation_.cell(static_cast<Index>(c));
        if (!cell.alive() || !cell.ghost()) continue;
        std::array<Index, 3> facet{cell.vertex[0], cell.vertex[1], cell.vertex[2]};
        std::rotate(facet.begin(), std::min_element(facet.begin(), facet.end()), facet.end());
        of_piece.push_back(facet);
      }
    });
    std::vector<std::array<Index, 3>> hull;
    for (const auto& of_piece : found) hull.insert(hull.end(), of_piece.begin(), of_piece.end());
    std::sort(hull.begin(), hull.end());
    return hull;
  }

  /// The farthest Voronoi vertex of each sample; for samples on the hull, whose cells are infinite, only its direction:
  /// outward.
  void find_first(const Execution& execution) {
    choose_farthest(first_, execution.part(0, 0.6), [](Index, const PoleBall&) { return true; });
    for_each_index_on_all_threads(direction_.size(), execution.part(0.6, 0.7), [&](std::size_t v) {
      if (!changed(v)) return;
      const Index c = first_.cell(v);
      direction_[v] = c == kNone ? Vec3(Vec3::Zero()) : from_sample(static_cast<Index>(v), balls_[slot(c)]);
    });
    const std::vector<std::array<Index, 3>> hull = hull_facets(execution.part(0.7, 0.9));
    for (const auto& facet : hull) {
      for (const Index v : facet) {
        first_.forget(v);
        if (changed(v)) direction_[slot(v)] = Vec3::Zero();
      }
    }
    for_each_index(hull.size(), execution.part(0.9, 1), [&](std::size_t f) {
      const Vec3 a = triangulation_.point(hull[f][0]).position();
      const Vec3 ab = triangulation_.point(hull[f][1]).position() - a, ac = triangulation_.point(hull[f][2]).position() - a;
      const Vec3 normal = stable_normalized(ab.cross(ac));
      for (const Index v : hull[f]) {
        if (changed(v)) direction_[slot(v)] += normal;
      }
    });
  }

  /// The farthest on the other side of the surface.
  void find_second(const Execution& execution) {
    choose_farthest(second_, execution,
                    [this](Index v, const PoleBall& ball) { return dot(from_sample(v, ball), direction_[slot(v)]) < 0; });
  }

  void find_poles(const Execution& execution) {
    std::vector<Vec3> normals(direction_.size());
    for_each_index_on_all_threads(normals.size(), execution.part(0, 0.2),
                                  [&](std::size_t s) { normals[s] = samples_.normal(static_cast<Index>(s)); });
    poles_.resize(2 * normals.size());
    constexpr std::size_t kSamplesAhead = 8;
    const auto prefetch_cell = [this](Index c) {
      if (c == kNone) return;
      detail::prefetch(&triangulation_.cell(c));
      detail::prefetch(&balls_[slot(c)]);
    };
    for_each_index_on_all_threads(normals.size(), execution.part(0.2, 1), [&](std::size_t s) {
      if (s + kSamplesAhead < normals.size()) {
        prefetch_cell(first_.cell(s + kSamplesAhead));
        prefetch_cell(second_.cell(s + kSamplesAhead));
      }
      if (!changed(s)) return;
      poles_[2 * s] = pole_at(first_.cell(s), normals);
      poles_[2 * s + 1] = pole_at(second_.cell(s), normals);
    });
  }

  Pole pole_at(Index c, const std::vector<Vec3>& normals) const {
    Pole pole;
    if (c == kNone) return pole;
    constexpr double kSteep = 0.8;  // cos 37°: between the faces of a cube's edge it is 0.71
    pole.center = balls_[slot(c)].center();
    pole.radius = std::sqrt(balls_[slot(c)].squared_radius);
    const auto& vertex = triangulation_.cell(c).vertex;
    double longest = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        const Vec3 chord = triangulation_.point(vertex[i]).position() - triangulation_.point(vertex[j]).position();
        const double square = squared_norm(chord), steep = kSteep * kSteep * square;
        const double above = dot(chord, normals[slot(vertex[i])]), below = dot(chord, normals[slot(vertex[j])]);
        longest = std::max(longest, square);
        pole.opposite = pole.opposite || (above * above > steep && below * below > steep);
      }
    }
    pole.apart = std::sqrt(longest) / pole.radius;
    return pole;
  }

  const PoleSamples& samples_;
  const RegularTriangulation& triangulation_;
  std::size_t num_old_ = 0;  ///< samples, in the last update
  Flags changed_;
  std::vector<PoleBall, detail::UninitializedAllocator<PoleBall>> balls_;  ///< by cell
  Farthest first_, second_;
  std::vector<Vec3> direction_;  ///< to the first
  std::vector<Pole> poles_;
};

/// A box of a grid of side `fineness` times the pole's radius, rounded down to a power of two, that holds the pole. Not 0; two
/// boxes share a key of 63 bits with probability 1e-9 among 1e5 poles.
std::uint64_t pole_box(const Pole& pole, double fineness) {
  int exponent = 0;
  std::frexp(pole.radius * fineness, &exponent);
  std::uint64_t key = static_cast<std::uint64_t>(static_cast<std::int64_t>(exponent));
  for (int k = 0; k < 3; ++k) {
    const double box = std::floor(std::ldexp(pole.center[k], -exponent));
    key = detail::scramble(key + 0x9e3779b97f4a7c15u +
                           static_cast<std::uint64_t>(static_cast<std::int64_t>(std::clamp(box, -0x1p62, 0x1p62))));
  }
  return key | 1;
}

/// Of the poles that count, one for each box: the poles of a sphere are all one point, and a search among many that are equally
/// near looks at each.
template <class Filter>
Points thinned_poles(const PoleFinder& finder, double fineness, const Filter& counts, const Execution& execution) {
  // Between sheets closer than the spacing of samples the radii of cells say little, and nothing else is that small.
  constexpr double kMinResolved = 0.5;
  const std::vector<Pole>& poles = finder.poles();
  std::size_t capacity = 16;
  while (capacity < 2 * poles.size()) capacity *= 2;
  std::vector<std::uint64_t> table(capacity, 0);
  std::vector<std::uint64_t> keys(poles.size(), 0);  // 0: it does not count
  for_each_index_on_all_threads(keys.size(), execution.part(0, 0.7), [&](std::size_t i) {
    if (poles[i].radius < 0) return;
    const double resolved = finder.resolved(i);
    if (resolved >= kMinResolved && counts(poles[i], resolved)) keys[i] = pole_box(poles[i], fineness);
  });
  std::vector<double> kept;
  for_each_index(keys.size(), execution.part(0.7, 1), [&](std::size_t i) {
    const std::uint64_t key = keys[i];
    if (key == 0) return;
    std::size_t at = key >> 1 & (capacity - 1);
    while (table[at] != 0 && table[at] != key) at = (at + 1) & (capacity - 1);
    if (table[at] == key) return;
    table[at] = key;
    kept.insert(kept.end(), poles[i].center.data(), poles[i].center.data() + 3);
  });
  return Points(std::move(kept));
}

/// The medial axis of a mesh, as poles.
class MedialAxis {
 public:
  MedialAxis(const MeshView& mesh, const LfsOptions& options, const Execution& execution)
      : samples_(mesh, execution.part(0, kSamplesEnd)) {
    const double separation = 2 * detail::portable_sine(detail::to_radians(options.min_separation / 2));
    const double shortest = std::sqrt(samples_.total_area() / (kHexagonal * options.samples));
    double from = kSamplesEnd;
    bool coarse = samples_.coarser_than(shortest, execution.part(from, from));
    // Of a mesh that is fine enough there is one round, of others two or three: each takes half of what is left.
    double to = coarse ? (from + kRoundsEnd) / 2 : kRoundsEnd;
    const double triangulated = from + kTriangulationShare * (to - from);
    RegularTriangulation triangulation(samples_.positions_from(0), no_weights(samples_.size()),
                                       execution.part(from, triangulated));
    PoleFinder finder(samples_, triangulation);
    finder.update(execution.part(triangulated, to));
    for (int round = 0; round < kRounds && coarse; ++round) {
      from = to;
      to = (from + kRoundsEnd) / 2;
      const Execution job = execution.part(from, to);
      // What must be resolved is where the surface comes near itself; near creases that never ends.
      set_poles(
          finder, [](const Pole& pole, double) { return pole.opposite; }, job.part(0, 0.1));
      const Index before = samples_.size();
      samples_.refine(
          kSpacing, shortest, [this](const Vec3& x) { return scaled_distance(x); }, job.part(0.1, 0.3));
      if (samples_.size() == before) break;
      triangulation.insert(samples_.positions_from(before), no_weights(samples_.size() - before), job.part(0.3, 0.8));
      finder.update(job.part(0.8, 1));
      if (samples_.size() - before < kSettled * before) break;
      coarse = samples_.coarser_than(shortest, job.part(1, 1));
    }
    set_poles(
        finder,
        [&](const Pole& pole, double resolved) {
          return pole.opposite || (resolved >= options.min_pole_ratio && pole.apart >= separation);
        },
        execution.part(kRoundsEnd, 1));
  }

  const std::vector<double>& areas() const { return samples_.areas(); }

  double distance(const Vec3& x) const {
    return std::clamp(scaled_distance(samples_.scale() * x), kMinDistance * samples_.diagonal(), samples_.diagonal()) /
           samples_.scale();
  }

 private:
  static constexpr double kHexagonal = 1.1547;  ///< samples per area / spacing² in a hexagonal lattice
  static constexpr int kRounds = 3;
  static constexpr double kSettled = 0.02;      ///< part of samples: after so few new ones there is no further round
  static constexpr double kSpacing = 0.33;      ///< lattice edges beside the feature size
  static constexpr double kFineness = 0.005;    ///< of the grid that thins poles: an error of up to √3 times as much
  static constexpr double kMinDistance = 1e-6;  ///< over the diagonal

  static constexpr double kSamplesEnd = 0.1, kRoundsEnd = 0.95;  ///< of the time
  static constexpr double kTriangulationShare = 0.8;             ///< of a round; the rest is for poles

  static std::vector<double> no_weights(Index n) { return std::vector<double>(slot(n), 0.0); }

  template <class Filter>
  void set_poles(const PoleFinder& finder, const Filter& counts, const Execution& execution) {
    const Points thinned = thinned_poles(finder, kFineness, counts, execution.part(0, 0.6));
    tree_ = KdTree(thinned, execution.part(0.6, 1));
  }

  double scaled_distance(const Vec3& x) const {
    return tree_.size() == 0 ? samples_.diagonal() : std::sqrt(tree_.nearest(x).squared_distance);
  }

  PoleSamples samples_;
  KdTree tree_{PointsView()};
};

void require_lfs_options(const LfsOptions& options) {
  const auto fail = [](const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "lfs: " + what); };
  if (!(options.scale > 0 && std::isfinite(options.scale))) fail("scale must be positive and finite");
  if (!(options.min_separation >= 0 && options.min_separation <= 180)) fail("min_separation must lie in [0, 180] degrees");
  if (!(options.min_pole_ratio >= 0 && std::isfinite(options.min_pole_ratio))) fail("min_pole_ratio must not be negative");
  if (options.samples < 1) fail("samples must be at least 1");
}

}  // namespace

namespace {

void require_finite_lfs_point(const Vec3& point, std::ptrdiff_t i) {
  if (point.allFinite()) return;
  throw Error(ErrorCode::kInvalidArgument, "lfs: point " + std::to_string(i) + " (0-based) is not finite; remove it");
}

}  // namespace

std::vector<double> local_feature_size(const MeshView& mesh, const PointsView& points, const LfsOptions& options,
                                       const Execution& execution) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    for (std::ptrdiff_t i = 0; i < points.rows(); ++i) require_finite_lfs_point(points[i], i);
    std::vector<double> result = local_feature_size(scale.mesh(mesh), scale.points(points), options, execution);
    scale.back(result);
    return result;
  }
  const Execution job = execution.start(kLfsStage);
  require_usable(mesh, job.part(0, 0.02));
  require_lfs_options(options);
  for (std::ptrdiff_t i = 0; i < points.rows(); ++i) {
    require_finite_lfs_point(points[i], i);
  }
  const MedialAxis axis(mesh, options, job.part(0.02, kAxisEnd));
  std::vector<double> result(static_cast<std::size_t>(points.rows()));
  for_each_index_on_all_threads(result.size(), job.part(kAxisEnd, 1),
                                [&](std::size_t i) { result[i] = axis.distance(points[static_cast<std::ptrdiff_t>(i)]); });
  job.finish();
  return result;
}

SizingField lfs_sizing(const MeshView& mesh, const LfsOptions& options, const Execution& execution) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    return detail::SizingFieldAccess::back(lfs_sizing(scale.mesh(mesh), options, execution), scale);
  }
  const Execution job = execution.start(kLfsStage);
  require_usable(mesh, job.part(0, 0.02));
  require_lfs_options(options);
  const MedialAxis axis(mesh, options, job.part(0.02, kAxisEnd));
  TabulationOptions tabulation;
  tabulation.tolerance = options.tolerance;
  tabulation.finest = 1;  // lfs is 1-Lipschitz: a finer mesh resolves it
  SizingField field = detail::tabulate_positions(
      mesh, axis.areas(), [&](const Vec3& x) { return axis.distance(x); }, tabulation, job.part(kAxisEnd, 0.98));
  if (options.scale != 1) field = field.scaled(options.scale, job.part(0.98, 1));
  job.finish();
  return field;
}

}  // namespace amps
