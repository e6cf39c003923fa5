// reproduce_spectra.h: Figure 5 of the paper, for reproduce_paper.cpp: spectra of sets in the plane and on surfaces.
#pragma once

#include "amps/amps.h"
#include "render_plot.h"
#include "report_page.h"
#include "reproduce_common.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace reproduce {

constexpr double kSpectrumRadius = 0.02;
constexpr std::uint64_t kSpectrumSets = 10;

/// Darts on the unit square until so many in a row have found no room: nearly maximal, by no other means.
inline SampleSet brute_force(double radius, std::uint64_t seed) {
  constexpr int kRejections = 2000000;
  const int cells = static_cast<int>(std::ceil(std::sqrt(2.0) / radius)) + 1;  // narrower than r/√2: one dart each
  std::vector<int> grid(static_cast<std::size_t>(cells * cells), -1);
  std::vector<Vec3> points;
  amps::Rng rng(seed);
  for (int rejected = 0; rejected < kRejections; ++rejected) {
    const double x = rng.uniform(), y = rng.uniform();
    const int i = static_cast<int>(x * cells), j = static_cast<int>(y * cells);
    bool fits = true;
    for (int b = std::max(j - 2, 0); b <= std::min(j + 2, cells - 1) && fits; ++b) {
      for (int a = std::max(i - 2, 0); a <= std::min(i + 2, cells - 1) && fits; ++a) {
        const int other = grid[static_cast<std::size_t>(b * cells + a)];
        fits = other < 0 || (points[static_cast<std::size_t>(other)] - Vec3(x, y, 0)).norm() >= radius;
      }
    }
    if (!fits) continue;
    rejected = 0;
    grid[static_cast<std::size_t>(j * cells + i)] = static_cast<int>(points.size());
    points.emplace_back(x, y, 0);
  }
  SampleSet set;
  set.positions.resize(static_cast<std::ptrdiff_t>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) set.positions.row(static_cast<std::ptrdiff_t>(i)) = points[i].transpose();
  set.radii.assign(points.size(), radius);
  return set;
}

/// Of a square grid of points, one at random in each cell; or all anywhere.
inline SampleSet random_points(int side, bool jittered, std::uint64_t seed) {
  amps::Rng rng(seed);
  SampleSet set;
  set.positions.resize(side * side);
  for (int i = 0; i < side * side; ++i) {
    const double x = rng.uniform(), y = rng.uniform();
    set.positions.row(i) =
        jittered ? Eigen::RowVector3d((i % side + x) / side, (i / side + y) / side, 0) : Eigen::RowVector3d(x, y, 0);
  }
  return set;
}

struct Spectrum {
  std::string name;
  amps::SpectrumReport report;

  double peak() const { return *std::max_element(report.radial_mean.begin(), report.radial_mean.end()); }
  /// The mean over rings but the first, where there are few frequencies.
  double anisotropy() const {
    constexpr std::size_t kFirst = 8;
    double sum = 0;
    for (std::size_t k = kFirst; k < report.anisotropy.size(); ++k) sum += report.anisotropy[k];
    return sum / static_cast<double>(report.anisotropy.size() - kFirst);
  }
  /// The difference of the radial mean from another, in what chance leaves: 1 where there is no other. Both are means over sets
  /// and frequencies, of which the window leaves a quarter independent.
  double off(const Spectrum& other) const {
    double sum = 0;
    const std::size_t n = std::min(report.rings.size(), other.report.rings.size());
    for (std::size_t k = 0; k < n; ++k) {
      const double chance =
          other.report.radial_mean[k] * std::sqrt(2 * 4.0 / (static_cast<double>(kSpectrumSets) * report.frequencies[k]));
      const double off = (report.radial_mean[k] - other.report.radial_mean[k]) / chance;
      sum += off * off / static_cast<double>(n);
    }
    return std::sqrt(sum);
  }
};

