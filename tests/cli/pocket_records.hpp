// Random cuts with a changing spindle speed, as controllers write them, and where their stable
// speeds truly are. Written from the text books alone (Altintas 2000, ch. 3), on no model of the
// library: teeth that remember the surface which those before them left, a spindle under a PI
// controller, an encoder that counts, a current that comes at a rate of its own.
//
// The truth is the linear cut, the same teeth without leaving the work: its limit depth at every
// speed by bisection on the growth of a disturbance in time. Stable speeds are its maxima.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <numbers>
#include <string>
#include <vector>

#include "blind/draw.hpp"

namespace pocket_records {

inline constexpr double kPi = std::numbers::pi;
inline constexpr double kRate_hz = 8000;

/// One mode in each direction, stepped exactly for a force that is held over the step.
struct Oscillator {
  double hz = 1000, damping = 0.02, mass_kg = 0.1;
  double x = 0, v = 0;

  Oscillator() = default;
  Oscillator(double f, double zeta, double m) : hz(f), damping(zeta), mass_kg(m) {}

  void prepare(double step_s) {
    const double wn = 2 * kPi * hz, s = damping * wn, wd = wn * std::sqrt(1 - damping * damping);
    const double e = std::exp(-s * step_s), c = std::cos(wd * step_s), d = std::sin(wd * step_s);
    xx_ = e * (c + s / wd * d), xv_ = e * d / wd;
    vx_ = -e * wn * wn / wd * d, vv_ = e * (c - s / wd * d);
    compliance_ = 1 / (mass_kg * wn * wn);
  }
  void step(double force_N) {
    const double rest = force_N * compliance_, off = x - rest, speed = v;
    x = rest + xx_ * off + xv_ * speed;
    v = vx_ * off + vv_ * speed;
  }
  /// Where it will be, to the first order of a short time.
  [[nodiscard]] double after(double time_s) const { return x + time_s * v; }
  [[nodiscard]] double energy() const { return x * x + v * v / (4 * kPi * kPi * hz * hz); }

 private:
  double xx_ = 0, xv_ = 0, vx_ = 0, vv_ = 0, compliance_ = 0;
};

struct Tool {
  int teeth = 2;
  double diameter_m = 0.01, immersion_m = 1e-3, feed_m = 8e-5;
  bool down = true;
  double tangential_Pa = 1.5e9, radial_ratio = 0.3;
  Oscillator x, y;

  [[nodiscard]] double arc() const { return std::acos(1 - 2 * immersion_m / diameter_m); }
  /// Angle of a tooth, 0 where an up cut begins and half a turn where a down cut ends.
  [[nodiscard]] double entry() const { return down ? kPi - arc() : 0; }
  [[nodiscard]] double exit() const { return down ? kPi : arc(); }
  [[nodiscard]] double mean_torque_Nm(double depth_m) const {
    return tangential_Pa * depth_m * immersion_m * feed_m * teeth / (2 * kPi);
  }
};

/// Teeth that cut with straight edges and leave a surface. The force of a step is that of its
/// middle, so that no delay of half a step moves the lobes.
class Cut {
 public:
  /// Linear: the teeth do not leave the work, and only what is left by the one before counts.
  Cut(const Tool& tool, double step_s, bool linear)
      : tool_(tool),
        linear_(linear),
        half_step_s_(step_s / 2),
        surface_(kBins + 1, 0.0),
        next_(surface_) {
    tool_.x.prepare(step_s);
    tool_.y.prepare(step_s);
  }
  /// Torque [Nm]; the spindle's `angle` in the middle of the step.
  double step(double angle, double depth_m) {
    const double pitch = 2 * kPi / tool_.teeth;
    const double turn = angle / pitch;
    const double tooth = std::floor(turn);
    // The arc is shorter than the pitch: one tooth is in the work, or none.
    const double phi = (turn - tooth) * pitch + (tool_.down ? kPi - pitch : 0);
    double fx = 0, fy = 0, torque = 0;
    if (phi >= tool_.entry() && phi <= tool_.exit()) {
      const double s = std::sin(phi), c = std::cos(phi);
      const double at = (phi - tool_.entry()) / tool_.arc() * kBins;
      const auto bin = std::min(static_cast<std::size_t>(at), kBins - 1);
      const double share = at - static_cast<double>(bin);
      const double left = surface_[bin] + share * (surface_[bin + 1] - surface_[bin]);
      const double here = tool_.x.after(half_step_s_) * s + tool_.y.after(half_step_s_) * c;
      const double feed = linear_ ? 0 : tool_.feed_m * s;
      double chip = feed + here - left;
      if (!linear_) chip = std::max(0.0, chip);
      // The material ahead has moved on by a feed when the next tooth comes.
      const double leaves = linear_ ? here : std::max(here, left - feed);
      if (cutting_ < 0 || cutting_ != tooth) begin(tooth);
      for (; static_cast<double>(filled_) <= at && filled_ <= kBins; ++filled_) {
        const double since =
            last_at_ < 0 ? 1 : (static_cast<double>(filled_) - last_at_) / (at - last_at_);
        next_[filled_] = last_leaves_ + since * (leaves - last_leaves_);
      }
      last_at_ = at, last_leaves_ = leaves;
      const double ft = tool_.tangential_Pa * depth_m * chip, fr = tool_.radial_ratio * ft;
      fx = -ft * c - fr * s;
      fy = ft * s - fr * c;
      torque = ft * tool_.diameter_m / 2;
    } else if (cutting_ >= 0) {
      finish();
    }
    tool_.x.step(fx);
    tool_.y.step(fy);
    return torque;
  }
  /// Of the vibration, squared.
  [[nodiscard]] double energy() const { return tool_.x.energy() + tool_.y.energy(); }
  /// Most that the last tooth's surface differed from the one before.
  [[nodiscard]] double moved() const { return moved_; }
  void disturb(double by) {
    tool_.x.x = by;
    tool_.y.x = -0.7 * by;
  }
  void scale(double by) {
    for (Oscillator* o : {&tool_.x, &tool_.y}) o->x *= by, o->v *= by;
    for (std::vector<double>* s : {&surface_, &next_})
      for (double& z : *s) z *= by;
  }

