// Detection against false alarms: random simulated cuts, seen through drives, counters and
// observers by the monitor stack with what it learned from an idling run. Beside it the naive
// rivals.
//
//   detection_study                  a small fixed set
//   detection_study --nightly        500 cuts of each kind and a shift of eight hours
//   detection_study --cases N [--from SEED] [--hours H] [--csv FILE]    FILE: a row a cut
//   detection_study ... --development   seeds that were looked at before: no figures
//   detection_study ... --event KIND    stable cuts and those of one kind alone
//   detection_study --show SEED KIND    one cut, with every alarm (KIND 0..3:
//   detection::Event)
// Figures and what was drawn: docs/detection.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/random_cuts.hpp"
#include "detection/scores.hpp"
#include "development_seeds.hpp"
#include "servosense/dsp/short_time_fourier.hpp"

using namespace servosense;
using namespace detection;
using detection::Event;

namespace {

// Looked at since: they keep what was reached, and figures come from others.
constexpr std::uint64_t kFirstSeed = 100000;
// A cut with less vibration than the first is stable, with more than the second it chatters, both
// in feeds per tooth and away from changes. In between the draw is passed over.
constexpr double kStill = 0.2, kChatters = 0.3;
// A tooth that breaks while less than this part of the largest load is on does not count.
constexpr double kLoaded = 0.6;
// Chatter counts as visible when its power in the torque of the cut is so many times the threshold
// that the idling run asks for: the observer's low-pass takes up to a tenth.
constexpr double kVisible = 10;

double wide(float x) { return static_cast<double>(x); }
double feed_of(const Cut& c) { return c.milling().cut.feed_per_tooth_m; }

struct AlarmTime {
  double t_s = 0;
  MonitorId monitor = MonitorId::signal;
  Channel channel = Channel::machine;
};

// What the stack makes of a record.
struct Watched {
  HostStackConfig config;
  std::vector<AlarmTime> alarms;
  std::vector<float> tooth, ar, collision;  // value over threshold at every sample
  // What the spindle's monitors hear.
  std::vector<float> torque_Nm;
  struct Turn {
    double angle_rad, increment_rad;
    Quality quality;
    std::array<double, kAxes> position_m;
  };
  std::vector<Turn> turn;
  std::vector<float> force_N;  // larger of x and y, size

