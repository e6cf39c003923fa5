// refill.h (internal): what optimisation knows of the dual triangulation around a sample, and how it finds refills worth
// carrying out. Nothing here changes anything: many may look at once.
#pragma once

#include "amps/base.h"
#include "amps/gaps.h"
#include "amps/mesh.h"
#include "amps/power_diagram.h"
#include "amps/samples.h"
#include "amps/sizing.h"
#include "amps/trial_patch.h"
#include "amps/wanted_radii.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace amps::detail {

/// Of an energy, against rounding.
inline constexpr double kLeastGain = 1e-6;
/// Trials count this for a sample more, and less for a sample fewer: halves the growth of sets, at no cost in time. With 5,
/// tight bounds take twice the time.
inline constexpr double kPerSample = 2;
/// Darts in the pool of a patch, and thrown for it at most, for each sample it loses; and darts in any pool at most.
inline constexpr std::size_t kPoolPerSample = 12, kMostPool = 96;
inline constexpr int kPoolDartsPerSample = 110;

/// The neighbours of a sample in the dual triangulation.
struct DualStar {
  static constexpr int kMost = 12;
  std::array<Index, kMost> ring;  ///< cyclic
  std::int8_t size = 0;           ///< 0: not a disk, or too large
};

/// A triangle, or a vertex (b = c = kNone), that is bad.
struct BadItem {
  Index a, b, c;
};

/// A sample to be.
struct NewSample {
  Vec3 x = Vec3::Zero();
  SurfacePoint at;
  double radius = 0;
};

/// What to do about a bad item.
struct Proposal {
  enum class Kind { kNothing, kRefill, kInPlace } kind = Kind::kNothing;
  std::vector<Index> removed;
  std::vector<NewSample> added;
  std::vector<Index> seen;  ///< samples it depends on
  std::uint64_t trials = 0;
};

/// Samples by id in the diagram. Ids of removed ones are used again.
struct OptimizedSet {
  std::vector<SurfacePoint> at;
  std::vector<double> radius;
  std::vector<char> alive;
  std::vector<DualStar> star;
  std::vector<double> energy;  ///< valence, and a third of its triangles
  Index size() const { return static_cast<Index>(alive.size()); }
};

/// Dual stars as the diagram has them.
class StarReader {
 public:
  StarReader(const RestrictedPowerDiagram& diagram, const DualRating& rating) : diagram_(diagram), rating_(rating) {}

  bool rate_crossings = false;

  /// Triangles around s as pairs of the other corners, lower first, ascending, each once.
  const std::vector<std::array<Index, 2>>& read(Index s) {
    pairs_.clear();
    for (Index f = diagram_.first_of_site(s); f != kNone; f = diagram_.next_of_site(f)) {
      const auto polygon = diagram_.polygon(f);
      for (Index k = 0; k < polygon.size; ++k) {
        const Index a = polygon.labels[k == 0 ? polygon.size - 1 : k - 1], b = polygon.labels[k];
        if (!RestrictedPowerDiagram::is_site(a) || !RestrictedPowerDiagram::is_site(b)) continue;
        pairs_.push_back({std::min(a, b), std::max(a, b)});
      }
    }
    std::sort(pairs_.begin(), pairs_.end());
    pairs_.erase(std::unique(pairs_.begin(), pairs_.end()), pairs_.end());
    return pairs_;
  }

  const std::vector<std::array<Index, 2>>& pairs() const { return pairs_; }

