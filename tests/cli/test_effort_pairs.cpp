// A drive that reports its current and its torque or its power, by the program alone: an idling run
// learns the noise of both and what is lost of a power, the mean that is taken then is quieter than
// either, and what does not agree is said, by both commands, and not averaged.
#include <cmath>
#include <cstdio>
#include <fstream>
#include <random>
#include <sstream>

#include "oracles/weakened_spindle.hpp"
#include "program.hpp"

using namespace program_test;
using oracle::WeakenedSpindle;

namespace {

struct Drive {
  WeakenedSpindle spindle;
  double noise_A = 0, noise_Nm = 0;
  double torque_share = 1;  ///< of the reported torque
  bool has_current = true, has_torque = true;
  bool torque_is_power = false;  ///< the second column is the power, losses and all
  double loss_W = 0, copper_W_per_Nm2 = 0, noise_W = 0;
};

Drive random(unsigned seed) {
  std::mt19937_64 bits(seed + 31);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(bits);
  };
  Drive d;
  d.spindle = WeakenedSpindle::random(seed);
  d.spindle.base_rad_s = 1e9;
  d.spindle.counts = 1048576;
  d.noise_A = between(0.01, 0.02) * d.spindle.limit_A;
  d.noise_Nm = between(0.5, 1.5) * d.noise_A * d.spindle.constant;
  return d;
}

void write_trace(const Drive& d, const std::string& name, double duration_s, bool cut,
                 unsigned seed) {
  std::ofstream out(folder / name);
  const char* second = d.torque_is_power ? ",spindle.power_W" : ",spindle.torque_Nm";
  out << "t_s,spindle.angle_counts" << (d.has_current ? ",spindle.current_A" : "")
      << (d.has_torque ? second : "") << "\n";
  std::mt19937_64 bits(seed);
  std::normal_distribution<double> noise(0, 1);
  char line[96];
  const WeakenedSpindle& s = d.spindle;
  s.run(
      duration_s,
      [&](double t) {
        constexpr double kShares[] = {0.3, 0.8, 0.5, 0.8, -0.4, -0.8, -0.2, 0.7};
        return s.top_rad_s * (cut ? 0.5 : kShares[std::min(static_cast<int>(t / 2), 7)]);
      },
      [&](double t) {
        return cut && t > 4 && static_cast<int>(t) % 2 == 0 ? 0.3 * s.limit_A * s.constant : 0.0;
      },
      [&](double t, std::int64_t counts, double current, double w) {
        std::snprintf(line, sizeof line, "%.6f,%lld", t, static_cast<long long>(counts));
        out << line;
        const double acting = d.torque_share * s.constant * current;
        const double ampere = current + d.noise_A * noise(bits), second_noise = noise(bits);
        const double torque = d.torque_is_power
                                  ? acting * w + d.loss_W + d.copper_W_per_Nm2 * acting * acting +
                                        d.noise_W * second_noise
                                  : acting + d.noise_Nm * second_noise;
        for (const auto& [has, value] :
             {std::pair{d.has_current, ampere}, {d.has_torque, torque}}) {
          if (!has) continue;
          std::snprintf(line, sizeof line, ",%.5f", value);
          out << line;
        }
        out << '\n';
      });
}

void write_machine(const Drive& d) {
  std::ostringstream text;
  text << "[machine]\nname = oracle\nsample_rate_hz = 8000\n[spindle]\nencoder_counts_per_rev = "
          "1048576\ntorque_constant_Nm_per_A = "
       << d.spindle.constant
       << "\n[observer.spindle]\ndisturbance_cutoff_rad_s = 500\nvelocity_cutoff_rad_s = 500\n";
  put("machine.ini", text.str());
}

double value_of(const std::string& key) {
  for (const std::string& line : lines(content(folder / "learned.ini")))
    if (line.starts_with(key + " ")) return std::stod(line.substr(line.find('=') + 1));
  return 0;
}

/// Standard deviation of the estimate at constant speed in the air.
double noise_of_estimate() {
  double n = 0, x = 0, xx = 0;
  for (const std::string& line : lines(content(folder / "estimates.csv"))) {
    if (line.empty() || line[0] == '#' || line[0] == 't') continue;
    const double t = std::stod(line), value = std::stod(line.substr(line.find(',') + 1));
    if (t < 2.5 || t > 4) continue;
    ++n, x += value, xx += value * value;
  }
  return std::sqrt(xx / n - x * x / n / n);
}

