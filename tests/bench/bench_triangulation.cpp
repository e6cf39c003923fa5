// Construction of the regular triangulation, insertion with a hint and removal, amps beside CGAL's sequential
// Regular_triangulation_3 on the same points in one run. Interleave repetitions for a fair ratio on a busy machine:
//   amps_bench --benchmark_filter=triangulation --benchmark_repetitions=5 --benchmark_enable_random_interleaving=true
#include "amps/triangulation.h"

#include <benchmark/benchmark.h>

#ifdef AMPS_BENCH_CGAL
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Regular_triangulation_3.h>
#ifdef CGAL_LINKED_WITH_TBB
#include <tbb/global_control.h>
#endif
#endif

#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace {

using amps::Points;
using amps::Rng;
using amps::Vec3;

struct Input {
  Points positions;
  std::vector<double> weights;
};

constexpr std::ptrdiff_t kPoints = 100000;
constexpr double kTurn = 6.283185307179586;

Input uniform_cube(double weight_range) {
  Rng rng(1);
  Input in{Points(kPoints), std::vector<double>(kPoints)};
  for (std::ptrdiff_t k = 0; k < kPoints; ++k) {
    for (int a = 0; a < 3; ++a) in.positions(k, a) = rng.uniform();
    in.weights[k] = weight_range * rng.uniform();
  }
  return in;
}

Vec3 on_sphere(Rng& rng) {
  const double z = 2 * rng.uniform() - 1, a = kTurn * rng.uniform(), s = std::sqrt(1 - z * z);
  return {s * std::cos(a), s * std::sin(a), z};
}

/// Darts on the unit sphere with radii growing 16-fold from one pole to the other, until 100,000 have found their place; a dart
/// fails if it lies within the greater of the two radii of an earlier one.
Input variable_radius_sphere() {
  Rng rng(2);
  const auto radius = [](const Vec3& p) { return 1.15e-3 * std::exp2(4 * std::pow((p.z() + 1) / 2, 2.0)); };
  constexpr double kCell = 1.15e-3 * 16;
  const auto cell_of = [](double x) { return static_cast<std::int64_t>(std::floor(x / kCell)) + 4096; };
  std::map<std::int64_t, std::vector<Vec3>> grid;
  Input in{Points(kPoints), std::vector<double>(kPoints)};
  std::ptrdiff_t count = 0;
  for (std::int64_t dart = 0; count < kPoints && dart < 100 * kPoints; ++dart) {
    const Vec3 p = on_sphere(rng);
    const double r = radius(p);
    bool free = true;
    for (std::int64_t x = cell_of(p.x()) - 1; free && x <= cell_of(p.x()) + 1; ++x) {
      for (std::int64_t y = cell_of(p.y()) - 1; free && y <= cell_of(p.y()) + 1; ++y) {
        for (std::int64_t z = cell_of(p.z()) - 1; free && z <= cell_of(p.z()) + 1; ++z) {
          const auto found = grid.find((x << 40) | (y << 20) | z);
          if (found == grid.end()) continue;
          for (const Vec3& q : found->second) {
            const double least = std::max(r, radius(q));
            free = free && (p - q).squaredNorm() >= least * least;
          }
        }
      }
    }
    if (!free) continue;
    grid[(cell_of(p.x()) << 40) | (cell_of(p.y()) << 20) | cell_of(p.z())].push_back(p);
    in.positions.row(count) = p.transpose();
    in.weights[count++] = r * r;
  }
  in.positions.resize(count);
  in.weights.resize(static_cast<std::size_t>(count));
  return in;
}

Input random_torus() {
  Rng rng(3);
  Input in{Points(kPoints), std::vector<double>(kPoints, 0.0)};
  for (std::ptrdiff_t k = 0; k < kPoints; ++k) {
    const double a = kTurn * rng.uniform(), b = kTurn * rng.uniform();
    in.positions.row(k) << (2 + std::cos(b)) * std::cos(a), (2 + std::cos(b)) * std::sin(a), std::sin(b);
  }
  return in;
}

Input grid(double divisor) {
  constexpr int m = 46;
  Input in{Points(m * m * m), std::vector<double>(static_cast<std::size_t>(m * m * m), 0.0)};
  std::ptrdiff_t k = 0;
  for (int x = 0; x < m; ++x) {
    for (int y = 0; y < m; ++y) {
      for (int z = 0; z < m; ++z) in.positions.row(k++) << x / divisor, y / divisor, z / divisor;
    }
  }
  return in;
}

