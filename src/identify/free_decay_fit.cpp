#include "free_decay_fit.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>

#include "dsp/dense.hpp"
#include "dsp/fourier.hpp"
#include "servosense/core/units.hpp"

namespace servosense::free_decay {
namespace {

using Complex = std::complex<double>;
using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr std::size_t kMostDecays = 6;
constexpr int kMostForced = 60;        // multiples of the rotation that are looked for
constexpr double kForcedPower = 25;    // chi square of two degrees: by chance in 4 of a million
constexpr double kHighest = 0.45;      // of the sample rate
constexpr double kLeastPeriods = 2;    // of a decay within the stretch
constexpr std::ptrdiff_t kBlock = 8;   // samples whose misfit is judged together
constexpr double kBlockMisfit = 5;     // chi square of a block over 8: by chance in 2 of 100 000
constexpr double kModelMisfit = 0.03;  // of the signal: no machine is quite linear
constexpr int kMostSteps = 15;
constexpr double kSettled = 1e-7;  // relative fall of the misfit

/// Nonlinear parameters of a decay.
struct Shape {
  double decay_per_s, omega_rad_s;
};

Vector samples(const Stretch& s, std::size_t from) {
  return Eigen::Map<const Vector>(s.value.data() + from,
                                  static_cast<Eigen::Index>(s.value.size() - from));
}

/// Constant and forced lines, a cosine and a sine each.
Matrix forced_columns(const Stretch& s, std::size_t from, const std::vector<int>& forced) {
  const auto n = static_cast<Eigen::Index>(s.value.size() - from);
  Matrix columns(n, 1 + 2 * static_cast<Eigen::Index>(forced.size()));
  columns.col(0).setOnes();
  for (std::size_t k = 0; k < forced.size(); ++k)
    for (Eigen::Index i = 0; i < n; ++i) {
      const double phase = kTwoPi * forced[k] * s.turns[from + static_cast<std::size_t>(i)];
      columns(i, 1 + 2 * static_cast<Eigen::Index>(k)) = std::cos(phase);
      columns(i, 2 + 2 * static_cast<Eigen::Index>(k)) = std::sin(phase);
    }
  return columns;
}

/// exp((-decay + j omega) t) at every sample.
std::vector<Complex> oscillation(const Shape& d, Eigen::Index n, double period_s) {
  const Complex turn = std::exp(Complex(-d.decay_per_s, d.omega_rad_s) * period_s);
  std::vector<Complex> z(static_cast<std::size_t>(n));
  Complex now = 1;
  for (Complex& value : z) value = now, now *= turn;
  return z;
}

/// Least squares by normal equations, columns scaled to unit length.
struct Solved {
  Vector coefficients;
  Matrix inverse;  ///< of the normal matrix
};
Solved least_squares(const Matrix& columns, const Vector& y, bool with_inverse = false) {
  Vector scale = columns.colwise().norm().transpose();
  for (double& x : scale) x = x > 0 ? 1 / x : 0;
  Matrix normal = scale.asDiagonal() * (columns.transpose() * columns) * scale.asDiagonal();
  normal.diagonal().array() += 1e-12;
  Solved out;
  out.coefficients =
      scale.asDiagonal() *
      dense::solve_symmetric(normal, Vector(scale.asDiagonal() * (columns.transpose() * y)));
  if (with_inverse)
    out.inverse = scale.asDiagonal() * dense::inverse_symmetric(normal) * scale.asDiagonal();
  return out;
}

/// Decays of given shapes with the best amplitudes.
class DecaysOfShapes {
 public:
  DecaysOfShapes(const Matrix& forced, const Vector& y, double period_s)
      : forced_(&forced), y_(&y), period_s_(period_s) {}

  void set(const std::vector<Shape>& shapes) {
    shapes_ = shapes;
    const Eigen::Index n = y_->size(), m = forced_->cols();
    columns_.resize(n, m + 2 * static_cast<Eigen::Index>(shapes.size()));
    columns_.leftCols(m) = *forced_;
    for (std::size_t r = 0; r < shapes.size(); ++r) {
      const auto z = oscillation(shapes[r], n, period_s_);
      const Eigen::Index at = m + 2 * static_cast<Eigen::Index>(r);
      for (Eigen::Index i = 0; i < n; ++i) {
        columns_(i, at) = z[static_cast<std::size_t>(i)].real();
        columns_(i, at + 1) = z[static_cast<std::size_t>(i)].imag();
      }
    }
    amplitudes_ = least_squares(columns_, *y_).coefficients;
    left_ = *y_ - columns_ * amplitudes_;
    misfit_ = left_.squaredNorm();
  }

