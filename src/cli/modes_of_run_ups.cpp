#include "modes_of_run_ups.hpp"

#include <algorithm>
#include <iostream>
#include <string>
#include <vector>

#include "console.hpp"
#include "modes_trace.hpp"
#include "servosense/identify/run_up.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/report.hpp"

namespace servosense::cli {
namespace {

constexpr std::size_t kMostCrossings = 8;  // that are drawn

void print_run_ups_json(const RunUpIdentification& found, const ModesTrace& traced) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("column", traced.column);
  json.objects("modes", found.modes, [&](const RunUpMode& m) {
    json.member("natural_frequency_hz", m.natural_frequency_hz.value);
    json.member("natural_frequency_hz_standard_error", m.natural_frequency_hz.standard_error);
    json.member("damping_ratio", m.damping_ratio.value);
    json.member("damping_ratio_standard_error", m.damping_ratio.standard_error);
    json.member("modal_mass_kg", nullptr);
    json.member("doubt", m.doubt);
    json.objects("crossings", m.crossings, [&](const ModeCrossing& c) {
      json.member("record", c.record);
      json.member("order", c.order);
      json.member("at_s", c.at_s);
      json.member("rate_hz_per_s", c.rate_hz_per_s);
      json.member("relative_rate", c.relative_rate);
    });
  });
  json.member("sweeps", found.sweeps);
  json.member("from_hz", found.from_hz);
  json.member("to_hz", found.to_hz);
  json.objects("turned_down", found.turned_down, [&](const PoleTurnedDown& p) {
    json.member("frequency_hz", p.frequency_hz);
    json.member("damping_ratio", p.damping_ratio);
    json.member("reason", p.reason);
  });
  json.values("remarks", traced.remarks);
  json.end_object();
  std::cout << '\n';
}

/// "1 up at 3.2 s, 2 down at 9.1 s"
std::string orders_of(const RunUpMode& m) {
  std::string text;
  for (const ModeCrossing& c : m.crossings)
    text += (text.empty() ? "" : ", ") + std::to_string(c.order) +
            (c.rate_hz_per_s > 0 ? " up at " : " down at ") + report::Cell(c.at_s, 4).text + " s";
  return text;
}

void print_run_ups_text(const RunUpIdentification& found, const ModesTrace& traced) {
  say("%s: %zu sweep%s of the speed; orders reach from %.4g to %.4g Hz\n", traced.column.c_str(),
      found.sweeps, found.sweeps == 1 ? "" : "s", found.from_hz, found.to_hz);
  say("   %-22s %-20s %s\n", "frequency, Hz", "damping, %", "orders");
  for (const RunUpMode& m : found.modes)
    say("   %-22s %-20s %s\n", with_error(m.natural_frequency_hz, 1).c_str(),
        with_error(m.damping_ratio, 100).c_str(), orders_of(m).c_str());
  for (const PoleTurnedDown& p : found.turned_down)
    say("   no mode at %.5g Hz, damping %.2g %%: %s\n", p.frequency_hz, 100 * p.damping_ratio,
        p.reason.c_str());
}

Expected<Done> write_run_ups_page(const std::string& path, const RunUpIdentification& found,
                                  const ModesTrace& traced) {
  report::Report page("Modes from run-ups", traced.column);
  for (const std::string& remark : traced.remarks)
    page.add(report::Note{remark + ".", report::Level::warning});
  report::Table modes{.title = "Modes", .caption = "With standard errors. No modal masses."};
  modes.header = {"natural frequency, Hz", "damping ratio, %", "orders", "remark"};
  for (const RunUpMode& m : found.modes)
    modes.rows.push_back({{with_error(m.natural_frequency_hz, 1), with_error(m.damping_ratio, 100),
                           orders_of(m), m.doubt},
                          m.doubt.empty() ? report::Level::none : report::Level::warning});
  page.add(std::move(modes));
  std::size_t drawn = 0;
  for (const RunUpMode& m : found.modes)
    for (const ModeCrossing& c : m.crossings) {
      if (drawn++ >= kMostCrossings) break;
      report::Plot plot;
      plot.title = c.record + ", order " + std::to_string(c.order) + " at " +
                   report::Cell(c.at_s, 4).text + " s";
      plot.x_label = "frequency of the order", plot.x_unit = "Hz";
      plot.y_label = "amplitude of " + traced.column;
      plot.series = {{.name = "measured", .x = c.frequency_hz, .y = c.measured},
                     {.name = "fitted", .x = c.frequency_hz, .y = c.fitted}};
      plot.series[0].broad = true;
      page.add(std::move(plot));
    }
  report::Table others{.title = "Peaks that are no modes", .folded = true};
  others.header = {"frequency, Hz", "damping ratio, %", "why not"};
  for (const PoleTurnedDown& p : found.turned_down)
    others.rows.push_back({{report::Cell(p.frequency_hz, 5).text,
                            report::Cell(100 * p.damping_ratio, 3).text, p.reason}});
  page.add(std::move(others));
  return page.write(path);
}

}  // namespace

int run_modes_of_run_ups(const Arguments& arguments) {
  auto traced = read_modes_trace(arguments);
  if (!traced) return fail(traced.error());
  Progress progress("fitting", arguments.quiet());
  RunUpOptions options;
  options.from_hz = traced->from_hz.value_or(options.from_hz);
  options.to_hz = traced->to_hz.value_or(options.to_hz);
  options.progress = [&](double share) { progress.show(share); };
  const auto found = identify_run_ups(traced->records, options);
  if (!found) return fail(found.error());
  traced->remarks.push_back("modes below " + report::Cell(found->from_hz, 4).text + " and above " +
                            report::Cell(found->to_hz, 4).text +
                            " Hz are not told: no order of the rotation reaches them");
  for (const RunUpMode& m : found->modes)
    if (!m.doubt.empty())
      traced->remarks.push_back("mode at " + report::Cell(m.natural_frequency_hz.value, 5).text +
                                " Hz: " + m.doubt);
  if (const auto page = arguments.value("--report"))
    if (auto done = write_run_ups_page(*page, *found, *traced); !done) return fail(done.error());
  for (const std::string& remark : traced->remarks) note(remark, arguments.quiet());
  if (arguments.json())
    print_run_ups_json(*found, *traced);
  else
    print_run_ups_text(*found, *traced);
  return 0;
}

}  // namespace servosense::cli
