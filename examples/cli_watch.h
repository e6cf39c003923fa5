// cli_watch.h: time, the progress bar, and Ctrl-C.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <string>

#ifdef _WIN32
#include <io.h>
#else
#include <unistd.h>
#endif

/// Thrown where the user, and not the work, has ended it.
struct Interrupted {};

class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// The signal that did; 0: none.
inline volatile std::sig_atomic_t interrupted = 0;

extern "C" inline void on_interrupt(int signal) {
  interrupted = signal;
  std::signal(signal, SIG_DFL);  // a second one ends the program at once
}

inline bool stderr_is_terminal() {
#ifdef _WIN32
  return _isatty(_fileno(stderr)) != 0;
#else
  return isatty(fileno(stderr)) != 0;
#endif
}

/// One job for all that a command does. Until finish(), SIGINT, SIGTERM and SIGHUP cancel what runs as a part of it, and a
/// terminal shows a bar.
class Watch {
 public:
  Watch(bool quiet, unsigned threads) : bar_(!quiet && stderr_is_terminal()) {
    for (std::size_t i = 0; i < kNumSignals; ++i) {
      previous_[i] = std::signal(kSignals[i], on_interrupt);
      if (previous_[i] == SIG_IGN) std::signal(kSignals[i], SIG_IGN);  // as in the background of a script
    }
    const amps::Progress progress([this](const char* stage, double fraction) {
      if (bar_) draw(stage, fraction);
      return interrupted == 0;
    });
    job_ = amps::Execution(threads, progress).start();
  }
  ~Watch() { finish(); }
  Watch(const Watch&) = delete;
  Watch& operator=(const Watch&) = delete;

  /// The piece of the job from `from` to `to` of its time, roughly.
  amps::Execution part(double from, double to) const { return job_.part(from, to); }

  /// Throws if the user, and not the work, ended it.
  void check(amps::Outcome status) const {
    if (interrupted != 0 || status == amps::Outcome::kCancelled) throw Interrupted();
  }

  /// The bar goes, and signals do what they did before.
  void finish() {
    if (finished_) return;
    finished_ = true;
    if (drawn_) std::fprintf(stderr, "\r%*s\r", kWidth + 40, "");
    for (std::size_t i = 0; i < kNumSignals; ++i) std::signal(kSignals[i], previous_[i]);
  }

 private:
#ifdef SIGHUP
  static constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP};
#else
  static constexpr int kSignals[] = {SIGINT, SIGTERM};
#endif
  static constexpr std::size_t kNumSignals = sizeof kSignals / sizeof kSignals[0];
  static constexpr int kWidth = 40;
  static constexpr double kSecondsBetween = 0.05;

  void draw(const char* stage, double fraction) {
    if (drawn_ && last_.seconds() < kSecondsBetween) return;
    last_ = Stopwatch();
    drawn_ = true;
    const int filled = static_cast<int>(std::clamp(fraction, 0.0, 1.0) * kWidth);
    const std::string bar =
        std::string(static_cast<std::size_t>(filled), '#') + std::string(static_cast<std::size_t>(kWidth - filled), '.');
    std::fprintf(stderr, "\r%-24.24s [%s] %3d %%", stage, bar.c_str(), static_cast<int>(100 * std::clamp(fraction, 0.0, 1.0)));
  }

  bool bar_;
  bool drawn_ = false;
  bool finished_ = false;
  void (*previous_[kNumSignals])(int) = {};
  Stopwatch last_;
  amps::Execution job_;
};
