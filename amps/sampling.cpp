#define AMPS_OWN_SOURCE
#include "amps/sampling.h"

#include "amps/count_model.h"
#include "amps/darts.h"
#include "amps/fragment_gaps.h"
#include "amps/kdtree.h"
#include "amps/spatial_sort.h"
#include "amps/voxel_grid.h"

#include <algorithm>
#include <cmath>
#include <ostream>
#include <utility>

namespace amps {
namespace detail {
namespace {

constexpr double kTargetTolerance = 0.01;
/// Runs made for a target end at this many, and sooner when together they have drawn this many samples: small sets, whose
/// counts scatter by more than the tolerance, are cheap to draw again.
constexpr int kTargetAttempts = 100;
constexpr int kLeastTargetAttempts = 8;
constexpr double kTargetSamples = 1e5;
/// Offset between the seeds of those runs: 2^64 over the golden ratio.
constexpr std::uint64_t kSeedStride = 0x9e3779b97f4a7c15u;

/// More samples than this would not leave the triangulation's cells their 32-bit names.
constexpr Index kMostSamples = 50'000'000;

/// A dart in a gap is thrown again when rounding puts it too close to a sample; so often before the tolerance is used.
constexpr int kGapDarts = 64;
/// Relative distance by which such a dart may be too close: a tenth of what the certificate allows.
constexpr double kSeparationSlack = 1e-10;

/// Gaps are chosen among so many fragments at a time, along a curve in space: where gap filling works, memory is at hand (two
/// thirds of the time at a million samples). The paper chooses among all gaps. Stretches that do not touch do not see each
/// other, so it does not matter which comes first, and within one choice is in proportion to ρ × area; only near where two of
/// them meet, each some 70 by 70 samples, is the order another. Counts of 24 sets of 19,500 samples: 19,510 ± 8, and 19,505 ± 8
/// chosen among all; stretches of 1024 make 0.4 % more, and so do stretches scattered in space.
constexpr std::size_t kFragmentsAtATime = 16384;

constexpr std::uint64_t kDartsPerReport = 1024;
constexpr Index kInsertionsPerReport = 256;

void require_sampling_options(const SamplingOptions& options) {
  if (options.max_rejections < 1) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: max_rejections is " + std::to_string(options.max_rejections) +
                                                 "; it must be at least 1 (the paper uses 300)");
  }
  if (options.max_samples < 1 || options.max_samples > kMostSamples) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: max_samples is " + std::to_string(options.max_samples) +
                                                 "; it must be between 1 and " + std::to_string(kMostSamples));
  }
}

/// Refuses radii before any work that would end in memory exhaustion. `density` is ∫dA/r².
void require_feasible_radii(double least, double greatest, double density, const Box& box, const SamplingOptions& options) {
  if (!(least > 0) || !std::isfinite(greatest)) {
    throw Error(ErrorCode::kInvalidArgument,
                "sampling: the radius is " + number_text(least) + "; it must be positive and finite");
  }
  const bool uniform = least == greatest;
  const std::string what =
      uniform ? "radius " + number_text(least) : "radii from " + number_text(least) + " to " + number_text(greatest);
  const double expected = kSamplesPerDensity * density;
  if (!(expected < options.max_samples)) {
    const double factor = std::sqrt(expected / options.max_samples) * 1.01;
    throw Error(ErrorCode::kTooLarge, "sampling: " + what + " need about " + number_text(expected) +
                                          " samples, more than max_samples, " + std::to_string(options.max_samples) + "; use " +
                                          (uniform ? "a radius of at least " + number_text(least * factor)
                                                   : "a sizing field scaled by at least " + number_text(factor)));
  }
  if (!VoxelGrid::fits(box, least, greatest)) {
    throw Error(ErrorCode::kTooLarge, "sampling: " + what + ": out of proportion to the mesh's diagonal " +
                                          number_text(box.diagonal()) +
                                          "; stay between 1e-6 and 1e6 of it, or rescale the mesh");
  }
}

/// Which of radius, sizing and target_count are given, and whether the field is this mesh's.
void require_one_sizing(const MeshView& mesh, const SamplingOptions& options) {
  const bool by_radius = options.radius != 0, by_count = options.target_count != 0, by_field = !options.sizing.empty();
  if (options.target_count < 0 || !(by_radius || by_count || by_field) || (by_radius && (by_count || by_field))) {
    throw Error(ErrorCode::kInvalidArgument,
                "sampling: set a positive radius, or a sizing field, or a positive target_count, or both of the last two");
  }
  if (by_field && !options.sizing.fits(mesh)) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: the sizing field is of another mesh (" +
                                                 std::to_string(options.sizing.num_facets()) + " facets; this one has " +
                                                 std::to_string(mesh.num_facets()) + "); make it from the mesh to be sampled");
  }
}

