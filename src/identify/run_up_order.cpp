#include "run_up_order.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "dsp/dense.hpp"
#include "servosense/core/units.hpp"

namespace servosense::run_up {
namespace {

using ComplexColumns = Eigen::MatrixXcd;
using Column = Eigen::VectorXcd;

constexpr int kSmooth = 4;                 // terms of the smooth part
constexpr double kBandWidths = 8;          // damping ratios to each side
constexpr double kWidestBand = 0.5;        // of the frequency: the smooth part is a cubic there
constexpr std::size_t kLeastWindows = 12;  // in a band
constexpr double kGridDampings[] = {0.007, 0.02, 0.06};
constexpr double kMostDamping = 0.2;
constexpr double kLeastDamping = 1e-4;
constexpr std::size_t kMostStarts = 6;
constexpr std::size_t kMostModes = 3;  // in a band
constexpr int kMostFitSteps = 25;
constexpr double kShared = 1.0 / 6;  // correlation of neighbours: Hann windows that half overlap

/// Where turns reach `turn`, in samples.
double sample_at(const Sweep& s, double turn) {
  const auto at = std::lower_bound(s.turns.begin(), s.turns.end(), turn);
  const auto i = static_cast<std::size_t>(at - s.turns.begin());
  if (i == 0 || at == s.turns.end()) return static_cast<double>(i);
  return static_cast<double>(i) - (*at - turn) / (*at - s.turns[i - 1]);
}

/// Hann in turns, times the speed: a mean over the angle.
template <class Signal>
Complex amplitude(const Sweep& s, const Windows& w, const std::vector<Complex>& line,
                  const Signal& signal, std::size_t k) {
  const double middle = w.middle_turn[k];
  const double slope = w.rotation_slope[k];
  Complex sum = 0;
  double weights = 0;
  for (std::size_t i = w.begin[k]; i < w.end[k]; ++i) {
    const double along = (s.turns[i] - middle) / kWindowTurns;
    const double at_s = static_cast<double>(i) * s.period_s - w.middle_s[k];
    const double weight = (1 + std::cos(kTwoPi * along)) * (w.rotation_hz[k] + slope * at_s);
    sum += weight * signal(i) * std::conj(line[i]);
    weights += weight;
  }
  return sum / weights;
}

/// Least squares and what it leaves; columns of noise that is alike made even.
double misfit(const ComplexColumns& columns, const Column& y, Column* left = nullptr,
              Column* solved = nullptr) {
  const Column x = dense::least_squares(columns, y);
  const Column rest = y - columns * x;
  if (left) *left = rest;
  if (solved) *solved = x;
  return rest.squaredNorm();
}

/// A band of one order, its windows' noise made white and even.
class Band {
 public:
  Band(const Windows& w, const std::vector<Complex>& amplitude, int order, double hz,
       double half_hz)
      : windows_(&w), order_(order) {
    const auto frequency = [&](std::size_t k) { return order * w.rotation_hz[k]; };
    first = w.count(), last = 0;
    for (std::size_t k = 0; k < w.count(); ++k)
      if (std::abs(frequency(k) - hz) <= half_hz) first = std::min(first, k), last = k + 1;
    if (last < first + kLeastWindows) {
      last = first = 0;
      return;
    }
    smooth.resize(count(), kSmooth);
    Column y(count());
    for (std::size_t k = first; k < last; ++k) {
      const auto row = static_cast<Eigen::Index>(k - first);
      const double u = (frequency(k) - hz) / half_hz;
      y(row) = amplitude[k];
      Complex power = 1;
      for (int c = 0; c < kSmooth; ++c, power *= u) smooth(row, c) = power;
    }
    raw = y;
    raw_smooth = smooth;
    for (int c = 0; c < kSmooth; ++c) smooth.col(c) = white(smooth.col(c));
    measured = white(y);
  }
  [[nodiscard]] Eigen::Index count() const { return static_cast<Eigen::Index>(last - first); }
  [[nodiscard]] Column white(Column y) const {
    for (Eigen::Index i = 0; i < count(); ++i) {
      const std::size_t k = first + static_cast<std::size_t>(i);
      y(i) *= std::sqrt(static_cast<double>(windows_->end[k] - windows_->begin[k]));
    }
    double diagonal = 1;
    for (Eigen::Index i = 1; i < count(); ++i) {
      const double below = kShared / diagonal;
      diagonal = std::sqrt(1 - below * below);
      y(i) = (y(i) - below * y(i - 1)) / diagonal;
    }
    return y;
  }
  /// Steady response of a mode.
  [[nodiscard]] Column steady(const Shape& m) const {
    Column x(count());
    for (std::size_t k = first; k < last; ++k)
      x(static_cast<Eigen::Index>(k - first)) =
          1.0 /
          Complex(m.damping * m.w_rad_s, kTwoPi * order_ * windows_->rotation_hz[k] - m.w_rad_s);
    return white(x);
  }

