// Chatter in the signal of an accelerometer or a microphone: false alarms against the law of the
// noise beside a line, whatever its colour and unit; a line against the truth; what must not be
// taken for one.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/monitors/event_text.hpp"
#include "servosense/monitors/sensor_chatter.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod_s = 125e-6;

SensorChatterConfig config_of() {
  SensorChatterConfig c = sensor_chatter_defaults(Channel::accelerometer, kPeriod_s);
  c.chatter.teeth = 4;
  return c;
}

/// A spindle at a speed, and what a sensor hears of the time and the angle.
struct Run {
  double rpm = 3137, seconds = 2;
  std::function<double(double, double)> value;  // of time [s] and angle [rad]
  std::function<void(std::size_t)> before = [](std::size_t) {};

  struct Heard {
    std::vector<double> scores;
    double alarm_s = -1, frequency_hz = 0, error_hz = 0, last = 0;
    std::size_t alarms = 0;
    std::uint64_t transforms = 0;
  };
  template <typename Real>
  Heard through(SensorChatter<Real>& ear, Quality quality = Quality::good) const {
    Heard heard;
    const double step = rad_s_from_rpm(rpm) * kPeriod_s;
    double angle = 0;
    std::uint64_t transforms = ear.chatter().state().transforms;
    bool on = false;
    for (std::size_t i = 0; static_cast<double>(i) * kPeriod_s < seconds; ++i) {
      before(i);
      angle += step;
      const double turn = angle - kTwoPi * std::floor(angle / kTwoPi);
      const double t = static_cast<double>(i) * kPeriod_s;
      const MonitorState state =
          ear.hear(static_cast<Real>(value(t, angle)), static_cast<Real>(turn),
                   static_cast<Real>(step), quality);
      const auto& s = ear.chatter().state();
      if (s.transforms != transforms) {
        transforms = s.transforms;
        heard.scores.push_back(static_cast<double>(s.line));
      }
      const bool alarm = state == MonitorState::alarm;
      if (alarm && !on) {
        ++heard.alarms;
        heard.alarm_s = t;
        heard.frequency_hz = static_cast<double>(ear.chatter().lines().state().found.frequency_hz);
        heard.error_hz = static_cast<double>(ear.chatter().lines().state().found.error_hz);
      }
      on = alarm;
    }
    heard.transforms = transforms;
    return heard;
  }
};

/// Gaussian noise of three colours.
struct Noise {
  std::mt19937_64 bits;
  std::normal_distribution<double> gauss;
  double pole = 0, low = 0;           // a low-pass of one pole
  double a = 0, b = 0, x = 0, y = 0;  // an oscillator
  explicit Noise(std::uint64_t seed) : bits(seed) {}
  static Noise brown(std::uint64_t seed) {
    Noise n(seed);
    n.pole = 0.95;
    return n;
  }
  static Noise ringing(std::uint64_t seed, double hz, double damping) {
    Noise n(seed);
    const double w = kTwoPi * hz * kPeriod_s, r = std::exp(-damping * w);
    n.a = 2 * r * std::cos(w);
    n.b = -r * r;
    return n;
  }
  double next() {
    const double white = gauss(bits);
    low = pole * low + white;
    const double now = a * x + b * y + low;
    y = x;
    return x = now;
  }
};

