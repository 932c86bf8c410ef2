// servosense lobes: which depth of cut is stable at which spindle speed.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <iostream>
#include <limits>
#include <optional>
#include <utility>

#include "chart_tool.hpp"
#include "commands.hpp"
#include "console.hpp"
#include "servosense/identify/growth_ratio.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "servosense/identify/stability_lobes.hpp"
#include "servosense/identify/usable_receptance.hpp"
#include "servosense/io/frf_file.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/report.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/write_file.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::cli {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kGap = std::numeric_limits<double>::quiet_NaN();  // in a curve
constexpr double kFastest_rpm = 1e6;  // the fastest air bearings turn half as fast
constexpr double kMostGrowth = 1.5;   // shown: the border is what matters

/// What is asked for.
struct Question {
  bool semi_discretization = false;
  MillingTool tool;
  MillingCut cut;
  Structure structure;                        // modes, unless...
  std::optional<ToolTipReceptance> measured;  // ...a receptance was measured
  double from_rpm = 0, to_rpm = 0;
  int speeds = 0;        // 0: as many as the method does in some seconds
  double deepest_m = 0;  // of the chart; 0: chosen
  std::optional<std::pair<double, double>> ratios{};  // unknown radial ratio
  bool map = false;                                   // of growth, wanted for the report
  std::vector<std::string> remarks;                   // on what was read
};

struct Answer {
  std::vector<LobePoint> limit;  // by rising speed
  std::vector<StabilityPocket> pockets;
  std::optional<LobePoint> minimum;     // of all speeds, or of those asked for
  std::optional<StabilityChart> chart;  // semi-discretisation
  std::optional<GrowthMap> growth;      // zeroth order from modes
  std::optional<LimitDepthBand> band;
  std::vector<SpeedInterval> safe;
  /// At the speed of [cut] by semi-discretisation, where the zeroth order is not enough.
  std::optional<LobePoint> interrupted;
  std::vector<std::string> remarks;
};

/// Whether fewer than one tooth is in the cut on average, which zeroth order takes for a steady
/// force.
bool is_interrupted(const Question& q) {
  return engagement_of(q.tool, q.cut).swept_rad() * q.tool.teeth < kTwoPi;
}

Expected<std::optional<ToolTipReceptance>> measured_receptance(const MachineFile& machine,
                                                               std::vector<std::string>& remarks) {
  ToolTipReceptance tip;
  bool any = false;
  for (const auto& [section, table] :
       {std::pair{"structure.x", &tip.xx}, std::pair{"structure.y", &tip.yy}}) {
    const auto file = machine.text(section, "frf");
    if (!file) continue;
    auto frf = read_frf(machine.beside(*file));
    if (!frf) return frf.error();
    auto usable = usable_receptance(*frf, *file);
    if (!usable) return usable.error();
    if (!usable->remark.empty() &&
        std::find(remarks.begin(), remarks.end(), usable->remark) == remarks.end())
      remarks.push_back(usable->remark);
    *table = std::move(usable->table);
    any = true;
  }
  if (!any) return std::optional<ToolTipReceptance>{};
  // Modes of the other direction, as a table over the same frequencies.
  const ReceptanceTable& known = tip.xx.frequency_hz.empty() ? tip.yy : tip.xx;
  for (const auto& [section, table] :
       {std::pair{"structure.x", &tip.xx}, std::pair{"structure.y", &tip.yy}}) {
    const auto modes = machine.triples(section, "modes");
    if (!modes) continue;
    ReceptanceTable sum;
    sum.frequency_hz = known.frequency_hz;
    for (const double frequency_hz : sum.frequency_hz) {
      std::complex<double> g = 0;
      for (const auto& [natural_hz, damping, mass_kg] : *modes)
        g += StructuralMode{natural_hz, damping, mass_kg}.receptance(kTwoPi * frequency_hz);
      sum.receptance_m_per_N.push_back(g);
    }
    *table = std::move(sum);
  }
  return std::optional(std::move(tip));
}

