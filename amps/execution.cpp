#define AMPS_OWN_SOURCE
#include "amps/execution.h"

#include "amps/thread_pool.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <limits>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

namespace amps {
namespace {

std::int64_t nanoseconds_now() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

struct Progress::State {
  std::atomic<bool> cancelled{false};
  std::atomic<double> fraction{0.0};
  std::atomic<const char*> stage{""};
  Callback callback;
  std::int64_t between_calls = 0;                                                 // nanoseconds
  std::atomic<std::int64_t> next_call{std::numeric_limits<std::int64_t>::min()};  // not before this time
  std::mutex calling;
  std::atomic<std::thread::id> caller{std::thread::id()};  // the thread that is in the callback

  void call();
};

/// With `calling` held.
void Progress::State::call() {
  struct CallerGuard {
    State& state;
    explicit CallerGuard(State& s) : state(s) { state.caller.store(std::this_thread::get_id(), std::memory_order_relaxed); }
    ~CallerGuard() {
      state.caller.store(std::thread::id(), std::memory_order_relaxed);
      // From the end of the call: a slow callback must not fill all the time there is.
      state.next_call.store(nanoseconds_now() + state.between_calls, std::memory_order_relaxed);
    }
  };
  const CallerGuard guard(*this);
  if (!callback(stage.load(std::memory_order_relaxed), fraction.load(std::memory_order_relaxed))) {
    cancelled.store(true, std::memory_order_relaxed);
  }
}

Progress::Progress() : state_(std::make_shared<State>()) {}

Progress::Progress(Callback callback, double seconds_between_calls) : Progress() {
  // No more than an hour, and no NaN, so that times of calls do not overflow.
  const double seconds = std::min(std::max(0.0, seconds_between_calls), 3600.0);
  state_->callback = std::move(callback);
  state_->between_calls = static_cast<std::int64_t>(seconds * 1e9);
}

void Progress::cancel() const noexcept { state_->cancelled.store(true, std::memory_order_relaxed); }

bool Progress::cancelled() const noexcept { return state_->cancelled.load(std::memory_order_relaxed); }

double Progress::fraction() const noexcept { return state_->fraction.load(std::memory_order_relaxed); }

const char* Progress::stage() const noexcept { return state_->stage.load(std::memory_order_relaxed); }

/// A job begins: the fraction and the stage of the one before are forgotten.
void Progress::begin() const noexcept {
  state_->fraction.store(0.0, std::memory_order_relaxed);
  state_->stage.store("", std::memory_order_relaxed);
}

/// Raises the fraction to `fraction` and calls back where that is due. Returns false if the job should stop. Without a stage
/// (null) that of before stays.
bool Progress::publish(const char* stage, double fraction) const {
  State& state = *state_;
  if (cancelled()) return false;
  double before = state.fraction.load(std::memory_order_relaxed);
  while (before < fraction && !state.fraction.compare_exchange_weak(before, fraction, std::memory_order_relaxed)) {
  }
  const bool complete = before < 1 && fraction >= 1;
  const bool new_stage = stage != nullptr && state.stage.load(std::memory_order_relaxed) != stage &&
                         state.stage.exchange(stage, std::memory_order_relaxed) != stage;
  const bool nameless = *state.stage.load(std::memory_order_relaxed) == '\0';  // the first stage is about to begin
  if (!state.callback || (nameless && !complete)) return true;
  if (state.caller.load(std::memory_order_relaxed) == std::this_thread::get_id()) return true;  // a report from the callback

  std::unique_lock<std::mutex> lock(state.calling, std::defer_lock);
  if (complete || new_stage) {
    lock.lock();
  } else {
    const std::int64_t now = nanoseconds_now();
    if (now < state.next_call.load(std::memory_order_relaxed) || !lock.try_lock()) return !cancelled();
    // Another thread may have called just now.
    if (now < state.next_call.load(std::memory_order_relaxed)) return !cancelled();
  }
  if (!cancelled()) state.call();
  return !cancelled();
}

Executor::~Executor() = default;

namespace detail {

/// What the copies of a started Execution share.
struct Job {
  explicit Job(unsigned workers) : pool(workers) {}

  ThreadPool pool;
  std::atomic<bool> in_loop{false};  // a parallel loop is running
};

namespace {

[[noreturn]] void throw_cancelled(const char* stage) {
  throw Error(ErrorCode::kCancelled, std::string("cancelled through Progress") + (*stage ? " during: " : "") + stage);
}

/// Above 1 where more is done than was foreseen.
double share_done(std::uint64_t done, std::uint64_t total) noexcept {
  return static_cast<double>(done) / static_cast<double>(std::max<std::uint64_t>(total, 1));
}

/// The pieces of one parallel loop, handed out in their order to whoever comes.
class PieceLoop {
 public:
  using Body = std::function<void(std::size_t, std::size_t)>;

  PieceLoop(std::size_t n, std::size_t grain, const Execution& execution, const Body& body)
      : n_(n), grain_(std::max<std::size_t>(grain, 1)), num_pieces_((n - 1) / grain_ + 1), execution_(execution), body_(body) {}

  std::size_t num_pieces() const noexcept { return num_pieces_; }

