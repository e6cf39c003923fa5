// mesh_files.h: meshes and samples that are hard to write, small files of every format, and what must be
// refused.
#pragma once

#include "errors.h"
#include "folder.h"
#include "meshes.h"
#include "samples.h"

#include "amps/mesh_io.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

using amps::MeshFormat;
using amps::SampleFormat;

inline const MeshFormat kFormats[] = {MeshFormat::kObj, MeshFormat::kOff, MeshFormat::kPly, MeshFormat::kStl};
inline const char* const kExtensions[] = {".obj", ".off", ".ply", ".stl"};

inline std::string content_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

inline bool same_bits(const Mesh& a, const Mesh& b) {
  return same_bits(a.vertices, b.vertices) && same_values(a.triangles, b.triangles);
}

/// Coordinates with the hardest bit patterns: random ones, denormals, both zeros, the ends of the range.
inline Mesh hard_mesh() {
  Rng rng(11);
  Mesh mesh;
  mesh.vertices = made_points(500, [&rng](Index) {
    Vec3 x;
    for (int k = 0; k < 3; ++k) {
      do {
        const std::uint64_t bits = rng.next();
        std::memcpy(&x[k], &bits, sizeof x[k]);
      } while (!std::isfinite(x[k]));
    }
    return x;
  });
  using limits = std::numeric_limits<double>;
  mesh.vertices.row(0) = Vec3(0.0, -0.0, 0.1).transpose();
  mesh.vertices.row(1) = Vec3(limits::denorm_min(), -limits::min(), limits::max()).transpose();
  mesh.triangles = made_triangles(300, [&rng](Index) { return Corners{below(rng, 500), below(rng, 500), below(rng, 500)}; });
  return mesh;
}

inline SampleSet some_samples(bool with_place) {
  Rng rng(5);
  const Index n = 40;
  SampleSet samples = bare_set(head(hard_mesh().vertices, n), made_values(n, [&rng](Index) { return rng.uniform() + 1e-300; }));
  if (!with_place) return samples;
  samples.barycentrics = made_points(n, [&](Index) {
    samples.facets.push_back(static_cast<Index>(rng.below(1u << 31)));
    return amps::uniform_barycentric(rng);
  });
  return samples;
}

/// The same set with samples on corners, curves and facets.
inline SampleSet on_curves(SampleSet samples) {
  Rng rng(6);
  for (Index s = 0; s < samples.size(); ++s) {
    const auto dimension = static_cast<std::uint8_t>(rng.below(3));
    samples.dimensions.push_back(dimension);
    samples.curves.push_back(dimension == 2 ? kNone : static_cast<Index>(rng.below(1u << 31)));
    samples.parameters.push_back(dimension == 1 ? rng.uniform() * 1e-3 : 0);
  }
  return samples;
}

inline void check_refused(const std::string& data, MeshFormat format, const std::string& part) {
  CAPTURE(data.substr(0, 80));
  const Thrown thrown = thrown_by([&] { amps::parse_mesh(data, format, "some.file"); });
  CAPTURE(thrown.text);
  CHECK(thrown.code == ErrorCode::kFileFormat);
  CHECK(thrown.text.substr(0, 11) == "some.file: ");
  CHECK(thrown.text.find(part) != std::string::npos);
}

inline void check_refused(const std::string& data, SampleFormat format, const std::string& part) {
  const Thrown thrown = thrown_by([&] { amps::parse_samples(data, format, "some.file"); });
  CAPTURE(thrown.text);
  CHECK(thrown.code == ErrorCode::kFileFormat);
  CHECK(thrown.text.find(part) != std::string::npos);
}

/// A unit square of four vertices and two triangles, as every well-formed variant below spells it.
inline Mesh square() { return amps::make_square(1); }

inline void check_is_square(const std::string& data, MeshFormat format) {
  CAPTURE(data);
  const Mesh mesh = amps::parse_mesh(data, format);
  CHECK(same_bits(mesh, square()));
}

template <class Value>
inline void put(std::string& out, Value value, bool big_endian) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  for (std::size_t k = 0; k < sizeof value; ++k)
    out += bytes[big_endian ? sizeof value - 1 - k : k];  // on a little-endian machine
}

