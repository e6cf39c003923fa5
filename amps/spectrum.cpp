#define AMPS_OWN_SOURCE
#include "amps/spectrum.h"

#include "amps/portable_math.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <locale>
#include <ostream>
#include <sstream>
#include <string>

namespace amps {
namespace {

constexpr Index kLeastMaxFrequency = 4, kGreatestMaxFrequency = 8192;
constexpr double kFrequenciesPerRoot = 4;  // of the default
/// Heck et al.: below, a disk of frequencies is free of noise; above, the rise of the spectrum is over.
constexpr double kQuietPower = 0.1, kRisenPower = 0.5;
/// The same: where the first peak begins; how far oscillation is looked at, in √n; its unit.
constexpr double kPeakPower = 0.98, kOscillationRange = 5, kOscillationScale = 10;

/// Points whose phases are kept at a time, and frequencies u that a piece of the loop takes: tables of one stay in cache, and
/// making them takes a tenth of the time.
constexpr std::size_t kPointsPerBlock = 64, kRowsPerStrip = 8;
/// Frequencies whose sums are in registers at a time.
constexpr std::size_t kLanes = 4;

/// One set, in turns of the square; with weights.
struct SpectrumSet {
  std::vector<double> x, y, weight;
  double power_of_noise = 0;  // Σ weight²
};

void require_spectrum_options(const SpectrumOptions& options) {
  const auto refuse = [](const std::string& what) {
    throw Error(ErrorCode::kInvalidArgument, "amps: SpectrumOptions::" + what);
  };
  if (!(options.side > 0) || !std::isfinite(options.side)) refuse("side must be positive and finite");
  if (!std::isfinite(options.x) || !std::isfinite(options.y)) refuse("x and y must be finite");
  if (options.max_frequency != 0 &&
      (options.max_frequency < kLeastMaxFrequency || options.max_frequency > kGreatestMaxFrequency)) {
    refuse("max_frequency must be 0, or from " + std::to_string(kLeastMaxFrequency) + " to " +
           std::to_string(kGreatestMaxFrequency));
  }
}

SpectrumSet spectrum_set(const PointsView& points, std::size_t number, const SpectrumOptions& options) {
  SpectrumSet set;
  const auto refuse = [&](const std::string& what) {
    throw Error(ErrorCode::kInvalidArgument, "amps: point set " + std::to_string(number) + ": " + what);
  };
  const bool periodic = options.border == SquareBorder::kPeriodic;
  for (std::ptrdiff_t i = 0; i < points.rows(); ++i) {
    const double x = (points(i, 0) - options.x) / options.side, y = (points(i, 1) - options.y) / options.side;
    if (!std::isfinite(x) || !std::isfinite(y)) refuse("point " + std::to_string(i) + " is not finite");
    const bool inside = x >= 0 && x <= 1 && y >= 0 && y <= 1;
    if (!inside && periodic) {
      refuse("point " + std::to_string(i) +
             " is outside the square; give its square in the options, or see it through a window");
    }
    if (!inside) continue;
    set.x.push_back(x);
    set.y.push_back(y);
    const double weight = periodic ? 1 : (1 - detail::portable_phase(x).cosine) * (1 - detail::portable_phase(y).cosine);
    set.weight.push_back(weight);
    set.power_of_noise += weight * weight;
  }
  if (!(set.power_of_noise > 0)) refuse("no point is in the square; give the square of the set in the options");
  return set;
}

/// The phases of a block of points at all frequencies 0, …, m, frequency by frequency: cos and sin of 2πvy.
class SpectrumTable {
 public:
  explicit SpectrumTable(Index m) : cosine_((detail::slot(m) + 1) * kPointsPerBlock), sine_(cosine_.size()) {}

