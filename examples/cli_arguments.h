// cli_arguments.h: what was typed — options of a command, their values checked, and help for what was mistyped.
#pragma once

#include "cli_output.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

/// The user's doing: printed as one line.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Option {
  const char* name;   ///< with its dashes
  const char* value;  ///< what to call its value; nullptr: none
  const char* help;
};

class Arguments;

struct Command {
  const char* name;
  const char* operands;  ///< as in the synopsis; those in brackets may be left out, one with dots given several times
  const char* summary;
  const char* details;
  std::vector<Option> options;
  int (*run)(const Arguments&);
};

inline const std::vector<Option>& common_options() {
  static const std::vector<Option> kCommon{
      {"--overwrite-input", nullptr, "an output may take the place of a file that is read"},
      {"--format", "FORMAT",
       "of what is named -, the standard input or output: obj, off, ply, stl; samples: xyzr, ply, csv;\n"
       "IN,OUT if both are. If an output is -, the table is on stderr"},
      {"--quiet", nullptr, "print nothing but errors"},
      {"--help", nullptr, "print this and exit"},
  };
  return kCommon;
}

/// What a command was called with. Getters throw UsageError naming the option and what it wants.
class Arguments {
 public:
  Arguments(const Command& command, const std::vector<std::string>& words);

  bool has(const std::string& name) const { return values_.count(name) != 0; }
  bool quiet() const { return has("--quiet"); }
  const std::string& operand(std::size_t i) const { return operands_[i]; }
  std::size_t operands() const { return operands_.size(); }
  std::string text(const std::string& name, const std::string& missing = "") const {
    const auto found = values_.find(name);
    return found == values_.end() ? missing : found->second;
  }

  double real(const std::string& name, double missing, double low, double high) const {
    if (!has(name)) return missing;
    const double value = real(name);
    if (!(value >= low && value <= high)) throw refused(name, "a number from " + number(low) + " to " + number(high));
    return value;
  }
  /// A length; 0 if missing.
  double positive(const std::string& name) const {
    if (!has(name)) return 0;
    const double value = real(name);
    if (!(value > 0)) throw refused(name, "a number above 0");
    return value;
  }

  /// A number above 0, or one with % after it: 1%. 0 where it is not given.
  double positive_or_percent(const std::string& name, bool& percent) const {
    percent = false;
    if (!has(name)) return 0;
    std::string word = text(name);
    percent = !word.empty() && word.back() == '%';
    if (percent) word.pop_back();
    const double value = real(name, word);
    if (!(value > 0)) throw refused(name, "a number above 0, or so many percent (1%)");
    return value;
  }

  std::uint64_t whole(const std::string& name, std::uint64_t missing, std::uint64_t low, std::uint64_t high) const {
    if (!has(name)) return missing;
    const std::string word = text(name);
    std::uint64_t value = 0;
    bool fits = !word.empty();
    const std::size_t exponent = word.find_first_of("eE");
    std::string digits = word.substr(0, exponent);
    if (exponent != std::string::npos) {  // 1e3
      const std::string power = word.substr(exponent + 1);
      const bool good =
          !digits.empty() && !power.empty() && power.size() <= 2 && power.find_first_not_of("0123456789") == std::string::npos;
      if (!good) throw refused(name, "a whole number");
      digits.append(static_cast<std::size_t>(std::stoi(power)), '0');
    }
    for (const char c : digits) {
      if (c < '0' || c > '9') throw refused(name, "a whole number");
      const auto digit = static_cast<std::uint64_t>(c - '0');
      fits = fits && value <= (UINT64_MAX - digit) / 10;
      value = value * 10 + digit;
    }
    if (!fits || value < low || value > high) {
      throw refused(name, "a whole number from " + std::to_string(low) + " to " + std::to_string(high));
    }
    return value;
  }

  /// As it was typed, with quotes where a shell needs some.
  std::string command_line() const {
    std::string line = "amps " + std::string(command_->name);
    for (const std::string& word : words_) line += " " + quoted_for_shell(word);
    return line;
  }

  UsageError error(const std::string& trouble) const {
    return UsageError("amps " + std::string(command_->name) + ": " + trouble + " (see 'amps " + command_->name + " --help')");
  }

 private:
  double real(const std::string& name) const { return real(name, text(name)); }
  double real(const std::string& name, const std::string& word) const {
    char* end = nullptr;
    const double value = std::strtod(word.c_str(), &end);
    if (word.empty() || *end != '\0' || !std::isfinite(value)) throw refused(name, "a number");
    return value;
  }
  UsageError refused(const std::string& name, const std::string& wanted) const {
    return error(name + " wants " + wanted + ", not '" + text(name) + "'");
  }

  static std::string quoted_for_shell(const std::string& word) {
    const char* const plain = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_./:=,%+-";
    if (!word.empty() && word.find_first_not_of(plain) == std::string::npos) return word;
    std::string quoted = "'";
    for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return quoted + "'";
  }

  const Command* command_;
  std::vector<std::string> words_;
  std::vector<std::string> operands_;
  std::map<std::string, std::string> values_;
};

/// Insertions, deletions and changes of a letter that make one word of the other (Levenshtein).
inline std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t change = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({change, row[j] + 1, diagonal + 1});
    }
  }
  return row.back();
}

inline std::string did_you_mean(const std::string& word, const std::vector<std::string>& known) {
  for (const std::string& candidate : known) {
    if (edit_distance(word, candidate) <= 2) return ", did you mean " + candidate + "?";
  }
  return "";
}

Arguments::Arguments(const Command& command, const std::vector<std::string>& words) : command_(&command), words_(words) {
  std::vector<Option> options = command.options;
  options.insert(options.end(), common_options().begin(), common_options().end());
  bool only_operands = false;  // after "--"
  for (std::size_t i = 0; i < words.size(); ++i) {
    std::string word = words[i];
    if (only_operands || word.size() < 2 || word[0] != '-') {
      operands_.push_back(word);
      continue;
    }
    if (word == "--") {
      only_operands = true;
      continue;
    }
    if (word == "-h") word = "--help";
    if (word == "-q") word = "--quiet";
    const std::size_t equals = word.find('=');
    const std::string name = word.substr(0, equals);
    const auto option = std::find_if(options.begin(), options.end(), [&](const Option& o) { return name == o.name; });
    if (option == options.end()) {
      std::vector<std::string> known;
      for (const Option& o : options) known.emplace_back(o.name);
      throw error("unknown option " + name + did_you_mean(name, known));
    }
    if (has(name)) throw error(name + " is given twice");
    if (option->value == nullptr) {
      if (equals != std::string::npos) throw error(name + " takes no value");
      values_[name];
    } else if (equals != std::string::npos) {
      values_[name] = word.substr(equals + 1);
    } else if (i + 1 < words.size()) {
      values_[name] = words[++i];
    } else {
      throw error(std::string(name) + " needs a value: " + name + " " + option->value);
    }
  }
  if (has("--help")) return;
  const std::string synopsis = command.operands;
  const auto most = static_cast<std::size_t>(std::count(synopsis.begin(), synopsis.end(), ' ')) + 1;
  const std::size_t least = most - static_cast<std::size_t>(std::count(synopsis.begin(), synopsis.end(), '['));
  if (operands_.size() < least) throw error("too few arguments, it wants " + synopsis);
  const bool any_number = synopsis.find("...") != std::string::npos;
  if (operands_.size() > most && !any_number) throw error("one argument too many: '" + operands_[most] + "'");
}
