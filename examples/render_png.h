// render_png.h: a picture of a triangle mesh, for the command-line program. A z-buffer rasteriser with perspective, two lights,
// anti-aliased triangle edges and two-sided colours (an inside seen through a hole is red), and a PNG encoder. It needs nothing
// but amps and the standard library, and is part of the program, not of the library.
#pragma once

#include "amps/amps.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <string>
#include <vector>

namespace render {

struct Image {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgb;  ///< width · height · 3, row by row from the top, sRGB
};

struct Options {
  int size = 1024;            ///< width and height in pixels
  bool smooth = false;        ///< normals interpolated over a triangle instead of one for all of it
  bool edges = true;          ///< triangle edges drawn dark
  double azimuth = 30;        ///< degrees the viewer walks around the up axis
  double elevation = 18;      ///< degrees the viewer looks down from
  bool z_up = false;          ///< the model's up axis is z instead of y
  amps::Execution execution;  ///< the picture does not depend on the threads
  /// Pairs of vertices, joined by thick lines where they are seen.
  std::vector<std::array<amps::Index, 2>> curves = {};
};

namespace detail {

constexpr int kSupersampling = 3;        // samples a pixel and axis
constexpr int kBandRows = 32;            // pixel rows rendered at a time: bounds memory, and is what threads share out
constexpr int kFacetsPerLook = 1 << 14;  // drawn between two looks for a cancel: about a millisecond where they are small
constexpr double kFieldOfView = 24;      // degrees, over the shorter side
constexpr double kMargin = 0.92;         // part of the picture the model may fill
constexpr double kEdgeHalfWidth = 0.55;  // pixels
constexpr double kEdgeDarkness = 0.8;    // 1: black
constexpr double kSliver = 1e-9;         // a sample this little outside counts as inside, so that shared edges have no pinholes

constexpr double kCurveHalfWidth = 1.5e-3;    // part of the picture's width
constexpr double kLeastCurveHalfWidth = 0.8;  // pixels
constexpr double kCurveBehind = 1e-3;         // a curve so little behind a surface, of its distance, counts as on it

using Color = Eigen::Vector3f;  // linear light

/// A mesh as the viewer sees it.
struct View {
  amps::Points screen;         // #V by 3: x, y in samples, 1/distance to the viewer
  amps::Points normals;        // in camera axes (z towards the viewer): per facet, or per vertex if smooth
  double edge_half_width = 0;  // samples
  float edge_darkness = 0;
  double curve_half_width = 0;  // samples
};

/// Rows: right, up, towards the viewer, in the axes of the model.
inline Eigen::Matrix3d camera_axes(const Options& options) {
  constexpr double kDegree = 3.14159265358979323846 / 180;
  const double azimuth = options.azimuth * kDegree;
  const double elevation = options.elevation * kDegree;
  Eigen::Matrix3d axes;
  axes << std::cos(azimuth), 0, -std::sin(azimuth), -std::sin(azimuth) * std::sin(elevation), std::cos(elevation),
      -std::cos(azimuth) * std::sin(elevation), std::sin(azimuth) * std::cos(elevation), std::sin(elevation),
      std::cos(azimuth) * std::cos(elevation);
  if (options.z_up) {
    Eigen::Matrix3d y_up_from_z_up;
    y_up_from_z_up << 1, 0, 0, 0, 0, 1, 0, -1, 0;
    return axes * y_up_from_z_up;
  }
  return axes;
}

inline amps::Points vertex_normals(const amps::MeshView& mesh, const amps::Points& facet_normals) {
  const std::vector<double> areas = amps::facet_areas(mesh);
  amps::Points normals(mesh.vertices.rows());
  for (amps::Index f = 0; f < mesh.num_facets(); ++f) {
    for (int k = 0; k < 3; ++k) {
      normals.row(mesh.triangles(f, k)) += areas[static_cast<std::size_t>(f)] * facet_normals.row(f);
    }
  }
  for (std::ptrdiff_t v = 0; v < normals.rows(); ++v) normals.row(v).normalize();
  return normals;
}

/// Median length of triangle edges on the screen, in samples.
inline double typical_edge(const amps::MeshView& mesh, const amps::Points& screen) {
  std::vector<double> lengths;
  lengths.reserve(static_cast<std::size_t>(mesh.num_facets()));
  for (amps::Index f = 0; f < mesh.num_facets(); ++f) {
    const auto edge = screen.row(mesh.triangles(f, 0)) - screen.row(mesh.triangles(f, 1));
    lengths.push_back(std::hypot(edge.x(), edge.y()));
  }
  const auto middle = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  return *middle;
}

inline View look_at(const amps::MeshView& mesh, const Options& options) {
  const Eigen::Matrix3d axes = camera_axes(options);
  const amps::Box box = amps::bounding_box(mesh);
  // Scaled to a unit diagonal, so that models of any size are far from overflow.
  const Eigen::Vector3d middle = 0.5 * box.min + 0.5 * box.max;
  amps::Points eye(mesh.vertices.rows());
  for (std::ptrdiff_t v = 0; v < eye.rows(); ++v) {
    eye.row(v) = (axes * (mesh.vertices[v] - middle) / box.diagonal()).transpose();
  }
  const double tangent = std::tan(kFieldOfView * 3.14159265358979323846 / 360) * kMargin;

  // Step back until every vertex is inside the frame, |x| ≤ tangent · (distance − z), and centre what is seen. Each step moves
  // the other's goal a little, so they take turns.
  double distance = 0;
  for (int turn = 0; turn < 6; ++turn) {
    Eigen::RowVector2d low = Eigen::RowVector2d::Constant(std::numeric_limits<double>::infinity());
    Eigen::RowVector2d high = -low;
    double needed = 0;
    for (amps::Index f = 0; f < mesh.num_facets(); ++f) {
      for (int k = 0; k < 3; ++k) {
        const Eigen::RowVector3d p = eye.row(mesh.triangles(f, k));
        const Eigen::RowVector2d seen = p.head<2>() * (turn == 0 ? 1 : distance / (distance - p.z()));
        low = low.cwiseMin(seen);
        high = high.cwiseMax(seen);
        needed = std::max(needed, p.head<2>().cwiseAbs().maxCoeff() / tangent + p.z());
      }
    }
    distance = needed;
    if (turn < 5) eye.map().leftCols<2>().rowwise() -= 0.5 * (low + high);
  }

  View view;
  const double half = 0.5 * options.size * kSupersampling;
  const double focal = half * kMargin / tangent;
  view.screen.resize(eye.rows());
  for (std::ptrdiff_t v = 0; v < eye.rows(); ++v) {
    const double inverse = 1 / (distance - eye(v, 2));
    view.screen.row(v) << half + focal * eye(v, 0) * inverse, half - focal * eye(v, 1) * inverse, inverse;
  }
  view.curve_half_width = kSupersampling * std::max(kLeastCurveHalfWidth, kCurveHalfWidth * options.size);
  amps::Points normals = amps::facet_normals(mesh);
  if (options.smooth) normals = vertex_normals(mesh, normals);
  view.normals = normals.map() * axes.transpose();
  if (options.edges) {
    // Where triangles are only a few pixels wide, lines get thinner and fade, or the picture would go black.
    const double pixels = typical_edge(mesh, view.screen) / kSupersampling;
    view.edge_half_width = std::min(kEdgeHalfWidth, 0.07 * pixels) * kSupersampling;
    view.edge_darkness = static_cast<float>(kEdgeDarkness * std::clamp((pixels - 1) / 5, 0.0, 1.0));
  }
  return view;
}

/// Light leaving a surface with this normal (camera axes, not necessarily of unit length) towards the viewer.
inline Color shade(const Eigen::Vector3d& direction, bool back) {
  static const Color kFront(0.33f, 0.52f, 0.72f);
  static const Color kBack(0.72f, 0.25f, 0.18f);
  static const Eigen::Vector3d kSide = Eigen::Vector3d(-0.62, 0.66, 0.42).normalized();
  const double length = direction.norm();
  Eigen::Vector3d n = length > 0 ? Eigen::Vector3d(direction / length) : Eigen::Vector3d::UnitZ();
  if (n.z() < 0) n = -n;
  const double head = n.z();
  const double side = std::max(0.0, (n.dot(kSide) + 0.35) / 1.35);  // wraps around, as the light of a wide window does
  const double sky = 0.5 + 0.5 * n.y();
  const double highlight = std::pow(std::max(0.0, n.dot((kSide + Eigen::Vector3d::UnitZ()).normalized())), 40);
  const auto diffuse = static_cast<float>(0.10 + 0.12 * sky + 0.42 * head + 0.58 * side * side);
  return (back ? kBack : kFront) * diffuse + Color::Constant(static_cast<float>(0.10 * highlight));
}

/// Soft grey, lighter above; `height` 0 at the top, 1 at the bottom of the picture.
inline Color background(double height) {
  const auto t = static_cast<float>(height);
  return (1 - t) * Color(0.93f, 0.94f, 0.96f) + t * Color(0.62f, 0.66f, 0.71f);
}

/// The samples of some rows of the picture.
struct Band {
  int width, first, rows;  // in samples
  std::vector<float> depth;
  std::vector<Color> color;
};

inline void draw_triangle(const amps::MeshView& mesh, const View& view, bool smooth, amps::Index f, Band& band) {
  const std::array<Eigen::Vector3d, 3> p{view.screen.row(mesh.triangles(f, 0)), view.screen.row(mesh.triangles(f, 1)),
                                         view.screen.row(mesh.triangles(f, 2))};
  const auto [low_y, high_y] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
  const int y0 = std::max(band.first, static_cast<int>(std::ceil(low_y - 0.5)));
  const int y1 = std::min(band.first + band.rows - 1, static_cast<int>(std::floor(high_y - 0.5)));
  if (y0 > y1) return;
  const auto [low_x, high_x] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
  const int x0 = std::max(0, static_cast<int>(std::ceil(low_x - 0.5)));
  const int x1 = std::min(band.width - 1, static_cast<int>(std::floor(high_x - 0.5)));
  // Twice the area, positive where the screen (y down) shows the triangle clockwise, that is from behind.
  const double area = (p[1].x() - p[0].x()) * (p[2].y() - p[0].y()) - (p[1].y() - p[0].y()) * (p[2].x() - p[0].x());
  if (area == 0) return;
  const bool back = area > 0;

  // weight[k] is 1 at corner k and 0 on the edge opposite; height[k] is how far that corner is from that edge.
  std::array<Eigen::Vector3d, 3> weight;
  std::array<double, 3> height{};
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d& a = p[(k + 1) % 3];
    const Eigen::Vector3d& b = p[(k + 2) % 3];
    const double dx = (a.y() - b.y()) / area;
    const double dy = (b.x() - a.x()) / area;
    weight[k] = {dx, dy, -(dx * a.x() + dy * a.y())};
    height[k] = std::abs(area) / std::hypot(b.x() - a.x(), b.y() - a.y());
  }
  const Color flat = smooth ? Color::Zero() : shade(view.normals.row(f).transpose(), back);
  for (int y = y0; y <= y1; ++y) {
    const std::size_t row = static_cast<std::size_t>(y - band.first) * static_cast<std::size_t>(band.width);
    for (int x = x0; x <= x1; ++x) {
      const Eigen::Vector3d at(x + 0.5, y + 0.5, 1);
      const std::array<double, 3> w{weight[0].dot(at), weight[1].dot(at), weight[2].dot(at)};
      if (std::min({w[0], w[1], w[2]}) < -kSliver) continue;
      const auto nearness = static_cast<float>(w[0] * p[0].z() + w[1] * p[1].z() + w[2] * p[2].z());
      const std::size_t i = row + static_cast<std::size_t>(x);
      if (nearness <= band.depth[i]) continue;
      band.depth[i] = nearness;
      Color color = flat;
      if (smooth) {
        Eigen::Vector3d normal = Eigen::Vector3d::Zero();
        for (int k = 0; k < 3; ++k)
          normal += w[static_cast<std::size_t>(k)] * view.normals.row(mesh.triangles(f, k)).transpose();
        color = shade(normal, back);
      }
      const double edge = std::min({w[0] * height[0], w[1] * height[1], w[2] * height[2]});
      const auto ink = static_cast<float>(std::clamp(view.edge_half_width + 0.5 - edge, 0.0, 1.0));
      band.color[i] = color * (1 - ink * view.edge_darkness);
    }
  }
}

/// Is a place of a curve seen, or is a surface before it? All samples around it are asked: beside a crease or at an outline,
/// one may lie on a facet that falls away steeply. A place outside the band is not seen.
inline bool is_seen(const Band& band, const Eigen::Vector3d& at) {
  const int x = static_cast<int>(std::floor(at.x())), y = static_cast<int>(std::floor(at.y())) - band.first;
  for (int v = std::max(0, y - 1); v <= std::min(band.rows - 1, y + 1); ++v) {
    for (int u = std::max(0, x - 1); u <= std::min(band.width - 1, x + 1); ++u) {
      const std::size_t i = static_cast<std::size_t>(v) * static_cast<std::size_t>(band.width) + static_cast<std::size_t>(u);
      if (at.z() * (1 + kCurveBehind) >= static_cast<double>(band.depth[i])) return true;
    }
  }
  return false;
}

/// Inks the samples beside a segment whose nearest point on it is seen: hidden lines stay hidden, and the whole width of others
/// is drawn, on whatever facets lie there.
inline void draw_curve(const View& view, const std::array<amps::Index, 2>& curve, Band& band, std::vector<float>& ink) {
  const Eigen::Vector3d a = view.screen.row(curve[0]), d = Eigen::Vector3d(view.screen.row(curve[1])) - a;
  const double reach = view.curve_half_width + 0.5;
  const auto from = [](double x, int least) {
    return static_cast<int>(std::ceil(std::max(x - 0.5, static_cast<double>(least))));
  };
  const auto to = [](double x, int most) { return static_cast<int>(std::floor(std::min(x - 0.5, static_cast<double>(most)))); };
  const double length2 = d.head<2>().squaredNorm();
  const int y1 = to(std::max(a.y(), a.y() + d.y()) + reach, band.first + band.rows - 1);
  for (int y = from(std::min(a.y(), a.y() + d.y()) - reach, band.first); y <= y1; ++y) {
    // Of a slanted segment, only the part near this row.
    double t0 = 0, t1 = 1;
    if (std::abs(d.y()) > reach) {
      const double near0 = (y + 0.5 - reach - a.y()) / d.y(), near1 = (y + 0.5 + reach - a.y()) / d.y();
      t0 = std::clamp(std::min(near0, near1), 0.0, 1.0);
      t1 = std::clamp(std::max(near0, near1), 0.0, 1.0);
    }
    const auto [low_x, high_x] = std::minmax({a.x() + t0 * d.x(), a.x() + t1 * d.x()});
    const int x1 = to(high_x + reach, band.width - 1);
    for (int x = from(low_x - reach, 0); x <= x1; ++x) {
      const Eigen::Vector2d here(x + 0.5, y + 0.5);
      const double t = length2 > 0 ? std::clamp((here - a.head<2>()).dot(d.head<2>()) / length2, 0.0, 1.0) : 0;
      const Eigen::Vector3d nearest = a + t * d;  // nearness is linear on the screen
      const auto dark = static_cast<float>(std::clamp(reach - (here - nearest.head<2>()).norm(), 0.0, 1.0));
      const std::size_t i =
          static_cast<std::size_t>(y - band.first) * static_cast<std::size_t>(band.width) + static_cast<std::size_t>(x);
      if (dark > ink[i] && is_seen(band, nearest)) ink[i] = dark;
    }
  }
}

inline void draw_curves(const View& view, const Options& options, Band& band) {
  if (options.curves.empty()) return;
  static const Color kCurve(0.012f, 0.012f, 0.016f);
  std::vector<float> ink(band.color.size(), 0.0f);
  for (std::size_t c = 0; c < options.curves.size(); ++c) {
    if (c % kFacetsPerLook == 0) options.execution.check();
    draw_curve(view, options.curves[c], band, ink);
  }
  for (std::size_t i = 0; i < ink.size(); ++i) band.color[i] = (1 - ink[i]) * band.color[i] + ink[i] * kCurve;
}

inline std::uint8_t to_srgb(float linear) {
  const float x = std::clamp(linear, 0.0f, 1.0f);
  const float s = x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f;
  return static_cast<std::uint8_t>(std::lround(255 * s));
}

}  // namespace detail

