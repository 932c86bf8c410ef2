// servosense study warm-up: how friction changes while a machine warms up.
#include <cmath>
#include <iostream>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/identify/warm_up_study.hpp"
#include "study_page.hpp"

namespace servosense::cli {
namespace {

struct Warmed {
  Channel channel = Channel::x;
  std::string unit, speed_unit;
  WarmUpStudy study;
};

std::string sentence(const Warmed& w) {
  const WarmUpStudy& s = w.study;
  const auto text = [](double value) { return report::Cell(value, 3).text; };
  const double first = s.parts.front().friction;
  const std::string error = text(2 * s.change.standard_error) + " " + w.unit;
  std::string said = std::string(name_of(w.channel)) + ": friction at " + text(s.speed) + " " +
                     w.speed_unit + " is " + text(first) + " " + w.unit + " at first";
  if (!s.changes)
    return said + ", and changes by less than " +
           text(std::abs(s.change.value) + 2 * s.change.standard_error) + " " + w.unit +
           " along the record: no warm-up is seen";
  said += ", and " + text(std::abs(s.change.value)) + " +- " + error +
          (s.change.value < 0 ? " less" : " more") + " at the end";
  return said + (s.settles ? ", with a time constant of " + text(s.time_constant_s) + " s"
                           : "; the record is too short to see where it ends");
}

report::Plot friction_picture(const Warmed& w) {
  report::Plot plot;
  plot.title = std::string(name_of(w.channel)) + ": friction at " +
               report::Cell(w.study.speed, 3).text + " " + w.speed_unit;
  plot.caption = sentence(w) + ".";
  plot.x_label = "time", plot.x_unit = "s", plot.y_label = "friction";
  report::Series found{"parts of the record", w.unit}, curve{"end + drop exp(-t / tau)", w.unit};
  for (const WarmUpPart& p : w.study.parts) {
    const double t = (p.from_s + p.to_s) / 2;
    found.x.push_back(t), found.y.push_back(p.friction);
    curve.x.push_back(t), curve.y.push_back(w.study.at(t));
  }
  plot.series = {std::move(found)};
  if (w.study.changes) plot.series.push_back(std::move(curve));
  return plot;
}

report::Table parts_table(const Warmed& w) {
  report::Table table{
      std::string(name_of(w.channel)) + ": parts of the record",
      "Viscous and Coulomb friction with their standard errors, where the motion "
      "tells them apart.",
      {"from [s]", "friction [" + w.unit + "]", "viscous [" + w.unit + " per " + w.speed_unit + "]",
       "+-", "Coulomb [" + w.unit + "]", "+-"},
      {}};
  for (const WarmUpPart& p : w.study.parts) {
    const auto value = [](const std::optional<Estimate>& e) {
      return e ? report::Cell(e->value, 4) : report::Cell("");
    };
    const auto error = [](const std::optional<Estimate>& e) {
      return e ? report::Cell(e->standard_error, 2) : report::Cell("");
    };
    table.rows.push_back({{report::Cell(p.from_s, 4), report::Cell(p.friction, 4), value(p.viscous),
                           error(p.viscous), value(p.coulomb), error(p.coulomb)},
                          report::Level::none});
  }
  return table;
}

void write(JsonWriter& json, const Warmed& w) {
  const WarmUpStudy& s = w.study;
  json.member("drive", name_of(w.channel));
  json.member("unit", w.unit);
  json.member("speed", s.speed);
  json.member("changes", s.changes);
  json.member("change", s.change.value);
  json.member("change_standard_error", s.change.standard_error);
  json.member("settles", s.settles);
  json.member("time_constant_s", s.settles ? s.time_constant_s : std::nan(""));
  json.objects("parts", s.parts, [&](const WarmUpPart& p) {
    json.member("from_s", p.from_s);
    json.member("to_s", p.to_s);
    json.member("friction", p.friction);
    const auto estimate = [&](const char* name, const std::optional<Estimate>& e) {
      json.member(name, e ? e->value : std::nan(""));
      json.member(std::string(name) + "_standard_error", e ? e->standard_error : std::nan(""));
    };
    estimate("viscous", p.viscous);
    estimate("coulomb", p.coulomb);
  });
}

int run_study_warm_up(const Arguments& arguments) {
  if (!arguments.has("--machine") || !arguments.has("--trace"))
    return fail(usage_error(
        "give --machine and --trace: an idling run of that machine from cold, one motion again "
        "and again"));
  const auto parts = whole_option(arguments, "--parts", kFewestWarmUpParts, kMostWarmUpParts, 12);
  if (!parts) return fail(parts.error());
  const auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  const auto read = study_records(*machine, arguments.at("--trace"), arguments.quiet());
  if (!read) return fail(read.error());
  std::vector<Warmed> all;
  std::vector<Compared> rows;
  std::vector<std::string> refusals;
  for (const DriveRecord& r : read->records) {
    const HostDriveSlotConfig& slot = *read->plan.slot_of(r.channel);
    if (drive_stands(slot.observer, r)) continue;
    auto study = study_warm_up(slot.observer, r, *parts);
    if (!study) {
      refusals.push_back(study.error().sentence);
      continue;
    }
    const bool turns = is_turning(r.channel);
    all.push_back({r.channel, turns ? "Nm" : "N", turns ? "rad/s" : "m/s", std::move(*study)});
    if (!turns)
      rows.push_back({std::string(name_of(r.channel)) + ": change of friction along the record",
                      "<", 55, std::abs(all.back().study.change.value), "N",
                      "Koike 2016, fig. 4-24, 1st to 50th move at 50 m/min"});
  }
  if (all.empty())
    return fail(data_error(refusals.empty()
                               ? arguments.at("--trace") + ": no drive moves; record an idling run"
                               : refusals.front()));
  for (const std::string& refusal : refusals) note(refusal, arguments.quiet());
  if (const auto path = arguments.value("--report")) {
    report::Report page("Friction against warm-up", arguments.at("--trace"));
    page.add(report::Paragraph{
        "What was identified warm reads in the morning as a cut. The record is cut into parts of "
        "equal length; friction is the mean effort against the motion near the highest "
        "speed."});
    for (const std::string& refusal : refusals) page.add(report::Paragraph{refusal + "."});
    if (!rows.empty()) page.add(compared_table(rows));
    for (const Warmed& w : all) page.add(friction_picture(w)).add(parts_table(w));
    if (auto done = page.write(*path); !done) return fail(done.error());
  }
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    write_compared(json, rows);
    json.objects("drives", all, [&](const Warmed& w) { write(json, w); });
    json.values("not_told", refusals);
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  if (!rows.empty()) say_compared(rows);
  for (const Warmed& w : all) say("  %s\n", sentence(w).c_str());
  return 0;
}

}  // namespace

Program study_warm_up_program() {
  return {{"study warm-up", "how friction changes while a machine warms up",
           study_options({{"--parts", "N", "parts of the record, 6 to 200 (12)"}},
                         "idling run from cold, one motion again and again"),
           "",
           "Friction of each drive over time, its time constant, and where the motion tells them "
           "apart viscous and Coulomb friction; beside Koike 2016, fig. 4-24."},
          run_study_warm_up};
}

}  // namespace servosense::cli
