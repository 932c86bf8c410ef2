// Notch against the analogue law on the prewarped frequency axis.
#include <complex>
#include <limits>

#include "check.hpp"
#include "oracles/frequency_response.hpp"
#include "servosense/dsp/notch.hpp"

namespace {

using namespace servosense;
constexpr double kPeriod_s = 125e-6;

double angle_of(double hz) { return kTwoPi * hz * kPeriod_s; }

template <typename Real>
std::vector<double> impulse(double hz, double quality) {
  Notch<Real> notch;
  notch.configure({hz, quality, kPeriod_s});
  return oracle::impulse_response([&](double x) { return notch.process(Real(x)); }, 20000);
}

// H(s) = (s^2 + w0^2) / (s^2 + s w0/Q + w0^2) at s = j (2/T) tan(w T/2), w0 warped alike.
void law() {
  for (const double f0 : {60.0, 1000.0, 2000.0, 3500.0})
    for (const double quality : {0.7, 2.0, 10.0}) {
      const auto h = impulse<double>(f0, quality);
      const double w0 = 2 / kPeriod_s * std::tan(angle_of(f0) / 2);
      for (const double f : {0.0, 30.0, 300.0, 900.0, 1100.0, 1990.0, 3000.0, 3999.0}) {
        const std::complex<double> s(0, 2 / kPeriod_s * std::tan(angle_of(f) / 2));
        const auto expected = (s * s + w0 * w0) / (s * s + s * w0 / quality + w0 * w0);
        CHECK_NEAR(std::abs(oracle::response(h, angle_of(f)) - expected), 0.0, 1e-9);
      }
      CHECK_NEAR(std::abs(oracle::response(h, angle_of(f0))), 0.0, 1e-10);  // the null is exact
      CHECK_NEAR(std::abs(oracle::response(h, 0)), 1.0, 1e-12);
      CHECK_NEAR(std::abs(oracle::response(h, kPi)), 1.0, 1e-9);
    }
}

// In float the null moves by the rounding of the coefficients: still far beyond 40 dB.
void null_in_float() {
  for (const double f0 : {1000.0, 2000.0}) {
    const double left = std::abs(oracle::response(impulse<float>(f0, 2), angle_of(f0)));
    check::figure("notch in float: gain at its centre [dB]", 20 * std::log10(left + 1e-12), "dB");
    CHECK_BETWEEN(left, 0.0, 1e-5);
  }
}

// Bandwidth: -3 dB where the warped frequencies are w0 / Q apart.
void bandwidth() {
  const double f0 = 1000, quality = 4;
  const auto h = impulse<double>(f0, quality);
  const double k0 = std::tan(angle_of(f0) / 2);
  for (const double side : {-1.0, 1.0}) {
    // |H|^2 = 1/2  <=>  |k^2 - k0^2| = k k0 / Q
    const double k = k0 * (side / (2 * quality) + std::sqrt(1 / (4 * quality * quality) + 1));
    CHECK_NEAR(std::norm(oracle::response(h, 2 * std::atan(k))), 0.5, 1e-9);
  }
}

void refusals() {
  CHECK_TEXT(Notch<float>::validate({4000, 2, kPeriod_s}).parameter(), "frequency_hz");
  CHECK_TEXT(Notch<float>::validate({0, 2, kPeriod_s}).parameter(), "frequency_hz");
  CHECK_TEXT(Notch<float>::validate({1000, 0, kPeriod_s}).parameter(), "quality");
  CHECK_TEXT(Notch<float>::validate({1000, 2, -1}).parameter(), "sample_period_s");
  const double inf = std::numeric_limits<double>::infinity();
  CHECK_TEXT(Notch<float>::validate({1000, inf, kPeriod_s}).parameter(), "quality");
  CHECK(Notch<float>::validate({3999, 2, kPeriod_s}).ok());
}

// A level is passed at once when primed; the state of the section tells of a held sample.
void start_and_faults() {
  Notch<double> notch;
  notch.configure({1000, 2, kPeriod_s});
  notch.prime(5);
  for (int n = 0; n < 20; ++n) CHECK_NEAR(notch.process(5), 5.0, 1e-13);
  CHECK_NEAR(notch.process(std::numeric_limits<double>::quiet_NaN()), 5.0, 1e-13);
  CHECK(notch.state().held);
  CHECK_NEAR(notch.process(5), 5.0, 1e-13);
}

}  // namespace

int main() {
  law();
  null_in_float();
  bandwidth();
  refusals();
  start_and_faults();
  return check::done();
}
