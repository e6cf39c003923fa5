#define AMPS_OWN_SOURCE
#include "amps/surface_distance.h"

#include "amps/execution.h"
#include "amps/mesh_edges.h"
#include "amps/mesh_scale.h"
#include "amps/spatial_sort.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <deque>
#include <iomanip>
#include <limits>
#include <locale>
#include <numeric>
#include <ostream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace amps {
namespace {

/// A point of a facet of `from` with its distance to `to`.
struct DistancePoint {
  Vec3 barycentric = Vec3::Zero();
  double distance = 0;
  Index nearest = kNone;  ///< facet of `to`
};

using DistanceCorners = std::array<DistancePoint, 3>;

/// The greatest distance met so far; of equal ones the first.
struct FarthestPoint {
  DistancePoint point;
  Index facet = kNone;
  void offer(const DistancePoint& p, Index f) {
    if (facet == kNone || p.distance > point.distance) *this = {p, f};
  }
};

/// A triangle within a facet of `from`, whose distances are not yet known well enough.
struct DistancePiece {
  Index facet = kNone;
  DistanceCorners corners;
  double upper = std::numeric_limits<double>::infinity();  ///< none of its points is farther than this
  Index over = kNone;   ///< the facet of `to` with the least greatest distance to the corners, which …
  int worst = 0;        ///< … this corner has
  int border_cuts = 0;  ///< since the last halving
};

/// The greatest distance that a point of a triangle has to its nearest corner. A triangle that is not obtuse has it at its
/// circumcentre; in an obtuse one the bisectors of the two short sides meet the longest side before they meet each other, and
/// it is there. Never less than the truth by more than rounding.
double covering_radius(const Vec3& a, const Vec3& b, const Vec3& c) {
  std::array<double, 3> squares = {detail::squared_norm(b - a), detail::squared_norm(c - b), detail::squared_norm(a - c)};
  std::sort(squares.begin(), squares.end());
  const double p = squares[0], q = squares[1], longest = squares[2];
  const double obtuse = longest - p - q;
  if (obtuse < 0) return std::sqrt(p * q / (4 * p * q - obtuse * obtuse) * longest);
  // The side of square p, at an angle of cosine k to the longest, has its bisector meet that at √p / 2k, and 2k √p √longest =
  // p + longest − q; likewise q. Neither is beyond the middle, which also stands in where rounding leaves nothing to divide by.
  const double length = std::sqrt(longest);
  const auto meets_at = [&](double side, double other) {
    const double projected = side + longest - other;
    if (side == 0) return 0.0;
    return projected > 0 ? side * length / projected : std::numeric_limits<double>::infinity();
  };
  const double from_p = meets_at(p, q), from_q = meets_at(q, p);
  return std::min(length / 2, from_p > from_q ? from_p : from_q);
}

/// The side k, from corner k to the next, that is longest; of sides equal to rounding the first, so that a surface is cut alike
/// at any scale and place.
struct LongestSide {
  std::size_t k = 0;
  double length = 0;
  explicit LongestSide(const std::array<Vec3, 3>& x) {
    constexpr double kLonger = 1 + 1e-9;
    for (std::size_t i = 0; i < 3; ++i) {
      const double l = detail::norm(x[(i + 1) % 3] - x[i]);
      if (l > kLonger * length) {
        length = l;
        k = i;
      }
    }
  }
};

std::array<Vec3, 3> corners_of(const MeshView& mesh, Index facet) {
  return {mesh.corner(facet, 0), mesh.corner(facet, 1), mesh.corner(facet, 2)};
}

double greatest_of(const DistanceCorners& p) { return std::max({p[0].distance, p[1].distance, p[2].distance}); }

/// The range of a job cut into parts in proportion to expected costs.
class TimeShares {
 public:
  TimeShares(const Execution& job, const std::vector<double>& costs) : job_(job), ends_(costs.size() + 1, 0.0) {
    std::partial_sum(costs.begin(), costs.end(), ends_.begin() + 1);
  }
  Execution part(std::size_t i) const { return job_.part(ends_[i] / ends_.back(), ends_[i + 1] / ends_.back()); }