void require_sample_set(const SampleSet& samples) {
  if (samples.size() == 0) throw Error(ErrorCode::kInvalidArgument, "samples: the set is empty; give at least one sample");
  if (samples.radii.size() != samples.positions.rows()) {
    throw Error(ErrorCode::kInvalidArgument, "samples: " + std::to_string(samples.positions.rows()) + " positions with " +
                                                 std::to_string(samples.radii.size()) + " radii; give one radius a sample");
  }
  const bool placed = !samples.facets.empty() || samples.barycentrics.rows() != 0;
  if (placed && (samples.facets.size() != static_cast<std::size_t>(samples.size()) ||
                 samples.barycentrics.rows() != samples.positions.rows())) {
    throw Error(ErrorCode::kInvalidArgument, "samples: " + std::to_string(samples.positions.rows()) + " positions with " +
                                                 std::to_string(samples.facets.size()) + " facets and " +
                                                 std::to_string(samples.barycentrics.rows()) +
                                                 " barycentrics; give one of each a sample, or neither");
  }
  for (Index s = 0; s < samples.size(); ++s) {
    if (!samples.positions.row(s).allFinite() || !(samples.radii[s] > 0) || !std::isfinite(samples.radii[s])) {
      throw Error(ErrorCode::kInvalidArgument, "samples: sample " + std::to_string(s) +
                                                   " has a coordinate that is not finite or a radius that is not positive; "
                                                   "remove or repair it");
    }
  }
}

/// Samples while their number is not known yet.
struct GrowingSet {
  std::vector<double> positions, barycentrics, radii;
  std::vector<Index> facets;

  Index size() const { return static_cast<Index>(radii.size()); }
  void add(const Vec3& position, double radius, const SurfacePoint& at) {
    positions.insert(positions.end(), {position.x(), position.y(), position.z()});
    barycentrics.insert(barycentrics.end(), {at.barycentric.x(), at.barycentric.y(), at.barycentric.z()});
    radii.push_back(radius);
    facets.push_back(at.facet);
  }
  void add_all(const SampleSet& samples) {
    const bool placed = !samples.facets.empty();
    for (Index s = 0; s < samples.size(); ++s) {
      SurfacePoint at;
      if (placed) at = {samples.facets[static_cast<std::size_t>(s)], samples.barycentrics.row(s).transpose()};
      add(samples.positions.row(s).transpose(), samples.radii[s], at);
    }
  }
  Eigen::Map<const Points> points() const { return {positions.data(), size(), 3}; }
  Vec3 position(Index s) const { return {positions[3 * slot(s)], positions[3 * slot(s) + 1], positions[3 * slot(s) + 2]}; }
  void reorder(const std::vector<Index>& order) {
    GrowingSet sorted;
    for (const Index s : order) {
      const double* const b = barycentrics.data() + 3 * slot(s);
      sorted.add(position(s), radii[slot(s)], {facets[slot(s)], {b[0], b[1], b[2]}});
    }
    *this = std::move(sorted);
  }
  SampleSet finish() const {
    const Eigen::Index n = size();
    return {Eigen::Map<const Points>(positions.data(), n, 3), Eigen::Map<const Eigen::VectorXd>(radii.data(), n), facets,
            Eigen::Map<const Points>(barycentrics.data(), n, 3)};
  }
};

// ---------------------------------------------------------------------------------------------------------------------------
// Dart throwing

/// The radii that are wanted, point by point: one for all, or a field.
class WantedRadii {
 public:
  explicit WantedRadii(double radius) : radius_(radius) {}
  /// A field that is the same everywhere is one radius.
  explicit WantedRadii(const SizingField& field)
      : radius_(field.min_radius()), field_(field.min_radius() == field.max_radius() ? SizingField() : field) {}
  /// But not where the samples of others have radii of their own.
  static WantedRadii varying(const SizingField& field) {
    WantedRadii result(field.min_radius());
    result.field_ = field;
    return result;
  }

  bool uniform() const { return field_.empty(); }
  const SizingField& field() const { return field_; }
  double at(const SurfacePoint& x) const { return uniform() ? radius_ : field_.radius(x); }
  double least() const { return uniform() ? radius_ : field_.min_radius(); }
  double greatest() const { return uniform() ? radius_ : field_.max_radius(); }
  /// ∫dA/r²
  double density_integral(double area) const { return uniform() ? area / radius_ / radius_ : field_.density_integral(); }

 private:
  double radius_;
  SizingField field_;
};

