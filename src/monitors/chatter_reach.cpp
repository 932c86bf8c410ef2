#include "servosense/monitors/chatter_reach.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace servosense {
namespace {

// Amplitudes are tried in steps of 3 %, from a tenth of the root of the threshold (noise may bring
// the rest) to 10 000 times that (the share of a heavy load).
constexpr std::size_t kRungs = 312;
constexpr double kRung = 1.03;
constexpr double kLowest = 0.1;
// Lines near harmonics of rotation and tooth passing are heard least, and which those are depends
// on the speed: the middle one of five frequencies stands for all.
constexpr std::array kSpread = {0.85, 0.93, 1.0, 1.09, 1.17};
// Samples from which the rate of the current is read.
constexpr std::uint64_t kRateSamples = 256;
constexpr double kNever = std::numeric_limits<double>::infinity();

using Shadow = ChatterMonitor<double, 3, 1, 1>;

ChatterConfig shadow_config(ChatterConfig c) {
  c.window_revolutions = 3;
  c.harmonics = 1;
  c.chatter_threshold_Nm2 = c.forced_threshold_Nm2 = 0;
  return c;
}

// c + x A + q A^2.
struct Quadratic {
  double c = 0, x = 0, q = 0;
  [[nodiscard]] double at(double a) const { return c + a * (x + a * q); }
};
Quadratic through(double own, double both, double alone) {
  return {own, both - own - alone, alone};
}

std::array<double, kRungs> rungs(double threshold_Nm2) {
  std::array<double, kRungs> a{};
  a[0] = kLowest * std::sqrt(threshold_Nm2);
  for (std::size_t i = 1; i < kRungs; ++i) a[i] = kRung * a[i - 1];
  return a;
}

}  // namespace

/// A sinusoid beside the record, and what the monitor would say of each amplitude.
struct ChatterReach::Tone {
  Tone(const ChatterReachConfig& c, double frequency)
      : frequency_hz(frequency),
        step_rad(kTwoPi * frequency * c.sample_period_s),
        amplitude(rungs(c.chatter.chatter_threshold_Nm2)),
        threshold(c.chatter.chatter_threshold_Nm2),
        consecutive(c.chatter.consecutive_revolutions) {
    DisturbanceObserverConfig lags = c.observer;
    lags.drive = DriveModelConfig{};
    path.configure(lags);
    both.configure(shadow_config(c.chatter));
    alone.configure(shadow_config(c.chatter));
    rule.share = c.chatter.tolerated_load_share;
    rule.cutting_Nm = c.chatter.cutting_torque_Nm;
    if (!both.comb().knows_teeth()) changes.resize(c.chatter.window_revolutions - 1);
  }

  // A revolution of the window is complete.
  void take_turn(const HostStack::Chatter& own) {
    const auto of = [&](auto measure) {
      return through(measure(own), measure(both), measure(alone));
    };
    const auto comb = [&](auto member) {
      return of([&](const auto& monitor) { return monitor.comb().state().*member; });
    };
    using Comb = HostStack::Chatter::Comb::State;
    change_before = change;
    change = own.comb().settled() ? comb(&Comb::change_Nm2) : Quadratic{};
    tooth = comb(&Comb::tooth_Nm2);
    turn = comb(&Comb::turn_Nm2);
    for (std::size_t i = 0; i < load.size(); ++i)
      load[i] = of([&](const auto& monitor) { return monitor.measures().load[i]; });
    mean = own.measures().mean_Nm;
    mean_slope = alone.measures().mean_Nm;
    for (std::size_t i = 0; i < kRungs; ++i)
      remembered[i] = ChatterRule<double>::remember(load[0].at(amplitude[i]), remembered[i]);
    if (changes.empty()) return;
    changes[next_change] = change;
    next_change = next_change + 1 == changes.size() ? 0 : next_change + 1;
  }

