// A part milled in passes along x, on a machine of the second generator (second_machine.hpp): a
// program, and its runs as the controller reports them. Kienzle forces of teeth that run out and
// are unevenly pitched: what the program's prediction is made from, a linear law without run-out,
// holds of it nowhere exactly.
//
// A pair of rows: a slot, then a side cut beside it, wider or narrower from the middle of the block
// on, where the slot before was. Sound runs have stock, material, overrides and holds within what a
// shop tolerates.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "detection/second_machine.hpp"

namespace detection::passes {

using second::Draw;
using second::kPeriod_s;
using servosense::kTwoPi;

inline constexpr double kNever = 1e9;
inline constexpr double kBlock_m = 0.06;  // along x, from 0
inline constexpr double kRapid_m_s = 0.25, kAccelerates_m_s2 = 3;

/// Along x at y, from `from_m` on. Beyond the block there is air.
struct Pass {
  double y_m = 0, depth_m = 0;
  /// What is uncut, across the feed, left of it positive: in the first half and the second.
  std::array<std::array<double, 2>, 2> uncut_m{};
  int line = 0;
};

struct Part {
  std::uint64_t seed = 0;
  double radius_m = 0, helix = 0, speed_rad_s = 0, feed_m = 0;  // a tooth
  std::vector<double> pitch, runout_m;
  double kc = 0, mc = 0, radial = 0, edge_t = 0, edge_r = 0;  // N, mm
  double stands_off_m = 0;                                    // of passes, before and behind
  std::vector<Pass> passes;
  second::Machine machine;

