// Signs of an absolute effort against the signed one that it was made from: a spindle of an oracle
// that runs up, turns round, cuts and brakes; and no flicker.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "check.hpp"
#include "oracles/weakened_spindle.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/identify/effort_sign.hpp"
#include "servosense/identify/idle_signs.hpp"

using namespace servosense;

namespace {

struct Record {
  std::vector<DriveSample<double>> samples;  // absolute
  std::vector<double> truth;
};

Record record(const oracle::WeakenedSpindle& s, double cut_Nm, unsigned seed) {
  Record r;
  double last = 0;
  s.record(
      20,
      [&](double t) {
        constexpr double kShares[] = {0.3, 1, 0.5, 1, -0.4, -1, -0.2, 0.7, 1, 0};
        return s.top_rad_s * kShares[std::min(static_cast<int>(t / 2), 9)];
      },
      [&](double t) { return t > 2 && t < 6 ? cut_Nm : 0.0; }, seed,
      [&](double, std::int64_t counts, double current) {
        DriveSample<double> d;
        const double angle = static_cast<double>(counts) * kTwoPi / s.counts;
        d.increment = angle - last;
        last = angle;
        r.truth.push_back(current * s.constant);
        d.effort = std::abs(current * s.constant);
        r.samples.push_back(d);
      });
  return r;
}

void against_truth(unsigned seed, double cut) {
  oracle::WeakenedSpindle s = oracle::WeakenedSpindle::random(seed);
  s.base_rad_s = 1e9;
  Record r = record(s, cut * s.coulomb, seed);
  EffortSignConfig c;
  c.inertia = 1.02 * s.inertia;  // as well as they are known
  c.viscous = 0.95 * s.viscous;
  c.coulomb = 1.05 * s.coulomb;
  c.grain = kTwoPi / s.counts;
  const double sure = resolve_signs(r.samples, c);
  const double noise = s.noise_A * s.constant;
  std::size_t wrong = 0, changes = 0;
  for (std::size_t i = 1; i < r.samples.size(); ++i) {
    const bool off = r.samples[i].effort * r.truth[i] < 0;
    if (off && std::abs(r.truth[i]) > 4 * noise) ++wrong;  // about nothing noise has the sign
    if (r.samples[i].effort * r.samples[i - 1].effort < 0) ++changes;
  }
  const double share = static_cast<double>(wrong) / static_cast<double>(r.samples.size());
  std::printf("  seed %u: %.4f %% wrong beyond noise, %zu changes, sure %.2f %%\n", seed,
              100 * share, changes, 100 * sure);
  CHECK(share < 1e-3);
  CHECK(sure > 0.9);
  CHECK(changes <= 12);  // ten speeds: never more often than the drive brakes or turns
}

/// In pieces as they come, answers are those of the whole record; each sample has one.
void in_pieces() {
  oracle::WeakenedSpindle s = oracle::WeakenedSpindle::random(3);
  s.base_rad_s = 1e9;
  Record r = record(s, 0, 3);
  EffortSignConfig c;
  c.inertia = s.inertia;
  c.viscous = s.viscous;
  c.coulomb = s.coulomb;
  c.grain = kTwoPi / s.counts;
  EffortSign sign(c);
  std::vector<int> late;
  for (const auto& d : r.samples) {
    sign.push(d.increment, d.effort);
    if (late.size() % 7 != 3)  // not at once
      while (const auto a = sign.pop()) late.push_back(a->sign);
    else if (const auto a = sign.pop())
      late.push_back(a->sign);
  }
  sign.finish();
  while (const auto a = sign.pop()) late.push_back(a->sign);
  CHECK(late.size() == r.samples.size());
  CHECK(sign.answered() == r.samples.size());
  resolve_signs(r.samples, c);
  std::size_t other = 0;
  for (std::size_t i = 0; i < std::min(late.size(), r.samples.size()); ++i)
    if (r.samples[i].effort != 0 && (r.samples[i].effort > 0 ? 1 : -1) != late[i]) ++other;
  CHECK(other == 0);
}

/// Without inertia, braking is not sure, and driving is.
void without_inertia() {
  oracle::WeakenedSpindle s = oracle::WeakenedSpindle::random(5);
  s.base_rad_s = 1e9;
  Record r = record(s, 0, 5);
  EffortSignConfig c;
  c.braking = 5;
  resolve_signs(r.samples, c, Quality::gap);
  std::size_t unsure = 0, wrong = 0;
  for (std::size_t i = 0; i < r.samples.size(); ++i) {
    if (has(r.samples[i].quality, Quality::gap))
      ++unsure;
    else if (r.samples[i].effort * r.truth[i] < 0 &&
             std::abs(r.truth[i]) > 5 * s.noise_A * s.constant)
      ++wrong;
  }
  CHECK(unsure > r.samples.size() / 50);
  CHECK(wrong < r.samples.size() / 1000);
}

/// Stretches of a record whose cuts were left out: what jumps from one to the next is no motion,
/// and the drive is found as from the whole record.
void with_gaps() {
  oracle::WeakenedSpindle s = oracle::WeakenedSpindle::random(7);
  s.base_rad_s = 1e9;
  const Record whole = record(s, 0, 7);
  // Half of every run-up, and most of the steady speed: of what is left it brakes a third of the
  // time.
  const auto without = [](std::size_t i) {
    const double t = static_cast<double>(i) * 125e-6, in = std::fmod(t, 2);
    const int move = static_cast<int>(t / 2);
    const bool runs_up = move == 1 || move == 3 || move == 5 || move == 8;
    return (runs_up && in < 0.6) || in > 1.3;
  };
  DriveRecord pieces{Channel::spindle, 125e-6, {}};
  bool gap = false;
  for (std::size_t i = 0; i < whole.samples.size(); ++i) {
    if (!without(i)) {
      pieces.samples.push_back(whole.samples[i]);
      // As DriveInput has it: where the drive went in the gap is no motion.
      if (gap) pieces.samples.back().increment = 0;
      if (gap) pieces.samples.back().quality |= Quality::restarted;
    }
    gap = without(i);
  }
  DisturbanceObserverConfig base;
  base.drive.inertia = 0;
  base.sample_period_s = 125e-6;
  const auto sure = find_idle_signs(base, pieces, kTwoPi / s.counts, {});
  if (!sure) std::puts(sure.error().sentence.c_str());
  CHECK(sure && *sure > 0.9);
  const auto found = identify_idle(base, pieces, {});
  CHECK(found.has_value());
  if (!found) return;
  CHECK_NEAR(found->inertia.value / s.inertia, 1, 0.01);
  CHECK_NEAR(found->coulomb.value / s.coulomb, 1, 0.03);
}

/// A few samples, fewer than it looks around: every one is answered.
void short_records() {
  for (const std::size_t n : {0U, 1U, 2U, 64U, 129U, 130U, 200U}) {
    std::vector<DriveSample<double>> samples(n);
    for (auto& d : samples) d.effort = 1, d.increment = -1e-4;
    EffortSignConfig c;
    c.inertia = 0.01;
    (void)resolve_signs(samples, c);
    if (n > 200) continue;
    for (const auto& d : samples) CHECK(std::abs(d.effort) == 1);
  }
}

}  // namespace

int main() {
  for (const unsigned seed : {1U, 2U, 3U, 4U, 5U, 8U}) {
    against_truth(seed, 0);
    against_truth(seed, 2);
  }
  in_pieces();
  without_inertia();
  with_gaps();
  short_records();
  return check::done();
}
