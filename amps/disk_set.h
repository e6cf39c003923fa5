// disk_set.h (internal): the disks there are, for whoever wants to add one. Disks are balls in space, or they know the surface
// they lie on: then disk_i is the part of the surface that is joined to p_i within ball_i (reach.h), two sheets do not see
// each other's disks, and what a disk covers and excludes is decided facet by facet.
#pragma once

#include "amps/base.h"
#include "amps/curves.h"
#include "amps/mesh.h"
#include "amps/reach.h"
#include "amps/samples.h"
#include "amps/voxel_grid.h"
#include "amps/wanted_radii.h"

#include <memory>
#include <vector>

namespace amps::detail {

/// Samples by id, their disks, and which of them a new disk conflicts with. Queries use scratch memory: one object per thread.
class DiskSet {
 public:
  /// Balls. The grid has no sample yet.
  explicit DiskSet(VoxelGrid grid) : grid_(std::move(grid)) {}
  /// Disks that know their surface, if `flood` is not null. `box`: of all samples.
  DiskSet(const Box& box, double min_radius, double max_radius, std::shared_ptr<const SurfaceFlood> flood);

  const VoxelGrid& grid() const { return grid_; }
  bool has_samples() const { return num_samples_ > 0; }
  bool knows_surface() const { return flood_ != nullptr; }
  const std::shared_ptr<const SurfaceFlood>& flood() const { return flood_; }
  /// By sample the facets it reaches; null for balls. Valid as long as this object, which may move.
  const ReachLists* reach_lists() const { return lists_.get(); }

  /// Some sample whose disk holds x, or kNone.
  Index covering_sample(const SurfacePoint& x) const;

  /// Does the disk of a sample of this id or a greater one hold x?
  bool is_covered_from(Index first, const SurfacePoint& x) const;

  /// Some sample that a disk would be too near to, kNone if there is none. By the max rule: one whose disk holds the new
  /// centre, or whose centre the new disk holds.
  Index conflicting_sample(const Sample& disk, ConflictRule rule) const;

  /// A sample that is stored; over a surface.
  const Sample& sample(Index id) const { return samples_[slot(id)]; }

  /// Does the disk of sample i hold the centre of sample j, inside? Exact.
  bool holds_sample(Index i, Index j) const;
  /// Is there a facet that holds j and that i reaches?
  bool reaches_sample(Index i, Index j) const { return holds(i, samples_[slot(j)].at); }
  /// The least |p_i − p_j|/r_i of samples whose disk holds the centre of another one, over a surface; infinite if there is
  /// none.
  double worst_conflict(const Execution& execution) const;

  /// The radius, up to `wanted`, of a new disk around a point that lies in no disk, such that it holds no sample; where the
  /// rule asks for that. Over a surface reach is not symmetric: round a tight fold x may lie in no disk of p while p lies in
  /// that of x. Then x gets the least radius at which its flood comes to p, which is at least |x − p| and r_p − |x − p|.
  double lowered_radius(const SurfacePoint& x, double wanted, const WantedRadii& radii) const;

  /// Stores a sample, whether or not it conflicts with others. Its id is new, or that of one that was removed: then it must be
  /// the same sample, or its reach forgotten.
  void insert(const Sample& sample, Index id);
  /// insert() of all samples of a set, ids being rows; floods on all threads. Cancelled, it throws Error(kCancelled).
  void insert_all(const GrowingSet& set, const Execution& execution);
  /// Stores a sample whose reach nobody will ask for, until clear().
  void insert_ball(const Sample& sample, Index id) { grid_.insert(sample.position(), sample.radius, id); }
  /// It counts no more; but what it reaches stays known, for the diagram, until forget_reach().
  void remove(const Sample& sample, Index id);
  void forget_reach(Index id);

  /// Makes the grid anew, without samples, and forgets all.
  void clear(const Box& box, double min_radius, double max_radius);

 private:
  bool holds(Index id, const SurfacePoint& x) const;
  void make_room(std::size_t num_stored, std::size_t total);
  void store(const Sample& sample, Index id);
  void flood_from(const SurfacePoint& x, double radius) const;
  bool flood_has(Index id) const;
  void widen_grid(double radius);

  VoxelGrid grid_;
  Box box_;
  double min_radius_ = 0, max_radius_ = 0;
  Index num_samples_ = 0;
  bool has_room_ = false;  ///< for samples that are foreseen
  std::shared_ptr<const SurfaceFlood> flood_;
  std::unique_ptr<ReachLists> lists_;
  std::vector<Sample> samples_;  ///< by id; only where disks know their surface
  std::vector<char> stored_;
  mutable SurfaceFlood::Scratch scratch_;
  mutable std::vector<Index> near_, homes_, flooded_;
};

/// The floods of a mesh where disks know their surface, cut at its curves (null: at none); else null.
std::shared_ptr<const SurfaceFlood> flood_of(const MeshView& mesh, Neighborhood neighborhood, const Execution& execution = {},
                                             const CurveGraph* curves = nullptr);

/// The disks of a set, ids being rows. Over a surface a sample that says of no facet lies on the nearest one. The radii are
/// those of the set, and others in [min_radius, max_radius]. Throws Error(kTooLarge) for radii out of proportion to the box.
std::shared_ptr<DiskSet> disks_of(const MeshView& mesh, const SampleSet& samples, double min_radius, double max_radius,
                                  const std::shared_ptr<const SurfaceFlood>& flood, const Execution& execution = {});

}  // namespace amps::detail
