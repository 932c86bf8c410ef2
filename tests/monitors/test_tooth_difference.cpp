// What the difference of tooth-period averages hears, and what the signals that it could be taken
// from still hold (Tarng 1988, sec. 4.2, 5.2, 5.3, 7.2): gains on the lines of the rotation, lines
// of force, acceleration, a sensor without anti-alias filter, ratios of throw and break.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <vector>

#include "check.hpp"
#include "servosense/dsp/biquad.hpp"
#include "servosense/monitors/tooth_breakage.hpp"
#include "servosense/sim/milling_simulator.hpp"

using namespace servosense;

namespace {

using Monitor = ToothBreakageMonitor<double>;
constexpr unsigned kTeeth = 8;

// Amplitude of Delta over the last of 20 turns of a signal of the spindle angle and of time.
double difference_amplitude(double period_s, double speed_rad_s,
                            const std::function<double(double angle, double t_s)>& signal) {
  ToothBreakageConfig c;
  c.sample_period_s = period_s;
  c.teeth = kTeeth;
  c.torque = true;
  c.noise = 1e-6;
  auto monitor = std::make_unique<Monitor>();
  CHECK_TEXT(Monitor::validate(c).reason(), "");
  monitor->configure(c);
  const double step = speed_rad_s * period_s;
  const auto samples = static_cast<int>(20 * kTwoPi / step);
  double angle = 0, square = 0;
  std::vector<double> differences;
  auto part = monitor->core().state().next;
  for (int i = 0; i < samples; ++i) {
    monitor->process(signal(angle, i * period_s), angle, step, Quality::good);
    if (monitor->core().state().next != part)
      differences.push_back(monitor->core().state().difference);
    part = monitor->core().state().next;
    angle += step;
    if (angle >= kTwoPi) angle -= kTwoPi;
  }
  constexpr std::size_t kTurn = std::size_t{Monitor::kPartsPerTooth} * kTeeth;
  for (std::size_t i = differences.size() - kTurn; i < differences.size(); ++i)
    square += differences[i] * differences[i];
  return std::sqrt(2 * square / kTurn);
}

// Continuous averages of tooth periods, 2 sin(u) sin(u) / u at u = pi k / m: nothing is left of the
// tooth frequency and its multiples, and the lines up to half of it are what a break is seen by.
void gains() {
  const std::array<double, 9> gain{0, 0.746, 1.273, 1.449, 1.273, 0.869, 0.424, 0.107, 0};
  // 500 samples a tooth period: straight lines between them miss 1e-4 of line 16.
  const double speed = kTwoPi * 10, period = 0.1 / (500 * kTeeth);
  for (unsigned k = 1; k <= 2 * kTeeth; ++k) {
    const double seen = difference_amplitude(
        period, speed, [&](double angle, double) { return 3 + std::cos(k * angle + 0.3); });
    const double u = kPi * k / kTeeth;
    CHECK_NEAR(seen, 2 * std::sin(u) * std::sin(u) / u, 5e-4);
    if (k < gain.size()) CHECK_NEAR(seen, gain[k], 1e-3);
  }
}

// Without a filter before the sampler a tone just above the servo rate looks like line 3 of the
// turn; the 1 kHz Butterworth filter of the study takes all but 1 / 64 of it.
void aliasing() {
  const double servo_s = 125e-6, speed = kTwoPi * 10;
  constexpr int kFine = 8;
  const double tone_hz = 1 / servo_s + 30;
  const auto sampled = [&](bool filtered) {
    // Second order, bilinear (his C1 to C3 for a low pass).
    const double w = std::tan(kPi * 1000 * servo_s / kFine), q = std::sqrt(2.0) * w;
    const double scale = 1 / (1 + q + w * w);
    Biquad<double> filter;
    filter.configure({w * w * scale, 2 * w * w * scale, w * w * scale, 2 * (w * w - 1) * scale,
                      (1 - q + w * w) * scale});
    int fine = 0;
    return difference_amplitude(servo_s, speed, [&](double, double t_s) {
      double y = 0;
      const int now = static_cast<int>(std::lround(t_s / servo_s)) * kFine;
      for (; fine <= now; ++fine) {
        const double x = std::cos(kTwoPi * tone_hz * fine * servo_s / kFine);
        y = filtered ? filter.process(x) : x;
      }
      return 3 + y;
    });
  };
  const double folded = sampled(false);
  check::figure("tone above the servo rate, folded to line 3: gain", folded);
  CHECK_NEAR(folded, 1.449, 0.005);
  CHECK_BETWEEN(sampled(true) / folded, 0.5 / 64, 1.5 / 64);
}

// Table 4.1: 600 rpm, 101.6 mm, eight straight teeth.
MillingSimulation face_mill(double immersion) {
  MillingSimulation s;
  s.tool.diameter_m = 101.6e-3;
  s.tool.teeth = kTeeth;
  s.tool.force.tangential_coefficient_N_per_m2 = 1500e6;
  s.tool.force.radial_ratio = 0.5263;
  s.cut = {600, 0.254e-3, 1.27e-3, immersion * s.tool.diameter_m, MillingDirection::up};
  if (immersion == 1) s.cut.direction = MillingDirection::slot;
  s.step_s = 0.1 / (kTeeth * 500);
  return s;
}

struct Turn {
  std::vector<double> x, y;
};
Turn one_turn(const MillingSimulation& s) {
  auto simulator = MillingSimulator::create(s);
  Turn turn;
  CHECK(simulator.has_value());
  for (unsigned i = 0; simulator && i < 500 * kTeeth; ++i) {
    const MillingStep& n = simulator->step();
    turn.x.push_back(n.fx_N);
    turn.y.push_back(n.fy_N);
  }
  return turn;
}

// Amplitude of line k of the rotation, by its definition.
double line(const std::vector<double>& x, unsigned k) {
  double c = 0, s = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double a = kTwoPi * k * static_cast<double>(i) / static_cast<double>(x.size());
    c += x[i] * std::cos(a);
    s += x[i] * std::sin(a);
  }
  return 2 * std::hypot(c, s) / static_cast<double>(x.size());
}

