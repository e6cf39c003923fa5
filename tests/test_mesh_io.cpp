// Files written, read back and left alone where writing fails. Formats and sample sets have files of their own.
#include "amps/mesh_io.h"
#include "amps/file_io.h"

#include "kit/data.h"
#include "kit/mesh_files.h"

#include "amps/shapes.h"

#include <doctest/doctest.h>

#ifdef __linux__
#include <sys/resource.h>

#include <csignal>
#endif

#include <clocale>
#include <cstring>
#include <fstream>
#include <locale>
#include <sstream>
#include <string>
#include <vector>

namespace amps_test {

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
  REQUIRE(rows(back.triangles) == rows(mesh.triangles));
  CHECK(rows(back.vertices) == rows(mesh.vertices));
  for (Index f = 0; f < rows(mesh.triangles); ++f) {
    for (int k = 0; k < 3; ++k) {
      Vec3 expected = MeshView(mesh).corner(f, k);
      for (double& x : expected) {
        const volatile float rounded = static_cast<float>(x);  // GCC 12 loses the rounding of two doubles side by side
        x = static_cast<double>(rounded);
      }
      REQUIRE(MeshView(back).corner(f, k) == expected);
    }
  }
}

TEST_CASE("mesh_io: an empty mesh survives in the formats that can say so") {
  const Mesh empty;
  for (const MeshFormat format : {MeshFormat::kOff, MeshFormat::kPly, MeshFormat::kStl}) {
    CHECK(same_bits(amps::parse_mesh(amps::format_mesh(empty, format), format), empty));
  }
}

TEST_CASE("mesh_io: meshes that could not be read back are not written") {
  Mesh mesh = square();
  mesh.vertices(1, 2) = kInfinity;
  for (const MeshFormat format : kFormats) CHECK(error_of([&] { amps::format_mesh(mesh, format); }) == ErrorCode::kInvalidMesh);
  mesh = square();
  mesh.triangles(0, 0) = 4;
  for (const MeshFormat format : kFormats) CHECK(error_of([&] { amps::format_mesh(mesh, format); }) == ErrorCode::kInvalidMesh);
  mesh = square();
  mesh.vertices(0, 0) = 1e39;
  CHECK(error_text([&] { amps::format_mesh(mesh, MeshFormat::kStl); }).find("too large for STL") != std::string::npos);
}

TEST_CASE("mesh_io: a failed write leaves what was there, and nothing else") {
  const Folder folder;
  const fs::path path = folder.path / "mesh.obj";
  amps::write_mesh(path, square());
  const std::string before = content_of(path);
  Mesh bad = square();
  bad.triangles(0, 0) = -1;
  CHECK_THROWS_AS(amps::write_mesh(path, bad), Error);
  CHECK(content_of(path) == before);

  fs::permissions(path, fs::perms::owner_read);
  CHECK(error_text([&] { amps::write_mesh(path, square()); }).find("read-only") != std::string::npos);
  fs::permissions(path, fs::perms::owner_read | fs::perms::owner_write);
  amps::write_mesh(path, amps::make_cube(1));
  CHECK(fs::status(path).permissions() == (fs::perms::owner_read | fs::perms::owner_write));

  const auto [code, what] = thrown_by([&] { amps::write_mesh(folder.path / "none" / "mesh.ply", square()); });
  CHECK(code == ErrorCode::kFileNotFound);
  CHECK(what.find("mesh.ply: cannot be created") != std::string::npos);
  fs::create_directory(folder.path / "dir.off");
  CHECK(error_of([&] { amps::write_mesh(folder.path / "dir.off", square()); }) == ErrorCode::kFileNotFound);
  CHECK(error_of([&] { amps::write_mesh(folder.path / "mesh.xyz", square()); }) == ErrorCode::kFileFormat);
  CHECK(error_of([&] { amps::write_samples(folder.path / "mesh.obj", some_samples(false)); }) == ErrorCode::kFileFormat);
  CHECK(folder.entries() == 2);
}

