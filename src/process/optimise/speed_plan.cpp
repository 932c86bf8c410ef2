#include "servosense/process/optimise/speed_plan.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "servosense/io/text.hpp"
#include "servosense/process/optimise/word_text.hpp"

namespace servosense::process {
namespace {

constexpr int kTurn = static_cast<int>(360 / SpeedPlan::kAngleStep_deg);
/// Sine of the climb from which a tool goes down more than along: its side does not tell how it
/// vibrates.
constexpr double kSteepest = 0.5;

double rpm_of(double cutting_speed_m_s, double radius_m) {
  return cutting_speed_m_s / radius_m * 30 / std::numbers::pi;
}

/// As an S word says it, not more: whole where that is no matter.
double worded(double rpm) {
  return rpm >= 100 ? std::floor(rpm * (1 + 1e-12)) : std::stod(word_digits(rpm));
}

/// Keeps the areas that no other exceeds in both: the least feed is among theirs.
void add_areas(std::vector<StepAreas>& all, const StepAreas& a) {
  const auto covers = [](const StepAreas& big, const StepAreas& small) {
    return big.removed_m2 >= small.removed_m2 && big.contact_m2 >= small.contact_m2;
  };
  if (std::ranges::any_of(all, [&](const StepAreas& b) { return covers(b, a); })) return;
  std::erase_if(all, [&](const StepAreas& b) { return covers(a, b); });
  all.push_back(a);
}

}  // namespace

std::string_view bound_name(SpeedBound bound) {
  static constexpr std::array<std::string_view, 6> names = {
      "loads", "cutting-speed", "spindle-speed", "stability", "axes", "fixed"};
  return names[static_cast<std::size_t>(bound)];
}

SpeedPlan::SpeedPlan(std::vector<std::string> lines, const CutLimits& limits,
                     const MotionLimits& motion, const std::array<double, 2>& compliance,
                     const std::array<double, 2>& spindle_rpm)
    : text_(std::move(lines)),
      limits_(limits),
      motion_(motion),
      compliance_(compliance),
      spindle_rpm_(spindle_rpm) {}

void SpeedPlan::fix(std::size_t line, const std::string& why) {
  Word& word = words_[line];
  if (word.why.empty()) word.why = why;
}

void SpeedPlan::put(const CanonicalMove& move, const ToolLaw* law) {
  if (move.kind == CanonicalMove::Kind::tool) tool_ = move.tool;
  if (move.kind == CanonicalMove::Kind::spindle && move.number == 0) word_ = move.line;
  axis_m_s_.push_back(at_a_feed(move) ? axis_speed(move, machine_, motion_) : kNoLimit);
  if (is_motion(move.kind) && move.kind != CanonicalMove::Kind::tap) machine_ = move.machine;
  moves_.push_back(move);
  laws_.push_back(law);
  word_of_.push_back(word_);
  tool_of_.push_back(tool_);
  if (word_ != 0 && (move.kind == CanonicalMove::Kind::tap || move.threads))
    fix(word_, "a thread is cut at it");
}

void SpeedPlan::add(const Engagement& e) {
  const CanonicalMove& move = moves_[e.move];
  const std::size_t word = word_of_[e.move];
  if (!at_a_feed(move) || word == 0 || move.spindle_rpm == 0) return;
  Section& section = sections_[word];
  LineCut& cut = section.lines[move.line];
  cut.length_m += e.path_m;
  cut.greatest_m_s = std::min({cut.greatest_m_s, axis_m_s_[e.move], limits_.feed_m_s});
  if (!e.cuts()) return;

  Word& of = words_[word];
  if (of.before_rpm == 0) {
    of.before_rpm = of.after_rpm = std::abs(move.spindle_rpm);
    const std::string_view text =
        word <= text_.size() ? std::string_view(text_[word - 1]) : std::string_view();
    const CodeWord s = code_word_of(text, 'S');
    const auto number = s.found() && s.plain
                            ? parse_number(trim(text.substr(s.begin + 1, s.end - s.begin - 1)))
                            : ParsedNumber<double>{};
    if (!number.ok() || std::abs(number.value - of.before_rpm) > 1e-9 * of.before_rpm)
      fix(word, "its S is not a number that says the speed");
  }
  const int tool = tool_of_[e.move];
  const ToolLaw* law = laws_[e.move];
  if (std::abs(std::abs(move.spindle_rpm) - of.before_rpm) > 1e-9 * of.before_rpm)
    fix(word, "its cuts are made at several speeds");
  if (move.spindle_rpm < 0) fix(word, "the spindle turns counterclockwise");
  if (!cutting_speed_.contains(tool))
    fix(word, "tool " + std::to_string(tool) + " has no cutting_speed_m_s");
  else if (const auto why = unstudied_.find(tool); why != unstudied_.end())
    fix(word, why->second);
  if (law == nullptr || law->teeth == 0) {
    fix(word, "the teeth of its tool are not known");
    return;
  }
  cut.law = law, cut.tool = tool;
  // At one tooth a second the feed is that of a tooth.
  CutLimits any_speed = limits_;
  any_speed.torque_Nm = any_speed.power_W = CutLimits::kNone;
  cut.feed_per_tooth_m =
      std::min(cut.feed_per_tooth_m,
               bound_feed(e, *law, 60.0 / law->teeth, compliance_, any_speed).feed_m_s);
  add_areas(cut.areas, step_areas(e));

  if (e.arcs.empty() || std::abs(e.rise) > kSteepest) return;
  double from_deg = e.arcs.front().from_deg, to_deg = e.arcs.front().to_deg;
  for (const Arc& arc : e.arcs)
    from_deg = std::min(from_deg, arc.from_deg), to_deg = std::max(to_deg, arc.to_deg);
  const double ahead_deg = std::atan2(e.ahead[1], e.ahead[0]) * 180 / std::numbers::pi;
  const auto steps = [&](double deg) {
    return static_cast<int>(std::lround((deg - ahead_deg) / kAngleStep_deg));
  };
  const int first = steps(from_deg);
  const int swept = std::clamp(steps(to_deg) - first, 1, kTurn);
  const int start = ((first % kTurn) + kTurn) % kTurn;
  double& depth = section.cuts[tool][{start, start + swept}];
  depth = std::max(depth, e.axial_depth_m);
}

void SpeedPlan::keep(std::size_t line, const std::string& why) {
  for (const auto& [word, section] : sections_) {
    const auto cut = section.lines.find(line);
    if (cut != section.lines.end() && cut->second.law != nullptr)
      fix(word, "line " + std::to_string(line) + " keeps its feed: " + why);
  }
}

double SpeedPlan::feed(const LineCut& cut, double rpm) const {
  const double teeth_s = cut.law->teeth * rpm / 60;
  const double torque_Nm = std::min(limits_.torque_at(rpm), limits_.torque_of_power(rpm));
  double feed_m = cut.feed_per_tooth_m;
  if (cut.law->torque && std::isfinite(torque_Nm))
    for (const StepAreas& a : cut.areas)
      feed_m = std::min(feed_m, cut.law->torque->feed_m(torque_Nm, a.removed_m2, a.contact_m2));
  return std::min(feed_m * teeth_s, cut.greatest_m_s);
}

double SpeedPlan::seconds(const Section& section, double rpm) const {
  double sum = 0;
  for (const auto& [line, cut] : section.lines) {
    if (cut.law == nullptr) continue;
    const double feed_m_s = feed(cut, rpm);
    if (!(feed_m_s > 0)) return kNoLimit;
    sum += cut.length_m / feed_m_s;
  }
  return sum;
}

double SpeedPlan::probability(const Section& section, const Stability& of, double rpm,
                              double least) const {
  double all = 1;
  for (const auto& [tool, cuts] : section.cuts) {
    std::vector<SideCut> list;
    for (const auto& [arc, depth_m] : cuts) {
      constexpr double step = kAngleStep_deg * std::numbers::pi / 180;
      list.push_back({{arc.first * step, arc.second * step}, depth_m});
    }
    all = std::min(all, of(tool, list, rpm, least));
    if (all < least) break;
  }
  return all;
}

void SpeedPlan::choose(const Section& section, Word& word, const Stability& stability,
                       double least) {
  std::array<double, 2> range = spindle_rpm_;
  std::array<SpeedBound, 2> by = {SpeedBound::spindle_speed, SpeedBound::spindle_speed};
  for (const auto& [line, cut] : section.lines) {
    if (cut.law == nullptr) continue;
    const auto& speed = cutting_speed_.at(cut.tool);
    const double low = rpm_of(speed[0], cut.law->radius_m),
                 high = rpm_of(speed[1], cut.law->radius_m);
    if (low > range[0]) range[0] = low, by[0] = SpeedBound::cutting_speed;
    if (high < range[1]) range[1] = high, by[1] = SpeedBound::cutting_speed;
  }
  const auto between = [&] {
    return printed(range[0], 5) + " and " + printed(range[1], 5) + " rpm";
  };
  struct Try {
    double rpm, seconds;
  };
  std::vector<Try> tries;
  const auto within = [&](double rpm) {
    return rpm >= range[0] * (1 - 1e-9) && rpm <= range[1] * (1 + 1e-9);
  };
  if (within(word.before_rpm)) tries.push_back({word.before_rpm, 0});
  for (double rpm = range[1]; rpm >= range[0]; rpm *= 1 - kSpeedStep)
    if (const double said = worded(rpm); within(said)) tries.push_back({said, 0});
  if (tries.empty()) {
    word.why = "no speed lies between " + between();
    return;
  }
  for (Try& t : tries) t.seconds = seconds(section, t.rpm);
  const auto before = within(word.before_rpm) ? tries.front() : Try{word.before_rpm, kNoLimit};
  std::ranges::stable_sort(tries, {}, &Try::seconds);
  if (!std::isfinite(tries.front().seconds)) {
    word.why = "its loads are above the limits at any speed between " + between();
    return;
  }
  word.cut_before_s = seconds(section, word.before_rpm);
  word.probability_before = probability(section, stability, word.before_rpm, 0);
  const auto stable = [&](double rpm) {
    return rpm == word.before_rpm ? word.probability_before >= least
                                  : probability(section, stability, rpm, least) >= least;
  };
  const auto fastest = std::ranges::find_if(
      tries, [&](const Try& t) { return std::isfinite(t.seconds) && stable(t.rpm); });
  if (fastest == tries.end()) {
    word.why = "no speed between " + between() + " is stable with a probability of " +
               printed(100 * least, 3) + " %";
    return;
  }
  Try chosen = *fastest;
  if (stable(before.rpm) && before.seconds * (1 - kLeastGain) <= fastest->seconds) {
    chosen = before;
  } else {
    std::vector<Try> alike;
    for (const Try& t : tries)
      if (t.seconds <= fastest->seconds * (1 + kAlike)) alike.push_back(t);
    std::ranges::stable_sort(
        alike, {}, [&](const Try& t) { return std::abs(std::log(t.rpm / word.before_rpm)); });
    chosen = *std::ranges::find_if(alike, [&](const Try& t) { return stable(t.rpm); });
  }
  word.after_rpm = chosen.rpm;
  word.cut_after_s = chosen.seconds;
  word.forced = word.changed() && !(std::isfinite(before.seconds) && stable(before.rpm));
  word.probability_after = chosen.rpm == word.before_rpm
                               ? word.probability_before
                               : probability(section, stability, chosen.rpm, 0);
  const auto gains = [&](double seconds_there) {
    return seconds_there < chosen.seconds * (1 - kLeastGain);
  };
  constexpr double kBeyond = 1.05;
  const bool at_axes = std::ranges::all_of(section.lines, [&](const auto& l) {
    return l.second.law == nullptr || feed(l.second, chosen.rpm) >= l.second.greatest_m_s;
  });
  if (gains(tries.front().seconds))
    word.bound = SpeedBound::stability;
  else if (gains(seconds(section, range[1] * kBeyond)))
    word.bound = by[1];
  else if (gains(seconds(section, range[0] / kBeyond)))
    word.bound = by[0];
  else
    word.bound = at_axes ? SpeedBound::axes : SpeedBound::loads;
}

void SpeedPlan::solve(const Stability& stability, double least) {
  std::erase_if(words_, [](const auto& w) { return w.second.before_rpm == 0; });
  for (auto& [line, word] : words_)
    if (word.why.empty()) choose(sections_.at(line), word, stability, least);
}

void SpeedPlan::revert(std::size_t line, SpeedBound bound) {
  Word& word = words_.at(line);
  word.after_rpm = word.before_rpm, word.bound = bound;
  word.cut_after_s = word.cut_before_s, word.probability_after = word.probability_before;
}

std::vector<CanonicalMove> SpeedPlan::moves() const {
  std::vector<CanonicalMove> all = moves_;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto word = words_.find(word_of_[i]);
    if (word == words_.end() || !word->second.changed()) continue;
    const double ratio = word->second.after_rpm / word->second.before_rpm;
    all[i].spindle_rpm *= ratio;
    if (all[i].feed_m_rev > 0) all[i].feed_m_s *= ratio, all[i].feed_word_m_s *= ratio;
  }
  return all;
}

std::map<std::size_t, std::string> SpeedPlan::digits() const {
  std::map<std::size_t, std::string> all;
  for (const auto& [line, word] : words_)
    if (word.changed()) all[line] = printed(word.after_rpm, 9);
  return all;
}

}  // namespace servosense::process
