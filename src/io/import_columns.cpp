// What a column is, by its heading, its unit and its values.
#include <algorithm>
#include <array>
#include <cmath>

#include "import_draft.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"

namespace servosense::detail {
namespace {

using State = ColumnDraft::State;

ColumnDraft left_out_because(std::string reason) {
  ColumnDraft draft;
  draft.reason = std::move(reason);
  return draft;
}

ColumnDraft asked(ColumnDraft draft, std::string question) {
  draft.state = State::open;
  draft.question = std::move(question);
  return draft;
}

std::string list_of(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + in_quotes(word);
  return text;
}

/// Kinds that the heading names or, with a unit, letters and the unit itself tell.
std::vector<ColumnKind> kinds_by(const HeadingMeaning& m) {
  if (!m.kinds.empty() || !m.known_unit) return m.kinds;
  std::vector<ColumnKind> kinds;
  for (const ColumnKind kind : m.symbols)
    if (kind_fits(kind, m.known_unit->dimension)) kinds.push_back(kind);
  if (!kinds.empty() || !m.symbols.empty()) return kinds;
  // "X [mm]", "S1 [rpm]": one kind alone has such a unit.
  for (int k = 0; k <= static_cast<int>(ColumnKind::counts); ++k)
    if (kind_fits(static_cast<ColumnKind>(k), m.known_unit->dimension))
      kinds.push_back(static_cast<ColumnKind>(k));
  const Dimension d = m.known_unit->dimension;
  if (d == Dimension::angular_speed || d == Dimension::velocity) return {ColumnKind::speed};
  if (d == Dimension::counts) return {ColumnKind::position};
  return kinds;
}

bool needs_no_drive(ColumnKind kind) {
  return kind == ColumnKind::block || kind == ColumnKind::override_;
}

/// Temperatures and the like that belong to no drive serve no command.
bool is_dispensable(ColumnKind kind) {
  return kind == ColumnKind::temperature || kind == ColumnKind::voltage ||
         kind == ColumnKind::acceleration;
}

bool is_per_minute(const UnitName& unit) {
  return unit.dimension == Dimension::angular_speed &&
         std::abs(unit.value - rad_s_from_rpm(1)) < 1e-9;
}

/// Which drive; a question or a reason where that is not said.
ColumnDraft with_channel(const HeadingMeaning& m, ColumnDraft draft) {
  const ColumnKind kind = draft.kind;
  if (needs_no_drive(kind)) {
    draft.channel = Channel::machine;
    if (m.channel)
      return left_out_because("no trace has " + std::string(kind_name(kind)) + " of one drive");
    return draft;
  }
  if (!m.channel_doubt.empty())
    return asked(draft, "seems to be " + std::string(kind_name(kind)) + " of " +
                            in_quotes(m.channel_doubt) + ", and which drive that is nobody says");
  if (m.channel) {
    draft.channel = *m.channel;
    return draft;
  }
  // What shops count in turns a minute and call speed, without another word, is the spindle's.
  const bool turns = kind == ColumnKind::rotation ||
                     (kind == ColumnKind::speed && m.known_unit && is_per_minute(*m.known_unit));
  if (turns && !m.says_axis) {
    draft.channel = Channel::spindle;
    return draft;
  }
  if (is_dispensable(kind)) return left_out_because("of which drive is not said");
  return asked(draft,
               "seems to be " + std::string(kind_name(kind)) + ", and of which drive is not said");
}

/// Quantity of a force or an acceleration that has a direction.
std::optional<Quantity> directed(const HeadingMeaning& m, Quantity quantity) {
  const auto one_of = [&](Quantity x, Quantity y, Quantity z) -> std::optional<Quantity> {
    if (m.direction == Channel::x) return x;
    if (m.direction == Channel::y) return y;
    if (m.direction == Channel::z) return z;
    return std::nullopt;
  };
  if (quantity == Quantity::force_N && (m.channel == Channel::dyno || m.channel == Channel::tool))
    return one_of(Quantity::force_x_N, Quantity::force_y_N, Quantity::force_z_N);
  if (quantity == Quantity::acceleration_m_s2 && m.channel == Channel::tool &&
      m.direction != Channel::z)
    return one_of(Quantity::acceleration_x_m_s2, Quantity::acceleration_y_m_s2, quantity);
  return m.direction ? std::nullopt : std::optional(quantity);
}

bool is_following_error(std::string_view word) {
  constexpr auto kWords = std::to_array<std::string_view>(
      {"following", "schlepp", "schleppfehler", "schleppabstand", "nachlauf"});
  return std::find(kWords.begin(), kWords.end(), word) != kWords.end();
}

/// Doubts that remain when drive, quantity and unit are known.
ColumnDraft doubted(const HeadingMeaning& m, const ColumnSurvey& survey, ColumnDraft draft) {
  if (!m.unknown.empty())
    return asked(draft, "seems to be " + std::string(kind_name(draft.kind)) + " of " +
                            std::string(name_of(draft.channel)) + ", but " + list_of(m.unknown) +
                            " in its heading is not known");
  if (m.command && m.actual) return asked(draft, "is named both a command and an actual value");
  if (m.statistic)
    return asked(draft, "is named a mean, an extreme or the like, and not the value of an instant");
  const bool linear_axis =
      draft.channel == Channel::x || draft.channel == Channel::y || draft.channel == Channel::z;
  if (draft.kind == ColumnKind::force && linear_axis && !m.says_axis)
    return asked(draft, "is a force in " + std::string(name_of(draft.channel)) +
                            ": of the drive (x.force_N), on the tool (tool.force_x_N) or at a "
                            "dynamometer (dyno.force_x_N)");
  const bool spindle = draft.channel == Channel::spindle || draft.channel == Channel::spindle2;
  if (spindle && draft.quantity &&
      (dimension_of(*draft.quantity) == Dimension::length ||
       dimension_of(*draft.quantity) == Dimension::velocity))
    return asked(draft, "is of a spindle, which turns, and its unit " + in_quotes(m.unit) +
                            " is one of a straight motion");
  if (draft.quantity == Quantity::angle_counts && !survey.whole)
    return asked(draft, "is counted, but its values are not whole");
  return draft;
}

/// Quantity and factor from the unit; open where there is none.
ColumnDraft with_unit(const HeadingMeaning& m, const std::vector<ColumnKind>& kinds,
                      ColumnDraft draft) {
  if (kinds.size() == 1 && kinds[0] == ColumnKind::counts && m.unit.empty()) {
    draft.quantity = Quantity::angle_counts;
    draft.unit = "counts";
    return draft;
  }
  if (draft.kind == ColumnKind::block) {
    draft.quantity = Quantity::nc_block;
    return draft;
  }
  if (!m.unit.empty() && !m.known_unit)
    return asked(draft, "has the unit " + in_quotes(m.unit) + ", which is not known");
  if (!m.known_unit) {
    draft.state = State::unit_open;
    return draft;
  }
  std::vector<ColumnKind> fitting;
  for (const ColumnKind kind : kinds)
    if (kind_fits(kind, m.known_unit->dimension)) fitting.push_back(kind);
  if (fitting.empty())
    return asked(draft, "is named " + std::string(kind_name(draft.kind)) + ", and its unit " +
                            in_quotes(m.unit) + " is none of that");
  if (fitting.size() > 1)
    return asked(draft, "is named " + std::string(kind_name(fitting[0])) + " and " +
                            std::string(kind_name(fitting[1])) + ", and its unit fits both");
  draft.kind = fitting[0];
  const auto quantity = quantity_of(draft.kind, m.known_unit->dimension, m.command);
  if (!quantity)
    return left_out_because("a trace has no column for " + std::string(kind_name(draft.kind)) +
                            " that is commanded");
  draft.quantity = directed(m, *quantity);
  draft.unit = m.unit;
  if (!draft.quantity)
    return asked(draft,
                 "is " + std::string(kind_name(draft.kind)) + " whose direction is not said");
  draft.factor = value_of_unit(m.known_unit->spelling, *draft.quantity).value_or(1);
  return draft;
}

}  // namespace

std::optional<Quantity> quantity_of(ColumnKind kind, Dimension d, bool command) {
  using Q = Quantity;
  const auto measured = [&](Q quantity) {
    return command ? std::nullopt : std::optional<Q>(quantity);
  };
  switch (kind) {
    case ColumnKind::position:
      if (d == Dimension::length) return command ? Q::command_position_m : Q::position_m;
      if (d == Dimension::angle) return command ? Q::command_angle_rad : Q::angle_rad;
      return measured(Q::angle_counts);
    case ColumnKind::speed:
    case ColumnKind::rotation:
      if (d == Dimension::velocity) return command ? Q::command_velocity_m_s : Q::velocity_m_s;
      return measured(Q::speed_rad_s);
    case ColumnKind::acceleration:
      return measured(Q::acceleration_m_s2);
    case ColumnKind::current:
      if (command)
        return d == Dimension::share ? std::nullopt : std::optional(Q::command_current_A);
      return d == Dimension::share ? Q::current_percent : Q::current_A;
    case ColumnKind::torque:
      if (command) return d == Dimension::share ? Q::command_torque_percent : Q::command_torque_Nm;
      return d == Dimension::share ? Q::torque_percent : Q::torque_Nm;
    case ColumnKind::force:
      return measured(Q::force_N);
    case ColumnKind::power:
      return measured(Q::power_W);
    case ColumnKind::load:
      return measured(d == Dimension::voltage ? Q::load_V : Q::load_percent);
    case ColumnKind::voltage:
      return measured(Q::voltage_V);
    case ColumnKind::temperature:
      return measured(Q::temperature_C);
    case ColumnKind::block:
      return measured(Q::nc_block);
    case ColumnKind::override_:
      return measured(Q::feed_override);
    case ColumnKind::counts:
      return measured(Q::angle_counts);
    case ColumnKind::time:
    case ColumnKind::date:
      break;
  }
  return std::nullopt;
}

std::vector<std::string_view> usual_units(const ColumnDraft& column) {
  const bool straight =
      column.channel == Channel::x || column.channel == Channel::y || column.channel == Channel::z;
  switch (column.kind) {
    case ColumnKind::position:
      if (straight) return {"mm", "m", "um"};
      return {"deg", "rad", "rev"};
    case ColumnKind::speed:
      if (straight) return {"mm/min", "mm/s", "m/min", "m/s"};
      return {"rpm", "rad/s", "deg/s"};
    case ColumnKind::rotation:
      return {"rpm", "rad/s", "deg/s"};
    case ColumnKind::acceleration:
      return {"m/s2", "mm/s2", "g"};
    case ColumnKind::current:
      return {"A", "mA", "%"};
    case ColumnKind::torque:
      return {"Nm", "%"};
    case ColumnKind::force:
      return {"N", "kN"};
    case ColumnKind::power:
      return {"W", "kW"};
    case ColumnKind::load:
      return {"%", "V"};
    case ColumnKind::voltage:
      return {"V", "mV"};
    case ColumnKind::temperature:
      return {"degC"};
    case ColumnKind::override_:
      return {"%", "1"};
    default:
      return {};
  }
}

ColumnDraft draft_column(const HeadingMeaning& m, const ColumnSurvey& survey) {
  if (m.name.empty()) return left_out_because("it has no heading");
  if (survey.values == 0) return left_out_because("there is no number in it");
  if (is_following_error(m.left_out))
    return left_out_because("it seems to be a following error; --column x.following_error_m=" +
                            m.name + ":mm takes it, commanded less actual");
  if (!m.left_out.empty())
    return left_out_because("a trace has nothing like it (" + in_quotes(m.left_out) + ")");
  const std::vector<ColumnKind> kinds = kinds_by(m);
  ColumnDraft draft;
  draft.state = State::taken;
  draft.command = m.command;
  if (kinds.empty()) {
    // A drive and nothing else, or with a letter that may stand for a quantity.
    const bool is_drive =
        m.channel && *m.channel != Channel::tool && *m.channel != Channel::dyno &&
        *m.channel != Channel::hammer &&
        (m.symbols.empty() ||
         (*m.channel != Channel::a && *m.channel != Channel::b && *m.channel != Channel::c));
    if (!is_drive || !m.unknown.empty()) return left_out_because("its heading is not known");
    draft.channel = *m.channel;
    return asked(draft, "says of which drive it is and not what");
  }
  draft.kind = kinds[0];
  if (draft.kind == ColumnKind::time || draft.kind == ColumnKind::date)
    return left_out_because("the time is taken elsewhere");
  // What has unknown words and only a unit to go by is anything.
  if (m.kinds.empty() && !m.unknown.empty() && !m.channel)
    return left_out_because("its heading is not known");
  draft = with_channel(m, draft);
  if (draft.state != State::taken) return draft;
  if (kinds.size() > 1 && m.unit.empty())
    return asked(draft, "is named " + std::string(kind_name(kinds[0])) + " and " +
                            std::string(kind_name(kinds[1])));
  draft = with_unit(m, kinds, draft);
  if (draft.state != State::taken && draft.state != State::unit_open) return draft;
  // Where no unit gives it a quantity, the usual one stands for the name.
  if (draft.state == State::unit_open) {
    const auto usual = unit_named(usual_units(draft)[0]);
    const auto quantity =
        usual ? quantity_of(draft.kind, usual->dimension, m.command) : std::nullopt;
    if (!quantity)
      return left_out_because("a trace has no column for " + std::string(kind_name(draft.kind)) +
                              " that is commanded");
    draft.quantity = quantity;
  }
  return doubted(m, survey, draft);
}

ColumnDraft answered_column(const ColumnAnswer& answer, const HeadingMeaning& m,
                            const ColumnSurvey& survey) {
  ColumnDraft draft;
  if (answer.left_out) return left_out_because("as asked for");
  draft.state = State::taken;
  draft.channel = answer.signal->channel;
  draft.quantity = answer.signal->quantity;
  draft.answered = !answer.unit.empty();
  for (int k = 0; k <= static_cast<int>(ColumnKind::counts); ++k) {
    const auto kind = static_cast<ColumnKind>(k);
    for (const bool command : {false, true})
      if (quantity_of(kind, dimension_of(*draft.quantity), command) == draft.quantity) {
        draft.kind = kind;
        draft.command = command;
        k = static_cast<int>(ColumnKind::counts);
        break;
      }
  }
  if (survey.values == 0)
    return asked(draft, "holds no number that could become " + column_name(*answer.signal));
  const Dimension d = dimension_of(*draft.quantity);
  if (!answer.unit.empty()) {
    draft.unit = answer.unit;
    draft.factor = value_of_unit(answer.unit, *draft.quantity).value_or(1);
  } else if (d == Dimension::none || d == Dimension::counts) {
    draft.answered = true;
    draft.unit = d == Dimension::counts ? "counts" : "";
  } else if (m.known_unit && value_of_unit(m.known_unit->spelling, *draft.quantity)) {
    draft.unit = m.unit;
    draft.factor = *value_of_unit(m.known_unit->spelling, *draft.quantity);
  } else if (!m.unit.empty()) {
    return asked(draft, "has the unit " + in_quotes(m.unit) + ", which is none of " +
                            column_name(*answer.signal));
  } else {
    draft.state = State::unit_open;
  }
  if (draft.quantity == Quantity::angle_counts && !survey.whole)
    return asked(draft, "holds numbers that are not whole and cannot be counts");
  return draft;
}

}  // namespace servosense::detail