/// A shaded picture of the whole mesh.
inline Image draw(const amps::MeshView& mesh, const Options& options) {
  using namespace detail;
  amps::require_usable(mesh, options.execution);
  const amps::Execution job = options.execution.start("drawing");
  const View view = look_at(mesh, options);
  Image image;
  image.width = image.height = options.size;
  image.rgb.resize(static_cast<std::size_t>(options.size) * static_cast<std::size_t>(options.size) * 3);

  std::atomic<int> rows_drawn{0};
  // Samples above and below a band: there, too, it must be known whether the middle of a line is hidden.
  const int margin = options.curves.empty() ? 0 : static_cast<int>(std::ceil(view.curve_half_width)) + 2;
  const auto draw_rows = [&](int first, int end) {
    const int first_sample = first * kSupersampling, num_samples = (end - first) * kSupersampling;
    Band band{options.size * kSupersampling, first_sample - margin, num_samples + 2 * margin, {}, {}};
    const std::size_t samples = static_cast<std::size_t>(band.width) * static_cast<std::size_t>(band.rows);
    band.depth.assign(samples, 0.0f);
    band.color.resize(samples);
    for (int y = 0; y < band.rows; ++y) {
      const Color color = background((band.first + y + 0.5) / (options.size * kSupersampling));
      std::fill_n(band.color.begin() + static_cast<std::ptrdiff_t>(y) * band.width, band.width, color);
    }
    for (amps::Index f = 0; f < mesh.num_facets(); ++f) {
      if (f % kFacetsPerLook == 0) job.report(static_cast<double>(rows_drawn) / options.size);
      draw_triangle(mesh, view, options.smooth, f, band);
    }
    draw_curves(view, options, band);
    for (int y = first; y < end; ++y) {
      for (int x = 0; x < options.size; ++x) {
        Color sum = Color::Zero();
        for (int s = 0; s < kSupersampling * kSupersampling; ++s) {
          const int sample_y = margin + (y - first) * kSupersampling + s / kSupersampling;
          const int sample_x = x * kSupersampling + s % kSupersampling;
          sum += band.color[static_cast<std::size_t>(sample_y) * static_cast<std::size_t>(band.width) +
                            static_cast<std::size_t>(sample_x)];
        }
        sum /= kSupersampling * kSupersampling;
        for (int c = 0; c < 3; ++c) {
          image.rgb[(static_cast<std::size_t>(y) * static_cast<std::size_t>(options.size) + static_cast<std::size_t>(x)) * 3 +
                    static_cast<std::size_t>(c)] = to_srgb(sum[c]);
        }
      }
    }
  };
  amps::parallel_for(static_cast<std::size_t>(options.size), kBandRows, job, [&](std::size_t begin, std::size_t end) {
    draw_rows(static_cast<int>(begin), static_cast<int>(end));
    rows_drawn += static_cast<int>(end - begin);
  });
  job.finish();
  return image;
}

