// The cutting coefficients beside a monitor stack: they hear what it has estimated, and its wear
// monitor hears what they have found.
//
// Purpose: once per servo period, behind the stack's process(): torque of the spindle, forces of x
// and y, motion of all, into CuttingCoefficients; its force ratio, once it is told, into the wear
// monitor of the stack, which has a rule for it (specific_force_ratio). Where the stack knows a
// program (monitors/expected_cut.hpp), depth and width are those of its engagement now.
// Cost on Cortex-M4F: that of cutting_coefficients, and the force ratio where a slot of cut ends.
// Delay, range, bounds: those of the parts. The wear monitor tells with its next sample.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "servosense/monitors/cutting_coefficients.hpp"
#include "servosense/monitors/monitor_stack.hpp"

namespace servosense {

template <RealNumber Real>
class CutBesideStack {
 public:
  using Coefficients = CuttingCoefficients<Real>;

  /// Requires Coefficients::validate(c).ok(). `tells_wear`: the stack's wear monitor is on.
  void configure(const CuttingCoefficientsConfig& c, bool tells_wear) noexcept {
    coefficients_.configure(c);
    tells_wear_ = tells_wear;
    reset();
  }
  /// Shares of each engagement of the program that the stack's torque band has; what it views must
  /// outlive its use. Then only cuts are heard of which the program has one, and air. Empty: every
  /// cut is that of the configuration, or of set_cut().
  void set_program(std::span<const CuttingShares> engagements) noexcept {
    program_ = engagements;
    engagement_ = kNone;
    hears_ = true;
  }
  void reset() noexcept {
    coefficients_.reset();
    engagement_ = kNone;
    hears_ = true;
    before_ = MonitorState::idle;
    slots_ = 0;
  }
  /// The sample that `stack` has just heard. True when the state has changed: `change` says how.
  template <typename Stack>
  bool process(Stack& stack, StateChange<Real>& change) SERVOSENSE_NONBLOCKING {
    if (!program_.empty() && !follows(stack.expected_cut())) return false;
    const auto& spindle = stack.spindle();
    const auto &x = stack.axis(0), &y = stack.axis(1);
    const MonitorState state = coefficients_.process(
        spindle.estimate, stack.spindle_way(), x.estimate, stack.axis_way(0), y.estimate,
        stack.axis_way(1), stack.axis_way(2), spindle.quality | x.quality | y.quality);
    const auto& now = coefficients_.state();
    if (now.slots != slots_) {
      slots_ = now.slots;
      if (tells_wear_) tell(stack.tool().wear());
    }
    if (state == before_) return false;
    change = {MonitorId::cutting_coefficients,
              Channel::tool,
              state,
              before_,
              now.value,
              now.threshold,
              static_cast<std::uint8_t>(now.verdict),
              0};
    before_ = state;
    return true;
  }

  [[nodiscard]] const Coefficients& coefficients() const noexcept { return coefficients_; }
  /// To tell of a new tool, or of a cut of another depth or width.
  [[nodiscard]] Coefficients& coefficients() noexcept { return coefficients_; }

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  // Whether this sample is heard.
  bool follows(const ExpectedCut<Real>* cut) noexcept {
    const bool steady =
        cut != nullptr && cut->kind == ExpectedCutKind::steady && cut->engagement < program_.size();
    const bool hears = steady || (cut != nullptr && cut->kind == ExpectedCutKind::air);
    if (hears && (!hears_ || (steady && cut->engagement != engagement_)))
      begin(steady ? cut->engagement : engagement_);
    return hears_ = hears;
  }
  // What is heard from now on does not go on from what was heard before.
  [[gnu::noinline]] void begin(std::size_t engagement) noexcept {
    engagement_ = engagement;
    if (engagement != kNone) coefficients_.set_cut(program_[engagement]);
  }
  template <typename Wear>
  [[gnu::noinline]] void tell(Wear& wear) noexcept {
    const auto ratio = coefficients_.force_ratio();
    if (ratio.told) wear.hear_cutting(ratio.value, ratio.error);
  }

  Coefficients coefficients_;
  std::span<const CuttingShares> program_;
  std::size_t engagement_ = kNone;  // that is heard, or was last
  bool hears_ = true;
  MonitorState before_ = MonitorState::idle;
  std::uint64_t slots_ = 0;
  bool tells_wear_ = false;
};

}  // namespace servosense
