// Stable spindle speeds from a decelerating cut: closed forms, simulated cuts, answers that are no.
// With --nightly: tools drawn at random.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/stability_lobes.hpp"
#include "servosense/identify/stable_speeds.hpp"
#include "servosense/sim/gaussian_noise.hpp"
#include "servosense/sim/milling_simulator.hpp"

using namespace servosense;

namespace {

constexpr double kRate = 8000;

// Koike 2016, tables 8-10 and 8-11, chip of 0.0875 mm.
MillingSimulation source_cut(double axial_depth_m = 15e-3) {
  MillingSimulation s;
  s.tool.diameter_m = 10e-3;
  s.tool.teeth = 2;
  s.tool.force.tangential_coefficient_N_per_m2 = 1500e6;
  s.tool.force.radial_ratio = 1.0 / 3;
  s.structure.x = {{2082, 0.018, 0.043}};
  s.structure.y = s.structure.x;
  s.cut = {9000, 0.0875e-3, axial_depth_m, 0.5e-3, MillingDirection::down};
  s.step_s = 4e-6;
  s.layers = 1;
  return s;
}

CuttingTorqueTrace simulate(MillingSimulation s, double from, double to, double rate, double base) {
  s.speed = SpindleSpeedProfile::ramp(from, to, rate, base);
  CuttingTorqueTrace trace;
  trace.sample_rate_hz = kRate;
  auto simulator = MillingSimulator::create(s);
  CHECK(simulator.has_value());
  if (!simulator) return trace;
  const auto done = simulator->run(std::abs(to - from) / (rate / 100 * base), kRate,
                                   Decimation::average, [&](const MillingStep& step) {
                                     trace.torque_Nm.push_back(step.torque_Nm);
                                     trace.spindle_speed_rad_s.push_back(step.spindle_speed_rad_s);
                                   });
  CHECK(done.has_value());
  return trace;
}

CuttingTorqueTrace source_ramp(double rate) {
  return simulate(source_cut(), 9000, 5400, rate, 7200);
}

void add_noise(CuttingTorqueTrace& trace, double rms_Nm, std::uint64_t seed) {
  GaussianNoise noise(seed);
  for (double& t : trace.torque_Nm) t += rms_Nm * noise.next();
}

StableSpeeds stable_speeds(const CuttingTorqueTrace& cut, int teeth = 2) {
  const auto result = identify_stable_speeds(cut, {teeth, 1});
  if (!result) check::fail(__FILE__, __LINE__) << result.error().sentence << '\n';
  CHECK(result.has_value());
  return result ? *result : StableSpeeds{};
}

// One mode in one direction: the pockets of the stability chart.
void closed_form_against_stability_lobes() {
  for (const double damping : {0.01, 0.02, 0.04})
    for (const int teeth : {2, 3, 5})
      for (const auto direction : {MillingDirection::down, MillingDirection::up}) {
        MillingSimulation s = source_cut();
        s.tool.teeth = teeth;
        s.structure.x.clear();
        s.structure.y = {{1500, damping, 0.05}};
        s.cut.direction = direction;
        const auto lobes = StabilityLobes::from_modes(s.structure, s.tool, s.cut);
        CHECK(lobes.has_value());
        if (!lobes) continue;
        const double base = 60.0 * 1500 / teeth;
        const auto pockets = lobes->pockets(base / 9.5, base / 2.5);
        CHECK(pockets.size() >= 5);
        for (const StabilityPocket& p : pockets) {
          const bool above = p.chatter_frequency_below_hz > 1500;
          const int waves =
              static_cast<int>(std::lround(base / p.spindle_speed_rpm + (above ? 0.12 : -0.12)));
          const double speed = single_mode_pocket_rpm(1500, damping, teeth, waves, above);
          CHECK_NEAR(speed / p.spindle_speed_rpm, 1, 1e-6);
        }
      }
}

// Chatter that obeys the limit of one mode exactly, carried by sidebands, over forced vibration.
void chatter_made_by_the_formula() {
  const double fn = 1200, zeta = 0.02;
  const int teeth = 3;
  CuttingTorqueTrace cut;
  double tooth = 0, phase = 0;
  for (int i = 0; i < 12000; ++i) {
    const double rpm = 5000 - 2200 * i / 12000.0;
    const double period = 60 / (teeth * rpm);
    // The lobe of the least limit depth, x + 1/x, x the detuning over the half width.
    double best = 1e300, frequency = 0;
    for (int k = 1; k < 20; ++k) {
      double low = 1e-6, high = kPi / 2 - 1e-6;  // of arg lambda, f rises as it falls
      auto excess = [&](double h) {
        const double x = zeta / std::tan(h);
        return fn * (x + std::hypot(1, x)) * period - (k + 0.5 + h / kPi);
      };
      if (excess(low) < 0 || excess(high) > 0) continue;
      for (int n = 0; n < 60; ++n) {
        const double h = (low + high) / 2;
        (excess(h) > 0 ? low : high) = h;
      }
      const double x = 1 / std::tan(low);
      if (x + 1 / x < best) {
        best = x + 1 / x;
        frequency = fn * (zeta * x + std::hypot(1, zeta * x));
      }
    }
    tooth += kTwoPi / (period * kRate);
    phase += kTwoPi * frequency / kRate;
    cut.torque_Nm.push_back(2 + std::cos(tooth) + 0.5 * std::cos(2 * tooth + 1) +
                            0.3 * std::cos(tooth / 3) +
                            0.2 * std::cos(phase) * (1 + 0.7 * std::cos(tooth + 0.4)));
    cut.spindle_speed_rad_s.push_back(rad_s_from_rpm(rpm));
  }
  const StableSpeeds found = stable_speeds(cut, teeth);
  CHECK(found.verdict == StableSpeedVerdict::found);
  // Phase of the formula is stationary, the sweep is not: half a per mille of frequency.
  CHECK_NEAR(found.natural_frequency_hz, fn, 3);
  CHECK_NEAR(found.damping_ratio, zeta, 0.003);
  CHECK(found.pockets.size() >= 3);
  for (const StableSpeed& p : found.pockets)
    CHECK_NEAR(p.spindle_speed_rpm, single_mode_pocket_rpm(fn, zeta, teeth, p.waves, true), 15);
}

const double kPockets[] = {5747, 6321, 7023, 7900};  // Koike's tool, koike 2016 fig. 8-30

double worst_error(const StableSpeeds& found) {
  CHECK(found.verdict == StableSpeedVerdict::found);
  CHECK(found.pockets.size() == 4);
  if (found.pockets.size() != 4) return 1e9;
  double worst = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const double error = found.pockets[i].spindle_speed_rpm - kPockets[i];
    if (std::abs(error) > std::abs(worst)) worst = error;
  }
  return worst;
}

