// shapes.h: procedural meshes for tests, examples and the command-line program. All are oriented outwards (the square
// upwards), the closed ones watertight with shared vertices and embedded.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/mesh.h"

namespace amps {

// Every function here throws Error(kInvalidArgument) for a size that is not positive and finite or a count below its minimum,
// and Error(kTooLarge) for more vertices or facets than an Index counts. O(#V + #F).

/// The unit square [0,1]² at z = 0 as n × n cells of two triangles, n ≥ 1. (n+1)² vertices, 2n² facets.
AMPS_EXPORT Mesh make_square(Index n = 1);

/// Surface of the unit cube [0,1]³, n × n cells of two triangles a side, n ≥ 1. 6n²+2 vertices, 12n² facets.
AMPS_EXPORT Mesh make_cube(Index n = 1);

/// Sphere around the origin: an icosahedron with every facet cut into n² and projected, where n ≥ 1 brings 20n² nearest to
/// `facets`. 10n²+2 vertices, all on the sphere to rounding.
AMPS_EXPORT Mesh make_sphere(Index facets = 5120, double radius = 1.0);

/// The same with semi-axes a, b, c.
AMPS_EXPORT Mesh make_ellipsoid(Index facets, const Vec3& semi_axes);

/// Torus around the z axis, `major` from the axis to the middle of the tube, `minor` < major the radius of the tube; nu ≥ 3
/// cells along, nv ≥ 3 around the tube. nu·nv vertices, 2·nu·nv facets.
AMPS_EXPORT Mesh make_torus(double major = 1.0, double minor = 0.4, Index nu = 96, Index nv = 40);

/// A tube around the (p, q) torus knot
///   c(t) = ((R + a cos qt) cos pt, (R + a cos qt) sin pt, a sin qt),  0 ≤ t < 2π;  (2, 3) is the trefoil.
struct KnotOptions {
  int p = 2;           ///< turns around the axis, ≥ 1, p and q without common divisor
  int q = 3;           ///< turns around the tube of the torus, ≥ 1
  double major = 2.0;  ///< R
  double minor = 1.0;  ///< a < R
  double tube = 0;     ///< radius of the tube; 0: seven tenths of the knot's reach (the largest that does not touch itself)
  Index around = 24;   ///< cells around the tube, ≥ 3
  Index along = 0;     ///< cells along the knot, ≥ 8(p + q); 0: as many as make cells about square
};

/// Genus 1, 2·along·around facets. Throws Error(kInvalidArgument) too if `tube` is over 0.9 of the reach.
AMPS_EXPORT Mesh make_knot(const KnotOptions& options = {});

}  // namespace amps

#include "amps/host_macros_end.h"
