#define AMPS_OWN_SOURCE
#include "amps/thread_pool.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

namespace amps::detail {
namespace {

/// A thread that has nothing to do stays awake for so long: to wake one takes some 20 microseconds, and loops of a fraction of
/// a millisecond follow each other within less (optimisation, gap filling). It lets others have the processor meanwhile.
constexpr std::chrono::microseconds kTimeAwake{100};

/// Where there are more threads than processors, those that wait awake would only be in the way of those that work.
bool has_a_processor_each(unsigned num_threads) {
  const unsigned processors = std::thread::hardware_concurrency();  // 0: not known
  return processors == 0 || num_threads <= processors;
}

template <class Condition>
void wait_awake(const Condition& holds) {
  if (holds()) return;
  const auto end = std::chrono::steady_clock::now() + kTimeAwake;
  do {
    std::this_thread::yield();
  } while (!holds() && std::chrono::steady_clock::now() < end);
}

}  // namespace

ThreadPool::ThreadPool(unsigned max_workers, Starter starter)
    : max_workers_(std::max(1u, max_workers)), starter_(std::move(starter)), stay_awake_(has_a_processor_each(max_workers_)) {}

ThreadPool::~ThreadPool() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    closing_ = true;
    something_new_.store(true, std::memory_order_relaxed);
  }
  work_there_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void ThreadPool::start_threads(unsigned wanted) {
  wanted = std::min(wanted, max_workers_ - 1);
  while (threads_.size() < wanted && !refused_) {
    try {
      threads_.reserve(wanted);  // a running thread that found no place here would end the program
      const auto loop = [this] { wait_for_work(); };
      threads_.push_back(starter_ ? starter_(loop) : std::thread(loop));
    } catch (const std::exception&) {  // std::system_error or std::bad_alloc
      refused_ = true;
    }
  }
}

void ThreadPool::run(unsigned count, const std::function<void(unsigned)>& work) {
  if (count == 0) return;
  start_threads(count - 1);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    work_ = &work;
    next_ = 1;
    count_ = count;
    something_new_.store(next_ < count_, std::memory_order_relaxed);
  }
  for (std::size_t i = 0; i < std::min<std::size_t>(count - 1, threads_.size()); ++i) work_there_.notify_one();
  work(0);
  std::unique_lock<std::mutex> lock(mutex_);
  while (next_ < count_) {  // what no thread has woken up for yet
    const unsigned i = next_++;
    something_new_.store(next_ < count_, std::memory_order_relaxed);
    lock.unlock();
    work(i);
    lock.lock();
  }
  if (none_running()) return;
  if (stay_awake_) {
    lock.unlock();
    wait_awake([this] { return none_running(); });
    lock.lock();
  }
  work_done_.wait(lock, [this] { return none_running(); });
}

void ThreadPool::wait_for_work() {
  for (;;) {
    if (stay_awake_) wait_awake([this] { return something_new_.load(std::memory_order_relaxed); });
    std::unique_lock<std::mutex> lock(mutex_);
    work_there_.wait(lock, [this] { return closing_ || next_ < count_; });
    if (closing_) return;
    const unsigned i = next_++;
    something_new_.store(next_ < count_, std::memory_order_relaxed);
    running_.fetch_add(1, std::memory_order_relaxed);
    const std::function<void(unsigned)>& work = *work_;
    lock.unlock();
    work(i);
    lock.lock();
    if (running_.fetch_sub(1, std::memory_order_relaxed) == 1) work_done_.notify_one();
  }
}

}  // namespace amps::detail