void the_source_cut_at_four_rates() {
  std::vector<CuttingTorqueTrace> cuts;
  for (const double rate : {15.0, 30.0, 50.0, 75.0}) {
    cuts.push_back(source_ramp(rate));
    const StableSpeeds found = stable_speeds(cuts.back());
    const double error = worst_error(found);
    CHECK_NEAR(error, 0, 30);
    check::figure("worst pocket at " + std::to_string(static_cast<int>(rate)) + " %/s", error,
                  "rpm");
    // The source's minima are late, so the correction has something to correct.
    for (const StableSpeed& p : found.pockets)
      if (std::isfinite(p.minimum_rpm))
        CHECK_BETWEEN(p.minimum_rpm - p.spindle_speed_rpm, -450, 60);
  }
  for (const auto& [a, b] : {std::pair{0, 2}, std::pair{1, 3}}) {
    const std::vector<CuttingTorqueTrace> two = {cuts[static_cast<std::size_t>(a)],
                                                 cuts[static_cast<std::size_t>(b)]};
    const auto found = identify_stable_speeds(two, {2, 1});
    CHECK(found.has_value());
    if (!found) continue;
    const double error = worst_error(*found);
    CHECK_NEAR(error, 0, 30);
    check::figure("worst pocket of two cuts", error, "rpm");
  }
}

