// file_io.h: (internal) what readers and writers of files share — errors that name the place, numbers that do not depend on
// the locale, a cursor over lines and tokens, bytes in either order, and files that are written whole or not at all.
#pragma once

#include "amps/base.h"
#include "amps/decimal.h"
#include "amps/execution.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <iosfwd>
#include <string>
#include <string_view>
#include <vector>

namespace amps {
namespace detail {

/// What is being read, for errors. Lines are counted only when one is reported, so that parsing keeps no count.
struct IoSource {
  std::string_view data;
  const std::string& name;
  Execution run = {};                 ///< told how far the reader is
  mutable std::size_t next_look = 0;  ///< in bytes

  /// To be called once a line or record, with the place it begins; throws when cancelled.
  void look(const char* where) const {
    const auto at = static_cast<std::size_t>(where - begin());
    if (at < next_look) return;
    constexpr std::size_t kBytesPerLook = 1 << 16;  // of text: a millisecond
    next_look = at + kBytesPerLook;
    run.report(static_cast<double>(at) / static_cast<double>(data.size() + 1));
  }

  const char* begin() const { return data.data(); }
  const char* end() const { return data.data() + data.size(); }

  [[noreturn]] void fail(const std::string& what, ErrorCode code = ErrorCode::kFileFormat) const {
    throw Error(code, name + ": " + what);
  }
  [[noreturn]] void fail_line(const char* where, const std::string& what) const {
    fail("line " + std::to_string(1 + lines_between(begin(), where)) + ": " + what);
  }
  /// Ends of lines in [from, to).
  std::size_t lines_between(const char* from, const char* to) const {
    std::size_t lines = 0;
    for (const char* p = from; p < to; ++p) lines += *p == '\n' || (*p == '\r' && (p + 1 == end() || p[1] != '\n')) ? 1 : 0;
    return lines;
  }
  [[noreturn]] void fail_byte(const char* where, const std::string& what) const {
    fail("byte " + std::to_string(where - begin()) + ": " + what);
  }
};

/// The remedy for most errors.
inline std::string cut_short_or_not(const char* format) { return std::string("; the file is cut short or is not ") + format; }

/// Parses a decimal number that fills [p, end); false if it is none. What is too large becomes an infinity, what is too small
/// a denormal or zero. "nan" and "inf" may or may not be taken for numbers, so look at the result.
bool parse_double(const char* p, const char* end, double& value);

/// The same by streams: where from_chars cannot read doubles, and for numbers out of range.
bool parse_double_slowly(std::string_view token, double& value);

/// Parses an integer at p and moves p behind it; false, and p unmoved, if there is none or it is too large.
bool parse_integer(const char*& p, const char* end, std::int64_t& value);

void append_number(std::string& out, std::int64_t value);

inline bool is_token_end(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == '\v' || c == '\f'; }

/// A cursor over text. The end of a line is \n, \r\n or \r. With `comment` set, that character hides the rest of a line; with
// `continuation`, a backslash before the end of a line joins it to the next.
struct TextCursor {
  const IoSource& source;
  const char* p;
  char comment = '#';
  bool continuation = false;

  explicit TextCursor(const IoSource& from) : source(from), p(from.begin()) {
    if (source.data.substr(0, 3) == "\xEF\xBB\xBF") p += 3;  // byte order mark of UTF-8
  }

  bool at_end() const { return p == source.end(); }

  static bool is_line_end(char c) { return c == '\n' || c == '\r'; }

  // Skips blanks; true if something is left on this line.
  bool more_on_line() {
    for (; p < source.end(); ++p) {
      if (continuation && *p == '\\' && p + 1 < source.end() && is_line_end(p[1])) {
        if (p[1] == '\r' && p + 2 < source.end() && p[2] == '\n') ++p;
        ++p;
      } else if (is_line_end(*p) || *p == comment) {
        return false;
      } else if (!is_token_end(*p)) {
        return true;
      }
    }
    return false;
  }

