// mesh_scale.h (internal): coordinates of any magnitude behave as those at 1. Whoever computes with a mesh whose largest
// coordinate is far from 1 does so with a copy, times a power of two, and gives back what it found, divided by that: the bits
// are those of the same mesh at 1. Where the scale does not ask for it there is no copy.
//
// What is computed from coordinates x has degree 8 in them at most (the side of a bisector at a crossing of two others, squared
// for its error), and filters of predicates hold while differences to the square lie in [kFilterMin, kFilterMax], 2^±166.
// Within 2^±kSafeExponent neither overflows, and what is lost below the least double, 2^-1074, is less than 2^-600 of the rest.
#pragma once

#include "amps/base.h"
#include "amps/buffers.h"
#include "amps/mesh.h"

#include <string>
#include <vector>

namespace amps::detail {

/// The power of two that a call computes in units of; 1 wherever the largest coordinate lies within 2^±kSafeExponent. A value.
///
/// Multiplying by it is exact but at the ends of doubles: coordinates below 2^-1074 of the largest become 0, and so do lengths,
/// but for the least one; coordinates of unused vertices that would overflow become the largest double. On the way back, what
/// is below the least normal double is rounded, and what is above the largest one is infinite.
class MeshScale {
 public:
  /// The least range in which a mesh of the least doubles, 2^-1074, fits once it is scaled by 2^1022.
  static constexpr int kSafeExponent = 53;

  MeshScale() = default;
  /// Of the vertices that facets use; those that are not finite, and facets with indices out of range, do not count.
  /// O(#V + #F), some 0.1 ms for 10⁵ facets.
  explicit MeshScale(const MeshView& mesh);
  /// One for both.
  MeshScale(const MeshView& first, const MeshView& second);
  /// Of all points.
  explicit MeshScale(const PointsView& points);
  /// Of a length.
  static MeshScale of_length(double length);

  bool is_one() const { return exponent_ == 0; }
  /// This in units of the other.
  MeshScale in(const MeshScale& other) const { return MeshScale(exponent_ - other.exponent_); }
  double unit() const { return unit_; }

  /// What `call` returns, which computes in our units: its errors say so, since lengths in them are no others.
  template <class Call>
  auto in_our_units(const Call& call) const {
    try {
      return call();
    } catch (const Error& error) {
      if (error.code() == ErrorCode::kCancelled) throw;
      throw Error(error.code(), std::string(error.what()) + " (lengths here in units of 2^" + std::to_string(exponent_) + ")");
    }
  }

  /// Into our units: a coordinate; a length, of which none but 0 becomes 0.
  double coordinate(double x) const;
  double length(double x) const;
  Vec3 point(const Vec3& x) const { return {coordinate(x[0]), coordinate(x[1]), coordinate(x[2])}; }
  Points points(const PointsView& points) const;
  std::vector<double> lengths(const std::vector<double>& lengths) const;
  Mesh mesh(const MeshView& mesh) const;

  /// And back again.
  double length_back(double x) const { return x * unit_; }
  double area_back(double x) const { return (x * unit_) * unit_; }
  void back(double& length) const { length *= unit_; }
  void back(std::vector<double>& lengths) const;
  void back(Points& points) const;

 private:
  explicit MeshScale(int exponent);
  static int exponent_for(double largest);

  int exponent_ = 0;
  double unit_ = 1, inverse_ = 1;
};

}  // namespace amps::detail
