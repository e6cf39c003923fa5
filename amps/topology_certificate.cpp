#define AMPS_OWN_SOURCE
#include "amps/topology_certificate.h"

#include "amps/predicates.h"

#include <algorithm>
#include <ostream>
#include <utility>

namespace amps {

const char* name_of(TopologyFailureKind kind) noexcept {
  switch (kind) {
    case TopologyFailureKind::kUncovered:
      return "uncovered";
    case TopologyFailureKind::kNoCell:
      return "no cell";
    case TopologyFailureKind::kDisagreement:
      return "facets divided differently at an edge";
    case TopologyFailureKind::kUndecided:
      return "undecided facet without area";
    case TopologyFailureKind::kPieces:
      return "cell in pieces";
    case TopologyFailureKind::kNotADisk:
      return "cell that is no disk";
    case TopologyFailureKind::kSharedEdge:
      return "shared edge that is not one path";
    case TopologyFailureKind::kEdgeAtCurves:
      return "shared edge that meets curves more than once";
    case TopologyFailureKind::kTriple:
      return "triple that is met more than once";
    case TopologyFailureKind::kCurve:
      return "part of the curves that is not one path";
    case TopologyFailureKind::kForeignCurve:
      return "part of a foreign curve";
  }
  return "unknown";
}

std::ostream& operator<<(std::ostream& out, const TopologyFailure& failure) {
  using Kind = TopologyFailureKind;
  const auto cell = [&]() -> std::ostream& { return out << "the cell of sample " << failure.sample; };
  const auto pair = [&]() -> std::ostream& {
    return out << "what the cells of samples " << failure.sample << " and " << failure.other << " share ";
  };
  switch (failure.kind) {
    case Kind::kUncovered:
      if (failure.sample == kNone) {
        out << "a part of the surface is in no disk";
      } else {
        cell() << " is not covered by its disk";
      }
      break;
    case Kind::kNoCell:
      out << "sample " << failure.sample << " owns nothing of the surface";
      break;
    case Kind::kDisagreement:
      cell() << " ends at an edge of the mesh, though facets go on there";
      break;
    case Kind::kUndecided:
      out << "a facet without area borders on nothing that tells whose it is";
      break;
    case Kind::kPieces:
      cell() << " has other pieces than the surface has at the sample";
      break;
    case Kind::kNotADisk:
      cell() << " has a piece that is no disk";
      break;
    case Kind::kSharedEdge:
      pair() << "is not one path";
      break;
    case Kind::kEdgeAtCurves:
      pair() << "meets curves more than once";
      break;
    case Kind::kTriple:
      out << "the cells of samples " << failure.sample << ", " << failure.other << " and " << failure.third
          << " meet more than once";
      break;
    case Kind::kCurve:
      cell() << " has a part of the curves that is not one path or tree around a corner";
      break;
    case Kind::kForeignCurve:
      cell() << " has a part of curve " << failure.other << ", which the sample is not on";
      break;
  }
  if (failure.facet != kNone) out << " (facet " << failure.facet << ")";
  return out;
}

std::ostream& operator<<(std::ostream& out, const TopologyCertificate& certificate) {
  out << "topology of " << certificate.cells << " cells: ";
  if (certificate.holds()) return out << "holds";
  out << certificate.failures.size() << " failures";
  const char* separator = " (";
  for (std::size_t kind = 0; kind < kNumTopologyFailureKinds; ++kind) {
    if (certificate.failures_of[kind] == 0) continue;
    out << separator << certificate.failures_of[kind] << " " << name_of(static_cast<TopologyFailureKind>(kind));
    separator = ", ";
  }
  return out << "); the first: " << certificate.failures.front();
}

namespace detail {
namespace {

using Labels = RestrictedPowerDiagram;

/// The root of an element of disjoint sets; the smallest one.
Index root_of(std::vector<Index>& parents, Index x) {
  while (parents[slot(x)] != x) x = parents[slot(x)] = parents[slot(parents[slot(x)])];
  return x;
}

/// False if they were one set already.
bool unite(std::vector<Index>& parents, Index a, Index b) {
  a = root_of(parents, a);
  b = root_of(parents, b);
  if (a == b) return false;
  parents[slot(a < b ? b : a)] = a < b ? a : b;
  return true;
}

void start_sets(std::vector<Index>& parents, std::size_t n) {
  parents.resize(n);
  for (std::size_t i = 0; i < n; ++i) parents[i] = static_cast<Index>(i);
}

TopologyCertificate certificate_of(Index cells, std::vector<TopologyFailure> failures) {
  TopologyCertificate result;
  result.cells = cells;
  std::sort(failures.begin(), failures.end());
  failures.erase(std::unique(failures.begin(), failures.end()), failures.end());
  for (const TopologyFailure& failure : failures) ++result.failures_of[static_cast<std::size_t>(failure.kind)];
  result.failures = std::move(failures);
  return result;
}

/// Of three different points in a line the one between the others.
int middle_corner(const MeshView& mesh, Index facet) {
  const Vec3 x[3] = {mesh.corner(facet, 0), mesh.corner(facet, 1), mesh.corner(facet, 2)};
  int axis = 0;
  while (axis < 2 && x[0][axis] == x[1][axis]) ++axis;
  for (int k = 0; k < 2; ++k) {
    const double a = x[(k + 1) % 3][axis], b = x[(k + 2) % 3][axis];
    if ((a < x[k][axis]) != (b < x[k][axis])) return k;
  }
  return 2;
}

/// Owners along side k of a facet, from its corner k to the next one. Empty: no fragment reaches the side.
void list_owners(const RestrictedPowerDiagram& diagram, Index facet, int k, std::vector<Index>& owners) {
  owners.clear();
  std::vector<std::array<Index, 2>> next_of;  // the owner of a part, and whose part is next
  Index first = kNone;
  for (Index f = diagram.first_of_facet(facet); f != kNone; f = diagram.next_of_facet(f)) {
    const auto p = diagram.polygon(f);
    const Index* const at = std::find(p.labels, p.labels + p.size, Labels::mesh_edge_label(k));
    if (p.site == kNone || at == p.labels + p.size) continue;
    const auto q = static_cast<Index>(at - p.labels);
    if (!Labels::is_site(p.labels[q == 0 ? p.size - 1 : q - 1])) first = p.site;
    next_of.push_back({p.site, p.labels[q + 1 == p.size ? 0 : q + 1]});
  }
  std::sort(next_of.begin(), next_of.end());
  constexpr Index kLeastLabel = Labels::mesh_edge_label(2);
  for (Index owner = first; owner != kNone && owners.size() < next_of.size();) {
    owners.push_back(owner);
    const auto next = std::lower_bound(next_of.begin(), next_of.end(), std::array<Index, 2>{owner, kLeastLabel});
    if (next == next_of.end() || (*next)[0] != owner || !Labels::is_site((*next)[1])) break;
    owner = (*next)[1];
  }
}

}  // namespace

// The surface

TopologyChecker::TopologyChecker(const MeshView& mesh, const SurfaceFlood& flood, const Execution& execution,
                                 const std::vector<std::size_t>* fans)
    : mesh_(mesh), flood_(flood) {
  const Execution run = execution.start();
  const SurfaceEdges& edges = flood.edges();
  std::vector<char> separating;
  sides_.resize(3 * slot(edges.num_facets()));
  Ticker ticker(run.part(0, 0.4), edges.size(), kEdgesPerLook);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    ticker.tick();
    const MeshEdge edge = edges[e];
    const std::uint8_t kind = edge.size() == 1 ? kBorder : edge.non_manifold() || flood.is_cut(e) ? kSeparating : kPlain;
    if (kind == kSeparating) {
      separating.resize(edges.size(), 0);
      separating[e] = 1;
    }
    for (const EdgeSide& side : edge) add_side(side, edge, kind);
  }
  std::vector<std::size_t> own;
  if (fans == nullptr || !separating.empty()) {
    own = corner_fans(edges.edges(), separating, run.part(0.4, 0.8));
    fans = &own;
  }
  starts_fan_.resize(fans->size());
  for (std::size_t c = 0; c < fans->size(); ++c) starts_fan_[c] = (*fans)[c] == c;
  find_flat_facets(run.part(0.8, 1));
  run.finish();
}

void TopologyChecker::add_side(const EdgeSide& side, const MeshEdge& edge, std::uint8_t kind) {
  Side& stored = sides_[side.corner()];
  stored.kind = kind;
  stored.first = edge[0].facet == side.facet;
  if (kind != kPlain) return;
  const EdgeSide& other = edge[stored.first ? 1 : 0];
  stored.across = other.facet;
  stored.k = other.k;
  stored.opposite = other.forward != side.forward;
}

void TopologyChecker::find_flat_facets(const Execution& execution) {
  Ticker ticker(execution, slot(mesh_.num_facets()), kEdgesPerLook);
  for (Index facet = 0; facet < mesh_.num_facets(); ++facet) {
    ticker.tick();
    if (!flood_.edges().counts(facet)) continue;
    const Vec3 a = mesh_.corner(facet, 0), b = mesh_.corner(facet, 1), c = mesh_.corner(facet, 2);
    if (collinear(a.data(), b.data(), c.data())) flat_.push_back({facet, middle_corner(mesh_, facet)});
  }
}

/// How many pieces the surface has around a point, apart at cut edges.
Index TopologyChecker::num_sectors(const SurfacePoint& at) const {
  const SurfaceEdges& edges = flood_.edges();
  if (at.facet == kNone || (edges.counts(at.facet) && (at.barycentric.array() != 0).all())) return 1;
  const std::vector<Index> homes = flood_.homes(at);
  if (homes.size() < 2) return 1;
  // The edges that join its homes at the point have all surface vertices that it lies between, one or two.
  std::array<Index, 2> between{kNone, kNone};
  for (int k = 0; k < 3; ++k) {
    const Index v = edges.triangles()(at.facet, k);
    if (at.barycentric[k] == 0 || v == between[0] || v == between[1]) continue;
    between[between[0] == kNone ? 0 : 1] = v;
  }
  std::vector<std::array<std::size_t, 2>> joined;  // an edge, and a home there
  std::vector<Index> parents;
  start_sets(parents, homes.size());
  for (std::size_t h = 0; h < homes.size(); ++h) {
    for (int k = 0; k < 3; ++k) {
      const std::size_t e = edges.edge(homes[h], k);
      if (flood_.is_cut(e)) continue;
      const MeshEdge edge = edges[e];
      const auto ends_at = [&](Index v) { return v == kNone || edge.low == v || edge.high == v; };
      if (ends_at(between[0]) && ends_at(between[1])) joined.push_back({e, h});
    }
  }
  std::sort(joined.begin(), joined.end());
  auto sectors = static_cast<Index>(homes.size());
  for (std::size_t i = 1; i < joined.size(); ++i) {
    if (joined[i][0] != joined[i - 1][0]) continue;
    if (unite(parents, static_cast<Index>(joined[i - 1][1]), static_cast<Index>(joined[i][1]))) --sectors;
  }
  return sectors;
}

// Facets without area

/// A facet without area is a segment, and whose its parts are the facets beside it tell. We treat it as a very thin triangle:
/// bisectors cross it from its long side to the two short ones, and three cells never meet in it.
class TopologyChecker::FlatDivider {
 public:
  FlatDivider(const TopologyChecker& checker, const RestrictedPowerDiagram& diagram)
      : mesh_(checker.mesh_),
        edges_(checker.flood_.edges()),
        flat_(checker.flat_),
        diagram_(diagram),
        lines_(flat_.size()),
        waits_(flat_.size(), 1),
        queue_(flat_.size()) {
    for (std::size_t i = 0; i < queue_.size(); ++i) queue_[i] = static_cast<Index>(i);
  }

