// The torque constant checked by run-ups and run-downs, on programs of a generator of its own
// (classical Runge and Kutta, a Stribeck curve that warms up, its own controller): drifts are found
// with their size, sound programs with cuts, other tools and warming friction raise nothing, a
// heavy tool is told as a step.
#include <cmath>
#include <cstdio>
#include <random>

#include "check.hpp"
#include "sanitized.hpp"
#include "servosense/identify/constant_check.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod = 1e-3;

/// A spindle in a program of tools: run-up, change of speed, cut, run-down, next tool.
struct Program {
  double inertia = 0.01, coulomb = 0.3, stribeck = 0.15, viscous = 5e-4;  // of the machine file
  double friction_warm = 1;  ///< share of the friction at the end
  double warms_s = 60;
  double noise_Nm = 0.05, count_rad = kTwoPi / 65536;
  double limit_Nm = 5, top_rad_s = 600;
  double tool_share = 0.015;  ///< of the inertia, the heaviest tool
  double heavy_from_s = 1e9, heavy_share = 0;
  double drift_from_s = 1e9, drift_over_s = 0, drift = 0;  ///< of the reported effort
  double one_cut_in = 3;                                   ///< run-downs begin in the cut
  unsigned seed = 1;

  static Program random(unsigned seed) {
    std::mt19937_64 bits(seed);
    const auto between = [&](double low, double high) {
      return low * std::pow(high / low, std::uniform_real_distribution<double>(0, 1)(bits));
    };
    Program p;
    p.seed = seed;
    p.inertia = between(0.003, 0.1);
    p.coulomb = p.inertia * between(10, 40);
    p.stribeck = p.coulomb * between(0.05, 0.5);
    p.viscous = p.inertia * between(0.01, 0.08);
    p.top_rad_s = between(300, 1500);
    p.limit_Nm = p.inertia * between(150, 800) + 2 * p.coulomb + p.viscous * p.top_rad_s;
    p.noise_Nm = between(0.002, 0.02) * p.limit_Nm;
    p.count_rad = kTwoPi / std::pow(2.0, std::floor(between(12, 20.99)));
    p.friction_warm = between(0.6, 0.95);
    p.warms_s = between(20, 300);
    p.one_cut_in = between(2, 8);
    return p;
  }

  /// The machine file's: what an idling run of the warm machine shows.
  [[nodiscard]] DisturbanceObserverConfig observer() const {
    DisturbanceObserverConfig c;
    c.sample_period_s = kPeriod;
    c.disturbance_cutoff_rad_s = c.velocity_cutoff_rad_s = 300;
    c.drive.inertia = inertia;
    c.drive.viscous = friction_warm * viscous;
    c.drive.coulomb = friction_warm * coulomb;
    c.drive.friction_knee = std::fmax(1e-3, 4 * count_rad);
    return c;
  }

  /// Hands each sample over: motion and effort as reported.
  template <typename Take>
  void run(double duration_s, Take take) const {
    std::mt19937_64 bits(seed + 5000);
    std::normal_distribution<double> noise(0, noise_Nm);
    std::uniform_real_distribution<double> any(0, 1);
    double angle = 0, w = 0, integral = 0, wanted = 0, load = 0, until = 0, j = inertia;
    int phase = 0;
    std::int64_t last = 0;
    const auto rows = static_cast<long>(duration_s / kPeriod);
    for (long i = 0; i < rows; ++i) {
      const double t = static_cast<double>(i) * kPeriod;
      const double off = std::abs(wanted - w);
      if (t >= until && (phase == 0 ? off > 0.5 : phase % 2 == 1 && off > 0.02 * top_rad_s)) {
        until = t + 1;          // not there yet
      } else if (t >= until) {  // stands, speed, cut, another speed, cut, stands
        phase = (phase + 1) % 5;
        load = 0;
        if (phase == 0) {
          wanted = 0;
          until = t + 1.5 + any(bits);
        } else if (phase == 1 || phase == 3) {
          if (phase == 1)
            j = inertia * (1 + tool_share * any(bits) + (t > heavy_from_s ? heavy_share : 0));
          wanted = top_rad_s * (0.4 + 0.6 * any(bits));
          until = t + 2 + any(bits);
        } else {
          load = limit_Nm * (0.05 + 0.4 * any(bits));
          until = t + 1 + 2 * any(bits);
          if (one_cut_in * any(bits) > 1) until += 0.3;  // leaves the cut before it brakes
        }
      }
      const bool leaving = (phase == 2 || phase == 4) && until - t < 0.3 && one_cut_in > 2;
      const double cut = leaving ? 0 : load * (1 + 0.3 * std::sin(4 * angle));
      const double share = 1 + (friction_warm - 1) * (1 - std::exp(-t / warms_s));
      const double error = wanted - w, gain = inertia * 40;
      const double asked = gain * error + integral;
      const double torque = std::fmin(limit_Nm, std::fmax(-limit_Nm, asked));
      if (torque == asked) integral += gain * 10 * kPeriod * error;
      const auto counts = static_cast<std::int64_t>(std::floor(angle / count_rad));
      DriveSample<double> s;
      s.increment = static_cast<double>(counts - last) * count_rad;
      last = counts;
      const double drifted =
          t < drift_from_s
              ? 0
              : drift * std::fmin(1, (t - drift_from_s + 1e-9) / std::fmax(drift_over_s, 1e-9));
      s.effort = (1 + drifted) * torque + noise(bits);
      take(t, s);
      const auto rate = [&](double at) {
        const double friction = (coulomb + stribeck * std::exp(-at * at / 4)) * std::tanh(at / 0.2);
        return (torque - share * (friction + viscous * at) - (at > 1 ? cut : 0)) / j;
      };
      constexpr int kSteps = 5;
      constexpr double h = kPeriod / kSteps;
      for (int k = 0; k < kSteps; ++k) {
        const double k1 = rate(w), k2 = rate(w + h / 2 * k1), k3 = rate(w + h / 2 * k2),
                     k4 = rate(w + h * k3);
        angle += h * (w + h / 6 * (k1 + k2 + k3));
        w += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
      }
    }
  }
};

