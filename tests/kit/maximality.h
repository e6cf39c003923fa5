// maximality.h: oracles of what a maximal Poisson-disk set is — all pairs of samples, bisection of the surface, no power
// diagram — and checks of all that is promised of one.
#pragma once

#include "execution.h"
#include "samples.h"

#include "amps/maximality.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace amps_test {

using amps::MaximalityReport;

/// The oracle of separation: the least distance of two samples over the greater of their radii, or the lesser by the min rule.
inline double separation_of_all_pairs(const SampleSet& set, ConflictRule rule = ConflictRule::kMax) {
  const double* const x = set.positions.data();  // plain arrays: Eigen is slow without optimisation
  const double* const r = set.radii.data();
  double worst = kInfinity;
  for (Index s = 0; s < set.size(); ++s) {
    for (Index t = 0; t < s; ++t) {
      const double dx = x[3 * s] - x[3 * t], dy = x[3 * s + 1] - x[3 * t + 1], dz = x[3 * s + 2] - x[3 * t + 2];
      const double radius = (r[s] > r[t]) == (rule == ConflictRule::kMax) ? r[s] : r[t];
      const double ratio = (dx * dx + dy * dy + dz * dz) / (radius * radius);
      if (ratio < worst) worst = ratio;
    }
  }
  return std::sqrt(worst);
}

/// Samples by cells of side `cell`: the oracle's own search structure.
class Cells {
 public:
  Cells(const Points& positions, double cell) : positions_(positions), cell_(cell) {
    for (Index s = 0; s < rows(positions); ++s) cells_[key(position(s), 0, 0, 0)].push_back(s);
  }
  Vec3 position(Index s) const { return point_at(positions_, s); }
  /// Calls back with every sample within one cell of x, and others.
  template <class Visit>
  void around(const Vec3& x, const Visit& visit) const {
    for (int i = -1; i <= 1; ++i) {
      for (int j = -1; j <= 1; ++j) {
        for (int k = -1; k <= 1; ++k) {
          const auto found = cells_.find(key(x, i, j, k));
          if (found == cells_.end()) continue;
          for (const Index s : found->second) visit(s);
        }
      }
    }
  }

 private:
  std::uint64_t key(const Vec3& x, int i, int j, int k) const {
    const auto digit = [this](double c, int step) {
      return static_cast<std::uint64_t>(std::floor(c / cell_) + step + 0x80000) & 0x1fffff;
    };
    return digit(x.x(), i) | digit(x.y(), j) << 21 | digit(x.z(), k) << 42;
  }
  Points positions_;
  double cell_;
  std::unordered_map<std::uint64_t, std::vector<Index>> cells_;
};

/// The oracle of coverage: a triangle is covered if one ball contains its corners; else it is cut at its longest edge and both
/// halves are looked at, among the balls that reach it, down to where a half is as small as the tolerance.
class CoverageOracle {
 public:
  CoverageOracle(const SampleSet& set, double tolerance)
      : set_(set), cells_(set.positions, 2.05 * max_of(set.radii)), largest_(max_of(set.radii)), tolerance_(tolerance) {}

  bool covers(const Mesh& mesh) {
    const MeshView view(mesh);
    for (Index f = 0; f < view.num_facets(); ++f) {
      if (!covers({view.corner(f, 0), view.corner(f, 1), view.corner(f, 2)}, nullptr)) return false;
    }
    return true;
  }

 private:
  using Triangle = std::array<Vec3, 3>;

  double reach(Index s) const { return set_.radii[s] * (1 + tolerance_); }

  bool in_one_ball(const Triangle& t, Index s) const {
    return std::all_of(t.begin(), t.end(),
                       [&](const Vec3& x) { return (x - cells_.position(s)).squaredNorm() <= reach(s) * reach(s); });
  }

  bool covers(const Triangle& t, const std::vector<Index>* candidates) {
    std::size_t from = 0;
    double longest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double length = (t[k] - t[(k + 1) % 3]).norm();
      if (length > longest) {
        longest = length;
        from = k;
      }
    }
    std::vector<Index> near;
    if (longest <= largest_) {
      const Vec3 centre = (t[0] + t[1] + t[2]) / 3;
      double least = kInfinity;
      const auto add = [&](Index s) {
        if ((cells_.position(s) - centre).norm() > longest + reach(s)) return;
        near.push_back(s);
        least = std::min(least, set_.radii[s]);
      };
      if (candidates == nullptr) {
        cells_.around(centre, add);
      } else {
        std::for_each(candidates->begin(), candidates->end(), add);
      }
      if (std::any_of(near.begin(), near.end(), [&](Index s) { return in_one_ball(t, s); })) return true;
      if (near.empty() || longest < tolerance_ * least) return false;
      candidates = &near;
    }
    const Vec3 middle = (t[from] + t[(from + 1) % 3]) / 2;
    Triangle first = t, second = t;
    first[(from + 1) % 3] = middle;
    second[from] = middle;
    return covers(first, candidates) && covers(second, candidates);
  }

  const SampleSet& set_;
  Cells cells_;
  double largest_, tolerance_;
};

