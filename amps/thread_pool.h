// thread_pool.h: (internal) threads that are started once and wait for work. One job owns one pool (execution.h).
#pragma once

#include "amps/base.h"

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

namespace amps::detail {

/// Threads for one caller at a time. They are started when the first work needs them, and joined by the destructor.
class ThreadPool {
 public:
  /// Starts a thread that calls the function it is given, or throws; std::thread's constructor unless a test wants to see it
  /// fail.
  using Starter = std::function<std::thread(std::function<void()>)>;

  /// At most `max_workers` (at least 1) do the work, the caller among them.
  explicit ThreadPool(unsigned max_workers, Starter starter = {});
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  /// Calls work(0), …, work(count − 1), each once, on the caller's thread and the pool's; returns when all have returned. Where
  /// the system refuses threads, those there are do all of it. `work` must not throw, and must not call run() of this pool.
  void run(unsigned count, const std::function<void(unsigned)>& work);

  /// How many threads have been started; the caller's is not one of them.
  std::size_t num_threads() const noexcept { return threads_.size(); }

 private:
  void start_threads(unsigned wanted);
  void wait_for_work();
  bool none_running() const noexcept { return running_.load(std::memory_order_relaxed) == 0; }

  const unsigned max_workers_;
  const Starter starter_;
  const bool stay_awake_;  // for a moment, when there is nothing to do
  std::vector<std::thread> threads_;
  bool refused_ = false;  // by the system: not asked again

  std::mutex mutex_;  // of all below; threads that wait awake read the atomics without it
  std::condition_variable work_there_, work_done_;
  const std::function<void(unsigned)>* work_ = nullptr;
  unsigned next_ = 0, count_ = 0;           // the numbers of the work that nobody has taken yet: [next_, count_)
  std::atomic<bool> something_new_{false};  // there is some, or the end has come
  std::atomic<unsigned> running_{0};        // how many of the pool's threads are at work
  bool closing_ = false;
};

/// Memory that pieces of a parallel loop use one after another: there are as many as work at the same time.
template <class Scratch>
class ScratchPool {
 public:
  /// Has one while it lives.
  class Loan {
   public:
    Loan(ScratchPool& pool, std::unique_ptr<Scratch> scratch) : pool_(pool), scratch_(std::move(scratch)) {}
    ~Loan() {
      const std::lock_guard<std::mutex> lock(pool_.mutex_);
      pool_.idle_.push_back(std::move(scratch_));
    }
    Loan(const Loan&) = delete;
    Loan& operator=(const Loan&) = delete;
    Scratch& operator*() const { return *scratch_; }
    Scratch* operator->() const { return scratch_.get(); }

   private:
    ScratchPool& pool_;
    std::unique_ptr<Scratch> scratch_;
  };

  /// One that is idle, or a new one: make() returns it.
  template <class Make>
  Loan lend(const Make& make) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (!idle_.empty()) {
        std::unique_ptr<Scratch> scratch = std::move(idle_.back());
        idle_.pop_back();
        return {*this, std::move(scratch)};
      }
      idle_.reserve(++num_made_);  // so that giving back does not throw
    }
    return {*this, make()};
  }

 private:
  std::mutex mutex_;
  std::size_t num_made_ = 0;
  std::vector<std::unique_ptr<Scratch>> idle_;
};

}  // namespace amps::detail
