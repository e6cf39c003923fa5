#define AMPS_OWN_SOURCE
#include "amps/sizing.h"

#include "amps/sizing_lattice.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace amps {
namespace {

using detail::is_radius;
using detail::number_text;
using detail::refuse_sizing;
using detail::SizingFieldAccess;
using detail::SizingLattice;
using detail::slot;

std::shared_ptr<SizingLattice> make_simple_lattice(const MeshView& mesh) {
  require_usable(mesh);
  return detail::make_lattice(mesh.copy(), facet_areas(mesh), {});
}

bool same_mesh(const MeshView& a, const MeshView& b) {
  return a.num_vertices() == b.num_vertices() && a.num_facets() == b.num_facets() && a.triangles == b.triangles &&
         a.vertices == b.vertices;
}

}  // namespace

SizingField::SizingField(std::shared_ptr<const SizingLattice> lattice, std::vector<double> nodes)
    : lattice_(std::move(lattice)), nodes_(std::make_shared<const std::vector<double>>(std::move(nodes))) {
  min_ = std::numeric_limits<double>::infinity();
  for (Index f = 0; f < lattice_->num_facets(); ++f) {
    if (!(lattice_->areas[slot(f)] > 0)) continue;
    for (std::size_t n = lattice_->node(f); n < lattice_->node(f + 1); ++n) {
      min_ = std::min(min_, (*nodes_)[n]);
      max_ = std::max(max_, (*nodes_)[n]);
    }
  }
}

bool SizingField::fits(const MeshView& mesh) const { return !empty() && same_mesh(lattice_->mesh, mesh); }

Index SizingField::num_facets() const { return lattice_->num_facets(); }

double SizingField::radius(Index facet, const Vec3& barycentric) const {
  return detail::interpolate_lattice(nodes_->data() + lattice_->node(facet), lattice_->k(facet), barycentric);
}

std::size_t SizingField::num_pieces() const { return lattice_->num_pieces(); }

std::size_t SizingField::first_piece(Index facet) const { return lattice_->piece(facet); }

SizingField::Piece SizingField::piece(std::size_t i) const {
  Piece result;
  result.facet = lattice_->simple() ? static_cast<Index>(i) : lattice_->piece_facet[i];
  const Index k = lattice_->k(result.facet);
  const detail::LatticeTriangle triangle = detail::nth_lattice_triangle(k, i - lattice_->piece(result.facet));
  for (std::size_t c = 0; c < 3; ++c) {
    const auto [x, y] = triangle.corner[c];
    result.corners[c] = detail::lattice_barycentric(k, x, y);
    result.radii[c] = (*nodes_)[lattice_->node(result.facet) + detail::lattice_node(k, x, y)];
  }
  return result;
}

double SizingField::density_integral(std::size_t i) const {
  const Piece p = piece(i);
  const double k = lattice_->k(p.facet), area = lattice_->areas[slot(p.facet)] / (k * k);
  return area > 0 ? area * detail::mean_inverse_square(p.radii) : 0.0;
}

double SizingField::density_integral() const {
  double sum = 0;
  for (std::size_t i = 0; i < num_pieces(); ++i) sum += density_integral(i);
  return sum;
}

SizingField SizingField::scaled(double factor) const {
  if (!is_radius(factor)) refuse_sizing("the factor " + number_text(factor) + " is not positive and finite");
  std::vector<double> nodes = *nodes_;
  for (double& r : nodes) {
    r *= factor;
    if (!is_radius(r))
      refuse_sizing("scaled by " + number_text(factor) + " a radius is no positive double; use a milder factor");
  }
  return {lattice_, std::move(nodes)};
}

SizingField SizingField::clamped(double lowest, double highest) const {
  if (!(is_radius(lowest) && lowest <= highest)) {
    refuse_sizing("cannot clamp to [" + number_text(lowest) + ", " + number_text(highest) + "]; give 0 < lowest <= highest");
  }
  std::vector<double> nodes = *nodes_;
  for (double& r : nodes) r = std::min(highest, std::max(lowest, r));
  return {lattice_, std::move(nodes)};
}

