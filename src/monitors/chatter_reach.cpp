#include "servosense/monitors/chatter_reach.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "servosense/dsp/lag_gain.hpp"

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
// Whether the noise of the record helps a sinusoid in the revolution that tells is chance: the mean
// over its phases is said.
constexpr std::array kPhases = {0.0, kPi / 2};
// A speed that changes less in a revolution is one that cuts: a run-up would tell of what is heard
// best on the way.
constexpr double kSteady = 0.01;
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

/// What the monitor would say of each amplitude of a sinusoid.
struct Ladder {
  double sign = 1;
  std::size_t found = kRungs;  // lowest rung that has alarmed, at a steady speed
  std::size_t found_anywhere = kRungs;
  std::size_t found_in_cut = kRungs;
  std::array<double, kRungs> remembered{};
  std::array<double, kRungs> beyond{};
  std::array<std::uint32_t, kRungs> over{};
  std::array<bool, kRungs> steps{};
};

}  // namespace

/// A sinusoid beside the record.
struct ChatterReach::Tone {
  Tone(const ChatterReachConfig& c, double frequency, double phase)
      : frequency_hz(frequency),
        phase_rad(phase),
        step_rad(kTwoPi * frequency * c.sample_period_s),
        shown(lag_gain(frequency, c.current_filter_hz)),
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
    ladders[1].sign = -1;
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
    // What record and sinusoid hold adds up where they have nothing to do with each other.
    const Quadratic held = {own.comb().state().held_Nm2, 0, alone.comb().state().held_Nm2};
    for (Ladder& l : ladders)
      for (std::size_t i = 0; i < kRungs; ++i) {
        const double a = l.sign * amplitude[i];
        l.steps[i] = own.comb().valid() &&
                     HostStack::Chatter::Comb::steps(held.at(a), change.at(a), change_before.at(a),
                                                     l.steps[i], threshold);
      }
    mean = own.measures().mean_Nm;
    mean_slope = alone.measures().mean_Nm;
    for (Ladder& l : ladders)
      for (std::size_t i = 0; i < kRungs; ++i)
        l.remembered[i] =
            ChatterRule<double>::remember(load[0].at(l.sign * amplitude[i]), l.remembered[i]);
    if (changes.empty()) return;
    changes[next_change] = change;
    next_change = next_change + 1 == changes.size() ? 0 : next_change + 1;
  }

  void take_verdict(const HostStack::Chatter& own, bool steady) {
    const bool valid = own.comb().valid() && own.state().feed.steady();
    const bool good = own.state().signal == SignalState::good;
    uneven_feed = own.state().feed.uneven;
    const bool in_cut = rule.cutting_Nm > 0 && rule.cuts(mean);
    for (Ladder& l : ladders) {
      // What is louder than one that has alarmed need not be asked.
      const std::size_t most = rule.cutting_Nm > 0 ? l.found_in_cut : l.found;
      for (std::size_t i = 0; i < most; ++i) {
        const double before = l.beyond[i];
        l.beyond[i] = valid ? beyond_at(l.sign * amplitude[i], l.remembered[i], l.steps[i]) : 0;
        const bool above = good && rule.judged(l.beyond[i], before) >= threshold;
        l.over[i] = above ? l.over[i] + 1 : 0;
        if (l.over[i] < consecutive) continue;
        l.found_anywhere = std::min(l.found_anywhere, i);
        if (!steady) break;
        l.found = std::min(l.found, i);
        if (in_cut) l.found_in_cut = std::min(l.found_in_cut, i);
        break;
      }
    }
    if (valid && good && steady) take_quiet(in_cut, own.state().load_Nm2);
  }

  // Mean of both ways round.
  [[nodiscard]] double smallest(std::size_t Ladder::*found) const {
    double product = 1;
    for (const Ladder& l : ladders) product *= l.*found < kRungs ? amplitude[l.*found] : kNever;
    return std::sqrt(product);
  }

  double frequency_hz;
  double phase_rad;
  double step_rad;
  double shown;    // of it, behind the drive's filter
  double now = 0;  // of the current, which may be renewed seldom
  double sum = 0;  // of a group
  DisturbanceObserver<double> path;
  Shadow both, alone;
  // The amplitude that would alarm if the machine made no noise of its own.
  double quiet = kNever, quiet_in_cut = kNever;

 private:
  [[nodiscard]] double beyond_at(double a, double remembered, bool steps) const {
    ChatterMeasures<double> m;
    for (std::size_t k = 0; k < load.size(); ++k) m.load[k] = load[k].at(a);
    if (!steps)
      m.beyond_change =
          both.comb().beyond_change(change.at(a), change_before.at(a), tooth.at(a), turn.at(a));
    if (!changes.empty()) {
      double least = remembered;
      for (const Quadratic& c : changes) least = std::min(least, c.at(a));
      m.beyond_change = std::max(m.beyond_change, least);
    }
    m.remembered = remembered;
    m.mean_Nm = mean + a * mean_slope;
    m.uneven_feed = uneven_feed;
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
  double mean = 0, mean_slope = 0, uneven_feed = 0;
  std::array<Ladder, 2> ladders;
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
  if (config_.current_filter_hz > 0)
    centre = std::min(centre, lag_half_hz(config_.current_filter_hz));
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
    for (const double phase : kPhases)
      tones_.push_back(std::make_unique<Tone>(config_, part * centre, phase));
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
    if (fresh) tone->now = tone->shown * std::sin(tone->phase_rad);
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
  if (until_turn_ > 0) {
    --until_turn_;
    if (until_turn_ == 0)
      for (auto& tone : tones_) tone->take_turn(chatter);
  }
  if (chatter.state().verdicts == verdicts_) return;
  verdicts_ = chatter.state().verdicts;
  const double speed = std::abs(chatter.window().speed_rad_s);
  const bool steady = std::abs(speed - speed_rad_s_) < kSteady * speed;
  speed_rad_s_ = speed;
  for (auto& tone : tones_) tone->take_verdict(chatter, steady);
  alarmed_ = alarmed_ || chatter.alarm(ChatterSign::power).state().state == MonitorState::alarm;
  if (chatter.state().signal != SignalState::good || !steady) return;
  const double mean = std::abs(chatter.window().mean_Nm);
  result_.largest_Nm = std::max(result_.largest_Nm, mean);
  const double cutting = config_.chatter.cutting_torque_Nm;
  if (cutting > 0 && mean >= cutting)
    result_.largest_cut_Nm = std::max(result_.largest_cut_Nm.value_or(0), mean);
  result_.slowest_rad_s = judged_ ? std::min(result_.slowest_rad_s, speed) : speed;
  result_.fastest_rad_s = std::max(result_.fastest_rad_s, speed);
  judged_ = true;
}

