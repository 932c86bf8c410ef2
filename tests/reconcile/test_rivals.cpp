// What drives are known to have and the catalogue lacks gets no name, and the report says what it
// looks like; the effects it resembles keep theirs. The force is computed from sines.
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>

#include "check.hpp"
#include "servosense/reconcile/drive.hpp"
#include "sine_motion.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

template <typename Force>
Report report_of(const char* what, Force force) {
  const auto outcome = reconcile_drive(sine_axis(force), {});
  CHECK(outcome);
  if (!outcome) return {};
  const Report& r = outcome->report;
  std::printf("%s: gap %.3g to %.3g N, %s\n", what, r.gap_before, r.gap_after,
              r.effects.empty() ? r.residual_detail.c_str() : r.effects[0].name.c_str());
  return r;
}

void check_named(const Report& r, const char* name) {
  CHECK(r.effects.size() == 1);
  for (const FoundEffect& e : r.effects) CHECK_TEXT(e.name, name);
}

void check_refused(const Report& r, const char* rival) {
  CHECK(r.effects.empty());
  CHECK_TEXT(name_of(r.verdict), "unexplained");
  CHECK(r.residual_detail.find(rival) != std::string::npos);
  CHECK(r.residual_detail.find("not in the catalogue") != std::string::npos);
  // Nor is it an effect that this motion could show.
  for (const auto& n : r.not_testable) CHECK(n.name != rival);
  for (const auto& d : r.detectable) CHECK(d.name != rival);
  CHECK(!r.resembles.empty());
  CHECK(r.summary.find("it looks like " + r.resembles) != std::string::npos);
}

Motion motion_at(double t) { return along_sines({0.31, 0.83, 2.3}, {0.1, 0.03, 0.003}, t); }

/// All that sine_axis() exerts, without the rest.
double force_of_motion(double t, double direction) {
  const Motion m = motion_at(t);
  return 100 * m.acceleration + 300 * m.velocity + 60 * direction;
}

double warmth(double t) { return 1 - std::exp(-t / 6); }

double at_a_speed(double t, double speed) {
  const double off = (std::abs(motion_at(t).velocity) - speed) / (0.2 * speed);
  return 1 / (1 + off * off * off * off);  // flatter than the rival's, which is no law either
}

}  // namespace

int main() {
  const auto friction = [](double direction) { return 60 * direction; };
  check_named(
      report_of("spring", [&](double, double x,
                              double direction) { return friction(direction) + 200 * (x - 0.1); }),
      "spring-load");
  check_refused(report_of("hardening spring",
                          [&](double, double x, double direction) {
                            return friction(direction) + 3000 * std::pow(x - 0.1, 3) +
                                   60 * (x - 0.1);
                          }),
                "hardening-spring");
  check_named(report_of("friction that falls",
                        [&](double t, double, double direction) {
                          return friction(direction) - 15 * warmth(t) * direction;
                        }),
              "thermal-friction-drift");
  check_refused(report_of("force constant that falls",
                          [&](double t, double, double direction) {
                            return friction(direction) +
                                   0.1 * warmth(t) * force_of_motion(t, direction);
                          }),
                "force-constant-drift");
  check_refused(report_of("friction at a speed",
                          [&](double t, double, double direction) {
                            return friction(direction) - 20 * direction * at_a_speed(t, 0.15);
                          }),
                "friction-at-a-speed");
  return check::done();
}