/// What both stages share: the mesh, the wanted radii, the samples so far and the grid that tells conflicts among them.
struct SamplingTask {
  SamplingTask(const MeshView& m, const SamplingOptions& o, const WantedRadii& r, std::uint64_t seed)
      : mesh(m), options(o), radii(r), grid(bounding_box(m), r.least(), r.greatest()), rng(seed) {
    if (r.uniform()) report.radius = r.least();
    report.seed = seed;
  }
  /// The next sample.
  void store(const Vec3& x, double radius, const SurfacePoint& at) {
    enter(x, radius, set.size());
    set.add(x, radius, at);
  }
  void enter(const Vec3& x, double radius, Index id) {
    if (radii.uniform()) {
      grid.insert(x, id);
    } else {
      grid.insert(x, radius, id);
    }
  }
  /// Samples get new numbers, in the order of a curve: what follows reaches for neighbours in space, which now are neighbours
  /// in memory.
  void sort_along_curve() {
    Stopwatch watch;
    set.reorder(curve_order(set.points()));
    grid = VoxelGrid(bounding_box(mesh), radii.least(), radii.greatest());
    for (Index s = 0; s < set.size(); ++s) enter(set.position(s), set.radii[slot(s)], s);
    report.seconds_darts += watch.lap();
  }

  const MeshView& mesh;
  const SamplingOptions& options;
  const WantedRadii& radii;
  VoxelGrid grid;
  Rng rng;  ///< one sequence for both stages: gap darts must not repeat the random numbers of the first darts
  GrowingSet set;
  SamplingReport report;
  Status status = Status::kDone;
};

/// Darts of one radius: uniform on the surface.
class UniformDarts {
 public:
  explicit UniformDarts(const SamplingTask& task)
      : grid_(task.grid), radius_(task.radii.least()), table_(facet_areas(task.mesh)) {}
  SurfacePoint draw(Rng& rng) const {
    SurfacePoint dart;
    dart.facet = table_.pick(rng);
    dart.barycentric = uniform_barycentric(rng);
    return dart;
  }
  double radius(const SurfacePoint&) const { return radius_; }
  bool conflicts(const Vec3& x, double) const { return grid_.conflicts(x); }

 private:
  const VoxelGrid& grid_;
  double radius_;
  AliasTable table_;
};

std::vector<double> piece_densities(const SizingField& field) {
  std::vector<double> result(field.num_pieces());
  for (std::size_t i = 0; i < result.size(); ++i) result[i] = field.density_integral(i);
  return result;
}

/// Darts of a sizing field: density exactly ρ = 1/r².
class FieldDarts {
 public:
  explicit FieldDarts(const SamplingTask& task)
      : grid_(task.grid),
        field_(task.radii.field()),
        by_max_(task.options.conflict_rule == ConflictRule::kMax),
        table_(piece_densities(field_)) {}

  SurfacePoint draw(Rng& rng) const {
    const SizingField::Piece piece = field_.piece(static_cast<std::size_t>(table_.pick(rng)));
    const Vec3 b = density_barycentric(piece.radii, rng);
    return {piece.facet, b[0] * piece.corners[0] + b[1] * piece.corners[1] + b[2] * piece.corners[2]};
  }
  double radius(const SurfacePoint& at) const { return field_.radius(at); }
  bool conflicts(const Vec3& x, double radius) const {
    return (by_max_ ? grid_.conflicting_sample_by_max(x, radius) : grid_.conflicting_sample_by_min(x, radius)) != kNone;
  }

 private:
  const VoxelGrid& grid_;
  const SizingField& field_;
  bool by_max_;
  AliasTable table_;
};

/// Darts are drawn some at a time, whatever becomes of the first of them: the voxels they will look at are on their way from
/// memory meanwhile. A third of the time of a large set.
template <class Darts>
void throw_all(SamplingTask& task, Darts&& darts, double expected) {
  struct Thrown {
    SurfacePoint at;
    Vec3 x;
    double radius;
    Rng after;  ///< the generator once this dart was drawn
  };
  constexpr std::size_t kAhead = 16;
  Rng rng = task.rng;
  std::vector<Thrown> thrown(kAhead, Thrown{{}, Vec3::Zero(), 0, rng});
  for (int rejections = 0;;) {
    for (Thrown& dart : thrown) {
      dart.at = darts.draw(rng);
      dart.x = position_of(task.mesh, dart.at);
      dart.radius = darts.radius(dart.at);
      dart.after = rng;
      task.grid.prefetch_voxel(dart.x, dart.radius);
    }
    for (const Thrown& dart : thrown) task.grid.prefetch_samples(dart.x, dart.radius);
    for (const Thrown& dart : thrown) {
      if (darts.conflicts(dart.x, dart.radius)) {
        ++rejections;
      } else {
        rejections = 0;
        task.store(dart.x, dart.radius, dart.at);
      }
      const bool goes_on = ++task.report.darts % kDartsPerReport != 0 ||
                           task.options.progress.report("dart throwing", std::min(1.0, task.set.size() / expected));
      if (!goes_on) task.status = Status::kCancelled;
      if (!goes_on || rejections >= task.options.max_rejections) {
        task.rng = dart.after;
        return;
      }
    }
  }
}

