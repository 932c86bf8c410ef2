#include "recommend_answer.hpp"

#include <algorithm>
#include <cmath>
#include <iostream>
#include <limits>

#include "console.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/report.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {

/// Less than this share of what would be removed if all were known is no good answer (chosen).
constexpr double kGoodAnswer = 0.5;
/// A cut whose label has so small a probability after all (chosen) does not fit the others.
constexpr double kDoubtful = 0.1;
/// A gain that is worth a measurement (chosen: the search itself is good to some per cent).
constexpr double kWorthIt = 0.03;

std::string mm(double m) { return printed(1e3 * m, 3) + " mm"; }
std::string per_cent(double share) { return printed(100 * share, 3) + " %"; }
std::string rpm(double speed) { return printed(std::round(speed), 6) + " rpm"; }
double cm3_min(double m3_s) { return 60e6 * m3_s; }

std::size_t nearest_speed(const Recommendation& r, double speed_rpm) {
  std::size_t nearest = 0;
  for (std::size_t i = 0; i < r.spindle_speed_rpm.size(); ++i)
    if (std::abs(r.spindle_speed_rpm[i] - speed_rpm) <
        std::abs(r.spindle_speed_rpm[nearest] - speed_rpm))
      nearest = i;
  return nearest;
}

double median_depth(const Recommendation& r, std::size_t speed) {
  const auto row = r.limit_depth_m.row(static_cast<Eigen::Index>(speed));
  return row[row.size() / 2];
}

std::string binding(const AdvisedCut& cut) {
  std::string all;
  for (const LimitAtCut& l : cut.limits)
    if (l.binds) all += (all.empty() ? "" : ", ") + l.name;
  return all;
}

/// Curve of depths over the speeds of the map; gaps beyond `deepest_m`.
report::Series depth_curve(const Recommendation& r, const char* name, double deepest_m,
                           const std::vector<double>& depth_m) {
  report::Series s;
  s.name = name;
  s.unit = "mm";
  s.x = r.spindle_speed_rpm;
  for (const double d : depth_m)
    s.y.push_back(d <= deepest_m ? 1e3 * d : std::numeric_limits<double>::quiet_NaN());
  return s;
}

report::HeatMap probability_map(const RecommendInputs& inputs, const RecommendAnswer& answer,
                                double probability) {
  const Recommendation& r = answer.found;
  double deepest_m = 0;
  for (std::size_t i = 0; i < r.spindle_speed_rpm.size(); ++i)
    deepest_m = std::max(deepest_m, std::min(median_depth(r, i), 3 * r.depth_m[i]));
  if (r.cut) deepest_m = std::max(deepest_m, 1.5 * r.cut->axial_depth_m);
  for (const WatchedCut& c : answer.cuts) deepest_m = std::max(deepest_m, 1.1 * c.axial_depth_m);
  deepest_m = std::min(deepest_m, inputs.limits.axial_depth_m);
  report::HeatMap map;
  map.title = "Probability that a cut is stable";
  map.caption =
      "Cuts below the curves are stable with that probability. Crosses: the advised cut, "
      "and cuts that were watched.";
  map.x_label = "spindle speed";
  map.x_unit = "rpm";
  map.y_label = "axial depth of cut";
  map.y_unit = "mm";
  map.z_label = "probability";
  map.height_px = 380;
  constexpr int kRows = 100;
  const auto& speed = r.spindle_speed_rpm;
  const std::size_t columns = speed.size();
  for (std::size_t i = 0; i < columns; ++i)
    map.x_edges.push_back(i == 0 ? speed[0] - (columns > 1 ? speed[1] - speed[0] : 2) / 2
                                 : (speed[i - 1] + speed[i]) / 2);
  map.x_edges.push_back(speed.back() + speed.back() - map.x_edges.back());
  for (int k = 0; k <= kRows; ++k) map.y_edges.push_back(1e3 * deepest_m * k / kRows);
  for (int k = 0; k < kRows; ++k)
    for (std::size_t i = 0; i < columns; ++i)
      map.z.push_back(r.probability(i, deepest_m * (k + 0.5) / kRows));
  std::vector<double> median;
  for (std::size_t i = 0; i < columns; ++i) median.push_back(median_depth(r, i));
  map.contours.push_back(depth_curve(r, per_cent(probability).c_str(), deepest_m, r.depth_m));
  map.contours.push_back(depth_curve(r, "50 %", deepest_m, median));
  if (!answer.zeroth_order_m.empty()) {
    map.contours.push_back(
        depth_curve(r, "zeroth order, values of the file", deepest_m, answer.zeroth_order_m));
    map.contours.back().dashed = true;
  }
  // Points would drown in the map: crosses, upright or diagonal.
  const double wide_rpm = 0.012 * (map.x_edges.back() - map.x_edges.front());
  const double high_mm = 0.025 * 1e3 * deepest_m;
  const auto crosses = [&](const char* name) {
    report::Series s;
    s.name = name;
    s.unit = "mm";
    return s;
  };
  const auto put = [&](report::Series& s, double speed_rpm, double depth_m, bool upright) {
    constexpr double kGap = std::numeric_limits<double>::quiet_NaN();
    const double y = 1e3 * depth_m, slant_rpm = upright ? 0 : wide_rpm,
                 slant_mm = upright ? 0 : high_mm;
    for (const double x : {speed_rpm - wide_rpm, speed_rpm + wide_rpm, kGap, speed_rpm - slant_rpm,
                           speed_rpm + slant_rpm, kGap})
      s.x.push_back(x);
    for (const double at : {y - slant_mm, y + slant_mm, kGap, y + high_mm, y - high_mm, kGap})
      s.y.push_back(at);
  };
  report::Series stable = crosses("+ watched, stable"), chatter = crosses("x watched, chatter"),
                 advised = crosses("+ advised cut"),
                 next = crosses("x test cut that would gain most");
  for (const WatchedCut& c : answer.cuts)
    put(c.stable ? stable : chatter, c.spindle_speed_rpm, c.axial_depth_m, c.stable);
  if (r.cut) put(advised, r.cut->spindle_speed_rpm, r.cut->axial_depth_m, true);
  if (r.next_cut && r.next_cut->axial_depth_m <= deepest_m)
    put(next, r.next_cut->spindle_speed_rpm, r.next_cut->axial_depth_m, false);
  for (report::Series* s : {&advised, &stable, &chatter, &next})
    if (!s->x.empty()) map.contours.push_back(std::move(*s));
  return map;
}

}  // namespace

