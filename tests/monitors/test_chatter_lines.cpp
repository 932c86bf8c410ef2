// Lines in the change from revolution to revolution, in noise of known law: false alarms against
// the exponential law, frequency against the truth, and what must not be taken for a line.
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/monitors/chatter.hpp"
#include "servosense/monitors/chatter_lines.hpp"
#include "servosense/monitors/event_text.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod_s = 125e-6, kCutoff_rad_s = 3500, kInertia = 5e-3;
constexpr double kCounts = 131072;
const double kThreshold = usual_chatter_line_threshold(kPeriod_s);

ChatterConfig config_of(double threshold) {
  ChatterConfig c;
  c.teeth = 4;
  c.tolerated_load_share = 0;
  c.lines = {threshold, kInertia, kCounts, kCutoff_rad_s, kCutoff_rad_s};
  return c;
}

// Rounding of a counter through the observer: J s g / (s + g) s h / (s + h), Tustin, g = h.
class RoundingThroughObserver {
 public:
  double operator()(double rounding_rad) {
    const double gT = kCutoff_rad_s * kPeriod_s, gain = 2 * gT / (2 + gT);
    const double speed_last = speed_;
    speed_ += gain * ((rounding_rad - last_) / kPeriod_s - speed_);
    last_ = rounding_rad;
    acceleration_ += gain * ((speed_ - speed_last) / kPeriod_s - acceleration_);
    return -kInertia * acceleration_;
  }

 private:
  double last_ = 0, speed_ = 0, acceleration_ = 0;
};

// Parts of `samples` samples each, so many a revolution: their means, straight lines from sample to
// sample, minus those of the last revolution. Torque [Nm] of the time [s].
struct Spindle {
  std::uint32_t parts = 40;
  double samples = 2.4;
  std::function<double(double)> torque;
  std::function<void()> after_transform = [] {};

  template <typename Real>
  void run(ChatterLines<Real>& lines, std::uint64_t transforms) const {
    std::vector<double> last(parts, 0);
    std::uint64_t part = 0;
    double integral = 0, began = 0, integral_began = 0, x = torque(0), edge = samples;
    lines.start(parts);
    std::uint64_t seen = lines.state().transforms;
    const std::uint64_t until = seen + transforms;
    for (std::uint64_t i = 1; lines.state().transforms < until; ++i) {
      lines.step(Real(0));
      const double next = torque(static_cast<double>(i) * kPeriod_s);
      while (edge <= static_cast<double>(i)) {
        const double f = edge - static_cast<double>(i - 1);
        const double here = integral + f * (x + f * (next - x) / 2);
        const double mean = (here - integral_began) / (edge - began);
        double& before = last[part % parts];
        if (part >= parts) lines.take(static_cast<Real>(mean - before), static_cast<Real>(1 - f));
        before = mean;
        began = edge;
        integral_began = here;
        edge = static_cast<double>(++part + 1) * samples;
      }
      integral += (x + next) / 2;
      x = next;
      if (lines.state().transforms != seen) {
        seen = lines.state().transforms;
        after_transform();
      }
    }
  }
};

// Of white rounding a score is exponential: so many transforms pass a level.
template <typename Real>
void false_alarms() {
  static ChatterLines<Real> lines;
  lines.configure(config_of(1));
  std::mt19937 random(11);
  std::uniform_real_distribution<double> rounding(-0.5, 0.5);
  RoundingThroughObserver observer;
  Spindle spindle;
  spindle.torque = [&](double) { return observer(rounding(random) * kTwoPi / kCounts); };
  spindle.run(lines, 30);  // the noise is learned
  CHECK_NEAR(static_cast<double>(lines.state().counter), 1, 0.15);
  constexpr int kTransforms = 6000;
  int above[3] = {0, 0, 0};
  const double level[3] = {8, 10, 12};
  spindle.after_transform = [&] {
    for (int i = 0; i < 3; ++i)
      above[i] += static_cast<double>(lines.state().found.score) > level[i];
  };
  spindle.run(lines, kTransforms);
  for (int i = 0; i < 2; ++i) {
    // All 256 lines, as the threshold counts them; lines at harmonics and below 60 Hz, and what
    // looks like the counter's are left out: a half is left at least a third of the time.
    const double most = 256 * std::exp(-level[i]) * kTransforms;
    check::figure("transforms that pass, of what the threshold counts with", above[i] / most);
    CHECK(above[i] < 1.0 * most + 3 * std::sqrt(most));
    CHECK(above[i] > 0.1 * most);
  }
  CHECK(above[2] <= 25);
}

