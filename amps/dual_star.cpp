#define AMPS_OWN_SOURCE
#include "amps/dual_star.h"

#include "amps/portable_math.h"

#include <algorithm>
#include <cmath>

namespace amps::detail {
namespace {

/// Bounds are kept by this much more, in degrees, so that other formulas for an angle agree that they are.
constexpr double kBoundMargin = 1e-9;

}  // namespace

DualRating::DualRating(bool angles, bool valences, double min_angle, double max_angle) : angles_(angles), valences_(valences) {
  const auto slope = [](double degrees) { return 1 / (kRadiansPerDegree * portable_cosine(std::fabs(90 - degrees))); };
  if (!angles) return;
  cos_min_ = portable_cosine(min_angle + kBoundMargin);
  cos_max_ = portable_cosine(max_angle - kBoundMargin);
  below_ = slope(min_angle);
  above_ = kObtuseShare * slope(max_angle);
}

const std::vector<StarReader::Pair>& StarReader::read(Index s) {
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
  std::size_t kept = 0;
  for (std::size_t k = 0, next = 0; k < pairs_.size(); k = next) {
    while (next < pairs_.size() && pairs_[next] == pairs_[k]) ++next;
    if ((next - k) % 2 == 1) pairs_[kept++] = pairs_[k];
  }
  repeats_ = kept != pairs_.size();
  pairs_.resize(kept);
  return pairs_;
}

StarReader::Ends StarReader::count_neighbors() {
  ring_.clear();
  for (const Pair& pair : pairs_) ring_.insert(ring_.end(), {pair[0], pair[1]});
  std::sort(ring_.begin(), ring_.end());
  Ends ends;
  ends.start = pairs_.front()[0];
  num_neighbors_ = 0;
  for (std::size_t k = 0; k < ring_.size();) {
    std::size_t next = k;
    while (next < ring_.size() && ring_[next] == ring_[k]) ++next;
    ++num_neighbors_;
    ends.crossing = ends.crossing || next - k > 2;
    if (next - k == 1) {
      ++ends.count;
      ends.start = ring_[k];
    }
    k = next;
  }
  return ends;
}

/// Fills ring_ from pair to pair; what is not reached belongs to another piece.
void StarReader::walk(Index start, std::size_t vertices) {
  ring_.assign(1, start);
  std::size_t last = pairs_.size();
  for (bool found = true; ring_.size() < vertices && found;) {
    found = false;
    for (std::size_t k = 0; k < pairs_.size(); ++k) {
      if (k == last || (pairs_[k][0] != ring_.back() && pairs_[k][1] != ring_.back())) continue;
      const Index next = pairs_[k][0] == ring_.back() ? pairs_[k][1] : pairs_[k][0];
      if (next == start) continue;
      ring_.push_back(next);
      last = k;
      found = true;
      break;
    }
  }
}

StarReader::Form StarReader::form(DualStar& star) {
  star.size = 0;
  star.repeats = repeats_;
  if (pairs_.empty()) return Form::kOther;
  const Ends ends = count_neighbors();
  if (ends.crossing && ends.count == 0) return Form::kCrossing;
  if (ends.crossing || (ends.count != 0 && ends.count != 2)) return Form::kOther;
  const std::size_t vertices = pairs_.size() + (ends.count == 2 ? 1 : 0);
  walk(ends.start, vertices);
  if (ring_.size() != vertices) return ends.count == 0 ? Form::kPinched : Form::kOther;
  if (ends.count == 2) return Form::kHalfDisk;
  if (ring_.size() >= 3 && ring_.size() <= static_cast<std::size_t>(DualStar::kMaxSize)) {
    std::copy(ring_.begin(), ring_.end(), star.ring.begin());
    star.size = static_cast<std::int8_t>(ring_.size());
  }
  return Form::kDisk;
}

/// Of the star that form() was last asked of.
double StarReader::valence(Form form) const {
  if (form == Form::kOther || (form == Form::kCrossing && !rates_crossings_)) return 0;
  return rating_.valence(num_neighbors_, form == Form::kHalfDisk);
}

double StarReader::energy(Index s, DualStar& star) {
  read(s);
  const Form its_form = form(star);
  double sum = s < num_fixed_ ? 0 : valence(its_form);
  for (const Pair& pair : pairs_) sum += triangle(s, pair[0], pair[1]) / 3;
  return sum;
}

bool StarReader::is_bad_crossing(Index s) {
  if (s < num_fixed_) return false;
  read(s);
  DualStar star;
  return form(star) == Form::kCrossing && rating_.valence(num_neighbors_, false) > 0;
}

void StarReader::list_bad(Index s, std::vector<BadItem>& items) {
  read(s);
  DualStar star;
  if (s >= num_fixed_ && valence(form(star)) > 0) items.push_back({s, kNone, kNone});
  for (const Pair& pair : pairs_) {
    if (s < pair[0] && triangle(s, pair[0], pair[1]) > 0) items.push_back({s, pair[0], pair[1]});
  }
}

void AngleRange::add(const Vec3& x, const Vec3& y, const Vec3& z) {
  const std::array<double, 3> side = {squared_norm(y - z), squared_norm(z - x), squared_norm(x - y)};
  for (std::size_t k = 0; k < 3; ++k) {
    const double cosine = corner_cosine(side[(k + 1) % 3], side[(k + 2) % 3], side[k]);
    min_cosine_ = std::min(min_cosine_, cosine);
    max_cosine_ = std::max(max_cosine_, cosine);
  }
}

double AngleRange::degrees(double cosine) { return to_degrees(portable_arc_cosine(std::min(std::max(cosine, -1.0), 1.0))); }

}  // namespace amps::detail
