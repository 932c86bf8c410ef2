// servosense identify modes: natural frequencies, damping and modal masses from receptances;
// without a hammer from what rings when a cut ends (modes_of_decays.cpp) and from run-ups of the
// spindle (modes_of_run_ups.cpp).
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "estimate_text.hpp"
#include "modes_of_decays.hpp"
#include "modes_of_run_ups.hpp"
#include "modes_page.hpp"
#include "servosense/identify/modes.hpp"
#include "servosense/io/frf_file.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {

using Triples = std::vector<std::array<double, 3>>;

struct AxisFiles {
  std::string axis;
  std::vector<std::string> files;  ///< the first is that of the point of the force
};

/// Which file is of which direction: as --axis says, else all of x.
Expected<std::vector<AxisFiles>> files_by_axis(const Arguments& arguments) {
  std::vector<std::string> files = arguments.all("--frf");
  files.insert(files.end(), arguments.operands().begin(), arguments.operands().end());
  std::vector<AxisFiles> all;
  std::map<std::string, std::string> axis_of;
  for (const std::string& word : arguments.all("--axis")) {
    const std::size_t equals = word.find('=');
    const std::string axis = word.substr(0, equals);
    if (equals == std::string::npos || (axis != "x" && axis != "y"))
      return usage_error("--axis " + in_quotes(word) + ": expected x=FILE or y=FILE");
    const std::string file = word.substr(equals + 1);
    if (std::find(files.begin(), files.end(), file) == files.end())
      return usage_error("--axis " + in_quotes(word) + ": give that file as --frf, too");
    if (!axis_of.emplace(file, axis).second)
      return usage_error("--axis names " + in_quotes(file) + " twice; a receptance has one axis");
    const auto same =
        std::find_if(all.begin(), all.end(), [&](const AxisFiles& a) { return a.axis == axis; });
    if (same == all.end())
      all.push_back({axis, {file}});
    else
      same->files.push_back(file);
  }
  if (all.empty()) all.push_back({"x", {}});
  for (const std::string& file : files) {
    if (std::count(files.begin(), files.end(), file) > 1)
      return usage_error(in_quotes(file) + " is given twice");
    if (axis_of.contains(file)) continue;
    if (all.size() > 1)
      return usage_error("say of which direction " + in_quotes(file) + " is: --axis x=" + file +
                         " or y=" + file);
    all.front().files.push_back(file);
  }
  std::sort(all.begin(), all.end(),
            [](const AxisFiles& l, const AxisFiles& r) { return l.axis < r.axis; });
  return all;
}

Expected<ModesOptions> modes_options(const Arguments& arguments) {
  ModesOptions options;
  const auto from = arguments.positive("--from");
  if (!from) return from.error();
  const auto to = arguments.positive("--to");
  if (!to) return to.error();
  const auto order = arguments.within("--order", 4, 200);
  if (!order) return order.error();
  options.from_hz = from->value_or(options.from_hz);
  options.to_hz = to->value_or(options.to_hz);
  options.highest_order = static_cast<int>(order->value_or(options.highest_order));
  if (options.from_hz >= options.to_hz) return usage_error("--from is not below --to; give a band");
  return options;
}

/// The machine file that the modes go into: --machine, else that of --out where there is one, else
/// an empty one.
Expected<MachineFile> machine_to_renew(const Arguments& arguments, const std::string& out) {
  if (const auto machine = arguments.value("--machine")) return MachineFile::read(*machine);
  std::error_code ignored;
  if (std::filesystem::is_regular_file(out, ignored)) return MachineFile::read(out);
  return MachineFile::parse("", out);
}

Expected<Done> write_modes(MachineFile& machine, const std::string& out,
                           const std::vector<ModesOfAxis>& all, std::vector<std::string>& remarks) {
  for (const ModesOfAxis& a : all) {
    Triples modes, errors;
    for (const IdentifiedMode& m : a.found.modes) {
      std::array<double, 3> values{}, relative{};
      std::size_t i = 0;
      for (const Estimate* e : {&m.natural_frequency_hz, &m.damping_ratio, &m.modal_mass_kg}) {
        values[i] = rounded(e->value);
        relative[i++] = std::strtod(printed(e->standard_error / e->value, 3).c_str(), nullptr);
      }
      modes.push_back(values);
      errors.push_back(relative);
    }
    const std::string section = "structure." + a.axis;
    if (const auto frf = machine.text(section, "frf"))
      remarks.push_back("[" + section + "] frf = " + *frf + " is replaced by the modes");
    machine.remove(section, "frf");
    machine.set(section, "modes", std::span<const std::array<double, 3>>(modes),
                "identify modes: " +
                    std::filesystem::path(a.found.receptances.front().name).filename().string());
    machine.set(section, "modes_relative_error", std::span<const std::array<double, 3>>(errors));
  }
  return machine.write(out);
}

