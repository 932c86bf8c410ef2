#include "servosense/process/verification/program_check.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "servosense/io/text.hpp"
#include "servosense/process/engagement/chip_load.hpp"
#include "servosense/process/engagement/turning_tools.hpp"
#include "servosense/process/motion/path_curve.hpp"

namespace servosense::process {
namespace {

using Kind = CanonicalMove::Kind;

constexpr double kToDeg = 180 / std::numbers::pi;
/// Lengths and depths that are alike [m]: floats, and what a control rounds to.
constexpr double kAlike = 1e-6;
/// Times that are alike [s]: a servo period.
constexpr double kAlikeSeconds = 1e-3;
/// An angle of a ramp that is alike [deg]: a micrometre in the tenth of a millimetre.
constexpr double kAlikeDeg = 0.5;
/// Of a drill's way: closer to its axis than that is drilling (derived: 0.1 mm in a millimetre).
constexpr double kAlongAxis = 0.995;
/// A slot or a cut in the middle is neither climb nor conventional [deg] (chosen).
constexpr double kNeither = 10;

std::string millimetres(double metres) { return printed(1e3 * metres) + " mm"; }

/// The same move of the machine with a tip that is higher.
CanonicalMove raised(CanonicalMove move, double by) {
  move.end[2] += by, move.begin[2] += by;
  const auto axes = plane_axes(move.plane);
  for (std::size_t i = 0; i < 2; ++i)
    if (axes[i] == 2) move.centre_m[i] += by;
  return move;
}

}  // namespace

std::string_view finding_name(FindingKind kind) {
  static constexpr std::array<std::string_view, kFindingKinds> names = {"rapid-into-material",
                                                                        "holder-contact",
                                                                        "shank-contact",
                                                                        "fixture-contact",
                                                                        "spindle-stopped",
                                                                        "spindle-wrong-way",
                                                                        "feed-before-spindle",
                                                                        "spindle-not-at-speed",
                                                                        "spindle-speed",
                                                                        "overtravel",
                                                                        "wrong-tool-length",
                                                                        "plunge",
                                                                        "drill-sideways",
                                                                        "chip-load",
                                                                        "depth",
                                                                        "gouge",
                                                                        "uncut-remainder"};
  return names[static_cast<std::size_t>(kind)];
}

Expected<CheckLimits> CheckLimits::from(const MachineFile& machine) {
  CheckLimits limits;
  Expected<Done> ok = Done{};
  const auto take = [&](const std::string& key, std::array<double, 2>& into) {
    const auto given = machine.pairs("limits", key);
    if (!given) return;
    into = given->front();
    if (!(into[0] < into[1]) && ok)
      ok = data_error(machine.where("limits", key) + ": [limits] " + key +
                      ": the least comes first, then the greatest");
  };
  for (std::size_t i = 0; i < 3; ++i)
    take(std::string("travel_") + "xyz"[i] + "_m", limits.travel_m[i]);
  take("spindle_speed_rpm", limits.spindle_speed_rpm);
  if (!ok) return ok.error();
  limits.feed_per_tooth_m = machine.number("limits", "feed_per_tooth_m").value_or(kNone);
  limits.axial_depth_m = machine.number("limits", "axial_depth_m").value_or(kNone);
  limits.spindle_start_s = machine.flag("machine", "waits_for_spindle").value_or(false)
                               ? 0
                               : machine.number("machine", "spindle_start_s").value_or(kNone);
  return limits;
}

ProgramCheck::ProgramCheck(Workpiece& workpiece, MachineTools& tools, const CheckLimits& limits)
    : tools_(tools),
      limits_(limits),
      engagement_(workpiece, cutters_of(tools_), [this](const Engagement& e) { judge(e); }),
      spindle_(limits.spindle_start_s < CheckLimits::kNone ? limits.spindle_start_s : 0) {}

void ProgramCheck::add_fixture(Workpiece& fixture) {
  fixtures_.push_back(
      std::make_unique<ProgramEngagement>(fixture, cutters_of(tools_), [this](const Engagement& e) {
        const double met = e.removed_m3 + e.holder_m3 + e.shank_m3;
        if (met > kLeastContact) find(FindingKind::fixture_contact, e, met);
      }));
}

void ProgramCheck::set_target(Workpiece& target, double tolerance_m) {
  tolerance_m_ = tolerance_m;
  target_ = std::make_unique<ProgramEngagement>(
      target,
      [this](int number) -> Expected<ProgramEngagement::Turning> {
        const auto tool = tools_.of(number);
        if (!tool) return tool.error();
        auto& smaller = smaller_[number];
        if (!smaller) {
          auto cutter = (*tool)->cutter.thinner(tolerance_m_);
          if (!cutter)
            return data_error(
                "tool " + std::to_string(number) +
                " is not larger than the tolerance of the target; give a smaller one");
          smaller = std::make_unique<Cutter>(std::move(*cutter));
        }
        return ProgramEngagement::Turning{smaller.get(), nullptr, nullptr};
      },
      [this](const Engagement& e) {
        if (e.removed_m3 > kLeastContact) find(FindingKind::gouge, e, e.removed_m3);
      });
}

Expected<Done> ProgramCheck::put(const CanonicalMove& move) {
  if (move.kind == Kind::tool) tool_ = move.tool;
  Move known{move.kind, move.spindle_rpm, kNoAngle};
  if (moves_.size() < ends_s_.size()) {
    known.begin_s = moves_.empty() ? 0 : moves_.back().end_s;
    known.end_s = ends_s_[moves_.size()];
    spindle_.put(move, known.begin_s);
    if (move.feed_m_rev == 0 && !move.threads) known.spindle_ready_s = spindle_.ready_s();
  }
  if (is_motion(move.kind)) {
    if (move.kind != Kind::rapid)
      if (const auto tool = tools_.of(tool_))
        known.feed_per_tooth_m = feed_per_tooth_m(move, (*tool)->teeth.value_or(0));
  }
  moves_.push_back(known);
  look_at(move);
  // The tip is where the tool is long, whatever offset is in force.
  const CanonicalMove real = is_motion(move.kind) ? raised(move, length_off(move)) : move;
  if (auto done = engagement_.put(real); !done) return done;
  for (const auto& fixture : fixtures_)
    if (auto done = fixture->put(real); !done) return done;
  if (target_)
    if (auto done = target_->put(raised(real, tolerance_m_)); !done) return done;
  return Done{};
}

std::optional<double> ProgramCheck::real_length(int number) const {
  if (table_ == nullptr) return {};
  const auto tool = tools_.of(number);
  if (tool && (*tool)->length_m) return (*tool)->length_m;
  const auto entry = table_->find(number);
  if (entry == table_->end()) return {};
  return entry->second.offset[2];
}

double ProgramCheck::length_off(const CanonicalMove& move) const {
  const auto length = real_length(tool_);
  const double off = length ? move.tool_length_m - *length : 0;
  return std::abs(off) > kAlike ? off : 0;
}

/// What needs no workpiece.
void ProgramCheck::look_at(const CanonicalMove& move) {
  if (!is_motion(move.kind)) return;
  Engagement at;
  at.move = moves_.size() - 1;
  at.line = move.line;
  at.tool = tool_;
  for (std::size_t i = 0; i < 3; ++i) at.place[i] = move.end[i];
  const PathCurve curve = move.kind == Kind::arc ? PathCurve::arc(move, machine_)
                                                 : PathCurve::line(move.machine, move.machine);
  if (move.kind != Kind::tap) machine_ = move.machine;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto [least, greatest] = limits_.travel_m[axis];
    const auto [low, high] = curve.extent(axis);
    const double beyond = std::max(least - low, high - greatest);
    if (beyond > kAlike) find(FindingKind::overtravel, at, beyond);
  }
  if (move.kind == Kind::rapid) return;
  const double speed = std::abs(move.spindle_rpm);
  if (speed > 0 &&
      !(speed >= limits_.spindle_speed_rpm[0] && speed <= limits_.spindle_speed_rpm[1]))
    find(FindingKind::spindle_speed, at, speed);
  if (const double off = length_off(move); off != 0)
    find(FindingKind::wrong_tool_length, at, std::abs(off));
}

