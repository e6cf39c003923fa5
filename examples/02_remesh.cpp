// 02_remesh.cpp: a mesh remeshed from matrices of the caller's own, with progress and a time limit.
//
//   02_remesh [MESH [OUT]]
#include "amps/amps.h"

#include <chrono>
#include <iostream>

int main(int argc, char** argv) try {
  const amps::Mesh input = argc > 1 ? amps::read_mesh(argv[1]) : amps::make_knot();

  // A program with matrices of its own gives them as they are, whatever their storage order: nothing is copied.
  const Eigen::MatrixXd vertices = input.vertices.map();
  const Eigen::MatrixXi triangles = input.triangles.map();
  const amps::MeshView view(vertices, triangles);

  amps::RemeshOptions options;
  options.sampling.target_count = 3000;
  options.sampling.execution.threads = 0;  // one per core; the result is the same for any number
  const auto start = std::chrono::steady_clock::now();
  options.sampling.execution.progress = amps::Progress([&](const char*, double) {  // false stops the work
    return std::chrono::steady_clock::now() - start < std::chrono::minutes(2);
  });

  const amps::RemeshResult result = amps::remesh(view, options);
  if (result.status == amps::Outcome::kCancelled) {
    std::cerr << "that took too long\n";
    return 1;
  }
  const amps::RemeshReport& report = result.report;
  const double radius = report.sampling.radius;
  std::cout << result.mesh.vertices.rows() << " vertices, " << result.mesh.triangles.rows() << " triangles\n"
            << "angles " << report.quality.min_angle << " to " << report.quality.max_angle << " degrees\n"
            << "edges  " << report.quality.min_edge / radius << " r to " << report.quality.max_edge / radius << " r\n"
            << "input:  " << report.input << "\n"
            << "output: " << report.output << "\n";
  if (argc > 2) amps::write_mesh(argv[2], result.mesh);

  // By theorem; 1e-9 is for the rounding of measured values.
  const bool kept = report.quality.min_angle >= 30 - 1e-9 && report.quality.max_angle <= 120 + 1e-9 &&
                    report.quality.min_edge >= radius * (1 - 1e-9) && report.quality.max_edge <= 2 * radius * (1 + 1e-9);
  return kept ? 0 : 1;
} catch (const amps::Error& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