  void skip_line() {
    while (p < source.end() && !is_line_end(*p)) ++p;
    if (p < source.end()) ++p;  // the \n of \r\n is an empty line, and those are skipped everywhere
  }

  // Goes to the next line that holds something, at or after p; false at the end of the text.
  bool next_content() {
    source.look(p);
    while (!more_on_line()) {
      if (at_end()) return false;
      skip_line();
    }
    return true;
  }

  // The token at p, which must not be blank; moves behind it.
  std::string_view token() {
    const char* from = p;
    while (p < source.end() && !is_token_end(*p) && (p == from || *p != comment)) ++p;
    // A backslash glued to the last token of a continued line.
    if (continuation && p - from > 1 && p[-1] == '\\' && p < source.end() && is_line_end(*p)) --p;
    return {from, static_cast<std::size_t>(p - from)};
  }

  // Reads numbers from this line until `wanted` are there; returns how many were.
  int numbers(double* values, int wanted) {
    for (int k = 0; k < wanted; ++k) {
      if (!more_on_line()) return k;
      const std::string_view text = token();
      if (!parse_double(text.data(), text.data() + text.size(), values[k])) {
        source.fail_line(text.data(), "expected a number, found \"" + shown(text) + "\"; correct or remove the line");
      }
    }
    return wanted;
  }