namespace detail {

/// Deflate (RFC 1951): one block, fixed Huffman codes, matches found by hash chains.
class Deflater {
 public:
  std::string compress(const std::vector<std::uint8_t>& data, const amps::Execution& execution) {
    constexpr std::size_t kBytesPerLook = 1 << 16;
    std::size_t next_look = 0;
    put_bits(1, 1);  // last block
    put_bits(1, 2);  // fixed codes
    std::vector<std::int64_t> newest(std::size_t{1} << kHashBits, -1);
    std::vector<std::int64_t> older(kWindow, -1);  // by position modulo the window
    const auto remember = [&](std::size_t i) {
      if (i + 3 > data.size()) return;
      const std::size_t h = hash(&data[i]);
      older[i % kWindow] = newest[h];
      newest[h] = static_cast<std::int64_t>(i);
    };
    for (std::size_t i = 0; i < data.size();) {
      if (i >= next_look) {
        next_look = i + kBytesPerLook;
        execution.report(static_cast<double>(i) / static_cast<double>(data.size()));
      }
      std::size_t best = 0, best_distance = 0;
      if (i + 3 <= data.size()) {
        const std::size_t longest = std::min<std::size_t>(258, data.size() - i);
        std::int64_t candidate = newest[hash(&data[i])];
        for (int tries = 0; tries < 48 && candidate >= 0 && i - static_cast<std::size_t>(candidate) < kWindow; ++tries) {
          const auto from = static_cast<std::size_t>(candidate);
          std::size_t length = 0;
          while (length < longest && data[from + length] == data[i + length]) ++length;
          if (length > best) {
            best = length;
            best_distance = i - from;
          }
          candidate = older[from % kWindow];
        }
      }
      if (best < 3) best = 1;
      if (best == 1) {
        put_symbol(data[i]);
      } else {
        put_match(best, best_distance);
      }
      for (std::size_t k = 0; k < best; ++k) remember(i + k);
      i += best;
    }
    put_symbol(256);
    put_bits(0, 7);  // fills the last byte
    return std::move(out_);
  }

