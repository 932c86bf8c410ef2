// Feed axes that idle: what some laps of a few moves teach the collision monitor, then hours of the
// same moves with other noise, another friction and elsewhere on the axis, and contacts in rapid
// motion. Drives drawn at random from two plants that are not what the fit assumes
// (oracles/idle_plant.hpp, oracles/shop_drive.hpp).
//
//   idle_axes                      a small fixed set
//   idle_axes --nightly            40 machines, 2.5 hours each
//   idle_axes --machines N [--from SEED] [--hours H] [--laps L] [--rate R]   H of each
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "check.hpp"
#include "detection/scores.hpp"
#include "oracles/idle_plant.hpp"
#include "oracles/shop_drive.hpp"
#include "servosense/identify/learn_thresholds.hpp"

namespace {

using namespace servosense;

constexpr double kPeriod_s = 250e-6;
constexpr double kNever = 1e9;

struct Machine {
  bool shop = false;
  oracle::IdlePlant plant;
  oracle::ShopDrive drive;
  oracle::FeedProgram program;
  double count_m = 0, noise_N = 0, step_N = 0;
};

struct Draw {
  std::mt19937 random;
  double between(double low, double high) {
    return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
  }
  double scale(double low, double high) { return low * std::pow(high / low, between(0, 1)); }
};

Machine draw(unsigned seed) {
  Draw d{std::mt19937(seed)};
  Machine m;
  m.shop = seed % 2 == 0;
  m.plant.inertia = d.scale(80, 500);
  m.plant.viscous = m.plant.inertia * d.between(1, 6);
  m.plant.coulomb = m.plant.inertia * d.between(0.2, 1);
  m.plant.knee = d.scale(2e-6, 3e-5);
  oracle::ShopDrive& s = m.drive;
  s.inertia = m.plant.inertia, s.viscous = m.plant.viscous, s.coulomb = m.plant.coulomb;
  s.bristle = d.scale(2e-6, 2e-5);
  s.stribeck = d.between(0, 0.4);
  s.stribeck_speed = d.scale(0.005, 0.05);
  s.ripple = d.between(0, 0.05);
  s.ripple_length = d.scale(0.005, 0.02);
  s.current_lag_s = d.between(0, 4e-4);
  s.period_s = kPeriod_s;
  s.effort_noise = 0;
  s.count = 1e-10;
  m.count_m = 0.016 / std::exp2(std::floor(d.between(17, 24)));
  m.noise_N = m.plant.coulomb * d.scale(0.01, 0.3);
  m.step_N = d.between(0, 1) < 0.3 ? m.noise_N * d.between(0.5, 3) : 0;
  const double rapid_m_s = d.between(0.3, 0.9);
  const int moves = 2 + static_cast<int>(d.between(0, 3));
  for (int i = 0; i < moves; ++i) {
    oracle::Reciprocating r;
    r.speed = i == 0 ? rapid_m_s : rapid_m_s * d.scale(0.05, 0.6);
    r.ramp_s = std::max(0.03, 2 * r.speed / d.between(4, 12));
    r.distance = r.speed * (r.ramp_s + d.between(0.05, 0.3));
    r.dwell_s = d.between(0, 0.2);
    m.program.moves.push_back(r);
  }
  return m;
}

/// True motion and effort; no noise.
struct Truth {
  std::vector<double> x, effort;
  double touch_s = kNever;
};

struct Contact {
  double at_m = kNever, stiffness = 0, gives_way_N = 0;
};

Truth run(const Machine& m, double friction, double offset_m, double seconds,
          const Contact& contact = {}) {
  Truth t;
  bool lost = false;
  const auto reference = [&](double at) {
    oracle::Motion r = m.program.at(at);
    r.x += offset_m;
    return r;
  };
  const auto load = [&](double now, double into_m) {
    if (lost || !(into_m > 0)) return 0.0;
    if (t.touch_s == kNever) t.touch_s = now;
    const double force = contact.stiffness * into_m;
    lost = force > contact.gives_way_N;
    return force;
  };
  if (m.shop) {
    oracle::ShopDrive d = m.drive;
    d.coulomb *= friction;
    for (const auto& s : d.run(seconds, 1, reference, [&](double now, double x, double) {
           return load(now, x - contact.at_m);
         })) {
      t.x.push_back(static_cast<double>(s.counts) * d.count);
      t.effort.push_back(s.effort);
    }
    return t;
  }
  oracle::IdlePlant p = m.plant;
  p.coulomb *= friction;
  // This plant knows loads over time: of an obstacle that is run into at the pace of the command.
  oracle::IdlePlant::Record record = p.run(seconds, kPeriod_s, reference, [&](double now) {
    return load(now, reference(now).x - contact.at_m);
  });
  t.x = std::move(record.x);
  t.effort = std::move(record.effort);
  return t;
}

/// Counts and effort as the drive reports them.
class Reported {
 public:
  Reported(const Machine& m, unsigned seed)
      : reporter_(m.count_m, m.noise_N, seed), step_N_(m.step_N) {}
  void start(double x) { last_ = reporter_.counts(x); }
  DriveSample<double> at(double x, double effort) {
    const std::int64_t now = reporter_.counts(x);
    DriveSample<double> s;
    s.increment = static_cast<double>(now - last_) * reporter_.unit_per_count;
    s.effort = reporter_.effort(effort);
    if (step_N_ > 0) s.effort = step_N_ * std::round(s.effort / step_N_);
    last_ = now;
    return s;
  }

