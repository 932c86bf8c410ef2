#include "reconcile/cut/lines.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <optional>

#include "reconcile/numerics/line_spectrum.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/golden_section.hpp"

namespace servosense::reconcile {
namespace {

constexpr std::size_t kMostCutLines = 4;
/// Neighbours at whole turns' distance looked at, and the power they may have beside a line's.
constexpr int kRow = 8;
/// Squares of the noise by which it must fit better to go with the feed: four standard errors.
constexpr double kSurelyByFeed = 16;

/// Normal equations of cosine and sine, the same for both forces, over the samples fitted; of an
/// amplitude that is the same all along, or goes with the feed.
struct WaveFit {
  double cc = 0, cs = 0, ss = 0;
  std::array<double, 2> c{}, q{};
  double n = 0, square = 0, first_s = 1e300, last_s = -1e300;

  WaveFit(const LineSearch& s, const Column& x_N, const Column& y_N, double hz, bool with_feed) {
    for (std::size_t i = 0; i < s.time_s.size(); ++i) {
      if (!s.fitted[i]) continue;
      first_s = std::min(first_s, s.time_s[i]);
      last_s = std::max(last_s, s.time_s[i]);
      const double p = kTwoPi * hz * s.time_s[i];
      const double size = with_feed ? s.feed_m[i] : 1;
      const double co = size * std::cos(p), si = size * std::sin(p);
      cc += co * co;
      cs += co * si;
      ss += si * si;
      c[0] += co * x_N[i];
      c[1] += co * y_N[i];
      q[0] += si * x_N[i];
      q[1] += si * y_N[i];
      square += x_N[i] * x_N[i] + y_N[i] * y_N[i];
      ++n;
    }
  }
  [[nodiscard]] double determinant() const { return cc * ss - cs * cs; }
  [[nodiscard]] double cosine(std::size_t axis) const {
    return (ss * c[axis] - cs * q[axis]) / determinant();
  }
  [[nodiscard]] double sine(std::size_t axis) const {
    return (cc * q[axis] - cs * c[axis]) / determinant();
  }
  /// Sum of squares.
  [[nodiscard]] double explained() const {
    if (!(determinant() > 0)) return 0;
    return cosine(0) * c[0] + sine(0) * q[0] + cosine(1) * c[1] + sine(1) * q[1];
  }
};

/// Line of a given frequency through marked samples, by least squares.
TimeLockedLine fitted_line(const LineSearch& s, const Column& x_N, const Column& y_N, double hz) {
  const WaveFit fit(s, x_N, y_N, hz, false);
  TimeLockedLine line;
  line.frequency_hz = hz;
  if (!(fit.determinant() > 0)) return line;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    line.cosine_N[axis] = fit.cosine(axis);
    line.sine_N[axis] = fit.sine(axis);
  }
  const double left = std::max(0.0, fit.square / 2 / fit.n - line.mean_square_N2());
  line.error_N = std::sqrt(2 * left / fit.n);
  // Rife and Boorstyn (1974), eq. 25, both forces together.
  line.frequency_error_hz =
      std::sqrt(6 * left / (fit.n * std::max(1e-300, 4 * line.mean_square_N2()))) /
      (kPi * (fit.last_s - fit.first_s));
  return line;
}

/// The surroundings know no feed. What is larger where more is cut is of the cut, though no
/// multiple of the rotation: harmonics of the teeth that fold back and meet a resonance.
bool goes_with_feed(const LineSearch& s, double hz) {
  const WaveFit alike(s, s.x_N, s.y_N, hz, false), by_feed(s, s.x_N, s.y_N, hz, true);
  const double noise_N2 = (by_feed.square - by_feed.explained()) / 2 / by_feed.n;
  return by_feed.explained() - alike.explained() > kSurelyByFeed * noise_N2;
}

/// Of both forces together, at steps finer than what the samples tell.
struct Spectrum {
  Eigen::VectorXd power;
  double step_hz = 0, length_s = 0;
};

std::optional<Spectrum> spectrum_of(const LineSearch& s, const Column& x_N, const Column& y_N) {
  // On a grid of samples; what does not count is zero.
  const std::size_t all = s.time_s.size();
  std::size_t first = 0, last = 0;
  bool any = false;
  for (std::size_t i = 0; i < all; ++i)
    if (s.fitted[i]) {
      if (!any) first = i;
      any = true;
      last = i;
    }
  if (!any || last - first < 512) return std::nullopt;
  const double from_s = s.time_s[first], to_s = s.time_s[last];
  const double rate_hz = static_cast<double>(last - first) / (to_s - from_s);
  if (!(rate_hz > 0) || !std::isfinite(rate_hz)) return std::nullopt;
  const Eigen::Index size = transform_size(static_cast<Eigen::Index>(last - first), 1024);
  Eigen::VectorXd power = Eigen::VectorXd::Zero(size / 2);
  for (const Column* force : {&x_N, &y_N}) {
    Eigen::VectorXd signal = Eigen::VectorXd::Zero(size);
    for (std::size_t i = first; i <= last; ++i)
      if (s.fitted[i]) {
        const auto k = static_cast<Eigen::Index>(std::lround((s.time_s[i] - from_s) * rate_hz));
        if (k >= 0 && k < size) signal(k) = (*force)[i];
      }
    power += power_of(signal);
  }
  return Spectrum{std::move(power), rate_hz / static_cast<double>(size), to_s - from_s};
}

double samples_fitted(const LineSearch& s) {
  return static_cast<double>(std::count(s.fitted.begin(), s.fitted.end(), true));
}

struct Peak {
  double hz = 0;
  double white_N2 = 0;  ///< mean square of the noise under it, of one force
};

/// The peak of the spectrum between lines that turn with the tool.
std::optional<Peak> strongest_of(const LineSearch& s, const Criteria& criteria) {
  const std::optional<Spectrum> spectrum = spectrum_of(s, s.x_N, s.y_N);
  if (!spectrum) return std::nullopt;
  const Eigen::VectorXd& power = spectrum->power;
  const double step_hz = spectrum->step_hz, apart_hz = criteria.line_distance / spectrum->length_s;
  const std::optional<Eigen::Index> peak = peak_of(
      power,
      [&](Eigen::Index k) {
        const double hz = step_hz * static_cast<double>(k);
        return hz * spectrum->length_s >= criteria.line_periods && hz <= s.most_hz &&
               std::abs(hz - s.turn_hz * std::round(hz / s.turn_hz)) >= apart_hz;
      },
      criteria);
  if (!peak) return std::nullopt;
  // Chatter is modulated by the teeth and harmonics that fold back come in rows: a line of the
  // surroundings stands alone.
  for (int order = -kRow; order <= kRow; ++order) {
    const double hz = std::abs(step_hz * static_cast<double>(*peak) + order * s.turn_hz);
    const auto k = static_cast<Eigen::Index>(std::lround(hz / step_hz));
    if (order == 0 || k < 2 || k + 2 >= power.size()) continue;
    if (power.segment(k - 2, 5).maxCoeff() > criteria.line_neighbours * power(*peak))
      return std::nullopt;
  }
  constexpr double kClose = 1e-5;  // of a step
  const double line_hz = lowest_between(
      [&](double hz) { return -fitted_line(s, s.x_N, s.y_N, hz).mean_square_N2(); },
      step_hz * static_cast<double>(*peak - 1), step_hz * static_cast<double>(*peak + 1),
      [&](double low, double high) { return high - low < kClose * step_hz; });
  // The median of the power of both forces over its mean: ln 2 where one is much noisier, 0.84
  // where they are alike.
  return Peak{line_hz, quantile_of(power, 0.5) / 0.8 / samples_fitted(s) / 2};
}

/// Mean square of one force over the samples fitted.
double mean_square(const LineSearch& s, const Column& x_N, const Column& y_N) {
  double square = 0, n = 0;
  for (std::size_t i = 0; i < s.time_s.size(); ++i) {
    if (!s.fitted[i]) continue;
    square += x_N[i] * x_N[i] + y_N[i] * y_N[i];
    n += 2;
  }
  return n > 0 ? square / n : 0;
}

/// Mean square that the line takes from the samples kept for the proof.
double held_mean_square(const LineSearch& s, const TimeLockedLine& line) {
  Column x = s.x_N, y = s.y_N;
  line.subtract_from(s.time_s, x, y);
  double less = 0, n = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (!s.held_out[i]) continue;
    less += s.x_N[i] * s.x_N[i] - x[i] * x[i] + s.y_N[i] * s.y_N[i] - y[i] * y[i];
    n += 2;
  }
  return n > 0 ? less / n : 0;
}

}  // namespace

