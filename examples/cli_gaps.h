// cli_gaps.h: amps gaps.
#pragma once

#include "amps/amps.h"
#include "cli_commands.h"
#include "cli_files.h"
#include "cli_fill.h"
#include "cli_output.h"
#include "cli_report.h"
#include "cli_watch.h"

#include <string>
#include <vector>

inline int run_gaps(const Arguments& arguments) {
  neighborhood_of(arguments, amps::Neighborhood::kSpace);  // refuses other names, before the work
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  files.reads("SAMPLES", arguments.operand(1), Holds::kSamples);
  if (arguments.operands() > 2) files.writes("OUT", arguments.operand(2), Holds::kMesh);
  files.writes("--json", Holds::kOther);
  files.look();
  Watch watch(arguments.quiet(), threads_of(arguments));
  const amps::Mesh mesh = files.usable_mesh(arguments.operand(0), watch.part(0, 0.05));
  const amps::SampleSet samples = files.samples(arguments.operand(1), watch.part(0.05, 0.1));
  // Sets that say what of the surface their samples are on are those of remesh.
  const amps::Neighborhood neighborhood =
      neighborhood_of(arguments, samples.dimensions.empty() ? amps::Neighborhood::kSpace : amps::Neighborhood::kSurface);
  const ForeignSet foreign = look_at_set(mesh, samples, watch.part(0.1, 0.2));
  const amps::MaximalityReport report =
      amps::verify_maximal(mesh, samples, watch.part(0.2, 0.5), amps::ConflictRule::kMax, neighborhood);
  const double area = amps::total_area(mesh, watch.part(0.5, 0.51));
  if (arguments.operands() > 2 && report.gaps > 0) {
    const amps::GapSet gaps = amps::find_gaps(mesh, samples, watch.part(0.51, kWorked), neighborhood);
    files.write(arguments.operand(2), gaps.primitives, {}, watch.part(kWorked, 1));
  }

  Json json = begin_json("gaps");
  json.add("samples", samples.size()).add("surface_area", area);
  add_radii(json, samples);
  add_foreign(json, foreign);
  add_maximality(json, report);
  files.write(json);
  watch.finish();

  const Table table = files.table();
  table.row("samples", number(samples.size()));
  print_foreign(table, foreign, neighborhood == amps::Neighborhood::kSpace);
  print_radii(table, samples);
  table.row("maximal", report.maximal() ? "yes" : "no");
  table.row("Poisson-disk", report.poisson_disk() ? "yes" : "no");
  print_maximality(table, report);
  if (std::isfinite(report.worst_coverage)) {
    const amps::Vec3& x = report.worst_point;
    table.row("  which is at", format("%.6g %.6g %.6g", x.x(), x.y(), x.z()));
  }
  table.row("gaps", number(report.gaps));
  table.row("area of gaps", format("%.6g   (%.3g %% of the surface)", report.gap_area, 100 * report.gap_area / area));
  if (arguments.operands() > 2) {
    const std::string out = Files::shown(arguments.operand(2), Files::kOutput);
    table.row("gap primitives", report.gaps > 0 ? "in " + out : "none, " + out + " is not written");
  }
  return report.maximal() ? kExitDone : kExitGaps;
}
