#define AMPS_OWN_SOURCE
#include "amps/wanted_radii.h"

#include "amps/predicates.h"

namespace amps::detail {

bool are_apart(const Sample& p, const Sample& q, ConflictRule rule) {
  const double r = kept_apart(rule, p.radius, q.radius);
  return side_of_ball(p.position().data(), q.position().data(), r * r) >= 0;
}

}  // namespace amps::detail
