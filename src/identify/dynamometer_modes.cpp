#include "servosense/identify/dynamometer_modes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <utility>

#include "dsp/dense.hpp"
#include "servosense/core/units.hpp"
#include "servosense/observer/dynamometer_filter.hpp"

namespace servosense {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kLeastLines = 20;
constexpr std::size_t kMostOfItself = 5;  // modes, unless more are asked for
constexpr double kWorthIt = 0.7;          // of the squares that a mode more may leave
constexpr double kLeastSize = 0.05;       // |H| from which a line counts by its inverse
constexpr double kLeastDamping = 1e-4, kMostDamping = 0.5;
constexpr int kSteps = 60;
constexpr double kDifference = 1e-6;  // of a logarithm, for derivatives

struct Lines {
  std::vector<double> hz;
  std::vector<Complex> value;
  double window_hz = 0;  // rate of the exponential window over 2 pi
};

/// 1 + 2 sum of the correlations of what is left from line to line, up to the first that chance
/// explains.
double alike(const VectorXd& left) {
  const double square = left.squaredNorm();
  const double chance = 2 / std::sqrt(static_cast<double>(left.size()));
  double sum = 1;
  for (Index lag = 2; square > 0 && lag < left.size() / 4; lag += 2) {
    const Index n = left.size() - lag;
    const double of_lag = left.head(n).dot(left.tail(n)) / square;
    if (!(of_lag > chance)) break;
    sum += 2 * of_lag;
  }
  return sum;
}

/// A pole: natural frequency and damping ratio as logarithms.
using Poles = VectorXd;

/// Shares and static gain that fit best beside the poles, and what they leave.
struct Linear {
  VectorXd amounts;  // static gain, then the share of each mode times it
  VectorXd left;     // real and imaginary part of each line in turn
  MatrixXd columns;
};

class ModesFit {
 public:
  explicit ModesFit(const Lines& lines) : lines_(lines) {
    for (const Complex& h : lines.value) weight_.push_back(1 / std::max(std::abs(h), kLeastSize));
  }

  [[nodiscard]] Linear linear(const Poles& p) const {
    const auto rows = static_cast<Index>(2 * lines_.hz.size());
    const Index modes = p.size() / 2;
    MatrixXd a(rows, modes + 1);
    VectorXd b(rows);
    for (std::size_t i = 0; i < lines_.hz.size(); ++i) {
      const auto row = static_cast<Index>(2 * i);
      const double w = weight_[i];
      a(row, 0) = w;
      a(row + 1, 0) = 0;
      b(row) = w * lines_.value[i].real();
      b(row + 1) = w * lines_.value[i].imag();
      for (Index k = 0; k < modes; ++k) {
        const Complex s = Complex(lines_.window_hz, lines_.hz[i]) / std::exp(p(2 * k));
        const Complex swings = 1.0 / (s * s + 2 * std::exp(p(2 * k + 1)) * s + 1.0) - 1.0;
        a(row, k + 1) = w * swings.real();
        a(row + 1, k + 1) = w * swings.imag();
      }
    }
    Linear out;
    out.amounts = dense::least_squares(a, b);
    out.left = b - a * out.amounts;
    out.columns = std::move(a);
    return out;
  }

  /// Of the poles, then of the amounts.
  [[nodiscard]] MatrixXd covariance(const Poles& p) const {
    const Linear at = linear(p);
    const Index rows = at.left.size(), poles = p.size(), count = poles + at.amounts.size();
    MatrixXd j(rows, count);
    for (Index i = 0; i < poles; ++i) {
      Poles beside = p;
      beside(i) += kDifference;
      j.col(i) = (linear(beside).columns - at.columns) * at.amounts / kDifference;
    }
    j.rightCols(at.amounts.size()) = at.columns;
    const double level =
        at.left.squaredNorm() / std::max<double>(1, static_cast<double>(rows - count));
    return level * alike(at.left) * dense::pseudo_inverse(j.transpose() * j);
  }

  /// Levenberg and Marquardt over the poles; returns what is left of the squares.
  double refine(Poles& p) const {
    double damping = 1e-2;
    VectorXd left = linear(p).left;
    double squares = left.squaredNorm();
    for (int step = 0; step < kSteps && damping < 1e8; ++step) {
      MatrixXd j(left.size(), p.size());
      for (Index i = 0; i < p.size(); ++i) {
        Poles beside = p;
        beside(i) += kDifference;
        j.col(i) = (linear(beside).left - left) / kDifference;
      }
      const MatrixXd normal = j.transpose() * j;
      bool better = false;
      while (!better && damping < 1e8) {
        MatrixXd damped = normal;
        damped.diagonal() *= 1 + damping;
        const VectorXd change =
            dense::least_squares(damped, Eigen::VectorXd(-j.transpose() * left));
        Poles next = p + change.cwiseMax(-0.3).cwiseMin(0.3);
        for (Index i = 1; i < next.size(); i += 2)
          next(i) = std::clamp(next(i), std::log(kLeastDamping), std::log(kMostDamping));
        const VectorXd left_next = linear(next).left;
        better = left_next.squaredNorm() < squares;
        if (!better) {
          damping *= 4;
          continue;
        }
        const bool done = left_next.squaredNorm() > (1 - 1e-10) * squares;
        p = next;
        left = left_next;
        squares = left.squaredNorm();
        damping = std::max(damping / 5, 1e-9);
        if (done) return squares;
      }
    }
    return squares;
  }

