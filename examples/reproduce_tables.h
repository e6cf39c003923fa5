// reproduce_tables.h: Tables 1 and 2 of the paper, for reproduce_paper.cpp.
#pragma once

#include "amps/amps.h"
#include "report_page.h"
#include "reproduce_common.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace reproduce {

struct Table1Row {
  Values samples, min_angle, max_angle, e_max, t_min, t_max, v567;

  /// Is the set within the bounds of maximal ones?
  bool add(const Mesh& mesh, const SampleSet& set) {
    constexpr double kRounding = 1e-9;
    const Mesh dual = amps::restricted_triangulation(mesh, set);
    const amps::QualityReport q = amps::quality(dual);
    const amps::BoundRatios ratios = amps::bound_ratios(dual, set.radii);
    samples.add(set.size() / 1000.0);
    min_angle.add(q.min_angle);
    max_angle.add(q.max_angle);
    e_max.add(ratios.max_edge);
    t_min.add(ratios.min_area);
    t_max.add(ratios.max_area);
    v567.add(q.valence_5_6_7);
    return q.min_angle >= 30 - kRounding && q.max_angle <= 120 + kRounding && ratios.min_edge >= 1 - kRounding &&
           ratios.max_edge <= 1 + kRounding && ratios.min_area >= 1 - kRounding && ratios.max_area <= 1 + kRounding;
  }
  std::vector<std::string> cells(const std::string& name) const {
    return {name,
            samples.text("%.1fk"),
            min_angle.text("%.1f\xC2\xB0"),
            max_angle.text("%.1f\xC2\xB0"),
            e_max.text("%.3f"),
            t_min.text("%.3f"),
            t_max.text("%.3f"),
            v567.text("%.1f %%")};
  }
};

inline void table_1(Run& run, Page& page) {
  constexpr double kRadius = 4.5e-3;
  page.heading("Table 1: one radius, on a square and a sphere");
  page.text(
      format("r = 4.5e-3 on the unit square and on a sphere of area 0.863; medians over seeds 1 to %d, with the least and the "
             "greatest. |e'_max| is the longest edge over 2r, |t'_min| the smallest area over that of the equilateral "
             "triangle of edges r, |t'_max| the largest area over that of the equilateral one in a circle of radius r: "
             "for maximal sets they are at most 1, at least 1 and at most 1, by theorem.",
             static_cast<int>(run.seeds)));
  struct Known {
    const char *darts, *darts_v567, *maximal, *maximal_v567, *optimized;
  };
  const std::vector<std::pair<std::string, Mesh>> surfaces = {{"square", amps::make_square()},
                                                              {"sphere", sphere_of_area(0.863)}};
  const std::vector<Known> known = {{"26.8k", "94.2 %", "34.5k", "96.4 %", "35.1k"},
                                    {"23.5k", "94.5 %", "29.7k", "96.6 %", "30.4k"}};
  std::vector<std::vector<std::string>> rows;
  const std::string no = kNotKnown;
  for (std::size_t s = 0; s < surfaces.size(); ++s) {
    const auto& [name, mesh] = surfaces[s];
    Table1Row darts, maximal, usual, acute;
    for (std::uint64_t seed = 1; seed <= run.seeds; ++seed) {
      darts.add(mesh, amps::throw_darts(mesh, with_radius(kRadius, seed)).samples);
      const SampleSet set = amps::sample(mesh, with_radius(kRadius, seed)).samples;
      run.check(maximal.add(mesh, set), "angles, edges and areas of maximal sets are within their bounds: " + name);
      usual.add(mesh, optimized(mesh, set, 35, 105, seed));
      acute.add(mesh, optimized(mesh, set, 42, 90, seed));
    }
    rows.push_back(darts.cells(name + ", darts (k = 300)"));
    rows.push_back({"paper", known[s].darts, no, no, no, no, no, known[s].darts_v567});
    rows.push_back(maximal.cells(name + ", maximal"));
    rows.push_back({"paper", known[s].maximal, no, no, no, no, no, known[s].maximal_v567});
    rows.push_back(usual.cells(name + ", optimised to [35\xC2\xB0, 105\xC2\xB0]"));
    rows.push_back({"paper", known[s].optimized, "35\xC2\xB0", "105\xC2\xB0", no, no, no, "100 %"});
    rows.push_back(acute.cells(name + ", optimised to [42\xC2\xB0, 90\xC2\xB0]"));
  }
  page.table({"surface and set", "samples", "least angle", "greatest angle", "|e'_max|", "|t'_min|", "|t'_max|", "v567"}, rows,
             "paper");
}

