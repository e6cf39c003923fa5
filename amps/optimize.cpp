#define AMPS_OWN_SOURCE
#include "amps/optimize.h"

#include "amps/gaps.h"
#include "amps/maximality.h"
#include "amps/predicates.h"
#include "amps/refill.h"
#include "amps/voxel_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <locale>
#include <ostream>
#include <sstream>
#include <string>
#include <utility>

namespace amps {
namespace detail {
namespace {

/// Iterations in a row that bring nothing before it is given up, and before kicks begin.
constexpr int kIdleIterations = 32, kIdleBeforeKicks = 2;
/// Kicks in one iteration, rounds of improvement after one; samples that a kick takes out beyond the usual: any number up to
/// one that grows by one in so many idle iterations, and ends at a ring and a half.
constexpr std::size_t kLeastKicks = 8, kMostKicks = 64;
constexpr int kKickRounds = 16, kIdlePerSample = 2, kMostKicked = 10;
/// It is also given up when this work, in refills tried per sample, has not halved the energy; an edit counts as so many of
/// them. (All the way to [46, 83] it takes 150 on a sphere.)
constexpr double kWorkPerHalving = 200, kWorkOfEdit = 40;
/// Edits of the diagram spent on vertices at crossings, beyond one for every fourth sample: 0.2 ms each. Where a surface meets
/// itself there may be no end of them.
constexpr std::uint64_t kEditsAtCrossings = 500;
/// Items are visited in stretches of so many ids, which mostly follow a curve in space, so that memory is at hand, and in
/// random order in each. So many are looked at before what was found is carried out: more are more parallel, and more of it out
/// of date (256 instead of 32: a fifth more time).
constexpr Index kStretch = 4096;
constexpr std::size_t kBatch = 32;
/// Refills of the diagram itself, where a patch cannot be copied.
constexpr int kRefillsInPlace = 8;
/// Darts for one gap of the diagram; samples for one refill.
constexpr int kRefillDarts = 64, kRefillSamples = 64;

/// Owns the state; carries out proposals.
class Optimizer {
 public:
  Optimizer(RestrictedPowerDiagram& diagram, const SampleSet& samples, const OptimizeOptions& options, double min_angle,
            double max_angle)
      : diagram_(diagram),
        options_(options),
        rating_(options.angles, options.valences, min_angle, max_angle),
        reader_(diagram, rating_),
        radii_{options.sizing, min_radius(samples)},
        grid_(grid_for(diagram.mesh(), samples, options.sizing)),
        rng_(options.seed) {
    report_.min_angle = min_angle;
    report_.max_angle = max_angle;
    const auto n = slot(samples.size());
    set_.at.resize(n);
    set_.alive.assign(n, 1);
    set_.star.resize(n);
    set_.energy.resize(n);
    set_.radius = samples.radii;
    changed_at_.assign(n, 0);
    distrusted_.assign(n, 0);
    is_new_.assign(n, 0);
    for (std::size_t s = 0; s < n; ++s) {
      if (!samples.facets.empty()) {
        set_.at[s] = {samples.facets[s], samples.barycentrics.row(static_cast<std::ptrdiff_t>(s)).transpose()};
      }
      grid_.insert(position(static_cast<Index>(s)), set_.radius[s], static_cast<Index>(s));
    }
    parallel_for(n, 1024, options.threads, [&](std::size_t begin, std::size_t end) {
      StarReader reader(diagram_, rating_);
      for (std::size_t s = begin; s < end; ++s) set_.energy[s] = reader.energy(static_cast<Index>(s), set_.star[s]);
    });
  }

  OptimizeReport run() {
    OptimizeStatus status = improve();
    if (status == OptimizeStatus::kDone && options_.valences) {
      // Vertices of bad valence on edges of more than two triangles come last: mostly there is little to be done, and what it
      // has cost in angles is made good again.
      rate_crossings(true);
      status = improve();
      if (status == OptimizeStatus::kStalled) {
        rate_crossings(false);
        const OptimizeStatus after = improve();
        if (after != OptimizeStatus::kDone) status = after;
        rate_crossings(true);
        bad_items();
      }
    }
    return end(status);
  }

