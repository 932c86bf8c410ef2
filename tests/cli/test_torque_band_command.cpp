// A program is taught, then run sound, late, with a dull tool and without a tool: identify
// torque-band and monitor as a user meets them, over time and over the path of the axes.
#include <cmath>
#include <cstdlib>
#include <random>
#include <string>

#include "check.hpp"
#include "detection/taught_programs.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

constexpr double kRate_hz = 2000, kPi = 3.14159265358979;
constexpr double kViscous = 0.002, kCoulomb_Nm = 0.3;

const char* const kMachine =
    "[machine]\nname = test bed\n\n[spindle]\ntorque_constant_Nm_per_A = 0.5\n"
    "inertia_kg_m2 = 0.01\nviscous_friction_Nm_s_per_rad = 0.002\ncoulomb_friction_Nm = 0.3\n"
    "encoder_counts_per_rev = 65536\n\n";
const char* const kBand =
    "[monitor.torque-band]\nreference = band.csv\nstep_s = 0.1\nmax_shift_s = 0.6\n"
    "shift_step_s = 0.1\n";

struct Part {
  unsigned seed = 1;
  double late_s = 0;
  double torque = 1;         ///< of the usual one...
  double torque_from_s = 0;  ///< ...from then on
};

// Cutting torque of the program: air, a cut, a deeper one, air, a third.
double expected_Nm(double t) {
  const auto ramp = [t](double from, double to) {
    const double begins = (t - from) / 0.3, ends = (to - t) / 0.3;
    return std::fmax(0, std::fmin(1, std::fmin(begins, ends)));
  };
  return 6 * ramp(1, 3) + 10 * ramp(3, 5) + 8 * ramp(6, 9);
}

// A spindle of 1230 rpm with three teeth: ripple and noise on top of the torque.
void record(const std::string& name, const Part& part) {
  std::mt19937 random(part.seed);
  std::normal_distribution<double> noise_Nm(0, 0.2);
  const double speed = 1230 * 2 * kPi / 60;
  std::string text = "t_s,spindle.angle_counts,spindle.current_A\n";
  for (int n = 0; n < 10 * static_cast<int>(kRate_hz); ++n) {
    const double t = n / kRate_hz, angle = speed * t;
    const double mean = expected_Nm(t - part.late_s) * (t >= part.torque_from_s ? part.torque : 1);
    const double torque = mean * (1 + 0.4 * std::sin(3 * angle) + 0.1 * std::sin(angle)) +
                          kViscous * speed + kCoulomb_Nm + noise_Nm(random);
    char line[96];
    std::snprintf(line, sizeof line, "%.6f,%lld,%.9g\n", t,
                  static_cast<long long>(std::floor(angle / (2 * kPi) * 65536)), torque / 0.5);
    text += line;
  }
  put(name, text);
}

void taught_and_watched() {
  put("plain.ini", kMachine);
  put("machine.ini", std::string(kMachine) + kBand);
  record("first.csv", {.seed = 1});
  record("second.csv", {.seed = 2, .late_s = 0.2, .torque = 1.05});
  const Outcome taught =
      run("identify torque-band --machine plain.ini --out band.csv --above-Nm 0.5 --below-Nm 0.5 "
          "--quiet first.csv second.csv");
  that(taught.status == 0 && taught.err.empty(), taught, "is taught", __LINE__);
  that(contains(taught.out, "second.csv came 0.2 s later"), taught, "finds the shift", __LINE__);
  const std::string band = content(folder / "band.csv");
  that(contains(band,
                "\nprogram_s,torque_Nm,lower_Nm,upper_Nm,section,nc_block,speed_rad_s,air_Nm,"
                "behind_gap\n0,"),
       taught, "the file", __LINE__);

  const auto watch = [](const Part& part) {
    record("part.csv", part);
    return run(
        "monitor --machine machine.ini --trace part.csv --events events.jsonl --quiet "
        "--fail-on-alarm");
  };
  const Outcome sound = watch({.seed = 3});
  that(sound.status == 0 && contains(sound.out, "torque-band    on tool      runs"), sound,
       "a sound part", __LINE__);
  that(contains(content(folder / "events.jsonl"), "\"monitor\": \"torque-band\""), sound,
       "tells its state", __LINE__);
  const Outcome late = watch({.seed = 4, .late_s = 0.4, .torque = 0.95});
  that(late.status == 0, late, "late by what is allowed: no alarm", __LINE__);
  const Outcome dull = watch({.seed = 5, .torque = 1.6});
  that(dull.status == 1, dull, "a dull tool", __LINE__);
  const Outcome lost = watch({.seed = 6, .torque = 0, .torque_from_s = 7});
  that(lost.status == 1 && contains(lost.out, "the torque has left its band"), lost,
       "a tool lost in the cut", __LINE__);
  // The first alarm: after the loss, which no shift within 0.6 s explains, and within the steps
  // that collect it.
  const std::string events = content(folder / "events.jsonl");
  const std::size_t alarm = events.find("\"state\": \"alarm\"");
  const std::size_t line = events.rfind('\n', alarm) + 1;
  const std::size_t time = events.find("\"t_s\": ", line);
  const double at_s = alarm == std::string::npos ? 0 : std::atof(events.c_str() + time + 7);
  that(at_s > 7 && at_s < 8, lost, "alarm within 1 s of the loss", __LINE__);
}

