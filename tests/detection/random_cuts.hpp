// Random milling cuts as a controller would record them, with the truth beside.
//
//   draw(seed, event)     machine, tool, structure, cut, workpiece and what goes wrong
//   idle_run(cut)         what its user does first: spindle and axes in the air
//   learn(cut, idle)      the machine file as `servosense identify idle` completes it
//   learn_good_cut(cut, machine)    what a sound part adds to it, `identify collision`
//   simulate(cut)         cut and drives together (sim/machine_simulator.hpp), and the labels
//   Reporter              counts and currents of a record, with fresh noise each time
//
// Equal seeds give equal cuts on every compiler. What is drawn, and from what: docs/detection.md.
// Stiffness follows from the depth: the limit depth of a structure is proportional to its modal
// masses, so these are scaled until the depth of the cut is the drawn multiple of the limit that
// the semi-discretisation finds for it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "detection/learned_machine.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/identify/learn_thresholds.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "servosense/identify/stability_lobes.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/sim/drive_motion.hpp"
#include "servosense/sim/gaussian_noise.hpp"
#include "servosense/sim/machine_simulator.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace detection {

using namespace servosense;

inline constexpr double kPeriod_s = 125e-6;
inline constexpr double kNever = std::numeric_limits<double>::infinity();
/// Drives of a case, in the order in which records hold them.
inline constexpr std::array kDrives = {Channel::spindle, Channel::x, Channel::y};
inline constexpr DriveSignal kReported{MotionKind::counts, EffortKind::current_A};

enum class Event { none, chatter, tooth_break, collision };
enum class Feature { none, exit, slot, hole, corner, ramp, hold };

[[nodiscard]] constexpr const char* name_of(Event e) {
  constexpr const char* names[] = {"none", "chatter", "tooth break", "collision"};
  return names[static_cast<int>(e)];
}
[[nodiscard]] constexpr const char* name_of(Feature f) {
  constexpr const char* names[] = {"steady", "exit", "slot", "hole", "corner", "ramp", "hold"};
  return names[static_cast<int>(f)];
}

/// Everything that is drawn.
struct Cut {
  std::uint64_t seed = 0;
  Event event = Event::none;
  Feature feature = Feature::none;
  MachineFile machine;           ///< scales of drives and sensors; friction as it truly is
  MachineSimulation simulation;  ///< reports currents without noise: that is the Reporter's
  double depth_over_limit = 0;   ///< of the full engagement; a ramp: the least limit on its way
  double swept_rad = 0;
  double mean_torque_Nm = 0;  ///< of the full engagement, edge forces left out
  double rated_torque_Nm = 0;
  double entry_s = 0;           ///< from first contact to full engagement
  double break_fraction = 0;    ///< of the edge, along the greatest depth
  unsigned encoder_bits = 0;    ///< of the spindle
  double current_noise_A[3]{};  ///< rms, as kDrives
  std::string text;             ///< one line for people

  [[nodiscard]] const MillingSimulation& milling() const { return simulation.milling; }
  [[nodiscard]] unsigned teeth() const { return static_cast<unsigned>(milling().tool.teeth); }
  [[nodiscard]] double turn_s() const { return 60 / milling().cut.spindle_speed_rpm; }
};

/// Motion and current of the drives at every servo instant.
struct DriveRun {
  std::vector<double> position;
  std::vector<float> current_A;  ///< without noise
  std::vector<char> is_new;
  void add(const DriveSimSample& s) {
    position.push_back(s.position);
    current_A.push_back(static_cast<float>(s.current_A));
    is_new.push_back(s.current_is_new ? 1 : 0);
  }
};

/// A simulated run, with labels. Times [s] from its start; sample i is at i * kPeriod_s.
/// Limit cycles near the stability limit stay below one feed per tooth, because the teeth leave the
/// cut: such a chattering cut has no chatter_s.
struct Record {
  std::array<DriveRun, 3> drive;  ///< as kDrives
  CutSchedule schedule;
  // The truth about the cut, one value a sample. Empty for an idle run.
  std::vector<float> torque_Nm;
  std::vector<float> x_m, y_m;
  /// Engagement is changing, feed is held or starting: everything but steady cut and steady air.
  std::vector<char> changing;
  /// Vibration that does not repeat with the revolution, amplitude over the last revolution [m].
  std::vector<float> vibration_m;
  double break_s = kNever;    ///< the tooth breaks
  double touch_s = kNever;    ///< first contact with the obstacle
  double chatter_s = kNever;  ///< vibration_m reaches one feed per tooth
  double onset_s = kNever;  ///< vibration_m passes a tenth of it on the way to that, or to its peak
  float steady_vibration_m = 0;  ///< largest vibration_m while nothing changes: chatter
  /// Half the mean square of what the torque of the cut differs from a revolution ago, while
  /// nothing changes between first and last contact: the power that a chatter monitor without noise
  /// would read.
  double steady_chatter_Nm2 = 0;
  bool tool_lost = false;  ///< ended early: vibration beyond a quarter of the radius

