#include "servosense/process/torque/tool_law.hpp"

namespace servosense::process {
namespace {

/// Edges of a drill that says nothing else (twist drills).
constexpr int kDrillEdges = 2;

}  // namespace

Expected<const ToolLaw*> ToolLaws::of(int number) {
  auto& known = known_[number];
  if (known) return static_cast<const ToolLaw*>(known.get());
  const std::string section = tool_section(*file_, number);
  MachineTools tools(*file_);
  const auto tool = tools.of(number);
  if (!tool) return tool.error();
  const auto number_of = [&](const char* key) { return file_->number(section, key); };
  ToolLaw law;
  law.kind = (*tool)->cutter.shape().kind;
  law.radius_m = (*tool)->cutter.shape().diameter_m / 2;
  law.teeth = (*tool)->teeth.value_or(law.kind == CutterKind::drill ? kDrillEdges
                                      : law.kind == CutterKind::tap ? 1
                                                                    : 0);
  law.helix_deg = number_of("helix_deg").value_or(0);
  if (auto throws = file_->list(section, "throw_m")) law.throw_m = std::move(*throws);
  if (!law.throw_m.empty() && static_cast<int>(law.throw_m.size()) != law.teeth)
    return data_error(file_->where(section, "throw_m") + ": [" + section + "] throw_m has " +
                      std::to_string(law.throw_m.size()) + " numbers for " +
                      std::to_string(law.teeth) + " teeth; give one a tooth");
  if (law.teeth > 0) {
    servosense::MillingTool with_throw;
    with_throw.teeth = law.teeth, with_throw.throw_m = std::move(law.throw_m);
    add_offset(with_throw, number_of("runout_m").value_or(0), 0);
    law.throw_m = std::move(with_throw.throw_m);
  }
  const auto tangential = number_of("tangential_coefficient_N_per_m2");
  if (tangential) {
    CuttingForceLaw force;
    force.tangential_coefficient_N_per_m2 = *tangential;
    force.tangential_edge_N_per_m = number_of("tangential_edge_N_per_m").value_or(0);
    force.radial_edge_N_per_m = number_of("radial_edge_N_per_m").value_or(0);
    force.axial_coefficient_N_per_m2 = number_of("axial_coefficient_N_per_m2").value_or(0);
    force.axial_edge_N_per_m = number_of("axial_edge_N_per_m").value_or(0);
    const auto ratio = number_of("radial_ratio");
    force.radial_ratio = ratio.value_or(0);
    law.torque = TorqueEquation::mechanistic(law.teeth, *tangential, force.tangential_edge_N_per_m);
    law.relative_error = number_of("tangential_coefficient_relative_error");
    if (ratio) law.force = force;
  }
  if (const auto k = file_->triples(section, "torque_equation"); k && law.kind != CutterKind::tap) {
    law.torque = TorqueEquation::of(k->front()[0], k->front()[1], k->front()[2]);
    law.from_equation = true;
    law.relative_error = number_of("torque_equation_relative_error");
  }
  const std::string name = "[" + section + "] ";
  if (!law.torque)
    law.lacks =
        name + (law.kind == CutterKind::tap ? "tangential_coefficient_N_per_m2"
                                            : "torque_equation or tangential_coefficient_N_per_m2");
  else if (law.teeth == 0)
    law.lacks = name + "teeth", law.torque.reset();
  known = std::make_unique<ToolLaw>(std::move(law));
  return static_cast<const ToolLaw*>(known.get());
}

}  // namespace servosense::process
