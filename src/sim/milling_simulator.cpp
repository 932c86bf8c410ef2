#include "servosense/sim/milling_simulator.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "in_range.hpp"

namespace servosense {
namespace {

constexpr double kStepsPerVibration = 10;  // of the stiffest mode
constexpr double kStepsPerTooth = 20;
constexpr double kPointsPerPitch = 4;  // a tooth leaves its surface one point late
constexpr double kSmallestPitch_deg = 0.1;

double smallest_pitch_rad(const MillingTool& tool) {
  const std::vector<double>& angles = tool.tooth_angle_rad;
  if (angles.empty()) return kTwoPi / tool.teeth;
  double smallest = kTwoPi - angles.back();
  for (std::size_t i = 1; i < angles.size(); ++i)
    smallest = std::min(smallest, angles[i] - angles[i - 1]);
  return smallest;
}

Expected<Done> validate(const MillingTool& tool) {
  if (tool.teeth < 1) return usage_error("the tool has no teeth: give at least one");
  if (tool.teeth > 1000) return usage_error("the tool has more than 1000 teeth");
  if (!positive(tool.diameter_m)) return usage_error("the tool needs a diameter above zero");
  if (!(tool.helix_deg >= 0 && tool.helix_deg <= 80))
    return usage_error("the helix angle is outside 0 to 80 degrees");
  const auto teeth = static_cast<std::size_t>(tool.teeth);
  const auto wrong_count = [&](const std::vector<double>& values) {
    return !values.empty() && values.size() != teeth;
  };
  if (wrong_count(tool.throw_m) || wrong_count(tool.broken_fraction) ||
      wrong_count(tool.tooth_angle_rad))
    return usage_error("throw, broken fraction and tooth angle need one value for each of the " +
                       std::to_string(teeth) + " teeth, or none");
  for (const double r : tool.throw_m)
    if (!(std::abs(r) < tool.radius_m()))
      return usage_error("the throw of a tooth is not smaller than the radius of the tool");
  for (const double p : tool.broken_fraction)
    if (!(p >= 0 && p <= 1)) return usage_error("the broken fraction of a tooth is outside 0 to 1");
  for (std::size_t i = 0; i < tool.tooth_angle_rad.size(); ++i) {
    const double last = i == 0 ? 0.0 : tool.tooth_angle_rad[i - 1];
    const double angle = tool.tooth_angle_rad[i];
    if (i == 0 ? angle != 0 : !(angle > last && angle < kTwoPi))
      return usage_error(
          "tooth angles must ascend from 0 and stay below one turn, ahead of tooth 1");
  }
  if (smallest_pitch_rad(tool) < rad_from_deg(kSmallestPitch_deg))
    return usage_error("tooth angles must be at least 0.1 degrees apart");
  const CuttingForceLaw& law = tool.force;
  if (!positive(law.tangential_coefficient_N_per_m2))
    return usage_error("the tangential cutting coefficient must be above zero");
  if (!not_negative(law.radial_ratio) || !not_negative(law.tangential_edge_N_per_m) ||
      !not_negative(law.radial_edge_N_per_m) || !not_negative(law.process_damping_N_per_m))
    return usage_error("radial ratio, edge coefficients and process damping cannot be negative");
  if (!std::isfinite(law.axial_coefficient_N_per_m2) || !std::isfinite(law.axial_edge_N_per_m))
    return usage_error("the axial coefficients must be finite");
  if (!(law.size_effect_exponent >= 0 && law.size_effect_exponent < 1) ||
      !positive(law.size_effect_reference_m))
    return usage_error(
        "the size effect needs an exponent from 0 to below 1 and a reference chip "
        "thickness above zero");
  return Done{};
}

Expected<Done> validate(const MillingCut& cut, const MillingTool& tool, bool wedge) {
  if (!positive(cut.spindle_speed_rpm)) return usage_error("the spindle speed must be above zero");
  if (!positive(cut.feed_per_tooth_m)) return usage_error("the feed per tooth must be above zero");
  if (!(cut.feed_per_tooth_m * tool.teeth < tool.radius_m()))
    return usage_error("the feed per revolution is not smaller than the radius of the tool");
  if (!wedge && !positive(cut.axial_depth_m))
    return usage_error("the axial depth of cut must be above zero");
  if (cut.direction != MillingDirection::slot) {
    if (!positive(cut.radial_immersion_m))
      return usage_error("the radial immersion must be above zero");
    if (cut.radial_immersion_m > tool.diameter_m)
      return usage_error(
          "the radial immersion is above the diameter of the tool: give at most the "
          "diameter");
  }
  return Done{};
}

std::string in_microseconds(double seconds) {
  std::string text = std::to_string(seconds * 1e6);
  return text.substr(0, text.find('.') + 3) + " us";
}

/// A force that is held for a step acts half a step late at worst; ten steps a vibration of the
/// structure stiffened by the cut keep that harmless, and far from the limit of stability.
Expected<Done> validate_step(const MillingSimulation& s, double depth_m, double fastest_rpm) {
  if (!positive(s.step_s)) return usage_error("the step must be above zero");
  const CuttingForceLaw& law = s.tool.force;
  const double per_tooth = 60 / (fastest_rpm * s.tool.teeth) / kStepsPerTooth;
  double longest = per_tooth;
  std::string reason = "20 steps for each tooth that passes";
  const double stiffness =
      law.tangential_coefficient_N_per_m2 * (1 + law.radial_ratio) * depth_m * s.tool.teeth;
  for (const auto* axis : {&s.structure.x, &s.structure.y}) {
    for (const StructuralMode& mode : *axis) {
      const double wn = mode.natural_frequency_rad_s();
      const double w = std::sqrt(wn * wn + stiffness / mode.modal_mass_kg);
      if (kTwoPi / w / kStepsPerVibration < longest) {
        longest = kTwoPi / w / kStepsPerVibration;
        reason = "10 steps for each vibration of the stiffest mode in the cut";
      }
      const double damper = law.process_damping_N_per_m * depth_m * s.tool.teeth;
      const double speed = rad_s_from_rpm(fastest_rpm) * s.tool.radius_m();
      if (damper > 0 && mode.modal_mass_kg * speed / damper < longest) {
        longest = mode.modal_mass_kg * speed / damper;
        reason = "steps shorter than the process damping takes to stop the lightest mode";
      }
    }
  }
  if (s.step_s > longest)
    return usage_error("the step of " + in_microseconds(s.step_s) + " is too long: the cut needs " +
                       reason + ", at most " + in_microseconds(longest));
  return Done{};
}

double greatest_depth(const MillingSimulation& s) {
  return s.workpiece.is_wedge() ? std::max(s.workpiece.front_depth_m, s.workpiece.far_depth_m)
                                : s.cut.axial_depth_m;
}

/// The trochoid crosses its neighbour half a feed behind the axis: teeth cut that much earlier at
/// the wall of up milling, that much longer at the wall of down milling.
Engagement engagement_window(const MillingSimulation& s) {
  Engagement window = engagement_of(s.tool, s.cut);
  if (!s.trochoidal_path) return window;
  const double beyond = std::asin(s.cut.feed_per_tooth_m / s.tool.diameter_m);
  if (s.cut.direction != MillingDirection::down) window.start_rad -= beyond;
  if (s.cut.direction != MillingDirection::up) window.exit_rad += beyond;
  return window;
}

}  // namespace

Expected<MillingSimulator> MillingSimulator::create(const MillingSimulation& simulation) {
  MillingSimulation s = simulation;
  if (auto ok = validate(s.tool); !ok) return ok.error();
  if (auto ok = servosense::validate(s.workpiece); !ok) return ok.error();
  if (auto ok = validate(s.cut, s.tool, s.workpiece.is_wedge()); !ok) return ok.error();
  if (auto ok = ModalResponse::validate(s.structure); !ok) return ok.error();
  if (auto ok = s.speed.validate(); !ok) return ok.error();
  if (s.layers < 1 || s.layers > 10000) return usage_error("layers must be from 1 to 10000");
  if (s.surface_points < 64 || s.surface_points > 1000000)
    return usage_error("surface points must be from 64 to 1000000");
  if (!not_negative(s.clearance_m) || !std::isfinite(s.start_position_m) ||
      !std::isfinite(s.start_angle_rad))
    return usage_error("clearance must not be negative, start position and angle must be numbers");
  if (!not_negative(s.wall_spacing_m))
    return usage_error("the spacing of the wall profile must not be negative");
  for (const ToothBreak& b : s.breaks)
    if (b.tooth < 1 || b.tooth > s.tool.teeth || !(b.fraction >= 0 && b.fraction <= 1) ||
        !std::isfinite(b.time_s))
      return usage_error("a tooth break needs a tooth from 1 to " + std::to_string(s.tool.teeth) +
                         ", a fraction from 0 to 1 and a time");

  if (s.speed.points.empty()) s.speed = SpindleSpeedProfile::constant(s.cut.spindle_speed_rpm);
  const auto by_speed = [](const auto& a, const auto& b) { return a.speed_rpm < b.speed_rpm; };
  const auto [slowest, fastest] =
      std::minmax_element(s.speed.points.begin(), s.speed.points.end(), by_speed);
  const double depth = greatest_depth(s);
  if (auto ok = validate_step(s, depth, fastest->speed_rpm); !ok) return ok.error();
  for (const double height : s.wall_heights_m)
    if (!(height >= 0 && height <= depth))
      return usage_error("a height of the wall profile is outside the axial depth of cut");

  const double steps_per_turn = 60 / (slowest->speed_rpm * s.step_s);
  s.surface_points = static_cast<int>(
      std::max(std::min<double>(s.surface_points, std::max(64.0, std::ceil(steps_per_turn))),
               std::ceil(kPointsPerPitch * kTwoPi / smallest_pitch_rad(s.tool))));
  std::stable_sort(s.breaks.begin(), s.breaks.end(),
                   [](const ToothBreak& a, const ToothBreak& b) { return a.time_s < b.time_s; });
  if (s.wall_heights_m.empty()) s.wall_heights_m = {depth / 2};
  if (s.wall_spacing_m == 0) s.wall_spacing_m = s.cut.feed_per_tooth_m / 40;
  return MillingSimulator(s);
}

MillingSimulator::MillingSimulator(const MillingSimulation& simulation)
    : simulation_(simulation),
      depth_m_(greatest_depth(simulation)),
      feed_per_rad_m_(simulation.cut.feed_per_tooth_m * simulation.tool.teeth / kTwoPi),
      radius_m_(simulation.tool.radius_m()),
      endless_(simulation.workpiece.is_endless()),
      window_(engagement_window(simulation)),
      structure_(simulation.structure, simulation.step_s) {
  const MillingSimulation& s = simulation_;
  now_.angle_rad = s.start_angle_rad;
  now_.feed_m = s.start == MillingStart::entry ? first_contact_m(radius_m_, window_) - s.clearance_m
                                               : s.start_position_m;
  LayeredCut::Config cut;
  cut.tool = s.tool;
  cut.window = window_;
  cut.feed_per_tooth_m = s.cut.feed_per_tooth_m;
  cut.depth_m = depth_m_;
  cut.wedge = s.workpiece.is_wedge();
  cut.front_depth_m = s.workpiece.front_depth_m;
  if (cut.wedge)
    cut.depth_slope = (s.workpiece.far_depth_m - s.workpiece.front_depth_m) / s.workpiece.length_m;
  cut.layers = s.layers;
  cut.rows = s.surface_points;
  cut.trochoidal = s.trochoidal_path;
  for (const ToothBreak& b : s.breaks) cut.break_fractions.push_back(b.fraction);
  cut_ = LayeredCut(cut, now_.angle_rad, now_.feed_m);

  wall_ = MachinedSurface(
      {s.tool, s.cut.direction, s.wall_heights_m, s.wall_spacing_m, now_.feed_m, s.wall_points});
  for (std::size_t i = 0; i < s.tool.broken_fraction.size(); ++i)
    wall_.break_tooth(i, depth_m_ * s.tool.broken_fraction[i]);
  wall_.advance(now_.angle_rad, now_.feed_m, 0);
  arcs_ = endless_ ? std::vector<Engagement>{window_}
                   : engagement_arcs(s.workpiece, radius_m_, window_, now_.feed_m);
  arcs_at_m_ = now_.feed_m;
}

const MillingStep& MillingSimulator::step() {
  const double middle_s = now_.t_s + simulation_.step_s / 2;
  const auto& points = simulation_.speed.points;
  return step(rad_s_from_rpm(points.size() == 1 ? points.front().speed_rpm
                                                : simulation_.speed.speed_rpm(middle_s)));
}

const MillingStep& MillingSimulator::step(double spindle_speed_rad_s) {
  return step(spindle_speed_rad_s, feed_per_rad_m_ * spindle_speed_rad_s);
}

const MillingStep& MillingSimulator::step(double spindle_speed_rad_s, double feed_m_s) {
  const double h = simulation_.step_s;
  while (next_break_ < simulation_.breaks.size() &&
         simulation_.breaks[next_break_].time_s <= now_.t_s + h / 2) {
    const ToothBreak& b = simulation_.breaks[next_break_++];
    cut_.break_tooth(static_cast<std::size_t>(b.tooth - 1), b.fraction);
    wall_.break_tooth(static_cast<std::size_t>(b.tooth - 1), depth_m_ * b.fraction);
  }

  const double half_turn = spindle_speed_rad_s * h / 2;
  const double half_feed = feed_m_s * h / 2;
  // Engagement follows the feed in steps that are small against the feed per tooth.
  if (!endless_ && now_.feed_m + half_feed - arcs_at_m_ > simulation_.cut.feed_per_tooth_m / 128) {
    arcs_at_m_ = now_.feed_m + half_feed;
    arcs_ = engagement_arcs(simulation_.workpiece, radius_m_, window_, arcs_at_m_);
  }

  LayeredCut::Axis middle{now_.feed_m + half_feed + now_.x_m + now_.vx_m_s * h / 2,
                          now_.y_m + now_.vy_m_s * h / 2, now_.vx_m_s, now_.vy_m_s};
  if (!simulation_.cut.regeneration) {
    middle.forgotten_x_m = now_.x_m + now_.vx_m_s * h / 2;
    middle.forgotten_y_m = middle.y_m;
  }
  LayeredCut::Load load;
  if (!lost_)
    load = cut_.advance(half_turn_rad_ + half_turn, 2 * half_turn, middle,
                        spindle_speed_rad_s * radius_m_, arcs_);
  half_turn_rad_ = half_turn;
  const ModalResponse::Motion& motion = structure_.advance(load.fx_N, load.fy_N);

  ++steps_;
  now_.t_s = static_cast<double>(steps_) * h;
  now_.angle_rad += 2 * half_turn;
  now_.feed_m += 2 * half_feed;
  now_.spindle_speed_rad_s = spindle_speed_rad_s;
  now_.fx_N = load.fx_N;
  now_.fy_N = load.fy_N;
  now_.fz_N = load.fz_N;
  now_.torque_Nm = load.torque_Nm;
  now_.teeth_in_cut = load.teeth_in_cut;
  now_.x_m = motion.x_m;
  now_.y_m = motion.y_m;
  now_.vx_m_s = motion.vx_m_s;
  now_.vy_m_s = motion.vy_m_s;
  lost_ = lost_ || !(std::max(std::abs(now_.x_m), std::abs(now_.y_m)) < radius_m_ / 4);
  if (!lost_) wall_.advance(now_.angle_rad, now_.feed_m + now_.x_m, now_.y_m);
  return now_;
}

Expected<Done> MillingSimulator::run(double duration_s, double rate_hz, Decimation decimation,
                                     const std::function<void(const MillingStep&)>& sample) {
  const auto count = static_cast<std::size_t>(std::llround(duration_s / simulation_.step_s));
  const double samples_per_step = std::min(rate_hz * simulation_.step_s, 1.0);
  MillingStep sum;
  double steps = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto period = std::floor(static_cast<double>(steps_) * samples_per_step + 1e-9);
    const MillingStep& s = step();
    if (lost_)
      return data_error("after " + std::to_string(s.t_s) +
                        " s the tool vibrates by more than a quarter of its radius: the cut is far "
                        "beyond its stability limit, take a smaller depth");
    steps += 1;
    sum.spindle_speed_rad_s += s.spindle_speed_rad_s;
    sum.fx_N += s.fx_N;
    sum.fy_N += s.fy_N;
    sum.fz_N += s.fz_N;
    sum.torque_Nm += s.torque_Nm;
    sum.x_m += s.x_m;
    sum.y_m += s.y_m;
    sum.vx_m_s += s.vx_m_s;
    sum.vy_m_s += s.vy_m_s;
    sum.teeth_in_cut = std::max(sum.teeth_in_cut, s.teeth_in_cut);
    if (std::floor(static_cast<double>(steps_) * samples_per_step + 1e-9) == period) continue;
    if (decimation == Decimation::last) {
      sample(s);
    } else {
      for (double* mean : {&sum.spindle_speed_rad_s, &sum.fx_N, &sum.fy_N, &sum.fz_N,
                           &sum.torque_Nm, &sum.x_m, &sum.y_m, &sum.vx_m_s, &sum.vy_m_s})
        *mean /= steps;
      sum.t_s = s.t_s;
      sum.angle_rad = s.angle_rad;
      sum.feed_m = s.feed_m;
      sample(sum);
    }
    sum = {};
    steps = 0;
  }
  return Done{};
}

Expected<std::vector<MillingStep>> MillingSimulator::run(double duration_s, double rate_hz,
                                                         Decimation decimation) {
  std::vector<MillingStep> samples;
  if (auto done =
          run(duration_s, rate_hz, decimation, [&](const MillingStep& s) { samples.push_back(s); });
      !done)
    return done.error();
  return samples;
}

}  // namespace servosense
