#include "import_plan_time.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "servosense/io/text.hpp"

namespace servosense::detail {
namespace {

using Source = ImportTime::Source;
constexpr double kYear2000_s = 946684800, kYear2100_s = 4102444800;

struct FirstRow {
  std::vector<std::string> fields;
};

Expected<FirstRow> first_row(TableFile& file) {
  if (auto done = file.rewind(); !done) return done.error();
  TableRow row;
  const auto more = file.next(row);
  if (!more) return more.error();
  FirstRow first;
  if (*more) first.fields.assign(row.fields.begin(), row.fields.end());
  first.fields.resize(file.layout().headings.size());
  return first;
}

bool names_time(const HeadingMeaning& m) {
  const bool kind = m.kinds == std::vector{ColumnKind::time};
  const bool symbol =
      m.kinds.empty() && m.symbols == std::vector{ColumnKind::time} &&
      (m.unit.empty() || (m.known_unit && m.known_unit->dimension == Dimension::time));
  return (kind || symbol) && m.unknown.empty() && m.left_out.empty() && !m.channel;
}
/// A unit of time, and not a word of what it is.
bool may_be_time(const HeadingMeaning& m) {
  return m.kinds.empty() && m.known_unit && m.known_unit->dimension == Dimension::time;
}
bool names_date(const HeadingMeaning& m) {
  return !m.kinds.empty() && m.kinds[0] == ColumnKind::date && m.unknown.empty();
}

class TimeFinder {
 public:
  TimeFinder(const TableFile& file, const FirstRow& first, const ImportMap& map, ImportDraft& draft)
      : file_(file), first_(first), map_(map), draft_(draft) {}

  Expected<Done> run() {
    ImportTime& time = draft_.time;
    if (map_.rate_hz) {
      time.source = Source::rate;
      time.rate_hz = *map_.rate_hz;
      for (const auto& [column, answer] : draft_.answers)
        if (answer.is_time)
          draft_.remarks.push_back("--rate is given, so " + named_column(*draft_.layout, column) +
                                   " is not read as time");
      return Done{};
    }
    for (const auto& [column, answer] : draft_.answers)
      if (answer.is_time) return take(column, answer.unit);
    const auto column = by_heading();
    if (!column) return Done{};
    const HeadingMeaning& m = draft_.meanings[*column];
    return take(*column, m.known_unit && m.known_unit->dimension == Dimension::time
                             ? std::string(m.known_unit->spelling)
                             : std::string());
  }

 private:
  [[nodiscard]] std::optional<TimeStamp> stamp(std::size_t i) const {
    return time_stamp_from(first_.fields[i]);
  }
  [[nodiscard]] bool is_free(std::size_t i) const { return !draft_.answers.contains(i); }

  std::optional<std::size_t> by_heading() {
    std::vector<std::size_t> named, doubtful, stamps;
    for (std::size_t i = 0; i < draft_.meanings.size(); ++i) {
      if (!is_free(i)) continue;
      const auto s = stamp(i);
      const bool date_alone = s && s->kind == TimeStamp::Kind::date;
      if (names_time(draft_.meanings[i]) || (names_date(draft_.meanings[i]) && s && !date_alone))
        named.push_back(i);
      else if (may_be_time(draft_.meanings[i]))
        doubtful.push_back(i);
      if (s && !date_alone) stamps.push_back(i);
    }
    if (named.empty() && stamps.size() == 1) return stamps[0];
    if (named.size() == 1) return named[0];
    const std::vector<std::size_t>& several = named.empty() ? doubtful : named;
    if (several.empty()) {
      draft_.questions.push_back(
          "no column of time was found: --rate HZ, how many rows a second there are, or --column "
          "t_s=OLD:UNIT");
      return std::nullopt;
    }
    std::string question = named.empty() ? "the time may be" : "the time could be";
    std::string options;
    for (const std::size_t i : several) {
      const auto& unit = draft_.meanings[i].known_unit;
      question += (i == several[0] ? " " : " or ") + named_column(*draft_.layout, i);
      options += (options.empty() ? ": " : " or ") +
                 answer_option(*draft_.layout, i, "t_s",
                               unit && unit->dimension == Dimension::time ? draft_.meanings[i].unit
                               : stamp(i)                                 ? ""
                                                                          : "s");
    }
    draft_.questions.push_back(question + options);
    return std::nullopt;
  }

