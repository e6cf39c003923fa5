// cli_files.h: files of the program `amps`, and the standard input and output in their place: looked at before the work,
// written whole or not at all.
#pragma once

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_output.h"

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <sstream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#endif

namespace fs = std::filesystem;

/// What a file holds. --format is not for pictures (PNG) and others: of these there is one.
enum class Holds { kMesh, kLines, kSamples, kPicture, kOther };

/// The files that a command reads and writes. First they are named, all of them; then looked at, which refuses, before any
/// work, an output that could not be written or would take the place of another or of an input; then read and written. `-` is
/// the standard input or output; --format tells its format.
class Files {
 public:
  explicit Files(const Arguments& arguments) : arguments_(arguments) {}

  void reads(const std::string& said, const std::string& name, Holds holds) {
    if (is_standard(name)) standard_input_ = true;
    require_format(name, holds, true);
    inputs_.push_back({said, name});
  }
  void writes(const std::string& said, const std::string& name, Holds holds) {
    if (is_standard(name)) {
      if (standard_output_) throw arguments_.error(said + " - is a second output there; name a file");
      standard_output_ = true;
      require_format(name, holds, false);
    } else {
      require_place(name);
      require_format(name, holds, false);
    }
    outputs_.push_back({said, name});
  }
  /// The value of an option, if it is given.
  void reads(const char* option, Holds holds) {
    if (arguments_.has(option)) reads(option, arguments_.text(option), holds);
  }
  void writes(const char* option, Holds holds) {
    if (arguments_.has(option)) writes(option, arguments_.text(option), holds);
  }

  /// Throws UsageError or Error. To be called once, when all are named; what comes from the standard input is then here.
  void look() {
    if (arguments_.has("--format") && !uses_format_) {
      throw arguments_.error("--format is for meshes and samples from or to the standard input and output: name them -");
    }
    for (std::size_t i = 0; i < outputs_.size(); ++i) {
      const Named& output = outputs_[i];
      if (is_standard(output.name)) continue;
      for (std::size_t j = 0; j < i; ++j) {
        if (!same_file(output.name, outputs_[j].name)) continue;
        throw arguments_.error(output.said + " names " + output.name + ", which is written already (" + outputs_[j].said +
                               "); name another file");
      }
      for (const Named& input : inputs_) {
        if (arguments_.has("--overwrite-input") || !same_file(output.name, input.name)) continue;
        throw arguments_.error(output.said + " names " + output.name + ", which is read (" + input.said +
                               "); name another file, or say --overwrite-input");
      }
      amps::require_writable_file(output.name);
    }
    if (!standard_input_) return;
    binary(stdin);
    data_.assign(std::istreambuf_iterator<char>(std::cin), {});
  }

  bool to_standard_output() const { return standard_output_; }
  /// A name as it can be shown.
  static std::string shown(const std::string& name, const char* standard) { return is_standard(name) ? standard : name; }

  amps::MeshFormat mesh_format(const std::string& name, bool input) const {
    return is_standard(name) ? mesh_format_of(format_named(input)) : amps::mesh_format(name);
  }

