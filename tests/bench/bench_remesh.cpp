// The whole remesh() and sample() on the bunny, as a user calls them, on one thread and two: time, memory, and what of the time
// threads can share. CGAL's isotropic remeshing with five iterations and as many vertices, in the same run where CGAL is found.
//   amps_bench --benchmark_filter=whole --benchmark_counters_tabular=true --benchmark_repetitions=5
// Some 20 s a repetition with CGAL. By row:
//   samples    vertices of the result
//   of_cgal    time over the least that CGAL took for as many
//   peak_MiB   memory at most, beside what was there before
//   s_…        seconds of a stage, of the last iteration
// and in the rows "foreseen", which take what a thread alone does for what each of 16 would (loop_times.h):
//   s_at_16    what 16 threads would take, of all and (at16_…) of a stage
//   work_…     seconds of a stage on one thread, with the ways that the code takes on 16
//   alone_…    of these, outside of loops
//   longest_…  the longest stretch that one thread does alone: outside of loops, or a piece of one
#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/shapes.h"
#include "amps/sizing.h"
#include "../kit/data.h"
#include "loop_times.h"
#include "peak_memory.h"

#include <benchmark/benchmark.h>

#ifdef AMPS_BENCH_CGAL
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/remesh.h>
#include <CGAL/Surface_mesh.h>
#endif

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

namespace {

enum class Whole { kUniform, kSizing, kNonObtuse, kSample };

struct WholeCase {
  const char* name;
  Whole what;
  amps::Index samples;
};
const WholeCase kWholeCases[] = {{"uniform 12k", Whole::kUniform, 12'000}, {"uniform 100k", Whole::kUniform, 100'000},
                                 {"lfs 12k", Whole::kSizing, 12'000},      {"[42, 90] 100k", Whole::kNonObtuse, 100'000},
                                 {"sampling 12k", Whole::kSample, 12'000}, {"sampling 100k", Whole::kSample, 100'000}};

/// The least seconds that CGAL took for so many vertices, in this run.
std::map<amps::Index, double>& seconds_of_cgal() {
  static std::map<amps::Index, double> seconds;
  return seconds;
}

const amps::Mesh& whole_mesh() {
  static const amps::Mesh mesh = amps_test::data_mesh_or("bunny_100kf_closed.obj", amps::make_knot());
  return mesh;
}

/// Seconds by stage, as progress tells where one begins.
class StageTimes {
 public:
  amps::Progress progress() {
    return amps::Progress([this](const char* stage, double) {
      begin(stage);
      return true;
    });
  }
  void start() {
    times_.clear();
    stage_ = "first";
    watch_.lap();
  }
  const std::map<std::string, double>& finish() {
    begin("");
    return times_;
  }

 private:
  void begin(const char* stage) {
    if (stage == nullptr || stage_ == stage) return;
    times_[stage_] += watch_.lap();
    stage_ = stage;
  }