/// The law of a score, as the threshold counts with it, is passed by no more transforms.
template <typename Real>
void false_alarms() {
  struct Colour {
    const char* name;
    Noise noise;
    bool follows_law;
  };
  for (Colour colour : {Colour{"white", Noise(7), true}, Colour{"brown", Noise::brown(8), false},
                        Colour{"ringing, damping 3 %", Noise::ringing(9, 700, 0.03), false}}) {
    auto ear = std::make_unique<SensorChatter<Real>>();
    ear->configure(config_of());
    Run run;
    run.seconds = 150;
    run.value = [&](double, double) { return colour.noise.next(); };
    const Run::Heard heard = run.through(*ear);
    CHECK(heard.alarms == 0);
    const auto transforms = static_cast<double>(heard.scores.size());
    CHECK(transforms > 3000);
    double highest_held = 0;
    for (std::size_t i = 4; i < heard.scores.size(); ++i)
      highest_held =
          std::max(highest_held,
                   *std::min_element(heard.scores.begin() + static_cast<std::ptrdiff_t>(i - 4),
                                     heard.scores.begin() + static_cast<std::ptrdiff_t>(i + 1)));
    check::figure(colour.name, highest_held, "highest score held");
    CHECK(highest_held < 0.5 * config_of().chatter.lines.threshold);
    if (!colour.follows_law) continue;
    for (const double x : {14.0, 20.0}) {
      const double passed = static_cast<double>(
          std::count_if(heard.scores.begin(), heard.scores.end(), [&](double s) { return s > x; }));
      // All 256 lines, as the threshold counts them. A third lie at multiples of the rotation or
      // below 60 Hz, of the others a third are peaks, and some are weaker than a multiple.
      const double most = 256 * std::pow(1 + x / 4.7, -4.7) * transforms;
      check::figure("transforms that pass, of what the threshold counts with", passed / most);
      CHECK(passed < most);
      CHECK(passed > 0.04 * most);
    }
  }
}

/// Teeth, noise and a line.
struct Cut {
  Noise noise{21};
  double from_s = 1, hz = 713.3, amplitude = 1, offset = 0, scale = 1, fan_hz = 0;
  double operator()(double t, double angle) {
    double v = offset + 3 * std::cos(4 * angle) + 1.5 * std::cos(8 * angle + 1) +
               0.5 * std::cos(angle) + noise.next();
    if (t >= from_s) v += amplitude * std::cos(kTwoPi * hz * t);
    if (fan_hz > 0) v += 2 * std::cos(kTwoPi * fan_hz * t + 1);
    return scale * v;
  }
};
template <typename Real = double>
Run::Heard heard(Cut cut, const SensorChatterConfig& config = config_of()) {
  auto ear = std::make_unique<SensorChatter<Real>>();
  ear->configure(config);
  Run run;
  run.seconds = 3;
  run.value = cut;
  return run.through(*ear);
}

template <typename Real>
void a_line() {
  const Run::Heard h = heard<Real>(Cut{});
  CHECK(h.alarms == 1);
  CHECK_BETWEEN(h.alarm_s, 1.1, 1.5);
  CHECK(std::abs(h.frequency_hz - 713.3) < 4 * h.error_hz);
  CHECK(h.error_hz < 1);
  Cut none;
  none.amplitude = 0;
  CHECK(heard<Real>(none).alarms == 0);
}

/// Neither the unit nor an offset such as gravity matters; the same to the sample, because a score
/// is a ratio.
void units() {
  const Run::Heard h = heard(Cut{});
  Cut cut;
  cut.scale = 1024;  // exact in floating point
  const Run::Heard scaled = heard(cut);
  CHECK(scaled.alarms == h.alarms);
  CHECK_NEAR(scaled.alarm_s, h.alarm_s, 0);
  CHECK_NEAR(scaled.frequency_hz, h.frequency_hz, 1e-9);
  CHECK(scaled.scores.size() == h.scores.size());
  cut.scale = 1000;  // mm/s2 for m/s2
  CHECK_NEAR(heard(cut).alarm_s, h.alarm_s, 0);
  cut.scale = 1e-3;
  CHECK_NEAR(heard(cut).alarm_s, h.alarm_s, 0);
  cut.scale = 1;
  cut.offset = kGravity_m_s2;
  CHECK_NEAR(heard(cut).alarm_s, h.alarm_s, 0);
  cut.offset = 0;
  // Single precision hears the same line.
  CHECK_NEAR(heard<float>(Cut{}).alarm_s, h.alarm_s, 0.05);
}