SizingField min(const SizingField& a, const SizingField& b) {
  if (a.empty() || b.empty()) refuse_sizing("minimum of an empty field; make both from the mesh");
  const auto& la = SizingFieldAccess::lattice(a);
  const auto& lb = SizingFieldAccess::lattice(b);
  if (la != lb && !same_mesh(la->mesh, lb->mesh))
    refuse_sizing("minimum of fields of different meshes; make both from one mesh");
  std::shared_ptr<const SizingLattice> lattice = la;
  if (!lb->simple()) {
    std::vector<std::uint8_t> levels(slot(la->num_facets()));
    for (Index f = 0; f < la->num_facets(); ++f)
      levels[slot(f)] = static_cast<std::uint8_t>(std::max(la->level(f), lb->level(f)));
    if (levels == lb->levels) {
      lattice = lb;
    } else if (levels != la->levels) {
      lattice = detail::make_lattice(la->mesh, la->areas, std::move(levels));
    }
  }
  std::vector<double> nodes(lattice->num_nodes());
  for (Index f = 0; f < lattice->num_facets(); ++f) {
    const Index k = lattice->k(f);
    double* out = nodes.data() + lattice->node(f);
    for (Index j = 0; j <= k; ++j) {
      for (Index i = 0; i + j <= k; ++i) {
        const Vec3 at = detail::lattice_barycentric(k, i, j);
        *out++ = std::min(a.radius(f, at), b.radius(f, at));
      }
    }
  }
  return SizingFieldAccess::make(std::move(lattice), std::move(nodes));
}

SizingField SizingField::with_ratio(double ratio, double quantile) const {
  if (!(ratio >= 1)) refuse_sizing("the ratio " + number_text(ratio) + " of the largest to the smallest radius is below 1");
  if (!(quantile >= 0 && quantile < 1)) refuse_sizing("the quantile " + number_text(quantile) + " is not in [0, 1)");
  struct Share {
    double radius, area;
  };
  std::vector<Share> shares;
  double total = 0;
  for (std::size_t i = 0; i < num_pieces(); ++i) {
    const Piece p = piece(i);
    const double k = lattice_->k(p.facet), area = lattice_->areas[slot(p.facet)] / (k * k);
    if (!(area > 0)) continue;
    shares.push_back({(p.radii[0] + p.radii[1] + p.radii[2]) / 3, area});
    total += area;
  }
  std::sort(shares.begin(), shares.end(),
            [](const Share& a, const Share& b) { return a.radius != b.radius ? a.radius < b.radius : a.area < b.area; });
  double below = 0, smallest = shares.front().radius;
  for (const Share& share : shares) {
    smallest = share.radius;
    below += share.area;
    if (below > quantile * total) break;
  }
  if (quantile == 0) smallest = min_;
  return clamped(smallest, ratio * smallest);
}

double count_factor(const SizingField& field, double count) {
  if (field.empty()) refuse_sizing("number of samples of an empty field; make it from a mesh");
  if (!(count >= 1 && std::isfinite(count)))
    refuse_sizing("cannot place " + number_text(count) + " samples; ask for one at least");
  return std::sqrt(kSamplesPerDensity * field.density_integral() / count);
}

SizingField uniform_sizing(const MeshView& mesh, double radius) {
  if (!is_radius(radius)) refuse_sizing("the radius " + number_text(radius) + " is not positive and finite");
  auto lattice = make_simple_lattice(mesh);
  const std::size_t n = lattice->num_nodes();
  return SizingFieldAccess::make(std::move(lattice), std::vector<double>(n, radius));
}

SizingField vertex_sizing(const MeshView& mesh, const ValuesView& radii) {
  auto lattice = make_simple_lattice(mesh);
  if (radii.size() != mesh.num_vertices()) {
    refuse_sizing(std::to_string(radii.size()) + " values for " + std::to_string(mesh.num_vertices()) +
                  " vertices; give one a vertex");
  }
  std::vector<double> nodes(lattice->num_nodes());
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index v = mesh.triangles(f, k);
      if (!is_radius(radii[v])) {
        refuse_sizing("the radius " + number_text(radii[v]) + " of vertex " + std::to_string(v) +
                      " (0-based) is not positive and finite; correct it");
      }
      nodes[3 * slot(f) + slot(k)] = radii[v];
    }
  }
  return SizingFieldAccess::make(std::move(lattice), std::move(nodes));
}

