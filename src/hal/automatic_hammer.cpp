#include "servosense/hal/automatic_hammer.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace servosense {
namespace {

constexpr double kOutlying =
    6;  // standard errors: a thousand benches of 100 readings see none by chance
constexpr double kGoldenPart = 0.381966;  // of the larger side
constexpr unsigned kNarrowings = 16;      // of a quarter turn leave 0.04 deg
constexpr double kFirstStep_m =
    50e-6;  // Dunwoody 4.2; at most half of longest_step_m, which the first may be blind
constexpr int kSlopeReadings = 16;  // averaged: the receptance has the error of the slope
constexpr double kSlopeSides_m[] = {25e-6, 50e-6};
constexpr double kGoneOfGap =
    0.25;  // the rest is for relief and run-out, which the zero does not know
constexpr unsigned kPlacesOfLand = 16;  // at which it is looked at
constexpr double kLeastStep_m = 1e-6;   // an axis goes no less
constexpr double kHalf = 0.5;  // of what is left: the sensor grows more sensitive as it comes near

double turned(double angle_rad) {
  const double rest = std::fmod(angle_rad, kTwoPi);
  return rest < 0 ? rest + kTwoPi : rest;
}

std::string text(const char* format, double a, double b) {
  char out[240];
  std::snprintf(out, sizeof out, format, a, b);
  return out;
}

}  // namespace

AutomaticHammer::AutomaticHammer(CncChannel& cnc, DistanceSensor& sensor,
                                 const AutomaticHammerConfig& config)
    : cnc_(cnc), sensor_(sensor), config_(config) {}

Expected<Done> AutomaticHammer::checked() const {
  const AutomaticHammerConfig& c = config_;
  if (c.teeth < 1 || c.teeth > 32) return usage_error("an automatic hammer needs 1 to 32 teeth");
  if (!(c.hammer_above_sensor_m > 0 && c.hammer_above_sensor_m < 0.1))
    return usage_error("the hammer's tip is above the sensor, by less than 0.1 m");
  if (c.scanned < 6 || c.scanned > 64) return usage_error("a pitch is scanned at 6 to 64 places");
  if (!(c.angle_tolerance_rad > 0)) return usage_error("the tolerance of an angle is positive");
  if (!(c.longest_step_m > 0 && c.longest_step_m <= c.zero_gap_m / 2))
    return usage_error("a step towards the sensor is at most half of the gap at its zero");
  if (!(c.zero_tolerance_V > 0 && c.zero_tolerance_V < c.greatest_volts))
    return usage_error("the tolerance of the zero is positive and within the sensor's range");
  if (!(c.tool_radius_m > 0 && c.sensor_width_m > 0))
    return usage_error("an automatic hammer needs the tool's radius and the width of the sensor");
  if (c.inserted && c.behind_edge_rad == 0)
    return usage_error(
        "an inserted cutter is hit behind the insert: say how far (behind_edge_rad)");
  return Done{};
}

Expected<DistanceReading> AutomaticHammer::read() {
  auto reading = sensor_.read();
  if (reading && !(std::isfinite(reading->volts) && reading->standard_error >= 0 &&
                   std::isfinite(reading->standard_error)))
    return device_error("the distance sensor gives no number; check its amplifier and cable");
  return reading;
}

Expected<DistanceReading> AutomaticHammer::read_at(double angle_rad) {
  ++probes_;
  if (auto done = cnc_.orient_spindle(angle_rad); !done) return done.error();
  return read();
}

// Where within a pitch from `from_rad` the tool is nearest to the sensor.
Expected<double> AutomaticHammer::nearest(double from_rad, const char* where) {
  const double step = kTwoPi / config_.teeth / config_.scanned;
  // The neighbours of the first and the last place too.
  std::vector<DistanceReading> seen(config_.scanned + 2);
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const auto reading = read_at(from_rad + (static_cast<double>(i) - 1) * step);
    if (!reading) return reading.error();
    if (reading->volts >= config_.greatest_volts)
      return device_error(
          text("the distance sensor reads %.2f V: the tool is too near; draw it back",
               reading->volts, 0));
    seen[i] = *reading;
  }
  const auto less = [](const DistanceReading& a, const DistanceReading& b) {
    return a.volts < b.volts;
  };
  const auto best = std::max_element(seen.begin() + 1, seen.end() - 1, less);
  const auto lowest = std::min_element(seen.begin(), seen.end(), less);
  if (best->volts <= -config_.greatest_volts)
    return device_error(std::string("the distance sensor sees no flute ") + where +
                        ": at no angle is the tool within its range; bring it nearer");
  if (best->volts - lowest->volts <=
      kOutlying * std::hypot(best->standard_error, lowest->standard_error))
    return device_error(std::string("the distance sensor sees no flute ") + where +
                        ": the tool is as near at every angle; check its height");
  const double at = from_rad + (static_cast<double>(best - seen.begin()) - 1) * step;
  double low = at - step, middle = at, high = at + step;
  DistanceReading there = *best;
  for (unsigned n = 0; n < kNarrowings && high - low > config_.angle_tolerance_rad; ++n) {
    const bool below = middle - low > high - middle;
    const double trial =
        below ? middle - kGoldenPart * (middle - low) : middle + kGoldenPart * (high - middle);
    const auto reading = read_at(trial);
    if (!reading) return reading.error();
    if (reading->volts >= there.volts) {
      (below ? high : low) = middle;
      middle = trial;
      there = *reading;
    } else {
      (below ? low : high) = trial;
    }
  }
  return middle;
}

