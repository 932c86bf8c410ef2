// Rows of a foreign table by the value of a column: a flag of the control that says "cutting".
#include <cmath>
#include <deque>

#include "import_draft.hpp"
#include "import_time.hpp"
#include "servosense/io/text.hpp"

namespace servosense::detail {

Expected<Done> choose_rows(TableFile& file, std::size_t column, const ImportWhere& where,
                           ImportPlan& plan) {
  if (auto done = file.rewind(); !done) return done.error();
  ImportClock clock(plan.time, file.layout().mark);
  const auto apart = static_cast<Nanoseconds>(std::llround(where.apart_s * 1e9));
  auto& without = plan.without;
  std::size_t taken = 0;
  std::deque<Nanoseconds> open;  // rows that the next other one may still put out
  for (TableRow row;;) {
    const auto more = file.next(row);
    if (!more) return more.error();
    if (!*more) break;
    const auto t = clock.read(row);
    if (!t) continue;  // an error when it is written
    for (; !open.empty() && open.front() < *t - apart; open.pop_front()) ++taken;
    const TableNumber number = table_number(row.fields[column], file.layout().mark);
    const bool wanted = number.state == TableNumber::State::value && number.value == where.value;
    const bool near = !without.empty() && *t <= without.back().second;
    if (wanted && !near) open.push_back(*t);
    if (wanted) continue;
    open.clear();
    if (!without.empty() && *t - apart <= without.back().second)
      without.back().second = *t + apart;
    else
      without.emplace_back(*t - apart, *t + apart);
  }
  taken += open.size();
  const std::string condition =
      named_column(file.layout(), column) + " = " + number_text(where.value) +
      (apart > 0 ? ", " + number_text(where.apart_s) + " s and more away from any other row" : "");
  if (taken == 0)
    return data_error(file.name() + ": has no row with " + condition +
                      "; check the value in a --preview, or ask for less distance");
  plan.remarks.push_back("taken are " + std::to_string(taken) + " of " + std::to_string(plan.rows) +
                         " rows: " + condition + "; the trace has gaps where the others are");
  return Done{};
}

}  // namespace servosense::detail