#ifdef __linux__
TEST_CASE("mesh_io: a full disk is an error, links are followed, devices are not replaced") {
  const Folder folder;
  fs::create_symlink("/dev/full", folder.path / "full.ply");
  const auto [code, what] = thrown_by([&] { amps::write_mesh(folder.path / "full.ply", square()); });
  CHECK(code == ErrorCode::kFileNotFound);
  CHECK(what.find("full.ply: cannot be written") != std::string::npos);
  CHECK(fs::is_character_file("/dev/full"));
  amps::write_mesh(folder.path / "real.ply", square());
  fs::create_symlink("real.ply", folder.path / "link.ply");
  amps::write_mesh(folder.path / "link.ply", amps::make_cube(2));
  CHECK(fs::is_symlink(folder.path / "link.ply"));
  CHECK(same_bits(amps::read_mesh(folder.path / "real.ply"), amps::make_cube(2)));
  std::ofstream full("/dev/full", std::ios::binary);
  CHECK(error_of([&] { amps::write_mesh(full, square(), MeshFormat::kOff); }) == ErrorCode::kFileNotFound);
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
  const auto [code, what] = thrown_by([&] { amps::write_mesh(path, amps::make_sphere(5000, 1.0)); });
  setrlimit(RLIMIT_FSIZE, &old);
  std::signal(SIGXFSZ, handler);
  CHECK(code == ErrorCode::kFileNotFound);
  CHECK(what.find("mesh.off: cannot be written") != std::string::npos);
  CHECK(same_bits(amps::read_mesh(path), square()));
  CHECK(folder.entries() == 1);
}
#endif

TEST_CASE("mesh_io: files that cannot be opened are an error that names them") {
  const Folder folder;
  for (const char* extension : kExtensions) {
    const std::string name = std::string("nothing") + extension;
    const auto [code, what] = thrown_by([&] { amps::read_mesh(folder.path / name); });
    CHECK(code == ErrorCode::kFileNotFound);
    CHECK(what.find(name) != std::string::npos);
    std::ofstream(folder.path / name, std::ios::binary).flush();
    CHECK(error_of([&] { amps::read_mesh(folder.path / name); }) == ErrorCode::kFileFormat);
  }
  CHECK(error_of([&] { amps::read_samples(folder.path / "nothing.csv"); }) == ErrorCode::kFileNotFound);
  CHECK(error_of([&] { amps::read_mesh("mesh"); }) == ErrorCode::kFileFormat);
  CHECK(error_of([&] { amps::read_mesh("mesh.xyzr"); }) == ErrorCode::kFileFormat);
  fs::create_directory(folder.path / "dir.off");
  CHECK(error_text([&] { amps::read_mesh(folder.path / "dir.off"); }).find("directory") != std::string::npos);
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
  Rng rng(3);
  std::vector<std::string> texts = {"0",      "-0",     "1",       ".5",      "5.",  "1e5", "1E-5", "+2", "1e400",
                                    "-1e400", "1e-400", "-1e-310", "1e99999", "",    "-",   ".",    "e5", "1e",
                                    "1e+",    "1x",     "0x1",     "1.2.3",   "1 2", "--1", "a1"};
  const Mesh hard = hard_mesh();
  for (int i = 0; i < 300; ++i) amps::detail::append_number(texts.emplace_back(), hard.vertices(below(rng, 500), 0));
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
    const Mesh mesh = data_mesh_or(name, amps::make_torus());
    for (const MeshFormat format : {MeshFormat::kObj, MeshFormat::kOff, MeshFormat::kPly}) {
      CHECK(same_bits(amps::parse_mesh(amps::format_mesh(mesh, format), format), mesh));
    }
    const Mesh stl = amps::parse_mesh(amps::format_mesh(mesh, MeshFormat::kStl), MeshFormat::kStl);
    CHECK(rows(stl.triangles) == rows(mesh.triangles));
  }
}

TEST_CASE("mesh_io: edges of a mesh are lines of OBJ, which reading a mesh passes over and reading marks gives back") {
  const Mesh square = amps::make_square(1);
  amps::MeshWriteOptions options;
  options.edges = {{0, 1}, {3, 2}};
  const std::string obj = amps::format_mesh(square, MeshFormat::kObj, options);
  CHECK(obj.find("\nl 1 2\nl 4 3\n") != std::string::npos);
  CHECK(amps::parse_mesh(obj, MeshFormat::kObj).triangles == square.triangles);
  CHECK(amps::format_mesh(square, MeshFormat::kOff, options) == amps::format_mesh(square, MeshFormat::kOff));
  const amps::MeshMarks marks = amps::parse_mesh_marks(obj, MeshFormat::kObj);
  CHECK(marks.edges == options.edges);
  CHECK(marks.vertices.empty());
  const Folder folder;
  amps::write_mesh(folder.path / "square.obj", square, options);
  CHECK(amps::read_mesh_marks(folder.path / "square.obj").edges == options.edges);
  CHECK(error_text([&] { amps::read_mesh_marks(folder.path / "square.ply"); }).find("OBJ files only") != std::string::npos);
  CHECK(error_of([&] { amps::read_mesh_marks(folder.path / "none.obj"); }) == ErrorCode::kFileNotFound);
  options.vertices = {2, 0};
  const amps::MeshMarks both = amps::parse_mesh_marks(amps::format_mesh(square, MeshFormat::kObj, options), MeshFormat::kObj);
  CHECK(both.edges == options.edges);
  CHECK(both.vertices == options.vertices);
  options.edges = {{0, 4}};
  CHECK_THROWS_AS(amps::format_mesh(square, MeshFormat::kObj, options), amps::Error);
  options.edges.clear();
  options.vertices = {-1};
  CHECK_THROWS_AS(amps::format_mesh(square, MeshFormat::kObj, options), amps::Error);
}

