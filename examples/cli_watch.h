// cli_watch.h: time, what a terminal shows of it (the progress bar, colours), and Ctrl-C.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "cli_output.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#ifdef _WIN32
#include <io.h>
#else
#include <sys/ioctl.h>
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

inline volatile std::sig_atomic_t interrupted = 0;

extern "C" inline void on_interrupt(int) {
  interrupted = 1;
  std::signal(SIGINT, SIG_DFL);  // a second one ends the program at once
}

inline bool stderr_is_terminal() {
#ifdef _WIN32
  return _isatty(_fileno(stderr)) != 0;
#else
  return isatty(fileno(stderr)) != 0;
#endif
}

/// Columns of the terminal that stderr is; 80 where it does not tell.
inline std::size_t terminal_columns() {
#ifdef TIOCGWINSZ
  winsize size{};
  if (ioctl(fileno(stderr), TIOCGWINSZ, &size) == 0 && size.ws_col > 0) return size.ws_col;
#endif
  return kColumns;
}

/// May colours be written to stderr? Not if it is no terminal, or a dumb one, or the user wants none (https://no-color.org).
inline bool has_colours() {
#ifdef _WIN32
  return false;
#else
  const char* const none = std::getenv("NO_COLOR");
  const char* const terminal = std::getenv("TERM");
  if (none != nullptr && *none != '\0') return false;
  return stderr_is_terminal() && terminal != nullptr && *terminal != '\0' && std::string(terminal) != "dumb";
#endif
}

inline std::string in_colour(const char* code, const std::string& text) {
  return has_colours() ? std::string("\033[") + code + "m" + text + "\033[0m" : text;
}
inline constexpr const char* kBarColour = "36";        // cyan
inline constexpr const char* kTroubleColour = "1;31";  // bold, red

/// How fast a job goes and how long it will take, from fractions told now and then.
class Pace {
 public:
  void tell(double seconds, double fraction) { told_.push_back({seconds, fraction}); }

  /// Of the whole, a second; over the later half of the time, since stages differ. 0: not known yet.
  double rate() {
    if (told_.empty() || told_.back().seconds < kFirstSeconds) return 0;
    const Told& now = told_.back();
    while (since_ + 1 < told_.size() && told_[since_ + 1].seconds <= now.seconds / 2) ++since_;
    const Told& then = told_[since_];
    return now.seconds > then.seconds ? (now.fraction - then.fraction) / (now.seconds - then.seconds) : 0;
  }

  /// As "1:05 left"; empty: not known.
  std::string time_left() {
    constexpr double kLongest = 360000;  // 100 hours
    const double r = rate();
    if (!(r > 0) || (1 - told_.back().fraction) / r > kLongest) return "";
    const auto left = static_cast<int>(std::ceil((1 - told_.back().fraction) / r));
    if (left >= 3600) return format("%d:%02d:%02d left", left / 3600, left / 60 % 60, left % 60);
    return format("%d:%02d left", left / 60, left % 60);
  }

 private:
  static constexpr double kFirstSeconds = 1;
  struct Told {
    double seconds, fraction;
  };
  std::vector<Told> told_;
  std::size_t since_ = 0;
};

/// One job for all that a command does. Until finish(), SIGINT cancels what runs as a part of it, and a terminal shows a bar.
class Watch {
 public:
  Watch(bool quiet, unsigned threads) : bar_(!quiet && stderr_is_terminal()) {
    previous_ = std::signal(SIGINT, on_interrupt);
    if (previous_ == SIG_IGN) std::signal(SIGINT, SIG_IGN);  // as in the background of a script
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

  /// The bar goes, and SIGINT does what it did before.
  void finish() {
    if (finished_) return;
    finished_ = true;
    if (drawn_) std::fprintf(stderr, "\r%*s\r", static_cast<int>(shown_), "");
    std::signal(SIGINT, previous_);
  }

 private:
  static constexpr double kSecondsBetween = 0.05;
  static constexpr std::size_t kMostColumns = 100, kLeastBar = 8;

  /// Stage, bar, percent, rate and time left, in one line of the terminal.
  void draw(const char* stage, double fraction) {
    if (drawn_ && last_.seconds() < kSecondsBetween) return;
    last_ = Stopwatch();
    drawn_ = true;
    fraction = std::clamp(fraction, 0.0, 1.0);
    pace_.tell(total_.seconds(), fraction);
    const double rate = pace_.rate();
    std::string numbers = format(" %3d %%", static_cast<int>(100 * fraction));
    if (rate > 0) numbers += format("  %5.3g %%/s  %s", 100 * rate, pace_.time_left().c_str());
    // The last column stays free: a terminal that is full goes to the next line.
    const std::size_t columns = std::min(terminal_columns(), kMostColumns) - 1;
    constexpr std::size_t kStage = 22, kNumbers = 33, kFrame = 3;
    const std::size_t taken = kStage + kNumbers + kFrame;
    const std::size_t width = columns > taken + kLeastBar ? columns - taken : 0;
    const auto filled = static_cast<std::size_t>(fraction * static_cast<double>(width));
    std::string line = format("%-22.22s", stage);
    const std::size_t bar_at = line.size() + 2;
    if (width > 0) line += " [" + std::string(filled, '#') + std::string(width - filled, '.') + "]";
    line += numbers;
    line.resize(std::min(line.size(), columns));
    line.resize(std::max(line.size(), std::min(shown_, columns)), ' ');  // over what was there
    shown_ = line.size();
    if (width > 0) line.replace(bar_at, filled, in_colour(kBarColour, std::string(filled, '#')));
    std::fprintf(stderr, "\r%s", line.c_str());
  }

  bool bar_;
  bool drawn_ = false;
  bool finished_ = false;
  void (*previous_)(int) = SIG_DFL;
  std::size_t shown_ = 0;  ///< columns
  Stopwatch total_, last_;
  Pace pace_;
  amps::Execution job_;
};