/// "LOW,HIGH" of --radial-ratio into `range`.
Expected<Done> read_ratio_range(const Arguments& arguments,
                                std::optional<std::pair<double, double>>& range) {
  const auto text = arguments.value("--radial-ratio");
  if (!text) return Done{};
  const std::size_t comma = text->find(',');
  const auto low = parse_number(text->substr(0, comma));
  const auto high =
      parse_number(comma == std::string::npos ? std::string() : text->substr(comma + 1));
  if (!low.ok() || !high.ok() || !(low.value >= 0) || !(high.value >= low.value) ||
      !(high.value <= 10))
    return usage_error(
        "--radial-ratio takes two numbers LOW,HIGH with 0 <= LOW <= HIGH <= 10, not '" + *text +
        "'");
  range.emplace(low.value, high.value);
  return Done{};
}

Expected<Question> question_of(const Arguments& arguments) {
  Question q;
  const std::string method = arguments.value("--method").value_or("zoa");
  if (method != "zoa" && method != "sd")
    return usage_error("--method is zoa (zeroth order) or sd (semi-discretisation), not '" +
                       method + "'");
  q.semi_discretization = method == "sd";
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return machine.error();
  auto tool = milling_tool(*machine);
  if (!tool) return tool.error();
  auto cut = milling_cut(*machine);
  if (!cut) return cut.error();
  q.tool = std::move(*tool);
  q.cut = *cut;
  auto measured = measured_receptance(*machine, q.remarks);
  if (!measured) return measured.error();
  q.measured = std::move(*measured);
  if (!q.measured || q.semi_discretization) {
    auto structure = structure_modes(*machine);
    if (!structure) return structure.error();
    q.structure = std::move(*structure);
  }
  q.map = arguments.has("--report");
  if (auto read = read_ratio_range(arguments, q.ratios); !read) return read.error();
  if (q.ratios && (q.measured || q.semi_discretization))
    return usage_error("--radial-ratio needs modes and the method zoa; leave out one of the two");

  for (const auto& [name, to] : {std::pair{"--from", &q.from_rpm}, std::pair{"--to", &q.to_rpm}}) {
    auto number = arguments.within(name, 1, kFastest_rpm, " rpm");
    if (!number) return number.error();
    if (*number) *to = **number;
  }
  auto depth = arguments.within("--depth", 1e-6, 1, " m");
  if (!depth) return depth.error();
  q.deepest_m = depth->value_or(0);
  if (q.from_rpm == 0) q.from_rpm = 0.5 * q.cut.spindle_speed_rpm;
  if (q.to_rpm == 0) q.to_rpm = std::max(1.5 * q.cut.spindle_speed_rpm, 1.5 * q.from_rpm);
  if (!(q.to_rpm > q.from_rpm)) return usage_error("--to must be above --from");
  auto speeds = arguments.within("--speeds", 2, 100000);
  if (!speeds) return speeds.error();
  if (*speeds) {
    if (**speeds != std::floor(**speeds))
      return usage_error("--speeds takes a whole number from 2 to 100000");
    q.speeds = static_cast<int>(**speeds);
  }
  return q;
}

std::vector<double> steps(double from, double to, int count) {
  std::vector<double> values;
  for (int i = 0; i < count; ++i) values.push_back(from + (to - from) * i / (count - 1));
  return values;
}

/// Local maxima of a limit curve, to its own resolution.
std::vector<StabilityPocket> pockets_of(const std::vector<LobePoint>& limit) {
  std::vector<StabilityPocket> pockets;
  for (std::size_t i = 1; i + 1 < limit.size(); ++i)
    if (std::isfinite(limit[i].axial_depth_m) &&
        limit[i].axial_depth_m > limit[i - 1].axial_depth_m &&
        limit[i].axial_depth_m >= limit[i + 1].axial_depth_m)
      pockets.push_back({limit[i].spindle_speed_rpm, limit[i].axial_depth_m,
                         limit[i - 1].chatter_frequency_hz, limit[i + 1].chatter_frequency_hz});
  return pockets;
}

/// Speeds and depths of a chart: fewer where every point costs a whole revolution.
constexpr int kSpeeds = 400, kDepths = 200, kDearSpeeds = 120, kDearDepths = 60;