 private:
  static constexpr int kHashBits = 15;
  static constexpr std::size_t kWindow = 32768;

  static std::size_t hash(const std::uint8_t* p) {
    const std::uint32_t x =
        static_cast<std::uint32_t>(p[0]) | static_cast<std::uint32_t>(p[1]) << 8 | static_cast<std::uint32_t>(p[2]) << 16;
    return (x * 2654435761u) >> (32 - kHashBits);
  }
  void put_bits(std::uint32_t bits, int count) {
    buffer_ |= bits << used_;
    for (used_ += count; used_ >= 8; used_ -= 8, buffer_ >>= 8) out_ += static_cast<char>(buffer_ & 255);
  }
  void put_code(std::uint32_t code, int length) {  // Huffman codes go out from their highest bit
    for (int k = length - 1; k >= 0; --k) put_bits(code >> k & 1, 1);
  }
  void put_symbol(std::uint32_t s) {
    if (s < 144) return put_code(0x30 + s, 8);
    if (s < 256) return put_code(0x190 + s - 144, 9);
    if (s < 280) return put_code(s - 256, 7);
    put_code(0xC0 + s - 280, 8);
  }
  /// Lengths 3–258 and distances 1–32768 share one scheme: 2^extra values a symbol, extra growing every `step` symbols.
  void put_match(std::size_t length, std::size_t distance) {
    if (length == 258) {
      put_symbol(285);
    } else {
      put_split(static_cast<std::uint32_t>(length - 3), 4, [this](std::uint32_t s) { put_symbol(257 + s); });
    }
    put_split(static_cast<std::uint32_t>(distance - 1), 2, [this](std::uint32_t s) { put_code(s, 5); });
  }
  template <class Put>
  void put_split(std::uint32_t value, std::uint32_t step, Put put) {
    int extra = 0;
    while (value >> extra >= 2 * step) ++extra;
    put(static_cast<std::uint32_t>(extra) * step + (value >> extra));
    put_bits(value & ((1u << extra) - 1), extra);
  }

