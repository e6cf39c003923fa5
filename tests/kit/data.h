// data.h: real meshes for tests, where the machine has them, and a stand-in where it does not.
#pragma once

#include "amps/mesh.h"
#include "amps/mesh_io.h"

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>

namespace amps_test {

/// The path of a test mesh, or nothing if this machine does not have it. The folder is the compile definition
/// AMPS_TEST_DATA_DIR, else the environment variable AMPS_TEST_DATA, else ../shared/data.
inline std::optional<std::string> data_file(const std::string& name) {
#ifdef AMPS_TEST_DATA_DIR
  const std::filesystem::path folder = AMPS_TEST_DATA_DIR;
#else
  const char* const from_environment = std::getenv("AMPS_TEST_DATA");
  const std::filesystem::path folder = from_environment != nullptr ? from_environment : "../shared/data";
#endif
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(folder / name, ignored)) return std::nullopt;
  return (folder / name).string();
}

/// The test mesh of that name, or `stand_in` where there is none.
inline amps::Mesh data_mesh_or(const std::string& name, const amps::Mesh& stand_in) {
  const std::optional<std::string> path = data_file(name);
  return path ? amps::read_mesh(*path) : stand_in;
}

}  // namespace amps_test
