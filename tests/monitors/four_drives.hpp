// Four drives whose efforts follow from their motion in closed form, what a stack reports of them,
// and the faults that a signal may have.
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "koike_stack.hpp"
#include "oracles/drive_plant.hpp"
#include "servosense/core/units.hpp"

namespace four_drives {

using namespace servosense;
using namespace koike;

template <typename Real>
using Stack = MonitorStack<Real, 8, 10, 64>;

template <typename Real>
constexpr const char* precision() {
  return sizeof(Real) == 4 ? "float" : "double";
}

constexpr double kPeriod_s = 125e-6;
constexpr double kSpeed_rad_s = 600, kTorque_Nm = 1.2, kForce_N = 50;
constexpr std::size_t kDrives = 1 + kAxes;  // spindle, x, y, z
constexpr const char* kNames[kDrives] = {"spindle", "x", "y", "z"};

inline MonitorStackConfig config() {
  MonitorStackConfig c = koike::stack_config();
  c.spindle.chatter.chatter_threshold_Nm2 = 0.02;
  c.spindle.chatter.forced_threshold_Nm2 = 0.02;
  for (AxisSlotConfig& a : c.axis)
    a.collision.threshold_N_per_s = a.collision.cutting_threshold_N_per_s = 5000;
  return c;
}

inline const oracle::Reciprocating kMove{0.15, 0.5, 0.12, 0.05};

inline oracle::Motion motion(std::size_t axis, int n) {
  return kMove.at(n * kPeriod_s + 0.11 * static_cast<double>(axis));
}

// First sample at which a drive has moved on from where it was at sample n, twice its friction
// knee.
inline int moved_on(std::size_t drive, int n) {
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

// Twenty time constants after the start: 2 (1/335) s * 10 for the estimate.
constexpr int kSettled = 480;
// Counted travel is up to a count off, 0.3 % of the knee: 0.3 N of x's friction, and some for the
// noise of the counts. y and z report without steps; what is left is discretisation, at 8.3 m/s2.
constexpr double kBound[kDrives] = {0.2, 0.5, 0.05, 0.05};  // spindle: 0.11 Nm a line at 20 bits

inline double truth(std::size_t drive) { return drive == 0 ? kTorque_Nm : kForce_N; }

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

inline std::vector<Fault> all_faults() {
  return {
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
}

}  // namespace four_drives
