// Progress, cancelling and executors through sampling, remeshing, certificates, diagrams and triangulations.
#include "amps/remesh.h"

#include "kit/bits.h"
#include "kit/errors.h"
#include "kit/execution.h"
#include "kit/maximality.h"

#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <atomic>
#include <functional>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

namespace amps_test {

using amps::Execution;
using amps::RemeshOptions;
using amps::RemeshResult;

namespace {

/// One call after another on the caller's thread, the last first.
struct ReversedExecutor : amps::Executor {
  unsigned concurrency() const override { return 3; }
  void run(unsigned count, const std::function<void(unsigned)>& work) override {
    ++runs;
    for (unsigned k = count; k > 0; --k) work(k - 1);
  }
  int runs = 0;
};

/// Each call on a thread of its own.
struct ThreadsExecutor : amps::Executor {
  unsigned concurrency() const override { return 3; }
  void run(unsigned count, const std::function<void(unsigned)>& work) override {
    std::vector<std::thread> threads;
    for (unsigned k = 0; k < count; ++k) threads.emplace_back(work, k);
    for (std::thread& thread : threads) thread.join();
  }
};

struct SerialExecutor : amps::Executor {
  unsigned concurrency() const override { return 1; }
  void run(unsigned, const std::function<void(unsigned)>&) override { FAIL("one worker needs no executor"); }
};

/// What a call told.
struct Told {
  std::vector<std::string> stages;
  double last = 0;
  bool rising = true;
  int calls = 0;

