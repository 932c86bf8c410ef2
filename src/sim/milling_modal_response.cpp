#include <algorithm>
#include <cmath>
#include <string>

#include "milling_pair.hpp"
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
    : modes_(std::max(structure.x.size(), structure.y.size())), x_modes_(structure.x.size()) {
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const auto& modes = axis == 0 ? structure.x : structure.y;
    for (std::size_t i = 0; i < modes.size(); ++i) {
      const StructuralMode& mode = modes[i];
      const double wn = mode.natural_frequency_rad_s();
      const double decay = mode.damping_ratio * wn;
      const double wd = wn * std::sqrt(1 - mode.damping_ratio * mode.damping_ratio);
      const double envelope = std::exp(-decay * step_s);
      const double c = envelope * std::cos(wd * step_s);
      const double s = envelope * std::sin(wd * step_s);
      ModePair& m = modes_[i];
      m.qq[axis] = c + decay / wd * s;
      m.qv[axis] = s / wd;
      m.vq[axis] = -wn * wn / wd * s;
      m.vv[axis] = c - decay / wd * s;
      m.q_per_N[axis] = (1 - m.qq[axis]) / mode.stiffness_N_per_m();
      m.v_per_N[axis] = m.qv[axis] / mode.modal_mass_kg;
      m.mass_kg[axis] = mode.modal_mass_kg;
    }
  }
}

const ModalResponse::Motion& ModalResponse::advance(double fx_N, double fy_N) {
  const Pair force = {fx_N, fy_N};
  Pair displacement{}, velocity{};
  for (ModePair& m : modes_) {
    const Pair q = pair_at(m.q), v = pair_at(m.v);
    const Pair q_new = pair_at(m.qq) * q + pair_at(m.qv) * v + pair_at(m.q_per_N) * force;
    const Pair v_new = pair_at(m.vq) * q + pair_at(m.vv) * v + pair_at(m.v_per_N) * force;
    pair_at(m.q) = q_new;
    pair_at(m.v) = v_new;
    displacement += q_new;
    velocity += v_new;
  }
  motion_ = {displacement[0], displacement[1], velocity[0], velocity[1]};
  return motion_;
}

void ModalResponse::strike(double x_N_s, double y_N_s) {
  const double blow_N_s[2] = {x_N_s, y_N_s};
  double* const velocity[2] = {&motion_.vx_m_s, &motion_.vy_m_s};
  for (ModePair& m : modes_) {
    for (std::size_t axis = 0; axis < 2; ++axis) {
      if (m.mass_kg[axis] == 0) continue;
      const double dv = blow_N_s[axis] / m.mass_kg[axis];
      m.v[axis] += dv;
      *velocity[axis] += dv;
    }
  }
}

}  // namespace servosense
