#include "servosense/io/import_plan.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "import_draft.hpp"
#include "import_plan_time.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {
namespace {

using detail::ColumnDraft;
using detail::ColumnKind;
using detail::ColumnSurvey;
using detail::ImportDraft;
using State = ColumnDraft::State;

class ImportPlanner {
 public:
  ImportPlanner(TableFile& file, const ImportMap& answers) : file_(file), map_(answers) {
    draft_.layout = &file.layout();
  }

  Expected<ImportPlan> run(const ImportProgress& progress) {
    const TableLayout& layout = file_.layout();
    for (std::size_t i = 0; i < layout.headings.size(); ++i)
      draft_.meanings.push_back(detail::meaning_of(
          layout.headings[i], i < layout.units.size() ? layout.units[i] : std::string()));
    auto answers = detail::resolve_answers(map_, layout, draft_.meanings, file_.name());
    if (!answers) return answers.error();
    draft_.answers = std::move(*answers);
    if (auto done = detail::find_time(file_, map_, draft_); !done) return done.error();
    auto survey = detail::survey_table(file_, draft_.time, sampled_columns(), progress);
    if (!survey) return survey.error();
    draft_.survey = std::move(*survey);
    if (draft_.survey.rows == 0)
      return data_error(file_.name() + ": no row could be read; give a table with rows of numbers");
    draft_columns();
    detail::settle_units(draft_);
    find_conflicts();
    ask_layout();
    detail::check_time(file_, draft_);
    ask_columns();
    detail::check_ranges(draft_);
    ask_texts();
    ask_anything();
    ImportPlan whole = plan();
    if (map_.where) {
      const auto column = detail::column_of(*map_.where, layout, draft_.meanings, file_.name());
      if (!column) return column.error();
      if (whole.questions.empty())
        if (auto done = detail::choose_rows(file_, *column, *map_.where, whole); !done)
          return done.error();
    }
    return whole;
  }

 private:
  /// Those whose rows are worth keeping: motion.
  [[nodiscard]] std::vector<std::size_t> sampled_columns() const {
    constexpr std::size_t kMost = 64;
    std::vector<std::size_t> columns;
    for (std::size_t i = 0; i < draft_.meanings.size() && columns.size() < kMost; ++i) {
      const detail::HeadingMeaning& m = draft_.meanings[i];
      const bool answered = draft_.answers.contains(i);
      const auto is_motion = [](ColumnKind kind) {
        return kind == ColumnKind::position || kind == ColumnKind::speed ||
               kind == ColumnKind::rotation;
      };
      const bool named = std::any_of(m.kinds.begin(), m.kinds.end(), is_motion) ||
                         std::any_of(m.symbols.begin(), m.symbols.end(), is_motion) ||
                         (m.channel && m.kinds.empty());
      if (answered || (named && m.left_out.empty())) columns.push_back(i);
    }
    return columns;
  }

  void draft_columns() {
    for (std::size_t i = 0; i < draft_.meanings.size(); ++i) {
      const ColumnSurvey& survey = draft_.survey.columns[i];
      const auto answer = draft_.answers.find(i);
      const bool has_time = draft_.time.source == ImportTime::Source::number ||
                            draft_.time.source == ImportTime::Source::stamp;
      ColumnDraft column;
      if (has_time && (i == draft_.time.column || draft_.time.date_column == i)) {
        column.state = State::time;
        column.kind = ColumnKind::time;
        column.reason = draft_.time.date_column == i ? "the date of the time" : draft_.time_reason;
      } else if (answer != draft_.answers.end() && !answer->second.is_time) {
        column = detail::answered_column(answer->second, draft_.meanings[i], survey);
      } else if (map_.only) {
        column.reason = "not asked for";
      } else {
        column = detail::draft_column(draft_.meanings[i], survey);
      }
      draft_.columns.push_back(std::move(column));
    }
  }

  [[nodiscard]] std::optional<Signal> target(std::size_t i) const {
    const ColumnDraft& c = draft_.columns[i];
    if ((c.state != State::taken && c.state != State::unit_open) || !c.quantity)
      return std::nullopt;
    return Signal{c.channel, *c.quantity};
  }
  [[nodiscard]] bool is_answer(std::size_t i) const { return draft_.answers.contains(i); }

