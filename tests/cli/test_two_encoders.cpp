// Drives that turn, with an encoder at the motor and one at the load, through `reconcile`: how wide
// the backlash is and how stiff the drive, from what lies between the two. Tables behind a gear and
// spindles behind a belt, of a generator of its own (tests/oracles/paired_drive.hpp), with errors
// of both encoders. `--nightly`: more of them; of other seeds with the first and how many.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>

#include "check.hpp"
#include "oracles/idle_plant.hpp"
#include "oracles/paired_drive.hpp"
#include "program.hpp"

namespace {

using namespace program_test;
using oracle::LoadedDrive;

constexpr double kRate_hz = 2000, kTurn = 2 * oracle::kPi;

struct Machine {
  const char* channel;
  const char* section;
  double gear = 1;
  double counts = 1 << 17;    // a turn of the motor
  double step = 1e-6;         // of the load's encoder [rad]
  double own_error = 20e-6;   // of that, once a turn [rad]
  double motor_error = 5e-6;  // of the motor's, at the load, once a turn of it
  bool begins_anew = false;   // the load's angle, with every turn
  LoadedDrive drive{};
  std::function<double(double)> command{};
  double run_s = 30;

  [[nodiscard]] double held_hz() const {
    return std::sqrt(drive.stiffness / drive.load_kg) / kTurn;
  }
};

double between(std::mt19937& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

/// Inertia, spring, friction and loop: `inertia` kg m2 in all, friction that stops a drive in
/// `stops_s` from `speed`.
void draw_drive(std::mt19937& random, Machine& m, double inertia, double friction) {
  LoadedDrive& d = m.drive;
  const double share = between(random, 0.3, 0.7), held = kTurn * between(random, 40, 110);
  d.load_kg = share * inertia;
  d.motor_kg = inertia - d.load_kg;
  d.stiffness = d.load_kg * held * held;
  d.damping = 2 * between(random, 0.03, 0.08) * held * d.load_kg;
  const double at_load = between(random, 0.2, 0.8);
  const double knee = 1e-4 * between(random, 0.3, 1);
  d.at_motor = {(1 - at_load) * friction, 0.3 * (1 - at_load) * friction, knee};
  d.at_load = {at_load * friction, 0.3 * at_load * friction, knee};
  d.loop.damping = between(random, 100, 200) * inertia;
  d.loop.lag_s = 5e-4;
}

/// A rotary table: 90 turns of the motor, two turns and more to and fro.
Machine table(unsigned seed, bool play) {
  std::mt19937 random(seed);
  Machine m{.channel = "a", .section = "axis.a", .gear = 90};
  const double inertia = between(random, 4, 20);
  draw_drive(random, m, inertia, inertia * between(random, 1, 4));
  if (play) m.drive.play = between(random, 60e-6, 400e-6);
  const double far = between(random, 10, 14);
  m.command =
      [moves = oracle::FeedProgram{
           {{.distance = 0.4, .speed = between(random, 0.2, 0.4), .dwell_s = 0.3},
            {.distance = 2, .speed = between(random, 0.8, 1.2), .ramp_s = 0.1},
            {.distance = far, .speed = between(random, 2.5, 3.5), .ramp_s = 0.2}}}](double t) {
        return moves.at(t).x;
      };
  return m;
}

/// A spindle behind a belt, which has no play; its angle begins anew with every turn.
Machine spindle(unsigned seed) {
  std::mt19937 random(seed);
  Machine m{.channel = "spindle",
            .section = "spindle",
            .gear = 1.5,
            .counts = 1 << 16,
            .step = kTurn / (1 << 18),
            .own_error = 100e-6,
            .motor_error = 100e-6,
            .begins_anew = true};
  const double inertia = between(random, 0.01, 0.05);
  draw_drive(random, m, inertia, inertia * between(random, 20, 60));
  for (oracle::Rubbing* rubs : {&m.drive.at_motor, &m.drive.at_load}) {
    rubs->viscous *= 0.05;
    rubs->knee *= 10;
  }
  oracle::SpeedProgram speeds{0.25, 0.5, {0, 40, 120, 20, -60, -150, -30, 80, 0}};
  m.command = [speeds](double t) { return speeds.at(std::fmod(t, speeds.length_s())).x; };
  m.run_s = 5 * speeds.length_s();
  return m;
}

void write(const Machine& m, unsigned seed) {
  std::mt19937 random(seed + 77);
  std::normal_distribution<double> normal;
  const double phase = between(random, 0, kTurn);
  LoadedDrive drive = m.drive;
  const auto rows = drive.run(m.run_s, 1 / kRate_hz, m.command, [](double) { return 0.0; });
  const double noise = 0.005 * drive.loop.damping;
  const std::string name = m.channel;
  std::string text =
      "t_s," + name + ".angle_counts," + name + ".torque_Nm," + name + ".angle_rad\n";
  char line[160];
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double motor =
        rows[i].motor + m.motor_error * std::sin(m.gear * rows[i].motor + 2 * phase);
    double load = rows[i].load + m.own_error * std::sin(rows[i].load + phase) + 0.37;
    if (m.begins_anew) load -= kTurn * std::floor(load / kTurn);
    std::snprintf(line, sizeof line, "%.4f,%.0f,%.5g,%.8f\n", static_cast<double>(i) / kRate_hz,
                  std::floor(motor / kTurn * m.gear * m.counts),
                  rows[i].effort + noise * normal(random), m.step * std::round(load / m.step));
    text += line;
  }
  put("moves.csv", text);
  // What the file says is somewhat off.
  char file[400];
  std::snprintf(file, sizeof file,
                "[machine]\nsample_rate_hz = %g\n[%s]\nencoder_counts_per_rev = %g\ngear_ratio = "
                "%g\ninertia_kg_m2 = %.6g\nviscous_friction_Nm_s_per_rad = %.6g\n"
                "coulomb_friction_Nm = %.6g\n",
                kRate_hz, m.section, m.counts, m.gear, 1.05 * drive.mass(),
                0.9 * (drive.at_motor.viscous + drive.at_load.viscous),
                1.1 * (drive.at_motor.coulomb + drive.at_load.coulomb));
  put("machine.ini", file);
}

struct Tally {
  int drives = 0, with_play = 0, named = 0, wrongly = 0, stiff = 0;
  double worst_width = 0, worst_width_share = 0, worst_held = 0, worst_held_share = 0;
};

void judge(const Machine& m, unsigned seed, Tally& tally) {
  write(m, seed);
  const Outcome o = run("reconcile --machine machine.ini --trace moves.csv --out found --json");
  that(o.status == 0, o, "compares", __LINE__);
  const Json json(o.out);
  bool named = false;
  double width = std::nan("");
  for (int i = 0; json.scalars.contains("effects." + std::to_string(i) + ".name"); ++i) {
    const std::string e = "effects." + std::to_string(i);
    if (json.text(e + ".name") != "backlash") continue;
    named = true;
    width = json.number(e + ".parameters.width_rad");
  }
  ++tally.drives;
  const bool play = m.drive.play > 0;
  tally.with_play += play;
  tally.named += play && named;
  tally.wrongly += !play && named;
  const auto told = [&](const char* what, double truth, double& worst, double& share) {
    const std::string key = std::string("between_encoders.") + what;
    const double value = json.number(key + ".value"), error = json.number(key + ".standard_error");
    if (!std::isfinite(value)) return std::nan("");
    worst = std::max(worst, std::abs(value - truth) / error);
    if (truth > 0) share = std::max(share, std::abs(value / truth - 1));
    return value;
  };
  const double gap = told("backlash", m.drive.play, tally.worst_width, tally.worst_width_share);
  const double held =
      told("held_resonance_hz", m.held_hz(), tally.worst_held, tally.worst_held_share);
  tally.stiff += std::isfinite(held);
  std::printf(
      "  %s, seed %u: play %.1f, between encoders %.1f +- %.1f urad, %s; held %.1f Hz, %.1f +- "
      "%.1f; left %.2g urad; %s\n",
      m.channel, seed, 1e6 * m.drive.play, 1e6 * gap,
      1e6 * json.number("between_encoders.backlash.standard_error"),
      named ? ("named, " + std::to_string(1e6 * width)).c_str() : "not named", m.held_hz(), held,
      json.number("between_encoders.held_resonance_hz.standard_error"),
      1e6 * json.number("between_encoders.left"), json.text("summary").c_str());
  that(json.text("between_encoders.unit") == "rad", o, "compares the encoders", __LINE__);
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  return in_own_folder("two_encoders", [&] {
    const auto given = [&](int at, unsigned otherwise) {
      return argc > at ? static_cast<unsigned>(std::atoi(argv[at])) : otherwise;
    };
    const unsigned from = given(2, nightly ? 31000 : 1), count = given(3, nightly ? 10 : 1);
    Tally tables, spindles;
    for (unsigned seed = from; seed < from + count; ++seed) {
      judge(table(seed, true), seed, tables);
      judge(table(seed + 1000, false), seed + 1000, tables);
      judge(spindle(seed + 2000), seed + 2000, spindles);
    }
    for (const Tally* t : {&tables, &spindles}) {
      const std::string of = t == &tables ? "tables" : "spindles";
      check::figure(of, t->drives);
      check::figure(of + " with play", t->with_play);
      check::figure(of + ", backlash named", t->named);
      check::figure(of + ", backlash named where there is none", t->wrongly);
      check::figure(of + ", compliance told", t->stiff);
      check::figure(of + ", backlash off by so many standard errors at most", t->worst_width);
      check::figure(of + ", backlash off by", 100 * t->worst_width_share, "%");
      check::figure(of + ", held resonance off by so many standard errors at most", t->worst_held);
      check::figure(of + ", held resonance off by", 100 * t->worst_held_share, "%");
      // Without a name the width is told all the same, between the encoders.
      CHECK(t->wrongly == 0 && 4 * t->named >= 3 * t->with_play);
      CHECK(t->worst_width < 4 && t->worst_held < 4);
      CHECK(4 * t->stiff >= 3 * t->drives);
    }
  });
}
