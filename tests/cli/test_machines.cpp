// Axes that turn, a second spindle, gears and linear motors, through the commands, against drives
// worked out from their equations of motion (tests/oracles/idle_plant.hpp).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "check.hpp"
#include "oracles/idle_plant.hpp"
#include "program.hpp"

namespace {

using namespace program_test;
using oracle::FeedProgram;
using oracle::IdlePlant;
using oracle::SpeedProgram;
using Load = std::function<double(double)>;

constexpr double kRate_hz = 2000;
constexpr double kTableCounts = 3.6e6, kSpindleCounts = 1 << 20;
constexpr double kTable_Nm_per_A = 30;
constexpr double kGear = 90;  // of the worm, where there is one

const IdlePlant kTable{.inertia = 2.5, .viscous = 12, .coulomb = 25, .knee = 1e-4};
const IdlePlant kSpindle{.inertia = 0.02,
                         .viscous = 0.002,
                         .coulomb = 0.5,
                         .knee = 1e-3,
                         .position_loop_rad_s = 0,
                         .speed_loop_rad_s = 200};
const FeedProgram kMoves{{{.distance = 0.6, .speed = 0.5, .ramp_s = 0.15},
                          {.distance = 1.2, .speed = 1.5, .ramp_s = 0.15},
                          {.distance = 1.5, .speed = 3, .ramp_s = 0.2}}};
const SpeedProgram kSpeeds{
    .ramp_s = 0.5, .hold_s = 3.5, .speeds = {0, 150, 300, 60, -150, -300, -60, 150, 300}};

const char* const kMachine = R"([machine]
name = mill-turn
[axis.a]
torque_constant_Nm_per_A = 30
encoder_counts_per_rev = 3600000
[spindle2]
encoder_counts_per_rev = 1048576
[observer.spindle2]
disturbance_cutoff_rad_s = 500
velocity_cutoff_rad_s = 500
)";

double nothing(double) { return 0; }
Load between(double from_s, double to_s, double torque) {
  return [=](double t) { return t >= from_s && t < to_s ? torque : 0.0; };
}

/// One column pair of a trace: counts, and an effort with white noise.
struct Columns {
  std::string motion, effort;
  std::vector<long long> counts;
  std::vector<double> value;
};
Columns reported(const IdlePlant::Record& r, const std::string& motion, const std::string& effort,
                 double unit_per_count, double per_unit, double noise, unsigned seed) {
  Columns c{motion, effort, {}, {}};
  oracle::Reporter reporter(unit_per_count, noise, seed);
  for (std::size_t i = 0; i < r.x.size(); ++i) {
    c.counts.push_back(reporter.counts(r.x[i]));
    c.value.push_back(reporter.effort(r.effort[i] / per_unit));
  }
  return c;
}
void write(const std::string& name, const std::vector<Columns>& all) {
  std::string text = "t_s";
  for (const Columns& c : all) text += "," + c.motion + "," + c.effort;
  text += '\n';
  char field[64];
  for (std::size_t i = 0; i < all[0].counts.size(); ++i) {
    std::snprintf(field, sizeof field, "%.6f", static_cast<double>(i) / kRate_hz);
    text += field;
    for (const Columns& c : all) {
      std::snprintf(field, sizeof field, ",%lld,%.9g", c.counts[i], c.value[i]);
      text += field;
    }
    text += '\n';
  }
  put(name, text);
}

/// The table and the second spindle of a machine.
void record(const std::string& name, unsigned seed, const Load& on_table = nothing,
            const Load& on_spindle = nothing) {
  const double seconds = kSpeeds.length_s(), period = 1 / kRate_hz;
  const auto table = kTable.run(
      seconds, period, [](double t) { return kMoves.at(t); }, on_table);
  const auto spindle = kSpindle.run(
      seconds, period, [](double t) { return kSpeeds.at(t); }, on_spindle);
  write(name, {reported(table, "a.angle_counts", "a.current_A", 2 * oracle::kPi / kTableCounts,
                        kTable_Nm_per_A, 0.02, seed),
               reported(spindle, "spindle2.angle_counts", "spindle2.torque_Nm",
                        2 * oracle::kPi / kSpindleCounts, 1, 0.02, seed + 1)});
}