  [[nodiscard]] std::size_t teeth() const { return pitch.size(); }
  [[nodiscard]] double feed_m_s() const {
    return feed_m * static_cast<double>(teeth()) * speed_rad_s / kTwoPi;
  }
  [[nodiscard]] double chip_N(double h_mm) const {  // of a millimetre of edge
    return kc * std::pow(h_mm, 1 - mc);
  }
};

/// `larger`: of the cutter; 1 is an end mill of 8 to 20 mm.
inline Part draw(std::uint64_t seed, double larger = 1) {
  Draw d(seed * 0x2545f4914f6cdd1dU + 9'000'000);
  Part p;
  p.seed = seed;
  p.radius_m = larger * d.scale(4e-3, 10e-3);
  const int teeth = d.whole(2, 5);
  for (int i = 0; i < teeth; ++i) p.pitch.push_back(kTwoPi * (i + d.between(-0.02, 0.02)) / teeth);
  p.helix = d.between(0, 0.7);
  p.speed_rad_s = d.scale(1.5, 5) / p.radius_m;
  p.feed_m = p.radius_m * d.between(0.006, 0.012);
  // Passes of 4 to 8 s.
  p.speed_rad_s = std::clamp(p.speed_rad_s, 0.012 / p.feed_m_s() * p.speed_rad_s,
                             0.024 / p.feed_m_s() * p.speed_rad_s);
  for (int i = 0; i < teeth; ++i) p.runout_m.push_back(p.feed_m * d.between(-0.1, 0.1));
  p.kc = d.between(600, 1800);
  p.mc = d.between(0.2, 0.3);
  p.radial = d.between(0.2, 0.6);
  p.edge_t = d.between(3, 15);
  p.edge_r = p.edge_t * d.between(0.8, 1.8);
  p.stands_off_m = p.radius_m + 1.2 * p.feed_m_s();
  const double r = p.radius_m;
  int line = 2;
  for (int pair = 0; pair < 2; ++pair) {
    const double y = 4 * r * pair, depth = r * d.between(0.15, 0.5);
    const double aside = r * d.between(0.3, 1.6), side = d.chance(0.5) ? 1 : -1;
    Pass slot{y, depth, {{{-r, r}, {-r, r}}}, line += 5};
    p.passes.push_back(slot);
    // What the slot has left, on the side to which the cutter moves.
    const std::array<double, 2> left =
        side > 0 ? std::array{r - aside, r} : std::array{-r, aside - r};
    p.passes.push_back({y + side * aside, depth, {left, left}, line += 5});
  }
  const double h_mm = 1e3 * p.feed_m;
  const double force = 500 * r * (p.chip_N(h_mm) + p.edge_t);
  p.machine = second::draw_machine(d, force * r * d.between(2, 6));
  return p;
}

inline std::string program_of(const Part& p) {
  char text[200];
  std::snprintf(text, sizeof text, "G21 G90 G17 G61\nS%.3f M3\nG0 Z5\n",
                p.speed_rad_s * 60 / kTwoPi);
  std::string all = text;
  for (const Pass& pass : p.passes) {
    std::snprintf(text, sizeof text, "G0 X%.4f Y%.4f\nG0 Z%.4f\nG4 P0.2\nG1 X%.4f F%.4f\nG0 Z5\n",
                  -1e3 * p.stands_off_m, 1e3 * pass.y_m, -1e3 * pass.depth_m,
                  1e3 * (kBlock_m + p.stands_off_m), 6e4 * p.feed_m_s());
    all += text;
  }
  return all + "M2\n";
}
inline std::string stock_of(const Part& p) {
  char text[160];
  const double r = p.radius_m;
  std::snprintf(text, sizeof text, "--stock box:0,%.5f,%.5f,%.5f,%.5f,0", -3 * r, -r, kBlock_m,
                8 * r);
  return text;
}

/// The linear law through two chips of the true one, N and mm.
struct Linear {
  double slope = 0, rest = 0;
};
inline Linear linear_law(const Part& p) {
  const double fine = 0.35, coarse = 0.9;  // of the feed
  const double low = p.chip_N(fine * 1e3 * p.feed_m), high = p.chip_N(coarse * 1e3 * p.feed_m);
  const double slope = (high - low) / ((coarse - fine) * 1e3 * p.feed_m);
  return {slope, low - slope * fine * 1e3 * p.feed_m};
}

/// What a shop writes of tool and material: its coefficients are off by 5 %, radial ones by 20.
inline void tell_tool(const Part& p, servosense::MachineFile& f, std::uint64_t seed) {
  Draw d(seed * 77 + 5);
  const auto [slope, rest] = linear_law(p);
  const double off = d.between(0.95, 1.05), off_radial = d.between(0.8, 1.2);
  f.set("tool", "diameter_m", 2 * p.radius_m);
  f.set("tool", "teeth", static_cast<int>(p.teeth()));
  f.set("tool", "helix_deg", p.helix * 360 / kTwoPi);
  f.set("tool", "flute_length_m", 6 * p.radius_m);
  f.set("tool", "tangential_coefficient_N_per_m2", 1e6 * slope * off);
  f.set("tool", "tangential_edge_N_per_m", 1e3 * (rest + p.edge_t) * off);
  f.set("tool", "radial_ratio", p.radial * off_radial);
  f.set("tool", "radial_edge_N_per_m", 1e3 * (p.radial * rest + p.edge_r) * off_radial);
  f.set("tool", "tangential_coefficient_relative_error", 0.05);
  f.set("cut", "axial_depth_m", p.passes[0].depth_m);
  f.set("cut", "direction", "slot");
  f.set("cut", "feed_per_tooth_m", p.feed_m);
  f.set("cut", "spindle_speed_rpm", p.speed_rad_s * 60 / kTwoPi);
  f.set("monitor.cutting-coefficients", "teach_slots", 20);
  for (const char* axis : {"axis.x", "axis.y", "axis.z"}) {
    f.set(axis, "max_velocity_m_s", kRapid_m_s);
    f.set(axis, "max_acceleration_m_s2", kAccelerates_m_s2);
  }
}

struct Course {
  bool in_air = false;  ///< no stock at all
  double harder = 1;
  double stock_m = 0;  ///< by which it stands higher, farther out and along
  double slower_from_s = kNever, slower = 1;
  std::size_t hold_pass = 99;  ///< feed hold in the middle of it
  // Faults; of a pass, at a place of x.
  std::size_t pass = 99;
  double at_m = 0;
  enum class Fault { none, tooth, contact, clamp } fault = Fault::none;
  double stiffness = 0, gives_way_N = 0;  ///< of a contact
  std::size_t lost = 0;
  double goes_on_s = kNever;  ///< after the fault
};

struct Trace {
  second::Samples samples;
  double event_s = kNever;  ///< the fault
};

class Run {
 public:
  Run(const Part& p, const Course& c)
      : p_(p), c_(c), drive_(p.machine.drive), noise_(p.seed * 31 + (c.in_air ? 1 : 2)) {}

