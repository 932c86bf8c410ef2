#include "servosense/process/optimise/feed_plan.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "servosense/io/text.hpp"
#include "servosense/process/motion/trajectory.hpp"
#include "servosense/process/optimise/word_text.hpp"

namespace servosense::process {
namespace {

/// Feeds are alike within this share: five digits of an F word.
constexpr double kSameFeed = 1e-4;
/// A shorter time that counts, as a share.
constexpr double kSameTime = 1e-9;

constexpr const char* kSeveral = "it is run with several feeds";

}  // namespace

FeedPlan::FeedPlan(std::vector<std::string> lines, const CutLimits& limits,
                   const MotionLimits& motion, bool accelerated,
                   const std::array<double, 2>& compliance)
    : text_(std::move(lines)),
      limits_(limits),
      motion_(motion),
      accelerated_(accelerated),
      compliance_(compliance) {}

void FeedPlan::put(const CanonicalMove& move, const ToolLaw* law) {
  axis_m_s_.push_back(is_motion(move.kind) ? axis_speed(move, machine_, motion_) : kNoLimit);
  if (is_motion(move.kind) && move.kind != CanonicalMove::Kind::tap) machine_ = move.machine;
  moves_.push_back(move);
  laws_.push_back(law);
  of_.emplace_back();
  if (!at_a_feed(move)) return;
  const auto [at, first] = lines_.try_emplace(move.line);
  Line& line = at->second;
  if (first) line.spindle_rpm = move.spindle_rpm;
  line.before_m_s = std::max(line.before_m_s, move.feed_m_s);
}

void FeedPlan::add(const Engagement& e) {
  Of& of = of_[e.move];
  const CanonicalMove& move = moves_[e.move];
  if (!e.cuts() || !at_a_feed(move)) return;
  of.cuts = true;
  const ToolLaw* law = laws_[e.move];
  if (law == nullptr || law->teeth == 0 || move.spindle_rpm == 0) return;
  const BoundFeed found = bound_feed(e, *law, move.spindle_rpm, compliance_, limits_);
  of.bound.add(found.feed_m_s, found.bound);
}

bool FeedPlan::has_word(std::size_t line) const {
  return line <= text_.size() && code_word_of(text_[line - 1], 'F').found();
}

void FeedPlan::fix(Line& line, const std::string& why) const {
  if (line.bound == FeedBound::fixed) return;
  line.bound = FeedBound::fixed, line.why = why, line.after_m_s = line.before_m_s;
}

void FeedPlan::bound_moves() {
  std::map<std::size_t, BoundFeed> least;
  for (std::size_t i = 0; i < moves_.size(); ++i) {
    const CanonicalMove& move = moves_[i];
    if (!at_a_feed(move)) continue;
    Line& line = lines_[move.line];
    BoundFeed& bound = least[move.line];
    const ToolLaw* law = laws_[i];
    line.cuts = line.cuts || of_[i].cuts;
    bound.add(of_[i].bound.feed_m_s, of_[i].bound.bound);
    bound.add(limits_.feed_m_s, FeedBound::feed);
    bound.add(axis_m_s_[i], FeedBound::axis_speed);
    const std::string_view text =
        move.line <= text_.size() ? std::string_view(text_[move.line - 1]) : std::string_view();
    if (move.threads || (law != nullptr && law->kind == CutterKind::tap))
      fix(line, "its thread sets the feed");
    else if (!(move.feed_word_m_s > 0))
      fix(line, "F does not set its feed");
    else if (!code_word_of(text, 'F').plain)
      fix(line, "its F is an expression that is not understood");
    else if (std::abs(move.feed_m_s - line.before_m_s) > kSameFeed * line.before_m_s)
      fix(line, kSeveral);
    if (!of_[i].cuts) continue;
    const bool needs_torque =
        limits_.torque_Nm < CutLimits::kNone || limits_.power_W < CutLimits::kNone;
    if (move.spindle_rpm == 0)
      fix(line, "it cuts while the spindle stands");
    else if (law == nullptr || law->teeth == 0)
      fix(line, "the teeth of its tool are not known");
    else if (needs_torque && !law->torque)
      fix(line, "the torque of its tool is not known");
    else if (limits_.deflection_m < CutLimits::kNone &&
             (!law->force || !(compliance_[0] > 0 && compliance_[1] > 0)))
      fix(line, "force or stiffness of its tool is not known");
    else if (!(of_[i].bound.feed_m_s > 0))
      fix(line,
          "its " + std::string(bound_name(of_[i].bound.bound)) + " is above the limit at any feed");
  }
  for (auto& [number, line] : lines_) {
    if (line.bound == FeedBound::fixed) continue;
    const BoundFeed& bound = least[number];
    line.bound = bound.bound;
    line.after_m_s = std::isinf(bound.feed_m_s) ? line.before_m_s : bound.feed_m_s;
    if (std::isinf(bound.feed_m_s)) fix(line, "nothing bounds its feed");
  }
  // Feeds that come from elsewhere, now one, now another, would have to stay there.
  const bool mixed = std::any_of(lines_.begin(), lines_.end(), [&](const auto& l) {
    return l.second.why == kSeveral && !has_word(l.first);
  });
  if (mixed)
    for (auto& [number, line] : lines_)
      fix(line, "a line without F is run with several feeds, which would change with this");
}

std::vector<CanonicalMove> FeedPlan::moves() const {
  std::vector<CanonicalMove> all = moves_;
  for (CanonicalMove& move : all) {
    if (!at_a_feed(move)) continue;
    const Line& line = lines_.at(move.line);
    if (line.bound == FeedBound::fixed || !line.changed()) continue;
    const double share = line.after_m_s / move.feed_m_s;
    move.feed_m_s *= share, move.feed_m_rev *= share;
  }
  return all;
}

double FeedPlan::run(std::map<std::size_t, double>& fastest_m_s) const {
  fastest_m_s.clear();
  const auto note = [&](const TimedMotion& motion) {
    double& fastest = fastest_m_s[motion.line];
    const VelocityProfile& profile = motion.profile;
    // The highest speed of a profile is where it begins, ends or stops rising.
    constexpr int looks = 64;
    for (int i = 0; i <= looks; ++i)
      fastest = std::max(fastest, profile.velocity(profile.duration_s() * i / looks));
    fastest = std::max(fastest, profile.braking_from_m_s());
  };
  TrajectoryPlanner planner(
      motion_, [](const CanonicalMove&, double) {}, note);
  for (const CanonicalMove& move : moves()) planner.put(move);
  planner.finish();
  return planner.now_s();
}

void FeedPlan::leave_out_what_gains_nothing() {
  std::map<std::size_t, double> fastest, ignored;
  const double time_s = run(fastest);
  const auto all = lines_;
  for (auto& [number, line] : lines_) {
    if (line.bound == FeedBound::fixed || !(line.after_m_s > line.before_m_s)) continue;
    // Lines that the control joins to one are seen in their first alone.
    if (fastest.count(number) == 0) continue;
    const double reached = fastest[number] / motion_.feed_override;
    if (reached >= line.after_m_s * (1 - kSameFeed)) continue;
    line.bound = FeedBound::acceleration;
    line.after_m_s = std::clamp(reached * (1 + kSameFeed), line.before_m_s, line.after_m_s);
  }
  if (run(ignored) > time_s * (1 + kSameTime)) lines_ = all;
}

void FeedPlan::write_words() {
  std::map<std::size_t, double> unit;  // feed of F1
  bool in_order = true;
  std::size_t before = 0;
  for (const CanonicalMove& move : moves_) {
    in_order = in_order && move.line >= before;
    before = move.line;
    if (at_a_feed(move)) unit[move.line] = move.feed_word_m_s;
  }
  for (auto& [number, line] : lines_) {
    if (line.bound == FeedBound::fixed) continue;
    if (std::abs(line.after_m_s - line.before_m_s) <= kSameFeed * line.before_m_s)
      line.after_m_s = line.before_m_s;
    if (line.changed())  // five digits are a little less
      line.after_m_s = std::stod(word_digits(line.after_m_s / unit[number])) * unit[number];
  }
  if (std::none_of(lines_.begin(), lines_.end(), [](const auto& l) { return l.second.changed(); }))
    return;
  // A feed stays in force until the next F. Which lines need one of their own is found by going
  // through the moves until none is missing.
  std::set<std::size_t> own, silent;  // silent: no move at a feed shows it
  for (std::size_t number = 1; number <= text_.size(); ++number)
    if (has_word(number)) (lines_.count(number) > 0 ? own : silent).insert(number);
  if (!silent.empty() && !in_order)
    for (const auto& [number, line] : lines_)
      if (unit[number] > 0) own.insert(number);
  for (bool again = true; again;) {
    again = false;
    double in_force = 0;
    bool per_turn = false;
    before = 0;
    for (const CanonicalMove& move : moves_) {
      if (!at_a_feed(move) || !(unit[move.line] > 0)) continue;
      const Line& line = lines_[move.line];
      const auto quiet = silent.upper_bound(before);
      if (in_order && quiet != silent.end() && *quiet < move.line)
        in_force = move.feed_m_s, per_turn = move.feed_m_rev > 0;
      const bool fits = std::abs(in_force - line.after_m_s) <= kSameFeed * line.after_m_s &&
                        per_turn == (move.feed_m_rev > 0);
      if (own.count(move.line) == 0 && !fits) own.insert(move.line), again = true;
      in_force = line.after_m_s, per_turn = move.feed_m_rev > 0;
      before = move.line;
    }
  }
  for (const std::size_t number : own) {
    const Line& line = lines_[number];
    if (line.changed())
      words_[number] = word_digits(line.after_m_s / unit[number]);
    else if (!has_word(number))
      words_[number] = printed(line.after_m_s / unit[number], 12);
  }
}

void FeedPlan::solve() {
  bound_moves();
  if (accelerated_) leave_out_what_gains_nothing();
  write_words();
}

}  // namespace servosense::process
