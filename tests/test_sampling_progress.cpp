// Sampling watched and cancelled.
#include "amps/sampling.h"

#include "kit/execution.h"
#include "kit/maximality.h"

#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <array>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace amps_test {

TEST_CASE("sampling: cancelled at any stage, what is there is a Poisson-disk set and says so") {
  const Mesh mesh = amps::make_torus();
  const double radius = 0.06;
  const SampleSet done = amps::sample(mesh, with_radius(radius)).samples;
  std::map<std::string, int> reports;
  SamplingOptions count = with_radius(radius);
  watch(count, [&](const char* stage, double) { return ++reports[stage] > 0; });
  amps::sample(mesh, count);
  REQUIRE(reports.size() == 4);
  for (const auto& entry : reports) {
    const std::string wanted = entry.first;
    CAPTURE(wanted);
    REQUIRE(entry.second > 16);
    for (const int last : {8, (entry.second + 1) / 2, entry.second - 2}) {  // the last of all tells that it is done
      CAPTURE(last);
      int seen = 0;
      SamplingOptions options = with_radius(radius);
      watch(options, [&](const char* stage, double) { return stage != wanted || ++seen < last; });
      const SamplingResult result = amps::sample(mesh, options);
      CHECK(result.status == Outcome::kCancelled);
      CHECK(cancelled(options));
      if (result.samples.size() == 0) {  // while it prepared to throw
        CHECK((wanted == "throwing darts" && last == 8));
        continue;
      }
      CHECK(result.samples.size() < done.size());
      CHECK(separation_of_all_pairs(result.samples) >= 1 - 1e-9);
      check_placement(mesh, result.samples);
      // As far as it came it is the whole run (darts that were not all thrown are in the order they were), and it can be
      // finished.
      if (wanted == "throwing darts") {
        std::set<std::array<double, 3>> all;
        for (Index s = 0; s < done.size(); ++s) all.insert({done.positions(s, 0), done.positions(s, 1), done.positions(s, 2)});
        Index strangers = 0;
        for (Index s = 0; s < result.samples.size(); ++s) {
          const Vec3 x = sample_at(result.samples, s);
          strangers += static_cast<Index>(1 - all.count({x[0], x[1], x[2]}));
        }
        CHECK(strangers == 0);
      } else {
        CHECK(same_set(result.samples, head(done, result.samples.size())));
      }
      check_maximal(mesh, amps::fill_gaps(mesh, result.samples, with_radius(radius)));
    }
  }
  // Before it began.
  SamplingOptions options = with_radius(radius);
  cancel(options);
  CHECK(amps::sample(mesh, options).status == Outcome::kCancelled);
  CHECK(amps::throw_darts(mesh, options).status == Outcome::kCancelled);
  CHECK(amps::fill_gaps(mesh, selected(done, [](Index s) { return s % 2 == 0; }), options).status == Outcome::kCancelled);
  options = with_count(2000);
  cancel(options);
  CHECK(amps::sample(mesh, options).status == Outcome::kCancelled);
}

TEST_CASE("sampling: progress never falls, names each stage of each attempt, and ends at 1") {
  for (const bool by_count : {false, true}) {
    SamplingOptions options = by_count ? with_count(6000) : with_radius(0.03);
    std::string last_stage;
    double last = 0;
    std::vector<std::string> stages;
    bool growing = true;
    watch(options, [&](const char* stage, double fraction) {
      if (stage != last_stage) stages.emplace_back(stage);
      growing = growing && fraction >= last && fraction <= 1;
      last_stage = stage;
      last = fraction;
      return true;
    });
    const SamplingResult result = amps::sample(amps::make_torus(), options);
    CHECK(result.status == Outcome::kDone);
    CHECK(growing);
    CHECK(last == 1);
    const std::vector<std::string> of_attempt = {"throwing darts", "triangulating samples", "dividing the surface",
                                                 "filling gaps"};
    std::vector<std::string> wanted;
    for (int k = 0; k < result.report.attempts; ++k) wanted.insert(wanted.end(), of_attempt.begin(), of_attempt.end());
    CHECK(stages == wanted);
  }
}

}  // namespace amps_test