/// `density` is ∫dA/r².
void run_darts(SamplingTask& task, double density) {
  Stopwatch watch;
  const double expected = kSamplesPerDensity * density;
  if (task.radii.uniform()) {
    throw_all(task, UniformDarts(task), expected);
  } else {
    throw_all(task, FieldDarts(task), expected);
  }
  task.report.dart_samples = task.set.size();
  task.report.seconds_darts += watch.lap();
}

// ---------------------------------------------------------------------------------------------------------------------------
// Gap filling

/// Non-negative weights with O(log n) update and choice in proportion to them. Sums are recomputed from the leaves, never
/// incremented, so they depend on the weights alone.
class SumTree {
 public:
  double total() const { return nodes_.empty() ? 0.0 : nodes_[1]; }

  void set(Index i, double weight) {
    if (static_cast<std::size_t>(i) >= leaves_) grow(static_cast<std::size_t>(i) + 1);
    std::size_t at = leaves_ + static_cast<std::size_t>(i);
    if (nodes_[at] == weight) return;
    nodes_[at] = weight;
    for (at /= 2; at > 0; at /= 2) nodes_[at] = nodes_[2 * at] + nodes_[2 * at + 1];
  }

  /// Of the first `stretch` leaves (a power of two, aligned) that have any weight, the one where their running sum passes u
  /// times their total, u in [0, 1); one of positive weight. Requires total() > 0.
  Index pick(double u, std::size_t stretch) const {
    std::size_t at = 1;
    for (std::size_t span = leaves_; span > stretch; span /= 2) {
      at *= 2;
      if (!(nodes_[at] > 0)) ++at;
    }
    double rest = u * nodes_[at];
    while (at < leaves_) {
      at *= 2;
      // Rounding must not lead into an empty branch.
      if ((rest >= nodes_[at] && nodes_[at + 1] > 0) || !(nodes_[at] > 0)) {
        rest -= nodes_[at];
        ++at;
      }
    }
    return static_cast<Index>(at - leaves_);
  }

 private:
  void grow(std::size_t wanted) {
    std::size_t leaves = std::max<std::size_t>(leaves_, 64);
    while (leaves < wanted) leaves *= 2;
    std::vector<double> nodes(2 * leaves, 0.0);
    std::copy(nodes_.begin() + static_cast<std::ptrdiff_t>(leaves_), nodes_.end(),
              nodes.begin() + static_cast<std::ptrdiff_t>(leaves));
    nodes_.swap(nodes);
    leaves_ = leaves;
    for (std::size_t at = leaves_ - 1; at > 0; --at) nodes_[at] = nodes_[2 * at] + nodes_[2 * at + 1];
  }
  std::vector<double> nodes_;
  std::size_t leaves_ = 0;
};

/// Gap area per fragment times ρ there, kept up to date through insertions.
class GapFiller {
 public:
  GapFiller(SamplingTask& task, RestrictedPowerDiagram& diagram) : task_(task), diagram_(diagram) {
    leaf_of_.resize(slot(diagram.fragment_capacity()));
    for (const Index s : curve_order(task.set.points())) {
      for (Index f = diagram.first_of_site(s); f != kNone; f = diagram.next_of_site(f)) {
        leaf_of_[slot(f)] = static_cast<Index>(fragment_at_.size());
        fragment_at_.push_back(f);
      }
    }
    for (Index f = 0; f < diagram.fragment_capacity(); ++f) refresh(f);
  }

  void run() {
    const double at_start = gaps_.total();
    double done = 0;  // ρ in the middle of what is left of a fragment may rise
    for (Index n = 0; gaps_.total() > 0; ++n) {
      if (n % kInsertionsPerReport == 0) {
        done = std::max(done, 1 - std::min(1.0, gaps_.total() / at_start));
        if (!task_.options.progress.report("gap filling", done)) {
          task_.status = Status::kCancelled;
          return;
        }
      }
      fill_one();
    }
  }

 private:
  void refresh(Index f) {
    double weight = 0;
    if (diagram_.alive(f) && !surely_covered(f)) {
      const auto polygon = diagram_.polygon(f);
      if (fragment_has_gap(diagram_, polygon)) {
        weight = gap_.assign(fragment_view(task_.mesh, polygon), ball_of(diagram_.site(polygon.site))) * density(polygon);
      }
    }
    set_weight(f, weight);
  }

