// execution.h: how a long call runs: on how many threads or on whose, who sees how far it is, and who can stop it. One value,
// Execution, carries all of it down from a user's call to the innermost loop.
//
//   amps::RemeshOptions options;
//   options.execution.threads = 4;
//   options.execution.progress = amps::Progress([](const char* stage, double fraction) {
//     std::cerr << stage << " " << 100 * fraction << " %\n";
//     return !user_wants_to_stop();
//   });
//
// A user's call is a job. It owns its threads: they are started when a loop first needs them, serve every loop of the job, and
// end with it. It has one fraction, which rises from 0 to 1 in proportion to time, as far as that can be foreseen; whoever
// calls something that takes long gives it a part of its own range (Execution::part). Threads change no bit of a result.
//
// Cancelling. A call that returns a status ends with what it has, valid but unfinished. Any other ends with
// Error(ErrorCode::kCancelled). Both do so within 100 ms, unless a callback or an Executor takes longer.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

namespace amps {

/// Progress and cancelling of one job at a time. Copies share one state, so keep one and pass another. Every member may be
/// called from any thread at any time, also from within the callback.
class Progress {
 public:
  /// Told how far the job is; returns false to cancel it. `stage` is a static string, what is being done in words for people;
  /// `fraction` is that of the whole job, in [0, 1], and never falls within a job. One call at a time, on whichever thread of
  /// the job has something to tell; none after the job is cancelled. Time spent here is lost to that thread, so be brief. An
  /// exception ends the job and reaches its caller. Start no job with the same Progress from here.
  using Callback = std::function<bool(const char* stage, double fraction)>;

  /// Often enough for a smooth bar, rarely enough for callbacks that draw one.
  static constexpr double kSecondsBetweenCalls = 0.01;

  AMPS_EXPORT Progress();
  /// Calls `callback` when a stage begins, when the job is complete, and in between where `seconds_between_calls` have passed
  /// since the last call ended. With 0 every report of the working code arrives, for tests; costly.
  AMPS_EXPORT explicit Progress(Callback callback, double seconds_between_calls = kSecondsBetweenCalls);

  /// Asks the job to stop. Stays in force: a job started later with this Progress stops at once.
  AMPS_EXPORT void cancel() const noexcept;
  AMPS_EXPORT bool cancelled() const noexcept;
  /// Where the present or last job is, for those who rather look than be called.
  AMPS_EXPORT double fraction() const noexcept;
  AMPS_EXPORT const char* stage() const noexcept;

 private:
  friend class Execution;
  struct State;

  void begin() const noexcept;
  bool publish(const char* stage, double fraction, bool silent = false) const;

  std::shared_ptr<State> state_;
};

/// A host's job system. amps runs everything on it in place of threads of its own, with the same bits.
///
///   struct TbbExecutor : amps::Executor {
///     unsigned concurrency() const override { return static_cast<unsigned>(tbb::this_task_arena::max_concurrency()); }
///     void run(unsigned count, const std::function<void(unsigned)>& work) override { tbb::parallel_for(0u, count, work); }
///   };
class AMPS_EXPORT Executor {
 public:
  virtual ~Executor();

  /// How many calls of `work` are worth while at the same time; with 0 or 1, amps does all work on the calling thread.
  virtual unsigned concurrency() const = 0;

  /// Calls work(0), …, work(count − 1), each once, and returns when all have returned. On any threads, in any order, at the
  /// same time or one after another: amps never waits in one call for another, so nothing can block. 2 ≤ count ≤ concurrency().
  /// `work` does not throw. If run() throws, no `work` may be running any more; the exception ends the job and reaches its
  /// caller. A job calls it from one thread at a time and never from within `work`; jobs that share an Executor may call it at
  /// the same time. Threads must round to nearest, else the job ends with Error(ErrorCode::kEnvironment).
  virtual void run(unsigned count, const std::function<void(unsigned)>& work) = 0;
};

namespace detail {
struct Job;
}

/// How a call runs. Cheap to copy. A user sets the fields; the functions below are for code that works, a user's own included:
/// with
///
///   const amps::Execution job = execution.start();
///   const amps::SamplingResult result = amps::sample(mesh, options_with(job.part(0, 0.9)));
///   amps::write_samples("samples.ply", result.samples, job.part(0.9, 1, "writing"));
///   job.finish();
///
/// two calls are one job, with one fraction and the same threads. A function that works calls start(), gives parts to those it
/// calls, reports from its own loops, and calls finish() on success.
class Execution {
 public:
  /// How many threads work, the caller's among them; 0: one per hardware core. Where the system refuses threads, fewer. Of no
  /// meaning with an executor. Once a job is started, it can be lowered for a call, not raised.
  unsigned threads = 1;

