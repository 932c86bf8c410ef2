// Dynamometer compensation against a dynamometer of the test's own (oracles/dynamometer.hpp): the
// range of the force from 750 to 18 000 rpm across the mode at 930 Hz (Dunwoody 2010, fig. 5.8 and
// 5.9), waveform beside that of the plain inverse, wrong modes and speeds, a speed that changes,
// noise, single precision, and what is bad of the input. The throws of the teeth come from seeds
// 601 on.
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <limits>
#include <random>
#include <vector>

#include "check.hpp"
#include "oracles/dynamometer.hpp"
#include "servosense/observer/dynamometer_filter.hpp"

namespace {

using namespace servosense;
using oracle::DynamometerSwing;
using oracle::ForceOverTurn;
using oracle::HelicalCut;
using Complex = std::complex<double>;

constexpr double kRate_hz = 25600;
constexpr double kPeriod_s = 1 / kRate_hz;
constexpr double kTurn = 6.283185307179586;

using Swings = std::vector<DynamometerSwing>;
const Swings kOneMode{{930, 0.03, 0.9}};

DynamometerFilterConfig config_of(const Swings& modes, double turns = 3) {
  DynamometerFilterConfig c;
  c.sample_period_s = kPeriod_s;
  c.modes = modes.size();
  for (std::size_t k = 0; k < modes.size(); ++k)
    c.mode[k] = {modes[k].frequency_hz, modes[k].damping, modes[k].share};
  c.averaged_turns = turns;
  return c;
}

/// H by its definition, in the test's own words.
Complex response(const Swings& modes, double w) {
  Complex h = 1;
  for (const DynamometerSwing& m : modes) {
    const double wk = kTurn * m.frequency_hz;
    h += m.share * (wk * wk / Complex(wk * wk - w * w, 2 * m.damping * wk * w) - 1.);
  }
  return h;
}

/// A slot by four teeth with throws of 8 um.
ForceOverTurn slot(unsigned seed) {
  HelicalCut cut;
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> off(-8e-6, 8e-6);
  for (double& t : cut.throw_m) t = off(random);
  return ForceOverTurn(cut);
}

/// From the 10th to the 90th percentile.
double range_of(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  const auto at = [&](double share) {
    return v[static_cast<std::size_t>(share * static_cast<double>(v.size() - 1))];
  };
  return at(0.9) - at(0.1);
}
double mean_of(const std::vector<double>& v) {
  double sum = 0;
  for (const double x : v) sum += x;
  return sum / static_cast<double>(v.size());
}
double rms(const std::vector<double>& v) {
  double sum = 0;
  for (const double x : v) sum += x * x;
  return std::sqrt(sum / static_cast<double>(v.size()));
}
std::vector<double> minus(std::vector<double> a, const std::vector<double>& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] -= b[i];
  return a;
}

struct Run {
  double rpm = 750;
  double rpm_per_s = 0;
  double seconds = 1.5;
  double speed_error = 0;  // of the speed that the filter is told
  double noise_N = 0;
};
/// The last quarter of a run, in whole turns.
struct Record {
  std::vector<double> force, measured, estimate;
  [[nodiscard]] double change() const {
    return rms(minus(force, std::vector<double>(force.size(), mean_of(force))));
  }
  /// Error over the force's change.
  [[nodiscard]] double error() const { return rms(minus(estimate, force)) / change(); }
  [[nodiscard]] double raw_error() const { return rms(minus(measured, force)) / change(); }
};

template <typename Real = double>
Record run_of(const ForceOverTurn& cut, const Swings& truth, const DynamometerFilterConfig& c,
              const Run& run) {
  static DynamometerFilter<Real> filter;
  CHECK(filter.validate(c).ok());
  filter.configure(c);
  oracle::SwingingDynamometer dynamometer(truth);
  std::mt19937 random(77);
  std::normal_distribution<double> noise(0, 1);
  const double w = run.rpm * kTurn / 60, grows = run.rpm_per_s * kTurn / 60;
  const auto angle_at = [&](double t) { return w * t + grows * t * t / 2; };
  const auto force = [&](double t) { return cut.at(angle_at(t)); };
  const auto count = static_cast<int>(run.seconds / kPeriod_s);
  // Percentiles of part of a turn would be those of some of the teeth.
  const double quarter_s = run.seconds / 4, turn_s = 60 / run.rpm;
  const double judged_s = run.rpm_per_s == 0 ? std::floor(quarter_s / turn_s) * turn_s : quarter_s;
  const auto judged = static_cast<int>(std::lround(judged_s / kPeriod_s));
  Record record;
  double before = 0;
  for (int i = 1; i <= count; ++i) {
    const double t = i * kPeriod_s;
    double measured = dynamometer.advance(t - kPeriod_s, kPeriod_s, force, 3);
    measured += run.noise_N * noise(random);
    const double angle = (1 + run.speed_error) * angle_at(t);
    const double estimate = static_cast<double>(
        filter.process(static_cast<Real>(measured), static_cast<Real>(std::fmod(angle, kTurn)),
                       static_cast<Real>(angle - before)));
    before = angle;
    if (i <= count - judged) continue;
    record.force.push_back(force(t));
    record.measured.push_back(measured);
    record.estimate.push_back(estimate);
  }
  return record;
}

