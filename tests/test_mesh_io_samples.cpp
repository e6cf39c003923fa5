// Sample sets and values of vertices in files.
#include "amps/mesh_io.h"

#include "kit/mesh_files.h"

#include <doctest/doctest.h>

#include <sstream>
#include <string>
#include <vector>

namespace amps_test {

TEST_CASE("mesh_io: samples written are read back bit for bit") {
  const Folder folder;
  for (const bool with_place : {false, true}) {
    for (const bool with_curves : {false, true}) {
      const SampleSet samples = with_curves ? on_curves(some_samples(with_place)) : some_samples(with_place);
      for (const char* extension : {".xyzr", ".ply", ".CSV"}) {
        CAPTURE(extension);
        const fs::path path = folder.path / (std::string("samples") + extension);
        amps::write_samples(path, samples);
        const SampleSet expected = std::string(extension) == ".xyzr" ? some_samples(false) : samples;
        CHECK(same_set_on_curves(amps::read_samples(path), expected));
        std::stringstream stream;
        amps::write_samples(stream, samples, amps::sample_format(path));
        CHECK(stream.str() == content_of(path));
        CHECK(same_set_on_curves(amps::read_samples(stream, amps::sample_format(path)), expected));
      }
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
  const SampleSet e = amps::parse_samples("Parameter,x,y,z,r,curve,dimension\n0.5,1,2,3,4,7,1\n0,1,2,3,4,0,0\n0,1,2,3,4,-1,2\n",
                                          SampleFormat::kCsv);
  CHECK(e.facets.empty());
  CHECK(e.dimensions == std::vector<std::uint8_t>{1, 0, 2});
  CHECK(e.curves == std::vector<Index>{7, 0, kNone});
  CHECK(e.parameters == std::vector<double>{0.5, 0, 0});
  // Of another's columns by these names, two are no place on curves, whatever is in them.
  const SampleSet f = amps::parse_samples("x,y,z,r,dimension,curve\n1,2,3,4,north,\n", SampleFormat::kCsv);
  CHECK(f.dimensions.empty());
  CHECK(f.curves.empty());
  CHECK(f.parameters.empty());
}

TEST_CASE("mesh_io: sample files name their columns, and hold what programs expect of their types") {
  const SampleSet bare = some_samples(false), placed = some_samples(true);
  const auto header = [](const SampleSet& set) {
    const std::string text = amps::format_samples(set, SampleFormat::kCsv);
    return text.substr(0, text.find('\n'));
  };
  CHECK(header(bare) == "x,y,z,radius");
  CHECK(header(placed) == "x,y,z,radius,facet,b0,b1,b2");
  CHECK(header(on_curves(bare)) == "x,y,z,radius,dimension,curve,parameter");
  CHECK(header(on_curves(placed)) == "x,y,z,radius,facet,b0,b1,b2,dimension,curve,parameter");
  const std::string ply = amps::format_samples(on_curves(placed), SampleFormat::kPly);
  for (const char* property : {"property int facet\n", "property double b2\n", "property uchar dimension\n",
                               "property int curve\n", "property double parameter\n"}) {
    CHECK(ply.find(property) != std::string::npos);
  }
  CHECK(amps::format_samples(on_curves(placed), SampleFormat::kXyzr) == amps::format_samples(bare, SampleFormat::kXyzr));
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
  const std::string curve_header = "x,y,z,r,dimension,curve,parameter\n1,2,3,4,";
  check_refused(curve_header + "3,0,0\n", SampleFormat::kCsv, "line 2: the dimension is not 0");
  check_refused(curve_header + "-1,0,0\n", SampleFormat::kCsv, "line 2: the dimension is not 0");
  check_refused(curve_header + "nan,0,0\n", SampleFormat::kCsv, "line 2: the dimension is not 0");
  check_refused(curve_header + "2,0,0\n", SampleFormat::kCsv, "line 2: a sample of dimension 2 is on no curve");
  check_refused(curve_header + "1,-1,0\n", SampleFormat::kCsv, "line 2: the number of the curve");
  check_refused(curve_header + "0,0.5,0\n", SampleFormat::kCsv, "line 2: the number of the curve");
  check_refused(curve_header + "1,0,-0.5\n", SampleFormat::kCsv, "line 2: the parameter");
  check_refused(curve_header + "1,0,inf\n", SampleFormat::kCsv, "line 2: the parameter");
  check_refused(curve_header + "0,0,0.5\n", SampleFormat::kCsv, "line 2: a sample that is on no curve");
  check_refused(curve_header + "1,0\n", SampleFormat::kCsv, "line 2: expected 7 fields, found 6");
  check_refused(amps::format_mesh(square(), MeshFormat::kPly), SampleFormat::kPly, "radius");
  check_refused("ply", SampleFormat::kPly, "PLY");
  const std::string data = amps::format_samples(on_curves(some_samples(true)), SampleFormat::kPly);
  for (std::size_t size = 0; size < data.size(); size += 7)
    CHECK_THROWS_AS(amps::parse_samples(data.substr(0, size), SampleFormat::kPly), Error);
  CHECK_THROWS_AS(amps::format_samples(SampleSet{}, SampleFormat::kXyzr), Error);
  SampleSet uneven = some_samples(true);
  uneven.facets.pop_back();
  CHECK_THROWS_AS(amps::format_samples(uneven, SampleFormat::kCsv), Error);
}

TEST_CASE("mesh_io: samples whose place on curves makes no sense are not written, nor taken") {
  const SampleSet good = on_curves(some_samples(true));
  CHECK_NOTHROW(amps::detail::require_sample_set(good));
  std::vector<SampleSet> uneven(4, good);
  uneven[0].dimensions.pop_back();
  uneven[1].curves.clear();
  uneven[2].parameters.push_back(0);
  uneven[3].dimensions.clear();
  for (const SampleSet& set : uneven) {
    CHECK(thrown_by([&] { amps::detail::require_sample_set(set); }).code == ErrorCode::kInvalidArgument);
    for (const SampleFormat format : {SampleFormat::kCsv, SampleFormat::kPly, SampleFormat::kXyzr})
      CHECK(thrown_by([&] { amps::format_samples(set, format); }).code == ErrorCode::kInvalidArgument);
  }
  SampleSet senseless = good;
  senseless.dimensions[7] = 3;
  const Thrown thrown = thrown_by([&] { amps::format_samples(senseless, SampleFormat::kPly); });
  CHECK(thrown.code == ErrorCode::kInvalidArgument);
  CHECK(thrown.text.find("sample 7: the dimension") != std::string::npos);
  CHECK_NOTHROW(amps::format_samples(senseless, SampleFormat::kXyzr));
}

}  // namespace amps_test
