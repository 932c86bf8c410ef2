// Motors that warm while they are recorded, by a generator of its own (drive_under_control.hpp):
// torque per ampere that falls with the column of the temperature gets its name, the machine file
// that is written closes the gap, and a file that has it already is not told anything is missing.
// Friction that warms up beside the column keeps its name, and a motor that only warms gets none.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>

#include "check.hpp"
#include "drive_under_control.hpp"
#include "servosense/io/machine_file.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr const char* kName = "torque-constant-temperature";
constexpr double kPeriod_s = 1e-3;

enum class Hidden { nothing, constant, friction, both };

struct WarmAxis {
  DriveUnderControl drive = axis_under_control();
  double force_per_A = 0, per_K = 0, at_C = 20;
  double from_C = 0, to_C = 0, warming_s = 0, step_C = 1;
  std::size_t told_each = 500;  ///< samples
  double inertia_told = 0, viscous_told = 0, coulomb_told = 0;

  static WarmAxis random(unsigned seed, Hidden hidden) {
    std::mt19937_64 bits(seed);
    const auto between = [&](double low, double high) {
      return low * std::pow(high / low, std::uniform_real_distribution<double>(0, 1)(bits));
    };
    WarmAxis a;
    DriveUnderControl& d = a.drive;
    d.inertia = between(40, 300);
    d.acceleration = between(1.5, 5);
    const double most = d.inertia * d.acceleration;
    d.coulomb = most * between(0.1, 0.4);
    d.top_speed = between(0.15, 0.4);
    d.viscous = most * between(0.05, 0.3) / d.top_speed;
    d.bandwidth_hz = between(15, 25);
    d.noise = most * between(0.005, 0.02);
    d.change_s = between(0.4, 0.8);
    d.length_s = 60;
    d.seed = seed;
    a.force_per_A = between(20, 200);
    a.from_C = between(18, 30);
    a.to_C = a.from_C + between(25, 60);
    a.warming_s = d.warming_s = d.length_s * between(0.2, 0.8);
    a.step_C = seed % 2 == 0 ? 1 : 0.1;
    if (hidden == Hidden::constant || hidden == Hidden::both) a.per_K = -between(0.7e-3, 2e-3);
    if (hidden == Hidden::friction || hidden == Hidden::both) {
      (seed % 2 == 0 ? d.coulomb_lost : d.viscous_lost) = between(0.15, 0.4);
      d.warming_s *= between(0.4, 1.2);  // bearings warm otherwise than windings
    }
    a.inertia_told = d.inertia * between(0.92, 1.08);
    a.viscous_told = d.viscous * between(0.9, 1.1);
    a.coulomb_told = d.coulomb * between(0.9, 1.1);
    return a;
  }
  [[nodiscard]] double temperature_C(double t) const {
    return from_C - (to_C - from_C) * std::expm1(-t / warming_s);
  }
  void write(const char* trace, const char* machine, const std::string& keys = "",
             bool column = true) const {
    DriveData d;
    d.sample_period_s = kPeriod_s;
    d.model.unit_per_turn = 0.01;
    drive.record(d);
    std::ofstream rows(trace);
    rows << "t_s,x.position_m,x.current_A" << (column ? ",x.temperature_C\n" : "\n");
    char line[120];
    for (std::size_t i = 0; i < d.samples.size(); ++i) {
      const double t = static_cast<double>(i) * kPeriod_s, now_C = temperature_C(t);
      char warm[16] = "";
      if (column && i % told_each == 0)
        std::snprintf(warm, sizeof warm, "%.1f", step_C * std::round(now_C / step_C));
      std::snprintf(line, sizeof line, "%.3f,%.7f,%.6f%s%s\n", t, d.samples[i].position,
                    d.samples[i].effort / (force_per_A * (1 + per_K * (now_C - at_C))),
                    column ? "," : "", warm);
      rows << line;
    }
    std::snprintf(line, sizeof line, "%.6g\nviscous_friction_N_s_per_m = %.6g\n", inertia_told,
                  viscous_told);
    std::ofstream file(machine);
    file << "[axis.x]\nlead_m = 0.01\nforce_constant_N_per_A = " << force_per_A
         << "\nequivalent_mass_kg = " << line << "coulomb_friction_N = " << coulomb_told << '\n'
         << keys;
  }
};

