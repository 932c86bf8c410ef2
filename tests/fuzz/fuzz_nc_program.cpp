// Any bytes as an NC program, in both dialects: an error of one line that names where, or moves of
// finite numbers. Never an endless run.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "servosense/process/motion/plain_time.hpp"
#include "servosense/process/motion/trajectory.hpp"
#include "servosense/process/program/program_reader.hpp"

using namespace servosense::process;

namespace {

void require(bool ok) {
  if (!ok) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view text(reinterpret_cast<const char*>(data) + 1, size - 1);
  ProgramOptions options;
  options.dialect = (data[0] & 1U) != 0 ? Dialect::fanuc : Dialect::linuxcnc;
  options.block_delete = (data[0] & 2U) != 0;
  if ((data[0] & 4U) != 0) options.tools = tool_table_of("T1 D6 Z10\nT2 D-1 X1\n", "tools").value();
  options.most_lines = 20'000;
  options.most_moves = 20'000;
  std::size_t moves = 0;
  PlainTime time({{0.5, 0.5, 0.5}}, [&](const CanonicalMove& move, double t_s) {
    ++moves;
    for (const AxisPoint* point : {&move.end, &move.machine})
      for (const double v : *point) require(!std::isnan(v));
    require(t_s >= 0 || std::isnan(t_s));
  });
  MotionLimits limits{{0.5, 0.5, 0.5}, {5, 4, 3}};
  if ((data[0] & 8U) != 0) limits.jerk_m_s3 = {50, 50, 50};
  std::size_t planned = 0;
  double before_s = 0;
  TrajectoryPlanner planner(limits, [&](const CanonicalMove&, double t_s) {
    ++planned;
    require(t_s >= before_s);
    before_s = t_s;
  });
  ProgramPlace place;
  const auto done = run_program(
      ProgramText::from(text, "fuzz"), options,
      [&](const CanonicalMove& move) {
        time.put(move);
        planner.put(move);
      },
      &place);
  planner.finish();
  require(planned == moves);
  require(moves <= options.most_moves);
  if (!done) {
    require(done.error().sentence.find('\n') == std::string::npos);
    require(done.error().sentence.starts_with("fuzz:"));
    require(place.line > 0 || ProgramText::from(text, "fuzz").lines().empty());
  }
  return 0;
}
