#define AMPS_OWN_SOURCE
#include "amps/curve_sampling.h"

#include "amps/box_tree.h"
#include "amps/curve_proximity.h"
#include "amps/curve_spacing.h"
#include "amps/predicates.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace amps::detail {

std::vector<Index> homes_of(const SurfaceFlood& flood, const CurveSample& sample) {
  return sample.vertex != kNone ? flood.homes_of_vertex(sample.vertex) : flood.homes_of_edge(sample.edge);
}

namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

// Rules of DESIGN §11, with their reasons.

/// Samples closer to curves than this share of the wanted radius keep it nevertheless, so that sampling ends.
constexpr double kLeastShare = 1.0 / 1024;
/// Mean length of chords in radii, for estimates.
constexpr double kMeanChord = 1.22;

// All curves

/// Attempts and rounds after which a curve is left as it is. Each lowers something by a tenth or so.
constexpr int kMaxLowerings = 100, kMaxRounds = 60;
/// A curve of more radii may be lowered less often, so that none takes seconds.
constexpr double kRadiiPerLowering = 1e4;
/// A step down.
constexpr double kLowered = 0.9;
/// Of the time: what is done before the first curve is sampled, and when all have been once.
constexpr double kProgressBefore = 0.05, kProgressSpaced = 0.9;

class CurveSampler {
 public:
  CurveSampler(const MeshView& mesh, const CurveGraph& graph, const SurfaceFlood& flood, const WantedRadii& wanted,
               const CurveSamplingOptions& options, const Execution& run);

  CurveSamples run();

 private:
  struct State {
    RadiusTable table;
    std::vector<std::pair<double, double>> lowered;                ///< parameters and radii that the table was lowered to there
    std::array<double, 2> ends_of_table = {kInfinite, kInfinite};  ///< the corners' radii that the table was made for
    std::array<bool, 2> has_wedge = {false, false};
    double most = kInfinite;
    int least_pieces = 1;
    int lowerings = 0;
    std::uint64_t attempts = 0;
    bool given_up = false;
    std::vector<CurveStop> samples;  ///< both ends included
  };
  struct Corner {
    SurfacePoint at;
    double radius = 0, wanted = 0;
    bool tip = false;
    std::vector<Index> curves;
  };
  /// A sample by its place in the states: of curve `curve` number `number`, or of corner `number`.
  struct Place {
    Index curve, number;
  };

  double wanted_at(const SurfacePoint& at) const {
    const double r = wanted_.at(at);
    return options_.limits == nullptr ? r : options_.limits->at(at.position, r);
  }
  const Curve& curve(Index c) const { return graph_.curves[slot(c)]; }
  std::array<Index, 2> corners_of(Index c) const { return {curve(c).first_corner, curve(c).last_corner}; }
  CurveTask task(Index c) const { return {mesh_, flood_.edges(), curve(c), states_[slot(c)].table, wanted_, options_.limits}; }
  CurveRadii radii_of(Index c) const;

  [[noreturn]] void refuse(double samples, const std::string& why) const;
  void require_few(double radii_of_way) const;
  void foresee();
  void count_pieces();
  void prepare_corners();
  void make_table(Index c);
  RadiusTable::Node make_node(Index c, double s, double bound);

  void settle();
  Spacing try_to_space(Index c, const CurveRadii& radii);
  bool lower_all(Index c);
  void lower_at(Index c, double s);
  void lower_table(Index c, double s, double radius) {
    states_[slot(c)].lowered.emplace_back(s, radius);
    states_[slot(c)].table.lower(s, radius);
  }
  void lower_corner(Index corner, double radius, Index except = kNone);
  void give_up(Index c);

  bool resolve_conflicts(int round);
  CurveSample sample_at(const Place& place) const;
  CurveSamples collect() const;
  void find_conflicts(const std::vector<CurveSample>& samples, std::vector<std::pair<Index, double>>& conflicts);
  void finish(CurveSamples& result);
  void measure(CurveSamples& result) const;

