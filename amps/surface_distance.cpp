#define AMPS_OWN_SOURCE
#include "amps/surface_distance.h"

#include "amps/spatial_sort.h"
#include "amps/surface_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iomanip>
#include <locale>
#include <ostream>
#include <sstream>
#include <string>
#include <vector>

namespace amps {
namespace {

/// A point of a facet of `from` with its distance to `to`.
struct DistancePoint {
  Vec3 barycentric = Vec3::Zero();
  double distance = 0;
  Index nearest = kNone;  ///< facet of `to`
};

/// The greatest distance met so far; of equal ones the first.
struct FarthestPoint {
  DistancePoint point;
  Index facet = kNone;
  void offer(const DistancePoint& p, Index f) {
    if (facet == kNone || p.distance > point.distance) *this = {p, f};
  }
  void offer(const FarthestPoint& other) {
    if (other.facet != kNone) offer(other.point, other.facet);
  }
};

/// A triangle of a facet of `from` whose distances are not yet known well enough.
struct DistancePiece {
  std::array<DistancePoint, 3> corners;
  double upper = std::numeric_limits<double>::infinity();  ///< none of its points is farther than this
  Index facet = kNone;
  Index over = kNone;    ///< the facet of `to` with the least greatest distance to the corners, which …
  int worst = 0;         ///< … this corner has
  int border_cuts = 0;   ///< since the last halving
};

/// The greatest distance a point of a triangle has to its nearest corner. A triangle that is not obtuse has it at its circumcentre;
/// in an obtuse one the bisectors of the two short sides meet the longest side before they meet each other, and it is there.
/// Never less than the truth by more than rounding.
double covering_radius(const Vec3& a, const Vec3& b, const Vec3& c) {
  std::array<double, 3> squares = {(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()};
  std::sort(squares.begin(), squares.end());
  const double p = squares[0], q = squares[1], longest = squares[2];
  const double obtuse = longest - p - q;
  if (obtuse < 0) return std::sqrt(p * q / (4 * p * q - obtuse * obtuse) * longest);
  // A side of square s at an angle of cosine k to the longest meets it at √s / 2k; twice its product with the longest is s + longest − other.
  const double length = std::sqrt(longest);
  const double from_p = p * length / (p + longest - q), from_q = q * length / (q + longest - p);
  return std::min(length / 2, from_p > from_q ? from_p : from_q);
}

struct DistanceSums {
  double mean = 0, square = 0;              ///< ∫ d, ∫ d²
  double mean_change = 0, square_change = 0;  ///< sums of what a rule of lower degree changes in each cell
  FarthestPoint farthest;
};

class OneSidedMeasure {
 public:
  OneSidedMeasure(const MeshView& from, const MeshView& to, const SurfaceTree& tree, double diagonal, const DistanceOptions& options)
      : from_(from), to_(to), tree_(tree), tolerance_(options.tolerance * diagonal), spacing_(options.spacing * diagonal), options_(options) {}

  OneSidedDistance run() {
    measure_vertices();
    integrate();
    enclose();
    const FarthestPoint& p = farthest_;
    result_.hausdorff_lower = p.point.distance;
    result_.farthest = {p.facet, p.point.barycentric, position(p.facet, p.point.barycentric)};
    return result_;
  }

 private:
  Vec3 position(Index facet, const Vec3& barycentric) const {
    return barycentric[0] * from_.corner(facet, 0) + barycentric[1] * from_.corner(facet, 1) + barycentric[2] * from_.corner(facet, 2);
  }

  DistancePoint measure(Index facet, const Vec3& barycentric, Index hint) const {
    const SurfaceHit hit = tree_.nearest(position(facet, barycentric), hint);
    return {barycentric, hit.distance, hit.point.facet};
  }

  DistancePoint corner(Index facet, int k) const {
    DistancePoint p = at_vertex_[detail::slot(from_.triangles(facet, k))];
    p.barycentric[k] = 1;
    return p;
  }

  double longest_edge(const std::array<Vec3, 3>& x) const {
    return std::sqrt(std::max({(x[1] - x[0]).squaredNorm(), (x[2] - x[1]).squaredNorm(), (x[0] - x[2]).squaredNorm()}));
  }

  std::array<Vec3, 3> corners_of(const MeshView& mesh, Index facet) const {
    return {mesh.corner(facet, 0), mesh.corner(facet, 1), mesh.corner(facet, 2)};
  }

  /// Distances of all vertices of facets. Along a curve, so that each starts from the facet nearest to its neighbour.
  void measure_vertices() {
    at_vertex_.resize(static_cast<std::size_t>(from_.num_vertices()));
    std::vector<char> used(at_vertex_.size(), 0);
    for (Index f = 0; f < from_.num_facets(); ++f) {
      for (int k = 0; k < 3; ++k) used[detail::slot(from_.triangles(f, k))] = 1;
    }
    const std::vector<Index> order = detail::curve_order(from_.vertices);
    constexpr std::size_t kGrain = 1024;
    parallel_for(order.size(), kGrain, options_.threads, [&](std::size_t begin, std::size_t end) {
      Index hint = kNone;
      for (std::size_t i = begin; i < end; ++i) {
        const std::size_t v = detail::slot(order[i]);
        if (used[v] == 0) continue;
        const SurfaceHit hit = tree_.nearest(from_.vertices.row(order[i]).transpose(), hint);
        hint = hit.point.facet;
        at_vertex_[v] = {Vec3::Zero(), hit.distance, hint};
      }
    });
  }

  // ---- Mean and root mean square ----

  /// Cells along an edge of a facet's lattice. The number of cells is its square.
  double lattice_size(Index facet) const { return std::max(1.0, std::ceil(longest_edge(corners_of(from_, facet)) / spacing_)); }

  void integrate() {
    double cells = 0;
    for (Index f = 0; f < from_.num_facets(); ++f) cells += lattice_size(f) * lattice_size(f);
    if (!(cells <= 0x1p39)) {  // a cell has a centre and half a corner of its own
      throw Error(ErrorCode::kTooLarge, "surface distance: the spacing of " + std::to_string(options_.spacing) +
                                            " diagonals would need more than 2^40 points; choose a larger one");
    }
    const auto facets = static_cast<std::size_t>(from_.num_facets());
    constexpr double kCellsAtATime = 2048;
    const auto grain = static_cast<std::size_t>(std::max(1.0, kCellsAtATime * static_cast<double>(facets) / cells));
    std::vector<DistanceSums> sums((facets + grain - 1) / grain);
    upper_.assign(facets, 0);
    parallel_for(facets, grain, options_.threads, [&](std::size_t begin, std::size_t end) {
      DistanceSums& sum = sums[begin / grain];
      std::vector<DistancePoint> above, below;
      for (std::size_t f = begin; f < end; ++f) integrate_facet(static_cast<Index>(f), above, below, sum);
    });

    DistanceSums all;
    for (const DistanceSums& sum : sums) {
      all.mean += sum.mean;
      all.square += sum.square;
      all.mean_change += sum.mean_change;
      all.square_change += sum.square_change;
      farthest_.offer(sum.farthest);
    }
    const double area = total_area(from_);
    result_.mean = all.mean / area;
    result_.mean_error = all.mean_change / area;
    result_.rms = std::sqrt(all.square / area);
    result_.rms_error = result_.rms - std::sqrt(std::max(0.0, all.square - all.square_change) / area);
  }

  /// The facet as a lattice of n² congruent cells. Rows of points are numbered from corner a to the side bc.
  void integrate_facet(Index facet, std::vector<DistancePoint>& above, std::vector<DistancePoint>& below, DistanceSums& sum) {
    const auto n = static_cast<std::int64_t>(lattice_size(facet));
    const auto lattice_point = [&](std::int64_t i, std::int64_t j, Index hint) -> DistancePoint {
      if (i == 0) return corner(facet, 0);
      if (i == n && (j == 0 || j == n)) return corner(facet, j == 0 ? 1 : 2);
      const Vec3 steps(static_cast<double>(n - i), static_cast<double>(i - j), static_cast<double>(j));
      return measure(facet, steps / static_cast<double>(n), hint);
    };
    const std::array<Vec3, 3> x = corners_of(from_, facet);
    const double cell_area = 0.5 * (x[1] - x[0]).cross(x[2] - x[0]).norm() / static_cast<double>(n * n);
    below.assign(1, lattice_point(0, 0, kNone));
    for (const DistancePoint& p : {corner(facet, 0), corner(facet, 1), corner(facet, 2)}) sum.farthest.offer(p, facet);
    for (std::int64_t i = 1; i <= n; ++i) {
      std::swap(above, below);
      below.clear();
      Index hint = above.front().nearest;
      for (std::int64_t j = 0; j <= i; ++j) {
        below.push_back(lattice_point(i, j, hint));
        hint = below.back().nearest;
        sum.farthest.offer(below.back(), facet);
      }
      for (std::size_t j = 0; j < above.size(); ++j) {
        add_cell(facet, {above[j], below[j], below[j + 1]}, cell_area, sum);
        if (j + 1 < above.size()) add_cell(facet, {above[j], below[j + 1], above[j + 1]}, cell_area, sum);
      }
    }
  }

  /// The rule of degree 2 with weights 3/4 at the centroid and 1/12 at the corners. All weights are positive, so no mean is
  /// negative. That of the centroid alone has degree 1; their difference is its error, to leading order.
  void add_cell(Index facet, const std::array<DistancePoint, 3>& corners, double area, DistanceSums& sum) {
    const Vec3 middle = (corners[0].barycentric + corners[1].barycentric + corners[2].barycentric) / 3;
    const DistancePoint centre = measure(facet, middle, corners[0].nearest);
    sum.farthest.offer(centre, facet);
    double mean = 0, square = 0;
    for (const DistancePoint& p : corners) {
      mean += p.distance / 3;
      square += p.distance * p.distance / 3;
    }
    const double at_centre = centre.distance;
    sum.mean += area * (0.75 * at_centre + 0.25 * mean);
    sum.square += area * (0.75 * at_centre * at_centre + 0.25 * square);
    sum.mean_change += area * 0.25 * std::abs(mean - at_centre);
    sum.square_change += area * 0.25 * std::abs(square - at_centre * at_centre);

    // On the way, a bound for the facet as in bound().
    const Vec3 x = position(facet, middle);
    std::array<Vec3, 3> y;
    for (std::size_t k = 0; k < 3; ++k) y[k] = position(facet, corners[k].barycentric);
    double& upper = upper_[detail::slot(facet)];
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t next = (k + 1) % 3;
      const double farthest = std::max({corners[k].distance, corners[next].distance, at_centre});
      upper = std::max(upper, farthest + covering_radius(y[k], y[next], x));
    }
  }

  // ---- The greatest distance ----

  /// Pieces whose bound is at most this need no cut.
  double goal() const { return farthest_.point.distance + tolerance_; }

  /// Cuts the pieces of highest bounds until none exceeds the goal. Batches are taken and returned in one order and made with
  /// the goal as it was before them, so that the number of threads changes nothing.
  void enclose() {
    std::vector<DistancePiece> pieces;  // those of the heap, and free places
    std::vector<std::size_t> free_places;
    std::vector<std::size_t> heap;
    const auto lower_bound = [&pieces](std::size_t a, std::size_t b) {
      return pieces[a].upper != pieces[b].upper ? pieces[a].upper < pieces[b].upper : a > b;
    };
    double settled = 0;  // the highest bound of the pieces given up
    const auto keep = [&](const DistancePiece& piece) {
      if (piece.upper <= goal()) {
        settled = std::max(settled, piece.upper);
        return;
      }
      if (free_places.empty()) {
        free_places.push_back(pieces.size());
        pieces.emplace_back();
      }
      pieces[free_places.back()] = piece;
      heap.push_back(free_places.back());
      free_places.pop_back();
      std::push_heap(heap.begin(), heap.end(), lower_bound);
    };
    for_whole_facets(keep);

    constexpr std::size_t kBatch = 512;
    std::vector<DistancePiece> batch;
    std::vector<CutPiece> cut(kBatch);
    for (std::int64_t cuts = 0; cuts < options_.max_cuts && !heap.empty() && pieces[heap.front()].upper > goal();) {
      batch.clear();
      while (batch.size() < kBatch && !heap.empty() && pieces[heap.front()].upper > goal()) {
        std::pop_heap(heap.begin(), heap.end(), lower_bound);
        batch.push_back(pieces[heap.back()]);
        free_places.push_back(heap.back());
        heap.pop_back();
      }
      constexpr std::size_t kGrain = 64;
      parallel_for(batch.size(), kGrain, options_.threads, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) cut[i] = cut_piece(batch[i]);
      });
      for (std::size_t i = 0; i < batch.size(); ++i) {
        for (const DistancePoint& p : cut[i].made) farthest_.offer(p, batch[i].facet);
      }
      for (std::size_t i = 0; i < batch.size(); ++i) {
        for (int k = 0; k < cut[i].count; ++k) keep(cut[i].parts[static_cast<std::size_t>(k)]);
      }
      cuts += static_cast<std::int64_t>(batch.size());
    }
    if (!heap.empty()) settled = std::max(settled, pieces[heap.front()].upper);
    result_.hausdorff = std::max(settled, farthest_.point.distance);
  }

