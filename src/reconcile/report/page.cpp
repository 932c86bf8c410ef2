// report.html: what a machinist reads.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>

#include "reconcile/report/maintenance_advice.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/report.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {
namespace {

std::string formatted(double value, const char* format = "%.3g") {
  char text[40];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

constexpr double kLeastFloorDrawn = 0.05;
constexpr double kLeastFloors = 3;  // that a map shows on either side
enum class Curve { measured, recalibrated, with_effects, floor };
report::Series curve(Curve what, std::string unit, Column x = {}, Column y = {}) {
  constexpr const char* kNames[] = {"measured", "recalibrated", "with the effects", "floor"};
  constexpr int kColours[] = {2, 0, 1, 7};
  const auto i = static_cast<std::size_t>(what);
  report::Series s{kNames[i], std::move(unit), std::move(x), std::move(y)};
  s.colour = kColours[i];
  s.broad = what == Curve::measured;
  s.dashed = what == Curve::with_effects;
  return s;
}

report::Table titled(std::string title, std::vector<std::string> header) {
  return {std::move(title), {}, std::move(header), {}};
}

void add_filled(report::Report& page, report::Table table) {
  if (!table.rows.empty()) page.add(std::move(table));
}

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

/// Measured, and simulated without the effects and with them.
void add_curves(report::Plot& plot, const std::string& unit, const Column& x, Column measured,
                Column before, Column after) {
  plot.series.push_back(curve(Curve::measured, unit, x, std::move(measured)));
  plot.series.push_back(curve(Curve::recalibrated, unit, x, std::move(before)));
  plot.series.push_back(curve(Curve::with_effects, unit, x, std::move(after)));
}

std::string list(const std::vector<NamedValue>& values, const std::vector<NamedValue>& errors) {
  std::string text;
  for (std::size_t p = 0; p < values.size(); ++p) {
    text += (p > 0 ? "; " : "") + values[p].key + " = " + values[p].text;
    for (std::size_t k = 0; k < values[p].values.size(); ++k) {
      text += (k > 0 ? ", " : "") + formatted(values[p].values[k], "%.4g");
      if (p < errors.size() && k < errors[p].values.size() && errors[p].values[k] > 0)
        text += " +- " + formatted(errors[p].values[k], "%.2g");
    }
  }
  return text;
}

/// The picture reaches some of the noise floor, so that noise looks like noise.
report::Plot map_plot(const Report& r, const ResidualMap& before, const ResidualMap* after) {
  const std::string& unit = r.gap_unit;
  const double floor = r.floors.used;
  report::Plot plot;
  plot.title = "Residual over " + before.variable;
  plot.caption =
      formatted(100 * before.share) +
      " % of the residual of the recalibrated model is a function of it" +
      (before.probability <= r.criteria.significant_map ? "." : ", no more than chance would do.");
  plot.x_label = before.variable;
  plot.x_unit = before.unit;
  plot.y_label = "residual";
  // Bins are of equal population; those of periodic or repeated values stay in order.
  plot.series.push_back(curve(Curve::recalibrated, unit, before.at, before.mean));
  if (after != nullptr)
    plot.series.push_back(curve(Curve::with_effects, unit, after->at, after->mean));
  double highest = kLeastFloors * floor;
  for (report::Series& s : plot.series) {
    s.style = report::Series::Style::points;
    for (const double y : s.y)
      if (std::isfinite(y)) highest = std::max(highest, 1.05 * std::abs(y));
  }
  plot.y_range = {-highest, highest};
  if (floor > kLeastFloorDrawn * highest) {  // else it would cover the points
    plot.limits.push_back({floor, "noise floor", report::Level::info});
    plot.limits.push_back({-floor, "", report::Level::info});
  }
  return plot;
}

report::Table ranking_table(const std::string& title, const std::vector<RankedCandidate>& ranking,
                            const std::string& unit) {
  report::Table table = titled(
      title, {"candidate", "gap left [" + unit + "]", "of the gap [%]", "cannot be named because"});
  for (std::size_t i = 0; i < ranking.size() && i < 8; ++i)
    table.rows.push_back({{ranking[i].name, ranking[i].gap_after, 100 * ranking[i].explained,
                           ranking[i].objection}});
  return table;
}

/// A position or speed with a prefix that reads well.
std::string length(double value, const std::string& unit, const char* micro = "µ") {
  const double size = std::abs(value);
  if (size >= 1 || size == 0) return formatted(value) + " " + unit;
  if (size >= 1e-3) return formatted(1e3 * value) + " m" + unit;
  return formatted(1e6 * value) + " " + micro + unit;
}

void add_simulations(report::Report& page, const Report& r) {
  const Proof& p = r.proof;
  if (p.motion_unit.empty()) return;
  const std::string& u = p.motion_unit;
  const FreeRun& free = p.free_run;
  page.add(report::Heading{"Simulated"});
  if (!free.not_shown.empty())
    page.add(report::Paragraph{"No run of the model left to itself: " + free.not_shown + "."});
  if (!free.horizons.empty()) {
    report::Table table;
    table.title = "Left to itself under the measured " + std::string(u == "m" ? "force" : "torque");
    table.caption = "Rms departure of the simulation from the measurement after so long, from " +
                    std::to_string(free.starts) +
                    " measured states in the held-out part. Floor: what noise alone causes.";
    table.header = {"after", "position, recalibrated", "with the effects",
                    "floor", "speed, recalibrated",    "with the effects",
                    "floor"};
    report::Plot growth;
    growth.title = "How far the simulation departs";
    growth.x_label = "horizon";
    growth.x_unit = "s";
    growth.y_label = "rms departure";
    growth.log_x = growth.log_y = true;
    for (const Curve what : {Curve::recalibrated, Curve::with_effects, Curve::floor})
      growth.series.push_back(curve(what, u));
    for (const FreeRun::Horizon& h : free.horizons) {
      const std::string per_s = u + "/s";
      table.rows.push_back(
          {{formatted(1000 * h.horizon_s) + " ms", length(h.position.before, u),
            length(h.position.after, u), length(h.position.floor, u), length(h.speed.before, per_s),
            length(h.speed.after, per_s), length(h.speed.floor, per_s)}});
      const double values[] = {h.position.before, h.position.after, h.position.floor};
      for (std::size_t k = 0; k < 3; ++k) {
        growth.series[k].x.push_back(h.horizon_s);
        growth.series[k].y.push_back(values[k]);
      }
    }
    page.add(table);
    page.add(growth);

    report::PlotGroup window;
    window.title = "One of these runs";
    report::Plot motion, departure;
    motion.x_label = departure.x_label = "time";
    motion.x_unit = departure.x_unit = "s";
    motion.y_label = "position";
    departure.y_label = "departure";
    add_curves(motion, u, free.time_s, free.measured, free.before, free.after);
    Column before = free.before, after = free.after;
    for (std::size_t i = 0; i < before.size(); ++i) {
      before[i] -= free.measured[i];
      after[i] -= free.measured[i];
    }
    departure.series.push_back(curve(Curve::recalibrated, u, free.time_s, std::move(before)));
    departure.series.push_back(curve(Curve::with_effects, u, free.time_s, std::move(after)));
    window.plots = {std::move(motion), std::move(departure)};
    page.add(std::move(window));
  }
  const ClosedLoop& loop = p.closed_loop;
  if (!loop.not_shown.empty()) {
    page.add(report::Paragraph{"Not simulated under its controller: " + loop.not_shown + "."});
    return;
  }
  report::Table table;
  table.title = "Under its controller, along the commanded motion";
  table.caption =
      "Rms of simulated less measured, in the held-out part. The measured following "
      "error is " +
      length(loop.following_rms, u) + " rms, the effort " + formatted(r.effort_rms) + " " +
      r.gap_unit + ".";
  table.header = {"", "recalibrated", "with the effects"};
  table.rows.push_back(
      {{"position", length(loop.position_before, u), length(loop.position_after, u)}});
  table.rows.push_back({{"effort [" + r.gap_unit + "]", report::Cell(loop.effort_before, 3),
                         report::Cell(loop.effort_after, 3)}});
  page.add(table);
}

void add_mean_turn(report::Report& page, const Report& r) {
  const MeanTurn& turn = r.mean_turn;
  if (turn.turns == 0) return;
  report::PlotGroup group;
  group.title = "A turn of the tool: mean of " + std::to_string(turn.turns) +
                (turn.held_out ? " turns kept for the proof, at " : " turns, at ") +
                length(turn.feed_per_tooth_m, "m") + " a tooth";
  Column degrees = turn.angle_rad;
  for (double& angle : degrees) angle *= 180 / kPi;
  for (const MeanTurn::Component& c : turn.components) {
    report::Plot plot;
    plot.x_label = "spindle angle";
    plot.x_unit = "°";
    plot.y_label = c.name;
    add_curves(plot, r.gap_unit, degrees, c.measured, c.before, c.after);
    group.plots.push_back(std::move(plot));
  }
  page.add(std::move(group));
}

/// What all this was decided by.
report::Table table_of(const Criteria& criteria) {
  report::Table table;
  table.title = "Criteria";
  table.folded = true;
  table.header = {"criterion", "value", "unit", "kind", "source", "calibrated on"};
  for (const Criterion& c : list_of_criteria()) {
    const bool own = criteria.*c.value != kCriteria.*c.value;
    table.rows.push_back(
        {{std::string(c.name), report::Cell(criteria.*c.value, 4), std::string(c.unit),
          name_of(c.kind), std::string(c.source), std::string(c.calibrated_on)},
         own ? report::Level::warning : report::Level::none});
  }
  return table;
}

/// What was missing, and what it means.
void add_missing(report::Report& page, const Report& r) {
  if (!r.effects.empty()) {
    report::Table table = titled(
        "What was missing", {"effect", "parameters", "gap before", "after", "confidence", "or"});
    for (const FoundEffect& e : r.effects) {
      std::string others = joined(e.class_members);
      if (!e.splitting_motion.empty())
        others += " (to tell them apart: " + e.splitting_motion + ")";
      table.rows.push_back(
          {{e.name, list(e.parameters, e.standard_errors), report::Cell(e.gap_before, 3),
            report::Cell(e.gap_after, 3), report::Cell(e.confidence, 2), others}});
    }
    page.add(table);
    report::Table words = titled("In plain words", {"effect", "what it means", "what to do"});
    for (const FoundEffect& e : r.effects)
      if (const MaintenanceAdvice w = maintenance_advice(e.name); !w.meaning.empty())
        words.rows.push_back({{e.name, std::string(w.meaning), std::string(w.remedy)}});
    add_filled(page, std::move(words));
  }
}

void add_changes(report::Report& page, const Report& r) {
  report::Table table =
      titled("Changed since " + r.since, {"", "parameter", "before", "after", "standard error"});
  for (const Change& c : r.changed)
    table.rows.push_back({{c.name, c.parameter, report::Cell(c.before, 4), report::Cell(c.after, 4),
                           report::Cell(c.after_error, 2)},
                          report::Level::warning});
  add_filled(page, std::move(table));
}

void add_second_record(report::Report& page, const Report& r) {
  const std::string& u = r.gap_unit;
  if (!r.second.trace.empty()) {
    report::Table table =
        titled("On the second record, " + r.second.trace + ", where nothing was fitted",
               {"", "gap before [" + u + "]", "after"});
    table.rows.push_back({{"model as given", report::Cell(r.second.gap_nominal, 3), ""}});
    for (const SecondGap& g : r.second.effects)
      table.rows.push_back({{g.shown ? g.name : g.name + " (this motion hardly shows it)",
                             report::Cell(g.gap_before, 3), report::Cell(g.gap_after, 3)}});
    for (const SecondGap& g : r.second.refuted)
      table.rows.push_back({{g.name + ": does not hold, and is not named",
                             report::Cell(g.gap_before, 3), report::Cell(g.gap_after, 3)},
                            report::Level::warning});
    page.add(table);
  }
}

void add_monitors(report::Report& page, const Report& r) {
  if (r.monitors_before.empty()) return;
  report::Table table = titled("What it means for the monitors", {"", "before", "after"});
  for (std::size_t i = 0; i < r.monitors_before.size() && i < r.monitors_after.size(); ++i)
    table.rows.push_back({{r.monitors_before[i].first, report::Cell(r.monitors_before[i].second, 3),
                           report::Cell(r.monitors_after[i].second, 3)}});
  page.add(table);
}

/// Measured and simulated, and what is left.
void add_records(report::Report& page, const Report& r) {
  const std::string& u = r.gap_unit;
  report::PlotGroup group;
  group.title = "Measured and simulated";
  report::Plot force;
  force.x_label = "time";
  force.x_unit = "s";
  force.y_label = u == "Nm" ? "torque" : "force";
  // What the filters make of the ends of the record is not drawn.
  const auto first = std::find(r.compared.begin(), r.compared.end(), true);
  const auto last = std::find(r.compared.rbegin(), r.compared.rend(), true).base();
  const auto inner = [&](Column column) {
    for (std::size_t i = 0; i < column.size() && i < r.compared.size(); ++i)
      if (i < static_cast<std::size_t>(first - r.compared.begin()) ||
          i >= static_cast<std::size_t>(last - r.compared.begin()))
        column[i] = std::nan("");
    return column;
  };
  add_curves(force, u, r.time_s, inner(r.measured), inner(r.simulated_before),
             inner(r.simulated_after));
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
  gap.series.push_back(curve(Curve::recalibrated, u, r.time_s, std::move(before)));
  gap.series.push_back(curve(Curve::with_effects, u, r.time_s, std::move(after)));
  gap.series.back().dashed = false;  // it lies on top
  gap.limits.push_back({r.floors.used, "noise floor", report::Level::info});
  gap.limits.push_back({-r.floors.used, "noise floor", report::Level::info});
  group.plots = {std::move(force), std::move(gap)};
  page.add(std::move(group));
}

void add_maps_and_rankings(report::Report& page, const Report& r) {
  const std::string& u = r.gap_unit;
  const std::string where = r.effects.empty() ? "" : r.effects[0].where;
  std::size_t drawn = 0;
  for (const ResidualMap& map : r.maps_before) {
    const bool wanted = map.variable == where || (drawn < 2 && map.share > 0.05 &&
                                                  map.probability <= r.criteria.significant_map);
    if (!wanted) continue;
    const ResidualMap* later = nullptr;
    for (const ResidualMap& m : r.maps_after)
      if (m.variable == map.variable) later = &m;
    page.add(map_plot(r, map, later));
    ++drawn;
  }
  for (const FoundEffect& e : r.effects)
    page.add(ranking_table("What else could be " + e.name, e.ranking, u));
  if (!r.ranking.empty() && r.verdict != Verdict::explained)
    page.add(ranking_table("Candidates for what is left", r.ranking, u));
  if (!r.residual_detail.empty()) page.add(report::Paragraph{r.residual_detail});
}

/// What was recalibrated, and what this record does not show.
void add_limits_of_record(report::Report& page, const Report& r) {
  report::Table calibrated = titled("Recalibrated", {"parameter", "from", "to", "standard error"});
  for (const Recalibrated& c : r.recalibrated)
    calibrated.rows.push_back({{c.parameter, report::Cell(c.from, 5), report::Cell(c.to, 5),
                                report::Cell(c.standard_error, 2)}});
  add_filled(page, std::move(calibrated));

  report::Table smallest =
      titled("Smaller than this it would not have been seen", {"effect", "parameter", "from"});
  for (const Detectable& d : r.detectable)
    smallest.rows.push_back({{d.name, d.key, report::Cell(d.value, 3)}});
  add_filled(page, std::move(smallest));

  report::Table untested =
      titled("Not testable with this record", {"effect", "because", "would need"});
  for (const NotTestable& n : r.not_testable)
    untested.rows.push_back({{n.name, n.because, n.would_need}});
  add_filled(page, std::move(untested));
  report::Table alike =
      titled("Not to be told apart with this motion", {"effects", "told apart by"});
  for (const Alike& a : r.classes) alike.rows.push_back({{joined(a.names), a.split_by}});
  add_filled(page, std::move(alike));
}

}  // namespace

std::string sentence_of(const BadSignal& bad) {
  return bad.column + ": " + formatted(100 * bad.share, "%.2g") + " % of the samples, from " +
         formatted(bad.from_s) + " s to " + formatted(bad.to_s) + " s, " + bad.fault +
         "; they are left out";
}

std::string summary_of(const Report& r, const std::string& subject) {
  const std::string unit = " " + r.gap_unit;
  const std::string floor = " (floor " + formatted(r.floors.used) + unit + ")";
  std::string s = subject + ": ";
  if (!r.since.empty()) {
    s += r.changed.empty() ? "nothing has changed since " + r.since
                           : "changed since " + r.since + ":";
    for (std::size_t i = 0; i < r.changed.size(); ++i)
      s += (i == 0 ? " " : ", ") + r.changed[i].name + " (" + r.changed[i].parameter + " " +
           formatted(r.changed[i].before) + " to " + formatted(r.changed[i].after) + ")";
    return s;
  }
  if (r.effects.empty()) {
    s += r.verdict == Verdict::agrees
             ? "nothing is missing; once recalibrated, the model is within " +
                   formatted(r.gap_after) + unit + " of the measurement, " +
                   formatted(100 * r.gap_after / r.effort_rms, "%.2g") + " % of the effort" + floor
             : "a gap of " + formatted(r.gap_after) + unit + floor +
                   " that no effect of the catalogue explains" +
                   (r.resembles.empty() ? "" : "; it looks like " + r.resembles);
  } else {
    s += "missing";
    std::string with;
    for (std::size_t i = 0; i < r.effects.size(); ++i) {
      const FoundEffect& e = r.effects[i];
      s += (i == 0 ? " " : ", ") + e.name;
      for (const std::string& other : e.class_members) s += " or " + other;
      s += " (confidence " + formatted(e.confidence, "%.2f");
      if (has_own_gap(e))
        s += std::string("; ") +
             (e.gap_band_hz > 0 ? "up to " + formatted(e.gap_band_hz) + " Hz "
                                : "seen by the scale ") +
             "the gap shrinks from " +
             (e.gap_unit.empty() ? formatted(e.gap_before) + " to " + formatted(e.gap_after) + unit
                                 : length(e.gap_before, e.gap_unit, "u") + " to " +
                                       length(e.gap_after, e.gap_unit, "u"));
      else
        with += (with.empty() ? "" : ", ") + e.name;
      s += ")";
    }
    if (!with.empty())
      s += "; with " +
           (std::any_of(r.effects.begin(), r.effects.end(), has_own_gap) ? with
            : r.effects.size() > 1                                       ? "them"
                                                                         : "it") +
           " the gap shrinks from " + formatted(r.gap_before) + " to " + formatted(r.gap_after) +
           unit + ", by " + formatted(100 * (1 - r.gap_after / r.gap_before)) + " %" + floor;
    else
      s += "; the gap is " + formatted(r.gap_after) + unit + floor;
    const char* gains[] = {", what the monitors read while nothing is cut from ",
                           ", their least threshold from ",
                           ", the smallest step of the force that they see from "};
    for (std::size_t i = 0; i < r.monitors_before.size() && i < std::size(gains); ++i)
      s += gains[i] + formatted(r.monitors_before[i].second) + " to " +
           formatted(r.monitors_after[i].second) + unit + (i == 0 ? " rms" : "");
  }
  if (!r.second.trace.empty() && !r.effects.empty()) {
    s += "; on the second record ";
    if (!std::all_of(r.effects.begin(), r.effects.end(), has_own_gap))
      s += "it shrinks from " + formatted(r.second.gap_before) + " to " +
           formatted(r.second.gap_after) + unit;
    else
      s += "it is " + formatted(r.second.gap_after) + unit;
    for (const SecondGap& g : r.second.effects)
      if (g.gap_band_hz > 0)
        s += ", up to " + formatted(g.gap_band_hz) + " Hz from " + formatted(g.gap_before) +
             " to " + formatted(g.gap_after) + unit;
  }
  for (const SecondGap& g : r.second.refuted)
    s += "; " + g.name + " was found too, but does not hold on the second record";
  for (const TimeLine& line : r.lines)
    s += "; a line fixed in time, " + formatted(line.amplitude) + unit + " at " +
         formatted(line.frequency_hz) + " Hz";
  return s;
}

std::string proof_of(const Report& r) {
  const Proof& p = r.proof;
  const auto plain = [&](double value) { return length(value, p.motion_unit, "u"); };
  const auto departs = [&](double before, double after) {
    return r.effects.empty()
               ? plain(after)
               : plain(before) + " without what was missing, by " + plain(after) + " with it";
  };
  std::string s;
  if (!p.free_run.horizons.empty()) {
    const FreeRun::Horizon& h = p.free_run.horizons.back();
    s += "left to itself for " + formatted(1000 * h.horizon_s) +
         " ms under the measured effort, the model departs from the measurement by " +
         departs(h.position.before, h.position.after) +
         " (noise alone: " + plain(h.position.floor) + ")";
  }
  const ClosedLoop& loop = p.closed_loop;
  if (!p.motion_unit.empty() && loop.not_shown.empty())
    s += (s.empty() ? "" : "; ") + std::string("under its controller by ") +
         departs(loop.position_before, loop.position_after);
  return s;
}

std::string maintenance_advice_of(const Report& r) {
  std::string text;
  for (const FoundEffect& e : r.effects)
    if (const MaintenanceAdvice w = maintenance_advice(e.name); !w.meaning.empty())
      text += (text.empty() ? "" : "\n") + e.name + ": " + std::string(w.meaning) + "; " +
              std::string(w.remedy);
  if (r.effects.empty() && r.verdict == Verdict::unexplained && !r.residual_white)
    text =
        "no name: the report shows at which speed, place or reversal the gap lies; record the same "
        "moves once more, for what is not there again was a disturbance of that run";
  return text;
}

Expected<Done> write_page(const Report& r, const std::string& path) {
  report::Report page("Reconcile: " + r.channel, name_of(r.verdict));
  for (const BadSignal& bad : r.bad_signals)
    page.add(report::Note{sentence_of(bad), report::Level::warning});
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
  page.add(report::Paragraph{"Gaps are rms over " + formatted(r.held_from_s) + " to " +
                             formatted(r.held_to_s) +
                             " s of the trace, which took no part in the fit."});

  add_missing(page, r);
  add_changes(page, r);
  add_second_record(page, r);
  add_monitors(page, r);
  add_records(page, r);
  add_mean_turn(page, r);
  add_simulations(page, r);

  add_maps_and_rankings(page, r);
  add_limits_of_record(page, r);
  for (const std::string& s : r.remarks) page.add(report::Paragraph{s});
  page.add(table_of(r.criteria));
  return page.write(path);
}

}  // namespace servosense::reconcile
