// servosense report: pictures of event files.
#include <algorithm>
#include <cstdio>
#include <iostream>
#include <map>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/io/event.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/report.hpp"

namespace servosense::cli {
namespace {

using report::Level;

int run_report(const Arguments& arguments) {
  if (arguments.operands().empty())
    return fail(
        usage_error("servosense report needs at least one event file; write one with 'servosense "
                    "monitor --events FILE'"));
  std::vector<Event> all;
  Progress progress("reading", arguments.quiet());
  for (const std::string& path : arguments.operands()) {
    progress.show(path, 1 + static_cast<std::size_t>(&path - arguments.operands().data()),
                  arguments.operands().size());
    auto events = read_events(path);
    if (!events) return fail(events.error());
    all.insert(all.end(), events->begin(), events->end());
  }
  // Every monitor that runs writes one when it begins.
  if (all.empty()) note("there is no event: nothing was watched", arguments.quiet());
  std::stable_sort(all.begin(), all.end(),
                   [](const Event& a, const Event& b) { return a.t_s < b.t_s; });

  struct Count {
    std::size_t alarms = 0, warnings = 0, faults = 0;
  };
  // In the order of their names.
  using Who = std::pair<std::string, std::string>;
  const auto who_says = [](const Event& e) { return Who{name_of(e.monitor), e.channel}; };
  std::map<Who, Count> counts;
  std::map<Who, report::Series> values;
  for (const Event& e : all) {
    Count& count = counts[who_says(e)];
    if (e.state == MonitorState::alarm) ++count.alarms;
    if (e.state == MonitorState::warning) ++count.warnings;
    if (e.state == MonitorState::signal_fault) ++count.faults;
    report::Series& series = values[who_says(e)];
    series.name = std::string(name_of(e.monitor)) + " on " + e.channel;
    series.unit = e.unit == "1" ? "" : e.unit;  // a ratio
    series.style = report::Series::Style::points;
    series.x.push_back(e.t_s);
    series.y.push_back(e.value);
  }
  std::string sources;
  for (const std::string& path : arguments.operands())
    sources += (sources.empty() ? "" : ", ") + path;
  report::Report page("servosense events", sources);
  Count total;
  for (const auto& [who, count] : counts) {
    total.alarms += count.alarms;
    total.warnings += count.warnings;
    total.faults += count.faults;
  }
  report::KeyFigures key;
  key.figures.push_back({"alarms", report::Cell(static_cast<double>(total.alarms)), "",
                         total.alarms > 0 ? Level::alarm : Level::none});
  key.figures.push_back({"warnings", report::Cell(static_cast<double>(total.warnings)), "",
                         total.warnings > 0 ? Level::warning : Level::none});
  key.figures.push_back({"signal faults", report::Cell(static_cast<double>(total.faults)), "",
                         total.faults > 0 ? Level::warning : Level::none});
  page.add(std::move(key));

  report::Table summary{
      "By monitor", "", {"monitor", "channel", "alarms", "warnings", "signal faults"}, {}};
  for (const auto& [who, count] : counts)
    summary.rows.push_back({{who.first, who.second, report::Cell(static_cast<double>(count.alarms)),
                             report::Cell(static_cast<double>(count.warnings)),
                             report::Cell(static_cast<double>(count.faults))},
                            count.alarms > 0 ? Level::alarm : Level::none});
  page.add(std::move(summary));

  for (auto& [who, series] : values) {
    report::Plot plot;
    plot.title = series.name;
    plot.caption = "Value of the monitor at each change of state.";
    plot.x_label = "time";
    plot.x_unit = "s";
    plot.y_label = "value";
    for (const Event& e : all)
      if (who_says(e) == who && e.state == MonitorState::alarm) {
        plot.marks.push_back({e.t_s, e.reason, Level::alarm});
        if (plot.limits.empty() && e.threshold > 0)
          plot.limits.push_back({e.threshold, "alarm threshold", Level::alarm});
      }
    plot.series.push_back(std::move(series));
    page.add(std::move(plot));
  }

  report::Table table{
      "Events",
      "",
      {"time [s]", "monitor", "channel", "state", "value", "threshold", "unit", "what it means"},
      {}};
  constexpr std::size_t kMostRows = 500;
  for (const Event& e : all) {
    if (table.rows.size() == kMostRows) {
      table.caption = "The first " + std::to_string(kMostRows) + " of " +
                      std::to_string(all.size()) + " events.";
      break;
    }
    table.rows.push_back({{report::Cell(e.t_s, 7), name_of(e.monitor), e.channel, name_of(e.state),
                           report::Cell(e.value, 4), report::Cell(e.threshold, 4),
                           e.unit == "1" ? "" : e.unit, e.reason},
                          e.state == MonitorState::alarm     ? Level::alarm
                          : e.state == MonitorState::warning ? Level::warning
                                                             : Level::none});
  }
  page.add(std::move(table));
  if (auto done = page.write(arguments.at("--out")); !done) return fail(done.error());
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("events", all.size());
    json.member("alarms", total.alarms);
    json.member("warnings", total.warnings);
    json.member("signal_faults", total.faults);
    json.member("report", arguments.at("--out"));
    json.end_object();
    std::cout << '\n';
  } else if (!arguments.quiet()) {
    say("%zu event(s), %zu alarm(s): %s\n", all.size(), total.alarms,
        arguments.at("--out").c_str());
  }
  return 0;
}

}  // namespace

Program report_program() {
  return {{"report",
           "pictures of what happened, from event files",
           {{"--out", "FILE", "HTML page to write", true, FileUse::output}},
           "EVENTS...",
           "EVENTS are files written by 'servosense monitor --events'."},
          run_report};
}

}  // namespace servosense::cli
