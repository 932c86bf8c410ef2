// AR models: the study's numbers, the forms against each other, hours of what breaks recursions,
// the moving threshold, the choice of the order.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <numeric>
#include <type_traits>
#include <vector>

#include "check.hpp"
#include "oracles/recursive_ar.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/ar_order.hpp"
#include "servosense/dsp/lattice_ar.hpp"
#include "servosense/dsp/moving_threshold.hpp"
#include "servosense/sim/gaussian_noise.hpp"

using namespace servosense;

namespace {

// Bertok 1984, p = 2, V = 0.5: residuals, model and energy, computed once by hand from 3.18, 3.19.
void golden() {
  const double z[] = {1, 2, 0, -1, 3, 1};
  const double e[] = {1, 2, -2.666667, 0.882353, 3.571429, 0.795276};
  const double sigma[] = {3, 5.666667, 8.176471, 8.428571, 29.519685, 29.922306};
  LatticeAr<double, 2> lattice;
  lattice.configure({2, 0.5, 1});
  oracle::CovarianceAr<double> covariance(2, 0.5);
  oracle::BayesAr bayes(2, 0.5);
  oracle::FastTransversalAr<double> fast(2, 0.5);
  for (int i = 0; i < 6; ++i) {
    CHECK_NEAR(lattice.process(z[i]), e[i], 6e-7);
    CHECK_NEAR(covariance.process(z[i]), e[i], 6e-7);
    CHECK_NEAR(bayes.process(z[i]), e[i], 6e-7);
    CHECK_NEAR(fast.process(z[i]), e[i], 6e-7);
    CHECK_NEAR(fast.energy, sigma[i], 6e-7);
    if (i == 2) {
      CHECK_NEAR(covariance.model[0], 0.705882, 6e-7);
      CHECK_NEAR(covariance.model[1], -0.941176, 6e-7);
    }
  }
  CHECK_NEAR(covariance.model[0], 0.100251, 6e-7);
  CHECK_NEAR(covariance.model[1], -0.446115, 6e-7);
  CHECK_NEAR((fast.A + covariance.model).norm(), 0, 1e-14);
}

/// Torque of a face mill as the drive shows it: six unequal teeth, twelve samples a revolution.
double milling(std::size_t k, GaussianNoise& noise, double mean = 500, double sd = 5) {
  static const double tooth[] = {1.0, 0.8, 1.1, 0.9, 1.2, 0.95};
  const double within = k % 2 == 0 ? 1.0 : 0.55;
  return mean + 80 * tooth[k / 2 % 6] * within + sd * noise.next();
}

// All forms give the same residual, for many orders and noise variances.
void forms_agree() {
  double lattice_worst = 0, fast_worst = 0, bayes_worst = 0, model_worst = 0;
  bool healthy = true;
  for (const int p : {2, 3, 8, 16, 27, 28, 32})
    for (const double v : {0.01, 0.1, 10.0}) {
      LatticeAr<double, 32> lattice;
      lattice.configure({static_cast<unsigned>(p), v, 1});
      oracle::CovarianceAr<double> covariance(p, v);
      oracle::FastTransversalAr<double> fast(p, v);
      oracle::BayesAr bayes(p, v);
      GaussianNoise noise(static_cast<std::uint64_t>(p));
      const int length = 1500;
      for (int k = 0; k < length; ++k) {
        const double z = milling(static_cast<std::size_t>(k), noise);
        const double e = covariance.process(z);
        lattice_worst = std::max(lattice_worst, std::abs(lattice.process(z) - e));
        fast_worst = std::max(fast_worst, std::abs(fast.process(z) - e));
        if (k < 200) bayes_worst = std::max(bayes_worst, std::abs(bayes.process(z) - e));
      }
      healthy = healthy && fast.healthy;
      model_worst = std::max(model_worst, (fast.A + covariance.model).cwiseAbs().maxCoeff());
      const Eigen::LLT<Eigen::MatrixXd> root(covariance.covariance);
      CHECK(root.info() == Eigen::Success);  // still positive definite
    }
  check::figure("lattice against covariance, p = 2..32, V = 0.01..10, double", lattice_worst);
  check::figure("fast transversal against covariance, double", fast_worst);
  check::figure("Bayes against Kalman form, double", bayes_worst);
  CHECK_BETWEEN(lattice_worst, 0.0, 1e-6);
  CHECK_BETWEEN(fast_worst, 0.0, 1e-6);
  CHECK_BETWEEN(bayes_worst, 0.0, 1e-6);
  CHECK_BETWEEN(model_worst, 0.0, 1e-6);
  CHECK(healthy);
}

// The model is the batch solution [E + M'M / V]^-1 M'z / V, and finds known coefficients.
void batch_and_known_coefficients() {
  GaussianNoise noise(3);
  const int p = 3, length = 20000;
  const double a[] = {1.2, -0.7, 0.2};
  oracle::CovarianceAr<double> covariance(p, 1.0);
  Eigen::MatrixXd normal = Eigen::MatrixXd::Identity(p, p);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(p);
  Eigen::VectorXd past = Eigen::VectorXd::Zero(p);
  for (int k = 0; k < length; ++k) {
    const double z = a[0] * past[0] + a[1] * past[1] + a[2] * past[2] + noise.next();
    normal += past * past.transpose();
    right += past * z;
    covariance.process(z);
    for (Eigen::Index i = p - 1; i > 0; --i) past[i] = past[i - 1];
    past[0] = z;
  }
  const Eigen::VectorXd batch = normal.ldlt().solve(right);
  CHECK_NEAR((covariance.model - batch).norm(), 0, 1e-10);
  // Standard error of a coefficient is at most 1 / sqrt(N) = 0.007.
  for (int i = 0; i < p; ++i) CHECK_NEAR(batch[i], a[i], 4 * 0.0071);
}

// With forgetting: weighted least squares. The covariance form lets V fade, the lattice keeps it,
// so the two are compared where V is next to nothing.
void forgetting() {
  const double l = 0.98;
  GaussianNoise noise(8);
  LatticeAr<double, 8> eight;
  eight.configure({8, 1e-6, l});
  oracle::CovarianceAr<double> covariance(8, 1e-6, l);
  double apart = 0;
  for (int k = 0; k < 3000; ++k) {
    const double z = milling(static_cast<std::size_t>(k), noise, 5, 1);
    const double e = covariance.process(z);
    const double f = eight.process(z);
    if (k > 500) apart = std::max(apart, std::abs(e - f));
  }
  check::figure("forgetting 0.98: lattice against weighted covariance, V -> 0", apart);
  CHECK_BETWEEN(apart, 0.0, 1e-5);
}

// The fast recursion in float loses its footing, and its health flag says so; the lattice in float
// stays with the double reference.
void float_breakdown() {
  for (const double v : {0.00318, 0.1}) {
    const int p = 28;
    oracle::FastTransversalAr<float> fast(p, static_cast<float>(v));
    oracle::CovarianceAr<float> textbook(p, static_cast<float>(v));
    LatticeAr<float, 32> lattice;
    lattice.configure({28, v, 1});
    oracle::CovarianceAr<double> reference(p, v);
    GaussianNoise noise(5);
    double fast_worst = 0, lattice_worst = 0, textbook_worst = 0;
    int broke = -1;
    for (int k = 0; k < 4000; ++k) {
      const double z = milling(static_cast<std::size_t>(k), noise);
      const double e = reference.process(z);
      const auto in = static_cast<float>(z);
      const double f = static_cast<double>(fast.process(in));
      const double t = static_cast<double>(textbook.process(in));
      const double l = static_cast<double>(lattice.process(in));
      if (!fast.healthy && broke < 0) broke = k;
      fast_worst = std::isfinite(f) ? std::max(fast_worst, std::abs(f - e)) : 1e30;
      textbook_worst = std::isfinite(t) ? std::max(textbook_worst, std::abs(t - e)) : 1e30;
      lattice_worst = std::max(lattice_worst, std::abs(l - e));
    }
    check::figure("float, V = " + std::to_string(v) + ": fast transversal, error", fast_worst);
    check::figure("  its health flag after samples", broke);
    check::figure("  covariance form, error", textbook_worst);
    check::figure("  lattice, error", lattice_worst);
    CHECK(broke >= 0 && broke < 200);
    CHECK(fast_worst > 100);
    // While the model is still undetermined (k < p) the residual is the quotient of small
    // differences of values of 500: a few units of float rounding times the condition.
    CHECK_BETWEEN(lattice_worst, 0.0, 1.0);
    CHECK(lattice.state().resets == 0);
  }
}

// An hour of half teeth at 12 000 rpm and four teeth, 1600 a second, in float: zeros, a pure tone,
// steps, and at the end the lattice does what a fresh one does.
void hours_of_nothing() {
  const double l = 1 - 1.0 / 80;
  const unsigned p = 16;
  const long hour = 1600L * 3600;
  auto lattice = std::make_unique<LatticeAr<float, 16>>();
  lattice->configure({p, 1e-4, l});
  auto finite = [&] {
    for (const auto& s : lattice->state().stages)
      if (!(is_finite(s.forward_reflection) && is_finite(s.backward_reflection) &&
            s.forward_energy >= 0.99e-4F && s.backward_energy >= 0.99e-4F && s.conversion >= 0 &&
            s.conversion <= 1))
        return false;
    return is_finite(lattice->state().residual);
  };
  bool ok = true;
  GaussianNoise noise(1);
  for (int k = 0; k < 1000; ++k) lattice->process(static_cast<float>(5 + noise.next()));
  for (long k = 0; k < hour; ++k) {
    const float e = lattice->process(0);
    if (k > 100) ok = ok && e == 0;
  }
  CHECK(ok && finite());
  // A tone of one line a revolution of 8 half teeth, exactly periodic: predicted to rounding.
  float tone[8];
  for (int i = 0; i < 8; ++i) tone[i] = static_cast<float>(10 * std::sin(kTwoPi * i / 8));
  double worst = 0;
  for (long k = 0; k < hour; ++k) {
    const float e = lattice->process(tone[k % 8]);
    if (k > 2000) worst = std::max(worst, std::abs(static_cast<double>(e)));
  }
  check::figure("residual of a pure tone of 10, V = 1e-4, float, one hour", worst);
  CHECK(finite());
  CHECK_BETWEEN(worst, 0.0, 1e-3);
  // Steps between levels every 50 samples.
  worst = 0;
  for (long k = 0; k < hour; ++k) {
    const float e = lattice->process(k / 50 % 2 == 0 ? 20.0F : -3.0F);
    if (k > 2000) worst = std::max(worst, std::abs(static_cast<double>(e)));  // the tone forgotten
  }
  CHECK(finite());
  check::figure("residual of steps of 23", worst);
  CHECK_BETWEEN(worst, 1.0, 100.0);  // a step of 23, predicted from at most 16 samples
  CHECK(lattice->state().resets == 0);
  // Nothing of that is left: the residual of new data is that of a fresh double model.
  LatticeAr<double, 16> fresh;
  fresh.configure({p, 1e-4, l});
  worst = 0;
  for (int k = 0; k < 6000; ++k) {
    const double z = milling(static_cast<std::size_t>(k) % 8, noise, 50, 1);
    const double d =
        fresh.process(z) - static_cast<double>(lattice->process(static_cast<float>(z)));
    if (k > 4000) worst = std::max(worst, std::abs(d));
  }
  check::figure("after three hours, float against a fresh double model", worst);
  CHECK_BETWEEN(worst, 0.0, 1e-3);
}

void bad_numbers() {
  LatticeAr<float, 8> lattice;
  lattice.configure({8, 0.01, 0.99});
  GaussianNoise noise(4);
  for (int k = 0; k < 500; ++k) lattice.process(static_cast<float>(noise.next()));
  const auto before = lattice.state().stages;
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), -3e38F}) {
    const float e = lattice.process(bad);
    CHECK(is_finite(e) && lattice.state().held);
  }
  CHECK(std::memcmp(&before, &lattice.state().stages, sizeof before) == 0);
  CHECK(is_finite(lattice.process(1)) && !lattice.state().held);
  // The largest numbers it takes, between small ones.
  for (int k = 0; k < 5000; ++k) lattice.process(k % 7 == 0 ? 9e11F : 1e-3F);
  for (int k = 0; k < 5000; ++k) lattice.process(static_cast<float>(noise.next()));
  CHECK(is_finite(lattice.state().residual));
  CHECK(std::abs(lattice.state().residual) < 20);
}

