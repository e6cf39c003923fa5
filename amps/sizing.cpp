#define AMPS_OWN_SOURCE
#include "amps/sizing.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>

namespace amps {

// ---------------------------------------------------------------------------------------------------------------------------
// Lattices

namespace detail {

/// Where the nodes are. With k = 2^level, node (i, j), i + j ≤ k, of a facet has barycentrics (k − i − j, i, j)/k; nodes are
/// stored by j, then i. Piece t of a facet lies in row j; rows alternate upward and downward triangles.
struct SizingLattice {
  Mesh mesh;
  std::vector<double> areas;             ///< by facet
  std::vector<std::uint8_t> levels;      ///< by facet; this and what follows is empty if all are 0
  std::vector<std::size_t> first_node;   ///< #F + 1
  std::vector<std::size_t> first_piece;  ///< #F + 1
  std::vector<Index> piece_facet;

  Index num_facets() const { return static_cast<Index>(mesh.triangles.rows()); }
  bool simple() const { return levels.empty(); }
  int level(Index f) const { return simple() ? 0 : levels[slot(f)]; }
  Index k(Index f) const { return Index{1} << level(f); }
  std::size_t node(Index f) const { return simple() ? 3 * slot(f) : first_node[slot(f)]; }
  std::size_t piece(Index f) const { return simple() ? slot(f) : first_piece[slot(f)]; }
  std::size_t num_nodes() const { return node(num_facets()); }
  std::size_t num_pieces() const { return piece(num_facets()); }
};

struct SizingFieldAccess {
  static SizingField make(std::shared_ptr<const SizingLattice> lattice, std::vector<double> nodes) {
    return {std::move(lattice), std::move(nodes)};
  }
  static const std::shared_ptr<const SizingLattice>& lattice(const SizingField& field) { return field.lattice_; }
  static const std::vector<double>& nodes(const SizingField& field) { return *field.nodes_; }
};

}  // namespace detail

namespace {

using detail::SizingFieldAccess;
using detail::SizingLattice;
using detail::slot;

/// Corners of lattice triangles as (i, j).
struct LatticeTriangle {
  std::array<std::array<Index, 2>, 3> corner;
};

std::size_t nodes_of_lattice(Index k) { return slot(k + 1) * slot(k + 2) / 2; }

/// Place of node (i, j) among those of its facet: rows before j hold k+1, k, … nodes.
std::size_t lattice_node(Index k, Index i, Index j) { return slot(j) * (2 * slot(k) + 3 - slot(j)) / 2 + slot(i); }

Vec3 lattice_barycentric(Index k, Index i, Index j) { return Vec3(k - i - j, i, j) / k; }

LatticeTriangle lattice_triangle(Index i, Index j, bool upward) {
  if (upward) return {{{{i, j}, {i + 1, j}, {i, j + 1}}}};
  return {{{{i + 1, j}, {i + 1, j + 1}, {i, j + 1}}}};
}

/// The t-th triangle of a lattice. Rows from j on hold (k − j)² triangles, so t lies in row j iff (k − j)² ≥ k² − t > (k − j −
/// 1)².
LatticeTriangle nth_lattice_triangle(Index k, std::size_t t) {
  const std::size_t all = slot(k) * slot(k), left = all - t;
  auto side = static_cast<std::size_t>(std::sqrt(static_cast<double>(left)));
  while (side * side < left) ++side;
  while ((side - 1) * (side - 1) >= left) --side;
  const std::size_t within = t - (all - side * side);
  return lattice_triangle(static_cast<Index>(within / 2), k - static_cast<Index>(side), within % 2 == 0);
}

/// The linear interpolant of a facet's nodes; never outside the range of the three it interpolates.
double interpolate_lattice(const double* nodes, Index k, const Vec3& barycentric) {
  const double x = barycentric[1] * k, y = barycentric[2] * k;  // exact: k is a power of two
  const Index j = std::clamp(static_cast<Index>(y), Index{0}, k - 1);
  const Index i = std::clamp(static_cast<Index>(x), Index{0}, k - 1 - j);
  const double u = x - i, v = y - j;
  const bool upward = u + v <= 1 || i + j + 1 == k;
  double a, b, c, s, t;  // a + s (b − a) + t (c − a)
  if (upward) {
    a = nodes[lattice_node(k, i, j)];
    s = u;
    t = v;
  } else {
    a = nodes[lattice_node(k, i + 1, j + 1)];
    s = 1 - v;
    t = 1 - u;
  }
  b = nodes[lattice_node(k, i + 1, j)];
  c = nodes[lattice_node(k, i, j + 1)];
  return std::clamp(a + s * (b - a) + t * (c - a), std::min({a, b, c}), std::max({a, b, c}));
}

/// A lattice of the given levels (empty: k = 1 everywhere).
std::shared_ptr<SizingLattice> make_lattice(Mesh mesh, std::vector<double> areas, std::vector<std::uint8_t> levels) {
  auto lattice = std::make_shared<SizingLattice>();
  lattice->mesh = std::move(mesh);
  lattice->areas = std::move(areas);
  if (std::all_of(levels.begin(), levels.end(), [](std::uint8_t level) { return level == 0; })) return lattice;
  lattice->levels = std::move(levels);
  const std::size_t n = lattice->levels.size();
  lattice->first_node.assign(n + 1, 0);
  lattice->first_piece.assign(n + 1, 0);
  for (std::size_t f = 0; f < n; ++f) {
    const Index k = Index{1} << lattice->levels[f];
    lattice->first_node[f + 1] = lattice->first_node[f] + nodes_of_lattice(k);
    lattice->first_piece[f + 1] = lattice->first_piece[f] + slot(k) * slot(k);
  }
  lattice->piece_facet.resize(lattice->first_piece[n]);
  for (std::size_t f = 0; f < n; ++f) {
    std::fill(lattice->piece_facet.begin() + static_cast<std::ptrdiff_t>(lattice->first_piece[f]),
              lattice->piece_facet.begin() + static_cast<std::ptrdiff_t>(lattice->first_piece[f + 1]), static_cast<Index>(f));
  }
  return lattice;
}

std::shared_ptr<SizingLattice> make_simple_lattice(const MeshView& mesh) {
  require_usable(mesh);
  return make_lattice({mesh.vertices, mesh.triangles}, facet_areas(mesh), {});
}

bool same_mesh(const MeshView& a, const MeshView& b) {
  return a.num_vertices() == b.num_vertices() && a.num_facets() == b.num_facets() && a.triangles == b.triangles &&
         a.vertices == b.vertices;
}

[[noreturn]] void refuse_sizing(const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "sizing: " + what); }

bool is_radius(double r) { return r > 0 && std::isfinite(r); }

// ---------------------------------------------------------------------------------------------------------------------------
// ∫ 1/r² over a triangle, r linear. std::log differs between platforms, and the integrals decide where darts go.

/// atanh(s)/s, |s| ≤ 0.172: the remainder of the series is below s²⁴/25 < 1e-19.
double atanh_over(double s) {
  const double q = s * s;
  double sum = 0;
  for (int n = 23; n >= 1; n -= 2) sum = sum * q + 1.0 / n;
  return sum;
}

/// ln x, x > 0: ln 2 · e + 2 atanh((m − 1)/(m + 1)) with m in [√½, √2].
double portable_log(double x) {
  constexpr double kLn2 = 0.693147180559945309417232;
  int exponent = 0;
  double m = std::frexp(x, &exponent);
  if (m < 0.70710678118654752) {
    m *= 2;
    --exponent;
  }
  const double s = (m - 1) / (m + 1);
  return exponent * kLn2 + 2 * s * atanh_over(s);
}

/// (ln b − ln a)/(b − a), also for a = b.
double log_slope(double a, double b) {
  const double s = (b - a) / (b + a);
  return std::abs(s) < 0.17 ? 2 * atanh_over(s) / (a + b) : (portable_log(b) - portable_log(a)) / (b - a);
}

/// The mean of 1/r² over a triangle. By Hermite–Genocchi it is 2·F[r₀, r₁, r₂] with F'' = 1/r², so F = −ln. Where the radii
/// differ little the divided difference cancels (its relative error is about ε/spread²); there, with deviations x_i from the
/// mean m in units of m, the mean of 1/(1 + x)² = Σ (−1)ⁿ (n + 1) xⁿ is Σ (−1)ⁿ 2/(n + 2) · h_n(x₀, x₁, x₂): h_n, the complete
/// homogeneous polynomial, follows from h_n = e₁ h_{n−1} − e₂ h_{n−2} + e₃ h_{n−3}, and e₁ = 0.
double mean_inverse_square(const std::array<double, 3>& radii) {
  double a = radii[0], b = radii[1], c = radii[2];
  if (a > b) std::swap(a, b);
  if (b > c) std::swap(b, c);
  if (a > b) std::swap(a, b);
  constexpr double kSeriesSpread = 0.1;
  if (c - a > kSeriesSpread * a) return 2 * (log_slope(a, b) - log_slope(b, c)) / (c - a);
  const double m = a + ((b - a) + (c - a)) / 3;
  const double x = (a - m) / m, y = (b - m) / m, z = -(x + y);
  const double e2 = x * y + z * (x + y), e3 = x * y * z;
  double h3 = 0, h2 = 0, h1 = 1, sum = 1;  // h_{n−3}, h_{n−2}, h_{n−1}
  // |x_i| ≤ 0.067, h_n ≤ (n + 1)(n + 2)/2 · 0.067ⁿ: the remainder is below 1e-15.
  for (int n = 1; n <= 14; ++n) {
    const double h = -e2 * h2 + e3 * h3;
    sum += (n % 2 == 0 ? 2.0 : -2.0) / (n + 2) * h;
    h3 = h2;
    h2 = h1;
    h1 = h;
  }
  return sum / (m * m);
}

}  // namespace