 private:
  const Execution& job_;
  std::vector<double> ends_;
};

/// One direction: vertices first, then the integrals, then cuts where these leave the greatest distance uncertain.
class OneSidedMeasure {
 public:
  OneSidedMeasure(const MeshView& from, const MeshView& to, const SurfaceTree& tree, double diagonal,
                  const DistanceOptions& options)
      : from_(from),
        to_(to),
        tree_(tree),
        tolerance_(options.tolerance * diagonal),
        spacing_(options.spacing * diagonal),
        options_(options) {}

  /// Points farther than `distance`: where there are any, not fewer than one in each piece of a facet under one facet of `to`.
  /// Throws Error(kCancelled) when cancelled.
  std::vector<detail::FarPoint> far_points(double distance, const TimeShares& shares) {
    constexpr double kSlack = 0.01;
    far_ = distance;
    tolerance_ = kSlack * distance;
    measure_vertices(shares.part(1));
    upper_.assign(detail::slot(from_.num_facets()), std::numeric_limits<double>::infinity());
    enclose(shares.part(2));
    return std::move(far_points_);
  }

  /// Shares: those of the search tree, of measuring and of cutting. Throws Error(kCancelled) when cancelled.
  OneSidedDistance run(const TimeShares& shares) {
    const Execution measuring = shares.part(1);
    measure_vertices(measuring.part(0, 0.4));
    integrate(measuring.part(0.4, 1));
    enclose(shares.part(2));
    const FarthestPoint& p = farthest_;
    result_.hausdorff_lower = p.point.distance;
    result_.farthest = {p.facet, p.point.barycentric, position(p.facet, p.point.barycentric)};
    return result_;
  }

 private:
  Vec3 position(Index facet, const Vec3& barycentric) const {
    return barycentric[0] * from_.corner(facet, 0) + barycentric[1] * from_.corner(facet, 1) +
           barycentric[2] * from_.corner(facet, 2);
  }

  std::array<Vec3, 3> positions(Index facet, const DistanceCorners& p) const {
    return {position(facet, p[0].barycentric), position(facet, p[1].barycentric), position(facet, p[2].barycentric)};
  }

  DistancePoint measure(Index facet, const Vec3& barycentric, Index hint) const {
    const SurfaceHit hit = tree_.nearest(position(facet, barycentric), hint);
    return {barycentric, hit.distance, hit.point.facet};
  }

  DistanceCorners facet_corners(Index facet) const {
    DistanceCorners p;
    for (int k = 0; k < 3; ++k) {
      p[static_cast<std::size_t>(k)] = at_vertex_[detail::slot(from_.triangles(facet, k))];
      p[static_cast<std::size_t>(k)].barycentric[k] = 1;
    }
    return p;
  }

  /// Distances of all vertices. Along a curve, so that each starts from the facet nearest to its neighbour.
  void measure_vertices(const Execution& execution) {
    at_vertex_.resize(detail::slot(from_.num_vertices()));
    const std::vector<Index> order = detail::curve_order(from_.vertices, execution.part(0, 0.2));
    constexpr std::size_t kGrain = 1024;
    detail::for_each_piece_on_all_threads(order.size(), kGrain, execution.part(0.2, 1),
                                          [&](std::size_t begin, std::size_t end) {
                                            Index hint = kNone;
                                            for (std::size_t i = begin; i < end; ++i) {
                                              const SurfaceHit hit = tree_.nearest(from_.vertices[order[i]], hint);
                                              hint = hit.point.facet;
                                              at_vertex_[detail::slot(order[i])] = {Vec3::Zero(), hit.distance, hint};
                                            }
                                          });
  }

  struct Sums {
    double mean = 0, square = 0;                ///< ∫ d, ∫ d²
    double mean_change = 0, square_change = 0;  ///< sums of what a rule of lower degree changes in each cell
    FarthestPoint farthest;
    std::uint64_t cells_untold = 0;  ///< not yet counted as work done
  };