  [[nodiscard]] std::size_t size() const { return drive[0].position.size(); }

  /// What the drives did in a sample, and the truth about its cut.
  void add(const MachineSample& sample) {
    drive[0].add(*sample.spindle);
    drive[1].add(*sample.x);
    drive[2].add(*sample.y);
    torque_Nm.push_back(static_cast<float>(sample.cut.torque_Nm));
    x_m.push_back(static_cast<float>(sample.cut.x_m));
    y_m.push_back(static_cast<float>(sample.cut.y_m));
  }
};

namespace detail {

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : noise_(seed * 0x2545f4914f6cdd1dU + 1) {
    for (int i = 0; i < 4; ++i) (void)noise_.uniform();
  }
  double between(double low, double high) { return low + (high - low) * noise_.uniform(); }
  /// As likely below as above the geometric mean.
  double scale(double low, double high) { return low * std::pow(high / low, noise_.uniform()); }
  int whole(int low, int high) {
    return std::min(high, low + static_cast<int>(noise_.uniform() * (high - low + 1)));
  }
  bool chance(double p) { return noise_.uniform() < p; }

 private:
  GaussianNoise noise_;
};

struct Material {
  const char* name;
  double tangential_low, tangential_high;  // [N/m2]
  double speed_low, speed_high;            // cutting speed [m/s]
};
inline constexpr Material kMaterials[] = {
    {"aluminium", 600e6, 900e6, 2.5, 8.0},
    {"steel", 1500e6, 2200e6, 1.3, 4.0},
    {"titanium", 1400e6, 2000e6, 0.7, 1.5},
};

inline void draw_tool_and_cut(Draw& d, Cut& c, std::string& material) {
  MillingSimulation& m = c.simulation.milling;
  const Material& of = kMaterials[d.whole(0, 2)];
  material = of.name;
  m.tool.diameter_m = d.scale(8e-3, 25e-3);
  m.tool.teeth = d.whole(2, 6);
  m.tool.helix_deg = d.between(0, 45);
  m.tool.force.tangential_coefficient_N_per_m2 = d.between(of.tangential_low, of.tangential_high);
  m.tool.force.radial_ratio = d.between(0.15, 0.5);
  // Edge forces of a chip of 10 to 40 um.
  const double edge = m.tool.force.tangential_coefficient_N_per_m2 * d.between(0, 20e-6);
  m.tool.force.tangential_edge_N_per_m = edge;
  m.tool.force.radial_edge_N_per_m = edge * d.between(0.5, 1);
  m.cut.spindle_speed_rpm =
      rpm_from_rad_s(d.between(of.speed_low, of.speed_high) / m.tool.radius_m());
  m.cut.feed_per_tooth_m = m.tool.diameter_m * d.between(0.003, 0.008);
  m.cut.axial_depth_m = m.tool.diameter_m * d.scale(0.05, 0.6);
  c.swept_rad = d.between(10, 180) * kPi / 180;
  if (c.swept_rad > 175 * kPi / 180) {
    m.cut.direction = MillingDirection::slot;
    c.swept_rad = kPi;
  } else {
    m.cut.direction = d.chance(0.5) ? MillingDirection::up : MillingDirection::down;
  }
  m.cut.radial_immersion_m = m.tool.radius_m() * (1 - std::cos(c.swept_rad));
  m.tool.throw_m.clear();
  const double throw_m = m.cut.feed_per_tooth_m * d.between(0, 0.1);
  for (int i = 0; i < m.tool.teeth; ++i) m.tool.throw_m.push_back(throw_m * d.between(-1, 1));
  c.mean_torque_Nm = m.tool.force.tangential_coefficient_N_per_m2 * m.cut.axial_depth_m *
                     m.cut.radial_immersion_m * m.cut.feed_per_tooth_m * m.tool.teeth / kTwoPi;
}

