// test_diagrams.h: sites and meshes for tests of restricted power diagrams, the laws that every diagram obeys, an oracle for
// its areas, and equality of diagrams.
#pragma once

#include "amps/power_diagram.h"
#include "amps/shapes.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <numeric>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

using amps::Error;
using amps::ErrorCode;
using amps::Index;
using amps::kNone;
using amps::Mesh;
using amps::MeshView;
using amps::Points;
using amps::Rng;
using amps::Triangles;
using amps::Vec3;
using Diagram = amps::RestrictedPowerDiagram;
using Real = long double;

struct Sites {
  Points positions;
  Eigen::VectorXd weights;
  Index size() const { return static_cast<Index>(positions.rows()); }
  Vec3 at(Index s) const { return positions.row(s).transpose(); }
};

inline Sites sites_of(const std::vector<Vec3>& positions) {
  Sites sites{Points(static_cast<Index>(positions.size()), 3), Eigen::VectorXd::Zero(static_cast<Index>(positions.size()))};
  for (Index s = 0; s < sites.size(); ++s) sites.positions.row(s) = positions[static_cast<std::size_t>(s)].transpose();
  return sites;
}

inline Mesh mesh_of(const std::vector<Vec3>& vertices, const std::vector<std::array<Index, 3>>& triangles) {
  Mesh mesh;
  mesh.vertices = sites_of(vertices).positions;
  mesh.triangles.resize(static_cast<Index>(triangles.size()), 3);
  for (Index f = 0; f < mesh.triangles.rows(); ++f) {
    for (int k = 0; k < 3; ++k) mesh.triangles(f, k) = triangles[static_cast<std::size_t>(f)][static_cast<std::size_t>(k)];
  }
  return mesh;
}

/// Uniform points of the surface, and a few within `lift` of it, with weights in [0, max_weight).
inline Sites random_sites(const Mesh& mesh, Index n, double max_weight, std::uint64_t seed, double lift = 0) {
  Rng rng(seed);
  const std::vector<double> areas = amps::facet_areas(mesh);
  std::vector<double> up_to(areas.size());
  std::partial_sum(areas.begin(), areas.end(), up_to.begin());
  Sites sites{Points(n, 3), Eigen::VectorXd(n)};
  for (Index s = 0; s < n; ++s) {
    const auto found = std::upper_bound(up_to.begin(), up_to.end(), rng.uniform() * up_to.back());
    const auto facet = static_cast<Index>(std::min<std::ptrdiff_t>(found - up_to.begin(), mesh.triangles.rows() - 1));
    const Vec3 b = amps::uniform_barycentric(rng);
    Vec3 x = Vec3::Zero();
    for (int k = 0; k < 3; ++k) x += b[k] * MeshView(mesh).corner(facet, k);
    for (int k = 0; k < 3; ++k) x[k] += lift * (rng.uniform() - 0.5);
    sites.positions.row(s) = x.transpose();
    sites.weights[s] = max_weight * rng.uniform();
  }
  return sites;
}

/// Unconnected triangles of all sizes in the unit cube, some crossing each other.
inline Mesh random_soup(Index n, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<Vec3> vertices;
  std::vector<std::array<Index, 3>> triangles;
  for (Index f = 0; f < n; ++f) {
    const Vec3 centre(rng.uniform(), rng.uniform(), rng.uniform());
    const double size = rng.uniform();
    for (int k = 0; k < 3; ++k) {
      vertices.push_back(centre + size * (Vec3(rng.uniform(), rng.uniform(), rng.uniform()) - Vec3::Constant(0.5)));
    }
    triangles.push_back({3 * f, 3 * f + 1, 3 * f + 2});
  }
  return mesh_of(vertices, triangles);
}

/// A book of `pages` rectangles around one spine: a non-manifold edge.
inline Mesh open_book(Index pages) {
  std::vector<Vec3> vertices = {{0, 0, 0}, {0, 0, 1}};
  std::vector<std::array<Index, 3>> triangles;
  for (Index p = 0; p < pages; ++p) {
    const double angle = 0.3 + 1.1 * p;
    const Index v = static_cast<Index>(vertices.size());
    for (const double z : {0.0, 1.0}) vertices.emplace_back(std::cos(angle), std::sin(angle), z);
    triangles.push_back({0, v, v + 1});
    triangles.push_back({0, v + 1, 1});
  }
  return mesh_of(vertices, triangles);
}

