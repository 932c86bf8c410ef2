// A spindle that reports neither torque nor current but its power or its load, by the program
// alone: an idling run shows inertia, friction and what is lost, a step of torque in a cut is read
// right at two speeds, what is too slow is left out and said, and what is missing is asked for.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <optional>
#include <random>
#include <sstream>

#include "oracles/weakened_spindle.hpp"
#include "program.hpp"
#include "sanitized.hpp"

using namespace program_test;
using oracle::WeakenedSpindle;

namespace {

constexpr double kRated_W = 10000;

/// A spindle whose drive takes power: what the shaft gets, a constant, and the copper's.
struct Machine {
  WeakenedSpindle spindle;
  double loss_W = 0, copper_W_per_Nm2 = 0, noise_W = 0;
  double run_up_Nm = 0;

  static Machine random(unsigned seed) {
    std::mt19937_64 bits(seed + 77);
    const auto between = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(bits);
    };
    Machine m;
    m.spindle = WeakenedSpindle::random(seed);
    m.spindle.base_rad_s = 1e9;
    m.run_up_Nm = m.spindle.limit_A * m.spindle.constant;
    const double most_W = m.run_up_Nm * m.spindle.top_rad_s;
    m.loss_W = between(0.01, 0.05) * most_W;
    m.copper_W_per_Nm2 = between(0.02, 0.08) * most_W / m.run_up_Nm / m.run_up_Nm;
    m.noise_W = between(0.001, 0.003) * most_W;
    return m;
  }
  [[nodiscard]] double power(double torque, double speed) const {
    return torque * speed + loss_W + copper_W_per_Nm2 * torque * torque;
  }
};

/// How the drive reports it.
struct Report {
  std::string column = "power_W";
  std::string keys;
  bool absolute = false;
  std::function<double(const Machine&, double torque, double power, double speed)> value =
      [](const Machine&, double, double power, double) { return power; };
};

void write_trace(const Machine& m, const Report& report, const std::string& name, double duration_s,
                 const std::function<double(double)>& speed,
                 const std::function<double(double)>& load, unsigned seed) {
  std::ofstream out(folder / name);
  out << "t_s,spindle.angle_counts,spindle." << report.column << "\n";
  char line[96];
  std::mt19937_64 bits(seed);
  std::normal_distribution<double> noise(0, m.noise_W);
  m.spindle.run(duration_s, speed, load,
                [&](double t, std::int64_t counts, double current, double w) {
                  const double torque = m.spindle.constant * current;
                  double value = report.value(m, torque, m.power(torque, w) + noise(bits), w);
                  if (report.absolute) value = std::abs(value);
                  std::snprintf(line, sizeof line, "%.6f,%lld,%.7g\n", t,
                                static_cast<long long>(counts), value);
                  out << line;
                });
}

void write_idle(const Machine& m, const Report& report, unsigned seed) {
  write_trace(
      m, report, "idle.csv", 30,
      [&](double t) {
        constexpr double kShares[] = {0.3, 1, 0.5, 1, -0.4, -1, -0.2, 0.7, 1, 0.15};
        return m.spindle.top_rad_s * kShares[std::min(static_cast<int>(t / 3), 9)];
      },
      [](double) { return 0.0; }, seed);
}

constexpr double kOfRunUp = 0.15;  // the cut

/// At 0.8 of top speed a cut from 5 s to 8 s, at 0.3 of it another from 13 s to 16 s, then rest.
void write_cut(const Machine& m, const Report& report, unsigned seed) {
  write_trace(
      m, report, "cut.csv", 20,
      [&](double t) {
        return m.spindle.top_rad_s * (t < 9 ? 0.8 : t < 17 ? 0.3 : 0.0);
      },
      [&](double t) {
        return (t > 5 && t < 8) || (t > 13 && t < 16) ? kOfRunUp * m.run_up_Nm : 0.0;
      },
      seed);
}

void write_machine(const Machine& m, const std::string& keys) {
  std::ostringstream text;
  text << "[machine]\nname = oracle\nsample_rate_hz = 8000\n[spindle]\nencoder_counts_per_rev = "
       << m.spindle.counts << "\n"
       << keys;
  put("machine.ini", text.str());
}

double value_of(const std::string& key) {
  for (const std::string& line : lines(content(folder / "learned.ini")))
    if (line.starts_with(key + " ")) return std::stod(line.substr(line.find('=') + 1));
  return 0;
}

