#include "servosense/identify/slow_vibration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>

#include "dsp/dense.hpp"
#include "dsp/fourier.hpp"
#include "servosense/core/units.hpp"

namespace servosense {
namespace {

// Of the rate: up to there what is slower than a turn is not heard, a tenth of the band at most.
// Convention.
constexpr double kCourse = 0.05;
constexpr int kDegree = 3;
constexpr unsigned kTurnHarmonics = 40;  // of the rotation
constexpr double kHighest_hz = 4000;     // no drive reports a current beyond
constexpr double kMostColumns = 0.25;    // of the window
constexpr std::size_t kLowest = 4;       // bins: below, what the polynomial leaves of a cut
constexpr double kLowest_hz = 6;         // and what a cut is uneven by
constexpr double kEnters = 0.25;         // step of the mean, in parts of the rms: entry or exit
constexpr std::size_t kAround = 16;      // bins to either side whose median is the floor
constexpr std::size_t kBeside = 2;       // of them, those of the line itself
// Median over mean of the power in three bins behind a Hann window, white noise.
constexpr double kMedian = 0.83;
constexpr double kRunsAway = 0.04;  // change of speed in a window
// An uneven cut modulates what turns: about a multiple of power P, d bins away, up to so much of it
// over 1 + d^2 is its skirt. (5 % of unevenness, slower than 5 Hz, leave a tenth of that.)
constexpr double kSkirt = 0.1;
constexpr double kOwnShare = 0.5;  // of the windows in which an own line stands out

/// Multiples of the rotation that a cut may show.
std::vector<unsigned> multiples(unsigned teeth, double rotation_hz, std::size_t most) {
  std::vector<unsigned> all;
  const auto add = [&](unsigned h) {
    if (h >= 1 && h * rotation_hz <= kHighest_hz && all.size() < most &&
        std::find(all.begin(), all.end(), h) == all.end())
      all.push_back(h);
  };
  if (teeth > 1)
    for (unsigned k = 1; k * teeth * rotation_hz <= kHighest_hz && k <= 12; ++k)
      for (const unsigned h : {k * teeth, k * teeth - 1, k * teeth + 1}) add(h);
  for (unsigned h = 1; h <= kTurnHarmonics; ++h) add(h);
  return all;
}

/// Power of a line about each bin up to half the rate: three bins, Hann window.
std::vector<double> line_powers(const Eigen::VectorXd& x) {
  const auto n = static_cast<std::size_t>(x.size());
  std::vector<double> windowed(n);
  for (std::size_t i = 0; i < n; ++i)
    windowed[i] = x(static_cast<Eigen::Index>(i)) * 0.5 *
                  (1 - std::cos(kTwoPi * (static_cast<double>(i) + 0.5) / static_cast<double>(n)));
  const std::vector<std::complex<double>> spectrum = fourier_lines(windowed);
  const double scale = 2 / (static_cast<double>(n) * static_cast<double>(n) * 0.375);
  std::vector<double> line(n / 2 + 1, 0.0);
  for (std::size_t k = 1; k < line.size(); ++k)
    for (const std::size_t i : {k - 1, k, k + 1})
      if (i < line.size()) line[k] += scale * std::norm(spectrum[i]);
  return line;
}

/// What an uneven cut may leave beside its lines.
std::vector<double> skirts_of(const std::vector<double>& line) {
  std::vector<double> skirt(line.size(), 0.0);
  for (std::size_t j = 1; j + 1 < line.size(); ++j) {
    if (line[j] < line[j - 1] || line[j] < line[j + 1]) continue;
    for (std::size_t k = 0; k < skirt.size(); ++k) {
      const double d = static_cast<double>(k) - static_cast<double>(j);
      skirt[k] = std::max(skirt[k], kSkirt * line[j] / (1 + d * d));
    }
  }
  return skirt;
}

}  // namespace

SlowVibration::SlowVibration(const SlowVibrationConfig& config)
    : config_(config),
      window_(std::max<std::size_t>(
          kLeastWindow, static_cast<std::size_t>(kWindow_s / config.sample_period_s) / 2 * 2)) {
  lowest_ = std::max(kLowest, static_cast<std::size_t>(kLowest_hz / bin_hz()));
  own_.assign(window_ / 2 + 1, false);
  for (const double hz : config_.own_lines_hz) {
    const auto k = static_cast<std::ptrdiff_t>(std::lround(hz / bin_hz()));
    for (std::ptrdiff_t i = k - 1; i <= k + 1; ++i)
      if (i >= 0 && i < static_cast<std::ptrdiff_t>(own_.size()))
        own_[static_cast<std::size_t>(i)] = true;
  }
}

double SlowVibration::bin_hz() const noexcept {
  return 1 / (static_cast<double>(window_) * config_.sample_period_s);
}
double SlowVibration::minimum_speed_rad_s() const noexcept {
  return kTwoPi * kLeastTurns * bin_hz();
}

std::optional<SlowVibrationVerdict> SlowVibration::add(double torque_Nm, double increment_rad,
                                                       Quality quality) {
  ++samples_;
  const bool good = !has(quality, kUnusable | Quality::gap | Quality::restarted) &&
                    std::isfinite(torque_Nm) && std::isfinite(increment_rad);
  if (!good) {
    torque_.clear();
    angle_.clear();
    windows_ = 0;
    return std::nullopt;
  }
  turned_ += increment_rad;
  torque_.push_back(torque_Nm);
  angle_.push_back(turned_);
  if (torque_.size() < window_) return std::nullopt;
  const bool turns = transform();
  windows_ = turns ? windows_ + 1 : 0;
  const auto half = static_cast<std::ptrdiff_t>(window_ / 2);
  torque_.erase(torque_.begin(), torque_.begin() + half);
  angle_.erase(angle_.begin(), angle_.begin() + half);
  if (windows_ < 3) return std::nullopt;
  return verdict();
}

bool SlowVibration::transform() {
  const auto n = static_cast<Eigen::Index>(window_);
  const std::size_t middle = window_ / 2;
  const double first = angle_[middle] - angle_[0], second = angle_[window_ - 1] - angle_[middle];
  const double turned = std::abs(first + second);
  if (turned < kTwoPi * kLeastTurns * (1 - 1.0 / static_cast<double>(window_)) ||
      std::abs(first - second) > kRunsAway / 2 * turned)
    return false;
  const double rotation_hz = turned / kTwoPi * bin_hz();
  const std::vector<unsigned> h = multiples(
      config_.teeth, rotation_hz,
      static_cast<std::size_t>(kMostColumns / 2 * static_cast<double>(window_)) - kDegree);
  // What modulates evenly: rotation and tooth passing.
  std::vector<unsigned> modulated = {1};
  const unsigned tooth = config_.teeth > 1 ? config_.teeth : 2;
  for (unsigned k = 1; k <= 6 && k * tooth * rotation_hz <= kHighest_hz; ++k)
    modulated.push_back(k * tooth);

  const auto columns = static_cast<Eigen::Index>(kDegree + 1 + 2 * h.size() + 2 * modulated.size());
  Eigen::MatrixXd a(n, columns);
  Eigen::VectorXd y(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto at = static_cast<std::size_t>(i);
    y(i) = torque_[at];
    const double t = 2 * static_cast<double>(i) / static_cast<double>(n - 1) - 1;
    Eigen::Index c = 0;
    double power = 1;
    for (int d = 0; d <= kDegree; ++d, power *= t) a(i, c++) = power;
    const double angle = angle_[at] - angle_[0];
    for (const unsigned k : h) {
      a(i, c++) = std::cos(k * angle);
      a(i, c++) = std::sin(k * angle);
    }
    for (const unsigned k : modulated) {
      a(i, c++) = t * std::cos(k * angle);
      a(i, c++) = t * std::sin(k * angle);
    }
  }
  mean_ = y.mean();
  load_ = y.squaredNorm() / static_cast<double>(n);
  const double step = y.head(n / 2).mean() - y.tail(n / 2).mean();
  const bool enters = std::abs(step) > kEnters * std::sqrt(load_);
  // Multiples that fold onto each other are one column twice: the ridge shares it out.
  Eigen::MatrixXd normal = a.transpose() * a;
  normal.diagonal().array() += 1e-7 * static_cast<double>(n);
  const Eigen::VectorXd fitted = dense::solve_symmetric(normal, a.transpose() * y);
  const Eigen::VectorXd turning =
      a.rightCols(columns - (kDegree + 1)) * fitted.tail(columns - (kDegree + 1));
  const Eigen::VectorXd e = y - a.leftCols(kDegree + 1) * fitted.head(kDegree + 1) - turning;

  const std::size_t bins = window_ / 2 + 1;
  for (auto* three : {&lines_, &ratios_, &skirts_})
    std::rotate(three->begin(), three->end() - 1, three->end());
  std::rotate(loads_.begin(), loads_.end() - 1, loads_.end());
  loads_[0] = load_;
  std::vector<double>& line = lines_[0];
  std::vector<double>& ratio = ratios_[0];
  line = line_powers(e);
  ratio.assign(bins, 0.0);
  floor_.assign(bins, 0.0);
  skirts_[0] = skirts_of(line_powers(turning));
  // Bins that hold a multiple of the rotation have nothing left: they tell of no floor.
  std::vector<bool> taken(bins, false);
  const double rate = 1 / config_.sample_period_s;
  for (const unsigned multiple : h) {
    double hz = std::fmod(multiple * rotation_hz, rate);
    if (hz > rate / 2) hz = rate - hz;
    const auto bin = static_cast<std::size_t>(std::lround(hz / bin_hz()));
    if (bin < bins) taken[bin] = true;
  }
  // Slower than a turn a cut swings with its course: stock, path, pumps.
  const double course_hz = std::min(rotation_hz, kCourse * rate);
  std::vector<double> near;
  std::size_t heard = 0;
  for (std::size_t k = lowest_; k + 1 < bins; ++k) {
    near.clear();
    const std::size_t from = k > kAround + 2 ? k - kAround : 2;
    for (std::size_t i = from; i < std::min(bins - 1, k + kAround + 1); ++i)
      if ((i + kBeside < k || i > k + kBeside) && !taken[i] && !own_[i]) near.push_back(line[i]);
    if (near.size() < 6) continue;
    const auto half = near.begin() + static_cast<std::ptrdiff_t>(near.size() / 2);
    std::nth_element(near.begin(), half, near.end());
    floor_[k] = *half / kMedian;
    if (own_[k] || !(floor_[k] > 0) || static_cast<double>(k) * bin_hz() < course_hz) continue;
    ratio[k] = enters ? 0.0 : line[k] / floor_[k];
    if (!taken[k]) ++heard;
  }
  heard_share_ = static_cast<double>(heard) / static_cast<double>(bins);
  return true;
}

SlowVibrationVerdict SlowVibration::verdict() const {
  SlowVibrationVerdict v;
  v.to = samples_;
  v.from = samples_ - 2 * window_;
  v.mean_Nm = mean_;
  v.load_Nm2 = load_;
  v.heard_share = heard_share_;
  const std::size_t bins = lines_[0].size();
  // What a cut leaves about its multiples while it begins or ends is in one of the three.
  const double share =
      config_.tolerated_load_share * *std::max_element(loads_.begin(), loads_.end());
  // The line may move by a bin from window to window.
  const auto about = [&](const std::vector<double>& of, std::size_t k) {
    return std::max({of[k - 1], of[k], k + 1 < bins ? of[k + 1] : 0.0});
  };
  double best_ratio = 0;
  for (std::size_t k = lowest_; k + 1 < bins; ++k) {
    if (own_[k]) continue;
    const double ratio =
        std::min({ratios_[0][k], about(ratios_[1], k), about(ratios_[2], k)}) / kLine;
    const double line = std::min({lines_[0][k], about(lines_[1], k), about(lines_[2], k)});
    const double beyond = line - std::max({share, skirts_[0][k], skirts_[1][k], skirts_[2][k]});
    if (ratio > 0) v.strongest_Nm2 = std::max(v.strongest_Nm2, beyond);
    const double strength = config_.threshold_Nm2 > 0 ? beyond / config_.threshold_Nm2 : ratio;
    const double value = std::min(ratio, strength);
    if (value > v.value || (v.value <= 0 && ratio > best_ratio)) {
      v.value = std::max(value, 0.0);
      best_ratio = ratio;
      v.line_Nm2 = line;
      v.apparent_hz = static_cast<double>(k) * bin_hz();
    }
  }
  std::vector<double> floors;
  for (const double f : floor_)
    if (f > 0) floors.push_back(f);
  if (!floors.empty()) {
    const auto half = floors.begin() + static_cast<std::ptrdiff_t>(floors.size() / 2);
    std::nth_element(floors.begin(), half, floors.end());
    v.needed_Nm2 = std::max(kLine * *half, share + config_.threshold_Nm2);
  }
  return v;
}

LearnedVibration learn_vibration(const SlowVibrationConfig& config,
                                 const std::vector<VibrationSample>& idle,
                                 double accepted_per_hour) {
  SlowVibrationConfig plain = config;
  plain.threshold_Nm2 = 0;
  plain.tolerated_load_share = 0;
  plain.own_lines_hz.clear();
  LearnedVibration learned;
  learned.accepted_per_hour = accepted_per_hour;
  {
    SlowVibration ear(plain);
    std::vector<double> times;
    std::size_t count = 0;
    for (const VibrationSample& s : idle) {
      if (!ear.add(s.torque_Nm, s.increment_rad, s.quality)) continue;
      const std::vector<double>& ratio = ear.over_floor();
      times.resize(ratio.size(), 0.0);
      for (std::size_t k = 1; k + 1 < ratio.size(); ++k)
        if (ratio[k] > SlowVibration::kLine && ratio[k] >= ratio[k - 1] && ratio[k] >= ratio[k + 1])
          ++times[k];
      ++count;
    }
    for (std::size_t k = 1; k + 1 < times.size(); ++k) {
      const double about = times[k - 1] + times[k] + times[k + 1];
      if (about > kOwnShare * static_cast<double>(count) && times[k] >= times[k - 1] &&
          times[k] > times[k + 1])
        learned.own_lines_hz.push_back(static_cast<double>(k) * ear.bin_hz());
    }
  }
  plain.own_lines_hz = learned.own_lines_hz;
  SlowVibration ear(plain);
  const double hop_s = static_cast<double>(ear.window()) / 2 * config.sample_period_s;
  for (const VibrationSample& s : idle)
    if (const auto v = ear.add(s.torque_Nm, s.increment_rad, s.quality)) {
      learned.add(v->strongest_Nm2);
      learned.rate.add(std::sqrt(v->strongest_Nm2), hop_s);
    }
  return learned;
}

double LearnedVibration::threshold() const {
  const double level = rate.level(accepted_per_hour);
  return std::max(IdleStatistics::threshold(), level * level);
}
double LearnedVibration::alarms_per_hour() const { return rate.per_hour(std::sqrt(threshold())); }

std::vector<double> folded_frequencies(double apparent_hz, double rate_hz, double highest_hz) {
  std::vector<double> all;
  for (unsigned k = 0; k * rate_hz - apparent_hz <= highest_hz; ++k) {
    if (k > 0) all.push_back(k * rate_hz - apparent_hz);
    if (k * rate_hz + apparent_hz <= highest_hz) all.push_back(k * rate_hz + apparent_hz);
  }
  return all;
}

}  // namespace servosense
