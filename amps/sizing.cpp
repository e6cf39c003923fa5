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

/// `scale`: in whose unit a is.
bool same_mesh(const MeshView& a, const detail::MeshScale& scale, const MeshView& b, const Execution& execution) {
  if (a.num_vertices() != b.num_vertices() || a.num_facets() != b.num_facets()) return false;
  bool same = true;
  detail::for_each_index(a.num_facets(), execution.part(0, 0.6),
                         [&](Index f) { same = same && a.triangles[f] == b.triangles[f]; });
  if (!same) return false;
  detail::for_each_index(a.num_vertices(), execution.part(0.6, 1),
                         [&](Index v) { same = same && a.vertices[v] == scale.point(b.vertices[v]); });
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
  const bool same = same_mesh(lattice_->mesh, scale_, mesh, job);
  job.finish();
  return same;
}

Index SizingField::num_facets() const { return lattice_->num_facets(); }

double SizingField::radius(Index facet, const Vec3& barycentric) const {
  return scale_.length_back(
      detail::interpolate_lattice(nodes_->data() + lattice_->node(facet), lattice_->k(facet), barycentric));
}

std::size_t SizingField::num_pieces() const { return lattice_->num_pieces(); }

std::size_t SizingField::first_piece(Index facet) const { return lattice_->piece(facet); }

SizingField::Piece SizingField::piece(std::size_t i) const {
  Piece result = scaled_piece(i);
  for (double& radius : result.radii) scale_.back(radius);
  return result;
}

SizingField::Piece SizingField::scaled_piece(std::size_t i) const {
  Piece result;
  result.facet = lattice_->simple() ? static_cast<Index>(i) : lattice_->piece_facet[i];
  const Index k = lattice_->k(result.facet);
  if (k == 1) {
    const double* const nodes = nodes_->data() + lattice_->node(result.facet);
    result.corners = {Vec3::UnitX(), Vec3::UnitY(), Vec3::UnitZ()};
    result.radii = {nodes[0], nodes[1], nodes[2]};
    return result;
  }
  const detail::LatticeTriangle triangle = detail::nth_lattice_triangle(k, i - lattice_->piece(result.facet));
  for (std::size_t c = 0; c < 3; ++c) {
    const auto [x, y] = triangle.corner[c];
    result.corners[c] = detail::lattice_barycentric(k, x, y);
    result.radii[c] = (*nodes_)[lattice_->node(result.facet) + detail::lattice_node(k, x, y)];
  }
  return result;
}

double SizingField::density_integral(std::size_t i) const {
  const Index facet = lattice_->simple() ? static_cast<Index>(i) : lattice_->piece_facet[i];
  const Index k = lattice_->k(facet);
  const double area = lattice_->areas[slot(facet)] / (static_cast<double>(k) * k);
  if (!(area > 0)) return 0;
  const double* nodes = nodes_->data() + lattice_->node(facet);
  if (k == 1) return area * detail::mean_inverse_square({nodes[0], nodes[1], nodes[2]});
  const detail::LatticeTriangle triangle = detail::nth_lattice_triangle(k, i - lattice_->piece(facet));
  std::array<double, 3> radii;
  for (std::size_t c = 0; c < 3; ++c) radii[c] = nodes[detail::lattice_node(k, triangle.corner[c][0], triangle.corner[c][1])];
  return area * detail::mean_inverse_square(radii);
}

double SizingField::density_integral(const Execution& execution) const {
  const Execution job = execution.start("counting samples to be");
  // Parts are summed in the order of pieces, whatever the number of threads.
  constexpr std::size_t kPiecesAtOnce = std::size_t{1} << 18;
  std::vector<double> parts(std::min(kPiecesAtOnce, num_pieces()));
  double sum = 0;
  const auto share = [&](std::size_t i) { return static_cast<double>(i) / static_cast<double>(num_pieces()); };
  for (std::size_t begin = 0; begin < num_pieces(); begin += kPiecesAtOnce) {
    const std::size_t end = std::min(begin + kPiecesAtOnce, num_pieces());
    detail::for_each_index_on_all_threads(end - begin, job.part(share(begin), share(end)),
                                          [&](std::size_t i) { parts[i] = density_integral(begin + i); });
    for (std::size_t i = begin; i < end; ++i) sum += parts[i - begin];
  }
  job.finish();
  return sum;
}

