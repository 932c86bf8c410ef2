// Friction against warm-up, of a drive that is not the library's (oracles/shop_drive.hpp: Dahl's
// bristles, cascade control) whose viscous friction falls as it warms, and of one whose does not.
// Closed form: friction at a speed is the Coulomb friction and the viscous one times the speed.
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "check.hpp"
#include "oracles/idle_plant.hpp"
#include "oracles/shop_drive.hpp"
#include "servosense/identify/warm_up_study.hpp"

namespace {

using namespace servosense;
using oracle::ShopDrive;

constexpr double kPeriod_s = 1e-3, kLength_s = 240, kTau_s = 60;

DriveRecord record_of(const ShopDrive& d, unsigned seed, double viscous_drop, double speed_up) {
  const oracle::FeedProgram move{
      {{.distance = 0.06, .speed = 0.15}, {.distance = 0.2, .speed = 0.4}}};
  const auto run = d.run(
      kLength_s, seed,
      [&](double t) {
        oracle::Motion m = move.at(t * speed_up);
        m.v *= speed_up, m.a *= speed_up * speed_up;
        return m;
      },
      [&](double t, double, double v) { return viscous_drop * std::exp(-t / kTau_s) * v; });
  DriveRecord record{Channel::x, d.period_s, {}};
  for (std::size_t i = 0; i < run.size(); ++i) {
    DriveSample<double> s;
    s.increment = i == 0 ? 0 : static_cast<double>(run[i].counts - run[i - 1].counts) * d.count;
    s.effort = run[i].effort;
    if (i == 0) s.quality = Quality::restarted;
    record.samples.push_back(s);
  }
  return record;
}

DisturbanceObserverConfig observer(const ShopDrive& d) {
  DisturbanceObserverConfig c;
  c.sample_period_s = d.period_s;
  c.disturbance_cutoff_rad_s = c.velocity_cutoff_rad_s = 200;
  c.drive.friction_knee = 1e-5;
  return c;
}

void warms() {
  for (const unsigned seed : {71U, 72U, 73U}) {
    ShopDrive d;
    d.period_s = kPeriod_s;
    d.speed_loop_rad_s = 150;
    const double drop = 300;  // on 732 N s/m
    const auto found = study_warm_up(observer(d), record_of(d, seed, drop, 1), 12);
    CHECK(found.has_value());
    if (!found) continue;
    const double v = found->speed;
    const double true_change = drop * v * (std::exp(-230 / kTau_s) - std::exp(-10 / kTau_s));
    std::printf("  seed %u: %.1f +- %.1f N at %.3f m/s (%.1f), time constant %.0f s (%.0f)\n", seed,
                found->change.value, found->change.standard_error, v, true_change,
                found->time_constant_s, kTau_s);
    CHECK(found->changes && found->settles);
    CHECK_NEAR(found->change.value / true_change, 1, 0.03);
    CHECK_NEAR(found->time_constant_s / kTau_s, 1, 0.15);
    CHECK_NEAR(found->end / (94 + 732 * v), 1, 0.02);
    // What falls is the viscous friction.
    const WarmUpPart &first = found->parts.front(), &last = found->parts.back();
    CHECK(first.viscous && last.viscous && first.coulomb && last.coulomb);
    if (!first.viscous || !last.viscous) continue;
    std::printf("    viscous %.0f +- %.0f, then %.0f +- %.0f\n", first.viscous->value,
                first.viscous->standard_error, last.viscous->value, last.viscous->standard_error);
    const auto near_truth = [&](const Estimate& e, double t) {
      const double truth = 732 + drop * std::exp(-t / kTau_s);
      CHECK_NEAR(e.value / truth, 1, 0.05);
      CHECK(std::abs(e.value - truth) < 2 * e.standard_error);
    };
    near_truth(*first.viscous, 10);
    near_truth(*last.viscous, 230);
  }
}

void does_not() {
  int changed = 0;
  for (unsigned seed = 81; seed < 91; ++seed) {
    ShopDrive d;
    d.period_s = kPeriod_s;
    d.speed_loop_rad_s = 150;
    const auto found = study_warm_up(observer(d), record_of(d, seed, 0, 1), 12);
    CHECK(found.has_value());
    if (found) changed += found->changes;
  }
  CHECK(changed == 0);
}

void refuses() {
  ShopDrive d;
  d.period_s = kPeriod_s;
  d.speed_loop_rad_s = 150;
  DriveRecord record = record_of(d, 91, 0, 1);
  const DriveRecord slower = record_of(d, 92, 0, 0.7);
  const auto says = [&](const DriveRecord& of, std::size_t parts, const char* what) {
    const auto found = study_warm_up(observer(d), of, parts);
    CHECK(!found.has_value());
    if (!found) CHECK(found.error().sentence.find(what) != std::string::npos);
  };
  says(record, 5, "take 6 to 200");
  says(record, 201, "take 6 to 200");
  record.samples.insert(record.samples.end(), slower.samples.begin(), slower.samples.end());
  says(record, 12, "record one motion, again and again");
  record.samples.resize(5000);
  says(record, 6, "or record more");
}

}  // namespace

int main() {
  warms();
  does_not();
  refuses();
  return check::done();
}