/// The square as a binary PLY with unknown elements and properties on all sides.
inline std::string crowded_ply(bool big_endian) {
  std::string out = "ply\nformat binary_";
  out += big_endian ? "big" : "little";
  out +=
      "_endian 1.0\ncomment crowded\nobj_info x\nelement camera 2\nproperty double fov\nproperty list short ushort ids\n"
      "element vertex 4\nproperty uchar red\nproperty float y\nproperty short x\nproperty list uint char notes\nproperty "
      "double z\n"
      "element face 1\nproperty int flags\nproperty list uint ushort vertex_index\nproperty float quality\n"
      "element tail 1\nproperty char c\nend_header\n";
  for (int i = 0; i < 2; ++i) {
    put(out, 0.5, big_endian);
    put(out, std::int16_t{2}, big_endian);
    put(out, std::uint16_t{1}, big_endian);
    put(out, std::uint16_t{2}, big_endian);
  }
  for (int v = 0; v < 4; ++v) {
    put(out, std::uint8_t{200}, big_endian);
    put(out, static_cast<float>(v / 2), big_endian);
    put(out, static_cast<std::int16_t>(v % 2), big_endian);
    put(out, static_cast<std::uint32_t>(v), big_endian);
    for (int k = 0; k < v; ++k) put(out, std::int8_t{-1}, big_endian);
    put(out, 0.0, big_endian);
  }
  put(out, std::int32_t{-7}, big_endian);
  put(out, std::uint32_t{4}, big_endian);
  for (const int corner : {0, 1, 3, 2}) put(out, static_cast<std::uint16_t>(corner), big_endian);
  put(out, 0.25f, big_endian);
  put(out, std::int8_t{1}, big_endian);
  return out;
}

inline std::string binary_off(const std::string& prefix, int extra_floats) {
  std::string out = prefix + "OFF BINARY\n";
  for (const std::int32_t count : {4, 1, 0}) put(out, count, true);
  for (int v = 0; v < 4; ++v) {
    for (const float x : {static_cast<float>(v % 2), static_cast<float>(v / 2), 0.0f}) put(out, x, true);
    for (int k = 0; k < extra_floats; ++k) put(out, 0.5f, true);
  }
  for (const std::int32_t word : {4, 0, 1, 3, 2, 3}) put(out, word, true);
  for (int k = 0; k < 3; ++k) put(out, 0.5f, true);
  return out;
}

inline const char* const kAsciiStl =
    "solid two words\nfacet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n  vertex 1 1 0\n endloop\nendfacet\n"
    "facet normal nan nan nan\n outer loop\n  vertex 0.0 -0 0\n  vertex 1e0 1 0\n  vertex 0 1 0\n endloop\nendfacet\nendsolid "
    "two words\n";

/// A small well-formed file of each kind.
inline std::vector<std::pair<MeshFormat, std::string>> small_files() {
  amps::MeshWriteOptions ascii;
  ascii.ascii_ply = true;
  const Mesh mesh = square();
  return {{MeshFormat::kObj, amps::format_mesh(mesh, MeshFormat::kObj)},
          {MeshFormat::kObj, "o x\nv 0 0 0 1\nv 1 0 0 1\\\n\nv 1 1 0\r\nv 0 1 0\nf -4//1 2/3/4 \\\n 3/1 4\n"},
          {MeshFormat::kOff, amps::format_mesh(mesh, MeshFormat::kOff)},
          {MeshFormat::kOff, binary_off("", 0)},
          {MeshFormat::kOff, binary_off("STCN", 9)},
          {MeshFormat::kPly, amps::format_mesh(mesh, MeshFormat::kPly)},
          {MeshFormat::kPly, amps::format_mesh(mesh, MeshFormat::kPly, ascii)},
          {MeshFormat::kPly, crowded_ply(false)},
          {MeshFormat::kPly, crowded_ply(true)},
          {MeshFormat::kStl, amps::format_mesh(mesh, MeshFormat::kStl)},
          {MeshFormat::kStl, kAsciiStl}};
}

/// True if the data was accepted; then what came of it must be sound.
inline bool survives(const std::string& data, MeshFormat format) {
  try {
    const Mesh mesh = amps::parse_mesh(data, format);
    const amps::MeshReport report = amps::check(mesh);
    CHECK(report.non_finite_vertices == 0);
    CHECK(report.out_of_range_facets == 0);
    return true;
  } catch (const Error& error) {
    CHECK(error.code() == ErrorCode::kFileFormat);
    return false;
  }
}

}  // namespace amps_test
