// What a user's first program does. Fails if amps does not do its work in a foreign project.
#include <amps/amps.h>

#include <cstdio>

int main() {
  amps::RemeshOptions options;
  options.sampling.radius = 0.2;
  const amps::RemeshResult result = amps::remesh(amps::make_sphere(1280), options);
  std::printf("%d vertices, angles from %.1f to %.1f degrees\n", static_cast<int>(result.mesh.vertices.rows()),
              result.report.quality.min_angle, result.report.quality.max_angle);
  return result.report.maximality.maximal() && result.report.quality.min_angle > 29.9 ? 0 : 1;
}
