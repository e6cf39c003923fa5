// cli_sample.h: amps sample.
#pragma once

#include "amps/amps.h"
#include "cli_commands.h"
#include "cli_files.h"
#include "cli_output.h"
#include "cli_report.h"
#include "cli_sizing.h"
#include "cli_watch.h"

#include <string>

inline int run_sample(const Arguments& arguments) {
  const SizingRequest sizing = sizing_request(arguments);
  amps::SamplingOptions options = sampling_options(arguments, amps::Neighborhood::kSpace);
  Files files(arguments);
  files.reads("IN", arguments.operand(0), Holds::kMesh);
  name_sizing_file(files, sizing);
  files.writes("OUT", arguments.operand(1), Holds::kSamples);
  files.writes("--json", Holds::kOther);
  files.look();

  const Stopwatch total;
  Watch watch(arguments.quiet(), options.execution.threads);
  const amps::Mesh mesh = files.mesh_to_sample(arguments.operand(0), watch.part(0, kRead));
  const double seconds_read = total.seconds();
  const double sized = sizing.kind == "uniform" ? kRead : kSized;
  options.sizing = make_sizing(sizing, mesh, watch.part(kRead, sized));
  const double seconds_sizing = total.seconds() - seconds_read;
  options.execution = watch.part(sized, kSampled);
  const amps::SamplingResult result = amps::sample(mesh, options);
  watch.check(result.status);
  const Stopwatch verify;
  const amps::MaximalityReport certificate =
      amps::verify_maximal(mesh, result.samples, watch.part(kSampled, kWorked), options.conflict_rule, options.neighborhood);
  const double seconds_verify = verify.seconds();
  const Stopwatch write;
  files.write(arguments.operand(1), result.samples, watch.part(kWorked, 1));
  Seconds seconds{{"read", seconds_read}, {"sizing", seconds_sizing}};
  for (const auto& stage : seconds_of(result.report)) seconds.push_back(stage);
  seconds.insert(seconds.end(), {{"verify", seconds_verify}, {"write", write.seconds()}, {"total", total.seconds()}});

  Json json = begin_json("sample");
  json.add("status", amps::name_of(result.status));
  json.add("samples", result.samples.size());
  add_radii(json, result.samples);
  add_sampling(json, result.report);
  add_exact_count(json, result.report.exact_count);
  add_maximality(json, certificate);
  add_seconds(json, seconds);
  files.write(json);
  watch.finish();

  const Table table = files.table();
  table.row("samples", of_wanted(result.samples.size(), options.target_count, result.status));
  table.row("of darts and of gaps", number(result.report.dart_samples) + " and " + number(result.report.gap_samples));
  print_exact_count(table, result.report.exact_count);
  print_radii(table, result.samples);
  print_maximality(table, certificate);
  print_unfilled(table, result.report);
  print_seconds(table, seconds);
  const std::string missed = amps::missed_count(result.report.exact_count);
  return missed.empty() ? kExitDone : complain(missed, kExitShape);
}
