// reach.h (internal): what a disk reaches. Disk i is the part of ball i and surface that is joined to its centre within the
// ball. A ball has one convex piece of a facet, so a facet has all of its part of the ball in the disk, or nothing: a disk is a
// ball and a set of facets. A flood finds the set, from the facets at the centre over every edge that the ball meets, whatever
// the number and orientation of the facets there. Balls are closed: touching is meeting. Edges may be cut: no flood crosses
// them. Decisions are exact.
//
// Laws, for one set of cut edges:
//   1. If an edge that is not cut meets the ball, all or none of its facets are reached.
//   2. Facets at the centre are reached, whatever the weight.
//   3. A greater ball of the same centre reaches no less.
// Facets that meet in nothing but a vertex are not joined there, nor facets that cross. Facets without area (collinear corners)
// are facets like others. What SurfaceEdges leaves out is never reached.
#pragma once

#include "amps/base.h"
#include "amps/execution.h"
#include "amps/mesh.h"
#include "amps/mesh_edges.h"
#include "amps/samples.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace amps::detail {

/// A point and the facets that it lies in: more than one on edges and at vertices.
struct PlacedPoint {
  Vec3 position = Vec3::Zero();
  std::vector<Index> homes;  ///< ascending, all of which count; empty: the point is no part of the surface
};

/// The floods of one surface. Const once it is made, and thread-safe where each thread has a Scratch of its own. 50 bytes a
/// facet beside the SurfaceEdges. A value.
class SurfaceFlood {
 public:
  /// `cut`: flags by edge; empty: none is cut. Coordinates must be finite. Throws Error(kInvalidArgument) if there is not one
  /// flag an edge, Error(kTooLarge) for more than 2^31 − 1 corners. O(#V + #F).
  SurfaceFlood(const MeshView& mesh, SurfaceEdges edges, std::vector<char> cut = {}, const Execution& run = {});

  const SurfaceEdges& edges() const { return edges_; }
  bool is_cut(std::size_t edge) const { return !cut_.empty() && cut_[edge] != 0; }
  /// Flags by edge; empty: none is cut.
  const std::vector<char>& cut() const { return cut_; }
  /// Of a surface vertex.
  Vec3 position(Index vertex) const { return Eigen::Map<const Vec3>(&positions_[3 * slot(vertex)]); }

  // Facets that a point lies in, whatever is cut; ascending, without facets that do not count.

  /// Of a point of any facet, by the barycentric coordinates that are not exactly 0: of three corners the facet, of two all
  /// facets at their edge, of one all facets at that vertex. Corners of equal position are one. In place of a facet that is
  /// there already, the one that counts. Empty where a facet has collapsed to a segment that is no edge, or to a point at no
  /// facet. O(facets at a corner).
  std::vector<Index> homes(const SurfacePoint& at) const;
  std::vector<Index> homes_of_edge(std::size_t edge) const;
  /// Of a surface vertex.
  std::vector<Index> homes_of_vertex(Index vertex) const;

  /// Memory of floods, of one thread: 4 bytes a facet, and 8 more once bottleneck() was called. May serve several surfaces.
  class Scratch {
   public:
    /// Floods look whether `watched` is cancelled every millisecond or so, and then throw Error(kCancelled).
    explicit Scratch(Execution watched = {}) : watched_(std::move(watched)) {}

   private:
    friend class SurfaceFlood;
    void start(std::size_t num_facets, std::size_t num_shared);
    bool is_marked(Index facet) const { return facet_mark_[slot(facet)] == now_; }
    /// False if it was.
    bool mark(Index facet) {
      if (is_marked(facet)) return false;
      facet_mark_[slot(facet)] = now_;
      return true;
    }
    bool is_marked_shared(Index number) const { return shared_mark_[slot(number)] == now_; }
    void mark_shared(Index number) { shared_mark_[slot(number)] = now_; }

    Execution watched_;
    std::uint32_t now_ = 0;
    std::vector<std::uint32_t> facet_mark_, shared_mark_;  ///< equal to now_: seen by this flood
    std::vector<Index> reached_;
    std::vector<double> radius_;
    std::vector<std::pair<double, Index>> heap_;
  };

  /// The facets that the disk around `centre` of squared radius `weight` reaches, ascending, in place of what `facets` had.
  /// `homes`: facets that count, where it starts. O(k log k) for k facets, some 20 to 40 ns each.
  void flood(const Vec3& centre, double weight, const std::vector<Index>& homes, Scratch& scratch,
             std::vector<Index>& facets) const;

