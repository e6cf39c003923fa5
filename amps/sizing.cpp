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

constexpr const char* kSizingStage = "making a sizing field";

std::shared_ptr<SizingLattice> make_simple_lattice(const MeshView& mesh, const Execution& execution) {
  require_usable(mesh, execution.part(0, 0.45));
  Mesh copy = mesh.copy();
  return detail::make_lattice(std::move(copy), facet_areas(mesh, execution.part(0.6, 1)), {}, execution);
}

bool same_mesh(const MeshView& a, const MeshView& b, const Execution& execution) {
  if (a.num_vertices() != b.num_vertices() || a.num_facets() != b.num_facets()) return false;
  bool same = true;
  detail::for_each_index(a.num_facets(), execution.part(0, 0.6),
                         [&](Index f) { same = same && a.triangles[f] == b.triangles[f]; });
  if (!same) return false;
  detail::for_each_index(a.num_vertices(), execution.part(0.6, 1),
                         [&](Index v) { same = same && a.vertices[v] == b.vertices[v]; });
  return same;
}

}  // namespace

SizingField::SizingField(std::shared_ptr<const SizingLattice> lattice, std::vector<double> nodes, const Execution& execution)
    : lattice_(std::move(lattice)), nodes_(std::make_shared<const std::vector<double>>(std::move(nodes))) {
  min_ = std::numeric_limits<double>::infinity();
  detail::for_each_index(lattice_->num_facets(), execution, [&](Index f) {
    if (!(lattice_->areas[slot(f)] > 0)) return;
    for (std::size_t n = lattice_->node(f); n < lattice_->node(f + 1); ++n) {
      min_ = std::min(min_, (*nodes_)[n]);
      max_ = std::max(max_, (*nodes_)[n]);
    }
  });
}

bool SizingField::fits(const MeshView& mesh, const Execution& execution) const {
  if (empty()) return false;
  const Execution job = execution.start("comparing meshes");
  const bool same = same_mesh(lattice_->mesh, mesh, job);
  job.finish();
  return same;
}

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

double SizingField::density_integral(const Execution& execution) const {
  const Execution job = execution.start("counting samples to be");
  double sum = 0;
  detail::for_each_index(num_pieces(), job, [&](std::size_t i) { sum += density_integral(i); });
  job.finish();
  return sum;
}

SizingField SizingField::scaled(double factor, const Execution& execution) const {
  const Execution job = execution.start(kSizingStage);
  if (!is_radius(factor)) refuse_sizing("the factor " + number_text(factor) + " is not positive and finite");
  std::vector<double> nodes = *nodes_;
  detail::for_each_index(nodes.size(), job.part(0, 0.5), [&](std::size_t n) {
    nodes[n] *= factor;
    if (!is_radius(nodes[n]))
      refuse_sizing("scaled by " + number_text(factor) + " a radius is no positive double; use a milder factor");
  });
  SizingField result(lattice_, std::move(nodes), job.part(0.5, 1));
  job.finish();
  return result;
}

SizingField SizingField::clamped(double lowest, double highest, const Execution& execution) const {
  const Execution job = execution.start(kSizingStage);
  if (!(is_radius(lowest) && lowest <= highest)) {
    refuse_sizing("cannot clamp to [" + number_text(lowest) + ", " + number_text(highest) + "]; give 0 < lowest <= highest");
  }
  std::vector<double> nodes = *nodes_;
  detail::for_each_index(nodes.size(), job.part(0, 0.5),
                         [&](std::size_t n) { nodes[n] = std::min(highest, std::max(lowest, nodes[n])); });
  SizingField result(lattice_, std::move(nodes), job.part(0.5, 1));
  job.finish();
  return result;
}

