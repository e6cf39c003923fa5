// cli_fill.h: amps fill — sets made elsewhere: what is wrong with them, and where their samples are after filling.
#pragma once

#include "amps/amps.h"
#include "cli_commands.h"
#include "cli_files.h"
#include "cli_output.h"
#include "cli_report.h"
#include "cli_watch.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <istream>
#include <string>
#include <vector>

/// Is it the word "none", or a text (.xyzr, .csv) of samples without any?
inline bool names_no_samples(const Files& files, const std::string& name) {
  if (name == "none") return true;
  const amps::SampleFormat format = files.sample_format(name, true);
  if (format == amps::SampleFormat::kPly) return false;
  return files.content(name, [&](std::istream& in) {
    bool head = format == amps::SampleFormat::kCsv;  // of names
    for (std::string line; std::getline(in, line);) {
      const std::size_t first = line.find_first_not_of(" \t\r");
      if (first == std::string::npos || line[first] == '#') continue;
      if (!head) return false;
      head = false;
    }
    return true;
  });
}

/// What is wrong with a set that comes from elsewhere.
struct ForeignSet {
  amps::Index off_surface = 0;    ///< samples farther from the surface than kOff of their radius
  amps::Index beside_it = 0;      ///< of these, so far that their disks hold nothing of it
  double farthest = 0;            ///< from the surface, in radii of that sample
  amps::Index close_pairs = 0;    ///< nearer than the greater radius of both; where disks are balls
  amps::Index close_samples = 0;  ///< in these
};

inline ForeignSet look_at_set(const amps::Mesh& mesh, const amps::SampleSet& samples, const amps::Execution& execution) {
  constexpr double kOff = 1e-6;       // of the radius: files in single precision are not off
  constexpr double kRounding = 1e-9;  // as MaximalityReport::poisson_disk
  ForeignSet set;
  const amps::SurfaceTree surface(mesh, execution.part(0, 0.3));
  const std::vector<amps::SurfaceHit> hits = surface.nearest_all(samples.positions, execution.part(0.3, 0.7));
  for (std::size_t s = 0; s < hits.size(); ++s) {
    const double off = hits[s].distance / samples.radii[s];
    set.off_surface += off > kOff;
    set.beside_it += off > 1;
    set.farthest = std::max(set.farthest, off);
  }
  const amps::KdTree tree(samples.positions, execution.part(0.7, 0.8));
  std::vector<amps::KdTree::Neighbor> around;
  std::vector<char> close(hits.size(), 0);
  for (amps::Index s = 0; s < samples.size(); ++s) {
    if (s % 1024 == 0) execution.check();
    const auto i = static_cast<std::size_t>(s);
    const double radius = samples.radii[i] * (1 - kRounding);
    tree.in_radius(samples.positions.row(s), radius, around);
    for (const amps::KdTree::Neighbor& other : around) {
      const auto j = static_cast<std::size_t>(other.index);
      if (other.index == s || other.squared_distance >= radius * radius) continue;
      close[i] = close[j] = 1;
      // The other one sees this pair too if it is as near for its radius.
      const double of_other = samples.radii[j] * (1 - kRounding);
      set.close_pairs += other.squared_distance >= of_other * of_other || s < other.index;
    }
  }
  set.close_samples = static_cast<amps::Index>(std::count(close.begin(), close.end(), 1));
  return set;
}

/// The filled set as it can be written: as `before` tells where its samples are, so does the whole. Facets that only the new
/// samples have are left out; on what of the surface they are, is: on a facet.
inline amps::SampleSet as_written(amps::SampleSet filled, const amps::SampleSet& before) {
  const auto n = static_cast<std::size_t>(filled.size());
  if (before.size() > 0 && before.facets.empty()) {
    filled.facets.clear();
    filled.barycentrics.resize(0);
  }
  if (!before.dimensions.empty()) {
    constexpr std::uint8_t kOnFacet = 2;
    filled.dimensions = before.dimensions;
    filled.curves = before.curves;
    filled.parameters = before.parameters;
    filled.dimensions.resize(n, kOnFacet);
    filled.curves.resize(n, amps::kNone);
    filled.parameters.resize(n, 0.0);
  }
  return filled;
}

/// The samples from `first` on.
inline amps::SampleSet samples_from(const amps::SampleSet& samples, amps::Index first) {
  const auto from = static_cast<std::ptrdiff_t>(first);
  const std::ptrdiff_t rows = samples.positions.rows() - from;
  amps::SampleSet rest;
  rest.positions.resize(rows);
  rest.radii.assign(samples.radii.begin() + from, samples.radii.end());
  for (std::ptrdiff_t i = 0; i < rows; ++i) rest.positions.row(i) = samples.positions.row(from + i);
  if (!samples.facets.empty()) {
    rest.facets.assign(samples.facets.begin() + from, samples.facets.end());
    rest.barycentrics.resize(rows);
    for (std::ptrdiff_t i = 0; i < rows; ++i) rest.barycentrics.row(i) = samples.barycentrics.row(from + i);
  }
  return rest;
}