  /// Columns of all parameters: decay and omega of each shape, then those of the amplitudes.
  [[nodiscard]] Matrix jacobian() const {
    const Eigen::Index n = y_->size(), m = forced_->cols();
    const auto shapes = static_cast<Eigen::Index>(shapes_.size());
    Matrix j(n, 2 * shapes + columns_.cols());
    j.rightCols(columns_.cols()) = columns_;
    const Vector t = Vector::LinSpaced(n, 0, static_cast<double>(n - 1) * period_s_);
    for (Eigen::Index r = 0; r < shapes; ++r) {
      const Eigen::Index at = m + 2 * r;
      const double p = amplitudes_[at], q = amplitudes_[at + 1];
      const auto c = columns_.col(at).array(), s = columns_.col(at + 1).array();
      j.col(2 * r) = -t.array() * (p * c + q * s);
      j.col(2 * r + 1) = t.array() * (q * c - p * s);
    }
    return j;
  }

  /// Gauss and Newton, steps halved until they help.
  void refine() {
    for (int step = 0; step < kMostSteps && !shapes_.empty(); ++step) {
      const Vector change = least_squares(jacobian(), left_).coefficients;
      const std::vector<Shape> before = shapes_;
      const double misfit = misfit_;
      double share = 1;
      for (;; share /= 2) {
        std::vector<Shape> next = before;
        for (std::size_t r = 0; r < next.size(); ++r) {
          const auto at = 2 * static_cast<Eigen::Index>(r);
          next[r].decay_per_s += share * change[at];
          next[r].omega_rad_s += share * change[at + 1];
        }
        if (allowed(next)) {
          set(next);
          if (misfit_ <= misfit) break;
        }
        if (share < 1e-2) {
          set(before);
          return;
        }
      }
      if (misfit - misfit_ < kSettled * misfit) return;
    }
  }

  [[nodiscard]] const std::vector<Shape>& shapes() const { return shapes_; }
  [[nodiscard]] const Vector& left() const { return left_; }
  [[nodiscard]] double misfit() const { return misfit_; }

 private:
  /// Within what the samples can show; growth only as much as noise gives a forced line.
  [[nodiscard]] bool allowed(const std::vector<Shape>& shapes) const {
    const double length_s = static_cast<double>(y_->size()) * period_s_;
    return std::all_of(shapes.begin(), shapes.end(), [&](const Shape& d) {
      return d.decay_per_s > -2 / length_s && d.decay_per_s < 1 / period_s_ &&
             d.omega_rad_s > kTwoPi / length_s && d.omega_rad_s < kPi / period_s_;
    });
  }

