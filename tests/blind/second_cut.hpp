// Mechanics of the second generator of blind cuts: teeth that move through the work step by step in
// time and remember where each tooth before them has been. Written from the text books alone
// (Martellotti 1941, Kline and DeVor 1983, Altintas 2000), without sight of the workflow or of the
// first generator.
//
// Frame: the cutter feeds to +x, turns clockwise, its tip is at R (sin phi, cos phi). Tooth j
// passes after tooth j - 1. Forces are those on the work.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

namespace blind::second_milling {

inline constexpr std::size_t kMostTeeth = 6;

/// Of the tool against the work, in one direction.
struct Mode {
  char axis = 'x';
  double hz = 0, damping = 0, mass_kg = 0;
};

struct Tooth {
  double angle = 0;  ///< beyond its place in an even pitch
  double reach = 0;  ///< beyond the nominal radius [m]
  double gone = 0;   ///< share of the depth of cut, from the tip up, that has no edge
};

enum class Direction { up, down, slot };

/// Everything that cuts. SI units.
struct Cutter {
  double radius = 0.01, helix_rad = 0;
  std::vector<Tooth> teeth;
  double ktc = 0, krc = 0, kac = 0;  ///< of the chip area
  double kte = 0, kre = 0;           ///< of the edge
  double exponent = 0;               ///< the coefficients go with (h / thickness)^-exponent
  double thickness = 1e-4;
  double ploughing = 0;  ///< radial force per depth of cut, per speed into the work over vc [N/m]
  double depth = 1e-3, immersion = 1e-3;
  Direction direction = Direction::slot;
  bool trochoid = false;     ///< paths of the teeth are exact, else circles that are moved on
  bool closed_form = false;  ///< integral over the helix, else slices; of circles only
  int slices = 20;
  bool regeneration = true;
  std::vector<Mode> modes;
  double face = -1e9, end = 1e9;  ///< of the work along the feed; the cutter's axis starts at 0
};

/// What the machine does at an instant.
struct Moment {
  double angle = 0, speed = 0;                    ///< of the spindle, rad and rad/s
  double feed = 0;                                ///< per tooth
  bool cutting = true;                            ///< else in the air
  double depth = 1, immersion = 1, hardness = 1;  ///< times what the cutter says
  double wear_t = 0, wear_r = 0;                  ///< more edge force
  std::array<double, kMostTeeth> tooth{1, 1, 1, 1, 1, 1};
};

struct Forces {
  std::vector<double> x, y, z;
  double largest_displacement = 0;
};

/// Angles of a tip between which there is work.
std::pair<double, double> engagement(const Cutter&, double immersion);

/// Eccentric clamping: the reach of each tooth.
void eccentric(Cutter&, double offset_m, double angle_rad);

Forces cut(const Cutter&, double step_s, std::size_t steps,
           const std::function<Moment(double t)>& at);

/// What a sensor on a spring of its own makes of a force; `share` of what it adds.
void ring(std::vector<double>& force, double step_s, double hz, double damping, double share = 1);

}  // namespace blind::second_milling
