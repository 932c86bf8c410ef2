// Modes from run-ups and run-downs that this test makes itself: modes driven by unbalance and by
// harmonics of it, each integrated by Runge and Kutta in time, read by an encoder of finite counts,
// with noise. Decoys: a smooth rise with the speed, a line of fixed frequency.
// Development seeds: 1 to 9 and, of the sweep, 1000 to 1999, 20261127 and
// 20261200 to 20261299.
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/identify/run_up.hpp"

using namespace servosense;

namespace {

constexpr double kWholeTurn = 6.283185307179586;

struct Swept {
  double f_hz, zeta, per_kg;
};

struct RunUps {
  double rate_hz = 5000, from_hz = 15, to_hz = 90;
  double up_s = 6, stays_s = 0.5, down_s = 8;
  std::vector<double> force = {1, 0.3, 0.2};  // of order 1, 2, 3 at 1 Hz; grows with the square
  double counts = 16384;                      // of the encoder, a turn
  double noise = 0.02;                        // of the highest response
  double mains = 0;                           // amplitude of 50 Hz, of the highest response
  double smooth = 0;  // acceleration of the bed, without resonance: of order 1, with the square
  bool acceleration = true;
};

double turns_at(const RunUps& c, double t) {
  const double up = (c.to_hz - c.from_hz) / c.up_s, down = (c.to_hz - c.from_hz) / c.down_s;
  const double a = std::min(t, c.up_s);
  double turns = c.from_hz * a + up * a * a / 2;
  if (t > c.up_s) turns += c.to_hz * std::min(t - c.up_s, c.stays_s);
  if (const double d = t - c.up_s - c.stays_s; d > 0) turns += c.to_hz * d - down * d * d / 2;
  return turns;
}

double speed_at(const RunUps& c, double t) {
  if (t < c.up_s) return c.from_hz + (c.to_hz - c.from_hz) * t / c.up_s;
  const double d = std::max(0.0, t - c.up_s - c.stays_s);
  return c.to_hz - (c.to_hz - c.from_hz) * d / c.down_s;
}

DecayRecord record_of(const RunUps& c, const std::vector<Swept>& modes, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, 1);
  std::uniform_real_distribution<double> phase(0, kWholeTurn);
  std::vector<double> phases(c.force.size());
  for (double& p : phases) p = phase(random);
  const double mains_phase = phase(random);
  const auto force = [&](double t) {
    const double turns = turns_at(c, t), speed = speed_at(c, t);
    double f = 0;
    for (std::size_t k = 0; k < c.force.size(); ++k)
      f += c.force[k] * speed * speed *
           std::cos(kWholeTurn * static_cast<double>(k + 1) * turns + phases[k]);
    return f;
  };
  const double end_s = c.up_s + c.stays_s + c.down_s, step = 1 / c.rate_hz;
  const auto n = static_cast<std::size_t>(end_s * c.rate_hz);
  DecayRecord r;
  r.name = "run.csv";
  std::vector<double> x(modes.size(), 0), v(modes.size(), 0);
  constexpr int kSub = 2;
  double now = force(0), highest = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double t = static_cast<double>(i) * step;
    double y = c.smooth * now;
    for (std::size_t m = 0; m < modes.size(); ++m) {
      const double w = kWholeTurn * modes[m].f_hz;
      y += c.acceleration ? modes[m].per_kg * now - 2 * modes[m].zeta * w * v[m] - w * w * x[m]
                          : x[m];
    }
    r.t_s.push_back(t);
    r.value.push_back(y);
    r.turns.push_back(std::floor(turns_at(c, t) * c.counts) / c.counts);
    highest = std::max(highest, std::abs(y));
    const double h = step / kSub;
    for (int sub = 0; sub < kSub; ++sub) {
      const double at = t + sub * h, half = force(at + h / 2), next = force(at + h);
      for (std::size_t m = 0; m < modes.size(); ++m) {
        const double w = kWholeTurn * modes[m].f_hz, z2 = 2 * modes[m].zeta * w;
        const auto a = [&](double f, double xx, double vv) {
          return modes[m].per_kg * f - z2 * vv - w * w * xx;
        };
        const double v1 = v[m], a1 = a(now, x[m], v1);
        const double v2 = v[m] + h / 2 * a1, a2 = a(half, x[m] + h / 2 * v1, v2);
        const double v3 = v[m] + h / 2 * a2, a3 = a(half, x[m] + h / 2 * v2, v3);
        const double v4 = v[m] + h * a3, a4 = a(next, x[m] + h * v3, v4);
        x[m] += h / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
        v[m] += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
      }
      now = next;
    }
  }
  if (highest == 0) highest = 1;
  for (std::size_t i = 0; i < n; ++i)
    r.value[i] += highest * (c.noise * normal(random) +
                             c.mains * std::cos(kWholeTurn * 50 * r.t_s[i] + mains_phase));
  return r;
}