// Spread over calls, the same bits.
void staged() {
  LatticeAr<float, 12> whole, staged;
  whole.configure({12, 0.1, 0.99});
  staged.configure({12, 0.1, 0.99});
  GaussianNoise noise(6);
  bool same = true;
  for (int k = 0; k < 300; ++k) {
    const auto z = static_cast<float>(milling(static_cast<std::size_t>(k), noise));
    const float e = whole.process(z);
    staged.begin(z);
    int calls = 1;
    while (!staged.process_some(5)) ++calls;
    same = same && calls == 3 && std::memcmp(&e, &staged.state().residual, sizeof e) == 0;
  }
  CHECK(same);
}

// Bertok 1984, figs 3.7 to 3.12: a break is lost at order 8 and stands out from 24 on; V from 0.02
// to 2 % of the mean matters little. Growing memory as in the study, and the monitor's ten
// revolutions: least squares that never forgets is bound for good to the first p samples, in which
// it saw the mean of 500 for the first time with zeros before it.
void order_and_variance() {
  auto contrast = [](unsigned p, double v, double forgetting) {
    double sum = 0;  // residual of the break over what the 300 samples before it reach
    for (unsigned seed = 1; seed <= 10; ++seed) {
      LatticeAr<double, 32> lattice;
      lattice.configure({p, v, forgetting});
      GaussianNoise noise(seed);
      double background = 0, peak = 0;
      for (std::size_t k = 0; k < 1512; ++k) {
        double z = milling(k, noise, 500, 2);
        if (k >= 1500 && k % 12 == 0) z -= 40;  // half of a tooth's ripple
        if (k >= 1500 && k % 12 == 2) z += 40;
        const double e = lattice.process(z);
        if (k >= 1200 && k < 1500) background = std::max(background, std::abs(e));
        if (k >= 1500) peak = std::max(peak, std::abs(e));
      }
      sum += peak / background / 10;
    }
    return sum;
  };
  const double ten_revolutions = 1 - 1 / 120.0;
  double growing[5], forgets[5];
  const unsigned orders[] = {8, 16, 24, 28, 32};
  for (int i = 0; i < 5; ++i) {
    growing[i] = contrast(orders[i], 0.1, 1);
    forgets[i] = contrast(orders[i], 0.1, ten_revolutions);
    check::figure("break over background, order " + std::to_string(orders[i]), growing[i]);
    check::figure("  with a memory of ten revolutions", forgets[i]);
  }
  CHECK(growing[0] < 2.5);
  CHECK(growing[2] > 1.2 * growing[0] && forgets[2] > 1.5 * forgets[0]);
  CHECK(forgets[2] > growing[2]);
  CHECK_NEAR(growing[4] / growing[2], 1, 0.25);  // no gain beyond two revolutions
  CHECK_NEAR(forgets[4] / forgets[2], 1, 0.25);
  CHECK_NEAR(contrast(28, 10, 1) / contrast(28, 0.1, 1), 1, 0.1);  // V 2 % and 0.02 % of the mean
}

