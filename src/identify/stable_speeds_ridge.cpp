#include "stable_speeds_ridge.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <string>

#include "dsp/dense.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/short_time_fourier.hpp"
#include "stable_speeds_ramps.hpp"

namespace servosense {
namespace {

constexpr std::size_t kRidgeTeeth = 32;  // window of the ridge
constexpr double kStrong = 1e-3;         // of the power of strong chatter; weak chatter counts:
                                         // the cut is linear then
constexpr double kForced = 1e-3;         // of the forced power: below it nothing is chatter, nor
constexpr double kStrongest = 0.01;      // where the strongest stays below this
// Of the mean square of the torque: chatter of a fifth of its height; the record shows less of it
// than there is. The higher waves leave the work.
constexpr double kLeavesWork = 0.02;

/// The ramp of a cut, sampled per angle of the tooth.
struct Teeth {
  Eigen::MatrixXd torque;         // a row per tooth
  std::vector<double> t_s;        // middle of each tooth
  std::vector<double> speed_rpm;  // there
  double rate_rpm_per_s = 0;
};

/// Mean of the values within `reach` to either side; fewer at the ends, on both sides alike, so
/// that a straight line stays what it is.
std::vector<double> smoothed(const std::vector<double>& x, std::size_t reach) {
  std::vector<double> sum(x.size() + 1, 0.0), mean(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) sum[i + 1] = sum[i] + x[i];
  for (std::size_t i = 0; i < x.size(); ++i) {
    const std::size_t r = std::min({reach, i, x.size() - 1 - i});
    mean[i] = (sum[i + r + 1] - sum[i - r]) / static_cast<double>(2 * r + 1);
  }
  return mean;
}

Expected<Teeth> sample_teeth(const CuttingTorqueTrace& cut, const StableSpeedOptions& options,
                             const TorqueView& view) {
  const std::vector<double> torque = torque_in(cut, view);
  // Direction of rotation is of no matter.
  std::vector<double> speed = cut.spindle_speed_rad_s;
  for (double& v : speed) v = std::abs(v);
  const auto reach = static_cast<std::size_t>(0.01 * cut.sample_rate_hz);
  speed = smoothed(speed, reach);
  if (speed.size() < 2 * reach + 2)
    return data_error("the cut is shorter than 0.02 s: record the whole ramp");
  const auto high = std::max_element(speed.begin(), speed.end()) - speed.begin();
  const auto low = std::min_element(speed.begin(), speed.end()) - speed.begin();
  const double top = speed[static_cast<std::size_t>(high)];
  const double span = top - speed[static_cast<std::size_t>(low)];
  if (!(span > 0.1 * top))
    return data_error(
        "the spindle speed changes by less than 10 %: record one cut while the speed override "
        "falls steadily over the speeds of interest");
  // From the first speed to the last, without the dwells at either end.
  auto first = static_cast<std::size_t>(std::min(high, low));
  auto last = static_cast<std::size_t>(std::max(high, low));
  const double margin = 0.002 * span;
  while (first < last &&
         std::abs(speed[first + 1] - speed[static_cast<std::size_t>(std::min(high, low))]) < margin)
    ++first;
  while (last > first &&
         std::abs(speed[last - 1] - speed[static_cast<std::size_t>(std::max(high, low))]) < margin)
    --last;

  // Tooth angle in turns of the tooth passing, by the trapezoid.
  const auto teeth = static_cast<double>(options.teeth);
  std::vector<double> angle(last - first + 1, 0.0);
  for (std::size_t i = 1; i < angle.size(); ++i)
    angle[i] = angle[i - 1] + teeth * (speed[first + i - 1] + speed[first + i]) /
                                  (2 * kTwoPi * cut.sample_rate_hz);
  const auto rows = static_cast<std::size_t>(angle.back());
  if (rows < 2 * kRidgeTeeth + static_cast<std::size_t>(options.teeth))
    return data_error("only " + std::to_string(rows) +
                      " teeth pass during the ramp: let the speed change more slowly");
  if (cut.sample_rate_hz * kTwoPi < 8 * teeth * top)
    return data_error(
        "fewer than 8 samples per tooth: the sample rate is too low for this spindle speed");
  const auto bins = static_cast<std::size_t>(
      std::clamp(std::ceil(cut.sample_rate_hz * kTwoPi / (teeth * (top - span))), 8.0, 256.0));

  Teeth result;
  result.torque.resize(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(bins));
  result.rate_rpm_per_s = rpm_from_rad_s((low > high ? -span : span) * cut.sample_rate_hz /
                                         static_cast<double>(last - first));
  std::size_t at = 0;
  auto time_at = [&](double turns) {  // in samples from `first`
    while (at + 2 < angle.size() && angle[at + 1] <= turns) ++at;
    return static_cast<double>(at) + (turns - angle[at]) / (angle[at + 1] - angle[at]);
  };
  for (std::size_t n = 0; n < rows; ++n) {
    for (std::size_t b = 0; b < bins; ++b) {
      const double t =
          time_at(static_cast<double>(n) + static_cast<double>(b) / static_cast<double>(bins));
      const double share = t - static_cast<double>(at);
      const std::size_t i = first + at;
      result.torque(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(b)) =
          torque[i] + share * (torque[i + 1] - torque[i]);
      if (b == bins / 2) {
        result.t_s.push_back((static_cast<double>(first) + t) / cut.sample_rate_hz);
        result.speed_rpm.push_back(rpm_from_rad_s(speed[i] + share * (speed[i + 1] - speed[i])));
      }
    }
  }
  return result;
}

/// Of the difference of one revolution: what exp(g + 2 pi j u) keeps of its power.
double revolution_gain(double fraction, double growth, int teeth) {
  const double n = teeth;
  return std::norm(1.0 - std::polar(std::exp(-growth * n), -kTwoPi * fraction * n));
}

double at_tooth(const std::vector<double>& values, double tooth) {
  const double last = static_cast<double>(values.size() - 1);
  const double t = std::clamp(tooth, 0.0, last);
  const auto i = std::min(static_cast<std::size_t>(t), values.size() - 2);
  return values[i] + (t - static_cast<double>(i)) * (values[i + 1] - values[i]);
}

/// The pair of exponentials in a few teeth (rows) of all bins (columns).
struct Pair {
  double angle = 0;  // 0..1/2 turn per tooth
  double growth = 0;
  double power = 0;
  double rest = 0;  // mean square of what it leaves
  bool stands_out = false;
};

// ESPRIT (Roy & Kailath 1989) with the bins as snapshots: a pair and one real exponential, the
// slow change that is left of what repeats.
Pair pair_in(const Eigen::Ref<const Eigen::MatrixXd>& teeth) {
  constexpr Eigen::Index kExponentials = 3;
  const Eigen::Index count = teeth.rows(), rows = count / 2;
  Eigen::MatrixXd product = Eigen::MatrixXd::Zero(rows, rows);
  for (Eigen::Index i = 0; i + rows <= count; ++i) {
    const auto part = teeth.middleRows(i, rows);
    product.noalias() += part * part.transpose();
  }
  const dense::SymmetricEigen subspace = dense::symmetric_eigen(product);
  Pair result;
  const Eigen::VectorXd& weight = subspace.values;  // rising
  if (!(weight(rows - 1) > 0)) return result;
  // The pair takes the two largest; in white noise all are within a factor of two.
  result.stands_out = weight(rows - 1 - kExponentials) < 0.1 * weight(rows - 2);
  const Eigen::MatrixXd signal = subspace.vectors.rightCols(kExponentials);
  const Eigen::Matrix3d turn =
      dense::least_squares(signal.topRows(rows - 1), Eigen::MatrixXd(signal.bottomRows(rows - 1)));
  const Eigen::Vector3cd z = dense::eigenvalues(turn.cast<std::complex<double>>());
  Eigen::Index pair = -1, single = 0;
  for (Eigen::Index i = 0; i < 3; ++i) {
    if (z(i).imag() > 1e-9) pair = i;
    if (std::abs(z(i).imag()) <= 1e-9) single = i;
  }
  if (pair < 0 || std::abs(z(pair)) < 0.2 || std::abs(z(pair)) > 5) return {};
  result.angle = std::arg(z(pair)) / kTwoPi;
  result.growth = std::log(std::abs(z(pair)));
  // Its amplitude in the middle, by least squares.
  Eigen::MatrixXd shape(count, 3);
  const double alone = std::clamp(z(single).real(), 0.5, 2.0);
  for (Eigen::Index i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) - 0.5 * static_cast<double>(count - 1);
    shape(i, 0) = std::exp(result.growth * t) * std::cos(kTwoPi * result.angle * t);
    shape(i, 1) = std::exp(result.growth * t) * std::sin(kTwoPi * result.angle * t);
    shape(i, 2) = std::pow(alone, t);
  }
  const Eigen::MatrixXd amplitude = dense::least_squares(shape, Eigen::MatrixXd(teeth));
  // Three of the teeth's numbers went into it.
  result.rest = (teeth - shape * amplitude).squaredNorm() /
                static_cast<double>((count - kExponentials) * teeth.cols());
  result.power = 0.5 * amplitude.topRows(2).squaredNorm() / static_cast<double>(teeth.cols());
  return result;
}

void find_chatter(const Teeth& teeth, const Eigen::MatrixXd& change, const StableSpeedOptions& o,
                  Eigen::Index window, ChatterOfCut& found) {
  struct At {
    double tooth = 0;
    Pair pair;
  };
  std::vector<At> all;
  std::vector<double> power, rest;
  const double middle = 0.5 * static_cast<double>(o.teeth) + 0.5 * static_cast<double>(window - 1);
  for (Eigen::Index n = 0; n + window <= change.rows(); ++n) {
    At a{static_cast<double>(n) + middle, pair_in(change.middleRows(n, window))};
    // Next to a harmonic of the spindle the difference of a revolution leaves nothing to measure,
    // and what is there is forced vibration that changes.
    const double gain = revolution_gain(a.pair.angle, a.pair.growth, o.teeth);
    a.pair.power = gain > 0.2 ? a.pair.power / gain : 0;
    power.push_back(a.pair.power);
    if (a.pair.rest > 0) rest.push_back(a.pair.rest / 2);  // it is in both revolutions
    all.push_back(a);
  }
  const Eigen::RowVectorXd mean = teeth.torque.colwise().mean();
  const double forced =
      (mean.array() - mean.mean()).square().sum() / static_cast<double>(mean.size());
  const double strongest = percentile(power, 0.95);
  const double mean_square = mean.squaredNorm() / static_cast<double>(mean.size());
  found.leaves_work = strongest > kLeavesWork * mean_square;
  found.forced_Nm2 = forced;
  found.mean_Nm = mean.mean();
  found.strongest_Nm2 = strongest;
  found.noise_Nm2 = percentile(rest, 0.5);
  const double floor = std::max(kStrong * strongest, kForced * forced);
  auto good = [&](std::size_t i) {
    return strongest > kStrongest * forced && all[i].pair.stands_out && all[i].pair.power > floor &&
           std::abs(all[i].pair.growth) < 0.5;
  };
  // u + k rises with the tooth period inside a lobe, whatever the mode: that tells z from its
  // conjugate.
  std::size_t count = 0;
  std::vector<double> steps;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!good(i)) continue;
    ++count;
    if (i > 0 && good(i - 1)) steps.push_back(all[i].pair.angle - all[i - 1].pair.angle);
  }
  const double drift = percentile(steps, 0.5) * (teeth.rate_rpm_per_s < 0 ? 1 : -1);
  found.above = drift < 0;
  found.share =
      static_cast<double>(count) / static_cast<double>(std::max<std::size_t>(1, all.size()));
  auto fraction = [&](std::size_t i) {
    return found.above ? 1 - all[i].pair.angle : all[i].pair.angle;
  };
  for (std::size_t i = 1; i + 1 < all.size(); ++i) {
    if (!good(i)) continue;
    const double slope = (fraction(i + 1) - fraction(i - 1)) / 2;
    const double u = fraction(i);
    const double edge = std::min({u, 1 - u, std::abs(u - 0.5)});
    if (std::abs(slope) > 0.03 || edge < 0.02) continue;  // a jump, or on top of a harmonic
    found.chatter.push_back({60 / (o.teeth * at_tooth(teeth.speed_rpm, all[i].tooth)), u, slope / 2,
                             all[i].pair.growth, all[i].pair.power});
  }
}

