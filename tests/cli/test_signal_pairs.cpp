// Signals that come in pairs, through the commands: motor and scale, command and motion, commanded
// and measured effort, one motor of two, and the sides of a gantry. Drives of an own generator
// (tests/oracles/paired_drive.hpp). `--nightly`: more seeds, misses and false alarms counted.
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "oracles/idle_plant.hpp"
#include "oracles/paired_drive.hpp"
#include "program.hpp"

namespace {

using namespace program_test;
using oracle::CascadeLoop;
using oracle::FeedProgram;
using oracle::Gantry;
using oracle::LoadedDrive;
using oracle::PairRow;

constexpr double kRate_hz = 2000, kLead = 0.01, kCounts = 1 << 17, kConstant = 300;
const FeedProgram kMoves{{{.distance = 0.05, .speed = 0.05, .dwell_s = 0.3},
                          {.distance = 0.3, .speed = 0.2},
                          {.distance = 0.4, .speed = 0.5, .ramp_s = 0.12}}};
double moves(double t) { return kMoves.at(t).x; }
double nothing(double) { return 0; }

const char* const kFile =
    "[machine]\nsample_rate_hz = 2000\n[axis.x]\nlead_m = 0.01\nencoder_counts_per_rev = 131072\n"
    "force_constant_N_per_A = 300\n";

struct Says {
  bool scale = false, following = false, command = false, told = false, effort = true,
       motion = true;
  double effort_part = 1, scale_part = 1;
  std::function<double(double)> slip = nothing;  // of the scale
};

void write(const std::string& name, const std::vector<PairRow>& rows, unsigned seed,
           const Says& says) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::string text = says.motion ? "t_s,x.angle_counts" : "t_s";
  if (says.effort) text += ",x.current_A";
  if (says.scale) text += ",x.position_m";
  if (says.following) text += ",x.following_error_m";
  if (says.command) text += ",x.command_position_m";
  if (says.told) text += ",x.command_current_A";
  text += '\n';
  char field[64];
  const auto put_field = [&](const char* format, double value) {
    std::snprintf(field, sizeof field, format, value);
    text += field;
  };
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const PairRow& r = rows[i];
    const double t = static_cast<double>(i) / kRate_hz;
    const double counted = std::floor(r.motor / kLead * kCounts + 0.3);
    put_field("%.4f", t);
    if (says.motion) put_field(",%.0f", counted + 5000);
    if (says.effort)
      put_field(",%.5f", says.effort_part * r.effort / kConstant + 0.01 * normal(random));
    if (says.scale)  // lines of 1 um, a screw 40 um/m long, 3 um out of true once a turn
      put_field(",%.6f", says.scale_part * (0.1 + r.load * (1 + 40e-6) + says.slip(t) +
                                            3e-6 * std::sin(2 * oracle::kPi * r.motor / kLead)));
    if (says.following) put_field(",%.7f", r.command - counted * kLead / kCounts);
    if (says.command) put_field(",%.7f", r.command);
    if (says.told) put_field(",%.5f", r.told / kConstant);
    text += '\n';
  }
  put(name, text);
}

double off(const Json& json, const std::string& path, double truth) {
  const double errors =
      std::abs(json.number(path + ".value") - truth) / json.number(path + ".standard_error");
  check::figure(path + ", off by so many standard errors", errors);
  return errors;
}

/// Events of that monitor and state.
int events(const Json& json, const std::string& monitor, const std::string& state,
           const std::string& reason = "") {
  int n = 0;
  for (int i = 0; json.scalars.contains("events." + std::to_string(i) + ".state"); ++i) {
    const std::string e = "events." + std::to_string(i);
    n += json.text(e + ".monitor") == monitor && json.text(e + ".state") == state &&
         contains(json.text(e + ".reason"), reason);
  }
  return n;
}

LoadedDrive drive_with_play(double play) {
  LoadedDrive d;
  d.play = play;
  return d;
}