  SampleSet samples(std::vector<Index>& ids) const {
    ids.clear();
    for (int made_here = 0; made_here < 2; ++made_here) {
      for (Index s = 0; s < set_.size(); ++s) {
        if (set_.alive[slot(s)] && is_new_[slot(s)] == made_here) ids.push_back(s);
      }
    }
    const auto n = static_cast<std::ptrdiff_t>(ids.size());
    SampleSet result;
    result.positions.resize(n);
    result.barycentrics.resize(n);
    for (std::ptrdiff_t k = 0; k < n; ++k) {
      const std::size_t s = slot(ids[static_cast<std::size_t>(k)]);
      result.positions.row(k) = position(static_cast<Index>(s)).transpose();
      result.radii.push_back(set_.radius[s]);
      result.facets.push_back(set_.at[s].facet);
      result.barycentrics.row(k) = set_.at[s].barycentric.transpose();
    }
    return result;
  }

 private:
  static VoxelGrid grid_for(const MeshView& mesh, const SampleSet& samples, const SizingField& sizing) {
    double least = min_radius(samples), greatest = max_radius(samples);
    if (!sizing.empty()) {
      least = std::min(least, sizing.min_radius());
      greatest = std::max(greatest, sizing.max_radius());
    }
    const Box box = bounding_box(mesh);
    if (!VoxelGrid::fits(box, least, greatest)) {
      throw Error(ErrorCode::kTooLarge, "optimisation: radii from " + std::to_string(least) + " to " +
                                            std::to_string(greatest) + " are out of proportion to the mesh's diagonal " +
                                            std::to_string(box.diagonal()) + "; stay between 1e-6 and 1e6 of it");
    }
    return VoxelGrid(box, least, greatest);
  }

  Vec3 position(Index s) const { return diagram_.site(s).position(); }

  /// Visits what is bad until nothing is, or nothing helps.
  OptimizeStatus improve() {
    double halved = INFINITY, work_then = 0;
    for (int idle = 0;; ++iteration_) {
      std::vector<BadItem> items = bad_items();
      const double energy = report_.iterations.back().energy;
      const double work = static_cast<double>(report_.trials) + kWorkOfEdit * static_cast<double>(report_.edits);
      if (energy <= halved / 2) {
        halved = energy;
        work_then = work;
      }
      const bool slow = work - work_then > kWorkPerHalving * num_samples_;
      if (items.empty()) return OptimizeStatus::kDone;
      if (options_.progress.cancelled()) return OptimizeStatus::kCancelled;
      if (idle == kIdleIterations || slow || !affords_edits_in_place()) return OptimizeStatus::kStalled;
      if (iteration_ == options_.max_iterations) return OptimizeStatus::kIterationLimit;
      const std::uint64_t accepted = report_.accepted;
      if (!visit(items)) {
        bad_items();
        return OptimizeStatus::kCancelled;
      }
      if (report_.accepted == accepted && idle >= kIdleBeforeKicks)
        kick_all(items, std::min(1 + idle / kIdlePerSample, kMostKicked));
      idle = report_.accepted == accepted ? idle + 1 : 0;
    }
  }

  OptimizeReport end(OptimizeStatus status) {
    report_.status = status;
    report_.iterations.pop_back();
    bad_items(true);
    Index left = 0;
    for (Index s = 0; s < set_.size(); ++s) {
      const bool alive = set_.alive[slot(s)] != 0;
      left += alive && !is_new_[slot(s)];
      report_.added += alive && is_new_[slot(s)];
    }
    report_.removed = num_samples_ - left;
    return report_;
  }

  /// The line of the report is written anew by bad_items(), which must follow.
  void rate_crossings(bool on) {
    reader_.rate_crossings = on;
    edits_in_place_ = 0;
    report_.iterations.pop_back();
    for (Index s = 0; s < set_.size(); ++s) {
      if (set_.alive[slot(s)] && set_.star[slot(s)].size == 0) set_.energy[slot(s)] = reader_.energy(s, set_.star[slot(s)]);
    }
  }