/// The measured force of whole turns over H, line by line of its Fourier transform.
std::vector<double> plain_inverse(const Swings& modes, const std::vector<double>& measured) {
  const std::size_t size = 4096;  // resolves 6 Hz
  std::vector<double> out(measured.end() - size, measured.end());
  std::vector<Complex> line(size / 2 + 1);
  std::vector<Complex> turn(size);
  for (std::size_t i = 0; i < size; ++i)
    turn[i] = std::polar(1., -kTurn * static_cast<double>(i) / static_cast<double>(size));
  for (std::size_t k = 0; k < line.size(); ++k) {
    for (std::size_t i = 0; i < size; ++i) line[k] += out[i] * turn[i * k % size];
    line[k] /= response(modes, kTurn * static_cast<double>(k) * kRate_hz / size);
  }
  for (std::size_t i = 0; i < size; ++i) {
    double sum = line[0].real() + line[size / 2].real() * (i % 2 == 0 ? 1 : -1);
    for (std::size_t k = 1; k < size / 2; ++k)
      sum += 2 * (line[k] * std::conj(turn[i * k % size])).real();
    out[i] = sum / size;
  }
  return out;
}

// --- what it must show ---------------------------------------------------------------------------

void same_range_at_every_speed(bool nightly) {
  std::printf("10th to 90th percentile of the force, 4 teeth in a slot, mode at 930 Hz:\n");
  double worst = 0, worst_raw = 0;
  for (unsigned seed = 601; seed < (nightly ? 611U : 602U); ++seed) {
    const ForceOverTurn cut = slot(seed);
    double reference = 0;
    for (const double rpm :
         nightly ? std::vector<double>{750, 1500, 3000, 4500, 6000, 7500, 9000, 10500, 12000, 13000,
                                       13500, 13950, 14500, 15000, 16500, 18000}
                 : std::vector<double>{750, 9000, 13950, 18000}) {
      const Record r = run_of(cut, kOneMode, config_of(kOneMode), {.rpm = rpm});
      const double range = range_of(r.estimate), raw = range_of(r.measured);
      if (rpm == 750.) reference = range;
      if (seed == 601)
        std::printf(
            "  %6.0f rpm %7.2f N, measured %7.2f N, applied %7.2f N; waveform error %.3f, "
            "measured %.3f\n",
            rpm, range, raw, range_of(r.force), r.error(), r.raw_error());
      worst = std::max(worst, std::abs(range / reference - 1));
      worst_raw = std::max(worst_raw, std::abs(raw / reference - 1));
      CHECK_BETWEEN(r.error(), 0, 0.35);  // harmonics beyond the twelfth
    }
  }
  check::figure("largest change of the range from that at 750 rpm", 100 * worst, "%");
  check::figure("the same of the measured force", 100 * worst_raw, "%");
  CHECK_BETWEEN(worst, 0, 0.05);
  CHECK(worst_raw > 1);
}

/// With noise of 2 % of the force's change: the plain inverse raises what lies above the mode.
void waveform_beside_the_plain_inverse() {
  const ForceOverTurn cut = slot(620);
  for (const double rpm : {3000., 13950.}) {
    const Record clean = run_of(cut, kOneMode, config_of(kOneMode), {.rpm = rpm});
    const double noise = 0.02 * clean.change();
    const Record r = run_of(cut, kOneMode, config_of(kOneMode), {.rpm = rpm, .noise_N = noise});
    const std::vector<double> inverse = plain_inverse(kOneMode, r.measured);
    // Its ends are not those of whole turns: the middle half is judged.
    const std::size_t size = inverse.size(), from = r.force.size() - size;
    std::vector<double> error, own;
    for (std::size_t i = size / 4; i < 3 * size / 4; ++i) {
      error.push_back(inverse[i] - r.force[from + i]);
      own.push_back(r.estimate[from + i] - r.force[from + i]);
    }
    const double plain = rms(error) / clean.change(), filtered = rms(own) / clean.change();
    std::printf(
        "waveform error at %.0f rpm, noise 2 %%: compensated %.3f, plain inverse %.3f, "
        "measured %.3f\n",
        rpm, filtered, plain, r.raw_error());
    CHECK(filtered < plain);
    CHECK(filtered < r.raw_error() / 3);
  }
}

