// Machines of the second generator and what is hidden in them, drawn at random.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "case.hpp"
#include "draw.hpp"
#include "second_motion.hpp"
#include "second_plant.hpp"

namespace blind::second {

/// What is drawn: any drive, or those of the text books, which the other draws leave out (Altintas
/// 2012, ch. 5 and Al-Bender, Lampaert and Swevers 2005): a mode of the ball screw or the belt at
/// 30 to 80 Hz, friction that slips over a decade of travel, a current loop below 300 Hz. The file
/// of such a machine knows mode and loop.
enum class Kind { any, text_book };

struct Drawn {
  Plant plant;
  Limits limits;
  double seconds = 30;
  bool turns = false;
  double counts = 0;  ///< of the encoder a turn
  Kind kind = Kind::any;
};

/// A machine without anything hidden.
Drawn draw_machine(Draw&, bool turns, Kind kind);

/// Gains for the machine as it is, with what is hidden in it, as somebody would tune them,
/// and by how much they had to be turned down.
void tune(Draw, Plant&, const Hidden&, double down);

struct Scenario {
  Plant plant;
  Hidden hidden;
  bool without_viscous = false, without_coulomb = false;  ///< of the machine file
  std::vector<HiddenEffect> effects;
};

/// Effects of the catalogue that a drive may have.
std::vector<std::string> effects_of(bool turns, Kind kind);
/// Kinds of disturbance that are not in it; the last is the line.
std::vector<std::string> outside_kinds();

/// What the scenario needs of the machine, so that it can be there at all. Of both, the machine
/// with the effect and the same without.
void make_room(Drawn&, std::string_view effect);

/// Hides one more. `program` gives what the motion visits. The largest acceleration of the other
/// axis is that of cross-talk.
void hide(Scenario&, const Drawn&, std::string_view effect, Draw&, double other_acceleration);

}  // namespace blind::second
