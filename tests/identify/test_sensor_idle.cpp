// Lines of the machine itself in an idling sensor: those that were put in, at their frequency and
// amplitude, and nothing that turns.
#include <cmath>
#include <cstddef>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/sensor_idle.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod_s = 125e-6;

struct Idle {
  std::vector<double> value, angle;
};

/// Eight seconds at two speeds: multiples of the rotation, a belt at 1.29 of it, noise, and tones.
Idle idle(const std::vector<SensorIdle::Line>& tones, std::uint64_t seed) {
  std::mt19937_64 bits(seed);
  std::normal_distribution<double> gauss;
  Idle out;
  double angle = 0;
  for (std::size_t i = 0; i < 64000; ++i) {
    const double t = static_cast<double>(i) * kPeriod_s;
    angle += rad_s_from_rpm(i < 32000 ? 2200 : 3650) * kPeriod_s;
    double v =
        0.3 * gauss(bits) + 2 * std::cos(angle) + std::cos(4 * angle) + std::cos(1.29 * angle);
    for (const SensorIdle::Line& tone : tones)
      v += tone.amplitude * std::cos(kTwoPi * tone.frequency_hz * t + 1);
    out.value.push_back(v);
    out.angle.push_back(angle);
  }
  return out;
}

void found() {
  const std::vector<SensorIdle::Line> tones = {{431.7, 0.8}, {50, 0.5}, {1203.2, 0.2}};
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Idle run = idle(tones, seed);
    const auto learned = learn_sensor(run.value, run.angle, kPeriod_s);
    CHECK(learned.has_value());
    if (!learned) return;
    CHECK(learned->own_lines.size() == tones.size());
    for (std::size_t i = 0; i < std::min(tones.size(), learned->own_lines.size()); ++i) {
      CHECK_NEAR(learned->own_lines[i].frequency_hz, tones[i].frequency_hz, 0.5);
      CHECK_NEAR(learned->own_lines[i].amplitude, tones[i].amplitude, 0.2 * tones[i].amplitude);
    }
    // Skirts of the multiples add to it.
    CHECK_BETWEEN(learned->noise, 0.27, 0.4);
    CHECK(learned->own_lines_hz(2).size() == 2);
  }
}

void nothing() {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Idle run = idle({}, 100 + seed);
    const auto learned = learn_sensor(run.value, run.angle, kPeriod_s);
    CHECK(learned && learned->own_lines.empty());
  }
  Idle run = idle({}, 1);
  for (std::size_t i = 0; i < run.value.size(); i += 1000) run.value[i] = std::nan("");
  const auto learned = learn_sensor(run.value, run.angle, kPeriod_s);
  CHECK(!learned);
  if (!learned) CHECK(learned.error().sentence.find("without a hole") != std::string::npos);
}

}  // namespace

int main() {
  found();
  nothing();
  return check::done();
}
