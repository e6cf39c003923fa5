// render_looks.h: what surfaces are painted with, as in the paper's figures: valences, classes of angles, radii as a map, the
// restricted cells of a sample set, its gaps in red, its disks. Each takes a mesh, and a set where it is of one, and gives a
// mesh to draw and the options to draw it with.
#pragma once

#include "amps/amps.h"
#include "render_mesh.h"
#include "render_plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace render {

/// What draw() takes: the options share what the mesh is painted with.
struct Scene {
  amps::Mesh mesh;
  Options options;
};

inline Color linear(const Rgb& color) {
  Color result;
  for (std::size_t c = 0; c < 3; ++c) {
    const float s = static_cast<float>(color[c]) / 255;
    result[static_cast<std::ptrdiff_t>(c)] = s <= 0.04045f ? s / 12.92f : std::pow((s + 0.055f) / 1.055f, 2.4f);
  }
  return result;
}

namespace look {

constexpr Rgb kPlain{214, 216, 220}, kDark{58, 58, 66}, kRed{214, 39, 40};
constexpr Rgb kValence5{88, 140, 214}, kValence6{128, 190, 112}, kValence7{240, 160, 72};
constexpr Rgb kCovered{176, 202, 226}, kCircle{60, 84, 120}, kDot{24, 24, 30};

/// Bounds of the classes of angles, degrees (the paper's figures).
constexpr double kDarkBelow = 30, kDarkAbove = 120, kRedBelow = 35, kRedAbove = 105;

}  // namespace look

/// From small (cool) to large (warm), t in [0, 1].
inline Color map_color(double t) {
  static constexpr Rgb kStops[] = {{49, 54, 149}, {116, 173, 209}, {254, 240, 170}, {244, 109, 67}, {150, 0, 38}};
  constexpr int kPieces = sizeof kStops / sizeof kStops[0] - 1;
  const double at = std::clamp(t, 0.0, 1.0) * kPieces;
  const int piece = std::min(static_cast<int>(at), kPieces - 1);
  const auto part = static_cast<float>(at - piece);
  return (1 - part) * linear(kStops[piece]) + part * linear(kStops[piece + 1]);
}

namespace detail {

/// The place of a value between the least and the greatest, by its logarithm; ½ if all are equal.
inline std::vector<double> by_logarithm(std::vector<double> values) {
  double low = std::numeric_limits<double>::infinity(), high = 0;
  for (const double v : values) {
    if (!(v > 0)) continue;
    low = std::min(low, v);
    high = std::max(high, v);
  }
  const double range = std::log(high / low);
  for (double& v : values) v = v > 0 && range > 1e-9 ? std::log(v / low) / range : 0.5;
  return values;
}

inline std::size_t corner_of_greatest(const Eigen::Vector3d& weights) {
  std::ptrdiff_t k = 0;
  weights.maxCoeff(&k);
  return static_cast<std::size_t>(k);
}

}  // namespace detail

/// Around each vertex its valence: 5 blue, 6 green, 7 orange, others dark; vertices of the border are plain.
inline Scene valence_look(const amps::Mesh& mesh) {
  const auto num_vertices = static_cast<std::size_t>(mesh.vertices.rows());
  std::vector<std::array<amps::Index, 2>> edges;
  for (std::ptrdiff_t f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const auto [low, high] = std::minmax<amps::Index>({mesh.triangles(f, k), mesh.triangles(f, (k + 1) % 3)});
      edges.push_back({low, high});
    }
  }
  std::sort(edges.begin(), edges.end());
  auto valence = std::make_shared<std::vector<int>>(num_vertices, 0);
  constexpr int kBorder = -1000000;
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t end = i;
    while (end < edges.size() && edges[end] == edges[i]) ++end;
    for (const amps::Index v : edges[i]) (*valence)[static_cast<std::size_t>(v)] += end - i == 1 ? kBorder : 1;
    i = end;
  }
  Scene scene{mesh, {}};
  const auto triangles = std::make_shared<amps::Triangles>(mesh.triangles);
  const std::array<Color, 5> colors{linear(look::kValence5), linear(look::kValence6), linear(look::kValence7),
                                    linear(look::kDark), linear(look::kPlain)};
  scene.options.paint = [=](amps::Index f, const Eigen::Vector3d& weights) {
    const int degree =
        (*valence)[static_cast<std::size_t>((*triangles)(f, static_cast<int>(detail::corner_of_greatest(weights))))];
    return degree < 0 ? colors[4] : degree >= 5 && degree <= 7 ? colors[static_cast<std::size_t>(degree - 5)] : colors[3];
  };
  return scene;
}

