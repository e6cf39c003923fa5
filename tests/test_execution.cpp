#include "amps/execution.h"

#include "amps/thread_pool.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <atomic>
#include <cfenv>
#include <functional>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

using amps::Error;
using amps::ErrorCode;
using amps::Execution;
using amps::Executor;
using amps::parallel_for;
using amps::Progress;
using amps::Rng;
using amps::detail::ThreadPool;
using amps::detail::Ticker;
using amps::detail::WorkCounter;

namespace {

using Work = std::function<void(unsigned)>;

constexpr double kAlways = 0;    // seconds between calls: every report arrives
constexpr double kNever = 3600;  // only those that always arrive

/// Everything a callback is told.
struct Record {
  std::vector<std::pair<std::string, double>> calls;

  Progress progress(double seconds_between_calls) {
    return Progress(
        [this](const char* stage, double fraction) {
          calls.emplace_back(stage, fraction);
          return true;
        },
        seconds_between_calls);
  }
  std::vector<std::string> stages() const {
    std::vector<std::string> result;
    for (const auto& call : calls) {
      if (result.empty() || result.back() != call.first) result.push_back(call.first);
    }
    return result;
  }
  bool rising() const {
    for (std::size_t i = 0; i < calls.size(); ++i) {
      if (!(calls[i].second >= (i == 0 ? 0 : calls[i - 1].second) && calls[i].second <= 1)) return false;
    }
    return true;
  }
};

template <class Function>
bool throws_cancelled(const Function& function) {
  try {
    function();
  } catch (const Error& error) {
    return error.code() == ErrorCode::kCancelled;
  }
  return false;
}

/// A number for each thread that ever was. (The system gives the ids of ended threads to new ones.)
int number_of_this_thread() {
  static std::atomic<int> next{0};
  thread_local const int number = next++;
  return number;
}

/// Host systems of several kinds, all within the contract.
struct InOrder : Executor {
  int runs = 0;
  unsigned concurrency() const override { return 4; }
  void run(unsigned count, const Work& work) override {
    ++runs;
    for (unsigned i = 0; i < count; ++i) work(i);
  }
};
struct Reversed : Executor {
  unsigned concurrency() const override { return 7; }
  void run(unsigned count, const Work& work) override {
    for (unsigned i = count; i-- > 0;) work(i);
  }
};
struct OnThreads : Executor {
  unsigned concurrency() const override { return 3; }
  void run(unsigned count, const Work& work) override {
    std::vector<std::thread> threads;
    for (unsigned i = 0; i < count; ++i) threads.emplace_back([&work, i] { work(i); });
    for (std::thread& thread : threads) thread.join();
  }
};
/// Out of contract: does nothing at all.
struct Idle : Executor {
  unsigned concurrency() const override { return 3; }
  void run(unsigned, const Work&) override {}
};
struct Single : Executor {
  unsigned concurrency() const override { return 0; }
  void run(unsigned, const Work&) override { throw std::logic_error("not to be called"); }
};
/// amps's own pool, where the system allows no more than a number of threads.
struct Refusing : Executor {
  explicit Refusing(int allowed)
      : pool(8, [this, allowed](const std::function<void()>& loop) {
          ++asked;
          if (asked > allowed) throw std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again));
          return std::thread(loop);
        }) {}
  unsigned concurrency() const override { return 8; }
  void run(unsigned count, const Work& work) override { pool.run(count, work); }

  int asked = 0;
  ThreadPool pool;
};

/// Calls test(execution) for each way there is to run a loop.
template <class Test>
void on_each_way(const Test& test) {
  for (const unsigned threads : {0u, 1u, 2u, 3u, 16u}) {
    CAPTURE(threads);
    test(Execution(threads));
    test(Execution(threads).start());
  }
  InOrder in_order;
  Reversed reversed;
  OnThreads on_threads;
  Idle idle;
  Single single;
  Refusing none(0), one(1);
  for (Executor* const executor : std::vector<Executor*>{&in_order, &reversed, &on_threads, &idle, &single, &none, &one}) {
    Execution execution;
    execution.executor = executor;
    test(execution.start());
  }
}