SizingField min(const SizingField& a, const SizingField& b, const Execution& execution) {
  if (a.empty() || b.empty()) refuse_sizing("minimum of an empty field; make both from the mesh");
  const auto& la = SizingFieldAccess::lattice(a);
  const auto& lb = SizingFieldAccess::lattice(b);
  const Execution job = execution.start(kSizingStage);
  if (la != lb && !same_mesh(la->mesh, lb->mesh, job.part(0, 0.2)))
    refuse_sizing("minimum of fields of different meshes; make both from one mesh");
  std::shared_ptr<const SizingLattice> lattice = la;
  if (!lb->simple()) {
    std::vector<std::uint8_t> levels(slot(la->num_facets()));
    for (Index f = 0; f < la->num_facets(); ++f)
      levels[slot(f)] = static_cast<std::uint8_t>(std::max(la->level(f), lb->level(f)));
    if (levels == lb->levels) {
      lattice = lb;
    } else if (levels != la->levels) {
      lattice = detail::make_lattice(la->mesh, la->areas, std::move(levels), job.part(0.2, 0.4));
    }
  }
  std::vector<double> nodes(lattice->num_nodes());
  detail::for_each_index(lattice->num_facets(), job.part(0.4, 0.9), [&](Index f) {
    const Index k = lattice->k(f);
    double* out = nodes.data() + lattice->node(f);
    for (Index j = 0; j <= k; ++j) {
      for (Index i = 0; i + j <= k; ++i) {
        const Vec3 at = detail::lattice_barycentric(k, i, j);
        *out++ = std::min(a.radius(f, at), b.radius(f, at));
      }
    }
  });
  SizingField result = SizingFieldAccess::make(std::move(lattice), std::move(nodes), job.part(0.9, 1));
  job.finish();
  return result;
}

namespace {

struct RadiusShare {
  double radius, area;
  bool operator<(const RadiusShare& other) const { return radius != other.radius ? radius < other.radius : area < other.area; }
};

/// The first radius in ascending order at which the areas so far exceed `limit`. Sorts no more of the shares than it takes.
double radius_at_area(std::vector<RadiusShare>& shares, double limit, const Execution& execution) {
  detail::Ticker ticker(execution, 8 * shares.size(), detail::kElementsPerLook);
  const auto before = [&ticker](const RadiusShare& a, const RadiusShare& b) {
    ticker.tick();
    return a < b;
  };
  const auto at = [&shares](std::size_t i) { return shares.begin() + static_cast<std::ptrdiff_t>(i); };
  constexpr std::size_t kFirstPart = 32;  // of all; where a quantile is asked for that is small, as it mostly is, one will do
  double below = 0;
  for (std::size_t from = 0, size = shares.size() / kFirstPart + 1; from < shares.size(); size *= 2) {
    const std::size_t to = std::min(from + size, shares.size());
    if (to < shares.size()) std::nth_element(at(from), at(to), shares.end(), before);
    std::sort(at(from), at(to), before);
    for (; from < to; ++from) {
      below += shares[from].area;
      if (below > limit) return shares[from].radius;
    }
  }
  return shares.back().radius;
}

}  // namespace

SizingField SizingField::with_ratio(double ratio, double quantile, const Execution& execution) const {
  const Execution job = execution.start(kSizingStage);
  if (!(ratio >= 1)) refuse_sizing("the ratio " + number_text(ratio) + " of the largest to the smallest radius is below 1");
  if (!(quantile >= 0 && quantile < 1)) refuse_sizing("the quantile " + number_text(quantile) + " is not in [0, 1)");
  std::vector<RadiusShare> shares;
  shares.reserve(num_pieces());
  double total = 0;
  detail::for_each_index(num_pieces(), job.part(0, 0.5), [&](std::size_t i) {
    const Piece p = piece(i);
    const double k = lattice_->k(p.facet), area = lattice_->areas[slot(p.facet)] / (k * k);
    if (!(area > 0)) return;
    shares.push_back({(p.radii[0] + p.radii[1] + p.radii[2]) / 3, area});
    total += area;
  });
  const double smallest = quantile == 0 ? min_ : radius_at_area(shares, quantile * total, job.part(0.5, 0.65));
  return clamped(smallest, ratio * smallest, job.part(0.65, 1));
}

double count_factor(const SizingField& field, double count, const Execution& execution) {
  if (field.empty()) refuse_sizing("number of samples of an empty field; make it from a mesh");
  if (!(count >= 1 && std::isfinite(count)))
    refuse_sizing("cannot place " + number_text(count) + " samples; ask for one at least");
  return std::sqrt(kSamplesPerDensity * field.density_integral(execution) / count);
}

SizingField uniform_sizing(const MeshView& mesh, double radius, const Execution& execution) {
  if (!is_radius(radius)) refuse_sizing("the radius " + number_text(radius) + " is not positive and finite");
  const Execution job = execution.start(kSizingStage);
  auto lattice = make_simple_lattice(mesh, job.part(0, 0.9));
  const std::size_t n = lattice->num_nodes();
  SizingField result = SizingFieldAccess::make(std::move(lattice), std::vector<double>(n, radius), job.part(0.9, 1));
  job.finish();
  return result;
}

