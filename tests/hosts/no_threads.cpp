// A system that refuses threads: its pthread_create fails after the first few. Work goes on with those there are, with the same
// bits.
#include "amps/amps.h"

#include <dlfcn.h>
#include <pthread.h>

#include <atomic>
#include <cerrno>
#include <cstdio>

namespace {
std::atomic<int> threads_left{0};
std::atomic<int> refused{0};
}  // namespace

// Stands in front of the C library's.
extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*start)(void*), void* argument) {
  if (threads_left.fetch_sub(1) <= 0) {
    ++refused;
    return EAGAIN;
  }
  using Create = int (*)(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*);
  static const Create create = reinterpret_cast<Create>(dlsym(RTLD_NEXT, "pthread_create"));
  return create(thread, attributes, start, argument);
}

int main() {
  const amps::Mesh mesh = amps::make_torus();
  amps::RemeshOptions options;
  options.sampling.target_count = 4000;
  const amps::RemeshResult expected = amps::remesh(mesh, options);
  options.sampling.execution.threads = 4;
  for (const int allowed : {0, 1, 2}) {
    threads_left = allowed;
    refused = 0;
    const amps::RemeshResult result = amps::remesh(mesh, options);
    const bool same = result.mesh.vertices == expected.mesh.vertices && result.mesh.triangles == expected.mesh.triangles;
    std::printf("%d threads, %d refused: %s\n", allowed, refused.load(), same ? "the same bits" : "other bits");
    if (!same || refused == 0) return 1;
  }
  return 0;
}