  [[nodiscard]] double alarm(MonitorId monitor, double from_s = 0, double to_s = kNever) const {
    for (const AlarmTime& a : alarms)
      if (a.monitor == monitor && a.t_s >= from_s && a.t_s <= to_s) return a.t_s;
    return kNever;
  }
};

std::size_t sample_at(double t_s) {
  return t_s > 0 ? static_cast<std::size_t>(std::llround(std::min(t_s, 1e6) / kPeriod_s)) : 0;
}

float highest(const std::vector<float>& v, double from_s = 0, double to_s = kNever) {
  float most = 0;
  for (std::size_t i = sample_at(from_s); i < std::min(v.size(), sample_at(to_s)); ++i)
    most = std::max(most, v[i]);
  return most;
}

// An alarm, and of teeth not of a pattern that lasts.
template <typename Change>
bool raised(const Change& change) {
  return change.state == MonitorState::alarm &&
         (change.detail == 0 || change.monitor == MonitorId::chatter);
}

Watched watch(const Cut& c, const Record& r, const HostStackConfig& config) {
  Watched w;
  w.config = config;
  static auto stack = std::make_unique<HostStack>();
  CHECK_TEXT(HostStack::validate(config).reason(), "");
  stack->configure(config);
  Reporter<double> reporter(c, r, c.seed + 1);
  const auto ratio = [](double value, double threshold) {
    return static_cast<float>(threshold > 0 ? std::abs(value) / threshold : 0);
  };
  for (std::size_t i = 0; i < r.size(); ++i) {
    const double t = static_cast<double>(i) * kPeriod_s;
    for (const auto& change : stack->process(reporter.at(i)))
      if (raised(change)) w.alarms.push_back({t, change.monitor, change.channel});
    const auto& tooth = stack->tool().tooth_breakage().core();
    const auto& ar = stack->tool().ar_breakage().core();
    w.tooth.push_back(tooth.state().signal == SignalState::good
                          ? ratio(tooth.state().value, tooth.alarm().threshold())
                          : 0);
    w.ar.push_back(ar.state().signal == SignalState::good
                       ? ratio(ar.state().value, ar.alarm().threshold())
                       : 0);
    float jerk = 0, force = 0;
    for (std::size_t a = 0; a < 2; ++a) {
      const auto& alarm = stack->collision(a).alarm();
      jerk = std::max(jerk, ratio(alarm.state().value, alarm.threshold()));
      force = std::max(force, static_cast<float>(std::abs(stack->axis(a).estimate)));
    }
    w.collision.push_back(jerk);
    w.force_N.push_back(force);
    const auto& s = stack->spindle();
    w.torque_Nm.push_back(static_cast<float>(s.estimate));
    w.turn.push_back({s.sample.turn_angle_rad,
                      s.sample.increment,
                      s.quality,
                      {stack->axis(0).sample.position, stack->axis(1).sample.position, 0}});
  }
  return w;
}

// Held for as many samples as an alarm takes.
float held(const std::vector<float>& v, unsigned samples, double from_s, double to_s) {
  float most = 0;
  const std::size_t end = std::min(v.size(), sample_at(to_s));
  for (std::size_t i = sample_at(from_s) + samples; i <= end; ++i) {
    float least = v[i - 1];
    for (std::size_t k = 2; k <= samples; ++k) least = std::min(least, v[i - k]);
    most = std::max(most, least);
  }
  return most;
}

// Highest multiple of its threshold at which the chatter monitor still alarms: its logic asks for
// several verdicts in a row.
double chatter_score(const Watched& w) {
  static auto monitor = std::make_unique<HostStack::Chatter>();
  const auto alarms = [&](double factor) {
    ChatterConfig config = w.config.spindle.chatter;
    config.chatter_threshold_Nm2 *= factor;
    config.lines.threshold *= factor;
    monitor->configure(config);
    for (std::size_t i = 0; i < w.turn.size(); ++i) {
      if (monitor->process(wide(w.torque_Nm[i]), w.turn[i].angle_rad, w.turn[i].increment_rad,
                           w.turn[i].quality) == MonitorState::alarm)
        return true;
      if (monitor->asks_position()) monitor->tell_position(w.turn[i].position_m);
    }
    return false;
  };
  double low = std::ldexp(1, -12), high = std::ldexp(1, 20);
  if (!alarms(low)) return low;
  while (high > 1.05 * low) {
    const double middle = std::sqrt(low * high);
    (alarms(middle) ? low : high) = middle;
  }
  return low;
}

// ---- Rivals, on the same estimate. Levels are told against those of the idling run, as ours are.

// Highest line that is no multiple of the tooth frequency (or only those of the spindle's harmonics
// between), mean square [Nm2].
double highest_line(const Cut& c, const Watched& w, bool of_the_turn) {
  ShortTimeFourierConfig config;
  config.window = 2048;
  config.hop = 512;
  std::vector<double> torque;
  for (std::size_t i = 0; i < w.turn.size(); ++i)
    torque.push_back(has(w.turn[i].quality, Quality::settling) ? 0.0 : wide(w.torque_Nm[i]));
  const Spectrogram s = good(short_time_fourier(torque, 1 / kPeriod_s, config), "spectrogram");
  const double line_hz = s.frequency_hz[1];
  double most = 0;
  for (std::size_t f = 0; f < s.frames(); ++f) {
    const std::size_t first = f * config.hop;
    double turned = 0;
    for (std::size_t i = first; i < first + config.window; ++i) turned += w.turn[i].increment_rad;
    const double turn_hz = turned / kTwoPi / (static_cast<double>(config.window) * kPeriod_s);
    if (turn_hz < 15) continue;  // the monitor idles too
    const double tooth_hz = turn_hz * c.teeth();
    for (std::size_t k = 4; k < s.lines(); ++k) {
      const double f_hz = s.frequency_hz[k];
      const auto off = [&](double base) { return std::abs(f_hz - base * std::round(f_hz / base)); };
      if (off(tooth_hz) < 3 * line_hz) continue;
      if (of_the_turn && off(turn_hz) > line_hz) continue;
      most = std::max(most, s.at(f, k));
    }
  }
  return most;
}

// Variance over eight revolutions, at its largest [Nm2].
double highest_variance(const Watched& w, double minimum_speed_rad_s) {
  double sum = 0, square = 0, turned = 0, most = 0;
  std::size_t first = 0;
  const auto torque = [&](std::size_t i) { return wide(w.torque_Nm[i]); };
  for (std::size_t i = 0; i < w.turn.size(); ++i) {
    if (has(w.turn[i].quality, Quality::settling)) {
      first = i + 1;
      sum = square = turned = 0;
      continue;
    }
    sum += torque(i);
    square += torque(i) * torque(i);
    turned += w.turn[i].increment_rad;
    if (turned < 8 * kTwoPi) continue;
    while (turned > 8 * kTwoPi) {
      sum -= torque(first);
      square -= torque(first) * torque(first);
      turned -= w.turn[first++].increment_rad;
    }
    const auto n = static_cast<double>(i + 1 - first);
    if (8 * kTwoPi / (n * kPeriod_s) > minimum_speed_rad_s)
      most = std::max(most, square / n - sum * sum / (n * n));
  }
  return most;
}

// Largest change of the mean torque of a tooth period to the next (Tarng 1988, 4-4) [Nm].
double highest_difference(const Cut& c, const Watched& w, double from_s, double to_s) {
  double sum = 0, n = 0, last = 0, most = 0;
  std::int64_t tooth = -1, means = 0;
  for (std::size_t i = sample_at(from_s); i < std::min(w.turn.size(), sample_at(to_s)); ++i) {
    const auto now = static_cast<std::int64_t>(w.turn[i].angle_rad / kTwoPi * c.teeth());
    if (now != tooth && n > 0) {
      if (means > 1) most = std::max(most, std::abs(sum / n - last));
      last = sum / n;
      ++means;
      sum = n = 0;
    }
    tooth = now;
    sum += wide(w.torque_Nm[i]);
    n += 1;
  }
  return most;
}

// ---- The study.

struct Study {
  Scores chatter, chatter_visible, chatter_variance, chatter_line, chatter_torque;
  Scores tooth, tooth_part, tooth_difference, tooth_torque, tooth_line;
  Scores ar, ar_part;
  Scores collision, collision_air, collision_force, collision_cut_force;
  Scores untaught, untaught_air;  // collision, before a good part was shown
  // At the thresholds that were learned.
  std::vector<double> chatter_at_feed;  // vibration at the alarm [feeds per tooth]
  std::vector<double> chatter_after_onset_turns;
  std::size_t chatter_in_time = 0, chatter_cuts = 0;
  std::vector<double> tooth_delay_periods, ar_delay_turns, collision_delay_s, air_delay_s,
      untaught_delay_s, untaught_air_delay_s;
  std::size_t tooth_in_time = 0, tooth_breaks = 0;
  std::size_t drawn[4]{}, passed_over[4]{};
  std::vector<std::string> failures;
  std::FILE* table = nullptr;  // --csv