/// Four standard errors: one in 16 000 of a normal distribution.
void within_its_error(const Json& json, const std::string& path, double truth) {
  const double error = json.number(path + ".standard_error");
  check::figure((path + ", off by so many standard errors").c_str(),
                std::abs(json.number(path + ".value") - truth) / error);
  CHECK_NEAR(json.number(path + ".value"), truth, 4 * error);
}

void idle_run_is_learned() {
  record("idle.csv", 101);
  put("m.ini", kMachine);
  const Outcome o = run("identify idle --machine m.ini --trace idle.csv --out learned.ini --json");
  that(o.status == 0, o, "learns both drives", __LINE__);
  const Json json(o.out);
  CHECK_TEXT(json.text("drives.0.channel"), "a");
  within_its_error(json, "drives.0.inertia_kg_m2", kTable.inertia);
  within_its_error(json, "drives.0.viscous_friction_Nm_s_per_rad", kTable.viscous);
  within_its_error(json, "drives.0.coulomb_friction_Nm", kTable.coulomb);
  CHECK(json.number("drives.0.inertia_kg_m2.standard_error") < 0.02 * kTable.inertia);
  CHECK(json.number("drives.0.collision_threshold_Nm_per_s") > 0);
  CHECK_TEXT(json.text("drives.0.unit"), "Nm");
  CHECK_TEXT(json.text("drives.1.channel"), "spindle2");
  within_its_error(json, "drives.1.inertia_kg_m2", kSpindle.inertia);
  within_its_error(json, "drives.1.coulomb_friction_Nm", kSpindle.coulomb);
  CHECK(json.number("drives.1.chatter_threshold_Nm2") > 0);
  const std::string learned = content(folder / "learned.ini");
  for (const char* part :
       {"[monitor.collision.a]\nthreshold_Nm_per_s = ", "phase_thresholds_Nm_per_s",
        "[monitor.chatter.spindle2]\nchatter_threshold_Nm2 = ", "[detectability.a]\nnoise_floor_Nm",
        "[detectability.spindle2]"})
    CHECK(contains(learned, part));
}

double mean(const std::vector<std::string>& rows, std::size_t column, double from_s, double to_s) {
  double sum = 0, n = 0;
  for (const std::string& row : rows) {
    if (row.empty() || row[0] == '#' || row[0] == 't') continue;
    std::stringstream in(row);
    std::vector<double> v;
    for (std::string field; std::getline(in, field, ',');)
      v.push_back(std::strtod(field.c_str(), nullptr));
    if (v[0] < from_s || v[0] >= to_s) continue;
    sum += v[column];
    ++n;
  }
  return sum / n;
}

void torques_are_followed() {
  // At 8.2 s the table goes at 0.5 rad/s, and the second spindle at 300 rad/s.
  record("cut.csv", 202, between(8.2, 8.7, 18), between(6, 7.5, 1.5));
  const Outcome o =
      run("monitor --machine learned.ini --trace cut.csv --estimates e.csv --events ev.jsonl "
          "--report r.html --json");
  that(o.status == 0, o, "watches", __LINE__);
  const std::string estimates = content(folder / "e.csv");
  CHECK(contains(estimates,
                 "t_s,a.torque_Nm,spindle2.torque_Nm,a.torque_band_Nm,spindle2.torque_band_Nm\n"));
  const auto rows = lines(estimates);
  // Friction is known to a part in a hundred of 25 Nm, and to 1 % of 0.5 Nm.
  CHECK_NEAR(mean(rows, 1, 8.3, 8.7), 18, 0.3);
  CHECK_NEAR(mean(rows, 1, 8.0, 8.2), 0, 0.3);
  CHECK_NEAR(mean(rows, 2, 6.1, 7.5), 1.5, 0.02);
  CHECK_NEAR(mean(rows, 2, 5.0, 6.0), 0, 0.02);
  const Json json(o.out);
  CHECK_TEXT(json.text("estimates.0.unit"), "Nm");
  CHECK(contains(content(folder / "r.html"), "Second spindle"));
}

