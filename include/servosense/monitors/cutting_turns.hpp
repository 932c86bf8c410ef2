// Means over whole revolutions, and which of them lie well inside a straight cut.
//
// Purpose: a mean over whole revolutions knows neither teeth nor helix nor run-out
// (model/average_cutting.hpp). Of a cut those are of use that are not at its ends.
//   slot      whole revolutions, 48 samples and radius / 24 of path at least, 64 revolutions at
//             most. The sample in which a revolution ends is shared out between both.
//   cut       torque at or above that of the last air and cutting_torque_Nm, feed per tooth within
//             its limits, z at rest
//   given     a cut whose neighbours have the same feed and speed, with a radius of the tool of
//             straight cut before it: so long the tool comes in. Behind it two slots whose torque
//             is not lower by 7 % nor 40 % below what waits, or a radius of cut: going out takes a
//             slot more than that of the torque (a 24th of the path of exit is 8 % of the chips at
//             least), and for good.
//   air       axes at rapid, whatever the torque is, or at rest with less torque, and so the slots
//             beside it
// Feed per tooth is path over turned teeth, along the feed whatever it is. A slot whose direction
// is another than that of the slot before begins a cut of its own: in a corner the engagement is
// another.
// Discretisation: sums of samples.
// Delay: two slots; a radius of path where the torque falls or is too noisy.
// Range: |torque|, |force| < 1e15; six samples a revolution.
// Numerical bound: sums of a slot; path of a radius; nothing drifts.
// Bad at: arcs that turn by less than 2 degrees a slot (taken for straight); entries and exits on a
// slope, which are longer than a radius.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/core/whole.hpp"

namespace servosense {

struct CuttingTurnsConfig {
  double sample_period_s = 125e-6;
  double cutting_torque_Nm = 0;  ///< from which on the tool cuts, mean of a revolution
  double radius_m = 0;           ///< of the tool
  unsigned teeth = 0;
  double least_feed_per_tooth_m = 1e-6;
  double most_feed_per_tooth_m = 1e-3;  ///< faster is a rapid
  double minimum_speed_rad_s = 10;      ///< slower than this the spindle does not cut
  double settle_s = 0.03;               ///< in which filters of the torque have forgotten the air
  double steady_feed = 0.02;            ///< share by which neighbours may differ
  double steady_speed = 0.01;
};

/// A slot. Forces and their axes as the drives report them: positive against positive motion.
template <RealNumber Real>
struct TurnMeans {
  Real torque_Nm = 0;  ///< positive against the rotation, whichever that is
  std::array<Real, 2> force_N{};
  std::array<Real, 2> direction{};  ///< of the feed, of length 1; 0 at rest
  Real feed_per_tooth_m = 0;
  Real speed_rad_s = 0;  ///< >= 0
  Real sense = 1;        ///< of the rotation: 1 or -1
  Real turns = 0;
};

enum class TurnKind : std::uint8_t { none, air, cut };

template <RealNumber Real>
class CuttingTurns {
 public:
  using Config = CuttingTurnsConfig;
  using Means = TurnMeans<Real>;

