// cli_sizing.h: --sizing and its companions: what they ask for, and the field that comes of it.
#pragma once

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_files.h"

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

inline constexpr std::uint64_t kMostVertices = 1u << 30;
inline constexpr std::uint64_t kMostThreads = 1024;

inline unsigned threads_of(const Arguments& arguments) {
  return static_cast<unsigned>(arguments.whole("--threads", 0, 0, kMostThreads));
}

/// What --sizing and its companions ask for, before there is a mesh.
struct SizingRequest {
  std::string kind;  ///< uniform, lfs, curvature, a file, or of remesh error: radii are its matter
  double least = 0, greatest = 0, gradation = 0;
  double error = 0;               ///< in the units of the mesh, or …
  bool error_in_percent = false;  ///< … in percent of its diagonal
  amps::Index count = 0;
};

/// FILE, or FILE.ply:PROPERTY: the file and the property.
inline std::pair<std::string, std::string> sizing_file(const std::string& name) {
  const std::size_t colon = name.find(".ply:");
  if (colon == std::string::npos) return {name, ""};
  return {name.substr(0, colon + 4), name.substr(colon + 5)};
}

/// E of --error in the units of this mesh; 0: none.
inline double error_of(const SizingRequest& request, const amps::Mesh& mesh) {
  return request.error_in_percent ? request.error / 100 * amps::bounding_box(mesh).diagonal() : request.error;
}

/// `certified`: --error bounds the result, whatever its radii; else it makes them.
inline SizingRequest sizing_request(const Arguments& arguments, bool certified = false) {
  SizingRequest request;
  request.error = arguments.positive_or_percent("--error", request.error_in_percent);
  request.kind = arguments.text("--sizing", request.error > 0 && !certified ? "curvature" : "uniform");
  request.least = arguments.positive("--rmin");
  request.greatest = arguments.positive("--rmax");
  request.count = static_cast<amps::Index>(arguments.whole("--vertices", 0, 1, kMostVertices));
  request.gradation = arguments.has("--gradation") ? arguments.positive("--gradation") : amps::kDefaultGradation;
  const bool bounded = request.least > 0 || request.greatest > 0;
  if (certified && request.kind == "error") {
    if (request.count == 0) throw arguments.error("--sizing error spends a number of vertices: say --vertices N");
    for (const char* name : {"--radius", "--rmin", "--rmax", "--gradation"}) {
      if (arguments.has(name)) throw arguments.error(std::string(name) + ": --sizing error has its own radii");
    }
    return request;
  }
  if (request.kind == "uniform") {
    for (const char* name : {"--rmin", "--rmax", "--error", "--gradation"}) {
      if (certified && name == std::string("--error")) continue;
      if (arguments.has(name)) throw arguments.error(std::string(name) + " is for radii that vary: say --sizing as well");
    }
    const bool by_radius = arguments.has("--radius"), by_count = arguments.has("--vertices");
    if (by_radius && by_count) throw arguments.error("say how dense: either --radius R or --vertices N");
    if (!by_radius && !by_count && request.error == 0) {
      throw arguments.error(std::string("say how dense: either --radius R or --vertices N") +
                            (certified ? ", or --error E, how far the result may be off" : ""));
    }
    return request;
  }
  std::vector<std::string> known{"uniform", "lfs", "curvature"};
  if (certified) known.push_back("error");
  std::error_code ignored;
  if (request.kind != "lfs" && request.kind != "curvature" && !fs::exists(sizing_file(request.kind).first, ignored)) {
    throw arguments.error("--sizing " + request.kind + " is neither uniform, lfs, curvature" + (certified ? ", error" : "") +
                          " nor a file that exists" + did_you_mean(request.kind, known));
  }
  if (arguments.has("--radius")) {
    throw arguments.error("--radius is for uniform sets, --sizing " + request.kind + " has its own radii");
  }
  if (!certified && request.error > 0 && request.kind != "curvature")
    throw arguments.error("--error goes with --sizing curvature");
  if (request.count > 0 && (bounded || (request.error > 0 && !certified))) {
    throw arguments.error(std::string("--vertices scales all radii: leave out --rmin") +
                          (certified ? " and --rmax" : ", --rmax and --error"));
  }
  if (request.greatest > 0 && request.least > request.greatest) throw arguments.error("--rmin is greater than --rmax");
  if (request.count == 0 && request.kind == "lfs" && !bounded) {
    throw arguments.error("say how dense: --vertices N, or --rmin R (and --rmax) to bound the local feature size");
  }
  if (request.count == 0 && request.kind == "curvature" && request.error == 0) {
    throw arguments.error("say how dense: --vertices N, or --error E, how far the result may be off");
  }
  return request;
}

/// The file of --sizing, if it is one.
inline void name_sizing_file(Files& files, const SizingRequest& request) {
  if (request.kind != "uniform" && request.kind != "lfs" && request.kind != "curvature" && request.kind != "error") {
    files.reads("--sizing", sizing_file(request.kind).first, Holds::kOther);
  }
}

inline amps::SizingField file_sizing(const amps::Mesh& mesh, const std::string& name, const amps::Execution& execution) {
  const auto [file, property] = sizing_file(name);
  const std::vector<double> radii =
      property.empty() ? amps::read_values(file, execution) : amps::read_vertex_property(file, property, execution);
  try {
    return amps::vertex_sizing(mesh, radii);
  } catch (const amps::Error& error) {
    throw amps::Error(error.code(), name + ": " + error.what());
  }
}

inline amps::SizingField make_sizing(const SizingRequest& request, const amps::Mesh& mesh, const amps::Execution& execution) {
  constexpr double kShareOfMaking = 0.8;  // of the time; the rest is scaling or limiting
  constexpr double kErrorScale = 1e-3;    // of the diagonal; any: the field is scaled
  amps::SizingField field;
  if (request.kind == "uniform" || request.kind == "error") return field;
  const amps::Execution making = execution.part(0, kShareOfMaking);
  if (request.kind == "lfs") {
    field = amps::lfs_sizing(mesh, {}, making);
  } else if (request.kind == "curvature") {
    amps::CurvatureOptions options;
    options.max_error = request.error > 0 ? error_of(request, mesh) : kErrorScale * amps::bounding_box(mesh).diagonal();
    field = amps::curvature_sizing(mesh, options, making);
  } else {
    field = file_sizing(mesh, request.kind, making);
  }
  const amps::Execution rest = execution.part(kShareOfMaking, 1);
  if (request.count > 0) return amps::for_count(field.with_ratio(), request.count, request.gradation, rest);
  if (request.least > 0 || request.greatest > 0) {
    const double least = request.least > 0 ? request.least : request.greatest / amps::kDefaultRatio;
    field = field.clamped(least, request.greatest > 0 ? request.greatest : amps::kDefaultRatio * least);
  }
  return field.limited(request.gradation, rest);
}
