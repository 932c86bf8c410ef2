#include "servosense/observer/dynamometer_design.hpp"

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

#include "dsp/dense.hpp"

namespace servosense {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::RowVectorXd;
using Eigen::VectorXd;

constexpr double kMeanGain = 0.70710678118654752;
constexpr double kWidestRange = 0.05;  // of speed, in which gains of one speed are used
constexpr int kRangeSteps = 10;

std::span<const DynamometerMode> modes_of(const DynamometerFilterConfig& c) {
  return {c.mode.data(), c.modes};
}

/// Where the states of harmonic n begin.
Index state_of(std::size_t modes, std::size_t n) {
  return static_cast<Index>(2 * modes + (n == 0 ? 0 : 2 * n - 1));
}

struct Model {
  MatrixXd transition, noise;
  RowVectorXd output, force;
};

Model model_of(const DynamometerFilterConfig& c, double speed) {
  const auto modes = static_cast<Index>(2 * c.modes);
  const auto forces = static_cast<Index>(2 * c.harmonics + 1);
  const Index size = modes + forces;
  MatrixXd a = MatrixXd::Zero(size, size);
  MatrixXd steady = MatrixXd::Zero(modes, forces);  // of the modes, for each state of the force
  Model m;
  m.output = m.force = RowVectorXd::Zero(size);
  for (std::size_t k = 0; k < c.modes; ++k) {
    const double w = kTwoPi * c.mode[k].natural_frequency_hz;
    const double decay = c.mode[k].damping_ratio * w;
    const double damped = w * std::sqrt(1 - c.mode[k].damping_ratio * c.mode[k].damping_ratio);
    const auto i = static_cast<Index>(2 * k);
    a.block<2, 2>(i, i) << -decay, damped, -damped, -decay;
    m.output(i) = 1;
    const double input = c.mode[k].share * w * w / damped;
    for (std::size_t n = 0; n <= c.harmonics; ++n) {
      const Complex s(decay, static_cast<double>(n) * speed);
      const Complex over = input / (s * s + damped * damped);
      const std::array<Complex, 2> x{damped * over, s * over};
      const Index j = state_of(0, n);
      for (Index row = 0; row < 2; ++row) {
        steady(i + row, j) = x[static_cast<std::size_t>(row)].real();
        if (n > 0) steady(i + row, j + 1) = x[static_cast<std::size_t>(row)].imag();
      }
    }
  }
  m.output(modes) = m.force(modes) = 1;
  for (std::size_t n = 1; n <= c.harmonics; ++n) {
    const Index i = state_of(c.modes, n);
    const double w = static_cast<double>(n) * speed;
    a(i, i + 1) = w;
    a(i + 1, i) = -w;
    const Complex h = dynamometer_response(modes_of(c), w);
    m.output(i) = h.real();
    m.output(i + 1) = h.imag();
    m.force(i) = 1;
  }
  // Noise on the force makes each mode ring by what its steady state has changed.
  MatrixXd enters(size, forces);
  enters << -steady, MatrixXd::Identity(forces, forces);
  const double follows = speed / (kTwoPi * c.averaged_turns);
  const double density = 2 * follows * follows * c.sample_period_s;
  // Van Loan 1978: transition and noise of a sample in one exponential.
  MatrixXd both = MatrixXd::Zero(2 * size, 2 * size);
  both << -a, density * enters * enters.transpose(), MatrixXd::Zero(size, size), a.transpose();
  const MatrixXd exponential = (both * c.sample_period_s).exp();
  m.transition = exponential.bottomRightCorner(size, size).transpose();
  const MatrixXd noise = m.transition * exponential.topRightCorner(size, size);
  m.noise = (noise + noise.transpose()) / 2;
  return m;
}

VectorXd gain_of(const MatrixXd& covariance, const RowVectorXd& output) {
  const VectorXd pc = covariance * output.transpose();
  return pc / (1 + output * pc);
}

/// Structured doubling (Chu, Fan and Lin 2005): each step doubles the samples that the covariance
/// has seen.
MatrixXd riccati(const Model& m) {
  const Index size = m.output.size();
  const MatrixXd one = MatrixXd::Identity(size, size);
  MatrixXd a = m.transition.transpose();
  MatrixXd g = m.output.transpose() * m.output;
  MatrixXd p = m.noise;
  constexpr int kMostDoublings = 60;
  for (int i = 0; i < kMostDoublings; ++i) {
    MatrixXd both(size, 2 * size);
    both << a, g;
    const MatrixXd over = dense::solve(one + g * p, both);
    const MatrixXd over_a = over.leftCols(size), over_g = over.rightCols(size);
    const MatrixXd more = a.transpose() * p * over_a;
    g += a * over_g * a.transpose();
    g = ((g + g.transpose()) / 2).eval();
    p += more;
    p = ((p + p.transpose()) / 2).eval();
    a = (a * over_a).eval();
    if (!(more.norm() > 1e-15 * p.norm())) break;
  }
  return p;
}

double residual_of(const Model& m, const MatrixXd& p) {
  const VectorXd pc = p * m.output.transpose();
  const double s = 1 + m.output * pc;
  const MatrixXd after = p - pc * pc.transpose() / s;
  return (m.transition * after * m.transition.transpose() + m.noise - p).norm() / p.norm();
}

double radius_of(const Model& m, const VectorXd& gain) {
  const Index size = m.output.size();
  const MatrixXd closed = m.transition * (MatrixXd::Identity(size, size) - gain * m.output);
  return dense::eigenvalues(closed.cast<std::complex<double>>()).cwiseAbs().maxCoeff();
}

/// Conj(H) / |H| and what the block's gains are multiples of.
struct BlockUnits {
  std::vector<Complex> direction;
  double step = 0;
};
BlockUnits units_of(const DynamometerFilterConfig& c, double speed) {
  BlockUnits u;
  const double step = speed * c.sample_period_s * 2 / (kTwoPi * c.averaged_turns);
  double sum = 0;
  for (std::size_t n = 0; n <= c.harmonics; ++n) {
    const Complex h = dynamometer_response(modes_of(c), static_cast<double>(n) * speed);
    const double own = n == 0 ? kMeanGain : 1;
    u.direction.push_back(own * std::conj(h) / std::abs(h));
    sum += own * std::abs(h);
  }
  u.step = step / (1 + step * sum);
  return u;
}

VectorXd from_block(const DynamometerFilterConfig& c, const DynamometerGain& gain, double speed) {
  const BlockUnits u = units_of(c, speed);
  VectorXd k = VectorXd::Zero(static_cast<Index>(2 * c.modes + 2 * c.harmonics + 1));
  for (std::size_t i = 0; i < c.modes; ++i) {
    k(static_cast<Index>(2 * i)) = gain.ringing[i].re * u.step;
    k(static_cast<Index>(2 * i + 1)) = -gain.ringing[i].im * u.step;
  }
  for (std::size_t n = 0; n <= c.harmonics; ++n) {
    const Complex g = Complex(gain.harmonic[n].re, gain.harmonic[n].im) * u.direction[n] * u.step;
    const Index at = state_of(c.modes, n);
    k(at) = g.real();
    if (n > 0) k(at + 1) = -g.imag();
  }
  return k;
}

DynamometerGain to_block(const DynamometerFilterConfig& c, const VectorXd& k, double speed) {
  const BlockUnits u = units_of(c, speed);
  DynamometerGain gain;
  for (std::size_t i = 0; i < c.modes; ++i) {
    const auto at = static_cast<Index>(2 * i);
    gain.ringing[i] = {k(at) / u.step, -k(at + 1) / u.step};
  }
  for (std::size_t n = 0; n <= c.harmonics; ++n) {
    const Index at = state_of(c.modes, n);
    const Complex g = Complex(k(at), n > 0 ? -k(at + 1) : 0) / (u.direction[n] * u.step);
    gain.harmonic[n] = {g.real(), g.imag()};
  }
  return gain;
}

std::string with_digits(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.4g", value);
  return text.data();
}

}  // namespace

