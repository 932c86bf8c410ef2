// Motion in time: profiles and corners against closed forms, and whole programs against what may
// never happen along the sampled path.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>

#include "check.hpp"
#include "motion_programs.hpp"
#include "servosense/process/motion/trajectory.hpp"
#include "servosense/process/program/program_reader.hpp"

namespace {

using namespace servosense::process;
using Eigen::Vector3d;

MotionLimits even_limits() {
  MotionLimits limits;
  limits.velocity_m_s = {0.1, 0.1, 0.1};
  limits.acceleration_m_s2 = {0.5, 0.5, 0.5};
  return limits;
}

struct Planned {
  Trajectory path;
  std::vector<double> ends_s;
  std::vector<std::size_t> lines;
  AxisPoint last{};
  double now_s = 0;
};

Planned plan(const std::string& program, const MotionLimits& limits) {
  Planned planned;
  TrajectoryPlanner planner(
      limits,
      [&](const CanonicalMove& move, double end_s) {
        planned.ends_s.push_back(end_s);
        planned.lines.push_back(move.line);
        if (is_motion(move.kind)) planned.last = move.machine;
      },
      [&](TimedMotion&& motion) { planned.path.add(std::move(motion)); });
  const auto done = run_program(ProgramText::from(program, "part.ngc"), {},
                                [&](const CanonicalMove& move) { planner.put(move); });
  CHECK(done.has_value());
  if (!done) std::printf("%s\n", done.error().sentence.c_str());
  planner.finish();
  planned.now_s = planner.now_s();
  return planned;
}

double seconds(const std::string& program, const MotionLimits& limits = even_limits()) {
  return plan(program, limits).path.duration_s();
}

void profiles() {
  const RampLimits hard{2}, soft{2, 40};
  // v0^2 + 2 a s; dv/a; the S-curve of Biagiotti and Melchiorri, section 3.4.
  CHECK_NEAR(reachable_speed(0.3, 0.2, hard), std::sqrt(0.09 + 2 * 2 * 0.2), 1e-12);
  CHECK_NEAR(ramp_seconds(0.1, 0.5, hard), 0.2, 1e-12);
  CHECK_NEAR(ramp_seconds(0.1, 0.5, soft), 0.2 + 2.0 / 40, 1e-12);
  CHECK_NEAR(ramp_seconds(0.5, 0.45, soft), 2 * std::sqrt(0.05 / 40), 1e-12);
  CHECK_NEAR(ramp_length(0, 0.5, soft), 0.25 * 0.3, 1e-12);
  std::mt19937_64 random(71);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  double worst_length = 0, worst_speed = 0, worst_acceleration = 0, worst_jerk = 0,
         worst_inverse = 0;
  for (int i = 0; i < 3000; ++i) {
    const RampLimits limits{uniform(0.2, 5), i % 2 ? uniform(5, 500) : kNoLimit};
    const double length = std::pow(10, uniform(-5, 0)), top = uniform(0.01, 1);
    double start = uniform(0, top), end = uniform(0, top);
    if (i % 5 == 0) start = end = 0;
    start = std::min(start, reachable_speed(end, length, limits));  // what a look-ahead sees to
    const auto profile = VelocityProfile::plan(length, start, top, end, limits);
    const double whole = profile.duration_s();
    // Integrated by the trapezoid rule from speeds that are asked for one by one.
    const int steps = 4000;
    double gone = 0, before = start, a_before = 0;
    for (int k = 1; k <= steps; ++k) {
      const double v = profile.velocity(whole * k / steps);
      gone += (v + before) / 2 * whole / steps;
      worst_speed = std::max(worst_speed, v - top);
      const double a = profile.acceleration(whole * k / steps);
      worst_acceleration = std::max(worst_acceleration, std::abs(a) / limits.acceleration_m_s2 - 1);
      if (limits.jerk_m_s3 < kNoLimit) {
        worst_jerk =
            std::max(worst_jerk, std::abs(a - a_before) * steps / whole / limits.jerk_m_s3 - 1);
        a_before = a;
      }
      before = v;
    }
    // The rule cuts off the bends of the speed: at most a dt^2 / 8 where it begins or ends to
    // change, twice that at a peak; jerk adds up to 4 a dt^2 / 12.
    worst_length =
        std::max(worst_length, (std::abs(gone - length) - 1e-8 * length) /
                                   (limits.acceleration_m_s2 * std::pow(whole / steps, 2)));
    CHECK_NEAR(profile.length_m(), length, 1e-9 * length + 1e-13);
    const double t = uniform(0, whole);
    worst_inverse = std::max(worst_inverse, std::abs(profile.time_at(profile.distance(t)) - t) *
                                                profile.velocity(t) / length);
  }
  check::figure("length by the trapezoid rule", worst_length, "a dt^2");
  CHECK(worst_length < 1);
  CHECK(worst_speed < 1e-12);
  CHECK(worst_acceleration < 1e-6);
  CHECK(worst_jerk < 1e-6);
  CHECK(worst_inverse < 1e-9);
}

void closed_forms() {
  MotionLimits limits = even_limits();
  const std::string stop = "G61.1\n";
  CHECK_NEAR(seconds(stop + "F3000 G1 X100\nM2\n"), 100.0 / 50 + 50.0 / 500, 1e-9);
  CHECK_NEAR(seconds(stop + "G0 X10\nM2\n"), 2 * std::sqrt(0.01 / 0.5), 1e-9);
  // LinuxCNC keeps half of the acceleration back where G64 has nothing to blend into.
  CHECK_NEAR(seconds("G64 F3000 G1 X100\nM2\n"), 100.0 / 50 + 50.0 / 250, 1e-9);
  // Of x and y the slower one counts, of velocity and of acceleration: 30/0.1, 40/0.3.
  limits.velocity_m_s = {0.1, 0.2, 1};
  limits.acceleration_m_s2 = {0.5, 0.3, 1};
  const double v = 50 / (30 / 0.1), a = 50 / (40 / 0.3);
  CHECK_NEAR(seconds(stop + "G0 X300 Y400\nM2\n", limits), 0.5 / v + v / a, 1e-9);
  limits = even_limits();
  // Rapids and feeds under their overrides; G95 under none.
  limits.feed_override = 0.5;
  limits.rapid_override = 0.25;
  CHECK_NEAR(seconds(stop + "F3000 G1 X100\nM2\n", limits), 100.0 / 25 + 25.0 / 500, 1e-9);
  CHECK_NEAR(seconds(stop + "G0 X100\nM2\n", limits), 100.0 / 25 + 25.0 / 500, 1e-9);
  CHECK_NEAR(seconds(stop + "S600 M3 G95 F2 G1 X100\nM2\n", limits), 100.0 / 20 + 20.0 / 500, 1e-9);
  limits = even_limits();
  limits.jerk_m_s3 = {10, 10, 10};
  CHECK_NEAR(seconds(stop + "F3000 G1 X100\nM2\n", limits), 2 + 0.1 + 0.5 / 10, 1e-9);
  // One line of many blocks is one move; stops between them are not.
  limits = even_limits();
  const std::string parts = "F3000 G1 X20\nX50\nX51\nX100\nM2\n";
  CHECK_NEAR(seconds("G61\n" + parts), 2.1, 1e-9);
  CHECK_NEAR(seconds("G64 P0.01\n" + parts), 2.2, 1e-9);
  CHECK_NEAR(seconds(stop + parts),
             2 + 3 * 0.1 + 2 * std::sqrt(0.001 / 0.5) - 1.0 / 50 + 3 * limits.cycle_s / 2, 1e-9);
  // A circle as fast as sqrt(3)/2 of the acceleration holds it, half of it along the path.
  const double fast = std::sqrt(std::sqrt(0.75) * 0.5 * 0.008);
  CHECK_NEAR(seconds(stop + "F60000 G2 X0 Y0 I8 J0\nM2\n"),
             2 * std::acos(-1.0) * 0.008 / fast + fast / 0.25, 1e-9);
  // What waits.
  limits.tool_change_s = 7;
  const auto waits = plan(stop + "T1 M6\nF3000 G1 X100\nG4 P2.5\nG1 X0\nM2\n", limits);
  CHECK_NEAR(waits.now_s, 7 + 2.1 + 2.5 + 2.1 + limits.cycle_s, 1e-9);
  CHECK(waits.ends_s.size() == 5 && waits.ends_s[0] == 7);
}

/// A right-angled corner within G64 P: by hand, with the arc's radius from the tolerance.
void corner() {
  MotionLimits limits = even_limits();
  const double tolerance = 0.1e-3;
  const auto path = plan("G64 P0.1 Q0\nF6000 G1 X50\nY50\nM2\n", limits).path;
  const double radius = tolerance / (std::sqrt(2.0) - 1);
  const double slow = std::sqrt(std::sqrt(0.75) * 0.5 * radius);
  // To 100 mm/s takes 10 mm, from there down to the arc's speed a little less.
  const double leg = 0.05 - radius;
  const double ramps = 0.1 / 0.5 + (0.1 - slow) / 0.5;
  const double ramped = 0.01 + (0.01 - slow * slow) / (2 * 0.5);
  // The second leg ends where nothing follows: it has half of the acceleration.
  const double last = (0.1 - slow) / 0.25 + 0.1 / 0.25;
  const double lasted = (0.01 - slow * slow) / (2 * 0.25) + 0.01 / (2 * 0.25);
  const double expected = ramps + (leg - ramped) / 0.1 + last + (leg - lasted) / 0.1 +
                          std::acos(-1.0) / 2 * radius / slow;
  CHECK_NEAR(path.duration_s(), expected, 1e-6);
  double nearest = 1;
  for (double t = 0; t < path.duration_s(); t += 1e-4) {
    const AxisPoint at = path.position(t);
    nearest = std::min(nearest, std::hypot(at[0] - 0.05, at[1]));
  }
  CHECK_NEAR(nearest, tolerance, 1e-8);
  CHECK_NEAR(path.position(1e3)[1], 0.05, 1e-15);
}

/// Nothing beyond the limits along the path, sampled each servo period and integrated. LinuxCNC's
/// rule for helices lets their centripetal acceleration go beyond: there are none here.
void sampled(double jerk_m_s3) {
  MotionLimits limits;
  limits.velocity_m_s = {0.12, 0.1, 0.06};
  limits.acceleration_m_s2 = {0.9, 0.7, 0.5};
  limits.jerk_m_s3 = {jerk_m_s3, jerk_m_s3, jerk_m_s3};
  double fastest = 0, hardest = 0, drift = 0, jump = 0;
  for (unsigned seed = 1; seed <= 60; ++seed) {
    const auto planned = plan(motion_programs::random_program(seed, false), limits);
    const Trajectory& path = planned.path;
    CHECK(std::is_sorted(planned.ends_s.begin(), planned.ends_s.end()));
    CHECK(std::is_sorted(planned.lines.begin(), planned.lines.end()));
    const AxisPoint end = path.position(path.duration_s());
    for (std::size_t k = 0; k < 3; ++k) CHECK_NEAR(end[k], planned.last[k], 1e-10);
    const double h = limits.cycle_s;
    Vector3d before = Vector3d::Zero();
    for (double t = 0; t < path.duration_s(); t += h) {
      const Vector3d v = path.velocity(t + h), middle = path.velocity(t + h / 2);
      const AxisPoint p0 = path.position(t), p1 = path.position(t + h);
      const Vector3d moved(p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]);
      drift = std::max(drift, (moved - h / 6 * (before + 4 * middle + v)).norm());
      jump = std::max(jump, moved.norm());
      for (int k = 0; k < 3; ++k) {
        const auto axis = static_cast<std::size_t>(k);
        fastest = std::max(fastest, std::abs(v[k]) / limits.velocity_m_s[axis]);
        const double a = std::abs(v[k] - before[k]) / h / limits.acceleration_m_s2[axis];
        hardest = std::max(hardest, a);
      }
      before = v;
    }
  }
  check::figure("greatest velocity, of the limit", fastest);
  check::figure("greatest acceleration over a servo period, of the limit", hardest);
  check::figure("integrated velocity against position", drift, "m a period");
  CHECK(fastest < 1 + 1e-9);
  CHECK(drift < 1e-6 && jump < 0.18e-3);  // a period at all axes' speed is 0.17 mm
  CHECK(hardest < 1 + 1e-6);
}

