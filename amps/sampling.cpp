#define AMPS_OWN_SOURCE
#include "amps/sampling.h"

#include "amps/gaps.h"
#include "amps/kdtree.h"
#include "amps/voxel_grid.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ostream>
#include <utility>

namespace amps {
namespace detail {
namespace {

/// n·r²/area of a maximal Poisson-disk set of uniform radius: random sequential adsorption jams at a coverage of 0.547 with
/// disks of radius r/2 (Feder 1980), 0.547·4/π = 0.6965 far from borders.
constexpr double kMaximalDensity = 0.6965;
constexpr double kTargetTolerance = 0.02;
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

constexpr std::uint64_t kDartsPerReport = 1024;
constexpr Index kInsertionsPerReport = 256;

std::string number_text(double x) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", x);
  return text;
}

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

/// Refuses radii before any work that would end in memory exhaustion.
void require_feasible_radius(double radius, double area, const Box& box, const SamplingOptions& options) {
  if (!(radius > 0) || !std::isfinite(radius)) {
    throw Error(ErrorCode::kInvalidArgument,
                "sampling: the radius is " + number_text(radius) + "; it must be positive and finite");
  }
  const double expected = kMaximalDensity * area / radius / radius;
  if (!(expected < options.max_samples)) {
    throw Error(ErrorCode::kTooLarge, "sampling: radius " + number_text(radius) + " on an area of " + number_text(area) +
                                          " needs about " + number_text(expected) + " samples, more than max_samples, " +
                                          std::to_string(options.max_samples) + "; use a radius of at least " +
                                          number_text(std::sqrt(kMaximalDensity * area / options.max_samples) * 1.01));
  }
  if (!VoxelGrid::fits(box, radius)) {
    throw Error(ErrorCode::kTooLarge, "sampling: radius " + number_text(radius) +
                                          " is out of proportion to the mesh's diagonal " + number_text(box.diagonal()) +
                                          "; use one between 1e-6 and 1e6 of it, or rescale the mesh");
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
  SampleSet finish() const {
    const Eigen::Index n = size();
    return {Eigen::Map<const Points>(positions.data(), n, 3), Eigen::Map<const Eigen::VectorXd>(radii.data(), n), facets,
            Eigen::Map<const Points>(barycentrics.data(), n, 3)};
  }
};

Vec3 position_of(const MeshView& mesh, const SurfacePoint& at) {
  return at.barycentric[0] * mesh.corner(at.facet, 0) + at.barycentric[1] * mesh.corner(at.facet, 1) +
         at.barycentric[2] * mesh.corner(at.facet, 2);
}

/// Unit normal of a facet with area, at any scale whose squares a double holds.
Vec3 normal_of(const MeshView& mesh, Index facet) {
  const Vec3 a = mesh.corner(facet, 0);
  return (mesh.corner(facet, 1) - a).cross(mesh.corner(facet, 2) - a).stableNormalized();
}

/// The point of the facet below x, which lies in its plane up to rounding.
SurfacePoint surface_point(const MeshView& mesh, Index facet, const Vec3& x) {
  const Vec3 a = mesh.corner(facet, 0), b = mesh.corner(facet, 1), c = mesh.corner(facet, 2);
  const Vec3 normal = normal_of(mesh, facet);
  Vec3 weight((b - x).cross(c - x).dot(normal), (c - x).cross(a - x).dot(normal), (a - x).cross(b - x).dot(normal));
  weight = weight.cwiseMax(0.0);
  return {facet, weight / weight.sum()};
}

// ---------------------------------------------------------------------------------------------------------------------------
// Dart throwing

/// What both stages share: the mesh, one radius, the samples so far and the grid that tells conflicts among them.
struct SamplingTask {
  SamplingTask(const MeshView& m, const SamplingOptions& o, double r, std::uint64_t seed)
      : mesh(m), options(o), radius(r), grid(bounding_box(m), r), rng(seed) {
    report.radius = r;
    report.seed = seed;
  }
  const MeshView& mesh;
  const SamplingOptions& options;
  double radius;
  VoxelGrid grid;
  Rng rng;  ///< one sequence for both stages: gap darts must not repeat the random numbers of the first darts
  GrowingSet set;
  SamplingReport report;
  Status status = Status::kDone;
};

void run_darts(SamplingTask& task, const std::vector<double>& areas, double total) {
  Stopwatch watch;
  const AliasTable table(areas);
  Rng rng = task.rng;
  const double expected = kMaximalDensity * total / (task.radius * task.radius);
  for (int rejections = 0; rejections < task.options.max_rejections;) {
    SurfacePoint dart;
    dart.facet = table.pick(rng);
    dart.barycentric = uniform_barycentric(rng);
    const Vec3 x = position_of(task.mesh, dart);
    if (task.grid.conflicts(x)) {
      ++rejections;
    } else {
      rejections = 0;
      task.grid.insert(x, task.set.size());
      task.set.add(x, task.radius, dart);
    }
    if (++task.report.darts % kDartsPerReport == 0 &&
        !task.options.progress.report("dart throwing", std::min(1.0, task.set.size() / expected))) {
      task.status = Status::kCancelled;
      break;
    }
  }
  task.rng = rng;
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

  /// The leaf where the running sum passes u·total, u in [0, 1); one of positive weight. Requires total() > 0.
  Index pick(double u) const {
    double rest = u * total();
    std::size_t at = 1;
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

FragmentView fragment_view(const MeshView& mesh, const RestrictedPowerDiagram::Polygon& polygon) {
  return {polygon.corners, static_cast<std::size_t>(polygon.size), normal_of(mesh, polygon.facet)};
}

Ball ball_of(const WeightedPoint& site) { return {site.position(), site.w}; }

bool fragment_has_gap(const RestrictedPowerDiagram& diagram, const RestrictedPowerDiagram::Polygon& polygon) {
  return has_gap({polygon.corners, static_cast<std::size_t>(polygon.size), Vec3::UnitZ()}, ball_of(diagram.site(polygon.site)));
}

/// Gap area per fragment, kept up to date through insertions.
class GapFiller {
 public:
  GapFiller(SamplingTask& task, RestrictedPowerDiagram& diagram) : task_(task), diagram_(diagram) {
    for (Index f = 0; f < diagram.fragment_capacity(); ++f) refresh(f);
  }

  void run() {
    const double area_at_start = gaps_.total();
    for (Index n = 0; gaps_.total() > 0; ++n) {
      if (n % kInsertionsPerReport == 0 &&
          !task_.options.progress.report("gap filling", 1 - std::min(1.0, gaps_.total() / area_at_start))) {
        task_.status = Status::kCancelled;
        return;
      }
      fill_one();
    }
  }

 private:
  void refresh(Index f) {
    double area = 0;
    if (diagram_.alive(f) && !(diagram_.reach(f) <= task_.radius)) {
      const auto polygon = diagram_.polygon(f);
      if (fragment_has_gap(diagram_, polygon)) {
        area = gap_.assign(fragment_view(task_.mesh, polygon), ball_of(diagram_.site(polygon.site)));
      }
    }
    gaps_.set(f, area);
  }

  void fill_one() {
    const Index f = gaps_.pick(task_.rng.uniform());
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
    gaps_.set(f, 0.0);
  }

  /// Rounding may move a point of the gap into a ball: the doubles themselves are tested, exactly unless slack is given.
  bool is_free(const Vec3& x, const RestrictedPowerDiagram::Polygon& polygon, double slack) const {
    const double shrink = (1 - slack) * (1 - slack);
    const auto outside = [&](const Vec3& p, double w) { return side_of_ball(x.data(), p.data(), w * shrink) >= 0; };
    const WeightedPoint& owner = diagram_.site(polygon.site);
    if (!outside(owner.position(), owner.w)) return false;
    for (Index k = 0; k < polygon.size; ++k) {
      if (!RestrictedPowerDiagram::is_site(polygon.labels[k])) continue;
      const WeightedPoint& site = diagram_.site(polygon.labels[k]);
      if (!outside(site.position(), site.w)) return false;
    }
    const Index nearby = task_.grid.conflicting_sample(x);
    return nearby == kNone || (slack > 0 && outside(diagram_.site(nearby).position(), task_.radius * task_.radius));
  }

  void insert(const Vec3& x, const SurfacePoint& at, Index near) {
    task_.grid.insert(x, task_.set.size());
    task_.set.add(x, task_.radius, at);
    ++task_.report.gap_samples;
    diagram_.insert(x, task_.radius * task_.radius, near);
    for (const Index f : diagram_.changed()) refresh(f);
  }

  SamplingTask& task_;
  RestrictedPowerDiagram& diagram_;
  FragmentGap gap_;
  SumTree gaps_;
};

/// Second stage: the diagram of the samples so far, filled until no gap is left.
std::unique_ptr<RestrictedPowerDiagram> run_gap_filling(SamplingTask& task) {
  Stopwatch watch;
  const SampleSet start = task.set.finish();
  auto diagram = std::make_unique<RestrictedPowerDiagram>(task.mesh, start.positions, start.radii.cwiseAbs2(),
                                                          task.options.threads, task.options.progress);
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
  const bool by_count = options.target_count != 0;
  if (by_count == (options.radius != 0) || options.target_count < 0) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: set either a positive radius or a positive target_count");
  }
  const std::vector<double> areas = facet_areas(mesh);
  const double area = total_area(mesh);
  const Box box = bounding_box(mesh);
  const auto run_once = [&](double radius, std::uint64_t seed) {
    require_feasible_radius(radius, area, box, options);
    SamplingTask task(mesh, options, radius, seed);
    run_darts(task, areas, area);
    std::unique_ptr<RestrictedPowerDiagram> diagram;
    if (task.status == Status::kDone) diagram = run_gap_filling(task);
    return finish_run(task, std::move(diagram));
  };
  if (!by_count) return run_once(options.radius, options.seed);

  // The count is a random function of the radius, close to density·area/r²: every run improves the estimate of the density.
  const double target = options.target_count;
  const auto miss = [target](const SamplingRun& run) { return std::fabs(run.result.samples.size() - target) / target; };
  SamplingRun best;
  SamplingReport total;
  double density = kMaximalDensity, density_sum = 0;
  for (int attempt = 1; attempt <= kTargetAttempts; ++attempt) {
    const double radius = std::sqrt(density * area / target);
    SamplingRun run = run_once(radius, options.seed + static_cast<std::uint64_t>(attempt - 1) * kSeedStride);
    total.attempts = attempt;
    add_up(total, run.result.report);
    if (run.result.status == Status::kCancelled) {
      best = std::move(run);
      break;
    }
    // The first estimate may be far off (thin or rough surfaces): later ones start the mean over.
    const double estimate = run.result.samples.size() * radius * radius / area;
    density_sum = attempt == 2 ? 2 * estimate : density_sum + estimate;
    density = density_sum / attempt;
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

/// min |p_i − p_j| / max(r_i, r_j) over all pairs. Each pair is seen from its larger disk, within the best ratio so far.
double worst_separation_of(const RestrictedPowerDiagram& diagram) {
  const Index n = diagram.num_sites();
  double best = INFINITY;
  const RegularTriangulation::Adjacency around = diagram.adjacency();
  const auto ratio = [&](Index i, Index j) {
    const WeightedPoint &p = diagram.site(i), &q = diagram.site(j);
    return (p.position() - q.position()).norm() / std::sqrt(std::max(p.w, q.w));
  };
  // Neighbours in the triangulation give a bound, and with equal radii the answer: the nearest point is a neighbour.
  double least = INFINITY, greatest = 0;
  bool all_visible = true;
  for (Index i = 0; i < n; ++i) {
    least = std::min(least, diagram.site(i).w);
    greatest = std::max(greatest, diagram.site(i).w);
    all_visible = all_visible && diagram.visible(i);
    for (Index k = around.offset[static_cast<std::size_t>(i)]; k < around.offset[static_cast<std::size_t>(i) + 1]; ++k) {
      best = std::min(best, ratio(i, around.adjacent[static_cast<std::size_t>(k)]));
    }
  }
  if (all_visible && least == greatest) return best;
  Points positions(n, 3);
  for (Index i = 0; i < n; ++i) positions.row(i) = diagram.site(i).position().transpose();
  const KdTree tree(positions);
  std::vector<KdTree::Neighbor> found;
  for (Index i = 0; i < n; ++i) {
    const double w = diagram.site(i).w;
    // The bound's own rounding must not lose the pair that set it.
    const double reach = std::min(best, 1e150) * std::sqrt(w) * (1 + 1e-12);
    tree.in_radius(diagram.site(i).position(), reach, found);
    for (const KdTree::Neighbor& near : found) {
      if (near.index != i && diagram.site(near.index).w <= w) best = std::min(best, ratio(i, near.index));
    }
  }
  return best;
}

}  // namespace

MaximalityReport measure_maximality(const RestrictedPowerDiagram& diagram) {
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
  report.worst_separation = worst_separation_of(diagram);
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
    throw Error(ErrorCode::kInvalidArgument, "sampling: dart throwing alone needs a radius; target_count counts maximal sets");
  }
  const double area = total_area(mesh);
  detail::require_feasible_radius(options.radius, area, bounding_box(mesh), options);
  detail::SamplingTask task(mesh, options, options.radius, options.seed);
  detail::run_darts(task, facet_areas(mesh), area);
  return std::move(detail::finish_run(task, nullptr).result);
}

SamplingResult fill_gaps(const MeshView& mesh, const SampleSet& existing, const SamplingOptions& options) {
  require_usable(mesh);
  detail::require_sampling_options(options);
  detail::require_sample_set(existing);
  if (options.target_count != 0) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: gap filling takes a radius, not a target_count");
  }
  const double smallest = existing.radii.minCoeff();
  const double radius = options.radius == 0 ? smallest : options.radius;
  if (radius > smallest) {
    throw Error(ErrorCode::kInvalidArgument, "sampling: new disks of radius " + detail::number_text(radius) +
                                                 " could cover existing samples; use at most the smallest existing radius, " +
                                                 detail::number_text(smallest));
  }
  Box box = bounding_box(mesh);
  box.min = box.min.cwiseMin(existing.positions.colwise().minCoeff().transpose());
  box.max = box.max.cwiseMax(existing.positions.colwise().maxCoeff().transpose());
  detail::require_feasible_radius(radius, total_area(mesh), box, options);
  detail::SamplingTask task(mesh, options, radius, options.seed);
  task.grid = detail::VoxelGrid(box, radius);
  task.set.add_all(existing);
  for (Index s = 0; s < existing.size(); ++s) task.grid.insert(existing.positions.row(s).transpose(), s);
  auto diagram = detail::run_gap_filling(task);
  return std::move(detail::finish_run(task, std::move(diagram)).result);
}

MaximalityReport verify_maximal(const MeshView& mesh, const SampleSet& samples, unsigned threads) {
  return detail::measure_maximality(detail::diagram_of(mesh, samples, threads));
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