void ProgramCheck::judge(const Engagement& e) {
  if (listener_) listener_(e);
  const Move& move = moves_[e.move];
  const bool cuts = e.removed_m3 > kLeastContact;
  if (e.holder_m3 > kLeastContact) find(FindingKind::holder_contact, e, e.holder_m3);
  if (e.shank_m3 > kLeastContact) find(FindingKind::shank_contact, e, e.shank_m3);
  judge_direction(e, move.spindle_rpm);
  if (e.rapid) {
    if (cuts) find(FindingKind::rapid_into_material, e, e.removed_m3);
    return;
  }
  if (move.spindle_rpm == 0)
    find(cuts ? FindingKind::spindle_stopped : FindingKind::feed_before_spindle, e, e.removed_m3);
  if (!cuts) return;
  const double begin_s = move.begin_s + (move.end_s - move.begin_s) * e.from_share;
  if (const double early = move.spindle_ready_s - begin_s; early > kAlikeSeconds)
    find(FindingKind::spindle_not_at_speed, e, early);
  if (move.spindle_rpm < 0 && move.kind != Kind::tap)
    find(FindingKind::spindle_wrong_way, e, e.removed_m3);
  const auto tool = tools_.of(e.tool);
  if (!tool) return;
  const bool drill = (*tool)->cutter.shape().kind == CutterKind::drill;
  const double ramp = -std::asin(std::clamp(e.rise, -1.0, 1.0)) * kToDeg;
  if (e.bottom_m2 > 0 && ramp > (*tool)->ramp_angle_deg + kAlikeDeg)
    find(FindingKind::plunge, e, ramp);
  if (drill && std::abs(e.rise) < kAlongAxis) find(FindingKind::drill_sideways, e, e.removed_m3);
  if (move.feed_per_tooth_m > limits_.feed_per_tooth_m * (1 + 1e-9))
    find(FindingKind::chip_load, e, move.feed_per_tooth_m);
  if (!drill && e.axial_depth_m > limits_.axial_depth_m + kAlike)
    find(FindingKind::depth, e, e.axial_depth_m);
}

