// Stretches of cutting and of air in a record, by the level of its first signal.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "cutting_rows.hpp"
#include "cutting_turns.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/quantile.hpp"
#include "servosense/identify/cutting.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense {
namespace {

using cutting_rows::kStill_m_s;
using cutting_turns::Means;
using cutting_turns::Turns;

// Conventions, unless told otherwise.
constexpr double kSameSpeed = 0.02;       // of the speed
constexpr double kSameFeed = 0.03;        // of the feed
constexpr double kFrictionWrong = 0.5;    // the most that friction of a file may be off: air
constexpr double kAirOfCut = 0.3;         // the same of the cut, where a file has no friction
constexpr double kAirBand = 0.15;         // of the range of levels, in which air lies
constexpr double kLeastCut = 0.05;        // of the greatest level: what cuts
constexpr double kNoise = 6;              // standard deviations: one turn in 5e8 by chance
constexpr double kOfFive = 0.55;          // standard deviation of the median of five, of one
constexpr double kSettledBy = 0.03;       // of the level: the tool is fully in
constexpr double kSkip = 5;               // time constants: less than 1 % is left
constexpr std::size_t kScatterTurns = 8;  // that show a scatter
constexpr double kLeastCut_s = 0.1;
constexpr double kUneven = 0.05;        // of the level, between the halves of a cut
constexpr double kClearStep = 4;        // standard errors
constexpr double kFlat = 0.3;           // share of a cut at the highest value of the record
constexpr double kFiltered = 10;        // of a tooth less than a tenth is left
constexpr std::size_t kFewLevels = 10;  // that a coarse quantum leaves of a cut
constexpr std::size_t kFlicker = 4;     // turns
constexpr double kFlatCut = 0.02;       // of z in the path
constexpr double kNoisy = 1e-6;         // of the level: a meter without noise has less

std::string seconds(double s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g s", s);
  return text;
}

enum class State { invalid, air, cutting };

/// What is known of one stretch of turns.
struct Turn {
  Turns at;
  double level = 0, feed = 0;
  std::array<double, 3> velocity{};
  std::int32_t block = 0;
  bool even = false;      // its speed is that of the turn before
  std::size_t speed = 0;  // group
  State state = State::invalid;
};

class Finder {
 public:
  Finder(const CuttingRecord& record, const CutGeometry& geometry)
      : record_(record), geometry_(geometry) {
    for (const CuttingSignal& signal : record.signals) means_.emplace_back(signal.value);
  }

  Expected<std::vector<FoundCut>> find() {
    look();
    if (turns_.empty())
      return data_error(record_.name +
                        ": the spindle stands or turns slower than 50 rpm; give a record of cuts");
    for (std::size_t group = 0; group < speeds_.size(); ++group) classify(group);
    std::vector<FoundCut> found;
    for (std::size_t from = 0; from < turns_.size();) {
      std::size_t to = from + 1;
      while (to < turns_.size() && same_stretch(from, to)) ++to;
      if (turns_[from].state != State::invalid) take(from, to, found);
      from = to;
    }
    const bool none = std::ranges::all_of(found, &FoundCut::air);
    const auto cutting = std::ranges::count(turns_, State::cutting, &Turn::state);
    if (none && static_cast<std::size_t>(cutting) >= kScatterTurns)
      return data_error(record_.name +
                        ": the level stands out from the air for a few turns at a time only; give "
                        "cuts of a second each, without chatter");
    return found;
  }

