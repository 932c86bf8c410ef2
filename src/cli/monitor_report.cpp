// The page of a monitored run: verdict, when each monitor watched, a picture of what each looked
// at, events.
#include "monitor_report.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <tuple>
#include <utility>

#include "effort_unit.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/report.hpp"

namespace servosense::cli {
namespace {

using report::Level;

constexpr std::size_t kMeans = 600;  // about a value a pixel of a wide page

Level level_of(MonitorState state) {
  if (state == MonitorState::alarm) return Level::alarm;
  if (state == MonitorState::warning || state == MonitorState::signal_fault) return Level::warning;
  return Level::info;
}

std::string drive_title(Channel channel) {
  return channel == Channel::spindle    ? "Spindle"
         : channel == Channel::spindle2 ? "Second spindle"
                                        : "Axis " + std::string(name_of(channel));
}

// Of what the monitor looks at: power of torque, rate of force.
std::string value_unit(const DriveHistory& drive) {
  return derived_unit(drive.unit, is_spindle(drive.channel) ? "2" : "/s");
}

report::Series series_of(const Envelope& envelope, std::string name, std::string unit) {
  report::Series s;
  s.name = std::move(name);
  s.unit = std::move(unit);
  envelope.points(s.x, s.y);
  return s;
}

// What the cut does is the mean; teeth and noise are the envelope around it.
void add_mean_and_envelope(const Envelope& envelope, const std::string& unit, report::Plot& plot) {
  plot.series.push_back(series_of(envelope, "smallest to largest", unit));
  plot.series.back().faint = true;
  report::Series mean;
  mean.name = "mean";
  mean.unit = unit;
  envelope.means(kMeans, mean.x, mean.y);
  plot.series.push_back(std::move(mean));
}

/// States of one monitor from the events, the last one up to the end of the record.
struct Stretch {
  double from_s, to_s;
  MonitorState state;
};
std::vector<Stretch> stretches(const MonitorRun& run, MonitorId monitor, Channel channel,
                               MonitorState first) {
  std::vector<Stretch> all;
  double since_s = run.from_s;
  MonitorState state = first;
  for (const Event& e : run.events) {
    if (e.monitor != monitor || e.channel != name_of(channel)) continue;
    if (e.t_s > since_s) all.push_back({since_s, e.t_s, state});
    since_s = e.t_s;
    state = e.state;
  }
  all.push_back({since_s, run.to_s, state});
  return all;
}

bool is_grave(MonitorState state) { return level_of(state) != Level::info; }

// Alarms, warnings and faults on one channel. A few alarms are explained below the picture; many
// are left to the table of events.
void mark(const MonitorRun& run, Channel channel, bool explain, report::Plot& plot) {
  constexpr std::size_t kMostExplained = 8;
  for (const MonitorAvailability& m : run.plan.monitors) {
    if (!m.runs || m.channel != channel) continue;
    for (const Stretch& s : stretches(run, m.monitor, channel, MonitorState::idle))
      if (is_grave(s.state)) plot.spans.push_back({s.from_s, s.to_s, "", level_of(s.state)});
  }
  for (const Event& e : run.events)
    if (e.channel == name_of(channel) && e.state == MonitorState::alarm)
      plot.marks.push_back(
          {e.t_s, std::string(name_of(e.monitor)) + ": " + e.reason, Level::alarm});
  if (!explain || plot.marks.size() > kMostExplained)
    for (report::Mark& m : plot.marks) m.label.clear();
}

report::Timeline timeline(const MonitorRun& run) {
  report::Timeline t;
  t.title = "What watched, and when";
  t.caption = "Each monitor that runs, from the first to the last sample.";
  t.unit = "s";
  t.from = run.from_s;
  t.to = run.to_s;
  for (std::size_t i = 0; i < run.plan.monitors.size(); ++i) {
    const MonitorAvailability& m = run.plan.monitors[i];
    if (!m.runs) continue;
    report::TimelineRow row;
    row.name = std::string(name_of(m.monitor)) + ", " + std::string(name_of(m.channel));
    for (const Stretch& s : stretches(run, m.monitor, m.channel, MonitorState::learning))
      row.spans.push_back({s.from_s, s.to_s, name_of(s.state)});
    const double share =
        run.to_s > run.from_s ? run.watched[i].armed_s / (run.to_s - run.from_s) : 0;
    row.remark = std::to_string(static_cast<int>(std::lround(100 * std::min(1.0, share)))) + " %";
    t.rows.push_back(std::move(row));
  }
  return t;
}

report::PlotGroup pictures(const MonitorRun& run, const DriveHistory& drive) {
  const bool spindle = is_spindle(drive.channel), turns = is_turning(drive.channel);
  report::PlotGroup group;
  report::Plot estimate;
  estimate.title = turns ? "Cutting torque" : "Cutting force";
  estimate.caption =
      "Estimated from motor effort and motion; friction, inertia and gravity removed.";
  estimate.x_label = "time";
  estimate.x_unit = "s";
  estimate.y_label = turns ? "torque" : "force";
  add_mean_and_envelope(drive.estimate, drive.unit, estimate);
  mark(run, drive.channel, true, estimate);
  group.plots.push_back(std::move(estimate));

  report::Plot watched;
  watched.title = spindle ? "Vibration power" : "Disturbance jerk";
  watched.y_label = spindle ? "power" : turns ? "rate of torque" : "rate of force";
  watched.series.push_back(series_of(drive.value, spindle ? "chatter" : "jerk", value_unit(drive)));
  if (spindle) watched.series.push_back(series_of(drive.forced_power, "forced", value_unit(drive)));
  if (drive.threshold > 0)
    watched.limits.push_back({drive.threshold, "alarm threshold", Level::none});
  if (drive.threshold > 0 && !spindle)
    watched.limits.push_back({-drive.threshold, "", Level::none});
  mark(run, drive.channel, false, watched);
  group.plots.push_back(std::move(watched));

  report::Plot speed;
  speed.title = "Speed";
  speed.y_label = "speed";
  speed.height_px = 120;
  speed.series.push_back(series_of(drive.speed, "speed", turns ? "rpm" : "m/s"));
  group.plots.push_back(std::move(speed));
  return group;
}

/// Speed of rotation [rpm], where it is the same for most of the turning; 0 where it is not.
double usual_speed_rpm(const Envelope& speed) {
  constexpr double kSame = 0.02;  // of the middle one, for eight tenths of the time
  std::vector<double> x, rpm;
  speed.means(kMeans, x, rpm);
  for (double& n : rpm) n = std::abs(n);
  std::sort(rpm.begin(), rpm.end());
  if (rpm.empty()) return 0;
  rpm.erase(rpm.begin(), std::upper_bound(rpm.begin(), rpm.end(), 0.1 * rpm.back()));
  if (rpm.empty()) return 0;
  const double low = rpm[rpm.size() / 10], high = rpm[rpm.size() - 1 - rpm.size() / 10];
  const double middle = rpm[rpm.size() / 2];
  return high - low <= 2 * kSame * middle ? middle : 0;
}

report::Plot spectrum(const MonitorRun& run, const DriveHistory& drive) {
  report::Plot plot;
  plot.title = is_turning(drive.channel) ? "Spectrum of the cutting torque"
                                         : "Spectrum of the cutting force";
  plot.caption =
      "Welch average over the record, Hann window; the lines of a sinusoid sum to its mean square.";
  plot.x_label = "frequency";
  plot.x_unit = "Hz";
  plot.y_label = "power per line";
  plot.log_y = true;
  report::Series s;
  s.name = "estimate";
  s.unit = derived_unit(drive.unit, "2");
  s.x = drive.spectrum.frequency_hz();
  s.y = drive.spectrum.power();
  s.x.erase(s.x.begin());
  s.y.erase(s.y.begin());
  plot.series.push_back(std::move(s));
  double rpm = 0;
  for (const DriveHistory& d : run.drives)
    if (d.channel == run.plan.tool_spindle) rpm = usual_speed_rpm(d.speed);
  const double highest_hz = 0.5 / run.sample_period_s;
  const auto line = [&](double hz, const std::string& what) {
    if (hz > 0 && hz < highest_hz) plot.marks.push_back({hz, what, Level::info});
  };
  line(rpm / 60, "rotation of the spindle");
  if (run.teeth > 1) line(run.teeth * rpm / 60, "tooth passing");
  for (const double hz : run.chatter_hz) line(hz, "chatter");
  if (rpm == 0)
    plot.caption += " The spindle's speed changes, so no line of rotation or teeth is marked.";
  return plot;
}

report::Histogram histogram(const DriveHistory& drive) {
  const bool spindle = is_spindle(drive.channel);
  report::Histogram h;
  h.title = spindle ? "Chatter power" : "Disturbance jerk";
  h.caption = "How often each value was seen, and where the threshold lies.";
  h.x_label = spindle ? "chatter power" : "jerk";
  h.x_unit = value_unit(drive);
  h.values = drive.values;
  h.log_count = true;
  if (drive.threshold > 0) h.limits.push_back({drive.threshold, "alarm threshold", Level::none});
  if (drive.threshold > 0 && !spindle)
    h.limits.push_back({-drive.threshold, "alarm threshold", Level::none});
  return h;
}

void shade_grave(const MonitorRun& run, MonitorId monitor, report::Plot& plot) {
  for (const Stretch& s : stretches(run, monitor, Channel::tool, MonitorState::idle))
    if (is_grave(s.state)) plot.spans.push_back({s.from_s, s.to_s, "", level_of(s.state)});
}

report::Plot picture(const MonitorRun& run, const ToolHistory& tool) {
  report::Plot plot;
  plot.title = tool.title;
  plot.caption = tool.caption;
  plot.x_label = "time";
  plot.x_unit = "s";
  plot.y_label = tool.y_label;
  plot.height_px = 160;
  plot.series.push_back(series_of(tool.value, tool.y_label, tool.unit));
  if (tool.threshold > 0) plot.limits.push_back({tool.threshold, "alarm threshold", Level::none});
  shade_grave(run, tool.monitor, plot);
  for (const Event& e : run.events)
    if (e.monitor == tool.monitor && e.state == MonitorState::alarm)
      plot.marks.push_back({e.t_s, e.reason, Level::alarm});
  return plot;
}

/// What the program asks for, what was measured, and the band about the former.
report::Plot picture(const MonitorRun& run, const BandHistory& band) {
  report::Plot plot;
  plot.title = "Torque against the program";
  plot.caption =
      "Means over whole revolutions, and what the reference expects there. Gaps: the spindle "
      "stands or changes speed, the feed is held, or the reference does not know the block.";
  plot.x_label = "time";
  plot.x_unit = "s";
  plot.y_label = "torque";
  const auto add = [&](const Envelope& envelope, const char* name, bool limit) {
    report::Series s;
    s.name = name;
    s.unit = "Nm";
    s.dashed = s.faint = limit;
    envelope.means(kMeans, s.x, s.y);
    const double steps = static_cast<double>(s.x.size());
    const double usual = s.x.empty() ? 0 : (s.x.back() - s.x.front()) / steps;
    constexpr double kApart = 20;  // steps, from which on nothing is known between them
    for (std::size_t i = 1; i < s.x.size(); ++i)
      if (s.x[i] - s.x[i - 1] > kApart * usual) s.y[i] = std::nan("");
    plot.series.push_back(std::move(s));
  };
  add(band.lower, "lower limit", true);
  add(band.upper, "upper limit", true);
  add(band.expected, "expected", false);
  add(band.measured, "measured", false);
  shade_grave(run, MonitorId::torque_band, plot);
  return plot;
}

/// K_tc, K_te and the like over the run, with their intervals and what has changed them.
report::PlotGroup pictures(const CoefficientHistory& history) {
  struct Drawn {
    FoundPlace place;
    const char *title, *caption, *y_label, *unit;
  };
  constexpr Drawn kDrawn[] = {
      {kSpecificForce, "Specific cutting force",
       "At one chip thickness, whatever depth and feed are, after each group of revolutions. Gaps: "
       "the cuts have not told it. A flag is a change at once, from where on it is learned anew.",
       "force over chip area", "N/m2"},
      {kTangential, "Tangential coefficient K_tc", "", "K_tc", "N/m2"},
      {kTangentialEdge, "Tangential edge coefficient K_te", "", "K_te", "N/m"},
      {kRadialRatio, "Radial ratio", "", "K_rc / K_tc", ""}};
  constexpr double kSure = 1.96;
  report::PlotGroup group;
  for (const Drawn& drawn : kDrawn) {
    report::Plot plot;
    plot.title = drawn.title;
    plot.caption = drawn.caption;
    plot.x_label = "time";
    plot.x_unit = "s";
    plot.y_label = drawn.y_label;
    plot.height_px = 140;
    report::Series value, low, high;
    value.name = "estimate";
    low.name = "lower end of the 95 % interval";
    high.name = "upper end";
    low.dashed = high.dashed = low.faint = high.faint = true;
    for (report::Series* s : {&value, &low, &high}) s->unit = drawn.unit;
    bool any = false;
    for (const CoefficientHistory::Point& point : history.points) {
      const CuttingEstimate<double>& e = point.estimate[drawn.place];
      any = any || e.told;
      const double shown = e.told ? e.value : std::nan("");
      for (report::Series* s : {&value, &low, &high}) s->x.push_back(point.t_s);
      value.y.push_back(shown);
      low.y.push_back(shown - kSure * e.error);
      high.y.push_back(shown + kSure * e.error);
    }
    if (!any) continue;  // why it is not told is in the table below
    plot.series = {std::move(low), std::move(high), std::move(value)};
    const bool first = drawn.place == kSpecificForce;
    for (const CoefficientHistory::Change& c : history.changes)
      plot.marks.push_back(
          {c.t_s,
           first ? "changed by " + report::Cell(100 * c.share, 2).text + " %" : std::string(),
           Level::warning});
    if (first && history.taught_N_per_m2 > 0)
      plot.limits.push_back({history.taught_N_per_m2, "of the new tool", Level::none});
    if (first && history.worn_N_per_m2 > 0)
      plot.limits.push_back({history.worn_N_per_m2, "worn", Level::none});
    group.plots.push_back(std::move(plot));
  }
  return group;
}

report::Table table_of(const std::vector<FoundCoefficient>& found) {
  report::Table table{
      "", "At the end of the run.", {"coefficient", "value", "+- (95 %)", "unit", ""}, {}};
  for (const FoundCoefficient& f : found) {
    const std::string unit = f.unit == "1" ? "" : f.unit;
    if (f.told)
      table.rows.push_back(
          {{f.name, report::Cell(f.value, 4), report::Cell(1.96 * f.standard_error, 2), unit, ""},
           Level::none});
    else
      table.rows.push_back({{f.name, "", "", unit, "not told: " + f.why}, Level::none});
  }
  return table;
}

report::Table table_of_events(const MonitorRun& run) {
  report::Table events{
      "",
      "",
      {"time [s]", "monitor", "channel", "state", "value", "threshold", "what it means"},
      {}};
  constexpr std::size_t kMostRows = 60;
  for (const Event& e : run.events) {
    if (!is_grave(e.state)) continue;
    if (events.rows.size() == kMostRows) {
      events.caption =
          "The first " + std::to_string(kMostRows) + " are listed; the event file has all.";
      break;
    }
    const auto with_unit = [&](double value) {
      const report::Cell cell(value, 3);
      return report::Cell(cell.text + (e.unit.empty() ? "" : " " + e.unit));
    };
    events.rows.push_back({{report::Cell(e.t_s, 6), name_of(e.monitor), e.channel, name_of(e.state),
                            with_unit(e.value), with_unit(e.threshold), e.reason},
                           level_of(e.state)});
  }
  return events;
}

void add_tiles(const MonitorRun& run, Level verdict, report::Report& page) {
  report::KeyFigures key;
  // A tile in colour says its level in words: not twice the same.
  const bool said =
      run.verdict.word == VerdictWord::alarm || run.verdict.word == VerdictWord::warning;
  key.figures.push_back(
      {"verdict", report::Cell(name_of(run.verdict.word)), "", said ? Level::none : verdict});
  key.figures.push_back({"monitors that watched",
                         report::Cell(std::to_string(run.verdict.watched) + " of " +
                                      std::to_string(run.verdict.wanted)),
                         "", run.verdict.watched == 0 ? Level::warning : Level::none});
  key.figures.push_back({"alarms", report::Cell(static_cast<double>(run.alarms)), "",
                         run.alarms > 0 ? Level::alarm : Level::none});
  key.figures.push_back({"warnings", report::Cell(static_cast<double>(run.warnings)), "",
                         run.warnings > 0 ? Level::warning : Level::none});
  key.figures.push_back({"recorded", report::Cell(run.to_s - run.from_s, 3), "s"});
  key.figures.push_back({"sample rate", report::Cell(1 / run.sample_period_s, 4), "Hz"});
  for (const DriveHistory& drive : run.drives)
    key.figures.push_back({"largest on " + std::string(name_of(drive.channel)),
                           report::Cell(drive.estimate.largest_magnitude(), 3), drive.unit});
  page.add(std::move(key));
}

}  // namespace

Expected<Done> write_monitor_report(const MonitorRun& run, const std::string& path) {
  report::Report page("servosense monitor", run.trace + " on " + run.machine +
                                                (run.recorded.empty() ? "" : ", " + run.recorded));
  const Level level = run.alarms > 0                           ? Level::alarm
                      : run.verdict.word == VerdictWord::clear ? Level::info
                                                               : Level::warning;
  page.add(report::Note{run.verdict.sentence, level});
  add_tiles(run, level, page);
  for (const std::string& note : run.notes) page.add(report::Note{note, Level::info});
  for (const std::string& remark : run.plan.remarks) page.add(report::Note{remark, Level::info});
  if (run.missing > 0)
    page.add(report::Note{std::to_string(run.missing) +
                              " samples are missing from the trace; short "
                              "holes were bridged, monitors started anew after long ones.",
                          Level::warning});
  page.add(timeline(run));
  for (const DriveHistory& drive : run.drives) {
    page.add(report::Heading{drive_title(drive.channel)});
    page.add(pictures(run, drive));
    if (drive.spectrum.segments() > 0) page.add(spectrum(run, drive));
    // Of one value there is nothing to see.
    if (std::ranges::adjacent_find(drive.values, std::not_equal_to{}) != drive.values.end())
      page.add(histogram(drive));
  }
  if (!run.tool.empty()) {
    page.add(report::Heading{"Tool"});
    for (const ToolHistory& tool : run.tool) {
      if (tool.monitor == MonitorId::torque_band && run.band.steps > 0)
        page.add(picture(run, run.band));
      page.add(picture(run, tool));
    }
  }
  if (!run.coefficients.empty()) {
    page.add(report::Heading{"Cutting coefficients"});
    if (report::PlotGroup group = pictures(run.coefficient_history); !group.plots.empty())
      page.add(std::move(group));
    page.add(table_of(run.coefficients));
  }
  if (report::Table events = table_of_events(run); !events.rows.empty()) {
    page.add(report::Heading{"Events"});
    page.add(std::move(events));
  }
  page.add(report::Heading{"What was watched"});
  report::Table monitors{"", "", {"monitor", "channel", "runs", "watched [s]", ""}, {}};
  for (std::size_t i = 0; i < run.plan.monitors.size(); ++i) {
    const MonitorAvailability& m = run.plan.monitors[i];
    monitors.rows.push_back(
        {{name_of(m.monitor), std::string(name_of(m.channel)), m.runs ? "yes" : "no",
          report::Cell(run.watched[i].armed_s, 3), m.reason},
         Level::none});
  }
  page.add(std::move(monitors));
  page.add(report::Paragraph{"A monitoring aid, not a safety function."});
  return page.write(path);
}

}  // namespace servosense::cli