inline Spectrum spectrum_of(const std::string& name, const std::function<SampleSet(std::uint64_t seed)>& make) {
  constexpr Index kMaxFrequency = 160;
  std::vector<SampleSet> sets;
  for (std::uint64_t seed = 1; seed <= kSpectrumSets; ++seed) sets.push_back(make(seed));
  amps::SpectrumOptions options;
  options.max_frequency = kMaxFrequency;
  return {name, amps::spectrum(amps::positions_of(sets), options)};
}

/// 0 black, 1 grey, 2 and more white; the mean density left out.
inline render::Image power_image(const amps::SpectrumReport& report) {
  const Index m = report.max_frequency, hidden = report.rings.front() - 1;
  render::Image image;
  image.width = image.height = 2 * m + 1;
  for (Index v = m; v >= -m; --v) {
    for (Index u = -m; u <= m; ++u) {
      const bool mean = std::abs(u) <= hidden && std::abs(v) <= hidden;
      const double power = mean ? 0 : report.at(u, v);
      image.rgb.insert(image.rgb.end(), 3, static_cast<std::uint8_t>(std::lround(255 * std::min(1.0, power / 2))));
    }
  }
  return image;
}

/// Sets on the unit square, by seed, as sampled and within bounds of angles.
struct SquareSets {
  Mesh square = amps::make_square(8);

  SampleSet maximal(std::uint64_t seed) const { return amps::sample(square, with_radius(kSpectrumRadius, seed)).samples; }
  Spectrum within(const std::string& name, double low, double high) const {
    return spectrum_of(name, [&](std::uint64_t seed) { return optimized(square, maximal(seed), low, high, seed); });
  }
};

inline std::vector<Spectrum> all_spectra(const SquareSets& sets) {
  const int side = static_cast<int>(std::lround(std::sqrt(amps::kSamplesPerDensity) / kSpectrumRadius));
  return {spectrum_of("white noise", [&](std::uint64_t seed) { return random_points(side, false, seed); }),
          spectrum_of("jittered grid", [&](std::uint64_t seed) { return random_points(side, true, seed); }),
          spectrum_of("darts by brute force", [](std::uint64_t seed) { return brute_force(kSpectrumRadius, seed); }),
          spectrum_of("maximal", [&](std::uint64_t seed) { return sets.maximal(seed); }),
          sets.within("[35\xC2\xB0, 105\xC2\xB0]", 35, 105),
          sets.within("[42\xC2\xB0, 90\xC2\xB0]", 42, 90)};
}

/// Least angle against what becomes of the spectrum.
inline void choice_of_bounds(const SquareSets& sets, const Spectrum& maximal, const Spectrum& brute, Page& page) {
  const std::vector<std::pair<double, double>> bounds = {{33, 111}, {35, 105}, {38, 100}, {40, 95}, {42, 90}, {44, 87}};
  render::Plot choice{"Shape against randomness", "least angle, degrees", "of the radial mean", {}};
  choice.legend_left = true;
  render::Series peak{"greatest power", {30}, {maximal.peak()}, true};
  render::Series waves{"oscillation", {30}, {maximal.report.oscillation}, true};
  render::Series off{"off brute force, in noise", {30}, {maximal.off(brute)}, true};
  for (const auto& [low, high] : bounds) {
    const Spectrum s = sets.within("", low, high);
    for (render::Series* series : {&peak, &waves, &off}) series->x.push_back(low);
    peak.y.push_back(s.peak());
    waves.y.push_back(s.report.oscillation);
    off.y.push_back(s.off(brute));
  }
  choice.series = {peak, waves, off};
  page.picture(
      "figure_5_choice.png", render::draw(choice),
      "Sets as sampled (30 degrees), then optimised to [33, 111], [35, 105], [38, 100], [40, 95], [42, 90], [44, 87] degrees: "
      "the tighter the angles, the higher the peak of the spectrum and the more it oscillates.");
}