  /// Of the last star read. A disk: one cycle of pairs. A half disk: one path. Pinched: several cycles. A
  /// crossing: no border, but edges of more than two triangles.
  enum class Form { kDisk, kHalfDisk, kPinched, kCrossing, kOther };
  Form form(DualStar& star) {
    star.size = 0;
    if (pairs_.empty()) return Form::kOther;
    ring_.clear();
    for (const auto& pair : pairs_) ring_.insert(ring_.end(), {pair[0], pair[1]});
    std::sort(ring_.begin(), ring_.end());
    int ends = 0;
    bool crossing = false;
    num_neighbors_ = 0;
    Index start = pairs_.front()[0];
    for (std::size_t k = 0; k < ring_.size();) {
      std::size_t next = k;
      while (next < ring_.size() && ring_[next] == ring_[k]) ++next;
      ++num_neighbors_;
      crossing = crossing || next - k > 2;
      if (next - k == 1) {
        ++ends;
        start = ring_[k];
      }
      k = next;
    }
    if (crossing && ends == 0) return Form::kCrossing;
    if (crossing || (ends != 0 && ends != 2)) return Form::kOther;
    // Walk; what is not reached belongs to another piece.
    const std::size_t vertices = pairs_.size() + (ends == 2 ? 1 : 0);
    ring_.assign(1, start);
    std::size_t last = pairs_.size();
    for (std::size_t found = 1; ring_.size() < vertices && found != 0;) {
      found = 0;
      for (std::size_t k = 0; k < pairs_.size(); ++k) {
        if (k == last || (pairs_[k][0] != ring_.back() && pairs_[k][1] != ring_.back())) continue;
        const Index next = pairs_[k][0] == ring_.back() ? pairs_[k][1] : pairs_[k][0];
        if (next == start) continue;
        ring_.push_back(next);
        last = k;
        found = 1;
        break;
      }
    }
    if (ring_.size() != vertices) return ends == 0 ? Form::kPinched : Form::kOther;
    if (ends == 2) return Form::kHalfDisk;
    if (ring_.size() >= 3 && ring_.size() <= static_cast<std::size_t>(DualStar::kMost)) {
      std::copy(ring_.begin(), ring_.end(), star.ring.begin());
      star.size = static_cast<std::int8_t>(ring_.size());
    }
    return Form::kDisk;
  }

  double triangle(Index a, Index b, Index c) const {
    return rating_.triangle(diagram_.site(a).position(), diagram_.site(b).position(), diagram_.site(c).position());
  }
  /// Of the last star that form() was asked of.
  double valence(Form form) const {
    if (form == Form::kOther || (form == Form::kCrossing && !rate_crossings)) return 0;
    return rating_.valence(num_neighbors_, form == Form::kHalfDisk);
  }
  double energy(Index s, DualStar& star) {
    read(s);
    double sum = valence(form(star));
    for (const auto& pair : pairs_) sum += triangle(s, pair[0], pair[1]) / 3;
    return sum;
  }

 private:
  const RestrictedPowerDiagram& diagram_;
  const DualRating& rating_;
  std::vector<std::array<Index, 2>> pairs_;
  std::vector<Index> ring_;
  int num_neighbors_ = 0;
};

/// Wanted radii of new samples.
struct RefillRadii {
  SizingField field;
  double least = 0;
  double at(const SurfacePoint& x) const { return field.empty() ? least : field.radius(x); }
};

/// The disks of a patch side by side, for many tests whose outcome cannot be predicted: eight at a time, without branches.
class NearbyDisks {
 public:
  /// Those from `first` on; near ones should come first.
  void assign(const TrialPatch& patch, int first) {
    size_ = 0;
    for (int v = first; v < patch.num_vertices(); ++v) add(patch.position(v), patch.weight(v));
    while (size_ % kBlock != 0) add(Vec3::Constant(INFINITY), 0);
  }

  /// Is x in none of them? If so, `nearest` is the squared distance of the nearest centre.
  bool are_apart(const Vec3& x, double& nearest) const {
    for (std::size_t begin = 0; begin < size_; begin += kBlock) {
      double depth = INFINITY;
      for (std::size_t k = begin; k < begin + kBlock; ++k) {
        const double dx = x_[k] - x[0], dy = y_[k] - x[1], dz = z_[k] - x[2], d = dx * dx + dy * dy + dz * dz;
        depth = std::min(depth, d - weight_[k]);
        nearest = std::min(nearest, d);
      }
      if (depth < 0) return false;
    }
    return true;
  }

 private:
  static constexpr std::size_t kBlock = 8;
  void add(const Vec3& x, double weight) {
    x_[size_] = x[0];
    y_[size_] = x[1];
    z_[size_] = x[2];
    weight_[size_++] = weight;
  }
  static constexpr std::size_t kRoom = static_cast<std::size_t>(TrialPatch::kMaxVertices);
  static_assert(kRoom % kBlock == 0, "");
  std::array<double, kRoom> x_, y_, z_, weight_;
  std::size_t size_ = 0;
};

/// Looks for refills that improve what is around a bad item, in copies; reads the diagram, changes nothing. One per thread.
class RefillFinder {
 public:
  RefillFinder(const RestrictedPowerDiagram& diagram, const OptimizedSet& set, const DualRating& rating,
               const RefillRadii& radii, int refills)
      : diagram_(diagram), set_(set), radii_(radii), refills_(refills), patch_(rating), trial_(rating) {}

