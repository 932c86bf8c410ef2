// A plan in the making: what each column of a foreign table seems to be, and what is still open.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "heading_meaning.hpp"
#include "import_survey.hpp"
#include "servosense/io/import_plan.hpp"

namespace servosense::detail {

/// What --column or the map says of a column.
struct ColumnAnswer {
  bool is_time = false, left_out = false;
  std::optional<Signal> signal;
  std::string unit;  ///< empty: not given
};
using ColumnAnswers = std::map<std::size_t, ColumnAnswer>;
/// Usage error for a heading that is not in the table, for one that stands for several columns, for
/// a unit that does not fit; data error naming all headings of a map that are missing.
Expected<ColumnAnswers> resolve_answers(const ImportMap& map, const TableLayout& layout,
                                        const std::vector<HeadingMeaning>& meanings,
                                        const std::string& name);

/// The column that --where names. Usage error when there is none or several.
Expected<std::size_t> column_of(const ImportWhere& where, const TableLayout& layout,
                                const std::vector<HeadingMeaning>& meanings,
                                const std::string& name);
/// Finds the rows that are not wanted. Data error when no row is left.
Expected<Done> choose_rows(TableFile& file, std::size_t column, const ImportWhere& where,
                           ImportPlan& plan);

struct ColumnDraft {
  enum class State : std::uint8_t {
    left_out,
    time,
    taken,
    unit_open,  ///< all is known but the unit
    open        ///< a question
  };
  State state = State::left_out;
  Channel channel = Channel::machine;
  ColumnKind kind = ColumnKind::time;
  bool command = false;
  std::optional<Quantity> quantity;
  std::string unit;        ///< as written
  double factor = 1;       ///< to the unit of the quantity
  bool conflicts = false;  ///< with another column
  bool answered = false;   ///< by the user, its unit, too
  std::string reason;      ///< why left out, or how the unit was settled
  std::string question;    ///< without the option that answers
};

struct ImportDraft {
  const TableLayout* layout = nullptr;
  std::vector<HeadingMeaning> meanings;
  ColumnAnswers answers;
  std::vector<ColumnDraft> columns;
  ImportTime time;
  bool time_open = false;   ///< a column without a unit
  std::string time_reason;  ///< by what its unit is known
  TableSurvey survey;
  std::vector<std::string> questions, remarks;
};

/// What a column is by its heading and its values.
[[nodiscard]] ColumnDraft draft_column(const HeadingMeaning& meaning, const ColumnSurvey& survey);
/// What the answer makes of it. Data error when there is no number in it.
[[nodiscard]] ColumnDraft answered_column(const ColumnAnswer& answer, const HeadingMeaning& meaning,
                                          const ColumnSurvey& survey);
/// Quantity that a kind is in a unit of that dimension; nothing: no trace has it.
[[nodiscard]] std::optional<Quantity> quantity_of(ColumnKind kind, Dimension dimension,
                                                  bool command);
/// Units that a column of this kind may be in, the usual one first.
[[nodiscard]] std::vector<std::string_view> usual_units(const ColumnDraft& column);

/// Units by agreement of position and speed; headings that disagree become questions.
void settle_units(ImportDraft& draft);
/// Questions on values beyond what machines do.
void check_ranges(ImportDraft& draft);

/// "'x.current_A=I_q (A):A'", with its option, for a shell.
[[nodiscard]] std::string answer_option(const TableLayout& layout, std::size_t column,
                                        std::string_view to, std::string_view unit);
/// How a heading is named in sentences: 'Strom X', or #3 'Strom' where several are called that.
[[nodiscard]] std::string named_column(const TableLayout& layout, std::size_t column);
/// What OLD has to be for the column.
[[nodiscard]] std::string old_name(const TableLayout& layout, std::size_t column);

}  // namespace servosense::detail
