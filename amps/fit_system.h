// fit_system.h (internal): the offsets of vertices that bring points of triangles and edges onto a surface, in the
// least-squares sense: samples, the sparse matrix they make, and conjugate gradients. All sums are in a fixed order, so that
// offsets are the same bits for any number of threads.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

namespace amps::detail {

/// Vertices or triangles of a piece of parallel loops: they take 0.1 to 1 µs each.
inline constexpr std::size_t kFitGrain = 1024;

/// A point at which the distance to the surface is to be small: offset + direction · Σ weight[k] · displacement of corner k of
/// an element.
struct FitSample {
  Vec3 weight = Vec3::Zero();
  Vec3 direction = Vec3::Zero();
  double offset = 0;
  double mass = 0;  ///< area; 0: it does not count
};

/// Samples by element.
struct FitSamples {
  std::vector<std::size_t> first;  ///< of each element, and the end
  std::vector<FitSample> samples;
};

/// Sum of term(i) over [0, n): the same bits for any number of threads.
template <class Term>
double ordered_sum(std::size_t n, const Execution& run, const Term& term) {
  std::vector<double> parts((n + kFitGrain - 1) / kFitGrain, 0.0);
  parallel_for(n, kFitGrain, run, [&](std::size_t begin, std::size_t end) {
    double sum = 0;
    for (std::size_t i = begin; i < end; ++i) sum += term(i);
    parts[begin / kFitGrain] = sum;
  });
  double sum = 0;
  for (const double part : parts) sum += part;
  return sum;
}

/// Elements (triangles, or edges as triangles with their second end twice) and the vertices they join.
class FitElements {
 public:
  FitElements(std::vector<std::array<Index, 3>> elements, std::size_t num_vertices, const Execution& run)
      : elements_(std::move(elements)), first_corner_(num_vertices + 1, 0), first_(num_vertices + 1, 0) {
    for (const auto& element : elements_) {
      for (const Index v : element) ++first_corner_[slot(v) + 1];
    }
    for (std::size_t v = 0; v < num_vertices; ++v) first_corner_[v + 1] += first_corner_[v];
    corners_.resize(3 * elements_.size());
    std::vector<std::size_t> next(first_corner_.begin(), first_corner_.end() - 1);
    for (std::size_t c = 0; c < corners_.size(); ++c) corners_[next[slot(elements_[c / 3][c % 3])]++] = c;
    std::vector<Index> around;
    Ticker ticker(run, num_vertices, kFitGrain);
    for (std::size_t v = 0; v < num_vertices; ++v) {
      ticker.tick();
      around.assign(1, static_cast<Index>(v));
      for (std::size_t i = first_corner_[v]; i < first_corner_[v + 1]; ++i) {
        for (const Index u : elements_[corners_[i] / 3]) around.push_back(u);
      }
      std::sort(around.begin(), around.end());
      around.erase(std::unique(around.begin(), around.end()), around.end());
      neighbors_.insert(neighbors_.end(), around.begin(), around.end());
      first_[v + 1] = neighbors_.size();
    }
  }

  std::size_t size() const { return elements_.size(); }
  const std::array<Index, 3>& operator[](std::size_t e) const { return elements_[e]; }
  std::size_t num_vertices() const { return first_.size() - 1; }
  /// Corners (3·element + k) at a vertex: corner(i) for i in [first_corner(v), first_corner(v + 1)).
  std::size_t first_corner(std::size_t v) const { return first_corner_[v]; }
  std::size_t corner(std::size_t i) const { return corners_[i]; }
  /// Vertices that share an element with a vertex, itself among them, ascending: neighbor(i) for i in [first(v), first(v + 1)).
  std::size_t first(std::size_t v) const { return first_[v]; }
  Index neighbor(std::size_t i) const { return neighbors_[i]; }
  std::size_t find(std::size_t v, Index u) const {
    std::size_t i = first_[v];
    while (neighbors_[i] != u) ++i;
    return i;
  }