void wrong_modes_and_speeds() {
  const ForceOverTurn cut = slot(630);
  const auto at = [&](double frequency, double speed_error, double rpm) {
    Swings believed = kOneMode;
    believed[0].frequency_hz *= frequency;
    const Record right = run_of(cut, kOneMode, config_of(kOneMode), {.rpm = rpm});
    const Record r =
        run_of(cut, kOneMode, config_of(believed), {.rpm = rpm, .speed_error = speed_error});
    const double change = std::abs(range_of(r.estimate) / range_of(right.estimate) - 1);
    std::printf("  %6.0f rpm: range off by %5.1f %%, waveform error %.3f (%.3f without)\n", rpm,
                100 * change, r.error(), right.error());
    return std::array{change, r.error() - right.error()};
  };
  std::printf("mode 5 %% too high:\n");
  CHECK(at(1.05, 0, 750)[0] < 0.01);
  const auto resonant = at(1.05, 0, 13950);
  CHECK_BETWEEN(resonant[1], 0.1, 1);
  std::printf("mode 5 %% too low:\n");
  CHECK_BETWEEN(at(0.95, 0, 13950)[1], 0.1, 1);
  std::printf("speed 0.5 %% too high:\n");
  CHECK_BETWEEN(at(1, 0.005, 13950)[1], 0.05, 1);
}

/// Across the mode in a second: the gains follow the angle.
void speed_that_changes() {
  const ForceOverTurn cut = slot(640);
  double worst = 0;
  for (const double rpm_per_s : {-3000., 3000.}) {
    // The last quarter crosses 13 950 rpm.
    const Run run{.rpm = 13950 - 0.875 * rpm_per_s, .rpm_per_s = rpm_per_s, .seconds = 1};
    const Record r = run_of(cut, kOneMode, config_of(kOneMode), run);
    const Record steady = run_of(cut, kOneMode, config_of(kOneMode), {.rpm = 13950, .seconds = 1});
    std::printf(
        "%+.0f rpm/s through the mode: waveform error %.3f, at a constant speed %.3f, "
        "measured %.3f\n",
        rpm_per_s, r.error(), steady.error(), r.raw_error());
    worst = std::max(worst, r.error() - steady.error());
  }
  CHECK_BETWEEN(worst, 0, 0.1);
}

/// A force within the harmonics comes back exactly, at every harmonic.
void exact_at_the_harmonics() {
  DynamometerFilter<double> filter;
  filter.configure(config_of(kOneMode, 1));
  for (const double rpm : {750., 13950., -9000.}) {
    filter.reset();
    const double w = rpm * kTurn / 60;
    std::array<Complex, 13> line;
    for (std::size_t n = 0; n < line.size(); ++n)
      line[n] = std::polar(100. / (1. + static_cast<double>(n)), n == 0 ? 0. : 1.7 * double(n));
    double worst = 0;
    // |H| of the twelfth is 0.013 at 13 950 rpm: its time constant is 79 turns.
    const int count = static_cast<int>((rpm > 750 ? 3500 : 800) * 60 / std::abs(rpm) / kPeriod_s);
    for (int i = 0; i < count; ++i) {
      const double angle = std::fmod(w * kPeriod_s * i, kTurn);
      double force = 0, measured = 0;
      for (std::size_t n = 0; n < line.size(); ++n) {
        const Complex z = line[n] * std::polar(1., static_cast<double>(n) * angle);
        force += z.real();
        measured += (response(kOneMode, static_cast<double>(n) * w) * z).real();
      }
      const double estimate = filter.process(measured, angle, w * kPeriod_s);
      if (i > count - 2000) worst = std::max(worst, std::abs(estimate - force));
    }
    check::figure("error of a force of 13 lines, of 100 N", worst / 100);
    CHECK(worst / 100 < 1e-9);
    for (std::size_t n = 0; n < line.size(); ++n)
      CHECK(std::abs(Complex(filter.state().force[n].re, filter.state().force[n].im) / line[n] -
                     1.) < 1e-9);
    if (rpm > 750) CHECK_NEAR(filter.state().slowest, std::abs(response(kOneMode, 12 * w)), 1e-9);
  }
}

