// execution.h: threads, progress and cancelling of calls, set in one place for all kinds of options.
#pragma once

#include "basics.h"

#include "amps/execution.h"
#include "amps/surface_distance.h"

#include <type_traits>
#include <utility>

namespace amps_test {

using amps::Progress;

/// What a call takes to run on so many threads (0: as many as there are).
inline unsigned on_threads(unsigned threads) { return threads; }

template <class Options, class = void>
struct HasExecution : std::false_type {};
template <class Options>
struct HasExecution<Options, std::void_t<decltype(std::declval<Options&>().execution)>> : std::true_type {};

template <class Options>
void run_on(Options& options, unsigned threads) {
  if constexpr (HasExecution<Options>::value) {
    options.execution.threads = threads;
  } else {
    options.threads = threads;
  }
}
inline void run_on(amps::DistanceOptions& options, unsigned threads) { options.execution.threads = threads; }

/// `callback` is told where the call is; it cancels by returning false. It is told everything, however often.
template <class Options>
void watch(Options& options, Progress::Callback callback) {
  options.execution.progress = Progress(std::move(callback), 0);
}

/// Cancels a call before it begins.
template <class Options>
void cancel(Options& options) {
  options.execution.progress.cancel();
}

template <class Options>
bool cancelled(const Options& options) {
  return options.execution.progress.cancelled();
}

}  // namespace amps_test