const std::string kIdle =
    "identify idle --machine machine.ini --trace idle.csv --out learned.ini --json";
const std::string kWatch =
    "monitor --machine learned.ini --trace cut.csv --estimates estimates.csv --json";

double noise_with(Drive d, bool current, bool torque, unsigned seed) {
  d.has_current = current;
  d.has_torque = torque;
  write_trace(d, "cut.csv", 8, true, seed);
  const Outcome o = run(kWatch);
  that(o.status == 0, o, "monitors", __LINE__);
  if (current && torque) {
    that(contains(o.out, "by their noise"), o, "says the weights", __LINE__);
    that(!contains(o.out, "not used by this command"), o, "both are used", __LINE__);
  }
  return noise_of_estimate();
}

void mean_of_both(unsigned seed) {
  const Drive d = random(seed);
  write_machine(d);
  write_trace(d, "idle.csv", 16, false, seed);
  const Outcome learned = run(kIdle);
  that(learned.status == 0, learned, "identifies", __LINE__);
  const double noise_A = value_of("effort_noise_A") / d.noise_A,
               noise_Nm = value_of("effort_noise_Nm") / d.noise_Nm;
  CHECK_NEAR(noise_A, 1, 0.02);
  CHECK_NEAR(noise_Nm, 1, 0.02);
  const double current = noise_with(d, true, false, seed + 1),
               torque = noise_with(d, false, true, seed + 1),
               both = noise_with(d, true, true, seed + 1);
  // What the encoder adds is in all of them; the noises of the two efforts are independent.
  Drive quiet = d;
  quiet.noise_A *= 0.02;
  quiet.noise_Nm *= 0.02;
  const double floor = noise_with(quiet, true, false, seed + 1);
  const auto own = [&](double noise) { return noise * noise - floor * floor; };
  const double expected = std::sqrt(floor * floor + 1 / (1 / own(current) + 1 / own(torque)));
  std::printf(
      "  seed %u: noise %+.2f and %+.2f %%, estimate %.4g Nm by current, %.4g by torque, "
      "%.4g by both (%.4g expected)\n",
      seed, 100 * (noise_A - 1), 100 * (noise_Nm - 1), current, torque, both, expected);
  CHECK_NEAR(both / expected, 1, 0.05);
}

/// A torque of another scale is told with its ratio.
void disagree(unsigned seed, double share) {
  Drive d = random(seed);
  write_machine(d);
  write_trace(d, "idle.csv", 16, false, seed);
  run(kIdle);
  d.torque_share = share;
  write_trace(d, "cut.csv", 16, true, seed + 1);
  const Outcome o = run(kWatch);
  char ratio[64];
  std::snprintf(ratio, sizeof ratio, "spindle.torque_Nm is %.2f", share);
  that(contains(o.out, ratio) && contains(o.out, "spindle.current_A alone is taken"), o,
       "names both and their ratio", __LINE__);
  that(contains(o.out, "\"warnings\": 1"), o, "warns once", __LINE__);
  write_trace(d, "idle.csv", 16, false, seed + 2);
  const Outcome learned = run(kIdle);
  that(contains(learned.out, ratio), learned, "names both and their ratio", __LINE__);
  CHECK(value_of("effort_noise_A") == 0);
}

/// Three percent are within the error of a constant.
void agree(unsigned seed) {
  Drive d = random(seed);
  d.torque_share = 1.03;
  write_machine(d);
  write_trace(d, "idle.csv", 16, false, seed);
  run(kIdle);
  write_trace(d, "cut.csv", 16, true, seed + 1);
  const Outcome o = run(kWatch);
  // Steps of the load may be heard as chatter.
  that(!contains(o.out, "alone is taken"), o, "does not warn of the pair", __LINE__);
  CHECK(value_of("effort_noise_A") > 0);
}

