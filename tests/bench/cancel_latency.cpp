// How long calls go without a look for a cancel, how soon they return after one, and how far their fraction is from elapsed
// time. Calls: sample, remesh, verify_maximal and restricted_triangulation on a sphere.
//
//   amps_cancel_latency [SAMPLES = 1000000] [THREADS = 1] [CANCELS = 12] [CALL …]
//
// A look is a report that reaches the callback, which is told everything here. Silence counts for the stage that was shown when
// it began; "begin" and "end" are what comes before the first report and after the last: arguments checked, memory freed.
#include "amps/amps.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace {

double seconds_now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

/// What is known of a stage, in order of appearance.
struct Stage {
  std::string name;
  double silence = 0, latency = 0, seconds = 0;
  int cancels = 0;
};

struct Stages {
  std::vector<Stage> all;

  Stage& operator[](const std::string& name) {
    for (Stage& stage : all) {
      if (stage.name == name) return stage;
    }
    all.push_back({});
    all.back().name = name;
    return all.back();
  }
};

using Call = std::function<void(const amps::Execution&)>;

/// Uncancelled. Returns the time it took.
double measure_silence(const Call& call, unsigned threads, Stages& stages) {
  struct Look {
    double time, fraction;
  };
  std::vector<Look> looks;
  looks.reserve(1 << 24);
  double last = 0;
  std::string shown = "begin";
  const amps::Progress progress(
      [&](const char* stage, double fraction) {
        const double now = seconds_now();
        Stage& before = stages[shown];
        before.silence = std::max(before.silence, now - last);
        before.seconds += now - last;
        if (shown != stage) shown = stage;
        last = now;
        looks.push_back({now, fraction});
        return true;
      },
      0);
  const double begin = last = seconds_now();
  call({threads, progress});
  const double end = seconds_now();
  Stage& after = stages["end"];
  after.silence = after.seconds = end - last;
  double deviation = 0, at = 0, told = 0;
  for (const Look& look : looks) {
    const double elapsed = (look.time - begin) / (end - begin);
    if (std::fabs(look.fraction - elapsed) > deviation) {
      deviation = std::fabs(look.fraction - elapsed);
      at = elapsed;
      told = look.fraction;
    }
  }
  std::printf("  %.2f s, %zu looks; fraction off by at most %.3f (%.3f told at %.3f of the time)\n", end - begin, looks.size(),
              deviation, told, at);
  return end - begin;
}

/// Cancelled after `delay` seconds, from another thread.
void measure_latency(const Call& call, unsigned threads, double delay, Stages& stages) {
  const amps::Progress progress;
  std::atomic<bool> over{false};
  double cancelled_at = 0;
  std::string shown;
  const double begin = seconds_now();
  std::thread canceller([&] {
    while (seconds_now() - begin < delay && !over) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    shown = progress.stage();
    cancelled_at = seconds_now();
    progress.cancel();
  });
  try {
    call({threads, progress});
  } catch (const amps::Error& error) {
    if (error.code() != amps::ErrorCode::kCancelled) throw;
  }
  const double returned = seconds_now();
  over = true;
  canceller.join();
  if (returned < cancelled_at) return;  // it was faster
  Stage& stage = stages[shown.empty() ? "begin" : shown];
  stage.latency = std::max(stage.latency, returned - cancelled_at);
  ++stage.cancels;
}

void measure(const char* name, const Call& call, unsigned threads, int cancels) {
  std::printf("%s, %u threads\n", name, threads);
  Stages stages;
  const double time = measure_silence(call, threads, stages);
  amps::Rng rng(1);
  for (int k = 0; k < cancels; ++k) measure_latency(call, threads, time * (k + rng.uniform()) / cancels, stages);
  std::printf("  %-32s %9s %12s %12s %8s\n", "stage", "s", "silence ms", "latency ms", "cancels");
  for (const Stage& stage : stages.all) {
    std::printf("  %-32s %9.2f %12.1f %12.1f %8d\n", stage.name.c_str(), stage.seconds, 1000 * stage.silence,
                1000 * stage.latency, stage.cancels);
  }
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const int samples = argc > 1 ? std::atoi(argv[1]) : 1000000;
  const auto threads = static_cast<unsigned>(argc > 2 ? std::atoi(argv[2]) : 1);
  const int cancels = argc > 3 ? std::atoi(argv[3]) : 12;
  const auto wanted = [&](const std::string& name) {
    return argc <= 4 || std::any_of(argv + 4, argv + argc, [&](const char* given) { return name == given; });
  };
  const amps::Mesh mesh = amps::make_sphere(20480);
  amps::RemeshOptions options;
  options.sampling.radius = std::sqrt(amps::kSamplesPerDensity * amps::total_area(mesh) / samples);
  const auto sampling_with = [&](const amps::Execution& execution) {
    amps::SamplingOptions sampling = options.sampling;
    sampling.execution = execution;
    return sampling;
  };
  if (wanted("sample")) {
    const Call call = [&](const amps::Execution& execution) { amps::sample(mesh, sampling_with(execution)); };
    measure("sample", call, threads, cancels);
  }
  if (wanted("remesh")) {
    const Call call = [&](const amps::Execution& execution) {
      amps::RemeshOptions all = options;
      all.sampling.execution = execution;
      amps::remesh(mesh, all);
    };
    measure("remesh", call, threads, cancels);
  }
  if (!wanted("verify_maximal") && !wanted("restricted_triangulation")) return 0;
  const amps::SampleSet set = amps::sample(mesh, options.sampling).samples;
  if (wanted("verify_maximal")) {
    const Call call = [&](const amps::Execution& execution) { amps::verify_maximal(mesh, set, execution); };
    measure("verify_maximal", call, threads, cancels);
  }
  if (wanted("restricted_triangulation")) {
    const Call call = [&](const amps::Execution& execution) { amps::restricted_triangulation(mesh, set, execution); };
    measure("restricted_triangulation", call, threads, cancels);
  }
  return 0;
}
