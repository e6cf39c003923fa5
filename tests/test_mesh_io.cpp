#include "amps/mesh_io.h"
#include "amps/file_io.h"
#include "amps/shapes.h"
#include "test_data.h"

#include <doctest/doctest.h>

#ifdef __linux__
#include <sys/resource.h>

#include <csignal>
#endif

#include <clocale>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <locale>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace {

namespace fs = std::filesystem;
using amps::Index;
using amps::Mesh;
using amps::MeshFormat;
using amps::SampleFormat;
using amps::SampleSet;

const MeshFormat kFormats[] = {MeshFormat::kObj, MeshFormat::kOff, MeshFormat::kPly, MeshFormat::kStl};
const char* const kExtensions[] = {".obj", ".off", ".ply", ".stl"};

// An empty directory of this test's own, removed at the end.
struct Folder {
  fs::path path;
  Folder() {
    for (int i = 0; path.empty(); ++i) {
      const fs::path candidate = fs::temp_directory_path() / ("amps_test_mesh_io_" + std::to_string(i));
      std::error_code error;
      if (fs::create_directory(candidate, error)) path = candidate;
      REQUIRE(i < 1000);
    }
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
  std::size_t entries() const { return static_cast<std::size_t>(std::distance(fs::directory_iterator(path), {})); }
};

std::string content_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

bool same_bits(const Mesh& a, const Mesh& b) {
  const auto size = static_cast<std::size_t>(a.vertices.size()) * sizeof(double);
  return a.vertices.rows() == b.vertices.rows() && a.triangles.rows() == b.triangles.rows() && a.triangles == b.triangles &&
         (size == 0 || std::memcmp(a.vertices.data(), b.vertices.data(), size) == 0);
}

bool same_bits(const SampleSet& a, const SampleSet& b) {
  return same_bits(Mesh{a.positions, {}}, Mesh{b.positions, {}}) && a.radii == b.radii && a.facets == b.facets &&
         same_bits(Mesh{a.barycentrics, {}}, Mesh{b.barycentrics, {}});
}

// Coordinates with the hardest bit patterns: random ones, denormals, both zeros, the ends of the range.
Mesh hard_mesh() {
  amps::Rng rng(11);
  Mesh mesh;
  mesh.vertices.resize(500, 3);
  mesh.triangles.resize(300, 3);
  for (Eigen::Index v = 0; v < mesh.vertices.rows(); ++v) {
    for (int k = 0; k < 3; ++k) {
      double x = 0;
      do {
        const std::uint64_t bits = rng.next();
        std::memcpy(&x, &bits, sizeof x);
      } while (!std::isfinite(x));
      mesh.vertices(v, k) = x;
    }
  }
  using limits = std::numeric_limits<double>;
  mesh.vertices.row(0) << 0.0, -0.0, 0.1;
  mesh.vertices.row(1) << limits::denorm_min(), -limits::min(), limits::max();
  for (Eigen::Index f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) mesh.triangles(f, k) = static_cast<Index>(rng.below(500));
  }
  return mesh;
}

SampleSet some_samples(bool with_place) {
  amps::Rng rng(5);
  SampleSet samples;
  const Index n = 40;
  samples.positions = Mesh(hard_mesh()).vertices.topRows(n);
  samples.radii.resize(n);
  for (Index i = 0; i < n; ++i) samples.radii(i) = rng.uniform() + 1e-300;
  if (!with_place) return samples;
  samples.barycentrics.resize(n, 3);
  for (Index i = 0; i < n; ++i) {
    samples.facets.push_back(static_cast<Index>(rng.below(1u << 31)));
    samples.barycentrics.row(i) = amps::uniform_barycentric(rng).transpose();
  }
  return samples;
}

// The error of a call that must fail, checked to be one line.
template <class Body>
std::pair<amps::ErrorCode, std::string> error_of(Body&& body) {
  try {
    body();
  } catch (const amps::Error& error) {
    const std::string what = error.what();
    CHECK(what.find('\n') == std::string::npos);
    return {error.code(), what};
  }
  FAIL_CHECK("no amps::Error");
  return {amps::ErrorCode::kInternal, ""};
}

void check_refused(const std::string& data, MeshFormat format, const std::string& part) {
  const std::pair<amps::ErrorCode, std::string> error = error_of([&] { amps::parse_mesh(data, format, "some.file"); });
  const amps::ErrorCode code = error.first;
  const std::string& what = error.second;
  CAPTURE(data.substr(0, 80));
  CAPTURE(what);
  CHECK(code == amps::ErrorCode::kFileFormat);
  CHECK(what.substr(0, 11) == "some.file: ");
  CHECK(what.find(part) != std::string::npos);
}