TEST_CASE("mesh_io: labels of facets are groups of OBJ and a property of PLY, and the mesh is read back as it was") {
  const Mesh mesh = amps::make_sphere(200, 1.0);
  amps::MeshWriteOptions options;
  for (Index f = 0; f < rows(mesh.triangles); ++f) options.labels.push_back(f < 50 ? 7 : f < 100 ? -1 : 0);
  for (const bool ascii : {false, true}) {
    options.ascii_ply = ascii;
    for (const MeshFormat format : {MeshFormat::kObj, MeshFormat::kOff, MeshFormat::kPly}) {
      CAPTURE(static_cast<int>(format));
      CHECK(same_bits(amps::parse_mesh(amps::format_mesh(mesh, format, options), format), mesh));
    }
  }
  CHECK(amps::format_mesh(mesh, MeshFormat::kOff, options) == amps::format_mesh(mesh, MeshFormat::kOff));
  CHECK(amps::format_mesh(mesh, MeshFormat::kStl, options) == amps::format_mesh(mesh, MeshFormat::kStl));

  // Read by another reader: the group that each face stands in.
  options.label_name = "part_2";
  std::istringstream obj(amps::format_mesh(mesh, MeshFormat::kObj, options));
  std::vector<Index> found;
  int groups = 0;
  for (std::string line, group; std::getline(obj, line);) {
    if (line[0] == 'g') group = line.substr(2), ++groups;
    if (line[0] != 'f') continue;
    REQUIRE(group.substr(0, 7) == "part_2_");
    found.push_back(static_cast<Index>(std::stoi(group.substr(7))));
  }
  CHECK(found == options.labels);
  CHECK(groups == 3);
  // However labels are mixed, there is one group of each.
  amps::MeshWriteOptions mixed;
  for (Index f = 0; f < rows(mesh.triangles); ++f) mixed.labels.push_back(f % 3 == 0 ? 4 : f % 2);
  const std::string text = amps::format_mesh(mesh, MeshFormat::kObj, mixed);
  for (const char* group : {"g patch_4\n", "g patch_1\n", "g patch_0\n"}) {
    CHECK(text.find(group) != std::string::npos);
    CHECK(text.find(group) == text.rfind(group));
  }
  const Mesh grouped = amps::parse_mesh(text, MeshFormat::kObj);
  CHECK(rows(grouped.triangles) == rows(mesh.triangles));
  CHECK(grouped.triangles.row(0) == mesh.triangles.row(0));  // of 4, the number that comes first
  CHECK(grouped.triangles.row(1) == mesh.triangles.row(3));
  std::istringstream ply(amps::format_mesh(mesh, MeshFormat::kPly, options));
  std::string line;
  bool told = false;
  while (line != "end_header") {
    REQUIRE(std::getline(ply, line));
    told = told || line == "property int part_2";
  }
  CHECK(told);
  for (Index v = 0; v < rows(mesh.vertices); ++v) std::getline(ply, line);
  found.clear();
  for (Index f = 0; f < rows(mesh.triangles); ++f) {
    Index size, a, b, c, label;
    ply >> size >> a >> b >> c >> label;
    REQUIRE(static_cast<bool>(ply));
    found.push_back(label);
  }
  CHECK(found == options.labels);
}

TEST_CASE("mesh_io: labels that cannot be are refused in every format") {
  const Mesh mesh = square();
  for (const MeshFormat format : kFormats) {
    amps::MeshWriteOptions options;
    options.labels = {1};
    CHECK(error_text([&] { amps::format_mesh(mesh, format, options); }).find("1 labels for 2 facets") != std::string::npos);
    options.labels = {1, 2};
    for (const char* name : {"", "a patch", "patch\n"}) {
      options.label_name = name;
      CHECK(error_of([&] { amps::format_mesh(mesh, format, options); }) == ErrorCode::kInvalidArgument);
    }
  }
}

}  // namespace amps_test
