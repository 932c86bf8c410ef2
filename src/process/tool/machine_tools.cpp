#include "servosense/process/tool/machine_tools.hpp"

#include <string>

namespace servosense::process {
namespace {

CutterKind cutter_kind_from(const std::string& word) {
  for (const CutterKind kind : {CutterKind::flat, CutterKind::ball, CutterKind::bull,
                                CutterKind::taper, CutterKind::drill, CutterKind::tap})
    if (cutter_kind_name(kind) == word) return kind;
  return CutterKind::face;
}

}  // namespace

std::string tool_section(const MachineFile& file, int number) {
  std::string own = "tool." + std::to_string(number);
  return file.has_section(own) ? own : "tool";
}

Expected<const MillingTool*> MachineTools::of(int number) {
  auto& known = known_[number];
  if (known) return static_cast<const MillingTool*>(known.get());
  const std::string section = tool_section(*file_, number);
  if (!file_->has_section(section))
    return data_error(file_->name() + ": there is neither [tool." + std::to_string(number) +
                      "] nor [tool]; add one with kind and diameter_m");
  CutterShape shape;
  const auto diameter = file_->required_number(section, "diameter_m");
  if (!diameter) return diameter.error();
  shape.diameter_m = *diameter;
  if (const auto kind = file_->text(section, "kind")) shape.kind = cutter_kind_from(*kind);
  const auto take = [&](const char* key, double& value) {
    if (const auto given = file_->number(section, key)) value = *given;
  };
  take("corner_radius_m", shape.corner_radius_m);
  take("flute_length_m", shape.flute_length_m);
  take("stick_out_m", shape.stick_out_m);
  take("holder_diameter_m", shape.holder_diameter_m);
  take("point_angle_deg", shape.point_angle_deg);
  take("taper_deg", shape.taper_deg);
  take("entering_angle_deg", shape.entering_angle_deg);
  auto cutter = Cutter::of(shape);
  if (!cutter)
    return data_error(file_->where(section) + ": [" + section + "]: " + cutter.error().sentence);
  auto holder = cutter->holder();
  std::optional<int> teeth;
  if (const auto given = file_->number(section, "teeth")) teeth = static_cast<int>(*given);
  auto shank = cutter->shank();
  // A face mill has no edges below its middle.
  double ramp_angle_deg = shape.kind == CutterKind::face ? 0 : 90;
  take("ramp_angle_deg", ramp_angle_deg);
  known = std::make_unique<MillingTool>(
      MillingTool{std::move(*cutter), std::move(holder), std::move(shank), teeth,
                  file_->number(section, "length_m"), ramp_angle_deg});
  return static_cast<const MillingTool*>(known.get());
}

}  // namespace servosense::process