/// Splits [0, 1] at random, to a depth, and reports in random order at the leaves.
void work_at_random(Rng& rng, const Execution& execution, int depth) {
  if (depth == 0) {
    for (int i = 0; i < 20; ++i) execution.report(rng.uniform() * 1.2 - 0.1);
    return execution.finish();
  }
  std::vector<double> cuts{0, 1};
  for (int i = 0; i < 3; ++i) cuts.push_back(rng.uniform());
  std::sort(cuts.begin(), cuts.end());
  for (std::size_t i = 0; i + 1 < cuts.size(); ++i) work_at_random(rng, execution.part(cuts[i], cuts[i + 1]), depth - 1);
  execution.finish();
}

}  // namespace

TEST_CASE("execution: a report within nested parts is a place in the whole, computed by hand") {
  Record record;
  const Execution job = Execution(1, record.progress(kAlways)).start();
  CHECK(job.progress.fraction() == 0);
  const Execution second = job.part(0.5, 0.75);
  CHECK(job.progress.fraction() == 0.5);
  const Execution last = second.part(0.5, 1);
  CHECK(job.progress.fraction() == 0.625);
  last.report(0.5);
  CHECK(job.progress.fraction() == 0.6875);
  last.report(7);  // never outside its range
  CHECK(job.progress.fraction() == 0.75);
  job.part(0, 0.5).report(1);  // never back
  CHECK(job.progress.fraction() == 0.75);
  job.report(1);
  CHECK(job.progress.fraction() == 1);
  // A part ends where it was said to, also where from + (to - from) is rounded to something else.
  const Execution other = Execution(1, Progress()).start();
  const double from = 0x1p-54, to = 1 - 0x1p-53;
  REQUIRE(from + (to - from) < to);
  other.part(from, to).report(1);
  CHECK(other.progress.fraction() == to);
}

TEST_CASE("execution: however parts are nested, the fraction rises from 0 to exactly 1") {
  Rng rng(1);
  for (int round = 0; round < 50; ++round) {
    Record record;
    const Execution job = Execution(1, record.progress(kAlways)).start("at random");
    work_at_random(rng, job, 3);
    CHECK(record.rising());
    REQUIRE(record.calls.size() > 64 * 20);
    CHECK(record.calls.front().second == 0);
    CHECK(record.calls.back().second == 1);
    CHECK(job.progress.fraction() == 1);
  }
}

TEST_CASE("execution: reports of many threads arrive one at a time, and the fraction never falls") {
  std::atomic<int> inside{0};
  bool alone = true;
  double last = 0;
  bool rising = true;
  std::size_t calls = 0;
  const Progress progress(
      [&](const char*, double fraction) {
        alone = alone && ++inside == 1;
        rising = rising && fraction >= last;
        last = fraction;
        ++calls;
        --inside;
        return true;
      },
      kAlways);
  const Execution job = Execution(1, progress).start("work");
  std::vector<std::thread> threads;
  for (std::uint64_t t = 0; t < 8; ++t) {
    threads.emplace_back([&job, t] {
      Rng rng(t);
      for (int i = 0; i < 2000; ++i) job.report(rng.uniform() * i / 2000);
    });
  }
  for (std::thread& thread : threads) thread.join();
  job.finish();
  CHECK(alone);
  CHECK(rising);
  CHECK(last == 1);
  CHECK(calls > 100);
}

TEST_CASE("execution: the outermost name of a stage is shown, and parts without a name leave it to those below") {
  Record record;
  const Execution job = Execution(1, record.progress(kAlways)).start();
  job.part(0, 0.1, "reading").part(0, 1, "parsing").report(1);
  const Execution middle = job.part(0.2, 0.5);
  middle.part(0, 0.5, "darts").start("inner").report(0.3);
  middle.part(0.5, 1).start("gaps").report(0.3);
  job.part(0.5, 1, "writing").report(1);
  CHECK(record.stages() == std::vector<std::string>{"reading", "darts", "gaps", "writing"});
  CHECK(job.progress.stage() == std::string("writing"));
  // The name of a whole call, unless it is part of another.
  CHECK(Execution(1, Progress()).start("alone").part(0, 1, "inside").progress.stage() == std::string("alone"));
}

