// Loads behind a spring or play, driven by a prescribed motion: against transfer functions and
// against the equations of motion in very small steps.
#include <algorithm>
#include <complex>

#include "check.hpp"
#include "effects_by_hand.hpp"

using namespace effect_test;

namespace {

DriveFacts facts_at(double period_s) {
  DriveFacts f;
  f.sample_period_s = period_s;
  f.inertia = 200;
  f.viscous = 700;
  f.coulomb = 100;
  return f;
}

// Motor on a sine: force and deflection follow
//   X2/X = (2 z wr (1-s) jw + wa^2) / (wa^2 - w^2 + 2 z wr (1-s) jw),   F = -m2 w^2 X2
// wa^2 = (1-s) wr^2.
template <typename Real>
void transfer(double period_s, double shaken_hz, double tolerance) {
  const double resonance = 90, damping = 0.05, share = 0.4;
  auto effect = made<FlexibleCoupling<Real>>({{resonance}, {damping}, {share}}, facts_at(period_s));
  CHECK(effect.load_shares().inertia == share && effect.load_shares().friction == 0);
  const double w = kTwoPi * shaken_hz, wr = kTwoPi * resonance, amplitude = 1e-4;
  Path<Real> path;
  path.period_s = period_s;
  std::complex<double> force = 0, deflection = 0;
  const int settle = static_cast<int>(1.5 / period_s), whole = static_cast<int>(1 / period_s);
  for (int n = 1; n <= settle + whole; ++n) {
    const double t = n * period_s;
    const double F = static_cast<double>(effect.transmitted(path.to(amplitude * std::sin(w * t))));
    if (n <= settle) continue;
    const std::complex<double> turn = std::polar(2.0 / whole, -w * t);
    force += F * turn;
    deflection += static_cast<double>(effect.deflection()) * turn;
  }
  using namespace std::complex_literals;
  const std::complex<double> spring = (1 - share) * (wr * wr + 2i * damping * wr * w);
  const std::complex<double> load = spring / (spring - w * w);
  const std::complex<double> sine = -1i * amplitude;  // phasor of a sine
  const std::complex<double> F = -80 * w * w * load * sine, d = (1.0 - load) * sine;
  check::figure("transmitted force at " + std::to_string(static_cast<int>(shaken_hz)) +
                    " Hz, T = " + std::to_string(period_s * 1e6) + " us, relative error",
                std::abs(force - F) / std::abs(F));
  CHECK_NEAR(std::abs(force - F) / std::abs(F), 0, tolerance);
  CHECK_NEAR(std::abs(deflection - d) / std::abs(d), 0, tolerance);
}

// Undamped, up to just below half the sample rate, after a kick: neither grows nor decays. The
// energy of the load against a motor that is held is constant.
void stable() {
  for (const double period_s : {125e-6, 1e-3})
    for (const double share : {0.4, 0.02, 0.98})
      for (const double part : {0.05, 0.25, 0.49}) {
        const double resonance = part / period_s, w = kTwoPi * resonance * std::sqrt(1 - share);
        auto effect =
            made<FlexibleCoupling<double>>({{resonance}, {0}, {share}}, facts_at(period_s));
        MotionState<double> m;
        m.increment = 1e-6;
        (void)effect.transmitted(m);
        m.increment = 0;
        const auto energy = [&] {
          const double d = effect.state().deflection, v = effect.state().load_velocity;
          return w * w * d * d + v * v;
        };
        const double first = energy();
        for (int n = 0; n < 1000000; ++n) (void)effect.transmitted(m);
        CHECK_NEAR(energy() / first, 1, 1e-9);  // rounding, 1e6 times
      }
  const auto beyond = setting("flexible-coupling", {{4001}, {0.1}, {0.4}});
  CHECK(!FlexibleCoupling<double>::validate(beyond, facts_at(125e-6)).ok());
}

// A cutting force on the load, motor held: deflects by F/k and the motor feels all of it.
void cutting_on_the_load() {
  auto effect = made<FlexibleCoupling<float>>({{90}, {0.2}, {0.4}}, facts_at(125e-6));
  MotionState<float> m;
  m.cutting = 500;
  float F = 0;
  for (int n = 0; n < 8000; ++n) F = effect.transmitted(m);
  const double k = 0.4 * 0.6 * 200 * std::pow(kTwoPi * 90, 2);
  CHECK_NEAR(static_cast<double>(F), 500, 1e-3);
  CHECK_NEAR(static_cast<double>(effect.deflection()), 500 / k, 1e-5 * 500 / k);
}

// Begun in full travel, no blow.
void start_on_the_move() {
  auto spring = made<FlexibleCoupling<float>>({{90}, {0.02}, {0.4}}, facts_at(125e-6));
  DriveFacts f = facts_at(125e-6);
  f.coulomb = f.viscous = 0;
  auto play = made<Backlash<float>>({{2e-5}}, f);
  MotionState<float> m;
  m.increment = 1e-4F;  // 0.8 m/s
  spring.start(m);
  play.start(m);
  for (int n = 0; n < 100; ++n) {
    // Stopping 80 kg from 0.8 m/s takes thousands of newtons; rounding of the speed, hundredths.
    CHECK_NEAR(static_cast<double>(spring.transmitted(m)), 0, 0.5);
    CHECK_NEAR(static_cast<double>(play.transmitted(m)), 0, 0.5);
  }
}

// The header's equations in steps of 0.5 us (semi-implicit), driven by the same motion.
struct SlowBacklash {
  double b, m2, D2, C2, L, k, c, knee;
  double x2 = 0, v2 = 0, z = 0;
  double force(double x, double v) const {
    const double d = x - x2, free = std::abs(d) - b / 2, s = d < 0 ? -1 : 1;
    return free <= 0 ? 0 : s * std::max(0.0, k * free + c * s * (v - v2));
  }
  void step(double x, double v, double h) {
    x2 += h * v2;
    z = std::clamp(z + h * v2, -knee, knee);
    v2 += h / m2 * (force(x, v) - D2 * v2 - C2 * z / knee - L);
  }
};

template <typename Real>
void backlash(double period_s, double load, double tolerance) {
  DriveFacts f = facts_at(period_s);
  f.constant_load = load;
  f.load_friction_share = 0.6;
  const double b = 40e-6, m2 = 100, w = kTwoPi * 200;
  auto effect = made<Backlash<Real>>({{b}}, f);
  SlowBacklash slow{b, m2, 0.6 * 700, 60, load, m2 * w * w, 2 * 0.3 * w * m2, f.friction_knee};
  slow.x2 = load > 0 ? -b / 2 - load / slow.k : 0;
  Path<Real> path;
  path.period_s = period_s;
  const auto x = [](double t) { return 0.02 * (1 - std::cos(kTwoPi * 2 * t)); };
  const auto v = [](double t) { return 0.02 * kTwoPi * 2 * std::sin(kTwoPi * 2 * t); };
  double squares = 0, error = 0, open = 0, deflection = 0;
  int n = 0, gaps = 0;
  for (double t = period_s; t < 3; t += period_s) {
    const int fine = static_cast<int>(period_s / 5e-7 + 0.5);
    for (int i = 0; i < fine; ++i) {
      const double s = t - period_s + (i + 1) * period_s / fine;
      slow.step(x(s), v(s), period_s / fine);
    }
    const double F = static_cast<double>(effect.transmitted(path.to(x(t))));
    const double expected = slow.force(x(t), v(t));
    squares += expected * expected;
    error += (F - expected) * (F - expected);
    deflection =
        std::max(deflection, std::abs(static_cast<double>(effect.deflection()) - (x(t) - slow.x2)));
    if (F == 0) open += period_s;
    if (expected == 0) ++gaps;
    ++n;
  }
  const double relative = std::sqrt(error / squares);
  check::figure("backlash, T = " + std::to_string(period_s * 1e6) + " us, load " +
                    std::to_string(static_cast<int>(load)) + " N: rms force error",
                relative);
  check::figure("  time in the gap", open, "s");
  CHECK(relative <= tolerance);
  CHECK_NEAR(open, gaps * period_s, 0.25 * gaps * period_s + 4 * period_s);
  // 2 Hz, 0.25 m/s, 316 N of inertia: gravity of 800 N never lets go, without it the gap opens.
  CHECK(load > 500 ? open == 0 : open > 0.005);
  CHECK(deflection < b);
}

// With the coupling on as well, there is one load: play in series with that spring.
void in_series() {
  DriveEffectsConfig c = config("backlash", {{0}});
  c.settings[1] = setting("flexible-coupling", {{120}, {0.1}, {0.3}});
  c.count = 2;
  DriveFacts f = facts_at(c.sample_period_s);
  f.coulomb = f.viscous = f.load_friction_share = 0;
  CHECK(DriveEffects<double>::validate(c, f).ok());
  DriveEffects<double> both, spring;
  both.configure(c, f);
  spring.configure(config("flexible-coupling", {{120}, {0.1}, {0.3}}), f);
  CHECK(both.load_shares().inertia == 0.3);
  Path<double> path;
  double worst = 0, most = 0;
  for (int n = 1; n < 8000; ++n) {
    const MotionState<double>& m = path.to(1e-3 * (1 - std::cos(kTwoPi * 5 * n * 125e-6)));
    const double a = both.force(m), b = spring.force(m);
    worst = std::max(worst, std::abs(a - b));
    most = std::max(most, std::abs(b));
  }
  // No play: the same load, but for the clearance of the contact (never pulls while it parts) and
  // the first-order damping of the flank, w h = 0.08.
  CHECK_NEAR(worst / most, 0, 0.04);
}

// Friction of the load: a bristle that bends up to the knee, in steps of 0.5 us.
struct RubbingLoad {
  double k, c, m2, viscous, coulomb, knee;
  double x2 = 0, v2 = 0, force = 0, bent = 0;
  void step(double x, double v, double h) {
    force = k * (x - x2) + c * (v - v2);
    v2 += h * (force - viscous * v2 - coulomb * bent / knee) / m2;
    x2 += h * v2;
    bent = std::clamp(bent + h * v2, -knee, knee);
  }
};

// Strokes with reversals, the load sticking at each, and a pause.
void rubbing_load(double period_s, double tolerance) {
  const double resonance = 40, damping = 0.05, share = 0.4, rub = 0.8;
  const DriveFacts facts = facts_at(period_s);
  auto effect = made<FlexibleCoupling<double>>({{resonance}, {damping}, {share}, {rub}}, facts);
  CHECK(effect.load_shares().inertia == share && effect.load_shares().friction == rub);
  const double m2 = share * facts.inertia, wr = kTwoPi * resonance;
  RubbingLoad slow{(1 - share) * m2 * wr * wr,
                   (1 - share) * m2 * 2 * damping * wr,
                   m2,
                   rub * facts.viscous,
                   rub * facts.coulomb,
                   facts.friction_knee};
  const double w = kTwoPi * 1.5;
  const auto x = [&](double t) { return t < 2 ? 4e-3 * (1 - std::cos(w * t)) : 0; };
  const double h = 0.5e-6;
  const auto inner = static_cast<long>(std::lround(period_s / h));
  Path<double> path;
  path.period_s = period_s;
  double error = 0, squares = 0, deflection = 0, stands = 0;
  long n = 0;
  for (double t = 0; t < 2.5;) {
    for (long i = 0; i < inner; ++i) {
      t = static_cast<double>(++n) * h;
      slow.step(x(t), (x(t) - x(t - h)) / h, h);
    }
    const double F = effect.transmitted(path.to(x(t)));
    error += (F - slow.force) * (F - slow.force);
    squares += slow.force * slow.force;
    if (std::abs(effect.state().rubbing) < 0.99 * slow.coulomb) stands += period_s;
    deflection =
        std::max(deflection, std::abs(static_cast<double>(effect.deflection()) - (x(t) - slow.x2)));
  }
  const double relative = std::sqrt(error / squares);
  check::figure("load that rubs, T = " + std::to_string(period_s * 1e6) + " us: rms force error",
                relative);
  check::figure("  deflection error", deflection, "m");
  check::figure("  time it stands", stands, "s");
  CHECK(relative <= tolerance);
  CHECK(stands > 0.5 && stands < 1.5);
}

// Pulled slowly from rest: spring and knee in series until it slides, then what friction at that
// speed takes.
void winding_up() {
  const DriveFacts facts = facts_at(125e-6);
  auto effect = made<FlexibleCoupling<double>>({{60}, {0.1}, {0.5}, {0.9}}, facts);
  const double k = 0.25 * 200 * std::pow(kTwoPi * 60, 2), v = 1e-4;
  const double bristle = 0.9 * facts.coulomb / facts.friction_knee;
  const double both = k * bristle / (k + bristle);
  const double damper = 0.25 * 200 * 2 * 0.1 * kTwoPi * 60 * v;
  Path<double> path;
  for (int n = 1; n <= 80000; ++n) {
    const double x = v * n * 125e-6;
    const double F = effect.transmitted(path.to(x));
    if (x > 1e-5 && both * x < 80) {
      CHECK_NEAR(effect.deflection(), both / k * x, 1e-7);
      CHECK_NEAR(F, both * x, 2 * damper);
    }
    if (n > 70000) CHECK_NEAR(F, 0.9 * (100 + 700 * v), 0.1);
  }
}

void springs() {
  auto spring = made<SpringLoad<double>>({{4000}, {0.12}});
  MotionState<double> m;
  m.position = 0.2;
  CHECK_NEAR(spring.force(m), 320, 1e-12);
  auto load = made<ConstantLoad<float>>({{-17}});
  CHECK(load.force(MotionState<float>{}) == -17.0F);
}

}  // namespace