  /// kInPlace is the answer where nothing is found and a patch could not be copied (boundaries).
  Proposal find(const BadItem& item, Rng rng) {
    proposal_ = Proposal();
    bool copied = true;
    best_gain_ = kLeastGain;
    perfect_ = false;
    const std::size_t corners = item.b == kNone ? 1 : 3;
    std::array<Index, 3> corner = {item.a, item.b, item.c};
    for (std::size_t k = corners; k > 1; --k) std::swap(corner[k - 1], corner[rng.below(k)]);
    // Small patches first: they cost least to try and to carry out.
    for (std::size_t k = 0; k < corners && !perfect_; ++k) {
      removed_.assign(1, corner[k]);
      copied = try_patch(rng) && copied;
    }
    if (proposal_.kind == Proposal::Kind::kRefill) return std::move(proposal_);
    for (std::size_t k = 0; k < corners; ++k) {
      removed_.assign(1, corner[k]);
      if (corners == 3) {
        removed_.push_back(corner[(k + 1) % 3]);
      } else {
        add_random_neighbor(rng);
      }
      copied = try_patch(rng) && copied;
      if (proposal_.kind == Proposal::Kind::kRefill) return std::move(proposal_);
    }
    removed_.assign(corner.begin(), corner.begin() + static_cast<std::ptrdiff_t>(corners));
    const int neighbors = corners == 1 || rng.below(2) == 0 ? 2 : 0;
    for (int k = 0; k < neighbors; ++k) add_random_neighbor(rng);
    copied = try_patch(rng) && copied;
    if (proposal_.kind == Proposal::Kind::kRefill) return std::move(proposal_);
    if (!copied) proposal_.kind = Proposal::Kind::kInPlace;
    return std::move(proposal_);
  }

 private:
  void add_random_neighbor(Rng& rng) {
    const DualStar& star = set_.star[slot(removed_[rng.below(removed_.size())])];
    if (star.size == 0) return;
    const Index s = star.ring[rng.below(static_cast<std::uint64_t>(star.size))];
    if (std::find(removed_.begin(), removed_.end(), s) == removed_.end()) removed_.push_back(s);
  }

  /// Several refills of the gap that removed_ leave; the best becomes the proposal if it is an improvement. False if the patch
  /// cannot be copied.
  bool try_patch(Rng& rng) {
    if (!copy_patch()) return false;
    const double before = patch_.energy() + kPerSample * static_cast<double>(removed_.size());
    for (std::size_t k = 0; k < removed_.size(); ++k) {
      if (!patch_.remove(static_cast<int>(k))) return true;
    }
    fill_pool(rng);
    bool improved = false;
    double best = -best_gain_;
    for (int refill = 0; refill < refills_ && !pool_.empty() && !perfect_; ++refill) {
      ++proposal_.trials;
      if (!try_refill(rng)) continue;
      const double after = trial_.energy(), energy = after + kPerSample * static_cast<double>(chosen_.size()) - before;
      if (!(energy < best)) continue;
      perfect_ = after == 0 && chosen_.size() <= removed_.size();
      best = energy;
      best_gain_ = -energy;
      improved = true;
      proposal_.kind = Proposal::Kind::kRefill;
      proposal_.added = chosen_;
    }
    if (improved) {
      proposal_.removed = removed_;
      proposal_.seen = ids_;
    }
    return true;
  }

  int local(Index s) {
    for (std::size_t k = 0; k < ids_.size(); ++k) {
      if (ids_[k] == s) return static_cast<int>(k);
    }
    ids_.push_back(s);
    const WeightedPoint& p = diagram_.site(s);
    const int size = set_.star[slot(s)].size;
    return patch_.add_vertex(p.position(), p.w, size, size > 0) ? static_cast<int>(ids_.size()) - 1 : -1;
  }

  /// The stars of removed_ and of their neighbours.
  bool copy_patch() {
    patch_.clear();
    ids_.clear();
    for (const Index s : removed_) local(s);
    for (const Index s : removed_) {
      const DualStar& star = set_.star[slot(s)];
      if (star.size == 0) return false;
      for (int k = 0; k < star.size; ++k) {
        if (local(star.ring[static_cast<std::size_t>(k)]) < 0) return false;
      }
    }
    const std::size_t inner = ids_.size();
    for (std::size_t v = 0; v < inner; ++v) {
      const DualStar star = set_.star[slot(ids_[v])];
      if (star.size == 0) return false;
      int before = local(star.ring[static_cast<std::size_t>(star.size - 1)]);
      for (int k = 0; k < star.size; ++k) {
        const int at = local(star.ring[static_cast<std::size_t>(k)]);
        if (before < 0 || at < 0) return false;
        // Once: from the first of its corners.
        const auto earlier = [&](int u) { return static_cast<std::size_t>(u) < v; };
        if (!earlier(before) && !earlier(at) && !patch_.add_triangle(static_cast<int>(v), before, at)) return false;
        before = at;
      }
    }
    patch_.close();
    return true;
  }

