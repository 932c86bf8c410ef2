// Which parts of the signals are a cut, which air, and what a hole took (wear.hpp has the
// equations).
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/monitors/friction_drift.hpp"
#include "servosense/monitors/wear_config.hpp"

namespace servosense {

/// A hole or pass, friction and non-cutting parts removed.
template <RealNumber Real>
struct WearHole {
  Real thrust_N = 0;       ///< mean
  Real torque_Nm = 0;      ///< mean
  Real thrust_peak_N = 0;  ///< highest sample of the counted parts
  Real torque_peak_Nm = 0;
  Real travel_m = 0;        ///< counted
  std::uint32_t parts = 0;  ///< counted
};

/// One part of `part_s`: what is kept for a replay.
template <RealNumber Real>
struct WearPart {
  Real thrust_N = 0;  ///< mean over the good samples
  Real torque_Nm = 0;
  Real travel_m = 0;
  Real turned_rad = 0;
  Real thrust_low_N = 0;
  Real thrust_high_N = 0;
  Real torque_low_Nm = 0;
  Real torque_high_Nm = 0;
  bool usable = false;  ///< enough good samples
};

/// Everything that passes from part to part.
template <RealNumber Real>
struct WearCut {
  static constexpr std::size_t kBuckets = 8;  ///< that the last exit_m of a cut wait in
  enum class Phase : std::uint8_t { air, cutting, in_hole };

  Phase phase = Phase::air;
  bool open = false;         ///< a hole has begun and has no verdict
  bool just_opened = false;  ///< with the last part
  std::uint32_t steady = 0;  ///< parts in a row at steady speed, stops at kSettled
  Real feed_m_s = 0;         ///< of the last part
  Real speed_rad_s = 0;
  Real thrust_N = 0;  ///< of the last part, friction removed
  Real torque_Nm = 0;
  Real cut_m = 0;          ///< fed since the cut began
  Real depth_m = 0;        ///< of the hole, a little more
  Real from_bottom_m = 0;  ///< along the feed
  Real since_cut_s = 0;
  WearHole<Real> hole;      ///< the open one so far
  WearHole<Real> complete;  ///< the last complete one
  /// Newest stretches of the cut, may be its exit; a ring.
  std::array<WearHole<Real>, kBuckets> last{};
  std::uint32_t buckets = 0;
  std::uint32_t newest = 0;
  Real stroke_m = 0;      ///< at feed into the workpiece, cutting or not
  WearPart<Real> lesson;  ///< the last part...
  bool learns = false;    ///< ...if it was air
  bool verdict = false;   ///< `complete` is not judged yet
  typename FrictionDrift<Real>::State friction;
  typename FrictionDrift<Real>::State spindle;
  std::uint64_t short_cuts = 0;   ///< without enough steady travel
  std::uint64_t broken_cuts = 0;  ///< given up for a fault
};

/// Finds cuts and holes part by part, and learns friction in the air.
template <RealNumber Real>
class WearCutFinder {
 public:
  using Cut = WearCut<Real>;
  using Hole = WearHole<Real>;
  using Part = WearPart<Real>;
  using Phase = typename Cut::Phase;
  static constexpr std::size_t kBuckets = Cut::kBuckets;
  static constexpr std::uint32_t kSettled = 2;  ///< steady parts until the observers have settled

  /// Requires validate(c).ok(). part_s: length of a part, a whole number of samples.
  void configure(const WearConfig& c, double part_s) noexcept {
    auto real = [](double x) { return static_cast<Real>(x); };
    part_s_ = real(part_s);
    per_part_s_ = real(1 / part_s);
    direction_ = real(c.feed_direction);
    thrust_level_ = real(c.cutting_thrust_N);
    torque_level_ = real(c.cutting_torque_Nm);
    release_ = real(c.release_fraction);
    fastest_ = real(c.maximum_feed_m_s);
    slowest_ = real(c.maximum_feed_m_s * 1e-3);
    turning_ = real(c.minimum_speed_rad_s);
    steady_ = real(c.steady_fraction);
    const auto slack = [&](double level, double inertia) {
      return inertia > 0 ? real(0.5 * level * part_s / inertia) : Real(0);
    };
    feed_slack_ = slack(c.cutting_thrust_N, c.equivalent_mass_kg);
    speed_slack_ = slack(c.cutting_torque_Nm, c.inertia_kg_m2);
    entry_m_ = real(c.entry_m);
    exit_m_ = real(c.exit_m);
    bucket_m_ = real(c.exit_m / (kBuckets - 1));
    shortest_m_ = real(c.shortest_m);
    clearance_m_ = real(c.clearance_m);
    peck_s_ = real(c.peck_window_s);
    friction_.configure({c.friction_error_N, c.friction_error_N, c.friction_drift_N,
                         c.friction_noise_N, c.maximum_feed_m_s, c.rapid_m_s});
    // Turning one way, a spindle cannot tell an offset from friction.
    spindle_.configure({0, c.spindle_error_Nm, c.spindle_drift_Nm, c.spindle_noise_Nm,
                        c.top_speed_rad_s, c.top_speed_rad_s});
  }
  /// Friction and cuts as at the start.
  void reset(Cut& c) const noexcept {
    c = Cut{};
    friction_.reset(c.friction);
    spindle_.reset(c.spindle);
  }
  /// An unknown time has passed.
  void start_anew(Cut& c) const noexcept {
    give_up(c);
    c.phase = Phase::air;
    c.steady = 0;
    friction_.doubt(c.friction);
    spindle_.doubt(c.spindle);
  }
  /// The cut and the hole it belongs to are not judged.
  void give_up(Cut& c) const noexcept {
    if (c.phase == Phase::cutting || c.open) ++c.broken_cuts;
    if (c.phase == Phase::cutting) c.phase = Phase::in_hole;
    c.open = c.verdict = c.learns = false;
    c.buckets = 0;
    c.depth_m = 0;
  }

