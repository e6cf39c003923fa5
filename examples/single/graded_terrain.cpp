// graded_terrain.cpp: a terrain from a formula, with disks that are small near its peak, and the proof that they cover it. From
// this file and amps_single.h alone (`cmake --build BUILD --target amps_single_header` writes it into BUILD; copy it here).
//
//   c++ -std=c++17 -O2 -I/usr/include/eigen3 graded_terrain.cpp -o graded_terrain -pthread
//   ./graded_terrain terrain.obj
#define AMPS_IMPLEMENTATION
#include "amps_single.h"

#include <cmath>
#include <iostream>

int main(int argc, char** argv) try {
  amps::Mesh terrain = amps::make_square(64);  // [0, 1]², z = 0
  for (amps::Index v = 0; v < terrain.vertices.rows(); ++v) {
    const double x = terrain.vertices(v, 0) - 0.5, y = terrain.vertices(v, 1) - 0.5;
    terrain.vertices(v, 2) = 0.4 * std::exp(-20 * (x * x + y * y)) + 0.02 * std::sin(12 * x) * std::cos(9 * y);
  }

  // The wanted radius at any point of the surface.
  const amps::Vec3 peak(0.5, 0.5, 0.4);
  const amps::SizingField field =
      amps::function_sizing(terrain, [&](const amps::SurfacePoint& at) { return 0.008 + 0.05 * (at.position - peak).norm(); });

  amps::RemeshOptions options;
  options.sampling.sizing = field;
  const amps::RemeshResult result = amps::remesh(terrain, options);
  const amps::MaximalityReport proof = amps::verify_maximal(terrain, result.samples);  // from the samples alone
  std::cout << result.samples.size() << " samples\n" << proof << "\n" << result.report.quality << "\n";
  if (argc > 1) amps::write_mesh(argv[1], result.mesh);
  return proof.maximal() && proof.poisson_disk() ? 0 : 1;
} catch (const amps::Error& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
