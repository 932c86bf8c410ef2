// Motion of a structure, mode by mode, under a force that is constant over each step.
//
//   q'' + 2 zeta w q' + w^2 q = F / m        x = sum of q over the modes of x, y likewise
//   [q v](t+h) = Phi [q v](t) + Gamma F      Phi, Gamma exact for constant F (zero-order hold)
//
// The source integrates with semi-implicit Euler (Koike 2016, 2.5; Tarng 1988, eq. 3-18 to 3-23),
// stable only for w h < 2 (sqrt(1 + zeta^2) - zeta) and with a frequency error of (w h)^2/24. The
// exact step costs the same six multiplications a mode, is stable for every h and leaves the force,
// not the structure, to decide how short a step must be.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/structural_mode.hpp"

namespace servosense {

class ModalResponse {
 public:
  struct Motion {
    double x_m = 0, y_m = 0;
    double vx_m_s = 0, vy_m_s = 0;
  };
  struct ModeState {
    double displacement_m = 0;
    double velocity_m_s = 0;
  };

  /// Masses and frequencies above zero, damping ratio in [0, 1).
  [[nodiscard]] static Expected<Done> validate(const Structure& structure);

  ModalResponse() = default;
  /// For a valid structure. An axis without modes is rigid.
  ModalResponse(const Structure& structure, double step_s);

  /// Moves on by one step under the force on the tool.
  const Motion& advance(double fx_N, double fy_N) {
    const auto move = [this](std::size_t from, std::size_t to, double force, double& q, double& v) {
      double displacement = 0, velocity = 0;
      for (std::size_t i = from; i < to; ++i) {
        Mode& m = modes_[i];
        const ModeState s = m.state;
        m.state.displacement_m =
            m.qq * s.displacement_m + m.qv * s.velocity_m_s + m.q_per_N * force;
        m.state.velocity_m_s = m.vq * s.displacement_m + m.vv * s.velocity_m_s + m.v_per_N * force;
        displacement += m.state.displacement_m;
        velocity += m.state.velocity_m_s;
      }
      q = displacement;
      v = velocity;
    };
    move(0, x_modes_, fx_N, motion_.x_m, motion_.vx_m_s);
    move(x_modes_, modes_.size(), fy_N, motion_.y_m, motion_.vy_m_s);
    return motion_;
  }

  /// A blow of the given momentum, as from an impact hammer.
  void strike(double x_N_s, double y_N_s);

  [[nodiscard]] const Motion& motion() const { return motion_; }
  /// State of mode `i` in the order of Structure: x modes first, then y.
  [[nodiscard]] const ModeState& mode(std::size_t i) const { return modes_[i].state; }

 private:
  struct Mode {
    double qq = 1, qv = 0, vq = 0, vv = 1;  // Phi
    double q_per_N = 0, v_per_N = 0;        // Gamma
    double mass_kg = 0;
    ModeState state;
  };
  std::vector<Mode> modes_;
  std::size_t x_modes_ = 0;
  Motion motion_;
};

}  // namespace servosense