  amps::Mesh mesh(const std::string& name, const amps::Execution& execution) const {
    if (!is_standard(name)) return amps::read_mesh(name, execution);
    return amps::parse_mesh(data_, mesh_format(name, true), kInput, execution);
  }
  /// One that can be sampled; errors name the file.
  amps::Mesh usable_mesh(const std::string& name, const amps::Execution& execution) const {
    amps::Mesh result = mesh(name, execution.part(0, 0.8));
    try {
      amps::require_usable(result, execution.part(0.8, 1));
    } catch (const amps::Error& error) {
      throw amps::Error(error.code(), shown(name, kInput) + ": " + error.what());
    }
    return result;
  }
  /// One of which disks of one size can cover all.
  amps::Mesh mesh_to_sample(const std::string& name, const amps::Execution& execution) const {
    amps::Mesh result = usable_mesh(name, execution.part(0, 0.9));
    const amps::Index wild = amps::find_wild_vertex(result, execution.part(0.9, 1));
    if (wild != amps::kNone) {
      throw amps::Error(amps::ErrorCode::kInvalidMesh, shown(name, kInput) + ": mesh: " + shown_vertex(result, wild) +
                                                           " is so far from all others that no radius suits the mesh; " +
                                                           "correct it, or remove its facets");
    }
    return result;
  }
  /// A vertex that the user has to find in a file.
  static std::string shown_vertex(const amps::MeshView& mesh, amps::Index v) {
    const amps::Vec3 x = mesh.vertices[v];
    return "vertex " + std::to_string(v) + " (0-based) at " + format("(%.9g, %.9g, %.9g)", x.x(), x.y(), x.z());
  }
  amps::MeshMarks marks(const std::string& name, const amps::Execution& execution) const {
    if (!is_standard(name)) return amps::read_mesh_marks(name, execution);
    return amps::parse_mesh_marks(data_, mesh_format(name, true), kInput, execution);
  }
  amps::SampleSet samples(const std::string& name, const amps::Execution& execution) const {
    if (!is_standard(name)) return amps::read_samples(name, execution);
    return amps::parse_samples(data_, sample_format(name, true), kInput, execution);
  }
  amps::SampleFormat sample_format(const std::string& name, bool input) const {
    return is_standard(name) ? sample_format_of(format_named(input)) : amps::sample_format(name);
  }
  /// Whether `is_so(stream)`, of what is there; false of what is no file, such as a pipe, which can be read only once.
  template <class Predicate>
  bool content(const std::string& name, const Predicate& is_so) const {
    if (is_standard(name)) {
      std::istringstream in(data_);
      return is_so(in);
    }
    std::error_code ignored;
    if (!fs::is_regular_file(name, ignored)) return false;
    std::ifstream in(name);
    return in.good() && is_so(in);
  }

  void write(const std::string& name, const amps::MeshView& mesh, const amps::MeshWriteOptions& options,
             const amps::Execution& execution) const {
    if (!is_standard(name)) return amps::write_mesh(name, mesh, options, execution);
    print(amps::format_mesh(mesh, mesh_format(name, false), options, execution));
  }
  void write(const std::string& name, const amps::SampleSet& samples, const amps::Execution& execution) const {
    if (!is_standard(name)) return amps::write_samples(name, samples, execution);
    print(amps::format_samples(samples, sample_format(name, false), execution));
  }
  void write(const std::string& name, const std::string& content) const {
    if (!is_standard(name)) return amps::write_file(name, content);
    print(content);
  }
  /// --json
  void write(Json& json) const {
    if (arguments_.has("--json")) write(arguments_.text("--json"), json.close().text());
  }

  /// On stderr where an output has stdout.
  Table table() const { return Table(arguments_.quiet(), standard_output_ ? stderr : stdout); }

  static constexpr const char* kInput = "standard input";
  static constexpr const char* kOutput = "standard output";

 private:
  struct Named {
    std::string said;  // by which argument
    std::string name;
  };

  static bool is_standard(const std::string& name) { return name == "-"; }

  static void binary(std::FILE* stream) {
#ifdef _WIN32
    _setmode(_fileno(stream), _O_BINARY);
#else
    (void)stream;
#endif
  }
  static void print(const std::string& content) {
    binary(stdout);
    if (std::fwrite(content.data(), 1, content.size(), stdout) == content.size() && std::fflush(stdout) == 0) return;
    throw amps::Error(amps::ErrorCode::kFileNotFound, std::string(kOutput) + ": cannot be written; check what it leads to");
  }

