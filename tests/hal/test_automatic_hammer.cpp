// The automatic hammer on benches that are not there: end mills of a profile of our own before a
// capacitive sensor that is curved, noisy and blind between the flutes, turned and moved by a
// controller that loses, cuts and delays.
#include <cmath>
#include <cstdio>
#include <memory>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/hal/automatic_hammer.hpp"
#include "servosense/hal/simulated_cnc.hpp"

using namespace servosense;

namespace {

constexpr int kHousing = 12, kSeen = 7;  // places on either side

struct Bench {
  unsigned teeth = 4;
  double radius_m = 6e-3, helix_rad = rad_from_deg(30), phase_rad = 1;
  double runout_m = 5e-6, runout_rad = 0;
  double gap_m = 0.4e-3;  // between flute and sensor at the start
  double sensitivity_V = 15, zero_gap_m = 0.25e-3, noise_V = 0.01;
  double width_m = 1.5e-3;  // of what the sensor sees; its housing is twice as wide
  double above_m = 0.015;
  SimulatedCncConfig cnc;
  unsigned seed = 1;
};

// Behind the edge a land with a relief of 8 degrees over a quarter of the pitch, a heel over a
// tenth, a gullet as deep as a quarter of the radius, and the rake face, which rises over 0.1 mm.
double below_circle_m(const Bench& b, double angle_rad, double up_m) {
  const double pitch = kTwoPi / b.teeth;
  double behind =
      std::fmod(angle_rad - b.phase_rad - up_m * std::tan(b.helix_rad) / b.radius_m, pitch);
  if (behind < 0) behind += pitch;
  const double land = 0.25 * pitch, heel = 0.1 * pitch, rake = 0.1e-3 / b.radius_m;
  const double relief = b.radius_m * std::tan(rad_from_deg(8)) * std::min(behind, land);
  const double gullet = 0.25 * b.radius_m * std::clamp((behind - land) / heel, 0.0, 1.0);
  return (relief + gullet) * std::clamp((pitch - behind) / rake, 0.0, 1.0);
}

class Sensor final : public DistanceSensor {
 public:
  Sensor(const Bench& bench, SimulatedCnc& cnc) : bench_(bench), cnc_(cnc), random_(bench.seed) {}

  Expected<DistanceReading> read() override {
    const CncStatus now = cnc_.true_status();
    if (now.moving) moved_while_read = true;
    ++reads;
    if (fails_after != 0 && reads > fails_after)
      return device_error("the converter does not answer");
    if (nan_after != 0 && reads > nan_after) return DistanceReading{std::nan(""), 0.01};
    std::normal_distribution<double> noise(0, bench_.noise_V);
    return DistanceReading{
        std::clamp(volts(cnc_.truth().spindle_angle_rad, now.position_m) + noise(random_), -10.0,
                   10.0),
        bench_.noise_V};
  }
  /// Without noise; the least gap before the housing is kept.
  double volts(double spindle_rad, const std::array<double, kAxes>& at_m) {
    // The housing, then what is seen: a disc.
    for (int i = -kHousing; i <= kHousing; ++i)
      least_gap_m = std::min(
          least_gap_m, this->gap(spindle_rad, bench_.width_m * i / kHousing, -at_m[2], at_m[0]));
    double sum = 0, all = 0;
    for (int iy = -kSeen; iy <= kSeen; ++iy)
      for (int iz = -kSeen; iz <= kSeen; ++iz) {
        if (iy * iy + iz * iz > kSeen * kSeen) continue;
        const double gap = this->gap(spindle_rad, bench_.width_m / 2 * iy / kSeen,
                                     -at_m[2] + bench_.width_m / 2 * iz / kSeen, at_m[0]);
        sum += bench_.zero_gap_m / std::max(gap, 1e-6);
        ++all;
      }
    return blind ? -10 : std::clamp(sign * bench_.sensitivity_V * (sum / all - 1), -10.0, 10.0);
  }
  double gap(double spindle_rad, double y, double up, double x) const {
    // The ray at y meets the tool where its own radius puts it: one step of the fixed point is
    // enough here.
    const double aside = std::asin(y / bench_.radius_m);
    const double radius =
        round ? bench_.radius_m
              : bench_.radius_m - below_circle_m(bench_, spindle_rad + aside, up) +
                    bench_.runout_m * std::cos(spindle_rad + aside - bench_.runout_rad);
    const double depth = std::abs(y) < radius ? std::sqrt(radius * radius - y * y) : 0;
    return bench_.gap_m + bench_.radius_m - x - depth;
  }

