// The cut that the numbers of a fit stand for.
#include <array>
#include <cmath>

#include "reconcile/cut/fit.hpp"
#include "servosense/core/units.hpp"

namespace servosense::reconcile {
namespace {

using enum Unknown::Kind;

void throw_axis(MillingTool& tool, double x_m, double y_m) {
  RunoutEffect::apply(std::array{std::hypot(x_m, y_m), std::atan2(y_m, x_m)}, tool);
}

/// Where the chip ends, or begins, at its thickest: straight teeth leave the cut or enter it there
/// at once. With the zero counted from that step a change of the immersion leaves it in its place;
/// otherwise the two are tied to a valley as narrow as a sample.
double thick_end_rad(const CutState& state) {
  const Engagement arc = engagement_of(state);
  return state.cut.direction == MillingDirection::up ? arc.exit_rad : arc.start_rad;
}

}  // namespace

CutState CutFitter::state_at(const std::vector<Unknown>& unknowns,
                             const std::vector<double>& values, bool edges) const {
  CutState s = given_;
  s.edges = s.edges || edges;
  double throw_x_m = 0, throw_y_m = 0;
  const auto teeth = static_cast<std::size_t>(s.tool.teeth);
  SensorMode sensor;
  StructuralMode mode;
  std::size_t mode_axis = 2;
  for (std::size_t i = 0; i < unknowns.size(); ++i) {
    const Unknown& u = unknowns[i];
    const double v = values[i];
    switch (u.kind) {
      case zero:
        s.zero_rad = v;
        break;
      case immersion:
        s.immersion_scale = v;
        break;
      case lag:
        s.lag_scale = v;
        break;
      case helix:
        s.tool.helix_deg = v;
        s.lag_scale = 1;
        break;
      case exponent:
        s.tool.force.size_effect_exponent = v;
        break;
      case throw_x:
        throw_x_m = v * feed_m_;
        break;
      case throw_y:
        throw_y_m = v * feed_m_;
        break;
      case shorter:
        s.tool.throw_m.resize(teeth, 0.0);
        s.tool.throw_m[u.index] -= v * feed_m_;
        break;
      case broken:
        s.tool.broken_fraction.resize(teeth, 0.0);
        s.tool.broken_fraction[u.index] = std::max(s.tool.broken_fraction[u.index], v);
        break;
      case pitch:
        if (s.tool.tooth_angle_rad.empty())
          for (std::size_t j = 0; j < teeth; ++j)
            s.tool.tooth_angle_rad.push_back(kTwoPi * static_cast<double>(j) /
                                             static_cast<double>(teeth));
        s.tool.tooth_angle_rad[u.index] += v;
        break;
      case sensor_hz:
        sensor.natural_frequency_hz[u.index] = std::exp(v);
        break;
      case sensor_damping:
        sensor.damping_ratio[u.index] = std::exp(v);
        break;
      case offset_x:
        s.offset_N[0] = v;
        break;
      case offset_y:
        s.offset_N[1] = v;
        break;
      case damping:
        s.tool.force.process_damping_N_per_m = v * 1e-3 * given_.coefficients[0];
        break;
      case mode_hz:
        mode.natural_frequency_hz = std::exp(v);
        mode_axis = u.index;
        break;
      case mode_damping:
        mode.damping_ratio = std::exp(v);
        break;
      case mode_mass:
        mode.modal_mass_kg = std::exp(v);
        break;
    }
  }
  if (steep()) s.zero_rad += thick_end_rad(s) - thick_end_rad(given_);
  if (throw_x_m != 0 || throw_y_m != 0) throw_axis(s.tool, throw_x_m, throw_y_m);
  if (sensor.natural_frequency_hz[0] > 0) s.sensor = sensor;
  if (mode_axis < 2) modes_along(s, mode_axis).push_back(mode);
  return s;
}

}  // namespace servosense::reconcile