  Expected<Done> take(std::size_t column, const std::string& unit) {
    ImportTime& time = draft_.time;
    time.column = column;
    if (const auto first = stamp(column)) {
      time.source = Source::stamp;
      time.from_first = true;
      if (first->kind == TimeStamp::Kind::clock) find_date();
      return Done{};
    }
    const std::string number = plain_number(first_.fields[column], file_.layout().mark);
    const auto value = parse_number(number);
    if (number.empty() || !value.ok())
      return file_.error_at(file_.layout().first_line,
                            named_column(*draft_.layout, column) + ": expected a time, found " +
                                in_quotes(first_.fields[column]) +
                                "; write seconds, 2024-05-01 12:30:00.125 or 12:30:00.125, or say "
                                "--rate");
    time.source = Source::number;
    if (!unit.empty()) {
      set_time_unit(time, unit_named(unit, Dimension::time)->value);
    } else {
      draft_.time_open = true;
      // As seconds since 1970, whatever the unit, so that no digit is lost.
      for (const int exponent : {0, -3, -6, -9}) {
        time.exponent = exponent;
        if (std::abs(value.value) * std::pow(10.0, exponent) < kYear2100_s) break;
      }
    }
    const double seconds = std::abs(value.value) * std::pow(10.0, time.exponent) * time.multiple;
    // A clock that counts from 1970, or long since switched on.
    constexpr double kThreeYears_s = 1e8;
    time.from_first = seconds >= kThreeYears_s;
    return Done{};
  }

  void find_date() {
    std::vector<std::size_t> dates;
    for (std::size_t i = 0; i < draft_.meanings.size(); ++i) {
      const auto s = stamp(i);
      if (i != draft_.time.column && is_free(i) && s && s->kind == TimeStamp::Kind::date)
        dates.push_back(i);
    }
    if (dates.size() == 1) draft_.time.date_column = dates[0];
  }