// Power of the ridge by a short-time Fourier transform over the teeth: every sideband of the
// chatter falls on one line.
Expected<Done> find_ridge(const Teeth& teeth, const Eigen::MatrixXd& change,
                          const StableSpeedOptions& o, ChatterOfCut& found) {
  constexpr std::size_t kPoints = 256;
  const ShortTimeFourierConfig config{kRidgeTeeth, 1, kPoints, WindowShape::hann, Detrend::line};
  std::vector<double> sum;
  std::size_t frames = 0, lines = 0;
  double scale = 1;
  for (Eigen::Index b = 0; b < change.cols(); ++b) {
    const Eigen::VectorXd column = change.col(b);
    auto part = short_time_fourier(
        std::span(column.data(), static_cast<std::size_t>(column.size())), 1, config);
    if (!part) return part.error();
    frames = part->frames();
    lines = part->lines();
    scale = part->peak_to_mean_square / static_cast<double>(change.cols());
    if (sum.empty()) sum.assign(part->power.size(), 0.0);
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += part->power[i];
  }
  for (std::size_t f = 0; f < frames; ++f) {
    double best = -1, at = 0;
    for (std::size_t k = 0; k < lines; ++k) {
      const double u = static_cast<double>(k) / kPoints;
      const double p = sum[f * lines + k] / std::max(0.2, revolution_gain(u, 0, o.teeth));
      if (p > best) best = p, at = u;
    }
    const double tooth = static_cast<double>(f) + 0.5 * static_cast<double>(o.teeth) +
                         0.5 * static_cast<double>(kRidgeTeeth - 1);
    found.ridge.t_s.push_back(at_tooth(teeth.t_s, tooth));
    found.ridge.spindle_speed_rpm.push_back(at_tooth(teeth.speed_rpm, tooth));
    found.ridge.power_Nm2.push_back(best * scale);
    found.ridge_fraction.push_back(found.above ? 1 - at : at);
  }
  return Done{};
}

