// The whole pipeline and each of its stages: dart throwing, triangulation, restricted power diagram, gap filling, remeshing.
// The bunny is ../shared/data/bunny_100kf_closed.obj (environment AMPS_TEST_DATA: another folder), a generated knot where there
// is none.
//   amps_bench --benchmark_filter=pipeline
#include "amps/power_diagram.h"
#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/shapes.h"
#include "../test_data.h"

#include <benchmark/benchmark.h>

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace {

/// A mesh, a radius for about `samples` samples, and what each stage starts from.
struct PipelineCase {
  std::string name;
  amps::Mesh mesh;
  amps::SamplingOptions options;
  amps::SampleSet darts;    ///< after the first stage
  amps::SampleSet maximal;  ///< after the second

  PipelineCase(std::string n, amps::Mesh m, double samples) : name(std::move(n)), mesh(std::move(m)) {
    options.radius = std::sqrt(0.7 * amps::total_area(mesh) / samples);
    darts = amps::throw_darts(mesh, options).samples;
    maximal = amps::fill_gaps(mesh, darts, options).samples;
  }
};

/// Made when first asked for: listing the benchmarks costs nothing.
const PipelineCase& pipeline_case(std::size_t which) {
  static std::unique_ptr<PipelineCase> cases[3];
  std::unique_ptr<PipelineCase>& made = cases[which];
  if (made == nullptr) {
    if (which == 0) {
      made = std::make_unique<PipelineCase>("bunny, 12k", amps_test::data_mesh_or("bunny_100kf_closed.obj", amps::make_knot()),
                                            12000);
    } else if (which == 1) {
      made = std::make_unique<PipelineCase>("sphere, 10k", amps::make_sphere(20480), 10000);
    } else {
      made = std::make_unique<PipelineCase>("sphere, 100k", amps::make_sphere(20480), 100000);
    }
  }
  return *made;
}

/// Times `stage` of a case; its result is the number of samples it worked on.
template <class Stage>
void run(benchmark::State& state, const Stage& stage) {
  const PipelineCase& input = pipeline_case(static_cast<std::size_t>(state.range(0)));
  double samples = 0;
  for (auto iteration : state) {
    static_cast<void>(iteration);
    samples = stage(input);
  }
  state.SetLabel(input.name);
  state.counters["samples"] = samples;
  state.counters["time/sample"] =
      benchmark::Counter(samples, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void pipeline_darts(benchmark::State& state) {
  run(state, [](const PipelineCase& c) { return amps::throw_darts(c.mesh, c.options).samples.size(); });
}

void pipeline_triangulation(benchmark::State& state) {
  run(state, [](const PipelineCase& c) {
    const amps::RegularTriangulation triangulation(c.maximal.positions, c.maximal.radii.cwiseAbs2());
    benchmark::DoNotOptimize(triangulation.num_cells());
    return c.maximal.size();
  });
}

/// Of the whole set, with its triangulation.
void pipeline_diagram(benchmark::State& state) {
  run(state, [](const PipelineCase& c) {
    const amps::RestrictedPowerDiagram diagram(c.mesh, c.maximal.positions, c.maximal.radii.cwiseAbs2());
    benchmark::DoNotOptimize(diagram.num_fragments());
    return c.maximal.size();
  });
}

/// From the darts on, with their triangulation and diagram.
void pipeline_gap_filling(benchmark::State& state) {
  run(state, [](const PipelineCase& c) { return amps::fill_gaps(c.mesh, c.darts, c.options).samples.size(); });
}

void pipeline_sample(benchmark::State& state) {
  run(state, [](const PipelineCase& c) { return amps::sample(c.mesh, c.options).samples.size(); });
}

void pipeline_remesh(benchmark::State& state) {
  run(state, [](const PipelineCase& c) {
    amps::RemeshOptions options;
    options.sampling = c.options;
    return amps::remesh(c.mesh, options).samples.size();
  });
}

void pipeline_certificate(benchmark::State& state) {
  run(state, [](const PipelineCase& c) {
    benchmark::DoNotOptimize(amps::verify_maximal(c.mesh, c.maximal).worst_coverage);
    return c.maximal.size();
  });
}

BENCHMARK(pipeline_darts)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);
BENCHMARK(pipeline_triangulation)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);
BENCHMARK(pipeline_diagram)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);
BENCHMARK(pipeline_gap_filling)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);
BENCHMARK(pipeline_sample)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);
BENCHMARK(pipeline_remesh)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);
BENCHMARK(pipeline_certificate)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);

}  // namespace
