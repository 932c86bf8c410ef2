// Chatter by sensors (monitors/sensor_chatter.hpp) on recorded milling: a microphone, 48 kHz
// brought to 8 kHz, and accelerometers at 1650 Hz. Speeds are stated, angles were not recorded.
// Which cuts chatter: test_recordings.cpp. Beside it the naive limits, 1.5 times what the air
// reads: rms of 50 ms, and the strongest line off the multiples of the rotation.
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/short_time_fourier.hpp"
#include "servosense/identify/sensor_idle.hpp"
#include "servosense/monitors/sensor_chatter.hpp"

namespace fs = std::filesystem;
using namespace servosense;

namespace {

using Series = std::vector<double>;
using Ear = SensorChatter<double, 32, 40>;

std::vector<char> bytes(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// 16 bit, mono, 48 kHz: means of six, of full scale 1.
Series sound(const fs::path& path) {
  const std::vector<char> raw = bytes(path);
  Series out;
  double sum = 0;
  std::size_t n = 0;
  for (std::size_t i = 44; i + 1 < raw.size(); i += 2) {
    const auto low = static_cast<std::uint8_t>(raw[i]);
    const auto high = static_cast<std::uint8_t>(raw[i + 1]);
    sum += static_cast<std::int16_t>(static_cast<std::uint16_t>(low | (high << 8U))) / 32768.0;
    if (++n % 6 == 0) {
      out.push_back(sum / 6);
      sum = 0;
    }
  }
  return out;
}

Series acceleration(const fs::path& path, std::size_t axis) {
  const std::vector<char> raw = bytes(path);
  Series out;
  for (std::size_t i = 0; i + 16 <= raw.size(); i += 16) {
    float value = 0;
    std::copy_n(raw.data() + i + 4 * axis, sizeof value, reinterpret_cast<char*>(&value));
    out.push_back(static_cast<double>(value));
  }
  return out;
}

struct Watched {
  bool alarm = false;
  double line = 0, share = 0, hz = 0, rms = 0, naive_line = 0;
};

Series angle_of(std::size_t n, double rpm, double period_s) {
  Series angle(n);
  for (std::size_t i = 0; i < n; ++i)
    angle[i] = rad_s_from_rpm(rpm) * period_s * static_cast<double>(i);
  return angle;
}

Watched watch(const SensorChatterConfig& config, const Series& x, double rpm) {
  const double period_s = config.chatter.sample_period_s;
  static auto ear = std::make_unique<Ear>();
  ear->configure(config);
  const Series angle = angle_of(x.size(), rpm, period_s);
  Watched w;
  std::uint64_t transforms = 0, verdicts = 0;
  std::array<double, 5> last{};
  std::array<double, 4> shares{};
  for (std::size_t i = 1; i < x.size(); ++i) {
    const MonitorState state = ear->hear(x[i], angle[i] - kTwoPi * std::floor(angle[i] / kTwoPi),
                                         angle[i] - angle[i - 1], Quality::good);
    w.alarm = w.alarm || state == MonitorState::alarm;
    const auto& s = ear->chatter().state();
    if (s.transforms != transforms) {
      transforms = s.transforms;
      std::rotate(last.begin(), last.end() - 1, last.end());
      last[0] = s.line;
      const double held = *std::min_element(last.begin(), last.end());
      if (held > w.line) {
        w.line = held;
        w.hz = ear->chatter().lines().state().found.frequency_hz;
      }
    }
    if (s.verdicts != verdicts) {
      verdicts = s.verdicts;
      const auto m = ear->chatter().measures();
      std::rotate(shares.begin(), shares.end() - 1, shares.end());
      shares[0] = m.remembered > 0 ? m.beyond_change / m.remembered : 0;
      w.share = std::max(w.share, *std::min_element(shares.begin(), shares.end()));
    }
  }
  const auto block = static_cast<std::size_t>(0.05 / period_s);
  for (std::size_t from = 0; from + block <= x.size(); from += block) {
    double sum = 0, mean = 0;
    for (std::size_t i = from; i < from + block; ++i) mean += x[i] / static_cast<double>(block);
    for (std::size_t i = from; i < from + block; ++i) sum += (x[i] - mean) * (x[i] - mean);
    w.rms = std::max(w.rms, std::sqrt(sum / static_cast<double>(block)));
  }
  if (const auto s = short_time_fourier(x, 1 / period_s)) {
    for (std::size_t f = 0; f < s->frames(); ++f)
      for (std::size_t k = 4; k < s->lines(); ++k) {
        const double order = s->frequency_hz[k] / (rpm / 60);
        if (std::abs(order - std::round(order)) * rpm / 60 > 1.5 * s->frequency_hz[1])
          w.naive_line = std::max(w.naive_line, s->at(f, k));
      }
  }
  return w;
}

struct Score {
  std::size_t hits = 0, chatter = 0, wrong = 0, sound = 0;
  void add(bool alarm, bool chatters) {
    (chatters ? hits : wrong) += alarm ? 1 : 0;
    ++(chatters ? chatter : sound);
  }
  void print(const char* what) const {
    std::printf("  %-44s %zu of %zu found, %zu of %zu sound ones alarm\n", what, hits, chatter,
                wrong, sound);
  }
};

constexpr double kMargin = 1.5;

/// What the air teaches: lines, and the power beyond the revolution.
SensorChatterConfig taught(SensorChatterConfig config, const Series& air, double rpm) {
  const double period_s = config.chatter.sample_period_s;
  const auto idle = learn_sensor(air, angle_of(air.size(), rpm, period_s), period_s);
  CHECK(idle.has_value());
  if (!idle) return config;
  const auto own = idle->own_lines_hz(config.own_lines_hz.size());
  std::copy(own.begin(), own.end(), config.own_lines_hz.begin());
  auto ear = std::make_unique<Ear>();
  SensorChatterConfig silent = config;
  silent.chatter.lines.threshold = 0;
  ear->configure(silent);
  const double step = rad_s_from_rpm(rpm) * period_s;
  double highest = 0, angle = 0;
  for (const double v : air) {
    angle += step;
    ear->hear(v, angle - kTwoPi * std::floor(angle / kTwoPi), step, Quality::good);
    highest = std::max(highest, ear->chatter().measures().beyond_change);
  }
  config.chatter.chatter_threshold_Nm2 = kMargin * highest;
  return config;
}

void microphone() {
  const std::string folder = check::outside_data("nolicence/milling-chatter-audio");
  if (folder.empty()) return;
  SensorChatterConfig config = sensor_chatter_defaults(Channel::microphone, 1 / 8000.0);
  config.chatter.teeth = 6;
  const Series air = sound(folder + "/idle_dev.wav");
  config = taught(config, air, 1656);
  const Watched idle = watch(config, air, 1656);
  const Watched stable = watch(config, sound(folder + "/stable_dev.wav"), 1494);
  const Watched chatter = watch(config, sound(folder + "/chatter_dev.wav"), 1656);
  for (const auto& [name, w] :
       {std::pair{"idle", &idle}, {"stable", &stable}, {"chatter", &chatter}})
    std::printf("  %-8s %s line %7.1f at %6.1f Hz, share %.2f, rms %.3f\n", name,
                w->alarm ? "ALARM" : "     ", w->line, w->hz, w->share, w->rms);
  Score monitor, rms, line;
  monitor.add(chatter.alarm, true);
  monitor.add(stable.alarm, false);
  rms.add(chatter.rms > kMargin * idle.rms, true);
  rms.add(stable.rms > kMargin * idle.rms, false);
  line.add(chatter.naive_line > kMargin * idle.naive_line, true);
  line.add(stable.naive_line > kMargin * idle.naive_line, false);
  monitor.print("microphone, monitor");
  rms.print("rms");
  line.print("line of an FFT");
  CHECK(!idle.alarm);
}

void accelerometer() {
  const std::string folder = check::outside_data("nolicence/mill-vibration-hurco");
  if (folder.empty()) return;
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".f32") paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  Score monitor, rms, line;
  std::array<SensorChatterConfig, 2> configs;
  std::array<Watched, 2> air;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    Series rest = acceleration(folder + "/AluminumCutsAlongX__EBI_T100_0p375IN_6000RPM.f32", axis);
    rest.erase(rest.begin(), rest.begin() + 8 * 1650);  // the cut is over
    SensorChatterConfig config = sensor_chatter_defaults(Channel::accelerometer, 1 / 1650.0);
    config.chatter.teeth = 4;
    configs[axis] = taught(config, rest, 6000);
    air[axis] = watch(configs[axis], rest, 6000);
    CHECK(!air[axis].alarm);
  }
  for (const fs::path& path : paths) {
    const std::string name = path.filename().string();
    // Another sensor; the speed changes; eighth of a turn a sample is the limit.
    if (name.starts_with("PCB") || name.find("to6") != std::string::npos) continue;
    std::size_t from = name.find("RPM");
    const std::size_t at = from;
    while (from > 0 && std::isdigit(static_cast<unsigned char>(name[from - 1])) != 0) --from;
    const double rpm = std::stod(name.substr(from, at - from));
    const bool chatters = name.starts_with("CutsAlongX__EBI_T100_0p25IN_6900RPM") ||
                          name.starts_with("CutsAlongX__EBI_T50_0p25IN_6900RPM");
    bool alarm = false, loud = false, high = false;
    for (std::size_t axis = 0; axis < 2; ++axis) {
      const Watched w = watch(configs[axis], acceleration(path, axis), rpm);
      std::printf("  %-58s %zu %s %s line %8.1f at %5.1f Hz, share %.2f, rms %.2f\n", name.c_str(),
                  axis, chatters ? "chatter" : "       ", w.alarm ? "ALARM" : "     ", w.line, w.hz,
                  w.share, w.rms);
      alarm = alarm || w.alarm;
      loud = loud || w.rms > kMargin * air[axis].rms;
      high = high || w.naive_line > kMargin * air[axis].naive_line;
    }
    monitor.add(alarm, chatters);
    rms.add(loud, chatters);
    line.add(high, chatters);
  }
  monitor.print("accelerometer, monitor");
  rms.print("rms");
  line.print("line of an FFT");
  CHECK(monitor.chatter == 2);
  CHECK(monitor.wrong <= rms.wrong && monitor.wrong <= line.wrong);
}

}  // namespace

int main() {
  microphone();
  accelerometer();
  return check::done();
}