TEST_CASE("execution: between calls time passes, but no stage is missed, nor the end") {
  Record record;
  const Execution job = Execution(1, record.progress(kNever)).start();
  for (const char* const stage : {"a", "b", "c"}) {
    const double from = (*stage - 'a') * 0.25;
    const Execution part = job.part(from, from + 0.25, stage);
    for (int i = 0; i < 1000; ++i) part.report(i / 1000.0);
  }
  const Execution end = job.part(0.75, 1, "c");
  for (int i = 0; i <= 1000; ++i) end.report(i / 1000.0);
  end.report(1);
  job.part(0, 1, "c").finish();
  const std::vector<std::pair<std::string, double>> expected = {{"a", 0}, {"b", 0.25}, {"c", 0.5}, {"c", 1}};
  CHECK(record.calls == expected);
}

TEST_CASE("execution: with no time between calls, every report arrives") {
  Record record;
  const Execution job = Execution(1, record.progress(kAlways)).start("work");
  for (int i = 0; i < 1000; ++i) job.report(i / 1000.0);
  CHECK(record.calls.size() == 1000);
}

TEST_CASE("execution: a job begins at 0 whatever was before, a part of a job where the job is") {
  const Progress progress;
  const Execution execution(1, progress);
  execution.start("first").finish();
  CHECK(progress.fraction() == 1);
  const Execution job = execution.start("second");
  CHECK(progress.fraction() == 0);
  const Execution half = job.part(0.5, 1);
  CHECK(half.start("inner").progress.fraction() == 0.5);
  // A user's own two calls as one job.
  Record record;
  const Execution whole = Execution(1, record.progress(kAlways)).start();
  for (const double from : {0.0, 0.5}) whole.part(from, from + 0.5).start("call").finish();
  CHECK(record.rising());
  CHECK(record.calls.back() == std::make_pair(std::string("call"), 1.0));
}

TEST_CASE("execution: cancelled from the callback, the report throws and names the stage, and nothing more is called") {
  int calls = 0;
  const Progress progress([&](const char*, double fraction) { return ++calls > 0 && fraction < 0.5; }, kAlways);
  const Execution job = Execution(1, progress).start("counting");
  job.report(0.4);
  CHECK(!job.cancelled());
  try {
    job.report(0.5);
    FAIL("not cancelled");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::kCancelled);
    CHECK(std::string(error.what()).find("counting") != std::string::npos);
  }
  CHECK(calls == 2);
  CHECK(job.cancelled());
  CHECK(throws_cancelled([&] { job.check(); }));
  CHECK(throws_cancelled([&] { job.report(0.6); }));
  CHECK(throws_cancelled([&] { static_cast<void>(job.part(0.7, 1, "next")); }));
  job.finish();  // a complete result stays one
  CHECK(calls == 2);
  CHECK(progress.fraction() == 0.5);
  // A cancel stays in force for later jobs; to start one is no look.
  const Execution later = Execution(1, progress).start("later");
  CHECK(throws_cancelled([&] { later.check(); }));
  // What must be done all the same.
  const Execution tidy = later.without_progress();
  tidy.part(0, 0.5, "tidying").report(0.5);
  int pieces = 0;
  parallel_for(10, 1, tidy, [&](std::size_t, std::size_t) { ++pieces; });
  CHECK(pieces == 10);
  CHECK(calls == 2);
}

TEST_CASE("execution: cancelled from another thread, loops end") {
  for (const unsigned threads : {1u, 4u}) {
    const Progress progress;
    const Execution job = Execution(threads, progress).start();
    std::atomic<bool> began{false};
    std::thread other([&] {
      while (!began) std::this_thread::yield();
      progress.cancel();
    });
    CHECK(throws_cancelled([&] {
      for (;;) {
        parallel_for(100, 1, job, [&](std::size_t, std::size_t) { began = true; });
      }
    }));
    other.join();
  }
}