void sound_motion_is_silent() {
  record("sound.csv", 303);
  const Outcome o = run("monitor --machine learned.ini --trace sound.csv --json");
  that(o.status == 0, o, "watches", __LINE__);
  const Json json(o.out);
  CHECK_TEXT(json.text("verdict"), "clear");
  CHECK_NEAR(json.number("alarms"), 0, 0);
  for (std::size_t i = 0; i < json.sizes.at("monitors"); ++i) {
    const std::string path = "monitors." + std::to_string(i);
    if (json.text(path + ".channel") != "a" || json.text(path + ".name") != "collision") continue;
    CHECK_TEXT(json.text(path + ".runs"), "true");
    CHECK_TEXT(json.text(path + ".sees_from.unit"), "Nm");
  }
}

/// The first alarm of a run.
struct Alarm {
  double t_s = 0;
  std::string monitor, channel, unit;
};
Alarm first_alarm(const Json& json) {
  for (std::size_t i = 0; json.scalars.contains("events." + std::to_string(i) + ".t_s"); ++i) {
    const std::string path = "events." + std::to_string(i);
    if (json.text(path + ".state") == "alarm")
      return {json.number(path + ".t_s"), json.text(path + ".monitor"),
              json.text(path + ".channel"), json.text(path + ".unit")};
  }
  return {};
}

void contact_on_the_table_is_found() {
  record("contact.csv", 404, between(8.2, 12, 60));
  const Outcome o = run("monitor --machine learned.ini --trace contact.csv --json --fail-on-alarm");
  that(o.status == 1, o, "alarms", __LINE__);
  const Alarm alarm = first_alarm(Json(o.out));
  CHECK_TEXT(alarm.monitor + " " + alarm.channel + " " + alarm.unit, "collision a Nm/s");
  check::figure("contact on a, alarm after", 1e3 * (alarm.t_s - 8.2), "ms");
  // Three samples of 0.5 ms after filters of some 6 ms.
  CHECK(alarm.t_s > 8.2 && alarm.t_s < 8.22);
}

void chatter_on_the_second_spindle_is_found() {
  // 137 Hz is 5.7 times the rotation at 150 rad/s and 2.9 times that at 300.
  record("chatter.csv", 505, nothing, [](double t) {
    return t >= 1.5 && t < 3.5 ? 0.8 * std::sin(2 * oracle::kPi * 137 * t) : 0.0;
  });
  const Outcome o = run("monitor --machine learned.ini --trace chatter.csv --json");
  that(o.status == 0, o, "watches", __LINE__);
  const Alarm alarm = first_alarm(Json(o.out));
  CHECK_TEXT(alarm.monitor + " " + alarm.channel + " " + alarm.unit, "chatter spindle2 Nm2");
  CHECK(alarm.t_s > 1.5 && alarm.t_s < 3.5);
}

/// The table behind a play of `width`, its friction on the side of the motor.
IdlePlant::Record with_play(double width, double seconds) {
  const double motor = 1.5, load = 1, stiffness = 4e5, damping = 100;
  const double loop = 200, speed_loop = 400;
  IdlePlant::Record record;
  std::array<double, 4> y{};
  oracle::Bristle bristle{kTable.knee};
  constexpr int kSteps = 20;
  const double h = 1 / kRate_hz / kSteps;
  const auto effort = [&](double t, double x, double v) {
    const oracle::Motion r = kMoves.at(t);
    return kTable.inertia * r.a + kTable.viscous * r.v + kTable.inertia * loop * loop * (r.x - x) +
           kTable.inertia * speed_loop * (r.v - v);
  };
  for (std::size_t i = 0; i < static_cast<std::size_t>(seconds * kRate_hz); ++i) {
    const double at = static_cast<double>(i) / kRate_hz;
    record.x.push_back(y[0]);
    record.effort.push_back(effort(at, y[0], y[1]));
    for (int k = 0; k < kSteps; ++k) {
      const double from = y[0];
      y = oracle::runge_kutta(y, at + k * h, h, [&](double t, const std::array<double, 4>& s) {
        const double sign =
            std::clamp(bristle.z + s[0] - from, -kTable.knee, kTable.knee) / kTable.knee;
        const double apart = s[0] - s[2], beyond = std::abs(apart) - width / 2;
        const double spring =
            beyond > 0 ? std::copysign(stiffness * beyond, apart) + damping * (s[1] - s[3]) : 0;
        return std::array<double, 4>{
            s[1],
            (effort(t, s[0], s[1]) - kTable.viscous * s[1] - kTable.coulomb * sign - spring) /
                motor,
            s[3], spring / load};
      });
      bristle.follow(y[0] - from);
    }
  }
  return record;
}