  /// Does the disk around `from` hold `to`: is that in the closed ball, and one of its homes reached? O(k).
  bool holds(const PlacedPoint& from, double weight, const PlacedPoint& to, Scratch& scratch) const;

  /// The least radius at which the disk around `from` holds `to`, rounded down: infinite if holds(from, limit², to) is false.
  /// Else a radius R < limit (0 for points of one position) such that holds(from, w, to) is false for all w ≤ R·R, as doubles
  /// multiply. The exact one is at most 2^-40·(R + l) above, l the longest edge that the disk of radius `limit` meets. `limit`²
  /// is finite. O(k log k), k the facets that the disk of radius `limit` reaches.
  double bottleneck(const PlacedPoint& from, const PlacedPoint& to, double limit, Scratch& scratch) const;

 private:
  /// A facet for floods. across[k], at side k: the facet behind it; kNone: none, or the edge is cut; below that, the number of
  /// an edge of three or more facets, as kNone − 1 − number.
  struct Links {
    std::array<Index, 3> vertex;
    std::array<Index, 3> across;
  };
  static constexpr bool is_shared(Index across) { return across < kNone; }
  static constexpr Index shared_number(Index across) { return kNone - 1 - across; }

  const double* at(Index vertex) const { return &positions_[3 * slot(vertex)]; }
  template <class Visit>
  void spread(const Vec3& centre, double weight, const std::vector<Index>& homes, Scratch& scratch, std::vector<Index>& facets,
              const Visit& visit) const;
  void facets_at(Index vertex, Index other, std::vector<Index>& facets) const;
  double radius_of_arrival(const PlacedPoint& from, const PlacedPoint& to, Scratch& scratch) const;

  SurfaceEdges edges_;
  std::vector<char> cut_;
  std::vector<double> positions_;                    ///< xyzxyz… of the mesh's vertices
  std::vector<Links> links_;                         ///< by facet; of one that does not count, of no use
  std::vector<Index> shared_begin_, shared_facets_;  ///< facets of each edge of three or more that is not cut
  std::vector<Index> vertex_begin_, vertex_facets_;  ///< facets of each vertex that count, ascending
};

/// Which facets each sample reaches: ascending and contiguous. Numbers of samples may be given anew once they are removed. 4
/// bytes a pair of sample and facet, as much again after many edits; room of removed samples is used again. A value.
class ReachLists {
 public:
  /// Facets of a sample; valid until the next edit.
  struct Facets {
    const Index* first;
    const Index* last;
    const Index* begin() const { return first; }
    const Index* end() const { return last; }
    std::size_t size() const { return static_cast<std::size_t>(last - first); }
    bool empty() const { return first == last; }
    Index operator[](std::size_t k) const { return first[k]; }
  };

  /// Makes room for lists of so many samples, that are as long as those there are by now on average.
  void reserve(std::size_t num_samples);

  /// A sample that has no list gets one; `facets` ascending, each once. O(k). Throws Error(kTooLarge) beyond 2^31 − 1 pairs.
  void add(Index sample, const std::vector<Index>& facets);
  /// The list of a sample that has one is another one now; false if it is the same. O(k).
  bool replace(Index sample, const std::vector<Index>& facets);
  /// The sample has no list any more. O(1) amortised.
  void remove(Index sample);

  bool has(Index sample) const { return slot(sample) < runs_.size() && runs_[slot(sample)].size >= 0; }
  /// Of a sample that has a list.
  Facets facets(Index sample) const {
    const Run& run = runs_[slot(sample)];
    const Index* const first = facets_.data() + run.begin;
    return {first, first + run.size};
  }
  /// Of a sample that has a list. O(log k).
  bool reaches(Index sample, Index facet) const;

  /// Pairs of a sample and a facet that it reaches.
  std::size_t size() const { return facets_.size() - unused_; }
  /// Pairs that there is memory for: no more than twice as many, or a few.
  std::size_t capacity() const { return facets_.size(); }

 private:
  struct Run {
    Index begin = 0;
    Index size = -1;  ///< −1: the sample has no list
  };
  Index take_run(std::size_t size);
  void release(Run& run);
  void compact();

  std::vector<Run> runs_;              ///< by sample
  std::vector<Index> facets_;          ///< by pair: runs of pairs of one sample
  std::vector<Index> unused_of_size_;  ///< first unused run of each size, linked by what is at its first pair
  std::size_t unused_ = 0;             ///< pairs of unused runs
};

}  // namespace amps::detail