/// Triangles with an angle below 30 or above 120 degrees dark; else, below 35 or above 105, red; others plain.
inline Scene angle_look(const amps::Mesh& mesh) {
  const auto colors = std::make_shared<std::vector<Color>>();
  const Color plain = linear(look::kPlain), red = linear(look::kRed), dark = linear(look::kDark);
  for (std::ptrdiff_t f = 0; f < mesh.triangles.rows(); ++f) {
    double least = 180, greatest = 0;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d at = mesh.vertices.row(mesh.triangles(f, k));
      const Eigen::Vector3d a = Eigen::Vector3d(mesh.vertices.row(mesh.triangles(f, (k + 1) % 3))) - at;
      const Eigen::Vector3d b = Eigen::Vector3d(mesh.vertices.row(mesh.triangles(f, (k + 2) % 3))) - at;
      const double angle = std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / 3.14159265358979323846;
      least = std::min(least, angle);
      greatest = std::max(greatest, angle);
    }
    const bool is_dark = least < look::kDarkBelow || greatest > look::kDarkAbove;
    const bool is_red = least < look::kRedBelow || greatest > look::kRedAbove;
    colors->push_back(is_dark ? dark : is_red ? red : plain);
  }
  Scene scene{mesh, {}};
  scene.options.paint = [colors](amps::Index f, const Eigen::Vector3d&) { return (*colors)[static_cast<std::size_t>(f)]; };
  return scene;
}

/// A value at each vertex, positive, as a map from cool to warm by its logarithm. Empty: the mean length of edges there.
inline Scene map_look(const amps::Mesh& mesh, std::vector<double> values = {}) {
  if (values.empty()) {
    values.assign(static_cast<std::size_t>(mesh.vertices.rows()), 0.0);
    std::vector<double> count(values.size(), 0.0);
    for (std::ptrdiff_t f = 0; f < mesh.triangles.rows(); ++f) {
      for (int k = 0; k < 3; ++k) {
        const amps::Index v = mesh.triangles(f, k), w = mesh.triangles(f, (k + 1) % 3);
        const double length = (mesh.vertices.row(v) - mesh.vertices.row(w)).norm();
        for (const amps::Index end : {v, w}) {
          values[static_cast<std::size_t>(end)] += length;
          ++count[static_cast<std::size_t>(end)];
        }
      }
    }
    for (std::size_t v = 0; v < values.size(); ++v) values[v] /= std::max(1.0, count[v]);
  }
  const auto places = std::make_shared<std::vector<double>>(detail::by_logarithm(std::move(values)));
  const auto triangles = std::make_shared<amps::Triangles>(mesh.triangles);
  Scene scene{mesh, {}};
  scene.options.paint = [=](amps::Index f, const Eigen::Vector3d& weights) {
    double t = 0;
    for (int k = 0; k < 3; ++k) t += weights[k] * (*places)[static_cast<std::size_t>((*triangles)(f, k))];
    return map_color(t);
  };
  return scene;
}

/// How the cells of a set are painted.
enum class CellLook {
  kCells,   ///< in pale colours that tell neighbours apart
  kRadius,  ///< by radius, from cool to warm
  kGaps,    ///< covered or, in red, not
  kDisks,   ///< the same, with the circles that disks end at
};