  void integrate(const Execution& execution) {
    const std::size_t facets = detail::slot(from_.num_facets());
    constexpr std::size_t kGrain = 64;
    std::vector<Sums> sums((facets + kGrain - 1) / kGrain);
    upper_.assign(facets, 0);
    const double area = total_area(from_, execution.part(0, 0.03));
    const std::vector<Index> repeated = detail::find_repeated_facets(from_, execution.part(0.03, 0.05));
    // Halving leaves cells of a fifth of the squared spacing, as a mean.
    const double cells = std::min(5 * area / (spacing_ * spacing_), 1e18);
    detail::WorkCounter counter(execution.part(0.05, 1), facets + static_cast<std::uint64_t>(cells));
    counter_ = &counter;
    parallel_for(facets, kGrain, execution, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const auto f = static_cast<Index>(i);
        if (std::binary_search(repeated.begin(), repeated.end(), f)) continue;  // its points are those of another facet
        const std::array<Vec3, 3> x = corners_of(from_, f);
        integrate(f, facet_corners(f), 0.5 * detail::norm((x[1] - x[0]).cross(x[2] - x[0])), sums[begin / kGrain]);
      }
      tell_cells(sums[begin / kGrain]);
    });
    Sums all;
    for (const Sums& sum : sums) {
      all.mean += sum.mean;
      all.square += sum.square;
      all.mean_change += sum.mean_change;
      all.square_change += sum.square_change;
      farthest_.offer(sum.farthest.point, sum.farthest.facet);
    }
    result_.mean = all.mean / area;
    result_.mean_error = all.mean_change / area;
    result_.rms = std::sqrt(all.square / area);
    result_.rms_error = result_.rms - std::sqrt(std::max(0.0, all.square - all.square_change) / area);
  }

  /// Halves a triangle of a facet at its longest side until that is within the spacing: few cells on slivers, too.
  void integrate(Index facet, const DistanceCorners& p, double area, Sums& sums) {
    // Measured from a corner of the facet, so that roundings are those of its size and the halving ends wherever it lies.
    const Vec3 ab = from_.corner(facet, 1) - from_.corner(facet, 0), ac = from_.corner(facet, 2) - from_.corner(facet, 0);
    std::array<Vec3, 3> x;
    for (std::size_t k = 0; k < 3; ++k) x[k] = p[k].barycentric[1] * ab + p[k].barycentric[2] * ac;
    const LongestSide side(x);
    if (side.length <= spacing_) {
      add_cell(facet, p, area, sums);
      return;
    }
    const DistancePoint &a = p[side.k], &b = p[(side.k + 1) % 3], &c = p[(side.k + 2) % 3];
    const DistancePoint middle = measure(facet, (a.barycentric + b.barycentric) / 2, a.nearest);
    integrate(facet, {a, middle, c}, area / 2, sums);
    integrate(facet, {middle, b, c}, area / 2, sums);
  }

  void tell_cells(Sums& sums) { counter_->add(std::exchange(sums.cells_untold, 0)); }

  /// The rule of degree 2 with weights 3/4 at the centroid and 1/12 at the corners. All weights are positive, so no mean is
  /// negative. That of the centroid alone has degree 1; their difference is its error, to leading order.
  void add_cell(Index facet, const DistanceCorners& corners, double area, Sums& sums) {
    const Vec3 middle = (corners[0].barycentric + corners[1].barycentric + corners[2].barycentric) / 3;
    const DistancePoint centre = measure(facet, middle, corners[0].nearest);
    double mean = 0, square = 0;
    for (const DistancePoint& p : corners) {
      sums.farthest.offer(p, facet);
      mean += p.distance / 3;
      square += p.distance * p.distance / 3;
    }
    sums.farthest.offer(centre, facet);
    constexpr std::uint64_t kCellsPerLook = 256;
    if (++sums.cells_untold == kCellsPerLook) tell_cells(sums);
    const double at_centre = centre.distance;
    sums.mean += area * (0.75 * at_centre + 0.25 * mean);
    sums.square += area * (0.75 * at_centre * at_centre + 0.25 * square);
    sums.mean_change += area * 0.25 * std::abs(mean - at_centre);
    sums.square_change += area * 0.25 * std::abs(square - at_centre * at_centre);

    // On the way, a bound for the facet, as in bound().
    const Vec3 x = position(facet, middle);
    const std::array<Vec3, 3> y = positions(facet, corners);
    double& upper = upper_[detail::slot(facet)];
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t next = (k + 1) % 3;
      const double farthest = std::max({corners[k].distance, corners[next].distance, at_centre});
      upper = std::max(upper, farthest + covering_radius(y[k], y[next], x));
    }
  }

  /// Pieces whose bound is at most this need no cut.
  double goal() const { return (far_ > 0 ? far_ : farthest_.point.distance) + tolerance_; }

  /// Cuts pieces until no bound exceeds the goal. They queue, and are cut in batches with the goal as it was before: so the
  /// number of threads changes nothing. (First come, first served: the best first would save nothing, for the sampling of
  /// integrate() has the lower bound close to its end, and with it the pieces that must be cut.)
  void enclose(const Execution& execution) {
    std::deque<DistancePiece> queue;
    double settled = 0;  // the highest bound of the pieces that need no cut
    const auto keep = [&](const DistancePiece& piece) {
      if (far_ > 0 && greatest_of(piece.corners) > far_) {
        list_far_points(piece);
      } else if (piece.upper > goal()) {
        queue.push_back(piece);
      } else {
        settled = std::max(settled, piece.upper);
      }
    };
    constexpr double kListed = 0.05;  // of the time
    detail::for_each_index(from_.num_facets(), execution.part(0, kListed), [&](Index f) {
      DistancePiece piece;
      piece.facet = f;
      piece.corners = facet_corners(f);
      piece.upper = upper_[detail::slot(f)];
      bound(piece);
      keep(piece);
    });
    const Execution cutting = execution.part(kListed, 1);
    constexpr std::size_t kBatch = 8192, kGrain = 64;
    std::vector<CutPiece> cut;
    double done = 0, parted = 0;
    for (std::int64_t left = options_.max_cuts; left > 0 && !queue.empty();) {
      const std::size_t n = std::min({kBatch, queue.size(), static_cast<std::size_t>(left)});
      cut.resize(std::max(cut.size(), n));
      // As if on and on a cut left as many parts to cut as it did so far (a geometric series), but no more than surfaces take
      // that coincide: about ten cuts for each facet of the other (measured).
      constexpr double kMaxRatio = 0.95, kMaxCuts = 10;
      const double waiting = static_cast<double>(queue.size());
      const double ratio = done > 0 ? std::min(parted / done, kMaxRatio) : kMaxRatio;
      const double left_to_do = std::min(waiting / (1 - ratio), std::max(kMaxCuts * to_.num_facets() - done, waiting));
      const double fraction = done / (done + left_to_do);
      parallel_for(n, kGrain, execution, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) cut[i] = cut_piece(queue[i]);
        cutting.report(fraction);
      });
      queue.erase(queue.begin(), queue.begin() + static_cast<std::ptrdiff_t>(n));
      for (std::size_t i = 0; i < n; ++i) {
        for (const DistancePiece& part : cut[i].parts) {
          for (const DistancePoint& p : part.corners) farthest_.offer(p, part.facet);
        }
      }
      const std::size_t uncut = queue.size();
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t k = 0; k < cut[i].count; ++k) keep(cut[i].parts[k]);
      }
      left -= static_cast<std::int64_t>(n);
      done += static_cast<double>(n);
      parted += static_cast<double>(queue.size() - uncut);
    }
    for (const DistancePiece& piece : queue) settled = std::max(settled, piece.upper);
    result_.hausdorff = std::max(settled, farthest_.point.distance);
  }

  void list_far_points(const DistancePiece& piece) {
    for (const DistancePoint& p : piece.corners) {
      if (p.distance > far_) far_points_.push_back({piece.facet, p.nearest, p.distance, position(piece.facet, p.barycentric)});
    }
  }

  /// Lowers piece.upper as far as is worth it: to the goal.
  ///
  /// Distance changes by at most 1 per unit of length, so it is at most the greatest at a corner and the covering radius. And
  /// distance to one facet of `to`, a convex set, is a convex function: at most that of the farthest corner.
  void bound(DistancePiece& piece) const {
    if (piece.upper <= goal()) return;
    const std::array<Vec3, 3> x = positions(piece.facet, piece.corners);
    const DistanceCorners& p = piece.corners;
    piece.upper = std::min(piece.upper, greatest_of(p) + covering_radius(x[0], x[1], x[2]));
    if (piece.upper <= goal()) return;
    double min_bound = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < 3; ++k) {
      const Index facet = p[k].nearest;
      if ((k > 0 && facet == p[0].nearest) || (k > 1 && facet == p[1].nearest)) continue;
      double max_bound = -1;
      int worst = 0;
      for (std::size_t j = 0; j < 3 && max_bound < min_bound; ++j) {
        const double d = p[j].nearest == facet ? p[j].distance : tree_.nearest_on_facet(x[j], facet).distance;
        if (d > max_bound) {
          max_bound = d;
          worst = static_cast<int>(j);
        }
      }
      if (max_bound < min_bound) {
        min_bound = max_bound;
        piece.over = facet;
        piece.worst = worst;
      }
    }
    piece.upper = std::min(piece.upper, min_bound);
  }

  struct CutPiece {
    std::array<DistancePiece, 3> parts;
    std::size_t count = 0;
    void add(const DistancePiece& piece, const DistanceCorners& corners) {
      parts[count] = piece;
      parts[count++].corners = corners;
    }
  };

  /// The piece in parts, with their bounds; the piece itself if it needs no cut any more.
  CutPiece cut_piece(const DistancePiece& piece) const {
    CutPiece cut;
    if (piece.upper <= goal()) {
      cut.add(piece, piece.corners);
      return cut;
    }
    // A piece much larger than the facet under it would lose only a bit of itself to a cut along the facet's border. And cuts
    // along borders might follow one another without end, so now and then the piece is halved: small pieces are settled.
    constexpr double kTooLarge = 2;
    constexpr int kBorderCuts = 5;
    const std::array<Vec3, 3> x = positions(piece.facet, piece.corners);
    const LongestSide longest(x);
    std::array<double, 3> side{};
    if (piece.border_cuts < kBorderCuts && longest.length <= kTooLarge * LongestSide(corners_of(to_, piece.over)).length &&
        border_sides(piece, x, side)) {
      cut_along_border(piece, x, side, cut);
      for (std::size_t k = 0; k < cut.count; ++k) cut.parts[k].border_cuts = piece.border_cuts + 1;
    } else if (across_sides(x, longest, side)) {
      cut_along_border(piece, x, side, cut);
      for (std::size_t k = 0; k < cut.count; ++k) cut.parts[k].border_cuts = 0;
    } else {
      const DistancePoint &a = piece.corners[longest.k], &b = piece.corners[(longest.k + 1) % 3],
                          &c = piece.corners[(longest.k + 2) % 3];
      const DistancePoint middle = measure(piece.facet, (a.barycentric + b.barycentric) / 2, a.nearest);
      cut.add(piece, {a, middle, c});
      cut.add(piece, {middle, b, c});
      for (std::size_t k = 0; k < cut.count; ++k) cut.parts[k].border_cuts = 0;
    }
    for (std::size_t k = 0; k < cut.count; ++k) bound(cut.parts[k]);
    return cut;
  }

  /// On which side of the middle of its longest side the corners of a needle lie, along that side: halves would be as slender,
  /// and as many as the square of its length asks for. False if it is no needle, or its third corner is near the middle.
  static bool across_sides(const std::array<Vec3, 3>& x, const LongestSide& longest, std::array<double, 3>& side) {
    constexpr double kNeedle = 8, kNearMiddle = 0.1;
    const Vec3 along = x[(longest.k + 1) % 3] - x[longest.k], other = x[(longest.k + 2) % 3] - x[longest.k];
    const double square = detail::squared_norm(along);
    if (!(square > kNeedle * detail::norm(along.cross(other)))) return false;
    const Vec3 middle = x[longest.k] + along / 2;
    for (std::size_t k = 0; k < 3; ++k) side[k] = detail::dot(along, x[k] - middle);
    return std::fabs(side[(longest.k + 2) % 3]) > kNearMiddle * square;
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
      const double length = detail::norm(direction);
      if (!(length > 0)) return false;
      const double distance = detail::dot(direction, x[static_cast<std::size_t>(piece.worst)] - t[e]) / length;
      if (distance < farthest) {
        farthest = distance;
        inward = direction / length;
        on_border = t[e];
      }
    }
    if (!(farthest < 0)) return false;
    double min_side = 0, max_side = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      side[k] = detail::dot(inward, x[k] - on_border);
      min_side = std::min(min_side, side[k]);
      max_side = std::max(max_side, side[k]);
    }
    constexpr double kSmallestPart = 0.02;
    return std::min(-min_side, max_side) > kSmallestPart * (max_side - min_side);
  }

  /// In three, one corner parted from the other two by a plane they are on either `side` of.
  void cut_along_border(const DistancePiece& piece, const std::array<Vec3, 3>& x, const std::array<double, 3>& side,
                        CutPiece& cut) const {
    std::size_t alone = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      if ((side[k] > 0) != (side[(k + 1) % 3] > 0) && (side[k] > 0) != (side[(k + 2) % 3] > 0)) alone = k;
    }
    const std::size_t left = (alone + 1) % 3, right = (alone + 2) % 3;
    const auto crossing = [&](std::size_t other) {
      const DistancePoint &a = piece.corners[alone], &b = piece.corners[other];
      const double t = side[alone] / (side[alone] - side[other]);
      return measure(piece.facet, (1 - t) * a.barycentric + t * b.barycentric, t < 0.5 ? a.nearest : b.nearest);
    };
    const DistancePoint on_left = crossing(left), on_right = crossing(right);
    const DistancePoint &l = piece.corners[left], &r = piece.corners[right];
    cut.add(piece, {piece.corners[alone], on_left, on_right});
    const Vec3 at_left = position(piece.facet, on_left.barycentric), at_right = position(piece.facet, on_right.barycentric);
    if (detail::squared_norm(at_left - x[right]) < detail::squared_norm(at_right - x[left])) {  // the shorter diagonal
      cut.add(piece, {on_left, l, r});
      cut.add(piece, {on_left, r, on_right});
    } else {
      cut.add(piece, {on_left, l, on_right});
      cut.add(piece, {on_right, l, r});
    }
  }

  MeshView from_, to_;
  const SurfaceTree& tree_;  ///< of `to`
  double tolerance_, spacing_;
  const DistanceOptions& options_;
  std::vector<DistancePoint> at_vertex_;
  std::vector<double> upper_;  ///< of each facet: no point of it is farther
  FarthestPoint farthest_;
  double far_ = 0;  ///< points farther than this are listed, instead; 0: none
  std::vector<detail::FarPoint> far_points_;
  detail::WorkCounter* counter_ = nullptr;  ///< of cells, while integrate() runs
  OneSidedDistance result_;
};

