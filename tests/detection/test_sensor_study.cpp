// Chatter heard by an accelerometer and by a microphone, on the simulated cuts of the detection
// study: what is missed, and what of stable cuts alarms, beside naive methods.
//
//   accelerometer  a third of the tool's acceleration along x, what the noise of chip formation
//                  rings in the tool's modes, the spindle's own orders, a fan, mains, white noise
//   microphone     the tool's velocity, 3 ms late, the same ringing, two fans, mains, cabin noise
//                  that falls with the frequency, and coolant: a band about 1.2 kHz that comes and
//                  goes, which the idling run does not have
//
// Levels are drawn for each cut, of its own forced vibration. The naive methods have 1.5 times what
// they read in the idling run for a limit:
//
//   rms      of 50 ms
//   line     strongest of a Hann window of 512 samples off the multiples of the rotation
//   MV - MFT power beyond the harmonics over eight revolutions (Koike 2016, sec. 2.3.3)
//
//   sensor_study [--cases N] [--from SEED]    --nightly: 150 of each kind
// Figures: docs/sensor-chatter.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/random_cuts.hpp"
#include "detection/scores.hpp"
#include "seed_range.hpp"
#include "servosense/dsp/short_time_fourier.hpp"
#include "servosense/identify/sensor_idle.hpp"
#include "servosense/monitors/sensor_chatter.hpp"

using namespace servosense;
using namespace detection;
using detection::Event;

namespace {

constexpr std::uint64_t kFirstSeed = 905000;     // looked at
constexpr double kStill = 0.2, kChatters = 0.3;  // of the feed per tooth, as the study
constexpr double kMargin = 1.5;                  // of the naive limits

using Series = std::vector<double>;

/// A damped oscillator that noise rings: its acceleration.
class Ringing {
 public:
  Ringing(double hz, double damping) {
    const double w = kTwoPi * hz * kPeriod_s, r = std::exp(-damping * w);
    a_ = 2 * r * std::cos(w);
    b_ = -r * r;
  }
  double operator()(double force) {
    const double now = a_ * x_ + b_ * y_ + force;
    const double acceleration = now - 2 * x_ + y_;
    y_ = x_;
    x_ = now;
    return acceleration;
  }