const std::string kTableAlone =
    "[machine]\nname = table\n[axis.a]\ntorque_constant_Nm_per_A = 30\nencoder_counts_per_rev = "
    "3600000\ninertia_kg_m2 = 2.5\nviscous_friction_Nm_s_per_rad = 12\ncoulomb_friction_Nm = 25\n";

void table_reconciles() {
  put("table.ini", kTableAlone);
  const auto table = [](const IdlePlant::Record& r, unsigned seed) {
    return std::vector{reported(r, "a.angle_counts", "a.current_A", 2 * oracle::kPi / kTableCounts,
                                kTable_Nm_per_A, 0.02, seed)};
  };
  write("null.csv",
        table(kTable.run(40, 1 / kRate_hz, [](double t) { return kMoves.at(t); }), 606));
  const Outcome null =
      run("reconcile --machine table.ini --trace null.csv --channel a --out null --json");
  that(null.status == 0, null, "compares", __LINE__);
  CHECK_TEXT(Json(null.out).text("verdict"), "agrees");
  CHECK_TEXT(Json(null.out).text("gap_unit"), "Nm");

  write("play.csv", table(with_play(1e-3, 40), 707));
  const Outcome play =
      run("reconcile --machine table.ini --trace play.csv --channel a --out play --json");
  that(play.status == 0, play, "compares", __LINE__);
  const Json json(play.out);
  CHECK_TEXT(json.text("channel"), "a");
  CHECK_TEXT(json.text("effects.0.name"), "backlash");
  const double error = json.number("effects.0.standard_errors.width_rad");
  CHECK_NEAR(json.number("effects.0.parameters.width_rad"), 1e-3, 3 * error);
  CHECK(error < 3e-4);
  CHECK(json.number("gap_after") < 0.5 * json.number("gap_before"));
  CHECK(contains(content(folder / "play" / "machine.ini"), "[effect.a.backlash]\nwidth_rad = "));
}

/// A gear changes what the motor reports, not what turns.
void gears_are_seen_through() {
  const auto table = kTable.run(16, 1 / kRate_hz, [](double t) { return kMoves.at(t); });
  const double count = 2 * oracle::kPi / kTableCounts;
  write("table.csv",
        {reported(table, "a.angle_counts", "a.current_A", count, kTable_Nm_per_A, 0.02, 808)});
  const auto inertia = [](const char* machine) {
    put("g.ini", machine);
    const Outcome o = run("identify idle --machine g.ini --trace table.csv --out g2.ini --json");
    that(o.status == 0, o, "is learned", __LINE__);
    return Json(o.out).number("drives.0.inertia_kg_m2.value");
  };
  const double direct =
      inertia("[axis.a]\ntorque_constant_Nm_per_A = 30\nencoder_counts_per_rev = 3600000\n");
  CHECK_NEAR(direct, kTable.inertia, 0.02 * kTable.inertia);
  // The same table behind a worm: 40 000 counts a turn of the motor, a third of a Nm per ampere.
  static_assert(kTableCounts / kGear == 40000);
  CHECK_NEAR(inertia("[axis.a]\ntorque_constant_Nm_per_A = 0.333333333333\n"
                     "encoder_counts_per_rev = 40000\ngear_ratio = 90\n"),
             direct, 1e-9 * direct);
}