SizingField SizingField::scaled(double factor, const Execution& execution) const {
  const Execution job = execution.start(kSizingStage);
  if (!is_radius(factor)) refuse_sizing("the factor " + number_text(factor) + " is not positive and finite");
  std::vector<double> nodes = *nodes_;
  detail::for_each_index(nodes.size(), job.part(0, 0.5), [&](std::size_t n) {
    nodes[n] *= factor;
    if (!is_radius(scale_.length_back(nodes[n])))
      refuse_sizing("scaled by " + number_text(factor) + " a radius is no positive double; use a milder factor");
  });
  SizingField result(lattice_, std::move(nodes), job.part(0.5, 1));
  result.scale_ = scale_;
  job.finish();
  return result;
}

SizingField SizingField::clamped(double lowest, double highest, const Execution& execution) const {
  const Execution job = execution.start(kSizingStage);
  if (!(is_radius(lowest) && lowest <= highest)) {
    refuse_sizing("cannot clamp to [" + number_text(lowest) + ", " + number_text(highest) + "]; give 0 < lowest <= highest");
  }
  std::vector<double> nodes = *nodes_;
  const double low = scale_.length(lowest), high = scale_.length(highest);
  detail::for_each_index(nodes.size(), job.part(0, 0.5),
                         [&](std::size_t n) { nodes[n] = std::min(high, std::max(low, nodes[n])); });
  SizingField result(lattice_, std::move(nodes), job.part(0.5, 1));
  result.scale_ = scale_;
  job.finish();
  return result;
}

SizingField min(const SizingField& a, const SizingField& b, const Execution& execution) {
  if (a.empty() || b.empty()) refuse_sizing("minimum of an empty field; make both from the mesh");
  const auto& la = SizingFieldAccess::lattice(a);
  const auto& lb = SizingFieldAccess::lattice(b);
  const Execution job = execution.start(kSizingStage);
  const detail::MeshScale& scale = SizingFieldAccess::scale(a);
  const bool same_scale = SizingFieldAccess::scale(b).in(scale).is_one();
  if (!same_scale || (la != lb && !same_mesh(la->mesh, {}, lb->mesh, job.part(0, 0.2))))
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
        *out++ = scale.length(std::min(a.radius(f, at), b.radius(f, at)));
      }
    }
  });
  SizingField result = SizingFieldAccess::make(std::move(lattice), std::move(nodes), job.part(0.9, 1));
  job.finish();
  return SizingFieldAccess::of_scale(std::move(result), scale);
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
    const Piece p = scaled_piece(i);
    const double k = lattice_->k(p.facet), area = lattice_->areas[slot(p.facet)] / (k * k);
    if (!(area > 0)) return;
    shares.push_back({(p.radii[0] + p.radii[1] + p.radii[2]) / 3, area});
    total += area;
  });
  const double smallest = quantile == 0 ? min_ : radius_at_area(shares, quantile * total, job.part(0.5, 0.65));
  return clamped(scale_.length_back(smallest), ratio * scale_.length_back(smallest), job.part(0.65, 1));
}

double count_factor(const SizingField& field, double count, const Execution& execution) {
  if (field.empty()) refuse_sizing("number of samples of an empty field; make it from a mesh");
  if (!(count >= 1 && std::isfinite(count)))
    refuse_sizing("cannot place " + number_text(count) + " samples; ask for one at least");
  return std::sqrt(kSamplesPerDensity * field.density_integral(execution) / count);
}

SizingField uniform_sizing(const MeshView& mesh, double radius, const Execution& execution) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    return SizingFieldAccess::back(
        scale.in_our_units([&] { return uniform_sizing(scale.mesh(mesh), scale.length(radius), execution); }), scale);
  }
  if (!is_radius(radius)) refuse_sizing("the radius " + number_text(radius) + " is not positive and finite");
  const Execution job = execution.start(kSizingStage);
  auto lattice = make_simple_lattice(mesh, job.part(0, 0.9));
  const std::size_t n = lattice->num_nodes();
  SizingField result = SizingFieldAccess::make(std::move(lattice), std::vector<double>(n, radius), job.part(0.9, 1));
  job.finish();
  return result;
}

