#define AMPS_OWN_SOURCE
#include "amps/base.h"

#include <algorithm>
#include <exception>
#include <locale>
#include <mutex>
#include <sstream>
#include <thread>
#include <utility>
#include <vector>

namespace amps {

Rng::Rng(std::uint64_t seed) noexcept {
  for (std::uint64_t& word : state_) {  // splitmix64
    seed += 0x9e3779b97f4a7c15u;
    word = detail::scramble(seed);
  }
}

std::uint64_t Rng::below(std::uint64_t n) noexcept {
  // Reject the short last interval, so that every residue has the same number of preimages.
  const std::uint64_t threshold = (0 - n) % n;
  for (;;) {
    const std::uint64_t x = next();
    if (x >= threshold) return x % n;
  }
}

Vec3 uniform_barycentric(Rng& rng) noexcept {
  double u = rng.uniform();
  double v = rng.uniform();
  // Fold the unit square onto the triangle. Multiples of 2^-53 below 1: the reflection and 1 − u − v are exact, hence the
  // three coordinates are non-negative and sum to exactly 1.
  if (u + v > 1.0) {
    u = 1.0 - u;
    v = 1.0 - v;
  }
  return {1.0 - u - v, u, v};
}

Progress::Progress() : state_(std::make_shared<State>()) {}

Progress::Progress(Callback callback) : Progress() { state_->callback = std::move(callback); }

void Progress::cancel() noexcept { state_->cancelled.store(true, std::memory_order_relaxed); }

bool Progress::cancelled() const noexcept { return state_->cancelled.load(std::memory_order_relaxed); }

double Progress::fraction() const noexcept { return state_->fraction.load(std::memory_order_relaxed); }

const char* Progress::stage() const noexcept { return state_->stage.load(std::memory_order_relaxed); }

bool Progress::report(const char* stage, double fraction) const {
  {
    const std::lock_guard<std::mutex> lock(state_->report_mutex);
    // Threads report in any order: the farthest of a stage counts.
    if (state_->stage.load(std::memory_order_relaxed) == stage && fraction <= 1) {
      fraction = std::max(fraction, state_->fraction.load(std::memory_order_relaxed));
    }
    state_->stage.store(stage, std::memory_order_relaxed);
    state_->fraction.store(fraction, std::memory_order_relaxed);
    if (state_->callback && !state_->callback(stage, fraction)) {
      state_->cancelled.store(true, std::memory_order_relaxed);
    }
  }
  return !cancelled();
}

void parallel_for(std::size_t n, std::size_t grain, unsigned threads,
                  const std::function<void(std::size_t, std::size_t)>& body) {
  if (n == 0) return;
  grain = std::max<std::size_t>(grain, 1);
  const std::size_t pieces = (n + grain - 1) / grain;
  if (threads == 0) threads = std::max(1u, std::thread::hardware_concurrency());
  const std::size_t workers = std::min<std::size_t>(threads, pieces);
  if (workers <= 1) {
    for (std::size_t p = 0; p < pieces; ++p) body(p * grain, std::min(n, (p + 1) * grain));
    return;
  }

  std::atomic<std::size_t> next_piece{0};
  std::mutex failure_mutex;
  std::exception_ptr failure;
  std::size_t failed_piece = pieces;
  const auto work = [&] {
    for (std::size_t p = next_piece++; p < pieces; p = next_piece++) {
      try {
        body(p * grain, std::min(n, (p + 1) * grain));
      } catch (...) {
        const std::lock_guard<std::mutex> lock(failure_mutex);
        if (p < failed_piece) {
          failed_piece = p;
          failure = std::current_exception();
        }
      }
    }
  };
  std::vector<std::thread> pool;
  pool.reserve(workers - 1);
  for (std::size_t t = 1; t < workers; ++t) pool.emplace_back(work);
  work();
  for (std::thread& thread : pool) thread.join();
  if (failure) std::rethrow_exception(failure);
}

namespace detail {

std::string number_text(double x) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text << x;
  return text.str();
}

void assertion_failed(const char* condition, const char* file, int line) {
  throw Error(ErrorCode::kInternal, std::string("amps: internal error, please report it: ") + condition + " does not hold at " +
                                        file + ":" + std::to_string(line));
}

}  // namespace detail
}  // namespace amps
