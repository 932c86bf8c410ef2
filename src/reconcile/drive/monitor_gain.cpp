// What an effect does for the monitors: it may close a gap in the model and yet make them read
// more, as backlash does where the instants at which a load meets its flank are not known.
#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "reconcile/drive/workflow.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/text.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kDetectionQuantile = 2.326;  // 99 of 100 cases, as in identify/idle.hpp
constexpr const char* kKey = "used_by_monitors";

/// What the monitors' observer reads while nothing is cut.
struct Reading {
  double rms = 0, largest = 0, smallest_step = 0;
};

std::optional<Reading> reading_of(const MachineFile& machine, const DriveData& data,
                                  const Report& report) {
  const auto config =
      monitor_observer(machine, data.channel, data.effort_kind(), data.sample_period_s);
  if (!config || !DisturbanceObserver<double>::validate(*config).ok()) return std::nullopt;
  DriveRecord record{data.channel, data.sample_period_s, data.samples};
  if (!data.temperature_C.empty()) {
    const Column ratio = constant_ratio(data, column_choices(machine).drive(data.channel).constant);
    for (std::size_t i = 0; i < ratio.size(); ++i) record.samples[i].effort *= ratio[i];
  }
  const std::vector<bool> moving = samples_in_motion(*config, record);
  DisturbanceObserver<double> observer;
  observer.configure(*config);
  Reading r;
  double sum = 0, square = 0, n = 0;
  for (std::size_t i = 0; i < record.samples.size(); ++i) {
    const double estimate = observer.process(record.samples[i]);
    const double t = data.start_s + static_cast<double>(i) * data.sample_period_s;
    if (!moving[i] || t < report.held_from_s || t > report.held_to_s) continue;
    sum += estimate;
    square += estimate * estimate;
    r.largest = std::max(r.largest, std::abs(estimate));
    ++n;
  }
  if (n == 0) return std::nullopt;
  r.rms = std::sqrt(square / n);
  const double spread = std::sqrt(std::max(0.0, square / n - sum / n * (sum / n)));
  r.smallest_step = r.largest + kDetectionQuantile * spread;
  return r;
}

bool better(const std::optional<Reading>& with, const std::optional<Reading>& without,
            const Criteria& criteria) {
  return with && (!without || (with->rms < without->rms &&
                               with->largest <= criteria.more_peak * without->largest));
}

std::vector<std::pair<std::string, double>> figures(const Reading& r, bool turns) {
  const std::string unit = turns ? " [Nm]" : " [N]";
  return {{"estimated force while idling, rms" + unit, r.rms},
          {"its largest value, the least threshold" + unit, r.largest},
          {"smallest step seen above it" + unit, r.smallest_step}};
}

}  // namespace

void choose_for_monitors(MachineFile& machine, const MachineFile& before, const DriveData& data,
                         Report& report) {
  const auto section_of = [&](const FoundEffect& e) {
    return "effect." + report.channel + "." + e.name;
  };
  const auto is_theirs = [&](const FoundEffect& e) {
    return drive_effect_index(e.name) != kDriveEffectCount && machine.has_section(section_of(e));
  };
  // The one that costs most goes first: it may be what makes another one look bad.
  for (;;) {
    const std::optional<Reading> with = reading_of(machine, data, report);
    FoundEffect* worst = nullptr;
    double least = 0;
    for (FoundEffect& e : report.effects) {
      if (!e.used_by_monitors || !is_theirs(e)) continue;
      MachineFile other = machine;
      other.set(section_of(e), kKey, "no");
      const std::optional<Reading> without = reading_of(other, data, report);
      if (!without || better(with, without, report.criteria)) continue;
      if (worst != nullptr && !(without->rms < least)) continue;
      worst = &e;
      least = without->rms;
    }
    if (worst == nullptr) break;
    worst->used_by_monitors = false;
    machine.set(section_of(*worst), kKey, "no");
    report.remarks.push_back(worst->name +
                             " stands in the machine file for simulation and reconcile "
                             "and is kept from the monitors (used_by_monitors = no): on the part "
                             "kept for the proof they read " +
                             (with ? printed(with->rms) : "nothing usable") + " with it and " +
                             printed(least) + " without, rms");
  }
  for (const FoundEffect& e : report.effects)
    if (e.used_by_monitors && is_theirs(e) && machine.has(section_of(e), kKey))
      machine.set(section_of(e), kKey, "yes");

  const std::optional<Reading> was = reading_of(before, data, report);
  const std::optional<Reading> is = reading_of(machine, data, report);
  if (!was || !is) return;
  report.monitors_before = figures(*was, data.turns());
  report.monitors_after = figures(*is, data.turns());
  if (is->rms > was->rms)
    report.remarks.push_back("the monitors read " + printed(is->rms) +
                             " with the recalibrated parameters and " + printed(was->rms) +
                             " with those of " + before.name() + ", rms: keep that file for them");
  if (report.since.empty()) report.summary = summary_of(report, report.channel);
}

}  // namespace servosense::reconcile