void choice_of_order() {
  // An AR(3) process: both criteria find an order near 3, and no lower one.
  GaussianNoise noise(12);
  std::vector<double> z(4000);
  for (std::size_t k = 3; k < z.size(); ++k)
    z[k] = 1.2 * z[k - 1] - 0.7 * z[k - 2] + 0.3 * z[k - 3] + noise.next();
  auto curve = ar_order_curve(z, 40, 1e-3);
  CHECK(curve.has_value());
  CHECK_BETWEEN(static_cast<double>(curve->least_aic), 3, 6);
  CHECK_BETWEEN(static_cast<double>(curve->least_fpe), 3, 6);
  // Variance of the innovation: 1 within four standard errors, sqrt(2 / 4000) each.
  CHECK_NEAR(curve->variance[3], 1, 4 * 0.0224);
  CHECK_NEAR(curve->fpe[3], 1, 4 * 0.0224);
  // Akaike's factor by hand.
  const double n = 3960;
  CHECK_NEAR(curve->fpe[5] / curve->variance[5], (n + 6) / (n - 6), 1e-12);
  // Against the residuals of the covariance form, order by order.
  for (const int p : {1, 7, 40}) {
    oracle::CovarianceAr<double> model(p, 1e-3);
    double sum = 0;
    for (std::size_t k = 0; k < z.size(); ++k) {
      const double e = model.process(z[k]);
      if (k >= 40) sum += e * e;
    }
    CHECK_NEAR(curve->variance[static_cast<std::size_t>(p)], sum / n, 1e-8);
  }
  // Twelve samples a revolution: AIC falls steeply where the order covers a revolution.
  std::vector<double> torque(3000);
  for (std::size_t k = 0; k < torque.size(); ++k) torque[k] = milling(k, noise, 500, 1);
  curve = ar_order_curve(torque, 48, 0.1);
  CHECK(curve.has_value());
  CHECK_BETWEEN(static_cast<double>(curve->least_aic), 11, 48);
  check::figure("AIC at order 8", curve->aic[8]);
  check::figure("AIC at order 12", curve->aic[12]);
  check::figure("AIC at order 24", curve->aic[24]);
  CHECK(curve->aic[8] > curve->aic[12] + 100);
  CHECK(curve->aic[24] < curve->aic[12]);
  // What it refuses, and what it takes.
  CHECK(!ar_order_curve(z, 0, 1));
  CHECK(!ar_order_curve(z, 257, 1));
  CHECK(!ar_order_curve(z, 40, 0));
  CHECK(!ar_order_curve(std::span(z).first(122), 40, 1));
  z[77] = std::nan("");
  CHECK(!ar_order_curve(z, 40, 1));
  const std::vector<double> zeros(200, 0.0);
  curve = ar_order_curve(zeros, 10, 1e-3);
  CHECK(curve.has_value() && curve->least_aic == 0);
}