/// Differences on a sphere and a torus beside those in the plane.
inline void surface_spectra(const Mesh& square, Run& run, Page& page) {
  constexpr double kSamples = 6000, kRange = 3, kChance = 1e-9;
  render::Plot plot{"Density of differences along the surface", "distance / r", "pair correlation (no order: 1)", {}};
  const std::vector<std::pair<std::string, Mesh>> shapes = {
      {"square", square}, {"sphere", amps::make_sphere(20000)}, {"torus", amps::make_torus(1.0, 0.4, 160, 64)}};
  std::vector<std::vector<std::string>> rows;
  for (const auto& [name, shape] : shapes) {
    const double radius = std::sqrt(amps::kSamplesPerDensity * amps::total_area(shape) / kSamples);
    std::vector<SampleSet> sets;
    for (std::uint64_t seed = 1; seed <= 3; ++seed) sets.push_back(amps::sample(shape, with_radius(radius, seed)).samples);
    amps::DifferentialOptions options;
    options.range = kRange;
    options.bins = 60;
    const amps::DifferentialReport report = amps::differential_spectrum(shape, sets, options);
    run.check(report.min_distance >= 1 - kChance, "no two samples on the " + name + " are nearer than r");
    plot.series.push_back({name, report.distances, report.radial_mean});
    double sum = 0, weight = 0;
    for (std::size_t k = 0; k < report.anisotropy.size(); ++k) {
      sum += report.anisotropy[k] * report.pairs[k];
      weight += report.pairs[k];
    }
    rows.push_back({name, format("%.6f r", report.min_distance), format("%.2f dB", sum / weight)});
  }
  page.picture("figure_5_surfaces.png", render::draw(plot),
               "Differential-domain analysis of maximal sets: sphere and torus agree with the plane.");
  page.table({"surface", "least distance", "anisotropy (none: 0 dB)"}, rows, "paper");
}

inline void figure_5(Run& run, Page& page) {
  const SquareSets sets;
  const std::vector<Spectrum> all = all_spectra(sets);
  const Spectrum &brute = all[2], &maximal = all[3];
  page.heading("Figure 5: spectra");
  page.text(
      format("Ten sets each of about %.0f points on the unit square (r = %.2f), through a Hann window. The last column is the "
             "root mean square difference of the radial mean from that of brute-force darts (thrown until two million in a row "
             "find no room), in units of what chance alone would leave: maximal sets have about 1.",
             brute.report.mean_points, kSpectrumRadius));
  std::vector<std::vector<std::string>> rows;
  std::vector<std::pair<render::Image, std::string>> images;
  render::Plot mean{"Radial mean power", "frequency / sqrt(n)", "power (white noise: 1)", {}};
  render::Plot anisotropy{"Anisotropy", "frequency / sqrt(n)", "dB (no direction: -10)", {}};
  anisotropy.height = 400;
  anisotropy.y_min = -20;
  anisotropy.y_max = 10;
  for (const Spectrum& s : all) {
    const amps::SpectrumReport& r = s.report;
    rows.push_back({s.name, format("%.0f", r.mean_points), format("%.2f", r.effective_nyquist), format("%.2f", r.oscillation),
                    format("%.2f", s.peak()), format("%.1f dB", s.anisotropy()),
                    &s == &brute ? std::string(kNotKnown) : format("%.1f", s.off(brute))});
    images.emplace_back(power_image(r), s.name);
    render::Series curve{s.name, {}, r.radial_mean}, directions{s.name, {}, r.anisotropy};
    for (const Index ring : r.rings) curve.x.push_back(ring / std::sqrt(r.mean_points));
    directions.x = curve.x;
    mean.series.push_back(curve);
    anisotropy.series.push_back(directions);
  }
  page.table({"sets", "points", "effective Nyquist", "oscillation", "peak", "anisotropy", "off brute force"}, rows, "paper");
  page.picture("figure_5_power.png", render::sheet(images, 3), "Power by frequency: black 0, grey 1, white 2 and more.");
  page.picture("figure_5_mean.png", render::draw(mean), "Radial mean power.");
  page.picture("figure_5_anisotropy.png", render::draw(anisotropy), "Anisotropy: ten sets without a direction have -10 dB.");
  choice_of_bounds(sets, maximal, brute, page);
  surface_spectra(sets.square, run, page);
}

}  // namespace reproduce
