// base.h: the vocabulary of amps — vectors and index types, errors, assertions, a seeded random generator. Everything else in
// the library includes this file and only files between it and itself in the reading order of amps.h.
#pragma once

#include "amps/host_macros_begin.h"

#include "amps/contraction.h"

#include <Eigen/Core>
#include <Eigen/Geometry>  // cross products

#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

/// Marks what a shared library shows. Where amps is one (AMPS_SHARED: CMake defines it, for users as well, who may also do so
/// by hand), all else is hidden; a static library and the single header need nothing.
#if !defined(AMPS_SHARED)
#define AMPS_EXPORT
#elif defined(_WIN32) || defined(__CYGWIN__)
#if defined(AMPS_OWN_SOURCE)
#define AMPS_EXPORT __declspec(dllexport)
#else
#define AMPS_EXPORT __declspec(dllimport)
#endif
#else
#define AMPS_EXPORT __attribute__((visibility("default")))
#endif

namespace amps {

/// Index of a vertex, facet, sample or cell. 32 bits: every array of amps has fewer than 2^31 entries.
using Index = std::int32_t;

/// "No such element" wherever an Index is expected.
inline constexpr Index kNone = -1;

using Vec3 = Eigen::Vector3d;

/// What went wrong, for programs; `Error::what()` says what, where and what to do, for people.
enum class ErrorCode {
  kInvalidArgument,  ///< an option or argument out of its range
  kInvalidMesh,      ///< a mesh that cannot be worked on: empty, not finite, indices out of range, no area
  kFileNotFound,     ///< a file that cannot be opened or created
  kFileFormat,       ///< a file that is not what its name or header says, or is cut short
  kTooLarge,         ///< the result would not fit in memory or in 32-bit indices
  kEnvironment,      ///< floating-point arithmetic is not what exactness needs (-ffast-math, other rounding mode)
  kCancelled,        ///< stopped through Progress (execution.h) in a call that has nothing to return but its whole result
  kInternal,         ///< a broken invariant: a bug in amps, please report it
};

/// The one exception amps throws (besides std::bad_alloc). State passed by reference is unchanged when it is thrown, unless
/// the function says otherwise.
class AMPS_EXPORT Error : public std::runtime_error {
 public:
  Error(ErrorCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
  Error(const Error&) = default;
  Error& operator=(const Error&) = default;
  ~Error() override;  // in base.cpp, so that all programs and libraries share one type information
  ErrorCode code() const noexcept { return code_; }

 private:
  ErrorCode code_;
};

/// Seeded generator, the same sequence on every platform: xoshiro256** (Blackman & Vigna 2018), seeded by splitmix64. The
/// distributions of <random> differ between standard libraries, so amps has its own.
class Rng {
 public:
  AMPS_EXPORT explicit Rng(std::uint64_t seed) noexcept;

  std::uint64_t next() noexcept {
    const std::uint64_t result = rotate(state_[1] * 5, 7) * 9;
    const std::uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = rotate(state_[3], 45);
    return result;
  }

  /// Uniform in [0, 1), a multiple of 2^-53.
  double uniform() noexcept { return static_cast<double>(next() >> 11) * 0x1p-53; }

  /// Uniform in {0, …, n−1}; n ≥ 1. Unbiased (rejection).
  AMPS_EXPORT std::uint64_t below(std::uint64_t n) noexcept;

