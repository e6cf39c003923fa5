// render_mesh.h: a picture of a triangle mesh, without a display. A z-buffer rasteriser with perspective, two lights,
// supersampling, edges, curves and dots, and two-sided colours (an inside seen through a hole is red). What the surface is
// painted with is a function of the place: render_looks.h has some. It needs nothing but amps and the standard library, and is
// part of the program, not of the library.
#pragma once

#include "amps/amps.h"
#include "render_png.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

namespace render {

using Color = Eigen::Vector3f;  // linear light

/// The colour of a surface at a place of a facet, given by barycentric coordinates.
using Paint = std::function<Color(amps::Index facet, const Eigen::Vector3d& weights)>;

/// A dot on the surface.
struct Dot {
  Eigen::Vector3d position;
  Color color;
};

struct Options {
  int size = 1024;            ///< width and height in pixels
  bool smooth = false;        ///< normals interpolated over a triangle instead of one for all of it
  bool edges = true;          ///< triangle edges drawn dark
  double azimuth = 30;        ///< degrees the viewer walks around the up axis
  double elevation = 18;      ///< degrees the viewer looks down from
  bool z_up = false;          ///< the model's up axis is z instead of y
  amps::Execution execution;  ///< the picture does not depend on the threads
  double zoom = 1;            ///< so many times larger than what fits the picture, about its middle
  /// Pairs of vertices, joined by thick lines where they are seen.
  std::vector<std::array<amps::Index, 2>> curves = {};
  double curve_width = 0;  ///< pixels; 0: thick, by the size of the picture
  Paint paint = {};        ///< empty: blue outside, red inside
  /// By facet, which of its edges are drawn: bit e stands for that from corner e to e + 1 (mod 3). Empty: all.
  std::vector<std::uint8_t> edges_of = {};
  double spacing = 0;  ///< of the lines that edges are, in units of the mesh: fine ones fade. 0: the median length of an edge
  std::vector<Dot> dots = {};
  double dot_radius = 0;  ///< pixels; 0: by their number
};

/// Where a model is looked at from, by name; false for any other name.
inline bool look_from(const std::string& name, Options& options) {
  struct View {
    const char* name;
    double azimuth, elevation;
  };
  static constexpr View kViews[] = {{"front", 0, 0}, {"back", 180, 0},   {"left", -90, 0},        {"right", 90, 0},
                                    {"top", 0, 90},  {"bottom", 0, -90}, {"iso", 45, 35.26438968}};
  for (const View& view : kViews) {
    if (name != view.name) continue;
    options.azimuth = view.azimuth;
    options.elevation = view.elevation;
    return true;
  }
  return false;
}

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

/// A mesh as the viewer sees it.
struct View {
  amps::Points screen;         // #V by 3: x, y in samples, 1/distance to the viewer
  amps::Points dots;           // the same of dots
  amps::Points normals;        // in camera axes (z towards the viewer): per facet, or per vertex if smooth
  double edge_half_width = 0;  // samples
  float edge_darkness = 0;
  double curve_half_width = 0;  // samples
  double dot_radius = 0;        // samples
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

/// Of evenly spread dots, half of which are seen, the greatest radius in pixels that leaves most of the surface to be seen.
inline double usual_dot(const Options& options) {
  constexpr double kOfSpacing = 0.12, kLeast = 0.9, kMost = 7;
  const double spacing = options.size * options.zoom / std::sqrt(1.0 + 0.5 * static_cast<double>(options.dots.size()));
  return std::clamp(kOfSpacing * spacing, kLeast, kMost);
}

inline View look_at(const amps::MeshView& mesh, const Options& options) {
  const Eigen::Matrix3d axes = camera_axes(options);
  const amps::Box box = amps::bounding_box(mesh);
  // Scaled to a unit diagonal, so that models of any size are far from overflow.
  const Eigen::Vector3d middle = 0.5 * box.min + 0.5 * box.max;
  const auto num_vertices = mesh.vertices.rows(), num_dots = static_cast<std::ptrdiff_t>(options.dots.size());
  amps::Points eye(num_vertices + num_dots);
  for (std::ptrdiff_t v = 0; v < eye.rows(); ++v) {
    const Eigen::Vector3d x = v < num_vertices ? Eigen::Vector3d(mesh.vertices[v])
                                               : options.dots[static_cast<std::size_t>(v - num_vertices)].position;
    eye.row(v) = (axes * (x - middle) / box.diagonal()).transpose();
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
  const double focal = half * kMargin / tangent * options.zoom;
  view.screen.resize(num_vertices);
  view.dots.resize(num_dots);
  for (std::ptrdiff_t v = 0; v < eye.rows(); ++v) {
    const double inverse = 1 / (distance - eye(v, 2));
    const Eigen::RowVector3d seen(half + focal * eye(v, 0) * inverse, half - focal * eye(v, 1) * inverse, inverse);
    if (v < num_vertices) {
      view.screen.row(v) = seen;
    } else {
      view.dots.row(v - num_vertices) = seen;
    }
  }
  view.dot_radius = kSupersampling * (options.dot_radius > 0 ? options.dot_radius : usual_dot(options));
  const double usual_half_width = std::max(kLeastCurveHalfWidth, kCurveHalfWidth * options.size);
  view.curve_half_width = kSupersampling * (options.curve_width > 0 ? options.curve_width / 2 : usual_half_width);
  amps::Points normals = amps::facet_normals(mesh);
  if (options.smooth) normals = vertex_normals(mesh, normals);
  view.normals = normals.map() * axes.transpose();
  if (options.edges) {
    // Where triangles are only a few pixels wide, lines get thinner and fade, or the picture would go black.
    const double edge =
        options.spacing > 0 ? options.spacing * focal / (distance * box.diagonal()) : typical_edge(mesh, view.screen);
    const double pixels = edge / kSupersampling;
    view.edge_half_width = std::min(kEdgeHalfWidth, 0.07 * pixels) * kSupersampling;
    view.edge_darkness = static_cast<float>(kEdgeDarkness * std::clamp((pixels - 1) / 5, 0.0, 1.0));
  }
  return view;
}

/// Light leaving a surface of a colour, with this normal (camera axes, not necessarily of unit length) towards the viewer.
inline Color shade(const Eigen::Vector3d& direction, const Color& color) {
  static const Eigen::Vector3d kSide = Eigen::Vector3d(-0.62, 0.66, 0.42).normalized();
  const double length = direction.norm();
  Eigen::Vector3d n = length > 0 ? Eigen::Vector3d(direction / length) : Eigen::Vector3d::UnitZ();
  if (n.z() < 0) n = -n;
  const double head = n.z();
  const double side = std::max(0.0, (n.dot(kSide) + 0.35) / 1.35);  // wraps around, as the light of a wide window does
  const double sky = 0.5 + 0.5 * n.y();
  const double highlight = std::pow(std::max(0.0, n.dot((kSide + Eigen::Vector3d::UnitZ()).normalized())), 40);
  const auto diffuse = static_cast<float>(0.10 + 0.12 * sky + 0.42 * head + 0.58 * side * side);
  return color * diffuse + Color::Constant(static_cast<float>(0.10 * highlight));
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

/// What a surface is painted with where nobody says: its outside and its inside; and how much darker is the inside of others.
inline const Color kFront(0.33f, 0.52f, 0.72f);
inline const Color kBack(0.72f, 0.25f, 0.18f);
constexpr float kDarkInside = 0.35f;

inline void draw_triangle(const amps::MeshView& mesh, const View& view, const Options& options, amps::Index f, Band& band) {
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
  // Edges that are not drawn are far off.
  const unsigned drawn = options.edges_of.empty() ? 7u : options.edges_of[static_cast<std::size_t>(f)];
  std::array<double, 3> far_off{};
  for (std::size_t k = 0; k < 3; ++k) {  // edge k + 1 is opposite to corner k
    far_off[k] = (drawn >> (k + 1) % 3 & 1u) != 0 ? 0 : std::numeric_limits<double>::infinity();
  }
  const Color flat = options.smooth ? Color::Zero() : shade(view.normals.row(f).transpose(), back ? kBack : kFront);
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
      if (options.smooth || options.paint) {
        Eigen::Vector3d normal = view.normals.row(options.smooth ? 0 : f).transpose();
        if (options.smooth) {
          normal.setZero();
          for (int k = 0; k < 3; ++k)
            normal += w[static_cast<std::size_t>(k)] * view.normals.row(mesh.triangles(f, k)).transpose();
        }
        Color base = back ? kBack : kFront;
        if (options.paint) {
          // Nearness is linear on the screen, places are not.
          const Eigen::Vector3d place(w[0] * p[0].z(), w[1] * p[1].z(), w[2] * p[2].z());
          base = options.paint(f, place / place.sum()) * (back ? kDarkInside : 1.0f);
        }
        color = shade(normal, base);
      }
      const double edge =
          std::min({w[0] * height[0] + far_off[0], w[1] * height[1] + far_off[1], w[2] * height[2] + far_off[2]});
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

/// Dots whose middles are seen, whole.
inline void draw_dots(const View& view, const Options& options, Band& band) {
  for (std::size_t i = 0; i < options.dots.size(); ++i) {
    if (i % kFacetsPerLook == 0) options.execution.check();
    const Eigen::Vector3d at = view.dots.row(static_cast<std::ptrdiff_t>(i));
    const double reach = view.dot_radius + 0.5;
    const int y0 = std::max(band.first, static_cast<int>(std::ceil(std::max(at.y() - reach - 0.5, -1e9))));
    const int y1 = std::min(band.first + band.rows - 1, static_cast<int>(std::floor(std::min(at.y() + reach - 0.5, 1e9))));
    if (y0 > y1 || at.x() < -reach || at.x() > band.width + reach || !is_seen(band, at)) continue;
    const int x0 = std::max(0, static_cast<int>(std::ceil(at.x() - reach - 0.5)));
    const int x1 = std::min(band.width - 1, static_cast<int>(std::floor(at.x() + reach - 0.5)));
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const double away = std::hypot(x + 0.5 - at.x(), y + 0.5 - at.y());
        const auto cover = static_cast<float>(std::clamp(reach - away, 0.0, 1.0));
        const std::size_t j =
            static_cast<std::size_t>(y - band.first) * static_cast<std::size_t>(band.width) + static_cast<std::size_t>(x);
        band.color[j] = (1 - cover) * band.color[j] + cover * options.dots[i].color;
      }
    }
  }
}

inline std::uint8_t to_srgb(float linear) {
  const float x = std::clamp(linear, 0.0f, 1.0f);
  const float s = x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f;
  return static_cast<std::uint8_t>(std::lround(255 * s));
}

}  // namespace detail

/// A shaded picture of the whole mesh, or with a zoom of its middle.
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
  const double overhang =
      std::max(options.curves.empty() ? 0.0 : view.curve_half_width, options.dots.empty() ? 0.0 : view.dot_radius);
  const int margin = overhang == 0 ? 0 : static_cast<int>(std::ceil(overhang)) + 2;
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
      draw_triangle(mesh, view, options, f, band);
    }
    draw_curves(view, options, band);
    draw_dots(view, options, band);
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

}  // namespace render