  /// What is bad, and a line of the report. Angles are measured where something is bad, or everywhere.
  std::vector<BadItem> bad_items(bool measure_all = false) {
    std::vector<BadItem> items;
    OptimizeIteration line;
    AngleRange range;
    if (measure_all || report_.iterations.empty()) range = angles_of_all();
    for (Index s = 0; s < set_.size(); ++s) {
      if (!set_.alive[slot(s)]) continue;
      ++line.samples;
      line.energy += set_.energy[slot(s)];
      if (!(set_.energy[slot(s)] > 0)) continue;
      reader_.read(s);
      list_bad(s, items);
    }
    for (const BadItem& item : items) {
      ++(item.b == kNone ? line.bad_vertices : line.bad_triangles);
      if (item.b != kNone) measure(item.a, item.b, item.c, range);
    }
    line.min_angle = range.min_angle();
    line.max_angle = range.max_angle();
    line.seconds = seconds_ += watch_.lap();
    report_.iterations.push_back(line);
    return items;
  }

  /// What is bad at s: itself, and triangles of which it is the lowest corner. The star has just been read.
  void list_bad(Index s, std::vector<BadItem>& items) {
    DualStar star;
    if (reader_.valence(reader_.form(star)) > 0) items.push_back({s, kNone, kNone});
    for (const auto& pair : reader_.pairs()) {
      if (s < pair[0] && reader_.triangle(s, pair[0], pair[1]) > 0) items.push_back({s, pair[0], pair[1]});
    }
  }

  /// As cosines.
  struct AngleRange {
    double least = 2, greatest = -2;
    double min_angle() const { return greatest < -1.5 ? 0 : degrees(greatest); }
    double max_angle() const { return greatest < -1.5 ? 0 : degrees(least); }
    static double degrees(double cosine) { return 57.29577951308232 * std::acos(std::min(std::max(cosine, -1.0), 1.0)); }
  };

  void measure(Index a, Index b, Index c, AngleRange& range) const {
    const Vec3 x = position(a), y = position(b), z = position(c);
    const std::array<double, 3> side = {(y - z).squaredNorm(), (z - x).squaredNorm(), (x - y).squaredNorm()};
    for (std::size_t k = 0; k < 3; ++k) {
      const double p = side[(k + 1) % 3], q = side[(k + 2) % 3], cosine = (p + q - side[k]) / (2 * std::sqrt(p * q));
      range.least = std::min(range.least, cosine);
      range.greatest = std::max(range.greatest, cosine);
    }
  }

  AngleRange angles_of_all() {
    AngleRange range;
    for (Index s = 0; s < set_.size(); ++s) {
      if (!set_.alive[slot(s)]) continue;
      const DualStar& star = set_.star[slot(s)];
      for (int k = 0; k < star.size; ++k) {
        const Index a = star.ring[static_cast<std::size_t>(k)], b = star.ring[static_cast<std::size_t>((k + 1) % star.size)];
        const bool once = s < std::min(a, b) || set_.star[slot(a)].size == 0 || set_.star[slot(b)].size == 0;
        if (once) measure(s, a, b, range);
      }
      if (star.size != 0) continue;
      for (const auto& pair : reader_.read(s)) measure(s, pair[0], pair[1], range);
    }
    return range;
  }

  /// Visits items that are sorted by their first corner, in another order. False if cancelled.
  bool visit(std::vector<BadItem>& items) {
    for (std::size_t begin = 0, end; begin < items.size(); begin = end) {
      for (end = begin + 1; end < items.size() && items[end].a / kStretch == items[begin].a / kStretch;) ++end;
      for (std::size_t k = end - begin; k > 1; --k) std::swap(items[begin + k - 1], items[begin + rng_.below(k)]);
      for (std::size_t first = begin; first < end; first += kBatch) {
        if (!goes_on(first, items.size())) return false;
        visit_batch(items.data() + first, std::min(kBatch, end - first));
      }
    }
    return true;
  }

  /// Looks at items in parallel, and does what is proposed, in order.
  void visit_batch(const BadItem* items, std::size_t count) {
    const std::uint64_t seed = rng_.next();
    ++clock_;
    std::vector<Proposal> proposals(count);
    parallel_for(count, 8, options_.threads, [&](std::size_t begin, std::size_t end) {
      RefillFinder finder(diagram_, set_, rating_, radii_, options_.refills);
      for (std::size_t k = begin; k < end; ++k) {
        if (is_current(items[k])) proposals[k] = finder.find(items[k], Rng(scramble(seed + k)));
      }
    });
    for (std::size_t k = 0; k < count; ++k) carry_out(items[k], proposals[k]);
  }

