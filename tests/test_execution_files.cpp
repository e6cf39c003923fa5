// Files and measures of meshes under an Execution: every reader and writer, from and to memory, streams and files. In small
// steps, cancelled when told to, with the same results as unwatched; a cancelled write leaves the folder as it was.
#include "kit/basics.h"
#include "kit/errors.h"
#include "kit/folder.h"

#include "amps/execution.h"
#include "amps/mesh_io.h"
#include "amps/quality.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>
#include <string>
#include <vector>

namespace amps_test {
namespace {

using amps::Execution;
using amps::MeshFormat;
using amps::Progress;
using amps::SampleFormat;
using amps::SampleSet;

/// A folder whose files are compared.
struct WatchedFolder : Folder {
  /// The content of every file, hidden ones too, by name.
  std::map<std::string, std::string> content() const {
    std::map<std::string, std::string> result;
    for (const auto& entry : fs::directory_iterator(path)) {
      std::ifstream in(entry.path(), std::ios::binary);
      std::ostringstream bytes;
      bytes << in.rdbuf();
      result[entry.path().filename().string()] = bytes.str();
    }
    return result;
  }
};

/// Large enough for many looks in every loop.
const Mesh& mesh() {
  static const Mesh result = amps::make_torus(1, 0.4, 400, 150);
  return result;
}

/// Every vertex of mesh(), as if it had been sampled in a facet.
const SampleSet& samples() {
  static const SampleSet result = [] {
    SampleSet set;
    set.positions = mesh().vertices;
    const auto n = static_cast<std::size_t>(set.positions.rows());
    set.radii.assign(n, 0.125);
    set.facets.assign(n, 3);
    set.barycentrics.resize(set.positions.rows());
    for (std::ptrdiff_t i = 0; i < set.positions.rows(); ++i) set.barycentrics.row(i) << 0.25, 0.25, 0.5;
    return set;
  }();
  return result;
}

std::string numbers_of(const Mesh& read) { return amps::format_mesh(read, MeshFormat::kPly); }

std::string binary_off() {
  std::string data = "OFF BINARY\n";
  const auto put = [&data](std::uint32_t bits) {
    for (int shift = 24; shift >= 0; shift -= 8) data += static_cast<char>(static_cast<unsigned char>(bits >> shift));
  };
  put(static_cast<std::uint32_t>(mesh().vertices.rows()));
  put(static_cast<std::uint32_t>(mesh().triangles.rows()));
  put(0);
  for (std::ptrdiff_t v = 0; v < mesh().vertices.rows(); ++v) {
    for (int k = 0; k < 3; ++k) {
      const auto x = static_cast<float>(mesh().vertices(v, k));
      std::uint32_t bits = 0;
      std::memcpy(&bits, &x, sizeof bits);
      put(bits);
    }
  }
  for (std::ptrdiff_t f = 0; f < mesh().triangles.rows(); ++f) {
    put(3);
    for (int k = 0; k < 3; ++k) put(static_cast<std::uint32_t>(mesh().triangles(f, k)));
    put(0);
  }
  return data;
}

std::string ascii_stl() {
  std::ostringstream out;
  out << "solid torus\n";
  for (std::ptrdiff_t f = 0; f < mesh().triangles.rows(); ++f) {
    out << "facet normal 0 0 0\nouter loop\n";
    for (int k = 0; k < 3; ++k) {
      const auto corner = mesh().vertices.row(mesh().triangles(f, k));
      out << "vertex " << corner[0] << ' ' << corner[1] << ' ' << corner[2] << '\n';
    }
    out << "endloop\nendfacet\n";
  }
  out << "endsolid torus\n";
  return out.str();
}

struct FileCall {
  std::string name;
  std::function<std::string(const Execution&)> run;  ///< the result, as bytes
};

void add_mesh_calls(const fs::path& folder, std::vector<FileCall>& calls) {
  const auto add = [&calls](std::string name, std::function<std::string(const Execution&)> run) {
    calls.push_back({std::move(name), std::move(run)});
  };
  amps::MeshWriteOptions ascii;
  ascii.ascii_ply = true;
  for (const char* extension : {"obj", "off", "ply", "stl"}) {
    const fs::path path = folder / (std::string("mesh.") + extension);
    const MeshFormat format = amps::mesh_format(path);
    const std::string name = extension, data = amps::format_mesh(mesh(), format);
    amps::write_mesh(path, mesh());
    add("parse " + name, [=](const Execution& e) { return numbers_of(amps::parse_mesh(data, format, "memory", e)); });
    add("read " + name, [=](const Execution& e) { return numbers_of(amps::read_mesh(path, e)); });
    add("read a stream of " + name, [=](const Execution& e) {
      std::ifstream in(path, std::ios::binary);
      return numbers_of(amps::read_mesh(in, format, "stream", e));
    });
    add("format " + name, [=](const Execution& e) { return amps::format_mesh(mesh(), format, {}, e); });
    add("write a stream of " + name, [=](const Execution& e) {
      std::ostringstream out;
      amps::write_mesh(out, mesh(), format, {}, e);
      return out.str();
    });
  }
  add("format ascii ply", [=](const Execution& e) { return amps::format_mesh(mesh(), MeshFormat::kPly, ascii, e); });
  const std::string ascii_ply = amps::format_mesh(mesh(), MeshFormat::kPly, ascii);
  add("parse ascii ply",
      [=](const Execution& e) { return numbers_of(amps::parse_mesh(ascii_ply, MeshFormat::kPly, "memory", e)); });
  const std::string off = binary_off(), stl = ascii_stl();
  add("parse binary off", [=](const Execution& e) { return numbers_of(amps::parse_mesh(off, MeshFormat::kOff, "memory", e)); });
  add("parse ascii stl", [=](const Execution& e) { return numbers_of(amps::parse_mesh(stl, MeshFormat::kStl, "memory", e)); });
}

void add_sample_calls(const fs::path& folder, std::vector<FileCall>& calls) {
  for (const char* extension : {"xyzr", "ply", "csv"}) {
    const fs::path path = folder / (std::string("samples.") + extension);
    const SampleFormat format = amps::sample_format(path);
    const std::string name = std::string("samples of ") + extension;
    amps::write_samples(path, samples());
    calls.push_back({"read " + name, [=](const Execution& e) {
                       return amps::format_samples(amps::read_samples(path, e), SampleFormat::kPly);
                     }});
    calls.push_back({"format " + name, [=](const Execution& e) { return amps::format_samples(samples(), format, e); }});
  }
  const auto bytes = [](const std::vector<double>& values) {
    return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(double));
  };
  const fs::path list = folder / "values.txt";
  {
    std::ofstream out(list);
    for (int i = 0; i < 100000; ++i) out << 1 + i % 7 << '\n';
  }
  calls.push_back({"read values", [=](const Execution& e) { return bytes(amps::read_values(list, e)); }});
  calls.push_back({"read a property",
                   [=](const Execution& e) { return bytes(amps::read_vertex_property(folder / "samples.ply", "radius", e)); }});
}

void add_measures(std::vector<FileCall>& calls) {
  const auto bytes = [](const auto& values, std::ptrdiff_t n) {
    return std::string(reinterpret_cast<const char*>(values.data()), static_cast<std::size_t>(n) * sizeof(double));
  };
  const auto n = mesh().triangles.rows();
  calls.push_back({"areas", [=](const Execution& e) { return bytes(amps::facet_areas(mesh(), e), n); }});
  calls.push_back({"area", [](const Execution& e) { return std::to_string(amps::total_area(mesh(), e)); }});
  calls.push_back({"normals", [=](const Execution& e) { return bytes(amps::facet_normals(mesh(), e), 3 * n); }});
  calls.push_back({"box", [](const Execution& e) { return std::to_string(amps::bounding_box(mesh(), e).diagonal()); }});
  calls.push_back({"usable", [](const Execution& e) {
                     amps::require_usable(mesh(), e);
                     return std::string();
                   }});
  calls.push_back(
      {"without isolated vertices", [](const Execution& e) { return numbers_of(amps::remove_isolated_vertices(mesh(), e)); }});
  calls.push_back({"merged", [](const Execution& e) { return numbers_of(amps::merge_equal_vertices(mesh(), e)); }});
  calls.push_back({"topology", [](const Execution& e) {
                     std::ostringstream out;
                     out << amps::topology(mesh(), e);
                     return out.str();
                   }});
  calls.push_back({"check", [](const Execution& e) {
                     std::ostringstream out;
                     out << amps::check(mesh(), e);
                     return out.str();
                   }});
  calls.push_back({"quality", [](const Execution& e) {
                     std::ostringstream out;
                     out << amps::quality(mesh(), e);
                     return out.str();
                   }});
}

std::vector<FileCall> file_calls(const Folder& folder) {
  std::vector<FileCall> calls;
  add_mesh_calls(folder.path, calls);
  add_sample_calls(folder.path, calls);
  add_measures(calls);
  return calls;
}

/// Told every report.
Execution watched(const Progress::Callback& callback) { return Execution(1, Progress(callback, 0)); }

}  // namespace