  const MeshView& mesh_;
  const CurveGraph& graph_;
  const SurfaceFlood& flood_;
  const WantedRadii& wanted_;
  const CurveSamplingOptions& options_;
  Execution run_;
  CurveProximity proximity_;
  SurfaceFlood::Scratch scratch_;
  std::vector<Corner> corners_;
  std::vector<State> states_;
  std::set<std::pair<double, Index>> waiting_;  ///< curves to be sampled, by length: short ones decide about their corners
  std::uint64_t placings_ = 0, settled_ = 0;
  Index rounds_ = 0;
};

CurveSampler::CurveSampler(const MeshView& mesh, const CurveGraph& graph, const SurfaceFlood& flood, const WantedRadii& wanted,
                           const CurveSamplingOptions& options, const Execution& run)
    : mesh_(mesh),
      graph_(graph),
      flood_(flood),
      wanted_(wanted),
      options_(options),
      run_(run),
      proximity_(graph, flood, run.part(0, kProgressBefore)),
      scratch_(run),
      corners_(graph.corners.size()),
      states_(graph.curves.size()) {}

CurveRadii CurveSampler::radii_of(Index c) const {
  CurveRadii radii;
  if (!curve(c).closed) {
    radii.ends = {corners_[slot(curve(c).first_corner)].radius, corners_[slot(curve(c).last_corner)].radius};
  }
  radii.most = states_[slot(c)].most;
  return radii;
}

void CurveSampler::refuse(double samples, const std::string& why) const {
  throw Error(ErrorCode::kTooLarge, "curves: they need about " + number_text(samples) + " samples, more than the " +
                                        number_text(options_.max_samples) + " that are in proportion, " + why);
}

/// Throws if so much of curves, in radii, needs more samples than are allowed.
void CurveSampler::require_few(double radii_of_way) const {
  const double samples = radii_of_way / kMeanChord;
  if (samples <= options_.max_samples) return;
  refuse(samples,
         "so long are they beside the wanted radius or so close to each other (thin plates, needles); choose a greater radius, "
         "ask for more vertices, or keep fewer curves");
}

/// Throws if the radii at a few places of each curve tell that there will be far more samples than are allowed. Before any is
/// made, since a curve beside another can have a thousand times the samples that its length asks for, and many such curves
/// pass require_few() one by one.
void CurveSampler::foresee() {
  constexpr double kRadiiPerPlace = 4, kMostPlaces = 8;
  constexpr double kFarMore = 2;  // of an estimate from so few places
  double radii_of_way = 0, least_share = kInfinite;
  std::pair<Index, double> closest{kNone, 0};
  for (Index c = 0; c < static_cast<Index>(states_.size()); ++c) {
    run_.check();
    const double length = curve(c).length(), bound = length / states_[slot(c)].least_pieces;
    const double places = std::min(kMostPlaces, std::max(1.0, std::ceil(length / (kRadiiPerPlace * wanted_.max()))));
    for (double k = 0; k < places; ++k) {
      const double s = (k + 0.5) / places * length;
      const RadiusTable::Node node = make_node(c, s, bound);
      double radius = node.bound;
      for (const std::size_t e : {std::size_t{0}, std::size_t{1}}) {
        const bool in_corner = !curve(c).closed && node.to_corner[e] < kWedgeStart * radii_of(c).ends[e];
        if (!in_corner) radius = std::min(radius, node.of_wedge[e]);
      }
      radii_of_way += length / places / radius;
      if (radius < least_share) {
        least_share = radius;
        closest = {c, s};
      }
    }
  }
  const double samples = radii_of_way / kMeanChord;
  if (samples <= kFarMore * options_.max_samples) return;
  const Vec3 at = place_on_curve(mesh_, flood_.edges(), curve(closest.first), closest.second).at.position;
  const std::string where = "(" + number_text(at.x()) + ", " + number_text(at.y()) + ", " + number_text(at.z()) + ")";
  const double wanted = wanted_.max();
  if (least_share >= wanted / 16) {
    refuse(samples, "so long are they beside the wanted radius; choose a greater radius, or ask for more vertices");
  }
  refuse(samples,
         "since they come closer to each other than " + number_text(least_share / wanted * 1.01) +
             " of the wanted radius, most so near " + where +
             ": needles or thin plates, too narrow to keep both sides of them. Take these facets out of the mesh, or make "
             "the parts wider: a few thousandths of the radius do");
}

