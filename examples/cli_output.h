// cli_output.h: what the program `amps` prints and writes — numbers as text, the table, JSON.
#pragma once

#include "amps/base.h"

#include <cmath>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <string>

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

/// The table: a name and one or two values a row.
class Table {
 public:
  Table(bool quiet, std::FILE* stream) : quiet_(quiet), stream_(stream) {}
  void row(const char* name, const std::string& value) const {
    if (!quiet_) std::fprintf(stream_, "%-22s %s\n", name, value.c_str());
  }
  void row(const char* name, const std::string& first, const std::string& second) const {
    if (!quiet_) std::fprintf(stream_, "%-22s %-14s %s\n", name, first.c_str(), second.c_str());
  }

 private:
  bool quiet_;
  std::FILE* stream_;
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
