// servosense identify load-meter: what a spindle's load meter shows a watt, and its friction.
#include <cmath>
#include <cstdio>
#include <iostream>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "cutting_records.hpp"
#include "estimate_text.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/cutting.hpp"
#include "servosense/identify/load_meter.hpp"
#include "servosense/io/json.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kLoadMeterProvenance = "servosense identify load-meter";
constexpr const char* kConstantLoad = "effect.spindle.constant-load";

/// Stretches of air and of cutting with the mean of the volts in each.
Expected<std::vector<LoadMeterPoint>> points_of(const std::string& path, const MachineFile& machine,
                                                Progress& progress,
                                                std::vector<std::string>& remarks) {
  // The meter itself is what is sought: as a drive it cannot be read yet.
  MachineFile without = machine;
  without.remove("spindle", "load_meter_V_per_W");
  auto record = read_cutting_record(path, without, progress, remarks,
                                    Signal{Channel::spindle, Quantity::load_V});
  if (!record) return record.error();
  CuttingSignal& meter = record->signals.back();
  meter.is_drive = true;
  meter.lag_s =
      1 / (kTwoPi * machine.number("spindle", "current_filter_hz").value_or(kLoadMeter_hz));
  if (record->signals.front().name != "tool.torque_Nm")
    return data_error(path + ": there is no column tool.torque_Nm, the torque that is measured");
  CutGeometry any;  // the feed is not asked for
  any.feed_per_tooth_m = 1;
  record->feed_per_tooth_m.clear();
  auto cuts = find_cuts(*record, any);
  if (!cuts) return cuts.error();
  std::vector<LoadMeterPoint> points;
  for (const FoundCut& cut : *cuts)
    if (cut.used && std::isfinite(cut.means.back().standard_error))
      points.push_back({std::abs(cut.speed_rad_s), cut.means.back().value,
                        cut.means.back().standard_error, cut.air ? 0 : cut.means.front().value});
  return points;
}

int run_identify_load_meter(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  const std::vector<std::string>& traces = arguments.operands();
  if (traces.empty()) return fail(usage_error("give one trace or more of air and of cuts"));
  std::vector<std::string> remarks;
  std::vector<LoadMeterPoint> points;
  {
    Progress progress("reading", arguments.quiet());
    for (const std::string& path : traces) {
      auto more = points_of(path, *machine, progress, remarks);
      if (!more) return fail(more.error());
      points.insert(points.end(), more->begin(), more->end());
    }
  }
  auto meter = calibrate_load_meter(points);
  if (!meter) return fail(data_error(traces.front() + ": " + meter.error().sentence));
  machine->set("spindle", "load_meter_V_per_W", rounded(meter->volts_per_watt.value),
               plus_minus(meter->volts_per_watt));
  machine->set("spindle", "power_known_from_rpm", kLoadMeterFrom_rpm);
  machine->set("spindle", "viscous_friction_Nm_s_per_rad",
               rounded(std::max(0.0, meter->viscous_Nm_s_per_rad.value)),
               plus_minus(meter->viscous_Nm_s_per_rad));
  // A friction is not negative; the constant of the line may be, and acts like a load.
  const bool negative = meter->constant_Nm.value < 0;
  machine->remove_section(kConstantLoad);
  machine->set("spindle", "coulomb_friction_Nm", negative ? 0 : rounded(meter->constant_Nm.value));
  if (negative) {
    machine->set(kConstantLoad, "torque_Nm", rounded(meter->constant_Nm.value),
                 plus_minus(meter->constant_Nm));
    machine->set(kConstantLoad, "provenance", kLoadMeterProvenance);
  }
  if (auto done = machine->write(arguments.at("--out")); !done) return fail(done.error());
  for (const std::string& remark : remarks) note(remark, arguments.quiet());
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("out", arguments.at("--out"));
    write_estimate(json, "load_meter_V_per_W", meter->volts_per_watt);
    write_estimate(json, "viscous_friction_Nm_s_per_rad", meter->viscous_Nm_s_per_rad);
    write_estimate(json, "constant_Nm", meter->constant_Nm);
    json.member("misfit", meter->misfit);
    json.objects("points", points, [&](const LoadMeterPoint& p) {
      json.member("spindle_speed_rpm", rpm_from_rad_s(p.speed_rad_s));
      json.member("volts", p.volts);
      json.member("volts_standard_error", p.volts_error);
      json.member("torque_Nm", p.torque_Nm);
    });
    json.values("remarks", remarks);
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say("%zu stretches of air and of cuts\n", points.size());
  print_row("load meter", meter->volts_per_watt, "V/W");
  print_row("viscous friction", meter->viscous_Nm_s_per_rad, "Nm s/rad");
  print_row("constant friction", meter->constant_Nm, "Nm");
  if (negative)
    say("the constant is below zero, of a line through a Stribeck curve; it is written as a "
        "constant "
        "load and holds for one sense of rotation, above %g rpm\n",
        kLoadMeterFrom_rpm);
  say("written to %s\n", arguments.at("--out").c_str());
  return 0;
}

}  // namespace

Program identify_load_meter_program() {
  return {{"identify load-meter",
           "volts per watt and friction of a load meter, from air and reference cuts",
           {{"--machine", "FILE", "machine file to start from", true, FileUse::input},
            {"--out", "FILE", "machine file to write", true, FileUse::renewed}},
           "TRACE...",
           "Air at several speeds above 2000 rpm, and cuts whose torque a dynamometer on the tool\n"
           "measures: columns spindle.load_V, tool.torque_Nm and the speed of the spindle."},
          run_identify_load_meter};
}

}  // namespace servosense::cli
