// cli_commands.h: what commands share — exit codes, the shares of their parts of the time, errors as one line, and the options
// of sampling.
#pragma once

#include "amps/amps.h"
#include "cli_arguments.h"
#include "cli_sizing.h"
#include "cli_terminal.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>

constexpr int kExitDone = 0;
constexpr int kExitTrouble = 2;
constexpr int kExitGaps = 3;
constexpr int kExitShape = 4;
constexpr int kExitSignal = 128;  // and its number, as a shell reports it

/// Where the parts of a command end, of its time: rough, since it depends on input and options.
constexpr double kRead = 0.03, kMarked = 0.04, kSized = 0.25, kSampled = 0.85, kRemeshed = 0.75, kWorked = 0.96;

/// --neighborhood
inline amps::Neighborhood neighborhood_of(const Arguments& arguments, amps::Neighborhood standard) {
  if (!arguments.has("--neighborhood")) return standard;
  const std::string name = arguments.text("--neighborhood");
  if (name == "surface") return amps::Neighborhood::kSurface;
  if (name == "space") return amps::Neighborhood::kSpace;
  throw arguments.error("--neighborhood " + name + ": name surface or space");
}

inline amps::SamplingOptions sampling_options(const Arguments& arguments, amps::Neighborhood neighborhood) {
  amps::SamplingOptions options;
  options.radius = arguments.positive("--radius");
  options.target_count = static_cast<amps::Index>(arguments.whole("--vertices", 0, 1, kMostVertices));
  options.exact_count = arguments.has("--exact");
  if (options.exact_count && options.target_count == 0) throw arguments.error("--exact goes with --vertices N");
  options.seed = arguments.whole("--seed", options.seed, 0, UINT64_MAX);
  options.execution.threads = threads_of(arguments);
  options.neighborhood = neighborhood_of(arguments, neighborhood);
  return options;
}

/// Errors are one line each, whatever a file name holds.
int complain(std::string message, int code = kExitTrouble) {
  if (message.compare(0, 4, "amps") != 0) message = "amps: " + message;
  std::replace_if(
      message.begin(), message.end(), [](char c) { return c == '\n' || c == '\r'; }, ' ');
  const std::size_t prefix = std::min(message.find(':'), message.size());
  message.replace(0, prefix, in_colour(kTroubleColour, message.substr(0, prefix)));
  std::fprintf(stderr, "%s\n", message.c_str());
  return code;
}
