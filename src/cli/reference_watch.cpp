#include "reference_watch.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "servosense/core/units.hpp"
#include "servosense/hal/wrapped_rows.hpp"
#include "servosense/identify/learn_reference.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kSection = "monitor.reference";
constexpr double kSameRate = 0.02, kSameTool = 0.02;
constexpr double kRelease = 0.8;  // of the threshold: an alarm ends below it

// Of ReferenceWatch::left_out_, beside those of NotCompared.
constexpr std::size_t kTooShort = 6;

std::string four_digits(double t_s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4f", t_s);
  return text;
}

std::string words_for(const ReferenceLayout& layout, const ReferenceFeature& f) {
  const std::string name = column_name(layout.signals[f.signal].signal);
  switch (f.kind) {
    case ReferenceFeatureKind::level:
      return name + ", mean";
    case ReferenceFeatureKind::swing:
      return name + ", swing about the mean";
    case ReferenceFeatureKind::order:
      if (f.at == 1) return name + ", once a turn";
      if (layout.teeth > 1 && f.at == layout.teeth) return name + ", tooth passing frequency";
      return name + ", " + number_text(f.at) + " times a turn";
    case ReferenceFeatureKind::between:
      return name + ", turning, between the tooth passing frequencies";
    case ReferenceFeatureKind::band:
      return name + ", band around " + printed(f.at, 3) + " Hz";
  }
  return name;
}

}  // namespace

class ReferenceWatch::Tap final : public WrappedRows {
 public:
  Tap(std::unique_ptr<RowSource> rows, ReferenceWatch& watch)
      : WrappedRows(std::move(rows)), watch_(watch) {}
  Expected<bool> next(TraceRow& row) override {
    auto more = rows_->next(row);
    if (more && *more && !row.fields.empty()) watch_.hear(row);
    return more;
  }

 private:
  ReferenceWatch& watch_;
};

Expected<std::unique_ptr<ReferenceWatch>> ReferenceWatch::open(const MachineFile& machine) {
  std::unique_ptr<ReferenceWatch> watch(new ReferenceWatch(machine));
  const auto file = machine.text(kSection, "reference");
  if (!file || !machine.flag(kSection, "enabled").value_or(true)) return watch;
  watch->path_ = machine.beside(*file);
  auto reference = read_reference(watch->path_);
  if (!reference) return reference.error();
  watch->features_ = reference_features(reference->layout);
  watch->reference_ = std::move(*reference);
  return watch;
}

std::unique_ptr<RowSource> ReferenceWatch::tap(std::unique_ptr<RowSource> rows) {
  if (!reference_) return rows;
  begin(rows->signals());
  return std::make_unique<Tap>(std::move(rows), *this);
}

void ReferenceWatch::begin(const std::vector<Signal>& signals) {
  columns_ = signals;
  auto turn = turn_column(machine_, signals);
  if (!turn) {
    begin_failed_ = turn.error().sentence;
    return;
  }
  std::vector<bool> present;
  for (const ReferenceSignal& s : reference_->layout.signals)
    present.push_back(std::find(signals.begin(), signals.end(), s.signal) != signals.end());
  auto distance = ReferenceDistance::learn(*reference_, present);
  if (!distance) {
    begin_failed_ = path_ + ": " + distance.error().sentence;
    return;
  }
  distance_ = std::move(*distance);
  cutter_.emplace(reference_->layout, signals, *turn);
}

std::string ReferenceWatch::why_not(double sample_period_s, bool live) {
  const ReferenceLayout& layout = reference_->layout;
  if (live) return "compares records, no live source; record with --record, then give the trace";
  if (!begin_failed_.empty()) return begin_failed_;
  const double rate_hz = 1 / sample_period_s;
  if (std::abs(rate_hz - layout.sample_rate_hz) > kSameRate * layout.sample_rate_hz)
    return "the reference is of " + number_text(layout.sample_rate_hz) + " Hz, the record of " +
           printed(rate_hz, 3) + " Hz; learn one from traces of that rate";
  const double diameter_m = machine_.number("tool", "diameter_m").value_or(0);
  if (diameter_m > 0 && reference_->tool_diameter_m > 0 &&
      std::abs(diameter_m - reference_->tool_diameter_m) > kSameTool * diameter_m)
    return "the reference is of a tool of " + number_text(reference_->tool_diameter_m) +
           " m, the machine file has one of " + number_text(diameter_m) + " m";
  const double teeth = machine_.number("tool", "teeth").value_or(0);
  if (teeth > 0 && layout.teeth > 0 && teeth != layout.teeth)
    return "the reference is of a tool of " + std::to_string(layout.teeth) +
           " teeth, the machine file has one of " + number_text(teeth);
  const Signal effort = layout.signals[layout.effort].signal;
  if (layout.cutting_level > 0 &&
      std::find(columns_.begin(), columns_.end(), effort) == columns_.end())
    return "needs " + column_name(effort) + ", which tells cuts from air in its reference";
  return "";
}