double TimeLockedLine::amplitude_N(std::size_t axis) const {
  return std::hypot(cosine_N[axis], sine_N[axis]);
}

double TimeLockedLine::mean_square_N2() const {
  const double x = amplitude_N(0), y = amplitude_N(1);
  return (x * x + y * y) / 4;
}

void TimeLockedLine::subtract_from(const Column& time_s, Column& x_N, Column& y_N) const {
  for (std::size_t i = 0; i < time_s.size(); ++i) {
    const double p = kTwoPi * frequency_hz * time_s[i];
    const double co = std::cos(p), si = std::sin(p);
    x_N[i] -= cosine_N[0] * co + sine_N[0] * si;
    y_N[i] -= cosine_N[1] * co + sine_N[1] * si;
  }
}

std::vector<TimeLockedLine> find_lines(LineSearch search, const Criteria& criteria) {
  std::vector<TimeLockedLine> lines;
  while (lines.size() < kMostCutLines) {
    const std::optional<Peak> peak = strongest_of(search, criteria);
    if (!peak) break;
    TimeLockedLine line = fitted_line(search, search.x_N, search.y_N, peak->hz);
    // Harmonics of the teeth that fold back at the sample rate go with the finer means.
    const TimeLockedLine finer = fitted_line(search, search.finer_x_N, search.finer_y_N, peak->hz);
    line.held_mean_square_N2 = held_mean_square(search, line);
    if (!(std::sqrt(line.mean_square_N2()) > search.least_N) ||
        line.mean_square_N2() <
            criteria.least_explained *
                (mean_square(search, search.x_N, search.y_N) - peak->white_N2) ||
        finer.mean_square_N2() < criteria.line_of_finer * line.mean_square_N2() ||
        line.held_mean_square_N2 < criteria.line_held_share * line.mean_square_N2() ||
        goes_with_feed(search, peak->hz))
      break;
    line.subtract_from(search.time_s, search.x_N, search.y_N);
    line.subtract_from(search.time_s, search.finer_x_N, search.finer_y_N);
    lines.push_back(line);
  }
  return lines;
}

double unsteady_N(const LineSearch& s) {
  const std::optional<Spectrum> spectrum = spectrum_of(s, s.finer_x_N, s.finer_y_N);
  if (!spectrum) return 0;
  // Noise may reach up to a part of the samples' band only: not the median, but what three quarters
  // of the lines do not exceed, 1.35 to 1.39 of the mean (chi-squared of four or two).
  const double white_N2 = quantile_of(spectrum->power, 0.75) / 1.36 / samples_fitted(s) / 2;
  return std::sqrt(std::max(0.0, mean_square(s, s.finer_x_N, s.finer_y_N) - white_N2));
}

}  // namespace servosense::reconcile