SizingField vertex_sizing(const MeshView& mesh, const ValuesView& radii, const Execution& execution) {
  if (const detail::MeshScale scale(mesh); !scale.is_one()) {
    std::vector<double> scaled;
    for (std::ptrdiff_t v = 0; v < radii.size(); ++v) scaled.push_back(scale.length(radii[v]));
    return SizingFieldAccess::back(scale.in_our_units([&] { return vertex_sizing(scale.mesh(mesh), scaled, execution); }),
                                   scale);
  }
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

constexpr double kAreasShare = 0.1, kTabulated = 0.9;  ///< of the time of a tabulation

[[noreturn]] void refuse_many_nodes(std::size_t most) {
  throw Error(ErrorCode::kTooLarge, "sizing: the function needs more than " + std::to_string(most) +
                                        " lattice nodes; give larger radii or a larger tolerance");
}

/// The values of a user's function, which is called from one thread, and with the same point from all facets that have it.
class FunctionValues {
 public:
  FunctionValues(const MeshView& mesh, const SizingFunction& radius, const Execution& execution)
      : mesh_(mesh), radius_(radius), execution_(execution) {
    at_vertex_.assign(slot(mesh.num_vertices()), 0.0);
  }

  /// Between facets and within large ones.
  void look(Index facet) const {
    execution_.report(kAreasShare + (kTabulated - kAreasShare) * static_cast<double>(facet) / mesh_.num_facets());
  }

  double at_corner(Index f, int k) {
    double& value = at_vertex_[slot(mesh_.triangles(f, k))];
    if (value == 0) value = inside(f, Vec3::Unit(k));
    return value;
  }

  /// At `steps` of k steps from the start of a side, 0 < steps < k.
  double on_side(Index f, int k, const PlaceOnSide& place) {
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
    return inside(owner, b);
  }

  double inside(Index facet, const Vec3& b) {
    constexpr unsigned kCallsPerLook = 16;  // up to some milliseconds each
    if (++calls_ % kCallsPerLook == 0) look(facet);
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

 private:
  const MeshView& mesh_;
  const SizingFunction& radius_;
  const Execution& execution_;
  unsigned calls_ = 0;
  std::vector<double> at_vertex_;        ///< 0: not called yet
  std::vector<std::size_t> first_side_;  ///< empty until a facet has a lattice
};

/// The values of a function of the position, for several threads.
class PositionValues {
 public:
  PositionValues(const MeshView& mesh, const PositionFunction& radius, const Execution& execution)
      : mesh_(mesh), radius_(radius), execution_(execution), at_vertex_(slot(mesh.num_vertices())) {
    for_each_index_on_all_threads(at_vertex_.size(), execution,
                                  [&](std::size_t v) { at_vertex_[v] = radius(mesh.vertices[static_cast<Index>(v)]); });
  }

  void look(Index) const { execution_.check(); }

  double at_corner(Index f, int k) const { return at_vertex_[slot(mesh_.triangles(f, k))]; }

  double on_side(Index f, int k, const PlaceOnSide& place) const {
    Vec3 from = mesh_.corner(f, place.side), to = mesh_.corner(f, (place.side + 1) % 3);
    double along = static_cast<double>(place.steps) / k;
    // In the order of their coordinates: facets with the edge make the same points.
    if (std::lexicographical_compare(to.data(), to.data() + 3, from.data(), from.data() + 3)) {
      std::swap(from, to);
      along = 1 - along;  // exact: k is a power of two
    }
    return radius_((1 - along) * from + along * to);
  }

  double inside(Index f, const Vec3& b) const {
    return radius_(b[0] * mesh_.corner(f, 0) + b[1] * mesh_.corner(f, 1) + b[2] * mesh_.corner(f, 2));
  }

 private:
  const MeshView& mesh_;
  const PositionFunction& radius_;
  Execution execution_;
  std::vector<double> at_vertex_;
};

/// Tabulates a range of facets, one by one. Values: FunctionValues or PositionValues.
template <class Values>
class FacetTabulator {
 public:
  FacetTabulator(const MeshView& mesh, Values& values, const TabulationOptions& options, const std::vector<double>& areas,
                 std::vector<std::uint8_t>& levels)
      : mesh_(mesh), values_(values), options_(options), areas_(areas), levels_(levels) {}

  void tabulate(Index f) {
    std::vector<double>& now = now_;
    now.assign({values_.at_corner(f, 0), values_.at_corner(f, 1), values_.at_corner(f, 2)});
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

  /// Of the facets so far, in order.
  std::vector<double> take_nodes() { return std::move(nodes_); }

 private:
  static constexpr int kLastLevel = 14;

  double at_node(Index f, Index k, Index i, Index j) {
    const PlaceOnSide place = place_on_side(k, i, j);
    if (place.side < 0) return values_.inside(f, lattice_barycentric(k, i, j));
    if (place.steps == 0) return values_.at_corner(f, place.side);
    return values_.on_side(f, k, place);
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
      if (t % kElementsPerLook == kElementsPerLook - 1) values_.look(f);
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
    if (nodes_.size() + nodes_of_lattice(fine) > options_.max_nodes) refuse_many_nodes(options_.max_nodes);
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
      const double r = values_.inside(f, b);
      if (!(std::abs(r - linear) <= options_.tolerance * r)) return false;
    }
    return true;
  }

  const MeshView& mesh_;
  Values& values_;
  const TabulationOptions& options_;
  const std::vector<double>& areas_;
  std::vector<std::uint8_t>& levels_;
  std::vector<double> nodes_;
  std::vector<double> now_, coarse_;  ///< the facet's lattice, and the one before
};

SizingField field_of_nodes(const MeshView& mesh, std::vector<double> areas, std::vector<std::uint8_t> levels,
                           std::vector<double> nodes, const Execution& execution) {
  Mesh copy = mesh.copy();
  auto lattice = make_lattice(std::move(copy), std::move(areas), std::move(levels), execution.part(0.2, 0.7));
  return SizingFieldAccess::make(std::move(lattice), std::move(nodes), execution.part(0.7, 1));
}

SizingField tabulate_function(const MeshView& mesh, const SizingFunction& radius, const TabulationOptions& options,
                              const Execution& execution) {
  std::vector<double> areas = facet_areas(mesh, execution.part(0, kAreasShare));
  std::vector<std::uint8_t> levels(areas.size(), 0);
  FunctionValues values(mesh, radius, execution);
  FacetTabulator<FunctionValues> tabulator(mesh, values, options, areas, levels);
  for_each_index(mesh.num_facets(), execution.part(kAreasShare, kTabulated), [&](Index f) { tabulator.tabulate(f); });
  return field_of_nodes(mesh, std::move(areas), std::move(levels), tabulator.take_nodes(), execution.part(kTabulated, 1));
}

}  // namespace

SizingField tabulate_positions(const MeshView& mesh, const std::vector<double>& areas, const PositionFunction& radius,
                               const TabulationOptions& options, const Execution& execution) {
  constexpr std::size_t kFacetsPerPiece = 1024;
  constexpr double kVerticesEnd = 0.6;  // of the time
  std::vector<std::uint8_t> levels(areas.size(), 0);
  PositionValues values(mesh, radius, execution.part(0, kVerticesEnd));
  std::vector<std::vector<double>> parts(areas.size() / kFacetsPerPiece + 1);
  const Execution tabulation = execution.part(kVerticesEnd, kTabulated);
  for_each_piece_on_all_threads(areas.size(), kFacetsPerPiece, tabulation, [&](std::size_t begin, std::size_t end) {
    FacetTabulator<PositionValues> tabulator(mesh, values, options, areas, levels);
    for (std::size_t f = begin; f < end; ++f) tabulator.tabulate(static_cast<Index>(f));
    parts[begin / kFacetsPerPiece] = tabulator.take_nodes();
  });
  std::size_t size = 0;
  for (const auto& part : parts) size += part.size();
  if (size > options.max_nodes) refuse_many_nodes(options.max_nodes);
  std::vector<double> nodes;
  nodes.reserve(size);
  for (auto& part : parts) {
    nodes.insert(nodes.end(), part.begin(), part.end());
    part = {};
  }
  return field_of_nodes(mesh, areas, std::move(levels), std::move(nodes), execution.part(kTabulated, 1));
}

}  // namespace detail

SizingField function_sizing(const MeshView& mesh, const SizingFunction& radius, const TabulationOptions& options,
                            const Execution& execution) {
  if (const detail::MeshScale scale(mesh); radius && !scale.is_one()) {
    const SizingFunction scaled = [&](SurfacePoint at) {
      for (int k = 0; k < 3; ++k) scale.back(at.position[k]);
      return scale.length(radius(at));
    };
    return SizingFieldAccess::back(
        scale.in_our_units([&] { return function_sizing(scale.mesh(mesh), scaled, options, execution); }), scale);
  }
  const Execution job = execution.start(kSizingStage);
  require_usable(mesh, job.part(0, 0.1));
  if (!radius) refuse_sizing("no function given");
  if (!(options.tolerance > 0 && options.finest > 0)) refuse_sizing("tolerance and finest must be positive");
  const Execution tabulation = job.part(0.1, 1);
  SizingField result = detail::tabulate_function(mesh, radius, options, tabulation);
  job.finish();
  return result;
}

}  // namespace amps
