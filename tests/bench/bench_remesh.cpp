// The whole remesh() and sample() on the bunny, as a user calls them, on one thread and two: time, memory, and what of the time
// threads can share. CGAL's isotropic remeshing with five iterations and as many vertices, in the same run where CGAL is found.
//   amps_bench --benchmark_filter=whole --benchmark_counters_tabular=true --benchmark_repetitions=5
// Some 20 s a repetition with CGAL. By row:
//   samples    vertices of the result
//   of_cgal    time over the least that CGAL took for as many
//   peak_MiB   memory at most, beside what was there before
//   cpu        processor time over wall-clock time
//   s_…        seconds of a stage, of the last iteration
//   serial_…   with several threads: what of a stage one thread did alone, in seconds, if all else was shared evenly
//   s_at_16    what 16 threads would take by that
// Processor time tells of threads only where no other program wants the cores.
#include "amps/remesh.h"
#include "amps/sampling.h"
#include "amps/shapes.h"
#include "amps/sizing.h"
#include "../kit/data.h"
#include "peak_memory.h"

#include <benchmark/benchmark.h>

#ifdef AMPS_BENCH_CGAL
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/remesh.h>
#include <CGAL/Surface_mesh.h>
#endif

#include <algorithm>
#include <cmath>
#include <ctime>
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

/// Wall-clock and processor time by stage, as progress tells where one begins.
class StageTimes {
 public:
  struct Times {
    double wall = 0, cpu = 0;
  };

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
    cpu_ = cpu_now();
  }
  const std::map<std::string, Times>& finish() {
    begin("");
    return times_;
  }
  static double cpu_now() {
    timespec now{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }

 private:
  void begin(const char* stage) {
    if (stage == nullptr || stage_ == stage) return;
    Times& of_stage = times_[stage_];
    of_stage.wall += watch_.lap();
    const double now = cpu_now();
    of_stage.cpu += now - cpu_;
    cpu_ = now;
    stage_ = stage;
  }

  std::map<std::string, Times> times_;
  std::string stage_;
  amps::detail::Stopwatch watch_;
  double cpu_ = 0;
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
    options.sampling.sizing = amps::for_count(amps::lfs_sizing(whole_mesh(), {}, job.part(0, 0.4, "local feature size")),
                                              static_cast<double>(c.samples));
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
  std::map<std::string, StageTimes::Times> times;
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
  double wall = 0, cpu = 0, at_16 = 0;
  for (const auto& [stage, of_stage] : times) {
    wall += of_stage.wall;
    cpu += of_stage.cpu;
    state.counters["s_" + key_of(stage)] = of_stage.wall;
    if (threads == 1) continue;
    // wall = serial + shared/threads, cpu = serial + shared.
    const double shared = std::min(std::max(0.0, (of_stage.cpu - of_stage.wall) * threads / (threads - 1)), of_stage.cpu);
    state.counters["serial_" + key_of(stage)] = of_stage.cpu - shared;
    at_16 += of_stage.cpu - shared + shared / 16;
  }
  state.counters["cpu"] = cpu / wall;
  if (threads > 1) state.counters["s_at_16"] = at_16;
}

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

}  // namespace
