// Spindles whose torque per ampere falls with current, by the program alone: run-ups at different
// currents show from which current on and how much, a step of torque is then read right; where
// nothing falls nothing is found, and where the currents are too much alike the program says so.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "oracles/weakened_spindle.hpp"
#include "program.hpp"
#include "sanitized.hpp"
#include "spindle_records.hpp"

using namespace program_test;
using namespace spindle_records;
using oracle::WeakenedSpindle;

namespace {

/// Saturates by 15 to 40 % beyond 0.35 to 0.65 of what its drive gives.
WeakenedSpindle saturated(unsigned seed) {
  WeakenedSpindle s = WeakenedSpindle::random(seed);
  std::mt19937_64 bits(seed + 9);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(bits);
  };
  s.base_rad_s = 1e9;
  s.knee_A = between(0.35, 0.65) * s.limit_A;
  s.share_lost = between(0.15, 0.4);
  return s;
}

/// Both ways between speeds, each ramp in a time of its own: `hardest` of what the limit gives, and
/// shares of that.
void write_ramps(const WeakenedSpindle& s, double top, double hardest, bool alike, unsigned seed) {
  constexpr double kSpeeds[] = {0, 0.6, 0.2, 0.9, -0.3, -1, -0.1, 0.8, 0.3};
  constexpr double kShares[] = {1, 0.35, 0.75, 0.5, 0.9, 0.4, 0.6, 1};
  constexpr double kDwell_s = 0.4;
  const double most = hardest * (s.torque(s.limit_A, 0) - s.coulomb - s.viscous * top) / s.inertia;
  std::vector<double> ends, rates;
  double t = kDwell_s;
  for (std::size_t k = 0; k + 1 < std::size(kSpeeds); ++k) {
    rates.push_back(most * (alike ? 1 : kShares[k]));
    ends.push_back(t);
    t += top * std::abs(kSpeeds[k + 1] - kSpeeds[k]) / rates.back() + kDwell_s;
  }
  write_trace(
      s, "idle.csv", t,
      [&](double now) {
        double speed = 0;
        for (std::size_t k = 0; k < ends.size(); ++k) {
          const double step = top * (kSpeeds[k + 1] - kSpeeds[k]);
          const double gone = rates[k] * std::fmax(0, now - ends[k]);
          speed += std::copysign(std::fmin(std::abs(step), gone), step);
        }
        return speed;
      },
      [](double) { return 0.0; }, seed);
}

Outcome learn() {
  return run("identify idle --machine machine.ini --trace idle.csv --out learned.ini --json");
}

const std::string kEffect = "effect.spindle.torque-saturation";

double error_of(const Outcome& o, const std::string& key) {
  const std::size_t at = o.out.find("\"standard_error\": ", o.out.find("\"" + key + "\""));
  return at == std::string::npos ? 0 : std::stod(o.out.substr(at + 18));
}

/// A step of torque that takes 0.9 of the limit's current, as the monitors read it.
double step_read(const WeakenedSpindle& s, unsigned seed) {
  const double speed = 0.3 * s.top_rad_s;
  const double load = s.torque(0.9 * s.limit_A, speed) - s.coulomb - s.viscous * speed;
  write_trace(
      s, "cut.csv", kStepAt_s + 3, [&](double) { return speed; },
      [&](double t) { return t > kStepAt_s ? load : 0.0; }, seed);
  const Outcome o = run("monitor --machine learned.ini --trace cut.csv --estimates e.csv --json");
  that(o.status == 0, o, "monitors", __LINE__);
  return read_step("e.csv").step / load;
}