 private:
  std::vector<std::array<Index, 3>> elements_;
  std::vector<std::size_t> first_corner_, corners_, first_;
  std::vector<Index> neighbors_;
};

/// D by D numbers and D numbers, with sums in the order written.
template <std::size_t D>
using FitBlock = std::array<double, D * D>;
template <std::size_t D>
using FitVector = std::array<double, D>;

template <std::size_t D>
void add_block_product(const FitBlock<D>& a, const FitVector<D>& x, FitVector<D>& y) {
  for (std::size_t i = 0; i < D; ++i) {
    for (std::size_t j = 0; j < D; ++j) y[i] += a[i * D + j] * x[j];
  }
}

inline FitBlock<1> inverse_of(const FitBlock<1>& a) { return {1 / a[0]}; }

/// Of a symmetric positive definite one.
inline FitBlock<3> inverse_of(const FitBlock<3>& a) {
  const double c00 = a[4] * a[8] - a[5] * a[5], c01 = a[2] * a[5] - a[1] * a[8], c02 = a[1] * a[5] - a[2] * a[4];
  const double scale = 1 / (a[0] * c00 + a[1] * c01 + a[2] * c02);
  const double c11 = a[0] * a[8] - a[2] * a[2], c12 = a[1] * a[2] - a[0] * a[5], c22 = a[0] * a[4] - a[1] * a[1];
  return {c00 * scale, c01 * scale, c02 * scale, c01 * scale, c11 * scale, c12 * scale, c02 * scale, c12 * scale, c22 * scale};
}

/// How offsets are kept small, relative to the weight of a vertex's samples: along its normal, across it, and as differences
/// along edges.
struct FitRegularisation {
  double normal, tangential, edges;
};

/// The offsets that make Σ mass · (offset + direction · Σ weight · x)² least, with D unknowns a vertex: 1, along its normal, or
/// 3. Vertices that are not `unknown` have the displacement that is given.
template <std::size_t D>
class FitSystem {
 public:
  FitSystem(const FitElements& elements, const std::vector<char>& unknown, const std::vector<Vec3>& normals,
            const Execution& run)
      : elements_(elements), unknown_(unknown), normals_(normals), run_(run) {}

  /// `displacements` (in and out) by vertex.
  void solve(const FitSamples& samples, const FitRegularisation& regularisation, int max_iterations,
             std::vector<Vec3>& displacements) {
    assemble(samples, displacements);
    regularise(regularisation);
    iterate(max_iterations, displacements);
  }

 private:
  using Block = FitBlock<D>;
  using Vector = FitVector<D>;

  /// n · the directions of a vertex's unknowns.
  Vector along(const Vec3& n, std::size_t v) const {
    if constexpr (D == 1) {
      return {dot(n, normals_[v])};
    } else {
      return {n[0], n[1], n[2]};
    }
  }

  void assemble(const FitSamples& samples, const std::vector<Vec3>& displacements) {
    const std::size_t n = elements_.num_vertices();
    blocks_.assign(elements_.first(n), Block{});
    right_.assign(n, Vector{});
    mass_.assign(n, 0.0);
    parallel_for(n, kFitGrain, run_, [&](std::size_t begin, std::size_t end) {
      for (std::size_t v = begin; v < end; ++v) {
        if (unknown_[v] == 0) continue;
        for (std::size_t i = elements_.first_corner(v); i < elements_.first_corner(v + 1); ++i) {
          add_element(samples, elements_.corner(i) / 3, elements_.corner(i) % 3, v, displacements);
        }
      }
    });
  }

  /// What the samples of an element add to the row of its corner k, which is v.
  void add_element(const FitSamples& samples, std::size_t e, std::size_t k, std::size_t v,
                   const std::vector<Vec3>& displacements) {
    const std::array<Index, 3>& element = elements_[e];
    std::array<std::size_t, 3> place{};
    for (std::size_t l = 0; l < 3; ++l) place[l] = elements_.find(v, element[l]);
    for (std::size_t s = samples.first[e]; s < samples.first[e + 1]; ++s) {
      const FitSample& sample = samples.samples[s];
      const double weight = sample.mass * sample.weight[static_cast<int>(k)];
      if (!(weight > 0)) continue;
      mass_[v] += weight * sample.weight[static_cast<int>(k)];
      const Vector row = along(sample.direction, v);
      double offset = sample.offset;
      for (std::size_t l = 0; l < 3; ++l) {
        const double b = sample.weight[static_cast<int>(l)];
        const std::size_t u = slot(element[l]);
        if (unknown_[u] == 0) {
          offset += b * dot(sample.direction, displacements[u]);
          continue;
        }
        const Vector column = along(sample.direction, u);
        Block& block = blocks_[place[l]];
        for (std::size_t a = 0; a < D; ++a) {
          for (std::size_t c = 0; c < D; ++c) block[a * D + c] += weight * b * row[a] * column[c];
        }
      }
      for (std::size_t a = 0; a < D; ++a) right_[v][a] -= weight * offset * row[a];
    }
  }

