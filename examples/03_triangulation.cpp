// 03_triangulation.cpp: the regular triangulation on its own — weighted points in, cells and power-nearest queries out.
//
//   03_triangulation [POINTS]
#include "amps/amps.h"

#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

int main(int argc, char** argv) try {
  const amps::Index n = argc > 1 ? std::max(4, std::atoi(argv[1])) : 20000;
  amps::Rng rng(1);
  amps::Points points(n);
  std::vector<double> weights(static_cast<std::size_t>(n));  // squared radii, used as given
  for (amps::Index i = 0; i < n; ++i) {
    for (int k = 0; k < 3; ++k) points(i, k) = rng.uniform();
    weights[static_cast<std::size_t>(i)] = 1e-3 * rng.uniform();
  }

  amps::RegularTriangulation triangulation(points, weights);
  std::cout << triangulation.num_cells() << " cells, " << triangulation.num_ghosts() << " hull facets, "
            << triangulation.num_hidden() << " of " << n << " points hidden\n";

  // One more point, heavy enough to hide its surroundings.
  const amps::Vec3 centre(0.5, 0.5, 0.5);
  const amps::Index heavy = triangulation.insert(centre, 0.01);
  std::vector<amps::Index> neighbors;
  triangulation.neighbors(heavy, neighbors);
  std::cout << "a heavy point in the middle has " << neighbors.size() << " neighbours; now " << triangulation.num_hidden()
            << " points are hidden\n";
  const amps::Index nearest = triangulation.power_nearest(centre);
  std::cout << "power-nearest to the middle: " << (nearest == heavy ? "that point" : "another one") << "\n";

  // Every invariant proved anew, from the cells alone.
  const std::string trouble = triangulation.check();
  std::cout << "check: " << (trouble.empty() ? "correct" : trouble) << "\n";
  return trouble.empty() && nearest == heavy ? 0 : 1;
} catch (const amps::Error& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