/// How many pieces each curve needs, so that no two edges of curves have the same ends.
void CurveSampler::count_pieces() {
  std::vector<std::array<Index, 3>> by_ends;
  for (Index c = 0; c < static_cast<Index>(states_.size()); ++c) {
    const auto [a, b] = corners_of(c);
    if (curve(c).closed || a == b) {
      states_[slot(c)].least_pieces = 3;
    } else {
      by_ends.push_back({std::min(a, b), std::max(a, b), c});
    }
  }
  std::sort(by_ends.begin(), by_ends.end());
  for (std::size_t k = 1; k < by_ends.size(); ++k) {
    if (by_ends[k][0] != by_ends[k - 1][0] || by_ends[k][1] != by_ends[k - 1][1]) continue;
    states_[slot(by_ends[k][2])].least_pieces = states_[slot(by_ends[k - 1][2])].least_pieces = 2;
  }
}

void CurveSampler::prepare_corners() {
  for (Index c = 0; c < static_cast<Index>(states_.size()); ++c) {
    if (curve(c).closed) continue;
    const auto [a, b] = corners_of(c);
    corners_[slot(a)].curves.push_back(c);
    if (a != b) corners_[slot(b)].curves.push_back(c);
  }
  for (std::size_t k = 0; k < corners_.size(); ++k) {
    Corner& corner = corners_[k];
    const Index vertex = graph_.corners[k];
    PlacedPoint at{flood_.position(vertex), flood_.homes_of_vertex(vertex)};
    if (at.homes.empty()) {
      throw Error(ErrorCode::kInvalidArgument, "curves: vertex " + std::to_string(vertex) +
                                                   " is marked as a corner, but no facet has it; mark vertices of facets");
    }
    corner.at = corner_point(mesh_, flood_.edges(), at.homes.front(), vertex);
    corner.tip = options_.tips != nullptr && std::binary_search(options_.tips->begin(), options_.tips->end(), vertex);
    corner.wanted = corner.radius = corner.tip ? wanted_.at(corner.at) : wanted_at(corner.at);
    for (const Index c : corner.curves) {
      corner.radius = std::min(corner.radius, curve(c).length() / states_[slot(c)].least_pieces);
    }
    const double least = kLeastShare * corner.wanted;
    const double clear = proximity_.of_corner(static_cast<Index>(k), at, corner.radius);
    corner.radius = std::min(corner.radius, std::max(least, clear));
  }
}

RadiusTable::Node CurveSampler::make_node(Index c, double s, double bound) {
  const CurvePlace place = place_on_curve(mesh_, flood_.edges(), curve(c), s);
  const double wanted = wanted_at(place.at);
  PlacedPoint at{place.at.position,
                 place.vertex != kNone ? flood_.homes_of_vertex(place.vertex) : flood_.homes_of_edge(place.edge)};
  bound = std::min(bound, wanted);
  const Clearance clear = proximity_.of_curve(c, s, at, bound);
  const double least = std::min(bound, kLeastShare * wanted);
  RadiusTable::Node node{s, std::min(bound, std::max(least, clear.of_others)), clear.of_wedge, {kInfinite, kInfinite}};
  for (const std::size_t e : {std::size_t{0}, std::size_t{1}}) {
    node.of_wedge[e] = std::max(least, node.of_wedge[e]);
    if (!curve(c).closed) node.to_corner[e] = norm(at.position - corners_[slot(corners_of(c)[e])].at.position);
  }
  return node;
}