  /// Fragments that come later are the last leaves.
  void set_weight(Index f, double weight) { gaps_.set(slot(f) < leaf_of_.size() ? leaf_of_[slot(f)] : f, weight); }

  Index choose_fragment() {
    const Index leaf = gaps_.pick(task_.rng.uniform(), kFragmentsAtATime);
    return slot(leaf) < fragment_at_.size() ? fragment_at_[slot(leaf)] : leaf;
  }

  bool surely_covered(Index f) const {
    if (task_.radii.uniform()) return diagram_.reach(f) <= task_.radii.least();
    const double reach = diagram_.reach(f);
    return reach * reach <= diagram_.site(diagram_.polygon(f).site).w;
  }

  /// ρ in the middle of a fragment, in units of its greatest value. Above the square of rounding, so that no gap goes unseen.
  double density(const RestrictedPowerDiagram::Polygon& polygon) const {
    if (task_.radii.uniform()) return 1;
    Vec3 sum = Vec3::Zero();
    for (Index k = 0; k < polygon.size; ++k) sum += polygon.corners[k];
    const double ratio = task_.radii.least() / task_.radii.at(surface_point(task_.mesh, polygon.facet, sum / polygon.size));
    return ratio * ratio;
  }

  void fill_one() {
    const Index f = choose_fragment();
    const auto polygon = diagram_.polygon(f);
    gap_.assign(fragment_view(task_.mesh, polygon), ball_of(diagram_.site(polygon.site)));
    for (int dart = 0; dart < kGapDarts; ++dart) {
      const SurfacePoint at = surface_point(task_.mesh, polygon.facet, gap_.sample(task_.rng));
      const Vec3 x = position_of(task_.mesh, at);
      if (x.allFinite() && is_free(x, polygon, dart + 1 == kGapDarts ? kSeparationSlack : 0.0)) {
        insert(x, at, polygon.site);
        return;
      }
    }
    ++task_.report.unfilled_gaps;
    set_weight(f, 0.0);
  }

  /// Rounding may move a point of the gap into a ball: the doubles themselves are tested, exactly unless slack is given.
  bool is_free(const Vec3& x, const RestrictedPowerDiagram::Polygon& polygon, double slack) const {
    const double shrink = (1 - slack) * (1 - slack);
    const auto outside = [&](Index s, double w) {
      return side_of_ball(x.data(), diagram_.site(s).position().data(), w * shrink) >= 0;
    };
    if (!outside(polygon.site, diagram_.site(polygon.site).w)) return false;
    for (Index k = 0; k < polygon.size; ++k) {
      const Index label = polygon.labels[k];
      if (RestrictedPowerDiagram::is_site(label) && !outside(label, diagram_.site(label).w)) return false;
    }
    const bool uniform = task_.radii.uniform();
    const Index nearby = uniform ? task_.grid.conflicting_sample(x) : task_.grid.conflicting_sample_by_max(x, 0);
    if (nearby == kNone) return true;
    return slack > 0 && outside(nearby, uniform ? task_.radii.least() * task_.radii.least() : diagram_.site(nearby).w);
  }

  double radius_at(const Vec3& x, const SurfacePoint& at) const {
    const double wanted = task_.radii.at(at);
    if (task_.radii.uniform() || task_.options.conflict_rule == ConflictRule::kMin) return wanted;
    return radius_below(wanted, task_.grid.nearest_squared_distance(x, wanted));
  }

  void insert(const Vec3& x, const SurfacePoint& at, Index near) {
    const double radius = radius_at(x, at);
    task_.store(x, radius, at);
    ++task_.report.gap_samples;
    diagram_.insert(x, radius * radius, near);
    for (const Index f : diagram_.changed()) refresh(f);
  }

  SamplingTask& task_;
  RestrictedPowerDiagram& diagram_;
  FragmentGap gap_;
  SumTree gaps_;
  std::vector<Index> leaf_of_, fragment_at_;  ///< fragments of the start in the order of a curve over their sites, and back
};

/// Second stage: the diagram of the samples so far, filled until no gap is left.
std::unique_ptr<RestrictedPowerDiagram> run_gap_filling(SamplingTask& task) {
  Stopwatch watch;
  const Eigen::VectorXd weights = Eigen::Map<const Eigen::VectorXd>(task.set.radii.data(), task.set.size()).cwiseAbs2();
  auto diagram = std::make_unique<RestrictedPowerDiagram>(task.mesh, task.set.points(), weights, task.options.threads,
                                                          task.options.progress);
  task.report.seconds_triangulation += diagram->seconds_triangulation();
  task.report.seconds_diagram += watch.lap() - diagram->seconds_triangulation();
  if (task.options.progress.cancelled()) {
    task.status = Status::kCancelled;
    return nullptr;
  }
  GapFiller(task, *diagram).run();
  task.report.seconds_gaps += watch.lap();
  return diagram;
}

