// models.h: the models on which amps promises maximal sets and bounded angles — real ones where the machine has them,
// procedural stand-ins of the same kind where it does not.
#pragma once

#include "data.h"
#include "meshes.h"

#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

struct Model {
  std::string name;
  Mesh mesh;
  double radius;  ///< for a few thousand samples (procedural) or about 10,000 (real)
};

/// The radius at which about `count` samples cover the mesh.
inline double radius_for(const Mesh& mesh, double count) { return std::sqrt(0.7 * amps::total_area(mesh) / count); }

inline Model model(const std::string& name, Mesh mesh, double count) {
  const double radius = radius_for(mesh, count);
  return {name, std::move(mesh), radius};
}

/// A sphere of the given area: the facets' own, not that of the smooth surface.
inline Mesh sphere_of_area(double area, Index facets) {
  const Mesh mesh = amps::make_sphere(facets);
  return scaled(mesh, std::sqrt(area / amps::total_area(mesh)));
}

inline std::vector<Model> procedural_models() {
  return {model("square", amps::make_square(), 4000), model("sphere", amps::make_sphere(1280), 4000),
          model("torus", amps::make_torus(), 4000), model("knot", amps::make_knot(), 4000),
          model("cube", amps::make_cube(3), 3000)};
}

inline std::vector<Model> real_models() {
  const Mesh blob = amps::make_ellipsoid(5120, {1.0, 0.8, 0.6});
  const Mesh open_blob = first_facets(blob, rows(blob.triangles) - 300);
  const std::vector<std::pair<std::string, Mesh>> files = {{"bunny_100kf_closed.obj", blob},
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

/// Surfaces with everything that can be wrong with one, where the machine has them.
inline std::vector<Model> difficult_models() {
  const std::vector<std::string> names = {"anchor.off",
                                          "bones_26comps.off",
                                          "bumpy.off",
                                          "bunny_3k_closed.off",
                                          "cheburashka.off",
                                          "cow.off",
                                          "cube-minimal-degenerated.obj",
                                          "cube-shuffled.off",
                                          "cube_twist.obj",
                                          "degtri_four-2.off",
                                          "degtri_sliding.off",
                                          "double-torus-polygons.off",
                                          "eight.off",
                                          "elephant.off",
                                          "fan3_nonmanifold_edge.obj",
                                          "fandisk_coarse.obj",
                                          "fandisk_quads.off",
                                          "hemisphere.off",
                                          "hinge_ascii.stl",
                                          "hole_capsule_quads.off",
                                          "hourglass_nonmanifold_vertex.obj",
                                          "joined_tetrahedra.obj",
                                          "knot2_2comps.off",
                                          "lion-head.off",
                                          "maxFace.obj",
                                          "mech-holes-shark.off",
                                          "moebius.obj",
                                          "negative_indices.obj",
                                          "netgen_part1_ascii.stl",
                                          "platonic_shelf_polygons.obj",
                                          "prim_isolated.off",
                                          "quads_to_stitch.off",
                                          "sphere_solid_header_binary.stl",
                                          "suzanne.obj",
                                          "teapot.obj",
                                          "thingi_65004.stl",
                                          "three_peaks.off",
                                          "triple_vierbein.obj",
                                          "two_spheres_overlap.obj"};
  const Mesh stand_in = amps::make_ellipsoid(320, {1.0, 0.5, 0.01});
  std::vector<Model> models;
  for (const std::string& name : names) models.push_back(model(name, data_mesh_or(name, stand_in), 10000));
  return models;
}

}  // namespace amps_test
