// From trace to drive: what a hole in the record must not lose.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <optional>
#include <random>
#include <string>

#include "check.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

namespace fs = std::filesystem;

constexpr double kLead_m = 0.01;
constexpr int kCountsPerTurn = 4096;

double position(double t) { return 0.05 * std::sin(5 * t); }

enum class Motion { counts, position };

/// 2 s at 1 kHz; two holes, one too short and one too long for the servo's conditioning to bridge,
/// and a stretch whose rows are there but empty. The counter has 16 bits and wraps.
std::string trace(Motion motion) {
  std::string text = motion == Motion::counts ? "t_s,x.angle_counts,x.current_A\n"
                                              : "t_s,x.position_m,x.current_A\n";
  for (int i = 0; i < 2000; ++i) {
    if ((i > 300 && i < 305) || (i > 800 && i < 1000)) continue;
    char row[80];
    const double t = i * 1e-3;
    if (i > 1500 && i < 1550) {
      std::snprintf(row, sizeof row, "%.3f,,\n", t);
    } else if (motion == Motion::counts) {
      const auto counts =
          static_cast<std::int16_t>(std::lround(position(t) / kLead_m * kCountsPerTurn) + 32000);
      std::snprintf(row, sizeof row, "%.3f,%d,1\n", t, counts);
    } else {
      std::snprintf(row, sizeof row, "%.3f,%.9f,1\n", t, position(t));
    }
    text += row;
  }
  return text;
}