  // A token as it can be put in an error message: short, printable.
  static std::string shown(std::string_view text) {
    std::string result(text.substr(0, 24));
    for (char& c : result) c = c >= ' ' && c <= '~' ? c : '?';
    return text.size() > 24 ? result + "..." : result;
  }
};

inline bool equal_ignoring_case(std::string_view a, std::string_view lower) {
  const auto low = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  return std::equal(a.begin(), a.end(), lower.begin(), lower.end(), [&](char x, char y) { return low(x) == y; });
}

/// Values in a given byte order, by shifts, so the order of the machine does not matter.
template <class Unsigned>
Unsigned load_bytes(const char* p, bool big_endian) {
  Unsigned value = 0;
  for (std::size_t k = 0; k < sizeof(Unsigned); ++k) {
    const auto byte = static_cast<unsigned char>(p[big_endian ? k : sizeof(Unsigned) - 1 - k]);
    value = static_cast<Unsigned>(static_cast<Unsigned>(value << 4 << 4) | byte);  // not << 8: that is too far for one byte
  }
  return value;
}

template <class Value, class Unsigned>
Value load_as(const char* p, bool big_endian) {
  static_assert(sizeof(Value) == sizeof(Unsigned), "same size");
  const Unsigned bits = load_bytes<Unsigned>(p, big_endian);
  Value value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

template <class Unsigned, class Value>
void append_little_endian(std::string& out, Value value) {
  static_assert(sizeof(Value) == sizeof(Unsigned), "same size");
  Unsigned bits;
  std::memcpy(&bits, &value, sizeof bits);
  char bytes[sizeof bits];
  for (std::size_t k = 0; k < sizeof bits; ++k) bytes[k] = static_cast<char>(static_cast<unsigned char>(bits >> (8 * k)));
  out.append(bytes, sizeof bytes);
}

inline void append_float(std::string& out, double value) {
  append_little_endian<std::uint32_t>(out, static_cast<float>(value));
}

/// Of the time to read or write a file: getting its bytes from the disk or there.
inline constexpr double kShareOfDisk = 0.2;

/// Read or written between two looks: a few milliseconds.
inline constexpr std::size_t kBytesPerPiece = std::size_t{1} << 22;

/// Rows formatted between two looks: some milliseconds.
inline constexpr std::uint64_t kRowsPerLook = 1 << 13;

/// Text that a thread parses at a time: some milliseconds.
inline constexpr std::size_t kTextPiece = std::size_t{1} << 18;

/// Is what is left of a text from `from` on to be read in pieces?
inline bool worth_pieces(const IoSource& source, const char* from) {
  return source.run.workers() > 1 && static_cast<std::size_t>(source.end() - from) > kTextPiece;
}

/// Cuts the text into pieces of about kTextPiece, each of whole lines: behind an end of a line that no backslash takes away.
std::vector<std::string_view> text_pieces(std::string_view text, const Execution& run);

/// What is left of a text from `from` on, in pieces, if each line holds one row of a table of so many rows. Whether it does
/// shows when they are read: then no piece has more content than its rows, and none has less.
struct RowPieces {
  std::vector<std::string_view> pieces;
  std::vector<std::int64_t> ends;  ///< by piece: ends of lines up to there, at most `rows`
  std::int64_t rows;

  RowPieces(const IoSource& source, const char* from, std::int64_t num_rows);

  /// Are there enough lines?
  bool complete() const { return !ends.empty() && ends.back() == rows; }
  std::int64_t first_row(std::size_t piece) const { return piece == 0 ? 0 : ends[piece - 1]; }
};

/// Thrown out of a piece that cannot be read by itself.
struct NotByItself {};

/// Runs parse(k, source of piece k) for pieces of a text, on all threads. False if one of them is NotByItself or throws an
/// Error(kFileFormat): then the text has to be read from its beginning, which finds out what is wrong and in which line.
template <class Parse>
bool parse_pieces(const IoSource& source, const std::vector<std::string_view>& pieces, const Parse& parse) {
  const Execution looking = source.run.part(0, 0);  // pieces look for a cancel, and report when they are done
  WorkCounter done(source.run, source.data.size());
  try {
    parallel_for(pieces.size(), 1, source.run, [&](std::size_t number, std::size_t) {
      // From the end, where faces are: they are more likely to be out of the ordinary.
      const std::size_t k = pieces.size() - 1 - number;
      try {
        parse(k, IoSource{pieces[k], source.name, looking});
      } catch (const Error& error) {
        if (error.code() != ErrorCode::kFileFormat) throw;
        throw NotByItself();
      }
      done.add(pieces[k].size());
    });
  } catch (const NotByItself&) {
    return false;
  }
  return true;
}

/// The extension of a file name, with its dot, in lower case.
std::string lower_extension(const std::filesystem::path& path);

/// The rest of a stream, or a whole file. Error(kFileNotFound) if it cannot be opened or read. `expected_size`: 0 if unknown.
std::string read_whole_stream(std::istream& in, const std::string& name, std::size_t expected_size, const Execution& run = {});
std::string read_whole_file(const std::filesystem::path& path, const Execution& run = {});

/// Error(kFileNotFound) if the stream fails. If cancelled, part of the content is in it.
void write_whole_stream(std::ostream& out, const std::string& content, const Execution& run = {});

/// Error(kFileNotFound) that names the file.
[[noreturn]] void fail_file(const std::filesystem::path& path, const std::string& what);

/// The system's word for the error in errno.
std::string system_message();

/// Writes a file under a temporary name in the same directory and renames it: on failure, Error(kFileNotFound), nothing has
/// changed, and no temporary is left. A link is followed; permissions, owner and group are kept. A file with other names (hard
/// links), and one whose owner or group cannot be given to a new file, is written in place, after what it grows by: if there is
/// no room for that, nothing has changed. A device or pipe is written in place. Refused is a file that the caller may not
/// write, though the directory would allow to replace it.
///
/// Temporaries are called .amps-0.tmp, .amps-1.tmp and so on, and locked by their writer (flock). What killed programs left is
/// thus known, and taken away by the next writer in that directory: files of these names of the same user that nobody has
/// locked. On Windows, which has no flock, those are taken away that are an hour old and not open.
void replace_file(const std::filesystem::path& path, const std::string& content, const Execution& run = {});

/// Throws what replace_file would throw before it writes.
void require_replaceable(const std::filesystem::path& path);

}  // namespace detail
}  // namespace amps
