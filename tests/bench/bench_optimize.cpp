// Optimisation of valences and angles: the paper's Tables 1 and 2, tighter bounds than the paper's, growth with the number of
// samples, threads, and what it does to the randomness of the samples. A benchmark is one run with one seed, the last argument;
// its label says what became of it. Seconds are of the processor (optimize_threads: of the clock). Meshes are in ../shared/data
// (environment AMPS_TEST_DATA: another folder), generated ones stand in for those that are not there.
//   amps_bench --benchmark_filter=optimize_table1    uniform, [35, 105] degrees
//   amps_bench --benchmark_filter=optimize_table2    by local feature size, [32, 114] degrees
//   amps_bench --benchmark_filter=optimize_past      [38, 100], [42, 90], [45, 85] degrees
//   amps_bench --benchmark_filter=optimize_scaling   10k, 100k and 1M samples: about 2 minutes and 1.5 GB
//   amps_bench --benchmark_filter=optimize_threads
//   amps_bench --benchmark_filter=optimize_randomness
#include "amps/maximality.h"
#include "amps/optimize.h"
#include "amps/power_diagram.h"
#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/shapes.h"
#include "amps/sizing.h"
#include "amps/surface_distance.h"
#include "../kit/pair_correlation.h"
#include "../kit/data.h"
#include "peak_memory.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <string>
#include <utility>
#include <vector>