struct Reading {
  double fast = 0, slow = 0;  // mean of the estimate in the two cuts, less that before
  bool empty_at_rest = true;  // nothing is told where it stands
  double known = 0;           // share of the rows that have a value
};
Reading read_estimate() {
  double sum[4] = {}, n[4] = {}, rows = 0, told = 0;
  Reading r;
  for (const std::string& line : lines(content(folder / "estimates.csv"))) {
    if (line.empty() || line[0] == '#' || line[0] == 't') continue;
    const double t = std::stod(line);
    const std::size_t comma = line.find(',') + 1;
    const std::string field = line.substr(comma, line.find(',', comma) - comma);  // then its band
    const bool empty = field.empty() || field == "nan";
    ++rows;
    if (!empty) ++told;
    if (t > 19.5 && !empty) r.empty_at_rest = false;
    if (empty) continue;
    const int part = t > 4 && t < 5       ? 0
                     : t > 6 && t < 7.5   ? 1
                     : t > 12 && t < 13   ? 2
                     : t > 14 && t < 15.5 ? 3
                                          : -1;
    if (part < 0) continue;
    sum[part] += std::stod(field);
    ++n[part];
  }
  r.fast = sum[1] / n[1] - sum[0] / n[0];
  r.slow = sum[3] / n[3] - sum[2] / n[2];
  r.known = told / rows;
  return r;
}

/// Stated errors hold: four of them, as often as one in 16000.
void stated(const Machine& m, const Outcome& learned, unsigned seed) {
  const Json json(learned.out);
  const WeakenedSpindle& s = m.spindle;
  double worst = 0;
  const auto holds = [&](const std::string& key, double truth) {
    const double error = json.number("drives.0." + key + ".standard_error");
    const double off = (json.number("drives.0." + key + ".value") - truth) / error;
    that(std::abs(off) < 4, learned, key + " is off by " + std::to_string(off) + " errors",
         __LINE__);
    worst = std::fmax(worst, std::abs(off));
  };
  holds("inertia_kg_m2", s.inertia);
  holds("viscous_friction_Nm_s_per_rad", s.viscous);
  holds("coulomb_friction_Nm", s.coulomb);
  holds("power_loss_W", m.loss_W);
  holds("copper_loss_W_per_Nm2", m.copper_W_per_Nm2);
  std::printf(
      "  seed %u: within %.1f stated errors, P0 %.3g of %.3g +- %.2g W, k +- %.2g %%\n", seed,
      worst, json.number("drives.0.power_loss_W.value"), m.loss_W,
      json.number("drives.0.power_loss_W.standard_error"),
      100 * json.number("drives.0.copper_loss_W_per_Nm2.standard_error") / m.copper_W_per_Nm2);
}

/// A drive that loses nothing beside its windings.
void without_constant_loss(unsigned seed) {
  Machine m = Machine::random(seed);
  m.loss_W = 0;
  write_machine(m, "");
  write_idle(m, {}, seed);
  const Outcome learned =
      run("identify idle --machine machine.ini --trace idle.csv --out learned.ini --json");
  that(learned.status == 0, learned, "identifies", __LINE__);
  if (learned.status == 0) stated(m, learned, seed);
}

const std::string kWatch =
    "monitor --machine learned.ini --trace cut.csv --estimates estimates.csv --json";

void estimated(const Machine& m, const Report& report, unsigned seed, double tolerance) {
  write_machine(m, report.keys);
  write_idle(m, report, seed);
  const Outcome learned =
      run("identify idle --machine machine.ini --trace idle.csv --out learned.ini --json");
  that(learned.status == 0, learned, "identifies", __LINE__);
  if (learned.status != 0) return;
  if (report.value(m, 1, 2, 1) == 2) stated(m, learned, seed);
  const WeakenedSpindle& s = m.spindle;
  const double inertia = value_of("inertia_kg_m2") / s.inertia,
               coulomb = value_of("coulomb_friction_Nm") / s.coulomb,
               viscous = value_of("viscous_friction_Nm_s_per_rad") / s.viscous;
  const double friction =
      (value_of("coulomb_friction_Nm") + value_of("viscous_friction_Nm_s_per_rad") * s.top_rad_s) /
      (s.coulomb + s.viscous * s.top_rad_s);
  write_cut(m, report, seed + 1000);
  const Outcome cut = run(kWatch);
  that(cut.status == 0, cut, "monitors", __LINE__);
  that(report.column == "load_percent" || contains(cut.out, "power tells the torque from"), cut,
       "says from which speed on", __LINE__);
  const Reading r = read_estimate();
  const double step = kOfRunUp * m.run_up_Nm;
  std::printf(
      "  %s%s, seed %u: J %+.2f %%, D %+.2f %%, C %+.2f %%, D w + C %+.2f %%, P0 %+.2f %%, "
      "copper %+.2f %%, steps %+.2f and %+.2f %%, known from %.3g rpm\n",
      report.column.c_str(), report.absolute ? " absolute" : "", seed, 100 * (inertia - 1),
      100 * (viscous - 1), 100 * (coulomb - 1), 100 * (friction - 1),
      100 * (value_of("power_loss_W") / m.loss_W - 1),
      100 * (value_of("copper_loss_W_per_Nm2") / m.copper_W_per_Nm2 - 1), 100 * (r.fast / step - 1),
      100 * (r.slow / step - 1), value_of("power_known_from_rpm"));
  CHECK_NEAR(inertia, 1, tolerance);
  CHECK_NEAR(friction, 1, 2 * tolerance);
  CHECK_NEAR(r.fast / step, 1, tolerance);
  // Windings that take as much as braking gives back may hide the slow cut: then nothing is told.
  const bool slow_told =
      value_of("power_known_from_rpm") < servosense::rpm_from_rad_s(0.3 * s.top_rad_s);
  if (slow_told)
    CHECK_NEAR(r.slow / step, 1, tolerance);
  else
    CHECK(std::isnan(r.slow));
  if (report.value(m, 1, 2, 1) != 2) return;
  CHECK(r.empty_at_rest);
  if (slow_told) CHECK(r.known > 0.7);
}

