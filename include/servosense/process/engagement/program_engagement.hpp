// Cuts an NC program into a workpiece and tells, step by step, where the cutter meets it (phase 1
// of Bertok 1984, 4.3: geometry once, feeds and speeds afterwards).
//
// A move is cut in steps of kStepShare of the cutter's radius, an arc in chords that are off it by
// at most kChordTolerance. The lines along z are cut first, batch by batch on a thread of its own;
// the lines along x and y and the arcs follow, and look only where the former say that something is
// removed.
//
// The lines along x and y are cut a little later than they are looked at. What a cutter goes into
// with its front it has not cleared just before, as long as its path is straight or less curved
// than itself; so nothing is lost, and at the sides of the feed the outline that its circle meets
// is that of the part, not the wall that the cutter has just made.
#pragma once

#include <array>
#include <cstddef>
#include <deque>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/process/engagement/engaged_arcs.hpp"
#include "servosense/process/engagement/engagement.hpp"
#include "servosense/process/motion/path_curve.hpp"
#include "servosense/process/program/canonical_move.hpp"
#include "servosense/process/tool/cutter.hpp"
#include "servosense/process/workpiece/workpiece.hpp"

namespace servosense::process {

/// Step over cutter radius (chosen: angles are those of its middle, so that they are a tenth of a
/// radius along the path from either end).
inline constexpr double kStepShare = 0.2;
/// An arc is at most this far from its chords [m] (chosen: a tenth of what a radius is known to).
inline constexpr double kChordTolerance = 1e-6;
/// Heights at which a step is looked at (chosen: a finer side is cut alike in many layers).
inline constexpr std::size_t kMostSlabs = 16;

class ProgramEngagement {
 public:
  /// What turns, of a tool number; it stays where it is.
  struct Turning {
    const Cutter* cutter = nullptr;
    const Cutter* holder = nullptr;  ///< nothing if it is not known
    const Cutter* shank = nullptr;   ///< between cutter and holder; nothing as well
  };
  using Cutters = std::function<Expected<Turning>(int tool)>;
  /// Engagements in the order of the program: of a move in air one, else one a step.
  using Sink = std::function<void(const Engagement&)>;

  /// `workpiece` is in the coordinates of the program and is cut. Without level lines what is
  /// removed is told, but neither arcs nor contact. `step_share`: see kStepShare.
  ProgramEngagement(Workpiece& workpiece, Cutters cutters, Sink sink,
                    double step_share = kStepShare);

  /// Data error, with the line, for a move of an axis other than x, y, z, for a work offset that
  /// changes in x or y while the stock stays where it is, and for a tool without a cutter.
  ///
  /// Where the tool stands at the start is not known: nothing is cut before z has been given once.
  Expected<Done> put(const CanonicalMove& move);
  /// Cuts what is still held back.
  void finish();

  [[nodiscard]] double removed_m3() const { return removed_; }
  /// How far removed_m3() may be off, by refinement: each fourth of the lines along z, a grid of
  /// twice the spacing, gives the volume; by what they differ from all together at most (about two
  /// standard errors of the whole).
  [[nodiscard]] double removed_error_m3() const;
  /// Moves that put() has seen.
  [[nodiscard]] std::size_t moves() const { return move_; }

 private:
  struct Step {
    Engagement engagement;
    const Cutter* cutter = nullptr;
    const Cutter* core = nullptr;  // thinner by kContactDepth: what it does not meet is no contact
    const Cutter* holder = nullptr;
    const Cutter* shank = nullptr;
    Point from{}, to{}, middle{};
    std::array<double, 2> ahead{};  // seen from above, of length 1
    double level = 0, rise = 0;     // parts of the unit vector along the path
    bool follows = false;           // the cutter has been at `from`
    bool air = false;
    // Of the lines along z.
    bool in_core = false;          // some stand where the core passes: only they count then
    double low_z = 1, high_z = 0;  // of what is removed
    double top_z = 0;              // of the stock near the path
    double left = 0, right = 0;    // lateral extent of what is removed
  };

  /// Of what was cleared on the way here, with the front of a step.
  enum class Meeting : std::uint8_t {
    none,
    circles,  // taken out as such, layer by layer
    unknown   // of another cutter: the lines along x and y have to say
  };
  /// What the lines along x and y have not seen yet of the path.
  struct Held {
    const Cutter* cutter = nullptr;
    Point from{}, to{};
    double top_z = 0;
    Meeting meeting = Meeting::none;
  };

  void add(const CanonicalMove& move, std::size_t number, const PathCurve& curve,
           std::size_t count);
  void flush();
  [[nodiscard]] SweepFront front_of(const Step& step, const Sweep& sweep) const;
  void cut_columns(std::vector<Step>& steps);
  void cut_level(std::vector<Step>& steps);
  void look_at(Step& step);
  [[nodiscard]] static Meeting meeting(const Step& step, const Held& held);
  void take_out(const Held& held, double z, double radius, std::vector<Arc>& arcs) const;
  void clear(const Held& held);
  void clear_held();

  Workpiece& workpiece_;
  Cutters cutters_;
  Sink sink_;
  double step_share_;
  EngagedArcs circle_;
  Turning turning_;
  std::map<const Cutter*, std::unique_ptr<Cutter>> cores_;
  int tool_ = 0;
  std::size_t move_ = 0;
  AxisPoint machine_{};
  std::optional<std::array<double, 2>> offset_;  // of the work in x and y
  bool placed_ = false;                          // z is known
  std::optional<Point> last_;                    // where the cutter has been
  std::vector<Step> filling_, ahead_of_;
  std::deque<Held> held_;
  double held_m_ = 0;  // their length
  double removed_ = 0;
  std::array<double, 4> quarters_{};
};

}  // namespace servosense::process
