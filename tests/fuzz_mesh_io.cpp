// Fuzz target: damaged mesh files of every format either are read to a mesh whose indices are in range, or are refused.
//   libFuzzer: clang++ -DAMPS_LIBFUZZER -fsanitize=fuzzer,address,undefined tests/fuzz_mesh_io.cpp and the library's sources
//   CTest:     fuzz_mesh_io [SECONDS [SEED]] mutates valid files, 60 seconds by default
#include "amps/mesh_io.h"
#include "amps/shapes.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

using amps::Index;
using amps::MeshFormat;

namespace {

void require(bool good, const char* what) {
  if (good) return;
  std::fprintf(stderr, "\nfuzz_mesh_io: %s\n", what);
  std::abort();
}

}  // namespace

/// The first byte names the format.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const MeshFormat formats[] = {MeshFormat::kObj, MeshFormat::kOff, MeshFormat::kPly, MeshFormat::kStl};
  const std::string text(reinterpret_cast<const char*>(data) + 1, size - 1);
  try {
    const amps::Mesh mesh = amps::parse_mesh(text, formats[data[0] % 4]);
    for (Index f = 0; f < static_cast<Index>(mesh.triangles.rows()); ++f) {
      for (int k = 0; k < 3; ++k) {
        require(mesh.triangles(f, k) >= 0 && mesh.triangles(f, k) < mesh.vertices.rows(), "an index out of range");
      }
    }
    require(mesh.polygons.empty() || mesh.polygons.size() == static_cast<std::size_t>(mesh.triangles.rows()),
            "polygons of other triangles");
    require(amps::check(mesh).non_finite_vertices == 0, "a vertex that is not finite");
  } catch (const amps::Error& error) {
    require(error.code() == amps::ErrorCode::kFileFormat || error.code() == amps::ErrorCode::kTooLarge, error.what());
  }
  return 0;
}

#ifndef AMPS_LIBFUZZER
int main(int argc, char** argv) {
  const double seconds = argc > 1 ? std::atof(argv[1]) : 60;
  std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  const amps::Mesh cube = amps::make_cube(1);
  amps::MeshWriteOptions ascii;
  ascii.ascii_ply = true;
  const std::string points = "0 0 0\n4 0 0\n4 4 0\n0 4 0\n1 1 0\n1 3 0\n3 3 0\n3 1 0\n";
  const std::vector<std::string> files = {
      '\0' + amps::format_mesh(cube, MeshFormat::kObj),
      std::string(1, '\0') +
          "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nv 1 1 0\nv 1 3 0\nf 1 2 3 4 1 5 6/1/1 5//1\nf -1 -2 -3 -5 -4\n",
      '\1' + amps::format_mesh(cube, MeshFormat::kOff),
      "\1OFF\n8 2 0\n" + points + "10 0 1 2 3 0 4 5 6 7 4\n5 0 1 6 3 2 255 0 0\n",
      std::string("\1OFF BINARY\n\0\0\0\1\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0", 36),
      '\2' + amps::format_mesh(cube, MeshFormat::kPly),
      '\2' + amps::format_mesh(cube, MeshFormat::kPly, ascii),
      "\2ply\nformat ascii 1.0\ncomment c\nx\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement "
      "tristrips 1\nproperty list int int vertex_indices\nelement face 1\nproperty list uchar int "
      "vertex_indices\nend_header\n" +
          points + "6 0 1 2 -1 3 4\n10 0 1 2 3 0 4 5 6 7 4\n",
      '\3' + amps::format_mesh(cube, MeshFormat::kStl),
      "\3solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n"};
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
      std::printf("\rfuzz_mesh_io: seed %llu", static_cast<unsigned long long>(seed));
      std::fflush(stdout);
    }
    LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(file.data()), file.size());
    ++seed;
    ++done;
  } while (elapsed() < seconds);
  std::printf("\nfuzz_mesh_io: %llu files in %.0f s\n", static_cast<unsigned long long>(done), elapsed());
  return 0;
}
#endif
