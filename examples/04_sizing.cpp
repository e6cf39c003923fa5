// 04_sizing.cpp: radii of one's own — fine where a function says so, never coarser than the local feature size allows.
//
//   04_sizing [MESH [OUT]]
#include "amps/amps.h"

#include <algorithm>
#include <iostream>

int main(int argc, char** argv) try {
  const amps::Mesh mesh = argc > 1 ? amps::read_mesh(argv[1]) : amps::make_knot();
  const amps::Box box = amps::bounding_box(mesh);
  const double size = box.diagonal();

  // Any function of a surface point: here radii grow with the distance from one corner of the box, as for a close-up.
  const amps::SizingField near_corner = amps::function_sizing(
      mesh, [&](const amps::SurfacePoint& at) { return std::max(0.004 * size, 0.03 * (at.position - box.min).norm()); });
  amps::LfsOptions lfs;
  lfs.scale = 0.4;
  const amps::SizingField wanted = amps::min(near_corner, amps::lfs_sizing(mesh, lfs)).with_ratio(16);

  amps::RemeshOptions options;
  options.sampling.sizing = amps::for_count(wanted, 8000);  // scaled, and limited in gradation: that sets the worst angle
  options.sampling.target_count = 8000;
  const amps::RemeshResult result = amps::remesh(mesh, options);

  const amps::SamplingReport& sampling = result.report.sampling;
  std::cout << result.samples.size() << " samples, radii " << sampling.min_radius << " to " << sampling.max_radius << "\n"
            << result.report.quality << "\n"
            << result.report.maximality << "\n";
  if (argc > 2) amps::write_mesh(argv[2], result.mesh);
  return result.report.maximality.maximal() && result.report.maximality.poisson_disk() ? 0 : 1;
} catch (const amps::Error& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
