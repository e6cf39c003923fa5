#define AMPS_OWN_SOURCE
#include "amps/optimize_state.h"

#include "amps/voxel_grid.h"

#include <cstddef>
#include <utility>

namespace amps::detail {
namespace {

/// Room is made for one sample more for so many: ids are used again, and most sets grow by less. (Doubling: 5 MiB at 100k.)
constexpr std::size_t kSamplesPerRoom = 8;
/// Stars a thread reads at a time.
constexpr std::size_t kStarsPerTask = 1024;

/// Balls, none yet: for the samples there are and those to come.
DiskSet balls_for(const MeshView& mesh, const WantedRadii& radii) {
  const double min = radii.min_of_set(), max = radii.max_of_set();
  const Box box = bounding_box(mesh);
  if (!VoxelGrid::fits(box, min, max)) {
    throw Error(ErrorCode::kTooLarge, "optimisation: radii from " + number_text(min) + " to " + number_text(max) +
                                          " are out of proportion to the mesh's diagonal " + number_text(box.diagonal()) +
                                          "; stay between 1e-6 and 1e6 of it");
  }
  return DiskSet(VoxelGrid(box, min, max));
}

}  // namespace

WantedRadii radii_of(const OptimizeOptions& options, const SampleSet& samples) {
  const double min = min_radius(samples), max = max_radius(samples);
  const WantedRadii wanted = options.sizing.empty()
                                 ? WantedRadii(options.radius > 0 ? options.radius : min, options.conflict_rule)
                                 : WantedRadii(options.sizing, options.conflict_rule);
  return wanted.beside(min, max);
}

OptimizeState::OptimizeState(RestrictedPowerDiagram& given, const SampleSet& set, const OptimizeSurface& surface,
                             const OptimizeOptions& given_options, double min_angle, double max_angle,
                             const Execution& execution)
    : diagram(given),
      num_fixed(surface.num_fixed),
      topology(surface.topology),
      topology_samples(surface.samples),
      options(given_options),
      rating(options.angles, options.valences, min_angle, max_angle),
      reader(diagram, rating, num_fixed),
      radii(radii_of(options, set).with_caps(surface.caps)),
      balls(surface.disks != nullptr ? nullptr : std::make_unique<DiskSet>(balls_for(diagram.mesh(), radii))),
      samples(given, set, surface.disks != nullptr ? *surface.disks : *balls, execution.part(0, 0.3)),
      rng(options.seed) {
  report.min_angle = min_angle;
  report.max_angle = max_angle;
  const std::size_t n = slot(samples.size());
  stars.resize(n);
  seen.reserve(n + n / kSamplesPerRoom);
  seen.resize(n);
  std::vector<std::vector<std::pair<std::size_t, DualStar>>> large((n + kStarsPerTask - 1) / kStarsPerTask);
  for_each_piece_on_all_threads(n, kStarsPerTask, execution.part(0.3, 1), [&](std::size_t begin, std::size_t end) {
    StarReader own(diagram, rating, num_fixed);
    DualStar star;
    for (std::size_t s = begin; s < end; ++s) {
      stars.energy[s] = own.energy(static_cast<Index>(s), star);
      if (!stars.star.set_small(s, star)) large[begin / kStarsPerTask].emplace_back(s, star);
      seen.site[s] = diagram.site(static_cast<Index>(s));
    }
  });
  for (const auto& of_piece : large) {
    for (const auto& [s, star] : of_piece) stars.star.set(s, star);
  }
  seen.star = stars.star;
}

bool OptimizeState::is_current(const BadItem& item) const {
  for (const Index s : {item.a, item.b, item.c}) {
    if (s != kNone && (!samples.alive(s) || !(stars.energy[slot(s)] > 0))) return false;
  }
  if (item.is_vertex()) return true;
  const StarView star = stars.star[slot(item.a)];
  for (int k = 0; k < star.size; ++k) {
    const Index p = star.ring[static_cast<std::size_t>(k)], q = star.ring[static_cast<std::size_t>((k + 1) % star.size)];
    if ((p == item.b && q == item.c) || (p == item.c && q == item.b)) return true;
  }
  return star.size == 0;
}

void OptimizeState::see_changes() {
  seen.resize(slot(samples.size()));
  for (const Index s : unseen) {
    if (!samples.alive(s)) continue;
    seen.star.set(slot(s), stars.star[slot(s)]);
    seen.site[slot(s)] = diagram.site(s);
  }
  unseen.clear();
}

}  // namespace amps::detail
