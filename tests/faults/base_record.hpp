// What a small milling machine truly does while it moves, stands or cuts, and what it reports at a
// rate: a spindle and one axis (oracles/shop_drive.hpp) under their own controllers at 8 kHz.
//
// Every record has the same end, long after the place where a fault comes: a cut with chatter in
// it, then the axis runs into something.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "detection/learned_machine.hpp"
#include "oracles/drive_plant.hpp"
#include "oracles/shop_drive.hpp"
#include "servosense/hal/row_source.hpp"
#include "servosense/hal/sample_source.hpp"

namespace faults {

using namespace servosense;
using oracle::kPi;
using oracle::Motion;
using oracle::ShopDrive;

inline constexpr double kPlantRate_hz = 8000;
inline constexpr int kTeeth = 3;
inline constexpr double kSpeed_rad_s = 314;  // of the cut: 20 ms a turn
inline constexpr double kNewton_per_A = 300, kNm_per_A = 0.5;
inline constexpr double kAxisLimit_A = 40, kSpindleLimit_A = 60;
inline constexpr std::int64_t kCountsPerTurn = 1 << 20;
inline constexpr double kLead_m = 0.016;

// Of every record [s].
inline constexpr double kFault_s = 1.5;       // a fault comes...
inline constexpr double kFaultEnds_s = 1.92;  // ...and is over
inline constexpr double kEntry_s = 2.9;       // the tool enters, where it does not cut all along
inline constexpr double kChatter_s = 3.7, kChatterEnds_s = 4.2;
inline constexpr double kExit_s = 4.4;
inline constexpr double kContact_s = 4.75;
inline constexpr double kEnd_s = 4.95;

/// Speeds that follow one another, with smooth ramps (peak acceleration: twice the mean). Closed
/// form.
class SpeedCourse {
 public:
  struct Change {
    double at_s = 0, ramp_s = 0, to = 0;
  };
  SpeedCourse() = default;
  explicit SpeedCourse(std::vector<Change> changes) : changes_(std::move(changes)) {}

  [[nodiscard]] Motion at(double t) const {
    double x = 0, v = 0, since = 0;
    for (const Change& c : changes_) {
      if (t < c.at_s) break;
      x += v * (c.at_s - since);
      const double rise = c.to - v, w = 2 * kPi;
      if (t < c.at_s + c.ramp_s) {
        const double s = (t - c.at_s) / c.ramp_s;
        return {x + c.ramp_s * (v * s + rise * (s * s / 2 + (std::cos(w * s) - 1) / (w * w))),
                v + rise * (s - std::sin(w * s) / w), rise / c.ramp_s * (1 - std::cos(w * s))};
      }
      x += c.ramp_s * (v + rise / 2);
      v = c.to;
      since = c.at_s + c.ramp_s;
    }
    return {x + v * (t - since), v, 0};
  }