  /// By the recurrence exp(i(v+1)φ) = exp(ivφ)·exp(iφ), each step off by less than 3 units of rounding: 4e-16. Points beyond
  /// the set have whatever was there before; their weight is 0.
  void fill(const double* y, std::size_t count) {
    double c1[kPointsPerBlock] = {}, s1[kPointsPerBlock] = {};
    for (std::size_t j = 0; j < count; ++j) {
      const detail::Phase phase = detail::portable_phase(y[j]);
      c1[j] = phase.cosine;
      s1[j] = phase.sine;
    }
    std::fill_n(cosine_.begin(), kPointsPerBlock, 1.0);
    std::fill_n(sine_.begin(), kPointsPerBlock, 0.0);
    for (std::size_t at = kPointsPerBlock; at < cosine_.size(); at += kPointsPerBlock) {
      const double *c = &cosine_[at - kPointsPerBlock], *s = &sine_[at - kPointsPerBlock];
      double *next_c = &cosine_[at], *next_s = &sine_[at];
      for (std::size_t j = 0; j < kPointsPerBlock; ++j) {
        next_c[j] = c[j] * c1[j] - s[j] * s1[j];
        next_s[j] = s[j] * c1[j] + c[j] * s1[j];
      }
    }
  }
  const double* cosine(std::size_t v) const { return &cosine_[v * kPointsPerBlock]; }
  const double* sine(std::size_t v) const { return &sine_[v * kPointsPerBlock]; }