void found(const WeakenedSpindle& s, unsigned seed, double tolerance) {
  write_machine(s);
  write_ramps(s, s.base_rad_s < 1e8 ? s.top_rad_s : 0.8 * s.top_rad_s, 0.95, false, seed);
  const Outcome learned = learn();
  that(learned.status == 0, learned, "identifies", __LINE__);
  const auto inertia = value_of("learned.ini", "spindle", "inertia_kg_m2");
  const auto knee = value_of("learned.ini", kEffect, "knee_current_A");
  const auto lost = value_of("learned.ini", kEffect, "share_lost");
  that(inertia && knee && lost, learned, "finds saturation", __LINE__);
  if (!(inertia && knee && lost)) return;
  const double step = step_read(s, seed + 1000);
  const double pull_knee = (*knee - s.knee_A) / error_of(learned, "knee_current_A"),
               pull_lost = (*lost - s.share_lost) / error_of(learned, "share_lost");
  std::printf(
      "  seed %u: knee %.3f A %+.2f %% (%+.1f errors), share %.3f %+.2f %% (%+.1f), J %+.2f %%, "
      "step %+.2f %%%s\n",
      seed, s.knee_A, 100 * (*knee / s.knee_A - 1), pull_knee, s.share_lost,
      100 * (*lost / s.share_lost - 1), pull_lost, 100 * (*inertia / s.inertia - 1),
      100 * (step - 1), s.base_rad_s < 1e8 ? ", field weakened" : "");
  CHECK_NEAR(*knee / s.knee_A, 1, 2 * tolerance);
  CHECK_NEAR(*lost / s.share_lost, 1, 2 * tolerance);
  CHECK_NEAR(*inertia / s.inertia, 1, tolerance);
  CHECK_NEAR(step, 1, tolerance);
  // Stated errors hold: four of them, as often as one in 16000.
  CHECK(std::abs(pull_knee) < 4 && std::abs(pull_lost) < 4);
  const bool weakened = contains(content(folder / "learned.ini"), "field-weakening");
  CHECK(weakened == (s.base_rad_s < 1e8));
}

/// Both at once: beyond base speed the field is weakened.
WeakenedSpindle with_weakening(unsigned seed) {
  WeakenedSpindle s = saturated(seed);
  s.base_rad_s = s.top_rad_s / 2;
  return s;
}

/// i / sqrt(1 + (i/soft)^2) has no knee; one stands for it as well as it can.
void soft(unsigned seed, double tolerance) {
  WeakenedSpindle s = saturated(seed);
  s.knee_A = 1e9;
  s.soft_A = 1.2 * s.limit_A;
  write_machine(s);
  write_ramps(s, 0.8 * s.top_rad_s, 0.95, false, seed);
  const Outcome learned = learn();
  that(contains(content(folder / "learned.ini"), kEffect), learned, "finds saturation", __LINE__);
  const double step = step_read(s, seed + 1000);
  std::printf("  soft, seed %u: step %+.2f %%\n", seed, 100 * (step - 1));
  CHECK_NEAR(step, 1, tolerance);
}

/// What does not saturate but might look it.
struct Decoy {
  const char* name;
  std::function<void(WeakenedSpindle&)> change;
};
const Decoy kDecoys[] = {
    {"constant", [](WeakenedSpindle&) {}},
    {"noise", [](WeakenedSpindle& s) { s.noise_A = 0.08 * s.limit_A; }},
    {"windage", [](WeakenedSpindle& s) { s.drag = 4 * s.coulomb / s.top_rad_s / s.top_rad_s; }},
    {"viscous", [](WeakenedSpindle& s) { s.viscous *= 5; }},
    {"weakening", [](WeakenedSpindle& s) { s.base_rad_s = s.top_rad_s / 2.5; }},
    {"soft weakening",
     [](WeakenedSpindle& s) { s.base_rad_s = s.top_rad_s / 2.5, s.smooth = true; }},
    {"coarse encoder", [](WeakenedSpindle& s) { s.counts = 2048; }},
};

void none(const Decoy& decoy, unsigned seed) {
  WeakenedSpindle s = saturated(seed);
  s.knee_A = 1e9;
  decoy.change(s);
  write_machine(s);
  write_ramps(s, 0.8 * s.top_rad_s, 0.95, false, seed);
  const Outcome learned = learn();
  that(learned.status == 0, learned, "identifies", __LINE__);
  const bool is_found = contains(content(folder / "learned.ini"), kEffect);
  const std::size_t at = learned.out.find("torque_constant_seen_to_A");
  std::printf("  %s, seed %u: %s, seen to %.3g of the limit\n", decoy.name, seed,
              is_found ? "FOUND" : "none",
              at == std::string::npos ? -1 : std::stod(learned.out.substr(at + 28)) / s.limit_A);
  that(!is_found, learned, decoy.name, __LINE__);
}