 private:
  static std::uint64_t rotate(std::uint64_t x, int k) noexcept { return (x << k) | (x >> (64 - k)); }
  std::uint64_t state_[4];
};

/// Barycentric coordinates of a uniformly distributed point of a triangle; two draws of `rng`.
AMPS_EXPORT Vec3 uniform_barycentric(Rng& rng) noexcept;

/// How a call ended that need not reach all it was asked for. The result is valid in any case. In this order one is worse than
/// another.
enum class Outcome {
  kDone,            ///< everything asked for was reached
  kIterationLimit,  ///< as many iterations as allowed were spent
  kStalled,         ///< going on would bring nothing, or too little
  kNotMaximal,      ///< parts of the surface are in no disk, for the sake of the exact number of samples that was asked for
  kCountMissed,     ///< the number of samples is another one than asked for: the shape needs more, or fewer fit on it
  kErrorMissed,     ///< the result is farther from the surface than asked for, or not proved to be as near
  kShapeChanged,    ///< the result has another topology than the surface, lacks some of its curves, or is empty
  kCancelled,       ///< stopped through Progress
};

/// In words: "done", "iteration limit", "stalled", "not maximal", "count missed", "error missed", "shape changed", "cancelled".
AMPS_EXPORT const char* name_of(Outcome outcome) noexcept;

namespace detail {

/// As a double; INFINITY is a float, whose conversion compilers like to warn of.
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Sums over the coordinates of a vector, from the first to the last: Eigen's own dot, norm and sum add in another order with
// vector units than without. (What Eigen does coordinate by coordinate, and its cross product, have one order anyway.)
// Always inline: a copy in a program that allows contraction must not stand in for the library's.
#if defined(__GNUC__) || defined(__clang__)
#define AMPS_ALWAYS_INLINE inline __attribute__((always_inline))
#elif defined(_MSC_VER)
#define AMPS_ALWAYS_INLINE __forceinline
#else
#define AMPS_ALWAYS_INLINE inline
#endif

AMPS_ALWAYS_INLINE double sum(const Vec3& a) noexcept { return a[0] + a[1] + a[2]; }
AMPS_ALWAYS_INLINE double dot(const Vec3& a, const Vec3& b) noexcept { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
AMPS_ALWAYS_INLINE double squared_norm(const Vec3& a) noexcept { return a[0] * a[0] + a[1] * a[1] + a[2] * a[2]; }
AMPS_ALWAYS_INLINE double norm(const Vec3& a) noexcept { return std::sqrt(squared_norm(a)); }

/// The vector itself if its square is zero.
AMPS_ALWAYS_INLINE Vec3 normalized(const Vec3& a) noexcept {
  const double square = squared_norm(a);
  return square > 0 ? Vec3(a / std::sqrt(square)) : a;
}

/// The same for vectors whose squares are out of range: areas at extreme scales.
double stable_norm(const Vec3& a) noexcept;
Vec3 stable_normalized(const Vec3& a) noexcept;

/// splitmix64's finaliser: a hash of 64 bits.
inline std::uint64_t scramble(std::uint64_t z) noexcept {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

/// An Index that is known not to be negative, as a position in a std container.
inline std::size_t slot(Index i) noexcept { return static_cast<std::size_t>(i); }

/// Asks for a cache line that will be read soon; nothing where the compiler has no word for it.
inline void prefetch(const void* p) noexcept {
#if defined(__GNUC__) || defined(__clang__)
  __builtin_prefetch(p);
#else
  static_cast<void>(p);
#endif
}

/// Leaves the elements that resize() adds as they are in memory: threads that fill them then share its page faults as well.
template <class T>
struct UninitializedAllocator : std::allocator<T> {
  static_assert(std::is_trivially_copyable<T>::value, "has to be written before it is read, by assignment");
  template <class U>
  struct rebind {
    using other = UninitializedAllocator<U>;
  };
  template <class U>
  void construct(U*) noexcept {}
  template <class U, class... Arguments>
  void construct(U* at, Arguments&&... arguments) {
    ::new (static_cast<void*>(at)) U(std::forward<Arguments>(arguments)...);
  }
};

/// Wall-clock seconds since construction or the last lap().
class Stopwatch {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double seconds = std::chrono::duration<double>(now - start_).count();
    start_ = now;
    return seconds;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// Throws Error(kEnvironment) unless this thread rounds to nearest in plain double precision. A few nanoseconds; called where
/// exact work starts, and on threads that are not ours. Flush-to-zero modes, which games like to set, are fine: only denormal
/// coordinates would notice.
void require_exact_arithmetic();
/// A number in a text for people: six significant digits, 1e-09 as such, a point for the decimals whatever the locale.
std::string number_text(double x);

[[noreturn]] void assertion_failed(const char* condition, const char* file, int line);

}  // namespace detail
}  // namespace amps

/// Invariants of amps itself, never of its input. Checked in debug builds; throws Error(kInternal).
#ifdef NDEBUG
#define AMPS_ASSERT(condition) static_cast<void>(0)
#else
#define AMPS_ASSERT(condition) \
  ((condition) ? static_cast<void>(0) : ::amps::detail::assertion_failed(#condition, __FILE__, __LINE__))
#endif

#include "amps/host_macros_end.h"
