// Stamps that are wrong, in every way, from each kind of source: an axis goes to and fro at 0.5
// m/s, the fault comes in mid stroke, while it changes speed, and while it stands, and long after
// the fault it runs into something. Of each case: no alarm from the fault, a flag within the
// samples that docs/can.md states, and the contact found. Prints the table of that page.
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "../monitors/four_drives.hpp"
#include "check.hpp"
#include "servosense/hal/frame_aligner.hpp"
#include "servosense/hal/sample_source.hpp"

using namespace servosense;

namespace {

constexpr Nanoseconds kPeriod = 125'000;
constexpr Nanoseconds kStart = 1'700'000'000'000'000'000;
constexpr Nanoseconds kMs = 1'000'000, kS = 1000 * kMs, kHour = 3600 * kS;
constexpr std::int64_t kContact = 8 * 3020;  // in mid stroke, 3.02 s
constexpr std::int64_t kRows = kContact + 400;
constexpr std::int64_t kFaultRows = 4000;   // of a fault that passes
constexpr std::int64_t kFlaggedWithin = 8;  // samples

enum class Source { trace, counters, time, sync };
constexpr std::array<const char*, 4> kSourceNames = {"trace", "counters", "time", "sync"};

/// A row or frame: when it was taken, and how it is stamped.
struct Event {
  double taken = 0;  // in periods
  Nanoseconds t_ns = 0;
};

enum class Flag { none, allowed, required, always };

struct Case {
  const char* name;
  Flag flag;
  bool in_a_trace;  // the reader refuses stamps that go back
  /// All events of a record with the fault at row `at`.
  std::function<std::vector<Event>(std::int64_t at)> events;
  std::optional<Source> blind = {};  ///< where it cannot be told from something harmless
};

Nanoseconds on_time(double taken) {
  return kStart + std::llround(taken * static_cast<double>(kPeriod));
}

std::vector<Event> regular() {
  std::vector<Event> all;
  for (std::int64_t n = 0; n < kRows; ++n) {
    const auto taken = static_cast<double>(n);
    all.push_back({taken, on_time(taken)});
  }
  return all;
}
auto stepped(Nanoseconds by) {
  return [by](std::int64_t at) {
    auto all = regular();
    for (auto i = static_cast<std::size_t>(at); i < all.size(); ++i) all[i].t_ns += by;
    return all;
  };
}
auto stray(Nanoseconds by) {
  return [by](std::int64_t at) {
    auto all = regular();
    all[static_cast<std::size_t>(at)].t_ns += by;
    return all;
  };
}
auto jittered(double us) {
  return [us](std::int64_t at) {
    auto all = regular();
    std::mt19937 random(static_cast<unsigned>(at));
    for (auto i = static_cast<std::size_t>(at); i < static_cast<std::size_t>(at + kFaultRows); ++i)
      all[i].t_ns +=
          std::llround(1000 * us * (2.0 * (static_cast<double>(random()) / 4294967296.0) - 1));
    return all;
  };
}
auto lost(std::int64_t rows) {
  return [rows](std::int64_t at) {
    auto all = regular();
    all.erase(all.begin() + at, all.begin() + at + rows);
    return all;
  };
}
/// Stamps run `rate` times too slowly for a while: nothing else is wrong.
auto dense(double rate) {
  return [rate](std::int64_t at) {
    auto all = regular();
    const auto end = static_cast<std::size_t>(at + kFaultRows);
    const Nanoseconds from = all[static_cast<std::size_t>(at)].t_ns;
    Nanoseconds saved = 0;
    for (auto i = static_cast<std::size_t>(at); i < all.size(); ++i) {
      if (i < end) saved = std::llround(static_cast<double>(all[i].t_ns - from) * (1 - 1 / rate));
      all[i].t_ns -= saved;
    }
    return all;
  };
}
/// Events truly come at another rate for a while.
auto other_rate(double rate) {
  return [rate](std::int64_t at) {
    std::vector<Event> all;
    const auto from = static_cast<double>(at), to = static_cast<double>(at + kFaultRows);
    for (double taken = 0; taken < static_cast<double>(kRows);
         taken += taken >= from && taken < to ? 1 / rate : 1)
      all.push_back({taken, on_time(taken)});
    return all;
  };
}
auto twice(std::int64_t every) {
  return [every](std::int64_t at) {
    std::vector<Event> all;
    for (const Event& e : regular()) {
      all.push_back(e);
      const auto n = static_cast<std::int64_t>(e.taken);
      if (n >= at && n < at + kFaultRows && n % every == 0) all.push_back({e.taken, e.t_ns + 1});
    }
    return all;
  };
}

std::vector<Case> cases() {
  using F = Flag;
  return {
      {"nothing", F::none, true, stepped(0)},
      {"clock set back by 1 ms", F::required, false, stepped(-kMs)},
      {"clock set back by 1 s", F::required, false, stepped(-kS)},
      {"clock set back by 1 h", F::required, false, stepped(-kHour)},
      {"clock set ahead by 1 ms", F::required, true, stepped(kMs), Source::trace},
      {"clock set ahead by 1 s", F::required, true, stepped(kS)},
      {"clock set ahead by 1 h", F::required, true, stepped(kHour)},
      {"one stamp 1 h ahead", F::allowed, false, stray(kHour)},
      {"one stamp 1 h back", F::allowed, false, stray(-kHour)},
      {"one stamp 1 ms ahead", F::allowed, false, stray(kMs)},
      {"jitter of 10 us", F::allowed, true, jittered(10)},
      {"jitter of 30 us", F::allowed, true, jittered(30)},
      {"jitter of 60 us", F::allowed, true, jittered(60)},
      {"jitter of 100 us", F::required, true, jittered(100)},
      {"jitter of 200 us", F::required, true, jittered(200)},
      {"stamps twice too dense", F::required, true, dense(2)},
      {"stamps 1000 times too dense", F::required, true, dense(1000)},
      {"rows at 16 kHz", F::required, true, other_rate(2)},
      {"rows at 10 kHz", F::required, true, other_rate(1.25)},
      {"rows at 6 kHz", F::required, true, other_rate(0.75), Source::counters},
      {"every row twice", F::allowed, true, twice(1)},
      {"every tenth row twice", F::allowed, true, twice(10)},
      {"1 row lost", F::always, true, lost(1)},
      {"3 rows lost", F::always, true, lost(3)},
      {"8 rows lost", F::always, true, lost(8)},
      {"9 rows lost", F::always, true, lost(9)},
      {"1 s lost", F::always, true, lost(8000)},
  };
}

/// What x reports.
class Axis {
 public:
  Axis() {
    for (std::int64_t n = 0; n < kRows; ++n) {
      const oracle::Motion m = four_drives::kMove.at(static_cast<double>(n) * 125e-6);
      friction_.push_back(koike::kAxis[0].coulomb_N * bristle_.follow(m.x - last_));
      last_ = m.x;
    }
  }
  [[nodiscard]] std::array<TraceField, 2> at(double taken) const {
    const oracle::Motion m = four_drives::kMove.at(taken * 125e-6);
    const auto n = std::min(static_cast<std::size_t>(taken), friction_.size() - 1);
    double force = koike::kAxis[0].mass_kg * m.a + koike::kAxis[0].viscous * m.v + friction_[n];
    const double into = taken - static_cast<double>(kContact);
    if (into > 0) force += std::min(2000.0, 20 * into);  // 160 kN/s
    return {TraceField::of(m.x), TraceField::of(force)};
  }

