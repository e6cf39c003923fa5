// results.cpp: results of each part of amps, each as a hash of its text, which has every bit. Built against the library and,
// with AMPS_TEST_SINGLE, against the single header: both must print the same.
#ifdef AMPS_TEST_SINGLE
// What windows.h and X11 leave behind. Set aside by the header, and here again after it.
#define min(a, b) ((a) < (b) ? (a) : (b))
#define max(a, b) ((a) > (b) ? (a) : (b))
#define near
#define far
#define small char
#define Status int
#define Success 0
#include "amps_single.h"
#include "amps_single.h"  // again: nothing is there twice
#if !defined(min) || !defined(Success) || min(3, 2) != 2 || Success != 0
#error "the single header changed a macro of the user's"
#endif
#ifdef AMPS_OWN_SOURCE
#error "the single header takes a user's file for one of its own"
#endif
#undef min
#undef max
#undef near
#undef far
#undef small
#undef Status
#undef Success
#else
#include "amps/amps.h"
#endif

#include <cinttypes>
#include <cstdint>
#include <cstdio>
#include <string>

namespace {

/// FNV-1a.
void print(const char* name, const std::string& text) {
  std::uint64_t h = 14695981039346656037u;
  for (const char c : text) h = (h ^ static_cast<unsigned char>(c)) * 1099511628211u;
  std::printf("%s %016" PRIx64 "\n", name, h);
}

std::string obj(const amps::Mesh& mesh) { return amps::format_mesh(mesh, amps::MeshFormat::kObj); }
std::string csv(const amps::SampleSet& samples) { return amps::format_samples(samples, amps::SampleFormat::kCsv); }

}  // namespace

#ifdef AMPS_TEST_SINGLE
double product_sum_before(double a, double b, double c);
double product_sum_after(double a, double b, double c);
#endif

int main(int argc, char**) try {
#ifdef AMPS_TEST_SINGLE
  // −2^-60, or 0 if the product is rounded before the sum. The compiler does not know what argc is.
  const double a = argc + 0x1p-30, b = argc - 0x1p-30;
  if (product_sum_before(a, b, -1) != product_sum_after(a, b, -1)) {
    std::fprintf(stderr, "the single header changes how a user's code is rounded\n");
    return 1;
  }
#else
  static_cast<void>(argc);
#endif
  const amps::Mesh torus = amps::make_torus();
  print("input", obj(torus));

  amps::SamplingOptions sampling;
  sampling.radius = 0.1;
  print("sampled", csv(amps::sample(torus, sampling).samples));

  amps::RemeshOptions options;
  options.sampling.target_count = 800;
  const amps::RemeshResult remeshed = amps::remesh(amps::make_knot(), options);
  print("remeshed", obj(remeshed.mesh) + csv(remeshed.samples));

  options.optimization.min_angle = 42;
  options.optimization.max_angle = 90;
  print("optimised to 42-90", obj(amps::remesh(torus, options).mesh));

  const amps::Mesh ellipsoid = amps::make_ellipsoid(2000, amps::Vec3(2, 1, 1));
  amps::RemeshOptions varying;
  varying.sampling.sizing = amps::for_count(amps::lfs_sizing(ellipsoid), 800);
  const amps::RemeshResult by_lfs = amps::remesh(ellipsoid, varying);
  print("by local feature size", obj(by_lfs.mesh));

  const amps::Vec3 query(0.3, -1.7, 0.2);
  std::printf("nearest point %a\n", amps::SurfaceTree(ellipsoid).nearest(query).distance);
  std::printf("certificate %a\n", by_lfs.report.maximality.worst_coverage);
  return 0;
} catch (const amps::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 2;
}