TEST_CASE("execution of files: the fraction rises to 1 in small steps, and the result is that of an unwatched call") {
  constexpr double kMaxStep = 0.3;
  const WatchedFolder folder;
  for (const FileCall& call : file_calls(folder)) {
    CAPTURE(call.name);
    double last = 0, max_step = 0;
    bool falls = false;
    std::string names;
    const std::string result = call.run(watched([&](const char* stage, double fraction) {
      falls = falls || fraction < last;
      max_step = std::max(max_step, fraction - last);
      last = fraction;
      if (names.find(stage) == std::string::npos) names += stage;
      return true;
    }));
    CHECK(!falls);
    CHECK(last == 1);
    CHECK(max_step <= kMaxStep);
    CHECK(names.size() > 3);
    CHECK(result == call.run(Execution()));
  }
}

TEST_CASE("execution of files: cancelled by its callback, a call throws kCancelled and says no more") {
  const WatchedFolder folder;
  for (const FileCall& call : file_calls(folder)) {
    for (const double when : {0.0, 0.3, 0.6}) {
      CAPTURE(call.name);
      CAPTURE(when);
      bool cancelled = false;
      int later = 0;
      const Execution execution = watched([&](const char*, double fraction) {
        later += cancelled ? 1 : 0;
        cancelled = cancelled || fraction >= when;
        return !cancelled;
      });
      CHECK(error_of([&] { call.run(execution); }) == ErrorCode::kCancelled);
      CHECK(later == 0);
    }
  }
}