 private:
  double a_, b_, x_ = 0, y_ = 0;
};

double rms(const Series& x) {
  double sum = 0;
  for (const double v : x) sum += v * v;
  return x.empty() ? 0 : std::sqrt(sum / static_cast<double>(x.size()));
}

/// What a sensor gives, in the cut and in the air.
struct Heard {
  Series cut, idle, idle_angle;
};

/// All of it, of one sensor.
Heard sensor(const Cut& c, const Record& r, Channel channel) {
  std::mt19937_64 bits(c.seed * 97 + (channel == Channel::microphone ? 1 : 0));
  std::normal_distribution<double> gauss;
  std::uniform_real_distribution<double> uniform;
  const auto between = [&](double low, double high) {
    return low * std::pow(high / low, uniform(bits));
  };
  const bool air_borne = channel == Channel::microphone;
  const std::size_t n = r.size();
  Series motion(n, 0);
  std::vector<char> cuts(n, 0);
  const auto at = [&](std::size_t i) { return static_cast<double>(r.x_m[i]); };
  for (std::size_t i = 2; i < n; ++i) {
    if (air_borne) {
      if (i >= 24) motion[i] = 420 * 0.01 * (at(i - 23) - at(i - 24)) / kPeriod_s;
    } else {
      motion[i] = (at(i) - 2 * at(i - 1) + at(i - 2)) / (3 * kPeriod_s * kPeriod_s);
    }
    cuts[i] = r.torque_Nm[i] > 0;
  }
  // What the noises are drawn against: the vibration of the cut at its quietest quarter.
  Series levels;
  for (std::size_t from = 0; from + 800 <= n; from += 800) {
    const double level = rms(Series(motion.begin() + static_cast<std::ptrdiff_t>(from),
                                    motion.begin() + static_cast<std::ptrdiff_t>(from + 800)));
    if (cuts[from] != 0 && cuts[from + 799] != 0) levels.push_back(level);
  }
  const double forced = std::max(1e-9, quantile(levels, 0.25));
  // Ringing of the modes, to the wanted share.
  const auto& structure = c.milling().structure;
  std::vector<Ringing> modes;
  for (const auto* axis : {&structure.x, &structure.y})
    for (const StructuralMode& m : *axis)
      modes.emplace_back(m.natural_frequency_hz, m.damping_ratio);
  Series rung(n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    const double force = cuts[i] != 0 ? gauss(bits) : 0;
    for (Ringing& mode : modes) rung[i] += mode(force);
  }
  const double ring = between(0.03, 0.3) * forced / std::max(1e-12, rms(rung));
  const double white = between(0.003, 0.05) * forced;
  const double cabin = air_borne ? between(0.03, 0.3) * forced : 0;
  const double coolant = air_borne ? between(0.03, 0.5) * forced : 0;
  struct Tone {
    double hz, amplitude, phase;
  };
  std::vector<Tone> tones;
  for (const double hz : {50.0, 100.0, 150.0})
    tones.push_back({hz, between(0.01, 0.1) * forced, kTwoPi * uniform(bits)});
  for (int fan = 0; fan < (air_borne ? 2 : 1); ++fan)
    tones.push_back({between(150, 1400), between(0.05, 0.5) * forced, kTwoPi * uniform(bits)});
  std::array<double, 4> order{};
  for (double& a : order) a = between(0.01, 0.2) * forced;
  const auto surroundings = [&](std::size_t i, double angle, double& low) {
    const double t = static_cast<double>(i) * kPeriod_s;
    double v = white * gauss(bits);
    low += 0.05 * (gauss(bits) - low);
    v += cabin * 6 * low;
    for (const Tone& tone : tones)
      v += tone.amplitude * std::cos(kTwoPi * tone.hz * t + tone.phase);
    for (std::size_t k = 0; k < order.size(); ++k)
      v += order[k] * std::cos(static_cast<double>(k + 1) * angle + static_cast<double>(k));
    return v;
  };
  Heard heard;
  Ringing spray(1200, 0.25);
  Series sprayed(n, 0);
  for (std::size_t i = 0; i < n; ++i)
    sprayed[i] = spray(gauss(bits)) * (1 + 0.5 * std::sin(9 * static_cast<double>(i) * kPeriod_s));
  const double spray_scale = coolant / std::max(1e-12, rms(sprayed));
  double low = 0;
  for (std::size_t i = 0; i < n; ++i)
    heard.cut.push_back(motion[i] + ring * rung[i] + spray_scale * sprayed[i] +
                        surroundings(i, r.drive[0].position[i], low));
  // Six seconds in the air, at 0.6 and 1 of the speed, with the same machine about.
  const double speed = rad_s_from_rpm(c.milling().cut.spindle_speed_rpm);
  double angle = 0;
  for (std::size_t i = 0; i < 48000; ++i) {
    angle += kPeriod_s * (i < 24000 ? 0.6 : 1.0) * speed;
    heard.idle_angle.push_back(angle);
    heard.idle.push_back(surroundings(i, angle, low));
  }
  return heard;
}

/// Strongest line of 512 samples off the multiples of the rotation, mean square.
double strongest_line(const Series& x, const Series& angle, std::size_t from, std::size_t to) {
  constexpr std::size_t kWindow = 512;
  double most = 0;
  if (to - from < kWindow) return 0;
  ShortTimeFourierConfig config;
  config.window = kWindow;
  config.hop = kWindow / 2;
  const Spectrogram s = good(
      short_time_fourier(std::span(x).subspan(from, to - from), 1 / kPeriod_s, config), "line");
  for (std::size_t f = 0; f < s.frames(); ++f) {
    const std::size_t begin = from + f * kWindow / 2;
    const double turns = (angle[begin + kWindow - 1] - angle[begin]) / kTwoPi;
    if (!(turns > 1)) continue;
    for (std::size_t k = 4; k < kWindow / 2; ++k) {
      const double order = static_cast<double>(k) / turns;
      if (std::abs(order - std::round(order)) * turns > 1.5) most = std::max(most, s.at(f, k));
    }
  }
  return most;
}

double strongest_rms(const Series& x, std::size_t from, std::size_t to) {
  double most = 0;
  for (; from + 400 <= to; from += 400)
    most = std::max(most, rms(Series(x.begin() + static_cast<std::ptrdiff_t>(from),
                                     x.begin() + static_cast<std::ptrdiff_t>(from + 400))));
  return most;
}

using Ear = SensorChatter<double>;

SensorChatterConfig config_for(const Cut& c, Channel channel) {
  SensorChatterConfig config = sensor_chatter_defaults(channel, kPeriod_s);
  config.chatter.teeth = static_cast<unsigned>(c.milling().tool.teeth);
  return config;
}

struct Judged {
  double line = 0, share = 0, residue = 0, power = 0, hz = 0, alarm_s = kNever;
};

/// The monitor over a series, `air` and positions as far as they are known.
Judged listen(const SensorChatterConfig& config, const Series& x, const Series& angle,
              const Record* r) {
  static auto ear = std::make_unique<Ear>();
  ear->configure(config);
  Judged j;
  std::size_t cut_left = 0, transforms = 0, verdicts = 0;
  std::array<double, 4> shares{};
  std::array<double, 5> last{};
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double turn = angle[i] - kTwoPi * std::floor(angle[i] / kTwoPi);
    if (r != nullptr) {
      cut_left = r->torque_Nm[i] > 0 ? 240 : cut_left - (cut_left > 0);
      ear->tell_air(cut_left == 0);
    }
    const MonitorState state =
        ear->hear(x[i], turn, i > 0 ? angle[i] - angle[i - 1] : 0, Quality::good);
    if (r != nullptr && ear->chatter().asks_position())
      ear->tell_position({r->drive[1].position[i], r->drive[2].position[i], 0});
    const auto& s = ear->chatter().state();
    if (s.transforms != transforms) {
      transforms = s.transforms;
      for (std::size_t k = 4; k > 0; --k) last[k] = last[k - 1];
      last[0] = s.line;
      const double held = *std::min_element(last.begin(), last.end());
      if (held > j.line) {
        j.line = held;
        j.hz = ear->chatter().lines().state().found.frequency_hz;
      }
    }
    if (s.verdicts != verdicts) {
      verdicts = s.verdicts;
      const auto m = ear->chatter().measures();
      for (std::size_t k = 3; k > 0; --k) shares[k] = shares[k - 1];
      const bool touches = ChatterRule<double>::touches(m.load);
      shares[0] = m.remembered > 0 && cut_left > 0 && !touches && s.feed.steady()
                      ? m.beyond_change / m.remembered
                      : 0;
      j.share = std::max(j.share, *std::min_element(shares.begin(), shares.end()));
      j.power = std::max(j.power, m.beyond_change);
      j.residue = std::max(j.residue, s.residue_Nm2);
    }
    if (state == MonitorState::alarm && j.alarm_s == kNever)
      j.alarm_s = static_cast<double>(i) * kPeriod_s;
  }
  return j;
}

