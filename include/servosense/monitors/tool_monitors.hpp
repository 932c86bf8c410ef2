// The monitors of the tool: those that need several drives at once, or the teeth.
//
// Purpose: AR breakage and tooth breakage from the spindle torque (or tooth breakage from the
// lateral forces), drill fracture from the lateral forces and thrust, wear from thrust and torque,
// on one sample of the whole machine. Only those that are on cost anything. Delay, range, bounds:
// those of the blocks.
// Cost on Cortex-M4F: bench/firmware/instructions.csv, tool_monitors.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/fast_math.hpp"
#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/core/status.hpp"
#include "servosense/monitors/ar_breakage.hpp"
#include "servosense/monitors/drill_fracture.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/program_progress.hpp"
#include "servosense/monitors/tooth_breakage.hpp"
#include "servosense/monitors/torque_band.hpp"
#include "servosense/monitors/wear.hpp"

namespace servosense {

struct ToolMonitorsConfig {
  bool ar_breakage_on = false;
  bool tooth_breakage_on = false;  ///< on the torque when tooth_breakage.torque, else on x and y
  bool drill_fracture_on = false;
  bool wear_on = false;
  bool torque_band_on = false;  ///< needs a reference, and start() where the program begins
  /// Drill fracture, with its observers of x and y, and wear with the torque band take turns, each
  /// at half the servo rate: their sample_period_s, and that of the tool_observers, is twice the
  /// servo period. Not with tooth breakage on x and y.
  bool half_rate = false;
  ArBreakageConfig ar_breakage;
  ToothBreakageConfig tooth_breakage;
  DrillFractureConfig drill_fracture;
  WearConfig wear;
  TorqueBandConfig torque_band;
  double torque_band_advance = 125e-6;  ///< of time in a period [s]; in two at half rate

  /// Whether x and y must be watched at a high cutoff.
  [[nodiscard]] bool needs_lateral_forces() const noexcept {
    return drill_fracture_on || (tooth_breakage_on && !tooth_breakage.torque);
  }
};

/// The machine at one servo instant, as the tool feels it.
template <RealNumber Real>
struct ToolSample {
  Real torque_Nm = 0;        ///< of the spindle, high cutoff
  Real level_torque_Nm = 0;  ///< of the spindle, as reported
  Real turn_angle_rad = 0;
  const SineCosine<Real>* turn = nullptr;  ///< of turn_angle_rad, when known
  Real increment_rad = 0;
  Quality spindle = Quality::good;
  Real force_x_N = 0;  ///< high cutoff
  Real force_y_N = 0;
  Quality lateral = Quality::good;
  Real thrust_N = 0;  ///< of z, as reported
  Real feed_m = 0;    ///< motion of z since the last sample
  Quality thrust = Quality::good;
  std::array<Real, kAxes> way_m{};  ///< motion of the axes since the torque band was last heard
  Nanoseconds t_ns = 0;
  std::int32_t nc_block = kNoBlock;
  Real feed_override = 1;
};

/// MaxTeeth: capacity of the breakage monitors.
template <RealNumber Real, std::size_t MaxTeeth>
class ToolMonitors {
 public:
  using Config = ToolMonitorsConfig;
  using Ar = ArBreakageMonitor<Real, MaxTeeth>;
  using Tooth = ToothBreakageMonitor<Real, MaxTeeth>;
  using Drill = DrillFractureMonitor<Real, 512, 1280>;
  using Wear = WearMonitor<Real>;
  using Band = TorqueBandMonitor<Real>;
  static constexpr std::size_t kMonitors = 5;
  static constexpr double kGrains = 16;  ///< of path in a step of the torque band

