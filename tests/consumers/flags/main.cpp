// Everything that owns memory and crosses the border, both ways, in a program that uses Eigen's own allocations beside it.
#include <amps/amps.h>

#include <cstdio>
#include <string>
#include <utility>
#include <vector>

namespace {

bool expect(bool holds, const char* what) {
  if (!holds) std::fprintf(stderr, "failed: %s\n", what);
  return holds;
}

// The program's own matrices come and go between those of amps: where one allocator takes what the other gave, this crashes.
double churn(const Eigen::MatrixXd& m) {
  double sum = 0;
  for (int k = 1; k < 50; ++k) {
    Eigen::MatrixXd a = m.topRows(std::min<Eigen::Index>(k, m.rows()));
    Eigen::VectorXd b = a.rowwise().norm();
    a.conservativeResize(a.rows() + 3, a.cols());
    Eigen::Matrix4d c = Eigen::Matrix4d::Random();
    std::vector<Eigen::Matrix4d> d(static_cast<std::size_t>(k), c);
    sum += b.sum() + d.back().trace() * 0;
  }
  return sum;
}

}  // namespace

int main() {
  bool good = true;
  amps::Mesh mesh = amps::make_sphere(1280);
  amps::RemeshOptions options;
  options.sampling.radius = 0.2;
  amps::RemeshResult result = amps::remesh(mesh, options);
  good &= expect(result.report.maximality.maximal() && result.report.quality.min_angle > 29.9, "remesh of a sphere");

  // Results into the program's matrices, and back.
  Eigen::MatrixXd v = result.mesh.vertices.map();
  Eigen::MatrixXi f = result.mesh.triangles.map();
  good &= expect(churn(v) > 0, "the program's own matrices");
  amps::Mesh copy{v, f};
  result.mesh = std::move(copy);
  result.samples = amps::SampleSet();
  mesh.vertices.resize(3);
  mesh.vertices = amps::Points(v * 2.0);
  mesh.triangles = f;
  amps::SampleSet moved = amps::sample({v, f}, options.sampling).samples;
  moved.positions.resize(moved.positions.rows() / 2);
  moved.radii.resize(moved.radii.size() / 2);
  moved.facets.clear();
  moved.barycentrics = amps::Points();
  good &= expect(!amps::verify_maximal({v, f}, moved).maximal(), "half a set has gaps");
  const amps::SampleSet filled = amps::fill_gaps({v, f}, moved, options.sampling).samples;
  good &= expect(amps::verify_maximal({v, f}, filled).maximal(), "a filled set has none");

  const amps::SizingField field = amps::for_count(amps::lfs_sizing({v, f}).with_ratio(4), 500);
  options.sampling = amps::SamplingOptions();
  options.sampling.sizing = field;
  amps::RemeshResult adaptive = amps::remesh({v, f}, options);
  good &= expect(adaptive.report.maximality.maximal(), "remesh by local feature size");
  std::vector<double> radii = amps::local_feature_size({v, f}, v);
  radii.push_back(1);
  const std::vector<double> curvature = amps::max_curvature({v, f});
  good &= expect(curvature.size() + 1 == radii.size(), "fields by vertex");

  amps::RegularTriangulation triangulation(v, Eigen::VectorXd::Zero(v.rows()).eval().head(v.rows()));
  amps::Tetrahedra cells = triangulation.cells();
  cells.resize(1);
  amps::Triangles hull = triangulation.hull();
  hull = amps::Triangles();
  good &= expect(triangulation.check().empty(), "triangulation");

  const std::string text = amps::format_mesh(adaptive.mesh, amps::MeshFormat::kPly);
  amps::Mesh read = amps::parse_mesh(text, amps::MeshFormat::kPly);
  read.vertices.map() *= 2;
  good &= expect(read.triangles == adaptive.mesh.triangles, "written and read");
  const amps::SurfaceTree tree(read);
  good &= expect(tree.nearest_all(v).size() == static_cast<std::size_t>(v.rows()), "nearest points");
  try {
    amps::read_mesh("there is no such file.obj");
    good = expect(false, "an error");
  } catch (const amps::Error& error) {
    good &= expect(error.code() == amps::ErrorCode::kFileNotFound, "an error's code");
  }
  return good ? 0 : 1;
}