  amps::Progress progress() {
    return amps::Progress(
        [this](const char* stage, double fraction) {
          if (stages.empty() || stages.back() != stage) stages.emplace_back(stage);
          rising = rising && fraction >= last && fraction <= 1;
          last = fraction;
          ++calls;
          return true;
        },
        0);
  }
};

using Call = std::function<void(const Execution&)>;

/// Told everything, a call never falls back and ends at 1; cancelled at the k-th report, it ends, and tells nothing more.
std::vector<std::string> check_call(const Call& call, bool throws) {
  Told told;
  call({1, told.progress()});
  CHECK(told.rising);
  CHECK(told.last == 1);
  for (const int share : {0, 1, 3, 5, 7, 9}) {
    const int at = 1 + (told.calls - 3) * share / 10;
    CAPTURE(at);
    int calls = 0;
    const amps::Progress progress([&](const char*, double) { return ++calls < at; }, 0);
    const auto run = [&] { call({2, progress}); };
    if (throws) {
      CHECK(error_of(run) == ErrorCode::kCancelled);
    } else {
      run();
    }
    CHECK(progress.cancelled());
    CHECK(calls == at);
  }
  return told.stages;
}

RemeshOptions remesh_options(double radius, const Execution& execution) {
  RemeshOptions options;
  options.sampling.radius = radius;
  options.sampling.execution = execution;
  return options;
}

std::uint64_t bits_of(const SampleSet& set) { return hash_bits(set.positions, set.barycentrics); }

constexpr double kRadius = 0.05;

}  // namespace

TEST_CASE("pipeline: fractions rise to 1, stages have their names, a cancel ends a call at its next look") {
  const Mesh mesh = amps::make_torus();
  const std::vector<std::string> diagram = {"triangulating samples", "dividing the surface"};
  const std::vector<std::string> sampling = {"throwing darts", diagram[0], diagram[1], "filling gaps"};
  const auto with = [](std::vector<std::string> first, const std::vector<std::string>& more) {
    first.insert(first.end(), more.begin(), more.end());
    return first;
  };
  SamplingOptions options = with_radius(kRadius);
  const SampleSet set = amps::sample(mesh, options).samples;
  const auto sampled = [&](const Execution& execution) {
    options.execution = execution;
    const SamplingResult result = amps::sample(mesh, options);
    CHECK((result.status == Outcome::kCancelled) == execution.cancelled());
    CHECK((result.samples.size() == 0 || separation_of_all_pairs(result.samples) >= 1 - 1e-9));
  };
  CHECK(check_call(sampled, false) == sampling);
  const SampleSet half = selected(set, [](Index s) { return s % 2 == 0; });
  const auto filled = [&](const Execution& execution) {
    options.execution = execution;
    const SamplingResult result = amps::fill_gaps(mesh, half, options);
    CHECK((result.status == Outcome::kCancelled) == execution.cancelled());
    CHECK(same_set(head(result.samples, half.size()), half));
  };
  CHECK(check_call(filled, false) == with({"filling gaps"}, with(diagram, {"filling gaps"})));
  const auto remeshed = [&](const Execution& execution) {
    const RemeshResult result = amps::remesh(mesh, remesh_options(kRadius, execution));
    CHECK((result.status == Outcome::kCancelled) == execution.cancelled());
    CHECK(same_bits(result.mesh.vertices, result.samples.positions));
  };
  const std::vector<std::string> after = {"keeping the topology", "improving triangles", "building the mesh",
                                          "measuring the result"};
  CHECK(check_call(remeshed, false) == with({"finding curves"}, with(sampling, after)));
  const auto verified = [&](const Execution& execution) { amps::verify_maximal(mesh, set, execution); };
  CHECK(check_call(verified, true) == with(diagram, {"checking coverage and distances"}));
  const auto listed = [&](const Execution& execution) { amps::find_gaps(mesh, half, execution); };
  CHECK(check_call(listed, true) == with(diagram, {"listing gaps"}));
  const auto dual = [&](const Execution& execution) { amps::restricted_triangulation(mesh, set, execution); };
  CHECK(check_call(dual, true) == with(diagram, {"listing triangles"}));
  const std::vector<double> weights(at(set.size()), 0.0);
  const auto triangulated = [&](const Execution& execution) {
    const amps::RegularTriangulation triangulation(set.positions, weights, execution);
  };
  CHECK(check_call(triangulated, true) == std::vector<std::string>{"triangulating"});
}

TEST_CASE("pipeline: a cancelled diagram says so and is empty, a cancelled triangulation too") {
  const Mesh mesh = amps::make_torus();
  const SampleSet set = amps::sample(mesh, with_radius(0.1)).samples;
  const std::vector<double> weights(at(set.size()), 0.01);
  Told told;
  using amps::RestrictedPowerDiagram;
  CHECK(RestrictedPowerDiagram(mesh, set.positions, weights, Execution(1, told.progress())).status() == Outcome::kDone);
  for (int cancel_at = 1; cancel_at < told.calls; cancel_at += 1 + told.calls / 20) {
    CAPTURE(cancel_at);
    int calls = 0;
    const amps::Progress progress([&](const char*, double) { return ++calls < cancel_at; }, 0);
    RestrictedPowerDiagram diagram(mesh, set.positions, weights, Execution(1, progress));
    CHECK(diagram.status() == Outcome::kCancelled);
    CHECK(diagram.num_sites() == 0);
    CHECK(diagram.num_fragments() == 0);
    CHECK(diagram.dual_triangles().rows() == 0);
    CHECK(diagram.check() != "");
    CHECK(error_of([&] { diagram.insert({0, 0, 0}, 1); }) == ErrorCode::kCancelled);
    CHECK(error_of([&] { diagram.remove(0); }) == ErrorCode::kInvalidArgument);
    diagram = RestrictedPowerDiagram(mesh, set.positions, weights);
    CHECK(diagram.check() == "");
  }
  amps::RegularTriangulation triangulation(set.positions, weights);
  amps::Progress cancelled;
  cancelled.cancel();
  CHECK(error_of([&] { triangulation.insert(set.positions, weights, Execution(1, cancelled)); }) == ErrorCode::kCancelled);
  CHECK(triangulation.num_vertices() == 0);
  triangulation.insert(set.positions, weights);
  CHECK(triangulation.check() == "");
}

TEST_CASE("pipeline: the same bits on any number of threads and on any executor") {
  const Mesh mesh = amps::make_torus();
  const RemeshResult one = amps::remesh(mesh, remesh_options(kRadius, {}));
  const amps::MaximalityReport certificate = amps::verify_maximal(mesh, one.samples);
  ReversedExecutor reversed;
  ThreadsExecutor threads;
  SerialExecutor serial;
  for (const Execution& execution :
       std::vector<Execution>{{2}, {5}, {0}, {1, {}, &reversed}, {1, {}, &threads}, {4, {}, &serial}}) {
    const RemeshResult result = amps::remesh(mesh, remesh_options(kRadius, execution));
    CHECK(bits_of(result.samples) == bits_of(one.samples));
    CHECK(hash_bits(result.mesh.triangles) == hash_bits(one.mesh.triangles));
    SamplingOptions options = with_radius(kRadius);
    options.execution = execution;
    CHECK(bits_of(amps::sample(mesh, options).samples) == bits_of(amps::sample(mesh, with_radius(kRadius)).samples));
    const amps::MaximalityReport again = amps::verify_maximal(mesh, one.samples, execution);
    CHECK(same_bits(again.worst_coverage, certificate.worst_coverage));
    CHECK(same_bits(again.worst_separation, certificate.worst_separation));
    CHECK(hash_bits(amps::restricted_triangulation(mesh, one.samples, execution).triangles) == hash_bits(one.mesh.triangles));
  }
  CHECK(reversed.runs > 10);
}

TEST_CASE("pipeline: a job starts its threads once") {
  // The callback runs on whichever thread reports: those of a job are the caller's and two of its own, however many loops.
  const Mesh mesh = amps::make_torus();
  std::set<std::thread::id> seen;
  const amps::Progress progress(
      [&](const char*, double) {
        seen.insert(std::this_thread::get_id());
        return true;
      },
      0);
  CHECK(amps::remesh(mesh, remesh_options(0.03, {3, progress})).status != Outcome::kCancelled);
  CHECK(seen.count(std::this_thread::get_id()) == 1);
  CHECK(seen.size() > 1);
  CHECK(seen.size() <= 3);
}

}  // namespace amps_test
