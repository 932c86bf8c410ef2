#include "servosense/io/frf_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>

#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr std::array<std::string_view, 4> kColumns = {"frequency_hz", "receptance_re_m_per_N",
                                                      "receptance_im_m_per_N", "coherence"};

std::string header(std::size_t columns) {
  std::string text;
  for (std::size_t i = 0; i < columns; ++i) text += (i > 0 ? "," : "") + std::string(kColumns[i]);
  return text;
}

std::vector<std::string_view> fields_of(std::string_view line) {
  std::vector<std::string_view> fields;
  for (;;) {
    const std::size_t comma = line.find(',');
    fields.push_back(trim(line.substr(0, comma)));
    if (comma == std::string_view::npos) return fields;
    line.remove_prefix(comma + 1);
  }
}

}  // namespace

Expected<FrequencyResponse> read_frf(LineReader& lines) {
  FrequencyResponse response;
  std::size_t columns = 0;
  for (std::string_view line;;) {
    auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) break;
    line = trim(line);
    if (line.empty() || line.front() == '#') continue;
    const std::vector<std::string_view> fields = fields_of(line);
    if (columns == 0) {
      columns = fields.size();
      if (columns < 3 || columns > 4 || !std::equal(fields.begin(), fields.end(), kColumns.begin()))
        return lines.error_here("expected the header '" + header(3) + "[,coherence]', not " +
                                in_quotes(line));
      continue;
    }
    if (fields.size() != columns)
      return lines.error_here("expected " + std::to_string(columns) + " columns, not " +
                              std::to_string(fields.size()));
    std::array<double, 4> value{};
    for (std::size_t i = 0; i < columns; ++i) {
      const auto number = parse_number(fields[i]);
      if (!number.ok())
        return lines.error_here("column " + std::string(kColumns[i]) + ": expected a number, not " +
                                in_quotes(fields[i]));
      value[i] = number.value;
    }
    const bool first = response.frequency_hz.empty();
    if (!(value[0] >= 0) || (!first && !(value[0] > response.frequency_hz.back())))
      return lines.error_here("column frequency_hz: frequencies must be positive and rise, but " +
                              in_quotes(fields[0]) + " does not");
    // Analysers write a little more than 1 where there is nothing to measure: limit, do not refuse.
    if (columns == 4 && !(value[3] >= 0))
      return lines.error_here("column coherence: expected a number from 0 to 1, not " +
                              in_quotes(fields[3]));
    response.frequency_hz.push_back(value[0]);
    response.receptance_m_per_N.emplace_back(value[1], value[2]);
    if (columns == 4) response.coherence.push_back(std::min(value[3], 1.0));
  }
  if (response.frequency_hz.size() < 2)
    return data_error(lines.name() + ": a receptance needs two frequencies or more");
  return response;
}

Expected<FrequencyResponse> read_frf(const std::string& path) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  LineReader lines(std::move(*stream), path);
  return read_frf(lines);
}

std::string frf_text(const FrequencyResponse& response) {
  const bool coherence = !response.coherence.empty();
  std::string text = header(coherence ? 4 : 3) + "\n";
  for (std::size_t i = 0; i < response.frequency_hz.size(); ++i) {
    append_number(text, response.frequency_hz[i]);
    for (const double part :
         {response.receptance_m_per_N[i].real(), response.receptance_m_per_N[i].imag()}) {
      text += ',';
      append_number(text, part);
    }
    if (coherence) {
      text += ',';
      append_number(text, response.coherence[i]);
    }
    text += '\n';
  }
  return text;
}

}  // namespace servosense
