// 01_sample.cpp: a maximal Poisson-disk set on a mesh, and what each sample knows about the surface under it.
//
//   01_sample [MESH [RADIUS [OUT.xyzr]]]
#include "amps/amps.h"

#include <cstdlib>
#include <iostream>

int main(int argc, char** argv) try {
  const amps::Mesh mesh = argc > 1 ? amps::read_mesh(argv[1]) : amps::make_torus();

  amps::SamplingOptions options;
  options.radius = argc > 2 ? std::atof(argv[2]) : 0.02 * amps::bounding_box(mesh).diagonal();
  options.seed = 7;  // the same seed gives the same bits, everywhere
  const amps::SamplingResult result = amps::sample(mesh, options);
  const amps::SampleSet& samples = result.samples;
  std::cout << samples.size() << " samples of radius " << result.report.radius << ": " << result.report.dart_samples
            << " from darts, " << result.report.gap_samples << " from gaps\n";

  // Anything stored per vertex can be interpolated at a sample. Here: the position itself, to show that it works.
  double error = 0;
  for (amps::Index s = 0; s < samples.size(); ++s) {
    amps::Vec3 p = amps::Vec3::Zero();
    for (int k = 0; k < 3; ++k) {
      const amps::Index vertex = mesh.triangles(samples.facets[static_cast<std::size_t>(s)], k);
      p += samples.barycentrics(s, k) * mesh.vertices.row(vertex).transpose();
    }
    error = std::max(error, (p - samples.positions.row(s).transpose()).norm());
  }
  std::cout << "interpolated positions differ by " << error << " at most\n";

  // The certificate comes from a fresh diagram, not from the sampler's own books.
  const amps::MaximalityReport certificate = amps::verify_maximal(mesh, samples);
  std::cout << certificate << "\n";
  if (argc > 3) amps::write_samples(argv[3], samples);
  return certificate.maximal() && certificate.poisson_disk() ? 0 : 1;
} catch (const amps::Error& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