void print_modes_json(const std::vector<ModesOfAxis>& all, const std::vector<std::string>& remarks,
                      const Arguments& arguments) {
  JsonWriter json(std::cout, 2);
  const auto estimate = [&](const std::string& name, const Estimate& e) {
    json.member(name, e.value);
    json.member(name + "_standard_error", e.standard_error);
  };
  json.begin_object();
  json.key("modes");
  json.begin_array();
  for (const ModesOfAxis& a : all)
    for (const IdentifiedMode& m : a.found.modes) {
      json.begin_object();
      json.member("axis", a.axis);
      estimate("natural_frequency_hz", m.natural_frequency_hz);
      estimate("damping_ratio", m.damping_ratio);
      estimate("modal_mass_kg", m.modal_mass_kg);
      json.member("lines_in_peak", m.lines_in_peak);
      json.member("doubt", m.doubt);
      json.objects("residues", m.residue_per_kg, [&](const Estimate& e) {
        json.member(
            "file",
            a.found.receptances[static_cast<std::size_t>(&e - m.residue_per_kg.data())].name);
        estimate("residue_per_kg", e);
      });
      json.end_object();
    }
  json.end_array();
  json.key("receptances");
  json.begin_array();
  for (const ModesOfAxis& a : all)
    for (const FittedReceptance& r : a.found.receptances) {
      json.begin_object();
      json.member("file", r.name);
      json.member("axis", a.axis);
      json.member("direct", r.direct);
      json.member("from_hz", r.frequency_hz.front());
      json.member("to_hz", r.frequency_hz.back());
      json.member("explained", r.explained);
      estimate("compliance_m_per_N", r.compliance_m_per_N);
      estimate("inverse_mass_per_kg", r.inverse_mass_per_kg);
      json.end_object();
    }
  json.end_array();
  json.key("turned_down");
  json.begin_array();
  for (const ModesOfAxis& a : all)
    for (const PoleTurnedDown& p : a.found.turned_down) {
      json.begin_object();
      json.member("axis", a.axis);
      json.member("frequency_hz", p.frequency_hz);
      json.member("damping_ratio", p.damping_ratio);
      json.member("reason", p.reason);
      json.end_object();
    }
  json.end_array();
  json.values("remarks", remarks);
  if (const auto out = arguments.value("--out")) json.member("out", *out);
  json.end_object();
  std::cout << '\n';
}

void print_modes_text(const std::vector<ModesOfAxis>& all, const Arguments& arguments) {
  const auto pair = [](const Estimate& e, double scale) {
    char text[48];
    std::snprintf(text, sizeof text, "%.5g +- %.2g", scale * e.value, scale * e.standard_error);
    return std::string(std::isnan(e.value) ? "unknown" : text);
  };
  for (const ModesOfAxis& a : all) {
    say("%s: %-22s %-20s %s\n", a.axis.c_str(), "frequency, Hz", "damping, %", "modal mass, kg");
    for (const IdentifiedMode& m : a.found.modes)
      say("   %-22s %-20s %s\n", pair(m.natural_frequency_hz, 1).c_str(),
          pair(m.damping_ratio, 100).c_str(), pair(m.modal_mass_kg, 1).c_str());
    const FittedReceptance& first = a.found.receptances.front();
    say("   explain %.3g %% of %s from %.4g to %.5g Hz\n", 100 * first.explained,
        first.name.c_str(), first.frequency_hz.front(), first.frequency_hz.back());
    for (const PoleTurnedDown& p : a.found.turned_down)
      say("   no mode at %.5g Hz, damping %.2g %%: %s\n", p.frequency_hz, 100 * p.damping_ratio,
          p.reason.c_str());
  }
  if (const auto out = arguments.value("--out")) say("written to %s\n", out->c_str());
}

Expected<std::vector<ModesOfAxis>> modes_of_files(const std::vector<AxisFiles>& axes,
                                                  ModesOptions options, bool quiet) {
  Progress progress("fitting", quiet);
  std::vector<ModesOfAxis> all;
  for (const AxisFiles& a : axes) {
    std::vector<MeasuredReceptance> measured;
    for (const std::string& file : a.files) {
      auto response = read_frf(file);
      if (!response) return response.error();
      measured.push_back({file, std::move(*response), measured.empty()});
    }
    options.progress = [&](double share) {
      progress.show((static_cast<double>(all.size()) + share) / static_cast<double>(axes.size()));
    };
    auto found = identify_modes(measured, options);
    if (!found) return found.error();
    all.push_back({a.axis, std::move(*found)});
  }
  return all;
}

