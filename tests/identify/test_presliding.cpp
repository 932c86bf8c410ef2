// Presliding stiffness from drives that are pushed and do not break away. The drive is a mass on
// one bristle (Canudas de Wit 1995, eq. 2 to 4, breakaway constant), integrated by Runge-Kutta,
// with an encoder that counts and an effort with noise; it knows nothing of the library's closed
// form. Seeds 1 and 301 to 400 served development, 701 to 800 are judged.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/presliding.hpp"

namespace {

using namespace servosense;

struct BristleDrive {
  double mass = 1.8e-4, stiffness = 10, damping = 0.05, breakaway = 0.015, load = 0;
  double count = kTwoPi / 10000, noise = 0, period_s = 1e-3;

  using Three = std::array<double, 3>;  // position, speed, bristle
  [[nodiscard]] Three rate(const Three& s, double effort) const {
    const double slip = s[1] - stiffness * std::abs(s[1]) / breakaway * s[2];
    const double friction = stiffness * s[2] + damping * slip;
    return {s[1], (effort - friction) / mass, slip};
  }
  [[nodiscard]] Three step(const Three& s, double before, double after, double h) const {
    const auto ahead = [&](const Three& d, double by) {
      return Three{s[0] + by * d[0], s[1] + by * d[1], s[2] + by * d[2]};
    };
    const double middle = (before + after) / 2;
    const Three a = rate(s, before), b = rate(ahead(a, h / 2), middle);
    const Three c = rate(ahead(b, h / 2), middle), d = rate(ahead(c, h), after);
    Three next{};
    for (std::size_t i = 0; i < 3; ++i)
      next[i] = s[i] + h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
    return next;
  }

  struct Run {
    DriveRecord record;
    std::vector<double> position, effort;  // true; effort of friction alone
  };
  /// Pushed by `effort(t)`, beside the load.
  template <typename Effort>
  Run run(double seconds, unsigned seed, Channel channel, Effort&& effort) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    const double phase = std::uniform_real_distribution<double>(0, 1)(random);
    Run r;
    r.record = {channel, period_s, {}};
    Three s{};
    constexpr int kSteps = 4;
    const double h = period_s / kSteps;
    double last = 0;
    for (std::size_t i = 0; i < static_cast<std::size_t>(seconds / period_s); ++i) {
      const double t = static_cast<double>(i) * period_s;
      const double read = count * std::floor(s[0] / count + phase);
      DriveSample<double> sample;
      sample.increment = i == 0 ? 0 : read - last;
      sample.position = last = read;
      sample.effort = load + effort(t) + noise * normal(random);
      r.record.samples.push_back(sample);
      r.position.push_back(s[0]);
      r.effort.push_back(effort(t));
      for (int k = 0; k < kSteps; ++k) s = step(s, effort(t + k * h), effort(t + (k + 1) * h), h);
    }
    return r;
  }
};

double triangle(double phase) {  // in turns
  const double p = phase - std::floor(phase);
  return p < 0.25 ? 4 * p : p < 0.75 ? 2 - 4 * p : 4 * p - 4;
}

/// From sample `from` on, by least squares.
double true_slope(const BristleDrive::Run& run, std::size_t from) {
  double n = 0, x = 0, f = 0, xx = 0, xf = 0;
  for (std::size_t i = from; i < run.position.size(); ++i) {
    ++n;
    const double dx = run.position[i] - x, df = run.effort[i] - f;
    x += dx / n;
    f += df / n;
    xx += dx * (run.position[i] - x);
    xf += dx * (run.effort[i] - f);
  }
  return xf / xx;
}

DisturbanceObserverConfig known(const BristleDrive& d, double coulomb) {
  DisturbanceObserverConfig c;
  c.drive.inertia = d.mass;
  c.drive.friction_knee = d.mass > 1 ? 5e-6 : 1e-3;  // what a machine file has that says none
  c.drive.coulomb = coulomb;
  c.drive.constant_load = d.load;
  return c;
}

struct Tally {
  unsigned inside = 0, runs = 0;
  double worst = 0, stated = 0, off = 0;
  void add(const Estimate& e, double truth) {
    const double z = std::abs(e.value - truth) / e.standard_error;
    ++runs;
    off += e.value / truth - 1;
    inside += z <= 1.96;
    worst = std::max(worst, z);
    stated += e.standard_error / truth;
  }
  void judge(const char* what) const {
    std::printf(
        "  %-34s inside %3u of %3u, worst %.2f stated errors, stated %.2f %%, off by %.3f %%\n",
        what, inside, runs, worst, 100 * stated / runs, 100 * off / runs);
    CHECK(runs >= 95);
    CHECK(inside >= 0.9 * runs);
    CHECK(stated / runs < 0.1);
  }
};

