// The machine as the program sees it: modes, position, offsets, parameters. Turns blocks to moves.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "servosense/process/program/block.hpp"
#include "servosense/process/program/program_reader.hpp"

namespace servosense::process {

/// Nothing, or what is wrong.
using Refusal = std::optional<Error>;
inline Refusal refuse(std::string sentence) { return data_error(std::move(sentence)); }

inline constexpr std::size_t kX = 0, kY = 1, kZ = 2;
inline constexpr std::string_view kAxisLetters = "xyzabcuvw";
[[nodiscard]] constexpr bool is_rotary(std::size_t axis) { return axis >= 3 && axis < 6; }

enum class FeedMode { per_minute, inverse_time, per_revolution };
enum class Side { none, left, right };

/// Modes that M70 saves and M72 restores.
struct Modes {
  int motion = 800;
  Plane plane = Plane::xy;
  bool absolute = true, arc_absolute = false;
  double unit_mm = 1;
  FeedMode feed_mode = FeedMode::per_minute;
  double feed = 0;     // program units/min or /rev, as it stands in the program; 0: none yet
  double feed_mm = 0;  // the same in mm, of the unit in which it was given
  bool retract_to_r = true;
  int coordinate_system = 1;
  PathControl path_control = PathControl::blend;
  double blend_mm = 0, merge_mm = 0;
  double speed_rpm = 0;
  int spindle_direction = 0;  // 1 clockwise, -1, 0 stands
  bool surface_speed = false;
  bool tool_offset = false;  // of saved modes: whether one is in force
  bool mist = false, flood = false;
  bool feed_override = true, speed_override = true, adaptive_feed = false, feed_hold = true;
};

/// All in mm and degrees, the point in the coordinates of the program.
struct Offsets {
  AxisPoint work{}, shift{}, tool{};  // G54 to G59.3, G92 and G52, G43
  double rotation_deg = 0;
  [[nodiscard]] AxisPoint to_machine(AxisPoint point) const;
  [[nodiscard]] AxisPoint to_program(AxisPoint point) const;
};

void rotate(AxisPoint& point, double angle_deg);
/// A point in mm and degrees as one in metres and degrees.
AxisPoint in_metres(AxisPoint point);
/// In mm and degrees.
AxisPoint offset_of(const Tool& tool);

/// A circle in the plane of the move.
struct Circle {
  std::array<double, 2> centre{};
  int turns = 0;
};

/// Angle from one point of a circle to another, with turns as a CanonicalMove counts them.
double swept_rad(const std::array<double, 2>& from, const std::array<double, 2>& to,
                 const std::array<double, 2>& centre, int turns);
/// As path_length() of a straight move, in the units of the points.
double straight_length(const AxisPoint& from, const AxisPoint& to);

class Machine final : public ParameterValues {
 public:
  Machine(const ProgramOptions& options, std::function<void(const CanonicalMove&)> sink);

  [[nodiscard]] Expected<double> numbered(long index) const override;
  [[nodiscard]] Expected<double> named(std::string_view name) const override;
  [[nodiscard]] bool exists(std::string_view name) const override;

  /// Everything that the words of a block ask for, in LinuxCNC's order, but subroutines and loops.
  Refusal execute(const Block& block);
  [[nodiscard]] bool ended() const { return ended_; }
  /// M2 and what else ends a program.
  Refusal end_program();
  Refusal set_named(const std::string& name, double value);
  /// Moves of cutter compensation whose end is still open.
  void flush();

  // What flow of the program needs.
  std::size_t line = 0;  // of the program, from 1
  std::size_t file_line = 0;
  struct Frame {
    std::map<std::string, double, std::less<>> locals;
    std::optional<Modes> saved;
    bool restore_on_return = false;
  };
  std::vector<Frame> frames = std::vector<Frame>(1);
  std::vector<double> parameters;
  std::optional<double> returned;  // of the last subroutine
  Refusal restore(const Modes& modes);
  [[nodiscard]] Refusal overflow() const { return overflow_; }