/// A structure for which the depth of the cut is `over_limit` times its limit at all of `rpm`.
/// False when none has that limit with a plausible stiffness.
inline bool draw_structure(Draw& d, Cut& c, double over_limit, const std::vector<double>& rpm) {
  MillingSimulation& m = c.simulation.milling;
  const double first_hz = d.scale(300, 1400);
  m.structure.x = {{first_hz, d.between(0.015, 0.05), 1}};
  m.structure.y = {{first_hz * d.between(0.85, 1.2), d.between(0.015, 0.05), d.between(0.7, 1.4)}};
  if (d.chance(0.5))
    m.structure.y.push_back({first_hz * d.between(1.4, 1.9), d.between(0.015, 0.05), 4});
  // Kt depends on the chip thickness only through the size effect, which is not drawn.
  const auto lobes = StabilityLobes::from_modes(m.structure, m.tool, m.cut);
  const auto exact = SemiDiscretization::create(m.structure, m.tool, m.cut);
  if (!lobes || !exact) return false;
  double limit_m = kNever;
  for (const double speed : rpm) {
    const double about = lobes->limit_at(speed).axial_depth_m;
    limit_m = std::min(limit_m, exact->limit_at(speed, 2 * about, 30).axial_depth_m);
  }
  if (!(limit_m < 1e6)) return false;
  const double scale = m.cut.axial_depth_m / over_limit / limit_m;
  for (auto* axis : {&m.structure.x, &m.structure.y})
    for (StructuralMode& mode : *axis) mode.modal_mass_kg *= scale;
  const double k = m.structure.x[0].stiffness_N_per_m();
  c.depth_over_limit = over_limit;
  return k > 2e6 && k < 2e8;
}

/// Machine file with drives and sensors in proportion to the rated torque.
inline void draw_machine(Draw& d, Cut& c) {
  MachineFile& f = c.machine;
  f = good(MachineFile::parse("[machine]\nname = drawn\nsample_rate_hz = 8000\n", "drawn.ini"),
           "machine");
  const double rated = c.rated_torque_Nm;
  const double rated_A = 20;
  const double constant = rated / rated_A;
  const double inertia = rated * d.between(1.4e-4, 3e-4);
  const double update_hz[] = {8000, 8000, 4000, 2000, 1000};
  c.encoder_bits = static_cast<unsigned>(d.whole(17, 23));
  f.set("spindle", "torque_constant_Nm_per_A", constant);
  f.set("spindle", "inertia_kg_m2", inertia);
  f.set("spindle", "viscous_friction_Nm_s_per_rad", rated * d.between(1e-5, 5e-5));
  f.set("spindle", "coulomb_friction_Nm", rated * d.between(0.005, 0.015));
  f.set("spindle", "friction_knee_rad", 1e-3);
  f.set("spindle", "encoder_counts_per_rev", std::ldexp(1.0, static_cast<int>(c.encoder_bits)));
  f.set("spindle", "counter_bits", 32);
  f.set("spindle", "current_update_hz", update_hz[d.whole(0, 4)]);
  // Velocity loop of 20 to 50 Hz, integral a fifth of that.
  const double loop = kTwoPi * d.between(20, 50);
  f.set("controller.spindle", "velocity_gain_A_s_per_rad", loop * inertia / constant);
  f.set("controller.spindle", "velocity_integral_per_s", loop / 5);
  f.set("controller.spindle", "current_limit_A", 3 * rated_A);
  f.set("controller.spindle", "current_bandwidth_hz", d.between(600, 1500));
  c.current_noise_A[0] = rated_A * d.between(0.0005, 0.003);
  f.set("tool", "teeth", c.simulation.milling.tool.teeth);
  f.set("tool", "diameter_m", c.simulation.milling.tool.diameter_m);
  for (std::size_t i = 1; i < kDrives.size(); ++i) {
    const std::string name{servosense::name_of(kDrives[i])};
    const std::string axis = "axis." + name, controller = "controller." + name;
    const double mass = d.scale(100, 400);
    const double newton_per_A = 300;
    f.set(axis, "lead_m", 0.01);
    f.set(axis, "equivalent_mass_kg", mass);
    f.set(axis, "viscous_friction_N_s_per_m", mass * d.between(2, 5));
    f.set(axis, "coulomb_friction_N", mass * d.between(0.3, 0.8));
    f.set(axis, "friction_knee_m", 5e-6);
    f.set(axis, "force_constant_N_per_A", newton_per_A);
    f.set(axis, "encoder_counts_per_rev", std::ldexp(1.0, d.whole(17, 23)));
    f.set(axis, "counter_bits", 32);
    f.set(axis, "current_update_hz", update_hz[d.whole(0, 4)]);
    const double axis_loop = kTwoPi * d.between(20, 40);
    f.set(controller, "velocity_gain_A_s_per_m", axis_loop * mass / newton_per_A);
    f.set(controller, "velocity_integral_per_s", axis_loop / 5);
    f.set(controller, "position_gain_per_s", axis_loop / 4);
    f.set(controller, "current_limit_A", 40);
    f.set(controller, "current_bandwidth_hz", d.between(600, 1500));
    c.current_noise_A[i] = d.between(0.005, 0.05);
  }
}