  void note(const char* what, const Cut& c, double value) {
    char text[420];
    std::snprintf(text, sizeof text, "%s %.3g: %s", what, value, c.text.c_str());
    failures.emplace_back(text);
  }
};

// Part of the largest mean torque of a revolution that is on from the break to two revolutions
// later.
double load_at(const Cut& c, const Record& r, double t_s) {
  const std::size_t turn = sample_at(c.turn_s()), at = sample_at(t_s);
  std::vector<double> sum(r.size() + 1, 0);
  for (std::size_t i = 0; i < r.size(); ++i) sum[i + 1] = sum[i] + wide(r.torque_Nm[i]);
  double most = 0;
  for (std::size_t i = turn; i <= r.size(); i += turn / 4 + 1)
    most = std::max(most, sum[i] - sum[i - turn]);
  if (at < turn || at + 2 * turn > r.size() || !(most > 0)) return 0;
  const double before = sum[at] - sum[at - turn];
  const double after = sum[at + 2 * turn] - sum[at + turn];
  return std::min(before, after) / most;
}

// One row a cut: what was drawn that matters, the truth, scores and alarms.
void write_row(std::FILE* to, const Cut& c, const Record& r, const Watched& w, double load) {
  if (to == nullptr) return;
  const ChatterConfig& chatter = w.config.spindle.chatter;
  std::fprintf(to, "%llu,%s,%s,%u,%.0f,%u,%.0f,%.1f,%.3f,%.3f,%.3f,%.3f,%.2f,%.4g,%.4g,%.4g,%.4g",
               static_cast<unsigned long long>(c.seed), name_of(c.event), name_of(c.feature),
               c.encoder_bits, c.simulation.spindle->current_update_hz, c.teeth(),
               c.milling().cut.spindle_speed_rpm, c.swept_rad * 180 / kPi, c.mean_torque_Nm,
               c.rated_torque_Nm, c.depth_over_limit, wide(r.steady_vibration_m) / feed_of(c), load,
               c.break_fraction, r.steady_chatter_Nm2 / chatter.chatter_threshold_Nm2,
               chatter_score(w), (w.alarm(MonitorId::chatter) - r.chatter_s) / c.turn_s());
  const double end_s =
      r.break_s < kNever ? r.break_s + (c.teeth() + 3.0) * c.turn_s() / c.teeth() : kNever;
  const double from_s = r.break_s < kNever ? r.break_s : 0;
  const unsigned samples = w.config.axis[0].collision.consecutive_samples;
  std::fprintf(to, ",%.4g,%.4g,%.4g,%.5g,%.5g,%.5g\n", wide(highest(w.tooth, from_s, end_s)),
               wide(highest(w.ar, from_s)), wide(held(w.collision, samples, 0, kNever)),
               w.alarm(MonitorId::tooth_breakage, from_s) - std::min(r.break_s, 1e9), r.touch_s,
               w.alarm(MonitorId::collision));
}
constexpr const char* kColumns =
    "seed,event,feature,bits,current_hz,teeth,rpm,swept_deg,torque_Nm,rated_Nm,over_limit,"
    "vibration_feeds,load,fraction,true_chatter,chatter,chatter_late_turns,tooth,ar,collision,"
    "tooth_delay_s,touch_s,collision_s\n";

void study_chatter(Study& s, const Cut& c, const Record& r, const Watched& w,
                   const Watched& quiet) {
  const ChatterConfig& config = w.config.spindle.chatter;
  const bool chatters = c.event == Event::chatter;
  const auto add = [&](Scores& to, double score) {
    (chatters ? to.with : to.without).push_back(score);
  };
  const double score = chatter_score(w);
  add(s.chatter, score);
  add(s.chatter_variance, highest_variance(w, config.minimum_speed_rad_s) /
                              highest_variance(quiet, config.minimum_speed_rad_s));
  add(s.chatter_line, highest_line(c, w, false) / highest_line(c, quiet, false));
  add(s.chatter_torque, wide(highest(w.torque_Nm)) / c.rated_torque_Nm);
  // What hides in the noise of counter and current nobody can find.
  if (!chatters || r.steady_chatter_Nm2 > kVisible * config.chatter_threshold_Nm2)
    add(s.chatter_visible, score);
  const double t = w.alarm(MonitorId::chatter);
  if (!chatters) {
    if (t < kNever) s.note("chatter, false alarm", c, score);
    return;
  }
  ++s.chatter_cuts;
  if (t <= r.chatter_s && t < kNever) {
    ++s.chatter_in_time;
    s.chatter_at_feed.push_back(wide(r.vibration_m[sample_at(t)]) / feed_of(c));
    s.chatter_after_onset_turns.push_back((t - r.onset_s) / c.turn_s());
  } else {
    s.note(t < kNever ? "chatter found too late" : "chatter missed", c, score);
  }
}

void study_breakage(Study& s, const Cut& c, const Record& r, const Watched& w, const Watched& quiet,
                    double load) {
  const double rated = c.rated_torque_Nm;
  if (c.event == Event::none) {
    s.tooth.without.push_back(wide(highest(w.tooth)));
    s.ar.without.push_back(wide(highest(w.ar)));
    s.tooth_difference.without.push_back(highest_difference(c, w, 0, kNever) / rated);
    s.tooth_torque.without.push_back(wide(highest(w.torque_Nm)) / rated);
    s.tooth_line.without.push_back(highest_line(c, w, true) / highest_line(c, quiet, true));
    for (const MonitorId id : {MonitorId::tooth_breakage, MonitorId::ar_breakage})
      if (const double t = w.alarm(id); t < kNever)
        s.note((std::string(servosense::name_of(id)) + ", false alarm after contact + s").c_str(),
               c, t - r.schedule.contact_s);
    return;
  }
  const double period = c.turn_s() / c.teeth();
  const bool whole = c.break_fraction == 1;
  const double tooth_end = r.break_s + (c.teeth() + 3) * period;
  const double ar_end = r.break_s + 6 * c.turn_s();
  (whole ? s.tooth : s.tooth_part).with.push_back(wide(highest(w.tooth, r.break_s, tooth_end)));
  (whole ? s.ar : s.ar_part).with.push_back(wide(highest(w.ar, r.break_s, ar_end)));
  const double ar = w.alarm(MonitorId::ar_breakage, r.break_s, ar_end);
  if (ar < kNever) s.ar_delay_turns.push_back((ar - r.break_s) / c.turn_s());
  if (!whole) return;
  if (ar == kNever) s.note("ar-breakage missed, load", c, load);
  ++s.tooth_breaks;
  const double t = w.alarm(MonitorId::tooth_breakage, r.break_s, ar_end);
  if (t < kNever) s.tooth_delay_periods.push_back((t - r.break_s) / period);
  if (t <= tooth_end)
    ++s.tooth_in_time;
  else
    s.note(t < kNever ? "tooth found late, load" : "tooth missed, load", c, load);
  s.tooth_difference.with.push_back(highest_difference(c, w, r.break_s, tooth_end) / rated);
  s.tooth_torque.with.push_back(wide(highest(w.torque_Nm, r.break_s, tooth_end)) / rated);
  s.tooth_line.with.push_back(highest_line(c, w, true) / highest_line(c, quiet, true));
}

// Before a good part was shown.
void study_untaught(Study& s, const Cut& c, const Record& r, const Watched& w) {
  const unsigned samples = w.config.axis[0].collision.consecutive_samples;
  if (c.event == Event::none) {
    s.untaught.without.push_back(wide(held(w.collision, samples, 0, kNever)));
    s.untaught_air.without.push_back(wide(held(w.collision, samples, 0, r.schedule.contact_s)));
    if (const double t = w.alarm(MonitorId::collision); t < kNever)
      s.note("collision untaught, false alarm after contact + s", c, t - r.schedule.contact_s);
    return;
  }
  const double until = r.touch_s + 0.05;
  const bool air = r.touch_s < r.schedule.contact_s;
  (air ? s.untaught_air : s.untaught)
      .with.push_back(wide(held(w.collision, samples, r.touch_s, until)));
  const double t = w.alarm(MonitorId::collision, r.touch_s, until);
  if (t < kNever)
    (air ? s.untaught_air_delay_s : s.untaught_delay_s).push_back(t - r.touch_s);
  else
    s.note("collision untaught, missed", c, r.touch_s - r.schedule.contact_s);
}

// `good_N`: highest force of the part that taught the thresholds of the cut.
void study_collision(Study& s, const Cut& c, const Record& r, const Watched& w,
                     const Watched& quiet, double good_N) {
  const unsigned samples = w.config.axis[0].collision.consecutive_samples;
  const double idle_N = wide(highest(quiet.force_N));
  if (c.event == Event::none) {
    s.collision.without.push_back(wide(held(w.collision, samples, 0, kNever)));
    s.collision_air.without.push_back(wide(held(w.collision, samples, 0, r.schedule.contact_s)));
    s.collision_force.without.push_back(wide(highest(w.force_N)) / idle_N);
    s.collision_cut_force.without.push_back(wide(highest(w.force_N)) / good_N / 2);
    if (const double t = w.alarm(MonitorId::collision); t < kNever)
      s.note("collision, false alarm after contact + s", c, t - r.schedule.contact_s);
    return;
  }
  const double until = r.touch_s + 0.05;
  const bool air = r.touch_s < r.schedule.contact_s;
  (air ? s.collision_air : s.collision)
      .with.push_back(wide(held(w.collision, samples, r.touch_s, until)));
  if (!air) {
    const double most = wide(highest(w.force_N, r.touch_s, until));
    s.collision_force.with.push_back(most / idle_N);
    s.collision_cut_force.with.push_back(most / good_N / 2);
  }
  const double t = w.alarm(MonitorId::collision, r.touch_s, until);
  if (t < kNever)
    (air ? s.air_delay_s : s.collision_delay_s).push_back(t - r.touch_s);
  else
    s.note("collision missed", c, r.touch_s - r.schedule.contact_s);
}

void study_cut(Study& s, std::uint64_t seed, Event event) {
  const Cut c = draw(seed, event);
  const auto kind = static_cast<std::size_t>(event);
  ++s.drawn[kind];
  const Record idle = idle_run(c);
  MachineFile machine = learn(c, idle);
  const HostStackConfig untaught = good(plan_stack(machine, signals()), c.text.c_str()).config;
  double good_N = 0;
  if (event == Event::none || event == Event::collision) good_N = learn_good_cut(c, machine);
  const HostStackConfig config = good(plan_stack(machine, signals()), c.text.c_str()).config;
  const Record r = simulate(c);
  const double steady = wide(r.steady_vibration_m) / feed_of(c);
  if (event == Event::chatter ? steady < kChatters : steady > kStill) {
    ++s.passed_over[kind];
    return;
  }
  const double load = event == Event::tooth_break ? load_at(c, r, r.break_s) : 1;
  if (load < kLoaded || (event == Event::collision && r.touch_s == kNever)) {
    ++s.passed_over[kind];
    return;
  }
  const Watched w = watch(c, r, config);
  write_row(s.table, c, r, w, load);
  const Watched quiet = watch(c, idle, config);
  if (event == Event::none || event == Event::chatter) study_chatter(s, c, r, w, quiet);
  if (event == Event::none || event == Event::tooth_break) study_breakage(s, c, r, w, quiet, load);
  if (event == Event::none || event == Event::collision) {
    study_collision(s, c, r, w, quiet, good_N);
    study_untaught(s, c, r, watch(c, r, untaught));
  }
}

// ---- A shift: programs without a fault one after another, until the hours are full. Each is
// simulated once and replayed with fresh noise and counter origins; its idling run, air moves with
// the spindle at three speeds, comes between. In single precision, as a controller would run it.

// Multiples of the thresholds.
struct Levels {
  double chatter = 1, tooth = 1, ar = 1, collision = 1;
};

struct Shift {
  double hours = 0;
  std::size_t programs = 0, replays = 0;
  using Counts = std::array<std::array<std::size_t, 4>, 2>;  // levels; detectors as kWho
  Counts alarms{}, noisy_programs{};
  static constexpr std::array kWho = {MonitorId::chatter, MonitorId::tooth_breakage,
                                      MonitorId::ar_breakage, MonitorId::collision};
};

// The same shift for two sets of thresholds.
Shift shift(double hours, std::uint64_t from, std::size_t replays,
            const std::array<Levels, 2>& levels) {
  using Stack = MonitorStack<float, kHostRevolutions, kHostHarmonics, 1024, kHostTeeth>;
  const std::array stacks = {std::make_unique<Stack>(), std::make_unique<Stack>()};
  Shift out;
  for (std::uint64_t seed = from; out.hours < hours; ++seed) {
    const Cut c = draw(seed, Event::none);
    const Record r = simulate(c);
    if (wide(r.steady_vibration_m) > kStill * feed_of(c)) continue;
    const Record idle = idle_run(c);
    MachineFile machine = learn(c, idle);
    (void)learn_good_cut(c, machine);
    const HostStackConfig learned = good(plan_stack(machine, signals()), c.text.c_str()).config;
    for (std::size_t l = 0; l < levels.size(); ++l) {
      HostStackConfig config = learned;
      config.spindle.chatter.chatter_threshold_Nm2 *= levels[l].chatter;
      config.spindle.chatter.lines.threshold *= levels[l].chatter;
      config.tool.tooth_breakage.threshold *= levels[l].tooth;
      config.tool.ar_breakage.share_threshold *= levels[l].ar;
      for (HostAxisSlotConfig& axis : config.axis)
        for (double* t :
             {&axis.collision.threshold_N_per_s, &axis.collision.cutting_threshold_N_per_s})
          *t *= levels[l].collision;
      stacks[l]->configure(config);
    }
    ++out.programs;
    Shift::Counts noisy{};
    for (std::size_t k = 0; k < replays && out.hours < hours; ++k, ++out.replays)
      for (const Record* record : {&r, &idle}) {
        for (const auto& stack : stacks) stack->reset();
        Reporter<float> reporter(c, *record, seed * 1000 + 2 * k + 1000000);
        for (std::size_t i = 0; i < record->size(); ++i) {
          const ServoSample<float> sample = reporter.at(i);
          for (std::size_t l = 0; l < stacks.size(); ++l)
            for (const auto& change : stacks[l]->process(sample))
              if (raised(change))
                for (std::size_t m = 0; m < Shift::kWho.size(); ++m)
                  if (change.monitor == Shift::kWho[m]) ++out.alarms[l][m], noisy[l][m] = 1;
        }
        out.hours += static_cast<double>(record->size()) * kPeriod_s / 3600;
      }
    for (std::size_t l = 0; l < noisy.size(); ++l)
      for (std::size_t m = 0; m < noisy[l].size(); ++m) out.noisy_programs[l][m] += noisy[l][m];
  }
  return out;
}

void print(const Shift& s, const Levels& levels) {
  const double level[] = {levels.chatter, levels.tooth, levels.ar, levels.collision};
  std::printf("  shift of %.2f h, %zu programs, %zu replays: alarms (programs that alarmed)\n",
              s.hours, s.programs, s.replays);
  for (std::size_t m = 0; m < Shift::kWho.size(); ++m) {
    std::printf("    %-16s as learned %zu (%zu); ", servosense::name_of(Shift::kWho[m]),
                s.alarms[0][m], s.noisy_programs[0][m]);
    if (level[m] > 0)
      std::printf("99 %% found, %.3g of that: %zu (%zu)\n", level[m], s.alarms[1][m],
                  s.noisy_programs[1][m]);
    else
      std::printf("no threshold finds 99 %%\n");
  }
}

void print(const Study& s) {
  const char* kinds[] = {"stable", "chatter", "tooth break", "collision"};
  for (std::size_t k = 0; k < 4; ++k)
    std::printf("  %s: %zu drawn, %zu passed over\n", kinds[k], s.drawn[k], s.passed_over[k]);
  s.chatter.print("chatter");
  s.chatter_visible.print("  above the noise of the idling run");
  s.chatter_variance.print("  variance of 8 turns / idle");
  s.chatter_line.print("  FFT line / idle");
  s.chatter_torque.print("  torque / rated");
  s.tooth.print("tooth-breakage, whole tooth");
  Scores part = s.tooth_part;
  part.without = s.tooth.without;
  part.print("tooth-breakage, part of the edge");
  s.tooth_difference.print("  first difference / rated");
  s.tooth_torque.print("  torque / rated");
  s.tooth_line.print("  FFT line of the turn / idle");
  s.ar.print("ar-breakage, whole tooth");
  part = s.ar_part;
  part.without = s.ar.without;
  part.print("ar-breakage, part of the edge");
  s.collision.print("collision, in the cut");
  s.collision_air.print("collision, in the air before it");
  s.untaught.print("collision, in the cut, untaught");
  s.untaught_air.print("collision, in the air before it, untaught");
  s.collision_force.print("  force / idle, in the cut");
  s.collision_cut_force.print("  force / twice that of the good part");
  std::printf(
      "  chatter in time (before one feed per tooth): %zu of %zu; vibration at the alarm "
      "%.2f feeds (median), %.2f (95 %%); %.1f turns after a tenth (median)\n",
      s.chatter_in_time, s.chatter_cuts, quantile(s.chatter_at_feed, 0.5),
      quantile(s.chatter_at_feed, 0.95), quantile(s.chatter_after_onset_turns, 0.5));
  std::printf(
      "  tooth within m + 3 periods: %zu of %zu; delay %.1f periods (median), %.1f (most)\n",
      s.tooth_in_time, s.tooth_breaks, quantile(s.tooth_delay_periods, 0.5),
      quantile(s.tooth_delay_periods, 1));
  std::printf(
      "  ar delay %.1f turns (median); collision delay in the cut %.1f ms (median), %.1f (95 %%), "
      "in "
      "the air %.1f (median), %.1f (95 %%)\n",
      quantile(s.ar_delay_turns, 0.5), 1e3 * quantile(s.collision_delay_s, 0.5),
      1e3 * quantile(s.collision_delay_s, 0.95), 1e3 * quantile(s.air_delay_s, 0.5),
      1e3 * quantile(s.air_delay_s, 0.95));
  std::printf("  untaught, in the cut %.1f ms (median), %.1f (95 %%), in the air %.1f, %.1f\n",
              1e3 * quantile(s.untaught_delay_s, 0.5), 1e3 * quantile(s.untaught_delay_s, 0.95),
              1e3 * quantile(s.untaught_air_delay_s, 0.5),
              1e3 * quantile(s.untaught_air_delay_s, 0.95));
}

// What must not get worse. The figures themselves: docs/detection.md. Less than ten events say
// nothing (whole teeth: a third of the breaks drawn).
void hold(const Study& s) {
  if (s.chatter.with.size() >= 10) {
    CHECK(s.chatter.auc() > 0.9);
    for (const Scores* rival : {&s.chatter_variance, &s.chatter_line, &s.chatter_torque})
      CHECK(s.chatter.auc() > rival->auc());
    // One in ten, and one for small numbers.
    CHECK(10 * s.chatter.false_alarms() <= s.chatter.without.size() + 10);
  }
  if (s.tooth.with.size() >= 4) {
    CHECK(s.tooth.auc() > 0.95);
    for (const Scores* rival : {&s.tooth_difference, &s.tooth_torque, &s.tooth_line})
      CHECK(s.tooth.auc() >= rival->auc());
    CHECK(100 * s.tooth.false_alarms() <= 2 * s.tooth.without.size());
    CHECK(10 * s.tooth_in_time >= 9 * s.tooth_breaks);
    CHECK(s.ar.auc() > 0.9);
  }
  if (s.collision_air.with.size() >= 3) {
    CHECK(s.collision_air.auc() > 0.99);
    CHECK(s.collision_air.false_alarms() == 0);
  }
  if (s.collision.with.size() >= 3) {
    // One in twenty and one for small numbers; three in four and one.
    CHECK(20 * s.collision.false_alarms() <= s.collision.without.size() + 20);
    CHECK(4 * s.collision.found() + 4 >= 3 * s.collision.with.size());
    CHECK(s.collision.auc() > s.collision_force.auc());
  }
}

// ---- The apparatus itself.

void scores_by_hand() {
  const Scores s{{2, 3}, {1, 2}};
  CHECK_NEAR(s.auc(), 3.5 / 4, 1e-15);
  CHECK(s.found(2.5) == 1 && s.false_alarms(2) == 1);
  CHECK(s.reached_by(0.5) == 3 && s.reached_by(0.99) == 2 && s.found_at(0) == 0.5);
  // Nothing of 100: 3.7 %, where the rule of three says 3.
  CHECK_NEAR(wilson(0, 100).high, 0.0370, 1e-4);
  CHECK_NEAR(wilson(5, 10).low, 0.2366, 1e-4);
  // Near the example of Hanley and McNeil 1982: AUC 0.893 of 51 and 58, standard error 0.032.
  Scores h;
  for (int i = 0; i < 51; ++i) h.with.push_back(i < 46 ? 2 : 0.5);
  for (int i = 0; i < 58; ++i) h.without.push_back(i < 52 ? 1 : 1.5);
  CHECK_NEAR(h.auc(), 46.0 / 51, 1e-12);
  CHECK_BETWEEN(h.auc_error(), 0.029, 0.033);
}

// Equal seeds, equal records; the torque of a steady cut is that of its chips and edges.
void cuts_are_what_they_say(std::uint64_t from) {
  for (std::uint64_t seed = from; seed < from + 3; ++seed) {
    const Cut c = draw(seed, Event::none, Feature::none);
    const Record r = simulate(c);
    const Record again = simulate(draw(seed, Event::none, Feature::none));
    CHECK(r.torque_Nm == again.torque_Nm && r.drive[1].position == again.drive[1].position);
    const MillingSimulation& m = c.milling();
    const double edges = m.tool.force.tangential_edge_N_per_m * m.cut.axial_depth_m *
                         m.tool.radius_m() * c.swept_rad * m.tool.teeth / kTwoPi;
    const std::size_t to = sample_at(r.schedule.stop_s);
    const std::size_t from_sample = to - sample_at(10 * c.turn_s());
    double sum = 0;
    for (std::size_t i = from_sample; i < to; ++i) sum += wide(r.torque_Nm[i]);
    // Ten turns to within a sample, a force that is zero for most of the turn at small immersions;
    // a tenth of a degree of every entry and exit.
    CHECK_NEAR(sum / static_cast<double>(to - from_sample), c.mean_torque_Nm + edges,
               0.03 * (c.mean_torque_Nm + edges));
  }
}

void show(std::uint64_t seed, Event event) {
  const Cut c = draw(seed, event);
  const Record r = simulate(c);
  const Watched w = watch(c, r, learned_stack(c));
  std::printf(
      "%s\n  contact %.3f, full %.3f, stop %.3f, break %.4f, touch %.4f, onset %.4f, one feed "
      "%.4f; steady vibration %.2f feeds\n  scores: chatter %.3g, tooth %.3g, ar %.3g, "
      "collision %.3g\n",
      c.text.c_str(), r.schedule.contact_s, r.schedule.contact_s + c.entry_s, r.schedule.stop_s,
      r.break_s, r.touch_s, r.onset_s, r.chatter_s, wide(r.steady_vibration_m) / feed_of(c),
      chatter_score(w), wide(highest(w.tooth)), wide(highest(w.ar)), wide(highest(w.collision)));
  for (const AlarmTime& a : w.alarms)
    std::printf("  %.4f s: %s %s, vibration %.2f feeds\n", a.t_s, servosense::name_of(a.monitor),
                std::string(servosense::name_of(a.channel)).c_str(),
                wide(r.vibration_m[sample_at(a.t_s)]) / feed_of(c));
}

}  // namespace

