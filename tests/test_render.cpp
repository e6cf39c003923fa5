// The renderer of the examples: what is painted is what is there.
#include "examples/render_looks.h"
#include "examples/render_mesh.h"
#include "examples/render_plot.h"

#include "kit/basics.h"
#include "kit/meshes.h"

#include "amps/maximality.h"
#include "amps/sampling.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace amps_test {

using amps::SampleSet;
using doctest::Approx;

namespace {

double share_of(const render::Image& image, bool (*is)(int red, int green, int blue)) {
  double count = 0;
  for (std::size_t i = 0; i < image.rgb.size(); i += 3) count += is(image.rgb[i], image.rgb[i + 1], image.rgb[i + 2]);
  return count / (static_cast<double>(image.rgb.size()) / 3);
}

bool is_red(int red, int green, int blue) { return red > 2 * green && red > 2 * blue; }

/// The unit square from before, filling a known part of the picture.
render::Options from_before(int size) {
  render::Options options;
  CHECK(render::look_from("front", options));
  options.size = size;
  options.edges = false;
  return options;
}

bool equal(const render::Color& a, const render::Color& b) { return a == b; }

}  // namespace

TEST_CASE("render: a line covers its length times its thickness") {
  for (const auto& [x, y] : {std::array{80.0, 20.0}, {20.0, 80.0}, {70.3, 61.7}, {90.0, 85.5}}) {
    render::Canvas canvas(100, 100, {0, 0, 0});
    canvas.line(20, 20, x, y, 4, {255, 255, 255});
    double sum = 0;
    for (const std::uint8_t c : canvas.image().rgb) sum += c / 255.0 / 3;
    const double length = std::hypot(x - 20, y - 20);
    CHECK(sum == Approx(4 * length + kPi * 4).epsilon(0.02));
  }
  render::Canvas canvas(10, 10);
  canvas.line(-50, -50, -20, 5000, 3, {0, 0, 0});  // off the picture
  canvas.fill(-5, -5, 0, 100, {0, 0, 0});
  canvas.text(-100, 300, "off", 10);
  for (const std::uint8_t c : canvas.image().rgb) CHECK(c == 255);
}

TEST_CASE("render: every letter has strokes of its own, within its box") {
  std::vector<std::string> seen;
  for (int c = 33; c < 127; ++c) {
    const std::string strokes = render::detail::strokes_of(static_cast<char>(c));
    std::size_t digits = 0;
    for (const char d : strokes + " ") {
      if (d == ' ') {
        CHECK(digits % 2 == 0);
        CHECK(digits >= 4);
        digits = 0;
        continue;
      }
      CHECK((d >= '0' && d <= (digits % 2 == 0 ? '4' : '9')));
      ++digits;
    }
    if (std::isalnum(c) != 0) {
      CHECK(std::find(seen.begin(), seen.end(), strokes) == seen.end());
      if (c != '0') seen.push_back(strokes);  // zero and the capital O are one
    }
  }
  CHECK(render::Canvas::text_width("3\xC2\xB0", 6) == render::Canvas::text_width("30", 6));
}

TEST_CASE("render: axes end at round numbers and have some") {
  for (const double range : {0.013, 0.7, 1.0, 42.0, 99999.0}) {
    const double step = render::detail::round_step(range, 8);
    CHECK(range / step <= 8.01);
    CHECK(range / step >= 3);
    const double digits = step / std::pow(10, std::floor(std::log10(step * 1.0001)));
    CHECK(std::min({std::abs(digits - 1), std::abs(digits - 2), std::abs(digits - 5)}) < 1e-9);
  }
  render::Plot plot;  // nothing to draw, one point, and what is not finite
  CHECK(render::draw(plot).width == plot.width);
  plot.series.push_back({"one", {3}, {4}});
  plot.series.push_back({"none", {1, 2, 3}, {std::nan(""), 1 / 0.0, 2}, true});
  CHECK(render::draw(plot).height == plot.height);
  plot.log_y = true;
  plot.series.push_back({"not positive", {1, 2}, {0, -1}});
  CHECK(render::draw(plot).height == plot.height);
}