/// Nodes from start to end, a part of the radius apart; within the corners' disks, of the corner's radius.
void CurveSampler::make_table(Index c) {
  constexpr double kNodesPerRadius = 4, kNodesInCorner = 16;
  State& state = states_[slot(c)];
  const CurveRadii radii = radii_of(c);
  state.ends_of_table = radii.ends;
  state.table.clear();
  const double length = curve(c).length();
  const double bound = length / state.least_pieces;
  double radii_of_way = 0;
  std::uint64_t nodes = 0;
  for (double s = 0;;) {
    if (nodes++ % Ticker::kUnitsPerLook == 0) run_.check();
    RadiusTable::Node node = make_node(c, s, bound);
    // At its own end a corner's curves are all at distance 0.
    if (s == 0 || s == length) node.bound = std::min(bound, wanted_at(place_on_curve(mesh_, flood_.edges(), curve(c), s).at));
    double step = std::min(node.bound, length) / kNodesPerRadius;
    for (const std::size_t e : {std::size_t{0}, std::size_t{1}}) {
      state.has_wedge[e] = state.has_wedge[e] || node.of_wedge[e] < kInfinite;
      if (curve(c).closed) continue;
      const bool in_corner = node.to_corner[e] < kWedgeStart * radii.ends[e];
      if (in_corner && state.has_wedge[e]) step = std::min(step, radii.ends[e] / kNodesInCorner);
      if (!in_corner) step = std::min(step, node.of_wedge[e] / kNodesPerRadius);
    }
    state.table.add(node);
    if (!(s < length)) break;
    radii_of_way += std::min(step, length - s) / node.bound;
    require_few(radii_of_way);
    s = s + step < length && s + step > s ? s + step : length;
  }
  for (const auto& [s, radius] : state.lowered) state.table.lower(s, radius);
}

/// Samples with these radii, or says where that fails.
Spacing CurveSampler::try_to_space(Index c, const CurveRadii& radii) {
  constexpr int kStarts = 4;
  State& state = states_[slot(c)];
  ++placings_;
  run_.check();
  state.table.update(radii, curve(c).closed);
  require_few(state.table.integral());
  const CurveTask task = this->task(c);
  Rng rng(scramble(options_.seed ^ scramble(static_cast<std::uint64_t>(c) + 1)) + state.attempts++);
  if (!curve(c).closed) {
    const CurveStop first{0, radii.ends[0], corners_[slot(curve(c).first_corner)].at.position};
    const CurveStop last{curve(c).length(), radii.ends[1], corners_[slot(curve(c).last_corner)].at.position};
    return space_by_sections(task, first, last, state.least_pieces, rng, run_);
  }
  Spacing spacing;
  for (int k = 0; k < kStarts && !spacing.done; ++k) {
    const CurveStop first = task.stop(rng.uniform() * curve(c).length());
    CurveStop last = first;
    last.s += curve(c).length();
    spacing = space_by_sections(task, first, last, state.least_pieces, rng, run_);
  }
  return spacing;
}

/// The corner's radius is this or less; its curves but one have to be sampled anew.
void CurveSampler::lower_corner(Index corner, double radius, Index except) {
  Corner& at = corners_[slot(corner)];
  if (!(radius < at.radius)) return;
  at.radius = radius;
  for (const Index c : at.curves) {
    if (c != except) waiting_.insert({curve(c).length(), c});
  }
}

/// Lowers the greatest radii of a short curve and its corners to the first of a falling sequence with which it can be spaced.
bool CurveSampler::lower_all(Index c) {
  State& state = states_[slot(c)];
  CurveRadii radii = radii_of(c);
  double most = state.table.max();
  if (!curve(c).closed) most = std::max({most, radii.ends[0], radii.ends[1]});
  most = std::min(most, curve(c).length() / state.least_pieces);
  for (int k = 0; k < kMaxLowerings; ++k) {
    most *= kLowered;
    for (double& r : radii.ends) r = curve(c).closed ? r : std::min(r, most);
    radii.most = std::min(radii.most, most);
    Spacing spacing = try_to_space(c, radii);
    if (!spacing.done) continue;
    state.most = radii.most;
    state.samples = std::move(spacing.samples);
    if (!curve(c).closed) {
      lower_corner(curve(c).first_corner, radii.ends[0], c);
      lower_corner(curve(c).last_corner, radii.ends[1], c);
    }
    return true;
  }
  return false;
}