SizingField vertex_sizing(const MeshView& mesh, const ValuesView& radii, const Execution& execution) {
  const Execution job = execution.start(kSizingStage);
  auto lattice = make_simple_lattice(mesh, job.part(0, 0.7));
  if (radii.size() != mesh.num_vertices()) {
    refuse_sizing(std::to_string(radii.size()) + " values for " + std::to_string(mesh.num_vertices()) +
                  " vertices; give one a vertex");
  }
  std::vector<double> nodes(lattice->num_nodes());
  detail::for_each_index(mesh.num_facets(), job.part(0.7, 0.9), [&](Index f) {
    for (int k = 0; k < 3; ++k) {
      const Index v = mesh.triangles(f, k);
      if (!is_radius(radii[v])) {
        refuse_sizing("the radius " + number_text(radii[v]) + " of vertex " + std::to_string(v) +
                      " (0-based) is not positive and finite; correct it");
      }
      nodes[3 * slot(f) + slot(k)] = radii[v];
    }
  });
  SizingField result = SizingFieldAccess::make(std::move(lattice), std::move(nodes), job.part(0.9, 1));
  job.finish();
  return result;
}

SizingField vertex_density_sizing(const MeshView& mesh, const ValuesView& densities, const Execution& execution) {
  const Execution job = execution.start(kSizingStage);
  require_usable(mesh, job.part(0, 0.25));
  std::vector<double> radii;
  for (std::ptrdiff_t v = 0; v < densities.size(); ++v) radii.push_back(1 / std::sqrt(densities[v]));
  const Index to_check = densities.size() == mesh.num_vertices() ? mesh.num_facets() : 0;
  detail::for_each_index(to_check, job.part(0.25, 0.4), [&](Index f) {
    for (int k = 0; k < 3; ++k) {
      const Index v = mesh.triangles(f, k);
      if (is_radius(densities[v]) && is_radius(radii[slot(v)])) continue;
      refuse_sizing("the density " + number_text(densities[v]) + " of vertex " + std::to_string(v) +
                    " (0-based) is not positive and finite; correct it");
    }
  });
  return vertex_sizing(mesh, radii, job.part(0.4, 1));
}

namespace detail {
namespace {

/// Tabulates a function facet by facet.
class Tabulator {
 public:
  Tabulator(const MeshView& mesh, const SizingFunction& radius, const TabulationOptions& options, const Execution& execution)
      : mesh_(mesh),
        radius_(radius),
        options_(options),
        execution_(execution),
        areas_(facet_areas(mesh, execution.part(0, kAreasShare))) {
    levels_.assign(areas_.size(), 0);
    nodes_.reserve(3 * areas_.size());
    at_vertex_.assign(slot(mesh.num_vertices()), 0.0);
  }

  SizingField run() {
    for_each_index(mesh_.num_facets(), execution_.part(kAreasShare, kTabulated), [&](Index f) { tabulate(f); });
    const Execution last = execution_.part(kTabulated, 1);
    Mesh copy = mesh_.copy();
    auto lattice = make_lattice(std::move(copy), std::move(areas_), std::move(levels_), last.part(0.2, 0.7));
    return SizingFieldAccess::make(std::move(lattice), std::move(nodes_), last.part(0.7, 1));
  }

 private:
  static constexpr double kAreasShare = 0.1, kTabulated = 0.9;  ///< of the time
  static constexpr int kLastLevel = 14;

  /// Between facets and within large ones.
  void look() const {
    execution_.report(kAreasShare + (kTabulated - kAreasShare) * static_cast<double>(now_at_) / mesh_.num_facets());
  }

  double call(Index facet, const Vec3& b) {
    constexpr unsigned kCallsPerLook = 16;  // up to some milliseconds each
    if (++calls_ % kCallsPerLook == 0) look();
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
    if (first_side_.empty()) {
      first_side_ = first_sides(mesh_.triangles, mesh_.num_vertices(), execution_.part(0, 0));
    }
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
    now_at_ = f;
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
    return std::max({norm(b - a), norm(c - b), norm(a - c)});
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
      if (t % kElementsPerLook == kElementsPerLook - 1) look();
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
  bool centroids_agree(Index f, Index k) {
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
  const Execution& execution_;
  Index now_at_ = 0;  ///< facet
  unsigned calls_ = 0;
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
  const Execution job = execution.start(kSizingStage);
  require_usable(mesh, job.part(0, 0.1));
  if (!radius) refuse_sizing("no function given");
  if (!(options.tolerance > 0 && options.finest > 0)) refuse_sizing("tolerance and finest must be positive");
  const Execution tabulation = job.part(0.1, 1);
  SizingField result = detail::Tabulator(mesh, radius, options, tabulation).run();
  job.finish();
  return result;
}

}  // namespace amps
