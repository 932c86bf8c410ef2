// Motions from traces and programs, and several drives that run together.
#include <cmath>
#include <memory>
#include <sstream>
#include <string>

#include "../io/malformed.hpp"
#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/sim/drive_motion.hpp"

using namespace servosense;

namespace {

Expected<Motion> program(const std::string& text) {
  LineReader lines(std::make_unique<std::istringstream>(text), "moves.txt");
  return motion_from_program(lines);
}

Expected<Motion> from_trace(const std::string& text) {
  auto reader = TraceReader::from_stream(std::make_unique<std::istringstream>(text), "t.csv");
  if (!reader) return reader.error();
  auto trace = read_trace(*reader);
  if (!trace) return trace.error();
  return motion_from_trace(*trace, "t.csv");
}

template <typename Result>
void refused(const Result& result, const std::string& begin, const std::string& part) {
  CHECK(!result);
  if (result) return;
  CHECK_TEXT(result.error().sentence.substr(0, begin.size()), begin);
  if (result.error().sentence.find(part) == std::string::npos)
    CHECK_TEXT(result.error().sentence, part);
}

void test_program() {
  const auto m = program(
      "# two channels\n"
      "x limits 0.5 5 100\n"
      "x start 0.2\n"
      "x move 0.3 0.1   # to 0.3 m at 0.1 m/s\n"
      "spindle limits 1000 2000 1e5\n"
      "spindle cruise 500 2\n"
      "sync\n"
      "x move 0.2\n"
      "x load 100 1 1.5\n"
      "x load 20 1.2 9\n");
  CHECK(m.has_value());
  if (!m) return;
  CHECK(m->drives.size() == 2);
  const DriveMotion& x = m->drives[0];
  const DriveMotion& spindle = m->drives[1];
  CHECK(x.channel == Channel::x && x.loop == DriveLoop::position);
  CHECK(spindle.channel == Channel::spindle && spindle.loop == DriveLoop::velocity);
  CHECK_NEAR(x.initial_position, 0.2, 0);
  CHECK_NEAR(x.reference(0), 0.2, 0);
  // 0.1 m at 0.1 m/s, and V/a + a/j = 0.02 + 0.05 s to get there; but V < a^2/j, so 2 sqrt(V/j).
  const double move_s = 1 + 2 * std::sqrt(0.1 / 100);
  CHECK_NEAR(x.reference(move_s), 0.3, 1e-12);
  CHECK(x.reference(move_s - 1e-3) < 0.3);
  // The spindle takes 500/2000 + 2000/1e5 s up, 2 s, and as long down; x waits for it.
  const double spin_s = 2 + 2 * (0.25 + 0.02);
  CHECK_NEAR(spindle.reference(1), 500, 1e-9);
  CHECK_NEAR(spindle.reference(spin_s), 0, 1e-9);
  CHECK_NEAR(x.reference(spin_s), 0.3, 1e-12);
  CHECK_NEAR(x.reference(m->duration_s), 0.2, 1e-12);
  CHECK(m->duration_s > spin_s + 0.1 / 0.5);
  CHECK_NEAR(x.load(0.9), 0, 0);
  CHECK_NEAR(x.load(1.3), 120, 0);
  CHECK_NEAR(x.load(1.5), 20, 0);

  refused(program(""), "moves.txt: ", "moves nothing");
  refused(program("x dwell 0\n"), "moves.txt: ", "moves nothing");
  refused(program("tool move 1\n"), "moves.txt:1: ", "not 'tool'");
  malformed::check_all("motion", 10, [](const std::string& path) {
    const auto motion = read_motion(path);
    return motion ? Error{} : motion.error();
  });
  refused(program("x dwell -1\n"), "moves.txt:1: ", "");
}

void test_trace() {
  const auto m = from_trace(
      "t_s,x.command_position_m,x.position_m,y.velocity_m_s,spindle.speed_rad_s,tool.force_x_N,"
      "dyno.force_y_N,tool.torque_Nm\n"
      "1,0.1,9,0,100,-50,7,2\n"
      "1.5,,9,0.5,,-70,,4\n"
      "2,0.3,9,1,200,-70,9,4\n");
  CHECK(m.has_value());
  if (!m) return;
  CHECK_NEAR(m->duration_s, 1, 1e-12);
  CHECK(m->drives.size() == 3);
  const DriveMotion &spindle = m->drives[0], &x = m->drives[1], &y = m->drives[2];
  // A column at a slower rate is a line between its own rows.
  CHECK_NEAR(spindle.reference(0.5), 150, 1e-12);
  CHECK_NEAR(x.reference(0.25), 0.15, 1e-12);
  CHECK_NEAR(x.initial_position, 0.1, 1e-15);
  CHECK(y.loop == DriveLoop::velocity);
  CHECK_NEAR(y.reference(0.75), 0.75, 1e-12);
  // The tool pushes back on the work with what pushes on the tool.
  CHECK_NEAR(x.load(0.25), 60, 1e-12);
  CHECK_NEAR(y.load(0.5), 8, 1e-12);
  CHECK_NEAR(spindle.load(0), 2, 1e-12);
  CHECK_NEAR(spindle.reference(99), 200, 0);

  refused(from_trace("t_s,x.position_m\n0,1\n"), "t.csv: ", "two rows");
  refused(from_trace("t_s,x.current_A\n0,1\n1,1\n"), "t.csv: ", "no drive is told to move");
  refused(from_trace("t_s,x.position_m\n0,nan\n1,\n"), "t.csv: ", "no drive is told to move");
}

RunningDrive axis(Channel channel, const std::string& moves) {
  RunningDrive drive;
  drive.config.drive.inertia = 100;
  drive.config.drive.unit_per_turn = 0.01;
  drive.config.controller.position_gain_per_s = 40;
  drive.config.controller.velocity_gain_A_s = 3e4;
  drive.config.controller.velocity_integral_per_s = 60;
  auto motion = program(moves);
  if (!motion) check::fail(__FILE__, __LINE__) << motion.error().sentence << '\n';
  drive.motion = std::move(motion->drives[0]);
  drive.motion.channel = channel;
  return drive;
}

/// Effort of a drive that stands still while another one accelerates: cross-talk is a load.
void test_cross_talk() {
  const std::string moving = "y limits 0.5 2 20\ny move 0.2\n";
  std::vector<RunningDrive> drives = {axis(Channel::x, "x dwell 2\n"), axis(Channel::y, moving)};
  drives[0].cross_talk = {{Channel::y, 30.0}};
  drives[1].motion.initial_position = 0;
  double worst = 0, largest = 0, effort_sum = 0, load_sum = 0;
  double before = 0, last = 0;
  auto done = run_drives(drives, 1, [&](double, std::span<const DriveSimSample> now) {
    const double acceleration = (now[1].velocity - before) / 125e-6;
    before = now[1].velocity;
    // The load of this sample is that of the acceleration one sample ago.
    worst = std::max(worst, std::abs(now[0].cutting - 30 * last));
    last = acceleration;
    largest = std::max(largest, std::abs(now[0].cutting));
    effort_sum += now[0].effort * now[0].effort;
    load_sum += now[0].cutting * now[0].cutting;
    return Expected<Done>(Done{});
  });
  CHECK(done.has_value());
  CHECK_NEAR(worst, 0, 1e-9);
  // The axis reaches 2 m/s2, so the load peaks a little above 60 N.
  CHECK_BETWEEN(largest, 55, 80);
  // A stiff drive carries the slow load: its effort is the load.
  CHECK_NEAR(std::sqrt(effort_sum / load_sum), 1, 0.1);

  // A share of its effort, its velocity, its position.
  for (const CrossTalkOf of : {CrossTalkOf::effort, CrossTalkOf::velocity, CrossTalkOf::position}) {
    drives[0].cross_talk = {{Channel::y, 0.5, of}};
    DriveSimSample y{};
    double apart = 0, strongest = 0;
    done = run_drives(drives, 1, [&](double, std::span<const DriveSimSample> now) {
      const double felt = of == CrossTalkOf::effort     ? y.effort
                          : of == CrossTalkOf::velocity ? y.velocity
                                                        : y.position;
      apart = std::max(apart, std::abs(now[0].cutting - 0.5 * felt));
      strongest = std::max(strongest, std::abs(now[0].cutting));
      y = now[1];
      return Expected<Done>(Done{});
    });
    CHECK(done.has_value());
    CHECK_NEAR(apart, 0, 1e-12);
    CHECK_BETWEEN(strongest, of == CrossTalkOf::effort ? 50 : 0.09, 500);
  }

  drives[0].cross_talk.clear();
  double quiet = 0;
  done = run_drives(drives, 1, [&](double, std::span<const DriveSimSample> now) {
    quiet = std::max(quiet, std::abs(now[0].effort));
    return Expected<Done>(Done{});
  });
  CHECK(done.has_value());
  CHECK_NEAR(quiet, 0, 0);
}

void test_runs() {
  std::vector<RunningDrive> drives = {
      axis(Channel::x, "x start 0.7\nx limits 0.5 2 20\nx move 0.8\n")};
  drives[0].config.encoder.counts_per_turn = 10000;
  drives[0].config.encoder.initial_counts = 5;
  std::size_t rows = 0;
  std::int64_t first = 0;
  double last = 0;
  auto done = run_drives(drives, 1, [&](double t, std::span<const DriveSimSample> now) {
    CHECK_NEAR(t, static_cast<double>(rows) * 125e-6, 1e-12);
    if (rows++ == 0) first = now[0].angle_counts;
    last = now[0].position;
    return Expected<Done>(Done{});
  });
  CHECK(done.has_value());
  CHECK(rows == 8001);
  CHECK(first == 700000 + 5);  // 0.7 m at 1 um a count, no jump at the start
  CHECK_NEAR(last, 0.8, 1e-5);

  // What the caller answers ends the run.
  rows = 0;
  done = run_drives(drives, 1, [&](double, std::span<const DriveSimSample>) -> Expected<Done> {
    if (++rows == 3) return device_error("disk full");
    return Done{};
  });
  refused(done, "disk full", "");
  CHECK(rows == 3);

  refused(run_drives({}, 1, {}), "there is no drive", "");
  drives.push_back(axis(Channel::y, "y dwell 1\n"));
  drives[1].config.sample_period_s = 1e-3;
  refused(run_drives(drives, 1, {}), "drives that run together", "");
  drives[1].config.sample_period_s = 125e-6;
  drives[1].config.drive.inertia = -1;
  refused(run_drives(drives, 1, {}), "y: drive simulator", "inertia");
}

}  // namespace

int main() {
  test_program();
  test_trace();
  test_cross_talk();
  test_runs();
  return check::done();
}