/// The second column is the power, whose noise at the speed of the cut is that of the current.
Drive with_power(unsigned seed) {
  Drive d = random(seed);
  std::mt19937_64 bits(seed + 57);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(bits);
  };
  const double most_Nm = d.spindle.limit_A * d.spindle.constant,
               most_W = most_Nm * d.spindle.top_rad_s;
  d.torque_is_power = true;
  d.loss_W = between(0.01, 0.05) * most_W;
  d.copper_W_per_Nm2 = between(0.02, 0.08) * most_W / most_Nm / most_Nm;
  d.noise_W = between(0.7, 1.4) * d.noise_A * d.spindle.constant * d.spindle.top_rad_s / 2;
  return d;
}

void mean_with_power(unsigned seed) {
  const Drive d = with_power(seed);
  write_machine(d);
  write_trace(d, "idle.csv", 16, false, seed);
  const Outcome learned = run(kIdle);
  that(learned.status == 0, learned, "identifies", __LINE__);
  const double loss = value_of("power_loss_W") / d.loss_W,
               copper = value_of("copper_loss_W_per_Nm2") / d.copper_W_per_Nm2,
               noise_W = value_of("effort_noise_W") / d.noise_W;
  CHECK_NEAR(noise_W, 1, 0.03);
  CHECK_NEAR(loss, 1, 0.03);
  CHECK_NEAR(copper, 1, 0.05);
  Drive quiet = d;
  quiet.noise_A *= 0.02;
  quiet.noise_W *= 0.02;
  const double current = noise_with(d, true, false, seed + 1),
               both = noise_with(d, true, true, seed + 1),
               floor = noise_with(quiet, true, false, seed + 1);
  // Independent noises; that of the power over the speed, half of the highest.
  const double power_Nm = d.noise_W / (d.spindle.top_rad_s / 2),
               current_Nm = d.noise_A * d.spindle.constant;
  const double left = power_Nm * power_Nm / (power_Nm * power_Nm + current_Nm * current_Nm);
  const double expected = std::sqrt(floor * floor + left * (current * current - floor * floor));
  std::printf(
      "  seed %u, power: P0 %+.2f %%, copper %+.2f %%, noise %+.2f %%, estimate %.4g Nm by "
      "current, "
      "%.4g by both (%.4g expected)\n",
      seed, 100 * (loss - 1), 100 * (copper - 1), 100 * (noise_W - 1), current, both, expected);
  CHECK_NEAR(both / expected, 1, 0.05);
}

/// A power of another scale is told with its ratio, by both commands.
void power_disagrees(unsigned seed, double share) {
  Drive d = with_power(seed);
  write_machine(d);
  write_trace(d, "cut.csv", 16, true, seed);
  that(contains(run("monitor --machine machine.ini --trace cut.csv --json").out,
                "what is lost of it is not known"),
       run(kIdle), "asks for an idling run", __LINE__);
  write_trace(d, "idle.csv", 16, false, seed);
  run(kIdle);
  d.torque_share = share;
  write_trace(d, "cut.csv", 16, true, seed + 1);
  const Outcome o = run(kWatch);
  const std::string says = "spindle.power_W, less its losses, is ";
  const auto ratio_of = [&](const std::string& text) {
    const std::size_t at = text.find(says);
    return at == std::string::npos ? 0 : std::stod(text.substr(at + says.size()));
  };
  std::printf("  seed %u, power: %.2f is told as %.3f by monitor\n", seed, share, ratio_of(o.out));
  CHECK_NEAR(ratio_of(o.out), share, 0.03);
  that(contains(o.out, "spindle.current_A alone is taken"), o, "takes the current", __LINE__);
  that(contains(o.out, "\"warnings\": 1"), o, "warns once", __LINE__);
  write_trace(d, "idle.csv", 16, false, seed + 2);
  const Outcome learned = run(kIdle);
  CHECK_NEAR(ratio_of(learned.out), share, 0.02);
  CHECK(value_of("effort_noise_A") == 0);
}

}  // namespace

// `--nightly`: the figures of docs/power.md.
int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  return in_own_folder("effort_pairs", [&] {
    const unsigned from = nightly ? 751 : 1, count = nightly ? 8 : 1;
    for (unsigned seed = from; seed < from + count; ++seed) {
      mean_of_both(seed);
      disagree(seed + 100, seed % 2 == 0 ? 0.88 : 1.11);
      agree(seed + 200);
      mean_with_power(seed + 300);
      power_disagrees(seed + 400, seed % 2 == 0 ? 0.88 : 1.11);
    }
  });
}