  FlatFragments operator()(const Execution& execution) {
    FlatFragments result;
    for (std::size_t next = 0; next < queue_.size(); ++next) {
      if (next % kFlatFacetsPerLook == 0) execution.check();
      const Index i = queue_[next];
      waits_[slot(i)] = 0;
      if (!lines_[slot(i)].owners.empty() || !(divide_by_long_side(i) || divide_by_short_sides(i))) continue;
      // Those beside it may know more now.
      for_each_flat_beside(i, [&](Index other) {
        if (other == kNone || waits_[slot(other)] != 0 || !lines_[slot(other)].owners.empty()) return;
        waits_[slot(other)] = 1;
        queue_.push_back(other);
      });
    }
    for (Index i = 0; i < static_cast<Index>(flat_.size()); ++i) {
      if (!lines_[slot(i)].owners.empty()) {
        add_fragments(i, result);
        continue;
      }
      // Of no matter where all that it is joined to has no area either.
      bool alone = true;
      for_each_flat_beside(i, [&](Index other) { alone = alone && other != kNone && lines_[slot(other)].owners.empty(); });
      if (!alone) result.undecided.push_back(flat_[slot(i)].facet);
    }
    using Fragment = FlatFragments::Fragment;
    std::stable_sort(result.fragments.begin(), result.fragments.end(),
                     [](const Fragment& a, const Fragment& b) { return a.site < b.site; });
    return result;
  }

