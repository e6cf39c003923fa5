// dual_star.h (internal): the dual triangles around a sample, read from the restricted power diagram, and how bad they are.
#pragma once

#include "amps/base.h"
#include "amps/power_diagram.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace amps::detail {

/// An energy counts as lowered from this on; less may be rounding.
inline constexpr double kMinGain = 1e-6;

/// Law of cosines, from squared lengths: of the angle between the first two sides.
inline double corner_cosine(double beside, double other, double opposite) {
  const double product = beside * other;  // a length to the fourth
  const bool in_range = product > 1e-290 && product < 1e290;
  return (beside + other - opposite) / (2 * (in_range ? std::sqrt(product) : std::sqrt(beside) * std::sqrt(other)));
}

/// How bad a triangle or a valence is; 0: good.
class DualRating {
 public:
  /// Degrees, as OptimizeOptions.
  DualRating(bool angles, bool valences, double min_angle, double max_angle);

  /// Degrees out of bounds over the three corners, to first order in the angle, those above counting half; and 0.25 for each
  /// angle too small, 0.5 for one too large.
  double triangle(const Vec3& a, const Vec3& b, const Vec3& c) const {
    if (!angles_) return 0;
    const double la = squared_norm(b - c), lb = squared_norm(c - a), lc = squared_norm(a - b);
    return corner(lb, lc, la) + corner(lc, la, lb) + corner(la, lb, lc);
  }
  double valence(int neighbors, bool boundary) const {
    if (!valences_) return 0;
    const int max = boundary ? kMaxAtBoundary : kMaxInside;
    return kPerValence * (neighbors > max ? neighbors - max : !boundary && neighbors < kMinInside ? kMinInside - neighbors : 0);
  }

 private:
  static constexpr int kMinInside = 5;      ///< valence of an inner vertex, as the paper's
  static constexpr int kMaxInside = 7;      ///< likewise
  static constexpr int kMaxAtBoundary = 5;  ///< of a boundary vertex: angles of 45 degrees on a straight one
  /// Charged for each neighbour missing or too many: as much as that many degrees.
  static constexpr double kPerValence = 5;
  /// Charged for an angle above its bound, and half of it for one below, however little it is out of bounds.
  static constexpr double kPerBadTriangle = 0.5;
  /// An angle above its bound counts this times as much as one below.
  static constexpr double kObtuseShare = 0.5;

  double corner(double beside, double other, double opposite) const {
    const double cosine = corner_cosine(beside, other, opposite);
    if (cosine > cos_min_) return below_ * (cosine - cos_min_) + kPerBadTriangle / 2;
    if (cosine < cos_max_) return above_ * (cos_max_ - cosine) + kPerBadTriangle;
    return 0;
  }

  bool angles_, valences_;
  double cos_min_ = 1, cos_max_ = -1, below_ = 0, above_ = 0;
};

/// The neighbours of a sample in the dual triangulation, where they surround it.
struct DualStar {
  /// Samples beside those of small radii, at curves and folds, have 13 to 20 neighbours: most patches that could not be copied
  /// were theirs.
  static constexpr int kMaxSize = 24;
  std::array<Index, kMaxSize> ring;  ///< cyclic
  std::int8_t size = 0;              ///< 0: not a disk, or too large
  bool repeats = false;              ///< the cell meets two others more than once
};

/// A triangle, or a vertex (b = c = kNone), that is bad.
struct BadItem {
  Index a, b, c;
  bool is_vertex() const { return b == kNone; }
};

/// Reads dual stars as the diagram has them, one at a time, and rates them. A view: diagram and rating must outlive it.
class StarReader {
 public:
  /// Samples below `num_fixed` lie on curves: they may have any valence, and triangles of three of them any angles.
  StarReader(const RestrictedPowerDiagram& diagram, const DualRating& rating, Index num_fixed = 0)
      : diagram_(diagram), rating_(rating), num_fixed_(num_fixed) {}

  /// Whether the valence of crossings is rated; at first it is not.
  void rate_crossings(bool on) { rates_crossings_ = on; }
  bool rates_crossings() const { return rates_crossings_; }

  /// The other two corners of a triangle, the lower first.
  using Pair = std::array<Index, 2>;

  /// The triangles around s, ascending: those met an odd number of times, as the dual has them (remesh.h). Valid until the next
  /// star is read.
  const std::vector<Pair>& read(Index s);

  /// Kinds of stars. A disk: one cycle of pairs. A half disk: one path. Pinched: several cycles. A crossing: no border, but
  /// edges of more than two triangles.
  enum class Form { kDisk, kHalfDisk, kPinched, kCrossing, kOther };

  /// Of the last star read; `star` (out): its ring.
  Form form(DualStar& star);

  double triangle(Index a, Index b, Index c) const {
    if (std::max({a, b, c}) < num_fixed_) return 0;  // the input forces it
    return rating_.triangle(diagram_.site(a).position(), diagram_.site(b).position(), diagram_.site(c).position());
  }

