#define AMPS_OWN_SOURCE
#include "amps/maximality.h"

#include "amps/disk_set.h"
#include "amps/gaps.h"
#include "amps/kdtree.h"
#include "amps/predicates.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <ostream>
#include <utility>

namespace amps {
namespace detail {
namespace {

/// Of a loop that takes 100 ns a fragment, and some µs for one with a gap.
constexpr std::uint64_t kFragmentsPerLook = 2048;

/// min over all pairs of |p_i − p_j| over the larger radius, or over the smaller one.
///
/// Neighbours in the triangulation are enough where all sites are visible and every two neighbours i, j satisfy d² ≥ max(w_i,
/// w_j), decided exactly. (1) Then p_j lies in its own power cell, which its neighbours bound, so d_ij² − w_i ≥ −w_j for all i,
/// and on the segment between any two sites there is a point x of equal power to both. (2) Let i, j, w_i ≥ w_j, be the pair of
/// least q = d² − max(w_i, w_j), and not neighbours. Some k has less power at x than they. At x the squared distance from p_k
/// is by Stewart's theorem the mean, by the shares of the segment, of those at its ends, less the product of its parts; with q
/// for the pairs (i, k), (j, k) that makes q + mean(max(w_k, w_i), max(w_k, w_j)) < (q − w_j)/2 + w_k, hence q < −w_j, against
/// (1). So all pairs are as they should be. (3) In the same way, if ρ ≥ 1 is the least d/max(r_i, r_j) over all pairs, then a
/// pair that has it are neighbours: with ρ² max(w_k, ·) for the squared distances from p_k both w_k ≤ w_i and w_k > w_i
/// contradict.
class SeparationMeasure {
 public:
  /// `disks`: null for balls.
  SeparationMeasure(const RestrictedPowerDiagram& diagram, ConflictRule rule, const DiskSet* disks)
      : diagram_(diagram), rule_(rule), disks_(disks) {}

  double worst(const Execution& execution) {
    look_at_sites();
    look_at_neighbors(execution.part(0, 0.5));
    const bool apart = all_visible_ &&
                       ((rule_ == ConflictRule::kMax && neighbors_apart_) || (disks_ == nullptr && min_weight_ == max_weight_));
    if (apart) return best_;
    if (disks_ != nullptr) {
      const double conflict = disks_->worst_conflict(execution.part(0.5, 1));
      return std::isfinite(conflict) ? conflict : best_;
    }
    look_at_all_pairs(execution.part(0.5, 1));
    return best_;
  }

 private:
  static constexpr std::size_t kCellsPerPiece = 1 << 12;  // some 0.1 ms

  struct OfCells {
    double best = INFINITY;
    bool apart = true;
  };

  double ratio(const WeightedPoint& p, const WeightedPoint& q) const {
    return norm(p.position() - q.position()) / std::sqrt(kept_apart(rule_, p.w, q.w));
  }

  void look_at_sites() {
    for (Index i = 0; i < diagram_.num_sites(); ++i) {
      if (diagram_.removed(i)) continue;
      min_weight_ = std::min(min_weight_, diagram_.site(i).w);
      max_weight_ = std::max(max_weight_, diagram_.site(i).w);
      all_visible_ = all_visible_ && diagram_.visible(i);
    }
  }

  void look_at_neighbors(const Execution& execution) {
    const std::size_t n = slot(diagram_.cell_capacity());
    std::vector<OfCells> found((n + kCellsPerPiece - 1) / kCellsPerPiece);
    for_each_piece_on_all_threads(n, kCellsPerPiece, execution, [&](std::size_t begin, std::size_t end) {
      found[begin / kCellsPerPiece] = look_at_cells(static_cast<Index>(begin), static_cast<Index>(end));
    });
    for (const OfCells& of_cells : found) {
      best_ = std::min(best_, of_cells.best);
      neighbors_apart_ = neighbors_apart_ && of_cells.apart;
    }
  }

  OfCells look_at_cells(Index begin, Index end) const {
    constexpr double kRounding = 1e-12;  // of the square of a ratio, and far more
    OfCells result;
    double square_limit = INFINITY;  // no pair beyond matters
    diagram_.visit_neighbor_pairs(begin, end, [&](Index i, Index j) {
      const WeightedPoint &p = diagram_.site(i), &q = diagram_.site(j);
      const double larger = std::max(p.w, q.w), square = squared_norm(p.position() - q.position());
      if (square > square_limit * (disks_ != nullptr ? larger : kept_apart(rule_, p.w, q.w))) return;
      if (rule_ == ConflictRule::kMax && square <= larger * (1 + kRounding)) {
        const Vec3 centre = q.position();
        result.apart = result.apart && side_of_ball(&p.x, centre.data(), larger) >= 0;
      }
      if (disks_ == nullptr) {
        result.best = std::min(result.best, ratio(p, q));
      } else {
        const double distance = std::sqrt(square), from_i = distance / std::sqrt(p.w), from_j = distance / std::sqrt(q.w);
        if (from_i < result.best && disks_->reaches_sample(i, j)) result.best = from_i;
        if (from_j < result.best && disks_->reaches_sample(j, i)) result.best = from_j;
      }
      square_limit = std::max(result.best * result.best, 1.0) * (1 + kRounding);
    });
    return result;
  }