void check_refused(const std::string& data, SampleFormat format, const std::string& part) {
  const std::pair<amps::ErrorCode, std::string> error = error_of([&] { amps::parse_samples(data, format, "some.file"); });
  const amps::ErrorCode code = error.first;
  const std::string& what = error.second;
  CAPTURE(what);
  CHECK(code == amps::ErrorCode::kFileFormat);
  CHECK(what.find(part) != std::string::npos);
}

// A unit square of four vertices and two triangles, as every well-formed variant below spells it.
Mesh square() { return amps::make_square(1); }

void check_is_square(const std::string& data, MeshFormat format) {
  CAPTURE(data);
  const Mesh mesh = amps::parse_mesh(data, format);
  CHECK(same_bits(mesh, square()));
}

template <class Value>
void put(std::string& out, Value value, bool big_endian) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  for (std::size_t k = 0; k < sizeof value; ++k)
    out += bytes[big_endian ? sizeof value - 1 - k : k];  // on a little-endian machine
}

// The square as a binary PLY with unknown elements and properties on all sides.
std::string crowded_ply(bool big_endian) {
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

std::string binary_off(const std::string& prefix, int extra_floats) {
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

const char* const kAsciiStl =
    "solid two words\nfacet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n  vertex 1 1 0\n endloop\nendfacet\n"
    "facet normal nan nan nan\n outer loop\n  vertex 0.0 -0 0\n  vertex 1e0 1 0\n  vertex 0 1 0\n endloop\nendfacet\nendsolid "
    "two words\n";

// A small well-formed file of each kind.
std::vector<std::pair<MeshFormat, std::string>> small_files() {
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

// True if the data was accepted; then what came of it must be sound.
bool survives(const std::string& data, MeshFormat format) {
  try {
    const Mesh mesh = amps::parse_mesh(data, format);
    const amps::MeshReport report = amps::check(mesh);
    CHECK(report.non_finite_vertices == 0);
    CHECK(report.out_of_range_facets == 0);
    return true;
  } catch (const amps::Error& error) {
    CHECK(error.code() == amps::ErrorCode::kFileFormat);
    return false;
  }
}

}  // namespace

TEST_CASE("mesh_io: what is written is read back bit for bit") {
  const Mesh mesh = hard_mesh();
  amps::MeshWriteOptions ascii;
  ascii.ascii_ply = true;
  for (const MeshFormat format : {MeshFormat::kObj, MeshFormat::kOff, MeshFormat::kPly}) {
    CAPTURE(static_cast<int>(format));
    CHECK(same_bits(amps::parse_mesh(amps::format_mesh(mesh, format), format), mesh));
    CHECK(same_bits(amps::parse_mesh(amps::format_mesh(mesh, format, ascii), format), mesh));
    std::stringstream stream;
    amps::write_mesh(stream, mesh, format);
    CHECK(same_bits(amps::read_mesh(stream, format), mesh));
  }
  const Folder folder;
  for (const char* extension : {".OBJ", ".Off", ".ply"}) {
    const fs::path path = folder.path / (std::string("mesh.v1") + extension);
    amps::write_mesh(path, mesh);
    CHECK(same_bits(amps::read_mesh(path), mesh));
    amps::write_mesh(path, square());  // over the old one
    CHECK(same_bits(amps::read_mesh(path.string()), square()));
  }
  CHECK(folder.entries() == 3);
}

TEST_CASE("mesh_io: an STL keeps the mesh up to single precision, its vertices merged again") {
  const Mesh mesh = amps::make_sphere(500, 1.0);
  const Mesh back = amps::parse_mesh(amps::format_mesh(mesh, MeshFormat::kStl), MeshFormat::kStl);
  REQUIRE(back.triangles.rows() == mesh.triangles.rows());
  CHECK(back.vertices.rows() == mesh.vertices.rows());
  for (Eigen::Index f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Eigen::RowVector3d expected = mesh.vertices.row(mesh.triangles(f, k)).cast<float>().cast<double>();
      const Eigen::RowVector3d found = back.vertices.row(back.triangles(f, k));
      REQUIRE((found.array() == expected.array()).all());
    }
  }
}

TEST_CASE("mesh_io: an empty mesh survives in the formats that can say so") {
  const Mesh empty;
  for (const MeshFormat format : {MeshFormat::kOff, MeshFormat::kPly, MeshFormat::kStl}) {
    CHECK(same_bits(amps::parse_mesh(amps::format_mesh(empty, format), format), empty));
  }
}

TEST_CASE("mesh_io: OBJ in the forms people write it") {
  const std::string v = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n";
  for (const char* faces :
       {"f 1 2 4 3\n", "f 1 2 4\nf 1 4 3", "f 1/1 2/2 4/4 3/3\n", "f 1//1 2//1 4//1 3//1\n", "f 1/1/1 2/2/1 4/4/1 3/3/1\n",
        "f -4 -3 -1 -2\n", "f 1 2 \\\n 4 3\n", "f 1 2\\\r\n 4 3\n", "f\t1  2\t4 3  \n", "f 1 2 4 3 # quad\n",
        "g a\nusemtl C:\\x\\\nf 1 2 4 3\ns off\nl 1 2\np 1\nf 1 2\nf 1\nf\n"}) {
    check_is_square(v + faces, MeshFormat::kObj);
  }
  check_is_square(
      "\xEF\xBB\xBF# BOM\r\nvn 0 0 1\r\nvt 0 0\r\nv 0 0 0 1.0\r\nv 1 0 0 0.5 0.5 0.5\r\nv +0 1.0e0 0 #c\r\nv 1 1 0\r\n\r\nf 1 "
      "2 4 3\r\n",
      MeshFormat::kObj);
  check_is_square("f 1 2 4 3\rv 0 0 0\rv 1 0 0\rv 0 1 0\rv 1 1 0", MeshFormat::kObj);  // faces first, old line ends
  const Mesh repeated = amps::parse_mesh(v + "f 1 1 2\n", MeshFormat::kObj);
  CHECK(repeated.triangles.rows() == 1);
  CHECK(amps::check(repeated).repeated_index_facets == 1);
  CHECK(amps::parse_mesh("v 1e-400 -1e-310 1e308\nv 0 0 0\n", MeshFormat::kObj).vertices(0, 0) == 0.0);
}

TEST_CASE("mesh_io: OBJ that cannot be is refused with the line") {
  const std::string v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  check_refused("", MeshFormat::kObj, "not an OBJ");
  check_refused("hello\nworld\n", MeshFormat::kObj, "not an OBJ");
  check_refused("v 0 0 0\r\nv 1 0\r\n", MeshFormat::kObj, "line 2: expected 3 coordinates, found 2");
  check_refused(v + "f 1 2 4\n", MeshFormat::kObj, "line 4: vertex index 4 is out of range");
  check_refused("f 1 2 9\nf 1 2 8\n" + v, MeshFormat::kObj, "line 1: vertex index 9");
  check_refused(v + "f 1 2 0\n", MeshFormat::kObj, "line 4: vertex index 0");
  check_refused(v + "\n\nf 1 2 -4\n", MeshFormat::kObj, "line 6: vertex index -4");
  check_refused(v + "f 1 2 99999999999\n", MeshFormat::kObj, "line 4");
  check_refused(v + "f 1 2 99999999999999999999999\n", MeshFormat::kObj, "line 4");
  check_refused(v + "f 1 2 x\n", MeshFormat::kObj, "line 4: expected a vertex index, found \"x\"");
  for (const char* bad : {"nan", "inf", "-INF", "1e999", "0x10", "1,5", "--1", "+-1", "1e", ".", "1.0f"}) {
    check_refused(v + "v 0 0 " + bad + "\n", MeshFormat::kObj, "line 4");
  }
}

TEST_CASE("mesh_io: OFF in the forms people write it") {
  const std::string body = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n4 0 1 3 2\n";
  for (const char* header :
       {"OFF\n4 1 0\n", "OFF 4 1 0\n", "OFF\n4 1\n", "# c\n\nOFF # c\n\n# c\n4 1 4 # c\n\n", "OFF\r\n4 1 0\r\n"}) {
    check_is_square(header + body, MeshFormat::kOff);
  }
  check_is_square("OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 3\n3 0 3 2", MeshFormat::kOff);
  check_is_square("OFF\n4 4 0\n0 0 0\n#c\n1 0 0\n\n0 1 0 # c\n1 1 0\n2 0 1\n1 0\n0\n4 0 1 3 2 3 255 0 0\n", MeshFormat::kOff);
  check_is_square("COFF\n4 1 0\n0 0 0 255 0 0 255\n1 0 0 0.5 0 0 1\n0 1 0 1 1 1\n1 1 0 1 1 1\n4 0 1 3 2\n", MeshFormat::kOff);
  check_is_square("STCNOFF 4 1 0\n0 0 0 1 2 3 4\n1 0 0 1\n0 1 0 1\n1 1 0 1\n4 0 1 3 2\n", MeshFormat::kOff);
  check_is_square(binary_off("", 0), MeshFormat::kOff);
  check_is_square(binary_off("N", 3), MeshFormat::kOff);
  check_is_square(binary_off("C", 4), MeshFormat::kOff);
  check_is_square(binary_off("ST", 2), MeshFormat::kOff);
  check_is_square(binary_off("STCN", 9), MeshFormat::kOff);
}

TEST_CASE("mesh_io: OFF that cannot be is refused with the place") {
  check_refused("", MeshFormat::kOff, "empty");
  check_refused("4 1 0\n", MeshFormat::kOff, "expected OFF");
  check_refused("4OFF\n", MeshFormat::kOff, "dimensions");
  check_refused("OFF\n4 x\n", MeshFormat::kOff, "line 2");
  check_refused("OFF\n2000000000 2000000000 0\n0 0 0\n", MeshFormat::kOff, "promises");
  check_refused("OFF\n-1 0 0\n", MeshFormat::kOff, "promises");
  check_refused("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1\n3 0 1 2\n", MeshFormat::kOff, "line 5: expected 3 coordinates, found 2");
  check_refused("OFF\n3 1 0\n0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n", MeshFormat::kOff, "line 4");
  check_refused("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", MeshFormat::kOff, "line 6: vertex index 3 is out of range");
  check_refused("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", MeshFormat::kOff, "line 6: vertex index -1");
  check_refused("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", MeshFormat::kOff, "line 6: expected 3 vertex indices, found 2");
  check_refused("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n", MeshFormat::kOff, "ends after 0");
  std::string huge = "OFF BINARY\n";
  for (const std::int32_t count : {2000000000, 1, 0}) put(huge, count, true);
  check_refused(huge, MeshFormat::kOff, "promises");
}

TEST_CASE("mesh_io: PLY of any scalar type, byte order, element and property") {
  check_is_square(crowded_ply(false), MeshFormat::kPly);
  check_is_square(crowded_ply(true), MeshFormat::kPly);
  const std::string header =
      "ply\nformat ascii 1.0\ncomment c\nelement vertex 4\nproperty float64 x\nproperty float32 y\nproperty int8 z\nproperty "
      "float quality\n"
      "element face 1\nproperty list uint8 uint32 vertex_indices\nproperty list uchar float texcoord\nelement edge 1\nproperty "
      "int a\nend_header\n";
  const std::string body = "0 0 0 nan\n1 0 0 1\n0 1 0 inf\n1 1 0 1\n4 0 1 3 2 2 0.5 0.5\n3\n";
  check_is_square(header + body, MeshFormat::kPly);
  std::string crlf;
  for (const char c : header + body) crlf += c == '\n' ? std::string("\r\n") : std::string(1, c);
  check_is_square(crlf, MeshFormat::kPly);
  // A binary body that starts with a byte that is a line feed must not be taken for a part of the header, nor \r\n cut in two.
  for (const std::string& end : {std::string("\n"), std::string("\r\n")}) {
    std::string text = "ply" + end + "format binary_little_endian 1.0" + end + "element vertex 1" + end + "property uchar x" +
                       end + "property uchar y" + end + "property uchar z" + end + "end_header" + end + "\n\r\n";
    CHECK(amps::parse_mesh(text, MeshFormat::kPly).vertices.row(0) == Eigen::RowVector3d(10, 13, 10));
  }
  // Faces before vertices.
  check_is_square(
      "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_index\nelement vertex 4\nproperty float x\n"
      "property float y\nproperty float z\nend_header\n4 0 1 3 2\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n",
      MeshFormat::kPly);
}

TEST_CASE("mesh_io: PLY that cannot be is refused with the place") {
  const auto ply = [](const std::string& format, const std::string& vertices, const std::string& faces,
                      const std::string& body) {
    return "ply\nformat " + format + " 1.0\nelement vertex " + vertices +
           "\nproperty float x\nproperty float y\nproperty float z\nelement face " + faces +
           "\nproperty list uchar int vertex_indices\nend_header\n" + body;
  };
  const std::string v = "0 0 0\n1 0 0\n0 1 0\n";
  check_refused("", MeshFormat::kPly, "empty");
  check_refused("plyx\n", MeshFormat::kPly, "line 1");
  check_refused("ply\nformat ascii 1.0\n", MeshFormat::kPly, "end_header");
  check_refused("ply\nend_header\n", MeshFormat::kPly, "format");
  check_refused("ply\nformat ascii 1.0\nend_header\n", MeshFormat::kPly, "vertex");
  check_refused("ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\nend_header\n", MeshFormat::kPly,
                "line 4: unknown type \"quad\"");
  check_refused("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", MeshFormat::kPly, "x, y and z");
  check_refused("ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", MeshFormat::kPly, "line 3");
  check_refused(ply("ascii", "4000000000", "1", v), MeshFormat::kPly, "promises 4000000000");
  check_refused(ply("binary_little_endian", "4000000000", "1", v), MeshFormat::kPly, "promises 4000000000");
  check_refused(ply("ascii", "3", "4000000000", v), MeshFormat::kPly, "promises 4000000000");
  check_refused(ply("ascii", "3", "1", v + "3 0 1 3\n"), MeshFormat::kPly, "line 13: vertex index 3");
  check_refused(ply("ascii", "3", "1", v + "3 0 1 -2\n"), MeshFormat::kPly, "line 13: vertex index -2");
  check_refused(ply("ascii", "3", "1", v + "3 0 1 1.5\n"), MeshFormat::kPly, "whole number");
  check_refused(ply("ascii", "3", "1", v + "-3 0 1 1\n"), MeshFormat::kPly, "line 13");
  check_refused(ply("ascii", "3", "1", v + "3 0 1\n"), MeshFormat::kPly, "cut short");
  check_refused(ply("ascii", "3", "1", "0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n"), MeshFormat::kPly, "line 11");
  check_refused(ply("binary_big_endian", "3", "1", std::string(36, '\0') + '\377' + std::string(20, '\0')), MeshFormat::kPly,
                "cut short");
  check_refused(ply("binary_big_endian", "1", "0", std::string(12, '\377')), MeshFormat::kPly, "NaN");
}

TEST_CASE("mesh_io: STL is binary if its size says so, whatever its header says") {
  const Mesh expected = amps::merge_equal_vertices(amps::parse_mesh(kAsciiStl, MeshFormat::kStl));
  CHECK(expected.vertices.rows() == 4);
  CHECK(expected.triangles.rows() == 2);
  std::string binary = amps::format_mesh(expected, MeshFormat::kStl);
  CHECK(binary.size() == 84 + 50 * 2);
  CHECK(binary.substr(0, 5) != "solid");
  binary.replace(0, 12, "solid object");
  CHECK(same_bits(amps::parse_mesh(binary, MeshFormat::kStl), expected));
  binary[0] = 'x';
  CHECK(same_bits(amps::parse_mesh(binary + "tail", MeshFormat::kStl), expected));
  std::string upper(kAsciiStl);
  for (char& c : upper) c = c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  CHECK(same_bits(amps::parse_mesh(upper, MeshFormat::kStl), expected));
  check_refused("", MeshFormat::kStl, "not an STL");
  check_refused("solid x\n", MeshFormat::kStl, "endsolid");
  check_refused("solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nendloop\n", MeshFormat::kStl,
                "line 6: expected 3");
  check_refused("solid x\nwhat\n", MeshFormat::kStl, "line 2");
  check_refused(binary.substr(0, 120), MeshFormat::kStl, "promises 2 facets");
  for (int k = 0; k < 4; ++k) binary[static_cast<std::size_t>(96 + k)] = '\377';
  check_refused(binary, MeshFormat::kStl, "byte 96");
}

TEST_CASE("mesh_io: a file cut short anywhere is read or refused, never more") {
  for (const auto& file : small_files()) {
    const MeshFormat format = file.first;
    const std::string& data = file.second;
    CHECK(survives(data, format));
    int accepted = 0;
    for (std::size_t size = 0; size < data.size(); ++size) accepted += survives(data.substr(0, size), format) ? 1 : 0;
    // The last bytes may be dispensable (a line end, a name), and an OBJ is a mesh after every line; nothing else is.
    CAPTURE(data);
    if (format != MeshFormat::kObj) CHECK(accepted <= 13);
  }
}

TEST_CASE("mesh_io: a file with damaged bytes is read or refused, never more") {
  amps::Rng rng(2024);
  for (const auto& [format, data] : small_files()) {
    for (int round = 0; round < 3000; ++round) {
      std::string damaged = data;
      for (std::uint64_t n = 1 + rng.below(4); n > 0; --n) {
        const std::size_t at = rng.below(damaged.size());
        const std::uint64_t kind = rng.below(4);
        if (kind == 0) damaged[at] = static_cast<char>(static_cast<unsigned char>(rng.below(256)));
        if (kind == 1) damaged[at] = "0123456789-+.e \n\r\\#/"[rng.below(20)];
        if (kind == 2) damaged.erase(at, 1 + rng.below(4));
        if (kind == 3) damaged.insert(at, 1 + rng.below(4), static_cast<char>(static_cast<unsigned char>(rng.below(256))));
        if (damaged.empty()) damaged = "x";
      }
      for (const MeshFormat as : {format, kFormats[rng.below(4)]}) {
        try {
          const amps::MeshReport report = amps::check(amps::parse_mesh(damaged, as));
          REQUIRE(report.non_finite_vertices == 0);
          REQUIRE(report.out_of_range_facets == 0);
        } catch (const amps::Error& error) {
          const bool expected = error.code() == amps::ErrorCode::kFileFormat || error.code() == amps::ErrorCode::kTooLarge;
          REQUIRE(expected);
        }
      }
    }
  }
}

TEST_CASE("mesh_io: samples written are read back bit for bit") {
  const Folder folder;
  for (const bool with_place : {false, true}) {
    const SampleSet samples = some_samples(with_place);
    for (const char* extension : {".xyzr", ".ply", ".CSV"}) {
      CAPTURE(extension);
      const fs::path path = folder.path / (std::string("samples") + extension);
      amps::write_samples(path, samples);
      const SampleSet expected = std::string(extension) == ".xyzr" ? some_samples(false) : samples;
      CHECK(same_bits(amps::read_samples(path), expected));
    }
  }
  CHECK(folder.entries() == 3);
}

TEST_CASE("mesh_io: samples in the forms people write them") {
  const SampleSet a = amps::parse_samples("# x y z r\n1 2 3 0.5 # c\r\n\n 4\t5 6 1e-1", SampleFormat::kXyzr);
  CHECK(a.positions.row(1) == Eigen::RowVector3d(4, 5, 6));
  CHECK(a.radii(1) == 0.1);
  CHECK(a.facets.empty());
  const SampleSet b = amps::parse_samples("\xEF\xBB\xBF\"R\", X ,name,Z,Y\r\n0.5,1,dot,3,2\r\n", SampleFormat::kCsv);
  CHECK(b.positions.row(0) == Eigen::RowVector3d(1, 2, 3));
  CHECK(b.radii(0) == 0.5);
  const SampleSet c = amps::parse_samples("x,y,z,radius,facet,b2,b1,b0\n1,2,3,4,7,0.5,0.25,0.25\n", SampleFormat::kCsv);
  CHECK(c.facets == std::vector<Index>{7});
  CHECK(c.barycentrics.row(0) == Eigen::RowVector3d(0.25, 0.25, 0.5));
  const SampleSet d = amps::parse_samples("x,y,z,radius,facet\n1,2,3,4,7\n", SampleFormat::kCsv);
  CHECK(d.facets.empty());
}

TEST_CASE("mesh_io: a property of the vertices by its name") {
  const std::string text =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty list uchar int marks\nproperty double size\n"
      "end_header\n1 2 7 7 0.5\n2 0 1e-3\n3 1 4 7\n";
  const Eigen::VectorXd size = amps::parse_vertex_property(text, "size");
  REQUIRE(size.size() == 3);
  CHECK(size[0] == 0.5);
  CHECK(size[1] == 1e-3);
  CHECK(size[2] == 7);
  CHECK(amps::parse_vertex_property(text, "x")[2] == 3);
  CHECK_THROWS_WITH_AS(amps::parse_vertex_property(text, "marks", "a.ply"), "a.ply: its vertices have no property marks",
                       amps::Error);
  CHECK_THROWS_AS(amps::parse_vertex_property(text.substr(0, text.size() - 4), "size"), amps::Error);
  const std::string nan = text.substr(0, text.size() - 2) + "nan\n";
  CHECK_THROWS_AS(amps::parse_vertex_property(nan, "size"), amps::Error);
}

TEST_CASE("mesh_io: samples that cannot be are refused with the place") {
  check_refused("", SampleFormat::kXyzr, "no sample");
  check_refused("1 2 3\n", SampleFormat::kXyzr, "line 1: expected 4 numbers");
  check_refused("1 2 3 4\n1 2 3 4 5\n", SampleFormat::kXyzr, "line 2");
  check_refused("1 2 3 0\n", SampleFormat::kXyzr, "line 1: the radius");
  check_refused("1 2 3 nan\n", SampleFormat::kXyzr, "line 1");
  check_refused("1 2 inf 1\n", SampleFormat::kXyzr, "line 1");
  check_refused("", SampleFormat::kCsv, "empty");
  check_refused("x,y,z\n1,2,3\n", SampleFormat::kCsv, "radius");
  check_refused("x,y,z,radius\n", SampleFormat::kCsv, "no sample");
  check_refused("x,y,z,radius\n1,2,3\n", SampleFormat::kCsv, "line 2: expected 4 fields, found 3");
  check_refused("x,y,z,radius\n1,2,3,\n", SampleFormat::kCsv, "line 2: expected a number");
  check_refused("x,y,z,r,facet,b0,b1,b2\n1,2,3,4,1.5,0,0,1\n", SampleFormat::kCsv, "line 2: the facet");
  check_refused(amps::format_mesh(square(), MeshFormat::kPly), SampleFormat::kPly, "radius");
  check_refused("ply", SampleFormat::kPly, "PLY");
  const std::string data = amps::format_samples(some_samples(true), SampleFormat::kPly);
  for (std::size_t size = 0; size < data.size(); size += 7)
    CHECK_THROWS_AS(amps::parse_samples(data.substr(0, size), SampleFormat::kPly), amps::Error);
  CHECK_THROWS_AS(amps::format_samples(SampleSet{}, SampleFormat::kXyzr), amps::Error);
  SampleSet uneven = some_samples(true);
  uneven.facets.pop_back();
  CHECK_THROWS_AS(amps::format_samples(uneven, SampleFormat::kCsv), amps::Error);
}

TEST_CASE("mesh_io: meshes that could not be read back are not written") {
  Mesh mesh = square();
  mesh.vertices(1, 2) = std::numeric_limits<double>::infinity();
  for (const MeshFormat format : kFormats)
    CHECK(error_of([&] { amps::format_mesh(mesh, format); }).first == amps::ErrorCode::kInvalidMesh);
  mesh = square();
  mesh.triangles(0, 0) = 4;
  for (const MeshFormat format : kFormats)
    CHECK(error_of([&] { amps::format_mesh(mesh, format); }).first == amps::ErrorCode::kInvalidMesh);
  mesh = square();
  mesh.vertices(0, 0) = 1e39;
  CHECK(error_of([&] { amps::format_mesh(mesh, MeshFormat::kStl); }).second.find("too large for STL") != std::string::npos);
}

TEST_CASE("mesh_io: a failed write leaves what was there, and nothing else") {
  const Folder folder;
  const fs::path path = folder.path / "mesh.obj";
  amps::write_mesh(path, square());
  const std::string before = content_of(path);
  Mesh bad = square();
  bad.triangles(0, 0) = -1;
  CHECK_THROWS_AS(amps::write_mesh(path, bad), amps::Error);
  CHECK(content_of(path) == before);

  fs::permissions(path, fs::perms::owner_read);
  CHECK(error_of([&] { amps::write_mesh(path, square()); }).second.find("read-only") != std::string::npos);
  fs::permissions(path, fs::perms::owner_read | fs::perms::owner_write);
  amps::write_mesh(path, amps::make_cube(1));
  CHECK(fs::status(path).permissions() == (fs::perms::owner_read | fs::perms::owner_write));

  const auto [code, what] = error_of([&] { amps::write_mesh(folder.path / "none" / "mesh.ply", square()); });
  CHECK(code == amps::ErrorCode::kFileNotFound);
  CHECK(what.find("mesh.ply: cannot be created") != std::string::npos);
  fs::create_directory(folder.path / "dir.off");
  CHECK(error_of([&] { amps::write_mesh(folder.path / "dir.off", square()); }).first == amps::ErrorCode::kFileNotFound);
  CHECK(error_of([&] { amps::write_mesh(folder.path / "mesh.xyz", square()); }).first == amps::ErrorCode::kFileFormat);
  CHECK(error_of([&] { amps::write_samples(folder.path / "mesh.obj", some_samples(false)); }).first ==
        amps::ErrorCode::kFileFormat);
  CHECK(folder.entries() == 2);
}

#ifdef __linux__
TEST_CASE("mesh_io: a full disk is an error, links are followed, devices are not replaced") {
  const Folder folder;
  fs::create_symlink("/dev/full", folder.path / "full.ply");
  const auto [code, what] = error_of([&] { amps::write_mesh(folder.path / "full.ply", square()); });
  CHECK(code == amps::ErrorCode::kFileNotFound);
  CHECK(what.find("full.ply: cannot be written") != std::string::npos);
  CHECK(fs::is_character_file("/dev/full"));
  amps::write_mesh(folder.path / "real.ply", square());
  fs::create_symlink("real.ply", folder.path / "link.ply");
  amps::write_mesh(folder.path / "link.ply", amps::make_cube(2));
  CHECK(fs::is_symlink(folder.path / "link.ply"));
  CHECK(same_bits(amps::read_mesh(folder.path / "real.ply"), amps::make_cube(2)));
  std::ofstream full("/dev/full", std::ios::binary);
  CHECK(error_of([&] { amps::write_mesh(full, square(), MeshFormat::kOff); }).first == amps::ErrorCode::kFileNotFound);
  CHECK(folder.entries() == 3);
}

TEST_CASE("mesh_io: a write that fails half-way leaves the old file and no temporary one") {
  const Folder folder;
  const fs::path path = folder.path / "mesh.off";
  amps::write_mesh(path, square());
  rlimit old{};
  REQUIRE(getrlimit(RLIMIT_FSIZE, &old) == 0);
  rlimit small = old;
  small.rlim_cur = 5000;
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  REQUIRE(setrlimit(RLIMIT_FSIZE, &small) == 0);
  const auto [code, what] = error_of([&] { amps::write_mesh(path, amps::make_sphere(5000, 1.0)); });
  setrlimit(RLIMIT_FSIZE, &old);
  std::signal(SIGXFSZ, handler);
  CHECK(code == amps::ErrorCode::kFileNotFound);
  CHECK(what.find("mesh.off: cannot be written") != std::string::npos);
  CHECK(same_bits(amps::read_mesh(path), square()));
  CHECK(folder.entries() == 1);
}
#endif

TEST_CASE("mesh_io: files that cannot be opened are an error that names them") {
  const Folder folder;
  for (const char* extension : kExtensions) {
    const std::string name = std::string("nothing") + extension;
    const auto [code, what] = error_of([&] { amps::read_mesh(folder.path / name); });
    CHECK(code == amps::ErrorCode::kFileNotFound);
    CHECK(what.find(name) != std::string::npos);
    std::ofstream(folder.path / name, std::ios::binary).flush();
    CHECK(error_of([&] { amps::read_mesh(folder.path / name); }).first == amps::ErrorCode::kFileFormat);
  }
  CHECK(error_of([&] { amps::read_samples(folder.path / "nothing.csv"); }).first == amps::ErrorCode::kFileNotFound);
  CHECK(error_of([&] { amps::read_mesh("mesh"); }).first == amps::ErrorCode::kFileFormat);
  CHECK(error_of([&] { amps::read_mesh("mesh.xyzr"); }).first == amps::ErrorCode::kFileFormat);
  fs::create_directory(folder.path / "dir.off");
  CHECK(error_of([&] { amps::read_mesh(folder.path / "dir.off"); }).second.find("directory") != std::string::npos);
}

TEST_CASE("mesh_io: numbers do not depend on the locale") {
  // A locale with a decimal comma in both places a program sets one; the C library may not have de_DE, C++ can make its own.
  struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };
  const std::locale old = std::locale::global(std::locale(std::locale::classic(), new Comma));
  const std::string old_c = std::setlocale(LC_NUMERIC, nullptr);
  std::setlocale(LC_NUMERIC, "de_DE.UTF-8");
  const Mesh mesh = hard_mesh();
  for (const MeshFormat format : {MeshFormat::kObj, MeshFormat::kOff, MeshFormat::kPly}) {
    amps::MeshWriteOptions ascii;
    ascii.ascii_ply = true;
    const std::string data = amps::format_mesh(mesh, format, ascii);
    CHECK(data.find(',') == std::string::npos);
    CHECK(same_bits(amps::parse_mesh(data, format), mesh));
  }
  double value = 0;
  CHECK(amps::detail::parse_double_slowly("-1.25e2", value));
  CHECK(value == -125.0);
  std::setlocale(LC_NUMERIC, old_c.c_str());
  std::locale::global(old);
}