std::optional<ChatterReach::Result> ChatterReach::result() const {
  if (!judged_) return std::nullopt;
  struct Heard {
    double frequency_hz, steady, anywhere, in_cut;
    // How much it matters where one looks.
    [[nodiscard]] double spread() const {
      const double cut = std::isfinite(in_cut) ? std::log(in_cut / steady) : 0.0;
      return std::abs(std::log(steady / anywhere)) + cut;
    }
  };
  std::vector<Heard> heard;
  for (std::size_t i = 0; i < tones_.size(); i += kPhases.size()) {
    Heard h{tones_[i]->frequency_hz, 1, 1, 1};
    for (std::size_t k = i; k < i + kPhases.size(); ++k) {
      const Tone& tone = *tones_[k];
      h.steady *= alarmed_ ? tone.quiet : tone.smallest(&Ladder::found);
      h.anywhere *= alarmed_ ? tone.quiet : tone.smallest(&Ladder::found_anywhere);
      h.in_cut *= alarmed_ ? tone.quiet_in_cut : tone.smallest(&Ladder::found_in_cut);
    }
    for (double* product : {&h.steady, &h.anywhere, &h.in_cut}) *product = std::sqrt(*product);
    heard.push_back(h);
  }
  std::sort(heard.begin(), heard.end(),
            [](const Heard& a, const Heard& b) { return a.steady < b.steady; });
  // Of the middle three, the one that says the same of run-up, air and cut.
  const std::size_t middle_of = heard.size() / 2;
  Heard middle = heard[middle_of];
  for (const std::size_t i : {middle_of - 1, middle_of + 1})
    if (std::isfinite(heard[i].steady) &&
        (!std::isfinite(middle.steady) || heard[i].spread() < middle.spread()))
      middle = heard[i];
  Result result = result_;
  result.frequency_hz = middle.frequency_hz;
  result.amplitude_Nm = middle.steady;
  if (result.largest_cut_Nm) result.in_cut_Nm = middle.in_cut;
  return result;
}

}  // namespace servosense
