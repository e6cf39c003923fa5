// Meshes read and written in pieces by several threads: the same bits, and of damaged files the same errors, as by one thread.
#include "kit/basics.h"

#include "amps/base.h"
#include "amps/mesh_io.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <cstddef>
#include <string>
#include <vector>

namespace amps_test {
namespace {

using amps::MeshFormat;
using amps::Rng;

constexpr unsigned kThreads = 4;

/// A torus of several pieces, whatever the format.
const Mesh& torus() {
  static const Mesh result = amps::make_torus(1, 0.4, 300, 150);
  return result;
}

struct TextFile {
  MeshFormat format;
  std::string text;
};

std::vector<TextFile> text_files() {
  amps::MeshWriteOptions ascii;
  ascii.ascii_ply = true;
  return {{MeshFormat::kObj, amps::format_mesh(torus(), MeshFormat::kObj)},
          {MeshFormat::kOff, amps::format_mesh(torus(), MeshFormat::kOff)},
          {MeshFormat::kPly, amps::format_mesh(torus(), MeshFormat::kPly, ascii)}};
}

/// All that a reader finds, or its error, in full.
std::string outcome(const TextFile& file, unsigned threads) {
  try {
    const Mesh mesh = amps::parse_mesh(file.text, file.format, "memory", threads);
    std::string result = amps::format_mesh(mesh, MeshFormat::kPly);
    for (const amps::Index polygon : mesh.polygons) result += ' ' + std::to_string(polygon);
    return result;
  } catch (const amps::Error& error) {
    return std::string("error: ") + error.what();
  }
}

bool is_error(const std::string& outcome) { return outcome.compare(0, 6, "error:") == 0; }

/// The beginning of a random line.
std::size_t random_line(const std::string& text, Rng& rng) {
  const auto at = static_cast<std::size_t>(rng.uniform() * static_cast<double>(text.size()));
  return text.find('\n', at) == std::string::npos ? text.rfind('\n') + 1 : text.find('\n', at) + 1;
}

std::string with_line_ends(const std::string& text, const std::string& end) {
  std::string result;
  for (const char c : text) c == '\n' ? result += end : result += c;
  return result;
}

}  // namespace

TEST_CASE("mesh files in pieces: every format is written with the same bits by several threads") {
  amps::MeshWriteOptions options;
  for (std::ptrdiff_t f = 0; f < torus().triangles.rows(); ++f) options.labels.push_back(static_cast<amps::Index>(f % 3));
  options.edges = {{0, 1}, {5, 7}};
  options.vertices = {3};
  for (const bool ascii : {false, true}) {
    options.ascii_ply = ascii;
    for (const MeshFormat format : {MeshFormat::kObj, MeshFormat::kOff, MeshFormat::kPly, MeshFormat::kStl}) {
      CHECK(amps::format_mesh(torus(), format, options, 1) == amps::format_mesh(torus(), format, options, kThreads));
    }
  }
}

TEST_CASE("mesh files in pieces: every text format is read with the same bits by several threads, whatever the ends of lines") {
  for (const TextFile& file : text_files()) {
    CHECK(file.text.size() > 3000000);
    for (const char* end : {"\n", "\r\n", "\r", " # a comment\n", "\n\n"}) {
      if (file.format == MeshFormat::kPly && end[0] == ' ') continue;  // there are none
      if (file.format == MeshFormat::kPly && end[0] == '\n' && end[1] == '\n') continue;
      CAPTURE(end);
      const TextFile changed{file.format, with_line_ends(file.text, end)};
      const std::string by_one = outcome(changed, 1);
      CHECK(!is_error(by_one));
      CHECK(by_one == outcome(changed, kThreads));
    }
  }
}

TEST_CASE("mesh files in pieces: lines that are damaged, doubled, missing or in excess have the same outcome") {
  Rng rng(1);
  const std::vector<TextFile> files = text_files();
  const char* const lines[] = {"x\n",          "v 1 2\n",        "3 0 1\n",          "1 2 3\n",
                               "\n",           "# \\\n",         "f 1 2 3 4\n",      "\\\n",
                               "f -1 -2 -3\n", "nan 0 0\n",      "f 1 2 99999999\n", "3 0 1 99999999\n",
                               "v 0 0 0 \\\n", "\xEF\xBB\xBF\n", "4 0 1 2 3\n",      "g a\n"};
  int errors = 0, rounds = 0;
  for (const TextFile& file : files) {
    for (const char* line : lines) {
      CAPTURE(line);
      TextFile changed = file;
      changed.text.insert(random_line(file.text, rng), line);
      const std::string by_one = outcome(changed, 1);
      errors += is_error(by_one) ? 1 : 0;
      ++rounds;
      CHECK(by_one == outcome(changed, kThreads));
    }
    for (const std::size_t cut : {std::size_t{1}, file.text.size() / 3}) {
      TextFile changed = file;
      changed.text.resize(file.text.size() - cut);
      CHECK(outcome(changed, 1) == outcome(changed, kThreads));
      changed.text = file.text;
      const std::size_t from = random_line(file.text, rng);
      changed.text.erase(from, file.text.find('\n', from) + 1 - from);
      CHECK(outcome(changed, 1) == outcome(changed, kThreads));
    }
  }
  CHECK(errors > rounds / 4);
  CHECK(errors < rounds);
}

TEST_CASE("mesh files in pieces: polygons, and values of a row on several lines") {
  std::string obj, ply =
                       "ply\nformat ascii 1.0\nelement vertex 40000\nproperty float x\nproperty float y\nproperty float z\n"
                       "element face 39996\nproperty list uchar int vertex_indices\nend_header\n";
  for (int v = 0; v < 40000; ++v) {
    const std::string xyz = std::to_string(v % 200) + " " + std::to_string(v / 200) + " " + std::to_string(v % 7);
    obj += "v " + xyz + '\n';
    ply += v % 1000 == 999 ? std::to_string(v % 200) + "\n" + std::to_string(v / 200) + " " + std::to_string(v % 7) : xyz;
    ply += v % 1000 == 998 ? ' ' : '\n';  // two rows on two lines, but not a row on each
  }
  for (int f = 0; f < 39996; ++f) {
    const int size = 3 + f % 3;
    obj += "f";
    ply += std::to_string(size);
    for (int k = 0; k < size; ++k) {
      obj += ' ' + std::to_string(f + k + 1) + "/1";
      ply += ' ' + std::to_string(f + k);
    }
    obj += '\n';
    ply += '\n';
  }
  for (const TextFile& file : {TextFile{MeshFormat::kObj, obj}, TextFile{MeshFormat::kPly, ply}}) {
    const std::string by_one = outcome(file, 1);
    CHECK(!is_error(by_one));
    CHECK(by_one == outcome(file, kThreads));
  }
}

}  // namespace amps_test