TEST_CASE("execution of files: a cancelled write leaves the folder as it was, whether the file was there or not") {
  const WatchedFolder folder;
  { std::ofstream(folder.path / "old.csv") << "as it was"; }
  { std::ofstream(folder.path / "old.off") << "as it was"; }
  const auto before = folder.content();
  for (const char* name : {"old.csv", "new.xyzr", "new.ply", "old.off", "new.stl"}) {
    const fs::path path = folder.path / name;
    const bool of_samples = path.extension() == ".csv" || path.extension() == ".xyzr";
    const auto write = [&](const Execution& execution) {
      if (of_samples) {
        amps::write_samples(path, samples(), execution);
      } else {
        amps::write_mesh(path, mesh(), {}, execution);
      }
    };
    // The disk has the last fifth of the time.
    for (const double when : {0.0, 0.5, 0.81, 0.99}) {
      CAPTURE(name);
      CAPTURE(when);
      bool cancelled = false;
      const Execution execution = watched([&](const char*, double fraction) {
        cancelled = cancelled || fraction >= when;
        return !cancelled;
      });
      CHECK(error_of([&] { write(execution); }) == ErrorCode::kCancelled);
      CHECK(folder.content() == before);
    }
  }
  amps::write_samples(folder.path / "old.csv", samples(), watched([](const char*, double) { return true; }));
  CHECK(folder.content() != before);
}

TEST_CASE("execution of files: a star of many edges at one vertex is sorted with looks between") {
  constexpr Index kSpokes = 200000;
  Mesh star;
  star.vertices.resize(kSpokes + 1);
  star.triangles.resize(kSpokes);
  for (Index k = 0; k < kSpokes; ++k) {
    const Index next = (k + 1) % kSpokes;
    // In an order that a sort has to work at.
    const Index facet = static_cast<Index>((std::int64_t{k} * 77773) % kSpokes);
    star.triangles(facet, 0) = 0;
    star.triangles(facet, 1) = k + 1;
    star.triangles(facet, 2) = next + 1;
  }
  std::map<double, int> reports;
  const amps::TopologyReport report = amps::topology(star, watched([&](const char*, double fraction) {
                                                       ++reports[fraction];
                                                       return true;
                                                     }));
  CHECK(report.components == 1);
  CHECK(report.edges == 2 * kSpokes);
  int max_at_once = 0;
  for (const auto& [fraction, count] : reports) max_at_once = std::max(max_at_once, count);
  CHECK(max_at_once >= 20);  // of some 200,000 · 2 · 18 comparisons, one look in 65,536
}

}  // namespace amps_test