  static Status validate(const Config& c) noexcept {
    if (c.ar_breakage_on)
      if (const Status s = Ar::validate(c.ar_breakage); !s.ok()) return s;
    if (c.tooth_breakage_on)
      if (const Status s = Tooth::validate(c.tooth_breakage); !s.ok()) return s;
    if (c.drill_fracture_on)
      if (const Status s = Drill::validate(c.drill_fracture); !s.ok()) return s;
    if (c.half_rate && c.tooth_breakage_on && !c.tooth_breakage.torque)
      return Status::invalid("half_rate", "must be off with tooth breakage on x and y");
    if (c.wear_on)
      if (const Status s = Wear::validate(c.wear); !s.ok()) return s;
    if (c.torque_band_on) {
      if (const Status s = Band::validate(c.torque_band); !s.ok()) return s;
      if (!(c.torque_band_advance > 0))
        return Status::invalid("torque_band_advance", "must be positive");
    }
    return {};
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    on_ = {c.ar_breakage_on, c.tooth_breakage_on, c.drill_fracture_on, c.wear_on, c.torque_band_on};
    torque_ = c.tooth_breakage.torque;
    follows_ = on_.ar && on_.tooth && torque_ && c.ar_breakage.teeth == c.tooth_breakage.teeth;
    if (on_.ar) ar_.configure(c.ar_breakage);
    if (on_.tooth) tooth_.configure(c.tooth_breakage);
    if (on_.drill) drill_.configure(c.drill_fracture);
    if (on_.wear) wear_.configure(c.wear);
    if (on_.band) {
      TorqueBandConfig band = c.torque_band;
      band.sample_period_s = c.torque_band_advance;
      band_.configure(band);
    }
    progress_.configure(c.torque_band_advance, c.torque_band.over_path,
                        c.torque_band.step / kGrains);
    reset();
  }
  void reset() noexcept {
    ar_.reset();
    tooth_.reset();
    drill_.reset();
    wear_.reset();
    band_.reset();
    progress_.reset();
    before_ = {};
    heard_ = Quality::settling;
  }
  [[nodiscard]] bool any() const noexcept {
    return on_.ar || on_.tooth || on_.drill || on_.wear || on_.band;
  }

