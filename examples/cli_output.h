// cli_output.h: what the program `amps` prints and writes — numbers as text, the table, JSON.
#pragma once

#include "amps/base.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
inline std::string
format(const char* pattern, ...) {
  char buffer[512];
  std::va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(buffer, sizeof buffer, pattern, arguments);
  va_end(arguments);
  return buffer;
}

inline std::string number(double x) { return format("%.6g", x); }
inline std::string number(amps::Index n) { return std::to_string(n); }

/// Columns of what is printed: terminals have at least these.
inline constexpr std::size_t kColumns = 80;

/// `text` with line breaks in place of blanks so that it fits `columns`, the first of which is `column`; further lines start at
/// `indent`. Words that are too long stay whole.
inline std::string wrapped(const std::string& text, std::size_t column, std::size_t indent, std::size_t columns = kColumns) {
  std::string result;
  std::size_t at = column;
  for (std::size_t begin = 0; begin < text.size();) {
    // A word and the blanks before it.
    std::size_t word = text.find_first_not_of(' ', begin);
    if (word == std::string::npos) word = text.size();
    const std::size_t end = std::min(text.find_first_of(" \n", word), text.size());
    if (begin > 0 && at > indent && at + (end - begin) > columns) {
      result += "\n" + std::string(indent, ' ');
      at = indent;
      begin = word;
    }
    result.append(text, begin, end - begin);
    at += end - begin;
    begin = end;
    if (begin < text.size() && text[begin] == '\n') {
      result += "\n" + std::string(indent, ' ');
      at = indent;
      ++begin;
    }
  }
  return result;
}

/// The table: a name and one or two values a row, in 80 columns.
class Table {
 public:
  struct Row {
    std::string name, first, second;
    bool has_second;
  };
  Table(bool quiet, std::FILE* stream) : quiet_(quiet), stream_(stream) {}
  void row(const char* name, const std::string& value) const { add({name, value, "", false}); }
  void row(const char* name, const std::string& first, const std::string& second) const { add({name, first, second, true}); }
  const std::vector<Row>& rows() const { return rows_; }  ///< also of a quiet one
  /// From here on rows wait for print().
  void hold() { held_ = true; }
  void print() const {
    for (const Row& row : rows_) show(row);
  }

 private:
  static constexpr std::size_t kNameColumns = 23, kFirstColumns = 15;

  void add(const Row& row) const {
    rows_.push_back(row);
    if (!held_) show(row);
  }
  void show(const Row& row) const {
    if (quiet_) return;
    const std::string name = format("%-22s ", row.name.c_str());
    std::string line = name + wrapped(row.first, name.size(), kNameColumns);
    if (row.has_second) {
      const std::string start = name + format("%-14s ", row.first.c_str());
      line = start + wrapped(row.second, start.size(), kNameColumns + kFirstColumns);
    }
    std::fprintf(stream_, "%s\n", line.c_str());
  }

  bool quiet_;
  std::FILE* stream_;
  bool held_ = false;
  mutable std::vector<Row> rows_;  // printing does not change what a table is of
};

/// JSON text, built in one pass. Numbers read back to the same bits; infinities and NaN, which JSON lacks, become null.
class Json {
 public:
  Json& open(const char* key = nullptr) {
    next(key);
    text_ += '{';
    first_ = true;
    ++depth_;
    return *this;
  }
  Json& close() {
    --depth_;
    newline();
    text_ += '}';
    first_ = false;
    return *this;
  }
  Json& add(const char* key, double value) { return raw(key, std::isfinite(value) ? format("%.17g", value) : "null"); }
  Json& add(const char* key, int value) { return raw(key, std::to_string(value)); }
  Json& add(const char* key, std::uint64_t value) { return raw(key, std::to_string(value)); }
  Json& add(const char* key, bool value) { return raw(key, value ? "true" : "false"); }
  Json& add(const char* key, const char* value) { return raw(key, quoted(value)); }
  Json& add(const char* key, const std::string& value) { return raw(key, quoted(value)); }
  template <class Range>
  Json& add_list(const char* key, const Range& values) {
    std::string list;
    for (const auto& value : values) list += (list.empty() ? "" : ", ") + std::to_string(value);
    return raw(key, "[" + list + "]");
  }
  std::string text() const { return text_ + "\n"; }

 private:
  Json& raw(const char* key, const std::string& value) {
    next(key);
    text_ += value;
    return *this;
  }
  void next(const char* key) {
    if (depth_ > 0) {
      if (!first_) text_ += ',';
      newline();
    }
    first_ = false;
    if (key != nullptr) text_ += quoted(key) + ": ";
  }
  void newline() { text_ += '\n' + std::string(static_cast<std::size_t>(2 * depth_), ' '); }
  static std::string quoted(const std::string& s) {
    std::string out = "\"";
    for (const char c : s) {
      if (c == '"' || c == '\\') {
        out += '\\';
        out += c;
      } else if (static_cast<unsigned char>(c) < 0x20) {
        out += format("\\u%04x", static_cast<unsigned>(c));
      } else {
        out += c;
      }
    }
    return out + '"';
  }

  std::string text_;
  int depth_ = 0;
  bool first_ = true;
};