 private:
  oracle::Bristle bristle_;
  double last_ = 0;
  std::vector<double> friction_;
};

const std::vector<Signal> kSignals = {{Channel::x, Quantity::position_m},
                                      {Channel::x, Quantity::force_N}};

class Rows final : public RowSource {
 public:
  Rows(Source source, std::vector<Event> events, const Axis& axis)
      : source_(source), events_(std::move(events)), axis_(axis), aligner_(config(source)) {}
  [[nodiscard]] const std::vector<Signal>& signals() const override { return kSignals; }
  [[nodiscard]] bool in_contact() const {
    return at_ > 0 && events_[at_ - 1].taken > static_cast<double>(kContact);
  }
  [[nodiscard]] double period_s() const override { return source_ == Source::trace ? 0 : 125e-6; }
  Expected<bool> next(TraceRow& row) override {
    if (source_ == Source::trace) {
      if (at_ == events_.size()) return false;
      const auto fields = axis_.at(events_[at_].taken);
      // What a reader takes is sorted.
      last_ns_ = std::max(events_[at_++].t_ns, last_ns_ + 1);
      row.t_ns = last_ns_;
      row.fields.assign(fields.begin(), fields.end());
      return true;
    }
    while (!aligner_.pop(row)) {
      if (at_ == events_.size()) return false;
      const Event& e = events_[at_++];
      if (source_ == Source::sync) aligner_.sync(e.t_ns - 1000);
      // A sender counts what it sends; a repeated frame has the same count.
      if (at_ < 2 || e.taken != events_[at_ - 2].taken)
        count_ += at_ < 2 ? 0U
                          : static_cast<unsigned>(
                                std::max(1.0, std::floor(e.taken - events_[at_ - 2].taken)));
      const auto fields = axis_.at(e.taken);
      aligner_.push(
          0, e.t_ns, fields,
          source_ == Source::counters ? std::optional<std::uint32_t>(count_ & 255U) : std::nullopt);
      if (at_ == events_.size()) aligner_.finish();
    }
    return true;
  }