// Lines of the rotation below the tooth frequency are there only when a tooth is broken or thrown;
// in a slot three of them hold what the break leaves.
void breakage_zone() {
  for (const double immersion : {0.125, 0.25, 0.5, 0.75, 1.0}) {
    const auto zone = [&](const MillingSimulation& s) {
      const Turn turn = one_turn(s);
      std::array<double, kTeeth> power{};
      for (unsigned k = 1; k < kTeeth; ++k)
        power[k] = std::pow(line(turn.x, k), 2) + std::pow(line(turn.y, k), 2);
      return power;
    };
    const auto sum = [](const auto& power, unsigned to) {
      double s = 0;
      for (unsigned k = 1; k <= to; ++k) s += power[k];
      return s;
    };
    MillingSimulation s = face_mill(immersion);
    const double tooth_N = 648.2;
    const double intact = sum(zone(s), kTeeth - 1);
    CHECK(intact < 1e-6 * tooth_N * tooth_N);
    s.tool.throw_m = {0.1 * 0.254e-3, 0, 0, 0, 0, 0, 0, 0};
    const double thrown = sum(zone(s), kTeeth - 1);
    CHECK(thrown > 1e-4 * tooth_N * tooth_N);
    s.tool.throw_m.clear();
    s.tool.broken_fraction = {1, 0, 0, 0, 0, 0, 0, 0};
    const auto broken = zone(s);
    CHECK(sum(broken, kTeeth - 1) > 10 * thrown);
    if (immersion == 1) {
      check::figure("slot: share of lines 1 to 3 in the breakage zone",
                    sum(broken, 3) / sum(broken, kTeeth - 1));
      CHECK(sum(broken, 3) > 0.9 * sum(broken, kTeeth - 1));
    }
  }
}

// Acceleration of 1 kg at 600 Hz under the same force: a steady slot shows nothing, and what a
// break adds to the peak fades as the tooth frequency comes up to the mode.
void acceleration() {
  const double omega = kTwoPi * 600, damping = 0.04;
  const auto peak = [&](double immersion, bool broken, double rpm) {
    MillingSimulation s = face_mill(immersion);
    if (broken) s.tool.broken_fraction = {1, 0, 0, 0, 0, 0, 0, 0};
    const Turn turn = one_turn(s);  // rigid: the same at any speed
    const double h = 60 / rpm / static_cast<double>(turn.x.size());
    double x = 0, v = 0, most = 0;
    // Long enough for the start to die out, exp(-4 pi 0.04 60 600 / rpm) a turn at the least.
    const int turns = 6 + static_cast<int>(rpm / 100);
    for (int n = 0; n < turns; ++n)
      for (const double force : turn.x) {
        const double a = force - 2 * damping * omega * v - omega * omega * x;
        v += h * a;
        x += h * v;
        if (n + 1 == turns) most = std::max(most, std::abs(a));
      }
    return most;
  };
  // Tooth over natural frequency 1/20, 1/5, 1/2, 1; half immersion.
  for (const auto& [rpm, contrast] :
       {std::array{225.0, 1.99}, {900.0, 1.51}, {2250.0, 1.16}, {4500.0, 1.06}}) {
    CHECK(peak(1, false, rpm) < 1e-3 * peak(1, true, rpm));
    CHECK_NEAR(peak(0.5, true, rpm) / peak(0.5, false, rpm), contrast, 0.01);
  }
}

// Ratios to the mean at which a lost tooth and a throw of a tenth of the feed show (sec. 7.2): the
// same up to arcsin 0.1, apart beyond. Ours are those of the unluckiest place of the parts.
void ratios() {
  using Immersion = ToothImmersion<double, 16, Monitor::kPartsPerTooth>;
  const auto at = [](double swept_deg) {
    return Immersion::row({kTeeth, 0.1, false}, swept_deg * kPi / 180);
  };
  for (const double swept : {3.0, 5.0, 5.7}) {
    CHECK_NEAR(at(swept).broken, 2.0, 0.01);
    CHECK_NEAR(at(swept).thrown, 2.0, 0.01);
  }
  for (const auto& [swept, thrown] : {std::array{10.0, 1.64}, {20.0, 0.99}, {45.0, 0.50}})
    CHECK_NEAR(at(swept).thrown, thrown, 0.01);
  double apart = 1;
  for (const double swept : {6.5, 10.0, 20.0, 45.0, 60.0, 90.0}) {
    const auto row = at(swept);
    CHECK(row.broken / row.thrown > apart);
    apart = row.broken / row.thrown;
  }
}

}  // namespace

int main() {
  gains();
  aliasing();
  breakage_zone();
  acceleration();
  ratios();
  return check::done();
}