  /// Reports progress: `k` of n items in this iteration.
  bool goes_on(std::size_t k, std::size_t n) const {
    const double done = iteration_ + static_cast<double>(k) / static_cast<double>(n);
    return options_.progress.report("optimizing", std::min(1.0, done / options_.max_iterations));
  }

  /// Is it still there, and bad?
  bool is_current(const BadItem& item) const {
    for (const Index s : {item.a, item.b, item.c}) {
      if (s != kNone && (!set_.alive[slot(s)] || !(set_.energy[slot(s)] > 0))) return false;
    }
    if (item.b == kNone) return true;
    const DualStar& star = set_.star[slot(item.a)];
    for (int k = 0; k < star.size; ++k) {
      const Index p = star.ring[static_cast<std::size_t>(k)], q = star.ring[static_cast<std::size_t>((k + 1) % star.size)];
      if ((p == item.b && q == item.c) || (p == item.c && q == item.b)) return true;
    }
    return star.size == 0;
  }

  void carry_out(const BadItem& item, Proposal& proposal) {
    report_.trials += proposal.trials;
    if (proposal.kind == Proposal::Kind::kNothing) return;
    if (proposal.kind == Proposal::Kind::kInPlace || distrusted_[slot(item.a)]) {
      if (is_current(item) && !changed(item.a)) refill_in_place(item);
      return;
    }
    for (const Index s : proposal.seen) {
      if (changed(s)) return;
    }
    begin_edit(proposal.removed);
    if (!is_apart(proposal.added)) {  // some disk of another sheet
      distrusted_[slot(item.a)] = 1;
      for (const Index s : proposal.removed) grid_.insert(position(s), set_.radius[slot(s)], s);
      return;
    }
    ++report_.edits;
    Index near = proposal.removed.front();
    for (const NewSample& sample : proposal.added) near = enter(sample, near);
    for (const Index s : proposal.removed) take_out(s);
    if (fill() && improves()) {
      keep();
    } else {
      distrusted_[slot(item.a)] = 1;
      undo();
    }
  }

  bool changed(Index s) const { return changed_at_[slot(s)] == clock_; }

  // An edit: samples leave and come; then keep() or undo().

  struct OldSample {
    Index id;
    Vec3 x;
    SurfacePoint at;
    double radius, energy;
    char is_new;
  };

  void begin_edit(const std::vector<Index>& removed) {
    old_.clear();
    added_.clear();
    touched_.clear();
    affected_.clear();
    for (const Index s : removed) {
      old_.push_back({s, position(s), set_.at[slot(s)], set_.radius[slot(s)], set_.energy[slot(s)], is_new_[slot(s)]});
      grid_.remove(position(s), set_.radius[slot(s)], s);
    }
  }

  void note_changed() {
    touched_.insert(touched_.end(), diagram_.changed().begin(), diagram_.changed().end());
    affected_.insert(affected_.end(), diagram_.changed_sites().begin(), diagram_.changed_sites().end());
  }

  void take_out(Index s) {
    diagram_.remove(s);
    set_.alive[slot(s)] = 0;
    note_changed();
  }

  Index enter(const NewSample& sample, Index near) {
    Index s;
    if (free_.empty()) {
      s = diagram_.insert(sample.x, sample.radius * sample.radius, near);
      set_.at.emplace_back();
      set_.radius.push_back(0);
      set_.alive.push_back(0);
      set_.star.emplace_back();
      set_.energy.push_back(0);
      changed_at_.push_back(0);
      distrusted_.push_back(0);
      is_new_.push_back(1);
    } else {
      s = free_.back();
      free_.pop_back();
      diagram_.reinsert(s, sample.x, sample.radius * sample.radius, near);
      is_new_[slot(s)] = 1;
    }
    set_.at[slot(s)] = sample.at;
    set_.radius[slot(s)] = sample.radius;
    set_.alive[slot(s)] = 1;
    grid_.insert(sample.x, sample.radius, s);
    added_.push_back(s);
    note_changed();
    return s;
  }

  void undo_added() {
    for (const Index s : added_) {
      grid_.remove(position(s), set_.radius[slot(s)], s);
      take_out(s);
      free_.push_back(s);
    }
    added_.clear();
  }

