#define AMPS_OWN_SOURCE
#include "amps/refill.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace amps::detail {
namespace {

/// Energy that trials count for a sample more, and less for a sample fewer: halves the growth of sets, at no cost in time. With
/// 5, tight bounds take twice the time.
constexpr double kEnergyPerSample = 2;
/// Darts that are kept to choose from, for each sample taken out: fewer leave gaps, more cost time.
constexpr std::size_t kPoolPerSample = 12;
/// Darts that are kept at most; their indices are bytes.
constexpr std::size_t kMaxPool = 96;
/// Darts thrown at most to find those, for each sample taken out: most fall into disks around.
constexpr int kPoolDartsPerSample = 110;
/// So many pieces are counted faster than searched.
constexpr std::size_t kCountedPieces = 64;

}  // namespace

void NearbyDisks::assign(const TrialPatch& patch, int first) {
  size_ = 0;
  for (int v = first; v < patch.num_vertices(); ++v) add(patch.position(v), patch.weight(v));
  while (size_ % kBlock != 0) add(Vec3::Constant(INFINITY), 0);
}

void NearbyDisks::add(const Vec3& x, double weight) {
  x_[size_] = x[0];
  y_[size_] = x[1];
  z_[size_] = x[2];
  weight_[size_++] = weight;
}

void RefillFinder::plan(const BadItem& item, Rng& rng, RefillPlan& plan) const {
  plan.clear();
  std::array<Index, 3> corner;
  const std::size_t corners = corners_to_move(item, rng, corner);
  for (std::size_t k = corners; k > 1; --k) std::swap(corner[k - 1], corner[rng.below(k)]);
  // Small patches first: they cost least to try and to carry out.
  plan.num_singles = corners;
  RefillPlan::Patch patch;
  for (std::size_t k = 0; k < corners; ++k) {
    patch.size = 0;
    patch.add(corner[k]);
    plan.patches.push_back(patch);
  }
  for (std::size_t k = 0; k < corners; ++k) {
    patch.size = 0;
    patch.add(corner[k]);
    if (corners == 3) {
      patch.add(corner[(k + 1) % 3]);
    } else {
      add_random_neighbor(patch, rng);
    }
    plan.patches.push_back(patch);
  }
  if (corners > 0) {
    patch.size = 0;
    for (std::size_t k = 0; k < corners; ++k) patch.add(corner[k]);
    const int neighbors = corners == 1 || rng.below(2) == 0 ? 2 : 0;
    for (int k = 0; k < neighbors; ++k) add_random_neighbor(patch, rng);
    plan.patches.push_back(patch);
  }
  add_cells(plan);
}

Proposal RefillFinder::find(const RefillPlan& plan, Rng rng) {
  proposal_ = Proposal();
  of_count_ = false;
  best_gain_ = kMinGain;
  all_good_ = false;
  bool copied = true;
  for (std::size_t k = 0; k < plan.patches.size(); ++k) {
    const bool single = k < plan.num_singles;
    if (single && all_good_) continue;
    if (!single && proposal_.kind == Proposal::Kind::kRefill) break;
    copied = try_patch(plan, plan.patches[k], rng) && copied;
  }
  if (proposal_.kind != Proposal::Kind::kRefill && !copied) proposal_.kind = Proposal::Kind::kInPlace;
  return std::move(proposal_);
}

Proposal RefillFinder::find(const BadItem& item, Rng rng) {
  plan(item, rng, plan_);
  return find(plan_, rng);
}

Proposal RefillFinder::find_of_count(Index s, int change, int patch_size, double most, Rng rng) {
  proposal_ = Proposal();
  of_count_ = true;
  count_change_ = change;
  best_gain_ = -most;
  all_good_ = false;
  RefillPlan::Patch patch;
  patch.add(s);
  for (int k = 1; k < patch_size; ++k) add_random_neighbor(patch, rng);
  if (static_cast<int>(patch.size) + change < 1) return std::move(proposal_);
  plan_.clear();
  plan_.patches.push_back(patch);
  add_cells(plan_);
  if (!try_patch(plan_, patch, rng)) proposal_.kind = Proposal::Kind::kInPlace;
  return std::move(proposal_);
}