// A line in that noise: found, at its frequency, within the error that is told.
template <typename Real>
void frequency() {
  double squares = 0;
  int found = 0, tried = 0;
  for (unsigned seed = 1; seed <= 60; ++seed) {
    static ChatterLines<Real> lines;
    const double threshold = kThreshold;
    lines.configure(config_of(threshold));
    std::mt19937 random(100 + seed);
    std::uniform_real_distribution<double> rounding(-0.5, 0.5), uniform(0, 1);
    RoundingThroughObserver observer;
    Spindle spindle;
    const double turn_hz = 1 / (spindle.parts * spindle.samples * kPeriod_s);
    const double order = 4 + seed % 8 + 0.3 + 0.4 * uniform(random);
    const double line_hz = order * turn_hz, phase = kTwoPi * uniform(random);
    double amplitude = 0;
    spindle.torque = [&](double t) {
      return observer(rounding(random) * kTwoPi / kCounts) +
             amplitude * std::cos(kTwoPi * line_hz * t + phase);
    };
    spindle.run(lines, 20);
    CHECK(static_cast<double>(lines.state().found.score) < threshold);
    amplitude = 0.6;  // the noise has 1.4 Nm
    spindle.run(lines, 1);
    ++tried;
    if (static_cast<double>(lines.state().found.score) < threshold) continue;
    ++found;
    const auto& f = lines.state().found;
    const double off = static_cast<double>(f.frequency_hz) - line_hz;
    squares += std::pow(off / static_cast<double>(f.error_hz), 2);
    CHECK(std::abs(off) < 5);
    CHECK(static_cast<double>(f.power_Nm2) > 0.2 * amplitude * amplitude / 2);
    CHECK(static_cast<double>(f.power_Nm2) < 3 * amplitude * amplitude / 2);
  }
  check::figure("lines found", static_cast<double>(found) / tried);
  check::figure("error of the frequency over what is told", std::sqrt(squares / found));
  CHECK(10 * found >= 9 * tried);
  CHECK(std::sqrt(squares / found) < 1.6);
  CHECK(std::sqrt(squares / found) > 0.4);
}

// The counter of a spindle that turns evenly: a sawtooth with lines at the counts a sample, and
// torque of the teeth. The angle turns as the parts say.
void even_counter() {
  for (unsigned seed = 1; seed <= 40; ++seed) {
    static ChatterLines<double> lines;
    lines.configure(config_of(kThreshold));
    std::mt19937 random(300 + seed);
    std::uniform_real_distribution<double> uniform(0, 1);
    RoundingThroughObserver observer;
    Spindle spindle;
    spindle.samples = 2.2 + 0.6 * uniform(random);
    const double counts = kCounts / (spindle.parts * spindle.samples);  // a sample
    double at = uniform(random);
    spindle.torque = [&](double) {
      at += counts;
      at -= std::floor(at);
      return observer((0.5 - at) * kTwoPi / kCounts);
    };
    double most = 0;
    spindle.after_transform = [&] { most = std::max(most, lines.state().found.score); };
    spindle.run(lines, 20);
    CHECK(most < kThreshold);
  }
}

// What the teeth do, however it changes: 20 Nm at the tooth frequency and its second harmonic.
void changing_cut() {
  std::mt19937 random(500);
  std::uniform_real_distribution<double> rounding(-0.5, 0.5), uniform(0, 1);
  const auto most_of = [&](const std::function<double(double)>& load, double order) {
    static ChatterLines<double> lines;
    lines.configure(config_of(kThreshold));
    RoundingThroughObserver observer;
    Spindle spindle;
    const double turn_hz = 1 / (spindle.parts * spindle.samples * kPeriod_s);
    spindle.torque = [&](double t) {
      const double turn = kTwoPi * turn_hz * t;
      return observer(rounding(random) * kTwoPi / kCounts) +
             load(t) * (1 + std::cos(order * turn) + 0.5 * std::cos(2 * order * turn));
    };
    double most = 0;
    spindle.after_transform = [&] { most = std::max(most, lines.state().found.score); };
    spindle.run(lines, 30);
    return most / kThreshold;
  };
  CHECK(most_of([](double) { return 20.0; }, 4) < 1);
  CHECK(most_of([](double t) { return 20 * t; }, 4) < 1);
  CHECK(most_of([](double t) { return 20 / (1 + std::exp(-(t - 0.5) / 0.05)); }, 4) < 1);
  // The same at an order that is none of the spindle's is a line, at once.
  CHECK(most_of([](double) { return 20.0; }, 4.4) > 10);
}

