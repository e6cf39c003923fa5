#define AMPS_OWN_SOURCE
#include "amps/file_io.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <istream>
#include <limits>
#include <locale>
#include <ostream>
#include <sstream>
#include <system_error>
#include <utility>
#include <vector>

#if defined(__cpp_lib_to_chars) && __cpp_lib_to_chars >= 201611L
#define AMPS_HAS_DOUBLE_CHARCONV 1
#else
#define AMPS_HAS_DOUBLE_CHARCONV 0
#endif

namespace amps {
namespace detail {
namespace {

// [+-] digits [. digits] [e [+-] digits], with a digit before or behind the point.
bool is_decimal_number(std::string_view token) {
  std::size_t i = 0;
  const auto sign = [&] { i += i < token.size() && (token[i] == '+' || token[i] == '-') ? 1 : 0; };
  const auto digits = [&] {
    const std::size_t from = i;
    while (i < token.size() && token[i] >= '0' && token[i] <= '9') ++i;
    return i - from;
  };
  sign();
  std::size_t count = digits();
  if (i < token.size() && token[i] == '.') {
    ++i;
    count += digits();
  }
  if (count == 0) return false;
  if (i < token.size() && (token[i] == 'e' || token[i] == 'E')) {
    ++i;
    sign();
    if (digits() == 0) return false;
  }
  return i == token.size();
}

}  // namespace

bool parse_double_slowly(std::string_view token, double& value) {
  if (!is_decimal_number(token)) return false;
  std::istringstream in{std::string(token)};
  in.imbue(std::locale::classic());
  in >> value;
  // Out of range, libraries differ in what they call a failure, but all leave the nearest double.
  if (!in && std::abs(value) >= std::numeric_limits<double>::max()) {
    value = std::copysign(std::numeric_limits<double>::infinity(), value);
  }
  return true;
}

bool parse_double(const char* p, const char* end, double& value) {
  if (p < end && *p == '+') {
    ++p;
    if (p < end && *p == '-') return false;
  }
  if (p == end) return false;
#if AMPS_HAS_DOUBLE_CHARCONV
  const auto [stop, status] = std::from_chars(p, end, value);
  if (status == std::errc()) return stop == end;
  if (status != std::errc::result_out_of_range || stop != end) return false;
#endif
  return parse_double_slowly({p, static_cast<std::size_t>(end - p)}, value);
}

bool parse_integer(const char*& p, const char* end, std::int64_t& value) {
  const char* from = p < end && *p == '+' ? p + 1 : p;
  if (from != p && from < end && *from == '-') return false;
  const auto [stop, status] = std::from_chars(from, end, value);
  if (status != std::errc()) return false;
  p = stop;
  return true;
}

#undef AMPS_HAS_DOUBLE_CHARCONV

void append_number(std::string& out, std::int64_t value) {
  char digits[24];
  out.append(digits, std::to_chars(digits, digits + sizeof digits, value).ptr);
}

namespace {

[[noreturn]] void fail_file(const std::filesystem::path& path, const std::string& what) {
  throw Error(ErrorCode::kFileNotFound, path.string() + ": " + what);
}

// The system's word for the last error.
std::string system_message() { return std::error_code(errno != 0 ? errno : EIO, std::generic_category()).message(); }

/// Read or written between two looks: a few milliseconds.
constexpr std::size_t kBytesPerPiece = std::size_t{1} << 22;

// An open output file, closed and, unless it was completed, removed at the end of its scope.
struct OutputFile {
  std::filesystem::path path;
  std::FILE* file = nullptr;
  bool remove_it = true;

  OutputFile() = default;
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;
  ~OutputFile() {
    if (file != nullptr) std::fclose(file);
    std::error_code ignored;
    if (remove_it && !path.empty()) std::filesystem::remove(path, ignored);
  }

