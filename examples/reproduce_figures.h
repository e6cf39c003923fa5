// reproduce_figures.h: Figures 1 to 4, 6 and 7 of the paper, for reproduce_paper.cpp.
#pragma once

#include "amps/amps.h"
#include "render_looks.h"
#include "render_mesh.h"
#include "render_plot.h"
#include "report_page.h"
#include "reproduce_common.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>
#include <vector>

namespace reproduce {

constexpr int kPanel = 460;  // pixels

inline render::Image panel(render::Scene scene, const std::function<void(render::Options&)>& change = {}) {
  scene.options.size = kPanel;
  if (change) change(scene.options);
  return render::draw(scene.mesh, scene.options);
}

inline render::Scene plain(const Mesh& mesh) { return {mesh, {}}; }

/// Triangles whose dual point, the one of equal power to the corners in their plane, is in no disk: those that gaps have made.
inline render::Scene gap_triangles(const Mesh& dual, const std::vector<double>& radii) {
  std::vector<char> bad;
  for (std::ptrdiff_t f = 0; f < dual.triangles.rows(); ++f) {
    const Vec3 a = dual.vertices.row(dual.triangles(f, 0)).transpose();
    const Vec3 u = Vec3(dual.vertices.row(dual.triangles(f, 1)).transpose()) - a;
    const Vec3 v = Vec3(dual.vertices.row(dual.triangles(f, 2)).transpose()) - a;
    std::array<double, 3> w{};
    for (std::size_t k = 0; k < 3; ++k) {
      const double r = radii[static_cast<std::size_t>(dual.triangles(f, static_cast<int>(k)))];
      w[k] = r * r;
    }
    // x = a + s·u + t·v with 2x·u = u² + w0 − w1, 2x·v = v² + w0 − w2.
    Eigen::Matrix2d m;
    m << u.dot(u), u.dot(v), u.dot(v), v.dot(v);
    const Eigen::Vector2d st =
        m.inverse() * (0.5 * Eigen::Vector2d(u.squaredNorm() + w[0] - w[1], v.squaredNorm() + w[0] - w[2]));
    bad.push_back((st[0] * u + st[1] * v).squaredNorm() > w[0] ? 1 : 0);
  }
  render::Scene scene = plain(dual);
  const render::Color red = render::linear(render::look::kRed), grey = render::linear(render::look::kPlain);
  scene.options.paint = [=](Index f, const Eigen::Vector3d&) { return bad[static_cast<std::size_t>(f)] != 0 ? red : grey; };
  return scene;
}

inline std::vector<double> at_vertices(const Mesh& mesh, const amps::SizingField& field) {
  std::vector<double> radii(static_cast<std::size_t>(mesh.vertices.rows()), field.max_radius());
  for (std::ptrdiff_t f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) {
      radii[static_cast<std::size_t>(mesh.triangles(f, k))] = field.radius(static_cast<Index>(f), Vec3::Unit(k));
    }
  }
  return radii;
}

constexpr double kFewSamples = 3000;  // enough for the shape, few enough to see each

inline void figure_1(Run& run, Page& page) {
  const Mesh bunny = run.bunny();
  const amps::SizingField field = feature_sizing(bunny, kFewSamples);
  amps::SamplingOptions options;
  options.sizing = field;
  const SampleSet darts = amps::throw_darts(bunny, options).samples, maximal = amps::sample(bunny, options).samples;
  const SampleSet best = optimized(bunny, maximal, 32, 114, 1, field);
  const auto without_edges = [](render::Options& o) { o.edges = false; };

  page.heading("Figure 1: the bunny by local feature size");
  render::Scene gaps = render::cell_look(bunny, darts, render::CellLook::kGaps);
  render::add_dots(darts, render::look::kDot, gaps.options);
  render::Scene disks = render::cell_look(bunny, best, render::CellLook::kGaps);
  render::add_dots(best, render::look::kDot, disks.options);
  const auto small_dots = [](render::Options& o) { o.dot_radius = 1.4; };
  page.picture("figure_1.png",
               render::sheet({{panel(render::map_look(bunny, at_vertices(bunny, field)), without_edges), "(a) radii wanted"},
                              {panel(gaps, small_dots), "(b) darts alone: gaps in red"},
                              {panel(gap_triangles(amps::restricted_triangulation(bunny, darts), darts.radii)),
                               "(c) triangles that gaps have made"},
                              {panel(disks, small_dots), "(d) maximal and optimised"},
                              {panel(plain(amps::restricted_triangulation(bunny, best))), "(e) the mesh of (d)"}},
                             3),
               format("Radii by local feature size, cool where small, warm where large; %d darts leave gaps; the maximal and "
                      "optimised set has %d samples.",
                      darts.size(), best.size()));
}