void refusals() {
  put("bad.csv", "program_s,torque_Nm,lower_Nm,upper_Nm\n0,1,0,2\n0.1,1,2,0\n");
  put("bad.ini", std::string(kMachine) + "[monitor.torque-band]\nreference = bad.csv\n");
  put("gone.ini", std::string(kMachine) + "[monitor.torque-band]\nreference = gone.csv\n");
  record("part.csv", {});
  const Outcome bad = run("monitor --machine bad.ini --trace part.csv");
  that(bad.status == 3 && contains(bad.err, "bad.csv:3:"), bad, "names file and line", __LINE__);
  const Outcome gone = run("monitor --machine gone.ini --trace part.csv");
  that(gone.status == 4 && contains(gone.err, "gone.csv"), gone, "names the file", __LINE__);
  const Outcome none = run("identify torque-band --machine plain.ini --out x.csv");
  that(none.status == 2 && contains(none.err, "one trace or more"), none, "no trace", __LINE__);
  const Outcome unlike = run(
      "identify torque-band --machine plain.ini --out x.csv --max-shift-s 0.5 first.csv air.csv");
  that(unlike.status == 4, unlike, "a trace that is not there", __LINE__);
  const Outcome without = run("monitor --machine plain.ini --trace part.csv");
  that(without.status == 0 && contains(without.out, "has no reference"), without, "says what lacks",
       __LINE__);
}

// Two axes and a spindle, another feed in each run that nothing reports, feed hold in one.
void record_path(const std::string& name, const taught_programs::Program& p,
                 const taught_programs::Events& e, std::uint64_t seed) {
  std::string text =
      "t_s,spindle.speed_rad_s,spindle.current_A,x.position_m,x.current_A,z.position_m,z.current_A,"
      "machine.nc_block\n";
  std::mt19937 random(static_cast<unsigned>(seed));
  std::normal_distribution<double> noise_A(0, 0.05);
  double x = 0, z = 0;
  for (const auto& s : taught_programs::run_of(p, e, seed)) {
    x += s.way_m[0];
    z += s.way_m[2];
    const bool turns = std::abs(s.increment_rad) > 5e-4;
    char line[160];
    std::snprintf(line, sizeof line, "%.3f,%.9g,%.6g,%.6f,%.4f,%.6f,%.4f,%d\n",
                  static_cast<double>(s.t_ns) * 1e-9, s.increment_rad / taught_programs::kPeriod_s,
                  2 * (s.torque_Nm + (turns ? s.friction_Nm : 0)), x, noise_A(random), z,
                  noise_A(random), s.block);
    text += line;
  }
  put(name, text);
}

void over_path() {
  const taught_programs::Program p = taught_programs::draw(5);
  char machine[400];
  std::snprintf(machine, sizeof machine,
                "[machine]\nname = mill\nsample_rate_hz = 1000\n\n[spindle]\n"
                "torque_constant_Nm_per_A = 0.5\ninertia_kg_m2 = 1e-5\n"
                "viscous_friction_Nm_s_per_rad = 0\ncoulomb_friction_Nm = %.6g\n\n"
                "[axis.x]\nequivalent_mass_kg = 100\nforce_constant_N_per_A = 100\n\n"
                "[axis.z]\nequivalent_mass_kg = 100\nforce_constant_N_per_A = 100\n\n",
                p.coulomb_Nm);
  put("mill.ini", machine);
  put("mill_band.ini", std::string(machine) + "[monitor.torque-band]\nreference = path.csv\n");
  taught_programs::Events feeds;
  feeds.override_unreported = true;
  record_path("one.csv", p, feeds, 501);
  record_path("two.csv", p, feeds, 502);
  const Outcome single =
      run("identify torque-band --machine mill.ini --out path.csv --spacing-m 0.0002 one.csv");
  that(single.status == 0 && contains(single.out, "are assumed to differ by 3 %"), single,
       "one run: says what is assumed", __LINE__);
  const Outcome taught = run(
      "identify torque-band --machine mill.ini --out path.csv --spacing-m 0.0002 --quiet one.csv "
      "two.csv");
  that(taught.status == 0 && contains(taught.out, " m of steady turning"), taught, "is taught",
       __LINE__);
  const std::string band = content(folder / "path.csv");
  that(contains(band,
                "\npath_m,torque_Nm,lower_Nm,upper_Nm,section,nc_block,speed_rad_s,air_Nm,"
                "behind_gap,feed_m_s\n0,"),
       taught, "the file", __LINE__);
  const auto watch = [&](const taught_programs::Events& e, std::uint64_t seed) {
    record_path("part.csv", p, e, seed);
    return run("monitor --machine mill_band.ini --trace part.csv --quiet --fail-on-alarm");
  };
  taught_programs::Events held = feeds;
  held.holds = true;
  held.holds_reported = false;
  const Outcome sound = watch(held, 503);
  that(sound.status == 0 && contains(sound.out, "torque-band    on tool      runs"), sound,
       "other feeds and feed hold: no alarm", __LINE__);
  taught_programs::Events missing = feeds;
  missing.tool = 1;
  missing.torque = 0;
  const Outcome lost = watch(missing, 504);
  that(lost.status == 1 && contains(lost.out, "the torque has left its band"), lost,
       "a missing tool", __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("torque-band", [] {
    taught_and_watched();
    over_path();
    refusals();
  });
}