void motor_and_scale(unsigned seed) {
  LoadedDrive d = drive_with_play(30e-6);
  write("idle.csv", d.run(26, 1 / kRate_hz, moves, nothing), seed, {.scale = true});
  put("m.ini", std::string(kFile) + "moving_mass_kg = 100\n");
  const Outcome o = run("identify idle --machine m.ini --trace idle.csv --out learned.ini --json");
  that(o.status == 0, o, "learns", __LINE__);
  const Json json(o.out);
  CHECK(off(json, "drives.0.backlash_m", 30e-6) < 4);
  CHECK(json.number("drives.0.backlash_m.standard_error") < 6e-6);
  // The load swings at sqrt(k / m2) while the motor is held.
  const double held = std::sqrt(d.stiffness / d.load_kg) / (2 * oracle::kPi);
  CHECK(off(json, "drives.0.held_resonance_hz", held) < 4);
  CHECK(json.number("drives.0.held_resonance_hz.standard_error") < 0.1 * held);
  CHECK(off(json, "drives.0.lead_error_slope", 40e-6) < 4);
  CHECK(off(json, "drives.0.lead_error_once_m", 3e-6) < 4);
  const std::string learned = content(folder / "learned.ini");
  CHECK(contains(learned, "[effect.x.backlash]\nwidth_m = "));
  CHECK(contains(learned, "[effect.x.flexible-coupling]\nresonance_hz = "));
  CHECK(contains(learned, "[monitor.signal.x]\nload_band_m = "));
  CHECK(!contains(o.out, "not used by this command: x.position_m"));

  // Sound, with a cut of 500 N; then a belt that gives way by 0.4 mm.
  const auto cut = [](double t) { return t > 5 && t < 8 ? 500.0 : 0.0; };
  write("sound.csv", d.run(12, 1 / kRate_hz, moves, cut), seed + 1, {.scale = true});
  const Outcome sound = run("monitor --machine learned.ini --trace sound.csv --json");
  CHECK(sound.status == 0 && events(Json(sound.out), "signal", "warning") == 0);
  CHECK_TEXT(Json(sound.out).text("pairs.0.pair"), "load");
  CHECK_TEXT(Json(sound.out).text("pairs.0.runs"), "true");
  CHECK(Json(sound.out).number("pairs.0.watched_s") > 11);
  write("slip.csv", d.run(12, 1 / kRate_hz, moves, nothing), seed + 2,
        {.scale = true, .slip = [](double t) { return t > 6 ? -0.4e-3 : 0.0; }});
  const Outcome slip = run("monitor --machine learned.ini --trace slip.csv --json");
  const Json slipped(slip.out);
  that(events(slipped, "signal", "warning", "an encoder slips") == 1, slip, "warns", __LINE__);
  CHECK_TEXT(slipped.text("verdict"), "warning");
}

/// Holes, rows that are no good, and a counter and scale that begin elsewhere: none is a slip.
void faults_are_no_slip() {
  LoadedDrive d = drive_with_play(30e-6);
  write("sound.csv", d.run(12, 1 / kRate_hz, moves, nothing), 15, {.scale = true});
  const std::vector<std::string> rows = lines(content(folder / "sound.csv"));
  std::string text = rows[0] + "\n";
  for (std::size_t i = 1; i < rows.size(); ++i) {
    if (i > 8000 && i < 8300) continue;  // the axis goes on
    std::string row = rows[i];
    if (i % 3001 == 0) row = row.substr(0, row.rfind(',')) + ",nan";
    text += row + "\n";
  }
  put("holes.csv", text);
  const Outcome o = run("monitor --machine learned.ini --trace holes.csv --json");
  const Json json(o.out);
  CHECK(events(json, "signal", "warning", "come apart") == 0);
  CHECK(json.number("pairs.0.watched_s") > 8);
}

/// A table whose motor sits behind a gear, with an encoder of its own: rad, Nm and kg m2.
void table_with_an_encoder() {
  LoadedDrive d = drive_with_play(40e-6);
  const auto rows = d.run(26, 1 / kRate_hz, moves, nothing);
  std::string text = "t_s,a.angle_counts,a.torque_Nm,a.angle_rad\n";
  char line[120];
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::snprintf(line, sizeof line, "%.4f,%.0f,%.3f,%.7f\n", static_cast<double>(i) / kRate_hz,
                  std::floor(rows[i].motor / (2 * oracle::kPi) * 90 * 131072), rows[i].effort,
                  rows[i].load);
    text += line;
  }
  put("table.csv", text);
  put("table.ini",
      "[machine]\nsample_rate_hz = 2000\n[axis.a]\nencoder_counts_per_rev = 131072\n"
      "gear_ratio = 90\n");
  const Outcome o = run("identify idle --machine table.ini --trace table.csv --out t.ini --json");
  that(o.status == 0, o, "learns", __LINE__);
  CHECK(off(Json(o.out), "drives.0.backlash_rad", 40e-6) < 4);
  CHECK(contains(content(folder / "t.ini"), "[effect.a.backlash]\nwidth_rad = "));
  put("table.ini",
      "[machine]\nsample_rate_hz = 2000\n[axis.a]\nencoder_counts_per_rev = 131072\n"
      "gear_ratio = 45\n");
  refused("identify idle --machine table.ini --trace table.csv --out no.ini", 3,
          {"0.5 times as far", "gear_ratio", "[axis.a]"}, __LINE__);
}