inline void figure_2(Run& run, Page& page) {
  page.heading("Figure 2: gaps, and what fills them");
  const Mesh bunny = run.bunny();
  const double radius = std::sqrt(amps::kSamplesPerDensity * amps::total_area(bunny) / 1200);
  const SampleSet few = amps::throw_darts(bunny, with_radius(radius, 1)).samples;
  const amps::SamplingResult filled = amps::fill_gaps(bunny, few, with_radius(radius, 1));
  const auto near = [](render::Options& o) {
    render::look_from("right", o);
    o.zoom = 2.6;
    o.dot_radius = 3.5;
    o.curve_width = 0.7;
  };
  render::Scene circles = render::cell_look(bunny, few, render::CellLook::kDisks);
  render::Scene cells = render::cell_look(bunny, few, render::CellLook::kCells);
  render::Scene primitives = render::cell_look(bunny, few, render::CellLook::kGaps);
  const amps::GapSet gap_set = amps::find_gaps(bunny, few);
  std::vector<std::array<Index, 2>> lines;
  for (std::ptrdiff_t f = 0; f < gap_set.primitives.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k)
      lines.push_back({gap_set.primitives.triangles(f, k), gap_set.primitives.triangles(f, (k + 1) % 3)});
  }
  render::set_curves(gap_set.primitives, lines, primitives);
  render::Scene full = render::cell_look(bunny, filled.samples, render::CellLook::kDisks);
  for (render::Scene* scene : {&circles, &cells, &primitives}) render::add_dots(few, render::look::kDot, scene->options);
  for (Index s = 0; s < filled.samples.size(); ++s) {
    full.options.dots.push_back({Eigen::Vector3d(filled.samples.positions.row(s)),
                                 render::linear(s < few.size() ? render::look::kDot : render::look::kRed)});
  }
  page.picture(
      "figure_2.png",
      render::sheet({{panel(circles, near), "(a) disks and gaps"},
                     {panel(cells, near), "(b) restricted power cells"},
                     {panel(primitives, near), "(c) gap primitives"},
                     {panel(full, near), "(d) filled: new samples in red"}},
                    2),
      format("%d darts of one radius leave %d fragments of cells uncovered, %.2f %% of the surface; %d samples more make "
             "the set maximal.",
             few.size(), gap_set.gaps, 100 * gap_set.area / amps::total_area(bunny), filled.report.gap_samples));
}

inline void figure_3(Run& run, Page& page) {
  page.heading("Figure 3: from a set to a mesh");
  const Mesh triceratops = run.triceratops();
  amps::SamplingOptions of_triceratops;
  of_triceratops.sizing = feature_sizing(triceratops, kFewSamples);
  const SampleSet set = amps::sample(triceratops, of_triceratops).samples;
  const auto drawn = [](const render::Scene& scene) {
    const render::Image image = panel(scene, [](render::Options& o) {
      o.azimuth = 40;
      o.size = 640;
    });
    return render::rows_of(image, 110, 560);  // it is longer than high
  };
  page.picture("figure_3.png",
               render::sheet({{drawn(render::cell_look(triceratops, set, render::CellLook::kRadius)), "(a) cells by radius"},
                              {drawn(render::cell_look(triceratops, set, render::CellLook::kCells)), "(b) cells"},
                              {drawn(plain(amps::restricted_triangulation(triceratops, set))), "(c) the dual mesh"}},
                             3),
               format("A maximal set of %d samples on the triceratops, radii by local feature size.", set.size()));
}

inline void figure_4(Run& run, Page& page) {
  page.heading("Figure 4: optimisation of valences and angles");
  const Mesh bunny = run.bunny();
  const double radius = std::sqrt(amps::kSamplesPerDensity * amps::total_area(bunny) / kFewSamples);
  const SampleSet even = amps::sample(bunny, with_radius(radius, 1)).samples;
  const SampleSet better = optimized(bunny, even, 35, 105, 1);
  const Mesh before = amps::restricted_triangulation(bunny, even), after = amps::restricted_triangulation(bunny, better);
  const amps::QualityReport was = amps::quality(before), is = amps::quality(after);
  page.picture(
      "figure_4.png",
      render::sheet({{panel(render::valence_look(before)), "(a) valences, sampled"},
                     {panel(render::valence_look(after)), "(b) valences, optimised"},
                     {panel(render::angle_look(before)), "(c) angles, sampled"},
                     {panel(render::angle_look(after)), "(d) angles, optimised"}},
                    2),
      format(
          "Valence 5 blue, 6 green, 7 orange, others dark; triangles with an angle below 35\xC2\xB0 or above 105\xC2\xB0 red. "
          "%d samples become %d, angles [%.1f\xC2\xB0, %.1f\xC2\xB0] become [%.1f\xC2\xB0, %.1f\xC2\xB0], v567 %.1f %% becomes "
          "%.1f %%.",
          even.size(), better.size(), was.min_angle, was.max_angle, is.min_angle, is.max_angle, was.valence_5_6_7,
          is.valence_5_6_7));
}

