#include "modes_of_decays.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <string>
#include <vector>

#include "console.hpp"
#include "servosense/identify/free_decay.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/report.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/observer/machine_config.hpp"
#include "spindle_angle.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kMassUnknown =
    "modal mass is unknown: nothing measured the force that set the modes ringing; 'identify "
    "impact' measures it with a hammer";
constexpr std::size_t kMostPictures = 6;

/// In which ringing is sought unless told, the first that there is.
constexpr std::array kRings = {Quantity::acceleration_x_m_s2, Quantity::acceleration_y_m_s2,
                               Quantity::acceleration_m_s2,   Quantity::displacement_x_m,
                               Quantity::displacement_y_m,    Quantity::displacement_m,
                               Quantity::force_x_N,           Quantity::force_y_N,
                               Quantity::force_z_N,           Quantity::force_N,
                               Quantity::torque_Nm,           Quantity::current_A};

Expected<std::string> column_that_rings(const std::vector<Signal>& signals,
                                        const std::string& path) {
  for (const Quantity quantity : kRings)
    for (const Signal& s : signals)
      if (s.quantity == quantity) return column_name(s);
  return data_error(path +
                    ": there is no column of an acceleration, displacement, force, torque or "
                    "current; name one that it has with --column");
}

/// One trace: the column, and the turns of the spindle where something tells them.
Expected<DecayRecord> decay_record(const std::string& path, std::string& column,
                                   const MachineFile& machine, std::vector<std::string>& remarks) {
  auto reader = TraceReader::open(path);
  if (!reader) return reader.error();
  if (column.empty()) {
    auto found = column_that_rings(reader->signals(), path);
    if (!found) return found.error();
    column = *found;
    remarks.push_back(column + " is taken; --column says another");
  }
  const auto at = column_named(reader->signals(), column);
  if (!at)
    return data_error(path + ": there is no column " + column +
                      "; name one that it has with "
                      "--column");
  std::vector<TraceRow> rows;
  TraceRow row;
  for (;;) {
    auto more = reader->next(row);
    if (!more) return more.error();
    if (!*more) break;
    rows.push_back(row);
  }
  DecayRecord record;
  record.name = path + ": " + column;
  SpindleAngle spindle;
  if (motion_column(reader->signals(), tool_spindle(machine)) ||
      machine.number("cut", "spindle_speed_rpm")) {
    auto angle = spindle_angle(reader->signals(), rows, machine, path);
    if (!angle) return angle.error();
    spindle = std::move(*angle);
    if (!spindle.remark.empty()) remarks.push_back(spindle.remark);
  } else {
    remarks.push_back(
        path +
        ": the rotation is unknown, so a multiple of it that dies out slowly is taken "
        "for a mode; record spindle.angle_rad, or give [cut] spindle_speed_rpm");
  }
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const TraceField& field = rows[i].fields[*at];
    if (field.state == TraceField::State::empty) continue;
    record.t_s.push_back(seconds_from(rows[i].t_ns - rows.front().t_ns));
    record.value.push_back(field.value);
    if (!spindle.angle_rad.empty()) record.turns.push_back(spindle.angle_rad[i] / kTwoPi);
  }
  return record;
}

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

std::string decay_estimate(const Estimate& e, double scale) {
  return report::Cell(scale * e.value, 5).text + " +- " +
         report::Cell(scale * e.standard_error, 2).text;
}

void print_decays_text(const FreeDecayIdentification& found, const std::string& column) {
  say("%s: %zu of %zu ends of cuts ring\n", column.c_str(), found.decays.size(), found.ends);
  say("   %-22s %-20s %s\n", "frequency, Hz", "damping, %", "in decays");
  for (const FreeDecayMode& m : found.modes)
    say("   %-22s %-20s %zu\n", decay_estimate(m.natural_frequency_hz, 1).c_str(),
        decay_estimate(m.damping_ratio, 100).c_str(), m.decays);
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
    modes.rows.push_back({{decay_estimate(m.natural_frequency_hz, 1),
                           decay_estimate(m.damping_ratio, 100), std::to_string(m.decays), m.doubt},
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
  for (const char* option : {"--frf", "--axis", "--order"})
    if (arguments.has(option))
      return fail(
          usage_error(std::string(option) + " is of receptances; leave it out, or --trace"));
  if (arguments.has("--out"))
    return fail(
        usage_error("--out: a machine file takes modes with their mass, which --trace does "
                    "not tell; leave it out, or give receptances by --frf"));
  FreeDecayOptions options;
  const auto from = arguments.positive("--from");
  if (!from) return fail(from.error());
  const auto to = arguments.positive("--to");
  if (!to) return fail(to.error());
  options.from_hz = from->value_or(options.from_hz);
  options.to_hz = to->value_or(options.to_hz);
  if (options.from_hz >= options.to_hz)
    return fail(usage_error("--from is not below --to; give a band"));
  const auto named = arguments.value("--machine");
  const auto machine = named ? MachineFile::read(*named) : MachineFile::parse("", "--machine");
  if (!machine) return fail(machine.error());

  std::vector<std::string> paths = arguments.all("--trace");
  paths.insert(paths.end(), arguments.operands().begin(), arguments.operands().end());
  std::string column = arguments.value("--column").value_or("");
  std::vector<std::string> remarks = {kMassUnknown};
  std::vector<DecayRecord> records;
  Progress progress("fitting", arguments.quiet());
  for (const std::string& path : paths) {
    if (std::count(paths.begin(), paths.end(), path) > 1)
      return fail(usage_error("'" + path + "' is given twice"));
    auto record = decay_record(path, column, *machine, remarks);
    if (!record) return fail(record.error());
    records.push_back(std::move(*record));
  }
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