  static constexpr std::uint32_t kLeastSamples = 48;
  static constexpr std::uint32_t kMostTurns = 64;

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (!(c.cutting_torque_Nm > 0 && is_finite(c.cutting_torque_Nm)))
      return Status::invalid("cutting_torque_Nm", "must be known, to tell a cut from the air");
    if (!(c.radius_m > 0 && c.radius_m <= 1))
      return Status::invalid("radius_m", "must be within 0 and 1");
    if (c.teeth < 1) return Status::invalid("teeth", "must be at least 1");
    if (!(c.least_feed_per_tooth_m > 0 && c.most_feed_per_tooth_m > c.least_feed_per_tooth_m))
      return Status::invalid("most_feed_per_tooth_m", "must be above the least, that above 0");
    if (!(c.minimum_speed_rad_s > 0 && c.minimum_speed_rad_s * c.sample_period_s < 1))
      return Status::invalid("minimum_speed_rad_s",
                             "must be positive, and six samples a revolution at least");
    if (!(c.settle_s >= 0 && c.settle_s < 10))
      return Status::invalid("settle_s", "must be within 0 and 10");
    if (!(c.steady_feed > 0 && c.steady_speed > 0))
      return Status::invalid("steady_feed, steady_speed", "must be positive");
    return {};
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    level_ = static_cast<Real>(c.cutting_torque_Nm);
    radius_ = static_cast<Real>(c.radius_m);
    step2_ = static_cast<Real>(c.radius_m * c.radius_m / (kSteps * kSteps));
    per_tooth_ = static_cast<Real>(1.0 / c.teeth);
    least_feed_ = static_cast<Real>(c.least_feed_per_tooth_m);
    most_feed_ = static_cast<Real>(c.most_feed_per_tooth_m);
    per_s_ = static_cast<Real>(1 / c.sample_period_s);
    settle_ = static_cast<Real>(c.settle_s / c.sample_period_s);
    steady_feed_ = static_cast<Real>(c.steady_feed);
    steady_speed_ = static_cast<Real>(c.steady_speed);
    longest_ = whole(kMostTurns * kTwoPi / c.minimum_speed_rad_s / c.sample_period_s);
    reset();
  }
  void reset() noexcept {
    sums_ = {};
    last_ = {};
    kind_ = TurnKind::none;
    sense_ = 1;
    air_ = 0;
    air_given_ = false;
    air_torque_ = 0;
    released_ = 0;
    end_cut();
  }

  /// One servo period: torque of the spindle and its increment, force and increment of x and y,
  /// increment of z, and what is known against any of them. True when that took as long as the
  /// user of the slots may: the samples in which one ends, and the next three.
  bool process(Real torque_Nm, Real turned_rad, Real force_x_N, Real way_x_m, Real force_y_N,
               Real way_y_m, Real way_z_m, Quality quality) SERVOSENSE_NONBLOCKING {
    const Real check =
        (torque_Nm * torque_Nm + force_x_N * force_x_N + force_y_N * force_y_N) * Real(1e-30) +
        turned_rad * turned_rad * Real(1e-2) + way_x_m * way_x_m + way_y_m * way_y_m +
        way_z_m * way_z_m;
    if (quality > Quality::held || !(check < Real(1))) {
      begin_anew();
      return false;
    }
    const Sums now{torque_Nm, force_x_N, force_y_N, way_x_m, way_y_m, way_z_m, 1};
    sums_.add(now, 1);
    ++samples_;
    const Real turned = turned_rad * sense_;
    turned_ += turned;
    if (turned_ >= kTurn) return end_turn(now, turned);
    if (turned_ < -kBack || samples_ >= longest_) begin_anew();
    if (stage_ == Stage::none) return false;
    go_on();
    return true;
  }

  /// The next cut is another: what waits of this one is given up.
  void forget_cut() noexcept {
    released_ = 0;
    begin_anew();
  }

  /// What can be taken: cuts in their order, or the air that the last slot has confirmed.
  [[nodiscard]] TurnKind ready() const noexcept {
    return released_ > 0 ? TurnKind::cut : air_given_ ? TurnKind::air : TurnKind::none;
  }
  /// Requires ready() other than none. A cut whose feed or speed was not steady has 0 turns.
  [[nodiscard]] Means take() noexcept {
    if (released_ == 0) {
      air_given_ = false;
      return before_last_;
    }
    const Waiting& oldest = waiting_[first_];
    Means means = oldest.means;
    if (oldest.spoiled) means.turns = 0;
    first_ = (first_ + 1) % kWaiting;
    --count_;
    --released_;
    ahead_ = count_ > 0 ? ahead_ - waiting_[first_].gap : Real(0);
    return means;
  }
  /// Whether the newest slot cuts.
  [[nodiscard]] bool cutting() const noexcept { return kind_ == TurnKind::cut; }

