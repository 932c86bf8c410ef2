#include "drive_signals.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <tuple>
#include <type_traits>
#include <utility>

#include "servosense/core/units.hpp"
#include "servosense/model/elastoplastic_sign.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kWorkRate = 16;      // per corner: room for friction's harmonics and stiff loads
constexpr double kRowRate = 5;        // the Gaussian is 19 dB down where rows begin to alias
constexpr double kFirstCorner = 0.2;  // of the working rate
constexpr double kFine_s = 1.25e-4;   // of the motion between samples
constexpr double kFastest_hz = 400;  // of the motion that drives friction: beyond lie encoder steps
constexpr double kForgotten = 200;   // knees
constexpr double kRest_s = 0.05;     // friction creeps: slower than a knee in this time is rest
constexpr double kHighestCorner_hz = 70;  // above it lie the modes that every machine has
constexpr double kLowestCorner_hz = 12;
constexpr double kTolerable = 1e-3;     // of the effort: noise of the acceleration, times inertia
constexpr double kHalfPower = 0.13253;  // corner * standard deviation: sqrt(ln 2) / 2 pi

/// Standard deviation of the white part of a signal, from its fourth differences where it moves.
double white_noise(const Column& x, double moving) {
  std::vector<double> d;
  for (std::size_t i = 4; i < x.size(); ++i) {
    if (!(std::abs(x[i] - x[i - 4]) > moving)) continue;
    d.push_back(std::abs(x[i] - 4 * x[i - 1] + 6 * x[i - 2] - 4 * x[i - 3] + x[i - 4]));
  }
  if (d.size() < 100) return 0;
  const auto middle = d.begin() + static_cast<long>(d.size() / 2);
  std::nth_element(d.begin(), middle, d.end());
  return *middle / 0.6745 / std::sqrt(70.0);
}

/// What the encoder's noise, white, does to the force of inertia through the filter: the integral
/// of u^4 2^-u^2 over positive u is 1.66.
double force_of_position_noise(const DriveData& data, double position_noise, double corner) {
  return data.model.inertia * kTwoPi * kTwoPi * position_noise *
         std::sqrt(2 * data.sample_period_s * 1.66 * std::pow(corner, 5));
}

}  // namespace

Column difference(Column a, const Column& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] -= b[i];
  return a;
}

double between_samples(const Column& samples, double index) {
  const double at = std::clamp(index, 0.0, static_cast<double>(samples.size() - 1));
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, samples.size() - 1);
  return samples[below] + (at - static_cast<double>(below)) * (samples[above] - samples[below]);
}

double comparison_corner(const DriveData& data) {
  const std::size_t n = data.samples.size();
  Column position(n), effort(n);
  double at = 0, square = 0, fastest = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (i > 0) at += data.samples[i].increment;
    fastest = std::max(fastest, std::abs(data.samples[i].increment));
    position[i] = at;
    effort[i] = data.samples[i].effort;
    square += effort[i] * effort[i];
  }
  const double effort_rms = std::sqrt(square / static_cast<double>(std::max<std::size_t>(1, n)));
  const double position_noise = std::max(std::abs(data.unit_per_count) / std::sqrt(12.0),
                                         white_noise(position, 0.1 * fastest));
  const double effort_noise = white_noise(effort, 0);
  const double highest = std::min(kHighestCorner_hz, 0.1 / data.sample_period_s);
  for (double corner = highest; corner > kLowestCorner_hz; corner *= 0.9) {
    // Through the Gaussian: the integral of 2^-u^2 over positive u.
    const double force = effort_noise * std::sqrt(2 * data.sample_period_s * 1.0645 * corner);
    if (force_of_position_noise(data, position_noise, corner) <
        std::max(0.5 * force, kTolerable * effort_rms))
      return corner;
  }
  return std::min(highest, kLowestCorner_hz);
}

