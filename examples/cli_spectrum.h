// cli_spectrum.h: amps spectrum — how random, how even and how isotropic sample sets are, as a table, curves and a picture.
#pragma once

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_commands.h"
#include "cli_files.h"
#include "cli_output.h"
#include "cli_watch.h"
#include "render_plot.h"
#include "render_png.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <sstream>
#include <string>
#include <vector>

/// The square in the middle of a mesh that is a rectangle in a plane of constant z, along the axes, as the options of its
/// spectrum; side 0 for any other mesh.
inline amps::SpectrumOptions square_of(const amps::Mesh& mesh, const amps::Execution& execution) {
  constexpr double kFlat = 1e-9;  // of its size; files in single precision are not exact, but this flat
  const amps::Box box = amps::bounding_box(mesh, execution);
  const double width = box.max.x() - box.min.x(), height = box.max.y() - box.min.y();
  const bool flat = box.max.z() - box.min.z() <= kFlat * box.diagonal();
  const bool filled = std::abs(amps::total_area(mesh, execution) - width * height) <= kFlat * width * height;
  amps::SpectrumOptions options;
  options.side = flat && filled ? std::min(width, height) : 0;
  options.x = box.min.x() + (width - options.side) / 2;
  options.y = box.min.y() + (height - options.side) / 2;
  return options;
}

/// Numbers as a picture, the last row on top: 0 black, 1 grey, 2 and more white. Small ones are enlarged.
inline render::Image picture_of(const std::vector<double>& values, amps::Index side) {
  constexpr int kLeastSize = 512;
  constexpr double kWhite = 2;
  const int scale = (kLeastSize - 1) / side + 1;
  render::Image image;
  image.width = image.height = side * scale;
  for (int y = image.height - 1; y >= 0; --y) {
    for (int x = 0; x < image.width; ++x) {
      const double value =
          values[static_cast<std::size_t>(y / scale) * static_cast<std::size_t>(side) + static_cast<std::size_t>(x / scale)];
      image.rgb.insert(image.rgb.end(), 3, static_cast<std::uint8_t>(std::lround(255 * std::min(1.0, value / kWhite))));
    }
  }
  return image;
}

inline std::size_t place_of_greatest(const std::vector<double>& values) {
  return static_cast<std::size_t>(std::max_element(values.begin(), values.end()) - values.begin());
}

/// The mean of a curve from a place on, with a weight for each.
template <class Weight>
double mean_from(const std::vector<double>& values, std::size_t from, const Weight& weight) {
  double sum = 0, all = 0;
  for (std::size_t k = from; k < values.size(); ++k) {
    sum += weight(k) * values[k];
    all += weight(k);
  }
  return all > 0 ? sum / all : 0;
}

/// What was measured: one of the two.
struct MeasuredSpectrum {
  bool in_plane = false;
  amps::SpectrumReport plane;
  amps::DifferentialReport surface;
};

/// The options of `amps spectrum`, as far as they can be checked before there is a mesh.
struct SpectrumRequest {
  amps::SquareBorder border = amps::SquareBorder::kWindow;
  amps::Index max_frequency = 0;
  double range = 0;
};

inline SpectrumRequest spectrum_request(const Arguments& arguments) {
  constexpr std::uint64_t kLeastFrequency = 4, kMostFrequency = 8192;  // of the library
  SpectrumRequest request;
  const std::string border = arguments.text("--border", "window");
  if (border != "window" && border != "periodic") throw arguments.error("--border " + border + ": name window or periodic");
  if (border == "periodic") request.border = amps::SquareBorder::kPeriodic;
  request.max_frequency = static_cast<amps::Index>(arguments.whole("--max-frequency", 0, kLeastFrequency, kMostFrequency));
  request.range = arguments.positive("--range");
  return request;
}