Expected<Done> AutomaticHammer::move(Channel axis, double distance_m) {
  if (auto done = cnc_.jog(axis, distance_m, config_.feed_m_s); !done) return done;
  return cnc_.wait_until_there();
}

Expected<FluteFound> AutomaticHammer::find_flute() {
  if (auto done = checked(); !done) return done.error();
  probes_ = 0;
  FluteFound found;
  const auto at_end = nearest(0, "at the tool's end");
  if (!at_end) return at_end.error();
  double hit = *at_end, at_sensor = *at_end;
  if (!config_.inserted) {
    const double rise_m = config_.hammer_above_sensor_m / 2;
    if (auto done = move(Channel::z, -rise_m); !done) return done.error();
    const auto half_way = nearest(*at_end, "half way to the hammer");
    if (auto done = move(Channel::z, rise_m); !done) return done.error();
    if (!half_way) return half_way.error();
    at_sensor = *half_way;
    hit = 2 * at_sensor - hit;
  }
  found.hit_rad = turned(hit + config_.behind_edge_rad);
  found.at_sensor_rad = turned(at_sensor);
  found.at_end_rad = turned(*at_end);
  found.probes = probes_;
  return found;
}

// Halves what is left by the slope between the last two readings, for the sensor is more sensitive
// when near. From where the tool stands, `limit_m` towards the sensor at most, and `blind_m`
// without seeing that it moves.
Expected<Done> AutomaticHammer::approach(double limit_m, double blind_m, SensorZeroed& out) {
  const auto may_see = [&](const DistanceReading& r) {
    return std::abs(r.volts) < config_.greatest_volts;
  };
  const double from_m = moved_m_;
  std::optional<DistanceReading> before;  // with which the next is compared...
  double since_m = 0, slope = 0;          // ...and the way since then
  double last_m = 0, longest_m = config_.longest_step_m;
  for (;; ++out.steps) {
    const auto now = read();
    if (!now) return now.error();
    out.volts = now->volts;
    if (before && may_see(*before) && may_see(*now)) {
      const double changed = now->volts - before->volts;
      const bool seen =
          std::abs(changed) > kOutlying * std::hypot(now->standard_error, before->standard_error);
      if (seen) slope = changed / since_m;
      if (slope < 0)
        return device_error(
            "the distance sensor reads less when the tool moves along +x; is +x towards the "
            "sensor?");
      if (!seen && std::abs(since_m) >= blind_m)
        return device_error(
            "the distance sensor does not react to a move of the tool; check sensor, axis and "
            "height");
      if (seen) before.reset();
    }
    if (!before || !may_see(*before)) {
      before = *now;
      since_m = 0;
    }
    if (std::abs(now->volts) <= config_.zero_tolerance_V) return Done{};
    if (out.steps >= config_.steps)
      return device_error(
          text("the distance sensor still reads %.2f V after %.0f steps; set its zero by hand",
               now->volts, out.steps));
    double step_m = slope > 0 && may_see(*now) ? -kHalf * now->volts / slope
                    : may_see(*now)            ? -std::copysign(kFirstStep_m, now->volts)
                                               : -std::copysign(config_.longest_step_m, now->volts);
    if (step_m * last_m < 0) longest_m = std::abs(last_m) / 2;  // the zero lies between
    step_m = std::clamp(step_m, -longest_m, longest_m);
    if (moved_m_ + step_m - from_m > limit_m) {
      step_m = limit_m - (moved_m_ - from_m);
      if (step_m < kLeastStep_m) {
        out.land_in_the_way = true;
        return Done{};
      }
    }
    if (std::abs(moved_m_ + step_m - from_m) > config_.longest_approach_m)
      return device_error(text(
          "the distance sensor reads %.2f V after a way of %.1f mm; is there a tool before it?",
          now->volts, 1000 * std::abs(moved_m_ - from_m)));
    if (auto done = move(Channel::x, step_m); !done) return done;
    moved_m_ += step_m;
    since_m += step_m;
    last_m = step_m;
  }
}