inline Mesh with_random_flips(Mesh mesh, std::uint64_t seed) {
  Rng rng(seed);
  for (Index f = 0; f < mesh.triangles.rows(); ++f) {
    if (rng.below(2) == 0) std::swap(mesh.triangles(f, 1), mesh.triangles(f, 2));
  }
  return mesh;
}

inline Mesh joined(const Mesh& a, const Mesh& b) {
  Mesh mesh{Points(a.vertices.rows() + b.vertices.rows(), 3), Triangles(a.triangles.rows() + b.triangles.rows(), 3)};
  mesh.vertices << a.vertices, b.vertices;
  mesh.triangles << a.triangles, (b.triangles.array() + static_cast<Index>(a.vertices.rows())).matrix();
  return mesh;
}

inline Mesh small_knot() {
  amps::KnotOptions options;
  options.around = 6;
  options.along = 60;
  return amps::make_knot(options);
}

struct NamedMesh {
  std::string name;
  Mesh mesh;
};

inline std::vector<NamedMesh> small_meshes() {
  return {{"square", amps::make_square(3)},
          {"cube", amps::make_cube(2)},
          {"sphere", amps::make_sphere(180)},
          {"torus", amps::make_torus(1.0, 0.4, 14, 8)},
          {"knot", small_knot()},
          {"soup", random_soup(40, 11)},
          {"book of 5 pages", open_book(5)},
          {"sphere with flipped facets", with_random_flips(amps::make_sphere(180), 12)},
          {"two components", joined(amps::make_sphere(80), amps::make_cube(1))}};
}

inline bool same_bits(const Vec3& a, const Vec3& b) { return std::memcmp(a.data(), b.data(), 3 * sizeof(double)) == 0; }

/// The sites of a polygon corner: the owner and the labels of its two edges.
inline std::array<Index, 3> corner_key(const Diagram::Polygon& p, Index k) {
  std::array<Index, 3> key = {p.site, p.labels[k == 0 ? p.size - 1 : k - 1], p.labels[k]};
  std::sort(key.begin(), key.end());
  return key;
}

inline Real facet_area(const Mesh& mesh, Index facet) {
  using V = Eigen::Matrix<Real, 3, 1>;
  const V a = MeshView(mesh).corner(facet, 0).cast<Real>(), b = MeshView(mesh).corner(facet, 1).cast<Real>(),
          c = MeshView(mesh).corner(facet, 2).cast<Real>();
  return (b - a).cross(c - a).norm() / 2;
}

/// Area by the shoelace formula in the facet's plane, signed by the facet's orientation.
inline Real signed_area(const Mesh& mesh, const Diagram::Polygon& p) {
  using V = Eigen::Matrix<Real, 3, 1>;
  const V a = MeshView(mesh).corner(p.facet, 0).cast<Real>(), b = MeshView(mesh).corner(p.facet, 1).cast<Real>(),
          c = MeshView(mesh).corner(p.facet, 2).cast<Real>();
  const V normal = (b - a).cross(c - a).normalized();
  V sum = V::Zero();
  for (Index k = 0; k < p.size; ++k) {
    const V x = p.corners[k].cast<Real>() - a, y = p.corners[k + 1 == p.size ? 0 : k + 1].cast<Real>() - a;
    sum += x.cross(y);
  }
  return sum.dot(normal) / 2;
}

inline bool is_degenerate(const Mesh& mesh, Index facet) {
  const MeshView view(mesh);
  return amps::collinear(view.position(mesh.triangles(facet, 0)), view.position(mesh.triangles(facet, 1)),
                         view.position(mesh.triangles(facet, 2)));
}

