// reproduce_paper.cpp: the tables and figures of Yan & Wonka, "Adaptive maximal Poisson-disk sampling on surfaces" (SIGGRAPH
// Asia 2012 Technical Briefs), made anew: a page as HTML and Markdown, with pictures. examples/reproduce_paper.sh runs it.
//
//   reproduce_paper OUT_DIRECTORY [DATA_DIRECTORY] [SEEDS]
//
// Exit codes: 0 done, 1 a law of the paper does not hold (the page is there, a line on stderr says which), 2 trouble.
//
// Read from the bottom: main() makes one section after the other. Models come from the data directory; where one is missing, a
// shape of our own stands in, and the page says so.

#include "amps/amps.h"
#include "report_page.h"
#include "reproduce_common.h"
#include "reproduce_figures.h"
#include "reproduce_spectra.h"
#include "reproduce_tables.h"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace reproduce {
namespace {

void what_was_guessed(const Run& run, Page& page) {
  page.heading("What is known and what was guessed");
  page.list({
      "The paper's numbers here are those that the notes of this project hold; a dash stands where they hold none. Its text "
      "was not at hand.",
      "Figure 1 follows the paper's caption. Figures 2 to 4 show what the method does (gaps and their primitives, cells and "
      "dual, valences and angles); they need not be the same pictures.",
      "Scale of the models: not known. Where a radius is known (4.5e-3 on shapes of known area), it is taken as it is; "
      "elsewhere "
      "radii follow from the number of vertices, so that no scale is needed.",
      format("Figure 7: r = .012 of the paper means nothing without the scale of its model; r is such that a maximal set has "
             "about 4,560 samples, by %.4f area / r^2.",
             amps::kSamplesPerDensity),
      "Local feature size: r = s lfs, s so that the number of vertices is the paper's; lfs by poles, filtered as sizing.h "
      "says.",
      format("r_max = %g r_min, as in the paper; r_min is raised on the 1 %% of the surface where it is smallest.",
             amps::kDefaultRatio),
      format("Radii grow by at most %g along the surface: it sets the worst angles of sets as sampled. Whether the paper has "
             "such a limit is not known.",
             amps::kDefaultGradation),
      "Upper bound of angles where radii vary: 114 degrees, where the paper has 115, so that Q_min reaches its 0.51.",
      "The bunny is a closed one of 100,000 facets; which one the paper has is not known, nor is the model of its Figure 7: "
      "here "
      "it is the bunny.",
      "Columns of Table 1: |e'_max|, |t'_min|, |t'_max| are taken as ratios to the bounds of the theorem, as said there.",
  });
  if (!run.stand_ins.empty()) page.list(run.stand_ins);
}

int reproduce_all(int argc, char** argv) {
  if (argc < 2 || argc > 4) {
    std::fprintf(stderr, "usage: reproduce_paper OUT_DIRECTORY [DATA_DIRECTORY] [SEEDS]\n");
    return 2;
  }
  Run run;
  if (argc > 2) run.data = argv[2];
  if (argc > 3) {
    char* end = nullptr;
    const long seeds = std::strtol(argv[3], &end, 10);
    if (*argv[3] == '\0' || *end != '\0' || seeds < 1 || seeds > 1000) {
      std::fprintf(stderr, "reproduce_paper: SEEDS is a number from 1 to 1000, not '%s'\n", argv[3]);
      return 2;
    }
    run.seeds = static_cast<std::uint64_t>(seeds);
  }
  const fs::path out = argv[1];
  fs::create_directories(out);
  Page page(out);
  const std::string title = "Adaptive maximal Poisson-disk sampling on surfaces, reproduced";
  page.heading(title, 1);
  page.text(
      format("Tables and figures of Yan & Wonka (SIGGRAPH Asia 2012), made by amps %d.%d.%d: medians over seeds 1 to %d, the "
             "least and the "
             "greatest in parentheses; the paper's numbers below, in grey.",
             AMPS_VERSION_MAJOR, AMPS_VERSION_MINOR, AMPS_VERSION_PATCH, static_cast<int>(run.seeds)));
  const std::vector<std::pair<const char*, std::function<void()>>> sections = {
      {"Table 1", [&] { table_1(run, page); }},   {"Table 2", [&] { table_2(run, page); }},
      {"Figure 1", [&] { figure_1(run, page); }}, {"Figure 2", [&] { figure_2(run, page); }},
      {"Figure 3", [&] { figure_3(run, page); }}, {"Figure 4", [&] { figure_4(run, page); }},
      {"Figure 5", [&] { figure_5(run, page); }}, {"Figure 6", [&] { figure_6(run, page); }},
      {"Figure 7", [&] { figure_7(run, page); }}, {"what was guessed", [&] { what_was_guessed(run, page); }}};
  for (const auto& [name, make] : sections) {
    std::printf("%-18s", name);
    std::fflush(stdout);
    std::printf(" %6.1f s\n", seconds_of(make));
  }
  page.save(title);
  std::printf("wrote %s and %s\n", (out / "index.html").string().c_str(), (out / "index.md").string().c_str());
  for (const std::string& law : run.failures) std::fprintf(stderr, "reproduce_paper: this does not hold: %s\n", law.c_str());
  return run.failures.empty() ? 0 : 1;
}

}  // namespace
}  // namespace reproduce

int main(int argc, char** argv) {
  try {
    return reproduce::reproduce_all(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "reproduce_paper: %s\n", error.what());
    return 2;
  }
}
