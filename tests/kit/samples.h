// samples.h: options of sampling, radii and sample sets as tests want them, and what can be done to a set.
#pragma once

#include "points.h"
#include "random.h"

#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/sizing.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numeric>
#include <utility>
#include <vector>

namespace amps_test {

using amps::ConflictRule;
using amps::SampleSet;
using amps::SamplingOptions;
using amps::SamplingResult;
using amps::SizingField;

// Options.

inline SamplingOptions with_radius(double radius, std::uint64_t seed = 1) {
  SamplingOptions options;
  options.radius = radius;
  options.seed = seed;
  return options;
}

inline SamplingOptions with_count(Index count, std::uint64_t seed = 1) {
  SamplingOptions options;
  options.target_count = count;
  options.seed = seed;
  return options;
}

inline SamplingOptions with_sizing(const SizingField& field, std::uint64_t seed = 1, ConflictRule rule = ConflictRule::kMax) {
  SamplingOptions options;
  options.sizing = field;
  options.seed = seed;
  options.conflict_rule = rule;
  return options;
}

/// Remeshing without optimisation.
inline amps::RemeshOptions plain(const SamplingOptions& sampling) {
  amps::RemeshOptions options;
  options.optimize = false;
  options.sampling = sampling;
  return options;
}

/// The same without curves: creases and borders are sampled like everything else.
inline amps::RemeshOptions without_curves(amps::RemeshOptions options) {
  options.curves.creases = options.curves.borders = false;
  return options;
}

// Radii.

inline Values at_vertices(const Mesh& mesh, const std::function<double(const Vec3&)>& f) {
  return made_values(rows(mesh.vertices), [&](Index v) { return f(point_at(mesh.vertices, v)); });
}

/// From 1 to `ratio` along an axis.
inline Values graded_radii(const Mesh& mesh, double ratio, int axis) {
  const amps::Box box = amps::bounding_box(mesh);
  return at_vertices(mesh, [&](const Vec3& x) {
    const double radius = 1 + (ratio - 1) * (x[axis] - box.min[axis]) / (box.max[axis] - box.min[axis]);
    return std::clamp(radius, 1.0, ratio);  // isolated vertices may lie outside
  });
}

inline int longest_axis(const Mesh& mesh) {
  const amps::Box box = amps::bounding_box(mesh);
  int axis = 0;
  (box.max - box.min).maxCoeff(&axis);
  return axis;
}

/// Scaled so that about `count` samples come of it.
inline SizingField for_about(const SizingField& field, double count) { return field.scaled(amps::count_factor(field, count)); }

/// Radii from 1 to `ratio` along the longest axis, then scaled so that about `count` samples come of it.
inline SizingField graded_field(const Mesh& mesh, double ratio, double count) {
  return for_about(amps::vertex_sizing(mesh, graded_radii(mesh, ratio, longest_axis(mesh))), count);
}

/// Radii that leap from vertex to vertex by factors of up to `ratio`.
inline SizingField wild_field(const Mesh& mesh, double ratio, double count, std::uint64_t seed) {
  Rng rng(seed);
  return for_about(amps::vertex_sizing(mesh, at_vertices(mesh, [&](const Vec3&) { return std::pow(ratio, rng.uniform()); })),
                   count);
}

// Sets.

/// Without facets and barycentric coordinates.
inline SampleSet bare_set(const Points& positions, const Values& radii) { return {positions, radii, {}, {}}; }

inline SampleSet one_sample(const Vec3& position, double radius) {
  return bare_set(points_of({position}), constant_values(1, radius));
}

inline Vec3 sample_at(const SampleSet& set, Index s) { return point_at(set.positions, s); }

inline Index facet_of(const SampleSet& set, Index s) { return set.facets[at(s)]; }

inline Vec3 barycentric_of(const SampleSet& set, Index s) { return point_at(set.barycentrics, s); }

inline SampleSet chosen(const SampleSet& set, const std::vector<Index>& samples) {
  SampleSet result = bare_set(chosen(set.positions, samples), chosen(set.radii, samples));
  if (set.facets.empty()) return result;
  for (const Index s : samples) result.facets.push_back(facet_of(set, s));
  result.barycentrics = chosen(set.barycentrics, samples);
  return result;
}

/// Those that `keep(s)` wants.
template <class Keep>
SampleSet selected(const SampleSet& set, const Keep& keep) {
  std::vector<Index> samples;
  for (Index s = 0; s < set.size(); ++s) {
    if (keep(s)) samples.push_back(s);
  }
  return chosen(set, samples);
}

inline SampleSet head(const SampleSet& set, Index n) { return chosen(set, all_indices(n)); }

inline SampleSet sorted_by_position(const SampleSet& set) {
  std::vector<Index> samples = all_indices(set.size());
  std::sort(samples.begin(), samples.end(), [&](Index a, Index b) {
    const Vec3 x = sample_at(set, a), y = sample_at(set, b);
    return std::lexicographical_compare(x.data(), x.data() + 3, y.data(), y.data() + 3);
  });
  return chosen(set, samples);
}

inline bool same_set(const SampleSet& a, const SampleSet& b) {
  return same_bits(a.positions, b.positions) && same_bits(a.barycentrics, b.barycentrics) && a.facets == b.facets &&
         same_values(a.radii, b.radii);
}

/// On the same corners and curves, too: sets of remesh() say so, those of sample() do not.
inline bool same_set_on_curves(const SampleSet& a, const SampleSet& b) {
  return same_set(a, b) && a.dimensions == b.dimensions && a.curves == b.curves && same_values(a.parameters, b.parameters);
}

inline amps::RestrictedPowerDiagram diagram_of(const Mesh& mesh, const SampleSet& set) {
  return amps::RestrictedPowerDiagram(mesh, set.positions, squared(set.radii));
}

}  // namespace amps_test
