// What `servosense monitor` tells of the chatter in random cuts: the frequency beside the truth and
// a naive method, and the speeds by a file whose structure is as a tap test would give it.
//
//   chatter_advice_study             a few cuts
//   chatter_advice_study --nightly   240
//   chatter_advice_study --cases N [--from SEED]
#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "chatter_advice.hpp"
#include "check.hpp"
#include "detection/random_cuts.hpp"
#include "detection/scores.hpp"
#include "detection/tapped_file.hpp"
#include "dsp/fourier.hpp"

using namespace detection;
using cli::ChatterAdvice;
using cli::ChatterAdviceResult;
using cli::ChatterStretch;
using detection::Event;

namespace {

constexpr std::uint64_t kFirstSeed = 745000;

/// Power under a Hann window, padded to four times the length and more.
std::vector<double> power_of(std::vector<double> values, double& step_hz) {
  const auto n = static_cast<double>(values.size());
  double mean = 0;
  for (const double v : values) mean += v / n;
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = (values[i] - mean) * (1 - std::cos(kTwoPi * (static_cast<double>(i) + 0.5) / n));
  std::size_t size = 1;
  while (size < 4 * values.size()) size *= 2;
  values.resize(size, 0);
  const std::vector<std::complex<double>> lines = fourier_lines(values);
  std::vector<double> power(size / 2);
  for (std::size_t k = 0; k < power.size(); ++k) power[k] = std::norm(lines[k]);
  step_hz = 1 / (static_cast<double>(size) * kPeriod_s);
  return power;
}

/// Strongest line that is at least `off_hz` from every multiple of `harmonics_of_hz`.
double strongest(const std::vector<double>& power, double step_hz, double harmonics_of_hz,
                 double off_hz) {
  double most = 0, at_hz = 0;
  for (std::size_t k = 1; k < power.size(); ++k) {
    const double hz = static_cast<double>(k) * step_hz;
    if (hz < 0.5 * harmonics_of_hz || std::abs(std::remainder(hz, harmonics_of_hz)) < off_hz)
      continue;
    if (power[k] > most) most = power[k], at_hz = hz;
  }
  return at_hz;
}

struct Told {
  int right = 0, wrong = 0, none = 0;
  void add(const ChatterAdviceResult& result, double true_hz) {
    if (result.line.verdict != ChatterLineVerdict::told)
      ++none;
    else
      ++(std::abs(result.line.frequency_hz / true_hz - 1) < 0.01 ? right : wrong);
  }
  void print(const char* name) const {
    std::printf("  %-44s %4d right, %3d wrong, %3d none: %.1f %% right or none\n", name, right,
                wrong, none, 100.0 * (right + none) / std::max(1, right + wrong + none));
  }
};

}  // namespace