  /// Columns that would become the same: an answer decides, else a question.
  void find_conflicts() {
    for (std::size_t i = 0; i < draft_.columns.size(); ++i) {
      const auto signal = target(i);
      if (!signal) continue;
      std::vector<std::size_t> same;
      std::optional<std::size_t> answered;
      for (std::size_t j = 0; j < draft_.columns.size(); ++j)
        if (same_target(i, j)) {
          same.push_back(j);
          if (is_answer(j)) answered = j;
        }
      if (same.size() < 2) continue;
      std::string question = column_name(*signal) + " could be";
      for (const std::size_t j : same) {
        question += (j == same[0]       ? " "
                     : j == same.back() ? " or "
                                        : ", ") +
                    detail::named_column(*draft_.layout, j);
        if (j == answered) continue;
        draft_.columns[j].state = State::left_out;
        draft_.columns[j].conflicts = !answered;
        draft_.columns[j].reason = answered
                                       ? column_name(*signal) + " is made of " +
                                             detail::named_column(*draft_.layout, *answered)
                                       : column_name(*signal) + " could be made of several columns";
      }
      if (answered) continue;
      question += ":";
      for (const std::size_t j : same)
        question +=
            (j == same[0] ? " " : " or ") +
            detail::answer_option(*draft_.layout, j, column_name(*signal), draft_.columns[j].unit);
      draft_.questions.push_back(question);
    }
  }
  /// The same target; a position with an open unit may be any position of that drive.
  [[nodiscard]] bool same_target(std::size_t i, std::size_t j) const {
    const auto a = target(i), b = target(j);
    if (!a || !b || a->channel != b->channel) return false;
    if (a->quantity == b->quantity) return true;
    const ColumnDraft& c = draft_.columns[i];
    const ColumnDraft& d = draft_.columns[j];
    return c.kind == d.kind && c.command == d.command && !is_answer(i) && !is_answer(j) &&
           (c.state == State::unit_open || d.state == State::unit_open);
  }

  void ask_layout() {
    const TableLayout& layout = file_.layout();
    if (layout.mark_is_open)
      draft_.questions.push_back(
          "'" + layout.open_example +
          "' may have a decimal mark or one of thousands, and no number of the file tells: "
          "--decimal comma or --decimal point");
    const TableFile::Ragged& ragged = draft_.survey.ragged;
    if (ragged.count > 0)
      draft_.remarks.push_back(
          std::to_string(ragged.count) + " lines have another number of fields than " +
          std::to_string(layout.headings.size()) + " and were left out, the first in line " +
          std::to_string(ragged.line) + " (" + std::to_string(ragged.fields) + ")");
  }

  void ask_columns() {
    for (std::size_t i = 0; i < draft_.columns.size(); ++i) {
      const ColumnDraft& c = draft_.columns[i];
      const std::string leave = detail::answer_option(*draft_.layout, i, "-", "");
      const std::string named = detail::named_column(*draft_.layout, i);
      if (c.state == State::unit_open) {
        std::string units;
        const std::string to = column_name({c.channel, *c.quantity});
        std::string first;
        for (const std::string_view unit : detail::usual_units(c)) {
          if (is_answer(i) && !value_of_unit(unit, *c.quantity)) continue;
          if (first.empty()) first = std::string(unit);
          units += (units.empty() ? "" : ", ") + std::string(unit);
        }
        if (first.empty()) first = std::string(unit_of(*c.quantity));
        draft_.questions.push_back("the unit of " + named + " is not stated (" + units +
                                   "?): " + detail::answer_option(*draft_.layout, i, to, first) +
                                   " or the like, or leave it out: " + leave);
      } else if (c.state == State::open) {
        const auto usual = detail::usual_units(c);
        const auto& known = draft_.meanings[i].known_unit;
        const std::string unit = known           ? draft_.meanings[i].unit
                                 : usual.empty() ? ""
                                                 : std::string(usual[0]);
        const auto unit_known = unit_named(unit);
        const auto quantity =
            c.quantity
                ? c.quantity
                : detail::quantity_of(c.kind, unit_known ? unit_known->dimension : Dimension::none,
                                      c.command);
        const std::string drive =
            c.channel == Channel::machine ? "DRIVE" : std::string(name_of(c.channel));
        const std::string to =
            quantity ? drive + "." + std::string(name_of(*quantity)) : drive + ".QUANTITY";
        draft_.questions.push_back(named + " " + c.question + ": " +
                                   detail::answer_option(*draft_.layout, i, to, unit) +
                                   " or the like, or leave it out: " + leave);
      }
    }
  }

  /// Texts where numbers belong: a few are written as nan, many are a question.
  void ask_texts() {
    constexpr std::size_t kFew = 10;
    constexpr double kFewShare = 0.01;
    for (std::size_t i = 0; i < draft_.columns.size(); ++i) {
      const ColumnSurvey& s = draft_.survey.columns[i];
      if (draft_.columns[i].state != State::taken || s.texts == 0) continue;
      const std::string text =
          std::to_string(s.texts) + " fields of " + detail::named_column(*draft_.layout, i) +
          " are no numbers, the first '" + s.text + "' in line " + std::to_string(s.text_line);
      const bool few = s.texts <= kFew || static_cast<double>(s.texts) <
                                              kFewShare * static_cast<double>(draft_.survey.rows);
      const auto answer = draft_.answers.find(i);
      if (few || (answer != draft_.answers.end() && !answer->second.unit.empty()))
        draft_.remarks.push_back(text + ", and are written as nan");
      else
        draft_.questions.push_back(
            text + "; take it nevertheless, those as nan: " +
            detail::answer_option(
                *draft_.layout, i,
                column_name({draft_.columns[i].channel, *draft_.columns[i].quantity}),
                draft_.columns[i].unit) +
            ", or leave it out: " + detail::answer_option(*draft_.layout, i, "-", ""));
    }
  }