 private:
  void look() {
    ends_ = cutting_turns::turns_of(record_);
    const Means feed(record_.feed_per_tooth_m);
    std::vector<Means> velocity;
    for (const auto& v : record_.velocity_m_s) velocity.emplace_back(v);
    for (const Turns& at : ends_) {
      Turn t;
      t.at = at;
      t.level = level_of(at);
      for (std::size_t a = 0; a < 3; ++a)
        if (!record_.velocity_m_s[a].empty()) t.velocity[a] = velocity[a](at.from, at.to);
      if (!record_.feed_per_tooth_m.empty())
        t.feed = feed(at.from, at.to);
      else if (const double pace = std::hypot(t.velocity[0], t.velocity[1]);
               knows_axes() || pace > kStill_m_s)
        t.feed = pace * kTwoPi / (std::abs(at.speed_rad_s) * geometry_.teeth);
      else
        t.feed = geometry_.feed_per_tooth_m;
      if (!record_.block.empty()) t.block = record_.block[static_cast<std::size_t>(at.from)];
      if (!turns_.empty() && turns_.back().at.to == at.from) {
        const double last = turns_.back().at.speed_rad_s;
        t.even = std::abs(at.speed_rad_s - last) <= kSameSpeed * std::abs(last);
      }
      t.speed = group_of(at.speed_rad_s);
      turns_.push_back(t);
    }
  }
  /// The torque, of a dynamometer without it the force in the plane.
  [[nodiscard]] double level_of(const Turns& at) const {
    double force = 0;
    for (std::size_t s = 0; s < means_.size(); ++s) {
      const CuttingSignal& signal = record_.signals[s];
      if (signal.kind == CuttingSignal::Kind::torque) return means_[s](at.from, at.to);
      if (!signal.is_drive && signal.kind != CuttingSignal::Kind::z)
        force = std::hypot(force, means_[s](at.from, at.to));
    }
    return force;
  }
  /// Of the friction that the file takes off the level.
  [[nodiscard]] double friction_at(double speed) const {
    for (const CuttingSignal& signal : record_.signals)
      if (signal.kind == CuttingSignal::Kind::torque)
        return std::abs(signal.coulomb + signal.viscous * std::abs(speed));
    return 0;
  }
  [[nodiscard]] bool knows_axes() const {
    return !record_.velocity_m_s[0].empty() && !record_.velocity_m_s[1].empty();
  }
  std::size_t group_of(double speed) {
    for (std::size_t g = 0; g < speeds_.size(); ++g)
      if (std::abs(speed - speeds_[g]) <= 2 * kSameSpeed * std::abs(speeds_[g])) return g;
    speeds_.push_back(speed);
    return speeds_.size() - 1;
  }

  /// Air and cutting among the turns at one speed.
  void classify(std::size_t group) {
    std::vector<std::size_t> own;
    for (std::size_t k = 0; k < turns_.size(); ++k)
      if (turns_[k].speed == group && turns_[k].even && std::isfinite(turns_[k].level))
        own.push_back(k);
    if (own.size() < kScatterTurns) return;
    std::vector<double> steps, smooth;
    for (std::size_t i = 1; i < own.size(); ++i)
      if (own[i] == own[i - 1] + 1)
        steps.push_back(std::abs(turns_[own[i]].level - turns_[own[i - 1]].level));
    const double noise = median(steps) / (0.6745 * std::sqrt(2.0));
    for (std::size_t i = 2; i + 2 < own.size(); ++i)
      smooth.push_back(
          median({turns_[own[i - 2]].level, turns_[own[i - 1]].level, turns_[own[i]].level,
                  turns_[own[i + 1]].level, turns_[own[i + 2]].level}));
    std::vector<double> sorted = smooth;
    std::sort(sorted.begin(), sorted.end());
    const double low = sorted[sorted.size() / 50],
                 high = sorted[sorted.size() - 1 - sorted.size() / 50];
    const double friction = friction_at(speeds_[group]);
    const double air_limit = friction > 0 ? kFrictionWrong * friction + kNoise * noise
                                          : std::max(kAirOfCut * high, kNoise * noise);
    const bool has_air = low <= air_limit;
    std::vector<double> air;
    for (const double level : smooth)
      if (level <= low + std::max(kAirBand * (high - low), kNoise * noise)) air.push_back(level);
    const double floor = has_air ? median(air) : 0;
    const double cutting = floor + std::max(kNoise * kOfFive * noise, kLeastCut * (high - floor));
    for (std::size_t i = 0; i < own.size(); ++i) {
      const double level = i >= 2 && i + 2 < own.size() ? smooth[i - 2] : turns_[own[i]].level;
      turns_[own[i]].state = level > cutting || !has_air ? State::cutting : State::air;
    }
    // While the tool goes in, noise brings it below that level now and again.
    for (std::size_t i = 0, last = own.size(); i < own.size(); ++i) {
      if (turns_[own[i]].state != State::cutting) continue;
      if (last < i && i - last <= kFlicker)
        for (std::size_t k = last; k < i; ++k) turns_[own[k]].state = State::cutting;
      last = i;
    }
    if (noise_.size() <= group) noise_.resize(group + 1);
    noise_[group] = noise;
  }

