// A drive that reports its current and its torque, by the program alone: an idling run learns the
// noise of both, the mean that is taken then is quieter than either, and what does not agree is
// said, by both commands, and not averaged.
#include <cmath>
#include <cstdio>
#include <cstring>
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
  out << "t_s,spindle.angle_counts" << (d.has_current ? ",spindle.current_A" : "")
      << (d.has_torque ? ",spindle.torque_Nm" : "") << "\n";
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
      [&](double t, std::int64_t counts, double current, double) {
        std::snprintf(line, sizeof line, "%.6f,%lld", t, static_cast<long long>(counts));
        out << line;
        const double ampere = current + d.noise_A * noise(bits),
                     torque = d.torque_share * s.constant * current + d.noise_Nm * noise(bits);
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
  that(contains(o.out, "\"warnings\": 0"), o, "warns of nothing", __LINE__);
  CHECK(value_of("effort_noise_A") > 0);
}

}  // namespace

// `--nightly`: the figures of docs/power.md.
int main(int argc, char** argv) {
  const bool nightly = argc > 1 && std::strcmp(argv[1], "--nightly") == 0;
  return in_own_folder("effort_pairs", [&] {
    const unsigned from = nightly ? 751 : 1, count = nightly ? 8 : 1;
    for (unsigned seed = from; seed < from + count; ++seed) {
      mean_of_both(seed);
      disagree(seed + 100, seed % 2 == 0 ? 0.88 : 1.11);
      agree(seed + 200);
    }
  });
}