void find_minima(const StableSpeedOptions& o, ChatterOfCut& found) {
  ChatterRidge& r = found.ridge;
  const std::size_t n = r.t_s.size();
  for (std::size_t i = 0, a = 0, b = 0; i < n; ++i) {
    while (r.t_s[i] - r.t_s[a] > o.moving_average_s / 2) ++a;
    while (b < n && r.t_s[b] - r.t_s[i] <= o.moving_average_s / 2) ++b;
    double sum = 0;
    for (std::size_t j = a; j < b; ++j) sum += r.power_Nm2[j];
    r.average_Nm2.push_back(sum / static_cast<double>(b - a));
  }
  for (std::size_t i = 0; i < n;) {
    if (r.power_Nm2[i] >= r.average_Nm2[i]) {
      ++i;
      continue;
    }
    std::size_t end = i, least = i;
    for (; end < n && r.power_Nm2[end] < r.average_Nm2[end]; ++end)
      if (r.power_Nm2[end] < r.power_Nm2[least]) least = end;
    // A stretch that is cut off by the end of the record has its minimum elsewhere.
    const bool inside = i > 0 && end < n;
    if (inside) {
      PowerMinimum m;
      m.t_s = r.t_s[least];
      m.spindle_speed_rpm = r.spindle_speed_rpm[least];
      m.power_Nm2 = r.power_Nm2[least];
      m.average_Nm2 = r.average_Nm2[least];
      // Frequencies of the chatter that dies and of the one that follows.
      const double jump = found.ridge_fraction[i - 1] - found.ridge_fraction[end];
      m.frequency_jump = (found.rate_rpm_per_s < 0 ? jump : -jump) > 0.1;
      m.accepted = m.frequency_jump || m.power_Nm2 < 0.5 * m.average_Nm2;
      found.minima.push_back(m);
    }
    i = end;
  }
}

}  // namespace

