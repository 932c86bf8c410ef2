// Tool wear, from the thrust and torque of each hole or pass.
//
// Purpose: says when a drill, a tap or another tool is worn out or has chipped, from the cutting
// force and torque that feed axis and spindle estimate anyway (Koike 2016, ch. 4; observers at 500
// rad/s). The source's rules are made by drill_6mm(), drill_3mm(), tap_m6() and tap_m3().
// Equation: signals are averaged over parts of `part_s`; e(v) = o + c sgn(v) + d v is what friction
// has changed by since the machine was identified, and a part reads force - e(v).
//   cut:    a part that goes into the workpiece at feed, spindle turning, at or above the cutting
//           thrust or torque; ends below `release_fraction` of both, or when the feed ends
//   hole:   mean over the cut's parts at steady speed, without its first entry_m and last exit_m
//   level:  mean over the last average_holes holes   -> thrust_limit_N, torque_limit_Nm
//   ratio:  level / mean of the first teach_holes    -> thrust_ratio, torque_ratio
//   step:   nearest of the last confirm_holes holes - median of the three before them, up
//           (chipping) or down (fracture)            -> thrust_step_N, torque_step_Nm
// A step is raised from limit - a on, a = min(3.6 s, limit / 4), s the scatter of the taught holes:
// so a step as large as the limit is found, not missed every other time (a hole and the median of
// three others differ by 1.20 s rms). The median, because one odd hole is no step; three holes,
// because more of them lag behind a tool that wears fast. Steady is a speed that changes by less
// than steady_fraction from part to part, or so slowly that inertia asks for less than half of what
// means cutting: that much an axis gives way to chips, and an observer that knows its mass within a
// tenth reads it wrong by a twentieth. Friction changes with heat (55 N in the source). o, c, d are
// learned again in every air move at steady speed by a Kalman filter on a random walk, spindle
// friction likewise while it turns in the air. Air is: rapids, the way back above the hole, and the
// first clearance_m of a stroke at feed. What is found about a tool stands until new_tool(): a drop
// after a fracture clears nothing.
// Discretisation: parts; five more samples after a part for its filters, the verdict and the
// evidence.
// Delay: a verdict with the part that ends the cut (with pecks: peck_window_s later or with the
// next hole), confirm_holes holes for a step, (average_holes - 1) / 2 for a slow rise.
// Cost on Cortex-M4F: 89 instructions, 320 for the worst sample.
// Range: |force|, |torque| < 1e15; feeds from maximum_feed_m_s / 1000 on.
// Numerical bound: sums live one part, means one hole; the filters are contractions; nothing drifts
// in 24 h.
// Bad at: holes shorter than entry + exit + shortest_m (`short_cuts` counts them); a drill that is
// gone altogether (no thrust, no hole); friction that changes with position; cuts at rapid.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/monitors/monitor.hpp"

namespace servosense {

struct WearConfig {
  double sample_period_s = 125e-6;
  double part_s = 0.01;     ///< signals are averaged over so long
  int feed_direction = -1;  ///< of the axis, into the workpiece: -1 or +1; 0 = passes both ways
  // What a cut is.
  double cutting_thrust_N = 0;      ///< 0 = thrust does not say whether there is a cut
  double cutting_torque_Nm = 0;     ///< 0 = torque does not
  double release_fraction = 0.5;    ///< a cut ends below this fraction of both
  double maximum_feed_m_s = 0.1;    ///< faster moves are rapids and never cut
  double minimum_speed_rad_s = 10;  ///< slower than this the spindle does not cut
  double steady_fraction = 0.02;    ///< of the speed, between parts, that counts as steady
  /// Of the feed axis and of the spindle; 0 = not known. With them a speed is steady, too, while
  /// its change takes less than half of the cutting thrust or torque.
  double equivalent_mass_kg = 0;
  double inertia_kg_m2 = 0;
  double entry_m = 3e-3;      ///< of a cut, not counted: drill point, chamfer of a tap
  double exit_m = 3e-3;       ///< of a cut, not counted: break-through
  double shortest_m = 3e-3;   ///< that has to remain
  double clearance_m = 2e-3;  ///< of a stroke at feed, at least, lies before the workpiece
  double peck_window_s = 0;   ///< cuts that go on at the bottom within this are one hole
  // The rules. 0 = none.
  double thrust_limit_N = 0;
  double thrust_step_N = 0;
  double thrust_ratio = 0;  ///< of the taught thrust
  double torque_limit_Nm = 0;
  double torque_step_Nm = 0;
  double torque_ratio = 0;         ///< of the taught torque
  double warning_fraction = 0.75;  ///< of limits and ratios; a step has no warning
  unsigned teach_holes = 10;       ///< 2 or more
  unsigned average_holes = 3;      ///< that make the level; the source takes ten without wear
  unsigned confirm_holes = 2;      ///< that have to agree on a step
  // How far friction may be off; random walk, constant + direction + speed.
  double friction_error_N = 100;  ///< at the start, each of the three (at rapid)
  double friction_drift_N = 3.2;  ///< in 1 s: 55 N in 300 s
  double friction_noise_N = 10;   ///< of a part in the air, at feed
  double rapid_m_s = 0.83;
  double spindle_error_Nm = 0.1;
  double spindle_drift_Nm = 0.003;
  double spindle_noise_Nm = 0.02;
  double top_speed_rad_s = 1000;
  double tolerated_stand_ins = 0.25;  ///< of a part