  double least_gap_m = 1;
  bool moved_while_read = false, blind = false, round = false;
  double sign = 1;
  unsigned reads = 0, fails_after = 0, nan_after = 0;

 private:
  const Bench& bench_;
  SimulatedCnc& cnc_;
  std::mt19937 random_;
};

AutomaticHammerConfig config_for(const Bench& b) {
  AutomaticHammerConfig c;
  c.teeth = b.teeth;
  c.tool_radius_m = b.radius_m;
  c.sensor_width_m = 2 * b.width_m;
  c.hammer_above_sensor_m = b.above_m;
  c.zero_gap_m = b.zero_gap_m;
  c.longest_approach_m = 5e-3;
  return c;
}

// Angle at which the sensor, `up_m` above the tool's end, sees the most, nearest to `from_rad`
// modulo the pitch.
double off_rad(const Bench& b, double found_rad, double up_m) {
  Bench plain = b;
  plain.runout_m = 0;
  SimulatedCnc still;
  Sensor sensor(plain, still);
  const double pitch = kTwoPi / b.teeth;
  double best = 0, most = -100;
  const int places = 600;
  for (int i = 0; i < places; ++i) {
    const double angle = pitch * i / places;
    const double v = sensor.volts(angle, {0, 0, -up_m});
    if (v > most) {
      most = v;
      best = angle;
    }
  }
  return std::remainder(found_rad - best, pitch);
}

// Whether the sensor can stand at its zero where the flute is hit, with half of the gap left beside
// it.
bool possible(const Bench& b, double hit_rad) {
  SimulatedCnc still;
  Sensor sensor(b, still);
  for (double x = 0; x < 5e-3; x += 10e-6) {
    sensor.least_gap_m = 1;
    if (sensor.volts(hit_rad, {x, 0, 0}) >= 0) return sensor.least_gap_m >= b.zero_gap_m / 2;
  }
  return false;
}

struct Outcome {
  bool right = false, zeroed = false, refused = false, contact = false, possible = true;
  double off_end = 0, off_hit = 0, slope_off = 0;
  unsigned probes = 0;
  std::string said;
};

Outcome run(const Bench& b) {
  Outcome out;
  SimulatedCnc cnc(b.cnc);
  CncChannel channel(cnc);
  Sensor sensor(b, cnc);
  AutomaticHammer hammer(channel, sensor, config_for(b));
  const auto opened = channel.open();
  const auto flute = opened ? hammer.find_flute() : Expected<FluteFound>(opened.error());
  const auto zero = flute ? hammer.zero_sensor(*flute) : Expected<SensorZeroed>(flute.error());
  out.contact = sensor.least_gap_m <= 0;
  if (flute) out.possible = possible(b, flute->hit_rad);
  if (!zero) {
    out.refused = true;
    out.said = zero.error().sentence;
    return out;
  }
  out.probes = flute->probes;
  out.off_end = std::abs(off_rad(b, flute->at_end_rad, 0));
  out.off_hit = std::abs(off_rad(b, flute->hit_rad, b.above_m));
  const auto at = cnc.true_status().position_m;
  const double volts = sensor.volts(flute->hit_rad, at);
  const double side = 1e-6;
  const double slope = (sensor.volts(flute->hit_rad, {at[0] + side, at[1], at[2]}) -
                        sensor.volts(flute->hit_rad, {at[0] - side, at[1], at[2]})) /
                       (2 * side);
  out.slope_off = zero->volts_per_m / slope - 1;
  out.zeroed = std::abs(volts) <= 0.1 + 6 * b.noise_V;
  out.right = out.off_end <= rad_from_deg(1.5) && out.off_hit <= rad_from_deg(4.5) &&
              (out.zeroed || (zero->land_in_the_way && std::abs(volts) < 9.5)) &&
              std::abs(out.slope_off) < 0.03 + 6 * zero->volts_per_m_standard_error / slope;
  if (!out.right) {
    char text[200];
    std::snprintf(text, sizeof text, "end %.2f deg, hit %.2f deg, %.2f V, slope %.3f",
                  (out.off_end * 180 / kPi), (out.off_hit * 180 / kPi), volts, out.slope_off);
    out.said = text;
  }
  return out;
}

Bench drawn(unsigned seed) {
  std::mt19937 random(seed);
  const auto between = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  Bench b;
  b.seed = seed;
  b.teeth = 2 + static_cast<unsigned>(random() % 5);
  b.radius_m = between(4e-3, 10e-3);
  b.helix_rad = rad_from_deg(between(0, 45));
  b.phase_rad = between(0, kTwoPi);
  b.runout_m = between(0, 15e-6);
  b.runout_rad = between(0, kTwoPi);
  b.zero_gap_m = between(0.2e-3, 0.3e-3);
  b.gap_m = b.zero_gap_m * between(1.1, 1.3);
  b.sensitivity_V = between(8, 14);
  b.noise_V = std::exp(between(std::log(0.002), std::log(0.03)));
  b.width_m = between(0.3e-3, 1.0e-3);
  b.above_m = between(0.012, 0.018);
  b.cnc.seed = seed;
  if (seed % 2 == 0) {
    b.cnc.lost_request = b.cnc.lost_reply = 0.05;
    b.cnc.in_part = 0.3;
    b.cnc.busy = 0.2;
    b.cnc.refused_connections = 3;
  }
  return b;
}

void benches(unsigned first, unsigned count) {
  unsigned right = 0, zeroed = 0, refused = 0, contact = 0, wrong = 0, may = 0, done = 0;
  unsigned most_probes = 0;
  double most_end = 0, most_hit = 0;
  for (unsigned seed = first; seed < first + count; ++seed) {
    const Outcome o = run(drawn(seed));
    right += o.right;
    zeroed += o.right && o.zeroed;
    refused += o.refused;
    may += o.possible;
    done += o.possible && o.right;
    contact += o.contact;
    wrong += !o.right && !o.refused;
    most_probes = std::max(most_probes, o.probes);
    most_end = std::max(most_end, o.off_end);
    most_hit = std::max(most_hit, o.off_hit);
    if (!o.right && !o.refused) std::printf("  seed %u: %s\n", seed, o.said.c_str());
  }
  std::printf(
      "%u benches, in %u the sensor finds room: %u right; of all %u right (%u at the zero), %u "
      "refused, %u wrong, %u contacts; at most %.2f deg at the end, %.2f "
      "where it is hit, %u orientations\n",
      count, may, done, right, zeroed, refused, wrong, contact, (most_end * 180 / kPi),
      (most_hit * 180 / kPi), most_probes);
  CHECK(contact == 0);
  CHECK(wrong == 0);
  CHECK(10 * done >= 8 * may);
  CHECK(most_end < rad_from_deg(1.5));
  CHECK(most_hit < rad_from_deg(4.5));
  CHECK(most_probes <= 2 * (16 + 2 + 16));
}

template <typename T>
bool fails(const Expected<T>& done, const std::string& part) {
  if (!done && done.error().sentence.find(part) != std::string::npos) return true;
  std::printf("  instead of '%s': %s\n", part.c_str(),
              done ? "done" : done.error().sentence.c_str());
  return false;
}

// A rig of its own for each thing that is not as it should be.
struct Rig {
  explicit Rig(Bench bench = {}) : b(bench), cnc(b.cnc), channel(cnc), sensor(b, cnc) {
    CHECK(channel.open());
  }
  AutomaticHammer hammer() { return {channel, sensor, config_for(b)}; }
  Bench b;
  SimulatedCnc cnc;
  CncChannel channel;
  Sensor sensor;
};

void what_is_wrong_is_said() {
  {
    Rig rig;
    rig.sensor.blind = true;
    CHECK(fails(rig.hammer().find_flute(), "sees no flute at the tool's end: at no angle"));
  }
  {
    Rig rig;
    rig.sensor.round = true;
    rig.b.runout_m = 0;
    CHECK(fails(rig.hammer().find_flute(), "as near at every angle"));
  }
  {
    Bench near;
    near.gap_m = 0.06e-3;
    near.sensitivity_V = 40;
    Rig rig(near);
    CHECK(fails(rig.hammer().find_flute(), "too near"));
    CHECK(rig.sensor.least_gap_m > 0);
  }
  for (const unsigned after : {1u, 10u, 25u, 40u}) {
    Rig rig;
    rig.sensor.nan_after = after;
    CHECK(fails(rig.hammer().find_flute(), "gives no number") || after == 40);
    Rig other;
    other.sensor.fails_after = after;
    CHECK(fails(other.hammer().find_flute(), "does not answer") || after == 40);
    other.cnc.wait(1);
    CHECK_NEAR(other.cnc.true_status().position_m[2], 0, 1e-8);  // back at the height it began at
  }
  {
    Rig rig;
    AutomaticHammer hammer = rig.hammer();
    const auto flute = hammer.find_flute();
    CHECK(flute);
    if (!flute) return;
    rig.sensor.sign = -1;
    CHECK(fails(hammer.zero_sensor(*flute), "+x towards the sensor"));
    CHECK(rig.sensor.least_gap_m > 0);
    rig.sensor.sign = 1;
    rig.sensor.blind = true;
    CHECK(fails(hammer.zero_sensor(*flute), "is there a tool before it"));
    CHECK(rig.cnc.truth().path_m < 0.05);
    rig.cnc.wait(1);
    CHECK_NEAR(rig.cnc.true_status().position_m[0], -50e-6,
               1e-7);  // of the first try, away from the sensor
    rig.sensor.blind = false;
    CHECK(hammer.zero_sensor(*flute));
    // It stands at zero already.
    const auto again = hammer.zero_sensor(*flute);
    CHECK(again && again->volts_per_m > 0);
    rig.cnc.press_reset();
    CHECK(fails(hammer.zero_sensor(*flute), "reset or taken over"));
  }
  {
    Rig rig;
    rig.cnc.press_hold(true);
    CHECK(fails(rig.hammer().find_flute(), "the feed is held"));
  }
  AutomaticHammerConfig c = config_for({});
  Rig rig;
  const auto refused = [&](const char* part) {
    CHECK(fails(AutomaticHammer(rig.channel, rig.sensor, c).find_flute(), part));
    c = config_for({});
  };
  c.teeth = 0;
  refused("teeth");
  c.longest_step_m = 0.2e-3;
  refused("half of the gap");
  c.tool_radius_m = 0;
  refused("radius");
  c.inserted = true;
  refused("behind the insert");
  c.inserted = true;
  c.behind_edge_rad = rad_from_deg(20);
  const auto insert = AutomaticHammer(rig.channel, rig.sensor, c).find_flute();
  CHECK(insert);
  if (insert)
    CHECK_NEAR(std::remainder(insert->hit_rad - insert->at_end_rad - rad_from_deg(20), kTwoPi), 0,
               1e-9);
}

}  // namespace

int main(int argc, char** argv) {
  what_is_wrong_is_said();
  if (check::nightly(argc, argv))
    benches(20000, 1000);
  else
    benches(1, 60);
  return check::done();
}
