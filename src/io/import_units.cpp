// Units that other columns settle or contradict, and values that no machine has.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "import_agreement.hpp"
#include "import_draft.hpp"
#include "servosense/core/plausible.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"

namespace servosense::detail {
namespace {

using State = ColumnDraft::State;
using Units = std::vector<std::string_view>;

// Units of one quantity are a factor of 6 apart at least (deg/s and rpm), but for degrees a minute
// and radians a second. A gear or a scale may be a few per cent off.
constexpr double kSameFactor = 1.2;
// To settle what no heading says takes more.
constexpr double kSettledFactor = 1.03;

constexpr std::array<std::string_view, 3> kLengths = {"mm", "m", "um"};
constexpr std::array<std::string_view, 3> kAngles = {"deg", "rad", "rev"};
constexpr std::array<std::string_view, 4> kVelocities = {"mm/min", "mm/s", "m/min", "m/s"};
constexpr std::array<std::string_view, 4> kTurnings = {"rpm", "rad/s", "deg/s", "rev/s"};

double unit_value(std::string_view unit) {
  const auto known = unit_named(unit);
  return known ? known->value : 0;
}

bool turns(Quantity quantity) {
  const Dimension d = dimension_of(quantity);
  return d == Dimension::angle || d == Dimension::angular_speed;
}

/// A position and a speed of one drive, and what the rows say of them.
struct MotionPair {
  std::size_t position = 0, speed = 0;  // columns
  Agreement agreement;
};

class UnitSettler {
 public:
  explicit UnitSettler(ImportDraft& draft) : draft_(draft) {}

  void run() {
    find_pairs();
    if (draft_.time_open) settle_time();
    if (draft_.time_open) return;
    for (const MotionPair& pair : pairs_) settle(pair);
  }

 private:
  [[nodiscard]] std::string named(std::size_t column) const {
    return named_column(*draft_.layout, column);
  }

  void find_pairs() {
    for (const bool command : {false, true})
      for (std::size_t c = 0; c < kChannelNames.size(); ++c) {
        std::vector<std::size_t> positions, speeds;
        for (std::size_t i = 0; i < draft_.columns.size(); ++i) {
          const ColumnDraft& column = draft_.columns[i];
          if (column.state != State::taken && column.state != State::unit_open) continue;
          if (column.channel != static_cast<Channel>(c) || column.command != command) continue;
          if (column.kind == ColumnKind::position && column.unit != "counts")
            positions.push_back(i);
          if (column.kind == ColumnKind::speed || column.kind == ColumnKind::rotation)
            speeds.push_back(i);
        }
        if (positions.size() == 1 && speeds.size() == 1) add_pair(positions[0], speeds[0]);
      }
  }

  void add_pair(std::size_t position, std::size_t speed) {
    const RowSample& sample = draft_.survey.sample;
    const auto at = [&](std::size_t column) {
      return static_cast<std::size_t>(
          std::find(sample.columns.begin(), sample.columns.end(), column) - sample.columns.begin());
    };
    if (at(position) == sample.columns.size() || at(speed) == sample.columns.size()) return;
    const ColumnSurvey& survey = draft_.survey.columns[position];
    const auto found =
        agreement_of(sample, at(position), at(speed), survey.greatest - survey.least);
    if (found) pairs_.push_back({position, speed, *found});
  }

  /// Position steps over speed times time when they have these units; 1 where they agree.
  static double ratio_with(const MotionPair& pair, double position, double speed, double time = 1) {
    return std::abs(pair.agreement.ratio) * position / (speed * time);
  }
  static bool near_one(double ratio, double factor) { return ratio < factor && ratio > 1 / factor; }