  /// --format FORMAT, or IN,OUT.
  std::string format_named(bool input) const {
    const std::string formats = arguments_.text("--format");
    const std::size_t comma = formats.find(',');
    return comma == std::string::npos ? formats : input ? formats.substr(0, comma) : formats.substr(comma + 1);
  }
  amps::MeshFormat mesh_format_of(const std::string& name) const {
    if (name == "obj") return amps::MeshFormat::kObj;
    if (name == "off") return amps::MeshFormat::kOff;
    if (name == "ply") return amps::MeshFormat::kPly;
    if (name == "stl") return amps::MeshFormat::kStl;
    throw arguments_.error(name.empty() ? "a mesh comes or goes as -: say its --format, obj, off, ply or stl"
                                        : "--format " + name + ": a mesh is in obj, off, ply or stl");
  }
  amps::SampleFormat sample_format_of(const std::string& name) const {
    if (name == "xyzr") return amps::SampleFormat::kXyzr;
    if (name == "ply") return amps::SampleFormat::kPly;
    if (name == "csv") return amps::SampleFormat::kCsv;
    throw arguments_.error(name.empty() ? "samples come or go as -: say their --format, xyzr, ply or csv"
                                        : "--format " + name + ": samples are in xyzr, ply or csv");
  }

  /// The format is one that there is: the extension decides, or --format. Inputs are looked at when they are read.
  void require_format(const std::string& name, Holds holds, bool input) {
    const bool standard = is_standard(name);
    uses_format_ = uses_format_ || (standard && holds != Holds::kPicture && holds != Holds::kOther);
    if (input && !standard) return;
    if (holds == Holds::kMesh || holds == Holds::kLines) {
      const amps::MeshFormat format = mesh_format(name, input);
      if (holds == Holds::kLines && format != amps::MeshFormat::kObj) {
        throw arguments_.error("no lines can be in " + (standard ? "--format " + format_named(input) : name) +
                               ": name an .obj file");
      }
    } else if (holds == Holds::kSamples) {
      sample_format(name, input);
    } else if (holds == Holds::kPicture && !standard && !is_png(name)) {
      throw arguments_.error("cannot draw " + name + ": name a .png file");
    }
  }
  static bool is_png(const std::string& name) {
    std::string extension = fs::path(name).extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(), lower);
    return extension == ".png";
  }

  void require_place(const fs::path& path) const {
    std::error_code ignored;
    if (path.empty()) throw arguments_.error("the name of an output file is empty");
    if (fs::is_directory(path, ignored)) throw arguments_.error(path.string() + " is a directory, name a file in it");
    const fs::path directory = path.has_parent_path() ? path.parent_path() : fs::path(".");
    if (!fs::is_directory(directory, ignored)) {
      throw arguments_.error("cannot write " + path.string() + ": there is no directory " + directory.string() +
                             ", make it first");
    }
  }

  /// Whatever their names: links to one file are that file. Devices take any number of outputs.
  static bool same_file(const fs::path& a, const fs::path& b) {
    std::error_code error;
    const fs::file_status of_a = fs::status(a, error), of_b = fs::status(b, error);
    if (fs::exists(of_a) != fs::exists(of_b)) return false;
    if (fs::exists(of_a)) return fs::is_regular_file(of_a) && fs::equivalent(a, b, error);
    return comparable(a) == comparable(b);
  }
  static std::string comparable(const fs::path& path) {
    std::error_code error;
    fs::path whole = fs::weakly_canonical(fs::absolute(path, error), error);
    if (error) whole = path.lexically_normal();
    std::string name = whole.string();
#if defined(_WIN32) || defined(__APPLE__)  // where upper and lower case are one file
    std::transform(name.begin(), name.end(), name.begin(), lower);
#endif
    return name;
  }
  static char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

  const Arguments& arguments_;
  std::vector<Named> inputs_, outputs_;
  bool standard_input_ = false, standard_output_ = false;
  bool uses_format_ = false;
  std::string data_;  // of the standard input
};

/// The head of every statistics file.
inline Json begin_json(const char* command) {
  Json json;
  json.open()
      .add("program", std::string("amps"))
      .add("version", format("%d.%d.%d", AMPS_VERSION_MAJOR, AMPS_VERSION_MINOR, AMPS_VERSION_PATCH));
  json.add("command", std::string(command));
  return json;
}
