// The line of chatter: known tones among harmonics and noise, and milling that is told a better
// speed.
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/chatter_frequency.hpp"
#include "servosense/identify/stability_lobes.hpp"
#include "servosense/sim/milling_simulator.hpp"

using namespace servosense;

namespace {

struct Signal {
  std::vector<double> torque_Nm, angle_rad;
};

Signal tones(std::uint64_t seed, double speed_rpm, double frequency_hz, double amplitude,
             double noise, std::size_t samples) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> gauss(0, 1);
  std::uniform_real_distribution<double> phase(0, kTwoPi);
  Signal s;
  double start = phase(random), tone = phase(random);
  double harmonic[11], shift[11];
  for (int h = 1; h <= 10; ++h) harmonic[h] = gauss(random), shift[h] = phase(random);
  for (std::size_t i = 0; i < samples; ++i) {
    const double t = static_cast<double>(i) * 125e-6;
    const double angle = start + rad_s_from_rpm(speed_rpm) * t;
    double y = 2 + noise * gauss(random) + amplitude * std::sin(kTwoPi * frequency_hz * t + tone);
    for (int h = 1; h <= 10; ++h) y += harmonic[h] * std::sin(h * angle + shift[h]);
    s.torque_Nm.push_back(y);
    s.angle_rad.push_back(std::fmod(angle, kTwoPi));
  }
  return s;
}

void known_tones() {
  std::mt19937_64 random(99);
  std::uniform_real_distribution<double> speed(3000, 12000), frequency(300, 3500);
  double worst_hz = 0, worst_share = 0;
  unsigned tried = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    const double rpm = speed(random), hz = frequency(random);
    // Near a harmonic it is forced vibration, and least squares takes part of it away.
    const double turns = hz / (rpm / 60);
    if (turns < 10.5 && std::abs(turns - std::round(turns)) < 0.15) continue;
    ++tried;
    // Cramer and Rao: 8 Nm2 of noise power per... a tone of 1 Nm in 0.3 Nm of noise over 1024
    // samples can be placed to sqrt(24) 0.3 / (2 pi T N^1.5) = 0.06 Hz; Hann and two bins lose
    // a factor of 3, and the extreme of 200 is 3.5 sigma.
    const Signal s = tones(seed, rpm, hz, 1, 0.3, 1024);
    const auto line = chatter_line(s.torque_Nm, s.angle_rad, {});
    CHECK(line.has_value());
    if (!line) continue;
    CHECK_NEAR(line->spindle_speed_rpm, rpm, 1e-6 * rpm);
    worst_hz = std::max(worst_hz, std::abs(line->frequency_hz - hz));
    worst_share = std::max(worst_share, std::abs(line->share - 0.5 / 0.59));
  }
  CHECK(tried > 150);
  CHECK_BETWEEN(worst_hz, 0.05, 0.9);
  CHECK_BETWEEN(worst_share, 0.005, 0.12);
  check::figure("worst error of a tone in noise, 128 ms", worst_hz, "Hz");

  // Noise and harmonics alone: no line. Of 500 lines the highest is ln 500 = 6.2 times the mean, so
  // 8 dB is passed by chance in about two of three records: the share tells.
  unsigned strong = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    const Signal s = tones(seed, 7000, 800, 0, 0.3, 1024);
    const auto line = chatter_line(s.torque_Nm, s.angle_rad, {});
    strong += line && line->share > 0.1;
  }
  CHECK(strong == 0);
}

void observer_and_comb() {
  // Two lines; behind the observer the lower one is larger, before it the upper one was.
  ChatterLineConfig c;
  c.disturbance_cutoff_rad_s = c.velocity_cutoff_rad_s = 3500;
  const auto gain = [](double hz) { return 1 / (1 + std::pow(kTwoPi * hz / 3500, 2)); };
  Signal s = tones(5, 7300, 850, 1.0 * gain(850), 0, 2048);
  const Signal upper = tones(6, 7300, 1836, 1.6 * gain(1836), 0, 2048);
  for (std::size_t i = 0; i < 2048; ++i) s.torque_Nm[i] += upper.torque_Nm[i];
  const auto line = chatter_line(s.torque_Nm, s.angle_rad, c);
  CHECK(line.has_value());
  if (line) CHECK_NEAR(line->seen_hz, 1836, 0.5);
  // A natural frequency moves it along the comb of teeth: 7300 rpm, two teeth: 243.33 Hz.
  c.teeth = 2;
  c.natural_frequencies_hz = {2300};
  const auto placed = chatter_line(s.torque_Nm, s.angle_rad, c);
  CHECK(placed.has_value());
  if (placed) CHECK_NEAR(placed->frequency_hz, 1836 + 2 * 7300 / 30.0, 0.5);
}