// ---------------------------------------------------------------------------------------------------------------------------
// SizingField

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
  return interpolate_lattice(nodes_->data() + lattice_->node(facet), lattice_->k(facet), barycentric);
}

std::size_t SizingField::num_pieces() const { return lattice_->num_pieces(); }

std::size_t SizingField::first_piece(Index facet) const { return lattice_->piece(facet); }

SizingField::Piece SizingField::piece(std::size_t i) const {
  Piece result;
  result.facet = lattice_->simple() ? static_cast<Index>(i) : lattice_->piece_facet[i];
  const Index k = lattice_->k(result.facet);
  const LatticeTriangle triangle = nth_lattice_triangle(k, i - lattice_->piece(result.facet));
  for (std::size_t c = 0; c < 3; ++c) {
    const auto [x, y] = triangle.corner[c];
    result.corners[c] = lattice_barycentric(k, x, y);
    result.radii[c] = (*nodes_)[lattice_->node(result.facet) + lattice_node(k, x, y)];
  }
  return result;
}

double SizingField::density_integral(std::size_t i) const {
  const Piece p = piece(i);
  const double k = lattice_->k(p.facet), area = lattice_->areas[slot(p.facet)] / (k * k);
  return area > 0 ? area * mean_inverse_square(p.radii) : 0.0;
}