  Trace simulate() {
    for (double t = 0; t < 0.4; t += kPeriod_s)
      sample(p_.speed_rad_s * std::min(1.0, t / 0.3), 2, 1);
    for (double t = 0; t < 0.4; t += kPeriod_s) sample(p_.speed_rad_s, 3, 1);
    if (c_.in_air) to_and_fro();
    for (std::size_t i = 0; i < p_.passes.size() && now_s() < trace_.event_s + c_.goes_on_s; ++i) {
      const Pass& pass = p_.passes[i];
      pass_ = &pass;
      number_ = i;
      cuts_ = false;
      go(-p_.stands_off_m, pass.y_m, kRapid_m_s, pass.line - 3);
      for (double t = 0; t < 0.25; t += kPeriod_s) sample(p_.speed_rad_s, pass.line - 1, 1);
      cuts_ = true;
      go(kBlock_m + p_.stands_off_m, pass.y_m, p_.feed_m_s(), pass.line);
      cuts_ = false;
    }
    for (double t = 0; t < 0.3; t += kPeriod_s) sample(p_.speed_rad_s, pass_->line + 1, 1);
    return std::move(trace_);
  }

 private:
  void to_and_fro() {
    for (const double speed : {0.02, 0.1, kRapid_m_s})
      for (const double end : {0.04, 0.0}) go(end, end, speed, 3);
  }
  void go(double x, double y, double speed, int line) {
    const double dx = x - x_, dy = y - y_, length = std::hypot(dx, dy);
    if (!(length > 0)) return;
    const double from_x = x_, from_y = y_;
    double way = 0, v = 0, held_s = 0;
    while (way < length - 1e-7 && now_s() < trace_.event_s + c_.goes_on_s) {
      const bool slow = now_s() >= c_.slower_from_s && cuts_;
      const bool hold = cuts_ && number_ == c_.hold_pass && x_ > kBlock_m / 2 && held_s < 0.5;
      if (hold) held_s += kPeriod_s;
      const double share = hold ? 0 : slow ? c_.slower : 1;
      const double brakes = std::sqrt(2 * kAccelerates_m_s2 * (length - way));
      const double wanted = std::min({speed * share, brakes});
      const double step = kAccelerates_m_s2 * kPeriod_s;
      v += std::clamp(wanted - v, -step, step);
      way = std::min(length, way + std::max(v, 1e-6) * kPeriod_s);
      x_ = from_x + dx * way / length;
      y_ = from_y + dy * way / length;
      feed_ = v;
      sample(p_.speed_rad_s, line, share);
    }
    x_ = x, y_ = y, feed_ = 0;
  }