SizingField vertex_density_sizing(const MeshView& mesh, const ValuesView& densities) {
  require_usable(mesh);
  std::vector<double> radii;
  for (std::ptrdiff_t v = 0; v < densities.size(); ++v) radii.push_back(1 / std::sqrt(densities[v]));
  for (Index f = 0; f < mesh.num_facets() && densities.size() == mesh.num_vertices(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const Index v = mesh.triangles(f, k);
      if (is_radius(densities[v]) && is_radius(radii[slot(v)])) continue;
      refuse_sizing("the density " + number_text(densities[v]) + " of vertex " + std::to_string(v) +
                    " (0-based) is not positive and finite; correct it");
    }
  }
  return vertex_sizing(mesh, radii);
}

namespace detail {
namespace {

/// Tabulates a function facet by facet.
class Tabulator {
 public:
  Tabulator(const MeshView& mesh, const SizingFunction& radius, const TabulationOptions& options, Execution execution)
      : mesh_(mesh), radius_(radius), options_(options), run_(std::move(execution)), areas_(facet_areas(mesh)) {
    levels_.assign(areas_.size(), 0);
    nodes_.reserve(3 * areas_.size());
    at_vertex_.assign(slot(mesh.num_vertices()), 0.0);
  }

  SizingField run() {
    Ticker ticker(run_, areas_.size());
    for (Index f = 0; f < mesh_.num_facets(); ++f) {
      tabulate(f);
      ticker.tick();
    }
    return SizingFieldAccess::make(make_lattice(mesh_.copy(), std::move(areas_), std::move(levels_)), std::move(nodes_));
  }

 private:
  static constexpr int kLastLevel = 14;

  double call(Index facet, const Vec3& b) const {
    run_.check();  // a facet may have many nodes, and a node take long
    SurfacePoint at{facet, b, Vec3::Zero()};
    at.position = b[0] * mesh_.corner(facet, 0) + b[1] * mesh_.corner(facet, 1) + b[2] * mesh_.corner(facet, 2);
    const double r = radius_(at);
    if (is_radius(r)) return r;
    const auto list = [](const Vec3& v) {
      return "(" + number_text(v[0]) + ", " + number_text(v[1]) + ", " + number_text(v[2]) + ")";
    };
    refuse_sizing("the function gives the radius " + number_text(r) + " at " + list(at.position) + ", barycentrics " + list(b) +
                  " of facet " + std::to_string(facet) + " (0-based); it must be positive and finite everywhere");
  }

  double at_corner(Index f, int k) {
    double& value = at_vertex_[slot(mesh_.triangles(f, k))];
    if (value == 0) value = call(f, Vec3::Unit(k));
    return value;
  }

  double at_node(Index f, Index k, Index i, Index j) {
    const PlaceOnSide place = place_on_side(k, i, j);
    if (place.side < 0) return call(f, lattice_barycentric(k, i, j));
    if (place.steps == 0) return at_corner(f, place.side);
    if (first_side_.empty()) first_side_ = first_sides(mesh_.triangles, mesh_.num_vertices());
    const std::size_t first = first_side_[3 * slot(f) + slot(place.side)];
    const auto owner = static_cast<Index>(first / 3);
    const int side = static_cast<int>(first % 3);
    const bool same = mesh_.triangles(owner, side) == mesh_.triangles(f, place.side);
    const double along = static_cast<double>(same ? place.steps : k - place.steps) / k;
    Vec3 b = Vec3::Zero();
    b[side] = 1 - along;
    b[(side + 1) % 3] = along;
    return call(owner, b);
  }

  void tabulate(Index f) {
    std::vector<double>& now = now_;
    now.assign({at_corner(f, 0), at_corner(f, 1), at_corner(f, 2)});
    int level = 0;
    if (areas_[slot(f)] > 0) {
      const double edge = longest_edge(f);
      // The first lattice has edges of an eighth, or of twice the radius.
      while (fineness(edge, level) > 2 && level < 3) refine(f, level++);
      while (fineness(edge, level) > options_.finest && worth_refining(f, level)) {
        coarse_ = now;
        const bool agreed = refine(f, level) && centroids_agree(f, Index{1} << level);
        if (agreed) {
          now.swap(coarse_);
          break;
        }
        ++level;
      }
    }
    levels_[slot(f)] = static_cast<std::uint8_t>(level);
    nodes_.insert(nodes_.end(), now.begin(), now.end());
  }