inline bool covered_by_oracle(const Mesh& mesh, const SampleSet& set) { return CoverageOracle(set, 1e-9).covers(mesh); }

/// The library's own certificate, on one thread.
inline MaximalityReport certificate_of(const Mesh& mesh, const SampleSet& set, ConflictRule rule = ConflictRule::kMax) {
  return amps::verify_maximal(mesh, set, on_threads(1), rule);
}

/// Samples lie where they say, bit for bit.
inline void check_placement(const Mesh& mesh, const SampleSet& set) {
  REQUIRE(set.facets.size() == at(set.size()));
  REQUIRE(rows(set.barycentrics) == set.size());
  REQUIRE(rows(set.radii) == set.size());
  Index misplaced = 0;
  double worst_sum = 0;
  for (Index s = 0; s < set.size(); ++s) {
    const Index f = facet_of(set, s);
    REQUIRE((f >= 0 && f < rows(mesh.triangles)));
    const Vec3 b = barycentric_of(set, s);
    worst_sum = std::max(worst_sum, std::fabs(b.sum() - 1));
    bool right = b.minCoeff() >= 0;
    for (int c = 0; c < 3; ++c) {
      const auto corner = [&](int k) { return mesh.vertices(mesh.triangles(f, k), c); };
      const double x = b[0] * corner(0) + b[1] * corner(1) + b[2] * corner(2);
      right = right && same_bits(x, set.positions(s, c));
    }
    misplaced += !right;
  }
  CHECK(misplaced == 0);
  CHECK(worst_sum <= 4e-16);
}

/// Everything that is promised of a maximal set of one radius, by amps' own certificate and by the oracles.
inline void check_maximal(const Mesh& mesh, const SamplingResult& result) {
  const SampleSet& set = result.samples;
  CHECK(result.status == Outcome::kDone);
  CHECK(result.report.unfilled_gaps == 0);
  CHECK(all_equal(set.radii, result.report.radius));
  check_placement(mesh, set);
  const MaximalityReport certificate = amps::verify_maximal(mesh, set);
  CHECK(certificate.maximal());
  CHECK(certificate.poisson_disk());
  CHECK(certificate.worst_coverage <= 1 + 1e-9);
  CHECK(certificate.worst_separation >= 1 - 1e-9);
  CHECK(certificate.gaps == 0);
  CHECK(certificate.gap_area == 0);
  if (set.size() > 1) {
    const double separation = separation_of_all_pairs(set);
    CHECK(separation >= 1 - 1e-9);
    if (separation < 1.4) CHECK(certificate.worst_separation == doctest::Approx(separation).epsilon(1e-12));
  }
  CHECK(covered_by_oracle(mesh, set));
}

/// Radii are positive, never above the field, and not below its least value but for one rounding of a distance.
inline void check_radii(const SampleSet& set, const SizingField& field, double least) {
  Index above = 0;
  for (Index s = 0; s < set.size(); ++s) above += set.radii[s] > field.radius(facet_of(set, s), barycentric_of(set, s));
  CHECK(above == 0);
  CHECK(min_of(set.radii) >= least * (1 - 1e-15));
}

/// What amps says of a maximal set of varying radii.
inline void check_certificate(const Mesh& mesh, const SamplingResult& result, const SamplingOptions& options) {
  CHECK(result.status == Outcome::kDone);
  CHECK(result.report.unfilled_gaps == 0);
  const bool constant = options.sizing.min_radius() == options.sizing.max_radius();
  CHECK((result.report.radius == 0) == !constant);
  const MaximalityReport certificate = certificate_of(mesh, result.samples, options.conflict_rule);
  CHECK(certificate.worst_coverage <= 1 + 1e-9);
  CHECK(certificate.worst_separation >= 1 - 1e-9);
  CHECK(certificate.gaps == 0);
  const SizingField field = options.sizing.scaled(result.report.sizing_scale);
  check_radii(result.samples, field, field.min_radius());
  CHECK(result.report.min_radius == min_of(result.samples.radii));
  CHECK(result.report.max_radius == max_of(result.samples.radii));
  CHECK(result.report.mean_radius == doctest::Approx(mean_of(result.samples.radii)).epsilon(1e-12));
}

}  // namespace amps_test