  void settle_time() {
    std::vector<std::string_view> fitting;
    std::size_t possible = 0, known = 0;
    const double assumed =
        std::pow(10.0, draft_.time.exponent) * static_cast<double>(draft_.time.multiple);
    std::string by;
    for (const std::string_view unit : {"s", "ms", "us", "ns"}) {
      const double step = draft_.survey.time.median_step_s * unit_value(unit) / assumed;
      if (step < kShortestPeriod_s || step > kImpossiblePeriod_s) continue;
      ++possible;
      bool all = true;
      known = 0;
      for (const MotionPair& pair : pairs_) {
        const ColumnDraft& p = draft_.columns[pair.position];
        const ColumnDraft& v = draft_.columns[pair.speed];
        if (p.state != State::taken || v.state != State::taken) continue;
        if (turns(*p.quantity) != turns(*v.quantity)) continue;
        ++known;
        by = named(pair.position) + " and " + named(pair.speed);
        all = all && near_one(ratio_with(pair, p.factor, v.factor, unit_value(unit) / assumed),
                              kSettledFactor);
      }
      if (known > 0 && all) fitting.push_back(unit);
    }
    // One speed whose own unit is wrong would make the time wrong; two, or the rate of the rows
    // beside it, are another matter.
    if (fitting.size() != 1 || (possible > 1 && known < 2)) return;
    const double scale = unit_value(fitting[0]) / assumed;
    set_time_unit(draft_.time, unit_value(fitting[0]));
    draft_.time_open = false;
    draft_.survey.time.median_step_s *= scale;
    draft_.survey.time.longest_step_s *= scale;
    for (MotionPair& pair : pairs_) {
      pair.agreement.ratio /= scale;
      pair.agreement.standard_error /= scale;
    }
    draft_.time_reason = std::string(fitting[0]) + ", because " + by + " agree in it";
  }

  void settle(const MotionPair& pair) {
    ColumnDraft& p = draft_.columns[pair.position];
    ColumnDraft& v = draft_.columns[pair.speed];
    if (p.state == State::unit_open && v.state == State::unit_open) return;
    if (p.state == State::unit_open) {
      if (v.kind == ColumnKind::speed || turns(*v.quantity)) choose(pair, pair.position);
    } else if (v.state == State::unit_open) {
      choose(pair, pair.speed);
    } else if (turns(*p.quantity) == turns(*v.quantity)) {
      compare(pair);
    }
  }

  /// The one unit in which the open column agrees with the other.
  void choose(const MotionPair& pair, std::size_t open) {
    ColumnDraft& column = draft_.columns[open];
    const bool is_position = open == pair.position;
    const ColumnDraft& other = draft_.columns[is_position ? pair.speed : pair.position];
    const bool turning = turns(*other.quantity);
    // The travel of an axis whose speed is that of its motor needs a lead, which is not here.
    const bool straight_axis = column.channel == Channel::x || column.channel == Channel::y ||
                               column.channel == Channel::z;
    if (straight_axis && turning) return;
    if (column.kind == ColumnKind::rotation && !turning) return;
    Units units(turning ? kAngles.begin() : kLengths.begin(),
                turning ? kAngles.end() : kLengths.end());
    if (!is_position)
      units.assign(turning ? kTurnings.begin() : kVelocities.begin(),
                   turning ? kTurnings.end() : kVelocities.end());
    std::string_view found;
    std::size_t fitting = 0;
    for (const std::string_view unit : units) {
      const double value = unit_value(unit);
      const double ratio = is_position ? ratio_with(pair, value, other.factor)
                                       : ratio_with(pair, other.factor, value);
      if (!near_one(ratio, kSettledFactor)) continue;
      ++fitting;
      found = unit;
    }
    if (fitting != 1) return;
    const auto known = unit_named(found);
    const auto quantity = quantity_of(column.kind, known->dimension, column.command);
    if (!quantity) return;
    column.quantity = quantity;
    column.unit = std::string(found);
    column.factor = known->value;
    column.state = State::taken;
    column.reason = "unit by agreement with " + named(is_position ? pair.speed : pair.position);
  }