/// The command that a following error tells drives the simulation under the controller as well.
void reconcile_hears_the_error() {
  put("sim.ini", std::string(kFile) +
                     "equivalent_mass_kg = 200\nviscous_friction_N_s_per_m = 600\n"
                     "coulomb_friction_N = 90\n[controller.x]\nposition_gain_per_s = 40\n"
                     "velocity_gain_A_s_per_m = 120\nvelocity_integral_per_s = 20\n");
  put("motion.txt",
      "x limits 0.4 5 100\nx move 0.2\nx move 0\nx move 0.1 0.05\nx move 0 0.1\n"
      "x move 0.3\nx move 0\n");
  const Outcome made = run("simulate drive --machine sim.ini --motion motion.txt --out told.csv");
  that(made.status == 0, made, "moves", __LINE__);
  const std::vector<std::string> rows = lines(content(folder / "told.csv"));
  std::string text;
  for (const std::string& row : rows) {
    if (row.starts_with("#")) continue;
    if (row.starts_with("t_s")) {
      CHECK_TEXT(row, "t_s,x.command_position_m,x.angle_counts,x.current_A");
      text += "t_s,x.following_error_m,x.angle_counts,x.current_A\n";
      continue;
    }
    double t = 0, command = 0, counts = 0, current = 0;
    std::sscanf(row.c_str(), "%lf,%lf,%lf,%lf", &t, &command, &counts, &current);
    char line[120];
    std::snprintf(line, sizeof line, "%.6f,%.9f,%.0f,%.9g\n", t, command - counts * kLead / kCounts,
                  counts, current);
    text += line;
  }
  put("behind.csv", text);
  const Outcome a = run("reconcile --machine sim.ini --trace told.csv --out told --json");
  const Outcome b = run("reconcile --machine sim.ini --trace behind.csv --out behind --json");
  const std::string key = "proof.closed_loop.following_error";
  that(b.status == 0, b, "compares", __LINE__);
  const double told = Json(a.out).number(key), behind = Json(b.out).number(key);
  check::figure("following error that reconcile reads, of a command", told, "m");
  CHECK(told > 1e-4);
  CHECK_NEAR(behind, told, 0.01 * told);
}

void without_play() {
  LoadedDrive d = drive_with_play(0);
  write("rigid.csv", d.run(26, 1 / kRate_hz, moves, nothing), 21, {.scale = true});
  const Outcome o = run("identify idle --machine m.ini --trace rigid.csv --out rigid.ini --json");
  that(o.status == 0, o, "learns", __LINE__);
  CHECK(!contains(content(folder / "rigid.ini"), "[effect.x.backlash]"));
  CHECK(off(Json(o.out), "drives.0.backlash_m", 0) < 3);
}

void what_does_not_match_is_refused() {
  LoadedDrive d;
  const auto rows = d.run(14, 1 / kRate_hz, moves, nothing);
  put("m.ini", kFile);
  write("half.csv", rows, 31, {.scale = true, .scale_part = 0.5});
  refused("identify idle --machine m.ini --trace half.csv --out no.ini", 3,
          {"0.5 times as far", "lead_m", "encoder_counts_per_rev", "[axis.x]"}, __LINE__);
  write("turned.csv", rows, 32, {.scale = true, .scale_part = -1});
  refused("identify idle --machine m.ini --trace turned.csv --out no.ini", 3,
          {"counts against the motor"}, __LINE__);
}

CascadeLoop lagging() {
  CascadeLoop loop;
  loop.lag_s = 1.5e-3;
  loop.limit = 3000;
  return loop;
}

