// amps_cli.cpp: the command-line program `amps` — maximal Poisson-disk sampling and remeshing of mesh files.
//
//   amps remesh bunny.obj out.obj --vertices 12000
//
// Read from the bottom: main() finds the command, parses its options and runs it. Each command has a header, cli_NAME.h; it
// reads, works, writes and prints a table, in that order. Exit codes: 0 done, 2 bad input or usage (one line on stderr says
// what to do), 3 `gaps` found some or `fill` left some, 4 `remesh` has lost something of the shape (all files are written, one
// line on stderr says what is lost), 128 and the signal where one ended it: 130 for Ctrl-C.

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_commands.h"
#include "cli_curves.h"
#include "cli_files.h"
#include "cli_fill.h"
#include "cli_gaps.h"
#include "cli_info.h"
#include "cli_quality.h"
#include "cli_remesh.h"
#include "cli_render.h"
#include "cli_sample.h"
#include "cli_spectrum.h"
#include "cli_watch.h"

#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <string>
#include <vector>

namespace {

const std::vector<Command>& commands() {
  static const Option kRadius{"--radius", "R", "disk radius, in the units of the mesh"};
  static const Option kVertices{"--vertices", "N", "number of samples wanted instead, met within 1 %"};
  static const Option kExact{"--exact", nullptr,
                             "meet N exactly: samples are added or taken out where that costs least, and the table tells what\n"
                             "coverage is left"};
  static const Option kSizing{
      "--sizing", "KIND", "uniform (default), lfs, curvature, or a file of one radius a vertex (numbers, or x.ply:PROPERTY)"};
  static const Option kRmin{"--rmin", "R", "least radius; with --rmax left out, radii go up to 16 R"};
  static const Option kRmax{"--rmax", "R", "greatest radius"};
  static const Option kError{"--error", "E", "radii by curvature, so that triangles are at most E off"};
  static const Option kGradation{"--gradation", "L",
                                 "how fast radii may grow along the surface (default 0.1): it sets the worst angle"};
  static const Option kSeed{"--seed", "S", "of the random numbers (default 1): the same seed gives the same bits"};
  static const Option kThreads{"--threads", "T", "default 0: one per core; the result does not depend on it"};
  static const Option kJson{"--json", "FILE", "write the table as JSON too"};
  static const Option kFeatures{"--features", "ANGLE", "keep creases of more than so many degrees (default 40), or none"};
  static const Option kBorders{"--borders", "HOW", "keep (default) or free: sampled like everything else"};
  static const Option kKeep{"--keep", "FILE",
                            "keep the edges too that lines (l) of an OBJ file name, and points (p) as corners"};
  static const Option kInSpace{"--neighborhood", "KIND",
                               "space (default): disks are balls; surface: sheets do not see each other's disks"};
  static const std::vector<Command> kCommands{
      {"sample",
       "IN OUT",
       "place a maximal Poisson-disk set on a mesh",
       "IN is a mesh (.obj .off .ply .stl), OUT a sample set (.xyzr .ply .csv). No two samples are nearer than the\n"
       "greater of their radii, and every point of the surface is within the radius of a sample.",
       {kRadius, kVertices, kExact, kSizing, kRmin, kRmax, kError, kGradation, kInSpace, kSeed, kThreads, kJson},
       run_sample},
      {"remesh",
       "IN OUT",
       "replace a mesh by one of well-shaped triangles",
       "IN and OUT are meshes (.obj .off .ply .stl). With one radius R everywhere, all angles of OUT are in [30, 120] degrees\n"
       "and all edges in [R, 2R]; where radii vary, angles follow from how fast they do (--gradation). Optimisation narrows\n"
       "angles to [35, 105], or [32, 114] where radii vary, and valences to 5, 6 and 7. Corners of IN that are narrower keep\n"
       "their angles. Tighter bounds take longer: --angle-min 42 --angle-max 90 leaves no obtuse triangle, in six times the "
       "time.\n"
       "Creases and borders are kept as curves. OBJ files hold them as lines, and the patches between them as groups; PLY "
       "files\n"
       "hold patches as a property of faces. The FILE of --keep is IN itself, or has vertices at the positions of those of "
       "IN.\n"
       "Exit code 4: OUT is written, but has another topology than IN, lacks edges of curves, is farther from IN\n"
       "than --error allows, has another number of vertices than --exact asks for, or has no triangle.",
       {kRadius,
        {"--vertices", "N", "number of vertices wanted instead, met within 2 %"},
        kExact,
        {"--sizing", "KIND",
         "uniform (default), lfs, curvature, a file of one radius a vertex (numbers, or x.ply:PROPERTY), or error: N vertices\n"
         "are spent where they lower the distance to IN most, in some thirty times the time"},
        kRmin,
        kRmax,
        {"--error", "E", "the result is at most E from the input, proved: in the units of the mesh, or 1% of its diagonal"},
        kGradation,
        kFeatures,
        kBorders,
        kKeep,
        {"--neighborhood", "KIND", "surface (default): sheets do not see each other's disks; space: disks are balls"},
        {"--topology", "WHAT", "preserve (default): radii fall where the shape asks for it; report: only say what is lost"},
        {"--optimize", "WHAT", "angle,valence (default), angle, valence, or none"},
        {"--angle-min", "DEG", "least angle to reach, below 60"},
        {"--angle-max", "DEG", "greatest angle to reach, above 60"},
        {"--fit", "HOW", "vertices leave the surface so that triangles lie closer to it: none (default), normal or free"},
        {"--iterations", "N", "stop optimising after so many visits to all that is bad"},
        {"--convergence", "FILE", "write the course of optimisation as CSV"},
        {"--report", "FILE", "write a page (.html) of IN and OUT side by side, to be turned, with charts and this table"},
        kSeed,
        kThreads,
        {"--samples", "FILE", "write the vertices as a sample set too (.xyzr .ply .csv)"},
        kJson},
       run_remesh},
      {"curves",
       "IN [OUT]",
       "find the curves that remesh keeps",
       "IN is a mesh (.obj .off .ply .stl). Curves are borders, edges of many facets, creases, and what is marked (--keep).\n"
       "Creases too small for the radius wanted are dropped, as in remesh with the same numbers. OUT is an .obj file of the\n"
       "curves, as lines, and of their corners, as points: look at it, change it, and give it to --keep.",
       {kFeatures,
        kBorders,
        kKeep,
        {"--radius", "R", "the radius wanted, in the units of the mesh (default: none, creases of all sizes)"},
        {"--vertices", "N", "the number of vertices wanted instead"},
        kThreads,
        kJson},
       run_curves},
      {"gaps",
       "IN SAMPLES [OUT]",
       "say whether a set of disks on a mesh is maximal",
       "SAMPLES is a sample set (.xyzr .ply .csv), made by amps or by anything else. If parts of the mesh IN are in no disk,\n"
       "triangles that cover them are written to OUT. Exit code 0: maximal; 3: not. Disks of sets that say what of the "
       "surface\n"
       "their samples are on, as those of remesh (.ply .csv), know the surface, others are balls.",
       {{"--neighborhood", "KIND", "space or surface, instead: disks are balls, or sheets do not see each other's disks"},
        kThreads,
        kJson},
       run_gaps},
      {"fill",
       "IN SAMPLES OUT",
       "make a set of disks maximal, wherever it comes from",
       "SAMPLES is a sample set on the mesh IN (.xyzr .ply .csv), made by amps or by anything else; or none. OUT is the same "
       "set,\n"
       "bit by bit and in its order, and after it the samples that were missing. Samples off the surface and samples too "
       "close\n"
       "are told, and stay. Exit code 3: gaps are left, which hold no double.",
       {{"--radius", "R", "of new samples (default: the least in SAMPLES, which it must not exceed where disks are balls)"},
        {"--added", "FILE", "write the new samples alone, too ('amps render --added' draws them in red)"},
        {"--neighborhood", "KIND", "space or surface: disks are balls, or sheets do not see each other's disks"},
        kSeed,
        kThreads,
        kJson},
       run_fill},
      {"quality",
       "IN",
       "say how good the triangles of a mesh are",
       "IN is a mesh (.obj .off .ply .stl). Angles and valences as histograms; the columns of the paper's tables: angles, Q,\n"
       "% of triangles below 30 and above 90 degrees, v567; and, with a radius or radii, edges and areas over what they can "
       "be\n"
       "in the dual of a maximal set (|e'_max| and |t'_max| at most 1, |t'_min| at least 1, where there is one radius).\n"
       "Triangles beside curves are told apart: lines (l) of IN if it has some, else borders, or with --features what is "
       "found.",
       {{"--radius", "R", "the radius that IN was made with"},
        {"--samples", "FILE", "one sample a vertex, as 'amps remesh --samples' writes them, for radii that vary"},
        {"--features", "ANGLE", "curves are borders and creases of more than so many degrees"},
        {"--png", "FILE", "draw the histograms"},
        kThreads,
        kJson},
       run_quality},
      {"spectrum",
       "IN SAMPLES...",
       "say how random, even and isotropic sample sets are",
       "SAMPLES are sample sets (.xyzr .ply .csv) on the mesh IN, best ten or more of the same kind by different seeds: all\n"
       "numbers are means over them. Where IN is a rectangle along the axes, at one z, what is measured is the power by\n"
       "frequency in the square in its middle (white noise: 1): radial mean and anisotropy, effective Nyquist frequency and\n"
       "oscillation. On any other mesh, it is the density of differences between samples, in radii along the surface.",
       {{"--csv", "FILE", "write radial mean and anisotropy as curves"},
        {"--png", "FILE", "draw power by frequency, or density of differences: black 0, grey 1, white 2 or more"},
        {"--plot", "FILE", "draw radial mean and anisotropy as curves"},
        {"--border", "HOW", "window (default): the square is a part of something; periodic: it goes on as itself"},
        {"--max-frequency", "F", "periods a side, 4 to 8192 (default: 4 times the root of the number of samples)"},
        {"--differences", nullptr, "differences in any case"},
        {"--range", "R", "greatest difference, in radii (default 5)"},
        kThreads,
        kJson},
       run_spectrum},
      {"info",
       "IN",
       "say what a mesh is like, and what is wrong with it",
       "IN is a mesh (.obj .off .ply .stl). With a reference, such as the mesh IN was made from, also: how far the surfaces\n"
       "are apart. No point of either is farther from the other than the Hausdorff distance; root mean square (RMS) and mean\n"
       "are over each surface, and the greater of both directions is given. Curves are borders and creases of more than\n"
       "40 degrees, of all sizes; 'amps curves' tells which of them a wanted radius keeps.",
       {{"--reference", "FILE", "tell the distance to this mesh, too"}, kThreads, kJson},
       run_info},
      {"make",
       "SHAPE OUT",
       "write a sphere, torus, square, knot or cube",
       "OUT is a mesh (.obj .off .ply .stl).",
       {{"--n", "N", "about so many triangles (default 10000)"}},
       run_make},
      {"render",
       "IN OUT",
       "draw a picture of a mesh",
       "IN is a mesh (.obj .off .ply .stl), OUT a .png. Insides, seen through holes or on flipped triangles, are red.\n"
       "Curves are the lines (l) of IN if it has some, such as amps writes them; else, or with --features, they are found.\n"
       "Looks: shape; valence (around vertices with 5 neighbours blue, 6 green, 7 orange, others dark); angles (triangles "
       "with\n"
       "one below 30 or above 120 degrees dark, below 35 or above 105 red); radius (cool where small, warm where large: of\n"
       "samples, or of edges). Of a sample set: cells (of its power diagram on the surface), gaps (in no disk: red), disks.\n"
       "The picture fits the model. The circles of disks are those of balls.",
       {{"--size", "N", "width and height in pixels (default 1024)"},
        {"--look", "NAME", "shape (default), valence, angles, radius, cells, gaps or disks"},
        {"--legend", nullptr, "say in the picture what the colours of a look mean"},
        {"--samples", "FILE", "a sample set (.xyzr .ply .csv): each is a dot"},
        {"--no-dots", nullptr, "no dots, only what the look makes of the set"},
        {"--added", "FILE", "samples drawn as red dots, such as those that 'amps fill' added"},
        {"--view", "NAME", "front, back, left, right, top, bottom or iso, in place of both angles"},
        {"--zoom", "F", "so many times larger than what fits, about the middle"},
        {"--azimuth", "DEG", "walk around the model (default 30)"},
        {"--elevation", "DEG", "look down on it (default 18)"},
        {"--z-up", nullptr, "the model's up axis is z, not y"},
        {"--smooth", nullptr, "interpolate normals"},
        {"--no-edges", nullptr, "do not draw triangle edges"},
        {"--curves", nullptr, "draw curves as thick lines"},
        {"--features", "ANGLE", "borders, and creases of more than so many degrees (default 40) or none"},
        {"--radius", "R", "drop creases too small for this radius, as remesh does"},
        kThreads},
       run_render},
  };
  return kCommands;
}

void print_help() {
  std::printf("amps %d.%d.%d: maximal Poisson-disk sampling on surfaces, and remeshing with it\n\n", AMPS_VERSION_MAJOR,
              AMPS_VERSION_MINOR, AMPS_VERSION_PATCH);
  std::printf("usage: amps COMMAND ...\n\n");
  for (const Command& command : commands()) {
    std::printf("  %-24s %s\n", (std::string(command.name) + " " + command.operands).c_str(), command.summary);
  }
  std::printf("\n'amps COMMAND --help' tells the options of a command,\n'amps --version' the version.\n");
  std::printf("%s\n",
              wrapped("Exit codes: 0 done, 2 bad input or usage, 3 'gaps' found some or 'fill' left some, 4 'remesh' lost some "
                      "of the shape or missed --error, a number was not met --exact, 130 interrupted, 143 terminated.",
                      0, 0)
                  .c_str());
}

void print_help(const Command& command) {
  constexpr std::size_t kHelpColumn = 21;
  const auto wrapped_anew = [](std::string text, std::size_t column, std::size_t indent) {  // its lines are those of the source
    std::replace(text.begin(), text.end(), '\n', ' ');
    return wrapped(text, column, indent);
  };
  std::printf("usage: amps %s %s [options]\n\n%s: %s.\n%s\n\n", command.name, command.operands, command.name, command.summary,
              wrapped_anew(command.details, 0, 0).c_str());
  for (const std::vector<Option>& group : {command.options, common_options()}) {
    for (const Option& option : group) {
      const std::string name = option.value == nullptr ? option.name : std::string(option.name) + " " + option.value;
      std::printf("  %-18s %s\n", name.c_str(),
                  wrapped_anew(option.help, std::max(kHelpColumn, name.size() + 3), kHelpColumn).c_str());
    }
  }
}

/// Advice for those who call the library, in terms of options.
std::string in_options(const Arguments& arguments, std::string message) {
  const std::string limit = "more than max_samples, ";
  const std::size_t at = message.find(limit), advice = message.find("; use ");
  if (at == std::string::npos || advice == std::string::npos || advice < at) return message;
  for (const char* name : {"--vertices", "--rmin", "--rmax", "--error", "--sizing"}) {
    if (!arguments.has(name)) continue;
    const bool fewer = name == std::string("--vertices"), file = name == std::string("--sizing");
    message.replace(
        advice, std::string::npos,
        fewer ? "; ask for fewer --vertices"
              : std::string("; ") + (file ? "use larger radii in " : "use a larger ") + (file ? arguments.text(name) : name));
    break;
  }
  return message.replace(at, limit.size(), "more than ");
}

int run(const std::vector<std::string>& words) {
  if (words.empty()) throw UsageError("amps: no command given (see 'amps --help')");
  const std::string& name = words.front();
  if (name == "--help" || name == "-h" || name == "help") {
    print_help();
    return kExitDone;
  }
  if (name == "--version") {
    std::printf("amps %d.%d.%d\n", AMPS_VERSION_MAJOR, AMPS_VERSION_MINOR, AMPS_VERSION_PATCH);
    return kExitDone;
  }
  std::vector<std::string> known;
  for (const Command& command : commands()) {
    known.emplace_back(command.name);
    if (name != command.name) continue;
    const Arguments arguments(command, {words.begin() + 1, words.end()});
    if (arguments.has("--help")) {
      print_help(command);
      return kExitDone;
    }
    try {
      return command.run(arguments);
    } catch (const amps::Error& error) {
      throw amps::Error(error.code(), in_options(arguments, error.what()));
    }
  }
  throw UsageError("amps: unknown command " + name + did_you_mean(name, known) + " (see 'amps --help')");
}

}  // namespace

int main(int argc, char** argv) {
  const auto interruption = [] {
    std::fprintf(stderr, "amps: interrupted, nothing is written\n");
    return kExitSignal + interrupted;
  };
#ifdef SIGXFSZ
  std::signal(SIGXFSZ, SIG_IGN);  // writing then fails, and what is half-written is taken away
#endif
  try {
    const int code = run({argv + 1, argv + argc});
    if (std::fflush(stdout) != 0) return complain("cannot write to the standard output");
    return code;
  } catch (const Interrupted&) {
    return interruption();
  } catch (const amps::Error& error) {
    return error.code() == amps::ErrorCode::kCancelled ? interruption() : complain(error.what());
  } catch (const std::bad_alloc&) {
    return complain("out of memory; use a larger radius or fewer vertices");
  } catch (const std::exception& error) {
    return complain(error.what());
  }
}
