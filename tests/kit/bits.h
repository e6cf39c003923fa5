// bits.h: the bits of results as one number, to be compared with one recorded once.
#pragma once

#include <cstddef>
#include <cstdint>

namespace amps_test {

/// FNV-1a of the numbers in lists and matrices without gaps, and of nothing else, in the order given.
template <class... Lists>
std::uint64_t hash_bits(const Lists&... lists) {
  std::uint64_t h = 14695981039346656037u;
  const auto add = [&h](const void* data, std::size_t size) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (std::size_t k = 0; k < size; ++k) h = (h ^ bytes[k]) * 1099511628211u;
  };
  (add(lists.data(), static_cast<std::size_t>(lists.size()) * sizeof(*lists.data())), ...);
  return h;
}

}  // namespace amps_test
