// Force from an accelerometer (Tarng 1988, 5.1), by integration and by the inverse response in
// blocks, against structures of the test's own: second-order equations by classical Runge and
// Kutta. What the work states in words stands here in figures: exact for one mode, the mean lost,
// a mode that is off and a second one, noise against regularisation, the delay of a block. The
// modes are those of its table 5.1; the teeth of its table 5.2.
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "oracles/dynamometer.hpp"
#include "servosense/observer/acceleration_force.hpp"
#include "servosense/observer/inverse_filter.hpp"

namespace {

using namespace servosense;

constexpr double kTurn = 6.283185307179586;
constexpr double kRate_hz = 25600;
constexpr double kPeriod_s = 1 / kRate_hz;

struct Mode {
  double mass_kg, damping, frequency_hz;
};
const std::vector<Mode> kDominant{{80.3, 0.027, 474}};
const std::vector<Mode> kTable5_1{{680.0, 0.047, 274},
                                  {90.9, 0.140, 396},
                                  {80.3, 0.027, 474},
                                  {260.6, 0.037, 633},
                                  {40.5, 0.028, 855}};

/// Acceleration of `modes` under a face mill of eight teeth, and its force; both means over a
/// sample, as behind a filter against aliases.
struct Record {
  std::vector<double> force, acceleration;
};
Record shaken(const std::vector<Mode>& modes, double rpm, double seconds, double noise_m_s2 = 0) {
  oracle::HelicalCut cut;
  cut.teeth = 8;
  cut.radius_m = 0.0508;
  cut.helix_rad = 0.3;
  cut.depth_m = 0.00254;
  cut.feed_m = 0.254e-3;
  cut.exit_rad = kTurn / 4;
  cut.throw_m = {-20.3e-6, -4.2e-6, -16e-6, -8e-6, -25.2e-6, -2.9e-6, 0, -6.9e-6};
  const oracle::ForceOverTurn over_turn(cut);
  const double w = rpm * kTurn / 60;
  const auto force = [&](double t) { return over_turn.at(w * t); };
  std::mt19937 random(81);
  std::normal_distribution<double> noise(0, 1);
  std::vector<std::array<double, 2>> state(modes.size());
  Record r;
  constexpr int kSteps = 4;
  const double h = kPeriod_s / kSteps;
  for (int i = 0; i < static_cast<int>(seconds * kRate_hz); ++i) {
    double sum = 0, of_force = 0;
    for (std::size_t k = 0; k < modes.size(); ++k) {
      const double wk = kTurn * modes[k].frequency_hz;
      const auto a = [&](double x, double v, double f) {
        return f / modes[k].mass_kg - 2 * modes[k].damping * wk * v - wk * wk * x;
      };
      auto& [x, v] = state[k];
      const double before = v;
      for (int j = 0; j < kSteps; ++j) {
        const double t = i * kPeriod_s + j * h;
        const double f0 = force(t), f1 = force(t + h / 2), f2 = force(t + h);
        const double a1 = a(x, v, f0), v1 = v;
        const double a2 = a(x + h / 2 * v1, v + h / 2 * a1, f1), v2 = v + h / 2 * a1;
        const double a3 = a(x + h / 2 * v2, v + h / 2 * a2, f1), v3 = v + h / 2 * a2;
        const double a4 = a(x + h * v3, v + h * a3, f2), v4 = v + h * a3;
        x += h / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
        v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
      }
      sum += (v - before) / kPeriod_s;
    }
    for (int j = 0; j < kSteps; ++j) of_force += force(i * kPeriod_s + (j + 0.5) * h) / kSteps;
    r.force.push_back(of_force);
    r.acceleration.push_back(sum + noise_m_s2 * noise(random));
  }
  return r;
}

/// Of the third quarter, over the rms of the force less its mean, which neither method sees. At its
/// end the record stops as no cut does.
double error_of(const std::vector<double>& estimate, const std::vector<double>& force) {
  const std::size_t from = force.size() / 2, to = force.size() * 3 / 4;
  const auto count = static_cast<double>(to - from);
  double of_force = 0, of_estimate = 0;
  for (std::size_t i = from; i < to; ++i) {
    of_force += force[i] / count;
    of_estimate += estimate[i] / count;
  }
  double error = 0, change = 0;
  for (std::size_t i = from; i < to; ++i) {
    const double d = (estimate[i] - of_estimate) - (force[i] - of_force);
    error += d * d;
    change += (force[i] - of_force) * (force[i] - of_force);
  }
  return std::sqrt(error / change);
}
double mean_of(const std::vector<double>& v) {
  const std::size_t from = v.size() / 2, to = v.size() * 3 / 4;
  double sum = 0;
  for (std::size_t i = from; i < to; ++i) sum += v[i];
  return sum / static_cast<double>(to - from);
}

template <typename Real = double>
std::vector<double> integrated(const Record& r, const Mode& believed, double leak_hz = 2) {
  AccelerationForce<Real> block;
  AccelerationForceConfig c{kPeriod_s, believed.frequency_hz, believed.damping, believed.mass_kg,
                            leak_hz};
  CHECK(block.validate(c).ok());
  block.configure(c);
  std::vector<double> out;
  for (const double a : r.acceleration)
    out.push_back(static_cast<double>(block.process(static_cast<Real>(a))));
  return out;
}

/// The estimate, taken back by the delay of the filter.
std::vector<double> inverted(const Record& r, const std::vector<Mode>& believed,
                             double regularisation, std::size_t size = 4096) {
  std::vector<StructuralMode> modes;
  for (const Mode& m : believed) modes.push_back({m.frequency_hz, m.damping, m.mass_kg});
  auto filter = InverseFilter::make({accelerance(modes, kRate_hz, size / 2 + 1), regularisation});
  CHECK(filter.has_value());
  if (!filter) return std::vector<double>(r.force.size());
  std::vector<double> in = r.acceleration, out(r.acceleration.size() + size), block(size / 2);
  in.resize(in.size() + size, 0);
  for (std::size_t i = 0; i + size / 2 <= in.size(); i += size / 2) {
    filter->process({in.data() + i, size / 2}, block);
    for (std::size_t j = 0; j < block.size() && i + j < out.size(); ++j) out[i + j] = block[j];
  }
  CHECK(filter->delay_samples() == size / 4);
  CHECK(filter->block_samples() == size / 2);
  return {out.begin() + static_cast<std::ptrdiff_t>(size / 4),
          out.begin() + static_cast<std::ptrdiff_t>(size / 4 + r.force.size())};
}

constexpr std::size_t kLong = 65536;

void one_mode() {
  for (const double rpm : {480., 3555.}) {
    const Record r = shaken(kDominant, rpm, 5);
    const std::vector<double> a = integrated(r, kDominant[0], 0.5);
    const std::vector<double> b = inverted(r, kDominant, 1e-6, kLong);
    std::printf(
        "one mode, %4.0f rpm: error of the integrals %.4f, of the inverse %.4f; a mean of "
        "%.0f N becomes %.1f and %.1f N\n",
        rpm, error_of(a, r.force), error_of(b, r.force), mean_of(r.force), mean_of(a), mean_of(b));
    CHECK_BETWEEN(error_of(a, r.force), 0, 0.05);
    CHECK_BETWEEN(error_of(b, r.force), 0, 0.01);
    CHECK(std::abs(mean_of(a)) < 0.01 * mean_of(r.force));
    CHECK(std::abs(mean_of(b)) < 0.01 * mean_of(r.force));
  }
}

void wrong_modes() {
  const Record r = shaken(kDominant, 3555, 5);
  for (const double off : {0.95, 1.05}) {
    std::vector<Mode> believed = kDominant;
    believed[0].frequency_hz *= off;
    const double a = error_of(integrated(r, believed[0], 0.5), r.force);
    const double b = error_of(inverted(r, believed, 1e-6, kLong), r.force);
    std::printf("mode off by %+.0f %%, 3555 rpm: integrals %.3f, inverse %.3f\n", 100 * (off - 1),
                a, b);
    CHECK_BETWEEN(a, 0.5, 3);
    CHECK_BETWEEN(b, 0.5, 3);
  }
  for (const double rpm : {480., 3555.}) {
    const Record five = shaken(kTable5_1, rpm, 5);
    const double a = error_of(integrated(five, kDominant[0], 0.5), five.force);
    const double b = error_of(inverted(five, kDominant, 1e-6, kLong), five.force);
    const double all = error_of(inverted(five, kTable5_1, 1e-6, kLong), five.force);
    std::printf(
        "five modes, %4.0f rpm: integrals of the dominant one %.3f, inverse of it %.3f, "
        "inverse of all five %.4f\n",
        rpm, a, b, all);
    CHECK(a > 1);
    CHECK(b > 1);
    CHECK_BETWEEN(all, 0, 0.01);
  }
}

/// More regularisation, or leak, lets less noise through and less of the force.
void noise_against_regularisation() {
  const Record clean = shaken(kTable5_1, 3555, 5);
  const double rms_m_s2 = std::sqrt(mean_of([&] {
    std::vector<double> squares;
    for (const double a : clean.acceleration) squares.push_back(a * a);
    return squares;
  }()));
  const Record noisy = shaken(kTable5_1, 3555, 5, 0.05 * rms_m_s2);
  double best = 1e9, first = 0, last = 0;
  for (const double r : {1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2}) {
    const double error = error_of(inverted(noisy, kTable5_1, r), noisy.force);
    std::printf("noise 5 %%, inverse with r = %.0e /kg: error %.3f, without noise %.3f\n", r, error,
                error_of(inverted(clean, kTable5_1, r), clean.force));
    if (r == 1e-4) first = error;
    last = error;
    best = std::min(best, error);
  }
  CHECK(first > 3 * best && last > best);
  CHECK_BETWEEN(best, 0.1, 0.5);
  const Record one = shaken(kDominant, 3555, 5, 0.05 * rms_m_s2);
  const Record one_clean = shaken(kDominant, 3555, 5);
  double before = 1e9;
  for (const double leak : {2., 10., 50., 200.}) {
    const double error = error_of(integrated(one, kDominant[0], leak), one.force);
    std::printf("noise 5 %%, integrals with a leak of %3.0f Hz: error %.3f, without noise %.3f\n",
                leak, error, error_of(integrated(one_clean, kDominant[0], leak), one_clean.force));
    CHECK(error < before);
    before = error;
  }
}

void blocks() {
  // The delay: what leaves for a force that begins in the middle of a block.
  const std::vector<StructuralMode> mode{{474, 0.3, 1}};
  auto filter = InverseFilter::make({accelerance(mode, kRate_hz, 2049), 0.02});
  CHECK(filter.has_value());
  if (!filter) return;
  std::vector<double> in(2048), out(2048), second(2048);
  in[1000] = 1;
  filter->process(in, out);
  in[1000] = std::numeric_limits<double>::quiet_NaN();
  filter->process(in, second);
  out.insert(out.end(), second.begin(), second.end());
  std::size_t peak = 0;
  for (std::size_t i = 0; i < out.size(); ++i)
    if (std::abs(out[i]) > std::abs(out[peak])) peak = i;
  CHECK(peak == 1000 + 1024);
  CHECK(filter->not_finite() == 1);
  check::figure("delay of blocks of 2048 at 25.6 kHz", 1e3 * (2048 + 1024) / kRate_hz, "ms");
  filter->reset();
  CHECK(filter->not_finite() == 0);
  filter->process(std::vector<double>(2048), out);
  CHECK(out == std::vector<double>(out.size()) || out[0] == 0);

  const auto refused = [](const InverseFilterConfig& c, const std::string& words) {
    const auto made = InverseFilter::make(c);
    CHECK(!made.has_value() && made.error().sentence.find(words) != std::string::npos);
  };
  refused({accelerance(mode, kRate_hz, 2000), 1}, "power of two");
  refused({accelerance(mode, kRate_hz, 2049), 0}, "regularisation must be positive");
  refused({accelerance(mode, kRate_hz, 2049), 1e-9}, "remembers longer");
  refused({std::vector<std::complex<double>>(2049, std::nan("")), 1}, "must be finite");
}

void integrals_as_a_block() {
  const Record r = shaken(kDominant, 3555, 2);
  const std::vector<double> wide = integrated(r, kDominant[0], 20);
  const std::vector<double> narrow = integrated<float>(r, kDominant[0], 20);
  CHECK(error_of(narrow, wide) < 1e-3);
  AccelerationForce<double> block;
  const AccelerationForceConfig good{kPeriod_s, 474, 0.027, 80.3, 20};
  block.configure(good);
  (void)block.process(1);
  const double after = block.process(std::nan(""));
  CHECK(std::isfinite(after) && has(block.state().quality, Quality::invalid));
  CHECK(std::isfinite(block.process(1)) && !has(block.state().quality, Quality::invalid));
  (void)block.process(1, Quality::restarted);
  CHECK(has(block.state().quality, Quality::settling));
  const auto refused = [&](double AccelerationForceConfig::*field, double value) {
    AccelerationForceConfig c = good;
    c.*field = value;
    CHECK(!block.validate(c).ok());
  };
  refused(&AccelerationForceConfig::sample_period_s, 0);
  refused(&AccelerationForceConfig::natural_frequency_hz, 7000);
  refused(&AccelerationForceConfig::damping_ratio, 1);
  refused(&AccelerationForceConfig::modal_mass_kg, -1);
  refused(&AccelerationForceConfig::leak_hz, 300);
}

}  // namespace

int main() {
  one_mode();
  wrong_modes();
  noise_against_regularisation();
  blocks();
  integrals_as_a_block();
  return check::done();
}
