// trial_patch.h (internal): the dual triangles around a few samples, to try a refill on without touching the diagram.
//
// The patch holds triangles as triples, and rates them. A sample leaves, and the polygon of its neighbours is filled; a sample
// comes, and the triangles whose dual point is nearer to it than to their corners make way (Bowyer 1981; Watson 1981), just as
// in the restricted power diagram, but that here the dual point lies in the plane of the triangle and not on the surface, and
// decisions are made in doubles. So the patch is right up to curvature over one triangle and near-ties: it tells what is worth
// doing, not what is true.
#pragma once

#include "amps/base.h"
#include "amps/dual_star.h"

#include <array>
#include <cstdint>

namespace amps::detail {

/// Triangles around some samples. A value; copying costs as much as it holds.
class TrialPatch {
 public:
  static constexpr int kMaxVertices = 64;
  static constexpr int kMaxTriangles = 192;
  static constexpr int kMaxRing = 16;  ///< neighbours of a vertex that can be removed

  explicit TrialPatch(const DualRating& rating) : rating_(&rating) {}
  TrialPatch(const TrialPatch& other) { *this = other; }
  TrialPatch& operator=(const TrialPatch& other);

  void clear() { num_vertices_ = num_triangles_ = 0; }

  /// A sample with this many neighbours in all; `rated`: its valence counts. False if there is no room.
  bool add_vertex(const Vec3& x, double weight, int neighbors, bool rated);
  /// A dual triangle, each once. False if there is no room.
  bool add_triangle(int a, int b, int c);
  /// To be called when all are there: edges of one triangle are the patch's border, and no change may reach over it.
  void close();

  int num_vertices() const { return num_vertices_; }
  const Vec3& position(int v) const { return position_[static_cast<std::size_t>(v)]; }
  double weight(int v) const { return weight_[static_cast<std::size_t>(v)]; }

  // Both return false where the patch cannot follow; it is of no use then.

  /// Takes a vertex out whose triangles form a disk.
  bool remove(int v);
  /// Puts a sample in.
  bool insert(const Vec3& x, double weight);

  /// Of all triangles and rated valences.
  double energy() const;
  /// True if a dual point is not covered, by more than a hundredth of the weight: then the set is not maximal.
  bool has_gap() const;

 private:
  struct Triangle {
    Vec3 dual;
    double power;  ///< of the dual point; > 0: not covered
    double
        rating;  ///< kNotRated where a change has made it: most of these are gone, or have left gaps, before energy() is asked
    std::array<std::uint8_t, 3> corner;
  };
  static constexpr double kNotRated = -1;

  void append(int a, int b, int c);
  double rate(const Triangle& triangle) const;
  void drop(int t);
  bool fill(const std::uint8_t* ring, int size);

  const DualRating* rating_ = nullptr;
  int num_vertices_ = 0, num_triangles_ = 0;
  std::array<Vec3, kMaxVertices> position_;
  std::array<double, kMaxVertices> weight_;
  std::array<std::int16_t, kMaxVertices> neighbors_;
  std::array<bool, kMaxVertices> rated_;
  std::array<std::uint64_t, kMaxVertices> border_;  ///< bit v of u: edge uv is on the border
  std::array<Triangle, kMaxTriangles> triangles_;
};

}  // namespace amps::detail
