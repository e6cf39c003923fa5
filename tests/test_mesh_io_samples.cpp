// Sample sets and values of vertices in files.
#include "amps/mesh_io.h"

#include "kit/mesh_files.h"

#include <doctest/doctest.h>

#include <string>
#include <vector>

namespace amps_test {

TEST_CASE("mesh_io: samples written are read back bit for bit") {
  const Folder folder;
  for (const bool with_place : {false, true}) {
    const SampleSet samples = some_samples(with_place);
    for (const char* extension : {".xyzr", ".ply", ".CSV"}) {
      CAPTURE(extension);
      const fs::path path = folder.path / (std::string("samples") + extension);
      amps::write_samples(path, samples);
      const SampleSet expected = std::string(extension) == ".xyzr" ? some_samples(false) : samples;
      CHECK(same_set(amps::read_samples(path), expected));
    }
  }
  CHECK(folder.entries() == 3);
}

TEST_CASE("mesh_io: samples in the forms people write them") {
  const SampleSet a = amps::parse_samples("# x y z r\n1 2 3 0.5 # c\r\n\n 4\t5 6 1e-1", SampleFormat::kXyzr);
  CHECK(sample_at(a, 1) == Vec3(4, 5, 6));
  CHECK(a.radii[1] == 0.1);
  CHECK(a.facets.empty());
  const SampleSet b = amps::parse_samples("\xEF\xBB\xBF\"R\", X ,name,Z,Y\r\n0.5,1,dot,3,2\r\n", SampleFormat::kCsv);
  CHECK(sample_at(b, 0) == Vec3(1, 2, 3));
  CHECK(b.radii[0] == 0.5);
  const SampleSet c = amps::parse_samples("x,y,z,radius,facet,b2,b1,b0\n1,2,3,4,7,0.5,0.25,0.25\n", SampleFormat::kCsv);
  CHECK(c.facets == std::vector<Index>{7});
  CHECK(barycentric_of(c, 0) == Vec3(0.25, 0.25, 0.5));
  const SampleSet d = amps::parse_samples("x,y,z,radius,facet\n1,2,3,4,7\n", SampleFormat::kCsv);
  CHECK(d.facets.empty());
}

TEST_CASE("mesh_io: a property of the vertices by its name") {
  const std::string text =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty list uchar int marks\nproperty double size\n"
      "end_header\n1 2 7 7 0.5\n2 0 1e-3\n3 1 4 7\n";
  const Values size = amps::parse_vertex_property(text, "size");
  REQUIRE(size.size() == 3);
  CHECK(size[0] == 0.5);
  CHECK(size[1] == 1e-3);
  CHECK(size[2] == 7);
  CHECK(amps::parse_vertex_property(text, "x")[2] == 3);
  CHECK_THROWS_WITH_AS(amps::parse_vertex_property(text, "marks", "a.ply"), "a.ply: its vertices have no property marks",
                       Error);
  CHECK_THROWS_AS(amps::parse_vertex_property(text.substr(0, text.size() - 4), "size"), Error);
  const std::string nan = text.substr(0, text.size() - 2) + "nan\n";
  CHECK_THROWS_AS(amps::parse_vertex_property(nan, "size"), Error);
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
    CHECK_THROWS_AS(amps::parse_samples(data.substr(0, size), SampleFormat::kPly), Error);
  CHECK_THROWS_AS(amps::format_samples(SampleSet{}, SampleFormat::kXyzr), Error);
  SampleSet uneven = some_samples(true);
  uneven.facets.pop_back();
  CHECK_THROWS_AS(amps::format_samples(uneven, SampleFormat::kCsv), Error);
}

}  // namespace amps_test