std::vector<double> torque_in(const CuttingTorqueTrace& cut, const TorqueView& view) {
  const std::vector<double>& torque = view.inertia_alone ? cut.inertia_torque_Nm : cut.torque_Nm;
  return view.cutoff_hz > 0 ? low_passed(torque, cut.sample_rate_hz, view.cutoff_hz) : torque;
}

Expected<Done> check_cut(const CuttingTorqueTrace& cut, const StableSpeedOptions& options) {
  if (options.teeth < 1 || !(options.moving_average_s > 0) || !(cut.sample_rate_hz > 0))
    return usage_error(
        "stable speeds need at least one tooth, a moving average and a sample rate above zero");
  if (cut.torque_Nm.size() != cut.spindle_speed_rad_s.size())
    return usage_error("stable speeds need one spindle speed for each sample of the torque");
  if (!cut.inertia_torque_Nm.empty() && cut.inertia_torque_Nm.size() != cut.torque_Nm.size())
    return usage_error("stable speeds need one torque of the inertia for each sample, or none");
  for (std::size_t i = 0; i < cut.torque_Nm.size(); ++i) {
    if (!std::isfinite(cut.torque_Nm[i]) || !std::isfinite(cut.spindle_speed_rad_s[i]))
      return data_error("the cut holds a torque or speed that is not a number at sample " +
                        std::to_string(i) + ": cut the record to its good part");
  }
  return Done{};
}

