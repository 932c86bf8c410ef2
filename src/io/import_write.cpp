// Writing the trace of a plan.
#include <cmath>

#include "import_time.hpp"
#include "servosense/io/import_plan.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {
namespace {

/// Exactly where it can be: 10.03 mm are 0.01003 m, 5 mm/min are 5/60000 m/s.
double converted(std::string_view field, double value, double factor, DecimalMark mark) {
  if (factor == 1) return value;
  const int exponent = static_cast<int>(std::lround(std::log10(factor)));
  if (std::abs(std::pow(10.0, exponent) / factor - 1) < 1e-15) {
    const std::string digits = plain_number(field, mark);
    const bool plain = !digits.empty() && digits.find('e') == std::string::npos;
    const auto exact = parse_number(digits + "e" + std::to_string(exponent));
    if (plain && exact.ok()) return exact.value;
  }
  const double inverse = std::round(1 / factor);
  const bool whole = factor < 1 && std::abs(inverse * factor - 1) < 1e-15;
  return whole ? value / inverse : value * factor;
}

TraceField trace_field(std::string_view field, const ImportColumn& column, DecimalMark mark) {
  if (is_counts(*column.signal)) {
    const std::string plain = plain_number(field, mark);
    if (const auto counts = parse_counts(plain.substr(0, plain.find('.')));
        !plain.empty() && counts.ok() && plain.find('e') == std::string::npos)
      return TraceField::of_counts(counts.value);
  }
  const TableNumber number = table_number(field, mark);
  switch (number.state) {
    case TableNumber::State::value:
      break;
    case TableNumber::State::empty:
      return TraceField::none();
    default:
      return TraceField::invalid();
  }
  if (is_counts(*column.signal))
    return std::abs(number.value) < 0x1p63
               ? TraceField::of_counts(static_cast<std::int64_t>(number.value))
               : TraceField::invalid();
  return TraceField::of(converted(field, number.value, column.factor, mark));
}

TraceMetadata metadata_of(const TableFile& file, const ImportPlan& plan) {
  TraceMetadata metadata = {{"imported from", file.name()}};
  if (plan.time.from_first && !plan.time.origin.empty())
    metadata.emplace_back("start", plan.time.origin);
  for (const ImportColumn& c : plan.columns)
    if (c.signal && is_shown_as_written(c.heading) && !c.heading.empty())
      metadata.emplace_back(
          column_name(*c.signal),
          printable(c.heading, 200) + (c.unit.empty() ? "" : " (" + c.unit + ")"));
  return metadata;
}

}  // namespace

Expected<std::size_t> write_import(TableFile& file, const ImportPlan& plan, const std::string& out,
                                   const ImportProgress& progress) {
  if (!plan.questions.empty())
    return usage_error("a plan with open questions is not written; answer them first");
  std::vector<Signal> signals;
  std::vector<std::size_t> columns;
  for (std::size_t i = 0; i < plan.columns.size(); ++i)
    if (plan.columns[i].signal) {
      signals.push_back(*plan.columns[i].signal);
      columns.push_back(i);
    }
  if (auto done = file.rewind(); !done) return done.error();
  auto writer = TraceWriter::create(out, signals, metadata_of(file, plan));
  if (!writer) return writer.error();
  detail::ImportClock clock(plan.time, file.layout().mark);
  std::vector<TraceField> fields(columns.size());
  std::size_t rows = 0;
  auto skipped = plan.without.begin();
  for (TableRow row;;) {
    const auto more = file.next(row);
    if (!more) return more.error();
    if (!*more) break;
    const auto t = clock.read(row);
    if (!t) return file.error_at(row.line, "no time stands in this row; repair it or say --rate");
    while (skipped != plan.without.end() && *t > skipped->second) ++skipped;
    if (skipped != plan.without.end() && *t >= skipped->first) continue;
    for (std::size_t i = 0; i < columns.size(); ++i)
      fields[i] = trace_field(row.fields[columns[i]], plan.columns[columns[i]], file.layout().mark);
    const Nanoseconds from = plan.time.from_first ? plan.time.origin_ns : 0;
    if (auto done = writer->write(*t - from, std::span<const TraceField>(fields)); !done)
      return done.error();
    if (++rows % 4096 == 0 && progress) progress(file.progress());
  }
  if (auto done = writer->close(); !done) return done.error();
  return rows;
}

}  // namespace servosense