/// Reads the mesh and all sets, and measures them in the plane where that can be, else on the surface.
inline MeasuredSpectrum measure_spectrum(const Arguments& arguments, const Files& files, const SpectrumRequest& request,
                                         const Watch& watch) {
  constexpr double kMeshRead = 0.05, kAllRead = 0.2, kMeasured = 0.95;
  const amps::Mesh mesh = files.usable_mesh(arguments.operand(0), watch.part(0, kMeshRead));
  std::vector<amps::SampleSet> sets;
  const auto num_sets = static_cast<double>(arguments.operands() - 1);
  for (std::size_t i = 1; i < arguments.operands(); ++i) {
    const auto before = [&](std::size_t set) {
      return kMeshRead + (kAllRead - kMeshRead) * static_cast<double>(set) / num_sets;
    };
    sets.push_back(files.samples(arguments.operand(i), watch.part(before(i - 1), before(i))));
  }
  amps::SpectrumOptions plane = square_of(mesh, watch.part(kAllRead, kAllRead));
  MeasuredSpectrum measured;
  measured.in_plane = plane.side > 0 && !arguments.has("--differences");
  for (const char* name : {"--border", "--max-frequency"}) {
    if (arguments.has(name) && !measured.in_plane) {
      throw arguments.error(std::string(name) + " is for periodograms, and no periodogram is taken here; leave it out");
    }
  }
  if (measured.in_plane) {
    if (arguments.has("--range")) throw arguments.error("--range is for differences: say --differences as well");
    plane.border = request.border;
    plane.max_frequency = request.max_frequency;
    plane.execution = watch.part(kAllRead, kMeasured);
    measured.plane = amps::spectrum(amps::positions_of(sets), plane);
  } else {
    amps::DifferentialOptions surface;
    if (request.range > 0) surface.range = request.range;
    surface.execution = watch.part(kAllRead, kMeasured);
    measured.surface = amps::differential_spectrum(mesh, sets, surface);
  }
  return measured;
}

/// The power by frequency, or the density of differences. The power of the mean density is left out: it would outshine all.
inline render::Image picture_of(const MeasuredSpectrum& measured) {
  if (!measured.in_plane) return picture_of(measured.surface.image, measured.surface.image_size);
  const amps::SpectrumReport& report = measured.plane;
  std::vector<double> power = report.power;
  const amps::Index m = report.max_frequency, side = 2 * m + 1, hidden = report.rings.front() - 1;
  for (amps::Index v = m - hidden; v <= m + hidden; ++v) {
    for (amps::Index u = m - hidden; u <= m + hidden; ++u) power[static_cast<std::size_t>(v * side + u)] = 0;
  }
  return picture_of(power, side);
}

/// Radial mean and anisotropy as curves, one above the other.
inline render::Image plot_of(const MeasuredSpectrum& measured) {
  const amps::SpectrumReport& plane = measured.plane;
  const amps::DifferentialReport& surface = measured.surface;
  render::Series mean, directions;
  if (measured.in_plane) {
    for (const amps::Index ring : plane.rings) mean.x.push_back(ring / std::sqrt(plane.mean_points));
  } else {
    mean.x = surface.distances;
  }
  directions.x = mean.x;
  mean.y = measured.in_plane ? plane.radial_mean : surface.radial_mean;
  directions.y = measured.in_plane ? plane.anisotropy : surface.anisotropy;
  const char* const across = measured.in_plane ? "frequency / sqrt(n)" : "distance / r";
  render::Plot upper{
      "Radial mean", across, measured.in_plane ? "power (white noise: 1)" : "pair correlation (no order: 1)", {mean}};
  render::Plot lower{"Anisotropy", across, "dB", {directions}};
  lower.height = 360;
  return render::sheet({{render::draw(upper), ""}, {render::draw(lower), ""}}, 1);
}

inline std::string csv_of(const MeasuredSpectrum& measured) {
  std::ostringstream text;
  if (measured.in_plane) {
    amps::write_spectrum(text, measured.plane);
  } else {
    amps::write_spectrum(text, measured.surface);
  }
  return text.str();
}

/// In dB, over all rings but the first, which have so few frequencies that chance decides.
inline double mean_anisotropy(const amps::SpectrumReport& report) {
  constexpr std::size_t kFirstRings = 8;
  return mean_from(report.anisotropy, std::min(kFirstRings, report.rings.size() - 1), [](std::size_t) { return 1.0; });
}
inline double mean_anisotropy(const amps::DifferentialReport& report) {
  return mean_from(report.anisotropy, 0, [&](std::size_t k) { return report.pairs[k]; });
}
/// Where samples should not know of each other any more: over the last fifth of all distances.
inline double far_correlation(const amps::DifferentialReport& report) {
  return mean_from(report.radial_mean, report.radial_mean.size() * 4 / 5, [](std::size_t) { return 1.0; });
}