TEST_CASE("execution: an exception of the callback reaches the caller, from any worker") {
  on_each_way([](Execution execution) {
    execution.progress = Progress([](const char*, double) -> bool { throw std::runtime_error("no more"); });
    const Execution job = execution.start("work");
    CHECK_THROWS_WITH_AS(job.report(0.5), "no more", std::runtime_error);
    CHECK_THROWS_WITH_AS(parallel_for(100, 1, execution.start("again"), [&](std::size_t, std::size_t) { job.report(1); }),
                         "no more", std::runtime_error);
  });
}

TEST_CASE("execution: a callback may look, cancel, and even report") {
  Progress progress;
  int calls = 0;
  Execution job;
  progress = Progress(
      [&](const char*, double fraction) {
        ++calls;
        job.report(1);
        CHECK(progress.fraction() == 1);
        CHECK(progress.stage() == std::string("work"));
        progress.cancel();
        return fraction >= 0;
      },
      kAlways);
  job = Execution(1, progress).start("work");
  CHECK(throws_cancelled([&] { job.report(0.1); }));
  CHECK(calls == 1);
}

TEST_CASE("execution: pieces are the same on any workers, each is run once, and sums have the same bits") {
  for (const std::size_t n : {0u, 1u, 5u, 64u, 1000u}) {
    for (const std::size_t grain : {0u, 1u, 7u, 64u, 5000u}) {
      CAPTURE(n);
      CAPTURE(grain);
      const std::size_t size = std::max<std::size_t>(grain, 1);
      const std::size_t pieces = (n + size - 1) / size;
      std::vector<double> expected(pieces, 0.0);
      for (std::size_t i = 0; i < n; ++i) expected[i / size] += 1.0 / static_cast<double>(i + 3);
      on_each_way([&](const Execution& execution) {
        std::vector<double> sums(pieces, 0.0);
        std::vector<std::atomic<int>> runs(pieces);
        bool as_agreed = true;
        parallel_for(n, grain, execution, [&](std::size_t begin, std::size_t end) {
          if (begin % size != 0 || end != std::min(n, begin + size)) as_agreed = false;
          ++runs[begin / size];
          for (std::size_t i = begin; i < end; ++i) sums[begin / size] += 1.0 / static_cast<double>(i + 3);
        });
        CHECK(as_agreed);
        CHECK(std::all_of(runs.begin(), runs.end(), [](const std::atomic<int>& r) { return r == 1; }));
        CHECK(sums == expected);
      });
    }
  }
}

TEST_CASE("execution: grains near the largest number there is") {
  const std::size_t huge = static_cast<std::size_t>(-1);
  int runs = 0;
  parallel_for(3, huge, 2, [&](std::size_t begin, std::size_t end) { runs += begin == 0 && end == 3; });
  parallel_for(huge, huge, 2, [&](std::size_t begin, std::size_t end) { runs += begin == 0 && end == huge; });
  CHECK(runs == 2);
  std::vector<std::size_t> ends;
  parallel_for(huge, huge / 2 + 1, 1, [&](std::size_t, std::size_t end) { ends.push_back(end); });
  CHECK(ends == std::vector<std::size_t>{huge / 2 + 1, huge});
}

TEST_CASE("execution: of pieces that throw, the first is rethrown, and no new ones are begun") {
  for (int round = 0; round < 20; ++round) {
    on_each_way([&](const Execution& execution) {
      std::atomic<int> begun{0};
      std::atomic<bool> thrown{false};
      try {
        parallel_for(100000, 1, execution, [&](std::size_t i, std::size_t) {
          ++begun;
          if (i < 3) return;
          if (i == 3 && round % 2 == 0) {  // later pieces throw first if there are workers for them
            for (int wait = 0; wait < 1000 && !thrown; ++wait) std::this_thread::yield();
          }
          thrown = true;
          throw std::runtime_error(std::to_string(i));
        });
        FAIL("nothing was thrown");
      } catch (const std::runtime_error& error) {
        CHECK(error.what() == std::string("3"));
      }
      CHECK(begun < 100000);
      // The job goes on.
      std::atomic<int> runs{0};
      parallel_for(10, 1, execution, [&](std::size_t, std::size_t) { ++runs; });
      CHECK(runs == 10);
    });
  }
}