// A curve that falls where Bertok's fig. 3.6 does, steeply at first, and rises by chance elsewhere.
void candidates() {
  std::vector<double> aic = {9000};
  for (std::size_t p = 1; p <= 60; ++p) {
    double fall = p % 3 == 0 ? -1.5 : 0.8;
    if (p <= 3) fall = 1500;
    if (p == 9 || p == 11) fall = 120;
    if (p >= 28 && p <= 30) fall = 9;
    if (p == 44 || p == 46) fall = 25;
    aic.push_back(aic.back() - fall);
  }
  CHECK((candidate_orders(aic) == std::vector<std::size_t>{3, 11, 30, 46}));
  CHECK(candidate_orders(std::vector<double>(20, 1.0)).empty());
  CHECK(candidate_orders({}).empty());
}

void moving_threshold() {
  MovingThreshold<double, 32, 4> t;
  for (const auto& [n, q] : {std::pair{5U, 1U}, {10U, 1U}, {20U, 1U}, {10U, 4U}, {7U, 3U}}) {
    t.configure({n, 0.5, q});
    std::vector<double> x;
    GaussianNoise noise(n);
    for (std::size_t k = 0; k < 200; ++k) {
      x.push_back(noise.next() * (k == 100 ? 30 : 1));
      double before = 0, now = 0, others = 0;
      for (std::size_t i = 0; i < n + q && i <= k; ++i) {
        (i < q ? now : before) += x[k - i] * x[k - i];
        if (i > 0) others += x[k - i] * x[k - i];
      }
      const bool full = k + 1 >= n + q;
      const double expected = full ? now / (before / n + 0.25) : 0;
      const double newest = full ? x[k] * x[k] / ((others + 0.25 * n) / (n + q - 1)) : 0;
      CHECK_NEAR(t.process(x[k]), expected, 1e-12 * (1 + expected));
      CHECK_NEAR(t.state().newest_squared, newest, 1e-12 * (1 + newest));
    }
  }
  // Gaussian residuals, n = 10: P(|R| > 4) = P(|t_10| > 4) = 2.5e-3 without floor.
  MovingThreshold<float, 16> f;
  f.configure({10, 1e-6});
  GaussianNoise noise(77);
  int over = 0;
  const int trials = 400000;
  for (int k = 0; k < trials; ++k) over += f.process(static_cast<float>(noise.next())) > 16;
  check::figure("Gaussian residuals beyond R = 4, n = 10", over / double{trials});
  CHECK_NEAR(over / double{trials}, 2.52e-3, 4 * std::sqrt(2.52e-3 / trials) * 1.5);
  // Four of them together: P(R > 6) = P(F(4, 10) > 9) = 2.385e-3. Neighbours share three of four
  // residuals, so the count spreads twice as far at most.
  constexpr double kFourBeyondSix = 2.385e-3;
  MovingThreshold<float, 16, 4> joint;
  joint.configure({10, 1e-6, 4});
  over = 0;
  for (int k = 0; k < trials; ++k) over += joint.process(static_cast<float>(noise.next())) > 36;
  check::figure("four Gaussian residuals beyond R = 6, n = 10", over / double{trials});
  CHECK_NEAR(over / double{trials}, kFourBeyondSix, 4 * 2 * std::sqrt(kFourBeyondSix / trials));
  CHECK(f.process(std::numeric_limits<float>::quiet_NaN()) == 0);
  for (int k = 0; k < 50; ++k) CHECK(is_finite(f.process(0)));
}