double SizingField::density_integral() const {
  double sum = 0;
  for (std::size_t i = 0; i < num_pieces(); ++i) sum += density_integral(i);
  return sum;
}

SizingField SizingField::scaled(double factor) const {
  if (!is_radius(factor)) refuse_sizing("the factor " + std::to_string(factor) + " is not positive and finite");
  std::vector<double> nodes = *nodes_;
  for (double& r : nodes) {
    r *= factor;
    if (!is_radius(r))
      refuse_sizing("scaled by " + std::to_string(factor) + " a radius is no positive double; use a milder factor");
  }
  return {lattice_, std::move(nodes)};
}

SizingField SizingField::clamped(double least, double greatest) const {
  if (!(is_radius(least) && least <= greatest)) {
    refuse_sizing("cannot clamp to [" + std::to_string(least) + ", " + std::to_string(greatest) +
                  "]; give 0 < least <= greatest");
  }
  std::vector<double> nodes = *nodes_;
  for (double& r : nodes) r = std::min(greatest, std::max(least, r));
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
      lattice = make_lattice(la->mesh, la->areas, std::move(levels));
    }
  }
  std::vector<double> nodes(lattice->num_nodes());
  for (Index f = 0; f < lattice->num_facets(); ++f) {
    const Index k = lattice->k(f);
    double* out = nodes.data() + lattice->node(f);
    for (Index j = 0; j <= k; ++j) {
      for (Index i = 0; i + j <= k; ++i) {
        const Vec3 at = lattice_barycentric(k, i, j);
        *out++ = std::min(a.radius(f, at), b.radius(f, at));
      }
    }
  }
  return SizingFieldAccess::make(std::move(lattice), std::move(nodes));
}

// ---------------------------------------------------------------------------------------------------------------------------
// Factories

SizingField uniform_sizing(const MeshView& mesh, double radius) {
  if (!is_radius(radius)) refuse_sizing("the radius " + std::to_string(radius) + " is not positive and finite");
  auto lattice = make_simple_lattice(mesh);
  const std::size_t n = lattice->num_nodes();
  return SizingFieldAccess::make(std::move(lattice), std::vector<double>(n, radius));
}

SizingField vertex_sizing(const MeshView& mesh, const Eigen::Ref<const Eigen::VectorXd>& radii) {
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
        refuse_sizing("the radius " + std::to_string(radii[v]) + " of vertex " + std::to_string(v) +
                      " (0-based) is not positive and finite; correct it");
      }
      nodes[3 * slot(f) + slot(k)] = radii[v];
    }
  }
  return SizingFieldAccess::make(std::move(lattice), std::move(nodes));
}

}  // namespace amps