struct Table2Row {
  Values samples, min_q, min_angle, max_angle, below_30, v567, hausdorff, rms, seconds;

  void add(const Mesh& mesh, const Mesh& dual, double time) {
    const amps::QualityReport q = amps::quality(dual);
    const amps::DistanceReport distance = amps::surface_distance(mesh, dual);
    samples.add(static_cast<double>(dual.vertices.rows()) / 1000);
    min_q.add(q.min_q);
    min_angle.add(q.min_angle);
    max_angle.add(q.max_angle);
    below_30.add(q.below_30);
    v567.add(q.valence_5_6_7);
    hausdorff.add(distance.percent(distance.hausdorff()));
    rms.add(distance.percent(distance.rms()));
    seconds.add(time);
  }
  std::vector<std::string> cells(const std::string& name) const {
    return {name,
            samples.text("%.1fk"),
            min_q.text("%.2f"),
            min_angle.text("%.1f\xC2\xB0"),
            max_angle.text("%.1f\xC2\xB0"),
            below_30.text("%.2f %%"),
            v567.text("%.1f %%"),
            hausdorff.text("%.2f %%"),
            rms.text("%.3f %%"),
            seconds.text("%.2f")};
  }
};

inline void table_2(Run& run, Page& page) {
  page.heading("Table 2: radii by local feature size");
  page.text(
      "Bunny (B) and triceratops (T). MPS: maximal sets as sampled. Distances are the greater of both directions, in % of the "
      "diagonal of the input's bounding box. Seconds are those of the field, sampling, optimisation and triangles together, "
      "from the "
      "mesh in memory; the paper's were measured on other machines.");
  const std::string no = kNotKnown;
  std::vector<std::vector<std::string>> rows;
  struct Case {
    std::string name;
    Mesh mesh;
    double sampled, optimized;
    std::vector<std::string> paper_sampled, paper_optimized;
  };
  const std::vector<Case> cases = {
      {"B",
       run.bunny(),
       9800,
       12000,
       {"paper, B[MPS]", "9.8k", "0.36", "19.2\xC2\xB0", "133.2\xC2\xB0", "0.90 %", "94.7 %", no, no, no},
       {"paper, B[ours]", "12k", "0.51", "32\xC2\xB0", "115\xC2\xB0", "0 %", "100 %", "0.37 %", "0.035 %", "23.7"}},
      {"T",
       run.triceratops(),
       9000,
       9000,
       {"paper, T[MPS]", "9k", "0.29", "13.5\xC2\xB0", "138.6\xC2\xB0", "1.23 %", "92.0 %", no, no, no},
       {"paper, T[ours]", "9k", "0.51", "32\xC2\xB0", "115\xC2\xB0", "0 %", "100 %", "0.46 %", "0.062 %", no}}};
  for (const Case& c : cases) {
    Table2Row sampled, result;
    for (std::uint64_t seed = 1; seed <= run.seeds; ++seed) {
      for (const bool optimize : {false, true}) {
        Mesh dual;
        const double time = seconds_of([&] {
          amps::SamplingOptions options;
          options.sizing = feature_sizing(c.mesh, optimize ? c.optimized : c.sampled);
          options.seed = seed;
          SampleSet set = amps::sample(c.mesh, options).samples;
          if (optimize) set = optimized(c.mesh, set, 32, 114, seed, options.sizing);
          dual = amps::restricted_triangulation(c.mesh, set);
        });
        (optimize ? result : sampled).add(c.mesh, dual, time);
      }
    }
    rows.push_back(sampled.cells(c.name + "[MPS]"));
    rows.push_back(c.paper_sampled);
    rows.push_back(result.cells(c.name + "[optimised], [32\xC2\xB0, 114\xC2\xB0]"));
    rows.push_back(c.paper_optimized);
  }
  page.table(
      {"set", "vertices", "Q_min", "least angle", "greatest angle", "< 30\xC2\xB0", "v567", "Hausdorff", "RMS", "seconds"},
      rows, "paper");
}

}  // namespace reproduce
