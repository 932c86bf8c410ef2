// Every real-time block, watched by clang's RealtimeSanitizer: anything that may block inside
// process() ends the program with status 43. With --plant it runs a violation on purpose.
// PLANT_AT_COMPILE_TIME plants one that -Wfunction-effects must find.
#include <cstdio>
#include <cstring>
#include <memory>
#include <vector>

#include "../../bench/blocks.hpp"

namespace {

template <typename Case, typename Real>
Real process(Case& block, const bench::Sample<Real>& in) SERVOSENSE_NONBLOCKING {
  return block.step(in);
}

std::vector<float> history;

#ifdef PLANT_AT_COMPILE_TIME
void planted(float x) SERVOSENSE_NONBLOCKING { history.push_back(x); }
#else
// Hidden from the compiler's analysis, not from the sanitizer.
void (*volatile hidden)(float) = [](float x) { history.push_back(x); };
void planted(float x) SERVOSENSE_NONBLOCKING {
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wfunction-effects"
  hidden(x);
#pragma clang diagnostic pop
}
#endif

template <typename Real, typename... Case>
bool run_all(std::tuple<Case...>*) {
  constexpr std::uint32_t kSamples = 8192;
  bench::CutSignal<Real> signal(kSamples, true);
  std::vector<bench::Sample<Real>> samples;
  for (std::uint32_t i = 0; i < kSamples; ++i) samples.push_back(signal.next());
  bool configured = true;
  const auto run = [&](auto block) {
    if (!block->configure().ok()) {
      configured = false;
      return;
    }
    Real sum = 0;
    for (const bench::Sample<Real>& sample : samples) sum += process(*block, sample);
    std::printf("  %-30s sum %.6g\n", block->name, static_cast<double>(sum));
  };
  (run(std::make_unique<Case>()), ...);
  return configured;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "--plant") == 0) {
    planted(1);
    return 0;
  }
  const bool ok = run_all<float>(static_cast<bench::Blocks<float>*>(nullptr)) &&
                  run_all<double>(static_cast<bench::Blocks<double>*>(nullptr));
  return ok ? 0 : 1;
}