/// The restricted power diagram of a set, its cells outlined. Disks are balls: of sets whose disks know their surface, sheets
/// are seen as if they did not.
inline Scene cell_look(const amps::Mesh& mesh, const amps::SampleSet& samples, CellLook how,
                       const amps::Execution& execution = {}) {
  std::vector<double> weights;
  for (const double r : samples.radii) weights.push_back(r * r);
  const amps::RestrictedPowerDiagram diagram(mesh, samples.positions, weights, execution);

  Scene scene;
  std::vector<amps::Vec3> vertices, corners;
  std::vector<std::array<amps::Index, 3>> triangles;
  std::vector<amps::Index> site_of;
  for (amps::Index f = 0; f < diagram.fragment_capacity(); ++f) {
    if (!diagram.alive(f)) continue;
    const amps::RestrictedPowerDiagram::Polygon polygon = diagram.polygon(f);
    const auto first = static_cast<amps::Index>(vertices.size());
    polygon.list_corners(corners);
    vertices.insert(vertices.end(), corners.begin(), corners.end());
    const auto outlined = [&](amps::Index edge) { return amps::RestrictedPowerDiagram::is_site(polygon.labels[edge]); };
    for (amps::Index k = 1; k + 1 < polygon.size; ++k) {  // a fan; its edges are 0–k, k–k+1, k+1–0
      triangles.push_back({first, first + k, first + k + 1});
      site_of.push_back(polygon.site);
      unsigned drawn = outlined(k) ? 2u : 0u;
      if (k == 1 && outlined(0)) drawn |= 1u;
      if (k + 2 == polygon.size && outlined(k + 1)) drawn |= 4u;
      scene.options.edges_of.push_back(static_cast<std::uint8_t>(drawn));
    }
  }
  scene.mesh.vertices.resize(static_cast<std::ptrdiff_t>(vertices.size()));
  scene.mesh.triangles.resize(static_cast<std::ptrdiff_t>(triangles.size()));
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    scene.mesh.vertices.row(static_cast<std::ptrdiff_t>(v)) = vertices[v].transpose();
  }
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k)
      scene.mesh.triangles(static_cast<std::ptrdiff_t>(t), static_cast<int>(k)) = triangles[t][k];
  }
  double mean_radius = 0;
  for (const double r : samples.radii) mean_radius += r / static_cast<double>(samples.radii.size());
  scene.options.spacing = mean_radius;

  struct Cells {
    std::vector<Color> colors;  // of sites
    std::vector<Eigen::Vector3d> positions;
    std::vector<double> radii;
    std::vector<amps::Index> site_of;
    std::vector<std::vector<amps::Index>> near;  // sites whose disks may end in a cell
    amps::Mesh mesh;
  };
  const auto cells = std::make_shared<Cells>();
  cells->site_of = std::move(site_of);
  cells->mesh = scene.mesh;
  cells->radii = samples.radii;
  const std::vector<double> places = detail::by_logarithm(samples.radii);
  for (amps::Index s = 0; s < samples.size(); ++s) {
    cells->positions.emplace_back(samples.positions.row(s));
    // Hues a golden section apart: those of neighbours differ, whatever their numbers.
    const double hue = 6.28318530717958648 * std::fmod(0.61803398875 * s, 1.0);
    const Color pale(static_cast<float>(0.55 + 0.22 * std::cos(hue)), static_cast<float>(0.55 + 0.22 * std::cos(hue - 2.0944)),
                     static_cast<float>(0.55 + 0.22 * std::cos(hue + 2.0944)));
    const bool by_radius = how == CellLook::kRadius, by_hue = how == CellLook::kCells;
    cells->colors.push_back(by_radius ? map_color(places[static_cast<std::size_t>(s)])
                            : by_hue  ? pale
                                      : linear(look::kCovered));
  }
  const bool circles = how == CellLook::kDisks, gaps = circles || how == CellLook::kGaps;
  if (circles) {
    cells->near.resize(static_cast<std::size_t>(samples.size()));
    std::vector<amps::Index> first_ring, second_ring;
    for (amps::Index s = 0; s < samples.size(); ++s) {
      std::vector<amps::Index>& near = cells->near[static_cast<std::size_t>(s)];
      diagram.neighbors(s, first_ring);
      near = first_ring;
      for (const amps::Index n : first_ring) {
        diagram.neighbors(n, second_ring);
        near.insert(near.end(), second_ring.begin(), second_ring.end());
      }
      std::sort(near.begin(), near.end());
      near.erase(std::unique(near.begin(), near.end()), near.end());
    }
  }
  const Color red = linear(look::kRed), circle = linear(look::kCircle);
  scene.options.paint = [=](amps::Index f, const Eigen::Vector3d& at) -> Color {
    constexpr double kCircleHalfWidth = 0.025;  // radii
    const amps::Index site = cells->site_of[static_cast<std::size_t>(f)];
    if (site == amps::kNone) return red;
    Eigen::Vector3d x = Eigen::Vector3d::Zero();
    for (int k = 0; k < 3; ++k) x += at[k] * cells->mesh.vertices.row(cells->mesh.triangles(f, k)).transpose();
    const auto off = [&](amps::Index s) {  // of its circle, in radii
      const auto i = static_cast<std::size_t>(s);
      return (x - cells->positions[i]).norm() / cells->radii[i] - 1;
    };
    if (circles) {
      if (std::abs(off(site)) < kCircleHalfWidth) return circle;
      for (const amps::Index s : cells->near[static_cast<std::size_t>(site)]) {
        if (std::abs(off(s)) < kCircleHalfWidth) return circle;
      }
    }
    return gaps && off(site) > 0 ? red : cells->colors[static_cast<std::size_t>(site)];
  };
  if (gaps) scene.options.edges = false;
  return scene;
}

