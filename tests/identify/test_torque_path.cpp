// The bandwidth of the torque path against drives worked out from their equation of motion, whose
// current is reported through a filter, a delay and a rate that are known.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "sanitized.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/torque_path.hpp"

namespace {

using namespace servosense;

/// A spindle under a velocity loop, steps of 12.5 us (Euler, semi-implicit); its torque follows
/// through a current loop, and is reported behind a lag or a moving average, late, and held.
struct Drive {
  double rate_hz = 8000, update_hz = 0;
  double inertia = 0.01, viscous = 1e-3, coulomb = 0.4, most_Nm = 8;
  double loop_hz = 30, current_loop_hz = 600;
  double lag_hz = 0, average_s = 0, delay_s = 0;
  double noise_Nm = 0.03, counts = 1 << 20, top_rad_s = 300;
  double ramp_s = 0;  ///< of the reference; 0: steps, so that the torque meets its limit

  [[nodiscard]] DriveRecord record(double seconds, unsigned seed) const {
    constexpr double h = 12.5e-6;
    std::mt19937_64 bits(seed);
    std::normal_distribution<double> noise(0, noise_Nm);
    const auto every = static_cast<long>(std::lround(1 / (rate_hz * h)));
    const auto late = static_cast<std::size_t>(std::lround(delay_s / h));
    const auto window = static_cast<std::size_t>(std::lround(average_s / h));
    std::deque<double> past(std::max<std::size_t>(late + window + 2, 2), 0.0);
    double angle = 0, w = 0, integral = 0, torque = 0, lag = 0, held = 0, mean = 0, reference = 0;
    double next_update = 0;
    std::int64_t last = 0;
    DriveRecord out{Channel::spindle, 1 / rate_hz, {}};
    const double gain = inertia * kTwoPi * loop_hz;
    const double shares[] = {0.3, 1, -0.5, -1, 0.2, 0.7, -0.8, 0.4, -0.2, 0.9};
    for (long i = 0; static_cast<double>(i) * h < seconds; ++i) {
      const double t = static_cast<double>(i) * h;
      const double aim = top_rad_s * shares[static_cast<std::size_t>(t / 0.8137) % 10];
      const double step = ramp_s > 0 ? top_rad_s / ramp_s * h : 1e9;
      reference += std::clamp(aim - reference, -step, step);
      const double error = reference - w;
      const double asked = std::clamp(gain * error + integral, -most_Nm, most_Nm);
      if (asked == gain * error + integral) integral += gain * 30 * h * error;
      torque += (asked - torque) * -std::expm1(-kTwoPi * current_loop_hz * h);
      w += h * (torque - viscous * w - coulomb * std::tanh(w / 0.2)) / inertia;
      angle += h * w;
      past.push_front(torque);
      if (window > 0) mean += (past[late] - past[late + window]) / static_cast<double>(window);
      past.pop_back();
      const double seen = window > 0 ? mean : past[late];
      lag += lag_hz > 0 ? (seen - lag) * -std::expm1(-kTwoPi * lag_hz * h) : seen - lag;
      if (i % every != 0) continue;
      if (update_hz <= 0 || t >= next_update) {
        held = lag + noise(bits);
        if (update_hz > 0) next_update += 0.9993 / update_hz;
      }
      const auto now = static_cast<std::int64_t>(std::floor(angle / kTwoPi * counts));
      DriveSample<double> s;
      s.increment = static_cast<double>(now - last) * kTwoPi / counts;
      s.position = static_cast<double>(now) * kTwoPi / counts;
      s.effort = held;
      if (i == 0) s.quality = Quality::restarted;
      last = now;
      out.samples.push_back(s);
    }
    return out;
  }
};

struct Case {
  const char* name;
  Drive drive;
};

struct Seen {
  TorquePath path;
  bool identified = false;
};
Seen see(const Drive& d, unsigned seed) {
  DisturbanceObserverConfig c;
  c.sample_period_s = 1 / d.rate_hz;
  c.disturbance_cutoff_rad_s = c.velocity_cutoff_rad_s = std::min(500.0, d.rate_hz);
  c.drive.friction_knee = 1e-3;
  const DriveRecord record = d.record(kSanitized ? 5 : 9, seed);
  IdleOptions options;
  options.knees = {3e-4, 1e-3, 3e-3, 1e-2};
  const auto idle = identify_idle(c, record, options);
  CHECK(idle.has_value());
  if (!idle) {
    std::printf("%s\n", idle.error().sentence.c_str());
    return {};
  }
  return {identify_torque_path(c, *idle, record), true};
}

double true_half_hz(const Drive& d) {
  if (d.lag_hz > 0) return std::sqrt(3.0) * d.lag_hz;
  return d.average_s > 0 ? 0.6034 / d.average_s : 1e9;
}
double true_delay_s(const Drive& d) {
  return d.delay_s + d.average_s / 2 + (d.lag_hz > 0 ? 1 / (kTwoPi * d.lag_hz) : 0);
}

}  // namespace