double encoder_floor(const DriveData& data, double corner) {
  double noise = std::abs(data.unit_per_count) / std::sqrt(12.0);
  if (data.unit_per_count == 0 && 0.1 / data.sample_period_s >= kHighestCorner_hz) {
    // Slower rows would take motion for noise.
    Column position;
    double at = 0, fastest = 0;
    for (const auto& sample : data.samples) {
      if (!position.empty()) at += sample.increment;
      fastest = std::max(fastest, std::abs(sample.increment));
      position.push_back(at);
    }
    noise = white_noise(position, 0.1 * fastest);
  }
  return force_of_position_noise(data, noise, corner);
}

Smoother::Smoother(double corner_hz, double period_s) : reach_(1) {
  const double sigma = std::max(0.45, kHalfPower / (corner_hz * period_s));  // samples
  reach_ = static_cast<std::size_t>(std::ceil(4.5 * sigma));
  const auto n = static_cast<long>(reach_);
  double sum = 0, first = 0, second = 0, level = 0;
  for (int order = 0; order < 3; ++order) kernel_[order].assign(2 * reach_ + 1, 0);
  for (long i = -n; i <= n; ++i) {
    const double t = static_cast<double>(i) / sigma;
    const double g = std::exp(-0.5 * t * t);
    const auto at = static_cast<std::size_t>(i + n);
    kernel_[0][at] = g;
    kernel_[1][at] = t * g;
    kernel_[2][at] = (t * t - 1) * g;
    sum += g;
    level += kernel_[2][at];
  }
  for (std::size_t at = 0; at < kernel_[0].size(); ++at) {
    kernel_[0][at] /= sum;
    kernel_[2][at] -= level * kernel_[0][at];
  }
  for (long i = -n; i <= n; ++i) {
    const auto at = static_cast<std::size_t>(i + n);
    first += static_cast<double>(i) * period_s * kernel_[1][at];
    second += 0.5 * static_cast<double>(i * i) * period_s * period_s * kernel_[2][at];
  }
  for (std::size_t at = 0; at < kernel_[0].size(); ++at) {
    kernel_[1][at] /= first;
    kernel_[2][at] /= second;
  }
}

Column Smoother::apply(const Column& samples, int order, std::size_t stride) const {
  const std::vector<double>& kernel = kernel_[order];
  const auto n = static_cast<long>(samples.size());
  const auto reach = static_cast<long>(reach_);
  Column out;
  out.reserve(samples.size() / stride + 1);
  for (long i = 0; i < n; i += static_cast<long>(stride)) {
    double sum = 0;
    if (i >= reach && i + reach < n) {
      const double* from = samples.data() + (i - reach);
      for (std::size_t k = 0; k < kernel.size(); ++k) sum += kernel[k] * from[k];
    } else {
      for (long k = -reach; k <= reach; ++k) {
        const long at = std::clamp(i + k, 0L, n - 1);
        sum += kernel[static_cast<std::size_t>(k + reach)] * samples[static_cast<std::size_t>(at)];
      }
    }
    out.push_back(sum);
  }
  return out;
}

