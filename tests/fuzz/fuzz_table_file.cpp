// Any bytes as a foreign table: an error of one line, or a plan; what it writes is a trace.
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <sstream>
#include <string>

#include "servosense/io/import_plan.hpp"
#include "servosense/io/trace.hpp"

using namespace servosense;

namespace {

void require(bool ok) {
  if (!ok) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  auto file = TableFile::from_stream(std::make_unique<std::istringstream>(text), "fuzz");
  if (!file) {
    require(file.error().sentence.find('\n') == std::string::npos);
    return 0;
  }
  require(file->layout().headings.size() >= 1);
  for (const bool rate : {false, true}) {
    ImportMap map;
    if (rate) map.rate_hz = 1000;
    const auto plan = plan_import(*file, map);
    if (!plan) {
      require(plan.error().sentence.find('\n') == std::string::npos);
      continue;
    }
    require(plan->rows > 0 && plan->columns.size() == file->layout().headings.size());
    for (const std::string& question : plan->questions)
      require(question.find('\n') == std::string::npos);
    if (!plan->questions.empty()) continue;
    // What was decided stays decided.
    const auto again = plan_import(*file, plan->map);
    require(again && again->questions.empty());
    for (std::size_t i = 0; i < plan->columns.size(); ++i)
      require(again->columns[i].signal == plan->columns[i].signal);
    const std::string path = "/tmp/servosense_fuzz_table.csv";
    const auto written = write_import(*file, *plan, path);
    if (!written) {
      require(written.error().sentence.find('\n') == std::string::npos);
      continue;
    }
    const auto trace = read_trace(path);
    require(trace && trace->size() == plan->rows && *written == plan->rows);
  }
  return 0;
}
