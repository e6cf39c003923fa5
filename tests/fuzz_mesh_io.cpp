// Fuzz target: damaged files of every format either are read to something whose indices are in range, and that is read back
// from what it is written to, or are refused.
//   libFuzzer: clang++ -DAMPS_LIBFUZZER -fsanitize=fuzzer,address,undefined tests/fuzz_mesh_io.cpp and the library's sources
//   CTest:     fuzz_mesh_io [SECONDS [FORMAT [SEED]]] mutates valid files, 60 seconds by default, of one format or of all
#include "amps/mesh_io.h"
#include "amps/shapes.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

using amps::Index;
using amps::Mesh;
using amps::MeshFormat;
using amps::SampleFormat;

namespace {

const char* const kNames[] = {"obj", "off", "ply", "stl", "marks", "xyzr", "samples.ply", "csv"};
constexpr std::size_t kMarks = 4;  // those before it are meshes, those behind samples
constexpr std::size_t kNumFormats = std::size(kNames);

void require(bool good, const char* what) {
  if (good) return;
  std::fprintf(stderr, "\nfuzz_mesh_io: %s\n", what);
  std::abort();
}

template <class Table>
bool same_rows(const Table& a, const Table& b) {
  bool same = a.rows() == b.rows();
  for (std::ptrdiff_t i = 0; same && i < a.rows(); ++i) {
    for (int k = 0; k < 3; ++k) same = same && a(i, k) == b(i, k);
  }
  return same;
}

void read_a_mesh(const std::string& text, MeshFormat format) {
  const Mesh mesh = amps::parse_mesh(text, format);
  for (Index f = 0; f < static_cast<Index>(mesh.triangles.rows()); ++f) {
    for (int k = 0; k < 3; ++k) {
      require(mesh.triangles(f, k) >= 0 && mesh.triangles(f, k) < mesh.vertices.rows(), "an index out of range");
    }
  }
  require(mesh.polygons.empty() || mesh.polygons.size() == static_cast<std::size_t>(mesh.triangles.rows()),
          "polygons of other triangles");
  require(amps::check(mesh).non_finite_vertices == 0, "a vertex that is not finite");
  if (format == MeshFormat::kStl) return;
  const Mesh back = amps::parse_mesh(amps::format_mesh(mesh, format), format);
  require(same_rows(mesh.vertices, back.vertices) && same_rows(mesh.triangles, back.triangles), "another mesh is read back");
}

void read_marks(const std::string& text) {
  const amps::MeshMarks marks = amps::parse_mesh_marks(text, MeshFormat::kObj);
  require(marks.edges.size() == marks.edge_lines.size() && marks.vertices.size() == marks.vertex_lines.size(),
          "lines of marks");
  for (const auto& edge : marks.edges) require(std::min(edge[0], edge[1]) >= 0, "an edge out of range");
  for (const Index vertex : marks.vertices) require(vertex >= 0, "a point out of range");
}

void read_a_sample_set(const std::string& text, SampleFormat format) {
  const amps::SampleSet samples = amps::parse_samples(text, format);
  require(samples.size() > 0 && samples.radii.size() == static_cast<std::size_t>(samples.size()), "radii of other samples");
  for (const double radius : samples.radii) require(radius > 0, "a radius that is not above 0");
  const amps::SampleSet back = amps::parse_samples(amps::format_samples(samples, format), format);
  require(same_rows(samples.positions, back.positions) && samples.radii == back.radii && samples.facets == back.facets,
          "other samples are read back");
}

/// False if it is refused. The first byte is the number of the format.
bool is_read(const std::string& file) {
  constexpr MeshFormat kMeshes[] = {MeshFormat::kObj, MeshFormat::kOff, MeshFormat::kPly, MeshFormat::kStl};
  constexpr SampleFormat kSamples[] = {SampleFormat::kXyzr, SampleFormat::kPly, SampleFormat::kCsv};
  const std::string text = file.substr(1);
  const std::size_t format = static_cast<unsigned char>(file[0]) % kNumFormats;
  try {
    if (format < kMarks) {
      read_a_mesh(text, kMeshes[format]);
    } else if (format == kMarks) {
      read_marks(text);
    } else {
      read_a_sample_set(text, kSamples[format - kMarks - 1]);
    }
  } catch (const amps::Error& error) {
    require(error.code() == amps::ErrorCode::kFileFormat || error.code() == amps::ErrorCode::kTooLarge, error.what());
    return false;
  }
  return true;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size > 0) is_read(std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}

#ifndef AMPS_LIBFUZZER
namespace {

/// Good files: the number of a format, and what is in it.
std::vector<std::pair<std::size_t, std::string>> good_files() {
  const Mesh cube = amps::make_cube(1);
  amps::MeshWriteOptions ascii, marked;
  ascii.ascii_ply = true;
  marked.edges = {{0, 1}, {1, 2}};
  marked.vertices = {3};
  marked.labels.assign(static_cast<std::size_t>(cube.triangles.rows()), 7);
  const std::string points = "0 0 0\n4 0 0\n4 4 0\n0 4 0\n1 1 0\n1 3 0\n3 3 0\n3 1 0\n";
  std::string colored = std::string("OFF BINARY\n\0\0\0\3\0\0\0\1\0\0\0\0", 23) + std::string(36, '\0');
  colored += std::string("\0\0\0\3\0\0\0\0\0\0\0\1\0\0\0\2", 16);
  const std::string lines = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nl 1 2 3 \\\n -1\np 2 3\nl 1\n";
  amps::SampleSet samples;
  samples.positions = cube.vertices;
  const auto n = static_cast<std::size_t>(cube.vertices.rows());
  samples.radii.assign(n, 0.25);
  amps::SampleSet placed = samples;
  placed.facets.assign(n, 2);
  placed.barycentrics = cube.vertices;
  placed.dimensions.assign(n, 1);
  placed.curves.assign(n, 3);
  placed.parameters.assign(n, 0.5);
  std::vector<std::pair<std::size_t, std::string>> files = {
      {0, amps::format_mesh(cube, MeshFormat::kObj, marked)},
      {0, "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nv 1 1 0\nv 1 3 0\nf 1 2 3 4 1 5 6/1/1 5//1\nf -1 -2 -3 -5 -4\n"},
      {1, amps::format_mesh(cube, MeshFormat::kOff)},
      {1, "OFF\n8 2 0\n" + points + "10 0 1 2 3 0 4 5 6 7 4\n5 0 1 6 3 2 255 0 0\n"},
      {1, "STCNOFF 3 1 0\n0 0 0 0 0 1 1 1 1 1 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"},
      {1, std::string("OFF BINARY\n\0\0\0\1\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0", 35)},
      {1, colored},
      {1, colored + std::string("\0\0\0\0", 4)},
      {2, amps::format_mesh(cube, MeshFormat::kPly, marked)},
      {2, amps::format_mesh(cube, MeshFormat::kPly, ascii)},
      {2,
       "ply\nformat ascii 1.0\ncomment c\nx\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement "
       "tristrips 1\nproperty list int int vertex_indices\nelement face 1\nproperty list uchar int "
       "vertex_indices\nend_header\n" +
           points + "6 0 1 2 -1 3 4\n10 0 1 2 3 0 4 5 6 7 4\n"},
      {2, std::string("ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty short x\nproperty char y\nproperty uchar "
                      "z\nelement face 1\nproperty list uchar ushort vertex_index\nproperty int a\nend_header\n") +
              std::string("\0\0\0\0\0\1\0\0\0\0\1\0\3\0\0\0\1\0\2\0\0\0\0", 23)},
      {3, amps::format_mesh(cube, MeshFormat::kStl)},
      {3, "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n"},
      {kMarks, amps::format_mesh(cube, MeshFormat::kObj, marked)},
      {kMarks, lines}};
  for (const amps::SampleSet& set : {samples, placed}) {
    std::size_t format = kMarks;
    for (const SampleFormat of : {SampleFormat::kXyzr, SampleFormat::kPly, SampleFormat::kCsv}) {
      files.emplace_back(++format, amps::format_samples(set, of));
    }
  }
  return files;
}

}  // namespace

int main(int argc, char** argv) {
  const double seconds = argc > 1 ? std::atof(argv[1]) : 60;
  const std::string only = argc > 2 ? argv[2] : "all";
  std::uint64_t seed = argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 1;
  std::vector<std::string> files;
  for (const auto& [format, content] : good_files()) {
    if (only == "all" || only == kNames[format] || (only == "samples" && format > kMarks)) {
      files.push_back(static_cast<char>(format) + content);
    }
  }
  require(!files.empty(), "no such format: obj, off, ply, stl, marks, xyzr, samples.ply, csv, samples (all three), all");
  for (const std::string& file : files) require(is_read(file), "a good file is refused");
  const auto start = std::chrono::steady_clock::now();
  const auto elapsed = [start] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); };
  std::uint64_t done = 0;
  do {
    amps::Rng rng(seed);
    std::string file = files[rng.below(files.size())];
    for (std::uint64_t edits = rng.below(8); edits > 0; --edits) {
      const std::size_t at = 1 + rng.below(file.size()), length = rng.below(std::min<std::size_t>(file.size() - at, 20) + 1);
      const std::uint64_t what = rng.below(4);
      if (what == 0 && at < file.size()) file[at] = static_cast<char>(rng.below(256));
      if (what == 1) file.erase(at, length);
      if (what == 2) file.insert(at, file.substr(at, length));
      if (what == 3 && at < file.size()) file[at] = "0123456789-.e \n"[rng.below(15)];
    }
    if (done % 65536 == 0) {
      std::printf("\rfuzz_mesh_io %s: seed %llu", only.c_str(), static_cast<unsigned long long>(seed));
      std::fflush(stdout);
    }
    is_read(file);
    ++seed;
    ++done;
  } while (elapsed() < seconds);
  std::printf("\nfuzz_mesh_io: %llu files in %.0f s\n", static_cast<unsigned long long>(done), elapsed());
  return 0;
}
#endif
