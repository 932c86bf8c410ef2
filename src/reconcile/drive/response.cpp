// What is driven by the motion: friction along the path of the record, and the effects.
#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <tuple>
#include <type_traits>
#include <utility>

#include "reconcile/drive/backlash_response.hpp"
#include "reconcile/drive/signals.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/elastoplastic_sign.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kFine_s = 1.25e-4;  // of the motion between samples

}  // namespace

double DriveSignals::path_step_s() const {
  return 0.5 * sample_period_s_ / std::ceil(0.5 * sample_period_s_ / kFine_s);
}

namespace {

/// The path between a sample and the one before: a cubic (Catmull and Rom 1974), since a drive that
/// stops turns round within one.
struct Between {
  double from, slope, second, third;

  Between(const Column& path, std::size_t i) : from(path[i - 1]) {
    const double to = path[i];
    slope = i > 1 ? 0.5 * (to - path[i - 2]) : to - from;
    const double next = i + 1 < path.size() ? 0.5 * (path[i + 1] - from) : to - from;
    second = 3 * (to - from) - 2 * slope - next;
    third = slope + next - 2 * (to - from);
  }
  [[nodiscard]] double at(double t) const { return from + t * (slope + t * (second + t * third)); }
};

std::size_t half_steps(double sample_period_s, double step_s) {
  return static_cast<std::size_t>(std::lround(0.5 * sample_period_s / step_s));
}

/// The middle of a step, in samples.
double middle_of(std::size_t step, std::size_t steps) {
  return (static_cast<double>(step) + 0.5) / static_cast<double>(steps);
}

/// Of laws that always have something to learn.
std::optional<double> never(double /*way*/, const Place& /*cell*/) { return {}; }

}  // namespace

void DriveSignals::find_ways() {
  const std::size_t steps = 2 * half_steps(sample_period_s_, path_step_s());
  ways_.assign(path_.size(), 0);
  kept_.clear();
  double at = path_.empty() ? 0 : path_[0];
  for (std::size_t i = 1; i < path_.size(); ++i) {
    const Between between(path_, i);
    bool forward = true, backward = true;
    for (std::size_t k = 0; k < steps; ++k) {
      const double x = between.at(middle_of(k, steps));
      forward = forward && x >= at;
      backward = backward && x <= at;
      at = x;
    }
    ways_[i] = forward ? 1 : backward ? -1 : 0;
  }
}

/// Each sample stands for the half periods around it.
template <typename Law, typename Settled>
Column DriveSignals::along_path(Law law, Settled settled) const {
  const double step_s = path_step_s();
  const std::size_t half = half_steps(sample_period_s_, step_s), steps = 2 * half;
  const std::size_t n = path_.size();
  Column middles(steps), out(n, 0);
  for (std::size_t k = 0; k < steps; ++k) middles[k] = middle_of(k, steps);
  double at = n > 0 ? path_[0] : 0;
  bool passed_over = false;
  for (std::size_t i = 1; i < n; ++i) {
    const auto before = static_cast<double>(i > 1 ? steps : half);
    const auto after = static_cast<double>(i + 1 < n ? steps : half);
    Place place{};
    place.below = std::min((i - 1) / first_stride_, position.size() - 1);
    place.above = std::min(place.below + 1, position.size() - 1);
    if (ways_[i] != 0)
      if (const std::optional<double> answer = settled(ways_[i], place)) {
        out[i - 1] += static_cast<double>(half) * *answer / before;
        out[i] = static_cast<double>(half) * *answer / after;
        passed_over = true;
        continue;
      }
    if (passed_over) at = Between(path_, i - 1).at(middles.back());
    passed_over = false;
    const Between between(path_, i);
    double sum = 0;
    for (std::size_t k = 0; k < steps; ++k) {
      const double t = middles[k];
      const double x = between.at(t);
      place.at = (static_cast<double>(i - 1) + t) / static_cast<double>(first_stride_);
      sum += law(x - at, step_s, place);
      at = x;
      if (k + 1 == half) {
        out[i - 1] += sum / before;
        sum = 0;
      }
    }
    out[i] = sum / after;
  }
  return to_rows(to_work(out));
}

Column DriveSignals::direction_rows(double presliding) const {
  ElastoplasticSign<double> sign;
  sign.configure(presliding);
  return along_path(
      [&](double dx, double /*seconds*/, const Place& /*place*/) { return sign.process(dx); },
      [&](double way, const Place& /*cell*/) {
        return sign.state().deflection == way ? std::optional(way) : std::nullopt;
      });
}

Column DriveSignals::bristle_rows(double travel) const {
  double bristle = 0;
  return along_path(
      [&](double dx, double /*seconds*/, const Place& /*place*/) {
        const double end = dx < 0 ? -1 : 1;
        if (bristle == end) return end;  // most of the way
        return bristle = end + (bristle - end) * std::exp(-std::abs(dx) / travel);
      },
      [&](double way, const Place& /*cell*/) {
        return bristle == way ? std::optional(way) : std::nullopt;
      });
}

