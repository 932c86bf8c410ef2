// Any bytes as a figure of a data sheet: a sentence, or a finite number that is read again from
// what a machine file would hold. And as a whole entry: one sentence, or a file that can be read.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/io/data_sheet.hpp"
#include "servosense/io/sheet_value.hpp"
#include "servosense/io/text.hpp"

using namespace servosense;

namespace {

void require(bool ok) {
  if (!ok) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  for (const char* unit : {"m", "counts", "kg m2", "Nm s/rad", "V s/rad", ""}) {
    const auto read = sheet_value_from(text, unit, *unit == 'c');
    if (!read) {
      require(!read.error().sentence.empty());
      continue;
    }
    require(std::isfinite(read->value));
    const auto again = sheet_value_from(number_text(read->value), unit);
    require(again.has_value() && again->value == read->value);
  }
  const auto entry = sheet_entry_from(text);
  if (!entry) return 0;
  const std::string fault = sheet_fault(*entry);
  const SheetReport report =
      work_out(std::vector<SheetEntry>{*entry, {"axis.y", "vertical", "no"}}, "", "fuzz.ini");
  if (!fault.empty()) require(!report.faults.empty());
  if (report.faults.empty())
    require(MachineFile::parse(report.machine.text(), "again").has_value());
  for (const std::string& sentence : report.faults)
    require(sentence.find('\n') == std::string::npos);
  return 0;
}
