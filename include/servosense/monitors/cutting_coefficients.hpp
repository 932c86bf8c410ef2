// Cutting coefficients on line, from the torque of the spindle and the forces of x and y.
//
// Purpose: what the material and the edge of the tool ask for, whatever depth and feed are: K_tc,
// K_te and the radial ratio with their standard errors; a change of them; how much they have grown.
//   mean over whole revolutions well inside a straight cut (cutting_turns.hpp), in the frame of the
//   feed; linear in the coefficients (Dunwoody 2010, eq. 3.13 to 3.19, model/average_cutting.hpp):
//     torque = sum g K + friction of the spindle
//     force of an axis that moves = -(fx, fy in its direction) + sgn(v) friction of the axis
//   Kalman filter on a random walk from the told coefficients (cutting_filter.hpp). Friction of the
//   spindle is learned in the air as well.
//   k(h) = K_tc + K_te / h    specific cutting force at one mean chip thickness h, that of [cut]:
//                             S s / A at the feed s
//   ratio  k / taught k, with the standard errors of both: the wear monitor judges it
// set_cut() is another depth or width: coefficients are of tool and material, and go on.
// Where the feed never varies K_tc and K_te cannot be told apart, and k alone is followed. A value
// is told when its standard error is at most half of what it was before; the radial ratio when it
// is at most a tenth (kinds: chosen).
// Change: of the torque by d = +- smallest_change, a test of the innovations nu by their likelihood
// (Page 1954), mu = d torque / sqrt S:
//   g = max(0, g + mu (+-nu / sqrt S - mu / 2)) > h,    h = ln(false_change_slots)
// by which a false one comes after e^h slots or more in the mean (Lorden 1971). No slot adds more
// than h / 3, so an odd one is none. After it the coefficients are as doubtful as at the start: the
// estimate follows at once.
// Discretisation: slots of whole revolutions.
// Delay: two slots, until it is known that the cut does not end; four more for a change.
// Cost on Cortex-M4F: 141 instructions, 276 for the worst sample: the end of a slot and what the
// filter does with it take one step a sample, two rows of the filter each.
// Range: those of the parts.
// Numerical bound: those of the parts; nothing drifts.
// Bad at: cuts whose depth or width is not that of the file (read as coefficients); arcs, ramps;
// an axis that stands (its friction takes what it likes: not heard); friction that depends on the
// place; chips so thin that the law is not linear.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/monitors/cutting_coefficients_config.hpp"
#include "servosense/monitors/cutting_filter.hpp"
#include "servosense/monitors/cutting_turns.hpp"
#include "servosense/monitors/monitor.hpp"

namespace servosense {

/// Why a warning was raised.
enum class CuttingVerdict : std::uint8_t { none, change };

/// A value with its standard error. `told`: the cut has said it; else it is what was known before.
template <RealNumber Real>
struct CuttingEstimate {
  Real value = 0;
  Real error = 0;
  bool told = false;
};

template <RealNumber Real>
class CuttingCoefficients {
 public:
  using Config = CuttingCoefficientsConfig;
  using Turns = CuttingTurns<Real>;
  using Filter = CuttingFilter<Real>;
  using Estimate = CuttingEstimate<Real>;
  static constexpr std::uint32_t kShown = 200;  ///< slots that a change is warned of

  struct State {
    MonitorState state = MonitorState::idle;  ///< until something is cut
    CuttingVerdict verdict = CuttingVerdict::none;
    Real value = 0;             ///< change of the specific cutting force, a share
    Real threshold = 0;         ///< smallest_change
    Real taught_N_per_m2 = 0;   ///< 0: not yet
    Real taught_error = 0;      ///< [N/m2]
    std::uint64_t slots = 0;    ///< of cut that were heard
    std::uint64_t air = 0;      ///< slots of air, likewise
    std::uint64_t changes = 0;  ///< found
    Real change = 0;            ///< the last of them, of the specific cutting force, a share
    Real revolutions = 0;       ///< of cut that were heard
    std::uint64_t since = 0;    ///< slots since the last change
    std::uint64_t faults = 0;   ///< samples not used
    bool signal_fault = false;
    std::array<Real, 2> likelihood{};  ///< of a change up, and down
  };