  template <class Keep>
  void for_whole_facets(const Keep& keep) {
    constexpr std::size_t kSection = 1 << 16;  // bounds the memory of pieces that are given up at once
    const auto facets = static_cast<std::size_t>(from_.num_facets());
    std::vector<DistancePiece> section;
    for (std::size_t first = 0; first < facets; first += kSection) {
      section.resize(std::min(kSection, facets - first));
      constexpr std::size_t kGrain = 1024;
      parallel_for(section.size(), kGrain, options_.threads, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
          const auto f = static_cast<Index>(first + i);
          section[i] = DistancePiece();
          section[i].facet = f;
          section[i].upper = upper_[first + i];
          section[i].corners = {corner(f, 0), corner(f, 1), corner(f, 2)};
          bound(section[i]);
        }
      });
      for (const DistancePiece& piece : section) keep(piece);
    }
  }

  std::array<Vec3, 3> positions(const DistancePiece& piece) const {
    const auto at = [&](std::size_t k) { return position(piece.facet, piece.corners[k].barycentric); };
    return {at(0), at(1), at(2)};
  }

  static double greatest_of(const std::array<DistancePoint, 3>& p) {
    return std::max({p[0].distance, p[1].distance, p[2].distance});
  }

  /// Lowers piece.upper as far as is worth it: to the goal.
  ///
  /// Distance changes by at most 1 per unit of length, so it is at most the greatest at a corner and the covering radius. And
  /// distance to one facet of `to`, a convex set, is a convex function: at most that of the farthest corner.
  void bound(DistancePiece& piece) const {
    if (piece.upper <= goal()) return;
    const std::array<Vec3, 3> x = positions(piece);
    const std::array<DistancePoint, 3>& p = piece.corners;
    piece.upper = std::min(piece.upper, greatest_of(p) + covering_radius(x[0], x[1], x[2]));
    if (piece.upper <= goal()) return;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < 3; ++k) {
      const Index facet = p[k].nearest;
      if ((k > 0 && facet == p[0].nearest) || (k > 1 && facet == p[1].nearest)) continue;
      double greatest = 0;
      int worst = 0;
      for (std::size_t j = 0; j < 3 && greatest < least; ++j) {
        const double d = p[j].nearest == facet ? p[j].distance : tree_.nearest_on_facet(x[j], facet).distance;
        if (d > greatest || j == 0) {
          greatest = d;
          worst = static_cast<int>(j);
        }
      }
      if (greatest < least) {
        least = greatest;
        piece.over = facet;
        piece.worst = worst;
      }
    }
    piece.upper = std::min(piece.upper, least);
  }

  struct CutPiece {
    std::array<DistancePiece, 3> parts;
    int count = 0;
    std::array<DistancePoint, 2> made;  ///< new corners, the second perhaps equal to the first
  };

  CutPiece cut_piece(const DistancePiece& piece) const {
    // A piece much larger than the facet under it would lose a bit of itself to a cut along the facet's border; and as cuts
    // along borders may follow one another without end, every now and then the piece is halved, which settles it in the end:
    // small pieces are within the tolerance.
    constexpr double kTooLarge = 2;
    constexpr int kBorderCuts = 5;
    const std::array<Vec3, 3> x = positions(piece);
    std::array<double, 3> side{};
    // Quarters that would be near enough to their corners are cheaper than any other cut.
    const bool small = greatest_of(piece.corners) + covering_radius(x[0], x[1], x[2]) / 2 <= goal();
    if (!small && piece.border_cuts < kBorderCuts && longest_edge(x) <= kTooLarge * longest_edge(corners_of(to_, piece.over)) &&
        border_sides(piece, x, side)) {
      return cut_in_three(piece, x, side);
    }
    return halve(piece, x);
  }

  /// On which side of the nearest border of the facet under the piece its corners lie: of the plane through the edge that the
  /// worst corner is farthest beyond, upright on the facet. False if that plane does not cut the piece well.
  bool border_sides(const DistancePiece& piece, const std::array<Vec3, 3>& x, std::array<double, 3>& side) const {
    const std::array<Vec3, 3> t = corners_of(to_, piece.over);
    const Vec3 normal = (t[1] - t[0]).cross(t[2] - t[0]);
    double farthest = 0;
    Vec3 inward = Vec3::Zero(), on_border = Vec3::Zero();
    for (std::size_t e = 0; e < 3; ++e) {
      const Vec3 direction = normal.cross(t[(e + 1) % 3] - t[e]);
      const double length = direction.norm();
      if (!(length > 0)) return false;
      const double distance = direction.dot(x[static_cast<std::size_t>(piece.worst)] - t[e]) / length;
      if (distance < farthest) {
        farthest = distance;
        inward = direction / length;
        on_border = t[e];
      }
    }
    if (!(farthest < 0)) return false;
    double least = 0, greatest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      side[k] = inward.dot(x[k] - on_border);
      least = std::min(least, side[k]);
      greatest = std::max(greatest, side[k]);
    }
    constexpr double kSmallestPart = 0.02;
    return std::min(-least, greatest) > kSmallestPart * (greatest - least);
  }

  DistancePoint between(const DistancePiece& piece, std::size_t i, std::size_t j, double t) const {
    const Vec3 barycentric = (1 - t) * piece.corners[i].barycentric + t * piece.corners[j].barycentric;
    return measure(piece.facet, barycentric, piece.corners[t < 0.5 ? i : j].nearest);
  }

  void add_part(CutPiece& cut, const DistancePiece& piece, const DistancePoint& a, const DistancePoint& b, const DistancePoint& c,
                int border_cuts) const {
    DistancePiece& part = cut.parts[static_cast<std::size_t>(cut.count++)];
    part = piece;
    part.corners = {a, b, c};
    part.border_cuts = border_cuts;
    bound(part);
  }

  /// Along a plane with at least one corner on either side: one corner is parted from the other two.
  CutPiece cut_in_three(const DistancePiece& piece, const std::array<Vec3, 3>& x, const std::array<double, 3>& side) const {
    std::size_t alone = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      if ((side[k] > 0) != (side[(k + 1) % 3] > 0) && (side[k] > 0) != (side[(k + 2) % 3] > 0)) alone = k;
    }
    const std::size_t left = (alone + 1) % 3, right = (alone + 2) % 3;
    const double to_left = side[alone] / (side[alone] - side[left]), to_right = side[alone] / (side[alone] - side[right]);
    const DistancePoint on_left = between(piece, alone, left, to_left), on_right = between(piece, alone, right, to_right);
    CutPiece cut;
    cut.made = {on_left, on_right};
    const int cuts = piece.border_cuts + 1;
    const DistancePoint &l = piece.corners[left], &r = piece.corners[right];
    add_part(cut, piece, piece.corners[alone], on_left, on_right, cuts);
    const Vec3 at_left = x[alone] + to_left * (x[left] - x[alone]), at_right = x[alone] + to_right * (x[right] - x[alone]);
    if ((at_left - x[right]).squaredNorm() < (at_right - x[left]).squaredNorm()) {  // the shorter diagonal
      add_part(cut, piece, on_left, l, r, cuts);
      add_part(cut, piece, on_left, r, on_right, cuts);
    } else {
      add_part(cut, piece, on_left, l, on_right, cuts);
      add_part(cut, piece, on_right, l, r, cuts);
    }
    return cut;
  }

  CutPiece halve(const DistancePiece& piece, const std::array<Vec3, 3>& x) const {
    std::size_t longest = 0;
    for (std::size_t k = 1; k < 3; ++k) {
      if ((x[(k + 1) % 3] - x[k]).squaredNorm() > (x[(longest + 1) % 3] - x[longest]).squaredNorm()) longest = k;
    }
    const std::size_t a = longest, b = (longest + 1) % 3, c = (longest + 2) % 3;
    const DistancePoint middle = between(piece, a, b, 0.5);
    CutPiece cut;
    cut.made = {middle, middle};
    add_part(cut, piece, piece.corners[a], middle, piece.corners[c], 0);
    add_part(cut, piece, middle, piece.corners[b], piece.corners[c], 0);
    return cut;
  }

  MeshView from_, to_;
  const SurfaceTree& tree_;  ///< of `to`
  double tolerance_, spacing_;
  const DistanceOptions& options_;
  std::vector<DistancePoint> at_vertex_;
  std::vector<double> upper_;  ///< of each facet: no point of it is farther
  FarthestPoint farthest_;
  OneSidedDistance result_;
};