/// `balls`: disks are balls; else samples may be as near in space as their sheets are.
inline void print_foreign(const Table& table, const ForeignSet& set, bool balls) {
  if (set.off_surface > 0) {
    table.row("off the surface", number(set.off_surface) + format(" samples, by up to %.3g r", set.farthest));
  }
  if (set.beside_it > 0) table.row("beside it", number(set.beside_it) + " samples, whose disks hold nothing of it");
  if (balls && set.close_pairs > 0) {
    table.row("too close", number(set.close_pairs) + " pairs of samples, nearer than the greater of their radii");
  }
}

inline void add_foreign(Json& json, const ForeignSet& set) {
  json.add("off_surface", set.off_surface)
      .add("farthest_off", set.farthest)
      .add("beside_surface", set.beside_it)
      .add("close_pairs", set.close_pairs)
      .add("close_samples", set.close_samples);
}

inline int run_fill(const Arguments& arguments) {
  neighborhood_of(arguments, amps::Neighborhood::kSpace);  // refuses other names, before the work
  amps::SamplingOptions options;
  options.radius = arguments.positive("--radius");
  options.seed = arguments.whole("--seed", options.seed, 0, UINT64_MAX);
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  if (arguments.operand(1) != "none") files.reads("SAMPLES", arguments.operand(1), Holds::kSamples);
  files.writes("OUT", arguments.operand(2), Holds::kSamples);
  files.writes("--added", Holds::kSamples);
  files.writes("--json", Holds::kOther);
  files.look();
  const bool from_nothing = names_no_samples(files, arguments.operand(1));
  if (from_nothing && options.radius == 0) {
    throw arguments.error("there are no samples in " + Files::shown(arguments.operand(1), Files::kInput) +
                          ": say --radius R for new ones");
  }
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = files.mesh_to_sample(arguments.operand(0), watch.part(0, 0.05));
  amps::SampleSet before;
  if (!from_nothing) before = files.samples(arguments.operand(1), watch.part(0.05, 0.1));
  options.neighborhood =
      neighborhood_of(arguments, before.dimensions.empty() ? amps::Neighborhood::kSpace : amps::Neighborhood::kSurface);
  const bool balls = options.neighborhood == amps::Neighborhood::kSpace;

  ForeignSet foreign;
  amps::MaximalityReport was;
  if (!from_nothing) {
    foreign = look_at_set(mesh, before, watch.part(0.1, 0.2));
    was = amps::verify_maximal(mesh, before, watch.part(0.2, 0.35), options.conflict_rule, options.neighborhood);
  }
  options.execution = watch.part(0.35, 0.75);
  amps::SamplingResult result = from_nothing ? amps::sample(mesh, options) : amps::fill_gaps(mesh, before, options);
  watch.check(result.status);
  const amps::SampleSet filled = as_written(std::move(result.samples), before);
  const amps::MaximalityReport is =
      amps::verify_maximal(mesh, filled, watch.part(0.75, kWorked), options.conflict_rule, options.neighborhood);
  const amps::SampleSet added = samples_from(filled, before.size());
  files.write(arguments.operand(2), filled, watch.part(kWorked, 1));  // once it is in place, the others are written too
  const bool writes_added = arguments.has("--added") && added.size() > 0;
  if (writes_added) files.write(arguments.text("--added"), added, {});

  Json json = begin_json("fill");
  json.add("samples_before", before.size()).add("samples", filled.size()).add("added", added.size());
  add_radii(json, filled);
  add_foreign(json, foreign);
  if (!from_nothing) {
    json.open("before");
    add_maximality(json, was);
    json.close();
  }
  add_maximality(json, is);
  files.write(json);
  watch.finish();

  const Table table = files.table();
  table.row("", "before", "after");
  table.row("samples", number(before.size()), number(filled.size()));
  table.row("gaps", from_nothing ? "" : number(was.gaps), number(is.gaps));
  if (!from_nothing) table.row("worst coverage", format("%.6f r", was.worst_coverage), format("%.6f r", is.worst_coverage));
  table.row("added", number(added.size()) + (before.size() == 0  ? ""
                                             : added.size() == 0 ? ", the set was maximal"
                                                                 : ", after the others, which stay as they are"));
  if (arguments.has("--added")) {
    const std::string file = Files::shown(arguments.text("--added"), Files::kOutput);
    table.row("new samples", writes_added ? "in " + file : "none, " + file + " is not written");
  }
  print_foreign(table, foreign, balls);
  print_radii(table, filled);
  table.row("maximal", is.maximal() ? "yes" : "no");
  table.row("Poisson-disk", is.poisson_disk() ? "yes" : "no, samples given are nearer than their radii");
  print_maximality(table, is);
  print_unfilled(table, result.report);
  return is.maximal() ? kExitDone : kExitGaps;
}
