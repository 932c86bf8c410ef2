#include "torque_band_prediction.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "servosense/core/units.hpp"
#include "servosense/io/comma_fields.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr std::array<std::string_view, 21> kNames = {"line",
                                                     "t_s",
                                                     "spindle.torque_Nm",
                                                     "low_Nm",
                                                     "high_Nm",
                                                     "spindle_rpm",
                                                     "removed_m2",
                                                     "contact_m2",
                                                     "axial_depth_m",
                                                     "entry_deg",
                                                     "exit_deg",
                                                     "tool",
                                                     "least_force_x_N",
                                                     "greatest_force_x_N",
                                                     "least_force_y_N",
                                                     "greatest_force_y_N",
                                                     "least_force_z_N",
                                                     "greatest_force_z_N",
                                                     "arcs_deg",
                                                     "wider_Nm",
                                                     "higher_Nm"};
enum Column : std::size_t {
  line_number,
  time,
  mean_torque,
  low,
  high,
  spindle_speed,
  removed,
  contact,
  depth,
  entry,
  leaving,
  tool,
  least_x,
  arcs = least_x + 2 * kAxes,
  wider,
  higher,
  kColumns
};
constexpr std::array<std::string_view, kAxes> kMeans = {"force_x_N", "force_y_N", "force_z_N"};
/// Between points [s] (chosen: below the step between verdicts).
constexpr double kPoint_s = 0.02;
/// Steps of one engagement: what they remove and touch, and where, differs by less (chosen: what
/// the lines of a workpiece leave to chance; a twentieth of the torque at most).
constexpr double kSameArea = 0.05, kSameAngle_rad = 0.05;
/// Radial forces, and so where a force points, are known half as well as torque (convention).
constexpr double kForceError = 2;

struct Step {
  double from_s = 0, to_s = 0;  // of turning
  double torque_Nm = 0, low_Nm = 0, high_Nm = 0;
  std::int32_t line = kNoBlock;
  double speed_rad_s = 0;
  bool cuts = false;
  int tool = 0;
  std::optional<PredictedEngagement> engagement;  // where it is one arc
  std::array<ForceRange<double>, kAxes> force{};  // low-passed, on the drives
  TorqueBandChange<double> change;
};

struct Table {
  std::vector<Step> steps;
  bool has_cuts = false, has_changes = false;
};

using Values = std::array<double, kColumns>;

/// What a low-pass of two equal lags, as observers are, leaves of the swing about the mean.
double swing_left(const PredictedBand& band, double speed_rad_s) {
  if (band.teeth == 0 || !(band.force_cutoff_rad_s > 0)) return 1;
  const double over = band.teeth * speed_rad_s / band.force_cutoff_rad_s;
  return 1 / (1 + over * over);
}

void add_cut(const Values& value, const std::array<double, kAxes>& mean_N, bool one_arc,
             const PredictedBand& band, Step& step) {
  step.cuts = value[removed] > 0;
  step.tool = static_cast<int>(value[tool]);
  if (!step.cuts) {
    step.force.fill({0, 0});
    return;
  }
  // Rotation to the left is the mirror image, which nothing here is made for.
  if (one_arc && value[spindle_speed] > 0)
    step.engagement = {value[removed], value[contact], value[depth], rad_from_deg(value[entry]),
                       rad_from_deg(value[leaving])};
  const double left = swing_left(band, step.speed_rad_s);
  const double above =
      step.torque_Nm > 0 ? (step.high_Nm - step.torque_Nm) / step.torque_Nm + band.share : 0;
  for (std::size_t i = 0; i < kAxes; ++i) {
    const double least = value[least_x + 2 * i], most = value[least_x + 2 * i + 1];
    if (!(std::isfinite(least) && std::isfinite(most) && std::isfinite(above))) continue;
    const double least_N = mean_N[i] + left * (least - mean_N[i]);
    const double most_N = mean_N[i] + left * (most - mean_N[i]);
    const double wide = 1 + kForceError * above;
    // A drive pushes against what acts on its tool.
    step.force[i] = {wide * std::min(0.0, -most_N), wide * std::max(0.0, -least_N)};
  }
}