Complex dynamometer_response(std::span<const DynamometerMode> modes, double frequency_rad_s) {
  Complex h = 1;
  for (const DynamometerMode& m : modes) {
    const double r = frequency_rad_s / (kTwoPi * m.natural_frequency_hz);
    h += m.share * (1.0 / Complex(1 - r * r, 2 * m.damping_ratio * r) - 1.0);
  }
  return h;
}

Expected<DynamometerDesign> design_dynamometer_filter(const DynamometerFilterConfig& c,
                                                      double speed_rad_s) {
  using Block = DynamometerFilter<double>;
  if (const Status s = Block::validate(c); !s.ok())
    return usage_error("dynamometer filter: " + std::string(s.parameter()) + " " + s.reason());
  if (!(speed_rad_s > 0) || !std::isfinite(speed_rad_s))
    return usage_error("dynamometer filter: the spindle speed must be positive");
  const double highest = static_cast<double>(c.harmonics) * speed_rad_s;
  if (highest * c.sample_period_s >= Block::kHighestShare * kTwoPi / 2)
    return usage_error("dynamometer filter: harmonic " + std::to_string(c.harmonics) + " is at " +
                       with_digits(highest / kTwoPi) +
                       " Hz, above 0.8 of half the sample rate; take fewer harmonics or sample "
                       "faster");
  for (std::size_t n = 1; n <= c.harmonics; ++n) {
    const double w = static_cast<double>(n) * speed_rad_s;
    if (std::abs(dynamometer_response(modes_of(c), w)) < Block::kLeastResponse)
      return usage_error("dynamometer filter: at " + with_digits(speed_rad_s * 60 / kTwoPi) +
                         " rpm harmonic " + std::to_string(n) + ", " + with_digits(w / kTwoPi) +
                         " Hz, is at a zero of the dynamometer's response, which does not report "
                         "it; take fewer harmonics or another speed");
  }
  const Model m = model_of(c, speed_rad_s);
  DynamometerDesign d{m.transition, m.noise, m.output, m.force, riccati(m), {}, 0, 0, 0, {}};
  d.gain = gain_of(d.covariance, m.output);
  d.residual = residual_of(m, d.covariance);
  d.spectral_radius = radius_of(m, d.gain);
  const VectorXd pc = d.covariance * m.output.transpose();
  const double seen = m.force * d.gain;
  d.error_std =
      std::sqrt(m.force * d.covariance * m.force.transpose() - seen * seen * (1 + m.output * pc));
  d.block = to_block(c, d.gain, speed_rad_s);
  // Of other speeds only those at which the gains are stable.
  const auto stable = [&](double speed) {
    return radius_of(model_of(c, speed), from_block(c, d.block, speed)) < 1;
  };
  d.block.from_rad_s = d.block.to_rad_s = speed_rad_s;
  for (int i = 1; i <= kRangeSteps; ++i) {
    const double aside = kWidestRange * i / kRangeSteps;
    if (!stable(speed_rad_s * (1 - aside)) || !stable(speed_rad_s * (1 + aside))) break;
    d.block.from_rad_s = speed_rad_s * (1 - aside);
    d.block.to_rad_s = speed_rad_s * (1 + aside);
  }
  return d;
}

double dynamometer_error_std(const DynamometerDesign& d, const VectorXd& gain) {
  const Index size = d.output.size();
  const MatrixXd keeps = MatrixXd::Identity(size, size) - gain * d.output;
  // Lyapunov by doubling, of the error after a sample.
  MatrixXd f = keeps * d.transition;
  MatrixXd sum = keeps * d.noise * keeps.transpose() + gain * gain.transpose();
  constexpr int kDoublings = 40;
  for (int i = 0; i < kDoublings; ++i) {
    sum += (f * sum * f.transpose()).eval();
    f = (f * f).eval();
  }
  return std::sqrt(d.force * sum * d.force.transpose());
}

VectorXd dynamometer_block_gain(const DynamometerFilterConfig& c, double speed_rad_s) {
  DynamometerGain gain;
  for (ComplexGain& g : gain.harmonic) g = {1, 0};
  return from_block(c, gain, speed_rad_s);
}

}  // namespace servosense
