// cli_plots.h: bars and lines as inline SVG, for the report page. Colours and fonts are those of the page (page.css).
#pragma once

#include "cli_output.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

/// Text as it may stand in HTML, in attributes too.
inline std::string html(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

/// Counts of values in bins of equal width from `low` to `high`; those outside count in the first and the last bin.
class Histogram {
 public:
  Histogram(double low, double high, std::size_t bins) : low_(low), high_(high), counts_(bins, 0) {}
  void add(double value, double count = 1) {
    const double place = (value - low_) / (high_ - low_) * static_cast<double>(counts_.size());
    if (!(place == place)) return;
    counts_[static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(counts_.size() - 1)))] += count;
    total_ += count;
  }
  double low() const { return low_; }
  double high() const { return high_; }
  std::size_t bins() const { return counts_.size(); }
  bool empty() const { return total_ == 0; }
  double percent(std::size_t bin) const { return empty() ? 0 : 100 * counts_[bin] / total_; }
  double greatest_percent() const { return empty() ? 0 : 100 * *std::max_element(counts_.begin(), counts_.end()) / total_; }

 private:
  double low_, high_;
  std::vector<double> counts_;
  double total_ = 0;
};

/// One chart: a frame with ticks, and what is drawn into it.
class Plot {
 public:
  using Ticks = std::vector<std::pair<double, std::string>>;

  Plot(std::string title, double x_low, double x_high, double y_high)
      : title_(std::move(title)), x_low_(x_low), x_high_(x_high), y_high_(y_high > 0 ? y_high : 1) {}

  void ticks(const Ticks& along_x, const Ticks& along_y, const std::string& x_name, const std::string& y_name) {
    for (const auto& [y, name] : along_y) {
      axes_ += format(R"(<path class="grid" d="M%.1f %.1fH%.1f"/><text x="%.1f" y="%.1f" text-anchor="end">%s</text>)", kLeft,
                      to_y(y), kRight, kLeft - 5, to_y(y) + 4, html(name).c_str());
    }
    for (const auto& [x, name] : along_x) {
      axes_ += format(R"(<path class="axis" d="M%.1f %.1fv4"/><text x="%.1f" y="%.1f" text-anchor="middle">%s</text>)", to_x(x),
                      kBottom, to_x(x), kBottom + 16, html(name).c_str());
    }
    axes_ += format(R"(<text x="%.1f" y="%.1f" text-anchor="middle">%s</text><text x="2" y="11">%s</text>)",
                    (kLeft + kRight) / 2, kBottom + 32, html(x_name).c_str(), html(y_name).c_str());
  }

  /// A vertical line with nothing but its place to tell.
  void bound(double x) { marks_ += format(R"(<path class="bound" d="M%.1f %.1fV%.1f"/>)", to_x(x), kTop, kBottom); }

  void bars(const Histogram& histogram, const char* style) {
    for (std::size_t i = 0; i < histogram.bins(); ++i) {
      if (histogram.percent(i) == 0) continue;
      const double from = to_x(edge_of(histogram, i)) + kBarGap, to = to_x(edge_of(histogram, i + 1)) - kBarGap;
      const double top = to_y(histogram.percent(i));
      marks_ += format(R"(<rect class="%s" x="%.2f" y="%.2f" width="%.2f" height="%.2f"/>)", style, from, top, to - from,
                       kBottom - top);
    }
  }

  void outline(const Histogram& histogram, const char* style) {
    if (histogram.empty()) return;
    std::string path = format("M%.2f %.2f", to_x(histogram.low()), kBottom);
    for (std::size_t i = 0; i < histogram.bins(); ++i) {
      path += format("V%.2fH%.2f", to_y(histogram.percent(i)), to_x(edge_of(histogram, i + 1)));
    }
    marks_ += format(R"(<path class="%s" d=")", style) + path + format("V%.2f\"/>", kBottom);
  }

  void line(const std::vector<std::pair<double, double>>& points, const char* style) {
    std::string path;
    for (const auto& [x, y] : points) path += format("%s%.2f %.2f", path.empty() ? "M" : "L", to_x(x), to_y(y));
    marks_ += format(R"(<path class="line %s" d=")", style) + path + "\"/>";
  }

  /// A row of the key, in the upper right corner.
  void key(const std::string& name, const char* style, bool filled) {
    const double y = kTop + 8 + 16 * keys_++, x = kRight - 8;
    marks_ += format(R"(<text x="%.1f" y="%.1f" text-anchor="end">%s</text>)", x - 26, y + 4, html(name).c_str());
    marks_ += filled ? format(R"(<rect class="%s" x="%.1f" y="%.1f" width="20" height="9"/>)", style, x - 20, y - 4)
                     : format(R"(<path class="%s" d="M%.1f %.1fh20"/>)", style, x - 20, y);
  }

  std::string text() const {
    return R"(<figure class="chart"><figcaption>)" + html(title_) +
           R"(</figcaption><svg viewBox="0 0 320 220" role="img" aria-label=")" + html(title_) + R"(">)" + axes_ + marks_ +
           format(R"(<path class="axis" d="M%.1f %.1fV%.1fH%.1f"/>)", kLeft, kTop, kBottom, kRight) + "</svg></figure>\n";
  }

 private:
  static constexpr double kLeft = 38, kRight = 308, kTop = 18, kBottom = 182, kBarGap = 0.4;

  static double edge_of(const Histogram& histogram, std::size_t bin) {
    return histogram.low() +
           (histogram.high() - histogram.low()) * static_cast<double>(bin) / static_cast<double>(histogram.bins());
  }
  double to_x(double x) const { return kLeft + (x - x_low_) / (x_high_ - x_low_) * (kRight - kLeft); }
  double to_y(double y) const { return kBottom - y / y_high_ * (kBottom - kTop); }

  std::string title_;
  double x_low_, x_high_, y_high_;
  std::string axes_, marks_;
  int keys_ = 0;
};

/// Some four ticks of a round step from 0 to at most `high`, with a unit behind them.
inline Plot::Ticks round_ticks(double high, const char* unit = "") {
  Plot::Ticks ticks;
  if (!(high > 0)) return ticks;
  const double power = std::pow(10.0, std::floor(std::log10(high / 4)));
  double step = power;
  for (const double factor : {1.0, 2.0, 5.0, 10.0}) {
    step = factor * power;
    if (high / step <= 5) break;
  }
  for (int i = 0; i * step <= high * (1 + 1e-9); ++i) ticks.emplace_back(i * step, format("%g%s", i * step, unit));
  return ticks;
}
