// folder.h: a folder for the files of a test.
#pragma once

#include <doctest/doctest.h>

#include <cstddef>
#include <filesystem>
#include <iterator>
#include <string>
#include <system_error>

namespace amps_test {

namespace fs = std::filesystem;

/// An empty directory of this test's own, removed at the end.
struct Folder {
  fs::path path;
  Folder() {
    for (int i = 0; path.empty(); ++i) {
      const fs::path candidate = fs::temp_directory_path() / ("amps_test_" + std::to_string(i));
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

}  // namespace amps_test