void refuses() {
  auto named = [](auto&& change) {
    LatticeArConfig c;
    change(c);
    return std::string(LatticeAr<float, 32>::validate(c).parameter());
  };
  CHECK_TEXT(named([](auto&) {}), "");
  CHECK_TEXT(named([](auto& c) { c.order = 0; }), "order");
  CHECK_TEXT(named([](auto& c) { c.order = 33; }), "order");
  CHECK_TEXT(named([](auto& c) { c.noise_variance = 0; }), "noise_variance");
  CHECK_TEXT(named([](auto& c) { c.forgetting = 1.1; }), "forgetting");
  CHECK_TEXT((MovingThreshold<float, 8>::validate({9, 1}).parameter()), "window");
  CHECK_TEXT((MovingThreshold<float, 8>::validate({8, 0}).parameter()), "floor");
  CHECK_TEXT((MovingThreshold<float, 8, 4>::validate({8, 1, 5}).parameter()), "judged");
  static_assert(std::is_trivially_copyable_v<LatticeAr<float, 32>::State>);
}

}  // namespace

int main() {
  golden();
  forms_agree();
  batch_and_known_coefficients();
  forgetting();
  float_breakdown();
  hours_of_nothing();
  bad_numbers();
  staged();
  order_and_variance();
  choice_of_order();
  candidates();
  moving_threshold();
  refuses();
  return check::done();
}