  /// Each pair is seen from the disk that counts, within the best ratio so far.
  void look_at_all_pairs(const Execution& execution) {
    std::vector<WeightedPoint> sites;
    for (Index i = 0; i < diagram_.num_sites(); ++i) {
      if (!diagram_.removed(i)) sites.push_back(diagram_.site(i));
    }
    const auto n = static_cast<Index>(sites.size());
    const KdTree tree(PointsView(&sites.data()->x, n, sizeof(WeightedPoint)), execution.part(0, 0.4));
    std::vector<KdTree::Neighbor> found;
    Ticker ticker(execution.part(0.4, 1), sites.size());
    for (Index i = 0; i < n; ++i) {
      ticker.tick();
      const WeightedPoint& p = sites[slot(i)];
      // The bound's own rounding must not lose the pair that set it.
      const double reach = std::min(best_, 1e150) * std::sqrt(p.w) * (1 + 1e-12);
      tree.in_radius(p.position(), reach, found);
      for (const KdTree::Neighbor& near : found) {
        const WeightedPoint& q = sites[slot(near.index)];
        if (near.index != i && kept_apart(rule_, p.w, q.w) == p.w) best_ = std::min(best_, ratio(p, q));
      }
    }
  }

  const RestrictedPowerDiagram& diagram_;
  ConflictRule rule_;
  const DiskSet* disks_;
  double best_ = INFINITY;
  double min_weight_ = INFINITY, max_weight_ = 0;
  bool all_visible_ = true;
  bool neighbors_apart_ = true;
};

}  // namespace

RestrictedPowerDiagram diagram_of(const MeshView& mesh, const SampleSet& samples, const Execution& execution) {
  return diagram_of(mesh, samples, Neighborhood::kSpace, 0, execution).diagram;
}

SetDiagram diagram_of(const MeshView& mesh, const SampleSet& samples, Neighborhood neighborhood, double max_radius,
                      const Execution& execution, const CurveGraph* curves) {
  require_sample_set(samples);
  std::shared_ptr<DiskSet> disks;
  double begin = 0;
  if (neighborhood == Neighborhood::kSurface || curves != nullptr) {
    constexpr double kFloodsShare = 0.2;
    begin = kFloodsShare;
    require_usable(mesh);
    const auto flood = flood_of(mesh, neighborhood, execution.part(0, begin / 2), curves);
    if (flood != nullptr) disks = disks_of(mesh, samples, INFINITY, max_radius, flood, execution.part(begin / 2, begin));
  }
  RestrictedPowerDiagram diagram(mesh, samples.positions, weights_of(samples.radii),
                                 disks == nullptr ? nullptr : disks->reach_lists(), execution.part(begin, 1));
  if (diagram.status() == Outcome::kCancelled) execution.check();
  return {std::move(disks), std::move(diagram)};
}

bool has_gaps(const RestrictedPowerDiagram& diagram, const Execution& execution) {
  Ticker ticker(execution, slot(diagram.fragment_capacity()), kFragmentsPerLook);
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    ticker.tick();
    if (diagram.alive(f) && !diagram.covered(diagram.polygon(f))) return true;
  }
  return false;
}

namespace {

/// What consecutive fragments say of coverage.
struct CoverageOfFragments {
  double worst = 0;  ///< squared
  Vec3 worst_point = Vec3::Zero();
  std::vector<double> gap_areas;
};

CoverageOfFragments coverage_of_fragments(const RestrictedPowerDiagram& diagram, Index begin, Index end) {
  constexpr double kRounding = 1e-12;  // of the ratio of two squares, and far more
  CoverageOfFragments result;
  FragmentGap gap;
  std::vector<Vec3> corners;
  for (Index f = begin; f < end; ++f) {
    if (!diagram.alive(f)) continue;
    const auto polygon = diagram.polygon(f);
    if (polygon.site == kNone) {
      result.worst = INFINITY;
      result.worst_point = polygon.corners[0];
      result.gap_areas.push_back(polygon.area());
      continue;
    }
    // Many fragments are well within what is covered, and their corners need not be fetched.
    const WeightedPoint& site = diagram.site(polygon.site);
    const double reach = diagram.reach(f);
    if (reach * reach * (1 + kRounding) < site.w * std::min(result.worst, 1.0)) continue;
    polygon.list_corners(corners);
    for (const Vec3& x : corners) {
      const double coverage = squared_norm(x - site.position()) / site.w;
      if (!(coverage > result.worst)) continue;
      result.worst = coverage;
      result.worst_point = x;
    }
    if (!diagram.covered(polygon)) result.gap_areas.push_back(gap.assign(diagram, polygon));
  }
  return result;
}

}  // namespace

MaximalityReport measure_maximality(const RestrictedPowerDiagram& diagram, ConflictRule rule, const Execution& execution,
                                    const DiskSet* disks) {
  const Execution run = execution.start("checking coverage and distances");
  constexpr std::size_t kFragmentsPerPiece = 1 << 13;  // some 0.2 ms, and more where there are gaps
  const std::size_t n = slot(diagram.fragment_capacity());
  std::vector<CoverageOfFragments> found((n + kFragmentsPerPiece - 1) / kFragmentsPerPiece);
  for_each_piece_on_all_threads(n, kFragmentsPerPiece, run.part(0, 0.4), [&](std::size_t begin, std::size_t end) {
    found[begin / kFragmentsPerPiece] = coverage_of_fragments(diagram, static_cast<Index>(begin), static_cast<Index>(end));
  });
  MaximalityReport report;
  report.measured = true;
  for (const CoverageOfFragments& part : found) {
    if (part.worst > report.worst_coverage || part.worst == INFINITY) {
      report.worst_coverage = part.worst;
      report.worst_point = part.worst_point;
    }
    report.gaps += static_cast<Index>(part.gap_areas.size());
    for (const double area : part.gap_areas) report.gap_area += area;
  }
  report.worst_coverage = std::sqrt(report.worst_coverage);
  report.worst_separation = SeparationMeasure(diagram, rule, disks).worst(run.part(0.4, 1));
  run.finish();
  return report;
}

}  // namespace detail