inline void figure_6(Run& run, Page& page) {
  const Mesh bunny = run.bunny();
  const double area = amps::total_area(bunny);
  page.heading("Figure 6: time and convergence");
  render::Plot time{"Time by number of samples", "samples, thousands", "seconds", {}};
  time.log_y = true;
  render::Series sampling{"sampling", {}, {}, true}, usual{"optimising to [35\xC2\xB0, 105\xC2\xB0]", {}, {}, true};
  render::Series acute{"optimising to [42\xC2\xB0, 90\xC2\xB0]", {}, {}, true};
  for (const double n : {2000.0, 6000.0, 12000.0, 25000.0, 50000.0, 100000.0}) {
    SampleSet set;
    const double radius = std::sqrt(amps::kSamplesPerDensity * area / n);
    const double took = seconds_of([&] { set = amps::sample(bunny, with_radius(radius, 1)).samples; });
    sampling.x.push_back(set.size() / 1000.0);
    sampling.y.push_back(took);
    for (const auto& [series, low, high] : {std::tuple{&usual, 35.0, 105.0}, std::tuple{&acute, 42.0, 90.0}}) {
      series->x.push_back(set.size() / 1000.0);
      const double lowest = low, highest = high;
      series->y.push_back(seconds_of([&] { optimized(bunny, set, lowest, highest, 1); }));
    }
  }
  time.series = {sampling, usual, acute};
  page.picture("figure_6_time.png", render::draw(time), "The bunny, one radius; all threads of this machine.");

  render::Plot convergence{
      "What is left bad, by visit to all that is", "visits", "bad triangles and vertices, % of samples", {}};
  convergence.log_y = true;
  const SampleSet set = amps::sample(bunny, with_radius(std::sqrt(amps::kSamplesPerDensity * area / 12000), 1)).samples;
  for (const auto& bounds : {std::pair{35.0, 105.0}, std::pair{38.0, 100.0}, std::pair{42.0, 90.0}}) {
    amps::OptimizeOptions options;
    options.min_angle = bounds.first;
    options.max_angle = bounds.second;
    const amps::OptimizeReport report = amps::optimize(bunny, set, options).report;
    render::Series series{format("[%g\xC2\xB0, %g\xC2\xB0]", bounds.first, bounds.second), {}, {}, true};
    for (std::size_t i = 0; i < report.iterations.size(); ++i) {
      const amps::OptimizeIteration& at = report.iterations[i];
      series.x.push_back(static_cast<double>(i));
      series.y.push_back(100.0 * (at.bad_triangles + at.bad_vertices) / at.samples);
    }
    convergence.series.push_back(series);
  }
  page.picture("figure_6_convergence.png", render::draw(convergence),
               "12,000 samples on the bunny. A curve ends where nothing is left (which a logarithm does not show).");
}

/// The textbook sampler: a pool of random points of the surface, made first; one after the other becomes a sample, and prunes
/// the points in its disk. That is: in random order, a point stays if none that stayed is nearer than r. Takes points until so
/// many samples are there; returns how many that took.
inline std::size_t pool_and_prune(const Mesh& mesh, double radius, Index wanted, std::uint64_t seed, SampleSet& set) {
  constexpr std::size_t kMostPoints = 5000000;
  std::vector<double> sums;
  double sum = 0;
  for (const double area : amps::facet_areas(mesh)) sums.push_back(sum += area);
  amps::Rng rng(seed);
  std::unordered_map<std::uint64_t, std::vector<Vec3>> grid;  // cubes of side r
  const auto key = [](std::int64_t i, std::int64_t j, std::int64_t k) {
    constexpr std::int64_t kOffset = 1 << 20;
    return static_cast<std::uint64_t>(((i + kOffset) << 42) | ((j + kOffset) << 21) | (k + kOffset));
  };
  std::vector<Vec3> kept;
  std::size_t points = 0;
  while (points < kMostPoints && static_cast<Index>(kept.size()) < wanted) {
    ++points;
    const auto f = std::min<std::ptrdiff_t>(std::upper_bound(sums.begin(), sums.end(), rng.uniform() * sum) - sums.begin(),
                                            mesh.triangles.rows() - 1);
    double u = rng.uniform(), v = rng.uniform();
    if (u + v > 1) {
      u = 1 - u;
      v = 1 - v;
    }
    const Vec3 x = ((1 - u - v) * mesh.vertices.row(mesh.triangles(f, 0)) + u * mesh.vertices.row(mesh.triangles(f, 1)) +
                    v * mesh.vertices.row(mesh.triangles(f, 2)))
                       .transpose();
    std::array<std::int64_t, 3> at{};
    for (std::size_t k = 0; k < 3; ++k)
      at[k] = static_cast<std::int64_t>(std::floor(x[static_cast<std::ptrdiff_t>(k)] / radius));
    bool pruned = false;
    for (std::int64_t i = -1; i <= 1 && !pruned; ++i) {
      for (std::int64_t j = -1; j <= 1 && !pruned; ++j) {
        for (std::int64_t k = -1; k <= 1 && !pruned; ++k) {
          const auto cell = grid.find(key(at[0] + i, at[1] + j, at[2] + k));
          if (cell == grid.end()) continue;
          for (const Vec3& other : cell->second) pruned = pruned || (other - x).norm() < radius;
        }
      }
    }
    if (pruned) continue;
    kept.push_back(x);
    grid[key(at[0], at[1], at[2])].push_back(x);
  }
  set = {};
  set.positions.resize(static_cast<std::ptrdiff_t>(kept.size()));
  for (std::size_t i = 0; i < kept.size(); ++i) set.positions.row(static_cast<std::ptrdiff_t>(i)) = kept[i].transpose();
  set.radii.assign(kept.size(), radius);
  return points;
}