DriveSignals::DriveSignals(const DriveData& data, double corner)
    : corner_hz(corner),
      first_stride_(std::max<std::size_t>(
          1,
          static_cast<std::size_t>(std::lround(1 / (kWorkRate * corner * data.sample_period_s))))),
      first_(kFirstCorner / (static_cast<double>(first_stride_) * data.sample_period_s),
             data.sample_period_s),
      rows_(corner, static_cast<double>(first_stride_) * data.sample_period_s),
      // Gaussians in a row: the squares of their widths add.
      driven_(corner / std::hypot(1.0, corner * static_cast<double>(first_stride_) *
                                           data.sample_period_s / kFirstCorner),
              static_cast<double>(first_stride_) * data.sample_period_s) {
  work_period_s = static_cast<double>(first_stride_) * data.sample_period_s;
  stride_ =
      std::max<std::size_t>(1, static_cast<std::size_t>(1 / (kRowRate * corner * work_period_s)));
  const std::size_t n = data.samples.size();
  Column raw_position(n), raw_effort(n);
  double at = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (i > 0) at += data.samples[i].increment;
    raw_position[i] = at;
    raw_effort[i] = data.samples[i].effort;
  }
  path_ = Smoother(std::min(kFirstCorner / data.sample_period_s, kFastest_hz), data.sample_period_s)
              .apply(raw_position, 0, 1);
  sample_period_s_ = data.sample_period_s;
  position = to_work(raw_position);
  effort = to_work(raw_effort);
  const std::size_t m = position.size();
  const double start = position.empty() ? 0 : position[0];
  const double unit = data.model.unit_per_turn > 0 ? data.model.unit_per_turn : kTwoPi;
  const double angle0 = n > 0 ? data.samples[0].turn_angle_rad : 0;
  time_s.resize(m);
  turn_angle.resize(m);
  for (std::size_t i = 0; i < m; ++i) {
    time_s[i] = data.start_s + static_cast<double>(i) * work_period_s;
    const double turns = angle0 / kTwoPi + position[i] / unit;
    turn_angle[i] = kTwoPi * (turns - std::floor(turns));
  }
  for (double& x : position) x -= start;
  recorded_path_ = path_;
  recorded_position_ = position;
  recorded_angle_ = turn_angle;
  differentiate();

  faulty.assign(m, false);
  const auto reach = static_cast<long>(first_.reach());
  for (std::size_t i = 0; i < n; ++i) {
    if (!has(data.samples[i].quality,
             kUnusable | Quality::gap | Quality::restarted | Quality::saturated))
      continue;
    if (i == 0) continue;  // every record begins with a restart
    const long from =
        std::max(0L, (static_cast<long>(i) - reach) / static_cast<long>(first_stride_));
    const long to = std::min(static_cast<long>(m) - 1,
                             (static_cast<long>(i) + reach) / static_cast<long>(first_stride_) + 1);
    for (long k = from; k <= to; ++k) faulty[static_cast<std::size_t>(k)] = true;
  }

  // At rest friction may hold any force: those rows say nothing.
  resting.assign(m, true);
  const auto window =
      std::max<std::size_t>(1, static_cast<std::size_t>(0.5 * kRest_s / work_period_s));
  const double least = 2 * data.model.friction_knee;
  for (std::size_t i = 0; i < m; ++i) {
    const std::size_t from = i > window ? i - window : 0;
    const std::size_t to = std::min(m - 1, i + window);
    resting[i] = std::abs(position[to] - position[from]) < least;
  }
  // A reversal is no rest: what stands still for a moment between moves counts.
  std::vector<bool> moving(m, false);
  const auto longest = static_cast<std::size_t>(2 * kRest_s / work_period_s);
  for (std::size_t i = 0; i < m;) {
    std::size_t end = i;
    while (end < m && resting[end] == resting[i]) ++end;
    if (resting[i] && end - i <= longest)
      for (std::size_t k = i; k < end; ++k) moving[k] = true;
    i = end;
  }
  for (std::size_t i = 0; i < m; ++i)
    if (moving[i]) resting[i] = false;
  // A rest leaves friction anywhere within its knee: the first travel afterwards tells no law.
  double left_at = 0;
  bool settling = false;
  for (std::size_t i = 0; i < m; ++i) {
    if (resting[i]) left_at = position[i];
    settling = resting[i] || (settling && std::abs(position[i] - left_at) < least);
    resting[i] = settling;
  }

  // What friction remembers from before the record is forgotten after so much travel.
  for (std::size_t i = 0; i < m && std::abs(position[i]) < kForgotten * data.model.friction_knee;
       ++i)
    faulty[i] = true;

  smooth_direction = direction(data.model.friction_knee);
  reported_velocity = velocity_rows;
  reported_acceleration = acceleration_rows;
  usable.assign(rows(), true);
  const std::size_t memory = rows_.reach();
  for (std::size_t r = 0; r < usable.size(); ++r) {
    const std::size_t i = r * stride_;
    if (i < 2 * memory || i + 2 * memory >= m || resting[i]) {
      usable[r] = false;
      continue;
    }
    for (std::size_t k = i - memory; k <= i + memory; ++k)
      if (faulty[k]) {
        usable[r] = false;
        break;
      }
  }
}

