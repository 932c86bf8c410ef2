// Any bytes as a program of moves: an error of one line, or a motion whose references are finite.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <sstream>

#include "servosense/sim/drive_motion.hpp"

using namespace servosense;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  LineReader lines(
      std::make_unique<std::istringstream>(std::string(reinterpret_cast<const char*>(data), size)),
      "fuzz");
  const Expected<Motion> motion = motion_from_program(lines);
  if (!motion) {
    if (motion.error().sentence.find('\n') != std::string::npos) std::abort();
    return 0;
  }
  if (!std::isfinite(motion->duration_s)) std::abort();
  for (const DriveMotion& drive : motion->drives)
    for (int i = -1; i <= 17; ++i) {
      const double t = motion->duration_s * i / 16;
      if (!std::isfinite(drive.reference(t))) std::abort();
      if (drive.load && !std::isfinite(drive.load(t))) std::abort();
    }
  return 0;
}