int run_identify_modes(const Arguments& arguments) {
  if (arguments.has("--trace"))
    return arguments.has("--run-ups") ? run_modes_of_run_ups(arguments)
                                      : run_modes_of_decays(arguments);
  for (const char* option : {"--column", "--run-ups"})
    if (arguments.has(option))
      return fail(usage_error(std::string(option) + " is of a trace; give --trace"));
  if (!arguments.has("--frf"))
    return fail(usage_error("give a measured receptance: --frf FILE, or a trace of cuts: --trace"));
  const auto axes = files_by_axis(arguments);
  if (!axes) return fail(axes.error());
  const auto options = modes_options(arguments);
  if (!options) return fail(options.error());
  const auto all = modes_of_files(*axes, *options, arguments.quiet());
  if (!all) return fail(all.error());
  std::vector<std::string> remarks;
  for (const ModesOfAxis& a : *all) {
    for (const std::string& remark : a.found.remarks) remarks.push_back(remark);
    for (const IdentifiedMode& m : a.found.modes)
      if (!m.doubt.empty())
        remarks.push_back("mode of " + a.axis + " at " + printed(m.natural_frequency_hz.value, 5) +
                          " Hz: " + m.doubt);
  }
  if (arguments.all("--axis").empty()) {
    const bool several = axes->front().files.size() > 1;
    remarks.push_back(axes->front().files.front() +
                      " is taken as the receptance of x at the point of the force" +
                      (several ? ", the others as of other points; --axis says which is of y"
                               : "; --axis y=FILE says that it is of y"));
  }
  if (const auto out = arguments.value("--out")) {
    auto machine = machine_to_renew(arguments, *out);
    if (!machine) return fail(machine.error());
    if (auto done = write_modes(*machine, *out, *all, remarks); !done) return fail(done.error());
  }
  if (const auto page = arguments.value("--report"))
    if (auto done = write_modes_page(*page, *all); !done) return fail(done.error());
  for (const std::string& remark : remarks) note(remark, arguments.quiet());
  if (arguments.json())
    print_modes_json(*all, remarks, arguments);
  else
    print_modes_text(*all, arguments);
  return 0;
}

}  // namespace

Program identify_modes_program() {
  return {
      {"identify modes",
       "natural frequencies, damping and modal masses from receptances, ends of cuts or run-ups",
       {{.name = "--frf",
         .value = "FILE",
         .meaning = "receptance; several of one direction share their poles",
         .use = FileUse::input,
         .repeated = true},
        {.name = "--axis",
         .value = "x=FILE",
         .meaning = "direction (x, y) of a receptance (x); the first of each is of the point "
                    "of the force",
         .repeated = true},
        {.name = "--trace",
         .value = "FILE",
         .meaning = "instead: cuts that end in the air; frequency and damping of what rings then",
         .use = FileUse::input,
         .repeated = true},
        {"--run-ups", "",
         "of --trace: run-ups and run-downs of the spindle, whose orders sweep through modes",
         false},
        {"--column", "COLUMN",
         "of --trace (the first acceleration, displacement, force, torque, "
         "current)",
         false},
        {"--machine", "FILE", "machine file that the modes are added to", false, FileUse::input},
        {"--out", "FILE", "machine file to write, or to add the modes to", false, FileUse::renewed},
        {"--from", "HZ", "lowest frequency that is used", false},
        {"--to", "HZ", "highest frequency that is used", false},
        {"--order", "N", "highest order of the stabilisation diagram (40)", false},
        {"--report", "HTML", "page with receptances, fit and stabilisation diagram", false,
         FileUse::output}},
       "FILE...",
       "A receptance file has frequency_hz, receptance_re_m_per_N and receptance_im_m_per_N, as "
       "'servosense\n"
       "identify impact' writes it; FILE... are further ones. Only the receptance at the point "
       "of the force\n"
       "tells modal masses. Without --machine the modes go into the file of --out, the rest of "
       "which stays.\n"
       "Of --trace, --machine tells the encoder or the speed of the spindle; modal mass stays "
       "unknown."},
      run_identify_modes};
}

}  // namespace servosense::cli