void repeats_under_noise() {
  const CuttingTorqueTrace clean = source_ramp(30);
  std::vector<double> low(4, 1e9), high(4, 0);
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    CuttingTorqueTrace cut = clean;
    add_noise(cut, 0.02, seed);  // 2 % of the torque's standard deviation
    const StableSpeeds found = stable_speeds(cut);
    if (found.pockets.size() != 4) {
      check::fail(__FILE__, __LINE__) << "seed " << seed << ": " << found.sentence << '\n';
      continue;
    }
    for (std::size_t i = 0; i < 4; ++i) {
      low[i] = std::min(low[i], found.pockets[i].spindle_speed_rpm);
      high[i] = std::max(high[i], found.pockets[i].spindle_speed_rpm);
    }
  }
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK_BETWEEN(high[i] - low[i], 0, 40);
    check::figure("spread over 20 seeds", high[i] - low[i], "rpm");
  }
}

// Whatever repeats with the spindle has no influence.
void run_out_does_not_matter() {
  const CuttingTorqueTrace clean = source_ramp(50);
  CuttingTorqueTrace cut = clean;
  double angle = 0;
  for (std::size_t i = 0; i < cut.torque_Nm.size(); ++i) {
    cut.torque_Nm[i] += 0.8 * std::cos(angle) + 0.4 * std::cos(3 * angle + 1);
    angle += cut.spindle_speed_rad_s[i] / kRate;
  }
  const StableSpeeds with = stable_speeds(cut), without = stable_speeds(clean);
  CHECK(with.pockets.size() == without.pockets.size());
  // A larger forced torque raises the level below which chatter is not counted.
  for (std::size_t i = 0; i < std::min(with.pockets.size(), without.pockets.size()); ++i)
    CHECK_NEAR(with.pockets[i].spindle_speed_rpm, without.pockets[i].spindle_speed_rpm, 20);
}

void answers_that_are_no() {
  const StableSpeeds rising = stable_speeds(simulate(source_cut(), 5400, 9000, 50, 7200));
  const double rising_error = worst_error(rising);
  CHECK_NEAR(rising_error, 0, 30);
  check::figure("worst pocket, speed rising", rising_error, "rpm");

  // 3 mm is stable at every speed (limit 4.75 mm).
  CuttingTorqueTrace stable = simulate(source_cut(3e-3), 9000, 5400, 50, 7200);
  const StableSpeeds quiet = stable_speeds(stable);
  CHECK(quiet.sentence.find("would have been seen") != std::string::npos);
  CHECK(quiet.verdict == StableSpeedVerdict::insufficient_chatter);
  CHECK(quiet.pockets.empty());
  CHECK(quiet.minima.front().empty());
  // Noise as large as the cut hides what would have been seen: no word of a deeper cut.
  add_noise(stable, 0.05, 3);
  const StableSpeeds noisy = stable_speeds(stable);
  CHECK(noisy.verdict == StableSpeedVerdict::hidden);
  CHECK(noisy.sentence.find("deeper") == std::string::npos);

  CuttingTorqueTrace cut = source_ramp(75);
  CHECK(!identify_stable_speeds(cut, {0, 1}));
  CHECK(!identify_stable_speeds(cut, {40, 1}));  // fewer than 8 samples a tooth
  CuttingTorqueTrace bad = cut;
  bad.torque_Nm[100] = std::nan("");
  CHECK(!identify_stable_speeds(bad, {2, 1}));
  bad = cut;
  bad.torque_Nm.pop_back();
  CHECK(!identify_stable_speeds(bad, {2, 1}));
  bad = cut;
  std::fill(bad.spindle_speed_rad_s.begin(), bad.spindle_speed_rad_s.end(), 800.0);
  CHECK(!identify_stable_speeds(bad, {2, 1}));
  CHECK(!identify_stable_speeds(std::span<const CuttingTorqueTrace>{}, {2, 1}));
}