DriveOutcome outcome_of(const char* trace, const char* machine, bool write = false) {
  auto file = MachineFile::read(machine);
  CHECK(file.has_value());
  if (!file) return {};
  const auto data = read_drive(*file, trace, Channel::x);
  CHECK(data.has_value());
  if (!data) return {};
  auto outcome = reconcile_drive(*data, {});
  CHECK(outcome.has_value());
  if (!outcome) return {};
  if (write) {
    const MachineFile before = *file;
    augment(*file, *outcome, "test");
    choose_for_monitors(*file, before, *data, outcome->report);
    CHECK(file->write("warm_found.ini").has_value());
  }
  return std::move(*outcome);
}

std::string names_of(const Report& r) {
  std::string names;
  for (const FoundEffect& e : r.effects) names += (names.empty() ? "" : ", ") + e.name;
  return names.empty() ? "no name" : names;
}
/// Of what was found, in the standard errors that are said.
double errors_off(const DriveOutcome& o, double per_K) {
  for (const FoundEffect& e : o.report.effects)
    if (e.name == kName) {
      std::printf("change %.6f +- %.6f, true %.6f\n", e.parameters[0].values[0],
                  e.standard_errors[0].values[0], per_K);
      return std::abs(e.parameters[0].values[0] - per_K) / e.standard_errors[0].values[0];
    }
  return 1e9;
}
bool has(const std::string& names, const char* name) {
  return names.find(name) != std::string::npos;
}

struct Score {
  unsigned machines = 0;
  unsigned wrong = 0;           ///< names of what is not there
  unsigned named[4] = {};       ///< by what is hidden: all that is there
  double most_off = 0;          ///< of the change per kelvin, where it alone was hidden
  double most_inertia_off = 0;  ///< of the inertia, there
};

void score(const WarmAxis& axis, Hidden hidden, unsigned seed, Score& all) {
  axis.write("warm.csv", "warm.ini");
  const DriveOutcome o = outcome_of("warm.csv", "warm.ini", true);
  const Report& r = o.report;
  const std::string names = names_of(r);
  const bool constant = has(names, kName), friction = has(names, "thermal-");
  const bool of_constant = hidden == Hidden::constant || hidden == Hidden::both;
  const bool of_friction = hidden == Hidden::friction || hidden == Hidden::both;
  const bool wrong = (constant && !of_constant) || (friction && !of_friction) ||
                     r.effects.size() > static_cast<std::size_t>(constant + friction);
  const double per_K = constant ? o.constant->per_K / axis.per_K : 0;
  const double inertia = o.model.inertia / axis.drive.inertia;
  std::printf("%u: %s hidden: %s, gap %.3g to %.3g N, change %.4f, inertia %.4f of the true%s\n",
              seed,
              hidden == Hidden::nothing    ? "nothing"
              : hidden == Hidden::constant ? "constant"
              : hidden == Hidden::friction ? "friction"
                                           : "both",
              names.c_str(), r.gap_before, r.gap_after, per_K, inertia, wrong ? " WRONG" : "");
  all.wrong += wrong ? 1 : 0;
  if (constant == of_constant && friction == of_friction)
    ++all.named[static_cast<std::size_t>(hidden)];
  if (hidden != Hidden::constant || !constant) return;
  all.most_off = std::max(all.most_off, std::abs(per_K - 1));
  all.most_inertia_off = std::max(all.most_inertia_off, std::abs(inertia - 1));
}

Score score_of(unsigned first, unsigned count) {
  Score all;
  all.machines = count;
  for (unsigned seed = first; seed < first + count; ++seed)
    for (const Hidden hidden : {Hidden::nothing, Hidden::constant, Hidden::friction, Hidden::both})
      score(WarmAxis::random(seed, hidden), hidden, seed, all);
  std::printf(
      "%u machines each: %u wrong names; nothing %u, constant %u, friction %u, both %u "
      "named; change within %.2f %%, inertia %.2f %%\n",
      count, all.wrong, all.named[0], all.named[1], all.named[2], all.named[3], 100 * all.most_off,
      100 * all.most_inertia_off);
  return all;
}

