#include "study_page.hpp"

#include <cmath>
#include <utility>

#include "console.hpp"
#include "drive_records.hpp"
#include "stack_signals.hpp"

namespace servosense::cli {

report::Table compared_table(const std::vector<Compared>& all) {
  report::Table table{"Published beside obtained", {}, {"", "published", "obtained", "unit", "in"}};
  for (const Compared& c : all) {
    const std::string published =
        (c.relation == "=" ? "" : "below ") + report::Cell(c.published, 4).text;
    table.rows.push_back(
        {{c.what, published, report::Cell(c.obtained, 4), c.unit, c.source}, report::Level::none});
  }
  return table;
}

void say_compared(const std::vector<Compared>& all) {
  for (const Compared& c : all)
    say("  %s: %.4g%s%s, published %s%.4g (%s)\n", c.what.c_str(), c.obtained,
        c.unit.empty() ? "" : " ", c.unit.c_str(), c.relation == "=" ? "" : "below ", c.published,
        c.source.c_str());
}

void write_compared(JsonWriter& json, const std::vector<Compared>& all) {
  json.objects("compared", all, [&](const Compared& c) {
    json.member("what", c.what);
    json.member("relation", c.relation);
    json.member("published", c.published);
    json.member("obtained", c.obtained);
    json.member("unit", c.unit);
    json.member("source", c.source);
  });
}

Expected<StudyRecords> study_records(const MachineFile& machine, const std::string& trace,
                                     bool quiet) {
  auto reader = TraceReader::open(trace);
  if (!reader) return reader.error();
  auto source = open_trace(std::move(*reader), trace, machine);
  if (!source) return source.error();
  auto plan = plan_stack(machine, signals_of(*source));
  if (!plan) return plan.error();
  Progress progress("reading", quiet);
  auto records = read_records(*source, *plan, progress);
  if (!records) return records.error();
  if (records->empty())
    return data_error(trace + ": no drive has its motion and its effort in it; record both");
  return StudyRecords{std::move(*plan), std::move(*records)};
}

std::vector<Option> study_options(std::vector<Option> own, const std::string& of_trace) {
  std::vector<Option> all = {
      {"--machine", "FILE", "machine file: the study of your drives beside the source's", false,
       FileUse::input},
      {"--trace", "FILE", of_trace, false, FileUse::input}};
  for (Option& option : own) all.push_back(std::move(option));
  all.push_back({"--report", "FILE", "HTML page with the pictures", false, FileUse::output});
  return all;
}

Expected<std::size_t> whole_option(const Arguments& arguments, const std::string& name,
                                   double least, double most, std::size_t otherwise) {
  const auto value = arguments.within(name, least, most);
  if (!value) return value.error();
  if (!*value) return otherwise;
  if (**value != std::floor(**value)) return usage_error(name + " takes a whole number");
  return static_cast<std::size_t>(**value);
}

}  // namespace servosense::cli
