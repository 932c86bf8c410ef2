// A load behind backlash, as the workflow drives it along a record, against the same load along the
// motion itself, with and without a force that pulls at the stage.
//
// The oracle: a sine in closed form, the load at 2 us steps of it with an event at each impact, the
// second derivative of its distance filtered there by the same Gaussian, written out as a plain
// sum. The workflow sees the motion at 1 kHz in steps of an encoder.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "check.hpp"
#include "counted_motion.hpp"
#include "reconcile/drive/backlash_response.hpp"
#include "servosense/core/units.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kPeriod_s = 1e-3, kFine_s = 2e-6, kLength_s = 1.2;
constexpr double kCount_m = 5e-8, kCorner_hz = 40, kMass_kg = 100, kCoulomb_N = 80;
constexpr double kRate = kTwoPi * 3.9, kAmplitude_m = 2e-3;  // 1.2 m/s2 at the reversals
constexpr BacklashLoad kBacklash{40e-6, 0.5, 0.4};

double position(double t) { return kAmplitude_m * std::sin(kRate * t); }
double velocity(double t) { return kAmplitude_m * kRate * std::cos(kRate * t); }
double acceleration(double t) { return -kRate * kRate * position(t); }
double sign(double v) { return v > 0 ? 1 : v < 0 ? -1 : 0; }

struct Load {
  Column distance, friction;  // motor less load; what its friction does otherwise than the motor's
};

/// `pull(x)`: force at the stage over the mass of the load.
template <typename Pull>
Load along_the_motion(Pull pull) {
  Load load;
  const double slide = kBacklash.ratio * kCoulomb_N / kMass_kg;
  double d = kBacklash.width / 2, v = velocity(0);
  bool flies = false;
  for (double t = 0; t < kLength_s; t += kFine_s) {
    const double motor = velocity(t);
    const double force = acceleration(t) + slide * sign(motor) + pull(position(t));
    if (!flies) flies = force * d < 0;
    if (flies) {
      d += kFine_s * (motor - v);
      v -= kFine_s * (slide * sign(v) + pull(position(t)));
      if (std::abs(d) >= kBacklash.width / 2) {
        d = std::copysign(kBacklash.width / 2, d);
        flies = (motor - v) * d <= 0;
      }
    }
    if (!flies) v = motor;
    load.distance.push_back(d);
    load.friction.push_back(kBacklash.ratio * kCoulomb_N * (sign(v) - sign(motor)));
  }
  return load;
}

/// Rms of what the oracle asks for, and of `rows` less that, away from both ends.
struct Compared {
  double wanted = 0, error = 0;
};
Compared compare(const DriveSignals& signals, const Column& rows, const Load& load) {
  const double half = 0.13253;  // corner times standard deviation of the Gaussian
  const double sigma = half / signals.corner_hz;
  Compared c;
  double n = 0;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const double t = static_cast<double>(r) * signals.row_period_s();
    if (t < 0.2 || t > kLength_s - 0.2) continue;
    double sum = 0, weight = 0;
    for (double at = t - 5 * sigma; at < t + 5 * sigma; at += 20 * kFine_s) {
      const double u = (at - t) / sigma;
      const double w = std::exp(-0.5 * u * u);
      const auto i = static_cast<std::size_t>(std::lround(at / kFine_s));
      sum += w * (load.friction[i] - kMass_kg * (u * u - 1) / (sigma * sigma) * load.distance[i]);
      weight += w;
    }
    const double wanted = sum / weight;
    c.wanted += wanted * wanted;
    c.error += (rows[r] - wanted) * (rows[r] - wanted);
    n += 1;
  }
  return {std::sqrt(c.wanted / n), std::sqrt(c.error / n)};
}

}  // namespace

int main() {
  const DriveData data = counted_motion(position, kLength_s, kPeriod_s, kCount_m);
  const DriveSignals signals(data, kCorner_hz);
  const double mass = kBacklash.share * kMass_kg;
  const auto check = [&](const char* what, const DriveModelConfig& drive, auto pull) {
    const Load load = along_the_motion(pull);
    const Compared with = compare(
        signals, response_of_backlash(signals, drive, kBacklash, loads_of(signals, drive)), load);
    const Compared without =
        compare(signals, response_of_backlash(signals, drive, kBacklash, {}), load);
    std::printf("  %-14s %.2f N, off by %.2f, without the load %.2f\n", what, with.wanted,
                with.error, without.error);
    // Steps of 1.6 ms. A spring lets the load leave its flank slowly, at any instant of one: 24 %
    // there, else 2 %.
    CHECK(with.error < 0.3 * with.wanted);
    return without.error / with.wanted;
  };
  CHECK(check("no load", data.model, [](double) { return 0.0; }) < 0.1);

  DriveModelConfig hanging = data.model;
  hanging.constant_load = 20;
  CHECK(check("constant load", hanging, [&](double) { return 20 / mass; }) > 0.3);

  DriveModelConfig sprung = data.model;
  EffectSetting spring;
  spring.effect = drive_effect_index("spring-load");
  spring.parameters[0] = {{10e3}, 1};
  spring.parameters[1] = {{0.5e-3}, 1};
  sprung.effects.settings[sprung.effects.count++] = spring;
  CHECK(check("spring", sprung, [&](double x) { return 10e3 * (x - 0.5e-3) / mass; }) > 0.3);

  // A load that hangs heavier than it is thrown never leaves its flank.
  DriveModelConfig heavy = data.model;
  heavy.constant_load = 200;
  double most = 0;
  const Column column = response_of_backlash(signals, heavy, kBacklash, loads_of(signals, heavy));
  for (std::size_t r = column.size() / 4; r < 3 * column.size() / 4; ++r)
    most = std::max(most, std::abs(column[r]));
  std::printf("  heavy load     at most %.2g N\n", most);
  CHECK(most < 1e-6);
  return check::done();
}
