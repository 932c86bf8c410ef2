// The smallest thing that a monitor finds on this machine, at this speed.
#pragma once

#include <optional>
#include <string>

namespace servosense {

/// The smallest thing that a monitor would have found in what it has heard. What it is of: chatter,
/// the amplitude of a sinusoid of cutting torque that lasts; collision, a step of force; a broken
/// tooth, what it took of the torque; and so on, as `text` has it.
struct SeesFrom {
  double value = 0;
  std::string unit;                       ///< of the quantity: Nm, N, ratio...
  std::optional<double> frequency_hz;     ///< chatter: of the sinusoid
  std::optional<double> unheard_mode_hz;  ///< chatter: a mode that the signals cannot show
  std::optional<double> in_cut;           ///< the same where the tool cuts, when that is known
  /// Beyond any cut: more than the drive can give, or than the cuts of the record hold.
  bool blind = false;
  std::string text;  ///< for people: "chatter at 560 Hz from 0.31 Nm"
};

}  // namespace servosense
