// Runs of a part program as a spindle and its feed axes see them: torque written down along the
// path, friction, noise, overrides, pauses, gaps. Nothing of the library's simulators is in it.
//
// A program is a list of tools; a tool is a list of straight moves with a programmed feed. Cutting
// torque of a move at way x: level * ramps(x) * (0.85 f + 0.15) with f the feed's share of the
// programmed one (torque grows with feed, less than in proportion: Bertok 1984, eq. 4.1).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "servosense/core/quality.hpp"
#include "servosense/core/units.hpp"
#include "servosense/sim/gaussian_noise.hpp"

namespace taught_programs {

using servosense::GaussianNoise;
using servosense::kTwoPi;
using servosense::Quality;

constexpr double kPeriod_s = 1e-3;
constexpr double kRapid_m_s = 0.3;

struct Move {
  double length_m = 0, feed_m_s = 0;
  double torque_Nm = 0;  ///< of the cut at the programmed feed; 0 = air
  double ramp_m = 0;     ///< in which the cut begins and ends
  double angle = 0;      ///< in the plane of the axes
};
struct Tool {
  std::int32_t block = 0;
  double speed_rad_s = 0;
  std::vector<Move> moves;
};
struct Program {
  std::vector<Tool> tools;
  double coulomb_Nm = 0;       ///< of the spindle
  double highest_Nm = 0;       ///< torque of a cut
  double level_deviation = 0;  ///< standard, of a cut's torque from run to run
  double run_deviation = 0;    ///< the same of all cuts of a run together
  int teeth = 4;
};

inline double between(GaussianNoise& random, double a, double b) {
  return a + (b - a) * random.uniform();
}

/// Three to six tools, each with one to three cuts of 0.8 s or more.
inline Program draw(std::uint64_t seed) {
  GaussianNoise random(seed * 16 + 1);
  Program p;
  p.level_deviation = between(random, 0.01, 0.03);
  p.run_deviation = between(random, 0, 0.02);
  p.teeth = 2 + static_cast<int>(between(random, 0, 5));
  const int tools = 3 + static_cast<int>(between(random, 0, 4));
  for (int t = 0; t < tools; ++t) {
    Tool tool;
    tool.block = 10 * (t + 1);
    tool.speed_rad_s = servosense::rad_s_from_rpm(between(random, 900, 4000)) *
                       (random.uniform() < 0.2 ? -1.0 : 1.0);
    double level = between(random, 4, 20);
    tool.moves.push_back({between(random, 0.03, 0.1), kRapid_m_s, 0, 0, between(random, 0, 6)});
    for (int cuts = 1 + static_cast<int>(between(random, 0, 3)); cuts > 0; --cuts) {
      const double feed = between(random, 0.003, 0.015), angle = between(random, 0, 6);
      tool.moves.push_back({between(random, 0.0008, 0.004), feed, 0, 0, angle});
      tool.moves.push_back({std::max(0.006, feed * between(random, 0.9, 3)), feed, level,
                            between(random, 0.0005, 0.002), angle});
      p.highest_Nm = std::max(p.highest_Nm, level);
      tool.moves.push_back({0.001, feed, 0, 0, angle});
      if (random.uniform() < 0.5)
        tool.moves.push_back({between(random, 0.01, 0.04), kRapid_m_s, 0, 0, angle + 2});
      level = between(random, 4, 20);
    }
    tool.moves.push_back({between(random, 0.03, 0.1), kRapid_m_s, 0, 0, between(random, 0, 6)});
    p.tools.push_back(tool);
  }
  p.coulomb_Nm = p.highest_Nm * between(random, 0.05, 0.15);
  return p;
}

/// What happens to a run beside what always does (levels, friction, noise, times of tool changes).
struct Events {
  bool override_reported = false;    ///< somebody turns the knob, and the controller says so...
  bool override_unreported = false;  ///< ...or does not
  bool holds = false;                ///< feed hold, the spindle turning
  bool holds_reported = true;        ///< by an override of 0
  bool gaps = false;                 ///< of the record
  std::size_t from_tool = 0;         ///< the program is started with this one
  // The fault: the cut that `cut` counts, from the first tool on, or all of one tool.
  int cut = -1;
  int tool = -1;
  double torque = 1;
};

struct Sample {
  servosense::Nanoseconds t_ns = 0;
  double torque_Nm = 0;  ///< of the spindle, as its observer has it
  double friction_Nm = 0;
  double increment_rad = 0;
  std::array<double, 3> way_m{};
  double feed_override = 1;
  std::int32_t block = 0;
  Quality quality = Quality::good;
};

/// Cuts of the program: which tool has it and how long it lasts at the programmed feed.
struct CutPlace {
  std::size_t tool = 0;
  double seconds = 0;
};
inline std::vector<CutPlace> cuts_of(const Program& p) {
  std::vector<CutPlace> out;
  for (std::size_t t = 0; t < p.tools.size(); ++t)
    for (const Move& m : p.tools[t].moves)
      if (m.torque_Nm > 0) out.push_back({t, m.length_m / m.feed_m_s});
  return out;
}

class Runner {
 public:
  Runner(const Program& p, const Events& e, std::uint64_t seed)
      : p_(p), e_(e), random_(seed * 16 + 7) {}