  void undo() {
    const Index near = neighbor_of_added();
    undo_added();
    Index last = near;
    for (const OldSample& old : old_) {
      diagram_.reinsert(old.id, old.x, old.radius * old.radius, last);
      note_changed();
      grid_.insert(old.x, old.radius, old.id);
      set_.alive[slot(old.id)] = 1;
      last = old.id;
    }
  }

  /// A sample that stays, near the patch.
  Index neighbor_of_added() const {
    for (const Index s : affected_) {
      if (set_.alive[slot(s)] && std::find(added_.begin(), added_.end(), s) == added_.end()) return s;
    }
    return kNone;
  }

  void keep() {
    ++report_.accepted;
    if (journaling_) {
      journal_.push_back({old_, added_});
      journal_change_ += change_;
      region_.insert(region_.end(), affected_.begin(), affected_.end());
    }
    for (const OldSample& old : old_) free_.push_back(old.id);
    for (std::size_t k = 0; k < affected_.size(); ++k) {
      const std::size_t s = slot(affected_[k]);
      changed_at_[s] = clock_;
      distrusted_[s] = 0;
      set_.energy[s] = energies_[k];
      set_.star[s] = stars_[k];
    }
    for (const Index s : added_) {
      if (set_.at[slot(s)].facet != kNone && set_.at[slot(s)].barycentric.isZero(0)) {
        set_.at[slot(s)] = surface_point_below(diagram_.mesh(), set_.at[slot(s)].facet, diagram_.site(s).position());
      }
    }
  }

  /// Exact: none of these disks has the centre of another one or of a sample in it, nor is in a sample's.
  bool is_apart(const std::vector<NewSample>& samples) const {
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const NewSample& p = samples[k];
      if (grid_.conflicting_sample(p.x, p.radius, ConflictRule::kMax) != kNone) return false;
      for (std::size_t j = 0; j < k; ++j) {
        const double r = std::max(p.radius, samples[j].radius);
        if (side_of_ball(p.x.data(), samples[j].x.data(), r * r) < 0) return false;
      }
    }
    return true;
  }

  /// Energies of what the edit affected, before and after. Only stars of affected sites have changed.
  bool improves() {
    std::sort(affected_.begin(), affected_.end());
    affected_.erase(std::unique(affected_.begin(), affected_.end()), affected_.end());
    affected_.erase(std::remove_if(affected_.begin(), affected_.end(), [&](Index s) { return !set_.alive[slot(s)]; }),
                    affected_.end());
    double before = 0, after = 0;
    for (const OldSample& old : old_) before += old.energy;
    energies_.resize(affected_.size());
    stars_.resize(affected_.size());
    for (std::size_t k = 0; k < affected_.size(); ++k) {
      const Index s = affected_[k];
      if (std::find(added_.begin(), added_.end(), s) == added_.end()) before += set_.energy[slot(s)];
      energies_[k] = reader_.energy(s, stars_[k]);
      after += energies_[k];
    }
    change_ = after - before;
    return change_ < -kLeastGain || kicking_;
  }

  // Kicks: what no refill improves is refilled all the same, and what that has made bad is improved in turn. Should the whole
  // be no improvement, it is undone.

  struct Edit {
    std::vector<OldSample> old;
    std::vector<Index> added;
  };

  void kick_all(const std::vector<BadItem>& items, int most) {
    const std::size_t n = std::min(std::max(items.size(), kLeastKicks), kMostKicks);
    const std::uint64_t accepted = report_.accepted;
    for (std::size_t k = 0; k < n && (k < items.size() || report_.accepted == accepted); ++k) {
      if (!goes_on(items.size(), items.size())) return;
      const BadItem& item = items[k % items.size()];
      if (is_current(item)) kick(item, 1 + static_cast<int>(rng_.below(static_cast<std::uint64_t>(most))));
    }
  }