/// Machine file and trace of one drive, short enough for every day.
void by_day() {
  WarmAxis axis = WarmAxis::random(2, Hidden::constant);
  axis.drive.length_s = 20;
  axis.warming_s = 6;
  axis.told_each = 20;  // so fast does no motor warm
  axis.write("warm.csv", "warm.ini");
  const DriveOutcome found = outcome_of("warm.csv", "warm.ini", true);
  const Report& r = found.report;
  CHECK_TEXT(names_of(r), kName);
  CHECK_TEXT(name_of(r.verdict), "explained");
  CHECK(r.gap_after < 0.5 * r.gap_before);
  CHECK(found.constant && found.constant->at_C == 20);
  CHECK(errors_off(found, axis.per_K) < 3);
  CHECK_NEAR(found.model.inertia / axis.drive.inertia, 1, 0.005);
  CHECK(r.proof.free_run.not_shown.empty());
  CHECK(!r.proof.free_run.horizons.empty());
  for (const auto& h : r.proof.free_run.horizons)
    if (h.horizon_s >= 0.5) CHECK(h.speed.after < 0.5 * h.speed.before);
  CHECK(r.monitors_after[0].second < 0.7 * r.monitors_before[0].second);
  // The file as written, read by the record again: nothing is missing, and it is no other change.
  const auto written = MachineFile::read("warm_found.ini");
  CHECK(written && written->number("axis.x", "torque_constant_per_K").has_value());
  if (written && found.constant)
    CHECK_NEAR(*written->number("axis.x", "torque_constant_per_K"), found.constant->per_K, 1e-9);
  const Report again = outcome_of("warm.csv", "warm_found.ini").report;
  CHECK_TEXT(name_of(again.verdict), "agrees");
  CHECK(again.recalibrated.size() >= 3);
  for (const Recalibrated& c : again.recalibrated) CHECK_NEAR(c.to / c.from, 1, 0.02);
  // A file with half the change is put right, not told that something is missing.
  char keys[80];
  std::snprintf(keys, sizeof keys, "torque_constant_per_K = %.6g\n", axis.per_K / 2);
  axis.write("warm.csv", "warm.ini", keys);
  const DriveOutcome half = outcome_of("warm.csv", "warm.ini", true);
  CHECK_TEXT(names_of(half.report), "no name");
  CHECK_TEXT(name_of(half.report.verdict), "agrees");
  const auto& all = half.report.recalibrated;
  const auto put_right = std::ranges::find(all, std::string(kName) + " torque_constant_per_K",
                                           &Recalibrated::parameter);
  CHECK(put_right != all.end());
  if (put_right != all.end())
    CHECK(std::abs(put_right->to - axis.per_K) < 3 * put_right->standard_error);
  const auto corrected = MachineFile::read("warm_found.ini");
  if (corrected && put_right != all.end())
    CHECK_NEAR(corrected->number("axis.x", "torque_constant_per_K").value_or(0), put_right->to,
               1e-9);
  // Without the column it is no candidate, and the report says what would show it.
  axis.write("warm.csv", "warm.ini", "", false);
  const Report without = outcome_of("warm.csv", "warm.ini").report;
  CHECK(!has(names_of(without), kName));
  CHECK(std::ranges::any_of(without.not_testable, [](const NotTestable& n) {
    return n.name == kName && has(n.would_need, "x.temperature_C");
  }));
  // A motor that stays as warm as it is tells nothing.
  axis.per_K = 0;
  axis.to_C = axis.from_C + 3;
  axis.write("warm.csv", "warm.ini");
  const Report cold = outcome_of("warm.csv", "warm.ini").report;
  CHECK_TEXT(name_of(cold.verdict), "agrees");
  CHECK(std::ranges::any_of(cold.not_testable, [](const NotTestable& n) {
    return n.name == kName && has(n.because, "too much alike");
  }));
  // Friction that warms up beside a motor that does.
  axis.to_C = axis.from_C + 40;
  axis.drive.coulomb_lost = 0.3;
  axis.drive.warming_s = 5;
  axis.write("warm.csv", "warm.ini");
  CHECK_TEXT(names_of(outcome_of("warm.csv", "warm.ini").report), "thermal-friction-drift");
}

}  // namespace

/// `--nightly`, or a first seed and how many.
int main(int argc, char** argv) {
  const auto folder = std::filesystem::temp_directory_path() / "servosense_warm_motor";
  std::filesystem::create_directories(folder);
  std::filesystem::current_path(folder);
  if (argc <= 1) {
    by_day();
    return check::done();
  }
  const bool nightly = std::string(argv[1]) == "--nightly";
  const Score all = nightly ? score_of(9740000, 10)
                            : score_of(static_cast<unsigned>(std::stoul(argv[1])),
                                       argc > 2 ? static_cast<unsigned>(std::stoul(argv[2])) : 1);
  CHECK(all.wrong == 0);
  CHECK(all.named[0] == all.machines);
  return check::done();
}