TEST_CASE("mesh_io: the fallback for libraries without from_chars reads the same doubles") {
  amps::Rng rng(3);
  std::vector<std::string> texts = {"0",      "-0",     "1",       ".5",      "5.",  "1e5", "1E-5", "+2", "1e400",
                                    "-1e400", "1e-400", "-1e-310", "1e99999", "",    "-",   ".",    "e5", "1e",
                                    "1e+",    "1x",     "0x1",     "1.2.3",   "1 2", "--1", "a1"};
  const Mesh hard = hard_mesh();
  for (int i = 0; i < 300; ++i)
    amps::detail::append_number(texts.emplace_back(), hard.vertices(static_cast<Eigen::Index>(rng.below(500)), 0));
  for (const std::string& text : texts) {
    CAPTURE(text);
    double fast = 7, slow = 7;
    const bool is_number = amps::detail::parse_double(text.data(), text.data() + text.size(), fast);
    CHECK(amps::detail::parse_double_slowly(text, slow) == is_number);
    if (is_number) CHECK(std::memcmp(&fast, &slow, sizeof fast) == 0);
  }
}

TEST_CASE("mesh_io: real files survive every format") {
  for (const char* name :
       {"bunny_100kf_closed.obj", "teapot.obj", "spot.obj", "fertility.off", "thingi_65004.stl", "hinge_ascii.stl"}) {
    CAPTURE(name);
    const Mesh mesh = amps_test::data_mesh_or(name, amps::make_torus());
    for (const MeshFormat format : {MeshFormat::kObj, MeshFormat::kOff, MeshFormat::kPly}) {
      CHECK(same_bits(amps::parse_mesh(amps::format_mesh(mesh, format), format), mesh));
    }
    const Mesh stl = amps::parse_mesh(amps::format_mesh(mesh, MeshFormat::kStl), MeshFormat::kStl);
    CHECK(stl.triangles.rows() == mesh.triangles.rows());
  }
}
