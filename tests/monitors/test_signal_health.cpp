// Signal health behind the conditioning of a drive: every fault injected into a living signal is
// named within the stated number of samples and ends by itself; healthy drives are never accused.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <string>

#include "check.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/core/units.hpp"
#include "servosense/monitors/signal_health.hpp"

namespace {

using namespace servosense;

constexpr double kPeriod_s = 125e-6;
constexpr double kCountsPerTurn = 131072;
constexpr unsigned kUpdate = 4;  // servo periods per new current

/// A spindle that speeds up, cuts, slows down and stands, with current noise.
template <typename Real>
class Spindle {
 public:
  explicit Spindle(std::uint64_t seed) : random_(seed) {
    DriveInputConfig in;
    in.sample_period_s = kPeriod_s;
    in.unit_per_count = kTwoPi / kCountsPerTurn;
    in.counter_bits = 20;
    in.max_acceleration = 4e5;
    input_.configure(in);
    SignalHealthConfig c;
    c.effort_limit = 40;
    CHECK(SignalHealthMonitor<Real>::validate(c).ok());
    monitor.configure(c);
  }

  RawDriveSample<Real> next() {
    const double t = static_cast<double>(n_) * kPeriod_s;
    const double phase = std::fmod(t, 4.0);  // up 1 s, run 1.5 s, down 1 s, stand 0.5 s
    const double top = 800;
    speed_ = phase < 1 ? top * phase : phase < 2.5 ? top : phase < 3.5 ? top * (3.5 - phase) : 0;
    angle_ += speed_ * kPeriod_s;
    RawDriveSample<Real> raw;
    const auto counts = static_cast<std::int64_t>(std::floor(angle_ / kTwoPi * kCountsPerTurn));
    raw.counts = counts & 0xfffff;
    if (n_ % kUpdate == 0) {
      current_ = speed_ == 0 ? 0 : 2 + 0.3 * std::sin(12 * angle_) + 0.05 * noise_(random_);
      raw.effort = static_cast<Real>(current_);
    } else {
      raw.effort_quality = Quality::held;
    }
    ++n_;
    return raw;
  }
  MonitorState feed(const RawDriveSample<Real>& raw) {
    return monitor.process(input_.process(raw));
  }
  void run(double seconds) {
    for (int i = 0; i < seconds / kPeriod_s; ++i) feed(next());
  }
  [[nodiscard]] double speed() const { return speed_; }

  SignalHealthMonitor<Real> monitor;

 private:
  DriveInput<Real> input_;
  std::mt19937_64 random_;
  std::normal_distribution<double> noise_{0, 1};
  std::uint64_t n_ = 0;
  double angle_ = 0.1, speed_ = 0, current_ = 0;
};

template <typename Real>
void healthy() {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Spindle<Real> s(seed);
    s.run(0.01);
    unsigned accused = 0;
    for (int i = 0; i < 400000; ++i) accused += s.feed(s.next()) != MonitorState::armed;
    if (accused != 0) check::fail(__FILE__, __LINE__) << accused << " of seed " << seed << '\n';
    ++check::checks;
  }
}

/// Damages samples while `damage(raw, i)` is called, i = 0, 1, ... `samples`; the fault must be
/// named within `latest` samples, and be over after the release time, on a drive that runs.
template <typename Real, typename Damage>
void fault(const std::string& what, Damage damage, int samples, SignalCause cause,
           MonitorState state, int latest) {
  for (std::uint64_t seed = 11; seed <= 15; ++seed) {
    Spindle<Real> s(seed);
    s.run(1.2);  // at full speed
    CHECK(s.monitor.state().state == MonitorState::armed);
    int named = -1;
    for (int i = 0; i < samples; ++i) {
      RawDriveSample<Real> raw = s.next();
      damage(raw, i);
      s.feed(raw);
      if (named < 0 && s.monitor.state().cause == cause && s.monitor.state().state == state)
        named = i;
    }
    // The last damage may be seen with the first good sample only.
    s.feed(s.next());
    if (named < 0 && s.monitor.state().cause == cause && s.monitor.state().state == state)
      named = samples;
    if (!(named >= 0 && named <= latest))
      check::fail(__FILE__, __LINE__)
          << what << ": named after " << named << ", cause " << name_of(s.monitor.state().cause)
          << ", state " << name_of(s.monitor.state().state) << ", seed " << seed << '\n';
    ++check::checks;
    CHECK(s.monitor.state().state != MonitorState::armed);
    for (int i = 0; i < 8020; ++i) s.feed(s.next());
    if (s.monitor.state().state != MonitorState::armed)
      check::fail(__FILE__, __LINE__)
          << what << " latches: " << name_of(s.monitor.state().cause) << '\n';
    ++check::checks;
  }
}

