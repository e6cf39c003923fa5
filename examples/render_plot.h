// render_plot.h: line plots and labels as pictures: axes with round numbers, curves in colours that the colour-blind can tell
// apart, a stroke font of our own, pictures side by side. It needs nothing but render_png.h and the standard library.
#pragma once

#include "render_png.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace render {

using Rgb = std::array<std::uint8_t, 3>;  // sRGB

constexpr Rgb kInk{34, 34, 40}, kPaper{255, 255, 255}, kGridLine{226, 228, 232};

/// Okabe & Ito, "Color universal design", 2008; without yellow, which is too light for lines.
inline Rgb series_color(std::size_t i) {
  static constexpr Rgb kColors[] = {{0, 114, 178},   {213, 94, 0},   {0, 158, 115},
                                    {204, 121, 167}, {86, 180, 233}, {120, 120, 120}};
  return kColors[i % (sizeof kColors / sizeof kColors[0])];
}

namespace detail {

/// Strokes of a letter: pairs of digits x (0 to 4) and y (0 to 8; 2 is the base line, 6 the height of small letters, 8 that of
/// capitals); a space lifts the pen. A point twice is a dot.
inline const char* strokes_of(char c) {
  static const char* const kDigits[] = {"120307183847433212",          "172822 1232", "07183847460242",
                                        "07183847463515 354443321203", "32380444",    "480805354443321203",
                                        "473818070312324344351504",    "084812",      "15060718384746351504031232434435",
                                        "031232434738180706153546"};
  static const char* const kCapitals[] = {"022842 1535",
                                          "02083847463505 3544433202",
                                          "4738180703123243",
                                          "02083847433202",
                                          "48080242 0535",
                                          "480802 0535",
                                          "47381807031232434525",
                                          "0208 4248 0545",
                                          "1232 1838 2228",
                                          "3833221203",
                                          "0208 480542",
                                          "080242",
                                          "0208254842",
                                          "02084248",
                                          "120307183847433212",
                                          "02083847463505",
                                          "120307183847433212 2442",
                                          "02083847463505 2542",
                                          "473818070615354443321203",
                                          "0848 2228",
                                          "080312324348",
                                          "082248",
                                          "0812253248",
                                          "0248 0842",
                                          "082548 2522",
                                          "08480242"};
  static const char* const kSmall[] = {"16364542 441403123243",
                                       "0208 0312324345361605",
                                       "4536160503123243",
                                       "4248 4536160503123243",
                                       "04444536160503123243",
                                       "48382722 1636",
                                       "4536160503123243 4641301001",
                                       "0208 0516364542",
                                       "2226 2828",
                                       "26211000 2828",
                                       "0208 460442",
                                       "182822 1232",
                                       "0206 05162522 25364542",
                                       "0206 0516364542",
                                       "120305163645433212",
                                       "0006 0312324345361605",
                                       "4046 4536160503123243",
                                       "0206 05163645",
                                       "45361605143443321203",
                                       "28233242 1636",
                                       "0603123243 4642",
                                       "062246",
                                       "0612253246",
                                       "0246 0642",
                                       "0622 4610",
                                       "06460242"};
  if (c >= '0' && c <= '9') return kDigits[c - '0'];
  if (c >= 'A' && c <= 'Z') return kCapitals[c - 'A'];
  if (c >= 'a' && c <= 'z') return kSmall[c - 'a'];
  switch (c) {
    case '.':
      return "2222";
    case ',':
      return "2210";
    case ':':
      return "2222 2525";
    case ';':
      return "2210 2525";
    case '-':
      return "0444";
    case '+':
      return "0545 2327";
    case '=':
      return "0444 0646";
    case '/':
      return "0148";
    case '(':
      return "38272332";
    case ')':
      return "18272312";
    case '[':
      return "38181232";
    case ']':
      return "18383212";
    case '<':
      return "470543";
    case '>':
      return "074503";
    case '|':
      return "2129";
    case '%':
      return "0248 0708 4243";
    case '*':
      return "2327 1436 1634";
    case '\'':
      return "2826";
    case '!':
      return "2824 2222";
    case '^':
      return "062846";
    case '_':
      return "0141";
    case '~':
      return "05163546";
    case '\x01':
      return "0718271607";  // the degree sign
    default:
      return c == ' ' ? "" : "07183847462524 2222";
  }
}

/// UTF-8 degree signs become one byte.
inline std::string with_degrees(std::string text) {
  for (std::size_t at; (at = text.find("\xC2\xB0")) != std::string::npos;) text.replace(at, 2, "\x01");
  return text;
}

}  // namespace detail

