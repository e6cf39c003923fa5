#include "loop_times.h"

namespace amps_bench {
namespace {

LoopTimes* present_loop_times = nullptr;

}  // namespace

// The linker makes calls of amps::parallel_for() calls of the first of these, and gives the second its code.
void time_loop(std::size_t n, std::size_t grain, const amps::Execution& execution,
               const std::function<void(std::size_t, std::size_t)>& body) asm("__wrap_" AMPS_BENCH_PARALLEL_FOR);
void loop_of_amps(std::size_t n, std::size_t grain, const amps::Execution& execution,
                  const std::function<void(std::size_t, std::size_t)>& body) asm("__real_" AMPS_BENCH_PARALLEL_FOR);

void time_loop(std::size_t n, std::size_t grain, const amps::Execution& execution,
               const std::function<void(std::size_t, std::size_t)>& body) {
  LoopTimes* const times = present_loop_times;
  if (times == nullptr || times->in_loop_ || execution.executor == nullptr || execution.workers() == 1 || n <= grain) {
    return loop_of_amps(n, grain, execution, body);
  }
  struct Guard {
    LoopTimes& times;
    explicit Guard(LoopTimes& t) : times(t) { times.in_loop_ = true; }
    ~Guard() {
      times.in_loop_ = false;
      times.watch_.lap();
    }
  };
  times->end_of_stretch();
  const Guard guard(*times);
  std::vector<double> seconds;
  loop_of_amps(n, grain, execution, [&](std::size_t begin, std::size_t end) {
    amps::detail::Stopwatch piece;
    body(begin, end);
    seconds.push_back(piece.lap());
  });
  times->add_loop(seconds);
}

LoopTimes::LoopTimes(unsigned threads) : threads_(threads) { present_loop_times = this; }
LoopTimes::~LoopTimes() { present_loop_times = nullptr; }

void LoopTimes::begin(const char* stage) {
  if (stage == nullptr || stage_ == stage) return;
  if (!in_loop_) end_of_stretch();
  stage_ = stage;
}

void LoopTimes::end_of_stretch() {
  const double seconds = watch_.lap();
  Stage& of_stage = stages_[stage_];
  of_stage.alone += seconds;
  of_stage.foreseen += seconds;
  of_stage.longest = std::max(of_stage.longest, seconds);
}

void LoopTimes::add_loop(const std::vector<double>& seconds_of_pieces) {
  Stage& of_stage = stages_[stage_];
  std::vector<double> busy_until(threads_, 0.0);
  for (const double seconds : seconds_of_pieces) {
    *std::min_element(busy_until.begin(), busy_until.end()) += seconds;
    of_stage.shared += seconds;
    of_stage.longest = std::max(of_stage.longest, seconds);
  }
  of_stage.foreseen += *std::max_element(busy_until.begin(), busy_until.end());
}

const std::map<std::string, LoopTimes::Stage>& LoopTimes::stages() {
  if (!in_loop_) end_of_stretch();
  return stages_;
}

}  // namespace amps_bench
