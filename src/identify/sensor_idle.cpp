#include "servosense/identify/sensor_idle.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <string>

#include "servosense/core/units.hpp"
#include "servosense/dsp/short_time_fourier.hpp"

namespace servosense {
namespace {

constexpr double kWindow_s = 0.4;
constexpr double kPeak = 12;         // times the median about it
constexpr std::size_t kAbout = 16;   // lines to either side
constexpr double kMultiple = 1.5;    // lines beside a multiple of the rotation that are its own
constexpr double kOwnWindows = 0.6;  // of the windows
constexpr double kSlowest_hz = 40;   // below, the monitor hears nothing

/// Of the lines of one frame.
class Frame {
 public:
  Frame(std::span<const double> power, double turns) : power_(power), turns_(turns) {}
  [[nodiscard]] bool is_multiple(std::size_t k) const {
    if (!(turns_ > 2 * kMultiple)) return false;  // it stands, or nearly
    const double order = static_cast<double>(k) / turns_;
    return std::abs(order - std::round(order)) * turns_ < kMultiple;
  }
  [[nodiscard]] double floor(std::size_t k) const {
    std::vector<double> about;
    const std::size_t low = k > kAbout ? k - kAbout : 0;
    for (std::size_t i = low; i <= std::min(k + kAbout, power_.size() - 1); ++i)
      if (!is_multiple(i)) about.push_back(power_[i]);
    if (about.empty()) return 0;
    const auto middle = about.begin() + static_cast<std::ptrdiff_t>(about.size() / 2);
    std::nth_element(about.begin(), middle, about.end());
    return *middle;
  }
  [[nodiscard]] bool is_peak(std::size_t k) const {
    return power_[k] >= power_[k - 1] && power_[k] > power_[k + 1] && power_[k] > kPeak * floor(k);
  }

 private:
  std::span<const double> power_;
  double turns_;
};

}  // namespace

std::vector<double> SensorIdle::own_lines_hz(std::size_t most) const {
  std::vector<double> hz;
  for (std::size_t i = 0; i < std::min(most, own_lines.size()); ++i)
    hz.push_back(own_lines[i].frequency_hz);
  return hz;
}

Expected<SensorIdle> learn_sensor(std::span<const double> values, std::span<const double> angle_rad,
                                  double sample_period_s) {
  const auto window = std::bit_ceil(
      std::max<std::size_t>(256, static_cast<std::size_t>(kWindow_s / sample_period_s)));
  const std::size_t count = std::min(values.size(), angle_rad.size());
  ShortTimeFourierConfig config;
  config.window = config.hop = window;
  std::vector<std::size_t> heard, found;
  std::vector<double> power, at_hz;
  SensorIdle idle;
  double noise = 0;
  for (std::size_t from = 0; from + window <= count; from += window / 2) {
    const auto x = values.subspan(from, window);
    if (!std::all_of(x.begin(), x.end(), [](double v) { return std::isfinite(v); })) continue;
    const auto frame = short_time_fourier(x, 1 / sample_period_s, config);
    if (!frame) return frame.error();
    const std::size_t lines = frame->lines();
    for (auto* sums : {&heard, &found}) sums->resize(lines);
    for (auto* sums : {&power, &at_hz}) sums->resize(lines);
    const double turns = std::abs(angle_rad[from + window - 1] - angle_rad[from]) / kTwoPi;
    const Frame f(frame->frame(0), turns);
    const double line_hz = frame->frequency_hz[1];
    for (std::size_t k = 2; k + 2 < lines; ++k) {
      if (static_cast<double>(k) * line_hz < kSlowest_hz || f.is_multiple(k)) continue;
      ++heard[k];
      if (!f.is_peak(k)) continue;
      ++found[k];
      power[k] += frame->at(0, k) * frame->peak_to_mean_square;
      // Centre of the three lines of a Hann window.
      const double a = frame->at(0, k - 1), b = frame->at(0, k), c = frame->at(0, k + 1);
      at_hz[k] += line_hz * (static_cast<double>(k) + (c - a) / (a + b + c));
    }
    for (std::size_t k = 2; k + 2 < lines; ++k)
      if (!f.is_multiple(k)) noise += std::min(frame->at(0, k), kPeak * f.floor(k));
    ++idle.windows;
  }
  if (idle.windows == 0)
    return data_error("the sensor has no stretch of " + std::to_string(window) +
                      " samples without a hole; record the idling run with it");
  idle.noise = std::sqrt(noise / static_cast<double>(idle.windows));
  for (std::size_t k = 2; k + 2 < found.size(); ++k) {
    // A line between two bins is the peak of one now and of the other then.
    const std::size_t about = found[k] + found[k + 1];
    if (found[k] + found[k - 1] > about) continue;  // told already, or below
    const auto times = static_cast<double>(std::max(heard[k], heard[k + 1]));
    if (!(times > 0) || !(static_cast<double>(about) >= kOwnWindows * times) || about < 2) continue;
    const auto n = static_cast<double>(about);
    idle.own_lines.push_back(
        {(at_hz[k] + at_hz[k + 1]) / n, std::sqrt(2 * (power[k] + power[k + 1]) / n)});
    ++k;
  }
  std::sort(idle.own_lines.begin(), idle.own_lines.end(),
            [](const auto& a, const auto& b) { return a.amplitude > b.amplitude; });
  return idle;
}

}  // namespace servosense
