#include "servosense/identify/cut_evidence.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "servosense/dsp/quantile.hpp"

namespace servosense {
namespace {

constexpr double kWindow_s = 0.1;
constexpr std::size_t kLeastSamples = 8;  // of a window
constexpr double kSteady = 0.003;         // speed from window to window, relative
constexpr double kStep = 0.5;             // of the running effort
constexpr double kScatter = 8;            // of the differences of neighbouring windows
constexpr std::size_t kSide = 3;          // windows before and after
constexpr std::size_t kLeastForced = 20;
constexpr double kTorque = 0.2;  // mean over what repeats: below it the effort is no torque

struct Window {
  double start_s = 0, speed = 0, effort = 0;
  bool good = true;
};

std::vector<Window> windows_of(const DriveRecord& record) {
  std::vector<Window> all;
  const auto length = static_cast<std::size_t>(std::lround(kWindow_s / record.sample_period_s));
  if (length < kLeastSamples) return all;
  const auto n = static_cast<double>(length);
  for (std::size_t from = 0; from + length <= record.samples.size(); from += length) {
    Window w;
    w.start_s = static_cast<double>(from) * record.sample_period_s;
    for (std::size_t i = from; i < from + length; ++i) {
      const DriveSample<double>& s = record.samples[i];
      w.good = w.good && !has(s.quality, kUnusable | Quality::gap | Quality::restarted);
      w.speed += s.increment / (n * record.sample_period_s);
      w.effort += s.effort / n;
    }
    all.push_back(w);
  }
  return all;
}

std::string sentence(const char* format, double a, double b, double c) {
  char text[240];
  std::snprintf(text, sizeof text, format, a, b, c);
  return text;
}

}  // namespace

std::optional<std::string> effort_jumps(const DriveRecord& record) {
  const std::vector<Window> windows = windows_of(record);
  double highest = 0;
  for (const Window& w : windows) highest = std::max(highest, std::abs(w.speed));
  const auto steady = [&](std::size_t i) {  // from the one before
    const Window &w = windows[i], &last = windows[i - 1];
    return w.good && last.good && std::abs(w.speed) > 0.01 * highest &&
           std::abs(w.speed - last.speed) <= kSteady * std::abs(w.speed);
  };
  std::vector<double> running, differences;
  std::size_t in_row = 0;
  struct Step {
    double at_s, before, after;
  };
  std::vector<Step> steps;
  for (std::size_t i = 1; i < windows.size(); ++i) {
    in_row = steady(i) ? in_row + 1 : 0;
    if (in_row == 0) continue;
    const double sign = windows[i].speed > 0 ? 1 : -1;
    running.push_back(sign * windows[i].effort);
    differences.push_back(std::abs(windows[i].effort - windows[i - 1].effort));
    if (in_row < 2 * kSide + 1) continue;
    const auto middle_of = [&](std::size_t first) {
      std::vector<double> part;
      for (std::size_t k = first; k < first + kSide; ++k) part.push_back(sign * windows[k].effort);
      return median(part);
    };
    const std::size_t first = i - 2 * kSide;
    steps.push_back({windows[first + kSide].start_s, middle_of(first), middle_of(i + 1 - kSide)});
  }
  const double level = std::abs(median(running)), scatter = median(differences);
  for (const Step& s : steps) {
    const double step = std::abs(s.after - s.before);
    // The lower side is the air.
    const double air = std::min(std::abs(s.before), std::abs(s.after));
    if (step > kStep * std::max(std::min(level, air), 0.1 * level) && step > kScatter * scatter)
      return sentence("the effort goes from %.3g to %.3g at %.4g s while the speed stays the same",
                      s.before, s.after, s.at_s);
  }
  return std::nullopt;
}

std::optional<std::string> torque_repeats(const DisturbanceObserverConfig& observer,
                                          const ChatterConfig& chatter, const DriveRecord& record) {
  DisturbanceObserver<double> torque;
  torque.configure(observer);
  ChatterConfig silent = chatter;
  silent.chatter_threshold_Nm2 = silent.forced_threshold_Nm2 = 0;
  auto monitor = std::make_unique<HostStack::Chatter>();
  monitor->configure(silent);
  std::uint64_t verdicts = 0;
  std::vector<double> forced, residue, running;
  double effort = 0;
  std::size_t n = 0;
  for (const DriveSample<double>& sample : record.samples) {
    const double t = torque.process(sample);
    monitor->process(t, sample.turn_angle_rad, sample.increment, torque.state().quality);
    effort += sample.effort;
    ++n;
    const auto& state = monitor->state();
    if (state.verdicts == verdicts) continue;
    verdicts = state.verdicts;
    const double mean = effort / static_cast<double>(n);
    effort = 0;
    n = 0;
    if (state.signal != SignalState::good) continue;
    forced.push_back(state.forced_Nm2);
    residue.push_back(state.residue_Nm2);
    running.push_back(std::abs(mean));
  }
  if (forced.size() < kLeastForced) return std::nullopt;
  const double repeats = std::sqrt(median(forced)), rest = std::sqrt(median(residue));
  const double run = median(running);
  if (repeats > kStep * run && run > kTorque * repeats && repeats > 2 * rest)
    return sentence(
        "what repeats with each revolution has %.3g Nm rms, beside %.3g Nm to turn it "
        "(and %.2g Nm that does not repeat)",
        repeats, run, rest);
  return std::nullopt;
}

}  // namespace servosense