void require_distance_options(const DistanceOptions& options) {
  if (!(options.tolerance >= 1e-12 && options.tolerance <= 1)) {
    throw Error(ErrorCode::kInvalidArgument, "surface distance: the tolerance, in diagonals of the bounding box, is " +
                                                 detail::number_text(options.tolerance) + "; give one in [1e-12, 1]");
  }
  if (!(options.spacing >= 1e-6 && options.spacing <= 1)) {
    throw Error(ErrorCode::kInvalidArgument, "surface distance: the spacing, in diagonals of the bounding box, is " +
                                                 detail::number_text(options.spacing) + "; give one in [1e-6, 1]");
  }
  if (options.max_cuts < 0) {
    throw Error(ErrorCode::kInvalidArgument, "surface distance: max_cuts is negative; give 0 or more");
  }
}

/// Both meshes without isolated vertices, in one unit.
struct ScaledMeshes {
  detail::MeshScale scale;
  Mesh first, second;

  ScaledMeshes(const MeshView& a, const MeshView& b, const Execution& execution) {
    require_usable(a, execution.part(0, 0.25));
    require_usable(b, execution.part(0.25, 0.5));
    first = remove_isolated_vertices(a, execution.part(0.5, 0.75));
    second = remove_isolated_vertices(b, execution.part(0.75, 1));
    scale = detail::MeshScale(first, second);
    if (scale.is_one()) return;
    for (Mesh* mesh : {&first, &second}) mesh->vertices = scale.points(mesh->vertices);
  }