void conclude(RecommendAnswer& answer, double probability) {
  const Recommendation& r = answer.found;
  if (answer.learned)
    for (std::size_t i = 0; i < answer.cuts.size(); ++i) {
      const double chatter = answer.learned->chatter_probability[i];
      if ((answer.cuts[i].stable ? 1 - chatter : chatter) < kDoubtful)
        answer.remarks.push_back(
            "cut " + std::to_string(i + 1) + " of the evidence (" +
            rpm(answer.cuts[i].spindle_speed_rpm) + ", " + mm(answer.cuts[i].axial_depth_m) + ", " +
            (answer.cuts[i].stable ? "stable" : "chatter") +
            ") does not fit the other cuts and the machine file: look whether it was noted right");
    }
  if (!r.cut) {
    answer.verdict = "none";
    answer.sentence = "no cut can be advised: " + r.why_not;
    return;
  }
  const AdvisedCut& c = *r.cut;
  const std::string cut = rpm(c.spindle_speed_rpm) + ", " + mm(c.axial_depth_m) + " deep, " +
                          mm(c.feed_per_tooth_m) + " a tooth";
  const bool good = c.removal_m3_s >= kGoodAnswer * r.removal_if_known_m3_s;
  answer.verdict = good ? "found" : "uncertain";
  if (good)
    answer.sentence = "the most productive cut at " + per_cent(probability) + " is " + cut;
  else
    answer.sentence = "too little is known for a good cut: at " + per_cent(probability) + " " +
                      cut + " removes " + per_cent(c.removal_m3_s / r.removal_if_known_m3_s) +
                      " of what could be expected if all were known; measure, or watch cuts";
}

void print_recommendation(const RecommendAnswer& answer) {
  const Recommendation& r = answer.found;
  say("%s\n", answer.sentence.c_str());
  if (!r.cut) return;
  say("  removes %.4g cm3/min, stable with a probability of %.1f %%; held back by %s\n",
      cm3_min(r.cut->removal_m3_s), 100 * r.cut->probability_stable,
      binding(*r.cut).empty() ? "nothing" : binding(*r.cut).c_str());
  for (const LimitAtCut& l : r.cut->limits)
    if (l.name != "stability") say("  %-18s %10.4g of %.4g\n", l.name.c_str(), l.value, l.limit);
  if (!answer.zeroth_order_m.empty()) {
    const std::size_t i = nearest_speed(r, r.cut->spindle_speed_rpm);
    const double middle = median_depth(r, i);
    if (std::isfinite(answer.zeroth_order_m[i]) && std::isfinite(middle))
      say("  limit near there: %s by semi-discretisation (middle), %s by the zeroth order\n",
          mm(middle).c_str(), mm(answer.zeroth_order_m[i]).c_str());
  }
  for (const MeasurementGain& g : r.gains)
    if (g.gain >= kWorthIt) say("  %+.0f %% by %s\n", 100 * g.gain, g.what.c_str());
  if (r.next_cut && r.next_cut->gain >= kWorthIt)
    say("  %+.0f %% expected from a test cut at %s, %s deep (stable with %.0f %%)\n",
        100 * r.next_cut->gain, rpm(r.next_cut->spindle_speed_rpm).c_str(),
        mm(r.next_cut->axial_depth_m).c_str(), 100 * r.next_cut->probability_stable);
}

