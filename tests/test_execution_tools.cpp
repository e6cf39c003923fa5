// Long calls beside the pipeline (fields, trees, distances) under an Execution: one fraction that rises to 1, cancelled when
// told to, and the same bits on any threads and on a host's own.
#include "kit/basics.h"
#include "kit/errors.h"
#include "kit/folder.h"
#include "kit/meshes.h"
#include "kit/samples.h"

#include "amps/execution.h"
#include "amps/fit.h"
#include "amps/kdtree.h"
#include "amps/mesh_io.h"
#include "amps/quality.h"
#include "amps/sampling.h"
#include "amps/self_intersections.h"
#include "amps/shapes.h"
#include "amps/sizing.h"
#include "amps/surface_distance.h"
#include "amps/surface_tree.h"

#include <doctest/doctest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <set>
#include <string>
#include <vector>

namespace amps_test {
namespace {

using amps::Execution;
using amps::Progress;

struct Call {
  std::string name;
  std::function<std::vector<double>(const Execution&)> run;  ///< numbers of the result
};

std::vector<double> field_numbers(const SizingField& field) {
  std::vector<double> result;
  for (std::size_t i = 0; i < field.num_pieces(); ++i) {
    for (const double r : field.piece(i).radii) result.push_back(r);
  }
  return result;
}

std::vector<double> numbers_of(const amps::Points& points) { return {points.data(), points.data() + points.size()}; }

std::vector<Call> calls() {
  static const Mesh mesh = amps::make_torus(1, 0.4, 160, 64);
  static const Mesh coarse = amps::make_torus(1, 0.4, 24, 12);
  static const SizingField uneven = wild_field(mesh, 16, 20000, 3);
  static const std::vector<double> numbers(static_cast<std::size_t>(mesh.vertices.rows()), 2.0);
  return {
      {"k-d tree",
       [](const Execution& e) {
         const amps::KdTree tree(mesh.vertices, e);
         return std::vector<double>{tree.nearest(Vec3(0.1, 0.2, 0.3)).squared_distance};
       }},
      {"surface tree",
       [](const Execution& e) {
         const amps::SurfaceTree tree(mesh, e);
         return std::vector<double>{tree.nearest(Vec3(0.1, 0.2, 0.3)).distance};
       }},
      {"nearest points",
       [](const Execution& e) {
         static const amps::SurfaceTree tree(coarse);
         std::vector<double> result;
         for (const auto& hit : tree.nearest_all(mesh.vertices, e)) result.push_back(hit.distance);
         return result;
       }},
      {"distance",
       [](const Execution& e) {
         amps::DistanceOptions options;
         options.execution = e;
         const amps::DistanceReport report = amps::surface_distance(mesh, coarse, options);
         return std::vector<double>{report.hausdorff(), report.rms(), report.mean()};
       }},
      {"feature size", [](const Execution& e) { return amps::local_feature_size(mesh, mesh.vertices, {}, e); }},
      {"field by feature size", [](const Execution& e) { return field_numbers(amps::lfs_sizing(coarse, {}, e)); }},
      {"curvature", [](const Execution& e) { return amps::max_curvature(mesh, 50, e); }},
      {"function",
       [](const Execution& e) {
         return field_numbers(amps::function_sizing(
             coarse, [](const amps::SurfacePoint& at) { return 0.01 + 0.05 * at.position.squaredNorm(); }, {}, e));
       }},
      {"check", [](const Execution& e) { return std::vector<double>{amps::check(mesh, e).area}; }},
      {"topology", [](const Execution& e) { return std::vector<double>{double(amps::topology(mesh, e).edges)}; }},
      {"quality", [](const Execution& e) { return std::vector<double>{amps::quality(mesh, e).mean_q}; }},
      {"self-intersections",
       [](const Execution& e) {
         amps::SelfIntersectionOptions options;
         options.execution = e;
         static const Mesh crossing = joined(mesh, moved(mesh, {0.5, 0.1, 0.2}));
         std::vector<double> result;
         for (const auto& pair : amps::find_self_intersections(crossing, options).pairs) {
           result.push_back(pair.a);
           result.push_back(pair.b);
         }
         return result;
       }},
      {"merging",
       [](const Execution& e) { return std::vector<double>{double(amps::merge_equal_vertices(mesh, e).vertices.rows())}; }},
      {"scaling", [](const Execution& e) { return field_numbers(uneven.scaled(3, e)); }},
      {"clamping", [](const Execution& e) { return field_numbers(uneven.clamped(0.02, 0.05, e)); }},
      {"ratio", [](const Execution& e) { return field_numbers(uneven.with_ratio(4, 0.3, e)); }},
      {"minimum", [](const Execution& e) { return field_numbers(amps::min(uneven, uneven.scaled(0.5), e)); }},
      {"fitting", [](const Execution& e) { return std::vector<double>{double(uneven.fits(mesh, e))}; }},
      {"density", [](const Execution& e) { return std::vector<double>{uneven.density_integral(e)}; }},
      {"uniform field", [](const Execution& e) { return field_numbers(amps::uniform_sizing(mesh, 0.1, e)); }},
      {"field by vertices", [](const Execution& e) { return field_numbers(amps::vertex_sizing(mesh, numbers, e)); }},
      {"field by densities", [](const Execution& e) { return field_numbers(amps::vertex_density_sizing(mesh, numbers, e)); }},
      {"field by curvature",
       [](const Execution& e) {
         amps::CurvatureOptions options;
         options.max_error = 0.01;
         return field_numbers(amps::curvature_sizing(mesh, options, e));
       }},
      {"distance, one way",
       [](const Execution& e) {
         amps::DistanceOptions options;
         options.execution = e;
         return std::vector<double>{amps::one_sided_distance(coarse, mesh, options).mean};
       }},
      {"fit",
       [](const Execution& e) {
         amps::FitOptions options;
         options.execution = e;
         return numbers_of(amps::fit_vertices(mesh, coarse, options));
       }},
      {"free fit",
       [](const Execution& e) {
         amps::FitOptions options;
         options.fit = amps::Fit::kFree;
         options.execution = e;
         return numbers_of(amps::fit_vertices(mesh, coarse, options));
       }},
      {"gradation", [](const Execution& e) { return field_numbers(uneven.limited(0.1, e)); }},
      {"count", [](const Execution& e) { return field_numbers(amps::for_count(uneven, 5000, 0.1, e)); }},
  };
}

std::vector<Call> file_calls();

std::vector<Call> all_calls() {
  std::vector<Call> result = calls();
  for (Call& call : file_calls()) result.push_back(std::move(call));
  return result;
}

/// Reading and writing of meshes, in memory, in one format.
std::vector<Call> file_calls() {
  static const Mesh mesh = amps::make_torus(1, 0.4, 160, 64);
  std::vector<Call> result;
  for (const amps::MeshFormat format :
       {amps::MeshFormat::kObj, amps::MeshFormat::kOff, amps::MeshFormat::kPly, amps::MeshFormat::kStl}) {
    const std::string name = std::to_string(static_cast<int>(format));
    result.push_back({"format " + name, [format](const Execution& e) {
                        return std::vector<double>{double(amps::format_mesh(mesh, format, {}, e).size())};
                      }});
    const std::string data = amps::format_mesh(mesh, format);
    result.push_back({"parse " + name, [format, data](const Execution& e) {
                        const Mesh read = amps::parse_mesh(data, format, "memory", e);
                        return std::vector<double>{double(read.vertices.rows()), read.vertices(7, 1)};
                      }});
  }
  SamplingOptions options;
  options.radius = 0.02;
  static const SampleSet samples = amps::sample(mesh, options).samples;
  for (const amps::SampleFormat format : {amps::SampleFormat::kXyzr, amps::SampleFormat::kPly, amps::SampleFormat::kCsv}) {
    const std::string data = amps::format_samples(samples, format);
    result.push_back({"samples", [format, data](const Execution& e) {
                        const Execution job = e.start("files");
                        const std::string text = amps::format_samples(samples, format, job.part(0, 0.5));
                        const SampleSet read = amps::parse_samples(data, format, "memory", job.part(0.5, 1));
                        job.finish();
                        return std::vector<double>{double(text.size()), double(read.size())};
                      }});
  }
  return result;
}

/// Sees every report.
Progress watching(const Progress::Callback& callback) { return Progress(callback, 0); }

/// Runs everything in reverse order on the calling thread.
struct ReversedExecutor : amps::Executor {
  unsigned concurrency() const override { return 3; }
  void run(unsigned count, const std::function<void(unsigned)>& work) override {
    for (unsigned k = count; k-- > 0;) work(k);
  }
};

}  // namespace

TEST_CASE("execution of tools: the fraction rises from 0 to 1, in small steps, and stages have names") {
  for (const Call& call : all_calls()) {
    CAPTURE(call.name);
    std::vector<double> fractions;
    std::set<std::string> stages;
    const Execution execution(2, watching([&](const char* stage, double fraction) {
                                fractions.push_back(fraction);
                                stages.insert(stage);
                                return true;
                              }));
    call.run(execution);
    REQUIRE(fractions.size() > 2);
    double last = 0;
    for (const double f : fractions) {
      CHECK(f >= last);
      last = f;
    }
    CHECK(last == 1);
    CHECK(stages.size() == 1);
    CHECK(!stages.begin()->empty());
  }
}

TEST_CASE("execution of tools: a call that is cancelled ends with kCancelled, soon") {
  for (const Call& call : all_calls()) {
    for (const double when : {0.0, 0.2, 0.5, 0.8}) {
      CAPTURE(call.name);
      CAPTURE(when);
      int calls_after = 0;
      bool cancelled = false;
      const Execution execution(1, watching([&](const char*, double fraction) {
                                  calls_after += cancelled;
                                  cancelled = cancelled || (fraction >= when && fraction < 1);
                                  return !cancelled;
                                }));
      try {
        call.run(execution);
        CHECK(!cancelled);  // it had no report between
      } catch (const Error& error) {
        CHECK(error.code() == ErrorCode::kCancelled);
        CHECK(cancelled);
      }
      CHECK(calls_after == 0);
      CHECK((when > 0.5 || cancelled));
    }
  }
}

TEST_CASE("execution of tools: the same bits on any number of threads and on a host's executor") {
  ReversedExecutor reversed;
  for (const Call& call : all_calls()) {
    CAPTURE(call.name);
    const std::vector<double> expected = call.run(Execution());
    CHECK(call.run(Execution(3)) == expected);
    CHECK(call.run(Execution(1, Progress(), &reversed)) == expected);
  }
}

TEST_CASE("execution of tools: work within one facet is looked at, too") {
  static const Mesh square = amps::make_square();
  static const Mesh above = [] {
    Mesh result = amps::make_square();
    for (std::ptrdiff_t v = 0; v < result.vertices.rows(); ++v) result.vertices(v, 2) = 0.1;
    return result;
  }();
  const std::vector<Call> large_facets = {
      {"function",
       [](const Execution& e) {
         return field_numbers(amps::function_sizing(
             square, [](const amps::SurfacePoint& at) { return 0.005 + 0.02 * at.position.squaredNorm(); }, {}, e));
       }},
      {"distance", [](const Execution& e) {
         amps::DistanceOptions options;
         options.spacing = 0.003;
         options.execution = e;
         return std::vector<double>{amps::surface_distance(square, above, options).mean()};
       }}};
  for (const Call& call : large_facets) {
    CAPTURE(call.name);
    int reports = 0;
    call.run(Execution(1, watching([&](const char*, double) { return ++reports > 0; })));
    CHECK(reports > 100);
    int left = reports / 2;
    CHECK(error_of([&] { call.run(Execution(1, watching([&](const char*, double) { return --left > 0; }))); }) ==
          ErrorCode::kCancelled);
    CHECK(left == 0);
  }
}

TEST_CASE("execution of tools: a write that is cancelled leaves the old file, and nothing beside it") {
  const Folder own;
  const fs::path& folder = own.path;
  const Mesh mesh = amps::make_torus(1, 0.4, 160, 64);
  for (const char* name : {"mesh.obj", "mesh.ply", "mesh.stl"}) {
    const fs::path path = folder / name;
    amps::write_mesh(path, amps::make_square());
    const auto bytes = [&] {
      std::ifstream in(path, std::ios::binary);
      return std::string(std::istreambuf_iterator<char>(in), {});
    };
    const std::string before = bytes();
    for (const double when : {0.0, 0.5, 0.9}) {
      bool cancelled = false;
      const Execution execution(1, watching([&](const char*, double fraction) {
                                  cancelled = cancelled || fraction >= when;
                                  return !cancelled;
                                }));
      CHECK_THROWS_AS(amps::write_mesh(path, mesh, {}, execution), Error);
      CHECK(bytes() == before);
    }
    amps::write_mesh(path, mesh);
    CHECK(bytes() != before);
  }
  CHECK(std::distance(fs::directory_iterator(folder), fs::directory_iterator()) == 3);
}

}  // namespace amps_test