/// Feature, events and times. Lengths follow from times at the feed of the cut.
inline bool draw_course(Draw& d, Cut& c) {
  MachineSimulation& s = c.simulation;
  MillingSimulation& m = s.milling;
  const double radius = m.tool.radius_m();
  const double feed = m.cut.feed_per_tooth_m * m.tool.teeth / c.turn_s();
  const Engagement window = engagement_of(m.tool, m.cut);
  c.entry_s = -first_contact_m(radius, window) / feed;
  if (c.entry_s > 1) return false;
  const double steady = std::max(d.between(0.5, 0.9), 25 * c.turn_s());
  double cut_s = c.entry_s + steady;
  m.workpiece = {};
  m.workpiece.length_m = 10;
  s.program = {};
  const double at = c.entry_s + steady / 2;  // of the feature
  const double across_s = 2 * radius / feed;
  if (c.feature != Feature::ramp && c.feature != Feature::none && across_s > 1.5) return false;
  switch (c.feature) {
    case Feature::none:
      break;
    case Feature::exit:
      m.workpiece.length_m = feed * steady;
      cut_s += across_s + 0.1;
      break;
    case Feature::slot: {
      const double wide_s = d.between(0.1, 1) * across_s;
      m.workpiece.slots = {{feed * steady / 2, feed * (steady / 2 + wide_s)}};
      cut_s += across_s + wide_s;
      break;
    }
    case Feature::hole: {
      // Somewhere in the width of cut.
      const double from = radius * std::cos(window.start_rad),
                   to = radius * std::cos(window.exit_rad);
      const double r = radius * d.between(0.2, 0.8);
      m.workpiece.holes = {{feed * steady / 2 + r, d.between(from, to), r}};
      cut_s += across_s;
      break;
    }
    case Feature::corner: {
      // A round pocket that takes off a part of the width of cut from one side.
      const double from = radius * std::cos(window.start_rad),
                   to = radius * std::cos(window.exit_rad);
      const double wide = 2 * radius;
      const double y = d.between(0.3, 0.7) * (to - from) + from + (d.chance(0.5) ? wide : -wide);
      m.workpiece.holes = {{feed * steady / 2 + wide, y, wide}};
      cut_s += across_s;
      break;
    }
    case Feature::ramp: {
      const double rpm = m.cut.spindle_speed_rpm;
      m.speed.points = {{at, rpm}, {at + 1, rpm * (d.chance(0.5) ? 1.25 : 0.75)}};
      cut_s += 1;
      break;
    }
    case Feature::hold:
      s.program.holds = {{at, d.between(0, 0.2)}};
      cut_s += 0.4;
      break;
  }
  m.start = MillingStart::entry;
  s.program.cut_s = cut_s;
  s.program.dwell_s = 0.15;
  s.program.spindle_acceleration_rad_s2 =
      std::max(1000.0, rad_s_from_rpm(m.cut.spindle_speed_rpm) / 0.4);
  s.program.feed_acceleration_m_s2 = 1;
  s.program.feed_jerk_m_s3 = 50;
  // The feed comes up in the air, and the axis has 0.15 s more to settle.
  m.clearance_m = feed * (feed + 2 * std::sqrt(feed / 50) + 0.02 + 0.15);
  m.breaks.clear();
  s.obstacle.reset();
  if (c.event == Event::tooth_break) {
    c.break_fraction = d.chance(0.5) ? 1 : d.between(0.2, 0.8);
    m.breaks = {{d.between(c.entry_s + 6 * c.turn_s(), cut_s - 4 * c.turn_s()),
                 d.whole(1, m.tool.teeth), c.break_fraction}};
  } else if (c.event == Event::collision) {
    // A clamp in the way, in the air or in the cut; it or the tool gives way.
    FeedObstacle o;
    const double contact_m = first_contact_m(radius, window);
    o.position_m = d.chance(0.5) ? contact_m - d.between(0, 0.4) * m.clearance_m
                                 : contact_m + d.between(0, 0.8) * feed * (c.entry_s + steady);
    o.stiffness_N_per_m = d.scale(1e6, 2e7);
    o.strength_N = d.scale(300, 2000);
    s.obstacle = o;
  }
  // Short enough for the fastest mode, also as stiff as the cut makes it, and for a degree of turn.
  const CuttingForceLaw& law = m.tool.force;
  const double cut_N_per_m = law.tangential_coefficient_N_per_m2 * (1 + law.radial_ratio) *
                             m.cut.axial_depth_m * m.tool.teeth;
  double step = std::min(c.turn_s() / 360, 25e-6);
  for (const auto* axis : {&m.structure.x, &m.structure.y})
    for (const StructuralMode& mode : *axis) {
      const double stiffened_rad_s =
          std::hypot(mode.natural_frequency_rad_s(), std::sqrt(cut_N_per_m / mode.modal_mass_kg));
      step = std::min({step, 1 / (50 * mode.natural_frequency_hz), kTwoPi / stiffened_rad_s / 12});
    }
  m.step_s = kPeriod_s / std::ceil(kPeriod_s / step);
  m.layers = 16;
  m.surface_points = 720;
  m.wall_points = 1024;
  return true;
}

}  // namespace detail

