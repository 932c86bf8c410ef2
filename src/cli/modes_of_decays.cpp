#include "modes_of_decays.hpp"

#include <algorithm>
#include <iostream>
#include <string>
#include <vector>

#include "console.hpp"
#include "modes_trace.hpp"
#include "servosense/identify/free_decay.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/report.hpp"

namespace servosense::cli {
namespace {

constexpr std::size_t kMostPictures = 6;

void print_decays_json(const FreeDecayIdentification& found, const std::string& column,
                       const std::vector<std::string>& remarks) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("column", column);
  json.objects("modes", found.modes, [&](const FreeDecayMode& m) {
    json.member("natural_frequency_hz", m.natural_frequency_hz.value);
    json.member("natural_frequency_hz_standard_error", m.natural_frequency_hz.standard_error);
    json.member("damping_ratio", m.damping_ratio.value);
    json.member("damping_ratio_standard_error", m.damping_ratio.standard_error);
    json.member("modal_mass_kg", nullptr);
    json.member("decays", m.decays);
    json.member("doubt", m.doubt);
  });
  json.objects("decays", found.decays, [&](const FreeDecay& d) {
    json.member("record", d.record);
    json.member("from_s", d.from_s);
    json.member("to_s", d.to_s);
    json.member("rotation_hz", d.rotation_hz);
  });
  json.member("ends", found.ends);
  json.objects("turned_down", found.turned_down, [&](const PoleTurnedDown& p) {
    json.member("frequency_hz", p.frequency_hz);
    json.member("damping_ratio", p.damping_ratio);
    json.member("reason", p.reason);
  });
  json.values("remarks", remarks);
  json.end_object();
  std::cout << '\n';
}

void print_decays_text(const FreeDecayIdentification& found, const std::string& column) {
  say("%s: %zu of %zu ends of cuts ring\n", column.c_str(), found.decays.size(), found.ends);
  say("   %-22s %-20s %s\n", "frequency, Hz", "damping, %", "in decays");
  for (const FreeDecayMode& m : found.modes)
    say("   %-22s %-20s %zu\n", with_error(m.natural_frequency_hz, 1).c_str(),
        with_error(m.damping_ratio, 100).c_str(), m.decays);
  for (const PoleTurnedDown& p : found.turned_down)
    say("   no mode at %.5g Hz, damping %.2g %%: %s\n", p.frequency_hz, 100 * p.damping_ratio,
        p.reason.c_str());
}

Expected<Done> write_decays_page(const std::string& path, const std::string& column,
                                 const FreeDecayIdentification& found,
                                 const std::vector<std::string>& remarks) {
  report::Report page("Modes from free decays", column);
  for (const std::string& remark : remarks)
    page.add(report::Note{remark + ".", report::Level::warning});
  report::Table modes{.title = "Modes", .caption = "With standard errors. No modal masses."};
  modes.header = {"natural frequency, Hz", "damping ratio, %", "in decays", "remark"};
  for (const FreeDecayMode& m : found.modes)
    modes.rows.push_back({{with_error(m.natural_frequency_hz, 1), with_error(m.damping_ratio, 100),
                           std::to_string(m.decays), m.doubt},
                          m.doubt.empty() ? report::Level::none : report::Level::warning});
  page.add(std::move(modes));
  for (std::size_t i = 0; i < std::min(found.decays.size(), kMostPictures); ++i) {
    const FreeDecay& d = found.decays[i];
    report::Plot plot;
    plot.title = d.record + " from " + report::Cell(d.from_s, 6).text + " s";
    plot.x_label = "time", plot.x_unit = "s";
    plot.y_label = column + ", less its mean in the air";
    plot.series = {{.name = "measured", .x = d.t_s, .y = d.measured},
                   {.name = "fitted", .x = d.t_s, .y = d.fitted}};
    plot.series[0].broad = true;
    page.add(std::move(plot));
  }
  report::Table others{.title = "Poles that are no modes", .folded = true};
  others.header = {"frequency, Hz", "damping ratio, %", "why not"};
  for (const PoleTurnedDown& p : found.turned_down)
    others.rows.push_back({{report::Cell(p.frequency_hz, 5).text,
                            report::Cell(100 * p.damping_ratio, 3).text, p.reason}});
  page.add(std::move(others));
  return page.write(path);
}

}  // namespace

int run_modes_of_decays(const Arguments& arguments) {
  auto traced = read_modes_trace(arguments);
  if (!traced) return fail(traced.error());
  auto& [column, records, remarks, from_hz, to_hz] = *traced;
  Progress progress("fitting", arguments.quiet());
  FreeDecayOptions options;
  options.from_hz = from_hz.value_or(options.from_hz);
  options.to_hz = to_hz.value_or(options.to_hz);
  options.progress = [&](double share) { progress.show(share); };
  const auto found = identify_free_decays(records, options);
  if (!found) return fail(found.error());
  for (const FreeDecayMode& m : found->modes)
    if (!m.doubt.empty())
      remarks.push_back("mode at " + report::Cell(m.natural_frequency_hz.value, 5).text +
                        " Hz: " + m.doubt);
  if (const auto page = arguments.value("--report"))
    if (auto done = write_decays_page(*page, column, *found, remarks); !done)
      return fail(done.error());
  for (const std::string& remark : remarks) note(remark, arguments.quiet());
  if (arguments.json())
    print_decays_json(*found, column, remarks);
  else
    print_decays_text(*found, column);
  return 0;
}

}  // namespace servosense::cli