/// Standard deviation of the estimate of noise alone: as the header says.
void noise_is_one_number() {
  std::mt19937 random(651);
  std::normal_distribution<double> noise(0, 1);
  const double rpm = 6000, w = rpm * kTurn / 60, samples = 60 / rpm / kPeriod_s;
  double over_h = 0;
  for (int n = 1; n <= 12; ++n) over_h += 1 / std::abs(response(kOneMode, n * w));
  for (const double turns : {1., 3., 10., 30.}) {
    DynamometerFilter<double> filter;
    filter.configure(config_of(kOneMode, turns));
    double sum = 0, count = 0;
    for (int i = 0; i < 400000; ++i) {
      const double out =
          filter.process(noise(random), std::fmod(w * kPeriod_s * i, kTurn), w * kPeriod_s);
      if (i > 60000) sum += out * out, ++count;
    }
    const double found = std::sqrt(sum / count);
    const double expected = std::sqrt((over_h + 0.7) / (samples * turns));
    std::printf("noise of the estimate, %2.0f turns: %.4f of that measured, expected %.4f\n", turns,
                found, expected);
    CHECK_NEAR(found / expected, 1, 0.1);  // a gain of 3 turns is not yet small
  }
}

void single_precision() {
  const ForceOverTurn cut = slot(660);
  const Record wide = run_of(cut, kOneMode, config_of(kOneMode), {.rpm = 13950});
  const Record narrow = run_of<float>(cut, kOneMode, config_of(kOneMode), {.rpm = 13950});
  CHECK(rms(minus(wide.estimate, narrow.estimate)) < 1e-3 * wide.change());
}

void bad_samples_and_speeds() {
  DynamometerFilter<double> filter;
  filter.configure(config_of(kOneMode));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double step = 0.05;
  double angle = 0, reference = 0;
  const auto force = [](double a) { return 50 + 30 * std::sin(4 * a); };  // far below the mode
  for (int i = 0; i < 160000; ++i) {
    angle = std::fmod(angle + step / 40, kTurn);
    reference = filter.process(force(angle), angle, step / 40);
  }
  CHECK(!has(filter.state().quality, Quality::settling));
  CHECK_NEAR(reference, force(angle), 0.5);
  for (int i = 0; i < 300; ++i) {  // force lost: the harmonics go on
    angle = std::fmod(angle + step / 40, kTurn);
    reference = filter.process(nan, angle, step / 40);
  }
  CHECK(has(filter.state().quality, Quality::invalid));
  CHECK_NEAR(reference, force(angle), 0.5);
  CHECK(filter.process(force(angle), nan, step / 40) == reference);  // the angle lost: it stays
  CHECK(filter.process(force(angle), angle, 1e300) == reference);
  CHECK(filter.state().held == 302);
  angle = std::fmod(angle + step / 40, kTurn);
  CHECK_NEAR(filter.process(force(angle), angle, step / 40), force(angle), 0.5);
  CHECK(!has(filter.state().quality, Quality::invalid));
  (void)filter.process(force(angle), angle, step / 40, Quality::restarted);
  CHECK(has(filter.state().quality, Quality::settling));

  // Harmonics beyond 0.8 of half the rate are left out; one at a zero of H is counted.
  DynamometerFilterConfig undamped = config_of({{930, 1e-9, 0.9}});
  filter.configure(undamped);
  const double zero_hz = 930 * std::sqrt(10.);
  for (int i = 0; i < 50; ++i) {
    const double turn = kTurn * zero_hz / 3 * kPeriod_s;
    (void)filter.process(1, std::fmod(turn * i, kTurn), turn);
  }
  CHECK(filter.state().harmonics == 10);
  CHECK(filter.state().unseen == 1);

  const auto refused = [](auto&& change, const std::string& parameter) {
    DynamometerFilterConfig c = config_of(kOneMode);
    change(c);
    CHECK_TEXT(DynamometerFilter<double>::validate(c).parameter(), parameter);
  };
  refused([](auto& c) { c.sample_period_s = 0; }, "sample_period_s");
  refused([](auto& c) { c.modes = 9; }, "modes");
  refused([](auto& c) { c.harmonics = 0; }, "harmonics");
  refused([](auto& c) { c.averaged_turns = 0; }, "averaged_turns");
  refused([](auto& c) { c.mode[0].natural_frequency_hz = 20000; }, "natural_frequency_hz");
  refused([](auto& c) { c.mode[0].damping_ratio = 1; }, "damping_ratio");
  refused([](auto& c) { c.mode[0].share = 200; }, "share");
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  same_range_at_every_speed(nightly);
  waveform_beside_the_plain_inverse();
  wrong_modes_and_speeds();
  speed_that_changes();
  exact_at_the_harmonics();
  noise_is_one_number();
  single_precision();
  bad_samples_and_speeds();
  return check::done();
}