/// A fan is no chatter where it was learned, wherever the rate of the parts folds it to; chatter
/// beside it is.
void the_machines_own() {
  for (const double fan_hz : {445.0, 2210.0}) {
    Cut cut;
    cut.amplitude = 0;
    cut.fan_hz = fan_hz;
    SensorChatterConfig config = config_of();
    CHECK(heard(cut).alarms > 0);
    config.own_lines_hz[0] = fan_hz;
    CHECK(heard(cut, config).alarms == 0);
    cut.amplitude = 1;
    CHECK(heard(cut, config).alarms == 1);
  }
}

/// A line of less than its share of the vibration is none; in the air there is none either.
void conditions() {
  Cut cut;
  SensorChatterConfig config = config_of();
  config.chatter.tolerated_load_share = 0.2;  // its power is 0.5 of 7.3
  CHECK(heard(cut, config).alarms == 0);
  auto ear = std::make_unique<SensorChatter<double>>();
  ear->configure(config_of());
  Run run;
  run.seconds = 3;
  run.value = cut;
  run.before = [&](std::size_t) { ear->tell_air(true); };
  CHECK(run.through(*ear).alarms == 0);
}

/// What is no number neither latches nor alarms.
void faults() {
  auto ear = std::make_unique<SensorChatter<double>>();
  ear->configure(config_of());
  Cut cut;
  Run run;
  run.seconds = 3;
  std::size_t i = 0;
  run.value = [&](double t, double angle) {
    const double v = cut(t, angle);
    return ++i > 4000 && i < 4400 ? std::numeric_limits<double>::quiet_NaN() : v;
  };
  const Run::Heard h = run.through(*ear);
  CHECK(h.alarms == 1);
  CHECK_BETWEEN(h.alarm_s, 1.1, 1.6);
  CHECK(is_finite(ear->chatter().state().load_Nm2));
}

void what_is_refused() {
  SensorChatterConfig c = config_of();
  CHECK(SensorChatter<float>::validate(c).ok());
  c.channel = Channel::spindle;
  CHECK(std::string(SensorChatter<float>::validate(c).parameter()) == "channel");
  c = config_of();
  c.chatter.lines.threshold = 0;
  CHECK(std::string(SensorChatter<float>::validate(c).parameter()) == "lines.threshold");
  c.chatter.chatter_threshold_Nm2 = 1;  // the power alone
  CHECK(SensorChatter<float>::validate(c).ok());
  c = config_of();
  c.own_lines_hz[3] = -1;
  CHECK(std::string(SensorChatter<float>::validate(c).parameter()) == "own_lines_hz");
  c = config_of();
  c.highpass_rad_s = 1e5;
  CHECK(std::string(SensorChatter<float>::validate(c).parameter()) == "highpass_rad_s");
}

/// An event says which sensor has heard, and in its unit.
void what_is_said() {
  StateChange<double> change;
  change.monitor = MonitorId::chatter;
  change.channel = Channel::microphone;
  change.state = MonitorState::alarm;
  change.detail = static_cast<std::uint8_t>(ChatterSign::line);
  change.value = 120;
  change.frequency_hz = 713.3;
  change.error_hz = 0.4;
  Event event = event_from(change, 0);
  CHECK(event.channel == "microphone");
  CHECK(event.unit == "1");
  CHECK(event.reason.ends_with("713.3 +- 0.4 Hz in the sound"));
  change.detail = static_cast<std::uint8_t>(ChatterSign::power);
  CHECK(event_from(change, 0).unit == "Pa2");
  change.channel = Channel::accelerometer;
  CHECK(event_from(change, 0).unit == "m2/s4");
  change.channel = Channel::spindle;
  CHECK(event_from(change, 0).unit == "Nm2");
}

}  // namespace

int main() {
  false_alarms<float>();
  a_line<float>();
  a_line<double>();
  units();
  the_machines_own();
  conditions();
  faults();
  what_is_refused();
  what_is_said();
  check::figure("threshold", config_of().chatter.lines.threshold);
  return check::done();
}