TEST_CASE("render: places that are painted are those of the surface, in perspective") {
  // A square that leans back: what is painted by the middle of its height is seen above the middle of its picture.
  const Mesh leaning = mesh_of({{0, 0, 0}, {1, 0, 0}, {1, 0.2, -3}, {0, 0.2, -3}}, {{0, 1, 2}, {0, 2, 3}});
  render::Options options = from_before(200);
  options.elevation = 30;
  bool inside = true;
  options.paint = [&](Index f, const Eigen::Vector3d& w) {
    inside = inside && w.minCoeff() > -1e-6 && std::abs(w.sum() - 1) < 1e-12;
    double z = 0;
    for (int k = 0; k < 3; ++k) z += w[k] * leaning.vertices(leaning.triangles(f, k), 2);
    return z > -1.5 ? render::Color(1, 0, 0) : render::Color(0, 0, 1);
  };
  options.execution = amps::Execution(1);
  const render::Image image = render::draw(leaning, options);
  CHECK(inside);
  const double near = share_of(image, is_red);
  const double far = share_of(image, [](int red, int green, int blue) { return blue > 2 * red && blue > 2 * green; });
  CHECK(far > 0.05);
  CHECK(near > 1.2 * far);
}

TEST_CASE("render: gaps are red, by their area") {
  const Mesh square = amps::make_square(7);
  amps::SamplingOptions sampling;
  sampling.radius = 0.1;
  sampling.max_rejections = 10;
  const SampleSet darts = amps::throw_darts(square, sampling).samples;
  const double area = amps::verify_maximal(square, darts).gap_area;
  CHECK(area > 0.01);
  render::Scene gaps = render::cell_look(square, darts, render::CellLook::kGaps);
  render::Scene whole = gaps;
  whole.options.paint = [](Index, const Eigen::Vector3d&) { return render::Color(1, 0, 0); };
  const auto red = [](render::Scene scene) {
    render::Options options = from_before(800);
    options.paint = scene.options.paint;
    return share_of(render::draw(scene.mesh, options), is_red);
  };
  CHECK(std::abs(red(gaps) / red(whole) / area - 1) < 0.03);
  const SampleSet filled = amps::fill_gaps(square, darts, sampling).samples;
  CHECK(red(render::cell_look(square, filled, render::CellLook::kGaps)) == 0);
}

TEST_CASE("render: valences and classes of angles have their colours") {
  const Eigen::Vector3d corner(0.9, 0.05, 0.05);
  const render::Scene five = render::valence_look(amps::make_sphere(20));  // an icosahedron
  const render::Scene six = render::valence_look(amps::make_torus(1, 0.4, 20, 10));
  const render::Scene four = render::valence_look(amps::make_cube(1));
  const render::Scene border = render::valence_look(one_triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0}));
  CHECK(equal(five.options.paint(3, corner), render::linear(render::look::kValence5)));
  CHECK(equal(six.options.paint(3, corner), render::linear(render::look::kValence6)));
  CHECK(equal(border.options.paint(0, corner), render::linear(render::look::kPlain)));
  bool dark = false;
  for (Index f = 0; f < 12; ++f) dark = dark || equal(four.options.paint(f, corner), render::linear(render::look::kDark));
  CHECK(dark);

  const auto color_of = [&](double degrees) {  // of an isosceles triangle, by the angle at its apex
    const double half = degrees * kPi / 360;
    const render::Scene scene =
        render::angle_look(one_triangle({0, 0, 0}, {std::cos(half), std::sin(half), 0}, {std::cos(half), -std::sin(half), 0}));
    return scene.options.paint(0, corner);
  };
  for (const double degrees : {20.0, 29.9, 120.1, 150.0}) {
    CHECK(equal(color_of(degrees), render::linear(render::look::kDark)));
  }
  for (const double degrees : {30.1, 34.9, 105.1, 119.9}) CHECK(equal(color_of(degrees), render::linear(render::look::kRed)));
  for (const double degrees : {35.1, 60.0, 104.9}) CHECK(equal(color_of(degrees), render::linear(render::look::kPlain)));
}

TEST_CASE("render: a dot is seen before a surface and not behind it") {
  const Mesh square = amps::make_square(1);
  for (const double z : {0.05, -0.05}) {
    render::Options options = from_before(120);
    options.dots.push_back({Eigen::Vector3d(0.5, 0.5, z), render::Color(1, 0, 0)});
    options.dot_radius = 5;
    options.paint = [](Index, const Eigen::Vector3d&) { return render::Color(0.5f, 0.5f, 0.5f); };
    const double red = share_of(render::draw(square, options), is_red) * 120 * 120;
    if (z > 0) {
      CHECK(red == Approx(kPi * 25).epsilon(0.1));
    } else {
      CHECK(red == 0);
    }
  }
}

}  // namespace amps_test
