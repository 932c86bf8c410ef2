// The map of one revolution to the next, for tools whose teeth are not all alike: unequal pitch,
// and process damping. What ToothPassMap is for equal teeth, at steps of equal length instead of
// intervals between entries and exits.
//
//   F(t) = (a Kt / 2) sum over teeth j of A_j(t) [u(t) - u(t - T_j)] - (a Cp / v) D(t) u'(t)
// T_j is the time since the tooth ahead of j passed the same place, A_j its directional
// coefficients, D = sum of n n^T with n the normal of the surface at each engaged tooth (the radial
// force Cp times normal speed over cutting speed v). Over a step A_j and D are their means, the
// deflection between steps at t - T_j is a cubic, the force is linear and implicit in its end, and
// the response of the modes to it is exact. Error of a multiplier: below 2e-3 of it with the steps
// that are chosen (compared with ToothPassMap on equal teeth). Altintas, Engin and Budak (1999)
// have the cut of unequal pitch; Insperger and Stepan (2004) the method.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "servosense/model/milling.hpp"
#include "servosense/model/structural_mode.hpp"
#include "tooth_pass_map.hpp"

namespace servosense {

/// Whether ToothPassMap does not hold for this tool.
[[nodiscard]] bool needs_revolution_map(const MillingTool& tool);

class RevolutionMap {
 public:
  RevolutionMap(const Structure& structure, const MillingTool& tool, const Engagement& engagement,
                double spindle_speed_rpm, double axial_depth_m);

  [[nodiscard]] std::size_t size() const { return 2 * modes_.size() + 2 * memory_; }
  [[nodiscard]] const std::vector<Oscillator>& modes() const { return modes_; }
  /// State: q and q'/wn of each mode, then the deflections (x, y) of the last steps, oldest first.
  void apply(const double* before, double* after) const;

 private:
  using Matrix2 = std::array<double, 4>;

  /// Of one mode, over one step.
  struct Response {
    Oscillator::Free free;
    double q_from_begin, q_from_end;  ///< per force at the step's begin and end
    double p_from_begin, p_from_end;
  };
  struct Tooth {
    std::size_t steps;               ///< whole steps of its delay
    std::array<double, 4> weight;    ///< of the deflections around it, newest first
    std::vector<Matrix2> stiffness;  ///< a Kt / 2 times A, over each step
    std::vector<bool> cuts;          ///< in each step
  };

  std::size_t steps_ = 0;   ///< of a revolution
  std::size_t memory_ = 0;  ///< steps that are remembered
  std::vector<Oscillator> modes_;
  std::vector<Response> response_;
  std::vector<Tooth> teeth_;
  std::vector<Matrix2> damping_;  ///< over each step, force per velocity
  std::vector<Matrix2> solve_;    ///< over each step: inverse of the implicit system
};

}  // namespace servosense
