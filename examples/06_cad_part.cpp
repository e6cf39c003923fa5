// 06_cad_part.cpp: a machined part for finite elements: edges and corners kept, each triangle tagged with the face it is of for
// loads and supports, and the proofs looked at before the mesh is used.
//
//   06_cad_part [OUT.obj [MESH]]
#include "amps/amps.h"

#include <algorithm>
#include <cmath>
#include <iostream>

// A flange with a boss and a bore: squares and circles of points, each joined to the next, the last to the first.
amps::Mesh make_flange() {
  const double radius[] = {1, 1, 0.7, 0.7, 0.45, 0.45}, z[] = {0, 0.3, 0.3, 0.8, 0.8, 0};
  constexpr amps::Index kSquares = 2, kRings = 6, kAround = 64;  // a multiple of 8: then squares have their corners
  std::vector<double> xyz;
  std::vector<amps::Index> corners;
  for (amps::Index i = 0; i < kRings; ++i) {
    for (amps::Index k = 0; k < kAround; ++k) {
      const double angle = 2 * 3.14159265358979323846 * k / kAround, x = std::cos(angle), y = std::sin(angle);
      const double scale = radius[i] / (i < kSquares ? std::max(std::fabs(x), std::fabs(y)) : 1);
      xyz.insert(xyz.end(), {scale * x, scale * y, z[i]});
      const amps::Index here = i * kAround, up = (i + 1) % kRings * kAround, next = (k + 1) % kAround;
      corners.insert(corners.end(), {here + k, here + next, up + next, here + k, up + next, up + k});
    }
  }
  return {amps::Points(xyz), amps::Triangles(corners)};
}

int main(int argc, char** argv) try {
  amps::RemeshOptions options;
  options.sampling.target_count = 4000;  // by default creases of more than 40 degrees and borders are kept
  const amps::RemeshResult result = amps::remesh(argc > 2 ? amps::read_mesh(argv[2]) : make_flange(), options);
  const amps::CurveReport& curves = result.report.curves;
  std::cout << result.samples.size() << " vertices, " << name_of(result.status) << "; " << result.report.certificate << "\n"
            << curves.edges_kept << " of " << curves.edges << " edges along " << curves.curves << " curves, off by "
            << curves.deviation << "; angles beside them " << curves.beside.min_angle << " to " << curves.beside.max_angle
            << ", elsewhere " << curves.away.min_angle << " to " << curves.away.max_angle << "\ntriangles of the faces:";

  // The faces are the patches between curves. In the solver's file each is a group, and the curves are lines.
  amps::MeshWriteOptions writing;
  writing.labels = result.patches;
  writing.label_name = "face";
  writing.edges = result.curve_edges;
  if (argc > 1) amps::write_mesh(argv[1], result.mesh, writing);
  for (amps::Index face = 0; face < curves.patches; ++face) {
    std::cout << " " << std::count(result.patches.begin(), result.patches.end(), face);
  }
  const std::string lost = amps::lost_shape(result.report);
  std::cout << "\n" << (lost.empty() ? "nothing of the shape is lost" : lost) << "\n";
  return lost.empty() && (argc > 2 || result.status == amps::Outcome::kDone) ? 0 : 1;
} catch (const amps::Error& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