/// A linear axis by screw, by belt and screw, and by a linear motor.
void screws_belts_and_linear_motors() {
  const IdlePlant stage;  // 227 kg
  const FeedProgram moves{{{.distance = 0.05, .speed = 0.05},
                           {.distance = 0.2, .speed = 0.2},
                           {.distance = 0.3, .speed = 0.6}}};
  const auto run_of_it = stage.run(16, 1 / kRate_hz, [&](double t) { return moves.at(t); });
  const double count = 0.01 / (1 << 20), force_per_A = 300;
  const auto mass = [](const char* machine, const char* trace) {
    put("x.ini", machine);
    const Outcome o =
        run(std::string("identify idle --machine x.ini --json --out x2.ini --trace ") + trace);
    that(o.status == 0, o, "is learned", __LINE__);
    return Json(o.out).number("drives.0.equivalent_mass_kg.value");
  };
  write("x.csv",
        {reported(run_of_it, "x.angle_counts", "x.current_A", count, force_per_A, 0.02, 909)});
  const double torque = force_per_A * 0.01 / (2 * oracle::kPi);
  char text[200];
  std::snprintf(text, sizeof text,
                "[axis.x]\nlead_m = 0.01\nencoder_counts_per_rev = 1048576\n"
                "torque_constant_Nm_per_A = %.15g\n",
                torque);
  const double by_screw = mass(text, "x.csv");
  CHECK_NEAR(by_screw, stage.inertia, 0.01 * stage.inertia);
  // Two turns of the motor a turn of a screw of twice the lead.
  std::snprintf(text, sizeof text,
                "[axis.x]\nlead_m = 0.02\ngear_ratio = 2\nencoder_counts_per_rev = 1048576\n"
                "torque_constant_Nm_per_A = %.15g\n",
                torque);
  CHECK_NEAR(mass(text, "x.csv"), by_screw, 1e-9 * by_screw);

  // A scale, and a motor that pushes the stage itself.
  std::string linear = "t_s,x.position_m,x.current_A\n";
  oracle::Reporter reporter(1e-9, 0.02, 910);
  for (std::size_t i = 0; i < run_of_it.x.size(); ++i) {
    std::snprintf(text, sizeof text, "%.6f,%.9f,%.9g\n", static_cast<double>(i) / kRate_hz,
                  run_of_it.x[i], reporter.effort(run_of_it.effort[i] / force_per_A));
    linear += text;
  }
  put("linear.csv", linear);
  CHECK_NEAR(mass("[axis.x]\nforce_constant_N_per_A = 300\n", "linear.csv"), stage.inertia,
             0.01 * stage.inertia);
  // Nothing of it needs a lead.
  const Outcome o = run("monitor --machine x2.ini --trace linear.csv --estimates l.csv --json");
  that(o.status == 0, o, "is watched", __LINE__);
  CHECK_TEXT(Json(o.out).text("verdict"), "clear");
}

/// Two motors that also push against each other: their sum moves the stage.
void gantries_are_one_axis() {
  const IdlePlant stage;  // 227 kg
  const FeedProgram moves{{{.distance = 0.05, .speed = 0.05},
                           {.distance = 0.2, .speed = 0.2},
                           {.distance = 0.3, .speed = 0.6}}};
  const auto gantry = [&](const char* name, unsigned seed, const Load& load, double seconds) {
    const auto r = stage.run(
        seconds, 1 / kRate_hz, [&](double t) { return moves.at(t); }, load);
    auto racking = [&](std::size_t i, double sign) {
      return 0.5 * r.effort[i] + sign * 400 * std::sin(3 * static_cast<double>(i) / kRate_hz);
    };
    IdlePlant::Record one = r, other = r;
    for (std::size_t i = 0; i < r.x.size(); ++i) {
      one.effort[i] = racking(i, 1);
      other.effort[i] = racking(i, -1);
    }
    const double count = 0.01 / (1 << 20);
    write(name, {reported(one, "x.angle_counts", "x.current_A", count, 300, 0.02, seed),
                 reported(other, "x2.angle_counts", "x2.current_A", count, 300, 0.02, seed + 1)});
  };
  put("gantry.ini",
      "[axis.x]\ngantry = yes\nlead_m = 0.01\nencoder_counts_per_rev = 1048576\n"
      "force_constant_N_per_A = 300\n");
  gantry("gantry.csv", 111, nothing, 30);
  const Outcome o =
      run("identify idle --machine gantry.ini --trace gantry.csv --out both.ini --json");
  that(o.status == 0, o, "is learned", __LINE__);
  within_its_error(Json(o.out), "drives.0.equivalent_mass_kg", stage.inertia);
  within_its_error(Json(o.out), "drives.0.coulomb_friction_N", stage.coulomb);

  gantry("hit.csv", 113, between(3.3, 4, 900), 6);
  const Outcome hit =
      run("monitor --machine both.ini --trace hit.csv --estimates g.csv --json --fail-on-alarm");
  that(hit.status == 1, hit, "alarms", __LINE__);
  const Alarm alarm = first_alarm(Json(hit.out));
  CHECK_TEXT(alarm.monitor + " " + alarm.channel + " " + alarm.unit, "collision x N/s");
  CHECK(alarm.t_s > 3.3 && alarm.t_s < 3.32);
  CHECK_NEAR(mean(lines(content(folder / "g.csv")), 1, 3.4, 4), 900, 9);

  const Outcome same = run("reconcile --machine both.ini --trace gantry.csv --out g --json");
  that(same.status == 0, same, "compares", __LINE__);
  CHECK_TEXT(Json(same.out).text("verdict"), "agrees");

  // One motor alone is half of it.
  const Outcome half = run("monitor --machine both.ini --trace x.csv");
  that(half.status == 3, half, "is not taken for the whole", __LINE__);
  const Outcome made = run("simulate milling --machine both.ini --out no.csv");
  that(made.status == 3, made, "no cut on a gantry", __LINE__);
  put("motion.txt", "x limits 0.3 3 60\nx move 0.1\n");
  put("moved.ini", content(folder / "both.ini") +
                       "[controller.x]\nposition_gain_per_s = 40\nvelocity_gain_A_s_per_m = 40\n");
  const Outcome moved = run("simulate drive --machine moved.ini --motion motion.txt --out d.csv");
  that(moved.status == 0, moved, "moves", __LINE__);
  CHECK(contains(content(folder / "d.csv"),
                 "t_s,x.command_position_m,x.angle_counts,x.current_A,x2.current_A\n"));
}