void command_and_motion() {
  LoadedDrive d;
  d.loop = lagging();
  for (const bool error : {true, false}) {
    const Says says{.following = error, .command = !error, .told = true};
    d.loop = lagging();
    write("idle.csv", d.run(26, 1 / kRate_hz, moves, nothing), 41, says);
    put("m.ini", std::string(kFile) + "[controller.x]\ncurrent_limit_A = 10\n");
    const Outcome o = run("identify idle --machine m.ini --trace idle.csv --out f.ini --json");
    that(o.status == 0, o, "learns", __LINE__);
    const Json json(o.out);
    // e = (v + (viscous v + ...) / D) / Kv
    const double time = (1 + 500 / d.loop.damping) / d.loop.gain_per_s;
    CHECK(off(json, "drives.0.following_time_s", time) < 4);
    CHECK(json.number("drives.0.following_time_s.standard_error") < 0.02 * time);
    CHECK(contains(content(folder / "f.ini"), "position_gain_per_s = 39.5"));
    CHECK(off(json, "drives.0.command_delay_s", 1.5e-3) < 4);
    CHECK(json.number("drives.0.command_delay_s.standard_error") < 3e-4);

    d.loop = lagging();
    write("cut.csv",
          d.run(10, 1 / kRate_hz, moves, [](double t) { return t > 4 && t < 6 ? 400.0 : 0.0; }), 42,
          says);
    const Outcome cut = run("monitor --machine f.ini --trace cut.csv --json");
    CHECK(cut.status == 0 && events(Json(cut.out), "signal", "warning", "command") == 0);
    // Against a wall: the effort is at its limit and the command goes on.
    d.loop = lagging();
    write("wall.csv",
          d.run(8, 1 / kRate_hz, moves, [](double t) { return t > 4.5 ? 3500.0 : 0.0; }), 43, says);
    const Outcome wall = run("monitor --machine f.ini --trace wall.csv --json");
    that(events(Json(wall.out), "collision", "alarm", "pushes against something") == 1, wall,
         "says that it pushes", __LINE__);
  }
  // Switched off: it is told and does not give.
  d.loop = lagging();
  auto rows = d.run(8, 1 / kRate_hz, moves, nothing);
  for (std::size_t i = 9000; i < rows.size(); ++i) rows[i].effort *= 0.2;
  write("off.csv", rows, 44, {.command = true, .told = true});
  const Outcome o = run("monitor --machine f.ini --trace off.csv --json");
  that(events(Json(o.out), "signal", "warning", "off what it is told to") >= 1, o, "says it",
       __LINE__);
}

void command_stands_in() {
  LoadedDrive d;
  d.loop = lagging();
  write("told.csv", d.run(26, 1 / kRate_hz, moves, nothing), 51, {.told = true, .effort = false});
  put("m.ini", kFile);
  const Outcome o = run("identify idle --machine m.ini --trace told.csv --out told.ini --json");
  that(o.status == 0, o, "learns", __LINE__);
  CHECK(contains(o.out, "x.command_current_A stands for its effort"));
  CHECK(off(Json(o.out), "drives.0.equivalent_mass_kg", d.mass()) < 4);
}

/// A record of what the axis was told and how far it was behind tells how it moved.
void motion_by_the_command() {
  LoadedDrive d;
  const auto rows = d.run(26, 1 / kRate_hz, moves, nothing);
  const Says both{.following = true, .command = true, .motion = false};
  write("behind.csv", rows, 55, both);
  write("counted.csv", rows, 55, {});
  put("m.ini", kFile);
  const Outcome o = run("identify idle --machine m.ini --trace behind.csv --out b.ini --json");
  that(o.status == 0, o, "learns", __LINE__);
  CHECK(off(Json(o.out), "drives.0.equivalent_mass_kg", d.mass()) < 4);
  CHECK(contains(o.out, "x.position_m is x.command_position_m less x.following_error_m"));
  const Outcome counted =
      run("identify idle --machine m.ini --trace counted.csv --out c.ini --json");
  CHECK_NEAR(Json(o.out).number("drives.0.equivalent_mass_kg.value"),
             Json(counted.out).number("drives.0.equivalent_mass_kg.value"), 1e-3 * d.mass());
  const Outcome watched = run("monitor --machine b.ini --trace behind.csv --json");
  that(watched.status == 0 && events(Json(watched.out), "collision", "alarm") == 0, watched,
       "watches", __LINE__);
  const Outcome compared = run("reconcile --machine b.ini --trace behind.csv --out rb --json");
  that(compared.status == 0, compared, "compares", __LINE__);
  CHECK(contains(compared.out, "x.position_m is x.command_position_m less"));
}