SamplingRun finish_run(SamplingTask& task, std::unique_ptr<RestrictedPowerDiagram> diagram) {
  const std::vector<double>& radii = task.set.radii;
  if (!radii.empty()) {
    task.report.min_radius = *std::min_element(radii.begin(), radii.end());
    task.report.max_radius = *std::max_element(radii.begin(), radii.end());
    for (const double r : radii) task.report.mean_radius += r / static_cast<double>(radii.size());
  }
  return {{task.set.finish(), task.report, task.status}, std::move(diagram)};
}

/// Times and attempts add up over the runs made for one target.
void add_up(SamplingReport& total, const SamplingReport& run) {
  total.seconds_darts += run.seconds_darts;
  total.seconds_triangulation += run.seconds_triangulation;
  total.seconds_diagram += run.seconds_diagram;
  total.seconds_gaps += run.seconds_gaps;
}

}  // namespace

SamplingRun sample_with_diagram(const MeshView& mesh, const SamplingOptions& options) {
  require_usable(mesh);
  require_sampling_options(options);
  require_one_sizing(mesh, options);
  const double area = total_area(mesh);
  const Box box = bounding_box(mesh);
  const auto run_once = [&](const WantedRadii& radii, std::uint64_t seed) {
    const double density = radii.density_integral(area);
    require_feasible_radii(radii.least(), radii.greatest(), density, box, options);
    SamplingTask task(mesh, options, radii, seed);
    run_darts(task, density);
    std::unique_ptr<RestrictedPowerDiagram> diagram;
    if (task.status == Status::kDone) task.sort_along_curve();
    if (task.status == Status::kDone) diagram = run_gap_filling(task);
    return finish_run(task, std::move(diagram));
  };
  const bool by_field = !options.sizing.empty();
  if (options.target_count == 0) {
    return run_once(by_field ? WantedRadii(options.sizing) : WantedRadii(options.radius), options.seed);
  }

  CountModel model(mesh, options.sizing, options.target_count);
  const double target = options.target_count;
  const auto miss = [target](const SamplingRun& run) { return std::fabs(run.result.samples.size() - target) / target; };
  SamplingRun best;
  SamplingReport total;
  for (int attempt = 1; attempt <= kTargetAttempts; ++attempt) {
    const double scale = model.scale();
    SamplingRun run = run_once(by_field ? WantedRadii(options.sizing.scaled(scale)) : WantedRadii(scale),
                               options.seed + static_cast<std::uint64_t>(attempt - 1) * kSeedStride);
    if (by_field) run.result.report.sizing_scale = scale;
    total.attempts = attempt;
    add_up(total, run.result.report);
    if (run.result.status == Status::kCancelled) {
      best = std::move(run);
      break;
    }
    model.learn(run.result.samples.size());
    if (attempt == 1 || miss(run) < miss(best)) best = std::move(run);
    if (miss(best) <= kTargetTolerance) break;
    if (attempt >= kLeastTargetAttempts && attempt * target > kTargetSamples) break;
  }
  SamplingReport& report = best.result.report;
  report.attempts = total.attempts;
  report.seconds_darts = total.seconds_darts;
  report.seconds_triangulation = total.seconds_triangulation;
  report.seconds_diagram = total.seconds_diagram;
  report.seconds_gaps = total.seconds_gaps;
  return best;
}

RestrictedPowerDiagram diagram_of(const MeshView& mesh, const SampleSet& samples, unsigned threads) {
  require_sample_set(samples);
  return {mesh, samples.positions, samples.radii.cwiseAbs2(), threads};
}

namespace {

/// min over all pairs of |p_i − p_j| over the greater radius, or over the lesser one.
///
/// Neighbours in the triangulation are enough where all sites are visible and every two neighbours i, j satisfy d² ≥ max(w_i,
/// w_j), decided exactly. (1) Then p_j lies in its own power cell, which its neighbours bound, so d_ij² − w_i ≥ −w_j for all i,
/// and on the segment between any two sites there is a point x of equal power to both. (2) Let i, j, w_i ≥ w_j, be the pair of
/// least q = d² − max(w_i, w_j), and not neighbours. Some k has less power at x than they. At x the squared distance from p_k
/// is by Stewart's theorem the mean, by the shares of the segment, of those at its ends, less the product of its parts; with q
/// for the pairs (i, k), (j, k) that makes q + mean(max(w_k, w_i), max(w_k, w_j)) < (q − w_j)/2 + w_k, hence q < −w_j, against
/// (1). So all pairs are as they should be. (3) In the same way, if ρ ≥ 1 is the least d/max(r_i, r_j) over all pairs, then a
/// pair that has it are neighbours: with ρ² max(w_k, ·) for the squared distances from p_k both w_k ≤ w_i and w_k > w_i
/// contradict.
class SeparationMeasure {
 public:
  SeparationMeasure(const RestrictedPowerDiagram& diagram, ConflictRule rule)
      : diagram_(diagram), by_max_(rule == ConflictRule::kMax) {}

