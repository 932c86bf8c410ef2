// Cuts that chatter and teeth that break, of the second generator (second_machine.hpp): Kienzle
// forces with edges that push more than they cut, uneven pitch, a tool on two springs, chips that
// remember where the tool and each tooth before have been.
//
//   draw(seed)                  machine, tool, structure, cut; its depth is half of what it bears
//   simulate(case, course)      the cut as a controller records it, with the vibration beside
//   idle_run(case)              what its user does first
//
// What a cut bears is found by cutting: the depth at which, growing slowly, vibration sets in.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "detection/second_machine.hpp"

namespace detection::second {

inline constexpr double kForever = 1e9;

struct Tool {
  double radius_m = 0, helix = 0;
  std::vector<double> pitch, runout_m;
  double kc = 0, mc = 0, radial = 0, edge_t = 0, edge_r = 0;  // N, mm
};

struct Mode {
  double hz = 0, damping = 0, mass_kg = 1;
};

struct Case {
  std::uint64_t seed = 0;
  Tool tool;
  double speed_rad_s = 0, feed_m = 0;  // per tooth
  double from_m = 0, to_m = 0;         // width of the cut, across the feed
  std::array<Mode, 2> mode;            // in x and y
  double limit_m = 0;                  // depth that it bears
  std::size_t lost = 0;                // the tooth that breaks, if one does
  Machine machine;

  [[nodiscard]] std::size_t teeth() const { return tool.pitch.size(); }
  [[nodiscard]] double turn_s() const { return kTwoPi / speed_rad_s; }
  [[nodiscard]] double feed_m_s() const { return feed_m * static_cast<double>(teeth()) / turn_s(); }
};

/// What happens in the cut; times count from when the tool is in it for good.
struct Course {
  double cut_s = 1;
  double break_s = kForever;
  double fraction = 1;                                       ///< of the edge that is lost
  double grows_from_s = kForever, grows_until_s = kForever;  ///< from half to...
  double grown = 0.5;                                        ///< ...so many times what it bears
};

/// Chips, forces and the springs that give way to them, from step to step.
class Milling {
 public:
  Milling(const Case& c, double step_s) : c_(c), step_s_(step_s), gone_(c.teeth(), 0.0) {}

  struct Loads {
    double torque_Nm = 0, x_N = 0, y_N = 0;
  };

  /// Spindle angle and speed, way of the feed, depth of cut.
  Loads step(double angle, double speed_rad_s, double feed_m, double depth_m) {
    x_.push_back(feed_m + place_[0]);
    y_.push_back(place_[1]);
    angle_.push_back(angle);
    step_rad_ = speed_rad_s * step_s_;
    Loads sum;
    for (std::size_t i = 0; i < c_.teeth(); ++i) add_tooth(i, angle, depth_m, sum);
    const double force[] = {-sum.x_N, -sum.y_N};
    for (std::size_t k = 0; k < 2; ++k) {
      const Mode& m = c_.mode[k];
      const double w = kTwoPi * m.hz;
      velocity_[k] +=
          step_s_ * (force[k] / m.mass_kg - 2 * m.damping * w * velocity_[k] - w * w * place_[k]);
      place_[k] += step_s_ * velocity_[k];
    }
    return sum;
  }
  void lose(std::size_t tooth, double fraction) { gone_[tooth] = fraction; }
  [[nodiscard]] const std::array<double, 2>& place_m() const { return place_; }

 private:
  static constexpr int kSlices = 6;