void DriveSignals::differentiate() {
  const std::size_t m = position.size();
  increment.assign(m, 0);
  velocity.assign(m, 0);
  for (std::size_t i = 0; i < m; ++i) {
    if (i > 0) increment[i] = position[i] - position[i - 1];
    if (i > 0 && i + 1 < m) velocity[i] = (position[i + 1] - position[i - 1]) / (2 * work_period_s);
  }
  smooth_velocity = rows_.apply(position, 1, 1);
  smooth_acceleration = rows_.apply(position, 2, 1);
  velocity_rows = to_rows(position, 1);
  acceleration_rows = to_rows(position, 2);
  position_rows = to_rows(position, 0);
}

/// theta = theta_measured - a sin(theta + p), a = 2 pi A / unit < 1, is Kepler's equation: Newton,
/// bounded steps, converges for any a < 1 (Danby and Burkardt 1983); these a are small.
bool DriveSignals::correct_angle(double amplitude, double phase_rad, double unit_per_turn) {
  constexpr double kSteepest = 0.7;
  constexpr int kIterations = 6;  // quadratic: below rounding long before, at a of 0.7
  const double a = kTwoPi * amplitude / unit_per_turn;
  if (!(std::abs(a) < kSteepest)) return false;
  Column error(position.size());
  for (std::size_t i = 0; i < error.size(); ++i) {
    const double measured = recorded_angle_[i] + phase_rad;
    double theta = measured - a * std::sin(measured);
    for (int k = 0; k < kIterations; ++k)
      theta -= (theta + a * std::sin(theta) - measured) / (1 + a * std::cos(theta));
    error[i] = amplitude * std::sin(theta);
    const double turns = (theta - phase_rad) / kTwoPi;
    turn_angle[i] = kTwoPi * (turns - std::floor(turns));
  }
  // The motion was smoothed on its way to the working rate, and so was its error.
  const Column smooth = Smoother(kFirstCorner / work_period_s, work_period_s).apply(error, 0, 1);
  const double start = smooth.empty() ? 0 : smooth[0];
  for (std::size_t i = 0; i < position.size(); ++i)
    position[i] = recorded_position_[i] - (smooth[i] - start);
  const auto stride = static_cast<double>(first_stride_);
  for (std::size_t i = 0; i < path_.size(); ++i)
    path_[i] =
        recorded_path_[i] - (between_samples(smooth, static_cast<double>(i) / stride) - start);
  differentiate();
  return true;
}

Column DriveSignals::direction(double knee) const {
  ElastoplasticSign<double> sign;
  sign.configure(knee);
  Column out;
  out.reserve(increment.size());
  for (const double dx : increment) out.push_back(sign.process(dx));
  return out;
}

double DriveSignals::path_step_s() const {
  return 0.5 * sample_period_s_ / std::ceil(0.5 * sample_period_s_ / kFine_s);
}