 private:
  std::vector<Change> changes_;
};

enum class State { standing, moving, accelerating, cutting };
inline constexpr std::array kStates = {State::standing, State::moving, State::accelerating,
                                       State::cutting};
[[nodiscard]] constexpr const char* name_of(State s) {
  constexpr const char* kNames[] = {"standing", "moving", "accelerating", "cutting"};
  return kNames[static_cast<int>(s)];
}

/// What the machine does.
struct Course {
  SpeedCourse x, spindle;
  double entry_s = kEntry_s, exit_s = kExit_s;
  double entry2_s = 0, exit2_s = 0;  ///< of a second cut
  double chatter_s = kChatter_s, chatter_ends_s = kChatterEnds_s;
  double contact_s = kContact_s;
  double stiffness_N_m = 1e7, strength_N = 3000;  // of what x runs into
  double end_s = kEnd_s;
};

/// Of x, as its controller has it: never harder than in the idling run.
[[nodiscard]] inline double ramp_s(double speed) { return 0.02 + 0.15 * speed; }

/// `speed` of x where it moves [m/s].
[[nodiscard]] inline Course course_of(State state, double speed = 0.41) {
  Course c;
  using Changes = std::vector<SpeedCourse::Change>;
  Changes x, spindle;
  switch (state) {
    case State::standing:
      spindle.push_back({2.1, 0.4, kSpeed_rad_s});
      break;
    case State::moving:
      x.push_back({0.2, ramp_s(speed), speed});
      spindle.push_back({0.1, 0.4, kSpeed_rad_s});
      break;
    case State::accelerating: {
      // To and fro with 20 m/s2 at the peak, up and down with the spindle.
      double to = 0.4;
      for (double t = 0.2; t < 2.0; t += 0.14, to = -to) x.push_back({t, 0.08, to});
      double fast = 400;
      for (double t = 0.1; t < 2.0; t += 0.25, fast = 600 - fast) spindle.push_back({t, 0.2, fast});
      break;
    }
    case State::cutting:
      c.entry_s = 0.5;
      x.push_back({0.1, 0.05, 0.02});
      spindle.push_back({0.0, 0.3, kSpeed_rad_s});
      break;
  }
  if (state == State::accelerating) spindle.push_back({2.2, 0.2, kSpeed_rad_s});
  if (state != State::cutting) x.push_back({2.5, 0.1, 0.02});
  x.push_back({kExit_s + 0.1, 0.05, 0.1});
  c.x = SpeedCourse(x);
  c.spindle = SpeedCourse(spindle);
  return c;
}

/// In the air: several feeds both ways, several speeds of the spindle.
[[nodiscard]] inline Course idle_course() {
  Course c;
  c.entry_s = c.chatter_s = c.contact_s = 1e9;
  c.exit_s = c.chatter_ends_s = 0;
  std::vector<SpeedCourse::Change> x, spindle;
  double t = 0.3;
  for (const double v : {0.02, 0.1, 0.3, 0.45, 0.83})
    for (const double to : {v, -v, v, -v, 0.0}) {
      x.push_back({t, ramp_s(v), to});
      t += ramp_s(v) + 0.15;
    }
  c.end_s = t;
  double at = 0.1;
  for (const double v : {150.0, kSpeed_rad_s, 500.0, 0.0}) {
    spindle.push_back({at, 0.3, v});
    at += (c.end_s - 0.2) / 4;
  }
  c.x = SpeedCourse(x);
  c.spindle = SpeedCourse(spindle);
  return c;
}

/// A sound part: air, a cut, air.
[[nodiscard]] inline Course sound_course() {
  Course c = course_of(State::moving);
  c.chatter_s = c.contact_s = 1e9;
  c.chatter_ends_s = 0;
  return c;
}

[[nodiscard]] inline ShopDrive axis_drive() {
  ShopDrive d;
  d.stribeck = 0.2, d.ripple = 0.05;
  d.effort_step = kNewton_per_A * 0.005;
  d.effort_limit = kNewton_per_A * kAxisLimit_A;
  d.period_s = 1 / kPlantRate_hz;
  d.count = kLead_m / kCountsPerTurn;
  return d;
}
[[nodiscard]] inline ShopDrive spindle_drive() {
  ShopDrive d;
  d.inertia = 0.004, d.viscous = 4e-4, d.coulomb = 0.2, d.bristle = 1e-3;
  d.stribeck = 0.2, d.stribeck_speed = 5, d.ripple = 0.1, d.ripple_length = 2 * kPi;
  d.position_gain_per_s = 0;
  d.effort_noise = 0.01, d.effort_step = kNm_per_A * 0.005;
  d.effort_limit = kNm_per_A * kSpindleLimit_A;
  d.period_s = 1 / kPlantRate_hz;
  d.count = 2 * kPi / kCountsPerTurn;
  return d;
}

/// Counts and currents of both drives, 8000 a second, exactly as both took place.
struct Plant {
  std::vector<ShopDrive::Sample> x, spindle;