  std::size_t first = 0, last = 0;
  ComplexColumns smooth, raw_smooth;
  Column measured, raw;

 private:
  const Windows* windows_;
  int order_;
};

/// The mode's response to a unit harmonic, integrated, at the samples of the band's windows.
class Driven {
 public:
  Driven(const Sweep& s, const Windows& w, const std::vector<Complex>& line, int order,
         const Band& band)
      : s_(&s), w_(&w), line_(&line), order_(order), band_(&band) {}

  [[nodiscard]] Column of_mode(const Shape& m) {
    const double decay = m.damping * m.w_rad_s;
    const Complex pole(-decay, m.w_rad_s * std::sqrt(1 - m.damping * m.damping));
    const std::size_t begin = w_->begin[band_->first], end = w_->end[band_->last - 1];
    const auto lead = static_cast<std::size_t>(std::min(8 / decay / s_->period_s, 1e9));
    const std::size_t from = begin > lead ? begin - lead : 0;
    x_.resize(end);
    const double T = s_->period_s;
    const Complex keep = std::exp(pole * T);
    const double start_w = kTwoPi * order_ * w_->rotation_hz[band_->first];
    x_[from] = (*line_)[from] / (Complex(0, start_w) - pole);
    for (std::size_t i = from; i + 1 < end; ++i) {  // the angle between samples is straight
      const double w = kTwoPi * order_ * (s_->turns[i + 1] - s_->turns[i]) / T;
      x_[i + 1] = keep * x_[i] + ((*line_)[i + 1] - keep * (*line_)[i]) / (Complex(0, w) - pole);
    }
    return means([&](std::size_t i) { return x_[i]; });
  }
  [[nodiscard]] Column of_line(double hz) const {
    return means([&](std::size_t i) {
      return std::polar(1.0, kTwoPi * hz * static_cast<double>(i) * s_->period_s);
    });
  }