  // False (and errno) on failure. Close reports what a full disk or a network drive kept back.
  bool write_and_close(const std::string& content, const Execution& run) {
    errno = 0;
    bool written = true;
    for (std::size_t at = 0; written && at < content.size();) {
      const std::size_t piece = std::min(content.size() - at, kBytesPerPiece);
      written = std::fwrite(content.data() + at, 1, piece, file) == piece;
      at += piece;
      run.report(static_cast<double>(at) / static_cast<double>(content.size()));
    }
    written = written && std::fflush(file) == 0;
    const int write_error = errno;
    const bool closed = std::fclose(file) == 0;
    file = nullptr;
    if (!written) errno = write_error;
    return written && closed;
  }
};

// Opens a file that did not exist, in the directory of `target`.
void open_temporary(OutputFile& output, const std::filesystem::path& target) {
  constexpr int most_tries = 10000;  // names taken by other writers, or left by programs that were killed
  for (int i = 0; i < most_tries; ++i) {
    const std::filesystem::path name = target.parent_path() / (".amps-" + std::to_string(i) + ".tmp");
    errno = 0;
    output.file = std::fopen(name.string().c_str(), "wbx");  // x: fails if it exists, so two writers never share one
    if (output.file != nullptr) {
      output.path = name;
      return;
    }
    if (errno != EEXIST) break;
  }
  fail_file(target, "cannot be created: " + system_message() + "; check that its directory exists and can be written");
}

}  // namespace

std::string lower_extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return extension;
}

std::string read_whole_stream(std::istream& in, const std::string& name, std::size_t expected_size, const Execution& run) {
  // Strings that never grow beyond what they reserve, since to copy what was read takes long. A file of the expected size
  // takes one, with a byte to spare to see its end.
  constexpr double kShareOfReading = 0.7;
  std::vector<std::string> strings;
  std::size_t size = 0;
  while (in) {
    if (strings.empty() || strings.back().size() == strings.back().capacity()) {
      strings.emplace_back().reserve(std::max({expected_size > size ? expected_size - size + 1 : 0, size, kBytesPerPiece}));
    }
    std::string& data = strings.back();
    const std::size_t before = data.size();
    data.resize(before + std::min(data.capacity() - before, kBytesPerPiece));
    in.read(&data[before], static_cast<std::streamsize>(data.size() - before));
    data.resize(before + static_cast<std::size_t>(in.gcount()));
    size += data.size() - before;
    run.report(kShareOfReading * static_cast<double>(size) /
               static_cast<double>(std::max(size, expected_size) + kBytesPerPiece));
  }
  if (in.bad()) throw Error(ErrorCode::kFileNotFound, name + ": cannot be read: " + system_message() + "; check the device");
  if (strings.empty()) return {};
  if (strings.size() == 1) return std::move(strings.front());
  std::string joined;
  joined.reserve(size);
  Ticker ticker(run.part(kShareOfReading, 1), size, 1);
  for (std::string& data : strings) {
    for (std::size_t at = 0; at < data.size(); at += kBytesPerPiece) {
      joined.append(data, at, kBytesPerPiece);
      ticker.tick(kBytesPerPiece);
    }
    data = std::string();
  }
  return joined;
}

void write_whole_stream(std::ostream& out, const std::string& content, const Execution& run) {
  for (std::size_t at = 0; at < content.size(); at += kBytesPerPiece) {
    out.write(content.data() + at, static_cast<std::streamsize>(std::min(content.size() - at, kBytesPerPiece)));
    run.report(static_cast<double>(at) / static_cast<double>(content.size()));
  }
  out.flush();
  if (!out) throw Error(ErrorCode::kFileNotFound, "stream: the mesh cannot be written to it; check what it leads to");
}

std::string read_whole_file(const std::filesystem::path& path, const Execution& run) {
  std::error_code status;
  if (std::filesystem::is_directory(path, status)) fail_file(path, "is a directory; name a file");
  errno = 0;
  std::ifstream in(path, std::ios::binary);
  if (!in) fail_file(path, "cannot be opened: " + system_message() + "; check its name and permissions");
  const auto size = std::filesystem::file_size(path, status);
  return read_whole_stream(in, path.string(), status ? 0 : static_cast<std::size_t>(size), run);
}

void replace_file(const std::filesystem::path& path, const std::string& content, const Execution& run) {
  namespace fs = std::filesystem;
  std::error_code error;
  fs::path target = path;
  if (fs::is_symlink(path, error)) {
    target = fs::canonical(path, error);
    if (error) fail_file(path, "is a link to nothing: " + error.message() + "; remove it");
  }
  const fs::file_status status = fs::status(target, error);
  if (fs::is_directory(status)) fail_file(path, "is a directory; name a file");
  const bool exists = fs::exists(status);
  const char* const remedy = "; free some space or choose another place";
  OutputFile output;
  if (exists && !fs::is_regular_file(status)) {  // a device or pipe: renaming would replace it by a file
    output.remove_it = false;
    errno = 0;
    output.file = std::fopen(target.string().c_str(), "wb");
    if (output.file == nullptr) fail_file(path, "cannot be opened: " + system_message() + "; check its permissions");
    if (!output.write_and_close(content, run)) fail_file(path, "cannot be written: " + system_message() + remedy);
    return;
  }
  // Renaming would get past the protection of a file, so look at it first.
  constexpr fs::perms any_write = fs::perms::owner_write | fs::perms::group_write | fs::perms::others_write;
  if (exists && (status.permissions() & any_write) == fs::perms::none) {
    fail_file(path, "is read-only; change its permissions or choose another name");
  }
  open_temporary(output, target);
  if (!output.write_and_close(content, run)) fail_file(path, "cannot be written: " + system_message() + remedy);
  if (exists) fs::permissions(output.path, status.permissions(), error);  // best effort
  fs::rename(output.path, target, error);
  if (error) fail_file(path, "cannot be replaced: " + error.message() + "; check its permissions");
  output.remove_it = false;
}

}  // namespace detail
}  // namespace amps
