// 05_buffers.cpp: a game engine's vertex buffer as it is — interleaved floats and 16-bit indices — sampled without a copy of
// it.
//
//   05_buffers
#include "amps/amps.h"

#include <cstdint>
#include <iostream>
#include <vector>

struct Vertex {
  float normal[3];
  float position[3];
  std::uint8_t colour[4];
};

int main() try {
  // Somebody else's mesh: here a sphere, in an engine's layout.
  const amps::Mesh sphere = amps::make_sphere(5120);
  std::vector<Vertex> vertices;
  std::vector<std::uint16_t> indices;
  for (std::ptrdiff_t v = 0; v < sphere.vertices.rows(); ++v) {
    const Eigen::RowVector3f p = sphere.vertices.row(v).cast<float>();
    vertices.push_back(
        {{p.x(), p.y(), p.z()}, {p.x(), p.y(), p.z()}, {0, 0, static_cast<std::uint8_t>(127 + 127 * p.z()), 255}});
  }
  for (std::ptrdiff_t i = 0; i < sphere.triangles.size(); ++i)
    indices.push_back(static_cast<std::uint16_t>(sphere.triangles.data()[i]));

  // The view: where the first position lies, how many there are, and how far it is from one to the next.
  const amps::PointsView positions(vertices.front().position, static_cast<std::ptrdiff_t>(vertices.size()), sizeof(Vertex));
  const amps::TrianglesView triangles(indices.data(), static_cast<std::ptrdiff_t>(indices.size() / 3));
  const amps::MeshView view(positions, triangles);

  amps::SamplingOptions options;
  options.radius = 0.05;
  const amps::SampleSet samples = amps::sample(view, options).samples;

  // What the engine stores by vertex is interpolated by facet and barycentric coordinates.
  double blue = 0;
  for (amps::Index s = 0; s < samples.size(); ++s) {
    for (int k = 0; k < 3; ++k) {
      const amps::Index v = view.triangles(samples.facets[static_cast<std::size_t>(s)], k);
      blue += samples.barycentrics(s, k) * vertices[static_cast<std::size_t>(v)].colour[2];
    }
  }
  const amps::MaximalityReport certificate = amps::verify_maximal(view, samples);
  std::cout << samples.size() << " samples, mean blue " << blue / samples.size() << "\n" << certificate << "\n";
  return certificate.maximal() && certificate.poisson_disk() ? 0 : 1;
} catch (const amps::Error& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