  Progress progress;

  /// Runs everything in place of threads of amps's own; not owned, must outlive the job.
  Executor* executor = nullptr;

  Execution() = default;
  /// Implicit: wherever an Execution is taken, a number of threads will do.
  Execution(unsigned num_threads, Progress watched_by = {}, Executor* runs_on = nullptr)  // NOLINT
      : threads(num_threads), progress(std::move(watched_by)), executor(runs_on) {}

  /// How many workers a parallel loop has; at least 1.
  AMPS_EXPORT unsigned workers() const;

  /// The same, as a job that has begun, its fraction at 0; where it is part of a job already, of that. The job's threads end
  /// with the last copy. `stage` names the work unless a caller has named it. Neither reports nor looks for a cancel, so that
  /// arguments can be checked first.
  [[nodiscard]] AMPS_EXPORT Execution start(const char* stage = nullptr) const;

  /// The piece of this one's range from `from` to `to` (0 ≤ from ≤ to ≤ 1), for a call or a loop that takes this share of the
  /// time. `stage` is a static string, in words that a person understands. The outermost name is the one that is shown: who
  /// names a part decides, and a part without a name leaves it to those below. Reports that it begins; throws as check() does.
  [[nodiscard]] AMPS_EXPORT Execution part(double from, double to, const char* stage = nullptr) const;

  /// The same threads, but nobody watches and nobody can cancel: for what has to be done after a cancel. Keep it short.
  [[nodiscard]] AMPS_EXPORT Execution without_progress() const;

  /// The same on the caller's thread alone, also with an executor: for calls that are not worth several.
  [[nodiscard]] AMPS_EXPORT Execution on_one_thread() const;

  bool cancelled() const noexcept { return progress.cancelled(); }

  /// Throws Error(kCancelled) if the job is cancelled. A few nanoseconds; to be called every few milliseconds.
  AMPS_EXPORT void check() const;

  /// Publishes that `fraction` of this one's range is done, then check(). Threads may report in any order: the farthest counts.
  /// Some 10 ns, and 50 where there is a callback.
  AMPS_EXPORT void report(double fraction) const;

  /// Publishes that all is done. Does not throw when cancelled: the result is complete by now.
  AMPS_EXPORT void finish() const;

 private:
  friend AMPS_EXPORT void parallel_for(std::size_t n, std::size_t grain, const Execution& execution,
                                       const std::function<void(std::size_t, std::size_t)>& body);

  double overall(double fraction) const noexcept;