template <typename Real>
void faults() {
  using Raw = RawDriveSample<Real>;
  using enum SignalCause;
  constexpr Real kNan = std::numeric_limits<Real>::quiet_NaN();
  const auto warning = MonitorState::warning, fault_state = MonitorState::signal_fault;
  fault<Real>(
      "NaN", [&](Raw& r, int) { r.effort = kNan, r.effort_quality = Quality::good; }, 1, damaged,
      warning, 0);
  fault<Real>(
      "Inf",
      [&](Raw& r, int) {
        r.effort = std::numeric_limits<Real>::infinity(), r.effort_quality = Quality::good;
      },
      1, damaged, warning, 0);
  fault<Real>(
      "wild count", [](Raw& r, int) { r.counts = (r.counts + 50000) & 0xfffff; }, 1, jump, warning,
      0);
  for (const Quality q : {Quality::duplicate, Quality::reordered, Quality::missing})
    fault<Real>(
        name_of(q), [&](Raw& r, int) { r.motion_quality = r.effort_quality = q; }, 1, disorder,
        warning, 0);
  fault<Real>(
      "late", [](Raw& r, int) { r.motion_quality = Quality::late; }, 1, jitter, warning, 0);
  fault<Real>(
      "dead bus", [](Raw& r, int) { r.motion_quality = r.effort_quality = Quality::dead_bus; }, 3,
      silent_bus, fault_state, 0);
  fault<Real>(
      "lost block", [](Raw& r, int) { r.motion_quality = r.effort_quality = Quality::missing; }, 20,
      gap, fault_state, 8);
  std::int64_t held = 0;
  fault<Real>(
      "stuck encoder",
      [&](Raw& r, int i) {
        if (i == 0) held = r.counts;
        r.counts = held;
      },
      40, stuck_encoder, fault_state, 2);
  for (const int by : {20, -50, 1000})
    fault<Real>(
        "glitch of " + std::to_string(by),
        [&](Raw& r, int) { r.counts = (r.counts + by) & 0xfffff; }, 1, jump, warning, 1);
  fault<Real>(
      "narrow counter", [](Raw& r, int) { r.counts &= 0xfff; }, 20, jump, warning, 1);
  // With the current renewed every fourth sample: 80 and 1600 new values, and the one before.
  fault<Real>(
      "saturated", [](Raw& r, int) { r.effort = 40; }, 4 * 82, saturated, warning, 4 * 81);
  fault<Real>(
      "frozen current", [](Raw& r, int) { r.effort = Real(2.5); }, 4 * 1602, frozen_effort, warning,
      4 * 1602);
  // One sample in fifty: each is repaired, together they are too many: 1 % of 8000 are 80, and
  // -8000 ln(1 - 0.5) samples bring a share of 2 % to 1 %.
  fault<Real>(
      "bad line",
      [&](Raw& r, int i) {
        if (i % 50 == 0) r.effort = kNan, r.effort_quality = Quality::good;
      },
      8000, too_many, fault_state, 5650);
}

// The share against its recursion, sample by sample in double, through bursts of faults and rests
// long enough to be forgotten altogether: below 1e-6 it may be told as none. And a current that
// freezes is found after as many samples as on the first day.
template <typename Real>
void share() {
  SignalHealthConfig c;
  c.window_samples = 200;
  c.release_samples = 300;
  c.frozen_samples = 40;
  SignalHealthMonitor<Real> monitor;
  monitor.configure(c);
  DriveSample<Real> in;
  in.increment = Real(1e-3);
  double share = 0, worst = 0;
  int late = 0;
  for (int round = 0; round < 6; ++round) {
    for (int i = 0; i < 6000; ++i) {
      const bool faulty = i < 5 * round && i % 2 == 0;
      in.effort = static_cast<Real>(1 + i % 7);
      in.quality = faulty         ? Quality::missing | Quality::invalid
                   : i % 11 == 10 ? Quality::held
                                  : Quality::good;
      monitor.process(in);
      share += ((faulty ? 1 : 0) - share) / 200;
      worst = std::max(worst, std::abs(static_cast<double>(monitor.state().share) - share));
    }
    CHECK(monitor.state().state == MonitorState::armed);
    CHECK(monitor.state().share == 0);
    in.quality = Quality::good;
    in.effort = Real(20);
    int frozen = 0;
    while (monitor.process(in) == MonitorState::armed && frozen < 1000) ++frozen;
    late += frozen != 40;
    in.effort = Real(21);
    for (int i = 0; i < 300; ++i) in.effort = -in.effort, monitor.process(in);
    share *= std::pow(1 - 1.0 / 200, frozen + 301);
  }
  check::figure("share: largest error", worst);
  CHECK(worst < 1.01e-6);
  CHECK(late == 0);
}

template <typename Real>
void power_up() {
  SignalHealthMonitor<Real> monitor;
  monitor.configure({});
  DriveSample<Real> zero;
  for (int i = 0; i < 100000; ++i) monitor.process(zero);
  CHECK(monitor.state().state == MonitorState::learning);
  CHECK(monitor.state().cause == SignalCause::zeros);
  DriveSample<Real> alive;
  alive.effort = 1;
  CHECK(monitor.process(alive) == MonitorState::armed);
  // From then on zeros are legal: the drive stands.
  unsigned accused = 0;
  for (int i = 0; i < 100000; ++i) accused += monitor.process(zero) != MonitorState::armed;
  CHECK(accused == 0);
  // A NaN is no sign of life.
  monitor.reset();
  DriveSample<Real> bad;
  bad.quality = Quality::invalid;
  CHECK(monitor.process(bad) == MonitorState::warning);
}

void refusals() {
  const auto parameter = [](auto change) {
    SignalHealthConfig c;
    change(c);
    return std::string(SignalHealthMonitor<float>::validate(c).parameter());
  };
  CHECK_TEXT(parameter([](auto& c) { c.effort_limit = -1; }), "effort_limit");
  CHECK_TEXT(parameter([](auto& c) { c.saturated_samples = 0; }), "saturated_samples");
  CHECK_TEXT(parameter([](auto& c) { c.tolerated_share = 0; }), "tolerated_share");
  CHECK_TEXT(parameter([](auto& c) { c.window_samples = 0; }), "window_samples");
  CHECK_TEXT(parameter([](auto& c) { c.release_samples = 0; }), "release_samples");
  CHECK_TEXT(parameter([](auto&) {}), "");
}

}  // namespace

int main() {
  healthy<float>();
  healthy<double>();
  faults<float>();
  faults<double>();
  share<float>();
  share<double>();
  power_up<float>();
  power_up<double>();
  refusals();
  return check::done();
}
