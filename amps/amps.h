// amps.h: everything public in one include, the version, and where to start reading.
//
// amps places maximal Poisson-disk sets on triangle meshes and remeshes with them (Yan & Wonka, SIGGRAPH Asia 2012; ACM TOG
// 32(5), 2013). A set of disks of radius r is Poisson-disk when no two centres are nearer than r, and maximal when no further
// disk fits: every point of the surface is within r of a centre. Of a maximal set, the dual triangulation on the surface has
// all angles in [30°, 120°] and all edges in [r, 2r]: guaranteed, on any surface. Whether a set is maximal is decided exactly,
// not by tolerance: by the signs of polynomials at the corners of the cells of a diagram.
//
//   #include "amps/amps.h"
//
//   amps::Mesh mesh = amps::read_mesh("bunny.obj");
//   amps::RemeshOptions options;
//   options.sampling.target_count = 12000;  // or .radius, in the units of the mesh
//   amps::RemeshResult result = amps::remesh(mesh, options);
//   std::cout << result.report.quality << "\n" << result.report.maximality << "\n";
//   amps::write_mesh("bunny_12k.obj", result.mesh);
//
// No global state, nothing printed, no exit; the same input, options and seed give the same bits on any platform and any number
// of threads. Bad input throws amps::Error. Buffers are taken as views of your own, in float or double, row by row,
// interleaved or by columns: nothing is copied.
//
// Reading order. A file includes only files above it (tests/check_reading_order.cmake holds it to that).
//
//   host_macros_begin.h  (internal) macros of the host are set aside
//   host_macros_end.h    (internal) and put back
//   contraction.h    (internal) no fused multiply-add in amps's own sources
//   base.h           vectors and indices, Error, Rng
//   buffers.h        plain tables that results own, views of the caller's memory
//   thread_pool.h    (internal) threads that are started once
//   execution.h      Execution: threads, progress and cancelling of a call; parallel_for
//   portable_math.h  (internal) angles; sine, logarithm and their like with the same bits everywhere
//   exact.h          (internal) the number types behind exact decisions
//   predicates.h     orientation, power test, sides of bisectors, coverage: filter, exact, symbolic
//   mesh.h           Mesh and MeshView, areas, normals, topology, what is wrong with an input
//   mesh_edges.h     (internal) facets at edges, fans of corners, disjoint sets, points by position
//   mesh_scale.h     (internal) powers of two, so that coordinates of any magnitude behave as those at 1
//   shapes.h         sphere, torus, square, knot, cube
//   kdtree.h         nearest points (nanoflann, kept inside the .cpp)
//   surface_tree.h   SurfaceTree: the nearest point of a surface
//   box_tree.h       (internal) points and segments by distance
//   spatial_sort.h   (internal) the order of bulk insertion: random rounds along a Hilbert curve
//   samples.h        the sample set, the conflict rule; how a sample is made
//   reach.h          (internal) what a disk reaches: facets joined to its centre within its ball; by sample and by facet
//   triangulation.h  RegularTriangulation: the 3D regular triangulation of weighted points
//   triangulation_queries   (its .cpp only) cells, neighbours, location, the proof of all invariants
//   triangulation_edit      (its .cpp only) removing, moving and re-weighting points
//   triangulation_parallel  (its .cpp only) bulk insertion by several threads
//   site_tree.h      (internal) sites by place, while they come and go
//   polygon_pages.h  (internal) memory of polygons that change
//   power_diagram.h  RestrictedPowerDiagram: the surface cut into the cells of the samples
//   power_diagram_clipper  (internal) its polygons, cut by bisectors
//   power_diagram_edit     (its .cpp only) inserting and removing sites
//   power_diagram_pending  (its .cpp only) edits side by side
//   power_diagram_local    (its .cpp only) facets divided among the sites that reach them
//   sizing.h         sizing fields: the wanted radius at each point of a surface
//   sizing_lattice.h  (internal) its tables: lattices on facets, interpolation, the integral that counts samples
//   sizing_gradation        (its .cpp only) limiting how fast the radius changes; fields for a number of samples
//   sizing_lfs              (its .cpp only) local feature size, by poles
//   sizing_curvature        (its .cpp only) principal curvatures, radii for a bound of the error
//   curves.h         which edges are kept as curves: borders, creases, marks; corners and patches
//   cap_field.h      (internal) bounds of radii around points where they had to be small
//   wanted_radii.h   (internal) one radius or a field, and the conflict rule, behind one face
//   voxel_grid.h     (internal) which samples are near a dart
//   darts.h          (internal) drawing facets by weight and points by density
//   disk_set.h       (internal) the disks there are, balls or parts of the surface, and what conflicts with them
//   count_model.h    (internal) how many samples radii make
//   curve_proximity.h  (internal) distances between curves, where floods get from one to the other
//   curve_spacing.h  (internal) samples along one curve
//   curve_sampling.h  (internal) samples on corners and along curves
//   gaps.h           (internal) the uncovered part of a fragment: area, primitives, uniform points in it
//   gap_filling.h    (internal) fills gaps, for whoever has a set
//   topology_certificate.h  does the dual have the topology of the surface, curves included
//   topology_refinement.h   (internal) smaller radii where it has not
//   dual_mesh.h      (internal) the dual triangles as a mesh
//   dual_star.h      (internal) the dual triangles around a sample, and how bad they are
//   trial_patch.h    (internal) the dual triangles around a few samples, to try refills on
//   refill.h         (internal) finding refills that improve what is bad
//   sample_edit.h    (internal) samples, diagram and grid edited together, kept or undone
//   exact_count.h    what came of meeting a number of samples exactly
//   count_editor.h   (internal) adds samples, or takes some out, where that costs least
//   sampling.h       darts, then gap filling; smaller radii where the topology asks for them
//   sampling_stages.h  (internal) the stages of a run
//   maximality.h     the certificate that a set is maximal; its gaps
//   optimize.h       better triangles and valences by refilling gaps
//   optimize_state.h  (internal) what its parts work on
//   optimize_refiller.h  (internal) refills carried out, kept or undone
//   polygons.h       (internal) polygons of files, cut into triangles
//   decimal.h        (internal) doubles as text
//   file_io.h        (internal) what readers and writers share: places of errors, numbers, whole files
//   file_io_replace         (its .cpp only) files written whole or not at all
//   ply.h            (internal) reading PLY, and what all readers build meshes with
//   mesh_io.h        OBJ, OFF, PLY, STL and sample files
//   mesh_io_samples         (its .cpp only) sample files, lists of numbers
//   quality.h        angles, edges, areas, valences
//   spectrum.h       power spectra of point sets in the plane, differential-domain analysis on surfaces
//   spectrum_differential   (its .cpp only) the latter
//   surface_distance.h  Hausdorff, root-mean-square and mean distance between two surfaces
//   self_intersections.h  facets that cross, touch or overlap
//   fit_system.h     (internal) offsets of vertices by least squares
//   fit.h            vertices that leave the surface, so that triangles lie closer to it
//   error_refinement.h  (internal) smaller radii where a result is too far from the surface
//   remesh.h         the dual triangulation, and the whole pipeline in one call
#pragma once

/// Semantic version; CMake reads it from here.
#define AMPS_VERSION_MAJOR 0
#define AMPS_VERSION_MINOR 1
#define AMPS_VERSION_PATCH 0

#include "amps/base.h"
#include "amps/buffers.h"
#include "amps/execution.h"
#include "amps/predicates.h"
#include "amps/mesh.h"
#include "amps/shapes.h"
#include "amps/kdtree.h"
#include "amps/samples.h"
#include "amps/triangulation.h"
#include "amps/power_diagram.h"
#include "amps/sizing.h"
#include "amps/curves.h"
#include "amps/topology_certificate.h"
#include "amps/exact_count.h"
#include "amps/sampling.h"
#include "amps/maximality.h"
#include "amps/optimize.h"
#include "amps/mesh_io.h"
#include "amps/quality.h"
#include "amps/spectrum.h"
#include "amps/surface_tree.h"
#include "amps/surface_distance.h"
#include "amps/self_intersections.h"
#include "amps/fit.h"
#include "amps/remesh.h"
