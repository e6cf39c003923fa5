// What a strict program does with amps: the headers' templates are instantiated under all warnings of its own.
#include <amps/amps.h>

#include <array>
#include <cstdint>
#include <sstream>
#include <vector>

int main() {
  Eigen::MatrixXd v(3, 3);
  v << 0, 0, 0, 1, 0, 0, 0, 1, 0;
  Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor> vf = v.cast<float>();
  Eigen::MatrixXi f(1, 3);
  f << 0, 1, 2;
  const std::vector<std::array<float, 3>> floats(3);
  const std::vector<Eigen::Vector3d> doubles(3, Eigen::Vector3d::Zero());
  const std::vector<std::array<std::uint16_t, 3>> shorts(1, {{0, 1, 2}});
  const std::array<std::int64_t, 3> longs{{0, 1, 2}};
  const std::vector<double> weights(3, 0.0);
  const Eigen::VectorXf weights_of_floats = Eigen::VectorXf::Zero(3);

  const amps::MeshView views[] = {{v, f}, {vf, f}, {floats, shorts}, {doubles, amps::TrianglesView(longs.data(), 1)}};
  amps::Mesh mesh = views[0].copy();
  mesh.vertices.map() *= 2.0;
  mesh.vertices.resize(2);
  mesh.vertices = amps::Points(v);
  const bool same = amps::PointsView(v) == amps::PointsView(vf) && amps::TrianglesView(f) == amps::TrianglesView(shorts);
  const amps::ValuesView values[] = {weights, weights_of_floats};

  amps::StageTally tally;
  const amps::WeightedPoint a{0, 0, 0, 0}, b{1, 0, 0, 0}, c{0, 1, 0, 0}, d{0, 0, 1, 0};
  int sum = amps::orient3d(a, b, c, d) + amps::orient3d(a, b, c, d, {}, tally);
  sum += amps::power_test(a, b, c, d, d) + amps::power_test<false>(a, b, c, d, d, {}, tally);
  sum += static_cast<int>(tally[amps::Stage::kFilter]);

  amps::Execution execution(2, amps::Progress([](const char*, double) { return true; }));
  amps::parallel_for(10, 1, execution, [](std::size_t, std::size_t) {});
  const amps::RegularTriangulation triangulation(doubles, values[1], execution);
  const amps::SurfaceTree tree(mesh);
  std::ostringstream text;
  text << amps::check(mesh) << amps::quality(mesh) << amps::topology(mesh);
  amps::Rng rng(1);
  const amps::Vec3 somewhere = amps::uniform_barycentric(rng);
  return same && sum > 0 && triangulation.num_vertices() == 3 && tree.nearest(somewhere).distance >= 0 &&
                 views[1].num_facets() == 1
             ? 0
             : 1;
}
