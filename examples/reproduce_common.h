// reproduce_common.h: what the tables and figures of reproduce_paper.cpp share — models, seeds, sets.
#pragma once

#include "amps/amps.h"

#include <algorithm>
#include <cmath>
#include <chrono>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace reproduce {

namespace fs = std::filesystem;
using amps::Index;
using amps::Mesh;
using amps::SampleSet;
using amps::Vec3;

#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
inline std::string
format(const char* pattern, ...) {
  char buffer[1024];
  std::va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(buffer, sizeof buffer, pattern, arguments);
  va_end(arguments);
  return buffer;
}

inline double seconds_of(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// What a number was with each seed, as "median (least to greatest)".
class Values {
 public:
  void add(double value) { values_.push_back(value); }
  double median() const {
    std::vector<double> sorted = values_;
    std::sort(sorted.begin(), sorted.end());
    const std::size_t n = sorted.size();
    return n == 0 ? 0 : (sorted[(n - 1) / 2] + sorted[n / 2]) / 2;
  }
  std::string text(const char* pattern) const {
    const auto [low, high] = std::minmax_element(values_.begin(), values_.end());
    char m[64], a[64], b[64];
    print(m, pattern, median());
    print(a, pattern, *low);
    print(b, pattern, *high);
    return std::string(a) == b ? std::string(m) : std::string(m) + " (" + a + " to " + b + ")";
  }

 private:
#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral"
#endif
  static void print(char (&out)[64], const char* pattern, double value) { std::snprintf(out, sizeof out, pattern, value); }
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif
  std::vector<double> values_;
};

constexpr const char* kNotKnown = "\xE2\x80\x93";  // of the paper's numbers: not among those at hand

struct Run {
  fs::path data;
  std::uint64_t seeds = 5;
  std::vector<std::string> stand_ins;  ///< models that were missing
  std::vector<std::string> failures;   ///< laws that do not hold

  void check(bool holds, const std::string& law) {
    if (!holds) failures.push_back(law);
  }

  /// A model of the data directory, or what stands in for it.
  Mesh model(const std::string& name, const std::function<Mesh()>& stand_in) {
    const fs::path path = data / name;
    std::error_code ignored;
    if (!data.empty() && fs::is_regular_file(path, ignored)) return amps::read_mesh(path);
    const std::string said = name + " is missing; a shape made by amps stands in for it";
    if (std::find(stand_ins.begin(), stand_ins.end(), said) == stand_ins.end()) stand_ins.push_back(said);
    return stand_in();
  }
  Mesh bunny() {
    return model("bunny_100kf_closed.obj", [] { return amps::make_knot(); });
  }
  Mesh triceratops() {
    return model("triceratops.off", [] { return amps::make_torus(1.0, 0.4, 120, 48); });
  }
};

inline Mesh sphere_of_area(double area) {
  constexpr Index kFacets = 81920;
  Mesh mesh = amps::make_sphere(kFacets);
  const double factor = std::sqrt(area / amps::total_area(mesh));
  for (std::ptrdiff_t v = 0; v < mesh.vertices.rows(); ++v) mesh.vertices.row(v) *= factor;
  return mesh;
}

inline amps::SamplingOptions with_radius(double radius, std::uint64_t seed) {
  amps::SamplingOptions options;
  options.radius = radius;
  options.seed = seed;
  return options;
}

inline SampleSet optimized(const Mesh& mesh, const SampleSet& set, double min_angle, double max_angle, std::uint64_t seed,
                           const amps::SizingField& sizing = {}) {
  amps::OptimizeOptions options;
  options.min_angle = min_angle;
  options.max_angle = max_angle;
  options.seed = seed;
  options.sizing = sizing;
  return amps::optimize(mesh, set, options).samples;
}

/// Radii by local feature size for so many samples.
inline amps::SizingField feature_sizing(const Mesh& mesh, double samples) {
  return amps::for_count(amps::lfs_sizing(mesh).with_ratio(), samples);
}

}  // namespace reproduce
