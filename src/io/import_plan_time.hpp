// Which columns are the time of the rows, and whether that can be.
#pragma once

#include <string>

#include "import_draft.hpp"

namespace servosense::detail {

/// Chooses the time from the rate, the answers and the headings; looks at the first rows.
Expected<Done> find_time(TableFile& file, const ImportMap& map, ImportDraft& draft);
/// Questions on its unit, its order, its rate.
void check_time(const TableFile& file, ImportDraft& draft);
/// As people write it: "ms"; "" of time stamps.
[[nodiscard]] std::string time_unit(const ImportTime& time);

}  // namespace servosense::detail