 private:
  oracle::Reporter reporter_;
  double step_N_;
  std::int64_t last_ = 0;
};

struct Taught {
  DisturbanceObserverConfig observer;
  CollisionConfig collision;
  double stated_per_hour = 0;
  std::string refusal;
};

Taught teach(const Machine& m, unsigned seed, double laps, double accepted_per_hour) {
  Taught out;
  const Truth truth = run(m, 1, 0, laps * m.program.cycle_s());
  DriveRecord record{Channel::x, kPeriod_s, {}};
  Reported reported(m, seed);
  reported.start(truth.x.front());
  for (std::size_t i = 0; i < truth.x.size(); ++i)
    record.samples.push_back(reported.at(truth.x[i], truth.effort[i]));
  DisturbanceObserverConfig o;
  o.sample_period_s = kPeriod_s;
  o.disturbance_cutoff_rad_s = o.velocity_cutoff_rad_s = 335;
  IdleOptions options;
  const double least = 4 * m.count_m;
  for (const double knee : {2e-6, 5e-6, 1e-5, 2e-5, 5e-5})
    if (knee >= least) options.knees.push_back(knee);
  const auto found = identify_idle(o, record, options);
  if (!found) {
    out.refusal = found.error().sentence;
    return out;
  }
  o.drive = identified_drive(o.drive, *found);
  out.observer = o;
  CollisionConfig c;
  c.sample_period_s = kPeriod_s;
  c.release_samples = static_cast<unsigned>(0.1 / kPeriod_s);
  const LearnedCollision learned = learn_collision(o, c, record, accepted_per_hour);
  c.threshold_N_per_s = learned.threshold();
  for (std::size_t p = 0; p < kMotionPhases; ++p)
    c.phase_threshold_N_per_s[p] = learned.phase_threshold(static_cast<MotionPhase>(p));
  out.collision = c;
  out.stated_per_hour = learned.alarms_per_hour();
  return out;
}

/// Watches; alarms are told with the time and the phase.
template <typename Tell>
void watch(const Taught& taught, const Truth& truth, Reported& reported, Tell&& tell) {
  DisturbanceObserver<double> force;
  CollisionMonitor<double> monitor;
  force.configure(taught.observer);
  monitor.configure(taught.collision);
  reported.start(truth.x.front());
  for (std::size_t i = 0; i < truth.x.size(); ++i) {
    const DriveSample<double> s = reported.at(truth.x[i], truth.effort[i]);
    const double f = force.process(s);
    const auto before = monitor.alarm().state().state;
    const auto now = monitor.process(f, s.increment, force.state().quality);
    if (now == MonitorState::alarm && before != MonitorState::alarm)
      tell(static_cast<double>(i) * kPeriod_s, monitor.phase());
  }
}

struct Sum {
  double hours = 0, expected = 0;
  std::size_t machines = 0, unsupported = 0, alarms = 0, noisy = 0, contacts = 0, found = 0;
  std::size_t beyond_record = 0;  // alarms where the record bears less than was asked for
  std::array<std::size_t, kMotionPhases + 1> by_phase{};
  std::vector<double> delay_ms;
};

void study(unsigned seed, double hours, double laps, double accepted, Sum& sum) {
  const Machine m = draw(seed);
  const Taught taught = teach(m, seed * 7 + 1, laps, accepted);
  if (!taught.refusal.empty()) {
    std::printf("  seed %u: %s\n", seed, taught.refusal.c_str());
    return;
  }
  ++sum.machines;
  const bool supported = taught.stated_per_hour <= 1.001 * accepted;
  sum.unsupported += !supported;
  // The moves again: elsewhere on the axis, friction up to a tenth more or less.
  constexpr std::size_t kRuns = 5;
  Draw d{std::mt19937(seed + 5000)};
  std::vector<Truth> runs;
  for (std::size_t k = 0; k < kRuns; ++k)
    runs.push_back(
        run(m, 0.9 + 0.05 * static_cast<double>(k), d.between(0, 0.05), 20 * m.program.cycle_s()));
  Reported reported(m, seed * 7 + 2);
  std::size_t alarms = 0;
  double seconds = 0;
  std::array<std::size_t, kMotionPhases + 1> by_phase{};
  while (seconds < 3600 * hours) {
    const Truth& truth = runs[static_cast<std::size_t>(d.between(0, kRuns))];
    watch(taught, truth, reported, [&](double, MotionPhase p) {
      ++alarms;
      ++by_phase[static_cast<std::size_t>(p)];
    });
    seconds += static_cast<double>(truth.x.size()) * kPeriod_s;
  }
  for (std::size_t p = 0; p < by_phase.size(); ++p) sum.by_phase[p] += by_phase[p];
  sum.noisy += alarms > 0;
  if (supported) {
    sum.hours += seconds / 3600;
    sum.alarms += alarms;
    sum.expected += taught.stated_per_hour * seconds / 3600;
  } else {
    sum.beyond_record += alarms;
  }
  // Contacts in the first, fastest move.
  d.random.seed(seed + 9000);
  std::size_t found = 0;
  double slowest = 0;
  for (int k = 0; k < 3; ++k) {
    const oracle::Reciprocating& fast = m.program.moves.front();
    Contact contact;
    contact.at_m = fast.distance * d.between(0.35, 0.65);
    contact.stiffness = d.scale(2e5, 2e6);
    contact.gives_way_N = d.scale(300, 2000);
    const Truth truth = run(m, d.between(0.9, 1.1), 0, fast.stroke_s() + 0.1, contact);
    if (truth.touch_s == kNever) continue;
    ++sum.contacts;
    double at = kNever;
    watch(taught, truth, reported, [&](double t, MotionPhase) {
      if (at == kNever && t >= truth.touch_s) at = t;
    });
    if (at > truth.touch_s + 0.05) continue;
    ++found;
    sum.delay_ms.push_back(1e3 * (at - truth.touch_s));
    slowest = std::max(slowest, sum.delay_ms.back());
  }
  sum.found += found;
  std::printf(
      "  seed %u %s: noise %.3g N of %.3g, %zu moves; stated %.3g/h, %zu alarms in %.3g h "
      "(%zu %zu %zu %zu); thresholds %.3g %.3g %.3g %.3g; contacts %zu of 3, slowest %.3g ms\n",
      seed, m.shop ? "shop" : "knee", m.noise_N, m.plant.coulomb, m.program.moves.size(),
      taught.stated_per_hour, alarms, seconds / 3600, by_phase[0], by_phase[1], by_phase[2],
      by_phase[3], taught.collision.phase_threshold_N_per_s[0],
      taught.collision.phase_threshold_N_per_s[1], taught.collision.phase_threshold_N_per_s[2],
      taught.collision.phase_threshold_N_per_s[3], found, slowest);
}

}  // namespace