  /// Both have units: they must not contradict each other.
  void compare(const MotionPair& pair) {
    const ColumnDraft& p = draft_.columns[pair.position];
    const ColumnDraft& v = draft_.columns[pair.speed];
    const double ratio = ratio_with(pair, p.factor, v.factor);
    const bool sure = 4 * pair.agreement.standard_error < 0.2 * std::abs(pair.agreement.ratio);
    if (near_one(ratio, kSameFactor) || !sure) {
      if (near_one(ratio, kSameFactor) && pair.agreement.ratio < 0)
        draft_.remarks.push_back(named(pair.position) + " and " + named(pair.speed) +
                                 " count in opposite directions");
      return;
    }
    std::string other_unit;
    const bool turning = turns(*v.quantity);
    for (const std::string_view unit : turning ? Units(kTurnings.begin(), kTurnings.end())
                                               : Units(kVelocities.begin(), kVelocities.end()))
      if (near_one(ratio_with(pair, p.factor, unit_value(unit)), kSameFactor))
        other_unit = std::string(unit);
    std::string position_unit;
    for (const std::string_view unit :
         turning ? Units(kAngles.begin(), kAngles.end()) : Units(kLengths.begin(), kLengths.end()))
      if (near_one(ratio_with(pair, unit_value(unit), v.factor), kSameFactor))
        position_unit = std::string(unit);
    std::string text = named(pair.position) + " in " + p.unit + " and " + named(pair.speed) +
                       " in " + v.unit + " contradict each other: the position changes " +
                       printable(number_text(std::round(ratio * 1000) / 1000)) +
                       " times as fast as the speed says";
    if (!other_unit.empty()) text += "; " + other_unit + " would fit the speed";
    if (!position_unit.empty())
      text += (other_unit.empty() ? "; " : ", or ") + position_unit + " the position";
    if (p.answered && v.answered) {
      draft_.remarks.push_back(text);
      return;
    }
    const auto name_of_column = [](const ColumnDraft& c) {
      return column_name({c.channel, *c.quantity});
    };
    draft_.questions.push_back(
        text + ": say both, " +
        answer_option(*draft_.layout, pair.position, name_of_column(p),
                      position_unit.empty() ? p.unit : position_unit) +
        " " +
        answer_option(*draft_.layout, pair.speed, name_of_column(v),
                      position_unit.empty() && !other_unit.empty() ? other_unit : v.unit));
  }

  ImportDraft& draft_;
  std::vector<MotionPair> pairs_;
};

}  // namespace

void settle_units(ImportDraft& draft) { UnitSettler(draft).run(); }

void check_ranges(ImportDraft& draft) {
  for (std::size_t i = 0; i < draft.columns.size(); ++i) {
    const ColumnDraft& column = draft.columns[i];
    const ColumnSurvey& survey = draft.survey.columns[i];
    if (column.state != State::taken || survey.values == 0) continue;
    const QuantityRange range = range_of(*column.quantity);
    const double least = survey.least * column.factor;
    const double greatest = survey.greatest * column.factor;
    if (least >= range.least && greatest <= range.greatest) continue;
    const double worst = greatest > range.greatest ? survey.greatest : survey.least;
    const double limit = greatest > range.greatest ? range.greatest : range.least;
    const std::string name = column_name({column.channel, *column.quantity});
    std::string text = named_column(*draft.layout, i) + " reaches " + number_text(worst) +
                       (column.unit.empty() ? "" : " " + column.unit) +
                       ", beyond what machines do (" + number_text(limit) + " " +
                       std::string(unit_of(*column.quantity)) + ")";
    if (column.answered) {
      draft.remarks.push_back(text);
      continue;
    }
    std::string unit = column.unit;
    for (const std::string_view other : usual_units(column)) {
      const auto value = value_of_unit(other, *column.quantity);
      if (value && std::abs(worst) * *value <= std::abs(limit) && *value < column.factor) {
        unit = std::string(other);
        break;
      }
    }
    if (unit != column.unit) text += "; is it in " + unit + "?";
    draft.questions.push_back(text + " " + answer_option(*draft.layout, i, name, unit) +
                              ", or leave it out: " + answer_option(*draft.layout, i, "-", ""));
  }
}

}  // namespace servosense::detail