  Plant(const Course& c, unsigned seed) {
    const auto cut_share = [&](double t) {  // the tool goes in and out within three turns
      const auto within = [&](double from, double to) {
        return std::clamp(std::min((t - from) / 0.06, (to - t) / 0.06), 0.0, 1.0);
      };
      return within(c.entry_s, c.exit_s) + within(c.entry2_s, c.exit2_s);
    };
    // Torque of teeth over a third of their way [Nm].
    const auto torque = [&](double t) {
      const double share = cut_share(t);
      if (share <= 0) return 0.0;
      double sum = 0;
      for (int k = 0; k < kTeeth; ++k) {
        const double phi = std::fmod(c.spindle.at(t).x + 2 * kPi * k / kTeeth, 2 * kPi);
        if (phi < 2 * kPi / 3) sum += 2.5 * std::sin(1.5 * phi);
      }
      return share * sum;
    };
    const auto vibration = [&](double t) {
      if (t < c.chatter_s || t > c.chatter_ends_s) return 0.0;
      const double grown = std::min(1.0, std::exp((t - c.chatter_s - 0.1) / 0.03));
      return 0.8 * grown * std::sin(2 * kPi * 227 * t);
    };
    const double wall_m = c.contact_s < c.end_s ? c.x.at(c.contact_s).x : 1e9;
    bool held = true;
    const auto x_load = [&](double t, double at, double) {
      double load = 40 * torque(t);  // a tool of 25 mm, half of it along x
      if (t > c.contact_s - 0.1 && at > wall_m && held) {
        const double push = c.stiffness_N_m * (at - wall_m);
        held = push < c.strength_N;
        load += push;
      }
      return load;
    };
    x = axis_drive().run(
        c.end_s, 2 * seed, [&](double t) { return c.x.at(t); }, x_load);
    spindle = spindle_drive().run(
        c.end_s, 2 * seed + 1, [&](double t) { return c.spindle.at(t); },
        [&](double t, double, double) { return torque(t) + vibration(t); });
  }
};

/// How the drives report.
struct Reporting {
  int divider = 1;        ///< rows of the plant for one that is reported: 8000 / divider Hz
  int current_every = 1;  ///< rows per current update
  bool repeated = false;  ///< between updates the last value stands again, else nothing

  [[nodiscard]] double rate_hz() const { return kPlantRate_hz / divider; }
  [[nodiscard]] double period_s() const { return divider / kPlantRate_hz; }
  [[nodiscard]] Nanoseconds period_ns() const { return 125'000LL * divider; }
  [[nodiscard]] std::string text() const {
    std::string s = std::to_string(static_cast<int>(rate_hz())) + " Hz";
    if (current_every > 1)
      s += ", current 1/" + std::to_string(current_every) + (repeated ? " repeated" : "");
    return s;
  }
};

/// Columns of a row.
enum Column : std::size_t { spindle_counts, spindle_current, x_counts, x_current, kColumns };
inline const std::vector<Signal> kSignals = {{Channel::spindle, Quantity::angle_counts},
                                             {Channel::spindle, Quantity::current_A},
                                             {Channel::x, Quantity::angle_counts},
                                             {Channel::x, Quantity::current_A}};

struct Row {
  std::int64_t taken = 0;  ///< number of the reported row
  Nanoseconds t_ns = 0;
  std::array<TraceField, kColumns> fields;
};
using Rows = std::vector<Row>;

[[nodiscard]] inline Rows rows_of(const Plant& plant, const Reporting& r) {
  Rows rows;
  rows.reserve(plant.x.size() / static_cast<std::size_t>(r.divider) + 1);
  Row row;
  for (std::size_t i = 0; i < plant.x.size(); i += static_cast<std::size_t>(r.divider)) {
    row.taken = static_cast<std::int64_t>(rows.size());
    row.t_ns = row.taken * r.period_ns();
    row.fields[spindle_counts] = TraceField::of_counts(plant.spindle[i].counts & 0xffffffff);
    row.fields[x_counts] = TraceField::of_counts(plant.x[i].counts & 0xffffffff);
    if (row.taken % r.current_every == 0) {
      row.fields[spindle_current] = TraceField::of(plant.spindle[i].effort / kNm_per_A);
      row.fields[x_current] = TraceField::of(plant.x[i].effort / kNewton_per_A);
    } else if (!r.repeated) {
      row.fields[spindle_current] = row.fields[x_current] = TraceField::none();
    }
    rows.push_back(row);
  }
  return rows;
}

/// Rows at hand as a source; knows which it has given last.
class RowList final : public RowSource {
 public:
  explicit RowList(const Rows& rows, std::size_t from = 0) : rows_(rows), at_(from) {}
  [[nodiscard]] const std::vector<Signal>& signals() const override { return kSignals; }
  Expected<bool> next(TraceRow& row) override {
    if (at_ == rows_.size()) return false;
    const Row& r = rows_[at_++];
    // What a reader takes is sorted.
    last_ns_ = std::max(r.t_ns, last_ns_ + 1);
    row.t_ns = last_ns_;
    row.fields.assign(r.fields.begin(), r.fields.end());
    return true;
  }
  /// Row of the record that was given last.
  [[nodiscard]] std::int64_t taken() const { return at_ == 0 ? -1 : rows_[at_ - 1].taken; }