/// Every combinatorial law of a restricted power diagram, proved from the public interface alone. Returns the first violation.
inline std::string broken_law(const Mesh& mesh, const Diagram& diagram) {
  if (const std::string found = diagram.check(); !found.empty()) return "check(): " + found;
  struct Seen {
    int times = 0;
    Vec3 position = Vec3::Zero();
  };
  const auto see = [](Seen& seen, const Vec3& x) {
    if (seen.times++ == 0) seen.position = x;
    return same_bits(seen.position, x);
  };
  // Crossings of mesh edges, by the global ends of the edge and the two sites, over all facets.
  std::map<std::array<Index, 4>, Seen> on_edge;
  std::map<std::array<Index, 2>, int> facets_of_edge;
  Index fragments = 0, listed_triangles = 0;
  std::vector<Index> of_site(static_cast<std::size_t>(diagram.num_sites()), 0);
  for (Index facet = 0; facet < mesh.triangles.rows(); ++facet) {
    const std::string where = " on facet " + std::to_string(facet);
    if (is_degenerate(mesh, facet)) {
      if (diagram.first_of_facet(facet) != kNone) return "a facet without area has fragments:" + where;
      continue;
    }
    for (int e = 0; e < 3; ++e) {
      ++facets_of_edge[{std::min(mesh.triangles(facet, e), mesh.triangles(facet, (e + 1) % 3)),
                        std::max(mesh.triangles(facet, e), mesh.triangles(facet, (e + 1) % 3))}];
    }
    std::map<std::array<Index, 3>, Seen> inside, at_border;
    std::map<std::array<Index, 2>, int> shared_edges;
    std::set<Index> owners;
    Real total = 0, extent = 0;
    for (int k = 0; k < 3; ++k) {
      extent = std::max<Real>(extent, (MeshView(mesh).corner(facet, k) - MeshView(mesh).corner(facet, (k + 1) % 3)).norm());
      extent = std::max<Real>(extent, 1e-3 * MeshView(mesh).corner(facet, k).cwiseAbs().maxCoeff());
    }
    for (Index f = diagram.first_of_facet(facet); f != kNone; f = diagram.next_of_facet(f)) {
      const Diagram::Polygon p = diagram.polygon(f);
      ++fragments;
      ++of_site[static_cast<std::size_t>(p.site)];
      if (!diagram.alive(f) || p.facet != facet || p.size < 3) return "a list holds what it should not" + where;
      if (!diagram.visible(p.site)) return "a hidden site owns a fragment" + where;
      if (!owners.insert(p.site).second) return "a site owns two fragments" + where;
      const Real area = signed_area(mesh, p);
      if (area < -1e-13L * extent * extent) return "a fragment runs clockwise" + where;
      total += area;
      for (Index k = 0; k < p.size; ++k) {
        const std::array<Index, 3> key = corner_key(p, k);
        const Index in = p.labels[k == 0 ? p.size - 1 : k - 1], out = p.labels[k];
        if (in == out || in == p.site || out == p.site) return "labels repeat" + where;
        const int mesh_edges = !Diagram::is_site(in) + !Diagram::is_site(out);
        if (!see(mesh_edges == 0 ? inside[key] : at_border[key], p.corners[k])) return "corners at one vertex differ" + where;
        listed_triangles += mesh_edges == 0;
        if (Diagram::is_site(out)) ++shared_edges[{std::min(p.site, out), std::max(p.site, out)}];
        if (mesh_edges == 1) {
          const int e = Diagram::mesh_edge(Diagram::is_site(in) ? out : in);
          const Index other = Diagram::is_site(in) ? in : out;
          const Index u = mesh.triangles(facet, e), v = mesh.triangles(facet, (e + 1) % 3);
          Seen& seen = on_edge[{std::min(u, v), std::max(u, v), std::min(p.site, other), std::max(p.site, other)}];
          if (!see(seen, p.corners[k])) return "corners on the two sides of a mesh edge differ" + where;
        }
        if (mesh_edges == 2) {
          const int corner = Diagram::mesh_edge(out);
          if (Diagram::mesh_edge(in) != (corner + 2) % 3) return "mesh edges do not meet in a corner" + where;
          if (!same_bits(p.corners[k], MeshView(mesh).corner(facet, corner))) return "a mesh corner has moved" + where;
        }
      }
    }
    if (std::fabs(total - facet_area(mesh, facet)) > 1e-12L * facet_area(mesh, facet) + 1e-14L * extent * extent) {
      return "fragments do not tile" + where;
    }
    for (const auto& [key, seen] : inside) {
      if (seen.times != 3) return "a vertex inside is seen " + std::to_string(seen.times) + " times" + where;
    }
    for (const auto& [key, seen] : at_border) {
      const int expected = Diagram::is_site(key[1]) ? 2 : 1;  // sorted: mesh edges are negative and come first
      if (seen.times != expected) return "a vertex on the border is seen " + std::to_string(seen.times) + " times" + where;
    }
    for (const auto& [key, times] : shared_edges) {
      if (times != 2) return "a label is not mutual" + where;
    }
  }
  for (const auto& [key, seen] : on_edge) {
    if (seen.times != 2 * facets_of_edge[{key[0], key[1]}]) return "the facets of a mesh edge disagree on its crossings";
  }
  if (fragments != diagram.num_fragments()) return "num_fragments() is off";
  for (Index s = 0; s < diagram.num_sites(); ++s) {
    Index count = 0;
    for (Index f = diagram.first_of_site(s); f != kNone; f = diagram.next_of_site(f)) {
      if (diagram.polygon(f).site != s || !diagram.alive(f)) return "the list of a site holds what it should not";
      ++count;
    }
    if (count != of_site[static_cast<std::size_t>(s)]) return "the list of a site is incomplete";
  }
  if (3 * diagram.dual_triangles().rows() != listed_triangles) return "dual_triangles() are not the vertices inside";
  return "";
}

