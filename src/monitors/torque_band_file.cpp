#include "servosense/monitors/torque_band_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string_view>
#include <utility>

#include "servosense/io/comma_fields.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/write_file.hpp"
#include "torque_band_prediction.hpp"

namespace servosense {
namespace {

enum Field : std::size_t {
  at,
  torque,
  lower,
  upper,
  section,
  block,
  speed,
  air,
  gap,
  feed,
  kFields
};
constexpr std::array<std::string_view, kFields> kColumnNames = {
    "program_s", "torque_Nm",   "lower_Nm", "upper_Nm",   "section",
    "nc_block",  "speed_rad_s", "air_Nm",   "behind_gap", "feed_m_s"};
constexpr std::string_view kPath = "path_m";
constexpr std::string_view kAirLimit = "air_limit_Nm:";

using Row = std::array<std::optional<double>, kFields>;

/// Which field each column is; kFields: none.
struct Header {
  std::vector<std::size_t> columns;
  bool over_path = false;
  std::array<bool, kFields> has{};
};
std::optional<Header> header_of(std::string_view line) {
  Header h;
  for (const std::string_view name : comma_fields(line)) {
    const bool path = name == kPath;
    const auto found =
        std::find(kColumnNames.begin(), kColumnNames.end(), path ? kColumnNames[at] : name);
    const auto field = static_cast<std::size_t>(found - kColumnNames.begin());
    h.columns.push_back(field);
    if (field == kFields) continue;
    h.has[field] = true;
    h.over_path = h.over_path || path;
  }
  if (h.columns[0] != at || !h.has[torque] || !h.has[lower] || !h.has[upper]) return std::nullopt;
  return h;
}

Expected<Row> row_of(std::string_view line, const Header& header, const LineReader& lines) {
  Row row;
  std::size_t column = 0;
  std::optional<std::string_view> wrong;
  for (const std::string_view field : comma_fields(line)) {
    const std::size_t i = column++;
    if (i >= header.columns.size() || header.columns[i] == kFields || field.empty()) continue;
    const auto number = parse_number(field);
    if (number.ok())
      row[header.columns[i]] = number.value;
    else if (!wrong)
      wrong = field;
  }
  if (column != header.columns.size())
    return lines.error_here("expected " + std::to_string(header.columns.size()) + " columns");
  if (wrong) return lines.error_here("expected a number, not " + in_quotes(*wrong));
  return row;
}

Expected<Done> add(const Row& row, const Header& header, TorqueBandReference& to,
                   const LineReader& lines) {
  const std::size_t n = to.points.size();
  const double here = row[at].value_or(-1);
  if (n == 1) to.spacing = here;
  const double expected = static_cast<double>(n) * to.spacing;
  if (!(std::abs(here - expected) <= 1e-6 * (expected + to.spacing)) || (n == 1 && !(here > 0)))
    return lines.error_here(std::string(header.over_path ? kPath : kColumnNames[at]) +
                            " must begin with 0 and rise in equal steps");
  const int given = row[torque].has_value() + row[lower].has_value() + row[upper].has_value();
  if (given != 0 && given != 3)
    return lines.error_here("torque_Nm, lower_Nm and upper_Nm are either all given or all empty");
  if (given == 3 && !(*row[lower] < *row[upper]))
    return lines.error_here("lower_Nm must lie below upper_Nm");
  const double pace = row[feed].value_or(0);
  if (!(pace >= 0)) return lines.error_here("feed_m_s must not be negative");
  to.points.push_back(given == 3
                          ? TorqueBandPoint<double>{*row[torque], *row[lower], *row[upper], pace}
                          : TorqueBandPoint<double>{0, 1, -1, pace});
  return Done{};
}

}  // namespace

Expected<TorqueBandReference> read_torque_band(LineReader& lines, const PredictedBand& band) {
  TorqueBandReference reference;
  std::optional<Header> header;
  std::optional<double> section_before;
  for (std::string_view line;;) {
    auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) break;
    line = trim(line);
    if (line.empty()) continue;
    if (line.front() == '#') {
      line = trim(line.substr(1));
      if (header || !line.starts_with(kAirLimit)) continue;
      const auto number = parse_number(trim(line.substr(kAirLimit.size())));
      if (!number.ok() || !(number.value >= 0))
        return lines.error_here("air_limit_Nm must be a number, 0 or more");
      reference.air_limit_Nm = number.value;
      continue;
    }
    if (!header) {
      if (is_prediction(line)) return read_prediction(lines, line, band);
      header = header_of(line);
      if (!header)
        return lines.error_here(
            "expected a header that begins with program_s or path_m and has torque_Nm, lower_Nm "
            "and upper_Nm, or a table of 'program predict', not " +
            in_quotes(line));
      reference.over_path = header->over_path;
      continue;
    }
    auto row = row_of(line, *header, lines);
    if (!row) return row.error();
    if (auto done = add(*row, *header, reference, lines); !done) return done.error();
    if (!header->has[section]) continue;
    const auto& number = (*row)[section];
    if (!number) return lines.error_here("section must not be empty");
    if (section_before == number) continue;
    section_before = number;
    TorqueBandSection<double> s;
    s.first = static_cast<std::uint32_t>(reference.points.size() - 1);
    s.block = static_cast<std::int32_t>((*row)[block].value_or(kNoBlock));
    s.speed_rad_s = std::abs((*row)[speed].value_or(0));
    s.has_air = (*row)[air].has_value();
    s.air_Nm = (*row)[air].value_or(0);
    s.behind_gap = (*row)[gap].value_or(0) != 0;
    reference.sections.push_back(s);
  }
  if (reference.points.size() < 2)
    return data_error(lines.name() + ": a torque band needs two points or more");
  return reference;
}