void simulator_moves_them() {
  put("sim.ini", std::string("[machine]\nsample_rate_hz = 2000\n") + kTableAlone.substr(23) +
                     "[controller.a]\nposition_gain_per_s = 40\nvelocity_gain_A_s_per_rad = 12\n"
                     "[spindle2]\ninertia_kg_m2 = 0.02\n"
                     "[controller.spindle2]\nvelocity_gain_A_s_per_rad = 1\n");
  put("motion.txt",
      "a limits 3 20 400\na move 1\na load 40 0.2 0.4\nspindle2 limits 300 600 20000\n"
      "spindle2 cruise 100 1\n");
  const Outcome o = run("simulate drive --machine sim.ini --motion motion.txt --out s.csv --json");
  that(o.status == 0, o, "moves", __LINE__);
  const Json json(o.out);
  CHECK_NEAR(json.number("drives.0.largest_speed_rad_s"), 3, 0.3);
  CHECK_NEAR(json.number("drives.1.largest_speed_rad_s"), 100, 1);
  CHECK(contains(content(folder / "s.csv"),
                 "t_s,a.command_angle_rad,a.angle_counts,a.current_A,spindle2.angle_rad,"
                 "spindle2.current_A\n"));
  // A trace tells it as well.
  const Outcome again = run("simulate drive --machine sim.ini --motion s.csv --out t.csv --json");
  that(again.status == 0, again, "moves by a trace", __LINE__);
  CHECK_TEXT(Json(again.out).text("drives.0.channel"), "a");
}