// Of two readings on either side of where the tool stands, which then stands there again, and of
// two that are farther away: what differs between the two slopes grows with the square of the way
// and is taken out (Richardson).
Expected<Done> AutomaticHammer::measure_slope(SensorZeroed& out) {
  double slope[2] = {}, error[2] = {};
  for (std::size_t n = 0; n < 2; ++n) {
    const double side_m = kSlopeSides_m[n];
    DistanceReading seen[2];
    const double ways_m[] = {-side_m, 2 * side_m, -side_m};
    for (std::size_t i = 0; i < 3; ++i) {
      if (auto done = move(Channel::x, ways_m[i]); !done) return done;
      moved_m_ += ways_m[i];
      if (i == 2) break;
      for (int k = 0; k < kSlopeReadings; ++k) {
        const auto reading = read();
        if (!reading) return reading.error();
        seen[i].volts += reading->volts / kSlopeReadings;
        seen[i].standard_error =
            std::hypot(seen[i].standard_error, reading->standard_error / kSlopeReadings);
      }
    }
    const double most = std::max(std::abs(seen[0].volts), std::abs(seen[1].volts));
    slope[n] = (seen[1].volts - seen[0].volts) / (2 * side_m);
    error[n] = std::hypot(seen[1].standard_error, seen[0].standard_error) / (2 * side_m);
    if (!(most < config_.greatest_volts) || !(slope[n] > kOutlying * error[n]))
      return device_error(
          text("the distance sensor reads %.2f V where the hammer meets the tool and hardly reacts "
               "to its moves: "
               "it faces a gullet that it may not go into; hit at another height",
               seen[0].volts, 0));
  }
  const double near = kSlopeSides_m[0] * kSlopeSides_m[0],
               far = kSlopeSides_m[1] * kSlopeSides_m[1];
  out.volts_per_m = (far * slope[0] - near * slope[1]) / (far - near);
  out.volts_per_m_standard_error = std::hypot(far * error[0], near * error[1]) / (far - near);
  return Done{};
}

// How far the tool, its flute at the zero of the sensor and turned then to where it is hit, may go
// on.
double AutomaticHammer::clear_way_m(const FluteFound& flute) const {
  const double pitch = kTwoPi / config_.teeth;
  // The nearest place, as the sensor sees it, lies behind the edge, by half of what it sees at
  // most.
  const double before = config_.sensor_width_m / 2 / config_.tool_radius_m;
  double way_m = std::numeric_limits<double>::infinity();
  for (unsigned k = 0; k < config_.teeth * kPlacesOfLand; ++k) {
    const unsigned tooth = k / kPlacesOfLand;
    const double place = static_cast<double>(k % kPlacesOfLand) / (kPlacesOfLand - 1);
    const double behind = -before + place * (before + config_.land_share * pitch);
    const double aside = flute.at_end_rad + behind + pitch * tooth - flute.hit_rad;
    const double toward_m = config_.tool_radius_m * std::cos(aside);
    if (toward_m > 0 && std::abs(config_.tool_radius_m * std::sin(aside)) <=
                            config_.sensor_width_m / 2 + config_.zero_gap_m)
      way_m = std::min(way_m, kGoneOfGap * config_.zero_gap_m + config_.tool_radius_m - toward_m);
  }
  return way_m;
}

Expected<SensorZeroed> AutomaticHammer::zero_sensor(const FluteFound& flute) {
  if (auto done = checked(); !done) return done.error();
  moved_m_ = 0;
  SensorZeroed out;
  const auto all = [&]() -> Expected<Done> {
    if (auto done = cnc_.orient_spindle(flute.at_end_rad); !done) return done;
    if (auto done = approach(std::numeric_limits<double>::infinity(), config_.longest_step_m, out);
        !done)
      return done;
    if (auto done = cnc_.orient_spindle(flute.hit_rad); !done) return done;
    if (auto done = approach(clear_way_m(flute), config_.longest_approach_m, out); !done)
      return done;
    return measure_slope(out);
  };
  if (auto done = all(); !done) {
    if (moved_m_ > 0)
      if (auto back = move(Channel::x, -moved_m_); !back)
        return device_error(done.error().sentence +
                            "; and the tool could not be drawn back: " + back.error().sentence);
    return done.error();
  }
  out.moved_m = moved_m_;
  return out;
}

}  // namespace servosense