int main(int argc, char** argv) {
  std::size_t cases = 12;
  std::uint64_t from = kFirstSeed;
  double hours = 0;
  bool chosen = false, looked_at = false;
  std::vector<Event> events = {Event::none, Event::chatter, Event::tooth_break, Event::collision};
  Study s;
  for (int i = 1; i < argc; ++i) {
    const std::string option = argv[i];
    const auto next = [&] { return i + 1 < argc ? argv[++i] : "0"; };
    if (option == "--nightly") cases = 500, hours = 8;
    if (option == "--cases") cases = std::strtoul(next(), nullptr, 10);
    if (option == "--from") from = std::strtoul(next(), nullptr, 10), chosen = true;
    if (option == "--development") looked_at = true;
    if (option == "--hours") hours = std::strtod(next(), nullptr);
    if (option == "--event") events = {Event::none, static_cast<Event>(std::atoi(next()))};
    if (option == "--csv") s.table = std::fopen(next(), "w");
    if (option == "--show") {
      const std::uint64_t seed = std::strtoul(next(), nullptr, 10);
      show(seed, static_cast<Event>(std::atoi(next())));
      return 0;
    }
  }
  const char* use = development::use_of(development::kDetection, from, cases);
  if (use != nullptr && chosen && !looked_at) {
    std::fprintf(stderr,
                 "detection_study: these seeds were looked at before (%s); take others, or say "
                 "--development, and call it no figure\n",
                 use);
    return 2;
  }
  scores_by_hand();
  cuts_are_what_they_say(from);
  if (s.table != nullptr) std::fputs(kColumns, s.table);
  for (std::size_t i = 0; i < cases; ++i)
    for (const Event event : events) study_cut(s, from + i, event);
  if (s.table != nullptr) std::fclose(s.table);
  std::printf("  seeds %llu to %llu%s%s\n", static_cast<unsigned long long>(from),
              static_cast<unsigned long long>(from + cases - 1),
              use != nullptr ? ", looked at before: " : "", use != nullptr ? use : "");
  print(s);
  for (const std::string& f : s.failures) std::printf("  %s\n", f.c_str());
  hold(s);
  if (hours > 0) {
    const Levels most{s.chatter.reached_by(0.99), s.tooth.reached_by(0.99), s.ar.reached_by(0.99),
                      s.collision_air.reached_by(0.99)};
    print(shift(hours, from + 50000, 20, {Levels{}, most}), most);
  }
  return check::done();
}