/// A dot at each sample.
inline void add_dots(const amps::SampleSet& samples, const Rgb& color, Options& options) {
  for (amps::Index s = 0; s < samples.size(); ++s) {
    options.dots.push_back({Eigen::Vector3d(samples.positions.row(s)), linear(color)});
  }
}

/// Lines between pairs of vertices of the mesh that the scene is of.
inline void set_curves(const amps::Mesh& mesh, const std::vector<std::array<amps::Index, 2>>& lines, Scene& scene) {
  if (lines.empty()) return;
  const auto offset = scene.mesh.vertices.rows();
  amps::Points vertices(offset + mesh.vertices.rows());  // cells have vertices of their own
  for (std::ptrdiff_t v = 0; v < offset; ++v) vertices.row(v) = scene.mesh.vertices.row(v);
  for (std::ptrdiff_t v = 0; v < mesh.vertices.rows(); ++v) vertices.row(offset + v) = mesh.vertices.row(v);
  scene.mesh.vertices = std::move(vertices);
  for (const auto& [a, b] : lines) {
    scene.options.curves.push_back({static_cast<amps::Index>(offset + a), static_cast<amps::Index>(offset + b)});
  }
}

/// A legend in the lower left corner: colours and what they say.
inline Image with_legend(const Image& image, const std::vector<std::pair<Rgb, std::string>>& entries) {
  if (entries.empty()) return image;
  Canvas canvas(image);
  const double letter = std::max(9.0, image.width / 75.0);
  double y = image.height - letter * (1.9 * static_cast<double>(entries.size()) - 0.6);
  double widest = 0;
  for (const auto& entry : entries) widest = std::max(widest, Canvas::text_width(entry.second, letter));
  canvas.fill(0, static_cast<int>(y - 1.8 * letter), static_cast<int>(widest + 3.8 * letter), image.height, {246, 247, 249});
  for (const auto& [color, text] : entries) {
    const int left = static_cast<int>(letter), side = static_cast<int>(1.2 * letter), top = static_cast<int>(y - letter);
    canvas.fill(left - 1, top - 1, left + side + 1, top + side + 1, kInk);
    canvas.fill(left, top, left + side, top + side, color);
    canvas.text(left + side + 0.7 * letter, y, text, letter);
    y += 1.9 * letter;
  }
  return canvas.image();
}

}  // namespace render