  [[nodiscard]] bool same_stretch(std::size_t from, std::size_t to) const {
    const Turn &a = turns_[from], &b = turns_[to];
    if (b.state != a.state || b.speed != a.speed || b.at.from != turns_[to - 1].at.to) return false;
    if (a.state == State::invalid) return true;
    if (b.block != a.block) return false;
    // In the air a feed tells nothing, but the friction of an axis has its direction.
    const Turn& middle = turns_[from + (to - from) / 2];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (record_.velocity_m_s[axis].empty()) continue;
      const double u = middle.velocity[axis], v = b.velocity[axis];
      if (std::abs(u - v) >
          std::max(kStill_m_s, 2 * kSameFeed * std::max(std::abs(u), std::abs(v))))
        return false;
    }
    return a.state == State::air || !std::isfinite(middle.feed) ||
           std::abs(b.feed - middle.feed) <= kSameFeed * middle.feed;
  }

  /// What of the stretch can be used, or why nothing.
  void take(std::size_t from, std::size_t to, std::vector<FoundCut>& found) {
    const bool air = turns_[from].state == State::air;
    const double each_s = (turns_[to - 1].at.to - turns_[from].at.from) * record_.sample_period_s /
                          static_cast<double>(to - from);
    // A few turns beside others are where feed or direction change.
    std::size_t before = from, after = to;
    while (before > 0 && turns_[before - 1].state == State::cutting) --before;
    while (after < turns_.size() && turns_[after].state == State::cutting) ++after;
    const std::size_t others = (from - before) + (after - to);
    const bool passing =
        to - from < kFlicker || (to - from < kScatterTurns && (air || others >= kScatterTurns));
    if (passing) return;
    std::size_t first = from, last = to;
    double lag_s = 0;
    for (const CuttingSignal& signal : record_.signals) lag_s = std::max(lag_s, signal.lag_s);
    if (!air) settle(first, last);
    const auto skip = 1 + static_cast<std::size_t>(std::ceil(kSkip * lag_s / each_s));
    first += skip;
    last = last > skip ? last - skip : 0;
    FoundCut cut;
    cut.air = air;
    const bool enough =
        last >= first + kScatterTurns && static_cast<double>(last - first) * each_s >= kLeastCut_s;
    if (air && !enough) return;
    if (!enough) {
      const double found_s = static_cast<double>(to - from) * each_s;
      const double needed_s = std::max(kLeastCut_s, static_cast<double>(kScatterTurns) * each_s) +
                              found_s -
                              static_cast<double>(last > first ? last - first : 0) * each_s;
      cut.reason = "too short: of " + seconds(found_s) +
                   " nothing is left of entry, exit and the lag of the sensor; cut for " +
                   seconds(needed_s) + " at least";
      first = from;
      last = to;
    }
    describe(cut, first, last);
    if (enough) cut.reason = fault(cut, first, last);
    cut.used = cut.reason.empty();
    found.push_back(std::move(cut));
  }
  /// Leaves out where the tool is not fully in yet, or no more: up to the level within a tolerance,
  /// and what a torque that bends towards it like a parabola needs from there.
  void settle(std::size_t& first, std::size_t& last) const {
    std::vector<double> levels;
    for (std::size_t k = first; k < last; ++k) levels.push_back(turns_[k].level);
    const double level = median(levels);
    const double within = std::max(kClearStep * noise_[turns_[first].speed], kSettledBy * level);
    const double rest = level > 0 ? std::min(1.0, std::sqrt(2 * within / level)) : 1;
    const auto more = [&](std::size_t turns) {
      return static_cast<std::size_t>(std::ceil(rest * static_cast<double>(turns)));
    };
    const std::size_t from = first, to = last;
    while (first < last && std::abs(turns_[first].level - level) > within) ++first;
    while (last > first && std::abs(turns_[last - 1].level - level) > within) --last;
    first = std::min(last, first + more(first - from));
    last = std::max(first, last - std::min(last, more(to - last)));
  }