 private:
  static constexpr Real kTurn = static_cast<Real>(kTwoPi);
  static constexpr Real kBack = Real(0.5);          // rad: the spindle turns the other way
  static constexpr double kSteps = 24;              // slots that a radius of path is parted into
  static constexpr Real kStraight = Real(0.99939);  // cosine of 2 degrees
  static constexpr Real kFlat = Real(0.02);         // of z in the path
  static constexpr Real kGoesOn = Real(0.93);       // of the torque: the tool does not go out
  static constexpr Real kFarDown = Real(0.6);       // of it: it may be at the end of its way out
  static constexpr std::size_t kWaiting = 28;       // more than kSteps + 1

  struct Sums {
    Real torque = 0, force_x = 0, force_y = 0, way_x = 0, way_y = 0, way_z = 0, weight = 0;
    void add(const Sums& s, Real share) noexcept {
      torque += share * s.torque;
      force_x += share * s.force_x;
      force_y += share * s.force_y;
      way_x += share * s.way_x;
      way_y += share * s.way_y;
      way_z += share * s.way_z;
      weight += share * s.weight;
    }
  };
  /// What is left to do of the slot that has ended, a sample each.
  enum class Stage : std::uint8_t { none, judge, keep, release };
  struct Waiting {
    Means means;
    Real gap = 0;  // path from the end of the one before to that of this
    bool spoiled = false;
  };

  // The samples of a revolution do not belong together.
  [[gnu::noinline]] void begin_anew() noexcept {
    if (turned_ < -kBack) sense_ = -sense_;
    stage_ = Stage::none;
    sums_ = {};
    turned_ = 0;
    turns_ = 0;
    samples_ = 0;
    kind_ = TurnKind::none;
    air_ = 0;
    air_given_ = false;
    end_cut();
  }
  // What has been released stands.
  void end_cut() noexcept {
    count_ = released_;
    before_ = before_samples_ = since_newest_ = ahead_ = 0;
  }

  [[gnu::noinline]] bool end_turn(const Sums& now, Real turned) noexcept {
    turned_ -= kTurn;
    ++turns_;
    const Real way2 = sums_.way_x * sums_.way_x + sums_.way_y * sums_.way_y;
    const bool enough = way2 >= step2_;
    if (samples_ < kLeastSamples || (!enough && turns_ < kMostTurns)) return false;
    const Real rest = turned > turned_ ? turned_ / turned : Real(1);
    slot_.sums = sums_;
    slot_.sums.add(now, -rest);
    sums_ = {};
    sums_.add(now, rest);
    slot_.turns = static_cast<Real>(turns_);
    slot_.enough = enough;
    turns_ = 0;
    samples_ = 0;
    stage_ = Stage::judge;
    return true;
  }
  [[gnu::noinline]] void go_on() noexcept {
    if (stage_ == Stage::judge) {
      stage_ = judge() ? Stage::keep : Stage::none;
    } else if (stage_ == Stage::keep) {
      keep();
      stage_ = slot_.enough ? Stage::release : Stage::none;
    } else {
      release();
      stage_ = Stage::none;
    }
  }

  // True for a cut.
  bool judge() noexcept {
    const Sums& s = slot_.sums;
    const Real scale = Real(1) / s.weight;
    const Real path = std::sqrt(s.way_x * s.way_x + s.way_y * s.way_y);
    before_last_ = last_;
    Means& m = last_;
    m.sense = sense_;
    m.torque_Nm = sense_ * s.torque * scale;
    m.force_N = {s.force_x * scale, s.force_y * scale};
    m.direction = {};
    if (path > 0) m.direction = {s.way_x / path, s.way_y / path};
    m.turns = slot_.turns;
    m.feed_per_tooth_m = path * per_tooth_ / m.turns;
    m.speed_rad_s = m.turns * kTurn * scale * per_s_;
    const bool feeds = m.feed_per_tooth_m >= least_feed_ && m.feed_per_tooth_m <= most_feed_;
    const bool loaded = m.torque_Nm - air_torque_ >= level_;
    const bool rapid = m.feed_per_tooth_m > most_feed_;
    const bool flat = std::abs(s.way_z) <= kFlat * path;
    slot_.path = path;
    slot_.after_cut = kind_ == TurnKind::cut;
    slot_.same_speed =
        std::abs(m.speed_rad_s - before_last_.speed_rad_s) <= steady_speed_ * m.speed_rad_s;
    kind_ = loaded && feeds && flat        ? TurnKind::cut
            : !feeds && (rapid || !loaded) ? TurnKind::air
                                           : TurnKind::none;
    air_given_ = false;
    if (kind_ == TurnKind::cut) {
      air_ = 0;
      return true;
    }
    end_cut();
    air_ = kind_ != TurnKind::air ? 0 : air_ < 3 ? air_ + 1 : 3;
    air_given_ = air_ == 3 && slot_.same_speed;
    if (air_given_) air_torque_ = before_last_.torque_Nm;
    return false;
  }

