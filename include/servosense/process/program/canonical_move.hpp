// What an NC program asks of the machine, step by step: every code worked out, no mode left open.
//
// The steps and their numbers are those of LinuxCNC's canonical commands. `end` is where its
// interpreter says the tool goes, in the coordinates of the program, work offset and tool length
// taken off; `machine` is the same point with both put on.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace servosense::process {

/// x y z [m], a b c [deg], u v w [m].
using AxisPoint = std::array<double, 9>;

enum class Plane : std::uint8_t { xy, zx, yz };
/// First, second axis of the plane and the one across it, as places in an AxisPoint. Turns count
/// from the first axis towards the second.
[[nodiscard]] constexpr std::array<std::size_t, 3> plane_axes(Plane plane) {
  switch (plane) {
    case Plane::zx:
      return {2, 0, 1};
    case Plane::yz:
      return {1, 2, 0};
    case Plane::xy:
      break;
  }
  return {0, 1, 2};
}

enum class PathControl : std::uint8_t {
  exact_path,  ///< G61: every point is passed
  exact_stop,  ///< G61.1: the machine stops at every point
  blend        ///< G64: corners are rounded within a tolerance
};

struct CanonicalMove {
  enum class Kind : std::uint8_t {
    rapid,            ///< straight, as fast as the machine goes
    feed,             ///< straight, at `feed_m_s`
    arc,              ///< helical or in a plane, at `feed_m_s`
    tap,              ///< G33.1: to `end` and back with the spindle, `pitch_m` a revolution
    dwell,            ///< `seconds`
    tool,             ///< `tool` is in the spindle from here on
    spindle,          ///< `spindle_rpm` from here on
    coolant,          ///< M7, M8, M9: `number`
    stop,             ///< M0, M1, M60: `number`; waits for the operator
    override_switch,  ///< M48 to M53: `number`
    output,           ///< M62 to M65, M67, M68: `number`
    end,              ///< M2, M30, M99 or the last `%`
  };
  Kind kind = Kind::rapid;
  std::size_t line = 0;  ///< of the program, from 1; of another file's move, that of the call
  AxisPoint end{};
  AxisPoint machine{};
  AxisPoint begin{};  ///< of an arc: where it begins, in the coordinates of `end`
  // Of an arc.
  Plane plane = Plane::xy;
  std::array<double, 2> centre_m{};  ///< along the axes of the plane
  int turns = 0;  ///< counterclockwise positive; 1 is up to one turn, 2 up to two
  /// Speed along the path [m/s], 0 of a rapid. Under G95 that of the programmed spindle speed.
  double feed_m_s = 0;
  double feed_deg_s = 0;     ///< of a feed that moves axes that turn and nothing else [deg/s]
  double feed_m_rev = 0;     ///< under G95, G33 and G33.1, else 0
  double feed_word_m_s = 0;  ///< feed that F1 asks for [m/s]; 0 where F does not set it
  bool threads = false;      ///< the feed is that of a thread: G33, G33.1, G74, G84
  /// Programmed speed [rpm], clockwise (M3) positive; 0 while the spindle stands.
  double spindle_rpm = 0;
  double seconds = 0;
  int tool = 0;
  double tool_length_m = 0;  ///< of a motion: offset along z in force (G43)
  int number = 0;
  PathControl path_control = PathControl::blend;
  double blend_m = 0;  ///< tolerance of G64 P; 0 without P: as far as it takes to keep the speed
  double merge_m = 0;  ///< tolerance within which G64 Q, else P, makes one line of several; 0: none
  double rotation_deg = 0;  ///< of the coordinate system about z: from `end` to `machine`
};

[[nodiscard]] std::string_view kind_name(CanonicalMove::Kind kind);
/// Whether the tool moves.
[[nodiscard]] constexpr bool is_motion(CanonicalMove::Kind kind) {
  using Kind = CanonicalMove::Kind;
  return kind == Kind::rapid || kind == Kind::feed || kind == Kind::arc || kind == Kind::tap;
}
/// Angle swept by an arc from `from` [rad], counterclockwise positive.
[[nodiscard]] double arc_angle_rad(const CanonicalMove& arc, const AxisPoint& from);
/// Length of the path from `from` to the move's end over x, y, z [m]; with none of these, over
/// u, v, w; with none of those, over a, b, c [deg]. Both in the move's own coordinates.
[[nodiscard]] double path_length(const CanonicalMove& move, const AxisPoint& from);

}  // namespace servosense::process