  void unscale(OneSidedDistance& d) const {
    for (double* value : {&d.hausdorff, &d.hausdorff_lower, &d.mean, &d.rms, &d.mean_error, &d.rms_error}) scale.back(*value);
    d.farthest.position *= scale.unit();
  }
};

constexpr const char* kDistanceStage = "measuring distances";

/// Nanoseconds, roughly, to foresee time (measured: spheres of 4·10³ to 2·10⁶ facets, near each other). Where the surfaces are
/// (nearly) the same, triangles are cut until each lies under one facet of the other: there are as many as that has facets.
struct OneSidedCost {
  double tree, measure, cut;

  /// From n facets to m facets.
  OneSidedCost(double n, double m, const DistanceOptions& options) {
    const double workers = options.execution.workers(), cells = n + 5 / (options.spacing * options.spacing);
    tree = 500 * m;
    measure = 1500 * cells / workers;
    cut = (500 * n + 15000 * m) / workers;
  }
  double all() const { return tree + measure + cut; }
};
constexpr double kPrepareCost = 100;  ///< a facet

OneSidedDistance measure_one_side(const Mesh& from, const Mesh& to, double diagonal, const DistanceOptions& options,
                                  const Execution& execution) {
  const OneSidedCost cost(static_cast<double>(from.triangles.rows()), static_cast<double>(to.triangles.rows()), options);
  const TimeShares shares(execution, {cost.tree, cost.measure, cost.cut});
  const SurfaceTree tree(to, shares.part(0));
  return OneSidedMeasure(from, to, tree, diagonal, options).run(shares);
}

}  // namespace