 private:
  static constexpr std::size_t kFlatFacetsPerLook = 4096;

  /// The owners of a facet without area from end to end; none: not known.
  struct Line {
    std::vector<Index> owners;
    std::size_t middle = 0;  ///< of these the one that has the middle corner
  };

  /// Its place in flat_; kNone: the facet has area.
  Index find_flat(Index facet) const {
    const auto before = [](const FlatFacet& a, Index b) { return a.facet < b; };
    const auto at = std::lower_bound(flat_.begin(), flat_.end(), facet, before);
    return at != flat_.end() && at->facet == facet ? static_cast<Index>(at - flat_.begin()) : kNone;
  }

  /// visit(place in flat_, or kNone) for each facet at its edges, itself too.
  template <class Visit>
  void for_each_flat_beside(Index i, const Visit& visit) const {
    for (int k = 0; k < 3; ++k) {
      for (const EdgeSide& side : edges_[edges_.edge(flat_[slot(i)].facet, k)]) visit(find_flat(side.facet));
    }
  }

  bool divide_by_long_side(Index i) {
    const auto [facet, middle] = flat_[slot(i)];
    Line& line = lines_[slot(i)];
    list_owners_beyond(facet, (middle + 1) % 3, line.owners);
    if (line.owners.empty()) return false;
    std::reverse(line.owners.begin(), line.owners.end());  // as the short sides run
    const Vec3 x[3] = {mesh_.corner(facet, 0), mesh_.corner(facet, 1), mesh_.corner(facet, 2)};
    const double* const corners[3] = {x[0].data(), x[1].data(), x[2].data()};
    for (std::size_t q = 1; q < line.owners.size(); ++q) {
      const Bisector bisector(diagram_.site(line.owners[line.middle]), diagram_.site(line.owners[q]), corners);
      if (side_of_corner(corners, middle, bisector) < 0) line.middle = q;
    }
    return true;
  }