  /// One servo period, in parts that may come at rates of their own: what hears the spindle, what
  /// hears the lateral forces, what hears the thrust. Each calls `changed(monitor, state before,
  /// state, value, threshold, detail)` for a monitor whose state changed.
  template <typename Changed>
  [[gnu::always_inline]] void hear_spindle(const ToolSample<Real>& in, Changed changed) noexcept {
    watch_ar(in, changed);
    watch_teeth(in, changed);
  }
  /// Single monitors, of hear_spindle() and hear_thrust(), for those that spread them over samples.
  template <typename Changed>
  [[gnu::always_inline]] void watch_ar(const ToolSample<Real>& in, Changed changed) noexcept {
    if (on_.ar) {
      // Following, it is one sample late, so that not both work on the same one.
      const MonitorState state =
          follows_ ? ar_.template follow<2>(tooth_.torque_sampler(), tooth_.sampled(), heard_)
                   : ar_.process(in.torque_Nm, in.turn_angle_rad, in.increment_rad, in.spindle);
      if (state != before_.ar) {
        const auto& core = ar_.core();
        changed(MonitorId::ar_breakage, before_.ar, state, core.state().value,
                core.alarm().threshold(), std::uint8_t{0});
        before_.ar = state;
      }
    }
  }
  template <typename Changed>
  [[gnu::always_inline]] void watch_teeth(const ToolSample<Real>& in, Changed changed) noexcept {
    if (on_.tooth) {
      const MonitorState state =
          torque_ ? tooth_.process(in.torque_Nm, in.turn_angle_rad, in.increment_rad, in.spindle)
                  : tooth_.process(in.force_x_N, in.force_y_N, in.turn_angle_rad, in.increment_rad,
                                   in.lateral | in.spindle);
      if (state != before_.tooth) {
        const auto& core = tooth_.core();
        // A pattern that lasts is a warning of its own.
        const bool lasts = core.lasts();
        changed(MonitorId::tooth_breakage, before_.tooth, state, core.state().value,
                core.alarm().threshold(), static_cast<std::uint8_t>(lasts));
        before_.tooth = state;
      }
    }
    heard_ = in.spindle;
  }
  template <typename Changed>
  [[gnu::always_inline]] void hear_lateral(const ToolSample<Real>& in, Changed changed) noexcept {
    if (on_.drill) {
      const MonitorState state =
          drill_.process(in.force_x_N, in.force_y_N, in.thrust_N, in.turn_angle_rad,
                         in.increment_rad, in.lateral | in.spindle | in.thrust, in.turn);
      if (state != before_.drill) {
        changed(MonitorId::drill_fracture, before_.drill, state, drill_.state().value_N,
                drill_.alarm().threshold(), std::uint8_t{0});
        before_.drill = state;
      }
    }
  }
  template <typename Changed>
  [[gnu::always_inline]] void hear_thrust(const ToolSample<Real>& in, Changed changed) noexcept {
    watch_wear(in, changed);
    watch_band(in, changed);
  }
  template <typename Changed>
  [[gnu::always_inline]] void watch_wear(const ToolSample<Real>& in, Changed changed) noexcept {
    if (on_.wear) {
      const MonitorState state = wear_.process(in.thrust_N, in.feed_m, in.level_torque_Nm,
                                               in.increment_rad, in.thrust | in.spindle);
      if (state != before_.wear) {
        const auto& tool = wear_.tool();
        changed(MonitorId::wear, before_.wear, state, tool.value, tool.threshold,
                static_cast<std::uint8_t>(tool.rule));
        before_.wear = state;
      }
    }
  }
  template <typename Changed>
  [[gnu::always_inline]] void watch_band(const ToolSample<Real>& in, Changed changed) noexcept {
    if (on_.band) {
      const MonitorState state = band_.process(in.level_torque_Nm, in.increment_rad,
                                               progress_.next(in.t_ns, in.way_m, in.feed_override),
                                               in.feed_override, in.spindle, in.nc_block);
      if (state != before_.band) {
        changed(MonitorId::torque_band, before_.band, state, band_.core().value,
                band_.alarm().threshold(), std::uint8_t{0});
        before_.band = state;
      }
    }
  }

  /// All three parts on one sample.
  template <typename Changed>
  void process(const ToolSample<Real>& in, Changed changed) noexcept {
    hear_spindle(in, changed);
    hear_lateral(in, changed);
    hear_thrust(in, changed);
  }

  [[nodiscard]] const Ar& ar_breakage() const noexcept { return ar_; }
  [[nodiscard]] const Tooth& tooth_breakage() const noexcept { return tooth_; }
  [[nodiscard]] const Drill& drill_fracture() const noexcept { return drill_; }
  [[nodiscard]] const Wear& wear() const noexcept { return wear_; }
  /// To tell of a new tool, or to teach.
  [[nodiscard]] Tooth& tooth_breakage() noexcept { return tooth_; }
  [[nodiscard]] Wear& wear() noexcept { return wear_; }
  [[nodiscard]] const Band& torque_band() const noexcept { return band_; }
  /// To give it its reference and to start a program.
  [[nodiscard]] Band& torque_band() noexcept { return band_; }

 private:
  struct On {
    bool ar = false, tooth = false, drill = false, wear = false, band = false;
  } on_;
  struct Before {
    MonitorState ar = MonitorState::idle, tooth = MonitorState::idle, drill = MonitorState::idle,
                 wear = MonitorState::idle, band = MonitorState::idle;
  } before_;
  bool torque_ = true;
  Quality heard_ = Quality::settling;  // of the spindle's sample before
  bool follows_ = false;  // AR breakage hears the quarters that tooth breakage has sampled
  Ar ar_;
  Tooth tooth_;
  Drill drill_;
  Wear wear_;
  Band band_;
  ProgramProgress<Real, kAxes> progress_;
};

}  // namespace servosense