  void describe(FoundCut& cut, std::size_t first, std::size_t last) const {
    const Turns &begin = turns_[first].at, &end = turns_[last - 1].at;
    cut.from_s = record_.start_s + begin.from * record_.sample_period_s;
    cut.to_s = record_.start_s + end.to * record_.sample_period_s;
    const auto count = static_cast<double>(last - first);
    double feed = 0;
    for (std::size_t k = first; k < last; ++k) {
      cut.speed_rad_s += turns_[k].at.speed_rad_s / count;
      feed += turns_[k].feed / count;
      for (std::size_t a = 0; a < 3; ++a) cut.velocity_m_s[a] += turns_[k].velocity[a] / count;
    }
    cut.feed_per_tooth_m = std::isfinite(feed) ? feed : 0;
    const double speed = std::hypot(cut.velocity_m_s[0], cut.velocity_m_s[1]);
    if (speed > 0) cut.direction = {cut.velocity_m_s[0] / speed, cut.velocity_m_s[1] / speed};
    for (std::size_t s = 0; s < record_.signals.size(); ++s)
      cut.means.push_back(cutting_turns::mean_over(record_.signals[s], means_[s], ends_, first,
                                                   last, record_.sample_period_s));
  }

  [[nodiscard]] std::string fault(const FoundCut& cut, std::size_t first, std::size_t last) const {
    const double speed = std::abs(cut.speed_rad_s);
    char text[200];
    if (speed < record_.known_from_rad_s) {
      std::snprintf(text, sizeof text,
                    "at %.0f rpm a power does not tell the torque; cut faster "
                    "than %.0f rpm",
                    rpm_from_rad_s(speed), rpm_from_rad_s(record_.known_from_rad_s));
      return text;
    }
    if (record_.known_to_rad_s > 0 && speed > record_.known_to_rad_s * (1 + kSameSpeed)) {
      std::snprintf(text, sizeof text,
                    "at %.0f rpm the torque constant is not known; it is up to "
                    "%.0f rpm",
                    rpm_from_rad_s(speed), rpm_from_rad_s(record_.known_to_rad_s));
      return text;
    }
    if (cut.air) return {};
    for (const CuttingSignal& signal : record_.signals)
      if (saturated(signal, first, last)) return signal.name + " is at its limit; cut lighter";
    if (std::abs(cut.velocity_m_s[2]) >
        std::max(kStill_m_s, kFlatCut * std::hypot(cut.velocity_m_s[0], cut.velocity_m_s[1])))
      return "z moves in it, and holes, ramps and turning follow another law; mill in the plane of "
             "x and y";
    if (!(cut.feed_per_tooth_m > 0))
      return "the feed per tooth is not known; record tool.feed_per_tooth_m or the axes, or write "
             "[cut] feed_per_tooth_m";
    if (in_step(speed, cut.to_s - cut.from_s)) {
      std::snprintf(text, sizeof text,
                    "at %.0f rpm the teeth pass in step with the %.4g Hz of the record, which sees "
                    "them at one angle only; cut at another speed",
                    rpm_from_rad_s(speed), 1 / record_.sample_period_s);
      return text;
    }
    const std::size_t middle = first + (last - first) / 2;
    const CutMean a = level_over(first, middle), b = level_over(middle, last);
    const double off = std::abs(b.value - a.value);
    if (off > kUneven * std::abs(a.value) &&
        off > kClearStep * std::hypot(a.standard_error, b.standard_error)) {
      std::snprintf(text, sizeof text,
                    "its level runs from %.3g to %.3g; depth, width or feed change in it", a.value,
                    b.value);
      return text;
    }
    return {};
  }
  /// Whether the teeth, or twice as many, are sampled at an angle that does not go round within the
  /// cut.
  [[nodiscard]] bool in_step(double speed_rad_s, double duration_s) const {
    const double rate_hz = 1 / record_.sample_period_s;
    if (record_.signals[0].filter_s * speed_rad_s * geometry_.teeth > kFiltered) return false;
    for (const double order : {1.0, 2.0}) {
      const double hz = order * geometry_.teeth * speed_rad_s / kTwoPi;
      const double times = std::round(hz / rate_hz);
      if (times >= 1 && std::abs(hz - times * rate_hz) * duration_s < 2) return true;
    }
    return false;
  }
  [[nodiscard]] CutMean level_over(std::size_t first, std::size_t last) const {
    const auto n = static_cast<double>(last - first);
    double sum = 0, squares = 0;
    for (std::size_t k = first; k < last; ++k) sum += turns_[k].level;
    for (std::size_t k = first; k < last; ++k) squares += std::pow(turns_[k].level - sum / n, 2);
    return {sum / n, std::sqrt(squares) / n};
  }
  /// Whether a good part of the cut is at the highest value of the record.
  [[nodiscard]] bool saturated(const CuttingSignal& signal, std::size_t first,
                               std::size_t last) const {
    if (signal.raw.empty()) return false;
    double highest = 0;
    for (const double v : signal.raw)
      if (std::isfinite(v)) highest = std::max(highest, std::abs(v));
    const auto from = static_cast<std::size_t>(turns_[first].at.from);
    const auto to = std::min(static_cast<std::size_t>(turns_[last - 1].at.to), signal.raw.size());
    double at_limit = 0, count = 0;
    std::set<double> levels;
    for (std::size_t i = from; i < to; ++i) {
      ++count;
      if (std::abs(signal.raw[i]) >= highest * (1 - 1e-9)) ++at_limit;
      if (levels.size() <= kFewLevels) levels.insert(signal.raw[i]);
    }
    // A coarse meter has few values, and one without noise may well stay at one.
    const Turn& turn = turns_[first];
    const bool all = levels.size() == 1 && noise_[turn.speed] > kNoisy * std::abs(turn.level);
    return highest > 0 && at_limit > kFlat * count && (all || levels.size() > kFewLevels);
  }