/// The cut of a seed. With Feature absent it is drawn too.
[[nodiscard]] inline Cut draw(std::uint64_t seed, Event event,
                              std::optional<Feature> feature = std::nullopt) {
  detail::Draw d(4 * seed + static_cast<std::uint64_t>(event));
  for (;;) {
    Cut c;
    c.seed = seed;
    c.event = event;
    c.simulation.sample_period_s = kPeriod_s;
    c.feature = feature ? *feature : static_cast<Feature>(d.whole(0, 6));
    // A ramp may run out of the lobe that chatters.
    if (event == Event::chatter && c.feature == Feature::ramp) c.feature = Feature::none;
    std::string material;
    detail::draw_tool_and_cut(d, c, material);
    const MillingSimulation& m = c.simulation.milling;
    const double rpm = m.cut.spindle_speed_rpm;
    if (!(rpm > 1200 && rpm < 15000)) continue;
    // A cut of 3 to 60 % of what the spindle is rated for.
    c.rated_torque_Nm = d.scale(5, 40);
    const double load = c.mean_torque_Nm / c.rated_torque_Nm;
    if (!(load > 0.03 && load < 0.6)) continue;
    std::vector<double> speeds = {rpm};
    if (c.feature == Feature::ramp) speeds = {0.75 * rpm, 0.87 * rpm, rpm, 1.12 * rpm, 1.25 * rpm};
    const double over = event == Event::chatter ? d.between(1.3, 2.5) : d.between(0.2, 0.7);
    if (!detail::draw_structure(d, c, over, speeds)) continue;
    if (!detail::draw_course(d, c)) continue;
    detail::draw_machine(d, c);
    for (const Channel channel : kDrives) {
      auto& drive = channel == Channel::spindle ? c.simulation.spindle
                    : channel == Channel::x     ? c.simulation.x
                                                : c.simulation.y;
      drive = good(drive_simulation(c.machine, channel), "drive");
      drive->seed = seed;
    }
    char line[320];
    std::snprintf(line, sizeof line,
                  "seed %llu %s/%s: %s D%.1f z%d helix %.0f %s %.0f deg, %.0f rpm, fz %.0f um, ap "
                  "%.2f mm = %.2f limit, T %.2f of %.0f Nm, %u bit, %.0f Hz, modes %.0f %.0f Hz",
                  static_cast<unsigned long long>(seed), name_of(event), name_of(c.feature),
                  material.c_str(), 1e3 * m.tool.diameter_m, m.tool.teeth, m.tool.helix_deg,
                  m.cut.direction == MillingDirection::up     ? "up"
                  : m.cut.direction == MillingDirection::down ? "down"
                                                              : "slot",
                  c.swept_rad * 180 / kPi, rpm, 1e6 * m.cut.feed_per_tooth_m,
                  1e3 * m.cut.axial_depth_m, c.depth_over_limit, c.mean_torque_Nm,
                  c.rated_torque_Nm, c.encoder_bits, c.simulation.spindle->current_update_hz,
                  m.structure.x[0].natural_frequency_hz, m.structure.y[0].natural_frequency_hz);
    c.text = line;
    return c;
  }
}