  void kick(const BadItem& item, int more) {
    RefillFinder finder(diagram_, set_, rating_, radii_, options_.refills);
    const std::uint64_t accepted = report_.accepted;
    journaling_ = true;
    journal_.clear();
    region_.clear();
    journal_change_ = 0;
    kicking_ = true;
    refill_in_place(item, more);
    kicking_ = false;
    std::vector<BadItem> items;
    for (int round = 0; round < kKickRounds && !journal_.empty() && !(journal_change_ < -kLeastGain); ++round) {
      items.clear();
      std::sort(region_.begin(), region_.end());
      region_.erase(std::unique(region_.begin(), region_.end()), region_.end());
      for (const Index s : region_) {
        if (!set_.alive[slot(s)] || !(set_.energy[slot(s)] > 0)) continue;
        reader_.read(s);
        list_bad(s, items);
      }
      const std::size_t edits = journal_.size();
      for (const BadItem& bad : items) {
        if (!is_current(bad)) continue;
        ++clock_;
        Proposal proposal = finder.find(bad, Rng(rng_.next()));
        carry_out(bad, proposal);
      }
      if (journal_.size() == edits) break;
    }
    journaling_ = false;
    if (journal_change_ < -kLeastGain) return;
    roll_back();
    report_.accepted = accepted;
  }

  void roll_back() {
    affected_ = region_;
    for (std::size_t k = journal_.size(); k-- > 0;) {
      old_ = journal_[k].old;
      added_ = journal_[k].added;
      for (const OldSample& old : old_) {
        free_.erase(std::find(free_.begin(), free_.end(), old.id));
        set_.at[slot(old.id)] = old.at;
        set_.radius[slot(old.id)] = old.radius;
        is_new_[slot(old.id)] = old.is_new;
      }
      undo();
    }
    std::sort(affected_.begin(), affected_.end());
    affected_.erase(std::unique(affected_.begin(), affected_.end()), affected_.end());
    for (const Index s : affected_) {
      if (set_.alive[slot(s)]) set_.energy[slot(s)] = reader_.energy(s, set_.star[slot(s)]);
    }
  }

  double gap_of(Index f) {
    if (!diagram_.alive(f)) return 0;
    const double reach = diagram_.reach(f);
    const auto polygon = diagram_.polygon(f);
    const WeightedPoint& site = diagram_.site(polygon.site);
    if (reach * reach <= site.w || !fragment_has_gap(diagram_, polygon)) return 0;
    return gap_.assign(fragment_view(diagram_.mesh(), polygon), ball_of(site));
  }

  /// Darts in the gaps among touched_ until there is none; false if that takes too many.
  bool fill() {
    for (int n = 0; n < kRefillSamples; ++n) {
      std::sort(touched_.begin(), touched_.end());
      touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
      gaps_.clear();
      double total = 0;
      for (const Index f : touched_) {
        const double area = gap_of(f);
        if (area > 0) gaps_.push_back({f, total += area});
      }
      if (gaps_.empty()) return true;
      const double u = rng_.uniform() * total;
      std::size_t k = 0;
      while (k + 1 < gaps_.size() && gaps_[k].second <= u) ++k;
      if (!throw_dart(gaps_[k].first)) return false;
    }
    return false;
  }

  bool throw_dart(Index f) {
    gap_of(f);
    const auto polygon = diagram_.polygon(f);
    const Index near = polygon.site;
    for (int dart = 0; dart < kRefillDarts; ++dart) {
      NewSample sample;
      sample.at = surface_point_below(diagram_.mesh(), polygon.facet, gap_.sample(rng_));
      sample.x = position_of(diagram_.mesh(), sample.at);
      if (!sample.x.allFinite()) continue;
      if (grid_.conflicting_sample(sample.x, 0, ConflictRule::kMax) != kNone) continue;
      sample.radius = radii_.field.empty() ? radii_.least : radii_.at(sample.at);
      if (!radii_.field.empty())
        sample.radius = radius_below(sample.radius, grid_.nearest_squared_distance(sample.x, sample.radius));
      enter(sample, near);
      return true;
    }
    return false;
  }

  bool affords_edits_in_place() const {
    return !reader_.rate_crossings || edits_in_place_ < kEditsAtCrossings + static_cast<std::uint64_t>(num_samples_) / 4;
  }