Expected<RunUpIdentification> found_in(const RunUps& c, const std::vector<Swept>& modes,
                                       unsigned seed) {
  RunUpOptions options;
  options.highest_order = 6;
  return identify_run_ups(std::vector{record_of(c, modes, seed)}, options);
}

const std::vector<Swept> kTwo = {{62, 0.02, 1}, {131, 0.025, 1.5}};

void finds() {
  RunUps mains, displacement, bed;
  mains.mains = 0.1;
  displacement.acceleration = false;
  bed.smooth = 1;
  unsigned seed = 1;
  for (const RunUps& c : {RunUps{}, mains, displacement, bed}) {
    const auto found = found_in(c, kTwo, seed++);
    CHECK(found && found->sweeps == 2 && found->modes.size() == 2);
    if (!found || found->modes.size() != 2) continue;
    for (std::size_t i = 0; i < 2; ++i) {
      const RunUpMode& m = found->modes[i];
      CHECK_NEAR(m.natural_frequency_hz.value, kTwo[i].f_hz, 2e-3 * kTwo[i].f_hz);
      CHECK_NEAR(m.damping_ratio.value, kTwo[i].zeta, 0.1 * kTwo[i].zeta);
      CHECK_BETWEEN(m.natural_frequency_hz.standard_error, 1e-6 * kTwo[i].f_hz,
                    1e-3 * kTwo[i].f_hz);
      CHECK(m.crossings.size() >= 2);
      for (const ModeCrossing& k : m.crossings) {  // the order is at the mode at that time
        CHECK_NEAR(k.order * speed_at(c, k.at_s), kTwo[i].f_hz, 0.05 * kTwo[i].f_hz);
        CHECK((k.rate_hz_per_s > 0) == (k.at_s < c.up_s + c.stays_s));
        CHECK(k.measured.size() == k.fitted.size() && k.measured.size() == k.frequency_hz.size());
      }
    }
  }
}

/// The peak of a fast sweep stands elsewhere; the mode that is found does not.
void knows_what_the_sweep_does() {
  RunUps c;
  c.up_s = 4, c.down_s = 4, c.noise = 0.005;
  const std::vector<Swept> one = {{62, 0.012, 1}};
  const auto found = found_in(c, one, 5);
  CHECK(found && found->modes.size() == 1);
  if (!found || found->modes.empty()) return;
  bool shifted = false;
  for (const ModeCrossing& k : found->modes[0].crossings) {
    CHECK_NEAR(k.natural_frequency_hz.value, 62, 4 * k.natural_frequency_hz.standard_error + 1e-3);
    const auto top = std::max_element(k.measured.begin(), k.measured.end());
    const double peak_hz = k.frequency_hz[static_cast<std::size_t>(top - k.measured.begin())];
    const double later = (peak_hz - 62) * (k.rate_hz_per_s > 0 ? 1 : -1);
    shifted = shifted || (k.order == 1 && later > 0.012 * 62);
  }
  CHECK(shifted);
}

void refuses() {
  const auto says = [](const RunUps& c, const std::vector<Swept>& modes, const char* what) {
    const auto found = found_in(c, modes, 6);
    CHECK(!found);
    if (!found) CHECK(found.error().sentence.find(what) != std::string::npos);
  };
  RunUps decoys;
  decoys.smooth = 1, decoys.mains = 0.1;
  says({}, {}, "no mode answers");
  says(decoys, {}, "no mode answers");
  RunUps fast;
  fast.up_s = fast.down_s = 0.8, fast.noise = 0.005;
  says(fast, kTwo, "Hz/s of the rotation");
  RunUps steady;
  steady.from_hz = 85;
  says(steady, kTwo, "the speed rises or falls nowhere");
  says({}, {{900, 0.02, 1}}, "no mode answers");
  DecayRecord blind = record_of({}, kTwo, 7);
  blind.turns.clear();
  const auto unknown = identify_run_ups(std::vector{blind});
  CHECK(!unknown && unknown.error().sentence.find("angle of the spindle") != std::string::npos);
}