int main() {
  // Second order in two small ways: what is left of the bend of the motor's path, here up to
  // 0.04 (w T)^2 at the frequency of the motion, and the damper, 0.006 (w T)^2 at the
  // antiresonance.
  for (const double hz : {10.0, 50.0, 70.0, 90.0, 140.0})
    for (const double T : {125e-6, 1e-3}) {
      const double bound =
          0.04 * std::pow(kTwoPi * hz * T, 2) + 0.006 * std::pow(kTwoPi * 69.7 * T, 2);
      transfer<double>(T, hz, bound);
      transfer<float>(T, hz, bound + 1e-5);
    }
  stable();
  rubbing_load(125e-6, 4e-3);
  rubbing_load(1e-3, 2e-2);
  winding_up();
  cutting_on_the_load();
  start_on_the_move();
  // Always on one flank, second order: (w h)^2/24 = 1e-3 of what rings at 200 Hz, which is little.
  // Across the gap, impacts sharper than a sample: measured 2.2 % and 4.4 % of the rms force.
  backlash<double>(125e-6, 800, 3e-4);
  backlash<double>(125e-6, 0, 0.03);
  backlash<float>(125e-6, 0, 0.03);
  backlash<double>(1e-3, 0, 0.06);
  in_series();
  springs();
  return check::done();
}