/// Something to draw lines and letters on. Coordinates are pixels from the upper left corner.
class Canvas {
 public:
  Canvas(int width, int height, const Rgb& paper = kPaper) {
    image_.width = width;
    image_.height = height;
    for (int i = 0; i < width * height; ++i) image_.rgb.insert(image_.rgb.end(), paper.begin(), paper.end());
  }
  explicit Canvas(Image image) : image_(std::move(image)) {}
  int width() const { return image_.width; }
  int height() const { return image_.height; }
  const Image& image() const { return image_; }

  /// A segment with round ends; pixels take the colour by how much of them it covers.
  void line(double x0, double y0, double x1, double y1, double thickness, const Rgb& color) {
    const double reach = thickness / 2 + 0.5, dx = x1 - x0, dy = y1 - y0, length2 = dx * dx + dy * dy;
    const int top = std::max(0, static_cast<int>(std::floor(std::min(y0, y1) - reach)));
    const int bottom = std::min(image_.height - 1, static_cast<int>(std::ceil(std::max(y0, y1) + reach)));
    const int left = std::max(0, static_cast<int>(std::floor(std::min(x0, x1) - reach)));
    const int right = std::min(image_.width - 1, static_cast<int>(std::ceil(std::max(x0, x1) + reach)));
    for (int y = top; y <= bottom; ++y) {
      for (int x = left; x <= right; ++x) {
        const double px = x + 0.5 - x0, py = y + 0.5 - y0;
        const double t = length2 > 0 ? std::clamp((px * dx + py * dy) / length2, 0.0, 1.0) : 0;
        blend(x, y, std::clamp(reach - std::hypot(px - t * dx, py - t * dy), 0.0, 1.0), color);
      }
    }
  }

  void fill(int x0, int y0, int x1, int y1, const Rgb& color) {
    for (int y = std::max(0, y0); y < std::min(y1, image_.height); ++y) {
      for (int x = std::max(0, x0); x < std::min(x1, image_.width); ++x) blend(x, y, 1, color);
    }
  }

  /// Width of a text whose capitals are `height` pixels high.
  static double text_width(const std::string& text, double height) {
    return static_cast<double>(detail::with_degrees(text).size()) * kAdvance * height / kCapital;
  }

  /// The left end of its base line is at (x, y); `up`: it runs upwards.
  void text(double x, double y, const std::string& text, double height, const Rgb& color = kInk, bool up = false) {
    const double unit = height / kCapital, thickness = std::max(1.0, 0.13 * height);
    double from = 0;
    for (const char c : detail::with_degrees(text)) {
      const std::string strokes = detail::strokes_of(c);
      double last_x = 0, last_y = 0;
      bool pen = false;
      for (std::size_t i = 0; i < strokes.size();) {
        if (strokes[i] == ' ') {
          pen = false;
          ++i;
          continue;
        }
        const double along = (from + (strokes[i] - '0')) * unit, above = (strokes[i + 1] - '0' - kBase) * unit;
        const double to_x = up ? x - above : x + along, to_y = up ? y - along : y - above;
        if (pen) line(last_x, last_y, to_x, to_y, thickness, color);
        last_x = to_x;
        last_y = to_y;
        pen = true;
        i += 2;
      }
      from += kAdvance;
    }
  }

  void paste(const Image& other, int x, int y) {
    for (int row = 0; row < other.height; ++row) {
      for (int column = 0; column < other.width; ++column) {
        const std::uint8_t* from = &other.rgb[3 * (static_cast<std::size_t>(row) * static_cast<std::size_t>(other.width) +
                                                   static_cast<std::size_t>(column))];
        if (x + column >= 0 && x + column < image_.width && y + row >= 0 && y + row < image_.height) {
          blend(x + column, y + row, 1, {from[0], from[1], from[2]});
        }
      }
    }
  }