TEST_CASE("execution: a loop looks for a cancel before each piece") {
  on_each_way([](Execution execution) {
    execution.progress = Progress();
    const Execution job = execution.start();
    std::atomic<int> begun{0};
    CHECK(throws_cancelled([&] {
      parallel_for(100000, 1, job, [&](std::size_t i, std::size_t) {
        ++begun;
        if (i == 5) job.progress.cancel();
      });
    }));
    CHECK(begun >= 6);
    CHECK(begun < 100000);
    begun = 0;
    CHECK(throws_cancelled([&] { parallel_for(10, 1, job, [&](std::size_t, std::size_t) { ++begun; }); }));
    CHECK(begun == 0);
  });
  // The last piece is done: so is the loop.
  const Execution job = Execution(4).start();
  parallel_for(1, 1, job, [&](std::size_t, std::size_t) { job.progress.cancel(); });
  Execution other = Execution(4, Progress()).start();
  std::atomic<int> left{8};
  parallel_for(8, 1, other, [&](std::size_t, std::size_t) {
    if (--left == 0) other.progress.cancel();
  });
  CHECK(left == 0);
}

TEST_CASE("execution: a loop within a piece runs on the piece's thread, and never reaches the host") {
  on_each_way([](const Execution& execution) {
    const Execution job = execution.start();
    std::atomic<int> elsewhere{0}, runs{0};
    parallel_for(20, 1, job, [&](std::size_t, std::size_t) {
      const std::thread::id here = std::this_thread::get_id();
      parallel_for(20, 1, job.part(0, 1), [&](std::size_t, std::size_t) {
        elsewhere += std::this_thread::get_id() != here;
        ++runs;
      });
    });
    CHECK(runs == 400);
    // Where the outer loop has no workers of its own, the inner one may have them; it has no use for them here.
    if (job.workers() > 1) CHECK(elsewhere == 0);
  });
  InOrder in_order;
  const Execution job = Execution(1, {}, &in_order).start();
  for (int i = 0; i < 3; ++i) {
    parallel_for(5, 1, job, [&](std::size_t, std::size_t) { parallel_for(5, 1, job, [](std::size_t, std::size_t) {}); });
  }
  CHECK(in_order.runs == 3);
}

TEST_CASE("execution: threads are started once per job, when they are needed, and end with it") {
  static std::atomic<int> alive{0};
  struct Life {
    Life() { ++alive; }
    ~Life() { --alive; }
    void touch() const {}
  };
  std::mutex mutex;
  std::set<int> numbers;
  const auto note = [&](std::size_t, std::size_t) {
    thread_local const Life life;
    life.touch();
    const std::lock_guard<std::mutex> lock(mutex);
    numbers.insert(number_of_this_thread());
  };
  {
    const Execution job = Execution(4).start();
    for (int loop = 0; loop < 200; ++loop) parallel_for(100, 1, job.part(0, 1, "loop"), note);
    CHECK(numbers.size() <= 4);
    CHECK(alive == static_cast<int>(numbers.size()));
    {
      Execution fewer = job;
      fewer.threads = 1;
      numbers.clear();
      parallel_for(100, 1, fewer, note);
      CHECK(numbers.size() == 1);
      fewer.threads = 50;  // not raised
      for (int loop = 0; loop < 50; ++loop) parallel_for(100, 1, fewer, note);
      CHECK(numbers.size() <= 4);
    }
    numbers.clear();
    parallel_for(100, 100, job, note);  // one piece
    CHECK(numbers.size() == 1);
  }
  CHECK(alive <= 1);  // this one
  // Two threads of a user in one job: one of them has the workers.
  const Execution job = Execution(4).start();
  std::atomic<int> runs{0};
  const auto use = [&] {
    for (int loop = 0; loop < 100; ++loop) parallel_for(10, 1, job, [&](std::size_t, std::size_t) { ++runs; });
  };
  std::thread other(use);
  use();
  other.join();
  CHECK(runs == 2000);
}

