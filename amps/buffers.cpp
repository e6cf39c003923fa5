#define AMPS_OWN_SOURCE
#include "amps/buffers.h"

#if defined(__GNUC__)
#define AMPS_NOINLINE __attribute__((noinline))
#else
#define AMPS_NOINLINE
#endif

namespace amps {
namespace {

/// kNone for a number that is no Index.
template <class T>
Index narrowed(const unsigned char* at) noexcept {
  const T value = detail::load<T>(at);
  if constexpr (std::is_signed_v<T>) {
    if (value < 0) return kNone;
  }
  constexpr auto kMaxIndex = static_cast<std::uint64_t>(std::numeric_limits<Index>::max());
  return static_cast<std::uint64_t>(value) > kMaxIndex ? kNone : static_cast<Index>(value);
}

}  // namespace

// Not inline, on purpose: where floats made double and doubles meet in one variable that is made float again, GCC 12 drops both
// conversions from -O2 on, also of the doubles (its vectoriser of straight code).

AMPS_NOINLINE Vec3 PointsView::from_floats(std::ptrdiff_t i) const noexcept {
  const std::ptrdiff_t at = i * memory_.stride;
  const auto& column = memory_.column;
  using detail::load;
  return {load<float>(column[0] + at), load<float>(column[1] + at), load<float>(column[2] + at)};
}

AMPS_NOINLINE double ValuesView::from_float(std::ptrdiff_t i) const noexcept {
  return detail::load<float>(memory_.column[0] + i * memory_.stride);
}

Index TrianglesView::converted(const unsigned char* at) const noexcept {
  switch (type_) {
    case Type::kInt16:
      return narrowed<std::int16_t>(at);
    case Type::kUint16:
      return narrowed<std::uint16_t>(at);
    case Type::kInt32:
      return detail::load<std::int32_t>(at);
    case Type::kUint32:
      return narrowed<std::uint32_t>(at);
    case Type::kInt64:
      return narrowed<std::int64_t>(at);
    case Type::kUint64:
      return narrowed<std::uint64_t>(at);
  }
  return kNone;
}

}  // namespace amps

#undef AMPS_NOINLINE