  bool divide_by_short_sides(Index i) {
    const auto [facet, middle] = flat_[slot(i)];
    list_owners_beyond(facet, (middle + 2) % 3, before_);
    list_owners_beyond(facet, middle, after_);
    if (before_.empty() || after_.empty() || before_.back() != after_.front()) return false;
    Line& line = lines_[slot(i)];
    line.owners = before_;
    line.middle = line.owners.size() - 1;
    line.owners.insert(line.owners.end(), after_.begin() + 1, after_.end());
    return true;
  }

  /// Owners along side k of a facet in its direction, from another facet at the edge that knows; none: there is no such one.
  void list_owners_beyond(Index facet, int k, std::vector<Index>& owners) const {
    owners.clear();
    const MeshEdge edge = edges_[edges_.edge(facet, k)];
    const EdgeSide* const own = std::find_if(edge.begin(), edge.end(), [&](const EdgeSide& a) { return a.facet == facet; });
    for (const EdgeSide& side : edge) {
      if (side.facet == facet) continue;
      const Index other = find_flat(side.facet);
      if (other == kNone) {
        list_owners(diagram_, side.facet, side.k, owners);
      } else if (!lines_[slot(other)].owners.empty()) {
        const Line& line = lines_[slot(other)];
        const auto at = line.owners.begin() + static_cast<std::ptrdiff_t>(line.middle);
        const int sides_on = (side.k - flat_[slot(other)].middle + 3) % 3;
        if (sides_on == 0) owners.assign(at, line.owners.end());                     // from the middle corner on
        if (sides_on == 1) owners.assign(line.owners.rbegin(), line.owners.rend());  // the long side, which runs back
        if (sides_on == 2) owners.assign(line.owners.begin(), at + 1);               // up to the middle corner
      }
      if (owners.empty()) continue;
      if (side.forward != own->forward) std::reverse(owners.begin(), owners.end());
      return;
    }
  }

  void add_fragments(Index i, FlatFragments& result) const {
    const auto [facet, middle] = flat_[slot(i)];
    const Line& line = lines_[slot(i)];
    std::vector<Index>& labels = result.labels;
    for (std::size_t q = 0; q < line.owners.size(); ++q) {
      const auto first = static_cast<Index>(labels.size());
      if (q <= line.middle) labels.push_back(Labels::mesh_edge_label((middle + 2) % 3));
      if (q >= line.middle) labels.push_back(Labels::mesh_edge_label(middle));
      if (q + 1 < line.owners.size()) labels.push_back(line.owners[q + 1]);
      labels.push_back(Labels::mesh_edge_label((middle + 1) % 3));
      if (q > 0) labels.push_back(line.owners[q - 1]);
      result.fragments.push_back({line.owners[q], facet, first, static_cast<Index>(labels.size()) - first});
    }
  }

  const MeshView& mesh_;
  const SurfaceEdges& edges_;
  const std::vector<FlatFacet>& flat_;
  const RestrictedPowerDiagram& diagram_;
  std::vector<Line> lines_;  ///< as flat_, as the next
  std::vector<char> waits_;  ///< is it in the queue?
  std::vector<Index> queue_, before_, after_;
};

// Cells

/// What all cells of a check have in common.
struct TopologyChecker::Run {
  const RestrictedPowerDiagram& diagram;
  const TopologySamples& samples;
  const FlatFragments& flat;
  bool all_cells;  ///< then what several cells share is looked at from that of the least sample alone
};

/// The check of one cell after another.
class TopologyChecker::CellCheck {
 public:
  CellCheck(const TopologyChecker& checker, const Run& run, Scratch& scratch, std::vector<TopologyFailure>& failures)
      : checker_(checker),
        edges_(checker.flood_.edges()),
        diagram_(run.diagram),
        run_(run),
        cell_(scratch),
        failures_(failures) {
    cell_.piece_of_facet.resize(checker.sides_.size() / 3);
    if (cell_.shared_of_site.size() < slot(diagram_.num_sites())) cell_.shared_of_site.resize(slot(diagram_.num_sites()));
  }