TEST_CASE("execution: a pool calls all work once, starts threads once, and asks a system that refuses only once") {
  int started = 0;
  ThreadPool pool(4, [&](const std::function<void()>& loop) {
    ++started;
    return std::thread(loop);
  });
  CHECK(pool.num_threads() == 0);
  for (int round = 0; round < 200; ++round) {
    for (const unsigned count : {0u, 1u, 2u, 4u, 100u}) {
      std::vector<std::atomic<int>> calls(count);
      pool.run(count, [&](unsigned i) { ++calls[i]; });
      CHECK(std::all_of(calls.begin(), calls.end(), [](const std::atomic<int>& c) { return c == 1; }));
    }
  }
  CHECK(started == 3);
  CHECK(pool.num_threads() == 3);
  for (const int allowed : {0, 1, 2}) {
    Refusing refusing(allowed);
    const Execution job = Execution(1, {}, &refusing).start();
    for (int round = 0; round < 20; ++round) {
      std::atomic<int> runs{0};
      parallel_for(100, 1, job, [&](std::size_t, std::size_t) { ++runs; });
      CHECK(runs == 100);
    }
    CHECK(refusing.asked == allowed + 1);
    CHECK(refusing.pool.num_threads() == static_cast<std::size_t>(allowed));
  }
}

TEST_CASE("execution: an exception of the host's run reaches the caller, and the job goes on") {
  struct Throwing : InOrder {
    bool broken = true;
    void run(unsigned count, const Work& work) override {
      if (broken) throw std::runtime_error("host is closing");
      InOrder::run(count, work);
    }
  };
  Throwing host;
  const Execution job = Execution(1, {}, &host).start();
  CHECK_THROWS_WITH(parallel_for(10, 1, job, [](std::size_t, std::size_t) {}), "host is closing");
  host.broken = false;
  int runs = 0;
  parallel_for(10, 1, job, [&](std::size_t, std::size_t) { ++runs; });
  CHECK(runs == 10);
  CHECK(host.runs == 1);
}

TEST_CASE("execution: threads of a host that do not round to nearest are refused") {
  struct Rounding : Executor {
    unsigned concurrency() const override { return 2; }
    void run(unsigned count, const Work& work) override {
      std::thread thread([&] {
        REQUIRE(std::fesetround(FE_UPWARD) == 0);
        for (unsigned i = 0; i < count; ++i) work(i);
      });
      thread.join();
    }
  };
  Rounding host;
  const Execution job = Execution(1, {}, &host).start();
  try {
    parallel_for(10, 1, job, [](std::size_t, std::size_t) {});
    FAIL("not refused");
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::kEnvironment);
  }
}

TEST_CASE("execution: a ticker reports where a serial loop is, every so many units, and ends it when cancelled") {
  Record record;
  const Execution job = Execution(1, record.progress(kAlways)).start("ticks");
  Ticker ticker(job.part(0, 0.5), 1000, 100);
  for (int i = 0; i < 500; ++i) ticker.tick();
  ticker.tick(250);
  ticker.tick(1000);  // more than there is
  std::vector<double> fractions;
  for (const auto& call : record.calls) fractions.push_back(call.second);
  CHECK(fractions == std::vector<double>{0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.375, 0.5});
  int ticks = 0;
  CHECK(throws_cancelled([&] {
    Ticker other(job.part(0.5, 1), 1000, 100);
    for (; ticks < 1000; ++ticks) {
      if (ticks == 350) job.progress.cancel();
      other.tick();
    }
  }));
  CHECK(ticks == 399);
  Ticker nothing(Execution(1, Progress()), 0, 1);  // of nothing, all is done
  nothing.tick();
}

TEST_CASE("execution: a counter of work adds up what the pieces of a loop have done") {
  on_each_way([](Execution execution) {
    Record record;
    execution.progress = record.progress(kAlways);
    const Execution job = execution.start("count");
    WorkCounter counter(job.part(0.5, 1), 1000);
    parallel_for(1000, 7, job, [&](std::size_t begin, std::size_t end) { counter.add(end - begin); });
    CHECK(record.rising());
    CHECK(record.calls.front().second == 0.5);
    CHECK(record.calls.back().second == 1);
    CHECK(job.progress.fraction() == 1);
  });
}