/// Of teeth that turn clockwise, those on the right of the feed cut with it: climb milling.
void ProgramCheck::judge_direction(const Engagement& e, double spindle_rpm) {
  if (e.arcs.empty() || e.rapid) {
    direction_ = 0;
    return;
  }
  double weight = 0, middle = 0;
  for (const Arc& arc : e.arcs) {
    weight += arc.to_deg - arc.from_deg;
    middle += (arc.to_deg - arc.from_deg) * (arc.to_deg + arc.from_deg) / 2;
  }
  const double right = weight > 0 ? (middle / weight - 90) * (spindle_rpm < 0 ? -1 : 1) : 0;
  const int now = right > kNeither ? 1 : right < -kNeither ? -1 : 0;
  if (now == 0) return;
  if (direction_ == -now && (direction_changes_.empty() || direction_changes_.back() != e.line))
    direction_changes_.push_back(e.line);
  direction_ = now;
}

void ProgramCheck::find(FindingKind kind, const Engagement& at, double size) {
  Open& open = open_[static_cast<std::size_t>(kind)];
  if (open.finding > 0 && at.move <= open.move + 1) {
    Finding& finding = findings_[open.finding - 1];
    finding.last_line = at.line;
    finding.size = std::max(finding.size, size);
  } else {
    findings_.push_back({at.line, at.line, kind, at.tool, at.place, size, {}});
    open.finding = findings_.size();
  }
  open.move = at.move;
}

void ProgramCheck::finish() {
  engagement_.finish();
  for (const auto& fixture : fixtures_) fixture->finish();
  if (target_) target_->finish();
  // A feed that comes to a cut with the spindle at rest is one fault.
  std::erase_if(findings_, [&](const Finding& feed) {
    return feed.kind == FindingKind::feed_before_spindle &&
           std::ranges::any_of(findings_, [&](const Finding& cut) {
             return cut.kind == FindingKind::spindle_stopped && cut.line <= feed.last_line + 1 &&
                    feed.line <= cut.last_line + 1;
           });
  });
  std::ranges::stable_sort(findings_, {}, &Finding::line);
  for (Finding& finding : findings_) finding.message = message_of(finding);
}

