#define AMPS_OWN_SOURCE
#include "amps/samples.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

namespace amps::detail {

SurfacePoint surface_point_below(const MeshView& mesh, Index facet, const Vec3& x) {
  const Vec3 a = mesh.corner(facet, 0), b = mesh.corner(facet, 1), c = mesh.corner(facet, 2);
  const Vec3 normal = normal_of(mesh, facet);
  Vec3 weight(dot((b - x).cross(c - x), normal), dot((c - x).cross(a - x), normal), dot((a - x).cross(b - x), normal));
  weight = weight.cwiseMax(0.0);
  return surface_point_at(mesh, facet, weight / sum(weight));
}

void require_neighborhood(Neighborhood neighborhood, ConflictRule rule) {
  if (neighborhood != Neighborhood::kSurface || rule == ConflictRule::kMax) return;
  throw Error(ErrorCode::kInvalidArgument,
              "samples: disks that know their surface keep apart by the max rule only; set Neighborhood::kSpace for "
              "ConflictRule::kMin, or leave the rule");
}

void require_sample_set(const SampleSet& samples) {
  if (samples.size() == 0) throw Error(ErrorCode::kInvalidArgument, "samples: the set is empty; give at least one sample");
  if (samples.radii.size() != slot(samples.size())) {
    throw Error(ErrorCode::kInvalidArgument, "samples: " + std::to_string(samples.positions.rows()) + " positions with " +
                                                 std::to_string(samples.radii.size()) + " radii; give one radius a sample");
  }
  const bool placed = !samples.facets.empty() || samples.barycentrics.rows() != 0;
  if (placed && (samples.facets.size() != static_cast<std::size_t>(samples.size()) ||
                 samples.barycentrics.rows() != samples.positions.rows())) {
    throw Error(ErrorCode::kInvalidArgument, "samples: " + std::to_string(samples.positions.rows()) + " positions with " +
                                                 std::to_string(samples.facets.size()) + " facets and " +
                                                 std::to_string(samples.barycentrics.rows()) +
                                                 " barycentrics; give one of each a sample, or neither");
  }
  for (const std::size_t size : {samples.dimensions.size(), samples.curves.size(), samples.parameters.size()}) {
    if (size == samples.dimensions.size() && (size == 0 || size == slot(samples.size()))) continue;
    throw Error(ErrorCode::kInvalidArgument, "samples: " + std::to_string(samples.positions.rows()) + " positions with " +
                                                 std::to_string(size) +
                                                 " dimensions, curves or parameters; give one of each a sample, or none");
  }
  for (Index s = 0; s < samples.size(); ++s) {
    if (!samples.positions.row(s).allFinite() || !(samples.radii[slot(s)] > 0) || !std::isfinite(samples.radii[slot(s)])) {
      throw Error(ErrorCode::kInvalidArgument, "samples: sample " + std::to_string(s) +
                                                   " has a coordinate that is not finite or a radius that is not positive; "
                                                   "remove or repair it");
    }
  }
}

double min_radius(const SampleSet& samples) { return *std::min_element(samples.radii.begin(), samples.radii.end()); }

double max_radius(const SampleSet& samples) { return *std::max_element(samples.radii.begin(), samples.radii.end()); }

std::vector<double> weights_of(const std::vector<double>& radii) {
  std::vector<double> weights;
  weights.reserve(radii.size());
  for (const double r : radii) weights.push_back(r * r);
  return weights;
}

Sample sample_of(const SampleSet& samples, Index s) {
  Sample result;
  if (!samples.facets.empty()) {
    result.at.facet = samples.facets[slot(s)];
    result.at.barycentric = samples.barycentrics.row(s).transpose();
  }
  result.at.position = samples.positions.row(s).transpose();
  result.radius = samples.radii[slot(s)];
  return result;
}

void GrowingSet::add(const Sample& sample) {
  const Vec3 &x = sample.position(), &b = sample.at.barycentric;
  positions_.insert(positions_.end(), {x.x(), x.y(), x.z()});
  barycentrics_.insert(barycentrics_.end(), {b.x(), b.y(), b.z()});
  radii_.push_back(sample.radius);
  facets_.push_back(sample.at.facet);
}

void GrowingSet::add_all(const SampleSet& samples) {
  reserve(slot(size()) + slot(samples.size()));
  for (Index s = 0; s < samples.size(); ++s) add(sample_of(samples, s));
}

void GrowingSet::reserve(std::size_t size) {
  positions_.reserve(3 * size);
  barycentrics_.reserve(3 * size);
  radii_.reserve(size);
  facets_.reserve(size);
}

void GrowingSet::reorder(const std::vector<Index>& order, const Execution& execution) {
  GrowingSet sorted;
  sorted.reserve(order.size() + order.size() / 2);  // gap filling adds a third
  for_each_piece(order.size(), kElementsPerLook, execution, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) sorted.add((*this)[order[k]]);
  });
  *this = std::move(sorted);
}

Sample GrowingSet::operator[](Index s) const {
  return {{facets_[slot(s)], Eigen::Map<const Vec3>(barycentrics_.data() + 3 * slot(s)), position(s)}, radii_[slot(s)]};
}

SampleSet GrowingSet::finish() {
  SampleSet result;
  result.positions = Points(std::move(positions_));
  result.radii = std::move(radii_);
  result.facets = std::move(facets_);
  result.barycentrics = Points(std::move(barycentrics_));
  return result;
}

}  // namespace amps::detail