  /// A trace of nothing is none.
  void ask_anything() {
    const bool any = std::any_of(draft_.columns.begin(), draft_.columns.end(), [](const auto& c) {
      return c.state == State::taken || c.state == State::open || c.state == State::unit_open;
    });
    const bool all_conflicts =
        std::any_of(draft_.questions.begin(), draft_.questions.end(),
                    [](const std::string& q) { return q.find(" could be ") != std::string::npos; });
    if (any || all_conflicts) return;
    draft_.questions.push_back(
        file_.layout().has_heading
            ? std::string("no column was recognised; name them: --column NEW=OLD:UNIT, like "
                          "x.current_A=OLD:A")
            : std::string("the columns have no heading; name them by their place: --column "
                          "NEW=#1:UNIT, like x.current_A=#1:A"));
  }

  [[nodiscard]] ImportPlan plan() {
    ImportPlan plan;
    plan.time = draft_.time;
    plan.rows = draft_.survey.rows;
    plan.period_s = draft_.time_open || draft_.time.source == ImportTime::Source::none
                        ? std::numeric_limits<double>::quiet_NaN()
                        : draft_.survey.time.median_step_s;
    plan.questions = std::move(draft_.questions);
    plan.remarks = std::move(draft_.remarks);
    for (std::size_t i = 0; i < draft_.columns.size(); ++i) plan.columns.push_back(column(i));
    plan.map = whole_map(plan);
    return plan;
  }

  [[nodiscard]] ImportColumn column(std::size_t i) const {
    const ColumnDraft& c = draft_.columns[i];
    const ColumnSurvey& s = draft_.survey.columns[i];
    ImportColumn out;
    out.number = i + 1;
    out.heading = draft_.layout->headings[i];
    out.is_time = c.state == State::time && draft_.time.date_column != i;
    if (c.state == State::taken) out.signal = Signal{c.channel, *c.quantity};
    out.unit = c.unit;
    if (c.state != State::taken) out.unit = draft_.meanings[i].unit;
    if (out.is_time) out.unit = draft_.time_open ? "" : detail::time_unit(draft_.time);
    out.factor = c.state == State::taken ? c.factor : 1;
    out.is_open = c.state == State::open || c.state == State::unit_open || c.conflicts ||
                  (out.is_time && draft_.time_open);
    out.reason = c.reason;
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    out.least = s.values > 0 ? s.least * out.factor : kNone;
    out.greatest = s.values > 0 ? s.greatest * out.factor : kNone;
    out.missing_share = static_cast<double>(s.empty + s.invalid + s.texts) /
                        static_cast<double>(draft_.survey.rows);
    if (out.is_time && draft_.survey.time.read > 0 && !draft_.time_open) {
      const Nanoseconds from = draft_.time.from_first ? draft_.time.origin_ns : 0;
      out.least = seconds_from(draft_.survey.time.first_ns - from);
      out.greatest = seconds_from(draft_.survey.time.last_ns - from);
    }
    if (c.state == State::time) out.missing_share = 0;
    out.first = s.first;
    return out;
  }

  /// All that was decided, for the next file.
  [[nodiscard]] ImportMap whole_map(const ImportPlan& plan) const {
    ImportMap map = map_;
    map.entries.clear();
    map.separator = draft_.layout->separator;
    map.mark = draft_.layout->mark;
    for (std::size_t i = 0; i < plan.columns.size(); ++i) {
      const ImportColumn& c = plan.columns[i];
      const std::string old = detail::old_name(*draft_.layout, i);
      const auto answer = draft_.answers.find(i);
      if (c.is_time)
        map.entries.push_back({"t_s", old + (c.unit.empty() ? "" : " : " + c.unit), true});
      else if (c.signal)
        map.entries.push_back(
            {column_name(*c.signal), old + (c.unit.empty() ? "" : " : " + c.unit), true});
      else if (answer != draft_.answers.end() && answer->second.left_out)
        map.entries.push_back({"-", old, true});
    }
    return map;
  }

  TableFile& file_;
  const ImportMap& map_;
  ImportDraft draft_;
};

}  // namespace

Expected<ImportPlan> plan_import(TableFile& file, const ImportMap& answers,
                                 const ImportProgress& progress) {
  return ImportPlanner(file, answers).run(progress);
}

}  // namespace servosense
