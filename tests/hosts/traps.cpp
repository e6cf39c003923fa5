// A host that traps invalid operations, divisions by zero and overflows, to find its own mistakes: amps raises none with valid
// input. Does everything on meshes with sharp, flat, thin, open, repeated and degenerate parts. An exception ends it by SIGFPE;
// the last line printed is what was being done.
#include "amps/amps.h"

#include <cfenv>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "kit/data.h"

namespace {

void step(const char* what) {
  std::printf("  %s\n", what);
  std::fflush(stdout);
}

/// Bad input is refused as without traps.
void quietly(const char* what, const std::function<void()>& call) {
  step(what);
  try {
    call();
  } catch (const amps::Error& error) {
    std::printf("    %s\n", error.what());
  }
}

void measure(const amps::Mesh& mesh, const amps::Mesh& other) {
  amps::check(mesh);
  amps::topology(mesh);
  amps::quality(mesh);
  amps::facet_normals(mesh);
  amps::total_area(mesh);
  amps::find_self_intersections(mesh);
  amps::find_curves(mesh);
  amps::CurveOptions curves;
  curves.radius = (amps::bounding_box(mesh).max - amps::bounding_box(mesh).min).norm() / 40;
  amps::find_curves(mesh, curves);
  step("distance");
  amps::surface_distance(mesh, other);
  step("nearest points");
  amps::SurfaceTree(mesh).nearest_all(other.vertices);
  step("files");
  for (const amps::MeshFormat format :
       {amps::MeshFormat::kObj, amps::MeshFormat::kOff, amps::MeshFormat::kPly, amps::MeshFormat::kStl}) {
    amps::parse_mesh(amps::format_mesh(mesh, format), format);
  }
}

amps::RemeshResult remesh(const char* what, const amps::Mesh& mesh, const amps::RemeshOptions& options) {
  amps::RemeshResult result;
  quietly(what, [&] { result = amps::remesh(mesh, options); });
  return result;
}

void run(const amps::Mesh& mesh) {
  constexpr amps::Index kCount = 400;
  amps::RemeshOptions options;
  options.sampling.target_count = kCount;
  options.sampling.execution.threads = 2;
  const amps::RemeshResult result = remesh("remesh", mesh, options);
  const amps::SampleSet& samples = result.samples;
  quietly("measures", [&] { measure(mesh, result.mesh); });
  if (samples.positions.rows() > 0) {
    quietly("sets", [&] {
      for (const amps::Neighborhood neighborhood : {amps::Neighborhood::kSpace, amps::Neighborhood::kSurface}) {
        amps::verify_maximal(mesh, samples, {}, amps::ConflictRule::kMax, neighborhood, result.graph.get());
        amps::find_gaps(mesh, samples, {}, neighborhood, result.graph.get());
      }
      amps::SampleSet half = samples;
      half.positions.resize(samples.positions.rows() / 2);
      half.radii.resize(static_cast<std::size_t>(half.positions.rows()));
      half.facets.clear();
      half.barycentrics = amps::Points();
      half.dimensions.clear();
      half.curves.clear();
      half.parameters.clear();
      amps::SamplingOptions fill;
      fill.radius = result.report.sampling.radius;
      amps::optimize(mesh, amps::fill_gaps(mesh, half, fill).samples, {});
      for (const amps::SampleFormat format : {amps::SampleFormat::kXyzr, amps::SampleFormat::kPly, amps::SampleFormat::kCsv}) {
        amps::parse_samples(amps::format_samples(samples, format), format);
      }
    });
  }

  options.optimization.min_angle = 42;
  options.optimization.max_angle = 90;
  options.optimization.max_iterations = 50;
  remesh("[42, 90]", mesh, options);
  options.optimization = amps::OptimizeOptions();
  options.fit = amps::Fit::kFree;
  remesh("free fit", mesh, options);
  options.fit = amps::Fit::kNormal;
  remesh("fit along normals", mesh, options);
  options.fit = amps::Fit::kOff;
  options.sampling.neighborhood = amps::Neighborhood::kSpace;
  remesh("balls", mesh, options);
  options.sampling.conflict_rule = amps::ConflictRule::kMin;
  remesh("min rule", mesh, options);

  amps::RemeshOptions by_error;
  by_error.max_error = (amps::bounding_box(mesh).max - amps::bounding_box(mesh).min).norm() / 200;
  by_error.sampling.target_count = kCount;
  remesh("error", mesh, by_error);

  amps::RemeshOptions varying;
  quietly("curvature", [&] {
    amps::max_curvature(mesh);
    amps::CurvatureOptions curvature;
    curvature.max_error = by_error.max_error;
    varying.sampling.sizing = amps::for_count(amps::curvature_sizing(mesh, curvature), kCount);
  });
  remesh("by curvature", mesh, varying);
  quietly("local feature size", [&] {
    amps::local_feature_size(mesh, mesh.vertices);
    varying.sampling.sizing = amps::for_count(amps::lfs_sizing(mesh).with_ratio(), kCount);
  });
  remesh("by local feature size", mesh, varying);
  quietly("function", [&] {
    const amps::SizingField field =
        amps::function_sizing(mesh, [&](const amps::SurfacePoint& at) { return 1 + at.position[0] * at.position[0]; });
    amps::min(field.limited(0.2), amps::uniform_sizing(mesh, 1.5));
    amps::vertex_density_sizing(mesh, std::vector<double>(static_cast<std::size_t>(mesh.vertices.rows()), 2.0));
  });
}

/// A sheet of n by n squares, folded sharply in the middle.
amps::Mesh folded_sheet(amps::Index n) {
  amps::Mesh mesh = amps::make_square(n);
  for (std::ptrdiff_t i = 0; i < mesh.vertices.rows(); ++i) {
    double& x = mesh.vertices.row(i)[0];
    double& z = mesh.vertices.row(i)[2];
    if (x > 0.5) {
      z = 0.02 * (x - 0.5);
      x = 1 - x;
    }
  }
  return mesh;
}

/// A mesh with facets without area of all kinds, repeated facets and an isolated vertex.
amps::Mesh with_degenerate_parts(amps::Mesh mesh) {
  const amps::Index n = static_cast<amps::Index>(mesh.vertices.rows());
  std::vector<std::array<amps::Index, 3>> triangles;
  for (std::ptrdiff_t f = 0; f < mesh.triangles.rows(); ++f) triangles.push_back(amps::TrianglesView(mesh.triangles)[f]);
  const std::array<amps::Index, 3> first = triangles.front();
  triangles.push_back({first[0], first[0], first[1]});
  triangles.push_back({first[2], first[2], first[2]});
  triangles.push_back({first[1], first[2], first[0]});
  std::vector<amps::Vec3> vertices;
  for (std::ptrdiff_t i = 0; i < n; ++i) vertices.push_back(amps::PointsView(mesh.vertices)[i]);
  vertices.push_back((vertices[static_cast<std::size_t>(first[0])] + vertices[static_cast<std::size_t>(first[1])]) / 2);
  vertices.push_back(vertices[static_cast<std::size_t>(first[0])]);
  vertices.push_back(amps::Vec3(0.25, 0.25, 0.25));
  triangles.push_back({first[0], first[1], n});
  triangles.push_back({first[0], n + 1, n});
  return amps::MeshView(vertices, triangles).copy();
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::pair<std::string, amps::Mesh>> meshes;
  if (argc > 1) {
    for (int k = 1; k < argc; ++k) {
      quietly(argv[k], [&] { meshes.emplace_back(argv[k], amps::read_mesh(argv[k])); });
    }
  } else {
    meshes.emplace_back("sphere", amps::make_sphere(1280));
    meshes.emplace_back("cube", amps::make_cube());
    meshes.emplace_back("torus", amps::make_torus(1, 0.4, 24, 12));
    for (const double scale : {1e-30, 1e30}) {
      amps::Mesh scaled = amps::make_torus(1, 0.4, 12, 6);
      scaled.vertices.map() *= scale;
      meshes.emplace_back("torus, scaled", scaled);
    }
    meshes.emplace_back("folded sheet", folded_sheet(4));
    meshes.emplace_back("degenerate parts", with_degenerate_parts(amps::make_cube(2)));
    for (const char* name : {"reports/03_thin_plate.stl", "reports/28_wedge_15.obj", "reports/04_chair_slivers.obj",
                             "reports/13_three_sheets.obj", "moebius.obj", "fan3_nonmanifold_edge.obj", "fandisk_coarse.obj"}) {
      if (const auto path = amps_test::data_file(name)) meshes.emplace_back(name, amps::read_mesh(*path));
    }
  }
#ifdef __GLIBC__
  if (feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW) == -1) return AMPS_NOTHING_RAN;  // not on this machine
#else
  return AMPS_NOTHING_RAN;
#endif
  for (const auto& [name, mesh] : meshes) {
    std::printf("%s\n", name.c_str());
    run(mesh);
  }
  return 0;
}