  /// The number of corners it has looked at; 0: there is no cell.
  std::size_t operator()(Index s) {
    sample_ = s;
    start();
    collect();
    if (cell_.pieces.empty()) {
      if (diagram_.visible(s) && !diagram_.removed(s)) fail(TopologyFailureKind::kNoCell, kNone);
      return 0;
    }
    std::size_t num_labels = 0;
    for (const Piece& piece : cell_.pieces) num_labels += slot(piece.size);
    start_sets(cell_.parents, cell_.pieces.size());
    for (Index p = 0; p < static_cast<Index>(cell_.pieces.size()); ++p) list_shared(cell_.pieces[slot(p)]);
    for (Index p = 0; p < static_cast<Index>(cell_.pieces.size()); ++p) join_piece(p);
    if (disagreement_ == kNone && num_later_ != num_matched_) disagreement_ = cell_.pieces.front().facet;
    if (disagreement_ != kNone) {
      fail(TopologyFailureKind::kDisagreement, disagreement_);
      return num_labels;  // what else is counted means nothing
    }
    check_pieces();
    check_shared();
    check_triples();
    return num_labels;
  }

 private:
  static Index before(const Piece& piece, Index q) { return piece.labels[q == 0 ? piece.size - 1 : q - 1]; }
  static Index after(const Piece& piece, Index q) { return piece.labels[q + 1 == piece.size ? 0 : q + 1]; }
  /// Ends that are on bisectors, of an edge between edges of these labels.
  static Index num_crossings(Index in, Index out) { return (Labels::is_site(in) ? 1 : 0) + (Labels::is_site(out) ? 1 : 0); }
  static Index end_name(Index label) { return Labels::is_site(label) ? label : kNone; }

  /// Is it looked at from this cell?
  bool is_ours(Index site) const { return !run_.all_cells || site > sample_; }

  void fail(TopologyFailureKind kind, Index facet, Index other = kNone, Index third = kNone) {
    std::array<Index, 3> names = {sample_, other, third};
    if (kind == TopologyFailureKind::kSharedEdge || kind == TopologyFailureKind::kEdgeAtCurves) {
      std::sort(names.begin(), names.begin() + 2);
    }
    if (kind == TopologyFailureKind::kTriple) std::sort(names.begin(), names.end());
    TopologyFailure failure;
    failure.kind = kind;
    failure.sample = names[0];
    failure.other = names[1];
    failure.third = names[2];
    failure.facet = facet;
    failures_.push_back(failure);
  }

  void start() {
    if (++cell_.now == 0) {
      cell_.piece_of_facet.assign(cell_.piece_of_facet.size(), {});
      cell_.shared_of_site.assign(cell_.shared_of_site.size(), {});
      cell_.now = 1;
    }
    cell_.pieces.clear();
    cell_.shared.clear();
    cell_.triples.clear();
    cell_.curve_parts.clear();
    cell_.joins.clear();
    cell_.curve_joins.clear();
    disagreement_ = kNone;
    num_later_ = num_matched_ = 0;
    added_copies_ = 0;
  }

  void add_piece(Index facet, const Index* labels, Index size) {
    cell_.piece_of_facet[slot(facet)] = {cell_.now, static_cast<Index>(cell_.pieces.size())};
    cell_.pieces.push_back({facet, labels, size, 1, false});
    prefetch(labels);
    prefetch(&checker_.sides_[3 * slot(facet)]);
  }

  void collect() {
    Index uncovered = kNone;
    const double weight = diagram_.site(sample_).w;
    for (Index f = diagram_.first_of_site(sample_); f != kNone; f = diagram_.next_of_site(f)) {
      const RestrictedPowerDiagram::Polygon p = diagram_.polygon(f);
      if (!edges_.counts(p.facet)) continue;
      add_piece(p.facet, p.labels, p.size);
      if (run_.samples.covered) continue;
      const double reach = diagram_.reach(f);
      if (reach * reach < weight || diagram_.covered(p)) continue;
      if (uncovered == kNone || p.facet < uncovered) uncovered = p.facet;
    }
    if (uncovered != kNone) fail(TopologyFailureKind::kUncovered, uncovered);
    using Fragment = FlatFragments::Fragment;
    const auto& flat = run_.flat.fragments;
    auto at = std::lower_bound(flat.begin(), flat.end(), sample_, [](const Fragment& a, Index b) { return a.site < b; });
    for (; at != flat.end() && at->site == sample_; ++at) {
      add_piece(at->facet, &run_.flat.labels[slot(at->first)], at->size);
    }
  }

