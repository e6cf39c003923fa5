// topology_certificate.h: does the mesh dual to a restricted power diagram have the topology of the surface, curves included?
// Decided by integers alone, cell by cell.
//
// Edelsbrunner & Shah, "Triangulating topological spaces", 1997: where every cell is a disk, two cells share one path or
// nothing, three at most one point, and all of these meet the boundary as they should, the dual is homeomorphic to the surface.
// Where we go further: a surface may have curves that floods do not cross, and edges of three or more facets. The fragments of
// the diagram make a cell complex, whose vertices have names (a vertex of the mesh, a mesh edge and the site beyond a bisector,
// a facet and two sites): components and Euler characteristics are counted from these, never from coordinates.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"
#include "amps/reach.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <iosfwd>
#include <tuple>
#include <vector>

namespace amps {

/// What is wrong at a cell. In what follows curves are also all edges of the surface without exactly two facets.
enum class TopologyFailureKind {
  kUncovered,     ///< a part of the surface is in the disk of no sample
  kNoCell,        ///< a sample that others do not hide owns nothing of the surface
  kDisagreement,  ///< the facets at an edge are divided differently there
  kUndecided,     ///< nothing tells who owns a facet without area
  kPieces,        ///< a cell has other pieces than the surface has at its sample
  kNotADisk,      ///< a piece of a cell is no disk: it has a hole or a handle, or no boundary
  kSharedEdge,    ///< what two cells share is not one path
  kEdgeAtCurves,  ///< what two cells share meets curves more than once
  kTriple,        ///< three cells meet more than once
  kCurve,         ///< what a cell has of curves is not one path, or one tree around one corner
  kForeignCurve,  ///< a cell has a part of a curve that its sample is not on
};
inline constexpr std::size_t kNumTopologyFailureKinds = 11;

/// In words, such as "uncovered".
AMPS_EXPORT const char* name_of(TopologyFailureKind kind) noexcept;

struct TopologyFailure {
  TopologyFailureKind kind;
  Index sample = kNone;  ///< whose cell it is; of several samples the least; kNone: no one's
  Index other = kNone;   ///< the second one of kSharedEdge, kEdgeAtCurves and kTriple; of kForeignCurve the curve
  Index third = kNone;   ///< the third one of kTriple
  Index facet = kNone;   ///< where; kNone: not known
  bool operator<(const TopologyFailure& b) const { return tied() < b.tied(); }
  bool operator==(const TopologyFailure& b) const { return tied() == b.tied(); }

 private:
  std::tuple<TopologyFailureKind, Index, Index, Index, Index> tied() const { return {kind, sample, other, third, facet}; }
};
/// In a sentence.
AMPS_EXPORT std::ostream& operator<<(std::ostream& out, const TopologyFailure& failure);

/// The dual triangles, without triples met an even number of times, are homeomorphic to the surface if this holds: to the
/// surface whose fans at a vertex are apart where no sample that owns them is at that vertex. Curves are then edges of the
/// dual.
struct TopologyCertificate {
  Index cells = 0;                                            ///< looked at: samples that own something of the surface
  std::array<Index, kNumTopologyFailureKinds> failures_of{};  ///< by kind
  std::vector<TopologyFailure> failures;                      ///< all of them, sorted, each once
  bool holds() const { return failures.empty(); }
  Index num_failures(TopologyFailureKind kind) const { return failures_of[static_cast<std::size_t>(kind)]; }
};
AMPS_EXPORT std::ostream& operator<<(std::ostream& out, const TopologyCertificate& certificate);

namespace detail {

/// What the certificate asks about samples.
struct TopologySamples {
  /// Where a sample is: its barycentric coordinates that are 0 say in which facets. Facet kNone: inside of some facet.
  std::function<SurfacePoint(Index sample)> place;
  /// By edge of SurfaceEdges the curve it belongs to, or kNone; null: no edge belongs to any.
  const std::vector<Index>* curve_of_edge = nullptr;
  /// May the sample own a part of the curve? Needed where there are curves.
  std::function<bool(Index sample, Index curve)> may_own;
  /// Are all fragments known to be covered by their owners, exactly? Then nobody looks again, a sixth of the time.
  bool covered = false;
};

/// Certifies diagrams of one surface. Const once it is made, and thread-safe where each thread has a Scratch of its own.
/// 28 bytes a facet. Facets without area have no fragments in the diagram; they get some here, from those beside them.
class TopologyChecker {
 public:
  /// `flood`: of this mesh; curves are the edges that it has cut, and those without exactly two facets. It must outlive this,
  /// as the mesh's buffers. `fans`: corner_fans() of its edges, none cut, if they are there already. O(#V + #F).
  TopologyChecker(const MeshView& mesh, const SurfaceFlood& flood, const Execution& execution = {},
                  const std::vector<std::size_t>* fans = nullptr);

