// Kalman gains of the dynamometer filter for one speed. The oracle is a filter of the test's own:
// physical states (displacement and velocity of each mode, harmonics), transition and noise by
// power series, covariance by the recursion sample by sample, the estimate by plain matrices.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/observer/dynamometer_design.hpp"

namespace {

using namespace servosense;
using Complex = std::complex<double>;
using Eigen::MatrixXd;
using Eigen::RowVectorXd;
using Eigen::VectorXd;

constexpr double kTurn = 6.283185307179586;

DynamometerFilterConfig config_of(const std::vector<DynamometerMode>& modes) {
  DynamometerFilterConfig c;
  c.modes = modes.size();
  std::copy(modes.begin(), modes.end(), c.mode.begin());
  return c;
}
const DynamometerFilterConfig kOneMode = config_of({{930, 0.03, 0.9}});
const DynamometerFilterConfig kThreeModes =
    config_of({{930, 0.03, 0.7}, {1650, 0.02, -0.1}, {2480, 0.04, 0.25}});

double rad_s(double rpm) { return rpm * kTurn / 60; }

/// The composite model of Dunwoody 2010, eq. 5.36 to 5.40.
struct Physical {
  MatrixXd a, q;
  RowVectorXd c, f;
  Physical(const DynamometerFilterConfig& d, double speed) {
    const auto modes = static_cast<Eigen::Index>(2 * d.modes);
    const auto forces = static_cast<Eigen::Index>(2 * d.harmonics + 1);
    const Eigen::Index size = modes + forces;
    a = MatrixXd::Zero(size, size);
    q = MatrixXd::Zero(size, size);
    c = f = RowVectorXd::Zero(size);
    for (Eigen::Index i = modes; i < size; i += i == modes ? 1 : 2) f(i) = 1;
    c = f;
    for (std::size_t k = 0; k < d.modes; ++k) {
      const auto i = static_cast<Eigen::Index>(2 * k);
      const double w = kTurn * d.mode[k].natural_frequency_hz;
      // Displacement in force, and velocity over w, so that the recursion keeps its digits.
      a(i, i + 1) = w;
      a(i + 1, i) = -w;
      a(i + 1, i + 1) = -2 * d.mode[k].damping_ratio * w;
      a.row(i + 1) += w * f;
      c(i) += d.mode[k].share;
      c -= d.mode[k].share * f;
    }
    for (std::size_t n = 1; n <= d.harmonics; ++n) {
      const auto i = modes + static_cast<Eigen::Index>(2 * n - 1);
      a(i, i + 1) = static_cast<double>(n) * speed;
      a(i + 1, i) = -a(i, i + 1);
    }
    const double follows = speed / (kTurn * d.averaged_turns);
    q.bottomRightCorner(forces, forces) =
        2 * follows * follows * d.sample_period_s * MatrixXd::Identity(forces, forces);
  }
};

/// e^(At) and the integral of e^(As) Q e^(A's), by their series.
std::pair<MatrixXd, MatrixXd> over_a_sample(const MatrixXd& a, const MatrixXd& q, double t) {
  MatrixXd phi = MatrixXd::Identity(a.rows(), a.cols()), term = phi;
  MatrixXd noise = MatrixXd::Zero(a.rows(), a.cols()), derivative = q * t;
  for (int i = 1; i < 40; ++i) {
    noise += derivative;
    derivative = ((a * derivative + derivative * a.transpose()) * (t / (i + 1))).eval();
    term = (term * a * (t / i)).eval();
    phi += term;
  }
  return {phi, noise};
}

/// The same estimates as those of a filter that is found and run otherwise.
void same_as_the_recursion(const DynamometerFilterConfig& c, double rpm) {
  const auto design = design_dynamometer_filter(c, rad_s(rpm));
  CHECK(design.has_value());
  if (!design) return;
  const Physical m(c, rad_s(rpm));
  const auto [phi, noise] = over_a_sample(m.a, m.q, c.sample_period_s);
  MatrixXd p = noise;
  VectorXd gain;
  for (int i = 0; i < 60000; ++i) {
    const VectorXd pc = p * m.c.transpose();
    gain = pc / (1 + m.c * pc);
    const MatrixXd after = p - gain * pc.transpose();
    p = phi * after * phi.transpose() + noise;
    p = ((p + p.transpose()) / 2).eval();
    if (i % 256 == 255 && i > 2000) {
      const VectorXd next = p * m.c.transpose() / (1 + m.c * p * m.c.transpose());
      if ((next - gain).norm() < 1e-13 * gain.norm()) break;
    }
  }
  // The block with these gains, beside the matrices.
  static DynamometerFilter<double> block;
  block.configure(c, design->block);
  std::mt19937 random(701);
  std::normal_distribution<double> normal(0, 1);
  VectorXd z = VectorXd::Zero(phi.rows());
  double angle = 0;
  const double step = rad_s(rpm) * c.sample_period_s;
  // The block begins when it has been through the harmonics once.
  for (std::size_t i = 0; i <= c.harmonics; ++i) (void)block.process(0, angle, step);
  double worst = 0, largest = 0;
  for (int i = 0; i < 20000; ++i) {
    angle = std::fmod(angle + step, kTurn);
    const double y = normal(random);
    z = (phi * z).eval();
    z += gain * (y - m.c * z);
    const double expected = m.f * z, found = block.process(y, angle, step);
    worst = std::max(worst, std::abs(found - expected));
    largest = std::max(largest, std::abs(expected));
  }
  check::figure("block beside the recursion's filter, largest difference", worst / largest);
  CHECK(worst < 1e-6 * largest);
}

/// G(e^(jwT)) H(jw) of the design at the harmonics.
double worst_at_harmonics(const DynamometerFilterConfig& c, const DynamometerDesign& d,
                          double speed) {
  const auto size = d.transition.rows();
  const MatrixXd one = MatrixXd::Identity(size, size);
  const MatrixXd closed = (one - d.gain * d.output) * d.transition;
  double worst = 0;
  for (std::size_t n = 0; n <= c.harmonics; ++n) {
    const double w = static_cast<double>(n) * speed;
    const Complex at = std::polar(1., w * c.sample_period_s);
    const Eigen::VectorXcd x =
        (at * Eigen::MatrixXcd::Identity(size, size) - closed.cast<Complex>())
            .partialPivLu()
            .solve(d.gain.cast<Complex>() * at);
    Complex h = 1;
    for (std::size_t k = 0; k < c.modes; ++k) {
      const double wk = kTurn * c.mode[k].natural_frequency_hz;
      h += c.mode[k].share *
           (wk * wk / Complex(wk * wk - w * w, 2 * c.mode[k].damping_ratio * wk * w) - 1.);
    }
    worst = std::max(worst, std::abs((d.force.cast<Complex>() * x)(0) * h - 1.));
  }
  return worst;
}

void of_one_speed(const DynamometerFilterConfig& c, double rpm) {
  const auto d = design_dynamometer_filter(c, rad_s(rpm));
  CHECK(d.has_value());
  if (!d) {
    std::printf("%s\n", d.error().sentence.c_str());
    return;
  }
  const double harmonics = worst_at_harmonics(c, *d, rad_s(rpm));
  const double limit = dynamometer_error_std(*d, dynamometer_block_gain(c, rad_s(rpm)));
  std::printf(
      "%zu modes, %5.0f rpm, %2.0f turns: residual %.1e, |GH-1| %.1e, error %.4f, that of "
      "the limit gains %.4f; gains hold from %.0f to %.0f rpm\n",
      c.modes, rpm, c.averaged_turns, d->residual, harmonics, d->error_std, limit,
      d->block.from_rad_s * 60 / kTurn, d->block.to_rad_s * 60 / kTurn);
  CHECK(d->residual < 1e-8);
  CHECK(d->spectral_radius < 1);
  CHECK(harmonics < 1e-9);
  // Of the Kalman filter's own gain by another way; no gain is better.
  CHECK_NEAR(dynamometer_error_std(*d, d->gain) / d->error_std, 1, 1e-6);
  CHECK_BETWEEN(limit / d->error_std, 1, c.averaged_turns < 3 ? 1.2 : 1.05);
}

/// Without its higher modes the filter raises what lies there.
void higher_modes_matter() {
  DynamometerFilterConfig fewer = kThreeModes;
  fewer.modes = 1;
  const double speed = rad_s(9000);
  const auto full = design_dynamometer_filter(kThreeModes, speed);
  const auto cut = design_dynamometer_filter(fewer, speed);
  if (!full || !cut) return CHECK(false);
  check::figure("error of the force with all three modes", full->error_std);
  check::figure("promised by the first alone", cut->error_std);
  CHECK(cut->error_std > 1.5 * full->error_std);
}

void refusals() {
  const auto says = [](const DynamometerFilterConfig& c, double speed, const std::string& words) {
    const auto d = design_dynamometer_filter(c, speed);
    CHECK(!d.has_value());
    if (!d) {
      std::printf("%s\n", d.error().sentence.c_str());
      CHECK(d.error().sentence.find(words) != std::string::npos);
    }
  };
  DynamometerFilterConfig undamped = config_of({{930, 1e-6, 0.9}});
  says(undamped, kTurn * 930 * std::sqrt(10.) / 5, "harmonic 5, 2941 Hz, is at a zero");
  says(kOneMode, rad_s(60000), "above 0.8 of half the sample rate");
  says(kOneMode, 0, "must be positive");
  says(kOneMode, std::nan(""), "must be positive");
  DynamometerFilterConfig wrong = kOneMode;
  wrong.averaged_turns = 0;
  says(wrong, 100, "averaged_turns must be within");
}

}  // namespace

int main(int argc, char** argv) {
  for (const double turns : {1., 3., 10.})
    for (const double rpm : {750., 4000., 13950.}) {
      DynamometerFilterConfig c = kOneMode;
      c.averaged_turns = turns;
      of_one_speed(c, rpm);
    }
  of_one_speed(kThreeModes, 750);
  of_one_speed(kThreeModes, 9000);
  same_as_the_recursion(kThreeModes, 9000);
  if (check::nightly(argc, argv)) {
    std::mt19937 random(711);
    const auto uniform = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    for (int i = 0; i < 40; ++i) {
      std::vector<DynamometerMode> modes;
      const auto count = 1 + i % 5;
      for (int k = 0; k < count; ++k)
        modes.push_back({uniform(300, 5000), uniform(0.01, 0.1), uniform(-0.2, 0.6)});
      DynamometerFilterConfig c = config_of(modes);
      c.averaged_turns = uniform(2, 10);
      of_one_speed(c, uniform(750, 18000));
    }
  }
  higher_modes_matter();
  refusals();
  return check::done();
}