void intervals(const char* name, bool axis, bool sine) {
  Tally slope, stiffness, breakaway;
  for (unsigned seed = 701; seed < 801; ++seed) {
    std::mt19937 random(seed);
    const auto within = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    BristleDrive d;
    if (axis) {
      d.mass = within(100, 400);
      d.stiffness = within(1e7, 5e7);
      d.breakaway = within(60, 200);
      d.damping = 2 * within(0.2, 0.7) * std::sqrt(d.mass * d.stiffness);
      d.load = within(0, 1700);
      d.count = 0.016 / (1 << 20);
    } else {
      d.stiffness = within(5, 12);
      d.breakaway = within(0.012, 0.02);
      d.damping = 2 * within(0.2, 0.7) * std::sqrt(d.mass * d.stiffness);
    }
    d.noise = within(0.002, 0.03) * d.breakaway;
    const double most = within(0.7, 0.9) * d.breakaway, period = within(3, 5);
    const auto run =
        d.run(4.25 * period, seed, axis ? Channel::z : Channel::spindle, [&](double t) {
          return most * (sine ? std::sin(kTwoPi * t / period) : triangle(t / period));
        });
    const auto found = identify_presliding(known(d, 0), run.record, d.count);
    if (!found) {  // a stiff motor that moves by less than four counts
      std::printf("  seed %u: %s\n", seed, found.error().sentence.c_str());
      const auto [least, most_at] = std::minmax_element(run.position.begin(), run.position.end());
      CHECK(*most_at - *least < 4.5 * d.count);
      continue;
    }
    slope.add(found->slope, true_slope(run, static_cast<std::size_t>(0.25 * period / d.period_s)));
    CHECK(found->one_bristle);
    if (!found->one_bristle) {
      std::printf("  seed %u: %s\n", seed, found->remarks.front().c_str());
      continue;
    }
    stiffness.add(found->stiffness, d.stiffness);
    breakaway.add(found->breakaway, d.breakaway);
    CHECK_NEAR(found->friction_knee * found->slope.value / found->breakaway.value, 1, 0.7);
  }
  slope.judge((std::string(name) + ", slope").c_str());
  stiffness.judge((std::string(name) + ", stiffness").c_str());
  breakaway.judge((std::string(name) + ", breakaway").c_str());
}

bool says(const Expected<PreslidingIdentification>& found, const char* what) {
  if (found) return false;
  const bool said = found.error().sentence.find(what) != std::string::npos;
  if (!said) std::printf("  it says: %s\n", found.error().sentence.c_str());
  return said;
}

void refusals() {
  BristleDrive d;
  const auto wave = [](double most) { return [most](double t) { return most * triangle(t / 4); }; };
  const auto identified = [](const BristleDrive& drive, const DriveRecord& record) {
    return identify_presliding(known(drive, 0), record, drive.count);
  };
  const DriveRecord good = d.run(16, 1, Channel::spindle, wave(0.012)).record;
  CHECK(identified(d, good).has_value());
  DriveRecord bad = good;
  for (auto& s : bad.samples) s.effort = 0.01;
  CHECK(says(identified(d, bad), "never changes"));
  bad = good;
  for (auto& s : bad.samples) s.effort = std::abs(s.effort);
  CHECK(says(identified(d, bad), "lost its sign"));
  bad = good;
  for (auto& s : bad.samples) s.effort = -s.effort;
  CHECK(says(identified(d, bad), "check the sign"));
  bad = good;
  bad.samples.resize(900);
  CHECK(says(identified(d, bad), "one way only"));
  BristleDrive coarse = d;
  coarse.count = kTwoPi / 2000;
  CHECK(says(identified(coarse, coarse.run(16, 1, Channel::spindle, wave(0.012)).record),
             "too coarse"));
  BristleDrive noisy = d;
  noisy.noise = 0.3;
  CHECK(says(identified(noisy, noisy.run(16, 1, Channel::spindle, wave(0.012)).record), "noise"));
  for (const double most : {0.016, 0.02, 0.2})
    CHECK(says(identified(d, d.run(16, 1, Channel::spindle, wave(most)).record), "slides"));
  // At breakaway itself nothing is said of a bristle.
  const auto edge = identified(d, d.run(16, 1, Channel::spindle, wave(0.0152)).record);
  CHECK(says(edge, "slides") || (edge.has_value() && !edge->one_bristle));
  BristleDrive heavy = d;
  heavy.mass = 0.2;
  heavy.damping = 1.5;
  CHECK(
      says(identified(heavy, heavy.run(16, 1, Channel::spindle, wave(0.012)).record), "too fast"));
}