  double longest_edge(Index f) const {
    const Vec3 a = mesh_.corner(f, 0), b = mesh_.corner(f, 1), c = mesh_.corner(f, 2);
    return std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
  }
  /// Lattice edges in units of the smallest radius.
  double fineness(double edge, int level) const {
    return std::ldexp(edge, -level) / *std::min_element(now_.begin(), now_.end());
  }
  /// False where lattice triangles outnumber what samples justify: large needles, functions with jumps.
  bool worth_refining(Index f, int level) const {
    const Index k = Index{1} << level;
    const std::size_t pieces = slot(k) * slot(k);
    double sum = 0;
    for (std::size_t t = 0; t < pieces; ++t) {
      const LatticeTriangle triangle = nth_lattice_triangle(k, t);
      std::array<double, 3> radii;
      for (std::size_t c = 0; c < 3; ++c) radii[c] = now_[lattice_node(k, triangle.corner[c][0], triangle.corner[c][1])];
      sum += mean_inverse_square(radii);
    }
    const double samples = kSamplesPerDensity * areas_[slot(f)] * sum / static_cast<double>(pieces);
    return level < kLastLevel && 4 * static_cast<double>(pieces) <= 16 * samples + 64;
  }

  /// Doubles k in now_; true if the new values are what interpolation says.
  bool refine(Index f, int level) {
    const Index k = Index{1} << level, fine = 2 * k;
    if (nodes_.size() + nodes_of_lattice(fine) > options_.max_nodes) {
      throw Error(ErrorCode::kTooLarge, "sizing: the function needs more than " + std::to_string(options_.max_nodes) +
                                            " lattice nodes; give larger radii or a larger tolerance");
    }
    const std::vector<double> old = now_;
    const auto at = [&](Index i, Index j) { return old[lattice_node(k, i, j)]; };
    now_.clear();
    bool agreed = true;
    for (Index j = 0; j <= fine; ++j) {
      for (Index i = 0; i + j <= fine; ++i) {
        if (i % 2 == 0 && j % 2 == 0) {
          now_.push_back(at(i / 2, j / 2));
          continue;
        }
        // The ends of the lattice edge that this node is the middle of.
        const Index di = i % 2, dj = i % 2 == 0 ? 1 : j % 2 == 0 ? 0 : -1;
        const double linear = (at((i + di) / 2, (j + dj) / 2) + at((i - di) / 2, (j - dj) / 2)) / 2;
        now_.push_back(at_node(f, fine, i, j));
        agreed = agreed && std::abs(now_.back() - linear) <= options_.tolerance * now_.back();
      }
    }
    return agreed;
  }

  /// The same at the centroids of the lattice in coarse_.
  bool centroids_agree(Index f, Index k) const {
    for (std::size_t t = 0; t < slot(k) * slot(k); ++t) {
      const LatticeTriangle triangle = nth_lattice_triangle(k, t);
      Vec3 b = Vec3::Zero();
      double linear = 0;
      for (const auto& corner : triangle.corner) {
        b += lattice_barycentric(k, corner[0], corner[1]) / 3;
        linear += coarse_[lattice_node(k, corner[0], corner[1])] / 3;
      }
      const double r = call(f, b);
      if (!(std::abs(r - linear) <= options_.tolerance * r)) return false;
    }
    return true;
  }

  const MeshView& mesh_;
  const SizingFunction& radius_;
  const TabulationOptions& options_;
  const Execution run_;
  std::vector<double> areas_;
  std::vector<std::uint8_t> levels_;
  std::vector<double> nodes_;
  std::vector<double> at_vertex_;        ///< 0: not called yet
  std::vector<std::size_t> first_side_;  ///< empty until a facet has a lattice
  std::vector<double> now_, coarse_;     ///< the facet's lattice, and the one before
};

}  // namespace
}  // namespace detail

SizingField function_sizing(const MeshView& mesh, const SizingFunction& radius, const TabulationOptions& options,
                            const Execution& execution) {
  require_usable(mesh);
  if (!radius) refuse_sizing("no function given");
  if (!(options.tolerance > 0 && options.finest > 0)) refuse_sizing("tolerance and finest must be positive");
  const Execution run = execution.start("tabulating radii");
  SizingField result = detail::Tabulator(mesh, radius, options, run).run();
  run.finish();
  return result;
}

}  // namespace amps