  // The source's tools (Koike 2016, section 4.3). Cutting levels and lengths are not the source's:
  // a third of what a new tool takes, half to one diameter.
  static WearConfig drill_6mm() noexcept {
    WearConfig c;
    c.cutting_thrust_N = 120;
    c.thrust_limit_N = 800;
    c.thrust_step_N = 100;
    return c;
  }
  static WearConfig drill_3mm() noexcept {
    WearConfig c;
    c.cutting_thrust_N = 50;
    c.thrust_limit_N = 330;
    c.thrust_step_N = 40;
    c.entry_m = c.exit_m = c.shortest_m = 2e-3;
    return c;
  }
  static WearConfig tap_m6() noexcept {
    WearConfig c;
    c.cutting_torque_Nm = 0.25;
    c.torque_limit_Nm = 2.5;
    c.torque_ratio = 3;
    return c;
  }
  static WearConfig tap_m3() noexcept {
    WearConfig c;
    c.cutting_torque_Nm = 0.06;
    c.torque_ratio = 3;
    c.entry_m = c.exit_m = c.shortest_m = 1.5e-3;
    return c;
  }
};

struct FrictionDriftConfig {
  double offset_error = 0;     ///< standard deviation at the start, as `friction_error`
  double friction_error = 0;   ///< of c, and of d at the reference speed
  double drift = 0;            ///< of each in 1 s
  double noise = 0;            ///< of a value at `usual_speed` or slower
  double usual_speed = 1;      ///< where friction has to be known; noise grows beyond it
  double reference_speed = 1;  ///< that d refers to
};

/// What friction has changed by: o + c sgn(v) + d v / reference speed, from values in the air.
template <RealNumber Real>
class FrictionDrift {
 public:
  struct State {
    std::array<Real, 3> x{};  ///< o, c, d
    // Covariance: oo, oc, od, cc, cd, dd.
    std::array<Real, 6> p{};
  };

  void configure(const FrictionDriftConfig& c) noexcept {
    auto square = [](double x) { return static_cast<Real>(x * x); };
    first_ = {square(c.offset_error), square(c.friction_error), square(c.friction_error)};
    // What is known to be zero does not move either.
    for (std::size_t i = 0; i < 3; ++i) drift_[i] = first_[i] > 0 ? square(c.drift) : Real(0);
    noise_ = square(c.noise);
    per_usual_ = static_cast<Real>(1 / c.usual_speed);
    per_reference_ = static_cast<Real>(1 / c.reference_speed);
  }
  void reset(State& s) const noexcept {
    s = State{};
    doubt(s);
  }
  /// An unknown time has passed: what is known is as uncertain as at the start.
  void doubt(State& s) const noexcept {
    s.p = {};
    for (std::size_t i = 0; i < 3; ++i) s.p[kDiagonal[i]] = first_[i];
  }
  [[nodiscard]] Real at(const State& s, Real speed) const noexcept {
    return s.x[0] + sign(speed) * s.x[1] + speed * per_reference_ * s.x[2];
  }
  /// Standard deviation squared of at().
  [[nodiscard]] Real variance(const State& s, Real speed) const noexcept {
    const Row h = row(speed);
    const Row ph = times(s, h);
    return ph[0] * h[0] + ph[1] * h[1] + ph[2] * h[2];
  }
  /// Time passes; what is known gets old, but no older than at the start.
  void elapse(State& s, Real seconds) const noexcept {
    for (std::size_t i = 0; i < 3; ++i) {
      Real& p = s.p[kDiagonal[i]];
      const Real grown = p + drift_[i] * seconds;
      if (grown <= first_[i]) p = grown;
    }
  }
  /// A value in the air. A doubtful one, from what may be a soft cut, is taken only within three
  /// standard deviations of what was expected.
  void learn(State& s, Real value, Real speed, bool doubtful) const noexcept {
    const Row h = row(speed);
    const Row ph = times(s, h);
    const Real apart = speed * per_usual_;
    const Real noise = noise_ * (Real(1) + (apart * apart > 1 ? apart * apart : Real(0)));
    const Real total = ph[0] * h[0] + ph[1] * h[1] + ph[2] * h[2] + noise;
    const Real off = value - at(s, speed);
    if (doubtful && off * off > 9 * total) return;
    const Real scale = Real(1) / total;
    const Real error = off * scale;
    std::size_t k = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      s.x[i] += ph[i] * error;
      for (std::size_t j = i; j < 3; ++j, ++k) s.p[k] -= ph[i] * ph[j] * scale;
      Real& p = s.p[kDiagonal[i]];  // rounding must not make it negative
      if (p < 0) p = 0;
    }
  }

 private:
  using Row = std::array<Real, 3>;
  static constexpr std::array<std::size_t, 3> kDiagonal = {0, 3, 5};
  static Real sign(Real v) noexcept { return v > 0 ? Real(1) : v < 0 ? Real(-1) : Real(0); }
  [[nodiscard]] Row row(Real speed) const noexcept {
    return {Real(1), sign(speed), speed * per_reference_};
  }
  static Row times(const State& s, const Row& h) noexcept {
    const auto& p = s.p;
    return {p[0] * h[0] + p[1] * h[1] + p[2] * h[2], p[1] * h[0] + p[3] * h[1] + p[4] * h[2],
            p[2] * h[0] + p[4] * h[1] + p[5] * h[2]};
  }

  Row first_{};
  Row drift_{};
  Real noise_ = 1;
  Real per_usual_ = 1;
  Real per_reference_ = 1;
};

/// The rule that a verdict rests on.
enum class WearRule : std::uint8_t {
  none,
  thrust_limit,
  thrust_ratio,
  thrust_rise,  ///< chipping
  thrust_drop,  ///< fracture
  torque_limit,
  torque_ratio,
  torque_rise,
  torque_drop,
};

[[nodiscard]] constexpr const char* name_of(WearRule rule) noexcept {
  switch (rule) {
    case WearRule::none:
      return "none";
    case WearRule::thrust_limit:
      return "thrust limit";
    case WearRule::thrust_ratio:
      return "thrust against the first holes";
    case WearRule::thrust_rise:
      return "sudden rise of thrust";
    case WearRule::thrust_drop:
      return "sudden drop of thrust";
    case WearRule::torque_limit:
      return "torque limit";
    case WearRule::torque_ratio:
      return "torque against the first holes";
    case WearRule::torque_rise:
      return "sudden rise of torque";
    case WearRule::torque_drop:
      return "sudden drop of torque";
  }
  return "";
}