/// The corners of an item that may be taken out; where all are fixed, up to three of their neighbours that may.
std::size_t RefillFinder::corners_to_move(const BadItem& item, Rng& rng, std::array<Index, 3>& corner) const {
  std::size_t count = 0;
  for (const Index s : {item.a, item.b, item.c}) {
    if (s != kNone && s >= num_fixed_) corner[count++] = s;
  }
  if (count > 0) return count;
  constexpr int kDraws = 12;
  for (int draw = 0; draw < kDraws && count < corner.size(); ++draw) {
    const Index at = item.is_vertex() ? item.a : std::array<Index, 3>{item.a, item.b, item.c}[rng.below(3)];
    const StarView star = stars_.star[slot(at)];
    if (star.size == 0) continue;
    const Index s = star.ring[rng.below(static_cast<std::uint64_t>(star.size))];
    const auto end = corner.begin() + static_cast<std::ptrdiff_t>(count);
    if (s >= num_fixed_ && std::find(corner.begin(), end, s) == end) corner[count++] = s;
  }
  return count;
}

void RefillFinder::add_random_neighbor(RefillPlan::Patch& patch, Rng& rng) const {
  const StarView star = stars_.star[slot(patch.removed[rng.below(patch.size)])];
  if (star.size == 0) return;
  const Index s = star.ring[rng.below(static_cast<std::uint64_t>(star.size))];
  if (s >= num_fixed_ && !patch.has(s) && patch.size < RefillPlan::kMaxPatchSize) patch.add(s);
}

/// The cells of all samples of the plan as triangles. Samples without a star have patches that cannot be copied.
void RefillFinder::add_cells(RefillPlan& plan) const {
  std::vector<Vec3> corners;
  for (const RefillPlan::Patch& patch : plan.patches) {
    for (const Index s : patch) {
      const auto is_of_s = [s](const RefillPlan::Cell& cell) { return cell.sample == s; };
      if (stars_.star[slot(s)].size == 0 || std::any_of(plan.cells.begin(), plan.cells.end(), is_of_s)) continue;
      for (Index f = diagram_.first_of_site(s); f != kNone; f = diagram_.next_of_site(f)) {
        const auto polygon = diagram_.polygon(f);
        polygon.list_corners(corners);
        for (std::size_t k = 2; k < corners.size(); ++k) {
          plan.pieces.push_back({polygon.facet, corners[0], corners[k - 1] - corners[0], corners[k] - corners[0]});
        }
      }
      plan.cells.push_back({s, plan.pieces.size()});
    }
  }
}