Expected<Answer> answer_to(const Question& q, const std::function<void(double)>& done) {
  Answer a;
  a.remarks = q.remarks;
  if (auto checked = chart_knows(q.tool, q.cut, a.remarks); !checked) return checked.error();
  const bool dear = q.semi_discretization &&
                    (tooth_off_pitch(q.tool) || q.tool.force.process_damping_N_per_m != 0);
  const std::vector<double> speeds = steps(q.from_rpm, q.to_rpm,
                                           q.speeds > 0 ? q.speeds
                                           : dear       ? kDearSpeeds
                                                        : kSpeeds);
  MillingTool plain = q.tool;
  if (q.semi_discretization) {  // whose range of depths is chosen by the zeroth order
    plain.tooth_angle_rad.clear();
    plain.force.process_damping_N_per_m = 0;
  }
  auto lobes = q.measured ? StabilityLobes::from_receptance(*q.measured, plain, q.cut)
                          : StabilityLobes::from_modes(q.structure, plain, q.cut);
  if (!lobes) return lobes.error();
  auto envelope = lobes->envelope(speeds);
  if (!envelope) return envelope.error();
  const LobePoint minimum = lobes->minimum();
  if (!q.semi_discretization) {
    a.limit = std::move(*envelope);
    a.pockets = lobes->pockets(q.from_rpm, q.to_rpm);
    if (std::isfinite(minimum.axial_depth_m)) a.minimum = minimum;
  }
  double deepest = q.deepest_m;
  if (deepest == 0)
    deepest = std::max(1.5 * q.cut.axial_depth_m,
                       std::isfinite(minimum.axial_depth_m) ? 4 * minimum.axial_depth_m : 0);
  const int looks = dear ? kDearDepths : kDepths;
  std::vector<double> depths = steps(deepest / looks, deepest, looks);
  if (q.semi_discretization) {
    auto sd = SemiDiscretization::create(q.structure, q.tool, q.cut);
    if (!sd) return sd.error();
    auto chart = sd->chart(speeds, depths, 0, done);
    if (!chart) return chart.error();
    a.limit = chart->limit;
    for (const LobePoint& point : a.limit)
      if (std::isfinite(point.axial_depth_m) &&
          (!a.minimum || point.axial_depth_m < a.minimum->axial_depth_m))
        a.minimum = point;
    a.pockets = pockets_of(a.limit);
    a.chart = std::move(*chart);
    return a;
  }
  if (is_interrupted(q) && !q.measured) {
    const auto sd = SemiDiscretization::create(q.structure, q.tool, q.cut);
    if (!sd) return sd.error();
    a.interrupted = sd->limit_at(q.cut.spindle_speed_rpm, deepest);
    const LobePoint here = lobes->limit_at(q.cut.spindle_speed_rpm);
    const auto depth = [&](double depth_m) {
      return std::isfinite(depth_m) ? report::Cell(1e3 * depth_m, 3).text + " mm"
                                    : "more than " + report::Cell(1e3 * deepest, 3).text + " mm";
    };
    a.remarks.push_back(
        "the cut is interrupted (less than one tooth in it on average), where the zeroth order "
        "errs: "
        "at " +
        report::Cell(q.cut.spindle_speed_rpm, 5).text + " rpm it says " +
        depth(here.axial_depth_m) + ", semi-discretisation " + depth(a.interrupted->axial_depth_m) +
        "; use --method sd");
  } else if (is_interrupted(q)) {
    a.remarks.push_back(
        "the cut is interrupted (less than one tooth in it on average), where the zeroth order "
        "errs; "
        "fit modes to the receptance and use --method sd");
  }
  if (q.map && !q.measured) {
    auto growth = growth_map(q.structure, q.tool, q.cut, speeds, depths);
    if (!growth) return growth.error();
    a.growth = std::move(*growth);
  }
  if (q.ratios) {
    auto band =
        limit_depth_band(q.structure, q.tool, q.cut, q.ratios->first, q.ratios->second, speeds);
    if (!band) return band.error();
    a.band = std::move(*band);
    auto safe = safe_speeds(q.structure, q.tool, q.cut, q.ratios->first, q.ratios->second,
                            q.cut.axial_depth_m, q.from_rpm, q.to_rpm);
    if (!safe) return safe.error();
    a.safe = std::move(*safe);
  }
  return a;
}

std::string csv_of(const std::vector<LobePoint>& limit) {
  std::string text = "spindle_speed_rpm,axial_depth_m,chatter_frequency_hz\n";
  for (const LobePoint& point : limit) {
    append_number(text, point.spindle_speed_rpm);
    text += ',';
    append_number(text, point.axial_depth_m);
    text += ',';
    append_number(text, point.chatter_frequency_hz);
    text += '\n';
  }
  return text;
}

