// cli_render.h: amps render — what is drawn, from where, and what the surface is painted with.
#pragma once

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_commands.h"
#include "cli_curves.h"
#include "cli_files.h"
#include "cli_watch.h"
#include "render_looks.h"
#include "render_mesh.h"
#include "render_png.h"

#include <string>
#include <utility>
#include <vector>

/// The options of `amps render`, checked before there is a mesh.
struct RenderRequest {
  render::Options options;
  std::string look;      ///< shape, valence, angles, radius, cells, gaps or disks
  bool samples = false;  ///< there is a file of them
};

inline RenderRequest render_request(const Arguments& arguments) {
  constexpr std::uint64_t kLargestPicture = 16384;
  RenderRequest request;
  render::Options& options = request.options;
  options.size = static_cast<int>(arguments.whole("--size", 1024, 16, kLargestPicture));
  const std::string view = arguments.text("--view");
  if (arguments.has("--view") && !render::look_from(view, options)) {
    throw arguments.error("--view " + view + ": name front, back, left, right, top, bottom or iso");
  }
  options.azimuth = arguments.real("--azimuth", options.azimuth, -360, 360);
  options.elevation = arguments.real("--elevation", options.elevation, -90, 90);
  options.zoom = arguments.real("--zoom", 1, 0.01, 1000);
  options.smooth = arguments.has("--smooth");
  options.edges = !arguments.has("--no-edges");
  options.z_up = arguments.has("--z-up");

  request.look = arguments.text("--look", "shape");
  request.samples = arguments.has("--samples");
  bool known = false, of_cells = false;
  for (const char* name : {"shape", "valence", "angles", "radius"}) known = known || request.look == name;
  for (const char* name : {"cells", "gaps", "disks"}) of_cells = of_cells || request.look == name;
  if (!known && !of_cells) {
    throw arguments.error("--look " + request.look + ": name shape, valence, angles, radius, cells, gaps or disks");
  }
  if (of_cells && !request.samples) {
    throw arguments.error("--look " + request.look + " is of a sample set: name one by --samples FILE");
  }
  if (arguments.has("--legend") && request.look == "shape")
    throw arguments.error("--legend says what a --look means: name one");
  return request;
}

/// The mesh as it looks; `samples` is empty if there are none.
inline render::Scene scene_of(const RenderRequest& request, const amps::Mesh& mesh, const amps::SampleSet& samples,
                              const amps::Execution& execution) {
  render::Scene scene;
  if (request.look == "valence") {
    scene = render::valence_look(mesh);
  } else if (request.look == "angles") {
    scene = render::angle_look(mesh);
  } else if (request.look == "shape") {
    scene.mesh = mesh;
  } else if (request.look == "radius" && !request.samples) {
    scene = render::map_look(mesh);
  } else {
    const render::CellLook how = request.look == "radius"  ? render::CellLook::kRadius
                                 : request.look == "gaps"  ? render::CellLook::kGaps
                                 : request.look == "cells" ? render::CellLook::kCells
                                                           : render::CellLook::kDisks;
    scene = render::cell_look(mesh, samples, how, execution);
  }
  // What the request says of the camera, and what the look says of the surface.
  render::Options options = request.options;
  options.paint = scene.options.paint;
  options.edges_of = std::move(scene.options.edges_of);
  options.spacing = scene.options.spacing;
  options.edges = options.edges && scene.options.edges;
  scene.options = std::move(options);
  return scene;
}

/// What colours say, of a look and a set.
inline std::vector<std::pair<render::Rgb, std::string>> legend_of(const RenderRequest& request, bool added) {
  namespace look = render::look;
  std::vector<std::pair<render::Rgb, std::string>> legend;
  const auto rgb = [](double t) {
    render::Rgb color{};
    for (std::size_t c = 0; c < 3; ++c) {
      color[c] = render::detail::to_srgb(render::map_color(t)[static_cast<std::ptrdiff_t>(c)]);
    }
    return color;
  };
  if (request.look == "valence") {
    legend = {{look::kValence5, "5 neighbours"},
              {look::kValence6, "6"},
              {look::kValence7, "7"},
              {look::kDark, "fewer or more"},
              {look::kPlain, "border"}};
  } else if (request.look == "angles") {
    legend = {{look::kDark, "angles below 30\xC2\xB0 or above 120\xC2\xB0"},
              {look::kRed, "30\xC2\xB0 to 35\xC2\xB0 or 105\xC2\xB0 to 120\xC2\xB0"},
              {look::kPlain, "all angles in [35\xC2\xB0, 105\xC2\xB0]"}};
  } else if (request.look == "radius") {
    const std::string what = request.samples ? "radius" : "edge";
    legend = {{rgb(0), "least " + what}, {rgb(0.5), "geometric mean of both"}, {rgb(1), "greatest " + what}};
  } else if (request.look == "gaps" || request.look == "disks") {
    legend = {{look::kCovered, "in a disk"}, {look::kRed, "in no disk"}};
  }
  if (added) legend.emplace_back(look::kRed, "added samples");
  return legend;
}

inline int run_render(const Arguments& arguments) {
  const RenderRequest request = render_request(arguments);
  const bool curves = arguments.has("--curves");
  amps::CurveOptions finding = curve_options(arguments);
  finding.radius = arguments.positive("--radius");
  for (const char* name : {"--features", "--radius"}) {
    if (arguments.has(name) && !curves) throw arguments.error(std::string(name) + " is for curves: say --curves as well");
  }
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  files.reads("--samples", Holds::kSamples);
  files.reads("--added", Holds::kSamples);
  files.writes("OUT", arguments.operand(1), Holds::kPicture);
  files.look();
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = files.usable_mesh(arguments.operand(0), watch.part(0, kRead));
  amps::SampleSet samples, added;
  if (request.samples) samples = files.samples(arguments.text("--samples"), watch.part(kRead, 0.04));
  if (arguments.has("--added")) added = files.samples(arguments.text("--added"), watch.part(0.04, 0.05));
  std::vector<std::array<amps::Index, 2>> lines;
  if (curves) {
    const bool marked = !arguments.has("--features") && files.mesh_format(arguments.operand(0), true) == amps::MeshFormat::kObj;
    if (marked) lines = files.marks(arguments.operand(0), watch.part(0.05, 0.06)).edges;
    finding.execution = watch.part(0.06, 0.1);
    if (lines.empty()) lines = edges_of(amps::find_curves(mesh, finding));
  }
  render::Scene scene = scene_of(request, mesh, samples, watch.part(0.1, 0.25));
  if (request.samples && !arguments.has("--no-dots")) render::add_dots(samples, render::look::kDot, scene.options);
  if (added.size() > 0) render::add_dots(added, render::look::kRed, scene.options);
  render::set_curves(mesh, lines, scene);
  scene.options.execution = watch.part(0.25, 0.6);
  render::Image image = render::draw(scene.mesh, scene.options);
  if (arguments.has("--legend")) image = render::with_legend(image, legend_of(request, added.size() > 0));
  files.write(arguments.operand(1), render::encode_png(image, watch.part(0.6, 1)));
  watch.finish();
  return kExitDone;
}