void ReferenceWatch::plan(double sample_period_s, bool live, StackPlan& plan) {
  MonitorAvailability m{MonitorId::reference, Channel::tool, false, "", ""};
  if (!machine_.flag(kSection, "enabled").value_or(true)) {
    m.reason = "is switched off in the machine file";
    m.obstacle = "switched off";
  } else if (!reference_) {
    m.reason =
        "has no reference; run 'servosense identify reference' and write reference in "
        "[monitor.reference]";
    m.obstacle = "no reference";
  } else if (m.reason = why_not(sample_period_s, live); !m.reason.empty()) {
    m.obstacle = "another record than the reference is for";
  } else {
    m.runs = runs_ = true;
    m.reason = "compares windows of " + printed(reference_->layout.window_s, 3) + " s with " +
               std::to_string(reference_->sound.size()) + " of sound cuts";
    const ReferenceLayout& layout = reference_->layout;
    const auto missing = [&](Signal s, const char* what) {
      if (std::find(columns_.begin(), columns_.end(), s) == columns_.end())
        plan.remarks.push_back("monitor reference: " + column_name(s) + what);
    };
    for (const ReferenceSignal& s : layout.signals)
      missing(s.signal, " of the reference is not in the record: compared without it");
    for (const Signal s : layout.place)
      missing(s, " of the reference is not in the record: places are not told by it");
    if (layout.blocks)
      missing({Channel::machine, Quantity::nc_block},
              " of the reference is not in the record: windows of all blocks are compared");
  }
  plan.monitors.push_back(std::move(m));
}

void ReferenceWatch::hear(const TraceRow& row) {
  if (cutter_) judge(cutter_->add(row));
}

void ReferenceWatch::judge(const std::vector<ReferenceWindow>& windows) {
  for (const ReferenceWindow& w : windows) {
    const std::size_t i = verdicts_.size();
    verdicts_.push_back({w.from_s, w.to_s, std::nullopt});
    compared_.push_back(w.why == NotCompared::no ? distance_->compare(w) : std::nullopt);
    if (!compared_.back()) {
      ++left_out_[static_cast<std::size_t>(w.why == NotCompared::no ? NotCompared::other_block
                                                                    : w.why)];
      left_out_[kTooShort] += waiting_.size();
      waiting_.clear();
      three_.interrupt();
      settled_ = i + 1;
      continue;
    }
    waiting_.push_back(i);
    const auto known = three_.add(compared_.back()->distance);
    if (known.empty()) continue;
    for (std::size_t k = 0; k < waiting_.size(); ++k) verdicts_[waiting_[k]].distance = known[k];
    waiting_.clear();
    settled_ = i + 1;
  }
}

std::string ReferenceWatch::reason(std::size_t window) const {
  // Of the window itself and of the two that speak for it.
  const Compared* most = nullptr;
  for (std::size_t i = window < 2 ? 0 : window - 2; i <= window; ++i)
    if (compared_[i] && (most == nullptr || compared_[i]->distance > most->distance))
      most = &*compared_[i];
  const ReferenceVerdict& v = verdicts_[window];
  return words_for(reference_->layout, features_[most->feature]) + ": " + printed(most->ratio, 3) +
         " times its sound level, from " + four_digits(v.from_s) + " to " + four_digits(v.to_s) +
         " s";
}

std::vector<ReferenceWatch::Change> ReferenceWatch::changes(double t_s) {
  std::vector<Change> out;
  if (!runs_) return out;
  for (; told_ < settled_; ++told_) {
    const auto& distance = verdicts_[told_].distance;
    MonitorState now = MonitorState::idle;
    if (distance)
      now = *distance > threshold() ||
                    (state_ == MonitorState::alarm && *distance > kRelease * threshold())
                ? MonitorState::alarm
                : MonitorState::armed;
    if (now == state_) continue;
    Change c;
    c.change = {MonitorId::reference, Channel::tool, now, state_,
                distance.value_or(0), threshold()};
    c.event.t_s = t_s;
    c.event.monitor = MonitorId::reference;
    c.event.channel = std::string(name_of(Channel::tool));
    c.event.state = now;
    c.event.value = distance.value_or(std::nan(""));
    c.event.threshold = threshold();
    c.event.unit = "1";
    c.event.reason = now == MonitorState::alarm   ? reason(told_)
                     : now == MonitorState::armed ? "as the sound cuts"
                                                  : "nothing to compare";
    state_ = now;
    out.push_back(std::move(c));
  }
  return out;
}

std::vector<ReferenceWatch::Change> ReferenceWatch::finish(double t_s) {
  if (cutter_) judge(cutter_->finish());
  left_out_[kTooShort] += waiting_.size();
  waiting_.clear();
  settled_ = verdicts_.size();
  return changes(t_s);
}

void ReferenceWatch::tell(StackPlan& plan) const {
  if (!runs_) return;
  for (MonitorAvailability& m : plan.monitors) {
    if (m.monitor != MonitorId::reference) continue;
    SeesFrom s;
    s.value = distance_->seen_ratio();
    s.unit = "ratio";
    s.text = "an order or band of " + printed(s.value, 3) + " times its sound amplitude";
    if (std::isfinite(s.value)) {
      m.reason += ": sees " + s.text + ", the middle one";
      m.sees_from = std::move(s);
    }
  }
  const std::pair<std::size_t, const char*> kinds[] = {
      {static_cast<std::size_t>(NotCompared::too_few_samples), "lack samples"},
      {static_cast<std::size_t>(NotCompared::entry_or_exit), "hold an entry or exit"},
      {static_cast<std::size_t>(NotCompared::other_speed), "hold a change of speed"},
      {static_cast<std::size_t>(NotCompared::other_block),
       "are of a block or speed without a sound cut"},
      {kTooShort, "are of cuts shorter than three windows"}};
  std::string text;
  for (const auto& [kind, what] : kinds)
    if (left_out_[kind] > 0)
      text += (text.empty() ? "" : ", ") + std::to_string(left_out_[kind]) + " " + what;
  if (!text.empty())
    plan.remarks.push_back("monitor reference: of " + std::to_string(verdicts_.size()) +
                           " windows " + text + ": not compared");
}

}  // namespace servosense::cli
