// basics.h: the names of amps that most tests use, and a few numbers. Test files live in namespace amps_test, as the kit does.
#pragma once

#include "amps/mesh.h"

#include <cstddef>
#include <limits>

namespace amps_test {

using amps::Error;
using amps::ErrorCode;
using amps::Index;
using amps::kNone;
using amps::Mesh;
using amps::MeshView;
using amps::Outcome;
using amps::Points;
using amps::Rng;
using amps::Triangles;
using amps::Vec3;

/// What oracles calculate with.
using Real = long double;

inline constexpr double kPi = 3.14159265358979323846;
inline constexpr double kDegree = kPi / 180;
inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// An index as a place in a standard container.
inline std::size_t at(Index i) { return static_cast<std::size_t>(i); }

}  // namespace amps_test
