// Exact work is refused, with the environment error, where doubles are rounded to extended precision first.
#include "amps/base.h"

#include <cfloat>
#include <cstdio>

int main() {
#if FLT_EVAL_METHOD == 2
  const bool is_sound = false;
#else
  const bool is_sound = true;
#endif
  bool is_accepted = true;
  try {
    amps::detail::require_exact_arithmetic();
  } catch (const amps::Error& error) {
    is_accepted = false;
    std::printf("%s\n", error.what());
    if (error.code() != amps::ErrorCode::kEnvironment) return 1;
  }
  return is_accepted == is_sound ? 0 : 1;
}