// `--nightly`: the figures of docs/slow-records.md.
int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  const unsigned from = nightly ? 895001 : 1, seeds = nightly ? 6 : 1;
  const auto with = [](double rate, double lag, double average, double delay, double update = 0) {
    Drive d;
    d.rate_hz = rate;
    d.lag_hz = lag;
    d.average_s = average;
    d.delay_s = delay;
    d.update_hz = update;
    return d;
  };
  const std::vector<Case> cases = {
      {"8 kHz, lag of 100 Hz", with(8000, 100, 0, 0)},
      {"8 kHz, lag of 400 Hz, 0.5 ms", with(8000, 400, 0, 5e-4)},
      {"8 kHz, mean of 4 ms", with(8000, 0, 4e-3, 0)},
      {"8 kHz, lag of 150 Hz, held at 1 kHz", with(8000, 150, 0, 1e-3, 1000)},
      {"1 kHz, lag of 100 Hz, 2 ms", with(1000, 100, 0, 2e-3)},
      {"1 kHz, mean of 8 ms", with(1000, 0, 8e-3, 0)},
      {"250 Hz, lag of 20 Hz", with(250, 20, 0, 0)},
  };
  std::printf("  %-38s %9s %9s %9s %9s\n", "", "half/true", "stated se", "delay ms", "true ms");
  for (const Case& c : cases) {
    unsigned inside = 0, told = 0;
    double worst = 0;
    for (unsigned seed = from; seed < from + seeds; ++seed) {
      const Seen s = see(c.drive, seed);
      if (!s.identified) continue;
      const TorquePath& p = s.path;
      const double half = true_half_hz(c.drive);
      const double off = p.half_to_hz / half - 1;
      const double error = p.filtered() ? p.filter_hz.standard_error / p.filter_hz.value : 0;
      std::printf("  %-38s %9.3f %9.3f %9.3f %9.3f  %s\n", c.name, 1 + off, error,
                  1e3 * p.delay_s.value, 1e3 * true_delay_s(c.drive), p.sentence().c_str());
      CHECK(p.told && p.filtered());
      told += p.filtered();
      // Where the shape of the filter is not told, the one that shows less is stated.
      if (p.shape_told) worst = std::max(worst, std::abs(off));
      CHECK(p.shape_told || (off > -0.45 && off < 0.05));
      inside += std::abs(off) <= 2 * error;
      CHECK_NEAR(p.delay_s.value, true_delay_s(c.drive), 0.6 / c.drive.rate_hz + 2e-4);
    }
    if (c.drive.update_hz > 0) {
      const double update = see(c.drive, from).path.update_hz;
      CHECK_NEAR(update, c.drive.update_hz, 0.01 * c.drive.update_hz);
    }
    std::printf("  %-38s worst %.3f, in two errors %u of %u\n", c.name, worst, inside, told);
    CHECK(worst < 0.15);
  }
  // No filter, and accelerations too soft to tell: said, as a bound that holds.
  Drive bare;
  const TorquePath none = see(bare, from).path;
  std::printf("  %s\n", none.sentence().c_str());
  CHECK(!none.filtered() && none.told && none.half_to_hz > 200);
  Drive soft = with(8000, 200, 0, 0);
  soft.ramp_s = 3;
  soft.noise_Nm = 0.1;
  const TorquePath dull = see(soft, from).path;
  std::printf("  %s\n", dull.sentence().c_str());
  // Seen or not, what is stated must not be more than there is.
  CHECK(dull.told && dull.half_to_hz < 1.05 * true_half_hz(soft));
  CHECK(!dull.filtered() || !dull.shape_told);
  return check::done();
}
