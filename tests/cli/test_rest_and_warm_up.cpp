// What monitor writes about the estimate of a spindle that stands, warms up and cuts: the band, and
// the friction that is followed.
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "cli/program.hpp"

namespace {

using namespace program_test;

constexpr double kViscous = 8e-4, kCoulomb = 0.12, kSpeed = 400;

/// 3 s at rest, run-up, 60 s in the air with viscous friction 40 % above the file's, a cut of 1 Nm
/// for 20 s, 20 s in the air; a current that holds 0.08 Nm at rest.
std::string trace() {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::string text = "t_s,spindle.angle_counts,spindle.torque_Nm\n";
  double angle = 0, speed = 0;
  for (int i = 0; i < 105000; ++i) {
    const double t = i * 1e-3;
    const double acceleration = t > 3 && speed < kSpeed - 1e-9 ? 400 : 0;
    const double cut = t > 65 && t < 85 ? 1 : 0;
    const double friction = t > 3 ? kCoulomb + 1.4 * kViscous * speed : 0.08;
    char row[96];
    std::snprintf(row, sizeof row, "%.3f,%lld,%.6g\n", t,
                  static_cast<long long>(std::floor(angle * 65536 / (2 * M_PI))),
                  friction + cut + 0.005 * acceleration + 0.01 * normal(random));
    text += row;
    speed += 1e-3 * acceleration;
    angle += 1e-3 * speed;
  }
  return text;
}

std::string machine(const std::string& observer) {
  return "[machine]\nsample_rate_hz = 1000\n[spindle]\ntorque_constant_Nm_per_A = 1\n"
         "inertia_kg_m2 = 0.005\nviscous_friction_Nm_s_per_rad = 8e-4\ncoulomb_friction_Nm = "
         "0.12\nencoder_counts_per_rev = 65536\n[monitor.chatter]\nchatter_threshold_Nm2 = 1\n"
         "[observer.spindle]\ndisturbance_cutoff_rad_s = 300\nvelocity_cutoff_rad_s = 300\n" +
         observer;
}

struct Mean {
  double estimate = 0, band = 0;
};
/// From the estimates, between two times.
Mean mean(const std::string& file, double from, double to) {
  Mean m;
  double n = 0;
  for (const std::string& line : lines(content(folder / file))) {
    double t = 0, estimate = 0, band = 0;
    if (std::sscanf(line.c_str(), "%lf,%lf,%lf", &t, &estimate, &band) != 3) continue;
    if (t < from || t > to) continue;
    ++n;
    m.estimate += (estimate - m.estimate) / n;
    m.band += (band - m.band) / n;
  }
  CHECK(n > 100);
  return m;
}

void tests() {
  put("cold.csv", trace());
  const std::string level = "[monitor.collision]\ncutting_torque_Nm = 0.1\n";
  put("plain.ini", machine(level));
  put("follow.ini", machine("follow_friction_share = 0.5\n" + level));
  put("untold.ini", machine("follow_friction_share = 0.5\n"));
  const Outcome plain = run("monitor --machine plain.ini --trace cold.csv --estimates plain.csv");
  that(plain.status == 0, plain, "watches", __LINE__);
  const Outcome o = run("monitor --machine follow.ini --trace cold.csv --estimates follow.csv");
  that(o.status == 0, o, "watches", __LINE__);
  that(contains(o.err, "friction is followed") && contains(o.err, "friction was followed over"), o,
       "says so", __LINE__);
  CHECK(!contains(plain.err, "followed"));

  const std::string estimates = content(folder / "plain.csv");
  CHECK(contains(estimates, "t_s,spindle.torque_Nm,spindle.torque_band_Nm\n"));
  CHECK(contains(estimates, "noise left out"));  // no run has told its noise floor
  // At rest the observer takes the friction for none where 0.08 Nm hold: the band says so.
  const Mean rest = mean("plain.csv", 1, 2.9);
  CHECK_NEAR(std::abs(rest.estimate), 0.08, 0.01);
  CHECK_BETWEEN(rest.band, kCoulomb, 3 * kCoulomb);
  // In motion a tenth of the friction; which 40 % of the viscous part is not.
  const Mean cold = mean("plain.csv", 50, 64);
  CHECK_NEAR(cold.estimate, 0.4 * kViscous * kSpeed, 0.01);
  CHECK_NEAR(cold.band, 0.1 * (kCoulomb + kViscous * kSpeed), 0.002);

  CHECK_NEAR(mean("follow.csv", 50, 64).estimate, 0, 0.01);
  CHECK_NEAR(mean("follow.csv", 70, 84).estimate, 1, 0.01);
  CHECK_NEAR(mean("follow.csv", 90, 104).estimate, 0, 0.01);
  CHECK_NEAR(mean("plain.csv", 70, 84).estimate, 1 + 0.4 * kViscous * kSpeed, 0.01);

  const Outcome untold = run("monitor --machine untold.ini --trace cold.csv");
  that(contains(untold.err, "lacks cutting_torque_Nm") && !contains(untold.err, "was followed"),
       untold, "says why not", __LINE__);
}

}  // namespace

int main() { return in_own_folder("rest_and_warm_up", tests); }