  /// Tries a random patch in the diagram itself, of `more` samples than usual.
  void refill_in_place(const BadItem& item, int more = 0) {
    if (!affords_edits_in_place()) return;
    std::vector<Index> removed = {item.a};
    if (item.b != kNone) {
      const auto choice = rng_.below(3);
      if (choice > 0) removed.push_back(choice == 1 && rng_.below(2) == 0 ? item.c : item.b);
      if (choice > 1) removed.push_back(item.c);
      std::swap(removed[0], removed[rng_.below(removed.size())]);
    }
    const int neighbors = (rng_.below(3) == 0 ? 2 : 0) + more;
    for (int k = 0; k < neighbors; ++k) {
      const auto& pairs = reader_.read(removed[rng_.below(removed.size())]);
      if (!pairs.empty()) {
        const Index s = pairs[rng_.below(pairs.size())][rng_.below(2)];
        if (std::find(removed.begin(), removed.end(), s) == removed.end()) removed.push_back(s);
      }
    }
    if (static_cast<Index>(removed.size()) + 1 >= diagram_.num_sites() - diagram_.num_removed()) return;
    begin_edit(removed);
    for (const Index s : removed) take_out(s);
    for (int refill = 0; refill < kRefillsInPlace; ++refill) {
      ++report_.trials;
      ++report_.edits;
      ++edits_in_place_;
      if (fill() && improves()) {
        keep();
        return;
      }
      undo_added();
    }
    undo();
  }

  RestrictedPowerDiagram& diagram_;
  const OptimizeOptions& options_;
  const DualRating rating_;
  StarReader reader_;
  const RefillRadii radii_;
  VoxelGrid grid_;  ///< of the samples there are
  Rng rng_;
  OptimizedSet set_;
  std::vector<std::uint64_t> changed_at_;  ///< the batch that changed a sample's star last
  std::uint64_t clock_ = 0, edits_in_place_ = 0;
  int iteration_ = 0;
  std::vector<char> distrusted_, is_new_;
  std::vector<Index> free_;  ///< ids to be used again
  OptimizeReport report_;
  const Index num_samples_ = static_cast<Index>(diagram_.num_sites() - diagram_.num_removed());
  Stopwatch watch_;
  double seconds_ = 0;

  std::vector<OldSample> old_;
  double change_ = 0;  ///< of the energy, by the last edit
  bool kicking_ = false, journaling_ = false;
  std::vector<Edit> journal_;
  std::vector<Index> region_;
  double journal_change_ = 0;
  std::vector<Index> added_, touched_, affected_;
  std::vector<double> energies_;
  std::vector<DualStar> stars_;
  std::vector<std::pair<Index, double>> gaps_;
  FragmentGap gap_;
};

}  // namespace

void require_optimize_options(const OptimizeOptions& options) {
  const auto fail = [](const std::string& what) { throw Error(ErrorCode::kInvalidArgument, "optimisation: " + what); };
  const auto bounded = [](double x, double low, double high) { return x == 0 || (x > low && x < high); };
  if (!bounded(options.min_angle, 0, 60)) {
    fail("min_angle is " + std::to_string(options.min_angle) +
         "; it must be above 0 and below 60 degrees, or 0 for the default");
  }
  if (!bounded(options.max_angle, 60, 180)) {
    fail("max_angle is " + std::to_string(options.max_angle) +
         "; it must be above 60 and below 180 degrees, or 0 for the default");
  }
  if (options.max_iterations < 0)
    fail("max_iterations is " + std::to_string(options.max_iterations) + "; it must be at least 0");
  if (options.refills < 1) fail("refills is " + std::to_string(options.refills) + "; it must be at least 1");
}

namespace {

std::pair<double, double> bounds_of(const OptimizeOptions& options, bool uniform) {
  return {options.min_angle != 0 ? options.min_angle
          : uniform              ? 35
                                 : 32,
          options.max_angle != 0 ? options.max_angle
          : uniform              ? 105
                                 : 114};
}

}  // namespace

double expected_growth(const OptimizeOptions& options, bool uniform) {
  // Medians over sphere, bunny and fertility, 8k samples: [30.5, 119], [35, 105], [38, 100], [42, 90], [45, 85].
  constexpr std::array<std::array<double, 2>, 5> kGrowth = {{{0, 0.008}, {5, 0.013}, {8, 0.023}, {12, 0.041}, {15, 0.045}}};
  constexpr double kUpperPerLower = 2.4;  // the upper bounds above are about so many times as far from 120 as the lower from 30
  const auto [low, high] = bounds_of(options, uniform);
  const double tightness = std::max(low - 30, (120 - high) / kUpperPerLower);
  if (!options.angles) return options.valences ? kGrowth[0][1] : 0;
  std::size_t k = 1;
  while (k + 1 < kGrowth.size() && tightness > kGrowth[k][0]) ++k;
  const double t = std::min(std::max((tightness - kGrowth[k - 1][0]) / (kGrowth[k][0] - kGrowth[k - 1][0]), 0.0), 1.0);
  return kGrowth[k - 1][1] + t * (kGrowth[k][1] - kGrowth[k - 1][1]);
}

bool has_gaps(const RestrictedPowerDiagram& diagram) {
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    if (diagram.alive(f) && fragment_has_gap(diagram, diagram.polygon(f))) return true;
  }
  return false;
}