struct Tally {
  Scores monitor, line, share, rms, fft, residue;
  std::size_t before = 0, reached = 0;  // of those that reach one feed per tooth
  Series late_s;

  void hear(const Cut& c, const Record& r, Channel channel, bool chatters) {
    const Heard heard = sensor(c, r, channel);
    SensorChatterConfig config = config_for(c, channel);
    const SensorIdle idle = good(learn_sensor(heard.idle, heard.idle_angle, kPeriod_s), "idle");
    const std::vector<double> own = idle.own_lines_hz(config.own_lines_hz.size());
    std::copy(own.begin(), own.end(), config.own_lines_hz.begin());
    const Judged in_air = listen(config, heard.idle, heard.idle_angle, nullptr);
    config.chatter.chatter_threshold_Nm2 = kMargin * in_air.power;
    const Judged j = listen(config, heard.cut, r.drive[0].position, &r);
    const auto add = [&](Scores& s, double value, double limit) {
      (chatters ? s.with : s.without).push_back(limit > 0 ? value / limit : 0);
    };
    std::size_t from = 0, to = r.size();
    while (from < to && !(r.torque_Nm[from] > 0)) ++from;
    while (to > from && !(r.torque_Nm[to - 1] > 0)) --to;
    add(line, j.line, config.chatter.lines.threshold);
    // Its own operating point; for the area what is nearer to its limit.
    const double nearer = std::max(j.line / config.chatter.lines.threshold, j.share / 0.5);
    add(monitor, j.alarm_s < kNever ? std::max(1.0, nearer) : std::min(0.999, nearer), 1);
    add(share, j.share, 0.5);
    add(residue, j.residue, kMargin * in_air.residue);
    add(rms, strongest_rms(heard.cut, from, to),
        kMargin * strongest_rms(heard.idle, 0, heard.idle.size()));
    add(fft, strongest_line(heard.cut, r.drive[0].position, from, to),
        kMargin * strongest_line(heard.idle, heard.idle_angle, 0, heard.idle.size()));
    if (chatters && r.chatter_s < kNever) {
      ++reached;
      before += j.alarm_s < r.chatter_s;
      if (j.alarm_s < kNever) late_s.push_back(j.alarm_s - r.chatter_s);
    }
    if (chatters != (j.alarm_s < kNever))
      std::printf("  %s %s: line %.0f at %.1f Hz, share %.2f, %s\n", chatters ? "missed" : "false",
                  std::string(name_of(channel)).c_str(), j.line, j.hz, j.share, c.text.c_str());
  }
  void print(const char* name) const {
    std::printf("%s: %zu of %zu before one feed per tooth; alarms %.2f s after it in the median\n",
                name, before, reached, quantile(late_s, 0.5));
    monitor.print("monitor");
    line.print("  its lines");
    share.print("  its power over half of the load");
    rms.print("rms");
    fft.print("line of an FFT");
    residue.print("MV - MFT");
  }
};

}  // namespace

