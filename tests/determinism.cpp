// determinism.cpp: results of every part of amps on procedural models, each as a hash of its bits or its text. Built by
// determinism.sh with many tool chains: all must print the same. An argument is the number of threads.
#include "amps_single.h"

#include <array>
#include <cmath>
#include <cinttypes>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

namespace {

using amps::Index;
using amps::Mesh;
using amps::SampleSet;
using amps::Vec3;

/// FNV-1a of numbers and texts, in the order given; the same whatever the order of bytes and the size of indices.
class Hash {
 public:
  void add(std::uint64_t bits) {
    for (int k = 0; k < 64; k += 8) value_ = (value_ ^ ((bits >> k) & 0xff)) * 1099511628211u;
  }
  void add(double x) {
    std::uint64_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    add(bits);
  }
  void add(Index i) { add(static_cast<std::uint64_t>(static_cast<std::int64_t>(i))); }
  void add(const std::string& text) {
    for (const char c : text) add(static_cast<std::uint64_t>(static_cast<unsigned char>(c)));
  }
  template <class T, std::size_t N>
  void add(const std::array<T, N>& values) {
    for (const T& value : values) add(value);
  }
  template <class T>
  void add(const std::vector<T>& values) {
    for (const T& value : values) add(value);
  }
  template <class T, Index N>
  void add(const amps::Table<T, N>& table) {
    for (Index i = 0; i < table.rows(); ++i) {
      for (Index k = 0; k < N; ++k) add(table(i, k));
    }
  }
  void add(const Mesh& mesh) {
    add(mesh.vertices);
    add(mesh.triangles);
  }
  void add(const SampleSet& set) {
    add(set.positions);
    add(set.radii);
    add(set.facets);
    add(set.barycentrics);
  }
  std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 14695981039346656037u;
};

template <class... Values>
void print(const char* name, const Values&... values) {
  Hash hash;
  (hash.add(values), ...);
  std::printf("%-14s %016" PRIx64 "\n", name, hash.value());
  std::fflush(stdout);
}

template <class Report>
std::string text_of(const Report& report) {
  std::ostringstream text;
  text << report;
  return text.str();
}

/// A plate with a round end and a flat one, of corners, creases and smooth sides: what a machine part looks like. Points of the
/// arc by rational parametrisation, without sines.
Mesh make_part() {
  std::vector<std::array<double, 2>> outline = {{-1.5, -1}, {0, -1}};
  constexpr int kCuts = 16;
  for (int k = 1 - kCuts; k < kCuts; ++k) {
    const double t = static_cast<double>(k) / kCuts;
    outline.push_back({(1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)});
  }
  outline.push_back({0, 1});
  outline.push_back({-1.5, 1});
  const auto n = static_cast<Index>(outline.size());
  Mesh mesh;
  mesh.vertices.resize(2 * n + 2, 3);
  mesh.triangles.resize(4 * n, 3);
  for (Index side = 0; side < 2; ++side) {
    const double z = 0.5 * side;
    for (Index k = 0; k < n; ++k) {
      const auto& point = outline[static_cast<std::size_t>(k)];
      mesh.vertices.row(side * n + k) << point[0], point[1], z;
    }
    mesh.vertices.row(2 * n + side) << -0.25, 0, z;
  }
  for (Index k = 0; k < n; ++k) {
    const Index next = (k + 1) % n;
    mesh.triangles.row(4 * k) << 2 * n, next, k;
    mesh.triangles.row(4 * k + 1) << 2 * n + 1, n + k, n + next;
    mesh.triangles.row(4 * k + 2) << k, next, n + next;
    mesh.triangles.row(4 * k + 3) << k, n + next, n + k;
  }
  return mesh;
}

void print_texts(const Mesh& mesh, const SampleSet& samples) {
  amps::MeshWriteOptions ascii;
  ascii.ascii_ply = true;
  const std::string obj = format_mesh(mesh, amps::MeshFormat::kObj);
  print("obj", obj);
  print("off", format_mesh(mesh, amps::MeshFormat::kOff));
  print("ply", format_mesh(mesh, amps::MeshFormat::kPly));
  print("ply_text", format_mesh(mesh, amps::MeshFormat::kPly, ascii));
  print("stl", format_mesh(mesh, amps::MeshFormat::kStl));
  print("xyzr", format_samples(samples, amps::SampleFormat::kXyzr));
  print("csv", format_samples(samples, amps::SampleFormat::kCsv));
  print("sample_ply", format_samples(samples, amps::SampleFormat::kPly));
  print("read_back", amps::parse_mesh(obj, amps::MeshFormat::kObj));

  // Numbers of every size, written and read again; and numbers with more digits than a double has, at ties between doubles.
  Mesh numbers;
  numbers.vertices.resize(3000, 3);
  amps::Rng rng(1);
  for (Index v = 0; v < numbers.vertices.rows(); ++v) {
    for (Index k = 0; k < 3; ++k) {
      const int exponent = k == 0 ? static_cast<int>(rng.below(2000)) - 1000 : static_cast<int>(rng.below(100)) - 50;
      const double x = std::ldexp(2 * rng.uniform() - 1, exponent);
      numbers.vertices(v, k) = k == 2 ? std::floor(x) : x;
    }
  }
  const Vec3 special(0.1, 1e23, 5e-324), round(-0.0, 123456789012345680.0, 1e21), more(0x1p-1022, 1e-5, 1e5);
  numbers.vertices.row(0) = special.transpose();
  numbers.vertices.row(1) = round.transpose();
  numbers.vertices.row(2) = more.transpose();
  numbers.triangles.resize(1, 3);
  numbers.triangles.row(0) << 0, 1, 2;
  const std::string text = format_mesh(numbers, amps::MeshFormat::kOff);
  print("numbers", text);
  print("numbers_read", amps::parse_mesh(text, amps::MeshFormat::kOff));
  print("digits_read",
        amps::parse_values("9007199254740993 9007199254740993.0000000000000000000000000001 2.4703282292062328e-324 "
                           "1.7976931348623158e308 0.500000000000000166533453693773481063544750213623046875 1e-400"));
}

}  // namespace

