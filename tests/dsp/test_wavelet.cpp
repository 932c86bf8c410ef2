// Wavelet transform against the sum that defines it, closed forms, and the rotational filter.
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/dsp/rotational_filter.hpp"
#include "servosense/dsp/wavelet.hpp"

namespace {

using servosense::combined_density;
using servosense::CosineWindow;
using servosense::kPi;
using servosense::kTwoPi;
using servosense::Rotation;
using servosense::RotationalFilter;
using servosense::WaveletConfig;
using servosense::WaveletTransform;
using servosense::WaveletWindow;
using Complex = std::complex<double>;

constexpr double kRate = 8000;

std::vector<Complex> line_of(const std::vector<double>& x, const WaveletConfig& c, double f) {
  const auto transform = WaveletTransform::of(x, c);
  CHECK(transform.has_value());
  auto line = transform->line(f);
  CHECK(line.has_value());
  CHECK(line->size() == x.size());
  return *line;
}

// The definition, term by term.
Complex written_out(const std::vector<double>& x, WaveletWindow window, double f, double rate,
                    std::size_t count, std::ptrdiff_t t) {
  using Wide = long double;
  const Wide pi = std::acos(-1.0L);
  std::complex<Wide> sum = 0;
  Wide weights = 0;
  for (std::size_t m = 0; m < count; ++m) {
    const Wide u = (Wide(m) + 0.5L) / Wide(count);
    Wide w = 1;
    if (window == WaveletWindow::hann) w = 0.5L * (1 - std::cos(2 * pi * u));
    if (window == WaveletWindow::blackman)
      w = 0.42L - 0.5L * std::cos(2 * pi * u) + 0.08L * std::cos(4 * pi * u);
    if (window == WaveletWindow::gauss) w = std::exp(-0.5L * std::pow((u - 0.5L) * 8, 2));
    weights += w;
    const auto n = static_cast<std::ptrdiff_t>(count / 2) - static_cast<std::ptrdiff_t>(m);
    const std::ptrdiff_t at = t + n;
    if (at < 0 || at >= static_cast<std::ptrdiff_t>(x.size())) continue;
    sum += w * Wide(x[static_cast<std::size_t>(at)]) *
           std::polar(Wide(1), -2 * pi * Wide(f) * Wide(n) / Wide(rate));
  }
  sum *= 2 / weights;
  return {static_cast<double>(sum.real()), static_cast<double>(sum.imag())};
}

void equals_definition() {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> noise(-1, 1);
  double worst = 0;
  for (const WaveletWindow window : {WaveletWindow::hann, WaveletWindow::gauss,
                                     WaveletWindow::blackman, WaveletWindow::rectangular})
    for (const double f : {37.3, 150.0, 1111.0, 3900.0})
      for (const std::size_t length : {1UL, 50UL, 1500UL}) {
        std::vector<double> x(length);
        for (double& v : x) v = noise(random);
        const WaveletConfig c{kRate, 9.375, window};
        const auto line = line_of(x, c, f);
        const auto count = static_cast<std::size_t>(std::lround(9.375 * kRate / f));
        for (std::size_t t = 0; t < length; t += 41) {
          const Complex exact =
              written_out(x, window, f, kRate, count, static_cast<std::ptrdiff_t>(t));
          worst = std::max(worst, std::abs(line[t] - exact));
        }
      }
  check::figure("error / max|x| against the definition", worst);
  // FFT rounding: a few u log2(length).
  CHECK_BETWEEN(worst, 0.0, 2e-14);
}

void closed_forms() {
  // A sinusoid shows its amplitude and phase; detuned, the window's response (derived values, order
  // 500 at 150 Hz: those of the rotational filter).
  const double detuning_hz[] = {5, 10, 16, 20, 30, 40, 50};
  const double hann[] = {.939, .772, .500, .320, .026, .024, .004};
  for (int i = 0; i < 7; ++i) {
    std::vector<double> x(3000);
    for (std::size_t k = 0; k < x.size(); ++k)
      x[k] = 7 * std::cos(kTwoPi * (150 + detuning_hz[i]) * static_cast<double>(k) / kRate);
    const auto line = line_of(x, {}, 150);
    for (std::size_t k = 500; k < 2500; ++k) CHECK_NEAR(std::abs(line[k]), 7 * hann[i], 0.006);
  }
  std::vector<double> x(3000);
  for (std::size_t k = 0; k < x.size(); ++k)
    x[k] = 7 * std::cos(kTwoPi * 400 * static_cast<double>(k) / kRate + 0.3);
  for (const WaveletWindow window :
       {WaveletWindow::hann, WaveletWindow::gauss, WaveletWindow::blackman}) {
    const auto line = line_of(x, {kRate, 12, window}, 400);
    const auto transform = WaveletTransform::of(x, {kRate, 12, window});
    const std::size_t reach = transform->reach(400);
    CHECK(reach == 120);
    for (std::size_t k = reach; k < x.size() - reach; ++k) {
      const Complex exact = std::polar(7.0, kTwoPi * 400 * static_cast<double>(k) / kRate + 0.3);
      CHECK_NEAR(std::abs(line[k] - exact), 0, 0.01);
    }
  }
  // Twice the frequency, half the window: a record played twice as fast gives the same line.
  std::mt19937 random(2);
  std::normal_distribution<double> noise(0, 1);
  for (double& v : x) v = noise(random);
  const auto slow = line_of(x, {kRate, 10, WaveletWindow::gauss}, 100);
  const auto fast = line_of(x, {2 * kRate, 10, WaveletWindow::gauss}, 200);
  for (std::size_t k = 0; k < x.size(); ++k) CHECK_NEAR(std::abs(slow[k] - fast[k]), 0, 1e-13);
}

// What a wavelet sees of the motion in a plane, and what the rotational filter does: the two senses
// of rotation look alike to sqrt(|X|^2 + |Y|^2).
void blind_to_rotation() {
  for (const double sense : {1.0, -1.0}) {
    std::vector<double> x(3000);
    std::vector<double> y(3000);
    RotationalFilter<double, 500> filter;
    filter.configure({});
    double radius = 0;
    for (std::size_t k = 0; k < x.size(); ++k) {
      const double turns = 150 * static_cast<double>(k) / kRate;
      const double a = kTwoPi * (turns - std::floor(turns));
      x[k] = 10 * std::sin(a);
      y[k] = sense * 10 * std::cos(a);
      radius = filter.process(x[k], y[k], a);
    }
    const auto density = combined_density(line_of(x, {}, 150), line_of(y, {}, 150));
    CHECK_NEAR(density[1500], 10 * std::sqrt(2.0), 0.01);
    CHECK_NEAR(radius, sense > 0 ? 10 : 0, 0.01);
  }
  // With one window, the filter is made of the two lines: Sy + j Sx = (Y + j X) / 2 taken at the
  // middle of the window and turned on by half of it.
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 1);
  std::vector<double> x(2000);
  std::vector<double> y(2000);
  RotationalFilter<double, 500> filter;
  filter.configure({});
  std::vector<double> radius(x.size());
  for (std::size_t k = 0; k < x.size(); ++k) {
    x[k] = noise(random);
    y[k] = noise(random);
    const double turns = 150 * static_cast<double>(k) / kRate;
    radius[k] = filter.process(x[k], y[k], kTwoPi * (turns - std::floor(turns)));
  }
  const auto in_x = line_of(x, {}, 150);
  const auto in_y = line_of(y, {}, 150);
  // Samples t - 249 ... t + 250 of a window on t are the filter's at t + 250.
  for (std::size_t t = 300; t < 1700; t += 7)
    CHECK_NEAR(radius[t + 250], std::abs(in_y[t] + Complex(0, 1) * in_x[t]) / 2, 1e-12);
}

