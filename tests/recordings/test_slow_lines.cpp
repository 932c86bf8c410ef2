// Lines of slow signals (identify/slow_vibration.hpp) on recorded sets: a turn-mill that made sound
// parts, at 1 kHz, with lines put in; accelerations of milling at 1650 Hz, some with chatter.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/scores.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/lag_gain.hpp"
#include "servosense/identify/slow_vibration.hpp"

namespace fs = std::filesystem;
using namespace servosense;

namespace {

using Samples = std::vector<VibrationSample>;

/// Rows of a raw file, `channels` values each.
std::vector<float> read(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::vector<float> all(fs::file_size(path) / sizeof(float));
  in.read(reinterpret_cast<char*>(all.data()),
          static_cast<std::streamsize>(all.size() * sizeof(float)));
  return all;
}

Samples turning(const fs::path& path, std::size_t channels, std::size_t current, std::size_t rpm) {
  const std::vector<float> raw = read(path);
  Samples out;
  for (std::size_t i = 0; i + channels <= raw.size(); i += channels)
    out.push_back({static_cast<double>(raw[i + current]),
                   rad_s_from_rpm(static_cast<double>(raw[i + rpm])) * 1e-3, Quality::good});
  return out;
}

struct Watched {
  double value = 0, apparent_hz = 0;
  std::size_t verdicts = 0, alarms = 0;
};
Watched watch(const SlowVibrationConfig& config, const Samples& samples) {
  SlowVibration ear(config);
  Watched w;
  bool on = false;
  for (const VibrationSample& s : samples)
    if (const auto v = ear.add(s.torque_Nm, s.increment_rad, s.quality)) {
      ++w.verdicts;
      if (v->value >= 1 && !on) ++w.alarms;
      on = v->value >= (on ? 0.8 : 1);
      if (v->value > w.value) {
        w.value = v->value;
        w.apparent_hz = v->apparent_hz;
      }
    }
  return w;
}

/// One part teaches, the others are judged; then with lines of 300 to 1500 Hz that last for two
/// seconds of the steadiest cut, behind a filter of 200 Hz.
void turnmill() {
  const std::string folder = check::outside_data("turnmill-production");
  if (folder.empty()) return;
  const Samples taught = turning(folder + "/part_20181023_dev.f32", 10, 0, 6);
  SlowVibrationConfig config;
  const LearnedVibration learned = learn_vibration(config, taught);
  config.threshold_Nm2 = learned.threshold();
  config.own_lines_hz = learned.own_lines_hz;
  check::figure("turn-mill: windows that taught", static_cast<double>(learned.count()));
  check::figure("turn-mill: threshold", config.threshold_Nm2, "raw^2");
  std::size_t alarms = 0, verdicts = 0;
  detection::Scores scores;
  for (const auto& [name, channels] :
       {std::pair{"segments_1568211798.f32", 8}, std::pair{"segments_1568213682.f32", 8},
        std::pair{"segments_1574906106_dev.f32", 11}}) {
    const Samples part = turning(folder + "/" + name, static_cast<std::size_t>(channels), 4, 6);
    const Watched w = watch(config, part);
    std::printf("  %s: %zu verdicts, %zu alarms, highest %.2f at %.0f Hz\n", name, w.verdicts,
                w.alarms, w.value, w.apparent_hz);
    alarms += w.alarms;
    verdicts += w.verdicts;
    // Stretches of 2 s at one speed, with lines and without.
    std::mt19937_64 bits(5);
    std::uniform_real_distribution<double> uniform;
    for (std::size_t from = 0; from + 2000 <= part.size(); from += 2000) {
      Samples piece(part.begin() + static_cast<std::ptrdiff_t>(from),
                    part.begin() + static_cast<std::ptrdiff_t>(from + 2000));
      const Watched without = watch(config, piece);
      if (without.verdicts < 3) continue;
      double mean = 0;
      for (const VibrationSample& s : piece) mean += s.torque_Nm / 2000;
      const double hz = 300 * std::pow(5.0, uniform(bits));
      const double shown = 0.5 * std::abs(mean) * lag_gain(hz, 200);
      for (std::size_t i = 0; i < piece.size(); ++i)
        piece[i].torque_Nm += shown * std::sin(kTwoPi * hz * 1e-3 * static_cast<double>(i));
      scores.without.push_back(without.value);
      scores.with.push_back(watch(config, piece).value);
    }
  }
  scores.print("turn-mill, lines of half the mean");
  check::figure("turn-mill: alarms of sound parts", static_cast<double>(alarms));
  CHECK(verdicts > 100);
  CHECK(alarms <= 3);
  CHECK(scores.auc() > 0.8);
}

/// Accelerations of milling at 1650 Hz; chatter as in test_recordings.cpp. Learned in the air.
void hurco() {
  const std::string folder = check::outside_data("nolicence/mill-vibration-hurco");
  if (folder.empty()) return;
  const auto accelerations = [&](const fs::path& path, std::size_t axis, double rpm) {
    const std::vector<float> raw = read(path);
    Samples out;
    for (std::size_t i = 0; i + 4 <= raw.size(); i += 4)
      out.push_back(
          {static_cast<double>(raw[i + axis]), rad_s_from_rpm(rpm) / 1650, Quality::good});
    return out;
  };
  SlowVibrationConfig config;
  config.sample_period_s = 1 / 1650.0;
  config.teeth = 4;
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".f32") paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  std::array<SlowVibrationConfig, 2> configs;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    Samples air =
        accelerations(folder + "/AluminumCutsAlongX__EBI_T100_0p375IN_6000RPM.f32", axis, 6000);
    air.erase(air.begin(), air.begin() + 8 * 1650);  // the cut is over
    const LearnedVibration learned = learn_vibration(config, air);
    configs[axis] = config;
    configs[axis].threshold_Nm2 = learned.threshold();
    configs[axis].own_lines_hz = learned.own_lines_hz;
  }
  detection::Scores lines, rms;
  for (const fs::path& path : paths) {
    const std::string name = path.filename().string();
    if (name.starts_with("PCB") || name.find("to6") != std::string::npos) continue;
    const std::size_t at = name.find("RPM");
    std::size_t from = at;
    while (from > 0 && std::isdigit(static_cast<unsigned char>(name[from - 1])) != 0) --from;
    const double rpm = std::stod(name.substr(from, at - from));
    const bool chatter = name.starts_with("CutsAlongX__EBI_T100_0p25IN_6900RPM") ||
                         name.starts_with("CutsAlongX__EBI_T50_0p25IN_6900RPM");
    double value = 0, most = 0;
    std::array<Watched, 2> w;
    for (std::size_t axis = 0; axis < 2; ++axis) {
      const Samples samples = accelerations(path, axis, rpm);
      w[axis] = watch(configs[axis], samples);
      value = std::max(value, w[axis].value);
      double square = 0;
      for (std::size_t i = 0; i < samples.size(); ++i) {
        square += samples[i].torque_Nm * samples[i].torque_Nm;
        if (i % 825 == 824) most = std::max(most, square), square = 0;
      }
    }
    std::printf("  %-62s %s %8.2f at %3.0f Hz %8.2f at %3.0f Hz\n", name.c_str(),
                chatter ? "chatter" : "       ", w[0].value, w[0].apparent_hz, w[1].value,
                w[1].apparent_hz);
    (chatter ? lines.with : lines.without).push_back(value);
    (chatter ? rms.with : rms.without).push_back(most);
  }
  lines.print("accelerations, lines");
  rms.print("accelerations, rms");
  CHECK(lines.with.size() == 2);
  CHECK(lines.auc() >= rms.auc());
}

}  // namespace

int main() {
  turnmill();
  hurco();
  return check::done();
}