  double worst() {
    look_at_neighbors();
    const bool known = all_visible_ && ((by_max_ && neighbors_apart_) || least_ == greatest_);
    if (!known) look_at_all_pairs();
    return best_;
  }

 private:
  double ratio(const WeightedPoint& p, const WeightedPoint& q) const {
    return (p.position() - q.position()).norm() / std::sqrt(by_max_ ? std::max(p.w, q.w) : std::min(p.w, q.w));
  }

  void look_at_neighbors() {
    const RegularTriangulation::Adjacency around = diagram_.adjacency();
    for (Index i = 0; i < diagram_.num_sites(); ++i) {
      if (diagram_.removed(i)) continue;
      const WeightedPoint& p = diagram_.site(i);
      least_ = std::min(least_, p.w);
      greatest_ = std::max(greatest_, p.w);
      all_visible_ = all_visible_ && diagram_.visible(i);
      for (Index k = around.offset[slot(i)]; k < around.offset[slot(i) + 1]; ++k) {
        if (around.adjacent[slot(k)] < i) continue;
        const WeightedPoint& q = diagram_.site(around.adjacent[slot(k)]);
        const double between = ratio(p, q);
        best_ = std::min(best_, between);
        constexpr double kRounding = 1e-14;  // of the ratio
        if (between > 1 + kRounding) continue;
        const Vec3 centre = q.position();
        neighbors_apart_ = neighbors_apart_ && side_of_ball(&p.x, centre.data(), std::max(p.w, q.w)) >= 0;
      }
    }
  }

  /// Each pair is seen from the disk that counts, within the best ratio so far.
  void look_at_all_pairs() {
    std::vector<WeightedPoint> sites;
    for (Index i = 0; i < diagram_.num_sites(); ++i) {
      if (!diagram_.removed(i)) sites.push_back(diagram_.site(i));
    }
    const auto n = static_cast<Index>(sites.size());
    Points positions(n, 3);
    for (Index i = 0; i < n; ++i) positions.row(i) = sites[slot(i)].position().transpose();
    const KdTree tree(positions);
    std::vector<KdTree::Neighbor> found;
    for (Index i = 0; i < n; ++i) {
      const WeightedPoint& p = sites[slot(i)];
      // The bound's own rounding must not lose the pair that set it.
      const double reach = std::min(best_, 1e150) * std::sqrt(p.w) * (1 + 1e-12);
      tree.in_radius(p.position(), reach, found);
      for (const KdTree::Neighbor& near : found) {
        const WeightedPoint& q = sites[slot(near.index)];
        if (near.index != i && (by_max_ ? q.w <= p.w : q.w >= p.w)) best_ = std::min(best_, ratio(p, q));
      }
    }
  }

  const RestrictedPowerDiagram& diagram_;
  bool by_max_;
  double best_ = INFINITY;
  double least_ = INFINITY, greatest_ = 0;
  bool all_visible_ = true;
  bool neighbors_apart_ = true;
};

}  // namespace

MaximalityReport measure_maximality(const RestrictedPowerDiagram& diagram, ConflictRule rule) {
  MaximalityReport report;
  FragmentGap gap;
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    if (!diagram.alive(f)) continue;
    const auto polygon = diagram.polygon(f);
    const WeightedPoint& site = diagram.site(polygon.site);
    for (Index k = 0; k < polygon.size; ++k) {
      report.worst_coverage = std::max(report.worst_coverage, (polygon.corners[k] - site.position()).squaredNorm() / site.w);
    }
    if (!fragment_has_gap(diagram, polygon)) continue;
    ++report.gaps;
    report.gap_area += gap.assign(fragment_view(diagram.mesh(), polygon), ball_of(site));
  }
  report.worst_coverage = std::sqrt(report.worst_coverage);
  report.worst_separation = SeparationMeasure(diagram, rule).worst();
  return report;
}

}  // namespace detail

// ---------------------------------------------------------------------------------------------------------------------------

SamplingResult sample(const MeshView& mesh, const SamplingOptions& options) {
  return std::move(detail::sample_with_diagram(mesh, options).result);
}