  // What the part says: friction, a cut, its hole.
  void segment(Cut& c, const Part& part) const noexcept {
    const Real v = part.travel_m * per_part_s_;
    const Real w = part.turned_rad * per_part_s_;
    const Real feed_change = magnitude(v - c.feed_m_s);
    const Real speed_change = magnitude(w - c.speed_rad_s);
    const Real feed_steady = steady_ * magnitude(v);
    const Real speed_steady = steady_ * magnitude(w);
    const bool still = feed_change <= feed_steady && speed_change <= speed_steady;
    const bool steady = feed_change <= std::max(feed_steady, feed_slack_) &&
                        speed_change <= std::max(speed_steady, speed_slack_);
    const bool turns_back = v * c.feed_m_s < 0;
    c.feed_m_s = v;
    c.speed_rad_s = w;
    // Friction is learned from what has settled alone.
    c.steady = still && part.usable ? c.steady + (c.steady < kSettled) : 0;
    c.just_opened = c.learns = false;

    const Real along = direction_ != 0 ? direction_ : v < 0 ? Real(-1) : Real(1);
    const Real travel = along * part.travel_m;
    const Real friction = friction_.at(c.friction, v);
    const Real spindle = spindle_.at(c.spindle, w);
    if (part.usable) {
      c.thrust_N = along * (part.thrust_N - friction);
      c.torque_Nm = (part.torque_Nm - spindle) * (w < 0 ? Real(-1) : Real(1));
    }
    const bool may = may_cut(part);
    c.stroke_m = may && !turns_back ? c.stroke_m + travel : Real(0);
    const bool cutting = c.phase == Phase::cutting;
    const Real level = cutting ? release_ : Real(1);
    // A stroke begins in the air: as long as friction may be off by more than the level itself, say
    // after a cold start, what is felt there is friction.
    const bool sure = cutting || c.stroke_m > clearance_m_;
    const bool above =
        (thrust_level_ > 0 && c.thrust_N >= level * thrust_level_ &&
         (sure || friction_.variance(c.friction, v) <= thrust_level_ * thrust_level_)) ||
        (torque_level_ > 0 && c.torque_Nm >= level * torque_level_ &&
         (sure || spindle_.variance(c.spindle, w) <= torque_level_ * torque_level_));
    // A part without enough good samples says nothing: a cut goes on through it.
    const bool cuts = may && (part.usable ? above && (cutting || steady) : cutting);

    if (!cutting) {
      c.from_bottom_m += travel;
      c.since_cut_s += part_s_;
      // On the way back some more, for a tap still turns in its thread there.
      const Real rim = c.depth_m + (travel < 0 ? entry_m_ : Real(0));
      const bool out = direction_ == 0 || c.depth_m == 0 || c.from_bottom_m <= -rim;
      c.phase = out ? Phase::air : Phase::in_hole;
      if (c.open && c.since_cut_s > peck_s_) close_hole(c);
    }
    if (cuts && !cutting) begin_cut(c);
    if (cuts) {
      c.cut_m += travel;
      c.depth_m += travel;
      if (part.usable && steady && c.cut_m > entry_m_) count(c, part, friction, spindle, along);
    } else if (cutting) {
      end_cut(c);
    } else {
      c.learns = is_air(c, part, may, above);
    }
  }
  void learn_friction(Cut& c) const noexcept {
    friction_.elapse(c.friction, part_s_);
    const Real v = c.lesson.travel_m * per_part_s_;
    if (c.learns && magnitude(v) >= slowest_)
      friction_.learn(c.friction, c.lesson.thrust_N, v, may_cut(c.lesson));
  }
  void learn_spindle(Cut& c) const noexcept {
    spindle_.elapse(c.spindle, part_s_);
    const Real w = c.lesson.turned_rad * per_part_s_;
    if (c.learns && magnitude(w) >= turning_)
      spindle_.learn(c.spindle, c.lesson.torque_Nm, w, may_cut(c.lesson));
  }

  [[nodiscard]] const FrictionDrift<Real>& friction() const noexcept { return friction_; }
  [[nodiscard]] const FrictionDrift<Real>& spindle() const noexcept { return spindle_; }