  std::map<std::string, double> times_;
  std::string stage_;
  amps::detail::Stopwatch watch_;
};

/// "throwing darts" as "throwing_darts".
std::string key_of(std::string stage) {
  std::replace(stage.begin(), stage.end(), ' ', '_');
  return stage;
}

amps::Index run_whole(const WholeCase& c, const amps::Execution& execution) {
  amps::RemeshOptions options;
  options.sampling.target_count = c.samples;
  options.sampling.execution = execution;
  if (c.what == Whole::kSample) return amps::sample(whole_mesh(), options.sampling).samples.size();
  if (c.what == Whole::kSizing) {
    const amps::Execution job = execution.start();
    const amps::SizingField field = amps::lfs_sizing(whole_mesh(), {}, job.part(0, 0.3, "local feature size"));
    options.sampling.sizing = amps::for_count(field, static_cast<double>(c.samples), amps::kDefaultGradation,
                                              job.part(0.3, 0.4, "limiting the gradation"));
    options.sampling.execution = job.part(0.4, 1);
    return amps::remesh(whole_mesh(), options).samples.size();
  }
  if (c.what == Whole::kNonObtuse) {
    options.optimization.min_angle = 42;
    options.optimization.max_angle = 90;
  }
  return amps::remesh(whole_mesh(), options).samples.size();
}

/// range(0): the case; range(1): threads.
void whole_amps(benchmark::State& state) {
  const WholeCase& c = kWholeCases[static_cast<std::size_t>(state.range(0))];
  const auto threads = static_cast<unsigned>(state.range(1));
  whole_mesh();
  StageTimes stages;
  std::map<std::string, double> times;
  amps::Index samples = 0;
  double memory = 0, least = 0;
  for (auto iteration : state) {
    static_cast<void>(iteration);
    const double before = amps_bench::reset_peak_memory();
    stages.start();
    amps::detail::Stopwatch watch;
    samples = run_whole(c, amps::Execution(threads, stages.progress()));
    const double seconds = watch.lap();
    times = stages.finish();
    state.SetIterationTime(seconds);
    least = least == 0 ? seconds : std::min(least, seconds);
    memory = std::max(memory, amps_bench::peak_memory() - before);
  }
  state.SetLabel(std::string(c.name) + ", threads: " + std::to_string(threads));
  state.counters["samples"] = samples;
  state.counters["peak_MiB"] = memory / (1 << 20);
  const auto cgal = seconds_of_cgal().find(c.samples);
  if (cgal != seconds_of_cgal().end() && c.what != Whole::kSample) state.counters["of_cgal"] = least / cgal->second;
  for (const auto& [stage, seconds] : times) state.counters["s_" + key_of(stage)] = seconds;
}

#ifdef AMPS_BENCH_PARALLEL_FOR
/// range(0): the case; range(1): threads that are foreseen.
void whole_foreseen(benchmark::State& state) {
  const WholeCase& c = kWholeCases[static_cast<std::size_t>(state.range(0))];
  const auto threads = static_cast<unsigned>(state.range(1));
  whole_mesh();
  std::map<std::string, amps_bench::LoopTimes::Stage> stages;
  for (auto iteration : state) {
    static_cast<void>(iteration);
    amps_bench::InOrder executor(threads);
    amps_bench::LoopTimes times(threads);
    run_whole(c, amps::Execution(1, times.progress(), &executor));
    stages = times.stages();
    double all = 0;
    for (const auto& [name, stage] : stages) all += stage.foreseen;
    state.SetIterationTime(all);
  }
  state.SetLabel(std::string(c.name) + ", foreseen, threads: " + std::to_string(threads));
  double all = 0;
  for (const auto& [name, stage] : stages) {
    const std::string key = key_of(name);
    state.counters["work_" + key] = stage.alone + stage.shared;
    state.counters["alone_" + key] = stage.alone;
    state.counters["longest_" + key] = stage.longest;
    state.counters["at" + std::to_string(threads) + "_" + key] = stage.foreseen;
    all += stage.foreseen;
  }
  state.counters["s_at_" + std::to_string(threads)] = all;
}
#endif

#ifdef AMPS_BENCH_CGAL
using WholeKernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using WholeCgalMesh = CGAL::Surface_mesh<WholeKernel::Point_3>;

WholeCgalMesh whole_cgal_mesh() {
  const amps::Mesh& mesh = whole_mesh();
  WholeCgalMesh result;
  std::vector<WholeCgalMesh::Vertex_index> vertices;
  for (amps::Index v = 0; v < mesh.vertices.rows(); ++v) {
    vertices.push_back(result.add_vertex({mesh.vertices(v, 0), mesh.vertices(v, 1), mesh.vertices(v, 2)}));
  }
  const auto at = [&](amps::Index f, int k) { return vertices[static_cast<std::size_t>(mesh.triangles(f, k))]; };
  for (amps::Index f = 0; f < mesh.triangles.rows(); ++f) result.add_face(at(f, 0), at(f, 1), at(f, 2));
  return result;
}

double remeshed_by_cgal(WholeCgalMesh& mesh, double edge_length) {
  amps::detail::Stopwatch watch;
  CGAL::Polygon_mesh_processing::isotropic_remeshing(faces(mesh), edge_length, mesh, CGAL::parameters::number_of_iterations(5));
  return watch.lap();
}

/// range(0): vertices.
void whole_cgal(benchmark::State& state) {
  const auto wanted = static_cast<amps::Index>(state.range(0));
  const WholeCgalMesh input = whole_cgal_mesh();
  // Equilateral triangles, two a vertex, and then by what that makes.
  double edge_length = std::sqrt(2 * amps::total_area(whole_mesh()) / (std::sqrt(3.0) * wanted));
  {
    WholeCgalMesh mesh = input;
    remeshed_by_cgal(mesh, edge_length);
    mesh.collect_garbage();
    edge_length *= std::sqrt(static_cast<double>(mesh.number_of_vertices()) / wanted);
  }
  double vertices = 0, memory = 0;
  for (auto iteration : state) {
    static_cast<void>(iteration);
    WholeCgalMesh mesh = input;
    const double before = amps_bench::reset_peak_memory();
    const double seconds = remeshed_by_cgal(mesh, edge_length);
    memory = std::max(memory, amps_bench::peak_memory() - before);
    state.SetIterationTime(seconds);
    double& least = seconds_of_cgal()[wanted];
    least = least == 0 ? seconds : std::min(least, seconds);
    mesh.collect_garbage();
    vertices = static_cast<double>(mesh.number_of_vertices());
  }
  state.SetLabel("five iterations");
  state.counters["samples"] = vertices;
  state.counters["peak_MiB"] = memory / (1 << 20);
}

BENCHMARK(whole_cgal)->Arg(12'000)->Arg(100'000)->UseManualTime()->Iterations(1)->Unit(benchmark::kMillisecond);
#endif

BENCHMARK(whole_amps)->ArgsProduct({{0, 1, 2, 3, 4, 5}, {1, 2}})->UseManualTime()->Iterations(1)->Unit(benchmark::kMillisecond);
#ifdef AMPS_BENCH_PARALLEL_FOR
BENCHMARK(whole_foreseen)
    ->ArgsProduct({{0, 1, 2, 3, 4, 5}, {2, 4, 8, 16}})
    ->UseManualTime()
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);
#endif

}  // namespace