  const Matrix* forced_;
  const Vector* y_;
  double period_s_;
  std::vector<Shape> shapes_;
  Matrix columns_;
  Vector amplitudes_, left_;
  double misfit_ = 0;
};

/// The decay of the dictionary that takes most off `left`.
Shape strongest(const Vector& left, double period_s, double from_hz, double to_hz) {
  std::size_t size = 16;
  while (size < 2 * static_cast<std::size_t>(left.size())) size *= 2;
  const double length_s = static_cast<double>(left.size()) * period_s;
  const double line_hz = 1 / (static_cast<double>(size) * period_s);
  FourierTransform transform;
  std::vector<double> weighed(size);
  std::vector<Complex> spectrum;
  Shape best{0, 0};
  double most = -1;
  for (double decay = 0; decay<0.5 / period_s; decay = decay> 0 ? 2.5 * decay : 2 / length_s) {
    const double keep = std::exp(-decay * period_s);
    double weight = 1, sum = 0;
    for (Eigen::Index i = 0; i < left.size(); ++i, weight *= keep) {
      weighed[static_cast<std::size_t>(i)] = weight * left[i];
      sum += weight * weight;
    }
    transform.forward(weighed, spectrum);
    const double least_hz = std::max({from_hz, kLeastPeriods / length_s, decay / kTwoPi});
    for (std::size_t k = 1; k < size / 2; ++k) {
      const double hz = line_hz * static_cast<double>(k);
      if (hz < least_hz || hz > to_hz) continue;
      if (const double power = std::norm(spectrum[k]) / sum; power > most)
        most = power, best = {decay, kTwoPi * hz};
    }
  }
  return best;
}

/// Noise about a frequency over the mean noise, in power; 1 at least.
double local_noise(const Vector& left, double period_s, double hz, double width_hz) {
  const auto n = static_cast<double>(left.size());
  const double line_hz = 1 / (n * period_s);
  const int each_side = std::clamp(static_cast<int>(std::ceil(width_hz / line_hz)), 20, 200);
  double sum = 0, lines = 0;
  for (int k = -each_side; k <= each_side; ++k) {
    const double at_hz = hz + line_hz * k;
    if (at_hz < line_hz || at_hz > 0.5 / period_s - line_hz) continue;
    const auto z = oscillation({0, kTwoPi * at_hz}, left.size(), period_s);
    Complex x = 0;
    for (Eigen::Index i = 0; i < left.size(); ++i) x += left[i] * z[static_cast<std::size_t>(i)];
    sum += std::norm(x);
    ++lines;
  }
  return std::max(1.0, sum / lines / left.squaredNorm());
}

Pole pole_of(const Shape& d, double var_a, double var_v, double cov, double widen) {
  const double a = d.decay_per_s, v = d.omega_rad_s, w = std::hypot(a, v);
  Pole p;
  p.decay_per_s = {a, widen * std::sqrt(var_a)};
  p.frequency_hz = {v / kTwoPi, widen * std::sqrt(var_v) / kTwoPi};
  const double w_a = a / w, w_v = v / w;
  p.natural_frequency_hz = {
      w / kTwoPi,
      widen *
          std::sqrt(std::max(0.0, w_a * w_a * var_a + w_v * w_v * var_v + 2 * w_a * w_v * cov)) /
          kTwoPi};
  const double z_a = v * v / (w * w * w), z_v = -a * v / (w * w * w);
  p.damping_ratio = {a / w, widen * std::sqrt(std::max(0.0, z_a * z_a * var_a + z_v * z_v * var_v +
                                                                2 * z_a * z_v * cov))};
  return p;
}

}  // namespace

std::vector<int> forced_lines(const Stretch& s) {
  std::vector<int> tried, found;
  if (s.turns.empty()) return found;
  const double turns = std::abs(s.turns.back() - s.turns[s.quiet]);
  const auto n = static_cast<double>(s.value.size() - s.quiet);
  if (turns < 3) return found;  // lines less than three of them apart are not told apart
  const double highest = kHighest * n / turns;
  for (int k = 1; k <= kMostForced && k < highest; ++k) tried.push_back(k);
  const Matrix columns = forced_columns(s, s.quiet, tried);
  if (columns.rows() < 2 * columns.cols()) return found;
  const Vector y = samples(s, s.quiet);
  const Vector lines = least_squares(columns, y).coefficients;
  const double noise2 =
      (y - columns * lines).squaredNorm() / (n - static_cast<double>(lines.size()));
  for (std::size_t k = 0; k < tried.size(); ++k) {
    const auto at = 1 + 2 * static_cast<Eigen::Index>(k);
    if (lines.segment(at, 2).squaredNorm() * n / 2 > kForcedPower * noise2)
      found.push_back(tried[k]);
  }
  return found;
}

DecayFit fit_decays(const Stretch& s, std::size_t from, const std::vector<int>& forced,
                    double from_hz, double to_hz) {
  const Vector y = samples(s, from);
  const Matrix columns = forced_columns(s, from, forced);
  const auto n = static_cast<double>(y.size());
  const double enough = 4 * std::log(n);
  to_hz = std::min(to_hz, kHighest / s.period_s);
  DecaysOfShapes fit(columns, y, s.period_s);
  fit.set({});
  for (std::size_t more = 0; more < kMostDecays; ++more) {
    DecaysOfShapes with = fit;
    std::vector<Shape> shapes = fit.shapes();
    shapes.push_back(strongest(fit.left(), s.period_s, from_hz, to_hz));
    with.set(shapes);
    with.refine();
    if (!(n * std::log(fit.misfit() / with.misfit()) > enough)) break;
    fit = with;
  }

  DecayFit out;
  const Vector fitted = y - fit.left();
  out.fitted.assign(fitted.begin(), fitted.end());
  const auto half = static_cast<Eigen::Index>((s.quiet + s.value.size()) / 2 - from);
  const double noise2 =
      fit.left().tail(y.size() - half).squaredNorm() / (n - static_cast<double>(half));
  out.noise = std::sqrt(noise2);
  out.holds = true;
  for (Eigen::Index i = 0; i + kBlock <= half; i += kBlock) {
    const double left2 = fit.left().segment(i, kBlock).squaredNorm() / kBlock;
    const double signal2 = y.segment(i, kBlock).squaredNorm() / kBlock;
    out.holds = out.holds && left2 < kBlockMisfit * noise2 + kModelMisfit * kModelMisfit * signal2;
  }
  if (fit.shapes().empty()) return out;
  const Matrix jacobian = fit.jacobian();
  const double mean2 = fit.misfit() / (n - static_cast<double>(jacobian.cols()));
  const Matrix covariance = mean2 * least_squares(jacobian, y, true).inverse;
  for (std::size_t r = 0; r < fit.shapes().size(); ++r) {
    const Shape& d = fit.shapes()[r];
    const auto at = 2 * static_cast<Eigen::Index>(r);
    const double widen = std::sqrt(
        local_noise(fit.left(), s.period_s, d.omega_rad_s / kTwoPi, std::abs(d.decay_per_s) / kPi));
    out.poles.push_back(
        pole_of(d, covariance(at, at), covariance(at + 1, at + 1), covariance(at, at + 1), widen));
  }
  return out;
}

}  // namespace servosense::free_decay
