// One try at telling a CNC something: what a controller's interface must offer so that CncChannel
// and StopRequest can work with it. Links are small, and do not repeat anything; a try ends within
// the link's own time limit.
//
// Commands go as NC text (ISO 6983), for that is what controllers have in common: FOCAS takes text
// in pieces (Dunwoody 2010, ch. 6), LinuxCNC by lines.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include "servosense/core/drive_sample.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

enum class CncReply {
  done,
  busy,       ///< no room now; later perhaps
  refused,    ///< not in this state: machine off, another program, the operator has not let go
  reset,      ///< the controller was reset or taken over: what was begun is void
  no_answer,  ///< lost, on the way there or back: it may have been done
};

struct CncStatus {
  bool on = false;      ///< powered, and takes commands
  bool moving = false;  ///< a block is being carried out, or waits behind a feed hold
  bool feed_held = false;
  std::array<double, kAxes> position_m{};  ///< in the coordinates that move blocks are written in
  double feed_override = 1;
};

/// 1: as programmed.
struct CncOverrides {
  double feed = 1, spindle = 1;
};

class CncLink {
 public:
  CncLink() = default;
  CncLink(const CncLink&) = delete;
  CncLink& operator=(const CncLink&) = delete;
  virtual ~CncLink() = default;

  /// For error sentences.
  [[nodiscard]] virtual const std::string& name() const = 0;
  /// Connects and takes control, anew if need be; text that is no whole block yet is forgotten.
  /// `reset`, once, when the controller was reset meanwhile.
  virtual CncReply connect() = 0;
  /// NC text; blocks end with '\n'. `taken`: characters accepted, with `done` or `busy` only.
  virtual CncReply send(std::string_view text, std::size_t& taken) = 0;
  virtual CncReply status(CncStatus& status) = 0;
  virtual CncReply hold_feed(bool hold) = 0;
  /// 1: as programmed.
  virtual CncReply set_feed_override(double factor) = 0;
  /// Likewise of the spindle. Refused, both of these, by a link that cannot.
  virtual CncReply set_spindle_override(double /*factor*/) { return CncReply::refused; }
  /// As the controller has them now, whoever has set them.
  virtual CncReply overrides(CncOverrides& /*overrides*/) { return CncReply::refused; }

  /// The clock that waiting is measured by, and waiting itself: a simulation has its own.
  [[nodiscard]] virtual Nanoseconds now_ns() const;
  virtual void wait(double seconds);
};

}  // namespace servosense