/// Lowers what is before a place that no chord leads to, and has the curve sampled again.
void CurveSampler::lower_at(Index c, double s) {
  State& state = states_[slot(c)];
  const double length = curve(c).length();
  waiting_.insert({length, c});
  const double in_curve = curve(c).closed && s > length ? s - length : s;
  const double before = std::max(0.0, in_curve - state.table.at(in_curve) / 2);
  if (!curve(c).closed) {
    const double first = corners_[slot(curve(c).first_corner)].radius, last = corners_[slot(curve(c).last_corner)].radius;
    if (before < kLongestWay * first && before < length / 2) lower_corner(curve(c).first_corner, kLowered * first);
    if (length - before < kLongestWay * last && before > length / 2) lower_corner(curve(c).last_corner, kLowered * last);
  }
  lower_table(c, before, kLowered * state.table.at(before));
}

/// The curve is sampled by equal shares; what that breaks is mended or listed at the end.
void CurveSampler::give_up(Index c) {
  constexpr double kMostPieces = 1 << 16;
  State& state = states_[slot(c)];
  state.given_up = true;
  state.table.update(radii_of(c), curve(c).closed);
  const double wanted = std::min(kMostPieces, state.table.integral() / kMeanChord);
  const CurveTask task = this->task(c);
  state.samples = {task.stop(0)};
  for (const double s : state.table.cuts(std::max(state.least_pieces, static_cast<int>(std::ceil(wanted))))) {
    state.samples.push_back(task.stop(s));
  }
  state.samples.push_back(task.stop(curve(c).length()));
}

/// Samples the curves that wait, and those that this lowers corners of, until none waits. Each time that a curve cannot be
/// spaced its greatest radius falls by a tenth, and after kMaxLowerings it is given up: so this ends.
void CurveSampler::settle() {
  constexpr double kShort = 12;  // in radii
  while (!waiting_.empty()) {
    const Index c = waiting_.begin()->second;
    waiting_.erase(waiting_.begin());
    const double share = std::min(1.0, static_cast<double>(++settled_) / static_cast<double>(states_.size()));
    run_.report(kProgressBefore + (kProgressSpaced - kProgressBefore) * share);
    State& state = states_[slot(c)];
    const CurveRadii radii = radii_of(c);
    bool outdated = state.table.empty();
    for (const std::size_t e : {std::size_t{0}, std::size_t{1}}) {
      outdated = outdated || (state.has_wedge[e] && radii.ends[e] < state.ends_of_table[e] / 2);
    }
    if (outdated) make_table(c);
    if (state.given_up) {
      give_up(c);
      continue;
    }
    Spacing spacing = try_to_space(c, radii);
    if (spacing.done) {
      state.samples = std::move(spacing.samples);
      continue;
    }
    const double greatest = curve(c).closed ? state.table.max() : std::max({state.table.max(), radii.ends[0], radii.ends[1]});
    state.lowerings += 1 + static_cast<int>(state.table.integral() / kRadiiPerLowering);
    if (state.lowerings > kMaxLowerings) {
      give_up(c);
    } else if (curve(c).length() > kShort * greatest) {
      lower_at(c, spacing.stuck_at);
    } else if (!lower_all(c)) {
      give_up(c);
    }
  }
}

CurveSample CurveSampler::sample_at(const Place& place) const {
  CurveSample result;
  if (place.curve == kNone) {
    const Corner& corner = corners_[slot(place.number)];
    result.sample = {corner.at, corner.radius};
    result.corner = place.number;
    result.vertex = graph_.corners[slot(place.number)];
    result.tip = corner.tip;
    return result;
  }
  const CurveStop& stop = states_[slot(place.curve)].samples[slot(place.number)];
  const CurveTask of_curve = task(place.curve);
  const CurvePlace at = of_curve.place(stop.s);
  result.sample = {at.at, stop.radius};
  result.curve = place.curve;
  result.parameter = of_curve.wrapped(stop.s);
  result.edge = at.edge;
  result.vertex = at.vertex;
  return result;
}