/// The idling run that thresholds are learned from: the spindle at 40, 70 and 100 % of the fastest
/// speed of the program, the axes to and fro at two feeds.
[[nodiscard]] inline Record idle_run(const Cut& c) {
  double rpm = c.milling().cut.spindle_speed_rpm;
  for (const auto& p : c.milling().speed.points) rpm = std::max(rpm, p.speed_rpm);
  const double top = rad_s_from_rpm(rpm), up = c.simulation.program.spindle_acceleration_rad_s2;
  struct Hold {
    double speed, until_s;
  };
  // Time enough at each speed for a few windows of eight revolutions.
  std::vector<Hold> holds;
  double end = 0, speed = 0;
  for (const double part : {0.4, 0.7, 1.0}) {
    end += (part * top - speed) / up + std::max(0.6, 24 * kTwoPi / (part * top));
    speed = part * top;
    holds.push_back({speed, end});
  }
  end += top / up + 0.1;
  Trajectory x(0), y(0);
  while (x.duration_s() < end) {
    const double target = x.end() > 0 ? 0 : 1;
    const double v = x.duration_s() > end / 2 ? 0.02 : 0.1;
    for (Trajectory* t : {&x, &y}) (void)good(t->move_to(target * v / 2, {v, 2, 100}), "idle move");
  }
  const auto spindle_speed = [&](double t) {
    double v = 0, from = 0;
    for (const Hold& h : holds) {
      if (t < h.until_s) return std::min(h.speed, v + up * (t - from));
      v = h.speed;
      from = h.until_s;
    }
    return std::max(0.0, v - up * (t - from));
  };
  Record r;
  auto spindle = good(DriveSimulator::create(*c.simulation.spindle), "spindle");
  auto axis_x = good(DriveSimulator::create(*c.simulation.x), "x");
  auto axis_y = good(DriveSimulator::create(*c.simulation.y), "y");
  const auto count = static_cast<std::size_t>(end / kPeriod_s);
  for (std::size_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) * kPeriod_s;
    r.drive[0].add(spindle.step(spindle_speed(t)));
    r.drive[1].add(axis_x.step(x.at(t).position));
    r.drive[2].add(axis_y.step(y.at(t).position));
  }
  return r;
}

namespace detail {

/// Amplitude of what does not repeat with the revolution: half the largest difference from one, two
/// and three revolutions ago, whichever shows most (a vibration at a multiple and a half differs
/// after one, one near a third after two...).
inline void find_vibration(const Cut& c, Record& r, std::vector<double>& unlike_Nm2) {
  const std::size_t n = r.size();
  unlike_Nm2.assign(n, 0);
  r.vibration_m.assign(n, 0);
  std::vector<float> apart(n, 0);
  const std::vector<double>& angle = r.drive[0].position;
  const auto at = [&](const std::vector<float>& v, std::size_t i, double part) {
    // Catmull-Rom through four samples, at i + part.
    const auto value = [&](std::size_t k) { return static_cast<double>(v[k]); };
    const double a = value(i - 1), b = value(i), e = value(i + 1), f = value(i + 2);
    return b +
           part / 2 * (e - a + part * (2 * a - 5 * b + 4 * e - f + part * (3 * (b - e) + f - a)));
  };
  std::array<std::size_t, 3> back = {1, 1, 1};
  std::size_t from = 0;
  std::vector<std::size_t> peaks;  // indices of falling `apart` within the last revolution
  std::size_t first_peak = 0;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < back.size(); ++k) {
      const double then = angle[i] - kTwoPi * static_cast<double>(k + 1);
      std::size_t& j = back[k];
      if (then <= angle[1]) continue;
      while (j + 1 < i && angle[j + 1] <= then) ++j;
      const double step = angle[j + 1] - angle[j];
      if (!(step > 1e-9) || j + 2 >= n) continue;
      const double part = (then - angle[j]) / step;
      const double dx = at(r.x_m, j, part) - static_cast<double>(r.x_m[i]);
      const double dy = at(r.y_m, j, part) - static_cast<double>(r.y_m[i]);
      apart[i] = std::max(apart[i], static_cast<float>(std::max(std::abs(dx), std::abs(dy)) / 2));
      const double torque = at(r.torque_Nm, j, part) - static_cast<double>(r.torque_Nm[i]);
      if (k == 0) unlike_Nm2[i] = torque * torque / 2;
    }
    while (angle[from] < angle[i] - kTwoPi) ++from;
    while (peaks.size() > first_peak && apart[peaks.back()] <= apart[i]) peaks.pop_back();
    peaks.push_back(i);
    while (peaks[first_peak] < from) ++first_peak;
    r.vibration_m[i] = apart[peaks[first_peak]];
  }
  const auto feed = static_cast<float>(c.milling().cut.feed_per_tooth_m);
  std::size_t reached = n, highest = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (r.vibration_m[i] > r.vibration_m[highest]) highest = i;
    if (reached == n && r.vibration_m[i] >= feed) reached = i;
  }
  if (reached < n) r.chatter_s = static_cast<double>(reached) * kPeriod_s;
  std::size_t onset = std::min(reached, highest);
  if (n == 0 || r.vibration_m[highest] < feed / 10) return;
  while (onset > 0 && r.vibration_m[onset - 1] >= feed / 10) --onset;
  r.onset_s = static_cast<double>(onset) * kPeriod_s;
}