 private:
  static constexpr std::size_t kBins = 240;
  void begin(double tooth) {
    if (cutting_ >= 0) finish();
    cutting_ = tooth;
    filled_ = 0;
    last_at_ = -1;
  }
  void finish() {
    for (; filled_ <= kBins; ++filled_) next_[filled_] = filled_ > 0 ? next_[filled_ - 1] : 0;
    moved_ = 0;
    for (std::size_t i = 0; i <= kBins; ++i)
      moved_ = std::max(moved_, std::abs(next_[i] - surface_[i]));
    surface_ = next_;
    cutting_ = -1;
  }

  Tool tool_;
  bool linear_;
  double half_step_s_;
  std::vector<double> surface_, next_;
  double cutting_ = -1;  // the tooth
  double moved_ = 0;
  std::size_t filled_ = kBins + 1;
  double last_at_ = -1, last_leaves_ = 0;  // of the step before, in bins
};

/// Growth of a disturbance of the linear cut, per tooth.
inline double growth(const Tool& tool, double rpm, double depth_m) {
  const double period = 60 / (rpm * tool.teeth);
  const auto steps = static_cast<std::size_t>(
      std::ceil(std::max(50 * std::max(tool.x.hz, tool.y.hz) * period, 120.0)));
  const double step = period / static_cast<double>(steps);
  Cut cut(tool, step, true);
  cut.disturb(1e-6);
  constexpr int kSettle = 60, kLook = 60;
  double log_size = 0, before = 0;
  for (int tooth = 0; tooth < kSettle + kLook; ++tooth) {
    double energy = 0;
    for (std::size_t i = 0; i < steps; ++i) {
      cut.step(2 * kPi / tool.teeth *
                   (tooth + (static_cast<double>(i) + 0.5) / static_cast<double>(steps)),
               depth_m);
      energy = std::max(energy, cut.energy());
    }
    const double size = std::sqrt(energy);
    if (tooth == kSettle - 1) before = log_size + std::log(size);
    if (tooth == kSettle + kLook - 1) return (log_size + std::log(size) - before) / kLook;
    log_size += std::log(size / 1e-6);
    cut.scale(1e-6 / size);
  }
  return 0;
}

/// Limit depth [m] by bisection, to half a per cent; `low` and `high` hold it.
inline double limit_depth(const Tool& tool, double rpm, double low, double high) {
  while (high > 1.005 * low) {
    const double middle = std::sqrt(low * high);
    (growth(tool, rpm, middle) < 0 ? low : high) = middle;
  }
  return std::sqrt(low * high);
}

struct Pocket {
  double rpm = 0, depth_m = 0;
};

struct Truth {
  double least_m = 0;  ///< limit depth at the worst speed
  std::vector<double> rpm, limit_m;
  std::vector<Pocket> pockets;  ///< deeper by a tenth at least than the cut between them
  [[nodiscard]] double limit_at(double speed) const {
    std::size_t i = 1;
    while (i + 1 < rpm.size() && rpm[i] < speed) ++i;
    const double share = (speed - rpm[i - 1]) / (rpm[i] - rpm[i - 1]);
    return limit_m[i - 1] + std::clamp(share, 0.0, 1.0) * (limit_m[i] - limit_m[i - 1]);
  }
};

inline Truth truth_of(const Tool& tool, double from_rpm, double to_rpm, double guess_m) {
  Truth t;
  t.least_m = 1e9;
  for (double rpm = from_rpm; rpm < to_rpm; rpm *= 1.004) {
    t.rpm.push_back(rpm);
    const bool first = t.limit_m.empty();
    const double near = first ? guess_m : t.limit_m.back(), within = first ? 30 : 1.5;
    double low = near / within, high = near * within;
    while (growth(tool, rpm, low) > 0) low /= within;
    while (growth(tool, rpm, high) < 0) high *= within;
    t.limit_m.push_back(limit_depth(tool, rpm, low, high));
    t.least_m = std::min(t.least_m, t.limit_m.back());
  }
  for (std::size_t i = 2; i + 2 < t.rpm.size(); ++i) {
    const auto begin = t.limit_m.begin() + static_cast<std::ptrdiff_t>(i);
    if (t.limit_m[i] < *std::max_element(begin - 2, begin + 3) || t.limit_m[i] < 1.1 * t.least_m)
      continue;
    // A cusp: thirds of the bracket.
    double a = t.rpm[i - 1], b = t.rpm[i + 1];
    const double low = t.limit_m[i] / 1.3, high = t.limit_m[i] * 1.3;
    while (b - a > 2) {
      const double p = a + (b - a) / 3, q = b - (b - a) / 3;
      if (limit_depth(tool, p, low, high) < limit_depth(tool, q, low, high))
        a = p;
      else
        b = q;
    }
    t.pockets.push_back({(a + b) / 2, limit_depth(tool, (a + b) / 2, low, high)});
  }
  return t;
}

enum class Course { falling, rising, stairs, two_falls };
inline const char* name_of(Course c) {
  constexpr std::array names = {"falling", "rising", "stairs", "two falls"};
  return names[static_cast<std::size_t>(c)];
}

struct Record {
  std::uint64_t seed = 0;
  Tool tool;
  Truth truth;
  Course course = Course::falling;
  double depth_m = 0, top_rpm = 0, bottom_rpm = 0, rate_per_s = 0;
  unsigned bits = 20;
  double current_hz = 2000;
  double chatter_share = 0;  ///< of the ramps: displacement of a tenth of the feed that repeats not
  std::string machine, trace, text;
};

namespace detail {

struct Leg {
  double rpm = 0, rate_rpm_s = 0, hold_s = 0;
  bool cuts = false, ramp = false;
};

/// Commanded speed, leg after leg, whether the tool cuts, and whether it is one of the ramps.
inline std::vector<Leg> legs_of(const Record& r, blind::Draw& d) {
  const double rate = r.rate_per_s * (r.top_rpm + r.bottom_rpm) / 2;
  const double fast = d.uniform(8000, 25000);
  const bool rises = r.course == Course::rising;
  const double begin = rises ? r.bottom_rpm : r.top_rpm, end = rises ? r.top_rpm : r.bottom_rpm;
  std::vector<Leg> legs = {{begin, fast, d.uniform(0.15, 0.5)},
                           {begin, fast, d.uniform(0.1, 0.3), true}};
  if (r.course == Course::stairs) {
    // The override is turned by clicks.
    const double click = d.uniform(0.02, 0.05) * begin;
    const double pause = click / rate;
    for (double v = begin - click; v > end; v -= click)
      legs.push_back({v, d.uniform(0.3, 1) * fast, pause, true, true});
  } else {
    legs.push_back({end, rate, d.uniform(0.02, 0.3), true, true});
  }
  legs.push_back({end, fast, d.uniform(0.1, 0.3)});
  if (r.course == Course::two_falls) {
    legs.push_back({begin, fast, d.uniform(0.1, 0.3)});
    legs.push_back({begin, fast, d.uniform(0.1, 0.2), true});
    legs.push_back({end, rate * d.uniform(0.6, 1.6), 0.05, true, true});
    legs.push_back({end, fast, d.uniform(0.1, 0.3)});
  }
  legs.push_back({0, fast, 0.2});
  return legs;
}

inline std::string number(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace detail

/// Everything of a seed but the trace.
inline Record draw_record(std::uint64_t seed) {
  blind::Draw d(seed, "cut");
  Record r;
  r.seed = seed;
  Tool& t = r.tool;
  t.teeth = 2 + static_cast<int>(d.below(3));
  t.diameter_m = 1e-3 * d.uniform(8, 20);
  t.immersion_m = t.diameter_m * d.uniform(0.05, 0.25);
  t.feed_m = d.uniform(5e-5, 1.5e-4);
  t.down = d.chance(0.7);
  t.tangential_Pa = 1e6 * d.uniform(600, 2500);
  t.radial_ratio = d.uniform(0.2, 0.5);
  const double hz = d.uniform(500, 2000), damping = d.uniform(0.01, 0.04);
  t.x = {hz, damping, 1};
  t.y = {d.chance(0.5) ? hz : hz * d.uniform(0.9, 1.1), damping * d.uniform(0.8, 1.25), 1};
  const double base = 60 * hz / t.teeth / d.uniform(4.5, 10), width = d.uniform(0.15, 0.3);
  r.top_rpm = base * (1 + width);
  r.bottom_rpm = base * (1 - width);
  // The limit depth goes with the mass: it is chosen for the depth of cut to be a usual one.
  const double guess =
      2 * damping * std::pow(2 * kPi * hz, 2) / t.tangential_Pa * 2 * kPi / (t.teeth * t.arc());
  r.truth = truth_of(t, 0.9 * r.bottom_rpm, 1.1 * r.top_rpm, guess);
  r.depth_m = t.diameter_m * d.uniform(0.1, 1);
  // One in eight is too shallow to chatter at every speed, or at any.
  const double over_limit = d.chance(0.125) ? d.uniform(0.4, 1.2) : d.uniform(2, 4);
  const double mass = r.depth_m / (over_limit * r.truth.least_m);
  t.x.mass_kg = t.y.mass_kg = mass;
  r.truth.least_m *= mass;
  for (double& m : r.truth.limit_m) m *= mass;
  for (Pocket& p : r.truth.pockets) p.depth_m *= mass;
  const double which = d.unit();
  r.course = which < 0.45   ? Course::falling
             : which < 0.65 ? Course::stairs
             : which < 0.85 ? Course::two_falls
                            : Course::rising;
  r.rate_per_s = d.uniform(0.15, 0.6);
  r.bits = 17 + static_cast<unsigned>(d.below(7));
  constexpr double kCurrent_hz[] = {1000, 2000, 4000, 8000};
  r.current_hz = d.one_of(kCurrent_hz);
  return r;
}

/// Cuts, and writes `machine` and `trace`.
inline void cut_record(Record& r) {
  blind::Draw d(r.seed, "record");
  const Tool& tool = r.tool;
  const double mean_Nm = tool.mean_torque_Nm(r.depth_m);
  const double inertia = d.log_uniform(5e-4, 8e-3);
  const double viscous = inertia * d.uniform(0.05, 0.3), coulomb = d.uniform(0.05, 0.3);
  const double constant = d.uniform(0.3, 0.9);
  const double gain = inertia * 2 * kPi * d.uniform(15, 60) / constant;  // bandwidth of the loop
  const double integral = gain * d.uniform(10, 40);
  const double current_s = 1 / (2 * kPi * d.uniform(600, 1500));
  const double limit_A = (60 + 4 * mean_Nm) / constant, noise_A = limit_A * d.uniform(1e-4, 8e-4);
  const std::vector<detail::Leg> legs = detail::legs_of(r, d);

  const auto fine =
      static_cast<std::size_t>(std::ceil(50 * std::max(tool.x.hz, tool.y.hz) / kRate_hz) + 1);
  const double step = 1 / (kRate_hz * static_cast<double>(fine));
  Cut cut(tool, step, false);
  const double counts = std::ldexp(1.0, static_cast<int>(r.bits));
  const auto held = static_cast<std::size_t>(kRate_hz / r.current_hz);
  const double entry_s = d.uniform(0.02, 0.15);
  double angle = 0, speed = 0, current = 0, wanted = 0, sum = 0, engaged = 0, rpm = 0;
  std::size_t leg = 0, ramp_samples = 0, chatter_samples = 0;
  double hold = 0;
  std::vector<double> last_turn, this_turn;
  r.trace = "t_s,spindle.angle_counts,spindle.current_A\n";
  for (std::size_t n = 0; leg < legs.size(); ++n) {
    const detail::Leg& l = legs[leg];
    const double most = l.rate_rpm_s / kRate_hz;
    rpm += std::clamp(l.rpm - rpm, -most, most);
    if (rpm == l.rpm && (hold += 1 / kRate_hz) > l.hold_s) ++leg, hold = 0;
    const double error = rpm * kPi / 30 - speed;
    sum = std::clamp(sum + integral / kRate_hz * error, -limit_A, limit_A);
    wanted = std::clamp(gain * error + sum, -limit_A, limit_A);
    // Into the work and out of it.
    engaged = std::clamp(engaged + (l.cuts ? 1 : -1) / (entry_s * kRate_hz), 0.0, 1.0);
    for (std::size_t i = 0; i < fine; ++i) {
      const double torque = cut.step(angle + step / 2 * speed, engaged * r.depth_m);
      current += step / current_s * (wanted - current);
      const double friction = viscous * speed + (speed > 0.1 ? coulomb : 0);
      speed += step / inertia * (constant * current - friction - torque);
      if (speed < 0) speed = 0;
      angle += step * speed;
    }
    if (l.ramp && engaged == 1) {
      ++ramp_samples;
      if (cut.moved() > 0.1 * tool.feed_m) ++chatter_samples;
    }
    r.trace += detail::number("%.6f,", static_cast<double>(n) / kRate_hz);
    r.trace += detail::number("%.0f,", std::floor(angle / (2 * kPi) * counts));
    if (n % held == 0) r.trace += detail::number("%.5g", current + noise_A * d.normal());
    r.trace += '\n';
  }
  r.chatter_share = ramp_samples > 0
                        ? static_cast<double>(chatter_samples) / static_cast<double>(ramp_samples)
                        : 0;
  const auto key = [&](const char* name, double value) {
    r.machine += name + detail::number(" = %.6g\n", value);
  };
  r.machine = "[machine]\nsample_rate_hz = 8000\n\n[tool]\n";
  key("diameter_m", tool.diameter_m);
  key("teeth", tool.teeth);
  key("tangential_coefficient_N_per_m2", tool.tangential_Pa * d.uniform(0.85, 1.15));
  key("radial_ratio", tool.radial_ratio);
  r.machine += "\n[cut]\n";
  key("spindle_speed_rpm", std::round((r.top_rpm + r.bottom_rpm) / 2));
  key("feed_per_tooth_m", tool.feed_m);
  key("axial_depth_m", r.depth_m);
  key("radial_immersion_m", tool.immersion_m);
  r.machine += std::string("direction = ") + (tool.down ? "down" : "up") + "\n\n[spindle]\n";
  key("torque_constant_Nm_per_A", constant);
  key("inertia_kg_m2", inertia * d.uniform(0.97, 1.03));
  key("viscous_friction_Nm_s_per_rad", viscous);
  key("coulomb_friction_Nm", coulomb);
  key("encoder_counts_per_rev", counts);
  key("current_update_hz", r.current_hz);
  char text[300];
  std::snprintf(
      text, sizeof text,
      "%-9s %d teeth, %4.0f and %4.0f Hz, %3.1f x limit, %5.0f to %5.0f rpm at %2.0f %%/s, "
      "%u bits, current at %.0f kHz, %4.2f Nm on %.1e kgm2, chatter %2.0f %%",
      name_of(r.course), tool.teeth, tool.x.hz, tool.y.hz, r.depth_m / r.truth.least_m, r.top_rpm,
      r.bottom_rpm, 100 * r.rate_per_s, r.bits, r.current_hz / 1000, mean_Nm, inertia,
      100 * r.chatter_share);
  r.text = text;
}

}  // namespace pocket_records
