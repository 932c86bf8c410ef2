#include "map_table.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

#include "servosense/core/units.hpp"
#include "servosense/io/comma_fields.hpp"
#include "servosense/io/text.hpp"

namespace servosense::detail {
namespace {

std::string unknown(std::string_view what, std::string_view name,
                    std::span<const std::string_view> known) {
  return "unknown " + std::string(what) + ' ' + in_quotes(name) + "; the nearest known one is '" +
         std::string(nearest_name(name, known)) + "'";
}

}  // namespace

Error MapTable::error_at(std::size_t line, const std::string& what) const {
  return data_error(name + ':' + std::to_string(line) + ": " + what);
}

Expected<MapTable> MapTable::read(LineReader lines, std::span<const std::string_view> columns,
                                  std::size_t required, std::span<const std::string_view> settings,
                                  std::string_view instead) {
  MapTable table;
  table.name = lines.name();
  std::vector<std::size_t> heading;
  std::string_view line;
  for (;;) {
    auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) return table;
    const std::string_view content = trim(line.substr(0, line.find('#')));
    const std::size_t equals = content.find('=');
    if (content.empty()) continue;
    if (heading.empty() && equals != std::string_view::npos) {
      const std::string_view name = trim(content.substr(0, equals));
      if (std::find(settings.begin(), settings.end(), name) == settings.end())
        return lines.error_here(unknown("setting", name, settings));
      if (std::any_of(table.settings.begin(), table.settings.end(),
                      [&](const Setting& s) { return s.name == name; }))
        return lines.error_here("the setting " + in_quotes(name) + " stands twice");
      table.settings.push_back(
          {std::string(name), std::string(trim(content.substr(equals + 1))), lines.line_number()});
      continue;
    }
    const auto cells = comma_fields(content);
    if (heading.empty()) {
      for (const std::string_view cell : cells) {
        const auto at = std::find(columns.begin(), columns.end(), cell);
        if (at == columns.end()) return lines.error_here(unknown("column", cell, columns));
        const auto column = static_cast<std::size_t>(at - columns.begin());
        if (std::find(heading.begin(), heading.end(), column) != heading.end())
          return lines.error_here("column " + in_quotes(cell) + " stands twice");
        heading.push_back(column);
      }
      if (!instead.empty() && std::find(cells.begin(), cells.end(), instead) != cells.end())
        required = 1;
      for (std::size_t c = 0; c < required; ++c)
        if (std::find(heading.begin(), heading.end(), c) == heading.end()) {
          std::string all;
          for (std::size_t i = 0; i < required; ++i)
            all += (i == 0 ? "" : ", ") + std::string(columns[i]);
          return lines.error_here("the column '" + std::string(columns[c]) +
                                  "' is missing; a table begins with: " + all);
        }
      continue;
    }
    if (cells.size() > heading.size())
      return lines.error_here(std::to_string(cells.size()) + " fields under a heading of " +
                              std::to_string(heading.size()));
    Row row{std::vector<std::string>(columns.size()), lines.line_number()};
    for (std::size_t i = 0; i < cells.size(); ++i) row.cell[heading[i]] = cells[i];
    table.rows.push_back(std::move(row));
  }
}

std::optional<std::uint32_t> parse_unsigned(std::string_view text, int base) {
  std::uint32_t value = 0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  if (text.empty() || fault != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::optional<double> parse_product(std::string_view text) {
  double product = 1;
  for (;;) {
    const std::size_t star = text.find('*');
    const auto number = parse_number(trim(text.substr(0, star)));
    if (!number.ok()) return std::nullopt;
    product *= number.value;
    if (star == std::string_view::npos) break;
    text.remove_prefix(star + 1);
  }
  if (!std::isfinite(product)) return std::nullopt;
  return product;
}

Expected<Signal> parse_signal(std::string_view text, std::string_view others) {
  const std::size_t dot = text.find('.');
  const auto channel = channel_from(text.substr(0, dot));
  const std::string_view rest =
      dot == std::string_view::npos ? std::string_view{} : text.substr(dot + 1);
  const auto quantity = quantity_from(rest);
  if (channel && quantity) return Signal{*channel, *quantity};
  std::string sentence = "expected a trace column such as x.position_m" + std::string(others) +
                         ", found " + in_quotes(text);
  if (channel)
    sentence +=
        "; the nearest quantity is '" + std::string(nearest_name(rest, kQuantityNames)) + "'";
  else if (quantity)
    sentence += "; the nearest channel is '" +
                std::string(nearest_name(text.substr(0, dot), kChannelNames)) + "'";
  return data_error(sentence);
}

std::optional<std::int64_t> parse_period_ns(std::string_view text) {
  const auto period = parse_number(text);
  if (!period.ok() || !(period.value >= 1e-6 && period.value <= 10)) return std::nullopt;
  return nanoseconds_from(period.value);
}

}  // namespace servosense::detail