/// Samples and pairs as they are now. A closed curve begins with its sample of the least parameter.
CurveSamples CurveSampler::collect() const {
  CurveSamples result;
  for (Index k = 0; k < static_cast<Index>(corners_.size()); ++k) result.samples.push_back(sample_at({kNone, k}));
  result.first_edge.push_back(0);
  for (Index c = 0; c < static_cast<Index>(states_.size()); ++c) {
    const Index begin = static_cast<Index>(result.samples.size());
    const Index inner = static_cast<Index>(states_[slot(c)].samples.size()) - 1;  // without the last
    for (Index k = curve(c).closed ? 0 : 1; k < inner; ++k) result.samples.push_back(sample_at({c, k}));
    if (curve(c).closed) {
      const auto before = [](const CurveSample& a, const CurveSample& b) { return a.parameter < b.parameter; };
      std::rotate(result.samples.begin() + begin,
                  std::min_element(result.samples.begin() + begin, result.samples.end(), before), result.samples.end());
    }
    const Index end = static_cast<Index>(result.samples.size());
    Index last = curve(c).closed ? kNone : curve(c).first_corner;
    for (Index s = begin; s < end; ++s) {
      if (last != kNone) result.edges.push_back({last, s});
      last = s;
    }
    if (last != kNone) result.edges.push_back({last, curve(c).closed ? begin : curve(c).last_corner});
    result.first_edge.push_back(result.edges.size());
  }
  return result;
}

/// Samples whose disks hold others, with the distance of the nearest of these squared; ascending.
void CurveSampler::find_conflicts(const std::vector<CurveSample>& samples, std::vector<std::pair<Index, double>>& conflicts) {
  conflicts.clear();
  std::vector<BoxItem> items;
  items.reserve(samples.size());
  for (const CurveSample& sample : samples) items.push_back({sample.sample.position(), sample.sample.position()});
  const BoxTree tree(items);
  Ticker ticker(run_.part(kProgressSpaced, 1), samples.size());
  for (Index s = 0; s < static_cast<Index>(samples.size()); ++s) {
    ticker.tick();
    const Sample& sample = samples[slot(s)].sample;
    const double weight = sample.radius * sample.radius;
    PlacedPoint from;
    double nearest = kInfinite;
    constexpr double kAboveRounding = 1 + 0x1p-40;
    tree.search(sample.position(), 1, sample.radius * kAboveRounding, [&](Index other, double&) {
      const Vec3& x = samples[slot(other)].sample.position();
      if (other == s || side_of_ball(x.data(), sample.position().data(), weight) >= 0) return;
      const double d2 = squared_norm(x - sample.position());
      if (d2 >= nearest) return;
      if (from.homes.empty()) from = {sample.position(), homes_of(flood_, samples[slot(s)])};
      if (flood_.holds(from, weight, {x, homes_of(flood_, samples[slot(other)])}, scratch_)) nearest = d2;
    });
    if (nearest < kInfinite) conflicts.emplace_back(s, nearest);
  }
}

/// Has curves sampled anew whose disks hold samples of others: at first with the same radii, then with lower ones. False if
/// there is nothing to do about it, or nothing that could be done.
bool CurveSampler::resolve_conflicts(int round) {
  constexpr int kRoundsOfChance = 2;
  constexpr double kOfDistance = 0.95;
  const CurveSamples now = collect();
  std::vector<std::pair<Index, double>> conflicts;
  find_conflicts(now.samples, conflicts);
  for (const auto& [s, d2] : conflicts) {
    const CurveSample& sample = now.samples[slot(s)];
    const double radius = kOfDistance * std::sqrt(d2);
    if (radius < kLeastShare * wanted_at(sample.sample.at)) continue;
    if (sample.corner != kNone) {
      lower_corner(sample.corner, radius);
      continue;
    }
    if (round >= kRoundsOfChance) lower_table(sample.curve, sample.parameter, radius);
    waiting_.insert({curve(sample.curve).length(), sample.curve});
  }
  return !waiting_.empty();
}