 private:
  // machine.cpp
  Refusal assign(const Block& block);
  Refusal execute_modes(const Block& block);
  Refusal execute_m(const Block& block);
  Refusal change_tool(int number);
  Refusal stop(int code);
  [[nodiscard]] double dwell_seconds(const Block& block) const;
  Refusal switch_units(double unit_mm);
  Refusal set_feed(double value);
  void put(CanonicalMove move);
  void give(CanonicalMove move);
  [[nodiscard]] CanonicalMove move_to(CanonicalMove::Kind kind, const AxisPoint& end) const;
  void put_number(CanonicalMove::Kind kind, int number);
  // block_check.cpp
  [[nodiscard]] Expected<int> motion_of(const Block& block) const;
  [[nodiscard]] Refusal check(const Block& block, int motion) const;
  // motion.cpp
  Refusal move(const Block& block, int motion);
  Refusal straight(const Block& block, int motion);
  Refusal arc(const Block& block, int motion);
  Refusal polar(const Block& block, AxisPoint& end) const;
  Expected<AxisPoint> ends(const Block& block) const;
  [[nodiscard]] Refusal may_feed(const Block& block, const char* what) const;
  [[nodiscard]] Expected<Circle> circle(const Block& block, int motion, const AxisPoint& from,
                                        const AxisPoint& to) const;
  [[nodiscard]] double feed_mm_s(const Block& block, double length) const;
  void put_feed(const AxisPoint& end, double feed, bool turns);
  void go(CanonicalMove::Kind kind, const AxisPoint& end, double feed_mm_s);
  CanonicalMove arc_move(const Circle& circle, const AxisPoint& end) const;
  // cycles.cpp
  Refusal cycle(const Block& block, int motion);
  Refusal hole(const Block& block, int motion, double r, double clear, double bottom,
               std::array<double, 2> at);
  // offsets.cpp
  Refusal once(const Block& block, int code);
  Refusal set_work_offset(const Block& block);
  Refusal set_tool_entry(const Block& block);
  Refusal set_shift(const Block& block, int code);
  Refusal go_home(const Block& block, int code);
  void save_home(int code);
  Refusal select_coordinate_system(int number);
  Refusal tool_length(const Block& block, int code);
  void use_tool_offset(const AxisPoint& offset);
  void load_work_offset();
  Expected<const Tool*> tool(long number, const char* what) const;
  Expected<Tool*> tool_entry(long number);
  void show_tool();  // in the parameters
  // compensation.cpp
  Refusal compensation(const Block& block, int code);
  Refusal compensation_off();
  Refusal compensated_straight(const Block& block, int motion, const AxisPoint& end);
  Refusal compensated_arc(const Block& block, int motion, const AxisPoint& end);
  void begin_at(const std::array<double, 2>& spot);
  Refusal end_open_moves(const std::array<double, 2>& spot);
  void open_move(CanonicalMove move, const AxisPoint& end, const std::array<double, 2>& toward,
                 double swept);
  [[nodiscard]] bool compensating() const { return side_ != Side::none; }
  [[nodiscard]] bool compensated() const { return compensating() && radius_ > 0; }
  [[nodiscard]] Refusal not_compensating(const char* what) const;

  const ProgramOptions& options_;
  std::function<void(const CanonicalMove&)> sink_;
  std::uint64_t moves_ = 0;
  Refusal overflow_;
  bool ended_ = false;
  Modes modes_;
  Offsets offsets_;
  AxisPoint stands_{};    // where the moves given so far leave the machine, in its coordinates [mm]
  AxisPoint position_{};  // in program coordinates; while compensating, of the tool's centre
  std::map<std::string, double, std::less<>> globals_;
  std::optional<ToolTable> tools_;
  Tool in_spindle_;
  int selected_tool_ = 0;
  bool tool_change_asked_ = false;
  double highest_rpm_ = 0;         // of G96
  std::array<double, 7> cycle_{};  // see cycles.cpp
  std::optional<double> initial_level_;
  // Cutter compensation.
  Side side_ = Side::none;
  double radius_ = 0;
  bool entry_ = true;        // the next move is the first
  bool after_exit_ = false;  // no arc until a straight move
  AxisPoint programmed_{};
  struct OpenMove {
    CanonicalMove move;
    AxisPoint end{};                 // mm
    std::array<double, 2> toward{};  // of a straight move, as programmed
    double swept_rad = 0;            // of an arc, as programmed
  };
  std::vector<OpenMove> open_;     // moves whose end is open, and what came after them
  std::array<double, 2> start_{};  // where the first of them begins
  bool start_known_ = false;
  bool waits_ = false;  // the move that is put is the first of them
};

}  // namespace servosense::process