/// How far arcs go along x, y and z: helices and spirals in all planes, turned about z, against
/// points along them.
void extents() {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int i = 0; i < 60; ++i) {
    CanonicalMove arc;
    arc.kind = CanonicalMove::Kind::arc;
    arc.plane = i % 3 == 0 ? Plane::xy : i % 3 == 1 ? Plane::zx : Plane::yz;
    arc.turns = (i % 2 == 0 ? 1 : -1) * (1 + i % 4);
    const auto axes = plane_axes(arc.plane);
    for (std::size_t k = 0; k < 3; ++k) arc.begin[k] = 0.03 * unit(random);
    arc.end = arc.begin;
    arc.centre_m = {0.03 * unit(random), 0.03 * unit(random)};
    arc.end[axes[0]] = arc.centre_m[0] + 0.03 * unit(random);
    arc.end[axes[1]] = arc.centre_m[1] + 0.03 * unit(random);
    arc.end[axes[2]] += 0.01 * unit(random);
    arc.rotation_deg = i % 5 == 0 ? 90 * unit(random) : 0;
    const double turned = arc.rotation_deg * std::numbers::pi / 180;
    const double c = std::cos(turned), s = std::sin(turned);
    const auto machine = [&](const AxisPoint& p) {
      return AxisPoint{c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]};
    };
    arc.machine = machine(arc.end);
    const PathCurve curve = PathCurve::arc(arc, machine(arc.begin));
    const PathCurve plain = PathCurve::programmed(arc, arc.begin);
    CHECK(curve.is_arc() && plain.is_arc());
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [low, high] = curve.extent(k);
      double least = 1, greatest = -1;
      for (int n = 0; n <= 20000; ++n) {
        const AxisPoint p = plain.at(plain.length() * n / 20000);
        least = std::min(least, machine(p)[k]), greatest = std::max(greatest, machine(p)[k]);
      }
      CHECK_NEAR(low, least, 1e-8);  // a step of 4 turns is 1.3e-3 rad, its sagitta 6e-9
      CHECK_NEAR(high, greatest, 1e-8);
    }
  }
}

}  // namespace

int main() {
  extents();
  profiles();
  closed_forms();
  corner();
  sampled(kNoLimit);
  sampled(20);
  return check::done();
}