  void regularise(const FitRegularisation& r) {
    const std::size_t n = elements_.num_vertices();
    const double num_unknown = ordered_sum(n, run_, [&](std::size_t v) { return unknown_[v] == 0 ? 0.0 : 1.0; });
    const double mean = ordered_sum(n, run_, [&](std::size_t v) { return mass_[v]; }) / std::max(1.0, num_unknown);
    // Where nothing counts, as on a triangle too thin to have an area, the system must not be singular.
    constexpr double kLeast = 1e-9;
    preconditioner_.assign(n, Block{});
    parallel_for(n, kFitGrain, run_, [&](std::size_t begin, std::size_t end) {
      for (std::size_t v = begin; v < end; ++v) {
        if (unknown_[v] == 0) continue;
        Block& diagonal = blocks_[elements_.find(v, static_cast<Index>(v))];
        if constexpr (D == 1) {
          diagonal[0] += r.normal * mean;
        } else {
          const Vec3& normal = normals_[v];
          for (std::size_t a = 0; a < D; ++a) {
            diagonal[a * D + a] += r.tangential * mass_[v];
            for (std::size_t c = 0; c < D; ++c) {
              diagonal[a * D + c] +=
                  (r.normal - r.tangential) * mass_[v] * normal[static_cast<int>(a)] * normal[static_cast<int>(c)];
            }
          }
        }
        for (std::size_t i = elements_.first(v); r.edges > 0 && i < elements_.first(v + 1); ++i) {
          const std::size_t u = slot(elements_.neighbor(i));
          if (u == v || unknown_[u] == 0) continue;
          const double weight = r.edges * std::min(mean, (mass_[v] + mass_[u]) / 2);
          for (std::size_t a = 0; a < D; ++a) {
            diagonal[a * D + a] += weight;
            blocks_[i][a * D + a] -= weight;
          }
        }
        for (std::size_t a = 0; a < D; ++a) diagonal[a * D + a] += kLeast * mean;
        preconditioner_[v] = inverse_of(diagonal);
      }
    });
  }

  double product(const std::vector<Vector>& a, const std::vector<Vector>& b) const {
    return ordered_sum(a.size(), run_, [&](std::size_t v) {
      double sum = 0;
      for (std::size_t k = 0; k < D; ++k) sum += a[v][k] * b[v][k];
      return sum;
    });
  }

  /// Conjugate gradients, preconditioned by the blocks of the diagonal.
  void iterate(int max_iterations, std::vector<Vec3>& displacements) {
    constexpr double kTolerance = 1e-3;  // of the residual, relative to the first
    const std::size_t n = elements_.num_vertices();
    std::vector<Vector> x(n, Vector{}), residual = right_, z(n), direction, image(n);
    const auto for_unknowns = [&](const auto& body) {
      parallel_for(n, kFitGrain, run_, [&](std::size_t begin, std::size_t end) {
        for (std::size_t v = begin; v < end; ++v) {
          if (unknown_[v] != 0) body(v);
        }
      });
    };
    const auto precondition = [&] {
      for_unknowns([&](std::size_t v) {
        z[v] = {};
        add_block_product<D>(preconditioner_[v], residual[v], z[v]);
      });
    };
    precondition();
    direction = z;
    double squared = product(residual, z);
    const double goal = kTolerance * kTolerance * squared;
    for (int iteration = 0; iteration < max_iterations && squared > goal; ++iteration) {
      for_unknowns([&](std::size_t v) {
        Vector sum{};
        for (std::size_t i = elements_.first(v); i < elements_.first(v + 1); ++i) {
          const std::size_t u = slot(elements_.neighbor(i));
          if (unknown_[u] != 0) add_block_product<D>(blocks_[i], direction[u], sum);
        }
        image[v] = sum;
      });
      const double step = squared / product(direction, image);
      for_unknowns([&](std::size_t v) {
        for (std::size_t k = 0; k < D; ++k) {
          x[v][k] += step * direction[v][k];
          residual[v][k] -= step * image[v][k];
        }
      });
      precondition();
      const double next = product(residual, z);
      const double ratio = next / squared;
      squared = next;
      for_unknowns([&](std::size_t v) {
        for (std::size_t k = 0; k < D; ++k) direction[v][k] = z[v][k] + ratio * direction[v][k];
      });
    }
    for_unknowns([&](std::size_t v) {
      if constexpr (D == 1) {
        displacements[v] = x[v][0] * normals_[v];
      } else {
        displacements[v] = Vec3(x[v][0], x[v][1], x[v][2]);
      }
    });
  }

  const FitElements& elements_;
  const std::vector<char>& unknown_;
  const std::vector<Vec3>& normals_;
  Execution run_;
  std::vector<Block> blocks_, preconditioner_;
  std::vector<Vector> right_;
  std::vector<double> mass_;  ///< Σ mass · weight² at each vertex
};

}  // namespace amps::detail