Expected<TorqueBandReference> read_torque_band(const std::string& path, const PredictedBand& band) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  LineReader lines(std::move(*stream), path);
  return read_torque_band(lines, band);
}

Expected<Done> write_torque_band(const std::string& path, const TorqueBandReference& reference,
                                 const std::vector<std::string>& comments) {
  std::string text;
  for (const std::string& comment : comments) text += "# " + comment + "\n";
  if (reference.air_limit_Nm > 0) {
    text += "# " + std::string(kAirLimit) + " ";
    append_number(text, reference.air_limit_Nm);
    text += '\n';
  }
  const bool sections = !reference.sections.empty();
  text += reference.over_path ? kPath : kColumnNames[at];
  for (std::size_t i = torque; i < (sections ? feed : section); ++i)
    text += "," + std::string(kColumnNames[i]);
  if (reference.over_path) text += "," + std::string(kColumnNames[feed]);
  text += '\n';
  std::size_t k = 0;
  for (std::size_t i = 0; i < reference.points.size(); ++i) {
    const auto& p = reference.points[i];
    append_number(text, static_cast<double>(i) * reference.spacing);
    for (const double value : {p.torque_Nm, p.lower_Nm, p.upper_Nm}) {
      text += ',';
      if (p.expects()) append_number(text, value);
    }
    if (sections) {
      while (k + 1 < reference.sections.size() && reference.sections[k + 1].first <= i) ++k;
      const auto& s = reference.sections[k];
      text += "," + std::to_string(k + 1) + ",";
      if (s.block != kNoBlock) text += std::to_string(s.block);
      text += ',';
      if (s.speed_rad_s > 0) append_number(text, s.speed_rad_s);
      text += ',';
      if (s.has_air) append_number(text, s.air_Nm);
      text += s.behind_gap ? ",1" : ",0";
    }
    if (reference.over_path) {
      text += ',';
      if (p.feed > 0) append_number(text, p.feed);
    }
    text += '\n';
  }
  return write_file(path, text);
}

}  // namespace servosense
