// cli_files.h: files of the program `amps`, looked at before the work and written whole or not at all.
#pragma once

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_output.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>
#include <vector>

namespace fs = std::filesystem;

/// Finds out before the work, not after it, that a result could not be written.
inline void require_writable(const Arguments& arguments, const fs::path& path) {
  std::error_code ignored;
  if (path.empty()) throw arguments.error("the name of an output file is empty");
  if (fs::is_directory(path, ignored)) throw arguments.error(path.string() + " is a directory, name a file in it");
  const fs::path directory = path.has_parent_path() ? path.parent_path() : fs::path(".");
  if (!fs::is_directory(directory, ignored)) {
    throw arguments.error("cannot write " + path.string() + ": there is no directory " + directory.string() +
                          ", make it first");
  }
}

/// Of the output file and what options name beside it, no two are the same file: the later one would take the place of the
/// other.
inline void require_distinct(const Arguments& arguments, const fs::path& out, const std::vector<const char*>& options) {
  std::vector<fs::path> paths{fs::weakly_canonical(fs::absolute(out))};
  for (const char* option : options) {
    if (!arguments.has(option)) continue;
    paths.push_back(fs::weakly_canonical(fs::absolute(arguments.text(option))));
    if (std::find(paths.begin(), paths.end() - 1, paths.back()) != paths.end() - 1) {
      throw arguments.error(std::string(option) + " names " + arguments.text(option) +
                            ", which is written already; name another file");
    }
  }
}

/// Writes all or nothing, as the library's writers do.
inline void write_file(const fs::path& path, const std::string& bytes) {
  std::error_code ignored;
  const bool in_place = fs::exists(path, ignored) && !fs::is_regular_file(path, ignored);  // a device or pipe
  fs::path temporary = path;
  if (!in_place) temporary += ".part";
  std::ofstream out(temporary, std::ios::binary);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  out.close();
  std::error_code trouble;
  if (out && !in_place) fs::rename(temporary, path, trouble);
  if (!out || trouble) {
    if (!in_place) fs::remove(temporary, ignored);
    throw amps::Error(amps::ErrorCode::kFileNotFound,
                      "cannot write " + path.string() + "; check that its directory can be written to and has space");
  }
}

/// Reads a mesh that can be sampled; errors name the file.
inline amps::Mesh load(const fs::path& path, const amps::Execution& execution) {
  amps::Mesh mesh = amps::read_mesh(path, execution.part(0, 0.8));
  try {
    amps::require_usable(mesh, execution.part(0.8, 1));
  } catch (const amps::Error& error) {
    throw amps::Error(error.code(), path.string() + ": " + error.what());
  }
  return mesh;
}

/// The extension decides the format: an unknown one is refused here.
inline void require_mesh_output(const Arguments& arguments, const std::string& path) {
  require_writable(arguments, path);
  amps::mesh_format(path);
}

/// Lines are in OBJ files only.
inline void require_line_output(const Arguments& arguments, const std::string& path) {
  require_mesh_output(arguments, path);
  if (amps::mesh_format(path) != amps::MeshFormat::kObj) {
    throw arguments.error("no lines can be in " + path + ": name an .obj file");
  }
}

inline void require_picture_output(const Arguments& arguments, const std::string& path) {
  std::string extension = fs::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  if (extension != ".png") throw arguments.error("cannot draw " + path + ": name a .png file");
  require_writable(arguments, path);
}

inline void require_sample_output(const Arguments& arguments, const std::string& path) {
  require_writable(arguments, path);
  amps::sample_format(path);
}

/// The head of every statistics file.
inline Json begin_json(const char* command) {
  Json json;
  json.open()
      .add("program", std::string("amps"))
      .add("version", format("%d.%d.%d", AMPS_VERSION_MAJOR, AMPS_VERSION_MINOR, AMPS_VERSION_PATCH));
  json.add("command", std::string(command));
  return json;
}

inline void write_json(const Arguments& arguments, Json& json) {
  if (arguments.has("--json")) write_file(arguments.text("--json"), json.close().text());
}