std::string ProgramCheck::message_of(const Finding& f) const {
  const std::string tool = "tool " + std::to_string(f.tool);
  switch (f.kind) {
    case FindingKind::rapid_into_material:
      return "a rapid goes through material; raise it above the part, or make it a feed";
    case FindingKind::holder_contact:
      return "the holder of " + tool +
             " runs into the part; use a longer tool, or cut less deep beside this wall";
    case FindingKind::shank_contact:
      return "the shank of " + tool + " runs into the part above its flutes, which are " +
             millimetres(flute_of(f.tool)) + " long; cut in steps, or use longer flutes";
    case FindingKind::fixture_contact:
      return tool + " or its holder runs into a fixture; go around it, or move the clamp";
    case FindingKind::spindle_stopped:
      return tool + " cuts while the spindle stands; start it (S, M3) before this line";
    case FindingKind::spindle_wrong_way:
      return tool +
             " cuts while the spindle turns counterclockwise (M4); use M3, unless it is a "
             "left-hand tool";
    case FindingKind::feed_before_spindle:
      return "a feed is made while the spindle stands; start it before, or make this a rapid";
    case FindingKind::spindle_not_at_speed:
      return tool + " cuts " + printed(f.size, 2) +
             " s before the spindle has its speed ([machine] spindle_start_s); dwell that long "
             "(G4), or start it earlier";
    case FindingKind::spindle_speed:
      return "a spindle speed of " + printed(f.size) +
             " rpm is outside [limits] spindle_speed_rpm, " +
             printed(limits_.spindle_speed_rpm[0]) + " to " +
             printed(limits_.spindle_speed_rpm[1]) + " rpm";
    case FindingKind::overtravel:
      return "the machine goes " + millimetres(f.size) +
             " beyond its travel ([limits] travel_x_m, travel_y_m, travel_z_m); move the work "
             "offset or the clamping";
    case FindingKind::wrong_tool_length:
      return "the length offset in force is " + millimetres(f.size) + " off the length of " + tool +
             (measured(f.tool)
                  ? " as measured ([tool] length_m); correct the tool table, or give G43 H"
                  : " in the tool table; give G43 H") +
             std::to_string(f.tool) + " after the tool change";
    case FindingKind::plunge:
      return tool + " goes down into material at " + printed(f.size, 2) +
             " degrees; its bottom stands " + printed(ramp_of(f.tool), 3) +
             " ([tool] ramp_angle_deg); enter on a flatter ramp or beside the part";
    case FindingKind::drill_sideways:
      return tool + " is a drill and cuts sideways; retract it first";
    case FindingKind::chip_load:
      return "a feed of " + millimetres(f.size) + " per tooth is above the limit of " +
             millimetres(limits_.feed_per_tooth_m) + "; lower F, or raise S";
    case FindingKind::depth:
      return "a cut " + millimetres(f.size) + " deep is above the limit of " +
             millimetres(limits_.axial_depth_m) + "; cut in more passes";
    case FindingKind::gouge:
      return tool + " cuts into the target by more than " + millimetres(tolerance_m_) +
             "; compare path, tool and length with what the target needs";
    case FindingKind::uncut_remainder:
      break;
  }
  return {};
}

bool ProgramCheck::measured(int number) const {
  const auto tool = tools_.of(number);
  return tool && (*tool)->length_m;
}

double ProgramCheck::ramp_of(int number) const {
  const auto tool = tools_.of(number);
  return tool ? (*tool)->ramp_angle_deg : 0;
}

double ProgramCheck::flute_of(int number) const {
  const auto tool = tools_.of(number);
  return tool ? (*tool)->cutter.shape().flute_length_m : 0;
}

}  // namespace servosense::process