DistanceReport surface_distance(const MeshView& first, const MeshView& second, const DistanceOptions& options) {
  require_distance_options(options);
  const Execution job = options.execution.start(kDistanceStage);
  const double n = first.num_facets(), m = second.num_facets();
  const TimeShares shares(job, {kPrepareCost * (n + m), OneSidedCost(n, m, options).all(), OneSidedCost(m, n, options).all()});
  const ScaledMeshes meshes(first, second, shares.part(0));
  DistanceReport report;
  report.diagonal = bounding_box(meshes.first).diagonal();
  report.forward = measure_one_side(meshes.first, meshes.second, report.diagonal, options, shares.part(1));
  report.backward = measure_one_side(meshes.second, meshes.first, report.diagonal, options, shares.part(2));
  meshes.unscale(report.forward);
  meshes.unscale(report.backward);
  meshes.scale.back(report.diagonal);
  job.finish();
  return report;
}

OneSidedDistance one_sided_distance(const MeshView& from, const MeshView& to, const DistanceOptions& options) {
  require_distance_options(options);
  const Execution job = options.execution.start(kDistanceStage);
  const double n = from.num_facets(), m = to.num_facets();
  const TimeShares shares(job, {kPrepareCost * (n + m), OneSidedCost(n, m, options).all()});
  const ScaledMeshes meshes(from, to, shares.part(0));
  const double diagonal = bounding_box(meshes.first).diagonal();
  OneSidedDistance result = measure_one_side(meshes.first, meshes.second, diagonal, options, shares.part(1));
  meshes.unscale(result);
  job.finish();
  return result;
}

namespace detail {

std::vector<FarPoint> far_points(const MeshView& from, const MeshView& to, const SurfaceTree& tree, double distance,
                                 const Execution& execution) {
  DistanceOptions options;
  options.execution = execution;
  const OneSidedCost cost(from.num_facets(), to.num_facets(), options);
  const TimeShares shares(execution, {0, cost.measure, cost.cut});
  return OneSidedMeasure(from, to, tree, 0, options).far_points(distance, shares);
}

}  // namespace detail

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
    text << (side == &report.forward ? "\nforward   " : "\nbackward  ") << "Hausdorff " << side->hausdorff << ", RMS "
         << side->rms << ", mean " << side->mean;
  }
  text << "\n";
  return out << text.str();
}

}  // namespace amps