  static Status validate(const Config& c) noexcept { return servosense::validate(c); }

  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    turns_.configure(c.turns);
    const std::array<ToldCoefficient, kCuttingCoefficients> told = {c.tangential, c.tangential_edge,
                                                                    c.radial, c.radial_edge};
    for (std::size_t i = 0; i < kCuttingCoefficients; ++i) {
      told_[i] = static_cast<Real>(told[i].value);
      error_[i] = static_cast<Real>(told[i].error);
      const double wander = c.drift * told[i].value / told[i].error;
      walk_[i] = static_cast<Real>(wander * wander / 1000);
    }
    const CuttingShares& s = c.shares;
    cut_shares_ = next_shares_ = in_real(s);
    friction_ = {static_cast<Real>(c.torque_friction_error_Nm),
                 static_cast<Real>(c.force_friction_error_N[0]),
                 static_cast<Real>(c.force_friction_error_N[1])};
    friction_walk_ = static_cast<Real>(1 / c.friction_memory_s);
    edge_weight_ = static_cast<Real>(
        c.chip_m > 0 ? 1 / c.chip_m : s.torque_edge_m2 / (s.torque_chip_m3 * c.feed_per_tooth_m));
    const double torque = c.tangential.value * s.torque_chip_m3 * c.feed_per_tooth_m;
    first_noise_ = static_cast<Real>(kFirstNoise * torque * kFirstNoise * torque);
    const double force = torque / c.turns.radius_m;
    first_force_noise_ = static_cast<Real>(kFirstNoise * force * kFirstNoise * force);
    change_ = static_cast<Real>(c.smallest_change);
    limit_ = static_cast<Real>(std::log(c.false_change_slots));
    teach_ = c.teach_slots;
    taught_ = static_cast<Real>(c.taught_N_per_m2);
    reset();
  }
  /// Forgets everything, the tool included.
  void reset() noexcept {
    turns_.reset();
    filter_.reset();
    state_ = {};
    state_.taught_N_per_m2 = taught_;
    noise_ = {};
    noise_[kTorque].variance = noise_[kAir].variance = first_noise_;
    noise_[kX].variance = noise_[kY].variance = first_force_noise_;
    stage_ = Stage::wait;
    stepped_ = false;
    air_speed_ = 0;
    found_ = {};
    changed_ = false;
  }
  /// From now on cuts are of this depth, width and direction; what was not heard out of the last
  /// one is given up. Requires validate(shares).ok().
  void set_cut(const CuttingShares& shares) noexcept {
    turns_.forget_cut();
    next_shares_ = in_real(shares);
  }
  /// Another tool: its coefficients are those of the file, friction stays what it was found to be.
  /// Give state().taught_N_per_m2 and taught_error of when it was last in the spindle, if it was.
  void new_tool(Real taught_N_per_m2 = 0, Real taught_error = 0) noexcept {
    filter_.forget(0, kCuttingCoefficients);
    turns_.forget_cut();
    const State before = state_;
    state_ = {};
    state_.taught_N_per_m2 = taught_N_per_m2 > 0 ? taught_N_per_m2 : taught_;
    state_.taught_error = taught_N_per_m2 > 0 ? taught_error : 0;
    state_.air = before.air;
    state_.faults = before.faults;
    found_ = {};
    changed_ = false;
    stage_ = Stage::wait;
    stepped_ = false;
  }