  void add_tooth(std::size_t i, double angle, double depth_m, Loads& sum) {
    const Tool& t = c_.tool;
    const std::size_t m = c_.teeth();
    const double slice_m = depth_m / kSlices;
    for (int k = 0; k < kSlices; ++k) {
      const double height = (k + 0.5) / kSlices;
      if (height < gone_[i]) continue;
      const double a = angle + t.pitch[i] - height * depth_m * std::tan(t.helix) / t.radius_m;
      const double ahead = std::cos(a), across = std::sin(a);
      if (ahead <= 0 || t.radius_m * across < c_.from_m || t.radius_m * across > c_.to_m) continue;
      if (x_.back() + t.radius_m * ahead < 0) continue;  // the face of the work
      double chip_m = kForever;
      for (std::size_t before = 1; before <= m; ++before) {
        const std::size_t j = (i + before) % m;  // larger pitch: ahead in the turn
        if (before < m && height < gone_[j]) continue;
        const double lead = before < m ? wrapped(t.pitch[j] - t.pitch[i]) : kTwoPi;
        const auto [x, y] = then(lead);
        chip_m = std::min(chip_m, (x_.back() - x) * ahead + (y_.back() - y) * across +
                                      t.runout_m[i] - t.runout_m[j]);
      }
      if (chip_m <= 0) continue;
      const double h = 1e3 * chip_m, slice = 1e3 * slice_m;
      const double pressure = t.kc * std::pow(h, 1 - t.mc);
      const double tangential = slice * (pressure + t.edge_t);
      const double radial = slice * (t.radial * pressure + t.edge_r);
      sum.torque_Nm += tangential * t.radius_m;
      sum.x_N += tangential * -across + radial * ahead;
      sum.y_N += tangential * ahead + radial * across;
    }
  }
  static double wrapped(double angle) { return angle < 0 ? angle + kTwoPi : angle; }
  // Where the tool was when the spindle had this much less behind it; before the start it stood
  // still. The speed then is not that of now: by that alone a spindle that swings would find less
  // to cut whenever it is fast, and swing up without chips that remember.
  [[nodiscard]] std::pair<double, double> then(double lead_rad) const {
    const double target = angle_.back() - lead_rad;
    double at = static_cast<double>(x_.size() - 1) - lead_rad / step_rad_;
    for (int k = 0; k < 3 && at > 0; ++k) at += (target - between(angle_, at)) / step_rad_;
    return {between(x_, at), between(y_, at)};
  }
  static double between(const std::vector<double>& v, double at) {
    if (!(at > 0)) return v.front();
    const auto last = static_cast<double>(v.size() - 1);
    if (at >= last) return v.back();
    const auto i = static_cast<std::size_t>(at);
    const double f = at - static_cast<double>(i);
    return v[i] + f * (v[i + 1] - v[i]);
  }

  const Case& c_;
  double step_s_;
  std::vector<double> gone_;
  std::vector<double> x_, y_, angle_;
  double step_rad_ = 1;
  std::array<double, 2> place_{}, velocity_{};
};

/// Amplitude of what does not repeat with the revolution, over the last one: half the largest
/// difference from one, two and three revolutions ago.
class Vibration {
 public:
  double add(double angle, const std::array<double, 2>& place_m) {
    const auto bin = static_cast<std::int64_t>(std::floor(angle / kTwoPi * kBins));
    if (bin == bin_) return largest_;
    bin_ = bin;
    const auto at = static_cast<std::size_t>(bin % kBins);
    auto& past = past_[at];
    double apart = 0;
    if (bin >= 4 * kBins)
      for (const auto& p : past)
        apart = std::max({apart, std::abs(place_m[0] - p[0]), std::abs(place_m[1] - p[1])});
    apart_[at] = apart / 2;
    past = {place_m, past[0], past[1]};
    largest_ = *std::max_element(apart_.begin(), apart_.end());
    return largest_;
  }