  void keep() noexcept {
    const Means &m = last_, &last = before_last_;
    const Real path = slot_.path;
    const bool straight =
        m.direction[0] * last.direction[0] + m.direction[1] * last.direction[1] >= kStraight;
    if (!slot_.after_cut || !straight) end_cut();
    const bool steady = slot_.same_speed && std::abs(m.feed_per_tooth_m - last.feed_per_tooth_m) <=
                                                steady_feed_ * m.feed_per_tooth_m;
    if (!steady && count_ > released_ && !(since_newest_ > 0)) newest().spoiled = true;
    since_newest_ += path;
    ahead_ += path;
    // A radius behind the oldest that waits for it.
    if (released_ == 0 && count_ > 1 && ahead_ >= radius_) released_ = 1;
    if (steady && before_ >= radius_ && before_samples_ >= settle_ && count_ < kWaiting) {
      if (count_ == 0) ahead_ = 0;
      waiting_[(first_ + count_) % kWaiting] = {m, since_newest_, false};
      ++count_;
      since_newest_ = 0;
    }
    if (before_ < radius_) before_ += path;
    if (before_samples_ < settle_) before_samples_ += slot_.sums.weight;
  }
  // Where the torque has not fallen since the slot two before, nor far since the oldest, what waits
  // up to it is no exit: at the end of one it may be level, but low.
  void release() noexcept {
    const Means &m = last_, &last = before_last_;
    if (count_ < released_ + 3 || since_newest_ > 0) return;
    const auto over_air = [&](const Means& of) { return of.torque_Nm - air_torque_; };
    const auto waiting = [&](std::size_t i) {
      return over_air(waiting_[(first_ + i) % kWaiting].means);
    };
    const Real level = kGoesOn * waiting(count_ - 3);
    if (over_air(m) >= level && over_air(last) >= level &&
        over_air(m) >= kFarDown * waiting(released_))
      released_ = count_ - 2;
  }
  [[nodiscard]] Waiting& newest() noexcept { return waiting_[(first_ + count_ - 1) % kWaiting]; }

  Sums sums_;
  struct {
    Sums sums;
    Real turns = 0, path = 0;
    bool enough = false, after_cut = false, same_speed = false;
  } slot_;  // that has ended last
  Stage stage_ = Stage::none;
  Means last_, before_last_;
  TurnKind kind_ = TurnKind::none;  // of the newest slot
  Real turned_ = 0;                 // of this revolution
  Real sense_ = 1;
  std::uint32_t turns_ = 0;
  std::uint32_t samples_ = 0;
  std::uint32_t air_ = 0;    // slots in a row, up to 3
  Real before_ = 0;          // path of this cut, up to a radius
  Real before_samples_ = 0;  // likewise
  Real since_newest_ = 0;    // path since the end of the newest that waits
  Real ahead_ = 0;           // path since the end of the oldest
  std::array<Waiting, kWaiting> waiting_{};
  std::size_t first_ = 0;
  std::size_t count_ = 0;
  std::size_t released_ = 0;  // the oldest of them: to be taken
  bool air_given_ = false;
  Real air_torque_ = 0;  // of the last air that was given: friction that the observer does not know

  Real level_ = 0, radius_ = 0, step2_ = 0, per_tooth_ = 1, least_feed_ = 0, most_feed_ = 0;
  Real per_s_ = 0, settle_ = 0, steady_feed_ = 0, steady_speed_ = 0;
  std::uint32_t longest_ = 1;
};

}  // namespace servosense