  /// Reads s: the rating of its valence and a third of that of its triangles. `star` (out): its ring.
  double energy(Index s, DualStar& star);

  /// Reads s: is it a crossing of bad valence, whether or not these are rated?
  bool is_bad_crossing(Index s);

  /// Reads s and adds what is bad there: s itself, and triangles of which it is the lowest corner.
  void list_bad(Index s, std::vector<BadItem>& items);

 private:
  struct Ends {
    int count = 0;          ///< neighbours in one triangle only
    bool crossing = false;  ///< a neighbour is in more than two
    Index start = kNone;    ///< an end, or any neighbour where there is none
  };
  Ends count_neighbors();
  void walk(Index start, std::size_t vertices);
  double valence(Form form) const;

  const RestrictedPowerDiagram& diagram_;
  const DualRating& rating_;
  Index num_fixed_;
  bool rates_crossings_ = false;
  std::vector<Pair> pairs_;
  bool repeats_ = false;
  std::vector<Index> ring_;
  int num_neighbors_ = 0;
};

/// A star that somebody else keeps, until that changes.
struct StarView {
  const Index* ring;  ///< cyclic
  int size;           ///< 0: not a disk, or too large
  bool repeats;       ///< the cell meets two others more than once

  StarView(const Index* its_ring, int its_size, bool its_repeats) : ring(its_ring), size(its_size), repeats(its_repeats) {}
  StarView(const DualStar& star) : StarView(star.ring.data(), star.size, star.repeats) {}
};

/// Stars by sample, in 40 bytes each where they have up to nine neighbours, as nearly all have. Const members may be called
/// concurrently, as may set_small() for different samples.
class StarTable {
 public:
  std::size_t size() const { return stars_.size(); }
  void reserve(std::size_t samples) { stars_.reserve(samples); }
  void resize(std::size_t samples) {
    // Mostly it grows by little.
    if (samples > stars_.capacity()) stars_.reserve(samples + samples / 8);
    stars_.resize(samples);
  }

  StarView operator[](std::size_t s) const {
    const Small& star = stars_[s];
    return star.size == kLarge ? StarView(large_[slot(star.ring[0])]) : StarView(star.ring.data(), star.size, star.repeats);
  }
  void set(std::size_t s, const StarView& star) {
    Small& old = stars_[s];
    if (old.size == kLarge) free_.push_back(old.ring[0]);
    if (set_small(s, star)) return;
    if (free_.empty()) {
      free_.push_back(static_cast<Index>(large_.size()));
      large_.emplace_back();
    }
    old.size = kLarge;
    old.ring[0] = free_.back();
    free_.pop_back();
    DualStar& kept = large_[slot(old.ring[0])];
    std::copy_n(star.ring, star.size, kept.ring.begin());
    kept.size = static_cast<std::int8_t>(star.size);
    kept.repeats = star.repeats;
  }
  /// False, and the star is empty, if this one is larger. The one before was not.
  bool set_small(std::size_t s, const StarView& star) {
    Small& kept = stars_[s];
    const bool fits = star.size <= kSmallSize;
    kept.size = static_cast<std::int8_t>(fits ? star.size : 0);
    kept.repeats = star.repeats;
    std::copy_n(star.ring, kept.size, kept.ring.begin());
    return fits;
  }

 private:
  static constexpr int kSmallSize = 9;
  static constexpr std::int8_t kLarge = -1;

  struct Small {
    std::array<Index, kSmallSize> ring{};  ///< or where it is in large_
    std::int8_t size = 0;
    bool repeats = false;
  };

  std::vector<Small> stars_;
  std::vector<DualStar> large_;
  std::vector<Index> free_;  ///< of large_, not used
};

/// Stars and energies by sample, as they were last read. Energies of all samples sum to that of the triangulation.
struct DualStars {
  StarTable star;
  std::vector<double> energy;

  void resize(std::size_t samples) {
    star.resize(samples);
    energy.resize(samples);
  }
  void read(StarReader& reader, Index s) {
    DualStar fresh;
    energy[slot(s)] = reader.energy(s, fresh);
    star.set(slot(s), fresh);
  }
};

/// The same of the samples that an edit affects, by their place among these.
struct AffectedStars {
  std::vector<DualStar> star;
  std::vector<double> energy;

  void resize(std::size_t samples) {
    star.resize(samples);
    energy.resize(samples);
  }
};

/// The least and the greatest of angles; kept as cosines.
class AngleRange {
 public:
  /// The corners of a triangle.
  void add(const Vec3& x, const Vec3& y, const Vec3& z);
  /// Degrees; 0 if there was no triangle.
  double min_angle() const { return empty() ? 0 : degrees(max_cosine_); }
  double max_angle() const { return empty() ? 0 : degrees(min_cosine_); }

 private:
  bool empty() const { return max_cosine_ < min_cosine_; }
  static double degrees(double cosine);
  double min_cosine_ = 2, max_cosine_ = -2;
};

}  // namespace amps::detail