/// What conflicts are left are ended by lowering radii to distances: nothing else is then promised for these samples.
void CurveSampler::finish(CurveSamples& result) {
  std::vector<std::pair<Index, double>> conflicts;
  find_conflicts(result.samples, conflicts);
  for (const auto& [s, d2] : conflicts) {
    double& radius = result.samples[slot(s)].sample.radius;
    radius = radius_below(radius, d2);
    ++result.report.forced;
  }
  constexpr Index kMostForced = 20'000;
  if (result.report.forced > kMostForced) {
    throw Error(
        ErrorCode::kTooLarge,
        "curves: " + std::to_string(result.report.forced) +
            " samples are on curves nearer to each other than a thousandth of the wanted radius, which all but coincide "
            "(thin plates, needles): faces beside them would take many times as many; take such facets out, make the "
            "parts some thousandths of the radius wide, or keep fewer curves");
  }
  for (const auto& [p, q] : result.edges) {
    Sample &a = result.samples[slot(p)].sample, &b = result.samples[slot(q)].sample;
    const double d2 = squared_norm(a.position() - b.position());
    a.radius = radius_below(a.radius, d2);
    b.radius = radius_below(b.radius, d2);
  }
  measure(result);
}

void CurveSampler::measure(CurveSamples& result) const {
  CurveSamplingReport& report = result.report;
  report.corners = static_cast<Index>(corners_.size());
  report.placings = placings_;
  report.rounds = rounds_;
  std::vector<RadiusCap> caps;
  for (const CurveSample& sample : result.samples) {
    constexpr double kAsWanted = 1 - 0x1p-30;
    const double r = sample.sample.radius, wanted = wanted_.at(sample.sample.at);
    if (r >= kAsWanted * wanted) continue;
    // Where curves all but coincide, faces are not to be filled with as many samples as that would take.
    caps.push_back({sample.sample.position(), std::max(r, kLeastShare * wanted)});
  }
  report.lowered = static_cast<Index>(caps.size());
  result.caps = CapField(std::move(caps), kCapGradation);
  for (std::size_t c = 0; c < states_.size(); ++c) {
    const CurveTask of_curve = task(static_cast<Index>(c));
    bool spaced = result.first_edge[c + 1] - result.first_edge[c] >= static_cast<std::size_t>(states_[c].least_pieces);
    for (std::size_t e = result.first_edge[c]; e < result.first_edge[c + 1]; ++e) {
      const CurveSample &p = result.samples[slot(result.edges[e][0])], &q = result.samples[slot(result.edges[e][1])];
      const double length = curve(static_cast<Index>(c)).length();
      CurveStop from{p.corner == kNone ? p.parameter : 0, p.sample.radius, p.sample.position()};
      CurveStop to{q.corner == kNone ? q.parameter : length, q.sample.radius, q.sample.position()};
      if (to.s <= from.s) to.s += length;  // across the start of a closed curve
      const double d2 = squared_norm(to.position - from.position);
      constexpr double kAboveRounding = 1 + 0x1p-50;
      spaced = spaced && d2 * kAboveRounding < from.radius * from.radius + to.radius * to.radius;
      if (!is_surely_kept(of_curve, from, to)) ++report.unproved_chords;
      report.worst_sagitta = std::max(report.worst_sagitta, of_curve.sagitta(from, to));
    }
    if (!spaced) report.unspaced.push_back(static_cast<Index>(c));
  }
}

CurveSamples CurveSampler::run() {
  count_pieces();
  prepare_corners();
  double radii_of_way = 0;
  for (Index c = 0; c < static_cast<Index>(states_.size()); ++c) {
    waiting_.insert({curve(c).length(), c});
    radii_of_way += curve(c).length() / wanted_.max();
  }
  require_few(radii_of_way);
  foresee();
  for (; rounds_ < kMaxRounds; ++rounds_) {
    settle();
    if (!resolve_conflicts(rounds_)) break;
  }
  settle();
  CurveSamples result = collect();
  finish(result);
  return result;
}

}  // namespace

CurveSamples sample_curves(const MeshView& mesh, const CurveGraph& graph, const SurfaceFlood& flood, const WantedRadii& wanted,
                           const CurveSamplingOptions& options) {
  if (wanted.rule() != ConflictRule::kMax) {
    throw Error(ErrorCode::kInvalidArgument,
                "curves: only the max rule keeps them; choose ConflictRule::kMax, or sample without curves");
  }
  const Execution run = options.execution.start("sampling curves");
  CurveSamples result = CurveSampler(mesh, graph, flood, wanted, options, run).run();
  run.finish();
  return result;
}

}  // namespace amps::detail
