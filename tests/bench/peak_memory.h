// peak_memory.h: how much memory the program has held at most, for benchmarks of the growth of memory.
#pragma once

#if defined(__GLIBC__)
#include <malloc.h>
#endif

#include <fstream>
#include <string>

namespace amps_bench {

/// Peak resident memory since the last reset, in bytes; 0 where the system does not say.
inline double peak_memory() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("VmHWM:", 0) == 0) return 1024.0 * std::stod(line.substr(6));
  }
  return 0;
}

inline double reset_peak_memory() {
#if defined(__GLIBC__)
  malloc_trim(0);  // or what earlier cases left in the heap would not count
#endif
  std::ofstream("/proc/self/clear_refs") << 5;
  return peak_memory();
}

}  // namespace amps_bench