SamplingResult throw_darts(const MeshView& mesh, const SamplingOptions& options) {
  require_usable(mesh);
  detail::require_sampling_options(options);
  if (options.target_count != 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "sampling: dart throwing alone needs a radius or a sizing field; target_count counts maximal sets");
  }
  detail::require_one_sizing(mesh, options);
  const detail::WantedRadii radii =
      options.sizing.empty() ? detail::WantedRadii(options.radius) : detail::WantedRadii(options.sizing);
  const double density = radii.density_integral(total_area(mesh));
  detail::require_feasible_radii(radii.least(), radii.greatest(), density, bounding_box(mesh), options);
  detail::SamplingTask task(mesh, options, radii, options.seed);
  detail::run_darts(task, density);
  return std::move(detail::finish_run(task, nullptr).result);
}

SamplingResult fill_gaps(const MeshView& mesh, const SampleSet& existing, const SamplingOptions& options) {
  require_usable(mesh);
  detail::require_sampling_options(options);
  detail::require_sample_set(existing);
  if (options.target_count != 0) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: gap filling takes a radius or a sizing field, not a target_count");
  }
  if (options.radius != 0 || !options.sizing.empty()) detail::require_one_sizing(mesh, options);
  const double smallest = existing.radii.minCoeff();
  const double radius = options.radius == 0 ? smallest : options.radius;
  if (radius > smallest) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: new disks of radius " + detail::number_text(radius) +
                                                 " could cover existing samples; use at most the smallest existing radius, " +
                                                 detail::number_text(smallest));
  }
  const detail::WantedRadii radii =
      options.sizing.empty() ? detail::WantedRadii(radius) : detail::WantedRadii::varying(options.sizing);
  Box box = bounding_box(mesh);
  box.min = box.min.cwiseMin(existing.positions.colwise().minCoeff().transpose());
  box.max = box.max.cwiseMax(existing.positions.colwise().maxCoeff().transpose());
  const double density = radii.density_integral(total_area(mesh));
  detail::require_feasible_radii(radii.least(), radii.greatest(), density, box, options);
  detail::SamplingTask task(mesh, options, radii, options.seed);
  if (radii.uniform()) {
    task.grid = detail::VoxelGrid(box, radius);
  } else {  // new disks may be as small as the existing ones
    const double least = std::min(radii.least(), smallest), greatest = std::max(radii.greatest(), existing.radii.maxCoeff());
    detail::require_feasible_radii(least, greatest, density, box, options);
    task.grid = detail::VoxelGrid(box, least, greatest);
  }
  task.set.add_all(existing);
  for (Index s = 0; s < existing.size(); ++s) {
    task.enter(existing.positions.row(s).transpose(), existing.radii[s], s);
  }
  auto diagram = detail::run_gap_filling(task);
  return std::move(detail::finish_run(task, std::move(diagram)).result);
}

MaximalityReport verify_maximal(const MeshView& mesh, const SampleSet& samples, unsigned threads, ConflictRule rule) {
  return detail::measure_maximality(detail::diagram_of(mesh, samples, threads), rule);
}

GapSet find_gaps(const MeshView& mesh, const SampleSet& samples, unsigned threads) {
  const RestrictedPowerDiagram diagram = detail::diagram_of(mesh, samples, threads);
  detail::FragmentGap gap;
  GapSet result;
  std::vector<double> corners;
  for (Index f = 0; f < diagram.fragment_capacity(); ++f) {
    const auto polygon = diagram.polygon(f);
    if (!diagram.alive(f) || !detail::fragment_has_gap(diagram, polygon)) continue;
    ++result.gaps;
    result.area += gap.assign(detail::fragment_view(mesh, polygon), detail::ball_of(diagram.site(polygon.site)));
    for (std::size_t k = 0; k < gap.num_primitives(); ++k) {
      for (const Vec3& corner : gap.primitive(k)) corners.insert(corners.end(), {corner.x(), corner.y(), corner.z()});
      result.facets.push_back(polygon.facet);
    }
  }
  const Eigen::Index triangles = static_cast<Eigen::Index>(result.facets.size());
  result.primitives.vertices = Eigen::Map<const Points>(corners.data(), 3 * triangles, 3);
  result.primitives.triangles.resize(triangles, 3);
  for (Index t = 0; t < triangles; ++t) result.primitives.triangles.row(t) << 3 * t, 3 * t + 1, 3 * t + 2;
  return result;
}

std::ostream& operator<<(std::ostream& out, const MaximalityReport& report) {
  return out << "worst coverage " << report.worst_coverage << ", worst separation " << report.worst_separation << ", gaps "
             << report.gaps << " of area " << report.gap_area;
}

}  // namespace amps