void bad_input() {
  Signal s = tones(5, 7300, 850, 1, 0.1, 1024);
  CHECK(!chatter_line({}, {}, {}));
  CHECK(!chatter_line(s.torque_Nm, std::span(s.angle_rad).first(100), {}));
  s.torque_Nm[3] = std::nan("");
  CHECK(!chatter_line(s.torque_Nm, s.angle_rad, {}));
  const std::vector<double> zeros(512, 0.0);
  CHECK(!chatter_line(zeros, zeros, {}));
  CHECK(quiet_speeds_rpm(2000, 0, 1000, 9000).empty());
  CHECK(quiet_speeds_rpm(0, 2, 1000, 9000).empty());
}

void speeds_by_hand() {
  // 2000 Hz, 4 teeth: 30000 / k.
  const auto speeds = quiet_speeds_rpm(2000, 4, 7000, 16000);
  CHECK(speeds.size() == 3);
  const double expected[] = {7500, 10000, 15000};
  for (std::size_t i = 0; i < speeds.size(); ++i) CHECK_NEAR(speeds[i], expected[i], 1e-9);
}

/// Chattering cuts drawn at random: the line is the lobes' chatter frequency, and at the suggested
/// speed the stable depth is greater than at the speed that chattered.
void milling() {
  std::mt19937_64 random(2024);
  auto between = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  unsigned cuts = 0, found = 0, better = 0;
  while (cuts < 12) {
    MillingSimulation m;
    m.tool.diameter_m = 0.012;
    m.tool.teeth = 2 + static_cast<int>(random() % 3);
    m.tool.force = {.tangential_coefficient_N_per_m2 = 8e8, .radial_ratio = 0.3};
    const double natural_hz = between(700, 1600);
    m.structure.y = m.structure.x = {{natural_hz, between(0.02, 0.04), 0.3}};
    m.cut.direction = MillingDirection::slot;
    m.cut.feed_per_tooth_m = 8e-5;
    m.cut.spindle_speed_rpm = between(0.1, 0.3) * 60 * natural_hz / m.tool.teeth;
    const auto lobes = StabilityLobes::from_modes(m.structure, m.tool, m.cut);
    CHECK(lobes.has_value());
    if (!lobes) return;
    const LobePoint limit = lobes->limit_at(m.cut.spindle_speed_rpm);
    if (!(limit.axial_depth_m < 2.5 * lobes->minimum().axial_depth_m)) continue;
    ++cuts;
    m.cut.axial_depth_m = 1.4 * limit.axial_depth_m;
    m.layers = 1;
    m.step_s = 1e-5;
    auto simulator = MillingSimulator::create(m);
    CHECK(simulator.has_value());
    if (!simulator) return;
    const auto steps = simulator->run(0.6, 8000);
    CHECK(steps.has_value());
    if (!steps) return;
    Signal s;
    for (std::size_t i = steps->size() - 1600; i < steps->size(); ++i) {
      s.torque_Nm.push_back((*steps)[i].torque_Nm);
      s.angle_rad.push_back((*steps)[i].angle_rad);
    }
    ChatterLineConfig c;
    c.harmonics = 20;
    c.teeth = static_cast<unsigned>(m.tool.teeth);
    c.natural_frequencies_hz = {natural_hz};
    const auto line = chatter_line(s.torque_Nm, s.angle_rad, c);
    if (!line) continue;
    found += std::abs(line->frequency_hz / limit.chatter_frequency_hz - 1) < 0.03;
    const auto speeds = quiet_speeds_rpm(line->frequency_hz, c.teeth, 0.6 * m.cut.spindle_speed_rpm,
                                         1.6 * m.cut.spindle_speed_rpm);
    double best = 0;
    for (const double rpm : speeds) best = std::max(best, lobes->limit_at(rpm).axial_depth_m);
    better += best > m.cut.axial_depth_m;
  }
  check::figure("of 12 chattering cuts, frequency within 3 %", found);
  check::figure("of 12 chattering cuts, stable at a suggested speed", better);
  CHECK_BETWEEN(found, 11, 12);
  CHECK_BETWEEN(better, 9, 12);
}

}  // namespace

int main() {
  known_tones();
  observer_and_comb();
  bad_input();
  speeds_by_hand();
  milling();
  return check::done();
}