  /// Memory of one thread: 8 bytes a facet and 8 a site.
  class Scratch;

  /// Of the whole diagram, which is of the same mesh. O(#fragments), some 20 ns a corner, split by sites over the threads with
  /// the same result for any number. Throws Error(kCancelled).
  TopologyCertificate check(const RestrictedPowerDiagram& diagram, const TopologySamples& samples,
                            const Execution& execution = {}) const;

  /// Of these cells alone, and what they share with others: after an edit those of changed_sites(). `cells`: each once; removed
  /// sites are passed over. A facet that nobody reaches is nobody's cell: its neighbours disagree with it. O(what these cells
  /// have, and the number of facets without area).
  TopologyCertificate check(const RestrictedPowerDiagram& diagram, const TopologySamples& samples,
                            const std::vector<Index>& cells, Scratch& scratch) const;

 private:
  /// A side of a facet. Its edge is plain if it has two facets and is not cut, else special.
  struct Side {
    Index across = kNone;   ///< plain: the facet behind it
    std::uint8_t k = 0;     ///< plain: its side of that facet
    std::uint8_t kind = 0;  ///< kPlain; special: kBorder, which separates nothing, or kSeparating
    bool first = false;     ///< is the facet the first one at the edge?
    bool opposite = false;  ///< plain: do both facets traverse the edge in opposite directions?
  };

  /// Corners in a line.
  struct FlatFacet {
    Index facet;
    int middle;  ///< the corner between the two others
  };

  /// Fragments of facets without area: cycles of labels as the diagram has them, those of a site one after another.
  struct FlatFragments {
    struct Fragment {
      Index site, facet, first, size;
    };
    std::vector<Fragment> fragments;
    std::vector<Index> labels;
    std::vector<Index> undecided;  ///< facets
  };

  /// The fragment of a cell in one facet.
  struct Piece {
    Index facet;
    const Index* labels;
    Index size;
    Index euler;   ///< what it adds to V − E + F where it lies in a piece cut open along curves
    bool bounded;  ///< has it an edge that is not inside of the cell?
  };
  /// What a cell shares with another one.
  struct Shared {
    Index site;
    Index vertices, segments;
    Index at_curves;  ///< points on curves
    Index facet;
  };
  /// What a cell has of a special edge.
  struct CurvePart {
    std::array<Index, 2> ends;  ///< surface vertices; kNone: the bisector with another site
    Index num_facets;           ///< at the edge
    Index facet;
  };
  struct Stamped {
    std::uint32_t stamp = 0;
    Index value = 0;
  };
  class FlatDivider;
  class CellCheck;
  struct Run;

  static constexpr std::uint8_t kPlain = 0, kBorder = 1, kSeparating = 2;

  void add_side(const EdgeSide& side, const MeshEdge& edge, std::uint8_t kind);
  void find_flat_facets(const Execution& execution);
  Index num_sectors(const SurfacePoint& at) const;

  MeshView mesh_;
  const SurfaceFlood& flood_;
  std::vector<Side> sides_;       ///< by corner
  std::vector<char> starts_fan_;  ///< by corner: is it the first one of its fan? Separating edges separate fans
  std::vector<FlatFacet> flat_;   ///< ascending
};

class TopologyChecker::Scratch {
  friend class TopologyChecker;
  std::uint32_t now = 0;
  std::vector<Stamped> piece_of_facet, shared_of_site;  ///< of the cell at hand, where the stamp is `now`
  std::vector<Piece> pieces;
  std::vector<Index> parents;  ///< disjoint sets of pieces
  std::vector<Shared> shared;
  std::vector<std::uint64_t> triples;
  std::vector<CurvePart> curve_parts;
  std::vector<std::array<Index, 2>> joins, curve_joins;  ///< pieces that meet at uncut edges of many facets, and at cut edges
  std::vector<std::array<Index, 2>> corners;             ///< surface vertex and piece
  std::vector<std::array<Index, 2>> curve_ends;          ///< surface vertex and number of facets
};

}  // namespace detail

}  // namespace amps

#include "amps/host_macros_end.h"