  Shared& shared_with(Index site, Index facet) {
    Stamped& at = cell_.shared_of_site[slot(site)];
    if (at.stamp != cell_.now) {
      at = {cell_.now, static_cast<Index>(cell_.shared.size())};
      cell_.shared.push_back({site, 0, 0, 0, facet});
    }
    return cell_.shared[slot(at.value)];
  }

  /// Its edges on bisectors, and where three cells meet.
  void list_shared(Piece& piece) {
    for (Index q = 0; q < piece.size; ++q) {
      const Index label = piece.labels[q];
      if (!Labels::is_site(label)) continue;
      piece.bounded = true;
      const Index in = before(piece, q), out = after(piece, q);
      --piece.euler;
      if (Labels::is_site(in)) {
        ++piece.euler;
        if (is_ours(in) && is_ours(label)) {
          const auto [low, high] = std::minmax(in, label);
          cell_.triples.push_back(static_cast<std::uint64_t>(low) << 32 | static_cast<std::uint64_t>(high));
        }
      }
      if (!is_ours(label)) continue;
      Shared& shared = shared_with(label, piece.facet);
      ++shared.segments;
      shared.vertices += num_crossings(in, out);
    }
  }

  /// Its vertices and edges that other pieces have too: each counts in the first facet there alone, and at edges that separate
  /// in each. The pieces beyond are joined to it.
  void join_piece(Index p) {
    Piece& piece = cell_.pieces[slot(p)];
    for (Index q = 0; q < piece.size; ++q) {
      const Index label = piece.labels[q];
      if (Labels::is_site(label)) continue;
      const std::size_t corner = 3 * slot(piece.facet) + slot(Labels::mesh_edge(label));
      const Index in = before(piece, q), out = after(piece, q);
      if (!Labels::is_site(in) && checker_.starts_fan_[corner] != 0) ++piece.euler;
      const Side& side = checker_.sides_[corner];
      if (side.first || side.kind == kSeparating) piece.euler += num_crossings(in, out) - 1;
      if (side.kind != kPlain) piece.bounded = true;
      if (!side.first) {
        ++num_later_;
        continue;
      }
      add_crossing(in, side.kind);
      add_crossing(out, side.kind);
      if (side.kind == kPlain) {
        const Index other = match(piece, q, side.across, side.k, side.opposite);
        if (other != kNone) unite(cell_.parents, p, other);
      } else {
        join_at_special_edge(p, q);
      }
    }
  }

  /// A point where what this cell shares with another one meets an edge of the mesh.
  void add_crossing(Index label, std::uint8_t kind) {
    if (!Labels::is_site(label) || !is_ours(label)) return;
    Shared& shared = cell_.shared[slot(cell_.shared_of_site[slot(label)].value)];
    ++shared.vertices;
    if (kind != kPlain) ++shared.at_curves;
  }

  /// The piece in another facet that has the same part of an edge; kNone: there is none.
  Index match(const Piece& piece, Index q, Index facet, int k, bool opposite) {
    const Stamped& at = cell_.piece_of_facet[slot(facet)];
    if (at.stamp == cell_.now) {
      const Piece& other = cell_.pieces[slot(at.value)];
      Index r = 0;
      while (r < other.size && other.labels[r] != Labels::mesh_edge_label(k)) ++r;
      if (r < other.size) {
        Index in = before(other, r), out = after(other, r);
        if (opposite) std::swap(in, out);
        if (end_name(before(piece, q)) == end_name(in) && end_name(after(piece, q)) == end_name(out)) {
          ++num_matched_;
          return at.value;
        }
      }
    }
    if (disagreement_ == kNone || piece.facet < disagreement_) disagreement_ = piece.facet;
    return kNone;
  }

  /// Edge q of piece p, in the first facet at a special edge.
  void join_at_special_edge(Index p, Index q) {
    const Piece& piece = cell_.pieces[slot(p)];
    const int k = Labels::mesh_edge(piece.labels[q]);
    const std::size_t e = edges_.edge(piece.facet, k);
    const MeshEdge edge = edges_[e];
    const Index in = before(piece, q), out = after(piece, q);
    for (const EdgeSide* side = edge.begin() + 1; side < edge.end(); ++side) {
      const Index other = match(piece, q, side->facet, side->k, side->forward != edge[0].forward);
      if (other != kNone) (checker_.flood_.is_cut(e) ? cell_.curve_joins : cell_.joins).push_back({p, other});
      added_copies_ += num_crossings(in, out) - 1;
    }
    const Triangles& triangles = edges_.triangles();
    cell_.curve_parts.push_back({{Labels::is_site(in) ? kNone : triangles(piece.facet, k),
                                  Labels::is_site(out) ? kNone : triangles(piece.facet, (k + 1) % 3)},
                                 static_cast<Index>(edge.size()),
                                 piece.facet});
    if (run_.samples.curve_of_edge == nullptr || run_.samples.curve_of_edge->empty()) return;
    const Index curve = (*run_.samples.curve_of_edge)[e];
    if (curve == kNone || run_.samples.may_own(sample_, curve)) return;
    fail(TopologyFailureKind::kForeignCurve, piece.facet, curve);
  }