/// What does not repeat where nothing has changed for four revolutions: chatter.
inline void find_steady_chatter(const Cut& c, Record& r, const std::vector<double>& unlike_Nm2) {
  const auto wait = static_cast<std::size_t>(4 * c.turn_s() / kPeriod_s);
  std::size_t quiet = 0, first = 0, last = r.size();
  while (first < last && !(r.torque_Nm[first] > 0)) ++first;
  while (last > first && !(r.torque_Nm[last - 1] > 0)) --last;
  double sum = 0, count = 0;
  for (std::size_t i = first; i < last; ++i) {
    quiet = r.changing[i] != 0 ? 0 : quiet + 1;
    if (quiet <= wait) continue;
    r.steady_vibration_m = std::max(r.steady_vibration_m, r.vibration_m[i]);
    sum += unlike_Nm2[i];
    count += 1;
  }
  if (count > 0) r.steady_chatter_Nm2 = sum / count;
}

/// Where the arcs in the work change, feed starts, stops or stands.
inline void find_changes(const Cut& c, Record& r, const std::vector<double>& feed_m,
                         const std::vector<double>& commanded_m) {
  const MillingSimulation& m = c.milling();
  const Engagement window = engagement_of(m.tool, m.cut);
  const double steady = m.cut.feed_per_tooth_m * m.tool.teeth / c.turn_s() * kPeriod_s;
  double last = 0;
  for (std::size_t i = 0; i < feed_m.size(); ++i) {
    double swept = 0;
    for (const Engagement& e : engagement_arcs(m.workpiece, m.tool.radius_m(), window, feed_m[i]))
      swept += e.swept_rad();
    // By far less than a revolution of any feed moves it.
    bool changes = i > 0 && std::abs(swept - last) > 1e-7;
    if (i > 0 && swept > 0) {
      const double moved = commanded_m[i] - commanded_m[i - 1];
      if (m.speed.points.empty() && std::abs(moved - steady) > 0.01 * steady) changes = true;
    }
    r.changing.push_back(changes ? 1 : 0);
    last = swept;
  }
}

}  // namespace detail

/// Runs the program of a cut, up to the run-down of the spindle.
[[nodiscard]] inline Record simulate(const Cut& c) {
  MachineSimulator machine = good(MachineSimulator::create(c.simulation), c.text.c_str());
  Record r;
  r.schedule = machine.schedule();
  std::vector<double> feed_m, commanded_m;
  // Where the tool is still in the work it would be lifted off now; z does not take part.
  const auto count = static_cast<std::size_t>(r.schedule.run_down_s / kPeriod_s);
  for (std::size_t i = 0; i < count; ++i) {
    const MachineSample s = machine.step();
    r.add(s);
    feed_m.push_back(s.cut.feed_m);
    commanded_m.push_back(s.feed_reference_m);
    if (s.obstacle_N > 0 && r.touch_s == kNever) r.touch_s = s.t_s;
    if (machine.milling().lost()) {
      r.tool_lost = true;
      break;
    }
  }
  if (c.event == Event::tooth_break)
    r.break_s = r.schedule.contact_s + c.milling().breaks[0].time_s;
  std::vector<double> unlike_Nm2;
  detail::find_vibration(c, r, unlike_Nm2);
  detail::find_changes(c, r, feed_m, commanded_m);
  detail::find_steady_chatter(c, r, unlike_Nm2);
  return r;
}