 private:
  static constexpr double kAdvance = 5.6, kCapital = 6, kBase = 2;  // units of strokes_of()

  void blend(int x, int y, double cover, const Rgb& color) {
    std::uint8_t* at =
        &image_.rgb[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(image_.width) + static_cast<std::size_t>(x))];
    for (std::size_t c = 0; c < 3; ++c) {
      at[c] = static_cast<std::uint8_t>(std::lround((1 - cover) * at[c] + cover * color[c]));
    }
  }

  Image image_;
};

struct Series {
  std::string name;
  std::vector<double> x, y;
  bool dots = false;  ///< a dot at each point too
};

struct Plot {
  std::string title, x_label, y_label;
  std::vector<Series> series;
  int width = 900, height = 560;
  bool log_y = false;
  bool legend_left = false;  ///< not at the right, where curves may end high
  /// Ends of the axes; equal: those of the data, and round.
  double x_min = 0, x_max = 0, y_min = 0, y_max = 0;
};

namespace detail {

/// 1, 2 or 5 times a power of ten, so that about `wanted` steps fill the range.
inline double round_step(double range, double wanted) {
  const double rough = range / wanted, power = std::pow(10, std::floor(std::log10(rough)));
  for (const double m : {1.0, 2.0, 5.0}) {
    if (m * power >= rough * 0.999) return m * power;
  }
  return 10 * power;
}

inline std::string tick_text(double value, double step) {
  char text[32];
  if (std::abs(value) < 1e-9 * step) value = 0;
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

struct Axis {
  double low, high, step;
  double part(double value) const { return (value - low) / (high - low); }
};

inline Axis axis_of(double low, double high, bool given, double wanted) {
  if (!(low < high)) {
    const double around = low == 0 || !std::isfinite(low) ? 1 : 0.1 * std::abs(low);
    if (!std::isfinite(low)) low = 0;
    high = low + around;
    low -= around;
  }
  const double step = round_step(high - low, wanted);
  if (given) return {low, high, step};
  return {std::floor(low / step + 1e-9) * step, std::ceil(high / step - 1e-9) * step, step};
}

}  // namespace detail

inline Image draw(const Plot& plot) {
  constexpr double kLetter = 11, kTitle = 14, kXTicks = 8, kYTicks = 6;
  constexpr double kLeft = 96, kRight = 26, kTop = 46, kBottom = 62;
  const auto height_of = [&](double y) { return plot.log_y ? std::log10(y) : y; };
  const auto shown = [&](double x, double y) {
    return std::isfinite(x) && std::isfinite(y) && (!plot.log_y || y > 0) &&
           (plot.x_min == plot.x_max || (x >= plot.x_min && x <= plot.x_max));
  };
  double low_x = std::numeric_limits<double>::infinity(), high_x = -low_x, low_y = low_x, high_y = -low_x;
  for (const Series& s : plot.series) {
    for (std::size_t i = 0; i < s.x.size(); ++i) {
      if (!shown(s.x[i], s.y[i])) continue;
      low_x = std::min(low_x, s.x[i]);
      high_x = std::max(high_x, s.x[i]);
      low_y = std::min(low_y, height_of(s.y[i]));
      high_y = std::max(high_y, height_of(s.y[i]));
    }
  }
  const bool x_given = plot.x_min < plot.x_max, y_given = plot.y_min < plot.y_max;
  const detail::Axis across =
      x_given ? detail::axis_of(plot.x_min, plot.x_max, true, kXTicks) : detail::axis_of(low_x, high_x, false, kXTicks);
  detail::Axis up = y_given ? detail::axis_of(height_of(plot.y_min), height_of(plot.y_max), true, kYTicks)
                            : detail::axis_of(low_y, high_y, false, kYTicks);
  if (plot.log_y) up = {std::floor(up.low + 1e-9), std::ceil(up.high - 1e-9), 1};

  Canvas canvas(plot.width, plot.height);
  const double width = plot.width - kLeft - kRight, height = plot.height - kTop - kBottom;
  const auto px = [&](double x) { return kLeft + width * across.part(x); };
  const auto py = [&](double y) { return kTop + height * (1 - up.part(y)); };
  for (double x = std::ceil(across.low / across.step - 1e-9) * across.step; x <= across.high + 1e-9 * across.step;
       x += across.step) {
    canvas.line(px(x), kTop, px(x), kTop + height, 1, kGridLine);
    const std::string text = detail::tick_text(x, across.step);
    canvas.text(px(x) - Canvas::text_width(text, kLetter) / 2, kTop + height + 2 * kLetter, text, kLetter);
  }
  for (double y = std::ceil(up.low / up.step - 1e-9) * up.step; y <= up.high + 1e-9 * up.step; y += up.step) {
    canvas.line(kLeft, py(y), kLeft + width, py(y), 1, kGridLine);
    const std::string text = detail::tick_text(plot.log_y ? std::pow(10, y) : y, plot.log_y ? 1e-30 : up.step);
    canvas.text(kLeft - 8 - Canvas::text_width(text, kLetter), py(y) + kLetter / 2, text, kLetter);
  }
  canvas.line(kLeft, kTop, kLeft, kTop + height, 1.5, kInk);
  canvas.line(kLeft, kTop + height, kLeft + width, kTop + height, 1.5, kInk);
  canvas.text(kLeft, kTop - 18, plot.title, kTitle);
  canvas.text(kLeft + (width - Canvas::text_width(plot.x_label, kLetter)) / 2, plot.height - 14, plot.x_label, kLetter);
  canvas.text(22, kTop + (height + Canvas::text_width(plot.y_label, kLetter)) / 2, plot.y_label, kLetter, kInk, true);

  for (std::size_t k = 0; k < plot.series.size(); ++k) {
    const Series& s = plot.series[k];
    bool pen = false;
    double last_x = 0, last_y = 0;
    for (std::size_t i = 0; i < s.x.size(); ++i) {
      if (!shown(s.x[i], s.y[i])) {
        pen = false;
        continue;
      }
      const double x = px(s.x[i]), y = py(std::clamp(height_of(s.y[i]), up.low, up.high));
      if (pen) canvas.line(last_x, last_y, x, y, 2, series_color(k));
      if (s.dots) canvas.line(x, y, x, y, 7, series_color(k));
      last_x = x;
      last_y = y;
      pen = true;
    }
    if (s.name.empty()) continue;
    const double row = kTop + 18 + 1.9 * kLetter * static_cast<double>(k);
    const double from = plot.legend_left ? kLeft + 54 : kLeft + width - 12 - Canvas::text_width(s.name, kLetter);
    canvas.line(from - 40, row - kLetter / 2, from - 12, row - kLetter / 2, 3, series_color(k));
    canvas.text(from, row, s.name, kLetter);
  }
  return canvas.image();
}

/// Rows [from, to) of a picture.
inline Image rows_of(const Image& image, int from, int to) {
  Canvas canvas(image.width, to - from);
  canvas.paste(image, 0, -from);
  return canvas.image();
}

/// Pictures in rows of `columns`, each with its caption below, if it has one; columns are as wide as the widest picture, rows
/// as high as their highest.
inline Image sheet(const std::vector<std::pair<Image, std::string>>& pictures, int columns) {
  constexpr int kCaption = 34, kBaseLine = 24;
  constexpr double kLetter = 12;
  const int count = static_cast<int>(pictures.size());
  int width = 0, height = 0;
  std::vector<int> tops;  // of rows
  for (int first = 0; first < count; first += columns) {
    tops.push_back(height);
    int highest = 0;
    for (int i = first; i < std::min(count, first + columns); ++i) {
      const auto& [image, caption] = pictures[static_cast<std::size_t>(i)];
      width = std::max(width, image.width);
      highest = std::max(highest, image.height + (caption.empty() ? 0 : kCaption));
    }
    height += highest;
  }
  Canvas canvas(std::min(columns, count) * width, height);
  for (int i = 0; i < count; ++i) {
    const auto& [image, caption] = pictures[static_cast<std::size_t>(i)];
    const int x = i % columns * width, y = tops[static_cast<std::size_t>(i / columns)];
    canvas.paste(image, x, y);
    canvas.text(x + (width - Canvas::text_width(caption, kLetter)) / 2, y + image.height + kBaseLine, caption, kLetter);
  }
  return canvas.image();
}

}  // namespace render
