#define AMPS_OWN_SOURCE
#include "amps/disk_set.h"

#include "amps/predicates.h"
#include "amps/surface_tree.h"
#include "amps/thread_pool.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

namespace amps::detail {

DiskSet::DiskSet(const Box& box, double min_radius, double max_radius, std::shared_ptr<const SurfaceFlood> flood)
    : grid_(box, min_radius, max_radius),
      box_(box),
      min_radius_(min_radius),
      max_radius_(max_radius),
      flood_(std::move(flood)) {
  if (flood_ != nullptr) lists_ = std::make_unique<ReachLists>();
}

void DiskSet::clear(const Box& box, double min_radius, double max_radius) {
  grid_ = VoxelGrid(box, min_radius, max_radius);
  box_ = box;
  min_radius_ = min_radius;
  max_radius_ = max_radius;
  if (flood_ != nullptr) lists_ = std::make_unique<ReachLists>();
  samples_.clear();
  stored_.clear();
  num_samples_ = 0;
  has_room_ = false;
}

/// Does the disk of a sample whose ball holds x hold it? It does where it reaches a facet at x.
bool DiskSet::holds(Index id, const SurfacePoint& x) const {
  if (lists_->reaches(id, x.facet)) return true;
  if ((x.barycentric.array() != 0).all()) return false;
  const std::vector<Index> homes = flood_->homes(x);
  return std::any_of(homes.begin(), homes.end(), [&](Index facet) { return lists_->reaches(id, facet); });
}

Index DiskSet::covering_sample(const SurfacePoint& x) const {
  const Index first = grid_.conflicting_sample(x.position, 0, ConflictRule::kMax);
  if (first == kNone || !knows_surface() || holds(first, x)) return first;
  grid_.list_conflicts(x.position, 0, ConflictRule::kMax, near_);
  for (const Index id : near_) {
    if (holds(id, x)) return id;
  }
  return kNone;
}

bool DiskSet::is_covered_from(Index first, const SurfacePoint& x) const {
  grid_.list_conflicts(x.position, 0, ConflictRule::kMax, near_);
  return std::any_of(near_.begin(), near_.end(), [&](Index id) { return id >= first && (!knows_surface() || holds(id, x)); });
}

/// Leaves the facets that a disk would reach in flooded_, ascending.
void DiskSet::flood_from(const SurfacePoint& x, double radius) const {
  homes_ = flood_->homes(x);
  flood_->flood(x.position, radius * radius, homes_, scratch_, flooded_);
}

/// Did the last flood come to a facet at the sample?
bool DiskSet::flood_has(Index id) const {
  const SurfacePoint& at = samples_[slot(id)].at;
  const auto flooded = [&](Index facet) { return std::binary_search(flooded_.begin(), flooded_.end(), facet); };
  if (flooded(at.facet)) return true;
  if ((at.barycentric.array() != 0).all()) return false;
  const std::vector<Index> homes = flood_->homes(at);
  return std::any_of(homes.begin(), homes.end(), flooded);
}

bool DiskSet::holds_sample(Index i, Index j) const {
  const Sample &disk = samples_[slot(i)], &other = samples_[slot(j)];
  return side_of_ball(other.position().data(), disk.position().data(), disk.radius * disk.radius) < 0 && holds(i, other.at);
}

double DiskSet::worst_conflict(const Execution& execution) const {
  double worst = INFINITY;
  Ticker ticker(execution, samples_.size());
  for (std::size_t id = 0; id < samples_.size(); ++id) {
    ticker.tick();
    if (stored_[id] == 0) continue;
    const auto j = static_cast<Index>(id);
    grid_.list_conflicts(samples_[id].position(), 0, ConflictRule::kMax, near_);
    for (const Index i : near_) {
      if (i == j || !holds_sample(i, j)) continue;
      const Sample& disk = samples_[slot(i)];
      worst = std::min(worst, norm(disk.position() - samples_[id].position()) / disk.radius);
    }
  }
  return worst;
}

Index DiskSet::conflicting_sample(const Sample& disk, ConflictRule rule) const {
  const Index first = grid_.conflicting_sample(disk.position(), disk.radius, rule);
  if (first == kNone || !knows_surface()) return first;
  const auto covers = [&](Index id) {
    const Sample& sample = samples_[slot(id)];
    return side_of_ball(disk.position().data(), sample.position().data(), sample.radius * sample.radius) < 0 &&
           holds(id, disk.at);
  };
  if (covers(first)) return first;
  grid_.list_conflicts(disk.position(), disk.radius, rule, near_);
  for (const Index id : near_) {
    if (covers(id)) return id;
  }
  flood_from(disk.at, disk.radius);
  for (const Index id : near_) {
    const Sample& sample = samples_[slot(id)];
    const double weight = disk.radius * disk.radius;
    if (side_of_ball(sample.position().data(), disk.position().data(), weight) < 0 && flood_has(id)) return id;
  }
  return kNone;
}

double DiskSet::lowered_radius(const SurfacePoint& x, double wanted, const WantedRadii& radii) const {
  if (!knows_surface()) {
    if (!radii.lowers()) return wanted;
    return radii.lowered(wanted, grid_.nearest_squared_distance(x.position, wanted));
  }
  if (radii.rule() != ConflictRule::kMax) return wanted;
  grid_.list_conflicts(x.position, wanted, ConflictRule::kMax, near_);
  double radius = wanted;
  PlacedPoint centre;
  for (const Index id : near_) {
    const SurfacePoint& at = samples_[slot(id)].at;
    if (!(squared_norm(at.position - x.position) < radius * radius)) continue;
    if (centre.homes.empty()) {
      flood_from(x, wanted);
      centre = {x.position, homes_};
    }
    if (!flood_has(id)) continue;
    const double bottleneck = flood_->bottleneck(centre, {at.position, flood_->homes(at)}, radius, scratch_);
    if (bottleneck < radius) radius = radius_below(radius, bottleneck * bottleneck);
  }
  return radius;
}

/// The grid is made for equal radii, or for those from min_radius_ on; over a surface some fall below.
void DiskSet::widen_grid(double radius) {
  constexpr double kOctaves = 16;  // levels without samples cost nothing
  min_radius_ = std::min(min_radius_, radius);
  max_radius_ = std::max(max_radius_, radius);
  if (VoxelGrid::fits(box_, min_radius_ / kOctaves, max_radius_)) min_radius_ /= kOctaves;
  grid_ = VoxelGrid(box_, min_radius_, max_radius_);
  for (std::size_t id = 0; id < samples_.size(); ++id) {
    if (stored_[id] != 0) grid_.insert(samples_[id].position(), samples_[id].radius, static_cast<Index>(id));
  }
}

/// All of a sample but its reach.
void DiskSet::store(const Sample& sample, Index id) {
  if (knows_surface()) {
    const bool equal = min_radius_ == max_radius_, fits = min_radius_ <= sample.radius && sample.radius <= max_radius_;
    if (equal ? sample.radius * sample.radius != min_radius_ * min_radius_ : !fits) widen_grid(sample.radius);
    if (slot(id) >= samples_.size()) {
      samples_.resize(slot(id) + 1);
      stored_.resize(slot(id) + 1, 0);
    }
    samples_[slot(id)] = sample;
    stored_[slot(id)] = 1;
  }
  grid_.insert(sample.position(), sample.radius, id);
  ++num_samples_;
}

void DiskSet::insert(const Sample& sample, Index id) {
  store(sample, id);
  if (!knows_surface() || lists_->has(id)) return;
  flood_from(sample.at, sample.radius);
  lists_->add(id, flooded_);
}

/// Once so many of all samples are in, what those to come will take is foreseen by them.
void DiskSet::make_room(std::size_t num_stored, std::size_t total) {
  constexpr std::size_t kForeseeingPart = 8;
  if (has_room_ || kForeseeingPart * num_stored < total) return;
  has_room_ = true;
  const std::size_t expected = room_for_more(total);
  grid_.reserve(static_cast<double>(expected) / static_cast<double>(num_stored));
  if (!knows_surface()) return;
  samples_.reserve(expected);
  stored_.reserve(expected);
  lists_->reserve(expected);
}

void DiskSet::insert_all(const GrowingSet& set, const Execution& execution) {
  constexpr std::size_t kSamplesPerPiece = 1024;
  const std::size_t n = slot(set.size());
  if (!knows_surface() || execution.workers() == 1) {
    for_each_piece(n, kSamplesPerPiece, execution, [&](std::size_t begin, std::size_t end) {
      for (std::size_t s = begin; s < end; ++s) insert(set[static_cast<Index>(s)], static_cast<Index>(s));
      make_room(end, n);
    });
    return;
  }
  /// What the samples of a piece reach, one after another.
  struct Reached {
    std::vector<Index> facets;
    std::vector<std::size_t> end;
  };
  // Not of all samples at once: what they reach is kept a second time meanwhile.
  const std::size_t pieces_at_a_time = 8 * slot(static_cast<Index>(execution.workers()));
  std::vector<Reached> reached(pieces_at_a_time);
  ScratchPool<SurfaceFlood::Scratch> scratches;
  for_each_piece(n, kSamplesPerPiece * pieces_at_a_time, execution, [&](std::size_t first, std::size_t last) {
    parallel_for(last - first, kSamplesPerPiece, execution, [&](std::size_t begin, std::size_t end) {
      const auto scratch = scratches.lend([] { return std::make_unique<SurfaceFlood::Scratch>(); });
      Reached& piece = reached[begin / kSamplesPerPiece];
      piece.facets.clear();
      piece.end.clear();
      std::vector<Index> facets;
      for (std::size_t s = first + begin; s < first + end; ++s) {
        const Sample sample = set[static_cast<Index>(s)];
        flood_->flood(sample.position(), sample.radius * sample.radius, flood_->homes(sample.at), *scratch, facets);
        piece.facets.insert(piece.facets.end(), facets.begin(), facets.end());
        piece.end.push_back(piece.facets.size());
      }
    });
    for (std::size_t s = first; s < last; ++s) {
      const Reached& piece = reached[(s - first) / kSamplesPerPiece];
      const std::size_t k = (s - first) % kSamplesPerPiece;
      const auto at = [&](std::size_t i) { return piece.facets.begin() + static_cast<std::ptrdiff_t>(i); };
      flooded_.assign(at(k == 0 ? 0 : piece.end[k - 1]), at(piece.end[k]));
      store(set[static_cast<Index>(s)], static_cast<Index>(s));
      lists_->add(static_cast<Index>(s), flooded_);
    }
    make_room(last, n);
  });
}

void DiskSet::remove(const Sample& sample, Index id) {
  --num_samples_;
  grid_.remove(sample.position(), sample.radius, id);
  if (!knows_surface()) return;
  stored_[slot(id)] = 0;
}

void DiskSet::forget_reach(Index id) {
  if (knows_surface()) lists_->remove(id);
}

std::shared_ptr<const SurfaceFlood> flood_of(const MeshView& mesh, Neighborhood neighborhood, const Execution& execution,
                                             const CurveGraph* curves) {
  if (neighborhood != Neighborhood::kSurface) {
    if (curves == nullptr || curves->empty()) return nullptr;
    throw Error(ErrorCode::kInvalidArgument,
                "samples: balls do not end at curves; set Neighborhood::kSurface, or leave them out");
  }
  const bool cut = curves != nullptr && !curves->empty();
  return std::make_shared<const SurfaceFlood>(mesh, SurfaceEdges(mesh, execution.part(0, 0.7)),
                                              cut ? curves->is_curve_edge : std::vector<char>(), execution.part(0.7, 1));
}

std::shared_ptr<DiskSet> disks_of(const MeshView& mesh, const SampleSet& samples, double min_radius, double max_radius,
                                  const std::shared_ptr<const SurfaceFlood>& flood, const Execution& execution) {
  Box box = bounding_box(mesh);
  for (Index s = 0; s < samples.size(); ++s) {
    box.min = box.min.cwiseMin(samples.positions.row(s).transpose());
    box.max = box.max.cwiseMax(samples.positions.row(s).transpose());
  }
  const double min = std::min(min_radius, detail::min_radius(samples)), max = std::max(max_radius, detail::max_radius(samples));
  if (!VoxelGrid::fits(box, min, max)) {
    throw Error(ErrorCode::kTooLarge, "samples: radii from " + number_text(min) + " to " + number_text(max) +
                                          " are out of proportion to the mesh's diagonal " + number_text(box.diagonal()) +
                                          "; stay between 1e-6 and 1e6 of it");
  }
  auto disks = std::make_shared<DiskSet>(box, min, max, flood);
  std::unique_ptr<SurfaceTree> tree;
  Index near = kNone;
  Ticker ticker(execution, slot(samples.size()));
  for (Index s = 0; s < samples.size(); ++s) {
    ticker.tick();
    Sample sample = sample_of(samples, s);
    if (flood != nullptr && sample.at.facet == kNone) {
      if (tree == nullptr) tree = std::make_unique<SurfaceTree>(mesh);
      const SurfaceHit hit = tree->nearest(sample.position(), near);
      near = hit.point.facet;
      sample.at.facet = hit.point.facet;
      sample.at.barycentric = hit.point.barycentric;
    }
    disks->insert(sample, s);
  }
  return disks;
}

}  // namespace amps::detail
