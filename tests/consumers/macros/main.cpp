// A host with macros for everything. AMPS_MACROS_FIRST: they come ahead of all else; without, behind the standard library, as
// when amps is included late.
#ifdef AMPS_MACROS_FIRST
#include "hosts.h"
#else
#include <algorithm>
#include <cassert>
#include <cmath>
#include <complex>
#include <filesystem>
#include <functional>
#include <iostream>
#include <limits>
#include <mutex>
#include <string>
#include <thread>
#include <vector>
#include "hosts.h"
#endif

#ifdef AMPS_SINGLE
#define AMPS_IMPLEMENTATION
#include "amps_single.h"
#else
#include "amps/amps.h"
#endif

#if !defined(check) || !defined(min) || !defined(near) || !defined(Status)
#error "amps has taken a macro away"
#endif

// Names that macros hide are within reach.
int main() {
  amps::RemeshOptions options;
  options.sampling.radius = 0.2;
  const amps::Mesh mesh = amps::make_sphere();
  const amps::SizingField field = amps::uniform_sizing(mesh, 0.1);
  return (amps::check)(mesh, {}).usable() && (amps::min)(field, field, {}).min_radius() > 0 ? 0 : 1;
}