 private:
  std::vector<double> cosine_, sine_;
};

/// Sums over the points of products of cos or sin 2πux and cos or sin 2πvy, for some u and all v.
struct SpectrumSums {
  double cc[kLanes] = {}, ss[kLanes] = {}, cs[kLanes] = {}, sc[kLanes] = {};
};

/// Adds a block of points to the sums of kLanes frequencies u at one v. `cos_u` and `sin_u`: by point, then by u; with weights.
void add_block(const double* cos_u, const double* sin_u, const double* cos_v, const double* sin_v, SpectrumSums& sums) {
  SpectrumSums s = sums;
  for (std::size_t j = 0; j < kPointsPerBlock; ++j) {
    const double *const cu = cos_u + j * kRowsPerStrip, *const su = sin_u + j * kRowsPerStrip;
    for (std::size_t k = 0; k < kLanes; ++k) {
      s.cc[k] += cu[k] * cos_v[j];
      s.ss[k] += su[k] * sin_v[j];
      s.cs[k] += cu[k] * sin_v[j];
      s.sc[k] += su[k] * cos_v[j];
    }
  }
  sums = s;
}

/// Adds |F|² / power_of_noise to the power at u in [begin, end) of one quadrant's rows, and at −u: v ≥ 0 only.
void add_strip(const SpectrumSet& set, Index m, std::size_t begin, std::size_t end, detail::WorkCounter& work,
               std::vector<double>& power) {
  const std::size_t n = set.x.size(), columns = detail::slot(m) + 1;
  SpectrumTable table(m);
  constexpr std::size_t kGroups = kRowsPerStrip / kLanes;
  std::vector<SpectrumSums> sums(columns * kGroups);
  double cos_u[kPointsPerBlock * kRowsPerStrip], sin_u[kPointsPerBlock * kRowsPerStrip];
  for (std::size_t first = 0; first < n; first += kPointsPerBlock) {
    const std::size_t count = std::min(kPointsPerBlock, n - first);
    table.fill(&set.y[first], count);
    std::fill(std::begin(cos_u), std::end(cos_u), 0.0);
    std::fill(std::begin(sin_u), std::end(sin_u), 0.0);
    for (std::size_t j = 0; j < count; ++j) {
      const double x = set.x[first + j], weight = set.weight[first + j];
      for (std::size_t k = 0; k < kRowsPerStrip; ++k) {
        const detail::Phase phase = detail::portable_phase(static_cast<double>(begin + k) * x);
        cos_u[j * kRowsPerStrip + k] = weight * phase.cosine;
        sin_u[j * kRowsPerStrip + k] = weight * phase.sine;
      }
    }
    for (std::size_t v = 0; v < columns; ++v) {
      for (std::size_t g = 0; g < kGroups; ++g) {
        add_block(cos_u + g * kLanes, sin_u + g * kLanes, table.cosine(v), table.sine(v), sums[v * kGroups + g]);
      }
    }
    work.add(1);
  }
  const std::size_t width = 2 * detail::slot(m) + 1, middle = detail::slot(m);
  for (std::size_t v = 0; v < columns; ++v) {
    double* const row = &power[(middle + v) * width + middle];
    for (std::size_t u = begin; u < end; ++u) {
      const std::size_t k = u - begin;
      const SpectrumSums& s = sums[v * kGroups + k / kLanes];
      const double cc = s.cc[k % kLanes], ss = s.ss[k % kLanes], cs = s.cs[k % kLanes], sc = s.sc[k % kLanes];
      const double re = cc - ss, im = sc + cs, mirrored_re = cc + ss, mirrored_im = sc - cs;
      row[u] += (re * re + im * im) / set.power_of_noise;
      if (u > 0) *(row - u) += (mirrored_re * mirrored_re + mirrored_im * mirrored_im) / set.power_of_noise;
    }
  }
}

/// The mean over the sets; the half v < 0 from the other.
void finish_power(SpectrumReport& report) {
  const std::size_t size = report.power.size();
  for (std::size_t i = size / 2; i < size; ++i) {
    report.power[i] /= report.sets;
    report.power[size - 1 - i] = report.power[i];
  }
}

/// Visits one of f and −f, for all but 0.
template <class Visit>
void for_half_plane(const SpectrumReport& report, const Visit& visit) {
  const Index m = report.max_frequency;
  for (Index v = 0; v <= m; ++v) {
    for (Index u = v == 0 ? 1 : -m; u <= m; ++u) visit(u, v, report.at(u, v));
  }
}

void measure_rings(SpectrumReport& report, bool window) {
  const Index first = window ? 2 : 1;
  const auto n = detail::slot(report.max_frequency - first + 1);
  std::vector<double> squares(n, 0.0);
  report.frequencies.assign(n, 0);
  report.radial_mean.assign(n, 0.0);
  report.anisotropy.assign(n, 0.0);
  for (std::size_t k = 0; k < n; ++k) report.rings.push_back(first + static_cast<Index>(k));
  // Half a ring: |f|² is whole and (k + ½)² is not, so rounding decides nothing.
  const auto ring_of = [](Index u, Index v) {
    return static_cast<Index>(std::sqrt(static_cast<double>(u) * u + static_cast<double>(v) * v) + 0.5);
  };
  const auto counts = [&](Index u, Index v) {
    return ring_of(u, v) <= report.max_frequency && !(window && std::abs(u) <= 1 && v <= 1);
  };
  for_half_plane(report, [&](Index u, Index v, double p) {
    if (!counts(u, v)) return;
    const std::size_t k = detail::slot(ring_of(u, v) - first);
    ++report.frequencies[k];
    report.radial_mean[k] += p;
  });
  for (std::size_t k = 0; k < n; ++k) report.radial_mean[k] /= report.frequencies[k];
  for_half_plane(report, [&](Index u, Index v, double p) {
    if (!counts(u, v)) return;
    const std::size_t k = detail::slot(ring_of(u, v) - first);
    squares[k] += (p - report.radial_mean[k]) * (p - report.radial_mean[k]);
  });
  for (std::size_t k = 0; k < n; ++k) {
    const double mean = report.radial_mean[k], ratio = squares[k] / (report.frequencies[k] - 1) / (mean * mean);
    report.anisotropy[k] =
        ratio > 0 ? 10 * detail::portable_log(ratio) / detail::portable_log(10) : -std::numeric_limits<double>::infinity();
  }
}

double effective_nyquist_of(const SpectrumReport& report) {
  const double unit = std::sqrt(report.mean_points) / 2;
  std::vector<double> within;  // the mean over a disk, by ring
  double sum = 0, frequencies = 0;
  for (std::size_t k = 0; k < report.rings.size(); ++k) {
    sum += report.radial_mean[k] * report.frequencies[k];
    frequencies += report.frequencies[k];
    within.push_back(sum / frequencies);
  }
  std::size_t risen = 0;
  while (risen < within.size() && (report.rings[risen] < unit || within[risen] <= kRisenPower)) ++risen;
  if (risen == within.size()) return 0;
  std::size_t k = risen;
  while (k > 0 && within[k - 1] >= kQuietPower) --k;
  if (k == 0) return 0;
  // A disk ends half a frequency outside the middle of its last ring.
  const double step = (kQuietPower - within[k - 1]) / (within[k] - within[k - 1]);
  return (report.rings[k - 1] + 0.5 + step) / 2 / unit;
}

double oscillation_of(const SpectrumReport& report) {
  std::size_t first = 0;
  while (first < report.rings.size() && report.radial_mean[first] < kPeakPower) ++first;
  if (first == report.rings.size()) return 0;
  const double end = report.rings[first] + kOscillationRange * std::sqrt(report.mean_points);
  double sum = 0, area = 0;
  for (std::size_t k = first; k < report.rings.size() && report.rings[k] <= end; ++k) {
    const double off = report.radial_mean[k] - 1;
    sum += off * off * report.rings[k];
    area += report.rings[k];
  }
  return kOscillationScale * std::sqrt(sum / area);
}

/// Lines of numbers, whatever the locale.
std::ostringstream spectrum_text(const char* names) {
  constexpr int kDigits = 9;
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text.precision(kDigits);
  text << names << '\n';
  return text;
}

}  // namespace

double SpectrumReport::at(Index u, Index v) const {
  const std::size_t width = 2 * detail::slot(max_frequency) + 1;
  return power[detail::slot(v + max_frequency) * width + detail::slot(u + max_frequency)];
}

SpectrumReport spectrum(const std::vector<PointsView>& sets, const SpectrumOptions& options) {
  const Execution run = options.execution.start("measuring the spectrum");
  require_spectrum_options(options);
  if (sets.empty()) throw Error(ErrorCode::kInvalidArgument, "amps: no point set is given to take the spectrum of");
  std::vector<SpectrumSet> all;
  SpectrumReport report;
  std::size_t blocks = 0;
  for (std::size_t i = 0; i < sets.size(); ++i) {
    run.check();
    all.push_back(spectrum_set(sets[i], i, options));
    report.mean_points += static_cast<double>(all.back().x.size());
    blocks += (all.back().x.size() - 1) / kPointsPerBlock + 1;
  }
  report.sets = static_cast<Index>(sets.size());
  report.mean_points /= report.sets;
  report.max_frequency = options.max_frequency;
  if (report.max_frequency == 0) {
    const double wanted = std::ceil(kFrequenciesPerRoot * std::sqrt(report.mean_points));
    report.max_frequency = static_cast<Index>(std::min<double>(wanted, kGreatestMaxFrequency));
    report.max_frequency = std::max(report.max_frequency, kLeastMaxFrequency);
  }
  const std::size_t rows = detail::slot(report.max_frequency) + 1, width = 2 * rows - 1;
  detail::resize_watched(report.power, width * width, 0.0, run);
  detail::WorkCounter work(run.part(0, 1), blocks * ((rows - 1) / kRowsPerStrip + 1));
  for (const SpectrumSet& set : all) {
    parallel_for(rows, kRowsPerStrip, run, [&](std::size_t begin, std::size_t end) {
      add_strip(set, report.max_frequency, begin, end, work, report.power);
    });
  }
  finish_power(report);
  measure_rings(report, options.border == SquareBorder::kWindow);
  report.effective_nyquist = effective_nyquist_of(report);
  report.oscillation = oscillation_of(report);
  run.finish();
  return report;
}

std::vector<PointsView> positions_of(const std::vector<SampleSet>& sets) {
  std::vector<PointsView> views;
  for (const SampleSet& set : sets) views.emplace_back(set.positions);
  return views;
}

void write_spectrum(std::ostream& out, const SpectrumReport& report) {
  std::ostringstream text = spectrum_text("frequency,relative_frequency,radial_mean,anisotropy_db,frequencies");
  for (std::size_t k = 0; k < report.rings.size(); ++k) {
    text << report.rings[k] << ',' << report.rings[k] / std::sqrt(report.mean_points) << ',' << report.radial_mean[k] << ','
         << report.anisotropy[k] << ',' << report.frequencies[k] << '\n';
  }
  out << text.str();
}

void write_spectrum(std::ostream& out, const DifferentialReport& report) {
  std::ostringstream text = spectrum_text("distance,pair_correlation,anisotropy_db,pairs");
  for (std::size_t k = 0; k < report.distances.size(); ++k) {
    text << report.distances[k] << ',' << report.radial_mean[k] << ',' << report.anisotropy[k] << ',' << report.pairs[k]
         << '\n';
  }
  out << text.str();
}

}  // namespace amps