/// Edges of the cells around evenly spaced points.
std::vector<double> edges_of(const std::vector<double>& middles, double scale) {
  const double half = (middles[1] - middles[0]) / 2;
  std::vector<double> edges;
  for (const double middle : middles) edges.push_back(scale * (middle - half));
  edges.push_back(scale * (middles.back() + half));
  return edges;
}

report::Series limit_curve(const std::vector<LobePoint>& limit, const char* name) {
  report::Series series;
  series.name = name;
  series.unit = "mm";
  for (const LobePoint& point : limit) {
    series.x.push_back(point.spindle_speed_rpm);
    series.y.push_back(std::isfinite(point.axial_depth_m) ? 1e3 * point.axial_depth_m : kGap);
  }
  return series;
}

template <typename Map>
report::HeatMap heat_map(const Map& map, const std::vector<double>& values,
                         const std::vector<LobePoint>& limit) {
  report::HeatMap picture;
  picture.x_label = "spindle speed";
  picture.x_unit = "rpm";
  picture.y_label = "axial depth of cut";
  picture.y_unit = "mm";
  picture.x_edges = edges_of(map.spindle_speed_rpm, 1);
  picture.y_edges = edges_of(map.axial_depth_m, 1e3);
  const std::size_t columns = map.spindle_speed_rpm.size(), rows = map.axial_depth_m.size();
  picture.z.resize(columns * rows);
  for (std::size_t c = 0; c < columns; ++c)
    for (std::size_t r = 0; r < rows; ++r)
      picture.z[r * columns + c] =
          std::clamp(std::log(values[c * rows + r]), -kMostGrowth, kMostGrowth);
  picture.diverging = true;
  report::Series border = limit_curve(limit, "limit");
  const double deepest = 1e3 * map.axial_depth_m.back();
  for (double& y : border.y)
    if (y > deepest) y = kGap;
  picture.contours.push_back(std::move(border));
  return picture;
}

/// The deepest pockets in range, and those next to the speed of [cut], by rising speed.
std::vector<StabilityPocket> pockets_to_show(const Question& q, const Answer& a) {
  constexpr std::size_t kDeepest = 3, kNearest = 2;
  std::vector<StabilityPocket> shown;
  const auto take = [&](std::size_t most, auto before) {
    std::vector<StabilityPocket> all = a.pockets;
    std::stable_sort(all.begin(), all.end(), before);
    all.resize(std::min(all.size(), most));
    for (const StabilityPocket& p : all)
      if (std::none_of(shown.begin(), shown.end(), [&](const StabilityPocket& s) {
            return s.spindle_speed_rpm == p.spindle_speed_rpm;
          }))
        shown.push_back(p);
  };
  take(kDeepest, [](const auto& l, const auto& r) { return l.axial_depth_m > r.axial_depth_m; });
  const double here = q.cut.spindle_speed_rpm;
  take(kNearest, [&](const auto& l, const auto& r) {
    return std::abs(l.spindle_speed_rpm - here) < std::abs(r.spindle_speed_rpm - here);
  });
  std::sort(shown.begin(), shown.end(),
            [](const auto& l, const auto& r) { return l.spindle_speed_rpm < r.spindle_speed_rpm; });
  return shown;
}

