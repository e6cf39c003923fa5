// wanted_radii.h (internal): what radius a new sample is to have, and how far apart samples must be — one radius or a sizing
// field, and the conflict rule, behind one face. Here, and nowhere else, it is decided whether radii are equal.
#pragma once

#include "amps/base.h"
#include "amps/cap_field.h"
#include "amps/samples.h"
#include "amps/sizing.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

namespace amps::detail {

/// Is one radius wanted everywhere? So it is without a field, and with one that is the same everywhere.
inline bool is_one_radius(const SizingField& field) { return field.empty() || field.min_radius() == field.max_radius(); }

/// max(a, b) or min(a, b): the distance that a rule keeps between two disks from their radii, or its square from their weights.
inline double kept_apart(ConflictRule rule, double a, double b) {
  return rule == ConflictRule::kMax ? std::max(a, b) : std::min(a, b);
}

/// The greatest radius, up to `wanted`, of a new disk that keeps a sample at this squared distance out. It is less than the
/// distance by more than the rounding of its square: the weight in the diagram is below all exact squared distances, and the
/// new site hides no other.
inline double radius_below(double wanted, double nearest_squared) {
  constexpr double kBelowRounding = 1 - 0x1p-50;  // eight units of roundoff: three squares and their sum
  const double bound = nearest_squared * kBelowRounding;
  if (!(bound < wanted * wanted)) return wanted;
  double r = std::sqrt(bound);
  while (r * r > bound) r = std::nextafter(r, 0.0);
  return r;
}

/// A value, cheap to copy. Thread-safe.
class WantedRadii {
 public:
  WantedRadii(double radius, ConflictRule rule) : WantedRadii(radius, {}, rule) {}
  /// A field that is the same everywhere is one radius.
  WantedRadii(const SizingField& field, ConflictRule rule)
      : WantedRadii(field.min_radius(), is_one_radius(field) ? SizingField() : field, rule) {}

  /// The same beside samples that are there already, of radii in [min, max].
  WantedRadii beside(double min, double max) const {
    WantedRadii result = *this;
    result.min_of_set_ = std::min(min_of_set_, min);
    result.max_of_set_ = std::max(max_of_set_, max);
    return result;
  }

  /// The same under these bounds (null: none), which some sample of the set has brought.
  WantedRadii with_caps(std::shared_ptr<const CapField> caps) const {
    WantedRadii result = *this;
    result.caps_ = std::move(caps);
    return result;
  }

  /// The same with all radii times this share, at most 1, beside samples that are there.
  WantedRadii scaled(double share) const {
    WantedRadii result = *this;
    result.radius_ *= share;
    if (!field_.empty()) result.field_ = field_.scaled(share);
    if (caps_ != nullptr) {
      std::vector<RadiusCap> caps = caps_->caps();
      for (RadiusCap& cap : caps) cap.radius *= share;
      result.caps_ = std::make_shared<const CapField>(std::move(caps), share * caps_->slope());
    }
    result.min_of_set_ *= share;
    return result;
  }

  ConflictRule rule() const { return rule_; }
  /// Is one radius wanted everywhere, but for caps?
  bool constant() const { return field_.empty(); }
  /// Do all samples have one radius, those that are there and those to come?
  bool uniform() const { return constant() && caps_ == nullptr && min_of_set_ == max_of_set_; }
  /// Empty if one radius is wanted.
  const SizingField& field() const { return field_; }

  double at(const SurfacePoint& x) const {
    const double wanted = constant() ? radius_ : field_.radius(x);
    return caps_ == nullptr ? wanted : caps_->at(x.position, wanted);
  }
  /// Of the radius or field, without caps.
  double min() const { return constant() ? radius_ : field_.min_radius(); }
  double max() const { return constant() ? radius_ : field_.max_radius(); }
  /// Is relative_density() 1 everywhere?
  bool one_density() const { return constant() && caps_ == nullptr; }
  /// The wanted density 1/r², in units of its greatest value.
  double relative_density(const SurfacePoint& x) const {
    if (one_density()) return 1;
    const double ratio = min() / at(x);
    return ratio * ratio;
  }
  /// ∫dA/r² over a surface of this area, without caps.
  double density_integral(double area) const { return constant() ? area / radius_ / radius_ : field_.density_integral(); }

  /// Of all radii, those that are there and those to come. A sample that gap filling adds is nowhere smaller: it lies in no
  /// disk, so it has lowered() at least to the smallest radius of the set, up to rounding.
  double min_of_set() const { return min_of_set_; }
  double max_of_set() const { return max_of_set_; }

  /// Can a disk of the wanted radius cover a sample whose disk does not cover its centre? Then radii are lowered().
  bool lowers() const { return rule_ == ConflictRule::kMax && max() > min_of_set_; }
  /// The radius of a new sample that lies in no disk, with the nearest sample at this squared distance. By the max rule not
  /// above that distance, so that no sample comes to lie in the new disk.
  double lowered(double wanted, double nearest_squared) const {
    return lowers() ? radius_below(wanted, nearest_squared) : wanted;
  }

 private:
  WantedRadii(double radius, SizingField field, ConflictRule rule) : radius_(radius), field_(std::move(field)), rule_(rule) {
    min_of_set_ = min();
    max_of_set_ = max();
  }

  double radius_;
  SizingField field_;
  std::shared_ptr<const CapField> caps_;
  ConflictRule rule_;
  double min_of_set_, max_of_set_;
};

/// Exact: do two disks keep the distance that the rule wants?
bool are_apart(const Sample& p, const Sample& q, ConflictRule rule);

}  // namespace amps::detail