void refuses_what_makes_no_sense() {
  const std::vector<double> x(100, 1.0);
  auto sentence = [&](const WaveletConfig& c, const std::vector<double>& record) {
    const auto t = WaveletTransform::of(record, c);
    return t ? std::string() : t.error().sentence;
  };
  CHECK_TEXT(sentence({}, x), "");
  CHECK(sentence({0, 10, WaveletWindow::hann}, x).find("sample rate") != std::string::npos);
  CHECK(sentence({kRate, 0.5, WaveletWindow::hann}, x).find("periods") != std::string::npos);
  CHECK(sentence({}, {}).find("empty") != std::string::npos);
  std::vector<double> broken = x;
  broken[37] = std::numeric_limits<double>::quiet_NaN();
  CHECK(sentence({}, broken).find("sample 37") != std::string::npos);
  const auto t = WaveletTransform::of(x, {});
  CHECK(!t->line(0));
  CHECK(!t->line(-5));
  CHECK(!t->line(4000));
  CHECK(!t->line(std::nan("")));
  CHECK(!t->line(1e-6));
  CHECK(t->line(3999).has_value());
  CHECK(!WaveletTransform::of(x, {kRate, 1, WaveletWindow::hann})->line(3000));
}

}  // namespace

int main() {
  equals_definition();
  closed_forms();
  blind_to_rotation();
  refuses_what_makes_no_sense();
  return check::done();
}