/// Several refills of the gap that a patch of the plan leaves; the best becomes the proposal if it is an improvement. False if
/// the patch cannot be copied.
bool RefillFinder::try_patch(const RefillPlan& plan, const RefillPlan::Patch& patch, Rng& rng) {
  removed_.assign(patch.begin(), patch.end());
  if (!copy_patch()) return false;
  const double per_sample = of_count_ ? 0 : kEnergyPerSample;
  const double before = patch_.energy() + per_sample * static_cast<double>(removed_.size());
  for (std::size_t k = 0; k < removed_.size(); ++k) {
    if (!patch_.remove(static_cast<int>(k))) return true;
  }
  fill_pool(plan, rng);
  bool improved = false;
  double best = -best_gain_;
  for (int refill = 0; refill < refills_ && !pool_.empty() && !all_good_; ++refill) {
    ++proposal_.trials;
    if (!try_refill(rng)) continue;
    if (of_count_ && static_cast<int>(chosen_.size()) - static_cast<int>(removed_.size()) != count_change_) continue;
    const double after = trial_.energy(), energy = after + per_sample * static_cast<double>(chosen_.size()) - before;
    if (!(energy < best)) continue;
    all_good_ = after == 0 && (of_count_ || chosen_.size() <= removed_.size());
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

/// The vertex of the patch that stands for s, made if there is none; −1 if there is no room.
int RefillFinder::local(Index s) {
  for (std::size_t k = 0; k < ids_.size(); ++k) {
    if (ids_[k] == s) return static_cast<int>(k);
  }
  ids_.push_back(s);
  const WeightedPoint& p = site(s);
  const int size = star(s).size;
  return patch_.add_vertex(p.position(), p.w, size, size > 0) ? static_cast<int>(ids_.size()) - 1 : -1;
}

/// The stars of removed_ and of their neighbours.
bool RefillFinder::copy_patch() {
  patch_.clear();
  ids_.clear();
  for (const Index s : removed_) local(s);
  for (const Index s : removed_) {
    const StarView around = star(s);
    if (around.size == 0) return false;
    for (int k = 0; k < around.size; ++k) {
      if (local(around.ring[static_cast<std::size_t>(k)]) < 0) return false;
    }
  }
  const std::size_t inner = ids_.size();
  for (std::size_t v = 0; v < inner; ++v) {
    const StarView around = star(ids_[v]);
    if (around.size == 0) return false;
    int before = local(around.ring[static_cast<std::size_t>(around.size - 1)]);
    for (int k = 0; k < around.size; ++k) {
      const int at = local(around.ring[static_cast<std::size_t>(k)]);
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

/// The triangles of the cells of removed_.
void RefillFinder::list_pieces(const RefillPlan& plan) {
  pieces_.clear();
  up_to_.clear();
  double total = 0;
  for (const Index s : removed_) {
    std::size_t begin = 0, cell = 0;
    while (plan.cells[cell].sample != s) begin = plan.cells[cell++].end;
    for (std::size_t k = begin; k < plan.cells[cell].end; ++k) {
      const RefillPlan::Piece& piece = plan.pieces[k];
      pieces_.push_back(piece);
      up_to_.push_back(total += norm(piece.u.cross(piece.v)));
    }
  }
}

/// The piece that an area up to the total comes to.
std::size_t RefillFinder::piece_at(double area) const {
  const std::size_t last = pieces_.size() - 1;
  std::size_t at = 0;
  // Of few, counted, not searched for: no branch to mispredict. Of many facets to a sample, searched for.
  if (last > kCountedPieces) {
    return static_cast<std::size_t>(std::upper_bound(up_to_.begin(), up_to_.end() - 1, area) - up_to_.begin());
  }
  for (std::size_t k = 0; k < last; ++k) at += up_to_[k] <= area ? 1 : 0;
  return at;
}

/// Uniform darts where removed_ had their cells, outside of all other balls: only there can a gap be.
void RefillFinder::fill_pool(const RefillPlan& plan, Rng& rng) {
  pool_.clear();
  list_pieces(plan);
  const double total = up_to_.empty() ? 0 : up_to_.back();
  if (!(total > 0)) return;
  others_.assign(patch_, static_cast<int>(removed_.size()));
  const std::size_t max_size = std::min(kPoolPerSample * removed_.size(), kMaxPool);
  const int max_darts = kPoolDartsPerSample * static_cast<int>(removed_.size());
  for (int dart = 0; dart < max_darts && pool_.size() < max_size; ++dart) {
    const double u = rng.uniform() * total;
    const RefillPlan::Piece& piece = pieces_[piece_at(u)];
    double along_u = rng.uniform(), along_v = rng.uniform();
    const bool other_half = along_u + along_v > 1;  // of the parallelogram
    along_u = other_half ? 1 - along_u : along_u;
    along_v = other_half ? 1 - along_v : along_v;
    const Vec3 drawn = piece.corner + along_u * piece.u + along_v * piece.v;
    double nearest = INFINITY;
    if (!others_.are_apart(drawn, nearest)) continue;
    Sample sample;
    sample.at = surface_point_below(diagram_.mesh(), piece.facet, drawn);
    if (!sample.position().allFinite()) continue;
    if (radii_.lowers()) {  // rounding has moved it, and the radius must be below the distance from where it is
      nearest = INFINITY;
      if (!others_.are_apart(sample.position(), nearest)) continue;
    }
    sample.radius = radii_.lowered(radii_.at(sample.at), nearest);
    pool_.push_back(sample);
  }
}

/// Samples of the pool in random order, each if those before leave it free. False if that is no maximal refill.
bool RefillFinder::try_refill(Rng& rng) {
  trial_ = patch_;
  chosen_.clear();
  open_.resize(pool_.size());
  for (std::size_t k = 0; k < open_.size(); ++k) open_[k] = static_cast<std::uint8_t>(k);
  while (!open_.empty()) {
    Sample next = pool_[open_[rng.below(open_.size())]];
    const Vec3 x = next.position();
    for (const Sample& other : chosen_) next.radius = radii_.lowered(next.radius, squared_norm(x - other.position()));
    if (!trial_.insert(x, next.radius * next.radius)) return false;
    chosen_.push_back(next);
    const double reach = next.radius * next.radius;
    open_.erase(std::remove_if(open_.begin(), open_.end(),
                               [&](std::uint8_t k) { return squared_norm(pool_[k].position() - x) < reach; }),
                open_.end());
  }
  return !trial_.has_gap();
}

}  // namespace amps::detail