/// A load meter: of rated power, in volts; and in percent of the torque rated at each speed.
Report volts() {
  return {"load_V", "load_meter_V_per_W = 0.001\n", false,
          [](const Machine&, double, double power, double) { return 1e-3 * power; }};
}
Report percent_of_power() {
  return {"load_percent", "load_percent_of = power\nrated_power_W = 10000\n", false,
          [](const Machine&, double, double power, double) { return 100 * power / kRated_W; }};
}
Report percent_of_rating(double rated_Nm) {
  std::ostringstream keys;
  keys << "load_percent_of = rating\nrated_power_W = 10000\nrated_torque_Nm = " << rated_Nm << "\n";
  return {"load_percent", keys.str(), false,
          [rated_Nm](const Machine& m, double torque, double power, double speed) {
            const double w = std::abs(speed);
            torque += (power - m.power(torque, speed)) / std::fmax(w, 50);  // the noise
            return 100 * torque / std::fmin(rated_Nm, w > 0 ? kRated_W / w : 1e9);
          }};
}

/// What a percentage is of is asked for by the name of the key.
void asks() {
  const Machine m = Machine::random(3);
  const Report report = percent_of_power();
  const auto record = [&](const Report& r) {
    write_trace(
        m, r, "cut.csv", 0.5, [](double) { return 100.0; }, [](double) { return 0.0; }, 3);
  };
  record(report);
  const auto says = [&](const std::string& keys, const std::string& what) {
    write_machine(m, keys);
    const Outcome o = run("monitor --machine machine.ini --trace cut.csv --json");
    that(o.status == 3 && contains(o.err, what), o, what, __LINE__);
  };
  says("", "load_percent_of = power");
  says("load_percent_of = power\n", "write rated_power_W in [spindle]");
  says("load_percent_of = torque\n", "write rated_torque_Nm in [spindle]");
  says("load_percent_of = rating\nrated_power_W = 10000\n", "rated_torque_Nm and rated_power_W");
  record(volts());
  says("", "write load_meter_V_per_W in [spindle]");
}

/// A spindle that turns slower than power tells its torque for most of the time.
void too_slow() {
  const Machine m = Machine::random(4);
  std::ostringstream keys;
  keys << "inertia_kg_m2 = " << m.spindle.inertia << "\npower_known_from_rpm = 300\n"
       << "[monitor.chatter]\nchatter_threshold_Nm2 = 1e6\nminimum_speed_rad_s = 10\n";
  write_machine(m, keys.str());
  write_trace(
      m, {}, "cut.csv", 3, [](double) { return 20.0; }, [](double) { return 0.0; }, 4);
  const Outcome o =
      run("monitor --machine machine.ini --trace cut.csv --estimates estimates.csv --json");
  that(contains(o.out, "\"partly-watched\""), o, "is watched partly", __LINE__);
  that(contains(o.out, "power tells the torque from 300 rpm on only"), o, "says why", __LINE__);
  CHECK(read_estimate().known < 0.01);
}

/// The workflow reads the same torque: what it compares needs no other effort.
void reconciled() {
  const Machine m = Machine::random(5);
  write_machine(m, "");
  write_idle(m, {}, 5);
  run("identify idle --machine machine.ini --trace idle.csv --out learned.ini --quiet");
  const Outcome o = run("reconcile --machine learned.ini --trace idle.csv --out found --json");
  that(o.status == 0, o, "reconciles", __LINE__);
  that(contains(o.out, "\"channel\": \"spindle\""), o, "the spindle", __LINE__);
  that(contains(o.out, "\"effects\": []"), o, "lacks no effect", __LINE__);
}

}  // namespace

// `--nightly`: the figures of docs/power.md; of other seeds with the first and how many behind it.
int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  return in_own_folder("power_effort", [&] {
    const auto given = [&](int at, unsigned otherwise) {
      return argc > at ? static_cast<unsigned>(std::atoi(argv[at])) : otherwise;
    };
    const unsigned from = given(2, nightly ? 701 : 1), count = given(3, nightly ? 12 : 1);
    for (unsigned seed = from; seed < from + count; ++seed) {
      const Machine m = Machine::random(seed);
      estimated(m, {}, seed, 0.01);
      if (kSanitized) continue;
      estimated(m, {"power_W", "", true}, seed + 100, 0.02);
      if (!nightly) continue;
      estimated(m, seed % 2 == 0 ? volts() : percent_of_power(), seed + 200, 0.01);
      estimated(m, percent_of_rating(0.6 * m.run_up_Nm), seed + 300, 0.01);
      without_constant_loss(seed + 400);
    }
    asks();
    too_slow();
    if (nightly) reconciled();
  });
}