Expected<Done> check_ramp(const CuttingTorqueTrace& ramp, const StableSpeedOptions& options) {
  if (auto teeth = sample_teeth(ramp, options, {}); !teeth) return teeth.error();
  return Done{};
}

Expected<ChatterOfCut> chatter_of(const CuttingTorqueTrace& cut, const StableSpeedOptions& options,
                                  const TorqueView& view) {
  auto teeth = sample_teeth(cut, options, view);
  if (!teeth) return teeth.error();
  ChatterOfCut found;
  found.rate_rpm_per_s = teeth->rate_rpm_per_s;
  const auto [slowest, fastest] =
      std::minmax_element(teeth->speed_rpm.begin(), teeth->speed_rpm.end());
  found.slowest_rpm = *slowest;
  found.fastest_rpm = *fastest;
  found.teeth = static_cast<double>(teeth->speed_rpm.size());
  const Eigen::Index revolution = options.teeth;
  const Eigen::Index rows = teeth->torque.rows() - revolution;
  const Eigen::MatrixXd change = teeth->torque.bottomRows(rows) - teeth->torque.topRows(rows);
  // The shortest window smears least, and eight teeth are the fewest that hold three exponentials
  // and show noise; a longer one where noise hides the chatter.
  for (const Eigen::Index window : {8, 12, 16, 24}) {
    ChatterOfCut longer = found;
    longer.chatter.clear();
    find_chatter(*teeth, change, options, window, longer);
    if (window == 8 || longer.share > found.share) found = std::move(longer);
    if (found.share >= kChatteringShare) break;
  }
  if (auto ok = find_ridge(*teeth, change, options, found); !ok) return ok.error();
  find_minima(options, found);
  return found;
}

}  // namespace servosense
