// What is known of a tool over its holes, and the rules that call it worn (wear.hpp has the
// equations).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/wear_config.hpp"

namespace servosense {

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
  specific_force_ratio,
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
    case WearRule::specific_force_ratio:
      return "specific cutting force against that of the new tool";
  }
  return "";
}

/// Unit of the value and threshold that the rule compares.
[[nodiscard]] constexpr const char* unit_of(WearRule rule) noexcept {
  switch (rule) {
    case WearRule::none:
    case WearRule::thrust_ratio:
    case WearRule::torque_ratio:
    case WearRule::specific_force_ratio:
      return "";
    case WearRule::torque_limit:
    case WearRule::torque_rise:
    case WearRule::torque_drop:
      return "Nm";
    default:
      return "N";
  }
}

/// One of the two signals of a tool, over its holes.
template <RealNumber Real>
struct WearTrend {
  static constexpr std::size_t kHoles = kWearHolesKept;
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
  Real force_ratio = 0;  ///< of the specific cutting force, as heard last; 0: not yet...
  Real force_error = 0;  ///< ...and its standard error
};

/// Limit, ratio and step of thrust and torque, applied hole by hole.
template <RealNumber Real>
class WearRules {
 public:
  using Trend = WearTrend<Real>;
  using Tool = WearTool<Real>;

  /// Requires validate(c).ok().
  void configure(const WearConfig& c) noexcept {
    auto real = [](double x) { return static_cast<Real>(x); };
    thrust_ = {real(c.thrust_limit_N), real(c.thrust_ratio), real(c.thrust_step_N)};
    torque_ = {real(c.torque_limit_Nm), real(c.torque_ratio), real(c.torque_step_Nm)};
    force_ratio_ = real(c.specific_force_ratio);
    warning_ = real(c.warning_fraction);
    teach_ = c.teach_holes;
    average_ = c.average_holes;
    confirm_ = c.confirm_holes;
  }
  /// There is no rule.
  [[nodiscard]] bool none() const noexcept { return !(of_holes() || force_ratio_ > 0); }
  /// What a rule compares with is known of the tool.
  [[nodiscard]] bool taught(const Tool& t) const noexcept {
    return (of_holes() && t.taught >= teach_) || t.force_ratio > 0;
  }
  /// Holes that a new tool is taught on.
  [[nodiscard]] std::uint32_t teach_holes() const noexcept { return teach_; }

  /// Mean thrust and torque of the tool's next hole.
  void judge(Tool& t, Real thrust_N, Real torque_Nm) const noexcept {
    if (t.holes < 0xffffffffU) ++t.holes;
    const bool teaching = t.taught < teach_;
    if (teaching) ++t.taught;
    add(t.thrust, thrust_N, t, teaching);
    add(t.torque, torque_Nm, t, teaching);
    t.next = t.next + 1 == Trend::kHoles ? 0 : t.next + 1;
    rule(t, t.thrust, thrust_, WearRule::thrust_limit);
    rule(t, t.torque, torque_, WearRule::torque_limit);
  }

  /// Specific cutting force over that of the new tool, and its standard error: the lower end of
  /// its 95 % interval is held against the rule.
  void judge_cutting(Tool& t, Real ratio, Real error) const noexcept {
    t.force_ratio = ratio;
    t.force_error = error;
    if (force_ratio_ > 0)
      raise(t, WearRule::specific_force_ratio, ratio - kSure * error, force_ratio_,
            Real(1) + warning_ * (force_ratio_ - Real(1)));
  }

 private:
  static constexpr Real kSure = Real(1.96);
  [[nodiscard]] bool of_holes() const noexcept { return thrust_.any() || torque_.any(); }

  struct Rules {
    Real limit = 0, ratio = 0, step = 0;
    [[nodiscard]] bool any() const noexcept { return limit > 0 || ratio > 0 || step > 0; }
  };

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
      raise(t, name(s.rise < 0 ? 3 : 2), (s.rise < 0 ? -s.rise : s.rise), step, step);
    }
    if (t.holes < confirm_) return;
    if (r.limit > 0) raise(t, name(0), s.level, r.limit, warning_ * r.limit);
    // Of a torque or thrust that was not there, there is no multiple.
    if (r.ratio > 0 && t.taught >= teach_ && s.taught > 0)
      raise(t, name(1), s.level / s.taught, r.ratio, Real(1) + warning_ * (r.ratio - Real(1)));
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

  Rules thrust_;
  Rules torque_;
  Real force_ratio_ = 0;
  Real warning_ = 0;
  std::uint32_t teach_ = 10;
  std::uint32_t average_ = 10;
  std::uint32_t confirm_ = 2;
};

}  // namespace servosense
