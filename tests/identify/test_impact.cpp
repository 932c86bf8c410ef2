// Receptance from hammer hits: structures of known modes, hit by pulses of closed form
// (tests/identify/hammer_hits.hpp); published numbers of the window, of the offset, of a recorded
// tool; noise against Monte Carlo; every reason for which a hit is not used.
#include <algorithm>
#include <cmath>
#include <complex>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"
#include "hammer_hits.hpp"
#include "servosense/identify/hammer_offset.hpp"
#include "servosense/identify/impact.hpp"
#include "servosense/identify/impact_pulse.hpp"

using namespace servosense;
using namespace hammer_test;

namespace {

constexpr std::complex<double> kI(0, 1);

ImpactOptions of(int derivative) {
  ImpactOptions o;
  o.response = static_cast<ResponseQuantity>(derivative);
  return o;
}

/// Largest deviation from the truth over the usable band, as a share of the highest receptance.
double off(const ImpactResult& f, const std::vector<Mode>& modes) {
  double worst = 0, highest = 0;
  for (std::size_t i = 0; i < f.response.frequency_hz.size(); ++i) {
    const double hz = f.response.frequency_hz[i];
    if (hz < f.usable_from_hz || hz > f.usable_to_hz) continue;
    const auto truth =
        receptance(modes, f.response.exponential_window_per_s + kI * (kTurn * hz));
    highest = std::max(highest, std::abs(truth));
    worst = std::max(worst, std::abs(f.response.receptance_m_per_N[i] - truth));
  }
  return worst / highest;
}

// Dunwoody 2010, 4.3: 6 % of the noise with a pulse of 0.4 ms in 0.2 s at 50 kHz.
void window() {
  constexpr std::size_t kSamples = 10000;
  for (const double width_s : {0.0004, 0.00041}) {
    std::vector<double> force(kSamples);
    for (std::size_t i = 0; i < kSamples; ++i)
      force[i] = force_of({0.01, 500, width_s, false}, static_cast<double>(i) / 50000);
    const auto peak = static_cast<std::size_t>(std::max_element(force.begin(), force.end()) -
                                               force.begin());
    const ForcePulse pulse = pulse_about(force, peak);
    const ForceWindow w(pulse);
    CHECK_NEAR(std::sqrt(w.power() / kSamples), 0.060, 0.003);
    for (std::size_t i = 0; i < kSamples; ++i) {
      const double at = w(static_cast<std::ptrdiff_t>(i));
      if (force[i] > 0) CHECK_NEAR(at, 1, 0);
      CHECK(at >= 0 && at <= 1);
    }
    CHECK_NEAR(w(w.begin() - 1) + w(w.end()), 0, 0);
  }
}

void offset_factors() {
  const double published[4][2] = {{0.060, 1.5802}, {0.080, 1.3850}, {0.100, 1.2875},
                                  {0.120, 1.2292}};
  for (const auto& [stick_out, factor] : published)
    CHECK_NEAR(hammer_offset_factor(0.015, stick_out).value(), factor, 1e-4);
  CHECK_NEAR(hammer_offset_factor(0, 0.1).value(), 1, 1e-15);
  for (const double offset : {0.1, 0.2, -0.01, std::nan("")})
    CHECK(!hammer_offset_factor(offset, 0.1) &&
          hammer_offset_factor(offset, 0.1).error().kind == ErrorKind::usage);
  CHECK(!hammer_offset_factor(0.01, 0));
}

void noise_free() {
  std::mt19937_64 random(1);
  for (const int derivative : {0, 1, 2}) {
    Bench b;
    b.derivative = derivative;
    b.force_offset_N = 3, b.response_offset = derivative == 0 ? 1e-6 : 0.1;
    const std::vector<ImpactRecord> records = {
        record(kTool, {{0.01, 400, 0.0005}}, b, random),
        record(kTool, {{0.012, 500, 0.0004}}, b, random)};
    for (const auto estimator : {FrfEstimator::h1, FrfEstimator::h2, FrfEstimator::hv}) {
      ImpactOptions options = of(derivative);
      options.estimator = estimator;
      const auto f = identify_impact(records, options);
      CHECK(f);
      if (!f) {
        std::cout << f.error().sentence << '\n';
        continue;
      }
      std::printf("  %d: from %g to %g Hz off %g, window %g averages %zu peak %g %g length %g\n",
                  derivative, f->usable_from_hz, f->usable_to_hz, off(*f, kTool),
                  f->response.exponential_window_per_s, f->averages, f->peak_hz, f->peak_m_per_N,
                  f->length_s);
      for (const auto& h : f->hits) if (!h.used) std::printf("   %g %s\n", h.t_s, h.reason.c_str());
      for (const auto& r : f->remarks) std::printf("    %s\n", r.c_str());
    }
  }
}


struct Drawn {
  std::vector<Mode> modes;
  std::vector<Hit> hits;
  Bench bench;
};

/// A tool, a bench and `count` sound hits of a trace each, as a shop has them.
Drawn drawn(std::mt19937_64& random) {
  const auto between = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  Drawn d;
  const int modes = 1 + static_cast<int>(random() % 4);
  for (int m = 0; m < modes; ++m)
    d.modes.push_back({between(300, 3000), between(0.015, 0.06), between(0.3, 20)});
  d.bench.rate_hz = random() % 2 ? 51200 : 25600;
  d.bench.duration_s = between(0.2, 0.6);
  d.bench.derivative = random() % 2 ? 2 : 0;
  const double noise = between(0.0005, 0.01), peak = between(50, 2000);
  d.bench.force_noise_N = noise * peak;
  d.bench.force_offset_N = between(-0.1, 0.1) * peak;
  d.hits = {{between(0.004, 0.03), peak, between(0.0003, 0.0012), random() % 2 == 0}};
  double highest = 0;
  for (double t = 0; t < 0.02; t += 2e-5)
    highest = std::max(highest, std::abs(response_to(d.modes, {0, peak, d.hits[0].width_s,
                                                               d.hits[0].raised}, t,
                                                     d.bench.derivative)));
  d.bench.response_noise = between(0.0005, 0.01) * highest;
  d.bench.response_offset = between(-0.2, 0.2) * highest;
  d.bench.response_drift_per_s = between(-0.1, 0.1) * highest;
  if (random() % 2) {
    d.bench.force_step_N = peak * between(1, 10) / 32768;
    d.bench.response_step = highest * between(1, 10) / 32768;
  }
  return d;
}

bool argc_dump = true;
void sweep(unsigned from, int count) {
  int good_lost = 0, doubles_missed = 0, cut_missed = 0, all = 0;
  for (unsigned seed = from; seed < from + static_cast<unsigned>(count); ++seed) {
    std::mt19937_64 random(seed);
    Drawn d = drawn(random);
    const auto between = [&](double a, double b) {
      return std::uniform_real_distribution<double>(a, b)(random);
    };
    const auto reason = [&](const std::vector<Hit>& hits, const Bench& b) {
      const std::vector<ImpactRecord> r = {record(d.modes, hits, b, random)};
      const auto f = identify_impact(r, of(b.derivative));
      if (!f) return f.error().sentence;
      return f->averages == 1 ? std::string() : f->hits[0].reason;
    };
    ++all;
    const std::string good = reason(d.hits, d.bench);
    if (!good.empty()) {
      ++good_lost;
      if (argc_dump) { std::ofstream o("/tmp/lost_" + std::to_string(seed) + ".csv"); std::mt19937_64 r2(seed); Drawn e = drawn(r2); auto r = record(e.modes, e.hits, e.bench, r2); for (std::size_t i = 0; i < r.force_N.size(); ++i) o << r.force_N[i] << ' ' << r.response[i] << '\n'; std::printf("steps %g noise %g der %d\n", e.bench.response_step, e.bench.response_noise, e.bench.derivative); for (auto& m : e.modes) std::printf("%g %g %g\n", m.hz, m.damping, m.kg);}
      std::printf("  seed %u lost: %s\n", seed, good.c_str());
    }
    Hit second = d.hits[0];
    second.at_s += second.width_s * between(1.1, 3) + between(0, 1) * between(0, 0.06);
    second.peak_N *= between(0.1, 0.9);
    second.width_s *= between(0.8, 1.3);
    const std::string twice = reason({d.hits[0], second}, d.bench);
    if (twice.find("double hit") == std::string::npos) {
      ++doubles_missed;
      std::printf("  seed %u double %g after %g ms width %g noise %g missed: %s\n", seed,
                  second.peak_N / d.hits[0].peak_N, 1e3 * (second.at_s - d.hits[0].at_s),
                  1e3 * d.hits[0].width_s, d.bench.force_noise_N / d.hits[0].peak_N, twice.c_str());
    }
    Bench narrow = d.bench;
    const bool force = random() % 2;
    double highest = 0;
    for (double t = 0; t < 0.02; t += 2e-5)
      highest = std::max(highest,
                         std::abs(response_to(d.modes, {0, d.hits[0].peak_N, d.hits[0].width_s,
                                                        d.hits[0].raised}, t, d.bench.derivative)));
    if (force) {
      narrow.force_offset_N = 0;
      narrow.force_range_N = between(0.5, 0.93) * d.hits[0].peak_N;
    } else {
      narrow.response_offset = 0;
      narrow.response_range = between(0.5, 0.9) * highest;
    }
    const std::string cut = reason(d.hits, narrow);
    if (cut.find("overload") == std::string::npos) {
      ++cut_missed;
      std::printf("  seed %u cut off %s missed: %s rate %g step %g of %g noise %g der %d lvl %g\n", seed, force ? "force" : "response",
                  cut.c_str(), d.bench.rate_hz, d.bench.response_step, highest, d.bench.response_noise/highest, d.bench.derivative, narrow.response_range/highest);
    }
  }
  std::printf("of %d: good lost %d, double missed %d, cut missed %d\n", all, good_lost,
              doubles_missed, cut_missed);
}

}  // namespace

int main(int argc, char** argv) {
  window();
  offset_factors();
  noise_free();
  sweep(argc > 1 ? static_cast<unsigned>(std::stoi(argv[1])) : 1, argc > 2 ? std::stoi(argv[2]) : 200);
  return check::done();
}