/// The inputs of the design's table; made once each.
const Input& input(char name) {
  static std::map<char, Input> made;
  const auto found = made.find(name);
  if (found != made.end()) return found->second;
  const auto make = [name]() -> Input {
    switch (name) {
      case 'a':
        return uniform_cube(0);
      case 'b':
        return uniform_cube(1e-4);
      case 'c':
        return variable_radius_sphere();
      case 'd':
        return random_torus();
      case 'e':
        return grid(1);
      case 'f':
        return grid(46);
      case 'h':
        return uniform_cube(1e-3);
      default: {
        Input in = input('c');
        in.weights.assign(in.weights.size(), 0.0);
        return in;
      }
    }
  };
  return made.emplace(name, make()).first->second;
}

void triangulate(benchmark::State& state, char name, unsigned threads) {
  const Input& in = input(name);
  std::int64_t cells = 0;
  for (auto _ : state) {
    const amps::RegularTriangulation t(in.positions, in.weights, threads);
    cells = t.num_cells();
  }
  state.counters["points"] = static_cast<double>(in.positions.rows());
  state.counters["cells"] = static_cast<double>(cells);
}

/// A million uniform points.
void triangulate_million(benchmark::State& state, unsigned threads) {
  static const Points positions = [] {
    Rng rng(4);
    Points result(1000000, 3);
    for (std::ptrdiff_t k = 0; k < result.size(); ++k) result.data()[k] = rng.uniform();
    return result;
  }();
  const std::vector<double> weights(static_cast<std::size_t>(positions.rows()), 0.0);
  for (auto _ : state) amps::RegularTriangulation(positions, weights, threads);
}

/// Single insertions of the second half, with the cell of a nearby vertex as the hint.
void insert_with_hint(benchmark::State& state, char name) {
  const Input& in = input(name);
  const std::ptrdiff_t half = in.positions.rows() / 2, some = 10000;
  const amps::RegularTriangulation first({in.positions.data(), half}, {in.weights.data(), half});
  std::vector<amps::Index> hint;
  for (std::ptrdiff_t k = half; k < half + some; ++k) hint.push_back(first.power_nearest(in.positions.row(k).transpose()));
  for (auto _ : state) {
    state.PauseTiming();
    amps::RegularTriangulation t({in.positions.data(), half},
                                 {in.weights.data(), half});  // not a copy: that has no room to grow
    state.ResumeTiming();
    for (std::ptrdiff_t k = 0; k < some; ++k) {
      t.insert(in.positions.row(half + k).transpose(), in.weights[half + k],
               t.incident_cell(hint[static_cast<std::size_t>(k)]));
    }
  }
  state.SetItemsProcessed(state.iterations() * some);
}

/// Removal of 10,000 points in random order, from a fresh copy each time.
void remove_some(benchmark::State& state, char name) {
  const Input& in = input(name);
  const std::ptrdiff_t some = 10000;
  for (auto _ : state) {
    state.PauseTiming();
    amps::RegularTriangulation t(in.positions, in.weights);
    state.ResumeTiming();
    for (amps::Index v = 0; v < some; ++v) t.remove(v);  // the input is in random order
  }
  state.SetItemsProcessed(state.iterations() * some);
}

#ifdef AMPS_BENCH_CGAL
using Oracle = CGAL::Regular_triangulation_3<CGAL::Exact_predicates_inexact_constructions_kernel>;

Oracle::Weighted_point weighted_point(const Input& in, std::ptrdiff_t k) {
  return {Oracle::Bare_point(in.positions(k, 0), in.positions(k, 1), in.positions(k, 2)), in.weights[k]};
}

void triangulate_cgal(benchmark::State& state, char name) {
  const Input& in = input(name);
  std::vector<Oracle::Weighted_point> points;
  for (std::ptrdiff_t k = 0; k < in.positions.rows(); ++k) points.push_back(weighted_point(in, k));
  std::size_t cells = 0;
  for (auto _ : state) {
    const Oracle t(points.begin(), points.end());
    cells = t.number_of_finite_cells();
  }
  state.counters["points"] = static_cast<double>(points.size());
  state.counters["cells"] = static_cast<double>(cells);
}

#ifdef CGAL_LINKED_WITH_TBB
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using ParallelOracle = CGAL::Regular_triangulation_3<
    Kernel, CGAL::Triangulation_data_structure_3<CGAL::Regular_triangulation_vertex_base_3<Kernel>,
                                                 CGAL::Regular_triangulation_cell_base_3<Kernel>, CGAL::Parallel_tag>>;