int main(int argc, char** argv) {
  const auto [from, cases] =
      check::seed_range(argc, argv, {kFirstSeed, check::nightly(argc, argv) ? 150U : 4U});
  Tally accelerometer, microphone;
  for (std::uint64_t i = 0; i < cases; ++i)
    for (const Event event : {Event::none, Event::chatter}) {
      const Cut c = draw(from + i, event);
      const Record r = simulate(c);
      const double vibration =
          static_cast<double>(r.steady_vibration_m) / c.milling().cut.feed_per_tooth_m;
      const bool chatters = event == Event::chatter;
      // Neither one nor the other.
      if (r.tool_lost || (chatters ? vibration < kChatters : vibration > kStill)) continue;
      accelerometer.hear(c, r, Channel::accelerometer, chatters);
      microphone.hear(c, r, Channel::microphone, chatters);
    }
  accelerometer.print("accelerometer");
  microphone.print("microphone");
  CHECK(!accelerometer.line.with.empty() && !accelerometer.line.without.empty());
  for (const Tally* t : {&accelerometer, &microphone}) {
    CHECK(t->monitor.auc() > 0.85);
    for (const Scores* naive : {&t->rms, &t->fft, &t->residue})
      CHECK(t->monitor.auc() > naive->auc());
    CHECK(static_cast<double>(t->monitor.false_alarms()) <=
          0.15 * static_cast<double>(t->monitor.without.size()));
  }
  return check::done();
}
