// Fuzz target: bytes are a program of insertions, bulk insertions, removals, returns and movements, and check() proves each
// step.
//   libFuzzer: clang++ -DAMPS_LIBFUZZER -fsanitize=fuzzer,address,undefined tests/fuzz_triangulation.cpp and the library's
//   sources CTest:     fuzz_triangulation [SECONDS [SEED]] runs random bytes through it, 60 seconds by default
#include "amps/triangulation.h"

#include "kit/sites.h"

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

using amps::Index;
using amps::RegularTriangulation;
using State = RegularTriangulation::VertexState;

namespace {

/// Takes values off the front of a byte string; zeros when it is used up.
struct Bytes {
  const std::uint8_t* data;
  std::size_t left;
  std::uint8_t byte() { return left == 0 ? std::uint8_t{0} : (--left, *data++); }
  /// A coordinate: a small integer (most sets are degenerate), a sixteenth, or any finite double.
  double number(unsigned kind) {
    if (kind == 0) return byte() % 4;
    if (kind == 1) return (byte() - 128) / 16.0;
    std::uint64_t bits = 0;
    for (int k = 0; k < 8; ++k) bits = bits << 8 | byte();
    double x;
    std::memcpy(&x, &bits, sizeof x);
    return std::isfinite(x) ? x : 0.0;
  }
  amps::WeightedPoint point(unsigned kind) {
    const double x = number(kind), y = number(kind), z = kind == 0 && byte() % 2 == 0 ? 0 : number(kind);
    return {x, y, z, byte() % 4 == 0 ? number(kind) : 0.0};
  }
};

void require(bool good, const char* what) {
  if (good) return;
  std::fprintf(stderr, "fuzz_triangulation: %s\n", what);
  std::abort();
}

/// As construction makes it of what is left.
void require_rebuilt(const RegularTriangulation& t) {
  amps_test::WeightedPoints left;
  for (Index v = 0; v < t.num_vertices(); ++v) {
    if (t.state(v) != State::kRemoved) left.push_back(t.point(v));
  }
  const RegularTriangulation fresh(amps_test::positions_of(left), amps_test::weights_of(left));
  require(t.dimension() == fresh.dimension(), "another dimension than construction of what is left");
  require(t.num_cells() == fresh.num_cells() && t.num_hidden() == fresh.num_hidden(), "not construction of what is left");
  for (Index v = 0, row = 0; v < t.num_vertices(); ++v) {
    if (t.state(v) == State::kRemoved) continue;
    require((t.state(v) == State::kVisible) == (fresh.state(row++) == State::kVisible),
            "another vertex than construction makes");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes bytes{data, size};
  RegularTriangulation t;
  // One in eight programs has arbitrary doubles: they are slow, most decisions being exact.
  const unsigned mode = bytes.byte() % 8;
  const unsigned kind = mode == 0 ? 2 : mode % 2;
  for (int step = 0; bytes.left > 0 && step < (kind == 2 ? 40 : 400); ++step) {
    const unsigned what = bytes.byte() % 16;
    const amps::WeightedPoint p = bytes.point(kind);
    const Index n = t.num_vertices(), v = n == 0 ? 0 : bytes.byte() % n;
    const bool live = n > 0 && t.state(v) != State::kRemoved;
    const Index capacity = t.cell_capacity(), hint = capacity == 0 ? amps::kNone : bytes.byte() % capacity;
    if (what < 1) {
      const Index count = bytes.byte() % 16;
      const amps_test::WeightedPoints some = amps_test::drawn(count, [&] { return bytes.point(kind); });
      t.insert(amps_test::positions_of(some), amps_test::weights_of(some));
    } else if (what < 6 || n == 0) {
      t.insert(p.position(), p.w, hint);
    } else if (!live) {
      t.reinsert(v, p.position(), p.w, hint);
    } else if (what < 13) {
      t.remove(v);
    } else {
      t.move(v, what == 13 ? t.point(v).position() : p.position(), p.w);
    }
    const std::string wrong = t.check();
    require(wrong.empty(), wrong.c_str());
    if (t.dimension() < 3) require_rebuilt(t);  // check() has nothing to look at
  }
  require_rebuilt(t);
  return 0;
}

#ifndef AMPS_LIBFUZZER
int main(int argc, char** argv) {
  const double seconds = argc > 1 ? std::atof(argv[1]) : 60;
  std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  const auto start = std::chrono::steady_clock::now();
  const auto elapsed = [start] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); };
  std::vector<std::uint8_t> bytes;
  std::uint64_t programs = 0;
  do {
    // Before the run: a crash leaves the seed of the program that caused it as the last line. SECONDS = 0 runs that one alone.
    std::printf("\rfuzz_triangulation: seed %llu", static_cast<unsigned long long>(seed));
    std::fflush(stdout);
    amps::Rng rng(seed++);
    bytes.resize(rng.below(rng.below(2000) + 1));  // many short programs: few points, often flat
    for (std::uint8_t& b : bytes) b = static_cast<std::uint8_t>(rng.below(256));
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
    ++programs;
  } while (elapsed() < seconds);
  std::printf("\nfuzz_triangulation: %llu programs in %.0f s\n", static_cast<unsigned long long>(programs), elapsed());
  return 0;
}
#endif