inline void add_spectrum(Json& json, const MeasuredSpectrum& measured) {
  if (measured.in_plane) {
    const amps::SpectrumReport& report = measured.plane;
    const std::size_t peak = place_of_greatest(report.radial_mean);
    json.add("kind", "periodogram")
        .add("sets", report.sets)
        .add("mean_points", report.mean_points)
        .add("max_frequency", report.max_frequency)
        .add("effective_nyquist", report.effective_nyquist)
        .add("oscillation", report.oscillation)
        .add("peak_power", report.radial_mean[peak])
        .add("peak_frequency", report.rings[peak])
        .add("mean_anisotropy_db", mean_anisotropy(report));
  } else {
    const amps::DifferentialReport& report = measured.surface;
    const std::size_t peak = place_of_greatest(report.radial_mean);
    json.add("kind", "differences")
        .add("sets", report.sets)
        .add("mean_samples", report.mean_samples)
        .add("range", report.range)
        .add("pairs", std::accumulate(report.pairs.begin(), report.pairs.end(), 0.0))
        .add("min_distance", report.min_distance)
        .add("peak_correlation", report.radial_mean[peak])
        .add("peak_distance", report.distances[peak])
        .add("far_correlation", far_correlation(report))
        .add("mean_anisotropy_db", mean_anisotropy(report));
  }
}

inline void print_spectrum(const Table& table, const MeasuredSpectrum& measured, const SpectrumRequest& request) {
  if (measured.in_plane) {
    const amps::SpectrumReport& report = measured.plane;
    const std::size_t peak = place_of_greatest(report.radial_mean);
    table.row("measured", request.border == amps::SquareBorder::kWindow ? "power in a square, seen through a window"
                                                                        : "power in a square that repeats itself");
    table.row("sets", number(report.sets));
    table.row("points", number(report.mean_points) + "   (in the square, mean)");
    table.row("effective Nyquist", format("%.4g   (square grid: 1)", report.effective_nyquist));
    table.row("oscillation", format("%.4g", report.oscillation));
    table.row("greatest radial mean", format("%.4g   (at %.4g sqrt(n) periods a side)", report.radial_mean[peak],
                                             report.rings[peak] / std::sqrt(report.mean_points)));
    table.row("mean anisotropy", format("%.4g dB   (no direction: %.4g dB)", mean_anisotropy(report),
                                        -10 * std::log10(static_cast<double>(report.sets))));
  } else {
    const amps::DifferentialReport& report = measured.surface;
    const std::size_t peak = place_of_greatest(report.radial_mean);
    table.row("measured", format("differences on the surface, up to %.4g r", report.range));
    table.row("sets", number(report.sets));
    table.row("samples", number(report.mean_samples) + "   (mean)");
    table.row("least distance", format("%.6g r", report.min_distance));
    table.row("greatest correlation", format("%.4g   (at %.4g r)", report.radial_mean[peak], report.distances[peak]));
    table.row("far correlation", format("%.4g   (no order: 1)", far_correlation(report)));
    table.row("mean anisotropy", format("%.4g dB   (no direction: 0 dB)", mean_anisotropy(report)));
  }
}

inline int run_spectrum(const Arguments& arguments) {
  const SpectrumRequest request = spectrum_request(arguments);
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  for (std::size_t i = 1; i < arguments.operands(); ++i) files.reads("SAMPLES", arguments.operand(i), Holds::kSamples);
  files.writes("--csv", Holds::kOther);
  files.writes("--png", Holds::kPicture);
  files.writes("--plot", Holds::kPicture);
  files.writes("--json", Holds::kOther);
  files.look();
  Watch watch(arguments.quiet(), threads_of(arguments));
  const MeasuredSpectrum measured = measure_spectrum(arguments, files, request, watch);
  std::string png, plot;
  if (arguments.has("--png")) png = render::encode_png(picture_of(measured), watch.part(kWorked, 0.99));
  if (arguments.has("--plot")) plot = render::encode_png(plot_of(measured), watch.part(0.99, 1));

  if (arguments.has("--csv")) files.write(arguments.text("--csv"), csv_of(measured));
  if (arguments.has("--png")) files.write(arguments.text("--png"), png);
  if (arguments.has("--plot")) files.write(arguments.text("--plot"), plot);
  Json json = begin_json("spectrum");
  add_spectrum(json, measured);
  files.write(json);
  watch.finish();
  print_spectrum(files.table(), measured, request);
  return kExitDone;
}
