// report.html: what a machinist reads.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "servosense/io/report.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {
namespace {

std::string printed(double value, const char* format = "%.3g") {
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string list(const std::vector<NamedValue>& values, const std::vector<NamedValue>& errors) {
  std::string text;
  for (std::size_t p = 0; p < values.size(); ++p) {
    text += (p > 0 ? "; " : "") + values[p].key + " = " + values[p].text;
    for (std::size_t k = 0; k < values[p].values.size(); ++k) {
      text += (k > 0 ? ", " : "") + printed(values[p].values[k], "%.4g");
      if (p < errors.size() && k < errors[p].values.size() && errors[p].values[k] > 0)
        text += " +- " + printed(errors[p].values[k], "%.2g");
    }
  }
  return text;
}

report::Plot map_plot(const ResidualMap& before, const ResidualMap* after,
                      const std::string& unit) {
  report::Plot plot;
  plot.title = "Residual over " + before.variable;
  plot.caption = printed(100 * before.share) +
                 " % of the residual of the recalibrated model is a function of it" +
                 (before.probability <= 0.05 ? "." : ", no more than chance would do.");
  plot.x_label = before.variable;
  plot.x_unit = before.unit;
  plot.y_label = "residual";
  // Bins are of equal population; those of periodic or repeated values stay in order.
  plot.series.push_back(
      {"recalibrated", unit, before.at, before.mean, report::Series::Style::points});
  if (after != nullptr)
    plot.series.push_back(
        {"with the effects", unit, after->at, after->mean, report::Series::Style::points});
  return plot;
}

report::Table ranking_table(const std::string& title, const std::vector<RankedCandidate>& ranking,
                            const std::string& unit) {
  report::Table table;
  table.title = title;
  table.header = {"candidate", "gap left [" + unit + "]", "of the gap [%]",
                  "cannot be named because"};
  for (std::size_t i = 0; i < ranking.size() && i < 8; ++i)
    table.rows.push_back(
        {{ranking[i].name, ranking[i].gap_after, 100 * ranking[i].explained, ranking[i].objection},
         report::Level::none});
  return table;
}

}  // namespace

std::string summary_of(const Report& r, const std::string& who) {
  const std::string unit = " " + r.gap_unit;
  const std::string floor = " (floor " + printed(r.floors.used) + unit + ")";
  std::string s = who + ": ";
  if (!r.since.empty()) {
    s += r.changed.empty() ? "nothing has changed since " + r.since
                           : "changed since " + r.since + ":";
    for (std::size_t i = 0; i < r.changed.size(); ++i)
      s += (i == 0 ? " " : ", ") + r.changed[i].name + " (" + r.changed[i].parameter + " " +
           printed(r.changed[i].before) + " to " + printed(r.changed[i].after) + ")";
    return s;
  }
  if (r.effects.empty()) {
    s += r.verdict == Verdict::agrees
             ? "nothing is missing; once recalibrated, the model is within " +
                   printed(r.gap_after) + unit + " of the measurement" + floor
             : "a gap of " + printed(r.gap_after) + unit + floor +
                   " that no effect of the catalogue explains";
  } else {
    s += "missing";
    for (std::size_t i = 0; i < r.effects.size(); ++i) {
      s += (i == 0 ? " " : ", ") + r.effects[i].name;
      for (const std::string& other : r.effects[i].class_members) s += " or " + other;
      s += " (confidence " + printed(r.effects[i].confidence, "%.2f") + ")";
    }
    s += std::string("; with ") + (r.effects.size() > 1 ? "them" : "it") +
         " the gap shrinks from " + printed(r.gap_before) + " to " + printed(r.gap_after) + unit +
         floor;
    if (!r.monitors_before.empty() && !r.monitors_after.empty())
      s += ", and what the monitors read while nothing is cut from " +
           printed(r.monitors_before[0].second) + " to " + printed(r.monitors_after[0].second) +
           unit + " rms";
  }
  if (!r.second.trace.empty() && !r.effects.empty())
    s += "; on the second record it shrinks from " + printed(r.second.gap_before) + " to " +
         printed(r.second.gap_after) + unit;
  for (const SecondGap& g : r.second.refuted)
    s += "; " + g.name + " was found too, but does not hold on the second record";
  for (const TimeLine& line : r.lines)
    s += "; a line fixed in time, " + printed(line.amplitude) + unit + " at " +
         printed(line.frequency_hz) + " Hz";
  return s;
}

Expected<Done> write_page(const Report& r, const std::string& path) {
  report::Report page("Reconcile: " + r.channel, name_of(r.verdict));
  page.add(report::Note{r.summary, r.verdict == Verdict::agrees || r.verdict == Verdict::explained
                                       ? report::Level::info
                                       : report::Level::warning});
  report::KeyFigures key;
  const std::string& u = r.gap_unit;
  key.figures.push_back({"gap of the model as given", report::Cell(r.gap_nominal, 3), u});
  key.figures.push_back({"recalibrated", report::Cell(r.gap_before, 3), u});
  key.figures.push_back({"with what was missing", report::Cell(r.gap_after, 3), u});
  key.figures.push_back({"noise floor", report::Cell(r.floors.used, 3), u});
  if (!r.effects.empty())
    key.figures.push_back({"confidence", report::Cell(100 * r.effects[0].confidence, 2), "%"});
  page.add(key);
  page.add(report::Paragraph{"Gaps are rms over " + printed(r.held_from_s) + " to " +
                             printed(r.held_to_s) +
                             " s of the trace, which took no part in the fit."});

  if (!r.effects.empty()) {
    report::Table table;
    table.title = "What was missing";
    table.header = {"effect", "parameters", "gap before", "after", "confidence", "or"};
    for (const FoundEffect& e : r.effects) {
      std::string others;
      for (const std::string& name : e.class_members) others += (others.empty() ? "" : ", ") + name;
      if (!e.splitting_motion.empty())
        others += " (to tell them apart: " + e.splitting_motion + ")";
      table.rows.push_back(
          {{e.name, list(e.parameters, e.standard_errors), report::Cell(e.gap_before, 3),
            report::Cell(e.gap_after, 3), report::Cell(e.confidence, 2), others},
           report::Level::none});
    }
    page.add(table);
  }
  if (!r.changed.empty()) {
    report::Table table;
    table.title = "Changed since " + r.since;
    table.header = {"", "parameter", "before", "after", "standard error"};
    for (const Change& c : r.changed)
      table.rows.push_back({{c.name, c.parameter, report::Cell(c.before, 4),
                             report::Cell(c.after, 4), report::Cell(c.after_error, 2)},
                            report::Level::warning});
    page.add(table);
  }
  if (!r.second.trace.empty()) {
    report::Table table;
    table.title = "On the second record, " + r.second.trace + ", where nothing was fitted";
    table.header = {"", "gap before [" + u + "]", "after"};
    table.rows.push_back(
        {{"model as given", report::Cell(r.second.gap_nominal, 3), ""}, report::Level::none});
    for (const SecondGap& g : r.second.effects)
      table.rows.push_back({{g.shown ? g.name : g.name + " (this motion hardly shows it)",
                             report::Cell(g.gap_before, 3), report::Cell(g.gap_after, 3)},
                            report::Level::none});
    for (const SecondGap& g : r.second.refuted)
      table.rows.push_back({{g.name + ": does not hold, and is not named",
                             report::Cell(g.gap_before, 3), report::Cell(g.gap_after, 3)},
                            report::Level::warning});
    page.add(table);
  }
  if (!r.monitors_before.empty()) {
    report::Table table;
    table.title = "What it means for the monitors";
    table.header = {"", "before", "after"};
    for (std::size_t i = 0; i < r.monitors_before.size() && i < r.monitors_after.size(); ++i)
      table.rows.push_back(
          {{r.monitors_before[i].first, report::Cell(r.monitors_before[i].second, 3),
            report::Cell(r.monitors_after[i].second, 3)},
           report::Level::none});
    page.add(table);
  }

  report::PlotGroup group;
  group.title = "Measured and simulated";
  report::Plot force;
  force.x_label = "time";
  force.x_unit = "s";
  force.y_label = u == "Nm" ? "torque" : "force";
  force.series.push_back({"measured", u, r.time_s, r.measured});
  force.series.push_back({"recalibrated", u, r.time_s, r.simulated_before});
  force.series.push_back({"with the effects", u, r.time_s, r.simulated_after});
  force.spans.push_back({r.held_from_s, r.held_to_s, "kept for the proof", report::Level::info});
  report::Plot gap;
  gap.title = "What is left";
  gap.x_label = "time";
  gap.x_unit = "s";
  gap.y_label = "residual";
  Column before = r.measured, after = r.measured;
  for (std::size_t i = 0; i < before.size(); ++i) {
    // Ends of the record, standstill and faults say nothing.
    const bool compared = r.compared.empty() || r.compared[i];
    const double measured = compared ? r.measured[i] : std::nan("");
    before[i] = measured - (i < r.simulated_before.size() ? r.simulated_before[i] : 0);
    after[i] = measured - (i < r.simulated_after.size() ? r.simulated_after[i] : 0);
  }
  gap.series.push_back({"recalibrated", u, r.time_s, std::move(before)});
  gap.series.push_back({"with the effects", u, r.time_s, std::move(after)});
  gap.limits.push_back({r.floors.used, "noise floor", report::Level::info});
  gap.limits.push_back({-r.floors.used, "noise floor", report::Level::info});
  group.plots = {std::move(force), std::move(gap)};
  page.add(std::move(group));

  const std::string where = r.effects.empty() ? "" : r.effects[0].where;
  std::size_t drawn = 0;
  for (const ResidualMap& map : r.maps_before) {
    const bool wanted = map.variable == where || (drawn < 2 && map.share > 0.05);
    if (!wanted) continue;
    const ResidualMap* later = nullptr;
    for (const ResidualMap& m : r.maps_after)
      if (m.variable == map.variable) later = &m;
    page.add(map_plot(map, later, u));
    ++drawn;
  }
  for (const FoundEffect& e : r.effects)
    page.add(ranking_table("What else could be " + e.name, e.ranking, u));
  if (!r.ranking.empty() && r.verdict != Verdict::explained)
    page.add(ranking_table("Candidates for what is left", r.ranking, u));
  if (!r.residual_detail.empty()) page.add(report::Paragraph{r.residual_detail});

  report::Table calibrated;
  calibrated.title = "Recalibrated";
  calibrated.header = {"parameter", "from", "to", "standard error"};
  for (const Recalibrated& c : r.recalibrated)
    calibrated.rows.push_back({{c.parameter, report::Cell(c.from, 5), report::Cell(c.to, 5),
                                report::Cell(c.standard_error, 2)},
                               report::Level::none});
  if (!calibrated.rows.empty()) page.add(calibrated);

  report::Table smallest;
  smallest.title = "Smaller than this it would not have been seen";
  smallest.header = {"effect", "parameter", "from"};
  for (const Detectable& d : r.detectable)
    smallest.rows.push_back({{d.name, d.key, report::Cell(d.value, 3)}, report::Level::none});
  if (!smallest.rows.empty()) page.add(smallest);

  report::Table untested;
  untested.title = "Not testable with this record";
  untested.header = {"effect", "because", "would need"};
  for (const NotTestable& n : r.not_testable)
    untested.rows.push_back({{n.name, n.because, n.would_need}, report::Level::none});
  if (!untested.rows.empty()) page.add(untested);
  report::Table alike;
  alike.title = "Not to be told apart with this motion";
  alike.header = {"effects", "told apart by"};
  for (const Alike& a : r.classes) {
    std::string names;
    for (const std::string& name : a.names) names += (names.empty() ? "" : ", ") + name;
    alike.rows.push_back({{names, a.split_by}, report::Level::none});
  }
  if (!alike.rows.empty()) page.add(alike);
  for (const std::string& s : r.remarks) page.add(report::Paragraph{s});
  return page.write(path);
}

}  // namespace servosense::reconcile