/// Between samples a cubic (Catmull and Rom 1974): a drive that stops turns round within one. Each
/// sample stands for the half periods around it.
template <typename Law>
Column DriveSignals::along_path(Law law) const {
  const double step_s = path_step_s();
  const auto half = static_cast<std::size_t>(std::lround(0.5 * sample_period_s_ / step_s));
  const std::size_t steps = 2 * half;
  const std::size_t n = path_.size();
  Column out(n, 0);
  double at = n > 0 ? path_[0] : 0;
  for (std::size_t i = 1; i < n; ++i) {
    const double from = path_[i - 1], to = path_[i];
    const double slope = i > 1 ? 0.5 * (to - path_[i - 2]) : to - from;
    const double next = i + 1 < n ? 0.5 * (path_[i + 1] - from) : to - from;
    const double second = 3 * (to - from) - 2 * slope - next;
    const double third = slope + next - 2 * (to - from);
    double sum = 0;
    for (std::size_t k = 0; k < steps; ++k) {
      const double t = (static_cast<double>(k) + 0.5) / static_cast<double>(steps);
      const double x = from + t * (slope + t * (second + t * third));
      const double working = (static_cast<double>(i - 1) + t) / static_cast<double>(first_stride_);
      sum += law(x - at, step_s, working);
      at = x;
      if (k + 1 == half) {
        out[i - 1] += sum / static_cast<double>(i > 1 ? steps : half);
        sum = 0;
      }
    }
    out[i] = sum / static_cast<double>(i + 1 < n ? steps : half);
  }
  return to_rows(to_work(out));
}

Column DriveSignals::direction_rows(double knee) const {
  ElastoplasticSign<double> sign;
  sign.configure(knee);
  return along_path([&](double dx, double /*seconds*/, double /*at*/) { return sign.process(dx); });
}

Column DriveSignals::bristle_rows(double travel) const {
  double bristle = 0;
  return along_path([&](double dx, double /*seconds*/, double /*at*/) {
    const double end = dx < 0 ? -1 : 1;
    if (bristle == end) return end;  // most of the way
    return bristle = end + (bristle - end) * std::exp(-std::abs(dx) / travel);
  });
}

Column DriveSignals::speed_direction_rows(double speed) const {
  return along_path([&](double /*dx*/, double /*seconds*/, double at) {
    return std::tanh(between_samples(velocity, at) / speed);
  });
}

double DriveSignals::share_passed_again() const {
  constexpr std::size_t kPlaces = 64;
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (std::size_t i = 0; i < usable.size(); ++i)
    if (usable[i]) {
      low = std::min(low, position_rows[i]);
      high = std::max(high, position_rows[i]);
    }
  if (!(high > low)) return 0;
  std::array<std::size_t, kPlaces> rows{}, passes{};
  std::size_t at = kPlaces, moving = 0;
  for (std::size_t i = 0; i < usable.size(); ++i) {
    if (!usable[i]) continue;
    const double place = (position_rows[i] - low) / (high - low) * kPlaces;
    const std::size_t now = std::min(kPlaces - 1, static_cast<std::size_t>(place));
    if (now != at) ++passes[now];
    at = now;
    ++rows[now];
    ++moving;
  }
  std::size_t again = 0;
  for (std::size_t i = 0; i < kPlaces; ++i)
    if (passes[i] > 1) again += rows[i];
  return static_cast<double>(again) / static_cast<double>(moving);
}

/// sigma1 dz/dt exp(-(v/vd)^2) (Canudas de Wit et al. 1995; Olsson 1996). vd: the speed at which
/// the inertia on its bristles would cross the knee.
Column DriveSignals::bristle_damping(const DriveModelConfig& drive) const {
  if (!(drive.coulomb > 0)) return Column(rows(), 0);
  const double per_square = drive.inertia / (drive.coulomb * drive.friction_knee);
  ElastoplasticSign<double> sign;
  sign.configure(drive.friction_knee);
  double before = 0;
  return along_path([&](double dx, double seconds, double /*at*/) {
    const double now = sign.process(dx);
    const double v = dx / seconds;
    const double rate = (now - std::exchange(before, now)) / seconds;
    return rate == 0 ? 0.0 : rate * std::exp(-v * v * per_square);
  });
}

Column DriveSignals::effort_rows(double delay_s) const {
  const double shift = delay_s / work_period_s;
  Column late(effort.size());
  for (std::size_t i = 0; i < late.size(); ++i)
    late[i] = between_samples(effort, static_cast<double>(i) - shift);
  return to_rows(late);
}

