// The torque constant checked in normal use, by the program alone: a spindle that runs up and down
// with cuts between them, whose reported current is right, or 6 % too much.
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

Outcome watched(unsigned seed, double share, const std::string& more) {
  WeakenedSpindle s = WeakenedSpindle::random(seed);
  s.base_rad_s = 1e9;
  std::ostringstream text;
  text << "[machine]\nname = oracle\nsample_rate_hz = 8000\n[spindle]\ntorque_constant_Nm_per_A = "
       << s.constant << "\nencoder_counts_per_rev = " << s.counts
       << "\ninertia_kg_m2 = " << s.inertia << "\nviscous_friction_Nm_s_per_rad = " << s.viscous
       << "\ncoulomb_friction_Nm = " << s.coulomb << "\n"
       << more;
  put("machine.ini", text.str());
  std::ofstream out(folder / "day.csv");
  out << "t_s,spindle.angle_counts,spindle.current_A\n";
  // As slow as it has to be to reach both speeds.
  const double step_s = 0.6 + s.top_rad_s / 150;
  char line[96];
  s.record(
      8 * step_s,
      [&](double t) { return s.top_rad_s * (static_cast<int>(t / step_s) % 2 == 0 ? 0.8 : 0.2); },
      [&](double t) {
        const double within = t / step_s - std::floor(t / step_s);
        return within > 0.85 && within < 0.95 ? 0.2 * s.limit_A * s.constant : 0.0;
      },
      seed,
      [&](double t, std::int64_t counts, double current) {
        std::snprintf(line, sizeof line, "%.6f,%lld,%.4f\n", t, static_cast<long long>(counts),
                      share * current);
        out << line;
      });
  out.close();
  return run("monitor --machine machine.ini --trace day.csv --json");
}

}  // namespace

int main() {
  return in_own_folder("constant_watch", [] {
    const Outcome sound = watched(2, 1, "");
    that(contains(sound.out, "\"warnings\": 0"), sound, "warns of nothing", __LINE__);
    that(contains(sound.out, "\"pairs\":"), sound, "has compared", __LINE__);
    const Outcome off = watched(2, 1.06, "");
    that(contains(off.out, "\"warnings\": 1"), off, "warns once", __LINE__);
    that(contains(off.out, "effort per acceleration is +6"), off, "with its size", __LINE__);
    that(contains(off.out, "another tool or work is clamped"), off, "and what it may be", __LINE__);
    const Outcome silent = watched(2, 1.06, "[monitor.signal]\nenabled = no\n");
    that(contains(silent.out, "\"warnings\": 0"), silent, "is switched off", __LINE__);
  });
}