/// All ramps alike under much noise: it is not denied. Either the program says that it is not told,
/// or what it finds holds within the errors that it states.
void hardly_told(unsigned seed) {
  WeakenedSpindle s = saturated(seed);
  s.noise_A = 0.15 * s.limit_A;
  write_machine(s);
  write_ramps(s, 0.8 * s.top_rad_s, 0.95, true, seed);
  const Outcome learned = learn();
  that(learned.status == 0, learned, "identifies", __LINE__);
  const auto knee = value_of("learned.ini", kEffect, "knee_current_A");
  const auto lost = value_of("learned.ini", kEffect, "share_lost");
  const auto inertia = value_of("learned.ini", "spindle", "inertia_kg_m2");
  const bool is_found = knee && lost && inertia;
  that(contains(learned.out, "currents too much alike") != is_found, learned, "says so", __LINE__);
  if (!is_found) {
    std::printf("  hardly told, seed %u: said so\n", seed);
    return;
  }
  const double pulls[] = {(*knee - s.knee_A) / error_of(learned, "knee_current_A"),
                          (*lost - s.share_lost) / error_of(learned, "share_lost"),
                          (*inertia - s.inertia) / error_of(learned, "inertia_kg_m2")};
  std::printf(
      "  hardly told, seed %u: found; knee %+.1f, share %+.1f, J %+.1f errors, J %+.2f %%\n", seed,
      pulls[0], pulls[1], pulls[2], 100 * (*inertia / s.inertia - 1));
  for (const double pull : pulls) CHECK(std::abs(pull) < 4);
}

/// Ramps that stay below the knee: nothing is said of what lies beyond.
void gentle(unsigned seed) {
  const WeakenedSpindle s = saturated(seed);
  write_machine(s);
  const double friction = (s.coulomb + 0.8 * s.viscous * s.top_rad_s) / s.constant;
  const double hardest = (0.9 * s.knee_A - friction) / (s.limit_A - friction);
  write_ramps(s, 0.8 * s.top_rad_s, hardest, false, seed);
  const Outcome learned = learn();
  that(learned.status == 0, learned, "identifies", __LINE__);
  that(!contains(content(folder / "learned.ini"), kEffect), learned, "finds nothing", __LINE__);
  const std::string key = "\"torque_constant_seen_to_A\": ";
  const std::size_t at = learned.out.find(key);
  that(at != std::string::npos, learned, "says up to which current", __LINE__);
  if (at == std::string::npos) return;
  const double seen = std::stod(learned.out.substr(at + key.size()));
  std::printf("  gentle, seed %u: seen to %.3g A, knee %.3g A\n", seed, seen, s.knee_A);
  CHECK_BETWEEN(seen, 0.5 * s.knee_A, s.knee_A);
}

}  // namespace

// `--nightly`: the figures of docs/identify-idle.md; of other seeds with the first and how many
// behind it.
int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  return in_own_folder("torque_saturation", [&] {
    const auto given = [&](int at, unsigned otherwise) {
      return argc > at ? static_cast<unsigned>(std::atoi(argv[at])) : otherwise;
    };
    const unsigned from = given(2, 811), count = given(3, 12);
    if (nightly) {
      for (unsigned seed = from; seed < from + count; ++seed) {
        found(saturated(seed), seed, 0.01);
        found(with_weakening(seed + 100), seed + 100, 0.01);
        soft(seed + 200, 0.08);
        none(kDecoys[seed % std::size(kDecoys)], seed + 300);
        none(kDecoys[(seed + 3) % std::size(kDecoys)], seed + 400);
        gentle(seed + 500);
        hardly_told(seed + 600);
      }
      return;
    }
    found(saturated(1), 1, 0.01);
    if (kSanitized) return;
    none(kDecoys[4], 1);
    hardly_told(1);
  });
}
