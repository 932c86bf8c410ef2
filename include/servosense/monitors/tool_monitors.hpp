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
#include <tuple>
#include <type_traits>

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

  /// A monitor, the members of Config that are its own, and what was last said of it.
  template <MonitorId Id, typename Monitor, bool Config::*On, auto Settings>
  struct Watched {
    static constexpr MonitorId kId = Id;
    Monitor monitor;
    bool on = false;
    MonitorState before = MonitorState::idle;

    static Status validate(const Config& c) noexcept {
      return c.*On ? Monitor::validate(c.*Settings) : Status{};
    }
    void configure(const Config& c) noexcept {
      on = c.*On;
      if (on) monitor.configure(c.*Settings);
    }
    void reset() noexcept {
      monitor.reset();
      before = MonitorState::idle;
    }
  };
  using WatchedAr =
      Watched<MonitorId::ar_breakage, Ar, &Config::ar_breakage_on, &Config::ar_breakage>;
  using WatchedTooth = Watched<MonitorId::tooth_breakage, Tooth, &Config::tooth_breakage_on,
                               &Config::tooth_breakage>;
  using WatchedDrill = Watched<MonitorId::drill_fracture, Drill, &Config::drill_fracture_on,
                               &Config::drill_fracture>;
  using WatchedWear = Watched<MonitorId::wear, Wear, &Config::wear_on, &Config::wear>;
  using WatchedBand =
      Watched<MonitorId::torque_band, Band, &Config::torque_band_on, &Config::torque_band>;
  /// Every monitor of the tool: how many there are, and what is done to each, follows from it.
  using All = std::tuple<WatchedAr, WatchedTooth, WatchedDrill, WatchedWear, WatchedBand>;
  static constexpr std::size_t kMonitors = std::tuple_size_v<All>;
  template <typename List>
  struct IdsOf;
  template <typename... W>
  struct IdsOf<std::tuple<W...>> {
    static constexpr std::array<MonitorId, sizeof...(W)> kIds = {W::kId...};
  };
  /// Their ids, in the order of All.
  static constexpr std::array<MonitorId, kMonitors> kIds = IdsOf<All>::kIds;
  static constexpr double kGrains = 16;  ///< of path in a step of the torque band

  static Status validate(const Config& c) noexcept {
    if (const Status s = validate_each(c, std::type_identity<All>{}); !s.ok()) return s;
    if (c.half_rate && c.tooth_breakage_on && !c.tooth_breakage.torque)
      return Status::invalid("half_rate", "must be off with tooth breakage on x and y");
    if (c.torque_band_on && !(c.torque_band_advance > 0))
      return Status::invalid("torque_band_advance", "must be positive");
    return {};
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    std::apply([&c](auto&... watched) { (watched.configure(c), ...); }, all_);
    torque_ = c.tooth_breakage.torque;
    follows_ = of<WatchedAr>().on && of<WatchedTooth>().on && torque_ &&
               c.ar_breakage.teeth == c.tooth_breakage.teeth;
    if (c.torque_band_on) {
      TorqueBandConfig band = c.torque_band;
      band.sample_period_s = c.torque_band_advance;
      torque_band().configure(band);
    }
    progress_.configure(c.torque_band_advance, c.torque_band.over_path,
                        c.torque_band.step / kGrains);
    reset();
  }
  void reset() noexcept {
    std::apply([](auto&... watched) { (watched.reset(), ...); }, all_);
    progress_.reset();
    heard_ = Quality::settling;
  }
  [[nodiscard]] bool any() const noexcept {
    return std::apply([](const auto&... watched) { return (watched.on || ...); }, all_);
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
    WatchedAr& ar = of<WatchedAr>();
    if (ar.on) {
      // Following, it is one sample late, so that not both work on the same one.
      const MonitorState state =
          follows_
              ? ar.monitor.template follow<2>(tooth_breakage().torque_sampler(),
                                              tooth_breakage().sampled(), heard_)
              : ar.monitor.process(in.torque_Nm, in.turn_angle_rad, in.increment_rad, in.spindle);
      if (state != ar.before) {
        const auto& core = ar.monitor.core();
        changed(ar.kId, ar.before, state, core.state().value, core.alarm().threshold(),
                std::uint8_t{0});
        ar.before = state;
      }
    }
  }
  template <typename Changed>
  [[gnu::always_inline]] void watch_teeth(const ToolSample<Real>& in, Changed changed) noexcept {
    WatchedTooth& tooth = of<WatchedTooth>();
    if (tooth.on) {
      const MonitorState state =
          torque_
              ? tooth.monitor.process(in.torque_Nm, in.turn_angle_rad, in.increment_rad, in.spindle)
              : tooth.monitor.process(in.force_x_N, in.force_y_N, in.turn_angle_rad,
                                      in.increment_rad, in.lateral | in.spindle);
      if (state != tooth.before) {
        const auto& core = tooth.monitor.core();
        // A pattern that lasts is a warning of its own.
        const bool lasts = core.lasts();
        changed(tooth.kId, tooth.before, state, core.state().value, core.alarm().threshold(),
                static_cast<std::uint8_t>(lasts));
        tooth.before = state;
      }
    }
    heard_ = in.spindle;
  }
  template <typename Changed>
  [[gnu::always_inline]] void hear_lateral(const ToolSample<Real>& in, Changed changed) noexcept {
    WatchedDrill& drill = of<WatchedDrill>();
    if (drill.on) {
      const MonitorState state =
          drill.monitor.process(in.force_x_N, in.force_y_N, in.thrust_N, in.turn_angle_rad,
                                in.increment_rad, in.lateral | in.spindle | in.thrust);
      if (state != drill.before) {
        changed(drill.kId, drill.before, state, drill.monitor.state().value_N,
                drill.monitor.alarm().threshold(), std::uint8_t{0});
        drill.before = state;
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
    WatchedWear& wear = of<WatchedWear>();
    if (wear.on) {
      const MonitorState state = wear.monitor.process(in.thrust_N, in.feed_m, in.level_torque_Nm,
                                                      in.increment_rad, in.thrust | in.spindle);
      if (state != wear.before) {
        const auto& tool = wear.monitor.tool();
        changed(wear.kId, wear.before, state, tool.value, tool.threshold,
                static_cast<std::uint8_t>(tool.rule));
        wear.before = state;
      }
    }
  }
  template <typename Changed>
  [[gnu::always_inline]] void watch_band(const ToolSample<Real>& in, Changed changed) noexcept {
    WatchedBand& band = of<WatchedBand>();
    if (band.on) {
      const MonitorState state = band.monitor.process(
          in.level_torque_Nm, in.increment_rad, progress_.next(in.t_ns, in.way_m, in.feed_override),
          in.feed_override, in.spindle, in.nc_block);
      if (state != band.before) {
        const auto& core = band.monitor.core();
        const bool alarm = state == MonitorState::alarm;
        changed(band.kId, band.before, state, core.value, band.monitor.alarm().threshold(),
                alarm ? core.cause.code() : std::uint8_t{0});
        band.before = state;
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

  [[nodiscard]] const Ar& ar_breakage() const noexcept { return of<WatchedAr>().monitor; }
  [[nodiscard]] const Tooth& tooth_breakage() const noexcept { return of<WatchedTooth>().monitor; }
  [[nodiscard]] const Drill& drill_fracture() const noexcept { return of<WatchedDrill>().monitor; }
  [[nodiscard]] const Wear& wear() const noexcept { return of<WatchedWear>().monitor; }
  /// To tell of a new tool, or to teach.
  [[nodiscard]] Tooth& tooth_breakage() noexcept { return of<WatchedTooth>().monitor; }
  [[nodiscard]] Wear& wear() noexcept { return of<WatchedWear>().monitor; }
  [[nodiscard]] const Band& torque_band() const noexcept { return of<WatchedBand>().monitor; }
  /// To give it its reference and to start a program.
  [[nodiscard]] Band& torque_band() noexcept { return of<WatchedBand>().monitor; }

 private:
  template <typename... W>
  static Status validate_each(const Config& c, std::type_identity<std::tuple<W...>>) noexcept {
    Status status;
    (void)((status = W::validate(c), status.ok()) && ...);
    return status;
  }

  template <typename Of>
  [[nodiscard]] Of& of() noexcept {
    return std::get<Of>(all_);
  }
  template <typename Of>
  [[nodiscard]] const Of& of() const noexcept {
    return std::get<Of>(all_);
  }

  All all_;
  bool torque_ = true;
  Quality heard_ = Quality::settling;  // of the spindle's sample before
  bool follows_ = false;  // AR breakage hears the quarters that tooth breakage has sampled
  ProgramProgress<Real, kAxes> progress_;
};

}  // namespace servosense