  void check_pieces() {
    std::vector<Piece>& pieces = cell_.pieces;
    const Index facet = pieces.front().facet;
    const auto n = static_cast<Index>(pieces.size());
    Index euler = 0, num_pieces = 0;
    bool disks = true;
    // Roots are the smallest of their sets: going down, all others have come before.
    for (Index p = n - 1; p >= 0; --p) {
      Piece& piece = pieces[slot(p)];
      euler += piece.euler;
      const Index root = root_of(cell_.parents, p);
      if (root != p) {
        pieces[slot(root)].bounded = pieces[slot(root)].bounded || piece.bounded;
        pieces[slot(root)].euler += piece.euler;
        euler -= piece.euler;
        continue;
      }
      ++num_pieces;
      disks = disks && piece.euler == 1 && piece.bounded;
    }
    if (!disks) fail(TopologyFailureKind::kNotADisk, facet);
    for (const auto& [a, b] : cell_.joins) num_pieces -= unite(cell_.parents, a, b) ? 1 : 0;
    if (num_pieces != checker_.num_sectors(run_.samples.place(sample_))) fail(TopologyFailureKind::kPieces, facet);
    if (cell_.curve_parts.empty()) return;
    if (!is_tree_of_curves()) fail(TopologyFailureKind::kCurve, cell_.curve_parts.front().facet);
    if (!is_contractible(euler, num_pieces)) fail(TopologyFailureKind::kPieces, facet);
  }

  /// Is what the cell has of special edges one tree, with at most one corner? A corner is a vertex from which other than two
  /// special edges go, or two of different numbers of facets: with two of them a curve would be a point in the dual. A tree by
  /// V − E; a circle beside a tree is the border of a piece that is apart from all others, or of one that is no disk.
  bool is_tree_of_curves() {
    auto& ends = cell_.curve_ends;
    ends.clear();
    for (const CurvePart& part : cell_.curve_parts) {
      for (const Index v : part.ends) {
        if (v != kNone) ends.push_back({v, part.num_facets});
      }
    }
    std::size_t vertices = 2 * cell_.curve_parts.size() - ends.size(), corners = 0;
    std::sort(ends.begin(), ends.end());
    for (std::size_t i = 0, next = 0; i < ends.size(); i = next) {
      while (next < ends.size() && ends[next][0] == ends[i][0]) ++next;
      ++vertices;
      if (next - i != 2 || ends[i][1] != ends[i + 1][1]) ++corners;
    }
    return vertices == cell_.curve_parts.size() + 1 && corners <= 1;
  }

  /// Of a cell with curves: do its pieces, all of them disks, hang together at the tree of its curves, each at one path of it?
  /// By the whole cell's characteristic: at the sum of the pieces' ones each vertex and edge at which pieces are apart has been
  /// counted in each of them.
  bool is_contractible(Index euler, Index num_pieces) {
    auto& corners = cell_.corners;
    corners.clear();
    Index fans = 0, vertices = 0;
    for (Index p = 0; p < static_cast<Index>(cell_.pieces.size()); ++p) {
      const Piece& piece = cell_.pieces[slot(p)];
      for (Index q = 0; q < piece.size; ++q) {
        if (Labels::is_site(piece.labels[q]) || Labels::is_site(before(piece, q))) continue;
        const int k = Labels::mesh_edge(piece.labels[q]);
        fans += checker_.starts_fan_[3 * slot(piece.facet) + static_cast<std::size_t>(k)];
        corners.push_back({edges_.triangles()(piece.facet, k), p});
      }
    }
    std::sort(corners.begin(), corners.end());
    for (const auto& [a, b] : cell_.curve_joins) num_pieces -= unite(cell_.parents, a, b) ? 1 : 0;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      if (i > 0 && corners[i][0] == corners[i - 1][0]) {
        num_pieces -= unite(cell_.parents, corners[i - 1][1], corners[i][1]) ? 1 : 0;
      } else {
        ++vertices;
      }
    }
    return num_pieces == 1 && euler - added_copies_ - (fans - vertices) == 1;
  }

  /// V − E is 1 of a path or tree; of a path and a circle too, but then the circle bounds a piece of this cell that is apart,
  /// or goes round a hole in it, or comes back to a curve at another path of the same piece, which is told elsewhere.
  void check_shared() {
    for (const Shared& shared : cell_.shared) {
      if (shared.vertices - shared.segments != 1) fail(TopologyFailureKind::kSharedEdge, shared.facet, shared.site);
      if (shared.at_curves > 1) fail(TopologyFailureKind::kEdgeAtCurves, shared.facet, shared.site);
    }
  }

