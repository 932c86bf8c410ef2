#include "reconcile/drive/signals.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "reconcile/drive/raw_columns.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/elastoplastic_sign.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kWorkRate = 16;      // per corner: room for friction's harmonics and stiff loads
constexpr double kRowRate = 5;        // the Gaussian is 19 dB down where rows begin to alias
constexpr double kFirstCorner = 0.2;  // of the working rate
constexpr double kFastest_hz = 400;  // of the motion that drives friction: beyond lie encoder steps
constexpr double kForgotten = 200;   // presliding distances
constexpr double kRest_s =
    0.05;  // friction creeps: slower than a presliding distance in this time is rest

/// Of a mode that the file has, where it lies in the band: the antiresonance of the motor, at which
/// the load swings while the motor stands still, w sqrt(1 - share) (Koike 2016, eq. 2-14). There
/// the motion tells next to nothing of the force: what the encoder does not resolve and what
/// friction stirs up in the load come out multiplied by 1 / (1 - (f / fa)^2), up to some ten times
/// what they are, and so does a frequency that is off by little. The hole is so wide that no force
/// counts more in it than on a rigid drive.
Notch antiresonance(const DriveData& data, double corner) {
  constexpr double kWidth = 0.25;  // of the frequency: the product stays below 1.2
  constexpr double kBeyond =
      2.5;  // corners: the Gaussian leaves a ninth of it, less than the notch
  const EffectSetting* mode = data.model.effects.find("flexible-coupling");
  if (mode == nullptr) return {};
  const double at = mode->scalar(0) * std::sqrt(std::max(0.0, 1 - mode->scalar(2)));
  return at > 0 && at < kBeyond * corner ? Notch{at, kWidth * at} : Notch{};
}

}  // namespace

DriveSignals::DriveSignals(const DriveData& data, double corner)
    : corner_hz(corner),
      first_stride_(std::max<std::size_t>(
          1,
          static_cast<std::size_t>(std::lround(1 / (kWorkRate * corner * data.sample_period_s))))),
      first_(kFirstCorner / (static_cast<double>(first_stride_) * data.sample_period_s),
             data.sample_period_s),
      rows_(corner, static_cast<double>(first_stride_) * data.sample_period_s,
            antiresonance(data, corner)),
      // Gaussians in a row: the squares of their widths add.
      driven_(corner / std::hypot(1.0, corner * static_cast<double>(first_stride_) *
                                           data.sample_period_s / kFirstCorner),
              static_cast<double>(first_stride_) * data.sample_period_s,
              antiresonance(data, corner)) {
  work_period_s = static_cast<double>(first_stride_) * data.sample_period_s;
  stride_ =
      std::max<std::size_t>(1, static_cast<std::size_t>(1 / (kRowRate * corner * work_period_s)));
  const std::size_t n = data.samples.size();
  const Column recorded = raw_position(data);
  path_ = Smoother(std::min(kFirstCorner / data.sample_period_s, kFastest_hz), data.sample_period_s)
              .apply(recorded, 0, 1);
  sample_period_s_ = data.sample_period_s;
  find_ways();
  position = to_work(recorded);
  effort = to_work(raw_effort(data));
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

  reported_velocity = velocity_rows;
  reported_acceleration = acceleration_rows;
  mark_faulty(data);
  mark_resting(data.model.friction_knee);
  mark_usable();
}

/// What the filters smear of samples that do not count, and what friction has not forgotten yet.
void DriveSignals::mark_faulty(const DriveData& data) {
  const std::size_t n = data.samples.size(), m = position.size();
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
  // What friction remembers from before the record is forgotten after so much travel.
  for (std::size_t i = 0; i < m && std::abs(position[i]) < kForgotten * data.model.friction_knee;
       ++i)
    faulty[i] = true;
}

void DriveSignals::mark_resting(double presliding) {
  const std::size_t m = position.size();
  // At rest friction may hold any force: those rows say nothing.
  resting.assign(m, true);
  const auto window =
      std::max<std::size_t>(1, static_cast<std::size_t>(0.5 * kRest_s / work_period_s));
  const double least = 2 * presliding;
  for (std::size_t i = 0; i < m; ++i) {
    const auto from = position.begin() + static_cast<long>(i > window ? i - window : 0);
    const auto to = position.begin() + static_cast<long>(std::min(m - 1, i + window)) + 1;
    const auto [low, high] = std::minmax_element(from, to);
    resting[i] = *high - *low < least;
  }
  // A rest leaves friction anywhere within its presliding distance: the first travel afterwards
  // tells no law.
  double left_at = 0;
  bool settling = false;
  for (std::size_t i = 0; i < m; ++i) {
    if (resting[i]) left_at = position[i];
    settling = resting[i] || (settling && std::abs(position[i] - left_at) < least);
    resting[i] = settling;
  }
}

void DriveSignals::mark_usable() {
  const std::size_t m = position.size();
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
  find_ways();
  differentiate();
  return true;
}

Column DriveSignals::direction(double presliding) const {
  ElastoplasticSign<double> sign;
  sign.configure(presliding);
  Column out;
  out.reserve(increment.size());
  for (const double dx : increment) out.push_back(sign.process(dx));
  return out;
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

Column DriveSignals::effort_rows(double delay_s) const {
  const double shift = delay_s / work_period_s;
  Column late(effort.size());
  for (std::size_t i = 0; i < late.size(); ++i)
    late[i] = between_samples(effort, static_cast<double>(i) - shift);
  return to_rows(late);
}

}  // namespace servosense::reconcile