  const TableFile& file_;
  const FirstRow& first_;
  const ImportMap& map_;
  ImportDraft& draft_;
};

/// A number without a unit that counts from 1970 in exactly one unit that rows can come in.
std::optional<double> epoch_unit(const ImportDraft& draft) {
  const HeadingMeaning& m = draft.meanings[draft.time.column];
  const double first_s = seconds_from(draft.survey.time.first_ns);  // in the unit assumed
  const bool stamped =
      m.name.find("tamp") != std::string::npos || m.name.find("poch") != std::string::npos ||
      m.name.find("nix") != std::string::npos || m.name.find("tempel") != std::string::npos;
  const double step = draft.survey.time.median_step_s;
  if (!stamped || first_s < kYear2000_s || first_s > kYear2100_s) return std::nullopt;
  // In the next smaller unit the rows would come a thousand times as fast: that must be impossible.
  if (!(step >= kShortestPeriod_s && step <= kLongestPeriod_s && step * 1e-3 < kShortestPeriod_s))
    return std::nullopt;
  return std::pow(10.0, draft.time.exponent);
}

void ask_unit(ImportDraft& draft) {
  const std::size_t column = draft.time.column;
  const double assumed = std::pow(10.0, draft.time.exponent);
  std::string could;
  std::string first = "s";
  for (const std::string_view unit : {"s", "ms", "us", "ns"}) {
    const double step = draft.survey.time.median_step_s * unit_named(unit)->value / assumed;
    if (!(step >= kShortestPeriod_s && step <= kLongestPeriod_s)) continue;
    if (could.empty()) first = std::string(unit);
    could += (could.empty() ? "" : ", ") + std::string(unit) + ": " +
             number_text(std::round(1e3 / step) / 1e3) + " rows a second";
  }
  draft.questions.push_back("the unit of the time " + named_column(*draft.layout, column) +
                            " is not stated (" + (could.empty() ? "s, ms, us?" : could) + "): " +
                            answer_option(*draft.layout, column, "t_s", first) + " or the like");
}

void check_rate_of_rows(ImportDraft& draft) {
  const double step = draft.survey.time.median_step_s;
  if (draft.time.source == Source::rate || !std::isfinite(step)) return;
  const std::size_t column = draft.time.column;
  const auto answer = draft.answers.find(column);
  const bool answered = answer != draft.answers.end() && !answer->second.unit.empty();
  if (step < kShortestPeriod_s || step > kLongestPeriod_s) {
    const std::string text = "by the time " + named_column(*draft.layout, column) + " there are " +
                             number_text(1 / step) +
                             " rows a second, which no record of drives has";
    if (answered)
      draft.remarks.push_back(text);
    else
      draft.questions.push_back(
          text + ": " +
          answer_option(*draft.layout, column, "t_s", step < kShortestPeriod_s ? "s" : "ms") +
          " or the like, or --rate HZ");
    return;
  }
  if (draft.survey.time.longest_step_s > 8.5 * step)
    draft.remarks.push_back("rows are missing: the time steps by " + number_text(step) +
                            " s, and by " + number_text(draft.survey.time.longest_step_s) +
                            " s at most");
}

}  // namespace

std::string time_unit(const ImportTime& time) {
  if (time.source != Source::number) return "";
  if (time.multiple == 60) return "min";
  if (time.multiple == 3600) return "h";
  constexpr std::array<const char*, 4> kUnits = {"s", "ms", "us", "ns"};
  return kUnits[static_cast<std::size_t>(-time.exponent / 3) % kUnits.size()];
}

Expected<Done> find_time(TableFile& file, const ImportMap& map, ImportDraft& draft) {
  const auto first = first_row(file);
  if (!first) return first.error();
  return TimeFinder(file, *first, map, draft).run();
}

void check_time(const TableFile& file, ImportDraft& draft) {
  ImportTime& time = draft.time;
  const TimeSurvey& survey = draft.survey.time;
  if (time.source == Source::none) return;
  if (draft.time_open) {
    if (const auto seconds = epoch_unit(draft)) {
      draft.time_open = false;
      set_time_unit(time, *seconds);
      draft.time_reason = "counts from 1970 in this unit";
    } else {
      ask_unit(draft);
    }
  }
  if (time.source != Source::rate) draft.columns[time.column].reason = draft.time_reason;
  if (survey.unread_line > 0)
    draft.questions.push_back("no time stands in line " + std::to_string(survey.unread_line) +
                              " of " + file.name() + " ('" + survey.unread +
                              "'): repair the line, or say --rate HZ");
  if (survey.not_later > 0)
    draft.questions.push_back(
        "the time is not later than in the row before in " + std::to_string(survey.not_later) +
        " rows, the first in line " + std::to_string(survey.not_later_line) +
        ": say --rate HZ, how many rows a second there are, or take the rows out");
  if (survey.midnights > 0)
    draft.remarks.push_back("the clock passes midnight " + std::to_string(survey.midnights) +
                            " times, and the time goes on");
  if (!draft.time_open) check_rate_of_rows(draft);
  if (!time.from_first) return;
  time.origin_ns = survey.first_ns;
  const TableRow none;
  if (time.source == Source::stamp) {
    const auto first = draft.survey.columns[time.column].first;
    const bool clock_alone = survey.first_ns < kNanosecondsPerSecond * 2 * 86400;
    time.origin = clock_alone ? (first.empty() ? "" : first[0]) : date_text(survey.first_ns);
  } else {
    time.origin = seconds_from(survey.first_ns) >= kYear2000_s
                      ? date_text(survey.first_ns) + "Z"
                      : number_text(seconds_from(survey.first_ns)) + " s";
  }
  draft.remarks.push_back("times count from the first row, " + time.origin);
}

}  // namespace servosense::detail