int main(int argc, char** argv) {
  unsigned machines = 4, from = 9000;
  double hours = 0.1, laps = 4, accepted = kAcceptedAlarmsPerHour;
  for (int i = 1; i < argc; ++i) {
    const std::string option = argv[i];
    const auto next = [&] { return i + 1 < argc ? argv[++i] : "0"; };
    if (option == "--nightly") machines = 40, hours = 2.5;
    if (option == "--machines") machines = static_cast<unsigned>(std::atoi(next()));
    if (option == "--from") from = static_cast<unsigned>(std::atoi(next()));
    if (option == "--hours") hours = std::atof(next());
    if (option == "--laps") laps = std::atof(next());
    if (option == "--rate") accepted = std::atof(next());
  }
  Sum sum;
  for (unsigned seed = from; seed < from + machines; ++seed)
    study(seed, hours, laps, accepted, sum);
  std::printf(
      "  %zu machines, %.3g h: accepted %.3g an hour, stated %.3g, counted %.3g (%zu alarms on %zu "
      "machines; %zu %zu %zu %zu %zu by phase); %zu records bear less, %zu alarms there\n",
      sum.machines, sum.hours, accepted, sum.expected / sum.hours,
      static_cast<double>(sum.alarms) / sum.hours, sum.alarms, sum.noisy, sum.by_phase[0],
      sum.by_phase[1], sum.by_phase[2], sum.by_phase[3], sum.by_phase[4], sum.unsupported,
      sum.beyond_record);
  std::printf(
      "  contacts in rapid motion: %zu of %zu, %.2f ms (median), %.2f (95 %%), %.2f (most)\n",
      sum.found, sum.contacts, detection::quantile(sum.delay_ms, 0.5),
      detection::quantile(sum.delay_ms, 0.95), detection::quantile(sum.delay_ms, 1));
  // No more than what is stated, by three deviations of the count; nothing slower than the filters.
  CHECK(static_cast<double>(sum.alarms) <= sum.expected + 3 * std::sqrt(sum.expected));
  CHECK(10 * sum.found >= 7 * sum.contacts);
  CHECK(detection::quantile(sum.delay_ms, 0.5) < 3);
  return check::done();
}
