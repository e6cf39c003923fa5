// remesh_file.cpp: a mesh file remeshed, from this file and amps_single.h alone (`cmake --build BUILD --target
// amps_single_header` writes it into BUILD; copy it here).
//
//   c++ -std=c++17 -O2 -I/usr/include/eigen3 remesh_file.cpp -o remesh_file -pthread
//   ./remesh_file bunny.obj out.obj 12000
#define AMPS_IMPLEMENTATION
#include "amps_single.h"

#include <cstdlib>
#include <iostream>

int main(int argc, char** argv) try {
  const amps::Mesh mesh = argc > 1 ? amps::read_mesh(argv[1]) : amps::make_knot();

  amps::RemeshOptions options;
  options.sampling.target_count = argc > 3 ? std::atoi(argv[3]) : 2000;
  const amps::RemeshResult result = amps::remesh(mesh, options);

  std::cout << result.report.quality << "\n" << result.report.maximality << "\n";
  if (argc > 2) amps::write_mesh(argv[2], result.mesh);
  return 0;
} catch (const amps::Error& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