  std::vector<Sample> run() {
    friction_ = 0.03 * p_.coulomb_Nm * random_.next();  // warmer or colder than it was identified
    noise_ = p_.highest_Nm * between(random_, 0.01, 0.04);
    common_ = p_.run_deviation * random_.next();
    stock_m_ = between(random_, -0.0003, 0.0003);  // by which the work lies elsewhere
    int cut = 0;
    for (std::size_t t = 0; t < p_.tools.size(); ++t) {
      const Tool& tool = p_.tools[t];
      if (t < e_.from_tool) {
        for (const Move& m : tool.moves) cut += m.torque_Nm > 0;
        continue;
      }
      block_ = tool.block;
      stand(between(random_, 0.2, 0.8));  // tool change
      spin_to(tool.speed_rad_s);
      turn(0.1);
      for (const Move& m : tool.moves) {
        double gain = 1 + common_ + p_.level_deviation * random_.next();
        if (m.torque_Nm > 0) {
          if (cut == e_.cut || static_cast<int>(t) == e_.tool) gain *= e_.torque;
          ++cut;
        }
        move(m, gain);
      }
      turn(0.1);
      spin_to(0);
    }
    return std::move(out_);
  }

 private:
  void sample(double torque, double feed, double angle) {
    const double step = speed_ * kPeriod_s;
    angle_ += step;
    Sample s;
    const double sense = speed_ < 0 ? -1 : 1;
    // At rest the motor is slack or holds against anything up to its friction.
    const double turning =
        std::abs(speed_) > 0.5
            ? sense * (torque * (1 + 0.1 * std::sin(angle_) + 0.3 * std::sin(p_.teeth * angle_)) +
                       friction_)
            : rest_;
    s.torque_Nm = turning + noise_ * random_.next();
    s.friction_Nm = sense * p_.coulomb_Nm;
    s.increment_rad = step;
    position_[0] += feed * kPeriod_s * std::cos(angle);
    position_[2] += feed * kPeriod_s * std::sin(angle);
    for (std::size_t i = 0; i < 3; ++i) {
      // Counts of a micrometre, and half of one of noise.
      const double counted = std::floor(position_[i] * 1e6 + 0.5 * random_.next()) * 1e-6;
      s.way_m[i] = counted - counted_[i];
      counted_[i] = counted;
    }
    s.t_ns = servosense::nanoseconds_from(static_cast<double>(++count_) * kPeriod_s);
    s.feed_override = hold_left_ > 0 && e_.holds_reported ? 0.0
                      : e_.override_reported              ? override_
                                                          : 1.0;
    s.block = block_;
    if (gap_left_ > 0) {
      --gap_left_;
      was_gap_ = true;
      return;  // nobody hears it
    }
    if (was_gap_) s.quality = Quality::gap | Quality::restarted;
    was_gap_ = false;
    out_.push_back(s);
  }
  void stand(double seconds) {
    rest_ = between(random_, -1, 1) * p_.coulomb_Nm;
    for (int n = static_cast<int>(seconds / kPeriod_s); n > 0; --n) sample(0, 0, 0);
  }
  void turn(double seconds) {
    for (int n = static_cast<int>(seconds / kPeriod_s); n > 0; --n) sample(0, 0, 0);
  }
  void spin_to(double speed) {
    const double change = 400 * kPeriod_s;
    // What inertia the observer does not know.
    const double lag = between(random_, -0.3, 0.3) * p_.highest_Nm;
    while (speed_ != speed) {
      speed_ += std::clamp(speed - speed_, -change, change);
      sample(lag, 0, 0);
    }
  }
  void move(const Move& m, double gain) {
    double x = 0;
    while (x < m.length_m) {
      if ((e_.override_reported || e_.override_unreported) && random_.uniform() < 3e-4)
        override_ = between(random_, 0.5, 1.2);
      if (e_.holds && random_.uniform() < 1.5e-4) hold_left_ = between(random_, 0.5, 3);
      if (e_.gaps && random_.uniform() < 1e-4)
        gap_left_ = static_cast<int>(between(random_, 100, 800));
      double wanted = m.feed_m_s * (m.feed_m_s == kRapid_m_s ? 1 : override_);
      if (hold_left_ > 0) hold_left_ -= kPeriod_s, wanted = 0;
      feed_ += std::clamp(wanted - feed_, -3 * kPeriod_s, 3 * kPeriod_s);  // 3 m/s2
      x += feed_ * kPeriod_s;
      double ramp = 0;
      if (m.torque_Nm > 0 && m.ramp_m > 0)
        ramp = std::clamp(std::min(x - stock_m_, m.length_m + 0.0005 - x) / m.ramp_m, 0.0, 1.0);
      const double share = feed_ / m.feed_m_s;
      sample(share > 0 ? m.torque_Nm * gain * ramp * (0.85 * share + 0.15) : 0.0, feed_, m.angle);
    }
    feed_ = 0;
  }

  const Program& p_;
  Events e_;
  GaussianNoise random_;
  std::vector<Sample> out_;
  double friction_ = 0, noise_ = 0, common_ = 0, stock_m_ = 0, rest_ = 0;
  double speed_ = 0, angle_ = 0, feed_ = 0, override_ = 1, hold_left_ = 0;
  std::array<double, 3> position_{}, counted_{};
  std::int32_t block_ = 0;
  int gap_left_ = 0;
  std::uint64_t count_ = 0;
  bool was_gap_ = false;
};

inline std::vector<Sample> run_of(const Program& p, const Events& e, std::uint64_t seed) {
  return Runner(p, e, seed).run();
}

}  // namespace taught_programs
