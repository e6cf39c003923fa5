// sample_points.cpp: blue-noise points on a mesh, as lines of x y z. From this file and amps_single.h alone (`cmake --build
// BUILD
// --target amps_single_header` writes it into BUILD; copy it here).
//
//   c++ -std=c++17 -O2 -I/usr/include/eigen3 sample_points.cpp -o sample_points -pthread
//   ./sample_points bunny.obj 5000 > bunny.xyz
#define AMPS_IMPLEMENTATION
#include "amps_single.h"

#include <cstdlib>
#include <iostream>

int main(int argc, char** argv) try {
  const amps::Mesh mesh = argc > 1 ? amps::read_mesh(argv[1]) : amps::make_torus();

  amps::SamplingOptions options;
  options.target_count = argc > 2 ? std::atoi(argv[2]) : 500;
  const amps::SampleSet samples = amps::sample(mesh, options).samples;

  std::cout.precision(17);
  for (amps::Index s = 0; s < samples.size(); ++s) {
    std::cout << samples.positions(s, 0) << ' ' << samples.positions(s, 1) << ' ' << samples.positions(s, 2) << '\n';
  }
  return std::cout.flush() ? 0 : 1;
} catch (const amps::Error& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