namespace {

/// What one effect does along a motion, by the members it has.
struct Response {
  Column force, linear, acting, error;  ///< empty where it has no such part
  Column rows;                          ///< the force in rows, where driven along the record
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

/// With the speed: faster than the working rate shows.
template <typename Effect>
Column follow_the_speed(const EffectSetting& setting, DriveFacts facts, const DriveSignals& s,
                        const Column& required) {
  facts.sample_period_s = s.path_step_s();
  Effect effect;
  effect.configure(setting, facts);
  effect.reset();
  MotionState<double> m;
  return s.along_path([&](double /*dx*/, double /*seconds*/, double at) {
    m.position = between_samples(s.position, at);
    m.velocity = between_samples(s.velocity, at);
    m.effort = between_samples(required, at);
    m.direction = std::tanh(m.velocity / s.knee_speed);
    return effect.force(m);
  });
}

template <typename Effect>
bool drive_effect(const EffectSetting& setting, const DriveFacts& facts, const DriveSignals& s,
                  const Column& required, Response& out) {
  if constexpr (requires { Effect::validate(setting, facts); })
    if (!Effect::validate(setting, facts).ok()) return false;
  if constexpr (kSwingsOver<Effect>)
    if (s.knee_speed > 0) {
      out.rows = follow_the_speed<Effect>(setting, facts, s, required);
      return true;
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
    m.acceleration = i > 0 && i + 1 < n ? (s.increment[i + 1] - s.increment[i]) * per_square : 0;
    m.effort = required[i];
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
    if constexpr (requires { effect->acting_effort(0.0); })
      out.acting.push_back(s.effort[i] - effect->acting_effort(s.effort[i]));
    if constexpr (requires { effect->position_error(m); })
      out.error.push_back(effect->position_error(m));
  }
  return true;
}

template <std::size_t... I>
bool drive_any(const EffectSetting& setting, const DriveFacts& facts, const DriveSignals& s,
               const Column& required, Response& out, std::index_sequence<I...>) {
  bool done = false;
  ((I == setting.effect
        ? void(done = drive_effect<std::tuple_element_t<I, DriveEffectList<double>>>(
                   setting, facts, s, required, out))
        : void()),
   ...);
  return done;
}

}  // namespace

Column DriveSignals::response(const EffectSetting& setting, const DriveModelConfig& drive,
                              const EffectSetting* coupling) const {
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
  facts.coupling = coupling;
  Response r;
  // What the motion takes, not what was measured: else whatever disturbs the effort would seem to
  // depend on the effort.
  Column required(position.size());
  for (std::size_t i = 0; i < required.size(); ++i)
    required[i] = drive.inertia * smooth_acceleration[i] + drive.viscous * smooth_velocity[i] +
                  drive.coulomb * smooth_direction[i] + drive.constant_load;
  if (!drive_any(setting, facts, *this, required, r, std::make_index_sequence<kDriveEffectCount>{}))
    return {};

  if (!r.rows.empty()) return r.rows;
  Column out = r.force.empty() ? Column(rows(), 0) : driven_to_rows(r.force);
  const auto add = [&](double factor, const Column& column) {
    for (std::size_t i = 0; i < out.size(); ++i) out[i] += factor * column[i];
  };
  if (r.load.inertia > 0) add(-r.load.inertia * drive.inertia, acceleration_rows);
  if (!r.linear.empty()) add(1, to_rows(r.linear));
  if (!r.acting.empty()) add(1, to_rows(r.acting));
  if (!r.error.empty()) {
    // What the drive really did is the measured motion less this error.
    add(-drive.inertia, driven_to_rows(r.error, 2));
    add(-drive.viscous, driven_to_rows(r.error, 1));
  }
  return out;
}

}  // namespace servosense::reconcile
