#define AMPS_OWN_SOURCE
#include "amps/base.h"

#include <algorithm>
#include <limits>
#include <locale>
#include <sstream>

namespace amps {

Error::~Error() = default;

Rng::Rng(std::uint64_t seed) noexcept {
  for (std::uint64_t& word : state_) {  // splitmix64
    seed += 0x9e3779b97f4a7c15u;
    word = detail::scramble(seed);
  }
}

std::uint64_t Rng::below(std::uint64_t n) noexcept {
  // Reject the short last interval, so that every residue has the same number of preimages.
  const std::uint64_t threshold = (0 - n) % n;
  for (;;) {
    const std::uint64_t x = next();
    if (x >= threshold) return x % n;
  }
}

Vec3 uniform_barycentric(Rng& rng) noexcept {
  double u = rng.uniform();
  double v = rng.uniform();
  // Fold the unit square onto the triangle. Multiples of 2^-53 below 1: the reflection and 1 − u − v are exact, hence the
  // three coordinates are non-negative and sum to exactly 1.
  if (u + v > 1.0) {
    u = 1.0 - u;
    v = 1.0 - v;
  }
  return {1.0 - u - v, u, v};
}

const char* name_of(Outcome outcome) noexcept {
  switch (outcome) {
    case Outcome::kDone:
      return "done";
    case Outcome::kCountMissed:
      return "count missed";
    case Outcome::kIterationLimit:
      return "iteration limit";
    case Outcome::kStalled:
      return "stalled";
    case Outcome::kNotMaximal:
      return "not maximal";
    case Outcome::kErrorMissed:
      return "error missed";
    case Outcome::kShapeChanged:
      return "shape changed";
    case Outcome::kCancelled:
      return "cancelled";
  }
  return "";
}

namespace detail {

namespace {

// Squares in here are as precise as any, their parts included where these count.
bool well_in_range(double square) { return square > 1e-280 && square < 1e280; }

// 2^-exponent times the vector, which makes its greatest coordinate some number in [½, 1).
Vec3 scaled_to_one(const Vec3& a, int& exponent) {
  std::frexp(a.lpNorm<Eigen::Infinity>(), &exponent);
  return {std::ldexp(a[0], -exponent), std::ldexp(a[1], -exponent), std::ldexp(a[2], -exponent)};
}

}  // namespace

double stable_norm(const Vec3& a) noexcept {
  const double square = squared_norm(a);
  if (well_in_range(square)) return std::sqrt(square);
  if (!a.allFinite() || a.isZero(0)) return square;
  int exponent = 0;
  const Vec3 scaled = scaled_to_one(a, exponent);
  return std::ldexp(norm(scaled), exponent);
}

Vec3 stable_normalized(const Vec3& a) noexcept {
  const double square = squared_norm(a);
  if (well_in_range(square)) return a / std::sqrt(square);
  if (!a.allFinite() || a.isZero(0)) return a;
  int exponent = 0;
  return normalized(scaled_to_one(a, exponent));
}

void require_exact_arithmetic() {
  // volatile: the compiler must not evaluate these with its own arithmetic.
  // `more` is above half an ulp by less than the extended precision of the x87 holds: rounded to that first, it is a tie.
  volatile double one = 1.0, half_ulp = 0x1p-53, more = 0x1.000002p-53;
  volatile double down = one + half_ulp;  // tie: to even, that is to 1
  volatile double up = one + more;        // above the tie: away
  volatile double minus = -one - more;
  if (down != 1.0 || up != 1.0 + 0x1p-52 || minus != -(1.0 + 0x1p-52)) {
    throw Error(ErrorCode::kEnvironment,
                "amps: floating-point arithmetic of this thread does not round to nearest in double precision; restore it with "
                "fesetround(FE_TONEAREST), and compile for SSE2 or another unit without extended precision");
  }
}

std::string number_text(double x) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text << x;
  return text.str();
}

void assertion_failed(const char* condition, const char* file, int line) {
  throw Error(ErrorCode::kInternal, std::string("amps: internal error, please report it: ") + condition + " does not hold at " +
                                        file + ":" + std::to_string(line));
}

}  // namespace detail
}  // namespace amps
