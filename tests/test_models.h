// test_models.h: the models on which amps promises maximal sets and bounded angles — real ones where the machine has them,
// procedural stand-ins of the same kind where it does not.
#pragma once

#include "amps/shapes.h"
#include "test_data.h"

#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

struct Model {
  std::string name;
  amps::Mesh mesh;
  double radius;  ///< for a few thousand samples (procedural) or about 10,000 (real)
};

/// The radius at which about `count` samples cover the mesh.
inline double radius_for(const amps::Mesh& mesh, double count) { return std::sqrt(0.7 * amps::total_area(mesh) / count); }

inline Model model(const std::string& name, amps::Mesh mesh, double count) {
  const double radius = radius_for(mesh, count);
  return {name, std::move(mesh), radius};
}

/// A sphere of the given area: the facets' own, not that of the smooth surface.
inline amps::Mesh sphere_of_area(double area, amps::Index facets) {
  amps::Mesh mesh = amps::make_sphere(facets);
  mesh.vertices *= std::sqrt(area / amps::total_area(mesh));
  return mesh;
}

inline std::vector<Model> procedural_models() {
  return {model("square", amps::make_square(), 4000), model("sphere", amps::make_sphere(1280), 4000),
          model("torus", amps::make_torus(), 4000), model("knot", amps::make_knot(), 4000),
          model("cube", amps::make_cube(3), 3000)};
}

inline std::vector<Model> real_models() {
  const amps::Mesh blob = amps::make_ellipsoid(5120, {1.0, 0.8, 0.6});
  amps::Mesh open_blob = blob;
  open_blob.triangles.conservativeResize(blob.triangles.rows() - 300, 3);
  const std::vector<std::pair<std::string, amps::Mesh>> files = {{"bunny_100kf_closed.obj", blob},
                                                                 {"bunny_36k_holes.obj", open_blob},
                                                                 {"triceratops.off", blob},
                                                                 {"fandisk.obj", amps::make_cube(4)},
                                                                 {"rocker-arm.obj", amps::make_torus(1.0, 0.2)},
                                                                 {"fertility.off", amps::make_knot()},
                                                                 {"homer.obj", amps::make_ellipsoid(1280, {1.0, 0.2, 0.1})},
                                                                 {"spot.obj", blob}};
  std::vector<Model> models;
  for (const auto& [name, stand_in] : files) models.push_back(model(name, data_mesh_or(name, stand_in), 10000));
  return models;
}

}  // namespace amps_test
