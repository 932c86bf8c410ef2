// A drive that reports its current as an absolute value, by the program alone: recognised in an
// idling run, its sign taken from the motion, a step of torque read right, and said.
#include <cmath>
#include <cstdio>
#include <fstream>
#include <optional>
#include <sstream>

#include "oracles/weakened_spindle.hpp"
#include "program.hpp"
#include "spindle_records.hpp"

using namespace program_test;
using oracle::WeakenedSpindle;

namespace {

constexpr double kStep_Nm = 1;

WeakenedSpindle drive(unsigned seed) {
  WeakenedSpindle s = WeakenedSpindle::random(seed);
  s.base_rad_s = 1e9;
  return s;
}

void write_idle(const WeakenedSpindle& s, bool absolute, unsigned seed) {
  spindle_records::write_trace(
      s, "idle.csv", 24,
      [&](double t) {
        constexpr double kShares[] = {0.3, 1, 0.5, 1, -0.4, -1, -0.2, 0.7, 1, 0};
        return s.top_rad_s * kShares[std::min(static_cast<int>(t / 2.4), 9)];
      },
      [](double) { return 0.0; }, seed, absolute);
}

/// Run-up, a cut from 5 s to 8 s, braking to a fifth.
void write_cut(const WeakenedSpindle& s, bool absolute, unsigned seed) {
  spindle_records::write_trace(
      s, "cut.csv", 12, [&](double t) { return s.top_rad_s * (t < 9 ? 0.8 : 0.2); },
      [](double t) { return t > 5 && t < 8 ? kStep_Nm : 0.0; }, seed, absolute);
}

void write_machine(const WeakenedSpindle& s, const std::string& more) {
  std::ostringstream text;
  text << "[machine]\nname = oracle\nsample_rate_hz = 8000\n[spindle]\ntorque_constant_Nm_per_A = "
       << s.constant << "\nencoder_counts_per_rev = " << s.counts << "\n"
       << more;
  put("machine.ini", text.str());
}

double value_of(const std::string& file, const std::string& key) {
  for (const std::string& line : lines(content(folder / file)))
    if (line.starts_with(key + " ")) return std::stod(line.substr(line.find('=') + 1));
  return std::nan("");
}

/// Mean of the estimate in the cut, and its largest while nothing is cut and the drive brakes.
struct Reading {
  double cut = 0, air = 0;
};
Reading read_estimate() {
  Reading r;
  double n = 0;
  for (const std::string& line : lines(content(folder / "estimates.csv"))) {
    if (line.empty() || line[0] == '#' || line[0] == 't') continue;
    const double t = std::stod(line);
    const std::size_t at = line.find(',') + 1;
    const std::string field = line.substr(at, line.find(',', at) - at);
    if (field.empty() || field == "nan") continue;
    const double value = std::stod(field);
    if (t > 6 && t < 7.5) r.cut += value, ++n;
    if (t > 9.1 && t < 11.5) r.air = std::max(r.air, std::abs(value));
  }
  r.cut /= n;
  return r;
}

Outcome learn() {
  return run("identify idle --machine machine.ini --trace idle.csv --out learned.ini --json");
}

/// The line of the JSON that counts them.
std::string alarms(const Outcome& o) {
  for (const std::string& line : lines(o.out))
    if (contains(line, "\"alarms\":")) return line;
  return {};
}

void recognised(unsigned seed) {
  const WeakenedSpindle s = drive(seed);
  write_machine(s, "");
  write_idle(s, false, seed);
  const Outcome plain = learn();
  that(plain.status == 0, plain, "identifies", __LINE__);
  that(!contains(plain.out, "absolute"), plain, "a current with a sign is left alone", __LINE__);
  write_cut(s, false, seed + 1);
  const std::string watch =
      "monitor --machine learned.ini --trace cut.csv --estimates estimates.csv --json";
  const Outcome told = run(watch);
  that(told.status == 0, told, "monitors", __LINE__);
  const Reading with_sign = read_estimate();

  write_idle(s, true, seed);
  const Outcome learned = learn();
  that(learned.status == 0, learned, "identifies", __LINE__);
  that(contains(learned.out, "absolute value"), learned, "says so", __LINE__);
  that(contains(content(folder / "learned.ini"), "current_is_unsigned = yes"), learned, "writes it",
       __LINE__);
  const double inertia = value_of("learned.ini", "inertia_kg_m2") / s.inertia,
               viscous = value_of("learned.ini", "viscous_friction_Nm_s_per_rad") / s.viscous,
               coulomb = value_of("learned.ini", "coulomb_friction_Nm") / s.coulomb;
  CHECK_NEAR(inertia, 1, 0.002);
  CHECK_NEAR(viscous, 1, 0.005);
  CHECK_NEAR(coulomb, 1, 0.005);
  write_cut(s, true, seed + 1);
  const Outcome cut = run(watch);
  that(cut.status == 0, cut, "monitors", __LINE__);
  that(contains(cut.out, "absolute value"), cut, "says so", __LINE__);
  that(alarms(cut) == alarms(told), cut, "as many alarms as with a sign", __LINE__);
  const Reading without = read_estimate();
  std::printf(
      "  seed %u: J %+.2f %%, D %+.2f %%, C %+.2f %%, step %+.2f %%, braking %.3g Nm (%.3g "
      "with a sign)\n",
      seed, 100 * (inertia - 1), 100 * (viscous - 1), 100 * (coulomb - 1),
      100 * (without.cut / kStep_Nm - 1), without.air, with_sign.air);
  CHECK_NEAR(without.cut, kStep_Nm, 0.01 * kStep_Nm);

  // The same record where nobody says what the current is.
  std::string learned_file = content(folder / "learned.ini");
  const auto at = learned_file.find("current_is_unsigned");
  learned_file.erase(at, learned_file.find('\n', at) + 1 - at);
  put("learned.ini", learned_file);
  const Outcome asked = run(watch);
  that(contains(asked.out, "current_is_unsigned = yes"), asked, "asks for the key", __LINE__);
}

/// A current in percent of the rated one is the same current; without the rated one it is asked
/// for.
void percent_of_rated(unsigned seed) {
  constexpr double kRated_A = 25;
  const WeakenedSpindle s = drive(seed);
  std::ostringstream parameters;
  parameters << "inertia_kg_m2 = " << s.inertia << "\nviscous_friction_Nm_s_per_rad = " << s.viscous
             << "\ncoulomb_friction_Nm = " << s.coulomb << "\ncurrent_is_unsigned = no\n";
  const std::string watch =
      "monitor --machine machine.ini --trace cut.csv --estimates estimates.csv --json";
  write_machine(s, parameters.str());
  write_cut(s, false, seed);
  that(run(watch).status == 0, run(watch), "monitors", __LINE__);
  const Reading ampere = read_estimate();
  std::string percent = "t_s,spindle.angle_counts,spindle.current_percent\n";
  for (const std::string& line : lines(content(folder / "cut.csv"))) {
    const auto comma = line.rfind(',');
    if (line[0] == 't' || comma == std::string::npos) continue;
    char value[32];
    std::snprintf(value, sizeof value, ",%.6f\n",
                  100 / kRated_A * std::stod(line.substr(comma + 1)));
    percent += line.substr(0, comma) + value;
  }
  put("cut.csv", percent);
  const Outcome refused = run(watch);
  that(contains(refused.out + refused.err, "rated_current_A"), refused,
       "asks for the rated current", __LINE__);
  write_machine(s, parameters.str() + "rated_current_A = 25\n");
  that(run(watch).status == 0, run(watch), "monitors", __LINE__);
  CHECK_NEAR(read_estimate().cut, ampere.cut, 1e-4);
}

}  // namespace

// `--nightly`: the figures of docs/drive-input.md.
int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  return in_own_folder("unsigned_current", [&] {
    const unsigned from = nightly ? 601 : 1, count = nightly ? 6 : 1;
    for (unsigned seed = from; seed < from + count; ++seed) recognised(seed);
    percent_of_rated(4);
  });
}