 private:
  template <class Signal>
  [[nodiscard]] Column means(const Signal& signal) const {
    Column c(band_->count());
    for (std::size_t k = band_->first; k < band_->last; ++k)
      c(static_cast<Eigen::Index>(k - band_->first)) = amplitude(*s_, *w_, *line_, signal, k);
    return c;
  }
  const Sweep* s_;
  const Windows* w_;
  const std::vector<Complex>* line_;
  int order_;
  const Band* band_;
  std::vector<Complex> x_;
};

ComplexColumns columns_of(const Band& band, const std::vector<Column>& modes) {
  const auto n = static_cast<Eigen::Index>(modes.size());
  ComplexColumns all(band.count(), n + kSmooth);
  for (Eigen::Index c = 0; c < n; ++c) all.col(c) = modes[static_cast<std::size_t>(c)].normalized();
  all.rightCols(kSmooth) = band.smooth;
  return all;
}

/// Shapes with the smooth part, by variable projection.
struct Projected {
  std::vector<Shape> shapes;
  std::vector<Column> columns;  ///< white
  Column left;
  double rss = 0;
  Eigen::MatrixXd jacobian;  ///< of what is left by log w, log damping, mode by mode
};

void project(Projected& p, const Band& band) {
  p.rss = misfit(columns_of(band, p.columns), band.measured, &p.left);
}

bool allowed(const Shape& m, double hz, double half_hz) {
  return m.damping > kLeastDamping && m.damping < kMostDamping &&
         std::abs(m.w_rad_s / kTwoPi - hz) < half_hz;
}

void differentiate(Projected& p, const Band& band, Driven& driven) {
  const Eigen::Index n = band.count();
  p.jacobian.resize(2 * n, 2 * static_cast<Eigen::Index>(p.shapes.size()));
  for (std::size_t m = 0; m < p.shapes.size(); ++m)
    for (int which = 0; which < 2; ++which) {
      const double step = which == 0 ? 1e-3 * p.shapes[m].damping : 1e-3;
      Shape moved = p.shapes[m];
      (which == 0 ? moved.w_rad_s : moved.damping) *= std::exp(step);
      std::vector<Column> columns = p.columns;
      columns[m] = band.white(driven.of_mode(moved));
      Column left;
      misfit(columns_of(band, columns), band.measured, &left);
      const Column change = (left - p.left) / step;
      const auto at = 2 * static_cast<Eigen::Index>(m) + which;
      p.jacobian.col(at).head(n) = change.real();
      p.jacobian.col(at).tail(n) = change.imag();
    }
}

/// Gauss and Newton with Levenberg's damping. False: it does not settle.
bool settle(Projected& p, const Band& band, Driven& driven, double hz, double half_hz) {
  double damped = 1e-3;
  for (int step = 0; step < kMostFitSteps; ++step) {
    differentiate(p, band, driven);
    Eigen::VectorXd left(2 * band.count());
    left << p.left.real(), p.left.imag();
    const Eigen::MatrixXd normal = p.jacobian.transpose() * p.jacobian;
    const Eigen::VectorXd slope = p.jacobian.transpose() * left;
    for (;; damped *= 10) {
      if (damped > 1e6) return true;
      Eigen::MatrixXd raised = normal;
      raised.diagonal() *= 1 + damped;
      const Eigen::VectorXd change = -dense::solve_symmetric(raised, slope);
      if (!change.allFinite()) return false;
      Projected next = p;
      bool inside = true;
      for (std::size_t m = 0; m < p.shapes.size(); ++m) {
        const auto at = 2 * static_cast<Eigen::Index>(m);
        Shape& shape = next.shapes[m];
        shape.w_rad_s *= std::exp(std::clamp(change(at), -0.2, 0.2));
        shape.damping *= std::exp(std::clamp(change(at + 1), -1.0, 1.0));
        inside = inside && allowed(shape, hz, half_hz);
        if (inside) next.columns[m] = band.white(driven.of_mode(shape));
      }
      if (!inside) continue;
      project(next, band);
      if (next.rss > p.rss) continue;
      const bool done = p.rss - next.rss < 1e-8 * p.rss;
      p = std::move(next);
      damped = std::max(damped / 10, 1e-9);
      if (done) {
        differentiate(p, band, driven);
        return true;
      }
      break;
    }
  }
  return false;
}

/// The best line of fixed frequency in place of the first mode.
double best_line(const Projected& p, const Band& band, const Driven& driven, double hz,
                 double reach_hz, double step_hz) {
  std::vector<Column> columns = p.columns;
  double best = p.left.squaredNorm() * 1e12, best_hz = hz;
  const auto attempt = [&](double at_hz) {
    columns[0] = band.white(driven.of_line(at_hz));
    const double rss = misfit(columns_of(band, columns), band.measured);
    if (rss < best) best = rss, best_hz = at_hz;
  };
  step_hz = std::max(step_hz, reach_hz / 60);
  for (double off = -reach_hz; off <= reach_hz; off += step_hz) attempt(hz + off);
  for (int finer = 0; finer < 8; ++finer) {
    step_hz /= 2;
    const double about = best_hz;
    attempt(about - step_hz);
    attempt(about + step_hz);
  }
  return best;
}

Start best_start(const Windows& w, const std::vector<Complex>& amplitude, int order, double low_hz,
                 double high_hz, const std::vector<Start>& taken) {
  Start best;
  const auto [least, most] = std::minmax_element(w.rotation_hz.begin(), w.rotation_hz.end());
  for (const double damping : kGridDampings)
    for (double hz = low_hz; hz <= high_hz; hz *= 1 + damping) {
      if (hz * (1 - 1.5 * damping) < order * *least || hz * (1 + 1.5 * damping) > order * *most)
        continue;
      if (std::any_of(taken.begin(), taken.end(), [&](const Start& t) {
            return std::abs(t.hz - hz) < 3 * std::max(t.damping, damping) * hz;
          }))
        continue;
      const Band band(w, amplitude, order, hz, std::min(kBandWidths * damping, kWidestBand) * hz);
      if (band.count() == 0) continue;
      const double without = misfit(band.smooth, band.measured);
      const double with =
          misfit(columns_of(band, {band.steady({kTwoPi * hz, damping})}), band.measured);
      const double gain = 2 * static_cast<double>(band.count()) * std::log(without / with);
      if (gain > best.gain) best = {hz, damping, gain};
    }
  return best;
}

}  // namespace

Windows windows_of(const Sweep& s) {
  Windows w;
  const double half = kWindowTurns / 2;
  for (double turn = s.turns.front() + half; turn + half < s.turns.back(); turn += kHopTurns) {
    const double begin = sample_at(s, turn - half), middle = sample_at(s, turn),
                 end = sample_at(s, turn + half);
    const double before = half / ((middle - begin) * s.period_s);
    const double after = half / ((end - middle) * s.period_s);
    w.begin.push_back(static_cast<std::size_t>(std::ceil(begin)));
    w.end.push_back(static_cast<std::size_t>(std::ceil(end)));
    w.middle_turn.push_back(turn);
    w.middle_s.push_back(middle * s.period_s);
    w.rotation_hz.push_back((before + after) / 2);
    w.rotation_slope.push_back((after - before) / ((end - begin) * s.period_s / 2));
  }
  return w;
}

std::vector<Complex> harmonic(const Sweep& s, int order) {
  std::vector<Complex> line;
  line.reserve(s.turns.size());
  for (const double turn : s.turns)
    line.push_back(std::polar(1.0, kTwoPi * std::remainder(order * turn, 1.0)));
  return line;
}

std::vector<Complex> amplitudes(const Sweep& s, const Windows& w,
                                const std::vector<Complex>& line) {
  std::vector<Complex> out;
  for (std::size_t k = 0; k < w.count(); ++k)
    out.push_back(amplitude(
        s, w, line, [&](std::size_t i) { return s.value[i]; }, k));
  return out;
}

std::vector<Start> starts(const Windows& w, const std::vector<Complex>& amplitude, int order,
                          double from_hz, double to_hz) {
  std::vector<Start> out;
  while (out.size() < kMostStarts) {
    const Start s = best_start(w, amplitude, order, from_hz, to_hz, out);
    if (s.gain < 20) break;  // of four parameters by chance in 5 of 10 000
    out.push_back(s);
  }
  return out;
}

CrossingFit fit_crossing(const Sweep& s, const Windows& w, const std::vector<Complex>& line,
                         const std::vector<Complex>& amplitude, int order, const Start& start) {
  CrossingFit out;
  Shape seek{kTwoPi * start.hz, start.damping};
  Projected fit;
  double hz = 0, half_hz = 0;
  for (int round = 0; round < 2; ++round) {  // the second with the band that the first one tells
    hz = seek.w_rad_s / kTwoPi;
    std::size_t near = 0;
    for (std::size_t k = 0; k < w.count(); ++k)
      if (std::abs(order * w.rotation_hz[k] - hz) < std::abs(order * w.rotation_hz[near] - hz))
        near = k;
    const double rings_hz =
        8 * std::abs(order * w.rotation_slope[near]) / (seek.damping * seek.w_rad_s);
    half_hz = std::min(std::max(kBandWidths * seek.damping * hz, rings_hz), kWidestBand * hz);
    const Band band(w, amplitude, order, hz, half_hz);
    if (band.count() == 0) return out;
    Driven driven(s, w, line, order, band);
    fit = {};
    fit.shapes = {seek};
    fit.columns = {band.white(driven.of_mode(seek))};
    project(fit, band);
    if (!settle(fit, band, driven, hz, half_hz)) return out;
    const auto n = static_cast<double>(2 * band.count());
    out.enough = 4 * std::log(n);
    while (round == 1 && fit.shapes.size() < kMostModes) {  // others of the band
      double best = fit.rss;
      Shape further{};
      for (const double damping : kGridDampings)
        for (double at = hz - half_hz; at < hz + half_hz; at += damping * hz) {
          std::vector<Column> columns = fit.columns;
          columns.push_back(band.steady({kTwoPi * at, damping}));
          const double rss = misfit(columns_of(band, columns), band.measured);
          if (rss < best) best = rss, further = {kTwoPi * at, damping};
        }
      if (!(n * std::log(fit.rss / best) > out.enough)) break;
      Projected with = fit;
      with.shapes.push_back(further);
      with.columns.push_back(band.white(driven.of_mode(further)));
      project(with, band);
      if (!settle(with, band, driven, hz, half_hz) ||
          !(n * std::log(fit.rss / with.rss) > out.enough))
        break;
      fit = std::move(with);
    }
    seek = fit.shapes.front();
    if (round == 0) continue;

    const auto parameters = static_cast<double>(4 * fit.shapes.size() + std::size_t{2} * kSmooth);
    if (n < parameters + 4) return out;
    const std::vector<Column> others(fit.columns.begin() + 1, fit.columns.end());
    out.gain = n * std::log(misfit(columns_of(band, others), band.measured) / fit.rss);
    const double visible_s = std::abs(w.rotation_hz[near] / w.rotation_slope[near]);
    const double reach_hz = std::max(3 * seek.damping * hz, w.rotation_hz[near] / 2);
    out.over_line =
        n * std::log(best_line(fit, band, driven, hz, reach_hz, 0.3 / visible_s) / fit.rss);
    Complex together = 0;
    for (Eigen::Index i = 1; i < band.count(); ++i)
      together += fit.left(i) * std::conj(fit.left(i - 1));
    out.alike = together.real() / fit.rss;
    const double alike = std::clamp(out.alike, 0.0, 0.9);
    const double widen = std::sqrt(fit.rss / (n - parameters) * (1 + alike) / (1 - alike));
    const Eigen::MatrixXd inverse = dense::inverse(fit.jacobian.transpose() * fit.jacobian);
    out.natural_frequency_hz = {seek.w_rad_s / kTwoPi,
                                widen * std::sqrt(inverse(0, 0)) * seek.w_rad_s / kTwoPi};
    out.damping_ratio = {seek.damping, widen * std::sqrt(inverse(1, 1)) * seek.damping};

    Column solved;
    misfit(columns_of(band, fit.columns), band.measured, nullptr, &solved);
    const Column of_mode = driven.of_mode(seek) * (solved(0) / fit.columns[0].norm());
    const Column of_smooth = band.raw_smooth * solved.tail(kSmooth);
    Column all = of_mode + of_smooth;
    for (std::size_t m = 1; m < fit.shapes.size(); ++m)
      all += driven.of_mode(fit.shapes[m]) *
             (solved(static_cast<Eigen::Index>(m)) / fit.columns[m].norm());
    Eigen::Index highest = 0;
    out.peak = of_mode.cwiseAbs().maxCoeff(&highest);
    out.smooth = std::abs(of_smooth(highest));
    out.rest = std::sqrt((band.raw - all).squaredNorm() / static_cast<double>(band.count()));
    out.first = band.first, out.last = band.last;
    for (Eigen::Index i = 0; i < all.size(); ++i) out.fitted.push_back(std::abs(all(i)));
    out.modes = fit.shapes;
  }
  return out;
}

}  // namespace servosense::run_up