int main(int argc, char** argv) {
  std::size_t cases = 20;
  std::uint64_t from = kFirstSeed;
  bool nightly = false;
  for (int i = 1; i < argc; ++i) {
    const std::string option = argv[i];
    const char* value = i + 1 < argc ? argv[i + 1] : "0";
    if (option == "--nightly") cases = 240, nightly = true;
    if (option == "--cases") cases = std::strtoul(value, nullptr, 10);
    if (option == "--from") from = std::strtoul(value, nullptr, 10);
  }
  Told bare, with_file, naive, of_teeth[7];
  int forced = 0, undecided = 0, silent = 0, advised = 0, stable = 0, cuts_advised = 0;
  for (std::size_t n = 0; n < cases; ++n) {
    const Cut c = draw(from + n, Event::chatter);
    const Record r = simulate(c);
    const MachineFile machine = learn(c, idle_run(c));
    const MachineFile file = file_of(c);
    const StackPlan plan = good(plan_stack(machine, signals()), c.text.c_str());
    auto stack = std::make_unique<HostStack>();
    stack->configure(plan.config);
    ChatterAdvice advice(machine, plan), knowing(file, plan);
    Reporter<double> reporter(c, r, c.seed + 1);
    std::optional<ChatterStretch> stretch;
    std::vector<double> torque_Nm, x_m, y_m;
    bool heard = false;
    for (std::size_t i = 0; i < r.size() && !stretch; ++i) {
      for (const auto& change : stack->process(reporter.at(i)))
        if (!heard && change.monitor == MonitorId::chatter && change.state == MonitorState::alarm) {
          heard = true;
          advice.alarm(0, change);
        }
      if (!heard) continue;
      stretch = advice.add(*stack);
      torque_Nm.push_back(stack->spindle().estimate);
      x_m.push_back(static_cast<double>(r.x_m[i]));
      y_m.push_back(static_cast<double>(r.y_m[i]));
    }
    if (!heard) continue;
    if (!stretch) stretch = advice.finish();
    const ChatterAdviceResult first = advice.look_into(*stretch);
    const ChatterAdviceResult known = knowing.look_into(*stretch);
    const double rotation_hz = first.line.spindle_speed_rpm / 60;
    if (!(rotation_hz > 0)) {  // fewer than eight revolutions were left
      ++bare.none, ++with_file.none, ++silent;
      continue;
    }
    double step_hz = 0;
    std::vector<double> moved = power_of(x_m, step_hz);
    const std::vector<double> across = power_of(y_m, step_hz);
    for (std::size_t k = 0; k < moved.size(); ++k) moved[k] += across[k];
    const double cell_hz = 1 / (static_cast<double>(x_m.size()) * kPeriod_s);
    const double true_hz = strongest(moved, step_hz, rotation_hz, 2 * cell_hz);
    const double by_torque_hz =
        strongest(power_of(torque_Nm, step_hz), step_hz, rotation_hz * c.teeth(), 2 * cell_hz);
    bare.add(first, true_hz);
    of_teeth[c.teeth()].add(first, true_hz);
    with_file.add(known, true_hz);
    ++(std::abs(by_torque_hz / true_hz - 1) < 0.01 ? naive.right : naive.wrong);
    forced += first.line.verdict == ChatterLineVerdict::forced;
    undecided += first.line.verdict == ChatterLineVerdict::undecided;
    silent += first.line.verdict == ChatterLineVerdict::silent;
    for (const auto* result : {&first, &known})
      if (result->line.verdict == ChatterLineVerdict::told &&
          !(std::abs(result->line.frequency_hz / true_hz - 1) < 0.01))
        std::printf("  %s: told %.1f Hz, swings at %.1f Hz, tooth %.1f Hz\n", c.text.c_str(),
                    result->line.frequency_hz, true_hz, rotation_hz * c.teeth());
    CHECK(first.speeds_rpm.empty());
    const MillingSimulation& m = c.milling();
    const auto exact = good(SemiDiscretization::create(m.structure, m.tool, m.cut), "truth");
    cuts_advised += !known.speeds_rpm.empty();
    for (const double rpm : known.speeds_rpm) {
      ++advised;
      stable += exact.spectral_radius(rpm, m.cut.axial_depth_m) < 1;
      CHECK(std::abs(rpm / known.line.spindle_speed_rpm - 1) > 0.02);
    }
  }
  const int cuts = bare.right + bare.wrong + bare.none;
  std::printf("  seeds %llu to %llu: %d cuts with a chatter alarm\n",
              static_cast<unsigned long long>(from),
              static_cast<unsigned long long>(from + cases - 1), cuts);
  bare.print("file without structure");
  std::printf("    none: %d nothing stands out, %d at a harmonic, %d undecided between lines\n",
              silent, forced, undecided);
  for (std::size_t z = 2; z <= 6; ++z)
    of_teeth[z].print(("  " + std::to_string(z) + " teeth").c_str());
  with_file.print("file with structure (1 % off)");
  naive.print("naive: strongest line of the torque");
  std::printf("  speeds, file with structure: %d of %d stable, in %d of %d cuts\n", stable, advised,
              cuts_advised, cuts);
  CHECK(cuts >= static_cast<int>(cases) / 2);
  CHECK(bare.wrong * 50 <= std::max(50, cuts));
  CHECK(with_file.wrong * 50 <= std::max(50, cuts));
  CHECK(naive.wrong > bare.wrong);
  if (nightly) {
    CHECK(bare.right * 3 >= cuts);
    CHECK(stable * 10 >= advised * 9);
    CHECK(cuts_advised * 3 >= cuts);
  }
  return check::done();
}
