#include <cmath>
#include <string>

#include "servosense/sim/modal_response.hpp"

namespace servosense {
namespace {

Expected<Done> validate_axis(const std::vector<StructuralMode>& modes, const std::string& axis) {
  for (std::size_t i = 0; i < modes.size(); ++i) {
    const std::string where = "mode " + std::to_string(i + 1) + " of axis " + axis;
    if (!(modes[i].modal_mass_kg > 0) || !std::isfinite(modes[i].modal_mass_kg))
      return usage_error(where + " has a modal mass that is not above zero");
    if (!(modes[i].natural_frequency_hz > 0) || !std::isfinite(modes[i].natural_frequency_hz))
      return usage_error(where + " has a natural frequency that is not above zero");
    if (!(modes[i].damping_ratio >= 0 && modes[i].damping_ratio < 1))
      return usage_error(where + " has a damping ratio outside 0 to 1");
  }
  return Done{};
}

}  // namespace

Expected<Done> ModalResponse::validate(const Structure& structure) {
  if (auto x = validate_axis(structure.x, "x"); !x) return x.error();
  return validate_axis(structure.y, "y");
}

ModalResponse::ModalResponse(const Structure& structure, double step_s)
    : x_modes_(structure.x.size()) {
  for (const auto* axis : {&structure.x, &structure.y}) {
    for (const StructuralMode& mode : *axis) {
      const double wn = mode.natural_frequency_rad_s();
      const double decay = mode.damping_ratio * wn;
      const double wd = wn * std::sqrt(1 - mode.damping_ratio * mode.damping_ratio);
      const double envelope = std::exp(-decay * step_s);
      const double c = envelope * std::cos(wd * step_s);
      const double s = envelope * std::sin(wd * step_s);
      Mode m;
      m.qq = c + decay / wd * s;
      m.qv = s / wd;
      m.vq = -wn * wn / wd * s;
      m.vv = c - decay / wd * s;
      m.q_per_N = (1 - m.qq) / mode.stiffness_N_per_m();
      m.v_per_N = m.qv / mode.modal_mass_kg;
      m.mass_kg = mode.modal_mass_kg;
      modes_.push_back(m);
    }
  }
}

void ModalResponse::strike(double x_N_s, double y_N_s) {
  for (std::size_t i = 0; i < modes_.size(); ++i) {
    const bool along_x = i < x_modes_;
    const double dv = (along_x ? x_N_s : y_N_s) / modes_[i].mass_kg;
    modes_[i].state.velocity_m_s += dv;
    (along_x ? motion_.vx_m_s : motion_.vy_m_s) += dv;
  }
}

}  // namespace servosense
