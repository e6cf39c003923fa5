// cli_watch.h: time, the progress bar, and Ctrl-C.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "cli_output.h"
#include "cli_terminal.h"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <string>

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

  /// A line on stderr, clear of the bar.
  void say(const std::string& line) {
    clear();
    std::fprintf(stderr, "%s\n", line.c_str());
  }

  /// The bar goes, and signals do what they did before.
  void finish() {
    if (finished_) return;
    finished_ = true;
    clear();
    for (std::size_t i = 0; i < kNumSignals; ++i) std::signal(kSignals[i], previous_[i]);
  }

 private:
#ifdef SIGHUP
  static constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP};
#else
  static constexpr int kSignals[] = {SIGINT, SIGTERM};
#endif
  static constexpr std::size_t kNumSignals = sizeof kSignals / sizeof kSignals[0];
  static constexpr double kSecondsBetween = 0.05;
  static constexpr std::size_t kMostColumns = 100;

  void clear() {
    if (drawn_) std::fprintf(stderr, "\r%*s\r", static_cast<int>(shown_), "");
    drawn_ = false;
    shown_ = 0;
  }

  /// One line of the terminal, over the one before.
  void draw(const char* stage, double fraction) {
    if (drawn_ && last_.seconds() < kSecondsBetween) return;
    last_ = Stopwatch();
    drawn_ = true;
    fraction = std::clamp(fraction, 0.0, 1.0);
    pace_.tell(total_.seconds(), fraction);
    // The last column stays free: a terminal that is full goes to the next line.
    const std::size_t columns = std::min(terminal_columns(), kMostColumns) - 1;
    std::string line = bar_line(stage, fraction, pace_, columns);
    line.resize(std::max(line.size(), std::min(shown_, columns)), ' ');  // over what was there
    shown_ = line.size();
    const std::size_t done = line.find('#');
    if (done != std::string::npos) {
      const std::size_t length = line.find_first_not_of('#', done) - done;
      line.replace(done, length, in_colour(kBarColour, line.substr(done, length)));
    }
    std::fprintf(stderr, "\r%s", line.c_str());
  }

  bool bar_;
  bool drawn_ = false;
  bool finished_ = false;
  void (*previous_[kNumSignals])(int) = {};
  std::size_t shown_ = 0;  ///< columns
  Stopwatch total_, last_;
  Pace pace_;
  amps::Execution job_;
};