/// CGAL on two threads, with its grid of locks.
void triangulate_cgal_parallel(benchmark::State& state, char name) {
  const Input& in = input(name);
  std::vector<ParallelOracle::Weighted_point> points;
  CGAL::Bbox_3 box;
  for (std::ptrdiff_t k = 0; k < in.positions.rows(); ++k) {
    points.push_back(weighted_point(in, k));
    box += points.back().bbox();
  }
  const tbb::global_control two(tbb::global_control::max_allowed_parallelism, 2);
  for (auto _ : state) {
    ParallelOracle::Lock_data_structure locks(box, 50);
    ParallelOracle(points.begin(), points.end(), &locks);
  }
}
#endif

void insert_with_hint_cgal(benchmark::State& state, char name) {
  const Input& in = input(name);
  const std::ptrdiff_t half = in.positions.rows() / 2, some = 10000;
  std::vector<Oracle::Weighted_point> points;
  for (std::ptrdiff_t k = 0; k < in.positions.rows(); ++k) points.push_back(weighted_point(in, k));
  for (auto _ : state) {
    state.PauseTiming();
    Oracle t(points.begin(), points.begin() + half);
    std::vector<Oracle::Vertex_handle> hint;
    for (std::ptrdiff_t k = half; k < half + some; ++k) {
      hint.push_back(t.nearest_power_vertex(points[static_cast<std::size_t>(k)].point()));
    }
    state.ResumeTiming();
    for (std::ptrdiff_t k = 0; k < some; ++k) {
      const auto at = static_cast<std::size_t>(k);
      t.insert(points[static_cast<std::size_t>(half) + at], hint[at]->cell());
    }
  }
  state.SetItemsProcessed(state.iterations() * some);
}

void remove_some_cgal(benchmark::State& state, char name) {
  const Input& in = input(name);
  const std::ptrdiff_t some = 10000;
  std::vector<Oracle::Weighted_point> points;
  for (std::ptrdiff_t k = 0; k < in.positions.rows(); ++k) points.push_back(weighted_point(in, k));
  for (auto _ : state) {
    state.PauseTiming();
    Oracle t(points.begin(), points.end());
    std::vector<Oracle::Vertex_handle> vertices;  // no point of these inputs is hidden: each is nearest to itself
    for (std::ptrdiff_t k = 0; k < some; ++k)
      vertices.push_back(t.nearest_power_vertex(points[static_cast<std::size_t>(k)].point()));
    state.ResumeTiming();
    for (const Oracle::Vertex_handle v : vertices) t.remove(v);
  }
  state.SetItemsProcessed(state.iterations() * some);
}
#endif

constexpr std::pair<char, const char*> kInputs[] = {
    {'a', "cube"},  {'b', "cube_weighted"}, {'h', "cube_a_third_hidden"}, {'c', "sphere_variable_radius"},
    {'d', "torus"}, {'e', "grid"},          {'f', "grid_rounded"},        {'s', "sphere_unweighted"}};

const int kRegistered = [] {
  for (const auto& entry : kInputs) {
    const char name = entry.first;
    const std::string title = std::string("triangulation/") + name + "_" + entry.second;
    const auto add = [&title](const char* who, std::function<void(benchmark::State&)> run) {
      benchmark::RegisterBenchmark((title + who).c_str(), std::move(run))->Unit(benchmark::kMillisecond)->UseRealTime();
    };
    add("/amps", [name](benchmark::State& state) { triangulate(state, name, 1); });
    add("/amps_2_threads", [name](benchmark::State& state) { triangulate(state, name, 2); });
#ifdef AMPS_BENCH_CGAL
    add("/cgal", [name](benchmark::State& state) { triangulate_cgal(state, name); });
#ifdef CGAL_LINKED_WITH_TBB
    add("/cgal_2_threads", [name](benchmark::State& state) { triangulate_cgal_parallel(state, name); });
#endif
#endif
  }
  for (const unsigned threads : {1u, 2u}) {
    const std::string title = "triangulation/million_threads:" + std::to_string(threads);
    benchmark::RegisterBenchmark(title.c_str(), [threads](benchmark::State& state) { triangulate_million(state, threads); })
        ->Unit(benchmark::kMillisecond)
        ->UseRealTime();
  }
  for (const char name : {'a', 'c'}) {
    const auto add = [name](const char* what, const char* who, void (*run)(benchmark::State&, char)) {
      const std::string title = std::string("triangulation/") + what + "_" + name + who;
      benchmark::RegisterBenchmark(title.c_str(), [run, name](benchmark::State& state) {
        run(state, name);
      })->Unit(benchmark::kMillisecond);
    };
    add("insert_with_hint", "/amps", insert_with_hint);
    add("remove", "/amps", remove_some);
#ifdef AMPS_BENCH_CGAL
    add("insert_with_hint", "/cgal", insert_with_hint_cgal);
    add("remove", "/cgal", remove_some_cgal);
#endif
  }
  return 0;
}();

}  // namespace