void require_distance_options(const DistanceOptions& options) {
  if (!(options.tolerance >= 1e-12 && options.tolerance <= 1)) {
    throw Error(ErrorCode::kInvalidArgument, "surface distance: the tolerance, in diagonals of the bounding box, is " +
                                                 std::to_string(options.tolerance) + "; give one in [1e-12, 1]");
  }
  if (!(options.spacing > 0)) {
    throw Error(ErrorCode::kInvalidArgument, "surface distance: the spacing, in diagonals of the bounding box, is " +
                                                 std::to_string(options.spacing) + "; give one above 0");
  }
  if (options.max_cuts < 0) {
    throw Error(ErrorCode::kInvalidArgument, "surface distance: max_cuts is negative; give 0 or more");
  }
}

/// Both meshes times one power of two that brings their coordinates below 1: no square overflows or is lost, and results at any
/// scale are the same bits.
struct ScaledMeshes {
  double scale;
  Mesh first, second;

  ScaledMeshes(const MeshView& a, const MeshView& b) {
    require_usable(a);
    require_usable(b);
    int exponent = 0;
    std::frexp(std::max(a.vertices.cwiseAbs().maxCoeff(), b.vertices.cwiseAbs().maxCoeff()), &exponent);
    scale = std::ldexp(1.0, -std::clamp(exponent, -1022, 1022));
    first = {a.vertices * scale, a.triangles};
    second = {b.vertices * scale, b.triangles};
  }