/// Unit of the value and threshold that the rule compares.
[[nodiscard]] constexpr const char* unit_of(WearRule rule) noexcept {
  switch (rule) {
    case WearRule::none:
    case WearRule::thrust_ratio:
    case WearRule::torque_ratio:
      return "";
    case WearRule::torque_limit:
    case WearRule::torque_rise:
    case WearRule::torque_drop:
      return "Nm";
    default:
      return "N";
  }
}

/// A hole or pass, friction and non-cutting parts removed.
template <RealNumber Real>
struct WearHole {
  Real thrust_N = 0;       ///< mean
  Real torque_Nm = 0;      ///< mean
  Real thrust_peak_N = 0;  ///< highest sample of the counted parts
  Real torque_peak_Nm = 0;
  Real travel_m = 0;        ///< counted
  std::uint32_t parts = 0;  ///< counted
};

/// One of the two signals of a tool, over its holes.
template <RealNumber Real>
struct WearTrend {
  static constexpr std::size_t kHoles = 16;
  Real taught = 0;   ///< mean of the first holes...
  Real squares = 0;  ///< ...and sum of their squared deviations (Welford 1962)
  Real scatter = 0;  ///< standard deviation of a taught hole; 0 until taught
  Real level = 0;    ///< mean of the last holes
  Real rise = 0;     ///< of the last confirm_holes, nearest; 0 until there are enough
  std::array<Real, kHoles> hole{};  ///< ring
};

/// Everything known about a tool. Keep it when the tool goes back to the magazine.
template <RealNumber Real>
struct WearTool {
  MonitorState condition = MonitorState::armed;  ///< armed, warning or alarm; never falls
  WearRule rule = WearRule::none;                ///< that made the condition...
  Real value = 0;                                ///< ...with what value...
  Real threshold = 0;                            ///< ...over what
  std::uint32_t holes = 0;                       ///< of this tool, stops at 2^32 - 1
  std::uint32_t taught = 0;                      ///< of them taught so far
  std::uint32_t alarm_hole = 0;                  ///< that raised the alarm, from 1
  std::uint32_t next = 0;                        ///< of the rings
  WearTrend<Real> thrust;
  WearTrend<Real> torque;
};

/// KeptParts: longest hole, in parts, whose alarm can be replayed; a longer one is raised without.
template <RealNumber Real, std::size_t KeptParts = 128>
class WearMonitor {
  static_assert(KeptParts >= 1);

 public:
  using Config = WearConfig;
  using Hole = WearHole<Real>;
  using Trend = WearTrend<Real>;
  using Tool = WearTool<Real>;
  static constexpr std::uint32_t kSettled = 2;  ///< steady parts until the observers have settled
  static constexpr std::size_t kBuckets = 8;    ///< that the last exit_m of a cut wait in

  enum class Phase : std::uint8_t { air, cutting, in_hole };

  /// One part of `part_s`: what is kept for a replay.
  struct Part {
    Real thrust_N = 0;  ///< mean over the good samples
    Real torque_Nm = 0;
    Real travel_m = 0;
    Real turned_rad = 0;
    Real thrust_low_N = 0;
    Real thrust_high_N = 0;
    Real torque_low_Nm = 0;
    Real torque_high_Nm = 0;
    bool usable = false;  ///< enough good samples
  };

  /// Everything that passes from part to part.
  struct Core {
    Phase phase = Phase::air;
    bool open = false;         ///< a hole has begun and has no verdict
    bool just_opened = false;  ///< with the last part
    std::uint32_t steady = 0;  ///< parts in a row at steady speed, stops at kSettled
    Real feed_m_s = 0;         ///< of the last part
    Real speed_rad_s = 0;
    Real thrust_N = 0;  ///< of the last part, friction removed
    Real torque_Nm = 0;
    Real cut_m = 0;          ///< fed since the cut began
    Real depth_m = 0;        ///< of the hole, a little more
    Real from_bottom_m = 0;  ///< along the feed
    Real since_cut_s = 0;
    Hole hole;                          ///< the open one so far
    Hole complete;                      ///< the last complete one
    std::array<Hole, kBuckets> last{};  ///< newest stretches of the cut, may be its exit; a ring
    std::uint32_t buckets = 0;
    std::uint32_t newest = 0;
    Real stroke_m = 0;     ///< at feed into the workpiece, cutting or not
    Part lesson;           ///< the last part...
    bool learns = false;   ///< ...if it was air
    bool verdict = false;  ///< `complete` is not judged yet
    typename FrictionDrift<Real>::State friction;
    typename FrictionDrift<Real>::State spindle;
    Tool tool;
    std::uint64_t short_cuts = 0;   ///< without enough steady travel
    std::uint64_t broken_cuts = 0;  ///< given up for a fault
  };

  struct State {
    MonitorState state = MonitorState::idle;
    SignalState signal = SignalState::filling;
    std::uint64_t sample = 0;
    std::uint64_t holes = 0;      ///< judged, all tools
    std::uint64_t alarms = 0;     ///< tools
    std::uint64_t stand_ins = 0;  ///< samples not used
    std::uint64_t restarts = 0;
  };