/// What the controller hands over: counts from a random origin, currents with white noise, as the
/// seed of this replay gives them.
template <typename Real>
class Reporter {
 public:
  Reporter(const Cut& cut, const Record& record, std::uint64_t seed)
      : record_(record), noise_(16 * seed + 5) {
    const DriveSimulatorConfig* drives[] = {&*cut.simulation.spindle, &*cut.simulation.x,
                                            &*cut.simulation.y};
    for (std::size_t d = 0; d < kDrives.size(); ++d) {
      const DriveSimulatorConfig& c = *drives[d];
      counts_per_unit_[d] = c.encoder.counts_per_turn / c.drive.unit_per_turn;
      origin_[d] = noise_.uniform() * c.encoder.counts_per_turn;
      rms_A_[d] = cut.current_noise_A[d];
    }
  }
  /// Sample i; to be asked for in turn.
  ServoSample<Real> at(std::size_t i) {
    ServoSample<Real> s;
    s.t_ns = static_cast<Nanoseconds>(std::llround(static_cast<double>(i) * kPeriod_s * 1e9));
    fill(s.spindle, 0, i);
    fill(s.axis[0], 1, i);
    fill(s.axis[1], 2, i);
    return s;
  }

 private:
  void fill(RawDriveSample<Real>& raw, std::size_t d, std::size_t i) {
    const DriveRun& run = record_.drive[d];
    raw.counts =
        static_cast<std::int64_t>(std::floor(run.position[i] * counts_per_unit_[d] + origin_[d])) &
        0xffffffff;  // as a counter of 32 bits shows it
    if (run.is_new[i])
      reported_A_[d] = static_cast<double>(run.current_A[i]) + rms_A_[d] * noise_.next();
    raw.effort = static_cast<Real>(reported_A_[d]);
    if (!run.is_new[i]) raw.effort_quality = Quality::held;
  }

  const Record& record_;
  GaussianNoise noise_;
  double counts_per_unit_[3]{}, origin_[3]{}, rms_A_[3]{}, reported_A_[3]{};
};

[[nodiscard]] inline StackSignals signals() {
  StackSignals s;
  s.sample_period_s = kPeriod_s;
  s.spindle = s.axis[0] = s.axis[1] = kReported;
  return s;
}

/// The machine file after `servosense identify idle`: inertia and friction as found, thresholds
/// and noise as learned from the idling run.
[[nodiscard]] inline MachineFile learn(const Cut& c, const Record& idle) {
  Reporter<double> reporter(c, idle, c.seed);
  std::size_t i = 0;
  return learn_idle(
      c.machine, signals(), c.teeth(), idle.size(), [&] { return reporter.at(i++); },
      c.text.c_str());
}

/// The same program on the same machine, sound: the stock differs by up to a tenth, the tool has
/// another run-out, the spindle another angle.
[[nodiscard]] inline Cut good_part(const Cut& c) {
  Cut part = c;
  detail::Draw d(4 * c.seed + static_cast<std::uint64_t>(c.event) + 7'000'000'000U);
  part.simulation.obstacle.reset();
  MillingSimulation& m = part.simulation.milling;
  m.breaks.clear();
  m.cut.axial_depth_m *= d.between(0.9, 1.1);
  const double throw_m = m.cut.feed_per_tooth_m * d.between(0, 0.1);
  for (double& t : m.tool.throw_m) t = throw_m * d.between(-1, 1);
  part.simulation.spindle->initial_position = d.between(0, kTwoPi);
  return part;
}

/// The machine file after `servosense identify collision` on one good part. Returns the highest
/// force that x or y took in it [N].
inline double learn_good_cut(const Cut& c, MachineFile& machine) {
  const Cut part = good_part(c);
  MachineSimulator simulator = good(MachineSimulator::create(part.simulation), c.text.c_str());
  Record r;
  const auto count = static_cast<std::size_t>(simulator.schedule().run_down_s / kPeriod_s);
  for (std::size_t i = 0; i < count && !simulator.milling().lost(); ++i) {
    const MachineSample s = simulator.step();
    r.drive[0].add(*s.spindle);
    r.drive[1].add(*s.x);
    r.drive[2].add(*s.y);
  }
  CutLearner learner(good(plan_stack(machine, signals()), "plan").config);
  Reporter<double> reporter(part, r, c.seed + 2);
  double highest_N = 0;
  for (std::size_t i = 0; i < r.size(); ++i) {
    learner.add(reporter.at(i));
    for (std::size_t a = 0; a < 2; ++a)
      highest_N = std::max(highest_N, std::abs(learner.stack().axis(a).estimate));
  }
  for (std::size_t i = 0; i < 2; ++i)
    machine.set(
        "monitor.collision",
        "cutting_threshold_" + std::string(servosense::name_of(kDrives[i + 1])) + "_N_per_s",
        learner.threshold(i));
  return highest_N;
}

/// Cut, idling run and learned machine file in one go; the stack's configuration from them.
[[nodiscard]] inline HostStackConfig learned_stack(const Cut& c) {
  return good(plan_stack(learn(c, idle_run(c)), signals()), "plan").config;
}

}  // namespace detection
