// loop_times.h: what of a call threads can share, measured on one thread: its parallel loops are run in order on the caller's
// thread, each piece by the clock, and then dealt out to as many threads as one likes.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"

#include <algorithm>
#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace amps_bench {

/// Runs nothing beside anything else, but says that it could: so the code takes the ways it takes on `threads` threads.
class InOrder : public amps::Executor {
 public:
  explicit InOrder(unsigned threads) : threads_(threads) {}
  unsigned concurrency() const override { return threads_; }
  void run(unsigned count, const std::function<void(unsigned)>& work) override {
    for (unsigned k = 0; k < count; ++k) work(k);
  }

 private:
  unsigned threads_;
};

/// While one exists, it keeps the times of all loops whose Execution has an executor and more than one piece; loops within
/// pieces belong to these. (parallel_for() is replaced when the benchmark is linked, see CMakeLists.txt.) One at a time, with
/// InOrder.
class LoopTimes {
 public:
  struct Stage {
    double alone = 0;     ///< seconds outside of loops
    double shared = 0;    ///< within
    double longest = 0;   ///< without a break on one thread: outside of loops, or one piece
    double foreseen = 0;  ///< with `threads` threads, each piece to the first that is free
  };

  explicit LoopTimes(unsigned threads);
  ~LoopTimes();
  LoopTimes(const LoopTimes&) = delete;
  LoopTimes& operator=(const LoopTimes&) = delete;

  /// To be given to what is measured.
  amps::Progress progress() {
    return amps::Progress([this](const char* stage, double) {
      begin(stage);
      return true;
    });
  }
  /// What has happened so far, by the names that progress has told.
  const std::map<std::string, Stage>& stages();

 private:
  friend void time_loop(std::size_t n, std::size_t grain, const amps::Execution& execution,
                        const std::function<void(std::size_t, std::size_t)>& body);

  void begin(const char* stage);
  void end_of_stretch();
  void add_loop(const std::vector<double>& seconds_of_pieces);

  unsigned threads_;
  bool in_loop_ = false;
  std::map<std::string, Stage> stages_;
  std::string stage_ = "first";
  amps::detail::Stopwatch watch_;  // since the last loop or the begin of the stage
};

}  // namespace amps_bench