void one_motor_of_two() {
  LoadedDrive d;
  write("one.csv", d.run(26, 1 / kRate_hz, moves, nothing), 61, {.effort_part = 0.47});
  put("m.ini", std::string(kFile) + "effort_share = 0.5\neffort_share_error = 0.03\n");
  const Outcome o = run("identify idle --machine m.ini --trace one.csv --out one.ini --json");
  that(o.status == 0, o, "learns", __LINE__);
  const Json json(o.out);
  CHECK(off(json, "drives.0.equivalent_mass_kg", d.mass()) < 3);
  CHECK_NEAR(json.number("drives.0.equivalent_mass_kg.value"), 0.94 * d.mass(), 0.01 * d.mass());
  CHECK(json.number("drives.0.coulomb_friction_N.standard_error") > 0.06 * 90);
  CHECK(contains(o.out, "0.5 +- 0.03 of the effort"));
  const Outcome seen = run("monitor --machine one.ini --trace one.csv --json");
  CHECK(contains(seen.out, "a force on the other motor's side may show as less"));
}

void write_gantry(const std::string& name, Gantry g, double seconds, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto rows = g.run(seconds, 1 / kRate_hz, moves);
  std::string text = "t_s,x.angle_counts,x.current_A,x2.angle_counts,x2.current_A\n";
  char line[160];
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::snprintf(line, sizeof line, "%.4f,%.0f,%.5f,%.0f,%.5f\n",
                  static_cast<double>(i) / kRate_hz,
                  std::floor(rows[i].x[0] / kLead * kCounts + 0.3),
                  rows[i].effort[0] / kConstant + 0.01 * normal(random),
                  std::floor(rows[i].x[1] / kLead * kCounts + 0.8),
                  rows[i].effort[1] / kConstant + 0.01 * normal(random));
    text += line;
  }
  put(name, text);
}

std::function<double(double)> from(double t0, double value) {
  return [=](double t) { return t > t0 ? value : 0.0; };
}
/// Grows in a second.
std::function<double(double)> grows(double t0, double value) {
  return [=](double t) { return value * std::clamp(t - t0, 0.0, 1.0); };
}

/// A gantry of its own for every seed.
Gantry gantry_of(unsigned seed) {
  std::mt19937 random(seed);
  const auto within = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  Gantry g;
  g.side_kg = within(100, 200);
  g.beam_stiffness = within(1e6, 6e6);
  g.crooked_m = within(5e-6, 40e-6);
  for (int s = 0; s < 2; ++s) {
    g.at_side[s].coulomb = within(40, 90);
    g.at_side[s].viscous = within(200, 500);
    g.loop[s].damping = 200 * g.side_kg;
    g.loop[s].integral_per_s = 30;
  }
  return g;
}

/// Learns the gantry of a seed as `both.ini`.
void learn_gantry(unsigned seed) {
  put("gantry.ini", std::string(kFile) + "gantry = yes\n");
  write_gantry("gantry.csv", gantry_of(seed), 26, seed);
  const Outcome o =
      run("identify idle --machine gantry.ini --trace gantry.csv --out both.ini --json");
  that(o.status == 0, o, "learns both sides", __LINE__);
  const std::string learned = content(folder / "both.ini");
  CHECK(contains(learned, "skew_band_m = ") && contains(learned, "skew_effort_band_N = "));
}

/// Alarms on the difference of the two sides, and of those the ones with that reason.
struct Racked {
  int alarms = 0, named = 0;
};
Racked racked(const Gantry& g, unsigned seed, const std::string& reason) {
  write_gantry("run.csv", g, 12, seed);
  const Json json(run("monitor --machine both.ini --trace run.csv --json").out);
  return {events(json, "signal", "alarm"), events(json, "signal", "alarm", reason)};
}

void gantries(unsigned seed) {
  learn_gantry(seed);
  put("m.ini", std::string(kFile) + "effort_share = 0.5\ngantry = yes\n");
  refused("monitor --machine m.ini --trace gantry.csv", 3, {"effort_share", "gantry"}, __LINE__);
  const Gantry sound = gantry_of(seed);
  CHECK(racked(sound, seed + 1, "").alarms == 0);
  Gantry g = sound;
  // Found while it moves back, and while it moves forward.
  for (const double t : {5.0, 6.0}) {
    g.binds[1] = from(t, 350);
    CHECK(racked(g, seed + 2, "x2 gives").named >= 1);
  }
  g = sound;
  g.drift[1] = grows(5, 0.4e-3);
  CHECK(racked(g, seed + 3, "push against each other").named >= 1);
  // A cut beside one of the guides is none of it.
  g = sound;
  g.load[1] = from(5, 400);
  CHECK(racked(g, seed + 4, "push against each other").named == 0);
}