  void check_triples() {
    std::vector<std::uint64_t>& triples = cell_.triples;
    std::sort(triples.begin(), triples.end());
    for (std::size_t i = 1; i < triples.size(); ++i) {
      if (triples[i] != triples[i - 1] || (i > 1 && triples[i] == triples[i - 2])) continue;
      constexpr std::uint64_t kLow = 0xffffffffu;
      fail(TopologyFailureKind::kTriple, kNone, static_cast<Index>(triples[i] >> 32), static_cast<Index>(triples[i] & kLow));
    }
  }

  const TopologyChecker& checker_;
  const SurfaceEdges& edges_;
  const RestrictedPowerDiagram& diagram_;
  const Run& run_;
  Scratch& cell_;
  std::vector<TopologyFailure>& failures_;
  Index sample_ = kNone;
  Index disagreement_ = kNone;  ///< the least facet
  Index num_later_ = 0;         ///< parts of edges in others than the first facet there
  Index num_matched_ = 0;       ///< of these, found again in the first one
  Index added_copies_ = 0;      ///< what special edges add to V − E in others than the first facet there
};

TopologyCertificate TopologyChecker::check(const RestrictedPowerDiagram& diagram, const TopologySamples& samples,
                                           const Execution& execution) const {
  const Execution run = execution.start("checking the topology");
  const FlatFragments flat = FlatDivider(*this, diagram)(run);
  const Run what{diagram, samples, flat, true};
  std::vector<TopologyFailure> failures;
  for (const Index facet : flat.undecided) {
    failures.push_back({TopologyFailureKind::kUndecided, kNone, kNone, kNone, facet});
  }
  if (diagram.reach_lists() != nullptr) {
    Ticker ticker(run.part(0, 0.1), slot(mesh_.num_facets()), kEdgesPerLook);
    for (Index facet = 0; facet < mesh_.num_facets(); ++facet) {
      ticker.tick();
      if (!diagram.local(facet) || !flood_.edges().counts(facet)) continue;
      const Index f = diagram.first_of_facet(facet);
      if (f != kNone && diagram.polygon(f).site == kNone) {
        failures.push_back({TopologyFailureKind::kUncovered, kNone, kNone, kNone, facet});
      }
    }
  }
  // A few pieces a worker: each has a scratch of its own.
  constexpr std::size_t kPiecesPerWorker = 4, kCellsPerPiece = 512;
  const std::size_t n = slot(diagram.num_sites());
  const std::size_t wanted = run.workers() == 1 ? 1 : kPiecesPerWorker * run.workers();
  const std::size_t grain = std::max(kCellsPerPiece, (n + wanted - 1) / wanted);
  std::vector<std::vector<TopologyFailure>> found((n + grain - 1) / grain);
  std::vector<Index> cells(found.size(), 0);
  const Execution checking = run.part(0.1, 1);
  WorkCounter done(checking, n);
  parallel_for(n, grain, checking, [&](std::size_t begin, std::size_t end) {
    Scratch scratch;
    CellCheck check_cell(*this, what, scratch, found[begin / grain]);
    constexpr std::size_t kCornersPerLook = 1 << 15;
    std::size_t corners = 0, told = begin;
    for (std::size_t s = begin; s < end; ++s) {
      if (diagram.removed(static_cast<Index>(s))) continue;
      const std::size_t looked_at = check_cell(static_cast<Index>(s));
      corners += looked_at + 1;
      cells[begin / grain] += looked_at > 0 ? 1 : 0;
      if (corners < kCornersPerLook) continue;
      done.add(s + 1 - told);
      told = s + 1;
      corners = 0;
    }
    done.add(end - told);
  });
  Index num_cells = 0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    failures.insert(failures.end(), found[i].begin(), found[i].end());
    num_cells += cells[i];
  }
  TopologyCertificate result = certificate_of(num_cells, std::move(failures));
  run.finish();
  return result;
}

TopologyCertificate TopologyChecker::check(const RestrictedPowerDiagram& diagram, const TopologySamples& samples,
                                           const std::vector<Index>& cells, Scratch& scratch) const {
  const FlatFragments flat = FlatDivider(*this, diagram)({});
  const Run what{diagram, samples, flat, false};
  std::vector<TopologyFailure> failures;
  CellCheck check_cell(*this, what, scratch, failures);
  Index num_cells = 0;
  for (const Index s : cells) {
    if (diagram.removed(s)) continue;
    num_cells += check_cell(s) > 0 ? 1 : 0;
  }
  return certificate_of(num_cells, std::move(failures));
}

}  // namespace detail

}  // namespace amps
