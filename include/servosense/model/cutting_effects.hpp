// Catalogue of what a model of the milling process may lack.
//
// An effect is one small class here, one line in kCuttingEffects below, and its name and parameters
// in core/effect_keys.hpp. It says what it is and changes the tool of the model (model/milling.hpp)
// by them; what the sensor or the structure adds has no place in the tool and only says what it is.
// The names and keys are those of the machine file, [effect.<channel>.<name>].
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <string_view>

#include "servosense/model/effect.hpp"
#include "servosense/model/milling.hpp"

namespace servosense {

struct CuttingEffectInfo : EffectInfo {
  const char* channel = "tool";  ///< in the machine file
  const char* equation = "";
  const char* scope = "tool";  ///< machine, power-up, tool or record
  const char* where = "";      ///< coordinate in which the residual shows it
  const char* signature = "";
  const char* confused_with = "";
  const char* splitting_experiment = "";
};

struct EdgeForceEffect {
  static constexpr CuttingEffectInfo info{
      effect_info("edge-force"),
      "tool",
      "dFt += Kte dz, dFr += Kre dz",
      "tool",
      "tooth-angle",
      "a part of the force that does not fall with the feed; a step where a tooth enters or leaves",
      "size-effect",
      "the same cut at three feeds, the largest four times the smallest"};
  static void apply(std::span<const double> v, MillingTool& tool) {
    tool.force.tangential_edge_N_per_m += v[0];
    tool.force.radial_edge_N_per_m += v[1];
  }
};

struct SizeEffect {
  static constexpr CuttingEffectInfo info{
      effect_info("size-effect"),
      "tool",
      "Kt -> Kt (h/h0)^-m, h0 = 0.1 mm",
      "tool",
      "chip-thickness",
      "force grows more slowly than the feed and steeply where the chip is thin",
      "edge-force",
      "the same cut at three feeds, the largest four times the smallest"};
  static void apply(std::span<const double> v, MillingTool& tool) {
    tool.force.size_effect_exponent = v[0];
  }
};

/// The tool axis is off by `throw_m` toward `angle_rad`, counted from tooth 1 in the sense of
/// cutting.
struct RunoutEffect {
  static constexpr CuttingEffectInfo info{
      effect_info("runout"),
      "tool",
      "r_j += rho cos(psi_j - lambda)",
      "tool",
      "tooth",
      "teeth cut unequally in the pattern of a sine; fades with the feed",
      "missing-tooth (two teeth), pitch-error",
      "indicate the teeth in the standing spindle, or cut at two feeds"};
  static void apply(std::span<const double> v, MillingTool& tool) { add_offset(tool, v[0], v[1]); }
};

/// Broken: `fraction` of the edge is gone, from the tip up.
struct MissingToothEffect {
  static constexpr CuttingEffectInfo info{
      effect_info("missing-tooth"),
      "tool",
      "tooth j does not cut below fraction * depth; the next takes its chip",
      "tool",
      "tooth",
      "one tooth cuts less, the next by as much more",
      "runout (two teeth), pitch-error",
      "look at the teeth, or cut at two feeds and two depths"};
  static void apply(std::span<const double> v, MillingTool& tool) {
    tool.broken_fraction.resize(static_cast<std::size_t>(tool.teeth), 0.0);
    double& gone = tool.broken_fraction[static_cast<std::size_t>(v[0]) - 1];
    gone = gone < v[1] ? v[1] : gone;
  }
};

struct HelixLagEffect {
  static constexpr CuttingEffectInfo info{
      effect_info("helix-lag"),
      "tool",
      "a layer at height z lags by z tan(helix) / R",
      "tool",
      "tooth-angle",
      "teeth enter and leave less or more steeply, the more the deeper the cut",
      "angular zero, axial depth",
      "the same cut at two axial depths"};
  static void apply(std::span<const double> v, MillingTool& tool) { tool.helix_deg = v[0]; }
};

struct PitchErrorEffect {
  static constexpr CuttingEffectInfo info{
      effect_info("pitch-error"),
      "tool",
      "psi_j = 2 pi (j-1)/N + angle_j",
      "tool",
      "tooth",
      "teeth come unevenly in time, and with it cut unequal chips",
      "runout",
      "finer samples over the angle, so that the time of entry counts"};
  static void apply(std::span<const double> v, MillingTool& tool) {
    const auto teeth = static_cast<std::size_t>(tool.teeth);
    tool.tooth_angle_rad.resize(teeth, 0.0);
    for (std::size_t j = 0; j < teeth && j < v.size(); ++j)
      tool.tooth_angle_rad[j] = kTwoPi * static_cast<double>(j) / static_cast<double>(teeth) + v[j];
  }
};

struct ProcessDampingEffect {
  static constexpr CuttingEffectInfo info{effect_info("process-damping"),
                                          "tool",
                                          "dFr += Cp dz (normal speed) / (cutting speed)",
                                          "tool",
                                          "frequency",
                                          "vibration dies out faster at low cutting speed",
                                          "damping of the structure",
                                          "the same cut at two spindle speeds, with the "
                                          "displacement of the tool recorded"};
  static void apply(std::span<const double> v, MillingTool& tool) {
    tool.force.process_damping_N_per_m += v[0];
  }
};

struct RegenerationEffect {
  static constexpr CuttingEffectInfo info{
      effect_info("regeneration"),
      "tool",
      "h += n . (u(t) - u(t - tooth period))",
      "machine",
      "frequency",
      "force follows the difference of the tool's displacement over a tooth period",
      "extra-mode",
      "record the displacement of the tool; cut near the limit of stability"};
};

struct ExtraModeEffect {
  static constexpr CuttingEffectInfo info{effect_info("extra-mode"),
                                          "tool",
                                          "m u'' + 2 zeta w m u' + w^2 m u = F, h follows u",
                                          "machine",
                                          "frequency",
                                          "ringing while teeth cut, none in the air",
                                          "sensor-resonance",
                                          "tap test of tool and dynamometer"};
};

struct SensorResonanceEffect {
  static constexpr CuttingEffectInfo info{
      effect_info("sensor-resonance"),
      "dyno",
      "F measured = w^2 / (s^2 + 2 zeta w s + w^2) F",
      "machine",
      "frequency",
      "ringing after every entry and exit of a tooth, in the air as well",
      "extra-mode",
      "tap test of tool and dynamometer"};
};

// One line an effect.
inline constexpr std::array kCuttingEffects = {
    EdgeForceEffect::info,      SizeEffect::info,         RunoutEffect::info,
    MissingToothEffect::info,   HelixLagEffect::info,     PitchErrorEffect::info,
    ProcessDampingEffect::info, RegenerationEffect::info, ExtraModeEffect::info,
    SensorResonanceEffect::info};

/// nullptr when there is none of that name.
[[nodiscard]] constexpr const CuttingEffectInfo* find_cutting_effect(std::string_view name) {
  for (const CuttingEffectInfo& info : kCuttingEffects)
    if (name == info.name) return &info;
  return nullptr;
}

}  // namespace servosense
