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
  const Motion& advance(double fx_N, double fy_N);

  /// A blow of the given momentum, as from an impact hammer.
  void strike(double x_N_s, double y_N_s);

  [[nodiscard]] const Motion& motion() const { return motion_; }
  /// State of mode `i` in the order of Structure: x modes first, then y.
  [[nodiscard]] ModeState mode(std::size_t i) const {
    const std::size_t axis = i < x_modes_ ? 0 : 1;
    const ModePair& m = modes_[i - axis * x_modes_];
    return {m.q[axis], m.v[axis]};
  }

 private:
  /// A mode of x beside one of y, so that one vector operation serves both. All zero: no mode.
  struct alignas(16) ModePair {
    double qq[2]{}, qv[2]{}, vq[2]{}, vv[2]{};  // Phi
    double q_per_N[2]{}, v_per_N[2]{};          // Gamma
    double q[2]{}, v[2]{};
    double mass_kg[2]{};
  };
  std::vector<ModePair> modes_;
  std::size_t x_modes_ = 0;
  Motion motion_;
};

}  // namespace servosense