/// Misses and false alarms over many machines.
void many_gantries() {
  int wrong = 0, missed_binding = 0, missed_drift = 0, runs = 0;
  for (unsigned seed = 9100; seed < 9130; ++seed, ++runs) {
    learn_gantry(seed);
    const Gantry sound = gantry_of(seed);
    wrong += racked(sound, seed + 1000, "").alarms > 0;
    Gantry g = sound;
    g.binds[1] = from(5, 350);
    missed_binding += racked(g, seed + 2000, "").alarms == 0;
    g = sound;
    g.drift[0] = grows(5, 0.4e-3);
    missed_drift += racked(g, seed + 3000, "").alarms == 0;
  }
  check::figure("gantries", runs);
  check::figure("sound runs of 12 s with an alarm", wrong);
  check::figure("guides that bind, missed", missed_binding);
  check::figure("encoders that drift, missed", missed_drift);
  CHECK(wrong == 0 && missed_binding <= 3 && missed_drift <= 3);
}

/// Drives of their own: a belt that gives way by a tenth of a millimetre or more, and cuts.
void many_drives() {
  int wrong = 0, missed = 0, runs = 0;
  double worst = 0, worst_held = 0;
  for (unsigned seed = 9300; seed < 9330; ++seed, ++runs) {
    std::mt19937 random(seed);
    const auto within = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    LoadedDrive d;
    d.motor_kg = within(60, 200);
    d.load_kg = within(60, 200);
    d.stiffness = within(2e7, 1e8);
    d.damping = 0.1 * std::sqrt(d.stiffness * d.load_kg);
    d.play = within(0, 60e-6);
    d.at_motor.coulomb = within(20, 90);
    d.at_load.coulomb = within(20, 90);
    d.loop.damping = 200 * d.mass();
    d.loop.lag_s = 1e-3;
    const double size = within(0.1e-3, 0.4e-3), cut = within(200, 800);
    const LoadedDrive rest = d;
    write("idle.csv", d.run(26, 1 / kRate_hz, moves, nothing), seed, {.scale = true});
    put("m.ini", kFile);
    const Json learned(
        run("identify idle --machine m.ini --trace idle.csv --out many.ini --json").out);
    const auto errors = [&](const std::string& path, double truth) {
      return std::abs(learned.number(path + ".value") - truth) /
             learned.number(path + ".standard_error");
    };
    worst = std::max(worst, errors("drives.0.backlash_m", d.play));
    worst_held =
        std::max(worst_held, errors("drives.0.held_resonance_hz",
                                    std::sqrt(d.stiffness / d.load_kg) / (2 * oracle::kPi)));
    d = rest;
    write("run.csv", d.run(12, 1 / kRate_hz, moves, from(5, cut)), seed + 1000, {.scale = true});
    wrong += events(Json(run("monitor --machine many.ini --trace run.csv --json").out), "signal",
                    "warning") > 0;
    d = rest;
    write("run.csv", d.run(12, 1 / kRate_hz, moves, nothing), seed + 2000,
          {.scale = true, .slip = from(5, size)});
    missed += events(Json(run("monitor --machine many.ini --trace run.csv --json").out), "signal",
                     "warning") == 0;
  }
  check::figure("drives with a scale", runs);
  check::figure("backlash, off by so many standard errors at most", worst);
  check::figure("held resonance, likewise", worst_held);
  check::figure("sound runs of 12 s with a cut and a warning", wrong);
  check::figure("slips of 0.1 to 0.4 mm, missed", missed);
  CHECK(worst < 4 && worst_held < 4);
  CHECK(wrong == 0 && missed <= 6);
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  return in_own_folder("signal_pairs", [&] {
    motor_and_scale(11);
    faults_are_no_slip();
    without_play();
    table_with_an_encoder();
    reconcile_hears_the_error();
    what_does_not_match_is_refused();
    command_and_motion();
    command_stands_in();
    motion_by_the_command();
    one_motor_of_two();
    gantries(71);
    if (nightly) many_gantries();
    if (nightly) many_drives();
  });
}