 private:
  const Rows& rows_;
  std::size_t at_ = 0;
  Nanoseconds last_ns_ = std::numeric_limits<Nanoseconds>::min() / 2;
};

[[nodiscard]] inline StackSignals signals_of(const Reporting& r) {
  StackSignals s;
  s.sample_period_s = r.period_s();
  s.spindle = s.axis[0] = DriveSignal{MotionKind::counts, EffortKind::current_A};
  return s;
}

/// What its owner writes down; the rest is learned.
[[nodiscard]] inline MachineFile machine_of(const Reporting& r) {
  MachineFile f = detection::good(
      MachineFile::parse("[machine]\nname = test bed\n[tool]\nteeth = 3\ndiameter_m = 0.025\n",
                         "bed.ini"),
      "machine");
  const double update_hz = r.rate_hz() / r.current_every;
  f.set("machine", "sample_rate_hz", r.rate_hz());
  f.set("spindle", "torque_constant_Nm_per_A", kNm_per_A);
  f.set("spindle", "inertia_kg_m2", 0.004);
  f.set("spindle", "friction_knee_rad", 1e-3);
  f.set("spindle", "encoder_counts_per_rev", static_cast<double>(kCountsPerTurn));
  f.set("spindle", "counter_bits", 32);
  f.set("spindle", "current_update_hz", update_hz);
  f.set("controller.spindle", "current_limit_A", kSpindleLimit_A);
  f.set("axis.x", "lead_m", kLead_m);
  f.set("axis.x", "equivalent_mass_kg", 227);
  f.set("axis.x", "friction_knee_m", 5e-6);
  f.set("axis.x", "force_constant_N_per_A", kNewton_per_A);
  f.set("axis.x", "encoder_counts_per_rev", static_cast<double>(kCountsPerTurn));
  f.set("axis.x", "counter_bits", 32);
  f.set("axis.x", "current_update_hz", update_hz);
  f.set("controller.x", "current_limit_A", kAxisLimit_A);
  return f;
}

[[nodiscard]] inline SampleSource source_of(std::unique_ptr<RowSource> rows,
                                            const MachineFile& machine) {
  return detection::good(
      SampleSource::open(std::move(rows), "rows", SampleSource::kMaxFill, column_choices(machine)),
      "source");
}

/// After `identify idle` and `identify collision`.
[[nodiscard]] inline MachineFile learned(const Reporting& r, const Rows& idle, const Rows& sound) {
  const std::string name = r.text();
  MachineFile machine = machine_of(r);
  SampleSource air = source_of(std::make_unique<RowList>(idle), machine);
  ServoSample<double> s;
  machine = detection::learn_idle(
      machine, signals_of(r), kTeeth, idle.size(),
      [&] {
        (void)*air.next(s);
        return s;
      },
      name.c_str());
  CutLearner learner(detection::good(plan_stack(machine, signals_of(r)), name.c_str()).config);
  SampleSource part = source_of(std::make_unique<RowList>(sound), machine);
  while (*part.next(s)) learner.add(s);
  machine.set("monitor.collision", "cutting_threshold_x_N_per_s", learner.threshold(0));
  return machine;
}

}  // namespace faults
