#include "torque_band_prediction.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "servosense/core/units.hpp"
#include "servosense/io/comma_fields.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr std::array<std::string_view, 6> kNames = {"line",   "t_s",     "spindle.torque_Nm",
                                                    "low_Nm", "high_Nm", "spindle_rpm"};
enum Column : std::size_t { line_number, time, torque, low, high, speed, kColumns };
/// Between points [s] (chosen: below the step between verdicts).
constexpr double kPoint_s = 0.02;

struct Step {
  double from_s = 0, to_s = 0;  // of turning
  double torque_Nm = 0, low_Nm = 0, high_Nm = 0;
  std::int32_t line = kNoBlock;
  double speed_rad_s = 0;
};

Expected<std::vector<Step>> steps_of(LineReader& lines, std::string_view header) {
  std::array<std::optional<std::size_t>, kColumns> place;
  const auto names = comma_fields(header);
  const std::size_t count = names.size();
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t k = 0; k < kColumns; ++k)
      if (names[i] == kNames[k]) place[k] = i;
  for (std::size_t k = 0; k < speed; ++k)
    if (!place[k])
      return lines.error_here("a table of 'program predict' has the column " +
                              std::string(kNames[k]));
  std::vector<Step> steps;
  double before_s = 0, turned_s = 0;
  for (std::string_view line;;) {
    const auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) return steps;
    if (trim(line).empty()) continue;
    const auto fields = comma_fields(line);
    if (fields.size() != count)
      return lines.error_here("expected " + std::to_string(count) + " columns");
    std::array<double, kColumns> value{};
    for (std::size_t k = 0; k < kColumns; ++k) {
      if (!place[k]) continue;
      const auto field = fields[*place[k]];
      const auto number = parse_number(field);
      if (field == "nan")
        value[k] = std::numeric_limits<double>::quiet_NaN();
      else if (number.ok())
        value[k] = number.value;
      else
        return lines.error_here("expected a number, not " + in_quotes(field));
    }
    if (!(value[time] >= before_s) || !(value[line_number] >= 0 && value[line_number] < 1e9))
      return lines.error_here("t_s must not go back, and line is a line of the program");
    if (value[low] > value[high]) return lines.error_here("low_Nm must not lie above high_Nm");
    const double lasts_s = value[time] - before_s;
    before_s = value[time];
    const double turns = std::abs(value[speed]);
    if (place[speed] && !(turns > 0)) continue;
    steps.push_back({turned_s, turned_s + lasts_s, value[torque], value[low], value[high],
                     static_cast<std::int32_t>(value[line_number]), rad_s_from_rpm(turns)});
    turned_s += lasts_s;
  }
}

}  // namespace

bool is_prediction(std::string_view header) { return header.starts_with("line,t_s,"); }

Expected<TorqueBandReference> read_prediction(LineReader& lines, std::string_view header,
                                              const PredictedBand& band) {
  const std::string head(header);  // the reader's buffer moves on
  const auto read = steps_of(lines, head);
  if (!read) return read.error();
  const std::vector<Step>& steps = *read;
  double highest_Nm = 0;
  bool any = false;
  for (const Step& s : steps)
    if (std::isfinite(s.torque_Nm) && s.to_s > s.from_s)
      any = any || s.torque_Nm > 0, highest_Nm = std::max(highest_Nm, s.torque_Nm);
  if (!any)
    return data_error(lines.name() +
                      ": predicts no torque; give torque_equation or cutting coefficients in "
                      "[tool], and a spindle speed in the program");
  TorqueBandReference reference;
  reference.predicted = true;
  reference.spacing = kPoint_s;
  const double end_s = steps.back().to_s;
  const auto count = std::max<std::size_t>(2, static_cast<std::size_t>(end_s / kPoint_s) + 1);
  const double more_Nm = band.torque_Nm.value_or(band.highest_share * highest_Nm);
  // Steps that any part of [t - time, t + time] meets.
  std::size_t here = 0, first = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) * kPoint_s;
    while (here + 1 < steps.size() && steps[here].to_s <= t) ++here;
    while (first + 1 < steps.size() && steps[first].to_s < t - band.time_s) ++first;
    TorqueBandPoint<double> p{steps[here].torque_Nm, 1e300, -1e300, 0};
    bool known = true;
    for (std::size_t k = first; k < steps.size() && steps[k].from_s <= t + band.time_s; ++k) {
      const Step& s = steps[k];
      known = known && std::isfinite(s.torque_Nm) && std::isfinite(s.low_Nm) &&
              std::isfinite(s.high_Nm);
      p.lower_Nm = std::min(p.lower_Nm, s.low_Nm - band.share * s.torque_Nm - more_Nm);
      p.upper_Nm = std::max(p.upper_Nm, s.high_Nm + band.share * s.torque_Nm + more_Nm);
    }
    if (!known) p = {0, 1, -1, 0};
    reference.points.push_back(p);
    const Step& s = steps[here];
    if (!reference.sections.empty() && reference.sections.back().block == s.line) continue;
    TorqueBandSection<double> section;
    section.first = static_cast<std::uint32_t>(i);
    section.block = s.line;
    section.speed_rad_s = s.speed_rad_s;
    reference.sections.push_back(section);
  }
  return reference;
}

}  // namespace servosense
