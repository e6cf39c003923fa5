#define AMPS_OWN_SOURCE
#include "amps/maximality.h"

#include "amps/gaps.h"
#include "amps/kdtree.h"
#include "amps/predicates.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <ostream>
#include <utility>

namespace amps {
namespace detail {
namespace {

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
  SeparationMeasure(const RestrictedPowerDiagram& diagram, ConflictRule rule) : diagram_(diagram), rule_(rule) {}

  double worst() {
    look_at_neighbors();
    const bool known = all_visible_ && ((rule_ == ConflictRule::kMax && neighbors_apart_) || min_weight_ == max_weight_);
    if (!known) look_at_all_pairs();
    return best_;
  }

 private:
  double ratio(const WeightedPoint& p, const WeightedPoint& q) const {
    return (p.position() - q.position()).norm() / std::sqrt(kept_apart(rule_, p.w, q.w));
  }

  void look_at_neighbors() {
    const RegularTriangulation::Adjacency around = diagram_.adjacency();
    for (Index i = 0; i < diagram_.num_sites(); ++i) {
      if (diagram_.removed(i)) continue;
      const WeightedPoint& p = diagram_.site(i);
      min_weight_ = std::min(min_weight_, p.w);
      max_weight_ = std::max(max_weight_, p.w);
      all_visible_ = all_visible_ && diagram_.visible(i);
      for (Index k = around.offset[slot(i)]; k < around.offset[slot(i) + 1]; ++k) {
        if (around.adjacent[slot(k)] < i) continue;
        const WeightedPoint& q = diagram_.site(around.adjacent[slot(k)]);
        const double between = ratio(p, q);
        best_ = std::min(best_, between);
        constexpr double kRounding = 1e-14;  // of the ratio
        if (between > 1 + kRounding) continue;
        const Vec3 centre = q.position();
        neighbors_apart_ = neighbors_apart_ && side_of_ball(&p.x, centre.data(), std::max(p.w, q.w)) >= 0;
      }
    }
  }

  /// Each pair is seen from the disk that counts, within the best ratio so far.
  void look_at_all_pairs() {
    std::vector<WeightedPoint> sites;
    for (Index i = 0; i < diagram_.num_sites(); ++i) {
      if (!diagram_.removed(i)) sites.push_back(diagram_.site(i));
    }
    const auto n = static_cast<Index>(sites.size());
    const KdTree tree(PointsView(&sites.data()->x, n, sizeof(WeightedPoint)));
    std::vector<KdTree::Neighbor> found;
    for (Index i = 0; i < n; ++i) {
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
  double best_ = INFINITY;
  double min_weight_ = INFINITY, max_weight_ = 0;
  bool all_visible_ = true;
  bool neighbors_apart_ = true;
};

}  // namespace

RestrictedPowerDiagram diagram_of(const MeshView& mesh, const SampleSet& samples, unsigned threads) {
  require_sample_set(samples);
  return {mesh, samples.positions, weights_of(samples.radii), threads};
}

MaximalityReport measure_maximality(const RestrictedPowerDiagram& diagram, ConflictRule rule) {
  MaximalityReport report;
  FragmentGap gap;
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    if (!diagram.alive(f)) continue;
    const auto polygon = diagram.polygon(f);
    const WeightedPoint& site = diagram.site(polygon.site);
    for (Index k = 0; k < polygon.size; ++k) {
      report.worst_coverage = std::max(report.worst_coverage, (polygon.corners[k] - site.position()).squaredNorm() / site.w);
    }
    if (diagram.covered(polygon)) continue;
    ++report.gaps;
    report.gap_area += gap.assign(diagram, polygon);
  }
  report.worst_coverage = std::sqrt(report.worst_coverage);
  report.worst_separation = SeparationMeasure(diagram, rule).worst();
  return report;
}

}  // namespace detail

MaximalityReport verify_maximal(const MeshView& mesh, const SampleSet& samples, unsigned threads, ConflictRule rule) {
  return detail::measure_maximality(detail::diagram_of(mesh, samples, threads), rule);
}

GapSet find_gaps(const MeshView& mesh, const SampleSet& samples, unsigned threads) {
  const RestrictedPowerDiagram diagram = detail::diagram_of(mesh, samples, threads);
  detail::FragmentGap gap;
  GapSet result;
  std::vector<double> corners;
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
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
  return result;
}

std::ostream& operator<<(std::ostream& out, const MaximalityReport& report) {
  return out << "worst coverage " << report.worst_coverage << ", worst separation " << report.worst_separation << ", gaps "
             << report.gaps << " of area " << report.gap_area;
}

}  // namespace amps