 private:
  static AlignerConfig config(Source source) {
    return {
        kPeriod, {{0, 2, 1, 1, source == Source::counters ? 8U : 0U}}, source == Source::sync, 20};
  }
  Source source_;
  std::vector<Event> events_;
  const Axis& axis_;
  FrameAligner aligner_;
  std::size_t at_ = 0;
  unsigned count_ = 0;
  Nanoseconds last_ns_ = 0;
};

struct Outcome {
  std::uint64_t rows = 0, flagged = 0;
  std::int64_t flag_after = -1;  // rows from the fault to the first flagged sample
  int alarms = 0;                // before the contact
  bool found = false;
};

MonitorStackConfig stack_config() {
  MonitorStackConfig c = four_drives::config();
  c.spindle.present = c.axis[1].present = c.axis[2].present = false;
  c.axis[0].input.kind = MotionKind::position;
  return c;
}

Outcome run(Source kind, const Case& c, std::int64_t at, const Axis& axis) {
  Outcome outcome;
  auto rows = std::make_unique<Rows>(kind, c.events(at), axis);
  const Rows& sender = *rows;
  auto source = SampleSource::open(std::move(rows), "rows");
  CHECK(source);
  if (!source) return outcome;
  const auto stack = std::make_unique<four_drives::Stack<double>>();
  stack->configure(stack_config());
  ServoSample<double> sample;
  std::int64_t heard = 0;
  while (*source->next(sample)) {
    ++heard;
    outcome.rows += source->recorded() ? 1 : 0;
    const auto& x = sample.axis[0];
    if (has(x.motion_quality | x.effort_quality, kUnusable)) {
      ++outcome.flagged;
      if (outcome.flag_after < 0) outcome.flag_after = heard - at;
    }
    for (const auto& change : stack->process(sample)) {
      if (change.state != MonitorState::alarm) continue;
      if (sender.in_contact())
        outcome.found = true;
      else
        ++outcome.alarms;
    }
  }
  return outcome;
}

}  // namespace

int main() {
  const Axis axis;
  std::printf("| fault | source | rows | flagged | first flag | false alarms | contact found |\n");
  std::printf("|---|---|--:|--:|--:|--:|---|\n");
  for (const Case& c : cases())
    for (const Source source : {Source::trace, Source::counters, Source::time, Source::sync}) {
      if (source == Source::trace && !c.in_a_trace) continue;
      Outcome sum;
      bool found = true;
      // In mid stroke, while it slows down, while it stands.
      for (const std::int64_t at : {12480, 14720, 14960}) {
        const Outcome o = run(source, c, at, axis);
        sum.rows += o.rows;
        sum.flagged += o.flagged;
        sum.flag_after = std::max(sum.flag_after, o.flag_after);
        sum.alarms += o.alarms;
        found = found && o.found;
        // A counter tells the row, whatever the stamps: only what is lost must be flagged.
        const bool must =
            c.flag == Flag::always || (c.flag == Flag::required && source != Source::counters);
        if (must) CHECK(o.flagged > 0 && o.flag_after <= kFlaggedWithin);
        if (c.flag == Flag::none) CHECK(o.flagged == 0);
        const bool blind = c.blind && *c.blind == source;
        if (!blind) CHECK(o.alarms == 0);
        CHECK(o.found);
      }
      std::printf("| %s | %s | %llu | %llu | %lld | %d | %s |\n", c.name,
                  kSourceNames[static_cast<std::size_t>(source)],
                  static_cast<unsigned long long>(sum.rows / 3),
                  static_cast<unsigned long long>(sum.flagged / 3),
                  static_cast<long long>(sum.flag_after), sum.alarms, found ? "yes" : "NO");
    }
  return check::done();
}