void print_recommendation_json(const RecommendInputs& inputs, const RecommendAnswer& answer) {
  const Recommendation& r = answer.found;
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("verdict", answer.verdict);
  json.member("sentence", answer.sentence);
  json.member("spindle_speed_rpm", r.cut ? r.cut->spindle_speed_rpm : kNone);
  json.member("axial_depth_m", r.cut ? r.cut->axial_depth_m : kNone);
  json.member("feed_per_tooth_m", r.cut ? r.cut->feed_per_tooth_m : kNone);
  json.member("probability_stable", r.cut ? r.cut->probability_stable : kNone);
  json.member("removal_m3_s", r.cut ? r.cut->removal_m3_s : kNone);
  json.member("removal_if_known_m3_s", r.removal_if_known_m3_s);
  json.objects("limits", r.cut ? r.cut->limits : std::vector<LimitAtCut>{},
               [&](const LimitAtCut& l) {
                 json.member("name", l.name);
                 json.member("limit", l.limit);
                 json.member("value", l.value);
                 json.member("binds", l.binds);
               });
  json.objects("gains", r.gains, [&](const MeasurementGain& g) {
    json.member("measurement", g.what);
    json.member("gain", g.gain);
  });
  if (r.next_cut) {
    json.key("test_cut");
    json.begin_object();
    json.member("spindle_speed_rpm", r.next_cut->spindle_speed_rpm);
    json.member("axial_depth_m", r.next_cut->axial_depth_m);
    json.member("probability_stable", r.next_cut->probability_stable);
    json.member("gain", r.next_cut->gain);
    json.end_object();
  }
  if (answer.learned) {
    json.key("evidence");
    json.begin_object();
    json.member("cuts", answer.cuts.size());
    json.member("least_effective_share", answer.learned->least_effective_share);
    json.member("moved_share", answer.learned->moved_share);
    json.values("chatter_probability", answer.learned->chatter_probability);
    json.end_object();
  }
  json.objects("errors", inputs.errors, [&](const ErrorStated& e) {
    json.member("parameter", e.parameter);
    json.member("standard_error", e.standard_error);
    json.member("stated", e.stated);
    json.member("source", e.source);
  });
  std::vector<std::size_t> speeds(r.spindle_speed_rpm.size());
  for (std::size_t i = 0; i < speeds.size(); ++i) speeds[i] = i;
  json.objects("map", speeds, [&](std::size_t i) {
    json.member("spindle_speed_rpm", r.spindle_speed_rpm[i]);
    json.member("axial_depth_m", r.depth_m[i]);
    json.member("middle_axial_depth_m", median_depth(r, i));
    json.member("zeroth_order_axial_depth_m",
                answer.zeroth_order_m.empty() ? kNone : answer.zeroth_order_m[i]);
  });
  json.values("remarks", answer.remarks);
  json.end_object();
  std::cout << '\n';
}

Expected<Done> write_recommendation_report(const std::string& path, const std::string& machine,
                                           const RecommendInputs& inputs,
                                           const RecommendAnswer& answer, double probability) {
  const Recommendation& r = answer.found;
  report::Report page("Recommended cut", machine);
  page.add(report::Note{answer.sentence,
                        answer.verdict == "found" ? report::Level::info : report::Level::warning});
  if (r.cut) {
    report::KeyFigures figures;
    figures.figures = {
        {"spindle speed", report::Cell(std::round(r.cut->spindle_speed_rpm), 6), "rpm"},
        {"axial depth", report::Cell(1e3 * r.cut->axial_depth_m, 3), "mm"},
        {"feed per tooth", report::Cell(1e3 * r.cut->feed_per_tooth_m, 3), "mm"},
        {"removal", report::Cell(cm3_min(r.cut->removal_m3_s), 3), "cm3/min"},
        {"stable with", report::Cell(100 * r.cut->probability_stable, 3), "%"}};
    page.add(std::move(figures));
  }
  for (const std::string& remark : answer.remarks)
    page.add(report::Note{remark, report::Level::info});
  page.add(probability_map(inputs, answer, probability));
  if (r.cut) {
    report::Table limits{"Limits",
                         "Torque, power and deflection are exceeded with no more than the "
                         "remaining probability.",
                         {"limit", "allowed", "reached", ""},
                         {}};
    for (const LimitAtCut& l : r.cut->limits)
      limits.rows.push_back({{l.name, report::Cell(l.limit, 4), report::Cell(l.value, 4),
                              l.binds ? "holds the cut back" : ""},
                             report::Level::none});
    page.add(std::move(limits));
  }
  report::BarChart gains{"What would gain most",
                         "Expected removal rate at the same probability, were this known.",
                         "gain",
                         "%",
                         {}};
  for (const MeasurementGain& g : r.gains) gains.bars.push_back({g.what, 100 * g.gain});
  if (r.next_cut)
    gains.bars.push_back({"a test cut at " + rpm(r.next_cut->spindle_speed_rpm) + ", " +
                              mm(r.next_cut->axial_depth_m) + " deep",
                          100 * r.next_cut->gain});
  if (!gains.bars.empty()) page.add(std::move(gains));
  report::Table errors{"How well things are known",
                       "Standard errors, relative unless said otherwise.",
                       {"parameter", "standard error", "source"},
                       {}};
  for (const ErrorStated& e : inputs.errors)
    errors.rows.push_back({{e.parameter, report::Cell(e.standard_error, 3), e.source},
                           e.stated ? report::Level::none : report::Level::warning});
  page.add(std::move(errors));
  return page.write(path);
}

}  // namespace servosense::cli