  void run_serially() const {
    for (std::size_t p = 0; p < num_pieces_; ++p) {
      execution_.check();
      run_piece(p);
    }
  }

  /// Takes pieces until there are none, or there is a reason to stop. A piece that is taken is run, and pieces are taken in
  /// their order: so the first piece that throws is always found, whoever is faster.
  void take_pieces() noexcept {
    while (!stopped_.load(std::memory_order_relaxed) && !execution_.cancelled()) {
      const std::size_t p = next_.fetch_add(1, std::memory_order_relaxed);
      if (p >= num_pieces_) return;
      try {
        require_exact_arithmetic();  // of a thread that may be the host's
        run_piece(p);
      } catch (...) {
        fail(p);
      }
      done_.fetch_add(1, std::memory_order_relaxed);
    }
  }

  /// After all workers have returned.
  void rethrow_failure() const {
    if (failure_) std::rethrow_exception(failure_);
    if (done_.load(std::memory_order_relaxed) < num_pieces_) execution_.check();
  }

 private:
  void run_piece(std::size_t p) const {
    const std::size_t begin = p * grain_;
    body_(begin, begin + std::min(grain_, n_ - begin));
  }

  void fail(std::size_t p) noexcept {
    const std::lock_guard<std::mutex> lock(failure_mutex_);
    if (!failure_ || p < failed_piece_) {
      failed_piece_ = p;
      failure_ = std::current_exception();
    }
    stopped_.store(true, std::memory_order_relaxed);
  }

  const std::size_t n_, grain_, num_pieces_;
  const Execution& execution_;
  const Body& body_;
  std::atomic<std::size_t> next_{0}, done_{0};
  std::atomic<bool> stopped_{false};
  std::mutex failure_mutex_;
  std::size_t failed_piece_ = 0;
  std::exception_ptr failure_;
};

/// Holds a job's one parallel loop. A loop within a piece of another does not get it, and neither does a second thread of the
/// user.
class LoopGuard {
 public:
  explicit LoopGuard(Job& job) noexcept : job_(job), first_(!job.in_loop.exchange(true, std::memory_order_acquire)) {}
  ~LoopGuard() {
    if (first_) job_.in_loop.store(false, std::memory_order_release);
  }
  LoopGuard(const LoopGuard&) = delete;
  LoopGuard& operator=(const LoopGuard&) = delete;

  bool first() const noexcept { return first_; }

 private:
  Job& job_;
  const bool first_;
};

}  // namespace

void Ticker::look() {
  next_look_ = done_ + units_per_look_;
  execution_.report(share_done(done_, total_));
}

void WorkCounter::add(std::uint64_t units) {
  execution_.report(share_done(done_.fetch_add(units, std::memory_order_relaxed) + units, total_));
}

}  // namespace detail

unsigned Execution::workers() const {
  if (executor) return std::max(1u, executor->concurrency());
  return std::max(1u, threads == 0 ? std::thread::hardware_concurrency() : threads);
}

Execution Execution::start(const char* stage) const {
  Execution job = *this;
  if (!job.stage_) job.stage_ = stage;
  if (job.job_) return job;
  if (!job.executor) job.threads = workers();
  job.job_ = std::make_shared<detail::Job>(job.threads);
  progress.begin();
  return job;
}

Execution Execution::part(double from, double to, const char* stage) const {
  Execution part = *this;
  part.from_ = overall(from);
  part.to_ = overall(to);
  if (!part.stage_) part.stage_ = stage;
  part.report(0);
  return part;
}

Execution Execution::without_progress() const {
  Execution unseen = *this;
  unseen.progress = Progress();
  return unseen;
}

Execution Execution::on_one_thread() const {
  Execution alone = *this;
  alone.threads = 1;
  alone.executor = nullptr;
  return alone;
}

/// Never outside the range, whatever rounding does, and exactly at its end for 1.
double Execution::overall(double fraction) const noexcept {
  if (fraction >= 1) return to_;
  return fraction > 0 ? std::min(to_, from_ + (to_ - from_) * fraction) : from_;
}

void Execution::check() const {
  if (cancelled()) detail::throw_cancelled(progress.stage());
}

void Execution::report(double fraction) const {
  if (!progress.publish(stage_, overall(fraction))) detail::throw_cancelled(progress.stage());
}

void Execution::finish() const { progress.publish(stage_, to_); }

void parallel_for(std::size_t n, std::size_t grain, const Execution& execution,
                  const std::function<void(std::size_t, std::size_t)>& body) {
  if (n == 0) return;
  detail::PieceLoop loop(n, grain, execution, body);
  const unsigned workers = static_cast<unsigned>(std::min<std::size_t>(execution.workers(), loop.num_pieces()));
  if (workers == 1) return loop.run_serially();
  const std::shared_ptr<detail::Job> job = execution.job_ ? execution.job_ : std::make_shared<detail::Job>(workers);
  {
    const detail::LoopGuard guard(*job);
    if (!guard.first()) return loop.run_serially();
    const std::function<void(unsigned)> work = [&loop](unsigned) { loop.take_pieces(); };
    if (execution.executor) {
      execution.executor->run(workers, work);
      loop.take_pieces();  // whatever it has not called work for
    } else {
      job->pool.run(workers, work);
    }
  }
  loop.rethrow_failure();
}

}  // namespace amps