  void take_verdict(const HostStack::Chatter& own) {
    const bool valid = own.comb().valid() && own.state().feed.steady();
    const bool good = own.state().signal == SignalState::good;
    const bool in_cut = rule.cutting_Nm > 0 && rule.cuts(mean);
    // What is louder than one that has alarmed need not be asked.
    const std::size_t most = rule.cutting_Nm > 0 ? found_in_cut : found;
    for (std::size_t i = 0; i < most; ++i) {
      const double before = beyond[i];
      beyond[i] = valid ? beyond_at(i) : 0;
      const bool above = good && rule.judged(beyond[i], before) >= threshold;
      over[i] = above ? over[i] + 1 : 0;
      if (over[i] < consecutive) continue;
      found = std::min(found, i);
      if (in_cut) found_in_cut = std::min(found_in_cut, i);
      break;
    }
    if (valid && good) take_quiet(in_cut, own.state().load_Nm2);
  }

  [[nodiscard]] double amplitude_of(std::size_t rung) const {
    return rung < kRungs ? amplitude[rung] : kNever;
  }

  double frequency_hz;
  double phase_rad = 0;
  double step_rad;
  double now = 0;  // of the current, which may be renewed seldom
  double sum = 0;  // of a group
  DisturbanceObserver<double> path;
  Shadow both, alone;
  std::size_t found = kRungs;  // lowest rung that has alarmed...
  std::size_t found_in_cut = kRungs;
  // ...and the amplitude that would if the machine made no noise of its own.
  double quiet = kNever, quiet_in_cut = kNever;

 private:
  [[nodiscard]] double beyond_at(std::size_t i) const {
    const double a = amplitude[i];
    ChatterMeasures<double> m;
    for (std::size_t k = 0; k < load.size(); ++k) m.load[k] = load[k].at(a);
    m.beyond_change =
        both.comb().beyond_change(change.at(a), change_before.at(a), tooth.at(a), turn.at(a));
    if (!changes.empty()) {
      double least = remembered[i];
      for (const Quadratic& c : changes) least = std::min(least, c.at(a));
      m.beyond_change = std::max(m.beyond_change, least);
    }
    m.remembered = remembered[i];
    m.mean_Nm = mean + a * mean_slope;
    return rule.beyond(m);
  }

  void take_quiet(bool in_cut, double remembered_Nm2) {
    double heard = both.comb().beyond_change(change.q, change_before.q, tooth.q, turn.q);
    if (!changes.empty()) heard = std::max(heard, change.q);
    heard -= 0.5 * rule.share;
    const double part = rule.cuts(mean) ? 1 : ChatterRule<double>::kAir;
    const double needed =
        heard > 0 ? std::sqrt((threshold / part + rule.share * remembered_Nm2) / heard) : kNever;
    quiet = std::min(quiet, needed);
    if (in_cut) quiet_in_cut = std::min(quiet_in_cut, needed);
  }

  std::array<double, kRungs> amplitude;
  double threshold;
  std::uint32_t consecutive;
  ChatterRule<double> rule;
  // The newest revolution.
  Quadratic change, change_before, tooth, turn;
  std::array<Quadratic, 3> load;
  double mean = 0, mean_slope = 0;
  // Of each amplitude.
  std::array<double, kRungs> remembered{};
  std::array<double, kRungs> beyond{};
  std::array<std::uint32_t, kRungs> over{};
  std::vector<Quadratic> changes;  // of the window, a ring, where a change that lasts counts
  std::size_t next_change = 0;
};

ChatterReach::ChatterReach(const ChatterReachConfig& config) : config_(config) {}
ChatterReach::~ChatterReach() = default;

void ChatterReach::choose_tones() {
  const double rate = 1 / config_.chatter.sample_period_s;
  double current =
      1 / config_.sample_period_s * static_cast<double>(fresh_) / static_cast<double>(samples_);
  if (config_.current_update_hz > 0) current = std::min(current, config_.current_update_hz);
  // Where the lags of the observer leave half, what the parts of the comb (2.4 samples) pass
  // undamped, and what a current that is renewed so often can show without its mirror images.
  const auto corner = [](double g) { return g / kTwoPi; };
  const double lags = std::min(corner(config_.observer.disturbance_cutoff_rad_s),
                               corner(config_.observer.velocity_cutoff_rad_s));
  double centre = std::min({lags, rate / 8, current / 5});
  const double highest = std::min(rate / 5, current / 3);
  for (const double mode : config_.modes_hz) {
    if (mode * kSpread.back() <= highest) {
      centre = mode;
      result_.unheard_mode_hz.reset();
      break;
    }
    if (!result_.unheard_mode_hz) result_.unheard_mode_hz = mode;
  }
  for (const double part : kSpread)
    tones_.push_back(std::make_unique<Tone>(config_, part * centre));
}