// A transform is ready before the next is due, whatever there is to seek through.
void in_time() {
  static ChatterLines<float> lines;
  lines.configure(config_of(20));
  std::mt19937 random(600);
  std::normal_distribution<double> normal;
  Spindle spindle;
  spindle.samples = 2;  // the shortest parts
  spindle.torque = [&](double) { return normal(random); };
  std::uint64_t steps = 0;
  spindle.run(lines, 5);
  const std::uint64_t before = lines.state().transforms;
  for (int i = 0; i < 50 * 128; ++i) {
    for (int k = 0; k < 2; ++k, ++steps) lines.step(0);
    lines.take(static_cast<float>(normal(random)), 0);
  }
  CHECK(lines.state().transforms - before >= 49);
}

// The monitor: chatter at a fifth of the noise's power is an alarm, of a line and not of the comb.
void of_the_monitor() {
  using Monitor = ChatterMonitor<double, 8, 10, 2048>;
  static Monitor with, without;
  ChatterConfig c = config_of(kThreshold);
  c.sample_period_s = kPeriod_s;
  c.window_revolutions = 8;
  c.chatter_threshold_Nm2 = 4;  // of the comb: what rounding holds it below
  c.cutting_torque_Nm = 1;
  c.tolerated_load_share = 0.001;
  CHECK_TEXT(Monitor::validate(c).reason(), "");
  with.configure(c);
  c.lines.threshold = 0;
  without.configure(c);
  std::mt19937 random(700);
  std::uniform_real_distribution<double> rounding(-0.5, 0.5);
  RoundingThroughObserver observer;
  const double speed = kTwoPi * 83.7;
  double angle = 0, alarm_s = -1, over_s = -1;
  for (int i = 0; i < 32000; ++i) {
    const double t = i * kPeriod_s;
    angle += speed * kPeriod_s;
    if (angle >= kTwoPi) angle -= kTwoPi;
    const double chatter = t > 1 && t < 3 ? 0.8 * std::cos(kTwoPi * 703 * t) : 0;
    const double torque =
        8 + 3 * std::cos(4 * angle) + chatter + observer(rounding(random) * kTwoPi / kCounts);
    const auto state = with.process(torque, angle, speed * kPeriod_s, Quality::good);
    CHECK(without.process(torque, angle, speed * kPeriod_s, Quality::good) != MonitorState::alarm);
    if (state == MonitorState::alarm && alarm_s < 0) {
      alarm_s = t;
      CHECK_NEAR(with.lines().state().found.frequency_hz, 703, 3);
      CHECK(with.sign() == ChatterSign::line);
      CHECK(with.value(with.sign()) >= with.alarm(with.sign()).threshold());
      CHECK(with.state().chatter_Nm2 < c.chatter_threshold_Nm2);
      CHECK(with.evidence().count == 0);  // there is none of a line
    }
    if (alarm_s > 0 && over_s < 0 && state != MonitorState::alarm) over_s = t;
  }
  CHECK(with.state().alarms == 1);  // one, however the score moves from transform to transform
  check::figure("alarm over after chatter", over_s - 3, "s");
  // A window that still holds some of it, and eight transforms.
  CHECK(over_s > 3 && over_s < 3 + 0.15 + 8 * 0.05);
  check::figure("alarm after chatter", alarm_s - 1, "s");
  CHECK(alarm_s > 1 && alarm_s < 1.35);
}

// What is said of it.
void event() {
  StateChange<double> change;
  change.monitor = MonitorId::chatter;
  change.channel = Channel::spindle;
  change.state = MonitorState::alarm;
  change.detail = static_cast<std::uint8_t>(ChatterSign::line);
  change.value = 1234.5;
  change.threshold = 38.8;
  change.frequency_hz = 703.24;
  change.error_hz = 0.41;
  const Event event = event_from(change, 0);
  CHECK_TEXT(event.reason,
             "vibration at no multiple of the spindle speed: a line of 1234 times its noise at "
             "703.2 +- 0.4 Hz");
  CHECK_TEXT(event.unit, "1");
  CHECK(event.extra.size() == 2 && event.extra[0].second == change.frequency_hz &&
        event.extra[1].second == change.error_hz);
  change.detail = 0;
  change.frequency_hz = change.error_hz = 0;
  const Event power = event_from(change, 0);
  CHECK_TEXT(power.unit, "Nm2");
  CHECK(power.extra.empty());
}

}  // namespace

int main() {
  false_alarms<double>();
  false_alarms<float>();
  frequency<double>();
  frequency<float>();
  even_counter();
  changing_cut();
  in_time();
  of_the_monitor();
  event();
  return check::done();
}