Expected<Done> write_report(const std::string& path, const std::string& machine, const Question& q,
                            const Answer& a) {
  report::Report page("Stability lobes", machine);
  report::KeyFigures figures;
  if (a.minimum)
    figures.figures.push_back({q.semi_discretization ? "stable at every speed shown up to"
                                                     : "stable at every speed up to",
                               report::Cell(1e3 * a.minimum->axial_depth_m, 4), "mm"});
  for (const StabilityPocket& pocket : pockets_to_show(q, a))
    figures.figures.push_back(
        {"pocket of " + report::Cell(1e3 * pocket.axial_depth_m, 3).text + " mm at",
         report::Cell(std::round(pocket.spindle_speed_rpm), 5), "rpm"});
  page.add(std::move(figures));
  for (const std::string& remark : a.remarks) page.add(report::Note{remark, report::Level::info});

  report::PlotGroup group;
  report::Plot depth;
  depth.title = "Limit depth";
  depth.caption = "Cuts below the curve are stable, cuts above it chatter.";
  depth.x_label = "spindle speed";
  depth.x_unit = "rpm";
  depth.y_label = "axial depth of cut";
  depth.y_range.from = 0;
  if (a.minimum) {
    double highest = std::max(1.1 * q.cut.axial_depth_m, 4 * a.minimum->axial_depth_m);
    for (const StabilityPocket& pocket : a.pockets)
      highest =
          std::max(highest, std::min(1.2 * pocket.axial_depth_m, 12 * a.minimum->axial_depth_m));
    depth.y_range.to = 1e3 * highest;
  }
  depth.series.push_back(limit_curve(a.limit, "limit"));
  if (a.band) {
    depth.series.clear();
    const auto edge_of_band = [&](const char* name, const std::vector<double>& depth_m) {
      report::Series series;
      series.name = name;
      series.unit = "mm";
      series.x = a.band->spindle_speed_rpm;
      for (const double d : depth_m) series.y.push_back(std::isfinite(d) ? 1e3 * d : kGap);
      depth.series.push_back(std::move(series));
    };
    edge_of_band("safe below", a.band->lowest_depth_m);
    edge_of_band("chatters above", a.band->highest_depth_m);
    for (const SpeedInterval& safe : a.safe)
      depth.spans.push_back({safe.from_rpm, safe.to_rpm,
                             "safe for every radial ratio at the depth of [cut]",
                             report::Level::info});
  }
  report::Series cut;
  cut.name = "the cut of [cut]";
  cut.unit = "mm";
  cut.x = {q.cut.spindle_speed_rpm};
  cut.y = {1e3 * q.cut.axial_depth_m};
  cut.style = report::Series::Style::points;
  if (q.cut.spindle_speed_rpm >= q.from_rpm && q.cut.spindle_speed_rpm <= q.to_rpm)
    depth.series.push_back(std::move(cut));
  depth.limits.push_back({1e3 * q.cut.axial_depth_m, "depth of [cut]", report::Level::info});
  for (const StabilityPocket& pocket : a.pockets)
    depth.marks.push_back({pocket.spindle_speed_rpm,
                           "pocket, " + report::Cell(1e3 * pocket.axial_depth_m, 4).text + " mm",
                           report::Level::info});
  group.plots.push_back(std::move(depth));
  report::Plot frequency;
  frequency.title = "Chatter frequency";
  frequency.caption = "At the limit.";
  frequency.y_label = "frequency";
  report::Series chatter;
  chatter.name = "chatter frequency";
  chatter.unit = "Hz";
  chatter.style = report::Series::Style::points;
  for (const LobePoint& point : a.limit) {
    chatter.x.push_back(point.spindle_speed_rpm);
    chatter.y.push_back(point.chatter_frequency_hz);
  }
  frequency.series.push_back(std::move(chatter));
  frequency.height_px = 160;
  group.plots.push_back(std::move(frequency));
  page.add(std::move(group));
  if (a.chart) {
    report::HeatMap map = heat_map(*a.chart, a.chart->spectral_radius, a.limit);
    map.title = "Growth from tooth to tooth";
    map.caption =
        "Logarithm of the largest Floquet multiplier: below zero vibration dies out, "
        "above zero it grows.";
    map.z_label = "log |mu|";
    page.add(std::move(map));
  }
  if (a.growth) {
    report::HeatMap map = heat_map(*a.growth, a.growth->amplitude_ratio, a.limit);
    map.title = "Growth from tooth to tooth";
    map.caption =
        "Logarithm of the amplitude ratio of one tooth pass to the one before (Koike "
        "2016, eq. 8-1): below zero vibration dies out, above zero it grows.";
    map.z_label = "log mu";
    page.add(std::move(map));
  }
  return page.write(path);
}