// Tools drawn at random: how often there is an answer, and how often it is right.
void random_tools(int count) {
  int asked = 0, found = 0, within_1 = 0, within_2 = 0;
  std::vector<double> errors;
  int speeds = 0, covered = 0;
  for (int seed = 1; seed <= count; ++seed) {
    GaussianNoise draw(static_cast<std::uint64_t>(seed));
    const auto between = [&](double a, double b) { return a + (b - a) * draw.uniform(); };
    MillingSimulation s = source_cut();
    s.tool.teeth = draw.uniform() < 0.5 ? 2 : 3;
    const double fn = between(500, 2000), zeta = between(0.01, 0.04);
    const double mass = 0.043 * (2082 / fn) * (2082 / fn) * between(0.7, 1.4);
    s.structure.x = {{fn, zeta, mass}};
    s.structure.y = {{draw.uniform() < 0.5 ? fn : fn * between(0.9, 1.1), zeta, mass}};
    s.cut.radial_immersion_m = between(0.5e-3, 2.5e-3);
    const auto lobes = StabilityLobes::from_modes(s.structure, s.tool, s.cut);
    if (!lobes) continue;
    s.cut.axial_depth_m = 3 * lobes->minimum().axial_depth_m;  // as deep as the source's cut
    const double base = 60 * fn / s.tool.teeth / between(5, 11), width = between(0.2, 0.3);
    const double rates[] = {15, 30, 50, 75};
    const double rate = rates[static_cast<int>(4 * draw.uniform())];
    s.speed = SpindleSpeedProfile::ramp(base * (1 + width), base * (1 - width), rate, base);
    s.cut.spindle_speed_rpm = base;
    auto simulator = MillingSimulator::create(s);
    if (!simulator) continue;
    CuttingTorqueTrace cut;
    if (!simulator->run(2 * width / (rate / 100), kRate, Decimation::average,
                        [&](const MillingStep& step) {
                          cut.torque_Nm.push_back(step.torque_Nm);
                          cut.spindle_speed_rad_s.push_back(step.spindle_speed_rad_s);
                        }))
      continue;  // tool lost
    ++asked;
    const auto result = identify_stable_speeds(cut, {s.tool.teeth, 1});
    if (!result || result->verdict != StableSpeedVerdict::found || result->pockets.empty())
      continue;
    ++found;
    const auto truth = lobes->pockets(base * (0.9 - width), base * (1.1 + width));
    std::vector<double> error;
    for (const StableSpeed& p : result->pockets) {
      double nearest = 1;
      for (const StabilityPocket& t : truth)
        nearest = std::min(nearest, std::abs(p.spindle_speed_rpm / t.spindle_speed_rpm - 1));
      error.push_back(nearest);
    }
    const double worst = *std::max_element(error.begin(), error.end());
    errors.push_back(worst);
    for (std::size_t i = 0; i < error.size(); ++i) {
      ++speeds;
      const StableSpeed& p = result->pockets[i];
      covered += error[i] * p.spindle_speed_rpm < p.uncertainty_rpm;
    }
    within_1 += worst < 0.01;
    within_2 += worst < 0.02;
  }
  std::sort(errors.begin(), errors.end());
  check::figure("random tools: cuts", asked);
  check::figure("answered", found);
  check::figure("speeds", speeds);
  check::figure("within their uncertainty", covered);
  check::figure("worst pocket within 1 %", within_1);
  check::figure("worst pocket within 2 %", within_2);
  CHECK(!errors.empty());
  if (errors.empty()) return;
  check::figure("median of the worst pocket", 100 * errors[errors.size() / 2], "%");
  // Neighbouring pockets are 1/K apart, 9 to 20 %: chance would put two in ten within 2 %.
  CHECK(found * 2 > asked);
  CHECK(within_2 * 10 > 8 * found);
  CHECK(errors[errors.size() / 2] < 0.01);
}

}  // namespace

int main(int argc, char** argv) {
  closed_form_against_stability_lobes();
  chatter_made_by_the_formula();
  the_source_cut_at_four_rates();
  repeats_under_noise();
  run_out_does_not_matter();
  answers_that_are_no();
  const bool nightly = check::nightly(argc, argv);
  random_tools(nightly ? 300 : 12);
  return check::done();
}