/// A second spindle, a table and a gantry of one machine file, through every room: simulated,
/// learned from, watched, compared.
void through_every_room() {
  const auto file = [](bool truth) {
    std::string text =
        "[machine]\nsample_rate_hz = 2000\n[axis.x]\ngantry = yes\nlead_m = 0.01\n"
        "encoder_counts_per_rev = 1048576\nforce_constant_N_per_A = 300\n";
    if (truth)
      text +=
          "equivalent_mass_kg = 400\nviscous_friction_N_s_per_m = 900\ncoulomb_friction_N = 120\n"
          "[controller.x]\nposition_gain_per_s = 40\nvelocity_gain_A_s_per_m = 130\n"
          "current_noise_A = 0.02\n";
    text += "[axis.a]\ntorque_constant_Nm_per_A = 30\nencoder_counts_per_rev = 3600000\n";
    if (truth)
      text +=
          "inertia_kg_m2 = 2.5\nviscous_friction_Nm_s_per_rad = 12\ncoulomb_friction_Nm = 25\n"
          "[controller.a]\nposition_gain_per_s = 40\nvelocity_gain_A_s_per_rad = 15\n"
          "current_noise_A = 0.02\n";
    text += "[spindle2]\ntorque_constant_Nm_per_A = 0.8\nencoder_counts_per_rev = 1048576\n";
    if (truth)
      text +=
          "inertia_kg_m2 = 0.02\nviscous_friction_Nm_s_per_rad = 0.002\n"
          "coulomb_friction_Nm = 0.4\n[controller.spindle2]\nvelocity_gain_A_s_per_rad = 2\n"
          "current_noise_A = 0.02\n";
    return text;
  };
  put("made.ini", file(true));
  put("unknown.ini", file(false));
  std::string program = "x limits 0.4 4 80\na limits 3 20 400\nspindle2 limits 300 600 20000\n";
  for (int lap = 0; lap < 4; ++lap)
    program +=
        "x move 0.3\nx move 0.02 0.05\nx move 0.1 0.15\nx move 0\n"
        "a move 4\na move 3.8 0.2\na move 1 0.8\na move 0\n"
        "spindle2 cruise 250 0.7\nspindle2 cruise -60 0.7\nspindle2 cruise 20 0.7\n"
        "spindle2 cruise -250 0.7\n";
  put("rooms.txt", program);
  const Outcome made =
      run("simulate drive --machine made.ini --motion rooms.txt --out rooms.csv --json");
  that(made.status == 0, made, "simulates", __LINE__);

  const Outcome learned =
      run("identify idle --machine unknown.ini --trace rooms.csv --out known.ini --json");
  that(learned.status == 0, learned, "learns", __LINE__);
  const Json json(learned.out);
  std::string channels;
  for (int i = 0; json.scalars.contains("drives." + std::to_string(i) + ".channel"); ++i) {
    const std::string drive = "drives." + std::to_string(i);
    const std::string channel = json.text(drive + ".channel");
    channels += channel + " ";
    within_its_error(json, drive + (channel == "x" ? ".equivalent_mass_kg" : ".inertia_kg_m2"),
                     channel == "x"   ? 400
                     : channel == "a" ? 2.5
                                      : 0.02);
  }
  CHECK_TEXT(channels, "x a spindle2 ");

  const Outcome watched = run("monitor --machine known.ini --trace rooms.csv --json");
  that(watched.status == 0, watched, "watches", __LINE__);
  CHECK_TEXT(first_alarm(Json(watched.out)).monitor, "");
  for (const std::string channel : {"x", "a", "spindle2"}) {
    const Outcome same = run("reconcile --machine known.ini --trace rooms.csv --channel " +
                             channel + " --out same_" + channel + " --json");
    that(same.status == 0, same, "compares", __LINE__);
    CHECK_TEXT(Json(same.out).text("verdict"), "agrees");
  }
}

void what_is_left_out_is_said() {
  put("export.ini", std::string("[machine]\nsample_rate_hz = 2000\n[axis.x]\nlead_m = 0.01\n"
                                "equivalent_mass_kg = 200\nforce_constant_N_per_A = 300\n") +
                        kTableAlone.substr(23) + "[spindle2]\ninertia_kg_m2 = 0.02\n");
  const Outcome exported = run("export --c export.ini --out export.h");
  that(exported.status == 0, exported, "is written", __LINE__);
  CHECK(!contains(exported.out, "[axis.a] is not carried over"));
  const std::string header = content(folder / "export.h");
  CHECK(contains(header, "#if SERVOSENSE_AXES < 4"));
  CHECK(contains(exported.out, "room for one spindle, x, y, z, a, b and c"));
  CHECK(contains(exported.out, "[spindle2] is not carried over"));
  // A drive in the trace that the file does not know.
  put("no.ini", "[spindle2]\nencoder_counts_per_rev = 1048576\n");
  const Outcome o = run("monitor --machine no.ini --trace sound.csv");
  that(contains(o.out, "no section [axis.a]"), o, "says which section lacks", __LINE__);
  put("wrong.ini", "[axis.a]\nlead_m = 0.01\n");
  CHECK(contains(run("monitor --machine wrong.ini --trace sound.csv").err, "unknown key 'lead_m'"));
  const Outcome channel = run("reconcile --machine table.ini --trace null.csv --channel u --out u");
  that(channel.status == 2 && contains(channel.err, "a, b, c, spindle or spindle2"), channel,
       "names the channels", __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("machines", [] {
    idle_run_is_learned();
    torques_are_followed();
    sound_motion_is_silent();
    contact_on_the_table_is_found();
    chatter_on_the_second_spindle_is_found();
    table_reconciles();
    gears_are_seen_through();
    screws_belts_and_linear_motors();
    gantries_are_one_axis();
    simulator_moves_them();
    through_every_room();
    what_is_left_out_is_said();
  });
}