OptimizeResult optimize_diagram(RestrictedPowerDiagram& diagram, const SampleSet& samples, const OptimizeOptions& options,
                                std::vector<Index>& ids) {
  require_optimize_options(options);
  const bool uniform = min_radius(samples) == max_radius(samples);
  const auto [min_angle, max_angle] = bounds_of(options, uniform);
  Optimizer optimizer(diagram, samples, options, min_angle, max_angle);
  OptimizeResult result;
  result.report = optimizer.run();
  result.samples = optimizer.samples(ids);
  return result;
}

}  // namespace detail

OptimizeResult optimize(const MeshView& mesh, const SampleSet& samples, const OptimizeOptions& options) {
  detail::require_optimize_options(options);
  if (!options.sizing.empty() && !options.sizing.fits(mesh)) {
    throw Error(ErrorCode::kInvalidArgument, "optimisation: the sizing field is of another mesh (" +
                                                 std::to_string(options.sizing.num_facets()) + " facets; this one has " +
                                                 std::to_string(mesh.num_facets()) +
                                                 "); make it from the mesh the samples are on");
  }
  std::vector<Index> ids;
  RestrictedPowerDiagram diagram = detail::diagram_of(mesh, samples, options.threads);
  if (!detail::has_gaps(diagram)) return detail::optimize_diagram(diagram, samples, options, ids);
  SamplingOptions filling;
  filling.sizing = options.sizing;
  filling.seed = options.seed;
  filling.threads = options.threads;
  filling.progress = options.progress;
  const SamplingResult filled = fill_gaps(mesh, samples, filling);
  if (filled.status == Status::kCancelled) {
    OptimizeResult result{filled.samples, {}};
    result.report.status = OptimizeStatus::kCancelled;
    return result;
  }
  RestrictedPowerDiagram whole = detail::diagram_of(mesh, filled.samples, options.threads);
  OptimizeResult result = detail::optimize_diagram(whole, filled.samples, options, ids);
  const auto first_new = ids.begin() + (filled.samples.size() - result.report.removed);
  const auto kept = static_cast<Index>(std::count_if(ids.begin(), first_new, [&](Index s) { return s < samples.size(); }));
  result.report.removed = samples.size() - kept;
  result.report.added = result.samples.size() - kept;
  return result;
}

void write_convergence(std::ostream& stream, const OptimizeReport& report) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out.precision(9);
  out << "iteration,bad_triangles,bad_vertices,min_angle,max_angle,samples,energy,seconds\n";
  for (std::size_t k = 0; k < report.iterations.size(); ++k) {
    const OptimizeIteration& line = report.iterations[k];
    out << k << ',' << line.bad_triangles << ',' << line.bad_vertices << ',' << line.min_angle << ',' << line.max_angle << ','
        << line.samples << ',' << line.energy << ',' << line.seconds << '\n';
  }
  stream << out.str();
}

std::ostream& operator<<(std::ostream& out, const OptimizeReport& report) {
  static constexpr const char* kStatus[] = {"done", "iteration limit", "stalled", "cancelled"};
  out << "optimisation to [" << report.min_angle << ", " << report.max_angle
      << "] degrees: " << kStatus[static_cast<std::size_t>(report.status)];
  if (!report.iterations.empty()) {
    const OptimizeIteration &first = report.iterations.front(), &last = report.iterations.back();
    out << " after " << report.iterations.size() - 1 << " iterations; bad triangles " << first.bad_triangles << " -> "
        << last.bad_triangles << ", bad vertices " << first.bad_vertices << " -> " << last.bad_vertices;
  }
  return out << "; samples -" << report.removed << " +" << report.added;
}

}  // namespace amps