  std::shared_ptr<detail::Job> job_;  // none before start()
  double from_ = 0, to_ = 1;          // this one's range in that of the job
  const char* stage_ = nullptr;
};

/// Runs body(begin, end) over consecutive pieces of [0, n) of `grain` elements each. Pieces depend only on n and grain, never
/// on the workers, so a body that writes per piece gives the same result on any. Looks for a cancel before each piece, and then
/// throws Error(kCancelled); a piece that takes more than a few milliseconds should look too. If pieces throw, no further ones
/// are begun, and the exception of the first (lowest begin) is rethrown when all workers have ended. Within a piece, a loop of
/// the same job runs on the piece's own thread. Does not report: see detail::WorkCounter.
AMPS_EXPORT void parallel_for(std::size_t n, std::size_t grain, const Execution& execution,
                              const std::function<void(std::size_t begin, std::size_t end)>& body);

namespace detail {

/// Runs body(begin, end) over consecutive pieces of [0, n) of `grain` elements each, on this thread, and reports after each:
/// for loops whose elements take so little that a Ticker would be dear.
template <class Body>
void for_each_piece(std::size_t n, std::size_t grain, const Execution& execution, const Body& body) {
  for (std::size_t begin = 0; begin < n;) {
    const std::size_t end = n - begin > grain ? begin + grain : n;
    body(begin, end);
    begin = end;
    execution.report(static_cast<double>(end) / static_cast<double>(n));
  }
}

/// Elements of a piece for such loops: up to 100 ns each, in a few milliseconds.
inline constexpr std::size_t kElementsPerLook = std::size_t{1} << 15;

/// The same with body(i) for each i in [0, n), elements of up to a microsecond.
template <class Integer, class Body>
void for_each_index(Integer n, const Execution& execution, const Body& body) {
  constexpr std::size_t kIndicesPerLook = kElementsPerLook / 8;
  for_each_piece(static_cast<std::size_t>(n), kIndicesPerLook, execution, [&body](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) body(static_cast<Integer>(i));
  });
}

/// Room to reserve for what n elements of a sampling may become: samples of gap filling add a third, and optimisation some
/// hundredths. Memory is not used before it is written to, and what never moves leaves no holes behind.
inline std::size_t room_for_more(std::size_t n) { return n + n / 2; }

/// values.resize(n, value), with looks between: fresh memory takes some 0.3 ms a megabyte.
template <class T>
void resize_watched(std::vector<T>& values, std::size_t n, const T& value, const Execution& execution) {
  constexpr std::size_t kPerPiece = (std::size_t{1} << 22) / sizeof(T);
  values.reserve(n);
  while (values.size() < n) {
    execution.report(0);
    values.resize(std::min(n, values.size() + kPerPiece), value);
  }
}

/// Runs `work`; false if it ended because it was cancelled.
template <class Work>
bool completes(const Work& work) {
  try {
    work();
    return true;
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kCancelled) throw;
    return false;
  }
}

/// Reports progress of a serial loop over `total` units of work, and looks for a cancel, every `units_per_look` units. tick()
/// throws as Execution::check() does.
class Ticker {
 public:
  /// 256 units of 10 µs, which is dear for a sample or a facet, are looked at 400 times a second; of 10 ns, a look costs 2 %.
  static constexpr std::uint64_t kUnitsPerLook = 256;

  Ticker(Execution execution, std::uint64_t total, std::uint64_t units_per_look = kUnitsPerLook)
      : execution_(std::move(execution)), total_(total), units_per_look_(units_per_look), next_look_(units_per_look) {}

  /// `units` more are done.
  void tick(std::uint64_t units = 1) {
    done_ += units;
    if (done_ >= next_look_) look();
  }

 private:
  void look();

  Execution execution_;
  std::uint64_t total_, units_per_look_, next_look_, done_ = 0;
};

/// The same for the bodies of a parallel loop: each adds what it has done, once in some 1,000 units or in a millisecond.
class WorkCounter {
 public:
  WorkCounter(Execution execution, std::uint64_t total) : execution_(std::move(execution)), total_(total) {}

  void add(std::uint64_t units);

 private:
  Execution execution_;
  std::uint64_t total_;
  std::atomic<std::uint64_t> done_{0};
};

/// for_each_piece() on all threads: parallel_for() that reports when a piece is done.
template <class Body>
void for_each_piece_on_all_threads(std::size_t n, std::size_t grain, const Execution& execution, const Body& body) {
  WorkCounter done(execution, n);
  parallel_for(n, grain, execution, [&](std::size_t begin, std::size_t end) {
    body(begin, end);
    done.add(end - begin);
  });
}

/// for_each_index() on all threads. `body` writes to i's own places.
template <class Body>
void for_each_index_on_all_threads(std::size_t n, const Execution& execution, const Body& body) {
  constexpr std::size_t kGrain = 2048;
  for_each_piece_on_all_threads(n, kGrain, execution, [&body](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) body(i);
  });
}

}  // namespace detail
}  // namespace amps

#include "amps/host_macros_end.h"
