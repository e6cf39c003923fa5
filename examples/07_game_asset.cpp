// 07_game_asset.cpp: a barrel of a game, without lids: its ends stay open and in place, no triangle crosses the seam of the
// texture or a border of materials, and texture coordinates come along.
//
//   07_game_asset [OUT.obj]
#include "amps/amps.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iostream>

int main(int argc, char** argv) try {
  // As engines have it: at the seam, where u is 0 and 1, two vertices at each place. A material for each triangle.
  constexpr amps::Index kAround = 40, kRows = 12, kHoop = 3, kVertices = (kAround + 1) * (kRows + 1);
  amps::Mesh barrel{amps::Points(kVertices), {}};
  amps::Points uvs(kVertices);  // u, v, 0
  std::vector<amps::Index> corners, materials;
  amps::RemeshOptions options;
  for (amps::Index i = 0; i < kVertices; ++i) {
    const amps::Index row = i / (kAround + 1), k = i % (kAround + 1), up = i + kAround + 1;
    const double v = 1.0 * row / kRows, angle = 2 * 3.14159265358979323846 * (k % kAround) / kAround, r = 1 + v * (1 - v);
    barrel.vertices.row(i) << r * std::cos(angle), r * std::sin(angle), 3 * v;
    uvs.row(i) << 1.0 * k / kAround, v, 0;
    if (row < kRows && k == 0) options.curves.edges.push_back({i, up});
    if (row == kRows || k == kAround) continue;
    corners.insert(corners.end(), {i, i + 1, up + 1, i, up + 1, up});
    materials.insert(materials.end(), 2, row < kHoop || row >= kRows - kHoop ? 1 : 0);
  }
  barrel.triangles = amps::Triangles(corners);
  options.curves.labels = materials;  // borders between them are kept; open ends are by default
  options.sampling.target_count = 1500;
  const amps::RemeshResult result = amps::remesh(barrel, options);

  // What vertices have is interpolated. A vertex on the seam lies on one side of it: from the other it is a whole turn off.
  std::ofstream out(argc > 1 ? argv[1] : "");  // without a name nothing is written
  for (std::ptrdiff_t v = 0; v < result.mesh.vertices.rows(); ++v) out << "v " << result.mesh.vertices.row(v) << "\n";
  double texture = 0, hoops = 0, least = 1, across = 0;
  for (std::size_t t = 0; t < result.patches.size(); ++t) {
    const auto row = result.mesh.triangles.row(static_cast<std::ptrdiff_t>(t));
    Eigen::Matrix3d uv = Eigen::Matrix3d::Zero();
    for (int c = 0; c < 3; ++c) {
      const amps::Index facet = result.samples.facets[static_cast<std::size_t>(row[c])];
      for (int k = 0; k < 3; ++k) uv.row(c) += result.samples.barycentrics(row[c], k) * uvs.row(barrel.triangles(facet, k));
      uv(c, 0) -= std::round(uv(c, 0) - uvs(barrel.triangles(result.facets[t], 0), 0));
      across = std::max(across, std::fabs(uv(c, 0) - 0.5) - 0.5);
      out << "vt " << uv.row(c) << "\n";
    }
    const double area = (uv.row(1) - uv.row(0)).cross(uv.row(2) - uv.row(0))[2] / 2;
    texture += area, least = std::min(least, area), hoops += area * materials[static_cast<std::size_t>(result.facets[t])];
    out << "usemtl slot_" << result.patches[t] << "\nf " << row[0] + 1 << "/-3 " << row[1] + 1 << "/-2 " << row[2] + 1
        << "/-1\n";
  }
  std::cout << result.samples.size() << " vertices, " << name_of(result.status) << "; " << result.report.curves.edges_kept
            << " edges of ends, seam and hoops; " << 100 * texture << " % of the texture, " << 100 * hoops << " % in hoops\n";
  const bool right = std::fabs(texture - 1) < 1e-12 && std::fabs(hoops - 0.5) < 1e-12 && across < 1e-12 && least > 0;
  return right && result.status == amps::Outcome::kDone ? 0 : 1;
} catch (const amps::Error& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