void print_text(const Question& q, const Answer& a) {
  if (a.minimum)
    say("stable at every speed%s up to %.4g mm (chatter at %.4g Hz)\n",
        q.semi_discretization ? " shown" : "", 1e3 * a.minimum->axial_depth_m,
        a.minimum->chatter_frequency_hz);
  else
    say("nothing limits the depth%s\n", q.semi_discretization ? " shown" : "");
  for (const StabilityPocket& pocket : a.pockets)
    say("pocket at %7.0f rpm: %.4g mm (%.4g Hz below, %.4g Hz above)\n", pocket.spindle_speed_rpm,
        1e3 * pocket.axial_depth_m, pocket.chatter_frequency_below_hz,
        pocket.chatter_frequency_above_hz);
  if (a.band) {
    if (a.safe.empty()) say("no speed is safe over the whole range of radial ratios\n");
    for (const SpeedInterval& safe : a.safe)
      say("safe at %.4g mm for every radial ratio: %.0f to %.0f rpm\n", 1e3 * q.cut.axial_depth_m,
          safe.from_rpm, safe.to_rpm);
  }
}

void print_json(const Question& q, const Answer& a) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("method", q.semi_discretization ? "sd" : "zoa");
  json.key("minimum_axial_depth_m");
  json.value(a.minimum ? a.minimum->axial_depth_m : kInfinite);
  json.objects("pockets", a.pockets, [&](const StabilityPocket& pocket) {
    json.member("spindle_speed_rpm", pocket.spindle_speed_rpm);
    json.member("axial_depth_m", pocket.axial_depth_m);
    json.member("chatter_frequency_below_hz", pocket.chatter_frequency_below_hz);
    json.member("chatter_frequency_above_hz", pocket.chatter_frequency_above_hz);
  });
  if (a.band) {
    json.key("safe_speeds_rpm");
    json.begin_array();
    for (const SpeedInterval& safe : a.safe) {
      json.begin_array();
      json.value(safe.from_rpm);
      json.value(safe.to_rpm);
      json.end_array();
    }
    json.end_array();
  }
  if (a.interrupted) {
    json.key("semi_discretization");
    json.begin_object();
    json.member("spindle_speed_rpm", a.interrupted->spindle_speed_rpm);
    json.member("axial_depth_m", a.interrupted->axial_depth_m);
    json.end_object();
  }
  json.values("remarks", a.remarks);
  json.objects("limit", a.limit, [&](const LobePoint& point) {
    json.member("spindle_speed_rpm", point.spindle_speed_rpm);
    json.member("axial_depth_m", point.axial_depth_m);
    json.member("chatter_frequency_hz", point.chatter_frequency_hz);
  });
  json.end_object();
  std::cout << '\n';
}

int run_lobes(const Arguments& arguments) {
  auto question = question_of(arguments);
  if (!question) return fail(question.error());
  auto answer = [&] {
    Progress progress("charting", arguments.quiet());
    return answer_to(*question, [&](double share) { progress.show(share); });
  }();
  if (!answer) return fail(answer.error());
  if (!arguments.quiet())
    for (const std::string& remark : answer->remarks) note(remark);
  if (const auto out = arguments.value("--out"))
    if (auto done = write_file(*out, csv_of(answer->limit)); !done) return fail(done.error());
  if (const auto path = arguments.value("--report"))
    if (auto done = write_report(*path, arguments.at("--machine"), *question, *answer); !done)
      return fail(done.error());
  if (arguments.json())
    print_json(*question, *answer);
  else
    print_text(*question, *answer);
  return 0;
}

}  // namespace

Program lobes_program() {
  return {
      {"lobes",
       "stability lobes: the stable depth of cut at every spindle speed",
       {{"--machine", "FILE", "machine file with [tool], [cut] and [structure.x] or .y", true,
         FileUse::input},
        {"--method", "zoa|sd",
         "zeroth order (default), or semi-discretisation for small radial immersion", false},
        {"--from", "RPM", "lowest spindle speed (half that of [cut])", false},
        {"--to", "RPM", "highest spindle speed (1.5 times that of [cut])", false},
        {"--speeds", "N",
         "spindle speeds in the chart (400; 120 with unequal pitch or process damping)", false},
        {"--depth", "M", "greatest axial depth of the chart, in metres", false},
        {"--radial-ratio", "LOW,HIGH",
         "range of an unknown radial ratio: the speeds safe over all of it", false},
        {"--out", "CSV", "file for the limit depth at every speed", false, FileUse::output},
        {"--report", "HTML", "page with the chart", false, FileUse::output}},
       "",
       "Spindle speed and depth of [cut] set the default ranges; the chart holds for all others."},
      run_lobes};
}

}  // namespace servosense::cli