  /// One pole more, from a grid.
  [[nodiscard]] Poles with_another(const Poles& p) const {
    Poles best, tried(p.size() + 2);
    tried.head(p.size()) = p;
    double least = std::numeric_limits<double>::infinity();
    const double low = std::log(std::max(lines_.hz.front(), lines_.hz.back() / 1000));
    const double high = std::log(lines_.hz.back());
    constexpr int kFrequencies = 120;
    for (int i = 0; i <= kFrequencies; ++i)
      for (const double damping : {0.01, 0.03, 0.1}) {
        tried(p.size()) = low + (high - low) * i / kFrequencies;
        tried(p.size() + 1) = std::log(damping);
        const double squares = linear(tried).left.squaredNorm();
        if (squares < least) {
          least = squares;
          best = tried;
        }
      }
    return best;
  }

 private:
  const Lines& lines_;
  std::vector<double> weight_;
};

bool plausible(const Poles& p, const Lines& lines) {
  for (Index i = 0; i < p.size(); i += 2)
    if (std::exp(p(i)) < lines.hz.front() || std::exp(p(i)) > 1.2 * lines.hz.back() ||
        p(i + 1) <= std::log(kLeastDamping) || p(i + 1) >= std::log(kMostDamping))
      return false;
  return true;
}

}  // namespace

Expected<DynamometerFit> fit_dynamometer_modes(std::span<const double> frequency_hz,
                                               std::span<const Complex> response,
                                               const DynamometerFitOptions& options) {
  Lines lines;
  lines.window_hz = options.exponential_window_per_s / kTwoPi;
  for (std::size_t i = 0; i < std::min(frequency_hz.size(), response.size()); ++i)
    if (frequency_hz[i] > 0 && frequency_hz[i] >= options.from_hz &&
        frequency_hz[i] <= options.to_hz && std::isfinite(response[i].real()) &&
        std::isfinite(response[i].imag())) {
      lines.hz.push_back(frequency_hz[i]);
      lines.value.push_back(response[i]);
    }
  if (lines.hz.size() < kLeastLines)
    return data_error("fewer than " + std::to_string(kLeastLines) +
                      " lines of the response can be used; give a longer record or a wider band");
  if (options.modes > kMostDynamometerModes)
    return usage_error("a dynamometer has " + std::to_string(kMostDynamometerModes) +
                       " modes at most");
  const ModesFit fit(lines);
  Poles poles(0);
  double squares = fit.linear(poles).left.squaredNorm();
  const double tiny = 1e-20 * static_cast<double>(lines.hz.size());
  const std::size_t most = options.modes > 0 ? options.modes : kMostOfItself;
  for (std::size_t k = 0; k < most && squares > tiny; ++k) {
    Poles more = fit.with_another(poles);
    const double left = fit.refine(more);
    const bool wanted = options.modes > 0 || (left < kWorthIt * squares && plausible(more, lines));
    if (!wanted) break;
    poles = more;
    squares = left;
  }
  if (poles.size() == 0)
    return data_error(
        "the response shows no mode; give one that reaches above the natural "
        "frequency of the dynamometer");
  const Linear found = fit.linear(poles);
  DynamometerFit out;
  out.static_gain = found.amounts(0);
  out.misfit = std::sqrt(squares / static_cast<double>(lines.hz.size()));
  out.from_hz = lines.hz.front();
  out.to_hz = lines.hz.back();
  const MatrixXd covariance = fit.covariance(poles);
  std::vector<Index> order(static_cast<std::size_t>(poles.size() / 2));
  std::iota(order.begin(), order.end(), Index{0});
  std::ranges::sort(order, {}, [&](Index k) { return poles(2 * k); });
  for (const Index k : order) {
    const DynamometerMode mode{std::exp(poles(2 * k)), std::exp(poles(2 * k + 1)),
                               found.amounts(k + 1) / out.static_gain};
    // A share is an amount over the static gain.
    VectorXd of_share = VectorXd::Zero(covariance.rows());
    of_share(poles.size()) = -mode.share / out.static_gain;
    of_share(poles.size() + 1 + k) = 1 / out.static_gain;
    out.modes.push_back(mode);
    out.standard_errors.push_back({mode.natural_frequency_hz * std::sqrt(covariance(2 * k, 2 * k)),
                                   mode.damping_ratio * std::sqrt(covariance(2 * k + 1, 2 * k + 1)),
                                   std::sqrt(of_share.dot(covariance * of_share))});
  }
  return out;
}

}  // namespace servosense
