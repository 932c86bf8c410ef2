// How many blocks a second are cut, and in how much memory: a stock of 200 mm at 0.1 mm, finished
// by a ball of 10 mm in blocks of 0.8 mm.
#include <sys/resource.h>

#include <chrono>

#include "cut_parts.hpp"

using namespace cut_parts;

int main(int count, char** words) {
  const bool nightly = check::nightly(count, words);
  const int rows = nightly ? 400 : 10, row_blocks = 250;
  std::string program = "G0 Z20\nG0 X0 Y0\n";
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < row_blocks; ++i) {
      const double x = 200.0 * (j % 2 == 0 ? i : row_blocks - 1 - i) / (row_blocks - 1);
      const double y = 0.5 * j;
      char text[80];
      std::snprintf(text, sizeof text, "G1 X%.3f Y%.3f Z%.4f\n", x, y,
                    -3 - 2 * std::sin(x / 20) * std::cos(y / 25));
      program += text;
    }
  const auto begun = std::chrono::steady_clock::now();
  const Cut c =
      cut(box_mm(0, 0, -200, 200, 200, 0), {cutter_of({CutterKind::ball, 10e-3})}, program);
  const double wall_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  CHECK_TEXT(c.error, "");
  CHECK(c.steps.size() >= static_cast<std::size_t>(rows * row_blocks));
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  const double processor_s = static_cast<double>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
                             1e-6 * static_cast<double>(used.ru_utime.tv_usec);
  const double memory_mb = static_cast<double>(used.ru_maxrss) / 1024;
  check::figure("blocks", rows * row_blocks);
  check::figure("wall time", wall_s, "s");
  check::figure("processor time", processor_s, "s");
  check::figure("memory", memory_mb, "MB");
  CHECK(memory_mb < 1000);
  CHECK_NEAR(c.removed_m3 + c.left_m3, 8e-3, 1e-9);
  return check::done();
}
