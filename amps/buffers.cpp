#define AMPS_OWN_SOURCE
#include "amps/buffers.h"

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

// Not inlined even where all sources are one: GCC 12 would follow kNone into arrays and warn of it.
#if defined(__GNUC__)
__attribute__((noinline))
#endif
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