MaximalityReport verify_maximal(const MeshView& mesh, const SampleSet& samples, const Execution& execution, ConflictRule rule,
                                Neighborhood neighborhood, const CurveGraph* curves) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    MaximalityReport report = scale.in_our_units([&] {
      return verify_maximal(scale.mesh(mesh), detail::scaled_samples(samples, scale), execution, rule, neighborhood, curves);
    });
    report.gap_area = scale.area_back(report.gap_area);
    return report;
  }
  const Execution run = execution.start();
  detail::require_neighborhood(neighborhood, rule);
  const detail::SetDiagram set = detail::diagram_of(mesh, samples, neighborhood, 0, run.part(0, 0.85), curves);
  const MaximalityReport report = detail::measure_maximality(set.diagram, rule, run.part(0.85, 1), set.disks.get());
  run.finish();
  return report;
}

GapSet find_gaps(const MeshView& mesh, const SampleSet& samples, const Execution& execution, Neighborhood neighborhood,
                 const CurveGraph* curves) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    GapSet result = scale.in_our_units(
        [&] { return find_gaps(scale.mesh(mesh), detail::scaled_samples(samples, scale), execution, neighborhood, curves); });
    scale.back(result.primitives.vertices);
    result.area = scale.area_back(result.area);
    return result;
  }
  const Execution run = execution.start();
  const detail::SetDiagram set = detail::diagram_of(mesh, samples, neighborhood, 0, run.part(0, 0.9), curves);
  const RestrictedPowerDiagram& diagram = set.diagram;
  detail::Ticker ticker(run.part(0.9, 1, "listing gaps"), detail::slot(diagram.fragment_capacity()), detail::kFragmentsPerLook);
  detail::FragmentGap gap;
  GapSet result;
  std::vector<double> corners;
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    ticker.tick();
    const auto polygon = diagram.polygon(f);
    if (!diagram.alive(f) || diagram.covered(polygon)) continue;
    ++result.gaps;
    result.area += gap.assign(diagram, polygon);
    for (std::size_t k = 0; k < gap.num_primitives(); ++k) {
      for (const Vec3& corner : gap.primitive(k)) corners.insert(corners.end(), {corner.x(), corner.y(), corner.z()});
      result.facets.push_back(polygon.facet);
    }
  }
  std::vector<Index> rows(3 * result.facets.size());
  std::iota(rows.begin(), rows.end(), Index{0});
  result.primitives = {Points(std::move(corners)), Triangles(std::move(rows))};
  run.finish();
  return result;
}

std::ostream& operator<<(std::ostream& out, const MaximalityReport& report) {
  return out << "worst coverage " << report.worst_coverage << ", worst separation " << report.worst_separation << ", gaps "
             << report.gaps << " of area " << report.gap_area;
}

}  // namespace amps
