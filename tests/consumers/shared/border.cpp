// What has to cross the border of a shared library: errors of amps on their way out, a program's own on their way through, and
// the templates of the headers that have their last stages in the library.
#include <amps/amps.h>

#include <cstdio>
#include <functional>
#include <string>
#include <typeinfo>

namespace {

bool expect(bool holds, const char* what) {
  if (!holds) std::fprintf(stderr, "failed: %s\n", what);
  return holds;
}

struct ProgramError {
  int number;
};

struct FailingExecutor : amps::Executor {
  unsigned concurrency() const override { return 2; }
  void run(unsigned, const std::function<void(unsigned)>&) override { throw ProgramError{7}; }
};

/// What `call` throws: "Error", "ProgramError", "other" or "nothing".
template <class Call>
std::string thrown_by(const Call& call) {
  try {
    call();
  } catch (const amps::Error& error) {
    return typeid(error) == typeid(amps::Error) ? "Error" : "another type";
  } catch (const ProgramError&) {
    return "ProgramError";
  } catch (...) {
    return "other";
  }
  return "nothing";
}

}  // namespace

int main() {
  bool good = true;
  const amps::Mesh mesh = amps::make_sphere(1280);
  amps::SamplingOptions options;
  options.radius = -1;
  good &= expect(thrown_by([&] { amps::sample(mesh, options); }) == "Error", "an error of amps is caught as such");
  options.radius = 0.1;
  options.execution.progress = amps::Progress([](const char*, double) -> bool { throw ProgramError{1}; }, 0);
  good &= expect(thrown_by([&] { amps::sample(mesh, options); }) == "ProgramError", "an error of a callback passes through");
  FailingExecutor executor;
  const amps::Execution on_it(2, {}, &executor);
  good &= expect(thrown_by([&] { amps::parallel_for(100, 1, on_it, [](std::size_t, std::size_t) {}); }) == "ProgramError",
                 "an error of an executor passes through");

  const amps::WeightedPoint a{0, 0, 0, 0}, b{1, 0, 0, 0}, c{0, 1, 0, 0}, d{0, 0, 1, 0}, e{1, 1, 0, 0}, q{1, 1, 1, 0};
  good &= expect(amps::orient3d(a, b, c, d) == 1 && amps::orient3d(a, b, c, e) == 0, "orientation, exact");
  good &= expect(amps::power_test<false>(a, b, c, d, q) == 0 && amps::power_test(a, b, c, d, q) != 0, "power test, exact");
  return good ? 0 : 1;
}