  const CuttingRecord& record_;
  const CutGeometry& geometry_;
  std::vector<Means> means_;  // by signal
  std::vector<Turns> ends_;
  std::vector<Turn> turns_;
  std::vector<double> speeds_, noise_;  // by group
};

}  // namespace

Expected<std::vector<FoundCut>> find_cuts(const CuttingRecord& record,
                                          const CutGeometry& geometry) {
  return Finder(record, geometry).find();
}

Expected<CutGeometry> cut_geometry(const MachineFile& machine) {
  if (!machine.has("tool", "teeth"))
    return data_error(machine.where("tool") +
                      ": [tool] has no teeth: coefficients are found for milling, not for turning, "
                      "where the spindle carries the work; of a mill write teeth");
  auto tool = milling_teeth(machine);
  if (!tool) return tool.error();
  CutGeometry geometry;
  MillingCut cut;
  const std::string direction = machine.text("cut", "direction").value_or("down");
  auto depth = machine.required_number("cut", "axial_depth_m");
  if (!depth) return depth.error();
  if (direction != "slot") {
    auto width = machine.required_number("cut", "radial_immersion_m");
    if (!width) return width.error();
    cut.radial_immersion_m = *width;
  }
  cut.direction = direction == "slot" ? MillingDirection::slot
                  : direction == "up" ? MillingDirection::up
                                      : MillingDirection::down;
  geometry.teeth = tool->teeth;
  geometry.radius_m = tool->radius_m();
  geometry.axial_depth_m = *depth;
  geometry.engagement = engagement_of(*tool, cut);
  geometry.throw_m = tool->throw_m;
  geometry.runout_known = machine.has("tool", "runout_m") || !tool->throw_m.empty();
  geometry.feed_per_tooth_m = machine.number("cut", "feed_per_tooth_m").value_or(0);
  return geometry;
}

}  // namespace servosense