Column DriveSignals::speed_direction_rows(double speed) const {
  return along_path([&](double /*dx*/, double /*seconds*/,
                        const Place& place) { return std::tanh(place.of(velocity) / speed); },
                    [&](double /*way*/, const Place& cell) {
                      constexpr double kOne = 20;  // from there on tanh is 1 to the last digit
                      const double from = velocity[cell.below] / speed,
                                   to = velocity[cell.above] / speed;
                      return std::min(from, to) > kOne    ? std::optional(1.0)
                             : std::max(from, to) < -kOne ? std::optional(-1.0)
                                                          : std::nullopt;
                    });
}

/// sigma1 dz/dt exp(-(v/vd)^2) (Canudas de Wit et al. 1995; Olsson 1996). vd: the speed at which
/// the inertia on its bristles would cross the presliding distance.
Column DriveSignals::bristle_damping(const DriveModelConfig& drive) const {
  if (!(drive.coulomb > 0)) return Column(rows(), 0);
  const double per_square = drive.inertia / (drive.coulomb * drive.friction_knee);
  ElastoplasticSign<double> sign;
  sign.configure(drive.friction_knee);
  double before = 0;
  return along_path(
      [&](double dx, double seconds, const Place& /*place*/) {
        const double now = sign.process(dx);
        const double v = dx / seconds;
        const double rate = (now - std::exchange(before, now)) / seconds;
        return rate == 0 ? 0.0 : rate * std::exp(-v * v * per_square);
      },
      [&](double way, const Place& /*cell*/) {
        return before == way ? std::optional(0.0) : std::nullopt;
      });
}

namespace {

/// What one effect does along a motion, by the members it has.
struct Response {
  Column force, linear, acting, error;  ///< empty where it has no such part
  Column rows;                          ///< of what is driven along the record, in rows
  LoadShares load;
};

/// Effects that are friction, and swing over as it does.
template <typename Effect>
constexpr bool kSwingsOver = std::is_same_v<Effect, CoulombFriction<double>> ||
                             std::is_same_v<Effect, StribeckFriction<double>> ||
                             std::is_same_v<Effect, AsymmetricFriction<double>> ||
                             std::is_same_v<Effect, PositionDependentFriction<double>> ||
                             std::is_same_v<Effect, ThermalFrictionDrift<double>> ||
                             std::is_same_v<Effect, LoadDependentFriction<double>>;

/// What the motion takes but for Coulomb friction, and friction's share of all that is transmitted.
struct Load {
  Column force;
  double friction = 0;
};

/// Faster than the working rate shows.
template <typename Effect>
Column swing_over(const EffectSetting& setting, DriveFacts facts, const DriveSignals& s,
                  const Load& load) {
  facts.sample_period_s = s.path_step_s();
  Effect effect;
  effect.configure(setting, facts);
  effect.reset();
  ElastoplasticSign<double> sign;
  sign.configure(facts.friction_knee);
  return s.along_path(
      [&](double dx, double /*seconds*/, const Place& place) {
        MotionState<double> m;
        m.position = place.of(s.position);
        m.velocity = place.of(s.velocity);
        m.direction =
            s.presliding_speed > 0 ? std::tanh(m.velocity / s.presliding_speed) : sign.process(dx);
        m.effort = place.of(load.force) + facts.coulomb * m.direction;
        // u = load + mu abs(u) S
        m.effort /= 1 - load.friction * (m.effort < 0 ? -m.direction : m.direction);
        return effect.force(m);
      },
      never);
}

/// A load that rubs turns round faster than the working rate shows: what its friction adds, by way
/// of the spring, to what it takes from the drive's own.
template <typename Effect>
Column rub(const EffectSetting& setting, DriveFacts facts, const DriveSignals& s) {
  facts.sample_period_s = s.path_step_s();
  EffectSetting free = setting;
  free.parameters[3] = {};
  Effect rubbing, swinging;
  rubbing.configure(setting, facts);
  swinging.configure(free, facts);
  const double share = rubbing.load_shares().friction;
  ElastoplasticSign<double> sign;
  sign.configure(facts.friction_knee);
  bool started = false;
  return s.along_path(
      [&](double dx, double seconds, const Place& /*place*/) {
        MotionState<double> m;
        m.increment = dx;
        if (!std::exchange(started, true)) rubbing.start(m), swinging.start(m);
        return rubbing.transmitted(m) - swinging.transmitted(m) -
               share * (facts.viscous * dx / seconds + facts.coulomb * sign.process(dx));
      },
      never);
}

/// What the motion takes, not what was measured: else whatever disturbs the effort would seem to
/// depend on the effort.
Load load_of(const DriveSignals& s, const DriveModelConfig& drive) {
  Load load{loads_of(s, drive)};
  load.force.resize(s.position.size(), 0);
  for (std::size_t i = 0; i < load.force.size(); ++i)
    load.force[i] +=
        drive.inertia * s.smooth_acceleration[i] + drive.viscous * s.smooth_velocity[i];
  if (const EffectSetting* friction = drive.effects.find("load-dependent-friction"))
    load.friction = friction->scalar(0);
  return load;
}

template <typename Effect>
bool drive_effect(const EffectSetting& given, const DriveFacts& facts, const DriveSignals& s,
                  const DriveModelConfig& drive, Rate rate, Response& out) {
  if constexpr (requires { Effect::validate(given, facts); })
    if (!Effect::validate(given, facts).ok()) return false;
  if constexpr (kSwingsOver<Effect>) {
    out.rows = swing_over<Effect>(given, facts, s, load_of(s, drive));
    return true;
  }
  EffectSetting setting = given;
  if constexpr (std::is_same_v<Effect, FlexibleCoupling<double>>)
    if (rate == Rate::path && setting.scalar(3) > 0) {
      out.rows = rub<Effect>(setting, facts, s);
      setting.parameters[3] = {};
    }
  auto effect = std::make_unique<Effect>();  // a delay line is large
  effect->configure(setting, facts);
  effect->reset();
  if constexpr (requires { effect->load_shares(); }) out.load = effect->load_shares();
  ElastoplasticSign<double> sign;
  sign.configure(facts.friction_knee);
  const std::size_t n = s.position.size();
  const double per_square = 1 / (facts.sample_period_s * facts.sample_period_s);
  MotionState<double> m;
  for (std::size_t i = 0; i < n; ++i) {
    m.position = s.position[i];
    m.velocity = s.velocity[i];
    m.increment = s.increment[i];
    m.direction = sign.process(s.increment[i]);
    m.turn_angle_rad = s.turn_angle[i];
    m.effort = s.effort[i];
    m.acceleration = i > 0 && i + 1 < n ? (s.increment[i + 1] - s.increment[i]) * per_square : 0;
    if constexpr (requires { effect->start(m); })
      if (i == 0) effect->start(m);
    if constexpr (requires { effect->force(m); }) out.force.push_back(effect->force(m));
    if constexpr (requires { effect->viscous(); })
      out.linear.push_back(effect->viscous() * m.velocity);
    if constexpr (requires { effect->transmitted(m); })
      // The load's own friction is in the terms of the model already.
      out.linear.push_back(effect->transmitted(m) -
                           out.load.friction *
                               (facts.viscous * m.velocity + facts.coulomb * m.direction) -
                           out.load.constant_load * facts.constant_load);
    if constexpr (requires { effect->acting_effort(0.0, m); })
      out.acting.push_back(s.effort[i] - effect->acting_effort(s.effort[i], m));
    if constexpr (requires { effect->position_error(m); })
      out.error.push_back(effect->position_error(m));
  }
  return true;
}

template <std::size_t... I>
bool drive_any(const EffectSetting& setting, const DriveFacts& facts, const DriveSignals& s,
               const DriveModelConfig& drive, Rate rate, Response& out, std::index_sequence<I...>) {
  bool done = false;
  ((I == setting.effect
        ? void(done = drive_effect<std::tuple_element_t<I, DriveEffectList<double>>>(
                   setting, facts, s, drive, rate, out))
        : void()),
   ...);
  return done;
}

}  // namespace

