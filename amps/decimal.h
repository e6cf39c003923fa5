// decimal.h: (internal) doubles as text, the same text with every standard library.
#pragma once

#include "amps/base.h"

#include <string>

namespace amps::detail {

/// Appends the shortest decimal that reads back as the same double, of those the nearest to it; as std::to_chars does, plain or
/// with an exponent, whichever is shorter. Finite numbers only.
void append_number(std::string& out, double value);

/// The same without std::to_chars, which not every standard library has: some twenty times slower.
void append_number_slowly(std::string& out, double value);

}  // namespace amps::detail