 private:
  static Real magnitude(Real x) noexcept { return x < 0 ? -x : x; }

  [[nodiscard]] bool may_cut(const Part& part) const noexcept {
    const Real feed = part.travel_m * per_part_s_;
    const Real along = direction_ != 0 ? direction_ * feed : magnitude(feed);
    return along > slowest_ && along <= fastest_ &&
           magnitude(part.turned_rad) * per_part_s_ >= turning_;
  }
  void begin_cut(Cut& c) const noexcept {
    const bool goes_on = c.open && direction_ != 0 && magnitude(c.from_bottom_m) <= entry_m_;
    if (!goes_on) {
      if (c.open) close_hole(c);
      c.depth_m = 2 * magnitude(c.feed_m_s) * part_s_;  // it touched before it was seen to cut
      c.just_opened = true;
      c.open = true;
      c.hole = Hole{};
    } else {
      c.depth_m += c.from_bottom_m;
    }
    c.phase = Phase::cutting;
    c.cut_m = 0;
    c.buckets = 0;
  }
  // The newest exit_m of the cut wait until more has followed.
  void count(Cut& c, const Part& part, Real friction, Real spindle, Real along) const noexcept {
    Hole now;
    now.thrust_N = c.thrust_N;
    now.torque_Nm = c.torque_Nm;
    now.thrust_peak_N = along > 0 ? part.thrust_high_N - friction : friction - part.thrust_low_N;
    now.torque_peak_Nm =
        c.speed_rad_s < 0 ? spindle - part.torque_low_Nm : part.torque_high_Nm - spindle;
    now.travel_m = magnitude(part.travel_m);
    now.parts = 1;
    if (!(bucket_m_ > 0)) return join(c.hole, now);
    if (c.buckets > 0 && c.last[c.newest].travel_m < bucket_m_) return join(c.last[c.newest], now);
    c.newest = c.newest + 1 == kBuckets ? 0 : c.newest + 1;
    if (c.buckets == kBuckets)
      join(c.hole, c.last[c.newest]);  // the oldest: exit_m have followed
    else
      ++c.buckets;
    c.last[c.newest] = now;
  }
  static void join(Hole& a, const Hole& b) noexcept {
    if (a.parts == 0) {
      a = b;
      return;
    }
    a.parts += b.parts;
    const Real weight = static_cast<Real>(b.parts) / static_cast<Real>(a.parts);
    a.thrust_N += (b.thrust_N - a.thrust_N) * weight;
    a.torque_Nm += (b.torque_Nm - a.torque_Nm) * weight;
    if (b.thrust_peak_N > a.thrust_peak_N) a.thrust_peak_N = b.thrust_peak_N;
    if (b.torque_peak_Nm > a.torque_peak_Nm) a.torque_peak_Nm = b.torque_peak_Nm;
    a.travel_m += b.travel_m;
  }
  void end_cut(Cut& c) const noexcept {
    // Of what waits, the older stretches count, up to where exit_m begins.
    Real behind = 0;
    std::uint32_t at = c.newest;
    for (std::uint32_t i = 0; i < c.buckets; ++i) {
      if (behind >= exit_m_) join(c.hole, c.last[at]);
      behind += c.last[at].travel_m;
      at = (at == 0 ? static_cast<std::uint32_t>(kBuckets) : at) - 1;
    }
    c.buckets = 0;
    c.phase = Phase::in_hole;
    c.from_bottom_m = 0;
    c.since_cut_s = 0;
    c.steady = 0;  // the observers settle anew, whatever the speed does
    if (!(peck_s_ > 0)) close_hole(c);
  }
  void close_hole(Cut& c) const noexcept {
    c.open = false;
    if (c.hole.parts == 0 || c.hole.travel_m < shortest_m_) {
      ++c.short_cuts;
      return;
    }
    c.complete = c.hole;
    c.verdict = true;
  }
  // Steady, out of the hole, and not where the workpiece may be. A rapid or a retraction is never a
  // cut, however far friction is off.
  [[nodiscard]] bool is_air(Cut& c, const Part& part, bool may, bool above) const noexcept {
    if (c.phase != Phase::air || c.steady < kSettled ||
        (may && (above || c.stroke_m > clearance_m_)))
      return false;
    c.lesson = part;
    return true;
  }

  FrictionDrift<Real> friction_;
  FrictionDrift<Real> spindle_;
  Real part_s_ = 0;
  Real per_part_s_ = 0;
  Real direction_ = -1;
  Real thrust_level_ = 0;
  Real torque_level_ = 0;
  Real release_ = 0;
  Real fastest_ = 0;
  Real slowest_ = 0;
  Real turning_ = 0;
  Real steady_ = 0;
  Real feed_slack_ = 0;   // change of speed from part to part...
  Real speed_slack_ = 0;  // ...that takes half of the cutting level
  Real entry_m_ = 0;
  Real exit_m_ = 0;
  Real bucket_m_ = 0;
  Real shortest_m_ = 0;
  Real clearance_m_ = 0;
  Real peck_s_ = 0;
};

}  // namespace servosense