Expected<Table> steps_of(LineReader& lines, std::string_view header, const PredictedBand& band) {
  std::array<std::optional<std::size_t>, kColumns> place;
  std::array<std::optional<std::size_t>, kAxes> means;
  const auto names = comma_fields(header);
  const std::size_t count = names.size();
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t k = 0; k < kColumns; ++k)
      if (names[i] == kNames[k]) place[k] = i;
    for (std::size_t k = 0; k < kAxes; ++k)
      if (names[i] == kMeans[k]) means[k] = i;
  }
  for (std::size_t k = 0; k < spindle_speed; ++k)
    if (!place[k])
      return lines.error_here("a table of 'program predict' has the column " +
                              std::string(kNames[k]));
  Table table;
  const auto there = [](const auto& at) { return at.has_value(); };
  table.has_cuts =
      std::all_of(place.begin(), place.begin() + wider, there) && std::ranges::all_of(means, there);
  table.has_changes = place[wider] && place[higher];
  double before_s = 0, turned_s = 0;
  for (std::string_view line;;) {
    const auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) return table;
    if (trim(line).empty()) continue;
    const auto fields = comma_fields(line);
    if (fields.size() != count)
      return lines.error_here("expected " + std::to_string(count) + " columns");
    std::string_view wrong;
    const auto number_in = [&](std::size_t column) {
      const std::string_view field = fields[column];
      const auto number = parse_number(field);
      if (field != "nan" && !number.ok()) wrong = field;
      return field == "nan" ? std::numeric_limits<double>::quiet_NaN() : number.value;
    };
    Values value{};
    for (std::size_t k = 0; k < kColumns; ++k)
      if (place[k] && k != arcs) value[k] = number_in(*place[k]);
    std::array<double, kAxes> mean_N{};
    for (std::size_t k = 0; k < kAxes; ++k)
      if (means[k]) mean_N[k] = number_in(*means[k]);
    if (!wrong.empty()) return lines.error_here("expected a number, not " + in_quotes(wrong));
    if (!(value[time] >= before_s) || !(value[line_number] >= 0 && value[line_number] < 1e9))
      return lines.error_here("t_s must not go back, and line is a line of the program");
    if (value[low] > value[high]) return lines.error_here("low_Nm must not lie above high_Nm");
    const double lasts_s = value[time] - before_s;
    before_s = value[time];
    const double turns = std::abs(value[spindle_speed]);
    if (place[spindle_speed] && !(turns > 0)) continue;
    Step& step = table.steps.emplace_back();
    step.from_s = turned_s;
    step.to_s = turned_s += lasts_s;
    step.torque_Nm = value[mean_torque];
    step.low_Nm = value[low];
    step.high_Nm = value[high];
    step.line = static_cast<std::int32_t>(value[line_number]);
    step.speed_rad_s = rad_s_from_rpm(turns);
    const auto above = [&](Column changed) {
      const double by_Nm = value[changed] - step.torque_Nm;
      return std::isfinite(by_Nm) ? by_Nm : 0;
    };
    if (table.has_changes) step.change = {above(wider), above(higher)};
    if (table.has_cuts)
      add_cut(value, mean_N, std::ranges::count(fields[*place[arcs]], ':') == 1, band, step);
  }
}

bool same(const PredictedEngagement& a, const PredictedEngagement& b) {
  const auto near = [](double x, double y) { return std::abs(x - y) <= kSameArea * x; };
  return near(a.removed_m2, b.removed_m2) && near(a.contact_m2, b.contact_m2) &&
         std::abs(a.start_rad - b.start_rad) <= kSameAngle_rad &&
         std::abs(a.exit_rad - b.exit_rad) <= kSameAngle_rad;
}

/// What steps `first` to `end` share, of which `here` is the one in the middle.
ExpectedCut<double> shared_by(const std::vector<Step>& steps, std::size_t first, std::size_t end,
                              std::size_t here, std::vector<PredictedEngagement>& engagements) {
  ExpectedCut<double> cut;
  cut.force.fill({0, 0});
  const auto& middle = steps[here].engagement;
  bool any = false, steady = middle.has_value();
  for (std::size_t k = first; k < end; ++k) {
    const Step& s = steps[k];
    any = any || s.cuts;
    steady = steady && s.engagement && same(*middle, *s.engagement);
    for (std::size_t i = 0; i < kAxes; ++i) {
      cut.force[i].least_N = std::min(cut.force[i].least_N, s.force[i].least_N);
      cut.force[i].most_N = std::max(cut.force[i].most_N, s.force[i].most_N);
    }
  }
  cut.kind = !any     ? ExpectedCutKind::air
             : steady ? ExpectedCutKind::steady
                      : ExpectedCutKind::changing;
  if (!steady) return cut;
  if (engagements.empty() || !same(engagements.back(), *middle)) engagements.push_back(*middle);
  if (engagements.size() > std::numeric_limits<std::uint16_t>::max())
    cut.kind = ExpectedCutKind::changing;
  else
    cut.engagement = static_cast<std::uint16_t>(engagements.size() - 1);
  return cut;
}

}  // namespace

bool is_prediction(std::string_view header) { return header.starts_with("line,t_s,"); }

Expected<TorqueBandReference> read_prediction(LineReader& lines, std::string_view header,
                                              const PredictedBand& band) {
  const std::string head(header);  // the reader's buffer moves on
  const auto read = steps_of(lines, head, band);
  if (!read) return read.error();
  const std::vector<Step>& steps = read->steps;
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
    std::size_t k = first;
    for (; k < steps.size() && steps[k].from_s <= t + band.time_s; ++k) {
      const Step& s = steps[k];
      known = known && std::isfinite(s.torque_Nm) && std::isfinite(s.low_Nm) &&
              std::isfinite(s.high_Nm);
      p.lower_Nm = std::min(p.lower_Nm, s.low_Nm - band.share * s.torque_Nm - more_Nm);
      p.upper_Nm = std::max(p.upper_Nm, s.high_Nm + band.share * s.torque_Nm + more_Nm);
    }
    if (!known) p = {0, 1, -1, 0};
    reference.points.push_back(p);
    if (read->has_changes) reference.changes.push_back(steps[here].change);
    if (read->has_cuts)
      reference.cuts.push_back(shared_by(steps, first, k, here, reference.engagements));
    const Step& s = steps[here];
    if (!reference.sections.empty() && reference.sections.back().block == s.line) continue;
    TorqueBandSection<double> section;
    section.first = static_cast<std::uint32_t>(i);
    section.block = s.line;
    section.speed_rad_s = s.speed_rad_s;
    reference.sections.push_back(section);
  }
  // Areas and angles mean something of one tool alone.
  std::set<int> tools;
  for (const Step& s : steps)
    if (s.cuts) tools.insert(s.tool);
  if (tools.size() > 1) reference.engagements.clear();
  return reference;
}

}  // namespace servosense