/// Whether an order crosses the half-power band in more than four turns, half as much again to be
/// sure, and reaches beyond it.
bool slow_enough(const RunUps& c, const Swept& m) {
  const double slower = (c.to_hz - c.from_hz) / std::max(c.up_s, c.down_s);
  for (int order = 1; order <= static_cast<int>(c.force.size()); ++order)
    if (m.f_hz * (1 + 2 * m.zeta) < order * c.to_hz &&
        2 * m.zeta * m.f_hz / (order * slower) > 1.5 * 4 * order / m.f_hz)
      return true;
  return false;
}

/// Machines at random, and decoys without any mode.
void sweep(int machines, unsigned seed) {
  int sought = 0, found_of_sought = 0, seen = 0, extra = 0, sure_extra = 0, decoys = 0,
      false_modes = 0, far_hz = 0;
  int frequency_holds = 0, damping_holds = 0;
  for (int machine = 0; machine < machines; ++machine) {
    std::mt19937_64 random(seed + static_cast<unsigned>(machine));
    const auto between = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    RunUps c;
    c.from_hz = between(10, 20), c.to_hz = between(70, 110);
    c.up_s = between(4, 10), c.down_s = between(4, 10), c.stays_s = between(0, 1);
    c.noise = between(0.005, 0.05), c.counts = machine % 2 ? 4096 : 65536;
    c.force = {1, between(0.1, 0.4), between(0.1, 0.4)};
    c.mains = machine % 3 == 0 ? between(0.02, 0.1) : 0;
    c.acceleration = machine % 5 != 0;
    c.smooth = machine % 2 == 0 && c.acceleration ? between(0, 1) : 0;
    std::vector<Swept> modes;
    if (machine % 4 != 3)
      modes.push_back({between(55, 62), between(0.01, 0.03), between(0.5, 1.5)});
    if (machine % 2 == 0)
      modes.push_back({between(90, 130), between(0.01, 0.03), between(0.5, 1.5)});
    if (modes.empty()) c.smooth = 1;
    const auto found = found_in(c, modes, seed + 1000 + static_cast<unsigned>(machine));
    for (const Swept& t : modes) sought += slow_enough(c, t);
    decoys += modes.empty();
    if (!found) continue;
    std::size_t right = 0;
    for (const Swept& t : modes) {
      const auto m = std::find_if(found->modes.begin(), found->modes.end(), [&](const auto& f) {
        return std::abs(f.natural_frequency_hz.value - t.f_hz) < t.zeta * t.f_hz;
      });
      if (m == found->modes.end()) continue;
      ++right;
      found_of_sought += slow_enough(c, t);
      const double hz_off = std::abs(m->natural_frequency_hz.value - t.f_hz);
      far_hz += hz_off > 0.005 * t.f_hz;
      frequency_holds += hz_off < 1.96 * m->natural_frequency_hz.standard_error;
      damping_holds +=
          std::abs(m->damping_ratio.value - t.zeta) < 1.96 * m->damping_ratio.standard_error;
    }
    seen += static_cast<int>(right);
    if (modes.empty()) false_modes += static_cast<int>(found->modes.size());
    extra += static_cast<int>(found->modes.size() - right);
    for (const RunUpMode& m : found->modes)
      sure_extra +=
          m.doubt.empty() && std::none_of(modes.begin(), modes.end(), [&](const Swept& t) {
            return std::abs(m.natural_frequency_hz.value - t.f_hz) < t.zeta * t.f_hz;
          });
  }
  const auto share = [](int part, int all) { return 100.0 * part / std::max(all, 1); };
  check::figure("modes that an order crosses slowly", sought);
  check::figure("of which found", found_of_sought);
  check::figure("found in all", seen);
  check::figure("frequency farther off than 0.5 %", far_hz);
  check::figure("intervals of frequency hold", share(frequency_holds, seen), "%");
  check::figure("intervals of damping hold", share(damping_holds, seen), "%");
  check::figure("modes too many", extra);
  check::figure("modes too many without a doubt", sure_extra);
  check::figure("decoys", decoys);
  check::figure("modes in decoys", false_modes);
  CHECK(found_of_sought >= 0.95 * sought);
  CHECK(far_hz <= 0.01 * seen);
  CHECK(share(frequency_holds, seen) >= 88);  // 95, less two deviations of 40 draws
  CHECK(share(damping_holds, seen) >= 88);
  CHECK(sure_extra <= 0.01 * machines && extra <= 0.03 * machines);
  CHECK(false_modes == 0);
}

}  // namespace

int main(int argc, char** argv) {
  finds();
  knows_what_the_sweep_does();
  refuses();
  if (check::nightly(argc, argv)) sweep(40, 20261300);
  return check::done();
}