  /// What an alarm is replayed from: the monitor as the hole had begun, and the parts since.
  struct Evidence {
    Core before;
    std::array<Part, KeptParts> parts{};
    std::uint32_t count = 0;  ///< 0: no alarm yet, or the hole was too long
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0 && c.sample_period_s <= 0.1))
      return Status::invalid("sample_period_s", "must be positive, 0.1 s at most");
    if (!(c.part_s >= 7.5 * c.sample_period_s && c.part_s <= 10))
      return Status::invalid("part_s", "must be within 8 samples and 10 s");
    if (c.feed_direction < -1 || c.feed_direction > 1)
      return Status::invalid("feed_direction", "must be -1, 0 or 1");
    struct Number {
      const char* name;
      double value;
      bool positive;
    };
    const Number numbers[] = {{"cutting_thrust_N", c.cutting_thrust_N, false},
                              {"cutting_torque_Nm", c.cutting_torque_Nm, false},
                              {"maximum_feed_m_s", c.maximum_feed_m_s, true},
                              {"minimum_speed_rad_s", c.minimum_speed_rad_s, true},
                              {"steady_fraction", c.steady_fraction, true},
                              {"equivalent_mass_kg", c.equivalent_mass_kg, false},
                              {"inertia_kg_m2", c.inertia_kg_m2, false},
                              {"entry_m", c.entry_m, false},
                              {"exit_m", c.exit_m, false},
                              {"shortest_m", c.shortest_m, false},
                              {"clearance_m", c.clearance_m, false},
                              {"peck_window_s", c.peck_window_s, false},
                              {"thrust_limit_N", c.thrust_limit_N, false},
                              {"thrust_step_N", c.thrust_step_N, false},
                              {"torque_limit_Nm", c.torque_limit_Nm, false},
                              {"torque_step_Nm", c.torque_step_Nm, false},
                              {"friction_error_N", c.friction_error_N, false},
                              {"friction_drift_N", c.friction_drift_N, false},
                              {"friction_noise_N", c.friction_noise_N, true},
                              {"rapid_m_s", c.rapid_m_s, true},
                              {"spindle_error_Nm", c.spindle_error_Nm, false},
                              {"spindle_drift_Nm", c.spindle_drift_Nm, false},
                              {"spindle_noise_Nm", c.spindle_noise_Nm, true},
                              {"top_speed_rad_s", c.top_speed_rad_s, true}};
    for (const Number& n : numbers) {
      if (n.positive && !(n.value > 0 && n.value < 1e9))
        return Status::invalid(n.name, "must be positive, below 1e9");
      if (!(n.value >= 0 && n.value < 1e9))
        return Status::invalid(n.name, "must be zero or positive, below 1e9");
    }
    if (!(c.cutting_thrust_N > 0 || c.cutting_torque_Nm > 0))
      return Status::invalid("cutting_thrust_N",
                             "must be set, or cutting_torque_Nm, to know when the tool cuts");
    if (!(c.release_fraction > 0 && c.release_fraction <= 1))
      return Status::invalid("release_fraction", "must be within 0 and 1");
    if (!(c.thrust_ratio == 0 || (c.thrust_ratio > 1 && is_finite(c.thrust_ratio))))
      return Status::invalid("thrust_ratio", "must be zero (none) or more than 1");
    if (!(c.torque_ratio == 0 || (c.torque_ratio > 1 && is_finite(c.torque_ratio))))
      return Status::invalid("torque_ratio", "must be zero (none) or more than 1");
    if (!(c.warning_fraction > 0 && c.warning_fraction <= 1))
      return Status::invalid("warning_fraction", "must be within 0 and 1");
    if (c.teach_holes < 2 || c.teach_holes > 10000)
      return Status::invalid("teach_holes", "must be within 2 and 10000");
    if (c.average_holes < 1 || c.average_holes > Trend::kHoles)
      return Status::invalid("average_holes", "must be within 1 and 16");
    if (c.confirm_holes < 1 || c.confirm_holes > Trend::kHoles - 3)
      return Status::invalid("confirm_holes", "must be within 1 and 13");
    if (!(c.tolerated_stand_ins >= 0 && c.tolerated_stand_ins < 1))
      return Status::invalid("tolerated_stand_ins", "must be at least 0 and below 1");
    return {};
  }

  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    auto real = [](double x) { return static_cast<Real>(x); };
    part_samples_ = static_cast<std::uint32_t>(std::lround(c.part_s / c.sample_period_s));
    fewest_ = part_samples_ - static_cast<std::uint32_t>(c.tolerated_stand_ins *
                                                         static_cast<double>(part_samples_));
    const double part_s = part_samples_ * c.sample_period_s;
    part_s_ = real(part_s);
    per_part_s_ = real(1 / part_s);
    direction_ = real(c.feed_direction);
    thrust_level_ = real(c.cutting_thrust_N);
    torque_level_ = real(c.cutting_torque_Nm);
    release_ = real(c.release_fraction);
    fastest_ = real(c.maximum_feed_m_s);
    slowest_ = real(c.maximum_feed_m_s * 1e-3);
    turning_ = real(c.minimum_speed_rad_s);
    steady_ = real(c.steady_fraction);
    const auto slack = [&](double level, double inertia) {
      return inertia > 0 ? real(0.5 * level * part_s / inertia) : Real(0);
    };
    feed_slack_ = slack(c.cutting_thrust_N, c.equivalent_mass_kg);
    speed_slack_ = slack(c.cutting_torque_Nm, c.inertia_kg_m2);
    entry_m_ = real(c.entry_m);
    exit_m_ = real(c.exit_m);
    bucket_m_ = real(c.exit_m / (kBuckets - 1));
    shortest_m_ = real(c.shortest_m);
    clearance_m_ = real(c.clearance_m);
    peck_s_ = real(c.peck_window_s);
    thrust_rules_ = {real(c.thrust_limit_N), real(c.thrust_ratio), real(c.thrust_step_N)};
    torque_rules_ = {real(c.torque_limit_Nm), real(c.torque_ratio), real(c.torque_step_Nm)};
    off_ = !(c.thrust_limit_N > 0 || c.thrust_ratio > 0 || c.thrust_step_N > 0 ||
             c.torque_limit_Nm > 0 || c.torque_ratio > 0 || c.torque_step_Nm > 0);
    warning_ = real(c.warning_fraction);
    teach_ = c.teach_holes;
    average_ = c.average_holes;
    confirm_ = c.confirm_holes;
    friction_.configure({c.friction_error_N, c.friction_error_N, c.friction_drift_N,
                         c.friction_noise_N, c.maximum_feed_m_s, c.rapid_m_s});
    // Turning one way, a spindle cannot tell an offset from friction.
    spindle_.configure({0, c.spindle_error_Nm, c.spindle_drift_Nm, c.spindle_noise_Nm,
                        c.top_speed_rad_s, c.top_speed_rad_s});
    reset();
  }

  /// Forgets everything, the tool included.
  void reset() noexcept {
    core_ = Core{};
    friction_.reset(core_.friction);
    spindle_.reset(core_.spindle);
    sums_ = Sums{};
    state_ = State{};
    stage_ = 0;
    recording_ = false;
    slot_ = 0;
    count_ = {};
    pinned_ = kNone;
  }
  /// Another tool. Give what tool() said of it when it was last in the spindle, if it ever was.
  /// What is known of friction stays.
  void new_tool(const Tool& tool = {}) noexcept {
    give_up_cut();
    core_.tool = tool;
    show();
  }
  /// The tool's first holes as they were taught on another of its kind; skips teaching.
  void set_taught(Real thrust_N, Real thrust_scatter_N, Real torque_Nm,
                  Real torque_scatter_Nm) noexcept {
    Tool& t = core_.tool;
    t.thrust.taught = thrust_N;
    t.thrust.scatter = thrust_scatter_N;
    t.torque.taught = torque_Nm;
    t.torque.scatter = torque_scatter_Nm;
    t.taught = teach_;
    show();
  }

  /// One servo period: cutting force of the feed axis, its increment, cutting torque of the
  /// spindle, its increment, and what is known against any of them.
  MonitorState process(Real force_N, Real feed_m, Real torque_Nm, Real turned_rad,
                       Quality quality) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    Sums& p = sums_;
    ++s.sample;
    if (stage_ != 0) run_stage();
    // In one test: four numbers, each within reason.
    const Real check = (force_N * force_N + torque_Nm * torque_Nm) * Real(1e-30) + feed_m * feed_m +
                       turned_rad * turned_rad * Real(1e-4);
    if (has(quality, kBreaks | kFaulty) || !(check < Real(1))) {
      if (!take_fault(quality, feed_m, turned_rad)) return s.state;
    } else {
      if (s.signal != SignalState::good) set_signal(SignalState::good);
      p.force += force_N;
      p.torque += torque_Nm;
      p.travel += feed_m;
      p.turned += turned_rad;
      p.last_feed = feed_m;
      p.last_turned = turned_rad;
      if (force_N < p.force_low) p.force_low = force_N;
      if (force_N > p.force_high) p.force_high = force_N;
      if (torque_Nm < p.torque_low) p.torque_low = torque_Nm;
      if (torque_Nm > p.torque_high) p.torque_high = torque_Nm;
      ++p.good;
    }
    if (++p.samples == part_samples_) close_part();
    return s.state;
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] const Core& core() const noexcept { return core_; }
  [[nodiscard]] const Tool& tool() const noexcept { return core_.tool; }
  /// The last complete hole.
  [[nodiscard]] const Hole& hole() const noexcept { return core_.complete; }
  /// Friction of the axis, and of the spindle, over what was identified; and its standard
  /// deviation. Off the real-time path.
  [[nodiscard]] Real friction_N(Real feed_m_s) const noexcept {
    return friction_.at(core_.friction, feed_m_s);
  }
  [[nodiscard]] Real spindle_friction_Nm(Real speed_rad_s) const noexcept {
    return spindle_.at(core_.spindle, speed_rad_s);
  }
  [[nodiscard]] Real friction_sigma_N(Real feed_m_s) const noexcept {
    return std::sqrt(friction_.variance(core_.friction, feed_m_s));
  }

  /// What the last alarm was raised from. A copy; off the real-time path.
  [[nodiscard]] Evidence evidence() const noexcept {
    Evidence e;
    if (pinned_ == kNone) return e;
    e.before = before_[pinned_];
    e.parts = parts_[pinned_];
    e.count = count_[pinned_];
    return e;
  }
  /// The monitor's core after the last part of the evidence: its tool has the alarm, bit for bit.
  /// Off the real-time path. Requires configure() with the configuration of the alarm.
  [[nodiscard]] Core replay(const Evidence& e) const noexcept {
    Core core = e.before;
    for (std::uint32_t i = 0; i < e.count; ++i) {
      segment(core, e.parts[i]);
      learn_friction(core);
      learn_spindle(core);
      if (core.verdict) judge(core);
    }
    return core;
  }

 private:
  struct Sums {
    Real force = 0, torque = 0, travel = 0, turned = 0;
    Real last_feed = 0, last_turned = 0;  // of the last good sample
    Real force_low = kFar, force_high = -kFar, torque_low = kFar, torque_high = -kFar;
    std::uint32_t samples = 0;
    std::uint32_t good = 0;
  };
  struct Rules {
    Real limit = 0, ratio = 0, step = 0;
  };
  static constexpr Real kFar = Real(1e30);
  static constexpr std::size_t kNone = 2;
  static constexpr Quality kBreaks = Quality::restarted | Quality::gap | Quality::settling;
  static constexpr Quality kFaulty = kUnusable | Quality::stuck;
  static Real magnitude(Real x) noexcept { return x < 0 ? -x : x; }

  // ---- samples ---------------------------------------------------------------------------------

  // False when the sample does not belong to any part.
  [[gnu::noinline]] bool take_fault(Quality quality, Real feed_m, Real turned_rad) noexcept {
    if (has(quality, kBreaks)) {
      if (state_.signal == SignalState::good) start_anew();
      set_signal(has(quality, Quality::gap) ? SignalState::faulty : SignalState::filling);
      return false;
    }
    ++state_.stand_ins;
    set_signal(SignalState::faulty);
    // The axis moves on meanwhile.
    sums_.travel += magnitude(feed_m) < 1 ? feed_m : sums_.last_feed;
    sums_.turned += magnitude(turned_rad) < 100 ? turned_rad : sums_.last_turned;
    return true;
  }
  void start_anew() noexcept {
    ++state_.restarts;
    sums_ = Sums{};
    stage_ = 0;
    give_up_cut();
    core_.phase = Phase::air;
    core_.steady = 0;
    // Nobody knows how long it was.
    friction_.doubt(core_.friction);
    spindle_.doubt(core_.spindle);
  }
  void give_up_cut() noexcept {
    Core& c = core_;
    if (c.phase == Phase::cutting || c.open) ++c.broken_cuts;
    if (c.phase == Phase::cutting) c.phase = Phase::in_hole;
    c.open = c.verdict = c.learns = false;
    c.buckets = 0;
    c.depth_m = 0;
    recording_ = false;
  }

  [[gnu::noinline]] void set_signal(SignalState signal) noexcept {
    state_.signal = signal;
    show();
  }
  // What is known of the tool, unless the signal has a say.
  void show() noexcept {
    const Tool& t = core_.tool;
    if (state_.signal == SignalState::faulty)
      state_.state = MonitorState::signal_fault;
    else if (off_)
      state_.state = MonitorState::idle;
    else if (t.condition != MonitorState::armed)
      state_.state = t.condition;
    else if (t.taught < teach_ || state_.signal == SignalState::filling)
      state_.state = MonitorState::learning;
    else
      state_.state = MonitorState::armed;
  }

  // ---- parts -----------------------------------------------------------------------------------

  [[gnu::noinline]] void close_part() noexcept {
    const Sums& p = sums_;
    part_.usable = p.good >= fewest_ && p.good > 0;
    if (part_.usable) {
      const Real scale = Real(1) / static_cast<Real>(p.good);
      part_.thrust_N = p.force * scale;
      part_.torque_Nm = p.torque * scale;
      part_.thrust_low_N = p.force_low;
      part_.thrust_high_N = p.force_high;
      part_.torque_low_Nm = p.torque_low;
      part_.torque_high_Nm = p.torque_high;
    }
    part_.travel_m = p.travel;
    part_.turned_rad = p.turned;
    Sums next;
    next.last_feed = p.last_feed;
    next.last_turned = p.last_turned;
    sums_ = next;
    stage_ = 1;
  }

  // One stage a sample, so that no sample costs much more than another.
  [[gnu::noinline]] void run_stage() noexcept {
    Core& c = core_;
    switch (stage_++) {
      case 1:
        keep(part_);
        segment(c, part_);
        return;
      case 2:
        learn_friction(c);
        return;
      case 3:
        learn_spindle(c);
        return;
      case 4:
        if (c.verdict) take_verdict();
        return;
      default:
        stage_ = 0;
        if (c.just_opened) begin_recording();
    }
  }

  void learn_friction(Core& c) const noexcept {
    friction_.elapse(c.friction, part_s_);
    const Real v = c.lesson.travel_m * per_part_s_;
    if (c.learns && magnitude(v) >= slowest_)
      friction_.learn(c.friction, c.lesson.thrust_N, v, may_cut(c.lesson));
  }
  void learn_spindle(Core& c) const noexcept {
    spindle_.elapse(c.spindle, part_s_);
    const Real w = c.lesson.turned_rad * per_part_s_;
    if (c.learns && magnitude(w) >= turning_)
      spindle_.learn(c.spindle, c.lesson.torque_Nm, w, may_cut(c.lesson));
  }
  [[nodiscard]] bool may_cut(const Part& part) const noexcept {
    const Real feed = part.travel_m * per_part_s_;
    const Real along = direction_ != 0 ? direction_ * feed : magnitude(feed);
    return along > slowest_ && along <= fastest_ &&
           magnitude(part.turned_rad) * per_part_s_ >= turning_;
  }

  // What the part says: friction, a cut, its hole.
  void segment(Core& c, const Part& part) const noexcept {
    const Real v = part.travel_m * per_part_s_;
    const Real w = part.turned_rad * per_part_s_;
    const Real feed_change = magnitude(v - c.feed_m_s);
    const Real speed_change = magnitude(w - c.speed_rad_s);
    const Real feed_steady = steady_ * magnitude(v);
    const Real speed_steady = steady_ * magnitude(w);
    const bool still = feed_change <= feed_steady && speed_change <= speed_steady;
    const bool steady = feed_change <= std::max(feed_steady, feed_slack_) &&
                        speed_change <= std::max(speed_steady, speed_slack_);
    const bool turns_back = v * c.feed_m_s < 0;
    c.feed_m_s = v;
    c.speed_rad_s = w;
    // Friction is learned from what has settled alone.
    c.steady = still && part.usable ? c.steady + (c.steady < kSettled) : 0;
    c.just_opened = c.learns = false;

    const Real along = direction_ != 0 ? direction_ : v < 0 ? Real(-1) : Real(1);
    const Real travel = along * part.travel_m;
    const Real friction = friction_.at(c.friction, v);
    const Real spindle = spindle_.at(c.spindle, w);
    if (part.usable) {
      c.thrust_N = along * (part.thrust_N - friction);
      c.torque_Nm = (part.torque_Nm - spindle) * (w < 0 ? Real(-1) : Real(1));
    }
    const bool may = may_cut(part);
    c.stroke_m = may && !turns_back ? c.stroke_m + travel : Real(0);
    const bool cutting = c.phase == Phase::cutting;
    const Real level = cutting ? release_ : Real(1);
    // A stroke begins in the air: as long as friction may be off by more than the level itself, say
    // after a cold start, what is felt there is friction.
    const bool sure = cutting || c.stroke_m > clearance_m_;
    const bool above =
        (thrust_level_ > 0 && c.thrust_N >= level * thrust_level_ &&
         (sure || friction_.variance(c.friction, v) <= thrust_level_ * thrust_level_)) ||
        (torque_level_ > 0 && c.torque_Nm >= level * torque_level_ &&
         (sure || spindle_.variance(c.spindle, w) <= torque_level_ * torque_level_));
    // A part without enough good samples says nothing: a cut goes on through it.
    const bool cuts = may && (part.usable ? above && (cutting || steady) : cutting);

    if (!cutting) {
      c.from_bottom_m += travel;
      c.since_cut_s += part_s_;
      // On the way back some more, for a tap still turns in its thread there.
      const Real rim = c.depth_m + (travel < 0 ? entry_m_ : Real(0));
      const bool out = direction_ == 0 || c.depth_m == 0 || c.from_bottom_m <= -rim;
      c.phase = out ? Phase::air : Phase::in_hole;
      if (c.open && c.since_cut_s > peck_s_) close_hole(c);
    }
    if (cuts && !cutting) begin_cut(c);
    if (cuts) {
      c.cut_m += travel;
      c.depth_m += travel;
      if (part.usable && steady && c.cut_m > entry_m_) count(c, part, friction, spindle, along);
    } else if (cutting) {
      end_cut(c);
    } else {
      c.learns = is_air(c, part, may, above);
    }
  }

  void begin_cut(Core& c) const noexcept {
    const bool goes_on = c.open && direction_ != 0 && magnitude(c.from_bottom_m) <= entry_m_;
    if (!goes_on) {
      if (c.open) close_hole(c);
      c.depth_m = 2 * magnitude(c.feed_m_s) * part_s_;  // it touched before it was seen to cut
      c.just_opened = true;
      c.open = true;
      c.hole = Hole{};
    } else {
      c.depth_m += c.from_bottom_m;
    }
    c.phase = Phase::cutting;
    c.cut_m = 0;
    c.buckets = 0;
  }

  // The newest exit_m of the cut wait until more has followed.
  void count(Core& c, const Part& part, Real friction, Real spindle, Real along) const noexcept {
    Hole now;
    now.thrust_N = c.thrust_N;
    now.torque_Nm = c.torque_Nm;
    now.thrust_peak_N = along > 0 ? part.thrust_high_N - friction : friction - part.thrust_low_N;
    now.torque_peak_Nm =
        c.speed_rad_s < 0 ? spindle - part.torque_low_Nm : part.torque_high_Nm - spindle;
    now.travel_m = magnitude(part.travel_m);
    now.parts = 1;
    if (!(bucket_m_ > 0)) return join(c.hole, now);
    if (c.buckets > 0 && c.last[c.newest].travel_m < bucket_m_) return join(c.last[c.newest], now);
    c.newest = c.newest + 1 == kBuckets ? 0 : c.newest + 1;
    if (c.buckets == kBuckets)
      join(c.hole, c.last[c.newest]);  // the oldest: exit_m have followed
    else
      ++c.buckets;
    c.last[c.newest] = now;
  }

  static void join(Hole& a, const Hole& b) noexcept {
    if (a.parts == 0) {
      a = b;
      return;
    }
    a.parts += b.parts;
    const Real weight = static_cast<Real>(b.parts) / static_cast<Real>(a.parts);
    a.thrust_N += (b.thrust_N - a.thrust_N) * weight;
    a.torque_Nm += (b.torque_Nm - a.torque_Nm) * weight;
    if (b.thrust_peak_N > a.thrust_peak_N) a.thrust_peak_N = b.thrust_peak_N;
    if (b.torque_peak_Nm > a.torque_peak_Nm) a.torque_peak_Nm = b.torque_peak_Nm;
    a.travel_m += b.travel_m;
  }

  void end_cut(Core& c) const noexcept {
    // Of what waits, the older stretches count, up to where exit_m begins.
    Real behind = 0;
    std::uint32_t at = c.newest;
    for (std::uint32_t i = 0; i < c.buckets; ++i) {
      if (behind >= exit_m_) join(c.hole, c.last[at]);
      behind += c.last[at].travel_m;
      at = (at == 0 ? static_cast<std::uint32_t>(kBuckets) : at) - 1;
    }
    c.buckets = 0;
    c.phase = Phase::in_hole;
    c.from_bottom_m = 0;
    c.since_cut_s = 0;
    c.steady = 0;  // the observers settle anew, whatever the speed does
    if (!(peck_s_ > 0)) close_hole(c);
  }
  void close_hole(Core& c) const noexcept {
    c.open = false;
    if (c.hole.parts == 0 || c.hole.travel_m < shortest_m_) {
      ++c.short_cuts;
      return;
    }
    c.complete = c.hole;
    c.verdict = true;
  }

  // Steady, out of the hole, and not where the workpiece may be. A rapid or a retraction is never a
  // cut, however far friction is off.
  [[nodiscard]] bool is_air(Core& c, const Part& part, bool may, bool above) const noexcept {
    if (c.phase != Phase::air || c.steady < kSettled ||
        (may && (above || c.stroke_m > clearance_m_)))
      return false;
    c.lesson = part;
    return true;
  }

  // ---- holes -----------------------------------------------------------------------------------

  void take_verdict() noexcept {
    const MonitorState before = core_.tool.condition;
    judge(core_);
    ++state_.holes;
    if (core_.tool.condition == MonitorState::alarm && before != MonitorState::alarm) {
      ++state_.alarms;
      pin();
    }
    show();
  }

  void judge(Core& c) const noexcept {
    Tool& t = c.tool;
    c.verdict = false;
    if (t.holes < 0xffffffffU) ++t.holes;
    const bool teaching = t.taught < teach_;
    if (teaching) ++t.taught;
    add(t.thrust, c.complete.thrust_N, t, teaching);
    add(t.torque, c.complete.torque_Nm, t, teaching);
    t.next = t.next + 1 == Trend::kHoles ? 0 : t.next + 1;
    rule(t, t.thrust, thrust_rules_, WearRule::thrust_limit);
    rule(t, t.torque, torque_rules_, WearRule::torque_limit);
  }

  void add(Trend& s, Real hole, const Tool& t, bool teaching) const noexcept {
    if (teaching) {
      const Real d = hole - s.taught;
      s.taught += d / static_cast<Real>(t.taught);
      s.squares += d * (hole - s.taught);
      if (t.taught == teach_) s.scatter = std::sqrt(s.squares / static_cast<Real>(teach_ - 1));
    }
    s.hole[t.next] = hole;
    auto back = [&](std::uint32_t k) {
      return s.hole[(t.next + Trend::kHoles - k) % Trend::kHoles];
    };
    const std::uint32_t levels = t.holes < average_ ? t.holes : average_;
    Real level = 0;
    for (std::uint32_t k = 0; k < levels; ++k) level += back(k);
    s.level = level / static_cast<Real>(levels);
    s.rise = 0;
    if (t.holes < confirm_ + 3) return;
    const Real reference = median(back(confirm_), back(confirm_ + 1), back(confirm_ + 2));
    Real low = back(0);
    Real high = low;
    for (std::uint32_t k = 1; k < confirm_; ++k) {
      low = back(k) < low ? back(k) : low;
      high = back(k) > high ? back(k) : high;
    }
    if (low > reference) s.rise = low - reference;
    if (high < reference) s.rise = high - reference;
  }

  static Real median(Real a, Real b, Real c) noexcept {
    const Real low = a < b ? a : b;
    const Real high = a < b ? b : a;
    return c < low ? low : c > high ? high : c;
  }

  // The rules of one signal, in the order of WearRule from `first` on.
  void rule(Tool& t, const Trend& s, const Rules& r, WearRule first) const noexcept {
    auto name = [&](int k) { return static_cast<WearRule>(static_cast<int>(first) + k); };
    if (r.step > 0) {
      const Real spread = Real(3.6) * s.scatter;
      const Real step = r.step - (spread < r.step / 4 ? spread : r.step / 4);
      raise(t, name(s.rise < 0 ? 3 : 2), magnitude(s.rise), step, step);
    }
    if (t.holes < confirm_) return;
    if (r.limit > 0) raise(t, name(0), s.level, r.limit, warning_ * r.limit);
    // Of a torque or thrust that was not there, there is no multiple.
    if (r.ratio > 0 && t.taught >= teach_ && s.taught > 0)
      raise(t, name(1), s.level / s.taught, r.ratio, warning_ * r.ratio);
  }
  static void raise(Tool& t, WearRule rule, Real value, Real threshold, Real warning) noexcept {
    const MonitorState found = value >= threshold ? MonitorState::alarm
                               : value >= warning ? MonitorState::warning
                                                  : MonitorState::armed;
    if (found <= t.condition) return;
    t.condition = found;
    t.rule = rule;
    t.value = value;
    t.threshold = threshold;
    if (found == MonitorState::alarm) t.alarm_hole = t.holes;
  }

  // ---- evidence --------------------------------------------------------------------------------

  // Two slots: an alarm pins the present one, and recording goes on in the other.
  void begin_recording() noexcept {
    slot_ = pinned_ == 0 ? 1 : 0;
    before_[slot_] = core_;
    count_[slot_] = 0;
    recording_ = true;
  }
  void keep(const Part& part) noexcept {
    if (!recording_) return;
    if (count_[slot_] == KeptParts) {
      recording_ = false;
      return;
    }
    parts_[slot_][count_[slot_]++] = part;
  }
  void pin() noexcept {
    pinned_ = recording_ ? slot_ : kNone;
    recording_ = false;
  }

  Core core_;
  Sums sums_;
  State state_;
  Part part_;
  std::uint32_t stage_ = 0;
  bool recording_ = false;
  std::size_t slot_ = 0;
  std::size_t pinned_ = kNone;
  std::array<std::uint32_t, 2> count_{};
  std::array<Core, 2> before_{};
  std::array<std::array<Part, KeptParts>, 2> parts_{};

  FrictionDrift<Real> friction_;
  FrictionDrift<Real> spindle_;
  std::uint32_t part_samples_ = 80;
  std::uint32_t fewest_ = 60;
  Real part_s_ = 0;
  Real per_part_s_ = 0;
  Real direction_ = -1;
  Real thrust_level_ = 0;
  Real torque_level_ = 0;
  Real release_ = 0;
  Real fastest_ = 0;
  Real slowest_ = 0;
  Real turning_ = 0;
  Real steady_ = 0;
  Real feed_slack_ = 0;   // change of speed from part to part...
  Real speed_slack_ = 0;  // ...that takes half of the cutting level
  Real entry_m_ = 0;
  Real exit_m_ = 0;
  Real bucket_m_ = 0;
  Real shortest_m_ = 0;
  Real clearance_m_ = 0;
  Real peck_s_ = 0;
  Rules thrust_rules_;
  Rules torque_rules_;
  Real warning_ = 0;
  std::uint32_t teach_ = 10;
  std::uint32_t average_ = 10;
  std::uint32_t confirm_ = 2;
  bool off_ = true;
};

}  // namespace servosense