  struct Loads {
    double torque_Nm = 0, x_N = 0, y_N = 0;
  };
  // Clockwise, as with M3: angles from the feed, left positive, fall.
  Loads cut(double angle, double x) {
    Loads sum;
    if (c_.in_air || !cuts_) return sum;
    constexpr int kSlices = 5;
    const double depth = pass_->depth_m + c_.stock_m, r = p_.radius_m;
    const std::size_t m = p_.teeth();
    const double per_rad = feed_ / p_.speed_rad_s;
    for (std::size_t i = 0; i < m; ++i) {
      if (broken_ && i == c_.lost) continue;
      for (int k = 0; k < kSlices; ++k) {
        const double lag = depth * (k + 0.5) / kSlices * std::tan(p_.helix) / r;
        const double a = -(angle - p_.pitch[i]) + lag;
        const double ahead = std::cos(a), across = r * std::sin(a);
        if (ahead <= 0 || !solid(x + r * ahead, across)) continue;
        double chip_m = kNever;
        for (std::size_t before = 1; before <= m; ++before) {
          const std::size_t j = (i + m - before) % m;
          if (before < m && broken_ && j == c_.lost) continue;
          double lead = p_.pitch[i] - p_.pitch[j];
          if (lead <= 0) lead += kTwoPi;
          chip_m = std::min(chip_m, per_rad * lead * ahead + p_.runout_m[i] - p_.runout_m[j]);
        }
        if (chip_m <= 0) continue;
        const double chip = p_.chip_N(1e3 * chip_m);
        const double slice = 1e3 * depth / kSlices * c_.harder;
        const double tangential = slice * (chip + p_.edge_t);
        const double radial = slice * (p_.radial * chip + p_.edge_r);
        sum.torque_Nm += tangential * r;
        sum.x_N += tangential * std::sin(a) + radial * std::cos(a);
        sum.y_N += -tangential * std::cos(a) + radial * std::sin(a);
        if (x > kBlock_m + r) happens();
      }
    }
    return sum;
  }
  [[nodiscard]] bool solid(double x, double across) const {
    // A clamp stands in the way behind the block.
    if (c_.fault == Course::Fault::clamp && number_ == c_.pass && x > c_.at_m && x < c_.at_m + 0.02)
      return true;
    if (x < -c_.stock_m || x > kBlock_m + c_.stock_m) return false;
    const auto& uncut = pass_->uncut_m[x > kBlock_m / 2 ? 1 : 0];
    return across >= uncut[0] && across <= uncut[1];
  }
  void happens() {
    if (trace_.event_s == kNever) trace_.event_s = now_s();
  }
  [[nodiscard]] double now_s() const { return static_cast<double>(n_) * kPeriod_s; }

  void sample(double speed, int line, double share) {
    constexpr int kSteps = 4;
    const bool here = cuts_ && number_ == c_.pass && x_ >= c_.at_m;
    if (here && c_.fault == Course::Fault::tooth) {
      broken_ = true;
      happens();
    }
    drive_[0].control(speed);
    drive_[1].control(x_);
    drive_[2].control(y_);
    for (int k = 0; k < kSteps; ++k) {
      Loads load = cut(drive_[0].x, drive_[1].x);
      if (here && c_.fault == Course::Fault::contact && !gone_) {
        const double force = c_.stiffness * (drive_[1].x - c_.at_m);
        if (force > 0) {
          happens();
          gone_ = force > c_.gives_way_N;
          load.x_N += force;
        }
      }
      const double step = kPeriod_s / kSteps;
      drive_[0].advance(load.torque_Nm, step);
      drive_[1].advance(load.x_N, step);
      drive_[2].advance(load.y_N, step);
    }
    servosense::ServoSample<double> s;
    s.t_ns = static_cast<servosense::Nanoseconds>(n_) * 125'000;
    s.nc_block = line;
    s.feed_override = share;
    s.spindle = drive_[0].report(static_cast<int>(n_), noise_);
    s.axis[0] = drive_[1].report(static_cast<int>(n_), noise_);
    s.axis[1] = drive_[2].report(static_cast<int>(n_), noise_);
    trace_.samples.push_back(s);
    ++n_;
  }

  const Part& p_;
  Course c_;
  std::array<second::Drive, 3> drive_;
  servosense::GaussianNoise noise_;
  Trace trace_;
  const Pass* pass_ = nullptr;
  std::size_t number_ = 0;
  bool cuts_ = false, broken_ = false, gone_ = false;
  double x_ = 0, y_ = 0, feed_ = 0;
  std::size_t n_ = 0;
};

inline Trace simulate(const Part& p, const Course& c) { return Run(p, c).simulate(); }

/// The machine's file with what a run of the program in the air has taught, and the tool.
inline servosense::MachineFile learned(const Part& p) {
  Course air;
  air.in_air = true;
  servosense::MachineFile f =
      second::learned(p.machine, simulate(p, air).samples, static_cast<unsigned>(p.teeth()));
  tell_tool(p, f, p.seed);
  return f;
}

}  // namespace detection::passes
