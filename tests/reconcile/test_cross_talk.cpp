// A force that follows another axis: which part of the other's motion it follows, and how much,
// from whatever the trace has of it. The force is computed from sines, so nothing simulates
// anything.
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <utility>

#include "check.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/model/cross_talk.hpp"
#include "servosense/reconcile/drive.hpp"
#include "sine_motion.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

namespace fs = std::filesystem;

/// An axis beside one of 80 kg with 500 N s/m and 90 N, recorded as `columns` says. One of the
/// other's quantities, times `coefficient`, is felt.
std::string trace(CrossTalkOf of, double coefficient, const std::string& columns) {
  const auto y_at = [](double t) { return along_sines({0.23, 1.09, 2.9}, {0.08, 0.01, 0.002}, t); };
  const auto y_force = [](const Motion& y) {
    return 80 * y.acceleration + 500 * y.velocity + 90 * std::tanh(y.velocity / 1e-3);
  };
  const DriveData axis = sine_axis([&](double t, double, double direction) {
    const Motion y = y_at(t);
    const double all[] = {y.acceleration, y.velocity, y.position, y_force(y)};
    return 60 * direction + coefficient * all[static_cast<int>(of)];
  });
  std::string text = "t_s,x.position_m,x.force_N," + columns + "\n";
  double t = 0, at = 0;
  for (const DriveSample<double>& sample : axis.samples) {
    const Motion y = y_at(t);
    at += sample.increment;
    char row[160];
    std::snprintf(row, sizeof row, "%.3f,%.9f,%.5f", t, at, sample.effort);
    text += row;
    if (columns.starts_with("y.position_m")) {
      std::snprintf(row, sizeof row, ",%.9f", y.position);
    } else if (columns.starts_with("y.velocity_m_s")) {
      std::snprintf(row, sizeof row, ",%.9f", y.velocity);
    } else {  // counts of 0.1 um, 16 bits
      std::snprintf(row, sizeof row, ",%d",
                    static_cast<int>(static_cast<std::int16_t>(std::lround(y.position / 1e-7))));
    }
    text += row;
    if (columns.ends_with("y.force_N")) {
      std::snprintf(row, sizeof row, ",%.5f", y_force(y));
      text += row;
    }
    text += '\n';
    t += axis.sample_period_s;
  }
  return text;
}

DriveOutcome outcome_of(const std::string& trace, const std::string& y_section,
                        const std::string& second_trace = "") {
  const fs::path folder =
      fs::temp_directory_path() / ("servosense_cross_talk_" + std::to_string(getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "trace.csv") << trace;
  std::ofstream(folder / "second.csv") << second_trace;
  std::ofstream(folder / "machine.ini")
      << "[machine]\nname = two axes\nsample_rate_hz = 1000\n[axis.x]\nequivalent_mass_kg = 104\n"
         "viscous_friction_N_s_per_m = 290\ncoulomb_friction_N = 62\nfriction_knee_m = 2e-6\n"
         "lead_m = 0.01\n"
      << y_section;
  const auto machine = MachineFile::read((folder / "machine.ini").string());
  CHECK(machine);
  DriveOutcome none;
  if (!machine) return none;
  const auto data = read_drive(*machine, (folder / "trace.csv").string(), Channel::x);
  std::optional<DriveData> second;
  if (!second_trace.empty()) {
    auto read = read_drive(*machine, (folder / "second.csv").string(), Channel::x);
    CHECK(read);
    if (read) second = std::move(*read);
  }
  fs::remove_all(folder);
  CHECK(data);
  if (!data) return none;
  auto outcome = reconcile_drive(*data, {}, second ? &*second : nullptr);
  CHECK(outcome);
  return outcome ? std::move(*outcome) : none;
}

/// Named as what it follows, of the right size, and gone with it.
void felt(CrossTalkOf of, double coefficient, const std::string& columns,
          const std::string& y_section = "") {
  const DriveOutcome outcome = outcome_of(trace(of, coefficient, columns), y_section);
  CHECK(outcome.report.effects.size() == 1);
  for (const FoundEffect& e : outcome.report.effects) {
    CHECK_TEXT(e.name, "cross-talk");
    if (e.name != "cross-talk") continue;
    CHECK_TEXT(e.parameters.at(0).text, "y");
    CHECK_TEXT(e.parameters.at(2).text, std::string(kCrossTalkOf[static_cast<std::size_t>(of)]));
    std::printf("%s: %.4g, true %.4g; gap %.3g to %.3g N\n", e.parameters.at(2).text.c_str(),
                e.parameters.at(1).values.at(0), coefficient, e.gap_before, e.gap_after);
    CHECK_NEAR(e.parameters.at(1).values.at(0) / coefficient, 1, 0.02);
    CHECK(e.gap_after < 0.2 * e.gap_before);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string both = "y.position_m,y.force_N";
  felt(CrossTalkOf::acceleration, 8, both);
  felt(CrossTalkOf::effort, 0.06, both);
  if (check::nightly(argc, argv)) {
    felt(CrossTalkOf::velocity, -30, both);
    felt(CrossTalkOf::position, 60, both);
  }
  // The motion alone, as a speed or as a counter that wraps.
  felt(CrossTalkOf::acceleration, -5, "y.velocity_m_s");
  felt(CrossTalkOf::acceleration, -5, "y.angle_counts",
       "[axis.y]\nlead_m = 0.01\nencoder_counts_per_rev = 100000\ncounter_bits = 16\n");
  // A second record without that effort proves nothing, and loses nothing.
  const DriveOutcome proved = outcome_of(trace(CrossTalkOf::effort, 0.06, both), "",
                                         trace(CrossTalkOf::effort, 0.06, "y.position_m"));
  CHECK(proved.report.effects.size() == 1);
  CHECK(proved.report.second.gap_after > 0);
  // Counts of nobody knows what are passed over; so is an axis that does nothing to this one.
  CHECK(outcome_of(trace(CrossTalkOf::acceleration, -5, "y.angle_counts"), "")
            .report.effects.empty());
  CHECK(outcome_of(trace(CrossTalkOf::effort, 0, both), "").report.effects.empty());
  return check::done();
}