  /// Uniform darts where removed_ had their cells, outside of all other balls: only there can a gap be.
  void fill_pool(Rng& rng) {
    pieces_.clear();
    up_to_.clear();
    double total = 0;
    for (const Index s : removed_) {
      for (Index f = diagram_.first_of_site(s); f != kNone; f = diagram_.next_of_site(f)) {
        const auto polygon = diagram_.polygon(f);
        for (Index k = 2; k < polygon.size; ++k) {
          const Vec3 u = polygon.corners[k - 1] - polygon.corners[0], v = polygon.corners[k] - polygon.corners[0];
          pieces_.push_back({polygon.facet, polygon.corners[0], u, v});
          up_to_.push_back(total += u.cross(v).norm());
        }
      }
    }
    pool_.clear();
    if (!(total > 0)) return;
    others_.assign(patch_, static_cast<int>(removed_.size()));
    const std::size_t most = std::min(kPoolPerSample * removed_.size(), kMostPool);
    const int most_darts = kPoolDartsPerSample * static_cast<int>(removed_.size());
    for (int dart = 0; dart < most_darts && pool_.size() < most; ++dart) {
      const double u = rng.uniform() * total;
      std::size_t at = 0;  // counted, not searched for: no branch to mispredict
      for (std::size_t k = 0; k + 1 < pieces_.size(); ++k) at += up_to_[k] <= u ? 1 : 0;
      const Piece& piece = pieces_[at];
      double along_u = rng.uniform(), along_v = rng.uniform();
      const bool other_half = along_u + along_v > 1;  // of the parallelogram
      along_u = other_half ? 1 - along_u : along_u;
      along_v = other_half ? 1 - along_v : along_v;
      NewSample sample;
      sample.x = piece.corner + along_u * piece.u + along_v * piece.v;
      double nearest = INFINITY;
      if (!others_.are_apart(sample.x, nearest)) continue;
      sample.at.facet = piece.facet;
      if (radii_.field.empty()) {
        sample.radius = radii_.least;
        if (nearest < sample.radius * sample.radius) continue;
      } else {
        sample.at = surface_point_below(diagram_.mesh(), piece.facet, sample.x);
        sample.radius = radius_below(radii_.at(sample.at), nearest);
      }
      pool_.push_back(sample);
    }
  }

  /// Samples of the pool in random order, each if those before leave it free. False if that is no maximal refill.
  bool try_refill(Rng& rng) {
    trial_ = patch_;
    chosen_.clear();
    open_.resize(pool_.size());
    for (std::size_t k = 0; k < open_.size(); ++k) open_[k] = static_cast<std::uint8_t>(k);
    while (!open_.empty()) {
      NewSample next = pool_[open_[rng.below(open_.size())]];
      for (const NewSample& other : chosen_) {
        if (!radii_.field.empty()) next.radius = radius_below(next.radius, (next.x - other.x).squaredNorm());
      }
      if (!trial_.insert(next.x, next.radius * next.radius)) return false;
      chosen_.push_back(next);
      const double reach = next.radius * next.radius;
      open_.erase(std::remove_if(open_.begin(), open_.end(),
                                 [&](std::uint8_t k) { return (pool_[k].x - next.x).squaredNorm() < reach; }),
                  open_.end());
    }
    return !trial_.has_gap();
  }

  /// A triangle of a fragment: a corner and the edges from it.
  struct Piece {
    Index facet;
    Vec3 corner, u, v;
  };

  const RestrictedPowerDiagram& diagram_;
  const OptimizedSet& set_;
  const RefillRadii& radii_;
  int refills_;
  double best_gain_ = 0;
  bool perfect_ = false;  ///< nothing is bad in the patch any more, and no sample has been added: no need to look further
  Proposal proposal_;
  TrialPatch patch_, trial_;
  std::vector<Index> removed_, ids_;
  NearbyDisks others_;
  std::vector<Piece> pieces_;
  std::vector<double> up_to_;  ///< twice the area of a piece and all before it
  std::vector<NewSample> pool_, chosen_;
  std::vector<std::uint8_t> open_;
};

}  // namespace amps::detail
