// A spindle that takes its time to start: what waits for it, and what cuts before it has its speed.
// Times by hand.
#include <algorithm>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/process/motion/plain_time.hpp"
#include "servosense/process/motion/trajectory.hpp"
#include "servosense/process/program/program_reader.hpp"
#include "servosense/process/verification/program_check.hpp"

namespace {

using namespace servosense::process;
using servosense::MachineFile;

MotionLimits limits_with(double start_s) {
  MotionLimits limits;
  limits.velocity_m_s = {0.1, 0.1, 0.1};
  limits.spindle_start_s = start_s;
  return limits;
}

template <typename Planner>
std::vector<double> ends_of(const std::string& program, const MotionLimits& limits) {
  std::vector<double> ends_s;
  Planner planner(limits, [&](const CanonicalMove&, double end_s) { ends_s.push_back(end_s); });
  CHECK(run_program(ProgramText::from(program, "part.ngc"), {}, [&](const CanonicalMove& move) {
          planner.put(move);
        }).has_value());
  planner.finish();
  return ends_s;
}

/// Of a machine without inertia, then of one with: 0.5 m/s2, G61.1, half a servo period a stop.
void waits() {
  const auto plain = [](const std::string& program, double start_s) {
    return ends_of<PlainTime>(program + "M2\n", limits_with(start_s)).back();
  };
  // 100 mm at 50 mm/s, and 100 mm back at 100 mm/s.
  const std::string way = "F3000 G1 X100\nG0 X0\n";
  CHECK_NEAR(plain("S1000 M3\n" + way, 0), 3, 1e-12);
  CHECK_NEAR(plain("S1000 M3\n" + way, 4), 7, 1e-12);
  CHECK_NEAR(plain("S1000 M3\nG4 P1.5\n" + way, 4), 7, 1e-12);
  CHECK_NEAR(plain("S1000 M3\nG4 P4.5\n" + way, 4), 7.5, 1e-12);
  // A rapid does not wait, nor a spindle that stands.
  CHECK_NEAR(plain("S1000 M3\nG0 X100\nF3000 G1 X0\n", 4), 6, 1e-12);
  CHECK_NEAR(plain("S1000 M3\nM5\n" + way, 4), 3, 1e-12);
  // From 1000 to 4000 rpm three quarters; to 1050 nothing; back to it after M5 all.
  CHECK_NEAR(plain("S1000 M3\n" + way + "S4000\n" + way, 4), 7 + 3 + 3, 1e-12);
  CHECK_NEAR(plain("S1000 M3\n" + way + "S1050\n" + way, 4), 7 + 3, 1e-12);
  CHECK_NEAR(plain("S1000 M3\n" + way + "M5\nM3\n" + way, 4), 7 + 4 + 3, 1e-12);
  CHECK_NEAR(plain("S1000 M3\n" + way + "M4\n" + way, 4), 7 + 8 + 3, 1e-12);
  CHECK_NEAR(plain("T1 M6\nS1000 M3\n" + way + "T2 M6\nM3\n" + way, 4), 7 + 7, 1e-12);
  // A second change within the first does not make it shorter.
  CHECK_NEAR(plain("S1000 M3\nS1200\n" + way, 4), 7, 1e-12);

  MotionLimits limits = limits_with(4);
  limits.acceleration_m_s2 = {0.5, 0.5, 0.5};
  const auto real = [&](const std::string& program) {
    return ends_of<TrajectoryPlanner>("G61.1\n" + program + "M2\n", limits).back();
  };
  const double stop = limits.cycle_s / 2;
  CHECK_NEAR(real("S1000 M3\n" + way), 4 + 2.1 + 1.2 + 2 * stop, 1e-9);
  CHECK_NEAR(real("S1000 M3\nG0 X100\nF3000 G1 X0\n"), 4 + 2.1 + stop, 1e-9);
  CHECK_NEAR(real("S1000 M3\nG0 X100\nG33.1 X90 K1\n"), 4 + 2 * 10.0 * 60 / 1000, 1e-9);
  // The feeds after the first go on as without it.
  const std::string path = "G64 P0.05\nG0 X10\nF1500\nG1 X30\nY10\nX40 Y20\nG2 X50 Y30 I10 J0\n";
  const auto whole = [&](double start_s) {
    limits.spindle_start_s = start_s;
    return ends_of<TrajectoryPlanner>("S1000 M3\n" + path + "M2\n", limits);
  };
  const auto without = whole(0), with = whole(60);
  CHECK(without.size() == with.size());
  const double rapid = without[2];
  CHECK_NEAR(with[2], rapid, 1e-12);
  CHECK_NEAR(with.back() - without.back(), 60 - rapid - stop, 1e-9);
}

/// A slot of which the cut begins 3 s after M3: 40 mm at 100 mm/s, 8 mm and 5 mm at 5 mm/s.
void cuts_too_early() {
  const std::string limits =
      "[axis.x]\nmax_velocity_m_s = 0.1\n[axis.y]\nmax_velocity_m_s = 0.1\n"
      "[axis.z]\nmax_velocity_m_s = 0.1\n[tool]\ndiameter_m = 0.01\nflute_length_m = 0.02\n";
  const auto found = [&](const std::string& keys, const std::string& start,
                         const std::string& feed = "F300", bool timed = true) {
    const auto machine = MachineFile::parse("[machine]\n" + keys + limits, "mill.ini");
    CHECK(machine.has_value());
    MachineTools tools(*machine);
    auto workpiece = *Workpiece::of(BoxStock{{0, 0, -0.02}, {0.04, 0.08, 0}}, 5e-4);
    ProgramCheck check(workpiece, tools, *CheckLimits::from(*machine));
    const std::string program = "G21 G90 G17\nT1 M6\n" + start + "\nG0 X-10 Y40 Z5\nG1 Z-3 " +
                                feed + "\nG1 X50\nG0 Z50\nM2\n";
    if (timed) check.set_times(ends_of<PlainTime>(program, machine_motion(*machine).limits));
    CHECK(run_program(ProgramText::from(program, "part.ngc"), {}, [&](const CanonicalMove& move) {
            CHECK(check.put(move).has_value());
          }).has_value());
    check.finish();
    return check.findings();
  };
  const auto late = found("spindle_start_s = 4\n", "S5000 M3");
  CHECK(late.size() == 1);
  if (late.size() == 1) {
    CHECK(late[0].kind == FindingKind::spindle_not_at_speed);
    CHECK(late[0].line == 6 && late[0].last_line == 6);
    // Within a step of a fifth of the radius, 0.2 s.
    CHECK_BETWEEN(late[0].size, 0.999, 1.2);
    CHECK(late[0].message.find("spindle_start_s") != std::string::npos);
    check::figure("before its speed, 1 s by hand", late[0].size, "s");
  }
  CHECK(found("spindle_start_s = 2.7\n", "S5000 M3").empty());
  // What gives it the time: a dwell, a control that waits.
  CHECK(found("spindle_start_s = 4\n", "S5000 M3 G4 P1.3").empty());
  CHECK(found("spindle_start_s = 4\nwaits_for_spindle = yes\n", "S5000 M3").empty());
  // The spindle turns already: half the speed is half the time; feeds a revolution follow it.
  CHECK(found("spindle_start_s = 8\n", "S5000 M3\nG4 P8\nS7000").empty());
  CHECK(found("spindle_start_s = 8\n", "S5000 M3\nG4 P8\nS10000").size() == 1);
  CHECK(found("spindle_start_s = 4\n", "S5000 M3", "G95 F0.06").empty());
  // Nothing is known.
  CHECK(found("", "S5000 M3").empty());
  CHECK(found("spindle_start_s = 4\n", "S5000 M3", "F300", false).empty());
}

}  // namespace

int main() {
  waits();
  cuts_too_early();
  return check::done();
}