  /// One servo period: cutting torque of the spindle and its increment, cutting force and increment
  /// of x and of y, increment of z, and what is known against any of them.
  MonitorState process(Real torque_Nm, Real turned_rad, Real force_x_N, Real way_x_m,
                       Real force_y_N, Real way_y_m, Real way_z_m,
                       Quality quality) SERVOSENSE_NONBLOCKING {
    const bool fault = quality > Quality::held;
    if (fault != state_.signal_fault) hear_fault(fault, quality);
    if (fault) ++state_.faults;
    // Either a slot ends, or the filter goes on with one.
    if (!turns_.process(torque_Nm, turned_rad, force_x_N, way_x_m, force_y_N, way_y_m, way_z_m,
                        quality) &&
        (stage_ != Stage::wait || turns_.ready() != TurnKind::none))
      go_on();
    return state_.state;
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  /// Whether the newest revolutions cut.
  [[nodiscard]] bool cutting() const noexcept { return turns_.cutting(); }
  /// K_tc [N/m2], K_te [N/m], K_rc [N/m2], K_re [N/m]. Off the real-time path.
  [[nodiscard]] Estimate coefficient(std::size_t i) const noexcept {
    Estimate e = single(i);
    // Where the edge is not told, what is left for the chip is not either.
    e.told = e.told && single(i % 2 == 0 ? i + 1 : i).told;
    return e;
  }
  /// Specific cutting force at the chip of the configuration [N/m2].
  [[nodiscard]] Estimate specific_force() const noexcept {
    Estimate e;
    e.value = specific_now();
    const Real a = error_[0], b = edge_weight_ * error_[1];
    e.error = std::sqrt(a * a * filter_.variance(0) + b * b * filter_.variance(1) +
                        2 * a * b * filter_.covariance(0, 1));
    e.told = e.error * e.error <= (a * a + b * b) / 4;
    // Chip and edge err against each other; what is left goes with the part of the edge.
    e.error = both(e.error, kLawEdge * edge_weight_ * coefficient_now(1));
    return e;
  }
  /// Of it to the taught one: wear that depends on neither depth nor width nor feed. Once a slot.
  [[nodiscard]] Estimate force_ratio() const noexcept {
    const State& s = state_;
    if (!(s.taught_N_per_m2 > 0)) return {1, 0, false};
    const Estimate k = specific_force();
    const Real scale = Real(1) / s.taught_N_per_m2;
    const Real ratio = k.value * scale;
    const Real of_taught = ratio * s.taught_error;
    return {ratio, std::sqrt(k.error * k.error + of_taught * of_taught) * scale, k.told};
  }
  /// K_rc / K_tc. Off the real-time path.
  [[nodiscard]] Estimate radial_ratio() const noexcept {
    const Real tangential = coefficient_now(0), radial = coefficient_now(2);
    Estimate e;
    e.value = radial / tangential;
    const Real a = error_[2] / tangential, b = -e.value * error_[0] / tangential;
    e.error = std::sqrt(a * a * filter_.variance(2) + b * b * filter_.variance(0) +
                        2 * a * b * filter_.covariance(0, 2));
    e.error = both(e.error, (kLaw[0] + kLaw[2]) * e.value);
    e.told = e.error <= kRatioTold * std::abs(e.value);
    return e;
  }
  /// Friction of the spindle beyond what its observer knows [Nm].
  [[nodiscard]] Estimate spindle_friction() const noexcept {
    return {filter_.value(4) * friction_[0], std::sqrt(filter_.variance(4)) * friction_[0],
            filter_.variance(4) <= Real(0.25)};
  }
  /// Noise of a slot's mean torque, standard deviation [Nm].
  [[nodiscard]] Real torque_noise_Nm() const noexcept {
    return std::sqrt(noise_[kTorque].variance);
  }
  /// Smallest change of the specific cutting force that 20 slots like the last show, a share; 0
  /// before the first.
  [[nodiscard]] Real smallest_change_seen() const noexcept {
    if (!(cut_ > 0)) return 0;
    const Real noise = noise_[kTorque].variance / (cut_ * cut_);
    const Real needed = change_ / 2 + limit_ * noise / (20 * change_);
    return needed > change_ ? needed : change_;
  }

 private:
  static constexpr std::uint8_t kTorque = 0, kX = 1, kY = 2, kAir = 3;
  /// What comes next of a slot, a sample each; rows have several.
  enum class Stage : std::uint8_t { wait, predict, observe, rows, test };
  static constexpr double kFirstNoise = 0.03;
  // Of a mean: what the law and the measured feed leave.
  static constexpr Real kTorqueModel = Real(0.003), kForceModel = Real(0.01);
  static constexpr Real kMoves = Real(0.2);      // of the path: less, and an axis may stick
  static constexpr Real kSameSpeed = Real(0.1);  // beyond it friction is another
  static constexpr Real kRatioTold = Real(0.1);
  static constexpr Real kOdd = 9;  // of the variance: one mean of air in 370 by chance

  // What run-out of up to 5 um adds to the error of each at chips of 30 to 110 um: a tooth that
  // passes over its chip leaves the law (measured on tests/monitors/milled_program.hpp).
  static constexpr std::array<Real, kCuttingCoefficients> kLaw = {Real(0.005), Real(0.025),
                                                                  Real(0.015), Real(0.06)};
  static constexpr Real kLawEdge = Real(0.02);  // of k, likewise
  [[nodiscard]] static Real both(Real a, Real b) noexcept { return std::sqrt(a * a + b * b); }

  /// Of a mean, in K_tc, K_te, K_rc, K_re; the even ones times the feed per tooth.
  using Shares = std::array<Real, kCuttingCoefficients>;
  struct CutShares {
    Shares torque{}, x{}, y{};
  };
  [[nodiscard]] static CutShares in_real(const CuttingShares& s) noexcept {
    const auto real = [](double a, double b, double p, double q) {
      return Shares{static_cast<Real>(a), static_cast<Real>(b), static_cast<Real>(p),
                    static_cast<Real>(q)};
    };
    return {
        real(s.torque_chip_m3, s.torque_edge_m2, 0, 0),
        real(s.x_tangential_chip_m2, s.x_tangential_edge_m, s.x_radial_chip_m2, s.x_radial_edge_m),
        real(s.y_tangential_chip_m2, s.y_tangential_edge_m, s.y_radial_chip_m2, s.y_radial_edge_m)};
  }

  [[nodiscard]] Real coefficient_now(std::size_t i) const noexcept {
    return told_[i] + error_[i] * filter_.value(i);
  }
  [[nodiscard]] Real specific_now() const noexcept {
    return coefficient_now(0) + edge_weight_ * coefficient_now(1);
  }
  [[nodiscard]] Estimate single(std::size_t i) const noexcept {
    const Real value = coefficient_now(i);
    return {value, both(error_[i] * std::sqrt(filter_.variance(i)), kLaw[i] * value),
            filter_.variance(i) <= Real(0.25)};
  }

  [[gnu::noinline]] void hear_fault(bool fault, Quality quality) noexcept {
    state_.signal_fault = fault;
    const bool first = has(quality, Quality::settling) && state_.slots == 0;
    if (fault && !first) state_.state = MonitorState::signal_fault;
    if (!fault) show();
  }
  void show() noexcept {
    State& s = state_;
    if (s.signal_fault) return;
    const bool shown = s.changes > 0 && s.since < kShown;
    if (s.slots == 0) {
      s.state = MonitorState::idle;
    } else if (s.taught_N_per_m2 > 0) {
      s.state = shown ? MonitorState::warning : MonitorState::armed;
      if (!shown) s.verdict = CuttingVerdict::none;
    } else {
      s.state = MonitorState::learning;
    }
  }

  // One step of what is to be done of a slot.
  [[gnu::noinline]] void go_on() noexcept {
    switch (stage_) {
      case Stage::wait:
        take();
        break;
      case Stage::predict:
        predict();
        stage_ = Stage::observe;
        break;
      case Stage::observe:
        if (kind_ == kX || kind_ == kY)
          observe_force(kind_ - kX);
        else
          observe_torque();
        stage_ = Stage::rows;
        break;
      case Stage::rows: {
        // What follows a step tells the friction, and of the noise nothing.
        typename Filter::Noise kept = noise_[kind_];
        if (filter_.advance(stepped_ ? kept : noise_[kind_]))
          weighed();
        else if (!filter_.busy())
          next();
        break;
      }
      case Stage::test:
        test_change();
        stage_ = Stage::rows;
        break;
    }
  }
  void take() noexcept {
    kind_ = turns_.ready() == TurnKind::air ? kAir : kTorque;
    slot_ = turns_.take();
    if (!(slot_.turns > 0)) return;
    cut_shares_ = next_shares_;
    stage_ = Stage::predict;
  }
  // What has gone by since.
  void predict() noexcept {
    const Real time = slot_.turns * static_cast<Real>(kTwoPi) / slot_.speed_rad_s * friction_walk_;
    typename Filter::Vector added{};
    if (kind_ == kTorque)
      for (std::size_t i = 0; i < kCuttingCoefficients; ++i) added[i] = walk_[i] * slot_.turns;
    for (std::size_t i = kCuttingCoefficients; i < kCuttingStates; ++i) added[i] = time;
    if (changed_) filter_.doubt(0, kCuttingCoefficients);
    changed_ = false;
    if (std::abs(slot_.speed_rad_s - air_speed_) > kSameSpeed * slot_.speed_rad_s) {
      filter_.doubt(kCuttingCoefficients, kCuttingCoefficients + 1);
      air_speed_ = slot_.speed_rad_s;
    }
    filter_.predict(added);
  }
  void observe_torque() noexcept {
    typename Filter::Vector h{};
    h[kCuttingCoefficients] = friction_[0];
    if (kind_ == kAir)
      return filter_.observe(slot_.torque_Nm, h, kTorqueModel * kTorqueModel * first_noise_);
    const Real expected = take_shares(cut_shares_.torque, Real(1), h);
    cut_ = slot_.torque_Nm;
    const Real floor = kTorqueModel * cut_;
    filter_.observe(slot_.torque_Nm - expected, h, floor * floor);
  }
  /// h of the coefficients, and what is expected of the told ones.
  Real take_shares(const Shares& shares, Real sign, typename Filter::Vector& h) const noexcept {
    Real expected = 0;
    for (std::size_t i = 0; i < kCuttingCoefficients; ++i) {
      const Real g = sign * shares[i] * (i % 2 == 0 ? slot_.feed_per_tooth_m : Real(1));
      h[i] = g * error_[i];
      expected += g * told_[i];
    }
    return expected;
  }
  // Of an axis, from the frame of the feed: y is to its left where the spindle turns clockwise.
  void observe_force(std::size_t axis) noexcept {
    const Real along = slot_.direction[axis];
    const Real across = slot_.sense * (axis == 0 ? -slot_.direction[1] : slot_.direction[0]);
    Shares shares;
    for (std::size_t i = 0; i < kCuttingCoefficients; ++i)
      shares[i] = along * cut_shares_.x[i] + across * cut_shares_.y[i];
    typename Filter::Vector h{};
    const Real expected = take_shares(shares, Real(-1), h);  // forces on the tool push it back
    h[kCuttingCoefficients + 1 + axis] = along < 0 ? -friction_[1 + axis] : friction_[1 + axis];
    const Real floor = kForceModel * (cut_ > 0 ? slot_.force_N[axis] : Real(0));
    filter_.observe(slot_.force_N[axis] - expected, h,
                    floor * floor + Real(1e-4) * first_force_noise_);
  }

  void weighed() noexcept {
    if (kind_ == kTorque) stage_ = Stage::test;
    if (kind_ != kAir || stepped_) return;
    // Friction has stepped: what is known of it no longer holds, nor what hangs on it.
    const Real off = filter_.innovation();
    if (!(off * off > kOdd * filter_.spread())) return;
    filter_.doubt(kCuttingCoefficients, kCuttingCoefficients + 1);
    stepped_ = true;
    stage_ = Stage::observe;
  }
  // What is heard of the slot after this.
  void next() noexcept {
    stage_ = Stage::wait;
    stepped_ = false;
    if (kind_ == kAir) {
      ++state_.air;
      return;
    }
    for (++kind_; kind_ <= kY; ++kind_)
      if (std::abs(slot_.direction[kind_ - kX]) >= kMoves) {
        stage_ = Stage::observe;
        return;
      }
    end_slot();
  }

  void test_change() noexcept {
    State& s = state_;
    if (!(s.taught_N_per_m2 > 0) || s.slots < kSettled || s.since < kSettled) return;
    const Real scale = Real(1) / std::sqrt(filter_.spread());
    const Real mu = change_ * cut_ * scale, z = filter_.innovation() * scale;
    const Real most = limit_ / 3;
    for (std::size_t i = 0; i < 2; ++i) {
      Real gain = mu * ((i == 0 ? z : -z) - mu / 2);
      if (gain > most) gain = most;
      Found& f = found_[i];
      // What the torque of this slot makes of the specific force, to what that was before.
      const Real force = specific_now() * cut_ / (cut_ - filter_.innovation());
      if (!(s.likelihood[i] > 0)) f = {specific_now(), force};
      s.likelihood[i] += gain;
      if (!(s.likelihood[i] > 0)) {
        s.likelihood[i] = 0;
        continue;
      }
      const Real mean = (f.last + force) / 2;
      f.last = force;
      if (s.likelihood[i] >= limit_) return tell_change(mean / f.before - 1);
    }
  }
  [[gnu::noinline]] void tell_change(Real share) noexcept {
    State& s = state_;
    ++s.changes;
    s.since = 0;
    s.change = share;
    s.likelihood = {};
    found_ = {};
    changed_ = true;
    s.verdict = CuttingVerdict::change;
    s.value = share;
    s.threshold = change_;
  }

  void end_slot() noexcept {
    State& s = state_;
    ++s.slots;
    ++s.since;
    s.revolutions += slot_.turns;
    if (!(s.taught_N_per_m2 > 0)) {
      if (s.slots < teach_) return;
      const Estimate k = specific_force();
      if (!k.told) return;
      s.taught_N_per_m2 = k.value;
      s.taught_error = k.error;
    }
    show();
  }

  static constexpr std::uint64_t kSettled = 20;  // slots until the test has a state to doubt

  /// Specific force when a likelihood was 0 last, and as the last slot alone has it.
  struct Found {
    Real before = 1, last = 1;
  };

  Turns turns_;
  Filter filter_;
  State state_;
  TurnMeans<Real> slot_;  // that the filter is at
  Real cut_ = 0;          // its torque
  std::uint8_t kind_ = kTorque;
  Stage stage_ = Stage::wait;
  bool stepped_ = false;  // this slot of air has shown that friction has stepped
  bool changed_ = false;
  std::array<typename Filter::Noise, 4> noise_{};
  std::array<Found, 2> found_{};
  Real air_speed_ = 0;  // that the friction of the spindle is known at

  Shares told_{}, error_{}, walk_{};
  CutShares cut_shares_, next_shares_;  // of the slot that the filter is at; from the next on
  std::array<Real, 3> friction_{};
  Real friction_walk_ = 0, edge_weight_ = 0, first_noise_ = 1, first_force_noise_ = 1;
  Real change_ = 0, limit_ = 0, taught_ = 0;
  std::uint32_t teach_ = 1;
};

}  // namespace servosense
