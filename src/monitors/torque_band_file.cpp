#include "servosense/monitors/torque_band_file.hpp"

#include <array>
#include <cmath>
#include <string_view>
#include <utility>

#include "servosense/io/text.hpp"
#include "servosense/io/write_file.hpp"

namespace servosense {
namespace {

constexpr std::string_view kHeader = "program_s,torque_Nm,lower_Nm,upper_Nm";

Expected<std::array<double, 4>> numbers_of(std::string_view line, const LineReader& lines) {
  std::array<double, 4> value{};
  for (std::size_t i = 0; i < value.size(); ++i) {
    const std::size_t comma = line.find(',');
    if ((comma == std::string_view::npos) != (i + 1 == value.size()))
      return lines.error_here("expected 4 columns");
    const std::string_view field = trim(line.substr(0, comma));
    const auto number = parse_number(field);
    if (!number.ok()) return lines.error_here("expected a number, not " + in_quotes(field));
    value[i] = number.value;
    if (comma != std::string_view::npos) line.remove_prefix(comma + 1);
  }
  return value;
}

}  // namespace

Expected<TorqueBandReference> read_torque_band(LineReader& lines) {
  TorqueBandReference reference;
  bool header = false;
  for (std::string_view line;;) {
    auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) break;
    line = trim(line);
    if (line.empty() || line.front() == '#') continue;
    if (!header) {
      if (line != kHeader)
        return lines.error_here("expected the header '" + std::string(kHeader) + "', not " +
                                in_quotes(line));
      header = true;
      continue;
    }
    auto value = numbers_of(line, lines);
    if (!value) return value.error();
    const auto& [program_s, torque, lower, upper] = *value;
    const std::size_t n = reference.points.size();
    if (n == 1) reference.spacing_s = program_s;
    const double expected = static_cast<double>(n) * reference.spacing_s;
    if (!(std::abs(program_s - expected) <= 1e-6 * (expected + reference.spacing_s)) ||
        (n == 1 && !(program_s > 0)))
      return lines.error_here("program_s must begin with 0 and rise in equal steps");
    if (!(lower < upper)) return lines.error_here("lower_Nm must lie below upper_Nm");
    reference.points.push_back({torque, lower, upper});
  }
  if (reference.points.size() < 2)
    return data_error(lines.name() + ": a torque band needs two points or more");
  return reference;
}

Expected<TorqueBandReference> read_torque_band(const std::string& path) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  LineReader lines(std::move(*stream), path);
  return read_torque_band(lines);
}

Expected<Done> write_torque_band(const std::string& path, const TorqueBandReference& reference,
                                 const std::string& comment) {
  std::string text = "# " + comment + "\n" + std::string(kHeader) + "\n";
  for (std::size_t i = 0; i < reference.points.size(); ++i) {
    const auto& p = reference.points[i];
    append_number(text, static_cast<double>(i) * reference.spacing_s);
    for (const double value : {p.torque_Nm, p.lower_Nm, p.upper_Nm}) {
      text += ',';
      append_number(text, value);
    }
    text += '\n';
  }
  return write_file(path, text);
}

}  // namespace servosense