namespace {

/// Degrees; 0 and 0: the paper's.
struct AngleBounds {
  double min = 0, max = 0;
};
constexpr AngleBounds kTighter = {38, 100}, kNonObtuse = {42, 90}, kTightest = {45, 85};

struct OptimizeCase {
  std::string name;
  amps::Mesh mesh;
  amps::SamplingOptions options;
};

OptimizeCase uniform_case(const std::string& name, amps::Mesh mesh, double samples) {
  OptimizeCase c{name, std::move(mesh), {}};
  c.options.radius = std::sqrt(amps::kSamplesPerDensity * amps::total_area(c.mesh) / samples);
  return c;
}

/// Radii by local feature size.
OptimizeCase adaptive_case(const std::string& name, const std::string& file, double samples) {
  OptimizeCase c{name, amps_test::data_mesh_or(file, amps::make_knot()), {}};
  if (!amps_test::data_file(file)) c.name = "knot instead of " + name;
  c.options.sizing = amps::for_count(amps::lfs_sizing(c.mesh).with_ratio(16), samples);
  return c;
}

OptimizeCase bunny_case() { return adaptive_case("bunny 12k lfs", "bunny_100kf_closed.obj", 12000); }
OptimizeCase triceratops_case() { return adaptive_case("triceratops 9k lfs", "triceratops.off", 9000); }

/// The surfaces of Table 1, at its radius.
OptimizeCase table1_case(bool sphere) {
  OptimizeCase c{"square", amps::make_square(), {}};
  if (sphere) {
    c = {"sphere", amps::make_sphere(81920), {}};
    c.mesh.vertices.map() *= std::sqrt(0.863 / amps::total_area(c.mesh));
  }
  c.options.radius = 4.5e-3;
  return c;
}

double processor_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

struct OptimizeRun {
  amps::SampleSet start;  ///< maximal
  amps::OptimizeResult result;
  double sampling = 0, optimization = 0;              ///< seconds of the processor
  double clock_sampling = 0, clock_optimization = 0;  ///< of the clock
};

/// Sampling, then optimisation of the diagram that left.
OptimizeRun run_case(const OptimizeCase& c, AngleBounds bounds, std::uint64_t seed, unsigned threads = 1) {
  OptimizeRun run;
  amps::SamplingOptions sampling = c.options;
  sampling.seed = seed;
  sampling.execution.threads = threads;
  amps::detail::Stopwatch watch;
  double start = processor_seconds();
  amps::detail::SamplingRun sampled = amps::detail::sample_with_diagram(c.mesh, sampling);
  run.sampling = processor_seconds() - start;
  run.clock_sampling = watch.lap();
  run.start = std::move(sampled.result.samples);

  amps::OptimizeOptions options;
  options.min_angle = bounds.min;
  options.max_angle = bounds.max;
  options.seed = seed;
  options.execution.threads = threads;
  options.sizing = c.options.sizing;
  std::vector<amps::Index> ids;
  watch.lap();
  start = processor_seconds();
  run.result.samples = run.start;
  run.result.report = amps::detail::optimize_diagram(*sampled.diagram, run.result.samples, {}, options, ids);
  run.optimization = processor_seconds() - start;
  run.clock_optimization = watch.lap();
  return run;
}

std::string label(const OptimizeCase& c, const amps::OptimizeReport& report) {
  std::string text = c.name + " [" + std::to_string(static_cast<int>(report.min_angle)) + ", " +
                     std::to_string(static_cast<int>(report.max_angle)) + "]: " + amps::name_of(report.status);
  if (report.status != amps::Outcome::kDone) {
    text += ", " + std::to_string(report.iterations.back().bad_triangles) + " bad triangles, " +
            std::to_string(report.iterations.back().bad_vertices) + " bad vertices";
  }
  return text;
}

double percent_added(const OptimizeRun& run) { return 100.0 * run.result.samples.size() / run.start.size() - 100; }

/// Optimises once and says how it went.
OptimizeRun report_run(benchmark::State& state, const OptimizeCase& c, AngleBounds bounds, std::uint64_t seed) {
  OptimizeRun run;
  for (auto iteration : state) {
    static_cast<void>(iteration);
    run = run_case(c, bounds, seed);
  }
  const amps::QualityReport q = amps::quality(amps::restricted_triangulation(c.mesh, run.result.samples));
  const amps::MaximalityReport m = amps::verify_maximal(c.mesh, run.result.samples);
  state.SetLabel(label(c, run.result.report) + (m.maximal() && m.poisson_disk() ? "" : ", NOT A MAXIMAL POISSON-DISK SET"));
  state.counters["samples"] = run.result.samples.size();
  state.counters["added_%"] = percent_added(run);
  state.counters["replaced_%"] = 100.0 * run.result.report.removed / run.start.size();
  state.counters["angle_min"] = q.min_angle;
  state.counters["angle_max"] = q.max_angle;
  state.counters["valence_567_%"] = q.valence_5_6_7;
  state.counters["q_min"] = q.min_q;
  state.counters["visits"] = static_cast<double>(run.result.report.iterations.size() - 1);
  state.counters["seconds"] = run.optimization;
  state.counters["seconds_sampling"] = run.sampling;
  return run;
}

/// range(0): 0 square, 1 sphere; range(1): seed. The paper's square has 35.1 thousand samples then, its sphere 30.4.
void optimize_table1(benchmark::State& state) {
  report_run(state, table1_case(state.range(0) != 0), {}, static_cast<std::uint64_t>(state.range(1)));
}

/// range(0): 0 bunny, 1 triceratops; range(1): seed. The paper: angles 32 to 115 degrees, all valences 5 to 7, Q_min 0.51,
/// distances 0.37 and 0.035, 0.46 and 0.062 %.
void optimize_table2(benchmark::State& state) {
  const OptimizeCase c = state.range(0) == 0 ? bunny_case() : triceratops_case();
  const OptimizeRun run = report_run(state, c, {}, static_cast<std::uint64_t>(state.range(1)));
  const amps::DistanceReport before = amps::surface_distance(c.mesh, amps::restricted_triangulation(c.mesh, run.start));
  const amps::DistanceReport d = amps::surface_distance(c.mesh, amps::restricted_triangulation(c.mesh, run.result.samples));
  state.counters["hausdorff_%"] = d.percent(d.hausdorff());
  state.counters["hausdorff_before_%"] = before.percent(before.hausdorff());
  state.counters["rms_%"] = d.percent(d.rms());
  state.counters["rms_before_%"] = before.percent(before.rms());
}

/// range(0): which case; range(1): seed.
void optimize_past(benchmark::State& state) {
  const auto make = [&]() -> std::pair<OptimizeCase, AngleBounds> {
    switch (state.range(0)) {
      case 0:
        return {uniform_case("square 12k", amps::make_square(), 12000), kNonObtuse};
      case 1:
        return {uniform_case("sphere 12k", amps::make_sphere(20480), 12000), kNonObtuse};
      case 2:
        return {uniform_case("torus 12k", amps::make_torus(), 12000), kNonObtuse};
      case 3:
        return {uniform_case("bunny 12k", amps_test::data_mesh_or("bunny_100kf_closed.obj", amps::make_knot()), 12000),
                kNonObtuse};
      case 4:
        return {bunny_case(), kTighter};
      case 5:
        return {bunny_case(), kNonObtuse};
      case 6:
        return {triceratops_case(), kTighter};
      case 7:
        return {triceratops_case(), kNonObtuse};
      default:
        return {uniform_case("sphere 12k", amps::make_sphere(20480), 12000), kTightest};
    }
  };
  const auto [c, bounds] = make();
  report_run(state, c, bounds, static_cast<std::uint64_t>(state.range(1)));
}

/// range(0): samples; range(1): 0 the paper's bounds, 1 no obtuse triangle.
void optimize_scaling(benchmark::State& state) {
  const OptimizeCase c = uniform_case("sphere", amps::make_sphere(20480), static_cast<double>(state.range(0)));
  OptimizeRun run;
  double memory = 0;
  for (auto iteration : state) {
    static_cast<void>(iteration);
    const double before = amps_bench::reset_peak_memory();
    run = run_case(c, state.range(1) == 0 ? AngleBounds{} : kNonObtuse, 1);
    memory = amps_bench::peak_memory() - before;
  }
  const double samples = run.result.samples.size();
  state.SetLabel(label(c, run.result.report));
  state.counters["us/sample"] = 1e6 * run.optimization / samples;
  state.counters["us_sampling/sample"] = 1e6 * run.sampling / samples;
  state.counters["bytes/sample"] = memory / samples;  // of both
  state.counters["visits"] = static_cast<double>(run.result.report.iterations.size() - 1);
}

/// range(0): 0 sphere of 100k samples, 1 bunny by local feature size without obtuse triangles; range(1): threads.
void optimize_threads(benchmark::State& state) {
  const OptimizeCase c = state.range(0) == 0 ? uniform_case("sphere 100k", amps::make_sphere(20480), 100000) : bunny_case();
  OptimizeRun run;
  for (auto iteration : state) {
    static_cast<void>(iteration);
    run = run_case(c, state.range(0) == 0 ? AngleBounds{} : kNonObtuse, 1, static_cast<unsigned>(state.range(1)));
  }
  state.SetLabel(label(c, run.result.report));
  state.counters["seconds"] = run.clock_optimization;
  state.counters["seconds_sampling"] = run.clock_sampling;
}

/// Pair correlation from r to 4r in steps of 0.05 r, on the surfaces of Table 1; of the square, the samples 4r and more inside.
std::vector<double> pair_correlation_of(const amps::SampleSet& samples, bool sphere, double area) {
  const double r = samples.radii[0], margin = sphere ? 0 : 4 * r, inside = (1 - 2 * margin) * (1 - 2 * margin);
  std::vector<char> inner(static_cast<std::size_t>(samples.size()), 1);
  double count = samples.size();
  for (amps::Index i = 0; !sphere && i < samples.size(); ++i) {
    const Eigen::Array2d p = samples.positions.row(i).head<2>().transpose();
    if (std::min(p.minCoeff(), (1 - p).minCoeff()) < margin) {
      inner[static_cast<std::size_t>(i)] = 0;
      --count;
    }
  }
  return amps_test::pair_correlation(samples.positions, inner, count / (sphere ? area : inside), r, 0.05 * r, 60);
}

/// range(0): 0 square, 1 sphere; range(1): bounds, 0 no optimisation; range(2): seed.
void optimize_randomness(benchmark::State& state) {
  static constexpr AngleBounds kBounds[] = {{}, {35, 105}, kTighter, kNonObtuse, kTightest};
  const bool sphere = state.range(0) != 0;
  const OptimizeCase c = table1_case(sphere);
  OptimizeRun run;
  for (auto iteration : state) {
    static_cast<void>(iteration);
    if (state.range(1) == 0) {
      amps::SamplingOptions options = c.options;
      options.seed = static_cast<std::uint64_t>(state.range(2));
      run.start = run.result.samples = amps::sample(c.mesh, options).samples;
    } else {
      run = run_case(c, kBounds[state.range(1)], static_cast<std::uint64_t>(state.range(2)));
    }
  }
  const std::vector<double> g = pair_correlation_of(run.result.samples, sphere, amps::total_area(c.mesh));
  state.SetLabel(state.range(1) == 0 ? c.name + ", not optimised" : label(c, run.result.report));
  state.counters["added_%"] = percent_added(run);
  state.counters["replaced_%"] = 100.0 * run.result.report.removed / run.start.size();
  const auto first_minimum = std::min_element(g.begin(), g.begin() + 30);  // before 2.5 r
  state.counters["peak"] = *std::max_element(g.begin(), g.end());
  state.counters["minimum"] = *first_minimum;
  state.counters["minimum_at"] = 1.025 + 0.05 * static_cast<double>(first_minimum - g.begin());
  for (std::size_t k = 0; k < g.size(); ++k) {
    std::string distance = std::to_string(1.025 + 0.05 * static_cast<double>(k));
    state.counters["g_" + distance.substr(0, 5)] = g[k];
  }
}

const std::vector<std::int64_t> kSeeds = {1, 2, 3, 4, 5};

BENCHMARK(optimize_table1)->ArgsProduct({{0, 1}, kSeeds})->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(optimize_table2)->ArgsProduct({{0, 1}, kSeeds})->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(optimize_past)->ArgsProduct({{0, 1, 2, 3, 4, 5, 6, 7, 8}, kSeeds})->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(optimize_scaling)->ArgsProduct({{10000, 100000, 1000000}, {0, 1}})->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(optimize_threads)->ArgsProduct({{0, 1}, {1, 2}})->Iterations(1)->UseRealTime()->Unit(benchmark::kMillisecond);
BENCHMARK(optimize_randomness)->ArgsProduct({{0, 1}, {0, 1, 2, 3, 4}, kSeeds})->Iterations(1)->Unit(benchmark::kMillisecond);

}  // namespace
