// diagrams.h: the laws that every restricted power diagram obeys, an oracle for its areas, and equality of diagrams.
#pragma once

#include "meshes.h"
#include "sites.h"

#include "amps/power_diagram.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps_test {

using Diagram = amps::RestrictedPowerDiagram;

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
  const Vec3 a = view.corner(facet, 0), b = view.corner(facet, 1), c = view.corner(facet, 2);
  return amps::collinear(a.data(), b.data(), c.data());
}

/// Flags of facets that an earlier one is, by positions in any order. Corners of degenerate facets may be equal; they are none.
inline std::vector<char> repeated_facets(const Mesh& mesh) {
  std::set<std::array<std::array<double, 3>, 3>> seen;
  std::vector<char> repeated(at(rows(mesh.triangles)), 0);
  for (Index f = 0; f < rows(mesh.triangles); ++f) {
    if (is_degenerate(mesh, f)) continue;
    std::array<std::array<double, 3>, 3> corners;
    for (int k = 0; k < 3; ++k) {
      const Vec3 x = MeshView(mesh).corner(f, k);
      corners[at(k)] = {x.x() + 0.0, x.y() + 0.0, x.z() + 0.0};
    }
    std::sort(corners.begin(), corners.end());
    repeated[at(f)] = seen.insert(corners).second ? 0 : 1;
  }
  return repeated;
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
  const std::vector<char> repeated = repeated_facets(mesh);
  Index fragments = 0, listed_triangles = 0;
  std::vector<Index> of_site(static_cast<std::size_t>(diagram.num_sites()), 0);
  for (Index facet = 0; facet < mesh.triangles.rows(); ++facet) {
    const std::string where = " on facet " + std::to_string(facet);
    if (is_degenerate(mesh, facet) || repeated[at(facet)] != 0) {
      if (diagram.first_of_facet(facet) != kNone) return "a facet without area, or there already, has fragments:" + where;
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
  const std::vector<char> repeated = repeated_facets(mesh);
  for (Index facet = 0; facet < mesh.triangles.rows(); ++facet) {
    if (is_degenerate(mesh, facet) || repeated[at(facet)] != 0) continue;
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

/// Labels and corner bits of a fragment, turned to begin with its least label.
struct Canonical {
  std::vector<Index> labels;
  std::vector<std::array<double, 3>> corners;
  bool operator==(const Canonical& other) const { return labels == other.labels && corners == other.corners; }
};
using CanonicalDiagram = std::map<std::pair<Index, Index>, Canonical>;  ///< by facet and site

/// All fragments, with sites named `name[s]`.
inline CanonicalDiagram canonical(const Diagram& diagram, const std::vector<Index>& name) {
  CanonicalDiagram result;
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    if (!diagram.alive(f)) continue;
    const Diagram::Polygon p = diagram.polygon(f);
    std::vector<Index> labels(p.labels, p.labels + p.size);
    for (Index& label : labels) {
      if (Diagram::is_site(label)) label = name[at(label)];
    }
    const auto start = static_cast<std::size_t>(std::min_element(labels.begin(), labels.end()) - labels.begin());
    Canonical& entry = result[{p.facet, name[at(p.site)]}];
    for (std::size_t k = 0; k < labels.size(); ++k) {
      const std::size_t from = (start + k) % labels.size();
      entry.labels.push_back(labels[from]);
      entry.corners.push_back({p.corners[from].x(), p.corners[from].y(), p.corners[from].z()});
    }
  }
  return result;
}

inline CanonicalDiagram canonical(const Diagram& diagram) { return canonical(diagram, all_indices(diagram.num_sites())); }

/// One fragment as it lies in its slot.
inline Canonical unturned(const Diagram::Polygon& p) {
  Canonical result;
  result.labels.assign(p.labels, p.labels + p.size);
  for (Index k = 0; k < p.size; ++k) result.corners.push_back({p.corners[k].x(), p.corners[k].y(), p.corners[k].z()});
  return result;
}

/// All fragments by slot: facet and site, labels and corners.
inline std::map<Index, std::pair<std::pair<Index, Index>, Canonical>> snapshot(const Diagram& diagram) {
  std::map<Index, std::pair<std::pair<Index, Index>, Canonical>> result;
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    if (!diagram.alive(f)) continue;
    const Diagram::Polygon p = diagram.polygon(f);
    result[f] = {{p.facet, p.site}, unturned(p)};
  }
  return result;
}

/// Equal as sets of fragments.
inline bool same_diagram(const Diagram& a, const Diagram& b) {
  return a.num_sites() == b.num_sites() && a.num_fragments() == b.num_fragments() && canonical(a) == canonical(b);
}

inline Diagram inserted_one_by_one(const Mesh& mesh, const Sites& sites, Index at_once = 1) {
  const Sites begin = head(sites, at_once);
  Diagram diagram(mesh, begin.positions, begin.weights);
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

}  // namespace amps_test