  std::string out_;
  std::uint32_t buffer_ = 0;
  int used_ = 0;
};

inline void put_uint32(std::string& out, std::uint32_t x) {
  for (int shift = 24; shift >= 0; shift -= 8) out += static_cast<char>(x >> shift & 255);
}

inline void put_chunk(std::string& out, const char* type, const std::string& data) {
  put_uint32(out, static_cast<std::uint32_t>(data.size()));
  const std::string body = type + data;
  std::uint32_t crc = 0xFFFFFFFFu;
  for (const char c : body) {
    crc ^= static_cast<std::uint8_t>(c);
    for (int k = 0; k < 8; ++k) crc = crc >> 1 ^ ((crc & 1) != 0 ? 0xEDB88320u : 0u);
  }
  out += body;
  put_uint32(out, crc ^ 0xFFFFFFFFu);
}

/// Rows predicted by one of the five PNG filters each, the one that leaves the least to say.
inline std::vector<std::uint8_t> filter_rows(const Image& image, const amps::Execution& execution) {
  const std::size_t stride = static_cast<std::size_t>(image.width) * 3;
  std::vector<std::uint8_t> above(stride, 0), row(stride), best(stride), out;
  for (std::size_t y = 0; y < static_cast<std::size_t>(image.height); ++y) {
    execution.report(static_cast<double>(y) / image.height);
    const std::uint8_t* now = &image.rgb[y * stride];
    long best_cost = std::numeric_limits<long>::max();
    std::uint8_t best_filter = 0;
    for (std::uint8_t filter = 0; filter < 5; ++filter) {
      long cost = 0;
      for (std::size_t i = 0; i < stride; ++i) {
        const int a = i < 3 ? 0 : now[i - 3], b = above[i], c = i < 3 ? 0 : above[i - 3];
        const int pa = std::abs(b - c), pb = std::abs(a - c), pc = std::abs(a + b - 2 * c);
        const int paeth = pa <= pb && pa <= pc ? a : pb <= pc ? b : c;
        const int predicted[5] = {0, a, b, (a + b) / 2, paeth};
        row[i] = static_cast<std::uint8_t>(now[i] - predicted[filter]);
        cost += std::abs(static_cast<std::int8_t>(row[i]));
      }
      if (cost < best_cost) {
        best_cost = cost;
        best_filter = filter;
        best.swap(row);
      }
    }
    out.push_back(best_filter);
    out.insert(out.end(), best.begin(), best.end());
    above.assign(now, now + stride);
  }
  return out;
}

}  // namespace detail

/// The bytes of a PNG file (8-bit RGB).
inline std::string encode_png(const Image& image, const amps::Execution& execution) {
  using namespace detail;
  const amps::Execution job = execution.start("writing");
  std::string header;
  put_uint32(header, static_cast<std::uint32_t>(image.width));
  put_uint32(header, static_cast<std::uint32_t>(image.height));
  header += std::string("\x08\x02\x00\x00\x00", 5);  // 8 bits, RGB, deflate, adaptive filters, not interlaced

  const std::vector<std::uint8_t> rows = filter_rows(image, job.part(0, 0.5));
  std::uint32_t a = 1, b = 0;  // Adler-32
  for (const std::uint8_t byte : rows) {
    a = (a + byte) % 65521;
    b = (b + a) % 65521;
  }
  std::string data = "\x78\x01";  // zlib: deflate with a 32 KiB window
  data += Deflater().compress(rows, job.part(0.5, 1));
  put_uint32(data, b << 16 | a);

  std::string png = "\x89PNG\r\n\x1a\n";
  put_chunk(png, "IHDR", header);
  put_chunk(png, "IDAT", data);
  put_chunk(png, "IEND", "");
  job.finish();
  return png;
}

}  // namespace render