Column DriveSignals::response(const EffectSetting& setting, const DriveModelConfig& drive,
                              const EffectSetting* coupling, Rate rate) const {
  DriveEffectsConfig alone;
  alone.sample_period_s = work_period_s;
  alone.settings[0] = setting;
  alone.count = 1;
  if (!DriveEffects<double>::validate(alone).ok()) return {};
  DriveFacts facts;
  facts.sample_period_s = work_period_s;
  facts.inertia = drive.inertia;
  facts.viscous = drive.viscous;
  facts.coulomb = drive.coulomb;
  facts.constant_load = drive.constant_load;
  facts.friction_knee = drive.friction_knee;
  facts.unit_per_turn = drive.unit_per_turn;
  facts.load_inertia_share = drive.load_inertia_share;
  facts.load_friction_share = drive.load_friction_share;
  facts.effort_per_ampere = drive.effort_per_ampere;
  facts.coupling = coupling;
  Response r;
  if (!drive_any(setting, facts, *this, drive, rate, r,
                 std::make_index_sequence<kDriveEffectCount>{}))
    return {};

  Column out = !r.rows.empty()   ? r.rows
               : r.force.empty() ? Column(rows(), 0)
                                 : driven_to_rows(r.force);
  if (r.load.inertia > 0) add_to(out, -r.load.inertia * drive.inertia, acceleration_rows);
  if (!r.linear.empty()) add_to(out, 1, to_rows(r.linear));
  if (!r.acting.empty()) add_to(out, 1, to_rows(r.acting));
  if (!r.error.empty()) {
    // What the drive really did is the measured motion less this error.
    add_to(out, -drive.inertia, driven_to_rows(r.error, 2));
    add_to(out, -drive.viscous, driven_to_rows(r.error, 1));
  }
  return out;
}

}  // namespace servosense::reconcile