  void unscale(OneSidedDistance& d) const {
    for (double* value : {&d.hausdorff, &d.hausdorff_lower, &d.mean, &d.rms, &d.mean_error, &d.rms_error}) *value /= scale;
    d.farthest.position /= scale;
  }
};

}  // namespace

DistanceReport surface_distance(const MeshView& first, const MeshView& second, const DistanceOptions& options) {
  require_distance_options(options);
  const ScaledMeshes meshes(first, second);
  DistanceReport report;
  report.diagonal = bounding_box(meshes.first).diagonal();
  report.forward =
      OneSidedMeasure(meshes.first, meshes.second, SurfaceTree(meshes.second), report.diagonal, options).run();
  report.backward =
      OneSidedMeasure(meshes.second, meshes.first, SurfaceTree(meshes.first), report.diagonal, options).run();
  meshes.unscale(report.forward);
  meshes.unscale(report.backward);
  report.diagonal /= meshes.scale;
  return report;
}

OneSidedDistance one_sided_distance(const MeshView& from, const MeshView& to, const DistanceOptions& options) {
  require_distance_options(options);
  const ScaledMeshes meshes(from, to);
  const double diagonal = bounding_box(meshes.first).diagonal();
  OneSidedDistance result = OneSidedMeasure(meshes.first, meshes.second, SurfaceTree(meshes.second), diagonal, options).run();
  meshes.unscale(result);
  return result;
}

std::ostream& operator<<(std::ostream& out, const DistanceReport& report) {
  std::ostringstream text;  // neither the caller's format nor its locale
  text.imbue(std::locale::classic());
  text << std::setprecision(6);
  const auto row = [&](const char* name, double value) {
    text << name << value << " (" << report.percent(value) << " % of the diagonal)";
  };
  row("Hausdorff ", report.hausdorff());
  row(", at least ", report.hausdorff_lower());
  row("\nRMS       ", report.rms());
  row("\nmean      ", report.mean());
  for (const OneSidedDistance* side : {&report.forward, &report.backward}) {
    text << (side == &report.forward ? "\nforward   " : "\nbackward  ") << "Hausdorff " << side->hausdorff << ", RMS " << side->rms
         << ", mean " << side->mean;
  }
  text << "\n";
  return out << text.str();
}

}  // namespace amps
