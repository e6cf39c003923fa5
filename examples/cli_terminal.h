// cli_terminal.h: what only a terminal gets — its width, colours, and how long work will take.
#pragma once

#include "cli_output.h"

#include <cmath>
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

/// Stage, bar, percent, and rate and time left once `pace` knows them, in at most `columns`; without a bar where it has no
/// room. `fraction` is what is done, in [0, 1].
inline std::string bar_line(const char* stage, double fraction, Pace& pace, std::size_t columns) {
  constexpr std::size_t kStage = 22, kNumbers = 33, kFrame = 3, kLeastBar = 8;
  std::string line = format("%-22.22s", stage);
  if (columns > kStage + kNumbers + kFrame + kLeastBar) {
    const std::size_t width = columns - (kStage + kNumbers + kFrame);
    const auto filled = static_cast<std::size_t>(fraction * static_cast<double>(width));
    line += " [" + std::string(filled, '#') + std::string(width - filled, '.') + "]";
  }
  line += format(" %3d %%", static_cast<int>(100 * fraction));
  const double rate = pace.rate();
  if (rate > 0) line += format("  %5.3g %%/s  %s", 100 * rate, pace.time_left().c_str());
  line.resize(std::min(line.size(), columns));
  return line;
}