 private:
  static constexpr std::int64_t kBins = 180;
  std::array<std::array<std::array<double, 2>, 3>, kBins> past_{};
  std::array<double, kBins> apart_{};
  std::int64_t bin_ = -1;
  double largest_ = 0;
};

inline constexpr int kSteps = 6;  // of the cut in a servo period
inline constexpr double kStep_s = kPeriod_s / kSteps;

/// The depth at which vibration passes a tenth of a feed per tooth, growing by `rate_m_s` at
/// constant speed; 0 where it never does up to `most_m`.
inline double bears_m(const Case& c, double most_m, double grows_s) {
  Milling milling(c, kStep_s);
  Vibration vibration;
  const double angle_step = c.speed_rad_s * kStep_s, feed_step = c.feed_m_s() * kStep_s;
  const double in_s = 10 * c.turn_s();
  for (std::int64_t n = 0;; ++n) {
    const double t = static_cast<double>(n) * kStep_s;
    if (t > in_s + grows_s) return 0;
    const double depth = most_m * (0.05 + 0.95 * std::max(0.0, t - in_s) / grows_s);
    const double angle = static_cast<double>(n) * angle_step;
    milling.step(angle, c.speed_rad_s, c.tool.radius_m + static_cast<double>(n) * feed_step, depth);
    const double v = vibration.add(angle, milling.place_m());
    if (t > in_s && v > 0.1 * c.feed_m) return depth;
  }
}

/// What does not repeat with the revolution [feeds per tooth] after 1.5 s at a depth that stays, at
/// constant speed: of a stable cut nothing but what the measure is off by (0.01). Near its limit a
/// cut vibrates for longer than a record lasts before one sees it, and some never reach more.
inline double keeps_vibrating(const Case& c, double depth_m) {
  Milling milling(c, kStep_s);
  Vibration vibration;
  const double angle_step = c.speed_rad_s * kStep_s, feed_step = c.feed_m_s() * kStep_s;
  double most = 0;
  for (std::int64_t n = 0; static_cast<double>(n) * kStep_s < 1.5; ++n) {
    const double angle = static_cast<double>(n) * angle_step;
    milling.step(angle, c.speed_rad_s, c.tool.radius_m + static_cast<double>(n) * feed_step,
                 depth_m);
    const double v = vibration.add(angle, milling.place_m());
    if (static_cast<double>(n) * kStep_s > 1.4) most = std::max(most, v);
  }
  return most / c.feed_m;
}

inline Case draw(std::uint64_t seed) {
  Draw d(seed * 0x2545f4914f6cdd1dU);  // neighbours far apart on the one sequence of numbers
  for (;;) {
    Case c;
    c.seed = seed;
    Tool& t = c.tool;
    t.radius_m = d.scale(4e-3, 12e-3);
    const int teeth = d.whole(2, 6);
    for (int i = 0; i < teeth; ++i)
      t.pitch.push_back(kTwoPi * (i + d.between(-0.02, 0.02)) / teeth);
    t.helix = d.between(0, 0.7);
    c.speed_rad_s = d.scale(0.8, 7) / t.radius_m;
    c.feed_m = t.radius_m * d.between(0.006, 0.015);
    for (int i = 0; i < teeth; ++i) t.runout_m.push_back(c.feed_m * d.between(-0.1, 0.1));
    const double wide = d.scale(0.1, 1) * 2 * t.radius_m;
    c.from_m = d.chance(0.5) ? -t.radius_m : t.radius_m - wide;
    c.to_m = c.from_m + wide;
    t.kc = d.between(500, 2000);
    t.mc = d.between(0.2, 0.3);
    t.radial = d.between(0.2, 0.6);
    t.edge_t = d.between(3, 20);
    t.edge_r = t.edge_t * d.between(0.8, 1.8);
    for (Mode& m : c.mode) {
      m.hz = d.scale(300, 1200);
      m.damping = d.between(0.015, 0.05);
      const double w = kTwoPi * m.hz;
      m.mass_kg = d.scale(3e6, 6e7) / (w * w);
    }
    c.lost = static_cast<std::size_t>(d.whole(0, teeth - 1));
    // At speeds that the chatter monitor hears, and in the work within half a second.
    if (c.speed_rad_s < 125 || t.radius_m / c.feed_m_s() > 0.5) continue;
    c.limit_m = bears_m(c, 1.5 * t.radius_m, std::max(0.6, 60 * c.turn_s()));
    // Deeper than a scratch, and what is half of it is still far from it.
    if (c.limit_m < 0.1 * t.radius_m) continue;
    const double h_mm = 1e3 * c.feed_m;
    const double force = 500 * c.limit_m * (t.kc * std::pow(h_mm, 1 - t.mc) + t.edge_t);
    c.machine = draw_machine(d, force * t.radius_m * d.between(1.5, 10));
    return c;
  }
}

struct Trace {
  Samples samples;
  std::vector<float> vibration_m;
  double in_s = 0;  ///< the tool is in the cut for good
};

inline Trace simulate(const Case& c, const Course& course) {
  Trace t;
  GaussianNoise noise(c.seed * 31 + 2);
  Milling milling(c, kStep_s);
  Vibration vibration;
  auto drive = c.machine.drive;
  const double up_s = 0.3, feeds_s = up_s + 0.3, accelerates_m_s2 = 3;
  const double full = c.feed_m_s();
  double way = -(c.tool.radius_m + 0.15 * full), feed = 0;
  t.in_s = feeds_s + full / accelerates_m_s2 / 2 - way / full;
  const double start = way;
  for (int n = 0; n * kPeriod_s < t.in_s + course.cut_s; ++n) {
    const double now = n * kPeriod_s;
    if (now > feeds_s) feed = std::min(full, feed + accelerates_m_s2 * kPeriod_s);
    way += feed * kPeriod_s;
    const double in = now - t.in_s;
    if (in >= course.break_s) milling.lose(c.lost, course.fraction);
    const double grown = std::clamp(
        (in - course.grows_from_s) / (course.grows_until_s - course.grows_from_s), 0.0, 1.0);
    const double depth = c.limit_m * (0.5 + (course.grown - 0.5) * grown);
    drive[0].control(c.speed_rad_s * std::min(1.0, now / up_s));
    drive[1].control(way - start);
    drive[2].control(0);
    for (int k = 0; k < kSteps; ++k) {
      const auto load =
          milling.step(drive[0].x, std::max(drive[0].v, 1.0), start + drive[1].x, depth);
      drive[0].advance(load.torque_Nm, kStep_s);
      drive[1].advance(load.x_N, kStep_s);
      drive[2].advance(load.y_N, kStep_s);
    }
    ServoSample<double> sample;
    sample.t_ns = static_cast<Nanoseconds>(n) * 125'000;
    sample.spindle = drive[0].report(n, noise);
    sample.axis[0] = drive[1].report(n, noise);
    sample.axis[1] = drive[2].report(n, noise);
    t.samples.push_back(sample);
    t.vibration_m.push_back(static_cast<float>(vibration.add(drive[0].x, milling.place_m())));
  }
  return t;
}

/// Spindle at three speeds, the axes to and fro.
inline Samples idle_run(const Case& c) {
  Samples samples;
  GaussianNoise noise(c.seed * 31 + 1);
  auto drive = c.machine.drive;
  const double hold_s = std::max(0.8, 30 * kTwoPi / (0.4 * c.speed_rad_s));
  double speed = 0, x = 0;
  for (int n = 0; n * kPeriod_s < 3 * hold_s; ++n) {
    const double now = n * kPeriod_s;
    const double wanted = c.speed_rad_s * (0.4 + 0.3 * std::floor(now / hold_s));
    speed = std::min(wanted, speed + c.speed_rad_s * kPeriod_s / 0.3);
    const double into = std::fmod(now, 0.5);
    x += kPeriod_s * (now < hold_s ? 0.1 : 0.02) * (into < 0.2 ? 1 : into < 0.4 ? -1 : 0);
    drive[0].control(speed);
    drive[1].control(x);
    drive[2].control(-x);
    for (int k = 0; k < kSteps; ++k)
      for (Drive& one : drive) one.advance(0, kStep_s);
    ServoSample<double> sample;
    sample.t_ns = static_cast<Nanoseconds>(n) * 125'000;
    sample.spindle = drive[0].report(n, noise);
    sample.axis[0] = drive[1].report(n, noise);
    sample.axis[1] = drive[2].report(n, noise);
    samples.push_back(sample);
  }
  return samples;
}

}  // namespace detection::second