/// The oracle: area per site by clipping every facet with every bisector, no neighbours asked. Points are barycentric; a facet
/// that lies in a bisector goes to the lexicographically smaller site, of equal positions the heaviest, then the first, owns
/// all.
inline std::vector<Real> brute_force_areas(const Mesh& mesh, const Sites& sites) {
  using Point = std::array<Real, 3>;
  std::vector<Real> areas(static_cast<std::size_t>(sites.size()), 0);
  std::vector<Point> polygon, clipped;
  for (Index facet = 0; facet < mesh.triangles.rows(); ++facet) {
    if (is_degenerate(mesh, facet)) continue;
    const Real whole = facet_area(mesh, facet);
    for (Index i = 0; i < sites.size(); ++i) {
      polygon = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
      for (Index j = 0; j < sites.size() && !polygon.empty(); ++j) {
        if (i == j) continue;
        const Vec3 p = sites.at(i), q = sites.at(j);
        if (p == q) {
          const double wi = sites.weights[i], wj = sites.weights[j];
          if (wj > wi || (wj == wi && j < i)) polygon.clear();
          continue;
        }
        Point d;
        for (int c = 0; c < 3; ++c) {
          const Vec3 x = MeshView(mesh).corner(facet, c);
          Real sum = static_cast<Real>(sites.weights[i]) - static_cast<Real>(sites.weights[j]);
          for (int a = 0; a < 3; ++a) {
            sum += (static_cast<Real>(q[a]) - p[a]) * ((static_cast<Real>(q[a]) - x[a]) + (static_cast<Real>(p[a]) - x[a]));
          }
          d[static_cast<std::size_t>(c)] = sum;
        }
        if (d[0] == 0 && d[1] == 0 && d[2] == 0) {
          if (std::lexicographical_compare(q.data(), q.data() + 3, p.data(), p.data() + 3)) polygon.clear();
          continue;
        }
        const auto side = [&d](const Point& x) { return x[0] * d[0] + x[1] * d[1] + x[2] * d[2]; };
        clipped.clear();
        for (std::size_t k = 0; k < polygon.size(); ++k) {
          const Point &x = polygon[k], &y = polygon[(k + 1) % polygon.size()];
          const Real sx = side(x), sy = side(y);
          if (sx >= 0) clipped.push_back(x);
          if ((sx > 0 && sy < 0) || (sx < 0 && sy > 0)) {
            const Real t = sx / (sx - sy);
            clipped.push_back({x[0] + t * (y[0] - x[0]), x[1] + t * (y[1] - x[1]), x[2] + t * (y[2] - x[2])});
          }
        }
        polygon = clipped;
      }
      Real twice = 0;  // in the plane of the last two coordinates, where the whole facet has area 1/2
      for (std::size_t k = 2; k < polygon.size(); ++k) {
        twice += (polygon[k - 1][1] - polygon[0][1]) * (polygon[k][2] - polygon[0][2]) -
                 (polygon[k - 1][2] - polygon[0][2]) * (polygon[k][1] - polygon[0][1]);
      }
      areas[static_cast<std::size_t>(i)] += whole * twice;
    }
  }
  return areas;
}

