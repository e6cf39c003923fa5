// Reading files of each format in the forms people write them; what cannot be is refused with the place, however it is broken.
#include "amps/mesh_io.h"

#include "kit/mesh_files.h"

#include <doctest/doctest.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace amps_test {

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
  CHECK(rows(repeated.triangles) == 1);
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

TEST_CASE("mesh_io: lines and points of OBJ in the forms people write them") {
  using Edges = std::vector<std::array<Index, 2>>;
  const std::string v = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n";
  const auto parsed = [](const std::string& text) { return amps::parse_mesh_marks(text, MeshFormat::kObj, "some.file"); };
  for (const char* lines : {"l 1 2 4 3\n", "l 1 2\nl 2 4\nl 4 3\n", "l 1/1 2/2 4/4 3/3", "l -4 -3 -1 -2\n", "l 1 2 \\\n 4 3\n",
                            "\r\nf 1 2 3\r\nl\t1  2\t4 3 # a polyline\r\n", "l 1 2\nl 3\nl\ng b\nl 2 4\nl 4 3"}) {
    CAPTURE(lines);
    const amps::MeshMarks marks = parsed(v + lines);
    CHECK(marks.edges == Edges{{0, 1}, {1, 3}, {3, 2}});
    CHECK(marks.vertices.empty());
    CHECK(marks.edge_lines.size() == marks.edges.size());
  }
  CHECK(parsed("l 1 2\n" + v).edges == Edges{{0, 1}});  // before the vertices
  CHECK(parsed("v 0 0 0\nv 1 0 0\nl -1 -2\nv 2 0 0\nl -1 -2\n").edges == Edges{{1, 0}, {2, 1}});
  const amps::MeshMarks marks = parsed(v + "\n# two\r\np 1 -1\rl 1 2 3 1\n\\\nvp 1\np 2\n");
  CHECK(marks.vertices == std::vector<Index>{0, 3, 1});
  CHECK(marks.vertex_lines == std::vector<std::size_t>{7, 7, 11});
  CHECK(marks.edges == Edges{{0, 1}, {1, 2}, {2, 0}});
  CHECK(marks.edge_lines == std::vector<std::size_t>{8, 8, 8});
  CHECK(parsed(v).empty());
}

TEST_CASE("mesh_io: lines and points of OBJ that cannot be are refused with the line") {
  const std::string v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  const auto refused = [](const std::string& data, MeshFormat format, const std::string& part) {
    CAPTURE(data);
    const Thrown thrown = thrown_by([&] { amps::parse_mesh_marks(data, format, "some.file"); });
    CAPTURE(thrown.text);
    CHECK(thrown.code == ErrorCode::kFileFormat);
    CHECK(thrown.text.find("some.file: ") == 0);
    CHECK(thrown.text.find(part) != std::string::npos);
  };
  refused("", MeshFormat::kObj, "not an OBJ");
  refused(v + "l 1 4\n", MeshFormat::kObj,
          "line 4: vertex index 4 is out of range, vertices are numbered 1 to 3; correct or remove the line");
  refused(v + "\nl 1 0\n", MeshFormat::kObj, "line 5: vertex index 0");
  refused(v + "l -4 1\n", MeshFormat::kObj, "line 4: vertex index -4");
  refused(v + "l 1 x\n", MeshFormat::kObj, "line 4: expected a vertex index, found \"x\"; correct or remove the line");
  refused("p 9\np 8\n" + v, MeshFormat::kObj,
          "line 1: vertex index 9 is out of range, vertices are numbered 1 to 3; correct or remove the point");
  for (const MeshFormat format : {MeshFormat::kOff, MeshFormat::kPly, MeshFormat::kStl}) {
    refused(v + "l 1 2\n", format, "OBJ files only");
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
  // Binary faces with colours, without, and with no number of their parts.
  for (const int kind : {0, 1, 2}) {
    for (const bool big_endian : {true, false}) {
      std::string faces = "OFF BINARY\n";
      for (const std::int32_t count : {4, 2, 0}) put(faces, count, big_endian);
      for (const float x : {0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 1.f, 1.f, 0.f, 0.f, 1.f, 0.f}) put(faces, x, big_endian);
      for (const std::int32_t third : {1, 2}) {
        for (const std::int32_t index : {3, 0, third, third + 1}) put(faces, index, big_endian);
        if (kind == 1) put(faces, std::int32_t{0}, big_endian);
        if (kind == 2) {
          for (const std::int32_t part : {3, 0, 1, 2}) put(faces, part, big_endian);
        }
      }
      for (const char* behind : {"", "more"}) {  // with something behind, faces have colours
        if (kind == 0 && *behind != '\0') continue;
        const Mesh mesh = amps::parse_mesh(faces + behind, MeshFormat::kOff);
        REQUIRE(rows(mesh.triangles) == 2);
        CHECK((mesh.triangles(1, 0) == 0 && mesh.triangles(1, 1) == 2 && mesh.triangles(1, 2) == 3));
      }
    }
  }
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
    CHECK(point_at(amps::parse_mesh(text, MeshFormat::kPly).vertices, 0) == Vec3(10, 13, 10));
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
  CHECK(rows(expected.vertices) == 4);
  CHECK(rows(expected.triangles) == 2);
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
  Rng rng(2024);
  auto files = small_files();
  files.emplace_back(MeshFormat::kObj, "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\nl 1 2/1 -1 \\\n 3\np -3 2\n");
  for (const auto& [format, data] : files) {
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
          if (as == MeshFormat::kObj) amps::parse_mesh_marks(damaged, as);
        } catch (const Error& error) {
          const bool expected = error.code() == ErrorCode::kFileFormat || error.code() == ErrorCode::kTooLarge;
          REQUIRE(expected);
        }
      }
    }
  }
}

}  // namespace amps_test
