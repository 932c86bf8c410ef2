#include "servosense/io/frf_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <string_view>
#include <utility>

#include "servosense/io/comma_fields.hpp"
#include "servosense/io/text.hpp"
#include "universal_file.hpp"

namespace servosense {
namespace {

constexpr std::array<std::string_view, 5> kColumns = {"frequency_hz", "receptance_re_m_per_N",
                                                      "receptance_im_m_per_N", "coherence",
                                                      "standard_error_m_per_N"};
constexpr std::array<std::string_view, 3> kFormats = {"csv", "columns", "uff58"};

std::string header(std::size_t columns) {
  std::string text;
  for (std::size_t i = 0; i < columns; ++i) text += (i > 0 ? "," : "") + std::string(kColumns[i]);
  return text;
}

/// Between blanks, tabs or commas.
std::vector<std::string_view> bare_fields(std::string_view line) {
  if (line.find(',') != std::string_view::npos) return comma_fields(line);
  constexpr std::string_view kBlank = " \t";
  std::vector<std::string_view> words;
  for (std::size_t at = 0;;) {
    at = line.find_first_not_of(kBlank, at);
    if (at == std::string_view::npos) return words;
    const std::size_t end = std::min(line.find_first_of(kBlank, at), line.size());
    words.push_back(line.substr(at, end - at));
    at = end;
  }
}

/// A row of the table, of either text format.
Expected<Done> take_row(const LineReader& lines, const std::vector<std::string_view>& fields,
                        FrequencyResponse& response) {
  std::array<double, 5> value{};
  for (std::size_t i = 0; i < fields.size(); ++i) {
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
  if (fields.size() > 3 && !(value[3] >= 0))
    return lines.error_here("column coherence: expected a number from 0 to 1, not " +
                            in_quotes(fields[3]));
  if (fields.size() > 4 && !(value[4] >= 0))
    return lines.error_here("column standard_error_m_per_N: expected a number from 0 on, not " +
                            in_quotes(fields[4]));
  response.frequency_hz.push_back(value[0]);
  response.receptance_m_per_N.emplace_back(value[1], value[2]);
  if (fields.size() > 3) response.coherence.push_back(std::min(value[3], 1.0));
  if (fields.size() > 4) response.standard_error_m_per_N.push_back(value[4]);
  return Done{};
}

}  // namespace

Expected<Done> take_exponential_window(const LineReader& lines, std::string_view line,
                                       FrequencyResponse& response) {
  const std::size_t at = line.find(kExponentialWindowKey);
  if (at == std::string_view::npos) return Done{};
  const std::string_view rate = trim(line.substr(at + kExponentialWindowKey.size()));
  const auto number = parse_number(rate);
  if (!number.ok() || !(number.value >= 0))
    return lines.error_here(std::string(kExponentialWindowKey) +
                            " expected a rate in 1/s from 0 on, not " + in_quotes(rate));
  response.exponential_window_per_s = number.value;
  return Done{};
}

Expected<FrfFormat> frf_format(const std::string& path, const std::string& name) {
  if (!name.empty()) {
    const auto* const at = std::find(kFormats.begin(), kFormats.end(), name);
    if (at == kFormats.end())
      return usage_error("there is no receptance format " + in_quotes(name) +
                         "; there are csv, columns and uff58");
    return static_cast<FrfFormat>(at - kFormats.begin());
  }
  std::string ending = std::filesystem::path(path).extension().string();
  for (char& c : ending)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  if (ending == ".uff" || ending == ".unv" || ending == ".uf58") return FrfFormat::uff58;
  if (ending == ".txt" || ending == ".dat" || ending == ".asc") return FrfFormat::columns;
  return FrfFormat::csv;
}

Expected<FrequencyResponse> read_frf(LineReader& lines) {
  FrequencyResponse response;
  std::size_t columns = 0;
  bool bare = false;
  for (std::string_view line;;) {
    auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) break;
    line = trim(line);
    if (line.empty()) continue;
    if (line.front() == '#') {
      if (auto ok = take_exponential_window(lines, line, response); !ok) return ok.error();
      continue;
    }
    if (columns == 0 && line == "-1") return read_universal_frf(lines);
    const std::vector<std::string_view> fields = bare ? bare_fields(line) : comma_fields(line);
    if (columns == 0) {
      const std::vector<std::string_view> words = bare_fields(line);
      bare = words.size() == 3 && parse_number(words[0]).ok();
      columns = bare ? 3 : fields.size();
      if (!bare && (columns < 3 || columns > kColumns.size() ||
                    !std::equal(fields.begin(), fields.end(), kColumns.begin())))
        return lines.error_here(
            "expected the header '" + header(3) +
            "[,coherence[,standard_error_m_per_N]]', three numbers, or '-1' of a universal file, "
            "not " +
            in_quotes(line));
      if (!bare) continue;
      if (auto ok = take_row(lines, words, response); !ok) return ok.error();
      continue;
    }
    if (fields.size() != columns)
      return lines.error_here("expected " + std::to_string(columns) + " columns, not " +
                              std::to_string(fields.size()));
    if (auto ok = take_row(lines, fields, response); !ok) return ok.error();
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

std::string frf_text(const FrequencyResponse& response, FrfFormat format,
                     const std::string& title) {
  if (format == FrfFormat::uff58) return universal_frf_text(response, title);
  const bool csv = format == FrfFormat::csv;
  const bool coherence = csv && !response.coherence.empty();
  const bool error = coherence && !response.standard_error_m_per_N.empty();
  const char separator = csv ? ',' : ' ';
  std::string text = title.empty() ? "" : "# " + title + "\n";
  if (response.exponential_window_per_s > 0)
    text += "# " + std::string(kExponentialWindowKey) + " " +
            number_text(response.exponential_window_per_s) + "\n";
  text += (csv ? "" : "# ") + header(error ? 5 : coherence ? 4 : 3) + "\n";
  for (std::size_t i = 0; i < response.frequency_hz.size(); ++i) {
    const auto more = [&](double value) {
      text += separator;
      append_number(text, value);
    };
    append_number(text, response.frequency_hz[i]);
    more(response.receptance_m_per_N[i].real());
    more(response.receptance_m_per_N[i].imag());
    if (coherence) more(response.coherence[i]);
    if (error) more(response.standard_error_m_per_N[i]);
    text += '\n';
  }
  return text;
}

}  // namespace servosense