/// Largest difference between the areas of the diagram and the oracle's, relative to the larger of the cell and a thousandth of
/// the mean one: rounding of a corner in space costs a tiny cell more than its share.
inline double worst_area_error(const Mesh& mesh, const Sites& sites, const Diagram& diagram) {
  const std::vector<Real> expected = brute_force_areas(mesh, sites);
  const std::vector<double> areas = diagram.cell_areas();
  REQUIRE(areas.size() == expected.size());
  const Real total = std::accumulate(expected.begin(), expected.end(), Real(0));
  Real worst = 0;
  for (std::size_t s = 0; s < areas.size(); ++s) {
    const Real scale = std::max(expected[s], Real(1e-3) * total / static_cast<Real>(areas.size()));
    worst = std::max(worst, std::fabs(areas[s] - expected[s]) / scale);
  }
  return static_cast<double>(worst);
}

/// Facet, site, labels and corner bits of all fragments, each polygon turned to begin with its least label.
struct Canonical {
  std::vector<Index> labels;
  std::vector<std::array<double, 3>> corners;
  bool operator==(const Canonical& other) const { return labels == other.labels && corners == other.corners; }
};
using CanonicalDiagram = std::map<std::pair<Index, Index>, Canonical>;

inline CanonicalDiagram canonical(const Diagram& diagram) {
  CanonicalDiagram result;
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    if (!diagram.alive(f)) continue;
    const Diagram::Polygon p = diagram.polygon(f);
    const auto start = static_cast<Index>(std::min_element(p.labels, p.labels + p.size) - p.labels);
    Canonical& entry = result[{p.facet, p.site}];
    for (Index k = 0; k < p.size; ++k) {
      const Index at = (start + k) % p.size;
      entry.labels.push_back(p.labels[at]);
      entry.corners.push_back({p.corners[at].x(), p.corners[at].y(), p.corners[at].z()});
    }
  }
  return result;
}

/// Equal as sets of fragments.
inline bool same_diagram(const Diagram& a, const Diagram& b) {
  return a.num_sites() == b.num_sites() && a.num_fragments() == b.num_fragments() && canonical(a) == canonical(b);
}

inline Diagram inserted_one_by_one(const Mesh& mesh, const Sites& sites, Index at_once = 1) {
  Diagram diagram(mesh, sites.positions.topRows(at_once), sites.weights.head(at_once));
  for (Index s = at_once; s < sites.size(); ++s) {
    REQUIRE(diagram.insert(sites.at(s), sites.weights[s], s % 3 == 0 ? kNone : s / 2) == s);
  }
  return diagram;
}

inline Index count_hidden(const Diagram& diagram) {
  Index hidden = 0;
  for (Index s = 0; s < diagram.num_sites(); ++s) hidden += !diagram.visible(s);
  return hidden;
}

/// All laws at once, for inputs with ties: whatever they are, one diagram comes out, and it is right.
inline void check_everything(const Mesh& mesh, const Sites& sites, double tolerance = 1e-12) {
  const Diagram diagram(mesh, sites.positions, sites.weights);
  CHECK(broken_law(mesh, diagram) == "");
  CHECK(worst_area_error(mesh, sites, diagram) <= tolerance);
  CHECK(same_diagram(diagram, inserted_one_by_one(mesh, sites)));
}

/// Integer points on the sphere |p|² = n.
inline std::vector<Vec3> integer_sphere(int n) {
  std::vector<Vec3> points;
  const int m = static_cast<int>(std::sqrt(n));
  for (int x = -m; x <= m; ++x) {
    for (int y = -m; y <= m; ++y) {
      for (int z = -m; z <= m; ++z) {
        if (x * x + y * y + z * z == n) points.emplace_back(x, y, z);
      }
    }
  }
  return points;
}

inline Mesh scaled(Mesh mesh, double factor, const Vec3& offset = Vec3::Zero()) {
  mesh.vertices *= factor;
  mesh.vertices.rowwise() += offset.transpose();
  return mesh;
}

inline ErrorCode error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    CHECK(std::string(error.what()).size() > 20);
    return error.code();
  }
  FAIL("no error was thrown");
  return ErrorCode::kInternal;
}

}  // namespace amps_test
