// Monitor stack on four drives whose efforts follow from their motion in closed form: estimates
// against the force that was put in, faults on every input of every drive, wiring, absent drives.
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "check.hpp"
#include "koike_stack.hpp"
#include "oracles/drive_plant.hpp"
#include "servosense/core/units.hpp"

namespace {

using namespace servosense;
using namespace koike;

template <typename Real>
using Stack = MonitorStack<Real, 8, 10, 64>;

constexpr double kPeriod_s = 125e-6;
constexpr double kSpeed_rad_s = 600, kTorque_Nm = 1.2, kForce_N = 50;
constexpr std::size_t kDrives = 1 + kAxes;  // spindle, x, y, z
constexpr const char* kNames[kDrives] = {"spindle", "x", "y", "z"};

MonitorStackConfig config() {
  MonitorStackConfig c = koike::stack_config();
  c.spindle.chatter.chatter_threshold_Nm2 = 0.02;
  c.spindle.chatter.forced_threshold_Nm2 = 0.02;
  for (AxisSlotConfig& a : c.axis) a.collision.threshold_N_per_s = 5000;
  return c;
}

const oracle::Reciprocating kMove{0.15, 0.5, 0.12, 0.05};

oracle::Motion motion(std::size_t axis, int n) {
  return kMove.at(n * kPeriod_s + 0.11 * static_cast<double>(axis));
}

// First sample at which a drive has moved on from where it was at sample n, twice its friction
// knee.
int moved_on(std::size_t drive, int n) {
  if (drive == 0) return n;
  int later = n;
  while (std::abs(motion(drive - 1, later).x - motion(drive - 1, n).x) < 1e-5) ++later;
  return later;
}

// What the drives report while the spindle turns steadily and the axes go to and fro, each in its
// own phase, against a steady cut.
template <typename Real>
std::vector<ServoSample<Real>> recording(int samples) {
  std::array<oracle::Bristle, kAxes> bristle;
  std::array<double, kAxes> last{};
  std::vector<ServoSample<Real>> all;
  for (int n = 0; n < samples; ++n) {
    ServoSample<Real> s;
    s.t_ns = n * Nanoseconds{125'000};
    s.spindle.counts =
        static_cast<std::int64_t>(std::floor(kSpeed_rad_s * n * kPeriod_s / kTwoPi * (1 << 20)));
    s.spindle.effort =
        static_cast<Real>(kTorque_Nm + kSpindleViscous * kSpeed_rad_s + kSpindleCoulomb_Nm);
    for (std::size_t i = 0; i < kAxes; ++i) {
      const oracle::Motion m = motion(i, n);
      if (n == 0) last[i] = m.x;
      const double friction = kAxis[i].coulomb_N * bristle[i].follow(m.x - last[i]);
      last[i] = m.x;
      s.axis[i].counts = static_cast<std::int64_t>(std::floor(m.x / 0.016 * (1 << 20)));
      s.axis[i].motion = i == 1 ? m.x : m.v;
      s.axis[i].effort = static_cast<Real>(kAxis[i].mass_kg * m.a + kAxis[i].viscous * m.v +
                                           friction + kAxis[i].gravity_N + kForce_N);
    }
    all.push_back(s);
  }
  return all;
}

template <typename Real>
RawDriveSample<Real>& raw(ServoSample<Real>& s, std::size_t drive) {
  return drive == 0 ? s.spindle : s.axis[drive - 1];
}
template <typename Real>
const typename Stack<Real>::Drive& out(const Stack<Real>& stack, std::size_t drive) {
  return drive == 0 ? stack.spindle() : stack.axis(drive - 1);
}

// Follows the reported changes: each must begin where the one before ended, and together they must
// give the states of the stack.
template <typename Real>
struct Mirror {
  std::array<MonitorState, kDrives> state{};
  std::array<MonitorState, kDrives> health = [] {
    std::array<MonitorState, kDrives> h{};
    h.fill(MonitorState::learning);
    return h;
  }();
  bool ok = true;
  int alarms = 0, warnings = 0, changes = 0;

  void follow(std::span<const StateChange<Real>> reported, const Stack<Real>& stack) {
    for (const StateChange<Real>& c : reported) {
      const std::size_t d =
          c.channel == Channel::spindle
              ? 0
              : 1 + static_cast<std::size_t>(c.channel) - static_cast<std::size_t>(Channel::x);
      if (c.monitor == MonitorId::signal) {
        ok = ok && d < kDrives && c.before == health[d] && c.state != c.before;
        if (d < kDrives) health[d] = c.state;
        continue;
      }
      ok = ok && d < kDrives && c.before == state[d] && c.state != c.before &&
           c.monitor == (d == 0 ? MonitorId::chatter : MonitorId::collision);
      if (d >= kDrives) continue;
      state[d] = c.state;
      ++changes;
      alarms += c.state == MonitorState::alarm;
      warnings += c.state == MonitorState::warning;
    }
    for (std::size_t d = 0; d < kDrives; ++d) ok = ok && out(stack, d).state == state[d];
  }
};

template <typename Real>
constexpr const char* precision() {
  return sizeof(Real) == 4 ? "float" : "double";
}

// ---- estimates ---------------------------------------------------------------------------------

// Twenty time constants after the start: 2 (1/335) s * 10 for the estimate.
constexpr int kSettled = 480;
// Counted travel is up to a count off, 0.3 % of the knee: 0.3 N of x's friction, and some for the
// noise of the counts. y and z report without steps; what is left is discretisation, at 8.3 m/s2.
constexpr double kBound[kDrives] = {0.2, 0.5, 0.05, 0.05};  // spindle: 0.11 Nm a line at 20 bits

double truth(std::size_t drive) { return drive == 0 ? kTorque_Nm : kForce_N; }

template <typename Real>
void steady_cut() {
  auto stack = std::make_unique<Stack<Real>>();
  CHECK(Stack<Real>::validate(config()).ok());
  stack->configure(config());
  Mirror<Real> mirror;
  std::array<double, kDrives> worst{};
  int n = 0;
  for (const ServoSample<Real>& s : recording<Real>(16'000)) {
    mirror.follow(stack->process(s), *stack);
    if (++n > 2 * kSettled)
      for (std::size_t d = 0; d < kDrives; ++d)
        worst[d] =
            std::max(worst[d], std::abs(static_cast<double>(out(*stack, d).estimate) - truth(d)));
  }
  for (std::size_t d = 0; d < kDrives; ++d) {
    check::figure(std::string(kNames[d]) + ", " + precision<Real>() + ": off by at most", worst[d],
                  d == 0 ? "Nm" : "N");
    CHECK_BETWEEN(worst[d], 0.0, kBound[d]);
    CHECK(out(*stack, d).state == MonitorState::armed);
  }
  CHECK(mirror.ok && mirror.alarms == 0 && mirror.warnings == 0);
  CHECK(mirror.changes == 2 * kDrives);  // learning, armed
  CHECK(stack->samples() == 16'000);
}

// ---- faults ------------------------------------------------------------------------------------

struct Fault {
  const char* name;
  int length;
  bool motion;  // else effort
  enum Kind { nan, inf, flagged, leap } kind;
  Quality quality;
};

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

template <typename Real>
void spoil(RawDriveSample<Real>& r, const Fault& f) {
  const double wrong = f.kind == Fault::nan ? kNan : kInf;
  Quality& quality = f.motion ? r.motion_quality : r.effort_quality;
  switch (f.kind) {
    case Fault::nan:
    case Fault::inf:
      // Counts cannot be NaN: their source marks them.
      if (f.motion)
        r.motion = wrong;
      else
        r.effort = static_cast<Real>(wrong);
      if (f.motion) quality = Quality::invalid, r.counts += 123'456;
      break;
    case Fault::flagged:
      // Whatever stands beside the flag must not matter.
      quality = f.quality;
      if (f.motion)
        r.motion = -1e9, r.counts = -77;
      else
        r.effort = Real(-1e9);
      break;
    case Fault::leap:
      r.counts += 1 << 18;  // a quarter turn: beyond what the drive can do in a period
      r.motion += 1e3;
      break;
  }
}

template <typename Real>
void faults() {
  const std::vector<Fault> all = {
      {"NaN effort", 1, false, Fault::nan, {}},
      {"Inf effort", 1, false, Fault::inf, {}},
      {"effort missing", 1, false, Fault::flagged, Quality::missing},
      {"effort missing, eight", 8, false, Fault::flagged, Quality::missing},
      {"effort jumps", 1, false, Fault::flagged, Quality::jump},
      {"effort out of order", 1, false, Fault::flagged, Quality::reordered},
      {"effort dead", 200, false, Fault::flagged, Quality::dead_bus},
      {"NaN motion", 1, true, Fault::nan, {}},
      {"Inf motion", 1, true, Fault::inf, {}},
      {"motion missing", 1, true, Fault::flagged, Quality::missing},
      {"motion missing, eight", 8, true, Fault::flagged, Quality::missing},
      {"motion jumps", 1, true, Fault::leap, {}},
      {"motion twice", 1, true, Fault::flagged, Quality::duplicate},
      {"motion lost, nine", 9, true, Fault::flagged, Quality::missing},
      {"motion dead", 200, true, Fault::flagged, Quality::dead_bus},
  };
  constexpr int kSamples = 7000;
  const auto clean = recording<Real>(kSamples);
  std::vector<std::array<Real, kDrives>> reference;
  auto stack = std::make_unique<Stack<Real>>();
  stack->configure(config());
  for (const auto& s : clean) {
    stack->process(s);
    auto& row = reference.emplace_back();
    for (std::size_t d = 0; d < kDrives; ++d) row[d] = out(*stack, d).estimate;
  }
  // x: deceleration, dwell, acceleration, cruise, cruise; z dwells at the last one.
  const std::array<int, 5> starts = {3000, 3400, 3900, 5050, 5400};
  for (std::size_t d = 0; d < kDrives; ++d)
    for (const Fault& f : all)
      for (const int start : starts) {
        stack->configure(config());
        Mirror<Real> mirror;
        bool flagged = true, others = true, finite = true, right = true;
        int good_again = 0;
        double off = 0;
        const int end = start + f.length;
        // After a restart at standstill nobody knows which way friction points until the axis
        // moves.
        const int known = f.length > 8 ? moved_on(d, end) : end;
        for (int n = 0; n < kSamples; ++n) {
          ServoSample<Real> s = clean[static_cast<std::size_t>(n)];
          const bool faulty = n >= start && n < end;
          if (faulty) spoil(raw(s, d), f);
          mirror.follow(stack->process(s), *stack);
          const auto& drive = out(*stack, d);
          const auto& was = reference[static_cast<std::size_t>(n)];
          // Said with the very sample, by the estimate and by the monitor.
          if (faulty)
            flagged = flagged && has(drive.quality, kUnusable | Quality::gap) &&
                      drive.state == MonitorState::signal_fault;
          for (std::size_t k = 0; k < kDrives; ++k) {
            finite = finite && std::isfinite(out(*stack, k).estimate);
            if (k != d)
              others = others && std::bit_cast<std::array<std::byte, sizeof(Real)>>(
                                     out(*stack, k).estimate) ==
                                     std::bit_cast<std::array<std::byte, sizeof(Real)>>(was[k]);
          }
          if (n >= end && drive.state != MonitorState::armed) good_again = n + 1 - end;
          if (n >= known + kSettled)
            off = std::max(off, std::abs(static_cast<double>(drive.estimate) - truth(d)));
          if (n >= end + kSettled)
            right = right && !has(drive.quality, kUnusable | Quality::gap | Quality::settling);
        }
        auto that = [&](bool ok, const char* what) {
          check::that(ok,
                      (std::string(kNames[d]) + ", " + precision<Real>() + ", " + f.name + " at " +
                       std::to_string(start) + ": " + what)
                          .c_str(),
                      __FILE__, __LINE__);
        };
        that(flagged, "flagged with the sample");
        that(finite, "finite");
        that(others, "the other drives do not notice");
        that(right, "good again when the filters have settled");
        that(off <= kBound[d], ("right again, off by " + std::to_string(off)).c_str());
        // Observer and jerk settle one after the other; chatter needs nine revolutions, 84 samples
        // each, behind its observer.
        that(good_again <= (d == 0 ? 1000 : kSettled + 240),
             ("armed again, after " + std::to_string(good_again)).c_str());
        that(mirror.ok, "each change is reported once");
        that(mirror.alarms == 0 && mirror.warnings == 0, "no alarm and no warning");
      }
}

// ---- wiring ------------------------------------------------------------------------------------

// A contact on one axis is that axis's alarm, vibration of the torque is the spindle's; each once.
// Chatter is not judged while the axes speed up or slow down, which ends its alarm: it is raised in
// both stretches of steady feed. Where no axis is known, once.
template <typename Real>
void alarms(bool with_axes) {
  auto stack = std::make_unique<Stack<Real>>();
  MonitorStackConfig c = config();
  for (AxisSlotConfig& axis : c.axis) axis.present = with_axes;
  stack->configure(c);
  const auto clean = recording<Real>(8000);
  std::vector<StateChange<Real>> raised;
  Mirror<Real> mirror;
  for (int n = 0; n < 8000; ++n) {
    ServoSample<Real> s = clean[static_cast<std::size_t>(n)];
    if (n >= 3000 && n < 3032) s.axis[1].effort += static_cast<Real>(40 * (n - 2999));
    if (n >= 4000) s.spindle.effort += static_cast<Real>(std::sin(kTwoPi * 270.0 * n * kPeriod_s));
    const auto changes = stack->process(s);
    mirror.follow(changes, *stack);
    for (const auto& change : changes)
      if (change.state == MonitorState::alarm) raised.push_back(change);
  }
  CHECK(mirror.ok);
  const std::size_t first = with_axes ? 1 : 0;
  CHECK(raised.size() == (with_axes ? 3U : 1U));
  if (raised.size() <= first) return;
  for (std::size_t i = first; i < raised.size(); ++i) {
    CHECK(raised[i].channel == Channel::spindle && raised[i].monitor == MonitorId::chatter);
    CHECK(raised[i].detail == 0 && raised[i].value >= raised[i].threshold);
  }
  if (!with_axes) return;
  CHECK(raised[0].channel == Channel::y && raised[0].monitor == MonitorId::collision);
  CHECK(raised[0].value >= raised[0].threshold && raised[0].threshold == Real(5000));
  CHECK(stack->collision(1).state().alarms == 1 && stack->collision(0).state().alarms == 0);
}

// With cutoffs of its own, the monitor listens to an observer of its own: the chain of blocks put
// together by hand gives the same bits.
template <typename Real>
void own_observer() {
  MonitorStackConfig c = config();
  c.axis[0].observer.disturbance_cutoff_rad_s = 900;
  auto stack = std::make_unique<Stack<Real>>();
  stack->configure(c);
  DriveInput<Real> input;
  DisturbanceObserver<Real> reported, listened;
  auto monitor = std::make_unique<CollisionMonitor<Real>>();
  input.configure(c.axis[0].input);
  reported.configure(c.axis[0].observer);
  listened.configure(c.axis[0].monitor_observer);
  monitor->configure(c.axis[0].collision);
  bool same = true, apart = false;
  for (const auto& s : recording<Real>(4000)) {
    stack->process(s);
    const DriveSample<Real> sample = input.process(s.axis[0]);
    const Real estimate = reported.process(sample);
    const Real force = listened.process(sample);
    monitor->process(force, listened.state().quality);
    same = same && stack->axis(0).estimate == estimate &&
           stack->collision(0).state().jerk_N_per_s == monitor->state().jerk_N_per_s;
    apart = apart || estimate != force;
  }
  CHECK(same);
  CHECK(apart);
}

/// The monitors of the tool hear what they would hear alone, and report every change.
template <typename Real>
void tool_monitors() {
  MonitorStackConfig c = config();
  c.tool.ar_breakage_on = c.tool.tooth_breakage_on = c.tool.drill_fracture_on = c.tool.wear_on =
      true;
  c.tool.ar_breakage.teeth = c.tool.tooth_breakage.teeth = 3;
  c.tool.ar_breakage.noise_Nm = c.tool.tooth_breakage.noise = 0.01;
  c.tool.tooth_breakage.torque = true;
  c.tool.drill_fracture.threshold_N = 5;
  c.tool.wear.cutting_thrust_N = 100;
  c.tool.wear.thrust_limit_N = 500;
  for (std::size_t i = 0; i < 2; ++i) {
    c.axis[i].tool_observer = c.axis[i].monitor_observer;
    c.axis[i].tool_observer.disturbance_cutoff_rad_s = 2500;
    c.axis[i].tool_observer.velocity_cutoff_rad_s = 2500;
  }
  CHECK(Stack<Real>::validate(c).ok());
  auto stack = std::make_unique<Stack<Real>>();
  auto alone = std::make_unique<ToolMonitors<Real, 8>>();
  stack->configure(c);
  alone->configure(c.tool);
  std::array<DriveInput<Real>, kDrives> input;
  std::array<DisturbanceObserver<Real>, kDrives> reported;
  DisturbanceObserver<Real> torque, x, y;
  input[0].configure(c.spindle.input);
  reported[0].configure(c.spindle.observer);
  for (std::size_t i = 0; i < kAxes; ++i) {
    input[i + 1].configure(c.axis[i].input);
    reported[i + 1].configure(c.axis[i].observer);
  }
  torque.configure(c.spindle.monitor_observer);
  x.configure(c.axis[0].tool_observer);
  y.configure(c.axis[1].tool_observer);
  bool same = true;
  int told = 0, expected = 0;
  for (const auto& s : recording<Real>(12000)) {
    for (const StateChange<Real>& change : stack->process(s))
      told += change.channel == Channel::tool;
    const DriveSample<Real> spindle = input[0].process(s.spindle);
    std::array<DriveSample<Real>, kAxes> axis;
    for (std::size_t i = 0; i < kAxes; ++i) axis[i] = input[i + 1].process(s.axis[i]);
    ToolSample<Real> in;
    in.torque_Nm = torque.process(spindle);
    in.level_torque_Nm = reported[0].process(spindle);
    in.turn_angle_rad = spindle.turn_angle_rad;
    in.increment_rad = spindle.increment;
    in.spindle = torque.state().quality;
    in.force_x_N = x.process(axis[0]);
    in.force_y_N = y.process(axis[1]);
    in.lateral = x.state().quality | y.state().quality;
    in.thrust_N = reported[3].process(axis[2]);
    in.feed_m = axis[2].increment;
    in.thrust = reported[3].state().quality;
    alone->process(in, [&](auto&&...) { ++expected; });
    same = same &&
           stack->tool().ar_breakage().state().state == alone->ar_breakage().state().state &&
           stack->tool().tooth_breakage().core().state().value ==
               alone->tooth_breakage().core().state().value &&
           stack->tool().drill_fracture().state().radius_N ==
               alone->drill_fracture().state().radius_N &&
           stack->tool().wear().state().sample == alone->wear().state().sample;
  }
  CHECK(same);
  CHECK(told == expected && expected >= 4);

  // Without room for teeth the monitors of the tool are not there.
  auto bare = std::make_unique<MonitorStack<Real, 8, 10, 1024, 0>>();
  bare->configure(c);
  for (const auto& s : recording<Real>(500))
    for (const auto& change : bare->process(s)) CHECK(change.channel != Channel::tool);
}

template <typename Real>
void absent_drives() {
  const auto all = recording<Real>(2000);
  auto full = std::make_unique<Stack<Real>>();
  auto part = std::make_unique<Stack<Real>>();
  for (unsigned present = 0; present < 1U << kDrives; ++present) {
    MonitorStackConfig c = config();
    c.spindle.present = (present & 1U) != 0;
    for (std::size_t i = 0; i < kAxes; ++i) {
      c.axis[i].present = (present >> (i + 1) & 1U) != 0;
      // What is absent is not looked at.
      if (!c.axis[i].present) c.axis[i].observer.disturbance_cutoff_rad_s = -1;
    }
    CHECK(Stack<Real>::validate(c).ok());
    full->configure(config());
    part->configure(c);
    Mirror<Real> mirror;
    bool same = true;
    for (const auto& s : all) {
      full->process(s);
      mirror.follow(part->process(s), *part);
      for (std::size_t d = 0; d < kDrives; ++d)
        same = same && out(*part, d).estimate ==
                           ((present >> d & 1U) != 0 ? out(*full, d).estimate : Real(0));
    }
    CHECK(same && mirror.ok);
    for (std::size_t d = 0; d < kDrives; ++d)
      CHECK(out(*part, d).state ==
            ((present >> d & 1U) != 0 ? MonitorState::armed : MonitorState::idle));
  }
}

// Reset is as good as new.
template <typename Real>
void reset() {
  auto stack = std::make_unique<Stack<Real>>();
  stack->configure(config());
  const auto all = recording<Real>(3000);
  std::vector<Real> first;
  for (const auto& s : all) {
    stack->process(s);
    for (std::size_t d = 0; d < kDrives; ++d) first.push_back(out(*stack, d).estimate);
  }
  stack->reset();
  CHECK(stack->samples() == 0);
  std::size_t at = 0;
  bool same = true;
  int changes = 0;
  for (const auto& s : all) {
    for (const StateChange<Real>& c : stack->process(s)) changes += c.monitor != MonitorId::signal;
    for (std::size_t d = 0; d < kDrives; ++d) same = same && out(*stack, d).estimate == first[at++];
  }
  CHECK(same);
  CHECK(changes == 2 * static_cast<int>(kDrives));
}

void refusals() {
  auto refused = [](auto change, const char* parameter) {
    MonitorStackConfig c = config();
    change(c);
    const Status s = Stack<float>::validate(c);
    CHECK(!s.ok());
    CHECK_TEXT(s.parameter(), parameter);
  };
  refused([](auto& c) { c.spindle.input.unit_per_count = 0; }, "unit_per_count");
  refused([](auto& c) { c.spindle.chatter.harmonics = 11; }, "harmonics");
  refused([](auto& c) { c.axis[2].observer.disturbance_cutoff_rad_s = 0; },
          "disturbance_cutoff_rad_s");
  refused([](auto& c) { c.axis[1].monitor_observer.velocity_cutoff_rad_s = 16'000; },
          "velocity_cutoff_rad_s");
  refused([](auto& c) { c.axis[0].collision.threshold_N_per_s = kNan; }, "threshold_N_per_s");
}

template <typename Real>
void all() {
  steady_cut<Real>();
  faults<Real>();
  alarms<Real>(true);
  alarms<Real>(false);
  own_observer<Real>();
  tool_monitors<Real>();
  absent_drives<Real>();
  reset<Real>();
}

}  // namespace

int main() {
  all<float>();
  all<double>();
  refusals();
  return check::done();
}