void ChatterReach::heard(const RawDriveSample<double>& raw, const HostStack& stack) {
  const bool fresh = !has(raw.effort_quality, Quality::held);
  ++samples_;
  if (fresh) ++fresh_;
  if (tones_.empty()) {
    if (samples_ < kRateSamples) return;
    choose_tones();
  }
  const unsigned group = config_.grouped ? 2 : 1;
  const bool told = stack.samples() % group == 0;
  const auto& heard = stack.heard_torque();
  const DriveSample<double>& in = stack.spindle().sample;
  for (auto& tone : tones_) {
    tone->phase_rad += tone->step_rad;
    if (tone->phase_rad > kTwoPi) tone->phase_rad -= kTwoPi;
    if (fresh) tone->now = std::sin(tone->phase_rad);
    tone->sum += tone->now;
    if (!told) continue;
    DriveSample<double> sinusoid;
    sinusoid.effort = tone->sum / group;
    tone->sum = 0;
    const double s = tone->path.process(sinusoid);
    tone->both.process(heard.value + s, in.turn_angle_rad, in.increment, heard.quality);
    tone->alone.process(s, in.turn_angle_rad, in.increment, heard.quality);
  }
  if (told) judge(stack.chatter());
}

void ChatterReach::judge(const HostStack::Chatter& chatter) {
  // Revolutions are measured one sample after they end, verdicts follow some samples later.
  if (chatter.window().present != present_) {
    present_ = chatter.window().present;
    until_turn_ = 2;
  }
  if (until_turn_ > 0 && --until_turn_ == 0)
    for (auto& tone : tones_) tone->take_turn(chatter);
  if (chatter.state().verdicts == verdicts_) return;
  verdicts_ = chatter.state().verdicts;
  for (auto& tone : tones_) tone->take_verdict(chatter);
  alarmed_ = alarmed_ || chatter.chatter_alarm().state().state == MonitorState::alarm;
  if (chatter.state().signal != SignalState::good) return;
  const double mean = std::abs(chatter.window().mean_Nm);
  result_.largest_Nm = std::max(result_.largest_Nm, mean);
  const double cutting = config_.chatter.cutting_torque_Nm;
  if (cutting > 0 && mean >= cutting)
    result_.largest_cut_Nm = std::max(result_.largest_cut_Nm.value_or(0), mean);
  const double speed = std::abs(chatter.window().speed_rad_s);
  result_.slowest_rad_s = judged_ ? std::min(result_.slowest_rad_s, speed) : speed;
  result_.fastest_rad_s = std::max(result_.fastest_rad_s, speed);
  judged_ = true;
}

std::optional<ChatterReach::Result> ChatterReach::result() const {
  if (!judged_) return std::nullopt;
  struct Heard {
    double anywhere, in_cut, frequency_hz;
  };
  std::vector<Heard> heard;
  for (const auto& tone : tones_) {
    if (alarmed_)
      heard.push_back({tone->quiet, tone->quiet_in_cut, tone->frequency_hz});
    else
      heard.push_back({tone->amplitude_of(tone->found), tone->amplitude_of(tone->found_in_cut),
                       tone->frequency_hz});
  }
  std::sort(heard.begin(), heard.end(),
            [](const Heard& a, const Heard& b) { return a.anywhere < b.anywhere; });
  const Heard& middle = heard[heard.size() / 2];
  Result result = result_;
  result.frequency_hz = middle.frequency_hz;
  result.amplitude_Nm = middle.anywhere;
  if (result.largest_cut_Nm) result.in_cut_Nm = middle.in_cut;
  return result;
}

}  // namespace servosense
