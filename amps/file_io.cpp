#define AMPS_OWN_SOURCE
#include "amps/file_io.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
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

void fail_file(const std::filesystem::path& path, const std::string& what) {
  throw Error(ErrorCode::kFileNotFound, path.string() + ": " + what);
}

std::string system_message() { return std::error_code(errno != 0 ? errno : EIO, std::generic_category()).message(); }

std::vector<std::string_view> text_pieces(std::string_view text, const Execution& run) {
  constexpr char kFirstOfByteOrderMark = '\xEF';  // which readers skip where they start
  std::vector<std::string_view> pieces;
  while (text.size() > kTextPiece) {
    run.check();
    std::size_t end = kTextPiece;
    for (; end < text.size(); ++end) {
      const bool ends_line = text[end - 1] == '\n' || (text[end - 1] == '\r' && text[end] != '\n');
      if (!ends_line || text[end] == kFirstOfByteOrderMark) continue;
      const std::size_t last = text[end - 1] == '\n' && text[end - 2] == '\r' ? end - 3 : end - 2;
      if (text[last] != '\\') break;
    }
    pieces.push_back(text.substr(0, end));
    text.remove_prefix(end);
  }
  if (!text.empty()) pieces.push_back(text);
  return pieces;
}

RowPieces::RowPieces(const IoSource& source, const char* from, std::int64_t num_rows) : rows(num_rows) {
  pieces = text_pieces({from, static_cast<std::size_t>(source.end() - from)}, source.run);
  ends.resize(pieces.size());
  parallel_for(pieces.size(), 1, source.run, [&](std::size_t k, std::size_t) {
    const bool ends_in_line = k + 1 == pieces.size() && pieces[k].back() != '\n';
    ends[k] = std::count(pieces[k].begin(), pieces[k].end(), '\n') + (ends_in_line ? 1 : 0);
  });
  std::int64_t total = 0;
  for (std::int64_t& end : ends) {
    total += end;
    end = std::min(total, rows);
  }
}

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
  if (!out) throw Error(ErrorCode::kFileNotFound, "stream: it cannot be written to; check what it leads to");
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

}  // namespace detail
}  // namespace amps