/// What cannot be told is said, and the Coulomb friction helps where it is known.
void straight_line() {
  BristleDrive d;
  d.breakaway = 0.5;
  d.noise = 8e-3;
  const auto run = d.run(16, 5, Channel::spindle, [](double t) { return 0.03 * triangle(t / 4); });
  const auto alone = identify_presliding(known(d, 0), run.record, d.count);
  CHECK(alone.has_value() && !alone->one_bristle && alone->friction_knee == 0);
  CHECK(alone && alone->remarks.front().find("straight line") != std::string::npos);
  CHECK(alone && std::abs(alone->slope.value - d.stiffness) < 2.6 * alone->slope.standard_error);
  const auto with = identify_presliding(known(d, 0.5), run.record, d.count);
  CHECK(with.has_value() && with->one_bristle && !with->breakaway_fitted);
  CHECK(with &&
        std::abs(with->stiffness.value - d.stiffness) < 2.6 * with->stiffness.standard_error);
  CHECK(with && std::abs(with->friction_knee * with->slope.value / 0.5 - 1) < 1e-9);
}

/// Recorded: a servo motor of 7 counts a push, and a direct drive of two joints whose loop is not
/// that of one bristle.
void recorded_drives() {
  if (const std::string folder = check::outside_data("nolicence/lugre-servo-motor");
      !folder.empty()) {
    for (const char* name : {"sigma0_1", "sigma0_2", "Fs_1", "Fs_2", "Fs_3", "Fs_4"}) {
      std::ifstream file(folder + "/" + name + ".f32", std::ios::binary);
      DriveRecord record{Channel::spindle, 1e-3, {}};
      std::array<float, 3> row{};
      double last = 0;
      while (file.read(reinterpret_cast<char*>(row.data()), sizeof row)) {
        DriveSample<double> s;
        s.increment = record.samples.empty() ? 0 : static_cast<double>(row[0]) - last;
        last = static_cast<double>(row[0]);
        s.effort = static_cast<double>(row[2]);
        record.samples.push_back(s);
      }
      DisturbanceObserverConfig c;
      c.drive.friction_knee = 1e-3;
      const auto found = identify_presliding(c, record, kTwoPi / 10000);
      if (std::string(name).starts_with("Fs")) {
        CHECK(says(found, "slides") || says(found, "one way only"));
        continue;
      }
      CHECK(found.has_value() && found->one_bristle);
      if (!found) continue;
      std::printf(
          "  %s: slope %.3f +- %.3f, after a reversal %.2f +- %.2f Nm/rad, breakaway %.4f "
          "+- %.4f Nm, %.1f %% left\n",
          name, found->slope.value, found->slope.standard_error, found->stiffness.value,
          found->stiffness.standard_error, found->breakaway.value, found->breakaway.standard_error,
          100 * found->residual_share);
      CHECK_NEAR(found->slope.value, 5.0, 1.96 * found->slope.standard_error);
      CHECK_BETWEEN(found->slope.standard_error, 0.02, 0.5);
    }
  }
  if (const std::string folder = check::outside_data("nolicence/lugre-direct-drive");
      !folder.empty()) {
    struct Joint {
      const char* file;
      double published;
    };
    for (const auto& [name, published] :
         {Joint{"test3_sig0_j1_6_exp1_gan", 21419}, Joint{"test3_sig0_j1_6_exp2_gan", 21419},
          Joint{"test3_sig0_j2_08_exp1_gan", 1014}, Joint{"test3_sig0_j2_08_exp2_gan", 1014}}) {
      std::ifstream file(folder + "/" + name + ".csv");
      std::string line;
      std::getline(file, line);
      DriveRecord record{Channel::spindle, 15e-3, {}};
      double last = 0;
      while (std::getline(file, line)) {
        double t = 0, position = 0, speed = 0, torque = 0;
        CHECK(std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf", &t, &position, &speed, &torque) == 4);
        DriveSample<double> s;
        s.increment = record.samples.empty() ? 0 : (position - last) * kPi / 180;
        last = position;
        s.effort = torque;
        record.samples.push_back(s);
      }
      DisturbanceObserverConfig c;
      c.drive.friction_knee = 1e-3;
      const auto found = identify_presliding(c, record, 0);
      CHECK(found.has_value());
      if (!found) {
        std::printf("  %s: %s\n", name, found.error().sentence.c_str());
        continue;
      }
      std::printf("  %s: slope %.0f +- %.0f Nm/rad (published %.0f), %.1f %% left\n", name,
                  found->slope.value, found->slope.standard_error, published,
                  100 * found->residual_share);
      CHECK(!found->one_bristle);
    }
  }
}

}  // namespace

int main() {
  intervals("motor, triangle", false, false);
  intervals("motor, sine", false, true);
  intervals("vertical axis, triangle", true, false);
  intervals("vertical axis, sine", true, true);
  refusals();
  straight_line();
  recorded_drives();
  return check::done();
}
