#include "modes_trace.hpp"

#include <algorithm>
#include <array>

#include "servosense/io/drive_columns.hpp"
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

}  // namespace

Expected<ModesTrace> read_modes_trace(const Arguments& arguments) {
  for (const char* option : {"--frf", "--axis", "--order"})
    if (arguments.has(option))
      return usage_error(std::string(option) + " is of receptances; leave it out, or --trace");
  if (arguments.has("--out"))
    return usage_error(
        "--out: a machine file takes modes with their mass, which --trace does not tell; leave it "
        "out, or give receptances by --frf");
  ModesTrace out;
  const auto from = arguments.positive("--from");
  if (!from) return from.error();
  const auto to = arguments.positive("--to");
  if (!to) return to.error();
  if (*from && *to && **from >= **to) return usage_error("--from is not below --to; give a band");
  out.from_hz = *from, out.to_hz = *to;
  const auto named = arguments.value("--machine");
  const auto machine = named ? MachineFile::read(*named) : MachineFile::parse("", "--machine");
  if (!machine) return machine.error();
  std::vector<std::string> paths = arguments.all("--trace");
  paths.insert(paths.end(), arguments.operands().begin(), arguments.operands().end());
  out.column = arguments.value("--column").value_or("");
  out.remarks = {kMassUnknown};
  for (const std::string& path : paths) {
    if (std::count(paths.begin(), paths.end(), path) > 1)
      return usage_error("'" + path + "' is given twice");
    auto record = decay_record(path, out.column, *machine, out.remarks);
    if (!record) return record.error();
    out.records.push_back(std::move(*record));
  }
  return out;
}

std::string with_error(const Estimate& e, double scale) {
  return report::Cell(scale * e.value, 5).text + " +- " +
         report::Cell(scale * e.standard_error, 2).text;
}

}  // namespace servosense::cli