struct Heard {
  bool warned = false, stepped = false;
  double at_s = 0, told = 0, error = 0;
  ConstantDrift last;
  std::size_t pairs = 0;
};
Heard hear(const Program& p, double duration_s) {
  ConstantCheck check(p.observer());
  Heard heard;
  p.run(duration_s, [&](double t, const DriveSample<double>& s) {
    check.sample(s, true);
    if (check.pairs() == heard.pairs) return;
    heard.pairs = check.pairs();
    const auto now = check.now();
    if (!now) return;
    heard.last = *now;
    if (now->beyond && now->step) heard.stepped = true;
    if (!now->beyond || now->step || heard.warned) return;
    heard.warned = true;
    heard.at_s = t;
    heard.told = now->drift;
    heard.error = now->standard_error;
  });
  return heard;
}

void sound(unsigned from, unsigned count) {
  unsigned alarms = 0, pairs = 0;
  double worst = 0;
  for (unsigned seed = from; seed < from + count; ++seed) {
    const Heard h = hear(Program::random(seed), 200);
    pairs += static_cast<unsigned>(h.pairs);
    worst = std::fmax(worst, std::abs(h.last.drift));
    if (!h.warned) continue;
    ++alarms;
    std::printf("  seed %u: %+.3f +- %.3f at %.0f s\n", seed, h.told, h.error, h.at_s);
  }
  std::printf("  %u sound programs, %u pairs: %u warned, largest drift at the end %.2f %%\n", count,
              pairs, alarms, 100 * worst);
  CHECK(pairs > 10 * count);
  CHECK(alarms == 0);
}

void drifted(unsigned from, unsigned count, double drift, double over_s, double least_share) {
  unsigned found = 0, within = 0;
  double late = 0;
  for (unsigned seed = from; seed < from + count; ++seed) {
    Program p = Program::random(seed);
    p.drift = seed % 2 == 0 ? drift : -drift;
    p.drift_from_s = over_s > 0 ? 20 : 0;
    p.drift_over_s = over_s;
    const Heard h = hear(p, over_s > 0 ? 320 : 160);
    if (!h.warned || h.at_s < p.drift_from_s) continue;
    ++found;
    late += h.at_s - p.drift_from_s;
    // Tools add up to 1.5 % of the inertia.
    if (std::abs(h.last.drift - p.drift) < 0.02) ++within;
  }
  std::printf("  drift of %.0f %% over %.0f s: %u of %u found, %u within 2 %%, after %.0f s\n",
              100 * drift, over_s, found, count, within, late / found);
  CHECK(found >= least_share * count);
  CHECK(within == found);
}

void heavy_tool(unsigned from, unsigned count) {
  unsigned warned = 0, stepped = 0;
  for (unsigned seed = from; seed < from + count; ++seed) {
    Program p = Program::random(seed);
    p.heavy_from_s = 100;
    p.heavy_share = 0.12;
    const Heard h = hear(p, 240);
    warned += h.warned ? 1 : 0;
    stepped += h.stepped ? 1 : 0;
  }
  std::printf("  a tool of 12 %%: %u of %u told as a step, %u warned\n", stepped, count, warned);
  CHECK(stepped >= 0.9 * count);
  CHECK(warned <= 0.02 * count);
}

/// The drift is not that of the friction: bearings that take a half more are told apart.
void worn_bearing() {
  Program p = Program::random(3);
  p.tool_share = 0;
  const ConstantDrift before = hear(p, 60).last;
  const double more = 0.5 * p.coulomb;
  p.coulomb += more;
  Program file = p;
  file.coulomb -= more;
  ConstantCheck check(file.observer());
  p.run(60, [&](double, const DriveSample<double>& s) { check.sample(s, true); });
  const ConstantDrift after = check.now().value_or(ConstantDrift{});
  CHECK_NEAR(after.drift, before.drift, 0.004);
  CHECK_NEAR((after.friction - before.friction) / more, 1, 0.25);
}

}  // namespace

// `--nightly`: the figures of docs/constants.md.
int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  const unsigned from = nightly ? 801 : 1, count = nightly ? 200 : kSanitized ? 2 : 10;
  sound(from, count);
  drifted(from + 1000, nightly ? 100 : count, 0.05, 0, 0.95);
  drifted(from + 2000, nightly ? 100 : count, 0.05, 150, 0.9);
  heavy_tool(from + 3000, nightly ? 100 : count);
  worn_bearing();
  return check::done();
}