int main(int argc, char** argv) try {
  amps::Execution execution;
  if (argc > 1) execution.threads = static_cast<unsigned>(std::atoi(argv[1]));

  const Mesh torus = amps::make_torus(), ellipsoid = amps::make_ellipsoid(2000, Vec3(2, 1, 0.8));
  amps::KnotOptions small_knot;
  small_knot.around = 12;
  print("shapes", torus, ellipsoid, amps::make_sphere(500), amps::make_knot(small_knot), amps::make_cube(3),
        amps::make_square(2));

  amps::SamplingOptions sampling;
  sampling.radius = 0.1;
  sampling.execution = execution;
  print("sample", sample(torus, sampling).samples);

  const amps::SizingField lfs = lfs_sizing(ellipsoid, {}, execution);
  sampling.radius = 0;
  sampling.sizing = for_count(lfs.with_ratio(), 1000);
  print("sample_lfs", sample(ellipsoid, sampling).samples);

  amps::RemeshOptions uniform;
  uniform.sampling.target_count = 1500;
  uniform.sampling.execution = execution;
  const amps::RemeshResult remeshed = remesh(torus, uniform);
  print("remesh", remeshed.mesh, remeshed.samples);
  print("reports", text_of(remeshed.report.quality), text_of(remeshed.report.output), text_of(remeshed.report.certificate),
        remeshed.report.quality.min_angle, remeshed.report.maximality.worst_coverage);

  amps::RemeshOptions varying = uniform;
  varying.sampling.target_count = 0;
  varying.sampling.sizing = for_count(lfs, 1000);
  const amps::RemeshResult by_lfs = remesh(ellipsoid, varying);
  print("remesh_lfs", by_lfs.mesh, by_lfs.samples);

  amps::CurvatureOptions curvature;
  curvature.max_error = 0.005;
  varying.sampling.sizing = curvature_sizing(ellipsoid, curvature, execution);
  print("curvature", remesh(ellipsoid, varying).mesh);

  amps::RemeshOptions tight = uniform;
  tight.optimization.min_angle = 42;
  tight.optimization.max_angle = 90;
  print("angles_42_90", remesh(torus, tight).mesh);

  const Mesh part = make_part();
  amps::RemeshOptions curves = uniform;
  curves.sampling.target_count = 1000;
  const amps::RemeshResult of_part = remesh(part, curves);
  print("curves", of_part.mesh, of_part.samples, of_part.curve_edges, of_part.patches);

  curves.max_error = 0.005;
  const amps::RemeshResult within_error = remesh(part, curves);
  print("max_error", within_error.mesh, within_error.report.hausdorff_bound);

  amps::FitOptions fit;
  for (const amps::Fit kind : {amps::Fit::kNormal, amps::Fit::kFree}) {
    fit.fit = kind;
    fit.execution = execution;
    print(kind == amps::Fit::kNormal ? "fit_normal" : "fit_free", fit_vertices(torus, remeshed.mesh, fit));
  }

  const amps::DistanceReport distance = surface_distance(torus, remeshed.mesh);
  print("distance", distance.hausdorff(), distance.hausdorff_lower(), distance.rms(), distance.mean(), text_of(distance));
  const auto nearest = amps::SurfaceTree(ellipsoid).nearest(Vec3(0.3, -1.7, 0.2));
  print("nearest", nearest.distance, nearest.point.facet);

  print_texts(remeshed.mesh, remeshed.samples);
  return 0;
} catch (const std::exception& error) {
  std::printf("failed: %s\n", error.what());
  return 2;
}