std::optional<DriveData> read(const std::string& trace, double lead_m = kLead_m) {
  const fs::path folder =
      fs::temp_directory_path() / ("servosense_drive_data_" + std::to_string(getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "trace.csv") << trace;
  std::ofstream(folder / "machine.ini")
      << "[machine]\nname = hole\nsample_rate_hz = 1000\n[axis.x]\nequivalent_mass_kg = 100\n"
         "force_constant_N_per_A = 50\nencoder_counts_per_rev = 4096\ncounter_bits = 16\nlead_m = "
      << lead_m
      << "\n[observer.x]\ndisturbance_cutoff_rad_s = 300\n"
         "velocity_cutoff_rad_s = 300\n";
  const auto machine = MachineFile::read((folder / "machine.ini").string());
  CHECK(machine);
  if (!machine) return std::nullopt;
  auto drive = read_drive(*machine, (folder / "trace.csv").string(), Channel::x);
  CHECK(drive);
  fs::remove_all(folder);
  if (!drive) return std::nullopt;
  return std::move(*drive);
}

void holes_lose_no_travel(Motion motion) {
  const auto drive = read(trace(motion));
  if (!drive) return;
  CHECK(drive->samples.size() == 2000);
  // Where a row was recorded, the sum of all increments is where the axis is.
  const double count = motion == Motion::counts ? kLead_m / kCountsPerTurn : 1e-9;
  double at = 0, worst = 0, longest = 0;
  for (std::size_t i = 1; i < drive->samples.size(); ++i) {
    const double step = drive->samples[i].increment;
    at += step;
    longest = std::max(longest, std::abs(step));
    const bool recorded =
        !(i > 300 && i < 305) && !(i > 800 && i < 1000) && !(i > 1500 && i < 1550);
    if (recorded)
      worst =
          std::max(worst, std::abs(at - (position(static_cast<double>(i) * 1e-3) - position(0))));
  }
  check::figure("travel lost, in steps", worst / count);
  CHECK(worst <= 1.01 * count);
  CHECK(longest < 2 * 0.05 * 5 * 1e-3);  // spread over the hole, not made up in one step
}

/// Switched off for two seconds: the counter begins elsewhere, the axis has not moved.
void a_power_up_is_no_travel() {
  std::string text = "t_s,x.angle_counts,x.current_A\n";
  for (int i = 0; i < 2000; ++i) {
    char row[80];
    std::snprintf(row, sizeof row, "%.3f,%d,1\n", i * 1e-3 + (i < 1000 ? 0 : 2),
                  i < 1000 ? i : 5000 + i);
    text += row;
  }
  const auto drive = read(text);
  if (!drive) return;
  double at = 0;
  for (std::size_t i = 1; i < drive->samples.size(); ++i) at += drive->samples[i].increment;
  // One step a row; what is lost is the bridged start of the hole, a row at most.
  CHECK(std::abs(at - 1998 * kLead_m / kCountsPerTurn) <= 10 * kLead_m / kCountsPerTurn);
}

/// A record of whole steps shows them, whatever its column is called; one with noise of many steps
/// or of none does not. `digits` of the text.
void steps_without_counts() {
  constexpr double kStep = 4e-8, kPeriod = 1e-3;
  const auto text = [&](bool speed, double step, int digits, double noise) {
    std::string all = speed ? "t_s,x.velocity_m_s,x.current_A\n" : "t_s,x.position_m,x.current_A\n";
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    double before = 0;
    for (int i = 0; i < 2000; ++i) {
      double x = position(i * kPeriod) / 50 + noise * normal(random);
      if (step > 0) x = step * std::floor(x / step);
      char row[80];
      std::snprintf(row, sizeof row, "%.3f,%.*f,1\n", i * kPeriod, digits,
                    speed ? (x - before) / kPeriod : x);
      before = x;
      if (i > 0) all += row;
    }
    return all;
  };
  const auto step_in = [&](bool speed, double step, int digits, double noise) {
    const auto data = read(text(speed, step, digits, noise));
    CHECK(data.has_value());
    return data ? data->motion_step : -1;
  };
  for (const double noise : {0.0, kStep})
    for (const bool speed : {false, true}) {
      CHECK_NEAR(step_in(speed, kStep, 12, noise) / kStep, 1.0, 0.01);
      CHECK_NEAR(step_in(speed, kStep, speed ? 6 : 9, noise) / kStep, 1.0, 0.05);
      CHECK(step_in(speed, 0, 12, kStep + noise) == 0);
      CHECK(step_in(speed, kStep, 12, 100 * kStep) == 0);
    }
  const auto counted = read(trace(Motion::counts));
  CHECK(counted && counted->motion_step == 0);
}

/// In other units the lead is another, too.
void presliding_that_nobody_says() {
  for (const Motion motion : {Motion::counts, Motion::position}) {
    const auto here = read(trace(motion)), there = read(trace(motion), 1.7 * kLead_m);
    CHECK(here && there);
    if (!here || !there) continue;
    CHECK_NEAR(here->model.friction_knee, motion == Motion::counts ? 9.8e-6 : 5e-6, 0.1e-6);
    CHECK_NEAR(there->model.friction_knee / here->model.friction_knee, 1.7, 1e-12);
  }
}

/// The angle of an axis's motor is travel by the lead; a position beside it is that of a scale, as
/// beside counts.
void angle_of_the_motor() {
  for (const bool scale : {false, true}) {
    std::string text = "t_s,x.angle_rad,x.current_A";
    text += scale ? ",x.position_m\n" : "\n";
    for (int i = 0; i < 2000; ++i) {
      char row[120];
      const double t = i * 1e-3, x = position(t);
      std::snprintf(row, sizeof row, scale ? "%.3f,%.9f,1,%.9f\n" : "%.3f,%.9f,1\n", t,
                    x / kLead_m * 2 * std::numbers::pi, x + 0.01);
      text += row;
    }
    const auto drive = read(text);
    CHECK(drive);
    if (!drive) continue;
    double at = drive->start_position;
    double off = 0;
    for (std::size_t i = 0; i < drive->samples.size(); ++i) {
      if (i > 0) at += drive->samples[i].increment;
      off = std::max(off, std::abs(at - position(static_cast<double>(i) * 1e-3)));
    }
    CHECK(off < 1e-9);  // digits of the text
    CHECK(drive->load_position.empty() != scale);
    if (scale && !drive->load_position.empty())
      CHECK_NEAR(drive->load_position[700], position(0.7) + 0.01, 1e-9);
  }
}

/// So is its speed, where there is neither position nor angle; what is not looked at is named.
void speed_of_the_motor() {
  std::string text = "t_s,x.speed_rad_s,x.current_A,tool.force_x_N\n";
  for (int i = 0; i < 2000; ++i) {
    char row[120];
    const double t = (i + 0.5) * 1e-3;
    std::snprintf(
        row, sizeof row, "%.3f,%.9f,1,2\n", i * 1e-3,
        (position(t + 1e-6) - position(t - 1e-6)) / 2e-6 / kLead_m * 2 * std::numbers::pi);
    text += row;
  }
  const auto drive = read(text);
  CHECK(drive);
  if (!drive) return;
  double at = 0, off = 0;
  for (std::size_t i = 0; i < drive->samples.size(); ++i) {
    at += drive->samples[i].increment;
    off = std::max(off, std::abs(at - (position(1e-3 * static_cast<double>(i)) - position(0))));
  }
  // Trapezia of speeds, and the first of them before the start: below a period at the top speed.
  CHECK(off < 1e-3 * 0.5);
  CHECK(std::ranges::any_of(drive->remarks, [](const std::string& r) {
    return r == "columns not used by this command: tool.force_x_N";
  }));
}

}  // namespace

int main() {
  angle_of_the_motor();
  speed_of_the_motor();
  presliding_that_nobody_says();
  steps_without_counts();
  holes_lose_no_travel(Motion::counts);
  holes_lose_no_travel(Motion::position);
  a_power_up_is_no_travel();
  return check::done();
}