inline void figure_7(Run& run, Page& page) {
  constexpr Index kTheirs = 3909, kFilled = 4560;
  const Mesh bunny = run.bunny();
  const double radius = std::sqrt(amps::kSamplesPerDensity * amps::total_area(bunny) / kFilled);
  Values pool, added, filled_size, coverage_before, gap_area;
  bool unchanged = true, certified = true;
  render::Image before_image, after_image;
  for (std::uint64_t seed = 1; seed <= run.seeds; ++seed) {
    SampleSet set;
    pool.add(static_cast<double>(pool_and_prune(bunny, radius, kTheirs, seed, set)) / 1000);
    const amps::MaximalityReport was = amps::verify_maximal(bunny, set);
    const SampleSet filled = amps::fill_gaps(bunny, set, with_radius(radius, seed)).samples;
    const amps::MaximalityReport is = amps::verify_maximal(bunny, filled);
    coverage_before.add(was.worst_coverage);
    gap_area.add(100 * was.gap_area / amps::total_area(bunny));
    added.add(filled.size() - set.size());
    filled_size.add(filled.size());
    certified = certified && is.maximal() && is.poisson_disk();
    for (std::ptrdiff_t s = 0; s < set.positions.rows(); ++s) {
      unchanged =
          unchanged && filled.positions.row(s) == set.positions.row(s) && filled.radii[static_cast<std::size_t>(s)] == radius;
    }
    if (seed > 1) continue;
    render::Scene theirs = render::cell_look(bunny, set, render::CellLook::kGaps);
    render::add_dots(set, render::look::kDot, theirs.options);
    render::Scene ours = render::cell_look(bunny, filled, render::CellLook::kGaps);
    for (Index s = 0; s < filled.size(); ++s) {
      ours.options.dots.push_back(
          {Eigen::Vector3d(filled.positions.row(s)), render::linear(s < set.size() ? render::look::kDot : render::look::kRed)});
    }
    const auto large = [](render::Options& o) {
      o.size = 620;
      o.dot_radius = 1.8;
    };
    before_image = panel(theirs, large);
    after_image = panel(ours, large);
  }
  run.check(unchanged, "filling leaves samples unchanged bit by bit");
  run.check(certified, "filled sets are certified maximal Poisson-disk sets");
  page.heading("Figure 7: a set from elsewhere, filled");
  page.text(
      "The paper fills the set of another sampler. Here a textbook sampler, written in this example, stands in for it: a pool "
      "of "
      "random points of the surface is made first, and each sample prunes those in its disk. The pool is as large as it takes "
      "to have the "
      "competitor's number of samples.");
  page.table({"", "given", "filled", "added", "points in the pool", "worst coverage, given", "gaps, % of the surface"},
             {{"amps", format("%d", kTheirs), filled_size.text("%.0f"), added.text("%.0f"), pool.text("%.1fk"),
               coverage_before.text("%.2f r"), gap_area.text("%.2f %%")},
              {"paper", "3909", "4560", "651", kNotKnown, kNotKnown, kNotKnown}},
             "paper");
  page.text(std::string("Old samples are unchanged bit by bit: ") + (unchanged ? "yes" : "NO") +
            ". Filled sets are certified maximal Poisson-disk sets: " + (certified ? "yes" : "NO") + ".");
  page.picture("figure_7.png",
               render::sheet({{before_image, "(a) given: gaps in red"}, {after_image, "(b) filled: new samples in red"}}, 2),
               "Pool and pruning, before and after filling.");
}

}  // namespace reproduce
