// Programs that go all ways, for tests of motion in time.
#pragma once

#include <cmath>
#include <cstdio>
#include <random>
#include <sstream>
#include <string>

namespace motion_programs {

/// Lines and arcs of all kinds and lengths, in one of the modes of path control; arcs that rise,
/// too, where `helices` says so.
inline std::string random_program(unsigned seed, bool helices) {
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const char* modes[] = {"G64", "G64 P0.02", "G64 P0.3", "G64 P0.05 Q0", "G61", "G61.1"};
  std::ostringstream out;
  out << "G21 G17 G90 G94\nG91 F" << uniform(300, 12000) << '\n' << modes[seed % 6] << '\n';
  for (int i = 0; i < 60; ++i) {
    const double size = std::pow(10, uniform(-1, 1.5));
    const double angle = uniform(0, 6.28), x = size * std::cos(angle), y = size * std::sin(angle);
    switch (random() % 6) {
      case 0:
        out << "G0 X" << x << " Y" << y << " Z" << uniform(-3, 3) << '\n';
        break;
      case 1: {  // an arc, its radius the same at both ends
        const bool clockwise = random() % 2 == 0, rises = random() % 3 == 0 && helices;
        const double sweep = uniform(0.2, 6), turned = angle + (clockwise ? -sweep : sweep);
        char line[200];
        std::snprintf(line, sizeof line, "G%d X%.7f Y%.7f Z%.3f I%.7f J%.7f\n", clockwise ? 2 : 3,
                      size * (std::cos(turned) - std::cos(angle)),
                      size * (std::sin(turned) - std::sin(angle)), rises ? uniform(-2, 2) : 0.0, -x,
                      -y);
        out << line;
        break;
      }
      case 2:
        out << "G1 X" << x << " Y" << y << " Z" << uniform(-1, 1) << '\n';
        break;
      default:
        out << "G1 X" << x << " Y" << y << '\n';
    }
  }
  out << "M2\n";
  return out.str();
}

}  // namespace motion_programs
